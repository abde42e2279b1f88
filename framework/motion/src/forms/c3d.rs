//! C3D files as motions.
//!
//! A residual above 0 is the standard deviation of a measured sample; 0 marks a sample from a model or a filter. Where
//! every residual is 0, samples count as measured: many programs write no residuals.

use foveate_messages::{CameraId, CameraSet, Provenance};
use nalgebra::Point3;

use super::units::{unit, unit_to_write};
use super::{Keeps, MotionError, ReadOptions, Written, lost};
use crate::c3d::{self, Analog, ByteOrder, Coding, Recording};
use crate::motion::{Event, Motion, Sample, Up};

/// Bits of the mask.
const BITS: usize = 7;
/// Least step of residuals [m].
const FINEST_STEP: f64 = 0.02e-3;

pub(super) fn read(bytes: &[u8], options: &ReadOptions) -> Result<(Motion, Vec<String>), MotionError> {
    let (file, mut remarks) = c3d::read_with_remarks(bytes).map_err(|it| MotionError(it.to_string()))?;
    let n_points = file.labels.len();
    let mut is_place = vec![true; n_points];
    file.model_outputs.iter().flat_map(|it| &it.points).for_each(|it| is_place[*it] = false);
    let of_places = || file.samples.iter().zip(is_place.iter().cycle()).filter(|it| *it.1).map(|it| it.0);
    let there = || of_places().filter(|it| it.is_present());
    let largest = there().flat_map(|it| it.position).fold(0.0_f32, |most, it| most.max(it.abs()));
    let (name, metres) = unit(&file.units, options.metres_per_unit, f64::from(largest), &mut remarks);
    // What is written shortest was meant: 59.94, and not the float next to it.
    let rate_hz = file.rate_hz.to_string().parse().unwrap_or(f64::from(file.rate_hz));
    if !(rate_hz.is_finite() && rate_hz > 0.0) && file.n_frames() > 0 {
        return Err(MotionError(format!(
            "found a rate of {rate_hz} in header and POINT:RATE, expected frames a second"
        )));
    }
    let has_residuals = file.start_s.is_some() || there().any(|it| it.residual > 0.0);
    if !has_residuals && there().next().is_some() {
        remarks.push("all residuals are 0: taken as missing, and all samples as measured".to_owned());
    }
    let sample = |it: &c3d::Sample| {
        let place = Point3::from(it.position.map(|it| f64::from(it) * metres));
        let cameras: CameraSet = (0..BITS as u16).filter(|bit| it.cameras >> bit & 1 == 1).map(CameraId).collect();
        let sample = Sample { cameras, ..Sample::at(place) };
        match it.residual > 0.0 {
            true => sample.with_sigma(f64::from(it.residual) * metres),
            false if has_residuals => Sample { provenance: Provenance::Filled, ..sample },
            false => sample,
        }
    };
    let n_frames = file.n_frames();
    let first = f64::from(file.first_frame.max(1) - 1) / rate_hz;
    let start_s = file.start_s.filter(|it| it.is_finite()).unwrap_or(first);
    // Ours count from the first frame, others on the clock of the frames' numbers.
    let events_from = if file.start_s.is_some() { start_s } else { 0.0 };
    let event = |it: &c3d::Event| Event {
        label: it.label.clone(),
        context: it.context.clone(),
        time_s: it.time_s + events_from,
    };
    let is_seen = there().any(|it| it.cameras != 0);
    let bit_names = (0..BITS).map(|it| file.cameras.get(it).cloned().unwrap_or_else(|| format!("camera-{}", it + 1)));
    let n_channels = file.analog.labels.len();
    let mut besides: Vec<String> =
        (n_channels > 0).then(|| format!("{n_channels} analog channels")).into_iter().collect();
    let kinds: Vec<String> = file.model_outputs.iter().map(|it| format!("{} {}", it.points.len(), it.kind)).collect();
    let n_outputs = is_place.iter().filter(|it| !**it).count();
    if n_outputs > 0 {
        let what = format!("{n_outputs} outputs of a model that are no places ({})", kinds.join(", "));
        remarks.push(format!("{what}: left out"));
        besides.push(what);
    }
    let motion = Motion {
        times_s: (0..n_frames).map(|it| start_s + it as f64 / rate_hz).collect(),
        rate_hz: Some(rate_hz),
        samples: of_places().map(|it| it.is_present().then(|| sample(it))).collect(),
        up: if file.y_is_up { Up::Y } else { Up::Z },
        events: file.events.iter().map(event).collect(),
        cameras: if is_seen || !file.cameras.is_empty() { bit_names.collect() } else { Vec::new() },
        unit: Some((name, metres)),
        besides,
        labels: file.labels.iter().zip(&is_place).filter(|it| *it.1).map(|it| it.0.clone()).collect(),
        ..Motion::default()
    };
    Ok((motion, remarks))
}

