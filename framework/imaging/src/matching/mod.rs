//! Least squares matching: the place and affine deformation of a patch of one picture in another, with covariance.
//!
//! A patch of the *template* is compared with the other picture under an affine map of its lattice (translation, scales, shears: six unknowns)
//! and a gain and an offset of its gray levels, so that the sum of squared differences is least: [D'Apuzzo 1999 §2.3]; A. Gruen, "Adaptive least
//! squares correlation", South African Journal of Photogrammetry 14(3), 1985. Steps are inverse compositional: S. Baker, I. Matthews,
//! "Lucas-Kanade 20 years on", IJCV 56(3), 2004: the normal equations are the template's own and solved once for it. Gain and offset
//! enter linearly and are eliminated beforehand, the derivatives made orthogonal to the template and to a constant.
//!
//! | here | there | meaning | unit |
//! |---|---|---|---|
//! | [`Warp`] | transformation parameters | search pixel = `at` + `matrix` · (template pixel − its centre) | px, – |
//! | `gain`, `offset` | r₁, r₀ | search gray level = gain · template's + offset | –, gray level |
//! | [`Match::covariance`] | σ₀² Qₓₓ | of `at` | px² |
//!
//! | file | what it gives |
//! |---|---|
//! | [`spline`] | a picture between its pixels |
//! | [`template`] | a patch prepared for matching |
//! | [`two`] | the match in one other picture |
//! | [`many`] | in several at once, with the depth of one point in space as an unknown |
//! | [`search`] | the best place in a box by cross-correlation: a start, on a pyramid where the box is large |
//! | [`growth`] | region growing from seeds, best first |

pub mod growth;
mod lanes;
pub mod many;
pub mod search;
pub mod spline;
pub mod template;
#[cfg(test)]
mod tests;
pub mod two;

use nalgebra::Matrix2;

pub use growth::{Grown, Growth, grow};
pub use many::{Place, SpaceMatch, match_in_space};
pub use search::{Correlated, SearchBuffers, SearchPyramid, repeats, search};
pub use spline::SplineImage;
pub use template::Template;
pub use two::{Match, MatchBuffers, match_template};

use crate::ImagingError;

/// A patch reaches at most this far from its centre [px].
pub const MAX_REACH: usize = 31;

/// Affine map of a patch into another picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Warp {
    /// Where the template's centre lies: column, row [px].
    pub at: [f64; 2],
    /// Rows of the matrix that takes what is right of and below the centre in the template to the picture [–].
    pub matrix: [[f64; 2]; 2],
}

impl Warp {
    /// Neither turned nor stretched.
    pub fn shift(at: [f64; 2]) -> Self {
        Self { at, matrix: [[1.0, 0.0], [0.0, 1.0]] }
    }

    /// The place in the picture of the point at `offset` from the template's centre [px].
    pub fn apply(&self, offset: [f64; 2]) -> [f64; 2] {
        let [[a, b], [c, d]] = self.matrix;
        [self.at[0] + a * offset[0] + b * offset[1], self.at[1] + c * offset[0] + d * offset[1]]
    }

    /// The same affine deformation for a patch whose centre lies at `offset` from this one's: the start for a neighbour.
    pub fn beside(&self, offset: [f64; 2]) -> Self {
        Self { at: self.apply(offset), ..*self }
    }

    /// From the picture back to the template, whose centre lies at `centre`; `None` for one that is flat.
    pub fn inverse(&self, centre: [f64; 2]) -> Option<Self> {
        let inverse = self.as_matrix().try_inverse()?;
        Some(Self { at: centre, matrix: rows_of(&inverse) })
    }

    /// Largest and smallest factor by which a length in the template is longer in the picture; the second is negative where it is mirrored [–].
    pub fn stretches(&self) -> [f64; 2] {
        let matrix = self.as_matrix();
        let [[a, b], [c, d]] = self.matrix;
        let largest = (((a + d).hypot(b - c)) + ((a - d).hypot(b + c))) / 2.0;
        [largest, matrix.determinant() / largest.max(f64::MIN_POSITIVE)]
    }

    pub(super) fn as_matrix(&self) -> Matrix2<f64> {
        let [[a, b], [c, d]] = self.matrix;
        Matrix2::new(a, b, c, d)
    }
}

pub(super) fn rows_of(matrix: &Matrix2<f64>) -> [[f64; 2]; 2] {
    [[matrix[(0, 0)], matrix[(0, 1)]], [matrix[(1, 0)], matrix[(1, 1)]]]
}

