//! Which picture of a set shows what, from the pictures alone.
//!
//! 1. Pictures that are alike, or each other's inverse, show one bit.
//! 2. Where a bit of a Gray code changes between neighbouring pixels, all finer bits of its axis have one value there, and coarser ones and those of the other axis
//!    have both: this puts the bits of an axis in order.
//! 3. That value is 1 for the next finer bit and 0 for those after it: this tells a picture from its inverse, of all but the coarsest bit.
//!
//! Where a picture stands says which axis is which, and which bits they are where some are not seen to change.

use super::code::{Axis, Shown, StripeCode};

/// What a picture seems to show.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Seen {
    /// A bit or its inverse.
    Bit(Shown),
    /// A bit, or its inverse: nothing tells which.
    Plane(Axis, u32),
    /// No stripes, all lit.
    Lit,
    /// No stripes, all dark.
    Dark,
    /// Stripes of a bit, nothing tells which.
    Stripes,
    /// Undetermined.
    Unknown,
}

/// How well what was seen agrees with what is expected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fit {
    Yes,
    Maybe,
    No,
}

impl Seen {
    /// `known` are the bits that some picture was seen to show.
    pub(super) fn fits(&self, expected: Shown, known: &[(Axis, u32)]) -> Fit {
        let may_be = |it: bool| if it { Fit::Maybe } else { Fit::No };
        match (*self, expected) {
            (Seen::Stripes, Shown::White | Shown::Black) => Fit::No,
            (Seen::Stripes | Seen::Unknown, _) => Fit::Maybe,
            (Seen::Bit(shown), _) if shown == expected => Fit::Yes,
            (Seen::Plane(axis, plane), Shown::Bit { axis: of, plane: at, .. }) if (axis, plane) == (of, at) => Fit::Yes,
            (Seen::Lit, Shown::White) | (Seen::Dark, Shown::Black) => Fit::Yes,
            // A bit that is the same all over the picture.
            (Seen::Lit | Seen::Dark, Shown::Bit { axis, plane, .. }) => may_be(!known.contains(&(axis, plane))),
            _ => Fit::No,
        }
    }
}

/// What pictures look like in some of their pixels.
pub(super) struct Samples {
    /// By picture and pixel: 1 lit, −1 dark, 0 neither for certain.
    pub(super) signs: Vec<Vec<i8>>,
    /// Pixels side by side.
    pub(super) neighbours: Vec<[u32; 2]>,
    /// By pair of these, whether one stands below the other rather than beside it.
    pub(super) is_down: Vec<bool>,
}

impl Samples {
    /// Of the changes that pictures show, the part that is seen along rows rather than down columns [–].
    pub(super) fn along(&self, pictures: impl Iterator<Item = usize>) -> f64 {
        let (mut along, mut down) = (0_usize, 0_usize);
        for signs in pictures.map(|it| &self.signs[it]) {
            for ([a, b], is_down) in self.neighbours.iter().zip(&self.is_down) {
                let is_changed = signs[*a as usize] * signs[*b as usize] < 0;
                *if *is_down { &mut down } else { &mut along } += usize::from(is_changed);
            }
        }
        along as f64 / (along + down).max(1) as f64
    }
}

/// One bit, as some pictures show it.
struct Class {
    /// Each with whether it shows the inverse of the first.
    members: Vec<(usize, bool)>,
    signs: Vec<i8>,
    /// Part of the pixels with the rarer value [–].
    rarer: f64,
    /// Bits that stand where its members stand.
    homes: Vec<(Axis, u32)>,
    axis: Axis,
}

/// Part of the pixels in which a picture with stripes is lit (dark), at least [–].
const STRIPES: f64 = 0.03;
/// Two pictures are alike where they differ in less than this part of the rarer value of either [–].
const ALIKE: f64 = 0.3;
/// Changes of a bit that say something.
pub(super) const MIN_CHANGES: usize = 30;
/// Of the rarer value so many are expected by chance where its absence says something.
const MIN_RARER: f64 = 8.0;
/// A bit has one value where the other is rarer than this part of what chance makes it [–].
const ONE_VALUE: f64 = 0.4;

