//! `surface.tracker`: measures a surface once, and then tracks its points [D'Apuzzo 1999 §2.4].
//!
//! Each moment: points are tracked in time and between views, filtered, and extended over newly visible surface: new points have identities of their
//! own. Lost points are searched for a while, and keep their identity when they are found.

use std::collections::{BTreeMap, BTreeSet};

use foveate::estimation::statistics::median;
use foveate::imaging::matching::{MAX_REACH, SearchPyramid};
use foveate::prelude::*;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bent::Straight;
use crate::cover::Covered;
use crate::engine::Engine;
use crate::filters::{FilterOptions, filter};
use crate::guide::Guide;
use crate::lost::{LostTrack, Search};
use crate::matcher::{coverage, missing, report_faults};
use crate::measure::{MeasureOptions, Sample, sigma};
use crate::path::{CreepOptions, Moments, crept};
use crate::settings::{Prepared, SurfaceSettings};
use crate::tracks::{Neighbourhood, Stepper, Track, TrackOptions};
use crate::views::Moment;

ports! {
    pub(crate) fn declared_ports;
    IMAGE: In<Image> = synced("image", 4).many();
    SKELETONS: In<Skeletons> = latest("skeletons").optional();
    TRACKED: Out<TrackedSurface> = "tracked";
    CLOUD: Out<PointCloud> = "cloud";
}

figures! {
        "surface.points": count, neither, "Points sent, over all moments";
        "surface.measured": count, neither, "Points measured, seeds included, before they are compared with their neighbours";
    "surface.refused.*": count, low, "Attempts at a point that failed for this reason; a place may be tried from several neighbours";
        "surface.seeds.tried": count, neither, "Seeds that were named, or textured patches that were searched along their epipolar lines";
        "surface.seeds.ambiguous": count, low, "Seeds with a second place nearly as good in some view: a repeated texture";
        "surface.seeds.found": count, high, "Seeds that became points";
    "surface.unseen": share, low, "Points that some camera does not see though they face it within 60° and lie in its picture, over all points of all moments: occluded, or cameras not synchronised or moved";
        "surface.misfit_px.median": px, low, "Residual of a point's lines of sight, median over the points of a moment and over the moments";
        "surface.misfit_px.max": px, low, "The same for the moment in which it is largest";
        "surface.out_of_step": count, low, "Moments left out because their residuals are far larger than earlier";
        "surface.stuck": count, low, "Pictures not used because they equal the one before, byte for byte, while another camera's had changed";
    "surface.coverage": share, high, "Places of the grid with a point, over those in the smallest rectangle around all points of a moment, mean over the moments";
    "surface.sigma_mm": mm, low, "Mean standard deviation of the points, over the three axes, by their matches and contradictions between cameras";
    "trajectories.count": count, neither, "Trajectories, of any length";
    "trajectories.mean_samples": count, high, "Mean number of samples of a trajectory";
    "trajectories.ended.*": count, low, "Trajectories that ended for this reason";
    "trajectories.failed.*": count, low, "Points that were not found in the next moment, by the step that failed last: the search for the patch (search_), the match with the picture before (time_), or the match between views";
        "trajectories.second_look": count, neither, "Points found at their neighbours' prediction, not at that of their own motion";
    "trajectories.lost_share": share, low, "Points that were not found in the next moment, over all points of all moments but the last";
        "trajectories.regenerated": count, high, "Lost points that were found again and kept their identity";
        "trajectories.guided": count, high, "Lost points that were found again at the prediction by the body at `skeletons`, as their neighbours were lost, too";
        "trajectories.appeared": count, neither, "New points after the first moment";
    "trajectories.ambiguous": count, low, "Searches in time whose second best place is as good as the best: a repeated texture";
    "step_mm.{x,y,z}": mm, neither, "Median step of all points from one moment to the next, mean over the moments; a step over a moment without pictures counts as two";
    "step_mm.spread": mm, low, "Root mean square distance of the points' steps from the median step of their moment, mean over the moments: for a rigid surface without rotation this is noise";
}

