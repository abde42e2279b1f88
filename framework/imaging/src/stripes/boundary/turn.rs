//! Which of the four pictures is shown, where it is not stated or has to be verified.
//!
//! A picture taken for another one than it is makes other boundaries of all boundaries, and no three side by side stay side by side ([`design`](super::design), 4). So edges are tracked four times, the projector
//! taken to be none to three pictures ahead of what is said: where it is, boundaries that four pictures make known follow one another in the row and lie above one another from row to row; where it is
//! not, most are contradicted by their neighbours. Boundaries that their neighbours confirm ([`lines`]) are counted over the last few pictures.

use super::decode::{Line, known, lines};
use super::design::FRAMES;
use super::detect::Edges;
use super::track::{Shift, Tracker};

/// Boundaries that must hold in the last pictures together before anything is said …
const LEAST: f32 = 200.0;
/// … and of those that are known, this part at least: of rendered recordings 0.74 to 0.99 where pictures were taken for what they show, stripes of 2 px in the camera's picture among them, and 0.03 to 0.37 where they
/// were taken for others, or ran backwards or out of turn [–] …
const MOST: f32 = 0.55;
/// … and no other order may have more than this part of them [–].
const SECOND: f32 = 0.5;
/// A picture counts for less by this factor with each that follows.
const FADES: f32 = 0.8;

/// How many boundaries are known by what was seen of them, and how many of these hold against their neighbours, in the last few pictures.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Held {
    /// Known by their own looks [boundaries].
    pub known: f32,
    /// Confirmed by their neighbours [boundaries].
    pub confirmed: f32,
}

impl Held {
    /// Of one picture: its tracks, and the boundaries of them that hold.
    pub fn of(tracker: &Tracker, lines: &[Vec<Line>]) -> Held {
        Held { known: known(tracker) as f32, confirmed: lines.iter().map(Vec::len).sum::<usize>() as f32 }
    }

    /// Takes up a picture.
    pub fn take(&mut self, one: Held) {
        self.known = FADES * self.known + one.known;
        self.confirmed = FADES * self.confirmed + one.confirmed;
    }

    /// Part of what is known that holds [–].
    pub fn share(&self) -> f32 {
        self.confirmed / self.known.max(1.0)
    }
}

/// Four trackers of the same pictures, each of which takes the projector to be so many pictures ahead of what is said.
#[derive(Debug, Clone)]
pub struct Turns {
    trackers: Vec<Tracker>,
    held: [Held; FRAMES],
}

impl Turns {
    /// All four as `tracker` is, which has no tracks yet.
    pub fn new(mut tracker: Tracker) -> Turns {
        tracker.reset();
        Turns { trackers: vec![tracker; FRAMES], held: [Held::default(); FRAMES] }
    }

    /// From one stripe to the next from now on, about [px].
    pub fn set_pitch(&mut self, pitch: f32) {
        self.trackers.iter_mut().for_each(|it| it.set_pitch(pitch));
    }

    /// As [`Tracker::predict`].
    pub fn predict(&mut self, pictures: u32, shift: Shift<'_>) {
        self.trackers.iter_mut().for_each(|it| it.predict(pictures, shift));
    }

    /// As [`Tracker::align`], each by its own tracks [px].
    pub fn align(&mut self, edges: &Edges, told: usize) -> [f32; FRAMES] {
        let mut off = [0.0; FRAMES];
        for (ahead, (off, tracker)) in off.iter_mut().zip(&mut self.trackers).enumerate() {
            *off = tracker.align(edges, (told + ahead) % FRAMES);
        }
        off
    }

    /// As [`Tracker::update`]; `told` is the picture that should be shown.
    pub fn update(&mut self, edges: &Edges, told: usize) {
        for (ahead, (tracker, held)) in self.trackers.iter_mut().zip(&mut self.held).enumerate() {
            tracker.update(edges, (told + ahead) % FRAMES);
            held.take(Held::of(tracker, &lines(tracker)));
        }
    }

    /// By how many pictures the projector is ahead: what holds.
    pub fn held(&self) -> &[Held; FRAMES] {
        &self.held
    }

    /// How many pictures the projector is ahead of what is said; `None` while that is not certain.
    pub fn decided(&self) -> Option<usize> {
        let mut order: Vec<usize> = (0..FRAMES).collect();
        order.sort_by(|a, b| self.held[*b].confirmed.total_cmp(&self.held[*a].confirmed));
        let [best, second] = [order[0], order[1]].map(|it| self.held[it]);
        let is_certain = best.confirmed >= LEAST && best.share() >= MOST && second.confirmed <= SECOND * best.confirmed;
        is_certain.then_some(order[0])
    }

