//! From pictures of a board to a solved camera network.

mod hold_out;
mod stretch;

use std::collections::BTreeMap;

use foveate_estimation::Loss;
use foveate_estimation::statistics::median;
use foveate_geometry::Camera;
use foveate_geometry::bundle::{CameraCovariance, Freedom, Optic};
use foveate_geometry::self_calibration::CameraStatus;
use foveate_scene::uncertainty::Fixed;
use nalgebra::{Isometry3, Vector2};

use super::groups::{self, CameraFrame, turned_place};
use super::optics::{self, View};
use super::pattern::Board;
use super::plane;
use super::rigid::{self, Rigid, RigidOptions, Seen};
use super::types::{BoardError, BoardOptions, BoardPose, BoardSolution, HoldOut, OpticsFit, OpticsRefusal};
use super::views::{check, frames, gather};
use crate::recording::Recording;
use crate::solved::{FixedFreedoms, ObservationRole, Solved, SolvedCamera, SolvedObservation, SolvedPoint, Step};

/// All views together contradict a camera's own when its focal length is further from these than this [standard deviations].
const CONTRADICTION: f64 = 3.5;

/// Calibrates all cameras that see `board`, together or in a chain: their optics as far as they are free, and their poses in metres.
///
/// Spots carry the number of their mark as `label`; the result counts unusable spots and gives the status of each camera. One
/// camera alone works too: its optics, and its pose relative to the board.
///
/// ```
/// use foveate_calibration::board::{Board, BoardOptions, calibrate};
/// use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
/// use foveate_geometry::{Camera, bundle::Freedom};
/// use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
///
/// // A camera with a focal length of 610 px sees a board at twelve tilts.
/// let camera = |focal| Camera::look_at(Point3::new(0.0, -1.2, 0.1), Point3::origin(), [640, 480], focal);
/// let (truth, board) = (camera(610.0), Board::chessboard(8, 5, 0.04)?);
/// let facing = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
/// let camera_frames = (0..12).map(|frame| {
///     let angle = 0.5 * f64::from(frame);
///     let tilt = UnitQuaternion::from_euler_angles(0.5 * angle.sin(), 0.5 * angle.cos(), 0.1 * angle);
///     let world_from_board = Isometry3::from_parts(Translation3::identity(), facing * tilt) * Translation3::new(-0.14, 0.08, 0.0);
///     let spot = |(id, place): (u32, Point3<f64>)| {
///         let pixel = truth.sees(&(world_from_board * place))?;
///         Some(Spot { pixel, sigma_px: 0.1, peak: 1.0, label: Some(id) })
///     };
///     CameraFrame { camera: 0, time_s: f64::from(frame), spots: board.marks().filter_map(spot).collect() }
/// });
/// let guess = CameraGuess { name: "cam".into(), camera: camera(800.0), free: Freedom { focal: true, ..Freedom::POSE } };
/// let recording = Recording { cameras: vec![guess], camera_frames: camera_frames.collect() };
///
/// let found = calibrate(&recording, &board, &BoardOptions::default())?;
/// let focal_px = found.solved.cameras[0].camera.intrinsics.focal[0];
/// assert!((focal_px - 610.0).abs() < 0.5, "{focal_px}");
/// # Ok::<(), foveate_calibration::board::BoardError>(())
/// ```
///
/// # Errors
/// See [`BoardError`].
pub fn calibrate(recording: &Recording, board: &Board, options: &BoardOptions) -> Result<BoardSolution, BoardError> {
    check(recording, options)?;
    let (camera_frames, views, unusable_spots, misfit_views) = gather(recording, board, options)?;
    let mut optics: Vec<OpticsFit> = (0..recording.cameras.len())
        .map(|camera| {
            let guess = &recording.cameras[camera];
            let own: Vec<&View> = camera_frames
                .iter()
                .zip(&views)
                .filter(|(camera_frame, _)| camera_frame.camera == camera)
                .map(|it| it.1)
                .collect();
            optics::fit(&guess.camera, guess.free, &own, options)
        })
        .collect();
    loop {
        let mut solution = solve(recording, camera_frames.clone(), &optics, board, options)?;
        // Cameras whose clocks differ see a moving board in other places than it was: their optics must not make up for that.
        let cameras = optics.iter().zip(&solution.solved.cameras).map(|(fit, camera)| contradiction(fit, camera));
        let worst = cameras.enumerate().max_by(|a, b| a.1.total_cmp(&b.1)).filter(|it| it.1 > CONTRADICTION);
        if let Some((camera, _)) = worst {
            optics[camera].contradicted = true;
            continue;
        }
        (solution.unusable_spots, solution.misfit_views) = (unusable_spots, misfit_views);
        return Ok(solution);
    }
}

