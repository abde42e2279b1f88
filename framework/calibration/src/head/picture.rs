//! Errors of three models as points and as histograms, side by side: as in Figures 51 and 52 of [Davis 2002].

use std::fmt::Write as _;

use foveate_estimation::statistics;

use super::compare::{Comparison, ModelFit};
use crate::report::page::escaped;
use crate::report::svg::{Axis, Plot};

/// Of one plot and of the words above it [px of the picture].
const SIDE: [f64; 2] = [320.0, 290.0];
const HISTOGRAM: [f64; 2] = [320.0, 210.0];
const WORDS: f64 = 64.0;
const BARS: usize = 30;
/// The part of the right observations that every plot shows at least.
const SHOWN: f64 = 0.98;

const STYLE: &str = "svg text { font: 11px system-ui, sans-serif; fill: #62666e; } text.m { text-anchor: middle; } text.e { text-anchor: end; } \
                     text.label { fill: #1d1f23; } text.h { font-size: 14px; font-weight: 600; fill: #1d1f23; } path { fill: none; } \
                     .grid { stroke: #dcdcd6; } .frame { stroke: #8b8f97; } .cross { stroke: #8b8f97; stroke-dasharray: 3 3; } \
                     .dots { stroke: #1f66c7; stroke-width: 3; stroke-linecap: round; } .bars { fill: #1f66c7; }";

/// The picture as SVG. `title` is told above it; the same input gives the same bytes.
pub fn picture(comparison: &Comparison, title: &str) -> String {
    let models = comparison.models();
    let fits = models.iter().filter_map(|it| it.1);
    let right = &comparison.calibration.right;
    let reach = fits.clone().filter_map(|it| part_of(it, right, SHOWN)).fold(0.0, f64::max).max(1e-6);
    let most = fits.flat_map(|it| counts(it, reach)).max().unwrap_or(0).max(1);
    let [width, height] = [3.0 * SIDE[0], WORDS + SIDE[1] + HISTOGRAM[1]];
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {width} {height}\" width=\"{width}\" height=\"{height}\">\n\
         <title>{0}</title>\n<style>{STYLE}</style>\n<rect width=\"100%\" height=\"100%\" fill=\"#ffffff\"/>\n\
         <text class=\"h\" x=\"12\" y=\"20\">{0}</text>\n",
        escaped(title)
    );
    for (column, (name, fit)) in models.into_iter().enumerate() {
        let left = column as f64 * SIDE[0];
        let [first, second] = words(name, fit, reach);
        // Writing to a String cannot fail.
        let _ = writeln!(svg, "<text class=\"label\" x=\"{}\" y=\"40\">{}</text>", left + 46.0, escaped(&first));
        let _ = writeln!(svg, "<text x=\"{}\" y=\"55\">{}</text>", left + 46.0, escaped(&second));
        let Some(fit) = fit else { continue };
        let (scatter, histogram) = (scatter(fit, reach, name), histogram(fit, reach, most, name));
        let _ = writeln!(svg, "<g transform=\"translate({left} {WORDS})\">{scatter}</g>");
        let _ = writeln!(svg, "<g transform=\"translate({left} {})\">{histogram}</g>", WORDS + SIDE[1]);
    }
    svg + "</svg>\n"
}

fn words(name: &str, fit: Option<&ModelFit>, reach: f64) -> [String; 2] {
    let Some(fit) = fit else { return [name.to_owned(), "too little was seen".to_owned()] };
    let outside = fit.errors.iter().filter(|it| it.is_none_or(|it| it.amax() > reach)).count();
    let left_out = if outside > 0 { format!(", {outside} outside the frame") } else { String::new() };
    [format!("{name}: median {:.2} px", fit.median_px), format!("{} observations{left_out}", fit.errors.len())]
}

fn scatter(fit: &ModelFit, reach: f64, name: &str) -> String {
    let axis = |label: &str| Axis::linear(-reach, reach, label);
    let mut plot =
        Plot::new(SIDE, axis("error along the row [px]"), axis("error along the column [px]"), name).equal().down();
    plot.line("cross", [(-reach, 0.0), (reach, 0.0)].into_iter());
    plot.line("cross", [(0.0, -reach), (0.0, reach)].into_iter());
    plot.dots("dots", fit.errors.iter().flatten().map(|it| (it.x, it.y)));
    plot.finish()
}

fn histogram(fit: &ModelFit, reach: f64, most: usize, name: &str) -> String {
    let top = 1.05 * most as f64;
    let mut plot =
        Plot::new(HISTOGRAM, Axis::linear(0.0, reach, "error [px]"), Axis::linear(0.0, top, "observations"), name);
    let width = reach / BARS as f64;
    let bars = counts(fit, reach).into_iter().enumerate();
    plot.bars("bars", bars.map(|(it, n)| (it as f64 * width, (it + 1) as f64 * width, n as f64)));
    if fit.median_px < reach {
        plot.line("cross", [(fit.median_px, 0.0), (fit.median_px, top)].into_iter());
    }
    plot.finish()
}

/// How many errors each bar stands for.
fn counts(fit: &ModelFit, reach: f64) -> Vec<usize> {
    let mut counts = vec![0; BARS];
    for length in fit.errors.iter().flatten().map(|it| it.norm()) {
        if let Some(count) = counts.get_mut((length / reach * BARS as f64) as usize) {
            *count += 1;
        }
    }
    counts
}

/// The length that `part` of the right errors keep within.
fn part_of(fit: &ModelFit, right: &[bool], part: f64) -> Option<f64> {
    let lengths: Vec<f64> =
        fit.errors.iter().zip(right).filter(|it| *it.1).filter_map(|it| Some((*it.0)?.norm())).collect();
    statistics::percentile(&lengths, 100.0 * part)
}
