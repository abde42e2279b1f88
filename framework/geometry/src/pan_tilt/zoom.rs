//! Optics by zoom position: a calibrated table with interpolation between its stops.
//!
//! Between stops each number follows a monotone cubic, so that nothing between two stops lies outside them (F. Fritsch
//! and J. Butland, "A method for constructing local monotone piecewise cubic interpolants", SIAM J. Sci. Stat. Comput.
//! 5(2), 1984); focal lengths are interpolated in their logarithm, since zoom drives go by ratios.

use crate::camera::{Camera, CameraError, Distortion, Intrinsics};

/// Calibrated optics at one position of the zoom drive.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZoomStop {
    /// Position of the drive, in the device's units.
    pub zoom: f64,
    /// Focal lengths, principal point, skew.
    pub intrinsics: Intrinsics,
    /// Lens distortion.
    pub distortion: Distortion,
}

/// Optics by zoom position; positions beyond the ends of the table get the optics of the ends.
#[derive(Debug, Clone, PartialEq)]
pub struct ZoomTable {
    stops: Vec<ZoomStop>,
    /// By stop, what it holds, focal lengths in their logarithm.
    values: Vec<[f64; COLUMNS]>,
    /// By stop, the slopes of the same.
    slopes: Vec<[f64; COLUMNS]>,
}

/// Why stops do not make a table.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ZoomError {
    /// Too few stops to interpolate.
    #[error("{count} zoom stops, expected at least 2")]
    TooFew {
        /// Number of stops.
        count: usize,
    },
    /// Positions that do not increase.
    #[error("zoom stop {stop} is at {found}, expected more than {before}, the position of the stop before it")]
    NotRising {
        /// Index of the stop.
        stop: usize,
        /// Its position.
        found: f64,
        /// Position of the stop before it.
        before: f64,
    },
    /// Focal lengths that are not monotone: one focal length would have two positions.
    #[error(
        "the focal length at zoom stop {stop} is {found} px after {before} px, against the direction of the stops before it"
    )]
    FocalTurnsBack {
        /// Index of the stop.
        stop: usize,
        /// Its focal length [px].
        found: f64,
        /// Focal length of the stop before it [px].
        before: f64,
    },
    /// Optics that cannot be used.
    #[error("zoom stop {stop}: {fault}")]
    BadOptics {
        /// Index of the stop.
        stop: usize,
        /// The fault of the optics.
        fault: CameraError,
    },
}

/// A chosen zoom position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ZoomChoice {
    /// Position of the drive.
    pub zoom: f64,
    /// Radius of the sphere in the image over half the image's shorter side: the requested one, unless the table ends before it [–].
    pub fill: f64,
}

const COLUMNS: usize = 10;

impl ZoomTable {
    /// A table of two stops or more, by rising position.
    ///
    /// # Errors
    /// See [`ZoomError`].
    pub fn new(stops: Vec<ZoomStop>) -> Result<ZoomTable, ZoomError> {
        if stops.len() < 2 {
            return Err(ZoomError::TooFew { count: stops.len() });
        }
        for (stop, it) in stops.iter().enumerate() {
            let camera = Camera {
                image_size: [1, 1],
                intrinsics: it.intrinsics,
                distortion: it.distortion,
                camera_from_world: nalgebra::Isometry3::identity(),
            };
            camera.check().map_err(|fault| ZoomError::BadOptics { stop, fault })?;
        }
        let rises = stops[1].intrinsics.focal[0] > stops[0].intrinsics.focal[0];
        for (stop, pair) in stops.windows(2).enumerate() {
            let [before, found] = [pair[0].zoom, pair[1].zoom];
            if !(found.is_finite() && before.is_finite() && found > before) {
                return Err(ZoomError::NotRising { stop: stop + 1, found, before });
            }
            let [before, found] = [pair[0].intrinsics.focal[0], pair[1].intrinsics.focal[0]];
            if found == before || (found > before) != rises {
                return Err(ZoomError::FocalTurnsBack { stop: stop + 1, found, before });
            }
        }
        let values: Vec<[f64; COLUMNS]> = stops.iter().map(values).collect();
        let slopes = slopes(&stops, &values);
        Ok(ZoomTable { stops, values, slopes })
    }

