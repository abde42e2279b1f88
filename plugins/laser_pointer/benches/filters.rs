//! Jitter filters at rest and in motion, as Casiez et al. plot them (CHI 2012): the mean distance of what a filter gives from where the person means to point, by
//! speed; and the same for the prediction to display time.
//!
//! `cargo bench -p foveate-laser-pointer --bench filters -- [--tune] [FOLDER]`: prints a table, and draws `pointer_filters.svg` into FOLDER; with `--tune`, the best
//! of a grid of settings on seeds 1 to 3.
//!
//! People: moves of least jerk (T. Flash, N. Hogan, J. Neurosci. 5(7), 1985) between rests. Their tremor: amplitude falls with frequency as 1/f from 0.4 to 9 Hz
//! (G. Sutton, K. Sykes, J. Physiol. 190(2), 1967, who see a peak at 9 Hz besides); the bands from 7.5 to 12.5 Hz and from 16.5 to 30 Hz have 24 % and 10 % of the
//! whole amplitude (B. Carignan et al., Exp. Brain Res. 202(2), 2010). Its size on the wall is an assumption: 3 mm rms on each axis, 1 mrad from 3 m. Pictures at
//! 120 Hz show the spot to 0.5 mm on each axis; a tracker of nearly constant velocity is between these and the filters.

use std::f64::consts::TAU;
use std::path::PathBuf;

use foveate::estimation::statistics::median;
use foveate::estimation::{ConstantVelocity, Random};
use foveate::plot::{Axis, COLOURS, Chart, Figure, Series};
use foveate::prelude::*;
use foveate_laser_pointer::smoothing::{JitterFilter, Smoother, SmoothingSettings};
use nalgebra::{Matrix3, Point2, Point3, Vector2, Vector3};

const RATE_HZ: f64 = 120.0;
const DURATION_S: f64 = 60.0;
const TREMOR_M: f64 = 3e-3;
const SPOT_M: f64 = 0.5e-3;
/// Prediction span, from capture to display.
const AHEAD_S: f64 = 0.05;
/// Of the tracker: hands on a wall accelerate by metres per second in a tenth of a second [m²/s³].
const TRACKER_DENSITY: f64 = 30.0;
/// Borders of the speed classes [m/s]; below the first: at rest.
const SPEEDS: [f64; 7] = [0.0, 0.01, 0.1, 0.3, 1.0, 2.0, 5.0];
const N_SPEEDS: usize = SPEEDS.len() - 1;
const TUNING: [u64; 3] = [1, 2, 3];
const JUDGING: std::ops::RangeInclusive<u64> = 101..=120;

/// What a person means and what the camera sees.
struct Hand {
    meant: Vec<Point2<f64>>,
    speed: Vec<f64>,
    targets: Vec<Target>,
}

fn hand(seed: u64) -> Hand {
    let mut random = Random::new(seed).fork("hand");
    let n = (RATE_HZ * DURATION_S) as usize;
    let (mut meant, mut speed) = (Vec::new(), Vec::new());
    let mut at = Point2::new(random.uniform_in(0.5, 3.5), random.uniform_in(0.3, 1.7));
    while meant.len() < n {
        let rest = (random.uniform_in(0.5, 1.5) * RATE_HZ) as usize;
        meant.extend(std::iter::repeat_n(at, rest));
        speed.extend(std::iter::repeat_n(0.0, rest));
        let to = Point2::new(random.uniform_in(0.5, 3.5), random.uniform_in(0.3, 1.7));
        let lasts = random.uniform_in(0.5, 2.0);
        for step in 1..=(lasts * RATE_HZ) as usize {
            let s = step as f64 / (lasts * RATE_HZ).floor();
            let part = s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s);
            meant.push(at + (to - at) * part);
            speed.push((to - at).norm() * 30.0 * s * s * (1.0 - s) * (1.0 - s) / lasts);
        }
        at = to;
    }
    meant.truncate(n);
    speed.truncate(n);
    let tremor = [tremor(&mut random, n), tremor(&mut random, n)];
    let mut tracker: Option<ConstantVelocity> = None;
    let mut targets = Vec::new();
    for (step, it) in meant.iter().enumerate() {
        let noise = Vector2::new(random.normal(), random.normal()) * SPOT_M;
        let seen = it + Vector2::new(tremor[0][step], tremor[1][step]) + noise;
        let seen = Point3::new(seen.x, seen.y, 0.0);
        let covariance = Matrix3::from_diagonal_element(SPOT_M * SPOT_M);
        let filter = tracker.get_or_insert_with(|| ConstantVelocity::new(seen, covariance, 1.0));
        if step > 0 {
            filter.predict(1.0 / RATE_HZ, TRACKER_DENSITY);
            filter.update_position(&seen, &covariance);
        }
        targets.push(Target {
            id: TargetId(1),
            position: filter.position,
            velocity: Vector3::new(filter.velocity.x, filter.velocity.y, 0.0),
            covariance: filter.covariance,
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        });
    }
    Hand { meant, speed, targets }
}

