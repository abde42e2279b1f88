//! Detection of repeated texture: whether a piece of surface matches as well at another depth.
//!
//! A patch by itself says where it lies as well as its match does, and where else it would lie as well: its line of sight is walked along in the other views, over the distances at which a surface
//! may be. Of one patch that means little: what repeats has noise of its own, and of two places one always looks a little better. So all patches of a piece decide together. A surface that lies
//! where it was found looks clearly better there for nearly all of them, if it has any texture of its own beside the one that repeats; one that was found a period off does so for few. What repeats
//! across the epipolar lines is on none of them.

use foveate::geometry::Camera;
use foveate::imaging::matching::{MatchBuffers, MatchOptions, SearchBuffers, Template, Warp, match_template, search};
use nalgebra::{Point2, Point3, Vector2};

use crate::cover::Covered;
use crate::measure::{MeasureOptions, Sample, plane_warp};
use crate::seeds::places;
use crate::views::{Moment, View};

/// Patches of a piece that are tested: a part of its points, with a lower and an upper bound [–].
const PART: usize = 4;
const LEAST: usize = 12;
const MOST: usize = 48;
/// Around each place of the line, for what the calibration is off [px].
const AROUND: usize = 1;
/// Places this near to the own one are its peak's flank: half of the shortest detectable period [px].
const NEAR_PX: f64 = 4.0;
/// A place of a line is a peak where none so near on it is better [places],
const PEAK: usize = 3;
/// and correlates so well before its patch is bent as it lies there [–].
const COARSELY: f64 = 0.6;
/// Two views say the same depth where they differ by no more than this along their lines [px].
const SAME_PX: f64 = 2.0;
/// The own place is clearly better where what its patches differ by is less than this part of what they do at the other one [–]: for pure noise the two scatter by 15 %.
const CLEARLY: f64 = 0.7;
/// A piece is doubtful where more than this part of its patches look as good elsewhere [–]: of random texture it is none to one in 48, of one that repeats more than half, and a fourth near the rim
/// of a picture (`cargo test -p foveate-surface remarks`).
const DOUBTFUL: f64 = 0.2;

/// Looks for other places; holds the memory for that.
#[derive(Debug, Default)]
pub struct Repeats {
    template: Template,
    search: SearchBuffers,
    matches: MatchBuffers,
}

/// A place on the line of sight at which one view sees the patch again.
#[derive(Debug, Clone, Copy)]
struct Peak {
    view: usize,
    at: [f64; 2],
    /// Distance along the line of sight [m].
    depth: f64,
    correlation: f64,
}

/// What is known of one patch.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Verdict {
    /// It looks clearly best where it is.
    Here,
    /// It looks as good so far off, along the line of sight [m]; whether views say so that do not see it here, and none that does.
    Elsewhere(f64, bool),
}

/// Why a piece of surface is rejected.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elsewhere {
    /// Its patches look as good so far off, along their lines of sight, the median over them [m].
    pub off_m: f64,
    /// Whether it is other views that see them there: no texture that repeats, but cameras that contradict each other.
    pub is_contradicted: bool,
}

impl Repeats {
    /// Whether a piece, given as some of the points of `surface`, looks as good elsewhere.
    pub fn doubt(
        &mut self,
        views: &[View],
        moment: &Moment,
        surface: &[Covered],
        piece: &[usize],
        measure: &MeasureOptions,
        distance_m: [f64; 2],
    ) -> Option<Elsewhere> {
        let mut piece = piece.to_vec();
        piece.sort_unstable();
        let n = (piece.len() / PART).clamp(LEAST, MOST).min(piece.len());
        let asked = (0..n).map(|it| &surface[piece[(2 * it + 1) * piece.len() / (2 * n)]].sample);
        let verdicts: Vec<Verdict> = asked.filter_map(|it| self.ask(views, moment, it, measure, distance_m)).collect();
        let elsewhere = |it: &Verdict| match it {
            Verdict::Here => None,
            Verdict::Elsewhere(off, by_others) => Some((*off, *by_others)),
        };
        let mut found: Vec<(f64, bool)> = verdicts.iter().filter_map(elsewhere).collect();
        found.sort_by(|a, b| a.0.total_cmp(&b.0));
        let by_others = found.iter().filter(|it| it.1).count();
        let is_doubtful = found.len() as f64 > DOUBTFUL * verdicts.len() as f64;
        is_doubtful.then(|| Elsewhere { off_m: found[found.len() / 2].0, is_contradicted: 2 * by_others > found.len() })
    }

