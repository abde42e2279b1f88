//! The node on arms that are not made of metaballs.

mod people;
mod starts;

use foveate::estimation::random::Random;
use foveate::geometry::Camera;
use foveate::geometry::metaball::{self, Side};
use foveate::prelude::*;
use foveate::scene::{Calibration, LengthUnit, NamedCamera};
use foveate_testkit::check_node;
use nalgebra::{Matrix3, Point2, Point3, UnitQuaternion, Vector3};

use super::track::start::stray;
use super::track::{BodyTracker, Outcome, Rules, rejection};
use super::{BodyFitter, BodySettings, Clicked, Model, SILHOUETTES, SKELETONS, SKIN, Skin};

const TRACKED: In<TrackedSurface> = In::each(0, "tracked");

/// Shoulder, elbow and wrist of an arm that bends.
fn joints(time_s: f64) -> [Point3<f64>; 3] {
    let shoulder = Point3::new(-0.3, 0.05, 1.2);
    let upper = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), 0.2 + 0.3 * time_s) * Vector3::x();
    let hinge = nalgebra::Unit::new_normalize(upper.cross(&Vector3::new(0.0, -0.6, 0.8)));
    let fore = UnitQuaternion::from_axis_angle(&hinge, 0.5 + 0.8 * time_s) * upper;
    let elbow = shoulder + upper * 0.30;
    [shoulder, elbow, elbow + fore * 0.255]
}

/// Points of tapered tubes with elliptical sections about both bones, and of a flat hand, from the front.
fn points(time_s: f64, n: usize) -> TrackedSurface {
    let mut random = Random::new(9);
    let [shoulder, elbow, wrist] = joints(time_s);
    let (upper, fore) = (elbow - shoulder, wrist - elbow);
    let hinge = upper.cross(&fore).normalize();
    let tip = wrist + fore.normalize() * 0.17;
    let parts = [
        (shoulder, elbow, [0.056, 0.044], 1.0),
        (elbow, wrist, [0.044, 0.028], 0.95),
        (wrist, tip, [0.024, 0.016], 0.5),
    ];
    let mut list = Vec::new();
    for id in 0..n as u32 {
        let (from, to, radii, flat) = parts[(random.uniform() * 2.5) as usize];
        let (part, angle) = (random.uniform(), random.uniform_in(0.0, std::f64::consts::TAU));
        let axis = (to - from).normalize();
        let side = axis.cross(&hinge);
        let radius = radii[0] + (radii[1] - radii[0]) * part;
        let out = hinge * (angle.cos() * radius * flat) + side * (angle.sin() * radius / flat);
        let normal = (hinge * (angle.cos() / flat) + side * (angle.sin() * flat)).normalize();
        let off = Vector3::from_fn(|_, _| 3e-4 * random.normal());
        if normal.y > -0.3 {
            continue;
        }
        let position = from + (to - from) * part + out + off;
        let mut cameras = CameraSet::default();
        cameras.insert(CameraId(0));
        list.push(TrackedPoint {
            id,
            position,
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            covariance: Matrix3::identity() * 1e-7,
            normal,
            cameras,
            provenance: Provenance::Measured,
            n_samples: 1,
        });
    }
    TrackedSurface { time: Time::from_s(time_s), list, ended: Vec::new() }
}

fn settings() -> BodySettings {
    let off = [Vector3::new(0.03, -0.02, 0.015), Vector3::new(-0.02, 0.03, 0.02), Vector3::new(0.01, 0.03, -0.025)];
    let clicked = ["right-shoulder", "right-elbow", "right-wrist"].into_iter().zip(joints(0.0)).zip(off);
    BodySettings {
        clicked: clicked
            .map(|((joint, at), off)| Clicked { joint: joint.to_owned(), at: (at + off).coords.into() })
            .collect(),
        shape_frames: 3,
        picture: false,
        ..BodySettings::default()
    }
}

fn rules() -> Rules {
    Rules {
        clicked_m: 0.04,
        points: 500,
        slide_m: 0.015,
        turn_rad_s: 6.0,
        silhouette_px: 1.0,
        shape_frames: 3,
        options: metaball::BodyFitOptions::default(),
    }
}

