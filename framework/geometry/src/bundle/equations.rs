//! The normal equations of cameras and points, and their reduction to the cameras.

use foveate_estimation::Loss;
use foveate_estimation::least_squares::driver::predicted_reduction;
use nalgebra::{DMatrix, DVector, Matrix2x3, Matrix3, Point3, SMatrix, SVector, Vector2, Vector3};

use super::Observation;
use super::columns::{N_NAMES, OpticsPrior};
use super::lengths::{Coupled, Length};
use crate::camera::Camera;

/// Who sees what, ordered by point and within a point by camera.
pub(super) struct Layout {
    /// The observations in use.
    pub observations: Vec<Observation>,
    /// By point: its range in `observations`.
    pub of_point: Vec<std::ops::Range<usize>>,
    /// By observation in use, where clocks are adjusted: how the pixel moves [px/s], and when [s].
    pub motions: Vec<(Vector2<f64>, f64)>,
    /// By camera and name: the row in the reduced system, where free.
    pub rows: Vec<[Option<usize>; N_NAMES]>,
    /// By column of a camera's block: its name.
    pub names: Vec<usize>,
    /// By camera: its place among those with something free.
    pub slots: Vec<Option<usize>>,
    /// Known lengths between points in use; no point is in two.
    pub lengths: Vec<Length>,
    /// By camera, where anything is known.
    pub known_optics: Vec<OpticsPrior>,
    /// By point: whether it is in one.
    pub coupled: Vec<bool>,
    /// Cameras that see points in use and whose pose is held.
    pub anchors: Vec<usize>,
    /// Rows of the reduced system.
    pub dimension: usize,
}

/// All blocks at one state; those of cameras are C wide, the last two columns for the clock where it is adjusted.
pub(super) struct Equations<const C: usize, const TIMED: bool> {
    pub of_camera: Vec<SMatrix<f64, C, C>>,
    pub gradient_of_camera: Vec<SVector<f64, C>>,
    pub of_point: Vec<Matrix3<f64>>,
    pub gradient_of_point: Vec<Vector3<f64>>,
    pub between: Vec<SMatrix<f64, C, 3>>,
    /// By known length: the block of its two points.
    pub of_length: Vec<Matrix3<f64>>,
    pub cost: f64,
}

/// The system of the cameras alone, and what leads back to the points.
pub(super) struct Reduced<const C: usize> {
    blocks: Vec<SMatrix<f64, C, C>>,
    gradients: Vec<SVector<f64, C>>,
    pub inverses: Vec<Matrix3<f64>>,
    /// By known length.
    pub coupled: Vec<Coupled>,
    pub information: DMatrix<f64>,
    pub gradient: DVector<f64>,
}

/// A camera with its rotation as a matrix, for many points in turn.
pub struct Posed<'a> {
    camera: &'a Camera,
    rotation: Matrix3<f64>,
}

