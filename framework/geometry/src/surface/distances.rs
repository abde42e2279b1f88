//! Distances between two shapes in one space, both ways, and how much of the second the first covers.
//!
//! From each point of one shape the distance to the nearest place of the other is taken. Where that place is an open
//! edge, the point lies beside the other shape, and its distance says nothing about the accuracy of either: such
//! points are counted separately, and so are those beyond the search distance.

use foveate_estimation::statistics::percentile;
use nalgebra::{Point3, Vector3};

use super::{Shape, SurfacePoint};

/// Options of [`distances`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DistanceOptions {
    /// Search distance: points farther away are counted as far, and left out otherwise [m].
    pub most: f64,
    /// The second shape counts as covered where the first one is this near [m].
    pub covers: f64,
    /// Number of samples on a triangle mesh from which distances are measured [–].
    pub n_samples: usize,
}

/// Distances from one shape to another.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Distances {
    /// Number of points in front of or behind the other shape and within the search distance; the figures below are of these.
    pub n: usize,
    /// Number of points beside the other shape.
    pub n_beside: usize,
    /// Number of points in front of or behind it beyond the search distance.
    pub n_far: usize,
    /// Median distance [m].
    pub median: f64,
    /// 95th percentile [m].
    pub p95: f64,
    /// Root mean square distance [m].
    pub rms: f64,
    /// Largest distance [m].
    pub max: f64,
    /// Mean signed distance, positive on the side of the other's normals; `None` where normals are unknown [m].
    pub mean: Option<f64>,
}

/// Distances both ways, and coverage.
#[derive(Debug, Clone, PartialEq)]
pub struct ShapeDistances {
    /// From the first to the second.
    pub to_second: Distances,
    /// From the second to the first.
    pub to_first: Distances,
    /// Part of the second shape that the first covers: of its area, or of its points [–].
    pub coverage: f64,
    /// Part of the first shape that the second covers, likewise [–].
    pub coverage_of_first: f64,
    /// By point or corner of the first: distance to the second, signed where normals are known; NaN where it is not counted [m].
    pub of_points: Vec<f64>,
    /// Whether these are signed.
    pub is_signed: bool,
}

/// Distances between `first` and `second`, which lie in one space.
pub fn distances(first: &Shape, second: &Shape, options: &DistanceOptions) -> ShapeDistances {
    let is_signed = second.is_mesh() || second.normals().iter().any(|it| *it != Vector3::zeros());
    let of_points: Vec<f64> = in_parallel(first.points(), |it| match measured(it, second, options.most) {
        Measured::Distance(it, _) => it,
        Measured::Beside | Measured::Far => f64::NAN,
    });
    let from_first = if first.is_mesh() { samples(first, options.n_samples) } else { first.points().to_vec() };
    let from_second = if second.is_mesh() { samples(second, options.n_samples) } else { second.points().to_vec() };
    let covered = |points: &[Point3<f64>], by: &Shape| {
        let is_covered = in_parallel(points, |it| {
            by.nearest_within(it, options.covers).is_some_and(|nearest| (nearest.place - it).norm() <= options.covers)
        });
        is_covered.iter().filter(|it| **it).count() as f64 / points.len().max(1) as f64
    };
    ShapeDistances {
        to_second: summary(&from_first, second, options.most),
        to_first: summary(&from_second, first, options.most),
        coverage: covered(&from_second, first),
        coverage_of_first: covered(&from_first, second),
        of_points,
        is_signed,
    }
}

fn samples(shape: &Shape, n: usize) -> Vec<Point3<f64>> {
    shape.samples(n).iter().map(|it: &SurfacePoint| it.position).collect()
}

#[derive(Debug, Clone, Copy)]
enum Measured {
    /// With a sign where it is known, and whether it is.
    Distance(f64, bool),
    Beside,
    Far,
}

fn measured(point: &Point3<f64>, other: &Shape, most: f64) -> Measured {
    let Some(nearest) = other.nearest(point) else { return Measured::Far };
    let off = point - nearest.place;
    let distance = off.norm();
    match (nearest.is_edge, distance > most) {
        // Not even near an edge.
        (_, true) => Measured::Far,
        (true, _) => Measured::Beside,
        _ if nearest.normal == Vector3::zeros() => Measured::Distance(distance, false),
        _ => Measured::Distance(distance.copysign(off.dot(&nearest.normal)), true),
    }
}

