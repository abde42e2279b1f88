//! `structured_light.calibrator`: camera and projector calibrated together from sets of pictures of a chessboard.
//!
//! The projector is an inverse camera: `structured_light.corners` gives features for it as for any camera, and both are calibrated as cameras that see a board
//! ([`foveate_calibration::board`]). Each set is then held out in turn: a calibration is made from the others, the board is placed in the held-out set
//! by the camera's corners, and the projector's corners are predicted.
//!
//! The board is flat: points triangulated on it are compared with its plane.

use std::collections::BTreeMap;
use std::sync::Arc;

use foveate::estimation::statistics::{median, percentile};
use foveate::geometry::{Camera, CameraStatus, Distortion, Freedom, Intrinsics, ResectionOptions, refine_pose};
use foveate::prelude::*;
use foveate::scene::Calibration;
use foveate::scene::draft::{guessed_focal, middle};
use foveate_calibration::board::{Board, BoardOptions, BoardPose, BoardSolution, calibrate, one_angle};
use foveate_calibration::network::Origin;
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_calibration::solved::{ObservationRole, SolvedObservation};
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::pair::{OnRay, triangulate};
use crate::pattern::projector_of;
use crate::triangulator::{TriangulatorSettings, max_sigma};

ports! {
    pub(crate) fn declared_ports;
    FEATURES: In<Features> = each("features");
    MAP: In<ProjectorMap> = each("map").optional();
}

figures! {
    "projector.rms_px": px, low, "Root mean square re-projection error of the projector's corners over all sets, rejected ones included";
    "projector.held_out_px.rms": px, low, "Root mean square error of the projector's corners in a set as predicted by a calibration without that set, with the board placed by camera and projector, over all sets in turn" => "projector's corners of a set held out";
    "projector.held_out_px.worst": px, low, "The largest of these by set";
    "projector.transfer_px.rms": px, low, "As projector.held_out_px.rms, with the board placed by the camera alone";
    "projector.sets": count, high, "Sets in which camera and projector saw the board";
    "camera.rms_px": px, low, "Root mean square re-projection error of the camera's corners over all sets, rejected ones included";
    "camera.held_out_px.rms": px, low, "As projector.held_out_px.rms, for the camera's corners";
    "corners.rejected": count, low, "Corners of camera and projector that the calibration rejects as outliers";
    "both.rms_px": px, low, "Root mean square re-projection error of the corners of camera and projector over all sets, rejected ones included";
    "both.used_px.rms": px, low, "As both.rms_px, without rejected corners" => "corners of camera and projector off the calibration";
    "depth_mm.{median,p95}": mm, low, "Distance along the camera's rays between triangulated points and the calibrated board, over all sets" => "depth error";
    "flatness_mm.{median,worst}": mm, low, "Root mean square distance of the points on the board from their best plane in a set, over sets; includes any bend of the board";
    "coverage": share, high, "Part of the camera pixels between the board's corners that have a point, over all sets" => "part covered of what could be seen";
}

/// Settings of [`Calibrator`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CalibratorSettings {
    /// Inner corners in a row of the board, one less than squares [–]
    #[schemars(range(min = 3, max = 100))]
    pub columns: u32,
    /// Rows of inner corners, one less than squares in a column [–]
    #[schemars(range(min = 3, max = 100))]
    pub rows: u32,
    /// Side of a square, as measured on the board [mm]
    #[schemars(range(min = 0.1, max = 10000.0))]
    pub square_mm: f64,
    /// The projector's name in the calibration [–]
    #[serde(default = "crate::pattern::default_projector")]
    pub projector: String,
    /// Name of the calibration that is written into the results folder [–]
    #[serde(default = "default_file")]
    pub file: String,
}

fn default_file() -> String {
    "procam.calibration.toml".to_owned()
}