    /// The calibrated stops, by rising position.
    pub fn stops(&self) -> &[ZoomStop] {
        &self.stops
    }

    /// First and last position of the table.
    pub fn range(&self) -> [f64; 2] {
        [self.stops[0].zoom, self.stops[self.stops.len() - 1].zoom]
    }

    /// Interpolated optics at the position `zoom`; NaN gives the first stop.
    pub fn optics_at(&self, zoom: f64) -> (Intrinsics, Distortion) {
        let [first, last] = self.range();
        let zoom = if zoom.is_nan() { first } else { zoom.clamp(first, last) };
        let at = self.interval(|stop| stop.zoom <= zoom);
        let mut found = [0.0; COLUMNS];
        for (column, value) in found.iter_mut().enumerate() {
            *value = self.column_at(at, column, zoom);
        }
        let [ln_x, ln_y, u, v, skew, k1, k2, p1, p2, k3] = found;
        (Intrinsics { focal: [ln_x.exp(), ln_y.exp()], principal: [u, v], skew }, Distortion { k1, k2, p1, p2, k3 })
    }

    /// The position with the horizontal focal length `focal` [px], or the end of the table nearest to it.
    pub fn zoom_of_focal(&self, focal: f64) -> f64 {
        let [first, last] = self.range();
        let rises = self.values[1][0] > self.values[0][0];
        let wanted = focal.ln();
        let ends = [self.values[0][0], self.values[self.values.len() - 1][0]];
        if wanted.is_nan() || (wanted <= ends[0]) == rises {
            return first;
        }
        if (wanted >= ends[1]) == rises {
            return last;
        }
        let at = self.interval(|stop| (stop.intrinsics.focal[0].ln() <= wanted) == rises);
        let (mut low, mut high) = (self.stops[at].zoom, self.stops[at + 1].zoom);
        // Halving: sixty times is to the last digit.
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if (self.column_at(at, 0, middle) <= wanted) == rises {
                low = middle;
            } else {
                high = middle;
            }
        }
        0.5 * (low + high)
    }

    /// The position at which a sphere of `radius` [m], its centre on the axis `depth` [m] from the lens, fills the
    /// part `fill` of half the shorter side of an image of `image_size` [px]. A lens inside the sphere gets the
    /// shortest focal length.
    pub fn zoom_of_sphere(&self, radius: f64, depth: f64, image_size: [u32; 2], fill: f64) -> ZoomChoice {
        let half_side = 0.5 * f64::from(image_size[0].min(image_size[1]));
        // The rim is seen at tan = radius / √(depth² − radius²).
        let tangent = radius / (depth * depth - radius * radius).max(0.0).sqrt();
        let focal = fill * half_side / tangent;
        let zoom = self.zoom_of_focal(if focal.is_nan() { 0.0 } else { focal });
        ZoomChoice { zoom, fill: self.optics_at(zoom).0.focal[0] * tangent / half_side }
    }

    /// The interval that starts with the last stop for which `before` holds.
    fn interval(&self, before: impl FnMut(&ZoomStop) -> bool) -> usize {
        self.stops.partition_point(before).clamp(1, self.stops.len() - 1) - 1
    }

    /// Hermite's cubic in interval `at`.
    fn column_at(&self, at: usize, column: usize, zoom: f64) -> f64 {
        let width = self.stops[at + 1].zoom - self.stops[at].zoom;
        let t = (zoom - self.stops[at].zoom) / width;
        let [from, to] = [self.values[at][column], self.values[at + 1][column]];
        let [leaving, arriving] = [self.slopes[at][column] * width, self.slopes[at + 1][column] * width];
        let s = 1.0 - t;
        s * s * (1.0 + 2.0 * t) * from + t * t * (1.0 + 2.0 * s) * to + t * s * (s * leaving - t * arriving)
    }
}

fn values(stop: &ZoomStop) -> [f64; COLUMNS] {
    let Intrinsics { focal, principal, skew } = stop.intrinsics;
    let Distortion { k1, k2, p1, p2, k3 } = stop.distortion;
    [focal[0].ln(), focal[1].ln(), principal[0], principal[1], skew, k1, k2, p1, p2, k3]
}

