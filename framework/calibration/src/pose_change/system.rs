//! Cameras and points adjusted together, one of the cameras with a second pose from a moment on and with the same optics before and after.
//!
//! Points are eliminated point by point (Schur complement), and the sums over points are kept by stretches of time: the sum over those after a moment
//! says what a second pose from then on would gain, for every camera and moment at once (the score test; D. Andrews, "Tests for parameter
//! instability and structural change with unknown change point", 1993).

use foveate_estimation::Loss;
use foveate_estimation::least_squares::schur::BlockSum;
use foveate_estimation::least_squares::{Damping, DriverOptions, GroupedEquations, GroupedProblem, solve_grouped};
use foveate_geometry::Camera;
use foveate_geometry::bundle::{CLOCK, Freedom, OpticsPrior, Posed, moved};
use nalgebra::{DMatrix, DVector, Isometry3, Point2, Point3, Translation3, Vector3};

/// Columns of a pose.
pub(super) const POSE: usize = 6;
/// Cost of an observation of a point that its camera cannot see [σ²].
const UNSEEN: f64 = 900.0;
const LOSS: Loss = Loss::CAUCHY;
/// Done when a step is to gain less than 1e-4 of the cost: what is compared differs by parts of it.
const OPTIONS: DriverOptions = DriverOptions {
    damping: Damping { initial: 1e-4, least: 1e-8, fastest_decrease: 0.1 },
    max_iterations: 20,
    relative_gain: 1e-4,
    absolute_gain: 0.0,
};

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
        let second = self.second_camera().filter(|_| self.is_second(slot, time_s));
        second.unwrap_or_else(|| self.cameras[slot].clone())
    }

    fn is_second(&self, slot: usize, time_s: f64) -> bool {
        self.second.as_ref().is_some_and(|it| it.slot == slot && time_s >= it.at_s)
    }

    /// The camera with a second pose, there.
    fn second_camera(&self) -> Option<Camera> {
        let second = self.second.as_ref()?;
        Some(Camera { camera_from_world: second.camera_from_world, ..self.cameras[second.slot].clone() })
    }
}

/// The normal equations of the cameras.
#[derive(Clone)]
pub(super) struct Reduced {
    pub information: DMatrix<f64>,
    /// Its negative leads downhill.
    pub slope: DVector<f64>,
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

    /// By bin of tracks, in ascending order: the normal equations, of the priors not.
    pub(super) fn by_bin(&self, state: &State, sigma_px: f64, bins: &[usize]) -> Vec<Reduced> {
        let second = state.second_camera();
        let views = Views::of(state, second.as_ref());
        let mut sums = Vec::new();
        for tracks in (0..bins.len()).collect::<Vec<usize>>().chunk_by(|a, b| bins[*a] == bins[*b]) {
            let mut equations = GroupedEquations::new(LOSS, self.n, tracks.len());
            for (group, track) in tracks.iter().enumerate() {
                self.add_track(&mut equations, state, &views, sigma_px, *track, group);
            }
            let (information, slope) = equations.eliminated();
            sums.push(Reduced { information, slope });
        }
        sums
    }

    /// Where the columns of a camera stand among the unknowns.
    fn rows(&self, slot: usize, is_second: bool) -> [Option<usize>; CLOCK] {
        let mut rows = [None; CLOCK];
        for (place, column) in self.columns[slot].iter().enumerate() {
            let first = if is_second && place < POSE { self.n } else { self.first[slot] };
            rows[*column] = Some(first + place);
        }
        rows
    }

