//! The number of cameras that saw each target over time: a strip per target, darker for more cameras.

use foveate::plot::axes::Range;
use foveate::plot::colours::shade;
use foveate::plot::svg::Pen;
use foveate::plot::ticks::round_step;
use foveate::plot::{Axis, Chart, Figure, Marks, Series};

use super::{Coloured, INK, Subject};
use crate::track_history::Sample;

const WIDTH: f64 = 660.0;
const ROW: f64 = 21.0;
const TOTAL_HEIGHT: f64 = 120.0;
/// Strips drawn at most.
const STRIPS_LIMIT: usize = 24;
/// Narrowest bin [s]: a round of unsynchronised cameras.
const NARROWEST_BIN_S: f64 = 0.05;
const BINS_LIMIT: f64 = 370.0;
/// Tracked, but seen by no camera.
const UNSEEN: &str = "#e2d9cf";

/// Cameras for each target, and for all of them together.
pub(crate) fn cameras(subject: &Subject<'_>, span: (f64, f64)) -> String {
    let x = Range { min: span.0, max: span.1 }.widened(0.01);
    let bin_s = round_step((x.length() / BINS_LIMIT).max(NARROWEST_BIN_S));
    let mut shown: Vec<&Coloured<'_>> = subject.tracks.iter().chain(&subject.others).take(STRIPS_LIMIT).collect();
    shown.sort_by_key(|it| it.id);
    let n_more = subject.tracks.len() + subject.others.len() - shown.len() + subject.n_left_out as usize;
    let strips: Vec<Vec<Cell>> = shown.iter().map(|it| cells(&it.track.samples, bin_s)).collect();
    let most = strips.iter().flatten().map(|it| it.count).max().unwrap_or(0);
    let shades: Vec<String> = (0..=most).map(|count| shade_of(count, most)).collect();
    // At most ten of the shades are explained.
    let is_explained = |count: u32| count == 0 || (count - 1).is_multiple_of(most.div_ceil(10).max(1));
    let name = |count: u32| match count {
        0 => "no camera: predicted".to_owned(),
        1 => "1 camera".to_owned(),
        _ => format!("{count} cameras"),
    };
    let series = shades.iter().zip(0..).map(|(colour, count)| {
        let name = if is_explained(count) { name(count) } else { String::new() };
        let of_row = |(row, strip): (usize, &Vec<Cell>)| {
            let runs = strip.chunk_by(|a, b| a.count == b.count && a.bin + 1 == b.bin);
            let of_count = runs.filter(|run| run[0].count == count);
            let area = |run: &[Cell]| {
                let [from, to] = [run[0].bin, run[run.len() - 1].bin + 1].map(|it| it as f64 * bin_s);
                let [top, bottom] = [-0.36, 0.36].map(|it| Axis::row(row) + it);
                vec![[from, top], [to, top], [to, bottom], [from, bottom]]
            };
            of_count.map(area).collect::<Vec<_>>()
        };
        let pieces = strips.iter().enumerate().flat_map(of_row).collect();
        Series { pieces, ..Series::new(name, Marks::Areas(1.0), Pen::new(colour, 1.0), Vec::new()) }
    });
    let rows = Axis::of_rows(shown.iter().map(|it| format!("target {}", it.id.0)));
    let time = || Axis::new("time [s]").over(x.min, x.max);
    let height = ROW * shown.len().max(3) as f64;
    let targets = Chart { series: series.collect(), ..Chart::new("", [WIDTH, height], time().hidden(), rows) };
    let left_out = if n_more > 0 { format!("; {n_more} shorter tracks left out") } else { String::new() };
    let title = format!("{}: cameras that saw each target, in steps of {bin_s} s{left_out}", subject.name);
    let charts = vec![targets.if_empty("no targets"), total(subject, time(), bin_s)];
    Figure { title, n_columns: 1, charts }.svg()
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
fn total(subject: &Subject<'_>, time: Axis, bin_s: f64) -> Chart<'static> {
    let mut all: Vec<Cell> = subject.all().flat_map(|it| cells(&it.track.samples, bin_s)).collect();
    all.sort_by_key(|it| it.bin);
    let bins: Vec<(i64, u32)> = all
        .chunk_by(|a, b| a.bin == b.bin)
        .filter_map(|chunk| Some((chunk.first()?.bin, chunk.iter().fold(0, |bits, it| bits | it.cameras).count_ones())))
        .collect();
    let most = bins.iter().map(|it| it.1).max().unwrap_or(1).max(subject.cameras.len().min(128) as u32);
    let steps = |run: &[(i64, u32)]| {
        let edges = run.iter().flat_map(|&(bin, count)| [bin, bin + 1].map(|it| [it as f64 * bin_s, f64::from(count)]));
        edges.collect::<Vec<_>>()
    };
    let pieces = bins.chunk_by(|a, b| a.0 + 1 == b.0).map(steps).collect();
    let y = Axis::new("cameras [–]").over(0.0, 1.08 * f64::from(most)).whole();
    let line = Series { pieces, ..Series::line("any target", INK, Vec::new()) };
    Chart::new("", [WIDTH, TOTAL_HEIGHT], time, y).with(line).if_empty("no targets")
}

/// Darker for more cameras.
fn shade_of(count: u32, most: u32) -> String {
    match count {
        0 => UNSEEN.to_owned(),
        _ if most > 1 => shade(f64::from(count - 1) / f64::from(most - 1)),
        _ => shade(1.0),
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
