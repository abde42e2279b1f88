//! SVG drawing: lines, areas, dots and texts. Coordinates are in pixels of the figure, y downwards.
//!
//! Points with a coordinate that is not finite are not drawn; lines break there.

use std::fmt::Write;

use crate::colours::{PAPER, Theme};
use crate::text::{coordinate, escaped, fitted, push_tenths, tenths};

/// A point x, y [px].
pub type Point = [f64; 2];

/// Line style.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pen<'a> {
    /// Colour, as SVG writes it.
    pub colour: &'a str,
    /// Width [px].
    pub width: f64,
    /// Lengths of dash and gap, as SVG writes them; empty: solid.
    pub dash: &'a str,
    /// Opacity, 0 to 1.
    pub opacity: f64,
}

impl<'a> Pen<'a> {
    /// A solid, opaque line.
    pub const fn new(colour: &'a str, width: f64) -> Self {
        Self { colour, width, dash: "", opacity: 1.0 }
    }

    /// The same line with dashes.
    pub const fn dashed(self, dash: &'a str) -> Self {
        Self { dash, ..self }
    }

    /// The same line with this opacity.
    pub const fn faint(self, opacity: f64) -> Self {
        Self { opacity, ..self }
    }

    fn write(&self, body: &mut String) {
        // Writing to a String cannot fail, here and below.
        let _ = write!(body, " stroke=\"{}\" stroke-width=\"{}\"", self.colour, coordinate(self.width));
        if !self.dash.is_empty() {
            let _ = write!(body, " stroke-dasharray=\"{}\"", self.dash);
        }
        if self.opacity < 1.0 {
            let _ = write!(body, " stroke-opacity=\"{}\"", self.opacity);
        }
    }
}

/// A rectangle [px].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rect {
    /// Left edge [px].
    pub left: f64,
    /// Upper edge [px].
    pub top: f64,
    /// Width [px].
    pub width: f64,
    /// Height [px].
    pub height: f64,
}

impl Rect {
    /// Right edge [px].
    pub fn right(&self) -> f64 {
        self.left + self.width
    }

    /// Lower edge [px].
    pub fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// Centre [px].
    pub fn middle(&self) -> Point {
        [self.left + 0.5 * self.width, self.top + 0.5 * self.height]
    }

    /// Whether the two overlap by more than an edge.
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

/// Position of a text relative to its anchor point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Anchor {
    /// The anchor is at the left end.
    Start,
    /// The anchor is in the middle.
    Middle,
    /// The anchor is at the right end.
    End,
}

/// Size of ordinary text [px].
pub const TEXT: f64 = 13.0;
/// Size of titles [px].
pub const TITLE: f64 = 16.0;
/// Size of names and numbers within a picture [px].
pub const SMALL: f64 = 12.0;

/// Text style.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Font<'a> {
    /// Size [px].
    pub size: f64,
    /// Colour; `None`: the theme's ink.
    pub colour: Option<&'a str>,
    /// Whether the text is bold.
    pub bold: bool,
    /// Whether the text has an outline in the background colour, for use over other marks.
    pub halo: bool,
}

impl<'a> Font<'a> {
    /// Plain text of this size, in ink.
    pub const fn new(size: f64) -> Self {
        Self { size, colour: None, bold: false, halo: false }
    }

    /// The same text in another colour.
    pub const fn coloured(self, colour: &'a str) -> Self {
        Self { colour: Some(colour), ..self }
    }

    /// The same text in bold.
    pub const fn bold(self) -> Self {
        Self { bold: true, ..self }
    }

    /// The same text with an outline in the background colour.
    pub const fn with_halo(self) -> Self {
        Self { halo: true, ..self }
    }
}

impl From<f64> for Font<'_> {
    fn from(size: f64) -> Self {
        Self::new(size)
    }
}

/// A segment of a curve.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Step {
    /// A straight line to this point.
    To(Point),
    /// A quadratic Bézier curve: control point and end.
    Quadratic(Point, Point),
    /// A cubic Bézier curve: two control points and end.
    Cubic(Point, Point, Point),
}

/// An SVG figure that marks are added to.
#[derive(Debug)]
pub struct Svg {
    width: f64,
    height: f64,
    title: String,
    body: String,
    theme: Theme,
}

impl Svg {
    /// A white figure of that size with a heading, cut where it is too long; the file's title has all of it.
    pub fn new(width: f64, height: f64, title: &str) -> Self {
        let mut svg = Self::bare(width, height, title, PAPER);
        svg.text([16.0, 26.0], Anchor::Start, TITLE, &fitted(title, TITLE, width - 32.0));
        svg
    }

