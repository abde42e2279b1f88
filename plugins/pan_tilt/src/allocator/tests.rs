//! The allocator over targets that walk and heads that turn.

use std::collections::BTreeSet;
use std::sync::Arc;

use foveate::geometry::pan_tilt::{Limits, PanTiltHead, Setting, aim};
use foveate_testkit::check_node;
use foveate_testkit::scene::{camera_ring, ring_calibration};
use nalgebra::{Matrix6, Point3, Vector3};

use super::*;

/// Speed of the heads' axes, and from an assignment to the motion.
const SPEED_RAD_S: f64 = 1.0;
const LATENCY_S: f64 = 0.3;

fn heads(n: usize) -> Vec<(CameraId, PanTiltHead)> {
    heads_within(100.0, n)
}

fn heads_within(pan_deg: f64, n: usize) -> Vec<(CameraId, PanTiltHead)> {
    let limits = Limits::symmetric(pan_deg.to_radians(), 60f64.to_radians());
    let aligned = camera_ring(n).into_iter().map(|camera| PanTiltHead::aligned(camera, limits));
    aligned.enumerate().map(|(place, head)| (CameraId(place as u16), head)).collect()
}

fn settings() -> AllocatorSettings {
    let speed = SPEED_RAD_S.to_degrees();
    AllocatorSettings { pan_deg_s: speed, tilt_deg_s: speed, ..AllocatorSettings::default() }
}

fn target(id: u32, position: Point3<f64>) -> Target {
    Target {
        id: TargetId(id),
        position,
        velocity: Vector3::zeros(),
        covariance: Matrix6::identity() * 1e-4,
        cameras: CameraSet::default(),
        provenance: Provenance::Measured,
    }
}

fn at(time_s: f64, places: &[(u32, [f64; 3])]) -> Targets {
    let list = places.iter().map(|(id, place)| target(*id, Point3::from(*place))).collect();
    Targets { time: Time::from_s(time_s), list }
}

fn of(assignment: &Assignment, id: u32) -> Vec<u16> {
    assignment.list.iter().filter(|it| it.1 == TargetId(id)).map(|it| it.0.0).collect()
}

/// Heads that turn at their speed towards their assigned target, with a delay.
struct Room {
    heads: Vec<(PanTiltHead, Setting, Option<TargetId>)>,
    /// When an assignment was given, and it.
    orders: Vec<(f64, Assignment)>,
}

/// What came of a run.
#[derive(Debug)]
struct Outcome {
    tally: Tally,
    /// Parts of the time, from the second second on, in which a target was in the middle of two heads' pictures.
    seen: Vec<f64>,
}

/// Lets heads follow targets for 40 s.
fn run(
    settings: AllocatorSettings,
    heads: Vec<(CameraId, PanTiltHead)>,
    path: impl Fn(f64) -> Vec<(u32, [f64; 3])>,
) -> Outcome {
    const STEP_S: f64 = 1.0 / 30.0;
    let mut allocator = Allocator::new(settings, heads.clone());
    let mut room = Room {
        heads: heads.into_iter().map(|(_, head)| (head, Setting::default(), None)).collect(),
        orders: Vec::new(),
    };
    let (mut seen, mut steps) = (vec![0u32; path(0.0).len()], 0u32);
    for step in 0..1200 {
        let time_s = f64::from(step) * STEP_S;
        let now = at(time_s, &path(time_s));
        for (place, (_, setting, _)) in room.heads.iter().enumerate() {
            let position = HeadPosition { earliest: now.time, latest: now.time, angles: [setting.pan, setting.tilt] };
            allocator.take_report(&HeadReport {
                camera: CameraId(place as u16),
                link: HeadLink::Ready,
                first: 0,
                events: vec![(now.time, HeadEvent::Position(position))],
            });
        }
        if let Some(assignment) = allocator.update(&now) {
            room.orders.push((time_s, assignment));
        }
        let order = room.orders.iter().rev().find(|it| it.0 <= time_s - LATENCY_S).map(|it| it.1.clone());
        let mut looking = vec![0; now.list.len()];
        for (place, (head, setting, follows)) in room.heads.iter_mut().enumerate() {
            *follows = order.as_ref().and_then(|it| it.target_of(CameraId(place as u16)));
            let Some(index) = now.list.iter().position(|it| Some(it.id) == *follows) else { continue };
            let Ok(there) = aim(head, &now.list[index].position, setting) else { continue };
            let reach = SPEED_RAD_S * STEP_S;
            let turn = |from: f64, to: f64| from + (to - from).clamp(-reach, reach);
            *setting = Setting::new(turn(setting.pan, there.setting.pan), turn(setting.tilt, there.setting.tilt));
            let off =
                head.camera_at(setting).project(&now.list[index].position).map(|it| (it.x - 319.5).hypot(it.y - 239.5));
            looking[index] += u32::from(off.is_some_and(|it| it < 40.0));
        }
        if time_s >= 2.0 {
            steps += 1;
            looking.iter().zip(&mut seen).for_each(|(n, seen)| *seen += u32::from(*n >= 2));
        }
    }
    Outcome { tally: allocator.tally(), seen: seen.iter().map(|it| f64::from(*it) / f64::from(steps)).collect() }
}

