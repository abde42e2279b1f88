//! Acquisition of a body from voxels alone [Mikić 2001 §3]: head, neck, torso; limbs are in [`super::limbs`].
//!
//! 1. Head: a spherical crust between the smallest and the largest head is placed at each position that is deep
//!    enough. The paper counts its surface voxels; here 96 directions are followed
//!    from its middle, and those count that leave the voxels within the crust, so that the threshold does not depend
//!    on the size of voxels. A head is open at its neck only.
//! 2. Neck: the mean of the head's voxels that touch others.
//! 3. Torso: the template hangs on the neck and swings until its axis passes through the middle of the voxels inside
//!    it. Then it is shrunk, and extended along its axis until
//!    that is no longer inside: where the legs part.
//!
//! Each step can fail, with a reason; several places for the head are tried, the best first.

use nalgebra::{Matrix2, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};
use thiserror::Error;

use super::field::VoxelField;
use super::model::Body;
use super::parts::{N_PARTS, Part};
use super::proportions::{Proportions, share};
use super::solid::TRUNK_BOTTOM;

/// Options of acquisition.
#[derive(Debug, Clone, PartialEq)]
pub struct AcquisitionOptions {
    /// Inner and outer radius of the crust: the smallest and the largest head, hair included [m].
    pub crust: [f64; 2],
    /// Least share of the directions that leave within the crust, for a head [–].
    pub crust_share: f64,
    /// Least share of the torso's template filled by voxels, for a torso [–].
    pub torso_filled: f64,
    /// Least cosine between the vertical and the direction to the torso's upper end, for a body [–].
    pub least_up: f64,
    /// Largest share of the voxels' skin that may belong to no part, for a body [–].
    pub most_unexplained: f64,
    /// Least volume of a body [m³].
    pub least_volume: f64,
    /// Options for limbs.
    pub limbs: super::limbs::LimbOptions,
}

impl Default for AcquisitionOptions {
    /// Who lies is found, who stands on the head only when upright again: in hulls, calves look like heads, and legs like a torso on them. Arms that hang are a third of a body's skin.
    /// Heads are 14 to 26 cm through (Winter, figure 4.1, adults ± hair). The neck takes a tenth of all directions and a hull of few views another tenth. A child of ten has 30 l.
    fn default() -> Self {
        Self {
            crust: [0.065, 0.15],
            crust_share: 0.70,
            torso_filled: 0.60,
            least_up: -0.3,
            most_unexplained: 0.45,
            least_volume: 0.02,
            limbs: super::limbs::LimbOptions::default(),
        }
    }
}

