//! Position over time: one panel an axis, with a band of two standard deviations.

use foveate::plot::axes::Range;
use foveate::plot::svg::{Pen, Point};
use foveate::plot::{Axis, Chart, Figure, Marks, Series};

use super::space::tracks;
use super::{Coloured, INK, MEASURED, PREDICTED, Subject, TRUTH};
use crate::track_history::Sample;

/// Least and largest width of a panel [px]: long runs get more, but no more than can be read on a small screen.
const WIDTH: [f64; 2] = [660.0, 860.0];
/// Width of a second [px].
const WIDTH_A_SECOND: f64 = 18.0;
const HEIGHT: f64 = 170.0;
/// Narrowest column of a band [px]; bands are smooth, so details are not needed.
const BAND_COLUMN: f64 = 2.0;
/// Columns of all bands of a panel.
const BAND_LIMIT: usize = 4000;

/// x, y and z against time.
pub(crate) fn position(subject: &Subject<'_>, span: (f64, f64)) -> String {
    let x = Range { min: span.0, max: span.1 }.widened(0.01);
    let width = (x.length() * WIDTH_A_SECOND).clamp(WIDTH[0], WIDTH[1]).round();
    let column_px = BAND_COLUMN.max(width * subject.tracks.len() as f64 / BAND_LIMIT as f64);
    let column_s = column_px / width * x.length();
    let chart = |(axis, name): (usize, &str)| {
        let time = Axis::new("time [s]").over(x.min, x.max);
        let time = if axis < 2 { time.hidden() } else { time };
        let Range { min, max } = range(subject, axis);
        let y = Axis::new(format!("{name} [{}]", subject.unit)).over(min, max);
        let series = courses(subject, axis, column_s);
        Chart { series, ..Chart::new("", [width, HEIGHT], time, y) }.if_empty("no targets")
    };
    let charts = ["x", "y", "z"].into_iter().enumerate().map(chart).collect();
    Figure { title: format!("{}: position over time", subject.name), n_columns: 1, charts }.svg()
}

fn range(subject: &Subject<'_>, axis: usize) -> Range {
    let tracks = subject.all().map(|it| it.track).chain(subject.truth.iter().copied());
    let mut values: Vec<f64> = tracks.flat_map(|it| &it.samples).map(|it| f64::from(it.position[axis])).collect();
    Range::of_most(&mut values).unwrap_or(Range { min: -1.0, max: 1.0 }).widened(0.06)
}

fn courses<'a>(subject: &Subject<'a>, axis: usize, column_s: f64) -> Vec<Series<'a>> {
    let place = |it: &Sample| [it.time_s, f64::from(it.position[axis])];
    let line = |name: String, pen, pieces| Series { pieces, ..Series::new(name, Marks::Line, pen, Vec::new()) };
    let truth = subject.truth.iter().flat_map(|it| it.pieces()).map(|piece| piece.iter().map(place).collect());
    let mut series = vec![line("truth".to_owned(), TRUTH, truth.collect())];
    series.retain(|_| !subject.truth.is_empty());
    for it in &subject.tracks {
        let pen = Pen::new(it.colour, 1.0);
        series.push(Series { marks: Marks::Areas(0.18), ..line(String::new(), pen, bands(it, axis, column_s)) });
    }
    for (name, pen, lines) in tracks(subject, place) {
        series.push(line(name, pen, lines));
    }
    let styles = [("measured", Pen::new(INK, MEASURED)), ("predicted", Pen::new(INK, MEASURED).dashed(PREDICTED))];
    series.extend(styles.map(|(name, pen)| line(name.to_owned(), pen, Vec::new())));
    series.push(Series::new("\u{b1}2\u{3c3}", Marks::Areas(0.18), Pen::new(INK, 1.0), Vec::new()));
    series
}

/// Two standard deviations to either side, as wide in each column of time as its widest sample.
fn bands(it: &Coloured<'_>, axis: usize, column_s: f64) -> Vec<Vec<Point>> {
    let band = |piece: &[Sample]| {
        let end = |it: &Sample, sigmas: f64| f64::from(it.position[axis]) + sigmas * f64::from(it.sigma[axis]);
        let column_of = |it: &Sample| (it.time_s / column_s).floor();
        let (mut upper, mut lower) = (Vec::new(), Vec::new());
        for samples in piece.chunk_by(|a, b| column_of(a) == column_of(b)) {
            let time_s = samples.iter().map(|it| it.time_s).sum::<f64>() / samples.len() as f64;
            upper.push([time_s, samples.iter().map(|it| end(it, 2.0)).fold(f64::MIN, f64::max)]);
            lower.push([time_s, samples.iter().map(|it| end(it, -2.0)).fold(f64::MAX, f64::min)]);
        }
        upper.extend(lower.into_iter().rev());
        upper
    };
    it.track.pieces().map(band).filter(|it| it.len() > 3).collect()
}
