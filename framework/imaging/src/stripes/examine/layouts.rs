//! Sets that differ from what is stated: which pictures are missing, or with which settings a complete set was made.
//!
//! Every possible arrangement is tried and accepted if all rules of a Gray code hold in it. How pairs of pictures relate to each other rules most of them out before
//! their pixels are compared with the rules.

use super::super::code::{Axis, Group, Inverse, Shown, StripeCode};
use super::super::explain::{Explained, permutations};
use super::super::faults::SetFault;
use super::super::identify::{Samples, bit_of};
use super::super::wave_steps;
use super::BROKEN;
use super::rules::Set;
use crate::ImageView;

/// Pixels in which pictures are compared with each other.
const FEW: usize = 4000;
/// Two pictures of one bit are each other's inverse but for this part of the pixels [–].
const SAME: f64 = 0.12;
/// A picture may be white (black) where it is not the brightest (darkest) in this part of the pixels at most [–].
const FLAT: f64 = 0.1;
/// Bits of an axis, more or fewer, of other projectors that are tried.
const OTHER_BITS: u32 = 3;
/// Phase steps of other sets that are tried.
const MOST_STEPS: u32 = 16;
/// Least part resolved, of the bits whose order follows from changes of coarser ones [–].
const TOLD: f64 = 0.5;

/// What the pictures of a set are to one another.
pub(super) struct Layouts<'a> {
    set: &'a Set<'a>,
    /// By picture and picture: part of the pixels in which they do not make white and black together [–].
    not_inverse: Vec<Vec<f64>>,
    /// By picture: whether it may be white, and black.
    flat: Vec<[bool; 2]>,
}

/// By place of a code the picture that shows what belongs there.
type Places = Vec<Option<usize>>;

