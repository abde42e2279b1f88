//! Charts of measured series, and where they go.

use std::path::Path;

use foveate_export::plot::axes::{Labels, Panel, Range};
use foveate_export::plot::legend::{Key, LEGEND_WIDTH, Legend};
use foveate_export::plot::svg::{Anchor, Pen, Point, Rect, SMALL, Svg, TEXT};
use foveate_export::plot::thin::thin_paths;

/// How the points of a series are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Marks {
    Line,
    Dashed,
    Dots,
    /// A line from each point with an even number to the next one.
    Strokes,
}

/// What the axes mean.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scale {
    Linear,
    /// A unit to the right is as long as one upwards.
    Equal,
    /// Powers of ten, both ways.
    Logarithmic,
}

/// Points that belong together.
#[derive(Debug, Clone)]
pub struct Series {
    pub name: String,
    pub marks: Marks,
    pub colour: &'static str,
    /// In pieces, between which no line is drawn.
    pub pieces: Vec<Vec<Point>>,
}

impl Series {
    pub fn new(name: impl Into<String>, marks: Marks, colour: &'static str, points: Vec<Point>) -> Self {
        Self { name: name.into(), marks, colour, pieces: vec![points] }
    }
}

/// One frame with axes.
#[derive(Debug, Clone)]
pub struct Chart {
    pub title: String,
    pub x: &'static str,
    pub y: &'static str,
    pub scale: Scale,
    pub series: Vec<Series>,
}

const LEFT: f64 = 72.0;
const ABOVE: f64 = 30.0;
const BELOW: f64 = 50.0;
const HEAD: f64 = 36.0;
const GRID: Pen<'static> = Pen::new("#e4e4e4", 0.8);

/// All `charts` in so many columns, each of `size` [px] within its axes.
pub fn draw(title: &str, n_columns: usize, size: [f64; 2], charts: &[Chart]) -> String {
    let n_rows = charts.len().div_ceil(n_columns);
    let step = [LEFT + size[0] + 18.0, ABOVE + size[1] + BELOW];
    let names: Vec<&Series> = charts.iter().flat_map(|it| &it.series).filter(|it| !it.name.is_empty()).collect();
    let right = step[0] * n_columns as f64;
    let height = (HEAD + step[1] * n_rows as f64).max(HEAD + 20.0 * names.len().min(12) as f64 + 20.0);
    let mut svg = Svg::new(right + LEGEND_WIDTH + 40.0, height, title);
    for (index, chart) in charts.iter().enumerate() {
        let [left, top] =
            [(index % n_columns) as f64 * step[0] + LEFT, (index / n_columns) as f64 * step[1] + HEAD + ABOVE];
        draw_one(&mut svg, chart, Rect { left, top, width: size[0], height: size[1] });
    }
    let mut legend = Legend::at([right + 12.0, HEAD + ABOVE]);
    let mut listed: Vec<&str> = Vec::new();
    for series in names {
        if !listed.contains(&series.name.as_str()) {
            listed.push(&series.name);
            let key = match series.marks {
                Marks::Line | Marks::Strokes => Key::Line(Pen::new(series.colour, 2.0)),
                Marks::Dashed => Key::Line(Pen::new(series.colour, 2.0).dashed("4 3")),
                Marks::Dots => Key::Dot { fill: series.colour },
            };
            legend.entry(&mut svg, key, &series.name);
        }
    }
    svg.finish()
}

