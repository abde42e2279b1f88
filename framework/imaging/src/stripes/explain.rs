//! What is wrong with a set, in terms of which picture shows what.

use super::code::{Axis, Group, Inverse, Shown, StripeCode};
use super::faults::{Found, SetFault};
use super::identify::{Fit, Samples, Seen, Step, align, bit_of, identify};

/// Of the pictures of bits so many must be known, and so many of these at most be wrong, for a set to be explained [–].
const KNOWN: f64 = 0.5;
const WRONG: f64 = 0.5;
/// With more pictures than this in other places, the whole set may have another order [–].
const OTHER_ORDER: f64 = 0.25;

/// What is wrong with `n_pictures` pictures of `code`, and the picture for each place; `None` where the pictures do not tell. `skipped` say nothing.
pub(super) fn explain(
    code: &StripeCode,
    n_pictures: usize,
    skipped: &[usize],
    samples: &Samples,
) -> Option<(Vec<SetFault>, Vec<Option<usize>>)> {
    // Steps of a sine are neither lit nor dark.
    if code.steps > 0 {
        return None;
    }
    let roles = code.pictures();
    let home = |picture: usize| -> Option<Vec<Shown>> {
        let from_the_end = (picture + roles.len()).checked_sub(n_pictures);
        let mut list: Vec<Shown> =
            [Some(picture), from_the_end].into_iter().flatten().filter_map(|it| roles.get(it).copied()).collect();
        list.dedup();
        (!skipped.contains(&picture)).then_some(list)
    };
    let homes: Vec<Option<Vec<Shown>>> = (0..n_pictures).map(home).collect();
    let seen = identify(code, samples, &homes);
    let mut known: Vec<(Axis, u32)> = Vec::new();
    for it in &seen {
        match it {
            Seen::Bit(shown) => known.extend(bit_of(shown)),
            Seen::Plane(axis, plane) => known.push((*axis, *plane)),
            Seen::Lit | Seen::Dark | Seen::Unknown => {}
        }
    }
    let n_known = known.len();
    let n_bits = roles.iter().filter(|it| matches!(it, Shown::Bit { .. })).count();
    if (n_known as f64) < KNOWN * n_bits as f64 {
        return None;
    }
    known.sort_unstable();
    known.dedup();
    let set = Seens { roles: &roles, seen: &seen, known: &known };
    let (order, mut faults) = match n_pictures == roles.len() {
        true => {
            let is_wrong = |it: &usize| set.fit(*it, *it) == Fit::No;
            let n_wrong = (0..n_pictures).filter(is_wrong).count();
            if n_wrong as f64 > OTHER_ORDER * n_known as f64
                && let Some(other) = set.other_order(code)
            {
                return Some((vec![SetFault::OtherOrder { code: Box::new(other) }], vec![None; roles.len()]));
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
    (!faults.is_empty()).then_some((faults, places))
}

/// What pictures show, beside what the places of a set should.
struct Seens<'a> {
    roles: &'a [Shown],
    seen: &'a [Seen],
    known: &'a [(Axis, u32)],
}

impl Seens<'_> {
    fn fit(&self, picture: usize, place: usize) -> Fit {
        self.seen[picture].fits(self.roles[place], self.known)
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
                _ => faults.push(SetFault::Exchanged { pictures: [a, b], expected: [self.roles[a], self.roles[b]] }),
            }
        }
        for axis in Axis::BOTH {
            let planes: Vec<u32> = inverted.iter().filter(|it| it.0 == axis).map(|it| it.1).collect();
            let all = planes.len() > 1 && planes.len() + 1 >= self.known.iter().filter(|it| it.0 == axis).count();
            faults.extend((!planes.is_empty()).then_some(SetFault::Inverted { axis, planes, all }));
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
            Seen::Plane(axis, plane) => Found::Bit(axis, plane),
            Seen::Lit => Found::Shown(Shown::White),
            Seen::Dark => Found::Shown(Shown::Black),
            Seen::Unknown => return None,
        };
        Some(SetFault::Shows { picture, found, expected })
    }

    /// The code with another order of its pictures that all that is seen fits, if there is one.
    fn other_order(&self, code: &StripeCode) -> Option<StripeCode> {
        let inverses: &[Inverse] = match code.inverse {
            Inverse::None => &[Inverse::None],
            _ => &[Inverse::After, Inverse::Before, Inverse::Apart],
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
        fitting.next()
    }
}

fn permutations(groups: &[Group]) -> Vec<Vec<Group>> {
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
