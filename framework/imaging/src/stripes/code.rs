//! Which pictures make a code, and in which order a set of pictures holds them.

use super::boundary::FRAMES;
use crate::ImagingError;

/// Projectors are at most so large, each way [px]: stripes are numbered with 16 bits, and one number says that there is none.
pub const MAX_SIDE: u32 = 32_768;
/// Steps of a phase shift, at most [–].
pub const MAX_STEPS: u32 = 32;

/// A coordinate of the projector.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Axis {
    /// The column: stripes are vertical in the projector's picture.
    Columns,
    /// The row: stripes are horizontal.
    Rows,
}

impl Axis {
    /// Both.
    pub const BOTH: [Axis; 2] = [Axis::Columns, Axis::Rows];

    /// 0 for columns, 1 for rows.
    pub fn index(self) -> usize {
        match self {
            Axis::Columns => 0,
            Axis::Rows => 1,
        }
    }

    /// `columns` or `rows`, for messages.
    pub fn in_words(self) -> &'static str {
        match self {
            Axis::Columns => "columns",
            Axis::Rows => "rows",
        }
    }
}

/// What a picture shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Shown {
    /// All projector pixels lit.
    White,
    /// None lit.
    Black,
    /// One bit of the Gray code of each stripe.
    Bit {
        /// Of which coordinate.
        axis: Axis,
        /// Which bit: 0 is the coarsest, of which half the code's range is lit.
        plane: u32,
        /// Lit where the bit is 0.
        inverse: bool,
    },
    /// One step of a sine wave along an axis.
    Phase {
        /// Of which coordinate.
        axis: Axis,
        /// Step `k` of `n` is ahead by k/n of a period.
        step: u32,
    },
    /// One of the pictures of a stripe boundary code.
    Boundary {
        /// Of which coordinate.
        axis: Axis,
        /// Which: see [`super::boundary::BoundaryCode`].
        frame: u32,
    },
}

impl Shown {
    /// The axis whose stripes it shows.
    pub fn axis(&self) -> Option<Axis> {
        match self {
            Shown::Bit { axis, .. } | Shown::Phase { axis, .. } | Shown::Boundary { axis, .. } => Some(*axis),
            Shown::White | Shown::Black => None,
        }
    }
}

impl std::fmt::Display for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Shown::White => f.write_str("white"),
            Shown::Black => f.write_str("black"),
            Shown::Bit { axis, plane, inverse } => {
                let inverse = if *inverse { ", inverse" } else { "" };
                write!(f, "bit {plane} of the {}{inverse}", axis.in_words())
            }
            Shown::Phase { axis, step } => write!(f, "phase step {step} of the {}", axis.in_words()),
            Shown::Boundary { axis, frame } => write!(f, "boundary picture {frame} of the {}", axis.in_words()),
        }
    }
}

/// A group of pictures that follow one another in a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// The white picture.
    White,
    /// The black picture.
    Black,
    /// The bits of one axis, then its phase steps.
    Stripes(Axis),
}

impl Group {
    /// The order of a set in words: `columns`, `rows`, `white`, `black`.
    ///
    /// # Errors
    ///
    /// A sentence about a word that is none of these.
    pub fn order(words: &str) -> Result<Vec<Group>, String> {
        let named = |word: &str| match word {
            "columns" => Ok(Group::Stripes(Axis::Columns)),
            "rows" => Ok(Group::Stripes(Axis::Rows)),
            "white" => Ok(Group::White),
            "black" => Ok(Group::Black),
            other => Err(format!("found `{other}`, expected words out of columns, rows, white, black")),
        };
        words.split_whitespace().map(named).collect()
    }
}

/// Where the inverse pictures are in a set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Inverse {
    /// Each right after its bit.
    #[default]
    After,
    /// Each right before its bit.
    Before,
    /// All bits of an axis, then all their inverses.
    Apart,
    /// All bits of both axes, then all their inverses in the same order.
    Last,
    /// Without inverse pictures: a pixel is lit where it is brighter than the mean of white and black.
    None,
}