/// A bit changes clearly less often than another below this part of its changes [–].
const FEWER: f64 = 0.7;

/// What each picture shows; `homes` says what the places may be at which each stands, `None` for pictures not to be looked at.
pub(super) fn identify(code: &StripeCode, samples: &Samples, homes: &[Option<Vec<Shown>>]) -> Vec<Seen> {
    let mut seen = vec![Seen::Unknown; samples.signs.len()];
    let mut striped: Vec<usize> = Vec::new();
    for (picture, signs) in samples.signs.iter().enumerate().filter(|it| homes[it.0].is_some()) {
        let (lit, dark) = counts(signs);
        if 4 * (lit + dark) < signs.len() {
            continue;
        }
        match (lit as f64, dark as f64) {
            (lit, dark) if dark < STRIPES * (lit + dark) => seen[picture] = Seen::Lit,
            (lit, dark) if lit < STRIPES * (lit + dark) => seen[picture] = Seen::Dark,
            _ => {
                seen[picture] = Seen::Stripes;
                striped.push(picture);
            }
        }
    }
    let classes = in_classes(samples, &striped, homes);
    let relations = Relations::of(&classes, samples);
    for axis in Axis::BOTH {
        let n_planes = if code.has(axis) { code.bits[axis.index()] as usize } else { 0 };
        let planes = relations.planes(&classes, axis, n_planes);
        for (class, plane) in &planes {
            let coarser = planes.iter().filter(|it| it.1 < *plane);
            let votes = coarser.filter_map(|(other, at)| {
                Some(if relations.value[*other][*class]? == (at + 1 == *plane) { 1 } else { -1 })
            });
            let is_bit = match votes.sum::<i32>() {
                0 => by_places(&classes[*class], homes, axis, *plane),
                sum => Some(sum > 0),
            };
            for (picture, is_inverse_of_first) in &classes[*class].members {
                seen[*picture] = match is_bit {
                    Some(is_bit) => {
                        Seen::Bit(Shown::Bit { axis, plane: *plane, inverse: *is_inverse_of_first == is_bit })
                    }
                    None => Seen::Plane(axis, *plane),
                };
            }
        }
    }
    seen
}

/// Of more than two pictures of one bit one is there twice: which of both kinds is the bit, by where they stand. Nothing is inferred from two or one.
fn by_places(class: &Class, homes: &[Option<Vec<Shown>>], axis: Axis, plane: u32) -> Option<bool> {
    if class.members.len() < 3 {
        return None;
    }
    let stands_as = |inverse_of_first: bool, picture: usize, is_bit: bool| {
        let shown = Shown::Bit { axis, plane, inverse: inverse_of_first == is_bit };
        homes[picture].as_ref().is_some_and(|it| it.contains(&shown))
    };
    let count = |is_bit: bool| class.members.iter().filter(|it| stands_as(it.1, it.0, is_bit)).count();
    let [as_bit, as_inverse] = [count(true), count(false)];
    (as_bit != as_inverse).then_some(as_bit > as_inverse)
}

/// Whether two pictures show the same stripes.
pub(super) fn are_alike(samples: &Samples, a: usize, b: usize) -> bool {
    let (mut like, mut unlike) = (0_usize, 0_usize);
    for (a, b) in samples.signs[a].iter().zip(&samples.signs[b]) {
        like += usize::from(a * b > 0);
        unlike += usize::from(a * b < 0);
    }
    let least = rarer(&samples.signs[a]).min(rarer(&samples.signs[b]));
    least > STRIPES && (unlike as f64) < ALIKE * least * (like + unlike) as f64
}

fn counts(signs: &[i8]) -> (usize, usize) {
    (signs.iter().filter(|it| **it > 0).count(), signs.iter().filter(|it| **it < 0).count())
}

fn rarer(signs: &[i8]) -> f64 {
    let (lit, dark) = counts(signs);
    lit.min(dark) as f64 / (lit + dark).max(1) as f64
}

