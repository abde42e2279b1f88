//! The drawing itself.

use std::collections::BTreeSet;

use foveate_plot::colours::{PAPER, Theme};
use foveate_plot::svg::{Anchor, Font, Pen, Rect, Step, Svg};
use foveate_plot::text::text_width;

use super::layout::{Layout, Way, place};
use super::{Sketch, colours};

/// Room above the scales, for the title.
const TITLE: f64 = 64.0;
/// Room below them, for the legend.
const LEGEND: f64 = 40.0;
/// Radius of the turns of backward edges.
const TURN: f64 = 8.0;

const INK: &str = "#1b2733";
const SOFT: &str = "#41505e";
const EDGE: Pen<'static> = Pen::new("#5a6b7b", 1.4);
const FEEDBACK: Pen<'static> = Pen::new("#8a5a00", 1.4).dashed("5 4");
const THEME: Theme = Theme { ink: INK, muted: "#5a6b7b", ..PAPER };
const SMALL: Font<'static> = Font::new(12.0).coloured(THEME.muted);

/// An SVG document of a sketch.
pub(super) fn draw(sketch: &Sketch<'_>) -> String {
    let layout = place(sketch, TITLE);
    let width = layout.width.max(title_width(sketch)).max(legend_width(sketch));
    let mut svg = Svg::bare(width, layout.height + LEGEND, sketch.title, THEME);
    svg.text([24.0, 30.0], Anchor::Start, Font::new(18.0).bold(), sketch.title);
    svg.text([24.0, 49.0], Anchor::Start, SMALL, &counts(sketch));
    for (index, frame) in sketch.scales.iter().enumerate() {
        let rect = layout.frames[index];
        let fill = if depth_is_odd(sketch, index) { "#ffffff" } else { "#f7f9fb" };
        svg.rounded(rect, 10.0, fill, Some(Pen::new("#c3ced8", 1.0)));
        let (at, name) = ([rect.left + 14.0, rect.top + 24.0], Font::new(15.0).bold());
        svg.text(at, Anchor::Start, name, frame.name);
        svg.text([at[0] + text_width(frame.name, name.size) + 12.0, at[1]], Anchor::Start, SMALL, &frame.about);
    }
    draw_links(&mut svg, sketch, &layout);
    for (index, part) in sketch.nodes.iter().enumerate() {
        svg.with_hint(&format!("{}: {}", part.name, part.role.name()), |svg| draw_box(svg, part, layout.boxes[index]));
    }
    draw_messages(&mut svg, sketch, &layout);
    draw_legend(&mut svg, sketch, layout.height + 14.0);
    svg.finish()
}

fn counts(sketch: &Sketch<'_>) -> String {
    let plural = |count: usize, word: &str| format!("{count} {word}{}", if count == 1 { "" } else { "s" });
    let mut parts = vec![plural(sketch.scales.len(), "scale"), plural(sketch.nodes.len(), "node")];
    if sketch.cameras > 0 {
        parts.push(plural(sketch.cameras, "camera"));
    }
    parts.join(", ")
}

fn title_width(sketch: &Sketch<'_>) -> f64 {
    48.0 + text_width(sketch.title, 18.0).max(text_width(&counts(sketch), 12.0))
}

fn depth_is_odd(sketch: &Sketch<'_>, scale: usize) -> bool {
    let mut odd = false;
    let mut at = sketch.scales[scale].parent;
    // Far down nobody sees the difference.
    for _ in 0..64 {
        let Some(parent) = at else { break };
        odd = !odd;
        at = sketch.scales[parent].parent;
    }
    odd
}

fn draw_box(svg: &mut Svg, part: &super::Part<'_>, place: Rect) {
    let (fill, stroke) = colours(part.role);
    svg.rounded(place, 6.0, fill, Some(Pen::new(stroke, 1.3)));
    if part.count > 1 {
        let count = format!("×{}", part.count);
        let width = text_width(&count, 11.0) + 10.0;
        let pill = Rect { left: place.right() - width - 7.0, top: place.top + 6.0, width, height: 16.0 };
        svg.rounded(pill, 8.0, stroke, None);
        let font = Font::new(11.0).bold().coloured("#ffffff");
        svg.text([pill.middle()[0], pill.top + 12.0], Anchor::Middle, font, &count);
    }
    let left = place.left + 12.0;
    svg.text([left, place.top + 19.0], Anchor::Start, Font::new(13.0).bold(), part.name);
    svg.text([left, place.top + 35.0], Anchor::Start, Font::new(11.0).coloured(SOFT), part.type_name);
}

