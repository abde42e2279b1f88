//! BVH files as motions: each joint is a point, and each end of a limb, as `JOINT-end`.

use nalgebra::Point3;

use super::{Keeps, MotionError, ReadOptions, Written, lost};
use crate::bvh::SkeletonMotion;
use crate::motion::{Motion, Sample, Skeleton, Up};

/// What most animation programs take a unit for [m].
const USUAL_UNIT_M: f64 = 0.01;

pub(super) fn read(text: &str, options: &ReadOptions) -> Result<(Motion, Vec<String>), MotionError> {
    let file = SkeletonMotion::from_bvh(text).map_err(|it| MotionError(it.to_string()))?;
    let mut remarks = Vec::new();
    let unit_m = options.metres_per_unit.unwrap_or(USUAL_UNIT_M);
    if options.metres_per_unit.is_none() {
        remarks.push("BVH has no unit; taken: centimetres (another: --metres-per-unit)".to_owned());
    }
    let mut labels = Vec::new();
    for joint in &file.joints {
        labels.push(joint.name.clone());
        labels.extend(joint.end.map(|_| format!("{}-end", joint.name)));
    }
    let mut samples = Vec::with_capacity(file.n_frames() * labels.len());
    for poses in (0..file.n_frames()).map_while(|it| file.poses(it, unit_m)) {
        for (pose, joint) in poses.iter().zip(&file.joints) {
            samples.push(Some(Sample::at(Point3::from(pose.translation.vector))));
            samples.extend(joint.end.map(|end| Some(Sample::at(pose * Point3::from(end * unit_m)))));
        }
    }
    // Frame times are written with few digits: 0.0083333 is 120 Hz.
    let rate = 1.0 / file.frame_s;
    let whole = rate.round();
    let rate_hz = if whole > 0.0 && (rate / whole - 1.0).abs() < 1e-4 { whole } else { rate };
    let motion = Motion {
        labels,
        times_s: (0..file.n_frames()).map(|it| it as f64 / rate_hz).collect(),
        rate_hz: Some(rate_hz),
        samples,
        up: Up::Y,
        unit: Some(("m".to_owned(), 1.0)).filter(|_| unit_m == 1.0),
        skeleton: Some(Skeleton { motion: file, unit_m }),
        lacks_start: true,
        ..Motion::default()
    };
    Ok((motion, remarks))
}

pub(super) fn write(motion: &Motion) -> Result<Written, MotionError> {
    let Some(skeleton) = &motion.skeleton else {
        return Err(MotionError("found points without a skeleton, expected joints with bones between them".to_owned()));
    };
    let lost = lost(&Motion { skeleton: None, ..motion.clone() }, Keeps::default());
    Ok(Written { bytes: skeleton.motion.to_bvh().into_bytes(), lost, notes: Vec::new() })
}
