//! Chessboards and their like: optics and poses of cameras from pictures of one rigid board.
//!
//! Source: Z. Zhang, "A flexible new technique for camera calibration", TPAMI 22(11), 2000, for the optics of one camera; the rest is
//! a bundle adjustment in which the board has one pose in each frame, and its marks none of their own.
//!
//! 1. Each camera alone ([`OpticsFit`]): homographies give a focal length, all its views together the optics that they can hold.
//! 2. Each picture: one or two poses of the board ([D. Oberkampf et al. 1996]: from afar a board looks like its mirror image).
//! 3. Pairs of cameras: the relative pose on which most common frames agree settles the mirror image and which way round a symmetric
//!    board lies; pairs are chained, the surest first.
//! 4. All together: cameras, optics and board poses under a robust loss, what contradicts is rejected, and again.
//!
//! The world is the board's own space in one frame: that in which it lay on the floor, if one is named, otherwise the one that most
//! cameras saw.

mod groups;
mod network;
mod optics;
mod pattern;
mod plane;
mod rigid;
mod types;
mod unsynchronised;
mod views;

use nalgebra::Vector3;

pub use network::calibrate;
pub use pattern::Board;
pub use types::{
    BoardError, BoardOptions, BoardPose, BoardSolution, HoldOut, OpticsFit, OpticsRefusal, Refused, Stretch,
};
pub use unsynchronised::{BoardClocksError, board_on_one_clock};

/// Boards whose directions differ by less are as good as parallel: focal length and distance are then distinguished by perspective alone [rad].
const ONE_ANGLE: f64 = 0.17;

/// The largest angle between board normals [rad], if it is so small that all boards are as good as one view; `None` otherwise. One angle does not
/// determine a focal length.
pub fn one_angle(normals: &[Vector3<f64>]) -> Option<f64> {
    let pairs = normals.iter().flat_map(|a| normals.iter().map(move |b| a.angle(b)));
    let most = pairs.fold(0.0, f64::max);
    (normals.len() > 1 && most < ONE_ANGLE).then_some(most)
}

#[cfg(test)]
mod tests;
