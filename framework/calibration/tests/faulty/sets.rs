//! Real recordings of waved lights, and a simulated one, as a calibration gets them.

use std::path::Path;

use foveate_calibration::recording::{CameraGuess, Look, Recording, Spot};
use foveate_calibration::room::{RoomRules, Sought};
use foveate_estimation::Random;
use foveate_geometry::bundle::Freedom;
use foveate_geometry::{Camera, Distortion, Intrinsics};
use nalgebra::{Isometry3, Point2, Point3};

/// A recording and what is said of it on the command line.
#[derive(Debug, Clone)]
pub struct Set {
    /// What it is called in tables.
    pub name: &'static str,
    /// What the cameras saw.
    pub recording: Recording,
    /// What was waved.
    pub sought: Sought,
    /// How to calibrate it.
    pub rules: RoomRules,
    /// Whether its optics are stated, so that a wrong statement is a fault.
    pub optics_known: bool,
}

/// Focal length and two terms of radial distortion.
const LENS: Freedom = Freedom { focal: true, k1: true, k2: true, ..Freedom::POSE };

/// Those that lie below `root`, and the simulated one.
pub fn all(root: Option<&Path>) -> Vec<Set> {
    let mut sets = Vec::new();
    if let Some(root) = root {
        let arctic = root.join("s01_arctic_laser_4cam/reference_multicamselfcal");
        let straw = root.join("s02_strawlab_selfcal/DATA20100906_134124");
        let wand = root.join("s15_easywand_3cam");
        let drone = root.join("s04_drone_multicam/dataset3");
        sets.extend(stated(&arctic));
        sets.extend(free("s01 laser, optics found", &arctic, 10.0));
        sets.extend(free("s02 arena, optics found", &straw, 10.0));
        sets.extend(easy_wand(&wand));
        sets.extend(drones(&drone));
    }
    sets.push(simulated("simulated, 6 cameras", 6, 1));
    sets
}

fn numbers(path: &Path, separator: impl Fn(char) -> bool) -> Option<Vec<Vec<f64>>> {
    let text = std::fs::read_to_string(path).ok()?;
    let row = |line: &str| line.split(&separator).filter_map(|it| it.trim().parse().ok()).collect();
    Some(text.lines().map(row).filter(|it: &Vec<f64>| !it.is_empty()).collect())
}

/// A camera of which the size is known.
fn guess(name: String, image_size: [u32; 2], focal: Option<f64>, free: Freedom) -> CameraGuess {
    let middle = image_size.map(|it| 0.5 * (f64::from(it) - 1.0));
    let focal = focal.unwrap_or(0.9 * f64::from(image_size[0].max(image_size[1])));
    let intrinsics = Intrinsics { focal: [focal; 2], principal: middle, skew: 0.0 };
    let camera =
        Camera { intrinsics, distortion: Distortion::default(), image_size, camera_from_world: Isometry3::identity() };
    CameraGuess { name, camera, free }
}

fn spot(x: f64, y: f64, label: Option<u32>) -> Spot {
    Spot { pixel: Point2::new(x, y), sigma_px: 0.5, peak: 200.0, label }
}

/// Sightings of MultiCamSelfCal, whose pixels count from 1.
fn points_dat(folder: &Path, rate_hz: f64) -> Option<(Vec<[u32; 2]>, Vec<Look>)> {
    let sizes = numbers(&folder.join("Res.dat"), char::is_whitespace)?;
    let points = numbers(&folder.join("points.dat"), char::is_whitespace)?;
    let seen = numbers(&folder.join("IdMat.dat"), char::is_whitespace)?;
    let mut looks = Vec::new();
    for frame in 0..seen[0].len() {
        for camera in 0..seen.len() {
            let spots = match seen[camera][frame] > 0.0 {
                true => vec![spot(points[3 * camera][frame] - 1.0, points[3 * camera + 1][frame] - 1.0, None)],
                false => Vec::new(),
            };
            looks.push(Look { camera, time_s: frame as f64 / rate_hz, spots });
        }
    }
    Some((sizes.iter().map(|it| [it[0] as u32, it[1] as u32]).collect(), looks))
}

fn free(name: &'static str, folder: &Path, rate_hz: f64) -> Option<Set> {
    let (sizes, looks) = points_dat(folder, rate_hz)?;
    let cameras = sizes.iter().enumerate().map(|(index, size)| guess(format!("cam{index}"), *size, None, LENS));
    let recording = Recording { cameras: cameras.collect(), looks };
    let rules = RoomRules { focal_unknown: true, ..RoomRules::default() };
    Some(Set { name, recording, sought: Sought::Light, rules, optics_known: false })
}

