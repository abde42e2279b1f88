//! A projector placed by whatever stands in its light, against a truth that it is not told: twenty seeds, `cargo bench -p foveate-structured-light --bench boardless`.
//!
//! What is numbered is what `structured_light.points` makes of sets of pictures. Lenses have a thin prism and a term of r⁸ that are not fitted; things stand before a wall and a
//! floor, elsewhere in each set. Errors are those of the projector's centre after all points are laid over the true ones.

use foveate::estimation::random::Random;
use foveate::estimation::statistics::median;
use foveate::geometry::{AlignmentOptions, Camera, CameraStatus, Distortion, Freedom, Intrinsics, align};
use foveate_calibration::network::{CalibrationTarget, NetworkOptions, from_nothing};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_calibration::solved::ObservationRole;
use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

const SEEDS: u64 = 20;
/// Of a point, in a camera and in the projector [px].
const NOISE_PX: [f64; 2] = [0.1, 0.05];
/// Cells of the projector's picture [px].
const CELL_PX: f64 = 32.0;
const SIZES: [[u32; 2]; 3] = [[1024, 768], [1280, 1024], [1280, 1024]];

/// The projector, or a camera: with a lens richer than what is fitted.
struct TrueCamera {
    camera: Camera,
    /// Thin prism, of r² along x and y; radial of r⁸.
    beyond: [f64; 3],
}

