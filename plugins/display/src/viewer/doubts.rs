//! Checks of the settings of `viewer` against a run: lights that are mirrored, misplaced or in other axes give wrong views without any other symptom.

use foveate::prelude::*;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};

use crate::head::Head;

/// Mirrored lights are tried in one of this many messages in which a light is missing.
const TRY_EACH: u64 = 16;
/// Fewest messages for a remark.
const LEAST_MESSAGES: u64 = 30;
/// A light that is seen in less than this share of the messages, while another is in most, is misplaced in the settings.
const RARE: f64 = 0.02;
const OFTEN: f64 = 0.5;
/// Largest mean angle between a viewer's gaze and the display [deg].
const BESIDE_DEG: f64 = 75.0;
/// Largest mean tilt of a viewer's head [deg].
const MOST_TILT_DEG: f64 = 50.0;
/// With a shorter mean vector, people turn too much for a mean direction.
const TURNS_ABOUT: f64 = 0.3;

/// Statistics of the messages.
pub(super) struct Doubts {
    /// The same lights with left and right exchanged, where these can be distinguished: four or more, not in one plane.
    mirrored: Option<Head>,
    n_lights: usize,
    n_messages: u64,
    /// By light, in how many of them it was found.
    n_seen: Vec<u64>,
    /// Messages in which a light was missing, those of them in which mirrored lights were tried, and in which all of these fitted.
    n_partly: u64,
    n_tried: u64,
    n_mirrored: u64,
    /// Sums of the head's gaze and of its up direction.
    forward: Vector3<f64>,
    up: Vector3<f64>,
}

impl Doubts {
    pub(super) fn new(lights: &[Point3<f64>], tolerance: f64, start: UnitQuaternion<f64>) -> Doubts {
        let flipped: Vec<Point3<f64>> = lights.iter().map(|it| Point3::new(it.x, -it.y, it.z)).collect();
        Doubts {
            mirrored: (lights.len() > 3).then(|| Head::new(flipped, tolerance, start)),
            n_lights: lights.len(),
            n_messages: 0,
            n_seen: vec![0; lights.len()],
            n_partly: 0,
            n_tried: 0,
            n_mirrored: 0,
            forward: Vector3::zeros(),
            up: Vector3::zeros(),
        }
    }

    /// A message in which the head was found.
    pub(super) fn add(&mut self, head: &Head, space_from_head: &Isometry3<f64>, targets: &[Target]) {
        self.n_messages += 1;
        let mut n = 0;
        for (light, _) in head.seen(targets) {
            self.n_seen[light] += 1;
            n += 1;
        }
        self.forward += space_from_head * Vector3::x();
        self.up += space_from_head * Vector3::z();
        let Some(mirrored) = self.mirrored.as_mut().filter(|_| n < self.n_lights) else { return };
        if self.n_partly.is_multiple_of(TRY_EACH) {
            mirrored.forget();
            self.n_tried += 1;
            let is_found = mirrored.find(targets).is_some() && mirrored.seen(targets).count() == self.n_lights;
            self.n_mirrored += u64::from(is_found);
        }
        self.n_partly += 1;
    }

    /// The remarks; `out` is the mean normal of the tiles.
    pub(super) fn remarks(&self, out: &Vector3<f64>) -> Vec<String> {
        if self.n_messages < LEAST_MESSAGES {
            return Vec::new();
        }
        let n = self.n_messages as f64;
        if 2 * self.n_mirrored > self.n_tried && self.n_tried > 0 {
            return vec![format!(
                "all {} lights fit `lights_mm` with left and right exchanged, but not as stated: expected x forward, y to the left, z up",
                self.n_lights
            )];
        }
        let mut told = Vec::new();
        let share = |it: &u64| *it as f64 / n;
        if self.n_seen.iter().any(|it| share(it) > OFTEN) {
            for (light, _) in self.n_seen.iter().enumerate().filter(|it| share(it.1) < RARE) {
                told.push(format!(
                    "light {} of `lights_mm` was rarely found at its place on the head, while others were: is its position right, and is it lit?",
                    light + 1
                ));
            }
        }
        let tilt = self.up.angle(&Vector3::z()).to_degrees();
        if tilt > MOST_TILT_DEG {
            told.push(format!(
                "in the mean the head's crown pointed {tilt:.0}° from straight up: `lights_mm` may be mirrored or in other axes; expected x forward, y to the left, z up"
            ));
        }
        let beside = self.forward.angle(&-out).to_degrees();
        if self.forward.norm() > TURNS_ABOUT * n && beside > BESIDE_DEG {
            told.push(format!(
                "in the mean the head looked {beside:.0}° past the display: `lights_mm` may be mirrored or in other axes; expected x forward, y to the left, z up"
            ));
        }
        told
    }
}
