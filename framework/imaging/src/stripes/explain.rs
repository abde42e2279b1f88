//! What is wrong with a set, in terms of which picture shows what.

use super::code::{Axis, Group, Inverse, Shown, StripeCode};
use super::faults::{Found, SetFault};
use super::identify::{Fit, MIN_CHANGES, Samples, Seen, Step, align, are_alike, bit_of, identify};

/// Of the pictures of bits so many must be known, and so many of these at most be wrong, for a set to be explained [–].
const KNOWN: f64 = 0.5;
const WRONG: f64 = 0.5;
/// With more pictures than this in other places, the whole set may have another order [–].
const OTHER_ORDER: f64 = 0.25;

/// What a set is found to be.
pub(super) struct Explained {
    /// What is wrong.
    pub(super) faults: Vec<SetFault>,
    /// By place the picture that shows what belongs there.
    pub(super) places: Vec<Option<usize>>,
    /// Bits of which nothing tells a picture from its inverse.
    pub(super) unsure: Vec<(Axis, u32)>,
}

impl Explained {
    /// Without what is said of the pictures of an axis that keeps what the code promises, in a set with all its pictures: these stand where they should.
    pub(super) fn clear(&mut self, axis: Axis, shown: &[Shown]) {
        let is_of = |place: usize| shown.get(place).and_then(Shown::axis) == Some(axis);
        self.faults.retain(|it| match it {
            SetFault::Extra { picture, .. } => !is_of(*picture),
            _ => it.axes().is_none_or(|axes| axes.iter().any(|it| *it != axis)),
        });
        for (place, picture) in self.places.iter_mut().enumerate() {
            match is_of(place) {
                true => *picture = Some(place),
                false => *picture = picture.filter(|it| !is_of(*it)),
            }
        }
        self.unsure.retain(|it| it.0 != axis);
    }

    /// Whether the same pictures lack and nothing else is wrong, but for what is sure of them.
    pub(super) fn says_the_same(&self, other: &Explained) -> bool {
        let one = |fault: &SetFault| match fault {
            SetFault::Missing { shown, .. } => Some(bit_of(shown).ok_or(*shown)),
            _ => None,
        };
        let lacking = |it: &Explained| it.faults.iter().map(one).collect::<Option<Vec<_>>>();
        lacking(self).is_some_and(|it| lacking(other) == Some(it))
    }
}

/// Changes of bits for another projector that are tried.
const OTHER_BITS: u32 = 4;
/// Of the bits of another projector so many must be seen for the pictures to be its [–].
const OTHER_KNOWN: f64 = 0.9;

fn homes_of(roles: &[Shown], n_pictures: usize, skipped: &[usize]) -> Vec<Option<Vec<Shown>>> {
    let home = |picture: usize| -> Option<Vec<Shown>> {
        let from_the_end = (picture + roles.len()).checked_sub(n_pictures);
        let mut list: Vec<Shown> =
            [Some(picture), from_the_end].into_iter().flatten().filter_map(|it| roles.get(it).copied()).collect();
        list.dedup();
        (!skipped.contains(&picture)).then_some(list)
    };
    (0..n_pictures).map(home).collect()
}

/// The bit that the picture at a place shows.
pub(super) fn bit_at(roles: &[Shown], place: usize) -> Option<(Axis, u32)> {
    roles.get(place).and_then(bit_of)
}

fn known_of(seen: &[Seen]) -> Vec<(Axis, u32)> {
    let bit = |it: &Seen| match it {
        Seen::Bit(shown) => bit_of(shown),
        Seen::Plane(axis, plane) => Some((*axis, *plane)),
        Seen::Lit | Seen::Dark | Seen::Stripes | Seen::Unknown => None,
    };
    seen.iter().filter_map(bit).collect()
}

/// What pictures show, taken for those of `roles` in their order: what each seems to be, the bits that are known, each once, and how many pictures show one.
fn taken_for(
    code: &StripeCode,
    roles: &[Shown],
    n_pictures: usize,
    skipped: &[usize],
    samples: &Samples,
) -> (Vec<Seen>, Vec<(Axis, u32)>, usize) {
    let seen = identify(code, samples, &homes_of(roles, n_pictures, skipped));
    let mut known = known_of(&seen);
    let n_known = known.len();
    known.sort_unstable();
    known.dedup();
    (seen, known, n_known)
}

