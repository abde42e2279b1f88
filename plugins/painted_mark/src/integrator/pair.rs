//! Selection of the best pair of cameras over time, with smooth changes [Davis 2002 §5.2].

use foveate::geometry::{AlignmentOptions, align};
use foveate::prelude::CameraId;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

/// Larger angles between lines of sight do not improve a pair [rad].
const WIDE: f64 = 0.52;

/// Quality of a pair of cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Offer {
    pub pair: [CameraId; 2],
    /// Marks that both see.
    pub common: usize,
    /// Angle between their lines of sight [rad].
    pub angle: f64,
}

impl Offer {
    fn worth(&self) -> f64 {
        self.common as f64 * (self.angle.sin() / WIDE.sin()).clamp(0.0, 1.0)
    }
}

/// Keeps a pair until another is better by a given share.
#[derive(Default)]
pub(super) struct Choice {
    pair: Option<[CameraId; 2]>,
    pub changes: u64,
}

impl Choice {
    /// The pair to use, and the previous one if it differs and still sees something.
    pub fn choose(&mut self, offers: &[Offer], gain: f64) -> Option<([CameraId; 2], Option<[CameraId; 2]>)> {
        let best = offers.iter().max_by(|a, b| a.worth().total_cmp(&b.worth())).filter(|it| it.common > 0)?;
        let held = offers.iter().find(|it| Some(it.pair) == self.pair && it.common > 0);
        let taken = held.filter(|held| best.worth() <= held.worth() * (1.0 + gain)).unwrap_or(best);
        let last = self.pair.replace(taken.pair).filter(|last| *last != taken.pair);
        self.changes += u64::from(last.is_some());
        Some((taken.pair, last.filter(|_| held.is_some())))
    }
}

/// A step between two pairs, spread over time: the motion from the points of the new pair to those of the old one, fading out.
pub(super) struct Blend {
    /// Rotation and shift about `middle`.
    turn: Vector3<f64>,
    shift: Vector3<f64>,
    time_constant: f64,
}

impl Blend {
    pub fn new(time_s: f64) -> Blend {
        Blend { turn: Vector3::zeros(), shift: Vector3::zeros(), time_constant: time_s }
    }

    /// Switches to another pair: `new` and `old` are the same marks by both pairs at this time.
    pub fn step(&mut self, new: &[Point3<f64>], old: &[Point3<f64>]) {
        let middle = middle(new);
        let fading = self.motion(&middle);
        let shown: Vec<Point3<f64>> = old.iter().map(|it| fading * it).collect();
        let Ok(motion) = align(new, &shown, AlignmentOptions { robust: true, ..AlignmentOptions::default() }) else {
            return;
        };
        let motion = motion.b_from_a.isometry;
        self.turn = motion.rotation.scaled_axis();
        self.shift = motion * middle - middle;
    }

    /// Lets `seconds` pass.
    pub fn fade(&mut self, seconds: f64) {
        let left = if self.time_constant > 0.0 { (-seconds / self.time_constant).exp() } else { 0.0 };
        self.turn *= left;
        self.shift *= left;
    }

    /// The rest of the step, for points about `middle`.
    pub fn motion(&self, middle: &Point3<f64>) -> Isometry3<f64> {
        let about = Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_scaled_axis(self.turn));
        Translation3::from(middle.coords + self.shift) * about * Translation3::from(-middle.coords)
    }
}

/// Mean of points; the origin for none.
pub(super) fn middle(points: &[Point3<f64>]) -> Point3<f64> {
    let sum = points.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords);
    Point3::from(sum / points.len().max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::integrator::tests::marks_on_a_face;

    fn offer(pair: [u16; 2], common: usize, angle: f64) -> Offer {
        Offer { pair: pair.map(CameraId), common, angle }
    }

    #[test]
    fn a_pair_is_kept_until_another_is_clearly_better() {
        let mut choice = Choice::default();
        let pair = |it: [u16; 2]| it.map(CameraId);
        let first = choice.choose(&[offer([0, 1], 50, 0.6), offer([1, 2], 40, 0.6)], 0.2);
        assert_eq!(first, Some((pair([0, 1]), None)));
        let near = [offer([0, 1], 50, 0.6), offer([1, 2], 55, 0.6)];
        assert_eq!(choice.choose(&near, 0.2), Some((pair([0, 1]), None)));
        let clear = [offer([0, 1], 40, 0.6), offer([1, 2], 55, 0.6)];
        assert_eq!(choice.choose(&clear, 0.2), Some((pair([1, 2]), Some(pair([0, 1])))));
        let gone = [offer([0, 1], 30, 0.6), offer([1, 2], 0, 0.6)];
        assert_eq!(choice.choose(&gone, 0.2), Some((pair([0, 1]), None)), "the old pair sees nothing to compare with");
        assert_eq!(choice.choose(&[], 0.2), None);
        assert_eq!(choice.changes, 2);
        let narrow = [offer([0, 1], 50, 0.05), offer([2, 3], 30, 0.6)];
        assert_eq!(Choice::default().choose(&narrow, 0.2), Some((pair([2, 3]), None)));
    }

    #[test]
    fn a_step_between_pairs_is_spread_over_time() {
        let old = marks_on_a_face();
        let bias = Isometry3::new(Vector3::new(0.004, -0.003, 0.002), Vector3::new(0.001, 0.002, -0.001));
        let new: Vec<Point3<f64>> = old.iter().map(|it| bias * it).collect();
        let mut blend = Blend::new(0.5);
        blend.step(&new, &old);
        let off = |blend: &Blend, to: &[Point3<f64>]| {
            let motion = blend.motion(&middle(&new));
            new.iter().zip(to).map(|(it, to)| (motion * it - to).norm()).fold(0.0, f64::max)
        };
        assert!(off(&blend, &old) < 1e-9, "right after the step nothing is to be seen of it");
        blend.fade(0.1);
        assert!((5e-4..3e-3).contains(&off(&blend, &old)));
        blend.fade(20.0);
        assert!(off(&blend, &new) < 1e-9, "in the end the new pair is believed");
    }
}
