//! The drawing itself.

use std::collections::BTreeSet;
use std::fmt::Write;

use super::layout::{Layout, Rect, Way, place, text_width};
use super::{Sketch, colours};

/// Room above the scales, for the title.
const TITLE: f64 = 64.0;
/// Room below them, for the legend.
const LEGEND: f64 = 40.0;
/// Radius of the turns of backward edges.
const TURN: f64 = 8.0;

const STYLE: &str = "text{font-family:system-ui,-apple-system,'Segoe UI',Roboto,'DejaVu Sans',sans-serif;fill:#1b2733}\
.title{font-size:18px;font-weight:600}.small{font-size:12px;font-weight:400;fill:#5a6b7b}.scale{font-size:15px;font-weight:600}\
.name{font-size:13px;font-weight:600}.type{font-size:11px;fill:#41505e}.count{font-size:11px;font-weight:600;fill:#fff}\
.message{font-size:10.5px;fill:#41505e;paint-order:stroke;stroke:#fff;stroke-width:3px;stroke-linejoin:round}\
.back{fill:#8a5a00;text-anchor:middle}.edge{fill:none;stroke:#5a6b7b;stroke-width:1.4}.feedback{stroke-dasharray:5 4;stroke:#8a5a00}\
.frame{fill:#f7f9fb;stroke:#c3ced8}.inner{fill:#fff}";

/// An SVG document of a sketch.
pub(super) fn draw(sketch: &Sketch<'_>) -> String {
    let layout = place(sketch, TITLE);
    let width = layout.width.max(title_width(sketch)).max(legend_width(sketch));
    let height = layout.height + LEGEND;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width:.0}\" height=\"{height:.0}\" \
         viewBox=\"0 0 {width:.0} {height:.0}\" role=\"img\">\n<title>{}</title>\n<style>{STYLE}</style>\n\
         <defs><marker id=\"tip\" viewBox=\"0 0 8 8\" refX=\"7.2\" refY=\"4\" markerWidth=\"7\" markerHeight=\"7\" \
         orient=\"auto-start-reverse\"><path d=\"M0 0.6 8 4 0 7.4z\" fill=\"#5a6b7b\"/></marker>\
         <marker id=\"back\" viewBox=\"0 0 8 8\" refX=\"7.2\" refY=\"4\" markerWidth=\"7\" markerHeight=\"7\" \
         orient=\"auto-start-reverse\"><path d=\"M0 0.6 8 4 0 7.4z\" fill=\"#8a5a00\"/></marker></defs>\n\
         <rect width=\"100%\" height=\"100%\" fill=\"#fff\"/>\n",
        escaped(sketch.title)
    );
    let _ = writeln!(svg, "<text x=\"24\" y=\"30\" class=\"title\">{}</text>", escaped(sketch.title));
    let _ = writeln!(svg, "<text x=\"24\" y=\"49\" class=\"small\">{}</text>", counts(sketch));
    for (index, frame) in sketch.scales.iter().enumerate() {
        let Rect { x, y, width, height } = layout.frames[index];
        let class = if depth_is_odd(sketch, index) { "frame inner" } else { "frame" };
        let _ = writeln!(
            svg,
            "<rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"10\" class=\"{class}\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" class=\"scale\">{}<tspan class=\"small\" dx=\"10\">{}</tspan></text>",
            x + 14.0,
            y + 24.0,
            escaped(frame.name),
            escaped(&frame.about)
        );
    }
    draw_links(&mut svg, sketch, &layout);
    for (index, part) in sketch.nodes.iter().enumerate() {
        draw_box(&mut svg, part, layout.boxes[index]);
    }
    draw_messages(&mut svg, sketch, &layout);
    draw_legend(&mut svg, sketch, layout.height + 14.0);
    svg.push_str("</svg>\n");
    svg
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

fn draw_box(svg: &mut String, part: &super::Part<'_>, place: Rect) {
    let (fill, stroke) = colours(part.role);
    let Rect { x, y, width, height } = place;
    let _ = write!(
        svg,
        "<g><title>{}: {}</title><rect x=\"{x:.1}\" y=\"{y:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" rx=\"6\" \
         fill=\"{fill}\" stroke=\"{stroke}\" stroke-width=\"1.3\"/>",
        escaped(part.name),
        part.role.name()
    );
    if part.count > 1 {
        let count = format!("×{}", part.count);
        let pill = text_width(&count, 11.0) + 10.0;
        let _ = write!(
            svg,
            "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{pill:.1}\" height=\"16\" rx=\"8\" fill=\"{stroke}\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" class=\"count\" text-anchor=\"middle\">{count}</text>",
            x + width - pill - 7.0,
            y + 6.0,
            x + width - pill / 2.0 - 7.0,
            y + 18.0
        );
    }
    let _ = writeln!(
        svg,
        "<text x=\"{:.1}\" y=\"{:.1}\" class=\"name\">{}</text><text x=\"{:.1}\" y=\"{:.1}\" class=\"type\">{}</text></g>",
        x + 12.0,
        y + 19.0,
        escaped(part.name),
        x + 12.0,
        y + 35.0,
        escaped(part.type_name)
    );
}

