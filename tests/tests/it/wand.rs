//! A wand that others waved: told apart without its labels, and as long in held-out frames as in the others.

use foveate_calibration::recording::{CameraFrame, CameraGuess, Recording, Spot};
use foveate_calibration::wand::{self, LabelOptions, RefineOptions, Wand};
use foveate_testkit::data_dir_or_skip;
use nalgebra::{Isometry3, Point2};

use foveate::geometry::bundle::Freedom;
use foveate::geometry::self_calibration::SelfCalibrationOptions;
use foveate::geometry::{Camera, CameraStatus, Distortion, Intrinsics};

fn numbers(text: &str, separator: char) -> Vec<Vec<f64>> {
    text.lines().map(|line| line.split(separator).filter_map(|it| it.trim().parse().ok()).collect()).collect()
}

/// The cameras with their guessed focal lengths, and the wand with its ends under the labels 0 and 1.
fn recording(profile: &str, rows: &str) -> Recording {
    let cameras = numbers(profile, ' ').into_iter().filter(|it| it.len() == 7).map(|it| {
        let intrinsics = Intrinsics { focal: [it[1]; 2], principal: [it[4], it[5]], skew: 0.0 };
        let (distortion, image_size) = (Distortion::default(), [it[2] as u32, it[3] as u32]);
        let camera = Camera { intrinsics, distortion, image_size, camera_from_world: Isometry3::identity() };
        let free = Freedom { focal: true, k1: true, ..Freedom::POSE };
        CameraGuess { name: format!("camera {}", it[0]), camera, free }
    });
    let mut camera_frames = Vec::new();
    for (frame, row) in numbers(rows, ',').iter().enumerate().filter(|it| it.1.len() == 12) {
        for camera in 0..3 {
            let spot = |end: usize| Spot {
                pixel: Point2::new(row[6 * end + 2 * camera], row[6 * end + 2 * camera + 1]),
                sigma_px: 1.0,
                peak: 1.0,
                label: Some(end as u32),
            };
            // In one picture of two the second end comes first, in each camera in another one.
            let order = if (frame >> camera) % 2 == 0 { [0, 1] } else { [1, 0] };
            camera_frames.push(CameraFrame { camera, time_s: frame as f64, spots: order.map(spot).to_vec() });
        }
    }
    Recording { cameras: cameras.collect(), camera_frames }
}

#[test]
fn a_real_wand_is_told_apart_and_keeps_its_length_where_it_was_held_out() {
    let Some(folder) = data_dir_or_skip("the wand", "s15_easywand_3cam") else { return };
    let read = |name: &str| std::fs::read_to_string(folder.join(name)).unwrap();
    let given = recording(&read("RGBsetup_profile.txt"), &read("wandpts.csv"));
    assert_eq!((given.cameras.len(), given.camera_frames.len()), (3, 150));
    let mut bare = given.clone();
    bare.camera_frames.iter_mut().flat_map(|it| &mut it.spots).for_each(|it| it.label = None);
    let frames = wand::frames_by_time(&bare, 0.5);
    // The focal lengths are guesses, so that right pixels are some way off their lines.
    let options = LabelOptions { sigma_px: 3.0, inlier_px: 15.0, ..LabelOptions::default() };
    let found = wand::label(&bare, &frames, &options).unwrap();
    let mut wrong = 0;
    for (found, given) in found.recording.camera_frames.chunks(3).zip(given.camera_frames.chunks(3)) {
        let differs = |it: &(&CameraFrame, &CameraFrame)| {
            it.0.spots
                .iter()
                .any(|spot| it.1.spots.iter().any(|own| own.pixel == spot.pixel && own.label != spot.label))
        };
        let exchanged = found.iter().zip(given).filter(differs).count();
        wrong += exchanged.min(3 - exchanged);
    }
    assert!(wrong <= 2 && found.whole >= 140, "{wrong} wrong, {} whole", found.whole);

    let all = wand::observations(&given, &frames);
    let (fit, held): (Vec<_>, Vec<_>) = all.into_iter().partition(|it| it.frame % 2 == 0);
    let options = SelfCalibrationOptions {
        sigma_px: 1.0,
        inlier_px: 15.0,
        max_focal_sigma: 0.2,
        ..SelfCalibrationOptions::default()
    };
    let mut start = wand::solve(&given.cameras, &fit, &options).unwrap();
    assert!(start.cameras.iter().all(|it| it.status == CameraStatus::Calibrated));
    start.cameras.iter_mut().zip(&given.cameras).for_each(|(it, given)| it.freed = given.free);
    let unit = Wand { ends: [0, 1], length_m: 1.0, sigma_m: 0.0 };
    let refine = RefineOptions { sigma_px: 1.0, frame_sigma: 3e-3, ..RefineOptions::default() };
    let refined = wand::refine(&start, &unit, &refine).unwrap();
    let measured = wand::lengths(&wand::intersect(&refined.solved.cameras, &held), [0, 1]).unwrap();
    // A bundle adjustment without the length and without distortion leaves 0.9 %.
    assert!(measured.spread < 5e-3 && (measured.mean - 1.0).abs() < 2e-3, "{} {}", measured.spread, measured.mean);
}
