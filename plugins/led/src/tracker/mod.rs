//! From the features of many cameras, each in its own time, to targets that keep their identity.
//!
//! One frame of one camera at a time [Davis 2002 §3.4]: all filters are predicted to its time, each target is projected into
//! that camera and is associated with its feature, and each filter is updated with that pixel alone. Nothing waits for a
//! set of cameras to be complete. Unassociated features may initiate a target; a target that is not seen any more is terminated [§3.6], and
//! is remembered for a while.
//!
//! | step | file |
//! |---|---|
//! | validity and time of frames [§3.5] | here, and `history` |
//! | pairs of targets and features | `association`, and `hypotheses` for ambiguous frames |
//! | spots that are two targets | `unresolved` |
//! | initiations | `initiation`, and [`consensus`](crate::consensus); `partners`: cameras with a common view |
//! | terminations | `track`, and here |
//! | re-identification | `memory` |

mod association;
mod history;
mod hypotheses;
mod initiation;
mod memory;
mod partners;
mod settings;
mod tally;
mod track;
mod unresolved;

use foveate::estimation::clocks::{ClockEstimate, ClockEstimator, ClockObservation, ClockSettings};
use foveate::estimation::motion::{AdaptiveNoise, Filter, Model};
use foveate::geometry::Camera;
use foveate::messages::{CameraId, CameraSet, Features, Interval, Provenance, Target, TargetId, Targets, Time};
use nalgebra::{Matrix2, Matrix6, Point3, Vector3};

use association::{Association, Gate, Pair};
use history::{Seen, Step};
use hypotheses::{Frame, Hypotheses};
use initiation::{Conditions, TrackInitiation};
use memory::{Memory, Newborn, Reach, Recalled};
pub use settings::{AssociationMethod, Clocks, IntegratorSettings, LateRule, MotionModel};
pub use tally::{CameraTally, Tally};
use track::{Termination, Track};

use crate::consensus::ConsensusOptions;

/// A new target must be seen by this part of `initiation_share` of the frames with its place in view: less than at its initiation,
/// when all cameras' newest frames were looked at and not each one.
const CONFIRMATION_SHARE: f64 = 0.5;

/// Time constant of the estimated model noise of a target [s].
const ADAPT_WITHIN_S: f64 = 0.25;
/// Bounds of the factor on the noise of a motion model. Not much below 1: where features are better than stated,
/// small innovations look like a calm target, and the filter would lag in its next turn.
const LEAST_NOISE: f64 = 0.4;
const MOST_NOISE: f64 = 64.0;

/// Weight of the newest frame in the mean number of false features of a camera's frames.
const CLUTTER_WEIGHT: f64 = 0.02;

/// What happened to a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Entry {
    /// It was applied; the targets are of its time, or of the filter's where that is a little later.
    Applied,
    /// Captured too long before the filter's time: discarded.
    Late,
    /// Not newer than the last frame of the same camera: discarded.
    Repeated,
    /// No such camera in the calibration: discarded.
    UnknownCamera,
}

/// All live targets, and the state of tracking.
#[derive(Debug)]
pub struct Tracker {
    settings: IntegratorSettings,
    model: Model,
    cameras: Vec<Camera>,
    /// Opposite corners of the working volume, the lower one first.
    volume: Option<[Point3<f64>; 2]>,
    /// Ascending by identity.
    tracks: Vec<Track>,
    next_id: u32,
    /// The time of all filters.
    time: Option<Time>,
    /// By camera: the stamp of its newest frame.
    newest: Vec<Option<Time>>,
    /// By camera: mean number of features per frame without a target.
    clutter: Vec<f64>,
    association: Association,
    hypotheses: Hypotheses,
    initiation: TrackInitiation,
    memory: Memory,
    clocks: ClockEstimator,
    /// Index of a target, and its filter as of a late frame.
    past: Vec<(usize, Filter)>,
    /// Targets by their place along one axis.
    along: Vec<(f64, usize)>,
    /// Targets at one place: the index of the younger one, then of the older one.
    twins: Vec<(usize, usize)>,
    tally: Tally,
}

