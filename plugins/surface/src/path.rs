//! Detection of creep, which no filter of single steps sees: displacements of points since they were first seen are compared with those of their neighbours.
//!
//! The edge of a shadow drags a point along by a fraction of a pixel in each step, and a mirrored lamp holds up what passes below it. Paths are kept at common moments. From the earliest of them
//! that a point has in common with enough of its neighbours, and from one half way, their displacements are fitted by an affine map of the tangent plane (rigid motion, and stretching cloth), wrong
//! ones weighted down; what is off by more than the neighbours scatter has crept. The worst go first, and no longer count as neighbours: what creeps, creeps in company.

use std::collections::HashMap;

use foveate::estimation::statistics::median;
use nalgebra::{Matrix3, Point3, Vector3};

use crate::tracks::Track;

/// Moments at which paths are kept, at most: beyond, every other one is dropped.
const MOST_MOMENTS: usize = 24;
/// Neighbours in common that an affine map is fitted to, at least.
const LEAST_NEIGHBOURS: usize = 8;
/// Rounds of taking out the worst.
const ROUNDS: usize = 8;
/// Of those beyond the limit the ones this near to the worst around go in one round, [–]
const AS_BAD: f64 = 0.6;

/// The moments at which paths are kept, the same for all points.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Moments {
    now: u32,
    stride: u32,
}

impl Default for Moments {
    fn default() -> Self {
        Self { now: 0, stride: 1 }
    }
}

impl Moments {
    /// Begins the next moment: its number.
    pub fn begin(&mut self) -> u32 {
        self.now += 1;
        if self.now / self.stride > MOST_MOMENTS as u32 {
            self.stride *= 2;
        }
        self.now
    }

    /// Adds to each path where the point is now, and drops moments that are no longer kept.
    pub fn note(&self, tracks: &mut [Track]) {
        let Self { now, stride } = *self;
        for track in tracks {
            let place = track.sample.position;
            track.path.retain(|it| it.0.is_multiple_of(stride));
            if now.is_multiple_of(stride) && track.path.last().is_none_or(|it| it.0 < now) {
                track.path.push((now, place));
            }
        }
    }
}

/// How far a path may be off what its neighbours say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CreepOptions {
    /// Neighbours lie within this [m].
    pub radius_m: f64,
    /// By so many median distances of the neighbours' own displacements, [–]
    pub scatters: f64,
    /// and by this error of positions [m].
    pub error_m: f64,
}

/// Which of `tracks`, as they lie at moment `now`, have crept.
pub fn crept(tracks: &[Track], now: u32, options: &CreepOptions) -> Vec<bool> {
    let cell = |at: &Point3<f64>| [0, 1, 2].map(|axis| (at[axis] / options.radius_m).floor() as i32);
    let mut cells: HashMap<[i32; 3], Vec<usize>> = HashMap::new();
    for (index, track) in tracks.iter().enumerate().filter(|it| it.1.path.first().is_some_and(|it| it.0 < now)) {
        cells.entry(cell(&track.sample.position)).or_default().push(index);
    }
    let around = |index: usize| {
        let at = &tracks[index].sample.position;
        let [x, y, z] = cell(at);
        let mut near = Vec::new();
        for place in (0..27).map(|it| [x + it / 9 - 1, y + it / 3 % 3 - 1, z + it % 3 - 1]) {
            let listed = cells.get(&place).into_iter().flatten().copied();
            near.extend(listed.filter(|it| (tracks[*it].sample.position - at).norm() <= options.radius_m));
        }
        near
    };
    let held: Vec<usize> = {
        let mut all: Vec<usize> = cells.values().flatten().copied().collect();
        all.sort_unstable();
        all
    };
    let neighbours: HashMap<usize, Vec<usize>> = held.iter().map(|it| (*it, around(*it))).collect();
    let mut is_crept = vec![false; tracks.len()];
    let mut excess = vec![0.0; tracks.len()];
    // After the first round only what had a neighbour taken out is asked again.
    let mut asked = held.clone();
    for _ in 0..ROUNDS {
        for &index in &asked {
            let near: Vec<&Track> = neighbours[&index]
                .iter()
                .filter(|it| **it != index && !is_crept[**it])
                .map(|it| &tracks[*it])
                .collect();
            excess[index] = excess_of(&tracks[index], &near, now, options).unwrap_or(0.0);
        }
        let worst_around = |index: usize| {
            neighbours[&index].iter().filter(|it| !is_crept[**it]).map(|it| excess[*it]).fold(0.0, f64::max)
        };
        let out: Vec<usize> = held
            .iter()
            .copied()
            .filter(|it| !is_crept[*it] && excess[*it] > 1.0 && excess[*it] >= AS_BAD * worst_around(*it))
            .collect();
        if out.is_empty() {
            break;
        }
        out.iter().for_each(|it| is_crept[*it] = true);
        asked = out.iter().flat_map(|it| neighbours[it].iter().copied()).filter(|it| !is_crept[*it]).collect();
        asked.sort_unstable();
        asked.dedup();
    }
    is_crept
}

