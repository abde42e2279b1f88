//! Straight lines fitted to points by least squares, as [Davis 2002 §3.7] does.

use nalgebra::{SMatrix, SVector};

/// Distance of each point from the line that fits all of them best.
pub fn distances_from_line<const D: usize>(points: &[SVector<f64, D>]) -> Vec<f64> {
    let n = points.len().max(1) as f64;
    let middle: SVector<f64, D> = points.iter().sum::<SVector<f64, D>>() / n;
    let mut spread = SMatrix::<f64, D, D>::zeros();
    for point in points {
        spread += (point - middle) * (point - middle).transpose();
    }
    // The line runs along the eigenvector of the largest eigenvalue: power iteration, since D is a parameter.
    let mut along = points.last().map_or(SVector::zeros(), |it| it - middle);
    for _ in 0..100 {
        along = (spread * along).normalize();
    }
    points.iter().map(|it| ((it - middle) - along * along.dot(&(it - middle))).norm()).collect()
}

/// Mean and largest of some numbers.
pub fn mean_and_most(values: &[f64]) -> [f64; 2] {
    let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
    [mean, values.iter().copied().fold(0.0, f64::max)]
}
