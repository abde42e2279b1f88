//! Re-identification: whether a new target is one that was lost, or has been unseen for a while.
//!
//! Two kinds of evidence are used. Motion: the new target is within reach of the lost one. Arrangement: its distances to
//! its neighbours are those of the lost one, as far as these were constant (lights on one limb are, those on two
//! people do not). Where two lost targets fit equally, none is used: a new identity is less harmful than a wrong one.

use foveate::estimation::motion::Filter;
use foveate::messages::{Interval, TargetId, Time};
use nalgebra::{Point3, Vector3};
use smallvec::SmallVec;

use super::track::Track;

/// Distances to this many others are kept.
const N_NEIGHBOURS: usize = 6;
/// Farther targets are not neighbours [m].
const NEAR: f64 = 1.0;
/// Time constant of the mean and the variance of a distance [s].
const FORGET_S: f64 = 2.0;
/// Interval between updates of distances.
const PERIOD: Interval = Interval(100_000_000);
/// Fewest updates of a distance before it is used.
const ENOUGH_LOOKS: u32 = 5;
/// Error of a distance besides its own spread, standard deviation [m].
const DISTANCE_SIGMA: f64 = 0.02;
/// Spread of a distance to an unrelated target, standard deviation [m].
const ANY_DISTANCE: f64 = 0.5;
/// Largest evidence of one distance, for or against; in −2 ln of a likelihood.
const MAX_LOG_LIKELIHOOD: f64 = 6.0;
/// Evidence of the distances that compensates for an unobserved motion.
const ARRANGED: f64 = -12.0;
/// After this time unseen, the direction of motion is no longer used [s].
const HEADING_LASTS_S: f64 = 0.3;
/// The mean deviation from constant velocity covers this many updates.
const WANDER_LOOKS: u32 = 20;
/// Smallest uncertainty of a target's position at its last observation [m].
const KNOWN_TO: f64 = 0.01;
/// Updates within the time of constant heading, plus one.
const LOOKS_BACK: usize = 4;
/// Prior deviation from constant velocity in that time, each axis, standard deviation [m], and its weight [updates].
const ANY_WANDER: f64 = 0.15;
const ANY_LOOKS: f64 = 3.0;
/// Two lost targets are ambiguous when their costs differ by less.
const ALIKE: f64 = 2.0;

/// The distance to another target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Neighbour {
    id: TargetId,
    /// [m]
    mean: f64,
    /// [m²]
    variance: f64,
    /// At its last update [m].
    last: f64,
    /// Mean square of its change [m²/s²].
    change: f64,
    looks: u32,
}

/// Time, position [m] and velocity [m/s] of a target.
type Look = (Time, Point3<f64>, Vector3<f64>);

/// Observed deviation of a target from constant velocity: a motion model is unreliable for long gaps.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Wander {
    /// Its state at the last updates; the newest last.
    past: SmallVec<[Look; LOOKS_BACK]>,
    /// Mean square of one axis after [`HEADING_LASTS_S`] [m²].
    squared: f64,
    looks: u32,
}

/// The targets around one.
pub(super) type Neighbours = SmallVec<[Neighbour; N_NEIGHBOURS]>;

/// A lost target that may be found again.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Lost {
    pub id: TargetId,
    /// As of `filter_at`.
    filter: Filter,
    filter_at: Time,
    seen_at: Time,
    neighbours: Neighbours,
    wander: Wander,
}

/// Reach of a lost target.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reach {
    /// How long it is remembered.
    pub remember: Interval,
    /// Largest distance in standard deviations.
    pub sigma: f64,
    /// Speed of a target that changes its direction, each axis, standard deviation [m/s].
    pub speed: f64,
}

/// All targets that may be found again.
#[derive(Debug, Default)]
pub(super) struct Memory {
    lost: Vec<Lost>,
    looked_at: Option<Time>,
}

