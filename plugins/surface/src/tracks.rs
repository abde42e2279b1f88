//! Tracking of surface points from one moment to the next [D'Apuzzo 1999 §2.4].
//!
//! Each view for itself: from where the point's own motion leads to expect it, the best place by cross-correlation in a search box, then a least squares match with
//! the picture before (temporal). At the place where the reference finds it, a match between the views (spatial); where both say the same place, the point is
//! tracked.

use std::collections::{BTreeMap, HashMap};

use foveate::imaging::matching::{
    MatchBuffers, MatchOptions, Refused, SearchBuffers, SplineImage, Template, Warp, match_template, repeats,
};
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
    /// Moments for which a lost point is searched.
    pub remember: u32,
    /// Within this the motion is uniform [m].
    pub radius_m: f64,
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
    /// Where it was at moments that all points keep, by their numbers, ascending.
    pub path: Vec<(u32, Point3<f64>)>,
    /// How its patch was bent in the last step, in the reference's picture [–].
    pub bend: Matrix,
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
    /// Of searches.
    pub templates: (Template, SearchBuffers),
    /// Of one match.
    pub template: Template,
    /// Of one match.
    pub matches: MatchBuffers,
    /// Searches in time that came to a place, of one view each,
    pub searched: u64,
    /// and those of them with another place as good.
    pub ambiguous: u64,
    /// Points that were not found, by what failed.
    pub failed: BTreeMap<&'static str, u64>,
    /// Points that were found where their neighbours went, and not where their own motion led.
    pub second: u64,
    /// Points that were found again where a body said that they are.
    pub guided: u64,
}

/// A second place this good makes the best one ambiguous.
pub const AS_GOOD: f64 = 0.97;
/// Correlation of a patch bent as in the step before, at whole pixels, at least: the match that follows decides.
pub const MIN_CORRELATION: f64 = 0.5;
/// Half the search box of a point beside one that was found: so small that no second place is in it [px].
pub const BESIDE_PX: f64 = 2.0;
/// Places of one picture that correlate so well look the same [–]: a match of either with what follows may pass.
const LOOKS_THE_SAME: f64 = 0.9;
/// Longer periods of a texture are not searched [px].
const MOST_REPEATS_PX: f64 = 32.0;

/// How a patch is bent from one picture to the next: rows.
type Matrix = [[f64; 2]; 2];

