//! Whole people of tubes: rings of elliptical sections about straight bones, which no metaball made.

use super::*;

/// Joints in the order of [`BODY_JOINTS`] of a person of `height` [m] who faces x, mid-step, forearms raised.
fn joints(height: f64) -> Vec<Point3<f64>> {
    let left_right = |x: f64, y: f64, z: f64| [Point3::new(x, y, z), Point3::new(x, -y, z)];
    let mut places = vec![Point3::new(0.0, 0.0, 0.935), Point3::new(0.0, 0.0, 0.87)];
    places.extend(left_right(0.0, 0.105, 0.80));
    places.extend([Point3::new(0.06, 0.13, 0.63), Point3::new(-0.06, -0.13, 0.63)]);
    places.extend([Point3::new(0.19, 0.12, 0.56), Point3::new(-0.02, -0.12, 0.49)]);
    places.extend(left_right(0.0, 0.05, 0.525));
    places.extend([Point3::new(-0.04, 0.05, 0.285), Point3::new(0.09, -0.05, 0.30)]);
    places.extend([Point3::new(-0.14, 0.05, 0.06), Point3::new(0.05, -0.05, 0.055)]);
    places.into_iter().map(|it| it * height).collect()
}

/// Points all around a person of `height`, `girth` times as thick as usual.
fn surface(height: f64, girth: f64, time_s: f64) -> TrackedSurface {
    let at = joints(height);
    let h = height;
    let up = |it: Point3<f64>, by: f64| it + Vector3::z() * (by * h);
    let [hips, shoulders] = [(8, 9), (2, 3)].map(|(a, b)| nalgebra::center(&at[a], &at[b]));
    let toes = |ankle: usize| at[ankle] + Vector3::new(0.11, 0.0, -0.03) * h;
    let tip = |elbow: usize, wrist: usize| at[wrist] + (at[wrist] - at[elbow]).normalize() * (0.1 * h);
    // Ends of the bone, half widths at both ends over the height, width across the body over that to the front.
    let tubes = [
        (up(hips, -0.05), up(shoulders, 0.01), [0.085, 0.07], 1.3),
        (shoulders, at[1], [0.034, 0.032], 1.0),
        (up(at[0], -0.06), up(at[0], 0.06), [0.044, 0.04], 0.9),
        (at[2], at[4], [0.033, 0.026], 1.0),
        (at[3], at[5], [0.033, 0.026], 1.0),
        (at[4], at[6], [0.026, 0.018], 1.0),
        (at[5], at[7], [0.026, 0.018], 1.0),
        (at[6], tip(4, 6), [0.018, 0.012], 1.3),
        (at[7], tip(5, 7), [0.018, 0.012], 1.3),
        (at[8], at[10], [0.052, 0.036], 1.0),
        (at[9], at[11], [0.052, 0.036], 1.0),
        (at[10], at[12], [0.034, 0.022], 1.0),
        (at[11], at[13], [0.034, 0.022], 1.0),
        (at[12], toes(12), [0.024, 0.016], 1.1),
        (at[13], toes(13), [0.024, 0.016], 1.1),
    ];
    let areas = tubes.map(|(from, to, widths, _)| (to - from).norm() * (widths[0] + widths[1]));
    let total: f64 = areas.iter().sum();
    let mut random = Random::new(17);
    let mut list = Vec::new();
    for id in 0..2600 {
        let mut left = random.uniform() * total;
        let number = areas.iter().position(|it| {
            left -= it;
            left < 0.0
        });
        let (from, to, widths, across) = tubes[number.unwrap_or(0)];
        let (part, angle) = (random.uniform(), random.uniform_in(0.0, std::f64::consts::TAU));
        let axis = (to - from).normalize();
        let side = (Vector3::y() - axis * axis.y).normalize();
        let front = side.cross(&axis);
        let radius = (widths[0] + (widths[1] - widths[0]) * part) * h * girth;
        let out = side * (angle.cos() * radius * across) + front * (angle.sin() * radius / across.sqrt());
        let off = Vector3::from_fn(|_, _| 3e-4 * random.normal());
        list.push(TrackedPoint {
            id,
            position: from + (to - from) * part + out + off,
            velocity: Vector3::zeros(),
            acceleration: Vector3::zeros(),
            covariance: Matrix3::identity() * 1e-7,
            normal: out.normalize(),
            cameras: [CameraId(0), CameraId(1)].into_iter().collect(),
            provenance: Provenance::Measured,
            n_samples: 1,
        });
    }
    TrackedSurface { time: Time::from_s(time_s), list, ended: Vec::new() }
}

