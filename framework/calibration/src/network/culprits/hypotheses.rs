//! Fits one camera to the light's places by the others, under each hypothesis of what may be wrong with it.
//!
//! Under each hypothesis the camera's pose, and its free optics, are searched again; the share of its observations that then
//! fit decides. A hypothesis is accepted when it explains half of what is missing relative to the share that other cameras reach.

use std::collections::BTreeMap;

use foveate_estimation::Random;
use foveate_estimation::statistics::median;
use foveate_geometry::bundle::Freedom;
use foveate_geometry::{Camera, PixelNoise, ResectionOptions, refine, resect};
use nalgebra::{Point2, Point3, Vector3};

use super::LEAST_ROWS;
use crate::cause::Cause;
use crate::checks::models::{Extra, Fitted, Samples, Witnessed};
use crate::network::settle::Room;
use crate::recording::{CameraGuess, Recording};

/// Observations that are compared at most [–].
const MOST_ROWS: usize = 400;
/// Observations by which many shifts of time are compared [–].
const FEW_ROWS: usize = 100;
/// Rows are shifted by at most so many frames [–].
const MOST_FRAMES: i64 = 60;
/// A place is of a time when it is at most this part of a frame's period off [–].
const SAME_TIME: f64 = 0.3;
/// A hypothesis must explain this part of what is missing, and so much of all observations at the least [–].
const EXPLAINS: f64 = 0.5;
const LEAST_GAIN: f64 = 0.05;
/// … and so many observations [–].
const LEAST_COUNT: f64 = 10.0;
/// A simpler hypothesis is taken that explains so little less [–].
const SIMPLER: f64 = 0.03;
/// Neighbours on the path further away than so many periods give no velocity [–].
const NEIGHBOURS: f64 = 2.5;
/// Focal lengths of which nothing is known are tried at these factors.
const FOCAL_FACTORS: [f64; 4] = [1.0, 1.6, 0.6, 2.5];
/// Parts of the recording before and after a change of pose are at least this long [–].
const LEAST_PART: f64 = 0.08;
/// False observations are diagnosed from this share on, beyond that of other cameras [–].
const FALSE_SHARE: f64 = 0.1;
/// No pose explains a camera that fits less than this by any hypothesis [–].
const NO_POSE: f64 = 0.12;

/// What a camera is found to be.
pub(super) struct Finding {
    pub camera: usize,
    /// `None`: nothing worth telling.
    pub cause: Option<Cause>,
    /// Under the simplest hypothesis: nothing but false observations.
    pub fitted: Camera,
    /// Share of its observations that fit: as they are, and with the cause put right.
    pub shares: [f64; 2],
    /// Before and after the moment at which it changed most, if it did.
    pub parts: Option<Parts>,
}

/// Two poses of one camera.
pub(super) struct Parts {
    pub before: Camera,
    pub after: Camera,
    pub at_s: f64,
    share: f64,
    /// What they explain beyond what one pose does [–].
    pub gain: f64,
}

/// Where the light was, by cameras other than the one in question.
pub(super) struct Witnesses<'a> {
    network: &'a Room<'a>,
    camera: usize,
    sigma_px: f64,
    /// By label, in the order of time.
    places: BTreeMap<u32, Vec<Place>>,
    rows: Vec<Row>,
    period_s: f64,
    /// Optics that may be those of the camera.
    starts: Vec<Camera>,
}

#[derive(Clone, Copy)]
struct Place {
    time_s: f64,
    point: Point3<f64>,
    covariance: nalgebra::Matrix3<f64>,
    velocity: Option<nalgebra::Vector3<f64>>,
}

#[derive(Clone, Copy)]
struct Row {
    time_s: f64,
    label: u32,
    pixel: Point2<f64>,
}

/// A camera under one hypothesis.
struct Fit {
    camera: Camera,
    share: f64,
    cost: f64,
}

