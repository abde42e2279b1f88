//! Charts: series of points in frames with axes, in a grid, with a legend.
//!
//! The caller describes the data ([`Series`], [`Axis`], [`Chart`], [`Figure`]); margins, ticks, colours of axes, thinning and the legend follow.

use crate::axes::{Labels, Panel, Range, Span};
use crate::colours::Theme;
use crate::legend::{Key, LINE_HEIGHT, Legend};
use crate::svg::{Anchor, Font, Pen, Point, Rect, SMALL, Svg, TEXT};
use crate::text::{fitted, text_width};
use crate::thin::{CHART_POINTS, evenly, thin_courses, thin_dots, thin_paths};
use crate::ticks::round_step;

/// How the points of a series are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Marks {
    /// A line through the points of each piece.
    Line,
    /// Dots of this radius [px].
    Dots(f64),
    /// A line from each point with an even index to the next one.
    Strokes,
    /// Each piece is the outline of an area, with this opacity.
    Areas(f64),
}

/// A series of points, drawn in one way and named in the legend.
#[derive(Debug, Clone)]
pub struct Series<'a> {
    /// Name in the legend; empty: none.
    pub name: String,
    /// How the points are drawn.
    pub marks: Marks,
    /// Colour and line style.
    pub pen: Pen<'a>,
    /// Points in the units of the axes, in pieces between which no line is drawn.
    pub pieces: Vec<Vec<Point>>,
}

impl<'a> Series<'a> {
    /// A series in one piece.
    pub fn new(name: impl Into<String>, marks: Marks, pen: Pen<'a>, points: Vec<Point>) -> Self {
        Self { name: name.into(), marks, pen, pieces: vec![points] }
    }

    /// A series drawn as a line.
    pub fn line(name: impl Into<String>, colour: &'a str, points: Vec<Point>) -> Self {
        Self::new(name, Marks::Line, Pen::new(colour, 1.4), points)
    }

    /// A series drawn as dots.
    pub fn dots(name: impl Into<String>, colour: &'a str, points: Vec<Point>) -> Self {
        Self::new(name, Marks::Dots(1.5), Pen::new(colour, 1.0), points)
    }

    /// A series drawn as bars from 0 upwards: each [from x, to x, height].
    pub fn bars(name: impl Into<String>, colour: &'a str, bars: impl IntoIterator<Item = [f64; 3]>) -> Self {
        let outline = |[from, to, value]: [f64; 3]| {
            // A narrow gap between neighbours.
            let (from, to) = (from + 0.04 * (to - from), to - 0.04 * (to - from));
            vec![[from, 0.0], [from, value], [to, value], [to, 0.0]]
        };
        let pieces = bars.into_iter().filter(|it| it[2] > 0.0).map(outline).collect();
        Self { name: name.into(), marks: Marks::Areas(0.75), pen: Pen::new(colour, 1.0), pieces }
    }

    /// The same series, dashed.
    pub fn dashed(self) -> Self {
        Self { pen: self.pen.dashed("5 3.5"), ..self }
    }

    fn key(&self) -> Key<'a> {
        match self.marks {
            Marks::Line | Marks::Strokes => Key::Line(Pen { width: self.pen.width.max(1.8), ..self.pen }),
            Marks::Dots(_) => Key::Dot { fill: self.pen.colour, edge: self.pen.colour },
            Marks::Areas(opacity) => Key::Swatch(self.pen.colour, opacity),
        }
    }
}

/// One axis of a chart.
#[derive(Debug, Clone, Default)]
pub struct Axis {
    label: String,
    range: Option<Range>,
    log: bool,
    down: bool,
    hidden: bool,
    zero: bool,
    whole: bool,
    rows: Vec<String>,
}

impl Axis {
    /// An axis with this label, which ends with the unit in brackets; it shows all data.
    pub fn new(label: impl Into<String>) -> Self {
        Self { label: label.into(), ..Self::default() }
    }

