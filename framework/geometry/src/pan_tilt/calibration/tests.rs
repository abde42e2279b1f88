//! Heads of known axes, found again from what they see.

use nalgebra::{SMatrix, SVector, Vector2, Vector4};

use super::equations::FOCAL;
use super::*;
use crate::camera::Distortion;
use crate::pan_tilt::axis::Axis;
use crate::pan_tilt::head::{Limits, Setting, Stacking};

/// A head at a wall, its axes degrees and centimetres from the lens.
pub(super) fn crooked(stacking: Stacking) -> PanTiltHead {
    let mut camera = Camera::look_at(Point3::new(-3.0, 0.5, 2.3), Point3::new(0.0, 0.2, 1.4), [640, 480], 700.0);
    camera.distortion = Distortion { k1: -0.15, k2: 0.04, p1: 0.001, p2: -0.002, k3: 0.0 };
    let mut head = PanTiltHead::aligned(camera, Limits::WIDE);
    head.pan = head.pan.moved(&Vector4::new(0.05, -0.04, 0.02, -0.05));
    head.tilt = head.tilt.moved(&Vector4::new(-0.03, 0.06, 0.03, -0.04));
    head.stacking = stacking;
    head
}

/// What there is to be seen, and with what noise.
#[derive(Clone, Copy)]
pub(super) struct Scene {
    pub sigma_px: f64,
    pub target_mm: f64,
    pub setting_deg: f64,
    pub wrong: f64,
    pub points_a_setting: usize,
    pub distances: [f64; 2],
    pub seed: u64,
}

pub(super) const SCENE: Scene = Scene {
    sigma_px: 0.5,
    target_mm: 1.0,
    setting_deg: 0.0,
    wrong: 0.0,
    points_a_setting: 12,
    distances: [1.2, 4.5],
    seed: 1,
};

/// The settings of [Davis 2002 §4.2], and four with both angles off rest, without which no data tell the stackings apart.
pub(super) fn settings() -> Vec<Setting> {
    let degrees = |pan: i32, tilt: i32| Setting::new(f64::from(pan).to_radians(), f64::from(tilt).to_radians());
    let mut all: Vec<Setting> = (-5..=5).map(|it| degrees(10 * it, 0)).collect();
    all.extend((-4..=3).filter(|it| *it != 0).map(|it| degrees(0, 5 * it)));
    all.extend([degrees(-40, -20), degrees(-30, 15), degrees(30, -15), degrees(40, 15)]);
    all
}

pub(super) fn observe(
    head: &PanTiltHead,
    settings: &[Setting],
    units: [AxisUnits; 2],
    scene: &Scene,
) -> Vec<HeadObservation> {
    let mut random = Random::new(scene.seed);
    let mut all = Vec::new();
    for setting in settings {
        let off = scene.setting_deg.to_radians();
        let stood = Setting::new(setting.pan + off * random.normal(), setting.tilt + off * random.normal());
        let camera = head.camera_at(&stood);
        for _ in 0..scene.points_a_setting {
            let mut pixel = Point2::new(random.uniform_in(15.0, 625.0), random.uniform_in(15.0, 465.0));
            let [near, far] = scene.distances;
            let place = camera.ray(&pixel).unwrap().at(random.uniform_in(near, far));
            let mut normal = || random.normal();
            let target = place + Vector3::new(normal(), normal(), normal()) * (scene.target_mm * 1e-3);
            pixel += Vector2::new(normal(), normal()) * scene.sigma_px;
            if random.uniform() < scene.wrong {
                pixel = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
            }
            all.push(HeadObservation {
                pan: units[0].units(setting.pan),
                tilt: units[1].units(setting.tilt),
                point_in_world: target,
                point_covariance: Matrix3::from_diagonal_element((scene.target_mm * 1e-3).powi(2)),
                pixel,
                sigma_px: scene.sigma_px.max(1e-3),
            });
        }
    }
    all
}

pub(super) fn radians(head: &PanTiltHead, scene: &Scene) -> Vec<HeadObservation> {
    observe(head, &settings(), [AxisUnits::RADIANS; 2], scene)
}

/// Optics without a place.
pub(super) fn optics(head: &PanTiltHead) -> Camera {
    Camera { camera_from_world: Isometry3::identity(), ..head.at_rest.clone() }
}

#[track_caller]
fn found(head: &PanTiltHead, observations: &[HeadObservation], options: &HeadOptions) -> HeadCalibration {
    let found = calibrate_head(&optics(head), observations, options).unwrap_or_else(|it| panic!("{it}"));
    assert!(found.converged);
    found
}

