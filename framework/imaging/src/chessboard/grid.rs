//! Joins saddles to the grid of a chessboard's corners.

use std::collections::{BTreeMap, VecDeque};

use nalgebra::{Point2, Vector2};

use super::saddles::{Plane, Saddle};

/// A whole rectangle of corners, row by row.
#[derive(Debug, Clone)]
pub(super) struct Grid {
    pub width: usize,
    pub height: usize,
    pub corners: Vec<Point2<f64>>,
}

/// Saddles from which a grid is grown, at most.
const MAX_SEEDS: usize = 400;
/// A corner is at most this part of a step from where its neighbours let it be expected.
const TOLERANCE: f64 = 0.35;
/// Part of the corners that must have been seen; the rest is supplied by their neighbours.
const SEEN: f64 = 0.8;
/// Cosine of the angle between a neighbour's direction and that of an edge, at least.
const ALONG: f64 = 0.9;
/// Of the steps to both sides of the corner from which a grid is grown, the shorter over the longer, at least.
const ALIKE: f64 = 0.6;
const SIDES: [(i32, i32); 4] = [(1, 0), (0, 1), (-1, 0), (0, -1)];

type Labels = BTreeMap<(i32, i32), usize>;

/// The first grid of `columns` × `rows`, either way round, that grows from one of the saddles.
pub(super) fn grow(plane: &Plane, saddles: &[Saddle], columns: usize, rows: usize) -> Option<Grid> {
    if (saddles.len() as f64) < SEEN * (columns * rows) as f64 {
        return None;
    }
    let mut tried = vec![false; saddles.len()];
    for seed in 0..saddles.len().min(MAX_SEEDS) {
        if tried[seed] {
            continue;
        }
        let labels = from_seed(saddles, seed);
        labels.values().for_each(|it| tried[*it] = true);
        tried[seed] = true;
        if (labels.len() as f64) < SEEN * (columns * rows) as f64 {
            continue;
        }
        let found = window(&labels, columns, rows).or_else(|| window(&labels, rows, columns));
        if let Some(grid) = found.and_then(|it| filled(plane, saddles, &labels, it)) {
            return Some(grid);
        }
    }
    None
}

/// Width and height of the largest grid that grows from one of the saddles, the larger first.
pub(super) fn largest(saddles: &[Saddle]) -> Option<[usize; 2]> {
    let mut tried = vec![false; saddles.len()];
    let mut best = None;
    for seed in 0..saddles.len().min(MAX_SEEDS) {
        if !std::mem::replace(&mut tried[seed], true) {
            let labels = from_seed(saddles, seed);
            labels.values().for_each(|it| tried[*it] = true);
            best = best.max(extent(&labels).map(|it| (it[0] * it[1], it)));
        }
    }
    best.map(|it| it.1)
}

/// Of the rows and columns that are there for the most part, how many; `None` for fewer than 3 either way, or with gaps.
fn extent(labels: &Labels) -> Option<[usize; 2]> {
    let count = |of: &dyn Fn(&(i32, i32)) -> i32| {
        let mut counts: BTreeMap<i32, usize> = BTreeMap::new();
        labels.keys().for_each(|it| *counts.entry(of(it)).or_default() += 1);
        counts
    };
    let (columns, rows) = (count(&|it| it.0), count(&|it| it.1));
    let full = |counts: &BTreeMap<i32, usize>| {
        let most = counts.values().copied().max().unwrap_or(0);
        let kept: Vec<i32> = counts.iter().filter(|it| 2 * *it.1 > most).map(|it| *it.0).collect();
        Some((*kept.first()?, *kept.last()?))
    };
    let ((left, right), (top, bottom)) = (full(&columns)?, full(&rows)?);
    let (width, height) = ((right - left + 1) as usize, (bottom - top + 1) as usize);
    let inside = labels.keys().filter(|(x, y)| (left..=right).contains(x) && (top..=bottom).contains(y)).count();
    let is_grid = width.min(height) >= 3 && inside as f64 >= SEEN * (width * height) as f64;
    is_grid.then_some([width.max(height), width.min(height)])
}