/// How far a path is off, over how far it may be: the worse of two stretches of time. `None` where too few neighbours have a path in common with it.
fn excess_of(track: &Track, near: &[&Track], now: u32, options: &CreepOptions) -> Option<f64> {
    let earlier = &track.path[..track.path.partition_point(|it| it.0 < now)];
    let first = (0..earlier.len()).find_map(|at| Some((at, off_since(track, near, earlier[at], options)?)))?;
    let half = earlier[(first.0 + earlier.len()) / 2..].first().filter(|it| it.0 > earlier[first.0].0);
    let later = half.and_then(|it| off_since(track, near, *it, options));
    Some(later.unwrap_or(0.0).max(first.1))
}

/// The same since one moment.
fn off_since(
    track: &Track,
    near: &[&Track],
    (moment, from): (u32, Point3<f64>),
    options: &CreepOptions,
) -> Option<f64> {
    let then = |it: &Track| it.path.binary_search_by_key(&moment, |it| it.0).ok().map(|at| it.path[at].1);
    // What moved, off where, beside the point.
    let mut beside: Vec<(Vector3<f64>, Vector3<f64>)> = Vec::with_capacity(near.len());
    for it in near {
        if let Some(place) = then(it) {
            beside.push((place - from, it.sample.position - place));
        }
    }
    if beside.len() < LEAST_NEIGHBOURS {
        return None;
    }
    // In the tangent plane, across which a place is less well known and measured anew each time.
    let normal = track.normal;
    let flat = |it: Vector3<f64>| it - normal * normal.dot(&it);
    let (u, v) = tangents(&normal, &beside);
    let row = |off: &Vector3<f64>| Vector3::new(1.0, off.dot(&u), off.dot(&v));
    let middle = |axis: usize| median(&beside.iter().map(|it| it.1[axis]).collect::<Vec<f64>>()).unwrap_or(0.0);
    let mut map = Matrix3::from_rows(&[
        Vector3::from_fn(|axis, _| middle(axis)).transpose(),
        Vector3::zeros().transpose(),
        Vector3::zeros().transpose(),
    ]);
    let off = |map: &Matrix3<f64>, it: &(Vector3<f64>, Vector3<f64>)| flat(it.1 - map.transpose() * row(&it.0)).norm();
    let mut scatter = 0.0;
    let mut leverage = 0.0;
    for _ in 0..ROUNDS {
        let all: Vec<f64> = beside.iter().map(|it| off(&map, it)).collect();
        scatter = median(&all)?;
        let scale = (2.0 * scatter).max(0.1 * options.error_m).max(1e-12);
        let (mut information, mut side) = (Matrix3::zeros(), Matrix3::zeros());
        for (it, off) in beside.iter().zip(&all) {
            let weight = 1.0 / (1.0 + (off / scale).powi(2)).powi(2);
            let row = row(&it.0);
            information += weight * row * row.transpose();
            side += weight * row * it.1.transpose();
        }
        let inverse = information.try_inverse()?;
        leverage = inverse[(0, 0)];
        let next = inverse * side;
        let settled = (next - map).row(0).norm() < 0.01 * options.error_m;
        map = next;
        if settled {
            break;
        }
    }
    let went = track.sample.position - from;
    let is_off = flat(went - map.row(0).transpose()).norm();
    let limit = (options.error_m + options.scatters * scatter) * (1.0 + leverage).sqrt();
    Some(is_off / limit)
}