impl Tracker {
    /// A tracker without targets. `cameras` are all of the calibration, in its order; `settings` have been checked;
    /// `volume` is the working volume by opposite corners [m].
    ///
    /// # Panics
    /// When `settings` fail [`IntegratorSettings::check`].
    pub fn new(settings: IntegratorSettings, cameras: Vec<Camera>, volume: Option<[[f64; 3]; 2]>) -> Self {
        let n = cameras.len();
        Self {
            volume: volume.map(|[a, b]| {
                let (a, b) = (Point3::from(a), Point3::from(b));
                [a.inf(&b), a.sup(&b)]
            }),
            model: settings.model(),
            tracks: Vec::new(),
            next_id: 0,
            time: None,
            newest: vec![None; n],
            clutter: vec![0.0; n],
            association: Association::default(),
            hypotheses: Hypotheses::default(),
            initiation: TrackInitiation::new(&cameras),
            memory: Memory::default(),
            clocks: ClockEstimator::new(
                n,
                ClockSettings { offset_sigma_s: settings.clock_spread_ms * 1e-3, ..ClockSettings::default() },
            ),
            past: Vec::new(),
            along: Vec::new(),
            twins: Vec::new(),
            tally: Tally { cameras: vec![CameraTally::default(); n], ..Tally::default() },
            settings,
            cameras,
        }
    }

    /// Takes in one frame of one camera, captured at `stamp` by that camera's clock.
    pub fn observe(&mut self, stamp: Time, features: &Features) -> Entry {
        let camera = usize::from(features.camera.0);
        if camera >= self.cameras.len() {
            return Entry::UnknownCamera;
        }
        let applied = match self.settings.clocks {
            Clocks::Correct => self.clock(features.camera, stamp).map_or(0.0, |it| it.offset_s),
            Clocks::Trust | Clocks::Estimate => 0.0,
        };
        let time = stamp - Interval::from_s(applied);
        let entry = self.admit(camera, stamp, time);
        let tally = &mut self.tally.cameras[camera];
        match entry {
            Entry::Late => tally.late += 1,
            Entry::Repeated => tally.repeated += 1,
            _ => tally.applied += 1,
        }
        if entry != Entry::Applied {
            self.tally.late += features.list.len() as u64;
            return entry;
        }
        let now = self.time.map_or(time, |now| now.max(time));
        tally.applied_late += u64::from(time < now);
        self.advance(now);
        if time < now && self.settings.late == LateRule::OutOfSequence {
            self.associate_late(stamp, time, now, features);
        } else {
            self.associate(stamp, now, features);
        }
        self.judge();
        self.merge(now);
        if self.newest[camera].is_none_or(|newest| stamp > newest) {
            self.newest[camera] = Some(stamp);
            self.initiate_from(time, now, features);
        }
        if self.settings.remember_ms > 0.0 {
            self.memory.look(&mut self.tracks, now);
        }
        Entry::Applied
    }

    /// Whether a frame that `camera` took at `time`, at `stamp` by its own clock, is used.
    fn admit(&self, camera: usize, stamp: Time, time: Time) -> Entry {
        let late = self.time.map_or(Interval(0), |now| now - time);
        let newest = self.newest[camera];
        let (tolerance_ms, in_order) = match self.settings.late {
            LateRule::Discard => (0.0, true),
            LateRule::Apply => (self.settings.late_tolerance_ms.max(self.settings.clocks_off_ms()), true),
            LateRule::OutOfSequence => (self.settings.history_ms(), false),
        };
        let tolerance = Interval::from_ms(tolerance_ms);
        if late > tolerance {
            Entry::Late
        } else if newest.is_some_and(|newest| stamp == newest || (in_order && stamp < newest)) {
            Entry::Repeated
        } else {
            Entry::Applied
        }
    }

    /// The time of the targets; `None` before the first frame.
    pub fn time(&self) -> Option<Time> {
        self.time
    }

    /// The newest stamp of `camera`, by its own clock; `None` before its first frame.
    pub fn newest_stamp(&self, camera: CameraId) -> Option<Time> {
        self.newest.get(usize::from(camera.0)).copied().flatten()
    }

    /// Number of live targets, without tentative ones.
    pub fn n_targets(&self) -> usize {
        self.shown().count()
    }

