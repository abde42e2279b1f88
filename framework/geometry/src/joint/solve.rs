//! The normal equations of points and poses together, and what is uncertain after them.

use nalgebra::{Cholesky, DMatrix, DVector, Matrix2x3, Matrix3, Matrix6, Matrix6x3, Point3, Vector3, Vector6};

use super::{FLATTEST, Search};

/// By camera Hcc and gc, by point Hpp and gp, by observation Hcp.
pub(super) struct Equations {
    camera: Vec<(Matrix6<f64>, Vector6<f64>)>,
    point: Vec<(Matrix3<f64>, Vector3<f64>)>,
    /// JointObservation, its block.
    mixed: Vec<(usize, Matrix6x3<f64>)>,
}

impl Equations {
    /// At the place where the search is; `bend` of Huber's loss in standard deviations.
    pub(super) fn of(search: &Search<'_>, bend: f64) -> Equations {
        let mut camera: Vec<_> =
            search.priors.iter().zip(&search.offsets).map(|(prior, offset)| (*prior, -(prior * offset))).collect();
        let mut point = vec![(Matrix3::zeros(), Vector3::zeros()); search.positions.len()];
        let mut mixed = Vec::with_capacity(search.observations.len());
        for (index, observation) in search.observations.iter().enumerate() {
            let Some(position) = search.positions[observation.point].filter(|_| search.in_use[index]) else { continue };
            let view = &search.cameras[observation.viewpoint];
            let Some((expected, by_point)) = view.project_with_jacobian(&position) else { continue };
            let whitening = search.whitening[index];
            let residual = whitening * (observation.pixel - expected);
            let by_point: Matrix2x3<f64> = whitening * by_point;
            // A turn ω about the centre moves the point by ω × (p − c), a shift by itself.
            let arm = position - search.centres[observation.viewpoint];
            let mut by_pose = nalgebra::Matrix2x6::zeros();
            by_pose.fixed_columns_mut::<3>(0).copy_from(&(by_point * -arm.cross_matrix()));
            by_pose.fixed_columns_mut::<3>(3).copy_from(&by_point);
            let norm = residual.norm();
            let weight = if norm > bend { bend / norm } else { 1.0 };
            let (information, gradient) = &mut point[observation.point];
            *information += by_point.transpose() * by_point * weight;
            *gradient += by_point.transpose() * residual * weight;
            let (information, gradient) = &mut camera[observation.viewpoint];
            *information += by_pose.transpose() * by_pose * weight;
            *gradient += by_pose.transpose() * residual * weight;
            mixed.push((index, by_pose.transpose() * by_point * weight));
        }
        Equations { camera, point, mixed }
    }

    /// Inverse information of each point by itself; `None` for points whose place is not fixed.
    fn point_inverses(&self) -> Vec<Option<Matrix3<f64>>> {
        let inverse = |(information, _): &(Matrix3<f64>, Vector3<f64>)| {
            let size = information.trace();
            let solid = information.determinant() > FLATTEST * size.powi(3) / 27.0;
            if solid { information.try_inverse() } else { None }
        };
        self.point.iter().map(inverse).collect()
    }

    /// Information and gradient of the poses with the points eliminated.
    fn reduced(&self, search: &Search<'_>, inverses: &[Option<Matrix3<f64>>]) -> (DMatrix<f64>, DVector<f64>) {
        let size = 6 * self.camera.len();
        let (mut information, mut gradient) = (DMatrix::zeros(size, size), DVector::zeros(size));
        for (viewpoint, (block, right)) in self.camera.iter().enumerate() {
            information.fixed_view_mut::<6, 6>(6 * viewpoint, 6 * viewpoint).copy_from(block);
            gradient.fixed_rows_mut::<6>(6 * viewpoint).copy_from(right);
        }
        let mut of_point: Vec<Vec<usize>> = vec![Vec::new(); self.point.len()];
        for (place, (index, _)) in self.mixed.iter().enumerate() {
            of_point[search.observations[*index].point].push(place);
        }
        for (point, places) in of_point.iter().enumerate() {
            let Some(inverse) = inverses[point] else { continue };
            for a in places {
                let (observation, block) = &self.mixed[*a];
                let row = 6 * search.observations[*observation].viewpoint;
                let part = block * inverse;
                let mut right = gradient.fixed_rows_mut::<6>(row);
                right -= part * self.point[point].1;
                for b in places {
                    let (other, other_block) = &self.mixed[*b];
                    let column = 6 * search.observations[*other].viewpoint;
                    let mut cell = information.fixed_view_mut::<6, 6>(row, column);
                    cell -= part * other_block.transpose();
                }
            }
        }
        (information, gradient)
    }

