//! Labelled points, several in a picture: the joints of a person, the parts of an animal. Each label is a point of its own.
//!
//! Labels, by a person or a neural network, confuse left and right now and then. Where two labels may be swapped, the
//! spot of each is also a second choice for the other: it is used where the other cameras have the point there.

use std::collections::{BTreeMap, BTreeSet};

use super::moments::{Moment, View, are_triggered_together, of_light, of_pictures, tolerance_s};
use crate::recording::{CameraFrame, Recording};
use crate::solved::{ObservationRole, Solved};

/// Spots of one label in one picture that are two or more say nothing.
const ONE: usize = 1;

/// Observations of one label that show the point of another label.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Swapped {
    /// Index of the camera.
    pub camera: usize,
    /// Their label.
    pub labelled: u32,
    /// The label of the point that they show.
    pub shows: u32,
    /// Their number.
    pub count: usize,
    /// Number of all observations of that label in the camera.
    pub of: usize,
}

/// Moments of each label, by frame and then by label; looks are in order.
pub(super) fn moments(recording: &Recording, mirrored: &[[u32; 2]]) -> Vec<Moment> {
    let labels: BTreeSet<u32> =
        recording.camera_frames.iter().flat_map(|it| &it.spots).filter_map(|it| it.label).collect();
    let together = are_triggered_together(recording);
    let mut all: Vec<Moment> = Vec::new();
    for label in labels {
        let own = Recording { cameras: recording.cameras.clone(), camera_frames: looks_of(recording, label) };
        let moments = if together { of_pictures(&own) } else { of_light(&own) };
        all.extend(moments.into_iter().map(|it| Moment { label, ..it }));
    }
    number(&mut all, tolerance_s(recording));
    if together {
        offer(&mut all, mirrored);
    }
    all
}

fn looks_of(recording: &Recording, label: u32) -> Vec<CameraFrame> {
    let of = |camera_frame: &CameraFrame| {
        let spots: Vec<_> = camera_frame.spots.iter().filter(|it| it.label == Some(label)).copied().collect();
        CameraFrame { spots: if spots.len() == ONE { spots } else { Vec::new() }, ..*camera_frame }
    };
    recording.camera_frames.iter().map(of).collect()
}

/// Gives the moments of one time one number, and puts them in order.
fn number(moments: &mut [Moment], tolerance_s: f64) {
    moments.sort_by(|a, b| a.time_s.total_cmp(&b.time_s).then(a.label.cmp(&b.label)));
    let (mut frame, mut start_s) = (0, moments.first().map_or(0.0, |it| it.time_s));
    let mut seen = BTreeSet::new();
    for moment in moments.iter_mut() {
        if moment.time_s - start_s > tolerance_s || !seen.insert(moment.label) {
            (frame, start_s) = (frame + 1, moment.time_s);
            seen = BTreeSet::from([moment.label]);
        }
        moment.frame = frame;
    }
    moments.sort_by_key(|it| (it.frame, it.label));
}

/// Adds the spot of the mirrored label to each observation, as a second choice.
fn offer(moments: &mut [Moment], mirrored: &[[u32; 2]]) {
    let of = |label: u32| {
        mirrored.iter().find_map(|&[left, right]| match label {
            it if it == left => Some(right),
            it if it == right => Some(left),
            _ => None,
        })
    };
    let mut spots = BTreeMap::new();
    for moment in moments.iter() {
        for view in &moment.views {
            spots.insert((moment.frame, moment.label, view.camera), view.spots[0]);
        }
    }
    for moment in moments.iter_mut() {
        let Some(other) = of(moment.label) else { continue };
        for View { camera, spots: own, .. } in &mut moment.views {
            own.extend(spots.get(&(moment.frame, other, *camera)));
        }
    }
}

