//! Numbers above columns, by their figures and the holes in these.

use super::TargetPattern;
use super::apart;
use super::patches::{Dark, DarkPatch, Group};

/// What was read.
pub(super) struct Reading {
    /// The number of the leftmost column, if it is beyond doubt.
    pub first: Option<usize>,
    /// Columns that agree with the best numbering and with the next, each counting as much as its figures are large.
    pub votes: [f64; 2],
}

/// Holes in the figures 0 to 9 as most typefaces have them; an open 4 has none.
const HOLES: [usize; 10] = [1, 0, 0, 0, 1, 0, 1, 0, 2, 1];
/// The best numbering must agree with this part of what was read,
const AGREEING: f64 = 0.6;
/// and be ahead of the next by so much of one large number.
const AHEAD: f64 = 0.8;
/// A figure is at least this high beside the rectangles of its column, and at most.
const HEIGHTS: std::ops::Range<f64> = 0.35..2.0;
/// Pixels of a figure, at least.
const LEAST_AREA: u32 = 12;
/// A hole has at least this part of the figure's box.
const LEAST_HOLE: f64 = 0.012;
/// Where figures are above the first rectangle, in steps of the column.
const ABOVE: std::ops::Range<f64> = 0.4..1.5;

/// Figures and holes of a number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Looks {
    figures: usize,
    holes: usize,
}

fn looks_of(number: usize) -> Looks {
    let (mut rest, mut looks) = (number, Looks { figures: 0, holes: 0 });
    while rest > 0 {
        looks.figures += 1;
        looks.holes += HOLES[rest % 10];
        rest /= 10;
    }
    looks
}

/// How far what was seen speaks for a number: 1 in full, −1 against it.
fn agreement(seen: Looks, number: usize) -> f64 {
    let expected = looks_of(number);
    match (seen.figures == expected.figures, seen.holes == expected.holes) {
        (true, true) => 1.0,
        // Figures that touch, a hole that print or glare has closed: little either way.
        (true, false) if seen.holes < expected.holes => -0.3,
        _ => -1.0,
    }
}

pub(super) fn read(dark: &Dark<'_>, patches: &[DarkPatch], chains: &[Vec<usize>], pattern: TargetPattern) -> Reading {
    let seen: Vec<Option<(Looks, f64)>> = (0..chains.len()).map(|it| above(dark, patches, chains, it)).collect();
    let largest = seen.iter().flatten().map(|it| it.1).fold(0.0, f64::max);
    let mut scores: Vec<(f64, f64, usize)> = Vec::new();
    for first in 1..=pattern.columns {
        let (mut score, mut weights) = (0.0, 0.0);
        for (index, seen) in seen.iter().enumerate() {
            let Some((looks, size)) = seen else { continue };
            let number = (first - 1 + index) % pattern.columns + 1;
            let weight = size / largest;
            score += weight * agreement(*looks, number);
            weights += weight;
        }
        scores.push((score, weights, first));
    }
    scores.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.2.cmp(&b.2)));
    let Some(&(best, weights, first)) = scores.first() else { return Reading { first: None, votes: [0.0; 2] } };
    let next = scores.get(1).map_or(f64::NEG_INFINITY, |it| it.0);
    let sure = best >= AGREEING * weights && best - next >= AHEAD && weights > 0.0;
    Reading { first: sure.then_some(first), votes: [best, next.max(0.0)] }
}

/// What stands above a column, and how large it is seen: its height times the room between columns, which is narrow where they are turned away [px²].
fn above(dark: &Dark<'_>, patches: &[DarkPatch], chains: &[Vec<usize>], index: usize) -> Option<(Looks, f64)> {
    let chain = &chains[index];
    let (top, second) = (&patches[chain[0]], &patches[chain[1]]);
    let step = apart(&top.centre, &second.centre);
    // To the nearer neighbour on either side at the top.
    let to_neighbour = |other: Option<&Vec<usize>>| other.map(|it| (patches[it[0]].centre.x - top.centre.x).abs());
    let beside = [index.checked_sub(1).and_then(|it| chains.get(it)), chains.get(index + 1)];
    let room = beside.into_iter().filter_map(to_neighbour).fold(f64::INFINITY, f64::min);
    let half = if room.is_finite() { 0.47 * room } else { step };
    let lean = (second.centre.x - top.centre.x) / (second.centre.y - top.centre.y);
    let is_figure = |it: &&Group| {
        let up = top.centre.y - it.mean.y;
        let sideways = it.mean.x - (top.centre.x - lean * up);
        let height = it.height() as f64 / f64::from(top.size[1]);
        it.area >= LEAST_AREA
            && ABOVE.contains(&(up / step))
            && sideways.abs() < half
            && HEIGHTS.contains(&height)
            && (it.width() as f64) < 2.0 * half
    };
    let figures: Vec<&Group> = dark.groups.iter().filter(is_figure).collect();
    let height = figures.iter().map(|it| it.height()).max()?;
    // Dirt beside a number is not as high.
    let figures: Vec<&&Group> = figures.iter().filter(|it| 10 * it.height() >= 7 * height).collect();
    if figures.len() > 2 {
        return None;
    }
    let holes = figures.iter().map(|it| holes(dark, it)).sum();
    Some((Looks { figures: figures.len(), holes }, height as f64 * half))
}

/// Bright parts of a figure's box that are shut off from its outside.
fn holes(dark: &Dark<'_>, figure: &Group) -> usize {
    let [left, top, ..] = figure.bounds;
    // A frame of bright pixels around the box joins all that is outside.
    let (width, height) = (figure.width() + 2, figure.height() + 2);
    let is_bright = |x: usize, y: usize| {
        let framed = x == 0 || y == 0 || x == width - 1 || y == height - 1;
        framed || !dark.is_dark(left + x - 1, top + y - 1)
    };
    let mut taken = vec![false; width * height];
    let mut frontier = Vec::new();
    let mut count = 0;
    for first in 0..width * height {
        if taken[first] || !is_bright(first % width, first / width) {
            continue;
        }
        taken[first] = true;
        frontier.push(first);
        let mut area = 0usize;
        while let Some(at) = frontier.pop() {
            area += 1;
            let (x, y) = (at % width, at / width);
            for (u, v) in [(x.wrapping_sub(1), y), (x + 1, y), (x, y.wrapping_sub(1)), (x, y + 1)] {
                if u < width && v < height && !taken[v * width + u] && is_bright(u, v) {
                    taken[v * width + u] = true;
                    frontier.push(v * width + u);
                }
            }
        }
        // The first one is the outside.
        let large = area as f64 >= LEAST_HOLE * (width * height) as f64;
        count += usize::from(first > 0 && large);
    }
    count
}
