//! The growing surface: a distance field for its shape, patches for registration.
//!
//! A cloud is registered to all that came before, not to the last one: errors of poses do not add up along a chain. What does not fit is refused and changes nothing.

use foveate::estimation::statistics::{SIGMA_PER_MAD, median};
use foveate::geometry::surface::{
    DistanceField, FieldOptions, Fused, MeshOptions, Patches, Registration, RegistrationError, RegistrationOptions,
    Surface, SurfacePoint, TriangleMesh, find_normals, register,
};
use nalgebra::{Isometry3, Matrix3, Matrix6, Point3, Translation3, Vector3};

/// How a surface is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ModelOptions {
    /// From voxel to voxel; 0: twice the distance of neighbouring points of the first cloud [m].
    pub voxel_m: f64,
    /// How far to either side of the surface distances are kept [voxels].
    pub truncation: f64,
    /// Standard deviation of the start's place and of its direction, an axis [m, rad].
    pub start_sigmas: [f64; 2],
    /// Root mean square error of the points by that of the pose, at most; 0: half a voxel [m].
    pub max_pose_sigma_m: f64,
    /// After how long a cloud counts 1/e of what it did; 0: each counts for good [s].
    pub keep_s: f64,
    /// What registration is to be content with; `None`: each cloud lies where it is said to.
    pub registration: Option<RegistrationOptions>,
    /// Of the distance field and of the patches together [bytes].
    pub max_bytes: usize,
}

/// Points of one thing at one time, in the space of its scale.
#[derive(Debug, Clone, Default)]
pub struct Piece {
    /// With colours [gray level].
    pub points: Vec<(SurfacePoint, [u8; 3])>,
    /// Where the camera stood [m].
    pub viewpoint: Point3<f64>,
    /// When [s].
    pub time_s: f64,
}

/// The outcome for a cloud.
#[derive(Debug, Clone, PartialEq)]
pub struct Joined {
    /// Takes the cloud to the surface.
    pub surface_from_cloud: Isometry3<f64>,
    /// Of δ in `surface_from_cloud`⁻¹ ∘ exp(δ): an error of where the first cloud of the surface lies as that cloud saw it, (rotation, translation) [rad², rad m, m²].
    pub covariance: Matrix6<f64>,
    /// Root mean square motion of the cloud's points by an error of one standard deviation of that [m].
    pub sigma: f64,
    /// What all points of the cloud share, such as the error of its camera's pose: a shift of the whole, in the space of the surface [m²].
    pub shared: Matrix3<f64>,
    /// `None` for the cloud that the surface began with, and for those that lie where they are said to.
    pub registration: Option<Registration>,
    /// Points that are in the surface now.
    pub n_fused: usize,
    /// Points left out for want of a normal, and for want of memory.
    pub n_without_normal: usize,
    /// See above.
    pub n_beyond_memory: usize,
}

/// Why a cloud is not in the surface.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// It does not fit the surface so far.
    #[error("{0}")]
    Unregistered(RegistrationError),
    /// Its shape does not determine its pose.
    #[error(
        "its shape leaves {n_open} direction{} undetermined, as planes, spheres and rods do, and without {} the pose is known to {:.2} mm, expected {:.2} mm",
        if *n_open == 1 { "" } else { "s" }, if *n_open == 1 { "it" } else { "them" }, 1e3 * sigma_m, 1e3 * expected_m
    )]
    NotHeld {
        /// Directions in which it slides along itself.
        n_open: usize,
        /// Root mean square error of the points [m].
        sigma_m: f64,
        /// The most that is allowed [m].
        expected_m: f64,
    },
}

/// Neighbours that tell a normal lie within so many voxels.
const NORMAL_RADIUS: f64 = 3.0;
/// Cells that clouds are registered to, in voxels.
const CELL: f64 = 2.0;
/// Levels of them: the coarsest is 64 voxels wide.
const N_LEVELS: usize = 6;
/// Bytes of a block of the field, and of a patch on all its levels, with their places in tables.
const BLOCK_BYTES: usize = 512 * 32 + 64;
const PATCH_BYTES: usize = 160;
/// Patches to each block that there is room for: a surface passes some 16 cells of 2 × 2 × 2 voxels in a block.
const PATCHES_PER_BLOCK: usize = 16;