fn n_bits(roles: &[Shown]) -> usize {
    roles.iter().filter(|it| bit_of(it).is_some()).count()
}

/// The bits of columns and rows of another projector whose whole set these pictures are, in the order of `code`.
pub(super) fn other_bits(
    code: &StripeCode,
    n_pictures: usize,
    skipped: &[usize],
    samples: &Samples,
) -> Option<[u32; 2]> {
    if code.steps > 0 {
        return None;
    }
    let has = Axis::BOTH.map(|it| code.has(it));
    let off = |bits: [u32; 2]| bits[0].abs_diff(code.bits[0]) + bits[1].abs_diff(code.bits[1]);
    let range = |axis: usize| if has[axis] { 3..=15_u32 } else { code.bits[axis]..=code.bits[axis] };
    let all = range(0).flat_map(|columns| range(1).map(move |rows| [columns, rows]));
    let mut others: Vec<StripeCode> = all
        .filter(|it| (1..=OTHER_BITS).contains(&off(*it)))
        .map(|bits| StripeCode {
            bits,
            projector: bits.map(|it| 1 << it),
            offset: [0; 2],
            stripe: [1; 2],
            ..code.clone()
        })
        .filter(|it| it.pictures().len() == n_pictures)
        .collect();
    others.sort_by_key(|it| off(it.bits));
    let fits = |other: &StripeCode| {
        let roles = other.pictures();
        let (seen, known, n_known) = taken_for(other, &roles, n_pictures, skipped, samples);
        let set = Seens { roles: &roles, seen: &seen, known: &known, samples };
        // Where a bit changes, all finer ones do: none of these is the same all over the picture.
        let is_not_of_it = |it: &usize| {
            let coarser = |(axis, plane): (Axis, u32)| known.iter().any(|it| it.0 == axis && it.1 < plane);
            // Nor does a bit that lacks between two others leave its neighbours in doubt.
            let is_odd = matches!(seen[*it], Seen::Lit | Seen::Dark | Seen::Plane(..));
            is_odd && bit_of(&roles[*it]).is_some_and(coarser)
        };
        n_known as f64 >= OTHER_KNOWN * n_bits(&roles) as f64
            && (0..n_pictures).all(|it| set.fit(it, it) != Fit::No && !is_not_of_it(&it))
            && !set.lacks_a_bit()
    };
    others.into_iter().find(fits).map(|it| it.bits)
}

/// The pictures of one axis, where those of the other are not there: for each place of the whole code its picture; `None` where there is no such axis.
pub(super) fn one_axis(
    code: &StripeCode,
    n_pictures: usize,
    skipped: &[usize],
    samples: &Samples,
) -> Option<Explained> {
    if !Axis::BOTH.into_iter().all(|it| code.has(it)) {
        return None;
    }
    // Where both axes have as many bits, what stripes look like says which one it is.
    let lacking = match samples.along(0..n_pictures) > 0.5 {
        true => [Axis::Rows, Axis::Columns],
        false => [Axis::Columns, Axis::Rows],
    };
    lacking.into_iter().find_map(|lacking| {
        let is_kept = |it: &&Group| **it != Group::Stripes(lacking);
        let rest = StripeCode { order: code.order.iter().filter(is_kept).copied().collect(), ..code.clone() };
        let found = explained(&rest, n_pictures, skipped, samples)?;
        let of_rest = rest.pictures();
        let place = |it: &Shown| of_rest.iter().position(|shown| shown == it).and_then(|at| found.places[at]);
        let all = code.pictures();
        let places: Vec<Option<usize>> = all.iter().map(place).collect();
        let n_there = all.iter().zip(&places).filter(|it| bit_of(it.0).is_some() && it.1.is_some()).count();
        // Nearly all bits of this axis have to be there.
        if (n_there as f64) < OTHER_KNOWN * n_bits(&of_rest) as f64 {
            return None;
        }
        let pictures = all.len() - of_rest.len();
        let faults = std::iter::once(SetFault::NoAxis { axis: lacking, pictures }).chain(found.faults).collect();
        Some(Explained { faults, places, unsure: found.unsure })
    })
}