/// Corners of camera and projector in; a calibration in the results folder, with its accuracy.
pub struct Calibrator {
    settings: CalibratorSettings,
    board: Board,
    /// Camera, projector.
    ids: [CameraId; 2],
    names: [String; 2],
    sizes: [[u32; 2]; 2],
    out_dir: Option<std::path::PathBuf>,
    sets: BTreeMap<Time, Set>,
    remarks: Vec<String>,
}

/// What is known of one set.
#[derive(Default)]
struct Set {
    /// Of camera and projector.
    features: [Vec<Feature>; 2],
    map: Option<Arc<ProjectorMap>>,
    on_board: Vec<(Point2<f64>, ProjectorSample)>,
    board_pixels: usize,
}

impl Node for Calibrator {
    const TYPE: &'static str = "structured_light.calibrator";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Calibrates camera and projector together, and tests each set by the others";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CalibratorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CalibratorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let board = Board::chessboard(settings.columns, settings.rows, settings.square_mm / 1e3);
        let board = board.map_err(ConfigError::node)?;
        let camera = setup.camera.ok_or_else(|| {
            ConfigError::node(format_args!("`{}` serves one camera: say which with `camera = \"name\"`", Self::TYPE))
        })?;
        let projector = projector_of(setup, &settings.projector)?;
        setup.claim_named_file("file", &settings.file)?;
        let ids = [camera, CameraId(projector as u16)];
        let of = |it: CameraId| &setup.calibration.cameras[usize::from(it.0)];
        Ok(Self {
            board,
            ids,
            names: ids.map(|it| of(it).name.clone()),
            sizes: ids.map(|it| of(it).camera.image_size),
            settings,
            out_dir: setup.out_dir.clone(),
            sets: BTreeMap::new(),
            remarks: Vec::new(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(features) = io.take(&FEATURES) {
            let Some(which) = self.ids.iter().position(|it| *it == features.value.camera) else { continue };
            let set = self.sets.entry(features.time()).or_default();
            set.features[which] = features.value.list.clone();
            set.reduce(self.settings.columns as usize, self.settings.rows as usize);
        }
        while let Some(map) = io.take(&MAP) {
            let set = self.sets.entry(map.time()).or_default();
            set.map = Some(map.value);
            set.reduce(self.settings.columns as usize, self.settings.rows as usize);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let result = self.conclude(report);
        report.remarks.append(&mut self.remarks);
        result.map_err(NodeError::input)
    }
}

impl Set {
    /// Keeps of the map what lies on the board, once both are there.
    fn reduce(&mut self, columns: usize, rows: usize) {
        let corners = &self.features[0];
        if corners.len() != columns * rows {
            return;
        }
        let Some(map) = self.map.take() else { return };
        let corner = |column: usize, row: usize| corners[row * columns + column].centre;
        let top = (0..columns).map(|it| corner(it, 0));
        let right = (1..rows).map(|it| corner(columns - 1, it));
        let bottom = (0..columns - 1).rev().map(|it| corner(it, rows - 1));
        let left = (1..rows - 1).rev().map(|it| corner(0, it));
        let outline: Vec<Point2<f64>> = top.chain(right).chain(bottom).chain(left).collect();
        for y in 0..map.height {
            for x in 0..map.width {
                let pixel = Point2::new(f64::from(x), f64::from(y));
                if !is_inside(&outline, &pixel) {
                    continue;
                }
                self.board_pixels += 1;
                let sample = map.get(x as usize, y as usize);
                if sample.coordinate.iter().any(|it| it.is_finite()) {
                    self.on_board.push((pixel, sample));
                }
            }
        }
    }
}

/// Whether a point lies in a polygon: a ray to its right passes an odd number of sides.
fn is_inside(outline: &[Point2<f64>], point: &Point2<f64>) -> bool {
    let mut inside = false;
    for (at, a) in outline.iter().enumerate() {
        let b = &outline[(at + 1) % outline.len()];
        let passes = (a.y > point.y) != (b.y > point.y);
        inside ^= passes && point.x < a.x + (point.y - a.y) / (b.y - a.y) * (b.x - a.x);
    }
    inside
}

/// Places of corners on the board [m], and where they were seen [px].
type Marks = (Vec<Point3<f64>>, Vec<Point2<f64>>);

/// What a calibration explains of a set.
struct Predicted {
    /// Observed − predicted, of camera and projector [px].
    errors: [Vec<f64>; 2],
}

impl Calibrator {
    /// With `has_lens`, what bends straight rows is to be found.
    fn guess(&self, which: usize, n_sets: usize, has_lens: bool) -> CameraGuess {
        let image_size = self.sizes[which];
        let intrinsics = Intrinsics { focal: guessed_focal(image_size, 1.0), principal: middle(image_size), skew: 0.0 };
        let camera = Camera {
            image_size,
            intrinsics,
            distortion: Distortion::default(),
            camera_from_world: Isometry3::identity(),
        };
        // How two views of a plane are foreshortened holds four numbers of a camera: focal length and principal point, and no shape of pixels. Its lens bends straight rows of
        // corners in each view, and the views themselves tell whether they hold its first term.
        let few = Freedom { focal: true, principal: true, ..Freedom::POSE };
        let free = match n_sets < 3 {
            true => Freedom { k1: has_lens, ..few },
            false => Freedom { aspect: true, k1: true, k2: true, decentering: true, ..few },
        };
        CameraGuess { name: self.names[which].clone(), camera, free }
    }

    fn recording(&self, without: Option<Time>, has_lens: bool) -> Recording {
        let n_sets = self.sets.len() - usize::from(without.is_some());
        let spot = |it: &Feature| Spot {
            pixel: it.centre,
            sigma_px: (it.covariance.trace() / 2.0).max(1e-6).sqrt(),
            peak: 0.0,
            label: it.label,
        };
        let both = self.sets.iter().filter(|(time, _)| Some(**time) != without);
        let camera_frames = both.flat_map(|(time, set)| {
            let time_s = time.as_s();
            [0, 1].map(|camera| CameraFrame { camera, time_s, spots: set.features[camera].iter().map(spot).collect() })
        });
        Recording {
            cameras: [0, 1].map(|it| self.guess(it, n_sets, has_lens)).into(),
            camera_frames: camera_frames.collect(),
        }
    }

    /// Where views do not hold a lens beside what else is found, without one.
    fn solve(&self, without: Option<Time>) -> Result<BoardSolution, String> {
        self.solve_with(without, true).or_else(|_| self.solve_with(without, false))
    }

    fn solve_with(&self, without: Option<Time>, has_lens: bool) -> Result<BoardSolution, String> {
        let n_sets = self.sets.len() - usize::from(without.is_some());
        let options = BoardOptions { hold_out_every: 0, min_views: n_sets.clamp(2, 3), ..BoardOptions::default() };
        let solution =
            calibrate(&self.recording(without, has_lens), &self.board, &options).map_err(|fault| {
                match self.guessed_angles() {
                    Some(cause) => cause,
                    None => fault.to_string(),
                }
            })?;
        let bad = solution.solved.cameras.iter().zip(&solution.optics);
        match bad.into_iter().find(|(camera, _)| camera.status != CameraStatus::Calibrated) {
            Some((camera, optics)) => {
                let why = optics.refused.first().map_or_else(|| camera.status.to_string(), ToString::to_string);
                Err(format!("`{}` cannot be calibrated from {n_sets} sets of the board: {why}", camera.name))
            }
            None => Ok(solution),
        }
    }

    fn conclude(&mut self, report: &mut Report) -> Result<(), String> {
        let is_seen = |set: &Set| set.features.iter().all(|it| it.len() >= 6);
        let n_all = self.sets.len();
        self.sets.retain(|_, set| is_seen(set));
        report.figure("projector.sets", self.sets.len() as f64);
        if self.sets.len() < 2 {
            return Err(format!(
                "camera and projector saw the board in {} of the {n_all} sets that were decoded, expected at least 3 for a calibration, the board tilted in different ways",
                self.sets.len()
            ));
        }
        let solution = self.solve(None)?;
        self.residuals(&solution, report);
        let normals: Vec<Vector3<f64>> = solution.boards.iter().map(BoardPose::normal).collect();
        self.remarks.extend(at_one_angle(&normals));
        self.remarks.extend(solution.stretch.map(|it| it.to_string()));
        if self.sets.len() < 3 {
            self.remarks.push(format!(
                "{} sets determine at best focal length, principal point and one distortion term, and none can be held out: expected at least 3",
                self.sets.len()
            ));
        } else {
            self.hold_out(report);
        }
        self.surfaces(&solution, report);
        self.write(&solution, report)
    }

    fn residuals(&mut self, solution: &BoardSolution, report: &mut Report) {
        // Those that were rejected count too.
        let off = |it: &SolvedObservation| {
            let point = &solution.solved.points[it.point?];
            Some((solution.solved.cameras[it.camera].camera.project(&point.position)? - it.pixel).norm())
        };
        let errors = |which: Option<usize>| -> Vec<f64> {
            let all = solution.solved.observations.iter();
            all.filter(|it| which.is_none_or(|which| it.camera == which)).filter_map(off).collect()
        };
        let rejected = solution.solved.observations.iter().filter(|it| it.role == ObservationRole::Rejected).count();
        report.figure("corners.rejected", rejected as f64);
        let used = solution.solved.observations.iter().filter(|it| it.role == ObservationRole::Used);
        report.figure("both.used_px.rms", rms(&used.filter_map(off).collect::<Vec<f64>>()));
        report.figure("camera.rms_px", rms(&errors(Some(0))));
        report.figure("projector.rms_px", rms(&errors(Some(1))));
        report.figure("both.rms_px", rms(&errors(None)));
        for (fit, camera) in solution.optics.iter().zip(&solution.solved.cameras) {
            let names: Vec<String> = fit.refused.iter().map(|it| format!("{} ({})", it.what, it.why)).collect();
            if !names.is_empty() {
                let name = &camera.name;
                self.remarks.push(format!("optics of `{name}` that stay as guessed: {}", names.join("; ")));
            }
        }
    }

    /// Each set in turn by the others.
    fn hold_out(&mut self, report: &mut Report) {
        let times: Vec<Time> = self.sets.keys().copied().collect();
        let (mut all, mut transfer, mut worst) = ([Vec::new(), Vec::new()], Vec::new(), 0.0_f64);
        for time in times {
            let solution = match self.solve(Some(time)) {
                Ok(solution) => solution,
                Err(fault) => {
                    self.remarks.push(format!("without the set at {:.2} s: {fault}", time.as_s()));
                    worst = f64::NAN;
                    continue;
                }
            };
            let cameras = [0, 1].map(|it| solution.solved.cameras[it].camera.clone());
            let set = &self.sets[&time];
            let together = self.predict(&cameras, set, true);
            let alone = self.predict(&cameras, set, false);
            if let (Some(together), Some(alone)) = (together, alone) {
                worst = worst.max(rms(&together.errors[1]));
                transfer.extend(alone.errors[1].iter().copied());
                let [camera, projector] = together.errors;
                all[0].extend(camera);
                all[1].extend(projector);
            }
        }
        report.figure("camera.held_out_px.rms", rms(&all[0]));
        report.figure("projector.held_out_px.rms", rms(&all[1]));
        report.figure("projector.held_out_px.worst", worst);
        report.figure("projector.transfer_px.rms", rms(&transfer));
    }

    /// Places the board by what the camera saw, or both did, and says how far off everything is.
    fn predict(&self, cameras: &[Camera; 2], set: &Set, by_both: bool) -> Option<Predicted> {
        let marks = |which: usize| -> Marks {
            let list = set.features[which].iter();
            list.filter_map(|it| Some((self.board.place(it.label?)?, it.centre))).unzip()
        };
        let seen = [marks(0), marks(1)];
        let (places, pixels) = &seen[0];
        let start = self.solved_pose(&cameras[0], places, pixels)?;
        let mut world_from_board = start;
        if by_both {
            world_from_board = adjust_pose(cameras, &seen, start)?;
        }
        let errors = [0, 1].map(|which| {
            let (places, pixels) = &seen[which];
            let off = |(place, pixel): (&Point3<f64>, &Point2<f64>)| {
                Some((cameras[which].project(&(world_from_board * place))? - pixel).norm())
            };
            places.iter().zip(pixels).filter_map(off).collect()
        });
        Some(Predicted { errors })
    }

    /// What is to be said where the boards, placed by the guessed camera, have nearly one direction.
    fn guessed_angles(&self) -> Option<String> {
        let camera = self.guess(0, self.sets.len(), true).camera;
        let normal = |set: &Set| {
            let marks = set.features[0].iter().filter_map(|it| Some((self.board.place(it.label?)?, it.centre)));
            let (places, pixels): Marks = marks.unzip();
            Some(self.solved_pose(&camera, &places, &pixels)? * Vector3::z())
        };
        at_one_angle(&self.sets.values().filter_map(normal).collect::<Vec<_>>())
    }

    /// `world_from_board` by one camera: of the poses that a start from the front leads to, the best.
    fn solved_pose(&self, camera: &Camera, places: &[Point3<f64>], pixels: &[Point2<f64>]) -> Option<Isometry3<f64>> {
        let local = Camera { camera_from_world: Isometry3::identity(), ..camera.clone() };
        let mut random = foveate::estimation::random::Random::new(1);
        let options = ResectionOptions::default();
        let found = foveate::geometry::resect(&local, places, pixels, &options, |n| random.below(n)).ok()?;
        let posed = Camera { camera_from_world: found.camera_from_world, ..local };
        let fine = refine_pose(&posed, places, pixels, &options).ok()?;
        Some(camera.camera_from_world.inverse() * fine.camera_from_world)
    }

    /// Points on the board against its plane.
    fn surfaces(&self, solution: &BoardSolution, report: &mut Report) {
        let [camera, projector] = [0, 1].map(|it| &solution.solved.cameras[it].camera);
        let (mut off_plane, mut by_set, mut pixels, mut known) = (Vec::new(), Vec::new(), 0, 0);
        let kept = TriangulatorSettings::default();
        let is_good = |it: &OnRay| it.misfit <= kept.max_misfit_px;
        for (time, set) in &self.sets {
            let near = |it: &&foveate_calibration::board::BoardPose| (it.time_s - time.as_s()).abs() < 1e-3;
            let Some(pose) = solution.boards.iter().find(near) else { continue };
            let normal = pose.world_from_board * Vector3::z();
            let origin = pose.world_from_board * Point3::origin();
            let mut points: Vec<Point3<f64>> = Vec::new();
            let all =
                set.on_board.iter().filter_map(|(pixel, it)| triangulate(camera, projector, pixel, it).filter(is_good));
            let all: Vec<OnRay> = all.collect();
            let limit = max_sigma(None, &mut all.iter().map(|it| (it.sigma / it.depth) as f32).collect::<Vec<_>>());
            for found in all.into_iter().filter(|it| it.sigma <= limit * it.depth) {
                let along = found.ray.direction.dot(&normal);
                let depth = (origin - found.ray.origin).dot(&normal) / along;
                off_plane.push(1e3 * (found.depth - depth).abs());
                points.push(found.point());
            }
            pixels += set.board_pixels;
            known += points.len();
            by_set.push(1e3 * flatness(&points));
        }
        if pixels == 0 {
            return;
        }
        report.figure("depth_mm.median", median(&off_plane).unwrap_or(f64::NAN));
        report.figure("depth_mm.p95", percentile(&off_plane, 95.0).unwrap_or(f64::NAN));
        report.figure("flatness_mm.median", median(&by_set).unwrap_or(f64::NAN));
        report.figure("flatness_mm.worst", by_set.iter().copied().fold(f64::NAN, f64::max));
        report.figure("coverage", known as f64 / pixels as f64);
    }

    fn write(&self, solution: &BoardSolution, report: &mut Report) -> Result<(), String> {
        let origin = Origin {
            method: "structured_light.calibrator: a board".to_owned(),
            note: format!("camera and projector from {} sets of a {}", self.sets.len(), self.board.name),
            ..Origin::default()
        };
        let calibration: Calibration = solution.solved.to_calibration(origin).map_err(|fault| fault.to_string())?;
        let Some(folder) = &self.out_dir else { return Ok(()) };
        report.save(folder, &self.settings.file, calibration.to_toml()).map_err(|fault| fault.to_string())
    }
}

/// What is to be said where all poses of the board, whose normals these are, have nearly one direction.
fn at_one_angle(normals: &[Vector3<f64>]) -> Option<String> {
    one_angle(normals).map(|most| {
        format!(
            "the board was seen at one angle only, within {:.0} degrees, which does not determine focal lengths and thus depth; expected poses tilted by 20 degrees or more in different directions",
            most.to_degrees()
        )
    })
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|it| it * it).sum::<f64>() / errors.len() as f64).sqrt()
}

/// Root mean square distance from the plane that fits points best.
fn flatness(points: &[Point3<f64>]) -> f64 {
    let n = points.len() as f64;
    let mean = points.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords) / n;
    let mut scatter = Matrix3::zeros();
    for point in points {
        let off = point.coords - mean;
        scatter += off * off.transpose();
    }
    (scatter.symmetric_eigenvalues().min().max(0.0) / n).sqrt()
}

