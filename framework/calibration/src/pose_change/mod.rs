//! A camera that was moved during the recording: two poses, one before and one after a moment, with the same optics, in a room that is adjusted
//! with all other cameras at once.
//!
//! A room of few cameras whose optics are free bends until a shift of some pixels shows in no camera's residuals. So a second pose is not searched against points
//! from the other cameras, but with everything else free to follow it: first to first order, for each camera and each moment (the score test),
//! then the best few for good, from coarse to fine. A lens that differs from its model asks for a second pose too where the light goes from
//! one part of a picture to another; it gains little by it, and evenly, so a move must leave residuals that are several times smaller.

mod system;

use foveate_estimation::Loss;
use foveate_estimation::statistics::median;
use foveate_geometry::Camera;
use foveate_geometry::bundle::{Freedom, OpticsPrior};
use nalgebra::{DMatrix, DVector, Point2, Point3, Vector3};

use crate::cause::{CameraFault, Cause};
use crate::solved::SolvedPoint;

use self::system::{POSE, Reduced, Second, Seen, State, System, Track, centred};

/// An observation of a camera.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Observed {
    pub camera: usize,
    pub pixel: Point2<f64>,
}

/// What was seen of a point, and about where it is.
#[derive(Debug, Clone)]
pub(crate) struct Witness {
    pub time_s: f64,
    pub point: Point3<f64>,
    pub observed: Vec<Observed>,
}

impl Witness {
    /// Without observations.
    pub(crate) fn of(point: &SolvedPoint) -> Witness {
        Witness { time_s: point.time_s, point: point.position, observed: Vec::new() }
    }
}

/// What is known of a camera: as it stands, what of it was found, and what is known of its optics beside that; `None` where it has no pose.
pub(crate) type Member = Option<(Camera, Freedom, OpticsPrior)>;

/// A camera that was moved.
#[derive(Debug, Clone)]
pub(crate) struct PoseChange {
    pub camera: usize,
    /// Time [s].
    pub at_s: f64,
    /// Median distance of where it sees points before from where it sees them after [px].
    pub shift_px: f64,
    /// By how much it turned [rad].
    pub turn: f64,
    /// How far its centre went [unit of the room].
    pub distance: f64,
    /// Share of its observations that fit with one pose, and with two [–].
    pub shares: [f64; 2],
}

impl PoseChange {
    /// As a fault of the camera.
    pub(crate) fn culprit(&self) -> CameraFault {
        let PoseChange { camera, at_s, shift_px, turn, distance, shares } = *self;
        CameraFault { camera, cause: Cause::Moved { at_s: Some(at_s), shift_px, turn, distance }, shares }
    }
}

/// Points that are enough [–].
const ENOUGH: usize = 700;
/// Moments that are compared [–].
const BINS: usize = 24;
/// Observations of the camera before and after [–].
const LEAST_ROWS: usize = 20;
/// Blurs under which a second pose is searched to first order, each with the number of cameras that are then examined fully [–]: where a camera was moved
/// by much, the room follows one of its parts, and the other part counts only from afar.
const SEARCHES: [(f64, usize); 2] = [(1.0, 2), (16.0, 4)];
/// No residuals are taken for better than that [px].
const TRIFLE_PX: f64 = 0.1;
/// From coarse to fine [–].
const BLURS: [f64; 3] = [16.0, 4.0, 1.0];
/// Two poses must lower the cost of all observations by this part [–]…
const LEAST_SHARE: f64 = 0.08;
/// … and by so many observations' worth more: over few, lens and noise ask for a second pose by chance [–].
const BY_CHANCE: f64 = 130.0;
/// A second pose that gains less than this part of that to first order is not searched [–]: cameras that were moved give 0.5 and more, even by
/// 20 pixels, and clean recordings 0.1 to 0.4.
const LIKELY: f64 = 0.4;
/// What the two poses have apart is at least so large [px]…
const LEAST_SHIFT_PX: f64 = 1.0;
/// … and so many times what observations are off with both, in the median [–].
const SHIFT_RATIO: f64 = 4.0;
/// Before and after the camera has seen points in so many places [–]: a pose has six freedoms, and a light that is held still for a while is one place, to which any
/// disturbance of some seconds fits a pose of its own.
const LEAST_PLACES: usize = 8;
/// So far apart in the picture, as a part of its width [–].
const PLACES_APART: f64 = 0.03;
/// With both poses every camera fits so large a part of its observations; where another does not, something else is wrong [–].
const ALL_FIT: f64 = 0.8;