/// A surface that grows.
pub struct Model {
    options: ModelOptions,
    grown: Option<Grown>,
}

struct Grown {
    voxel_m: f64,
    field: DistanceField,
    patches: Patches,
    /// Of the last cloud that fitted: where the next one is expected.
    surface_from_cloud: Isometry3<f64>,
    /// Its time [s].
    time_s: f64,
    n_pieces: usize,
    /// Of where it lies beside its first cloud: an error δ of poses that lead into it, from the left.
    covariance: Matrix6<f64>,
    /// Points in it, those of older clouds for what they still count.
    n_points: f64,
}

/// A point counts no less than this of what it did, so that weights stay numbers.
const LEAST_SHARE: f64 = 1e-6;

impl Model {
    /// Without a cloud yet.
    pub fn new(options: ModelOptions) -> Model {
        Model { options, grown: None }
    }

    /// Clouds in it.
    pub fn n_pieces(&self) -> usize {
        self.grown.as_ref().map_or(0, |it| it.n_pieces)
    }

    /// Points that a cloud needs.
    pub fn min_points(&self) -> usize {
        self.options.registration.map_or(1, |it| it.min_pairs)
    }

    /// From voxel to voxel; 0 before the first cloud [m].
    pub fn voxel_m(&self) -> f64 {
        self.grown.as_ref().map_or(0.0, |it| it.voxel_m)
    }

    /// Its memory [bytes].
    pub fn bytes(&self) -> usize {
        self.grown.as_ref().map_or(0, |it| it.field.n_blocks() * BLOCK_BYTES + it.patches.len() * PATCH_BYTES)
    }

    /// Forgets all clouds.
    pub fn clear(&mut self) {
        self.grown = None;
    }

    /// The surface as it is now.
    pub fn mesh(&self, options: &MeshOptions) -> TriangleMesh {
        self.grown.as_ref().map_or_else(TriangleMesh::default, |it| it.field.mesh(options))
    }