impl Memory {
    /// Updates the distances between `tracks`, at intervals.
    pub fn look(&mut self, tracks: &mut [Track], now: Time) {
        let elapsed = self.looked_at.map(|before| now - before);
        if elapsed.is_some_and(|it| it < PERIOD) {
            return;
        }
        self.looked_at = Some(now);
        let elapsed_s = elapsed.map_or(0.0, Interval::as_s);
        let is_known = |track: &Track| now - track.seen_at <= PERIOD; // where the others are supposed to be says nothing
        for index in 0..tracks.len() {
            let (before, rest) = tracks.split_at_mut(index);
            let Some((track, after)) = rest.split_first_mut() else { break };
            if !is_known(track) {
                track.wander.past.clear();
                continue;
            }
            let place = track.filter.position();
            track.wander.look(now, place, track.filter.velocity());
            let mut nearest: Option<Neighbour> = None;
            for other in before.iter().chain(after.iter()).filter(|it| is_known(it)) {
                let mean = (other.filter.position() - place).norm();
                if let Some(known) = track.neighbours.iter_mut().find(|it| it.id == other.id) {
                    known.look(mean, elapsed_s);
                } else if mean < NEAR && nearest.is_none_or(|it| mean < it.mean) {
                    nearest = Some(Neighbour { id: other.id, mean, variance: 0.0, last: mean, change: 0.0, looks: 1 });
                }
            }
            let Some(nearest) = nearest else { continue };
            if track.neighbours.len() == N_NEIGHBOURS {
                // The loosest tie gives way to one that may be tighter.
                let loosest = (0..N_NEIGHBOURS).max_by(|&a, &b| {
                    let spread = |it: usize| track.neighbours[it].variance.sqrt() + 0.1 * track.neighbours[it].mean;
                    spread(a).total_cmp(&spread(b))
                });
                let Some(loosest) = loosest.filter(|&it| {
                    track.neighbours[it].looks >= ENOUGH_LOOKS && nearest.mean < track.neighbours[it].mean
                }) else {
                    continue;
                };
                track.neighbours.swap_remove(loosest);
            }
            track.neighbours.push(nearest);
        }
    }

    /// Remembers a target that was lost at `now`.
    pub fn keep(&mut self, track: &Track, now: Time) {
        self.lost.push(Lost::of(track, now));
    }

    /// Remembers `lost` again: the target that got its identity was false.
    pub fn put_back(&mut self, lost: Lost) {
        self.lost.push(lost);
    }

    /// Forgets targets unseen for too long.
    pub fn forget(&mut self, now: Time, reach: &Reach) {
        self.lost.retain(|it| now - it.seen_at <= reach.remember);
    }

    /// The lost or unseen target that matches one initiated at `place` [m] with the variance `variance` of each coordinate [m²], if there is one
    /// and only one.
    pub fn recall(&mut self, newborn: &Newborn<'_>, reach: &Reach) -> Option<Recalled> {
        let lost = self.lost.iter().enumerate();
        let lost = lost.filter_map(|(index, lost)| Some((lost.misfit(newborn, reach)?, Err(index))));
        let unseen = newborn
            .tracks
            .iter()
            .filter(|it| it.is_coasting(newborn.now) || it.is_astray())
            .filter_map(|track| Some((Lost::of(track, newborn.now).misfit(newborn, reach)?, Ok(track.id))));
        let mut misfits: SmallVec<[(f64, Result<TargetId, usize>); 8]> = lost.chain(unseen).collect();
        misfits.sort_by(|a, b| a.0.total_cmp(&b.0));
        let (best, who) = *misfits.first()?;
        if misfits.get(1).is_some_and(|second| second.0 - best < ALIKE) {
            return None;
        }
        Some(match who {
            Ok(id) => Recalled::Live(id),
            Err(index) => Recalled::Lost(Box::new(self.lost.remove(index))),
        })
    }
}

/// A target about to be initiated.
#[derive(Debug, Clone, Copy)]
pub(super) struct Newborn<'a> {
    /// [m]
    pub place: Point3<f64>,
    /// Of each coordinate [m²].
    pub variance: f64,
    pub now: Time,
    /// Those that live, ascending by identity.
    pub tracks: &'a [Track],
}

/// Identity of a new target.
#[derive(Debug)]
pub(super) enum Recalled {
    /// A live target without recent observations.
    Live(TargetId),
    /// A terminated target.
    Lost(Box<Lost>),
}

impl Wander {
    fn look(&mut self, now: Time, place: Point3<f64>, velocity: Vector3<f64>) {
        if self.past.len() == LOOKS_BACK {
            self.past.remove(0);
        }
        if let Some((then, from, heading)) = self.past.first().filter(|_| self.past.len() + 1 == LOOKS_BACK) {
            let elapsed_s = (now - *then).as_s();
            let astray = (place - (from + heading * elapsed_s)).norm_squared() / 3.0;
            let scaled = astray * (HEADING_LASTS_S / elapsed_s.max(1e-3)).powi(2);
            self.looks += 1;
            let weight = 1.0 / f64::from(self.looks.min(WANDER_LOOKS));
            self.squared += weight * (scaled - self.squared);
        }
        self.past.push((now, place, velocity));
    }

