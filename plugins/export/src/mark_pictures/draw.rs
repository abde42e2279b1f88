//! The pictures themselves.

use foveate::estimation::statistics::median;

use super::course::{Course, Front, Moment, neighbours};
use crate::plot::axes::{Labels, Panel, Range, round_step};
use crate::plot::legend::{COLOURS, Key, LEGEND_WIDTH, Legend};
use crate::plot::svg::{Anchor, Pen, Point, Rect, SMALL, Svg, TEXT};
use crate::plot::thin::{FIGURE_POINTS, thin_courses};

const LEFT: f64 = 76.0;
const TOP: f64 = 46.0;
const WIDTH: f64 = 760.0;
/// Least and greatest height of a view of the world.
const LOWEST: f64 = 130.0;
const HIGHEST: f64 = 900.0;
const OURS: &str = COLOURS[0];
const COMPARED: &str = "#9a9a9a";
const FILLED: &str = COLOURS[1];
/// Surfaces that lie over one another in the picture of the whole way.
const OVERLAID: usize = 60;
/// Stills, in rows of four.
const STILLS: usize = 8;
/// A line goes on over as many usual steps [–].
const LONGEST_STEPS: f64 = 4.5;
/// Marks of the pairs whose distances are drawn are this far apart on average [m].
const PAIRS: std::ops::Range<f64> = 0.015..0.09;

/// All surfaces over one another, in the world, from above and from the front, at one scale along all axes [Davis 2002 Fig. 63].
pub(super) fn way(course: &Course, name: &str) -> String {
    let step = course.moments.len().div_ceil(OVERLAID).max(1);
    let shown: Vec<&Moment> = course.moments.iter().step_by(step).collect();
    let title = format!("{name}: the marks of {} moments in the world", shown.len());
    let all = || shown.iter().flat_map(|it| it.in_world());
    let values = |axis: usize| all().map(|it| it.0[axis]).filter(|it| it.is_finite()).collect::<Vec<_>>();
    let range = |axis: usize| Range::of_most(&mut values(axis)).map(|it| it.widened(0.04));
    let (Some(x), Some(y), Some(z)) = (range(0), range(1), range(2)) else { return nothing(&title) };
    // [px/m]; a panel that would be too low or too narrow shows more of the world, not a stretched one.
    let scale = (WIDTH / x.length()).min(HIGHEST / y.length()).min(HIGHEST / z.length());
    let tall = |it: Range| (it.length() * scale).max(LOWEST);
    let reach = |it: Range, pixels: f64| {
        let (middle, half) = (0.5 * (it.min + it.max), 0.5 * pixels / scale);
        Range { min: middle - half, max: middle + half }
    };
    let [deep, high] = [tall(y), tall(z)];
    let (x, y, z) = (reach(x, WIDTH), reach(y, deep), reach(z, high));
    let mut svg = Svg::new(LEFT + WIDTH + 20.0, TOP + deep + high + 90.0, &title);
    let steps = [Some(round_step(42.0 / scale)); 2];
    let mut top = TOP;
    for (axis, other, tall, label) in [(1, y, deep, "y [m], from above"), (2, z, high, "z [m], from the front")] {
        let rect = Rect { left: LEFT, top, width: WIDTH, height: tall };
        let panel = Panel { rect, x, y: other };
        panel.background(&mut svg, Labels { steps, ..Labels::new((axis == 2).then_some("x [m]"), label) });
        svg.within(rect, |svg| {
            for (number, moment) in shown.iter().enumerate() {
                let colour = COLOURS[number % COLOURS.len()];
                for (place, _) in moment.in_world() {
                    svg.circle(panel.place(place.x, place[axis]), 1.3, colour, Pen::new("none", 0.0));
                }
            }
        });
        panel.frame(&mut svg);
        top += tall + 30.0;
    }
    svg.finish()
}