    /// A figure without a heading; `title` is for screen readers.
    pub fn bare(width: f64, height: f64, title: &str, theme: Theme) -> Self {
        Self { width, height, title: title.to_owned(), body: String::new(), theme }
    }

    /// The theme in use.
    pub fn theme(&self) -> &Theme {
        &self.theme
    }

    /// Draws polylines, one for each piece, as one mark.
    pub fn lines(&mut self, pieces: &[Vec<Point>], pen: Pen<'_>) {
        let whole = |piece| <[Point]>::split(piece, |it: &Point| !is_sound(it)).filter(|it| it.len() > 1);
        let mut outlines = String::new();
        pieces.iter().flat_map(|it| whole(it)).for_each(|piece| outline(&mut outlines, piece));
        if !outlines.is_empty() {
            self.body.push_str("<path fill=\"none\" stroke-linejoin=\"round\"");
            pen.write(&mut self.body);
            let _ = writeln!(self.body, " d=\"{outlines}\"/>");
        }
    }

    /// Draws a straight line.
    pub fn line(&mut self, from: Point, to: Point, pen: Pen<'_>) {
        self.lines(&[vec![from, to]], pen);
    }

    /// Draws a curve.
    pub fn curve(&mut self, from: Point, steps: &[Step], pen: Pen<'_>) {
        let write = |it: Point| it.map(coordinate).join(" ");
        let mut path = format!("M{}", write(from));
        for step in steps {
            let _ = match *step {
                Step::To(to) => write!(path, "L{}", write(to)),
                Step::Quadratic(over, to) => write!(path, "Q{} {}", write(over), write(to)),
                Step::Cubic(first, second, to) => write!(path, "C{} {} {}", write(first), write(second), write(to)),
            };
        }
        self.body.push_str("<path fill=\"none\"");
        pen.write(&mut self.body);
        let _ = writeln!(self.body, " d=\"{path}\"/>");
    }

    /// Draws a closed area in one colour.
    pub fn area(&mut self, points: &[Point], colour: &str, opacity: f64, pen: Option<Pen<'_>>) {
        self.areas(&[points.to_vec()], colour, opacity, pen);
    }

    /// Draws closed areas in one colour, as one mark.
    pub fn areas(&mut self, areas: &[Vec<Point>], colour: &str, opacity: f64, pen: Option<Pen<'_>>) {
        let mut outlines = String::new();
        for area in areas.iter().filter(|it| it.len() > 1 && it.iter().all(is_sound)) {
            outline(&mut outlines, area);
            outlines.push('z');
        }
        if outlines.is_empty() {
            return;
        }
        let _ = write!(self.body, "<path fill=\"{colour}\"");
        if opacity < 1.0 {
            let _ = write!(self.body, " fill-opacity=\"{opacity}\"");
        }
        if let Some(pen) = pen {
            pen.write(&mut self.body);
        }
        let _ = writeln!(self.body, " d=\"{outlines}\"/>");
    }

    /// Draws a rectangle.
    pub fn rect(&mut self, rect: Rect, fill: &str, pen: Option<Pen<'_>>) {
        self.rounded(rect, 0.0, fill, pen);
    }

    /// Draws a rectangle with round corners of that radius [px].
    pub fn rounded(&mut self, rect: Rect, radius: f64, fill: &str, pen: Option<Pen<'_>>) {
        let _ = write!(self.body, "<rect{} fill=\"{fill}\"", place_of(&rect));
        if radius > 0.0 {
            let _ = write!(self.body, " rx=\"{}\"", coordinate(radius));
        }
        if let Some(pen) = pen {
            pen.write(&mut self.body);
        }
        self.body.push_str("/>\n");
    }

    /// Draws rectangles in one colour, as one mark, with sharp edges, so that neighbours leave no seam.
    pub fn cells(&mut self, cells: &[Rect], fill: &str) {
        if cells.is_empty() {
            return;
        }
        let _ = write!(self.body, "<path fill=\"{fill}\" shape-rendering=\"crispEdges\" d=\"");
        for &Rect { left, top, width, height } in cells {
            let [left, top, width, height] = [left, top, width, height].map(coordinate);
            let _ = write!(self.body, "M{left} {top}h{width}v{height}h-{width}z");
        }
        self.body.push_str("\"/>\n");
    }