impl<'a> Posed<'a> {
    /// Precomputes the rotation of `camera`.
    pub fn new(camera: &'a Camera) -> Posed<'a> {
        Posed { camera, rotation: camera.camera_from_world.rotation.to_rotation_matrix().into_inner() }
    }

    /// Pixel [px], its derivatives with respect to the first C columns of [`super::NAMES`] (where `TIMED`: C − 2, and
    /// two left 0 for the clock) and to the point; `None` where the camera does not see it.
    #[inline]
    pub fn linearise<const C: usize, const TIMED: bool>(
        &self,
        point: &Point3<f64>,
    ) -> Option<(Vector2<f64>, SMatrix<f64, 2, C>, Matrix2x3<f64>)> {
        let in_camera = self.rotation * point.coords + self.camera.camera_from_world.translation.vector;
        if in_camera.z.is_nan() || in_camera.z <= 0.0 {
            return None;
        }
        let per_depth = 1.0 / in_camera.z;
        let (x, y) = (in_camera.x * per_depth, in_camera.y * per_depth);
        let (distorted, slope) = self.camera.distortion.distort_with_jacobian(&Vector2::new(x, y))?;
        let intrinsics = &self.camera.intrinsics;
        let ([fx, fy], skew) = (intrinsics.focal, intrinsics.skew);
        // Pixel by normalised point.
        let a = fx * slope.m11 + skew * slope.m21;
        let b = fx * slope.m12 + skew * slope.m22;
        let (c, d) = (fy * slope.m21, fy * slope.m22);
        let rows = &self.rotation;
        let mut by_point = Matrix2x3::zeros();
        for column in 0..3 {
            let dx = (rows[(0, column)] - rows[(2, column)] * x) * per_depth;
            let dy = (rows[(1, column)] - rows[(2, column)] * y) * per_depth;
            by_point[(0, column)] = a * dx + b * dy;
            by_point[(1, column)] = c * dx + d * dy;
        }
        let mut by_camera = SMatrix::<f64, 2, C>::zeros();
        for row in 0..2 {
            // T exp(δ) p = T (p + ω × p + v): the pixel by ω is p × (pixel by p).
            let (j, p) = ([by_point[(row, 0)], by_point[(row, 1)], by_point[(row, 2)]], point);
            by_camera[(row, 0)] = p.y * j[2] - p.z * j[1];
            by_camera[(row, 1)] = p.z * j[0] - p.x * j[2];
            by_camera[(row, 2)] = p.x * j[1] - p.y * j[0];
            by_camera[(row, 3)] = j[0];
            by_camera[(row, 4)] = j[1];
            by_camera[(row, 5)] = j[2];
        }
        let centred = Vector2::new(fx * distorted.x + skew * distorted.y, fy * distorted.y);
        let end = if TIMED { C - 2 } else { C };
        if end > 6 {
            let s = x * x + y * y;
            let linear = |u: f64, v: f64| Vector2::new(fx * u + skew * v, fy * v);
            let optics = [
                centred,
                linear(x * s, y * s),
                linear(x * s * s, y * s * s),
                Vector2::x(),
                Vector2::y(),
                Vector2::new(0.0, fy * distorted.y),
                linear(2.0 * x * y, s + 2.0 * y * y),
                linear(s + 2.0 * x * x, 2.0 * x * y),
                linear(x * s * s * s, y * s * s * s),
            ];
            for column in 6..end {
                by_camera.set_column(column, &optics[column - 6]);
            }
        }
        Some((centred + Vector2::from(intrinsics.principal), by_camera, by_point))
    }
}

impl<const C: usize, const TIMED: bool> Equations<C, TIMED> {
    pub(super) fn new(layout: &Layout, n_points: usize) -> Self {
        let n_free = layout.slots.iter().flatten().count();
        Self {
            of_camera: vec![SMatrix::zeros(); n_free],
            gradient_of_camera: vec![SVector::zeros(); n_free],
            of_point: vec![Matrix3::zeros(); n_points],
            gradient_of_point: vec![Vector3::zeros(); n_points],
            between: vec![SMatrix::zeros(); layout.observations.len()],
            of_length: vec![Matrix3::zeros(); layout.lengths.len()],
            cost: 0.0,
        }
    }

    /// Fills in the blocks at a state; `None` where a camera does not see a point. `clocks`: offset and drift of each camera.
    pub(super) fn fill(
        &mut self,
        layout: &Layout,
        cameras: &[Camera],
        clocks: &[[f64; 2]],
        points: &[Point3<f64>],
        loss: &Loss,
    ) -> Option<()> {
        self.of_camera.fill(SMatrix::zeros());
        self.gradient_of_camera.fill(SVector::zeros());
        self.cost = 0.0;
        let posed: Vec<Posed<'_>> = cameras.iter().map(Posed::new).collect();
        for (index, range) in layout.of_point.iter().enumerate() {
            let (mut of_point, mut gradient) = (Matrix3::zeros(), Vector3::zeros());
            for at in range.clone() {
                let observation = &layout.observations[at];
                let linear = posed[observation.camera].linearise::<C, TIMED>(&points[index])?;
                let (seen, mut by_camera, by_point) = linear;
                let per_sigma = 1.0 / observation.sigma_px;
                let mut error = seen - observation.pixel.coords;
                if TIMED {
                    let (velocity, time_s) = layout.motions[at];
                    let [offset, drift] = clocks[observation.camera];
                    error -= velocity * (offset + drift * time_s);
                    by_camera.set_column(C - 2, &-velocity);
                    by_camera.set_column(C - 1, &(velocity * -time_s));
                }
                let (cost, weight) = loss.at(error.norm_squared() * per_sigma * per_sigma);
                self.cost += 0.5 * cost;
                let weight = weight * per_sigma * per_sigma;
                let weighted_point = by_point * weight;
                of_point += by_point.tr_mul(&weighted_point);
                gradient += weighted_point.tr_mul(&error);
                if let Some(slot) = layout.slots[observation.camera] {
                    self.between[at] = by_camera.tr_mul(&weighted_point);
                    let weighted = by_camera * weight;
                    self.of_camera[slot] += by_camera.tr_mul(&weighted);
                    self.gradient_of_camera[slot] += weighted.tr_mul(&error);
                }
            }
            self.of_point[index] = of_point;
            self.gradient_of_point[index] = gradient;
        }
        for (length, coupling) in layout.lengths.iter().zip(&mut self.of_length) {
            self.cost += length.add(points, loss, &mut self.of_point, &mut self.gradient_of_point, coupling)?;
        }
        self.add_known_optics(layout, cameras);
        self.cost.is_finite().then_some(())
    }

