//! One camera against the path: search, refinement, and whether to believe it.

use foveate_estimation::Random;
use foveate_estimation::statistics::{median, percentile};
use foveate_geometry::{Camera, Freedom, Optic, OpticsPrior};
use nalgebra::{Isometry3, Matrix3, Point3, UnitQuaternion, Vector3};

use super::PathOptions;
use super::measured::{MeasuredPath, spreads};
use super::refine::{Free, Quality, Refined, State, refine, wander};
use super::refusal::Refusal;
use super::search::{Candidate, FASTEST_DRIFT, search};
use super::track::{Seen, Track};
use crate::recording::{CameraGuess, Recording};

/// Observations in a refinement of a part of the recording, and of all of it in the end [–].
const FEW: usize = 240;
const MANY: usize = 2400;
/// Candidates that are refined in their window, and over the whole recording [–].
const REFINED: usize = 16;
const EXTENDED: usize = 6;
/// Offsets that are so many steps apart are two [–].
const DISTINCT_STEPS: f64 = 2.5;
/// Focal lengths of which nothing is known, over the guess [–].
const FOCAL_FACTORS: [f64; 7] = [1.0, 1.4, 0.7, 2.0, 0.5, 2.8, 4.0];
/// Another offset, or a reversed pose, with so large a part of the share that agrees is as good [–].
const AS_GOOD: f64 = 0.8;
/// And so large a part of the number of observations [–].
const AS_MANY: f64 = 0.6;
/// Of a Gaussian pair of numbers, 99 % are nearer to 0 than so many standard deviations.
const LIMIT_SIGMAS: f64 = 3.03;
/// One block of observations in so many is held out [–].
const HOLD_OUT_EVERY: usize = 5;
/// Blocks of a recording [–].
const HOLD_OUT_BLOCKS: usize = 40;
/// Parts of a recording in which the clock is looked at apart [–].
const CLOCK_PARTS: usize = 12;
/// A drift counts when it is so many standard deviations from none.
const DRIFT_SIGMAS: f64 = 2.0;
/// Of the relative covariance of a pose nothing beyond this is of use: centre over distance, and turn [rad].
const WEAK: [f64; 2] = [0.05, 0.03];
/// A focal length known worse than this is not found [–].
const WEAK_FOCAL: f64 = 0.05;
/// Held out observations that are so many times, and so many pixels, further off than those used show that a fit does not hold.
const HELD_OUT_WORSE: (f64, f64) = (3.0, 3.0);

/// A camera that was found.
#[derive(Debug, Clone)]
pub(super) struct Found {
    pub state: State,
    pub quality: CameraQuality,
    pub free: Freedom,
    pub prior: OpticsPrior,
    pub used: Vec<Seen>,
    pub held_out: Vec<Seen>,
    pub limit_px: f64,
    pub sigma_px: f64,
    pub right: usize,
    pub of: usize,
    /// The next best offset: path time less camera time [s], and its share.
    pub rival: Option<(f64, f64)>,
    pub wander: Option<[f64; 2]>,
    pub depth_m: f64,
    /// Optics that were to be found and stay as given.
    pub held: Vec<Optic>,
}

/// As [`Quality`], kept.
#[derive(Debug, Clone)]
pub(super) struct CameraQuality {
    pub pose: nalgebra::Matrix6<f64>,
    pub centre: Matrix3<f64>,
    pub optics: foveate_geometry::bundle::OpticsSigma,
    pub clock_s: f64,
}

/// Pose and clock of a camera; the path's origin is near its middle.
pub(super) fn solve(
    recording: &Recording,
    camera: usize,
    path: &MeasuredPath,
    options: &PathOptions,
) -> Result<Found, Refusal> {
    let guess = &recording.cameras[camera];
    let track = Track::new(recording, camera, &guess.camera);
    let found = Solver { guess, path, options }.solve(recording, camera, &track);
    // A mirrored picture is a world of the other hand: no pose makes it fit.
    let Err(Refusal::Disagrees { right, of, .. }) = found else { return found };
    let other_hand = path.of_other_hand();
    let share = right as f64 / of.max(1) as f64;
    match (Solver { guess, path: &other_hand, options }).solve(recording, camera, &track) {
        Ok(mirrored) if mirrored.share() > options.good_share.max(share) => {
            Err(Refusal::Mirrored { share, mirrored: mirrored.share() })
        }
        _ => found,
    }
}

