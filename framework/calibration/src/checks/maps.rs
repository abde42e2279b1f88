//! Residuals over the picture of a camera: what is systematic in them, and what it looks like.

use nalgebra::{Matrix5, SMatrix, Vector2, Vector5};

use super::network::Room;
use crate::solved::ObservationRole;

/// What a systematic residual looks like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Pattern {
    /// The same everywhere: the principal point is off, or the camera moved.
    Shifted,
    /// Grows with the distance from the middle: the focal length is off.
    Scaled,
    /// Turns about the middle: the camera rolled.
    Rolled,
    /// Grows with the third power of the distance: the lens distorts otherwise than its model.
    Distorted,
    /// None of these.
    Other,
}

/// One cell of a [`ResidualMap`].
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MapCell {
    /// Observations in it [–].
    pub count: usize,
    /// Mean of their residuals, seen − measured [px].
    pub mean: Vector2<f64>,
    /// Standard deviation of either coordinate of that mean, were the residuals independent noise [px].
    pub sigma: f64,
}

/// Residuals of a camera, binned over its picture.
#[derive(Debug, Clone, PartialEq)]
pub struct ResidualMap {
    /// Cells across and down.
    pub size: [usize; 2],
    /// Row by row from the top left.
    pub cells: Vec<MapCell>,
    /// What is systematic about it, if anything.
    pub pattern: Option<Pattern>,
    /// Root of the mean squared systematic residual, noise taken off [px].
    pub systematic_px: f64,
}

impl ResidualMap {
    /// The cell at `column` and `row`.
    pub fn cell(&self, column: usize, row: usize) -> Option<&MapCell> {
        self.cells.get(row * self.size[0] + column).filter(|_| column < self.size[0])
    }
}

/// Cells with fewer observations say nothing.
const LEAST_IN_CELL: usize = 3;
/// Shapes take up the pattern when they explain this part of it.
const EXPLAINS: f64 = 0.5;
/// How unlikely chance must be: standard deviations of the sum of squares over the cells.
const SIGNIFICANT: f64 = 6.0;

/// `None` without an observation in use that has a residual.
pub(super) fn map(network: &Room<'_>, camera: usize) -> Option<ResidualMap> {
    let [width, height] = network.solved.cameras[camera].camera.image_size.map(f64::from);
    let n = network.options.map_cells.max(1);
    let cell_px = width.max(height) / n as f64;
    let size = [(width / cell_px).ceil() as usize, (height / cell_px).ceil() as usize].map(|it| it.max(1));
    let mut cells = vec![MapCell::default(); size[0] * size[1]];
    let used = network.of_camera[camera].iter().map(|it| &network.solved.observations[*it]);
    for observation in used.filter(|it| it.role == ObservationRole::Used) {
        let Some(residual) = observation.residual else { continue };
        let place = |at: f64, of: usize| (((at + 0.5) / cell_px).max(0.0) as usize).min(of - 1);
        let cell = &mut cells[place(observation.pixel.y, size[1]) * size[0] + place(observation.pixel.x, size[0])];
        cell.count += 1;
        cell.mean += residual;
    }
    if cells.iter().all(|it| it.count == 0) {
        return None;
    }
    for cell in cells.iter_mut().filter(|it| it.count > 0) {
        cell.mean /= cell.count as f64;
        cell.sigma = network.sigma_px / (cell.count as f64).sqrt();
    }
    let told: Vec<(Vector2<f64>, MapCell)> = cells
        .iter()
        .enumerate()
        .filter(|(_, it)| it.count >= LEAST_IN_CELL)
        .map(|(index, it)| (middle_of(index, size), *it))
        .collect();
    let chi2: f64 = told.iter().map(|(_, it)| it.mean.norm_squared() / it.sigma.powi(2)).sum();
    let freedom = 2.0 * told.len() as f64;
    let count: f64 = told.iter().map(|(_, it)| it.count as f64).sum();
    let squares: f64 = told.iter().map(|(_, it)| it.mean.norm_squared() * it.count as f64).sum();
    let noise = freedom * network.sigma_px.powi(2);
    let systematic_px = ((squares - noise) / count.max(1.0)).max(0.0).sqrt();
    let significant = chi2 > freedom + SIGNIFICANT * (2.0 * freedom).sqrt();
    let told_of = significant
        && systematic_px > (network.options.pattern_sigma * network.sigma_px).max(network.options.least_effect_px);
    let pattern = told_of.then(|| shape(&told));
    Some(ResidualMap { size, cells, pattern, systematic_px })
}

/// The middle of a cell, from the middle of the picture, in halves of its longer side.
fn middle_of(index: usize, [across, down]: [usize; 2]) -> Vector2<f64> {
    let (column, row) = ((index % across) as f64, (index / across) as f64);
    let half = 0.5 * across.max(down) as f64;
    Vector2::new((column + 0.5 - 0.5 * across as f64) / half, (row + 0.5 - 0.5 * down as f64) / half)
}

/// Fits shift, scale, roll and distortion together, and names the one that takes most when left out.
fn shape(cells: &[(Vector2<f64>, MapCell)]) -> Pattern {
    let fitted = |held: Option<usize>| -> f64 {
        let (mut information, mut gradient) = (Matrix5::<f64>::identity() * 1e-9, Vector5::<f64>::zeros());
        for (at, cell) in cells {
            let rows = shapes(at, held);
            let weight = cell.sigma.powi(-2);
            information += rows.transpose() * rows * weight;
            gradient += rows.transpose() * cell.mean * weight;
        }
        information.cholesky().map_or(0.0, |it| it.solve(&gradient).dot(&gradient))
    };
    let total: f64 = cells.iter().map(|(_, it)| it.mean.norm_squared() / it.sigma.powi(2)).sum();
    let together = fitted(None);
    if together < EXPLAINS * total {
        return Pattern::Other;
    }
    let each = [Pattern::Shifted, Pattern::Scaled, Pattern::Rolled, Pattern::Distorted];
    let loss = |index: usize| together - fitted(Some(index));
    each[(0..4).max_by(|a, b| loss(*a).total_cmp(&loss(*b))).unwrap_or(0)]
}

/// Columns: shift in x and y, scale, roll, distortion; those of the shape `held` are 0.
fn shapes(at: &Vector2<f64>, held: Option<usize>) -> SMatrix<f64, 2, 5> {
    let cubic = at * at.norm_squared();
    let columns = [Vector2::x(), Vector2::y(), *at, Vector2::new(-at.y, at.x), cubic];
    let of_shape = [0, 0, 1, 2, 3];
    SMatrix::from_fn(|row, column| if held == Some(of_shape[column]) { 0.0 } else { columns[column][row] })
}