impl<'a> Witnesses<'a> {
    pub(super) fn new(network: &'a Room<'a>, camera: usize, recording: &Recording) -> Witnesses<'a> {
        let guess = &recording.cameras[camera];
        let sigma_px = network.pixel_sigma().unwrap_or(0.5).max(0.1);
        let mut places: BTreeMap<u32, Vec<Place>> = BTreeMap::new();
        let mut rows = Vec::new();
        for (moment, known) in network.moments.iter().zip(&network.known) {
            let own = moment.views.iter().find(|it| it.camera == camera);
            if let Some(pixel) = own.and_then(|it| Some(it.spots[it.chosen?])) {
                rows.push(Row { time_s: moment.time_s, label: moment.label, pixel });
            }
            let others = moment.views.iter().filter(|it| it.camera != camera && it.right);
            let seen: Vec<(&Camera, Point2<f64>)> =
                others.filter_map(|it| Some((network.cameras[it.camera].as_ref()?, it.spots[it.chosen?]))).collect();
            let (Some(start), true) = (known.point, seen.len() >= 2) else { continue };
            let (models, pixels): (Vec<&Camera>, Vec<Point2<f64>>) = seen.into_iter().unzip();
            let Ok(made) = refine(&models, &pixels, PixelNoise::Sigma(sigma_px), start) else { continue };
            places.entry(moment.label).or_default().push(Place {
                time_s: moment.time_s,
                point: made.position,
                covariance: made.covariance,
                velocity: None,
            });
        }
        let times: Vec<f64> =
            recording.camera_frames.iter().filter(|it| it.camera == camera).map(|it| it.time_s).collect();
        let mut gaps: Vec<f64> = times.windows(2).map(|it| it[1] - it[0]).filter(|it| *it > 0.0).collect();
        gaps.sort_by(f64::total_cmp);
        let period_s = gaps.get(gaps.len() / 10).copied().unwrap_or(1.0);
        for list in places.values_mut() {
            list.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
            for it in 1..list.len().saturating_sub(1) {
                let (before, after) = (list[it - 1], list[it + 1]);
                let gap_s = after.time_s - before.time_s;
                if gap_s > 0.0 && gap_s <= NEIGHBOURS * period_s {
                    list[it].velocity = Some((after.point - before.point) / gap_s);
                }
            }
        }
        let starts = starts(network, guess);
        Witnesses { network, camera, sigma_px, places, rows, period_s, starts }
    }

    /// Rows beside the places of `shift_s` earlier; at most `most` of them, evenly.
    fn beside(&self, shift_s: f64, most: usize) -> Vec<Witnessed> {
        let tolerance_s = SAME_TIME * self.period_s;
        let found = self.rows.iter().filter_map(|row| {
            let list = self.places.get(&row.label)?;
            let wanted = row.time_s - shift_s;
            let after = list.partition_point(|it| it.time_s < wanted);
            let near = list[after.saturating_sub(1)..(after + 1).min(list.len())].iter();
            let place = near.min_by(|a, b| (a.time_s - wanted).abs().total_cmp(&(b.time_s - wanted).abs()))?;
            ((place.time_s - wanted).abs() <= tolerance_s).then_some(Witnessed {
                time_s: row.time_s,
                pixel: row.pixel,
                point: place.point,
                covariance: place.covariance,
                velocity: place.velocity,
            })
        });
        let all: Vec<Witnessed> = found.collect();
        let every = all.len().div_ceil(most).max(1);
        all.into_iter().step_by(every).collect()
    }

    /// The pose, and the optics in `extras`, by search from each of `starts`.
    fn fit(&self, seen: &[Witnessed], starts: &[Camera], extras: &[Extra]) -> Option<Fit> {
        if seen.len() < LEAST_ROWS {
            return None;
        }
        let limit_px = self.network.inlier_px();
        let points: Vec<Point3<f64>> = seen.iter().map(|it| it.point).collect();
        let pixels: Vec<Point2<f64>> = seen.iter().map(|it| it.pixel).collect();
        let mut best: Option<Fit> = None;
        for start in starts {
            let mut random = Random::new(self.network.seed()).fork("hypotheses");
            let options = ResectionOptions {
                sigma_px: self.sigma_px.max(limit_px / 6.0),
                inlier_px: 2.0 * limit_px,
                trials: 400,
            };
            let Ok(found) = resect(start, &points, &pixels, &options, |n| random.below(n)) else { continue };
            let mut camera = Camera { camera_from_world: found.camera_from_world, ..start.clone() };
            let samples = Samples::new(seen, &camera, self.sigma_px);
            for blur in [8.0, 2.0, 1.0] {
                if let Some(fitted) = samples.blurred(blur).fit(&camera, extras).filter(|it| is_sane(&it.camera, start))
                {
                    camera = fitted.camera;
                }
            }
            let near = samples.near(&camera, limit_px);
            let share = near.iter().filter(|it| **it).count() as f64 / seen.len() as f64;
            let cost: f64 = samples.squares(&camera).iter().map(|it| (1.0 + it).ln()).sum();
            if best.as_ref().is_none_or(|it| (share, -cost) > (it.share, -it.cost)) {
                best = Some(Fit { camera, share, cost });
            }
        }
        best
    }

    /// Roughly which share of `seen` some pose explains.
    fn coarse(&self, seen: &[Witnessed], start: &Camera) -> Option<f64> {
        let points: Vec<Point3<f64>> = seen.iter().map(|it| it.point).collect();
        let pixels: Vec<Point2<f64>> = seen.iter().map(|it| it.pixel).collect();
        let limit_px = self.network.inlier_px();
        let mut random = Random::new(self.network.seed()).fork("shifts");
        let options = ResectionOptions { sigma_px: limit_px / 3.0, inlier_px: 3.0 * limit_px, trials: 150 };
        let found =
            resect(start, &points, &pixels, &options, |n| random.below(n)).ok().filter(|_| seen.len() >= LEAST_ROWS)?;
        Some(found.right.iter().filter(|it| **it).count() as f64 / seen.len() as f64)
    }

    /// What is wrong with the camera, beside others that fit a share of `usual`; `None` where too little was seen to say anything.
    pub(super) fn examine(&self, guess: &CameraGuess, usual: f64) -> Option<Finding> {
        let free = extras_of(&guess.free);
        let seen = self.beside(0.0, MOST_ROWS);
        let plain = self.fit(&seen, &self.starts, &free)?;
        let missing = (usual - plain.share).max(0.0);
        let least = LEAST_COUNT / seen.len() as f64;
        let needed = plain.share + (EXPLAINS * missing).max(LEAST_GAIN).max(least);
        // The simplest first.
        let mut found: Vec<(f64, Cause)> = Vec::new();
        let starts = [std::slice::from_ref(&plain.camera), &self.starts[..]].concat();
        if let Some(share) = self.mirrored(&seen, &starts, &free) {
            found.push((share, Cause::Mirrored));
        }
        found.extend(self.late(&starts, &free));
        // Others that are hardly known themselves do not tell of a lens.
        if self.network.is_held() {
            found.extend(self.optics(&seen, &starts, &free));
        }
        let parts = self.parts(&seen, &plain);
        if let Some(parts) = &parts {
            let shifts = seen
                .iter()
                .filter_map(|it| Some((parts.before.project(&it.point)? - parts.after.project(&it.point)?).norm()));
            let [before, after] = [&parts.before, &parts.after];
            found.push((
                parts.share,
                Cause::Moved {
                    at_s: Some(parts.at_s),
                    shift_px: median(&shifts.collect::<Vec<_>>()).unwrap_or(f64::NAN),
                    turn: before.camera_from_world.rotation.angle_to(&after.camera_from_world.rotation),
                    distance: (before.centre() - after.centre()).norm(),
                },
            ));
        }
        let most = found.iter().map(|it| it.0).fold(0.0, f64::max);
        let chosen = found.into_iter().find(|it| it.0 >= needed && it.0 >= most - SIMPLER);
        let (cause, share) = match chosen {
            Some((share, cause)) => (Some(cause), share),
            None if plain.share < NO_POSE => (Some(Cause::Unknown { size: 1.0 - plain.share }), plain.share),
            None if plain.share < usual - FALSE_SHARE.max(least) => {
                (Some(Cause::FalseObservations { share: 1.0 - plain.share }), usual)
            }
            None => (None, plain.share),
        };
        let shares = [plain.share, share];
        Some(Finding { camera: self.camera, cause, fitted: plain.camera, shares, parts })
    }

    fn mirrored(&self, seen: &[Witnessed], starts: &[Camera], free: &[Extra]) -> Option<f64> {
        let width = f64::from(starts[0].image_size[0]);
        let turned: Vec<Witnessed> = seen
            .iter()
            .map(|it| Witnessed { pixel: Point2::new(width - 1.0 - it.pixel.x, it.pixel.y), ..*it })
            .collect();
        self.fit(&turned, starts, free).map(|it| it.share)
    }

    /// By whole frames first, by which rows slip, then as finely as the light moves.
    fn late(&self, starts: &[Camera], free: &[Extra]) -> Option<(f64, Cause)> {
        let coarse = (-MOST_FRAMES..=MOST_FRAMES).filter(|it| *it != 0).filter_map(|frames| {
            let seen = self.beside(frames as f64 * self.period_s, FEW_ROWS);
            Some((self.coarse(&seen, &starts[0])?, frames))
        });
        let mut coarse: Vec<(f64, i64)> = coarse.collect();
        coarse.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.abs().cmp(&b.1.abs())));
        // Part of a frame is no shift of rows.
        let fine = coarse.iter().take(3).map(|it| it.1).chain([0]).filter_map(|frames| {
            let shift_s = frames as f64 * self.period_s;
            let seen = self.beside(shift_s, MOST_ROWS);
            let found = self.fit(&seen, starts, free)?;
            let samples = Samples::new(&seen, &found.camera, self.sigma_px);
            let coarse = samples.blurred(8.0).fit(&found.camera, &[Extra::Delay]);
            let start = coarse.map_or_else(|| found.camera.clone(), |it| it.camera);
            let fitted = samples.fit(&start, &[Extra::Delay]).filter(|it| it.delay_s.abs() < 0.8 * self.period_s);
            let (delay_s, sigma_s) = fitted.as_ref().map_or((0.0, self.period_s), |it| (it.delay_s, it.delay_sigma_s));
            let share = fitted.map_or(found.share, |it| found.share.max(self.share_later(&seen, &it)));
            let sigma_s = if sigma_s.is_finite() { sigma_s } else { self.period_s };
            Some((share, Cause::Clock { offset_s: delay_s - shift_s, sigma_s }))
        });
        fine.max_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Share of `seen` that fits where the light is as much later as the camera's clock is found to be behind.
    fn share_later(&self, seen: &[Witnessed], fitted: &Fitted) -> f64 {
        let later = |it: &Witnessed| {
            let way = it.velocity.map_or_else(Vector3::zeros, |it| it * fitted.delay_s);
            Witnessed { point: it.point + way, ..*it }
        };
        let later: Vec<Witnessed> = seen.iter().map(later).collect();
        let near = Samples::new(&later, &fitted.camera, self.sigma_px).near(&fitted.camera, self.network.inlier_px());
        near.iter().filter(|it| **it).count() as f64 / near.len().max(1) as f64
    }

    /// What is stated of its optics and may be wrong.
    fn optics(&self, seen: &[Witnessed], starts: &[Camera], free: &[Extra]) -> Vec<(f64, Cause)> {
        let start = &starts[0];
        let ratio = |it: &Camera| it.intrinsics.focal[1] / it.intrinsics.focal[0];
        let with = |extra: Extra| -> Vec<Extra> { free.iter().copied().chain([extra]).collect() };
        let mut found = Vec::new();
        if !free.contains(&Extra::Focal) {
            let scaled = [1.0, 1.3, 0.77, 1.7, 0.6].map(|factor| {
                let mut camera = start.clone();
                camera.intrinsics.focal = camera.intrinsics.focal.map(|it| it * factor);
                camera
            });
            if let Some(fit) = self.fit(seen, &scaled, &with(Extra::Focal)) {
                let factor = fit.camera.intrinsics.focal[0] / start.intrinsics.focal[0];
                found.push((fit.share, Cause::Focal { factor }));
            }
        }
        if !free.contains(&Extra::Aspect) {
            let shaped = [1.0, 1.3, 0.77, 2.0, 0.5].map(|factor| {
                let mut camera = start.clone();
                camera.intrinsics.focal[1] *= factor;
                camera
            });
            if let Some(fit) = self.fit(seen, &shaped, &with(Extra::Aspect)) {
                found.push((fit.share, Cause::PixelShape { factor: ratio(&fit.camera) / ratio(start) }));
            }
        }
        if !free.contains(&Extra::Distortion) {
            let bent: Vec<Extra> = free.iter().copied().chain([Extra::Distortion, Extra::Distortion2]).collect();
            if let Some(fit) = self.fit(seen, &starts[..1], &bent) {
                found.push((fit.share, Cause::Distortion { k1: fit.camera.distortion.k1 - start.distortion.k1 }));
            }
        }
        found
    }

    /// The moment at which going over from one pose to another explains most.
    fn parts(&self, seen: &[Witnessed], plain: &Fit) -> Option<Parts> {
        let n = seen.len();
        let least = ((LEAST_PART * n as f64) as usize).max(LEAST_ROWS);
        if n < 2 * least + LEAST_ROWS {
            return None;
        }
        let limit_px = self.network.inlier_px();
        let start = std::slice::from_ref(&plain.camera);
        let mut best: Option<(usize, usize, Camera, Camera)> = None;
        for (first, last) in [(n / 4, n - n / 4), (least, n / 2), (n / 2, n - least)] {
            let (Some(before), Some(after)) =
                (self.fit(&seen[..first], start, &[]), self.fit(&seen[last..], start, &[]))
            else {
                continue;
            };
            let (mut before, mut after) = (before.camera, after.camera);
            for _ in 0..3 {
                let near = |camera: &Camera| Samples::new(seen, camera, self.sigma_px).near(camera, limit_px);
                let (early, late) = (near(&before), near(&after));
                let mut count = late.iter().filter(|it| **it).count();
                let (mut at, mut most) = (least, 0);
                for index in 1..n {
                    count = count + usize::from(early[index - 1]) - usize::from(late[index - 1]);
                    if (least..=n - least).contains(&index) && count > most {
                        (at, most) = (index, count);
                    }
                }
                if best.as_ref().is_none_or(|it| most > it.1) {
                    best = Some((at, most, before.clone(), after.clone()));
                }
                let again = (self.fit(&seen[..at], start, &[]), self.fit(&seen[at..], start, &[]));
                let (Some(a), Some(b)) = again else { break };
                (before, after) = (a.camera, b.camera);
            }
        }
        let (at, count, before, after) = best?;
        let at_s = 0.5 * (seen[at - 1].time_s + seen[at].time_s);
        let share = count as f64 / n as f64;
        Some(Parts { before, after, at_s, share, gain: share - plain.share })
    }
}