    /// Of a step of the equations with all diagonals raised by the part `damping`.
    pub(super) fn predicted_reduction(
        &self,
        of_cameras: &[SVector<f64, C>],
        of_points: &[Vector3<f64>],
        damping: f64,
    ) -> f64 {
        let mut sum = 0.0;
        for ((step, gradient), block) in of_cameras.iter().zip(&self.gradient_of_camera).zip(&self.of_camera) {
            let raised = block.diagonal() * damping;
            sum += predicted_reduction(step.as_slice(), gradient.as_slice(), raised.as_slice());
        }
        for ((step, gradient), block) in of_points.iter().zip(&self.gradient_of_point).zip(&self.of_point) {
            let raised = block.diagonal() * damping;
            sum += predicted_reduction(step.as_slice(), gradient.as_slice(), raised.as_slice());
        }
        sum
    }

    fn add_known_optics(&mut self, layout: &Layout, cameras: &[Camera]) {
        for (index, known) in layout.known_optics.iter().enumerate() {
            let Some(slot) = layout.slots[index] else { continue };
            for (optic, (apart, sigma)) in known.apart(&cameras[index]).iter().zip(known.sigma.columns()).enumerate() {
                let column = 6 + optic;
                if layout.rows[index][column].is_none() {
                    continue;
                }
                let information = sigma.powi(-2); // 0 of an infinite one
                self.of_camera[slot][(column, column)] += information;
                self.gradient_of_camera[slot][column] += information * apart;
                self.cost += 0.5 * information * apart * apart;
            }
        }
    }
}

impl<const C: usize> Reduced<C> {
    pub(super) fn new(layout: &Layout, n_points: usize) -> Self {
        let n_free = layout.slots.iter().flatten().count();
        Self {
            blocks: vec![SMatrix::zeros(); n_free * (n_free + 1) / 2],
            gradients: vec![SVector::zeros(); n_free],
            inverses: vec![Matrix3::zeros(); n_points],
            coupled: vec![Coupled::default(); layout.lengths.len()],
            information: DMatrix::zeros(layout.dimension, layout.dimension),
            gradient: DVector::zeros(layout.dimension),
        }
    }

    /// Eliminates the points, with all diagonals raised by the part `damping`.
    pub(super) fn fill<const TIMED: bool>(&mut self, layout: &Layout, equations: &Equations<C, TIMED>, damping: f64) {
        self.blocks.fill(SMatrix::zeros());
        for (slot, block) in equations.of_camera.iter().enumerate() {
            let own = &mut self.blocks[slot * (slot + 1) / 2 + slot];
            *own = *block;
            (0..C).for_each(|it| own[(it, it)] *= 1.0 + damping);
        }
        self.gradients.copy_from_slice(&equations.gradient_of_camera);
        for (index, range) in layout.of_point.iter().enumerate() {
            if layout.coupled[index] {
                continue;
            }
            let mut damped = equations.of_point[index];
            (0..3).for_each(|it| damped[(it, it)] *= 1.0 + damping);
            let inverse = invert(&damped);
            self.inverses[index] = inverse;
            let gradient = &equations.gradient_of_point[index];
            for high in range.clone() {
                let Some(row) = layout.slots[layout.observations[high].camera] else { continue };
                let led_back = equations.between[high] * inverse;
                self.gradients[row] -= led_back * gradient;
                let first = row * (row + 1) / 2;
                for low in range.start..=high {
                    let Some(column) = layout.slots[layout.observations[low].camera] else { continue };
                    let block = &mut self.blocks[first + column];
                    let between = &equations.between[low];
                    subtract_product(block, &led_back, between);
                    if row == column && low != high {
                        // Twice by the same camera: the transpose lies in the same block.
                        subtract_product(block, &(equations.between[low] * inverse), &equations.between[high]);
                    }
                }
            }
        }
        for (index, length) in layout.lengths.iter().enumerate() {
            self.eliminate_coupled(layout, equations, damping, index, length.points);
        }
        self.spread(layout);
    }

