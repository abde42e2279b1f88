//! Cameras and points adjusted together, one of the cameras with a second pose from a moment on and with the same optics before and after.
//!
//! Points are eliminated point by point (Schur complement), and the sums over points are kept by stretches of time: the sum over those after a moment
//! says what a second pose from then on would gain, for every camera and moment at once (the score test; D. Andrews, "Tests for parameter
//! instability and structural change with unknown change point", 1993).

use foveate_estimation::Loss;
use foveate_geometry::Camera;
use foveate_geometry::bundle::{Freedom, OpticsPrior, moved};
use nalgebra::{DMatrix, DVector, Isometry3, Matrix2x3, Matrix3, Point2, Point3, Translation3, Vector2, Vector3};

/// Columns of a pose.
pub(super) const POSE: usize = 6;
/// Steps by which optics are differentiated, by column from the focal length on.
const STEPS: [f64; 9] = [1e-5, 1e-5, 1e-5, 1e-2, 1e-2, 1e-5, 1e-6, 1e-6, 1e-5];
/// Cost of an observation of a point that its camera cannot see [σ²].
const UNSEEN: f64 = 900.0;
const LOSS: Loss = Loss::CAUCHY;
/// Steps at most [–].
const STEPS_AT_MOST: usize = 12;
/// Done when a step gains less than this part of the cost [–].
const LEAST_GAIN: f64 = 1e-4;

/// What one camera saw of a point.
#[derive(Debug, Clone, Copy)]
pub(super) struct Seen {
    pub slot: usize,
    pub pixel: Point2<f64>,
}

/// What was seen of a point.
#[derive(Debug, Clone)]
pub(super) struct Track {
    pub time_s: f64,
    pub seen: Vec<Seen>,
}

/// What does not change while it is adjusted.
#[derive(Debug)]
pub(super) struct System {
    pub tracks: Vec<Track>,
    /// By slot: columns of [`foveate_geometry::bundle::NAMES`] that are free.
    columns: Vec<Vec<usize>>,
    /// By slot: its first unknown.
    first: Vec<usize>,
    priors: Vec<OpticsPrior>,
    n: usize,
}

/// Cameras and points.
#[derive(Debug, Clone)]
pub(super) struct State {
    pub cameras: Vec<Camera>,
    pub points: Vec<Point3<f64>>,
    pub second: Option<Second>,
    /// Σ ρ [–].
    pub cost: f64,
}

/// The second pose of a camera.
#[derive(Debug, Clone)]
pub(super) struct Second {
    pub slot: usize,
    /// From then on.
    pub at_s: f64,
    pub camera_from_world: Isometry3<f64>,
}

impl State {
    /// The camera in `slot` at a time.
    pub(super) fn camera(&self, slot: usize, time_s: f64) -> Camera {
        let camera = self.cameras[slot].clone();
        match &self.second {
            Some(it) if it.slot == slot && time_s >= it.at_s => {
                Camera { camera_from_world: it.camera_from_world, ..camera }
            }
            _ => camera,
        }
    }
}

/// The normal equations of the cameras.
#[derive(Clone)]
pub(super) struct Reduced {
    pub information: DMatrix<f64>,
    /// Its negative leads downhill.
    pub slope: DVector<f64>,
}

/// What brings a point along with the cameras: V⁻¹, V⁻¹ b, and W by unknown.
struct Follows {
    point: usize,
    inverse: Matrix3<f64>,
    slope: Vector3<f64>,
    between: Vec<(usize, Vector3<f64>)>,
}

/// An observation, linearised.
struct Row {
    /// By unknown.
    by_camera: Vec<(usize, Vector2<f64>)>,
    by_point: Matrix2x3<f64>,
    off: Vector2<f64>,
    weight: f64,
}

impl System {
    pub(super) fn new(tracks: Vec<Track>, freed: &[Freedom], priors: Vec<OpticsPrior>) -> System {
        let columns: Vec<Vec<usize>> = freed
            .iter()
            .map(|it| {
                let mask = Freedom { pose: true, ..*it }.mask();
                (0..mask.len()).filter(|column| mask[*column]).collect()
            })
            .collect();
        let first = columns.iter().scan(0, |sum, it| Some(std::mem::replace(sum, *sum + it.len()))).collect();
        let n = columns.iter().map(Vec::len).sum();
        System { tracks, columns, first, priors, n }
    }

    /// By slot: what is known of the optics.
    pub(super) fn priors(&self) -> &[OpticsPrior] {
        &self.priors
    }

    /// The first unknown of a camera's pose.
    pub(super) fn first(&self, slot: usize) -> usize {
        self.first[slot]
    }

