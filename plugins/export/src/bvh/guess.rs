//! Infers which target is on which part of a body, from their mutual distances over time.
//!
//! For each candidate pair of shoulders and each stature, head, waist and the two arms are searched one by one; the best few of each are combined,
//! with each target used once. The cost of an assignment is a sum of squares:
//!
//! | term | unit |
//! |---|---|
//! | logarithm of a part's length over its share of the stature | 15 % |
//! | stretch of a part | 15 % |
//! | logarithm of left over right, of arms | 8 % |
//! | median height of head, waist, elbows and wrists over the shoulders, less that of a body at rest | a fifth of the stature, of arms three tenths |

use super::body::Places;
use super::proportions::{All, PARTS, STATURES_M, Sides, length, sides, some};

/// Targets that are tried: those seen in the most frames.
const MOST: usize = 32;
/// Candidates of each part that are combined.
const BEST: usize = 4;
/// Fewest frames in which a pair must have been seen together.
const TOGETHER: usize = 10;
/// Largest cost of a pair, so that one outlier does not dominate.
const WORST: f64 = 30.0;
/// Heights of head, waist, elbows and wrists over the shoulders, as shares of the stature [Winter 2009, figure 4.1].
const HEAD_UP: f64 = 0.182;
const WAIST_UP: f64 = -0.25;
const ELBOW_UP: f64 = -0.188;
const WRIST_UP: f64 = -0.333;

/// Statistics of all pairs.
struct Pairs {
    n: usize,
    /// Length and stretch.
    pairs: Vec<Option<(f64, f64)>>,
    heights: Vec<f64>,
}

impl Pairs {
    fn of(frames: &[All], kept: &[usize]) -> Self {
        let n = kept.len();
        let mut pairs = vec![None; n * n];
        for (i, a) in kept.iter().enumerate() {
            for (j, b) in kept.iter().enumerate().take(i) {
                let mut distances: Vec<f64> = some(frames).filter_map(|it| Some((it[*a]? - it[*b]?).norm())).collect();
                let it = if distances.len() >= TOGETHER { length(&mut distances) } else { None };
                (pairs[i * n + j], pairs[j * n + i]) = (it, it);
            }
        }
        let height = |target: &usize| {
            let mut heights: Vec<f64> = some(frames).filter_map(|it| Some(it[*target]?.y)).collect();
            length(&mut heights).map_or(0.0, |it| it.0)
        };
        Self { n, pairs, heights: kept.iter().map(height).collect() }
    }

    fn length(&self, a: usize, b: usize) -> Option<f64> {
        self.pairs[a * self.n + b].map(|it| it.0)
    }

    fn cost(&self, a: usize, b: usize, share: f64, stature: f64) -> f64 {
        match self.pairs[a * self.n + b] {
            Some((length, stretch)) if a != b => {
                let off = (length.max(1e-9) / (share * stature)).ln() / 0.15;
                (off * off + (stretch / 0.15).powi(2)).min(WORST)
            }
            _ => 4.0 * WORST,
        }
    }

    /// Cost of the height of `a` over `b`.
    fn height_cost(&self, a: usize, b: usize, wanted: f64, stature: f64, deviation: f64) -> f64 {
        (((self.heights[a] - self.heights[b]) / stature - wanted) / deviation).powi(2).min(WORST)
    }

    /// The cheapest targets other than the two shoulders.
    fn best(&self, [i, j]: [usize; 2], cost: impl Fn(usize) -> f64) -> Vec<(f64, usize)> {
        cheapest((0..self.n).filter(|it| *it != i && *it != j).map(|it| (cost(it), it)).collect())
    }

    fn arms(&self, shoulder: usize, other: usize, stature: f64) -> Vec<(f64, [usize; 2])> {
        let is_free = |it: &usize| *it != shoulder && *it != other;
        let mut arms = Vec::new();
        for elbow in (0..self.n).filter(is_free) {
            let upper = self.cost(shoulder, elbow, PARTS[1].share, stature)
                + self.height_cost(elbow, shoulder, ELBOW_UP, stature, 0.3);
            for wrist in (0..self.n).filter(is_free).filter(|it| *it != elbow) {
                let lower = self.cost(elbow, wrist, PARTS[3].share, stature)
                    + self.height_cost(wrist, shoulder, WRIST_UP, stature, 0.3);
                arms.push((upper + lower, [elbow, wrist]));
            }
        }
        cheapest(arms)
    }
}

fn cheapest<T>(mut all: Vec<(f64, T)>) -> Vec<(f64, T)> {
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    all.truncate(BEST);
    all
}

