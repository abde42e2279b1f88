//! Errors of three models as points and as histograms, side by side: as in Figures 51 and 52 of [Davis 2002].

use foveate_estimation::statistics;
use foveate_plot::colours::REFERENCE;
use foveate_plot::svg::Pen;
use foveate_plot::{Axis, COLOURS, Chart, Figure, Marks, Series};

use super::compare::{Comparison, ModelFit};

/// Of one frame [px].
const SCATTER: [f64; 2] = [240.0, 240.0];
const HISTOGRAM: [f64; 2] = [240.0, 170.0];
const BARS: usize = 30;
/// The part of the right observations that every plot shows at least.
const SHOWN: f64 = 0.98;

/// The comparison as SVG under the heading `title`; the same input gives the same bytes.
pub fn picture(comparison: &Comparison, title: &str) -> String {
    let models = comparison.models();
    let fits = models.iter().filter_map(|it| it.1);
    let right = &comparison.calibration.right;
    let reach = fits.clone().filter_map(|it| part_of(it, right, SHOWN)).fold(0.0, f64::max).max(1e-6);
    let most = fits.flat_map(|it| counts(it, reach)).max().unwrap_or(0).max(1);
    let scatters = models.iter().map(|(name, fit)| scatter(*fit, reach, name));
    let histograms = models.iter().map(|(_, fit)| histogram(*fit, reach, most));
    Figure { title: title.to_owned(), n_columns: models.len(), charts: scatters.chain(histograms).collect() }.svg()
}

fn scatter<'a>(fit: Option<&ModelFit>, reach: f64, name: &str) -> Chart<'a> {
    let (x, y) = (Axis::new("error along the row [px]"), Axis::new("error along the column [px]"));
    let title = fit.map_or_else(|| name.to_owned(), |it| format!("{name}: median {:.2} px", it.median_px));
    let chart = Chart::new(title, SCATTER, x.over(-reach, reach), y.over(-reach, reach).down());
    let Some(fit) = fit else { return chart.if_empty("too little was seen") };
    let zero = vec![[-reach, 0.0], [reach, 0.0], [0.0, -reach], [0.0, reach]];
    let errors = fit.errors.iter().flatten().map(|it| [it.x, it.y]).collect();
    chart
        .with(Series::new("", Marks::Strokes, Pen::new(REFERENCE, 1.0), zero).dashed())
        .with(Series::dots("", COLOURS[0], errors))
}

fn histogram<'a>(fit: Option<&ModelFit>, reach: f64, most: usize) -> Chart<'a> {
    let top = 1.05 * most as f64;
    let outside = fit.map_or(0, |it| it.errors.iter().filter(|it| it.is_none_or(|it| it.amax() > reach)).count());
    let left_out = if outside > 0 { format!(", {outside} outside") } else { String::new() };
    let title = fit.map_or_else(String::new, |it| format!("{} observations{left_out}", it.errors.len()));
    let (x, y) = (Axis::new("error [px]").over(0.0, reach), Axis::new("observations [–]").over(0.0, top));
    let chart = Chart::new(title, HISTOGRAM, x, y).if_empty("");
    let Some(fit) = fit else { return chart };
    let width = reach / BARS as f64;
    let bars = counts(fit, reach).into_iter().enumerate();
    let bars = bars.map(|(it, n)| [it as f64 * width, (it + 1) as f64 * width, n as f64]);
    let median = vec![[fit.median_px, 0.0], [fit.median_px, top]];
    chart.with(Series::bars("", COLOURS[0], bars)).with(Series::line("median", COLOURS[1], median).dashed())
}

/// Number of errors in each bar.
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
