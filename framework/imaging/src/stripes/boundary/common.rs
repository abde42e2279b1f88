//! Common offset of a whole picture from its prediction, as errors of a pan-tilt head's pose cause.
//!
//! Tracks whose boundary is known vote. Where one shows as rising or falling, each edge of that kind near it says how far it may have moved, and each edge of the other kind how far it has not; a
//! ghost says where no edge should be. True differences pile up in one place of the histogram, accidental ones cancel: neighbours of a boundary look different from it. The middle of the votes
//! around the highest place is the answer, where most tracks voted for it and no other place is nearly as high; otherwise there is none.

use super::design::{BoundaryCode, Look};
use super::detect::Edge;
use super::track::Track;

/// How far all of a picture may have moved beyond its prediction, in stripes …
const REACH: f32 = 1.5;
/// … and where tracks are not proven: a picture that went to the neighbouring boundaries before anything was known gives numbers that ask for a shift by a stripe in that picture ever after.
const UNPROVEN_REACH: f32 = 0.5;
/// Of the histogram [px].
const BIN: f32 = 0.5;
/// Tracks that vote, at least.
const LEAST: usize = 50;
/// Part of them that must vote for one place, net of those against it.
const MOST: f32 = 0.35;
/// No other place may have more than this part of the votes of the highest.
const SECOND: f32 = 0.6;

/// By how much tracks at their predicted places are off in a picture that shows picture `frame` of the code, in columns [px].
///
/// `None` with too few known tracks, or where they do not agree.
pub(super) fn common_shift<'a>(
    rows: impl Iterator<Item = (&'a [Track], &'a [Edge])> + Clone,
    frame: usize,
    pitch: f32,
) -> Option<f32> {
    let n_proven = rows.clone().flat_map(|it| it.0).filter(|it| it.is_proven()).count();
    let needs_proof = n_proven >= LEAST;
    let reach = pitch * if needs_proof { REACH } else { UNPROVEN_REACH };
    let half = (reach / BIN).ceil() as usize;
    let mut votes = vec![0_i32; 2 * half + 1];
    let mut differences = Vec::new();
    let mut n = 0_usize;
    let code = BoundaryCode::get();
    for (tracks, edges) in rows {
        for track in tracks {
            let Some(number) = track.number().filter(|_| track.is_proven() || !needs_proof) else { continue };
            let look = code.look(number, frame);
            n += usize::from(look.shows());
            let first = edges.partition_point(|it| it.x < track.now.x - reach);
            for edge in edges[first..].iter().take_while(|it| it.x <= track.now.x + reach) {
                let off = edge.x - track.now.x;
                let at = ((off / BIN).round() as isize + half as isize).clamp(0, 2 * half as isize) as usize;
                if look == if edge.is_rising { Look::Rising } else { Look::Falling } {
                    votes[at] += 1;
                    differences.push(off);
                } else {
                    votes[at] -= 1;
                }
            }
        }
    }
    let around = |at: usize| votes[at.saturating_sub(1)..(at + 2).min(votes.len())].iter().sum::<i32>();
    let best = (0..votes.len()).max_by_key(|it| (around(*it), std::cmp::Reverse(it.abs_diff(half))))?;
    let far = (pitch / 2.0 / BIN) as usize;
    let second = (0..votes.len()).filter(|it| it.abs_diff(best) > far).map(around).max().unwrap_or(0);
    let highest = around(best) as f32;
    if n < LEAST || highest < MOST * n as f32 || second as f32 > SECOND * highest {
        return None;
    }
    let middle = (best as f32 - half as f32) * BIN;
    differences.retain(|it| (it - middle).abs() <= 1.5 * BIN);
    let at = differences.len() / 2;
    (!differences.is_empty()).then(|| *differences.select_nth_unstable_by(at, f32::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::super::design::FRAMES;
    use super::super::detect::{DetectOptions, Edges, detect};
    use super::super::scene::Scene;
    use super::super::track::{TrackOptions, Tracker};
    use crate::ImageView;

    const NEXT: usize = 10;

    fn edges(scene: &Scene, picture: usize) -> Edges {
        let pixels = scene.picture(picture, picture % FRAMES);
        let view = ImageView::new(&pixels, scene.size[0], scene.size[1]).unwrap();
        detect(&view, &DetectOptions::default()).unwrap()
    }

    /// A tracker that knows a scene at rest, predicted for picture [`NEXT`] by `off` too much.
    fn tracker(scene: &Scene, off: f32) -> Tracker {
        let mut tracker = Tracker::new(scene.size[1], TrackOptions::default()).unwrap();
        for picture in 0..NEXT {
            tracker.predict(1, &|_, _| [0.0; 2]);
            tracker.update(&edges(scene, picture), picture % FRAMES);
        }
        tracker.predict(1, &|_, _| [off, 0.0]);
        tracker
    }

    /// The rows of `part` moved by `by` [px].
    fn moved(mut edges: Edges, part: std::ops::Range<usize>, by: f32) -> Edges {
        edges.rows[part].iter_mut().flatten().for_each(|it| it.x += by);
        edges
    }

    #[test]
    fn a_shift_that_was_foretold_falsely_is_found() {
        for seed in 1..=3 {
            let scene = Scene::new(0.0, 0.0, seed);
            let edges = edges(&scene, NEXT);
            for off in [-11.0, -5.0, -1.3, 0.0, 0.4, 3.0, 4.0, 7.5, 11.0] {
                let mut tracker = tracker(&scene, off);
                let found = tracker.align(&edges, NEXT % FRAMES);
                assert!((found + off).abs() < 0.15, "seed {seed}: {found} px for {}", -off);
                let agreement = tracker.agreement(&edges);
                assert!(agreement.fits[NEXT % FRAMES] * 10 > agreement.n * 8, "seed {seed}: {agreement:?}");
            }
        }
    }

    #[test]
    fn without_tracks_edges_or_stripes_nothing_is_moved() {
        let scene = Scene::new(0.0, 0.0, 4);
        let mut new = Tracker::new(scene.size[1], TrackOptions::default()).unwrap();
        assert_eq!(new.align(&edges(&scene, 0), 0), 0.0);
        let mut known = tracker(&scene, 5.0);
        let places = |it: &Tracker| it.rows().iter().flatten().map(|it| it.now.x).collect::<Vec<f32>>();
        let before = places(&known);
        assert_eq!(known.align(&Edges { rows: vec![Vec::new(); scene.size[1]], n_saturated: 0 }, NEXT % FRAMES), 0.0);
        let plain = vec![90; scene.size[0] * scene.size[1]];
        let plain = detect(&ImageView::new(&plain, scene.size[0], scene.size[1]).unwrap(), &DetectOptions::default());
        assert_eq!(known.align(&plain.unwrap(), NEXT % FRAMES), 0.0);
        assert_eq!(places(&known), before);
        // Another picture of the code than the one that is shown.
        assert_eq!(known.align(&edges(&scene, NEXT + 1), NEXT % FRAMES), 0.0);
    }

    #[test]
    fn a_part_that_moves_otherwise_is_outvoted_and_a_half_says_nothing() {
        let scene = Scene::new(0.0, 0.0, 5);
        let of = |rows: usize| moved(edges(&scene, NEXT), 0..rows, 6.0);
        let found = tracker(&scene, 3.0).align(&of(scene.size[1] / 4), NEXT % FRAMES);
        assert!((found + 3.0).abs() < 0.15, "{found}");
        let found = tracker(&scene, 3.0).align(&of(scene.size[1] / 2), NEXT % FRAMES);
        assert_eq!(found, 0.0);
    }
}