fn draw_one(svg: &mut Svg, chart: &Chart, rect: Rect) {
    let is_log = chart.scale == Scale::Logarithmic;
    let on_axis = |point: &Point| if is_log { point.map(f64::log10) } else { *point };
    let points = || chart.series.iter().flat_map(|it| it.pieces.iter().flatten()).map(on_axis);
    let range =
        |axis: usize| Range::of(points().map(|it| it[axis])).unwrap_or(Range { min: 0.0, max: 1.0 }).widened(0.05);
    let (mut x, mut y) = (range(0), range(1));
    if chart.scale == Scale::Equal {
        let per_px = (x.length() / rect.width).max(y.length() / rect.height);
        let around = |range: Range, pixels: f64| {
            let middle = (range.min + range.max) / 2.0;
            Range { min: middle - per_px * pixels / 2.0, max: middle + per_px * pixels / 2.0 }
        };
        (x, y) = (around(x, rect.width), around(y, rect.height));
    }
    let panel = Panel { rect, x, y };
    svg.text([rect.left, rect.top - 8.0], Anchor::Start, TEXT, &chart.title);
    if is_log {
        log_background(svg, &panel, chart);
    } else {
        panel.background(svg, Labels::new(Some(chart.x), chart.y));
    }
    svg.within(rect, |svg| {
        for series in &chart.series {
            let mut pieces: Vec<Vec<Point>> = series
                .pieces
                .iter()
                .map(|piece| piece.iter().map(on_axis).map(|[x, y]| panel.place(x, y)).collect())
                .collect();
            match series.marks {
                Marks::Line | Marks::Dashed => {
                    thin_paths(&mut pieces, 20_000);
                    let pen = Pen::new(series.colour, 1.3);
                    svg.lines(&pieces, if series.marks == Marks::Dashed { pen.dashed("4 3") } else { pen });
                }
                Marks::Dots => pieces.iter().flatten().for_each(|it| {
                    svg.circle(*it, 1.6, series.colour, Pen::new(series.colour, 0.3));
                }),
                Marks::Strokes => {
                    let strokes: Vec<Vec<Point>> =
                        pieces.iter().flat_map(|it| it.chunks(2)).map(<[Point]>::to_vec).collect();
                    svg.lines(&strokes, Pen::new(series.colour, 0.7));
                }
            }
        }
    });
    panel.frame(svg);
}

/// Grid and numbers at the powers of ten, and between them where there are few.
fn log_background(svg: &mut Svg, panel: &Panel, chart: &Chart) {
    let rect = panel.rect;
    let ticks = |range: Range| -> Vec<f64> {
        let steps: &[f64] = if range.length() > 2.2 { &[1.0] } else { &[1.0, 2.0, 5.0] };
        let powers = range.min.floor() as i32..=range.max.ceil() as i32;
        let all = powers.flat_map(|power| steps.iter().map(move |it| it * 10_f64.powi(power)));
        all.filter(|it| (range.min..=range.max).contains(&it.log10())).collect()
    };
    for tick in ticks(panel.x) {
        let [x, _] = panel.place(tick.log10(), panel.y.min);
        svg.line([x, rect.top], [x, rect.bottom()], GRID);
        svg.text([x, rect.bottom() + 16.0], Anchor::Middle, SMALL, &tick.to_string());
    }
    for tick in ticks(panel.y) {
        let [_, y] = panel.place(panel.x.min, tick.log10());
        svg.line([rect.left, y], [rect.right(), y], GRID);
        svg.text([rect.left - 6.0, y + 4.0], Anchor::End, SMALL, &format!("{}", (tick * 1e6).round() / 1e6));
    }
    svg.text([rect.left + rect.width / 2.0, rect.bottom() + 36.0], Anchor::Middle, TEXT, chart.x);
    svg.text_upwards([rect.left - 52.0, rect.top + rect.height / 2.0], TEXT, chart.y);
}

/// Writes `svg` as `name`.svg into the folder asked for, if any.
pub fn save(out: Option<&Path>, name: &str, svg: &str) {
    let Some(folder) = out else { return };
    let path = folder.join(format!("{name}.svg"));
    match std::fs::create_dir_all(folder).and_then(|()| std::fs::write(&path, svg)) {
        Ok(()) => println!("plot: {}", path.display()),
        Err(error) => eprintln!("{}: the plot could not be saved ({error})", path.display()),
    }
}