    fn ask(
        &mut self,
        views: &[View],
        moment: &Moment,
        sample: &Sample,
        measure: &MeasureOptions,
        distance_m: [f64; 2],
    ) -> Option<Verdict> {
        let from = &views[sample.reference].camera;
        let ray = from.ray(&Point2::from(sample.pixel))?;
        let picture = moment.pictures[sample.reference].as_ref()?.finest();
        self.template.take(picture, sample.pixel, measure.reach, &measure.matching).ok()?;
        let normal = sample.normal(views);
        let mut peaks: Vec<Peak> = Vec::new();
        for (view, to) in views.iter().enumerate().filter(|it| it.0 != sample.reference) {
            let seen = sample.seen.iter().find(|it| it.view == view).map(|it| it.warp.matrix);
            let bent = || Some(plane_warp(from, &to.camera, &sample.position, &normal?)?.matrix);
            let Some(matrix) = seen.or_else(bent) else { continue };
            let along = places(&ray, &to.camera, distance_m, 1.0);
            peaks.extend(self.peaks(moment, view, &to.camera, &along, matrix, measure));
        }
        peaks.iter_mut().for_each(|it| {
            let other = views[it.view].camera.ray(&Point2::from(it.at));
            let point = other.and_then(|other| foveate::geometry::triangulate_rays(&[ray, other]));
            it.depth = point.map_or(f64::NAN, |point| ray.depth_of(&point));
        });
        let apart = |a: [f64; 2], b: [f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        let is_elsewhere = |depth: f64| {
            sample.seen.iter().any(|it| {
                let there = views[it.view].camera.project(&ray.at(depth));
                there.is_none_or(|there| apart([there.x, there.y], it.warp.at) > NEAR_PX)
            })
        };
        let own = sample.seen.iter().map(|it| 1.0 - it.correlation).sum::<f64>() / sample.seen.len() as f64;
        let mut verdict = Verdict::Here;
        let mut least = f64::INFINITY;
        for depth in peaks.iter().map(|it| it.depth).filter(|it| *it > 0.0 && is_elsewhere(*it)) {
            if !holds(measure, &ray.at(depth)) {
                continue;
            }
            // In each view the peak that says so, if there is one.
            let said = views.iter().enumerate().filter_map(|(view, to)| {
                let there = to.camera.project(&ray.at(depth))?;
                let near = peaks.iter().filter(|it| it.view == view && apart(it.at, [there.x, there.y]) < SAME_PX);
                near.map(|it| it.correlation).max_by(f64::total_cmp).map(|it| (view, it))
            });
            let said: Vec<(usize, f64)> = said.collect();
            let other = said.iter().map(|it| 1.0 - it.1).sum::<f64>() / said.len() as f64;
            let is_as_good =
                said.len() > sample.seen.len() || (said.len() == sample.seen.len() && own > CLEARLY * other);
            if is_as_good && other < least {
                least = other;
                let by_others = said.iter().all(|it| sample.seen.iter().all(|seen| seen.view != it.0));
                verdict = Verdict::Elsewhere((depth - ray.depth_of(&sample.position)).abs(), by_others);
            }
        }
        Some(verdict)
    }

    /// Places along a line that look like the patch, each with the patch bent as it lies there.
    fn peaks(
        &mut self,
        moment: &Moment,
        view: usize,
        to: &Camera,
        along: &[Point3<f64>],
        matrix: [[f64; 2]; 2],
        measure: &MeasureOptions,
    ) -> Vec<Peak> {
        let Some(picture) = moment.pictures[view].as_ref().map(|it| it.finest()) else { return Vec::new() };
        let line: Vec<[f64; 2]> = along.iter().filter_map(|it| to.project(it)).map(|it| [it.x, it.y]).collect();
        let found: Vec<Option<(f64, Warp)>> = line
            .iter()
            .map(|at| {
                let found = search(&self.template, picture, &Warp { at: *at, matrix }, AROUND, &mut self.search)?;
                Some((found.correlation, found.warp))
            })
            .collect();
        let score = |it: usize| found[it].map_or(-1.0, |it| it.0);
        let is_peak = |it: &usize| {
            let around = it.saturating_sub(PEAK)..(it + PEAK + 1).min(found.len());
            // Of equals the first.
            score(*it) > COARSELY
                && around
                    .into_iter()
                    .all(|other| score(other) < score(*it) || (score(other) == score(*it) && other >= *it))
        };
        let loose = MatchOptions { max_sigma_px: 10.0 * measure.matching.max_sigma_px, ..measure.matching };
        let mut peaks = Vec::new();
        for index in (0..found.len()).filter(is_peak) {
            let Some((_, start)) = found[index] else { continue };
            let Ok(matched) = match_template(&self.template, picture, &start, &loose, &mut self.matches) else {
                continue;
            };
            // Off the line a point would be a misfit.
            let before = Vector2::from(line[index.saturating_sub(1)]);
            let way = Vector2::from(line[(index + 1).min(line.len() - 1)]) - before;
            let off = Vector2::from(matched.warp.at) - before;
            if off.perp(&way).abs() <= 2.0 * measure.max_misfit_px * way.norm() {
                peaks.push(Peak { view, at: matched.warp.at, depth: f64::NAN, correlation: matched.correlation });
            }
        }
        peaks
    }
}

/// Whether points may lie there.
fn holds(measure: &MeasureOptions, point: &Point3<f64>) -> bool {
    let Some([a, b]) = measure.volume_m else { return true };
    (0..3).all(|axis| (a[axis].min(b[axis])..=a[axis].max(b[axis])).contains(&point[axis]))
}
