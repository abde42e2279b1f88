//! Plots as SVG: a frame with two axes, ticks and units, and what is drawn in it.

use std::fmt::Write as _;

use super::page::{escaped, fixed};

/// One axis of a plot.
#[derive(Debug, Clone)]
pub(crate) struct Axis {
    low: f64,
    high: f64,
    log: bool,
    label: String,
}

impl Axis {
    /// From `low` to `high`; a span without extent or with a number that is none becomes one that can be drawn.
    pub(crate) fn linear(low: f64, high: f64, label: &str) -> Self {
        let (low, high) = if low.is_finite() && high.is_finite() { (low, high) } else { (0.0, 1.0) };
        let high = if high > low { high } else { low + low.abs().max(1.0) };
        Self { low, high, log: false, label: label.to_owned() }
    }

    /// Logarithmic, widened to whole decades when it spans less than one.
    pub(crate) fn log(low: f64, high: f64, label: &str) -> Self {
        let usable = low > 0.0 && high >= low && high.is_finite();
        let (mut low, mut high) = if usable { (low, high) } else { (0.1, 10.0) };
        if high < 10.0 * low {
            (low, high) = (10_f64.powf(low.log10().floor()), 10_f64.powf(high.log10().ceil()));
            high = if high > low { high } else { 10.0 * low };
        }
        Self { low, high, log: true, label: label.to_owned() }
    }

    /// 0 at the low end, 1 at the high end.
    fn part(&self, value: f64) -> f64 {
        if self.log {
            (value / self.low).ln() / (self.high / self.low).ln()
        } else {
            (value - self.low) / (self.high - self.low)
        }
    }

    fn ticks(&self, most: usize) -> Vec<(f64, String)> {
        if self.log {
            let decades = self.low.log10().ceil() as i32..=self.high.log10().floor() as i32;
            let steps: &[f64] = if self.high / self.low < 200.0 { &[1.0, 2.0, 5.0] } else { &[1.0] };
            let all = (self.low.log10().floor() as i32..=*decades.end())
                .flat_map(|decade| steps.iter().map(move |it| it * 10_f64.powi(decade)));
            let inside = all.filter(|it| (self.low * 0.999..=self.high * 1.001).contains(it));
            return inside.map(|it| (it, plain(it))).collect();
        }
        let rough = (self.high - self.low) / most.max(1) as f64;
        let decade = 10_f64.powf(rough.log10().floor());
        let step =
            [1.0, 2.0, 5.0, 10.0].into_iter().map(|it| it * decade).find(|it| *it >= rough * 0.999).unwrap_or(rough);
        let digits = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
        let first = (self.low / step - 1e-6).ceil() as i64;
        let last = (self.high / step + 1e-6).floor() as i64;
        (first..=last.min(first + 50)).map(|it| it as f64 * step).map(|it| (it, fixed(it, digits))).collect()
    }
}

/// Without trailing zeros.
fn plain(value: f64) -> String {
    if (1e-4..1e5).contains(&value) {
        let digits = (-value.log10().floor()).max(0.0) as usize;
        format!("{value:.digits$}")
    } else {
        format!("{value:.0e}")
    }
}

/// A plot in the making.
pub(crate) struct Plot {
    width: f64,
    height: f64,
    left: f64,
    top: f64,
    inner: [f64; 2],
    x: Axis,
    y: Axis,
    name: String,
    body: String,
    y_ticks: bool,
}

impl Plot {
    /// `size`: of the whole picture [px of the page]; `name` is read out to those who do not see it.
    pub(crate) fn new(size: [f64; 2], x: Axis, y: Axis, name: &str) -> Self {
        let [left, top, right, bottom] = [46.0, 8.0, 10.0, 34.0];
        let inner = [size[0] - left - right, size[1] - top - bottom];
        let name = escaped(name);
        Self { width: size[0], height: size[1], left, top, inner, x, y, name, body: String::new(), y_ticks: true }
    }

    /// Room for `left` px of words at the rows, which the caller draws in place of ticks.
    pub(crate) fn with_rows(mut self, left: f64) -> Self {
        self.inner[0] += self.left - left;
        self.left = left;
        self.y_ticks = false;
        self
    }

    /// So that a unit is as long on either axis: the frame is shrunk, and stays in the middle.
    pub(crate) fn equal(mut self) -> Self {
        let span = [self.x.high - self.x.low, self.y.high - self.y.low];
        let scale = (self.inner[0] / span[0].abs()).min(self.inner[1] / span[1].abs());
        let inner = span.map(|it| it.abs() * scale);
        self.left += 0.5 * (self.inner[0] - inner[0]);
        self.height -= self.inner[1] - inner[1];
        self.inner = inner;
        self
    }

    /// With the low end of y at the top, as in images.
    pub(crate) fn down(mut self) -> Self {
        std::mem::swap(&mut self.y.low, &mut self.y.high);
        self
    }

    pub(crate) fn x(&self, value: f64) -> f64 {
        self.left + self.inner[0] * self.x.part(value)
    }

    pub(crate) fn y(&self, value: f64) -> f64 {
        self.top + self.inner[1] * (1.0 - self.y.part(value))
    }