/// Steps of the search for a pose.
const STEPS: usize = 20;

/// The pose of a board under which what both cameras saw is nearest.
fn adjust_pose(cameras: &[Camera; 2], seen: &[Marks; 2], start: Isometry3<f64>) -> Option<Isometry3<f64>> {
    let mut pose = start;
    for _ in 0..STEPS {
        let (mut normal, mut side) = (nalgebra::Matrix6::zeros(), nalgebra::Vector6::zeros());
        for (camera, (places, pixels)) in cameras.iter().zip(seen) {
            for (place, pixel) in places.iter().zip(pixels) {
                let (at, by_point) = camera.project_with_jacobian(&(pose * place))?;
                // B exp(δ) p = B (p + ω × p + v)
                let by_place = by_point * pose.rotation.to_rotation_matrix().matrix();
                let mut by_pose = nalgebra::SMatrix::<f64, 2, 6>::zeros();
                by_pose.fixed_view_mut::<2, 3>(0, 0).copy_from(&(by_place * -place.coords.cross_matrix()));
                by_pose.fixed_view_mut::<2, 3>(0, 3).copy_from(&by_place);
                normal += by_pose.transpose() * by_pose;
                side -= by_pose.transpose() * (at - pixel);
            }
        }
        let step = normal.try_inverse()? * side;
        let turn = nalgebra::UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        pose *= Isometry3::from_parts(Vector3::new(step[3], step[4], step[5]).into(), turn);
        if step.norm() < 1e-10 {
            break;
        }
    }
    Some(pose)
}

