//! Signed distance of a point from the skin of a part, with derivatives.
//!
//! Limbs are cones with round ends (the paper's are cylinders) and round cross-sections (the radius in the middle is
//! the mean of x and y): at the joint to the body and at a joint to another part the middle of the round end is the
//! joint itself, so that two parts meet like a ball joint; a limb's free end lies at −l_z. The head is an ellipsoid.
//! The torso is an elliptic cylinder from where the legs part, below the hip joints, to a little above the shoulders,
//! with a neck from there to the head. Distances to ellipses are of first order, exact on the skin: (f − 1)/|∇f| of f²
//! = x²/a² + y²/b².

use nalgebra::Vector3;

use super::parts::Part;

/// The flat top of the trunk between the middle of the torso and the neck [–]: the shoulders (0.694) and what the muscle stands above the joint, 0.025 of the stature
/// (Winter, figure 4.1: shoulder joint 0.818, top of the shoulder 0.843).
const TRUNK_TOP: f64 = 0.84;
/// The flat lower end of the trunk between the middle of the torso and its hips [–]: hip joints at 0.530 of the stature (Winter, figure 4.1), where legs part at 0.475 (C. C. Gordon et al.,
/// *1988 Anthropometric Survey of U.S. Army Personnel*, 1989: crotch height 0.837 m of 1.756 m, women 0.771 m of 1.629 m): (0.700 − 0.475)/0.170.
pub(super) const TRUNK_BOTTOM: f64 = 1.32;
/// Radius of the neck as a share of the half width of the shoulders [–]: 0.055 m beside 0.18 m (circumference of a neck 0.35 m).
const NECK: f64 = 0.3;

/// Signed distance from a skin, in the part's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Skin {
    /// Distance, above 0 outside [m].
    pub distance: f64,
    /// Outward unit normal in the part's axes: the derivative of the distance by the point.
    pub normal: Vector3<f64>,
    /// Derivative of the distance by the sizes.
    pub by_sizes: Vector3<f64>,
}

/// The skin of `part` at a point in the part's axes. `is_end`: the part has no child.
pub fn skin(part: Part, point: &Vector3<f64>, sizes: &Vector3<f64>, is_end: bool) -> Skin {
    match part {
        Part::Torso => {
            let trunk = trunk(point, sizes);
            let neck = neck(point, sizes);
            if neck.distance < trunk.distance { neck } else { trunk }
        }
        Part::Head => ellipsoid(point, sizes),
        _ => limb(taper(part), point, sizes, is_end),
    }
}

fn unit(v: Vector3<f64>) -> (f64, Vector3<f64>) {
    let length = v.norm();
    if length > 1e-12 { (length, v / length) } else { (0.0, Vector3::x()) }
}

/// How much thicker a limb's part is at its upper end than in its middle, and thinner at its lower end, as a share of its radius [–]: circumferences of thigh 0.60 m, knee 0.39 m, calf 0.38 m, ankle 0.22 m, upper
/// arm 0.33 m, elbow 0.28 m, forearm 0.30 m, wrist 0.17 m (Gordon et al. 1989, men); a foot and a hand are thicker again. Without it the place where a limb becomes thinner is taken for its joint.
pub(super) fn taper(part: Part) -> f64 {
    match part {
        Part::LeftUpperArm | Part::RightUpperArm => 0.10,
        Part::LeftLowerArm | Part::RightLowerArm => 0.25,
        Part::LeftThigh | Part::RightThigh | Part::LeftCalf | Part::RightCalf => 0.22,
        Part::Torso | Part::Head => 0.0,
    }
}

fn limb(taper: f64, point: &Vector3<f64>, sizes: &Vector3<f64>, is_end: bool) -> Skin {
    let (radius, half) = ((sizes.x + sizes.y) / 2.0, sizes.z);
    let [top, tip] = [1.0 + taper, 1.0 - taper];
    // The middle of a free end's ball: that ball ends at −l_z.
    let slope = taper * radius / half;
    let low = if is_end { -((half - radius) / (1.0 - slope)).max(0.0) } else { -half };
    let at = point.z.clamp(low, half.max(low));
    let share = 1.0 + taper * at / half;
    let away = point - Vector3::new(0.0, 0.0, at);
    // Derivatives by radius and by half length.
    let (distance, normal, by_radius, by_half);
    if point.z > half {
        let (length, out) = unit(away);
        (distance, normal, by_radius, by_half) = (length - top * radius, out, -top, -out.z);
    } else if point.z < low {
        let (length, out) = unit(away);
        (distance, normal) = (length - share * radius, out);
        if is_end {
            let d = 1.0 - slope;
            let low_by_radius = 1.0 / d - (half - radius) * taper / half / d.powi(2);
            let low_by_half = -1.0 / d + (half - radius) * slope / half / d.powi(2);
            by_radius = -(out.z + slope) * low_by_radius - share;
            by_half = -(out.z + slope) * low_by_half + slope * low / half;
        } else {
            (by_radius, by_half) = (-tip, out.z);
        }
    } else {
        let along = (1.0 + slope * slope).sqrt();
        let (length, out) = unit(away);
        distance = (length - share * radius) / along;
        normal = (out - Vector3::z() * slope) / along;
        by_radius = -share / along;
        by_half = slope * at / half / along;
    }
    Skin { distance, normal, by_sizes: Vector3::new(by_radius / 2.0, by_radius / 2.0, by_half) }
}

