//! Compares clouds of several references where they share a surface.
//!
//! A camera that was moved, or whose lens is another, is not visible in points that it and one other camera see: along their epipolar line every depth fits. But two clouds whose points do not come of the same
//! cameras are then apart. Each point of one is projected into the other's picture: it is off the surface there where it lies in front of it, which that camera would have seen, or close behind it.

use std::collections::HashMap;

use foveate::estimation::statistics::median;
use foveate::prelude::*;

use crate::cover::{CoverOptions, Covered, cell_of, remove};
use crate::measure::Sample;
use crate::views::View;

/// Most points of a cloud that are compared with the others.
const ASKED: usize = 2000;
/// Places at which two clouds are compared, at least.
const LEAST_PLACES: usize = 40;
/// A point is off another cloud's surface by so many standard deviations of both, and by what the surface may bend between two points [–].
const OFF: f64 = 4.0;
/// Radius of curvature that a surface may have, in distances between points.
const ROUND: f64 = 5.0;
/// Of one surface, seen by cameras that are as they were calibrated, fewer places are off [–].
const CONTRADICTS: f64 = 0.05;
/// A camera is named where the places at which it alone has no part are off by less than this part of all [–].
const WITHOUT: f64 = 0.3;

/// What was found over all moments.
#[derive(Debug, Default)]
pub struct Clouds {
    /// By view: points that were left out, and how far they lie off what others see [m].
    left_out: HashMap<usize, (u64, Vec<f64>)>,
    /// Moments in which clouds contradict each other and no camera is named, and the largest part of places.
    unnamed: (u64, f64),
}

/// A place that two clouds see.
struct Place {
    /// The views that their points come of.
    views: [Vec<usize>; 2],
    /// How far they lie apart [m].
    off_m: f64,
    is_off: bool,
}

impl Place {
    fn has(&self, view: usize) -> bool {
        self.views.iter().any(|it| it.contains(&view))
    }
}

impl Clouds {
    /// Leaves out what comes of cameras that contradict all others. The surfaces of a moment, each with its reference's number among `views`.
    pub fn settle(&mut self, views: &[View], surfaces: &mut [(usize, Vec<Covered>)], options: &CoverOptions) {
        loop {
            let places = places(views, surfaces, options);
            let all = share(&places, |_| true);
            let Some(all) = all.filter(|it| *it > CONTRADICTS) else { return };
            let without = (0..views.len()).filter_map(|view| {
                places.iter().any(|it| it.has(view)).then_some(())?;
                Some((share(&places, |it| !it.has(view)).unwrap_or(0.0), view))
            });
            let best = without.min_by(|a, b| a.0.total_cmp(&b.0)).filter(|it| it.0 < WITHOUT * all);
            let Some((_, view)) = best else {
                self.unnamed = (self.unnamed.0 + 1, self.unnamed.1.max(all));
                return;
            };
            let (count, offs) = self.left_out.entry(view).or_default();
            offs.extend(places.iter().filter(|it| it.is_off && it.has(view)).map(|it| it.off_m));
            for (_, surface) in surfaces.iter_mut() {
                let out: Vec<usize> =
                    (0..surface.len()).filter(|it| of(&surface[*it].sample).contains(&view)).collect();
                *count += out.len() as u64;
                remove(surface, &out);
            }
        }
    }

    /// How many points were left out.
    pub fn n_left_out(&self) -> u64 {
        self.left_out.values().map(|it| it.0).sum()
    }

    /// Remarks.
    pub fn report(&self, views: &[View], report: &mut Report) {
        let mut named: Vec<_> = self.left_out.iter().collect();
        named.sort_by_key(|it| it.0);
        for (view, (count, offs)) in named {
            report.remark(format!(
                "`{}` contradicts the other cameras: its points are {:.1} mm off those of others, in the median, and {count} were left out: it was moved since it was calibrated, its \
                 calibration is wrong, it is not synchronised, or its pictures are another camera's",
                views[*view].name,
                1e3 * median(offs).unwrap_or(0.0)
            ));
        }
        if let (n @ 1.., share) = self.unnamed {
            report.remark(format!(
                "clouds of different cameras contradict each other in {n} moments, at up to {:.0} % of the places that two of them see, and the faulty camera is ambiguous: some were moved since they were calibrated, or \
                 are not synchronised; points are less accurate than stated",
                100.0 * share
            ));
        }
    }
}

/// The part of places that are off, of those wanted; `None` for too few.
fn share(places: &[Place], wanted: impl Fn(&Place) -> bool) -> Option<f64> {
    let all: Vec<bool> = places.iter().filter(|it| wanted(it)).map(|it| it.is_off).collect();
    (all.len() >= LEAST_PLACES).then(|| all.iter().filter(|it| **it).count() as f64 / all.len() as f64)
}

/// The views that a point comes of.
fn of(sample: &Sample) -> Vec<usize> {
    let mut views: Vec<usize> = sample.seen.iter().map(|it| it.view).chain([sample.reference]).collect();
    views.sort_unstable();
    views
}

/// Points of each cloud in the pictures of the other references, where they come of other views than what that one sees there.
fn places(views: &[View], surfaces: &[(usize, Vec<Covered>)], options: &CoverOptions) -> Vec<Place> {
    let cells: Vec<HashMap<[usize; 2], &Covered>> =
        surfaces.iter().map(|(_, surface)| surface.iter().map(|it| (it.cell, it)).collect()).collect();
    let mut places = Vec::new();
    for (from, (_, surface)) in surfaces.iter().enumerate() {
        for point in surface.iter().step_by(surface.len().div_ceil(ASKED).max(1)) {
            for (to, (reference, _)) in surfaces.iter().enumerate().filter(|it| it.0 != from) {
                places.extend(compared(&views[*reference], point, &cells[to], options));
            }
        }
    }
    places
}

/// Compares a point with another camera's surface.
fn compared(
    to: &View,
    point: &Covered,
    cells: &HashMap<[usize; 2], &Covered>,
    options: &CoverOptions,
) -> Option<Place> {
    let position = point.sample.position;
    let pixel = to.camera.sees(&position)?;
    let there = cells.get(&cell_of([pixel.x, pixel.y], options.spacing_px))?;
    let views = [of(&point.sample), of(&there.sample)];
    if views[0] == views[1] {
        return None;
    }
    let apart = position - there.sample.position;
    let normal = there.normal;
    let before = normal.dot(&apart);
    let spacing = options.spacing_px as f64 * apart_of(to, there);
    let aside = (apart - normal * before).norm();
    // Along its line of sight a point that is far before the surface lies aside of it as well.
    let bend = aside.min(2.0 * spacing).powi(2) / (2.0 * ROUND * spacing);
    let variance = normal.dot(&((point.sample.covariance + there.sample.covariance) * normal));
    let tolerance = OFF * variance.sqrt() + bend;
    let is_far_behind = before < -2.0 * spacing || point.normal.dot(&normal) < 0.5 && before < 0.0;
    (!is_far_behind).then(|| Place { views, off_m: before.abs(), is_off: before.abs() > tolerance })
}

/// A pixel's width at a point's distance [m].
fn apart_of(view: &View, point: &Covered) -> f64 {
    (view.camera.camera_from_world * point.sample.position).z / view.camera.intrinsics.focal[0]
}
