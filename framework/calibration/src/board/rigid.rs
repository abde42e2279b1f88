//! Bundle adjustment over cameras and the poses of one rigid board: the poses under which all pixels together are most likely.
//!
//! As in [`foveate_geometry::bundle`], but what is eliminated from the normal equations is not points with three unknowns but poses with
//! six: `of_board` is V, `between` W, and the reduced system U − W V⁻¹ Wᵀ has the unknowns of the cameras alone. The world is fixed
//! by the caller, who holds the pose of one board or of one camera.

use foveate_estimation::Loss;
use foveate_estimation::least_squares::invert_information;
use foveate_geometry::Camera;
use foveate_geometry::bundle::correlated::{Correlated, Group, Linear, place};
use foveate_geometry::bundle::{CLOCK, CameraCovariance, Freedom, NAMES, OpticsSigma, Posed, moved};
use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix2x3, Matrix3, Matrix6, Point2, Point3, SMatrix, SVector, Translation3,
    UnitQuaternion, Vector2, Vector3, Vector6,
};

use crate::stretches::stretches;

/// A mark of a board as a camera saw it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub camera: usize,
    pub board: usize,
    /// On the board [m].
    pub place: Point3<f64>,
    /// Raw [px].
    pub pixel: Point2<f64>,
    pub sigma_px: f64,
}

#[derive(Debug, Clone, Copy)]
pub(super) struct RigidOptions {
    pub loss: Loss,
    /// The board whose pose stays.
    pub held_board: Option<usize>,
    pub max_iterations: u32,
    pub relative_gain: f64,
    pub covariance: bool,
    /// Whether it states what residuals show, boards being in the order of their times, rather than that each mark errs by itself.
    pub correlated: bool,
}

impl Default for RigidOptions {
    fn default() -> Self {
        Self {
            loss: Loss::HUBER,
            held_board: None,
            max_iterations: 60,
            relative_gain: 1e-7,
            covariance: false,
            correlated: false,
        }
    }
}

/// Covariance of a camera's columns.
pub(super) type Columns = SMatrix<f64, CLOCK, CLOCK>;

/// Parameters that the observations leave open: camera and name.
pub(super) type Open = Vec<(usize, &'static str)>;

pub(super) struct Rigid {
    pub cameras: Vec<Camera>,
    pub world_from_board: Vec<Isometry3<f64>>,
    /// By observation: where the solution has it − where it was seen, `None` where the camera cannot see it [px].
    pub residuals: Vec<Option<Vector2<f64>>>,
    pub cost: f64,
    /// By camera, if asked for; the parameters that stay open otherwise.
    pub covariance: Option<Result<Vec<CameraCovariance>, Open>>,
    /// By camera: of the columns that [`NAMES`] lists, if asked for and nothing is open.
    pub columns: Vec<Columns>,
}

/// Adjusts what `freedoms` leaves free in `cameras`, and all boards but the held one; `None` when a mark that is seen at the start is
/// not finite, or nothing is.
pub(super) fn adjust(
    cameras: &[Camera],
    freedoms: &[Freedom],
    boards: &[Isometry3<f64>],
    seen: &[Seen],
    options: &RigidOptions,
) -> Option<Rigid> {
    match freedoms.iter().map(Freedom::width).max().unwrap_or(0) {
        0..=6 => run::<6>(cameras, freedoms, boards, seen, options),
        7..=9 => run::<9>(cameras, freedoms, boards, seen, options),
        _ => run::<15>(cameras, freedoms, boards, seen, options),
    }
}

/// One camera frame of a camera at a board: a range of observations.
struct CameraFrame {
    camera: usize,
    board: usize,
    seen: Vec<usize>,
}

struct Layout<'a> {
    seen: &'a [Seen],
    /// By board, in its order.
    camera_frames: Vec<CameraFrame>,
    of_board: Vec<std::ops::Range<usize>>,
    /// By camera and column: the row of the reduced system.
    rows: Vec<[Option<usize>; CLOCK]>,
    dimension: usize,
    held_board: Option<usize>,
}

