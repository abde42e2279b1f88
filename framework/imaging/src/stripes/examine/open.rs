//! Missing pictures that the rules of a Gray code cannot identify, inferred from how stripes lie in the picture.
//!
//! 1. *Polarity of the coarsest bit when one of its pictures is missing.* With the wrong polarity all stripes count from the other end. If that gives columns outside the projector, the polarity is known. If not, the
//!    other axis resolves it: a camera sees the lit side of a surface, on which columns and rows have the same orientation as in the projector's picture, so the determinant of their slopes is positive.
//! 2. *Whether both pictures of the finest bit or of another bit are missing.* Without its finest bit a code has stripes twice as wide, and everything else holds. Without another bit its stripes are half as wide as assumed, or
//!    fold back. The other axis resolves that too: stripes of equal width in the projector have about equal width in the picture.
//!
//! Columns and rows are compared with a plane each, block by block of the picture: where they are not planar, or blocks disagree, the question stays open.

use nalgebra::{Matrix2, Vector2};

use super::super::code::{Axis, Shown, StripeCode};
use super::super::explain::bit_at;
use super::super::faults::SetFault;
use super::Examination;
use super::rules::Set;

/// Pixels that tell it, at least.
const MIN_SAMPLES: usize = 300;
/// Columns beyond the projector's, over all: of what is right at most, and of what is wrong at least [–].
const RIGHT: f64 = 0.01;
const WRONG: f64 = 0.05;
/// Blocks along each side of the picture; pixels that tell of one, and blocks that tell, at least.
const BLOCKS: usize = 8;
const MIN_IN_BLOCK: usize = 40;
const MIN_BLOCKS: usize = 8;
/// So many of them agree on the way in which columns and rows run: where a bit lacks, they fold back [–].
const AGREE: f64 = 0.9;
/// What a plane leaves of the squares of columns (rows) about their mean, at most [–].
const OFF_PLANE: f64 = 0.1;
/// Slopes of columns and rows stand across each other by this sine at least [–].
const ACROSS: f64 = 0.5;
/// Slopes of columns over those of rows, or the other way about, where stripes are as wide as they are taken for: a surface turned by 37° makes 1.25, and another bit that lacks 2 of 1 [–].
const AS_WIDE: f64 = 1.25;

/// Changes of the finest bit that is there over those of the next coarser one: two where these are neighbours, and four where one between them lacks.
const AS_NARROW: f64 = 2.8;

/// Columns and rows in the picture, of bits that are certain.
struct Numbers {
    /// x, y, column and row where both are known [px].
    places: Vec<[f64; 4]>,
    /// By axis the part of the pixels with one that the projector does not have [–].
    beyond: [f64; 2],
}

/// How columns and rows lie in the picture.
struct Way {
    /// Whether they run round as in the projector's picture, and not as in a mirror.
    is_as_projector: bool,
    /// Steepness of columns over that of rows, in the middle one of the blocks [–].
    as_wide: f64,
}

/// Whether anything is open that may be settled.
pub(super) fn is_open(code: &StripeCode, found: &Examination) -> bool {
    let lacks = |it: &SetFault| matches!(it, SetFault::MissingBits { .. });
    code.steps == 0 && (!found.unsure.is_empty() || found.faults.iter().any(lacks))
}

/// Settles what is open of `found`, and says by what.
pub(super) fn settle(set: &Set<'_>, found: &mut Examination) {
    for axis in Axis::BOTH.into_iter().filter(|it| set.code.has(*it)) {
        settle_finest(set, found, axis);
    }
    // What one axis tells by its range may tell the other.
    for axis in [Axis::Columns, Axis::Rows, Axis::Columns].into_iter().filter(|it| set.code.has(*it)) {
        settle_inverse(set, found, axis);
    }
}