/// Two that walk to and fro across each other's way.
fn crossing(time_s: f64) -> Vec<(u32, [f64; 3])> {
    let swing = (0.5 * time_s).sin();
    vec![(1, [1.6 * swing, 0.3, 1.0]), (2, [-1.6 * swing, -0.3, 1.2])]
}

#[test]
fn targets_that_cross_stay_in_two_pictures_and_heads_seldom_change() {
    for n in [4, 6] {
        let smooth = run(settings(), heads(n), crossing);
        assert!(smooth.seen.iter().all(|it| *it > 0.97), "{n} heads: {smooth:?}");
        let eager = AllocatorSettings { switch_cost: 0.0, settle_ms: 0.0, slew_cost_per_s: 0.0, ..settings() };
        let eager = run(eager, heads(n), crossing);
        println!("{n} heads, 40 s: {smooth:?}; without costs of switching {eager:?}");
        assert!(smooth.tally.switches * 3 <= eager.tally.switches, "{n} heads: {smooth:?}, {eager:?}");
    }
}

#[test]
fn three_targets_with_seven_heads_have_two_each_all_the_time() {
    let path = |time_s: f64| {
        let mut places = crossing(time_s);
        places.push((3, [0.8 * (0.3 * time_s).cos(), 1.2 * (0.4 * time_s).sin(), 0.9]));
        places
    };
    let outcome = run(settings(), heads(7), path);
    println!("{outcome:?}");
    assert!(outcome.seen.iter().all(|it| *it > 0.97), "{outcome:?}");
}

#[test]
fn heads_hand_over_targets_that_walk_out_of_their_reach() {
    // All around a circle of 2 m, one on each side of it, within a ring of heads that look no further than 25 degrees to the side.
    let path = |time_s: f64| {
        let (sine, cosine) = (0.35 * time_s).sin_cos();
        vec![(1, [2.0 * cosine, 2.0 * sine, 1.0]), (2, [-2.0 * cosine, -2.0 * sine, 1.0])]
    };
    let outcome = run(settings(), heads_within(25.0, 12), path);
    println!("{outcome:?}");
    assert!(outcome.tally.switches > 4, "{outcome:?}");
    assert!(outcome.seen.iter().all(|it| *it > 0.97), "{outcome:?}");
}

/// Feeds the same targets for some seconds from `from_s` on; the last assignment.
fn feed(allocator: &mut Allocator, from_s: f64, to_s: f64, places: &[(u32, [f64; 3])]) -> Assignment {
    let steps = ((to_s - from_s) * 30.0) as usize;
    let given = (0..steps).filter_map(|step| allocator.update(&at(from_s + step as f64 / 30.0, places)));
    given.last().expect("an assignment")
}

#[test]
fn heads_are_spread_over_targets_two_or_more_for_each_and_look_across() {
    let mut allocator = Allocator::new(settings(), heads(4));
    let assignment = feed(&mut allocator, 0.0, 2.0, &[(4, [0.3, 0.0, 1.0]), (9, [-0.3, 0.0, 1.0])]);
    // Of four around the two, opposite ones tell little together.
    for id in [4, 9] {
        let pair = of(&assignment, id);
        assert_eq!(pair.len(), 2, "{assignment:?}");
        assert_eq!((pair[1] - pair[0]) % 2, 1, "heads opposite each other: {assignment:?}");
    }
}

#[test]
fn assignments_come_at_the_rate_that_was_asked_for_and_at_once() {
    let mut allocator = Allocator::new(AllocatorSettings { rate_hz: 2.0, ..settings() }, heads(3));
    let given: Vec<bool> =
        (0..61).map(|step| allocator.update(&at(f64::from(step) / 30.0, &crossing(0.0))).is_some()).collect();
    assert!(given[0]);
    assert_eq!(given.iter().filter(|it| **it).count(), 5);
}

