//! One camera fitted to points of known place: its pose alone, or with what may be wrong about it.

use foveate_estimation::Loss;
use foveate_estimation::least_squares::{Equations, Options, Problem, solve};
use foveate_estimation::statistics::{median, percentile};
use foveate_geometry::{Camera, ResectionOptions, resect};
use nalgebra::{
    DVector, Isometry3, Matrix2, Matrix3, Point2, Point3, SMatrix, Translation3, UnitQuaternion, Vector2, Vector3,
};

/// Columns of the step: rotation, translation, then these.
const FOCAL: usize = 6;
const K1: usize = 7;
const DELAY: usize = 8;
const ASPECT: usize = 9;
const K2: usize = 10;
const PRINCIPAL: usize = 11;
const WIDTH: usize = 13;
const LOSS: Loss = Loss::CAUCHY;
/// A residual of a point that the camera cannot see [σ].
const UNSEEN: f64 = 30.0;

/// What is fitted beside the pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Extra {
    Focal,
    /// Height over width of the focal length.
    Aspect,
    Principal,
    /// The first term of radial distortion.
    Distortion,
    /// The second term.
    Distortion2,
    Delay,
}

impl Extra {
    fn columns(self) -> std::ops::Range<usize> {
        let first = match self {
            Extra::Focal => FOCAL,
            Extra::Aspect => ASPECT,
            Extra::Principal => return PRINCIPAL..PRINCIPAL + 2,
            Extra::Distortion => K1,
            Extra::Distortion2 => K2,
            Extra::Delay => DELAY,
        };
        first..first + 1
    }
}

/// A camera, and by how much its clock is behind: it sees the light where that is `delay_s` later than it says.
#[derive(Debug, Clone)]
pub(crate) struct Fitted {
    pub camera: Camera,
    pub delay_s: f64,
    /// Standard deviation of the delay, where that was fitted.
    pub delay_sigma_s: f64,
    /// Σ ρ.
    pub cost: f64,
}

/// An observation beside where the other cameras have the point.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Witnessed {
    pub time_s: f64,
    pub pixel: Point2<f64>,
    /// By the others.
    pub point: Point3<f64>,
    /// Covariance of that place.
    pub covariance: Matrix3<f64>,
    pub velocity: Option<Vector3<f64>>,
}

impl Witnessed {
    /// Covariance of the pixel's distance from where `camera` should see the point, that of the pixel included [px²].
    pub(crate) fn spread(&self, camera: &Camera, sigma_px: f64) -> Option<Matrix2<f64>> {
        let (_, by_point) = camera.project_with_jacobian(&self.point)?;
        Some(by_point * self.covariance * by_point.transpose() + Matrix2::identity() * sigma_px * sigma_px)
    }
}

/// Observations beside points, with the standard deviation of their distance.
#[derive(Debug, Clone)]
pub(crate) struct Samples {
    of: Vec<Sample>,
    centroid: Vector3<f64>,
    sigma_px: f64,
}

#[derive(Debug, Clone, Copy)]
struct Sample {
    /// From the centroid of all.
    point: Point3<f64>,
    pixel: Point2<f64>,
    velocity: Vector3<f64>,
    has_velocity: bool,
    /// Of either coordinate [px].
    sigma: f64,
}

impl Samples {
    /// `camera` is to be about right: it says how the uncertainty of a point looks in the picture.
    pub(crate) fn new(witnessed: &[Witnessed], camera: &Camera, sigma_px: f64) -> Self {
        let n = witnessed.len().max(1) as f64;
        let centroid = witnessed.iter().fold(Vector3::zeros(), |sum, it| sum + it.point.coords) / n;
        let sample = |it: &Witnessed| Sample {
            point: it.point - centroid,
            pixel: it.pixel,
            velocity: it.velocity.unwrap_or_else(Vector3::zeros),
            has_velocity: it.velocity.is_some(),
            sigma: it.spread(camera, sigma_px).map_or(sigma_px, |it| (0.5 * it.trace()).sqrt()),
        };
        Self { of: witnessed.iter().map(sample).collect(), centroid, sigma_px }
    }

    pub(crate) fn len(&self) -> usize {
        self.of.len()
    }

    /// Share of the samples whose velocity is known [–].
    pub(crate) fn moving_share(&self) -> f64 {
        self.of.iter().filter(|it| it.has_velocity).count() as f64 / self.len().max(1) as f64
    }

