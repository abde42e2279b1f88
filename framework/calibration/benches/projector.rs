//! A projector and its camera from poses of a chessboard, against a truth that neither is told: twenty seeds, `cargo bench -p foveate-calibration --bench projector`.
//!
//! Truth is drawn anew for each seed: lenses with a thin prism and a term of r⁸, which are not fitted; a projector whose picture is thrown upwards; a board that is bent by some
//! tenths of a millimetre and measured half a thousandth too large. Corners are off by what corners of real sets are.

use foveate_calibration::board::{Board, BoardOptions, calibrate};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_estimation::random::Random;
use foveate_estimation::statistics::median;
use foveate_geometry::{AlignmentOptions, Camera, CameraStatus, Distortion, Freedom, Intrinsics, align};
use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion, Vector2};

const SEEDS: u64 = 20;
const COLUMNS: u32 = 9;
const ROWS: u32 = 6;
const SQUARE_M: f64 = 0.04;
/// Of a corner, camera and projector [px].
const NOISE_PX: [f64; 2] = [0.08, 0.12];
/// How far the middle of a bent board is off its plane, standard deviation over seeds [m].
const BENT_M: f64 = 3e-4;
const SIZES: [[u32; 2]; 2] = [[1280, 1024], [1024, 768]];

/// A camera with a lens richer than what is fitted.
struct TrueCamera {
    camera: Camera,
    /// Thin prism, of r² along x and y; radial of r⁸.
    beyond: [f64; 3],
}

impl TrueCamera {
    fn draw(random: &mut Random, which: usize) -> TrueCamera {
        let mut about = |middle: f64, spread: f64| middle + spread * random.normal();
        let [columns, rows] = SIZES[which].map(f64::from);
        let focal = about([1350.0, 1900.0][which], 40.0);
        // A projector's picture is thrown upwards: its optical axis meets the lower edge.
        let principal = [about(columns / 2.0, 8.0), about([rows / 2.0, 0.92 * rows][which], 8.0)];
        let distortion = Distortion {
            k1: about([-0.12, 0.03][which], 0.02),
            k2: about(0.03, 0.02),
            p1: about(0.0, 5e-4),
            p2: about(0.0, 5e-4),
            ..Distortion::default()
        };
        let turn = UnitQuaternion::from_euler_angles(about(0.05, 0.03), about(-0.16, 0.03), about(0.0, 0.02));
        let place = Translation3::new(about(-0.3, 0.03), about(-0.08, 0.03), about(0.04, 0.02));
        TrueCamera {
            beyond: [about(0.0, 3e-4), about(0.0, 3e-4), about(0.0, 2e-3)],
            camera: Camera {
                image_size: SIZES[which],
                intrinsics: Intrinsics { focal: [focal, focal * about(1.0, 5e-4)], principal, skew: 0.0 },
                distortion,
                camera_from_world: if which == 0 { Isometry3::identity() } else { Isometry3::from_parts(place, turn) },
            },
        }
    }

    fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        let pixel = self.camera.project(point)?;
        let Intrinsics { focal, principal, .. } = self.camera.intrinsics;
        let from_axis = Vector2::new((pixel.x - principal[0]) / focal[0], (pixel.y - principal[1]) / focal[1]);
        let square = from_axis.norm_squared();
        let [x, y, radial] = self.beyond;
        let bent = from_axis * (1.0 + radial * square.powi(4)) + Vector2::new(x, y) * square;
        let pixel = Point2::new(principal[0] + focal[0] * bent.x, principal[1] + focal[1] * bent.y);
        let [columns, rows] = self.camera.image_size.map(f64::from);
        ((0.0..columns - 1.0).contains(&pixel.x) && (0.0..rows - 1.0).contains(&pixel.y)).then_some(pixel)
    }
}

/// A pose of the board before both, tilted by up to 40 degrees, of which both see all corners.
fn recording(truth: &[TrueCamera; 2], board: &Board, n_poses: usize, bend_m: f64, random: &mut Random) -> Recording {
    let mut camera_frames = Vec::new();
    // Bent like a leaf, by so much in its middle.
    let bend = random.normal() * bend_m;
    let mut n = 0;
    while n < n_poses {
        let mut within = |most: f64| most * (2.0 * random.uniform() - 1.0);
        let turn = UnitQuaternion::from_euler_angles(std::f64::consts::PI + within(0.6), within(0.6), within(0.4));
        let place = Translation3::new(within(0.3), within(0.25) - 0.1, 1.25 + within(0.25));
        let pose = Isometry3::from_parts(place, turn);
        let on_board = |label: u32| -> Option<Point3<f64>> {
            let place = board.place(label)? * 1.0005;
            let along = place.x / (0.5 * f64::from(COLUMNS - 1) * SQUARE_M) - 1.0;
            Some(pose * Point3::new(place.x, place.y, bend * (1.0 - along * along)))
        };
        let spots = |which: usize| -> Option<Vec<(u32, Point2<f64>)>> {
            (0..COLUMNS * ROWS).map(|label| Some((label, truth[which].project(&on_board(label)?)?))).collect()
        };
        let Some(both) = spots(0).zip(spots(1)) else { continue };
        for (camera, seen) in [both.0, both.1].into_iter().enumerate() {
            let mut off = || NOISE_PX[camera] * random.normal();
            let spot = |(label, pixel): (u32, Point2<f64>)| Spot {
                pixel: pixel + Vector2::new(off(), off()),
                sigma_px: NOISE_PX[camera],
                peak: 0.0,
                label: Some(label),
            };
            camera_frames.push(CameraFrame { camera, time_s: n as f64, spots: seen.into_iter().map(spot).collect() });
        }
        n += 1;
    }
    Recording { cameras: [0, 1].map(guess).into(), camera_frames }
}

