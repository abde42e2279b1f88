//! Where a pointer was held still: intervals in which every camera sees it at one place.

use foveate_calibration::recording::CameraFrame;
use nalgebra::{Point2, Vector2};

/// Largest motion of a spot at rest [px].
const STILL_PX: f64 = 1.0;
/// A picture without the spot is ignored if the next with it comes within this time [s].
const GAP_S: f64 = 0.1;
/// Smallest standard deviation of a place: pixels are not uniform [px].
const LEAST_SIGMA_PX: f64 = 0.02;

/// A pointer that was held still.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rest {
    /// Start and end [s].
    pub(super) span_s: [f64; 2],
    /// Camera, pixel, its standard deviation [px].
    pub(super) seen: Vec<(usize, Point2<f64>, f64)>,
}

/// All rests of at least `hold_s`, by time. `camera_frames` are sorted by time.
pub(super) fn rests(n_cameras: usize, camera_frames: &[CameraFrame], hold_s: f64) -> Vec<Rest> {
    let mut all: Vec<(usize, Stretch)> = Vec::new();
    for camera in 0..n_cameras {
        let mut open: Option<Stretch> = None;
        for frame in camera_frames.iter().filter(|it| it.camera == camera) {
            // A bezel may mirror it: the pointer is the brightest spot.
            let Some(spot) = frame.spots.iter().max_by(|a, b| a.peak.total_cmp(&b.peak)) else { continue };
            match &mut open {
                Some(own) if own.goes_on(frame.time_s, &spot.pixel) => {
                    own.add(frame.time_s, &spot.pixel, spot.sigma_px)
                }
                _ => {
                    all.extend(open.take().map(|it| (camera, it)));
                    open = Some(Stretch::new(frame.time_s, spot.pixel, spot.sigma_px));
                }
            }
        }
        all.extend(open.map(|it| (camera, it)));
    }
    all.retain(|it| it.1.last_s - it.1.first_s >= hold_s);
    all.sort_by(|a, b| a.1.first_s.total_cmp(&b.1.first_s).then(a.0.cmp(&b.0)));
    let mut rests: Vec<Rest> = Vec::new();
    for (camera, it) in all {
        let seen = (camera, it.mean(), it.sigma());
        match rests.last_mut() {
            // Longer at the same time than apart.
            Some(rest) if rest.span_s[1].min(it.last_s) - it.first_s > 0.5 * hold_s => {
                rest.seen.push(seen);
                rest.span_s[1] = rest.span_s[1].max(it.last_s);
            }
            _ => rests.push(Rest { span_s: [it.first_s, it.last_s], seen: vec![seen] }),
        }
    }
    rests
}

#[derive(Debug, Clone)]
struct Stretch {
    begin: Point2<f64>,
    first_s: f64,
    last_s: f64,
    sum: Vector2<f64>,
    variances: f64,
    n: f64,
}

impl Stretch {
    fn new(time_s: f64, pixel: Point2<f64>, sigma: f64) -> Stretch {
        let mut new =
            Stretch { begin: pixel, first_s: time_s, last_s: time_s, sum: Vector2::zeros(), variances: 0.0, n: 0.0 };
        new.add(time_s, &pixel, sigma);
        new
    }

    fn goes_on(&self, time_s: f64, pixel: &Point2<f64>) -> bool {
        (pixel - self.begin).norm() < STILL_PX && time_s - self.last_s < GAP_S
    }

    fn add(&mut self, time_s: f64, pixel: &Point2<f64>, sigma: f64) {
        self.last_s = time_s;
        self.sum += pixel.coords;
        self.variances += sigma * sigma;
        self.n += 1.0;
    }

    fn mean(&self) -> Point2<f64> {
        Point2::from(self.sum / self.n)
    }

    fn sigma(&self) -> f64 {
        (self.variances.sqrt() / self.n).max(LEAST_SIGMA_PX)
    }
}
