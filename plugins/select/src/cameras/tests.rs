//! Which cameras are picked, and when that changes.

use std::sync::Arc;

use foveate_testkit::check_node;
use foveate_testkit::scene::{camera_ring, ring_calibration};
use nalgebra::{Matrix6, Point3, Vector3};

use super::*;

fn target(id: u32, place: [f64; 3], cameras: &[u16]) -> Target {
    Target {
        id: TargetId(id),
        position: Point3::from(place),
        velocity: Vector3::zeros(),
        covariance: Matrix6::identity() * 1e-4,
        cameras: cameras.iter().copied().map(CameraId).collect(),
        provenance: Provenance::Measured,
    }
}

fn chooser(settings: CamerasSettings, n: usize) -> Chooser {
    let cameras = camera_ring(n).into_iter().zip(0..).map(|(camera, id)| (CameraId(id), camera));
    Chooser::new(settings, cameras.collect())
}

/// Feeds the same targets, seen by all of `witnesses`, for two seconds from `from_s` on; the last choice.
fn feed(chooser: &mut Chooser, from_s: f64, places: &[[f64; 3]], witnesses: &[u16]) -> Vec<u16> {
    let list: Vec<Target> = places.iter().zip(1..).map(|(place, id)| target(id, *place, witnesses)).collect();
    let at = |step: u32| Targets { time: Time::from_s(from_s + f64::from(step) / 60.0), list: list.clone() };
    let last = (0..120).filter_map(|step| chooser.update(&at(step))).last().expect("a choice");
    last.cameras.iter().map(|it| it.0).collect()
}

const ALL: [u16; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];
const MIDDLE: [f64; 3] = [0.1, 0.05, 1.0];

#[test]
fn without_targets_all_are_chosen() {
    assert_eq!(feed(&mut chooser(CamerasSettings::default(), 12), 0.0, &[], &[]), ALL);
}

#[test]
fn a_few_that_look_across_are_chosen() {
    for (least, most) in [(2, 2), (3, 4), (5, 6)] {
        let settings = CamerasSettings { least, most, ..CamerasSettings::default() };
        let chosen = feed(&mut chooser(settings, 12), 0.0, &[MIDDLE], &ALL);
        assert!((least as usize..=most as usize).contains(&chosen.len()), "{chosen:?}");
        let cameras = camera_ring(12);
        let line = |it: &u16| (cameras[usize::from(*it)].centre() - Point3::from(MIDDLE)).normalize();
        let sharpest = chosen.iter().flat_map(|a| chosen.iter().map(move |b| line(a).cross(&line(b)).norm()));
        assert!(sharpest.fold(0.0, f64::max) > 60f64.to_radians().sin(), "{chosen:?}");
    }
}

#[test]
fn a_camera_that_does_not_see_the_target_is_left_out() {
    let open: Vec<u16> = ALL.into_iter().filter(|it| it % 2 == 0).collect();
    let chosen = feed(&mut chooser(CamerasSettings::default(), 12), 0.0, &[MIDDLE], &open);
    assert!(chosen.iter().all(|it| open.contains(it)), "{chosen:?}");
    // Where two alone see it, others are taken all the same: they may see it again.
    let chosen = feed(&mut chooser(CamerasSettings::default(), 12), 0.0, &[MIDDLE], &[3, 6]);
    assert!(chosen.len() >= 3 && chosen.contains(&3) && chosen.contains(&6), "{chosen:?}");
}

#[test]
fn targets_that_are_near_each_other_share_cameras() {
    let near: Vec<[f64; 3]> = (0..8).map(|it| [0.05 * f64::from(it), 0.0, 1.0]).collect();
    let chosen = feed(&mut chooser(CamerasSettings::default(), 12), 0.0, &near, &ALL);
    assert!(chosen.len() <= 4, "{chosen:?}");
}

#[test]
fn a_target_out_of_most_pictures_has_those_that_show_it() {
    // 1.9 m to the side: the near cameras look past it.
    let place = Point3::new(1.9, 0.0, 0.3);
    let cameras = camera_ring(12);
    let can: Vec<u16> = ALL.into_iter().filter(|it| cameras[usize::from(*it)].sees(&place).is_some()).collect();
    assert!(can.len() < 12 && can.len() >= 3, "{can:?}");
    let chosen = feed(&mut chooser(CamerasSettings::default(), 12), 0.0, &[place.into()], &can);
    assert!(chosen.len() >= 3 && chosen.iter().all(|it| can.contains(it)), "{chosen:?}");
    // And one that nobody sees has nobody, which is counted.
    let mut chooser = chooser(CamerasSettings::default(), 12);
    assert!(feed(&mut chooser, 0.0, &[[0.0, 0.0, 40.0]], &[]).is_empty());
    assert_eq!(chooser.tally().unseen, chooser.tally().targets);
}

#[test]
fn a_choice_stays_while_its_targets_hardly_move_and_follows_one_that_walks() {
    let walk = |settings: CamerasSettings, radius: f64| {
        let mut chooser = chooser(settings, 12);
        let mut counts = Vec::new();
        for step in 0..1200 {
            let (sine, cosine) = (0.005 * f64::from(step)).sin_cos();
            let list = vec![target(1, [radius * cosine, radius * sine, 1.0], &ALL)];
            let time = Time::from_s(f64::from(step) / 60.0);
            counts.extend(chooser.update(&Targets { time, list }).map(|it| it.cameras.len()));
        }
        assert!(counts.iter().all(|it| (3..=4).contains(it)), "{counts:?}");
        chooser.tally().changes
    };
    let free = CamerasSettings { change_cost: 0.0, ..CamerasSettings::default() };
    assert_eq!(walk(CamerasSettings::default(), 0.01), 0);
    let (steady, restless) = (walk(CamerasSettings::default(), 0.9), walk(free, 0.9));
    assert!(steady > 0 && 3 * steady < 2 * restless, "{steady} changes, {restless} at no cost");
}

#[test]
fn choices_are_made_at_the_rate_that_was_asked_for_and_what_is_no_number_is_passed_over() {
    let mut chooser = chooser(CamerasSettings { rate_hz: 2.0, ..CamerasSettings::default() }, 4);
    let list = vec![target(1, [f64::NAN, 0.0, 0.0], &[0, 77])];
    let made: usize = (0..61)
        .filter(|step| {
            let time = Time::from_s(f64::from(*step) / 30.0);
            chooser.update(&Targets { time, list: list.clone() }).is_some_and(|it| it.cameras.len() == 4)
        })
        .count();
    assert_eq!(made, 5);
}

#[test]
fn node_keeps_its_promises() {
    check_node::<CamerasNode>("");
    check_node::<CamerasNode>("cameras = \"wide-*\"\nleast = 2\nmost = 3");
}

#[test]
fn settings_out_of_range_are_named() {
    let setting = |settings: CamerasSettings| {
        let setup = Setup { calibration: Arc::new(ring_calibration(3)), ..Setup::for_tests() };
        CamerasNode::new(settings, &setup).err().and_then(|it| it.setting)
    };
    assert_eq!(setting(CamerasSettings::default()), None);
    assert_eq!(setting(CamerasSettings { least: 5, ..Default::default() }).as_deref(), Some("most"));
    assert_eq!(setting(CamerasSettings { rim_cost: f64::NAN, ..Default::default() }).as_deref(), Some("rim_cost"));
    assert_eq!(setting(CamerasSettings { cameras: "no-*".into(), ..Default::default() }).as_deref(), Some("cameras"));
}
