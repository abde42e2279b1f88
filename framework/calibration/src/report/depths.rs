//! Report section: coverage of depth by the light.

use foveate_plot::svg::Pen;
use foveate_plot::{Axis, Chart, Marks, Series};

use super::ReportInput;
use super::figures::{Figures, quantile};
use super::page::{PLOT, Page, SERIES, THEME};

pub(super) fn section(page: &mut Page, report: &ReportInput<'_>, figures: &Figures) {
    let known: Vec<(&str, &[f64])> = report
        .solved
        .cameras
        .iter()
        .zip(&figures.cameras)
        .filter(|it| !it.1.depths.is_empty())
        .map(|(camera, of)| (camera.name.as_str(), of.depths.as_slice()))
        .collect();
    if known.is_empty() {
        return;
    }
    page.section(
        "depth",
        "Coverage of depth",
        "How far in front of each camera the light was: lines reach from the nearest to the farthest, boxes hold the middle half, the mark is \
         the median. A focal length needs depth: where the farthest is less than twice the nearest, it is poorly separated from distance.",
    );
    let far = known.iter().map(|it| it.1[it.1.len() - 1]).fold(0.0, f64::max);
    let near = known.iter().map(|it| it.1[0]).fold(0.0, f64::min);
    let rows = Axis::of_rows(known.iter().map(|it| it.0.to_owned()));
    let x = Axis::new(format!("depth [{}]", report.unit)).over(near, 1.03 * far);
    let mut series = [
        (Marks::Strokes, Pen::new(SERIES[0], 1.0)),
        (Marks::Areas(0.45), Pen::new(SERIES[0], 1.0)),
        (Marks::Strokes, Pen::new(THEME.ink, 2.0)),
    ]
    .map(|(marks, pen)| Series::new("", marks, pen, Vec::new()));
    for (index, &(_, depths)) in known.iter().enumerate() {
        let row = Axis::row(index);
        let [low, middle, high] = [0.25, 0.5, 0.75].map(|part| quantile(depths, part));
        let (above, below) = (row - 0.28, row + 0.28);
        series[0].pieces.push(vec![[depths[0], row], [depths[depths.len() - 1], row]]);
        series[1].pieces.push(vec![[low, above], [high, above], [high, below], [low, below]]);
        series[2].pieces.push(vec![[middle, above], [middle, below]]);
    }
    let mut chart = Chart::new("", [580.0, 18.0 * known.len() as f64], x, rows);
    chart.series.extend(series);
    page.raw(&chart.element(THEME, PLOT, "Depths by camera"));
}
