//! Which feature of a frame belongs to which target.
//!
//! Each target is projected into the camera; the nearest feature is its own [Davis 2002 §3.4], within a gate. Nearest is
//! meant in the filter's own measure, νᵀS⁻¹ν + ln det S: the likelihood, up to a constant. The second term lets a target
//! that is known well win over one that could be anywhere, as a newborn one could, which the distance νᵀS⁻¹ν alone would
//! favour. The best pair is fixed first, then the best of the rest: one feature to one target.

use foveate::geometry::Camera;
use foveate::messages::Feature;
use nalgebra::{Matrix2, Matrix2x3, Vector2};

use super::track::Track;

/// What a pair needs to be a pair.
#[derive(Debug, Clone, Copy)]
pub(super) struct Gate {
    /// Largest √(νᵀS⁻¹ν) [–].
    pub sigma: f64,
    /// Largest |ν| [px].
    pub pixels: f64,
    /// Variance added to each axis of each feature [px²].
    pub camera_variance: f64,
}

/// The search for pairs, with its buffers.
#[derive(Debug, Default)]
pub(super) struct Association {
    /// Row and number of each usable feature, ascending by row.
    rows: Vec<(f64, usize)>,
    pairs: Vec<Pair>,
    /// By target: whether it has a feature.
    target_taken: Vec<bool>,
    /// By target: whether it lies in the camera's field of view.
    in_view: Vec<bool>,
    /// By feature: whether it has a target.
    feature_taken: Vec<bool>,
    /// Features without finite numbers or with a negative variance.
    pub unusable: u64,
}

/// A target and a feature that may be its own.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair {
    /// νᵀS⁻¹ν + ln det S; less is better.
    cost: f64,
    /// Number of the target.
    pub track: usize,
    /// Number of the feature.
    pub feature: usize,
    /// Measured minus expected [px].
    pub innovation: Vector2<f64>,
    /// Of the pixel by the position [px/m].
    pub jacobian: Matrix2x3<f64>,
}

impl Association {
    /// Pairs `tracks`, already carried to the time of the frame, with `features`.
    pub fn run(&mut self, tracks: &[Track], camera: &Camera, features: &[Feature], gate: &Gate) {
        let largest_variance = self.sort_features(features);
        self.pairs.clear();
        self.in_view.clear();
        for (index, track) in tracks.iter().enumerate() {
            self.pair_up(index, track, camera, features, gate, largest_variance);
        }
        // A complete order: equal costs by identity, then by place, so that a run can be repeated.
        self.pairs.sort_unstable_by(|a, b| {
            a.cost.total_cmp(&b.cost).then_with(|| (a.track, a.feature).cmp(&(b.track, b.feature)))
        });
        self.target_taken.clear();
        self.target_taken.resize(tracks.len(), false);
        let (target_taken, feature_taken) = (&mut self.target_taken, &mut self.feature_taken);
        self.pairs.retain(|pair| {
            let free = !target_taken[pair.track] && !feature_taken[pair.feature];
            if free {
                target_taken[pair.track] = true;
                feature_taken[pair.feature] = true;
            }
            free
        });
    }

    /// The pairs of the last frame: at most one a target, at most one a feature.
    pub fn pairs(&self) -> &[Pair] {
        &self.pairs
    }

    /// Whether target number `track` got a feature in the last frame.
    pub fn has_feature(&self, track: usize) -> bool {
        self.target_taken.get(track).copied().unwrap_or(false)
    }

    /// Whether target number `track` lay in the field of view of the last frame's camera.
    pub fn in_view(&self, track: usize) -> bool {
        self.in_view.get(track).copied().unwrap_or(false)
    }

    /// Takes note that target number `track` is gone and those behind it move up.
    pub fn forget_target(&mut self, track: usize) {
        if track < self.target_taken.len() {
            self.target_taken.remove(track);
            self.in_view.remove(track);
        }
    }

    /// The usable features of the last frame that no target got.
    pub fn unmatched(&self) -> impl Iterator<Item = usize> + '_ {
        self.rows.iter().map(|it| it.1).filter(|&feature| !self.feature_taken[feature])
    }

    /// Lists the usable features by row; returns the largest variance among them [px²].
    fn sort_features(&mut self, features: &[Feature]) -> f64 {
        self.rows.clear();
        self.feature_taken.clear();
        self.feature_taken.resize(features.len(), false);
        let mut largest: f64 = 0.0;
        for (index, feature) in features.iter().enumerate() {
            let [a, b, c] = [feature.covariance[(0, 0)], feature.covariance[(0, 1)], feature.covariance[(1, 1)]];
            let finite = feature.centre.coords.sum().is_finite() && (a + b + c).is_finite();
            if !(finite && a >= 0.0 && c >= 0.0 && a * c >= b * b) {
                self.unusable += 1;
                continue;
            }
            largest = largest.max(a + c);
            self.rows.push((feature.centre.y, index));
        }
        self.rows.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then_with(|| a.1.cmp(&b.1)));
        largest
    }

    /// Adds the pairs of one target.
    fn pair_up(
        &mut self,
        index: usize,
        track: &Track,
        camera: &Camera,
        features: &[Feature],
        gate: &Gate,
        largest_variance: f64,
    ) {
        let projected = camera.project_with_jacobian(&track.filter.position);
        self.in_view.push(projected.is_some_and(|(pixel, _)| camera.has_pixel(&pixel)));
        let Some((expected, jacobian)) = projected else { return };
        let own = Matrix2::identity() * gate.camera_variance;
        let predicted = track.filter.innovation_covariance(&jacobian, &own);
        // No axis of S is longer than its trace; a feature further away than that cannot pass the gate.
        let reach = gate.pixels.min(gate.sigma * (predicted.trace() + largest_variance).sqrt());
        let first = self.rows.partition_point(|row| row.0 < expected.y - reach);
        for &(row, feature) in &self.rows[first..] {
            if row > expected.y + reach {
                break;
            }
            let innovation = features[feature].centre - expected;
            if !(innovation.x.abs() <= reach && innovation.norm_squared() <= gate.pixels * gate.pixels) {
                continue;
            }
            let s = predicted + features[feature].covariance;
            let determinant = s[(0, 0)] * s[(1, 1)] - s[(0, 1)] * s[(1, 0)];
            let (x, y) = (innovation.x, innovation.y);
            let squared = (s[(1, 1)] * x * x - (s[(0, 1)] + s[(1, 0)]) * x * y + s[(0, 0)] * y * y) / determinant;
            if determinant > 0.0 && squared <= gate.sigma * gate.sigma {
                self.pairs.push(Pair { cost: squared + determinant.ln(), track: index, feature, innovation, jacobian });
            }
        }
    }
}

/// A feature's covariance and the camera's own error [px²].
pub(super) fn widened(covariance: &Matrix2<f64>, camera_variance: f64) -> Matrix2<f64> {
    covariance + Matrix2::identity() * camera_variance
}
