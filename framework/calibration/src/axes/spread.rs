//! How far points reach in each direction: levers of what is fitted to them, and whether they lie on a line or in a plane.

use foveate_geometry::AlignmentError;
use nalgebra::{Matrix3, Point3, Vector3};

use super::AxesError;

/// Points whose spread across a line is less than this part of that along it lie on it.
pub(super) const COLLINEAR: f64 = 0.02;

/// How far points reach.
pub(super) struct Spread {
    pub centroid: Point3<f64>,
    /// Root of the sum of the squared distances from the centroid: the lever of the scale.
    pub size: f64,
    pub flat_normal: Vector3<f64>,
    /// Roots of the eigenvalues of the scatter.
    pub least: f64,
    /// Tilts about the longest axis have this lever, which is the shortest one.
    pub middle: f64,
    pub largest: f64,
}

impl Spread {
    pub(super) fn of(points: &[Point3<f64>]) -> Spread {
        let n = points.len().max(1) as f64;
        let centroid = Point3::from(points.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords / n));
        let mut scatter = Matrix3::zeros();
        points.iter().for_each(|it| scatter += (it - centroid) * (it - centroid).transpose());
        let axes = scatter.symmetric_eigen();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| axes.eigenvalues[*a].total_cmp(&axes.eigenvalues[*b]));
        let root = |it: usize| axes.eigenvalues[order[it]].max(0.0).sqrt();
        Spread {
            centroid,
            size: scatter.trace().sqrt(),
            flat_normal: axes.eigenvectors.column(order[0]).into_owned(),
            least: root(0),
            middle: root(1),
            largest: root(2),
        }
    }
}

pub(super) fn not_collinear(given: &str, points: &[Point3<f64>]) -> Result<(), AxesError> {
    let spread = Spread::of(points);
    let ratio = spread.middle / spread.largest;
    let fault = AxesError::Collinear { given: given.to_owned(), ratio };
    if ratio.is_nan() || ratio < COLLINEAR { Err(fault) } else { Ok(()) }
}

pub(super) fn collinear(given: &str, fault: AlignmentError) -> AxesError {
    let ratio = match fault {
        AlignmentError::Degenerate { spread_ratio, .. } => spread_ratio,
        AlignmentError::LengthsDiffer { .. } | AlignmentError::NotFinite { .. } => f64::NAN,
    };
    AxesError::Collinear { given: given.to_owned(), ratio }
}