    /// Adds what was seen of a track, as a group.
    fn add_track(
        &self,
        equations: &mut GroupedEquations<3>,
        state: &State,
        views: &Views<'_>,
        sigma_px: f64,
        track: usize,
        group: usize,
    ) {
        let (Track { time_s, seen }, point) = (&self.tracks[track], &state.points[track]);
        let visible = |it: &Seen| {
            let is_second = state.is_second(it.slot, *time_s);
            let linear = views.of_slot(it.slot, is_second).linearise::<CLOCK, false>(point)?;
            Some((linear, is_second))
        };
        let linear: Vec<_> = seen.iter().map(visible).collect();
        let is_fixed = linear.iter().flatten().count() >= 2;
        for (seen, linear) in seen.iter().zip(&linear) {
            let Some(((pixel, by_camera, by_point), is_second)) = linear else {
                equations.add_cost(LOSS.at(UNSEEN).0);
                continue;
            };
            let off = pixel - seen.pixel.coords;
            if is_fixed {
                let mut sum = BlockSum::zeros();
                sum.add(&LOSS, &off, (by_camera, by_point), sigma_px.powi(-2));
                equations.add_sum(&self.rows(seen.slot, *is_second), group, &sum);
            } else {
                equations.add_cost(LOSS.at(off.norm_squared() / sigma_px.powi(2)).0);
            }
        }
    }

    /// Adjusts all of it, with pixels of that standard deviation.
    pub(super) fn adjust(&self, state: State, sigma_px: f64) -> State {
        let sought = Sought { system: self, sigma_px, has_second: state.second.is_some() };
        match solve_grouped(&sought, state.clone(), LOSS, &OPTIONS) {
            Ok(found) => State { cost: 2.0 * found.outcome.cost, ..found.parameters },
            Err(_) => State { cost: f64::INFINITY, ..state },
        }
    }
}

/// Cameras of a state, ready for many points.
struct Views<'a> {
    first: Vec<Posed<'a>>,
    second: Option<Posed<'a>>,
}

impl<'a> Views<'a> {
    /// `second`: as [`State::second_camera`] has it.
    fn of(state: &'a State, second: Option<&'a Camera>) -> Views<'a> {
        Views { first: state.cameras.iter().map(Posed::new).collect(), second: second.map(Posed::new) }
    }

    fn of_slot(&self, slot: usize, is_second: bool) -> &Posed<'a> {
        self.second.as_ref().filter(|_| is_second).unwrap_or(&self.first[slot])
    }
}

/// What is to be minimised.
struct Sought<'a> {
    system: &'a System,
    sigma_px: f64,
    has_second: bool,
}

impl GroupedProblem<3> for Sought<'_> {
    type Parameters = State;

    fn dimension(&self) -> usize {
        self.system.n + if self.has_second { POSE } else { 0 }
    }

    fn n_groups(&self) -> usize {
        self.system.tracks.len()
    }

    fn moved(&self, from: &State, shared: &DVector<f64>, groups: &[Vector3<f64>]) -> State {
        let step = |slot: usize, is_second: bool| {
            self.system.rows(slot, is_second).map(|row| row.map_or(0.0, |it| shared[it]))
        };
        let cameras = from.cameras.iter().enumerate().map(|(slot, it)| moved(it, &step(slot, false)));
        let second = from.second.as_ref().map(|it| {
            let camera = Camera { camera_from_world: it.camera_from_world, ..from.cameras[it.slot].clone() };
            Second { camera_from_world: moved(&camera, &step(it.slot, true)).camera_from_world, ..it.clone() }
        });
        let points = from.points.iter().zip(groups).map(|(it, step)| it + step);
        State { cameras: cameras.collect(), points: points.collect(), second, cost: from.cost }
    }

    fn linearise(&self, at: &State, equations: &mut GroupedEquations<3>) -> Option<()> {
        let second = at.second_camera();
        let views = Views::of(at, second.as_ref());
        for track in 0..self.system.tracks.len() {
            self.system.add_track(equations, at, &views, self.sigma_px, track, track);
        }
        for (slot, columns) in self.system.columns.iter().enumerate() {
            let (apart, sigmas) = apart(&self.system.priors[slot], &at.cameras[slot]);
            for (place, column) in columns.iter().enumerate().skip(POSE) {
                let per_sigma = 1.0 / sigmas[*column - POSE];
                let row = self.system.first[slot] + place;
                equations.add_known(row, apart[*column - POSE] * per_sigma, per_sigma);
            }
        }
        Some(())
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