fn summary(points: &[Point3<f64>], other: &Shape, most: f64) -> Distances {
    let mut found = Distances::default();
    let (mut all, mut sum, mut n_signed) = (Vec::new(), 0.0, 0_usize);
    for it in in_parallel(points, |it| measured(it, other, most)) {
        match it {
            Measured::Distance(distance, is_signed) => {
                all.push(distance.abs());
                if is_signed {
                    sum += distance;
                    n_signed += 1;
                }
            }
            Measured::Beside => found.n_beside += 1,
            Measured::Far => found.n_far += 1,
        }
    }
    found.n = all.len();
    found.median = percentile(&all, 50.0).unwrap_or(f64::NAN);
    found.p95 = percentile(&all, 95.0).unwrap_or(f64::NAN);
    found.max = all.iter().copied().reduce(f64::max).unwrap_or(f64::NAN);
    found.rms = (all.iter().map(|it| it * it).sum::<f64>() / all.len() as f64).sqrt();
    found.mean = (n_signed > 0).then(|| sum / n_signed as f64);
    found
}

/// Work on each point, on all cores; the results in order.
fn in_parallel<T: Send>(points: &[Point3<f64>], one: impl Fn(&Point3<f64>) -> T + Sync) -> Vec<T> {
    let threads = std::thread::available_parallelism().map_or(1, |it| it.get());
    let share = points.len().div_ceil(threads).max(1);
    let one = &one;
    std::thread::scope(|scope| {
        let parts: Vec<_> =
            points.chunks(share).map(|part| scope.spawn(move || part.iter().map(one).collect::<Vec<T>>())).collect();
        let joined = |it: std::thread::ScopedJoinHandle<'_, Vec<T>>| match it.join() {
            Ok(part) => part,
            Err(panic) => std::panic::resume_unwind(panic),
        };
        parts.into_iter().flat_map(joined).collect()
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of 1 m at a height, in triangles of 5 cm or as their corners.
    fn square(height: f64, from: f64, is_mesh: bool) -> Shape {
        const N: usize = 21;
        let place = |it: usize| Point3::new(from + (it % N) as f64 * 0.05, (it / N) as f64 * 0.05, height);
        let cell = |it: usize| {
            let a = (it / (N - 1) * N + it % (N - 1)) as u32;
            [[a, a + 1, a + 1 + N as u32], [a, a + 1 + N as u32, a + N as u32]]
        };
        let triangles = if is_mesh { (0..(N - 1) * (N - 1)).flat_map(cell).collect() } else { Vec::new() };
        let up = Point3::new(0.5, 0.5, 9.0);
        Shape::new((0..N * N).map(place).collect(), Vec::new(), triangles, &up).unwrap()
    }

    #[test]
    fn a_square_over_half_of_another_covers_half_and_is_as_high_as_it_is() {
        let options = DistanceOptions { most: 0.2, covers: 0.03, n_samples: 40_000 };
        for (first, second) in [(true, true), (false, true), (true, false), (false, false)] {
            let found = distances(&square(0.01, 0.5, first), &square(0.0, 0.0, second), &options);
            let Distances { n, n_beside, n_far, median, p95, rms, mean, .. } = found.to_second;
            let part = n as f64 / (n + n_beside + n_far) as f64;
            assert!((0.49..0.67).contains(&part), "{first} {second}: {:?}", found.to_second);
            for it in [median, p95, rms, mean.unwrap()] {
                assert!((it - 0.01).abs() < 1e-6, "{first} {second}: {:?}", found.to_second);
            }
            for it in [found.coverage, found.coverage_of_first] {
                assert!((0.49..0.67).contains(&it), "{first} {second}: {it}");
            }
            assert!((found.to_first.mean.unwrap() + 0.01).abs() < 1e-6, "{:?}", found.to_first);
            assert!(found.is_signed && found.of_points.len() == 441);
        }
    }

    #[test]
    fn what_is_farther_than_is_looked_is_counted_as_far() {
        let options = DistanceOptions { most: 0.2, covers: 0.03, n_samples: 1000 };
        let found = distances(&square(0.5, 0.0, true), &square(0.0, 0.0, true), &options);
        assert_eq!((found.to_second.n, found.to_second.n_far, found.coverage), (0, 1000, 0.0));
        assert!(found.to_second.median.is_nan() && found.of_points.iter().all(|it| it.is_nan()));
    }
}