    /// Draws a circle, `radius` in px.
    pub fn circle(&mut self, at: Point, radius: f64, fill: &str, pen: Pen<'_>) {
        if is_sound(&at) {
            let [x, y] = at.map(coordinate);
            let _ = write!(self.body, "<circle cx=\"{x}\" cy=\"{y}\" r=\"{}\" fill=\"{fill}\"", coordinate(radius));
            pen.write(&mut self.body);
            self.body.push_str("/>\n");
        }
    }

    /// Draws filled dots, as one mark.
    pub fn dots(&mut self, points: impl IntoIterator<Item = Point>, radius: f64, colour: &str, opacity: f64) {
        let mut path = String::new();
        for point in points.into_iter().filter(is_sound) {
            let [x, y] = point.map(coordinate);
            let _ = write!(path, "M{x} {y}h0");
        }
        if !path.is_empty() {
            self.body.push_str("<path fill=\"none\" stroke-linecap=\"round\"");
            Pen::new(colour, 2.0 * radius).faint(opacity).write(&mut self.body);
            let _ = writeln!(self.body, " d=\"{path}\"/>");
        }
    }

    /// Draws the head of an arrow that ends at `at` and points to the right.
    pub fn arrow_head(&mut self, [x, y]: Point, colour: &str) {
        self.area(&[[x, y], [x - 9.0, y - 4.2], [x - 9.0, y + 4.2]], colour, 1.0, None);
    }

    /// Writes a text; `at` is the anchor, on the base line.
    pub fn text<'f>(&mut self, at: Point, anchor: Anchor, font: impl Into<Font<'f>>, text: &str) {
        if is_sound(&at) {
            let [x, y] = at.map(coordinate);
            self.written(&format!(" x=\"{x}\" y=\"{y}\""), anchor, font.into(), text);
        }
    }

    /// Writes a text that runs upwards; `at` is its middle, on the base line.
    pub fn text_upwards<'f>(&mut self, at: Point, font: impl Into<Font<'f>>, text: &str) {
        self.text_turned(at, Anchor::Middle, font, text);
    }

    /// Writes a text that runs upwards; `at` is the anchor, on the base line.
    pub fn text_turned<'f>(&mut self, at: Point, anchor: Anchor, font: impl Into<Font<'f>>, text: &str) {
        if is_sound(&at) {
            let [x, y] = at.map(coordinate);
            self.written(&format!(" transform=\"translate({x},{y}) rotate(-90)\""), anchor, font.into(), text);
        }
    }

    fn written(&mut self, place: &str, anchor: Anchor, font: Font<'_>, text: &str) {
        if text.is_empty() {
            return;
        }
        let anchor = match anchor {
            Anchor::Start => "",
            Anchor::Middle => " text-anchor=\"middle\"",
            Anchor::End => " text-anchor=\"end\"",
        };
        let _ = write!(self.body, "<text{place}{anchor} font-size=\"{}\"", coordinate(font.size));
        if let Some(colour) = font.colour {
            let _ = write!(self.body, " fill=\"{colour}\"");
        }
        if font.bold {
            self.body.push_str(" font-weight=\"600\"");
        }
        if font.halo {
            let paper = self.theme.paper;
            let _ = write!(
                self.body,
                " paint-order=\"stroke\" stroke=\"{paper}\" stroke-width=\"3\" stroke-linejoin=\"round\""
            );
        }
        let _ = writeln!(self.body, ">{}</text>", escaped(text));
    }

    /// Clips what `marks` draws to `rect`.
    pub fn within(&mut self, rect: Rect, marks: impl FnOnce(&mut Svg)) {
        // A figure in the figure: unlike a clip path it needs no name, of which there may be but one in a page.
        let place = place_of(&rect);
        let view = [rect.left, rect.top, rect.width, rect.height].map(coordinate).join(" ");
        let _ = writeln!(self.body, "<svg{place} viewBox=\"{view}\" overflow=\"hidden\">");
        marks(self);
        self.body.push_str("</svg>\n");
    }

    /// Gives what `marks` draws a tooltip `about`.
    pub fn with_hint(&mut self, about: &str, marks: impl FnOnce(&mut Svg)) {
        let _ = write!(self.body, "<g><title>{}</title>", escaped(about));
        marks(self);
        self.body.push_str("</g>\n");
    }

    /// The whole SVG file.
    pub fn finish(self) -> String {
        let (size, title) = (self.size(), escaped(&self.title));
        let Self { body, theme, .. } = self;
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" {size} role=\"img\" fill=\"{}\" \
             font-family=\"Helvetica, Arial, Liberation Sans, DejaVu Sans, sans-serif\">\n<title>{title}</title>\n\
             <rect width=\"100%\" height=\"100%\" fill=\"{}\"/>\n{body}</svg>\n",
            theme.ink, theme.paper
        )
    }

    /// The figure as an element of a page, in the page's font; `class`: for its style sheet.
    pub fn element(self, class: &str) -> String {
        let size = self.size();
        let (ink, name, body) = (self.theme.ink, escaped(&self.title), self.body);
        format!("<svg class=\"{class}\" {size} role=\"img\" aria-label=\"{name}\" fill=\"{ink}\">{body}</svg>")
    }

    fn size(&self) -> String {
        let [width, height] = [self.width, self.height].map(|it| coordinate(it.max(1.0)));
        format!("width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\"")
    }
}

