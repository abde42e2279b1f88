//! Pointers on a wall, from the spots that each camera finds at its own times: the algorithm of `laser_pointer.tracker`.
//!
//! For each frame, in the order of delivery: its spots become places on the wall, each with the covariance of the spot and of the camera's map. Spots dimmer than the
//! wall itself can be, too large, or outside of the wall are left out. Pointers are predicted to the frame's time and take the places at the least sum of squared
//! Mahalanobis distances plus ln det S, within a gate. What is left may be new: a pointer begins when a second camera that sees the place sees the spot there, too, or, where one camera
//! sees it alone, when the spot stays. A place that one camera reports and another, which sees it, does not, is disputed: what no second camera ever saw ends there. A bezel
//! mirrors a spot along a row or a column of displays: what is level with a larger spot nearby, or plumb with it, does not begin a pointer as long as it stays so.
//!
//! Mirror lines of bezels are learnt (`mirrors`); from then on a reflection is known by its place. A pointer that has moved to a reflection is moved back to the spot.
//!
//! A spot that is one with another, or with its own reflection, is shifted. So each observation has two hypotheses: it is as accurate as its covariance, or, less likely, off by a
//! third of the width at which spots touch; the likelier one is used. A spot that is suddenly half as large again counts as that of two pointers, even before the second is known.
//!
//! Two pointers whose spots touch are one spot in the picture. Both are updated with it, with a covariance that spans both, and not for longer
//! than it takes to cross.
//!
//! Where users' pointers have blink codes, each frame also updates its pointers' decoders (`codes`); where they have colours, each spot's label updates their colour (`colours`), which
//! also enters the assignment. The user is decided from both (`users`).

use std::collections::BTreeMap;

use foveate::estimation::assignment::{self, Workspace};
use foveate::estimation::{Filter, Model};
use foveate::prelude::*;
use foveate::scene::WallMap;
use nalgebra::{Matrix2, Matrix2x3, Matrix3, Point2, Point3, Vector3};

use super::codes::Decoder;
use super::colours::Belief;
use super::health;
use super::mirrors::{Mirrors, Seen as Spot};
use super::settings::TrackerSettings;
use super::users::{UserTally, UsersOfTracks};

/// The wall's plane in the filters' space.
const ON_WALL: Matrix2x3<f64> = Matrix2x3::new(1.0, 0.0, 0.0, 0.0, 1.0, 0.0);
/// A pixel this bright is full: how much light fell on it is not known [gray level].
const FULL: u8 = 250;
/// A reflection is level or plumb with its spot to this [m].
const LEVEL_M: f64 = 5e-3;
/// Two pointers share a spot no longer than this [s].
const MERGED_S: f64 = 0.25;
/// A reflection is this much smaller than its spot, or dimmer: area over area [–].
const SMALLER: f64 = 0.8;
/// Prior odds that a spot is shifted, as minus twice their logarithm: one in fifty.
const SHIFTED: f64 = 7.8;
/// The same for a pointer whose spot looks like a reflection: it would be a reflection by chance.
const MIRRORED: f64 = 6.0;
/// A reflection is no larger than this, relative to its spot: a window of the wall behind it lets it look larger than it is [–].
const LARGER: f64 = 1.3;
/// Spots may lie so far beside the wall: on its frame, or by the error of a map [m].
const BESIDE_M: f64 = 0.01;
/// What was not seen for longer than this may be another light when it is seen again: more than the time between two frames of one camera at 60 Hz [s].
const DARK_S: f64 = 0.025;
/// A camera that has been silent for so long counts as gone [s].
const SILENT_S: f64 = 0.1;
/// A spot this near to the edge of a picture may be cut off [px]: its centre may be off by [`CUT_PX`] then.
const EDGE_PX: f64 = 3.0;
const CUT_PX: f64 = 1.0;
/// What a candidate's place costs more than a pointer's: a candidate takes none from a pointer.
const CANDIDATES_LATER: f64 = 1e3;
/// A spot that the edge of a picture cuts is smaller for a while: of its largest area a pointer forgets so much with each frame [–].
const AREA_KEPT: f64 = 0.97;
/// A spot this much larger than the pointer's usual one is more than one [–]; of the usual one each frame counts so much [–], once there were so many.
const GROWN: f64 = 1.5;
const USUAL: f64 = 0.1;
const GROWN_AFTER: u32 = 4;
/// Pointers nearer to each other than this may be taken for each other, in widths of two spots that touch [–].
const MIXED: f64 = 1.5;
/// What begins nearer to a pointer than this, in widths of two spots that touch, must stay as long as what was once mirrored [–].
const NEAR_MERGES: f64 = 2.5;
/// What was once mirrored must be by itself for so many frames.
const CLEAR_FRAMES: u32 = 4;
/// Frames of a camera in which it must see a spot that another one reports, until the place is disputed.
const DISPUTED_FRAMES: u32 = 3;

