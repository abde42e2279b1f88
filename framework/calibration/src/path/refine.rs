//! Pose, optics and clock of one camera together, by all that it saw of the path: Levenberg–Marquardt under Cauchy's loss.
//!
//! The columns are those of [`foveate_geometry::bundle::NAMES`]: pose, optics, then the clock, as the path's time in the middle of what the
//! camera saw and what it gains until the end [s]. Observations near each other in time err together (by hand marked ones, the
//! antenna beside the marked centre, a lens that is modelled roughly), so that the covariance is that of blocks of time: with the information H and
//! the gradient gᵦ of each block b, H⁻¹ (Σ gᵦ gᵦᵀ) H⁻¹ n/(n − p) for n blocks and p parameters (White's estimator, clustered).

use foveate_estimation::Loss;
use foveate_estimation::least_squares::{Equations, Options, Problem, solve};
use foveate_estimation::statistics::{SIGMA_PER_MAD, median};
use foveate_geometry::Camera;
use foveate_geometry::bundle::{CLOCK, Freedom, NAMES, Optic, OpticsPrior, OpticsSigma, Posed, moved};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, SMatrix, SVector, Vector2};

use super::measured::{MeasuredPath, sigma_of_lengths};
use super::track::Seen;

/// Columns.
const N: usize = CLOCK + 2;
const COLUMNS: [usize; N] = {
    let mut columns = [0; N];
    let mut at = 0;
    while at < N {
        columns[at] = at;
        at += 1;
    }
    columns
};
/// Where optics are held: pose and clock.
const N_POSED: usize = 8;
const POSED: [usize; N_POSED] = [0, 1, 2, 3, 4, 5, CLOCK, CLOCK + 1];
/// Of observations that err together there are so many independent groups, at most [–].
const BLOCKS: usize = 60;
/// Groups of less time than this err together all the same [s].
const LEAST_BLOCK_S: f64 = 1.0;
/// Along the motion of the point, errors of so many limits may be the clock's [–].
const WANDERING: f64 = 5.0;
/// No observation is better [px].
const LEAST_SIGMA_PX: f64 = 0.05;
/// What is behind the camera, or where its lens has no picture, counts as this far off [σ].
const UNSEEN: f64 = 100.0;

/// A camera and its clock: path time = `path_s` + `rate` · (camera time − `middle_s`).
#[derive(Debug, Clone, PartialEq)]
pub(super) struct State {
    pub camera: Camera,
    pub middle_s: f64,
    pub path_s: f64,
    pub rate: f64,
}

impl State {
    pub fn path_time(&self, camera_s: f64) -> f64 {
        self.path_s + self.rate * (camera_s - self.middle_s)
    }

    /// The same clock with another reference time of the camera.
    pub fn told_at(&self, middle_s: f64) -> State {
        State { middle_s, path_s: self.path_time(middle_s), ..self.clone() }
    }

    /// Where the path is seen less where it was [px]; `None` behind the camera.
    pub fn residual(&self, path: &MeasuredPath, seen: &Seen) -> Option<Vector2<f64>> {
        Some(self.camera.project(&path.at(self.path_time(seen.time_s)).0)? - seen.pixel)
    }

    /// Length of each residual; infinite behind the camera [px].
    pub fn errors<'a>(&'a self, path: &'a MeasuredPath, seen: &'a [Seen]) -> impl Iterator<Item = f64> + 'a {
        seen.iter().map(|it| self.residual(path, it).map_or(f64::INFINITY, |it| it.norm()))
    }

    /// Those of `seen` that fall on the path.
    pub fn on_path(&self, path: &MeasuredPath, seen: &[Seen]) -> Vec<Seen> {
        seen.iter().copied().filter(|it| path.covers(self.path_time(it.time_s))).collect()
    }

    /// Standard deviation of a coordinate of the better half of `seen` [px].
    pub fn sigma_px(&self, path: &MeasuredPath, seen: &[Seen]) -> f64 {
        let errors: Vec<f64> = self.errors(path, seen).map(|it| it.min(1e9)).collect();
        sigma_of_lengths(&errors).max(LEAST_SIGMA_PX)
    }
}

/// What is free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Free {
    pub optics: Freedom,
    pub rate: bool,
}

/// What is known of a state.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Refined {
    pub state: State,
    /// Of all columns, 0 for what is held; `None` where something is open.
    pub covariance: Option<DMatrix<f64>>,
    /// Columns that the observations leave open.
    pub open: Vec<usize>,
}

