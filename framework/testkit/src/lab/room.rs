//! The room of the lab, its cameras, and a person who walks through it.

use std::f64::consts::{PI, TAU};

use foveate_geometry::Camera;
use nalgebra::{Point3, Vector3};

use super::Light;

/// Opposite corners of the volume in which lights move [m].
pub const ROOM_M: [[f64; 3]; 2] = [[-1.75, -2.5, 0.0], [1.75, 2.5, 2.2]];

/// `n` cameras at 2.7 m around a room of 3.5 m × 5 m, looking at its middle; fields of 640 × 240 px.
pub fn cameras(n: usize) -> Vec<Camera> {
    (0..n)
        .map(|i| {
            let angle = TAU * i as f64 / n as f64;
            // On the walls of the room, not on a circle.
            let (s, c) = angle.sin_cos();
            let reach = (1.75 / c.abs().max(1e-9)).min(2.5 / s.abs().max(1e-9));
            let centre = Point3::new(c * reach, s * reach, 2.7);
            let mut camera = Camera::look_at(centre, Point3::new(0.0, 0.0, 1.1), [640, 240], 420.0);
            camera.intrinsics.focal = [420.0, 210.0];
            camera
        })
        .collect()
}

/// The lights of a walking person at time `t` [s]: head, shoulders, elbows, wrists, waist.
pub fn person(t: f64) -> [Light; 8] {
    let pace = 0.9; // around an ellipse of 1.0 m × 1.5 m: about 1 m/s
    let (a, b) = (0.9, 1.4);
    let phase = pace * t;
    let centre = Point3::new(a * phase.cos(), b * phase.sin(), 0.0);
    let heading = Vector3::new(-a * phase.sin(), b * phase.cos(), 0.0).normalize();
    let left = Vector3::z().cross(&heading);
    let step = TAU * 0.9 * t;
    let bob = 0.02 * (2.0 * step).sin();
    let swing = |side: f64, length: f64| heading * (0.35 * length * (step + side * PI / 2.0).sin());
    let at = |forward: f64, aside: f64, up: f64, moved: Vector3<f64>, normal: Vector3<f64>| {
        let place = centre + heading * forward + left * aside + Vector3::z() * (up + bob) + moved;
        Light { position: place, normal }
    };
    let none = Vector3::zeros();
    [
        at(0.0, 0.0, 1.75, none, Vector3::z()),
        at(0.0, 0.20, 1.45, none, left + Vector3::z()),
        at(0.0, -0.20, 1.45, none, -left + Vector3::z()),
        at(-0.03, 0.28, 1.15, swing(1.0, 0.4), left - heading * 0.5),
        at(-0.03, -0.28, 1.15, swing(-1.0, 0.4), -left - heading * 0.5),
        at(0.03, 0.30, 0.90, swing(1.0, 1.0), left + heading * 0.5),
        at(0.03, -0.30, 0.90, swing(-1.0, 1.0), -left + heading * 0.5),
        at(0.12, 0.0, 1.0, none, heading),
    ]
}
