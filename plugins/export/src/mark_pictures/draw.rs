//! The pictures themselves.

use foveate::estimation::statistics::median;
use foveate::plot::axes::Range;
use foveate::plot::colours::{REFERENCE, shade};
use foveate::plot::legend::{Key, LINE_HEIGHT, Legend};
use foveate::plot::svg::{Anchor, Pen, Point, SMALL, Svg};
use foveate::plot::{Axis, COLOURS, Chart, Figure, Marks, Series, nothing};

use super::course::{Course, Front, Moment, neighbours};

const WIDTH: f64 = 660.0;
/// Height of a panel with curves.
const HEIGHT: f64 = 170.0;
/// Least and greatest height of a view of the world.
const LOWEST: f64 = 130.0;
const HIGHEST: f64 = 800.0;
const OURS: &str = COLOURS[0];
const FILLED: &str = COLOURS[1];
/// Surfaces drawn over one another in the picture of the path, and number of them whose times the legend gives.
const OVERLAID: usize = 60;
const DATED: usize = 6;
/// Stills, in rows of four.
const STILLS: usize = 8;
/// Longest step of a line, in usual steps [–].
const LONGEST_STEPS: f64 = 4.5;
/// Marks of the pairs whose distances are drawn are this far apart on average [m].
const PAIRS: std::ops::Range<f64> = 0.015..0.09;
/// Text of an empty figure.
const NO_MARKS: &str = "no marks were recovered in this run";

/// All surfaces over one another, in the world, from above and from the front, at one scale along all axes [Davis 2002 Fig. 63].
pub(super) fn way(course: &Course, name: &str) -> String {
    let step = course.moments.len().div_ceil(OVERLAID).max(1);
    let shown: Vec<&Moment> = course.moments.iter().step_by(step).collect();
    let title = format!("{name}: the marks of {} moments in the world", shown.len());
    let values = |axis: usize| shown.iter().flat_map(|it| it.in_world()).map(|it| it.0[axis]).collect::<Vec<_>>();
    let range = |axis: usize| Range::of_most(&mut values(axis)).map(|it| it.widened(0.04));
    let (Some(x), Some(y), Some(z)) = (range(0), range(1), range(2)) else { return nothing(&title, NO_MARKS) };
    // [px/m]; a panel that would be too low or too narrow shows more of the world, not a stretched one.
    let scale = (WIDTH / x.length()).min(HIGHEST / y.length()).min(HIGHEST / z.length());
    let over = |axis: Axis, of: Range, pixels: f64| {
        let Range { min, max } = of.around_middle(pixels / scale);
        axis.over(min, max)
    };
    // From pale, the first, to dark, the last.
    let part = |index: usize| index as f64 / (shown.len() - 1).max(1) as f64;
    let shades: Vec<String> = (0..shown.len()).map(|it| shade(0.12 + 0.88 * part(it))).collect();
    let dated: Vec<usize> = (0..DATED).map(|it| it * (shown.len() - 1) / (DATED - 1)).collect();
    let view = |upwards: usize, of: Range, across: Axis, label: &str| {
        let tall = (of.length() * scale).max(LOWEST);
        let mut chart = Chart::new("", [WIDTH, tall], over(across, x, WIDTH), over(Axis::new(label), of, tall));
        for (index, (moment, colour)) in shown.iter().zip(&shades).enumerate() {
            let name = if dated.contains(&index) { format!("{:.1} s", moment.time_s) } else { String::new() };
            let points = moment.in_world().map(|(place, _)| [place.x, place[upwards]]).collect();
            chart.series.push(Series::new(name, Marks::Dots(1.3), Pen::new(colour, 1.0), points));
        }
        chart
    };
    let above = view(1, y, Axis::new("x [m]").hidden(), "from above: y [m]");
    let front = view(2, z, Axis::new("x [m]"), "from the front: z [m]");
    Figure { title, n_columns: 1, charts: vec![above, front] }.svg()
}

