//! Axes: what a range of values becomes on paper.

use super::svg::{Anchor, INK, Pen, Point, Rect, SMALL, Svg, TEXT};

const GRID: Pen<'static> = Pen::new("#e4e4e4", 0.8);

/// A range of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Its lower end.
    pub min: f64,
    /// Its upper end.
    pub max: f64,
}

impl Range {
    /// Of finite values; `None` without any.
    pub fn of(values: impl IntoIterator<Item = f64>) -> Option<Self> {
        let finite = values.into_iter().filter(|it| it.is_finite());
        finite.fold(None, |range: Option<Range>, value| {
            let (min, max) = range.map_or((value, value), |it| (it.min.min(value), it.max.max(value)));
            Some(Range { min, max })
        })
    }

    /// Of most of `values`: where a few of them lie far off, they do not count.
    pub fn of_most(values: &mut [f64]) -> Option<Self> {
        let whole = Self::of(values.iter().copied())?;
        values.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| values[((values.len() - 1) as f64 * share).round() as usize];
        let most = Range { min: at(0.005), max: at(0.995) };
        Some(if whole.length() <= 2.0 * most.length() { whole } else { most.widened(0.1) })
    }

    /// From end to end.
    pub fn length(&self) -> f64 {
        self.max - self.min
    }

    /// The least range that holds both.
    pub fn union(self, other: Option<Range>) -> Self {
        other.map_or(self, |it| Range { min: self.min.min(it.min), max: self.max.max(it.max) })
    }

    /// Longer by `share` of its length at either end; a point becomes a short range.
    pub fn widened(self, share: f64) -> Self {
        let by = if self.length() > 0.0 { self.length() * share } else { (self.min.abs() * share).max(1e-3) };
        Range { min: self.min - by, max: self.max + by }
    }

    /// Round numbers within, about `n` of them, and how many decimals they need.
    pub fn ticks(&self, n: f64) -> (Vec<f64>, usize) {
        self.ticks_by(round_step(self.length() / n.max(1.0)))
    }

    /// Multiples of `step` within, and how many decimals they need.
    fn ticks_by(&self, step: f64) -> (Vec<f64>, usize) {
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let (first, last) = ((self.min / step - 1e-6).ceil(), (self.max / step + 1e-6).floor());
        let count = (last - first).clamp(-1.0, 1000.0) as i64 + 1;
        ((0..count).map(|index| (first + index as f64) * step).collect(), decimals)
    }
}

/// The smallest of 1, 2, 5, 10, … that is at least `least`.
pub fn round_step(least: f64) -> f64 {
    if !(least > 0.0 && least.is_finite()) {
        return 1.0;
    }
    let power = 10_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0].map(|it| it * power).into_iter().find(|it| *it >= least * (1.0 - 1e-9)).unwrap_or(10.0 * power)
}

/// A frame with two axes.
#[derive(Debug, Clone, Copy)]
pub struct Panel {
    /// Where it lies in the figure [px].
    pub rect: Rect,
    /// To the right.
    pub x: Range,
    /// Upwards.
    pub y: Range,
}

/// What is written at the axes of a panel.
#[derive(Debug, Clone, Copy)]
pub struct Labels<'a> {
    /// `None`: neither a label nor numbers, as another panel below has them.
    pub x: Option<&'a str>,
    /// What the values upwards are.
    pub y: &'a str,
    /// Distance of the ticks across and upwards; `None`: what the space allows.
    pub steps: [Option<f64>; 2],
}

impl<'a> Labels<'a> {
    /// With ticks as the space allows.
    pub fn new(x: Option<&'a str>, y: &'a str) -> Self {
        Self { x, y, steps: [None; 2] }
    }
}

impl Panel {
    /// Where the values lie in the figure [px].
    pub fn place(&self, x: f64, y: f64) -> Point {
        [
            self.rect.left + (x - self.x.min) / self.x.length() * self.rect.width,
            self.rect.bottom() - (y - self.y.min) / self.y.length() * self.rect.height,
        ]
    }

    /// Grid, ticks, numbers, labels; draw it before the lines, and [`Self::frame`] after them.
    pub fn background(&self, svg: &mut Svg, labels: Labels<'_>) {
        let Rect { left, top, width, .. } = self.rect;
        let (right, bottom) = (self.rect.right(), self.rect.bottom());
        let ticks_of =
            |range: Range, n: f64, step: Option<f64>| step.map_or_else(|| range.ticks(n), |it| range.ticks_by(it));
        let (ticks, decimals) = ticks_of(self.x, width / 60.0, labels.steps[0]);
        for tick in ticks {
            let [x, _] = self.place(tick, 0.0);
            svg.line([x, top], [x, bottom], GRID);
            if labels.x.is_some() {
                svg.text([x, bottom + 16.0], Anchor::Middle, SMALL, &number(tick, decimals));
            }
        }
        let (ticks, decimals) = ticks_of(self.y, (self.rect.height / 34.0).max(2.0), labels.steps[1]);
        for tick in ticks {
            let [_, y] = self.place(0.0, tick);
            svg.line([left, y], [right, y], GRID);
            svg.text([left - 6.0, y + 4.0], Anchor::End, SMALL, &number(tick, decimals));
        }
        if let Some(label) = labels.x {
            svg.text([left + width / 2.0, bottom + 36.0], Anchor::Middle, TEXT, label);
        }
        svg.text_upwards([left - 48.0, (top + bottom) / 2.0], TEXT, labels.y);
    }

    /// The edge.
    pub fn frame(&self, svg: &mut Svg) {
        svg.rect(self.rect, "none", Some(Pen::new(INK, 1.0)));
    }
}

/// A typographic minus, and no `-0`.
fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    let is_zero = text.bytes().all(|it| matches!(it, b'-' | b'0' | b'.'));
    match text.strip_prefix('-') {
        Some(digits) if is_zero => digits.to_owned(),
        Some(digits) => format!("\u{2212}{digits}"),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_lie_within() {
        let ticks = |min: f64, max: f64, n: f64| Range { min, max }.ticks(n);
        assert_eq!(ticks(-1.75, 1.75, 4.0), (vec![-1.0, 0.0, 1.0], 0));
        let (fine, decimals) = ticks(0.0, 0.1, 5.0);
        assert_eq!((fine.len(), decimals), (6, 2));
        assert!(ticks(5.0, 5.0, 4.0).0.len() <= 1);
        assert_eq!(ticks(0.0, 60.0, 6.0).0, [0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0]);
    }

    #[test]
    fn few_far_values_do_not_count() {
        let mut values: Vec<f64> = (0..1000).map(|it| f64::from(it) * 0.001).collect();
        let clean = Range::of_most(&mut values.clone()).unwrap();
        assert_eq!((clean.min, clean.max), (0.0, 0.999));
        values.extend([500.0, -900.0, f64::NAN]);
        let range = Range::of_most(&mut values).unwrap();
        assert!(range.min > -0.3 && range.max < 1.3, "{range:?}");
        assert_eq!(Range::of_most(&mut []), None);
    }

    #[test]
    fn steps_are_one_two_five() {
        let steps = [0.9, 1.0, 1.1, 2.5, 6.0, 0.0, f64::NAN].map(round_step);
        assert_eq!(steps, [1.0, 1.0, 2.0, 5.0, 10.0, 1.0, 1.0]);
    }

    #[test]
    fn numbers_have_a_proper_minus() {
        assert_eq!([number(-0.5, 1), number(-0.01, 1), number(2.0, 0)], ["\u{2212}0.5", "0.0", "2"]);
    }
}
