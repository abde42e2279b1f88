//! One camera for a projection and a lens that were estimated with two different calibration matrices.
//!
//! Wanted is the camera that puts each ray of `pinhole` at the pixel where `lens` would: with K_p [R t] the pinhole,
//! K_l distort(K_l⁻¹ K_p [R t] X). To first and second order in K_l⁻¹ K_p − 1 our model can do that: its decentering
//! terms are just what a shifted centre of distortion looks like, and a turn about the axis takes up the shear.
//! The rest is left to a least-squares fit (Levenberg–Marquardt) of all intrinsics and a small turn over the image.

use foveate_estimation::least_squares::{Damping, DriverOptions, SmallEquations, SmallProblem, solve_small};
use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Point2, Point3, SVector, UnitQuaternion, Vector2, Vector3};

/// Five intrinsics, five of distortion, three of a turn.
const UNKNOWNS: usize = 13;
type Unknowns = SVector<f64, UNKNOWNS>;
/// Grid of pixels over the image on which the two are compared.
const GRID: [usize; 2] = [33, 25];
const OPTIONS: DriverOptions = DriverOptions {
    damping: Damping { initial: 1e-6, least: 1e-12, fastest_decrease: 0.1 },
    max_iterations: 60,
    relative_gain: 1e-9,
    absolute_gain: 0.0,
};

/// The best camera, and its largest distance from the wanted pixels on a grid over the image [px]. `lens` stands at the
/// origin. `None` when the lens maps less than half of the image, or nothing fits to 5 px.
pub(crate) fn fit(lens: &Camera, pinhole: &Camera) -> Option<(Camera, f64)> {
    let samples = samples(lens, pinhole);
    if 2 * samples.len() < GRID[0] * GRID[1] {
        return None;
    }
    let start = Camera { distortion: lens.distortion, ..pinhole.clone() };
    let unknowns_of_start = Unknowns::from_row_slice(&[
        start.intrinsics.focal[0],
        start.intrinsics.focal[1],
        start.intrinsics.skew,
        start.intrinsics.principal[0],
        start.intrinsics.principal[1],
        start.distortion.k1,
        start.distortion.k2,
        start.distortion.p1,
        start.distortion.p2,
        start.distortion.k3,
        0.0,
        0.0,
        0.0,
    ]);
    let found = solve_small(&Fit { samples: &samples, pinhole }, unknowns_of_start, &OPTIONS).ok()?;
    let camera = camera_of(&found.parameters, pinhole);
    let error = errors(&camera, &samples, pinhole).flatten().map(|it| it.norm()).fold(0.0, f64::max);
    (error < 5.0).then_some((camera, error))
}

/// A ray of the pinhole as a point in its camera at depth 1, and the pixel where the lens puts it.
type Sample = (Point3<f64>, Point2<f64>);

fn samples(lens: &Camera, pinhole: &Camera) -> Vec<Sample> {
    let linear = |camera: &Camera| Camera { distortion: Distortion::default(), ..camera.clone() };
    let (linear_lens, linear_pinhole) = (linear(lens), linear(pinhole));
    let [columns, rows] = lens.image_size.map(f64::from);
    let place = |index: usize, of: usize, extent: f64| 1.0 + (extent - 1.0) * index as f64 / (of - 1) as f64;
    let pixels = (0..GRID[0] * GRID[1]).map(|index| {
        let (column, row) = (index % GRID[0], index / GRID[0]);
        Point2::new(place(column, GRID[0], columns), place(row, GRID[1], rows))
    });
    pixels
        .filter_map(|pixel| {
            let undistorted = linear_lens.project(&Point3::from(lens.normalise(&pixel)?.push(1.0)))?;
            Some((Point3::from(linear_pinhole.normalise(&undistorted)?.push(1.0)), pixel))
        })
        .collect()
}

fn camera_of(unknowns: &Unknowns, pinhole: &Camera) -> Camera {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(unknowns[10], unknowns[11], unknowns[12]));
    Camera {
        image_size: pinhole.image_size,
        intrinsics: Intrinsics {
            focal: [unknowns[0], unknowns[1]],
            skew: unknowns[2],
            principal: [unknowns[3], unknowns[4]],
        },
        distortion: Distortion { k1: unknowns[5], k2: unknowns[6], p1: unknowns[7], p2: unknowns[8], k3: unknowns[9] },
        camera_from_world: Isometry3::from_parts(Vector3::zeros().into(), turn) * pinhole.camera_from_world,
    }
}

/// Actual minus wanted pixel of each sample [px]; `None` where the camera sees nothing.
fn errors(camera: &Camera, samples: &[Sample], pinhole: &Camera) -> impl Iterator<Item = Option<Vector2<f64>>> {
    let turn = camera.camera_from_world.rotation * pinhole.camera_from_world.rotation.inverse();
    let at_origin = Camera { camera_from_world: Isometry3::from_parts(Default::default(), turn), ..camera.clone() };
    samples.iter().map(move |(point, pixel)| at_origin.project(point).map(|seen| seen - pixel))
}

struct Fit<'a> {
    samples: &'a [Sample],
    pinhole: &'a Camera,
}

impl SmallProblem<UNKNOWNS> for Fit<'_> {
    type Parameters = Unknowns;

    fn moved(&self, from: &Unknowns, step: &Unknowns) -> Unknowns {
        from + step
    }

    /// By central differences.
    fn linearise(&self, at: &Unknowns, equations: &mut SmallEquations<UNKNOWNS>) -> Option<()> {
        let errors_at = |unknowns: &Unknowns| -> Option<Vec<Vector2<f64>>> {
            errors(&camera_of(unknowns, self.pinhole), self.samples, self.pinhole).collect()
        };
        let residuals = errors_at(at)?;
        let mut columns: [Vec<Vector2<f64>>; UNKNOWNS] = Default::default();
        for (unknown, column) in columns.iter_mut().enumerate() {
            let step = 1e-5 * at[unknown].abs().max(1.0);
            let (mut above, mut below) = (*at, *at);
            above[unknown] += step;
            below[unknown] -= step;
            let (above, below) = (errors_at(&above)?, errors_at(&below)?);
            *column = above.iter().zip(&below).map(|(a, b)| (a - b) / (2.0 * step)).collect();
        }
        let dot = |a: &[Vector2<f64>], b: &[Vector2<f64>]| a.iter().zip(b).map(|(a, b)| a.dot(b)).sum::<f64>();
        for (row, by_row) in columns.iter().enumerate() {
            equations.gradient[row] = dot(by_row, &residuals);
            for (column, by_column) in columns.iter().enumerate() {
                equations.information[(row, column)] = dot(by_row, by_column);
            }
        }
        equations.cost = 0.5 * dot(&residuals, &residuals);
        Some(())
    }
}