/// Counts of spots over all frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Tally {
    /// Spots received.
    pub spots: u64,
    /// Too dim: the wall itself can be as bright.
    pub dim: u64,
    /// Too large.
    pub large: u64,
    /// Outside of the wall.
    pub beside: u64,
    /// Frames that came after a later one.
    pub late: u64,
    /// Pointers that began.
    pub begun: u64,
    /// Candidates that disappeared too early or that no second camera confirmed.
    pub dropped: u64,
    /// Mirror lines of bezels, over all cameras.
    pub bezels: u64,
}

/// A spot on the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    point: Point2<f64>,
    covariance: Matrix2<f64>,
    /// Area on the wall [m²].
    area: f64,
    peak: u8,
    /// Label of its colour by the detector.
    label: Option<u32>,
    /// It may be the reflection of a larger one.
    is_mirrored: bool,
    /// The spot of this picture that it is the reflection of, in a known bezel.
    source: Option<usize>,
}

/// A confirmed or tentative pointer.
#[derive(Debug, Clone)]
pub(super) struct Track {
    pub(super) id: Option<TargetId>,
    filter: Filter,
    /// Of the filter's state.
    time: Time,
    /// By camera, when it was last seen, and how many of the camera's frames since then should have shown it.
    cameras: BTreeMap<CameraId, Seen>,
    /// When any camera saw it last.
    seen: Time,
    /// Frames in which it was seen.
    frames: u32,
    /// When it last had a spot of its own.
    owned: Time,
    /// Frames since its spot may have been the reflection of a larger one.
    clear: u32,
    /// Its recent largest spot [m²].
    area: f64,
    /// Running mean of its unmerged spots [m²].
    usual: f64,
    /// This frame's camera saw it.
    pub(super) is_measured: bool,
    /// State of its code; `None` where no user has one.
    pub(super) decoder: Option<Decoder>,
    /// State of its colour; `None` where no user has one.
    pub(super) belief: Option<Belief>,
    /// Its user.
    pub(super) user: Option<u32>,
    /// Since when it may be exchanged with another pointer, as their spots were one, until its user is decided again.
    pub(super) mixed: Option<Time>,
    /// It was dark for longer than a frame since its user was decided: it may be another pointer, too.
    pub(super) dark: bool,
    /// A fault of its code has been counted.
    pub(super) is_counted: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Seen {
    frames: u32,
    missed: u32,
}

impl Track {
    /// Consecutive labels of the same colour; unlimited where colours are not used.
    pub(super) fn run(&self) -> u32 {
        self.belief.as_ref().map_or(u32::MAX, Belief::run)
    }
}

/// The pointers on one wall.
pub struct Pointers {
    settings: TrackerSettings,
    size: [f64; 2],
    /// By the camera's number; cameras that the map lacks have none.
    cameras: Vec<Option<foveate::scene::WallCamera>>,
    /// Time of each camera's last frame.
    last_frames: Vec<Option<Time>>,
    tracks: Vec<Track>,
    next: u32,
    latest: Option<Time>,
    tally: Tally,
    /// By the camera's number.
    health: Vec<health::Camera>,
    /// Pairs of cameras that disagreed, with counts: the one that saw a spot, the one that did not.
    disputes: BTreeMap<(CameraId, CameraId), u64>,
    costs: Vec<f64>,
    /// By track and place as `costs`: the hypothesis of a shifted spot is likelier.
    shifted: Vec<bool>,
    mirrors: Mirrors,
    seen: Vec<Spot>,
    assigned: Vec<Option<usize>>,
    workspace: Workspace,
    places: Vec<Place>,
    users: Option<UsersOfTracks>,
}

impl Pointers {
    /// For cameras of these names, in the order of their numbers, and the wall of `map`.
    pub fn new(settings: TrackerSettings, map: &WallMap, names: &[String]) -> Pointers {
        Pointers {
            users: UsersOfTracks::new(&settings),
            settings,
            size: map.size_m,
            cameras: names.iter().map(|it| map.cameras.get(it).cloned()).collect(),
            last_frames: vec![None; names.len()],
            tracks: Vec::new(),
            next: 1,
            latest: None,
            tally: Tally::default(),
            health: vec![health::Camera::default(); names.len()],
            disputes: BTreeMap::new(),
            costs: Vec::new(),
            shifted: Vec::new(),
            mirrors: Mirrors::new(names.len()),
            seen: Vec::new(),
            assigned: Vec::new(),
            workspace: Workspace::default(),
            places: Vec::new(),
        }
    }