struct Fit<'a> {
    path: &'a MeasuredPath,
    seen: &'a [Seen],
    sigma_px: f64,
    half_s: f64,
    prior: &'a OpticsPrior,
    free: Free,
}

impl Fit<'_> {
    /// Residual in σ and its derivative by all columns; `None` where it is not seen.
    fn row(&self, at: &State, posed: &Posed<'_>, seen: &Seen) -> Option<(Vector2<f64>, SMatrix<f64, 2, N>)> {
        let (point, velocity) = self.path.at(at.path_time(seen.time_s));
        let (pixel, by_camera, by_point) = posed.linearise::<CLOCK, false>(&point)?;
        let mut jacobian = SMatrix::<f64, 2, N>::zeros();
        jacobian.fixed_columns_mut::<CLOCK>(0).copy_from(&by_camera);
        let by_time = by_point * velocity;
        jacobian.set_column(CLOCK, &by_time);
        jacobian.set_column(CLOCK + 1, &(by_time * ((seen.time_s - at.middle_s) / self.half_s)));
        Some(((pixel - seen.pixel.coords) / self.sigma_px, jacobian / self.sigma_px))
    }

    /// As [`Self::row`], of pose and clock alone.
    fn posed_row(
        &self,
        at: &State,
        posed: &Posed<'_>,
        seen: &Seen,
    ) -> Option<(Vector2<f64>, SMatrix<f64, 2, N_POSED>)> {
        let (point, velocity) = self.path.at(at.path_time(seen.time_s));
        let (pixel, by_pose, by_point) = posed.linearise::<6, false>(&point)?;
        let mut jacobian = SMatrix::<f64, 2, N_POSED>::zeros();
        jacobian.fixed_columns_mut::<6>(0).copy_from(&by_pose);
        let by_time = by_point * velocity;
        jacobian.set_column(6, &by_time);
        jacobian.set_column(7, &(by_time * ((seen.time_s - at.middle_s) / self.half_s)));
        Some(((pixel - seen.pixel.coords) / self.sigma_px, jacobian / self.sigma_px))
    }

    fn held(&self) -> Vec<usize> {
        let optics = self.free.optics.mask();
        let is_free = |column: usize| match column {
            0..6 => true,
            CLOCK => true,
            _ if column > CLOCK => self.free.rate,
            _ => optics[column],
        };
        (0..N).filter(|it| !is_free(*it)).collect()
    }

    /// What is known of free optics, as residuals: column, value and derivative.
    fn known(&self, camera: &Camera) -> Vec<(usize, f64, f64)> {
        let (own, other) = (&camera.intrinsics, &self.prior.camera.intrinsics);
        let (lens, expected) = (&camera.distortion, &self.prior.camera.distortion);
        let focal = (own.focal[0] / other.focal[0]).ln();
        let sigma = &self.prior.sigma;
        let values = [
            (6, focal, sigma.focal),
            (7, lens.k1 - expected.k1, sigma.radial[0]),
            (8, lens.k2 - expected.k2, sigma.radial[1]),
            (9, own.principal[0] - other.principal[0], sigma.principal[0]),
            (10, own.principal[1] - other.principal[1], sigma.principal[1]),
            (11, (own.focal[1] / other.focal[1]).ln() - focal, sigma.aspect),
            (12, lens.p1 - expected.p1, sigma.decentering[0]),
            (13, lens.p2 - expected.p2, sigma.decentering[1]),
            (14, lens.k3 - expected.k3, sigma.radial[2]),
        ];
        let mask = self.free.optics.mask();
        let told = values.into_iter().filter(|it| mask[it.0] && it.2.is_finite() && it.2 > 0.0);
        told.map(|(column, apart, sigma)| (column, apart / sigma, 1.0 / sigma)).collect()
    }
}

