//! How far apart two motions are, point by point.
//!
//! In this order: points are paired, B is brought to A's axes, the times are shifted, B is aligned to A in space; then
//! the distance of each pair is taken at the frames of the motion
//! of the lower rate, where the other is interpolated between neighbouring frames. Samples missing in either are counted, and not compared.

mod pairs;
mod shift;
#[cfg(test)]
mod tests;

use foveate_estimation::statistics::percentile;
use foveate_geometry::alignment::{AlignmentOptions, align};
use nalgebra::{Isometry3, Point3};

use crate::motion::{Motion, Up};
use pairs::{by_names, by_places};

/// How points of the two files are paired.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pairing {
    /// By name, ignoring anything before a `:`, case, blanks and signs.
    Names,
    /// By the assignment of least mean distance over the common time.
    Nearest,
}

/// Options of [`compare`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CompareOptions {
    /// Pairing of the points; `None`: by names, or by distance where no name is in both.
    pub pairing: Option<Pairing>,
    /// Whether to align B to A by the best rigid transform.
    pub align: bool,
    /// Largest shift in time to search; 0: none [s].
    pub most_shift_s: f64,
}

/// Distances of one pair of points, or of all pairs.
#[derive(Debug, Clone, PartialEq)]
pub struct Distances {
    /// Name in A.
    pub name_a: String,
    /// Name in B.
    pub name_b: String,
    /// Number of frames with both points.
    pub n: usize,
    /// Number of frames with only A's point, and only B's.
    pub n_only: [usize; 2],
    /// Median distance [m]; NaN without a frame.
    pub median: f64,
    /// 95th percentile of the distances [m].
    pub p95: f64,
    /// Largest distance [m].
    pub max: f64,
}

/// The result of [`compare`].
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// How the points were paired.
    pub pairing: Pairing,
    /// Distances of each pair, in the order of A.
    pub points: Vec<Distances>,
    /// Distances of all pairs together.
    pub all: Distances,
    /// Names of unpaired points, in A and in B.
    pub only: [Vec<String>; 2],
    /// Number of frames with at least one pair.
    pub n_frames: usize,
    /// Number of frames in the common time.
    pub n_common: usize,
    /// Shift added to B's times [s].
    pub shift_s: f64,
    /// Transform from B to A, where alignment was requested.
    pub a_from_b: Option<Isometry3<f64>>,
    /// Remarks for the user.
    pub remarks: Vec<String>,
}

/// Frames of irregular times that are this far apart are no neighbours [s].
const NEIGHBOURS_S: f64 = 0.05;
/// Places that a transform in space is fitted to, at most.
const MOST_FITTED: usize = 20_000;

