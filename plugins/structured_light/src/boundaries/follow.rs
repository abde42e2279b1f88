//! Takes a picture up into the tracks, and finds which of the four patterns it shows where that is not certain.
//!
//! What a projector was told or a recording's `first_shows` says has to be borne out by what boundaries come of it, at the start, after each gap, and where boundaries that are known contradict their neighbours.

use foveate::imaging::stripes::boundary::{Agreement, Edges, FRAMES, Held, Line, Shows, Turns, lines};
use foveate::prelude::*;

use super::{Boundaries, MOST_OTHERS};

/// A projector or a recording goes on as before as long as this part of the known boundaries of the last pictures holds against their neighbours: of rendered recordings 0.74 and more do, and 0.37 at most of pictures taken for
/// others than they are [–] …
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

/// What the caller foretells: how far what is at (x, y) moves from the picture before, in columns and rows [px].
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

    /// Tracks the edges of a picture of which pattern `said` is said to be shown; `by` is how many pictures after the one before and what is foretold, `None` without one.
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
        let (told, has_pose) = ((said + self.ahead) % FRAMES, self.has_pose);
        if let Some(mut turns) = self.turns.take() {
            turns.set_pitch(self.tracker.options().pitch);
            let mut off = [0.0; FRAMES];
            if let Some((pictures, foretold)) = by {
                turns.predict(pictures, foretold);
                if has_pose {
                    off = turns.align(edges, told);
                }
            }
            turns.update(edges, told);
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
        if let Some((pictures, foretold)) = by {
            self.tracker.predict(pictures, foretold);
            if has_pose {
                off = self.tracker.align(edges, told);
            }
        }
        let agreement = self.tracker.agreement(edges);
        let shows = agreement.shows(told);
        let Some(shown) = shows.picture(told) else { return self.lose_track(edges, told, &agreement, time, off) };
        // What is between two pictures says nothing of one that was passed over.
        let was_unclear = std::mem::take(&mut self.unclear) > 0;
        self.note_other(shows, told, time);
        self.tracker.update(edges, shown);
        self.taken += 1;
        self.shown_last[shown] = self.taken;
        let lines = lines(&self.tracker);
        let one = Held::of(&self.tracker, &lines);
        self.held.take(one);
        if self.held.known >= LEAST_KNOWN && self.held.share() < LEAST_HELD {
            let fault = format!(
                "found {:.0} % of the boundaries that are known confirmed by their neighbours, expected {:.0} % at least: pictures are other ones than is said, or move too fast; begins anew",
                100.0 * self.held.share(),
                100.0 * LEAST_HELD
            );
            self.note("doubt", time, &fault);
            self.begin_with(edges, told);
            return Followed { lines: None, off };
        }
        Followed { lines: (self.borne_out(one, time) && !was_unclear).then_some(lines), off }
    }

    /// Forgets all tracks, and begins with a picture.
    fn begin_with(&mut self, edges: &Edges, told: usize) {
        self.begin_anew();
        if let Some(turns) = &mut self.turns {
            turns.update(edges, told);
        }
    }

    /// A picture that is none of the four for the boundaries that are known: it is passed over, and where the next one is no better, all begins anew with that.
    fn lose_track(&mut self, edges: &Edges, told: usize, agreement: &Agreement, time: Time, off: f32) -> Followed {
        let most = agreement.fits.iter().max().copied().unwrap_or(0);
        let fault = format!(
            "{most} of {} boundaries that are known fit the pattern that suits them best, expected most, and few any other: what the camera sees has jumped, moves too fast, or is in another light",
            agreement.n
        );
        self.note("unclear", time, &fault);
        self.unclear += 1;
        if self.unclear > MOST_UNCLEAR {
            self.begin_with(edges, told);
        }
        Followed { lines: None, off }
    }

    /// Notes that another pattern is shown than was told; after some in a row pictures are taken to be so many ahead.
    fn note_other(&mut self, shows: Shows, told: usize, time: Time) {
        let Shows::Instead(instead) = shows else {
            self.others = 0;
            return;
        };
        let fault = match &self.recorded {
            Some(_) => format!(
                "the picture shows pattern {instead} of the code, expected pattern {told} after those before: a frame was dropped by the projector, or lacks in the recording"
            ),
            None => format!(
                "the projector shows picture {instead} of the code, expected picture {told} as it was told: it dropped a frame, or `latency_ms` is wrong"
            ),
        };
        self.note("dropped", time, &fault);
        self.others += 1;
        if self.others > MOST_OTHERS {
            self.ahead = (self.ahead + instead + FRAMES - told) % FRAMES;
            self.others = 0;
        }
    }

    /// Whether what is known of a picture may be given: most of it holds against its neighbours, and each of the four patterns had its say of late.
    fn borne_out(&mut self, one: Held, time: Time) -> bool {
        if one.known >= LEAST_IN_ONE && one.share() < LEAST_HELD_IN_ONE {
            let fault = format!(
                "found {:.0} % of the boundaries that are known in a picture confirmed by their neighbours, expected {:.0} % at least: the others are as doubtful",
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
                "pattern {stale} has not been seen for {unseen} pictures, expected each of the four in turn: boundaries are not borne out without it. Does the projector show all four, and the camera take each?"
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
        let (told, shown) = ((said + self.ahead) % FRAMES, (said + self.ahead + ahead) % FRAMES);
        let is_first = !std::mem::replace(&mut self.is_decided, true);
        match (self.settings.first_shows.filter(|_| self.recorded.is_some()), ahead) {
            (_, 0) => {}
            (Some(first), _) if is_first => {
                self.wrong_first = Some((first, (first + ahead as u32) % FRAMES as u32));
            }
            // Nobody said what the first picture shows.
            (None, _) if is_first && self.recorded.is_some() => {}
            _ => {
                let why = if self.recorded.is_some() {
                    "do pictures lack in the recording?"
                } else {
                    "is `latency_ms` right?"
                };
                let fault = format!(
                    "found pictures that show pattern {shown} of the code, expected pattern {told} as was said: {why} From here on they are taken for what they show"
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
                "{name}: the first picture of the recording shows pattern {found} of the code, and not pattern {stated} as `first_shows` says: no map is made. Set `first_shows = {found}`, or leave it out"
            ));
        } else if self.recorded.is_some() && self.frames == 0 && (1..FRAMES as u64).contains(&self.empty) {
            report.remark(format!(
                "{name}: found {} pictures in the recording, expected {} at least: before that it is open which of the four patterns the first one shows",
                // Each is judged when the next one is there.
                self.empty + 1,
                FRAMES + 1
            ));
        } else if self.recorded.is_some() && self.frames == 0 && self.empty > 0 && self.unknown_period == 0 {
            report.remark(format!(
                "{name}: no picture of the recording gave a map: whichever of the four patterns the first one shows, too few boundaries follow one another. Do pictures show the four patterns in turn, in the order of `foveate patterns`, and do their stripes go as `stripes` says?"
            ));
        }
        if self.lit_from.is_none() && self.unlit > 0 {
            report.remark(format!(
                "{name}: found {} pictures and no pattern, expected a projector that says what it shows: does it run?",
                self.unlit
            ));
        }
    }
}