/// The camera that was moved, if one was.
pub(crate) fn pose_change(members: &[Member], witnesses: &[Witness], inlier_px: f64) -> Option<PoseChange> {
    let slots: Vec<usize> = (0..members.len()).filter(|it| members[*it].is_some()).collect();
    if slots.len() < 2 {
        return None;
    }
    let slot_of = |camera: usize| slots.iter().position(|it| *it == camera);
    let is_finite = |it: &Point3<f64>| it.coords.norm().is_finite();
    let useful: Vec<&Witness> = witnesses
        .iter()
        .filter(|it| is_finite(&it.point) && it.observed.iter().filter(|it| members[it.camera].is_some()).count() > 1)
        .collect();
    let every = useful.len().div_ceil(ENOUGH).max(1);
    let mut chosen: Vec<&Witness> = useful.into_iter().step_by(every).collect();
    chosen.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    if chosen.len() < 2 * LEAST_ROWS {
        return None;
    }
    let middle = chosen.iter().fold(Vector3::zeros(), |sum, it| sum + it.point.coords) / chosen.len() as f64;
    let seen = |it: &Observed| Some(Seen { slot: slot_of(it.camera)?, pixel: it.pixel });
    let tracks: Vec<Track> = chosen
        .iter()
        .map(|it| Track { time_s: it.time_s, seen: it.observed.iter().filter_map(seen).collect() })
        .collect();
    let known: Vec<&(Camera, Freedom, OpticsPrior)> = slots.iter().filter_map(|it| members[*it].as_ref()).collect();
    let freed: Vec<Freedom> = known.iter().map(|it| it.1).collect();
    let system = System::new(tracks, &freed, known.iter().map(|it| it.2.clone()).collect());
    let start = State {
        cameras: known.iter().map(|it| centred(&it.0, &middle)).collect(),
        points: chosen.iter().map(|it| it.point - middle).collect(),
        second: None,
        cost: f64::INFINITY,
    };
    let looked = Looked { system: &system, freed: &freed, inlier_px };
    let (plain, found, sigma_px) = looked.best(&start)?;
    looked.accepted(&plain, &found, sigma_px, &slots)
}

struct Looked<'a> {
    system: &'a System,
    freed: &'a [Freedom],
    inlier_px: f64,
}

struct Candidate {
    slot: usize,
    at_s: f64,
    gain: f64,
}

