//! Bundle adjustment over cameras and the poses of one rigid board: the poses under which all pixels together are most likely.
//!
//! As in [`foveate_geometry::bundle`], but what is eliminated from the normal equations is not points with three unknowns but poses with
//! six: they are the groups of [`foveate_estimation::least_squares::schur`]. The world is fixed by the caller, who holds the pose of
//! one board or of one camera.

use foveate_estimation::Loss;
use foveate_estimation::least_squares::schur::BlockSum;
use foveate_estimation::least_squares::{DriverOptions, GroupedEquations, GroupedProblem, solve_grouped};
use foveate_geometry::Camera;
use foveate_geometry::bundle::correlated::{Correlated, Group, Linear, place};
use foveate_geometry::bundle::{CLOCK, CameraCovariance, Freedom, NAMES, OpticsSigma, Posed, moved};
use nalgebra::{
    DVector, Isometry3, Matrix2x3, Matrix3, Matrix6, Point2, Point3, SMatrix, Translation3, UnitQuaternion, Vector2,
    Vector3, Vector6,
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
    /// By camera, if requested; the unobservable parameters if there are any.
    pub covariance: Option<Result<Vec<CameraCovariance>, Open>>,
    /// By camera: of the columns that [`NAMES`] lists, if requested and if all parameters are observable.
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

/// Cameras and boards.
#[derive(Clone)]
struct State {
    cameras: Vec<Camera>,
    boards: Vec<Isometry3<f64>>,
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
    let start = State { cameras: cameras.to_vec(), boards: boards.to_vec() };
    let RigidOptions { max_iterations, relative_gain, .. } = *options;
    let driver = DriverOptions { max_iterations, relative_gain, ..DriverOptions::default() };
    let found = solve_grouped(&Sought::<C> { layout: &layout }, start, options.loss, &driver).ok()?;
    let State { cameras, boards } = &found.parameters;
    let residuals =
        seen.iter().map(|it| Some(cameras[it.camera].project(&(boards[it.board] * it.place))? - it.pixel)).collect();
    let mut columns = Vec::new();
    let covariance = options.covariance.then(|| {
        let names = |open: &[usize]| {
            let name = |row: &usize| {
                let place = |(camera, rows): (usize, &[Option<usize>; CLOCK])| {
                    Some((camera, NAMES[rows.iter().position(|it| *it == Some(*row))?]))
                };
                layout.rows.iter().enumerate().find_map(place)
            };
            open.iter().filter_map(name).collect::<Vec<_>>()
        };
        let (mut whole, inverses) = found.covariance().map_err(|open| names(&open.parameters))?;
        if options.correlated {
            let equations = &found.equations;
            whole =
                correlated::<C>(&layout, equations, &inverses, cameras, boards, &options.loss).covariance(&whole, 0);
        }
        columns = layout
            .rows
            .iter()
            .map(|rows| Columns::from_fn(|i, j| rows[i].zip(rows[j]).map_or(0.0, |at| whole[at])))
            .collect();
        Ok(cameras.iter().zip(&columns).map(|(camera, block)| of_camera(camera, block)).collect())
    });
    let (cost, State { cameras, boards }) = (found.outcome.cost, found.parameters);
    Some(Rigid { cameras, world_from_board: boards, residuals, cost, covariance, columns })
}

/// All marks at the solution.
fn correlated<const C: usize>(
    layout: &Layout<'_>,
    equations: &GroupedEquations<6>,
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
        Group { stretch, seen: seen.collect(), inverse, gradient: equations.groups()[*board].gradient }
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

/// What is to be minimised, with camera blocks of width C.
struct Sought<'a, const C: usize> {
    layout: &'a Layout<'a>,
}

impl<const C: usize> Sought<'_, C> {
    fn rows(&self, camera: usize) -> [Option<usize>; C] {
        std::array::from_fn(|column| self.layout.rows[camera][column])
    }
}

impl<const C: usize> GroupedProblem<6> for Sought<'_, C> {
    type Parameters = State;

    fn dimension(&self) -> usize {
        self.layout.dimension
    }

    fn n_groups(&self) -> usize {
        self.layout.of_board.len()
    }

    fn moved(&self, from: &State, shared: &DVector<f64>, groups: &[Vector6<f64>]) -> State {
        let step = |camera: usize| self.rows(camera).map(|row| row.map_or(0.0, |it| shared[it]));
        let cameras = from.cameras.iter().enumerate().map(|(index, it)| moved(it, &step(index)));
        let boards = from.boards.iter().zip(groups).map(|(it, step)| board_moved(it, step));
        State { cameras: cameras.collect(), boards: boards.collect() }
    }

    fn linearise(&self, at: &State, equations: &mut GroupedEquations<6>) -> Option<()> {
        let (layout, loss) = (self.layout, equations.loss());
        let posed: Vec<Posed<'_>> = at.cameras.iter().map(Posed::new).collect();
        for camera_frame in &layout.camera_frames {
            let board = &at.boards[camera_frame.board];
            let mut sum = BlockSum::<C, 6>::zeros();
            for seen in camera_frame.seen.iter().map(|it| &layout.seen[*it]) {
                let (pixel, by_camera, by_point) =
                    posed[camera_frame.camera].linearise::<C, false>(&(board * seen.place))?;
                let mut by_board = by_board(&by_point, board, &seen.place);
                if layout.held_board == Some(camera_frame.board) {
                    by_board.fill(0.0);
                }
                let per_variance = 1.0 / (seen.sigma_px * seen.sigma_px);
                sum.add(&loss, &(pixel - seen.pixel.coords), (&by_camera, &by_board), per_variance);
            }
            equations.add_sum(&self.rows(camera_frame.camera), camera_frame.board, &sum);
        }
        Some(())
    }
}
