//! How many cameras saw each target, over time: a strip a target, dark where many did.

use foveate::plot::axes::{Labels, Panel, Range};
use foveate::plot::colours::shade;
use foveate::plot::legend::{Key, LEGEND_WIDTH, LINE_HEIGHT, Legend};
use foveate::plot::svg::{Anchor, Pen, Point, Rect, SMALL, Svg};
use foveate::plot::ticks::round_step;

use super::{Coloured, Subject};
use crate::track_history::Sample;

const LEFT: f64 = 90.0;
const TOP: f64 = 46.0;
const WIDTH: f64 = 660.0;
const STRIP: f64 = 15.0;
const ROW: f64 = 21.0;
const TOTAL_HEIGHT: f64 = 120.0;
const BETWEEN: f64 = 34.0;
const BELOW: f64 = 56.0;
/// Strips drawn at most.
const STRIPS_LIMIT: usize = 24;
/// Narrowest bin [s]: a round of unsynchronised cameras.
const NARROWEST_BIN_S: f64 = 0.05;
const BINS_LIMIT: f64 = 370.0;
/// Known, but seen by none.
const UNSEEN: &str = "#e2d9cf";

/// Cameras for each target, and for all of them together.
pub(crate) fn cameras(subject: &Subject<'_>, span: (f64, f64)) -> String {
    let x = Range { min: span.0, max: span.1 }.widened(0.01);
    let bin_s = round_step((x.length() / BINS_LIMIT).max(NARROWEST_BIN_S));
    let mut shown: Vec<&Coloured<'_>> = subject.tracks.iter().chain(&subject.others).take(STRIPS_LIMIT).collect();
    shown.sort_by_key(|it| it.id);
    let n_more = subject.tracks.len() + subject.others.len() - shown.len() + subject.n_left_out as usize;
    let strips: Vec<Vec<Cell>> = shown.iter().map(|it| cells(&it.track.samples, bin_s)).collect();
    let strips_height = ROW * shown.len().max(1) as f64 + 6.0;
    let height = (TOP + strips_height + BETWEEN + TOTAL_HEIGHT + BELOW).max(TOP + 14.0 * LINE_HEIGHT);
    let title = format!("{}: cameras that saw each target, in steps of {bin_s} s", subject.name);
    let mut svg = Svg::new(LEFT + WIDTH + LEGEND_WIDTH + 20.0, height, &title);
    let most = strips.iter().flatten().map(|it| it.count).max().unwrap_or(0).max(1);

    let rect = Rect { left: LEFT, top: TOP, width: WIDTH, height: strips_height };
    let panel = Panel::new(rect, x, Range { min: 0.0, max: 1.0 });
    for (row, (it, strip)) in shown.iter().zip(&strips).enumerate() {
        let top = TOP + 6.0 + row as f64 * ROW;
        svg.text([LEFT - 8.0, top + STRIP - 3.5], Anchor::End, SMALL, &format!("target {}", it.id.0));
        for run in strip.chunk_by(|a, b| a.count == b.count && a.bin + 1 == b.bin) {
            let (Some(first), Some(last)) = (run.first(), run.last()) else { continue };
            let [left, _] = panel.place((first.bin as f64 * bin_s).max(x.min), 0.0);
            let [right, _] = panel.place(((last.bin + 1) as f64 * bin_s).min(x.max), 0.0);
            let cell = Rect { left, top, width: (right - left).max(0.3), height: STRIP };
            svg.cells(&[cell], &shade_of(first.count, most));
        }
    }
    panel.frame(&mut svg);
    total(&mut svg, subject, x, bin_s, rect.bottom() + BETWEEN);
    key(&mut svg, most, n_more, [LEFT + WIDTH + 20.0, TOP]);
    svg.finish()
}

/// One bin of one target.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Cell {
    bin: i64,
    cameras: u128,
    count: u32,
}