/// Resolves which bit lacks both pictures, the finest or another, where the pictures themselves do not say.
fn settle_finest(set: &Set<'_>, found: &mut Examination, axis: Axis) {
    let finest = set.code.bits[axis.index()] - 1;
    let is_open = |it: &SetFault| matches!(it, SetFault::MissingBits { axis: of, planes, .. } if *of == axis && planes.contains(&finest));
    let Some(at) = found.faults.iter().position(is_open) else { return };
    let n_pictures = set.pictures.len();
    let shown = set.code.pictures();
    let is_finest = |it: &Shown| matches!(it, Shown::Bit { axis: of, plane, .. } if *of == axis && *plane == finest);
    let lacking: Vec<Shown> = shown.iter().copied().filter(is_finest).collect();
    if n_pictures + lacking.len() != shown.len() {
        return;
    }
    let mut next = 0..n_pictures;
    let places: Vec<Option<usize>> = shown
        .iter()
        .map(|it| if is_finest(it) { None } else { next.next() }.filter(|it| !set.skipped.contains(it)))
        .collect();
    let numbers = Numbers::of(set, &places, |_, it| it);
    let Some(Way { is_as_projector: true, as_wide }) = numbers.way(set.size()) else { return };
    if !(1.0 / AS_WIDE..=AS_WIDE).contains(&as_wide) || numbers.beyond[axis.index()] > RIGHT {
        return;
    }
    // Stripes of a bit are half as wide as those of the next coarser one: a quarter says that another one lies between.
    let [there, coarser] = [1, 2].map(|it| changes(set, &places, axis, finest.saturating_sub(it)));
    if there as f64 > AS_NARROW * coarser as f64 {
        return;
    }
    let after = |what: &Shown| places[..set.code.place(*what).unwrap_or(0)].iter().rev().find_map(|it| *it);
    let faults = lacking.iter().map(|it| SetFault::Missing { shown: *it, after: after(it), or_inverse: false });
    let faults: Vec<SetFault> = faults.chain([SetFault::ByWidth { axis, plane: finest }]).collect();
    found.faults.splice(at..=at, faults);
    found.unsure.retain(|it| it.0 != axis);
    found.places = places;
}

/// How often a bit differs from a pixel to the next, right of it or below.
fn changes(set: &Set<'_>, places: &[Option<usize>], axis: Axis, plane: u32) -> usize {
    let picture = |inverse: bool| set.code.place(Shown::Bit { axis, plane, inverse }).and_then(|it| places[it]);
    let (Some(bit), Some(inverse)) = (picture(false), picture(true)) else { return 0 };
    let is_lit = |at: usize| set.level(bit, at) > set.level(inverse, at);
    let n = set.pictures[bit].pixels().len();
    let beside =
        |&(at, ..): &(usize, u8, u8)| [at + 1, at + set.width].map(|other| other < n && is_lit(at) != is_lit(other));
    set.lit.iter().flat_map(beside).filter(|it| *it).count()
}