    /// Counts of spots.
    pub fn tally(&self) -> Tally {
        Tally { bezels: self.mirrors.count() as u64, ..self.tally }
    }

    /// Pairs of cameras that disagreed: the one that saw a spot, the one that should have seen it, how often.
    pub fn disputes(&self) -> impl Iterator<Item = (CameraId, CameraId, u64)> + '_ {
        self.disputes.iter().map(|((saw, not), count)| (*saw, *not, *count))
    }

    /// Remarks on cameras or settings, for cameras of these names.
    pub fn remarks(&self, names: &[String]) -> Vec<String> {
        let decided = self.users_tally().map(|it| it.decided);
        health::remarks(&self.health, names, &self.settings, self.tally.begun, decided)
    }

    /// Users of the pointers after the frame at `time`; `None` where no user has a code or a colour.
    pub fn users(&mut self, time: Time) -> Option<Users> {
        Some(self.users.as_mut()?.report(time, &self.tracks))
    }

    /// Counts of decisions about users; `None` where no user has a code or a colour.
    pub fn users_tally(&self) -> Option<&UserTally> {
        self.users.as_ref().map(UsersOfTracks::tally)
    }

    /// Takes in the spots of one camera at one time, and writes all pointers at that time into `targets`. `false`, without any output, for a frame that comes after
    /// a later one, and for a camera without a map.
    pub fn take_in(&mut self, time: Time, features: &Features, targets: &mut Targets) -> bool {
        let camera = features.camera;
        let number = usize::from(camera.0);
        self.tally.spots += features.list.len() as u64;
        if self.cameras.get(number).is_none_or(Option::is_none) {
            return false;
        }
        self.health[number].frame(time, self.latest);
        if self.latest.is_some_and(|it| time < it) {
            self.tally.late += 1;
            return false;
        }
        (self.latest, self.last_frames[number]) = (Some(time), Some(time));
        self.place(number, time, &features.list);
        self.end_lost(time);
        for track in &mut self.tracks {
            track.filter.predict((time - track.time).as_s());
            (track.time, track.is_measured) = (time, false);
        }
        self.assign();
        self.update(camera, time);
        self.decode(number, time);
        self.begin(camera, time);
        self.judge(time);
        if let Some(users) = &mut self.users {
            users.decide(&mut self.tracks, &mut self.next, time);
        }
        self.report(time, camera, targets);
        true
    }

    /// Ends pointers that no camera has seen for too long, before this frame's spots are assigned: a later light is a new pointer.
    fn end_lost(&mut self, time: Time) {
        let lost = Interval::from_ms(self.settings.lost_ms);
        let is_over = |it: &Track| time - it.seen > lost;
        self.tally.dropped += self.tracks.iter().filter(|it| it.id.is_none() && is_over(it)).count() as u64;
        self.tracks.retain(|it| !is_over(it));
    }

