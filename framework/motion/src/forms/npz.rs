//! NumPy archives as motions, in the layout of `export.npy`.

use foveate_messages::{CameraId, CameraSet, Provenance};
use nalgebra::Point3;

use super::{Keeps, MotionError, Written, lost};
use crate::motion::{Motion, Sample, Up, rate_of};
use crate::npz::{Archive, Arrays};

/// Row and column of a covariance's upper triangle.
const TRIANGLE: [(usize, usize); 6] = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)];

/// As many frames C3D can count.
const MOST_FRAMES: usize = 1 << 24;

pub(super) fn read(bytes: &[u8]) -> Result<(Motion, Vec<String>), MotionError> {
    let file = Arrays::read(bytes).map_err(MotionError)?;
    let wrong = |it: String| MotionError(it);
    let positions = file.numbers("positions_m").map_err(wrong)?;
    let [n_frames, n_points, 3] = positions.shape[..] else {
        return Err(MotionError(format!(
            "`positions_m`: found the shape {:?}, expected frames × points × 3",
            positions.shape
        )));
    };
    // Where one is 0 no number stands behind the other.
    if n_frames.max(n_points) > MOST_FRAMES {
        return Err(MotionError(format!(
            "`positions_m`: found {n_frames} frames of {n_points} points, expected at most {MOST_FRAMES} of either"
        )));
    }
    let of_shape = |name: &str, shape: &[usize]| -> Result<Option<Vec<f64>>, MotionError> {
        if !file.has(name) {
            return Ok(None);
        }
        let array = file.numbers(name).map_err(wrong)?;
        match array.shape == shape {
            true => Ok(Some(array.values)),
            false => Err(MotionError(format!("`{name}`: found the shape {:?}, expected {shape:?}", array.shape))),
        }
    };
    let texts = |name: &str| if file.has(name) { file.texts(name).map_err(wrong) } else { Ok(Vec::new()) };
    let mut remarks = Vec::new();
    let mut labels = texts("labels")?;
    if labels.len() != n_points {
        remarks.push(format!("`labels` names {} of {n_points} points", labels.len()));
        labels.resize(n_points, String::new());
    }
    let rate = of_shape("rate_hz", &[])?.and_then(|it| it.first().copied()).filter(|it| it.is_finite() && *it > 0.0);
    let times_s = match (of_shape("times_s", &[n_frames])?, rate) {
        (Some(times), _) => times,
        (None, Some(rate)) => (0..n_frames).map(|it| it as f64 / rate).collect(),
        (None, None) => {
            return Err(MotionError("found neither `times_s` nor `rate_hz`, expected one of them".to_owned()));
        }
    };
    if times_s.iter().any(|it| !it.is_finite()) || times_s.windows(2).any(|it| it[1] <= it[0]) {
        return Err(MotionError("`times_s`: found times out of order, expected ascending ones".to_owned()));
    }
    let covariances = of_shape("covariances_m2", &[n_frames, n_points, 3, 3])?;
    let provenance_names = texts("provenance_names")?;
    let provenance = of_shape("provenance", &[n_frames, n_points])?;
    let cameras = texts("camera_names")?;
    let n_bytes = cameras.len().div_ceil(8);
    let seen = of_shape("cameras", &[n_frames, n_points, n_bytes])?;
    let sample = |place: usize| {
        let position = &positions.values[place * 3..place * 3 + 3];
        if !position.iter().all(|it| it.is_finite()) {
            return None;
        }
        let provenance =
            match provenance.as_ref().and_then(|it| provenance_names.get(it[place] as usize)).map(String::as_str) {
                Some("missing") => return None,
                Some("filled") => Provenance::Filled,
                Some("predicted") => Provenance::Predicted,
                _ => Provenance::Measured,
            };
        let mut sample = Sample { provenance, ..Sample::at(Point3::new(position[0], position[1], position[2])) };
        if let Some(all) = &covariances {
            sample.covariance = TRIANGLE.map(|(row, column)| all[place * 9 + row * 3 + column] as f32);
        }
        if let Some(bits) = &seen {
            let is_set = |camera: &usize| bits[place * n_bytes + camera / 8] as u8 >> (camera % 8) & 1 == 1;
            sample.cameras = (0..cameras.len()).filter(is_set).map(|it| CameraId(it as u16)).collect::<CameraSet>();
        }
        Some(sample)
    };
    let samples: Vec<Option<Sample>> = (0..n_frames * n_points).map(sample).collect();
    let besides = file.has("marks_own_m").then(|| "the marks in their own space".to_owned());
    let motion = Motion {
        labels,
        rate_hz: rate.or_else(|| rate_of(&times_s)),
        times_s,
        samples,
        up: Up::Z,
        cameras,
        besides: besides.into_iter().collect(),
        ..Motion::default()
    };
    Ok((motion, remarks))
}

pub(super) fn write(motion: &Motion) -> Result<Written, MotionError> {
    let mut turned = motion.clone();
    let notes = turned.turn(Up::Z).then(|| "turned: z is up in such archives".to_owned()).into_iter().collect();
    let (n, p) = (motion.n_frames(), motion.labels.len());
    let n_bytes = motion.cameras.len().div_ceil(8);
    let mut positions = Vec::with_capacity(n * p * 3);
    let mut covariances = Vec::with_capacity(n * p * 9);
    let mut provenance = Vec::with_capacity(n * p);
    let mut bits = vec![0_u8; n * p * n_bytes];
    for (place, sample) in turned.samples.iter().enumerate() {
        let there = sample.as_ref();
        positions.extend(there.map_or([f64::NAN; 3], |it| it.position.into()));
        let mut whole = [f32::NAN; 9];
        if let Some(it) = there {
            for ((row, column), value) in TRIANGLE.into_iter().zip(it.covariance) {
                (whole[row * 3 + column], whole[column * 3 + row]) = (value, value);
            }
            for camera in it.cameras.iter().map(|it| usize::from(it.0)).filter(|it| *it < motion.cameras.len()) {
                bits[place * n_bytes + camera / 8] |= 1 << (camera % 8);
            }
        }
        covariances.extend(whole);
        provenance.push(match there.map(|it| it.provenance) {
            None => 0,
            Some(Provenance::Measured) => 1,
            Some(Provenance::Filled) => 2,
            Some(Provenance::Predicted) => 3,
        });
    }

    let mut to = Archive::default();
    let mut add = || {
        if let Some(rate_hz) = turned.rate_hz {
            to.floats("rate_hz", &[], &[rate_hz])?;
        }
        to.floats("times_s", &[n], &turned.times_s)?;
        to.texts("labels", &turned.labels.iter().map(String::as_str).collect::<Vec<_>>())?;
        to.floats("positions_m", &[n, p, 3], &positions)?;
        to.short_floats("covariances_m2", &[n, p, 3, 3], &covariances)?;
        to.texts(
            "provenance_names",
            &["missing", Provenance::Measured.name(), Provenance::Filled.name(), Provenance::Predicted.name()],
        )?;
        to.bytes("provenance", &[n, p], &provenance)?;
        to.texts("camera_names", &turned.cameras.iter().map(String::as_str).collect::<Vec<_>>())?;
        to.bytes("cameras", &[n, p, n_bytes], &bits)
    };
    if add().is_err() {
        return Err(MotionError(format!(
            "{n} frames of {p} points take more than the 4 GiB that such a file can have"
        )));
    }
    let keeps =
        Keeps { uncertainty: true, provenance: true, predicted: true, cameras: true, events: false, start: true };
    Ok(Written { bytes: to.finish(), lost: lost(motion, keeps), notes })
}
