//! Two targets whose images have run into one spot.
//!
//! Lights that are closer in a picture than their images are wide are one spot, whose centre lies between them. Associated with one of the two, it biases that one by half of
//! their distance and leaves the other without any; as all cameras on one side see the pair like this, both are lost. Here the spot is a measurement of both
//! (W. Koch and G. van Keuk, "Multiple hypothesis track maintenance with possibly unresolved measurements", IEEE Trans. Aerospace and Electronic Systems 33(3), 1997):
//!
//! z = (h(x₁) + h(x₂)) / 2 + noise of covariance R, R = of the feature + (w d)(w d)ᵀ, d = h(x₁) − h(x₂), w = [`WEIGHT_SIGMA`]
//!
//! With P₁ and P₂ the covariances of both predicted places in the picture, that is a measurement 2z − h(x₂) of the first with covariance 4R + P₂, and of the second likewise.
//! It is used where both are predicted within the spot, and where that explains its centre better than the one target that it was associated with.

use foveate::messages::Feature;
use nalgebra::{Matrix2, Matrix2x3, Point2};

use super::association::{Association, Gate, Pair, widened};

/// The lights of a spot are not equally bright, and one may be half occluded: position of the centre between the two, standard deviation [parts of their distance].
const WEIGHT_SIGMA: f64 = 0.25;
/// A target is predicted within a spot when it is no farther from its centre than this [radii of a disc as large].
const WITHIN: f64 = 1.2;

/// Two targets farther apart than this in a picture are not one spot [px].
const MOST_APART_PX: f64 = 12.0;
/// Largest certainty that a target is seen or occluded [–].
const MOST_SURE: f64 = 0.95;

/// Predicted place of a target in a picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Predicted {
    pub track: usize,
    pub view: usize,
    /// Recent detection rate [–].
    pub share: f64,
    /// [px]
    pub pixel: Point2<f64>,
    /// Of the pixel by the position [px/m].
    pub jacobian: Matrix2x3<f64>,
    /// Of the predicted pixel, without any feature's error [px²].
    pub covariance: Matrix2<f64>,
}

/// A spot.
#[derive(Debug, Clone, Copy)]
struct Spot {
    /// Its number among the features.
    feature: usize,
    /// [px]
    centre: Point2<f64>,
    /// Of the centre, the camera's own error included [px²].
    covariance: Matrix2<f64>,
    /// [px²]
    area: f64,
}

impl Association {
    /// Associates a spot with two targets, once features are chosen: where two, of which at most one has a feature, are predicted within it.
    pub fn share_spots(&mut self, features: &[Feature], gate: &Gate) {
        self.predicted.sort_unstable_by(|a, b| a.pixel.y.total_cmp(&b.pixel.y).then(a.track.cmp(&b.track)));
        for first in 0..self.predicted.len() {
            let one = self.predicted[first];
            for second in first + 1..self.predicted.len() {
                let other = self.predicted[second];
                if other.pixel.y - one.pixel.y > MOST_APART_PX {
                    break;
                }
                let tracks = [one.track, other.track];
                let is_apart = (one.pixel.x - other.pixel.x).abs() > MOST_APART_PX;
                let has_feature = tracks.map(|it| self.target_taken[it]);
                if is_apart || tracks.iter().any(|it| self.is_unresolved[*it]) || has_feature == [true, true] {
                    continue;
                }
                let owner = self.chosen.iter().position(|it| tracks.contains(&it.track));
                let spot = match owner {
                    Some(owner) => Some(self.chosen[owner].feature),
                    None => self.nearest_free(&nalgebra::center(&one.pixel, &other.pixel), features),
                };
                let Some(feature) = spot else { continue };
                let Feature { centre, covariance, area, .. } = features[feature];
                let covariance = widened(&covariance, gate.camera_variance);
                let spot = Spot { feature, centre, covariance, area: f64::from(area) };
                let Some((both, cost)) = of_both(&spot, [&one, &other], gate.sigma) else { continue };
                if let Some(owner) = owner {
                    // That the other one is there, and that it is hidden.
                    let seen = if self.chosen[owner].track == one.track { other.share } else { one.share };
                    let seen = seen.clamp(1.0 - MOST_SURE, MOST_SURE);
                    if cost - 2.0 * (seen / (1.0 - seen)).ln() > self.chosen[owner].cost {
                        continue;
                    }
                    self.target_taken[self.chosen[owner].track] = false;
                    self.chosen.swap_remove(owner);
                }
                self.feature_taken[feature] = true;
                for pair in both {
                    self.is_unresolved[pair.track] = true;
                    self.chosen.push(pair);
                }
            }
        }
    }

