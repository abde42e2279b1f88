//! Recordings of others below `FOVEATE_DATA`, and how each is calibrated.

use std::path::Path;

use foveate_calibration::board::{self, Board, BoardOptions};
use foveate_calibration::network::{CalibrationTarget, NetworkOptions, from_nothing};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_calibration::solved::Solved;
use foveate_calibration::wand::{self, RefineOptions, Wand};
use foveate_geometry::bundle::Freedom;
use foveate_geometry::{Camera, Distortion, Intrinsics};
use foveate_scene::Draft;
use foveate_scene::draft::{guessed_focal, middle};
use nalgebra::{Isometry3, Point2};

/// How a recording becomes a room.
pub type Solve = Box<dyn Fn(&Recording) -> Result<Solved, String>>;

/// A recording and what is done with it.
pub struct Set {
    pub name: String,
    pub recording: Recording,
    /// Pictures a second, by which its times are frames.
    pub rate_hz: f64,
    /// Whether its lengths are in metres.
    pub is_metric: bool,
    pub solve: Solve,
}

pub const LENS: Freedom = Freedom { focal: true, k1: true, k2: true, ..Freedom::POSE };
const ALL: Freedom = Freedom { principal: true, decentering: true, aspect: true, ..LENS };
pub const FOCAL: Freedom = Freedom { focal: true, ..Freedom::POSE };

/// Those that are asked for, or why not.
pub fn all(root: Option<&Path>, wanted: &[String]) -> Vec<Result<Set, String>> {
    let mut sets = Vec::new();
    for it in wanted.iter().filter_map(|it| it.split_once('=')) {
        sets.push(observations(it.0, Path::new(it.1)));
    }
    let Some(root) = root else {
        sets.push(Err("FOVEATE_DATA is not set: no recording of others".to_owned()));
        return sets;
    };
    let is_wanted = |name: &str| wanted.is_empty() || wanted.iter().any(|it| name.starts_with(it.as_str()));
    let arctic = || points_dat(&root.join("s01_arctic_laser_4cam/reference_multicamselfcal"), 25.0, 1.0);
    let straw = || points_dat(&root.join("s02_strawlab_selfcal/DATA20100906_134124"), 10.0, 0.0);
    for (name, free) in [("focal", FOCAL), ("lens", LENS), ("all optics", ALL)] {
        let own = |set: &str| format!("{set} {name}");
        if is_wanted("s01") {
            sets.push(arctic().map(|it| light(own("s01"), it, 25.0, free)));
        }
        if is_wanted("s02") {
            sets.push(straw().map(|it| light(own("s02"), it, 10.0, free)));
        }
    }
    if is_wanted("s15") {
        for (name, free) in [("focal", FOCAL), ("focal, k1", Freedom { k1: true, ..FOCAL })] {
            sets.push(easy_wand(&root.join("s15_easywand_3cam"), free).map(|it| waved_wand(format!("s15 {name}"), it)));
        }
    }
    if is_wanted("s16") {
        sets.push(caliscope(&root.join("s16_caliscope_4cam_charuco"), Freedom::POSE, "s16 optics known"));
        sets.push(caliscope(&root.join("s16_caliscope_4cam_charuco"), ALL, "s16 all optics"));
    }
    sets
}

/// One waved light, from nothing.
pub fn light(name: String, recording: Recording, rate_hz: f64, free: Freedom) -> Set {
    let mut recording = recording;
    recording.cameras.iter_mut().for_each(|it| it.free = free);
    let solve: Solve = Box::new(|recording| {
        let options = NetworkOptions { focal_unknown: true, ..NetworkOptions::default() };
        from_nothing(recording, CalibrationTarget::Light, &options)
            .map(|it| it.solved)
            .map_err(|fault| fault.to_string())
    });
    Set { name, recording, rate_hz, is_metric: false, solve }
}

/// Length of the wand of s15, which nobody states: any serves.
const WAND: Wand = Wand { ends: [0, 1], length_m: 1.0, sigma_m: 0.0 };

fn waved_wand(name: String, recording: Recording) -> Set {
    let solve: Solve = Box::new(|recording| {
        let options = NetworkOptions { inlier_px: 15.0, max_focal_sigma: 0.2, ..NetworkOptions::default() };
        let network = from_nothing(recording, CalibrationTarget::Wand, &options).map_err(|fault| fault.to_string())?;
        let options = RefineOptions { sigma_px: network.sigma_px, ..RefineOptions::default() };
        wand::refine(&network.solved, &WAND, &options).map(|it| it.solved).map_err(|fault| fault.to_string())
    });
    Set { name, recording, rate_hz: 30.0, is_metric: true, solve }
}

fn guess(name: &str, image_size: [u32; 2], focal: [f64; 2]) -> CameraGuess {
    let intrinsics = Intrinsics { focal, principal: middle(image_size), skew: 0.0 };
    let camera =
        Camera { intrinsics, distortion: Distortion::default(), image_size, camera_from_world: Isometry3::identity() };
    CameraGuess { name: name.to_owned(), camera, free: Freedom::POSE }
}

fn spot(x: f64, y: f64, sigma_px: f64, label: Option<u32>) -> Spot {
    Spot { pixel: Point2::new(x, y), sigma_px, peak: 1.0, label }
}

fn numbers(path: &Path, separator: impl Fn(char) -> bool) -> Result<Vec<Vec<f64>>, String> {
    let text = std::fs::read_to_string(path).map_err(|fault| format!("`{}`: {fault}", path.display()))?;
    let row = |line: &str| line.split(&separator).filter_map(|it| it.trim().parse().ok()).collect();
    Ok(text.lines().map(row).filter(|it: &Vec<f64>| !it.is_empty()).collect())
}

