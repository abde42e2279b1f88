//! Seeds of a surface: points found without a prior, or named in the settings.
//!
//! Well textured patches of the reference, spread over its picture, are searched along their epipolar lines in every other view, at a coarse level of the
//! picture, bent as planes of a few directions at that depth would be: views that stand apart see a surface so differently that an unbent patch would not be
//! recognised. A patch whose second best place is nearly as good is ambiguous (a repeated texture) and left out.

use foveate::geometry::Ray;
use foveate::imaging::matching::{MatchBuffers, MatchOptions, SearchBuffers, Template, Warp, match_template, search};
use nalgebra::{Point2, Point3, Vector3};

use crate::measure::{MeasureOptions, Measurer, Sample, plane_warp};
use crate::views::{Moment, View};

/// Options of the search for seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeedOptions {
    /// Tiles along the longer side of the picture, one seed each.
    pub tiles: usize,
    /// Levels of the pictures, the coarsest of which is searched.
    pub n_levels: usize,
    /// The second best place over the best one, at most [–].
    pub max_second: f64,
    /// Correlation at the coarse level, at least [–].
    pub min_correlation: f64,
    /// Nearest and farthest distance from the reference [m].
    pub distance_m: [f64; 2],
}

/// Counts of patches that were tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SeedCounts {
    /// Patches with texture.
    pub tried: u64,
    /// With a place that is nearly as good, and others between that are not.
    pub ambiguous: u64,
    /// That look alike all along the line.
    pub even: u64,
    /// That look like nothing on it.
    pub unlike: u64,
    /// That were seen there coarsely, and refused when they were matched finely.
    pub refused: u64,
    /// Points in the end.
    pub found: u64,
}

/// Half a side of a patch at the coarse level [px].
const REACHES: std::ops::RangeInclusive<usize> = 6..=12;
/// Places along a line at most: a longer one is taken in larger steps.
const MOST_PLACES: usize = 3000;
/// Places this near are one [px at the coarse level].
const ONE_PLACE: f64 = 5.0;
/// Between two places that look alike for a texture that repeats, correlation falls below this part of theirs [–].
const VALLEY: f64 = 0.8;
/// Around each place, for lines that are off by the calibration's error [px at the coarse level].
const AROUND: usize = 1;

/// Finds seeds all over the reference's picture.
pub fn find_seeds(
    measurer: &mut Measurer,
    views: &[View],
    moment: &Moment,
    reference: usize,
    measure: &MeasureOptions,
    options: &SeedOptions,
) -> (Vec<Sample>, SeedCounts) {
    let mut counts = SeedCounts::default();
    let mut seeds = Vec::new();
    let Some(pictures) = moment.pictures[reference].as_ref() else { return (seeds, counts) };
    let level = options.n_levels - 1;
    let Some(coarse) = pictures.level(level) else { return (seeds, counts) };
    let factor = f64::from(1u32 << level);
    let reach = measure.reach.clamp(*REACHES.start(), *REACHES.end());
    let matching = MatchOptions { min_correlation: options.min_correlation, ..measure.matching };
    let mut template = Template::default();
    let mut finder =
        Finder { template: Template::default(), buffers: SearchBuffers::default(), matches: MatchBuffers::default() };
    let (width, height) = coarse.size();
    let tile = width.max(height).div_ceil(options.tiles.max(1)).max(4);
    for top in (0..height).step_by(tile) {
        for left in (0..width).step_by(tile) {
            // Of nine patches in the tile the one whose place is best fixed.
            let places = (0..9).map(|it| {
                let third = |at: usize| (at as f64 + 0.5) * tile as f64 / 3.0;
                [left as f64 + third(it % 3), top as f64 + third(it / 3)].map(f64::round)
            });
            let fixed = |at: [f64; 2], template: &mut Template| {
                template.take(coarse, at, reach, &matching).ok().map(|()| (template.bound().trace(), at))
            };
            let best = places.filter_map(|at| fixed(at, &mut template)).min_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, at)) = best else { continue };
            counts.tried += 1;
            let pixel = at.map(|it| it * factor);
            let Looked { found, kinds } = finder.starts(views, moment, reference, at, reach, &matching, options);
            // Each patch once, whatever several views say of it.
            match () {
                () if kinds.contains(&Kind::Ambiguous) => counts.ambiguous += 1,
                () if kinds.contains(&Kind::Even) => counts.even += 1,
                () if found.is_empty() => counts.unlike += 1,
                () => (),
            }
            if found.is_empty() {
                continue;
            }
            let start = MeasureOptions {
                matching: MatchOptions { max_shift_px: 2.0 * factor, ..measure.matching },
                ..measure.clone()
            };
            match measurer.measure(views, moment, reference, pixel, &found, &start) {
                Ok(sample) => {
                    counts.found += 1;
                    seeds.push(sample);
                }
                Err(_) => counts.refused += 1,
            }
        }
    }
    (seeds, counts)
}

/// Why a patch has no place in a view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Ambiguous,
    Even,
}