    /// Places of the spots on the wall; spots that cannot be pointers are left out.
    fn place(&mut self, number: usize, time: Time, features: &[Feature]) {
        self.places.clear();
        let Some(camera) = &self.cameras[number] else { return };
        let least = camera.brightest * self.settings.brighter;
        let map_variance = (self.settings.map_mm * 1e-3).powi(2);
        for it in features {
            if it.peak < FULL && f64::from(it.peak) < least {
                self.tally.dim += 1;
                continue;
            }
            let health = &mut self.health[number];
            health.bright += 1;
            health.labelled += u64::from(it.label.is_some());
            let inside =
                |point: &Point2<f64>| (0..2).all(|axis| (-BESIDE_M..self.size[axis] + BESIDE_M).contains(&point[axis]));
            let [width, height] = camera.map.image_size.map(f64::from);
            let inside_by = [it.centre.x, it.centre.y, width - 1.0 - it.centre.x, height - 1.0 - it.centre.y];
            let is_cut = inside_by.into_iter().any(|it| it < EDGE_PX);
            let cut = if is_cut { CUT_PX * CUT_PX } else { 0.0 };
            let covariance = it.covariance + Matrix2::identity() * cut;
            let Some(placed) = camera.map.place(&it.centre, &covariance).filter(|it| inside(&it.point)) else {
                self.tally.beside += 1;
                health.beside += 1;
                continue;
            };
            let area = f64::from(it.area) * placed.plane_by_pixel.determinant().abs();
            if area.sqrt() > self.settings.largest_mm * 1e-3 {
                self.tally.large += 1;
                health.large += 1;
                continue;
            }
            let covariance = placed.covariance + Matrix2::identity() * map_variance;
            self.places.push(Place {
                point: placed.point,
                covariance,
                area,
                peak: it.peak,
                label: it.label,
                is_mirrored: false,
                source: None,
            });
        }
        let reach = self.settings.reflection_mm * 1e-3;
        self.seen.clear();
        self.seen.extend(self.places.iter().map(|it| Spot { point: it.point, area: it.area }));
        self.mirrors.learn(number, time, &self.seen, reach);
        let camera_number = number;
        for number in 0..self.places.len() {
            let place = self.places[number];
            let is_beside = |point: &Point2<f64>, level: f64| {
                let off = point - place.point;
                off.norm() < reach && off.amin() < level
            };
            let by_spot = self.places.iter().any(|it| {
                let is_smaller = place.area < SMALLER * it.area || f64::from(place.peak) < SMALLER * f64::from(it.peak);
                is_smaller && is_beside(&it.point, LEVEL_M)
            });
            // The spot itself may lie outside this camera's picture.
            let by_pointer = self.tracks.iter().filter(|it| it.id.is_some()).any(|it| {
                let point = it.filter.position_after((time - it.time).as_s()).xy();
                let is_outside = !camera.map.sees(&point, self.settings.margin_px);
                is_outside && place.area < SMALLER * it.area && is_beside(&point, 2.0 * LEVEL_M)
            });
            // Where a bezel is known, the place alone tells.
            let by_line = |point: &Point2<f64>| self.mirrors.mirrors(camera_number, &place.point, point);
            let is_source = |it: &Place| it.point != place.point && place.area < LARGER * it.area && by_line(&it.point);
            let source = self.places.iter().position(is_source);
            let of_pointer = self
                .tracks
                .iter()
                .filter(|it| it.id.is_some())
                .any(|it| by_line(&it.filter.position_after((time - it.time).as_s()).xy()));
            self.places[number].source = source;
            self.places[number].is_mirrored = by_spot || by_pointer || source.is_some() || of_pointer;
        }
    }

