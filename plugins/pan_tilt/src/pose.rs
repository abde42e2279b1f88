//! `pan_tilt.pose`: the pose of the camera on a head when each of its pictures was taken.

use foveate::estimation::{ActuatorEstimator, ActuatorOptions};
use foveate::geometry::pan_tilt::{PanTiltHead, Setting};
use foveate::prelude::*;
use foveate::scene::heads::CalibratedHead;
use nalgebra::{Isometry3, Matrix2, Point3, SMatrix, Vector4, Vector6};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::control::take_event;
use crate::target_anchor::TargetAnchor;

ports! {
    REPORT: In<HeadReport> = each("report");
    IMAGE: In<Image> = each("image").optional();
    FEATURES: In<Features> = each("features").optional();
    TARGET: In<Targets> = latest("target").optional().of_parent();
    POSE: Out<HeadPose> = "pose";
}

figures! {
    "heads.*.pose_latency_ms": ms, neither, "Latency from a command to the first movement of that head, as estimated at the end";
        "heads.*.pose_latency_sigma_ms": ms, low, "Standard deviation of that latency";
        "heads.*.sighted": share, high, "Pictures whose pose was corrected by the target, of those with a pose";
        "heads.*.pictures_without_pose": count, low, "Pictures before the head's first position answer";
}

/// Largest distance of the target's feature from its prediction [standard deviations] …
const GATE_SIGMAS: f64 = 4.0;
/// … if no other feature is this near.
const ALONE_SIGMAS: f64 = 12.0;
/// Longest extrapolation of a target to the time of a picture [s].
const FARTHEST_S: f64 = 0.1;

/// Step of derivatives [rad, m].
const STEP: f64 = 1e-6;

/// Settings of [`Pose`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PoseSettings {
    /// Initial latency from a command on the line to the first movement [ms].
    #[schemars(range(min = 0.0, max = 800.0))]
    pub latency_ms: f64,
    /// Approximate acceleration of the head; it is estimated during the run [°/s²].
    #[schemars(range(min = 10.0, max = 10_000.0))]
    pub acceleration_deg_per_s2: f64,
    /// Resolution of the head's answers for pan and tilt [°].
    #[schemars(inner(range(min = 1e-6, max = 10.0)))]
    pub quantum_deg: [f64; 2],
    /// Vibration of the camera beyond the motors' motion, standard deviation [°].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub shake_deg: f64,
}

impl Default for PoseSettings {
    /// As of the EVI-D30.
    fn default() -> Self {
        Self { latency_ms: 270.0, acceleration_deg_per_s2: 400.0, quantum_deg: [1.0 / 8.8, 1.0 / 12.0], shake_deg: 0.1 }
    }
}

/// The pose of a head at the capture time of each picture, with uncertainty; the paper's weak point [Davis 2002 §5.2]. See [`ActuatorEstimator`].
///
/// With `features` and `target` connected, a picture with the scale's target, and no other feature near it, corrects the head's pose: the
/// target's position is known from the scale above.
pub struct Pose {
    camera: CameraId,
    name: String,
    head: CalibratedHead,
    actuator: ActuatorEstimator,
    zoom: Option<f64>,
    anchor: TargetAnchor,
    target: Option<Target>,
    target_time: Time,
    n_sighted: u64,
    n_told: u64,
    next_event: u64,
    n_unknown: u64,
}

/// Both angles and their covariance [rad, rad²].
#[derive(Debug, Clone, Copy, PartialEq)]
struct Standing {
    angles: [f64; 2],
    covariance: Matrix2<f64>,
}

/// Observation of the head's angles by a picture.
struct Observation {
    /// Combined with the prediction.
    standing: Standing,
    /// By the picture alone, with its uncertainty.
    seen: [f64; 2],
    variances: [f64; 2],
}