    /// Eliminates both points of a known length at once.
    fn eliminate_coupled<const TIMED: bool>(
        &mut self,
        layout: &Layout,
        equations: &Equations<C, TIMED>,
        damping: f64,
        index: usize,
        points: [usize; 2],
    ) {
        let of_points = points.map(|it| equations.of_point[it]);
        let inverse = Coupled::inverse_of(of_points, &equations.of_length[index], damping);
        let gradients = points.map(|it| equations.gradient_of_point[it]);
        let seen = || {
            points.into_iter().enumerate().flat_map(|(side, it)| layout.of_point[it].clone().map(move |at| (side, at)))
        };
        for (side, high) in seen() {
            let Some(row) = layout.slots[layout.observations[high].camera] else { continue };
            let led_back = [0, 1].map(|other| equations.between[high] * inverse.block(side, other));
            self.gradients[row] -= led_back[0] * gradients[0] + led_back[1] * gradients[1];
            for (other, low) in seen() {
                let Some(column) = layout.slots[layout.observations[low].camera].filter(|it| *it <= row) else {
                    continue;
                };
                subtract_product(
                    &mut self.blocks[row * (row + 1) / 2 + column],
                    &led_back[other],
                    &equations.between[low],
                );
            }
        }
        self.coupled[index] = inverse;
    }

    /// Copies the free rows and columns of the blocks into the dense system.
    fn spread(&mut self, layout: &Layout) {
        let free: Vec<(usize, &[Option<usize>; N_NAMES])> =
            layout.slots.iter().zip(&layout.rows).filter_map(|(slot, rows)| Some(((*slot)?, rows))).collect();
        for &(slot, rows) in &free {
            for (column, name) in layout.names.iter().enumerate() {
                if let Some(to_row) = rows[*name] {
                    self.gradient[to_row] = self.gradients[slot][column];
                }
            }
            for &(other, columns) in &free[..=slot] {
                let block = &self.blocks[slot * (slot + 1) / 2 + other];
                for (column, name) in layout.names.iter().enumerate() {
                    let Some(to_column) = columns[*name] else { continue };
                    for (row, name) in layout.names.iter().enumerate() {
                        let Some(to_row) = rows[*name] else { continue };
                        self.information[(to_row, to_column)] = block[(row, column)];
                        self.information[(to_column, to_row)] = block[(row, column)];
                    }
                }
            }
        }
    }

    /// The step of the points that follows from one of the cameras.
    pub(super) fn step_of_points<const TIMED: bool>(
        &self,
        layout: &Layout,
        equations: &Equations<C, TIMED>,
        of_cameras: &[SVector<f64, C>],
        steps: &mut [Vector3<f64>],
    ) {
        let gradient_of = |index: usize| {
            let mut gradient = equations.gradient_of_point[index];
            for at in layout.of_point[index].clone() {
                if let Some(slot) = layout.slots[layout.observations[at].camera] {
                    gradient += equations.between[at].tr_mul(&of_cameras[slot]);
                }
            }
            gradient
        };
        for (index, step) in steps.iter_mut().enumerate() {
            if !layout.coupled[index] {
                *step = -(self.inverses[index] * gradient_of(index));
            }
        }
        for (length, inverse) in layout.lengths.iter().zip(&self.coupled) {
            let gradients = length.points.map(gradient_of);
            for (side, point) in length.points.into_iter().enumerate() {
                steps[point] = -(inverse.block(side, 0) * gradients[0] + inverse.block(side, 1) * gradients[1]);
            }
        }
    }
}

/// `block` −= `a` `b`ᵀ.
#[inline]
fn subtract_product<const C: usize>(block: &mut SMatrix<f64, C, C>, a: &SMatrix<f64, C, 3>, b: &SMatrix<f64, C, 3>) {
    for column in 0..C {
        let [b0, b1, b2] = [b[(column, 0)], b[(column, 1)], b[(column, 2)]];
        for row in 0..C {
            block[(row, column)] -= a[(row, 0)] * b0 + a[(row, 1)] * b1 + a[(row, 2)] * b2;
        }
    }
}

/// The inverse of a symmetric matrix; of one that is singular, 0: such a point does not move and tells nothing.
#[inline]
fn invert(symmetric: &Matrix3<f64>) -> Matrix3<f64> {
    let m = symmetric;
    let a = m.m22 * m.m33 - m.m23 * m.m23;
    let b = m.m13 * m.m23 - m.m12 * m.m33;
    let c = m.m12 * m.m23 - m.m13 * m.m22;
    let determinant = m.m11 * a + m.m12 * b + m.m13 * c;
    let largest = m.m11.max(m.m22).max(m.m33);
    if determinant.is_nan() || determinant <= 1e-20 * largest * largest * largest {
        return Matrix3::zeros();
    }
    let per = 1.0 / determinant;
    let (d, e) = (m.m11 * m.m33 - m.m13 * m.m13, m.m12 * m.m13 - m.m11 * m.m23);
    let f = m.m11 * m.m22 - m.m12 * m.m12;
    Matrix3::new(a, b, c, b, d, e, c, e, f) * per
}