/// Lists swapped labels: observations whose label in `recording` differs from that of the same pixels in `solved`.
pub fn swapped(recording: &Recording, solved: &Solved) -> Vec<Swapped> {
    let bits = |it: &nalgebra::Point2<f64>| [it.x.to_bits(), it.y.to_bits()];
    let mut labels: BTreeMap<(usize, [u64; 2]), u32> = BTreeMap::new();
    let mut of: BTreeMap<(usize, u32), usize> = BTreeMap::new();
    for camera_frame in &recording.camera_frames {
        for spot in &camera_frame.spots {
            if let Some(label) = spot.label {
                labels.insert((camera_frame.camera, bits(&spot.pixel)), label);
                *of.entry((camera_frame.camera, label)).or_default() += 1;
            }
        }
    }
    let mut counts: BTreeMap<(usize, u32, u32), usize> = BTreeMap::new();
    for it in
        solved.observations.iter().filter(|it| matches!(it.role, ObservationRole::Used | ObservationRole::HeldOut))
    {
        let shows = it.point.map(|it| solved.points[it].label);
        let Some((shows, labelled)) = shows.zip(labels.get(&(it.camera, bits(&it.pixel))).copied()) else { continue };
        if shows != labelled {
            *counts.entry((it.camera, labelled, shows)).or_default() += 1;
        }
    }
    let one = |((camera, labelled, shows), count): ((usize, u32, u32), usize)| Swapped {
        camera,
        labelled,
        shows,
        count,
        of: of.get(&(camera, labelled)).copied().unwrap_or(count),
    };
    counts.into_iter().map(one).collect()
}

#[cfg(test)]
mod tests {
    use foveate_estimation::Random;
    use foveate_geometry::{Camera, CameraStatus, Freedom};
    use nalgebra::{Point3, UnitQuaternion, Vector3};

    use super::super::{CalibrationTarget, NetworkOptions, from_nothing, recalibrate};
    use super::*;
    use crate::recording::{CameraGuess, Spot};
    use crate::solved::FixedFreedoms;

    /// Hips 0 and 1, knees 2 and 3, ankles 4 and 5, head 6: even numbers are left.
    const MIRRORED: [[u32; 2]; 3] = [[0, 1], [2, 3], [4, 5]];

