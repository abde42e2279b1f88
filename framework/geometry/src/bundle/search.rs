//! Levenberg–Marquardt over cameras and points.

use foveate_estimation::Loss;
use foveate_estimation::least_squares::{Damping, DriverOptions, System, minimise_with_costs};
use foveate_estimation::statistics::median;
use nalgebra::{DMatrix, Isometry3, Matrix6, Point3, SMatrix, SVector, Vector2, Vector3, Vector6};

use super::columns::{CLOCK, N_NAMES};
use super::correlated::{Correlated, Group, Linear, place};
use super::equations::{Equations, Layout, Posed, Reduced};
use super::lengths::Length;
use super::timing::Timing;
use super::{
    Adjusted, BundleError, BundleOptions, Freedom, Gauge, Known, KnownLength, Observation, columns, covariance, gauge,
};
use crate::camera::Camera;

/// Cameras and points are nearly linear in one another: damping falls fast.
const DAMPING: Damping = Damping { initial: 1e-4, least: 1e-12, fastest_decrease: 0.1 };

/// Takes the scene to its centroid and to size 1, and back.
struct Scale {
    centroid: Vector3<f64>,
    size: f64,
}

/// Points so many times as far from the middle as usual have run away, along lines of sight that hardly meet.
const RUN_AWAY: f64 = 30.0;

impl Scale {
    fn of(points: &[Point3<f64>]) -> Scale {
        let middle = |axis: usize| median(&points.iter().map(|it| it[axis]).collect::<Vec<_>>()).unwrap_or(0.0);
        let middle = Vector3::new(middle(0), middle(1), middle(2));
        let distances: Vec<f64> = points.iter().map(|it| (it.coords - middle).norm()).collect();
        let limit = RUN_AWAY * median(&distances).filter(|it| *it > 0.0).unwrap_or(f64::INFINITY);
        let near = || points.iter().zip(&distances).filter(|it| *it.1 <= limit).map(|it| it.0.coords);
        let n = near().count().max(1) as f64;
        let centroid = near().fold(Vector3::zeros(), |sum, it| sum + it) / n;
        let squares: f64 = near().map(|it| (it - centroid).norm_squared()).sum();
        let size = (squares / n).sqrt();
        Scale { centroid, size: if size > 0.0 && size.is_finite() { size } else { 1.0 } }
    }

    fn inwards(&self, camera: &Camera) -> Camera {
        let pose = camera.camera_from_world;
        let translation = (pose.rotation * self.centroid + pose.translation.vector) / self.size;
        Camera { camera_from_world: Isometry3::from_parts(translation.into(), pose.rotation), ..camera.clone() }
    }

    fn outwards(&self, camera: &Camera) -> Camera {
        let pose = camera.camera_from_world;
        let translation = pose.translation.vector * self.size - pose.rotation * self.centroid;
        Camera { camera_from_world: Isometry3::from_parts(translation.into(), pose.rotation), ..camera.clone() }
    }
}

/// Clocks beside what [`super::adjust`] gives.
pub(super) struct FoundClocks {
    /// By camera: offset and drift that were found.
    pub clocks: Vec<[f64; 2]>,
    /// By camera: their rows in `covariance`.
    pub rows: Vec<[Option<usize>; 2]>,
    /// Covariance of all free camera parameters, if requested and if the data determine them.
    pub covariance: Option<DMatrix<f64>>,
}