    /// A y axis of named rows in place of numbers: the first at the top, row number `i` at [`Self::row`].
    pub fn of_rows(names: impl IntoIterator<Item = String>) -> Self {
        let rows: Vec<String> = names.into_iter().map(|it| fitted(&it, SMALL, 170.0)).collect();
        let range = Some(Range { min: 0.0, max: rows.len().max(1) as f64 });
        Self { range, rows, down: true, ..Self::default() }
    }

    /// Position of the middle of a row.
    pub fn row(index: usize) -> f64 {
        index as f64 + 0.5
    }

    /// The axis with this range, whatever the data are.
    pub fn over(self, min: f64, max: f64) -> Self {
        Self { range: Some(Range { min, max }), ..self }
    }

    /// The axis with a logarithmic scale; values that are not positive are not drawn.
    pub fn log(self) -> Self {
        Self { log: true, ..self }
    }

    /// The axis with its low end at the top, as in images.
    pub fn down(self) -> Self {
        Self { down: true, ..self }
    }

    /// The axis with a range that includes 0.
    pub fn from_zero(self) -> Self {
        Self { zero: true, ..self }
    }

    /// The axis with whole numbers, for counts.
    pub fn whole(self) -> Self {
        Self { whole: true, ..self }
    }

    /// The axis without label and numbers, above another chart with the same axis.
    pub fn hidden(self) -> Self {
        Self { hidden: true, ..self }
    }

    fn span(&self, values: impl Iterator<Item = f64>) -> Span {
        let span = match (self.range, self.log) {
            (Some(range), false) => Span::linear(range),
            (Some(range), true) => Span::logarithmic(range),
            (None, false) => {
                let zero = self.zero.then_some(0.0);
                let of = Range::of(values.chain(zero)).filter(|it| it.length() > 0.0 || !self.zero);
                Span::linear(of.map_or(Range { min: 0.0, max: 1.0 }, |it| it.widened(0.05)))
            }
            (None, true) => {
                let of = Range::of(values.filter(|it| *it > 0.0)).unwrap_or(Range { min: 0.0, max: 0.0 });
                let by = (of.max / of.min).powf(0.05).clamp(1.0, 1e9);
                Span::logarithmic(Range { min: of.min / by, max: of.max * by })
            }
        };
        Span { down: self.down, ..span }
    }
}

/// A frame with two axes and its series.
#[derive(Debug, Clone)]
pub struct Chart<'a> {
    /// Title above the frame; empty: none.
    pub title: String,
    /// Size of the frame [px].
    pub size: [f64; 2],
    /// Axis to the right.
    pub x: Axis,
    /// Axis upwards.
    pub y: Axis,
    /// Whether both axes have the same scale; their ranges are then extended as needed.
    pub equal: bool,
    /// Series, from the back to the front.
    pub series: Vec<Series<'a>>,
    /// Text where no series has a point.
    pub if_empty: String,
}

impl<'a> Chart<'a> {
    /// A chart without series.
    pub fn new(title: impl Into<String>, size: [f64; 2], x: Axis, y: Axis) -> Self {
        let (series, if_empty) = (Vec::new(), "no data".to_owned());
        Self { title: title.into(), size, x, y, equal: false, series, if_empty }
    }

    /// The chart with one more series in front.
    pub fn with(mut self, series: Series<'a>) -> Self {
        self.series.push(series);
        self
    }

    /// The chart with the same scale on both axes.
    pub fn equal(self) -> Self {
        Self { equal: true, ..self }
    }

    /// The chart with this text where no series has a point.
    pub fn if_empty(self, text: impl Into<String>) -> Self {
        Self { if_empty: text.into(), ..self }
    }