/// Which of the six geometric unknowns a match has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Freedom {
    /// All six.
    #[default]
    Affine,
    /// The translation; the deformation stays as it was at the start.
    Translation,
}

/// Unknowns of a match, and the limits within which it is accepted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchOptions {
    /// Which unknowns there are.
    pub freedom: Freedom,
    /// Steps at most [–].
    pub max_steps: u32,
    /// Done when steps still to come, as they have shrunk so far, move the centre by less [px].
    pub done_px: f64,
    /// The centre may move so far from its start at most [px].
    pub max_shift_px: f64,
    /// Correlation between the two patches once they are matched, at least [–].
    pub min_correlation: f64,
    /// Lengths in one picture over those in the other, at most, either way [–].
    pub max_stretch: f64,
    /// The larger of the two stretches over the smaller, at most [–].
    pub max_shear: f64,
    /// Standard deviation of the centre along its worst direction, at most [px].
    pub max_sigma_px: f64,
    /// Standard deviation of the gray levels in the template, at least [gray level].
    pub min_contrast: f64,
    /// Gain of the gray levels, at most, and one over it at least [–].
    pub max_gain: f64,
}

impl Default for MatchOptions {
    /// What holds for patches of 13 × 13 px in pictures of 8 bits; each gate is measured by `cargo bench -p foveate-imaging --bench matching`.
    fn default() -> Self {
        Self {
            freedom: Freedom::Affine,
            max_steps: 20,
            done_px: 0.002,
            max_shift_px: 3.0,
            min_correlation: 0.9,
            max_stretch: 2.0,
            max_shear: 2.0,
            max_sigma_px: 0.1,
            min_contrast: 3.0,
            max_gain: 4.0,
        }
    }
}

impl MatchOptions {
    /// # Errors
    /// The first option that is out of its range.
    pub fn check(&self) -> Result<(), ImagingError> {
        let more_than = |name, found: f64, least: f64, expected| {
            ImagingError::unless(found > least && found.is_finite(), name, expected, found)
        };
        ImagingError::unless(self.max_steps > 0, "max_steps", "at least 1", f64::from(self.max_steps))?;
        more_than("done_px", self.done_px, 0.0, "more than 0 px")?;
        more_than("max_shift_px", self.max_shift_px, 0.0, "more than 0 px")?;
        more_than("max_sigma_px", self.max_sigma_px, 0.0, "more than 0 px")?;
        more_than("max_stretch", self.max_stretch, 1.0, "more than 1")?;
        more_than("max_shear", self.max_shear, 1.0, "more than 1")?;
        more_than("max_gain", self.max_gain, 1.0, "more than 1")?;
        let correlates = (0.0..1.0).contains(&self.min_correlation);
        ImagingError::unless(correlates, "min_correlation", "0 to less than 1", self.min_correlation)?;
        ImagingError::unless(self.min_contrast >= 0.0, "min_contrast", "0 or more", self.min_contrast)
    }
}

/// Why there is no match.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Refused {
    /// The patch, or its place in the other picture, is not whole on the picture.
    Outside,
    /// The template has too little contrast, or none in some direction.
    NoTexture,
    /// No minimum within the steps allowed.
    NoConvergence,
    /// The centre moved too far from its start.
    Wandered,
    /// The patch is stretched, sheared or mirrored too much.
    Bent,
    /// Gray levels have nothing to do with those of the template, or are inverted.
    Radiometry,
    /// What is left differs too much.
    Dissimilar,
    /// The standard deviation of the place is too large.
    Vague,
}

impl Refused {
    /// All of them, in the order of the tests.
    pub const ALL: [Refused; 8] = [
        Refused::Outside,
        Refused::NoTexture,
        Refused::NoConvergence,
        Refused::Wandered,
        Refused::Bent,
        Refused::Radiometry,
        Refused::Dissimilar,
        Refused::Vague,
    ];

    /// A short name, for messages and names of figures.
    pub fn name(self) -> &'static str {
        match self {
            Refused::Outside => "outside",
            Refused::NoTexture => "no_texture",
            Refused::NoConvergence => "no_convergence",
            Refused::Wandered => "wandered",
            Refused::Bent => "bent",
            Refused::Radiometry => "radiometry",
            Refused::Dissimilar => "dissimilar",
            Refused::Vague => "vague",
        }
    }
}