/// Estimate to truth in the order and the steps of [`HeadCovariance`].
fn error(found: &HeadCalibration, truth: &PanTiltHead, units: [AxisUnits; 2]) -> SVector<f64, 16> {
    let pose = found.head.at_rest.camera_from_world.inverse() * truth.at_rest.camera_from_world;
    let mut error = SVector::<f64, 16>::zeros();
    error.fixed_rows_mut::<3>(0).copy_from(&pose.rotation.scaled_axis());
    error.fixed_rows_mut::<3>(3).copy_from(&pose.translation.vector);
    error.fixed_rows_mut::<4>(6).copy_from(&found.head.pan.step_to(&truth.pan).unwrap());
    error.fixed_rows_mut::<4>(10).copy_from(&found.head.tilt.step_to(&truth.tilt).unwrap());
    for axis in 0..2 {
        error[14 + axis] = (units[axis].rad_per_unit / found.units[axis].rad_per_unit).ln();
    }
    error
}

/// Directions of both axes [°] and places [mm], how far off.
fn axis_errors(found: &HeadCalibration, truth: &PanTiltHead) -> [[f64; 2]; 2] {
    let off = |found: &Axis, truth: &Axis| {
        let step = found.step_to(truth).unwrap();
        [step.fixed_rows::<2>(0).norm().to_degrees(), 1e3 * step.fixed_rows::<2>(2).norm()]
    };
    [off(&found.head.pan, &truth.pan), off(&found.head.tilt, &truth.tilt)]
}

#[track_caller]
fn assert_axes_within(found: &HeadCalibration, truth: &PanTiltHead, degrees: f64, mm: f64) {
    for [direction, place] in axis_errors(found, truth) {
        assert!(direction < degrees && place < mm, "{:?}", axis_errors(found, truth));
    }
}

#[test]
fn clean_observations_give_the_head_back() {
    for stacking in [Stacking::TiltOnPan, Stacking::PanOnTilt] {
        let truth = crooked(stacking);
        let clean = Scene { sigma_px: 0.0, target_mm: 0.0, ..SCENE };
        let found = found(&truth, &radians(&truth, &clean), &HeadOptions { stacking, ..HeadOptions::default() });
        assert!(found.rms_px < 1e-6 && found.holdout.unwrap().rms_px < 1e-6, "{}", found.rms_px);
        assert_axes_within(&found, &truth, 1e-6, 1e-5);
        assert!((found.head.at_rest.centre() - truth.at_rest.centre()).norm() < 1e-7);
    }
}

#[test]
fn noise_leaves_the_axes_to_hundredths_of_a_degree_and_a_millimetre() {
    let truth = crooked(Stacking::TiltOnPan);
    let found = found(&truth, &radians(&truth, &SCENE), &HeadOptions::default());
    assert_axes_within(&found, &truth, 0.1, 2.0);
    assert!((0.9..1.1).contains(&found.noise_factor), "{}", found.noise_factor);
    let holdout = found.holdout.unwrap();
    assert!((holdout.settings, holdout.parts) == (22, 5) && holdout.rms_px < 1.1 * found.rms_px, "{holdout:?}");
    assert!(found.right.iter().filter(|it| **it).count() > 258 && found.residuals.iter().all(|it| it.is_some()));
}

#[test]
fn focal_length_is_found_and_as_far_off_as_is_said() {
    let mut squared = 0.0;
    for seed in 0..20 {
        let truth = crooked(Stacking::TiltOnPan);
        let mut stated = optics(&truth);
        stated.intrinsics.focal = stated.intrinsics.focal.map(|it| it * 1.03);
        let observations = radians(&truth, &Scene { seed, ..SCENE });
        let options = HeadOptions { optics: OpticsRule::Focal, ..HeadOptions::default() };
        let found = calibrate_head(&stated, &observations, &options).unwrap();
        let off = found.head.at_rest.intrinsics.focal[0] / truth.at_rest.intrinsics.focal[0] - 1.0;
        assert!(off.abs() < 2e-3, "{off}");
        squared += (off / found.focal_sigma).powi(2) / 20.0;
        // Axes are less well known then.
        assert_axes_within(&found, &truth, 0.2, 8.0);
        let held = calibrate_head(&stated, &observations, &HeadOptions::default()).unwrap();
        assert!(held.rms_px > 1.5 * found.rms_px && held.focal_sigma == 0.0, "{} {}", held.rms_px, found.rms_px);
    }
    assert!((0.4..2.2).contains(&squared), "{squared}");
}

