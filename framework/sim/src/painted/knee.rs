//! A knee [Davis 2002 §6.1]: a piece of leg around it, its skin between thigh and shank, that bulges and slides as the knee bends.
//!
//! Its space is that of the thigh: x ahead, y to the left, z up along the thigh, the origin in the joint. The shank is what
//! [`Surface::follow`] follows. Millimetres where nothing else is said.

use std::f64::consts::PI;

use foveate_estimation::random::Random;
use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

use super::head::{bell, smooth};
use super::surface::{Material, Mode, Spot, Surface, Triangle};
use super::texture::noise;
use crate::person::{BodyPart, Pose};

/// Thigh and shank among the parts of a [`Pose`]: those of the right leg.
pub(super) const PARTS: [usize; 2] = [12, 14];
/// How much of thigh and shank the surface stands in for [m].
const REACH_M: f64 = 0.2;

/// Height, how far ahead and behind the leg's axis, half the width.
const PROFILE: [[f64; 4]; 9] = [
    [185.0, 72.0, 70.0, 71.0],
    [120.0, 67.0, 62.0, 64.0],
    [60.0, 59.0, 52.0, 57.0],
    [20.0, 56.0, 46.0, 57.0],
    [-10.0, 55.0, 44.0, 56.0],
    [-45.0, 51.0, 46.0, 53.0],
    [-90.0, 46.0, 58.0, 54.0],
    [-140.0, 42.0, 62.0, 53.0],
    [-190.0, 40.0, 56.0, 49.0],
];
/// Between rows, and between columns ahead and behind.
const ROW: f64 = 6.0;
const COLUMNS: [[f64; 2]; 2] = [[100.0, 6.25], [180.0, 16.0]];
const TEXEL: f64 = 0.42;

/// The piece of leg, and the size of its texture [texel].
pub(super) fn knee() -> (Surface, [usize; 2]) {
    let n_rows = ((PROFILE[0][0] - PROFILE[8][0]) / ROW) as usize + 1;
    let mut half = vec![0.0];
    for [end, step] in COLUMNS {
        let start = half[half.len() - 1];
        let n = ((end - start) / step) as usize;
        half.extend((1..=n).map(|i| start + (end - start) * i as f64 / n as f64));
    }
    let azimuths: Vec<f64> = half.iter().rev().map(|it| -it).chain(half[1..half.len() - 1].iter().copied()).collect();
    let n_columns = azimuths.len();
    let mut rest = Vec::new();
    for row in 0..n_rows {
        rest.extend(azimuths.iter().map(|azimuth| leg(azimuth * PI / 180.0, PROFILE[0][0] - ROW * row as f64)));
    }
    // Lengths around the widest part.
    let across: Vec<f32> =
        azimuths.iter().chain(&[180.0]).map(|it| ((it + 180.0) * PI / 180.0 * 60.0 / TEXEL) as f32 + 4.0).collect();
    let down = |row: usize| (ROW * row as f64 / TEXEL) as f32 + 4.0;
    let mut triangles = Vec::new();
    for (row, column) in (0..n_rows - 1).flat_map(|row| (0..n_columns).map(move |column| (row, column))) {
        let next = (column + 1) % n_columns;
        let corner = |row: usize, column: usize| (row * n_columns + column) as u32;
        let [a, b] = [row, row + 1].map(|row| (corner(row, column), [across[column], down(row)]));
        let [d, c] = [row, row + 1].map(|row| (corner(row, next), [across[column + 1], down(row)]));
        for of in [[a, b, c], [a, c, d]] {
            let (corners, texels) = (of.map(|it| it.0), of.map(|it| it.1));
            triangles.push(Triangle { corners, texels, material: Material::Skin });
        }
    }
    let size = [across[n_columns] as usize + 6, down(n_rows) as usize + 6];
    let follow = rest.iter().map(|it: &Point3<f64>| smooth((38.0 - it.z) / 76.0)).collect();
    let modes = modes(&rest);
    let rest = rest.into_iter().map(|it| it * 1e-3).collect();
    let mut surface = Surface { rest, triangles, modes, follow, openness: Vec::new() };
    surface.open();
    (surface, size)
}

/// The leg at an azimuth [rad] and a height.
fn leg(azimuth: f64, z: f64) -> Point3<f64> {
    let place = PROFILE.iter().position(|row| row[0] < z).unwrap_or(PROFILE.len() - 1).max(1);
    let (a, b) = (PROFILE[place - 1], PROFILE[place]);
    let t = smooth((a[0] - z) / (a[0] - b[0]));
    let [ahead, behind, wide] = [1, 2, 3].map(|of| a[of] + (b[of] - a[of]) * t);
    let (sine, cosine) = azimuth.sin_cos();
    let along = if cosine > 0.0 { ahead } else { behind };
    let p = Point3::new(along * cosine, wide * sine, z);
    // The kneecap, the tendon below it, and where that ends; hollows beside.
    let front = smooth(p.x / 30.0);
    let out = 6.5 * bell(p.y, 19.0) * bell(z - 8.0, 19.0) + 4.0 * bell(p.y, 9.0) * bell(z + 52.0, 12.0)
        - 3.0 * bell(p.y.abs() - 33.0, 9.0) * bell(z + 4.0, 20.0)
        + 3.5 * bell(p.y.abs() - 36.0, 14.0) * bell(z - 62.0, 24.0);
    p + Vector3::new(cosine, sine, 0.0) * (out * front)
}

