//! All cameras, each judged by the lights as the others have them.
//!
//! A target says which features belong together, and no more: where it is, is found anew for each camera from the features of it in
//! the *other* cameras, just before and just after, between which its path is straight. (Nothing is carried by the target's velocity,
//! at which a bumped camera pulls.) A witness that the rest contradicts is left out. A feature counts only when it is the one feature
//! near a target, and that target the only one near: other lights, glints and crossing targets drop out rather than being guessed at.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use foveate::geometry::triangulate::{PixelNoise, refine};
use foveate::geometry::{Camera, Triangulation};
use foveate::messages::{Features, Interval, Provenance, TargetId, Targets, Time};
use nalgebra::{Isometry3, Matrix2, Point2, Point3, Translation3, UnitQuaternion, Vector3};

use super::turns::{Change, Residual, TurnOptions, Turns};

/// See [`super::CameraWatchSettings`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WatchOptions {
    /// About the turns.
    pub turns: TurnOptions,
    /// How far a feature may be from its target [rad].
    pub gate: f64,
    /// How far apart the two features of another camera may be between which a target is placed.
    pub max_age: Interval,
}

/// Cameras that no longer stand as they stood.
#[derive(Debug, Clone, PartialEq)]
pub struct Bump {
    /// Which; one of these, where it is several.
    pub cameras: Vec<usize>,
    /// Since when: the start of the first bin that shows it.
    pub at: Time,
    /// When that was plain.
    pub told_at: Time,
    /// By how much the world turned before it, about its own x (tilt), y (pan) and z (roll); of the likeliest one [rad].
    pub turn: Vector3<f64>,
    /// How far lights moved in its picture, root mean square [px].
    pub shift_px: f64,
    /// How many standard deviations that is.
    pub sigmas: f64,
}

/// A turn of a camera, for the table.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Row {
    /// Start of its bin.
    pub at: Time,
    /// Which camera.
    pub camera: usize,
    /// [rad]
    pub turn: Vector3<f64>,
    /// Standard deviation about the worst known axis [rad].
    pub sigma: f64,
    /// What it was made of.
    pub observations: usize,
    /// How far it and those just before it are from the history; NaN without one.
    pub sigmas: f64,
}

/// Of the most certain change, a change this part as certain is as good a candidate.
const AS_GOOD: f64 = 0.67;
/// What shows in fewer bins passes again.
const LASTING: usize = 2;
/// Bins to wait for candidates to come apart.
const PATIENCE: u32 = 4;
/// A bump's size is taken from as many turns after it, once these are known.
const SETTLED: usize = 4;
/// Fewer witnesses than this may all be led astray by one of them.
const CERTAIN: usize = 3;
/// A squared distance beyond this many variances and a witness is left out, if others remain.
const CONTRADICTS: f64 = 16.0;
/// Errors of pixels that no covariance states: the lens model, mostly [px].
const UNSTATED_PX: f64 = 0.1;
/// How much a light is accelerated between two pictures of a camera, standard deviation [m/s²]: arms and legs do as much.
const ACCELERATION: f64 = 10.0;
/// Features that wait for their targets; more are forgotten.
const MOST_WAITING: usize = 4096;
/// Targets not heard of for this long are forgotten.
const FORGOTTEN: Interval = Interval(2_000_000_000);

#[derive(Debug, Clone, Copy)]
struct Observation {
    time: Time,
    pixel: Point2<f64>,
    covariance: Matrix2<f64>,
}

/// The last features of a target.
#[derive(Debug, Clone)]
struct Seen {
    /// By camera, in the order of time.
    observations: Vec<VecDeque<Observation>>,
    /// When some camera last observed it.
    measured: Time,
}

/// A feature that is judged as soon as the others' next ones are known.
#[derive(Debug, Clone, Copy)]
struct Pending {
    camera: usize,
    target: TargetId,
    observation: Observation,
    /// About where the target is.
    near: Point3<f64>,
}

/// Watches the cameras of a rig.
#[derive(Debug)]
pub struct Watch {
    options: WatchOptions,
    cameras: Vec<Camera>,
    /// As they are believed to stand now: tells which feature is which light once a camera was bumped.
    stand: Vec<Camera>,
    turns: Vec<Turns>,
    /// No witness any more.
    is_out: Vec<bool>,
    /// What the calibration says of its orientation holds no more: it was bumped, or may have been.
    is_void: Vec<bool>,
    observations: Vec<u64>,
    waiting: Vec<(Time, Arc<Features>)>,
    targets: Option<Arc<Targets>>,
    seen: BTreeMap<TargetId, Seen>,
    pending: VecDeque<Pending>,
    /// Start of the open bin.
    bin: Option<Time>,
    patience: u32,
    bumps: Vec<Bump>,
    /// Of bumps whose size is still to be settled: which, and how the camera was turned before.
    unsettled: Vec<(usize, Vector3<f64>)>,
    /// By camera: how many observations of the open bin had fewer than [`CERTAIN`] witnesses, of how many.
    thin: Vec<[usize; 2]>,
    /// By camera: who was a witness in the open bin.
    asked: Vec<Vec<bool>>,
    rows: Vec<Row>,
    witnesses: Vec<usize>,
    pixels: Vec<Point2<f64>>,
    covariances: Vec<Matrix2<f64>>,
}

