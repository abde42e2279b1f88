//! A band about the head with three lights, and the eyes below it: where they truly are, which is not quite where they should be.

use foveate_estimation::random::Random;
use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::body::Led;
use super::{HALF_DIFFERENCE_S, Person, Pose};

/// Lights on the band.
pub const N_ON_HEADBAND: usize = 3;

/// Where the lights should be in the head's space (x forward, y left, z up, the origin in the middle of the head): no two of them as far apart as two others [m].
const LIGHTS: [[f64; 3]; N_ON_HEADBAND] = [[0.135, 0.02, 0.05], [0.0, 0.14, 0.03], [-0.03, -0.135, 0.06]];
/// The eyes of the average head, 63 mm apart (N. Dodgson, "Variation and extrema of human interpupillary distance", SPIE 5291, 2004) [m].
const EYES: [[f64; 3]; 2] = [[0.085, 0.0315, 0.0], [0.085, -0.0315, 0.0]];
/// Standard deviation of half their distance, from the same [m].
const EYE_SIGMA: f64 = 0.0018;
/// How people put on a band: standard deviations of each light [m] and of the whole about each axis [rad]. Assumed.
const LIGHT_SIGMA: f64 = 0.002;
const TURN_SIGMA: f64 = 0.02;

/// A band as a person wears it.
#[derive(Debug, Clone, PartialEq)]
pub struct Headband {
    lights: [Point3<f64>; N_ON_HEADBAND],
    eyes: [Point3<f64>; 2],
}

impl Headband {
    /// One of many.
    pub fn new(mut random: Random) -> Headband {
        let mut vector = |sigma: f64| Vector3::from_fn(|_, _| random.normal() * sigma);
        let turn = UnitQuaternion::from_scaled_axis(vector(TURN_SIGMA));
        let lights = LIGHTS.map(|it| turn * Point3::from(it) + vector(LIGHT_SIGMA));
        let apart = vector(EYE_SIGMA).x;
        let eyes = EYES.map(|it| Point3::new(it[0], it[1] + apart * it[1].signum(), it[2]));
        Headband { lights, eyes }
    }

    /// The lights of a head, each shining away from its middle.
    pub fn lights(&self, pose: &Pose) -> [Led; N_ON_HEADBAND] {
        self.lights.map(|it| Led { position: pose.head * it, normal: pose.head * it.coords.normalize() })
    }

    /// Positions [m] and velocities [m/s] of the lights at `time_s` [s].
    pub fn motion(&self, person: &Person, time_s: f64) -> [(Point3<f64>, Vector3<f64>); N_ON_HEADBAND] {
        let at = |time_s: f64| self.lights(&person.pose(time_s)).map(|it| it.position);
        let (before, now, after) = (at(time_s - HALF_DIFFERENCE_S), at(time_s), at(time_s + HALF_DIFFERENCE_S));
        std::array::from_fn(|i| (now[i], (after[i] - before[i]) / (2.0 * HALF_DIFFERENCE_S)))
    }

    /// The left and the right eye [m].
    pub fn eyes(&self, pose: &Pose) -> [Point3<f64>; 2] {
        self.eyes.map(|it| pose.head * it)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_differ_a_little_and_no_two_distances_are_alike() {
        for seed in 0..50 {
            let band = Headband::new(Random::new(seed));
            let apart = |a: usize, b: usize| (band.lights[a] - band.lights[b]).norm();
            let distances = [apart(0, 1), apart(0, 2), apart(1, 2)];
            for (place, it) in distances.iter().enumerate() {
                assert!(distances[..place].iter().all(|other| (other - it).abs() > 0.015), "{distances:?}");
            }
            let should = LIGHTS.map(Point3::from);
            let off = band.lights.iter().zip(&should).map(|(it, should)| (it - should).norm()).fold(0.0, f64::max);
            assert!((1e-4..0.03).contains(&off), "{off} m");
            assert!(((band.eyes[0] - band.eyes[1]).norm() - 0.063).abs() < 0.015 && band.eyes[0].y > 0.0);
        }
    }
}