/// The bending of a patch that moves without turning.
pub const UNBENT: Matrix = [[1.0, 0.0], [0.0, 1.0]];

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
        let moments = [before, now];
        let earlier = Neighbourhood::new(&tracks, options.radius_m);
        for track in &tracks {
            // A new one goes where its neighbours went before; where nothing has moved yet, it may be anywhere.
            let motion = match track.n_samples {
                1 => earlier.motion_without(&track.sample.position, Some(track.id)),
                _ => None,
            };
            let found = match (motion, track.n_samples) {
                (Some(motion), _) => {
                    let with = track.going_with(&motion);
                    self.follow(measurer, views, moments, dt_s, &with, options.boxes_px[1], measure, options)
                }
                (None, 1) => self.follow(measurer, views, moments, dt_s, track, options.boxes_px[0], measure, options),
                _ => self.follow(measurer, views, moments, dt_s, track, options.boxes_px[1], measure, options),
            };
            match found {
                Ok((sample, bend)) => stepped.found.push(track.moved_to(sample, bend, dt_s)),
                Err(_) => stepped.ended.push((track.clone(), TrajectoryEnd::Lost)),
            }
        }
        // What was not found where its own motion led may be where the neighbours have gone in this step.
        let around = Neighbourhood::of_a_step(&stepped.found, options.radius_m, dt_s);
        let mut again = Vec::new();
        stepped.ended.retain_mut(|(track, end)| {
            let motion = around.motion_without(&track.sample.position, Some(track.id));
            let found = match motion {
                Some(motion) => {
                    // Beside the nearest of them, or about where all went.
                    let beside = Track { velocity: motion.nearest.velocity, ..track.going_with(&motion) };
                    self.follow(measurer, views, moments, dt_s, &beside, BESIDE_PX, measure, options).or_else(|_| {
                        let with = track.going_with(&motion);
                        self.follow(measurer, views, moments, dt_s, &with, options.boxes_px[1], measure, options)
                    })
                }
                None => Err(("no_neighbours", TrajectoryEnd::Lost)),
            };
            match found {
                Ok((sample, bend)) => {
                    again.push(track.moved_to(sample, bend, dt_s));
                    false
                }
                Err((what, why)) => {
                    *self.failed.entry(what).or_default() += 1;
                    *end = why;
                    true
                }
            }
        });
        self.second += again.len() as u64;
        stepped.found.extend(again);
        stepped
    }

    /// Follows one point with a search box, and says what failed.
    #[expect(clippy::too_many_arguments, reason = "one turn of the loop above")]
    fn follow(
        &mut self,
        measurer: &mut Measurer,
        views: &[View],
        moments: [&Moment; 2],
        dt_s: f64,
        track: &Track,
        box_px: f64,
        measure: &MeasureOptions,
        options: &TrackOptions,
    ) -> Result<(Sample, Matrix), (&'static str, TrajectoryEnd)> {
        let sample = &track.sample;
        let expected = sample.position + track.velocity * dt_s;
        let mut temporal = |view: usize, at: [f64; 2]| {
            let camera = &views[view].camera;
            let moved = camera.project(&expected).zip(camera.project(&sample.position));
            let step = moved.map_or_else(nalgebra::Vector2::zeros, |(to, from)| to - from);
            let start = Warp { at: [at[0] + step.x, at[1] + step.y], matrix: track.bend };
            self.temporal(moments, view, at, start, box_px, view == sample.reference, options)
        };
        let place = temporal(sample.reference, sample.pixel).map_err(|it| (it, TrajectoryEnd::Lost))?;
        let mut starts = Vec::with_capacity(sample.seen.len());
        let mut why = "few_views";
        for seen in &sample.seen {
            match temporal(seen.view, seen.warp.at) {
                Ok(found) => starts.push((seen.view, Warp { at: found.at, ..seen.warp })),
                Err(it) => why = it,
            }
        }
        if starts.is_empty() {
            return Err((why, TrajectoryEnd::Lost));
        }
        loop {
            let spatial = measurer.measure(views, moments[1], sample.reference, place.at, &starts, measure);
            let spatial = spatial.map_err(|it| (it.name(), TrajectoryEnd::Lost))?;
            let n_starts = starts.len();
            starts.retain(|(view, warp)| {
                let there = spatial.seen.iter().find(|it| it.view == *view);
                there
                    .is_none_or(|it| (warp.at[0] - it.warp.at[0]).hypot(warp.at[1] - it.warp.at[1]) <= options.agree_px)
            });
            match starts.len() {
                n if n == n_starts => {
                    // A view that lost it may see it again, as its plane lies there: three views are held against one another, two are not.
                    let wider = spatial.starts_at(views, place.at);
                    let again = (wider.len() > spatial.seen.len())
                        .then(|| measurer.measure(views, moments[1], sample.reference, place.at, &wider, measure).ok());
                    let again = again.flatten().filter(|it| it.seen.len() > spatial.seen.len());
                    return Ok((again.unwrap_or(spatial), place.matrix));
                }
                // Of several views those are left out that say two places; what is left agrees in time and in space.
                0 => return Err(("disagreed", TrajectoryEnd::Disagreed)),
                _ => (),
            }
        }
    }

    /// Where one view sees what it saw at `at` a moment before; else what failed. Of a patch that repeats one view is enough to tell that.
    #[expect(clippy::too_many_arguments, reason = "half of one function, apart for its length")]
    fn temporal(
        &mut self,
        [before, now]: [&Moment; 2],
        view: usize,
        at: [f64; 2],
        start: Warp,
        box_px: f64,
        may_repeat: bool,
        options: &TrackOptions,
    ) -> Result<Warp, &'static str> {
        let pictures = before.pictures[view].as_ref().zip(now.pictures[view].as_ref());
        let (from, to) = pictures.ok_or("time_no_picture")?;
        let found = to.search_from(from, at, options.reach, &start, box_px, &mut self.templates);
        let found = found.ok_or("search_outside")?;
        self.searched += 1;
        if found.correlation < MIN_CORRELATION {
            return Err("search_unlike");
        }
        if found.second > AS_GOOD * found.correlation {
            self.ambiguous += 1;
            return Err("search_ambiguous");
        }
        let mut template = std::mem::take(&mut self.template);
        let taken = template.take(from.finest(), at, options.reach, &options.matching);
        let repeats = match taken {
            Ok(()) if may_repeat => self.repeats(&template, from.finest(), box_px),
            _ => Vec::new(),
        };
        self.template = template;
        taken.map_err(in_time)?;
        if may_be_elsewhere(&repeats, &start, &found.warp, box_px) {
            self.ambiguous += 1;
            return Err("search_ambiguous");
        }
        let matched = match_template(&self.template, to.finest(), &found.warp, &options.matching, &mut self.matches);
        Ok(matched.map_err(in_time)?.warp)
    }

    /// Where else `picture`, which a patch was taken from, looks like it, as far off as two places of a search box can be [px].
    pub fn repeats(&mut self, template: &Template, picture: &SplineImage, box_px: f64) -> Vec<[f64; 2]> {
        let reach = (2.0 * box_px).min(MOST_REPEATS_PX).ceil() as usize;
        repeats(template, picture, reach, LOOKS_THE_SAME, &mut self.templates.1)
    }
}