/// Why no body was acquired.
#[derive(Debug, Clone, PartialEq, Error)]
pub enum AcquisitionFailure {
    /// Too few voxels for a body.
    #[error("{found:.4} m³ of voxels, expected {expected:.4} m³ or more for a body")]
    Small {
        /// Volume of the voxels [m³].
        found: f64,
        /// Volume that is needed [m³].
        expected: f64,
    },
    /// No head was found.
    #[error("no head: at best {found:.2} of all directions leave within the crust, expected {expected:.2}")]
    Head {
        /// Largest share found [–].
        found: f64,
        /// Share that is needed [–].
        expected: f64,
    },
    /// No torso was found below any head.
    #[error("no torso: voxels fill {found:.2} of the template below the head, expected {expected:.2}")]
    Torso {
        /// Largest share found [–].
        found: f64,
        /// Share that is needed [–].
        expected: f64,
    },
    /// The torso below the head points upwards from it.
    #[error(
        "no torso: the one at the head points the wrong way, cosine {found:.2} to the vertical, expected {expected:.2} or more"
    )]
    Hanging {
        /// Largest cosine found [–].
        found: f64,
        /// Cosine that is needed [–].
        expected: f64,
    },
    /// Head and torso leave too many voxels unexplained.
    #[error(
        "head and torso explain too little: {found:.2} of the skin belongs to no part, expected at most {expected:.2}"
    )]
    Rest {
        /// Share of the skin that belongs to no part [–].
        found: f64,
        /// Largest accepted share [–].
        expected: f64,
    },
    /// The model fits, but is unlike a person, as with armchairs, boxes and plants.
    #[error(
        "too unlike a person: {head:.2} of the head's skin is present, and the limbs' sizes are {limbs:.1} standard deviations from people's"
    )]
    Unlike {
        /// Share of the head's skin that is present [–].
        head: f64,
        /// Root mean square deviation of the limbs' sizes, in standard deviations [–].
        limbs: f64,
    },
    /// The volume cuts the body off, and the head may be beyond its end.
    #[error(
        "the volume cuts it off, and no head in it is clear: {head:.2} of its skin is present, expected {expected:.2}"
    )]
    CutOff {
        /// Share of the head's skin that is present [–].
        head: f64,
        /// Share that is needed [–].
        expected: f64,
    },
    /// Voxels above the head that was found reach the volume's top, and may be the real head.
    #[error(
        "the volume cuts it off: {away:.2} m beside the head that was found {thick:.2} m thick voxels reach the volume's top, {above:.2} m higher, and that may be the head"
    )]
    CutAbove {
        /// Thickness of the voxels that reach the top [m].
        thick: f64,
        /// Height of the top above the middle of the head that was found [m].
        above: f64,
        /// Horizontal distance from that head [m].
        away: f64,
    },
    /// The body is tracked already, or as many bodies are tracked as allowed.
    #[error("its head is that of a tracked body, or {most} bodies are tracked, which is the limit")]
    Known {
        /// The most bodies that are tracked.
        most: usize,
    },
    /// Voxels beside another body that would be a lying or stooping person: thighs and chairs look like that.
    #[error(
        "beside another body, and its head is {found:.2} m above its lowest voxel with the torso {upright:.2} upright: expected {expected:.2} m and {least_upright:.2} or more for a new person there"
    )]
    Beside {
        /// Height of the head above the lowest voxel [m].
        found: f64,
        /// Height that is needed [m].
        expected: f64,
        /// Cosine between the torso and the vertical [–].
        upright: f64,
        /// Cosine that is needed [–].
        least_upright: f64,
    },
    /// The fitted model does not agree with the voxels.
    #[error(
        "the fitted {part} does not agree with the voxels: {inside:.2} of its axis lies inside, {covered:.2} of its skin is present"
    )]
    Fit {
        /// Name of the part.
        part: &'static str,
        /// Share of its axis inside the voxels [–].
        inside: f64,
        /// Share of its skin that is present [–].
        covered: f64,
    },
}

/// A candidate for a head.
#[derive(Debug, Clone, PartialEq)]
pub struct HeadFound {
    /// Centre [m].
    pub centre: Point3<f64>,
    /// Mean distance from the centre to the skin [m].
    pub radius: f64,
    /// Share of the directions that leave within the crust [–].
    pub crust_share: f64,
    /// Unit direction to the neck.
    pub down: Vector3<f64>,
}

const N_WAYS: usize = 96;

/// Directions all over the sphere, as even as a spiral of golden angles makes them.
pub(super) fn ways<const N: usize>() -> [Vector3<f64>; N] {
    let golden = std::f64::consts::PI * (3.0 - 5f64.sqrt());
    std::array::from_fn(|i| {
        let z = 1.0 - (2 * i + 1) as f64 / N as f64;
        let (sine, cosine) = (golden * i as f64).sin_cos();
        let ring = (1.0 - z * z).sqrt();
        Vector3::new(ring * cosine, ring * sine, z)
    })
}

/// Candidates for heads, the best first, none within 0.12 m of a better one; and the largest share of all directions, accepted or not.
pub fn find_heads(field: &VoxelField, options: &AcquisitionOptions) -> (Vec<HeadFound>, f64) {
    let ways = ways::<N_WAYS>();
    let [inner, outer] = options.crust;
    let half = field.size() / 2.0;
    let mut found: Vec<HeadFound> = Vec::new();
    let mut best: f64 = 0.0;
    // Of fine voxels every second along each axis will do: the middle is refined.
    let coarse = (0.03 / field.size()).floor().max(1.0) as u32;
    for &cell in field.voxels() {
        let depth = field.depth_of(cell);
        if depth < inner - 1.2 * field.size() || depth > outer + half || !is_on_lattice(field, cell, coarse) {
            continue;
        }
        let centre = field.centre(cell);
        // Six ways first: most places fail these.
        let quick = [0, 15, 31, 47, 63, 79].map(|it| ways[it]);
        if quick.iter().filter(|way| leaves(field, &centre, way, outer + half).is_some()).count() < 4 {
            continue;
        }
        let mut head = try_head(field, &centre, &ways, [inner, outer]);
        for _ in 0..2 {
            let better = try_head(field, &head.centre, &ways, [inner, outer]);
            if better.crust_share < head.crust_share {
                break;
            }
            head = better;
        }
        best = best.max(head.crust_share);
        if head.crust_share >= options.crust_share {
            found.push(head);
        }
    }
    found.sort_by(|a, b| b.crust_share.total_cmp(&a.crust_share));
    let mut kept: Vec<HeadFound> = Vec::new();
    for head in found {
        if kept.len() < 6 && kept.iter().all(|it| (it.centre - head.centre).norm() > 0.12) {
            kept.push(head);
        }
    }
    (kept, best)
}