struct Equations<const C: usize> {
    of_camera: Vec<SMatrix<f64, C, C>>,
    gradient_of_camera: Vec<SVector<f64, C>>,
    of_board: Vec<Matrix6<f64>>,
    gradient_of_board: Vec<Vector6<f64>>,
    /// By look.
    between: Vec<SMatrix<f64, C, 6>>,
    cost: f64,
}

fn run<const C: usize>(
    cameras: &[Camera],
    freedoms: &[Freedom],
    boards: &[Isometry3<f64>],
    seen: &[Seen],
    options: &RigidOptions,
) -> Option<Rigid> {
    let layout = lay_out(cameras, freedoms, boards, seen, options.held_board);
    if layout.camera_frames.is_empty() {
        return None;
    }
    let (mut cameras, mut boards) = (cameras.to_vec(), boards.to_vec());
    let mut here = Equations::<C>::at(&layout, &cameras, &boards, &options.loss)?;
    let (mut damping, mut growth) = (1e-4, 2.0);
    for _ in 0..options.max_iterations {
        let Some((step, of_boards)) = here.step(&layout, damping) else {
            damping *= growth;
            growth *= 2.0;
            if damping > 1e15 {
                break;
            }
            continue;
        };
        let next_cameras: Vec<Camera> = cameras
            .iter()
            .enumerate()
            .map(|(it, camera)| moved(camera, block::<C>(&layout, it, &step).as_slice()))
            .collect();
        let next_boards: Vec<Isometry3<f64>> =
            boards.iter().zip(&of_boards).map(|(board, step)| board_moved(board, step)).collect();
        let predicted_reduction = here.predicted_reduction(&layout, &step, &of_boards);
        let there = Equations::<C>::at(&layout, &next_cameras, &next_boards, &options.loss);
        let small = predicted_reduction <= options.relative_gain * here.cost.max(f64::MIN_POSITIVE);
        match there {
            Some(there) if there.cost <= here.cost => {
                let gain = (here.cost - there.cost) / predicted_reduction.max(f64::MIN_POSITIVE);
                damping = (damping * (1.0 - (2.0 * gain.min(1.5) - 1.0).powi(3)).max(1.0 / 3.0)).max(1e-15);
                growth = 2.0;
                (cameras, boards, here) = (next_cameras, next_boards, there);
            }
            _ => {
                damping = damping.max(1e-10) * growth;
                growth *= 2.0;
            }
        }
        if small {
            break;
        }
        if damping > 1e15 {
            break;
        }
    }
    let residuals =
        seen.iter().map(|it| Some(cameras[it.camera].project(&(boards[it.board] * it.place))? - it.pixel)).collect();
    let mut columns = Vec::new();
    let covariance = options.covariance.then(|| {
        let (information, _, inverses) = here.reduced(&layout, 0.0);
        let names = |open: &[usize]| {
            let name = |row: &usize| {
                let place = |(camera, rows): (usize, &[Option<usize>; CLOCK])| {
                    Some((camera, NAMES[rows.iter().position(|it| *it == Some(*row))?]))
                };
                layout.rows.iter().enumerate().find_map(place)
            };
            open.iter().filter_map(name).collect::<Vec<_>>()
        };
        let whole = if layout.dimension == 0 { Ok(DMatrix::zeros(0, 0)) } else { invert_information(&information) };
        let mut whole = whole.map_err(|open| names(&open))?;
        if options.correlated {
            whole = correlated(&layout, &here, &inverses, &cameras, &boards, &options.loss).covariance(&whole, 0);
        }
        columns = layout
            .rows
            .iter()
            .map(|rows| Columns::from_fn(|i, j| rows[i].zip(rows[j]).map_or(0.0, |at| whole[at])))
            .collect();
        Ok(cameras.iter().zip(&columns).map(|(camera, block)| of_camera(camera, block)).collect())
    });
    Some(Rigid { cameras, world_from_board: boards, residuals, cost: here.cost, covariance, columns })
}

