//! Users of pointers from colours and blink codes, and corrections of ID switches.
//!
//! A pointer has a user once its colour or its decoder is certain, and keeps it until it ends or another one becomes certain. Decoders restart when merged spots separate. What is decided
//! then may show that two tracks have exchanged their lights: their identities are exchanged back. A pointer that may have become another light, since it
//! was dark or its spot was merged with another's, and is another user's now, without a counterpart, gets a new identity. A continuously seen pointer is the same light: what was
//! decided before was wrong, and it keeps its identity with the other user.
//!
//! One user has one pointer. A second pointer with the same code, or of the same colour, gets no user, and is counted.

use std::collections::BTreeMap;

use foveate::prelude::*;

use super::codes::{Codes, Verdict};
use super::colours::Colours;
use super::pointers::Track;
use super::settings::TrackerSettings;

/// Consecutive spots with the same label that are needed before a pointer's user is decided again: where it may have become another light, and where it was seen continuously.
const RUN_AFTER_DOUBT: u32 = 4;
const RUN_IN_SIGHT: u32 = 12;
/// Width of the histogram of unknown periods [ms].
const PERIOD_STEP_MS: f64 = 10.0;

/// Counts of decisions over all frames.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct UserTally {
    /// Pointers that got a user.
    pub decided: u64,
    /// ID switches that were corrected.
    pub mended: u64,
    /// Times that a pointer became another user's and got a new identity.
    pub changed: u64,
    /// Continuously seen pointers whose user was corrected.
    pub corrected: u64,
    /// Pointers that were dark in a period of no user, by that period to 10 ms [ms].
    pub unknown: BTreeMap<u32, u64>,
    /// By user: pointers that had the user's code or colour while another one had it.
    pub shared: BTreeMap<u32, u64>,
}

/// Decides the users of tracks.
pub(super) struct UsersOfTracks {
    codes: Option<Codes>,
    colours: Option<Colours>,
    tally: UserTally,
    exchanged: Vec<Exchange>,
}

impl UsersOfTracks {
    /// `None` where users have neither codes nor colours.
    pub fn new(settings: &TrackerSettings) -> Option<UsersOfTracks> {
        let (codes, colours) = (Codes::new(settings), Colours::new(settings));
        let tells = codes.is_some() || colours.is_some();
        tells.then(|| UsersOfTracks { codes, colours, tally: UserTally::default(), exchanged: Vec::new() })
    }

    pub fn codes(&self) -> Option<&Codes> {
        self.codes.as_ref()
    }

    pub fn colours(&self) -> Option<&Colours> {
        self.colours.as_ref()
    }

    /// The user of a track, by its code and its colour.
    fn verdict(&self, track: &Track) -> Verdict {
        let by_code = match (&self.codes, &track.decoder) {
            (Some(codes), Some(decoder)) => codes.verdict(decoder),
            _ => Verdict::Undecided,
        };
        let colour = self.colours.as_ref().zip(track.belief.as_ref()).and_then(|(colours, it)| colours.users(it));
        match (colour.as_deref(), by_code) {
            (Some([user]), _) => Verdict::User(*user),
            // Of several with one colour the code tells which.
            (Some(users), Verdict::User(user)) if !users.is_empty() && !users.contains(&user) => Verdict::Undecided,
            (_, by_code) => by_code,
        }
    }

    pub fn tally(&self) -> &UserTally {
        &self.tally
    }

    /// Applies all certain decisions after a frame; `next` is the next identity.
    pub fn decide(&mut self, tracks: &mut [Track], next: &mut u32, time: Time) {
        let verdict = |it: &Track| if it.id.is_some() { self.verdict(it) } else { Verdict::Undecided };
        let verdicts: Vec<Verdict> = tracks.iter().map(verdict).collect();
        self.exchange(tracks, &verdicts, time);
        for row in 0..tracks.len() {
            // What is not seen any more has no code.
            if !tracks[row].is_measured {
                continue;
            }
            match verdicts[row] {
                Verdict::User(user) => self.give(tracks, &verdicts, row, user, next),
                Verdict::Other(period) if !tracks[row].is_counted => {
                    tracks[row].is_counted = true;
                    let step = (period * 1e3 / PERIOD_STEP_MS).round() * PERIOD_STEP_MS;
                    *self.tally.unknown.entry(step as u32).or_default() += 1;
                }
                _ => {}
            }
        }
    }