/// As [`super::adjust`] with camera blocks of width C, and where `TIMED` as [`super::adjust_with_clocks`] by `timing`.
pub(super) fn run<const C: usize, const TIMED: bool>(
    given: &[Camera],
    freedoms: &[Freedom],
    given_points: &[Point3<f64>],
    observations: &[Observation],
    known: &Known<'_>,
    timing: Timing<'_>,
    options: &BundleOptions,
) -> Result<(Adjusted, FoundClocks), BundleError> {
    let scale = Scale::of(given_points);
    let cameras: Vec<Camera> = given.iter().map(|it| scale.inwards(it)).collect();
    let points: Vec<Point3<f64>> =
        given_points.iter().map(|it| Point3::from((it.coords - scale.centroid) / scale.size)).collect();
    let clocks = vec![[0.0; 2]; given.len()];
    let (mut layout, left_out) = lay_out(&cameras, freedoms, &points, observations, timing);
    for &KnownLength { points, length, sigma } in known.lengths {
        if points.iter().all(|it| !layout.of_point[*it].is_empty()) {
            points.iter().for_each(|it| layout.coupled[*it] = true);
            layout.lengths.push(Length { points, length: length / scale.size, sigma: sigma / scale.size });
        }
    }
    layout.known_optics = known.optics.to_vec();
    layout.names = if TIMED { (0..C - 2).chain(CLOCK..N_NAMES).collect() } else { (0..C).collect() };
    if layout.observations.is_empty() {
        return Err(BundleError::NothingShared { observations: observations.len() });
    }
    let mut search = Search::<C, TIMED>::new(&layout, State { cameras, clocks, points }, options.loss);
    let BundleOptions { max_iterations, relative_gain, .. } = *options;
    let driver = DriverOptions { damping: DAMPING, max_iterations, relative_gain, ..DriverOptions::default() };
    let Ok((outcome, costs)) = minimise_with_costs(&mut search, &driver) else {
        return Err(BundleError::NothingShared { observations: observations.len() });
    };
    let Search { mut reduced, here, at, .. } = search;
    let State { cameras, clocks, points } = &at;
    let covariance = options.covariance.then(|| {
        reduced.fill(&layout, &here, 0.0);
        let moved = (scale.centroid, scale.size);
        covariance::of_cameras(&layout, cameras, &reduced.information, options.gauge, moved, |inverse, directions| {
            if known.stretches.is_empty() {
                return inverse;
            }
            correlated(&layout, &here, &reduced, &at, &options.loss, known.stretches).covariance(&inverse, directions)
        })
    });
    let (covariance, of_rows) = match covariance {
        Some(Ok((of_cameras, of_rows))) => (Some(Ok(of_cameras)), Some(of_rows)),
        Some(Err(open)) => (Some(Err(open)), None),
        None => (None, None),
    };
    let mut adjusted = Adjusted {
        cameras: given
            .iter()
            .zip(cameras)
            .zip(freedoms)
            .map(
                |((given, camera), freedom)| {
                    if *freedom == Freedom::NONE { given.clone() } else { scale.outwards(camera) }
                },
            )
            .collect(),
        points: points.iter().map(|it| Point3::from(it.coords * scale.size + scale.centroid)).collect(),
        residuals: Vec::new(),
        rms_px: 0.0,
        left_out,
        costs,
        stop: outcome.stop,
        iterations: outcome.iterations,
        covariance,
    };
    for (point, range) in layout.of_point.iter().enumerate() {
        if range.is_empty() {
            adjusted.points[point] = given_points[point];
        }
    }
    if layout.anchors.is_empty()
        && let Gauge::Cameras { reference, other } = options.gauge
    {
        put_back(&mut adjusted, given, [reference, other], layout.lengths.is_empty());
    }
    let residual = |(index, it): (usize, &Observation)| {
        let seen = adjusted.cameras[it.camera].project(&adjusted.points[it.point])?;
        let [offset, drift] = clocks[it.camera];
        let moved =
            timing.motion(index).map_or_else(Vector2::zeros, |(velocity, time_s)| velocity * (offset + drift * time_s));
        Some(seen - it.pixel - moved)
    };
    adjusted.residuals = observations.iter().enumerate().map(residual).collect();
    let used: Vec<f64> = (0..observations.len())
        .filter(|it| adjusted.left_out.binary_search(it).is_err())
        .filter_map(|it| Some(adjusted.residuals[it]?.norm_squared()))
        .collect();
    adjusted.rms_px = (used.iter().sum::<f64>() / used.len().max(1) as f64).sqrt();
    let rows = layout.rows.iter().map(|it| [it[CLOCK], it[CLOCK + 1]]).collect();
    Ok((adjusted, FoundClocks { clocks: at.clocks, rows, covariance: of_rows }))
}

/// Where an adjustment stands, in the units of the search.
#[derive(Clone)]
struct State {
    cameras: Vec<Camera>,
    clocks: Vec<[f64; 2]>,
    points: Vec<Point3<f64>>,
}

/// An adjustment on its way.
struct Search<'a, const C: usize, const TIMED: bool> {
    layout: &'a Layout,
    loss: Loss,
    at: State,
    candidate: State,
    here: Equations<C, TIMED>,
    there: Equations<C, TIMED>,
    reduced: Reduced<C>,
    of_cameras: Vec<SVector<f64, C>>,
    of_points: Vec<Vector3<f64>>,
}

impl<'a, const C: usize, const TIMED: bool> Search<'a, C, TIMED> {
    fn new(layout: &'a Layout, at: State, loss: Loss) -> Self {
        let (n_free, n_points) = (layout.slots.iter().flatten().count(), at.points.len());
        Search {
            layout,
            loss,
            candidate: at.clone(),
            at,
            here: Equations::new(layout, n_points),
            there: Equations::new(layout, n_points),
            reduced: Reduced::new(layout, n_points),
            of_cameras: vec![SVector::zeros(); n_free],
            of_points: vec![Vector3::zeros(); n_points],
        }
    }
}