/// Whether `b` can be the neighbour of `a` in some direction: its bright quadrants lie where the dark ones of `a` do.
fn opposed(a: &Saddle, b: &Saddle) -> bool {
    let weaker = a.strength.min(b.strength) > 0.15 * a.strength.max(b.strength);
    weaker && a.bright.dot(&b.bright).abs() < 0.64
}

fn from_seed(saddles: &[Saddle], seed: usize) -> Labels {
    let mut labels = Labels::from([((0, 0), seed)]);
    let own = &saddles[seed];
    for (side, direction) in SIDES.into_iter().zip([own.edges[0], own.edges[1], -own.edges[0], -own.edges[1]]) {
        let neighbours = saddles.iter().enumerate().filter(|(_, it)| {
            let step = it.centre - own.centre;
            let far = step.norm();
            let along = |edge: &Vector2<f64>| edge.dot(&step).abs() > ALONG * far;
            far > 3.0 && step.dot(&direction) > ALONG * far && opposed(own, it) && it.edges.iter().any(along)
        });
        let nearest =
            neighbours.min_by(|a, b| (a.1.centre - own.centre).norm().total_cmp(&(b.1.centre - own.centre).norm()));
        if let Some((at, _)) = nearest
            && !labels.values().any(|it| *it == at)
        {
            labels.insert(side, at);
        }
    }
    // Squares of one board are alike on both sides of a corner.
    let far = |side: (i32, i32)| labels.get(&side).map(|it| (saddles[*it].centre - own.centre).norm());
    let alike = |a: Option<f64>, b: Option<f64>| a.zip(b).is_none_or(|(a, b)| a.min(b) > ALIKE * a.max(b));
    if labels.len() < 4 || !alike(far(SIDES[0]), far(SIDES[2])) || !alike(far(SIDES[1]), far(SIDES[3])) {
        return labels;
    }
    let mut used: Vec<bool> = vec![false; saddles.len()];
    labels.values().for_each(|it| used[*it] = true);
    let mut waiting: VecDeque<(i32, i32)> = labels.keys().copied().collect();
    while let Some(at) = waiting.pop_front() {
        for side in SIDES {
            let next = (at.0 + side.0, at.1 + side.1);
            if labels.contains_key(&next) {
                continue;
            }
            let Some(step) = expected_step(saddles, &labels, at, side) else { continue };
            let from = &saddles[labels[&at]];
            let expected = from.centre + step;
            let near = saddles.iter().enumerate().filter(|(index, it)| !used[*index] && opposed(from, it));
            let nearest = near.min_by(|a, b| (a.1.centre - expected).norm().total_cmp(&(b.1.centre - expected).norm()));
            if let Some((index, found)) = nearest
                && (found.centre - expected).norm() < TOLERANCE * step.norm()
            {
                used[index] = true;
                labels.insert(next, index);
                waiting.push_back(next);
                // What was expected too far away before may be near now.
                waiting
                    .extend(SIDES.iter().map(|it| (next.0 + it.0, next.1 + it.1)).filter(|it| labels.contains_key(it)));
            }
        }
    }
    labels
}

/// The step from a corner to one side, as the corners around it let expect: the step before, and those of the rows beside.
fn expected_step(saddles: &[Saddle], labels: &Labels, at: (i32, i32), side: (i32, i32)) -> Option<Vector2<f64>> {
    let centre = |x: i32, y: i32| labels.get(&(x, y)).map(|it| saddles[*it].centre);
    let own = centre(at.0, at.1)?;
    let across = (side.1, side.0);
    let (mut sum, mut weights) = (Vector2::zeros(), 0.0);
    if let Some(behind) = centre(at.0 - side.0, at.1 - side.1) {
        // Steps shrink towards the horizon as they did before.
        let before = own - behind;
        let step = centre(at.0 - 2 * side.0, at.1 - 2 * side.1).map_or(before, |it| {
            let ratio = (before.norm() / (behind - it).norm()).clamp(0.7, 1.4);
            before * ratio
        });
        (sum, weights) = (sum + step, weights + 1.0);
    }
    for sign in [1, -1] {
        let beside = (at.0 + sign * across.0, at.1 + sign * across.1);
        if let (Some(from), Some(to)) = (centre(beside.0, beside.1), centre(beside.0 + side.0, beside.1 + side.1)) {
            (sum, weights) = (sum + (to - from), weights + 1.0);
        }
    }
    (weights > 0.0).then(|| sum / weights)
}