impl TrueCamera {
    /// Number 0 is the projector, the others are cameras.
    fn draw(random: &mut Random, which: usize) -> TrueCamera {
        let mut about = |middle: f64, spread: f64| middle + spread * random.normal();
        let [columns, rows] = SIZES[which].map(f64::from);
        let focal = about([1900.0, 1350.0, 1350.0][which], 40.0);
        // Cameras are known beforehand; of the projector it is known how it throws its picture, to some pixels.
        let principal = [about(columns / 2.0, 8.0), about([0.92 * rows, rows / 2.0, rows / 2.0][which], 8.0)];
        let distortion = Distortion { k1: about([0.03, -0.12, -0.12][which], 0.02), ..Distortion::default() };
        let side = [0.0, -0.45, 0.4][which];
        let place = Point3::new(about(side, 0.03), about(-0.05, 0.03), about(0.0, 0.03));
        let target = Point3::new(about(0.0, 0.02), about(if which == 0 { 0.35 } else { 0.0 }, 0.02), 1.8);
        let toward = UnitQuaternion::face_towards(&(target - place), &Vector3::y());
        let world_from_camera = Isometry3::from_parts(Translation3::from(place.coords), toward);
        let intrinsics = Intrinsics { focal: [focal; 2], principal, skew: 0.0 };
        let camera_from_world = world_from_camera.inverse();
        TrueCamera {
            beyond: [about(0.0, 3e-4), about(0.0, 3e-4), about(0.0, 2e-3)],
            camera: Camera { image_size: SIZES[which], intrinsics, distortion, camera_from_world },
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

/// The nearest thing on a ray of the projector: a wall, a floor, or one of some balls.
fn lit(origin: &Point3<f64>, along: &Vector3<f64>, balls: &[(Point3<f64>, f64)]) -> Point3<f64> {
    let mut depth = (2.4 - origin.z) / along.z;
    if along.y > 0.0 {
        depth = depth.min((0.45 - origin.y) / along.y);
    }
    for (middle, radius) in balls {
        let to_middle = middle - origin;
        let nearest = to_middle.dot(along);
        let inside = radius * radius - (to_middle.norm_squared() - nearest * nearest);
        if inside > 0.0 {
            depth = depth.min(nearest - inside.sqrt());
        }
    }
    origin + depth * along
}

struct Found {
    residual_px: f64,
    /// NaN where nothing was held out.
    held_out_px: f64,
    centre_mm: f64,
    focal_percent: f64,
}

/// `cameras` cameras of known optics and a projector; `n_sets` sets. With `has_optics`, the projector's are known too.
fn trial(seed: u64, n_cameras: usize, n_sets: usize, has_optics: bool) -> Option<Found> {
    let mut random = Random::new(seed);
    let truth: Vec<TrueCamera> = (0..=n_cameras).map(|it| TrueCamera::draw(&mut random, it)).collect();
    let projector = &truth[0].camera;
    let [columns, rows] = projector.image_size.map(f64::from);
    let across = (columns / CELL_PX) as u32;
    let mut camera_frames = Vec::new();
    let mut places: Vec<Vec<Point3<f64>>> = Vec::new();
    for set in 0..n_sets {
        let mut within = |most: f64| most * (2.0 * random.uniform() - 1.0);
        let balls: Vec<(Point3<f64>, f64)> =
            (0..6).map(|_| (Point3::new(within(0.45), within(0.3), 1.6 + within(0.5)), 0.14 + within(0.06))).collect();
        let n = across * (rows / CELL_PX) as u32;
        let middle = |it: u32| Point2::new(f64::from(it % across) + 0.5, f64::from(it / across) + 0.5) * CELL_PX;
        let of_set: Vec<Point3<f64>> = (0..n)
            .map(|it| {
                let ray = projector.ray(&middle(it)).unwrap();
                lit(&projector.centre(), &ray.direction.into_inner(), &balls)
            })
            .collect();
        let seen: Vec<Vec<Option<Point2<f64>>>> =
            truth.iter().map(|camera| of_set.iter().map(|it| camera.project(it)).collect()).collect();
        for (camera, pixels) in seen.iter().enumerate() {
            let noise = NOISE_PX[usize::from(camera == 0)];
            // Balls hide what is behind them from a camera.
            let is_seen = |at: usize| {
                let centre = truth[camera].camera.centre();
                let along = (of_set[at] - centre).normalize();
                (lit(&centre, &along, &balls) - of_set[at]).norm() < 1e-6
            };
            let spots: Vec<Spot> = (0..of_set.len())
                .filter(|at| is_seen(*at))
                .filter_map(|at| Some((at, pixels[at]?)))
                .map(|(at, pixel)| Spot {
                    pixel: pixel + Vector2::new(random.normal(), random.normal()) * noise,
                    sigma_px: noise,
                    peak: 0.0,
                    label: Some(at as u32),
                })
                .collect();
            camera_frames.push(CameraFrame { camera, time_s: set as f64, spots });
        }
        places.push(of_set);
    }
    let guess = |which: usize| {
        let mut camera = Camera { camera_from_world: Isometry3::identity(), ..truth[which].camera.clone() };
        let mut free = Freedom::POSE;
        if which == 0 && !has_optics {
            camera.intrinsics =
                Intrinsics { focal: [1.4 * columns; 2], principal: [columns / 2.0, 0.92 * rows], ..camera.intrinsics };
            camera.distortion = Distortion::default();
            free = Freedom { focal: true, principal: true, k1: true, ..free };
        }
        CameraGuess { name: ["projector", "camera-1", "camera-2"][which].to_owned(), camera, free }
    };
    let recording = Recording { cameras: (0..=n_cameras).map(guess).collect(), camera_frames };
    let options = NetworkOptions { focal_unknown: !has_optics, ..NetworkOptions::default() };
    let solved = from_nothing(&recording, CalibrationTarget::Labels { mirrored: &[] }, &options).ok()?.solved;
    if solved.cameras.iter().any(|it| it.status != CameraStatus::Calibrated) {
        return None;
    }
    let rms = |role: ObservationRole| {
        let of_role = solved.observations.iter().filter(|it| it.role == role);
        let squares: Vec<f64> = of_role.filter_map(|it| Some(it.residual?.norm_squared())).collect();
        (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
    };
    let pairs = solved.points.iter().filter_map(|it| {
        let set = places.get(it.time_s.round() as usize)?;
        Some((it.position, *set.get(it.label as usize)?))
    });
    let (found, there): (Vec<Point3<f64>>, Vec<Point3<f64>>) = pairs.unzip();
    let laid = align(&found, &there, AlignmentOptions { scale: true, robust: true }).ok()?;
    let centre = laid.b_from_a * solved.cameras[0].camera.centre();
    let focal = solved.cameras[0].camera.intrinsics.focal[0] / projector.intrinsics.focal[0] - 1.0;
    Some(Found {
        residual_px: rms(ObservationRole::Used),
        held_out_px: rms(ObservationRole::HeldOut),
        centre_mm: 1e3 * (centre - projector.centre()).norm(),
        focal_percent: 100.0 * focal.abs(),
    })
}

fn main() {
    println!(
        "| cameras | sets | projector's optics | failed | residual | held out | its centre off | its focal length off |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for (n_cameras, n_sets, has_optics) in
        [(1, 1, true), (1, 3, true), (2, 3, true), (1, 3, false), (2, 3, false), (2, 8, false)]
    {
        let all: Vec<Found> = (1..=SEEDS).filter_map(|seed| trial(seed, n_cameras, n_sets, has_optics)).collect();
        let shown = |of: &dyn Fn(&Found) -> f64, unit: &str| {
            let list: Vec<f64> = all.iter().map(of).filter(|it| it.is_finite()).collect();
            let worst = list.iter().copied().fold(f64::NAN, f64::max);
            median(&list).map_or("–".to_owned(), |middle| format!("{middle:.3} / {worst:.3} {unit}"))
        };
        println!(
            "| {n_cameras} | {n_sets} | {} | {} of {SEEDS} | {} | {} | {} | {} |",
            if has_optics { "known" } else { "found" },
            SEEDS as usize - all.len(),
            shown(&|it| it.residual_px, "px"),
            shown(&|it| it.held_out_px, "px"),
            shown(&|it| it.centre_mm, "mm"),
            shown(&|it| it.focal_percent, "%")
        );
    }
}