/// As [`crooked`], with the view of a lens at its long end, seven degrees high.
fn narrow() -> PanTiltHead {
    let mut head = crooked(Stacking::TiltOnPan);
    head.at_rest.intrinsics.focal = [3400.0; 2];
    head.at_rest.distortion = Distortion { k1: -0.05, ..Distortion::default() };
    head
}

#[test]
fn a_narrow_view_with_a_focal_length_a_little_off_is_calibrated() {
    let truth = narrow();
    let mut stated = optics(&truth);
    stated.intrinsics.focal = stated.intrinsics.focal.map(|it| it * 0.985);
    stated.intrinsics.principal[0] += 5.0;
    let units = [AxisUnits { rad_per_unit: 1.003, at_rest: 0.0 }; 2];
    for seed in 0..4 {
        let scene = Scene { seed, points_a_setting: 25, distances: [2.0, 6.0], sigma_px: 0.3, ..SCENE };
        let observations = observe(&truth, &settings(), units, &scene);
        let options = HeadOptions {
            optics: OpticsRule::Focal,
            units: [UnitsRule::Near(AxisUnits::RADIANS); 2],
            ..HeadOptions::default()
        };
        let found = calibrate_head(&stated, &observations, &options).unwrap_or_else(|it| panic!("{seed}: {it}"));
        let off = found.head.at_rest.intrinsics.focal[0] / 3400.0 - 1.0;
        assert!(off.abs() < 4e-3 && found.rms_px < 6.0, "{off} {}", found.rms_px);
        assert_axes_within(&found, &truth, 0.3, 20.0);
    }
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    // Device units, estimated; the paper's Sony counts 880 of them over 200°.
    let units = [AxisUnits { rad_per_unit: 200f64.to_radians() / 880.0, at_rest: 0.0 }; 2];
    let mut options = HeadOptions { units: units.map(UnitsRule::Near), ..HeadOptions::default() };
    for (name, setting_deg) in [("exact settings", 0.0), ("settings 0.05° off", 0.05)] {
        options.setting_sigma = f64::to_radians(setting_deg);
        let (mut squared, mut axes, mut predicted, mut factor) = (0.0, 0.0, 0.0, 0.0);
        for seed in 0..20 {
            let truth = crooked(Stacking::TiltOnPan);
            let scene = Scene { setting_deg, seed, points_a_setting: 8, ..SCENE };
            let found = found(&truth, &observe(&truth, &settings(), units, &scene), &options);
            let error = error(&found, &truth, units);
            squared += error.dot(&(found.covariance.whole.try_inverse().unwrap() * error)) / 20.0;
            let of_axes = error.fixed_rows::<8>(6).into_owned();
            let covariance: SMatrix<f64, 8, 8> = found.covariance.whole.fixed_view::<8, 8>(6, 6).into_owned();
            axes += of_axes.dot(&(covariance.try_inverse().unwrap() * of_axes)) / 20.0;
            let setting = Setting::new(0.6, 0.2);
            let target = truth.camera_at(&setting).ray(&Point2::new(500.0, 100.0)).unwrap().at(2.0);
            let (pixel, covariance) = found.predict(units[0].units(0.6), units[1].units(0.2), &target).unwrap();
            let off = pixel - Point2::new(500.0, 100.0);
            predicted += off.dot(&(covariance.try_inverse().unwrap() * off)) / 20.0;
            factor += found.noise_factor / 20.0;
        }
        // χ² of 16, 8 and 2 degrees of freedom over 20: four standard errors of the mean.
        assert!((10.9..21.1).contains(&squared), "{name}: {squared}");
        assert!((4.4..11.6).contains(&axes), "{name}: {axes}");
        assert!((0.2..3.8).contains(&predicted), "{name}: {predicted}");
        assert!((0.95..1.05).contains(&factor), "{name}: {factor}");
    }
}

#[test]
fn one_wrong_observation_in_five_does_no_harm() {
    let truth = crooked(Stacking::TiltOnPan);
    for seed in 0..4 {
        let scene = Scene { wrong: 0.2, seed, ..SCENE };
        let observations = radians(&truth, &scene);
        let robust = found(&truth, &observations, &HeadOptions::default());
        let sigmas = [robust.covariance.pan(), robust.covariance.tilt()];
        for (sigma, [direction, place]) in sigmas.iter().zip(axis_errors(&robust, &truth)) {
            assert!(
                direction < 4.0 * sigma.direction.to_degrees() && place < 4.0 * 1e3 * sigma.place,
                "{sigma:?} {place}"
            );
            assert!(sigma.direction.to_degrees() < 0.07 && 1e3 * sigma.place < 3.0, "{sigma:?}");
        }
        let wrong = robust.right.iter().filter(|it| !**it).count();
        assert!(
            (30..80).contains(&wrong) && (0.9..1.1).contains(&robust.noise_factor),
            "{wrong} {}",
            robust.noise_factor
        );
        let plain = HeadOptions {
            loss: Loss::Squared,
            most_place_sigma: 1.0,
            most_direction_sigma: 1.0,
            ..HeadOptions::default()
        };
        let plain = refine_head(&truth, [AxisUnits::RADIANS; 2], &observations, &plain).unwrap();
        assert!(axis_errors(&plain, &truth)[0][1] > 5.0 && plain.right.iter().all(|it| *it));
    }
}

