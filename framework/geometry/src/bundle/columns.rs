//! Which parameters of a camera are free, and the column of each in its block.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};

use crate::camera::Camera;

/// Of optics and pose there are so many columns; those of the clock come after them.
pub const CLOCK: usize = 15;
/// All columns.
pub const N_NAMES: usize = CLOCK + 2;

/// What can be free. A camera's block of width C has the first C of them, or where clocks are adjusted the first C − 2 and the last two.
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

/// What of a camera is adjusted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Freedom {
    /// Rotation and translation.
    pub pose: bool,
    /// One factor of both focal lengths.
    pub focal: bool,
    /// A further factor of the vertical focal length alone.
    pub aspect: bool,
    /// Both coordinates of the principal point.
    pub principal: bool,
    /// Radial distortion, of r².
    pub k1: bool,
    /// Radial distortion, of r⁴.
    pub k2: bool,
    /// Radial distortion, of r⁶.
    pub k3: bool,
    /// Both decentering terms p1 and p2.
    pub decentering: bool,
}

impl Freedom {
    /// Nothing: the camera is known.
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
    /// The pose, under known optics.
    pub const POSE: Freedom = Freedom { pose: true, ..Freedom::NONE };

    /// Whether an optic is free.
    pub fn frees(&self, optic: Optic) -> bool {
        let mut of = *self;
        *of.of(optic)
    }

    /// The same with an optic held.
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

    /// By column of [`NAMES`].
    pub fn mask(&self) -> [bool; CLOCK] {
        let Freedom { pose, focal, aspect, principal, k1, k2, k3, decentering } = *self;
        let optics = [focal, k1, k2, principal, principal, aspect, decentering, decentering, k3];
        std::array::from_fn(|column| if column < 6 { pose } else { optics[column - 6] })
    }

    /// How many numbers are free.
    pub fn n_parameters(&self) -> usize {
        self.mask().iter().filter(|it| **it).count()
    }

    /// How many columns of [`NAMES`], counted from the first, hold all that is free.
    pub fn width(&self) -> usize {
        self.mask().iter().rposition(|it| *it).map_or(0, |it| it + 1)
    }
}

/// What of a camera's optics is freed or held as one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Optic {
    /// The factor of both focal lengths.
    Focal,
    /// The further factor of the vertical one.
    Aspect,
    /// The principal point.
    Principal,
    /// Radial distortion, of r².
    K1,
    /// Radial distortion, of r⁴.
    K2,
    /// Radial distortion, of r⁶.
    K3,
    /// Both decentering terms.
    Decentering,
}

impl Optic {
    /// All, from the one that is missed most to the one that is missed least.
    pub const ALL: [Optic; 7] =
        [Optic::Focal, Optic::K1, Optic::Principal, Optic::K2, Optic::Aspect, Optic::Decentering, Optic::K3];

    /// By the name of one of its parameters in [`super::UnobservableParameters`].
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

/// Standard deviations of the optics; 0 for what is held, infinite for what nobody knows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct OpticsSigma {
    /// Of the common factor of both focal lengths, relative [–].
    pub focal: f64,
    /// Of the further factor of the vertical one [–].
    pub aspect: f64,
    /// Of the principal point [px].
    pub principal: [f64; 2],
    /// Of k1, k2, k3 [–].
    pub radial: [f64; 3],
    /// Of p1, p2 [–].
    pub decentering: [f64; 2],
}

/// What is known of a camera's optics beside what its pixels say, such as that the principal point is near the middle.
///
/// What is free and known roughly keeps its own uncertainty in the covariance of everything else, where what is held at a guess would
/// pass for certain.
#[derive(Debug, Clone, PartialEq)]
pub struct OpticsPrior {
    /// With these optics; its pose does not matter.
    pub camera: Camera,
    /// To within so much, independent of each other and of that of other cameras.
    pub sigma: OpticsSigma,
}

/// The principal point of a camera of which nobody measured it is this part of the picture's longer side from the middle [–].
const PRINCIPAL_SIGMA: f64 = 0.02;

impl OpticsPrior {
    /// Of a `camera` whose optics are those that may be expected of any: nothing of its focal length, a principal point near the middle of
    /// the picture, pixels of the shape stated, a lens of moderate distortion that is mounted nearly straight.
    pub fn of_guess(camera: &Camera) -> OpticsPrior {
        let longer = f64::from(camera.image_size[0].max(camera.image_size[1]));
        let [fx, fy] = camera.intrinsics.focal;
        // Along the side of pixels that are higher than wide there are fewer of them.
        let principal = [PRINCIPAL_SIGMA * longer, PRINCIPAL_SIGMA * longer * fy / fx];
        let sigma =
            OpticsSigma { focal: f64::INFINITY, aspect: 0.003, principal, radial: [0.3; 3], decentering: [0.003; 2] };
        OpticsPrior { camera: camera.clone(), sigma }
    }

    /// Nothing.
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

/// Moves `camera` by a step in the columns of [`NAMES`], those left out 0; focal lengths by factors, so that they stay positive.
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