impl Problem for Fit<'_> {
    type Parameters = State;

    fn dimension(&self) -> usize {
        N
    }

    fn moved(&self, from: &State, step: &DVector<f64>) -> State {
        State {
            camera: moved(&from.camera, &step.as_slice()[..CLOCK]),
            middle_s: from.middle_s,
            path_s: from.path_s + step[CLOCK],
            rate: from.rate + step[CLOCK + 1] / self.half_s,
        }
    }

    fn linearise(&self, at: &State, equations: &mut Equations) -> Option<()> {
        let posed = Posed::new(&at.camera);
        let is_posed = self.free.optics == Freedom::POSE;
        for seen in self.seen {
            if is_posed {
                match self.posed_row(at, &posed, seen) {
                    Some((residual, jacobian)) => equations.add(&POSED, &residual, &jacobian),
                    None => equations.add(&POSED, &Vector2::new(UNSEEN, 0.0), &SMatrix::<f64, 2, N_POSED>::zeros()),
                }
                continue;
            }
            match self.row(at, &posed, seen) {
                Some((residual, jacobian)) => equations.add(&COLUMNS, &residual, &jacobian),
                None => equations.add(&COLUMNS, &Vector2::new(UNSEEN, 0.0), &SMatrix::<f64, 2, N>::zeros()),
            }
        }
        for (column, value, slope) in self.known(&at.camera) {
            let mut row = [0.0; N];
            row[column] = slope;
            equations.add_row(value, &row);
        }
        Some(())
    }
}

/// The best state near `start` by `seen`, of which the path has all, each coordinate good to `sigma_px`.
pub(super) fn refine(
    start: State,
    path: &MeasuredPath,
    seen: &[Seen],
    sigma_px: f64,
    free: Free,
    prior: &OpticsPrior,
) -> Option<Refined> {
    let (first, last) = (seen.first()?, seen.last()?);
    let start = start.told_at(0.5 * (first.time_s + last.time_s));
    let half_s = (0.5 * (last.time_s - first.time_s)).max(1e-6);
    let fit = Fit { path, seen, sigma_px, half_s, prior, free };
    let options = Options { loss: Loss::CAUCHY, held: fit.held(), max_iterations: 40, relative_gain: 1e-7 };
    let solution = solve(&fit, start, &options).ok()?;
    let (covariance, open) = match &solution.covariance {
        Ok(_) => (fit.covariance(&solution.parameters), Vec::new()),
        Err(open) => (None, open.parameters.clone()),
    };
    Some(Refined { state: solution.parameters, covariance, open })
}

impl Fit<'_> {
    /// Of the clustered estimator; `None` where the information cannot be inverted.
    fn covariance(&self, at: &State) -> Option<DMatrix<f64>> {
        let held = self.held();
        let free: Vec<usize> = (0..N).filter(|it| !held.contains(it)).collect();
        let span_s = 2.0 * self.half_s;
        let blocks = ((span_s / LEAST_BLOCK_S) as usize).clamp(1, BLOCKS);
        let first_s = at.middle_s - self.half_s;
        let posed = Posed::new(&at.camera);
        let mut information = SMatrix::<f64, N, N>::zeros();
        let mut gradients = vec![SVector::<f64, N>::zeros(); blocks];
        for seen in self.seen {
            let Some((residual, jacobian)) = self.row(at, &posed, seen) else { continue };
            let (_, weight) = Loss::CAUCHY.at(residual.norm_squared());
            information += jacobian.transpose() * jacobian * weight;
            let block = (((seen.time_s - first_s) / span_s * blocks as f64) as usize).min(blocks - 1);
            gradients[block] += jacobian.transpose() * residual * weight;
        }
        for (column, _, slope) in self.known(&at.camera) {
            information[(column, column)] += slope * slope;
        }
        let meat = gradients.iter().fold(SMatrix::<f64, N, N>::zeros(), |sum, it| sum + it * it.transpose());
        let reduced = DMatrix::from_fn(free.len(), free.len(), |row, column| information[(free[row], free[column])]);
        // Scaled to a diagonal of 1, since columns have units of their own.
        let scale: Vec<f64> =
            (0..free.len()).map(|it| reduced[(it, it)].max(f64::MIN_POSITIVE).sqrt().recip()).collect();
        let scaled =
            DMatrix::from_fn(free.len(), free.len(), |row, column| reduced[(row, column)] * scale[row] * scale[column]);
        let inverse = scaled.cholesky()?.inverse();
        let inverse =
            DMatrix::from_fn(free.len(), free.len(), |row, column| inverse[(row, column)] * scale[row] * scale[column]);
        let covariance = if blocks > 2 * free.len() {
            let meat = DMatrix::from_fn(free.len(), free.len(), |row, column| meat[(free[row], free[column])]);
            let surplus = blocks as f64 / (blocks - free.len()) as f64;
            // What is known beforehand of optics is no block; without this half of it they would pass for better known than that.
            &inverse * meat * &inverse * surplus + self.of_prior(at, &free, &inverse)
        } else {
            // Too few groups to tell how they differ: as if each of them had one observation.
            let n = self.seen.len() as f64 / (blocks.max(1) as f64);
            inverse * n.max(1.0)
        };
        let mut whole = DMatrix::zeros(N, N);
        for (row, &to_row) in free.iter().enumerate() {
            for (column, &to_column) in free.iter().enumerate() {
                whole[(to_row, to_column)] = covariance[(row, column)];
            }
        }
        Some(whole)
    }

    /// What the errors of the known optics add: H⁻¹ P H⁻¹, P their information.
    fn of_prior(&self, at: &State, free: &[usize], inverse: &DMatrix<f64>) -> DMatrix<f64> {
        let mut known = DMatrix::zeros(free.len(), free.len());
        for (column, _, slope) in self.known(&at.camera) {
            if let Some(place) = free.iter().position(|it| *it == column) {
                known[(place, place)] = slope * slope;
            }
        }
        inverse * known * inverse
    }
}