impl Watch {
    /// Nothing seen yet; `cameras` are all of the calibration, in its order.
    pub fn new(options: WatchOptions, cameras: Vec<Camera>) -> Self {
        let n = cameras.len();
        Self {
            options,
            turns: vec![Turns::default(); n],
            is_out: vec![false; n],
            is_void: vec![false; n],
            observations: vec![0; n],
            stand: cameras.clone(),
            cameras,
            waiting: Vec::new(),
            targets: None,
            seen: BTreeMap::new(),
            pending: VecDeque::new(),
            bin: None,
            patience: 0,
            bumps: Vec::new(),
            unsettled: Vec::new(),
            thin: vec![[0; 2]; n],
            asked: vec![vec![false; n]; n],
            rows: Vec::new(),
            witnesses: Vec::new(),
            pixels: Vec::new(),
            covariances: Vec::new(),
        }
    }

    /// What was told so far.
    pub fn bumps(&self) -> &[Bump] {
        &self.bumps
    }

    /// All turns so far.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// By camera: observations that could be compared.
    pub fn observations(&self) -> &[u64] {
        &self.observations
    }

    /// Takes in what a camera saw at `time`.
    pub fn add_features(&mut self, time: Time, features: Arc<Features>) {
        if usize::from(features.camera.0) >= self.cameras.len() {
            return;
        }
        match &self.targets {
            Some(targets) if targets.time == time => {
                let targets = Arc::clone(targets);
                self.look(time, &features, &targets);
            }
            _ => {
                if self.waiting.len() >= MOST_WAITING {
                    self.waiting.remove(0);
                }
                self.waiting.push((time, features));
            }
        }
    }

    /// Takes in the targets after what was seen at their time.
    pub fn add_targets(&mut self, targets: Arc<Targets>) {
        let time = targets.time;
        let mut waiting = std::mem::take(&mut self.waiting);
        for (_, features) in waiting.iter().filter(|it| it.0 == time) {
            self.look(time, features, &targets);
        }
        waiting.retain(|it| it.0 > time);
        self.waiting = waiting;
        self.judge_until(time - self.options.max_age);
        self.targets = Some(targets);
    }

    /// Judges what waits, and ends the bin that is open.
    pub fn finish(&mut self) {
        if let Some(last) = self.pending.back() {
            self.judge_until(last.observation.time);
        }
        if let Some(open) = self.bin.take() {
            self.close(open);
        }
    }

    /// Keeps what a camera saw of each target, to be judged and to judge others by.
    fn look(&mut self, time: Time, features: &Features, targets: &Targets) {
        let own = usize::from(features.camera.0);
        let model = &self.stand[own];
        let gate_px = self.options.gate * model.intrinsics.focal[0];
        for target in &targets.list {
            let known = self.seen.get(&target.id).is_some_and(|it| time - it.measured <= self.options.max_age);
            match target.provenance {
                Provenance::Measured => {}
                // A camera that was bumped far may be believed by no target any more.
                Provenance::Predicted if known => {}
                _ => continue,
            }
            let Some(expected) = model.project(&target.position) else { continue };
            let is_near = |it: &Point2<f64>| (it - expected).norm() < gate_px;
            let mut others = targets.list.iter().filter(|it| it.id != target.id);
            let crowded = others.any(|it| model.project(&it.position).is_some_and(|it| is_near(&it)));
            let mut near = features.list.iter().filter(|it| is_near(&it.centre));
            let (Some(feature), None, false) = (near.next(), near.next(), crowded) else { continue };
            let observation = Observation { time, pixel: feature.centre, covariance: feature.covariance };
            self.pending.push_back(Pending { camera: own, target: target.id, observation, near: target.position });
            let n = self.cameras.len();
            let none = || Seen { observations: vec![VecDeque::new(); n], measured: time };
            let seen = self.seen.entry(target.id).or_insert_with(none);
            if target.provenance == Provenance::Measured {
                seen.measured = time;
            }
            let observations = &mut seen.observations[own];
            // They are asked for what others saw up to `max_age` ago, and for the one before that.
            while observations.front().is_some_and(|it| time - it.time > Interval(2 * self.options.max_age.0)) {
                observations.pop_front();
            }
            observations.push_back(observation);
        }
    }