/// A code of stripes and the order of its pictures in a set: what a projector shows, and what a camera's set is decoded with.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct StripeCode {
    /// Columns and rows of the projector [px].
    pub projector: [u32; 2],
    /// Bits by axis; 0 where an axis has no Gray code.
    pub bits: [u32; 2],
    /// Added to the projector's column and row before they are coded [px].
    pub offset: [u32; 2],
    /// Projector pixels to a stripe of the finest bit's code: 1, 2, 4, … [px].
    pub stripe: [u32; 2],
    /// Order of the groups of pictures.
    pub order: Vec<Group>,
    /// Where inverse pictures are.
    pub inverse: Inverse,
    /// Whether the finest bit of an axis comes first.
    pub fine_first: bool,
    /// Steps of the phase shift; 0: none.
    pub steps: u32,
    /// Its period [px].
    pub period: u32,
    /// Pictures of a stripe boundary code, which takes the place of bits and phase and is shown again and again; 0: the code is static.
    pub frames: u32,
}

/// Bits that `n` numbers need.
fn bits_for(n: u32) -> u32 {
    n.saturating_sub(1).checked_ilog2().map_or(0, |it| it + 1).max(1)
}

impl StripeCode {
    /// Gray code of columns, then rows, each bit followed by its inverse, then white and black: OpenCV's order.
    pub fn gray(projector: [u32; 2]) -> StripeCode {
        StripeCode {
            projector,
            bits: projector.map(bits_for),
            offset: [0, 0],
            stripe: [1, 1],
            order: vec![Group::Stripes(Axis::Columns), Group::Stripes(Axis::Rows), Group::White, Group::Black],
            inverse: Inverse::After,
            fine_first: false,
            steps: 0,
            period: 0,
            frames: 0,
        }
    }

    /// Stripe boundary code of stripes `stripe` px wide, along the axis that `order` names first; columns where it names none.
    pub fn boundary(projector: [u32; 2], stripe: u32, order: &[Group]) -> StripeCode {
        let first = order.iter().find(|it| matches!(it, Group::Stripes(_)));
        StripeCode {
            bits: [0, 0],
            stripe: [stripe, stripe],
            order: vec![first.copied().unwrap_or(Group::Stripes(Axis::Columns))],
            inverse: Inverse::None,
            frames: FRAMES as u32,
            ..StripeCode::gray(projector)
        }
    }

    /// Phase shift of `steps` steps and a period of `period` px, on a Gray code whose stripes are half a period wide.
    pub fn phase(projector: [u32; 2], steps: u32, period: u32) -> StripeCode {
        let stripe = (period / 2).max(1).next_power_of_two();
        let bits = projector.map(|it| bits_for(it.div_ceil(stripe)));
        StripeCode { bits, stripe: [stripe, stripe], steps, period: 2 * stripe, ..StripeCode::gray(projector) }
    }

    /// The same with `bits` pictures for each axis rather than as many as its columns and rows need: fewer leave the finest out.
    ///
    /// With `centred`, the code's middle is the projector's rather than its beginning.
    pub fn with_bits(mut self, bits: [Option<u32>; 2], centred: bool) -> StripeCode {
        for (axis, bits) in bits.into_iter().enumerate() {
            let needed = bits_for(self.projector[axis]);
            let range = bits.unwrap_or(needed).max(needed).min(16);
            if let Some(it) = bits {
                self.bits[axis] = it;
                self.stripe[axis] = 1 << (range - it.min(range));
            }
            if centred {
                self.offset[axis] = ((1 << range) - self.projector[axis]) / 2;
            }
        }
        self
    }

    /// The same with its middle in the projector's middle where its beginning is the first column (row), and the other way round; `None` where that is the same.
    pub fn with_other_centre(&self) -> Option<StripeCode> {
        let other = |axis: usize| match self.offset[axis] {
            0 => ((self.stripe[axis] << self.bits[axis]).saturating_sub(self.projector[axis])) / 2,
            _ => 0,
        };
        let offset = [other(0), other(1)];
        (offset != self.offset && self.steps == 0).then(|| StripeCode { offset, ..self.clone() })
    }