/// Settings of [`Tracker`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrackerSettings {
    /// Matching of the surface between views [–]
    pub surface: SurfaceSettings,
    /// Side of a patch that is matched in time, odd [px]
    #[schemars(range(min = 7, max = 63))]
    pub patch_px: usize,
    /// Largest motion of a point in its first step, from picture to picture, in each direction [px]
    #[schemars(range(min = 1.0, max = 500.0))]
    pub first_search_px: f64,
    /// Largest distance of a point from the prediction by its own motion [px]
    #[schemars(range(min = 1.0, max = 500.0))]
    pub search_px: f64,
    /// Smallest correlation of a patch with itself a moment before, and with other views of a tracked point [–]
    #[schemars(range(min = 0.0, max = 0.999))]
    pub min_correlation: f64,
    /// Largest distance between a point's temporal match and its match between views [px]
    #[schemars(range(min = 0.01, max = 10.0))]
    pub agree_px: f64,
    /// Largest speed: a hand reaches 10 m/s [m/s]
    #[schemars(range(min = 0.0001, max = 1000.0))]
    pub max_speed: f64,
    /// Largest acceleration: a hand that hits something 1,000 m/s² [m/s²]
    #[schemars(range(min = 0.0001, max = 100000.0))]
    pub max_acceleration: f64,
    /// Radius of uniform motion: less than the width of a limb, and more than the distance to the next point but one. 0: 3.75 places of the grid [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub uniform_radius_mm: f64,
    /// Largest difference of a velocity from its neighbours' median, as a part of it: a limb that rotates [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub uniform_part: f64,
    /// plus this many median differences of the neighbours' own [–]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub uniform_scatters: f64,
    /// plus the effect of this error of a step. 0: the standard deviation of a point, median over all [mm]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub uniform_mm: f64,
    /// Moments for which a lost point is searched; 0: none [–]
    #[schemars(range(min = 0, max = 1000))]
    pub remember: u32,
    /// Whether new points are measured where the surface appears [–]
    pub renew: bool,
}

impl Default for TrackerSettings {
    fn default() -> Self {
        Self {
            surface: SurfaceSettings::default(),
            patch_px: 13,
            first_search_px: 24.0,
            search_px: 6.0,
            min_correlation: 0.85,
            agree_px: 0.5,
            max_speed: 10.0,
            max_acceleration: 1000.0,
            uniform_radius_mm: 0.0,
            uniform_part: 0.25,
            uniform_scatters: 5.0,
            uniform_mm: 0.0,
            remember: 5,
            renew: true,
        }
    }
}

/// Factor on the gates for known points: with the gates for new points, marginal ones would be lost and found alternately.
const HELD: f64 = 1.5;

/// Of searches that are ambiguous so many are no chance [–]: of wool that does not repeat it is one in a hundred.
const REPEATING: f64 = 0.2;

/// Of points more than this part is not lost from picture to picture unless something is wrong [–].
const LOST: f64 = 0.5;

/// Where `uniform_radius_mm` is left to it: so many places of the grid [–].
const RADIUS_PLACES: f64 = 3.75;

/// Radius of neighbours for comparing paths, in radii of uniform motion: larger than the patches that creep together.
const CREEP_RADII: f64 = 2.0;

/// Both ends of a path have their errors, and what is no rigid motion moves otherwise here and there: so many times what a step may be off [–].
const CREEP_ERRORS: f64 = 2.0;

/// Pictures in, points with identities out.
pub struct Tracker {
    engine: Engine,
    /// Gates between views for points that are followed.
    held: MeasureOptions,
    options: TrackOptions,
    filters: FilterOptions,
    creep: CreepOptions,
    /// Within what the motion is uniform, and what error of a step it may have; 0: as the points have it [m].
    uniform_m: [f64; 2],
    renew: bool,
    /// Now, and a moment before.
    moments: [Moment; 2],
    n_levels: usize,
    state: State,
    guide: Guide,
    stepper: Stepper,
    coverages: Vec<f64>,
    steps: Vec<Step>,
    /// Moments since the last one of which points were given out.
    without: u32,
    faults: Vec<String>,
}

/// What a moment changes, and what is put back where it is left out.
#[derive(Debug, Clone, Default)]
struct State {
    tracks: Vec<Track>,
    lost: Vec<LostTrack>,
    numbers: Moments,
    next_id: u32,
    counts: Counts,
}

#[derive(Debug, Clone, Default)]
struct Counts {
    points: u64,
    sigmas: f64,
    ended: BTreeMap<TrajectoryEnd, u64>,
    /// Points that had a next moment, and those that were not in it.
    followed: u64,
    not_found: u64,
    regenerated: u64,
    appeared: u64,
}

/// What all points did from one moment with pictures to the next.
#[derive(Debug)]
struct Step {
    /// Median over the points [m].
    median: Vector3<f64>,
    /// Root mean square distance of theirs from it [m].
    spread: f64,
    /// How long it took [s].
    dt_s: f64,
    /// Over how many moments, those without points counted.
    moments: u32,
}