#[test]
fn a_target_that_is_gone_keeps_its_heads_for_a_while_and_then_gives_them_up() {
    let mut allocator = Allocator::new(settings(), heads(4));
    let both = [(1, [0.5, 0.0, 1.0]), (2, [-0.5, 0.0, 1.0])];
    let before = feed(&mut allocator, 0.0, 3.0, &both);
    let still = feed(&mut allocator, 3.0, 3.8, &both[1..]);
    assert_eq!(still, before);
    let after = feed(&mut allocator, 3.8, 6.0, &both[1..]);
    assert!(of(&after, 1).is_empty(), "{after:?}");
    assert!(of(&after, 2).len() > 2, "{after:?}");
    let nobody = feed(&mut allocator, 6.0, 8.0, &[]);
    assert_eq!(nobody.list, []);
}

#[test]
fn a_head_that_is_away_is_replaced_at_once() {
    // Two for each of two, one to spare.
    let mut allocator = Allocator::new(AllocatorSettings { heads_per_target: 2, ..settings() }, heads(5));
    let both = [(1, [0.5, 0.0, 1.0]), (2, [-0.5, 0.0, 1.0])];
    let before = feed(&mut allocator, 0.0, 3.0, &both);
    let gone = of(&before, 1)[0];
    allocator.take_report(&HeadReport { camera: CameraId(gone), ..HeadReport::default() });
    let after = allocator.update(&at(3.5, &both)).expect("an assignment");
    assert!(!of(&after, 1).contains(&gone));
    assert_eq!([of(&after, 1).len(), of(&after, 2).len()], [2, 2], "{after:?}");
}

#[test]
fn only_the_targets_that_are_asked_for_get_heads() {
    let places = [(3, [0.5, 0.0, 1.0]), (5, [-0.5, 0.0, 1.0]), (8, [0.0, 0.5, 1.0])];
    let ids = |settings: AllocatorSettings| {
        let assignment = feed(&mut Allocator::new(settings, heads(6)), 0.0, 1.0, &places);
        assignment.list.iter().map(|it| it.1.0).collect::<BTreeSet<u32>>().into_iter().collect::<Vec<u32>>()
    };
    assert_eq!(ids(settings()), [3, 5, 8]);
    assert_eq!(ids(AllocatorSettings { only: vec![8, 3, 77], ..settings() }), [3, 8]);
    assert_eq!(ids(AllocatorSettings { most_targets: 1, ..settings() }), [3]);
}

#[test]
fn what_nobody_can_reach_and_what_is_no_number_gets_nobody() {
    let mut allocator = Allocator::new(settings(), heads(3));
    let assignment = feed(&mut allocator, 0.0, 1.0, &[(1, [0.0, 0.0, 300.0]), (2, [f64::NAN, 0.0, 1.0])]);
    assert_eq!(assignment.list, []);
}

#[test]
fn heads_change_over_one_after_another() {
    // Both pairs are to be exchanged; a spare head goes first, so that no target is ever left with fewer than two.
    let mut allocator = Allocator::new(AllocatorSettings { settle_ms: 0.0, ..settings() }, heads(5));
    let mut least = 2;
    for step in 0..600 {
        let time_s = f64::from(step) / 30.0;
        let Some(assignment) = allocator.update(&at(time_s, &crossing(time_s))) else { continue };
        if time_s > 1.0 {
            least = least.min(of(&assignment, 1).len()).min(of(&assignment, 2).len());
        }
    }
    assert_eq!((least, allocator.tally().forced), (2, 0));
    assert!(allocator.tally().switches > 0, "nothing was tested");
}

#[test]
fn node_keeps_its_promises() {
    check_node::<AllocatorNode>("");
    check_node::<AllocatorNode>("cameras = \"head-?\"\nonly = [1, 2]\nrate_hz = 10");
}

#[test]
fn settings_out_of_range_and_cameras_without_heads_are_named() {
    let refusal = |settings: AllocatorSettings| {
        let setup = Setup { calibration: Arc::new(ring_calibration(3)), ..Setup::for_tests() };
        AllocatorNode::new(settings, &setup).err().map(|it| (it.setting.unwrap_or_default(), it.message))
    };
    let (setting, message) = refusal(AllocatorSettings::default()).unwrap();
    assert_eq!(setting, "cameras");
    assert!(message.contains("`ptz-*`"), "{message}");
    let (_, message) = refusal(AllocatorSettings { cameras: "ring-*".to_owned(), ..settings() }).unwrap();
    assert!(message.contains("no head for `ring-1`"), "{message}");
    let (setting, _) = refusal(AllocatorSettings { rate_hz: f64::NAN, ..settings() }).unwrap();
    assert_eq!(setting, "rate_hz");
}