    /// The chart as an element of a page: without title and legend, in the page's own colours and font.
    pub fn element(&self, theme: Theme, class: &str, name: &str) -> String {
        let panel = self.panel([0.0; 2]);
        let [left, below] = [self.left(&panel), self.below()];
        let [width, height] = self.size;
        let mut svg = Svg::bare(left + width + 16.0, 8.0 + height + below, name, theme);
        self.draw(&mut svg, [left, 8.0]);
        svg.element(class)
    }

    fn panel(&self, [left, top]: Point) -> Panel {
        let rect = Rect { left, top, width: self.size[0].max(1.0), height: self.size[1].max(1.0) };
        let values = |axis: usize| self.series.iter().flat_map(|it| it.pieces.iter().flatten()).map(move |it| it[axis]);
        let mut panel = Panel::new(rect, self.x.span(values(0)), self.y.span(values(1)));
        if self.equal && !self.x.log && !self.y.log {
            let per_px = (panel.x.range.length() / rect.width).max(panel.y.range.length() / rect.height);
            panel.x.range = panel.x.range.around_middle(per_px * rect.width);
            panel.y.range = panel.y.range.around_middle(per_px * rect.height);
        }
        panel
    }

    fn labels(&self) -> Labels<'_> {
        let x = (!self.x.hidden).then_some(self.x.label.as_str());
        if !self.x.whole && !self.y.whole {
            return Labels { rows: &self.y.rows, ..Labels::new(x, &self.y.label) };
        }
        let panel = self.panel([0.0; 2]);
        let step =
            |axis: &Axis, span: &Span, n: f64| axis.whole.then(|| round_step((span.range.length() / n).max(1.0)));
        let steps = [step(&self.x, &panel.x, self.size[0] / 60.0), step(&self.y, &panel.y, self.size[1] / 34.0)];
        Labels { steps, rows: &self.y.rows, ..Labels::new(x, &self.y.label) }
    }

    fn is_empty(&self) -> bool {
        let is_sound = |it: &Point| it.iter().all(|it| it.is_finite());
        !self.series.iter().flat_map(|it| it.pieces.iter().flatten()).any(is_sound)
    }

    /// Left of the frame [px].
    fn left(&self, panel: &Panel) -> f64 {
        panel.left_margin(&self.labels()).max(30.0)
    }

    /// Below the frame [px].
    fn below(&self) -> f64 {
        match (self.x.hidden, self.x.label.is_empty()) {
            (true, _) => 12.0,
            (false, true) => 24.0,
            (false, false) => 44.0,
        }
    }

    fn draw(&self, svg: &mut Svg, at: Point) {
        let panel = self.panel(at);
        let rect = panel.rect;
        let title = fitted(&self.title, TEXT, rect.width);
        svg.text([rect.left, rect.top - 8.0], Anchor::Start, Font::new(TEXT).bold(), &title);
        if self.is_empty() {
            // Numbers along the axes of nothing would say something.
            let muted = svg.theme().muted;
            let text = fitted(&self.if_empty, SMALL, rect.width - 8.0);
            let [x, y] = rect.middle();
            svg.text([x, y + 4.0], Anchor::Middle, Font::new(SMALL).coloured(muted), &text);
            let labels = Labels { x: None, rows: &[], ..self.labels() };
            svg.text_upwards([rect.left - 24.0, rect.middle()[1]], TEXT, labels.y);
        } else {
            panel.background(svg, self.labels());
            let n_points = |it: &Series<'_>| it.pieces.iter().map(Vec::len).sum::<usize>();
            let n_all = self.series.iter().map(n_points).sum::<usize>().max(1);
            svg.within(rect, |svg| {
                for series in &self.series {
                    let share = n_points(series) as f64 / n_all as f64;
                    series.draw(svg, &panel, (CHART_POINTS as f64 * share) as usize + 1000);
                }
            });
        }
        panel.frame(svg);
    }
}