/// What bending and pulling do to the skin.
fn modes(rest: &[Point3<f64>]) -> Vec<Mode> {
    let mode = |name: &str, by: &dyn Fn(&Point3<f64>) -> Vector3<f64>| {
        let moved = rest.iter().enumerate().map(|(i, p)| (i as u32, by(p)));
        let moves = moved.filter(|(_, by)| by.norm() > 0.02).map(|(i, by)| (i, by * 1e-3)).collect();
        Mode { name: name.to_owned(), moves }
    };
    let front = |p: &Point3<f64>| smooth((p.x - 5.0) / 35.0);
    vec![
        // The kneecap sinks between the bones, and the joint's corners come out beside it.
        mode("bend", &|p| {
            let cap = -9.0 * bell(p.y, 20.0) * bell(p.z - 18.0, 20.0);
            let corners = 8.0 * bell(p.y.abs() - 26.0, 14.0) * bell(p.z - 6.0, 26.0);
            Vector3::x() * ((cap + corners) * front(p))
        }),
        // Skin slides over the kneecap, down from above.
        mode("slide", &|p| Vector3::z() * (-11.0 * front(p) * bell(p.z - 25.0, 38.0))),
        // The muscles above it tighten.
        mode("pull", &|p| {
            let inner = 7.0 * bell(p.y - 34.0, 17.0) * bell(p.z - 58.0, 22.0);
            let outer = 5.0 * bell(p.y + 32.0, 17.0) * bell(p.z - 72.0, 24.0);
            let cap = 3.5 * bell(p.y, 18.0) * bell(p.z - 8.0, 18.0);
            Vector3::new(inner + outer, (inner - outer) * 0.4, cap) * front(p)
        }),
    ]
}

/// Weights of the modes on the body `pose`.
pub(super) fn weights(pose: &Pose, weights: &mut Vec<f64>) {
    let [thigh, shank] = axes(pose);
    let bent = thigh.dot(&shank).clamp(-1.0, 1.0).acos();
    let lifted = -thigh.dot(&pose.forward);
    let bend = smooth(bent / 1.1);
    weights.clear();
    weights.extend([bend, (bent / 1.1).min(1.2), smooth(0.35 + 0.9 * lifted - 0.5 * bend)]);
}

/// Up along thigh and shank, of length 1.
fn axes(pose: &Pose) -> [Vector3<f64>; 2] {
    PARTS.map(|it| (pose.parts[it].ends[0] - pose.parts[it].ends[1]).normalize())
}

/// From the spaces of thigh and shank (that of a straight leg) to the world.
pub(super) fn frames(pose: &Pose) -> [Isometry3<f64>; 2] {
    let joint = pose.parts[PARTS[1]].ends[0];
    axes(pose).map(|up| {
        let left = Vector3::z().cross(&pose.forward);
        let left = (left - up * left.dot(&up)).normalize();
        let turn = Rotation3::from_matrix_unchecked(Matrix3::from_columns(&[left.cross(&up), left, up]));
        Isometry3::from_parts(Translation3::from(joint), UnitQuaternion::from_rotation_matrix(&turn))
    })
}

/// What is left of a part of the body beside the surface.
pub(super) fn beside(part: usize, body: BodyPart) -> BodyPart {
    let [a, b] = body.ends;
    let share = (REACH_M / (b - a).norm()).min(0.9);
    match part {
        _ if part == PARTS[0] => BodyPart { ends: [a, b + (a - b) * share], ..body },
        _ if part == PARTS[1] => BodyPart { ends: [a + (b - a) * share, b], ..body },
        _ => body,
    }
}

/// Spots of the first `n` marks: nine rows of five, as uneven as painted by hand. An even grid looks the same when it is shifted by one row, so that its marks
/// could not be distinguished.
pub(super) fn spots(surface: &Surface, n: usize) -> Vec<Spot> {
    let rows = (0..9).flat_map(|row| [0.0, 21.0, -21.0, 40.0, -40.0].map(|y| [y, 82.0 - 20.0 * f64::from(row)]));
    let mut hand = Random::new(45);
    let mut uneven = |[y, z]: [f64; 2]| [y + hand.uniform_in(-3.5, 3.5), z + hand.uniform_in(-3.5, 3.5)];
    rows.map(&mut uneven).filter_map(|[y, z]| surface.spot_from_ahead(y * 1e-3, z * 1e-3)).take(n).collect()
}

/// How bright the leg is at `p` [m]: skin between shorts and a long sock.
pub(super) fn albedo(p: &Point3<f64>, seed: u32) -> f32 {
    let grain = |size: f64, number: u32| noise(p, [size * 1e-3; 3], seed ^ number);
    let z = p.z * 1e3 + f64::from(grain(30.0, 81)) * 2.0;
    let wrinkles = noise(p, [30e-3, 9e-3, 1.8e-3], seed ^ 82);
    let cap = (bell(p.y * 1e3, 24.0) * bell(z - 10.0, 24.0)) as f32;
    let hairs = noise(p, [1.2e-3, 0.9e-3, 7e-3], seed ^ 83).max(0.35) - 0.35;
    let skin = 0.62 + 0.03 * grain(22.0, 84) + 0.022 * grain(6.0, 85) + 0.028 * grain(1.7, 86) + 0.02 * grain(0.9, 87)
        - cap * (0.05 + 0.03 * wrinkles)
        - 0.12 * hairs * (1.0 - cap);
    let cloth = 0.13 + 0.02 * grain(1.5, 88);
    let covered = (smooth((z - 128.0) / 3.0) + smooth((-142.0 - z) / 3.0)).min(1.0) as f32;
    skin + (cloth - skin) * covered
}