    /// Variance of each coordinate after `unseen_s` [m²].
    fn variance(&self, unseen_s: f64) -> f64 {
        let looks = f64::from(self.looks.min(WANDER_LOOKS));
        let after = (self.squared * looks + ANY_WANDER * ANY_WANDER * ANY_LOOKS) / (looks + ANY_LOOKS);
        after * (unseen_s.min(HEADING_LASTS_S) / HEADING_LASTS_S).powi(2)
    }
}

impl Neighbour {
    fn look(&mut self, distance: f64, elapsed_s: f64) {
        self.looks += 1;
        // A plain mean at first, an exponential one later.
        let keep = (-elapsed_s / FORGET_S).exp().min(1.0 - 1.0 / f64::from(self.looks));
        let off = distance - self.mean;
        self.mean += (1.0 - keep) * off;
        self.variance = keep * (self.variance + (1.0 - keep) * off * off);
        let change = (distance - self.last) / elapsed_s.max(1e-3);
        self.change += (1.0 - keep) * (change * change - self.change);
        self.last = distance;
    }

    /// Evidence of a distance of `distance`, known with `variance`, after `unseen_s`: −2 ln of its likelihood, less that of
    /// an unrelated target. The better of two models is used: a constant distance, or one that keeps changing.
    fn evidence(&self, distance: f64, variance: f64, unseen_s: f64) -> f64 {
        let own = DISTANCE_SIGMA * DISTANCE_SIGMA + variance;
        let about = |centre: f64, variance: f64| {
            let variance = own + variance;
            (distance - centre).powi(2) / variance + (variance / (ANY_DISTANCE * ANY_DISTANCE)).ln()
        };
        let kept = about(self.mean, self.variance);
        let changed = about(self.last, self.change * unseen_s * unseen_s);
        kept.min(changed).clamp(-MAX_LOG_LIKELIHOOD, MAX_LOG_LIKELIHOOD)
    }
}

impl Lost {
    /// `track`, whose filter is of `now`.
    fn of(track: &Track, now: Time) -> Self {
        Self {
            id: track.id,
            filter: track.filter.clone(),
            filter_at: now,
            seen_at: track.seen_at,
            neighbours: track.neighbours.clone(),
            wander: track.wander.clone(),
        }
    }

    /// Squared normalised distance of `new`; `None` where it cannot be this one.
    fn misfit(&self, newborn: &Newborn<'_>, reach: &Reach) -> Option<f64> {
        let &Newborn { place, variance, now, tracks } = newborn;
        let unseen_s = (now - self.seen_at).as_s();
        // Straight on for as long as a heading lasts; from there it may have gone anywhere, at its speed.
        let mut filter = self.filter.clone();
        let straight_s =
            (HEADING_LASTS_S - (self.filter_at - self.seen_at).as_s()).clamp(0.0, (now - self.filter_at).as_s());
        let seen_last = filter.position() - filter.velocity() * (self.filter_at - self.seen_at).as_s();
        filter.predict(straight_s);
        let turned = reach.speed * (unseen_s - HEADING_LASTS_S).max(0.0);
        let spread = self.wander.variance(unseen_s) + turned * turned + variance + KNOWN_TO * KNOWN_TO;
        // One that slowed down or stopped meanwhile lies on the way there.
        let motion = off_way(&seen_last, &filter.position(), &place).norm_squared() / spread;
        let known = self.neighbours.iter().filter(|it| it.looks >= ENOUGH_LOOKS);
        let arrangement: f64 = known
            .filter_map(|neighbour| {
                let other = tracks.binary_search_by_key(&neighbour.id, |it| it.id).ok()?;
                let other = Some(&tracks[other]).filter(|it| !it.is_coasting(now))?;
                Some(neighbour.evidence((other.filter.position() - place).norm(), variance, unseen_s))
            })
            .sum();
        let gate = reach.sigma * reach.sigma;
        let far = if arrangement <= ARRANGED { 4.0 * gate } else { gate };
        (motion <= far && motion + arrangement <= gate).then_some(motion + arrangement)
    }
}

/// From the nearest point of the segment between `from` and `to` to `place` [m].
fn off_way(from: &Point3<f64>, to: &Point3<f64>, place: &Point3<f64>) -> Vector3<f64> {
    let way = to - from;
    let part = (place - from).dot(&way) / way.norm_squared().max(f64::MIN_POSITIVE);
    place - (from + way * part.clamp(0.0, 1.0))
}
