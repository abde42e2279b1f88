//! Adds a picture to the tracks, and determines which of the four patterns it shows where that is not certain.
//!
//! The pattern stated by the projector or by a recording's `first_shows` is verified by the boundaries it gives, at the start, after each gap, and where known boundaries contradict their neighbours.

use foveate::imaging::stripes::boundary::{Agreement, Edges, FRAMES, Held, Line, Shows, Turns, lines};
use foveate::prelude::*;

use super::{Boundaries, MOST_OTHERS};

/// Tracking restarts when neighbours confirm less than this part of the known boundaries of the last pictures. Measured
/// on rendered recordings: 0.74 or more with the right pictures, 0.37 at most with pictures taken for others than they
/// are [–] …
const LEAST_HELD: f32 = 0.45;
/// … of which so many are needed before they say anything.
const LEAST_KNOWN: f32 = 400.0;
/// The same of one picture alone, whose map is not given otherwise [–] …
const LEAST_HELD_IN_ONE: f32 = 0.6;
/// … of so many that are known at least.
const LEAST_IN_ONE: f32 = 20.0;
/// Pictures one after the other that are none of the four, beyond which tracks are lost.
const MOST_UNCLEAR: u32 = 1;
/// Each of the four patterns has to be seen again before so many pictures have passed: twice the code.
const MOST_UNSEEN: u64 = 2 * FRAMES as u64;

/// The caller's prediction: how far the point at (x, y) moves from the picture before, in columns and rows [px].
pub(super) type Foretold<'a> = &'a (dyn Fn(f32, f32) -> [f32; 2] + Sync);

/// What came of a picture.
pub(super) struct Followed {
    /// Boundaries of the picture before it, by row; `None` while it is open which pattern is shown.
    pub lines: Option<Vec<Vec<Line>>>,
    /// How far stripes moved in common beyond what the head's pose says [px].
    pub off: f32,
}

impl Boundaries {
    /// Forgets all tracks, and which pattern is shown.
    pub(super) fn begin_anew(&mut self) {
        self.tracker.reset();
        self.turns = Some(Turns::new(self.tracker.clone()));
        self.held = Held::default();
        (self.others, self.unclear) = (0, 0);
        self.shown_last = [self.taken; FRAMES];
    }

