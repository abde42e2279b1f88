//! Points over time, from any file: the common form in which motion is filled, smoothed, compared and converted.

use std::collections::BTreeSet;

use foveate_messages::{CameraSet, Provenance};
use nalgebra::{Matrix3, Point3};

use crate::bvh::SkeletonMotion;

/// The coordinate axis that points up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Up {
    /// y is up, as in OpenSim, BVH and glTF.
    Y,
    /// z is up, as in our world and most C3D files.
    #[default]
    Z,
}

impl Up {
    /// Name of the axis: `y` or `z`.
    pub const fn name(self) -> &'static str {
        match self {
            Up::Y => "y",
            Up::Z => "z",
        }
    }

    /// Converts coordinates with z up to this axis up: (x, y, z) becomes (x, z, −y) with y up.
    pub const fn of_z_up(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Up::Y => [x, z, -y],
            Up::Z => [x, y, z],
        }
    }

    /// Converts coordinates with this axis up to z up.
    pub const fn to_z_up(self, [x, y, z]: [f64; 3]) -> [f64; 3] {
        match self {
            Up::Y => [x, -z, y],
            Up::Z => [x, y, z],
        }
    }
}

/// A point in one frame.
#[derive(Debug, Clone)]
pub struct Sample {
    /// Position [m].
    pub position: Point3<f64>,
    /// Upper triangle of the position's covariance, by rows; NaN where the file does not say [m²].
    pub covariance: [f32; 6],
    /// The cameras that saw it, by index in [`Motion::cameras`].
    pub cameras: CameraSet,
    /// Provenance: measured, predicted or filled in.
    pub provenance: Provenance,
}

impl PartialEq for Sample {
    /// Covariances that are not known are alike.
    fn eq(&self, other: &Self) -> bool {
        (self.position, &self.cameras, self.provenance) == (other.position, &other.cameras, other.provenance)
            && self.covariance.map(f32::to_bits) == other.covariance.map(f32::to_bits)
    }
}

impl Sample {
    /// A measured sample with an unknown covariance.
    pub fn at(position: Point3<f64>) -> Self {
        Self { position, covariance: [f32::NAN; 6], cameras: CameraSet::default(), provenance: Provenance::Measured }
    }

    /// The sample with the same variance along each axis.
    pub fn with_sigma(self, sigma: f64) -> Self {
        let variance = (sigma * sigma) as f32;
        Self { covariance: [variance, 0.0, 0.0, variance, 0.0, variance], ..self }
    }

    /// Standard deviation of the position: root of the mean variance over the axes; `None` where it is unknown [m].
    pub fn sigma(&self) -> Option<f64> {
        let [xx, _, _, yy, _, zz] = self.covariance.map(f64::from);
        let mean = (xx + yy + zz) / 3.0;
        (mean >= 0.0).then(|| mean.sqrt())
    }

    /// Covariance of the position; `None` where it is unknown [m²].
    pub fn covariance(&self) -> Option<Matrix3<f64>> {
        let [xx, xy, xz, yy, yz, zz] = self.covariance.map(f64::from);
        let whole = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        whole.iter().all(|it| it.is_finite()).then_some(whole)
    }
}

/// A labelled moment, such as a foot strike.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Event {
    /// Label of the event.
    pub label: String,
    /// Subject or side, such as `Left`; empty where the file does not say.
    pub context: String,
    /// Time on the clock of [`Motion::times_s`] [s].
    pub time_s: f64,
}

/// A skeleton whose joints are the points.
#[derive(Debug, Clone, PartialEq)]
pub struct Skeleton {
    /// The skeleton and its motion as the file has it.
    pub motion: SkeletonMotion,
    /// Length of the file's unit [m].
    pub unit_m: f64,
}