/// Compares two motions, B with A.
///
/// # Errors
/// A sentence: no points or times in common, or too few for a transform.
pub fn compare(a: &Motion, b: &Motion, options: &CompareOptions) -> Result<Comparison, String> {
    for (name, motion) in [("A", a), ("B", b)] {
        if motion.n_present() == 0 {
            return Err(format!("found no samples in {name}, expected one at least"));
        }
    }
    let mut remarks = Vec::new();
    if options.most_shift_s == 0.0 {
        remarks.extend(clocks(a, b));
    }
    let mut b = b.clone();
    let named = by_names(&a.labels, &b.labels);
    let pairing = options.pairing.unwrap_or(if named.is_empty() { Pairing::Nearest } else { Pairing::Names });
    if pairing == Pairing::Names && named.is_empty() {
        let few = |labels: &[String]| labels.iter().take(4).map(|it| format!("`{it}`")).collect::<Vec<_>>().join(", ");
        return Err(format!(
            "found no name in both (A has {}, B {}), expected common names or the pairing by places (nearest)",
            few(&a.labels),
            few(&b.labels)
        ));
    }
    if options.pairing.is_none() && pairing == Pairing::Nearest {
        remarks.push("no name is in both: points are paired by their places".to_owned());
    }
    let known = (pairing == Pairing::Names).then_some(&named[..]);
    let shift_s = match options.most_shift_s > 0.0 {
        true => shift::by_speeds(a, &b, known, options.most_shift_s)?,
        false => 0.0,
    };
    move_in_time(&mut b, shift_s);
    let mut pairs = match pairing {
        Pairing::Names => named,
        Pairing::Nearest => by_places(a, &b, &Isometry3::identity())?,
    };
    if a.up != b.up {
        pairs = same_up(a, &mut b, pairs, pairing, &mut remarks)?;
    }
    let mut shift_s = shift_s;
    let mut a_from_b = None;
    if options.align {
        let mut best = lay_onto(a, &b, &pairs)?;
        if pairing == Pairing::Nearest {
            // Points that change partners change the transform, and the other way round.
            for _ in 0..10 {
                let again = by_places(a, &b, &best)?;
                if again == pairs {
                    break;
                }
                pairs = again;
                best = lay_onto(a, &b, &pairs)?;
            }
        }
        a_from_b = Some(best);
    }
    if options.most_shift_s > 0.0 {
        let more = shift::refined(a, &b, &pairs, options.align)?;
        if (shift_s + more).abs() <= options.most_shift_s {
            shift_s += more;
            move_in_time(&mut b, more);
            if options.align {
                a_from_b = Some(lay_onto(a, &b, &pairs)?);
            }
        }
        if shift_s.abs() > 0.98 * options.most_shift_s {
            remarks.push(format!("the shift of {shift_s:.3} s is the largest allowed; a larger one may fit better"));
        }
    }
    let moved = a_from_b.unwrap_or_default();
    let mut comparison = measure(a, &b, &pairs, &moved);
    if comparison.n_common == 0 {
        return Err(format!(
            "found no common time: A lasts from {:.3} to {:.3} s, B from {:.3} to {:.3} s; expected an overlap, or a search for a shift (--shift)",
            a.start_s(),
            a.times_s.last().copied().unwrap_or(0.0),
            b.start_s(),
            b.times_s.last().copied().unwrap_or(0.0)
        ));
    }
    let only = |labels: &[String], taken: &dyn Fn(usize) -> bool| -> Vec<String> {
        labels.iter().enumerate().filter(|it| !taken(it.0)).map(|it| it.1.clone()).collect()
    };
    comparison.only = [
        only(&a.labels, &|it| pairs.iter().any(|pair| pair[0] == it)),
        only(&b.labels, &|it| pairs.iter().any(|pair| pair[1] == it)),
    ];
    Ok(Comparison { pairing, shift_s, a_from_b, remarks, ..comparison })
}

/// What speaks against the times of A and B being of one clock.
fn clocks(a: &Motion, b: &Motion) -> Option<String> {
    let (from_a, from_b) = (a.start_s(), b.start_s());
    let frame_s = 1.0 / a.usual_rate_hz().unwrap_or(1.0).max(b.usual_rate_hz().unwrap_or(1.0));
    if (from_a - from_b).abs() < 0.5 * frame_s {
        return None;
    }
    let starts = format!("A begins at {from_a:.3} s, B at {from_b:.3} s");
    match (a.lacks_start, b.lacks_start) {
        (true, true) => None,
        (false, false) if a.n_frames() > 1 && a.n_frames() == b.n_frames() && a.rate_hz == b.rate_hz => Some(format!(
            "{starts}, and both have {} frames at one rate: where one of them lost when it began, a shift in time aligns them",
            a.n_frames()
        )),
        (false, false) => None,
        (is_a, _) => Some(format!(
            "{starts}, but {} does not say when it begins: they share no clock; search for a shift in time (--shift)",
            if is_a { "A" } else { "B" }
        )),
    }
}

fn move_in_time(motion: &mut Motion, by_s: f64) {
    motion.times_s.iter_mut().for_each(|it| *it += by_s);
}

/// Of two files that say another axis is up: turned, or as the numbers stand, whichever is nearer, for some say so wrongly.
fn same_up(
    a: &Motion,
    b: &mut Motion,
    pairs: Vec<[usize; 2]>,
    pairing: Pairing,
    remarks: &mut Vec<String>,
) -> Result<Vec<[usize; 2]>, String> {
    let mut turned = b.clone();
    turned.turn(a.up);
    let again =
        if pairing == Pairing::Nearest { by_places(a, &turned, &Isometry3::identity())? } else { pairs.clone() };
    let median = |b: &Motion, pairs: &[[usize; 2]]| {
        let all = measure(a, b, pairs, &Isometry3::identity()).all;
        if all.n == 0 { f64::INFINITY } else { all.median }
    };
    let name = |it: Up| it.name();
    if median(&turned, &again) < median(b, &pairs) {
        remarks.push(format!("{} is up in A and {} in B: B is turned", name(a.up), name(b.up)));
        *b = turned;
        return Ok(again);
    }
    remarks.push(format!(
        "{} is up in A and {} in B by their formats; their numbers agree better as they stand, and are compared so",
        name(a.up),
        name(b.up)
    ));
    b.up = a.up;
    Ok(pairs)
}