/// Two directions in which neighbours spread: across the normal, or, where none is known, the ones they spread in most.
fn tangents(normal: &Vector3<f64>, beside: &[(Vector3<f64>, Vector3<f64>)]) -> (Vector3<f64>, Vector3<f64>) {
    let spread = beside.iter().fold(Matrix3::zeros(), |sum, it| sum + it.0 * it.0.transpose());
    let eigen = spread.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let across: Vector3<f64> =
        if normal.norm() > 0.5 { *normal } else { eigen.eigenvectors.column(least).into_owned() };
    let along: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    let u = (along - across * across.dot(&along)).try_normalize(1e-9).unwrap_or_else(|| {
        let any = if across.x.abs() < 0.9 { Vector3::x() } else { Vector3::y() };
        (any - across * across.dot(&any)).normalize()
    });
    (u, across.cross(&u))
}

#[cfg(test)]
mod tests {
    use nalgebra::Point3;

    use super::*;
    use crate::measure::Sample;

    /// A grid of 11 × 11 points 4 mm apart that turns and stretches from moment to moment; those that `creeps` names go 0.15 mm astray in each.
    fn found(creeps: impl Fn(usize) -> bool, n_moments: u32) -> Vec<usize> {
        let place = |index: usize, k: f64| {
            let (x, y) = (4e-3 * (index % 11) as f64, 4e-3 * (index / 11) as f64);
            let (sine, cosine) = (0.02 * k).sin_cos();
            let astray = if creeps(index) { 1.5e-4 * k } else { 0.0 };
            let stretch = 1.0 + 0.002 * k;
            Point3::new(stretch * (cosine * x - sine * y) + 1e-3 * k + astray, stretch * (sine * x + cosine * y), 0.0)
        };
        let sample = |position: Point3<f64>| Sample {
            reference: 0,
            pixel: [0.0; 2],
            seen: Vec::new(),
            position,
            covariance: Matrix3::zeros(),
            correlation: 1.0,
            misfit_px: 0.0,
        };
        let mut moments = Moments::default();
        let mut tracks: Vec<Track> =
            (0..121).map(|it| Track::new(it as u32, sample(place(it, 0.0)), Vector3::z())).collect();
        let options = CreepOptions { radius_m: 0.015, scatters: 5.0, error_m: 4e-4 };
        let mut all = Vec::new();
        for k in 1..=n_moments {
            let number = moments.begin();
            for (index, track) in tracks.iter_mut().enumerate() {
                track.sample.position = place(index, f64::from(k));
            }
            all = crept(&tracks, number, &options);
            moments.note(&mut tracks);
        }
        (0..all.len()).filter(|it| all[*it]).collect()
    }

    #[test]
    fn what_creeps_beside_neighbours_that_turn_and_stretch_is_found_and_nothing_else() {
        assert_eq!(found(|_| false, 8), Vec::<usize>::new());
        // One inside, one at the border, and two together.
        for creeping in [vec![60], vec![5], vec![48, 49]] {
            assert_eq!(found(|it| creeping.contains(&it), 8), creeping);
        }
        // After one step it is within what a place may be off.
        assert_eq!(found(|it| it == 60, 2), Vec::<usize>::new());
    }
}