fn is_on_lattice(field: &VoxelField, cell: u32, coarse: u32) -> bool {
    if coarse == 1 {
        return true;
    }
    let place = field.centre(cell).coords / (field.size() * f64::from(coarse));
    let off = |it: f64| (it - it.floor()) * f64::from(coarse) < 1.0;
    off(place.x) && off(place.y) && off(place.z)
}

/// Distance along `way` until the voxels end; `None`: farther than `most`, or out of the volume, where occupancy is unknown.
fn leaves(field: &VoxelField, from: &Point3<f64>, way: &Vector3<f64>, most: f64) -> Option<f64> {
    let step = field.size() * 0.4;
    let n = (most / step).ceil() as usize;
    let end = (1..=n).map(|it| it as f64 * step).find(|&at| !field.is_occupied(&(from + way * at)))?;
    (!field.is_beyond(&(from + way * end))).then_some(end - step / 2.0)
}

fn try_head(field: &VoxelField, centre: &Point3<f64>, ways: &[Vector3<f64>], [inner, outer]: [f64; 2]) -> HeadFound {
    let half = field.size() / 2.0;
    let (mut sum, mut radii, mut n, mut beyond) = (Vector3::zeros(), 0.0, 0, Vector3::zeros());
    for way in ways {
        match leaves(field, centre, way, outer + half) {
            Some(at) if at >= inner - half => {
                sum += way * at;
                radii += at;
                n += 1;
            }
            Some(_) => {}
            None => beyond += way,
        }
    }
    let count = f64::from(n.max(1));
    // A head goes on in one direction only, a piece of a limb in two.
    let n_beyond = ways.iter().filter(|it| leaves(field, centre, it, outer + half).is_none()).count();
    let is_one_sided = n_beyond < 4 || beyond.norm() > 0.6 * n_beyond as f64;
    let down = beyond.try_normalize(1e-6).unwrap_or(-Vector3::z());
    // The ways through the neck are missing on one side; without their opposites the mean is fair.
    let mut fair = Vector3::zeros();
    let mut n_fair = 0;
    for way in ways {
        if way.dot(&down).abs() < 0.75
            && let Some(at) = leaves(field, centre, way, outer + half).filter(|at| *at >= inner - half)
        {
            fair += way * at;
            n_fair += 1;
        }
    }
    let shift = if n_fair > ways.len() / 3 { fair / f64::from(n_fair as u32) } else { sum / count };
    HeadFound {
        centre: centre + shift * 0.7,
        radius: radii / count,
        crust_share: f64::from(n) / ways.len() as f64 * if is_one_sided { 1.0 } else { 0.6 },
        down,
    }
}

/// A candidate for head, neck and torso.
#[derive(Debug, Clone, PartialEq)]
pub struct TrunkFound {
    /// The head.
    pub head: HeadFound,
    /// Position of the neck [m].
    pub neck: Point3<f64>,
    /// Unit direction from the torso's lower end to the neck.
    pub up: Vector3<f64>,
    /// Unit direction to one side, perpendicular to `up`; which side is unknown.
    pub aside: Vector3<f64>,
    /// Length of the torso [m].
    pub length: f64,
    /// Share of the template that voxels fill [–].
    pub filled: f64,
}