    /// Judges what was seen up to `until`, after which the others were heard of as well.
    fn judge_until(&mut self, until: Time) {
        while let Some(next) = self.pending.front().filter(|it| it.observation.time <= until).copied() {
            self.pending.pop_front();
            self.enter(next.observation.time);
            self.judge(&next);
        }
        self.enter(until);
    }

    /// Ends the bin that is open if `time` is after it.
    fn enter(&mut self, time: Time) {
        let bin = self.options.turns.bin;
        let open = *self.bin.get_or_insert(time);
        if time >= open + bin {
            self.close(open);
            let passed = ((time - open).as_s() / bin.as_s()).floor();
            self.bin = Some(open + Interval::from_s(passed * bin.as_s()));
            self.seen.retain(|_, it| time - it.measured < FORGOTTEN);
        }
    }

    /// Compares what a camera saw with what the others make of it.
    fn judge(&mut self, pending: &Pending) {
        let own = pending.camera;
        let Some(placed) = self.place_without(pending) else { return };
        let camera = &self.cameras[own];
        let Some((expected, by_point)) = camera.project_with_jacobian(&placed.position) else { return };
        let spread = pending.observation.covariance
            + by_point * placed.covariance * by_point.transpose()
            + Matrix2::identity() * UNSTATED_PX * UNSTATED_PX;
        let in_camera = camera.camera_from_world * placed.position;
        let rotation = camera.camera_from_world.rotation.to_rotation_matrix();
        let by_turn = by_point * rotation.matrix().transpose() * -in_camera.coords.cross_matrix();
        let error = pending.observation.pixel - expected;
        self.turns[own].add(Residual { error, target: pending.target, covariance: spread, by_turn });
        self.observations[own] += 1;
        self.thin[own][0] += usize::from(self.witnesses.len() < CERTAIN);
        self.thin[own][1] += 1;
        self.witnesses.iter().for_each(|it| self.asked[own][*it] = true);
    }

    /// Where the target was by all other cameras; `None` if fewer than two agree.
    fn place_without(&mut self, pending: &Pending) -> Option<Triangulation> {
        let time = pending.observation.time;
        let seen = self.seen.get(&pending.target)?;
        self.witnesses.clear();
        self.pixels.clear();
        self.covariances.clear();
        for (camera, observations) in seen.observations.iter().enumerate() {
            if camera == pending.camera || self.is_out[camera] {
                continue;
            }
            let after = observations.partition_point(|it| it.time < time);
            let Some(next) = observations.get(after) else { continue };
            let last =
                if next.time == time { Some(next) } else { after.checked_sub(1).and_then(|it| observations.get(it)) };
            let Some(last) = last.filter(|it| next.time - it.time <= self.options.max_age) else { continue };
            let Some((_, by_point)) = self.cameras[camera].project_with_jacobian(&pending.near) else { continue };
            let (since, until) = ((time - last.time).as_s(), (next.time - time).as_s());
            let part = if next.time > last.time { since / (since + until) } else { 0.0 };
            // By how much the path is not straight.
            let bulge = 0.5 * ACCELERATION * since * until;
            self.witnesses.push(camera);
            self.pixels.push(last.pixel + (next.pixel - last.pixel) * part);
            self.covariances.push(
                last.covariance * (1.0 - part).powi(2)
                    + next.covariance * part.powi(2)
                    + by_point * by_point.transpose() * bulge.powi(2)
                    + Matrix2::identity() * UNSTATED_PX * UNSTATED_PX,
            );
        }
        loop {
            let models: smallvec::SmallVec<[&Camera; 32]> =
                self.witnesses.iter().map(|it| &self.cameras[*it]).collect();
            let noise = PixelNoise::Covariances(&self.covariances);
            let placed = refine(&models, &self.pixels, noise, pending.near).ok()?;
            let squared = |index: usize| {
                let off = models[index].project(&placed.position).map(|it| it - self.pixels[index]);
                let weight = self.covariances[index].try_inverse();
                off.zip(weight).map_or(f64::INFINITY, |(off, weight)| off.dot(&(weight * off)))
            };
            let worst = (0..models.len()).max_by(|a, b| squared(*a).total_cmp(&squared(*b)))?;
            if squared(worst) <= CONTRADICTS {
                return Some(placed);
            }
            if models.len() < 4 {
                return None; // of three that contradict each other, none is to be believed
            }
            self.witnesses.remove(worst);
            self.pixels.remove(worst);
            self.covariances.remove(worst);
        }
    }

