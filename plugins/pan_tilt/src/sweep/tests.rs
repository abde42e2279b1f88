//! The node's own part: what it makes of reports and limits. How it goes over settings is tested where that is.

use std::sync::Arc;

use foveate::geometry::pan_tilt::{Axis, AxisUnits, Limits};
use foveate::scene::heads::{Head, Heads};
use foveate_testkit::check_node;
use nalgebra::Vector3;

use super::*;

fn setup(limits: Option<Limits>) -> Setup {
    let mut calibration = foveate_testkit::scene::ring_calibration(3);
    let axis = |along: Vector3<f64>| Axis::through_origin(along).unwrap();
    let head = limits.map(|limits| Head {
        pan: axis(Vector3::y()),
        tilt: axis(Vector3::x()),
        stacking: Default::default(),
        limits,
        units: [AxisUnits::DEGREES; 2],
        zoom: None,
        covariance: None,
    });
    calibration.heads = Heads(head.map(|it| ("ring-1".to_owned(), it)).into_iter().collect());
    Setup { calibration: Arc::new(calibration), camera: Some(CameraId(0)), ..Setup::for_tests() }
}

#[test]
fn node_keeps_the_law() {
    check_node::<SweepNode>("");
    check_node::<SweepNode>("pan_deg = [0, 5]\ntilt_deg = []\nboth_deg = [[1, 2]]\nobservations = 3");
}

#[test]
fn the_defaults_are_the_papers_settings_and_eight_more() {
    let places = SweepSettings::default().places();
    assert_eq!(places.len(), 11 + 7 + 8);
    assert!((places[0][0].to_degrees() + 50.0).abs() < 1e-9 && places[11][1].to_degrees().round() == -20.0);
}

#[test]
fn settings_beyond_the_limits_are_left_out() {
    let narrow = setup(Some(Limits::symmetric(0.6, 0.1)));
    let node = SweepNode::new(SweepSettings::default(), &narrow).ok().unwrap();
    // Pan -30° to 30°, tilt ±5°.
    assert_eq!((node.sweep.progress()[1], node.left_out), (7 + 2, 26 - 9));
    let none = SweepSettings { pan_deg: vec![90.0], tilt_deg: Vec::new(), both_deg: Vec::new(), ..Default::default() };
    let refused = SweepNode::new(none, &narrow).err().unwrap();
    assert!(refused.to_string().contains("no setting within the limits of the head of ring-1"), "{refused}");
    assert_eq!(SweepNode::new(SweepSettings::default(), &setup(None)).ok().unwrap().left_out, 0);
}

#[test]
fn advice_is_a_line_whenever_it_changes() {
    let folder = tempfile::tempdir().unwrap();
    let setup = Setup { out_dir: Some(folder.path().to_owned()), ..setup(None) };
    let mut node = SweepNode::new(SweepSettings::default(), &setup).ok().unwrap();
    let mut tell = |time_s: f64, sweep: &Sweep| node.advice.tell(Time::from_s(time_s), sweep).unwrap();
    let mut sweep = node.sweep.clone();
    sweep.step(0.0, None);
    [0.0, 0.5, 1.5].into_iter().for_each(|it| tell(it, &sweep));
    sweep.step(2.0, Some(SweepSettings::default().places()[0]));
    [2.2, 2.6, 9.0].into_iter().for_each(|it| tell(it, &sweep));
    let advice = std::fs::read_to_string(folder.path().join("sweep.ring-1.txt")).unwrap();
    // One line when the head leaves, one when it waits for the light, none while nothing changes.
    let times: Vec<&str> = advice.lines().map(|it| it.split(" s ").next().unwrap().trim()).collect();
    assert_eq!(times, ["0.0", "2.6"], "{advice}");
    assert!(advice.lines().all(|it| it.contains("1 of 26")), "{advice}");
}

#[test]
fn what_is_out_of_range_and_a_missing_camera_are_refused() {
    let refusal = |change: fn(&mut SweepSettings)| {
        let mut settings = SweepSettings::default();
        change(&mut settings);
        SweepNode::new(settings, &setup(None)).err().and_then(|it| it.setting)
    };
    assert_eq!(refusal(|_| ()), None);
    assert_eq!(refusal(|it| it.both_deg[0][1] = f64::NAN).as_deref(), Some("both_deg"));
    assert_eq!(refusal(|it| it.cells = 10).as_deref(), Some("cells"));
    assert_eq!(refusal(|it| it.file = "a/b.csv".into()).as_deref(), Some("file"));
    assert_eq!(refusal(|it| it.advice = "".into()).as_deref(), Some("advice"));
    assert!(SweepNode::new(SweepSettings::default(), &Setup::for_tests()).is_err_and(|it| it.setting.is_none()));
}