/// Resolves which of the two pictures of a bit is missing, where the pictures themselves do not say.
fn settle_inverse(set: &Set<'_>, found: &mut Examination, axis: Axis) {
    // What stands where is open too then.
    if found.faults.iter().any(|it| matches!(it, SetFault::MissingBits { axis: of, .. } if *of == axis)) {
        return;
    }
    let index = axis.index();
    let place = |plane: u32, inverse: bool| set.code.place(Shown::Bit { axis, plane, inverse });
    let lone = |plane: &u32| {
        let [bit, inverse] = [place(*plane, false)?, place(*plane, true)?];
        let there = [bit, inverse].map(|it| found.places[it]);
        (there[0].is_some() != there[1].is_some()).then_some([bit, inverse])
    };
    found.unsure.sort_unstable();
    found.unsure.dedup();
    let mut open = found.unsure.iter().filter(|it| it.0 == axis).filter_map(|it| Some((it.1, lone(&it.1)?)));
    let (Some((plane, [bit, inverse])), None) = (open.next(), open.next()) else { return };
    let is_as_placed_bit = found.places[bit].is_some();
    // Counted from the other end, of all of a block that coarser bits make.
    let flip = (1_u32 << (set.code.bits[index] - plane)) - 1;
    let ways = [false, true]
        .map(|is_other| Numbers::of(set, &found.places, |of, it| if is_other && of == axis { it ^ flip } else { it }));
    let [here, there] = [0, 1].map(|it| ways[it].beyond[index]);
    let by_range = match (here, there) {
        (here, there) if here <= RIGHT && there >= WRONG => Some(false),
        (here, there) if there <= RIGHT && here >= WRONG => Some(true),
        _ => None,
    };
    let is_other_sure =
        found.lacking(set.code, Axis::BOTH[1 - index]).is_empty() && set.code.has(Axis::BOTH[1 - index]);
    let by_way = ways[0].way(set.size()).filter(|_| is_other_sure).map(|it| !it.is_as_projector);
    let is_impossible = here >= WRONG && there >= WRONG;
    let is_other = match (by_range, by_way) {
        (Some(range), Some(way)) if range != way => return,
        (None, None) => return,
        _ if is_impossible => return,
        (range, way) => range.or(way).unwrap_or_default(),
    };
    if is_other {
        found.places.swap(bit, inverse);
    }
    found.unsure.retain(|it| *it != (axis, plane));
    let is_bit = is_as_placed_bit != is_other;
    let lacks = Shown::Bit { axis, plane, inverse: is_bit };
    let before = found.places[..if is_bit { inverse } else { bit }].iter().rev().find_map(|it| *it);
    for fault in &mut found.faults {
        match fault {
            SetFault::Missing { shown, after, or_inverse } if bit_at(&[*shown], 0) == Some((axis, plane)) => {
                (*shown, *after, *or_inverse) = (lacks, before, false);
            }
            SetFault::Doubled { expected: Some(shown), .. } if bit_at(&[*shown], 0) == Some((axis, plane)) => {
                *shown = lacks;
            }
            _ => {}
        }
    }
    if by_range.is_none() {
        found.faults.push(SetFault::ByWay { axis, plane });
    }
}

impl Numbers {
    /// Of pictures that stand at `places`; `change` makes another number of a stripe of an axis.
    fn of(set: &Set<'_>, places: &[Option<usize>], change: impl Fn(Axis, u32) -> u32) -> Numbers {
        let mut beyond = [0.0; 2];
        let numbers = Axis::BOTH.map(|axis| {
            let index = axis.index();
            if !set.code.has(axis) {
                return vec![None; set.lit.len()];
            }
            let bits = set.code.bits[index];
            let picture = |plane: u32, inverse: bool| {
                set.code.place(Shown::Bit { axis, plane, inverse }).and_then(|it| places.get(it).copied().flatten())
            };
            let mut planes: Vec<[Option<usize>; 2]> =
                (0..bits).map(|it| [picture(it, false), picture(it, true)]).collect();
            // Without its finest bits the code is one of wider stripes.
            while planes.last() == Some(&[None, None]) {
                planes.pop();
            }
            let left_out = bits - planes.len() as u32;
            let (from, width) = (set.code.offset[index], set.code.stripe[index] << left_out);
            let until = from + set.code.projector[index];
            let (mut n, mut n_beyond) = (0_usize, 0_usize);
            let one = |it: &(usize, u8, u8)| {
                let number = change(axis, set.number(&planes, it)? << left_out) >> left_out;
                n += 1;
                n_beyond += usize::from((number + 1) * width <= from || number * width >= until);
                Some((f64::from(number) + 0.5) * f64::from(width))
            };
            let numbers: Vec<Option<f64>> = set.lit.iter().map(one).collect();
            if n >= MIN_SAMPLES {
                beyond[index] = n_beyond as f64 / n as f64;
            }
            numbers
        });
        let [columns, rows] = &numbers;
        let at = |it: &(usize, u8, u8)| [(it.0 % set.width) as f64, (it.0 / set.width) as f64];
        let both = set.lit.iter().zip(columns.iter().zip(rows));
        let places = both.filter_map(|(it, (column, row))| Some([at(it)[0], at(it)[1], (*column)?, (*row)?]));
        Numbers { places: places.collect(), beyond }
    }