/// Optics that may be those of the camera: as they were found, as those of cameras with pictures of the same size, as guessed.
fn starts(network: &Room<'_>, guess: &CameraGuess) -> Vec<Camera> {
    if !guess.free.focal {
        return vec![guess.camera.clone()];
    }
    let alike: Vec<&Camera> =
        network.cameras.iter().flatten().filter(|it| it.image_size == guess.camera.image_size).collect();
    let mut starts = Vec::new();
    let middle = |of: &dyn Fn(&Camera) -> f64| median(&alike.iter().map(|it| of(it)).collect::<Vec<_>>());
    if let (Some(focal), Some(k1), Some(k2)) =
        (middle(&|it| it.intrinsics.focal[0]), middle(&|it| it.distortion.k1), middle(&|it| it.distortion.k2))
    {
        let mut camera = guess.camera.clone();
        let factor = focal / camera.intrinsics.focal[0];
        camera.intrinsics.focal = camera.intrinsics.focal.map(|it| it * factor);
        if guess.free.k1 {
            (camera.distortion.k1, camera.distortion.k2) = (k1, k2);
        }
        starts.push(camera);
    }
    starts.extend(FOCAL_FACTORS.map(|factor| {
        let mut camera = guess.camera.clone();
        camera.intrinsics.focal = camera.intrinsics.focal.map(|it| it * factor);
        camera
    }));
    starts
}

fn extras_of(free: &Freedom) -> Vec<Extra> {
    let list = [
        (free.focal, Extra::Focal),
        (free.aspect, Extra::Aspect),
        (free.principal, Extra::Principal),
        (free.k1, Extra::Distortion),
        (free.k2, Extra::Distortion2),
    ];
    list.into_iter().filter(|it| it.0).map(|it| it.1).collect()
}

/// Focal lengths beyond a factor of four are no lens of this camera.
fn is_sane(camera: &Camera, start: &Camera) -> bool {
    let ratio = camera.intrinsics.focal[0] / start.intrinsics.focal[0];
    (0.25..4.0).contains(&ratio) && camera.check().is_ok()
}
