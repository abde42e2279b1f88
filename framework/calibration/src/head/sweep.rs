//! Drives a head over settings, goes on when enough was seen at each, and says where the light is needed.
//!
//! The paper's settings [Davis 2002 §4.2] are pan alone and tilt alone; with those a tilt axis that stands still and one that is carried look
//! the same, so that settings with both follow.

use std::fmt;

use nalgebra::Point2;

/// Rows and columns into which the picture is divided.
const CELLS: usize = 3;
/// A head that has not arrived after this is not waited for [s].
const LONGEST_WAY_S: f64 = 15.0;

/// Options of [`Sweep`]: the settings, and how much must be seen at each.
#[derive(Debug, Clone, PartialEq)]
pub struct SweepOptions {
    /// Settings in their order: pan and tilt [rad].
    pub settings: Vec<[f64; 2]>,
    /// The head is at a setting when it reports a position this close [rad].
    pub tolerance: f64,
    /// How long after it stopped what it carries still swings [s].
    pub settle_s: f64,
    /// The light counts again when it moved by this much in the picture [px].
    pub step_px: f64,
    /// So many observations are enough at a setting … [–]
    pub observations: u32,
    /// … when they lie in so many ninths of the picture [–].
    pub cells: u32,
    /// After this time it goes on with what there is [s].
    pub longest_s: f64,
    /// Columns and rows of the picture [px].
    pub image_size: [u32; 2],
}

/// The command to the head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum SweepOrder {
    /// Go to this setting; repeated from time to time until it arrives [rad].
    Go([f64; 2]),
    /// Stay, the light is being seen.
    Stay,
    /// All settings were visited.
    Done,
}

/// The observations at one setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Seen {
    /// Whether the head got there.
    pub reached: bool,
    /// Observations of the light that count.
    pub observations: u32,
    /// By ninth of the picture, row by row.
    pub cells: [u32; CELLS * CELLS],
}

/// A head on its way over settings.
#[derive(Debug, Clone)]
pub struct Sweep {
    options: SweepOptions,
    at: usize,
    /// Since when it is under way to the present setting [s].
    sent_s: Option<f64>,
    /// When the order was said last [s].
    said_s: f64,
    /// Since when it stands there [s].
    there_s: Option<f64>,
    last: Option<Point2<f64>>,
    seen: Vec<Seen>,
}

/// An order is said again after this [s].
const SAID_AGAIN_S: f64 = 3.0;

impl Sweep {
    /// Before the first setting.
    pub fn new(options: SweepOptions) -> Sweep {
        let seen = vec![Seen::default(); options.settings.len()];
        Sweep { options, at: 0, sent_s: None, said_s: 0.0, there_s: None, last: None, seen }
    }

    /// Advances to time `now_s`; `angles` is the last reported position of the head [rad]. Returns the command.
    pub fn step(&mut self, now_s: f64, angles: Option<[f64; 2]>) -> SweepOrder {
        let Some(&setting) = self.options.settings.get(self.at) else { return SweepOrder::Done };
        let Some(sent_s) = self.sent_s else {
            (self.sent_s, self.said_s) = (Some(now_s), now_s);
            return SweepOrder::Go(setting);
        };
        let is_there = angles
            .is_some_and(|it| (it[0] - setting[0]).abs().max((it[1] - setting[1]).abs()) <= self.options.tolerance);
        match (is_there, self.there_s) {
            (true, None) => {
                self.there_s = Some(now_s);
                self.seen[self.at].reached = true;
            }
            (true, Some(there_s))
                if self.is_enough() || now_s - there_s > self.options.settle_s + self.options.longest_s =>
            {
                return self.go_on(now_s);
            }
            (true, Some(_)) => {}
            (false, _) => {
                self.there_s = None;
                if now_s - sent_s > LONGEST_WAY_S + self.options.longest_s {
                    return self.go_on(now_s);
                }
                if now_s - self.said_s > SAID_AGAIN_S {
                    self.said_s = now_s;
                    return SweepOrder::Go(setting);
                }
            }
        }
        SweepOrder::Stay
    }

    fn go_on(&mut self, now_s: f64) -> SweepOrder {
        (self.at, self.sent_s, self.there_s, self.last) = (self.at + 1, None, None, None);
        self.step(now_s, None)
    }

    /// Adds a picture of time `time_s` with exactly one light, at `pixel`.
    pub fn add_observation(&mut self, time_s: f64, pixel: Point2<f64>) {
        let has_settled = self.there_s.is_some_and(|it| time_s > it + self.options.settle_s);
        let moved = self.last.is_none_or(|it| (it - pixel).norm() >= self.options.step_px);
        if !has_settled || !moved {
            return;
        }
        self.last = Some(pixel);
        let seen = &mut self.seen[self.at];
        seen.observations += 1;
        let [column, row] = [0, 1].map(|axis| {
            let part = (pixel[axis] + 0.5) / f64::from(self.options.image_size[axis]);
            ((part * CELLS as f64) as usize).min(CELLS - 1)
        });
        seen.cells[row * CELLS + column] += 1;
    }

    fn is_enough(&self) -> bool {
        let seen = &self.seen[self.at];
        let cells = seen.cells.iter().filter(|it| **it > 0).count();
        seen.observations >= self.options.observations && cells >= self.options.cells as usize
    }

    /// How many settings are behind it, and how many there are.
    pub fn progress(&self) -> [usize; 2] {
        [self.at.min(self.seen.len()), self.seen.len()]
    }

    /// What was seen at each setting, in their order.
    pub fn seen(&self) -> impl Iterator<Item = ([f64; 2], &Seen)> {
        self.options.settings.iter().copied().zip(&self.seen)
    }

    /// Settings that the head reached, with observations enough.
    pub fn filled(&self) -> usize {
        self.seen.iter().filter(|it| it.observations >= self.options.observations).count()
    }
}

impl fmt::Display for Sweep {
    /// A sentence for the person with the light: where the head is, what is missing there, where the light is wanted.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [at, n] = self.progress();
        let Some([pan, tilt]) = self.options.settings.get(at) else {
            return write!(f, "{n} of {n} settings done, {} with enough observations", self.filled());
        };
        let (pan, tilt) = (pan.to_degrees(), tilt.to_degrees());
        write!(f, "setting {} of {n} (pan {pan:+.0}°, tilt {tilt:+.0}°): ", at + 1)?;
        if self.there_s.is_none() {
            return write!(f, "the head is on its way");
        }
        let seen = &self.seen[at];
        let wanted = self.options.observations;
        match seen.cells.iter().enumerate().min_by_key(|it| *it.1) {
            _ if seen.observations == 0 => write!(f, "the light was not seen yet; move it in front of the camera"),
            Some((emptiest, 0)) => {
                let vertical = ["at the top", "halfway up", "at the bottom"][emptiest / CELLS];
                let across = ["left", "middle", "right"][emptiest % CELLS];
                write!(
                    f,
                    "{} of {wanted} observations; move the light to the {across} of the picture, {vertical}",
                    seen.observations
                )
            }
            _ => write!(f, "{} of {wanted} observations; move the light on, nearer and farther", seen.observations),
        }
    }
}