impl Node for Pose {
    const TYPE: &'static str = "pan_tilt.pose";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str =
        "Computes the pose of a head's camera at each picture from commands, answers and latency";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = PoseSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: PoseSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("latency_ms", settings.latency_ms, 0.0..=800.0)?;
        ConfigError::unless_in("acceleration_deg_per_s2", settings.acceleration_deg_per_s2, 10.0..=10_000.0)?;
        for quantum in settings.quantum_deg {
            ConfigError::unless_in("quantum_deg", quantum, 1e-6..=10.0)?;
        }
        ConfigError::unless_in("shake_deg", settings.shake_deg, 0.0..=10.0)?;
        let (camera, head) = crate::head_of(setup)?;
        let options = ActuatorOptions {
            latency_s: [settings.latency_ms * 1e-3, 0.08],
            acceleration: settings.acceleration_deg_per_s2.to_radians(),
            quantum: settings.quantum_deg.map(f64::to_radians),
            shake: settings.shake_deg.to_radians(),
            ..ActuatorOptions::default()
        };
        Ok(Self {
            camera,
            name: setup.camera_name().unwrap_or_default().to_owned(),
            head,
            actuator: ActuatorEstimator::new(options, 0.0, [0.0; 2]),
            zoom: None,
            anchor: TargetAnchor::new(setup),
            target: None,
            target_time: Time(i64::MIN),
            n_sighted: 0,
            n_told: 0,
            next_event: 0,
            n_unknown: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(report) = io.take(&REPORT) {
            for (at, event) in report.value.since(&mut self.next_event) {
                take_event(&mut self.actuator, *at, event);
                if let HeadEvent::Zoom(zoom) = event {
                    self.zoom = Some(*zoom);
                }
            }
            return Ok(());
        }
        if let Some(targets) = io.latest(&TARGET).filter(|it| it.value.time > self.target_time) {
            self.target_time = targets.value.time;
            self.target = self.anchor.target(targets.value).cloned();
        }
        if let Some(image) = io.take(&IMAGE) {
            self.tell(image.stamp, None, io);
        } else if let Some(features) = io.take(&FEATURES) {
            self.tell(features.stamp, Some(&features.value), io);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = &self.name;
        let [latency, sigma] = self.actuator.latency();
        report.figure(format!("heads.{name}.pose_latency_ms"), latency * 1e3);
        report.figure(format!("heads.{name}.pose_latency_sigma_ms"), sigma * 1e3);
        report.figure(format!("heads.{name}.sighted"), self.n_sighted as f64 / self.n_told as f64);
        if self.n_unknown > 0 {
            report.figure(format!("heads.{name}.pictures_without_pose"), self.n_unknown as f64);
        }
        Ok(())
    }
}

impl Pose {
    fn tell(&mut self, stamp: Stamp, features: Option<&Features>, io: &mut Io<'_>) {
        // A head without a report may be anywhere.
        let state = self.actuator.last_answer_s().and_then(|last| Some((last, self.actuator.at(stamp.time.as_s())?)));
        let Some((last, state)) = state else {
            self.n_unknown += 1;
            return io.gap(&POSE, stamp.time, "the head has not reported its position yet");
        };
        let foreseen = Standing { angles: state.angles, covariance: Matrix2::from_diagonal(&state.variances.into()) };
        let observation = features.and_then(|it| self.observation(it, stamp.time, &foreseen));
        self.n_told += 1;
        let standing = match observation {
            Some(Observation { standing, seen, variances }) => {
                self.n_sighted += 1;
                self.actuator.observation(stamp.time.as_s(), seen, variances);
                standing
            }
            None => foreseen,
        };
        let age = Interval::from_s((stamp.time.as_s() - last).max(0.0));
        let pose = self.pose_at(stamp.time, &standing, state.rates, age);
        io.emit(&POSE, stamp, pose);
    }

    /// The head's angles from the target's feature, if there is exactly one.
    fn observation(&self, features: &Features, time: Time, foreseen: &Standing) -> Option<Observation> {
        let target = self.target.as_ref()?;
        let since = time - self.target_time;
        if since.abs().as_s() > FARTHEST_S {
            return None;
        }
        let [pan, tilt] = foreseen.angles;
        // The light itself is seen, not what its scale means by it.
        let place = target.position_after(since);
        let expected = self.head.model.project_with_jacobian(&place, &Setting { pan, tilt, zoom: self.zoom })?;
        let block = |row, column| target.covariance.fixed_view::<3, 3>(row, column).into_owned();
        let dt = since.as_s();
        let place_covariance = block(0, 0) + (block(0, 3) + block(3, 0)) * dt + block(3, 3) * (dt * dt);
        let by_place = expected.by_point * place_covariance * expected.by_point.transpose();
        let by_angles = expected.by_angles * foreseen.covariance * expected.by_angles.transpose();
        let distance = |it: &Feature| {
            let missed = it.centre - expected.pixel;
            let inverse = (by_angles + by_place + it.covariance).try_inverse()?;
            Some((missed.dot(&(inverse * missed)).max(0.0).sqrt(), missed))
        };
        let mut near =
            features.list.iter().filter_map(|it| Some((it, distance(it)?))).filter(|it| it.1.0 < ALONE_SIGMAS);
        let (feature, (sigmas, missed)) = near.next()?;
        if near.next().is_some() || sigmas > GATE_SIGMAS {
            return None;
        }
        // An extended Kalman filter's update of both angles by one pixel.
        let noise = by_place + feature.covariance;
        let gain = foreseen.covariance * expected.by_angles.transpose() * (by_angles + noise).try_inverse()?;
        let change = gain * missed;
        let by_pixel = expected.by_angles.try_inverse()?;
        let (seen, variances) = (by_pixel * missed, by_pixel * noise * by_pixel.transpose());
        Some(Observation {
            standing: Standing {
                angles: [pan + change.x, tilt + change.y],
                covariance: (Matrix2::identity() - gain * expected.by_angles) * foreseen.covariance,
            },
            seen: [pan + seen.x, tilt + seen.y],
            variances: [variances[(0, 0)], variances[(1, 1)]],
        })
    }

    fn pose_at(&self, time: Time, standing: &Standing, rates: [f64; 2], age: Interval) -> HeadPose {
        let setting = Setting { pan: standing.angles[0], tilt: standing.angles[1], zoom: self.zoom };
        let here = from_world(&self.head.model, &setting);
        let by_angles = self.by_angles(&setting);
        let mut covariance = by_angles * standing.covariance * by_angles.transpose();
        if let Some(known) = &self.head.covariance {
            let by_unknowns = self.by_unknowns(&setting, &by_angles);
            covariance += by_unknowns * known.whole * by_unknowns.transpose();
        }
        HeadPose {
            camera: self.camera,
            time,
            angles: standing.angles,
            angles_covariance: standing.covariance,
            rates,
            zoom: self.zoom,
            camera_from_world: here,
            covariance,
            age,
        }
    }

    /// δ of the camera's pose for a radian of pan and of tilt.
    fn by_angles(&self, setting: &Setting) -> SMatrix<f64, 6, 2> {
        let Setting { pan, tilt, .. } = *setting;
        let model = &self.head.model;
        let column = |turned: Setting| step_to(model, setting, &from_world(model, &turned));
        SMatrix::from_columns(&[
            column(Setting { pan: pan + STEP, ..*setting }),
            column(Setting { tilt: tilt + STEP, ..*setting }),
        ])
    }

    /// δ of the camera's pose by the unknowns of the calibration, in the order of its covariance. A rotation of the camera's rest pose rotates it at any setting:
    /// both are in the world.
    fn by_unknowns(&self, setting: &Setting, by_angles: &SMatrix<f64, 6, 2>) -> SMatrix<f64, 6, 16> {
        let mut by = SMatrix::<f64, 6, 16>::zeros();
        by.fixed_view_mut::<6, 6>(0, 0).fill_with_identity();
        let mut moved = self.head.model.clone();
        for part in 0..4 {
            let mut step = Vector4::zeros();
            step[part] = STEP;
            let model = &self.head.model;
            moved.pan = model.pan.footed_at(&Point3::origin()).moved(&step);
            by.set_column(6 + part, &step_to(model, setting, &from_world(&moved, setting)));
            moved.pan = model.pan;
            moved.tilt = model.tilt.footed_at(&Point3::origin()).moved(&step);
            by.set_column(10 + part, &step_to(model, setting, &from_world(&moved, setting)));
            moved.tilt = model.tilt;
        }
        by.set_column(14, &(by_angles.column(0) * setting.pan));
        by.set_column(15, &(by_angles.column(1) * setting.tilt));
        by
    }
}

fn from_world(model: &PanTiltHead, setting: &Setting) -> Isometry3<f64> {
    model.camera_from_rest(setting) * model.at_rest.camera_from_world
}

/// δ from the pose at `setting` to one that is [`STEP`] away, for a step of 1.
fn step_to(model: &PanTiltHead, setting: &Setting, there: &Isometry3<f64>) -> Vector6<f64> {
    let step = from_world(model, setting).inverse() * there;
    let mut delta = Vector6::zeros();
    delta.fixed_rows_mut::<3>(0).copy_from(&(step.rotation.scaled_axis() / STEP));
    delta.fixed_rows_mut::<3>(3).copy_from(&(step.translation.vector / STEP));
    delta
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate::estimation::ActuatorState;
    use foveate::geometry::Camera;
    use foveate::geometry::pan_tilt::{HeadCovariance, Limits};
    use foveate_testkit::check_node;

    use nalgebra::Matrix6;

    use super::*;

    fn setup() -> Setup {
        let text = "[calibration]\nlength_unit = \"m\"\n[camera.ptz-1]\nimage_size_px = [640, 480]\nfocal_px = [900.0, 900.0]\n\
                    principal_point_px = [319.5, 239.5]\nposition_m = [0.0, 0.0, 2.0]\ncamera_from_world_wxyz = [0.7071067811865476, 0.7071067811865476, 0.0, 0.0]\n\
                    [head.ptz-1]\npan_axis = { point_m = [0.01, 0.0, -0.05], direction = [0.0, 1.0, 0.0] }\n\
                    tilt_axis = { point_m = [0.0, 0.02, -0.03], direction = [1.0, 0.0, 0.0] }\n";
        let calibration =
            foveate::scene::calibration::Calibration::from_toml(text, std::path::Path::new("test")).unwrap();
        let mut setup = Setup::for_tests();
        (setup.calibration, setup.camera) = (Arc::new(calibration), Some(CameraId(0)));
        setup
    }

    #[test]
    fn node_keeps_the_law() {
        check_node::<Pose>("");
        check_node::<Pose>("latency_ms = 0\nquantum_deg = [0.01, 0.01]");
    }

    #[test]
    fn settings_out_of_range_and_a_camera_without_a_head_are_refused() {
        let refused = |change: fn(&mut PoseSettings)| {
            let mut settings = PoseSettings::default();
            change(&mut settings);
            Pose::new(settings, &setup()).err().and_then(|it| it.setting)
        };
        assert_eq!(refused(|_| ()), None);
        assert_eq!(refused(|it| it.latency_ms = -1.0).as_deref(), Some("latency_ms"));
        assert_eq!(refused(|it| it.quantum_deg[1] = 0.0).as_deref(), Some("quantum_deg"));
        assert_eq!(refused(|it| it.shake_deg = f64::NAN).as_deref(), Some("shake_deg"));
        let without = Pose::new(PoseSettings::default(), &Setup::for_tests());
        assert!(without.is_err_and(|it| it.message.contains("found no camera")));
    }

    /// What a picture tells of a head that truly stands at `truth`, when it is thought to stand at 0.3 and -0.2 rad; besides the target's, the picture has
    /// features at these distances from it [px].
    fn observed(truth: [f64; 2], others: &[f64]) -> Option<Observation> {
        let mut pose = Pose::new(PoseSettings::default(), &setup()).unwrap();
        let place = Point3::new(1.0, 3.0, 1.2);
        pose.target_time = Time::from_s(1.0);
        pose.target = Some(Target {
            id: TargetId(0),
            position: place,
            velocity: nalgebra::Vector3::x(),
            covariance: Matrix6::identity() * 1e-6,
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        });
        let time = Time::from_s(1.02);
        let moved = place + nalgebra::Vector3::x() * 0.02;
        let pixel = pose.head.model.camera_at(&Setting::new(truth[0], truth[1])).project(&moved).unwrap();
        let feature = |off: f64| Feature {
            centre: pixel + nalgebra::Vector2::new(off, 0.0),
            covariance: Matrix2::identity() * 0.01,
            area: 9,
            peak: 200,
            label: None,
        };
        let list = [0.0].iter().chain(others).map(|it| feature(*it)).collect();
        let foreseen = Standing { angles: [0.3, -0.2], covariance: Matrix2::identity() * 0.004_f64.powi(2) };
        pose.observation(&Features { camera: CameraId(0), list }, time, &foreseen)
    }

    #[test]
    fn a_picture_of_the_target_says_where_the_head_stood() {
        let truth = [0.306, -0.195];
        let Observation { standing, seen, variances } = observed(truth, &[]).unwrap();
        for axis in [0, 1] {
            assert!((seen[axis] - truth[axis]).abs() < 1e-4, "{axis}: {}", seen[axis]);
            let [by, to] =
                [(standing.angles[axis] - truth[axis]).abs(), 3.0 * standing.covariance[(axis, axis)].sqrt()];
            assert!(by < to && to < 0.002 && variances[axis] > 1e-8, "{axis}: {by} of {to}");
        }
    }

    #[test]
    fn a_picture_with_two_candidates_or_a_far_one_says_nothing() {
        assert!(observed([0.305, -0.2], &[20.0]).is_none(), "another feature is near");
        assert!(observed([0.305, -0.2], &[400.0]).is_some(), "another feature is far");
        assert!(observed([0.34, -0.2], &[]).is_none(), "ten standard deviations off: that is another light");
    }

    #[test]
    fn the_covariance_is_that_of_poses_drawn_from_what_is_known() {
        let mut pose = Pose::new(PoseSettings::default(), &setup()).unwrap();
        let mut known = SMatrix::<f64, 16, 16>::zeros();
        for (index, sigma) in [1e-3, 2e-3, 1e-3, 2e-3, 1e-3, 3e-3].into_iter().enumerate() {
            known[(index, index)] = f64::powi(sigma, 2);
        }
        (6..14).for_each(|it| known[(it, it)] = 1e-6);
        (known[(14, 14)], known[(15, 15)]) = (1e-5, 1e-5);
        pose.head.covariance = Some(HeadCovariance { whole: known });
        let state = ActuatorState { angles: [0.6, -0.3], rates: [0.0; 2], variances: [4e-6, 1e-6] };
        let standing = Standing { angles: state.angles, covariance: Matrix2::from_diagonal(&state.variances.into()) };
        let stated = pose.pose_at(Time::ZERO, &standing, [0.0; 2], Interval(0));
        let mut random = foveate::estimation::Random::new(2);
        let mut found = Matrix6::zeros();
        const DRAWN: usize = 4000;
        for _ in 0..DRAWN {
            let mut drawn = pose.head.model.clone();
            let mut normal = |variance: f64| variance.sqrt() * random.normal();
            let delta: Vec<f64> = (0..16).map(|it| normal(known[(it, it)])).collect();
            let turn = nalgebra::UnitQuaternion::from_scaled_axis(nalgebra::Vector3::new(delta[0], delta[1], delta[2]));
            let shift = nalgebra::Translation3::new(delta[3], delta[4], delta[5]);
            drawn.at_rest = Camera {
                camera_from_world: drawn.at_rest.camera_from_world * Isometry3::from_parts(shift, turn),
                ..drawn.at_rest
            };
            drawn.pan = drawn.pan.footed_at(&Point3::origin()).moved(&Vector4::from_column_slice(&delta[6..10]));
            drawn.tilt = drawn.tilt.footed_at(&Point3::origin()).moved(&Vector4::from_column_slice(&delta[10..14]));
            drawn.limits = Limits::WIDE;
            let setting = Setting {
                pan: (state.angles[0] + normal(state.variances[0])) * delta[14].exp(),
                tilt: (state.angles[1] + normal(state.variances[1])) * delta[15].exp(),
                zoom: None,
            };
            let step = stated.camera_from_world.inverse() * from_world(&drawn, &setting);
            let mut error = Vector6::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&step.rotation.scaled_axis());
            error.fixed_rows_mut::<3>(3).copy_from(&step.translation.vector);
            found += error * error.transpose() / DRAWN as f64;
        }
        for index in 0..6 {
            let ratio = found[(index, index)] / stated.covariance[(index, index)];
            assert!((0.9..1.1).contains(&ratio), "{index}: {ratio}");
        }
    }
}