impl Node for Tracker {
    const TYPE: &'static str = "surface.tracker";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Tracks points of a textured surface in time and between views, without markers";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TrackerSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TrackerSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("patch_px", settings.patch_px, 7..=2 * MAX_REACH + 1)?;
        if settings.patch_px.is_multiple_of(2) {
            return Err(ConfigError::at(
                "patch_px",
                format_args!("found {}, expected an odd number", settings.patch_px),
            ));
        }
        ConfigError::unless_in("first_search_px", settings.first_search_px, 1.0..=500.0)?;
        ConfigError::unless_in("search_px", settings.search_px, 1.0..=500.0)?;
        ConfigError::unless_in("min_correlation", settings.min_correlation, 0.0..=0.999)?;
        ConfigError::unless_in("agree_px", settings.agree_px, 0.01..=10.0)?;
        ConfigError::unless_in("max_speed", settings.max_speed, 1e-4..=1e3)?;
        ConfigError::unless_in("max_acceleration", settings.max_acceleration, 1e-4..=1e5)?;
        ConfigError::unless_in("uniform_radius_mm", settings.uniform_radius_mm, 0.0..=1e3)?;
        ConfigError::unless_in("uniform_part", settings.uniform_part, 0.0..=1.0)?;
        ConfigError::unless_in("uniform_scatters", settings.uniform_scatters, 0.0..=100.0)?;
        ConfigError::unless_in("uniform_mm", settings.uniform_mm, 0.0..=100.0)?;
        ConfigError::unless_in("remember", settings.remember, 0..=1000)?;
        let prepared = settings.surface.prepare(setup).map_err(|it| match it.setting {
            Some(name) => ConfigError::at(&format!("surface.{name}"), it.message),
            None => it,
        })?;
        if let n @ 2.. = prepared.references.len() {
            return Err(ConfigError::at(
                "surface.reference",
                format_args!("found a name of {n} cameras, expected one: points are followed in its pictures"),
            ));
        }
        let mut matching = prepared.measure.matching;
        matching.min_correlation = settings.min_correlation;
        let mut held = prepared.measure.clone();
        held.matching.min_correlation = held.matching.min_correlation.min(settings.min_correlation);
        held.matching.max_sigma_px *= HELD;
        held.max_back_px *= HELD;
        let boxes_px = [settings.first_search_px.max(settings.search_px), settings.search_px];
        let n_levels = prepared.seeds.n_levels.max(SearchPyramid::levels_for(boxes_px[0]));
        Ok(Self {
            engine: Engine::new(prepared),
            held,
            options: TrackOptions {
                reach: settings.patch_px / 2,
                matching,
                boxes_px,
                agree_px: settings.agree_px,
                remember: settings.remember,
                radius_m: 0.0,
            },
            filters: FilterOptions {
                max_speed: settings.max_speed,
                max_acceleration: settings.max_acceleration,
                radius_m: 0.0,
                uniform_part: settings.uniform_part,
                uniform_scatters: settings.uniform_scatters,
                uniform_m: 0.0,
            },
            creep: CreepOptions { radius_m: 0.0, scatters: settings.uniform_scatters, error_m: 0.0 },
            uniform_m: [settings.uniform_radius_mm, settings.uniform_mm].map(|it| it * 1e-3),
            renew: settings.renew,
            moments: [Moment::default(), Moment::default()],
            n_levels,
            state: State::default(),
            guide: Guide::default(),
            stepper: Stepper::default(),
            coverages: Vec::new(),
            steps: Vec::new(),
            without: 0,
            faults: Vec::new(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(bodies) = io.latest(&SKELETONS) {
            self.guide.take(bodies.value);
        }
        let images: Vec<_> = io.take_set(&IMAGE).collect();
        let Some(time) = images.iter().map(Stamped::time).max() else { return Ok(()) };
        self.moments.swap(0, 1);
        self.faults.extend(self.engine.take(&mut self.moments[0], &images, self.n_levels));
        self.moments[0].time = time;
        let before = self.state.clone();
        let tracked = match missing(&self.engine, &self.moments[0]) {
            Some(why) => Err(why),
            None => {
                let tracked = self.follow(time);
                let points = self.state.tracks.iter().map(|it| (&it.sample, &it.normal));
                self.engine.give(points).map_or(Ok(tracked), Err)
            }
        };
        let (mut tracked, step) = match tracked {
            Ok(tracked) => tracked,
            Err(why) => {
                // The moment before stays what points are followed from.
                self.moments.swap(0, 1);
                self.state = before;
                self.without += 1;
                io.gap(&TRACKED, time, why.clone());
                io.gap(&CLOUD, time, why);
                return Ok(());
            }
        };
        self.without = 0;
        self.steps.extend(step);
        let widened = self.engine.widened();
        let samples: Vec<&Sample> = self.state.tracks.iter().map(|it| &it.sample).collect();
        let places = self.engine.straightened(&samples);
        for (point, (position, covariance)) in tracked.list.iter_mut().zip(&places) {
            (point.position, point.covariance) = (*position, covariance * widened);
        }
        let spacing = self.engine.prepared.cover.spacing_px;
        let cells: BTreeSet<[usize; 2]> =
            self.state.tracks.iter().map(|it| crate::cover::cell_of(it.sample.pixel, spacing)).collect();
        self.coverages.extend(coverage(cells.iter().copied()));
        self.state.counts.points += tracked.list.len() as u64;
        self.state.counts.sigmas += widened.sqrt() * places.iter().map(|it| sigma(&it.1)).sum::<f64>();
        io.emit_at(&TRACKED, time, tracked);
        io.emit_at(&CLOUD, time, self.cloud(&places));
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let counts = &self.state.counts;
        self.engine.report(report);
        report.figure("surface.points", counts.points as f64);
        report.figure("surface.sigma_mm", 1e3 * counts.sigmas / counts.points as f64);
        report.figure("surface.coverage", self.coverages.iter().sum::<f64>() / self.coverages.len() as f64);
        report.figure("trajectories.count", f64::from(self.state.next_id));
        report.figure("trajectories.mean_samples", counts.points as f64 / f64::from(self.state.next_id));
        for (end, count) in &counts.ended {
            report.figure(format!("trajectories.ended.{}", end.name()), *count as f64);
        }
        for (what, count) in &self.stepper.failed {
            report.figure(format!("trajectories.failed.{what}"), *count as f64);
        }
        report.figure("trajectories.second_look", self.stepper.second as f64);
        report.figure("trajectories.lost_share", counts.not_found as f64 / counts.followed as f64);
        report.figure("trajectories.regenerated", counts.regenerated as f64);
        report.figure("trajectories.guided", self.stepper.guided as f64);
        report.figure("trajectories.appeared", counts.appeared as f64);
        report.figure("trajectories.ambiguous", self.stepper.ambiguous as f64);
        let Stepper { searched, ambiguous, .. } = self.stepper;
        let is_repeating = ambiguous as f64 > REPEATING * searched as f64;
        if is_repeating {
            report.remark(format!(
                "{ambiguous} of {searched} searches for a patch in the next picture were ambiguous: the texture repeats, expected another texture, or a `search_px` and \
                 a `first_search_px` of less than half of its period, for slower motion from picture to picture"
            ));
        }
        let lost = counts.not_found as f64 / counts.followed as f64;
        let ended = |why| counts.ended.get(&why).copied().unwrap_or(0) as f64 / counts.followed as f64;
        let [uneven, fast] = [TrajectoryEnd::NotUniform, TrajectoryEnd::TooFast].map(ended);
        if fast > 0.5 * LOST {
            report.remark(format!(
                "{:.0} % of the points move faster than `max_speed` = {} m/s, and were ended: expected a calibration in metres, the right `rate_hz`, or a larger `max_speed`",
                100.0 * fast,
                self.filters.max_speed
            ));
        } else if uneven > 0.5 * LOST {
            report.remark(format!(
                "{:.0} % of the points move unlike their neighbours, or have too few neighbours: expected a `uniform_radius_mm` of three places of the grid or more ({:.1} mm now), and a `uniform_mm` of what \
                 a point's error ({:.2} mm now); 0 estimates both",
                100.0 * uneven,
                1e3 * self.options.radius_m,
                1e3 * self.filters.uniform_m
            ));
        } else if lost > LOST && !is_repeating {
            let [first, later] = self.options.boxes_px;
            report.remark(format!(
                "{:.0} % of the points were not found in the next picture: they move farther from picture to picture than the search (`first_search_px` = {first}, `search_px` = {later}), pictures \
                 are missing between, or the light changes; expected a larger search, or more pictures a second",
                100.0 * lost
            ));
        }
        let n = self.steps.len() as f64;
        let mean = mean_step(&self.steps);
        for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
            report.figure(format!("step_mm.{name}"), 1e3 * mean[axis]);
        }
        report.figure("step_mm.spread", 1e3 * self.steps.iter().map(|it| it.spread).sum::<f64>() / n);
        if let Some(sides) = self.engine.other_sides() {
            report.remark(format!("{sides}; expected a tracker for each side (`surface.reference`)"));
        }
        report_faults(&mut self.faults, report);
        Ok(())
    }
}

impl Tracker {
    /// Limits that go by how far points lie apart, and how well they are known.
    fn scale(&mut self, tracks: &[Track]) {
        let Prepared { views, reference, cover, .. } = &self.engine.prepared;
        let camera = &views[*reference].camera;
        let pixel = |it: &Track| (camera.camera_from_world * it.sample.position).z / camera.intrinsics.focal[0];
        let middle = |of: &dyn Fn(&Track) -> f64| median(&tracks.iter().map(of).collect::<Vec<_>>());
        let places_m = middle(&pixel).map(|it| RADIUS_PLACES * cover.spacing_px as f64 * it);
        let found = [places_m, middle(&|it| it.sample.sigma())];
        let before = [self.options.radius_m, self.filters.uniform_m];
        let [radius_m, error_m] = [0, 1].map(|it| match self.uniform_m[it] {
            0.0 => found[it].unwrap_or(before[it]),
            set => set,
        });
        (self.options.radius_m, self.filters.radius_m, self.creep.radius_m) =
            (radius_m, radius_m, CREEP_RADII * radius_m);
        (self.filters.uniform_m, self.creep.error_m) = (error_m, CREEP_ERRORS * error_m);
    }