impl<'a> Layouts<'a> {
    /// `set` holds all pictures; what it says of their places is not used.
    pub(super) fn of(set: &'a Set<'a>) -> Layouts<'a> {
        let few: Vec<_> = set.lit.iter().copied().step_by(set.lit.len().div_ceil(FEW).max(1)).collect();
        let few = Set { lit: &few, skipped: Vec::new(), ..*set };
        let n = set.pictures.len();
        let mut not_inverse = vec![vec![1.0; n]; n];
        for (a, b) in (0..n).flat_map(|a| (0..a).map(move |b| (a, b))) {
            let share = few.not_inverse(a, b);
            (not_inverse[a][b], not_inverse[b][a]) = (share, share);
        }
        let flat = (0..n).map(|it| [Shown::White, Shown::Black].map(|shown| few.not_flat(it, shown) <= FLAT));
        Layouts { set, not_inverse, flat: flat.collect() }
    }

    fn is_there(&self, picture: usize) -> bool {
        !self.set.skipped.contains(&picture)
    }

    /// Whether pictures may be those of a code, by what pairs are to each other.
    fn may_be(&self, roles: &[Shown], places: &Places) -> bool {
        roles.iter().zip(places).all(|(shown, picture)| {
            let Some(picture) = picture.filter(|it| self.is_there(*it)) else { return true };
            match shown {
                Shown::White => self.flat[picture][0],
                Shown::Black => self.flat[picture][1],
                Shown::Bit { axis, plane, inverse: false } => {
                    let other = Shown::Bit { axis: *axis, plane: *plane, inverse: true };
                    let other = roles.iter().position(|it| *it == other).and_then(|it| places[it]);
                    other.filter(|it| self.is_there(*it)).is_none_or(|it| self.not_inverse[picture][it] <= BROKEN)
                }
                Shown::Bit { .. } | Shown::Phase { .. } | Shown::Boundary { .. } => true,
            }
        })
    }

    /// Whether two pictures of different bits, or of a bit and a phase step, are each other's inverse, which they never are.
    fn mixes_bits(&self, roles: &[Shown], places: &Places) -> bool {
        let has_stripes = |it: &usize| self.is_there(*it) && !self.flat[*it].contains(&true);
        let bits: Vec<_> = roles
            .iter()
            .zip(places)
            .filter(|it| matches!(it.0, Shown::Bit { .. } | Shown::Phase { .. }))
            .filter_map(|(shown, picture)| Some((bit_of(shown), picture.filter(has_stripes)?)))
            .collect();
        bits.iter().enumerate().any(|(at, (bit, picture))| {
            bits[..at].iter().any(|(other, before)| other != bit && self.not_inverse[*picture][*before] < SAME)
        })
    }

    /// Whether all that a code promises holds, and enough of it can be seen.
    fn holds(&self, code: &StripeCode, roles: &[Shown], places: &Places) -> bool {
        self.is_sound(code, roles, places, |set| {
            Axis::BOTH.into_iter().filter(|it| code.has(*it)).all(|axis| {
                let can_be = code.bits[axis.index()].saturating_sub(1);
                set.n_told(axis) as f64 >= TOLD * f64::from(can_be)
            })
        })
    }

    /// Whether nothing that a code promises is broken, and what else is asked.
    fn is_sound(
        &self,
        code: &StripeCode,
        roles: &[Shown],
        places: &Places,
        and: impl FnOnce(&Set<'_>) -> bool,
    ) -> bool {
        if !self.may_be(roles, places) || self.mixes_bits(roles, places) {
            return false;
        }
        let any = self.set.pictures[0];
        let views: Vec<ImageView<'_>> = places.iter().map(|it| it.map_or(any, |it| self.set.pictures[it])).collect();
        let is_missing = |it: &usize| places[*it].is_none_or(|it| !self.is_there(it));
        let skipped = (0..roles.len()).filter(is_missing).collect();
        let set = Set { code, pictures: &views, shown: roles, skipped, ..*self.set };
        set.broken_rules().is_empty() && and(&set)
    }

    /// One or two pictures that lack, where nothing else is wrong.
    pub(super) fn few_lack(&self) -> Option<Explained> {
        let code = self.set.code;
        let roles = code.pictures();
        let (n, all) = (self.set.pictures.len(), roles.len());
        let lacking: Vec<Vec<usize>> = match all.checked_sub(n)? {
            1 => (0..all).map(|it| vec![it]).collect(),
            2 => (0..all).flat_map(|b| (0..b).map(move |a| vec![a, b])).collect(),
            _ => return None,
        };
        let placed = |lacking: &[usize]| -> Places {
            let mut next = 0..n;
            (0..all).map(|it| if lacking.contains(&it) { None } else { next.next() }).collect()
        };
        let holding: Vec<Vec<usize>> = lacking.into_iter().filter(|it| self.holds(code, &roles, &placed(it))).collect();
        let first = holding.first()?;
        let places = placed(first);
        let after = |place: usize| places[..place].iter().rev().find_map(|it| *it);
        let bits = |it: &[usize]| it.iter().map(|it| bit_of(&roles[*it])).collect::<Vec<_>>();
        // Steps of a wave are like each other.
        let of_step = |it: &usize| match roles[*it] {
            Shown::Phase { axis, .. } => Some(axis),
            Shown::Bit { .. } | Shown::White | Shown::Black | Shown::Boundary { .. } => None,
        };
        if let Some(explained) = holding.iter().flatten().find_map(of_step).and_then(|it| self.gap(it, &roles)) {
            return Some(explained);
        }
        if let Some(axis) = of_step(&first[0])
            && holding.iter().flatten().all(|it| of_step(it) == Some(axis))
        {
            let places = (0..all).map(|it| places[it].filter(|_| of_step(&it) != Some(axis))).collect();
            let fault = SetFault::MissingSteps { axis, pictures: all - n };
            return Some(Explained { faults: vec![fault], places, unsure: Vec::new() });
        }
        if holding.iter().all(|it| bits(it) == bits(first)) {
            // Nothing tells which of the two of a bit lacks.
            let is_open = |place: &usize| holding.iter().any(|it| !it.contains(place));
            let missing = |place: &usize| {
                let (shown, or_inverse) = (roles[*place], is_open(place));
                SetFault::Missing { shown, after: after(*place), or_inverse }
            };
            let faults = first.iter().map(missing).collect();
            let unsure = first.iter().filter(|it| is_open(it)).filter_map(|it| bit_of(&roles[*it])).collect();
            return Some(Explained { faults, places, unsure });
        }
        // Of one axis, but nothing tells which.
        let mut lost: Vec<(Axis, u32)> = holding.iter().flat_map(|it| bits(it)).collect::<Option<_>>()?;
        lost.sort_unstable();
        lost.dedup();
        let (axis, _) = lost[0];
        let fault = SetFault::MissingBits { axis, planes: lost.iter().map(|it| it.1).collect(), pictures: all - n };
        let is_one_axis = lost.iter().all(|it| it.0 == axis);
        is_one_axis.then(|| Explained { faults: vec![fault], places, unsure: lost })
    }

    /// Which one phase step of an axis lacks, as the wave of the others tells it.
    fn gap(&self, axis: Axis, roles: &[Shown]) -> Option<Explained> {
        let n = self.set.code.steps as usize;
        let first = roles.iter().position(|it| matches!(it, Shown::Phase { axis: of, .. } if *of == axis))?;
        let is_run = (0..n).all(|it| roles.get(first + it) == Some(&Shown::Phase { axis, step: it as u32 }));
        // What could not be read is no step.
        if !is_run || !self.set.skipped.is_empty() || self.set.pictures.len() + 1 != roles.len() {
            return None;
        }
        let steps: Vec<&[u8]> = self.set.pictures[first..first + n - 1].iter().map(|it| it.pixels()).collect();
        let next = self.set.pictures.get(first + n - 1).map(|it| it.pixels());
        let pixels: Vec<usize> = self.set.lit.iter().map(|it| it.0).collect();
        let lacking = first + wave_steps::gap(&steps, next, n, &pixels)?;
        let places: Places =
            (0..roles.len()).map(|it| (it != lacking).then_some(it - usize::from(it > lacking))).collect();
        let is_last = lacking + 1 == first + n;
        let fault = match is_last {
            // Or the first one: where the wave begins the stripes tell.
            true => SetFault::MissingSteps { axis, pictures: 1 },
            false => SetFault::Missing { shown: roles[lacking], after: places[lacking - 1], or_inverse: false },
        };
        Some(Explained { faults: vec![fault], places, unsure: Vec::new() })
    }

    /// Two pictures in each other's places, or one too many, where nothing else is wrong.
    pub(super) fn one_slip(&self) -> Option<Explained> {
        let code = self.set.code;
        let roles = code.pictures();
        let (n, all) = (self.set.pictures.len(), roles.len());
        let natural: Places = (0..all).map(Some).collect();
        let mut holding: Vec<(Vec<usize>, Places)> = Vec::new();
        // An arrangement that spoils what would tell of a fault holds by saying nothing.
        let mut most = 0;
        let mut keep = |which: Vec<usize>, places: Places| {
            let mut told = 0;
            let is_sound = self.is_sound(code, &roles, &places, |set| {
                told = Axis::BOTH.into_iter().filter(|it| code.has(*it)).map(|it| set.n_told(it)).sum();
                told >= most
            });
            if !is_sound {
                return;
            }
            if told > most {
                holding.clear();
                most = told;
            }
            holding.push((which, places));
        };
        if n == all {
            for (a, b) in (0..n).flat_map(|a| (a + 1..n).map(move |b| (a, b))) {
                let mut places = natural.clone();
                places.swap(a, b);
                keep(vec![a, b], places);
            }
        } else if n == all + 1 {
            for extra in 0..n {
                let places = (0..n).filter(|it| *it != extra).map(Some).collect();
                keep(vec![extra], places);
            }
        }
        // Of pictures that are there twice, the later one is too many.
        let together = |it: &[(Vec<usize>, Places)]| it.windows(2).all(|it| it[1].0[0] == it[0].0[0] + 1);
        if holding.is_empty() || holding.len() > 1 && (n == all || !together(&holding) || holding.len() > 2) {
            return None;
        }
        let is_twice = holding.len() == 2;
        let (which, places) = holding.pop()?;
        let shown = |at: usize| places.iter().position(|it| *it == Some(at)).map(|it| roles[it]);
        let fault = match (which[..].try_into() as Result<[usize; 2], _>).ok() {
            None => SetFault::Extra {
                picture: which[0],
                shown: which[0].checked_sub(1).and_then(shown).filter(|_| is_twice),
            },
            Some([a, b]) => match (roles[a], roles[b]) {
                (Shown::White, Shown::Black) => SetFault::WhiteIsBlack { white: a, black: b },
                (Shown::Black, Shown::White) => SetFault::WhiteIsBlack { white: b, black: a },
                (of_a, of_b) => match (bit_of(&of_a), bit_of(&of_b)) {
                    (Some((axis, plane)), other) if other == Some((axis, plane)) => {
                        SetFault::Inverted { axis, planes: vec![plane], all: false, mended: true }
                    }
                    _ => SetFault::Exchanged { pictures: [a, b], expected: [of_a, of_b], mended: true },
                },
            },
        };
        Some(Explained { faults: vec![fault], places, unsure: Vec::new() })
    }

    /// A set in its order of which whole groups lack: the stripes of an axis, white, black.
    pub(super) fn part(&self, looks: &Samples) -> Option<Explained> {
        let code = self.set.code;
        let roles = code.pictures();
        let n = self.set.pictures.len();
        let all = 1..1_usize << code.order.len();
        let parts = all.map(|kept| StripeCode {
            order: code.order.iter().enumerate().filter(|it| kept >> it.0 & 1 == 1).map(|it| *it.1).collect(),
            ..code.clone()
        });
        let is_part = |it: &StripeCode| it.order != code.order && it.check().is_ok() && it.pictures().len() == n;
        let part = self.best(parts.filter(is_part), looks)?;
        let there = part.pictures();
        let places: Places = roles.iter().map(|it| there.iter().position(|shown| shown == it)).collect();
        let fault = |it: &Group| match it {
            Group::Stripes(axis) => {
                let pictures = roles.iter().filter(|it| it.axis() == Some(*axis)).count();
                SetFault::NoAxis { axis: *axis, pictures }
            }
            Group::White | Group::Black => {
                let shown = if *it == Group::White { Shown::White } else { Shown::Black };
                let place = code.place(shown).unwrap_or_default();
                let after = places[..place].iter().rev().find_map(|it| *it);
                SetFault::Missing { shown, after, or_inverse: false }
            }
        };
        let faults = code.order.iter().filter(|it| !part.order.contains(it)).map(fault).collect();
        Some(Explained { faults, places, unsure: Vec::new() })
    }

    /// The first code that holds and whose stripes look like those of their axis.
    fn best(&self, codes: impl Iterator<Item = StripeCode>, looks: &Samples) -> Option<StripeCode> {
        let places: Places = (0..self.set.pictures.len()).map(Some).collect();
        // Where both axes have as many bits, what stripes look like says which one it is.
        let bits = self.set.code.bits;
        let lies = |it: &StripeCode| bits[0] == bits[1] && axes_lie(it, looks);
        codes.filter(|it| !lies(it)).find(|it| self.holds(it, &it.pictures(), &places))
    }

    /// The settings of which these pictures are a whole set, as near to those stated as can be. White and black in each other's places alone are no other settings.
    pub(super) fn whole(&self, looks: &Samples) -> Option<StripeCode> {
        let code = self.set.code;
        let n = self.set.pictures.len();
        let off = |it: &StripeCode| {
            usize::from(it.order != code.order)
                + usize::from(it.inverse != code.inverse)
                + usize::from(it.fine_first != code.fine_first)
        };
        let mut others = other_settings(code);
        others.retain(|it| it.pictures().len() == n);
        others.sort_by_key(off);
        self.best(others.into_iter(), looks)
    }
}

