//! Which parameters of a camera are free, and the column of each in its block.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::camera::Camera;

/// Number of columns of pose and optics; those of the clock come after them.
pub const CLOCK: usize = 15;
/// Number of all columns.
pub const N_NAMES: usize = CLOCK + 2;

/// Names of the parameters of a camera. A camera's block of width C has the first C of them; where clocks are
/// adjusted, the first C − 2 and the last two.
pub const NAMES: [&str; N_NAMES] = [
    "rotation x",
    "rotation y",
    "rotation z",
    "translation x",
    "translation y",
    "translation z",
    "focal",
    "k1",
    "k2",
    "principal x",
    "principal y",
    "aspect",
    "p1",
    "p2",
    "k3",
    "clock offset",
    "clock drift",
];

/// Which parameters of a camera are adjusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Freedom {
    /// Rotation and translation.
    pub pose: bool,
    /// Common factor of both focal lengths.
    pub focal: bool,
    /// Additional factor of the vertical focal length.
    pub aspect: bool,
    /// Both coordinates of the principal point.
    pub principal: bool,
    /// Radial distortion coefficient of r².
    pub k1: bool,
    /// Radial distortion coefficient of r⁴.
    pub k2: bool,
    /// Radial distortion coefficient of r⁶.
    pub k3: bool,
    /// Both decentering coefficients p1 and p2.
    pub decentering: bool,
}

impl Freedom {
    /// No parameter: the camera is held.
    pub const NONE: Freedom = Freedom {
        pose: false,
        focal: false,
        aspect: false,
        principal: false,
        k1: false,
        k2: false,
        k3: false,
        decentering: false,
    };
    /// The pose only, under known optics.
    pub const POSE: Freedom = Freedom { pose: true, ..Freedom::NONE };

    /// Whether an optic is free.
    pub fn frees(&self, optic: Optic) -> bool {
        let mut of = *self;
        *of.of(optic)
    }

    /// The same freedom with an optic held.
    #[must_use]
    pub fn without(mut self, optic: Optic) -> Freedom {
        *self.of(optic) = false;
        self
    }

    fn of(&mut self, optic: Optic) -> &mut bool {
        match optic {
            Optic::Focal => &mut self.focal,
            Optic::Aspect => &mut self.aspect,
            Optic::Principal => &mut self.principal,
            Optic::K1 => &mut self.k1,
            Optic::K2 => &mut self.k2,
            Optic::K3 => &mut self.k3,
            Optic::Decentering => &mut self.decentering,
        }
    }

    /// Whether each column of [`NAMES`] is free.
    pub fn mask(&self) -> [bool; CLOCK] {
        let Freedom { pose, focal, aspect, principal, k1, k2, k3, decentering } = *self;
        let optics = [focal, k1, k2, principal, principal, aspect, decentering, decentering, k3];
        std::array::from_fn(|column| if column < 6 { pose } else { optics[column - 6] })
    }

    /// Number of free parameters.
    pub fn n_parameters(&self) -> usize {
        self.mask().iter().filter(|it| **it).count()
    }

    /// Number of columns of [`NAMES`], counted from the first, that include all free ones.
    pub fn width(&self) -> usize {
        self.mask().iter().rposition(|it| *it).map_or(0, |it| it + 1)
    }
}

/// A group of optical parameters that is freed or held as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Optic {
    /// Common factor of both focal lengths.
    Focal,
    /// Additional factor of the vertical focal length.
    Aspect,
    /// Principal point.
    Principal,
    /// Radial distortion coefficient of r².
    K1,
    /// Radial distortion coefficient of r⁴.
    K2,
    /// Radial distortion coefficient of r⁶.
    K3,
    /// Both decentering coefficients.
    Decentering,
}

impl Optic {
    /// All optics, from the most to the least important.
    pub const ALL: [Optic; 7] =
        [Optic::Focal, Optic::K1, Optic::Principal, Optic::K2, Optic::Aspect, Optic::Decentering, Optic::K3];

    /// The optic of one of the parameters in [`super::UnobservableParameters`].
    pub fn named(parameter: &str) -> Option<Optic> {
        match parameter {
            "focal" => Some(Optic::Focal),
            "aspect" => Some(Optic::Aspect),
            "principal x" | "principal y" => Some(Optic::Principal),
            "k1" => Some(Optic::K1),
            "k2" => Some(Optic::K2),
            "k3" => Some(Optic::K3),
            "p1" | "p2" => Some(Optic::Decentering),
            _ => None,
        }
    }
}

impl std::fmt::Display for Optic {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str(match self {
            Optic::Focal => "focal length",
            Optic::Aspect => "aspect",
            Optic::Principal => "principal point",
            Optic::K1 => "k1",
            Optic::K2 => "k2",
            Optic::K3 => "k3",
            Optic::Decentering => "decentering",
        })
    }
}

/// Standard deviations of the optics; 0 for held parameters, infinite for unknown ones.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OpticsSigma {
    /// Relative standard deviation of the common factor of both focal lengths [–].
    pub focal: f64,
    /// Standard deviation of the additional factor of the vertical focal length [–].
    pub aspect: f64,
    /// Standard deviations of the principal point [px].
    pub principal: [f64; 2],
    /// Standard deviations of k1, k2, k3 [–].
    pub radial: [f64; 3],
    /// Standard deviations of p1, p2 [–].
    pub decentering: [f64; 2],
}