/// The message of a person whose joints, `named` by their places, are clicked 30 mm off.
fn fitted(height: f64, girth: f64, named: [usize; 14]) -> Skeletons {
    let mut random = Random::new(3);
    let mut off = || Vector3::from_fn(|_, _| random.normal()).normalize() * 0.03;
    let clicked = joints(height)
        .into_iter()
        .zip(named)
        .map(|(at, name)| Clicked { joint: BODY_JOINTS[name].to_owned(), at: (at + off()).coords.into() });
    let settings = BodySettings {
        model: Model::Person,
        clicked: clicked.collect(),
        points: 1500,
        picture: false,
        ..BodySettings::default()
    };
    let mut bench = NodeBench::<BodyFitter>::new(settings).unwrap();
    bench.feed(&TRACKED, Time::ZERO, surface(height, girth, 0.0)).unwrap();
    let mut outputs = bench.outputs(&SKELETONS);
    std::sync::Arc::unwrap_or_clone(outputs.remove(0).value)
}

const AS_THEY_ARE: [usize; 14] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13];
const EXCHANGED: [usize; 14] = [0, 1, 3, 2, 5, 4, 7, 6, 9, 8, 11, 10, 13, 12];

#[test]
fn people_of_tubes_are_fitted_from_clicked_joints() {
    // The second is fitted with shanks too short for it at first.
    for (height, girth) in [(1.68, 1.05), (1.65, 1.2)] {
        let message = fitted(height, girth, AS_THEY_ARE);
        let skeleton = message.list.first().unwrap_or_else(|| panic!("{height} m: {:?}", message.unmodelled));
        let truth = joints(height);
        let at = |it: usize| skeleton.joint(BODY_JOINTS[it]).unwrap().position;
        for [a, b] in [[2, 4], [4, 6], [3, 5], [5, 7], [8, 10], [10, 12], [9, 11], [11, 13]] {
            let off = (at(b) - at(a)).angle(&(truth[b] - truth[a])).to_degrees();
            assert!(off < 6.0, "{height} m, {}: {off} degrees", BODY_JOINTS[b]);
        }
    }
}

#[test]
fn people_whose_left_and_right_are_exchanged_are_told_and_giants_are_none() {
    let reason = |message: Skeletons| {
        assert!(message.list.is_empty(), "{:?}", message.list[0].joints);
        message.unmodelled[0].reason.clone()
    };
    let exchanged = reason(fitted(1.75, 1.0, EXCHANGED));
    assert!(exchanged.contains("left and right") && exchanged.contains("exchanged"), "{exchanged}");
    let giant = reason(fitted(2.6, 1.0, AS_THEY_ARE));
    assert!(giant.contains("standard deviations") || giant.contains("off the body"), "{giant}");
}

