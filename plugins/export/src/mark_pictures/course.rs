//! The marks of a session, thinned, for the pictures.

use foveate::prelude::{Marks, Provenance};
use nalgebra::{Matrix3, Point3, SymmetricEigen, UnitQuaternion, Vector3};

/// One mark of one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sample {
    pub label: u32,
    /// In the marks' space [m].
    pub position: Point3<f32>,
    pub is_filled: bool,
}

/// All marks of one moment.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Moment {
    pub time_s: f64,
    pub world_from_marks: nalgebra::Isometry3<f64>,
    pub samples: Vec<Sample>,
    pub rms: Option<f64>,
    pub out_of_distribution: Option<f64>,
}

impl Moment {
    pub fn of(marks: &Marks) -> Moment {
        let sample = |it: &foveate::prelude::Mark| Sample {
            label: it.label,
            position: it.position.cast(),
            is_filled: it.provenance == Provenance::Filled,
        };
        let (rms, out_of_distribution) = marks.fit.as_ref().map(|it| (it.rms, it.out_of_distribution)).unzip();
        Moment {
            time_s: marks.time.as_s(),
            world_from_marks: marks.world_from_marks,
            samples: marks.list.iter().map(sample).collect(),
            rms,
            out_of_distribution,
        }
    }

    pub fn position(&self, label: u32) -> Option<Point3<f64>> {
        let place = self.samples.binary_search_by_key(&label, |it| it.label).ok()?;
        Some(self.samples[place].position.cast())
    }

    /// In the world [m].
    pub fn in_world(&self) -> impl Iterator<Item = (Point3<f64>, bool)> + '_ {
        self.samples.iter().map(|it| (self.world_from_marks * it.position.cast::<f64>(), it.is_filled))
    }
}

/// Moments, thinned to every second one whenever there are too many.
#[derive(Debug, Default)]
pub(super) struct Course {
    pub moments: Vec<Moment>,
    every: u64,
    seen: u64,
}

/// More are not visible in a picture.
const MOST: usize = 4000;

impl Course {
    pub fn push(&mut self, marks: &Marks) {
        let every = self.every.max(1);
        if self.seen.is_multiple_of(every) {
            self.moments.push(Moment::of(marks));
        }
        self.seen += 1;
        if self.moments.len() > MOST {
            let mut number = 0_usize;
            self.moments.retain(|_| {
                number += 1;
                number % 2 == 1
            });
            self.every = 2 * every;
        }
    }

    /// Every `step`-th moment.
    pub fn thinned(&self, step: usize) -> Course {
        Course { moments: self.moments.iter().step_by(step).cloned().collect(), ..Course::default() }
    }

    /// Every label, ascending.
    pub fn labels(&self) -> Vec<u32> {
        let mut labels: Vec<u32> = self.moments.iter().flat_map(|it| &it.samples).map(|it| it.label).collect();
        labels.sort_unstable();
        labels.dedup();
        labels
    }

    /// The distance of two marks over time [m].
    pub fn distance(&self, pair: [u32; 2]) -> Vec<(f64, f64)> {
        let at = |it: &Moment| Some((it.time_s, (it.position(pair[0])? - it.position(pair[1])?).norm()));
        self.moments.iter().filter_map(at).collect()
    }
}

/// A view of a surface: right and up, for marks in their own space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Front {
    middle: Point3<f64>,
    right: Vector3<f64>,
    up: Vector3<f64>,
}

impl Front {
    /// A view from the front of the surface, upright in the world as it is oriented on average. `None` for fewer than three marks, or marks on a line.
    pub fn of(moment: &Moment) -> Option<Front> {
        let points: Vec<Point3<f64>> = moment.samples.iter().map(|it| it.position.cast()).collect();
        if points.len() < 3 {
            return None;
        }
        let middle =
            Point3::from(points.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords) / points.len() as f64);
        let mut spread = Matrix3::zeros();
        points.iter().for_each(|it| spread += (it - middle) * (it - middle).transpose());
        let eigen = SymmetricEigen::new(spread);
        let flattest = eigen.eigenvalues.imin();
        let out: Vector3<f64> = eigen.eigenvectors.column(flattest).into_owned();
        // What lies in the middle of a face or a knee sticks out.
        let far: Vec<(f64, f64)> = points
            .iter()
            .map(|it| {
                let height = (it - middle).dot(&out);
                ((it - middle).norm_squared() - height * height, height)
            })
            .collect();
        let mean = far.iter().map(|it| it.0).sum::<f64>() / far.len() as f64;
        let bulge: f64 = far.iter().map(|it| (mean - it.0) * it.1).sum();
        let out = if bulge < 0.0 { -out } else { out };
        let rotation: UnitQuaternion<f64> = moment.world_from_marks.rotation;
        let upright = rotation.inverse() * Vector3::z();
        let right = upright.cross(&out);
        (right.norm() > 1e-3).then(|| {
            let right = right.normalize();
            Front { middle, right, up: out.cross(&right) }
        })
    }

    /// Right and up [m].
    pub fn place(&self, position: &Point3<f64>) -> [f64; 2] {
        let from = position - self.middle;
        [from.dot(&self.right), from.dot(&self.up)]
    }
}

/// Which marks are neighbours: those between which no other lies (K. R. Gabriel and R. R. Sokal, Systematic Zoology 18, 1969): none in the ball over
/// the two.
pub(super) fn neighbours(moment: &Moment) -> Vec<[u32; 2]> {
    let points: Vec<(u32, Point3<f64>)> = moment.samples.iter().map(|it| (it.label, it.position.cast())).collect();
    let mut pairs = Vec::new();
    for (place, (a, from)) in points.iter().enumerate() {
        for (b, to) in &points[..place] {
            let middle = nalgebra::center(from, to);
            let radius = (from - to).norm_squared() / 4.0;
            let is_free = |it: &(u32, Point3<f64>)| it.0 == *a || it.0 == *b || (it.1 - middle).norm_squared() > radius;
            if points.iter().all(is_free) {
                pairs.push([*a, *b]);
            }
        }
    }
    pairs
}
