//! What can be wrong with a set of pictures, and how it is said.

mod words;

use std::fmt;

use super::code::{Axis, Shown, StripeCode};

/// So many bits of an axis that fit no Gray code say that the pictures are not those of the stated order: a picture that is missing, wrong or in another's place spoils its own bit and one more, two that are exchanged up to four.
const OTHER_SET: usize = 5;

/// Something that is wrong with a set of pictures. Pictures are numbered in their order, from 0.
#[derive(Debug, Clone, PartialEq)]
pub enum SetFault {
    /// Another number of pictures than the code has.
    Count {
        /// How many there are.
        found: usize,
        /// How many the code has.
        expected: usize,
        /// The first one that is not the inverse that stands before or after it, where nothing else is known.
        unpaired: Option<usize>,
        /// Whether it is known which are missing or too many: each is a fault of its own.
        is_explained: bool,
    },
    /// A picture could not be read.
    Unreadable {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
    },
    /// No picture shows this.
    Missing {
        /// What.
        shown: Shown,
        /// The picture after which it should stand; `None` at the beginning.
        after: Option<usize>,
        /// Whether it may be its inverse instead.
        or_inverse: bool,
    },
    /// Pictures of some of these bits or their inverses lack: nothing tells which.
    MissingBits {
        /// Of which axis.
        axis: Axis,
        /// The bits.
        planes: Vec<u32>,
        /// How many pictures lack.
        pictures: usize,
    },
    /// Which of the two pictures of a bit lacks is told by the way in which columns and rows run in the picture.
    ByWay {
        /// Of which axis.
        axis: Axis,
        /// The bit.
        plane: u32,
    },
    /// That both pictures of the finest bit lack, and not those of another one, is told by how wide stripes of columns and rows are in the picture.
    ByWidth {
        /// Of which axis.
        axis: Axis,
        /// The bit.
        plane: u32,
    },
    /// Both pictures of a bit lack, and the other bits and the other axis tell what they would show.
    Unfolded {
        /// Of which axis.
        axis: Axis,
        /// The bit.
        plane: u32,
    },
    /// Phase steps of an axis lack: nothing tells which.
    MissingSteps {
        /// Of which axis.
        axis: Axis,
        /// How many pictures lack.
        pictures: usize,
    },
    /// No picture shows the stripes of an axis.
    NoAxis {
        /// Which axis.
        axis: Axis,
        /// How many pictures it has.
        pictures: usize,
    },
    /// A picture for which there is no place.
    Extra {
        /// Which.
        picture: usize,
        /// What it shows, where that is known.
        shown: Option<Shown>,
    },
    /// A picture shows something else than it should.
    Shows {
        /// Which.
        picture: usize,
        /// What it shows.
        found: Found,
        /// What it should show.
        expected: Shown,
    },
    /// Two pictures stand in each other's places.
    Exchanged {
        /// Which.
        pictures: [usize; 2],
        /// What they should show.
        expected: [Shown; 2],
        /// Whether the set is sound with both in their places, and is decoded so.
        mended: bool,
    },
    /// The set has another order.
    OtherOrder {
        /// A code of that order.
        code: Box<StripeCode>,
    },
    /// A picture is a negative: dark where it should be bright, by all gray levels.
    Negative {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
        /// Whether it is turned back by calculation.
        mended: bool,
    },
    /// A picture is brighter or darker than the others all over.
    Exposed {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
        /// How many times as bright [–].
        factor: f64,
    },
    /// Pictures are brighter or darker than most, and are evened out.
    Uneven {
        /// Which, each with how many times as bright [–].
        pictures: Vec<(usize, f64)>,
    },
    /// The light faded, or grew, evenly from picture to picture, and pictures are evened out.
    Faded {
        /// The first and the last picture.
        ends: [usize; 2],
        /// How many times as bright as the first the last one is [–].
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
        /// The first and the last of those between these that are not used either.
        but: Option<[usize; 2]>,
        /// By how much all grew brighter, or darker where negative, where a light that was switched explains it [gray levels].
        light: Option<f64>,
    },
    /// A light was switched between two pictures, and is taken off by calculation.
    Relit {
        /// The last picture before it.
        last: usize,
        /// The first one after it.
        first: usize,
        /// By how much all grew brighter, or darker where negative [gray levels].
        by: f64,
    },
    /// The light of the room differs from picture to picture, which is taken off by calculation.
    Unsteady {
        /// From the mean of all pictures, at most, in the middle one of the pixels [gray levels].
        by: f64,
    },
    /// A picture shows its stripes on another scene than the others.
    OtherScene {
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
    },
    /// The pictures are a whole set for a projector of another size.
    OtherSize {
        /// Bits of columns and rows that they have.
        bits: [u32; 2],
        /// How many pictures there are.
        found: usize,
    },
    /// The pictures are a whole set of other phase steps, or of another period.
    OtherWaves {
        /// How many steps they have.
        steps: u32,
        /// Their period [px].
        period: u32,
        /// How many pictures there are.
        found: usize,
    },
    /// The projector lights most of what it reaches too weakly.
    Dim {
        /// Part of the pixels that it lights well enough [–].
        lit: f64,
        /// Part of the pixels that it lights at all [–].
        reached: f64,
        /// What is needed [gray levels].
        needed: u8,
    },
    /// A picture of another size than the first.
    Size {
        /// Which.
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
        /// Which.
        picture: usize,
        /// What it should show.
        shown: Shown,
        /// Part of the pixels in which another picture is clearly brighter (darker) [–].
        share: f64,
    },
    /// A picture and its inverse do not make white and black together.
    NotInverse {
        /// The bit.
        shown: Shown,
        /// Its picture and the inverse.
        pictures: [usize; 2],
        /// Part of the pixels in which they do not [–].
        share: f64,
    },
    /// Bits whose picture and inverse are exchanged.
    Inverted {
        /// Which axis.
        axis: Axis,
        /// Which bits.
        planes: Vec<u32>,
        /// Whether that is all that can be told.
        all: bool,
        /// Whether the set is sound with these in their places, and is decoded so.
        mended: bool,
    },
    /// Bits that do not fit those before them.
    OutOfPlace {
        /// Which axis.
        axis: Axis,
        /// Which bits.
        planes: Vec<u32>,
    },
    /// Columns (rows) that the projector does not have.
    OutOfRange {
        /// Which axis.
        axis: Axis,
        /// Part of the pixels that show one [–].
        share: f64,
        /// How many the projector has [px].
        side: u32,
    },
    /// The projector hardly lights anything.
    TooDark {
        /// Part of the pixels that it lights [–].
        lit: f64,
        /// The 95th percentile of white − black [gray levels].
        contrast: u8,
        /// What is needed [gray levels].
        needed: u8,
    },
    /// No picture shows more light anywhere than the others, although they are not dark.
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
    /// Most of what the projector lights is saturated.
    TooBright {
        /// Part of the lit pixels that are [–].
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
    /// The axes whose pictures it is about; `None` of what concerns white, black or the whole set.
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

    /// Whether this axis cannot be decoded because of it; `needs_white` where nothing but white and black says what is lit.
    pub fn spoils(&self, axis: Axis, needs_white: bool) -> bool {
        let is_of = |shown: &Shown| shown.axis() == Some(axis);
        match self {
            SetFault::Count { is_explained, .. } => !is_explained,
            // What is not there may be worked out from the rest, and what lacks is known.
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