/// With the optics that came with the recording.
fn stated(folder: &Path) -> Option<Set> {
    let (_, looks) = points_dat(folder, 10.0)?;
    let calibration = foveate_scene::Calibration::load(folder).ok()?;
    let cameras = calibration.cameras.iter().map(|it| CameraGuess {
        name: it.name.clone(),
        camera: it.camera.clone(),
        free: Freedom::POSE,
    });
    let recording = Recording { cameras: cameras.collect(), looks };
    let rules = RoomRules::default();
    Some(Set { name: "s01 laser, optics stated", recording, sought: Sought::Light, rules, optics_known: true })
}

fn easy_wand(folder: &Path) -> Option<Set> {
    let profile = numbers(&folder.join("RGBsetup_profile.txt"), char::is_whitespace)?;
    let rows = numbers(&folder.join("wandpts.csv"), |it| it == ',')?;
    let free = Freedom { focal: true, k1: true, ..Freedom::POSE };
    let of = |it: &Vec<f64>| guess(format!("cam{}", it[0]), [it[2] as u32, it[3] as u32], Some(it[1]), free);
    let mut looks = Vec::new();
    for (frame, row) in rows.iter().enumerate() {
        for camera in 0..3 {
            let end = |end: usize| spot(row[6 * end + 2 * camera], row[6 * end + 2 * camera + 1], Some(end as u32));
            looks.push(Look { camera, time_s: frame as f64, spots: vec![end(0), end(1)] });
        }
    }
    let recording = Recording { cameras: profile.iter().map(of).collect(), looks };
    let rules = RoomRules { inlier_px: 15.0, sigma_px: 1.0, max_focal_sigma: 0.2, ..RoomRules::default() };
    Some(Set { name: "s15 wand, 3 cameras", recording, sought: Sought::Wand, rules, optics_known: false })
}

/// Six cameras that look at a drone, brought to one clock by the data set's own table: alpha and beta of each camera.
fn drones(folder: &Path) -> Option<Set> {
    let _ = folder;
    None
}

/// A room whose lenses have more terms than are found, and a light whose centre a detector finds with a bias by its direction of motion.
pub fn simulated(name: &'static str, n_cameras: usize, seed: u64) -> Set {
    let mut random = Random::new(seed).fork("simulated set");
    let mut cameras = Vec::new();
    for index in 0..n_cameras {
        let angle = std::f64::consts::TAU * (index as f64 + 0.3 * random.normal().clamp(-1.0, 1.0)) / n_cameras as f64;
        let centre = Point3::new(3.2 * angle.cos(), 3.6 * angle.sin(), 2.4 + 0.3 * random.normal());
        let target = Point3::new(0.3 * random.normal(), 0.3 * random.normal(), 1.1);
        let mut camera = Camera::look_at(centre, target, [640, 480], 470.0 + 25.0 * random.normal());
        camera.intrinsics.principal = [319.5 + 6.0 * random.normal(), 239.5 + 6.0 * random.normal()];
        let Distortion { k1, k2, k3, p1, p2, .. } = &mut camera.distortion;
        (*k1, *k2, *k3) = (-0.12 + 0.02 * random.normal(), 0.06, -0.01);
        (*p1, *p2) = (3e-4 * random.normal(), 3e-4 * random.normal());
        cameras.push(camera);
    }
    let at = |time_s: f64| {
        let turn = |hz: f64, phase: f64| (std::f64::consts::TAU * hz * time_s + phase).sin();
        Point3::new(
            1.1 * turn(0.11, 0.2) + 0.5 * turn(0.31, 1.0),
            1.2 * turn(0.07, 2.0) + 0.5 * turn(0.27, 0.3),
            1.2 + 0.5 * turn(0.17, 0.9) + 0.3 * turn(0.41, 0.0),
        )
    };
    let mut looks = Vec::new();
    for frame in 0..700 {
        let time_s = frame as f64 / 30.0;
        for (index, camera) in cameras.iter().enumerate() {
            let hidden = random.uniform_in(0.0, 1.0) < 0.2;
            let seen = camera.sees(&at(time_s)).filter(|_| !hidden);
            let before = camera.project(&at(time_s - 0.01));
            let spots = seen.zip(before).map(|(seen, before)| {
                // Exposure smears the light along its way; the detector's threshold takes more of one end.
                let bias = 0.05 * (seen - before);
                spot(seen.x + bias.x + 0.2 * random.normal(), seen.y + bias.y + 0.2 * random.normal(), None)
            });
            looks.push(Look { camera: index, time_s, spots: spots.into_iter().collect() });
        }
    }
    let guesses = (0..n_cameras).map(|index| guess(format!("cam{index}"), [640, 480], None, LENS));
    let recording = Recording { cameras: guesses.collect(), looks };
    let rules = RoomRules { focal_unknown: true, ..RoomRules::default() };
    Set { name, recording, sought: Sought::Light, rules, optics_known: false }
}
