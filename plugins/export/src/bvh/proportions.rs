//! Checks whether eight targets can be at their stated sites of a body.
//!
//! Source of lengths: D. A. Winter, *Biomechanics and Motor Control of Human Movement*, 4th ed., 2009, figure 4.1 (after Drillis and Contini, 1966): parts of the body as
//! shares of the stature. Distances to head and waist are computed from its heights: shoulders at 0.818, a target on top of the head at 1, one on the waist at 0.57,
//! between the hips (0.53) and the navel (0.6).
//!
//! | here | meaning | unit |
//! |---|---|---|
//! | length | median distance of two targets over the session | the file's |
//! | stature | median of length / share over all parts | the file's |
//! | stretch | distance of the 10th from the 90th of a hundred distances, over the length | – |

use nalgebra::{Point3, Vector3};

use super::body::Places;

/// A part of the body: its two sites, its share of the stature, its name in messages.
pub(super) struct Part {
    pub(super) ends: [usize; 2],
    pub(super) share: f64,
    pub(super) name: &'static str,
    /// The same on the other side.
    twin: Option<usize>,
}

/// All parts between targets.
pub(super) const PARTS: [Part; 9] = [
    Part { ends: [2, 3], share: 0.259, name: "the width of the shoulders", twin: None },
    Part { ends: [2, 4], share: 0.186, name: "the left upper arm", twin: Some(2) },
    Part { ends: [3, 5], share: 0.186, name: "the right upper arm", twin: None },
    Part { ends: [4, 6], share: 0.146, name: "the left forearm", twin: Some(4) },
    Part { ends: [5, 7], share: 0.146, name: "the right forearm", twin: None },
    Part { ends: [0, 2], share: 0.223, name: "the distance from head to left shoulder", twin: Some(6) },
    Part { ends: [0, 3], share: 0.223, name: "the distance from head to right shoulder", twin: None },
    Part { ends: [1, 2], share: 0.280, name: "the distance from waist to left shoulder", twin: Some(8) },
    Part { ends: [1, 3], share: 0.280, name: "the distance from waist to right shoulder", twin: None },
];

/// Statures of people who stand: from a child of a few months to the tallest man on record, 2.72 m [m].
pub(super) const STATURES_M: [f64; 2] = [0.5, 2.8];
/// Default of [`Limits::factor`], of [`Limits::side_factor`] and of [`Limits::stretch`].
pub(super) const PART_FACTOR: f64 = 1.6;
pub(super) const SIDE_FACTOR: f64 = 1.3;
pub(super) const STRETCH: f64 = 0.5;
/// Head and waist are no joints: a target there can sit some centimetres higher or lower, on a belt or between the shoulder blades.
const NO_JOINT: f64 = 1.25;
/// The arms among [`PARTS`].
const ARMS: std::ops::RangeInclusive<usize> = 1..=4;
/// Allowed stretch of arms, as a share of that of other parts, which bend.
const ARM_STRETCH: f64 = 0.6;
/// Frames that are examined, spread over the session.
pub(super) const FRAMES: usize = 600;
/// Fewest frames that determine the front.
const FRONT_FRAMES: usize = 15;

/// How far targets may be from those of a usual body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Limits {
    /// Factor of a part relative to the others.
    pub(super) factor: f64,
    /// Factor of left relative to right.
    pub(super) side_factor: f64,
    pub(super) stretch: f64,
    /// Metres in one unit of the positions; `None`: unknown.
    pub(super) unit_m: Option<f64>,
    /// Whether the body must be as tall as people are, with its head above its waist most of the time.
    pub(super) checks_standing: bool,
}

/// The frames that are examined.
pub(super) fn some<T>(frames: &[T]) -> impl Iterator<Item = &T> {
    frames.iter().step_by(frames.len().div_ceil(FRAMES).max(1))
}

/// Length and stretch of distances; `None` where there are too few.
pub(super) fn length(distances: &mut [f64]) -> Option<(f64, f64)> {
    distances.sort_unstable_by(f64::total_cmp);
    let at = |share: f64| distances.get(((distances.len().checked_sub(1)?) as f64 * share).round() as usize).copied();
    let median = at(0.5)?;
    Some((median, (at(0.9)? - at(0.1)?) / median.max(f64::MIN_POSITIVE)))
}

/// Whether left and right are as stated, by the movements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Sides {
    /// As stated: elbows are behind, and the body walks forward.
    Right,
    /// Left and right are exchanged.
    Exchanged,
    /// The movements do not distinguish them.
    Unknown,
}

