//! A set as it is to be decoded: missing pictures are reconstructed where the rest determines them.

use std::borrow::Cow;

use super::super::code::{Axis, Group, Inverse, Shown, StripeCode};
use super::super::exposure;
use super::super::wave_steps::{self, LEAST_STEPS};
use super::Examination;
use crate::ImageView;

/// Bits of an axis that have to be there, and finest ones that may lack altogether.
const MIN_BITS: u32 = 3;
const MOST_LEFT_OUT: u32 = 2;
/// Where so many bits and more of an axis are dark, that says something.
const LEAST_DARK_BITS: usize = 4;

/// A set of pictures ready to be decoded.
#[derive(Debug, Clone, PartialEq)]
pub struct Prepared<'a> {
    /// The code without the axes that are left out, and without missing white or black pictures.
    pub code: StripeCode,
    /// By place in `code`.
    pub pictures: Vec<Cow<'a, [u8]>>,
    /// Which of them were reconstructed, such as from white + black less the other picture of the bit.
    pub worked_out: Vec<Shown>,
}

impl Examination {
    /// The picture that shows something.
    pub(super) fn picture(&self, code: &StripeCode, what: Shown) -> Option<usize> {
        code.pictures().iter().position(|it| *it == what).and_then(|it| self.places.get(it).copied().flatten())
    }

    /// The picture that shows what belongs at a place of the set.
    pub fn picture_at(&self, place: usize) -> Option<usize> {
        self.places.get(place).copied().flatten()
    }

    fn has_white_and_black(&self, code: &StripeCode) -> bool {
        [Shown::White, Shown::Black].iter().all(|it| self.picture(code, *it).is_some())
    }

    /// Pictures that an axis needs to be decoded, and that are missing and cannot be reconstructed.
    pub fn lacking(&self, code: &StripeCode, axis: Axis) -> Vec<Shown> {
        let has_both = self.has_white_and_black(code);
        let is_there = |what: Shown| self.picture(code, what).is_some() || self.unfolded.iter().any(|it| it.0 == what);
        let mut list: Vec<Shown> = (0..code.steps)
            .map(|step| Shown::Phase { axis, step })
            .filter(|it| code.place(*it).is_some() && !is_there(*it))
            .collect();
        if list.len() + LEAST_STEPS <= code.steps as usize {
            list.clear();
        }
        let left_out = self.finest_left_out(code)[axis.index()];
        for plane in 0..code.bits[axis.index()] - left_out {
            let [bit, inverse] = [false, true].map(|inverse| Shown::Bit { axis, plane, inverse });
            let there = [bit, inverse].map(is_there);
            let is_known = has_both && !self.unsure.contains(&(axis, plane));
            match (code.inverse, there) {
                (Inverse::None, [true, _]) | (_, [true, true]) => {}
                (Inverse::None, [false, _]) => list.push(bit),
                (_, [true, false] | [false, true]) if is_known => {}
                (_, [is_bit, is_inverse]) => {
                    list.extend((!is_bit).then_some(bit).into_iter().chain((!is_inverse).then_some(inverse)));
                }
            }
        }
        list
    }

    /// By axis how many of the finest bits are not there at all, and are done without: stripes are twice as wide for each.
    pub fn finest_left_out(&self, code: &StripeCode) -> [u32; 2] {
        Axis::BOTH.map(|axis| {
            let is_there = |plane: u32| {
                [false, true].iter().any(|it| self.picture(code, Shown::Bit { axis, plane, inverse: *it }).is_some())
            };
            let bits = code.bits[axis.index()];
            // Below phase steps all are needed; and of a code of which hardly any is left nothing is made.
            let can_be = if code.has(axis) && code.steps == 0 { bits.saturating_sub(MIN_BITS) } else { 0 };
            let lacking = (0..bits).rev().take_while(|it| !is_there(*it)).count() as u32;
            if lacking <= can_be.min(MOST_LEFT_OUT) { lacking } else { 0 }
        })
    }

    /// The axes that can be decoded.
    pub fn usable(&self, code: &StripeCode) -> Vec<Axis> {
        // Without inverse pictures, white and black are the threshold.
        let needs_both = code.inverse == Inverse::None && !self.has_white_and_black(code);
        let is_spoilt = |axis: Axis| {
            needs_both
                || self.faults.iter().any(|it| it.spoils(axis, code.inverse == Inverse::None))
                || !self.lacking(code, axis).is_empty()
        };
        Axis::BOTH.into_iter().filter(|it| code.has(*it) && !is_spoilt(*it)).collect()
    }