impl Series<'_> {
    fn draw(&self, svg: &mut Svg, panel: &Panel, limit: usize) {
        let placed = |piece: &[Point]| piece.iter().map(|&[x, y]| panel.place(x, y)).collect::<Vec<Point>>();
        match self.marks {
            Marks::Line => {
                // Thinning compares places: only those that are some.
                let is_gap = |it: &Point| !it.iter().all(|it| it.is_finite());
                let whole = |piece: &Vec<Point>| {
                    let placed = placed(piece);
                    placed.split(is_gap).filter(|it| it.len() > 1).map(<[Point]>::to_vec).collect::<Vec<_>>()
                };
                let mut lines: Vec<Vec<Point>> = self.pieces.iter().flat_map(whole).collect();
                let is_course = lines.iter().all(|line| line.windows(2).all(|it| it[0][0] <= it[1][0]));
                if is_course {
                    thin_courses(&mut lines, limit)
                } else {
                    thin_paths(&mut lines, limit)
                };
                svg.lines(&lines, self.pen);
            }
            Marks::Dots(radius) => {
                let all = self.pieces.iter().flatten().map(|&[x, y]| panel.place(x, y));
                let told_apart = thin_dots(all, panel.rect);
                let shown = evenly(&told_apart, limit).copied();
                svg.dots(shown, radius, self.pen.colour, self.pen.opacity);
            }
            Marks::Strokes => {
                let strokes: Vec<Vec<Point>> =
                    self.pieces.iter().flat_map(|it| it.chunks_exact(2)).take(limit).map(placed).collect();
                svg.lines(&strokes, self.pen);
            }
            Marks::Areas(opacity) => {
                let areas: Vec<Vec<Point>> = self.pieces.iter().map(|it| placed(it)).collect();
                svg.areas(&areas, self.pen.colour, opacity, None);
            }
        }
    }
}

/// Charts in a grid, row by row, under one title, with one legend.
#[derive(Debug, Clone)]
pub struct Figure<'a> {
    /// Title of the figure.
    pub title: String,
    /// Number of charts side by side.
    pub n_columns: usize,
    /// The charts.
    pub charts: Vec<Chart<'a>>,
}

/// Height of the title [px].
const HEAD: f64 = 40.0;
/// Between columns, and from the last one to the legend [px].
const BETWEEN: f64 = 20.0;
/// The widest legend [px].
const LEGEND_LIMIT: f64 = 260.0;