    /// As if all were known so many times less well, for a start that is far off.
    pub(crate) fn blurred(&self, times: f64) -> Samples {
        let mut samples = self.clone();
        samples.of.iter_mut().for_each(|it| it.sigma *= times);
        samples
    }

    /// By sample: whether it is far from where `camera` sees the point, by both its standard deviation and pixels.
    pub(crate) fn far(&self, camera: &Camera, sigmas: f64, least_px: f64) -> Vec<bool> {
        let camera = self.centred(camera);
        let is_far = |it: &Sample| {
            let off = camera.project(&it.point).map_or(f64::INFINITY, |seen| (seen - it.pixel).norm());
            off > least_px && off > sigmas * it.sigma
        };
        self.of.iter().map(is_far).collect()
    }

    /// Median distance of where `camera` sees the points from where they were seen [px].
    pub(crate) fn median_px(&self, camera: &Camera) -> f64 {
        let camera = self.centred(camera);
        let off = self.of.iter().map(|it| camera.project(&it.point).map_or(1e3, |seen| (seen - it.pixel).norm()));
        median(&off.collect::<Vec<_>>()).unwrap_or(0.0)
    }

    /// Distance in the picture of what one fit sees from what the other one sees, which a quarter of the samples exceed [px].
    pub(crate) fn apart_px(&self, one: &Fitted, other: &Fitted) -> f64 {
        let cameras = [self.centred(&one.camera), self.centred(&other.camera)];
        let apart = self.of.iter().filter_map(|it| {
            let at = |delay_s: f64| it.point + it.velocity * delay_s;
            Some((cameras[0].project(&at(one.delay_s))? - cameras[1].project(&at(other.delay_s))?).norm())
        });
        percentile(&apart.collect::<Vec<_>>(), 75.0).unwrap_or(0.0)
    }

    /// By sample: whether `camera` sees the point within `limit_px` of the pixel, or within what is known of the point, up to four times that.
    pub(crate) fn near(&self, camera: &Camera, limit_px: f64) -> Vec<bool> {
        let camera = self.centred(camera);
        let is_near = |it: &Sample| {
            let limit = limit_px.max(4.0 * it.sigma).min(4.0 * limit_px);
            camera.project(&it.point).is_some_and(|seen| (seen - it.pixel).norm() <= limit)
        };
        self.of.iter().map(is_near).collect()
    }

    /// As a picture `width` wide shows them in a mirror [px].
    pub(crate) fn mirrored(&self, width: u32) -> Samples {
        let mut samples = self.clone();
        samples.of.iter_mut().for_each(|it| it.pixel.x = f64::from(width) - 1.0 - it.pixel.x);
        samples
    }

    /// By sample: squared distance in standard deviations under `camera` as it stands.
    pub(crate) fn squares(&self, camera: &Camera) -> Vec<f64> {
        let camera = self.centred(camera);
        let square = |it: &Sample| {
            let off = camera.project(&it.point).map(|seen| (seen - it.pixel).norm_squared() / it.sigma.powi(2));
            off.unwrap_or(UNSEEN * UNSEEN)
        };
        self.of.iter().map(square).collect()
    }

    /// By sample, in the order of time: its cost under `fitted`.
    pub(crate) fn costs(&self, fitted: &Fitted) -> Vec<f64> {
        let camera = self.centred(&fitted.camera);
        let cost = |it: &Sample| {
            let seen = camera.project(&(it.point + it.velocity * fitted.delay_s));
            let square = seen.map(|seen| (seen - it.pixel).norm_squared() / it.sigma.powi(2));
            LOSS.at(square.unwrap_or(UNSEEN * UNSEEN)).0
        };
        self.of.iter().map(cost).collect()
    }

    /// Fits the pose and `extras` from `camera` on.
    pub(crate) fn fit(&self, camera: &Camera, extras: &[Extra]) -> Option<Fitted> {
        let held = (FOCAL..WIDTH).filter(|it| !extras.iter().any(|extra| extra.columns().contains(it))).collect();
        let options = Options { loss: LOSS, held, max_iterations: 50, relative_gain: 1e-6 };
        let start = Unknowns { camera: self.centred(camera), delay_s: 0.0 };
        let solution = solve(self, start, &options).ok()?;
        let delay_sigma_s = solution.covariance.as_ref().map_or(f64::INFINITY, |it| it[(DELAY, DELAY)].max(0.0).sqrt());
        let Unknowns { mut camera, delay_s } = solution.parameters;
        camera.camera_from_world *= Translation3::from(-self.centroid);
        let cost = 2.0 * solution.costs.last()?;
        Some(Fitted { camera, delay_s, delay_sigma_s, cost })
    }