/// How far the focal length of all views together is from that of the camera's own, in standard deviations of the latter; 0 where there is
/// nothing to compare.
fn contradiction(fit: &OpticsFit, camera: &SolvedCamera) -> f64 {
    let own = fit.camera.intrinsics.focal[0];
    let is_compared = camera.status == CameraStatus::Calibrated && camera.freed.focal && !fit.contradicted;
    if is_compared { (camera.camera.intrinsics.focal[0] / own).ln().abs() / fit.sigma.focal.max(1e-9) } else { 0.0 }
}

/// Places cameras and boards with the optics as each camera's own views tell them, and adjusts all together.
fn solve(
    recording: &Recording,
    mut camera_frames: Vec<CameraFrame>,
    optics: &[OpticsFit],
    board: &Board,
    options: &BoardOptions,
) -> Result<BoardSolution, BoardError> {
    let n_cameras = recording.cameras.len();
    let mut cameras: Vec<Camera> = optics.iter().map(|it| it.camera.clone()).collect();
    let views = |camera: usize| camera_frames.iter().filter(|it| it.camera == camera).count();
    let most_views = (0..n_cameras).map(views).max().unwrap_or(0);
    let is_sought = recording.cameras.iter().any(|it| it.free != Freedom::POSE);
    let tilts = optics.iter().flat_map(|it| &it.refused).filter_map(|it| match it.why {
        OpticsRefusal::ViewsParallel { tilt_rad, .. } => Some(tilt_rad),
        _ => None,
    });
    let tilt_rad = tilts.reduce(f64::max);
    let no_pose = || {
        let board = board.name.clone();
        match tilt_rad {
            _ if most_views < options.min_views && is_sought => {
                BoardError::TooFewViews { board, views: most_views, needed: options.min_views }
            }
            Some(tilt_rad) => BoardError::NeverTilted { board, tilt_rad },
            None => BoardError::NoPose { board },
        }
    };
    for camera_frame in &mut camera_frames {
        camera_frame.poses = plane::poses(
            &cameras[camera_frame.camera],
            &camera_frame.places,
            &camera_frame.pixels,
            options.inlier_px.max(6.0),
        );
        camera_frame.poses.retain(|it| it.right > 0.5);
    }
    let mut status: Vec<CameraStatus> =
        (0..n_cameras).map(|it| alone(it, recording, &camera_frames, &optics[it], options)).collect();
    camera_frames.retain(|it| !it.poses.is_empty() && status[it.camera] == CameraStatus::Calibrated);
    if camera_frames.is_empty() {
        return Err(no_pose());
    }
    let guesses: Vec<Camera> = recording.cameras.iter().map(|it| it.camera.clone()).collect();
    let paired = pairs(&cameras, &camera_frames, board, options.poses_guessed.then_some(&guesses), options);
    let usable: Vec<bool> = status.iter().map(|it| *it == CameraStatus::Calibrated).collect();
    let groups = groups::groups(n_cameras, &paired, &usable);
    let Some(group) = groups.first() else { return Err(no_pose()) };
    for (camera, pose) in &group.members {
        cameras[*camera].camera_from_world = *pose;
    }
    let placed: Vec<bool> = (0..n_cameras).map(|it| group.members.iter().any(|member| member.0 == it)).collect();
    for other in &groups[1..] {
        for &(camera, _) in &other.members {
            let best =
                paired.iter().filter(|it| it.link.a == camera || it.link.b == camera).max_by_key(|it| it.link.common);
            let partner = best.map(|it| it.link.a + it.link.b - camera);
            status[camera] = match best {
                _ if other.members.len() > 1 => {
                    CameraStatus::Separate { group: other.members.iter().map(|it| it.0).collect() }
                }
                Some(pair) => CameraStatus::Inconsistent {
                    best: partner.unwrap_or(camera),
                    common: pair.link.common,
                    right: pair.link.right,
                },
                None => CameraStatus::NoPartner { best: None, common: 0, needed: 1 },
            };
        }
    }
    let mut network = Room::new(cameras, placed, camera_frames, optics, board, options);
    network.solve();
    let stretch = network.stretch(&recording.cameras.iter().map(|it| &it.camera).collect::<Vec<_>>());
    let mut solution = network.into_solution(recording, optics.to_vec(), status);
    solution.solved.links = paired.into_iter().map(|it| it.link).collect();
    solution.ambiguous = group.open.clone();
    solution.ambiguous.sort_unstable();
    solution.ambiguous.dedup();
    solution.stretch = stretch;
    Ok(solution)
}

