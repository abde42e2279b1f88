//! Where a named place is in a solved room, and how well that is known.

use foveate_estimation::statistics::median;
use foveate_geometry::CameraStatus;
use nalgebra::{Point3, Vector3};

use super::{AxesError, AxesOptions, Place};
use crate::solved::{ObservationRole, Solved};

/// Places that make a mean, at least.
const LEAST_IN_SPAN: usize = 2;
/// Samples of a stop, at least.
const LEAST_AT_STOP: usize = 5;
/// Samples in a row that may be off without ending a stop.
const PATIENCE: usize = 3;

/// A stop: a stretch of time in which a light stood still.
#[derive(Debug, Clone, PartialEq)]
pub struct Stop {
    /// First and last moment [s].
    pub span_s: [f64; 2],
    /// Median place, in the unit of the solution.
    pub position: Point3<f64>,
    /// Standard deviation of a coordinate of a single sample about it.
    pub scatter: f64,
    /// How many samples.
    pub count: usize,
}

/// A place with the standard deviation of each of its coordinates, in units of the solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Located {
    pub position: Point3<f64>,
    pub sigma: f64,
}

/// A solved room with what several givens ask of it.
pub(super) struct Room<'a> {
    pub solved: &'a Solved,
    pub options: &'a AxesOptions,
    /// Standard deviation of the place of a point by a single line of sight, across it.
    view_sigma: f64,
    /// By which the shape of the room is uncertain at any place: the median of the cameras' own.
    shape_sigma: f64,
}

impl<'a> Room<'a> {
    pub(super) fn new(solved: &'a Solved, options: &'a AxesOptions) -> Self {
        let across: Vec<f64> = solved
            .observations
            .iter()
            .filter(|it| it.role == ObservationRole::Used)
            .filter_map(|it| {
                let camera = &solved.cameras.get(it.camera)?.camera;
                let point = solved.points.get(it.point?)?.position;
                let depth = (camera.camera_from_world * point).z;
                // A Gaussian pair of numbers is half of the time closer to 0 than 1.1774 of their standard deviation.
                Some(it.residual?.norm() / 1.1774 / camera.intrinsics.focal[0] * depth)
            })
            .collect();
        let view_sigma = median(&across).unwrap_or(0.0);
        let of_cameras: Vec<f64> = solved
            .cameras
            .iter()
            .filter(|it| it.status == CameraStatus::Calibrated)
            .filter_map(|it| Some((it.covariance.as_ref()?.centre.trace() / 3.0).sqrt()))
            .collect();
        Self { solved, options, view_sigma, shape_sigma: median(&of_cameras).unwrap_or(view_sigma) }
    }

    /// Times and places of a light, in the order of time.
    pub(super) fn path(&self, label: u32) -> Vec<(f64, Point3<f64>)> {
        path(self.solved, label)
    }

    pub(super) fn locate(&self, place: &Place) -> Result<Located, AxesError> {
        match place {
            Place::Camera(name) => self.camera(name),
            &Place::Light { label, from_s, until_s } => {
                let samples = self.span(label, from_s, until_s, LEAST_IN_SPAN)?;
                let places: Vec<Point3<f64>> = samples.iter().map(|it| it.1).collect();
                Ok(self.located(median_place(&places), scatter(&places), places.len()))
            }
            &Place::Stop { label, number } => {
                let found = stops(self.solved, label, self.options);
                let stop = number.checked_sub(1).and_then(|it| found.get(it)).ok_or(AxesError::NoStop {
                    label,
                    number,
                    found: found.len(),
                    stop_s: self.options.stop_s,
                })?;
                Ok(self.located(stop.position, stop.scatter, stop.count))
            }
        }
    }

    /// What is left of the path within a span.
    pub(super) fn span(
        &self,
        label: u32,
        from_s: f64,
        until_s: f64,
        needed: usize,
    ) -> Result<Vec<(f64, Point3<f64>)>, AxesError> {
        let path = self.path(label);
        let recorded_s = [path.first(), path.last()].map(|it| it.map_or(f64::NAN, |it| it.0));
        let samples: Vec<_> = path.into_iter().filter(|it| (from_s..=until_s).contains(&it.0)).collect();
        if samples.len() < needed {
            let found = samples.len();
            return Err(AxesError::NoLight { label, from_s, until_s, found, needed, recorded_s });
        }
        Ok(samples)
    }