/// Waves of many frequencies with random phases, with the spectrum that the head of this file states [m].
fn tremor(random: &mut Random, n: usize) -> Vec<f64> {
    let bands: [(f64, f64, f64, bool); 3] = [
        (0.4, 9.0, (1.0 - 0.24_f64.powi(2) - 0.1_f64.powi(2)).sqrt(), true),
        (7.5, 12.5, 0.24, false),
        (16.5, 30.0, 0.1, false),
    ];
    let mut sum = vec![0.0; n];
    for (low, high, share, is_falling) in bands {
        let frequencies: Vec<f64> = (0..60).map(|it| low + (high - low) * f64::from(it) / 59.0).collect();
        let amplitudes: Vec<f64> = frequencies.iter().map(|it| if is_falling { 1.0 / it } else { 1.0 }).collect();
        let rms = (amplitudes.iter().map(|it| it * it / 2.0).sum::<f64>()).sqrt();
        for (frequency, amplitude) in frequencies.iter().zip(&amplitudes) {
            let phase = random.uniform_in(0.0, TAU);
            let size = TREMOR_M * share * amplitude / rms;
            for (step, it) in sum.iter_mut().enumerate() {
                *it += size * (TAU * frequency * step as f64 / RATE_HZ + phase).sin();
            }
        }
    }
    sum
}

/// Errors of one filter with one hand.
#[derive(Debug, Clone, Default)]
struct Errors {
    /// Mean distance from where the person means to point, by speed [mm].
    by_speed: [f64; N_SPEEDS],
    /// The same for predictions [`AHEAD_S`] ahead, against the intended place then [mm].
    ahead: [f64; N_SPEEDS],
    /// Mean way from picture to picture at rest [mm].
    jitter: f64,
    /// By how much time the path lags, where it fits what is meant best, above 1 m/s [ms].
    lag: f64,
}

fn judge(settings: &SmoothingSettings, hand: &Hand, is_ahead: bool) -> Errors {
    let mut smoother = Smoother::new(settings, &hand.targets[0]);
    let ahead_steps = (AHEAD_S * RATE_HZ).round() as usize;
    let mut sums = [[0.0; 3]; N_SPEEDS];
    let (mut path, mut jitter) = (vec![smoother.position()], [0.0, 0.0]);
    for step in 1..hand.targets.len() {
        let before = smoother.position();
        smoother.update(&hand.targets[step], 1.0 / RATE_HZ);
        path.push(smoother.position());
        let speed = hand.speed[step];
        let place = SPEEDS[1..].iter().position(|it| speed < *it).unwrap_or(N_SPEEDS - 1);
        if step > (2.0 * RATE_HZ) as usize && step + ahead_steps < hand.meant.len() {
            let predicted = if is_ahead { smoother.predicted(Interval::from_s(AHEAD_S)) } else { smoother.position() };
            sums[place][0] += (smoother.position() - hand.meant[step]).norm();
            sums[place][1] += (predicted - hand.meant[step + ahead_steps]).norm();
            sums[place][2] += 1.0;
            // At rest for half a second.
            if hand.speed[step - (0.5 * RATE_HZ) as usize..=step].iter().all(|it| *it == 0.0) {
                jitter = [jitter[0] + (smoother.position() - before).norm(), jitter[1] + 1.0];
            }
        }
    }
    let mean = |which: usize| sums.map(|it| 1e3 * it[which] / it[2]);
    Errors { by_speed: mean(0), ahead: mean(1), jitter: 1e3 * jitter[0] / jitter[1], lag: lag(&path, hand) }
}

