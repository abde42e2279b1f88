//! The room of the studio: what colour floor, walls and desks have, on the places of the lab's room.

use nalgebra::{Point3, Vector3};

use super::texture::Colour;
use crate::painted::noise;
use crate::world::{Surface, room_hit};

/// A place of the room that a line of sight ends on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Place {
    pub point: Point3<f64>,
    pub normal: Vector3<f32>,
    pub colour: Colour,
    /// How far away [lengths of the direction].
    pub depth: f64,
}

/// What a line of sight that starts inside the room ends on; what is finer than `resolved` [m] is left out.
pub(crate) fn place(origin: &Point3<f64>, direction: &Vector3<f64>, resolved: f64) -> Place {
    let (surface, axis, depth) = room_hit(origin, direction);
    let point = origin + direction * depth;
    let mut normal = Vector3::zeros();
    normal[axis] = if direction[axis] > 0.0 { -1.0 } else { 1.0 };
    Place { point, normal, colour: colour(surface, axis, &point, resolved), depth }
}

fn colour(surface: Surface, axis: usize, p: &Point3<f64>, resolved: f64) -> Colour {
    // Details fade where they are not resolved.
    let grain = |size: f64, seed: u32| {
        let seen = (size / resolved - 0.7).clamp(0.0, 1.0) as f32;
        if seen > 0.0 { seen * noise(p, [size; 3], seed) } else { 0.0 }
    };
    let times = |colour: Colour, by: f32| colour.map(|it| (it * by).max(0.0));
    match surface {
        Surface::Floor => {
            let tile = (p.x / 0.5).floor() + (p.y / 0.5).floor();
            let base = if tile.rem_euclid(2.0) < 1.0 { [0.26, 0.27, 0.30] } else { [0.22, 0.235, 0.27] };
            let fleck = grain(0.02, 301);
            let tone = 1.0 + 0.10 * grain(0.25, 302) + 0.12 * grain(0.06, 303) + 0.16 * grain(0.012, 304);
            let [r, g, b] = times(base, tone);
            [r + 0.03 * fleck, g, b - 0.02 * fleck]
        }
        Surface::Wall if p.z < 0.1 => times([0.22, 0.20, 0.18], 1.0 + 0.05 * grain(0.1, 311)),
        Surface::Wall => {
            let tone = 1.0 + 0.03 * grain(0.6, 312) + 0.025 * grain(0.08, 313) + 0.03 * grain(0.015, 314);
            poster(axis, p).unwrap_or(times([0.60, 0.585, 0.54], tone))
        }
        Surface::Display => times([0.10, 0.11, 0.13], 1.0 + 0.1 * grain(0.3, 321)),
        Surface::Desk => {
            let at = Point3::new(p.x, p.y * 0.12, p.z);
            let rings = noise(&at, [0.02; 3], 331) + 0.5 * noise(&at, [0.007; 3], 332);
            times([0.40, 0.28, 0.17], 1.0 + 0.2 * rings)
        }
        Surface::Ceiling => times([0.66, 0.66, 0.64], 1.0 + 0.05 * grain(0.05, 341)),
        Surface::Lamp => [0.85; 3],
    }
}

/// Sheets on the walls along y, of two colours.
fn poster(axis: usize, p: &Point3<f64>) -> Option<Colour> {
    if axis != 0 {
        return None;
    }
    let number = (p.y / 1.7).round();
    let (across, up) = (p.y - number * 1.7, p.z - 1.55);
    if across.abs() > 0.30 || up.abs() > 0.42 {
        return None;
    }
    if across.abs() > 0.28 || up.abs() > 0.40 {
        return Some([0.62, 0.62, 0.60]);
    }
    let at = Point3::new(p.x, p.y, p.z);
    let seed = 351 + number.rem_euclid(16.0) as u32 + if p.x > 0.0 { 40 } else { 0 };
    let blot = noise(&at, [0.09; 3], seed) + 0.4 * noise(&at, [0.03; 3], seed ^ 7);
    let colours = [[0.45, 0.12, 0.08], [0.10, 0.22, 0.40], [0.50, 0.42, 0.12], [0.08, 0.30, 0.16]];
    let [first, second] = [0, 1].map(|it| colours[(seed as usize + it) % 4]);
    Some(if blot > 0.1 { first } else { second })
}