/// What can be said of a camera by its own pictures.
fn alone(
    camera: usize,
    recording: &Recording,
    camera_frames: &[CameraFrame],
    fit: &OpticsFit,
    options: &BoardOptions,
) -> CameraStatus {
    let own: Vec<&CameraFrame> = camera_frames.iter().filter(|it| it.camera == camera).collect();
    let posed = own.iter().filter(|it| !it.poses.is_empty()).count();
    let asked = recording.cameras[camera].free.focal && options.focal_guessed;
    match fit.refused.iter().find(|it| it.what == Optic::Focal).filter(|_| asked).map(|it| it.why) {
        _ if own.is_empty() => CameraStatus::TooFewObservations { frames: 0, needed: 1 },
        Some(OpticsRefusal::TooFewViews { views, needed }) => {
            CameraStatus::TooFewObservations { frames: views, needed }
        }
        Some(OpticsRefusal::Uncertain { sigma, .. }) => CameraStatus::FocalOpen { sigma },
        Some(_) => CameraStatus::FocalOpen { sigma: f64::INFINITY },
        None if 2 * posed < own.len().min(options.min_views) || posed == 0 => {
            CameraStatus::Inconsistent { best: camera, common: own.len(), right: posed }
        }
        None => CameraStatus::Calibrated,
    }
}

fn pairs(
    cameras: &[Camera],
    camera_frames: &[CameraFrame],
    board: &Board,
    guess: Option<&Vec<Camera>>,
    options: &BoardOptions,
) -> Vec<groups::Paired> {
    let mut by_camera: Vec<BTreeMap<usize, &CameraFrame>> = vec![BTreeMap::new(); cameras.len()];
    for camera_frame in camera_frames {
        by_camera[camera_frame.camera].insert(camera_frame.frame, camera_frame);
    }
    let mut found = Vec::new();
    for a in 0..cameras.len() {
        for b in a + 1..cameras.len() {
            let common: Vec<(&CameraFrame, &CameraFrame)> =
                by_camera[a].iter().filter_map(|(frame, of_a)| Some((*of_a, *by_camera[b].get(frame)?))).collect();
            if !common.is_empty() {
                found.extend(groups::pair(cameras, a, b, &common, board, guess.map(Vec::as_slice), options));
            }
        }
    }
    found
}

/// Cameras, board poses and looks on their way to the solution.
struct Room<'a> {
    cameras: Vec<Camera>,
    placed: Vec<bool>,
    freedoms: Vec<Freedom>,
    camera_frames: Vec<CameraFrame>,
    /// By look and mark.
    roles: Vec<Vec<ObservationRole>>,
    residuals: Vec<Vec<Option<Vector2<f64>>>>,
    /// By frame.
    boards: BTreeMap<usize, Isometry3<f64>>,
    covariance: Vec<Option<CameraCovariance>>,
    origin: usize,
    hold_out: Option<HoldOut>,
    steps: Vec<Step>,
    board: &'a Board,
    options: &'a BoardOptions,
    sigma_factor: f64,
}

