//! Points of a surface followed from one moment to the next [D'Apuzzo 1999 §2.4].
//!
//! Each view for itself: from where the point's own motion leads to expect it, the best place by cross-correlation in a search box, then a least squares match with
//! the picture before (temporal). At the place where the reference finds it, a match between the views (spatial); where both say the same place, the point is
//! tracked. What is lost is looked for again for a while by the patch it was last seen with, where its neighbours went: then it keeps its identity.

use foveate::imaging::matching::{MatchBuffers, MatchOptions, SearchBuffers, Template, Warp, match_template, search};
use foveate::prelude::*;
use nalgebra::{Point3, Vector3};

use crate::measure::{MeasureOptions, Measurer, Sample};
use crate::views::{Moment, View};

/// How points are followed.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackOptions {
    /// Half a side of the patches that are matched in time [px].
    pub reach: usize,
    /// Gates of these matches.
    pub matching: MatchOptions,
    /// Half the search box of a point whose motion is not known, and of one whose motion is [px].
    pub boxes_px: [f64; 2],
    /// Temporal and spatial match are at most this far apart [px].
    pub agree_px: f64,
    /// Moments for which a lost point is looked for.
    pub remember: u32,
}

/// A point that is followed.
#[derive(Debug, Clone)]
pub struct Track {
    /// Its identity.
    pub id: u32,
    /// As it was seen last.
    pub sample: Sample,
    /// See [`TrackedPoint`].
    pub velocity: Vector3<f64>,
    /// See [`TrackedPoint`].
    pub acceleration: Vector3<f64>,
    /// Samples so far.
    pub n_samples: u32,
    /// As its neighbours say it [–].
    pub normal: Vector3<f64>,
}

/// A point that was lost.
#[derive(Debug, Clone)]
pub struct LostTrack {
    track: Track,
    /// The reference's patch when it was seen last.
    template: Template,
    /// Moments since then.
    age: u32,
}

/// What a step made of the points.
#[derive(Debug, Default)]
pub struct Stepped {
    /// Those that were found, with their velocities, not yet filtered.
    pub found: Vec<Track>,
    /// Those that were not, and why.
    pub ended: Vec<(Track, TrajectoryEnd)>,
}

/// Follows points; holds the memory for that.
#[derive(Debug, Default)]
pub struct Stepper {
    templates: (Template, SearchBuffers),
    template: Template,
    matches: MatchBuffers,
    /// Places of the best correlation with another one as good.
    pub ambiguous: u64,
}

/// A second place this good makes the best one ambiguous.
const AS_GOOD: f64 = 0.97;
/// Correlation of an unbent patch at whole pixels, at least: the match that follows decides.
const MIN_CORRELATION: f64 = 0.5;

impl Stepper {
    /// Follows `tracks` from one moment to the next, `dt_s` later.
    #[expect(clippy::too_many_arguments, reason = "two moments, and how each kind of match goes")]
    pub fn step(
        &mut self,
        measurer: &mut Measurer,
        views: &[View],
        [before, now]: [&Moment; 2],
        dt_s: f64,
        tracks: Vec<Track>,
        measure: &MeasureOptions,
        options: &TrackOptions,
    ) -> Stepped {
        let mut stepped = Stepped::default();
        for track in tracks {
            match self.follow(measurer, views, [before, now], dt_s, &track, measure, options) {
                Ok(sample) => stepped.found.push(track.moved_to(sample, dt_s)),
                Err(end) => stepped.ended.push((track, end)),
            }
        }
        stepped
    }