/// Points over time: the common form of all motion files.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Motion {
    /// Names of the points, all different.
    pub labels: Vec<String>,
    /// Time of each frame, ascending [s].
    pub times_s: Vec<f64>,
    /// Frame rate; `None`: the times are not regular [Hz].
    pub rate_hz: Option<f64>,
    /// Samples frame by frame, point by point within; `None` where a point is missing.
    pub samples: Vec<Option<Sample>>,
    /// Which axis is up.
    pub up: Up,
    /// Labelled moments.
    pub events: Vec<Event>,
    /// Names of the cameras in [`Sample::cameras`].
    pub cameras: Vec<String>,
    /// Name and length of the file's unit; `None`: metres, of a format without a choice [m].
    pub unit: Option<(String, f64)>,
    /// The skeleton whose joints the points are, as long as they are where it says.
    pub skeleton: Option<Skeleton>,
    /// Other content of the file, in words.
    pub besides: Vec<String>,
    /// Whether the file does not state the time of its first frame; its times then count from there.
    pub lacks_start: bool,
}

impl Motion {
    /// Number of frames.
    pub fn n_frames(&self) -> usize {
        self.times_s.len()
    }

    /// A point in a frame; `None` where it is missing.
    pub fn get(&self, frame: usize, point: usize) -> Option<&Sample> {
        let n_points = self.labels.len();
        if point < n_points { self.samples.get(frame * n_points + point)?.as_ref() } else { None }
    }

    /// The samples of one point over all frames.
    pub fn column(&self, point: usize) -> impl Iterator<Item = Option<&Sample>> {
        let n_points = self.labels.len().max(1);
        self.samples.iter().skip(point).step_by(n_points).map(Option::as_ref)
    }

    /// Number of samples that are present.
    pub fn n_present(&self) -> usize {
        self.samples.iter().flatten().count()
    }

    /// Number of samples with this provenance.
    pub fn n_of(&self, provenance: Provenance) -> usize {
        self.samples.iter().flatten().filter(|it| it.provenance == provenance).count()
    }

    /// Makes all names different: empty ones become `unlabelled-N`, later duplicates get ` (2)` and so on. Returns how many changed.
    pub fn make_names_unique(&mut self) -> usize {
        let mut taken = BTreeSet::new();
        let mut n_changed = 0;
        for (place, label) in self.labels.iter_mut().enumerate() {
            let wanted = if label.is_empty() { format!("unlabelled-{}", place + 1) } else { label.clone() };
            let mut name = wanted.clone();
            let mut number = 2;
            while !taken.insert(name.clone()) {
                name = format!("{wanted} ({number})");
                number += 1;
            }
            n_changed += usize::from(name != *label);
            *label = name;
        }
        n_changed
    }

    /// Rotates all points so that `up` is up: (x, y, z) with z up becomes (x, z, −y) with y up. Returns whether anything changed.
    pub fn turn(&mut self, up: Up) -> bool {
        if self.up == up {
            return false;
        }
        let before = self.up;
        for sample in self.samples.iter_mut().flatten() {
            sample.position = Point3::from(up.of_z_up(before.to_z_up(sample.position.into())));
            let [xx, xy, xz, yy, yz, zz] = sample.covariance;
            sample.covariance = match up {
                Up::Y => [xx, xz, -xy, zz, -yz, yy],
                Up::Z => [xx, -xz, xy, zz, -yz, yy],
            };
        }
        self.up = up;
        // Its axes are its own.
        self.skeleton = None;
        true
    }

    /// Time of the first frame [s].
    pub fn start_s(&self) -> f64 {
        self.times_s.first().copied().unwrap_or(0.0)
    }
}

/// How far times may be from a regular clock, as a part of its step, and still be on it.
const REGULAR: f64 = 0.01;

/// Resolution of times in our tables [s].
const FINE_S: f64 = 1e-6;