impl Figure<'_> {
    /// Charts whose numbers along x stand below another chart of their column show the same part of it as that one.
    fn with_shared_axes(&self) -> Self {
        let mut shared = self.clone();
        let (n, n_columns) = (shared.charts.len(), self.n_columns.max(1));
        for below in (0..n).filter(|it| !self.charts[*it].x.hidden) {
            let above = (0..=below).rev().step_by(n_columns);
            let group: Vec<usize> =
                above.enumerate().take_while(|(i, it)| *i == 0 || self.charts[*it].x.hidden).map(|it| it.1).collect();
            let values = group.iter().flat_map(|it| &self.charts[*it].series).flat_map(|it| it.pieces.iter().flatten());
            let whole = Range::of(values.map(|it| it[0]).filter(|it| it.is_finite()));
            let is_open = group.iter().all(|it| self.charts[*it].x.range.is_none() && !self.charts[*it].x.log);
            let (Some(whole), true) = (whole, is_open && group.len() > 1) else { continue };
            let range = if whole.length() > 0.0 { whole.widened(0.05) } else { continue };
            group.into_iter().for_each(|it| shared.charts[it].x.range = Some(range));
        }
        shared
    }

    /// The figure as an SVG file.
    pub fn svg(&self) -> String {
        self.with_shared_axes().drawn()
    }

    fn drawn(&self) -> String {
        let n_columns = self.n_columns.max(1);
        let column = |index: usize| self.charts.iter().skip(index).step_by(n_columns);
        let mut lefts = Vec::new();
        let mut right = 6.0;
        for index in 0..n_columns.min(self.charts.len()) {
            right += column(index).map(|it| it.left(&it.panel([0.0; 2]))).fold(0.0, f64::max);
            lefts.push(right);
            right += column(index).map(|it| it.size[0]).fold(0.0, f64::max) + BETWEEN;
        }
        let rows: Vec<&[Chart<'_>]> = self.charts.chunks(n_columns).collect();
        let mut tops = Vec::new();
        let mut bottom = HEAD;
        for row in &rows {
            bottom += if row.iter().all(|it| it.title.is_empty()) { 8.0 } else { 28.0 };
            tops.push(bottom);
            bottom += row.iter().map(|it| it.size[1] + it.below()).fold(0.0, f64::max);
        }
        // Each name once, beside the first row that has it.
        let mut entries: Vec<(usize, &str, Key<'_>)> = Vec::new();
        for (row, charts) in rows.iter().enumerate() {
            for series in charts.iter().filter(|it| !it.is_empty()).flat_map(|it| &it.series) {
                let key = series.key();
                if !series.name.is_empty() && !entries.iter().any(|it| it.1 == series.name && it.2 == key) {
                    entries.push((row, &series.name, key));
                }
            }
        }
        let beside = Legend::width_of(entries.iter().map(|it| it.1)).min(LEGEND_LIMIT);
        let beside = if entries.is_empty() { 0.0 } else { beside };
        // A legend of many entries may be longer than the rows.
        let longest = entries.iter().fold(HEAD, |next, it| tops[it.0].max(next) + LINE_HEIGHT);
        let size = [right + beside + 10.0, if beside > 0.0 { bottom.max(longest) } else { bottom }];
        let width = size[0].max(text_width(&self.title, crate::svg::TITLE).min(700.0) + 40.0);
        let mut svg = Svg::new(width, size[1] + 6.0, &self.title);
        for (row, charts) in rows.iter().enumerate() {
            charts.iter().zip(&lefts).for_each(|(chart, left)| chart.draw(&mut svg, [*left, tops[row]]));
        }
        let mut legend = Legend::at([right, HEAD]).wide(beside);
        for (row, name, key) in entries {
            legend.down_to(tops[row]);
            legend.entry(&mut svg, key, name);
        }
        svg.finish()
    }
}

/// A figure without data, which states the reason.
pub fn nothing(title: &str, why: &str) -> String {
    let mut svg = Svg::new(text_width(title, crate::svg::TITLE).clamp(640.0, 1000.0) + 40.0, 100.0, title);
    svg.text([16.0, 66.0], Anchor::Start, TEXT, &format!("nothing to show: {why}"));
    svg.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn charts_above_one_another_with_one_axis_show_the_same_part_of_it() {
        let chart = |from: f64, to: f64, x: Axis| {
            let line = Series::line("line", "#000", vec![[from, 1.0], [to, 2.0]]);
            Chart::new("", [300.0, 80.0], x, Axis::new("y")).with(line)
        };
        let time = || Axis::new("time [s]");
        let charts = vec![chart(13.0, 22.0, time().hidden()), chart(16.0, 21.0, time()), chart(0.0, 1.0, time())];
        let shared = Figure { title: String::new(), n_columns: 1, charts }.with_shared_axes();
        let ranges: Vec<Option<Range>> = shared.charts.iter().map(|it| it.x.range).collect();
        assert_eq!((ranges[0], ranges[2]), (ranges[1], None));
        assert!(ranges[0].is_some_and(|it| it.min <= 13.0 && it.max >= 22.0), "{ranges:?}");
        // Charts side by side share none.
        let charts = vec![chart(13.0, 22.0, time().hidden()), chart(16.0, 21.0, time())];
        let apart = Figure { title: String::new(), n_columns: 2, charts }.with_shared_axes();
        assert!(apart.charts.iter().all(|it| it.x.range.is_none()));
    }
}
