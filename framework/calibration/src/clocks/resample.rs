//! Resamples a recording of labelled points by unsynchronised cameras to common moments.

use std::collections::BTreeSet;

use super::frames::{Clock, FrameOptions, at_moments, moments};
use super::track::{Track, brightest};
use crate::recording::{CameraFrame, Recording, Spot};
use crate::solved::ClockFit;

/// The recording at common moments, in the network's time: each label's path is interpolated between the pictures of a camera, as
/// [`frames`](super::frames) does it for one light. Cameras without a clock (`None`) and spots without a label are left out.
///
/// Each label is a path of its own in each camera; if a picture has several spots with one label, the brightest is used.
pub fn on_one_clock(recording: &Recording, clocks: &[Option<ClockFit>], options: &FrameOptions) -> Recording {
    let clocks: Vec<Option<Clock>> = clocks.iter().map(|it| it.as_ref().map(Clock::of)).collect();
    let times_s = moments(&brightest(recording), &clocks, options.max_frames);
    let labels: BTreeSet<u32> =
        recording.camera_frames.iter().flat_map(|it| &it.spots).filter_map(|it| it.label).collect();
    let n = recording.cameras.len();
    let mut spots: Vec<Vec<Spot>> = vec![Vec::new(); times_s.len() * n];
    for label in labels {
        let tracks = brightest(&only(recording, label));
        let smooth: Vec<Track> = tracks.iter().map(|it| it.smooth(options.max_gap_s)).collect();
        let seen = at_moments(&tracks, &smooth, &clocks, times_s.clone(), options);
        for (it, sigma_px) in seen.observations.iter().zip(seen.sigmas_px) {
            let spot = Spot { pixel: it.pixel, sigma_px, peak: 1.0, label: Some(label) };
            spots[it.frame * n + it.camera].push(spot);
        }
    }
    let mut spots = spots.into_iter();
    let mut camera_frames = Vec::with_capacity(spots.len());
    for time_s in times_s {
        let of_frame = spots.by_ref().take(n).enumerate().filter(|it| clocks.get(it.0).copied().flatten().is_some());
        camera_frames.extend(of_frame.map(|(camera, spots)| CameraFrame { camera, time_s, spots }));
    }
    Recording { cameras: recording.cameras.clone(), camera_frames }
}

/// The paths of `labels` one after another, as that of one light, with pauses between them that no clock bridges.
pub(crate) fn in_turn(recording: &Recording, labels: &[u32], max_offset_s: f64) -> Recording {
    let times = || recording.camera_frames.iter().map(|it| it.time_s);
    let (first, last) = (times().fold(f64::INFINITY, f64::min), times().fold(f64::NEG_INFINITY, f64::max));
    let later_s = (last - first).max(0.0) + 4.0 * max_offset_s + 10.0;
    let of_label = |(turn, label): (usize, &u32)| {
        let mut camera_frames = only(recording, *label).camera_frames;
        camera_frames.iter_mut().for_each(|it| it.time_s += turn as f64 * later_s);
        camera_frames
    };
    Recording {
        cameras: recording.cameras.clone(),
        camera_frames: labels.iter().enumerate().flat_map(of_label).collect(),
    }
}

/// All pictures with what they show of one label.
fn only(recording: &Recording, label: u32) -> Recording {
    let camera_frame = |it: &CameraFrame| CameraFrame {
        camera: it.camera,
        time_s: it.time_s,
        spots: it.spots.iter().filter(|it| it.label == Some(label)).copied().collect(),
    };
    Recording {
        cameras: recording.cameras.clone(),
        camera_frames: recording.camera_frames.iter().map(camera_frame).collect(),
    }
}
