//! How observations fit: for all cameras, and for each over its image.

use foveate_plot::svg::Pen;
use foveate_plot::text::{count, escaped, fixed, rounded};
use foveate_plot::thin::evenly;
use foveate_plot::ticks::{round_step, round_step_below};
use foveate_plot::{Axis, Chart, Marks, Series};
use nalgebra::{Point2, Vector2};

use super::ReportInput;
use super::figures::{Figures, OfCamera, quantile, rms};
use super::page::{PLOT, Page, SERIES, THEME};
use crate::solved::SolvedCamera;

/// Dots of all scatter plots together, and of each at most.
const DOTS: usize = 40_000;
const DOTS_OF_ONE: usize = 1_500;
/// Arrows across an image; their rows follow from its shape.
const ARROWS: usize = 12;
/// A cell of the map needs so many observations: the mean of fewer is noise.
const CELL: usize = 3;
/// More cameras than this are folded.
const UNFOLDED: usize = 8;
const BINS: usize = 30;

pub(super) fn section(page: &mut Page, report: &ReportInput<'_>, figures: &Figures) {
    page.section(
        "residuals",
        "Residuals",
        "Good residuals scatter around zero, alike in all directions and all over the image. A cloud off the middle means that the camera \
         moved or its clock is wrong; arrows that rotate or point outwards mean that the lens differs from its model.",
    );
    page.raw(&histogram_of_all(figures));
    let n = figures.cameras.iter().filter(|it| !it.seen.is_empty()).count();
    let dots = (DOTS / n.max(1)).clamp(100, DOTS_OF_ONE);
    if figures.cameras.iter().any(|it| it.seen.len() > dots) {
        page.note(&format!(
            "Scatter plots show at most {} observations of each camera, evenly chosen; histograms, arrows and numbers are of all.",
            count(dots)
        ));
    }
    // One scale for all, so that cameras compare at a glance.
    let limit = round_step(3.0 * quantile(&figures.used_px, 0.75).max(quantile(&figures.held_out_px, 0.75)).max(0.05));
    for (camera, of) in report.solved.cameras.iter().zip(&figures.cameras) {
        if of.used_px.is_empty() && of.held_out_px.is_empty() {
            continue;
        }
        let scatter = scatter(camera, of, limit, dots);
        let histogram = histogram(of, limit);
        let (map, factor) = map(camera, of);
        let words = format!(
            "median {} px, root mean square {} px, {} observations",
            fixed(quantile(&of.used_px, 0.5), 3),
            fixed(rms(&of.used_px), 3),
            count(of.used_px.len())
        );
        let open = if n <= UNFOLDED { " open" } else { "" };
        page.raw(&format!(
            "<details class=\"camera\"{open}><summary><b>{}</b> <span>{words}</span></summary><div class=\"row\"><figure>{scatter}\
             <figcaption>residuals</figcaption></figure><figure>{histogram}<figcaption>their lengths</figcaption></figure><figure>{map}\
             <figcaption>mean residuals over the image, {factor}</figcaption></figure></div></details>",
            escaped(&camera.name),
        ));
    }
}

/// Share of the values in each of [`BINS`] bins from 0 to `limit` [%]: from, to, how much.
fn shares(sorted: &[f64], limit: f64) -> Vec<[f64; 3]> {
    let width = limit / BINS as f64;
    let below = |edge: f64| sorted.partition_point(|it| *it < edge);
    let share = |bin: usize| {
        let (from, to) = (bin as f64 * width, (bin + 1) as f64 * width);
        [from, to, 100.0 * (below(to) - below(from)) as f64 / sorted.len().max(1) as f64]
    };
    (0..BINS).map(share).collect()
}

fn drawn_histogram(size: [f64; 2], lists: [&[f64]; 2], limit: f64) -> String {
    let [used, held_out] = lists.map(|it| shares(it, limit));
    let most = used.iter().chain(&held_out).map(|it| it[2]).fold(1.0, f64::max);
    let x = Axis::new("length of the residual [px]").over(0.0, limit);
    let y = Axis::new("observations [%]").over(0.0, 1.05 * most);
    let mut chart = Chart::new("", size, x, y).with(Series::bars("used", SERIES[0], used));
    if !lists[1].is_empty() {
        let steps = held_out.iter().flat_map(|&[from, to, share]| [[from, share], [to, share]]).collect();
        chart = chart.with(Series::new("held out", Marks::Line, Pen::new(SERIES[1], 1.8), steps));
    }
    chart.element(THEME, PLOT, "Histogram of residuals")
}

