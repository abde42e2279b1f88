//! Priors of bodies: proportions, how much people differ, and limits of joints.
//!
//! Lengths as shares of the stature by D. A. Winter, *Biomechanics and Motor Control of Human Movement*, 2009, figure 4.1; radii from circumferences there and in
//! common size tables. Sizes are correlated: tall people have long arms, and both arms are alike. The covariance includes this.

use nalgebra::{DMatrix, Vector3};

use super::parts::{Joint, N_PARTS, Part};

/// Expected proportions of people and their spread.
#[derive(Debug, Clone, PartialEq)]
pub struct Proportions {
    /// Expected stature [m].
    pub stature: f64,
    /// Relative standard deviation of the stature [–].
    pub stature_spread: f64,
    /// Relative standard deviation of one length given the rest, both sides together [–].
    pub length_spread: f64,
    /// Relative standard deviation of one radius given the rest [–]: clothes and hulls of few views count here.
    pub radius_spread: f64,
    /// Relative standard deviation of one side given the other [–].
    pub side_spread: f64,
}

impl Default for Proportions {
    /// Adults: 1.70 m ± 8 % are men and women together; lengths differ by 6 % from what the stature says (Winter), sides by 2 %.
    fn default() -> Self {
        Self { stature: 1.70, stature_spread: 0.08, length_spread: 0.06, radius_spread: 0.15, side_spread: 0.02 }
    }
}

/// Half sizes of a part relative to the stature [–].
pub fn share(part: Part) -> Vector3<f64> {
    match part {
        Part::Torso => Vector3::new(0.065, 0.105, 0.170),
        Part::Head => Vector3::new(0.055, 0.050, 0.065),
        Part::LeftUpperArm | Part::RightUpperArm => Vector3::new(0.028, 0.028, 0.093),
        Part::LeftLowerArm | Part::RightLowerArm => Vector3::new(0.022, 0.022, 0.110),
        Part::LeftThigh | Part::RightThigh => Vector3::new(0.045, 0.045, 0.1225),
        Part::LeftCalf | Part::RightCalf => Vector3::new(0.031, 0.031, 0.1425),
    }
}

/// How far a standing person's height is from the stature, as a share [–]: a stride of 0.7 m lowers the head by 4 %.
pub(super) const STANDING_SPREAD: f64 = 0.04;

/// Standard deviation, along an axis, between a person's joint and that of a fitted body of common proportions in a
/// hull [m]. From simulated people that are not part of the reported figures.
pub fn joint_sigma(joint: Joint) -> f64 {
    match joint {
        Joint::Head => 0.008,
        Joint::Neck => 0.017,
        Joint::LeftHip | Joint::RightHip => 0.019,
        _ => 0.014,
    }
}

impl Proportions {
    /// Expected half sizes of all parts [m].
    pub fn sizes(&self) -> [Vector3<f64>; N_PARTS] {
        Part::ALL.map(|it| share(it) * self.stature)
    }

    /// Covariance of all sizes, part by part x, y, z [m²].
    pub fn covariance(&self) -> DMatrix<f64> {
        let sizes = self.sizes();
        let n = 3 * N_PARTS;
        let at = |i: usize| (Part::ALL[i / 3], i % 3, sizes[i / 3][i % 3]);
        // Whether number `i` is a length; else it is a radius. The torso's width is one of the skeleton, and the head is all radii.
        let is_length = |part: Part, axis: usize| (axis == 2 || part == Part::Torso && axis == 1) && part != Part::Head;
        DMatrix::from_fn(n, n, |i, j| {
            let ((part, axis, a), (other, other_axis, b)) = (at(i), at(j));
            let mut shared = self.stature_spread.powi(2);
            let alike = part == other || part == other.mirrored();
            let spread = if is_length(part, axis) { self.length_spread } else { self.radius_spread };
            // Limbs and heads are round: their radii are nearly one number.
            let round = part == Part::Head || part.is_limb() && axis < 2 && other_axis < 2;
            if alike && (axis == other_axis || round) {
                shared += spread.powi(2);
            }
            if i == j {
                shared += self.side_spread.powi(2);
            }
            shared * a * b
        })
    }
}

/// Limits of joints, as soft constraints of the filter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Tilt of the head from the torso's axis [rad].
    pub head_tilt: f64,
    /// Upper arm backwards from the plane of shoulders and hips [rad].
    pub arm_back: f64,
    /// Thigh backwards from that plane [rad].
    pub thigh_back: f64,
    /// Thigh to the other side, from the median plane [rad].
    pub thigh_across: f64,
    /// Bend of elbow and knee [rad].
    pub bend: f64,
    /// Bend of a knee the wrong way [rad].
    pub knee_forward: f64,
    /// Softness of all limits [rad].
    pub sigma: f64,
}

impl Default for Limits {
    /// Ranges of motion by the American Academy of Orthopaedic Surgeons, *Joint Motion*, 1965: extension of the shoulder 60°, of the hip 30°, adduction of the hip 30°, flexion of elbow
    /// 150°, of the knee 135° (150° crouching), extension of the knee 10°; the head 45°, to which the upper spine adds.
    fn default() -> Self {
        let degrees = |it: f64| it.to_radians();
        Self {
            head_tilt: degrees(60.0),
            arm_back: degrees(60.0),
            thigh_back: degrees(30.0),
            thigh_across: degrees(35.0),
            bend: degrees(150.0),
            knee_forward: degrees(10.0),
            sigma: degrees(8.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn covariance_is_one_and_ties_what_goes_together() {
        let proportions = Proportions::default();
        let covariance = proportions.covariance();
        assert!(covariance.clone().cholesky().is_some());
        let at = |part: Part, axis: usize| 3 * part.index() + axis;
        let correlation = |i: usize, j: usize| covariance[(i, j)] / (covariance[(i, i)] * covariance[(j, j)]).sqrt();
        let (left, right) = (at(Part::LeftThigh, 2), at(Part::RightThigh, 2));
        assert!(correlation(left, right) > 0.9 && correlation(left, at(Part::LeftCalf, 2)) < 0.7);
        assert!(correlation(at(Part::LeftCalf, 0), at(Part::LeftCalf, 1)) > 0.95);
    }

    #[test]
    fn standing_upright_the_shares_add_up_to_the_stature() {
        let [torso, head, thigh, calf] =
            [Part::Torso, Part::Head, Part::LeftThigh, Part::LeftCalf].map(|it| 2.0 * share(it).z);
        assert!((torso + head + thigh + calf - 1.0).abs() < 0.01, "{}", torso + head + thigh + calf);
    }
}
