//! Recovered targets compared with the cameras' features of the same time, in pixels.
//!
//! Targets and features arrive in any order; both are kept until a frame is old enough that no more messages of its time
//! will come. Of several values for one time (an integrator sends one after each camera) the last one is used.

use std::collections::BTreeMap;

use foveate::geometry::Camera;
use foveate::messages::{CameraId, Features, Interval, Provenance, Targets, Time};
use nalgebra::{Point2, Point3};

use super::distribution::Distribution;

/// Options of a comparison.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ComparisonOptions {
    /// Cameras that must agree with a target.
    pub min_cameras: usize,
    /// How close a feature must be to a target's projection to agree [px].
    pub gate: f64,
    /// Time after which a frame is settled.
    pub settle_after: Interval,
}

/// A running comparison.
#[derive(Debug)]
pub struct Comparison {
    options: ComparisonOptions,
    cameras: Vec<Camera>,
    open: BTreeMap<Time, Frame>,
    /// Frames that were settled, to be filled again.
    spare: Vec<Frame>,
    newest: Time,
    /// Everything before this is settled.
    settled: Time,
    pairs: Vec<(f64, usize, usize)>,
    /// Residuals of all cameras, and of each.
    pub all: Distribution,
    /// By camera.
    pub by_camera: Vec<Distribution>,
    /// Capture times with a target that enough cameras agree with.
    pub frames_recovered: u64,
    /// Capture times with any feature at all.
    pub frames_seen: u64,
    /// Features of recovered frames that agree with no recovered target.
    pub outliers_rejected: u64,
    /// Messages that came after their frame had been settled.
    pub late: u64,
}

#[derive(Debug, Default)]
struct Frame {
    /// Of targets that were measured at this time.
    targets: Vec<Point3<f64>>,
    features: Vec<(CameraId, Point2<f64>)>,
    /// By feature: the target it agrees with, and how far it is from its projection [px].
    agreement: Vec<Option<(usize, f64)>>,
}

impl Comparison {
    /// Nothing compared yet; `cameras` are all of the calibration, in its order.
    pub fn new(options: ComparisonOptions, cameras: Vec<Camera>) -> Self {
        Self {
            by_camera: vec![Distribution::default(); cameras.len()],
            options,
            cameras,
            open: BTreeMap::new(),
            spare: Vec::new(),
            newest: Time(i64::MIN),
            settled: Time(i64::MIN),
            pairs: Vec::new(),
            all: Distribution::default(),
            frames_recovered: 0,
            frames_seen: 0,
            outliers_rejected: 0,
            late: 0,
        }
    }

    /// Takes in a camera's features at `time`.
    pub fn add_features(&mut self, time: Time, features: &Features) {
        if let Some(frame) = self.frame(time) {
            frame.features.extend(features.list.iter().map(|it| (features.camera, it.centre)));
        }
    }

    /// Takes in targets; replaces earlier ones of the same time.
    pub fn add_targets(&mut self, targets: &Targets) {
        if let Some(frame) = self.frame(targets.time) {
            frame.targets.clear();
            let measured = targets.list.iter().filter(|it| it.provenance == Provenance::Measured);
            frame.targets.extend(measured.map(|it| it.position));
        }
    }

    /// Settles all frames that are still open.
    pub fn finish(&mut self) {
        while let Some((_, frame)) = self.open.pop_first() {
            self.settle(frame);
        }
    }

    /// The frame of `time`, unless it has been settled; settles those that are old enough.
    fn frame(&mut self, time: Time) -> Option<&mut Frame> {
        self.newest = self.newest.max(time);
        let horizon = self.newest - self.options.settle_after;
        while let Some(first) = self.open.first_entry().filter(|it| *it.key() < horizon) {
            let frame = first.remove();
            self.settle(frame);
        }
        self.settled = self.settled.max(horizon);
        if time < self.settled {
            self.late += 1;
            return None;
        }
        let spare = &mut self.spare;
        Some(self.open.entry(time).or_insert_with(|| spare.pop().unwrap_or_default()))
    }

    /// Compares one frame.
    fn settle(&mut self, mut frame: Frame) {
        self.match_up(&mut frame);
        let mut recovered = false;
        for target in 0..frame.targets.len() {
            let of_target = |it: &&Option<(usize, f64)>| it.is_some_and(|it| it.0 == target);
            if frame.agreement.iter().filter(of_target).count() >= self.options.min_cameras {
                recovered = true;
            } else {
                // Not recovered: what agrees with it by chance proves nothing.
                frame.agreement.iter_mut().filter(|it| of_target(&&**it)).for_each(|it| *it = None);
            }
        }
        self.frames_seen += u64::from(!frame.features.is_empty());
        if recovered {
            self.frames_recovered += 1;
            for ((camera, _), agreement) in frame.features.iter().zip(&frame.agreement) {
                let Some((_, residual)) = agreement else {
                    self.outliers_rejected += 1;
                    continue;
                };
                self.all.add(*residual);
                if let Some(own) = self.by_camera.get_mut(usize::from(camera.0)) {
                    own.add(*residual);
                }
            }
        }
        frame.targets.clear();
        frame.features.clear();
        self.spare.push(frame);
    }

