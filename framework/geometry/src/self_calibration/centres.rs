//! The centres of all cameras at once, with known rotations: a linear problem.
//!
//! With d the unit direction of an observation in the world and P = w (I − d dᵀ), a point X seen from centres cᵢ has Σ Pᵢ (X − cᵢ) = 0.
//! Eliminating the points leaves a quadratic form in the centres that is least, except for shifts, at the wanted ones: its
//! fourth eigenvector, found by inverse iteration. Weights 1/depth² turn distances from the line into angles, and Cauchy's weights
//! suppress outliers, both from the round before.

use foveate_estimation::statistics::{SIGMA_PER_MAD, median};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix3, Point3, Translation3, Vector3};

use super::links::{Oriented, Tracks};
use super::rotations::Averaged;
use crate::camera::Camera;

const ROUNDS: usize = 12;
const INVERSE_ITERATIONS: usize = 30;

/// A first guess of the poses of the largest group.
pub(super) struct Start {
    /// By camera: its guess, if in the group.
    pub cameras: Vec<Option<Camera>>,
}

/// A line of sight in the world.
struct Bearing {
    camera: usize,
    direction: Vector3<f64>,
    weight: f64,
    depth: f64,
    error: f64,
}

/// Places the cameras of the largest group; `None` when it holds fewer than two.
pub(super) fn place(tracks: &Tracks<'_>, links: &[Oriented], graph: &Averaged) -> Option<Start> {
    let n = tracks.cameras.len();
    let members: Vec<usize> = (0..n).filter(|it| graph.group[*it] == graph.largest).collect();
    if members.len() < 2 {
        return None;
    }
    let mut slots = vec![None; n];
    members.iter().enumerate().for_each(|(slot, camera)| slots[*camera] = Some(slot));
    let mut supported = vec![false; tracks.observations.len()];
    for link in links.iter().filter(|it| graph.consistent.contains(&(it.link.a, it.link.b))) {
        link.right.iter().flatten().for_each(|it| supported[*it] = true);
    }
    let mut frames: Vec<Vec<Bearing>> = Vec::new();
    for frame in &tracks.of_frame {
        let bearing = |index: &usize| {
            let observation = &tracks.observations[*index];
            let slot = slots[observation.camera].filter(|_| supported[*index])?;
            let in_camera = tracks.cameras[observation.camera].normalise(&observation.pixel)?.push(1.0);
            let direction = graph.camera_from_world[observation.camera].inverse() * in_camera.normalize();
            Some(Bearing { camera: slot, direction, weight: 1.0, depth: 1.0, error: 0.0 })
        };
        let bearings: Vec<Bearing> = frame.iter().filter_map(bearing).collect();
        if bearings.len() >= 2 {
            frames.push(bearings);
        }
    }
    let mut centres = DVector::zeros(3 * members.len());
    for round in 0..ROUNDS {
        centres = least_centres(&frames, members.len(), &centres, round)?;
        measure(&mut frames, &centres);
        let in_front = frames.iter().flatten().filter(|it| it.depth > 0.0).count();
        if 2 * in_front < frames.iter().map(Vec::len).sum() {
            centres = -centres;
            frames.iter_mut().flatten().for_each(|it| it.depth = -it.depth);
        }
        let errors: Vec<f64> = frames.iter().flatten().map(|it| it.error).collect();
        let scale = 2.385 * SIGMA_PER_MAD * median(&errors)?.max(1e-9);
        let depths: Vec<f64> = frames.iter().flatten().map(|it| it.depth.abs()).collect();
        let middle = median(&depths)?;
        for bearing in frames.iter_mut().flatten() {
            // Depths of points that are still far off would give single observations all the weight.
            let depth = bearing.depth.abs().clamp(0.2 * middle, 5.0 * middle) / middle;
            bearing.weight = 1.0 / (depth * depth * (1.0 + (bearing.error / scale).powi(2)));
        }
    }
    let mut cameras = vec![None; n];
    for (slot, &camera) in members.iter().enumerate() {
        let rotation = graph.camera_from_world[camera];
        let centre = centres.fixed_rows::<3>(3 * slot).into_owned();
        let camera_from_world = Isometry3::from_parts(Translation3::from(-(rotation * centre)), rotation);
        cameras[camera] = Some(Camera { camera_from_world, ..tracks.cameras[camera].clone() });
    }
    Some(Start { cameras })
}

/// The form of the centres when the points follow, least but for shifts; from `before` or, at first, from a fixed direction.
fn least_centres(frames: &[Vec<Bearing>], n: usize, before: &DVector<f64>, round: usize) -> Option<DVector<f64>> {
    let mut form = DMatrix::zeros(3 * n, 3 * n);
    for bearings in frames {
        let projections: Vec<Matrix3<f64>> = bearings.iter().map(across).collect();
        let Some(inverse) = projections.iter().sum::<Matrix3<f64>>().try_inverse() else { continue };
        for (bearing, projection) in bearings.iter().zip(&projections) {
            let led_back = projection * inverse;
            let mut own = form.fixed_view_mut::<3, 3>(3 * bearing.camera, 3 * bearing.camera);
            own += projection;
            for (other, by) in bearings.iter().zip(&projections) {
                let mut block = form.fixed_view_mut::<3, 3>(3 * bearing.camera, 3 * other.camera);
                block -= led_back * by;
            }
        }
    }
    let weight = form.trace() / (3 * n) as f64;
    // Shifts of all centres together cost nothing: make them dear, so that the least direction is the wanted one.
    for row in 0..3 * n {
        for column in (row % 3..3 * n).step_by(3) {
            form[(row, column)] += weight;
        }
        form[(row, row)] += 1e-10 * weight;
    }
    let factors = form.cholesky()?;
    let mut vector = before.clone();
    if round == 0 {
        // Any start that is not symmetric does.
        vector = DVector::from_fn(3 * n, |row, _| (1.7 * row as f64 + 0.3).sin());
    }
    for _ in 0..INVERSE_ITERATIONS {
        vector = factors.solve(&vector);
        let norm = vector.norm();
        vector /= norm;
    }
    vector.iter().all(|it| it.is_finite()).then_some(vector)
}

fn across(bearing: &Bearing) -> Matrix3<f64> {
    (Matrix3::identity() - bearing.direction * bearing.direction.transpose()) * bearing.weight
}

/// Intersects each frame, and measures depth and angular error of its bearings.
fn measure(frames: &mut [Vec<Bearing>], centres: &DVector<f64>) {
    for bearings in frames {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for bearing in bearings.iter() {
            let projection = across(bearing);
            normal += projection;
            right += projection * centres.fixed_rows::<3>(3 * bearing.camera);
        }
        let Some(point) = normal.try_inverse().map(|it| Point3::from(it * right)) else { continue };
        for bearing in bearings.iter_mut() {
            let offset = point.coords - centres.fixed_rows::<3>(3 * bearing.camera);
            bearing.depth = offset.dot(&bearing.direction);
            bearing.error = bearing.direction.cross(&offset).norm() / offset.norm().max(f64::MIN_POSITIVE);
        }
    }
}