fn errors_deg(skeleton: &Skeleton, truth: [Point3<f64>; 3]) -> [f64; 3] {
    let at = |name: &str| skeleton.joint(name).unwrap().position;
    let [a, b, c] = ["right-shoulder", "right-elbow", "right-wrist"].map(at);
    let (upper, fore) = (truth[1] - truth[0], truth[2] - truth[1]);
    let elbow = ((b - a).angle(&(c - b)) - upper.angle(&fore)).abs();
    [(b - a).angle(&upper), (c - b).angle(&fore), elbow].map(f64::to_degrees)
}

#[test]
fn node_keeps_its_promises() {
    check_node::<BodyFitter>("height_m = 1.8\nmodel = \"left_arm\"");
    check_node::<BodyFitter>(
        "model = \"person\"\nskin = \"patches\"\nclicked = [{ joint = \"neck\", at = [0, 0, 1.5] }]",
    );
}

#[test]
fn an_arm_that_bends_is_followed_to_two_degrees() {
    let settings = BodySettings { skin: Skin::Isosurface, skin_mm: 15.0, ..settings() };
    let mut bench = NodeBench::<BodyFitter>::new(settings).unwrap();
    for frame in 0..8 {
        let time_s = f64::from(frame) / 25.0;
        bench.feed(&TRACKED, Time::from_s(time_s), points(time_s, 1500)).unwrap();
    }
    let outputs = bench.outputs(&SKELETONS);
    assert_eq!(outputs.len(), 8);
    for (frame, message) in outputs.iter().enumerate() {
        let skeletons = &message.value;
        assert!(skeletons.unmodelled.is_empty(), "frame {frame}: {:?}", skeletons.unmodelled);
        let skeleton = &skeletons.list[0];
        let off = errors_deg(skeleton, joints(frame as f64 / 25.0));
        assert!(off.iter().all(|it| *it < 3.0), "frame {frame}: {off:?} degrees");
        let elbow = skeleton.joint("right-elbow").unwrap();
        assert!((0.01..0.03).contains(&elbow.sigma()), "{} m", elbow.sigma());
        assert_eq!(skeleton.limbs, [LimbDetail::Absent, LimbDetail::Bent, LimbDetail::Absent, LimbDetail::Absent]);
    }
    // At 0.3 rad/s with a lever of 0.3 m, and more at the wrist.
    let wrist = outputs[6].value.list[0].joint("right-wrist").unwrap().velocity.norm();
    assert!((0.1..0.8).contains(&wrist), "{wrist} m/s");
    assert!(bench.outputs(&SKIN)[7].value.n_vertices > 300);
    let figures = bench.finish().unwrap().figures;
    assert!(figures["body.frames"] == 8.0 && figures["body.rms_mm.median"] < 3.0, "{figures:?}");
}

#[test]
fn without_clicks_an_arm_is_found_along_its_points() {
    let settings = BodySettings { clicked: Vec::new(), ..settings() };
    let mut bench = NodeBench::<BodyFitter>::new(settings).unwrap();
    bench.feed(&TRACKED, Time::ZERO, points(0.5, 800)).unwrap();
    let outputs = bench.outputs(&SKELETONS);
    let skeleton = outputs[0].value.list.first().unwrap_or_else(|| panic!("{:?}", outputs[0].value.unmodelled));
    let off = errors_deg(skeleton, joints(0.5));
    assert!(off.iter().all(|it| *it < 6.0), "{off:?} degrees");
}

#[test]
fn an_arm_without_clicks_that_only_fits_as_few_people_are_is_refused_and_two_clicks_count() {
    // A person far smaller than stated: lengths and thicknesses no longer distinguish the shoulder.
    let first = |settings: BodySettings| {
        let mut bench = NodeBench::<BodyFitter>::new(settings).unwrap();
        bench.feed(&TRACKED, Time::ZERO, points(0.0, 800)).unwrap();
        bench.outputs(&SKELETONS).remove(0).value
    };
    let message = first(BodySettings { clicked: Vec::new(), height_m: 1.3, ..settings() });
    assert!(message.list.is_empty(), "{:?}", message.list);
    let reason = &message.unmodelled[0].reason;
    assert!(reason.contains("off the body") || reason.contains("orientation is ambiguous"), "{reason}");
    let mut two = settings();
    two.clicked.truncate(2);
    let message = first(two);
    let skeleton = message.list.first().unwrap_or_else(|| panic!("{:?}", message.unmodelled));
    let off = errors_deg(skeleton, joints(0.0));
    assert!(off.iter().all(|it| *it < 6.0), "{off:?} degrees");
}