    fn located(&self, position: Point3<f64>, scatter: f64, count: usize) -> Located {
        // A median is π/2 times as uncertain as a mean.
        let own = (0.5 * std::f64::consts::PI * scatter * scatter / count.max(1) as f64).sqrt();
        Located { position, sigma: own.hypot(self.shape_sigma).max(f64::MIN_POSITIVE) }
    }

    fn camera(&self, name: &str) -> Result<Located, AxesError> {
        let found = self.solved.cameras.iter().find(|it| it.name == name);
        let camera = found.ok_or_else(|| AxesError::NoSuchCamera {
            name: name.to_owned(),
            known: self.solved.cameras.iter().map(|it| it.name.clone()).collect(),
        })?;
        if camera.status != CameraStatus::Calibrated {
            return Err(AxesError::CameraNotSolved { name: name.to_owned(), status: camera.status.clone() });
        }
        let sigma = camera.covariance.as_ref().map_or(self.view_sigma, |it| (it.centre.trace() / 3.0).sqrt());
        Ok(Located { position: camera.camera.centre(), sigma: sigma.max(f64::MIN_POSITIVE) })
    }
}

/// When and where the light `label` stood still, in the order of time.
pub fn stops(solved: &Solved, label: u32, options: &AxesOptions) -> Vec<Stop> {
    let path = path(solved, label);
    let places: Vec<Point3<f64>> = path.iter().map(|it| it.1).collect();
    let middle = median_place(&places);
    let size = median(&places.iter().map(|it| (it - middle).norm()).collect::<Vec<_>>()).unwrap_or(0.0);
    let steps: Vec<f64> = places.windows(2).map(|it| (it[1] - it[0]).norm()).collect();
    // Noise alone moves the light from sample to sample; the quietest of them are those at stops.
    let noise = foveate_estimation::statistics::percentile(&steps, 10.0).unwrap_or(0.0);
    let radius = (options.stop_share * size).max(3.0 * noise);
    let mut found: Vec<Stop> = Vec::new();
    let mut first = 0;
    while first < path.len() {
        let last = stay(&places, first, radius);
        let lasts = path[last].0 - path[first].0 >= options.stop_s;
        if !lasts || last + 1 - first < LEAST_AT_STOP {
            first += 1;
            continue;
        }
        let position = median_place(&places[first..=last]);
        let stop = Stop {
            span_s: [path[first].0, path[last].0],
            position,
            scatter: scatter(&places[first..=last]),
            count: last + 1 - first,
        };
        match found.last_mut().filter(|it| (it.position - position).norm() <= 2.0 * radius) {
            // Jolted, but not carried away.
            Some(before) => {
                before.span_s[1] = stop.span_s[1];
                before.count += stop.count;
            }
            None => found.push(stop),
        }
        first = last + 1;
    }
    found
}

/// The last sample of a stay that begins with `first`.
fn stay(places: &[Point3<f64>], first: usize, radius: f64) -> usize {
    let (mut sum, mut count, mut last) = (places[first].coords, 1.0, first);
    for (index, place) in places.iter().enumerate().skip(first + 1) {
        if (place.coords - sum / count).norm() <= radius {
            (sum, count, last) = (sum + place.coords, count + 1.0, index);
        } else if index - last > PATIENCE {
            break;
        }
    }
    last
}

fn path(solved: &Solved, label: u32) -> Vec<(f64, Point3<f64>)> {
    let usable = |it: &&crate::solved::SolvedPoint| {
        it.label == label && it.time_s.is_finite() && it.position.iter().all(|value| value.is_finite())
    };
    let mut path: Vec<(f64, Point3<f64>)> =
        solved.points.iter().filter(usable).map(|it| (it.time_s, it.position)).collect();
    path.sort_by(|a, b| a.0.total_cmp(&b.0));
    path
}

/// By coordinate; the origin without any.
fn median_place(places: &[Point3<f64>]) -> Point3<f64> {
    let middle = |axis: usize| median(&places.iter().map(|it| it[axis]).collect::<Vec<_>>()).unwrap_or(0.0);
    Point3::from(Vector3::from_fn(|axis, _| middle(axis)))
}

/// Standard deviation of a coordinate.
fn scatter(places: &[Point3<f64>]) -> f64 {
    let middle = median_place(places);
    let squares: f64 = places.iter().map(|it| (it - middle).norm_squared()).sum();
    (squares / (3.0 * (places.len() as f64 - 1.0).max(1.0))).sqrt()
}