/// By how much the distances of two pairs of marks deviate from their means over time: of the pair whose distance changes most and of the one whose
/// distance changes least [Davis 2002 Fig. 64].
pub(super) fn distances(ours: &Course, compared: &Course, name: &str) -> String {
    let title = format!("{name}: deviation of the distance of two marks from its mean over the session");
    let pairs = extreme_pairs(ours);
    if pairs.is_empty() {
        return nothing(&title, NO_MARKS);
    }
    let last = pairs.len() - 1;
    let chart = |(row, (pair, what)): (usize, ([u32; 2], &str))| {
        let deviations = |course: &Course| {
            let distances = course.distance(pair);
            let mean = distances.iter().map(|it| it.1).sum::<f64>() / distances.len().max(1) as f64;
            distances.into_iter().map(|it| [it.0, (it.1 - mean) * 1e3]).collect::<Vec<_>>()
        };
        let title = format!("marks {}–{}: the distance changes {what}", pair[0], pair[1]);
        let x = Axis::new("time [s]");
        let x = if row < last { x.hidden() } else { x };
        let mut chart = Chart::new(title, [WIDTH, HEIGHT], x, Axis::new("deviation [mm]"));
        if !compared.moments.is_empty() {
            chart = chart.with(curve("comparison", REFERENCE, deviations(compared)));
        }
        chart.with(curve("all cameras", OURS, deviations(ours)))
    };
    let charts = pairs.into_iter().zip(["most", "least"]).enumerate().map(chart).collect();
    Figure { title, n_columns: 1, charts }.svg()
}

/// A course as a line, broken where samples are missing for long.
fn curve<'a>(name: &str, colour: &'a str, course: Vec<Point>) -> Series<'a> {
    let steps: Vec<f64> = course.windows(2).map(|it| it[1][0] - it[0][0]).collect();
    let longest = LONGEST_STEPS * median(&steps).unwrap_or(0.0);
    let pieces = course.chunk_by(|a, b| b[0] - a[0] <= longest).map(<[Point]>::to_vec).collect();
    Series { pieces, ..Series::line(name, colour, Vec::new()) }
}

/// The pair whose distance changes most and the pair whose distance changes least, of those that were present most of the time.
fn extreme_pairs(course: &Course) -> Vec<[u32; 2]> {
    let labels = course.labels();
    // A hundred moments tell it.
    let step = course.moments.len().div_ceil(100).max(1);
    let some = course.thinned(step);
    let mut pairs = Vec::new();
    for (place, a) in labels.iter().enumerate() {
        for b in &labels[..place] {
            let distances: Vec<f64> = some.distance([*b, *a]).into_iter().map(|it| it.1).collect();
            let mean = distances.iter().sum::<f64>() / distances.len().max(1) as f64;
            if 2 * distances.len() > some.moments.len() && PAIRS.contains(&mean) {
                let change = distances.iter().map(|it| (it - mean).abs()).sum::<f64>() / distances.len() as f64;
                pairs.push((change, [*b, *a]));
            }
        }
    }
    pairs.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    let ends = [pairs.first(), pairs.last()];
    ends.into_iter().flatten().map(|it| it.1).collect()
}