    #[expect(clippy::too_many_arguments, reason = "one turn of the loop above")]
    fn follow(
        &mut self,
        measurer: &mut Measurer,
        views: &[View],
        moments: [&Moment; 2],
        dt_s: f64,
        track: &Track,
        measure: &MeasureOptions,
        options: &TrackOptions,
    ) -> Result<Sample, TrajectoryEnd> {
        let sample = &track.sample;
        let expected = sample.position + track.velocity * dt_s;
        let box_px = options.boxes_px[usize::from(track.n_samples > 1)];
        let mut temporal = |view: usize, at: [f64; 2]| {
            let camera = &views[view].camera;
            let moved = camera.project(&expected).zip(camera.project(&sample.position));
            let step = moved.map_or_else(nalgebra::Vector2::zeros, |(to, from)| to - from);
            self.temporal(moments, view, at, [at[0] + step.x, at[1] + step.y], box_px, options)
        };
        let place = temporal(sample.reference, sample.pixel).ok_or(TrajectoryEnd::Lost)?;
        let mut starts = Vec::with_capacity(sample.seen.len());
        for seen in &sample.seen {
            if let Some(found) = temporal(seen.view, seen.warp.at) {
                starts.push((seen.view, Warp { at: found.at, ..seen.warp }));
            }
        }
        if starts.is_empty() {
            return Err(TrajectoryEnd::Lost);
        }
        let spatial = measurer.measure(views, moments[1], sample.reference, place.at, &starts, measure);
        let spatial = spatial.map_err(|_| TrajectoryEnd::Lost)?;
        let agrees = spatial.seen.iter().all(|seen| {
            let temporal = starts.iter().find(|it| it.0 == seen.view);
            temporal.is_none_or(|(_, warp)| {
                (warp.at[0] - seen.warp.at[0]).hypot(warp.at[1] - seen.warp.at[1]) <= options.agree_px
            })
        });
        if agrees { Ok(spatial) } else { Err(TrajectoryEnd::Disagreed) }
    }

    /// Where one view sees what it saw at `at` a moment before.
    fn temporal(
        &mut self,
        [before, now]: [&Moment; 2],
        view: usize,
        at: [f64; 2],
        expected: [f64; 2],
        box_px: f64,
        options: &TrackOptions,
    ) -> Option<Warp> {
        let (from, to) = (before.pictures[view].as_ref()?, now.pictures[view].as_ref()?);
        let found = to.search_from(from, at, options.reach, &Warp::shift(expected), box_px, &mut self.templates)?;
        if found.correlation < MIN_CORRELATION {
            return None;
        }
        if found.second > AS_GOOD * found.correlation {
            self.ambiguous += 1;
            return None;
        }
        self.template.take(from.finest(), at, options.reach, &options.matching).ok()?;
        let matched = match_template(&self.template, to.finest(), &found.warp, &options.matching, &mut self.matches);
        Some(matched.ok()?.warp)
    }

    /// Looks for points that were lost where their neighbours among `found` have gone.
    #[expect(clippy::too_many_arguments, reason = "as for a step, and what is lost")]
    pub fn regenerate(
        &mut self,
        measurer: &mut Measurer,
        views: &[View],
        now: &Moment,
        dt_s: f64,
        lost: &mut Vec<LostTrack>,
        found: &Neighbourhood<'_>,
        measure: &MeasureOptions,
        options: &TrackOptions,
    ) -> Vec<Track> {
        let mut again = Vec::new();
        lost.retain_mut(|it| {
            it.age += 1;
            let Some(motion) = found.motion_at(&it.track.sample.position) else { return it.age < options.remember };
            // It went with its neighbours meanwhile.
            it.track.sample.position += motion.velocity * dt_s;
            let sample = it.look(self, measurer, views, now, motion.nearest, measure, options);
            if let Some(sample) = sample {
                let track = Track {
                    sample,
                    velocity: motion.velocity,
                    acceleration: Vector3::zeros(),
                    n_samples: it.track.n_samples + 1,
                    ..it.track.clone()
                };
                again.push(track);
                return false;
            }
            it.age < options.remember
        });
        again
    }
}

impl LostTrack {
    /// A point that was seen at `before` and is not now; `None` where its patch cannot be kept.
    pub fn of(track: Track, before: &Moment, reach: usize, matching: &MatchOptions) -> Option<Self> {
        let mut template = Template::default();
        let picture = before.pictures[track.sample.reference].as_ref()?;
        template.take(picture.finest(), track.sample.pixel, reach, matching).ok()?;
        Some(Self { track, template, age: 0 })
    }

    #[expect(clippy::too_many_arguments, reason = "one turn of the loop that calls it")]
    fn look(
        &self,
        stepper: &mut Stepper,
        measurer: &mut Measurer,
        views: &[View],
        now: &Moment,
        beside: &Track,
        measure: &MeasureOptions,
        options: &TrackOptions,
    ) -> Option<Sample> {
        let reference = self.track.sample.reference;
        let picture = now.pictures[reference].as_ref()?.finest();
        let expected = views[reference].camera.sees(&self.track.sample.position)?;
        let half = options.boxes_px[1].ceil() as usize;
        let start = Warp::shift([expected.x, expected.y]);
        let found = search(&self.template, picture, &start, half, &mut stepper.templates.1)?;
        if found.correlation < MIN_CORRELATION || found.second > AS_GOOD * found.correlation {
            return None;
        }
        let place =
            match_template(&self.template, picture, &found.warp, &options.matching, &mut stepper.matches).ok()?;
        let starts = beside.sample.starts_at(views, place.warp.at);
        measurer.measure(views, now, reference, place.warp.at, &starts, measure).ok()
    }
}