#[test]
fn clicks_in_any_other_order_are_told_and_those_of_other_joints_or_units_too() {
    let first = |of: &dyn Fn(&mut Vec<Clicked>)| {
        let mut settings = settings();
        of(&mut settings.clicked);
        let mut bench = NodeBench::<BodyFitter>::new(settings).unwrap();
        bench.feed(&TRACKED, Time::ZERO, points(0.0, 800)).unwrap();
        bench.outputs(&SKELETONS).remove(0).value
    };
    assert_eq!(first(&|_| ()).list.len(), 1);
    for order in [[1, 0, 2], [0, 2, 1], [2, 1, 0], [1, 2, 0], [2, 0, 1]] {
        let message = first(&|clicked| {
            let at = order.map(|it| clicked[it].at);
            clicked.iter_mut().zip(at).for_each(|(it, at)| it.at = at);
        });
        assert!(message.list.is_empty(), "{order:?}: {:?}", message.list);
        let reason = &message.unmodelled[0].reason;
        assert!(reason.contains("look exchanged"), "{order:?}: {reason}");
    }
    let millimetres = first(&|clicked| clicked.iter_mut().for_each(|it| it.at = it.at.map(|it| 1e3 * it)));
    let reason = &millimetres.unmodelled[0].reason;
    assert!(reason.contains("m apart, expected about") && reason.contains("clicks are in metres"), "{reason}");
    let refused = |clicked: Vec<Clicked>| {
        BodyFitter::new(BodySettings { clicked, ..settings() }, &Setup::for_tests()).err().unwrap().message
    };
    let right = settings().clicked;
    let other = refused([&right[..1], &[Clicked { joint: "left-wrist".to_owned(), at: [0.0; 3] }]].concat());
    assert!(other.contains("expected one of the model's: right-shoulder, right-elbow, right-wrist"), "{other}");
    let twice = refused([&right[..], &right[..1]].concat());
    assert!(twice.contains("found right-shoulder twice"), "{twice}");
}

#[test]
fn a_hand_without_points_goes_with_the_forearm() {
    let (body, template) = metaball::arm(Side::Right, 1.75);
    let mut tracker = BodyTracker::new(body, template, rules());
    for frame in 0..4 {
        let time_s = f64::from(frame) / 25.0;
        let [shoulder, elbow, wrist] = joints(time_s);
        let mut surface = points(time_s, 1500);
        // The sleeve ends a little before the wrist.
        surface.list.retain(|it| (it.position - wrist).dot(&(wrist - elbow).normalize()) < -0.02);
        let off = Vector3::new(0.02, -0.02, 0.02);
        let clicks = [(3, shoulder + off), (5, elbow - off), (7, wrist + off)].into_iter().collect();
        let Outcome::Followed(frame) = tracker.track(&surface, &clicks, &[]) else { panic!("no body at {time_s} s") };
        let bones = &tracker.body().skeleton;
        let hand = bones.find("hand_right").unwrap();
        assert!(frame.unsupported.contains(&hand));
        let bent: Vec<f64> = bones.angles_of(hand).map(|it| frame.fit.state.angles[it].abs()).collect();
        assert!(bent.iter().all(|it| *it < 0.3), "{bent:?} rad at {time_s} s");
    }
}

/// Which pixels of a camera show the tapered tubes of the arm at one time.
fn silhouette(camera: &Camera, id: u16, time_s: f64) -> Silhouette {
    let [shoulder, elbow, wrist] = joints(time_s);
    let tubes = [(shoulder, elbow, [0.056, 0.044]), (elbow, wrist, [0.044, 0.028])];
    let [width, height] = camera.image_size;
    let is_body = |x: u32, y: u32| {
        let Some(ray) = camera.ray(&Point2::new(f64::from(x), f64::from(y))) else { return false };
        let direction = ray.direction.into_inner();
        tubes.iter().any(|(from, to, [first, last])| {
            (0..=40).any(|it| {
                let part = f64::from(it) / 40.0;
                let off = from + (to - from) * part - ray.origin;
                off.cross(&direction).norm() < first + (last - first) * part
            })
        })
    };
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let confidence: Vec<u8> = pixels.map(|(x, y)| if is_body(x, y) { 255 } else { 0 }).collect();
    let n_body = confidence.iter().filter(|it| **it > 0).count() as u32;
    Silhouette { camera: CameraId(id), width, height, n_body, confidence, ..Silhouette::default() }
}

