//! Which stripe is lit in which of four pictures.
//!
//! A stripe is a node of a graph, numbered by the pictures in which it is lit; a boundary is an arrow from the stripe on its left to the one on its right. A row of stripes is a
//! path through the graph, and no arrow is taken twice: four pictures then distinguish all boundaries.
//!
//! 1. An arrow is one of those whose boundary shows at least in every other picture, also from the fourth to the first: 112 of them.
//! 2. Stripes that are always lit or never are left out, which leaves 86 (the paper keeps them and has 110). What is bright or dark of itself then looks like no boundary of the
//!    code: an edge of the surface's own colour has a side that is dark in all pictures.
//! 3. Of two boundaries side by side one shows in each picture. Two in a row that show alternate between rising and falling, so that neighbours look different in every picture, and no
//!    gap between boundaries that show is wider than two stripes.
//! 4. A projector that is a picture ahead or behind, or shows the pictures backwards, makes other arrows of all arrows. No three in a row become three in a row of the code, so that this cannot be
//!    taken for stripes elsewhere.
//! 5. The path is closed: a projector with more stripes repeats it.
//!
//! Such a path is searched for depth first, the arrow with the fewest continuations first; ties are drawn at random with a fixed seed, and the search restarts after a while. So the code is always the same.

use std::sync::OnceLock;

/// Pictures of the code.
pub const FRAMES: usize = 4;

/// Stripes that are neither always lit nor never.
const STRIPES: std::ops::Range<u8> = 1..15;
/// Steps of a search until it restarts.
const STEPS: usize = 3_000;
/// The first seed of a search that comes to an end; those before it cost a second.
const FIRST_SEED: u64 = 282;

/// How a boundary looks in one picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Look {
    /// Dark on its left, lit on its right.
    Rising,
    /// Lit on its left, dark on its right.
    Falling,
    /// Dark on both sides: it does not show.
    Dark,
    /// Lit on both sides: it does not show.
    Lit,
}

impl Look {
    const ALL: [Look; 4] = [Look::Rising, Look::Falling, Look::Dark, Look::Lit];

    /// Whether it can be seen.
    pub fn shows(self) -> bool {
        matches!(self, Look::Rising | Look::Falling)
    }
}

/// A closed row of stripes. Boundary `i` stands between stripe `i − 1` and stripe `i`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BoundaryCode {
    /// Of each stripe, the pictures in which it is lit, as bits.
    stripes: Vec<u8>,
    /// By picture and look: the boundaries that look so, as bits.
    by_look: [[u128; 4]; FRAMES],
}

type Arrow = (u8, u8);

impl BoundaryCode {
    /// The code that projectors show here.
    pub fn get() -> &'static BoundaryCode {
        static CODE: OnceLock<BoundaryCode> = OnceLock::new();
        CODE.get_or_init(|| {
            let way = (FIRST_SEED..).find_map(search).unwrap_or_default();
            BoundaryCode::of(way.iter().map(|it| it.1).collect())
        })
    }

    fn of(stripes: Vec<u8>) -> BoundaryCode {
        let mut code = BoundaryCode { stripes, by_look: [[0; 4]; FRAMES] };
        for frame in 0..FRAMES {
            for boundary in 0..code.len() {
                code.by_look[frame][code.look(boundary, frame) as usize] |= 1 << boundary;
            }
        }
        code
    }

    /// How many boundaries, and stripes, there are before the code repeats.
    pub fn len(&self) -> usize {
        self.stripes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.stripes.is_empty()
    }

    /// Whether stripe `stripe`, counted over all repetitions, is lit in picture `frame`.
    pub fn is_lit(&self, stripe: usize, frame: usize) -> bool {
        self.stripes[stripe % self.len()] >> (frame % FRAMES) & 1 == 1
    }

    /// How a boundary looks in a picture.
    pub fn look(&self, boundary: usize, frame: usize) -> Look {
        let left = self.is_lit(boundary + self.len() - 1, frame);
        match (left, self.is_lit(boundary, frame)) {
            (false, true) => Look::Rising,
            (true, false) => Look::Falling,
            (false, false) => Look::Dark,
            (true, true) => Look::Lit,
        }
    }

    /// The boundaries that look so in a picture, boundary `i` as bit `i`.
    pub fn that_look(&self, look: Look, frame: usize) -> u128 {
        self.by_look[frame % FRAMES][look as usize]
    }

    /// The boundaries that do not show in a picture.
    pub fn hidden(&self, frame: usize) -> u128 {
        self.that_look(Look::Dark, frame) | self.that_look(Look::Lit, frame)
    }

    /// All boundaries.
    pub fn all(&self) -> u128 {
        Look::ALL.iter().fold(0, |all, look| all | self.that_look(*look, 0))
    }
}