    /// Tracks the edges of a picture of which pattern `said` is said to be shown; `by` is how many pictures after the one before and the prediction, `None` without one.
    pub(super) fn follow(
        &mut self,
        edges: &Edges,
        said: usize,
        by: Option<(u32, Foretold<'_>)>,
        time: Time,
    ) -> Followed {
        if by.is_none() {
            self.begin_anew();
        }
        // What a camera that does not turn sees moves by nothing in common.
        let (expected, has_pose) = ((said + self.ahead) % FRAMES, self.has_pose);
        if let Some(mut turns) = self.turns.take() {
            turns.set_pitch(self.tracker.options().pitch);
            let mut off = [0.0; FRAMES];
            if let Some((pictures, predicted)) = by {
                turns.predict(pictures, predicted);
                if has_pose {
                    off = turns.align(edges, expected);
                }
            }
            turns.update(edges, expected);
            let Some(ahead) = turns.decided() else {
                self.turns = Some(turns);
                return Followed { lines: None, off: 0.0 };
            };
            self.held = turns.held()[ahead];
            if !self.take_for(said, ahead, time) {
                self.turns = Some(turns);
                return Followed { lines: None, off: 0.0 };
            }
            self.tracker = turns.into_tracker(ahead);
            return Followed { lines: Some(lines(&self.tracker)), off: off[ahead] };
        }
        let mut off = 0.0;
        if let Some((pictures, predicted)) = by {
            self.tracker.predict(pictures, predicted);
            if has_pose {
                off = self.tracker.align(edges, expected);
            }
        }
        let agreement = self.tracker.agreement(edges);
        let shows = agreement.shows(expected);
        let Some(shown) = shows.picture(expected) else {
            return self.lose_track(edges, expected, &agreement, time, off);
        };
        // What is between two pictures says nothing of one that was passed over.
        let was_unclear = std::mem::take(&mut self.unclear) > 0;
        self.note_other(shows, expected, time);
        self.tracker.update(edges, shown);
        self.taken += 1;
        self.shown_last[shown] = self.taken;
        let lines = lines(&self.tracker);
        let one = Held::of(&self.tracker, &lines);
        self.held.take(one);
        if self.held.known >= LEAST_KNOWN && self.held.share() < LEAST_HELD {
            let fault = format!(
                "{:.0} % of the known boundaries are confirmed by their neighbours, expected at least {:.0} %: the pictures show other patterns than stated, or the surface moves too fast; tracking restarts",
                100.0 * self.held.share(),
                100.0 * LEAST_HELD
            );
            self.note("doubt", time, &fault);
            self.begin_with(edges, expected);
            return Followed { lines: None, off };
        }
        Followed { lines: (self.borne_out(one, time) && !was_unclear).then_some(lines), off }
    }

    /// Forgets all tracks, and begins with a picture.
    fn begin_with(&mut self, edges: &Edges, expected: usize) {
        self.begin_anew();
        if let Some(turns) = &mut self.turns {
            turns.update(edges, expected);
        }
    }

    /// A picture that is none of the four for the boundaries that are known: it is skipped, and where the next one is no better, tracking restarts with that.
    fn lose_track(&mut self, edges: &Edges, expected: usize, agreement: &Agreement, time: Time, off: f32) -> Followed {
        let most = agreement.fits.iter().max().copied().unwrap_or(0);
        let fault = format!(
            "{most} of {} known boundaries fit the best of the four patterns, expected most: the surface has jumped, moves too fast, or the light has changed",
            agreement.n
        );
        self.note("unclear", time, &fault);
        self.unclear += 1;
        if self.unclear > MOST_UNCLEAR {
            self.begin_with(edges, expected);
        }
        Followed { lines: None, off }
    }

    /// Notes that another pattern is shown than requested; after some in a row pictures are taken to be so many ahead.
    fn note_other(&mut self, shows: Shows, expected: usize, time: Time) {
        let Shows::Instead(instead) = shows else {
            self.others = 0;
            return;
        };
        let fault = match &self.recorded {
            Some(_) => format!(
                "the picture shows pattern {instead} of the code, expected pattern {expected} after those before: the projector dropped a frame, or one is missing in the recording"
            ),
            None => format!(
                "the projector shows picture {instead} of the code, expected picture {expected} as requested: it dropped a frame, or `latency_ms` is wrong"
            ),
        };
        self.note("dropped", time, &fault);
        self.others += 1;
        if self.others > MOST_OTHERS {
            self.ahead = (self.ahead + instead + FRAMES - expected) % FRAMES;
            self.others = 0;
        }
    }

    /// Whether what is known of a picture may be given: its neighbours confirm most of it, and each of the four patterns was seen recently.
    fn borne_out(&mut self, one: Held, time: Time) -> bool {
        if one.known >= LEAST_IN_ONE && one.share() < LEAST_HELD_IN_ONE {
            let fault = format!(
                "{:.0} % of the known boundaries in a picture are confirmed by their neighbours, expected at least {:.0} %: the others are unreliable too",
                100.0 * one.share(),
                100.0 * LEAST_HELD_IN_ONE
            );
            self.note("picture", time, &fault);
            return false;
        }
        let (stale, last) = self.shown_last.iter().enumerate().min_by_key(|it| it.1).map_or((0, 0), |it| (it.0, *it.1));
        let unseen = self.taken - last;
        if unseen >= MOST_UNSEEN {
            let fault = format!(
                "pattern {stale} has not been seen for {unseen} pictures, expected each of the four in turn: boundaries cannot be verified without it. Does the projector show all four, and does the camera take each?"
            );
            self.note("stale", time, &fault);
            return false;
        }
        true
    }

    /// Goes on with pictures that are `ahead` of what was taken for said; false where a rig states another first picture.
    fn take_for(&mut self, said: usize, ahead: usize, time: Time) -> bool {
        if self.wrong_first.is_some() {
            return false;
        }
        let (expected, shown) = ((said + self.ahead) % FRAMES, (said + self.ahead + ahead) % FRAMES);
        let is_first = !std::mem::replace(&mut self.is_decided, true);
        match (self.settings.first_shows.filter(|_| self.recorded.is_some()), ahead) {
            (_, 0) => {}
            (Some(first), _) if is_first => {
                self.wrong_first = Some((first, (first + ahead as u32) % FRAMES as u32));
            }
            // The rig does not state what the first picture shows.
            (None, _) if is_first && self.recorded.is_some() => {}
            _ => {
                let why = if self.recorded.is_some() {
                    "are pictures missing in the recording?"
                } else {
                    "is `latency_ms` right?"
                };
                let fault = format!(
                    "found pictures that show pattern {shown} of the code, expected pattern {expected} as stated: {why} From here on the patterns that they show are used"
                );
                self.note("turn", time, &fault);
            }
        }
        if self.wrong_first.is_none() {
            self.ahead = (self.ahead + ahead) % FRAMES;
        }
        self.wrong_first.is_none()
    }

    /// Says why nothing came of the pictures, where it is not certain which of the patterns the first one shows.
    pub(super) fn remark_on_start(&self, report: &mut Report) {
        let name = &self.camera_name;
        if let Some((stated, found)) = self.wrong_first {
            report.remark(format!(
                "{name}: the first picture of the recording shows pattern {found} of the code, expected pattern {stated} as `first_shows` states: no map is made. Set `first_shows = {found}`, or leave it out"
            ));
        } else if self.recorded.is_some() && self.frames == 0 && (1..FRAMES as u64).contains(&self.empty) {
            report.remark(format!(
                "{name}: found {} pictures in the recording, expected at least {}: with fewer, the pattern of the first one cannot be determined",
                // Each is judged when the next one is there.
                self.empty + 1,
                FRAMES + 1
            ));
        } else if self.recorded.is_some() && self.frames == 0 && self.empty > 0 && self.unknown_period == 0 {
            report.remark(format!(
                "{name}: no picture of the recording gave a map: for each of the four patterns as the first, too few boundaries follow one another. Do the pictures show the four patterns in turn, in the order of `foveate patterns`, and are their stripes those of `stripes`?"
            ));
        }
        if self.lit_from.is_none() && self.unlit > 0 {
            report.remark(format!(
                "{name}: found {} pictures and no pattern, expected a projector that reports what it shows: is it running?",
                self.unlit
            ));
        }
    }
}
