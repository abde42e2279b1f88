//! Real recordings of waved lights, as a calibration gets them, and a simulated one.

use std::path::Path;

use foveate_calibration::network::{CalibrationTarget, NetworkOptions};
use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording};
use foveate_geometry::bundle::Freedom;

use crate::faulty::sets::{LENS, Set, guess, simulated, spot};

/// A recording with its name.
pub struct Recorded {
    /// What it is called in tables.
    pub name: &'static str,
    /// What is calibrated.
    pub set: Set,
    /// Whether its optics are stated, so that a wrong statement is a fault.
    pub optics_known: bool,
}

/// Those that lie below `root`, and the simulated one.
pub fn all(root: Option<&Path>) -> Vec<Recorded> {
    let mut sets = Vec::new();
    if let Some(root) = root {
        let arctic = root.join("s01_arctic_laser_4cam/reference_multicamselfcal");
        let straw = root.join("s02_strawlab_selfcal/DATA20100906_134124");
        let wand = root.join("s15_easywand_3cam");
        sets.extend(stated(&arctic));
        sets.extend(free("s01 laser, optics found", &arctic, 10.0));
        sets.extend(free("s02 arena, optics found", &straw, 10.0));
        sets.extend(easy_wand(&wand));
    }
    sets.push(Recorded { name: "simulated, 6 cameras", set: simulated(6, 1), optics_known: false });
    sets
}

fn numbers(path: &Path, separator: impl Fn(char) -> bool) -> Option<Vec<Vec<f64>>> {
    let text = std::fs::read_to_string(path).ok()?;
    let row = |line: &str| line.split(&separator).filter_map(|it| it.trim().parse().ok()).collect();
    Some(text.lines().map(row).filter(|it: &Vec<f64>| !it.is_empty()).collect())
}

/// Observations of MultiCamSelfCal, whose pixels count from 1.
fn points_dat(folder: &Path, rate_hz: f64) -> Option<(Vec<[u32; 2]>, Vec<CameraFrame>)> {
    let sizes = numbers(&folder.join("Res.dat"), char::is_whitespace)?;
    let points = numbers(&folder.join("points.dat"), char::is_whitespace)?;
    let seen = numbers(&folder.join("IdMat.dat"), char::is_whitespace)?;
    let mut camera_frames = Vec::new();
    for frame in 0..seen[0].len() {
        for camera in 0..seen.len() {
            let spots = match seen[camera][frame] > 0.0 {
                true => vec![spot(points[3 * camera][frame] - 1.0, points[3 * camera + 1][frame] - 1.0, None)],
                false => Vec::new(),
            };
            camera_frames.push(CameraFrame { camera, time_s: frame as f64 / rate_hz, spots });
        }
    }
    Some((sizes.iter().map(|it| [it[0] as u32, it[1] as u32]).collect(), camera_frames))
}

fn free(name: &'static str, folder: &Path, rate_hz: f64) -> Option<Recorded> {
    let (sizes, camera_frames) = points_dat(folder, rate_hz)?;
    let cameras = sizes.iter().enumerate().map(|(index, size)| guess(format!("cam{index}"), *size, None, LENS));
    let recording = Recording { cameras: cameras.collect(), camera_frames };
    let options = NetworkOptions { focal_unknown: true, ..NetworkOptions::default() };
    let set = Set { recording, sought: CalibrationTarget::Light, options };
    Some(Recorded { name, set, optics_known: false })
}

/// With the optics that came with the recording.
fn stated(folder: &Path) -> Option<Recorded> {
    let (_, camera_frames) = points_dat(folder, 10.0)?;
    let calibration = foveate_scene::Calibration::load(folder).ok()?;
    let cameras = calibration.cameras.iter().map(|it| CameraGuess {
        name: it.name.clone(),
        camera: it.camera.clone(),
        free: Freedom::POSE,
    });
    let recording = Recording { cameras: cameras.collect(), camera_frames };
    let options = NetworkOptions::default();
    let set = Set { recording, sought: CalibrationTarget::Light, options };
    Some(Recorded { name: "s01 laser, optics stated", set, optics_known: true })
}

fn easy_wand(folder: &Path) -> Option<Recorded> {
    let profile = numbers(&folder.join("RGBsetup_profile.txt"), char::is_whitespace)?;
    let rows = numbers(&folder.join("wandpts.csv"), |it| it == ',')?;
    let free = Freedom { focal: true, k1: true, ..Freedom::POSE };
    let of = |it: &Vec<f64>| guess(format!("cam{}", it[0]), [it[2] as u32, it[3] as u32], Some(it[1]), free);
    let mut camera_frames = Vec::new();
    for (frame, row) in rows.iter().enumerate() {
        for camera in 0..3 {
            let end = |end: usize| spot(row[6 * end + 2 * camera], row[6 * end + 2 * camera + 1], Some(end as u32));
            camera_frames.push(CameraFrame { camera, time_s: frame as f64, spots: vec![end(0), end(1)] });
        }
    }
    let recording = Recording { cameras: profile.iter().map(of).collect(), camera_frames };
    let options = NetworkOptions { inlier_px: 15.0, sigma_px: 1.0, max_focal_sigma: 0.2, ..NetworkOptions::default() };
    let set = Set { recording, sought: CalibrationTarget::Wand, options };
    Some(Recorded { name: "s15 wand, 3 cameras", set, optics_known: false })
}