    /// Takes the points from the moment before to now.
    fn follow(&mut self, time: Time) -> (TrackedSurface, Option<Step>) {
        let before = std::mem::take(&mut self.state.tracks);
        let is_first = before.is_empty() && self.state.next_id == 0;
        let dt_s = (time - self.moments[1].time).as_s();
        let mut ended = Vec::new();
        let mut now = Vec::new();
        let mut step = None;
        self.scale(&before);
        if (!before.is_empty() || !self.state.lost.is_empty()) && dt_s > 0.0 {
            let [present, past] = &self.moments;
            let Engine { measurer, prepared, .. } = &mut self.engine;
            let (views, measure) = (&prepared.views, &self.held);
            let stepped =
                self.stepper.step(measurer, views, [past, present], dt_s, before.clone(), measure, &self.options);
            let (held, false_ones) = filter(stepped.found, &before, dt_s, &self.filters);
            let (held, merged) = unmerged(held, prepared.cover.spacing_px);
            self.state.counts.followed += before.len() as u64;
            self.state.counts.not_found += (before.len() - held.len()) as u64;
            step = median_step(&held, dt_s, 1 + self.without);
            let around = Neighbourhood::of_a_step(&held, self.filters.radius_m, dt_s);
            let search = Search {
                views,
                moments: [past, present],
                found: &around,
                guide: &self.guide,
                measure,
                options: &self.options,
            };
            let again = self.stepper.regenerate(measurer, &mut self.state.lost, &search);
            self.state.counts.regenerated += again.len() as u64;
            if self.options.remember > 0 {
                let missed = stepped.ended.iter().map(|it| it.0.clone());
                self.state.lost.extend(missed.filter_map(|it| LostTrack::of(it, &mut self.stepper, &search)));
            }
            for (track, end) in stepped.ended.into_iter().chain(false_ones).chain(merged) {
                *self.state.counts.ended.entry(end).or_default() += 1;
                ended.push((track.id, end));
            }
            now = held;
            now.extend(again);
        }
        let number = self.state.numbers.begin();
        let is_crept = crept(&now, number, &self.creep);
        let mut flags = is_crept.iter();
        now.retain(|it| {
            let is_crept = flags.next() == Some(&true);
            if is_crept {
                *self.state.counts.ended.entry(TrajectoryEnd::Crept).or_default() += 1;
                ended.push((it.id, TrajectoryEnd::Crept));
            }
            !is_crept
        });
        self.state.tracks = now;
        for id in self.cover(is_first) {
            *self.state.counts.ended.entry(TrajectoryEnd::Alone).or_default() += 1;
            ended.push((id, TrajectoryEnd::Alone));
        }
        ended.sort_unstable();
        self.state.numbers.note(&mut self.state.tracks);
        self.state.tracks.sort_by_key(|it| it.id);
        let views = &self.engine.prepared.views;
        let list = self.state.tracks.iter().map(|it| it.point(views)).collect();
        (TrackedSurface { time, list, ended }, step)
    }