    /// By bin of tracks: the normal equations, of the priors not; and the cost in all.
    pub(super) fn by_bin(&self, state: &State, sigma_px: f64, bins: &[usize]) -> Vec<Reduced> {
        let n_bins = bins.iter().max().map_or(0, |it| it + 1);
        let empty = Reduced { information: DMatrix::zeros(self.n, self.n), slope: DVector::zeros(self.n) };
        let mut sums = vec![empty; n_bins];
        for (index, bin) in bins.iter().enumerate() {
            self.track(state, sigma_px, index, &mut sums[*bin]);
        }
        sums
    }

    fn n_unknowns(&self, state: &State) -> usize {
        self.n + if state.second.is_some() { POSE } else { 0 }
    }

    /// Adds what a track tells of the cameras.
    fn track(&self, state: &State, sigma_px: f64, index: usize, sum: &mut Reduced) -> Option<Follows> {
        let (track, point) = (&self.tracks[index], &state.points[index]);
        let mut v = Matrix3::identity() * 1e-12;
        let mut b = Vector3::zeros();
        let mut rows: Vec<Row> = Vec::new();
        for seen in &track.seen {
            let camera = state.camera(seen.slot, track.time_s);
            let Some((pixel, by_point)) = camera.project_with_jacobian(point) else { continue };
            let off = (pixel - seen.pixel) / sigma_px;
            let weight = LOSS.at(off.norm_squared()).1;
            let by_point = by_point / sigma_px;
            let by_camera = self.by_camera(state, seen.slot, track.time_s, &camera, point, &pixel, &by_point, sigma_px);
            v += weight * by_point.transpose() * by_point;
            b += weight * by_point.transpose() * off;
            rows.push(Row { by_camera, by_point, off, weight });
        }
        if rows.len() < 2 {
            return None;
        }
        let inverse = v.try_inverse()?;
        let mut between: Vec<(usize, Vector3<f64>)> = Vec::new();
        for Row { by_camera, by_point, off, weight } in &rows {
            for (unknown, column) in by_camera {
                between.push((*unknown, *weight * by_point.transpose() * column));
                sum.slope[*unknown] += weight * column.dot(off);
                for (other, second) in by_camera {
                    sum.information[(*unknown, *other)] += weight * column.dot(second);
                }
            }
        }
        let slope = inverse * b;
        for (unknown, w) in &between {
            sum.slope[*unknown] -= w.dot(&slope);
            let follows = inverse * w;
            for (other, second) in &between {
                sum.information[(*other, *unknown)] -= follows.dot(second);
            }
        }
        Some(Follows { point: index, inverse, slope, between })
    }

    /// By unknown: how the pixel moves [σ].
    #[allow(clippy::too_many_arguments)]
    fn by_camera(
        &self,
        state: &State,
        slot: usize,
        time_s: f64,
        camera: &Camera,
        point: &Point3<f64>,
        pixel: &Point2<f64>,
        by_point: &Matrix2x3<f64>,
        sigma_px: f64,
    ) -> Vec<(usize, Vector2<f64>)> {
        let is_second = state.second.as_ref().is_some_and(|it| it.slot == slot && time_s >= it.at_s);
        let pose = if is_second { self.n } else { self.first[slot] };
        // T exp(δ) p = T (p + ω × p + v)
        let turned = by_point * -point.coords.cross_matrix();
        let mut list: Vec<(usize, Vector2<f64>)> =
            (0..3).map(|it| (pose + it, turned.column(it).into_owned())).collect();
        list.extend((0..3).map(|it| (pose + 3 + it, by_point.column(it).into_owned())));
        for (place, column) in self.columns[slot].iter().enumerate().skip(POSE) {
            let mut step = [0.0; 15];
            step[*column] = STEPS[*column - POSE];
            let there = moved(camera, &step).project(point);
            let by = there.map_or(Vector2::zeros(), |it| (it - pixel) / (step[*column] * sigma_px));
            list.push((self.first[slot] + place, by));
        }
        list
    }

    /// Adds what is known of the optics.
    fn add_priors(&self, state: &State, sum: &mut Reduced) {
        for (slot, columns) in self.columns.iter().enumerate() {
            let (apart, sigmas) = apart(&self.priors[slot], &state.cameras[slot]);
            for (place, column) in columns.iter().enumerate().skip(POSE) {
                let weight = sigmas[*column - POSE].powi(-2);
                let unknown = self.first[slot] + place;
                sum.information[(unknown, unknown)] += weight;
                sum.slope[unknown] += weight * apart[*column - POSE];
            }
        }
    }

