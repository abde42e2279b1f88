//! Pictures and what can be found in them: views, colour planes, masks, learned thresholds, bright spots, patches that move.
//!
//! One frame of one camera, as the detector of [Davis 2002 §3.3] treats it:
//!
//! 1. [`plane::extract`] turns RGB into one byte a pixel (a gray picture is taken as it is);
//! 2. [`SpotFinder`] searches it whole, or sampled rows and windows of it, against a [`ThresholdMap`];
//! 3. [`Background::update`] is told how much was lit, learns, and says whether the spots are to be trusted.
//!
//! A natural scene has no bright spots: [`Foreground`] splits a picture by the statistics of its background, and [`BlobFinder`]
//! joins the foreground to blobs. In colour, [`Segmenter`] tells bodies from their shadows. [`find_chessboard`] finds the corners of a calibration board.
//!
//! A surface with painted marks [Davis 2002 §5.1]: [`DotFinder`] finds them, [`Stabiliser`] the motion of the whole between two pictures,
//! and [`LucasKanade`] follows any small patch, from coarse to fine on a [`Pyramid`].
//!
//! A surface that is to be measured: [`matching`] finds patches of one picture in others by least squares, to hundredths of a pixel
//! [D'Apuzzo 1999 §2.3].
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
