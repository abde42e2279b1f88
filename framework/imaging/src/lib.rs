//! Feature detection and tracking in camera pictures: LED detection, background subtraction, blobs, chessboard corners, dots, Lucas-Kanade,
//! least squares matching, structured light.
//!
//! LEDs and other bright spots in one frame of one camera, as the detector of [Davis 2002 §3.3] does it:
//!
//! 1. [`plane::extract`] turns RGB into one byte a pixel (a gray picture is used as it is);
//! 2. [`SpotFinder`] searches it whole, or sampled rows and windows of it, against a [`ThresholdMap`];
//! 3. [`Background::update`] learns from the frame and from how much of it was lit, and judges whether the spots can be trusted.
//!
//! Natural scenes without lights: [`Foreground`] segments a picture by the statistics of its background, and [`BlobFinder`]
//! joins the foreground to blobs. In colour, [`Segmenter`] separates bodies from their shadows. [`find_chessboard`] finds the corners of a calibration board.
//!
//! Surfaces with painted marks [Davis 2002 §5.1]: [`DotFinder`] finds them, [`Stabiliser`] estimates the dominant translation between two pictures,
//! and [`LucasKanade`] tracks any small patch, from coarse to fine on a [`Pyramid`].
//!
//! Surfaces without markers: [`matching`] finds patches of one picture in others by least squares, to hundredths of a pixel
//! [D'Apuzzo 1999 §2.3]. Surfaces under a projector: [`stripes`] decodes Gray code, phase shift and stripe boundary codes.
//!
//! Pixel (0, 0) is the centre of the top-left pixel. Nothing here reads a clock, a file or a random number.
//!
//! Source: J. E. Davis, *Mixed Scale Motion Recovery*, PhD thesis, Stanford, 2002.

pub mod background;
pub mod blobs;
pub mod chessboard;
pub mod column_target;
pub mod dots;
mod error;
pub mod foreground;
pub mod hue;
pub mod jpeg;
pub mod lucas_kanade;
pub mod mask;
pub mod matching;
pub mod plane;
pub mod pyramid;
pub mod shrink;
pub mod silhouettes;
pub mod spots;
pub mod stabilise;
pub mod stripes;
mod thresholds;
pub mod view;

pub use background::{Background, BackgroundConfig, Statistic, Verdict};
pub use blobs::{Blob, BlobFinder, BlobLimits};
pub use chessboard::{Corner, find_chessboard, largest_grid};
pub use dots::{Dot, DotFinder, DotLimits};
pub use error::ImagingError;
pub use foreground::{Foreground, ForegroundConfig};
pub use hue::{Hue, RgbView, hue_between};
pub use lucas_kanade::{Flow, FlowSettings, Lost, LucasKanade, Template};
pub use mask::fill_polygon;
pub use plane::Channel;
pub use pyramid::Pyramid;
pub use shrink::shrink;
pub use silhouettes::{Closing, HoleFiller, Segmenter, SegmenterConfig};
pub use spots::{Centroid, Found, Measure, Sampling, Spot, SpotFinder, SpotLimits, Window};
pub use stabilise::{Shift, Stabiliser, StabiliserSettings};
pub use thresholds::ThresholdMap;
pub use view::ImageView;
