//! Which point of one motion is which of another.

use std::collections::BTreeMap;

use foveate_estimation::assignment::{Workspace, optimal};
use nalgebra::Isometry3;

use super::{common_times, places};
use crate::motion::Motion;

/// Pairs of the same name; where a name is not in both as it stands, by what is left of it without a subject's name before a `:`, capitals, blanks and
/// signs, if that is one point's alone in either.
pub(super) fn by_names(a: &[String], b: &[String]) -> Vec<[usize; 2]> {
    let exact: BTreeMap<&str, usize> = b.iter().map(String::as_str).zip(0..).collect();
    let core = |it: &str| -> String {
        let last = it.rsplit(':').next().unwrap_or(it);
        last.chars().filter(|it| it.is_alphanumeric()).flat_map(char::to_lowercase).collect()
    };
    let alone = |names: &[String]| {
        let mut all: BTreeMap<String, Option<usize>> = BTreeMap::new();
        for (place, name) in names.iter().enumerate() {
            all.entry(core(name)).and_modify(|it| *it = None).or_insert(Some(place));
        }
        all
    };
    let (of_a, of_b) = (alone(a), alone(b));
    let mut pairs: Vec<[usize; 2]> =
        a.iter().enumerate().filter_map(|(place, name)| Some([place, *exact.get(name.as_str())?])).collect();
    for (name, place) in &of_a {
        if let (Some(place), Some(Some(other))) = (place, of_b.get(name))
            && !name.is_empty()
            && !pairs.iter().any(|it| it[0] == *place || it[1] == *other)
        {
            pairs.push([*place, *other]);
        }
    }
    pairs.sort_unstable();
    pairs
}

/// Times that are looked at.
const MOST_TIMES: usize = 400;
/// Points on top of each other for no more than this part of the time are no pair: two that cross are near for a moment.
const LEAST_SHARE: f64 = 0.05;

/// The assignment of least mean distance over the common time, B's places taken to A by `a_from_b`.
///
/// # Errors
/// A sentence: too many points, or no time in common.
pub(super) fn by_places(a: &Motion, b: &Motion, a_from_b: &Isometry3<f64>) -> Result<Vec<[usize; 2]>, String> {
    let (n_a, n_b) = (a.labels.len(), b.labels.len());
    if n_a.saturating_mul(n_b) > 1_000_000 {
        return Err(format!("found {n_a} and {n_b} points, expected fewer to be paired by their places"));
    }
    let (times_s, _) = common_times(a, b);
    let step = times_s.len().div_ceil(MOST_TIMES).max(1);
    let few: Vec<f64> = times_s.into_iter().step_by(step).collect();
    let column = |motion: &Motion, point: usize| -> Vec<_> {
        places(motion, motion, &few, [point, point]).into_iter().map(|it| it[0]).collect()
    };
    let of_a: Vec<_> = (0..n_a).map(|it| column(a, it)).collect();
    let of_b: Vec<Vec<_>> =
        (0..n_b).map(|it| column(b, it).into_iter().map(|it| it.map(|it| a_from_b * it)).collect()).collect();
    let mut costs = Vec::with_capacity(n_a * n_b);
    for in_a in &of_a {
        for in_b in &of_b {
            let both = in_a.iter().zip(in_b).filter_map(|(a, b)| Some((((*a)?) - ((*b)?)).norm()));
            let (n, sum) = both.fold((0, 0.0), |all, it| (all.0 + 1, all.1 + it));
            let there = in_a.iter().flatten().count().min(in_b.iter().flatten().count());
            let is_enough = n > 0 && f64::from(n) >= LEAST_SHARE * there as f64;
            costs.push(if is_enough { sum / f64::from(n) } else { f64::NAN });
        }
    }
    let mut assigned = Vec::new();
    optimal(&costs, n_a, n_b, f64::INFINITY, &mut Workspace::default(), &mut assigned);
    Ok(assigned.into_iter().enumerate().filter_map(|(place, other)| Some([place, other?])).collect())
}