impl<const C: usize, const TIMED: bool> System for Search<'_, C, TIMED> {
    fn begin(&mut self) -> Option<f64> {
        let State { cameras, clocks, points } = &self.at;
        self.here.fill(self.layout, cameras, clocks, points, &self.loss)?;
        Some(self.here.cost)
    }

    fn solve(&mut self, damping: f64) -> Option<f64> {
        let Search { layout, here, reduced, of_cameras, of_points, .. } = self;
        reduced.fill(layout, here, damping);
        let step = gauge::solve(layout, &self.at.cameras, &reduced.information, &reduced.gradient)?;
        for (slot, rows) in layout.slots.iter().zip(&layout.rows) {
            if let Some(slot) = *slot {
                of_cameras[slot] = SVector::from_fn(|column, _| rows[layout.names[column]].map_or(0.0, |it| step[it]));
            }
        }
        reduced.step_of_points(layout, here, of_cameras, of_points);
        Some(here.predicted_reduction(of_cameras, of_points, damping))
    }

    fn attempt(&mut self) -> Option<f64> {
        let Search { layout, at, candidate, of_cameras, of_points, .. } = self;
        let end = if TIMED { C - 2 } else { C };
        for (index, slot) in layout.slots.iter().enumerate() {
            let Some(step) = slot.map(|it| &of_cameras[it]) else { continue };
            candidate.cameras[index] = columns::moved(&at.cameras[index], &step.as_slice()[..end]);
            if TIMED {
                candidate.clocks[index] = [0, 1].map(|it| at.clocks[index][it] + step[C - 2 + it]);
            }
        }
        for ((to, from), step) in candidate.points.iter_mut().zip(&at.points).zip(of_points) {
            *to = from + *step;
        }
        self.there.fill(layout, &candidate.cameras, &candidate.clocks, &candidate.points, &self.loss)?;
        Some(self.there.cost)
    }

    fn accept(&mut self) {
        std::mem::swap(&mut self.at, &mut self.candidate);
        std::mem::swap(&mut self.here, &mut self.there);
    }
}

/// All observations at a state that `equations` and `reduced`, without damping, are of. `stretches`: by point.
fn correlated<const C: usize, const TIMED: bool>(
    layout: &Layout,
    equations: &Equations<C, TIMED>,
    reduced: &Reduced<C>,
    state: &State,
    loss: &Loss,
    stretches: &[usize],
) -> Correlated<C> {
    let posed: Vec<Posed<'_>> = state.cameras.iter().map(Posed::new).collect();
    let linear = |at: usize, side: usize, point: usize| -> Option<Linear<C>> {
        let observation = &layout.observations[at];
        let camera = observation.camera;
        let (seen, mut by_camera, by_point) = posed[camera].linearise::<C, TIMED>(&state.points[point])?;
        let mut error = seen - observation.pixel.coords;
        if TIMED {
            let (velocity, time_s) = layout.motions[at];
            let [offset, drift] = state.clocks[camera];
            error -= velocity * (offset + drift * time_s);
            by_camera.set_column(C - 2, &-velocity);
            by_camera.set_column(C - 1, &(velocity * -time_s));
        }
        let per_variance = observation.sigma_px.powi(-2);
        let weight = loss.at(error.norm_squared() * per_variance).1 * per_variance;
        let mut by_unknown = SMatrix::<f64, 2, 6>::zeros();
        by_unknown.fixed_columns_mut::<3>(3 * side).copy_from(&by_point);
        let place = place(&observation.pixel, state.cameras[camera].image_size);
        Some(Linear { camera, weight, by_camera, by_unknown, error, place })
    };
    let of_point = |point: usize, side: usize| -> Vec<Linear<C>> {
        layout.of_point[point].clone().filter_map(|at| linear(at, side, point)).collect()
    };
    let mut groups = Vec::new();
    for point in (0..layout.of_point.len()).filter(|it| !layout.of_point[*it].is_empty() && !layout.coupled[*it]) {
        let (mut inverse, mut gradient) = (Matrix6::zeros(), Vector6::zeros());
        inverse.fixed_view_mut::<3, 3>(0, 0).copy_from(&reduced.inverses[point]);
        gradient.fixed_rows_mut::<3>(0).copy_from(&equations.gradient_of_point[point]);
        groups.push(Group { stretch: stretches[point], seen: of_point(point, 0), inverse, gradient });
    }
    for (length, coupled) in layout.lengths.iter().zip(&reduced.coupled) {
        let [a, b] = length.points;
        let mut seen = of_point(a, 0);
        seen.extend(of_point(b, 1));
        let mut gradient = Vector6::zeros();
        gradient.fixed_rows_mut::<3>(0).copy_from(&equations.gradient_of_point[a]);
        gradient.fixed_rows_mut::<3>(3).copy_from(&equations.gradient_of_point[b]);
        groups.push(Group { stretch: stretches[a], seen, inverse: *coupled.inverse(), gradient });
    }
    let rows = layout.rows.iter().map(|rows| std::array::from_fn(|column| rows[layout.names[column]]));
    let known = layout.known_optics.iter().zip(&layout.rows).flat_map(|(known, rows)| {
        let each = known.sigma.columns().into_iter().enumerate();
        each.filter_map(|(optic, sigma)| Some((rows[6 + optic]?, sigma)).filter(|it| it.1.is_finite()))
    });
    Correlated { groups, rows: rows.collect(), dimension: layout.dimension, known: known.collect() }
}

