//! What is shown and reported: the projector without its page's connection, in session time.

use std::collections::BTreeMap;

use foveate::node::page::{Client, PageEvent, PageNews};
use foveate::prelude::*;

use super::words::{FromPage, ToPage, When};
use super::{Advance, ProjectorSettings};

/// Remarks of one kind at most: the figures have them all.
const MOST_REMARKS: usize = 4;

/// What is to be done, in order.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Step {
    Say(Client, ToPage),
    Tell(PatternShown),
    Gap(Time, String),
}

/// Sets on their way to a page and back.
pub(super) struct Stage {
    settings: ProjectorSettings,
    projector: CameraId,
    names: Vec<String>,
    manifest: String,
    /// Windows, and whether each could show the patterns.
    windows: BTreeMap<Client, bool>,
    /// The one that does.
    active: Option<Client>,
    /// Number of the next set that is begun.
    next_set: u64,
    /// The set in progress, from its request on.
    set: u64,
    /// What is on the screen.
    current: Option<Current>,
    /// With `advance = "image"` or `"key"`, during a pause: when the next set begins.
    rests_until: Option<Time>,
    /// Whether the picture after the current one was requested.
    is_asked: bool,
    n_sets: u64,
    n_pictures: u64,
    n_broken: u64,
    n_slips: u64,
    worst_clock_ms: f64,
    last_unfit: Option<String>,
    last_seen: Option<Time>,
    remarks: Vec<String>,
}

/// A picture that the page shows.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Current {
    index: usize,
    /// From then on it was certainly there.
    from: Time,
    is_told: bool,
}

impl Stage {
    pub(super) fn new(settings: ProjectorSettings, projector: CameraId, names: Vec<String>, manifest: String) -> Stage {
        Stage {
            settings,
            projector,
            names,
            manifest,
            windows: BTreeMap::new(),
            active: None,
            next_set: 0,
            set: 0,
            current: None,
            rests_until: None,
            is_asked: false,
            n_sets: 0,
            n_pictures: 0,
            n_broken: 0,
            n_slips: 0,
            worst_clock_ms: f64::NAN,
            last_unfit: None,
            last_seen: None,
            remarks: Vec::new(),
        }
    }

    pub(super) fn count(&self) -> usize {
        self.names.len()
    }