impl<'a> Room<'a> {
    fn new(
        cameras: Vec<Camera>,
        placed: Vec<bool>,
        camera_frames: Vec<CameraFrame>,
        optics: &[OpticsFit],
        board: &'a Board,
        options: &'a BoardOptions,
    ) -> Room<'a> {
        let freedoms = optics
            .iter()
            .zip(&placed)
            .map(|(fit, placed)| match placed {
                true if fit.contradicted => Freedom::POSE,
                true => Freedom { pose: true, ..fit.freed },
                false => Freedom::NONE,
            })
            .collect();
        let roles = camera_frames
            .iter()
            .map(|it| {
                vec![if placed[it.camera] { ObservationRole::Used } else { ObservationRole::Unsolved }; it.ids.len()]
            })
            .collect();
        let residuals = camera_frames.iter().map(|it| vec![None; it.ids.len()]).collect();
        let covariance = vec![None; cameras.len()];
        Room {
            cameras,
            placed,
            freedoms,
            camera_frames,
            roles,
            residuals,
            boards: BTreeMap::new(),
            covariance,
            origin: 0,
            hold_out: None,
            steps: Vec::new(),
            board,
            options,
            sigma_factor: 1.0,
        }
    }

    fn solve(&mut self) {
        self.place_boards();
        self.choose_origin();
        self.keep_back();
        self.move_to_origin();
        let rough =
            RigidOptions { loss: Loss::CAUCHY, max_iterations: 30, relative_gain: 1e-4, ..RigidOptions::default() };
        self.adjust("cameras and boards", &rough);
        // From better cameras another of two poses may be the right one.
        self.place_boards();
        self.adjust("boards placed again", &rough);
        self.reject();
        self.move_to_origin();
        self.adjust(
            "without outliers",
            &RigidOptions { loss: Loss::HUBER, covariance: true, correlated: true, ..RigidOptions::default() },
        );
        self.test();
    }

    /// Finds where the board is in each frame, and how each camera frame is turned.
    fn place_boards(&mut self) {
        let mut by_frame: BTreeMap<usize, Vec<&mut CameraFrame>> = BTreeMap::new();
        for camera_frame in &mut self.camera_frames {
            by_frame.entry(camera_frame.frame).or_default().push(camera_frame);
        }
        let (cameras, placed, before) = (&self.cameras, &self.placed, &self.boards);
        let place = |(frame, mut camera_frames): (usize, Vec<&mut CameraFrame>)| {
            let found =
                groups::place(cameras, placed, before.get(&frame), &mut camera_frames, self.board, self.options)?;
            Some((frame, found))
        };
        self.boards = by_frame.into_iter().filter_map(place).collect();
    }

    fn seeing(&self, frame: usize) -> usize {
        self.camera_frames.iter().filter(|it| it.frame == frame && self.placed[it.camera]).count()
    }

    /// The frame whose board is the world: that on the floor, or the one that most cameras saw, and of those the one with most marks.
    fn choose_origin(&mut self) {
        let marks = |frame: usize| -> usize {
            self.camera_frames
                .iter()
                .filter(|it| it.frame == frame && self.placed[it.camera])
                .map(|it| it.ids.len())
                .sum()
        };
        let best = self.boards.keys().max_by_key(|it| (self.seeing(**it), marks(**it), std::cmp::Reverse(**it)));
        self.origin = best.copied().unwrap_or(0);
    }

    /// Moves the world into the board of the origin's frame.
    fn move_to_origin(&mut self) {
        let Some(origin) = self.boards.get(&self.origin).copied() else { return };
        for camera in &mut self.cameras {
            camera.camera_from_world *= origin;
        }
        for board in self.boards.values_mut() {
            *board = origin.inverse() * *board;
        }
    }

    fn seen(
        &self,
        boards: &BTreeMap<usize, usize>,
        wanted: impl Fn(usize, usize) -> bool,
    ) -> (Vec<Seen>, Vec<(usize, usize)>) {
        let (mut seen, mut of) = (Vec::new(), Vec::new());
        for (at, camera_frame) in self.camera_frames.iter().enumerate() {
            let Some(&board) = boards.get(&camera_frame.frame) else { continue };
            for mark in (0..camera_frame.ids.len()).filter(|it| wanted(at, *it)) {
                let place = turned_place(self.board, camera_frame, mark);
                seen.push(Seen {
                    camera: camera_frame.camera,
                    board,
                    place,
                    pixel: camera_frame.pixels[mark],
                    sigma_px: camera_frame.sigmas[mark] * self.sigma_factor,
                });
                of.push((at, mark));
            }
        }
        (seen, of)
    }

    fn adjust(&mut self, stage: &'static str, how: &RigidOptions) {
        let order: BTreeMap<usize, usize> = self.boards.keys().enumerate().map(|(at, frame)| (*frame, at)).collect();
        let poses: Vec<Isometry3<f64>> = self.boards.values().copied().collect();
        let (seen, of) = self.seen(&order, |at, mark| self.roles[at][mark] == ObservationRole::Used);
        let how = RigidOptions { held_board: order.get(&self.origin).copied(), ..*how };
        let Some(found) = rigid::adjust(&self.cameras, &self.freedoms, &poses, &seen, &how) else { return };
        let Rigid { cameras, world_from_board, residuals, covariance, .. } = found;
        self.cameras = cameras;
        self.boards.values_mut().zip(world_from_board).for_each(|(to, from)| *to = from);
        let (mut squares, mut used) = (0.0, 0);
        for ((at, mark), residual) in of.into_iter().zip(residuals) {
            self.residuals[at][mark] = residual;
            squares += residual.map_or(0.0, |it| it.norm_squared());
            used += usize::from(residual.is_some());
        }
        self.steps.push(Step { stage, rms_px: (squares / used.max(1) as f64).sqrt(), used });
        if let Some(Ok(covariance)) = covariance {
            self.covariance =
                covariance.into_iter().zip(&self.placed).map(|(it, placed)| placed.then_some(it)).collect();
        }
    }

    /// Rejects what lies far off, in the noise as it is, and takes that noise for the covariance.
    fn reject(&mut self) {
        let lengths: Vec<f64> = self.residuals.iter().flatten().flatten().map(|it| it.norm()).collect();
        let sigma_px = median(&lengths).unwrap_or(0.0) / 1.1774;
        let limit = (5.0 * sigma_px).max(0.05).min(self.options.inlier_px.max(4.0 * sigma_px));
        for (roles, residuals) in self.roles.iter_mut().zip(&self.residuals) {
            for (role, residual) in roles.iter_mut().zip(residuals).filter(|it| *it.0 == ObservationRole::Used) {
                if residual.is_none_or(|it| it.norm() > limit) {
                    *role = ObservationRole::Rejected;
                }
            }
        }
        let sigmas: Vec<f64> = self.camera_frames.iter().flat_map(|it| it.sigmas.iter().copied()).collect();
        self.sigma_factor = (sigma_px / median(&sigmas).unwrap_or(1.0)).max(1e-3);
    }

    fn into_solution(
        mut self,
        recording: &Recording,
        optics: Vec<OpticsFit>,
        status: Vec<CameraStatus>,
    ) -> BoardSolution {
        let mut times: BTreeMap<usize, f64> = BTreeMap::new();
        for (camera_frame, frame) in
            recording.camera_frames.iter().zip(frames(recording, self.options.frame_tolerance_s))
        {
            let time = times.entry(frame).or_insert(camera_frame.time_s);
            *time = time.min(camera_frame.time_s);
        }
        let mut fixed = FixedFreedoms {
            scale: Some(Fixed { by: self.board.name.clone(), sigma: None }),
            ..FixedFreedoms::default()
        };
        if let Some(wanted) = self.options.floor_time_s {
            let away = |frame: &usize| times.get(frame).map_or(f64::INFINITY, |it| (it - wanted).abs());
            let nearest = self.boards.keys().copied().min_by(|a, b| away(a).total_cmp(&away(b)));
            if let Some(floor) = nearest.filter(|it| away(it) <= self.options.frame_tolerance_s.max(0.5)) {
                let by = format!("the board on the floor at {wanted} s");
                fixed.gravity = Some(Fixed { by: by.clone(), sigma: None });
                fixed.origin = Some(Fixed { by, sigma: None });
                if floor != self.origin {
                    self.origin = floor;
                    self.move_to_origin();
                    self.adjust(
                        "seen from the floor",
                        &RigidOptions {
                            loss: Loss::HUBER,
                            covariance: true,
                            correlated: true,
                            ..RigidOptions::default()
                        },
                    );
                }
            }
        }
        let (mut points, mut observations, mut lengths) = (Vec::new(), Vec::new(), Vec::new());
        let mut place_of: BTreeMap<(usize, u32), usize> = BTreeMap::new();
        for (at, camera_frame) in self.camera_frames.iter().enumerate() {
            for (mark, &pixel) in camera_frame.pixels.iter().enumerate() {
                let place = turned_place(self.board, camera_frame, mark);
                let label = self.board.nearest(&place);
                let point = self.boards.get(&camera_frame.frame).filter(|_| self.placed[camera_frame.camera]).map(
                    |world_from_board| {
                        *place_of.entry((camera_frame.frame, label)).or_insert_with(|| {
                            let time_s = times.get(&camera_frame.frame).copied().unwrap_or(0.0);
                            points.push(SolvedPoint {
                                frame: camera_frame.frame,
                                time_s,
                                label,
                                position: world_from_board * place,
                            });
                            points.len() - 1
                        })
                    },
                );
                let role = self.roles[at][mark];
                let residual = self.residuals[at][mark];
                if role == ObservationRole::Used {
                    lengths.extend(residual.map(|it| it.norm()));
                }
                observations.push(SolvedObservation {
                    camera: camera_frame.camera,
                    frame: camera_frame.frame,
                    point,
                    pixel,
                    residual,
                    role,
                });
            }
        }
        // By frame and then by label, as the type promises.
        let mut order: Vec<usize> = (0..points.len()).collect();
        order.sort_by_key(|it| (points[*it].frame, points[*it].label));
        let mut new_place = vec![0; points.len()];
        order.iter().enumerate().for_each(|(new, old)| new_place[*old] = new);
        let points = order.iter().map(|it| points[*it]).collect();
        observations.iter_mut().for_each(|it| it.point = it.point.map(|old| new_place[old]));
        let cameras = recording.cameras.iter().enumerate().map(|(at, guess)| {
            let fit = &optics[at];
            let known = self.placed[at] && status[at] == CameraStatus::Calibrated;
            SolvedCamera {
                name: guess.name.clone(),
                camera: if known { self.cameras[at].clone() } else { guess.camera.clone() },
                status: status[at].clone(),
                freed: match known {
                    true if fit.contradicted => Freedom { pose: true, ..fit.freed },
                    true => self.freedoms[at],
                    false => Freedom::NONE,
                },
                prior: None,
                covariance: self.covariance[at].clone().filter(|_| known).map(|it| match fit.contradicted {
                    true => CameraCovariance { optics: fit.sigma, ..it },
                    false => it,
                }),
                clock: None,
            }
        });
        let solved =
            Solved { cameras: cameras.collect(), points, observations, steps: self.steps, fixed, ..Solved::default() };
        let rms_px = (lengths.iter().map(|it| it * it).sum::<f64>() / lengths.len().max(1) as f64).sqrt();
        let pose = |(frame, pose): (&usize, &Isometry3<f64>)| BoardPose {
            frame: *frame,
            time_s: times.get(frame).copied().unwrap_or(0.0),
            world_from_board: *pose,
        };
        BoardSolution {
            solved,
            optics,
            boards: self.boards.iter().map(pose).collect(),
            rms_px,
            median_px: median(&lengths).unwrap_or(f64::NAN),
            hold_out: self.hold_out,
            ambiguous: Vec::new(),
            unusable_spots: 0,
            misfit_views: 0,
            stretch: None,
        }
    }
}
