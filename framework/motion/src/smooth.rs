//! Zero-lag smoothing of paths: a Butterworth low-pass, forwards and then backwards.
//!
//! Source: D. A. Winter, *Biomechanics and Motor Control of Human Movement*, 4th edition, 2009, section 3.4.4.2, whose letters the table has.
//!
//! | here | source | meaning | unit |
//! |---|---|---|---|
//! | `cutoff_hz` | f_c | where both passes together pass 1/√2 of an amplitude | Hz |
//! | `correction` | C | (2^(1/2) − 1)^(1/4): factor between the cut-offs of both passes and of one | – |
//! | `omega` | ω_c | tan(π f_c / f_s) / C | – |
//! | `k1`, `k2` | K₁, K₂ | √2 ω_c, ω_c² | – |
//!
//! Second order, so fourth with both passes. Each run of samples without a gap is filtered on its own: its ends are
//! extended by their mirror image through the end sample,
//! and the filter starts at rest there, as in `scipy.signal.filtfilt`.

use nalgebra::{Point3, Vector3};

use crate::motion::Motion;

/// The shortest run that is filtered is longer than this: three times the filter's length, as in SciPy.
const PAD: usize = 9;
/// Periods of the cut-off by which a run is continued at either end, as far as it is as long itself: what the filter's start leaves has gone to a ten-millionth by then.
const PERIODS: f64 = 3.0;

/// What [`smooth`] did, for reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Smoothed {
    /// Number of samples filtered.
    pub n_samples: usize,
    /// Number of samples in runs too short to be filtered, which are unchanged.
    pub n_too_short: usize,
}

/// A second-order section y[n] = b₀ x[n] + b₁ x[n−1] + b₂ x[n−2] − a₁ y[n−1] − a₂ y[n−2].
#[derive(Debug, Clone, Copy)]
struct Filter {
    b: [f64; 3],
    a: [f64; 2],
    /// Samples by which a run is continued.
    pad: usize,
}

impl Filter {
    /// A single pass, such that two have this cut-off.
    fn new(cutoff_hz: f64, rate_hz: f64) -> Self {
        let correction = (2.0_f64.sqrt() - 1.0).powf(0.25);
        let omega = (std::f64::consts::PI * cutoff_hz / rate_hz).tan() / correction;
        let (k1, k2) = (std::f64::consts::SQRT_2 * omega, omega * omega);
        let b0 = k2 / (1.0 + k1 + k2);
        let a1 = (2.0 * k2 - 2.0) / (1.0 + k1 + k2);
        let a2 = (1.0 - k1 + k2) / (1.0 + k1 + k2);
        let pad = (PERIODS * rate_hz / cutoff_hz).ceil() as usize;
        Self { b: [b0, 2.0 * b0, b0], a: [a1, a2], pad: pad.max(PAD) }
    }

    /// One pass over `values`, in the order that they come in; before the first it was at rest there.
    fn pass<'a>(&self, values: impl Iterator<Item = &'a mut Vector3<f64>>) {
        let Self { b: [b0, b1, b2], a: [a1, a2], .. } = *self;
        let mut memory: Option<[Vector3<f64>; 2]> = None;
        for value in values {
            let x = *value;
            // Of a constant x the output is x.
            let [z1, z2] = memory.unwrap_or([x * (1.0 - b0), x * (b2 - a2)]);
            let y = x * b0 + z1;
            memory = Some([x * b1 - y * a1 + z2, x * b2 - y * a2]);
            *value = y;
        }
    }

    /// Both passes over one run.
    fn both(&self, run: &[Point3<f64>]) -> Vec<Point3<f64>> {
        let (first, last) = (run[0].coords, run[run.len() - 1].coords);
        let pad = self.pad.min(run.len() - 1);
        let before = (1..=pad).rev().map(|it| first * 2.0 - run[it].coords);
        let behind = (1..=pad).map(|it| last * 2.0 - run[run.len() - 1 - it].coords);
        let mut values: Vec<Vector3<f64>> = before.chain(run.iter().map(|it| it.coords)).chain(behind).collect();
        self.pass(values.iter_mut());
        self.pass(values.iter_mut().rev());
        values[pad..pad + run.len()].iter().map(|it| Point3::from(*it)).collect()
    }
}