#[test]
fn a_target_right_before_the_lens_is_no_witness() {
    let truth = crooked(Stacking::TiltOnPan);
    let mut observations = radians(&truth, &SCENE);
    // Beside the lens and 1 mm before it: wherever it is seen, its millimetre of error explains that.
    let ahead = truth.at_rest.camera_from_world.inverse_transform_point(&Point3::new(0.002, 0.0, 0.001));
    observations.push(HeadObservation { pan: 0.0, tilt: 0.0, point_in_world: ahead, ..observations[0].clone() });
    let found = found(&truth, &observations, &HeadOptions::default());
    assert!(!found.right[observations.len() - 1] && found.rms_px < 1.0 && found.holdout.unwrap().rms_px < 1.1);
}

#[test]
fn single_observations_everywhere_are_enough_when_the_units_are_known() {
    let truth = crooked(Stacking::TiltOnPan);
    let mut random = Random::new(3);
    let anywhere: Vec<Setting> =
        (0..150).map(|_| Setting::new(random.uniform_in(-1.6, 1.6), random.uniform_in(-0.4, 0.4))).collect();
    let scene = Scene { points_a_setting: 1, wrong: 0.2, ..SCENE };
    let observations = observe(&truth, &anywhere, [AxisUnits::RADIANS; 2], &scene);
    assert_axes_within(&found(&truth, &observations, &HeadOptions::default()), &truth, 0.15, 4.0);
    // Without the units there is no start.
    let unknown = HeadOptions { units: [UnitsRule::Unknown { at_rest: 0.0 }; 2], ..HeadOptions::default() };
    let refused = calibrate_head(&optics(&truth), &observations, &unknown).unwrap_err();
    assert_eq!(refused, HeadCalibrationError::NoStart { settings: 150, posed: 0 });
}

#[test]
fn units_are_found_from_nothing() {
    let truth = crooked(Stacking::TiltOnPan);
    let units = [AxisUnits { rad_per_unit: 0.004, at_rest: 120.0 }, AxisUnits { rad_per_unit: 0.0009, at_rest: -7.0 }];
    let scene = Scene { wrong: 0.15, points_a_setting: 16, ..SCENE };
    let observations = observe(&truth, &settings(), units, &scene);
    let unknown = units.map(|it| UnitsRule::Unknown { at_rest: it.at_rest });
    let found = found(&truth, &observations, &HeadOptions { units: unknown, ..HeadOptions::default() });
    assert_axes_within(&found, &truth, 0.15, 2.5);
    for ((found, truth), sigma) in found.units.iter().zip(units).zip(found.covariance.units()) {
        let off = found.rad_per_unit / truth.rad_per_unit - 1.0;
        assert!(off.abs() < 2e-3 && off.abs() < 4.5 * sigma, "{off}");
        assert_eq!(found.at_rest, truth.at_rest);
    }
}

#[test]
fn cameras_may_hang_upside_down_or_sideways_and_count_backwards() {
    for (turns, sign) in [(2.0, 1.0), (1.0, 1.0), (0.0, -1.0)] {
        let mut truth = crooked(Stacking::TiltOnPan);
        let roll = Axis::through_origin(Vector3::z()).unwrap().turn(turns * std::f64::consts::FRAC_PI_2);
        truth.at_rest.camera_from_world = roll * truth.at_rest.camera_from_world;
        for axis in [&mut truth.pan, &mut truth.tilt] {
            *axis = Axis { point: roll * axis.point, direction: roll.rotation * axis.direction };
        }
        let units = [AxisUnits { rad_per_unit: 0.01 * sign, at_rest: 0.0 }; 2];
        let options = HeadOptions { units: units.map(UnitsRule::Known), ..HeadOptions::default() };
        let scene = Scene { points_a_setting: 4, ..SCENE }; // too few for poses
        let found = found(&truth, &observe(&truth, &settings(), units, &scene), &options);
        assert_axes_within(&found, &truth, 0.2, 8.0);
    }
}