    /// How columns and rows lie in the picture, as most of its blocks have it: the sine between them, positive where they run round as in the projector, and the steepness of columns over that of rows. `None` where few blocks
    /// tell it, or they contradict each other.
    fn way(&self, [width, height]: [f64; 2]) -> Option<Way> {
        let mut blocks: Vec<Vec<[f64; 4]>> = vec![Vec::new(); BLOCKS * BLOCKS];
        for it in &self.places {
            let along = |at: f64, side: f64| ((at / side * BLOCKS as f64) as usize).min(BLOCKS - 1);
            blocks[along(it[1], height) * BLOCKS + along(it[0], width)].push(*it);
        }
        let one = |places: &Vec<[f64; 4]>| {
            let slopes = [slope(places, 2)?, slope(places, 3)?];
            let [steep, of_rows] = [0, 1].map(|it| slopes[it][0].hypot(slopes[it][1]));
            let sine = (slopes[0][0] * slopes[1][1] - slopes[0][1] * slopes[1][0]) / (steep * of_rows);
            (sine.abs() >= ACROSS).then_some((sine > 0.0, steep / of_rows))
        };
        let told: Vec<(bool, f64)> = blocks.iter().filter_map(one).collect();
        let n_as_projector = told.iter().filter(|it| it.0).count();
        let n_agree = n_as_projector.max(told.len() - n_as_projector);
        let mut ratios: Vec<f64> = told.iter().map(|it| it.1).collect();
        ratios.sort_by(f64::total_cmp);
        let is_told = told.len() >= MIN_BLOCKS && n_agree as f64 >= AGREE * told.len() as f64;
        is_told.then(|| Way { is_as_projector: 2 * n_as_projector > told.len(), as_wide: ratios[ratios.len() / 2] })
    }
}

/// The plane of number `which` of some places, by least squares: by how much it grows along x and y.
fn slope(places: &[[f64; 4]], which: usize) -> Option<[f64; 2]> {
    let n = places.len();
    if n < MIN_IN_BLOCK {
        return None;
    }
    let mut mean = [0.0; 4];
    places.iter().for_each(|it| mean.iter_mut().zip(it).for_each(|(mean, it)| *mean += it / n as f64));
    let (mut normal, mut right, mut all) = (Matrix2::zeros(), Vector2::zeros(), 0.0);
    for it in places {
        let place = Vector2::new(it[0] - mean[0], it[1] - mean[1]);
        let number = it[which] - mean[which];
        normal += place * place.transpose();
        right += place * number;
        all += number * number;
    }
    let slope = normal.try_inverse()? * right;
    // What the plane does not explain of the squares.
    let left = all - slope.dot(&right);
    (left <= OFF_PLANE * all).then_some([slope.x, slope.y])
}

#[cfg(test)]
mod tests {
    use super::super::super::code::Group;
    use super::super::super::scene::{Scene, wall, wall_code, wall_set};
    use super::super::tests::examined;
    use super::*;

    #[test]
    fn which_of_the_two_of_the_coarsest_bit_lacks_is_told() {
        // Columns 20 to 140 of 160, of a code of 256: counted from the other end they are beyond the projector. Rows 12 to 80 of 128 are not.
        for (missing, by_way) in [(0, false), (1, false), (16, true), (17, true)] {
            for seed in 1..=3 {
                let mut pictures = wall_set(seed);
                pictures.remove(missing);
                let found = examined(&wall_code(), &pictures);
                let lacks = wall_code().pictures()[missing];
                let is_it =
                    |it: &SetFault| matches!(it, SetFault::Missing { shown, or_inverse: false, .. } if *shown == lacks);
                assert!(is_it(&found.faults[1]), "{lacks}: {:?}", found.faults);
                assert_eq!(found.faults.len(), 2 + usize::from(by_way), "{lacks}: {:?}", found.faults);
                assert_eq!(matches!(found.faults.last(), Some(SetFault::ByWay { plane: 0, .. })), by_way, "{lacks}");
                assert_eq!(found.usable(&wall_code()), Axis::BOTH, "{lacks}");
            }
        }
    }