impl Looked<'_> {
    /// The room with one pose for each camera, and with the second pose that lowers its cost most; and the standard deviation of a pixel [px].
    fn best(&self, start: &State) -> Option<(State, State, f64)> {
        let system = self.system;
        let all = self.residuals(start, None);
        let sigma_px = (median(&all)? / 1.18).max(TRIFLE_PX);
        let plain = system.adjust(start.clone(), sigma_px);
        let after = self.residuals(&plain, None);
        let sigma_px = (median(&after)? / 1.18).max(TRIFLE_PX);
        let plain = system.adjust(plain, sigma_px);
        let likely = self.scores(&plain, sigma_px).iter().map(|it| it.gain).fold(0.0, f64::max);
        if likely < LIKELY * self.needed(&plain) {
            return None;
        }
        let mut candidates: Vec<Candidate> = Vec::new();
        for (blur, most) in SEARCHES {
            let mut list = self.scores(&plain, blur * sigma_px);
            list.sort_by(|a, b| b.gain.total_cmp(&a.gain));
            for it in list.into_iter().take(most) {
                if candidates.iter().all(|known| known.slot != it.slot || known.at_s != it.at_s) {
                    candidates.push(it);
                }
            }
        }
        let mut best: Option<State> = None;
        for it in candidates {
            let camera_from_world = plain.cameras[it.slot].camera_from_world;
            let second = Some(Second { slot: it.slot, at_s: it.at_s, camera_from_world });
            let mut state = State { second, ..plain.clone() };
            for blur in BLURS {
                state = system.adjust(state, blur * sigma_px);
                let at_s = self.change_over(&state, blur * sigma_px);
                if let (Some(second), Some(at_s)) = (&mut state.second, at_s) {
                    second.at_s = at_s;
                }
            }
            let state = system.adjust(state, sigma_px);
            if best.as_ref().is_none_or(|known| state.cost < known.cost) {
                best = Some(state);
            }
        }
        Some((plain, best?, sigma_px))
    }

    /// What a second pose must lower the cost by.
    fn needed(&self, plain: &State) -> f64 {
        let n: usize = self.system.tracks.iter().map(|it| it.seen.len()).sum();
        (LEAST_SHARE + BY_CHANCE / n.max(1) as f64) * plain.cost
    }

    /// The pose change to report, if it exceeds what lens and noise explain.
    fn accepted(&self, plain: &State, found: &State, sigma_px: f64, slots: &[usize]) -> Option<PoseChange> {
        let second = found.second.as_ref()?;
        let before = &found.cameras[second.slot];
        let after = Camera { camera_from_world: second.camera_from_world, ..before.clone() };
        let sees_it = |track: &Track| track.seen.iter().any(|it| it.slot == second.slot);
        let seen = self.system.tracks.iter().zip(&found.points).filter(|it| sees_it(it.0));
        let apart = seen.filter_map(|it| Some((before.project(it.1)? - after.project(it.1)?).norm()));
        let shift_px = median(&apart.collect::<Vec<_>>())?;
        let left_px = median(&self.residuals(found, Some(second.slot)))?;
        let share = |state: &State, slot: usize| {
            let off = self.residuals(state, Some(slot));
            off.iter().filter(|it| **it <= self.inlier_px).count() as f64 / off.len().max(1) as f64
        };
        let all_fit = (0..slots.len()).all(|slot| share(found, slot) >= ALL_FIT);
        let is_seen = shift_px > LEAST_SHIFT_PX && shift_px > SHIFT_RATIO * left_px;
        let is_gain = plain.cost - found.cost > self.needed(plain);
        let is_told = self
            .n_places(second.slot, second.at_s, f64::from(before.image_size[0]))
            .iter()
            .all(|it| *it >= LEAST_PLACES);
        if !(is_told && is_gain && is_seen && all_fit && self.is_no_lens(plain, found, second.slot, sigma_px)) {
            return None;
        }
        Some(PoseChange {
            camera: slots[second.slot],
            at_s: second.at_s,
            shift_px,
            turn: before.camera_from_world.rotation.angle_to(&after.camera_from_world.rotation),
            distance: (before.centre() - after.centre()).norm(),
            shares: [share(plain, second.slot), share(found, second.slot)],
        })
    }

    /// In how many places of its picture a camera has seen points before and after `at_s`, no more than are enough.
    fn n_places(&self, slot: usize, at_s: f64, width_px: f64) -> [usize; 2] {
        let mut places: [Vec<Point2<f64>>; 2] = Default::default();
        for track in &self.system.tracks {
            let places = &mut places[usize::from(track.time_s >= at_s)];
            let apart = PLACES_APART * width_px;
            for seen in track.seen.iter().filter(|it| it.slot == slot) {
                if places.len() < LEAST_PLACES && places.iter().all(|it| (it - seen.pixel).norm() > apart) {
                    places.push(seen.pixel);
                }
            }
        }
        places.map(|it| it.len())
    }

    /// Whether the second pose gains as much with the camera's lens free as well: a lens that is not as stated asks for another pose too.
    fn is_no_lens(&self, plain: &State, found: &State, slot: usize, sigma_px: f64) -> bool {
        let (mut freed, mut priors) = (self.freed.to_vec(), self.system.priors().to_vec());
        let all = Freedom { pose: true, focal: true, aspect: true, principal: true, k1: true, k2: true, ..freed[slot] };
        freed[slot] = all;
        priors[slot] = OpticsPrior::none(&plain.cameras[slot]);
        let system = System::new(self.system.tracks.clone(), &freed, priors);
        let [one, two] = [plain, found].map(|it| system.adjust(it.clone(), sigma_px));
        one.cost - two.cost > self.needed(&one)
    }

    /// How far observations are off [px].
    fn residuals(&self, state: &State, slot: Option<usize>) -> Vec<f64> {
        let tracks = self.system.tracks.iter().zip(&state.points);
        let of = |(track, point): (&Track, &Point3<f64>)| {
            let seen = track.seen.iter().filter(|it| slot.is_none_or(|own| own == it.slot));
            let off = |it: &Seen| {
                let seen = state.camera(it.slot, track.time_s).project(point);
                seen.map_or(1e3, |seen| (seen - it.pixel).norm())
            };
            seen.map(off).collect::<Vec<f64>>()
        };
        tracks.flat_map(of).collect()
    }

    /// What a second pose would gain to first order: for each camera the moment of the most.
    fn scores(&self, state: &State, sigma_px: f64) -> Vec<Candidate> {
        let (system, n) = (self.system, self.system.tracks.len());
        let n_bins = BINS.min(n / 4).max(2);
        let bins: Vec<usize> = (0..n).map(|it| it * n_bins / n).collect();
        let sums = system.by_bin(state, sigma_px, &bins);
        let size = sums[0].slope.len();
        let add = |mut to: Reduced, it: &Reduced| {
            to.information += &it.information;
            to.slope += &it.slope;
            to
        };
        let empty = || Reduced { information: DMatrix::zeros(size, size), slope: DVector::zeros(size) };
        let mut whole = sums.iter().fold(empty(), &add);
        (0..size).for_each(|it| whole.information[(it, it)] *= 1.0 + 1e-6);
        let Some(whole) = whole.information.cholesky() else { return Vec::new() };
        let mut best: Vec<Option<Candidate>> = (0..state.cameras.len()).map(|_| None).collect();
        let mut later = empty();
        for first in (1..n_bins).rev() {
            later = add(later, &sums[first]);
            let at = bins.partition_point(|it| *it < first);
            let at_s = 0.5 * (system.tracks[at - 1].time_s + system.tracks[at].time_s);
            for (slot, best) in best.iter_mut().enumerate() {
                let own = system.first(slot);
                let count =
                    |tracks: &[Track]| tracks.iter().filter(|it| it.seen.iter().any(|it| it.slot == slot)).count();
                if count(&system.tracks[..at]) < LEAST_ROWS || count(&system.tracks[at..]) < LEAST_ROWS {
                    continue;
                }
                let across = later.information.columns(own, POSE).into_owned();
                let slope = later.slope.rows(own, POSE).into_owned();
                let mut left =
                    later.information.view((own, own), (POSE, POSE)) - across.transpose() * whole.solve(&across);
                (0..POSE).for_each(|it| left[(it, it)] += 1e-6 * left[(it, it)].abs() + 1e-12);
                let Some(left) = left.cholesky() else { continue };
                let gain = slope.dot(&left.solve(&slope));
                if best.as_ref().is_none_or(|it| gain > it.gain) {
                    *best = Some(Candidate { slot, at_s, gain });
                }
            }
        }
        best.into_iter().flatten().collect()
    }

    /// The moment of change that costs least, with cameras and points as they are.
    fn change_over(&self, state: &State, sigma_px: f64) -> Option<f64> {
        let second = state.second.as_ref()?;
        let after = Camera { camera_from_world: second.camera_from_world, ..state.cameras[second.slot].clone() };
        let cost = |camera: &Camera, point: &Point3<f64>, pixel: &Point2<f64>| {
            let off = camera.project(point).map_or(900.0, |it| ((it - pixel) / sigma_px).norm_squared());
            Loss::CAUCHY.at(off).0
        };
        let mut rows: Vec<(f64, f64)> = Vec::new();
        for (track, point) in self.system.tracks.iter().zip(&state.points) {
            for it in track.seen.iter().filter(|it| it.slot == second.slot) {
                let early = cost(&state.cameras[second.slot], point, &it.pixel);
                rows.push((track.time_s, early - cost(&after, point, &it.pixel)));
            }
        }
        let mut sum = 0.0;
        let mut best: Option<(f64, f64)> = None;
        for index in 1..rows.len() {
            sum += rows[index - 1].1;
            let inside = index >= LEAST_ROWS && index + LEAST_ROWS <= rows.len();
            if inside && rows[index].0 > rows[index - 1].0 && best.is_none_or(|it| sum < it.0) {
                best = Some((sum, 0.5 * (rows[index - 1].0 + rows[index].0)));
            }
        }
        best.map(|it| it.1)
    }
}