/// Standard deviations and covariances of a refined camera.
pub(super) struct Quality {
    pub pose: Matrix6<f64>,
    /// Of the centre in the world [m²].
    pub centre: Matrix3<f64>,
    pub optics: OpticsSigma,
    /// Of the path's time in the middle [s].
    pub clock_s: f64,
    /// Of the rate [–].
    pub rate: f64,
}

impl Refined {
    /// How well it is known; `None` where something is open.
    pub fn quality(&self, half_s: f64) -> Option<Quality> {
        let covariance = self.covariance.as_ref()?;
        let pose: Matrix6<f64> = covariance.fixed_view::<6, 6>(0, 0).into_owned();
        let centre = self.state.camera.centre().coords;
        // T exp(δ) has its centre c at c − ω × c − v.
        let mut by_pose = nalgebra::Matrix3x6::zeros();
        by_pose.fixed_columns_mut::<3>(0).copy_from(&centre.cross_matrix());
        by_pose.fixed_columns_mut::<3>(3).copy_from(&-Matrix3::identity());
        let sigma = |column: usize| covariance[(column, column)].max(0.0).sqrt();
        Some(Quality {
            centre: by_pose * pose * by_pose.transpose(),
            pose,
            optics: OpticsSigma::of(sigma),
            clock_s: sigma(CLOCK),
            rate: sigma(CLOCK + 1) / half_s,
        })
    }

    /// Optics that the observations leave open.
    pub fn open_optics(&self) -> Vec<Optic> {
        self.open.iter().filter_map(|it| Optic::named(NAMES[*it])).collect()
    }
}

/// By how much the clock is off in parts of the recording, at most, with its standard deviation: a camera whose rate varies [s]. Errors along the
/// motion of the point in the picture are the clock's; those across it tell the noise.
pub(super) fn wander(
    state: &State,
    path: &MeasuredPath,
    seen: &[Seen],
    limit_px: f64,
    parts: usize,
) -> Option<[f64; 2]> {
    let (first, last) = (seen.first()?, seen.last()?);
    let span_s = (last.time_s - first.time_s).max(1e-9);
    let posed = Posed::new(&state.camera);
    let mut sums = vec![(0.0, 0.0, Vec::new()); parts.max(1)];
    for it in seen {
        let (point, velocity) = path.at(state.path_time(it.time_s));
        let Some((pixel, _, by_point)) = posed.linearise::<CLOCK, false>(&point) else { continue };
        let (error, motion) = (it.pixel.coords - pixel, by_point * velocity);
        let across = error.perp(&motion) / motion.norm().max(1e-9);
        if across.abs() > limit_px || error.norm() > WANDERING * limit_px {
            continue;
        }
        let part = (((it.time_s - first.time_s) / span_s * parts as f64) as usize).min(parts - 1);
        sums[part].0 += motion.dot(&error);
        sums[part].1 += motion.norm_squared();
        sums[part].2.push(across.abs());
    }
    let shifts = sums.iter().filter(|it| it.2.len() >= 20 && it.1 > 0.0).map(|(product, squares, across)| {
        // Errors of neighbours are alike: as if one in ten were independent.
        [product / squares, SIGMA_PER_MAD * median(across).unwrap_or(0.0) / (squares / 10.0).sqrt()]
    });
    shifts.max_by(|a, b| a[0].abs().total_cmp(&b[0].abs()))
}
