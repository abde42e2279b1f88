//! From the features of many cameras, each in its own time, to targets that keep their identity.
//!
//! One frame of one camera at a time [Davis 2002 §3.4]: all filters are carried to its time, each target is projected into
//! that camera and takes the feature that is its own, and each filter takes in that one pixel alone. Nothing waits for a
//! set of cameras to be complete. What no target explains may give birth to one; who is not seen any more dies [§3.6].
//!
//! | step | file |
//! |---|---|
//! | pairs of targets and features | `association` |
//! | births | `birth`, and [`consensus`](crate::consensus) |
//! | deaths | `track`, and here |

mod association;
mod birth;
mod settings;
mod track;

use foveate::geometry::Camera;
use foveate::messages::{CameraSet, Features, How, Interval, Target, TargetId, Targets, Time};
use nalgebra::{Matrix6, Point3, Vector3};

use association::{Association, Gate, widened};
use birth::{Conditions, Nursery};
pub use settings::IntegratorSettings;
use track::{Death, Track};

use crate::consensus::Rules;

/// For how long the acceleration of a target is taken to keep its value [s].
const ACCELERATION_LASTS_S: f64 = 0.1;

/// A newborn target must be seen by this part of `birth_share` of the frames that show its place: less than at its birth,
/// when all cameras' newest frames were looked at and not each one.
const PROBATION_SHARE: f64 = 0.5;

/// What became of a frame.
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

/// What the tracker has seen and done so far.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Tally {
    /// Targets that began.
    pub births: u64,
    /// Targets lost since no camera saw them.
    pub deaths_unseen: u64,
    /// Targets lost since one camera only saw them.
    pub deaths_single_view: u64,
    /// Targets lost since they left the working volume.
    pub deaths_outside: u64,
    /// Targets taken back since too few cameras saw them after their birth.
    pub deaths_unconfirmed: u64,
    /// Targets taken back since they followed the light of an older one.
    pub deaths_duplicate: u64,
    /// Features that belonged to a target.
    pub used: u64,
    /// Features that belonged to none when they came; those of a birth are among them.
    pub unmatched: u64,
    /// Features without finite numbers, or with a covariance that is none.
    pub unusable: u64,
    /// Features in late or repeated frames.
    pub late: u64,
    /// By camera.
    pub cameras: Vec<CameraTally>,
}

/// What became of one camera's frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CameraTally {
    /// Applied.
    pub applied: u64,
    /// Discarded since captured too long before the filter's time.
    pub late: u64,
    /// Discarded since not newer than the one before.
    pub repeated: u64,
}

/// All live targets, and what is needed to carry them on.
#[derive(Debug)]
pub struct Tracker {
    settings: IntegratorSettings,
    cameras: Vec<Camera>,
    /// Opposite corners, the lower one first.
    volume: Option<[Point3<f64>; 2]>,
    /// Ascending by identity.
    tracks: Vec<Track>,
    next_id: u32,
    /// The time that all filters are of.
    time: Option<Time>,
    /// By camera: when its newest frame was captured.
    newest: Vec<Option<Time>>,
    association: Association,
    nursery: Nursery,
    tally: Tally,
}

impl Tracker {
    /// A tracker without targets. `cameras` are all of the calibration, in its order; `settings` have been checked;
    /// `volume` is the working volume by opposite corners [m].
    pub fn new(settings: IntegratorSettings, cameras: Vec<Camera>, volume: Option<[[f64; 3]; 2]>) -> Self {
        let n = cameras.len();
        Self {
            volume: volume.map(|[a, b]| {
                let (a, b) = (Point3::from(a), Point3::from(b));
                [a.inf(&b), a.sup(&b)]
            }),
            settings,
            cameras,
            tracks: Vec::new(),
            next_id: 0,
            time: None,
            newest: vec![None; n],
            association: Association::default(),
            nursery: Nursery::new(n),
            tally: Tally { cameras: vec![CameraTally::default(); n], ..Tally::default() },
        }
    }

