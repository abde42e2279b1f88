//! The node on voxels of a body made of tubes.

use foveate::prelude::*;
use foveate_testkit::check_node;
use nalgebra::{Point3, Vector3};

use super::node::{HAND_LEFT, HEAD, SKELETONS, SMOOTHED, VOXELS};
use super::{BodyTrackerNode, BodyTrackerSettings, MarkOn};

/// Tubes: ends and radius [m].
fn person(at: f64, raise: f64) -> Vec<([Point3<f64>; 2], f64)> {
    let p = |x: f64, y: f64, z: f64| Point3::new(x, at + y, z);
    let mut tubes =
        vec![([p(0.0, 0.0, 1.62), p(0.0, 0.0, 1.65)], 0.10), ([p(0.0, 0.0, 1.40), p(0.0, 0.0, 1.60)], 0.055)];
    for side in [-1.0, 1.0] {
        let elbow = p(0.0, side * (0.18 + 0.29 * raise.cos()), 1.42 - 0.29 * raise.sin());
        let hand = elbow + Vector3::new(0.22, side * 0.2, 0.12);
        tubes.push(([p(0.0, side * 0.08, 0.95), p(0.0, side * 0.09, 1.36)], 0.105));
        tubes.push(([p(0.0, 0.0, 1.42), p(0.0, side * 0.18, 1.42)], 0.06));
        tubes.push(([p(0.0, side * 0.18, 1.42), elbow], 0.046));
        tubes.push(([elbow, hand], 0.04));
        let knee = p(0.10, side * 0.16, 0.50);
        let ankle = p(0.0, side * 0.18, 0.08);
        tubes.push(([p(0.0, side * 0.09, 0.90), knee], 0.075));
        tubes.push(([knee, ankle], 0.055));
        tubes.push(([ankle, ankle + Vector3::x() * 0.16], 0.04));
    }
    tubes
}