    /// Where a walker's joint is.
    fn joint(label: u32, time_s: f64) -> Point3<f64> {
        let heading = 0.5 * time_s;
        let on_floor = Vector3::new(1.2 * heading.cos() + 0.3 * (0.31 * time_s).sin(), 1.5 * heading.sin(), 0.0);
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), heading);
        let side = if label.is_multiple_of(2) { 0.12 } else { -0.12 };
        let swing = 0.4 * (6.0 * time_s + if label.is_multiple_of(2) { 0.0 } else { std::f64::consts::PI }).sin();
        let at = match label / 2 {
            0 => Vector3::new(side, 0.0, 0.95 + 0.03 * (12.0 * time_s).sin()),
            1 => Vector3::new(side, 0.5 * swing, 0.5),
            2 => Vector3::new(side, swing, 0.1 + 0.08 * swing.abs()),
            _ => Vector3::new(0.0, 0.0, 1.7),
        };
        Point3::from(on_floor + turn * at)
    }

    fn cameras() -> Vec<Camera> {
        let camera = |index: usize| {
            let angle = 1.6 * index as f64 + 0.3;
            let centre = Point3::new(4.5 * angle.cos(), 4.0 * angle.sin(), 1.6 + 0.3 * index as f64);
            Camera::look_at(centre, Point3::new(0.0, 0.0, 0.9), [1280, 720], 900.0)
        };
        (0..4).map(camera).collect()
    }

    /// Noise of 2 px, a tenth of the points missing, one in twenty on something else, and of camera 2 every fifth frame with left and right swapped.
    fn recording() -> Recording {
        let mut random = Random::new(3).fork("walker");
        let (truth, mut camera_frames) = (cameras(), Vec::new());
        for frame in 0..400 {
            let time_s = f64::from(frame) / 30.0;
            for (camera, model) in truth.iter().enumerate() {
                let is_swapped = camera == 2 && frame % 5 == 0;
                let mut spots = Vec::new();
                for label in 0..7_u32 {
                    let Some(seen) = model.sees(&joint(label, time_s)) else { continue };
                    let mut pixel = seen + nalgebra::Vector2::new(random.normal(), random.normal()) * 2.0;
                    if random.uniform() < 0.05 {
                        pixel.x += 200.0 * random.normal();
                    }
                    let told = if is_swapped && label < 6 { label ^ 1 } else { label };
                    if random.uniform() > 0.1 && model.has_pixel(&pixel) {
                        spots.push(Spot { pixel, sigma_px: 2.0, peak: 0.0, label: Some(told) });
                    }
                }
                camera_frames.push(CameraFrame { camera, time_s, spots });
            }
        }
        let guess = |(index, it): (usize, &Camera)| CameraGuess {
            name: format!("cam{index}"),
            camera: Camera { camera_from_world: Default::default(), ..it.clone() },
            free: Freedom::POSE,
        };
        Recording { cameras: truth.iter().enumerate().map(guess).collect(), camera_frames }
    }

    fn solver_options() -> NetworkOptions {
        NetworkOptions { sigma_px: 2.0, inlier_px: 10.0, ..NetworkOptions::default() }
    }

    #[test]
    fn a_walker_calibrates_from_nothing_and_swapped_sides_are_told() {
        let recording = recording();
        let network =
            from_nothing(&recording, CalibrationTarget::Labels { mirrored: &MIRRORED }, &solver_options()).unwrap();
        let found: Vec<Camera> = network.solved.cameras.iter().map(|it| it.camera.clone()).collect();
        assert!(network.solved.cameras.iter().all(|it| it.status == CameraStatus::Calibrated));
        let options = foveate_geometry::AlignmentOptions { scale: true, robust: false };
        let errors = foveate_geometry::camera_errors(&found, &cameras(), options).unwrap();
        println!("centres {:.4?} m, turns {:.5?} rad", errors.centres, errors.rotations);
        assert!(
            errors.centres.iter().all(|it| *it < 0.03) && errors.rotations.iter().all(|it| *it < 4e-3),
            "{errors:?}"
        );
        let found = swapped(&recording, &network.solved);
        let of_camera =
            |camera: usize| -> usize { found.iter().filter(|it| it.camera == camera).map(|it| it.count).sum() };
        // 80 frames of six labels, less those that are missing, off, or nearer to the other side than can be told: more than half of 480.
        assert!(of_camera(2) > 240, "{found:?}");
        assert!((0..4).filter(|it| *it != 2).all(|it| of_camera(it) < 30), "{found:?}");
        // Without knowing who may be taken for whom, they are rejected.
        let plain = from_nothing(&recording, CalibrationTarget::Labels { mirrored: &[] }, &solver_options()).unwrap();
        assert!(swapped(&recording, &plain.solved).is_empty());
        let used = |network: &super::super::SolvedNetwork| {
            network.solved.observations.iter().filter(|it| it.role == ObservationRole::Used).count()
        };
        assert!(used(&network) > used(&plain) + 200, "{} {}", used(&network), used(&plain));
    }

    #[test]
    fn an_older_calibration_is_adjusted_by_labels() {
        let mut recording = recording();
        for (guess, truth) in recording.cameras.iter_mut().zip(cameras()) {
            guess.camera = truth;
        }
        recording.cameras[1].camera.camera_from_world *= nalgebra::Translation3::new(0.2, 0.1, 0.0);
        let sought = CalibrationTarget::Labels { mirrored: &MIRRORED };
        let network = recalibrate(&recording, sought, &FixedFreedoms::default(), &solver_options()).unwrap();
        assert_eq!(network.moved.iter().map(|it| it.camera).collect::<Vec<_>>(), [1]);
        let off = (network.solved.cameras[1].camera.centre() - cameras()[1].centre()).norm();
        assert!(off < 0.03, "{off}");
    }

    #[test]
    fn two_spots_of_one_label_in_a_picture_say_nothing() {
        let mut recording = recording();
        recording.camera_frames.truncate(4);
        let extra = recording.camera_frames[0].spots[0];
        let before = moments(&recording, &[]).iter().find(|it| Some(it.label) == extra.label).unwrap().views.len();
        recording.camera_frames[0].spots.push(extra);
        let after = moments(&recording, &[]).iter().find(|it| Some(it.label) == extra.label).unwrap().views.len();
        assert_eq!(after + 1, before);
    }
}
