//! How near and how far each camera saw the light.

use super::ReportInput;
use super::figures::{Figures, quantile};
use super::page::Page;
use super::svg::{Axis, Plot, short};

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
        "How far in front of each camera the light was: lines from the nearest to the farthest, boxes hold the middle half, the mark is \
         the median. A focal length needs depth: where the farthest is less than twice the nearest, it is told from distance badly.",
    );
    let far = known.iter().map(|it| it.1[it.1.len() - 1]).fold(0.0, f64::max);
    let near = known.iter().map(|it| it.1[0]).fold(0.0, f64::min);
    let n = known.len();
    let x = Axis::linear(near, 1.03 * far, &format!("depth [{}]", report.unit));
    let size = [720.0, 50.0 + 18.0 * n as f64];
    let mut plot = Plot::new(size, x, Axis::linear(0.0, n as f64, ""), "Depths by camera").with_rows(130.0);
    for (index, &(name, depths)) in known.iter().enumerate() {
        let row = n as f64 - index as f64 - 0.5;
        let at = plot.y(row);
        let words: String = name.chars().take(20).collect();
        plot.text("tick e", 124.0, at + 3.5, &words);
        plot.line("thin s0", [(depths[0], row), (depths[depths.len() - 1], row)].into_iter());
        let [low, middle, high] = [0.25, 0.5, 0.75].map(|part| plot.x(quantile(depths, part)));
        plot.raw(&format!(
            "<rect class=\"box\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"10\"/><path class=\"median\" d=\"M{} {}v10\"/>",
            short(low),
            short(at - 5.0),
            short(high - low),
            short(middle),
            short(at - 5.0),
        ));
    }
    page.raw(&plot.finish());
}
