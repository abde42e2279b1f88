//! What holds no calibration, and what cannot be followed.

use super::tests::{SCENE, Scene, crooked, observe, optics, radians, settings};
use super::*;
use crate::pan_tilt::head::{Setting, Stacking};

#[track_caller]
fn refused(observations: &[HeadObservation], rules: &HeadRules) -> CalibrationFault {
    calibrate_head(&optics(&crooked(Stacking::TiltOnPan)), observations, rules).unwrap_err()
}

#[test]
fn too_little_range_is_refused() {
    let truth = crooked(Stacking::TiltOnPan);
    let rules = HeadRules::default();
    let still = |pan: f64, tilt: f64| -> Vec<Setting> {
        settings().iter().map(|it| Setting::new(it.pan * pan, it.tilt * tilt)).collect()
    };
    let fault = refused(&observe(&truth, &still(0.08, 1.0), [AxisUnits::RADIANS; 2], &SCENE), &rules);
    assert_eq!(fault.to_string(), "pan was moved over 8.00° only, expected 10.0° or more");
    let units = [AxisUnits::RADIANS; 2];
    let unknown = HeadRules { units: [UnitsRule::Unknown { at_rest: 0.0 }; 2], ..HeadRules::default() };
    for rules in [&rules, &unknown] {
        let fault = refused(&observe(&truth, &still(1.0, 0.0), units, &SCENE), rules);
        assert_eq!(fault, CalibrationFault::RangeTooSmall { axis: "tilt", range: 0.0, expected: rules.least_range[1] });
    }
    // With unknown units the range shows in the end only.
    let fault = refused(&observe(&truth, &still(1.0, 0.1), units, &Scene { points_a_setting: 30, ..SCENE }), &unknown);
    assert!(
        matches!(fault, CalibrationFault::RangeTooSmall { axis: "tilt", range, .. } if (range.to_degrees() - 3.5).abs() < 0.5),
        "{fault}"
    );
}

#[test]
fn targets_that_hold_nothing_are_refused() {
    let truth = crooked(Stacking::TiltOnPan);
    let rules = HeadRules::default();
    let mut observations = radians(&truth, &SCENE);
    assert_eq!(
        refused(&observations[..11], &rules),
        CalibrationFault::TooFew { count: 11, kind: "usable", expected: 12 }
    );
    // All far away: where the axes pass does not show.
    let far = refused(&radians(&truth, &Scene { distances: [100.0, 102.0], ..SCENE }), &rules);
    assert!(
        matches!(far, CalibrationFault::Loose { unit: "mm", distances: [near, _], .. } if (near - 100.0).abs() < 1.0),
        "{far}"
    );
    assert!(far.to_string().contains("nearer targets"), "{far}");
    // Along a line the camera may turn about it.
    for (index, it) in observations.iter_mut().enumerate() {
        it.point_in_world = Point3::new(0.0, 0.01 * index as f64, 1.0);
    }
    assert!(matches!(refused(&observations, &rules), CalibrationFault::OnALine { .. }));
}

#[test]
fn pixels_that_belong_to_no_targets_are_refused() {
    let truth = crooked(Stacking::TiltOnPan);
    let fault = refused(&radians(&truth, &Scene { wrong: 1.0, ..SCENE }), &HeadRules::default());
    assert!(
        matches!(
            fault,
            CalibrationFault::Loose { .. } | CalibrationFault::TooFew { .. } | CalibrationFault::ParallelAxes { .. }
        ),
        "{fault}"
    );
}

#[test]
fn a_tilt_axis_that_is_the_pan_axis_is_refused() {
    let mut truth = crooked(Stacking::TiltOnPan);
    truth.tilt = truth.pan;
    let unknown = HeadRules { units: [UnitsRule::Unknown { at_rest: 0.0 }; 2], ..HeadRules::default() };
    let fault = refused(&radians(&truth, &SCENE), &unknown);
    assert!(matches!(fault, CalibrationFault::ParallelAxes { angle } if angle < 0.1), "{fault}");
}

#[test]
fn what_cannot_be_followed_is_named() {
    let truth = crooked(Stacking::TiltOnPan);
    let observations = radians(&truth, &SCENE);
    let fault_of = |change: &dyn Fn(&mut HeadRules, &mut HeadObservation)| {
        let (mut rules, mut observations) = (HeadRules::default(), observations.clone());
        change(&mut rules, &mut observations[7]);
        refused(&observations, &rules).to_string()
    };
    assert_eq!(
        fault_of(&|it, _| it.loss = Loss::Cauchy { scale: 0.0 }),
        "the scale of the loss is 0, expected a finite number above 0"
    );
    assert_eq!(
        fault_of(&|it, _| it.setting_sigma = -1.0),
        "setting_sigma is -1, expected a finite number of 0 or more"
    );
    let zero = UnitsRule::Known(AxisUnits { rad_per_unit: 0.0, at_rest: 0.0 });
    assert_eq!(fault_of(&|it, _| it.units[1] = zero), "rad_per_unit is 0, expected a finite number other than 0");
    assert_eq!(fault_of(&|_, it| it.pan = f64::NAN), "observation 7: pan is NaN, expected a finite number");
    assert_eq!(fault_of(&|_, it| it.sigma_px = 0.0), "observation 7: sigma_px is 0, expected a finite number above 0");
    assert!(fault_of(&|_, it| it.point_covariance[(1, 1)] = -1.0).starts_with("observation 7: the least eigenvalue"));
    let mut broken = optics(&truth);
    broken.intrinsics.focal[0] = -1.0;
    let fault = calibrate_head(&broken, &observations, &HeadRules::default()).unwrap_err();
    assert_eq!(fault.to_string(), "the optics: focal[0] is -1 px, expected more than 0 px");
}