    #[test]
    fn a_frame_that_was_taken_twice_in_place_of_the_coarsest_bit_is_told() {
        for (of, instead_of) in [(0, 1), (1, 0), (16, 17), (17, 16)] {
            let mut pictures = wall_set(1);
            pictures[instead_of] = pictures[of].clone();
            let found = examined(&wall_code(), &pictures);
            let lacks = wall_code().pictures()[instead_of];
            assert!(
                matches!(found.faults[0], SetFault::Doubled { expected: Some(it), .. } if it == lacks),
                "{lacks}: {:?}",
                found.faults
            );
            assert_eq!(found.usable(&wall_code()), Axis::BOTH, "{lacks}");
            assert_eq!(found.picture_at(instead_of), None, "{lacks}");
        }
    }

    #[test]
    fn nothing_is_told_of_columns_alone_that_the_projector_has_either_way() {
        let code = StripeCode { order: vec![Group::Stripes(Axis::Rows)], ..wall_code() };
        let mut pictures = wall_set(1);
        pictures.truncate(30);
        pictures.drain(..16);
        pictures.remove(0);
        let found = examined(&code, &pictures);
        assert_eq!(found.usable(&code), [], "{:?}", found.faults);
        assert!(!found.faults.iter().any(|it| matches!(it, SetFault::ByWay { .. })), "{:?}", found.faults);
    }

    #[test]
    fn a_set_without_its_finest_bit_has_wider_stripes() {
        for (axis, first, n) in [(Axis::Columns, 0, 8), (Axis::Rows, 16, 7)] {
            for seed in 1..=3 {
                let mut pictures = wall_set(seed);
                pictures.drain(first + 2 * n - 2..first + 2 * n);
                let found = examined(&wall_code(), &pictures);
                assert_eq!(found.usable(&wall_code()), Axis::BOTH, "{axis:?}: {:?}", found.faults);
                let dropped = found.finest_left_out(&wall_code());
                assert_eq!(dropped[axis.index()], 1, "{axis:?}");
                let lacks = |it: &SetFault| match it {
                    SetFault::Missing { shown, or_inverse: false, .. } => {
                        bit_at(&[*shown], 0) == Some((axis, n as u32 - 1))
                    }
                    SetFault::Count { .. } | SetFault::ByWidth { .. } => true,
                    _ => false,
                };
                assert!(found.faults.iter().all(lacks), "{axis:?}: {:?}", found.faults);
            }
        }
    }

    #[test]
    fn a_coarse_bit_that_lacks_is_not_taken_for_the_finest() {
        // The coarsest bit changes nowhere: all the others are a code of their own, of stripes half as wide.
        for at in [30.0, 90.0] {
            let code = StripeCode::gray([160, 128]);
            let scene = if at < 60.0 {
                Scene { projector: |x, y| [3.0 + 0.45 * x, 12.0 + 0.58 * y], ..wall(3) }
            } else {
                Scene { projector: |x, y| [84.0 + 0.45 * x, 12.0 + 0.58 * y], ..wall(3) }
            };
            let mut pictures = scene.pictures(&code);
            pictures.drain(..2);
            let found = examined(&code, &pictures);
            assert_eq!(found.finest_left_out(&code), [0, 0], "{:?}", found.faults);
            assert!(!found.usable(&code).contains(&Axis::Columns), "{:?}", found.faults);
        }
    }

    #[test]
    fn the_second_finest_bit_that_lacks_is_not_taken_for_the_finest() {
        let code = StripeCode::gray([160, 128]);
        for seed in 1..=3 {
            // Stripes of the finest bit are two pixels wide: where a coarser bit changes, the next pixel may lie beyond them.
            let mut pictures =
                Scene { projector: |x, y| [3.0 + 0.97 * x, 12.0 + 0.95 * y], ..wall(seed) }.pictures(&code);
            pictures.drain(12..14);
            let found = examined(&code, &pictures);
            let is_wrong = |it: &SetFault| matches!(it, SetFault::ByWidth { .. });
            assert!(!found.faults.iter().any(is_wrong), "seed {seed}: {:?}", found.faults);
            assert_eq!(found.usable(&code), [Axis::Rows], "seed {seed}: {:?}", found.faults);
        }
    }
}