/// All marks at the solution.
fn correlated<const C: usize>(
    layout: &Layout<'_>,
    equations: &Equations<C>,
    inverses: &[Matrix6<f64>],
    cameras: &[Camera],
    boards: &[Isometry3<f64>],
    loss: &Loss,
) -> Correlated<C> {
    let posed: Vec<Posed<'_>> = cameras.iter().map(Posed::new).collect();
    let seeing: Vec<usize> = (0..boards.len()).filter(|it| !layout.of_board[*it].is_empty()).collect();
    let linear = |camera_frame: &CameraFrame, seen: &Seen| {
        let (pixel, by_camera, by_point) =
            posed[camera_frame.camera].linearise::<C, false>(&(boards[camera_frame.board] * seen.place))?;
        let error = pixel - seen.pixel.coords;
        let per_variance = seen.sigma_px.powi(-2);
        let weight = loss.at(error.norm_squared() * per_variance).1 * per_variance;
        let mut by_unknown = by_board(&by_point, &boards[camera_frame.board], &seen.place);
        if layout.held_board == Some(camera_frame.board) {
            by_unknown.fill(0.0);
        }
        let place = place(&seen.pixel, cameras[camera_frame.camera].image_size);
        Some(Linear { camera: camera_frame.camera, weight, by_camera, by_unknown, error, place })
    };
    let group = |(board, stretch): (&usize, usize)| {
        let camera_frames = &layout.camera_frames[layout.of_board[*board].clone()];
        let seen = camera_frames
            .iter()
            .flat_map(|camera_frame| camera_frame.seen.iter().filter_map(|it| linear(camera_frame, &layout.seen[*it])));
        let is_held = layout.held_board == Some(*board);
        let inverse = if is_held { Matrix6::zeros() } else { inverses[*board] };
        Group { stretch, seen: seen.collect(), inverse, gradient: equations.gradient_of_board[*board] }
    };
    let groups = seeing.iter().zip(stretches(&seeing)).map(group).collect();
    let rows = layout.rows.iter().map(|rows| std::array::from_fn(|column| rows[column])).collect();
    Correlated { groups, rows, dimension: layout.dimension, known: Vec::new() }
}

/// A pixel by a step of the board: B exp(δ) p = B (p + ω × p + v).
fn by_board(by_point: &Matrix2x3<f64>, world_from_board: &Isometry3<f64>, place: &Point3<f64>) -> SMatrix<f64, 2, 6> {
    let by_place = by_point * world_from_board.rotation.to_rotation_matrix().matrix();
    let mut by_board = SMatrix::<f64, 2, 6>::zeros();
    by_board.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_place * -place.coords.cross_matrix()));
    by_board.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_place);
    by_board
}

fn of_camera(camera: &Camera, block: &Columns) -> CameraCovariance {
    let pose: Matrix6<f64> = block.fixed_view::<6, 6>(0, 0).into_owned();
    // The centre c of T exp(δ) moves by c × ω − v.
    let mut by_pose = SMatrix::<f64, 3, 6>::zeros();
    by_pose.fixed_view_mut::<3, 3>(0, 0).copy_from(&camera.centre().coords.cross_matrix());
    by_pose.fixed_view_mut::<3, 3>(0, 3).copy_from(&-Matrix3::identity());
    let optics = OpticsSigma::of(|column| block[(column, column)].max(0.0).sqrt());
    CameraCovariance { pose, centre: by_pose * pose * by_pose.transpose(), optics }
}

fn board_moved(board: &Isometry3<f64>, step: &Vector6<f64>) -> Isometry3<f64> {
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
    let mut moved = board * Isometry3::from_parts(Translation3::new(step[3], step[4], step[5]), turn);
    moved.rotation.renormalize_fast();
    moved
}

