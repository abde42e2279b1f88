//! Faults of a set of pictures, and their messages.

mod words;

use std::fmt;

use super::code::{Axis, Shown, StripeCode};

/// With this many bits of an axis that fit no Gray code, the pictures are not in the stated order: a missing, wrong or misplaced picture spoils its own bit and one more, two swapped ones spoil up to four.
const OTHER_SET: usize = 5;

/// A fault of a set of pictures, as [`examine`](super::examine::examine) finds it. Pictures are numbered in their order, from 0; [`SetFault::describe`] says it to a person.
#[derive(Debug, Clone, PartialEq)]
pub enum SetFault {
    /// The set has more or fewer pictures than the code.
    Count {
        /// Pictures in the set.
        found: usize,
        /// Pictures of the code.
        expected: usize,
        /// The first picture that is not the inverse of its neighbour, where nothing else is known.
        unpaired: Option<usize>,
        /// Whether the missing or extra pictures are known: each is then a fault of its own.
        is_explained: bool,
    },
    /// A picture could not be read.
    Unreadable {
        /// Index of the picture.
        picture: usize,
        /// What it should show.
        shown: Shown,
    },
    /// A picture of the code is missing from the set.
    Missing {
        /// What it should show.
        shown: Shown,
        /// The picture after which it should come; `None` at the beginning.
        after: Option<usize>,
        /// Whether the inverse may be missing instead.
        or_inverse: bool,
    },
    /// Pictures of some of these bits or of their inverses are missing; which ones cannot be determined.
    MissingBits {
        /// Their axis.
        axis: Axis,
        /// The bits.
        planes: Vec<u32>,
        /// Number of missing pictures.
        pictures: usize,
    },
    /// The polarity of a bit with one missing picture was resolved from image orientation; wrong if the pictures are mirrored.
    ByWay {
        /// Its axis.
        axis: Axis,
        /// The bit.
        plane: u32,
    },
    /// Both pictures of the finest bit are missing, inferred from the width of the stripes in the picture.
    ByWidth {
        /// Its axis.
        axis: Axis,
        /// The bit.
        plane: u32,
    },
    /// Both pictures of a bit are missing and were reconstructed from the other bits and the other axis; wrong if the pictures are mirrored.
    Unfolded {
        /// Its axis.
        axis: Axis,
        /// The bit.
        plane: u32,
    },
    /// Phase steps of an axis are missing; which ones cannot be determined.
    MissingSteps {
        /// Their axis.
        axis: Axis,
        /// Number of missing pictures.
        pictures: usize,
    },
    /// No picture shows the stripes of an axis.
    NoAxis {
        /// The axis concerned.
        axis: Axis,
        /// How many pictures it has.
        pictures: usize,
    },
    /// A picture that does not belong to the set.
    Extra {
        /// The picture.
        picture: usize,
        /// What it shows, where that is known.
        shown: Option<Shown>,
    },
    /// A picture shows other stripes than it should.
    Shows {
        /// Index of the picture.
        picture: usize,
        /// What it shows.
        found: Found,
        /// What it should show.
        expected: Shown,
    },
    /// Two pictures are swapped.
    Exchanged {
        /// The pictures.
        pictures: [usize; 2],
        /// What they should show.
        expected: [Shown; 2],
        /// Whether the set is sound with both in their places, and is decoded that way.
        mended: bool,
    },
    /// The pictures are in another order than stated.
    OtherOrder {
        /// The code with the order that fits.
        code: Box<StripeCode>,
    },
    /// A picture is a negative: dark where it should be bright, by all gray levels.
    Negative {
        /// Index of the picture.
        picture: usize,
        /// What it should show.
        shown: Shown,
        /// Whether it is inverted before decoding.
        mended: bool,
    },
    /// The whole of a picture is brighter or darker than the others.
    Exposed {
        /// Index of the picture.
        picture: usize,
        /// What it should show.
        shown: Shown,
        /// Its brightness over that of the others [–].
        factor: f64,
    },
    /// Pictures are brighter or darker than most; brightness is equalised before decoding.
    Uneven {
        /// The pictures, each with its brightness over that of most [–].
        pictures: Vec<(usize, f64)>,
    },
    /// The light faded or grew evenly from picture to picture; brightness is equalised before decoding.
    Faded {
        /// The first and the last picture.
        ends: [usize; 2],
        /// Brightness of the last over that of the first [–].
        factor: f64,
    },
    /// Something moved between two pictures.
    Moved {
        /// The last picture before it.
        last: usize,
        /// The first one after it.
        first: usize,
        /// The first and the last of those that are used.
        used: [usize; 2],
        /// The first and the last of the unused pictures between these.
        but: Option<[usize; 2]>,
        /// Brightness added, negative if removed, where a switched light explains the change [gray levels].
        light: Option<f64>,
    },
    /// A light was switched between two pictures; the difference is subtracted before decoding.
    Relit {
        /// The last picture before it.
        last: usize,
        /// The first one after it.
        first: usize,
        /// Brightness added, negative if removed [gray levels].
        by: f64,
    },
    /// The ambient light differs from picture to picture; the difference is subtracted before decoding.
    Unsteady {
        /// Largest difference from the mean of all pictures, median over the pixels [gray levels].
        by: f64,
    },
    /// A picture shows its stripes on another scene than the other pictures.
    OtherScene {
        /// Index of the picture.
        picture: usize,
        /// What it should show.
        shown: Shown,
    },
    /// The pictures are a complete set for a projector of another size.
    OtherSize {
        /// Their bits for columns and rows.
        bits: [u32; 2],
        /// How many pictures there are.
        found: usize,
    },
    /// The pictures are a complete set with another number of phase steps or another period.
    OtherWaves {
        /// How many steps they have.
        steps: u32,
        /// Their period [px].
        period: u32,
        /// How many pictures there are.
        found: usize,
    },
    /// The projector's light is too weak in most of the area that it reaches.
    Dim {
        /// Part of the pixels with enough light [–].
        lit: f64,
        /// Part of the pixels that the projector reaches [–].
        reached: f64,
        /// Required white − black [gray levels].
        needed: u8,
    },
    /// A picture of another size than the first.
    Size {
        /// Index of the picture.
        picture: usize,
        /// Its columns and rows [px].
        found: (usize, usize),
        /// Those of the first [px].
        expected: (usize, usize),
    },
    /// Two pictures show the same stripes.
    Doubled {
        /// The later one.
        picture: usize,
        /// The earlier one.
        same_as: usize,
        /// What it should show.
        expected: Option<Shown>,
    },
    /// White is darker than black.
    WhiteIsBlack {
        /// The white picture.
        white: usize,
        /// The black one.
        black: usize,
    },
    /// White is not the brightest picture, or black not the darkest.
    NotWhite {
        /// Index of the picture.
        picture: usize,
        /// What it should show.
        shown: Shown,
        /// Part of the pixels in which another picture is clearly brighter (darker) [–].
        share: f64,
    },
    /// A picture and its inverse do not add up to white and black.
    NotInverse {
        /// The bit.
        shown: Shown,
        /// Its picture and the inverse.
        pictures: [usize; 2],
        /// Part of the pixels where they do not [–].
        share: f64,
    },
    /// Picture and inverse of some bits are swapped.
    Inverted {
        /// Their axis.
        axis: Axis,
        /// The bits.
        planes: Vec<u32>,
        /// Whether these are all bits whose polarity can be determined.
        all: bool,
        /// Whether the set is sound with these in their places, and is decoded that way.
        mended: bool,
    },
    /// Bits that do not fit the coarser ones.
    OutOfPlace {
        /// The axis concerned.
        axis: Axis,
        /// The bits concerned.
        planes: Vec<u32>,
    },
    /// Decoded columns (rows) outside the projector.
    OutOfRange {
        /// The axis concerned.
        axis: Axis,
        /// Part of the pixels that show one [–].
        share: f64,
        /// Columns (rows) of the projector [px].
        side: u32,
    },
    /// The projector lights hardly any pixel.
    TooDark {
        /// Part of the pixels that it lights [–].
        lit: f64,
        /// The 95th percentile of white − black [gray levels].
        contrast: u8,
        /// Required white − black [gray levels].
        needed: u8,
    },
    /// No picture shows stripes, although the pictures are not dark.
    Alike {
        /// The 95th percentile of the brightest level of a pixel [gray levels].
        level: u8,
        /// That of brightest − darkest [gray levels].
        contrast: u8,
        /// Noise of a pixel, standard deviation [gray levels].
        noise: f64,
        /// Part of the pixels that are saturated in all pictures [–].
        saturated: f64,
    },
    /// Most of the pixels that the projector lights are saturated.
    TooBright {
        /// Part of the lit pixels that are saturated [–].
        saturated: f64,
    },
}

