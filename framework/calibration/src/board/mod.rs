//! Chessboards and their like: optics and poses.