    /// The pose by search, whatever that of `camera` is; then as [`Self::fit`] with nothing else.
    pub(crate) fn search(&self, camera: &Camera, seed: u64) -> Option<Fitted> {
        let points: Vec<Point3<f64>> = self.of.iter().map(|it| it.point).collect();
        let pixels: Vec<Point2<f64>> = self.of.iter().map(|it| it.pixel).collect();
        let mut random = foveate_estimation::Random::new(seed).fork("resection");
        let options = ResectionOptions { sigma_px: self.sigma_px, inlier_px: 6.0 * self.sigma_px, trials: 300 };
        let found = resect(camera, &points, &pixels, &options, |n| random.below(n)).ok()?;
        let camera_from_world = found.camera_from_world * Translation3::from(-self.centroid);
        self.fit(&Camera { camera_from_world, ..camera.clone() }, &[])
    }

    fn centred(&self, camera: &Camera) -> Camera {
        let camera_from_world = camera.camera_from_world * Translation3::from(self.centroid);
        Camera { camera_from_world, ..camera.clone() }
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Unknowns {
    camera: Camera,
    delay_s: f64,
}

impl Problem for Samples {
    type Parameters = Unknowns;

    fn dimension(&self) -> usize {
        WIDTH
    }

    fn moved(&self, from: &Unknowns, step: &DVector<f64>) -> Unknowns {
        let mut moved = from.clone();
        let turn = UnitQuaternion::from_scaled_axis(Vector3::new(step[0], step[1], step[2]));
        moved.camera.camera_from_world *= Isometry3::from_parts(Translation3::new(step[3], step[4], step[5]), turn);
        moved.camera.camera_from_world.rotation.renormalize_fast();
        let factor = step[FOCAL].exp();
        moved.camera.intrinsics.focal = moved.camera.intrinsics.focal.map(|it| it * factor);
        moved.camera.intrinsics.focal[1] *= step[ASPECT].exp();
        moved.camera.intrinsics.principal[0] += step[PRINCIPAL];
        moved.camera.intrinsics.principal[1] += step[PRINCIPAL + 1];
        moved.camera.distortion.k1 += step[K1];
        moved.camera.distortion.k2 += step[K2];
        moved.delay_s += step[DELAY];
        moved
    }

    fn linearise(&self, at: &Unknowns, equations: &mut Equations) -> Option<()> {
        let Unknowns { camera, delay_s } = at;
        let columns = std::array::from_fn(|it| it);
        for sample in &self.of {
            let point = sample.point + sample.velocity * *delay_s;
            let Some((seen, by_point)) = camera.project_with_jacobian(&point) else {
                equations.add(&columns, &Vector2::new(UNSEEN, 0.0), &SMatrix::<f64, 2, WIDTH>::zeros());
                continue;
            };
            let mut jacobian = SMatrix::<f64, 2, WIDTH>::zeros();
            // T exp(δ) p = T (p + ω × p + v)
            jacobian.fixed_columns_mut::<3>(0).copy_from(&(by_point * -point.coords.cross_matrix()));
            jacobian.fixed_columns_mut::<3>(3).copy_from(&by_point);
            let [px, py] = camera.intrinsics.principal;
            jacobian.column_mut(FOCAL).copy_from(&Vector2::new(seen.x - px, seen.y - py));
            let in_camera = camera.camera_from_world * point;
            let ideal = Vector2::new(in_camera.x / in_camera.z, in_camera.y / in_camera.z);
            let [fx, fy] = camera.intrinsics.focal;
            let cubic = ideal * ideal.norm_squared();
            jacobian
                .column_mut(K1)
                .copy_from(&Vector2::new(fx * cubic.x + camera.intrinsics.skew * cubic.y, fy * cubic.y));
            let fifth = cubic * ideal.norm_squared();
            jacobian
                .column_mut(K2)
                .copy_from(&Vector2::new(fx * fifth.x + camera.intrinsics.skew * fifth.y, fy * fifth.y));
            jacobian.column_mut(ASPECT).copy_from(&Vector2::new(0.0, seen.y - py));
            jacobian.fixed_columns_mut::<2>(PRINCIPAL).copy_from(&Matrix2::identity());
            jacobian.column_mut(DELAY).copy_from(&(by_point * sample.velocity));
            equations.add(&columns, &((seen - sample.pixel) / sample.sigma), &(jacobian / sample.sigma));
        }
        Some(())
    }
}