/// Slopes at the stops: the weighted harmonic mean of those of the two intervals, 0 where these disagree.
fn slopes(stops: &[ZoomStop], values: &[[f64; COLUMNS]]) -> Vec<[f64; COLUMNS]> {
    let last = stops.len() - 1;
    let width = |at: usize| stops[at + 1].zoom - stops[at].zoom;
    let mut slopes = vec![[0.0; COLUMNS]; stops.len()];
    for column in 0..COLUMNS {
        let secant = |at: usize| (values[at + 1][column] - values[at][column]) / width(at);
        for (at, slope) in slopes.iter_mut().enumerate().take(last).skip(1) {
            let (left, right) = (secant(at - 1), secant(at));
            if left * right > 0.0 {
                let share = (width(at - 1) + 2.0 * width(at)) / (3.0 * (width(at - 1) + width(at)));
                slope[column] = left * right / (share * right + (1.0 - share) * left);
            }
        }
        slopes[0][column] = end_slope(secant(0), slopes[1][column], last == 1);
        slopes[last][column] = end_slope(secant(last - 1), slopes[last - 1][column], last == 1);
    }
    slopes
}

/// At an end: such that the cubic is a parabola there, as far as it stays monotone.
fn end_slope(secant: f64, inner: f64, only_two: bool) -> f64 {
    if only_two {
        return secant;
    }
    let parabola = 2.0 * secant - inner;
    if parabola * secant <= 0.0 { 0.0 } else { parabola.abs().min(3.0 * secant.abs()).copysign(secant) }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn stop(zoom: f64, focal: f64, k1: f64) -> ZoomStop {
        ZoomStop {
            zoom,
            intrinsics: Intrinsics { focal: [focal, focal * 1.01], principal: [319.5, 239.5], skew: 0.0 },
            distortion: Distortion { k1, ..Distortion::default() },
        }
    }

    /// Twelve-fold, as a consumer's head has it; the drive is nearly exponential.
    fn lens(zoom: f64) -> ZoomStop {
        let t: f64 = zoom / 1023.0;
        stop(zoom, 700.0 * (2.2 * t + 0.28 * t.powi(3)).exp(), -0.22 * (1.0 - t).powi(2))
    }

    fn table(n: usize) -> ZoomTable {
        ZoomTable::new((0..n).map(|it| lens(1023.0 * it as f64 / (n - 1) as f64)).collect()).unwrap()
    }

    #[test]
    fn stops_are_met_and_what_lies_between_is_near() {
        let table = table(9);
        for it in table.stops() {
            let (intrinsics, distortion) = table.optics_at(it.zoom);
            assert!((intrinsics.focal[1] - it.intrinsics.focal[1]).abs() < 1e-9);
            assert!((distortion.k1 - it.distortion.k1).abs() < 1e-12);
        }
        let (mut worst, mut worst_straight) = (0.0_f64, 0.0_f64);
        for zoom in 0..1024 {
            let truth = lens(f64::from(zoom)).intrinsics.focal[0];
            let off = |focal: f64| (focal / truth - 1.0).abs();
            worst = worst.max(off(table.optics_at(f64::from(zoom)).0.focal[0]));
            let at = (zoom as usize * 8 / 1023).min(7);
            let pair = [table.stops()[at], table.stops()[at + 1]];
            let share = (f64::from(zoom) - pair[0].zoom) / (pair[1].zoom - pair[0].zoom);
            let straight = pair[0].intrinsics.focal[0] * (1.0 - share) + pair[1].intrinsics.focal[0] * share;
            worst_straight = worst_straight.max(off(straight));
        }
        // Nine stops: 0.02 % against 1.5 % by straight lines.
        assert!(worst < 5e-4 && worst_straight > 20.0 * worst, "{worst} {worst_straight}");
    }

    proptest! {
        #[test]
        fn nothing_between_two_stops_lies_outside_them(
            steps in prop::collection::vec((0.1..50.0_f64, 0.001..2.0_f64, -0.4..0.4_f64), 2..8), falls: bool,
        ) {
            let (mut zoom, mut ln_focal) = (0.0, 6.0);
            let stops: Vec<ZoomStop> = steps.iter().map(|(width, gain, k1)| {
                zoom += width;
                ln_focal += if falls { -gain } else { *gain };
                stop(zoom, f64::exp(ln_focal), *k1)
            }).collect();
            let table = ZoomTable::new(stops.clone()).unwrap();
            for pair in stops.windows(2) {
                let mut before = pair[0].intrinsics.focal[0];
                for part in 1..=20 {
                    let zoom = pair[0].zoom + (pair[1].zoom - pair[0].zoom) * f64::from(part) / 20.0;
                    let (intrinsics, distortion) = table.optics_at(zoom);
                    let focal = intrinsics.focal[0];
                    let onward = if falls { before / focal } else { focal / before };
                    prop_assert!(onward > 1.0 - 1e-12);
                    before = focal;
                    let [low, high] = [pair[0].distortion.k1, pair[1].distortion.k1];
                    prop_assert!((low.min(high) - 1e-12..=low.max(high) + 1e-12).contains(&distortion.k1));
                    let back = table.optics_at(table.zoom_of_focal(focal)).0.focal[0];
                    prop_assert!((back / focal - 1.0).abs() < 1e-9, "{back} {focal}");
                }
            }
        }
    }

    #[test]
    fn beyond_the_ends_the_ends_hold() {
        let table = table(5);
        let [first, last] = table.range();
        assert_eq!(table.optics_at(-5.0), table.optics_at(first));
        assert_eq!(table.optics_at(1e9), table.optics_at(last));
        assert_eq!(table.optics_at(f64::NAN), table.optics_at(first));
        assert_eq!(
            [table.zoom_of_focal(1.0), table.zoom_of_focal(1e9), table.zoom_of_focal(f64::NAN)],
            [first, last, first]
        );
    }

    #[test]
    fn a_sphere_fills_what_was_asked_for() {
        let table = table(9);
        let choice = table.zoom_of_sphere(0.25, 4.0, [640, 480], 0.8);
        assert!((choice.fill - 0.8).abs() < 1e-9);
        // The rim of a sphere lies at the tangent from the lens: sin = radius / depth.
        let focal = table.optics_at(choice.zoom).0.focal[0];
        assert!((focal * (0.25_f64 / 4.0).asin().tan() - 0.8 * 240.0).abs() < 1e-6);
        // Too near and too far for this lens, and a lens inside the sphere.
        let near = table.zoom_of_sphere(0.25, 0.3, [640, 480], 0.8);
        assert!(near.zoom == 0.0 && near.fill > 0.8);
        let far = table.zoom_of_sphere(0.25, 400.0, [640, 480], 0.8);
        assert!(far.zoom == 1023.0 && far.fill < 0.8);
        assert_eq!(table.zoom_of_sphere(0.5, 0.3, [640, 480], 0.8).zoom, 0.0);
    }

    #[test]
    fn what_is_no_table_is_refused_with_the_place() {
        let refused = |stops: Vec<ZoomStop>| ZoomTable::new(stops).unwrap_err();
        assert_eq!(refused(vec![lens(0.0)]), ZoomError::TooFew { count: 1 });
        assert_eq!(
            refused(vec![lens(0.0), lens(9.0), lens(9.0)]),
            ZoomError::NotRising { stop: 2, found: 9.0, before: 9.0 }
        );
        assert_eq!(
            refused(vec![stop(0.0, 500.0, 0.0), stop(1.0, 600.0, 0.0), stop(2.0, 550.0, 0.0)]),
            ZoomError::FocalTurnsBack { stop: 2, found: 550.0, before: 600.0 }
        );
        assert!(matches!(
            refused(vec![stop(0.0, 500.0, 0.0), stop(1.0, -6.0, 0.0)]),
            ZoomError::BadOptics { stop: 1, .. }
        ));
        assert!(matches!(
            ZoomTable::new(vec![lens(0.0), lens(f64::NAN)]),
            Err(ZoomError::BadOptics { .. } | ZoomError::NotRising { .. })
        ));
    }
}
