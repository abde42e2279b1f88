//! The pose of a wall in a room, from a light of the room held at places of the wall.
//!
//! A rigid transform takes the wall's plane (x to the right, y down, z into it) to the room; it starts from the method of S. Umeyama (`foveate::geometry::alignment`) and
//! is adjusted by least squares, each place weighted by the covariance of the light's position.

use foveate::estimation::least_squares::{Equations, Loss, Options, Problem, solve};
use foveate::geometry::alignment::{AlignmentError, AlignmentOptions, align};
use nalgebra::{DVector, Isometry3, Matrix3, Matrix6, Point2, Point3, SMatrix, Translation3, UnitQuaternion, Vector3};

/// Fewest places for a pose, not on one line.
pub(super) const LEAST_PLACES: usize = 3;

/// Message where no pose was found.
const NO_POSE: &str = "no pose of the wall fits the light's positions: are the places right, and not on one line?";

/// A place of the wall, and the position of the light that was held there.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Touch {
    /// On the wall [m].
    pub(super) on_wall: Point2<f64>,
    /// In the room [m].
    pub(super) in_room: Point3<f64>,
    /// Covariance of the light's position, including how it was held [m²].
    pub(super) covariance: Matrix3<f64>,
}

/// Pose of the wall.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WallPose {
    pub(super) room_from_wall: Isometry3<f64>,
    /// Covariance of a step exp(δ) on its right: rotation, translation.
    pub(super) covariance: Matrix6<f64>,
    /// The places on the wall [m].
    pub(super) places: Vec<Point2<f64>>,
    /// By place, its distance from the light's position [m].
    pub(super) misses: Vec<f64>,
    /// The same with the place held out of the fit [m]; empty with too few places.
    pub(super) held_out: Vec<f64>,
    /// By place, root mean square distance of the others with the place held out [m].
    pub(super) others: Vec<f64>,
}

fn in_space(on_wall: &Point2<f64>) -> Point3<f64> {
    Point3::new(on_wall.x, on_wall.y, 0.0)
}

impl WallPose {
    /// A point of the wall in the room [m].
    pub(super) fn point(&self, on_wall: &Point2<f64>) -> Point3<f64> {
        self.room_from_wall * in_space(on_wall)
    }

    /// Covariance of that [m²].
    pub(super) fn covariance_at(&self, on_wall: &Point2<f64>) -> Matrix3<f64> {
        let by_step = by_step(&self.room_from_wall, on_wall);
        by_step * self.covariance * by_step.transpose()
    }
}

/// Finds the pose.
///
/// # Errors
/// What is wrong, in words.
pub(super) fn fit(touches: &[Touch]) -> Result<WallPose, String> {
    let (room_from_wall, covariance) = adjusted(touches)?;
    let off = |pose: &Isometry3<f64>, it: &Touch| (pose * in_space(&it.on_wall) - it.in_room).norm();
    let (mut held_out, mut rest) = (Vec::new(), Vec::new());
    if touches.len() > LEAST_PLACES {
        for (number, left_out) in touches.iter().enumerate() {
            let others: Vec<Touch> =
                touches.iter().enumerate().filter(|it| it.0 != number).map(|it| it.1.clone()).collect();
            let (pose, _) = adjusted(&others).map_err(|why| format!("without place {}: {why}", number + 1))?;
            held_out.push(off(&pose, left_out));
            let squares: f64 = others.iter().map(|it| off(&pose, it).powi(2)).sum();
            rest.push((squares / others.len() as f64).sqrt());
        }
    }
    let misses = touches.iter().map(|it| off(&room_from_wall, it)).collect();
    let places = touches.iter().map(|it| it.on_wall).collect();
    Ok(WallPose { places, room_from_wall, covariance, misses, held_out, others: rest })
}

fn adjusted(touches: &[Touch]) -> Result<(Isometry3<f64>, Matrix6<f64>), String> {
    let on_wall: Vec<Point3<f64>> = touches.iter().map(|it| in_space(&it.on_wall)).collect();
    let in_room: Vec<Point3<f64>> = touches.iter().map(|it| it.in_room).collect();
    let start = align(&on_wall, &in_room, AlignmentOptions::default()).map_err(|error| match error {
        AlignmentError::Degenerate { count, .. } => {
            format!("{count} places lie on one line, expected places all over the wall")
        }
        other => other.to_string(),
    })?;
    let weights: Option<Vec<Matrix3<f64>>> =
        touches.iter().map(|it| it.covariance.cholesky()?.l().try_inverse()).collect();
    let weights = weights.ok_or("found no valid covariance of the light's position, expected one")?;
    let options = Options { loss: Loss::Squared, ..Options::default() };
    let solution =
        solve(&Sought { touches, weights }, start.b_from_a.isometry, &options).map_err(|_| NO_POSE.to_owned())?;
    let covariance = solution.covariance.map_err(|_| NO_POSE.to_owned())?;
    let factor = solution.variance_factor.max(1.0);
    Ok((solution.parameters, Matrix6::from_fn(|row, column| covariance[(row, column)] * factor)))
}

/// Derivative of a point of the wall in the room by a step of the pose.
fn by_step(room_from_wall: &Isometry3<f64>, on_wall: &Point2<f64>) -> SMatrix<f64, 3, 6> {
    let turn = room_from_wall.rotation.to_rotation_matrix();
    let mut by_step = SMatrix::<f64, 3, 6>::zeros();
    by_step.fixed_view_mut::<3, 3>(0, 0).copy_from(&(-turn.matrix() * in_space(on_wall).coords.cross_matrix()));
    by_step.fixed_view_mut::<3, 3>(0, 3).copy_from(turn.matrix());
    by_step
}

struct Sought<'a> {
    touches: &'a [Touch],
    /// Inverse square roots of the covariances.
    weights: Vec<Matrix3<f64>>,
}

impl Problem for Sought<'_> {
    type Parameters = Isometry3<f64>;

    fn dimension(&self) -> usize {
        6
    }

    fn moved(&self, from: &Isometry3<f64>, step: &DVector<f64>) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        from * Isometry3::from_parts(Translation3::new(step[3], step[4], step[5]), turn)
    }

    fn linearise(&self, at: &Isometry3<f64>, equations: &mut Equations) -> Option<()> {
        let columns: [usize; 6] = std::array::from_fn(|it| it);
        for (it, weight) in self.touches.iter().zip(&self.weights) {
            let off = at * in_space(&it.on_wall) - it.in_room;
            equations.add(&columns, &(weight * off), &(weight * by_step(at, &it.on_wall)));
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn derivative_is_that_of_a_step_on_the_right() {
        let problem = Sought { touches: &[], weights: Vec::new() };
        let pose = Isometry3::new(Vector3::new(0.4, -1.0, 2.0), Vector3::new(0.7, -0.3, 1.1));
        let on_wall = Point2::new(1.3, 0.6);
        let by_step = by_step(&pose, &on_wall);
        for axis in 0..6 {
            let mut step = DVector::zeros(6);
            step[axis] = 1e-6;
            let moved = problem.moved(&pose, &step) * in_space(&on_wall) - pose * in_space(&on_wall);
            assert!((moved / 1e-6 - by_step.column(axis)).norm() < 1e-5, "axis {axis}");
        }
    }
}