/// Distinguishes the sides by the elbows, which bend to the front, and by the direction of walking, y up.
pub(super) fn sides(frames: &[Places]) -> Sides {
    let front_of = |places: &Places| -> Option<(Vector3<f64>, f64)> {
        let [left, right, waist] = [places[2]?, places[3]?, places[1]?];
        let up = (nalgebra::center(&left, &right) - waist).try_normalize(1e-9)?;
        Some(((left - right).cross(&up).try_normalize(1e-9)?, (left - right).norm()))
    };
    let (mut behind, mut before) = (0_usize, 0_usize);
    for places in some(frames) {
        let Some((front, width)) = front_of(places) else { continue };
        for [shoulder, elbow, wrist] in [[2, 4, 6], [3, 5, 7]] {
            let (Some(a), Some(b), Some(c)) = (places[shoulder], places[elbow], places[wrist]) else { continue };
            let Some(along) = (c - a).try_normalize(1e-9) else { continue };
            let out = (b - a) - along * (b - a).dot(&along);
            // A tenth of the shoulders: more than a target on the skin is off.
            match out.dot(&front) {
                it if it < -0.1 * width => behind += 1,
                it if it > 0.1 * width => before += 1,
                _ => {}
            }
        }
    }
    let (mut forward, mut backward) = (0.0, 0.0);
    let seen: Vec<&Places> = some(frames).filter(|it| it[1].is_some()).collect();
    for pair in seen.windows(2) {
        let (Some((front, width)), [Some(a), Some(b)]) = (front_of(pair[0]), [pair[0][1], pair[1][1]]) else {
            continue;
        };
        // Level ground: a jump says nothing.
        let step = Vector3::new(b.x - a.x, 0.0, b.z - a.z).dot(&front) / width.max(f64::MIN_POSITIVE);
        if step > 0.0 { forward += step } else { backward -= step }
    }
    let by_elbows = match (behind, before) {
        _ if behind + before < FRONT_FRAMES => 0,
        _ if behind > 3 * before => 1,
        _ if before > 3 * behind => -1,
        _ => 0,
    };
    // Two metres or so, mostly one way.
    let by_way = match (forward, backward) {
        _ if forward + backward < 5.0 => 0,
        _ if forward > 3.0 * backward => 1,
        _ if backward > 3.0 * forward => -1,
        _ => 0,
    };
    match by_elbows + by_way {
        1.. => Sides::Right,
        0 => Sides::Unknown,
        _ => Sides::Exchanged,
    }
}

/// Why the targets cannot be at their stated sites, y up; empty: no objection. `called` gives a site's name in messages.
pub(super) fn objections(frames: &[Places], called: &dyn Fn(usize) -> String, limits: &Limits) -> Vec<String> {
    let of = |part: &Part| {
        let [a, b] = part.ends;
        let mut distances: Vec<f64> = some(frames).filter_map(|it| Some((it[a]? - it[b]?).norm())).collect();
        length(&mut distances)
    };
    let lengths: Vec<Option<(f64, f64)>> = PARTS.iter().map(of).collect();
    let mut statures: Vec<f64> =
        PARTS.iter().zip(&lengths).filter_map(|(part, it)| Some((*it)?.0 / part.share)).collect();
    let Some((stature, _)) = length(&mut statures) else { return Vec::new() };
    let (per_unit, unit) = limits.unit_m.map_or((1.0, "units"), |it| (100.0 * it, "cm"));
    let say = |length: f64| format!("{:.0} {unit}", length * per_unit);
    let ends = |part: &Part| {
        let [a, b] = part.ends.map(called);
        format!("{a} and {b}")
    };
    let mut found = Vec::new();
    let mut is_named = [false; PARTS.len()];
    for (index, (part, it)) in PARTS.iter().zip(&lengths).enumerate() {
        let Some((length, stretch)) = *it else { continue };
        let usual = part.share * stature;
        let factor = if part.ends[0] < 2 { limits.factor * NO_JOINT } else { limits.factor };
        if length > factor * usual || length * factor < usual {
            is_named[index] = true;
            found.push(format!(
                "{} ({}) is {}, {} fits the rest of the body",
                part.name,
                ends(part),
                say(length),
                say(usual)
            ));
        } else if stretch > if ARMS.contains(&index) { limits.stretch * ARM_STRETCH } else { limits.stretch } {
            is_named[index] = true;
            found.push(format!("{} ({}) changes its length by {:.0} %", part.name, ends(part), 100.0 * stretch));
        }
    }
    for (index, part) in PARTS.iter().enumerate() {
        let Some(twin) = part.twin.filter(|it| !is_named[index] && !is_named[*it]) else { continue };
        if let (Some((left, _)), Some((right, _))) = (lengths[index], lengths[twin])
            && left.max(right) > limits.side_factor * left.min(right)
        {
            let (left, right, other) = (say(left), say(right), &PARTS[twin]);
            found.push(format!(
                "{} ({}) is {left}, {} ({}) is {right}",
                part.name,
                ends(part),
                other.name,
                ends(other)
            ));
        }
    }
    if limits.checks_standing
        && let Some(unit_m) = limits.unit_m
        && !(STATURES_M[0]..=STATURES_M[1]).contains(&(stature * unit_m))
    {
        found.push(format!("the body would be {:.2} m tall", stature * unit_m));
    }
    let heights = some(frames).filter_map(|it| Some(it[0]?.y > it[1]?.y));
    let (above, below): (Vec<bool>, Vec<bool>) = heights.partition(|it| *it);
    if limits.checks_standing && below.len() > above.len() {
        let [head, waist] = [0, 1].map(called);
        let share = 100 * below.len() / (above.len() + below.len());
        found.push(format!("{head} is below {waist} in {share} % of the frames"));
    }
    if found.is_empty() && sides(frames) == Sides::Exchanged {
        found.push("elbows bend backwards or the body walks backwards: left and right are exchanged".to_owned());
    }
    found
}

/// Positions of all targets in a frame, each its own.
pub(super) type All = Vec<Option<Point3<f64>>>;
