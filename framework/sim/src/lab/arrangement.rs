//! Where the wide cameras hang and where they look.
//!
//! Two sets that were placed with different goals, used together [Davis 2002, §3.1, Figs. 21 and 23]: one is denser
//! towards a display wall at +y, for people who move in front of it; the other is a rough ring around the volume. The
//! thesis gives the arrangement as drawings without figures: what follows is in its spirit, not to its measures.

use foveate_geometry::{Camera, Distortion};
use nalgebra::Point3;

/// Corners of the volume in which targets are to be tracked [m]: 3.5 m × 5 m, from 0.5 m to 2 m above the floor.
pub const VOLUME_M: [[f64; 3]; 2] = [[-1.75, -2.5, 0.5], [1.75, 2.5, 2.0]];

/// Corners of the room [m]; the display hangs on the wall at +y.
pub const ROOM_M: [[f64; 3]; 2] = [[-3.0, -3.9, 0.0], [3.0, 3.9, 3.0]];

/// Columns and rows of one field [px]: every other line of a picture, so that a pixel is twice as high as wide.
pub const FIELD_SIZE: [u32; 2] = [640, 240];

/// One camera: where it hangs [m], the point on its axis [m], horizontal focal length [px], principal point's shift from
/// the image's middle [px], radial distortion k₁ and k₂ [–].
struct Place {
    centre: [f64; 3],
    target: [f64; 3],
    focal: f64,
    shift: [f64; 2],
    radial: [f64; 2],
}

const fn place(centre: [f64; 3], target: [f64; 3], focal: f64, shift: [f64; 2], radial: [f64; 2]) -> Place {
    Place { centre, target, focal, shift, radial }
}

const PLACES: [Place; 18] = [
    // Towards the display: five above it that look back, three that look at those who stand before it.
    place([-2.45, 3.55, 2.62], [-0.25, 0.70, 1.15], 425.0, [3.1, -1.8], [-0.118, 0.021]),
    place([-1.20, 3.65, 2.74], [-0.40, 0.40, 1.15], 430.0, [-4.2, 0.9], [-0.104, 0.017]),
    place([0.05, 3.70, 2.80], [0.00, 0.20, 1.10], 425.0, [1.4, 2.2], [-0.121, 0.024]),
    place([1.25, 3.65, 2.73], [0.45, 0.35, 1.15], 435.0, [-2.6, -2.4], [-0.109, 0.019]),
    place([2.50, 3.50, 2.60], [0.30, 0.75, 1.15], 420.0, [5.0, 1.1], [-0.115, 0.022]),
    place([-1.60, -0.90, 2.84], [-0.20, 1.75, 1.10], 400.0, [-1.9, -0.7], [-0.112, 0.018]),
    place([0.20, -1.15, 2.88], [0.05, 1.80, 1.05], 405.0, [2.8, 1.6], [-0.101, 0.016]),
    place([1.70, -0.80, 2.83], [0.25, 1.80, 1.10], 400.0, [-3.7, 0.4], [-0.119, 0.023]),
    // The ring.
    place([2.75, 0.55, 2.70], [-0.20, 0.10, 1.00], 395.0, [0.8, -2.9], [-0.107, 0.018]),
    place([2.80, -1.10, 2.66], [-0.10, -0.15, 1.00], 400.0, [-5.3, 1.9], [-0.113, 0.020]),
    place([2.60, -2.75, 2.58], [0.15, -0.45, 1.05], 405.0, [4.4, 0.2], [-0.124, 0.025]),
    place([1.35, -3.60, 2.72], [0.30, -0.60, 1.05], 410.0, [-0.6, -1.3], [-0.105, 0.017]),
    place([-0.10, -3.70, 2.78], [0.05, -0.50, 1.05], 415.0, [2.1, 2.7], [-0.116, 0.021]),
    place([-1.50, -3.55, 2.70], [-0.35, -0.60, 1.05], 410.0, [-3.2, -0.5], [-0.110, 0.019]),
    place([-2.65, -2.65, 2.55], [-0.10, -0.40, 1.05], 405.0, [1.7, -2.1], [-0.122, 0.024]),
    place([-2.80, -0.95, 2.68], [0.15, -0.10, 1.00], 395.0, [-4.8, 0.7], [-0.103, 0.016]),
    place([-2.75, 0.70, 2.71], [0.15, 0.10, 1.00], 400.0, [3.5, 1.3], [-0.114, 0.020]),
    place([-2.70, 2.20, 2.63], [0.00, 0.35, 1.00], 400.0, [-1.1, -1.6], [-0.108, 0.019]),
];

/// How many cameras there are.
pub const N_CAMERAS: usize = PLACES.len();

/// The wide cameras with their names, `wide-1` to `wide-18`, in that order.
pub fn wide_cameras() -> Vec<(String, Camera)> {
    PLACES.iter().enumerate().map(|(i, place)| (format!("wide-{}", i + 1), camera_at(place))).collect()
}

fn camera_at(place: &Place) -> Camera {
    let mut camera = Camera::look_at(Point3::from(place.centre), Point3::from(place.target), FIELD_SIZE, place.focal);
    camera.intrinsics.focal[1] = place.focal / 2.0;
    camera.intrinsics.principal[0] += place.shift[0];
    camera.intrinsics.principal[1] += place.shift[1];
    camera.distortion = Distortion { k1: place.radial[0], k2: place.radial[1], ..Distortion::default() };
    camera
}