/// A figure that says that it shows nothing, and why.
fn nothing(title: &str) -> String {
    let mut svg = Svg::new(LEFT + WIDTH + 20.0, TOP + 80.0, title);
    svg.text([LEFT, TOP + 30.0], Anchor::Start, TEXT, "nothing to show: no marks were recovered in this run");
    svg.finish()
}

/// By how much the distances of two pairs of marks deviate from their means over time: of the pair whose distance changes most and of the one whose
/// distance changes least [Davis 2002 Fig. 64].
pub(super) fn distances(ours: &Course, compared: &Course, name: &str) -> String {
    let pairs = extreme_pairs(ours);
    if pairs.is_empty() {
        return nothing(&format!("{name}: how far the distance of two marks is from its mean over the session"));
    }
    let mut svg = Svg::new(
        LEFT + WIDTH + LEGEND_WIDTH + 20.0,
        TOP + 2.0 * 190.0 + 60.0,
        &format!("{name}: how far the distance of two marks is from its mean over the session"),
    );
    let mut legend = Legend::at([LEFT + WIDTH + 20.0, TOP]);
    legend.entry(&mut svg, Key::Line(Pen::new(OURS, 1.5)), "all cameras");
    if !compared.moments.is_empty() {
        legend.entry(&mut svg, Key::Line(Pen::new(COMPARED, 1.5)), "to compare with");
    }
    let time = Range::of(ours.moments.iter().map(|it| it.time_s)).unwrap_or(Range { min: 0.0, max: 1.0 });
    for (row, (pair, what)) in pairs.into_iter().zip(["most", "least"]).enumerate() {
        let deviations = |course: &Course| {
            let distances = course.distance(pair);
            let mean = distances.iter().map(|it| it.1).sum::<f64>() / distances.len().max(1) as f64;
            distances.into_iter().map(|it| (it.0, (it.1 - mean) * 1e3)).collect::<Vec<_>>()
        };
        let (mine, other) = (deviations(ours), deviations(compared));
        let y =
            Range::of(mine.iter().chain(&other).map(|it| it.1)).unwrap_or(Range { min: -1.0, max: 1.0 }).widened(0.1);
        let rect = Rect { left: LEFT, top: TOP + row as f64 * 210.0, width: WIDTH, height: 180.0 };
        let panel = Panel { rect, x: time.widened(0.01), y };
        let label = format!("{}–{} (changes {what}) [mm]", pair[0], pair[1]);
        panel.background(&mut svg, Labels::new((row == 1).then_some("time [s]"), &label));
        svg.within(rect, |svg| {
            for (course, pen) in [(other, Pen::new(COMPARED, 1.2)), (mine, Pen::new(OURS, 1.2))] {
                svg.lines(&pieces(&course, &panel), pen);
            }
        });
        panel.frame(&mut svg);
    }
    svg.finish()
}

/// A course as lines; where something is missing for long there is none.
fn pieces(course: &[(f64, f64)], panel: &Panel) -> Vec<Vec<Point>> {
    let steps: Vec<f64> = course.windows(2).map(|it| it[1].0 - it[0].0).collect();
    let longest = LONGEST_STEPS * median(&steps).unwrap_or(0.0);
    let runs = course.chunk_by(|a, b| b.0 - a.0 <= longest);
    let mut lines: Vec<Vec<Point>> =
        runs.map(|run| run.iter().map(|it| panel.place(it.0, it.1)).collect::<Vec<Point>>()).collect();
    thin_courses(&mut lines, FIGURE_POINTS / 4);
    lines
}

/// The pair whose distance changes most and the one whose changes least, of those that were there most of the time.
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

/// What a curve shows of a moment.
type Of<'a> = &'a dyn Fn(&Moment) -> Option<f64>;