/// The bit of a camera among `n_cameras`: one each, or shared evenly by neighbours.
fn bit(camera: CameraId, n_cameras: usize) -> usize {
    let camera = usize::from(camera.0);
    (if n_cameras > BITS { camera * BITS / n_cameras } else { camera }).min(BITS - 1)
}

/// The camera of each bit.
fn bits(cameras: &[String]) -> Vec<String> {
    let mut bits = vec![String::new(); cameras.len().min(BITS)];
    for (number, name) in (0..).zip(cameras) {
        let text = &mut bits[bit(CameraId(number), cameras.len())];
        if text.len() + name.len() < 110 {
            text.push_str(if text.is_empty() { "" } else { "+" });
            text.push_str(name);
        } else if !text.ends_with('…') {
            text.push('…');
        }
    }
    bits
}

pub(super) fn write(motion: &Motion, asked: Option<&str>) -> Result<Written, MotionError> {
    let (name, metres) = unit_to_write(motion, asked);
    let Some(rate_hz) = motion.rate_hz.or((motion.n_frames() == 1).then_some(1.0)) else {
        return Err(MotionError("the times are not regular, and C3D has one rate".to_owned()));
    };
    let sample = |it: &Option<Sample>| {
        let Some(it) = it.as_ref().filter(|it| it.provenance != Provenance::Predicted) else {
            return c3d::Sample::MISSING;
        };
        c3d::Sample {
            position: [0, 1, 2].map(|axis| (it.position[axis] / metres) as f32),
            // Not 0 where it is not known: that would say that it was not measured.
            residual: match it.provenance {
                Provenance::Filled | Provenance::Predicted => 0.0,
                Provenance::Measured => {
                    it.sigma().map_or(f32::MIN_POSITIVE, |it| (it / metres) as f32).max(f32::MIN_POSITIVE)
                }
            },
            cameras: it.cameras.iter().fold(0, |mask, camera| mask | 1 << bit(camera, motion.cameras.len())),
        }
    };
    // On the clock of the frames' numbers, where the first frame has one; else the file says when it is.
    let start_s = motion.start_s();
    let first = start_s * rate_hz;
    let is_numbered = (first - first.round()).abs() < 1e-3 && (0.0..16e6).contains(&first);
    let events_from = if is_numbered { 0.0 } else { start_s };
    let event = |it: &Event| c3d::Event {
        label: it.label.clone(),
        context: it.context.clone(),
        time_s: it.time_s - events_from,
    };
    let recording = Recording {
        rate_hz: rate_hz as f32,
        units: name,
        first_frame: if is_numbered { first.round() as u32 + 1 } else { 1 },
        labels: motion.labels.clone(),
        samples: motion.samples.iter().map(sample).collect(),
        events: motion.events.iter().map(event).collect(),
        analog: Analog::default(),
        start_s: (!is_numbered).then_some(start_s),
        cameras: bits(&motion.cameras),
        y_is_up: motion.up == Up::Y,
        model_outputs: Vec::new(),
    };
    let largest = motion.samples.iter().flatten().filter_map(Sample::sigma).fold(0.0, f64::max);
    let step = FINEST_STEP.max(largest / 255.0) / metres;
    let coding = Coding::Float { residual_step: step as f32 };
    let bytes = c3d::write(&recording, coding, ByteOrder::Intel).map_err(|it| MotionError(it.to_string()))?;
    let is_uneven = |it: &Sample| {
        let [xx, xy, xz, yy, yz, zz] = it.covariance;
        xx != yy || xx != zz || [xy, xz, yz] != [0.0; 3]
    };
    let cameras = motion.cameras.len() <= BITS;
    let keeps = Keeps { uncertainty: true, provenance: true, cameras, events: true, predicted: false, start: true };
    let mut lost = lost(motion, keeps);
    let n_uneven = motion.samples.iter().flatten().filter(|it| it.sigma().is_some() && is_uneven(it)).count();
    if n_uneven > 0 {
        lost.push(format!("{n_uneven} covariances: a residual holds only their mean over the axes"));
    }
    Ok(Written { bytes, lost, notes: Vec::new() })
}