    /// The same without so many of the finest bits of columns and rows: stripes are twice as wide for each.
    pub fn without_finest(&self, dropped: [u32; 2]) -> StripeCode {
        let mut code = self.clone();
        for (axis, dropped) in dropped.into_iter().enumerate() {
            code.bits[axis] = code.bits[axis].saturating_sub(dropped);
            code.stripe[axis] <<= dropped;
        }
        code
    }

    /// Checks that the code is possible: sides, bits, order, phase steps.
    ///
    /// # Errors
    /// The first value out of its range, with what was expected.
    pub fn check(&self) -> Result<(), ImagingError> {
        let sides = "1 to 32768 columns and rows";
        for side in self.projector {
            ImagingError::unless((1..=MAX_SIDE).contains(&side), "projector", sides, f64::from(side))?;
        }
        if self.frames > 0 {
            let alone = matches!(self.order[..], [Group::Stripes(_)]);
            let found = self.order.len() as f64;
            ImagingError::unless(alone, "order", "columns or rows alone for a boundary code", found)?;
            let fits = self.stripe.iter().all(|it| (2..=1024).contains(it));
            return ImagingError::unless(fits, "stripe", "2 to 1024", f64::from(self.stripe[0]));
        }
        for axis in Axis::BOTH {
            let at = axis.index();
            if !self.order.contains(&Group::Stripes(axis)) {
                continue;
            }
            let bits = f64::from(self.bits[at]);
            ImagingError::unless((1..=16).contains(&self.bits[at]), "bits", "1 to 16 for each axis", bits)?;
            let reach = (1_u64 << self.bits[at]) * u64::from(self.stripe[at]);
            let needed = u64::from(self.projector[at]) + u64::from(self.offset[at]);
            let expected = "enough bits to number all columns (rows) of the projector";
            ImagingError::unless(reach >= needed, "bits", expected, bits)?;
        }
        let any = self.order.iter().any(|it| matches!(it, Group::Stripes(_)));
        ImagingError::unless(any, "order", "columns, rows or both", 0.0)?;
        for (at, group) in self.order.iter().enumerate() {
            let again = self.order[..at].contains(group);
            ImagingError::unless(!again, "order", "each group of pictures once", at as f64)?;
        }
        if self.inverse == Inverse::None {
            let both = [Group::White, Group::Black].iter().all(|it| self.order.contains(it));
            ImagingError::unless(both, "order", "white and black where there are no inverse pictures", 0.0)?;
        }
        if self.steps > 0 {
            let steps = f64::from(self.steps);
            ImagingError::unless((3..=MAX_STEPS).contains(&self.steps), "steps", "3 to 32", steps)?;
            let fits = self.period == 2 * self.stripe[0] && self.period == 2 * self.stripe[1];
            let expected = "twice the width of the stripes of the Gray code below it";
            ImagingError::unless(fits && self.period >= 4, "period", expected, f64::from(self.period))?;
        }
        Ok(())
    }

    /// Whether the set encodes this coordinate.
    pub fn has(&self, axis: Axis) -> bool {
        self.order.contains(&Group::Stripes(axis))
    }

    /// What each picture of a set shows, in order.
    pub fn pictures(&self) -> Vec<Shown> {
        let is_stripes = |it: &Group| matches!(it, Group::Stripes(_));
        let last = self.order.iter().rposition(is_stripes).filter(|_| self.inverse == Inverse::Last);
        let group = |(at, group): (usize, &Group)| {
            let inverses = self.order.iter().filter(|it| last == Some(at) && is_stripes(it)).flat_map(|it| {
                let inverse = |it: Shown| match it {
                    Shown::Bit { axis, plane, .. } => Some(Shown::Bit { axis, plane, inverse: true }),
                    _ => None,
                };
                self.group(*it).into_iter().filter_map(inverse)
            });
            self.group(*group).into_iter().chain(inverses.collect::<Vec<Shown>>())
        };
        self.order.iter().enumerate().flat_map(group).collect()
    }