fn block<const C: usize>(layout: &Layout<'_>, camera: usize, step: &DVector<f64>) -> SVector<f64, C> {
    SVector::from_fn(|column, _| layout.rows[camera][column].map_or(0.0, |row| step[row]))
}

fn lay_out<'a>(
    cameras: &[Camera],
    freedoms: &[Freedom],
    boards: &[Isometry3<f64>],
    seen: &'a [Seen],
    held_board: Option<usize>,
) -> Layout<'a> {
    let mut by_frame: std::collections::BTreeMap<(usize, usize), Vec<usize>> = std::collections::BTreeMap::new();
    for (index, it) in seen.iter().enumerate() {
        // Marks that are out of view at the start have no derivative to lead them back.
        if cameras[it.camera].project(&(boards[it.board] * it.place)).is_some() {
            by_frame.entry((it.board, it.camera)).or_default().push(index);
        }
    }
    let camera_frames: Vec<CameraFrame> =
        by_frame.into_iter().map(|((board, camera), seen)| CameraFrame { camera, board, seen }).collect();
    let mut of_board = vec![0..0; boards.len()];
    for (index, camera_frame) in camera_frames.iter().enumerate() {
        let range = &mut of_board[camera_frame.board];
        *range = if range.start == range.end { index..index + 1 } else { range.start..index + 1 };
    }
    let mut dimension = 0;
    let mut rows = vec![[None; CLOCK]; cameras.len()];
    for (camera, freedom) in freedoms.iter().enumerate() {
        if camera_frames.iter().any(|it| it.camera == camera) {
            for (column, free) in freedom.mask().into_iter().enumerate() {
                rows[camera][column] = free.then(|| {
                    dimension += 1;
                    dimension - 1
                });
            }
        }
    }
    Layout { seen, camera_frames, of_board, rows, dimension, held_board }
}

impl<const C: usize> Equations<C> {
    fn at(layout: &Layout<'_>, cameras: &[Camera], boards: &[Isometry3<f64>], loss: &Loss) -> Option<Self> {
        let mut new = Self {
            of_camera: vec![SMatrix::zeros(); cameras.len()],
            gradient_of_camera: vec![SVector::zeros(); cameras.len()],
            of_board: vec![Matrix6::zeros(); boards.len()],
            gradient_of_board: vec![Vector6::zeros(); boards.len()],
            between: vec![SMatrix::zeros(); layout.camera_frames.len()],
            cost: 0.0,
        };
        let posed: Vec<Posed<'_>> = cameras.iter().map(Posed::new).collect();
        for (camera_frame, between) in layout.camera_frames.iter().zip(&mut new.between) {
            for seen in camera_frame.seen.iter().map(|it| &layout.seen[*it]) {
                let (pixel, by_camera, by_point) =
                    posed[camera_frame.camera].linearise::<C, false>(&(boards[camera_frame.board] * seen.place))?;
                let per_variance = 1.0 / (seen.sigma_px * seen.sigma_px);
                let error = pixel - seen.pixel.coords;
                let (cost, weight) = loss.at(error.norm_squared() * per_variance);
                new.cost += 0.5 * cost;
                let weight = weight * per_variance;
                let by_board = by_board(&by_point, &boards[camera_frame.board], &seen.place);
                let weighted = by_camera * weight;
                new.of_camera[camera_frame.camera] += by_camera.tr_mul(&weighted);
                new.gradient_of_camera[camera_frame.camera] += weighted.tr_mul(&error);
                if layout.held_board != Some(camera_frame.board) {
                    new.of_board[camera_frame.board] += by_board.tr_mul(&(by_board * weight));
                    new.gradient_of_board[camera_frame.board] += by_board.tr_mul(&error) * weight;
                    *between += weighted.tr_mul(&by_board);
                }
            }
        }
        new.cost.is_finite().then_some(new)
    }

