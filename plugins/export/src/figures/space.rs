//! Paths in space, to scale: from above, and from two sides.

use foveate::geometry::Camera;
use foveate::plot::axes::{Labels, Panel, Range};
use foveate::plot::colours::OTHERS;
use foveate::plot::legend::{Key, LEGEND_WIDTH, LINE_HEIGHT, Legend};
use foveate::plot::names::Names;
use foveate::plot::svg::{Pen, Point, Rect, Svg, TITLE};
use foveate::plot::text::text_width;
use foveate::plot::thin::{CHART_POINTS, thin_paths};
use foveate::plot::ticks::round_step;
use nalgebra::Point2;

use super::{Coloured, INK, MEASURED, PREDICTED, Subject, TRUTH};
use crate::track_history::{Sample, Track};

const LEFT: f64 = 76.0;
const TOP: f64 = 46.0;
const BELOW: f64 = 54.0;
/// Largest panel [px].
const PANEL: [f64; 2] = [680.0, 620.0];
const NARROWEST: f64 = 170.0;
const AXES: [&str; 3] = ["x", "y", "z"];
const VOLUME: Pen<'static> = Pen::new("#777777", 1.0).dashed("6 4");

/// The plan: x to the right, y upwards.
pub(crate) fn top(subject: &Subject<'_>) -> String {
    let title = format!("{}: paths seen from above", subject.name);
    draw(subject, &title, &[[0, 1]])
}

/// Two elevations, one below the other at the same scale.
pub(crate) fn side(subject: &Subject<'_>) -> String {
    let title = format!("{}: paths seen from the side", subject.name);
    draw(subject, &title, &[[0, 2], [1, 2]])
}

fn draw(subject: &Subject<'_>, title: &str, views: &[[usize; 2]]) -> String {
    let reach = 0.07 * [0, 1, 2].map(|axis| range(subject, axis, 0.0).length()).into_iter().fold(0.0, f64::max);
    let ranges = [0, 1, 2].map(|axis| range(subject, axis, reach));
    let (panels, scale) = arrange(views, &ranges);
    let right = panels.iter().map(|it| it.rect.right()).fold(0.0, f64::max);
    let bottom = panels.iter().map(|it| it.rect.bottom()).fold(0.0, f64::max);
    let height = (bottom + BELOW).max(TOP + LINE_HEIGHT * (subject.tracks.len() + 12) as f64);
    let title = match subject.unit {
        "m" => title.to_owned(),
        unit => format!("{title} [{unit} of the calibration]"),
    };
    let width = (right + LEGEND_WIDTH + 20.0).max(text_width(&title, TITLE) + 32.0);
    let mut svg = Svg::new(width, height, &title);
    for (axes, panel) in views.iter().zip(&panels) {
        view(&mut svg, subject, *axes, panel, (reach, CHART_POINTS / views.len()));
    }
    legend(&mut svg, subject, scale, [right + 20.0, TOP]);
    svg.finish()
}

/// Panels at one scale [px a unit of length], below or beside each other, whichever lets them be larger.
fn arrange(views: &[[usize; 2]], ranges: &[Range; 3]) -> (Vec<Panel>, f64) {
    let length = |axis: usize| ranges[axis].length();
    let sum = |side: usize| views.iter().map(|view| length(view[side])).sum::<f64>().max(1e-9);
    let most = |side: usize| views.iter().map(|view| length(view[side])).fold(1e-9, f64::max);
    let between = (views.len() - 1) as f64;
    let below = (PANEL[0] / most(0)).min((PANEL[1] - between * BELOW) / sum(1));
    let beside = ((PANEL[0] - between * LEFT) / sum(0)).min(PANEL[1] / most(1));
    let scale = below.max(beside);
    let mut corner = [LEFT, TOP];
    let mut panels = Vec::new();
    for &[across, up] in views {
        let [width, height] = [across, up].map(|axis| (length(axis) * scale).max(NARROWEST));
        let fit = |range: Range, pixels: f64| range.around_middle(pixels / scale);
        let rect = Rect { left: corner[0], top: corner[1], width, height };
        panels.push(Panel::new(rect, fit(ranges[across], width), fit(ranges[up], height)));
        if below >= beside {
            corner[1] = rect.bottom() + BELOW;
        } else {
            corner[0] = rect.right() + LEFT;
        }
    }
    (panels, scale)
}