    /// Pixels that all bits of an axis which cannot be decoded leave dark, row by row; nothing where inverse pictures or phase steps tell shadows, or few bits are there. White lights them, but a shadow that
    /// moved off before it was taken looks the same, and so does the axis's first stripe, which goes with it.
    pub fn dark_in(&self, code: &StripeCode, pictures: &[ImageView<'_>], axis: Axis) -> Vec<bool> {
        let of = |what: Shown| Some(pictures.get(self.picture(code, what)?)?.pixels());
        let bits: Vec<&[u8]> =
            (0..code.bits[axis.index()]).filter_map(|plane| of(Shown::Bit { axis, plane, inverse: false })).collect();
        match (of(Shown::White), of(Shown::Black)) {
            (Some(white), Some(black))
                if code.inverse == Inverse::None && code.steps == 0 && bits.len() >= LEAST_DARK_BITS =>
            {
                let is_dark = |at: usize| {
                    let both = u16::from(white[at]) + u16::from(black[at]);
                    bits.iter().all(|it| 2 * u16::from(it[at]) <= both)
                };
                (0..white.len()).map(is_dark).collect()
            }
            _ => Vec::new(),
        }
    }

    /// What [`super::decode()`] takes, of the axes that can be decoded; `pictures` are those that were examined.
    pub fn prepared<'a>(&self, code: &StripeCode, pictures: &[ImageView<'a>]) -> Prepared<'a> {
        let axes = self.usable(code);
        let is_kept = |it: &Group| match it {
            Group::Stripes(axis) => axes.contains(axis),
            Group::White => self.picture(code, Shown::White).is_some(),
            Group::Black => self.picture(code, Shown::Black).is_some(),
        };
        let left = StripeCode { order: code.order.iter().copied().filter(is_kept).collect(), ..code.clone() };
        let left = left.without_finest(self.finest_left_out(code));
        let taken = |what: Shown| -> Option<Cow<'a, [u8]>> {
            if let Some((_, told)) = self.unfolded.iter().find(|it| it.0 == what) {
                return Some(Cow::Owned(told.clone()));
            }
            let picture = self.picture(code, what)?;
            let pixels = pictures.get(picture)?.pixels();
            if let Some((_, relit)) = self.relit.iter().find(|it| it.0 == picture) {
                return Some(Cow::Owned(relit.clone()));
            }
            Some(match self.uneven.iter().find(|it| it.0 == picture) {
                Some((_, factor)) => Cow::Owned(exposure::evened(pixels, *factor)),
                None => Cow::Borrowed(pixels),
            })
        };
        let mut worked_out = Vec::new();
        let list = left.pictures().into_iter().map(|what| {
            if let Some(it) = taken(what) {
                return it;
            }
            worked_out.push(what);
            let other = match what {
                Shown::Bit { axis, plane, inverse } => taken(Shown::Bit { axis, plane, inverse: !inverse }),
                Shown::White | Shown::Black | Shown::Boundary { .. } => None,
                Shown::Phase { axis, step } => {
                    let steps: Vec<(usize, Cow<'a, [u8]>)> = (0..code.steps)
                        .filter_map(|step| Some((step as usize, taken(Shown::Phase { axis, step })?)))
                        .collect();
                    let (there, pixels): (Vec<usize>, Vec<&[u8]>) = steps.iter().map(|it| (it.0, &*it.1)).unzip();
                    if let Some(it) = wave_steps::worked_out(&pixels, &there, step as usize, code.steps as usize) {
                        return Cow::Owned(it);
                    }
                    None
                }
            };
            match (taken(Shown::White), taken(Shown::Black), other) {
                (Some(white), Some(black), Some(other)) => {
                    let sums = white.iter().zip(black.iter()).map(|it| i16::from(*it.0) + i16::from(*it.1));
                    Cow::Owned(
                        sums.zip(other.iter()).map(|(sum, it)| (sum - i16::from(*it)).clamp(0, 255) as u8).collect(),
                    )
                }
                _ => unreachable!("an axis that lacks a picture is not usable"),
            }
        });
        let mut pictures: Vec<Cow<'a, [u8]>> = list.collect();
        // What is left open is not lit, and as bright together as it was: beside a stripe's end a decoder would take two pictures of a bit that are alike for the end itself.
        if let (Some(white), Some(black)) = (left.place(Shown::White), left.place(Shown::Black)) {
            let pairs = self.unfolded.chunks_exact(2).flat_map(|pair| pair[0].1.iter().zip(&pair[1].1).enumerate());
            for (at, _) in pairs.filter(|(_, (bit, inverse))| bit == inverse) {
                let [a, b] = [white, black].map(|it| u16::from(pictures[it][at]));
                pictures[white].to_mut()[at] = ((a + b) / 2) as u8;
                pictures[black].to_mut()[at] = (a + b).div_ceil(2) as u8;
            }
        }
        Prepared { code: left, pictures, worked_out }
    }
}
