//! Distances between clouds that are not registered, along their normals, compared with their stated uncertainty.
//!
//! Each point of a cloud looks for the surface that the clouds before it made, along its normal to either side, for surfaces that look the same way. Where poses of clouds are off by more than a
//! voxel or two, these are layers beside each other, of which each is thin and sure of itself: only the distance between them says that they contradict each other.
//!
//! A cloud contradicts those before it where the median distance is more than `CONTRADICTS` times what is stated and more than a tenth of a voxel. Once one does, a vertex near pairs of points is
//! known no better than these lie apart: for errors of one size on both sides of a pair, E|r| = 2 σ / √π. Vertices without a pair near them are known as those of all clouds are in the median.

use std::collections::HashMap;

use foveate::estimation::statistics::median;
use foveate::geometry::surface::{Patches, Surface, SurfacePoint};
use nalgebra::Point3;

/// Points of a cloud that are asked, evenly picked.
const ASKED: usize = 3000;
/// The surface is searched in so many cells to either side [–].
const CELLS: i32 = 8;
/// Voxels to a cell [–].
const CELL: f64 = 2.0;
/// Cosine between the normals of a pair, at least [–].
const LIKE: f64 = 0.7;
/// Part of the points asked that lie over the surface so far, and number of them, at least: fewer say nothing.
const MIN_SHARE: f64 = 0.05;
const MIN_PAIRS: usize = 60;
/// Distance over what is stated, both medians, above which a cloud contradicts [–]. Twelve simulated turntable clouds make 0.3 with exact poses, and 4, 10, 18, 42 with ones that are off by 0.3, 1, 2, 5 mm where 0.06 mm is stated.
const CONTRADICTS: f64 = 3.0;
/// … and distance over the width of a voxel [–].
const CONTRADICTS_VOXELS: f64 = 0.1;
/// Voxels to a place in which pairs are counted together [–].
const PLACE: f64 = 8.0;

/// A cloud compared with those before it.
#[derive(Debug, Clone, PartialEq)]
pub struct Beside {
    /// Median distance along the normals [m].
    pub distance_m: f64,
    /// Median of its standard deviation, as points and their cameras' poses state it [m].
    pub stated_m: f64,
    /// Whether that contradicts them.
    pub contradicts: bool,
}

/// Pairs at a place.
#[derive(Debug, Clone, Copy, Default)]
struct Pairs {
    /// Sum of distances [m].
    sum: f64,
    n: f64,
}

/// Clouds so far.
pub struct Apart {
    voxel_m: f64,
    patches: Patches,
    places: HashMap<[i32; 3], Pairs>,
    distances: Vec<f64>,
    /// Variances of clouds along their normals, in full, median each [m²].
    variances: Vec<f64>,
    n_contradicting: usize,
}

impl Apart {
    /// Without a cloud yet, for a surface of such voxels; of patches at most `max_patches` are kept.
    pub fn new(voxel_m: f64, max_patches: usize) -> Apart {
        Apart {
            voxel_m,
            patches: Patches::new(CELL * voxel_m, 1, max_patches),
            places: HashMap::new(),
            distances: Vec::new(),
            variances: Vec::new(),
            n_contradicting: 0,
        }
    }

    /// Compares a cloud with those before it, and adds it. `variance`: of where it lies as a whole, beside what its points state [m²]. `None`: it shares too little with them, or is the first.
    pub fn add(&mut self, points: &[SurfacePoint], variance: f64) -> Option<Beside> {
        let beside = self.beside(points, variance);
        if let Some(beside) = &beside {
            self.distances.push(beside.distance_m);
            self.n_contradicting += usize::from(beside.contradicts);
        }
        points.iter().for_each(|it| {
            self.patches.add(it);
        });
        let of_points: Vec<f64> = asked(points).map(|it| variance + variance_of(it)).collect();
        self.variances.extend(median(&of_points));
        beside
    }

    fn beside(&mut self, points: &[SurfacePoint], variance: f64) -> Option<Beside> {
        let of_others = median(&self.variances)?;
        let n_asked = asked(points).count();
        let pairs: Vec<_> = asked(points).filter_map(|it| Some((it, self.nearest(it)?))).collect();
        if pairs.len() < MIN_PAIRS.max((MIN_SHARE * n_asked as f64) as usize) {
            return None;
        }
        for (point, residual) in &pairs {
            for place in [point.position, point.position + point.normal * *residual] {
                let there = self.places.entry(self.place(&place)).or_default();
                *there = Pairs { sum: there.sum + residual.abs(), n: there.n + 1.0 };
            }
        }
        let distances: Vec<f64> = pairs.iter().map(|it| it.1.abs()).collect();
        let stated: Vec<f64> = pairs.iter().map(|(it, _)| (variance_of(it) + variance + of_others).sqrt()).collect();
        let (distance_m, stated_m) = (median(&distances)?, median(&stated)?);
        let contradicts = distance_m > (CONTRADICTS * stated_m).max(CONTRADICTS_VOXELS * self.voxel_m);
        Some(Beside { distance_m, stated_m, contradicts })
    }

    /// Along its normal from a point to the surface so far, which looks the same way there; outwards is positive [m].
    fn nearest(&self, point: &SurfacePoint) -> Option<f64> {
        let at = |step: i32| {
            let place = point.position + point.normal * (f64::from(step) * CELL * self.voxel_m);
            let found = self.patches.nearest(0, &place)?;
            (found.normal.dot(&point.normal) > LIKE).then(|| found.normal.dot(&(found.position - point.position)))
        };
        at(0).or_else(|| {
            (1..=CELLS).find_map(|it| {
                let sides = [at(it), at(-it)].into_iter().flatten();
                sides.min_by(|a, b| a.abs().total_cmp(&b.abs()))
            })
        })
    }

    /// Standard deviation of a vertex along its normal, at least, by where it is; 0 where no cloud contradicts the others [m].
    pub fn least_sigma(&self) -> impl Fn(&Point3<f64>) -> f64 + '_ {
        let anywhere = median(&self.distances).filter(|_| self.n_contradicting > 0);
        move |place| {
            let Some(anywhere) = anywhere else { return 0.0 };
            let distance = self.places.get(&self.place(place)).map_or(anywhere, |it| it.sum / it.n);
            distance * std::f64::consts::PI.sqrt() / 2.0
        }
    }

    fn place(&self, place: &Point3<f64>) -> [i32; 3] {
        [0, 1, 2].map(|it| (place[it] / (PLACE * self.voxel_m)).floor() as i32)
    }
}

/// Variance along its normal [m²].
fn variance_of(point: &SurfacePoint) -> f64 {
    point.normal.dot(&(point.covariance * point.normal))
}

/// Points with a normal, evenly picked.
fn asked(points: &[SurfacePoint]) -> impl Iterator<Item = &SurfacePoint> {
    let step = points.len().div_ceil(ASKED).max(1);
    let is_sound = |it: &&SurfacePoint| it.position.coords.norm_squared().is_finite() && variance_of(it) > 0.0;
    points.iter().step_by(step).filter(is_sound)
}