impl Layouts<'_> {
    /// The bits of columns and rows of another projector whose whole set these pictures are, in the order of the code.
    pub(super) fn other_size(&self) -> Option<[u32; 2]> {
        let code = self.set.code;
        let n = self.set.pictures.len();
        let off = |bits: [u32; 2]| bits[0].abs_diff(code.bits[0]) + bits[1].abs_diff(code.bits[1]);
        let range = |axis: Axis| {
            let bits = code.bits[axis.index()];
            if code.has(axis) { bits.saturating_sub(OTHER_BITS)..=bits + OTHER_BITS } else { bits..=bits }
        };
        let all = range(Axis::Columns).flat_map(|columns| range(Axis::Rows).map(move |rows| [columns, rows]));
        let of_bits = |bits: [u32; 2]| {
            let projector = [0, 1].map(|axis| code.stripe[axis] << bits[axis]);
            StripeCode { bits, projector, offset: [0; 2], ..code.clone() }
        };
        let mut others: Vec<StripeCode> = all.filter(|it| off(*it) > 0).map(of_bits).collect();
        others.retain(|it| it.pictures().len() == n && it.check().is_ok());
        others.sort_by_key(|it| off(it.bits));
        let places: Places = (0..n).map(Some).collect();
        others.into_iter().find(|it| self.holds(it, &it.pictures(), &places)).map(|it| it.bits)
    }

    /// Whether neighbouring phase steps of a code are each other's inverse, as a bit and its inverse are.
    pub(super) fn has_bits_for_steps(&self, code: &StripeCode) -> bool {
        let roles = code.pictures();
        let are_steps =
            |it: &[Shown]| matches!(it, [Shown::Phase { axis: a, .. }, Shown::Phase { axis: b, .. }] if a == b);
        let n = roles.len().min(self.set.pictures.len());
        (1..n).any(|it| are_steps(&roles[it - 1..=it]) && self.not_inverse[it - 1][it] < SAME)
    }

    /// The phase steps and the period of which these pictures are a whole set, in the order of the code.
    pub(super) fn other_waves(&self) -> Option<StripeCode> {
        let code = self.set.code;
        // Pictures of a bit beside their inverse are told from steps: neighbouring ones are none.
        if code.steps == 0 || !matches!(code.inverse, Inverse::After | Inverse::Before) {
            return None;
        }
        let n = self.set.pictures.len();
        let all = (2..=7).flat_map(|it| (3..=MOST_STEPS).map(move |steps| [steps, 1 << it]));
        let others = all.map(|[steps, period]| StripeCode {
            order: code.order.clone(),
            inverse: code.inverse,
            fine_first: code.fine_first,
            ..StripeCode::phase(code.projector, steps, period)
        });
        let is_other = |it: &StripeCode| it != code && it.check().is_ok() && it.pictures().len() == n;
        let places: Places = (0..n).map(Some).collect();
        let mut holding = others
            .filter(is_other)
            .filter(|it| !self.has_bits_for_steps(it) && self.holds(it, &it.pictures(), &places));
        // One alone: more of them say nothing.
        holding.next().filter(|_| holding.next().is_none())
    }
}