/// Prior knowledge of a camera's optics, for example that the principal point is near the middle.
///
/// A free parameter with a prior keeps its own uncertainty in the covariance of everything else, where a parameter
/// held at a guess would count as certain.
#[derive(Debug, Clone, PartialEq)]
pub struct OpticsPrior {
    /// A camera with the prior mean of the optics; its pose is not used.
    pub camera: Camera,
    /// Prior standard deviations, independent of each other and between cameras.
    pub sigma: OpticsSigma,
}

/// Prior standard deviation of an unmeasured principal point from the middle, as a part of the picture's longer side [–].
const PRINCIPAL_SIGMA: f64 = 0.02;

impl OpticsPrior {
    /// The weak prior of any `camera`: unknown focal length, a principal point near the middle of the picture, the
    /// stated pixel shape, a lens of moderate distortion that is mounted nearly straight.
    pub fn of_guess(camera: &Camera) -> OpticsPrior {
        let longer = f64::from(camera.image_size[0].max(camera.image_size[1]));
        let [fx, fy] = camera.intrinsics.focal;
        // Along the side of pixels that are higher than wide there are fewer of them.
        let principal = [PRINCIPAL_SIGMA * longer, PRINCIPAL_SIGMA * longer * fy / fx];
        let sigma =
            OpticsSigma { focal: f64::INFINITY, aspect: 0.003, principal, radial: [0.3; 3], decentering: [0.003; 2] };
        OpticsPrior { camera: camera.clone(), sigma }
    }

    /// No prior knowledge: all standard deviations infinite.
    pub fn none(camera: &Camera) -> OpticsPrior {
        let unknown = f64::INFINITY;
        let (principal, radial, decentering) = ([unknown; 2], [unknown; 3], [unknown; 2]);
        let sigma = OpticsSigma { focal: unknown, aspect: unknown, principal, radial, decentering };
        OpticsPrior { camera: camera.clone(), sigma }
    }

    /// Whether every sigma is above 0; infinite ones say nothing.
    pub(super) fn is_usable(&self) -> bool {
        self.sigma.columns().iter().all(|it| *it > 0.0)
    }

    /// By column from the focal length on: how far the optics of `camera` are from these.
    pub(super) fn apart(&self, camera: &Camera) -> [f64; CLOCK - 6] {
        let (here, there) = (&camera.intrinsics, &self.camera.intrinsics);
        let (own, other) = (&camera.distortion, &self.camera.distortion);
        let focal = (here.focal[0] / there.focal[0]).ln();
        let aspect = (here.focal[1] / there.focal[1]).ln() - focal;
        let principal = [0, 1].map(|it| here.principal[it] - there.principal[it]);
        let decentering = [own.p1 - other.p1, own.p2 - other.p2];
        let radial = [own.k1 - other.k1, own.k2 - other.k2, own.k3 - other.k3];
        [focal, radial[0], radial[1], principal[0], principal[1], aspect, decentering[0], decentering[1], radial[2]]
    }
}

impl OpticsSigma {
    /// By column from the focal length on.
    pub(super) fn columns(&self) -> [f64; CLOCK - 6] {
        let OpticsSigma { focal, aspect, principal, radial, decentering } = *self;
        [focal, radial[0], radial[1], principal[0], principal[1], aspect, decentering[0], decentering[1], radial[2]]
    }

    /// From the standard deviation of each column of [`NAMES`].
    pub fn of(column: impl Fn(usize) -> f64) -> OpticsSigma {
        OpticsSigma {
            focal: column(6),
            aspect: column(11),
            principal: [column(9), column(10)],
            radial: [column(7), column(8), column(14)],
            decentering: [column(12), column(13)],
        }
    }
}

/// `camera` after a step in the columns of [`NAMES`] (missing ones are 0); focal lengths change by factors, so that they stay positive.
pub fn moved(camera: &Camera, step: &[f64]) -> Camera {
    let at = |column: usize| step.get(column).copied().unwrap_or(0.0);
    let mut moved = camera.clone();
    let turn = UnitQuaternion::from_scaled_axis(Vector3::new(at(0), at(1), at(2)));
    // T exp(δ), to first order in the translation, which is all that a step needs.
    moved.camera_from_world *= Isometry3::from_parts(Translation3::new(at(3), at(4), at(5)), turn);
    moved.camera_from_world.rotation.renormalize_fast();
    let both = at(6).exp();
    moved.intrinsics.focal[0] *= both;
    moved.intrinsics.focal[1] *= both * at(11).exp();
    moved.intrinsics.skew *= both;
    moved.intrinsics.principal[0] += at(9);
    moved.intrinsics.principal[1] += at(10);
    moved.distortion.k1 += at(7);
    moved.distortion.k2 += at(8);
    moved.distortion.p1 += at(12);
    moved.distortion.p2 += at(13);
    moved.distortion.k3 += at(14);
    moved
}