    pub(super) fn cost(&self, state: &State, sigma_px: f64) -> f64 {
        let mut cost = 0.0;
        for (track, point) in self.tracks.iter().zip(&state.points) {
            for seen in &track.seen {
                let off = state.camera(seen.slot, track.time_s).project(point).map(|it| it - seen.pixel);
                cost += LOSS.at(off.map_or(UNSEEN, |it| it.norm_squared() / sigma_px.powi(2))).0;
            }
        }
        for (slot, columns) in self.columns.iter().enumerate() {
            let (apart, sigmas) = apart(&self.priors[slot], &state.cameras[slot]);
            cost += columns.iter().skip(POSE).map(|it| (apart[it - POSE] / sigmas[it - POSE]).powi(2)).sum::<f64>();
        }
        cost
    }

    /// Adjusts all of it (Levenberg, Marquardt), with pixels of that standard deviation.
    pub(super) fn adjust(&self, mut state: State, sigma_px: f64) -> State {
        let n = self.n_unknowns(&state);
        state.cost = self.cost(&state, sigma_px);
        let mut damping = 1e-4;
        for _ in 0..STEPS_AT_MOST {
            let mut sum = Reduced { information: DMatrix::zeros(n, n), slope: DVector::zeros(n) };
            let followers: Vec<Follows> =
                (0..self.tracks.len()).filter_map(|it| self.track(&state, sigma_px, it, &mut sum)).collect();
            self.add_priors(&state, &mut sum);
            let before = state.cost;
            while damping < 1e6 {
                let mut damped = sum.information.clone();
                (0..n).for_each(|it| damped[(it, it)] += damping * damped[(it, it)].max(1e-12));
                let step = damped.cholesky().map(|it| it.solve(&-&sum.slope));
                let next = step.map(|it| self.moved(&state, &it, &followers, sigma_px));
                if let Some(next) = next.filter(|it| it.cost < state.cost) {
                    state = next;
                    damping = (0.1 * damping).max(1e-8);
                    break;
                }
                damping *= 10.0;
            }
            if before - state.cost < LEAST_GAIN * before {
                break;
            }
        }
        state
    }

    fn moved(&self, from: &State, step: &DVector<f64>, followers: &[Follows], sigma_px: f64) -> State {
        let mut state = from.clone();
        for (slot, columns) in self.columns.iter().enumerate() {
            let mut own = [0.0; 15];
            columns.iter().enumerate().for_each(|(place, column)| own[*column] = step[self.first[slot] + place]);
            state.cameras[slot] = moved(&from.cameras[slot], &own);
        }
        if let Some(second) = &mut state.second {
            let own: Vec<f64> = (0..POSE).map(|it| step[self.n + it]).collect();
            let camera = Camera { camera_from_world: second.camera_from_world, ..from.cameras[second.slot].clone() };
            second.camera_from_world = moved(&camera, &own).camera_from_world;
        }
        for it in followers {
            let along = it.between.iter().fold(Vector3::zeros(), |sum, (unknown, w)| sum + w * step[*unknown]);
            state.points[it.point] -= it.slope + it.inverse * along;
        }
        state.cost = self.cost(&state, sigma_px);
        state
    }
}

/// Of each optic, by column from the focal length on: how far it is from what is known of it, and to within how much that is.
fn apart(prior: &OpticsPrior, camera: &Camera) -> ([f64; 9], [f64; 9]) {
    let (here, there) = (&camera.intrinsics, &prior.camera.intrinsics);
    let (own, other) = (&camera.distortion, &prior.camera.distortion);
    let focal = (here.focal[0] / there.focal[0]).ln();
    let aspect = (here.focal[1] / there.focal[1]).ln() - focal;
    let [cx, cy] = [0, 1].map(|it| here.principal[it] - there.principal[it]);
    let by = [
        focal,
        own.k1 - other.k1,
        own.k2 - other.k2,
        cx,
        cy,
        aspect,
        own.p1 - other.p1,
        own.p2 - other.p2,
        own.k3 - other.k3,
    ];
    let it = &prior.sigma;
    let [k1, k2, k3] = it.radial;
    (by, [it.focal, k1, k2, it.principal[0], it.principal[1], it.aspect, it.decentering[0], it.decentering[1], k3])
}

/// `camera` in a world whose origin is at `middle`.
pub(super) fn centred(camera: &Camera, middle: &Vector3<f64>) -> Camera {
    Camera { camera_from_world: camera.camera_from_world * Translation3::from(*middle), ..camera.clone() }
}
