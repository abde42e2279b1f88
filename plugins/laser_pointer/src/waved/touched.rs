//! Consistency of the places at which a pointer was held: each is compared with maps that were fitted without it.

use foveate::geometry::plane_map::network::{KnownPlace, LEAST_PLACES, MomentObservation, PlaneNetwork, fit_network};
use nalgebra::{Matrix2, Point2, Vector2};

/// Fewest places that identify a wrong one: without it the others still have one to spare.
const LEAST_TO_NAME: usize = LEAST_PLACES + 2;

/// Without the wrong one, the others fit less than this many times worse than without any other.
const ALIKE: f64 = 2.0;

/// A touched place compared with maps that were fitted without it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Touched {
    /// Its number in the order in which places were touched.
    pub(super) number: usize,
    /// Its stated place [m].
    pub(super) point: Point2<f64>,
    /// Distance of its place by these maps from there [m].
    pub(super) miss: f64,
    /// The same in standard deviations of what these maps state and of how the pointer was held.
    pub(super) sigmas: f64,
    /// Root mean square distance of the others from maps without it, in the same unit.
    pub(super) others: f64,
}

/// Each touched place compared with the others; empty with too few to leave one out.
pub(super) fn touched(sizes: &[[u32; 2]], observations: &[MomentObservation], places: &[KnownPlace]) -> Vec<Touched> {
    if places.len() <= LEAST_PLACES {
        return Vec::new();
    }
    let off = (0..places.len()).filter_map(|number| {
        let others: Vec<KnownPlace> =
            places.iter().enumerate().filter(|it| it.0 != number).map(|it| it.1.clone()).collect();
        let network = fit_network(sizes, observations, &others).ok()?;
        let (miss, sigmas) = missed(&network, &places[number])?;
        let squares: Vec<f64> =
            others.iter().filter_map(|it| missed(&network, it)).map(|(_, sigmas)| sigmas * sigmas).collect();
        let others = (squares.iter().sum::<f64>() / squares.len().max(1) as f64).sqrt();
        Some(Touched { number, point: places[number].point, miss, sigmas, others })
    });
    off.collect()
}

/// Distance of a place by the maps from its stated place: by the mean of all cameras [m], and by the most certain camera in standard deviations.
fn missed(network: &PlaneNetwork, place: &KnownPlace) -> Option<(f64, f64)> {
    let (mut sum, mut n, mut best) = (Vector2::zeros(), 0.0, None::<(f64, f64)>);
    for (camera, pixel, sigma) in &place.seen {
        let Ok(map) = &network.maps[*camera] else { continue };
        let Some(placed) = map.place(pixel, &(Matrix2::identity() * (sigma * sigma))) else { continue };
        let off = placed.point - place.point;
        let covariance = placed.covariance + Matrix2::identity() * place.sigma * place.sigma;
        let Some(inverse) = covariance.try_inverse() else { continue };
        (sum, n) = (sum + off, n + 1.0);
        let (size, sigmas) = (covariance.trace(), off.dot(&(inverse * off)).max(0.0).sqrt());
        best = best.filter(|it| it.0 <= size).or(Some((size, sigmas)));
    }
    best.map(|it| ((sum / n).norm(), it.1))
}

/// Message about places that do not fit; `None` where every place is within `most` standard deviations.
pub(super) fn wrong(touched: &[Touched], most: f64) -> Option<String> {
    let worst = touched.iter().max_by(|a, b| a.sigmas.total_cmp(&b.sigmas)).filter(|it| it.sigmas > most)?;
    // Without the one that is wrong the others agree; places in a line may each explain the same.
    let least = touched.iter().map(|it| it.others).fold(f64::INFINITY, f64::min);
    let agree = |it: &&Touched| it.sigmas > most && it.others < most && it.others < ALIKE * least.max(1.0);
    let mut suspects: Vec<&Touched> = touched.iter().filter(agree).collect();
    if touched.len() < LEAST_TO_NAME || suspects.is_empty() {
        suspects = vec![worst];
    }
    let says = |it: &&Touched| {
        format!(
            "place {} of `touch_m`, ({}, {}) m, is {:.0} mm from its place by the others, {:.0} times the standard deviation of their maps and of `touch_mm`",
            it.number + 1,
            it.point.x,
            it.point.y,
            it.miss * 1e3,
            it.sigmas
        )
    };
    let list = suspects.iter().map(says).collect::<Vec<_>>().join(", or ");
    Some(if touched.len() >= LEAST_TO_NAME && suspects.iter().any(agree) {
        format!("{list}: was the pointer held there, and are `touch_m` and `size_m` right?")
    } else {
        format!(
            "{list}: the wrong place cannot be identified with fewer than six; was the pointer held at each of them, in this order, and are `touch_m` and `size_m` right?"
        )
    })
}