    /// Takes in one frame of one camera, captured at `time`.
    pub fn observe(&mut self, time: Time, features: &Features) -> Entry {
        let camera = usize::from(features.camera.0);
        if camera >= self.cameras.len() {
            return Entry::UnknownCamera;
        }
        let filter_time = self.time.map_or(time, |now| now.max(time));
        if filter_time - time > Interval::from_ms(self.settings.late_tolerance_ms) {
            self.tally.cameras[camera].late += 1;
            self.tally.late += features.list.len() as u64;
            return Entry::Late;
        }
        if self.newest[camera].is_some_and(|newest| time <= newest) {
            self.tally.cameras[camera].repeated += 1;
            self.tally.late += features.list.len() as u64;
            return Entry::Repeated;
        }
        self.tally.cameras[camera].applied += 1;
        self.newest[camera] = Some(time);
        self.advance(filter_time);
        self.associate(filter_time, features);
        self.merge(filter_time);
        self.give_birth(time, filter_time, features);
        Entry::Applied
    }

    /// The time that the targets are of; `None` before the first frame.
    pub fn time(&self) -> Option<Time> {
        self.time
    }

    /// How many targets live, without those that are withheld.
    pub fn n_targets(&self) -> usize {
        self.shown().count()
    }

    fn shown(&self) -> impl Iterator<Item = &Track> {
        self.tracks.iter().filter(|it| !it.withheld)
    }