    fn shown(&self) -> impl Iterator<Item = &Track> {
        self.tracks.iter().filter(|it| !it.is_tentative)
    }

    /// Counts so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
    }

    /// Offset of the clock of `camera` ahead of the mean of all, at `stamp` by that clock; `None` where there is no such camera, or
    /// clocks are trusted.
    pub fn clock(&self, camera: CameraId, stamp: Time) -> Option<ClockEstimate> {
        let estimates = self.settings.clocks != Clocks::Trust;
        estimates.then(|| self.clocks.estimate(usize::from(camera.0), stamp.as_s())).flatten()
    }

    /// Fills `targets` with all live targets as of [`Tracker::time`]; its memory is reused.
    pub fn write(&self, targets: &mut Targets) {
        targets.time = self.time.unwrap_or_default();
        targets.list.resize_with(self.n_targets(), || Target {
            id: TargetId::default(),
            position: Point3::origin(),
            velocity: Vector3::zeros(),
            covariance: Matrix6::zeros(),
            cameras: CameraSet::default(),
            provenance: Provenance::Predicted,
        });
        for (track, target) in self.shown().zip(&mut targets.list) {
            track.write(targets.time, target);
        }
    }

    /// Predicts all filters to `now` and terminates lost targets.
    fn advance(&mut self, now: Time) {
        let dt_s = self.time.map_or(0.0, |before| (now - before).as_s());
        self.time = Some(now);
        let unseen = Interval::from_ms(self.settings.lost_after_ms);
        let single_view = Interval::from_ms(self.settings.single_view_after_ms);
        let share = self.settings.initiation_share * CONFIRMATION_SHARE;
        let (volume, margin) = (&self.volume, self.settings.volume_margin_mm * 2e-3);
        let remembers = self.settings.remember_ms > 0.0;
        let (tally, memory) = (&mut self.tally, &mut self.memory);
        self.tracks.retain_mut(|track| {
            track.filter.predict_scaled(dt_s, track.noise_scale());
            let refuted = track.refuted(now, share);
            let reason =
                track.lost(now, unseen, single_view).or(refuted.then_some(Termination::Unconfirmed)).or_else(|| {
                    let position = track.filter.position();
                    let finite = position.coords.sum().is_finite();
                    (!finite || !within(volume, margin, &position)).then_some(Termination::Outside)
                });
            let Some(reason) = reason else { return true };
            tally.count(reason);
            if let Some(lost) = track.regained.take() {
                memory.put_back(*lost); // it died before it had proved to be the one
            } else if remembers
                && track.is_established()
                && matches!(reason, Termination::Unseen | Termination::SingleView)
            {
                memory.keep(track, now);
            }
            false
        });
        if remembers {
            self.memory.forget(now, &self.reach());
        }
        self.hypotheses.predict(&self.tracks, dt_s);
    }

    fn reach(&self) -> Reach {
        Reach {
            remember: Interval::from_ms(self.settings.remember_ms),
            sigma: self.settings.gate_sigma,
            speed: self.settings.initiation_speed_m_s,
        }
    }

    fn gate(&self, camera: CameraId, stamp: Time, time: Time) -> Gate {
        let applied = (stamp - time).as_s();
        let [width, height] = self.cameras[usize::from(camera.0)].image_size.map(f64::from);
        Gate {
            clutter: self.clutter[usize::from(camera.0)] / (width * height),
            sigma: self.settings.gate_sigma,
            pixels: self.settings.gate_px,
            camera_variance: self.settings.camera_error_px.powi(2),
            time_variance: self.clock(camera, stamp).map_or(0.0, |it| it.mean_squared_error(applied)),
        }
    }

    /// Associates the features of this frame with targets.
    fn associate(&mut self, stamp: Time, now: Time, features: &Features) {
        let camera = features.camera;
        let model = &self.cameras[usize::from(camera.0)];
        let gate = self.gate(camera, stamp, now);
        let n = self.tracks.len();
        let association = &mut self.association;
        // All pairs are found before the first filter changes.
        if self.settings.association == AssociationMethod::Hypotheses {
            self.hypotheses.look_up(&self.tracks);
            association.find_candidates(n, self.hypotheses.views(&self.tracks), model, &features.list, &gate);
            let frame = Frame { camera, time: now, features: &features.list, gate };
            self.hypotheses.settle(association, &mut self.tracks, &frame);
            self.tally.ambiguities = self.hypotheses.begun;
        } else {
            let views = self.tracks.iter().enumerate();
            let views = views.map(|(track, it)| it.view(track, &it.filter));
            association.find_candidates(n, views, model, &features.list, &gate);
            match self.settings.association {
                AssociationMethod::Nearest => association.choose_nearest(),
                AssociationMethod::Global | AssociationMethod::Hypotheses => association.choose_global(),
            }
            association.share_spots(&features.list, &gate);
        }
        let keeps_history = self.settings.late == LateRule::OutOfSequence;
        let reach = Interval::from_ms(self.settings.history_ms());
        for pair in self.association.pairs() {
            let track = &mut self.tracks[pair.track];
            let feature = &features.list[pair.feature];
            let noise = gate.noise(&(feature.covariance + pair.spread), &pair.jacobian, &track.filter);
            if self.settings.clocks != Clocks::Trust && track.is_established() {
                let seen = clock_observation(stamp, now, pair, &track.filter, &noise);
                self.clocks.observe(usize::from(camera.0), &seen);
            }
            let innovation = track.filter.update_pixel(pair.innovation, &pair.jacobian, &noise);
            self.tally.consistency.observe(innovation.normalised_squared, 2);
            self.tally.cameras[usize::from(camera.0)].consistency.observe(innovation.normalised_squared, 2);
            if let Some(adaptive) = &mut track.noise {
                adaptive.observe(innovation.normalised_squared, 2, (now - track.seen_at).as_s());
            }
            track.note(camera, now);
            if keeps_history {
                let seen = Some(Seen { camera, pixel: pair.pixel, noise });
                track.history.push(Step { time: now, seen, filter: track.filter.clone() }, reach);
            }
        }
        self.count_features(camera);
    }

    /// Associates the features of a frame from before `now`, with the targets as known at its own `time`.
    fn associate_late(&mut self, stamp: Time, time: Time, now: Time, features: &Features) {
        let camera = features.camera;
        let gate = self.gate(camera, stamp, time);
        self.past.clear();
        for (number, track) in self.tracks.iter().enumerate() {
            self.past.extend(track.history.filter_at(time, track.noise_scale()).map(|filter| (number, filter)));
        }
        let (past, tracks) = (&self.past, &self.tracks);
        let views = past.iter().map(|&(track, ref filter)| tracks[track].view(track, filter));
        let model = &self.cameras[usize::from(camera.0)];
        self.association.find_candidates(self.tracks.len(), views, model, &features.list, &gate);
        match self.settings.association {
            AssociationMethod::Nearest => self.association.choose_nearest(),
            AssociationMethod::Global | AssociationMethod::Hypotheses => self.association.choose_global(),
        }
        self.association.share_spots(&features.list, &gate);
        for pair in self.association.pairs() {
            let track = &mut self.tracks[pair.track];
            let feature = &features.list[pair.feature];
            let filter = &mut self.past[pair.view].1;
            let noise = gate.noise(&(feature.covariance + pair.spread), &pair.jacobian, filter);
            if self.settings.clocks != Clocks::Trust && track.is_established() {
                let seen = clock_observation(stamp, time, pair, filter, &noise);
                self.clocks.observe(usize::from(camera.0), &seen);
            }
            filter.update_pixel(pair.innovation, &pair.jacobian, &noise);
            let seen = Some(Seen { camera, pixel: pair.pixel, noise });
            let step = Step { time, seen, filter: filter.clone() };
            track.filter = track.history.insert(step, &self.cameras, track.noise_scale(), now);
            track.note_late(camera, time);
        }
        self.count_features(camera);
    }

    fn count_features(&mut self, camera: CameraId) {
        let n_unmatched = self.association.unmatched().count();
        let clutter = &mut self.clutter[usize::from(camera.0)];
        *clutter += CLUTTER_WEIGHT * (self.association.n_false() as f64 - *clutter);
        self.tally.used += self.association.n_used() as u64;
        self.tally.shared += self.association.n_shared() as u64;
        self.tally.unmatched += n_unmatched as u64;
        self.tally.unusable = self.association.unusable;
    }

    /// Updates each target in view with whether this frame saw it.
    fn judge(&mut self) {
        for (index, track) in self.tracks.iter_mut().enumerate() {
            if self.association.in_view(index) && !self.association.is_unresolved(index) {
                track.judge(self.association.has_feature(index), self.settings.initiation_share);
            }
        }
    }

    /// Terminates the younger of two targets that have been at one place for too long without being seen apart.
    fn merge(&mut self, now: Time) {
        let near = self.settings.separation_mm * 1e-3;
        let patience = Interval::from_ms(self.settings.merge_after_ms);
        // Neighbours along one axis first: only these can be near in space.
        self.along.clear();
        self.along.extend(self.tracks.iter().enumerate().map(|(number, track)| (track.filter.position().x, number)));
        self.along.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        self.twins.clear();
        for (place, &(x, a)) in self.along.iter().enumerate() {
            for &(_, b) in self.along[place + 1..].iter().take_while(|other| other.0 - x < near) {
                let (older, young) = (a.min(b), a.max(b));
                let apart = self.tracks[older].filter.position() - self.tracks[young].filter.position();
                if apart.norm_squared() < near * near {
                    self.twins.push((young, older));
                }
            }
        }
        if self.twins.is_empty() {
            self.tracks.iter_mut().for_each(|it| it.beside = None);
            return;
        }
        self.twins.sort_unstable(); // of several older ones, the oldest
        let mut gone = false;
        for young in 0..self.tracks.len() {
            let first = self.twins.partition_point(|it| it.0 < young);
            let twin = self.twins.get(first).filter(|it| it.0 == young).map(|it| it.1);
            let beside = twin.and_then(|older| {
                let apart = self.association.has_feature(older) && self.association.has_feature(young);
                let id = self.tracks[older].id;
                let since = self.tracks[young].beside.filter(|it| it.0 == id).map_or(now, |it| it.1);
                (!apart).then_some((id, since))
            });
            let track = &mut self.tracks[young];
            track.beside = beside;
            track.is_twin = beside.is_some_and(|(_, since)| now - since > patience);
            gone |= track.is_twin;
        }
        if gone {
            let tally = &mut self.tally;
            self.tracks.retain(|track| {
                if track.is_twin {
                    tally.count(Termination::Duplicate);
                }
                !track.is_twin
            });
        }
    }

    /// Stores unassociated features, and initiates targets where they meet those of other cameras.
    fn initiate_from(&mut self, time: Time, now: Time, features: &Features) {
        let camera = features.camera;
        let model = &self.cameras[usize::from(camera.0)];
        let unmatched = self.association.unmatched();
        self.initiation.record(camera, model, time, &features.list, unmatched, self.settings.initiation_motion_px);
        let n_unmatched = self.initiation.n_unmatched(camera);
        if n_unmatched > self.settings.initiation_features_max as usize {
            self.initiation.forget(camera);
            return;
        }
        self.initiate(camera, time, now, false);
        if self.settings.initiation_motion_px > 0.0 {
            self.initiate(camera, time, now, true);
        }
    }

    /// Initiates targets where unassociated lines of `camera` meet others; for fast lights where they are `moving`.
    fn initiate(&mut self, camera: CameraId, time: Time, now: Time, moving: bool) {
        if self.initiation.n_unmatched(camera) == 0 {
            return;
        }
        let conditions = Conditions {
            cameras: &self.cameras,
            options: ConsensusOptions {
                tolerance: self.settings.initiation_tolerance_mm * 1e-3,
                min_cameras: self.settings.initiation_cameras as usize,
                min_sine: self.settings.initiation_angle_deg.to_radians().sin(),
            },
            share: self.settings.initiation_share,
            stale_after: Interval::from_ms(self.settings.stale_after_ms),
            speed: self.settings.initiation_speed_m_s,
            camera_variance: self.settings.camera_error_px.powi(2),
        };
        let (volume, margin) = (&self.volume, self.settings.volume_margin_mm * 1e-3);
        let separation = self.settings.separation_mm * 1e-3;
        let confirmation = Interval::from_ms(self.settings.tentative_ms);
        let remembers = self.settings.remember_ms > 0.0;
        // One that nobody sees any more does not stand in the way: it may be the one that is initiated.
        let alone = |tracks: &[Track], point: &Point3<f64>| {
            let near = |it: &&Track| (it.filter.position() - point).norm_squared() < separation * separation;
            !tracks.iter().filter(near).any(|it| !(remembers && it.is_coasting(now)))
        };
        let (tracks, reach) = (&self.tracks, self.reach());
        let allowed = |point: &Point3<f64>| within(volume, margin, point) && alone(tracks, point);
        let n_meetings = self.initiation.meetings(camera, now, moving, &conditions, allowed).len();
        for index in 0..n_meetings {
            let Some(meeting) = self.initiation.meeting(index) else { break };
            let Some(start) = self.initiation.start(meeting, now, moving, &conditions) else { continue };
            if !alone(&self.tracks, &start.position) || !within(volume, margin, &start.position) {
                continue; // of two meetings around one light the better one came first
            }
            let filter =
                Filter::new(&self.model, start.position, start.covariance, start.velocity, start.velocity_sigma);
            let newborn =
                Newborn { place: start.position, variance: start.covariance.trace() / 3.0, now, tracks: &self.tracks };
            let recalled = if remembers { self.memory.recall(&newborn, &reach) } else { None };
            let witnesses = self.initiation.witnesses(meeting, time);
            let place = match recalled {
                Some(Recalled::Live(id)) => {
                    let Ok(place) = self.tracks.binary_search_by_key(&id, |it| it.id) else { continue };
                    self.tracks[place].restart(filter, camera, now);
                    self.hypotheses.forget(id);
                    self.tally.regained += 1;
                    place
                }
                recalled => {
                    let regained = match recalled {
                        Some(Recalled::Lost(lost)) => Some(lost),
                        _ => None,
                    };
                    let id = regained.as_ref().map_or(TargetId(self.next_id), |it| it.id);
                    self.next_id = self.next_id.max(id.0 + 1);
                    let mut track = Track::new(id, filter, now, camera, confirmation);
                    track.noise = self
                        .settings
                        .adapt_noise
                        .then(|| AdaptiveNoise::bounded(ADAPT_WITHIN_S, LEAST_NOISE, MOST_NOISE));
                    let share = self.initiation.share(camera, meeting, now, &conditions);
                    track.is_tentative = regained.is_none() && share < self.settings.initiation_sure_share;
                    self.tally.initiations += 1;
                    self.tally.regained += u64::from(regained.is_some());
                    track.regained = regained;
                    let place = self.tracks.partition_point(|it| it.id < id);
                    self.tracks.insert(place, track);
                    place
                }
            };
            let track = &mut self.tracks[place];
            witnesses.for_each(|witness| track.cameras.insert(witness));
            if self.settings.late == LateRule::OutOfSequence {
                let step = Step { time: now, seen: None, filter: track.filter.clone() };
                track.history.push(step, Interval::from_ms(self.settings.history_ms()));
            }
            self.initiation.consume_members(index);
            self.initiation.consume(camera, &start.position, 2.0 * conditions.options.tolerance);
        }
    }
}

/// The observation of the clock that gave `stamp` by `pair`, predicted to `time`.
fn clock_observation(stamp: Time, time: Time, pair: &Pair, filter: &Filter, noise: &Matrix2<f64>) -> ClockObservation {
    ClockObservation {
        stamp_s: stamp.as_s(),
        applied_offset_s: (stamp - time).as_s(),
        innovation: pair.innovation,
        image_velocity: pair.jacobian * filter.velocity(),
        innovation_covariance: filter.innovation_covariance(&pair.jacobian, noise),
    }
}

/// Whether `point` lies within `margin` of `volume`; everywhere where no volume is stated.
fn within(volume: &Option<[Point3<f64>; 2]>, margin: f64, point: &Point3<f64>) -> bool {
    let Some([low, high]) = volume else { return true };
    (0..3).all(|axis| (low[axis] - margin..=high[axis] + margin).contains(&point[axis]))
}