/// Shifts that are tried begin so many pictures before none.
const EARLIEST: usize = 5;

/// The shift in time at which the path is nearest to what was meant, above 1 m/s; to a tenth of a picture by a parabola [ms].
fn lag(path: &[Point2<f64>], hand: &Hand) -> f64 {
    let meant = |it: usize, shift: usize| {
        (it + EARLIEST).checked_sub(shift).filter(|it| hand.speed.get(*it).is_some_and(|it| *it > 1.0))
    };
    let cost = |shift: usize| -> f64 {
        let fast = (0..path.len()).filter_map(|it| Some((it, meant(it, shift)?)));
        let (sum, n) = fast
            .fold((0.0, 0.0), |(sum, n), (it, meant)| (sum + (path[it] - hand.meant[meant]).norm_squared(), n + 1.0));
        sum / n
    };
    let costs: Vec<f64> = (0..40).map(cost).collect();
    let best = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).unwrap_or(0);
    let mut shift = best as f64;
    if best > 0 && best + 1 < costs.len() {
        let [a, b, c] = [costs[best - 1], costs[best], costs[best + 1]];
        shift += 0.5 * (a - c) / (a - 2.0 * b + c);
    }
    1e3 * (shift - EARLIEST as f64) / RATE_HZ
}

fn settings(filter: JitterFilter) -> SmoothingSettings {
    SmoothingSettings { filter, ..SmoothingSettings::default() }
}

/// What the grid is judged by: rest and motion count alike, each speed as a share of what it is without a filter, predictions included.
fn cost(settings: &SmoothingSettings, hands: &[Hand]) -> f64 {
    let mut sum = 0.0;
    for hand in hands {
        let raw = judge(&SmoothingSettings { filter: JitterFilter::None, ..settings.clone() }, hand, true);
        let own = judge(settings, hand, true);
        sum += own.jitter / raw.jitter;
        sum += own.by_speed.iter().zip(&raw.by_speed).map(|(a, b)| a / b).sum::<f64>() / N_SPEEDS as f64;
        sum += own.ahead.iter().zip(&raw.ahead).map(|(a, b)| a / b).sum::<f64>() / N_SPEEDS as f64;
    }
    sum / hands.len() as f64
}

fn tune() {
    let hands: Vec<Hand> = TUNING.map(hand).into();
    let mut tried = Vec::new();
    for min_cutoff_hz in [0.5, 1.0, 2.0, 4.0] {
        for beta in [2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0] {
            for speed_cutoff_hz in [1.0, 2.0, 4.0] {
                let it = SmoothingSettings { min_cutoff_hz, beta, speed_cutoff_hz, ..settings(JitterFilter::OneEuro) };
                tried.push((cost(&it, &hands), it));
            }
        }
    }
    for acceleration_density in [0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0] {
        for noise_mm in [1.0, 2.0, 4.0, 8.0, 16.0] {
            let it = SmoothingSettings { acceleration_density, noise_mm, ..settings(JitterFilter::Kalman) };
            tried.push((cost(&it, &hands), it));
        }
    }
    for filter in [JitterFilter::OneEuro, JitterFilter::Kalman] {
        for still_m_s in [0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4] {
            let it = SmoothingSettings { still_m_s, ..settings(filter) };
            tried.push((cost(&it, &hands), it));
        }
    }
    tried.sort_by(|a, b| a.0.total_cmp(&b.0));
    for filter in [JitterFilter::OneEuro, JitterFilter::Kalman] {
        for (cost, it) in tried.iter().filter(|it| it.1.filter == filter).take(5) {
            println!("{cost:.4}: {it:?}");
        }
    }
    println!("{:.4}: none", cost(&settings(JitterFilter::None), &hands));
}