    /// Information and gradient of the cameras when boards follow, and the inverses by board.
    fn reduced(&self, layout: &Layout<'_>, damping: f64) -> (DMatrix<f64>, DVector<f64>, Vec<Matrix6<f64>>) {
        let mut information = DMatrix::zeros(layout.dimension, layout.dimension);
        let mut gradient = DVector::zeros(layout.dimension);
        let mut add = |a: usize, b: usize, block: &SMatrix<f64, C, C>| {
            for (i, row) in layout.rows[a].iter().take(C).enumerate() {
                for (j, column) in layout.rows[b].iter().take(C).enumerate() {
                    if let (Some(row), Some(column)) = (row, column) {
                        information[(*row, *column)] += block[(i, j)];
                    }
                }
            }
        };
        let mut raise = |a: usize, part: &SVector<f64, C>| {
            for (i, row) in layout.rows[a].iter().take(C).enumerate() {
                if let Some(row) = row {
                    gradient[*row] += part[i];
                }
            }
        };
        for (camera, block) in self.of_camera.iter().enumerate() {
            let mut damped = *block;
            (0..C).for_each(|it| damped[(it, it)] *= 1.0 + damping);
            add(camera, camera, &damped);
            raise(camera, &self.gradient_of_camera[camera]);
        }
        let mut inverses = vec![Matrix6::zeros(); self.of_board.len()];
        for (board, range) in layout.of_board.iter().enumerate() {
            let mut damped = self.of_board[board];
            (0..6).for_each(|it| damped[(it, it)] *= 1.0 + damping);
            let Some(factor) = damped.cholesky() else { continue };
            inverses[board] = factor.inverse();
            for high in range.clone() {
                let led_back = self.between[high] * inverses[board];
                raise(layout.camera_frames[high].camera, &-(led_back * self.gradient_of_board[board]));
                for low in range.clone() {
                    add(
                        layout.camera_frames[high].camera,
                        layout.camera_frames[low].camera,
                        &-(led_back * self.between[low].transpose()),
                    );
                }
            }
        }
        (information, gradient, inverses)
    }

    fn step(&self, layout: &Layout<'_>, damping: f64) -> Option<(DVector<f64>, Vec<Vector6<f64>>)> {
        let (information, gradient, inverses) = self.reduced(layout, damping);
        let step = if layout.dimension == 0 { gradient } else { information.cholesky()?.solve(&-gradient) };
        let mut of_boards: Vec<Vector6<f64>> = self.gradient_of_board.clone();
        for (camera_frame, between) in layout.camera_frames.iter().zip(&self.between) {
            of_boards[camera_frame.board] += between.tr_mul(&block::<C>(layout, camera_frame.camera, &step));
        }
        for (of_board, inverse) in of_boards.iter_mut().zip(&inverses) {
            *of_board = -(inverse * *of_board);
        }
        let finite = step.iter().all(|it| it.is_finite()) && of_boards.iter().flatten().all(|it| it.is_finite());
        finite.then_some((step, of_boards))
    }

    /// By how much the equations say that a step lowers the cost.
    fn predicted_reduction(&self, layout: &Layout<'_>, step: &DVector<f64>, of_boards: &[Vector6<f64>]) -> f64 {
        let mut predicted_reduction = 0.0;
        for camera in 0..self.of_camera.len() {
            let own = block::<C>(layout, camera, step);
            predicted_reduction -=
                self.gradient_of_camera[camera].dot(&own) + 0.5 * own.dot(&(self.of_camera[camera] * own));
        }
        for (board, own) in of_boards.iter().enumerate() {
            predicted_reduction -=
                self.gradient_of_board[board].dot(own) + 0.5 * own.dot(&(self.of_board[board] * own));
        }
        for (camera_frame, between) in layout.camera_frames.iter().zip(&self.between) {
            predicted_reduction -=
                block::<C>(layout, camera_frame.camera, step).dot(&(between * of_boards[camera_frame.board]));
        }
        predicted_reduction
    }
}