/// Left, top, width and height of the rectangle that holds enough corners, unless there are rows beyond it.
fn window(labels: &Labels, width: usize, height: usize) -> Option<(i32, i32, usize, usize)> {
    let (width_i, height_i) = (width as i32, height as i32);
    let count = |left: i32, top: i32, width: i32, height: i32| {
        labels.keys().filter(|(x, y)| (left..left + width).contains(x) && (top..top + height).contains(y)).count()
    };
    let (left, right) = labels.keys().fold((0, 0), |range, it| (range.0.min(it.0), range.1.max(it.0)));
    let (top, bottom) = labels.keys().fold((0, 0), |range, it| (range.0.min(it.1), range.1.max(it.1)));
    let places = (left - 1..=right.max(left)).flat_map(|x| (top - 1..=bottom.max(top)).map(move |y| (x, y)));
    let (seen, (x, y)) = places.map(|it| (count(it.0, it.1, width_i, height_i), it)).max_by_key(|it| it.0)?;
    let rival = [(x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)]
        .into_iter()
        .map(|it| count(it.0, it.1, width_i, height_i))
        .max()?;
    let beyond =
        [count(x - 1, y, 1, height_i), count(x + width_i, y, 1, height_i)].into_iter().any(|it| 2 * it > height)
            || [count(x, y - 1, width_i, 1), count(x, y + height_i, width_i, 1)].into_iter().any(|it| 2 * it > width);
    let enough = seen as f64 >= SEEN * (width * height) as f64;
    (enough && rival < seen && !beyond).then_some((x, y, width, height))
}

/// The rectangle with what is missing in it supplied from both sides, or by going on from one.
fn filled(
    plane: &Plane,
    saddles: &[Saddle],
    labels: &Labels,
    (left, top, width, height): (i32, i32, usize, usize),
) -> Option<Grid> {
    let mut places: BTreeMap<(i32, i32), Point2<f64>> =
        labels.iter().map(|(at, it)| (*at, saddles[*it].centre)).collect();
    let inside = |place: &Point2<f64>| plane.at(*place).is_some();
    for _ in 0..width + height {
        let mut added = false;
        for y in top..top + height as i32 {
            for x in left..left + width as i32 {
                if places.contains_key(&(x, y)) {
                    continue;
                }
                let get = |dx: i32, dy: i32| places.get(&(x + dx, y + dy)).copied();
                let between = |(dx, dy): (i32, i32)| Some(nalgebra::center(&get(dx, dy)?, &get(-dx, -dy)?));
                let onward = |(dx, dy): (i32, i32)| Some(get(dx, dy)? + (get(dx, dy)? - get(2 * dx, 2 * dy)?));
                let guesses: Vec<Point2<f64>> =
                    match SIDES[..2].iter().filter_map(|it| between(*it)).collect::<Vec<_>>() {
                        both if !both.is_empty() => both,
                        _ => SIDES.iter().filter_map(|it| onward(*it)).collect(),
                    };
                if guesses.is_empty() {
                    continue;
                }
                let mean = guesses.iter().fold(Vector2::zeros(), |sum, it| sum + it.coords) / guesses.len() as f64;
                places.insert((x, y), mean.into());
                added = true;
            }
        }
        if !added {
            break;
        }
    }
    let all = (top..top + height as i32).flat_map(|y| (left..left + width as i32).map(move |x| (x, y)));
    let corners: Vec<Point2<f64>> = all.map(|it| places.get(&it).copied().filter(inside)).collect::<Option<_>>()?;
    Some(Grid { width, height, corners })
}