/// How many marks were measured and filled in, and how well the model describes them.
pub(super) fn counts(course: &Course, name: &str) -> String {
    let title = format!("{name}: marks measured and filled in, and how well the model fits");
    if course.moments.is_empty() {
        return nothing(&title, NO_MARKS);
    }
    let line = |name: &str, colour, of: &dyn Fn(&Moment) -> Option<f64>| {
        curve(name, colour, course.moments.iter().filter_map(|it| Some([it.time_s, of(it)?])).collect())
    };
    let count = |it: &Moment, filled: bool| Some(it.samples.iter().filter(|it| it.is_filled == filled).count() as f64);
    let span =
        Range::of(course.moments.iter().map(|it| it.time_s)).unwrap_or(Range { min: 0.0, max: 1.0 }).widened(0.01);
    let time = || Axis::new("time [s]").over(span.min, span.max);
    let marks = Chart::new("", [WIDTH, HEIGHT], time(), Axis::new("marks [–]").from_zero().whole())
        .with(line("measured", OURS, &|it| count(it, false)))
        .with(line("filled in", FILLED, &|it| count(it, true)));
    let charts = if course.moments.iter().any(|it| it.rms.is_some() || it.out_of_distribution.is_some()) {
        let rms = Chart::new("", [WIDTH, HEIGHT], time().hidden(), Axis::new("rms of the fit [mm]").from_zero());
        let out_of_distribution =
            Chart::new("", [WIDTH, HEIGHT], time(), Axis::new("out-of-distribution score [–]").from_zero());
        vec![
            Chart { x: time().hidden(), ..marks },
            rms.with(line("", OURS, &|it| Some(it.rms? * 1e3))),
            out_of_distribution.with(line("", OURS, &|it| it.out_of_distribution)),
        ]
    } else {
        let fit = Chart::new("", [WIDTH, 40.0], time().hidden(), Axis::new(""));
        vec![marks, fit.if_empty("no shape was fitted in this run")]
    };
    Figure { title, n_columns: 1, charts }.svg()
}

/// Some moments of the surface from the front, marks connected to their neighbours; filled marks stand out [Davis 2002 Fig. 62, 70].
pub(super) fn stills(course: &Course, name: &str) -> String {
    const SIDE: f64 = 210.0;
    const TOP: f64 = 46.0;
    let title = format!("{name}: the surface at some moments");
    // Moments with marks enough for a net, where there are any: a still of two dots shows no surface.
    let whole: Vec<&Moment> = course.moments.iter().filter(|it| Front::of(it).is_some()).collect();
    if whole.is_empty() {
        return nothing(&title, NO_MARKS);
    }
    let step = (whole.len() / STILLS).max(1);
    let shown: Vec<&Moment> = whole.into_iter().skip(step / 2).step_by(step).take(STILLS).collect();
    let rows = shown.len().div_ceil(4) as f64;
    let mut svg = Svg::new(4.0 * SIDE + 40.0, TOP + rows * (SIDE + 24.0) + 24.0 + 2.0 * LINE_HEIGHT, &title);
    // One frame of reference and one net for all: that of the moment with most marks.
    let fullest = course.moments.iter().max_by_key(|it| (it.samples.len(), std::cmp::Reverse(it.time_s.to_bits())));
    let net = fullest.map(neighbours).unwrap_or_default();
    let half = 0.5 * SIDE - 12.0;
    for (number, moment) in shown.iter().enumerate() {
        let Some(front) = Front::of(moment) else { continue };
        let reach = moment.samples.iter().flat_map(|it| front.place(&it.position.cast())).map(f64::abs);
        let scale = half / reach.fold(1e-3, f64::max);
        let centre = [20.0 + SIDE * ((number % 4) as f64 + 0.5), TOP + (SIDE + 24.0) * ((number / 4) as f64 + 0.5)];
        let place = |label: u32| {
            let [right, up] = front.place(&moment.position(label)?);
            Some([centre[0] + right * scale, centre[1] - up * scale])
        };
        let edges = net.iter().filter_map(|[a, b]| Some(vec![place(*a)?, place(*b)?]));
        svg.lines(&edges.collect::<Vec<_>>(), Pen::new("#b9c4cc", 1.0));
        for sample in &moment.samples {
            if let Some(at) = place(sample.label) {
                let (fill, line) = if sample.is_filled { ("#ffffff", FILLED) } else { (OURS, OURS) };
                svg.circle(at, 2.6, fill, Pen::new(line, 1.3));
            }
        }
        let below = [centre[0], centre[1] + 0.5 * SIDE + 14.0];
        svg.text(below, Anchor::Middle, SMALL, &format!("{:.1} s", moment.time_s));
    }
    let mut legend = Legend::at([24.0, TOP + rows * (SIDE + 24.0) + 14.0]);
    legend.entry(&mut svg, Key::Dot { fill: OURS, edge: OURS }, "measured");
    legend.entry(&mut svg, Key::Dot { fill: "#ffffff", edge: FILLED }, "filled in by the model");
    svg.finish()
}