    /// Grows new points from those that are followed, or begins where there are none; what lies on another surface than its neighbours goes: the identities
    /// of those.
    fn cover(&mut self, is_first: bool) -> Vec<u32> {
        let moment = &self.moments[0];
        let n_before = self.state.tracks.len();
        let seeds: Vec<Sample> = match n_before {
            0 => self.engine.begin(moment),
            _ => self.state.tracks.iter().map(|it| it.sample.clone()).collect(),
        };
        if !self.renew && n_before > 0 {
            return Vec::new();
        }
        let are_known = n_before > 0 || self.engine.is_named();
        let mut surface = self.engine.grow(moment, &seeds, are_known);
        if n_before > 0 {
            let Prepared { views, reference, cover, .. } = &self.engine.prepared;
            let beside = crate::cover::crowded(&seeds, &surface, &views[*reference].camera, cover);
            surface.extend(beside);
        }
        let mut tracks = Vec::with_capacity(surface.len());
        let mut kept = vec![false; n_before];
        for it in surface {
            match it.seed.filter(|_| n_before > 0) {
                Some(seed) => {
                    kept[seed] = true;
                    tracks.push(Track { normal: it.normal, ..self.state.tracks[seed].clone() });
                }
                None => {
                    self.state.counts.appeared += u64::from(!is_first);
                    tracks.push(Track::new(self.state.next_id, it.sample, it.normal));
                    self.state.next_id += 1;
                }
            }
        }
        let before = std::mem::replace(&mut self.state.tracks, tracks);
        before.iter().zip(kept).filter(|it| !it.1).map(|it| it.0.id).collect()
    }

