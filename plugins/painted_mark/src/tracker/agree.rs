//! Consistency checks: a mark moves as its neighbours do, two marks are not one dot, and blurred pictures are rejected.

use nalgebra::Vector2;

use super::mark_tracker::{MarkTracker, SAME_GUESS_PX};
use super::neighbours::Neighbours;
use super::track::{Found, Track};

/// Largest distance of neighbours [px].
const NEIGHBOUR_PX: f64 = 100.0;
/// With fewer tracks that were seen in two pictures, all found tracks are used as neighbours.
const LEAST_TRUSTED: usize = 3;
/// A picture in which less than this part of so many tracks is found is rejected.
const LEAST_PART: f64 = 0.4;
const LEAST_FOR_BLUR: usize = 8;

impl MarkTracker {
    /// Motion of the neighbours of track `at` beyond their predictions. Tracks that were seen in the picture before are preferred: others
    /// may all have found the same wrong dot.
    pub(super) fn neighbours(&self, at: usize) -> Neighbours {
        let is_trusted = |it: &Track| it.is_seen() && it.found.is_some();
        let has_trusted = self.tracks.iter().filter(|it| is_trusted(it)).count() >= LEAST_TRUSTED;
        let others = self.tracks.iter().enumerate().filter(|(k, it)| *k != at && (!has_trusted || is_trusted(it)));
        let strays = others.filter_map(|(_, it)| Some((it.expected, it.found?.pixel - it.expected)));
        Neighbours::of(self.tracks[at].expected, NEIGHBOUR_PX, strays)
    }

    /// Searches marks that move unlike their neighbours again at the place predicted by these. A lost mark without neighbours stays lost.
    pub(super) fn compare(&mut self, shift: Vector2<f64>) {
        let jump_px = self.settings.jump_px;
        // Twice: the first round takes strays away that would mislead the second.
        for round in 0..2 {
            for at in 0..self.tracks.len() {
                let usual = self.neighbours(at).median();
                let track = &self.tracks[at];
                if track.lost > self.settings.patience_frames {
                    continue;
                }
                // Without neighbours, as the whole moves; but who was lost may then be anything.
                let Some(usual) = usual.or(track.is_seen().then(Vector2::zeros)) else {
                    self.tracks[at].found = None;
                    continue;
                };
                let expected = track.expected;
                let fits = |found: &Found| (found.pixel - expected - usual).norm() <= jump_px;
                if track.found.as_ref().is_some_and(fits) {
                    continue;
                }
                let is_worth_it = round == 0 && (track.found.is_some() || usual.norm() > SAME_GUESS_PX);
                let again = is_worth_it.then(|| self.eye.look(&self.settings, track, expected + usual, shift));
                self.tracks[at].found = again.flatten().filter(fits);
            }
        }
    }

    /// Two tracks on one dot: a labelled one is kept; of two labelled ones, both are ambiguous.
    pub(super) fn part(&mut self) {
        let apart = self.apart();
        for a in 0..self.tracks.len() {
            for b in a + 1..self.tracks.len() {
                let (Some(one), Some(other)) = (self.tracks[a].found, self.tracks[b].found) else { continue };
                if (one.pixel - other.pixel).norm() >= apart {
                    continue;
                }
                let named = [a, b].map(|it| self.tracks[it].label.is_some());
                if named[0] == named[1] || !named[0] {
                    self.tracks[a].found = None;
                }
                if named[0] == named[1] || !named[1] {
                    self.tracks[b].found = None;
                }
            }
        }
    }

    /// A picture in which most are missing at once is blurred by motion: marks found in it are unreliable.
    pub(super) fn pass_over_blur(&mut self) {
        // Those that were seen just before; in the next blurred picture there are none, and all that are looked for have to do.
        let n_seen = self.tracks.iter().filter(|it| it.is_seen()).count();
        let patience = if n_seen >= LEAST_FOR_BLUR { 0 } else { self.settings.patience_frames };
        let counted = self.tracks.iter().filter(|it| it.lost <= patience);
        let (looked_for, found) =
            counted.fold((0, 0), |(n, found), it| (n + 1, found + usize::from(it.found.is_some())));
        if looked_for >= LEAST_FOR_BLUR && (found as f64) < LEAST_PART * looked_for as f64 {
            self.tally.blurred += 1;
            self.is_blurred = true;
            self.tracks.iter_mut().for_each(|it| it.found = None);
        }
    }
}
