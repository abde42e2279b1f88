//! Which way a body looks. Voxels of somebody who stands still look the same from front and back; what tells is how bodies are built and how they move.
//!
//! | sign | says |
//! |---|---|
//! | feet | stick out to the front of the calves |
//! | knees | bend so that the feet go back |
//! | elbows | of arms that hang bend so that the hands go to the front |
//! | walking | goes ahead, nearly always |

use nalgebra::Vector3;

use super::field::VoxelField;
use super::filter::BodyFilter;
use super::parts::{Limb, Part};

/// Evidence of `dt_s` seconds that the front is where the torso's x points, as log-odds: below 0 it speaks for the other way.
pub(super) fn facing_evidence(filter: &BodyFilter, field: &VoxelField, dt_s: f64) -> f64 {
    let body = &filter.body;
    let layout = filter.layout();
    let torso = body.turn(Part::Torso);
    let (front, up) = (torso * Vector3::x(), torso * Vector3::z());
    let mut evidence = 0.0;
    for limb in Limb::ALL {
        let [upper, lower] = limb.parts();
        if !layout.has(lower) {
            continue;
        }
        let [u, v] = [upper, lower].map(|it| body.turn(it) * Vector3::z());
        // How far the lower part's upward direction points to the front of the upper part's line.
        let bent = (v - u * v.dot(&u)).dot(&front);
        let upright = u.dot(&up).max(0.0);
        if limb.is_leg() {
            // Beyond 10°, with legs that do not point away from the trunk by much.
            evidence += 4.0 * dead(bent, 0.17) * upright;
            evidence += 4.0 * foot(filter, field, lower).map_or(0.0, |it| dead(it.dot(&front), 0.02) / 0.08);
        } else {
            evidence -= 2.0 * dead(bent, 0.25) * upright * upright;
        }
    }
    // Across the floor, along the axis that is the front.
    let along = filter.velocity.dot(&front);
    if up.z.abs() > 0.8 {
        evidence += 3.0 * dead(along, 0.25).clamp(-1.5, 1.5);
    }
    evidence * dt_s
}

fn dead(value: f64, zone: f64) -> f64 {
    value.signum() * (value.abs() - zone).max(0.0)
}

/// From the calf's axis to the middle of the voxels about its lower end, at right angles to it [m].
fn foot(filter: &BodyFilter, field: &VoxelField, calf: Part) -> Option<Vector3<f64>> {
    let body = &filter.body;
    let size = body.size(calf);
    let axis = body.turn(calf) * Vector3::z();
    let sole = body.place(calf, &-Vector3::z());
    let (mut sum, mut n) = (Vector3::zeros(), 0);
    for &cell in field.voxels() {
        let away = field.centre(cell) - sole;
        let along = away.dot(&axis);
        let across = away - axis * along;
        if along > -0.05 && along < 0.45 * size.z && across.norm() < 0.25 {
            sum += across;
            n += 1;
        }
    }
    (n > 3).then(|| sum / f64::from(n))
}