/// Moves the whole scene so that the pose of `reference`, and if `rescale` its distance to `other`, are those of the `given` cameras.
fn put_back(adjusted: &mut Adjusted, given: &[Camera], [reference, other]: [usize; 2], rescale: bool) {
    let distance = |cameras: &[Camera]| (cameras[other].centre() - cameras[reference].centre()).norm();
    let factor = if rescale { distance(given) / distance(&adjusted.cameras) } else { 1.0 };
    if !factor.is_finite() {
        return;
    }
    for camera in &mut adjusted.cameras {
        camera.camera_from_world.translation.vector *= factor;
    }
    let given_from_found = given[reference].camera_from_world.inverse() * adjusted.cameras[reference].camera_from_world;
    for camera in &mut adjusted.cameras {
        camera.camera_from_world *= given_from_found.inverse();
    }
    for point in &mut adjusted.points {
        *point = given_from_found * Point3::from(point.coords * factor);
    }
    adjusted.cameras[reference].camera_from_world = given[reference].camera_from_world;
}

/// Orders the observations that can be used, and lists the others.
fn lay_out(
    cameras: &[Camera],
    freedoms: &[Freedom],
    points: &[Point3<f64>],
    observations: &[Observation],
    timing: Timing<'_>,
) -> (Layout, Vec<usize>) {
    let seen = |it: &Observation| cameras[it.camera].project(&points[it.point]).is_some();
    let mut order: Vec<usize> = (0..observations.len()).filter(|it| seen(&observations[*it])).collect();
    order.sort_by_key(|it| (observations[*it].point, observations[*it].camera));
    let mut kept = Vec::with_capacity(order.len());
    let mut motions = Vec::new();
    let mut of_point = vec![0..0; points.len()];
    let mut used = vec![false; observations.len()];
    for group in order.chunk_by(|a, b| observations[*a].point == observations[*b].point) {
        let (first, last) = (&observations[group[0]], &observations[group[group.len() - 1]]);
        if first.camera == last.camera {
            continue; // one camera alone does not hold a point
        }
        of_point[first.point] = kept.len()..kept.len() + group.len();
        kept.extend(group.iter().map(|it| observations[*it]));
        motions.extend(group.iter().filter_map(|it| timing.motion(*it)));
        group.iter().for_each(|it| used[*it] = true);
    }
    let mut sees = vec![false; cameras.len()];
    kept.iter().for_each(|it| sees[it.camera] = true);
    let (mut rows, mut slots) = (Vec::with_capacity(cameras.len()), Vec::with_capacity(cameras.len()));
    let (mut dimension, mut n_free) = (0, 0);
    let anchors = (0..cameras.len()).filter(|it| sees[*it] && !freedoms[*it].pose).collect();
    for (camera, (freedom, sees)) in freedoms.iter().zip(sees).enumerate() {
        let (mask, of_clock) = (freedom.mask(), timing.free(camera));
        let own: [Option<usize>; N_NAMES] = std::array::from_fn(|name| {
            let free = if name < CLOCK { mask[name] } else { of_clock[name - CLOCK] };
            (sees && free).then(|| {
                dimension += 1;
                dimension - 1
            })
        });
        let slot = own.iter().any(Option::is_some).then_some(n_free);
        n_free += usize::from(slot.is_some());
        rows.push(own);
        slots.push(slot);
    }
    let left_out = (0..observations.len()).filter(|it| !used[*it]).collect();
    let (names, lengths, known_optics, coupled) = (Vec::new(), Vec::new(), Vec::new(), vec![false; points.len()]);
    let layout = Layout {
        observations: kept,
        of_point,
        motions,
        rows,
        names,
        slots,
        lengths,
        known_optics,
        coupled,
        anchors,
        dimension,
    };
    (layout, left_out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_in_one_place_have_the_size_of_the_unit() {
        let place = Point3::new(1.0, 2.0, 3.0);
        let scale = Scale::of(&[place; 4]);
        assert_eq!((scale.centroid, scale.size), (place.coords, 1.0));
    }
}