/// The code with its columns where its rows stand, where the pictures of these look like that: columns that change from row to row.
pub(super) fn with_axes_exchanged(code: &StripeCode, samples: &Samples) -> Option<StripeCode> {
    let roles = code.pictures();
    let along =
        |axis: Axis| samples.along((0..roles.len()).filter(|it| bit_of(&roles[*it]).is_some_and(|it| it.0 == axis)));
    let is_exchanged = code.bits[0] == code.bits[1] && along(Axis::Columns) < 0.5 && along(Axis::Rows) > 0.5;
    let other = |it: &Group| match it {
        Group::Stripes(axis) => Group::Stripes(Axis::BOTH[1 - axis.index()]),
        other => *other,
    };
    is_exchanged.then(|| StripeCode { order: code.order.iter().map(other).collect(), ..code.clone() })
}

/// What is wrong with `n_pictures` pictures of `code`, and the picture for each place; `None` where the pictures do not tell. `skipped` say nothing.
pub(super) fn explain(code: &StripeCode, n_pictures: usize, skipped: &[usize], samples: &Samples) -> Option<Explained> {
    explained(code, n_pictures, skipped, samples).filter(|it| !it.faults.is_empty())
}

/// As [`explain`], of a set in which nothing is wrong too.
fn explained(code: &StripeCode, n_pictures: usize, skipped: &[usize], samples: &Samples) -> Option<Explained> {
    // Steps of a sine are neither lit nor dark.
    if code.steps > 0 {
        return None;
    }
    let roles = code.pictures();
    let (seen, known, n_known) = taken_for(code, &roles, n_pictures, skipped, samples);
    let other_order = || {
        let other = reordered(code, n_pictures, skipped, samples).filter(|_| n_pictures == roles.len())?;
        let faults = vec![SetFault::OtherOrder { code: Box::new(other) }];
        Some(Explained { faults, places: vec![None; roles.len()], unsure: Vec::new() })
    };
    if (n_known as f64) < KNOWN * n_bits(&roles) as f64 {
        return other_order();
    }
    let set = Seens { roles: &roles, seen: &seen, known: &known, samples };
    let (order, mut faults) = match n_pictures == roles.len() {
        true => {
            let is_wrong = |it: &usize| set.fit(*it, *it) == Fit::No;
            let n_wrong = (0..n_pictures).filter(is_wrong).count();
            if n_wrong as f64 > OTHER_ORDER * n_known as f64
                && let Some(other) = other_order()
            {
                return Some(other);
            }
            set.exchanged()
        }
        false => ((0..n_pictures).collect(), Vec::new()),
    };
    let steps = align(n_pictures, roles.len(), |at, place| set.fit(order[at], place));
    let is_wrong = |it: &&Step| !matches!(it, Step::At { fits: true, .. });
    if steps.iter().filter(is_wrong).count() as f64 > WRONG * n_known as f64 {
        return None;
    }
    let mut places = vec![None; roles.len()];
    let mut before = None;
    for step in steps {
        match step {
            Step::At { picture, place, fits } => {
                let picture = order[picture];
                before = Some(picture);
                if fits {
                    places[place] = Some(picture);
                } else {
                    faults.extend(set.wrong(picture, place));
                }
            }
            Step::Extra(picture) => {
                let picture = order[picture];
                before = Some(picture);
                let shown = match seen[picture] {
                    Seen::Bit(shown) => Some(shown),
                    _ => None,
                };
                faults.push(SetFault::Extra { picture, shown });
            }
            Step::Missing(place) => {
                let shown = roles[place];
                let is_open = |it: &Seen| bit_of(&shown).is_some_and(|(axis, plane)| *it == Seen::Plane(axis, plane));
                faults.push(SetFault::Missing { shown, after: before, or_inverse: seen.iter().any(is_open) });
            }
        }
    }
    let unsure: Vec<(Axis, u32)> = seen
        .iter()
        .filter_map(|it| if let Seen::Plane(axis, plane) = it { Some((*axis, *plane)) } else { None })
        .collect();
    // Two pictures of a bit that nothing tells from its inverse are one of each, or one twice.
    for (axis, plane) in &unsure {
        let place = |inverse: bool| {
            let shown = Shown::Bit { axis: *axis, plane: *plane, inverse };
            roles.iter().position(|it| *it == shown).filter(|it| places[*it].is_some())
        };
        if let (Some(a), Some(b)) = (place(false), place(true))
            && let (Some(of_a), Some(of_b)) = (places[a], places[b])
            && are_alike(samples, of_a, of_b)
        {
            let (later, same_as) = (of_a.max(of_b), of_a.min(of_b));
            let place = if later == of_a { a } else { b };
            places[place] = None;
            faults.push(SetFault::Doubled { picture: later, same_as, expected: Some(roles[place]) });
        }
    }
    Some(Explained { faults, places, unsure })
}