    fn group(&self, group: Group) -> Vec<Shown> {
        let axis = match group {
            Group::White => return vec![Shown::White],
            Group::Black => return vec![Shown::Black],
            Group::Stripes(axis) => axis,
        };
        if self.frames > 0 {
            return (0..self.frames).map(|frame| Shown::Boundary { axis, frame }).collect();
        }
        let mut planes: Vec<u32> = (0..self.bits[axis.index()]).collect();
        if self.fine_first {
            planes.reverse();
        }
        let bit = |inverse: bool| move |plane: &u32| Shown::Bit { axis, plane: *plane, inverse };
        let pair = |first: bool| planes.iter().flat_map(move |it| [bit(first)(it), bit(!first)(it)]);
        let mut list: Vec<Shown> = match self.inverse {
            Inverse::After => pair(false).collect(),
            Inverse::Before => pair(true).collect(),
            Inverse::Apart => planes.iter().map(bit(false)).chain(planes.iter().map(bit(true))).collect(),
            Inverse::Last | Inverse::None => planes.iter().map(bit(false)).collect(),
        };
        list.extend((0..self.steps).map(|step| Shown::Phase { axis, step }));
        list
    }

    /// Its order in the words of the nodes' settings.
    pub fn order_in_words(&self) -> String {
        let group = |it: &Group| match it {
            Group::White => "white",
            Group::Black => "black",
            Group::Stripes(axis) => axis.in_words(),
        };
        let order: Vec<&str> = self.order.iter().map(group).collect();
        let inverse = match self.inverse {
            Inverse::After => "after",
            Inverse::Before => "before",
            Inverse::Apart => "apart",
            Inverse::Last => "last",
            Inverse::None => "none",
        };
        format!("order = \"{}\", inverse = \"{inverse}\", fine_first = {}", order.join(" "), self.fine_first)
    }

    /// The place of a picture in a set.
    pub fn place(&self, shown: Shown) -> Option<usize> {
        self.pictures().iter().position(|it| *it == shown)
    }
}

/// The Gray code of a number.
pub fn gray_of(number: u32) -> u32 {
    number ^ (number >> 1)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opencv_order_has_42_pictures_for_1024_by_768() {
        let pictures = StripeCode::gray([1024, 768]).pictures();
        assert_eq!(pictures.len(), 42);
        assert_eq!(pictures[0], Shown::Bit { axis: Axis::Columns, plane: 0, inverse: false });
        assert_eq!(pictures[21], Shown::Bit { axis: Axis::Rows, plane: 0, inverse: true });
        assert_eq!(pictures[40..], [Shown::White, Shown::Black]);
    }

    #[test]
    fn bits_and_offsets_of_projectors_that_are_no_power_of_two() {
        assert_eq!(StripeCode::gray([1280, 800]).bits, [11, 10]);
        assert_eq!([1, 2, 3, 4, 5, 1024, 1025].map(bits_for), [1, 1, 2, 2, 3, 10, 11]);
        let centred = StripeCode::gray([1280, 800]).with_bits([None, None], true);
        assert_eq!(centred.offset, [384, 112]);
        let coarse = StripeCode::gray([1024, 768]).with_bits([Some(8), None], false);
        assert_eq!((coarse.bits, coarse.stripe), ([8, 10], [4, 1]));
        assert!(coarse.check().is_ok());
    }

    #[test]
    fn codes_that_cannot_be_are_refused() {
        let good = StripeCode::gray([1024, 768]);
        let fault = |code: StripeCode| code.check().unwrap_err().to_string();
        assert!(fault(StripeCode { bits: [9, 10], ..good.clone() }).contains("number all columns"));
        assert!(fault(StripeCode { projector: [0, 768], ..good.clone() }).contains("projector is 0"));
        let order = vec![Group::Stripes(Axis::Columns)];
        assert!(fault(StripeCode { order, inverse: Inverse::None, ..good.clone() }).contains("white and black"));
        assert!(fault(StripeCode { order: vec![Group::White], ..good.clone() }).contains("columns, rows"));
        assert!(fault(StripeCode { steps: 2, period: 2, ..good }).contains("steps is 2"));
        assert!(StripeCode::phase([1024, 768], 4, 16).check().is_ok());
    }
}