#[test]
fn three_models_fit_ever_better() {
    let truth = crooked(Stacking::TiltOnPan);
    let observations = radians(&truth, &SCENE);
    let aligned = found(
        &truth,
        &observations,
        &HeadOptions { axes: AxesRule::Aligned, loss: Loss::Squared, ..HeadOptions::default() },
    );
    let free = found(&truth, &observations, &HeadOptions::default());
    assert_eq!(aligned.head.pan, PanTiltHead::aligned(truth.at_rest.clone(), Limits::WIDE).pan);
    assert!(aligned.median_px > 5.0 && free.median_px < 0.8, "{} {}", aligned.median_px, free.median_px);
    let held = aligned.covariance.whole.fixed_view::<8, 8>(6, 6).into_owned();
    assert!(held.norm() == 0.0 && aligned.covariance.pose().norm() > 0.0);
}

#[test]
fn errors_larger_than_stated_widen_the_covariance() {
    let truth = crooked(Stacking::TiltOnPan);
    let mut observations = radians(&truth, &Scene { sigma_px: 3.0, target_mm: 0.0, ..SCENE });
    let as_stated = found(&truth, &observations, &HeadOptions::default());
    observations.iter_mut().for_each(|it| it.sigma_px = 0.3);
    let understated = found(&truth, &observations, &HeadOptions::default());
    assert!((9.0..11.0).contains(&understated.noise_factor), "{}", understated.noise_factor);
    let ratio = understated.covariance.pan().place / as_stated.covariance.pan().place;
    assert!((0.9..1.1).contains(&ratio), "{ratio}");
    assert!(understated.right.iter().filter(|it| **it).count() > 255);
}

#[test]
fn derivatives_are_those_of_differences() {
    let (head, at) = (crooked(Stacking::TiltOnPan), [0.7, -0.3]);
    for stacking in [Stacking::TiltOnPan, Stacking::PanOnTilt] {
        let head = PanTiltHead { stacking, ..head.clone() };
        let target = head.camera_at(&Setting::new(at[0], at[1])).ray(&Point2::new(420.0, 100.0)).unwrap().at(2.5);
        let observations = vec![
            HeadObservation {
                pan: at[0],
                tilt: at[1],
                point_in_world: target,
                point_covariance: Matrix3::zeros(),
                pixel: Point2::new(400.0, 110.0),
                sigma_px: 1.0,
            };
            12
        ];
        // Twelve alike are no calibration, but enough for a derivative.
        let options = HeadOptions::default();
        let prepared = Prepared {
            optics: optics(&head),
            options: &options,
            observations: &observations,
            used: vec![Used { units: at, setting: 0 }; 12],
            directions: vec![None; 12],
            at_rest: [0.0; 2],
            n_settings: 1,
        };
        let start = prepared.parameters(head, [1.0; 2]);
        let chosen = [0];
        let fit = Fit::new(&prepared, &chosen, &start, 1.0);
        let linear = prepared.linear(&start, 0).unwrap();
        let by_common = |unknown: usize| match unknown {
            FOCAL => linear.by_focal,
            _ => linear.by_shared.column(unknown).into_owned(),
        };
        for unknown in 0..17 {
            let at = |sign: f64| {
                let mut step = nalgebra::DVector::zeros(17);
                step[unknown] = sign * 1e-5;
                use foveate_estimation::least_squares::Problem as _;
                prepared.error(&fit.moved(&start, &step), 0).unwrap()
            };
            let difference = (at(1.0) - at(-1.0)) / 2e-5;
            let off = (difference - by_common(unknown)).norm();
            assert!(off < 1e-5 * (1.0 + difference.norm()), "{stacking:?} {unknown}: {difference} {off}");
        }
    }
}

#[test]
fn a_head_looked_at_from_its_start_is_refined() {
    let truth = crooked(Stacking::TiltOnPan);
    let observations = radians(&truth, &SCENE);
    let mut start = PanTiltHead::aligned(truth.at_rest.clone(), Limits::WIDE);
    start.at_rest.camera_from_world.translation.vector.x += 0.05;
    let units = [AxisUnits::RADIANS; 2];
    let refined = refine_head(&start, units, &observations, &HeadOptions::default()).unwrap();
    let free = found(&truth, &observations, &HeadOptions::default());
    assert!(refined.head.pan.step_to(&free.head.pan).unwrap().norm() < 1e-5);
    assert_eq!(refined.right, free.right);
}