/// The code with another order of its pictures that these fit. The places of the pictures decide which axis is which, so they are also taken for those of a set from its end.
fn reordered(code: &StripeCode, n_pictures: usize, skipped: &[usize], samples: &Samples) -> Option<StripeCode> {
    let roles = code.pictures();
    let from_the_end: Vec<Shown> = roles.iter().rev().copied().collect();
    // Inverses that come last stand where bits of the other axis do.
    let inverses_last = StripeCode { inverse: Inverse::Last, ..code.clone() }.pictures();
    let orders = [&roles, &from_the_end, &inverses_last];
    orders.into_iter().filter(|it| it.len() == roles.len()).find_map(|order| {
        let (seen, known, n_known) = taken_for(code, order, n_pictures, skipped, samples);
        let set = Seens { roles: &roles, seen: &seen, known: &known, samples };
        if n_known as f64 >= KNOWN * n_bits(&roles) as f64 { set.other_order(code) } else { None }
    })
}

/// What pictures show, beside what the places of a set should.
struct Seens<'a> {
    roles: &'a [Shown],
    seen: &'a [Seen],
    known: &'a [(Axis, u32)],
    samples: &'a Samples,
}

impl Seens<'_> {
    fn fit(&self, picture: usize, place: usize) -> Fit {
        self.seen[picture].fits(self.roles[place], self.known)
    }

    /// Whether a bit lacks between two that are taken for neighbours: where the coarser one changes, the next finer one is 1, and the one after that is 0.
    fn lacks_a_bit(&self) -> bool {
        let picture = |bit: (Axis, u32)| {
            self.seen.iter().enumerate().find_map(|(picture, it)| match it {
                Seen::Bit(shown) if bit_of(shown) == Some(bit) => Some((picture, Some(*shown))),
                Seen::Plane(axis, plane) if (*axis, *plane) == bit => Some((picture, None)),
                _ => None,
            })
        };
        self.known.iter().any(|&(axis, plane)| {
            let Some((coarser, _)) = picture((axis, plane)) else { return false };
            let Some((finer, Some(Shown::Bit { inverse, .. }))) = picture((axis, plane + 1)) else { return false };
            let [coarser, finer] = [coarser, finer].map(|it| &self.samples.signs[it]);
            let (mut ones, mut n) = (0, 0);
            for [a, b] in self.samples.neighbours.iter().map(|it| it.map(|it| it as usize)) {
                if coarser[a] * coarser[b] < 0 && finer[a] * finer[b] > 0 {
                    n += 1;
                    ones += usize::from((finer[a] > 0) != inverse);
                }
            }
            n >= MIN_CHANGES && 2 * ones < n
        })
    }

    /// Pictures in each other's places: the set with these put right, and what is said of it.
    fn exchanged(&self) -> (Vec<usize>, Vec<SetFault>) {
        let n = self.roles.len();
        let mut order: Vec<usize> = (0..n).collect();
        let mut faults = Vec::new();
        let mut inverted: Vec<(Axis, u32)> = Vec::new();
        for a in 0..n {
            let is_wrong = |it: usize| order[it] == it && self.fit(it, it) == Fit::No;
            let fits = |b: &usize| {
                let both = [self.fit(a, *b), self.fit(*b, a)];
                !both.contains(&Fit::No) && both.contains(&Fit::Yes)
            };
            let Some(b) = (a + 1..n).filter(|it| is_wrong(a) && is_wrong(*it)).find(fits) else { continue };
            order.swap(a, b);
            match (bit_of(&self.roles[a]), bit_of(&self.roles[b])) {
                (Some(bit), other) if other == Some(bit) => inverted.push(bit),
                _ if (self.roles[a], self.roles[b]) == (Shown::White, Shown::Black) => {
                    faults.push(SetFault::WhiteIsBlack { white: a, black: b });
                }
                _ if (self.roles[a], self.roles[b]) == (Shown::Black, Shown::White) => {
                    faults.push(SetFault::WhiteIsBlack { white: b, black: a });
                }
                _ => faults.push(SetFault::Exchanged {
                    pictures: [a, b],
                    expected: [self.roles[a], self.roles[b]],
                    mended: false,
                }),
            }
        }
        for axis in Axis::BOTH {
            let planes: Vec<u32> = inverted.iter().filter(|it| it.0 == axis).map(|it| it.1).collect();
            let all = planes.len() > 1 && planes.len() + 1 >= self.known.iter().filter(|it| it.0 == axis).count();
            faults.extend((!planes.is_empty()).then_some(SetFault::Inverted { axis, planes, all, mended: false }));
        }
        (order, faults)
    }

    /// A picture that shows something else than its place should.
    fn wrong(&self, picture: usize, place: usize) -> Option<SetFault> {
        let expected = self.roles[place];
        let found = match self.seen[picture] {
            Seen::Bit(shown) => {
                let is_it = |it: &usize| *it != picture && self.seen[*it] == Seen::Bit(shown);
                if let Some(same_as) = (0..self.seen.len()).find(is_it) {
                    return Some(SetFault::Doubled { picture, same_as, expected: Some(expected) });
                }
                Found::Shown(shown)
            }
            Seen::Plane(axis, plane) => {
                let is_it = |it: &usize| {
                    *it != picture && self.seen[*it] == self.seen[picture] && are_alike(self.samples, *it, picture)
                };
                if let Some(same_as) = (0..self.seen.len()).find(is_it) {
                    return Some(SetFault::Doubled { picture, same_as, expected: Some(expected) });
                }
                Found::Bit(axis, plane)
            }
            Seen::Lit => Found::Shown(Shown::White),
            Seen::Dark => Found::Shown(Shown::Black),
            Seen::Stripes => return Some(SetFault::Extra { picture, shown: None }),
            Seen::Unknown => return None,
        };
        Some(SetFault::Shows { picture, found, expected })
    }

    /// The code with another order of its pictures that all that is seen fits, if there is one.
    fn other_order(&self, code: &StripeCode) -> Option<StripeCode> {
        let inverses: &[Inverse] = match code.inverse {
            Inverse::None => &[Inverse::None],
            _ => &[Inverse::After, Inverse::Before, Inverse::Apart, Inverse::Last],
        };
        let orders = permutations(&code.order);
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
        let mut fitting = all.filter(|other| {
            let roles = other.pictures();
            let set = Seens { roles: &roles, ..*self };
            other != code && (0..roles.len()).all(|it| set.fit(it, it) != Fit::No)
        });
        let mut other = fitting.next()?;
        // Which axis is which was told by where the pictures stand, which is just what is wrong here: what stripes look like tells it better.
        if code.bits[0] == code.bits[1] && self.columns_lie() {
            for group in &mut other.order {
                if let Group::Stripes(axis) = group {
                    *axis = Axis::BOTH[1 - axis.index()];
                }
            }
        }
        Some(other)
    }

    /// Whether what was taken for columns changes from row to row rather than along them, and rows the other way round.
    fn columns_lie(&self) -> bool {
        let changes = |axis: Axis| {
            let is_of_axis = |it: &usize| match self.seen[*it] {
                Seen::Bit(shown) => shown.axis() == Some(axis),
                Seen::Plane(of, _) => of == axis,
                Seen::Lit | Seen::Dark | Seen::Stripes | Seen::Unknown => false,
            };
            self.samples.along((0..self.seen.len()).filter(is_of_axis))
        };
        changes(Axis::Columns) < changes(Axis::Rows)
    }
}

/// Groups in every order.
pub(super) fn permutations(groups: &[Group]) -> Vec<Vec<Group>> {
    if groups.is_empty() {
        return vec![Vec::new()];
    }
    let with_first = |at: usize| {
        let mut others = groups.to_vec();
        let first = others.remove(at);
        permutations(&others).into_iter().map(move |it| [vec![first], it].concat())
    };
    (0..groups.len()).flat_map(with_first).collect()
}