/// Range of one axis; `reach`: how far the views of the cameras are drawn.
fn range(subject: &Subject<'_>, axis: usize, reach: f64) -> Range {
    let of = |track: &Track| track.samples.iter().map(|it| f64::from(it.position[axis])).collect::<Vec<_>>();
    let mut values: Vec<f64> =
        subject.all().flat_map(|it| of(it.track)).chain(subject.truth.iter().flat_map(|it| of(it))).collect();
    let paths = Range::of_most(&mut values);
    let fixed = subject.volume.iter().flatten().map(|corner| corner[axis]);
    let cameras =
        subject.cameras.iter().map(|(_, camera)| camera.centre()[axis]).flat_map(|it| [it - reach, it + reach]);
    let rest = Range::of(fixed.chain(cameras));
    match (paths, rest) {
        (Some(paths), rest) => paths.union(rest),
        (None, Some(rest)) => rest,
        (None, None) => Range { min: -1.0, max: 1.0 },
    }
    .widened(0.04)
}

fn view(svg: &mut Svg, subject: &Subject<'_>, [across, up]: [usize; 2], panel: &Panel, (reach, limit): (f64, usize)) {
    let label = |axis: usize| format!("{} [{}]", AXES[axis], subject.unit);
    // Both axes have the same scale, and so the same distance of ticks.
    let step = Some(round_step(42.0 / panel.rect.width * panel.x.range.length()));
    panel.background(svg, Labels { steps: [step; 2], ..Labels::new(Some(&label(across)), &label(up)) });
    let place = |position: [f64; 3]| panel.place(position[across], position[up]);
    svg.within(panel.rect, |svg| {
        if let Some([min, max]) = subject.volume {
            let [a, b] = [place(min), place(max)];
            svg.lines(&[vec![a, [b[0], a[1]], b, [a[0], b[1]], a]], VOLUME);
        }
        for (_, camera) in &subject.cameras {
            draw_camera(svg, &outline(camera, reach, place));
        }
        let mut truth: Vec<Vec<Point>> = subject
            .truth
            .iter()
            .flat_map(|it| it.pieces())
            .map(|piece| piece.iter().map(|it| place(it.position.map(f64::from))).collect())
            .collect();
        thin_paths(&mut truth, limit);
        svg.lines(&truth, TRUTH);
        let all = tracks(subject, |it| place(it.position.map(f64::from)));
        let n_points = |lines: &[Vec<Point>]| lines.iter().map(Vec::len).sum::<usize>();
        let n_all = all.iter().map(|it| n_points(&it.2)).sum::<usize>().max(1);
        for (_, pen, mut lines) in all {
            let share = n_points(&lines) as f64 / n_all as f64;
            thin_paths(&mut lines, (limit as f64 * share) as usize + 500);
            svg.lines(&lines, pen);
        }
        for it in &subject.tracks {
            ends(svg, it, place);
        }
    });
    camera_names(svg, subject, panel, reach, place);
    panel.frame(svg);
}

/// The measured stretches, then the predicted ones, of each target with a colour, after those of all others together: the
/// legend's text, the pen, and the lines.
pub(crate) fn tracks<'a>(
    subject: &Subject<'a>,
    place: impl Fn(&Sample) -> Point,
) -> Vec<(String, Pen<'a>, Vec<Vec<Point>>)> {
    let others = (format!("{} shorter tracks", subject.others.len()), OTHERS, subject.others.as_slice());
    let own = subject.tracks.chunks(1).map(|it| (format!("target {}", it[0].id.0), it[0].colour, it));
    let mut all = Vec::new();
    for (name, colour, tracks) in std::iter::once(others).filter(|it| !it.2.is_empty()).chain(own) {
        for is_measured in [true, false] {
            let of_kind = tracks.iter().flat_map(|it| stretches(it.track)).filter(|it| it.0 == is_measured);
            let lines = of_kind.map(|(_, stretch)| stretch.iter().map(&place).collect()).collect();
            let pen = Pen::new(colour, MEASURED);
            all.push(match is_measured {
                true => (name.clone(), pen, lines),
                false => (String::new(), pen.dashed(PREDICTED), lines),
            });
        }
    }
    all
}

