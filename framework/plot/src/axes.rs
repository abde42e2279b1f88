//! Axes: maps from values to positions in a figure.

use crate::svg::{Anchor, Font, Pen, Point, Rect, SMALL, Svg, TEXT};
use crate::text::{fitted_label, text_width};
use crate::ticks::Ticks;

/// A range of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Lower end.
    pub min: f64,
    /// Upper end.
    pub max: f64,
}

impl Range {
    /// Range of the finite values; `None` without any.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        // Lengths of ranges must stay finite.
        let finite = values.into_iter().filter(|it| it.is_finite()).map(|it| it.clamp(-1e300, 1e300));
        finite.fold(None, |range: Option<Range>, value| {
            let (min, max) = range.map_or((value, value), |it| (it.min.min(value), it.max.max(value)));
            Some(Range { min, max })
        })
    }

    /// Range of most of `values`, without a few far outliers.
    pub fn of_most(values: &mut [f64]) -> Option<Self> {
        let whole = Self::of(values.iter().copied())?;
        values.sort_unstable_by(f64::total_cmp);
        let finite: Vec<f64> = values.iter().copied().filter(|it| it.is_finite()).collect();
        let at = |share: f64| finite[((finite.len() - 1) as f64 * share).round() as usize];
        let most = Range { min: at(0.005).max(-1e300), max: at(0.995).min(1e300) };
        Some(if whole.length() <= 2.0 * most.length() { whole } else { most.widened(0.1) })
    }

    /// Length of the range.
    pub fn length(&self) -> f64 {
        self.max - self.min
    }

    /// The smallest range that contains both.
    pub fn union(self, other: Option<Range>) -> Self {
        other.map_or(self, |it| Range { min: self.min.min(it.min), max: self.max.max(it.max) })
    }

    /// The range extended by `share` of its length at either end; a point becomes a short range.
    pub fn widened(self, share: f64) -> Self {
        let by = if self.length() > 0.0 { self.length() * share } else { (self.min.abs() * share).max(1e-3) };
        Range { min: self.min - by, max: self.max + by }
    }

    /// A range of this length with the same middle.
    pub fn around_middle(self, length: f64) -> Self {
        let middle = 0.5 * self.min + 0.5 * self.max;
        Range { min: middle - 0.5 * length, max: middle + 0.5 * length }
    }
}

/// Scale of one side of a panel: a range, linear or logarithmic. [`Span::linear`] and [`Span::logarithmic`] make a drawable one of any range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// Range that is shown.
    pub range: Range,
    /// Whether the scale is logarithmic.
    pub log: bool,
    /// Whether the low end lies at the top or at the right, as for rows of images.
    pub down: bool,
}

impl Span {
    /// A linear scale; an empty range becomes a short one, one that is not finite 0 to 1.
    pub fn linear(range: Range) -> Self {
        let is_sound = range.length().is_finite() && range.length() >= 0.0;
        let range = if is_sound { range } else { Range { min: 0.0, max: 1.0 } };
        // Between neighbouring numbers of the machine no position can be resolved.
        let is_long = range.length() > 1e-13 * range.min.abs().max(range.max.abs());
        let range = if is_long { range } else { range.around_middle(0.0).widened(0.05) };
        Self { range, log: false, down: false }
    }

    /// A logarithmic scale, widened to whole decades where it spans less than one; 0.1 to 10 where the range does not lie above 0.
    pub fn logarithmic(Range { min, max }: Range) -> Self {
        let is_sound = min > 0.0 && max >= min && max.is_finite();
        let (mut min, mut max) = if is_sound { (min.max(1e-290), max.clamp(1e-290, 1e290)) } else { (0.1, 10.0) };
        if max < 10.0 * min {
            (min, max) = (10_f64.powf(min.log10().floor()), 10_f64.powf(max.log10().ceil()));
            max = max.max(10.0 * min);
        }
        Self { range: Range { min, max }, log: true, down: false }
    }

    /// Relative position of a value: 0 at the left or lower end, 1 at the other; NaN where it has none.
    pub fn part(&self, value: f64) -> f64 {
        let Range { min, max } = self.range;
        let part = match self.log {
            true if value <= 0.0 => f64::NAN,
            true => (value.ln() - min.ln()) / (max.ln() - min.ln()),
            false => (value - min) / (max - min),
        };
        if self.down { 1.0 - part } else { part }
    }
}

impl From<Range> for Span {
    fn from(range: Range) -> Self {
        Self::linear(range)
    }
}

