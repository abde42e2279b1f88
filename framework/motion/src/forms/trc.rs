//! TRC files as motions.
//!
//! TRC does not say which axis is up. OpenSim and our own reader assume y: points are rotated when written, here as in
//! `export.trc`, unless another axis is requested.

use foveate_messages::Provenance;
use nalgebra::Point3;

use super::units::{unit, unit_to_write};
use super::{Keeps, MotionError, ReadOptions, WriteOptions, Written, lost};
use crate::motion::{Motion, Sample, Up, rate_of};
use crate::trc::{self, Recording};

pub(super) fn read(text: &str, options: &ReadOptions) -> Result<(Motion, Vec<String>), MotionError> {
    let (file, mut remarks) = trc::read_with_remarks(text).map_err(|it| MotionError(it.to_string()))?;
    let largest = file.positions.iter().flatten().flatten().fold(0.0_f64, |most, it| most.max(it.abs()));
    let (name, metres) = unit(&file.units, options.metres_per_unit, largest, &mut remarks);
    let rate = file.rate_hz;
    let on_clock = |times: &[f64]| {
        let step_off = |(frame, time): (usize, &f64)| (time - times[0] - frame as f64 / rate).abs() * rate;
        times.iter().enumerate().map(step_off).fold(0.0, f64::max)
    };
    // Some makers round times to hundredths: the stated rate counts where no time is far from it.
    let (times_s, rate_hz) = match rate_of(&file.times_s) {
        _ if file.times_s.is_empty() => (Vec::new(), Some(rate)),
        _ if on_clock(&file.times_s) < 0.6 => {
            let start = (file.times_s[0] * rate).round() / rate;
            let start = if (start - file.times_s[0]).abs() * rate < 0.02 { start } else { file.times_s[0] };
            ((0..file.times_s.len()).map(|it| start + it as f64 / rate).collect(), Some(rate))
        }
        found => {
            let words = found.map_or("are not regular".to_owned(), |it| format!("are of {it:.3} Hz"));
            remarks.push(format!("the header says {rate} frames a second, and the times {words}; taken: the times"));
            (file.times_s, found)
        }
    };
    if times_s.windows(2).any(|it| it[1] <= it[0]) {
        let place = times_s.windows(2).position(|it| it[1] <= it[0]).unwrap_or(0);
        return Err(MotionError(format!(
            "frame {}: found the time {} behind {}, expected a later one",
            place + 2,
            times_s[place + 1],
            times_s[place]
        )));
    }
    let sample = |it: &[f64; 3]| Sample::at(Point3::from(it.map(|it| it * metres)));
    let motion = Motion {
        labels: file.labels,
        times_s,
        rate_hz,
        samples: file.positions.iter().map(|it| it.as_ref().map(sample)).collect(),
        up: Up::Y,
        unit: Some((name, metres)),
        ..Motion::default()
    };
    Ok((motion, remarks))
}

pub(super) fn write(motion: &Motion, name: &str, options: &WriteOptions<'_>) -> Result<Written, MotionError> {
    let (unit, metres) = unit_to_write(motion, options.unit);
    let up = options.up.unwrap_or(Up::Y);
    let Some(rate_hz) = motion.rate_hz.or((motion.n_frames() == 1).then_some(1.0)) else {
        return Err(MotionError("the times are not regular, and TRC has one rate".to_owned()));
    };
    let place = |it: &Option<Sample>| {
        let it = it.as_ref().filter(|it| it.provenance != Provenance::Predicted)?;
        Some(up.of_z_up(motion.up.to_z_up(it.position.into())).map(|it| it / metres))
    };
    let recording = Recording {
        rate_hz,
        units: unit,
        labels: motion.labels.clone(),
        times_s: motion.times_s.clone(),
        positions: motion.samples.iter().map(place).collect(),
    };
    let mut lost = lost(motion, Keeps { start: true, ..Keeps::default() });
    let notes = (up != motion.up).then(|| format!("turned: {} is up in the table", up.name())).into_iter().collect();
    if up == Up::Z {
        lost.push("that z is up: TRC does not say it, and its readers take y (--from-up z)".to_owned());
    }
    // Five decimals.
    if metres > 0.011 {
        lost.push(format!("positions are rounded to {} mm; --unit mm keeps more", metres * 1e-2));
    }
    Ok(Written { bytes: trc::write(&recording, name).into_bytes(), lost, notes })
}
