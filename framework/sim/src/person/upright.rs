//! Which way is up in a recording.
//!
//! An upright person has the head above the ankles, and so does the skeleton where no joint is turned. Most files agree on both. Where they do not, either the skeleton was made for another axis than the recording,
//! or the person lies, crawls or stands on the hands throughout: then the floor, which is at 0 in most files, tells the two apart.

use foveate_scene::skeleton::{SkeletonMotion, z_up_from_y_up};
use nalgebra::{UnitQuaternion, Vector3};

use super::joints::{HEAD, N_JOINTS};

/// A direction along an axis has this part of it there, at least [–].
const ALONG: f64 = 0.6;
/// The mean of directions of length 1 is so long where they are much alike [–].
const STEADY: f64 = 0.5;
/// The lowest joint is so near the floor, in heights of the person [–].
const ON_THE_FLOOR: f64 = 0.15;
/// The lowest of so many frames of a hundred are errors [–].
const LOWEST: f64 = 0.02;

/// An axis of the file and whether its end points up.
pub(super) type Up = (usize, bool);

/// Which axis is up by joints' `places` in all frames [m], of a person `stature_m` tall, and which one the skeleton says where it disagrees.
pub(super) fn up(
    motion: &SkeletonMotion,
    joints: &[usize; N_JOINTS],
    places: &[[Vector3<f64>; N_JOINTS]],
    stature_m: f64,
) -> (Up, Option<Up>) {
    let mut at_rest: Vec<Vector3<f64>> = Vec::with_capacity(motion.joints.len());
    for joint in &motion.joints {
        let parent = joint.parent.and_then(|it| at_rest.get(it)).copied().unwrap_or_default();
        at_rest.push(parent + joint.offset);
    }
    let (moving, rest) = (of_motion(places), axis_of(&above_ankles(&joints.map(|it| at_rest[it]))));
    match (moving, rest) {
        (Some(moving), Some(rest)) if moving != rest => {
            let [of_moving, of_rest] = [moving, rest].map(|it| is_on_the_floor(places, it, stature_m));
            let is_turned = moving.0 == rest.0;
            let taken = if of_rest && !of_moving || is_turned && of_rest == of_moving { rest } else { moving };
            (taken, Some(if taken == rest { moving } else { rest }))
        }
        (Some(up), _) | (None, Some(up)) => (up, None),
        (None, None) => ((1, true), None),
    }
}

/// The axis along which heads are above ankles in the mean of all frames, if there is one: in a row of cartwheels there is none.
pub(super) fn of_motion(places: &[[Vector3<f64>; N_JOINTS]]) -> Option<Up> {
    let mean: Vector3<f64> =
        places.iter().filter_map(|it| above_ankles(it).try_normalize(1e-9)).sum::<Vector3<f64>>() / places.len() as f64;
    axis_of(&mean).filter(|_| mean.norm() > STEADY)
}

fn above_ankles(places: &[Vector3<f64>; N_JOINTS]) -> Vector3<f64> {
    places[HEAD] - (places[4] + places[5]) / 2.0
}

/// The axis along which `it` goes, if there is one.
fn axis_of(it: &Vector3<f64>) -> Option<Up> {
    let axis = it.iamax();
    (it[axis].abs() > ALONG * it.norm()).then_some((axis, it[axis] > 0.0))
}

/// Whether the person is on the floor at 0 if that axis is up.
fn is_on_the_floor(places: &[[Vector3<f64>; N_JOINTS]], (axis, is_end_up): Up, stature_m: f64) -> bool {
    let height = |it: &Vector3<f64>| if is_end_up { it[axis] } else { -it[axis] };
    let mut lowest: Vec<f64> = places
        .iter()
        .map(|it| it.iter().map(height).fold(f64::INFINITY, f64::min))
        .filter(|it| it.is_finite())
        .collect();
    lowest.sort_by(f64::total_cmp);
    lowest.get((LOWEST * lowest.len() as f64) as usize).is_some_and(|it| it.abs() < ON_THE_FLOOR * stature_m)
}

/// Turns what is up to z; x goes to y, y to z, z to x.
pub(super) fn z_up_from((axis, is_end_up): Up) -> UnitQuaternion<f64> {
    // y gets there at once, x the second time.
    let on = z_up_from_y_up();
    let turned = [on * on, on, UnitQuaternion::identity()][axis];
    let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
    if is_end_up { turned } else { over * turned }
}

/// As it is said to people.
pub(super) fn in_words((axis, is_end_up): Up) -> String {
    format!("{}{}", if is_end_up { "" } else { "-" }, ["x", "y", "z"][axis])
}