/// Whether what a code has for columns changes down the picture rather than along its rows, and rows the other way round.
fn axes_lie(code: &StripeCode, looks: &Samples) -> bool {
    let roles = code.pictures();
    let along =
        |axis: Axis| looks.along((0..roles.len()).filter(|it| bit_of(&roles[*it]).is_some_and(|it| it.0 == axis)));
    match Axis::BOTH.map(|it| code.has(it)) {
        [true, true] => along(Axis::Columns) < along(Axis::Rows),
        [true, false] => along(Axis::Columns) < 0.5,
        _ => along(Axis::Rows) > 0.5,
    }
}

/// A code with every other order of its pictures, with and without those of an axis, white, black and inverses.
fn other_settings(code: &StripeCode) -> Vec<StripeCode> {
    let groups: Vec<Group> = Axis::BOTH.map(Group::Stripes).into_iter().chain([Group::White, Group::Black]).collect();
    let mut orders: Vec<Vec<Group>> = Vec::new();
    for whole in permutations(&groups) {
        for n in 1..=whole.len() {
            let order = whole[..n].to_vec();
            if !orders.contains(&order) {
                orders.push(order);
            }
        }
    }
    let flip = |it: &Group| match it {
        Group::White => Group::Black,
        Group::Black => Group::White,
        it => *it,
    };
    let flipped: Vec<Group> = code.order.iter().map(flip).collect();
    let inverses = [Inverse::After, Inverse::Before, Inverse::Apart, Inverse::Last, Inverse::None];
    let all = orders.iter().flat_map(|order| {
        inverses.iter().flat_map(move |inverse| {
            [false, true].map(|fine_first| StripeCode {
                order: order.clone(),
                inverse: *inverse,
                fine_first,
                ..code.clone()
            })
        })
    });
    let is_other = |it: &StripeCode| {
        let is_flipped = it.order == flipped && it.inverse == code.inverse && it.fine_first == code.fine_first;
        it != code && !is_flipped && it.check().is_ok()
    };
    all.filter(is_other).collect()
}