impl Found {
    pub fn share(&self) -> f64 {
        self.right as f64 / self.of.max(1) as f64
    }
}

struct Solver<'a> {
    guess: &'a CameraGuess,
    path: &'a MeasuredPath,
    options: &'a PathOptions,
}

/// A candidate after refinement.
#[derive(Debug, Clone)]
struct Extended {
    state: State,
    step_s: f64,
    limit_px: f64,
    right: usize,
    of: usize,
    score: f64,
}

impl Extended {
    fn share(&self) -> f64 {
        self.right as f64 / self.of.max(1) as f64
    }
}

impl Solver<'_> {
    fn solve(&self, recording: &Recording, camera: usize, track: &Track) -> Result<Found, Refusal> {
        let (seen, needed) = (track.seen.len(), self.options.min_observations);
        if seen < needed {
            return Err(Refusal::TooFew { seen, needed });
        }
        let spread = |axis: usize| percentile(&track.seen.iter().map(|it| it.pixel[axis]).collect::<Vec<_>>(), 90.0);
        let spread_px = [0, 1].map(|axis| {
            let middle = median(&track.seen.iter().map(|it| it.pixel[axis]).collect::<Vec<_>>()).unwrap_or(0.0);
            spread(axis).unwrap_or(middle) - middle
        });
        let spread_px = spread_px[0].hypot(spread_px[1]);
        if spread_px < 2.0 * self.options.inlier_px {
            return Err(Refusal::Still { spread_px });
        }
        let extended = self.candidates(recording, camera, track);
        let best = extended.first().ok_or(Refusal::NoOverlap { seen, needed })?;
        if best.of < needed {
            return Err(Refusal::NoOverlap { seen, needed });
        }
        let found = self.finish(best, track)?;
        let rival = extended[1..].iter().filter(|it| self.differs(it, best)).max_by(|a, b| a.score.total_cmp(&b.score));
        self.judge(found, best, rival)
    }

    /// Whether two candidates are of two offsets.
    fn differs(&self, one: &Extended, other: &Extended) -> bool {
        let apart = (one.state.path_time(other.state.middle_s) - other.state.path_s).abs();
        apart > DISTINCT_STEPS * one.step_s.max(other.step_s)
    }

    /// All that may be, refined over the whole recording, the best first.
    fn candidates(&self, recording: &Recording, camera: usize, track: &Track) -> Vec<Extended> {
        let factors =
            if self.options.focal_unknown && self.guess.free.focal { &FOCAL_FACTORS[..] } else { &FOCAL_FACTORS[..1] };
        let mut random = Random::new(self.options.seed).fork(&self.guess.name);
        let mut found: Vec<Candidate> = Vec::new();
        for factor in factors {
            let mut optics = self.guess.camera.clone();
            optics.intrinsics.focal = optics.intrinsics.focal.map(|it| it * factor);
            let own;
            let track = if *factor == 1.0 {
                track
            } else {
                own = Track::new(recording, camera, &optics);
                &own
            };
            found.extend(search(track, self.path, &optics, &mut random));
        }
        found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut refined: Vec<(f64, State, Candidate)> = Vec::new();
        for candidate in found.iter().take(REFINED * factors.len()) {
            let Some(state) = self.in_window(candidate, track) else { continue };
            let seen = state.on_path(self.path, &track.thinned(candidate.window_s, FEW));
            let limit = self.limit_px(&state, candidate.near * focal(&state.camera) / 3.0);
            refined.push((score(&state, self.path, &seen, limit), state, candidate.clone()));
        }
        refined.sort_by(|a, b| b.0.total_cmp(&a.0));
        let mut extended: Vec<Extended> = Vec::new();
        for (_, state, candidate) in refined {
            let is_known = |it: &Extended| {
                (it.state.path_time(state.middle_s) - state.path_s).abs() <= DISTINCT_STEPS * candidate.step_s
                    && (focal(&it.state.camera) / focal(&state.camera)).ln().abs() < 0.1
            };
            if extended.len() >= EXTENDED || extended.iter().filter(|it| is_known(it)).count() > 1 {
                continue;
            }
            extended.extend(self.over_all(state, &candidate, track));
        }
        // By one limit for all: one that is right is nearer, and one with a longer lens would allow itself more.
        let limit_px = extended.iter().map(|it| it.limit_px).fold(f64::INFINITY, f64::min);
        for it in &mut extended {
            let seen = it.state.on_path(self.path, &track.thinned(track.span_s(), MANY));
            it.right = it.state.errors(self.path, &seen).filter(|it| *it <= limit_px).count();
            it.score = score(&it.state, self.path, &seen, limit_px);
        }
        extended.sort_by(|a, b| b.score.total_cmp(&a.score));
        extended
    }

    fn pose_and_clock(&self, rate: bool) -> Free {
        let optics = Freedom { focal: self.options.focal_unknown && self.guess.free.focal, ..Freedom::POSE };
        Free { optics, rate }
    }

    fn limit_px(&self, state: &State, sigma_px: f64) -> f64 {
        // A focal length that is being found is not to stretch its own limit.
        let most = self.options.agree_rad * focal(&state.camera).min(focal(&self.guess.camera));
        let most = most.max(self.options.inlier_px);
        (LIMIT_SIGMAS * sigma_px).clamp(self.options.inlier_px, most)
    }

    fn refined(&self, state: State, seen: &[Seen], sigma_px: f64, free: Free) -> Option<Refined> {
        refine(state, self.path, seen, sigma_px, free, &self.prior())
    }

    fn prior(&self) -> OpticsPrior {
        let mut prior = OpticsPrior::of_guess(&self.guess.camera);
        prior.sigma.focal = f64::INFINITY;
        prior
    }

    /// Pose and offset by what was seen in the window of the candidate.
    fn in_window(&self, candidate: &Candidate, track: &Track) -> Option<State> {
        let Candidate { camera, middle_s, path_s, window_s, near, .. } = candidate.clone();
        let mut state = State { camera, middle_s, path_s, rate: 1.0 };
        let mut sigma_px = near * focal(&state.camera) / 2.0;
        for _ in 0..4 {
            let seen = state.on_path(self.path, &track.thinned(window_s, FEW));
            state = self.refined(state, &seen, sigma_px, self.pose_and_clock(false))?.state;
            sigma_px = state.sigma_px(self.path, &seen).clamp(0.35 * sigma_px, sigma_px);
        }
        Some(state)
    }

    /// From the window on to all that the camera saw, its rate found on the way.
    fn over_all(&self, state: State, candidate: &Candidate, track: &Track) -> Option<Extended> {
        let [from_s, until_s] = track.span_s();
        let mut half_s = 0.5 * (candidate.window_s[1] - candidate.window_s[0]);
        let (mut state, middle_s) = (state, candidate.middle_s);
        let mut span_s = candidate.window_s;
        let coarse_px = candidate.near * focal(&state.camera) / 2.0;
        loop {
            let seen = state.on_path(self.path, &track.thinned(span_s, FEW));
            let sigma_px = state.sigma_px(self.path, &seen).min(coarse_px);
            let refined = self.refined(state.clone(), &seen, sigma_px, self.pose_and_clock(true))?.state;
            let is_sane = (refined.rate - 1.0).abs() <= 5.0 * FASTEST_DRIFT;
            state =
                if is_sane { refined } else { self.refined(state, &seen, sigma_px, self.pose_and_clock(false))?.state };
            if span_s[0] <= from_s && span_s[1] >= until_s {
                break;
            }
            half_s *= 1.7;
            span_s = [middle_s - half_s, middle_s + half_s];
        }
        for _ in 0..3 {
            let seen = state.on_path(self.path, &track.thinned([from_s, until_s], 2 * FEW));
            let sigma_px = state.sigma_px(self.path, &seen).min(coarse_px);
            state = self.refined(state, &seen, sigma_px, self.pose_and_clock(true))?.state;
        }
        let seen = state.on_path(self.path, &track.thinned([from_s, until_s], MANY));
        let limit = self.limit_px(&state, state.sigma_px(self.path, &seen));
        let right = state.errors(self.path, &seen).filter(|it| *it <= limit).count();
        let score = score(&state, self.path, &seen, limit);
        Some(Extended { state, step_s: candidate.step_s, limit_px: limit, right, of: seen.len(), score })
    }

    /// With all that is free, by the observations that are not held out.
    fn finish(&self, best: &Extended, track: &Track) -> Result<Found, Refusal> {
        let seen = best.state.on_path(self.path, &track.thinned(track.span_s(), MANY));
        let (mut used, mut held_out) = (Vec::new(), Vec::new());
        let per_block = seen.len().div_ceil(HOLD_OUT_BLOCKS).max(1);
        for (index, it) in seen.iter().enumerate() {
            let is_held_out = (index / per_block) % HOLD_OUT_EVERY == HOLD_OUT_EVERY / 2;
            if is_held_out { held_out.push(*it) } else { used.push(*it) }
        }
        let mut free = Free { optics: self.guess.free, rate: true };
        let mut held: Vec<Optic> = Vec::new();
        let mut refined = None;
        let mut state = best.state.clone();
        for _ in 0..6 {
            let sigma_px = state.sigma_px(self.path, &used);
            let Some(next) = self.refined(state.clone(), &used, sigma_px, free) else { break };
            let open = next.open_optics();
            if next.covariance.is_none() && !open.is_empty() {
                open.iter().for_each(|it| free.optics = free.optics.without(*it));
                held.extend(open);
                continue;
            }
            state = next.state.clone();
            refined = Some(next);
        }
        let points: Vec<Point3<f64>> = seen.iter().map(|it| self.path.at(state.path_time(it.time_s)).0).collect();
        let [along_m, across_m, _] = spreads(&points);
        let open = Refusal::Open { along_m, across_m };
        let refined = refined.ok_or_else(|| open.clone())?;
        let half_s = |it: &Refined| (used.last().map_or(0.0, |it| it.time_s) - it.state.middle_s).max(1e-6);
        let mut quality = refined.quality(half_s(&refined)).ok_or_else(|| open.clone())?;
        let has_drift = (state.rate - 1.0).abs() > DRIFT_SIGMAS * quality.rate;
        if !has_drift {
            let level = State { rate: 1.0, ..state.clone() };
            let sigma_px = level.sigma_px(self.path, &used);
            let again = self.refined(level, &used, sigma_px, Free { rate: false, ..free });
            if let Some((again, known)) = again.and_then(|it| it.quality(half_s(&it)).map(|quality| (it, quality))) {
                (state, quality) = (again.state, known);
            }
        }
        let Quality { pose, centre, optics, clock_s, .. } = quality;
        let sigma_px = state.sigma_px(self.path, &used);
        let limit_px = self.limit_px(&state, sigma_px);
        let right = state.errors(self.path, &seen).filter(|it| *it <= limit_px).count();
        let depths: Vec<f64> = points.iter().map(|it| (state.camera.camera_from_world * it).z).collect();
        Ok(Found {
            wander: wander(&state, self.path, &seen, limit_px, CLOCK_PARTS),
            quality: CameraQuality { pose, centre, optics, clock_s },
            free: free.optics,
            prior: self.prior(),
            limit_px,
            sigma_px,
            right,
            of: seen.len(),
            rival: None,
            depth_m: median(&depths).unwrap_or(f64::NAN),
            held,
            used,
            held_out,
            state,
        })
    }

    /// Refuses what cannot be believed.
    fn judge(&self, mut found: Found, best: &Extended, rival: Option<&Extended>) -> Result<Found, Refusal> {
        let offset = |it: &State| it.path_s - it.middle_s;
        let (share, offset_s) = (found.share(), offset(&found.state));
        if share < self.options.least_share {
            let Found { right, of, limit_px, .. } = found;
            let least_share = self.options.least_share;
            return Err(Refusal::Disagrees { right, of, limit_px, offset_s, least_share });
        }
        if let Some(rival) = rival {
            let (other_s, other_share) =
                (rival.state.path_time(found.state.middle_s) - found.state.middle_s, rival.share());
            let as_many = rival.right as f64 >= AS_MANY * best.right as f64;
            if other_share >= AS_GOOD * best.share() && as_many {
                return Err(Refusal::ClockAmbiguous { offset_s, share, other_s, other_share });
            }
            found.rival = Some((other_s, other_share));
        }
        let centre_m = found.quality.centre.symmetric_eigenvalues().max().max(0.0).sqrt();
        let turn =
            found.quality.pose.fixed_view::<3, 3>(0, 0).into_owned().symmetric_eigenvalues().max().max(0.0).sqrt();
        if found.free.focal && found.quality.optics.focal > WEAK_FOCAL {
            return Err(Refusal::OpticOpen { optic: Optic::Focal, sigma: found.quality.optics.focal });
        }
        if let Some(refusal) = self.reversed(&found) {
            return Err(refusal);
        }
        let is_weak = centre_m > WEAK[0] * found.depth_m || turn > WEAK[1];
        if is_weak || !(centre_m.is_finite() && turn.is_finite()) {
            return Err(Refusal::Weak { centre_m, turn_mrad: 1e3 * turn, depth_m: found.depth_m });
        }
        let of = |seen: &[Seen]| median(&found.state.errors(self.path, seen).map(|it| it.min(1e9)).collect::<Vec<_>>());
        if let (Some(used_px), Some(held_out_px)) = (of(&found.used), of(&found.held_out))
            && held_out_px > HELD_OUT_WORSE.0 * used_px
            && held_out_px > used_px + HELD_OUT_WORSE.1
        {
            return Err(Refusal::HeldOut { held_out_px, used_px });
        }
        Ok(found)
    }

    /// The pose under which depth is reversed (D. Necker's cube): as good where the path is flat and far away. With the camera's depth
    /// axis negated by D and the path mirrored in its own plane by H, the rotation is D R H about the middle of what was seen.
    fn reversed(&self, found: &Found) -> Option<Refusal> {
        let state = &found.state;
        let points: Vec<Point3<f64>> = found.used.iter().map(|it| self.path.at(state.path_time(it.time_s)).0).collect();
        let n = points.len().max(1) as f64;
        let middle = points.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords) / n;
        let scatter = points.iter().fold(Matrix3::zeros(), |sum, it| {
            let from_middle = it.coords - middle;
            sum + from_middle * from_middle.transpose() / n
        });
        let eigen = scatter.symmetric_eigen();
        let normal = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned();
        let mirror = Matrix3::identity() - 2.0 * normal * normal.transpose();
        let depth = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, -1.0));
        let pose = state.camera.camera_from_world;
        // Depth is reversed along the line of sight of the middle, not along the axis.
        let in_camera = pose * Point3::from(middle);
        let view =
            UnitQuaternion::rotation_between(&in_camera.coords, &Vector3::z())?.to_rotation_matrix().into_inner();
        let turned = view.transpose() * depth * view * pose.rotation.to_rotation_matrix().into_inner() * mirror;
        let rotation = UnitQuaternion::from_matrix(&turned);
        let reversed = Isometry3::from_parts((in_camera.coords - rotation * middle).into(), rotation);
        let mut other =
            State { camera: Camera { camera_from_world: reversed, ..state.camera.clone() }, ..state.clone() };
        for sigma_px in [8.0 * found.sigma_px, 2.0 * found.sigma_px, found.sigma_px] {
            other = self.refined(other, &found.used, sigma_px, self.pose_and_clock(false))?.state;
        }
        let angle = other.camera.camera_from_world.rotation.angle_to(&pose.rotation);
        let sigma_px = other.sigma_px(self.path, &found.used);
        let right = |it: &State| it.errors(self.path, &found.used).filter(|it| *it <= found.limit_px).count() as f64;
        let as_good = sigma_px <= found.sigma_px / AS_GOOD && right(&other) >= AS_GOOD * right(state);
        let [along, _, across] = spreads(&points);
        (angle > 0.05 && as_good)
            .then(|| Refusal::TwoPoses { angle_deg: angle.to_degrees(), flat: 100.0 * across / along })
    }
}

fn focal(camera: &Camera) -> f64 {
    0.5 * (camera.intrinsics.focal[0] + camera.intrinsics.focal[1])
}

/// Σ (1 − e²/limit²) of the observations that are nearer than the limit.
fn score(state: &State, path: &MeasuredPath, seen: &[Seen], limit_px: f64) -> f64 {
    state.errors(path, seen).map(|it| (1.0 - (it / limit_px).powi(2)).max(0.0)).sum()
}