/// How many marks were measured and filled in, and how well the model describes them.
pub(super) fn counts(course: &Course, name: &str) -> String {
    if course.moments.is_empty() {
        return nothing(&format!("{name}: marks measured and filled in, and how well the model fits"));
    }
    let mut svg = Svg::new(
        LEFT + WIDTH + LEGEND_WIDTH + 20.0,
        TOP + 2.0 * 190.0 + 60.0,
        &format!("{name}: marks measured and filled in, and how well the model fits"),
    );
    let mut legend = Legend::at([LEFT + WIDTH + 20.0, TOP]);
    legend.entry(&mut svg, Key::Line(Pen::new(OURS, 1.5)), "measured");
    legend.entry(&mut svg, Key::Line(Pen::new(FILLED, 1.5)), "filled in");
    let mut legend = Legend::at([LEFT + WIDTH + 20.0, TOP + 210.0]);
    legend.entry(&mut svg, Key::Line(Pen::new(OURS, 1.5)), "rms of the fit [mm]");
    legend.entry(&mut svg, Key::Line(Pen::new(FILLED, 1.5)), "outside the model [–]");
    let x = Range::of(course.moments.iter().map(|it| it.time_s)).unwrap_or(Range { min: 0.0, max: 1.0 }).widened(0.01);
    let count = |it: &Moment, filled: bool| it.samples.iter().filter(|it| it.is_filled == filled).count() as f64;
    let curves = |of: [Of<'_>; 2]| {
        of.map(|of| course.moments.iter().filter_map(|it| Some((it.time_s, of(it)?))).collect::<Vec<_>>())
    };
    let rows = [
        ("marks", curves([&|it| Some(count(it, false)), &|it| Some(count(it, true))])),
        ("rms [mm]; outside [–]", curves([&|it| Some(it.rms? * 1e3), &|it| it.out_of_distribution])),
    ];
    for (row, (label, curves)) in rows.into_iter().enumerate() {
        let is_empty = curves.iter().all(Vec::is_empty);
        let values = curves.iter().flatten().map(|it| it.1).chain([0.0]);
        let whole = Range { min: 0.0, max: 1.0 };
        let y = Range::of(values).filter(|_| !is_empty).unwrap_or(whole).widened(0.06);
        let rect = Rect { left: LEFT, top: TOP + row as f64 * 210.0, width: WIDTH, height: 180.0 };
        let panel = Panel { rect, x, y };
        panel.background(&mut svg, Labels::new((row == 1).then_some("time [s]"), label));
        svg.within(rect, |svg| {
            for (curve, colour) in curves.iter().zip([OURS, FILLED]) {
                svg.lines(&pieces(curve, &panel), Pen::new(colour, 1.2));
            }
        });
        panel.frame(&mut svg);
        if is_empty {
            let middle = [rect.left + 0.5 * rect.width, rect.top + 0.5 * rect.height];
            svg.text(middle, Anchor::Middle, SMALL, "no shape was fitted in this run");
        }
    }
    svg.finish()
}

/// Some moments of the surface from before it, marks joined to their neighbours; filled marks stand out [Davis 2002 Fig. 62, 70].
pub(super) fn stills(course: &Course, name: &str) -> String {
    const SIDE: f64 = 236.0;
    let title = format!("{name}: the surface at some moments");
    // Moments with marks enough for a net, where there are any: a still of two dots shows no surface.
    let whole: Vec<&Moment> = course.moments.iter().filter(|it| Front::of(it).is_some()).collect();
    if whole.is_empty() {
        return nothing(&title);
    }
    let step = (whole.len() / STILLS).max(1);
    let shown: Vec<&Moment> = whole.into_iter().skip(step / 2).step_by(step).take(STILLS).collect();
    let rows = shown.len().div_ceil(4) as f64;
    let mut svg = Svg::new(4.0 * SIDE + 40.0, TOP + rows * (SIDE + 24.0) + 44.0, &title);
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
    legend.entry(&mut svg, Key::Dot { fill: OURS }, "measured; rings: filled in by the model");
    svg.finish()
}
