//! Position over time: one panel an axis, with a band of two standard deviations.

use foveate::plot::axes::{Labels, Panel, Range};
use foveate::plot::legend::{Key, LEGEND_WIDTH, Legend};
use foveate::plot::svg::{Point, Rect, Svg};
use foveate::plot::thin::{FIGURE_POINTS, thin_courses};

use super::space::{draw_tracks, tracks};
use super::{Coloured, Subject, TRUTH};
use crate::track_history::Sample;

const LEFT: f64 = 76.0;
const TOP: f64 = 46.0;
/// Least and largest width of a panel [px]: long runs get more, but no more than can be read on a small screen.
const WIDTH: [f64; 2] = [660.0, 860.0];
/// What a second should have [px].
const WIDTH_A_SECOND: f64 = 18.0;
const HEIGHT: f64 = 170.0;
const BETWEEN: f64 = 16.0;
const BELOW: f64 = 50.0;
/// Narrowest column of a band [px]; bands are smooth, and seldom looked at closely.
const BAND_COLUMN: f64 = 2.0;
/// Columns of all bands of a panel.
const BAND_LIMIT: usize = 4000;

/// x, y and z against time.
pub(crate) fn position(subject: &Subject<'_>, span: (f64, f64)) -> String {
    let x = Range { min: span.0, max: span.1 }.widened(0.01);
    let width = (x.length() * WIDTH_A_SECOND).clamp(WIDTH[0], WIDTH[1]).round();
    let height = (TOP + 3.0 * HEIGHT + 2.0 * BETWEEN + BELOW).max(TOP + subject.legend_height(1));
    let mut svg =
        Svg::new(LEFT + width + LEGEND_WIDTH + 20.0, height, &format!("{}: position over time", subject.name));
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let top = TOP + axis as f64 * (HEIGHT + BETWEEN);
        let rect = Rect { left: LEFT, top, width, height: HEIGHT };
        let panel = Panel::new(rect, x, range(subject, axis));
        let label = format!("{name} [{}]", subject.unit);
        panel.background(&mut svg, Labels::new((axis == 2).then_some("time [s]"), &label));
        svg.within(rect, |svg| courses(svg, subject, axis, &panel));
        panel.frame(&mut svg);
    }
    let mut legend = Legend::at([LEFT + width + 20.0, TOP]);
    subject.tracks_legend(&mut legend, &mut svg);
    let ink = svg.theme().ink;
    legend.entry(&mut svg, Key::Swatch(ink, 0.18), "\u{b1}2\u{3c3}");
    svg.finish()
}

fn range(subject: &Subject<'_>, axis: usize) -> Range {
    let tracks = subject.all().map(|it| it.track).chain(subject.truth.iter().copied());
    let mut values: Vec<f64> = tracks.flat_map(|it| &it.samples).map(|it| f64::from(it.position[axis])).collect();
    Range::of_most(&mut values).unwrap_or(Range { min: -1.0, max: 1.0 }).widened(0.06)
}

fn courses(svg: &mut Svg, subject: &Subject<'_>, axis: usize, panel: &Panel) {
    let place = |it: &Sample| panel.place(it.time_s, f64::from(it.position[axis]));
    let truth_pieces = subject.truth.iter().flat_map(|it| it.pieces());
    let mut truth: Vec<Vec<Point>> = truth_pieces.map(|piece| piece.iter().map(place).collect()).collect();
    thin_courses(&mut truth, FIGURE_POINTS / 6);
    svg.lines(&truth, TRUTH);
    let column = BAND_COLUMN.max(panel.rect.width * subject.tracks.len() as f64 / BAND_LIMIT as f64);
    for it in &subject.tracks {
        bands(svg, it, axis, panel, column);
    }
    let (mut lines, pens) = tracks(subject, place);
    thin_courses(&mut lines, FIGURE_POINTS / 6);
    draw_tracks(svg, &lines, &pens);
}

/// Two standard deviations to either side, as wide in each column as its widest sample.
fn bands(svg: &mut Svg, it: &Coloured<'_>, axis: usize, panel: &Panel, column: f64) {
    for piece in it.track.pieces() {
        let place = |sample: &Sample, sigmas: f64| {
            panel.place(sample.time_s, f64::from(sample.position[axis]) + sigmas * f64::from(sample.sigma[axis]))
        };
        let column_of = |it: &Sample| (place(it, 0.0)[0] / column).floor();
        let (mut upper, mut lower) = (Vec::new(), Vec::new());
        for samples in piece.chunk_by(|a, b| column_of(a) == column_of(b)) {
            let x = samples.iter().map(|it| place(it, 0.0)[0]).sum::<f64>() / samples.len() as f64;
            upper.push([x, samples.iter().map(|it| place(it, 2.0)[1]).fold(f64::MAX, f64::min)]);
            lower.push([x, samples.iter().map(|it| place(it, -2.0)[1]).fold(f64::MIN, f64::max)]);
        }
        if upper.len() > 1 {
            upper.extend(lower.into_iter().rev());
            svg.area(&upper, it.colour, 0.18, None);
        }
    }
}