    /// Exchanges the identities of tracks that have each other's light.
    fn exchange(&mut self, tracks: &mut [Track], verdicts: &[Verdict], time: Time) {
        for one in 0..tracks.len() {
            let (Verdict::User(found), Some(user)) = (verdicts[one], tracks[one].user) else { continue };
            // Another track has this one's user by its light, and had the other's, or none; either may have become another light.
            let may_be = |it: usize| tracks[it].mixed.is_some() && tracks[it].run() >= RUN_AFTER_DOUBT;
            let is_partner = |it: &usize| {
                let before = tracks[*it].user;
                verdicts[*it] == Verdict::User(user) && (before == Some(found) || before.is_none()) && may_be(*it)
            };
            if !may_be(one) {
                continue;
            }
            let Some(other) = (0..tracks.len()).filter(|it| *it != one && found != user).find(is_partner) else {
                continue;
            };
            let (Some(first), Some(second)) = (tracks[one].id, tracks[other].id) else { continue };
            let since = tracks[one].mixed.min(tracks[other].mixed).or(tracks[one].mixed).or(tracks[other].mixed);
            (tracks[one].id, tracks[other].id) = (Some(second), Some(first));
            self.tally.decided += u64::from(tracks[other].user.is_none());
            (tracks[one].user, tracks[other].user) = (Some(found), Some(user));
            (tracks[one].mixed, tracks[other].mixed) = (None, None);
            self.exchanged.push(Exchange { ids: [first, second], since: since.unwrap_or(time) });
            self.tally.mended += 1;
        }
    }

    /// Gives `user` to track `row`, whose decoder is certain.
    fn give(&mut self, tracks: &mut [Track], verdicts: &[Verdict], row: usize, user: u32, next: &mut u32) {
        if tracks[row].user == Some(user) {
            if tracks[row].run() >= RUN_AFTER_DOUBT {
                (tracks[row].mixed, tracks[row].dark) = (None, false);
            }
            return;
        }
        let others = || (0..tracks.len()).filter(|it| *it != row);
        if let Some(holder) = others().find(|it| tracks[*it].user == Some(user)) {
            let track = &mut tracks[row];
            if verdicts[holder] == Verdict::User(user) && !track.is_counted {
                track.is_counted = true;
                *self.tally.shared.entry(user).or_default() += 1;
            }
            return;
        }
        if tracks[row].user.is_some() {
            let may_be_another = tracks[row].mixed.is_some() || tracks[row].dark;
            if tracks[row].run() < if may_be_another { RUN_AFTER_DOUBT } else { RUN_IN_SIGHT } {
                return;
            }
            // The other one of the two that were mixed has yet to say whose it is.
            if tracks[row].mixed.is_some() && others().any(|it| tracks[it].id.is_some() && tracks[it].mixed.is_some()) {
                return;
            }
            if may_be_another {
                tracks[row].id = Some(TargetId(*next));
                *next += 1;
                self.tally.changed += 1;
            } else {
                self.tally.corrected += 1;
            }
        }
        self.tally.decided += 1;
        (tracks[row].user, tracks[row].mixed, tracks[row].dark) = (Some(user), None, false);
    }

    /// The users after the frame at `time`; each exchange is reported once.
    pub fn report(&mut self, time: Time, tracks: &[Track]) -> Users {
        let mut list: Vec<TargetUser> =
            tracks.iter().filter_map(|it| Some(TargetUser { id: it.id?, user: it.user? })).collect();
        list.sort_by_key(|it| it.id);
        Users { time, list, exchanged: std::mem::take(&mut self.exchanged) }
    }
}