/// The times at which two motions are compared, and whether they are A's.
fn common_times(a: &Motion, b: &Motion) -> (Vec<f64>, bool) {
    let rate = |it: &Motion| it.usual_rate_hz().unwrap_or(f64::INFINITY);
    let (slow, fast, is_of_a) = if rate(a) <= rate(b) { (a, b, true) } else { (b, a, false) };
    let within = |it: &f64| {
        fast.times_s.first().is_some_and(|first| *first <= it + 1e-6)
            && fast.times_s.last().is_some_and(|last| *last >= it - 1e-6)
    };
    (slow.times_s.iter().copied().filter(within).collect(), is_of_a)
}

/// The places of every pair at the common times, where both are there; time by time.
fn places(a: &Motion, b: &Motion, times_s: &[f64], pair: [usize; 2]) -> Vec<[Option<Point3<f64>>; 2]> {
    let gaps = [a, b].map(|it| it.neighbours_s(NEIGHBOURS_S));
    let place = |motion: &Motion, point: usize, time: f64, gap: f64| motion.at(point, time, gap).map(|it| it.position);
    times_s.iter().map(|&time| [place(a, pair[0], time, gaps[0]), place(b, pair[1], time, gaps[1])]).collect()
}

/// The rigid transform of B onto A that fits best, wrong samples left aside.
fn lay_onto(a: &Motion, b: &Motion, pairs: &[[usize; 2]]) -> Result<Isometry3<f64>, String> {
    let (times_s, _) = common_times(a, b);
    let step = (times_s.len() * pairs.len()).div_ceil(MOST_FITTED).max(1);
    let few: Vec<f64> = times_s.iter().copied().step_by(step).collect();
    let (mut in_a, mut in_b) = (Vec::new(), Vec::new());
    for &pair in pairs {
        for both in places(a, b, &few, pair) {
            if let [Some(of_a), Some(of_b)] = both {
                in_a.push(of_a);
                in_b.push(of_b);
            }
        }
    }
    let solver_options = AlignmentOptions { scale: false, robust: true };
    let found = align(&in_b, &in_a, solver_options).map_err(|it| format!("B cannot be aligned to A: {it}"))?;
    Ok(found.b_from_a.isometry)
}

fn measure(a: &Motion, b: &Motion, pairs: &[[usize; 2]], a_from_b: &Isometry3<f64>) -> Comparison {
    let (times_s, _) = common_times(a, b);
    let mut is_compared = vec![false; times_s.len()];
    let mut all = Vec::new();
    let mut points = Vec::new();
    let mut n_only_of_all = [0; 2];
    for &pair in pairs {
        let mut distances = Vec::new();
        let mut n_only = [0; 2];
        for (both, is_compared) in places(a, b, &times_s, pair).into_iter().zip(&mut is_compared) {
            match both {
                [Some(of_a), Some(of_b)] => {
                    distances.push((a_from_b * of_b - of_a).norm());
                    *is_compared = true;
                }
                [Some(_), None] => n_only[0] += 1,
                [None, Some(_)] => n_only[1] += 1,
                [None, None] => {}
            }
        }
        all.extend_from_slice(&distances);
        (n_only_of_all[0], n_only_of_all[1]) = (n_only_of_all[0] + n_only[0], n_only_of_all[1] + n_only[1]);
        points.push(summary(&a.labels[pair[0]], &b.labels[pair[1]], &distances, n_only));
    }
    Comparison {
        pairing: Pairing::Names,
        points,
        all: summary("all", "all", &all, n_only_of_all),
        only: [Vec::new(), Vec::new()],
        n_frames: is_compared.iter().filter(|it| **it).count(),
        n_common: times_s.len(),
        shift_s: 0.0,
        a_from_b: None,
        remarks: Vec::new(),
    }
}

fn summary(name_a: &str, name_b: &str, distances: &[f64], n_only: [usize; 2]) -> Distances {
    let at = |percent: f64| percentile(distances, percent).unwrap_or(f64::NAN);
    let (median, p95, max) = (at(50.0), at(95.0), distances.iter().copied().fold(f64::NAN, f64::max));
    Distances { name_a: name_a.to_owned(), name_b: name_b.to_owned(), n: distances.len(), n_only, median, p95, max }
}
