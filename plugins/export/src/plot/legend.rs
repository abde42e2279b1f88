//! Colours, and the list that says what they mean.

use super::Subject;
use super::svg::{Anchor, INK, Pen, Point, SMALL, Svg};

/// Ten colours that stay apart for most eyes and in gray.
pub const COLOURS: [&str; 10] =
    ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#332288", "#56b4e9", "#882255", "#8a8a00", "#8c564b"];
/// Tracks without a colour of their own.
pub const OTHERS: &str = "#b3a58f";
/// Truth, behind all else.
pub const TRUTH: Pen<'static> = Pen::new("#9a9a9a", 2.6);
/// Width of a measured stretch [px].
pub const MEASURED: f64 = 1.3;
/// Dashes of a predicted stretch.
pub const PREDICTED: &str = "3 2.4";
/// Space that a legend needs beside a figure [px].
pub const LEGEND_WIDTH: f64 = 176.0;

const LINE_HEIGHT: f64 = 19.0;

/// What stands before an entry.
#[derive(Debug, Clone, Copy)]
pub enum Key<'a> {
    /// A stretch of line.
    Line(Pen<'a>),
    /// Colour and opacity.
    Swatch(&'a str, f64),
    /// A small circle.
    Dot {
        /// Its colour.
        fill: &'a str,
    },
    /// The symbol of a camera.
    Camera,
}

/// A list of entries, from the top down.
pub struct Legend {
    left: f64,
    next: f64,
}

impl Legend {
    /// A list whose upper left corner is there [px].
    pub fn at([left, top]: Point) -> Self {
        Self { left, next: top }
    }

    /// The next line of the list.
    pub fn entry(&mut self, svg: &mut Svg, key: Key<'_>, text: &str) {
        let (left, middle) = (self.left, self.next + LINE_HEIGHT / 2.0);
        match key {
            Key::Line(pen) => svg.line([left, middle], [left + 24.0, middle], pen),
            Key::Swatch(colour, opacity) => {
                let box_ = [
                    [left, middle - 5.0],
                    [left + 24.0, middle - 5.0],
                    [left + 24.0, middle + 5.0],
                    [left, middle + 5.0],
                ];
                svg.area(&box_, colour, opacity, None);
            }
            Key::Dot { fill } => svg.circle([left + 12.0, middle], 3.0, fill, Pen::new(INK, 1.2)),
            Key::Camera => {
                svg.area(
                    &[[left + 4.0, middle], [left + 20.0, middle - 6.0], [left + 20.0, middle + 6.0]],
                    "#888888",
                    0.25,
                    Some(Pen::new("#555555", 0.9)),
                );
                svg.circle([left + 4.0, middle], 2.0, "#333333", Pen::new("#333333", 0.5));
            }
        }
        svg.text([left + 32.0, middle + 4.0], Anchor::Start, SMALL, text);
        self.next += LINE_HEIGHT;
    }

    /// A line of a known length, at most 100 px, with the length below.
    pub fn scale_bar(&mut self, svg: &mut Svg, pixels: f64, text: &str) {
        let (left, right, y) = (self.left, self.left + pixels, self.next + LINE_HEIGHT / 2.0);
        svg.line([left, y], [right, y], Pen::new(INK, 2.0));
        for end in [left, right] {
            svg.line([end, y - 4.0], [end, y + 4.0], Pen::new(INK, 1.2));
        }
        let middle = (left + right) / 2.0;
        svg.text([middle.max(left + 20.0), y + 18.0], Anchor::Middle, SMALL, text);
        self.next += 2.0 * LINE_HEIGHT;
    }

    /// Free space between groups.
    pub fn skip(&mut self) {
        self.next += LINE_HEIGHT * 0.5;
    }

    /// The tracks of `subject`, and what those are that have no line of their own.
    pub(crate) fn tracks(&mut self, svg: &mut Svg, subject: &Subject<'_>) {
        for it in &subject.tracks {
            self.entry(svg, Key::Line(Pen::new(it.colour, 2.2)), &format!("target {}", it.id.0));
        }
        let n_others = subject.others.len() as u64;
        if n_others > 0 {
            self.entry(svg, Key::Line(Pen::new(OTHERS, 1.4)), &format!("{n_others} shorter tracks"));
        }
        if subject.n_left_out > 0 {
            svg.text(
                [self.left, self.next + 13.0],
                Anchor::Start,
                SMALL,
                &format!("{} short ones left out", subject.n_left_out),
            );
            self.next += LINE_HEIGHT;
        }
        if !subject.truth.is_empty() {
            self.entry(svg, Key::Line(TRUTH), "truth");
        }
        self.skip();
    }

    /// Solid and dashed.
    pub fn line_styles(&mut self, svg: &mut Svg) {
        self.entry(svg, Key::Line(Pen::new(INK, MEASURED)), "measured");
        self.entry(svg, Key::Line(Pen::new(INK, MEASURED).dashed(PREDICTED)), "predicted");
    }

    /// The least height of a figure that holds a legend of so many entries from `top` on [px].
    pub(crate) fn height(subject: &Subject<'_>, n_more: usize) -> f64 {
        let n = subject.tracks.len() + n_more + 4;
        LINE_HEIGHT * n as f64
    }
}