/// Tables of MultiCamSelfCal, the top left pixel being `first`.
fn points_dat(folder: &Path, rate_hz: f64, first: f64) -> Result<Recording, String> {
    let read = |name: &str| numbers(&folder.join(name), char::is_whitespace);
    let (sizes, points, seen) = (read("Res.dat")?, read("points.dat")?, read("IdMat.dat")?);
    let mut recording = Recording::default();
    for (camera, (size, visible)) in sizes.iter().zip(&seen).enumerate() {
        let size = [size[0] as u32, size[1] as u32];
        recording.cameras.push(guess(&format!("cam{camera}"), size, guessed_focal(size, 1.0)));
        for (frame, visible) in visible.iter().enumerate() {
            let [x, y] = [0, 1].map(|row| points[3 * camera + row][frame] - first);
            let spots = if *visible > 0.5 && x.is_finite() { vec![spot(x, y, 0.5, None)] } else { Vec::new() };
            recording.camera_frames.push(CameraFrame { camera, time_s: frame as f64 / rate_hz, spots });
        }
    }
    recording.camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    Ok(recording)
}

/// Observations of one light as our own table has them; sizes of pictures from what is seen.
fn observations(name: &str, path: &Path) -> Result<Set, String> {
    let text = std::fs::read_to_string(path).map_err(|fault| format!("`{}`: {fault}", path.display()))?;
    let mut lines = text.lines();
    let head: Vec<&str> = lines.next().unwrap_or_default().split(',').collect();
    let column = |name: &str| {
        head.iter().position(|it| *it == name).ok_or_else(|| format!("`{}` has no column {name}", path.display()))
    };
    let [time, camera, x, y] = [column("time_s")?, column("camera")?, column("x_px")?, column("y_px")?];
    let mut recording = Recording::default();
    for line in lines {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |it: usize| cells.get(it).and_then(|it| it.parse::<f64>().ok());
        let (Some(time_s), Some(x), Some(y), Some(name)) = (number(time), number(x), number(y), cells.get(camera))
        else {
            continue;
        };
        let known = recording.cameras.iter().position(|it| it.name == *name);
        let camera = known.unwrap_or_else(|| {
            recording.cameras.push(guess(name, [640, 480], guessed_focal([640, 480], 1.0)));
            recording.cameras.len() - 1
        });
        recording.camera_frames.push(CameraFrame { camera, time_s, spots: vec![spot(x, y, 0.5, None)] });
    }
    recording.camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    Ok(light(name.to_owned(), recording, 25.0, LENS))
}

fn easy_wand(folder: &Path, free: Freedom) -> Result<Recording, String> {
    let profile = numbers(&folder.join("RGBsetup_profile.txt"), char::is_whitespace)?;
    let rows = numbers(&folder.join("wandpts.csv"), |it| it == ',')?;
    let cameras = profile.iter().map(|it| {
        let guess = guess(&format!("camera {}", it[0]), [it[2] as u32, it[3] as u32], [it[1]; 2]);
        CameraGuess { free, ..guess }
    });
    let mut recording = Recording { cameras: cameras.collect(), camera_frames: Vec::new() };
    for (frame, row) in rows.iter().enumerate() {
        for camera in 0..3 {
            let end = |end: usize| {
                let at = 6 * end + 2 * camera;
                let [x, y] = [*row.get(at)?, *row.get(at + 1)?];
                (x.is_finite() && y.is_finite()).then(|| spot(x, y, 1.0, Some(end as u32)))
            };
            let spots = [0, 1].into_iter().filter_map(end).collect();
            recording.camera_frames.push(CameraFrame { camera, time_s: frame as f64 / 30.0, spots });
        }
    }
    Ok(recording)
}

fn caliscope(folder: &Path, free: Freedom, name: &str) -> Result<Set, String> {
    let draft = Draft::load(&folder.join("camera_array.toml")).map_err(|fault| fault.to_string())?;
    let cameras = draft.calibration.cameras.iter().map(|it| {
        let mut camera = it.camera.clone();
        if free.focal {
            camera = guess(&it.name, camera.image_size, guessed_focal(camera.image_size, 1.0)).camera;
        }
        camera.camera_from_world = Isometry3::identity();
        CameraGuess { name: it.name.clone(), camera, free }
    });
    let mut recording = Recording { cameras: cameras.collect(), camera_frames: Vec::new() };
    let rows = numbers(&folder.join("calibration/extrinsic/CHARUCO/xy_CHARUCO.csv"), |it| it == ',')?;
    for row in &rows {
        let &[frame, camera, _, label, x, y, ..] = row.as_slice() else { continue };
        let (camera, time_s) = (camera as usize, frame / 6.0);
        let found = recording.camera_frames.iter_mut().find(|it| it.camera == camera && it.time_s == time_s);
        let seen = spot(x, y, 0.3, Some(label as u32));
        match found {
            Some(camera_frame) => camera_frame.spots.push(seen),
            None => recording.camera_frames.push(CameraFrame { camera, time_s, spots: vec![seen] }),
        }
    }
    recording.camera_frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    let focal_guessed = free.focal;
    let solve: Solve = Box::new(move |recording| {
        let board = Board::charuco(4, 5, 0.054).map_err(|fault| fault.to_string())?;
        let options = BoardOptions { focal_guessed, ..BoardOptions::default() };
        board::calibrate(recording, &board, &options).map(|it| it.solved).map_err(|fault| fault.to_string())
    });
    Ok(Set { name: name.to_owned(), recording, rate_hz: 6.0, is_metric: true, solve })
}