/// What a picture was found to show.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Found {
    /// A bit or its inverse, white or black.
    Shown(Shown),
    /// A bit or its inverse.
    Bit(Axis, u32),
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Found::Shown(shown) => shown.fmt(f),
            Found::Bit(axis, plane) => write!(f, "bit {plane} of the {}", axis.in_words()),
        }
    }
}

impl SetFault {
    /// The axes of the pictures concerned; `None` for white, black or the whole set.
    pub(super) fn axes(&self) -> Option<Vec<Axis>> {
        let of =
            |shown: &[Shown]| Some(shown.iter().filter_map(Shown::axis).collect()).filter(|it: &Vec<_>| !it.is_empty());
        match self {
            SetFault::Missing { shown, .. }
            | SetFault::Shows { expected: shown, .. }
            | SetFault::NotInverse { shown, .. }
            | SetFault::OtherScene { shown, .. } => of(&[*shown]),
            SetFault::Doubled { expected: Some(shown), .. } | SetFault::Extra { shown: Some(shown), .. } => {
                of(&[*shown])
            }
            SetFault::Exchanged { expected, .. } => of(expected),
            SetFault::MissingBits { axis, .. }
            | SetFault::ByWay { axis, .. }
            | SetFault::ByWidth { axis, .. }
            | SetFault::Unfolded { axis, .. }
            | SetFault::MissingSteps { axis, .. }
            | SetFault::NoAxis { axis, .. }
            | SetFault::Inverted { axis, .. }
            | SetFault::OutOfPlace { axis, .. }
            | SetFault::OutOfRange { axis, .. } => Some(vec![*axis]),
            _ => None,
        }
    }