#[test]
fn sizes_that_few_people_have_are_refused_with_the_limit_that_holds_for_them() {
    let reason_of =
        |(body, template): (metaball::Body, metaball::State), segment: &str, what: &'static str, sigmas: f64| {
            let observed: Vec<_> = points(0.0, 400)
                .list
                .iter()
                .map(|it| metaball::BodyObservation::Point { at: it.position, sigma_m: 1e-3, segment: None })
                .collect();
            let options =
                metaball::BodyFitOptions { rough: false, max_rounds: 1, ..metaball::BodyFitOptions::default() };
            let priors = metaball::anthropometric(&template);
            let mut fit = metaball::fit_body(&body, &observed, &template, &priors, &options).unwrap();
            fit.support.fill(9.0);
            fit.off_share = 0.0;
            fit.doubts = vec![metaball::Doubt::Misshapen { segment: segment.to_owned(), what, sigmas, most: 3.0 }];
            rejection(&fit).map(|it| it.1)
        };
    let person =
        |segment: &str, what: &'static str, sigmas: f64| reason_of(metaball::person(1.75), segment, what, sigmas);
    for (segment, what, sigmas) in [
        ("trunk", "length", 3.9),
        ("upper_arm_left", "length", -3.9),
        ("pelvis", "thickness", 9.0),
        ("hand_left", "length", 9.0),
    ] {
        assert_eq!(person(segment, what, sigmas), None, "{what} of {segment}");
    }
    for (segment, what, sigmas, most) in [
        ("trunk", "length", 4.1, "expected 4 at most"),
        ("upper_arm_left", "length", -4.1, "expected 4 at most"),
        ("forearm_left", "length", 3.1, "expected 3 at most"),
        ("thigh_left", "thickness", 3.1, "expected 3 at most"),
        ("the whole body", "stature", 3.1, "expected 3 at most"),
    ] {
        let reason = person(segment, what, sigmas).unwrap_or_default();
        assert!(reason.contains(most), "{what} of {segment}: {reason}");
    }
    // Of a single arm less is known.
    let reason = reason_of(metaball::arm(Side::Right, 1.75), "upper_arm_right", "length", 3.1).unwrap_or_default();
    assert!(reason.contains("expected 3 at most"), "{reason}");
}

#[test]
fn points_between_two_limbs_do_not_keep_a_person_from_settling() {
    let (height, girth) = (1.85, 1.2);
    let (body, template) = metaball::person(1.75);
    let options = metaball::BodyFitOptions { joint_sigma_m: 0.012, ..metaball::BodyFitOptions::default() };
    let mut tracker = BodyTracker::new(body, template, Rules { points: 1500, options, ..rules() });
    let clicks = joints(height).into_iter().enumerate().collect();
    for message in 0..3 {
        let surface = surface(height, girth, 0.04 * f64::from(message));
        let Outcome::Followed(frame) = tracker.track(&surface, &clicks, &[]) else { panic!("no body") };
        assert!(frame.fit.settled, "{height} m, message {message}: {:?}", frame.fit.doubts);
    }
}

#[test]
fn points_together_off_the_body_are_a_limb_that_lies_elsewhere_and_scattered_ones_are_not() {
    let (body, template) = metaball::arm(Side::Right, 1.75);
    let list = points(0.0, 400).list;
    let observed: Vec<_> = list
        .iter()
        .map(|it| metaball::BodyObservation::Point { at: it.position, sigma_m: 1e-3, segment: None })
        .collect();
    let options = metaball::BodyFitOptions { rough: false, max_rounds: 1, ..metaball::BodyFitOptions::default() };
    let priors = metaball::anthropometric(&template);
    let mut fit = metaball::fit_body(&body, &observed, &template, &priors, &options).unwrap();
    // One in 30 points is of something else, `apart` from each other [m].
    let mut reason_of = |apart: f64| {
        fit.distances_m.fill(0.01);
        let mut surface = list.clone();
        for (number, it) in (0..list.len() / 30).enumerate() {
            surface[it].position = Point3::new(1.5 + apart * number as f64, 2.0, -1.0);
            fit.distances_m[it] = if number == 0 { f64::NAN } else { -0.06 };
        }
        stray(&surface.iter().collect::<Vec<_>>(), &fit)
    };
    let reason = reason_of(0.001).unwrap();
    assert!(reason.contains("together about (1.5") && reason.contains("more accurate clicked"), "{reason}");
    assert_eq!(reason_of(0.1), None);
}