    fn assign(&mut self) {
        let gate = self.settings.gate_sigmas.powi(2);
        let shift = (self.settings.merge_mm * 1e-3 / 3.0).powi(2);
        self.costs.clear();
        self.shifted.clear();
        let mut most: f64 = gate;
        for track in &self.tracks {
            for place in &self.places {
                let off = place.point - track.filter.position().xy();
                // Minus twice the log of the likelihood, for a spot that is what it seems to be and for one that is shifted by what it is one with.
                let cost_with = |more: f64| {
                    let covariance = place.covariance + Matrix2::identity() * more;
                    let s = track.filter.innovation_covariance(&ON_WALL, &covariance);
                    let distance = s.try_inverse().map_or(f64::INFINITY, |it| off.dot(&(it * off)));
                    // Relative to a micrometre, so that the term is positive: one that is known well goes first.
                    let density = (s.determinant() * 1e24).ln();
                    if distance <= gate { distance + density } else { f64::INFINITY }
                };
                let (clean, shifted) = (cost_with(0.0), cost_with(shift) + SHIFTED);
                let later = if track.id.is_some() { 0.0 } else { CANDIDATES_LATER };
                let colours = self.users.as_ref().and_then(UsersOfTracks::colours).zip(track.belief.as_ref());
                let later = later + colours.map_or(0.0, |(colours, belief)| colours.cost(belief, place.label));
                // A reflection is not taken for the spot, which may lie outside the picture.
                let is_own = track.id.is_none() || !place.is_mirrored || off.norm() < LEVEL_M;
                let later = later + if place.is_mirrored { MIRRORED } else { 0.0 };
                let cost = if is_own { clean.min(shifted) + later } else { f64::INFINITY };
                most = if cost.is_finite() { most.max(cost) } else { most };
                self.costs.push(cost);
                self.shifted.push(shifted < clean);
            }
        }
        let (rows, columns) = (self.tracks.len(), self.places.len());
        // As many as possible get a place.
        let alone = most * (rows + 1) as f64;
        assignment::optimal(&self.costs, rows, columns, alone, &mut self.workspace, &mut self.assigned);
        self.leave_reflections();
    }

