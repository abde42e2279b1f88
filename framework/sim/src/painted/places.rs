//! Where marks are painted on a face [Davis 2002, Figs. 55 and 58].

use super::surface::{Spot, Surface};

/// y (left) and z (up) of the marks on the right half of the face and on its middle, by the built-in head [mm]; those with y ≠ 0 have a
/// twin on the other half. Earlier ones are painted first.
const FACE: [[f64; 2]; 43] = [
    // Around the mouth, the chin.
    [0.0, -45.0],
    [14.0, -47.0],
    [31.0, -61.0],
    [0.0, -79.0],
    [14.5, -77.0],
    [27.5, -75.0],
    [0.0, -95.0],
    [15.0, -94.0],
    // Nose.
    [0.0, 16.0],
    [0.0, 2.0],
    [0.0, -10.5],
    [0.0, -22.5],
    [14.0, -26.5],
    // Brows.
    [13.0, 36.0],
    [26.0, 39.5],
    [39.0, 39.0],
    [51.5, 33.0],
    // Below and beside the eyes.
    [17.0, -5.0],
    [30.0, -8.0],
    [43.5, -6.0],
    [55.0, 5.0],
    // Cheeks.
    [30.0, -23.0],
    [44.5, -20.5],
    [57.5, -14.0],
    [26.0, -41.0],
    [39.5, -37.0],
    [52.5, -31.0],
    [44.0, -53.0],
    [55.0, -47.0],
    // Forehead.
    [0.0, 42.5],
    [20.0, 51.0],
    [42.0, 52.0],
    [10.0, 61.5],
    [31.0, 63.0],
    [0.0, 74.0],
    [20.0, 75.0],
    [51.0, 62.0],
    // Jaw.
    [30.0, -88.0],
    [43.0, -69.0],
    [0.0, -106.0],
    [40.0, 74.0],
    [42.0, -82.0],
    [54.0, 46.0],
];

/// The most marks that a face has room for.
pub(crate) const MOST: usize = 76;

/// Spots of the first `n` marks; `place` takes y and z of the built-in head to those of the surface [mm].
pub(super) fn on_face(surface: &Surface, n: usize, place: impl Fn([f64; 2]) -> [f64; 2]) -> Vec<Spot> {
    let both = FACE.iter().flat_map(|&[y, z]| {
        let twin = (y != 0.0).then_some([-y, z]);
        [Some([y, z]), twin].into_iter().flatten()
    });
    let spots = both.filter_map(|at| {
        let [y, z] = place(at);
        surface.spot_from_ahead(y * 1e-3, z * 1e-3)
    });
    spots.take(n).collect()
}