/// Filters every point of a motion with a regular frame rate, in place.
///
/// # Errors
/// A sentence: the times are not regular, or the cut-off is not between 0 and half the rate.
pub fn smooth(motion: &mut Motion, cutoff_hz: f64) -> Result<Smoothed, String> {
    let Some(rate_hz) = motion.rate_hz else {
        return Err("found irregular times, expected frames at one rate (resample them first)".to_owned());
    };
    // With the correction for two passes the cut-off of one must stay below half the rate, too: tan has no bound, so any below it does.
    if !(cutoff_hz > 0.0 && cutoff_hz < rate_hz / 2.0) {
        return Err(format!(
            "found a cut-off of {cutoff_hz} Hz at {rate_hz} Hz, expected more than 0 and less than {}",
            rate_hz / 2.0
        ));
    }
    let filter = Filter::new(cutoff_hz, rate_hz);
    let (n_points, n_frames) = (motion.labels.len(), motion.n_frames());
    let mut smoothed = Smoothed::default();
    for point in 0..n_points {
        let mut start = 0;
        while start < n_frames {
            let run: Vec<Point3<f64>> =
                (start..n_frames).map_while(|it| motion.get(it, point)).map(|it| it.position).collect();
            if run.len() > PAD {
                smoothed.n_samples += run.len();
                for (frame, place) in (start..).zip(filter.both(&run)) {
                    if let Some(sample) = &mut motion.samples[frame * n_points + point] {
                        sample.position = place;
                    }
                }
            } else {
                smoothed.n_too_short += run.len();
            }
            start += run.len().max(1);
        }
    }
    if smoothed.n_samples > 0 {
        motion.skeleton = None;
    }
    Ok(smoothed)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::Sample;

    fn of(values: &[Option<f64>]) -> Motion {
        let sample = |it: &Option<f64>| it.map(|x| Sample::at(Point3::new(x, -x, 1.0)));
        Motion {
            labels: vec!["a".to_owned()],
            times_s: (0..values.len()).map(|it| it as f64 / 100.0).collect(),
            rate_hz: Some(100.0),
            samples: values.iter().map(sample).collect(),
            ..Motion::default()
        }
    }

    fn wave(hz: f64) -> Vec<Option<f64>> {
        (0..1000).map(|it| Some((f64::from(it) / 100.0 * hz * std::f64::consts::TAU).sin())).collect()
    }

    /// Amplitude and lag [samples] of what is left of a wave.
    fn left_of(hz: f64, cutoff_hz: f64) -> (f64, f64) {
        let mut motion = of(&wave(hz));
        assert_eq!(smooth(&mut motion, cutoff_hz).unwrap(), Smoothed { n_samples: 1000, n_too_short: 0 });
        let (mut sine, mut cosine) = (0.0, 0.0);
        for (frame, sample) in motion.samples.iter().enumerate().skip(200).take(600) {
            let phase = frame as f64 / 100.0 * hz * std::f64::consts::TAU;
            let x = sample.as_ref().unwrap().position.x;
            (sine, cosine) = (sine + x * phase.sin() / 300.0, cosine + x * phase.cos() / 300.0);
        }
        (sine.hypot(cosine), cosine.atan2(sine) / (hz * std::f64::consts::TAU) * 100.0)
    }

    #[test]
    fn the_cut_off_lets_through_its_share_without_a_lag() {
        let (at_cutoff, lag) = left_of(6.0, 6.0);
        assert!((at_cutoff - std::f64::consts::FRAC_1_SQRT_2).abs() < 2e-3, "{at_cutoff}");
        assert!(lag.abs() < 1e-6, "{lag} samples");
        assert!((left_of(1.0, 6.0).0 - 1.0).abs() < 1e-3 && left_of(24.0, 6.0).0 < 0.006);
    }

    #[test]
    fn lines_stay_lines_up_to_their_ends() {
        let line: Vec<Option<f64>> = (0..50).map(|it| Some(f64::from(it) * 0.01 - 3.0)).collect();
        let mut motion = of(&line);
        smooth(&mut motion, 5.0).unwrap();
        for (sample, wanted) in motion.samples.iter().zip(line) {
            assert!((sample.as_ref().unwrap().position.x - wanted.unwrap()).abs() < 1e-6);
        }
    }

    /// `scipy.signal.filtfilt(*butter(2, f), x, padlen=30)` of x = [0, 1, 0, −1, 2, …], f such that two passes have 10 Hz at 100 Hz.
    #[test]
    fn it_is_the_filter_of_scipy() {
        let Some(python) = std::env::var_os("FOVEATE_PEER_PYTHON") else {
            return println!("skipped: it_is_the_filter_of_scipy needs FOVEATE_PEER_PYTHON, a python with scipy");
        };
        let script = "import numpy, scipy.signal as s\nx=numpy.array([((i*7)%13)-(i%5) for i in range(60)],float)\n\
             w=numpy.tan(numpy.pi*10/100)/(2**.5-1)**.25\nb,a=s.butter(2,2*numpy.arctan(w)/numpy.pi)\n\
             print(*s.filtfilt(b,a,x,padlen=30))";
        let output = std::process::Command::new(python).args(["-c", script]).output().unwrap();
        if !output.status.success() {
            return println!("skipped: it_is_the_filter_of_scipy finds no scipy");
        }
        let said = String::from_utf8(output.stdout).unwrap();
        let theirs: Vec<f64> = said.split_whitespace().map(|it| it.parse().unwrap()).collect();
        let mut motion = of(&(0..60).map(|it| Some(f64::from(it * 7 % 13 - it % 5))).collect::<Vec<_>>());
        smooth(&mut motion, 10.0).unwrap();
        for (ours, theirs) in motion.samples.iter().zip(theirs) {
            assert!((ours.as_ref().unwrap().position.x - theirs).abs() < 1e-9, "{ours:?} {theirs}");
        }
    }

    #[test]
    fn holes_part_runs_and_short_ones_stay() {
        let mut values = wave(24.0);
        values[100] = None;
        values[106] = None;
        let mut motion = of(&values);
        let before = motion.clone();
        assert_eq!(smooth(&mut motion, 6.0).unwrap(), Smoothed { n_samples: 100 + 893, n_too_short: 5 });
        assert_eq!(motion.samples[100..107], before.samples[100..107]);
        assert_ne!(motion.samples[99], before.samples[99]);
    }

    #[test]
    fn cut_offs_that_cannot_be_are_refused() {
        for cutoff_hz in [0.0, -1.0, 50.0, f64::NAN, f64::INFINITY] {
            assert!(smooth(&mut of(&wave(1.0)), cutoff_hz).unwrap_err().contains("less than 50"), "{cutoff_hz}");
        }
        let mut irregular = Motion { rate_hz: None, ..of(&wave(1.0)) };
        assert!(smooth(&mut irregular, 5.0).unwrap_err().contains("irregular"));
    }
}
