//! Tests of how people are found who stand in any way, in the hulls of rings of cameras.

use foveate_estimation::random::Random;
use nalgebra::Point3;

use super::drawn::{Stance, hull, ring};
use super::parts::Joint;
use super::tracker::{BodyTracker, JointEstimate, TrackerOptions};

/// Farther off is a joint that lies in another limb [m].
const ELSEWHERE: f64 = 0.15;

fn mirrored(joint: Joint) -> Joint {
    let pairs = [
        [Joint::LeftShoulder, Joint::RightShoulder],
        [Joint::LeftElbow, Joint::RightElbow],
        [Joint::LeftWrist, Joint::RightWrist],
        [Joint::LeftHip, Joint::RightHip],
        [Joint::LeftKnee, Joint::RightKnee],
        [Joint::LeftAnkle, Joint::RightAnkle],
    ];
    let other = |[left, right]: [Joint; 2]| (joint == left).then_some(right).or((joint == right).then_some(left));
    pairs.into_iter().find_map(other).unwrap_or(joint)
}

/// How far each joint is off, whichever side is called the left one, and whether any lacks [m].
fn off(found: &[JointEstimate], truth: &[(Joint, Point3<f64>)]) -> Vec<(Joint, f64)> {
    let with = |name: fn(Joint) -> Joint| -> Vec<(Joint, f64)> {
        let away = |(joint, at): &(Joint, Point3<f64>)| {
            let it = found.iter().find(|it| it.joint == name(*joint));
            (*joint, it.map_or(f64::INFINITY, |it| (it.position - at).norm()))
        };
        truth.iter().map(away).collect()
    };
    let sum = |it: &[(Joint, f64)]| it.iter().map(|it| it.1.min(1.0)).sum::<f64>();
    let (same, other) = (with(|it| it), with(mirrored));
    if sum(&same) <= sum(&other) { same } else { other }
}

/// Those who are found wrong, as text.
fn wrong(seeds: std::ops::Range<u64>, n_cameras: usize, vary: bool) -> Vec<String> {
    let mut wrong = Vec::new();
    for seed in seeds {
        let mut random = Random::new(seed);
        let mut stance = Stance::upright(&mut random);
        if vary {
            stance.vary(&mut random);
        } else if seed.is_multiple_of(2) {
            stance.spread = 0.0;
        }
        let (tubes, truth) = stance.drawn();
        let field = hull(&tubes, &ring(n_cameras, &mut random), 0.025);
        let mut options = TrackerOptions::default();
        options.proportions.stature = stance.stature;
        options.acquisition.least_volume = 0.008;
        match BodyTracker::acquire(&field, &options) {
            Ok(tracker) => {
                let far: Vec<_> = off(&tracker.joints(), &truth).into_iter().filter(|it| it.1 > ELSEWHERE).collect();
                if !far.is_empty() {
                    wrong
                        .push(format!("{seed}: {far:?}, {:.2} of the skin is nobody's", tracker.support().unexplained));
                }
            }
            Err(why) => wrong.push(format!("{seed}: {why}")),
        }
    }
    wrong
}

#[test]
fn legs_side_by_side_are_two_straight_legs() {
    let wrong = wrong(9200..9212, 8, false);
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn people_in_any_stance_are_found_with_all_limbs() {
    let wrong = wrong(9300..9320, 10, true);
    assert!(wrong.len() <= 1, "{} of 20 are wrong\n{}", wrong.len(), wrong.join("\n"));
}