fn is_sound(point: &Point) -> bool {
    point.iter().all(|it| it.is_finite())
}

fn place_of(rect: &Rect) -> String {
    let [x, y] = [rect.left, rect.top].map(coordinate);
    let [width, height] = [rect.width, rect.height].map(|it| coordinate(it.max(0.0)));
    format!(" x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\"")
}

/// Path data in tenths of a pixel, each step relative to the rounded point before, so that rounding does not add up.
fn outline(body: &mut String, points: &[Point]) {
    let rounded = |point: &Point| point.map(tenths);
    let Some(first) = points.first().map(rounded) else { return };
    body.push('M');
    push_tenths(body, first[0]);
    body.push(' ');
    push_tenths(body, first[1]);
    body.push('l');
    let mut before = first;
    for (index, point) in points.iter().enumerate().skip(1) {
        let point = rounded(point);
        if index > 1 {
            body.push(' ');
        }
        push_tenths(body, point[0] - before[0]);
        body.push(' ');
        push_tenths(body, point[1] - before[1]);
        before = point;
    }
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
        let mut svg = Svg::new(100.0, 50.0, "a < b & \u{1}c \"]]>");
        svg.lines(&[vec![[0.0, 0.0]]], Pen::new("red", 1.0));
        svg.with_hint("<&>", |svg| svg.text([1.0, 2.0], Anchor::End, SMALL, "</svg>"));
        let text = svg.finish();
        let xml = roxmltree::Document::parse(&text).unwrap();
        let titles: Vec<&str> =
            xml.descendants().filter(|it| it.has_tag_name("title")).filter_map(|it| it.text()).collect();
        assert_eq!(titles, ["a < b &  c \"]]>", "<&>"]);
        assert!(!text.contains("<path"), "a line of one point is none");
    }

    #[test]
    fn what_has_no_place_is_left_out_and_lines_break_there() {
        let bad = [f64::NAN, f64::INFINITY, f64::NEG_INFINITY];
        let mut svg = Svg::new(f64::NAN, f64::INFINITY, "");
        for x in bad {
            svg.circle([x, 1.0], 2.0, "red", Pen::new("red", 1.0));
            svg.text([1.0, x], Anchor::Start, SMALL, "gone");
            svg.text_upwards([1.0, x], SMALL, "gone");
            svg.dots([[x, x]], 1.0, "red", 1.0);
            svg.area(&[[0.0, 0.0], [1.0, x], [2.0, 0.0]], "red", 1.0, None);
            svg.rect(Rect { left: x, top: x, width: x, height: x }, "red", None);
            svg.lines(&[vec![[0.0, 0.0], [1.0, 0.0], [x, 0.0], [2.0, 0.0], [3.0, 0.0]]], Pen::new("red", 1.0));
        }
        let text = svg.finish();
        assert!(!text.contains("NaN") && !text.contains("inf") && !text.contains("gone"), "{text}");
        assert_eq!(text.matches("d=\"M0 0l1 0M2 0l1 0\"").count(), 3);
        assert_eq!((text.matches("<circle").count(), text.matches("<path").count()), (0, 3));
    }

    #[test]
    fn rectangles_that_touch_do_not_overlap() {
        let rect = |left: f64| Rect { left, top: 0.0, width: 10.0, height: 10.0 };
        assert!(rect(0.0).overlaps(&rect(9.9)) && !rect(0.0).overlaps(&rect(10.0)));
        assert!(rect(0.0).holds(&rect(0.0)) && !rect(0.0).holds(&rect(0.1)));
    }
}