    /// Registers a cloud, unless it lies where it is said to, and takes it in. `covariance`: of where the scale's space is, about the points' middle, beside `start_sigmas`.
    ///
    /// # Errors
    /// See [`Refusal`]: the surface is as it was.
    pub fn join(&mut self, mut piece: Piece, covariance: &Matrix6<f64>) -> Result<Joined, Refusal> {
        let min = self.min_points();
        if piece.points.len() < min {
            let count = piece.points.len();
            return Err(Refusal::Unregistered(RegistrationError::TooFewPoints { count, expected: min }));
        }
        let voxel_m = self.grown.as_ref().map_or_else(|| self.first_voxel_m(&piece), |it| it.voxel_m);
        let mut points: Vec<SurfacePoint> = piece.points.iter().map(|it| it.0).collect();
        let n_without_normal = find_normals(&mut points, NORMAL_RADIUS * voxel_m, &piece.viewpoint);
        // What a whole cloud shares, such as the error of its camera's pose, is for registration to find, and does not become less with more points.
        let scatter = scatter(&points, CELL * voxel_m);
        let sum: Matrix3<f64> = points.iter().map(|it| it.covariance).sum();
        let shared = sum * ((1.0 - scatter * scatter) / points.len().max(1) as f64);
        for (to, from) in piece.points.iter_mut().zip(points) {
            to.0 = SurfacePoint { covariance: from.covariance * (scatter * scatter), ..from };
        }

        let (registration, covariance) = match (&self.grown, &self.options.registration) {
            (Some(grown), Some(options)) => {
                let (found, covariance) = self.registered(grown, options, &piece, covariance)?;
                (Some(found), covariance + grown.covariance)
            }
            (Some(_), None) => (None, *covariance),
            (None, _) => {
                let count = piece.points.len() - n_without_normal;
                if count < min {
                    return Err(Refusal::Unregistered(RegistrationError::TooFewPoints { count, expected: min }));
                }
                (None, Matrix6::zeros())
            }
        };
        let surface_from_cloud = registration.as_ref().map_or_else(Isometry3::identity, |it| it.surface_from_cloud);
        let max_blocks = (self.options.max_bytes / (BLOCK_BYTES + PATCHES_PER_BLOCK * PATCH_BYTES)).max(1);
        let changes = self.options.keep_s > 0.0;
        let field = FieldOptions { voxel_m, truncation: self.options.truncation, max_blocks, changes };
        let grown = self.grown.get_or_insert_with(|| Grown {
            voxel_m,
            field: DistanceField::new(field),
            patches: Patches::new(CELL * voxel_m, N_LEVELS, max_blocks * PATCHES_PER_BLOCK),
            surface_from_cloud,
            time_s: piece.time_s,
            n_pieces: 0,
            covariance: Matrix6::zeros(),
            n_points: 0.0,
        });
        if self.options.keep_s > 0.0 {
            let share = (-(piece.time_s - grown.time_s).max(0.0) / self.options.keep_s).exp().max(LEAST_SHARE);
            grown.field.fade(share);
            grown.patches.fade(share);
            grown.n_points *= share;
        }
        grown.time_s = grown.time_s.max(piece.time_s);
        let turn: Matrix3<f64> = surface_from_cloud.rotation.to_rotation_matrix().into_inner();
        let (mut n_fused, mut n_beyond_memory) = (0, 0);
        for (point, colour) in &piece.points {
            let there = SurfacePoint {
                position: surface_from_cloud * point.position,
                covariance: turn * point.covariance * turn.transpose(),
                normal: surface_from_cloud.rotation * point.normal,
            };
            match grown.field.fuse(&there, *colour) {
                Fused::Yes => {
                    n_fused += 1;
                    grown.patches.add(&there);
                }
                Fused::Full => n_beyond_memory += 1,
                Fused::Unfit => {}
            }
        }
        grown.n_points += n_fused as f64;
        if registration.is_some() && n_fused > 0 {
            // The new cloud moves what is there by its own error, for as much as it counts.
            let share = n_fused as f64 / grown.n_points;
            grown.covariance += (covariance - grown.covariance) * (share * share);
        }
        grown.surface_from_cloud = surface_from_cloud;
        grown.n_pieces += 1;
        let sigma = motion(&covariance, piece.points.iter().map(|it| surface_from_cloud * it.0.position));
        let shared = turn * shared * turn.transpose();
        Ok(Joined {
            surface_from_cloud,
            covariance,
            sigma,
            shared,
            registration,
            n_fused,
            n_without_normal,
            n_beyond_memory,
        })
    }

    fn registered(
        &self,
        grown: &Grown,
        options: &RegistrationOptions,
        piece: &Piece,
        covariance: &Matrix6<f64>,
    ) -> Result<(Registration, Matrix6<f64>), Refusal> {
        // About the middle of the points, a turn moves them no farther than it must.
        let sum: Vector3<f64> = piece.points.iter().map(|it| it.0.position.coords).sum();
        let middle = Translation3::from(sum / piece.points.len() as f64);
        let points: Vec<SurfacePoint> =
            piece.points.iter().map(|it| SurfacePoint { position: it.0.position - middle.vector, ..it.0 }).collect();
        let [shift, turn] = self.options.start_sigmas.map(|it| it * it);
        let start_covariance = covariance + Matrix6::from_diagonal(&[turn, turn, turn, shift, shift, shift].into());
        let start = grown.surface_from_cloud * middle;
        let found = register(&points, &grown.patches, &start, &start_covariance, options);
        let mut found = found.map_err(Refusal::Unregistered)?;
        let expected_m = match self.options.max_pose_sigma_m {
            0.0 => 0.5 * grown.voxel_m,
            stated => stated,
        };
        if found.sigma > expected_m {
            return Err(Refusal::NotHeld { n_open: found.not_held.len(), sigma_m: found.sigma, expected_m });
        }
        let carried = adjoint(&found.surface_from_cloud);
        let covariance = carried * found.covariance * carried.transpose();
        found.surface_from_cloud *= middle.inverse();
        Ok((found, covariance))
    }