fn draw_links(svg: &mut String, sketch: &Sketch<'_>, layout: &Layout) {
    for (link, way) in sketch.links.iter().zip(&layout.ways) {
        let (class, tip) = if link.feedback { ("edge feedback", "back") } else { ("edge", "tip") };
        let _ = writeln!(
            svg,
            "<path d=\"{}\" class=\"{class}\" marker-end=\"url(#{tip})\"><title>{}</title></path>",
            path(way),
            escaped(&link.about)
        );
    }
}

fn path(way: &Way) -> String {
    let mut path = String::new();
    match way {
        Way::Forward(points) => {
            let mut before: Option<(f64, f64)> = None;
            for &(x, y) in points {
                match before {
                    None => {
                        let _ = write!(path, "M{x:.1} {y:.1}");
                    }
                    Some((_, y0)) if (y - y0).abs() < 0.05 => {
                        let _ = write!(path, "L{x:.1} {y:.1}");
                    }
                    Some((x0, y0)) => {
                        let middle = (x0 + x) / 2.0;
                        let _ = write!(path, "C{middle:.1} {y0:.1} {middle:.1} {y:.1} {x:.1} {y:.1}");
                    }
                }
                before = Some((x, y));
            }
        }
        Way::Around { from, level, to } => {
            let (right, left) = (from.0 + 20.0, to.0 - 20.0);
            let (down, up) = ((level - from.1).signum() * TURN, (to.1 - level).signum() * TURN);
            let _ = write!(
                path,
                "M{:.1} {:.1}L{:.1} {:.1}Q{right:.1} {:.1} {right:.1} {:.1}L{right:.1} {:.1}Q{right:.1} {level:.1} {:.1} {level:.1}\
                 L{:.1} {level:.1}Q{left:.1} {level:.1} {left:.1} {:.1}L{left:.1} {:.1}Q{left:.1} {:.1} {:.1} {:.1}L{:.1} {:.1}",
                from.0,
                from.1,
                right - TURN,
                from.1,
                from.1,
                from.1 + down,
                level - down,
                right - TURN,
                left + TURN,
                level + up,
                to.1 - up,
                to.1,
                left + TURN,
                to.1,
                to.0,
                to.1
            );
        }
    }
    path
}

/// The message of each output: beside it, or on the way back.
fn draw_messages(svg: &mut String, sketch: &Sketch<'_>, layout: &Layout) {
    let mut drawn = BTreeSet::new();
    for (link, way) in sketch.links.iter().zip(&layout.ways) {
        let (x, y, class) = match way {
            Way::Forward(points) => match points.first() {
                Some(&(x, y)) => (x + 5.0, y - 4.0, "message"),
                None => continue,
            },
            Way::Around { from, level, to } => ((from.0 + to.0) / 2.0, level - 4.0, "message back"),
        };
        let is_back = matches!(way, Way::Around { .. });
        if is_back || drawn.insert((link.from, link.output)) {
            let message = escaped(&link.label);
            let _ = writeln!(svg, "<text x=\"{x:.1}\" y=\"{y:.1}\" class=\"{class}\">{message}</text>");
        }
    }
}

fn legend_width(sketch: &Sketch<'_>) -> f64 {
    48.0 + sketch.roles().map(|it| text_width(it.name(), 12.0) + 34.0).sum::<f64>() + 130.0
}

fn draw_legend(svg: &mut String, sketch: &Sketch<'_>, y: f64) {
    let mut x = 24.0;
    for role in sketch.roles() {
        let (fill, stroke) = colours(role);
        let _ = writeln!(
            svg,
            "<rect x=\"{x:.1}\" y=\"{:.1}\" width=\"12\" height=\"12\" rx=\"3\" fill=\"{fill}\" stroke=\"{stroke}\"/>\
             <text x=\"{:.1}\" y=\"{:.1}\" class=\"small\">{}</text>",
            y - 10.0,
            x + 18.0,
            y,
            role.name()
        );
        x += text_width(role.name(), 12.0) + 34.0;
    }
    if sketch.links.iter().any(|it| it.feedback) {
        let _ = writeln!(
            svg,
            "<path d=\"M{x:.1} {:.1}h28\" class=\"edge feedback\" marker-end=\"url(#back)\"/>\
             <text x=\"{:.1}\" y=\"{y:.1}\" class=\"small\">feedback</text>",
            y - 4.0,
            x + 35.0
        );
    }
}

/// As it may stand in XML; what XML cannot hold is left out.
fn escaped(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for letter in text.chars().filter(|it| !it.is_control() && !matches!(it, '\u{fffe}' | '\u{ffff}')) {
        match letter {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            other => escaped.push(other),
        }
    }
    escaped
}
