//! What holds no calibration, and what cannot be followed.

use super::tests::{SCENE, Scene, crooked, observe, optics, radians, settings};
use super::*;
use crate::pan_tilt::head::{Setting, Stacking};

#[track_caller]
fn refused(observations: &[HeadObservation], options: &HeadOptions) -> HeadCalibrationError {
    calibrate_head(&optics(&crooked(Stacking::TiltOnPan)), observations, options).unwrap_err()
}

#[test]
fn too_little_range_is_refused() {
    let truth = crooked(Stacking::TiltOnPan);
    let options = HeadOptions::default();
    let still = |pan: f64, tilt: f64| -> Vec<Setting> {
        settings().iter().map(|it| Setting::new(it.pan * pan, it.tilt * tilt)).collect()
    };
    let fault = refused(&observe(&truth, &still(0.08, 1.0), [AxisUnits::RADIANS; 2], &SCENE), &options);
    assert_eq!(fault.to_string(), "pan was moved over 8.00°, expected 10.0° or more");
    let units = [AxisUnits::RADIANS; 2];
    let unknown = HeadOptions { units: [UnitsRule::Unknown { at_rest: 0.0 }; 2], ..HeadOptions::default() };
    for options in [&options, &unknown] {
        let fault = refused(&observe(&truth, &still(1.0, 0.0), units, &SCENE), options);
        assert_eq!(
            fault,
            HeadCalibrationError::RangeTooSmall { axis: "tilt", range: 0.0, expected: options.least_range[1] }
        );
    }
    // With unknown units the range shows in the end only.
    let fault = refused(&observe(&truth, &still(1.0, 0.1), units, &Scene { points_a_setting: 30, ..SCENE }), &unknown);
    assert!(
        matches!(fault, HeadCalibrationError::RangeTooSmall { axis: "tilt", range, .. } if (range.to_degrees() - 3.5).abs() < 0.5),
        "{fault}"
    );
}

#[test]
fn targets_that_hold_nothing_are_refused() {
    let truth = crooked(Stacking::TiltOnPan);
    let options = HeadOptions::default();
    let mut observations = radians(&truth, &SCENE);
    assert_eq!(
        refused(&observations[..11], &options),
        HeadCalibrationError::TooFew { count: 11, kind: "usable", expected: 12 }
    );
    // All far away: where the axes pass does not show.
    let far = refused(&radians(&truth, &Scene { distances: [100.0, 102.0], ..SCENE }), &options);
    assert!(
        matches!(far, HeadCalibrationError::Loose { unit: "mm", distances: [near, _], .. } if (near - 100.0).abs() < 1.0),
        "{far}"
    );
    assert!(far.to_string().contains("nearer targets"), "{far}");
    // Along a line the camera may turn about it.
    for (index, it) in observations.iter_mut().enumerate() {
        it.point_in_world = Point3::new(0.0, 0.01 * index as f64, 1.0);
    }
    assert!(matches!(refused(&observations, &options), HeadCalibrationError::OnALine { .. }));
}

#[test]
fn pixels_that_belong_to_no_targets_are_refused() {
    let truth = crooked(Stacking::TiltOnPan);
    let fault = refused(&radians(&truth, &Scene { wrong: 1.0, ..SCENE }), &HeadOptions::default());
    assert!(
        matches!(
            fault,
            HeadCalibrationError::Loose { .. }
                | HeadCalibrationError::TooFew { .. }
                | HeadCalibrationError::ParallelAxes { .. }
        ),
        "{fault}"
    );
}

#[test]
fn a_tilt_axis_that_is_the_pan_axis_is_refused() {
    let mut truth = crooked(Stacking::TiltOnPan);
    truth.tilt = truth.pan;
    let unknown = HeadOptions { units: [UnitsRule::Unknown { at_rest: 0.0 }; 2], ..HeadOptions::default() };
    let fault = refused(&radians(&truth, &SCENE), &unknown);
    assert!(matches!(fault, HeadCalibrationError::ParallelAxes { angle } if angle < 0.1), "{fault}");
}

#[test]
fn what_cannot_be_followed_is_named() {
    let truth = crooked(Stacking::TiltOnPan);
    let observations = radians(&truth, &SCENE);
    let fault_of = |change: &dyn Fn(&mut HeadOptions, &mut HeadObservation)| {
        let (mut options, mut observations) = (HeadOptions::default(), observations.clone());
        change(&mut options, &mut observations[7]);
        match refused(&observations, &options) {
            HeadCalibrationError::BadOption { option, found, .. } => (None, option, found),
            HeadCalibrationError::BadObservation { observation, field, found, .. } => (Some(observation), field, found),
            other => panic!("{other}"),
        }
    };
    assert_eq!(fault_of(&|it, _| it.loss = Loss::Cauchy { scale: 0.0 }), (None, "scale of the loss", 0.0));
    assert_eq!(fault_of(&|it, _| it.setting_sigma = -1.0), (None, "setting_sigma", -1.0));
    let zero = UnitsRule::Known(AxisUnits { rad_per_unit: 0.0, at_rest: 0.0 });
    assert_eq!(fault_of(&|it, _| it.units[1] = zero), (None, "rad_per_unit", 0.0));
    let (observation, field, found) = fault_of(&|_, it| it.pan = f64::NAN);
    assert!(found.is_nan());
    assert_eq!((observation, field), (Some(7), "pan"));
    assert_eq!(fault_of(&|_, it| it.sigma_px = 0.0), (Some(7), "sigma_px", 0.0));
    assert_eq!(fault_of(&|_, it| it.point_covariance[(1, 1)] = -1.0).0, Some(7));
    let mut broken = optics(&truth);
    broken.intrinsics.focal[0] = -1.0;
    let fault = calibrate_head(&broken, &observations, &HeadOptions::default()).unwrap_err();
    assert_eq!(fault.to_string(), "the optics: focal[0] is -1 px, expected more than 0 px");
}