/// A frame with two axes.
#[derive(Debug, Clone, Copy)]
pub struct Panel {
    /// Rectangle of the frame in the figure [px].
    pub rect: Rect,
    /// Scale to the right.
    pub x: Span,
    /// Scale upwards.
    pub y: Span,
}

/// Labels at the axes of a panel.
#[derive(Debug, Clone, Copy)]
pub struct Labels<'a> {
    /// Label of the axis to the right; `None`: neither a label nor numbers, for example above another panel.
    pub x: Option<&'a str>,
    /// Label of the axis upwards.
    pub y: &'a str,
    /// Distance of the ticks on either axis; `None`: as the space allows.
    pub steps: [Option<f64>; 2],
    /// Names of rows in place of numbers upwards: the first at 0.5, the next at 1.5.
    pub rows: &'a [String],
}

impl<'a> Labels<'a> {
    /// Labels with ticks as the space allows.
    pub fn new(x: Option<&'a str>, y: &'a str) -> Self {
        Self { x, y, steps: [None; 2], rows: &[] }
    }
}

/// Between the frame and the numbers beside it [px].
const GAP: f64 = 6.0;

impl Panel {
    /// A panel in `rect` with these ranges or scales.
    pub fn new(rect: Rect, x: impl Into<Span>, y: impl Into<Span>) -> Self {
        Self { rect, x: x.into(), y: y.into() }
    }

    /// Position of values in the figure [px]; NaN where they have none.
    pub fn place(&self, x: f64, y: f64) -> Point {
        [self.rect.left + self.x.part(x) * self.rect.width, self.rect.bottom() - self.y.part(y) * self.rect.height]
    }

    /// Ticks across: as many as have room side by side.
    fn ticks_across(&self, step: Option<f64>) -> Ticks {
        let mut n = (self.rect.width / 60.0).max(1.0);
        loop {
            let factor = (self.rect.width / 60.0).max(1.0) / n;
            let ticks = Ticks::of(&self.x, n, step.map(|it| if factor > 1.01 { it * factor.ceil() } else { it }));
            let between = ticks.values.windows(2).map(|it| (self.x.part(it[1]) - self.x.part(it[0])).abs());
            let room = between.fold(f64::INFINITY, f64::min) * self.rect.width;
            if n <= 1.0 || ticks.longest() as f64 * 0.58 * SMALL + 8.0 <= room {
                return ticks;
            }
            n *= 0.7;
        }
    }

    fn ticks_upwards(&self, step: Option<f64>) -> Ticks {
        // Steps that are given may still be too narrow for the height of a number.
        let is_wide = |it: &f64| it * self.rect.height / self.y.range.length() >= 0.9 * SMALL;
        Ticks::of(&self.y, (self.rect.height / 34.0).max(2.0), step.filter(is_wide))
    }

    /// Width of labels and numbers left of the frame [px].
    pub fn left_margin(&self, labels: &Labels<'_>) -> f64 {
        if labels.y.is_empty() { 4.0 + GAP + self.widest(labels) } else { self.label_out(labels) + TEXT }
    }

    /// From the frame to the base line of the label upwards [px].
    fn label_out(&self, labels: &Labels<'_>) -> f64 {
        (GAP + self.widest(labels) + 10.0).max(26.0)
    }

    /// The widest number or name upwards [px].
    fn widest(&self, labels: &Labels<'_>) -> f64 {
        match labels.rows {
            [] => self.ticks_upwards(labels.steps[1]).longest() as f64 * 0.58 * SMALL,
            rows => rows.iter().map(|it| text_width(it, SMALL)).fold(0.0, f64::max),
        }
    }

