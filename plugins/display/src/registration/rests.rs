//! Where a light was held still in the room: intervals in which it stays at one place.

use foveate::prelude::*;
use nalgebra::{Matrix3, Point3};

/// Messages without the light are ignored if the next with it comes within this time.
const GAP_MS: f64 = 200.0;
/// Errors of a tracker are correlated: this many samples of a rest count as one.
const CORRELATED: f64 = 10.0;

/// A light that was held still.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Rest {
    pub(super) from: Time,
    pub(super) until: Time,
    /// Its mean place [m].
    pub(super) point: Point3<f64>,
    /// Of that [m²].
    pub(super) covariance: Matrix3<f64>,
}

/// Samples of one light, in the order of time, as they come.
#[derive(Debug, Default)]
pub(super) struct Rests {
    open: Option<Stretch>,
    done: Vec<Rest>,
}

#[derive(Debug)]
struct Stretch {
    begin: Point3<f64>,
    from: Time,
    until: Time,
    sum: nalgebra::Vector3<f64>,
    covariances: Matrix3<f64>,
    n: f64,
}

impl Rests {
    /// Takes in a sample; while it rests the light keeps within `still` of where it was at first [m], for `hold` at least.
    pub(super) fn add(&mut self, time: Time, point: Point3<f64>, covariance: Matrix3<f64>, still: f64, hold: Interval) {
        let goes_on = self
            .open
            .as_ref()
            .is_some_and(|it| (point - it.begin).norm() < still && time - it.until < Interval::from_ms(GAP_MS));
        if !goes_on {
            self.close(hold);
            let (sum, covariances) = (nalgebra::Vector3::zeros(), Matrix3::zeros());
            self.open = Some(Stretch { begin: point, from: time, until: time, sum, covariances, n: 0.0 });
        }
        if let Some(it) = &mut self.open {
            it.until = time;
            it.sum += point.coords;
            it.covariances += covariance;
            it.n += 1.0;
        }
    }

    fn close(&mut self, hold: Interval) {
        let Some(it) = self.open.take().filter(|it| it.until - it.from >= hold) else { return };
        let Stretch { from, until, sum, covariances, n, .. } = it;
        let covariance = covariances / n / (n / CORRELATED).max(1.0);
        self.done.push(Rest { from, until, point: Point3::from(sum / n), covariance });
    }

    /// All rests.
    pub(super) fn finish(&mut self, hold: Interval) -> &[Rest] {
        self.close(hold);
        &self.done
    }
}