#[cfg(test)]
mod tests {
    use foveate::estimation::random::Random;
    use nalgebra::{Translation3, UnitQuaternion};

    use super::*;
    use crate::pair::tests::rig;

    /// The report on a camera and a projector that saw a board rotated about x and y by these angles, with corners 0.1 px off.
    fn reported(turns: &[[f64; 2]]) -> (Result<Report, String>, Vec<String>) {
        let (camera, projector) = rig();
        let named = [("camera", camera), ("projector", projector)];
        let cameras = named.map(|(name, camera)| foveate::scene::NamedCamera { name: name.to_owned(), camera });
        let calibration = Calibration::new(cameras.to_vec(), foveate::scene::LengthUnit::Metre, String::new()).unwrap();
        let setup = Setup { camera: Some(CameraId(0)), calibration: Arc::new(calibration), ..Setup::for_tests() };
        let settings = CalibratorSettings {
            columns: 9,
            rows: 7,
            square_mm: 50.0,
            projector: "projector".into(),
            file: "c.toml".into(),
        };
        let mut bench = NodeBench::<Calibrator>::with_setup(settings, &setup).unwrap();
        let mut random = Random::new(7);
        for (at, [x, y]) in turns.iter().enumerate() {
            let turn = UnitQuaternion::from_euler_angles(*x, *y, 0.1 * at as f64);
            let pose = Isometry3::from_parts(Translation3::new(-0.15, -0.1, 1.6 + 0.1 * at as f64), turn);
            for (number, named) in cameras.iter().enumerate() {
                let corner = |label: u32| {
                    let place = Point3::new(0.05 * f64::from(label % 9), 0.05 * f64::from(label / 9), 0.0);
                    let at = named.camera.project(&(pose * place)).unwrap();
                    let centre = at + nalgebra::Vector2::new(random.normal(), random.normal()) * 0.1;
                    let covariance = nalgebra::Matrix2::identity() * 0.01;
                    Feature { centre, covariance, area: 0, peak: 0, label: Some(label) }
                };
                let list = (0..63).map(corner).collect();
                let features = Features { camera: CameraId(number as u16), list };
                bench.feed(&FEATURES, Time::from_s(at as f64), features).unwrap();
            }
        }
        let result = bench.finish().map_err(|it| it.to_string());
        let remarks = result.as_ref().map(|it| it.remarks.clone()).unwrap_or_default();
        (result, remarks)
    }

