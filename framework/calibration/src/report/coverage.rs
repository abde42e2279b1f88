//! Report section: coverage of each image by the light.

use std::fmt::Write as _;

use foveate_plot::colours::level;
use foveate_plot::svg::{Rect, Svg};
use foveate_plot::text::{escaped, fixed};

use super::ReportInput;
use super::figures::Figures;
use super::page::{LEVELS, Page, THEME};
use super::residuals::cell_of;

const COLUMNS: usize = 12;
/// Observations in a cell that give the darkest shade, where a camera has that many on average.
const LEAST_FULL: f64 = 5.0;

pub(super) fn section(page: &mut Page, report: &ReportInput<'_>, figures: &Figures) {
    page.section(
        "coverage",
        "Coverage of the images",
        "Where each camera saw the light, used or held out. Lens and focal length are known where the light was: in an empty \
         corner the calibration only extrapolates.",
    );
    let mut cells_html = String::new();
    for (camera, of) in report.solved.cameras.iter().zip(&figures.cameras) {
        let [width, height] = camera.camera.image_size.map(|it| f64::from(it.max(1)));
        let rows = ((COLUMNS as f64 * height / width).round() as usize).clamp(1, 3 * COLUMNS);
        let mut counts = vec![0_usize; COLUMNS * rows];
        for (pixel, _) in &of.seen {
            if let Some(cell) = cell_of(pixel, [width, height], [COLUMNS, rows]) {
                counts[cell] += 1;
            }
        }
        let full = (of.seen.len() as f64 / counts.len() as f64).max(LEAST_FULL);
        let size = [10.0 * COLUMNS as f64, 10.0 * rows as f64];
        let mut svg = Svg::bare(size[0], size[1], &format!("Coverage of {}", camera.name), THEME);
        let mut cells = vec![Vec::new(); LEVELS.len()];
        for (cell, count) in counts.iter().enumerate() {
            let [left, top] = [cell % COLUMNS, cell / COLUMNS].map(|it| 10.0 * it as f64);
            let rect = Rect { left, top, width: 10.0, height: 10.0 };
            cells[level(*count as f64 / full, LEVELS.len())].push(rect);
        }
        cells.iter().zip(LEVELS).for_each(|(cells, colour)| svg.cells(cells, colour));
        let covered = counts.iter().filter(|it| **it > 0).count() as f64 / counts.len() as f64;
        let _ = write!(
            cells_html,
            "<figure>{}<figcaption><b>{}</b> {} %</figcaption></figure>",
            svg.element("heat"),
            escaped(&camera.name),
            fixed(100.0 * covered, 0),
        );
    }
    page.raw(&format!("<div class=\"heats\">{cells_html}</div>"));
    let keys: String = [("h0", "none"), ("h1", "up to a fifth"), ("h3", "three fifths"), ("h5", "all and more")]
        .map(|(class, words)| format!("<span class=\"key {class}\">{words}</span>"))
        .concat();
    page.raw(&format!(
        "<p class=\"note\">Observations in a cell, relative to an even spread over the image, or to 5 where that is more: {keys}. Each \
         picture is the whole image, u to the right and v downwards.</p>"
    ));
}