/// Finds neck and torso below a head.
pub fn find_torso(field: &VoxelField, head: &HeadFound, proportions: &Proportions) -> Option<TrunkFound> {
    let size = share(Part::Torso) * proportions.stature;
    let length = 2.0 * size.z;
    let reach = head.radius * 1.25 + field.size() * 0.3;
    let is_head = |place: &Point3<f64>| (place - head.centre).norm() <= reach;
    let (mut neck, mut n_neck) = (Vector3::zeros(), 0);
    let (mut middle, mut n_middle) = (Vector3::zeros(), 0);
    for &cell in field.voxels() {
        let place = field.centre(cell);
        if is_head(&place) {
            let touches = field.neighbours(cell).take(6).any(|(it, _)| field.holds(it) && !is_head(&field.centre(it)));
            if touches && (place - head.centre).dot(&head.down) > 0.0 {
                neck += place.coords;
                n_neck += 1;
            }
        } else {
            middle += place.coords;
            n_middle += 1;
        }
    }
    if n_neck == 0 || n_middle == 0 {
        return None;
    }
    let neck = Point3::from(neck / f64::from(n_neck));
    let mut down = (middle / f64::from(n_middle) - neck.coords).try_normalize(1e-6)?;
    // Far from the neck at first, so that it swings home from anywhere; then as wide as a torso.
    for step in 0..24 {
        let radius = if step < 12 { size.y * 1.3 } else { size.y };
        let (mut sum, mut n) = (Vector3::zeros(), 0);
        for &cell in field.voxels() {
            let away = field.centre(cell) - neck;
            let along = away.dot(&down);
            if along > 0.0 && along < length && (away - down * along).norm() < radius && !is_head(&field.centre(cell)) {
                sum += away;
                n += 1;
            }
        }
        if n == 0 {
            return None;
        }
        let next = (sum / f64::from(n)).try_normalize(1e-6)?;
        let turned = next.angle(&down);
        down = next;
        if turned < 0.01 && step > 12 {
            break;
        }
    }
    // Shrunk to a third, then grown along its axis while that lies inside: the place where the legs part ends it.
    let mut grown = length / 3.0;
    while grown < length * 1.4 && field.depth(&(neck + down * (grown + 0.01))).0 > 0.3 * size.x {
        grown += 0.01;
    }
    // From there up to the hips.
    grown /= 0.5 * (1.0 + TRUNK_BOTTOM);
    let filled = filled(field, &neck, &down, &size);
    let aside = aside(field, &neck, &down, &size, grown.max(0.7 * length));
    Some(TrunkFound {
        head: head.clone(),
        neck,
        up: -down,
        aside,
        length: grown.clamp(0.85 * length, 1.15 * length),
        filled,
    })
}