fn in_classes(samples: &Samples, striped: &[usize], homes: &[Option<Vec<Shown>>]) -> Vec<Class> {
    let mut classes: Vec<Class> = Vec::new();
    for &picture in striped {
        let signs = &samples.signs[picture];
        let own = rarer(signs);
        // Whether it is like the first of a class, or its inverse.
        let like = |class: &Class| -> Option<bool> {
            let first = &samples.signs[class.members[0].0];
            let (mut alike, mut unlike) = (0_usize, 0_usize);
            for (a, b) in first.iter().zip(signs) {
                alike += usize::from(a * b > 0);
                unlike += usize::from(a * b < 0);
            }
            let few = ALIKE * own.min(class.rarer) * (alike + unlike) as f64;
            ((unlike as f64) < few).then_some(false).or(((alike as f64) < few).then_some(true))
        };
        match classes.iter().enumerate().find_map(|(at, it)| Some((at, like(it)?))) {
            Some((at, inverse)) => classes[at].members.push((picture, inverse)),
            None => classes.push(Class {
                members: vec![(picture, false)],
                signs: Vec::new(),
                rarer: own,
                homes: Vec::new(),
                axis: Axis::Columns,
            }),
        }
    }
    for class in &mut classes {
        let mut sums = vec![0_i8; samples.signs[class.members[0].0].len()];
        for (picture, inverse) in &class.members {
            let sign = if *inverse { -1 } else { 1 };
            sums.iter_mut().zip(&samples.signs[*picture]).for_each(|(sum, it)| *sum += sign * it);
        }
        class.signs = sums.iter().map(|it| it.signum()).collect();
        class.rarer = rarer(&class.signs);
        let of_members = class.members.iter().filter_map(|it| homes[it.0].as_ref()).flatten();
        class.homes = of_members.filter_map(bit_of).collect();
        let n_columns = class.homes.iter().filter(|it| it.0 == Axis::Columns).count();
        class.axis = if 2 * n_columns >= class.homes.len() { Axis::Columns } else { Axis::Rows };
    }
    classes
}

/// Axis and number of a bit.
pub(super) fn bit_of(shown: &Shown) -> Option<(Axis, u32)> {
    match shown {
        Shown::Bit { axis, plane, .. } => Some((*axis, *plane)),
        _ => None,
    }
}

/// The coarsest bit of an axis that stands where its members do.
fn home(class: &Class, axis: Axis) -> Option<u32> {
    class.homes.iter().filter(|it| it.0 == axis).map(|it| it.1).min()
}

struct Relations {
    /// Where the first changes: the value that the second has there, if it has one.
    value: Vec<Vec<Option<bool>>>,
    /// How often each changes.
    changes: Vec<usize>,
}

impl Relations {
    fn of(classes: &[Class], samples: &Samples) -> Relations {
        let n = classes.len();
        let mut counts = vec![vec![[0_usize; 2]; n]; n];
        let mut changes = vec![0; n];
        let mut changed: Vec<usize> = Vec::new();
        // Of the pixels to one side of a pixel the nearest one that differs: beyond it fine stripes have changed again.
        let mut last = None;
        for ([a, b], is_down) in samples.neighbours.iter().zip(&samples.is_down) {
            if last == Some((a, is_down)) {
                continue;
            }
            let pair = |it: usize| [classes[it].signs[*a as usize], classes[it].signs[*b as usize]];
            changed.clear();
            changed.extend((0..n).filter(|it| pair(*it)[0] * pair(*it)[1] < 0));
            last = (!changed.is_empty()).then_some((a, is_down));
            // More at once than one bit of each axis: the edge of a surface.
            if !(1..=2).contains(&changed.len()) {
                continue;
            }
            changed.iter().for_each(|it| changes[*it] += 1);
            for (other, [here, _]) in (0..n).map(pair).enumerate().filter(|(_, [here, there])| here * there > 0) {
                changed.iter().for_each(|it| counts[*it][other][usize::from(here > 0)] += 1);
            }
        }
        let value = |a: usize, b: usize| -> Option<bool> {
            let [zeros, ones] = counts[a][b];
            let by_chance = classes[b].rarer * (zeros + ones) as f64;
            let says = a != b && zeros + ones >= MIN_CHANGES && by_chance >= MIN_RARER;
            (says && (zeros.min(ones) as f64) < ONE_VALUE * by_chance).then_some(ones > zeros)
        };
        Relations { value: (0..n).map(|a| (0..n).map(|b| value(a, b)).collect()).collect(), changes }
    }