    /// What was seen and done so far.
    pub fn tally(&self) -> &Tally {
        &self.tally
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
            how: How::Predicted,
        });
        for (track, target) in self.shown().zip(&mut targets.list) {
            track.write(targets.time, target);
        }
    }

    /// Carries all filters to `now` and drops who is lost by then.
    fn advance(&mut self, now: Time) {
        let dt_s = self.time.map_or(0.0, |before| (now - before).as_s());
        self.time = Some(now);
        let density = self.settings.acceleration_m_s2.powi(2) * ACCELERATION_LASTS_S;
        let unseen = Interval::from_ms(self.settings.lost_after_ms);
        let single_view = Interval::from_ms(self.settings.single_view_after_ms);
        let share = self.settings.birth_share * PROBATION_SHARE;
        let (tally, volume, margin) = (&mut self.tally, &self.volume, self.settings.volume_margin_mm * 2e-3);
        self.tracks.retain_mut(|track| {
            track.filter.predict(dt_s, density);
            let refuted = track.refuted(now, share);
            let death = track.lost(now, unseen, single_view).or(refuted.then_some(Death::Unconfirmed)).or_else(|| {
                let finite = track.filter.position.coords.sum().is_finite();
                (!finite || !within(volume, margin, &track.filter.position)).then_some(Death::Outside)
            });
            death.inspect(|death| tally.count(*death)).is_none()
        });
    }

    /// Gives each target its feature of this frame.
    fn associate(&mut self, now: Time, features: &Features) {
        let model = &self.cameras[usize::from(features.camera.0)];
        let gate = Gate {
            sigma: self.settings.gate_sigma,
            pixels: self.settings.gate_px,
            camera_variance: self.settings.camera_error_px.powi(2),
        };
        // All pairs are found before the first filter changes.
        self.association.run(&self.tracks, model, &features.list, &gate);
        for pair in self.association.pairs() {
            let track = &mut self.tracks[pair.track];
            let covariance = widened(&features.list[pair.feature].covariance, gate.camera_variance);
            track.filter.update_pixel(pair.innovation, &pair.jacobian, &covariance);
            track.note(features.camera, now);
        }
        for (index, track) in self.tracks.iter_mut().enumerate() {
            if self.association.in_view(index) {
                track.judge(self.association.has_feature(index), self.settings.birth_share);
            }
        }
        self.tally.used += self.association.pairs().len() as u64;
        self.tally.unmatched += self.association.unmatched().count() as u64;
        self.tally.unusable = self.association.unusable;
    }

    /// Takes back the younger of two targets that have been at one place for too long without being seen apart.
    fn merge(&mut self, now: Time) {
        let near = (self.settings.separation_mm * 1e-3).powi(2);
        let patience = Interval::from_ms(self.settings.merge_after_ms);
        let mut index = 0;
        while index < self.tracks.len() {
            let (older, rest) = self.tracks.split_at_mut(index);
            let young = &mut rest[0];
            let place = young.filter.position;
            let twin = older.iter().position(|it| (it.filter.position - place).norm_squared() < near);
            young.beside = twin.and_then(|twin| {
                let apart = self.association.has_feature(twin) && self.association.has_feature(index);
                let since = young.beside.filter(|it| it.0 == older[twin].id).map_or(now, |it| it.1);
                (!apart).then_some((older[twin].id, since))
            });
            if young.beside.is_some_and(|(_, since)| now - since > patience) {
                self.tally.count(Death::Duplicate);
                self.tracks.remove(index);
                self.association.forget_target(index);
            } else {
                index += 1;
            }
        }
    }

    /// Keeps what no target explains, and begins targets where that meets what other cameras left.
    fn give_birth(&mut self, time: Time, now: Time, features: &Features) {
        let camera = features.camera;
        let model = &self.cameras[usize::from(camera.0)];
        self.nursery.record(camera, model, time, &features.list, self.association.unmatched());
        let n_unmatched = self.nursery.n_unmatched(camera);
        if n_unmatched > self.settings.birth_features_max as usize {
            self.nursery.forget(camera);
            return;
        }
        if n_unmatched == 0 {
            return;
        }
        let conditions = Conditions {
            cameras: &self.cameras,
            rules: Rules {
                tolerance: self.settings.birth_tolerance_mm * 1e-3,
                min_cameras: self.settings.birth_cameras as usize,
                min_sine: self.settings.birth_angle_deg.to_radians().sin(),
            },
            share: self.settings.birth_share,
            stale_after: Interval::from_ms(self.settings.stale_after_ms),
            speed: self.settings.birth_speed_m_s,
            camera_variance: self.settings.camera_error_px.powi(2),
        };
        let (volume, margin) = (&self.volume, self.settings.volume_margin_mm * 1e-3);
        let separation = self.settings.separation_mm * 1e-3;
        let probation = Interval::from_ms(self.settings.probation_ms);
        let alone = |tracks: &[Track], point: &Point3<f64>| {
            tracks.iter().all(|it| (it.filter.position - point).norm_squared() >= separation * separation)
        };
        let tracks = &self.tracks;
        let n_meetings = self
            .nursery
            .meetings(camera, now, &conditions, |point| within(volume, margin, point) && alone(tracks, point))
            .len();
        for index in 0..n_meetings {
            let Some(meeting) = self.nursery.meeting(index) else { break };
            let Some(filter) = self.nursery.filter(meeting, now, &conditions) else { continue };
            if !alone(&self.tracks, &filter.position) || !within(volume, margin, &filter.position) {
                continue; // of two meetings around one light the better one came first
            }
            let mut track = Track::new(TargetId(self.next_id), filter, now, camera, probation);
            track.withheld = self.nursery.share(meeting, now, &conditions) < self.settings.birth_sure_share;
            let witnesses = self.nursery.witnesses(meeting).filter(|(_, seen_at)| *seen_at == time);
            witnesses.for_each(|(witness, _)| track.cameras.insert(witness));
            let place = track.filter.position;
            self.next_id += 1;
            self.tally.births += 1;
            self.tracks.push(track);
            self.nursery.consume(&place, 2.0 * conditions.rules.tolerance);
        }
    }
}

impl Tally {
    fn count(&mut self, death: Death) {
        *match death {
            Death::Unseen => &mut self.deaths_unseen,
            Death::SingleView => &mut self.deaths_single_view,
            Death::Outside => &mut self.deaths_outside,
            Death::Unconfirmed => &mut self.deaths_unconfirmed,
            Death::Duplicate => &mut self.deaths_duplicate,
        } += 1;
    }
}

/// Whether `point` lies within `margin` of `volume`; everywhere where no volume is stated.
fn within(volume: &Option<[Point3<f64>; 2]>, margin: f64, point: &Point3<f64>) -> bool {
    let Some([low, high]) = volume else { return true };
    (0..3).all(|axis| (low[axis] - margin..=high[axis] + margin).contains(&point[axis]))
}