fn cells(samples: &[Sample], bin_s: f64) -> Vec<Cell> {
    let bin = |it: &Sample| (it.time_s / bin_s).floor() as i64;
    samples
        .chunk_by(|a, b| bin(a) == bin(b))
        .filter_map(|chunk| {
            let cameras = chunk.iter().fold(0, |bits, it| bits | it.cameras);
            Some(Cell { bin: bin(chunk.first()?), cameras, count: cameras.count_ones() })
        })
        .collect()
}

/// A step line of the cameras that saw any target at all.
fn total(svg: &mut Svg, subject: &Subject<'_>, x: Range, bin_s: f64, top: f64) {
    let mut all: Vec<Cell> = subject.all().flat_map(|it| cells(&it.track.samples, bin_s)).collect();
    all.sort_by_key(|it| it.bin);
    let bins: Vec<(i64, u32)> = all
        .chunk_by(|a, b| a.bin == b.bin)
        .filter_map(|chunk| Some((chunk.first()?.bin, chunk.iter().fold(0, |bits, it| bits | it.cameras).count_ones())))
        .collect();
    let most = bins.iter().map(|it| it.1).max().unwrap_or(1).max(subject.cameras.len().min(128) as u32);
    let y = Range { min: 0.0, max: f64::from(most) * 1.08 };
    let panel = Panel::new(Rect { left: LEFT, top, width: WIDTH, height: TOTAL_HEIGHT }, x, y);
    let steps = [None, Some(round_step((f64::from(most) / 5.0).max(1.0)))];
    panel.background(svg, Labels { steps, ..Labels::new(Some("time [s]"), "cameras [–]") });
    let mut pieces: Vec<Vec<Point>> = Vec::new();
    for run in bins.chunk_by(|a, b| a.0 + 1 == b.0) {
        let steps = run
            .iter()
            .flat_map(|&(bin, count)| [bin, bin + 1].map(|edge| panel.place(edge as f64 * bin_s, f64::from(count))));
        pieces.push(steps.collect());
    }
    svg.within(panel.rect, |svg| svg.lines(&pieces, Pen::new(svg.theme().ink, 1.2)));
    panel.frame(svg);
}

/// Darker for more cameras.
fn shade_of(count: u32, most: u32) -> String {
    match count {
        0 => UNSEEN.to_owned(),
        _ if most > 1 => shade(f64::from(count - 1) / f64::from(most - 1)),
        _ => shade(1.0),
    }
}

/// The shades, at most ten of them.
fn key(svg: &mut Svg, most: u32, n_more: usize, at: Point) {
    let mut legend = Legend::at(at);
    legend.heading(svg, "cameras of a target");
    let step = most.div_ceil(10).max(1);
    for count in std::iter::once(0).chain((1..=most).step_by(step as usize)) {
        let text = if count == 0 { "none: predicted".to_owned() } else { count.to_string() };
        legend.entry(svg, Key::Swatch(&shade_of(count, most), 1.0), &text);
    }
    if n_more > 0 {
        legend.words(svg, &format!("{n_more} shorter tracks left out"));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_of_a_bin_are_counted_once() {
        let sample = |time_s: f64, cameras: u128| Sample {
            time_s,
            position: [0.0; 3],
            sigma: [0.0; 3],
            cameras,
            measured: true,
        };
        let found = cells(&[sample(0.0, 0b11), sample(0.05, 0b110), sample(0.11, 0), sample(0.35, 1 << 127)], 0.1);
        let counts: Vec<(i64, u32)> = found.iter().map(|it| (it.bin, it.count)).collect();
        assert_eq!(counts, [(0, 3), (1, 0), (3, 1)]);
    }

    #[test]
    fn most_cameras_are_darkest_and_none_is_no_shade() {
        assert_eq!([shade_of(1, 1), shade_of(18, 18)], [shade(1.0), shade(1.0)]);
        assert_eq!([shade_of(1, 18), shade_of(0, 18)], [shade(0.0), UNSEEN.to_owned()]);
    }
}