/// The rate of a regular clock that all of these times are on, from the first one on; frames may be left out where `with_holes`.
/// `None`: they are not regular, or fewer than two.
pub(crate) fn rate_of(times_s: &[f64]) -> Option<f64> {
    let (first, last) = (times_s.first()?, times_s.last()?);
    let step = (last - first) / (times_s.len() - 1) as f64;
    let is_regular = step > 0.0
        && times_s.iter().enumerate().all(|(frame, time)| (first + frame as f64 * step - time).abs() <= REGULAR * step);
    is_regular.then(|| {
        let rate = 1.0 / step;
        // Rounded times leave 60.0003 Hz of 60: the fewest decimals that leave all times where they are, but for their rounding.
        let is_multiple = |time: &f64, unit: f64| ((time / unit).round() * unit - time).abs() < 1e-9;
        let rounding =
            [1e-2, 1e-3, 1e-4, 1e-5].into_iter().find(|unit| times_s.iter().all(|it| is_multiple(it, *unit)));
        let fits = |rate: f64, most: f64| {
            let off = |(frame, time): (usize, &f64)| (first + frame as f64 / rate - time).abs();
            rate > 0.0 && times_s.iter().enumerate().all(|it| off(it) < most)
        };
        // Times with a fine resolution may be whole milliseconds, too: 0.007 s and its multiples.
        let most = 1.01 * rounding.filter(|_| !fits(rate, FINE_S)).unwrap_or(FINE_S);
        let mut rounded = (0..6).map(|decimals| 10_f64.powi(decimals)).map(|it| (rate * it).round() / it);
        rounded.find(|it| fits(*it, most)).unwrap_or(rate)
    })
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// `n_points` of known paths at `rate_hz` for `n_frames`, some of them missing, one filled.
    pub(crate) fn motion(n_points: usize, n_frames: usize, rate_hz: f64) -> Motion {
        let sample = |frame: usize, point: usize| {
            let t = frame as f64 / rate_hz;
            let place = Point3::new((t + point as f64).sin(), 0.25 * t, 1.0 + point as f64 * 0.125);
            match (frame * n_points + point) % 11 {
                7 => None,
                8 => Some(Sample { provenance: Provenance::Filled, ..Sample::at(place) }),
                _ => Some(Sample::at(place).with_sigma(0.001)),
            }
        };
        Motion {
            labels: (0..n_points).map(|it| format!("P{it}")).collect(),
            times_s: (0..n_frames).map(|it| it as f64 / rate_hz).collect(),
            rate_hz: Some(rate_hz),
            samples: (0..n_frames * n_points).map(|it| sample(it / n_points, it % n_points)).collect(),
            ..Motion::default()
        }
    }

    #[test]
    fn names_are_each_another() {
        let labels = ["a", "", "a", "a (2)", ""].map(str::to_owned).to_vec();
        let mut motion = Motion { labels, ..Motion::default() };
        assert_eq!(motion.make_names_unique(), 4);
        assert_eq!(motion.labels, ["a", "unlabelled-2", "a (2)", "a (2) (2)", "unlabelled-5"]);
    }

    #[test]
    fn turning_there_and_back_changes_nothing_and_carries_the_covariance() {
        let mut motion = motion(2, 3, 10.0);
        let sample = motion.samples[0].as_mut().unwrap();
        sample.covariance = [1.0, 0.1, 0.2, 2.0, 0.3, 3.0];
        let wanted = motion.clone();
        let z_up = wanted.samples[0].clone().unwrap();
        assert!(motion.turn(Up::Y) && !motion.turn(Up::Y));
        let y_up = motion.samples[0].clone().unwrap();
        let turn = Matrix3::new(1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -1.0, 0.0);
        assert!((turn * z_up.position - y_up.position).norm() < 1e-12);
        let carried = turn * z_up.covariance().unwrap() * turn.transpose();
        assert!((carried - y_up.covariance().unwrap()).norm() < 1e-6, "{carried}");
        assert!(motion.turn(Up::Z));
        assert_eq!(motion, wanted);
    }

    #[test]
    fn clocks_are_found_where_there_is_one() {
        let rounded = |rate: f64, n: usize| -> Vec<f64> {
            (0..n).map(|it| (it as f64 / rate * 1e6).round() / 1e6 + 3.0).collect()
        };
        assert_eq!(rate_of(&rounded(60.0, 500)), Some(60.0));
        assert_eq!(rate_of(&rounded(59.94, 5000)), Some(59.94));
        let odd = rate_of(&rounded(65.0543, 5000)).unwrap();
        assert!((odd - 65.0543).abs() < 1e-4, "{odd}");
        assert_eq!(rate_of(&[0.0, 0.1, 0.25]), None);
        assert_eq!((rate_of(&[]), rate_of(&[1.0])), (None, None));
    }
}