    #[test]
    fn three_poses_tilted_in_different_ways_are_enough() {
        let (report, remarks) = reported(&[[0.5, 0.1], [-0.4, 0.3], [0.1, -0.5], [0.3, 0.4]]);
        let figures = report.unwrap().figures;
        assert!(figures["projector.rms_px"] < 0.2 && figures["projector.held_out_px.rms"] < 0.5, "{figures:?}");
        assert!(!remarks.iter().any(|it| it.contains("one angle")), "{remarks:?}");
    }

    #[test]
    fn too_few_poses_are_told_as_such() {
        for turns in [&[][..], &[[0.5, 0.1]]] {
            let fault = reported(turns).0.unwrap_err();
            let n = turns.len();
            assert!(
                fault.contains(&format!("in {n} of the {n} sets that were decoded, expected at least 3")),
                "{fault}"
            );
        }
        let (report, remarks) = reported(&[[0.5, 0.1], [-0.4, 0.3]]);
        assert!(remarks.iter().any(|it| it.contains("none can be held out")), "{report:?} {remarks:?}");
    }

    #[test]
    fn a_board_at_one_angle_holds_no_focal_length_and_it_is_said() {
        let (flat, remarks) = reported(&[[0.0, 0.02], [0.01, 0.0], [0.0, 0.0], [0.02, 0.01]]);
        let words = flat.err().into_iter().chain(remarks).collect::<Vec<_>>().join("; ");
        assert!(words.contains("at one angle only"), "{words}");
        let (tilted, remarks) = reported(&[[0.5, 0.0], [0.51, 0.01], [0.5, 0.01], [0.49, 0.0]]);
        let words = tilted.err().into_iter().chain(remarks).collect::<Vec<_>>().join("; ");
        assert!(words.contains("at one angle only"), "{words}");
    }
}