#[test]
fn silhouettes_tell_where_a_forearm_without_points_is() {
    let eyes = [Point3::new(1.6, -1.2, 1.4), Point3::new(0.1, -2.0, 1.2), Point3::new(-0.4, -0.8, 2.9)];
    let cameras = eyes.map(|it| Camera::look_at(it, Point3::new(-0.05, 0.0, 1.2), [240, 180], 420.0));
    let named = |(id, camera): (usize, &Camera)| NamedCamera { name: format!("cam-{id}"), camera: camera.clone() };
    let list = cameras.iter().enumerate().map(named).collect();
    let calibration = Calibration::new(list, LengthUnit::Metre, String::new()).unwrap();
    let setup = Setup { calibration: calibration.into(), ..Setup::for_tests() };
    let forearm_off = |with_silhouettes: bool| {
        let mut bench = NodeBench::<BodyFitter>::with_setup(settings(), &setup).unwrap();
        let mut off = 0.0_f64;
        for frame in 0..3 {
            let time = Time::from_s(f64::from(frame) / 25.0);
            let [_, elbow, _] = joints(time.as_s());
            let mut surface = points(time.as_s(), 1500);
            // Up to the elbow, and a little beyond.
            surface.list.retain(|it| it.position.x < elbow.x + 0.01);
            if with_silhouettes {
                for (id, camera) in cameras.iter().enumerate() {
                    bench.feed(&SILHOUETTES, time, silhouette(camera, id as u16, time.as_s())).unwrap();
                }
            }
            bench.feed(&TRACKED, time, surface).unwrap();
            let messages = bench.outputs(&SKELETONS);
            let last = &messages.last().unwrap().value;
            off = last.list.first().map_or(90.0, |it| errors_deg(it, joints(time.as_s()))[1]);
        }
        let report = bench.finish().unwrap();
        let rays = report.figures.get("body.silhouette_rays").copied();
        assert_eq!(rays.is_some_and(|it| it > 60.0), with_silhouettes, "{rays:?}");
        off
    };
    let (with, without) = (forearm_off(true), forearm_off(false));
    assert!(with < 4.0 && with < 0.5 * without, "{with} degrees with silhouettes, {without} without");
}

#[test]
fn what_is_no_arm_is_refused_with_the_reason() {
    let mut bench = NodeBench::<BodyFitter>::new(settings()).unwrap();
    let mut wall = points(0.0, 900);
    for (number, point) in wall.list.iter_mut().enumerate() {
        point.position = Point3::new(0.02 * (number % 40) as f64, 0.3, 1.0 + 0.02 * (number / 40) as f64);
    }
    let mut few = points(0.0, 900);
    few.list.truncate(12);
    for (second, surface) in [wall, few].into_iter().enumerate() {
        let time = Time::from_s(second as f64);
        bench.feed(&TRACKED, time, TrackedSurface { time, ..surface }).unwrap();
    }
    let outputs = bench.outputs(&SKELETONS);
    for message in &outputs {
        assert!(message.value.list.is_empty() && message.value.unmodelled.len() == 1);
    }
    assert!(outputs[1].value.unmodelled[0].reason.contains("12 points, expected 20"), "{:?}", outputs[1].value);
    let figures = bench.finish().unwrap().figures;
    assert_eq!([figures["body.refused"], figures["body.refused.few_points"]], [2.0, 1.0]);
}

#[test]
fn unknown_joints_are_refused() {
    let clicked = vec![Clicked { joint: "left-antenna".to_owned(), at: [0.0; 3] }];
    let error =
        BodyFitter::new(BodySettings { clicked, ..BodySettings::default() }, &Setup::for_tests()).err().unwrap();
    assert!(error.message.contains("left-antenna") && error.message.contains("right-elbow"), "{}", error.message);
}