    /// Moves a pointer from a reflection back to the spot itself, unless that is another pointer's.
    fn leave_reflections(&mut self) {
        let model = Model::ConstantVelocity { acceleration_density: self.settings.acceleration_density };
        for row in 0..self.tracks.len() {
            let Some(place) = self.assigned[row].filter(|_| self.tracks[row].id.is_some()) else { continue };
            let Some(source) = self.places[place].source else { continue };
            let holder = self.assigned.iter().position(|it| *it == Some(source));
            if holder.is_some_and(|it| self.tracks[it].id.is_some()) {
                self.assigned[row] = None;
                continue;
            }
            if let Some(holder) = holder {
                self.assigned[holder] = None;
            }
            self.assigned[row] = Some(source);
            let point = self.places[source].point;
            let mut covariance = Matrix3::identity() * 1e-12;
            covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&self.places[source].covariance);
            let track = &mut self.tracks[row];
            let velocity = track.filter.velocity();
            track.filter =
                Filter::new(&model, Point3::new(point.x, point.y, 0.0), covariance, velocity, self.settings.speed);
        }
    }

    fn update(&mut self, camera: CameraId, time: Time) {
        let merge = self.settings.merge_mm * 1e-3;
        let before: Vec<Point2<f64>> = self.tracks.iter().map(|it| it.filter.position().xy()).collect();
        let may_share: Vec<bool> = self.tracks.iter().map(|it| it.id.is_some()).collect();
        for row in 0..self.tracks.len() {
            let own = self.assigned[row];
            // A spot beside which another pointer is expected that got none is the spot of both.
            let shared = match own {
                Some(place) => (0..before.len()).find(|&other| {
                    other != row
                        && may_share[other]
                        && self.assigned[other].is_none()
                        && (before[other] - self.places[place].point).norm() < merge
                }),
                None => None,
            };
            let lent = || {
                let taken = self.assigned.iter().flatten().copied();
                let near = taken.filter(|it| (before[row] - self.places[*it].point).norm() < merge);
                near.min_by(|a, b| {
                    let far = |it: &usize| (before[row] - self.places[*it].point).norm();
                    far(a).total_cmp(&far(b))
                })
            };
            let place = match own {
                Some(place) => place,
                None if may_share[row] && (time - self.tracks[row].owned).as_s() < MERGED_S => match lent() {
                    Some(place) => place,
                    None => continue,
                },
                None => continue,
            };
            let Place { point, mut covariance, is_mirrored, area, .. } = self.places[place];
            // A spot that has grown at once is one with another that nobody knows of yet.
            let has_grown = area > GROWN * self.tracks[row].usual && self.tracks[row].frames >= GROWN_AFTER;
            if shared.is_some() || own.is_none() || has_grown {
                covariance += Matrix2::identity() * (merge * merge / 4.0);
            } else if self.shifted[row * self.places.len() + place] {
                covariance += Matrix2::identity() * (merge * merge / 9.0);
            }
            let track = &mut self.tracks[row];
            let off = point - track.filter.position().xy();
            if (time - track.seen).as_s() > DARK_S {
                track.dark = true;
                track.belief.iter_mut().for_each(Belief::doubt);
            }
            track.filter.update_pixel(off, &ON_WALL, &covariance);
            (track.seen, track.is_measured) = (time, true);
            track.clear = if is_mirrored { 0 } else { track.clear + 1 };
            if own.is_some() {
                (track.owned, track.area) = (time, area.max(AREA_KEPT * track.area));
                track.usual += USUAL * (area - track.usual);
            }
            track.frames += 1;
            let seen = track.cameras.entry(camera).or_default();
            (seen.frames, seen.missed) = (seen.frames + 1, 0);
        }
        let Some(map) = self.cameras[usize::from(camera.0)].as_ref().map(|it| &it.map) else { return };
        for track in self.tracks.iter_mut().filter(|it| !it.is_measured) {
            if map.sees(&track.filter.position().xy(), self.settings.margin_px) {
                track.cameras.entry(camera).or_default().missed += 1;
            }
        }
    }

    /// Updates the decoders and colours of all pointers that this camera sees with this frame's spots.
    fn decode(&mut self, camera: usize, time: Time) {
        let (Some(users), Some(camera)) = (&self.users, &self.cameras[camera]) else { return };
        let merge = self.settings.merge_mm * 1e-3;
        let points: Vec<Point2<f64>> = self.tracks.iter().map(|it| it.filter.position().xy()).collect();
        let known: Vec<bool> = self.tracks.iter().map(|it| it.id.is_some()).collect();
        for (row, track) in self.tracks.iter_mut().enumerate() {
            let is_near = |it: &Point2<f64>, reach: f64| (it - points[row]).norm() < reach;
            // Whose light it is nobody can say, nor whose it will be afterwards.
            if (0..points.len()).any(|it| it != row && known[it] && is_near(&points[it], MIXED * merge)) {
                if let (Some(codes), Some(decoder)) = (users.codes(), &mut track.decoder) {
                    *decoder = codes.decoder(time);
                }
                track.mixed = track.mixed.or(Some(time));
                track.belief.iter_mut().for_each(Belief::doubt);
                continue;
            }
            // The flanks of a spot have light of another one that is somewhat farther away.
            let own = self.assigned.get(row).copied().flatten().map(|it| self.places[it]);
            let is_clear = |own: &Place| {
                let near = |it: &Point2<f64>| (it - own.point).norm() < NEAR_MERGES * merge;
                !(0..points.len()).any(|it| it != row && known[it] && near(&points[it]))
                    && !self.places.iter().any(|it| it.point != own.point && near(&it.point))
            };
            if let (Some(colours), Some(belief), Some(own)) = (users.colours(), &mut track.belief, own)
                && is_clear(&own)
            {
                colours.observe(belief, time, own.label);
            }
            let (Some(codes), Some(decoder)) = (users.codes(), &mut track.decoder) else { continue };
            // A spot that another one took, or a reflection, is no sign that it was dark.
            let is_dark = !track.is_measured
                && camera.map.sees(&points[row], self.settings.margin_px)
                && !self.places.iter().any(|it| is_near(&it.point, merge));
            if track.is_measured || is_dark {
                codes.observe(decoder, time, track.is_measured);
            }
        }
    }

    /// Initiates candidates from the unassigned places.
    fn begin(&mut self, camera: CameraId, time: Time) {
        let TrackerSettings { merge_mm, acceleration_density, speed, .. } = self.settings;
        let model = Model::ConstantVelocity { acceleration_density };
        for (number, place) in self.places.iter().enumerate() {
            if self.assigned.contains(&Some(number)) {
                continue;
            }
            // Beside a pointer that has its spot: a part of that spot.
            let is_part = self
                .tracks
                .iter()
                .any(|it| it.is_measured && (it.filter.position().xy() - place.point).norm() < merge_mm * 0.5e-3);
            if is_part {
                continue;
            }
            // Near a pointer that has just been seen, what begins may be a part of its spot that a bezel mirrors or parts.
            let is_near = self.tracks.iter().any(|it| {
                it.id.is_some() && (it.filter.position().xy() - place.point).norm() < NEAR_MERGES * merge_mm * 1e-3
            });
            let mut covariance = Matrix3::identity() * 1e-12;
            covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&place.covariance);
            let start = Point3::new(place.point.x, place.point.y, 0.0);
            let filter = Filter::new(&model, start, covariance, Vector3::zeros(), speed);
            self.tracks.push(Track {
                id: None,
                filter,
                time,
                cameras: [(camera, Seen { frames: 1, missed: 0 })].into(),
                seen: time,
                frames: 1,
                owned: time,
                clear: if place.is_mirrored || is_near { 0 } else { CLEAR_FRAMES },
                area: place.area,
                usual: place.area,
                is_measured: true,
                decoder: self.users.as_ref().and_then(|it| Some(it.codes()?.decoder(time))),
                belief: self.users.as_ref().and_then(|it| {
                    let mut belief = it.colours()?.belief(time);
                    it.colours()?.observe(&mut belief, time, place.label);
                    Some(belief)
                }),
                user: None,
                mixed: None,
                dark: false,
                is_counted: false,
            });
        }
    }

    /// Ends disputed candidates; confirms those that cameras agree on.
    fn judge(&mut self, time: Time) {
        let mut number = 0;
        while number < self.tracks.len() {
            let track = &self.tracks[number];
            let point = track.filter.position().xy();
            let sees = |it: usize| {
                let is_up = self.last_frames[it].is_some_and(|last| (time - last).as_s() < SILENT_S);
                is_up && self.cameras[it].as_ref().is_some_and(|it| it.map.sees(&point, self.settings.margin_px))
            };
            let watchers = (0..self.cameras.len()).filter(|it| sees(*it)).count();
            let saw = track.cameras.iter().filter(|it| it.1.frames > 0 && it.1.missed < DISPUTED_FRAMES);
            let saw: Vec<CameraId> = saw.map(|it| *it.0).collect();
            let did_not = track.cameras.iter().find(|it| it.1.missed >= DISPUTED_FRAMES && sees(usize::from(it.0.0)));
            let dispute = did_not.and_then(|it| Some((*saw.first()?, *it.0)));
            let agree = track.cameras.values().filter(|it| it.frames > 0).count();
            if let Some(pair) = dispute.filter(|_| agree < 2) {
                *self.disputes.entry(pair).or_default() += 1;
                self.tally.dropped += u64::from(track.id.is_none());
                self.tracks.swap_remove(number);
                continue;
            }
            let stays = watchers < 2 && track.frames >= self.settings.alone_frames;
            if track.id.is_none() && track.clear >= CLEAR_FRAMES && (agree >= 2 || stays) {
                self.tracks[number].id = Some(TargetId(self.next));
                self.next += 1;
                self.tally.begun += 1;
            }
            number += 1;
        }
    }

    fn report(&mut self, time: Time, camera: CameraId, targets: &mut Targets) {
        targets.time = time;
        targets.list.clear();
        for track in &self.tracks {
            let Some(id) = track.id else { continue };
            let mut cameras = CameraSet::default();
            if track.is_measured {
                cameras.insert(camera);
            }
            targets.list.push(Target {
                id,
                position: track.filter.position(),
                velocity: track.filter.velocity(),
                covariance: track.filter.covariance(),
                cameras,
                provenance: if track.is_measured { Provenance::Measured } else { Provenance::Predicted },
            });
        }
        targets.list.sort_by_key(|it| it.id);
    }
}
