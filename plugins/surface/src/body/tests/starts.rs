//! Arms and people that are begun from clicks far off, on other joints or refused before.

use super::*;

const JOINTS: [&str; 3] = ["right-shoulder", "right-elbow", "right-wrist"];

fn begun(clicked: Vec<(&str, Point3<f64>)>, height_m: f64) -> std::sync::Arc<Skeletons> {
    let clicked = clicked.into_iter().map(|(joint, at)| Clicked { joint: joint.to_owned(), at: at.coords.into() });
    let settings = BodySettings { clicked: clicked.collect(), height_m, ..settings() };
    let mut bench = NodeBench::<BodyFitter>::new(settings).unwrap();
    bench.feed(&TRACKED, Time::ZERO, points(0.0, 800)).unwrap();
    bench.outputs(&SKELETONS).remove(0).value
}

/// That the arm came out as it is, and how far off its worst direction is.
#[track_caller]
fn check_right(message: &Skeletons, what: &str) {
    let skeleton = message.list.first().unwrap_or_else(|| panic!("{what}: {:?}", message.unmodelled));
    let off = errors_deg(skeleton, joints(0.0));
    assert!(off.iter().all(|it| *it < 6.0), "{what}: {off:?} degrees");
}

#[test]
fn clicks_that_are_far_off_give_the_arm_or_none() {
    let mut random = Random::new(5);
    let mut n_right = 0;
    for number in 0..12 {
        let sigma = [0.08, 0.12][number % 2];
        let mut off = |at: Point3<f64>| at + Vector3::from_fn(|_, _| sigma * random.normal());
        let clicked = JOINTS.into_iter().zip(joints(0.0).map(&mut off)).collect();
        let message = begun(clicked, 1.75);
        if !message.list.is_empty() {
            check_right(&message, &format!("start {number}"));
            n_right += 1;
        }
    }
    assert!(n_right >= 10, "{n_right} of 12");
}

#[test]
fn one_click_on_a_wrong_joint_is_outvoted_by_the_points_or_told() {
    for (number, at) in [(0, 2), (1, 0), (2, 1), (2, 0)] {
        let message = begun(vec![(JOINTS[number], joints(0.0)[at])], 1.75);
        // Of this even arm the other way round is nearly as good, and one click may make it as good.
        let is_unclear = message.unmodelled.iter().any(|it| it.reason.contains("orientation is ambiguous"));
        if !is_unclear {
            check_right(&message, &format!("{number} at {at}"));
        }
    }
    check_right(&begun(Vec::new(), 1.75), "no click");
}

#[test]
fn a_height_that_is_far_off_is_told() {
    for (height_m, words) in [(2.4, "0.8 times the set `height_m`"), (1.3, "off the body")] {
        let message = begun(JOINTS.into_iter().zip(joints(0.0)).collect(), height_m);
        assert!(message.list.is_empty(), "{height_m} m: {:?}", message.list);
        assert!(message.unmodelled[0].reason.contains(words), "{height_m} m: {}", message.unmodelled[0].reason);
    }
}