    /// Whether the fault makes this axis undecodable; `needs_white` where only white and black determine which pixels are lit.
    pub fn spoils(&self, axis: Axis, needs_white: bool) -> bool {
        let is_of = |shown: &Shown| shown.axis() == Some(axis);
        match self {
            SetFault::Count { is_explained, .. } => !is_explained,
            // Missing pictures may be reconstructed from the rest; which ones are missing is known.
            SetFault::Missing { .. }
            | SetFault::MissingBits { .. }
            | SetFault::MissingSteps { .. }
            | SetFault::ByWay { .. }
            | SetFault::ByWidth { .. }
            | SetFault::Unfolded { .. }
            | SetFault::NoAxis { .. }
            | SetFault::Unreadable { .. }
            | SetFault::Doubled { .. }
            | SetFault::OtherScene { .. }
            | SetFault::Moved { .. }
            | SetFault::Relit { .. }
            | SetFault::Unsteady { .. }
            | SetFault::Uneven { .. }
            | SetFault::Faded { .. }
            | SetFault::WhiteIsBlack { .. }
            | SetFault::Dim { .. } => false,
            SetFault::Shows { expected: shown, .. } | SetFault::Negative { shown, .. } => {
                needs_white && matches!(shown, Shown::White | Shown::Black)
            }
            SetFault::NotWhite { .. } => needs_white,
            SetFault::Exposed { shown, .. } => is_of(shown) || matches!(shown, Shown::White | Shown::Black),
            SetFault::Exchanged { mended: true, .. } | SetFault::Inverted { mended: true, .. } => false,
            SetFault::Exchanged { expected, .. } => {
                expected.iter().any(is_of) || !expected.iter().all(|it| matches!(it, Shown::Bit { .. }))
            }
            SetFault::Extra { .. } | SetFault::TooBright { .. } => false,
            SetFault::NotInverse { shown, .. } => is_of(shown),
            // So many bits are not one picture: what is stated of the set is wrong, of the other axis too.
            SetFault::OutOfPlace { axis: of, planes } => *of == axis || planes.len() >= OTHER_SET,
            SetFault::Inverted { axis: of, .. } | SetFault::OutOfRange { axis: of, .. } => *of == axis,
            SetFault::Size { .. }
            | SetFault::OtherOrder { .. }
            | SetFault::OtherSize { .. }
            | SetFault::OtherWaves { .. }
            | SetFault::TooDark { .. }
            | SetFault::Alike { .. } => true,
        }
    }
}