/// Share of the template, a cylinder as thick as a torso is deep, that voxels fill.
fn filled(field: &VoxelField, neck: &Point3<f64>, down: &Vector3<f64>, size: &Vector3<f64>) -> f64 {
    let aside = down.cross(&if down.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize();
    let front = down.cross(&aside);
    let (mut n, mut inside) = (0, 0);
    for along in 2..18 {
        for ring in 0..12 {
            let (sine, cosine) = (f64::from(ring) * std::f64::consts::TAU / 12.0).sin_cos();
            for radius in [0.35, 0.8] {
                let off = (aside * cosine + front * sine) * (radius * size.x);
                let place = neck + down * (f64::from(along) / 18.0 * 2.0 * size.z) + off;
                n += 1;
                inside += i32::from(field.is_occupied(&place));
            }
        }
    }
    f64::from(inside) / f64::from(n)
}

/// The direction in which a torso is widest.
fn aside(
    field: &VoxelField,
    neck: &Point3<f64>,
    down: &Vector3<f64>,
    size: &Vector3<f64>,
    length: f64,
) -> Vector3<f64> {
    let first = down.cross(&if down.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize();
    let second = down.cross(&first);
    let mut moments = Matrix2::zeros();
    for &cell in field.voxels() {
        let away = field.centre(cell) - neck;
        let along = away.dot(down);
        let (a, b) = (away.dot(&first), away.dot(&second));
        // Below the neck, above the legs.
        if along > 0.25 * size.z && along < length * 0.9 && a * a + b * b < (1.5 * size.y).powi(2) {
            moments += Matrix2::new(a * a, a * b, a * b, b * b);
        }
    }
    let eigen = moments.symmetric_eigen();
    let widest = eigen.eigenvectors.column(eigen.eigenvalues.imax()).into_owned();
    first * widest[0] + second * widest[1]
}

/// Axes with z along `up` and y as near to `left` as may be.
pub(super) fn turn_of(up: &Vector3<f64>, left: &Vector3<f64>) -> UnitQuaternion<f64> {
    let front = left
        .cross(up)
        .try_normalize(1e-9)
        .unwrap_or_else(|| up.cross(&if up.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize());
    let axes = Matrix3::from_columns(&[front, up.cross(&front), *up]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

/// The body that a trunk begins with: limbs hang down.
pub(super) fn body_of(trunk: &TrunkFound, proportions: &Proportions) -> Body {
    let mut sizes = proportions.sizes();
    sizes[0].z = trunk.length / 2.0;
    let turn = turn_of(&trunk.up, &trunk.aside);
    let nods = (trunk.head.centre - trunk.neck).try_normalize(1e-6).unwrap_or(trunk.up);
    let mut turns = [turn; N_PARTS];
    turns[Part::Head.index()] = turn_of(&nods, &trunk.aside);
    // The head is the surest of all: the torso hangs below it.
    let below = trunk.head.centre - nods * sizes[Part::Head.index()].z - trunk.up * sizes[0].z;
    Body { torso: below, turns, sizes }
}

/// Moments of voxels, and the part that they describe, as in the paper: centre, axes by ascending variance, half sizes.
#[derive(Debug, Clone, PartialEq)]
pub struct Moments {
    /// Mean of the centres [m].
    pub centre: Point3<f64>,
    /// Columns: directions of least, middle and largest variance, right-handed.
    pub axes: Matrix3<f64>,
    /// Half sizes l₀ ≤ l₁ ≤ l₂ for the [`Form`] [m].
    pub sizes: Vector3<f64>,
}

/// The solid that voxels fill.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// A solid ellipsoid: l = √5 σ, since ∫z² over a ball of radius 1 is a fifth of its volume.
    Ellipsoid,
    /// The surface of an ellipsoid: l = √3 σ on a sphere. The paper uses this factor although its voxels fill the part: then it is 23 % too small.
    EllipsoidSkin,
    /// A solid cylinder: 2 σ across and √3 σ along.
    Cylinder,
}

/// Moments of voxels with these centres and of edge `size` [m]. `None` for fewer than four.
pub fn moments(centres: &[Point3<f64>], size: f64, form: Form) -> Option<Moments> {
    if centres.len() < 4 {
        return None;
    }
    let n = centres.len() as f64;
    let centre = Point3::from(centres.iter().map(|it| it.coords).sum::<Vector3<f64>>() / n);
    let spread = centres.iter().map(|it| (it - centre) * (it - centre).transpose()).sum::<Matrix3<f64>>() / n;
    // A cube has a variance of its own.
    let eigen = (spread + Matrix3::identity() * (size * size / 12.0)).symmetric_eigen();
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| eigen.eigenvalues[*a].total_cmp(&eigen.eigenvalues[*b]));
    let [x, y, z] = order.map(|it| eigen.eigenvectors.column(it).into_owned());
    let x = if x.cross(&y).dot(&z) < 0.0 { -x } else { x };
    let sigma = order.map(|it| eigen.eigenvalues[it].max(0.0).sqrt());
    let [across, along] = match form {
        Form::Ellipsoid => [5f64.sqrt(); 2],
        Form::EllipsoidSkin => [3f64.sqrt(); 2],
        Form::Cylinder => [2.0, 3f64.sqrt()],
    };
    let sizes = Vector3::new(across * sigma[0], across * sigma[1], along * sigma[2]);
    Some(Moments { centre, axes: Matrix3::from_columns(&[x, y, z]), sizes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filled(size: f64, inside: impl Fn(&Vector3<f64>) -> bool) -> Vec<Point3<f64>> {
        let n = (0.8 / size) as i32;
        let place = |i: i32| (f64::from(i) - f64::from(n) / 2.0) * size;
        let all = (0..n * n * n).map(|it| Vector3::new(place(it % n), place(it / n % n), place(it / n / n)));
        all.filter(inside).map(Point3::from).collect()
    }

    #[test]
    fn sizes_follow_from_variances() {
        let tube = filled(0.01, |p| (p.x / 0.05).powi(2) + (p.y / 0.08).powi(2) < 1.0 && p.z.abs() < 0.3);
        let found = moments(&tube, 0.01, Form::Cylinder).unwrap();
        assert!((found.sizes - Vector3::new(0.05, 0.08, 0.3)).norm() < 8e-3, "{}", found.sizes);
        assert!(found.axes.column(2).z.abs() > 0.999 && (found.axes.determinant() - 1.0).abs() < 1e-9);
        let egg = filled(0.01, |p| (p.x / 0.1).powi(2) + (p.y / 0.15).powi(2) + (p.z / 0.2).powi(2) < 1.0);
        let found = moments(&egg, 0.01, Form::Ellipsoid).unwrap();
        assert!((found.sizes - Vector3::new(0.1, 0.15, 0.2)).norm() < 8e-3, "{}", found.sizes);
        assert!(moments(&egg[..3], 0.01, Form::Ellipsoid).is_none());
        let ball = filled(0.01, |p| (0.24..0.25).contains(&p.norm()));
        let found = moments(&ball, 0.01, Form::EllipsoidSkin).unwrap();
        assert!((found.sizes - Vector3::repeat(0.245)).norm() < 8e-3, "{}", found.sizes);
    }
}
