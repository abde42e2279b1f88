//! Checks the names of clicked joints: the same places are tried under other names.

use foveate::geometry::metaball::{Body, BodyObservation, State};
use foveate::prelude::*;
use nalgebra::Point3;

use super::message::joint_place;

/// People's lengths of limbs vary by this about the mean, standard deviation [–].
const LENGTH_SPREAD: f64 = 0.06;
/// Other names are tried where the distances of clicked joints fit them this much worse at most: squared standard deviations, 3² [–].
const TRIED: f64 = 9.0;
/// Most other names that are tried, those with the best-fitting distances.
const MOST_TRIED: usize = 4;
/// Clicked ends of a limb with a larger error of their distance are in another unit, or of something else [σ].
const MOST_APART: f64 = 8.0;

/// Clicked joints by their places in [`BODY_JOINTS`], under other names.
#[derive(Debug, Clone)]
pub(super) struct Reading {
    /// The exchanged names, for messages.
    pub what: &'static str,
    pub clicks: Vec<(usize, Point3<f64>)>,
}

/// Joints of each arm and leg below shoulder and hip, by their places in [`BODY_JOINTS`].
pub(super) const LIMBS: [[usize; 2]; 4] = [[4, 6], [5, 7], [10, 12], [11, 13]];

/// Exchanges of left and right that people make.
const SIDES: [(&str, &[usize]); 7] = [
    ("left and right of the clicked joints", &[2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13]),
    ("left and right of the clicked arms", &[4, 5, 6, 7]),
    ("left and right of the clicked legs", &[10, 11, 12, 13]),
    ("left and right of the clicked elbows", &[4, 5]),
    ("left and right of the clicked wrists", &[6, 7]),
    ("left and right of the clicked knees", &[10, 11]),
    ("left and right of the clicked ankles", &[12, 13]),
];

/// The clicked joints of an arm in all other orders, of a person with left and right exchanged: those that fit the lengths of limbs about as well as the clicks do as they are, or better.
pub(super) fn other_readings(
    body: &Body,
    template: &State,
    clicks: &[(usize, Point3<f64>)],
    clicked_m: f64,
    is_person: bool,
) -> Vec<Reading> {
    let all = if is_person { sides(clicks) } else { orders(clicks) };
    let off = |clicks: &[(usize, Point3<f64>)]| {
        lengths_off(body, template, clicks, clicked_m).iter().map(|it| it.0 * it.0).sum::<f64>()
    };
    let as_they_are = off(clicks);
    let mut all: Vec<(f64, Reading)> =
        all.into_iter().map(|it| (off(&it.clicks), it)).filter(|it| it.0 <= as_they_are + TRIED).collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all.truncate(MOST_TRIED);
    all.into_iter().map(|it| it.1).collect()
}

/// Message about clicked joints whose distances differ much from the lengths of limbs.
pub(super) fn too_far_apart(
    body: &Body,
    template: &State,
    clicks: &[(usize, Point3<f64>)],
    clicked_m: f64,
) -> Option<String> {
    let worst =
        lengths_off(body, template, clicks, clicked_m).into_iter().max_by(|a, b| a.0.abs().total_cmp(&b.0.abs()))?;
    let (off, [a, b], found, expected) = worst;
    (off.abs() > MOST_APART).then(|| format!("clicked {} and {} are {found:.3} m apart, expected about {expected:.2} m: clicks are in metres, in the scale's space", BODY_JOINTS[a], BODY_JOINTS[b]))
}

/// Of limbs both ends of which were clicked: how far these are from being as far apart as the limb is long [σ], the joints, their distance and the length [m].
fn lengths_off(
    body: &Body,
    template: &State,
    clicks: &[(usize, Point3<f64>)],
    clicked_m: f64,
) -> Vec<(f64, [usize; 2], f64, f64)> {
    let bones = body.skeleton.segments();
    let mut list = Vec::new();
    for (first, from) in clicks {
        for (second, to) in clicks {
            // Joints above the arms and legs lie inside of their segments.
            let (Some((segment, _)), Some((next, _))) = (joint_place(body, *first), joint_place(body, *second)) else {
                continue;
            };
            if *first < 2 || bones[next].parent != Some(segment) {
                continue;
            }
            let expected = bones[segment].length * template.scales[bones[segment].scale];
            let found = (to - from).norm();
            let sigma = (2.0 * clicked_m * clicked_m + (LENGTH_SPREAD * expected).powi(2)).sqrt();
            list.push(((found - expected) / sigma, [*first, *second], found, expected));
        }
    }
    list
}

fn orders(clicks: &[(usize, Point3<f64>)]) -> Vec<Reading> {
    let [a, b, c] = clicks else { return Vec::new() };
    let at =
        |order: [usize; 3]| [(a.0, clicks[order[0]].1), (b.0, clicks[order[1]].1), (c.0, clicks[order[2]].1)].to_vec();
    let of = |what, order| Reading { what, clicks: at(order) };
    vec![
        of("the clicked shoulder and elbow", [1, 0, 2]),
        of("the clicked elbow and wrist", [0, 2, 1]),
        of("the clicked shoulder and wrist", [2, 1, 0]),
        of("the clicked shoulder, elbow and wrist", [1, 2, 0]),
        of("the clicked shoulder, elbow and wrist", [2, 0, 1]),
    ]
}

fn sides(clicks: &[(usize, Point3<f64>)]) -> Vec<Reading> {
    // Left ones are even.
    let exchanged = |of: &[usize]| {
        clicks.iter().map(|(joint, at)| if of.contains(joint) { (joint ^ 1, *at) } else { (*joint, *at) }).collect()
    };
    let is_clicked = |of: &[usize]| clicks.iter().any(|it| of.contains(&it.0));
    SIDES.iter().filter(|it| is_clicked(it.1)).map(|(what, of)| Reading { what, clicks: exchanged(of) }).collect()
}

/// What clicked joints say of a body.
pub(super) fn anchors(body: &Body, clicks: &[(usize, Point3<f64>)], sigma_m: f64) -> Vec<BodyObservation> {
    let one = |(joint, at): &(usize, Point3<f64>)| {
        let (segment, place) = joint_place(body, *joint)?;
        Some(BodyObservation::Anchored { segment, place, at: *at, sigma_m })
    };
    clicks.iter().filter_map(one).collect()
}
