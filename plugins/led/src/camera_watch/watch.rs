//! Checks each camera against the positions of lights by the others.
//!
//! A target only associates features: its position is triangulated again for each camera from its features in
//! the *other* cameras, just before and just after, between which its path is straight. (The target's velocity is not used,
//! since a bumped camera biases it.) A camera that the rest contradicts is left out. A feature counts only when it is the one feature
//! near a target, and that target the only one near: other lights, glints and crossing targets are left out.

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
    /// Options of the rotations.
    pub turns: TurnOptions,
    /// Largest angle between a feature and its target [rad].
    pub gate: f64,
    /// Longest time between the two features of another camera between which a target is triangulated.
    pub max_age: Interval,
}

/// Cameras that were bumped.
#[derive(Debug, Clone, PartialEq)]
pub struct Bump {
    /// The bumped camera; several where it is ambiguous.
    pub cameras: Vec<usize>,
    /// Start of the first bin that shows it.
    pub at: Time,
    /// Time at which it was certain.
    pub detected_at: Time,
    /// Rotation of the world in its view, about its own x (tilt), y (pan) and z (roll); of the likeliest camera [rad].
    pub turn: Vector3<f64>,
    /// Shift of lights in its picture, root mean square [px].
    pub shift_px: f64,
    /// The rotation in standard deviations.
    pub sigmas: f64,
}

/// A rotation of a camera, for the table.
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
    /// Number of observations.
    pub observations: usize,
    /// Distance of it and those just before it from the history in standard deviations; NaN without a history.
    pub sigmas: f64,
}

/// A change with this share of the significance of the largest is also a candidate.
const AS_GOOD: f64 = 0.67;
/// Changes in fewer bins are temporary.
const LASTING: usize = 2;
/// Bins to wait until candidates can be distinguished.
const PATIENCE: u32 = 4;
/// A bump's size is averaged over this many rotations after it, once these are known.
const SETTLED: usize = 4;
/// Fewer supporting cameras than this may all be biased by one of them.
const CERTAIN: usize = 3;
/// Above this normalised squared distance a supporting camera is left out, if others remain.
const CONTRADICTS: f64 = 16.0;
/// Pixel errors that are in no covariance, mostly of the lens model [px].
const UNSTATED_PX: f64 = 0.1;
/// Acceleration of a light between two pictures of a camera, standard deviation [m/s²]: as of arms and legs.
const ACCELERATION: f64 = 10.0;
/// Features that wait for their targets; more are forgotten.
const MOST_WAITING: usize = 4096;
/// Targets without a message for this long are forgotten.
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
    /// Time of its last observation by any camera.
    measured: Time,
}

/// A feature that waits for the others' next ones.
#[derive(Debug, Clone, Copy)]
struct Pending {
    camera: usize,
    target: TargetId,
    observation: Observation,
    /// Approximate position of the target.
    near: Point3<f64>,
}

/// Watches the cameras of a rig.
#[derive(Debug)]
pub struct Watch {
    options: WatchOptions,
    cameras: Vec<Camera>,
    /// Present cameras, corrected for bumps, for associating features with lights.
    stand: Vec<Camera>,
    turns: Vec<Turns>,
    /// Cameras that are not used for triangulation any more.
    is_out: Vec<bool>,
    /// Cameras whose calibrated orientation is invalid: bumped, or possibly so.
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
    /// Bumps whose size is not final: camera, and its rotation before.
    unsettled: Vec<(usize, Vector3<f64>)>,
    /// By camera: number of observations of the open bin with fewer than [`CERTAIN`] supporting cameras, and of all.
    thin: Vec<[usize; 2]>,
    /// By camera: the cameras used for its residuals in the open bin.
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

    /// Bumps reported so far.
    pub fn bumps(&self) -> &[Bump] {
        &self.bumps
    }

    /// All rotations so far.
    pub fn rows(&self) -> &[Row] {
        &self.rows
    }

    /// By camera: observations that could be compared.
    pub fn observations(&self) -> &[u64] {
        &self.observations
    }

    /// Takes in a camera's features at `time`.
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

    /// Takes in the targets, after the features of their time.
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

    /// Checks all waiting features, and ends the open bin.
    pub fn finish(&mut self) {
        if let Some(last) = self.pending.back() {
            self.judge_until(last.observation.time);
        }
        if let Some(open) = self.bin.take() {
            self.close(open);
        }
    }

    /// Stores a camera's features of each target, for its own check and those of others.
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

    /// Checks features up to `until`, for which the others' features have come.
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

    /// Compares a feature with the position of its target by the others.
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

    /// The target's position by all other cameras; `None` if fewer than two agree.
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

    /// Ends the bin that began at `at`, and reports changes.
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
            detected_at: at + options.bin + self.options.max_age,
            turn: change.turn,
            shift_px: change.shift_px,
            sigmas: change.sigmas,
        });
    }

    /// Finalises the size of bumps from rotations after them.
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

/// `camera` with the world in its view rotated by `turn`.
fn turned(camera: &Camera, turn: &Vector3<f64>) -> Camera {
    let turn = Isometry3::from_parts(Translation3::identity(), UnitQuaternion::from_scaled_axis(*turn));
    Camera { camera_from_world: turn * camera.camera_from_world, ..camera.clone() }
}