    /// Ends the bin that began at `at`, and tells what changed.
    fn close(&mut self, at: Time) {
        let options = self.options.turns;
        let thin = std::mem::replace(&mut self.thin, vec![[0; 2]; self.cameras.len()]);
        let asked = std::mem::replace(&mut self.asked, vec![vec![false; self.cameras.len()]; self.cameras.len()]);
        let mut changes: Vec<(usize, Change)> = Vec::new();
        let mut n_watched = 0;
        for camera in 0..self.cameras.len() {
            let Some(turn) = self.turns[camera].close(at, &options) else { continue };
            n_watched += 1;
            let change = self.turns[camera].change(at, self.is_void[camera], &options);
            let sigma = turn.information.symmetric_eigenvalues().min().max(f64::MIN_POSITIVE).sqrt().recip();
            let sigmas = change.map_or(f64::NAN, |it| it.sigmas);
            self.rows.push(Row { at, camera, turn: turn.turn, sigma, observations: turn.observations, sigmas });
            changes.extend(change.map(|it| (camera, it)));
        }
        let is_told = |it: &Change| {
            let large = it.turn.norm() > options.least && it.shift_px > options.least_px;
            it.sigmas > options.sigmas && it.bins >= LASTING && large
        };
        // Half as certain will do for what speaks against a diagnosis.
        let is_change = |it: &Change| it.sigmas > 0.5 * options.sigmas && it.turn.norm() > options.least;
        let changed: Vec<usize> = changes.iter().filter(|it| is_change(&it.1)).map(|it| it.0).collect();
        changes.retain(|it| is_told(&it.1));
        self.settle();
        // What most cameras show at once is no bump of one of them.
        let by_most = changed.len() > 2 && 2 * changed.len() > n_watched;
        // Who has many witnesses is judged first, if it shows as much: those with few may be led astray by that very camera.
        let is_certain = |it: &(usize, Change)| 2 * thin[it.0][0] <= thin[it.0][1];
        let most = |list: &mut dyn Iterator<Item = &(usize, Change)>| list.map(|it| it.1.sigmas).fold(0.0, f64::max);
        let certain = most(&mut changes.iter().filter(|it| is_certain(it)));
        if !by_most && certain > AS_GOOD * most(&mut changes.iter()) {
            changes.retain(is_certain);
        }
        let strongest = changes.iter().max_by(|a, b| a.1.sigmas.total_cmp(&b.1.sigmas)).copied();
        let Some((camera, change)) = strongest else {
            self.patience = 0;
            return;
        };
        let as_good = |it: &&(usize, Change)| it.0 == camera || it.1.sigmas > AS_GOOD * change.sigmas;
        let mut candidates: Vec<usize> = changes.iter().filter(as_good).map(|it| it.0).collect();
        if by_most {
            candidates = changed;
        } else if !is_certain(&(camera, change)) {
            candidates.extend((0..self.cameras.len()).filter(|it| asked[camera][*it]));
            candidates.sort_unstable();
            candidates.dedup();
        }
        if candidates.len() > 1 {
            self.patience += 1;
            if self.patience < PATIENCE {
                return;
            }
        }
        self.patience = 0;
        candidates.sort_unstable_by_key(|it| (*it != camera, *it));
        for (other, turns) in self.turns.iter_mut().enumerate() {
            if candidates.contains(&other) {
                self.is_void[other] = true;
                turns.forget_before(change.at);
            } else {
                // The bumped one was among their witnesses: what they showed with it is no measure of what they show without it. Until
                // they have a history again, the calibration stands in for it.
                turns.forget();
            }
        }
        if let [only] = candidates[..] {
            self.is_out[only] = true;
            self.stand[only] = turned(&self.cameras[only], &(change.before + change.turn));
            self.unsettled.push((self.bumps.len(), change.before));
        }
        self.bumps.push(Bump {
            cameras: candidates,
            at: change.at,
            told_at: at + options.bin + self.options.max_age,
            turn: change.turn,
            shift_px: change.shift_px,
            sigmas: change.sigmas,
        });
    }

    /// States the size of bumps from turns after them.
    fn settle(&mut self) {
        self.unsettled.retain(|(index, before)| {
            let bump = &mut self.bumps[*index];
            let turns = &self.turns[bump.cameras[0]];
            let known = turns.count_after(bump.at) >= SETTLED;
            if known && let Some(found) = turns.turned_since(bump.at, before) {
                (bump.turn, bump.shift_px) = found;
                let camera = bump.cameras[0];
                self.stand[camera] = turned(&self.cameras[camera], &(before + bump.turn));
            }
            !known
        });
    }
}

/// `camera` when the world has turned by `turn` before it.
fn turned(camera: &Camera, turn: &Vector3<f64>) -> Camera {
    let turn = Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_scaled_axis(*turn));
    Camera { camera_from_world: turn * camera.camera_from_world, ..camera.clone() }
}
