//! Legends: a list of what colours and signs mean, beside the panels.

use crate::svg::{Anchor, Font, Pen, Point, SMALL, Svg, TEXT};
use crate::text::{fitted, text_width};

/// Width of a legend beside a figure [px].
pub const LEGEND_WIDTH: f64 = 190.0;
/// Height of an entry [px].
pub const LINE_HEIGHT: f64 = 19.0;
/// From the left of the key to the text [px].
const KEY: f64 = 32.0;

/// Symbol of an entry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Key<'a> {
    /// A stretch of line.
    Line(Pen<'a>),
    /// A filled area: colour and opacity.
    Swatch(&'a str, f64),
    /// A small circle with an edge.
    Dot {
        /// Colour of the circle.
        fill: &'a str,
        /// Colour of its edge.
        edge: &'a str,
    },
    /// The symbol of a camera.
    Camera,
}

/// A list of entries, from the top down.
#[derive(Debug)]
pub struct Legend {
    left: f64,
    next: f64,
    width: f64,
}

impl Legend {
    /// A list with its upper left corner at this point [px], [`LEGEND_WIDTH`] wide.
    pub fn at([left, top]: Point) -> Self {
        Self { left, next: top, width: LEGEND_WIDTH }
    }

    /// The list with another width [px].
    pub fn wide(self, width: f64) -> Self {
        Self { width, ..self }
    }

    /// Width of a list with these `texts` [px].
    pub fn width_of<'t>(texts: impl IntoIterator<Item = &'t str>) -> f64 {
        KEY + texts.into_iter().map(|it| text_width(it, SMALL)).fold(0.0, f64::max)
    }

    /// Top of the next entry [px].
    pub fn bottom(&self) -> f64 {
        self.next
    }

    /// Continues from there, unless the list is further down already [px].
    pub fn down_to(&mut self, top: f64) {
        self.next = self.next.max(top);
    }

    /// Adds a heading over the entries that follow.
    pub fn heading(&mut self, svg: &mut Svg, text: &str) {
        let font = Font::new(TEXT).bold();
        svg.text([self.left, self.next + 12.0], Anchor::Start, font, &fitted(text, TEXT, self.width));
        self.next += LINE_HEIGHT + 2.0;
    }

    /// Adds a line of text without a symbol.
    pub fn words(&mut self, svg: &mut Svg, text: &str) {
        svg.text([self.left, self.next + 13.0], Anchor::Start, SMALL, &fitted(text, SMALL, self.width));
        self.next += LINE_HEIGHT;
    }

    /// Adds an entry.
    pub fn entry(&mut self, svg: &mut Svg, key: Key<'_>, text: &str) {
        let (left, middle) = (self.left, self.next + LINE_HEIGHT / 2.0);
        let ink = svg.theme().ink;
        match key {
            Key::Line(pen) => svg.line([left, middle], [left + 24.0, middle], pen),
            Key::Swatch(colour, opacity) => {
                let [top, bottom, right] = [middle - 6.0, middle + 6.0, left + 24.0];
                let corners = [[left, top], [right, top], [right, bottom], [left, bottom]];
                svg.area(&corners, colour, opacity, None);
            }
            Key::Dot { fill, edge } => svg.circle([left + 12.0, middle], 3.0, fill, Pen::new(edge, 1.2)),
            Key::Camera => {
                let view = [[left + 4.0, middle], [left + 20.0, middle - 6.0], [left + 20.0, middle + 6.0]];
                svg.area(&view, "#888888", 0.25, Some(Pen::new("#555555", 0.9)));
                svg.circle([left + 4.0, middle], 2.0, ink, Pen::new(ink, 0.5));
            }
        }
        // A width out of `width_of` may be short by a rounding.
        let text = fitted(text, SMALL, self.width - KEY + 1e-6);
        svg.text([left + KEY, middle + 4.0], Anchor::Start, SMALL, &text);
        self.next += LINE_HEIGHT;
    }

    /// Adds a scale bar, at most 100 px long, with its length as text below.
    pub fn scale_bar(&mut self, svg: &mut Svg, pixels: f64, text: &str) {
        let (left, right, y) = (self.left, self.left + pixels, self.next + LINE_HEIGHT / 2.0);
        let ink = svg.theme().ink;
        svg.line([left, y], [right, y], Pen::new(ink, 2.0));
        for end in [left, right] {
            svg.line([end, y - 4.0], [end, y + 4.0], Pen::new(ink, 1.2));
        }
        let middle = (left + right) / 2.0;
        let half = text_width(text, SMALL) / 2.0;
        svg.text([middle.max(left + half), y + 18.0], Anchor::Middle, SMALL, text);
        self.next += 2.0 * LINE_HEIGHT;
    }

    /// Leaves space between groups.
    pub fn skip(&mut self) {
        self.next += LINE_HEIGHT * 0.5;
    }
}