fn voxels_of(tubes: &[([Point3<f64>; 2], f64)], time_s: f64) -> Voxels {
    let size = 0.04;
    let mut voxels = Voxels {
        time: Time::from_s(time_s),
        size,
        origin: Point3::new(-1.0, -1.5, 0.0),
        cells: [50, 75, 50],
        ..Voxels::default()
    };
    let near = |place: &Point3<f64>| {
        tubes.iter().any(|([a, b], radius)| {
            let along = b - a;
            let share = ((place - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (place - (a + along * share)).norm() < *radius
        })
    };
    for z in 0..50_u16 {
        for y in 0..75_u16 {
            for x in 0..50_u16 {
                if near(&voxels.centre([x, y, z])) {
                    voxels.push(&Voxel { index: [x, y, z], ..Voxel::default() });
                }
            }
        }
    }
    voxels
}

fn bench() -> NodeBench<BodyTrackerNode> {
    NodeBench::new(BodyTrackerSettings::default()).unwrap()
}

#[test]
fn node_keeps_the_law() {
    check_node::<BodyTrackerNode>("");
    check_node::<BodyTrackerNode>("stature_m = 1.6\ncrust_share = 0.75\nmost = 2");
}

#[test]
fn a_person_of_tubes_is_found_with_all_parts_and_its_joints_are_where_the_tubes_meet() {
    let mut bench = bench();
    for frame in 0..12 {
        let time = f64::from(frame) / 30.0;
        let raise = 0.3 + 0.02 * f64::from(frame);
        bench.feed(&VOXELS, Time::from_s(time), voxels_of(&person(0.1, raise), time)).unwrap();
    }
    let outputs = bench.outputs(&SKELETONS);
    assert_eq!(outputs.len(), 12);
    let last = &outputs[11].value;
    assert_eq!((last.list.len(), last.unmodelled.len()), (1, 0));
    let body = &last.list[0];
    assert_eq!(body.parts.len(), 10, "{:?}", body.limbs);
    let raise: f64 = 0.3 + 0.02 * 11.0;
    let expected = [
        ("head", Point3::new(0.0, 0.1, 1.635)),
        ("left-shoulder", Point3::new(0.0, 0.28, 1.42)),
        ("right-shoulder", Point3::new(0.0, -0.08, 1.42)),
        ("left-elbow", Point3::new(0.0, 0.28 + 0.29 * raise.cos(), 1.42 - 0.29 * raise.sin())),
        ("right-elbow", Point3::new(0.0, -0.08 - 0.29 * raise.cos(), 1.42 - 0.29 * raise.sin())),
        ("left-knee", Point3::new(0.10, 0.26, 0.50)),
        ("right-knee", Point3::new(0.10, -0.06, 0.50)),
    ];
    for (name, place) in expected {
        let off = (body.joint(name).unwrap().position - place).norm();
        assert!(off < 0.07, "{name} is {:.0} mm off", off * 1e3);
    }
    // Feet and knees tell the front, so left is left.
    assert!(body.facing > 0.3, "{}", body.facing);
    let heads = bench.outputs(&HEAD);
    let head = &heads[11].value.list;
    assert_eq!((head.len(), head[0].id, head[0].provenance), (1, TargetId(0), Provenance::Measured));
    assert_eq!(bench.outputs(&HAND_LEFT)[11].value.list.len(), 1);
    let report = bench.finish().unwrap();
    assert_eq!(report.figures["voxel_body.found"], 1.0);
}

#[test]
fn smoothed_bodies_come_later_and_lie_no_farther_off() {
    let settings = BodyTrackerSettings { smooth_ms: 200.0, ..BodyTrackerSettings::default() };
    let mut bench = NodeBench::<BodyTrackerNode>::new(settings).unwrap();
    let raise = |frame: i32| 0.3 + 0.05 * f64::from(frame);
    for frame in 0..16 {
        let time = f64::from(frame) / 30.0;
        bench.feed(&VOXELS, Time::from_s(time), voxels_of(&person(0.1, raise(frame)), time)).unwrap();
    }
    let (plain, smoothed) = (bench.outputs(&SKELETONS), bench.outputs(&SMOOTHED));
    assert_eq!((plain.len(), smoothed.len()), (16, 10));
    let off = |outputs: &[Stamped<std::sync::Arc<Skeletons>>]| {
        let error = |frame: usize| {
            let raise = raise(frame as i32);
            let elbow = Point3::new(0.0, 0.28 + 0.29 * raise.cos(), 1.42 - 0.29 * raise.sin());
            (outputs[frame].value.list[0].joint("left-elbow").unwrap().position - elbow).norm()
        };
        (4..10).map(error).sum::<f64>()
    };
    assert_eq!(plain[7].value.time, smoothed[7].value.time);
    assert!(off(&smoothed) < off(&plain) + 0.02, "{} {}", off(&smoothed), off(&plain));
}

#[test]
fn a_box_is_no_body_and_is_named() {
    let mut bench = bench();
    let a_box: Vec<([Point3<f64>; 2], f64)> = (0..5)
        .map(|it| f64::from(it) * 0.1)
        .map(|y| ([Point3::new(0.0, y, 0.3), Point3::new(0.0, y, 0.9)], 0.2))
        .collect();
    bench.feed(&VOXELS, Time::ZERO, voxels_of(&a_box, 0.0)).unwrap();
    let outputs = bench.outputs(&SKELETONS);
    let message = &outputs[0].value;
    assert!(message.list.is_empty());
    assert!(message.unmodelled[0].reason.contains("no head"), "{}", message.unmodelled[0].reason);
    let report = bench.finish().unwrap();
    assert!(report.remarks.iter().any(|it| it.contains("no head")), "{:?}", report.remarks);
}

#[test]
fn two_people_are_two_bodies_and_who_leaves_is_let_go() {
    let mut bench = bench();
    for frame in 0..40 {
        let time = f64::from(frame) / 30.0;
        let mut tubes = person(-0.75, 0.5);
        if frame < 10 {
            tubes.extend(person(0.75, 0.5));
        }
        let mut message = voxels_of(&tubes, time);
        // Each a component of its own.
        let moved: Vec<Voxel> = message.iter().collect();
        message.voxels.clear();
        for mut voxel in moved {
            voxel.component = u16::from(message.centre(voxel.index).y > 0.0);
            message.push(&voxel);
        }
        bench.feed(&VOXELS, Time::from_s(time), message).unwrap();
    }
    let outputs = bench.outputs(&SKELETONS);
    let ids = |frame: usize| outputs[frame].value.list.iter().map(|it| it.id).collect::<Vec<_>>();
    assert_eq!(ids(0), [0, 1]);
    assert_eq!(ids(39).len(), 1);
    assert!(outputs[12].value.list.iter().any(|it| it.joints.iter().all(|it| it.provenance != Provenance::Measured)));
    let report = bench.finish().unwrap();
    assert_eq!([report.figures["voxel_body.found"], report.figures["voxel_body.lost"]], [2.0, 1.0]);
}

#[test]
fn no_voxels_are_no_bodies() {
    let mut bench = bench();
    bench.feed(&VOXELS, Time::ZERO, Voxels::default()).unwrap();
    let outputs = bench.outputs(&SKELETONS);
    let message = &outputs[0].value;
    assert!(message.list.is_empty() && message.unmodelled.is_empty());
}

#[test]
fn settings_that_make_no_sense_are_refused() {
    let refused = |settings: BodyTrackerSettings| {
        NodeBench::<BodyTrackerNode>::new(settings).err().and_then(|it| it.setting).unwrap_or_default()
    };
    let crust = BodyTrackerSettings { crust_mm: [150.0, 60.0], ..BodyTrackerSettings::default() };
    assert_eq!(refused(crust), "crust_mm");
    let volumes = BodyTrackerSettings { least_l: 20.0, most_l: 10.0, ..BodyTrackerSettings::default() };
    assert_eq!(refused(volumes), "most_l");
    let mark = MarkOn { target: 3, part: "left-foot".to_owned(), at: [0.0; 3], sigma_mm: 30.0 };
    let marks = BodyTrackerSettings { marks: vec![mark], ..BodyTrackerSettings::default() };
    assert_eq!(refused(marks), "marks");
}

/// All of a grid, one component.
fn filled(cells: [u16; 3], size: f64) -> Voxels {
    let mut voxels = Voxels { size, cells: cells.map(u32::from), ..Voxels::default() };
    for (z, y) in (0..cells[2]).flat_map(|z| (0..cells[1]).map(move |y| (z, y))) {
        (0..cells[0]).for_each(|x| voxels.push(&Voxel { index: [x, y, z], ..Voxel::default() }));
    }
    voxels.components = vec![VoxelComponent {
        n_voxels: voxels.len() as u32,
        centroid: Point3::origin(),
        min: [0; 3],
        max: cells.map(|it| it - 1),
        is_cut_off: false,
        target: None,
    }];
    voxels
}

#[test]
fn a_hull_of_a_whole_room_is_left_out_with_its_volume() {
    let mut bench = bench();
    bench.feed(&VOXELS, Time::ZERO, filled([100, 100, 100], 0.03)).unwrap();
    let message = &bench.outputs(&SKELETONS)[0].value;
    assert!(message.list.is_empty() && message.unmodelled.len() == 1);
    let reason = &message.unmodelled[0].reason;
    assert!(reason.contains("27000 l, expected `most_l` = 1500 l at most"), "{reason}");
    let report = bench.finish().unwrap();
    assert!(report.remarks.iter().any(|it| it.contains("more than a heap of bodies")), "{:?}", report.remarks);
}

#[test]
fn voxels_that_are_too_many_are_merged_where_half_of_them_are_there() {
    use super::bounded::{Bounded, MOST_VOXELS};
    let mut fine = filled([100, 100, 60], 0.01);
    let mut bounded = Bounded::default();
    bounded.take(&fine, 10.0);
    assert_eq!((bounded.merged(), bounded.cubes(&fine).indices.len(), bounded.cubes(&fine).size), (2, 75_000, 0.02));
    // A layer at the top that is half a cube thick stays, one that is three of eight does not.
    assert!(fine.len() > MOST_VOXELS);
    for (x, y) in (0..100).flat_map(|x| (0..100).map(move |y| (x, y))) {
        let is_kept = x < 50 || (x % 2, y % 2) != (1, 1);
        if is_kept {
            fine.push(&Voxel { index: [x, y, 60], ..Voxel::default() });
        }
    }
    bounded.take(&fine, 10.0);
    assert_eq!(bounded.cubes(&fine).indices.iter().filter(|it| it[2] == 30).count(), 25 * 50);
    bounded.take(&filled([10, 10, 10], 0.01), 10.0);
    assert_eq!((bounded.merged(), bounded.cubes(&fine).indices.len()), (1, 1000));
}

#[test]
fn a_child_that_is_smaller_than_a_body_is_told_and_a_toy_is_not() {
    let outcome = |scale: f64| {
        let mut bench = bench();
        let small = |([a, b], radius): ([Point3<f64>; 2], f64)| ([a * scale, b * scale], radius * scale);
        let mut voxels = voxels_of(&person(0.0, 0.3).into_iter().map(small).collect::<Vec<_>>(), 0.0);
        voxels.components = vec![VoxelComponent {
            n_voxels: voxels.len() as u32,
            centroid: Point3::new(0.0, 0.0, scale),
            min: [0; 3],
            max: [49; 3],
            is_cut_off: false,
            target: None,
        }];
        for frame in 0..4 {
            let time = f64::from(frame) / 30.0;
            bench.feed(&VOXELS, Time::from_s(time), Voxels { time: Time::from_s(time), ..voxels.clone() }).unwrap();
        }
        let report = bench.finish().unwrap();
        (voxels.volume(), report.remarks.iter().any(|it| it.contains("for a child set a smaller one")))
    };
    let (volume, is_reported) = outcome(0.55);
    assert!((0.006..0.02).contains(&volume) && is_reported, "{volume}");
    let (volume, is_reported) = outcome(0.25);
    assert!(volume < 0.004 && !is_reported, "{volume}");
}
