//! Detects motion in sets without inverse pictures: lit pixels of a picture of stripes are compared with white.
//!
//! Without inverse pictures nothing adds up to white and black. But within a stripe that is lit a picture has the colours of the surface, and their slopes are those of the white picture as long as nothing moves: the
//! correlation of both, over pixels where white has one, is near 1. Where it is lost, the picture was taken of another scene than white. A light of the room, or another exposure, leaves it as it is. A surface of one colour has no
//! slopes, and says nothing.

use super::super::code::{Inverse, Shown};
use super::super::faults::SetFault;
use super::rules::Set;

/// Every so many pixels one is looked at.
const STEP: usize = 3;
/// A stripe is lit over so many pixels to either side [px].
const AROUND: usize = 3;
/// White has a slope where two pixels apart it differs by more than this [gray levels], and so many standard deviations of a picture's noise.
const SLOPE: f64 = 8.0;
const SIGMAS: f64 = 5.0;
/// Slopes that tell of a picture, at least.
const MIN_SLOPES: usize = 150;
/// Correlation with the slopes of white: of one scene above 0.95; moved by one pixel across colours that change within two, about 0.5 [–].
const ALIKE: f64 = 0.75;
/// More changes than this from one scene to another are none, but something else.
const MOST_CHANGES: usize = 2;

/// Which pictures show the scene of white, in a set with all its pictures and without inverse ones: these, and what is said of the others. `None` where none is known to show another scene.
pub(super) fn of_one_scene(set: &Set<'_>) -> Option<(Vec<usize>, Vec<SetFault>)> {
    if set.code.inverse != Inverse::None || set.code.steps > 0 {
        return None;
    }
    let place = |what: Shown| set.code.place(what).filter(|it| !set.skipped.contains(it));
    let (white, black) = (place(Shown::White)?, place(Shown::Black)?);
    // Of each picture in its order whether it is like white, where that is known.
    let is_like = |picture: usize| match set.shown[picture] {
        Shown::Bit { .. } => is_like_white(set, picture, [white, black]),
        Shown::White => Some(true),
        Shown::Black | Shown::Phase { .. } | Shown::Boundary { .. } => None,
    };
    let known: Vec<(usize, bool)> = (0..set.shown.len())
        .filter(|it| !set.skipped.contains(it))
        .filter_map(|picture| Some((picture, is_like(picture)?)))
        .collect();
    let changes: Vec<[usize; 2]> =
        known.windows(2).filter(|it| it[0].1 != it[1].1).map(|it| [it[0].0, it[1].0]).collect();
    if changes.is_empty() || changes.len() > MOST_CHANGES {
        return None;
    }
    // Pictures between two that are like white are as these are, and others are not used.
    let like: Vec<usize> = known.iter().filter(|it| it.1).map(|it| it.0).collect();
    let is_used = |it: &usize| {
        let [before, after] = [known.iter().rev().find(|of| of.0 <= *it), known.iter().find(|of| of.0 >= *it)];
        [before, after].into_iter().flatten().all(|of| of.1)
    };
    let used: Vec<usize> = (0..set.shown.len()).filter(|it| !set.skipped.contains(it)).filter(is_used).collect();
    let ends = [*like.first()?, used.last().copied()?];
    let unused = |it: &usize| !used.contains(it) && !set.skipped.contains(it);
    let between: Vec<usize> = (ends[0]..=ends[1]).filter(unused).collect();
    let but = between.first().zip(between.last()).map(|(first, last)| [*first, *last]);
    let moved =
        |[last, first]: &[usize; 2]| SetFault::Moved { last: *last, first: *first, used: ends, but, light: None };
    let faults = changes.iter().map(moved).collect();
    Some((used, faults))
}

/// Whether a picture shows what white does; `None` where too little tells it. What moves along one direction leaves slopes along the other as they are: both have to tell that it is so.
fn is_like_white(set: &Set<'_>, picture: usize, [white, black]: [usize; 2]) -> Option<bool> {
    let both = [1, set.pictures[picture].width()].map(|by| likeness(set, picture, by, [white, black]));
    if both.iter().flatten().any(|it| *it < ALIKE) {
        return Some(false);
    }
    both.iter().all(Option::is_some).then_some(true)
}