    /// Left, top, right and bottom of the frame.
    pub(crate) fn frame(&self) -> [f64; 4] {
        [self.left, self.top, self.left + self.inner[0], self.top + self.inner[1]]
    }

    pub(crate) fn has(&self, x: f64, y: f64) -> bool {
        let inside = |part: f64| (-1e-9..=1.0 + 1e-9).contains(&part);
        inside(self.x.part(x)) && inside(self.y.part(y))
    }

    /// Puts in what is SVG already.
    pub(crate) fn raw(&mut self, svg: &str) {
        self.body += svg;
    }

    /// Dots as one path; what lies outside the frame is left out.
    pub(crate) fn dots(&mut self, class: &str, points: impl Iterator<Item = (f64, f64)>) {
        let mut path = String::new();
        for (x, y) in points.filter(|it| self.has(it.0, it.1)) {
            let _ = write!(path, "M{} {}h0", short(self.x(x)), short(self.y(y))); // writing to a String cannot fail
        }
        let _ = write!(self.body, "<path class=\"{class}\" d=\"{path}\"/>");
    }

    /// A line through the points that are numbers; broken where they leave the frame.
    pub(crate) fn line(&mut self, class: &str, points: impl Iterator<Item = (f64, f64)>) {
        let (mut path, mut pen_down) = (String::new(), false);
        for (x, y) in points {
            if !self.has(x, y) {
                pen_down = false;
                continue;
            }
            let _ = write!(path, "{}{} {}", if pen_down { 'L' } else { 'M' }, short(self.x(x)), short(self.y(y)));
            pen_down = true;
        }
        let _ = write!(self.body, "<path class=\"{class}\" d=\"{path}\"/>");
    }

    /// Bars from the low end of y, each from one x to the next.
    pub(crate) fn bars(&mut self, class: &str, bars: impl Iterator<Item = (f64, f64, f64)>) {
        let base = self.frame()[3];
        let mut path = String::new();
        for (from, to, value) in bars.filter(|it| it.2 > 0.0) {
            let [left, right, top] = [self.x(from), self.x(to), self.y(value)];
            let gap = if right - left > 3.0 { 0.5 } else { 0.0 };
            let (left, right) = (short(left + gap), short(right - gap));
            let _ = write!(path, "M{left} {}V{}H{right}V{}z", short(base), short(top), short(base));
        }
        let _ = write!(self.body, "<path class=\"{class}\" d=\"{path}\"/>");
    }

    pub(crate) fn text(&mut self, class: &str, x: f64, y: f64, text: &str) {
        let _ =
            write!(self.body, "<text class=\"{class}\" x=\"{}\" y=\"{}\">{}</text>", short(x), short(y), escaped(text));
    }

    pub(crate) fn finish(self) -> String {
        let Plot { width, height, ref body, ref name, .. } = self;
        let [left, top, right, bottom] = self.frame();
        let mut svg = format!(
            "<svg class=\"plot\" viewBox=\"0 0 {} {}\" width=\"{0}\" height=\"{1}\" role=\"img\" aria-label=\"{name}\">",
            short(width),
            short(height),
        );
        let (mut grid, mut words) = (String::new(), String::new());
        for (value, text) in self.x.ticks((self.inner[0] / 55.0) as usize) {
            let at = short(self.x(value));
            let _ = write!(grid, "M{at} {}V{}", short(top), short(bottom));
            let _ = write!(words, "<text class=\"tick m\" x=\"{at}\" y=\"{}\">{text}</text>", short(bottom + 13.0));
        }
        if self.y_ticks {
            let upright =
                Axis { low: self.y.low.min(self.y.high), high: self.y.low.max(self.y.high), ..self.y.clone() };
            for (value, text) in upright.ticks((self.inner[1] / 28.0) as usize) {
                let at = self.y(value);
                let _ = write!(grid, "M{} {}H{}", short(left), short(at), short(right));
                let _ = write!(
                    words,
                    "<text class=\"tick e\" x=\"{}\" y=\"{}\">{text}</text>",
                    short(left - 4.0),
                    short(at + 3.5)
                );
            }
        }
        let middle = [0.5 * (left + right), 0.5 * (top + bottom)].map(short);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"{grid}\"/>{body}<path class=\"frame\" d=\"M{} {}V{}H{}\"/>{words}",
            short(left),
            short(top),
            short(bottom),
            short(right),
        );
        let _ = write!(
            svg,
            "<text class=\"label m\" x=\"{}\" y=\"{}\">{}</text>",
            middle[0],
            short(bottom + 28.0),
            escaped(&self.x.label)
        );
        if !self.y.label.is_empty() {
            let across = short(left - 36.0);
            let _ = write!(
                svg,
                "<text class=\"label m\" transform=\"translate({across} {}) rotate(-90)\">{}</text>",
                middle[1],
                escaped(&self.y.label)
            );
        }
        svg + "</svg>"
    }
}

/// A coordinate with one digit after the point, or none where that is 0.
pub(crate) fn short(value: f64) -> String {
    let text = format!("{value:.1}");
    let text = text.strip_suffix(".0").unwrap_or(&text);
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

/// One of six shades for a part of the largest.
pub(crate) fn shade(part: f64) -> usize {
    if part > 0.0 { ((part * 5.0).ceil() as usize).clamp(1, 5) } else { 0 }
}
