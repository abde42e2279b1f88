//! Reconstructs a bit whose two pictures are both missing from the finer and coarser bits and from image orientation.
//!
//! Without one of its bits a Gray code folds: within a stripe of the next coarser bit, columns count up from one side and down again to the other, and the bit says on which slope a pixel lies. A camera sees the lit side of a
//! surface, on which columns and rows have the same orientation as in the projector's picture: where the determinant of their slopes is negative, a pixel lies on the slope that counts down. Pixels near the fold, where
//! slopes are not seen, and where neighbours contradict each other are left undecided.

use super::super::code::{Axis, Inverse, Shown, StripeCode};
use super::super::faults::SetFault;
use super::Examination;
use crate::ImageView;

/// Slopes are seen over so many pixels to either side [px].
const REACH: usize = 5;
/// Pixels around that have to agree, to either side [px], and with what majority [–].
const AROUND: usize = 4;
const AGREE: f64 = 0.6;
/// Of these, so many have to tell a slope [–].
const TELLING: f64 = 0.3;
/// White − black that tells anything [gray levels].
const LEAST: i32 = 8;
/// The bit is left undecided where the two slopes can be distinguished in less than this part of the lit pixels [–].
const TOLD: f64 = 0.5;
/// Where a stripe of a coarser bit ends, columns continue in this part of the places if the slopes are resolved
/// correctly [–]; and the least number of such places.
const GOES_ON: f64 = 0.8;
const LEAST_ENDS: usize = 200;

/// The bit of an axis that lacks altogether, where all others are there; none that is the finest.
pub(super) fn lone_gap(code: &StripeCode, found: &Examination, axis: Axis) -> Option<u32> {
    // Which one lacks has to be known.
    let is_open = |it: &SetFault| matches!(it, SetFault::MissingBits { axis: of, .. } if *of == axis);
    // Below phase steps stripes are wide, and beside a fold one that is open may be taken for its neighbour: a period off.
    if code.inverse == Inverse::None || code.steps > 0 || !code.has(axis) || found.faults.iter().any(is_open) {
        return None;
    }
    let is_there = |plane: &u32| {
        let picture = |inverse: bool| found.picture(code, Shown::Bit { axis, plane: *plane, inverse });
        picture(false).is_some() || picture(true).is_some()
    };
    let mut gaps = (0..code.bits[axis.index()]).filter(|it| !is_there(it));
    let gap = gaps.next().filter(|it| it + 1 < code.bits[axis.index()])?;
    gaps.next().is_none().then_some(gap)
}