/// Median and worst over the seeds of judging.
fn over(all: &[Errors], value: impl Fn(&Errors) -> f64) -> [f64; 2] {
    let values: Vec<f64> = all.iter().map(value).collect();
    [median(&values).unwrap_or(f64::NAN), values.iter().copied().fold(f64::MIN, f64::max)]
}

fn main() {
    let arguments: Vec<String> = std::env::args().skip(1).filter(|it| it != "--bench").collect();
    if arguments.iter().any(|it| it == "--tune") {
        tune();
        return;
    }
    let out = arguments.first().map(PathBuf::from);
    let hands: Vec<Hand> = JUDGING.map(hand).collect();
    let filters = [
        ("none", JitterFilter::None, true),
        ("1€", JitterFilter::OneEuro, true),
        ("Kalman", JitterFilter::Kalman, true),
    ];
    let middle = |it: usize| (SPEEDS[it] + SPEEDS[it + 1]) / 2.0;
    let mut now = Chart::new(
        "At its own time",
        [360.0, 260.0],
        Axis::new("speed [m/s]"),
        Axis::new("mean distance [mm]").from_zero(),
    );
    let mut later = Chart::new(
        "50 ms later",
        [360.0, 260.0],
        Axis::new("speed [m/s]"),
        Axis::new("mean distance [mm]").from_zero(),
    );
    println!("seeds {JUDGING:?}: median (worst)");
    println!("filter   jitter at rest [mm/picture]   lag above 1 m/s [ms]   error by speed, at rest to fastest [mm]");
    for (index, (name, filter, _)) in filters.into_iter().enumerate() {
        let all: Vec<Errors> = hands.iter().map(|it| judge(&settings(filter), it, true)).collect();
        let [jitter, lag] = [over(&all, |it| it.jitter), over(&all, |it| it.lag)];
        let by_speed: Vec<String> = (0..N_SPEEDS)
            .map(|speed| over(&all, |it| it.by_speed[speed]))
            .map(|[median, worst]| format!("{median:.1} ({worst:.1})"))
            .collect();
        let ahead: Vec<String> = (0..N_SPEEDS)
            .map(|speed| over(&all, |it| it.ahead[speed]))
            .map(|[median, worst]| format!("{median:.1} ({worst:.1})"))
            .collect();
        println!(
            "{name:8} {:.3} ({:.3})   {:.1} ({:.1})   {}",
            jitter[0],
            jitter[1],
            lag[0],
            lag[1],
            by_speed.join("  ")
        );
        println!("         50 ms later: {}", ahead.join("  "));
        let points = |value: &dyn Fn(&Errors, usize) -> f64| {
            (0..N_SPEEDS).map(|speed| [middle(speed), over(&all, |it| value(it, speed))[0]]).collect()
        };
        now = now.with(Series::line(name, COLOURS[index], points(&|it, speed| it.by_speed[speed])));
        later = later.with(Series::line("", COLOURS[index], points(&|it, speed| it.ahead[speed])));
    }
    let all: Vec<Errors> = hands.iter().map(|it| judge(&settings(JitterFilter::None), it, false)).collect();
    let points = (0..N_SPEEDS).map(|speed| [middle(speed), over(&all, |it| it.ahead[speed])[0]]).collect();
    later = later.with(Series::line("none, no prediction", COLOURS[3], points).dashed());
    if let Some(folder) = out {
        let title = "Distance from where a person means to point".to_owned();
        let svg = Figure { title, n_columns: 2, charts: vec![now, later] }.svg();
        let path = folder.join("pointer_filters.svg");
        match std::fs::create_dir_all(&folder).and_then(|()| std::fs::write(&path, svg)) {
            Ok(()) => println!("plot: {}", path.display()),
            Err(error) => eprintln!("{}: the plot could not be saved ({error})", path.display()),
        }
    }
}