/// In which pictures an arrow's boundary shows.
fn shows((left, right): Arrow) -> u8 {
    left ^ right
}

/// At least in every other picture, also from the last to the first.
fn shows_often(mask: u8) -> bool {
    (0..FRAMES).all(|it| mask >> it & 1 == 1 || mask >> ((it + 1) % FRAMES) & 1 == 1)
}

/// Whether one arrow may follow another.
fn may_follow(one: Arrow, next: Arrow) -> bool {
    one.1 == next.0 && shows(one) | shows(next) == 0b1111
}

/// A way over three arrows, the same for all orders of the pictures that a projector ahead, behind or running backwards makes of it.
fn run_of_three(one: Arrow, two: Arrow, three: Arrow) -> u16 {
    let stripes = [one.0, one.1, two.1, three.1];
    let shown = |order: &dyn Fn(usize) -> usize| {
        let turned = |stripe: u8| (0..FRAMES).fold(0, |turned, it| turned | (stripe >> (order(it) % FRAMES) & 1) << it);
        stripes.iter().fold(0_u16, |key, it| key << 4 | u16::from(turned(*it)))
    };
    let ahead = (0..FRAMES).map(|by| shown(&|it| it + by));
    let back = (0..FRAMES).map(|by| shown(&|it| FRAMES - it + by));
    ahead.chain(back).min().unwrap_or_default()
}