/// The two pictures of bit `gap` of an axis, as white and black of the set would have them; both are alike where the bit is undecided. `None` where it is undecided everywhere.
pub(super) fn unfolded(
    code: &StripeCode,
    found: &Examination,
    pictures: &[ImageView<'_>],
    axis: Axis,
    gap: u32,
) -> Option<[Vec<u8>; 2]> {
    let other = Axis::BOTH[1 - axis.index()];
    if !code.has(other) || !found.lacking(code, other).is_empty() || found.finest_left_out(code) != [0, 0] {
        return None;
    }
    let pixels = |what: Shown| found.picture(code, what).and_then(|it| pictures.get(it)).map(ImageView::pixels);
    let (white, black) = (pixels(Shown::White)?, pixels(Shown::Black)?);
    let (width, height) = pictures.first()?.size();
    let n = width * height;
    let contrast = |at: usize| i32::from(white[at]) - i32::from(black[at]);
    // By pixel the bits of an axis, with 0 for the one that lacks; `None` where nothing is lit. A bit that is not certain makes a neighbouring number.
    let bits_of = |axis: Axis| -> Option<Vec<Option<u32>>> {
        let mut bits = vec![Some(0_u32); n];
        for plane in 0..code.bits[axis.index()] {
            let [lit, unlit] = [false, true].map(|inverse| pixels(Shown::Bit { axis, plane, inverse }));
            if lit.is_none() && unlit.is_none() {
                bits.iter_mut().flatten().for_each(|it| *it <<= 1);
                continue;
            }
            for (at, bits) in bits.iter_mut().enumerate() {
                let sum = i32::from(white[at]) + i32::from(black[at]);
                let level = |of: Option<&[u8]>| of.map(|it| i32::from(it[at]));
                let (a, b) = (level(lit), level(unlit));
                let difference = a.unwrap_or_else(|| sum - b.unwrap_or(0)) - b.unwrap_or_else(|| sum - a.unwrap_or(0));
                *bits = bits.filter(|_| contrast(at) >= LEAST).map(|it| it << 1 | u32::from(difference > 0));
            }
        }
        Some(bits)
    };
    let number = |gray: u32| {
        let mut number = gray;
        for shift in [1, 2, 4, 8, 16] {
            number ^= number >> shift;
        }
        number
    };
    let finer = code.bits[axis.index()] - gap - 1;
    let half = 1_u32 << finer;
    // Of the axis: the stripe of the next coarser bit, and how far from the end of it that is nearer; of the other axis the number.
    let own: Vec<Option<(u32, u32)>> = bits_of(axis)?
        .into_iter()
        .map(|it| {
            let number = number(it?);
            let (block, inside) = (number >> (finer + 1), number & (2 * half - 1));
            Some((block, inside.min(2 * half - 1 - inside)))
        })
        .collect();
    let across: Vec<Option<u32>> = bits_of(other)?.into_iter().map(|it| it.map(number)).collect();
    let slope_sign = |at: usize| -> Option<i32> {
        let (block, from_end) = own[at]?;
        // Beside the fold slopes are those of both sides.
        if half - from_end <= 2 || contrast(at) < LEAST {
            return None;
        }
        let (x, y) = (at % width, at / width);
        let along = |is_down: bool| {
            let (place, n, by) = if is_down { (y, height, width) } else { (x, width, 1) };
            let reach = REACH.min(place).min(n - 1 - place);
            let value = |at: usize| {
                let (of, from_end) = own[at]?;
                Some([f64::from(from_end), f64::from(across[at]?)]).filter(|_| of == block)
            };
            let ahead = (1..=reach).rev().find_map(|it| Some((it, value(at + it * by)?)));
            let behind = (1..=reach).rev().find_map(|it| Some((it, value(at - it * by)?)));
            let here = Some((0, value(at)?));
            let ((a, of_a), (b, of_b)) = (ahead.or(here)?, behind.or(here)?);
            (a + b >= REACH).then(|| [0, 1].map(|it| (of_a[it] - of_b[it]) / (a + b) as f64))
        };
        let ([own_x, across_x], [own_y, across_y]) = (along(false)?, along(true)?);
        let determinant = own_x * across_y - own_y * across_x;
        let determinant = if axis == Axis::Columns { determinant } else { -determinant };
        (determinant != 0.0).then_some(if determinant > 0.0 { 1 } else { -1 })
    };
    let signs: Vec<i32> = (0..n).map(|at| slope_sign(at).unwrap_or(0)).collect();
    let slopes = majority(&signs, &own, [width, height]);
    let n_lit = (0..n).filter(|it| own[*it].is_some()).count();
    let n_told = slopes.iter().filter(|it| **it != 0).count();
    if (n_told as f64) < TOLD * n_lit.max(1) as f64 || !goes_on(&slopes, &own, half, width) {
        return None;
    }
    let both = |at: usize| {
        let middle = ((u16::from(white[at]) + u16::from(black[at])) / 2) as u8;
        let Some((block, _)) = own[at].filter(|_| slopes[at] != 0) else { return [middle; 2] };
        // The second half of a block has the binary digit 1; the Gray code's is that and the block's last digit.
        let is_one = (slopes[at] < 0) != (block & 1 == 1);
        if is_one { [white[at], black[at]] } else { [black[at], white[at]] }
    };
    let both: Vec<[u8; 2]> = (0..n).map(both).collect();
    Some([0, 1].map(|which| both.iter().map(|it| it[which]).collect()))
}

/// By pixel the sign that most around it have which lie in its stripe; 0 where they do not agree.
fn majority(signs: &[i32], own: &[Option<(u32, u32)>], [width, height]: [usize; 2]) -> Vec<i32> {
    let one = |at: usize| {
        let Some((block, _)) = own[at] else { return 0 };
        let (x, y) = (at % width, at / width);
        let (mut sum, mut n_told, mut n_all) = (0, 0, 0);
        for row in y.saturating_sub(AROUND)..=(y + AROUND).min(height - 1) {
            for column in x.saturating_sub(AROUND)..=(x + AROUND).min(width - 1) {
                let other = row * width + column;
                if own[other].is_some_and(|it| it.0 == block) {
                    n_all += 1;
                    n_told += signs[other].abs();
                    sum += signs[other];
                }
            }
        }
        let is_told = f64::from(n_told) >= TELLING * f64::from(n_all)
            && f64::from(sum.abs()) >= AGREE * f64::from(n_told)
            && sum.signum() * signs[at] >= 0;
        if is_told && signs[at] != 0 { sum.signum() } else { 0 }
    };
    (0..signs.len()).map(one).collect()
}

/// Whether columns go on from one stripe of the next coarser bit to the next, where these lie side by side: the end of the one is then the beginning of the other. Where none do, nothing contradicts.
fn goes_on(slopes: &[i32], own: &[Option<(u32, u32)>], half: u32, width: usize) -> bool {
    let (mut right, mut n) = (0_usize, 0_usize);
    for at in 0..slopes.len() {
        for beside in (1..=2 * REACH).flat_map(|it| [at + it, at + it * width]) {
            let (Some((a, near_a)), Some(Some((b, near_b)))) = (own[at], own.get(beside)) else { continue };
            if a.abs_diff(*b) != 1 || near_a.max(*near_b) > half / 4 || slopes[at] == 0 || slopes[beside] == 0 {
                continue;
            }
            // The lower of the two stripes ends here: its columns count down to its end; the upper one counts up.
            let [lower, upper] = if a < *b { [slopes[at], slopes[beside]] } else { [slopes[beside], slopes[at]] };
            n += 1;
            right += usize::from(lower < 0 && upper > 0);
        }
    }
    n < LEAST_ENDS || right as f64 >= GOES_ON * n as f64
}

#[cfg(test)]
mod tests {
    use super::super::super::code::Group;
    use super::super::super::scene::{wall, wall_code};
    use super::super::tests::examined;
    use super::*;

    #[test]
    fn a_bit_that_lacks_altogether_is_told_by_the_others() {
        for (code, least) in [(wall_code(), 4), (StripeCode::phase([160, 120], 8, 8), 0)] {
            let whole = wall(2).pictures(&code);
            let mut n_told = 0;
            for (axis, plane) in Axis::BOTH.into_iter().flat_map(|axis| (1..4).map(move |it| (axis, it))) {
                let place = |inverse: bool| code.place(Shown::Bit { axis, plane, inverse }).unwrap();
                let places = [place(false), place(true)];
                let mut pictures = whole.clone();
                places.iter().rev().for_each(|it| drop(pictures.remove(*it)));
                let found = examined(&code, &pictures);
                // Of coarse bits of which few stripes are seen nothing tells which one lacks, and beside folds of fine ones no slopes are seen.
                if !found.faults.contains(&SetFault::Unfolded { axis, plane }) {
                    assert!(!found.usable(&code).contains(&axis), "{axis:?} {plane}: {:?}", found.faults);
                    continue;
                }
                n_told += 1;
                assert_eq!(found.usable(&code), Axis::BOTH, "{axis:?} {plane}: {:?}", found.faults);
                let views: Vec<ImageView<'_>> =
                    pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
                let prepared = found.prepared(&code, &views);
                let difference = |of: [&[u8]; 2], at: usize| i32::from(of[0][at]) - i32::from(of[1][at]);
                let (mut right, mut wrong, mut open) = (0, 0, 0);
                for at in 0..19_200 {
                    let truth = difference(places.map(|it| &whole[it][..]), at);
                    let told = difference(places.map(|it| &prepared.pictures[it][..]), at);
                    if truth.abs() >= 40 {
                        right += usize::from(told * truth > 0);
                        wrong += usize::from(told * truth < 0);
                        open += usize::from(told == 0);
                    }
                }
                let all = right + wrong + open;
                assert!(right * 10 >= all * 6 && wrong * 200 <= all, "{axis:?} {plane}: {right} {wrong} {open}");
            }
            assert!(n_told >= least && (least > 0 || n_told == 0), "{n_told}");
        }
    }

    #[test]
    fn a_bit_of_columns_alone_is_left_out() {
        let order = vec![Group::Stripes(Axis::Columns), Group::White, Group::Black];
        let code = StripeCode { order, ..wall_code() };
        let mut pictures = wall(2).pictures(&code);
        pictures.drain(6..8);
        assert_eq!(examined(&code, &pictures).usable(&code), []);
    }
}