#[cfg(test)]
mod tests {
    use super::super::super::scene::{Scene, wall, wall_code, wall_set};
    use super::super::tests::examined;
    use super::*;

    #[test]
    fn both_pictures_of_a_bit_that_are_missing_are_named_and_no_other() {
        for (axis, first, n) in [(Axis::Columns, 0, 8), (Axis::Rows, 16, 7)] {
            for plane in 0..n {
                let mut pictures = wall_set(1);
                pictures.drain(first + 2 * plane..first + 2 * plane + 2);
                let found = examined(&wall_code(), &pictures);
                let is_named = |it: &&SetFault| !matches!(it, SetFault::ByWidth { .. } | SetFault::Unfolded { .. });
                let faults: Vec<SetFault> = found.faults[1..].iter().filter(is_named).cloned().collect();
                // Bits that are one value all over the wall are told from no other one, nor is the coarsest from the finest.
                let bits: Vec<u32> = match &faults[..] {
                    [SetFault::MissingBits { axis: of, planes, pictures: 2 }] if *of == axis => planes.clone(),
                    [SetFault::Missing { shown: a, .. }, SetFault::Missing { shown: b, .. }]
                        if a.axis() == Some(axis) && bit_of(a) == bit_of(b) =>
                    {
                        bit_of(a).into_iter().map(|it| it.1).collect()
                    }
                    other => panic!("bit {plane} of the {axis:?}: {other:?}"),
                };
                assert!(bits.contains(&(plane as u32)), "bit {plane} of the {axis:?}: {bits:?}");
                // Without its finest bit an axis has wider stripes, and others may be told by the bits that are there.
                let is_unfolded = found.faults.contains(&SetFault::Unfolded { axis, plane: plane as u32 });
                let is_left = |it: &Axis| *it != axis || plane + 1 == n || is_unfolded;
                let usable: Vec<Axis> = Axis::BOTH.into_iter().filter(is_left).collect();
                assert_eq!(found.usable(&wall_code()), usable, "bit {plane} of the {axis:?}");
            }
        }
    }