    /// The feature closest to `place` without a target.
    fn nearest_free(&self, place: &Point2<f64>, features: &[Feature]) -> Option<usize> {
        let first = self.rows.partition_point(|row| row.0 < place.y - MOST_APART_PX);
        let near = self.rows[first..].iter().take_while(|row| row.0 <= place.y + MOST_APART_PX).map(|it| it.1);
        let off = |feature: usize| (features[feature].centre - place).norm_squared();
        near.filter(|it| !self.feature_taken[*it]).min_by(|a, b| off(*a).total_cmp(&off(*b)).then(a.cmp(b)))
    }
}

/// The observations of both targets by `spot`, and −2 ln of its likelihood as in [`Pair::cost`]; `None` where it is not both of them, within `gate_sigma` standard deviations.
fn of_both(spot: &Spot, pair: [&Predicted; 2], gate_sigma: f64) -> Option<([Pair; 2], f64)> {
    let reach = WITHIN * (spot.area / std::f64::consts::PI).sqrt();
    if pair.iter().any(|it| (it.pixel - spot.centre).norm_squared() > reach * reach) {
        return None;
    }
    let apart = WEIGHT_SIGMA * (pair[0].pixel - pair[1].pixel);
    let noise = spot.covariance + apart * apart.transpose();
    let off = spot.centre - nalgebra::center(&pair[0].pixel, &pair[1].pixel);
    let s = (pair[0].covariance + pair[1].covariance) / 4.0 + noise;
    let squared = off.dot(&(s.try_inverse()? * off));
    if squared.is_nan() || squared > gate_sigma * gate_sigma {
        return None;
    }
    let cost = squared + s.determinant().ln();
    let of = |own: &Predicted, other: &Predicted| Pair {
        cost,
        view: own.view,
        track: own.track,
        feature: spot.feature,
        pixel: own.pixel + 2.0 * off,
        innovation: 2.0 * off,
        jacobian: own.jacobian,
        spread: 4.0 * noise - spot.covariance + other.covariance,
    };
    Some(([of(pair[0], pair[1]), of(pair[1], pair[0])], cost))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn predicted(track: usize, x: f64) -> Predicted {
        let (jacobian, covariance) = (Matrix2x3::zeros(), Matrix2::identity() * 0.04);
        Predicted { track, view: track, share: 0.8, pixel: Point2::new(x, 20.0), jacobian, covariance }
    }

    /// What a spot at `x` says of targets that are predicted at 10 and 13 px.
    fn seen(x: f64, area: f64) -> Option<[Pair; 2]> {
        let spot = Spot { feature: 0, centre: Point2::new(x, 20.0), covariance: Matrix2::identity() * 0.09, area };
        of_both(&spot, [&predicted(3, 10.0), &predicted(5, 13.0)], 4.0).map(|it| it.0)
    }

    #[test]
    fn a_spot_midway_moves_neither_target_and_one_beside_moves_both_alike() {
        let both = seen(11.5, 25.0).unwrap();
        assert_eq!(both.map(|it| it.track), [3, 5]);
        assert!(both.iter().all(|it| it.innovation.norm() < 1e-12), "{both:?}");
        let both = seen(11.7, 25.0).unwrap();
        assert!(both.iter().all(|it| (it.innovation.x - 0.4).abs() < 1e-12), "{both:?}");
        assert!((both[1].pixel.x - 13.4).abs() < 1e-12);
    }

    #[test]
    fn it_says_less_the_farther_they_are_apart_and_less_than_a_spot_of_one() {
        let [it, _] = seen(11.5, 25.0).unwrap();
        // 4 R and the other one's 0.04 px²; along the line between them 4 (0.25 · 3 px)², too.
        let noise = it.spread + Matrix2::identity() * 0.09;
        assert!((noise[(1, 1)] - (4.0 * 0.09 + 0.04)).abs() < 1e-12, "{noise}");
        assert!((noise[(0, 0)] - noise[(1, 1)] - 4.0 * 0.75 * 0.75).abs() < 1e-12, "{noise}");
    }

    #[test]
    fn a_small_spot_and_one_beside_the_pair_are_not_both() {
        assert!(seen(11.5, 4.0).is_none(), "neither light lies within it");
        assert!(seen(10.0, 12.0).is_none(), "the first one alone");
        assert!(seen(16.0, 60.0).is_none());
    }
}