    /// Whether a bit is coarser than another of its axis.
    fn is_coarser(&self, a: usize, b: usize) -> bool {
        self.value[a][b].is_some() && self.value[b][a].is_none()
    }

    /// The same, where each has one value where the other changes, as bits have that change once in the picture: the coarser one changes less often, else its place says it.
    fn comes_before(&self, classes: &[Class], axis: Axis, a: usize, b: usize) -> bool {
        if self.value[a][b].is_none() || self.value[b][a].is_none() {
            return self.is_coarser(a, b);
        }
        let [of_a, of_b] = [a, b].map(|it| self.changes[it] as f64);
        if of_a < FEWER * of_b || of_b < FEWER * of_a {
            of_a < of_b
        } else {
            home(&classes[a], axis) < home(&classes[b], axis)
        }
    }

    /// The classes of an axis, each with its bit.
    fn planes(&self, classes: &[Class], axis: Axis, n_planes: usize) -> Vec<(usize, u32)> {
        let is_of_axis = |class: &usize| {
            let related = |of: Axis| {
                let others = (0..classes.len()).filter(|it| it != class && classes[*it].axis == of);
                let (all, some) = others.fold((0, 0), |(all, some), it| {
                    (all + 1, some + usize::from(self.is_coarser(*class, it) || self.is_coarser(it, *class)))
                });
                some as f64 / f64::from(all.max(1))
            };
            let [columns, rows] = [related(Axis::Columns), related(Axis::Rows)];
            let found = match columns.max(rows) < 0.3 || (columns - rows).abs() < 0.1 {
                // Neither where it stands nor what it looks like puts it among the bits of an axis.
                true if classes[*class].homes.is_empty() => return false,
                true => classes[*class].axis,
                false if columns > rows => Axis::Columns,
                false => Axis::Rows,
            };
            found == axis
        };
        let mut list: Vec<usize> = (0..classes.len()).filter(is_of_axis).collect();
        let of_axis = list.clone();
        let rank = |class: usize| {
            let before = |a: usize, b: usize| i64::from(self.comes_before(classes, axis, a, b));
            let one = |other: &usize| before(*other, class) - before(class, *other);
            of_axis.iter().map(one).sum::<i64>()
        };
        list.sort_by_key(|it| (rank(*it), home(&classes[*it], axis)));
        // What says nothing of some coarse bits stands too early by its rank: neighbours say it of one another.
        for _ in 0..list.len() {
            for at in 1..list.len() {
                if self.is_coarser(list[at], list[at - 1]) {
                    list.swap(at - 1, at);
                }
            }
        }
        if list.len() > n_planes {
            return Vec::new();
        }
        // A bit that lacks between two others takes its place, too.
        let mut row: Vec<Option<usize>> = Vec::new();
        for at in 0..list.len() {
            row.extend(self.lacks_one_before(&list, at).then_some(None));
            row.push(Some(list[at]));
        }
        if row.len() > n_planes {
            row.retain(Option::is_some);
        }
        in_order(row.len(), n_planes, |at, plane| {
            let Some(class) = row[at] else { return 0 };
            let stands_there = classes[class].homes.contains(&(axis, plane as u32));
            4 * i32::from(stands_there) + i32::from(plane == at + n_planes - row.len())
        })
        .into_iter()
        .zip(&row)
        .filter_map(|(plane, class)| Some(((*class)?, plane as u32)))
        .collect()
    }

    /// Whether a bit lacks before number `at` of a row from coarse to fine: where its neighbour changes it would have the other value than where those before that one do.
    fn lacks_one_before(&self, row: &[usize], at: usize) -> bool {
        let Some(here) = at.checked_sub(1).and_then(|it| self.value[row[it]][row[at]]) else { return false };
        let mut before = row[..at - 1].iter().filter_map(|it| self.value[*it][row[at]]).peekable();
        before.peek().is_some() && before.all(|it| it == here)
    }
}