/// What a match with the picture before failed by, apart from what one between views does.
fn in_time(refused: Refused) -> &'static str {
    match refused {
        Refused::Outside => "time_outside",
        Refused::NoTexture => "time_no_texture",
        Refused::NoConvergence => "time_no_convergence",
        Refused::Wandered => "time_wandered",
        Refused::Bent => "time_bent",
        Refused::Radiometry => "time_radiometry",
        Refused::Dissimilar => "time_dissimilar",
        Refused::Vague => "time_vague",
    }
}

/// Whether a place that looked the same as what was found lies in the box of the search, too: of both one does not know which it is.
pub fn may_be_elsewhere(repeats: &[[f64; 2]], start: &Warp, found: &Warp, box_px: f64) -> bool {
    repeats.iter().any(|it| {
        let there = found.apply(*it);
        (0..2).all(|axis| (there[axis] - start.at[axis]).abs() <= box_px + 1.0)
    })
}

/// First `b`, then `a`.
pub fn product(a: &Matrix, b: &Matrix) -> Matrix {
    [0, 1].map(|row| [0, 1].map(|column| a[row][0] * b[0][column] + a[row][1] * b[1][column]))
}

impl Track {
    /// A new point.
    pub fn new(id: u32, sample: Sample, normal: Vector3<f64>) -> Self {
        let (velocity, acceleration) = (Vector3::zeros(), Vector3::zeros());
        Self { id, sample, velocity, acceleration, n_samples: 1, normal, path: Vec::new(), bend: UNBENT }
    }

    /// The same moving and bending as its neighbours do.
    fn going_with(&self, motion: &LocalMotion<'_>) -> Self {
        Self { velocity: motion.velocity, bend: motion.nearest.bend, ..self.clone() }
    }

    fn moved_to(&self, sample: Sample, bend: Matrix, dt_s: f64) -> Self {
        let velocity = (sample.position - self.sample.position) / dt_s;
        let known = self.n_samples > 1;
        let acceleration = if known { (velocity - self.velocity) / dt_s } else { Vector3::zeros() };
        Self { sample, velocity, acceleration, n_samples: self.n_samples + 1, bend, ..self.clone() }
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
    cells: HashMap<[i32; 3], Vec<(Point3<f64>, &'a Track)>>,
    radius_m: f64,
}

/// Neighbours that tell how a place moves, at least.
pub const MIN_NEIGHBOURS: usize = 4;

impl<'a> Neighbourhood<'a> {
    /// Those of `tracks` that have a velocity.
    pub fn new(tracks: &'a [Track], radius_m: f64) -> Self {
        Self::of_a_step(tracks, radius_m, 0.0)
    }

    /// Those of `tracks` that have a velocity, where they were before a step.
    pub fn of_a_step(tracks: &'a [Track], radius_m: f64, dt_s: f64) -> Self {
        let mut cells: HashMap<[i32; 3], Vec<(Point3<f64>, &Track)>> = HashMap::new();
        for track in tracks.iter().filter(|it| it.n_samples > 1) {
            let place = track.sample.position - track.velocity * dt_s;
            cells.entry(Self::cell(&place, radius_m)).or_default().push((place, track));
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
                    for (place, track) in cell {
                        let distance = (place - position).norm();
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

    /// The same of all of them.
    pub fn motion_at(&self, position: &Point3<f64>) -> Option<LocalMotion<'a>> {
        self.motion_without(position, None)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_two_places_in_a_box_that_look_the_same_neither_is_taken() {
        let start = Warp::shift([100.0, 50.0]);
        let repeats = [[20.0, 0.0], [-20.0, 0.0], [0.0, 20.0], [0.0, -20.0]];
        let is_ambiguous =
            |found: [f64; 2], box_px: f64| may_be_elsewhere(&repeats, &start, &Warp::shift(found), box_px);
        // The nearest place that looks the same lies 17 px off where it was expected, either way.
        for found in [[103.0, 50.0], [97.0, 50.0], [100.0, 53.0], [100.0, 47.0]] {
            assert!(is_ambiguous(found, 17.0) && !is_ambiguous(found, 15.0), "{found:?}");
        }
        assert!(!may_be_elsewhere(&[], &start, &start, 30.0));
        // Half as far off in a picture in which the patch is half as wide.
        let narrow = Warp { at: [103.0, 50.0], matrix: [[0.5, 0.0], [0.0, 0.5]] };
        assert!(may_be_elsewhere(&repeats, &start, &narrow, 7.0));
    }

    #[test]
    fn bends_follow_one_another() {
        let (turn, stretch) = ([[0.0, -1.0], [1.0, 0.0]], [[2.0, 0.0], [0.0, 1.0]]);
        // What pointed right is stretched first and then points down; the other way around it is not stretched.
        let right = |it: Matrix| [it[0][0], it[1][0]];
        assert_eq!(right(product(&turn, &stretch)), [0.0, 2.0]);
        assert_eq!(right(product(&stretch, &turn)), [0.0, 1.0]);
    }
}