/// Runs of samples that are all measured or all predicted, each beginning with the last sample of the one before, so that no
/// hole shows where the kind changes.
fn stretches(track: &Track) -> impl Iterator<Item = (bool, &[Sample])> {
    track.pieces().flat_map(|piece| {
        let mut start = 0;
        piece.chunk_by(|a, b| a.measured == b.measured).map(move |run| {
            let from = start.max(1) - 1;
            start += run.len();
            (run.first().is_some_and(|it| it.measured), &piece[from..start])
        })
    })
}

/// A hollow dot where the path begins, a full one where it ends.
fn ends(svg: &mut Svg, it: &Coloured<'_>, place: impl Fn([f64; 3]) -> Point) {
    if let (Some(first), Some(last)) = (it.track.samples.first(), it.track.samples.last()) {
        let pen = Pen::new(it.colour, 1.4);
        svg.circle(place(first.position.map(f64::from)), 3.2, "white", pen);
        svg.circle(place(last.position.map(f64::from)), 3.2, it.colour, pen);
    }
}

/// A camera's centre, and the corners of its picture `reach` away from it, where the lens has them.
fn outline(camera: &Camera, reach: f64, place: impl Fn([f64; 3]) -> Point) -> (Point, Vec<Point>) {
    let [width, height] = camera.image_size.map(|it| f64::from(it) - 1.0);
    let corners = [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]];
    let rays = corners.iter().filter_map(|&[x, y]| camera.ray(&Point2::new(x, y)));
    let far = rays.map(|ray| place((ray.origin + ray.direction.into_inner() * reach).into())).collect();
    (place(camera.centre().into()), far)
}

fn draw_camera(svg: &mut Svg, (centre, far): &(Point, Vec<Point>)) {
    let pen = Pen::new("#555555", 0.7);
    if far.len() == 4 {
        svg.area(far, "#888888", 0.18, Some(pen));
        far.iter().for_each(|corner| svg.line(*centre, *corner, pen.faint(0.8)));
    }
    svg.circle(*centre, 2.0, "#333333", Pen::new("#333333", 0.5));
}

/// Names next to the cameras where there is room; a name that would cover a camera or another name is left out.
fn camera_names(svg: &mut Svg, subject: &Subject<'_>, panel: &Panel, reach: f64, place: impl Fn([f64; 3]) -> Point) {
    let outlines: Vec<_> = subject.cameras.iter().map(|(_, camera)| outline(camera, reach, &place)).collect();
    let mut names = Names::within(panel.rect);
    for (centre, far) in &outlines {
        names.keep_off(*centre);
        for (index, corner) in far.iter().enumerate() {
            names.keep_off_line(*centre, *corner);
            names.keep_off_line(*corner, far[(index + 1) % far.len()]);
        }
    }
    for ((name, _), (centre, _)) in subject.cameras.iter().zip(outlines) {
        names.write(svg, centre, name);
    }
}

fn legend(svg: &mut Svg, subject: &Subject<'_>, scale: f64, at: Point) {
    let mut legend = Legend::at(at);
    for it in &subject.tracks {
        legend.entry(svg, Key::Line(Pen::new(it.colour, 2.2)), &format!("target {}", it.id.0));
    }
    let n_others = subject.others.len() as u64;
    if n_others > 0 {
        legend.entry(svg, Key::Line(Pen::new(OTHERS, 1.4)), &format!("{n_others} shorter tracks"));
    }
    if subject.n_left_out > 0 {
        legend.words(svg, &format!("{} short ones left out", subject.n_left_out));
    }
    if !subject.truth.is_empty() {
        legend.entry(svg, Key::Line(TRUTH), "truth");
    }
    legend.skip();
    legend.entry(svg, Key::Line(Pen::new(INK, MEASURED)), "measured");
    legend.entry(svg, Key::Line(Pen::new(INK, MEASURED).dashed(PREDICTED)), "predicted");
    legend.entry(svg, Key::Dot { fill: svg.theme().paper, edge: INK }, "begins");
    legend.entry(svg, Key::Dot { fill: INK, edge: INK }, "ends");
    if !subject.cameras.is_empty() {
        legend.entry(svg, Key::Camera, "camera and its view");
    }
    if subject.volume.is_some() {
        legend.entry(svg, Key::Line(VOLUME), "working volume");
    }
    legend.skip();
    let length = round_step(40.0 / scale);
    let unit = if subject.unit != "m" && length == 1.0 { "unit" } else { subject.unit };
    legend.scale_bar(svg, length * scale, &format!("{length} {unit}"));
}
