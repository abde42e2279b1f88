//! The marks of a figure, written as SVG text. Coordinates are in pixels of the figure, y downwards.

use std::fmt::Write;

/// x, y [px].
pub type Point = [f64; 2];

/// How a line looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pen<'a> {
    /// As SVG writes it.
    pub colour: &'a str,
    /// [px]
    pub width: f64,
    /// Lengths of dash and pause, as SVG writes them; empty: none.
    pub dash: &'a str,
    /// From 0 to 1.
    pub opacity: f64,
}

impl<'a> Pen<'a> {
    /// Solid and opaque.
    pub const fn new(colour: &'a str, width: f64) -> Self {
        Self { colour, width, dash: "", opacity: 1.0 }
    }

    /// The same with dashes.
    pub const fn dashed(self, dash: &'a str) -> Self {
        Self { dash, ..self }
    }

    /// The same, so opaque.
    pub const fn faint(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    fn write(&self, body: &mut String) {
        write!(body, " stroke=\"{}\" stroke-width=\"{}\"", self.colour, self.width).ok();
        if !self.dash.is_empty() {
            write!(body, " stroke-dasharray=\"{}\"", self.dash).ok();
        }
        if self.opacity < 1.0 {
            write!(body, " stroke-opacity=\"{}\"", self.opacity).ok();
        }
    }
}

/// A rectangle [px].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rect {
    /// Of its left edge.
    pub left: f64,
    /// Of its upper edge.
    pub top: f64,
    /// To the right.
    pub width: f64,
    /// Downwards.
    pub height: f64,
}

impl Rect {
    /// Of its right edge.
    pub fn right(&self) -> f64 {
        self.left + self.width
    }

    /// Of its lower edge.
    pub fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// Whether the two have more than an edge in common.
    pub fn overlaps(&self, other: &Rect) -> bool {
        self.left < other.right() && other.left < self.right() && self.top < other.bottom() && other.top < self.bottom()
    }

    /// Whether `other` lies within, edges included.
    pub fn holds(&self, other: &Rect) -> bool {
        self.left <= other.left
            && other.right() <= self.right()
            && self.top <= other.top
            && other.bottom() <= self.bottom()
    }
}

/// Where a text's anchor point lies within it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// At its left end.
    Start,
    /// Halfway.
    Middle,
    /// At its right end.
    End,
}

/// Ordinary text [px].
pub const TEXT: f64 = 13.0;
/// Titles [px].
pub const TITLE: f64 = 15.0;
/// Names within a picture [px].
pub const SMALL: f64 = 11.0;
/// Colour of text and axes.
pub const INK: &str = "#222222";

/// About how wide a text is [px]; a little more than common fonts need.
pub fn text_width(text: &str, size: f64) -> f64 {
    0.58 * size * text.chars().count() as f64
}

/// A figure that grows mark by mark.
#[derive(Debug)]
pub struct Svg {
    width: f64,
    height: f64,
    body: String,
    n_clips: usize,
}

impl Svg {
    /// A white figure of that size with a heading.
    pub fn new(width: f64, height: f64, title: &str) -> Self {
        let mut svg = Self { width, height, body: String::new(), n_clips: 0 };
        svg.text([16.0, 26.0], Anchor::Start, TITLE, title);
        svg
    }

    /// Straight lines from point to point, one for each piece, as one mark.
    pub fn lines(&mut self, pieces: &[Vec<Point>], pen: Pen<'_>) {
        if pieces.iter().all(|piece| piece.len() < 2) {
            return;
        }
        self.body.push_str("<path fill=\"none\" stroke-linejoin=\"round\"");
        pen.write(&mut self.body);
        self.body.push_str(" d=\"");
        pieces.iter().filter(|piece| piece.len() > 1).for_each(|piece| outline(&mut self.body, piece));
        self.body.push_str("\"/>\n");
    }

    /// One straight line.
    pub fn line(&mut self, from: Point, to: Point, pen: Pen<'_>) {
        self.lines(&[vec![from, to]], pen);
    }

    /// A closed area in one colour.
    pub fn area(&mut self, points: &[Point], colour: &str, opacity: f64, pen: Option<Pen<'_>>) {
        write!(self.body, "<path fill=\"{colour}\" fill-opacity=\"{opacity}\"").ok();
        if let Some(pen) = pen {
            pen.write(&mut self.body);
        }
        self.body.push_str(" d=\"");
        outline(&mut self.body, points);
        self.body.push_str("z\"/>\n");
    }

    /// A rectangle, filled and edged.
    pub fn rect(&mut self, rect: Rect, fill: &str, pen: Option<Pen<'_>>) {
        let Rect { left, top, width, height } = rect;
        write!(
            self.body,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{fill}\""
        )
        .ok();
        if let Some(pen) = pen {
            pen.write(&mut self.body);
        }
        self.body.push_str("/>\n");
    }

