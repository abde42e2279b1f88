//! Layout: columns in the order of the data, one lane per scale, routes for the edges between the boxes.
//!
//! All numbers are px of the drawing.

use std::collections::BTreeMap;

use foveate_plot::svg::Rect;
use foveate_plot::text::text_width;

use super::order::{Join, Slot, arrange};
use super::{Link, Sketch, Step};

/// Height of a box.
pub(super) const BOX_HEIGHT: f64 = 46.0;
/// Room between boxes of one column.
const ROW_GAP: f64 = 22.0;
/// Room between columns, for the edges.
const COLUMN_GAP: f64 = 96.0;
/// Height of the route of an edge past a column.
const WAY_HEIGHT: f64 = 4.0;
/// Room for a scale's name.
const HEADER: f64 = 40.0;
/// Room around what lies in a scale.
const PADDING: f64 = 18.0;
/// Room between two backward edges.
const CHANNEL: f64 = 18.0;
/// Bends that are drawn: a graph with more has its long edges drawn straight.
const MOST_BENDS: usize = 20_000;

/// The route of a link.
#[derive(Debug, Clone)]
pub(super) enum Way {
    /// From left to right through these points.
    Forward(Vec<(f64, f64)>),
    /// Out to the right, along a level, and in from the left.
    Around { from: (f64, f64), level: f64, to: (f64, f64) },
}

/// Places of everything.
pub(super) struct Layout {
    /// By node.
    pub boxes: Vec<Rect>,
    /// By scale.
    pub frames: Vec<Rect>,
    /// By link.
    pub ways: Vec<Way>,
    pub width: f64,
    pub height: f64,
}

/// Places a sketch below `top`.
pub(super) fn place(sketch: &Sketch<'_>, top: f64) -> Layout {
    let columns = columns(sketch);
    let widths: Vec<f64> = sketch
        .nodes
        .iter()
        .map(|it| {
            let count = if it.count > 1 { 14.0 + text_width(&it.count.to_string(), 11.0) + 12.0 } else { 0.0 };
            (text_width(it.name, 13.0) + count).max(text_width(it.type_name, 11.0)).max(96.0) + 24.0
        })
        .collect();
    let n_columns = columns.iter().map(|it| it + 1).max().unwrap_or(0);
    let mut column_width = vec![0.0_f64; n_columns];
    for (node, &column) in columns.iter().enumerate() {
        column_width[column] = column_width[column].max(widths[node]);
    }
    let deepest = sketch.walk().iter().fold((0_usize, 0_usize), |(depth, most), step| match step {
        Step::Into(_) => (depth + 1, most.max(depth + 1)),
        Step::OutOf(_) => (depth - 1, most),
    });
    let mut left = 24.0 + PADDING * deepest.1 as f64;
    let mut column_x = Vec::with_capacity(n_columns);
    for width in &column_width {
        column_x.push(left);
        left += width + COLUMN_GAP;
    }
    let lanes = lanes(sketch, &columns);
    let mut layout = Layout {
        boxes: vec![Rect::default(); sketch.nodes.len()],
        frames: vec![Rect::default(); sketch.scales.len()],
        ways: Vec::new(),
        width: 0.0,
        height: 0.0,
    };
    let mut lane_top = vec![0.0; sketch.scales.len()];
    let mut lane_height = vec![0.0; sketch.scales.len()];
    let mut y = top;
    for step in sketch.walk() {
        match step {
            Step::Into(scale) => {
                layout.frames[scale].top = y;
                y += HEADER;
                lane_top[scale] = y;
                lane_height[scale] = lanes[scale].height;
                let lane = &lanes[scale];
                for &(node, slot) in &lane.nodes {
                    let x = column_x[columns[node]] + (column_width[columns[node]] - widths[node]) / 2.0;
                    let centre = y + lane.slots[slot].y;
                    layout.boxes[node] =
                        Rect { left: x, top: centre - BOX_HEIGHT / 2.0, width: widths[node], height: BOX_HEIGHT };
                }
                let backward = lane.n_backward as f64;
                y += lane.height + if lane.n_backward > 0 { 6.0 + CHANNEL * backward } else { 0.0 };
                y += PADDING;
            }
            Step::OutOf(scale) => {
                let frame = layout.frames[scale];
                layout.frames[scale].height = y - frame.top;
                y += PADDING;
            }
        }
    }
    frame_widths(sketch, &mut layout);
    let right = layout.frames.iter().map(Rect::right).fold(0.0, f64::max);
    layout.width = right + 24.0;
    layout.height = y;
    layout.ways = ways(sketch, &layout, &lanes, &lane_top, &lane_height, &columns, &column_x, &column_width);
    layout
}