/// What a person would guess.
fn guess(which: usize) -> CameraGuess {
    let [columns, rows] = SIZES[which].map(f64::from);
    let intrinsics = Intrinsics { focal: [1.3 * columns; 2], principal: [columns / 2.0, rows / 2.0], skew: 0.0 };
    let camera = Camera {
        image_size: SIZES[which],
        intrinsics,
        distortion: Distortion::default(),
        camera_from_world: Isometry3::identity(),
    };
    let free =
        Freedom { focal: true, principal: true, aspect: true, k1: true, k2: true, decentering: true, ..Freedom::POSE };
    CameraGuess { name: ["camera", "projector"][which].to_owned(), camera, free }
}

/// Residuals [px]; the projector's centre in the camera's space and its focal length, off the truth [mm, %]; points of a volume, triangulated from what both truly see, off the truth after a motion of all together, that is, of the space [mm].
fn trial(seed: u64, n_poses: usize, bend_m: f64) -> Option<[f64; 4]> {
    let mut random = Random::new(seed);
    let truth = [0, 1].map(|it| TrueCamera::draw(&mut random, it));
    let board = Board::chessboard(COLUMNS, ROWS, SQUARE_M).ok()?;
    let recording = recording(&truth, &board, n_poses, bend_m, &mut random);
    let options = BoardOptions { hold_out_every: 0, min_views: 3.min(n_poses), ..BoardOptions::default() };
    let found = calibrate(&recording, &board, &options).ok()?.solved;
    if found.cameras.iter().any(|it| it.status != CameraStatus::Calibrated) {
        return None;
    }
    let squares = found.observations.iter().filter_map(|it| {
        let point = &found.points[it.point?];
        Some((found.cameras[it.camera].camera.project(&point.position)? - it.pixel).norm_squared())
    });
    let squares: Vec<f64> = squares.collect();
    let residual = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    let world_from_camera = found.cameras[0].camera.camera_from_world.inverse();
    let in_camera = |it: &Camera| Camera { camera_from_world: it.camera_from_world * world_from_camera, ..it.clone() };
    let [camera, projector] = [0, 1].map(|it| in_camera(&found.cameras[it].camera));
    let centre = (projector.centre() - truth[1].camera.centre()).norm() * 1e3;
    let focal = 100.0 * (projector.intrinsics.focal[0] / truth[1].camera.intrinsics.focal[0] - 1.0).abs();
    let (mut places, mut found) = (Vec::new(), Vec::new());
    for (x, y, z) in (-3..=3).flat_map(|x| (-3..=3).flat_map(move |y| (0..3).map(move |z| (x, y, z)))) {
        let point = Point3::new(f64::from(x) * 0.08, f64::from(y) * 0.06, 1.1 + 0.15 * f64::from(z));
        let Some((seen, lit)) = truth[0].project(&point).zip(truth[1].project(&point)) else { continue };
        found.push(foveate_geometry::triangulate_rays(&[camera.ray(&seen)?, projector.ray(&lit)?])?);
        places.push(point);
    }
    let rigid = align(&found, &places, AlignmentOptions::default()).ok()?;
    let off_mm: Vec<f64> = rigid.distances.iter().map(|it| it * 1e3).collect();
    Some([residual, centre, focal, median(&off_mm)?])
}

fn main() {
    println!(
        "| poses | board | failed | residual | projector's centre off | its focal length off | shape of a volume at 1.1 to 1.4 m off |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (n_poses, bend_m) in [3, 5, 10, 20].into_iter().flat_map(|it| [(it, 0.0), (it, BENT_M)]) {
        let trials: Vec<_> = (0..SEEDS).map(|seed| trial(1000 + seed, n_poses, bend_m)).collect();
        let failed = trials.iter().filter(|it| it.is_none()).count();
        let column = |at: usize| {
            let values: Vec<f64> = trials.iter().flatten().map(|it| it[at]).collect();
            (median(&values).unwrap_or(f64::NAN), values.iter().copied().fold(f64::NAN, f64::max))
        };
        let [residual, centre, focal, off] = [0, 1, 2, 3].map(column);
        println!(
            "| {n_poses} | {} | {failed} of {SEEDS} | {:.3} / {:.3} px | {:.2} / {:.2} mm | {:.3} / {:.3} % | {:.2} / {:.2} mm |",
            if bend_m > 0.0 { "bent" } else { "flat" },
            residual.0,
            residual.1,
            centre.0,
            centre.1,
            focal.0,
            focal.1,
            off.0,
            off.1
        );
    }
}