/// Correlation of the slopes of a picture, to the next pixel or `by` pixels on, with those of white where it is lit; `None` where too few tell it.
fn likeness(set: &Set<'_>, picture: usize, by: usize, [white, black]: [usize; 2]) -> Option<f64> {
    let [shown, white, black] = [picture, white, black].map(|it| set.pictures[it].pixels());
    let (width, height) = set.pictures[picture].size();
    let is_lit =
        |at: usize| 2 * u16::from(shown[at]) > u16::from(white[at]) + u16::from(black[at]) && white[at] > black[at];
    let least = SLOPE.max(SIGMAS * set.noise);
    let (mut n, mut of_both, mut of_shown, mut of_white) = (0_usize, 0.0, 0.0, 0.0);
    let inside = |side: usize| AROUND..side.saturating_sub(AROUND);
    let pixels = inside(height).flat_map(|y| inside(width).map(move |x| (x, y)));
    for at in pixels.filter(|(x, y)| (x + y) % STEP == 0).map(|(x, y)| y * width + x) {
        let slope = |of: &[u8]| f64::from(of[at + by]) - f64::from(of[at - by]);
        let there = slope(white);
        if there.abs() < least || !(0..=2 * AROUND).all(|it| is_lit(at + it * by - AROUND * by)) {
            continue;
        }
        let here = slope(shown);
        n += 1;
        (of_both, of_shown, of_white) = (of_both + here * there, of_shown + here * here, of_white + there * there);
    }
    (n >= MIN_SLOPES).then(|| of_both / (of_shown * of_white).sqrt().max(1e-9))
}

#[cfg(test)]
mod tests {
    use super::super::super::code::{Axis, StripeCode};
    use super::super::super::scene::{Scene, wall};
    use super::super::tests::examined;
    use super::*;

    fn code() -> StripeCode {
        StripeCode { inverse: Inverse::None, ..StripeCode::gray([160, 120]) }
    }

    /// Colours that change within a few pixels.
    fn patches(x: f64, y: f64) -> f64 {
        0.6 + 0.3 * (x / 1.7).sin() * (y / 1.5).cos()
    }

    /// Pictures of a wall, from number `from` on of the same one 3 px further to the right.
    fn moved(from: usize, seed: u64) -> Vec<Vec<u8>> {
        let here = Scene { albedo: patches, ..wall(seed) };
        let there = Scene {
            projector: |x, y| (wall(0).projector)(x - 3.0, y - 1.0),
            albedo: |x, y| patches(x - 3.0, y - 1.0),
            shadow: |x, y| (wall(0).shadow)(x - 3.0, y - 1.0),
            ..wall(seed)
        };
        let mut pictures = here.pictures(&code());
        pictures[from..].clone_from_slice(&there.pictures(&code())[from..]);
        pictures
    }

    #[test]
    fn what_moved_in_a_set_without_inverse_pictures_is_named() {
        // Eight bits of columns, seven of rows, white and black.
        for seed in 1..=3 {
            assert_eq!(examined(&code(), &moved(17, seed)).faults, [], "seed {seed}");
            for (from, usable) in [(5, vec![Axis::Rows]), (8, vec![Axis::Rows]), (12, vec![])] {
                let found = examined(&code(), &moved(from, seed));
                let is_it =
                    |it: &SetFault| matches!(it, SetFault::Moved { last, first, .. } if *last < from && from <= *first);
                assert!(found.faults.iter().any(is_it), "seed {seed}, from {from}: {:?}", found.faults);
                assert_eq!(found.usable(&code()), usable, "seed {seed}, from {from}: {:?}", found.faults);
            }
        }
    }

    #[test]
    fn other_light_is_no_motion_in_a_set_without_inverse_pictures() {
        let scene = wall(2);
        let mut pictures = scene.pictures(&code());
        for (times, picture) in pictures.iter_mut().enumerate() {
            let more = |at: usize| 3.0 * (times % 5) as f64 * (scene.albedo)((at % 160) as f64, (at / 160) as f64);
            picture.iter_mut().enumerate().for_each(|(at, it)| *it = (f64::from(*it) + more(at)).min(255.0) as u8);
        }
        let found = examined(&code(), &pictures);
        assert!(!found.faults.iter().any(|it| matches!(it, SetFault::Moved { .. })), "{:?}", found.faults);
    }
}