/// Columns: each node right of all that come before it in the schedule and give it something.
fn columns(sketch: &Sketch<'_>) -> Vec<usize> {
    let mut columns = vec![0; sketch.nodes.len()];
    let mut forward: Vec<(usize, usize)> =
        sketch.links.iter().map(|it| (it.from, it.to)).filter(|it| it.0 < it.1).collect();
    forward.sort_unstable();
    for (from, to) in forward {
        columns[to] = columns[to].max(columns[from] + 1);
    }
    columns
}

/// What stands in a scale.
#[derive(Default)]
struct Lane {
    slots: Vec<Slot>,
    /// Nodes and their slots.
    nodes: Vec<(usize, usize)>,
    /// By link: the slots of its route past other columns.
    bends: BTreeMap<usize, Vec<usize>>,
    height: f64,
    n_backward: usize,
}

fn lanes(sketch: &Sketch<'_>, columns: &[usize]) -> Vec<Lane> {
    let mut lanes: Vec<Lane> = sketch.scales.iter().map(|_| Lane::default()).collect();
    let mut slot_of = vec![0; sketch.nodes.len()];
    for (node, part) in sketch.nodes.iter().enumerate() {
        let lane = &mut lanes[part.scale];
        slot_of[node] = lane.slots.len();
        lane.nodes.push((node, lane.slots.len()));
        lane.slots.push(Slot { column: columns[node], height: BOX_HEIGHT, y: 0.0 });
    }
    let mut joins: Vec<Vec<Join>> = vec![Vec::new(); lanes.len()];
    let mut n_bends = 0;
    for (number, link) in sketch.links.iter().enumerate() {
        let (from, to) = (sketch.nodes[link.from].scale, sketch.nodes[link.to].scale);
        let lane = &mut lanes[from];
        if link.from >= link.to {
            lane.n_backward += 1;
            continue;
        }
        let mut before = slot_of[link.from];
        let span = columns[link.to].saturating_sub(columns[link.from] + 1);
        n_bends += span;
        if n_bends <= MOST_BENDS {
            for column in columns[link.from] + 1..columns[link.to] {
                let slot = lane.slots.len();
                lane.slots.push(Slot { column, height: WAY_HEIGHT, y: 0.0 });
                // A long way had better be straight.
                let weight = if lane.slots[before].height < BOX_HEIGHT { 8.0 } else { 1.0 };
                joins[from].push(Join { from: before, to: slot, weight });
                lane.bends.entry(number).or_default().push(slot);
                before = slot;
            }
        }
        if from == to && (span == 0 || n_bends <= MOST_BENDS) {
            joins[from].push(Join { from: before, to: slot_of[link.to], weight: 1.0 });
        }
    }
    for (lane, joins) in lanes.iter_mut().zip(&joins) {
        lane.height = arrange(&mut lane.slots, joins, ROW_GAP);
    }
    lanes
}

/// Frames as wide as what lies in them and their names; children before parents.
fn frame_widths(sketch: &Sketch<'_>, layout: &mut Layout) {
    let mut edges = vec![(f64::INFINITY, f64::NEG_INFINITY); sketch.scales.len()];
    for (node, part) in sketch.nodes.iter().enumerate() {
        let place = layout.boxes[node];
        let edge = &mut edges[part.scale];
        // Room for the labels of outputs and the turns of backward edges.
        *edge = (edge.0.min(place.left - 30.0), edge.1.max(place.right() + 30.0));
    }
    for (scale, frame) in sketch.scales.iter().enumerate().rev() {
        let (mut left, mut right) = edges[scale];
        if left > right {
            (left, right) = (24.0 + PADDING, 24.0 + PADDING);
        }
        let name = text_width(frame.name, 15.0) + text_width(&frame.about, 12.0) + 50.0;
        right = right.max(left + name);
        edges[scale] = (left, right);
        layout.frames[scale].left = left;
        layout.frames[scale].width = right - left;
        if let Some(parent) = frame.parent {
            let edge = &mut edges[parent];
            *edge = (edge.0.min(left - PADDING), edge.1.max(right + PADDING));
        }
    }
}