    fn first_voxel_m(&self, piece: &Piece) -> f64 {
        if self.options.voxel_m > 0.0 { self.options.voxel_m } else { 2.0 * spacing(piece) }
    }
}

/// Root mean square motion of points by an error of one standard deviation [m].
pub fn motion(covariance: &Matrix6<f64>, points: impl Iterator<Item = Point3<f64>>) -> f64 {
    // Of |ω × p + v|² = ωᵀ (|p|² 1 − p pᵀ) ω + 2 ω · (p × v) + |v|², the means of p and of p pᵀ are all that is needed.
    let (mut sum, mut squares, mut n) = (Vector3::zeros(), Matrix3::zeros(), 0.0);
    for point in points {
        sum += point.coords;
        squares += point.coords * point.coords.transpose();
        n += 1.0;
    }
    let (mean, squares) = (sum / n, squares / n);
    let block = |row, column| covariance.fixed_view::<3, 3>(row, column).into_owned();
    let turns = (block(0, 0) * (Matrix3::identity() * squares.trace() - squares)).trace();
    let both = 2.0 * (block(0, 3) * mean.cross_matrix().transpose()).trace();
    (turns + both + block(3, 3).trace()).max(0.0).sqrt()
}

/// Of an error δ on the right of a pose T: T exp(δ) = exp(A δ) T.
fn adjoint(pose: &Isometry3<f64>) -> Matrix6<f64> {
    let turn: Matrix3<f64> = pose.rotation.to_rotation_matrix().into_inner();
    let mut whole = Matrix6::zeros();
    whole.fixed_view_mut::<3, 3>(0, 0).copy_from(&turn);
    whole.fixed_view_mut::<3, 3>(3, 3).copy_from(&turn);
    whole.fixed_view_mut::<3, 3>(3, 0).copy_from(&(pose.translation.vector.cross_matrix() * turn));
    whole
}

/// Points that say how much a cloud scatters.
const SCATTERING: usize = 5000;
/// They stand in cells whose mean knows its place so much better than they do, as variances; and so many there must be.
const KNOWN_BETTER: f64 = 0.4;
const MIN_SCATTERING: usize = 50;

/// By how much points scatter about the mean plane of their own cell, over what their sigmas say; 1 where they scatter as much or more, or too few are there to tell.
fn scatter(points: &[SurfacePoint], cell_m: f64) -> f64 {
    let mut own = Patches::new(cell_m, 1, usize::MAX);
    points.iter().for_each(|it| {
        own.add(it);
    });
    let share = |it: &SurfacePoint| {
        let found = own.nearest(0, &it.position)?;
        let variance = found.normal.dot(&(it.covariance * found.normal));
        // The point is part of the mean: Var(x − mean) = Var(x) − Var(mean).
        let is_known = found.variance < KNOWN_BETTER * variance;
        is_known.then(|| (found.normal.dot(&(it.position - found.position))).abs() / (variance - found.variance).sqrt())
    };
    let shares: Vec<f64> = points.iter().step_by(points.len().div_ceil(SCATTERING).max(1)).filter_map(share).collect();
    let scatter = median(&shares).filter(|_| shares.len() >= MIN_SCATTERING).map(|it| SIGMA_PER_MAD * it);
    scatter.map_or(1.0, |it| it.clamp(1e-3, 1.0))
}

/// Points that say how far neighbours are apart.
const ASKED: usize = 300;

/// Median distance from a point to the one nearest to it [m].
fn spacing(piece: &Piece) -> f64 {
    let nearest = |it: &(SurfacePoint, [u8; 3])| {
        let off = |other: &(SurfacePoint, [u8; 3])| (other.0.position - it.0.position).norm_squared();
        piece.points.iter().map(off).filter(|it| *it > 0.0).fold(f64::INFINITY, f64::min).sqrt()
    };
    let mut distances: Vec<f64> = piece
        .points
        .iter()
        .step_by(piece.points.len().div_ceil(ASKED))
        .map(nearest)
        .filter(|it| it.is_finite())
        .collect();
    distances.sort_by(f64::total_cmp);
    distances.get(distances.len() / 2).map_or(1e-3, |it| it.max(1e-6))
}