    #[test]
    fn slips_where_a_part_of_an_axis_is_seen_accuse_no_good_picture() {
        // The second coarsest bit of the rows changes in a small part of the picture.
        let code = StripeCode::gray([160, 128]);
        let part = Scene { projector: |x, y| [20.0 + 0.61 * x, 30.0 + 0.8 * y], ..wall(4) };
        let pictures = part.pictures(&code);
        let usable = |pictures: &[Vec<u8>]| {
            let found = examined(&code, pictures);
            (found.faults.clone(), found.usable(&code))
        };
        assert_eq!(usable(&pictures), (vec![], Axis::BOTH.to_vec()));
        let n = pictures.len();
        for (a, b) in [(4, 5), (8, 9), (5, 24), (n - 2, n - 1)] {
            let mut changed = pictures.clone();
            changed.swap(a, b);
            let (faults, usable) = usable(&changed);
            assert_eq!((faults.len(), usable), (1, Axis::BOTH.to_vec()), "{a} and {b}: {faults:?}");
        }
        for twice in [3, 9, 25] {
            let mut changed = pictures.clone();
            changed.insert(twice, pictures[twice].clone());
            let (faults, usable) = usable(&changed);
            let is_it = matches!(faults[1], SetFault::Extra { picture, shown: Some(_) } if picture == twice + 1);
            assert!(faults.len() == 2 && is_it && usable == Axis::BOTH, "{twice}: {faults:?}");
        }
    }

    #[test]
    fn whole_sets_of_other_settings_are_told_these() {
        let groups = |words: &str| Group::order(words).unwrap();
        for (order, inverse, fine_first) in [
            ("rows columns white black", Inverse::After, false),
            ("columns rows white black", Inverse::After, true),
            ("columns rows white black", Inverse::None, false),
            ("white black rows columns", Inverse::Before, true),
            ("rows black white", Inverse::None, true),
            ("black columns white", Inverse::Apart, false),
        ] {
            let other = StripeCode { order: groups(order), inverse, fine_first, ..wall_code() };
            let pictures: Vec<Vec<u8>> =
                other.pictures().iter().map(|it| wall_set(2)[wall_code().place(*it).unwrap()].clone()).collect();
            let found = examined(&wall_code(), &pictures);
            let [SetFault::OtherOrder { code }] = &found.faults[..] else { panic!("{order}: {:?}", found.faults) };
            assert_eq!(code.order_in_words(), other.order_in_words());
            assert_eq!(examined(code, &pictures).faults, []);
            // Pictures in no order fit no settings.
            let mut spoilt = pictures.clone();
            spoilt.swap(2, 8);
            spoilt.swap(1, 6);
            spoilt.swap(3, 7);
            let said = examined(&wall_code(), &spoilt).faults;
            assert!(!said.iter().any(|it| matches!(it, SetFault::OtherOrder { .. })), "{order}: {said:?}");
        }
    }
}