#[expect(clippy::too_many_arguments, reason = "the parts of one layout")]
fn ways(
    sketch: &Sketch<'_>,
    layout: &Layout,
    lanes: &[Lane],
    lane_top: &[f64],
    lane_height: &[f64],
    columns: &[usize],
    column_x: &[f64],
    column_width: &[f64],
) -> Vec<Way> {
    let other_end = |link: &Link<'_>, number: usize, node: usize, bend: Option<&usize>| {
        let lane = sketch.nodes[link.from].scale;
        match bend {
            _ if link.from >= link.to => f64::INFINITY,
            Some(&slot) => lane_top[lane] + lanes[lane].slots[slot].y,
            None => layout.boxes[node].top + number as f64 * 1e-6,
        }
    };
    let bends = |link: &Link<'_>, number: usize| lanes[sketch.nodes[link.from].scale].bends.get(&number);
    let links = || sketch.links.iter().enumerate();
    let outlets = spread(links().map(|(number, it)| {
        let first = bends(it, number).and_then(|it| it.first());
        (it.from, it.output, other_end(it, number, it.to, first))
    }));
    let inlets = spread(links().map(|(number, it)| {
        let last = bends(it, number).and_then(|it| it.last());
        (it.to, it.input, other_end(it, number, it.from, last))
    }));
    let mut used = vec![0_usize; lanes.len()];
    let mut ways = Vec::with_capacity(sketch.links.len());
    for (number, link) in sketch.links.iter().enumerate() {
        let (from_box, to_box) = (layout.boxes[link.from], layout.boxes[link.to]);
        let at = |place: &Rect, share: &BTreeMap<(usize, usize), f64>, key| {
            place.top + place.height * share.get(&key).copied().unwrap_or(0.5)
        };
        let from = (from_box.right(), at(&from_box, &outlets, (link.from, link.output)));
        let to = (to_box.left, at(&to_box, &inlets, (link.to, link.input)));
        let scale = sketch.nodes[link.from].scale;
        if link.from >= link.to {
            used[scale] += 1;
            let level = lane_top[scale] + lane_height[scale] + 2.0 + CHANNEL * used[scale] as f64;
            ways.push(Way::Around { from, level, to });
            continue;
        }
        let mut points = vec![from];
        // Behind the box, where the column is wider than it.
        points.push((column_x[columns[link.from]] + column_width[columns[link.from]], from.1));
        for &slot in lanes[scale].bends.get(&number).into_iter().flatten() {
            let slot = lanes[scale].slots[slot];
            let y = lane_top[scale] + slot.y;
            points.push((column_x[slot.column], y));
            points.push((column_x[slot.column] + column_width[slot.column], y));
        }
        points.push((column_x[columns[link.to]], to.1));
        points.push(to);
        ways.push(Way::Forward(points));
    }
    ways
}

/// Ports of a node in use, spread over its side in the order of where their edges come from or go to: where each lies,
/// as a fraction of the height.
fn spread(ports: impl Iterator<Item = (usize, usize, f64)>) -> BTreeMap<(usize, usize), f64> {
    let mut of_node: BTreeMap<usize, BTreeMap<usize, (f64, f64)>> = BTreeMap::new();
    for (node, port, y) in ports {
        let sum = of_node.entry(node).or_default().entry(port).or_default();
        *sum = (sum.0 + y, sum.1 + 1.0);
    }
    let mut shares = BTreeMap::new();
    for (node, ports) in of_node {
        let mut ports: Vec<(f64, usize)> = ports.into_iter().map(|(port, (sum, count))| (sum / count, port)).collect();
        ports.sort_by(|a, b| a.0.total_cmp(&b.0));
        let count = ports.len() as f64;
        for (index, (_, port)) in ports.into_iter().enumerate() {
            shares.insert((node, port), (index as f64 + 1.0) / (count + 1.0));
        }
    }
    shares
}