/// Ascending places among `n` for `k` things in a row, of the highest sum of `worth(thing, place)`.
fn in_order(k: usize, n: usize, worth: impl Fn(usize, usize) -> i32) -> Vec<usize> {
    // best[i][j]: of the things from i on in places from j on.
    let mut best = vec![vec![i32::MIN / 2; n + 2]; k + 1];
    best[k] = vec![0; n + 2];
    for i in (0..k).rev() {
        for j in (0..n).rev() {
            best[i][j] = best[i][j + 1].max(best[i + 1][j + 1] + worth(i, j));
        }
    }
    let (mut places, mut j) = (Vec::new(), 0);
    for i in 0..k {
        while j + 1 < n && best[i][j] == best[i][j + 1] && best[i][j] != best[i + 1][j + 1] + worth(i, j) {
            j += 1;
        }
        places.push(j);
        j += 1;
    }
    places
}

/// One step through a set beside what is expected of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// A picture at its place, and whether it shows what is expected there.
    At { picture: usize, place: usize, fits: bool },
    /// A picture for which there is no place.
    Extra(usize),
    /// A place for which there is no picture.
    Missing(usize),
}

/// The set beside what is expected of it, with as few pictures as can be that are wrong, too many or missing.
pub(super) fn align(n_pictures: usize, n_places: usize, fit: impl Fn(usize, usize) -> Fit) -> Vec<Step> {
    const GAP: u32 = 10;
    let price = |picture: usize, place: usize| match fit(picture, place) {
        Fit::Yes => 0,
        Fit::Maybe => 2,
        Fit::No => 15,
    };
    let mut cost = vec![vec![0_u32; n_places + 1]; n_pictures + 1];
    for i in (0..=n_pictures).rev() {
        for j in (0..=n_places).rev() {
            let (extra, missing) = (i < n_pictures, j < n_places);
            let both = (extra && missing).then(|| cost[i + 1][j + 1] + price(i, j));
            let others = [extra.then(|| cost[i + 1][j] + GAP), missing.then(|| cost[i][j + 1] + GAP), both];
            cost[i][j] = others.into_iter().flatten().min().unwrap_or(0);
        }
    }
    let (mut i, mut j, mut steps) = (0, 0, Vec::new());
    while i < n_pictures || j < n_places {
        let (extra, missing) = (i < n_pictures, j < n_places);
        if extra && missing && cost[i][j] == cost[i + 1][j + 1] + price(i, j) {
            steps.push(Step::At { picture: i, place: j, fits: fit(i, j) != Fit::No });
            (i, j) = (i + 1, j + 1);
        } else if extra && cost[i][j] == cost[i + 1][j] + GAP {
            steps.push(Step::Extra(i));
            i += 1;
        } else {
            steps.push(Step::Missing(j));
            j += 1;
        }
    }
    steps
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn things_keep_their_order_and_take_the_places_of_highest_worth() {
        assert_eq!(in_order(3, 5, |i, j| i32::from([0, 3, 4][i] == j)), [0, 3, 4]);
        assert_eq!(in_order(2, 4, |i, j| i32::from(j == i + 2)), [2, 3]);
        assert_eq!(in_order(0, 4, |_, _| 0), [] as [usize; 0]);
        assert_eq!(in_order(3, 3, |_, _| 0), [0, 1, 2]);
    }

    #[test]
    fn pictures_are_missing_or_too_many_where_they_are() {
        let fit = |shown: &'static [usize]| move |i: usize, j: usize| if shown[i] == j { Fit::Yes } else { Fit::No };
        assert!(align(4, 5, fit(&[0, 1, 3, 4])).contains(&Step::Missing(2)));
        assert!(align(6, 5, fit(&[0, 1, 2, 2, 3, 4])).iter().any(|it| matches!(it, Step::Extra(2 | 3))));
        let wrong = align(5, 5, fit(&[0, 1, 1, 3, 4]));
        assert!(wrong.contains(&Step::At { picture: 2, place: 2, fits: false }), "{wrong:?}");
    }
}