    pub(super) fn clients(&self) -> impl Iterator<Item = Client> + '_ {
        self.windows.keys().copied()
    }

    /// Whether all sets were shown to the end.
    pub(super) fn is_done(&self) -> bool {
        self.settings.sets > 0 && self.n_sets >= self.settings.sets && self.current.is_none()
    }

    /// When it has something to do though nothing happens on the page.
    pub(super) fn looks_again(&self, now: Time, step: Interval) -> Option<Time> {
        let waits = self.settings.advance == Advance::Image && self.current.is_some() && !self.is_asked;
        self.rests_until.or_else(|| waits.then(|| now + step))
    }

    /// Something happened on a page; `session_from_host` carries the server's clock to the session's [ns].
    pub(super) fn hear(&mut self, now: Time, session_from_host: i64, event: PageEvent, steps: &mut Vec<Step>) {
        let client = event.client;
        match event.what {
            PageNews::Opened => {
                self.windows.insert(client, false);
            }
            PageNews::Closed(why) => {
                self.windows.remove(&client);
                if self.active == Some(client) {
                    self.give_up(now, &format!("the page was closed ({why})"), steps);
                    self.begin(steps);
                }
            }
            PageNews::Text(text) => match FromPage::read(&text) {
                Ok(message) => self.take(now, session_from_host, client, message, steps),
                Err(fault) => self.remark(format!("the page sent an invalid message: {fault}")),
            },
        }
    }

    fn take(&mut self, now: Time, session_from_host: i64, client: Client, message: FromPage, steps: &mut Vec<Step>) {
        let Some(is_ready) = self.windows.get_mut(&client) else { return };
        let is_active = self.active == Some(client);
        match message {
            FromPage::Ready(_) => {
                *is_ready = true;
                self.last_unfit = None;
                match self.active {
                    // It was ready before: it has begun anew by itself.
                    Some(active) if active == client => {
                        self.give_up(now, "the page was reloaded", steps);
                        self.begin(steps);
                    }
                    Some(_) => {
                        let words = "Another window shows the patterns; this one takes over when that is closed.";
                        steps.push(Step::Say(client, ToPage::Wait(words.to_owned())));
                    }
                    None => self.begin(steps),
                }
            }
            FromPage::Unfit(why) => {
                *is_ready = false;
                self.last_unfit = Some(why.clone());
                if is_active {
                    self.give_up(now, &format!("the page cannot show the patterns any more: {why}"), steps);
                    self.begin(steps);
                }
            }
            FromPage::Shown { set, index, when } if is_active => {
                self.shown(now, session_from_host, set, index, when, steps);
            }
            FromPage::Black(when) if is_active => {
                let (at, sigma) = on_session_clock(when, session_from_host);
                self.end_current(at - sigma, steps);
                self.is_asked = false;
                self.set = self.next_set;
                if self.settings.advance != Advance::Rate && !self.is_done() {
                    self.rests_until = Some(now + Interval::from_s(self.settings.pause_s));
                }
            }
            FromPage::Key(_) if is_active && self.settings.advance == Advance::Key => {
                if self.current.is_some() && !self.is_asked {
                    self.ask_next(steps);
                }
            }
            // What was on its way when the window was given up.
            FromPage::Shown { .. } | FromPage::Black(_) | FromPage::Key(_) => {}
        }
    }

    /// A picture came onto the screen.
    fn shown(&mut self, now: Time, offset: i64, set: u64, index: usize, when: When, steps: &mut Vec<Step>) {
        let (at, sigma) = on_session_clock(when, offset);
        if set < self.set {
            return; // of a set that was given up
        }
        let is_last = |it: &Current| it.index + 1 == self.names.len();
        let expected = match &self.current {
            None => (self.set, 0),
            Some(it) if is_last(it) => (self.set + 1, 0),
            Some(it) => (self.set, it.index + 1),
        };
        if (set, index) != expected {
            let (set_expected, index_expected) = expected;
            let why = format!(
                "the page showed picture {index} of set {set}, expected picture {index_expected} of set {set_expected}"
            );
            self.give_up(now, &why, steps);
            self.begin(steps);
            return;
        }
        self.end_current(at - sigma, steps);
        self.set = set;
        self.next_set = self.next_set.max(set + 1);
        self.n_pictures += 1;
        self.is_asked = false;
        self.worst_clock_ms = self.worst_clock_ms.max(when.sigma_ms);
        if when.slip_ms > 0.0 {
            self.n_slips += 1;
            let (ms, name) = (when.slip_ms, &self.names[index]);
            self.remark(format!(
                "set {set}: the page dropped frames at `{name}`: it may have been shown {ms:.0} ms late"
            ));
        }
        let from = at + sigma + Interval::from_ms(when.slip_ms);
        let is_told = self.settings.advance == Advance::Rate;
        if is_told {
            // The page shows the next one in the frame that is nearest to its time; where two are as near, in the earlier one.
            let frames = (1e3 / self.settings.rate_hz / when.refresh_ms - 0.51).ceil().max(1.0);
            self.tell(index, from, at + Interval::from_ms(frames * when.refresh_ms) - sigma, steps);
        }
        self.current = Some(Current { index, from, is_told });
    }

    /// What is on the screen gives way to something else, `until` which it was certainly there.
    fn end_current(&mut self, until: Time, steps: &mut Vec<Step>) {
        let Some(current) = self.current.take() else { return };
        if !current.is_told {
            self.tell(current.index, current.from, until, steps);
        }
        self.n_sets += u64::from(current.index + 1 == self.names.len());
    }

    fn tell(&self, index: usize, from: Time, until: Time, steps: &mut Vec<Step>) {
        let (set, name, lasts) = (self.set, self.names[index].clone(), until - from);
        if lasts <= Interval(0) {
            let why = format!(
                "set {set}: `{name}` was at no time certainly shown: the page drops frames, or `rate_hz` is too high"
            );
            steps.push(Step::Gap(from, why));
            return;
        }
        let [index, count] = [index, self.names.len()].map(|it| it as u32);
        let (projector, manifest) = (self.projector, self.manifest.clone());
        steps.push(Step::Tell(PatternShown { projector, set, index, count, name, from, lasts, manifest }));
    }

    /// Goes on where that depends on time or on the camera, of which the newest picture is of the time `seen`.
    pub(super) fn go_on(&mut self, now: Time, seen: Option<Time>, steps: &mut Vec<Step>) {
        self.last_seen = seen.or(self.last_seen);
        if self.rests_until.is_some_and(|it| now >= it) {
            self.begin(steps);
        }
        if self.settings.advance != Advance::Image || self.is_asked {
            return;
        }
        let (Some(current), Some(seen)) = (self.current, seen) else { return };
        let (half, latency) =
            (Interval::from_ms(self.settings.exposure_ms / 2.0), Interval::from_ms(self.settings.latency_ms));
        if seen - half < current.from + latency {
            return;
        }
        // The time that is told ends with this exposure: of what comes after it nobody knows which picture it shows. A microsecond for rounding.
        self.tell(current.index, current.from, seen + half - latency + Interval(1000), steps);
        self.current = Some(Current { is_told: true, ..current });
        self.ask_next(steps);
    }

    /// Asks for the picture after the current one.
    fn ask_next(&mut self, steps: &mut Vec<Step>) {
        let (Some(client), Some(current)) = (self.active, self.current) else { return };
        self.is_asked = true;
        let message = if current.index + 1 < self.names.len() {
            ToPage::Show { set: self.set, index: current.index + 1 }
        } else if self.has_more() && self.settings.pause_s == 0.0 {
            ToPage::Show { set: self.set + 1, index: 0 }
        } else {
            ToPage::Rest(true)
        };
        steps.push(Step::Say(client, message));
    }

    /// Whether sets are to follow the one that is being shown.
    fn has_more(&self) -> bool {
        self.settings.sets == 0 || self.n_sets + 1 < self.settings.sets
    }

    /// Begins a set in the first window that can show it.
    fn begin(&mut self, steps: &mut Vec<Step>) {
        self.active = self.active.filter(|it| self.windows.get(it) == Some(&true));
        self.active = self.active.or_else(|| self.windows.iter().find(|it| *it.1).map(|it| *it.0));
        let Some(client) = self.active else { return };
        if self.is_done() {
            return;
        }
        self.set = self.next_set;
        self.next_set += 1;
        (self.current, self.is_asked, self.rests_until) = (None, false, None);
        let message = match self.settings.advance {
            Advance::Rate => ToPage::Play {
                set: self.set,
                sets: self.settings.sets.saturating_sub(self.n_sets),
                hold_ms: 1e3 / self.settings.rate_hz,
                pause_ms: self.settings.pause_s * 1e3,
            },
            Advance::Image | Advance::Key => ToPage::Show { set: self.set, index: 0 },
        };
        steps.push(Step::Say(client, message));
    }

    /// The active window cannot go on: the set that it shows is given up.
    fn give_up(&mut self, now: Time, why: &str, steps: &mut Vec<Step>) {
        if self.active.is_none() {
            return;
        }
        self.active = None;
        if let Some(current) = self.current.take() {
            self.n_broken += 1;
            let (set, n, all) = (self.set, current.index + 1, self.names.len());
            let words = format!("set {set}: {why} at picture {n} of {all}; the next set begins when a page is ready");
            steps.push(Step::Gap(now, words.clone()));
            self.remark(words);
        }
        (self.is_asked, self.rests_until) = (false, None);
        self.next_set = self.next_set.max(self.set + 1);
    }

    fn remark(&mut self, words: String) {
        if self.remarks.len() < MOST_REMARKS {
            self.remarks.push(words);
        }
    }

    /// The figures of the projector called `name`; without the `address` of a page nothing could be shown.
    pub(super) fn report(&self, name: &str, address: Option<&str>, report: &mut Report) {
        report.figure(format!("projector.sets.{name}"), self.n_sets as f64);
        report.figure(format!("projector.pictures.{name}"), self.n_pictures as f64);
        report.figure(format!("projector.sets_broken.{name}"), self.n_broken as f64);
        report.figure(format!("projector.frames_dropped.{name}"), self.n_slips as f64);
        report.figure(format!("projector.clock_ms.max.{name}"), self.worst_clock_ms);
        self.remarks.iter().for_each(|it| report.remark(format!("{name}: {it}")));
        let Some(address) = address else {
            report.remark(format!("{name}: no pattern was shown: this run serves no pages; use `foveate run`"));
            return;
        };
        if self.n_pictures == 0 {
            let why = match &self.last_unfit {
                Some(why) => format!("the page reported: {why}"),
                None if self.windows.is_empty() => "no browser had the page open at the end".to_owned(),
                None => "the page was never ready".to_owned(),
            };
            report.remark(format!("{name}: no pattern was shown at {address}: {why}"));
        }
        let waits = self.settings.advance == Advance::Image && !self.is_asked;
        if let Some(current) = self.current.filter(|_| waits) {
            let seen = self.last_seen.map_or("none arrived".to_owned(), |it| format!("the last one was from {it}"));
            let (picture, from) = (&self.names[current.index], current.from);
            report.remark(format!("{name}: `{picture}`, shown at {from}, waited for a picture at `image`: {seen}"));
        }
    }
}

/// The frame that a page reported, in session time, and by how much it may be off.
fn on_session_clock(when: When, session_from_host: i64) -> (Time, Interval) {
    (Time(Interval::from_ms(when.at).0 + session_from_host), Interval::from_ms(when.sigma_ms))
}