    /// The followed points, which lie at `places`, row by row as the reference sees them.
    fn cloud(&self, places: &[Straight]) -> PointCloud {
        let spacing = self.engine.prepared.cover.spacing_px;
        let covered = |it: &Track| Covered {
            cell: crate::cover::cell_of(it.sample.pixel, spacing),
            sample: it.sample.clone(),
            normal: it.normal,
            confidence: 1.0,
            seed: None,
        };
        let mut points: Vec<(Covered, Straight)> =
            self.state.tracks.iter().map(covered).zip(places.iter().copied()).collect();
        points.sort_by_key(|(it, _)| {
            let [x, y] = it.sample.pixel.map(|it| it.round() as i64);
            [y, x]
        });
        let (surface, places): (Vec<Covered>, Vec<Straight>) = points.into_iter().unzip();
        self.engine.cloud(&self.moments[0], &surface, &places, String::new())
    }
}

/// Of points that came closer than half of what the grid has between them, the older one stays.
fn unmerged(mut tracks: Vec<Track>, spacing_px: usize) -> (Vec<Track>, Vec<(Track, TrajectoryEnd)>) {
    let cell_px = spacing_px as f64 / 2.0;
    let mut taken = std::collections::HashSet::new();
    let (mut held, mut merged) = (Vec::with_capacity(tracks.len()), Vec::new());
    tracks.sort_by_key(|it| it.id);
    for track in tracks {
        let cell = track.sample.pixel.map(|it| (it / cell_px) as i64);
        if taken.insert(cell) {
            held.push(track);
        } else {
            merged.push((track, TrajectoryEnd::Merged));
        }
    }
    (held, merged)
}

/// Median step of all points, and the root mean square of what is beside it [m].
fn median_step(tracks: &[Track], dt_s: f64, moments: u32) -> Option<Step> {
    if tracks.is_empty() {
        return None;
    }
    let middle = |axis: usize| {
        let list: Vec<f64> = tracks.iter().map(|it| it.velocity[axis] * dt_s).collect();
        median(&list).unwrap_or(0.0)
    };
    let step = Vector3::new(middle(0), middle(1), middle(2));
    let squares: f64 = tracks.iter().map(|it| (it.velocity * dt_s - step).norm_squared()).sum();
    Some(Step { median: step, spread: (squares / tracks.len() as f64).sqrt(), dt_s, moments })
}

/// The mean step from one moment to the next [m]: one over a moment without pictures counts as two, also where no camera has one.
fn mean_step(steps: &[Step]) -> Vector3<f64> {
    let usual_s = median(&steps.iter().map(|it| it.dt_s / f64::from(it.moments)).collect::<Vec<_>>()).unwrap_or(1.0);
    let moments: f64 = steps.iter().map(|it| (it.dt_s / usual_s).round().max(1.0)).sum();
    steps.iter().map(|it| it.median).sum::<Vector3<f64>>() / moments
}