    /// Steps of the poses, and moves of the points with their information; `None` where the equations are singular.
    #[expect(clippy::type_complexity, reason = "two lists that one caller takes apart at once")]
    pub(super) fn solve(&self, search: &Search<'_>) -> Option<(Vec<Vector6<f64>>, Vec<(Vector3<f64>, Matrix3<f64>)>)> {
        let inverses = self.point_inverses();
        let mut steps = vec![Vector6::zeros(); self.camera.len()];
        if search.options.estimate_poses {
            let (information, gradient) = self.reduced(search, &inverses);
            let solved = Cholesky::new(information)?.solve(&gradient);
            for (viewpoint, step) in steps.iter_mut().enumerate() {
                step.copy_from(&solved.fixed_rows::<6>(6 * viewpoint));
            }
        }
        let mut rights: Vec<Vector3<f64>> = self.point.iter().map(|it| it.1).collect();
        for (index, block) in &self.mixed {
            let observation = &search.observations[*index];
            rights[observation.point] -= block.transpose() * steps[observation.viewpoint];
        }
        let moves = inverses.iter().zip(&rights).zip(&self.point).map(|((inverse, right), (information, _))| {
            // A point whose place is not fixed is taken out by the move that is no number.
            (inverse.map_or(Vector3::repeat(f64::NAN), |it| it * right), *information)
        });
        Some((steps, moves.collect()))
    }

    /// Covariance of all ε together; `None` where the poses have no errors or the equations are singular.
    pub(super) fn poses_covariance(&self, search: &Search<'_>) -> Option<DMatrix<f64>> {
        let (information, _) = self.reduced(search, &self.point_inverses());
        Cholesky::new(information).filter(|_| search.options.estimate_poses).map(|it| it.inverse())
    }
}

/// What is uncertain of the whole and of each point beside it.
pub(super) struct Parts {
    pub whole: Matrix6<f64>,
    pub points: Vec<Option<Matrix3<f64>>>,
}

/// A change of the poses moves all points; the rigid motion that comes closest to that belongs to the whole, the rest to the points.
pub(super) fn rigid_parts(
    search: &Search<'_>,
    equations: &Equations,
    poses: &DMatrix<f64>,
    middle: &Point3<f64>,
) -> Parts {
    let inverses = equations.point_inverses();
    let known = |point: usize| search.positions[point].zip(inverses[point]);
    if poses.is_empty() {
        let points = (0..inverses.len()).map(|point| known(point).map(|it| it.1)).collect();
        return Parts { whole: Matrix6::zeros(), points };
    }
    let size = poses.nrows();
    // How each point follows ε: −Hpp⁻¹ Hcpᵀ, since the observations hold it where it is in the pictures.
    let mut follows = vec![DMatrix::<f64>::zeros(3, size); inverses.len()];
    for (index, block) in &equations.mixed {
        let observation = &search.observations[*index];
        if let Some(inverse) = inverses[observation.point] {
            let mut part = follows[observation.point].fixed_columns_mut::<6>(6 * observation.viewpoint);
            part -= inverse * block.transpose();
        }
    }
    let rigid = |position: &Point3<f64>| {
        let mut by_whole = nalgebra::Matrix3x6::zeros();
        by_whole.fixed_columns_mut::<3>(0).copy_from(&-(position - middle).cross_matrix());
        by_whole.fixed_columns_mut::<3>(3).fill_with_identity();
        by_whole
    };
    let (mut normal, mut right) = (Matrix6::zeros(), DMatrix::zeros(6, size));
    for (point, follow) in follows.iter().enumerate() {
        if let Some((position, _)) = known(point) {
            let by_whole = rigid(&position);
            normal += by_whole.transpose() * by_whole;
            right += by_whole.transpose() * follow;
        }
    }
    // Fewer than three points, or points on a line: what a turn would do belongs to the points.
    let scale = normal.trace() / 6.0;
    let solve = (normal + Matrix6::identity() * (scale * 1e-9)).try_inverse().unwrap_or_else(Matrix6::zeros);
    let whole = solve * right;
    let covariance = &whole * poses * whole.transpose();
    let points = follows.iter().enumerate().map(|(point, follow)| {
        let (position, inverse) = known(point)?;
        let rest = follow - rigid(&position) * &whole;
        let by_poses = &rest * poses * rest.transpose();
        Some(inverse + Matrix3::from_fn(|row, column| by_poses[(row, column)]))
    });
    let points = points.collect();
    Parts { whole: Matrix6::from_fn(|row, column| covariance[(row, column)]), points }
}