/// Places of a patch in other views, and what is wrong in those without one.
#[derive(Debug, Default)]
struct Looked {
    found: Vec<(usize, Warp)>,
    kinds: Vec<Kind>,
}

struct Finder {
    template: Template,
    buffers: SearchBuffers,
    matches: MatchBuffers,
}

impl Finder {
    /// Where the patch around `at` (at the coarse level) lies in each other view, at full resolution.
    #[expect(clippy::too_many_arguments, reason = "half of one function, apart for its length")]
    fn starts(
        &mut self,
        views: &[View],
        moment: &Moment,
        reference: usize,
        at: [f64; 2],
        reach: usize,
        matching: &MatchOptions,
        options: &SeedOptions,
    ) -> Looked {
        let level = options.n_levels - 1;
        let factor = f64::from(1u32 << level);
        let from = &views[reference].camera;
        let pixel = Point2::from(at.map(|it| it * factor));
        let mut looked = Looked::default();
        let Some(pictures) = moment.pictures[reference].as_ref() else { return looked };
        let (Some(ray), Some(coarse)) = (from.ray(&pixel), pictures.level(level)) else { return looked };
        for (view, to) in views.iter().enumerate().filter(|it| it.0 != reference) {
            let Some(other) = moment.pictures[view].as_ref().and_then(|it| it.level(level)) else { continue };
            if self.template.take(coarse, at, reach, matching).is_err() {
                continue;
            }
            // The best of the directions at each place along the line.
            let mut scored: Vec<(f64, Warp)> = Vec::new();
            for point in places(&ray, &to.camera, options.distance_m, factor) {
                let (here, there) = ((from.centre() - point).normalize(), (to.camera.centre() - point).normalize());
                let middle = (here + there).normalize();
                // Towards one view, towards the other, between them, and up and down from there.
                let side = here.cross(&there).try_normalize(1e-9).unwrap_or_else(Vector3::zeros);
                let directions =
                    [middle, here, there, (middle + 0.6 * side).normalize(), (middle - 0.6 * side).normalize()];
                let found = directions.iter().filter_map(|normal| {
                    let warp = plane_warp(from, &to.camera, &point, normal)?;
                    let warp = Warp { at: warp.at.map(|it| it / factor), ..warp };
                    let found = search(&self.template, other, &warp, AROUND, &mut self.buffers)?;
                    Some((found.correlation, found.warp))
                });
                scored.extend(found.max_by(|a, b| a.0.total_cmp(&b.0)));
            }
            let place = |a: &usize, b: &usize| scored[*a].0.total_cmp(&scored[*b].0);
            let Some(first) = (0..scored.len()).max_by(place) else { continue };
            let (best, warp) = scored[first];
            let far = |it: &usize| {
                let at = scored[*it].1.at;
                (at[0] - warp.at[0]).hypot(at[1] - warp.at[1]) > ONE_PLACE
            };
            let second = (0..scored.len()).filter(far).max_by(place);
            if best < options.min_correlation - 0.3 {
                continue;
            }
            if let Some(second) = second.filter(|it| scored[*it].0 > options.max_second * best) {
                let between = &scored[first.min(second)..=first.max(second)];
                let valley = between.iter().map(|it| it.0).fold(1.0, f64::min);
                if valley > VALLEY * scored[second].0 {
                    looked.kinds.push(Kind::Even);
                } else if best >= options.min_correlation {
                    looked.kinds.push(Kind::Ambiguous);
                }
                continue;
            }
            // Bent as it is, which the few directions only guessed.
            let loose = MatchOptions { max_shift_px: 3.0, max_sigma_px: 1.0, ..*matching };
            if let Ok(found) = match_template(&self.template, other, &warp, &loose, &mut self.matches) {
                looked.found.push((view, Warp { at: found.warp.at.map(|it| it * factor), ..found.warp }));
            }
        }
        looked
    }
}

/// Points along a line of sight that a camera sees a pixel of the coarse level apart, `factor` pixels of the picture.
pub(crate) fn places(
    ray: &Ray,
    to: &foveate::geometry::Camera,
    [near, far]: [f64; 2],
    factor: f64,
) -> Vec<Point3<f64>> {
    let at = |part: f64| ray.at(1.0 / (1.0 / near + part * (1.0 / far - 1.0 / near)));
    // The line may leave the picture or pass behind the camera: its length from a few pieces that are seen.
    const PIECES: usize = 32;
    let seen: Vec<Option<Point2<f64>>> = (0..=PIECES).map(|it| to.project(&at(it as f64 / PIECES as f64))).collect();
    let length: f64 = seen.windows(2).filter_map(|it| Some((it[0]? - it[1]?).norm())).filter(|it| it.is_finite()).sum();
    let n = ((length / factor).ceil() as usize).clamp(2, MOST_PLACES);
    (0..=n).map(|it| at(it as f64 / n as f64)).filter(|it| to.sees(it).is_some()).collect()
}