/// A closed way over all arrows; `None` where it was not found in time.
fn search(seed: u64) -> Option<Vec<Arrow>> {
    let arrows: Vec<Arrow> =
        STRIPES.flat_map(|a| STRIPES.map(move |b| (a, b))).filter(|it| shows_often(shows(*it))).collect();
    let next: Vec<Vec<usize>> =
        arrows.iter().map(|one| (0..arrows.len()).filter(|it| may_follow(*one, arrows[*it])).collect()).collect();
    let mut draw = seed;
    let mut is_used = vec![false; arrows.len()];
    // The best last, as they are taken from the end.
    let mut choices = |from: usize, is_used: &[bool]| -> Vec<usize> {
        let is_free = |it: &&usize| !is_used[**it];
        let mut list: Vec<(usize, u64, usize)> = next[from]
            .iter()
            .filter(is_free)
            .map(|it| {
                draw = draw.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (next[*it].iter().filter(is_free).count(), draw >> 33, *it)
            })
            .collect();
        list.sort_unstable_by(|a, b| b.cmp(a));
        list.into_iter().map(|it| it.2).collect()
    };
    let mut way = vec![0];
    is_used[0] = true;
    let mut open = vec![choices(0, &is_used)];
    let mut runs: Vec<u16> = Vec::new();
    let run_to = |way: &[usize], next: usize| match way {
        [.., one, two] => Some(run_of_three(arrows[*one], arrows[*two], arrows[next])),
        _ => None,
    };
    for _ in 0..STEPS {
        let ends = |runs: &[u16]| {
            let closing = [run_to(&way, way[0]), run_to(&[way[way.len() - 1], way[0]], way[1])];
            closing.iter().flatten().all(|it| !runs.contains(it)) && closing[0] != closing[1]
        };
        if way.len() == arrows.len() && may_follow(arrows[way[way.len() - 1]], arrows[way[0]]) && ends(&runs) {
            return Some(way.into_iter().map(|it| arrows[it]).collect());
        }
        match open.last_mut()?.pop() {
            Some(it) => {
                let run = run_to(&way, it);
                if run.is_some_and(|it| runs.contains(&it)) {
                    continue;
                }
                runs.extend(run);
                way.push(it);
                is_used[it] = true;
                open.push(choices(it, &is_used));
            }
            None => {
                open.pop();
                if way.len() > 2 {
                    runs.pop();
                }
                is_used[way.pop()?] = false;
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn four_pictures_in_a_row_tell_all_boundaries_apart_wherever_they_begin() {
        let code = BoundaryCode::get();
        assert_eq!(code.len(), 86);
        for first in 0..FRAMES {
            let looks = |boundary: usize| -> Vec<u8> {
                (first..first + FRAMES).map(|frame| code.look(boundary, frame) as u8).collect()
            };
            assert_eq!((0..code.len()).map(looks).collect::<BTreeSet<_>>().len(), code.len());
        }
        // Three do not.
        let three = |boundary: usize| -> Vec<u8> { (0..3).map(|frame| code.look(boundary, frame) as u8).collect() };
        assert!((0..code.len()).map(three).collect::<BTreeSet<_>>().len() < code.len());
    }

    #[test]
    fn a_boundary_shows_at_least_in_every_other_picture() {
        let code = BoundaryCode::get();
        for boundary in 0..code.len() {
            assert!((0..FRAMES).all(|it| code.look(boundary, it).shows() || code.look(boundary, it + 1).shows()));
        }
        let shown: usize = (0..FRAMES).map(|it| code.len() - code.hidden(it).count_ones() as usize).sum();
        assert!((0.65..0.8).contains(&(shown as f64 / (4.0 * 86.0))), "{shown} of 344");
    }

    #[test]
    fn neighbours_look_different_in_every_picture_and_one_of_two_shows() {
        let code = BoundaryCode::get();
        for (boundary, frame) in (0..code.len()).flat_map(|it| (0..FRAMES).map(move |frame| (it, frame))) {
            let [one, next] = [boundary, boundary + 1].map(|it| code.look(it % code.len(), frame));
            assert!(one != next && (one.shows() || next.shows()), "{boundary} in picture {frame}");
        }
    }

    #[test]
    fn a_projector_ahead_behind_or_backwards_shows_no_other_part_of_the_code() {
        let code = BoundaryCode::get();
        let looks = |boundary: usize, order: &dyn Fn(usize) -> usize| -> Vec<u8> {
            (0..FRAMES).map(|it| code.look(boundary % code.len(), order(it)) as u8).collect()
        };
        let told: Vec<Vec<u8>> = (0..code.len()).map(|it| looks(it, &|it| it)).collect();
        let taken_for = |boundary: usize, order: &dyn Fn(usize) -> usize| {
            let seen = looks(boundary, order);
            told.iter().position(|it| *it == seen)
        };
        for by in 0..FRAMES {
            let orders: [&dyn Fn(usize) -> usize; 2] = [&|it| it + by, &|it| FRAMES - it + by];
            for order in orders.into_iter().skip(usize::from(by == 0)) {
                for boundary in 0..code.len() {
                    let three = [0, 1, 2]
                        .map(|it| taken_for(boundary + it, order).map(|at| (at + code.len() - it) % code.len()));
                    let in_a_row = three[0].is_some() && three[0] == three[1] && three[1] == three[2];
                    assert!(!in_a_row || three[0] == Some(boundary), "{boundary} is taken for {three:?}, {by} ahead");
                }
            }
        }
    }

    #[test]
    fn what_is_bright_or_dark_of_itself_is_no_boundary() {
        let code = BoundaryCode::get();
        for boundary in 0..code.len() {
            let of = |stripe: usize| (0..FRAMES).filter(|it| code.is_lit(stripe, *it)).count();
            assert!((1..FRAMES).contains(&of(boundary)));
        }
    }

    #[test]
    fn boundaries_by_look_are_those_that_look_so() {
        let code = BoundaryCode::get();
        for frame in 0..FRAMES {
            let masks = Look::ALL.map(|it| code.that_look(it, frame));
            assert_eq!(masks.iter().map(|it| it.count_ones()).sum::<u32>(), 86);
            assert_eq!(masks.iter().fold(0, |a, b| a | b), code.all());
            let rising = (0..code.len()).filter(|it| code.look(*it, frame) == Look::Rising);
            assert_eq!(rising.fold(0, |mask, it| mask | 1_u128 << it), masks[0]);
        }
    }
}