fn histogram_of_all(figures: &Figures) -> String {
    let lists = [figures.used_px.as_slice(), figures.held_out_px.as_slice()];
    let reach = lists.iter().map(|it| quantile(it, 0.99)).fold(f64::NAN, f64::max);
    let limit = round_step(reach);
    let plot = drawn_histogram([500.0, 200.0], lists, limit);
    let held_out = if lists[1].is_empty() { "" } else { "<span class=\"key s1\">held out</span>" };
    let beyond = |list: &[f64]| list.len() - list.partition_point(|it| *it < limit);
    format!(
        "<figure>{plot}<figcaption>all cameras: <span class=\"key s0\">used</span>{held_out} · {} beyond {} px</figcaption></figure>",
        count(beyond(lists[0]) + beyond(lists[1])),
        rounded(limit)
    )
}

fn histogram(of: &OfCamera, limit: f64) -> String {
    drawn_histogram([240.0, 178.0], [&of.used_px, &of.held_out_px], limit)
}

fn scatter(camera: &SolvedCamera, of: &OfCamera, limit: f64, dots: usize) -> String {
    let axis = |name: &str| Axis::new(name).over(-limit, limit);
    let residuals: Vec<Vector2<f64>> = of.seen.iter().filter_map(|it| it.1).collect();
    let dots = evenly(&residuals, dots).map(|it| [it.x, it.y]).collect();
    let zero = vec![[-limit, 0.0], [limit, 0.0], [0.0, -limit], [0.0, limit]];
    Chart::new("", [178.0, 178.0], axis("u [px]"), axis("v [px]").down())
        .with(Series::new("", Marks::Strokes, Pen::new(THEME.edge, 1.0).dashed("2 3"), zero))
        .with(Series::new("", Marks::Dots(1.2), Pen::new(SERIES[0], 1.0).faint(0.45), dots))
        .element(THEME, PLOT, &format!("Residuals of {}", camera.name))
}

/// Mean residuals in cells of the image as arrows; and by what factor they are drawn longer, in words.
fn map(camera: &SolvedCamera, of: &OfCamera) -> (String, String) {
    let [width, height] = camera.camera.image_size.map(|it| f64::from(it.max(1)));
    let rows = ((ARROWS as f64 * height / width).round() as usize).clamp(1, 2 * ARROWS);
    let mut cells = vec![(0_usize, Vector2::zeros(), Vector2::zeros()); ARROWS * rows];
    for (pixel, residual) in &of.seen {
        let Some(residual) = residual else { continue };
        let Some(cell) = cell_of(pixel, [width, height], [ARROWS, rows]) else { continue };
        let (n, place, sum) = &mut cells[cell];
        *n += 1;
        *place += pixel.coords;
        *sum += residual;
    }
    let means: Vec<(Vector2<f64>, Vector2<f64>)> =
        cells.iter().filter(|it| it.0 >= CELL).map(|(n, place, sum)| (place / *n as f64, sum / *n as f64)).collect();
    let mut lengths: Vec<f64> = means.iter().map(|it| it.1.norm()).collect();
    lengths.sort_by(f64::total_cmp);
    let typical = quantile(&lengths, 0.9);
    let factor = if typical > 0.0 { round_step_below(0.9 * width / ARROWS as f64 / typical) } else { 1.0 };
    let (mut arrows, mut feet) = (Vec::new(), Vec::new());
    for (place, mean) in means {
        let tip = place + mean * factor;
        feet.push([place.x, place.y]);
        arrows.extend([[place.x, place.y], [tip.x, tip.y]]);
    }
    // The frame is the image, in its shape.
    let scale = (264.0 / width).min(198.0 / height);
    let (x, y) = (Axis::new("u [px]").over(-0.5, width - 0.5), Axis::new("v [px]").over(-0.5, height - 0.5).down());
    let drawn = Chart::new("", [width * scale, height * scale], x, y)
        .with(Series::new("", Marks::Strokes, Pen::new(SERIES[0], 1.4), arrows))
        .with(Series::new("", Marks::Dots(1.3), Pen::new(THEME.ink, 1.0), feet))
        .element(THEME, PLOT, &format!("Mean residuals over the image of {}", camera.name));
    (drawn, format!("drawn {} times as long, from the dot", rounded(factor)))
}

/// Number of the cell of a pixel, row by row; `None` off the image.
pub(super) fn cell_of(pixel: &Point2<f64>, size: [f64; 2], cells: [usize; 2]) -> Option<usize> {
    let part = [0, 1].map(|it| (pixel[it] + 0.5) / size[it]);
    let inside = part.iter().all(|it| (0.0..1.0).contains(it));
    let [column, row] = [0, 1].map(|it| ((part[it] * cells[it] as f64) as usize).min(cells[it] - 1));
    inside.then_some(row * cells[0] + column)
}