    /// Pairs targets and features within the gate, the closest first; one feature a camera to a target.
    fn match_up(&mut self, frame: &mut Frame) {
        frame.agreement.clear();
        frame.agreement.resize(frame.features.len(), None);
        self.pairs.clear();
        for (target, position) in frame.targets.iter().enumerate() {
            let mut projected: Option<(CameraId, Option<Point2<f64>>)> = None;
            for (feature, (camera, pixel)) in frame.features.iter().enumerate() {
                if projected.is_none_or(|it| it.0 != *camera) {
                    let model = self.cameras.get(usize::from(camera.0));
                    projected = Some((*camera, model.and_then(|it| it.project(position))));
                }
                let Some((_, Some(expected))) = projected else { continue };
                let residual = (pixel - expected).norm();
                if residual <= self.options.gate {
                    self.pairs.push((residual, target, feature));
                }
            }
        }
        self.pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        for &(residual, target, feature) in &self.pairs {
            let camera = frame.features[feature].0;
            let mut others = frame.features.iter().zip(&frame.agreement);
            let has_one = others.any(|(it, own)| it.0 == camera && own.is_some_and(|own| own.0 == target));
            if frame.agreement[feature].is_none() && !has_one {
                frame.agreement[feature] = Some((target, residual));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate::messages::{CameraSet, Feature, Target, TargetId};
    use foveate_testkit::camera_ring;
    use nalgebra::{Matrix2, Matrix6, Vector2, Vector3};

    use super::*;

    const LIGHT: Point3<f64> = Point3::new(0.1, -0.2, 1.1);

    fn comparison() -> Comparison {
        let options = ComparisonOptions { min_cameras: 3, gate: 5.0, settle_after: Interval::from_ms(100.0) };
        Comparison::new(options, camera_ring(4))
    }

    /// What camera number `camera` sees of `points`, off by `error`.
    fn features(camera: usize, points: &[Point3<f64>], error: Vector2<f64>) -> Features {
        let model = &camera_ring(4)[camera];
        let of = |point: &Point3<f64>| Feature {
            centre: model.sees(point).unwrap() + error,
            covariance: Matrix2::identity(),
            area: 4,
            peak: 200,
            label: None,
        };
        Features { camera: CameraId(camera as u16), list: points.iter().map(of).collect() }
    }

    fn targets(time: Time, positions: &[Point3<f64>], provenance: Provenance) -> Targets {
        let of = |(k, position): (usize, &Point3<f64>)| Target {
            id: TargetId(k as u32),
            position: *position,
            velocity: Vector3::zeros(),
            covariance: Matrix6::identity(),
            cameras: CameraSet::default(),
            provenance,
        };
        Targets { time, list: positions.iter().enumerate().map(of).collect() }
    }

    #[test]
    fn residuals_are_pixels_between_projection_and_feature() {
        let mut comparison = comparison();
        for (camera, error) in [(0, 0.3), (1, 0.4), (2, 0.5)] {
            comparison.add_features(Time::ZERO, &features(camera, &[LIGHT], Vector2::new(error, 0.0)));
        }
        comparison.add_targets(&targets(Time::ZERO, &[LIGHT], Provenance::Measured));
        comparison.finish();
        assert_eq!((comparison.frames_recovered, comparison.all.count()), (1, 3));
        assert!((comparison.all.quantile(0.5) - 0.4).abs() < 1e-3);
        assert!((comparison.by_camera[2].max() - 0.5).abs() < 1e-9);
    }

    #[test]
    fn the_last_targets_of_a_time_count_whatever_came_first() {
        let mut comparison = comparison();
        comparison.add_targets(&targets(Time::ZERO, &[LIGHT + Vector3::x()], Provenance::Measured));
        (0..4).for_each(|camera| comparison.add_features(Time::ZERO, &features(camera, &[LIGHT], Vector2::zeros())));
        comparison.add_targets(&targets(Time::ZERO, &[LIGHT], Provenance::Measured));
        comparison.finish();
        assert_eq!((comparison.frames_recovered, comparison.outliers_rejected), (1, 0));
    }

    #[test]
    fn predictions_and_targets_of_two_cameras_are_not_recovered() {
        for (provenance, n_cameras) in [(Provenance::Predicted, 4), (Provenance::Measured, 2)] {
            let mut comparison = comparison();
            (0..n_cameras)
                .for_each(|it| comparison.add_features(Time::ZERO, &features(it, &[LIGHT], Vector2::zeros())));
            comparison.add_targets(&targets(Time::ZERO, &[LIGHT], provenance));
            comparison.finish();
            assert_eq!((comparison.frames_recovered, comparison.frames_seen, comparison.all.count()), (0, 1, 0));
        }
    }

    #[test]
    fn what_agrees_with_no_target_is_an_outlier_and_one_feature_serves_one_target() {
        let mut comparison = comparison();
        let clutter = LIGHT + Vector3::new(0.3, 0.2, 0.1);
        for camera in 0..4 {
            comparison.add_features(Time::ZERO, &features(camera, &[LIGHT, clutter], Vector2::zeros()));
        }
        let twins = [LIGHT, LIGHT + Vector3::z() * 0.005];
        comparison.add_targets(&targets(Time::ZERO, &twins, Provenance::Measured));
        comparison.finish();
        assert_eq!((comparison.outliers_rejected, comparison.all.count()), (4, 4));
    }

    #[test]
    fn old_frames_are_settled_and_what_comes_later_is_counted() {
        let mut comparison = comparison();
        let at = |ms: f64| Time::ZERO + Interval::from_ms(ms);
        (0..3).for_each(|camera| comparison.add_features(at(0.0), &features(camera, &[LIGHT], Vector2::zeros())));
        comparison.add_targets(&targets(at(0.0), &[LIGHT], Provenance::Measured));
        comparison.add_targets(&targets(at(100.0), &[LIGHT], Provenance::Measured));
        assert_eq!(comparison.frames_recovered, 0);
        comparison.add_targets(&targets(at(100.1), &[LIGHT], Provenance::Measured));
        assert_eq!(comparison.frames_recovered, 1);
        comparison.add_features(at(0.0), &features(3, &[LIGHT], Vector2::zeros()));
        assert_eq!(comparison.late, 1);
    }
}