    /// Draws grid, ticks, numbers and labels; call it before the lines, and [`Self::frame`] after them.
    pub fn background(&self, svg: &mut Svg, labels: Labels<'_>) {
        let Rect { left, top, width, height } = self.rect;
        let (right, bottom) = (self.rect.right(), self.rect.bottom());
        let theme = *svg.theme();
        let (grid, numbers) = (Pen::new(theme.grid, 0.8), Font::new(SMALL).coloured(theme.muted));
        let mut lines = Vec::new();
        let across = self.ticks_across(labels.steps[0]);
        for (value, text) in across.values.iter().zip(&across.texts) {
            let x = left + self.x.part(*value) * width;
            lines.push(vec![[x, top], [x, bottom]]);
            if labels.x.is_some() {
                svg.text([x, bottom + 16.0], Anchor::Middle, numbers, text);
            }
        }
        let mut suffix = String::new();
        if labels.rows.is_empty() {
            let upwards = self.ticks_upwards(labels.steps[1]);
            for (value, text) in upwards.values.iter().zip(&upwards.texts) {
                let y = bottom - self.y.part(*value) * height;
                lines.push(vec![[left, y], [right, y]]);
                svg.text([left - GAP, y + 4.0], Anchor::End, numbers, text);
            }
            suffix = upwards.suffix;
        }
        for (row, name) in labels.rows.iter().enumerate() {
            let y = bottom - self.y.part(row as f64 + 0.5) * height;
            svg.text([left - GAP, y + 4.0], Anchor::End, numbers, name);
        }
        svg.lines(&lines, grid);
        if let Some(label) = labels.x {
            let label = fitted_label(&format!("{label}{}", across.suffix), TEXT, width + 60.0);
            svg.text([left + width / 2.0, bottom + 36.0], Anchor::Middle, TEXT, &label);
        }
        let out = self.label_out(&labels);
        let label = fitted_label(&format!("{}{suffix}", labels.y), TEXT, height + 50.0);
        svg.text_upwards([left - out, (top + bottom) / 2.0], TEXT, &label);
    }

    /// Draws the edge of the frame.
    pub fn frame(&self, svg: &mut Svg) {
        svg.rect(self.rect, "none", Some(Pen::new(svg.theme().edge, 1.0)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_far_values_do_not_count() {
        let mut values: Vec<f64> = (0..1000).map(|it| f64::from(it) * 0.001).collect();
        let clean = Range::of_most(&mut values.clone()).unwrap();
        assert_eq!((clean.min, clean.max), (0.0, 0.999));
        values.extend([500.0, -900.0, f64::NAN]);
        let range = Range::of_most(&mut values).unwrap();
        assert!(range.min > -0.3 && range.max < 1.3, "{range:?}");
        assert_eq!((Range::of_most(&mut []), Range::of_most(&mut [f64::NAN])), (None, None));
    }

    #[test]
    fn places_are_numbers_for_every_range() {
        let rect = Rect { left: 10.0, top: 20.0, width: 100.0, height: 50.0 };
        for (min, max) in
            [(0.0, 0.0), (-1e300, 1e300), (5e-324, 5e-324), (1e17, 1e17 + 16.0), (f64::NAN, 1.0), (2.0, 1.0)]
        {
            let range = Range { min, max };
            for span in [Span::linear(range), Span::logarithmic(range), Span { down: true, ..Span::linear(range) }] {
                let panel = Panel::new(rect, span, span);
                let middle = if span.log {
                    (0.5 * (span.range.min.ln() + span.range.max.ln())).exp()
                } else {
                    span.range.around_middle(0.0).min
                };
                let [x, y] = panel.place(middle, middle);
                assert!((x - 60.0).abs() < 0.1 && (y - 45.0).abs() < 0.1, "{min} {max} {span:?}: {x} {y}");
            }
        }
    }

    #[test]
    fn a_span_that_runs_down_has_its_low_end_at_the_top_and_logarithms_have_no_place_for_zero() {
        let rect = Rect { left: 0.0, top: 0.0, width: 100.0, height: 50.0 };
        let down = Span { down: true, ..Span::linear(Range { min: 0.0, max: 10.0 }) };
        let panel = Panel::new(rect, Span::logarithmic(Range { min: 1.0, max: 100.0 }), down);
        assert_eq!(panel.place(10.0, 0.0), [50.0, 0.0]);
        assert!(panel.place(0.0, 0.0)[0].is_nan() && panel.place(-1.0, 10.0)[0].is_nan());
    }

    #[test]
    fn numbers_across_do_not_touch_even_where_they_are_long_and_the_panel_is_narrow() {
        for width in [30.0, 90.0, 300.0, 1000.0] {
            for (min, max) in [(0.0, 1.0), (-123_456.0, 123_456.0), (0.0001, 0.00013), (1.7e9, 1.7e9 + 60.0)] {
                let rect = Rect { left: 0.0, top: 0.0, width, height: 50.0 };
                let panel = Panel::new(rect, Range { min, max }, Range { min, max });
                let ticks = panel.ticks_across(None);
                let places: Vec<f64> = ticks.values.iter().map(|it| panel.place(*it, 0.0)[0]).collect();
                for (index, pair) in places.windows(2).enumerate() {
                    let room = [index, index + 1].map(|it| text_width(&ticks.texts[it], SMALL) / 2.0);
                    assert!(width < 60.0 || pair[1] - pair[0] > room[0] + room[1], "{width} {min} {max}: {ticks:?}");
                }
            }
        }
    }
}