impl Track {
    /// A new point.
    pub fn new(id: u32, sample: Sample, normal: Vector3<f64>) -> Self {
        Self { id, sample, velocity: Vector3::zeros(), acceleration: Vector3::zeros(), n_samples: 1, normal }
    }

    fn moved_to(&self, sample: Sample, dt_s: f64) -> Self {
        let velocity = (sample.position - self.sample.position) / dt_s;
        let known = self.n_samples > 1;
        let acceleration = if known { (velocity - self.velocity) / dt_s } else { Vector3::zeros() };
        Self { id: self.id, sample, velocity, acceleration, n_samples: self.n_samples + 1, normal: self.normal }
    }

    /// As a message has it.
    pub fn point(&self, views: &[View]) -> TrackedPoint {
        let mut cameras = CameraSet::default();
        cameras.insert(views[self.sample.reference].id);
        self.sample.seen.iter().for_each(|it| cameras.insert(views[it.view].id));
        TrackedPoint {
            id: self.id,
            position: self.sample.position,
            velocity: self.velocity,
            acceleration: self.acceleration,
            covariance: self.sample.covariance,
            normal: self.normal,
            cameras,
            provenance: Provenance::Measured,
            n_samples: self.n_samples,
        }
    }
}

/// How what lies around a place moves.
pub struct LocalMotion<'a> {
    /// Component by component the median [m/s].
    pub velocity: Vector3<f64>,
    /// Median distance of the neighbours' velocities from that [m/s].
    pub scatter: f64,
    /// The nearest of them.
    pub nearest: &'a Track,
}

/// Points in cells of space, for their neighbours.
pub struct Neighbourhood<'a> {
    cells: std::collections::HashMap<[i32; 3], Vec<&'a Track>>,
    radius_m: f64,
}

/// Neighbours that tell how a place moves, at least.
const MIN_NEIGHBOURS: usize = 4;

impl<'a> Neighbourhood<'a> {
    /// Those of `tracks` that have a velocity.
    pub fn new(tracks: &'a [Track], radius_m: f64) -> Self {
        let mut cells: std::collections::HashMap<[i32; 3], Vec<&Track>> = std::collections::HashMap::new();
        for track in tracks.iter().filter(|it| it.n_samples > 1) {
            cells.entry(Self::cell(&track.sample.position, radius_m)).or_default().push(track);
        }
        Self { cells, radius_m }
    }

    fn cell(position: &Point3<f64>, radius_m: f64) -> [i32; 3] {
        [0, 1, 2].map(|axis| (position[axis] / radius_m).floor() as i32)
    }

    /// How the points within the radius of `position` move, all but the one of that identity; `None` where there are too few.
    pub fn motion_without(&self, position: &Point3<f64>, id: Option<u32>) -> Option<LocalMotion<'a>> {
        let [x, y, z] = Self::cell(position, self.radius_m);
        let mut near: Vec<(f64, &Track)> = Vec::new();
        for dx in -1..=1 {
            for dy in -1..=1 {
                for dz in -1..=1 {
                    let Some(cell) = self.cells.get(&[x + dx, y + dy, z + dz]) else { continue };
                    for track in cell {
                        let distance = (track.sample.position - position).norm();
                        if distance <= self.radius_m && Some(track.id) != id {
                            near.push((distance, track));
                        }
                    }
                }
            }
        }
        if near.len() < MIN_NEIGHBOURS {
            return None;
        }
        let middle = |mut list: Vec<f64>| {
            list.sort_by(f64::total_cmp);
            list[list.len() / 2]
        };
        let velocity = Vector3::from_fn(|axis, _| middle(near.iter().map(|it| it.1.velocity[axis]).collect()));
        let scatter = middle(near.iter().map(|it| (it.1.velocity - velocity).norm()).collect());
        let nearest = near.iter().min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.id.cmp(&b.1.id)))?.1;
        Some(LocalMotion { velocity, scatter, nearest })
    }

    fn motion_at(&self, position: &Point3<f64>) -> Option<LocalMotion<'a>> {
        self.motion_without(position, None)
    }
}