fn ellipsoid(point: &Vector3<f64>, sizes: &Vector3<f64>) -> Skin {
    let scaled = point.component_div(sizes);
    let f = scaled.norm();
    if f < 1e-9 {
        let short = sizes.imin();
        let normal = Vector3::from_fn(|axis, _| f64::from(u8::from(axis == short)));
        return Skin { distance: -sizes[short], normal, by_sizes: -normal };
    }
    let gradient = scaled.component_div(sizes) / f;
    let (slope, normal) = unit(gradient);
    let by_sizes = -scaled.component_mul(&gradient) / slope;
    Skin { distance: (f - 1.0) / slope, normal, by_sizes }
}

fn trunk(point: &Vector3<f64>, sizes: &Vector3<f64>) -> Skin {
    let flat = ellipsoid(&Vector3::new(point.x, point.y, 0.0), &Vector3::new(sizes.x, sizes.y, 1.0));
    let (up, by_z) = if point.z > 0.0 {
        (point.z - TRUNK_TOP * sizes.z, -TRUNK_TOP)
    } else {
        (-point.z - TRUNK_BOTTOM * sizes.z, -TRUNK_BOTTOM)
    };
    let lid = Skin { distance: up, normal: Vector3::z() * point.z.signum(), by_sizes: Vector3::z() * by_z };
    if flat.distance > 0.0 && up > 0.0 {
        // Beyond the rim.
        let (distance, weights) = unit(Vector3::new(flat.distance, up, 0.0));
        let mix = |a: Vector3<f64>, b: Vector3<f64>| a * weights.x + b * weights.y;
        return Skin { distance, normal: mix(flat.normal, lid.normal), by_sizes: mix(flat.by_sizes, lid.by_sizes) };
    }
    if flat.distance > up { flat } else { lid }
}

fn neck(point: &Vector3<f64>, sizes: &Vector3<f64>) -> Skin {
    let radius = NECK * sizes.y;
    let at = point.z.clamp(0.0, sizes.z);
    let (length, normal) = unit(point - Vector3::new(0.0, 0.0, at));
    let by_z = if point.z > sizes.z { -normal.z } else { 0.0 };
    Skin { distance: length - radius, normal, by_sizes: Vector3::new(0.0, -NECK, by_z) }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_laws::check_jacobian;
    use nalgebra::DMatrix;

    use super::*;

    #[test]
    fn derivatives_on_the_skin_are_those_of_the_distance() {
        let mut random = Random::new(3);
        let mut n_checked = 0;
        for step in 0..600 {
            let part = Part::ALL[step % Part::ALL.len()];
            let sizes = Vector3::new(0.09, 0.14, 0.27) + Vector3::from_fn(|_, _| random.uniform_in(0.0, 0.04));
            let is_end = step % 3 == 0;
            let mut point = Vector3::from_fn(|axis, _| 1.6 * sizes[axis] * random.uniform_in(-1.0, 1.0));
            // Down to the skin, where first-order distances are exact.
            for _ in 0..60 {
                let at = skin(part, &point, &sizes, is_end);
                point -= at.normal * at.distance;
            }
            let at = skin(part, &point, &sizes, is_end);
            if at.distance.abs() > 1e-10 {
                continue; // hopped between two faces of an edge
            }
            let values = [point.as_slice(), sizes.as_slice()].concat();
            let f = |x: &[f64]| {
                let [point, sizes] = [0, 3].map(|it| Vector3::new(x[it], x[it + 1], x[it + 2]));
                vec![skin(part, &point, &sizes, is_end).distance]
            };
            let stated = [at.normal.as_slice(), at.by_sizes.as_slice()].concat();
            // At an edge two derivatives are right.
            let near_edge = (0..6).any(|i| {
                let mut moved = values.clone();
                moved[i] += 2e-6;
                let [p, s] = [0, 3].map(|it| Vector3::new(moved[it], moved[it + 1], moved[it + 2]));
                (skin(part, &p, &s, is_end).normal - at.normal).norm() > 1e-3
            });
            if !near_edge {
                check_jacobian(f, &DMatrix::from_row_slice(1, 6, &stated), &values, 2e-4);
                n_checked += 1;
            }
        }
        assert!(n_checked > 400, "{n_checked}");
    }

    #[test]
    fn two_parts_of_a_limb_meet_as_a_ball_joint_and_a_free_end_is_where_the_size_says() {
        let sizes = Vector3::new(0.05, 0.05, 0.15);
        let below = |is_end: bool| skin(Part::LeftThigh, &Vector3::new(0.0, 0.0, -0.17), &sizes, is_end).distance;
        let tip = 0.05 * (1.0 - taper(Part::LeftThigh));
        assert!((below(true) - 0.02).abs() < 1e-12 && (below(false) - (0.02 - tip)).abs() < 1e-12);
        let side = |z: f64| skin(Part::LeftThigh, &Vector3::new(0.05, 0.0, z), &sizes, false).distance;
        assert!(side(0.1) < -0.005 && side(0.0).abs() < 1e-12 && side(-0.1) > 0.005);
    }
}
