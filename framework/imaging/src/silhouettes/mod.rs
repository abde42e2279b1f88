//! Background subtraction in colour with shadow removal: which pixels show a body, and with which confidence, by chromaticity and brightness.
//!
//! Source: T. Horprasert, D. Harwood, L. S. Davis, "A statistical approach for real-time robust background subtraction and shadow detection", ICCV
//! FRAME-RATE workshop 1999, as [Mikić 2001 §2] uses it. Of a pixel with mean E, standard deviations σ (both by channel) and value I:
//!
//! | here | paper | meaning | unit |
//! |---|---|---|---|
//! | `alpha` | α | Σ I E/σ² / Σ E²/σ²: the part of its light that it has kept | – |
//! | `chroma` | CD | √Σ ((I − α E)/σ)²: how far its colour is from that of its background in any light | σ |
//! | `bright` | (α − 1)/a | with a = 1/√Σ E²/σ², the standard deviation of α that σ implies | σ |
//!
//! A pixel is **shadow** or **highlight**, and no body, as long as `chroma` stays below its limit and α between `shadow_ratio` and `highlight_ratio`, which widen by the
//! limit of `bright` where a pixel is dark. How far it is from these limits, in limits, is f; its confidence is 255 f²/(1 + f²), one half on the limit.
//!
//! What is added to the paper:
//!
//! - *Limits* are those below which `detection_rate` of the background lies, by the histograms of the pictures that it was learnt from. They are held within
//!   one and two times what the median of the same histogram implies for Gaussian noise, so that a person who passes while learning raises them to twice at most.
//! - *Flicker.* The pictures that are learnt from are brought to the light of their median first: a lamp that flickers is no noise of single pixels.
//! - *Texture*, on demand (`by_texture`): what pixels take for shadow or highlight must fit the background in some light over windows (see `texture.rs`).
//! - *Edges.* A camera that trembles, or a coder, moves edges by a part of a pixel: σ² has (`jitter_px` times the slope of the background)² in it.
//! - *Light.* Each channel has a gain over the learnt light, that on which the picture agrees. Where many pixels differ all the same, tiles of 64 px whose
//!   texture is that of the background (correlation above 0.9) get a gain of their own: a lamp that lights one wall. A pixel is background
//!   there when either light explains it.
//! - *Saturation.* A channel at 255 says only that it is no darker: α is that of the others, where in that light it would be saturated.
//! - *Stationary bodies* are not learnt. With `absorb_frames`, what has kept the same colour for so long is, but not where a target is held.
//! - *Speed.* Where (value − mean)/σ, over all channels, is shorter than both limits, a pixel lies within them: all but one in some hundred pixels of the background end with that test, in whole numbers, eight at a time.
//!
//! A gray picture has no chromaticity; [`Foreground`](crate::Foreground) is for these.

mod closing;
mod holes;
mod light;
mod model;
mod segmenter;
#[cfg(test)]
mod tests;
mod texture;

pub use closing::Closing;
pub use holes::HoleFiller;
pub use segmenter::{Segmenter, SegmenterConfig};

/// Confidence from which on a pixel counts as body [0..=255].
pub const BODY: u8 = 128;
/// And surely so: f = 2.
pub const SURE: u8 = 204;