fn draw_links(svg: &mut Svg, sketch: &Sketch<'_>, layout: &Layout) {
    for (link, way) in sketch.links.iter().zip(&layout.ways) {
        let pen = if link.feedback { FEEDBACK } else { EDGE };
        let (from, steps, to) = path(way);
        svg.with_hint(&link.about, |svg| {
            svg.curve(from, &steps, pen);
            svg.arrow_head(to, pen.colour);
        });
    }
}

/// Where the line of a route begins, its steps, and where it ends; every route ends to the right.
fn path(way: &Way) -> ([f64; 2], Vec<Step>, [f64; 2]) {
    match way {
        Way::Forward(points) => {
            let point = |it: &(f64, f64)| [it.0, it.1];
            let [from, to] = [points.first(), points.last()].map(|it| it.map_or([0.0; 2], point));
            let step = |pair: &[(f64, f64)]| {
                let [[x0, y0], [x, y]] = [point(&pair[0]), point(&pair[1])];
                let middle = (x0 + x) / 2.0;
                let is_level = (y - y0).abs() < 0.05;
                if is_level { Step::To([x, y]) } else { Step::Cubic([middle, y0], [middle, y], [x, y]) }
            };
            (from, points.windows(2).map(step).collect(), to)
        }
        Way::Around { from, level, to } => {
            let (right, left) = (from.0 + 20.0, to.0 - 20.0);
            let (down, up) = ((level - from.1).signum() * TURN, (to.1 - level).signum() * TURN);
            let steps = vec![
                Step::To([right - TURN, from.1]),
                Step::Quadratic([right, from.1], [right, from.1 + down]),
                Step::To([right, level - down]),
                Step::Quadratic([right, *level], [right - TURN, *level]),
                Step::To([left + TURN, *level]),
                Step::Quadratic([left, *level], [left, level + up]),
                Step::To([left, to.1 - up]),
                Step::Quadratic([left, to.1], [left + TURN, to.1]),
                Step::To([to.0, to.1]),
            ];
            ([from.0, from.1], steps, [to.0, to.1])
        }
    }
}

/// The message of each output: beside it, or on the backward route.
fn draw_messages(svg: &mut Svg, sketch: &Sketch<'_>, layout: &Layout) {
    let font = Font::new(10.5).coloured(SOFT).with_halo();
    let mut drawn = BTreeSet::new();
    for (link, way) in sketch.links.iter().zip(&layout.ways) {
        match way {
            Way::Forward(points) => {
                let Some(&(x, y)) = points.first() else { continue };
                if drawn.insert((link.from, link.output)) {
                    svg.text([x + 5.0, y - 4.0], Anchor::Start, font, &link.label);
                }
            }
            Way::Around { from, level, to } => {
                let at = [(from.0 + to.0) / 2.0, level - 4.0];
                svg.text(at, Anchor::Middle, font.coloured(FEEDBACK.colour), &link.label);
            }
        }
    }
}

fn legend_width(sketch: &Sketch<'_>) -> f64 {
    48.0 + sketch.roles().map(|it| text_width(it.name(), 12.0) + 34.0).sum::<f64>() + 130.0
}

fn draw_legend(svg: &mut Svg, sketch: &Sketch<'_>, y: f64) {
    let mut x = 24.0;
    for role in sketch.roles() {
        let (fill, stroke) = colours(role);
        let swatch = Rect { left: x, top: y - 10.0, width: 12.0, height: 12.0 };
        svg.rounded(swatch, 3.0, fill, Some(Pen::new(stroke, 1.0)));
        svg.text([x + 18.0, y], Anchor::Start, SMALL, role.name());
        x += text_width(role.name(), 12.0) + 34.0;
    }
    if sketch.links.iter().any(|it| it.feedback) {
        svg.line([x, y - 4.0], [x + 28.0, y - 4.0], FEEDBACK);
        svg.arrow_head([x + 28.0, y - 4.0], FEEDBACK.colour);
        svg.text([x + 35.0, y], Anchor::Start, SMALL, "feedback");
    }
}