    /// The tracker that takes the projector to be `ahead`.
    pub fn into_tracker(mut self, ahead: usize) -> Tracker {
        self.trackers.swap_remove(ahead % FRAMES)
    }
}

#[cfg(test)]
mod tests {
    use super::super::detect::{DetectOptions, detect};
    use super::super::scene::Scene;
    use super::super::track::TrackOptions;
    use super::*;
    use crate::ImageView;

    /// What is decided after each of so many pictures, of which `shows` says what the projector shows and the caller says that they come in turn.
    fn decided(scene: &Scene, pictures: usize, shows: impl Fn(usize) -> usize) -> Vec<Option<usize>> {
        let mut turns = Turns::new(Tracker::new(scene.size[1], TrackOptions::default()).unwrap());
        let after = |picture: usize| {
            let pixels = scene.picture(picture, shows(picture));
            let view = ImageView::new(&pixels, scene.size[0], scene.size[1]).unwrap();
            turns.predict(1, &|_, _| [0.0; 2]);
            turns.update(&detect(&view, &DetectOptions::default()).unwrap(), picture % FRAMES);
            turns.decided()
        };
        (0..pictures).map(after).collect()
    }

    #[test]
    fn how_far_ahead_the_projector_is_is_found_and_never_found_otherwise() {
        for (seed, speed, nearer) in [(11, 0.0, 0.0), (12, 3.0, 0.0), (13, -6.0, 0.0), (14, 2.0, 0.6)] {
            let scene = Scene::new(speed, nearer, seed);
            for ahead in 0..FRAMES {
                let found = decided(&scene, 9, |it| (it + ahead) % FRAMES);
                assert!(found.iter().flatten().all(|it| *it == ahead), "seed {seed}, {ahead} ahead: {found:?}");
                assert_eq!(found.last(), Some(&Some(ahead)), "seed {seed}: {found:?}");
            }
        }
    }

    #[test]
    fn most_of_what_is_known_holds_where_things_move_fast() {
        for (seed, speed, nearer) in [(21, 6.0, 0.0), (22, -8.0, 0.0), (23, 4.0, 1.0), (24, -6.0, -0.8)] {
            let scene = Scene::new(speed, nearer, seed);
            let mut turns = Turns::new(Tracker::new(scene.size[1], TrackOptions::default()).unwrap());
            for picture in 0..16 {
                let pixels = scene.picture(picture, picture % FRAMES);
                let view = ImageView::new(&pixels, scene.size[0], scene.size[1]).unwrap();
                turns.predict(1, &|_, _| [0.0; 2]);
                turns.update(&detect(&view, &DetectOptions::default()).unwrap(), picture % FRAMES);
                let shares = turns.held().map(|it| it.share());
                assert!(picture < 6 || shares[0] > 0.6, "seed {seed}, picture {picture}: {shares:?}");
                assert!(picture < 6 || shares[1..].iter().all(|it| *it < 0.45), "seed {seed}, {picture}: {shares:?}");
            }
        }
    }

    #[test]
    fn pictures_in_another_order_or_of_no_code_are_none_of_the_four() {
        for seed in 15..18 {
            let scene = Scene::new(1.0, 0.0, seed);
            for ahead in 0..FRAMES {
                let backwards = decided(&scene, 16, |it| (2 * FRAMES * 16 - it + ahead) % FRAMES);
                assert!(backwards.iter().all(Option::is_none), "seed {seed}: {backwards:?}");
                let same = decided(&scene, 12, |_| ahead);
                assert!(same.iter().all(Option::is_none), "seed {seed}: {same:?}");
            }
            let exchanged = decided(&scene, 16, |it| [0, 2, 1, 3][it % FRAMES]);
            assert!(exchanged.iter().all(Option::is_none), "seed {seed}: {exchanged:?}");
        }
    }

    #[test]
    fn a_picture_that_was_dropped_at_the_start_only_delays_it() {
        let scene = Scene::new(1.0, 0.0, 18);
        let found = decided(&scene, 14, |it| if it < 2 { it } else { (it + 1) % FRAMES });
        assert!(found.iter().flatten().all(|it| *it == 1) && found.last() == Some(&Some(1)), "{found:?}");
    }
}