/// A guess; targets are indices into the lists of `frames`.
pub(super) struct Guess {
    /// In the order of [`super::body::SITES`].
    pub(super) targets: [usize; 8],
    /// Whether the movements distinguish left from right.
    pub(super) knows_sides: bool,
}

/// The most likely targets of a body, y up; `None`: fewer than eight, or no two were seen together. `is_left` gives the known side of a target, left (or
/// right), used where the movements do not distinguish them. `unit_m`: metres in one unit of the positions, where known.
pub(super) fn guess(frames: &[All], unit_m: Option<f64>, is_left: impl Fn(usize) -> Option<bool>) -> Option<Guess> {
    let n = frames.first()?.len();
    let mut kept: Vec<usize> = (0..n).collect();
    kept.sort_by_key(|it| std::cmp::Reverse(some(frames).filter(|frame| frame[*it].is_some()).count()));
    kept.truncate(MOST);
    kept.sort_unstable();
    if kept.len() < 8 {
        return None;
    }
    let pairs = Pairs::of(frames, &kept);
    let mut best: Option<(f64, [usize; 8])> = None;
    for i in 0..kept.len() {
        for j in 0..i {
            let Some(width) = pairs.length(i, j) else { continue };
            for step in 0..14 {
                let stature = width / PARTS[0].share * 0.6 * 1.08_f64.powi(step);
                let is_possible = |unit_m: f64| (STATURES_M[0]..=STATURES_M[1]).contains(&(stature * unit_m));
                if stature <= 0.0 || !unit_m.is_none_or(is_possible) {
                    continue;
                }
                let shoulders = pairs.cost(i, j, PARTS[0].share, stature);
                if best.is_some_and(|it| it.0 <= shoulders) {
                    continue;
                }
                let found = put_together(&pairs, [i, j], stature);
                if let Some((cost, sites)) = found
                    && best.is_none_or(|it| cost + shoulders < it.0)
                {
                    best = Some((cost + shoulders, sites));
                }
            }
        }
    }
    let mut targets = best?.1.map(|it| kept[it]);
    let places: Vec<Places> = some(frames).map(|frame| targets.map(|it| frame[it])).collect();
    let found_sides = sides(&places);
    let votes = |at: usize| targets[at..].iter().step_by(2).filter(|it| is_left(**it) == Some(at == 2)).count();
    let is_exchanged = match found_sides {
        Sides::Exchanged => true,
        Sides::Right => false,
        Sides::Unknown => votes(2) + votes(3) < 3,
    };
    if is_exchanged {
        [2, 4, 6].into_iter().for_each(|it| targets.swap(it, it + 1));
    }
    Some(Guess { targets, knows_sides: found_sides != Sides::Unknown })
}

/// The cheapest body on two shoulders, without the cost of the shoulders.
fn put_together(pairs: &Pairs, [i, j]: [usize; 2], stature: f64) -> Option<(f64, [usize; 8])> {
    let middle = |site: usize, share: f64, up: f64| {
        let distance = pairs.cost(i, site, share, stature) + pairs.cost(j, site, share, stature);
        let heights = [i, j].map(|it| pairs.height_cost(site, it, up, stature, 0.2));
        distance + (heights[0] + heights[1]) / 2.0
    };
    let heads = pairs.best([i, j], |it| middle(it, PARTS[5].share, HEAD_UP));
    let waists = pairs.best([i, j], |it| middle(it, PARTS[7].share, WAIST_UP));
    let [left, right] = [pairs.arms(i, j, stature), pairs.arms(j, i, stature)];
    let mut best: Option<(f64, [usize; 8])> = None;
    for (head_cost, head) in &heads {
        for (waist_cost, waist) in waists.iter().filter(|it| it.1 != *head) {
            for (left_cost, [le, lw]) in &left {
                for (right_cost, [re, rw]) in &right {
                    let others = [*head, *waist, *le, *lw, *re, *rw];
                    if (0..6).any(|it| others[..it].contains(&others[it])) {
                        continue;
                    }
                    let uneven = |a: [usize; 2], b: [usize; 2]| {
                        let [a, b] = [a, b].map(|it| pairs.length(it[0], it[1]).unwrap_or(0.0).max(1e-9));
                        ((a / b).ln() / 0.08).powi(2).min(WORST)
                    };
                    let cost = head_cost
                        + waist_cost
                        + left_cost
                        + right_cost
                        + uneven([i, *le], [j, *re])
                        + uneven([*le, *lw], [*re, *rw]);
                    if best.is_none_or(|it| cost < it.0) {
                        best = Some((cost, [*head, *waist, i, j, *le, *re, *lw, *rw]));
                    }
                }
            }
        }
    }
    best
}