    /// A rectangle whose edges lie on whole pixels, so that neighbours leave no seam.
    pub fn cell(&mut self, rect: Rect, fill: &str) {
        let Rect { left, top, width, height } = rect;
        writeln!(
            self.body,
            "<rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\" fill=\"{fill}\" shape-rendering=\"crispEdges\"/>"
        )
        .ok();
    }

    /// A circle around a point, `radius` in px.
    pub fn circle(&mut self, [x, y]: Point, radius: f64, fill: &str, pen: Pen<'_>) {
        write!(self.body, "<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius}\" fill=\"{fill}\"").ok();
        pen.write(&mut self.body);
        self.body.push_str("/>\n");
    }

    /// `at`: the anchor, on the base line.
    pub fn text(&mut self, [x, y]: Point, anchor: Anchor, size: f64, text: &str) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let text = escaped(text);
        writeln!(
            self.body,
            "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-size=\"{size}\">{text}</text>"
        )
        .ok();
    }

    /// Read from below, centred on `at`.
    pub fn text_upwards(&mut self, [x, y]: Point, size: f64, text: &str) {
        let text = escaped(text);
        writeln!(
            self.body,
            "<text transform=\"translate({x:.1},{y:.1}) rotate(-90)\" text-anchor=\"middle\" font-size=\"{size}\">{text}</text>"
        )
        .ok();
    }

    /// Draws what `marks` draws, within `rect` only.
    pub fn within(&mut self, rect: Rect, marks: impl FnOnce(&mut Svg)) {
        self.n_clips += 1;
        let Rect { left, top, width, height } = rect;
        write!(
            self.body,
            "<clipPath id=\"c{0}\"><rect x=\"{left:.1}\" y=\"{top:.1}\" width=\"{width:.1}\" height=\"{height:.1}\"/></clipPath>\n<g clip-path=\"url(#c{0})\">\n",
            self.n_clips
        )
        .ok();
        marks(self);
        self.body.push_str("</g>\n");
    }

    /// The whole file.
    pub fn finish(self) -> String {
        let Self { width, height, body, .. } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" \
             font-family=\"Helvetica, Arial, Liberation Sans, DejaVu Sans, sans-serif\" fill=\"{INK}\">\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"white\"/>\n{body}</svg>\n"
        )
    }
}

/// Path data in tenths of a pixel, each step relative to the rounded point before, so that rounding does not add up.
fn outline(body: &mut String, points: &[Point]) {
    let tenths = |point: &Point| point.map(|it| (it.clamp(-1e5, 1e5) * 10.0).round() as i64);
    let Some(first) = points.first().map(tenths) else { return };
    body.push('M');
    tenth(body, first[0]);
    body.push(' ');
    tenth(body, first[1]);
    body.push('l');
    let mut before = first;
    for (index, point) in points.iter().enumerate().skip(1) {
        let point = tenths(point);
        if index > 1 {
            body.push(' ');
        }
        tenth(body, point[0] - before[0]);
        body.push(' ');
        tenth(body, point[1] - before[1]);
        before = point;
    }
}

fn tenth(body: &mut String, tenths: i64) {
    let sign = if tenths < 0 { "-" } else { "" };
    let (whole, rest) = (tenths.abs() / 10, tenths.abs() % 10);
    if rest == 0 {
        write!(body, "{sign}{whole}").ok()
    } else {
        write!(body, "{sign}{whole}.{rest}").ok()
    };
}

fn escaped(text: &str) -> String {
    let shown = |it: char| if it.is_control() { ' ' } else { it };
    let text: String = text.chars().map(shown).collect();
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_do_not_add_up_their_rounding() {
        let mut body = String::new();
        outline(&mut body, &[[0.04, 1.0], [0.08, 1.25], [0.12, 0.0], [-0.3, 0.0]]);
        assert_eq!(body, "M0 1l0.1 0.3 0 -1.3 -0.4 0");
    }

    #[test]
    fn text_cannot_break_the_file() {
        let mut svg = Svg::new(100.0, 50.0, "a < b & \u{1}c");
        svg.lines(&[vec![[0.0, 0.0]]], Pen::new("red", 1.0));
        let text = svg.finish();
        assert!(text.contains("a &lt; b &amp;  c") && !text.contains("<path"), "{text}");
    }

    #[test]
    fn rectangles_that_touch_do_not_overlap() {
        let rect = |left: f64| Rect { left, top: 0.0, width: 10.0, height: 10.0 };
        assert!(rect(0.0).overlaps(&rect(9.9)) && !rect(0.0).overlaps(&rect(10.0)));
        assert!(rect(0.0).holds(&rect(0.0)) && !rect(0.0).holds(&rect(0.1)));
    }
}
