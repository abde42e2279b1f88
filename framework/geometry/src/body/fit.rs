//! Measurements of a body by voxels: faces on the skin of parts, and axes of parts that must lie inside.
//!
//! 1. Each face of the voxels is assigned to the part with the least Mahalanobis distance [Mikić 2001 §4], for faces
//!    with about the normal of the skin there. A face without a part
//!    nearby is left out (shadows, ghost volumes, chairs).
//! 2. Its distance from that part's skin is a residual, weighted down where it is large (D. Geman and D. McClure's
//!    function, (1 + r²/c²)⁻²), more so outside: a hull of few views bulges, but
//!    never lies inside the true body.
//! 3. The axis of each part must lie as deep inside the voxels as the part is thick. Where it does not, the missing
//!    depth is a residual too, along the gradient of the depths: this recovers
//!    a part that has left the voxels altogether, which no face can do.
//!
//! Errors of a hull are correlated over a hand's width, so a face counts by its area beside [`FitOptions::patch`]²:
//! voxels half as large do not give four times the information.

use nalgebra::{Point3, SMatrix, UnitQuaternion, Vector3};

use super::field::VoxelField;
use super::filter::{BodyFilter, Matrix9, Normal, Vector9};
use super::layout::Layout;
use super::model::Body;
use super::parts::{N_PARTS, Part};
use super::proportions::{Limits, Proportions, STANDING_SPREAD, share};
use super::solid::{skin, taper};

/// Options of the comparison of voxels with a body.
#[derive(Debug, Clone, PartialEq)]
pub struct FitOptions {
    /// Standard deviation of a face's distance from the skin, besides that of the voxel size [m]: hulls, clothes, bodies that are not cylinders.
    pub sigma: f64,
    /// Correlation length of the errors of faces [m].
    pub patch: f64,
    /// Largest distance of a face from its part [m].
    pub gate: f64,
    /// A face outside the skin gets half weight at this distance [m].
    pub soft_outside: f64,
    /// A face inside the skin gets half weight at this distance [m].
    pub soft_inside: f64,
    /// Penalty on a face with the opposite normal, in squared standard deviations [–].
    pub turned: f64,
    /// Standard deviation of the depth of an axis [m].
    pub depth_sigma: f64,
    /// Most faces in use; of more, every second, third, … [–].
    pub most_faces: usize,
    /// Iterations within an update [–].
    pub iterations: usize,
}

impl Default for FitOptions {
    /// The distances of simulated people's hulls of four to eight views from their skins are 15 mm (rms) beside the voxels' own error.
    fn default() -> Self {
        Self {
            sigma: 0.015,
            patch: 0.07,
            gate: 0.13,
            soft_outside: 0.035,
            soft_inside: 0.08,
            turned: 16.0,
            depth_sigma: 0.015,
            most_faces: 2500,
            iterations: 4,
        }
    }
}

/// How well the voxels support a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Support {
    /// By part: share of its skin, as seen from all sides, with faces on it [–].
    pub covered: [f64; N_PARTS],
    /// By part: share of its axis inside the voxels [–].
    pub inside: [f64; N_PARTS],
    /// Share of all faces that belong to no part [–].
    pub unexplained: f64,
    /// Root mean square distance of faces from their part's skin [m].
    pub rms: f64,
    /// Cost of the fit: the negative logarithm of a likelihood, up to a constant for the voxels [–].
    pub cost: f64,
}

impl Default for Support {
    fn default() -> Self {
        Self { covered: [0.0; N_PARTS], inside: [0.0; N_PARTS], unexplained: 0.0, rms: 0.0, cost: 0.0 }
    }
}

/// A measured point on a part: an LED, a painted mark, a labelled point.
#[derive(Debug, Clone, PartialEq)]
pub struct Labelled {
    /// The part.
    pub part: Part,
    /// Position on it, as factors of the part's sizes [–].
    pub factors: Vector3<f64>,
    /// Measured position [m].
    pub position: Point3<f64>,
    /// Standard deviation, including that of its position on the body [m].
    pub sigma: f64,
}

/// Compares bodies with one field of voxels.
pub struct Fit<'a> {
    field: &'a VoxelField,
    options: &'a FitOptions,
    step: usize,
    /// Area that a used face represents [m²].
    area: f64,
    /// By used face: the part that it belongs to, or `None`.
    pub owners: Vec<Option<Part>>,
    /// Inverse squared deviations of the parts as predicted.
    scales: [f64; N_PARTS],
    /// Support by the voxels at the last equations.
    pub support: Support,
}

struct Placed {
    part: Part,
    centre: Point3<f64>,
    back: UnitQuaternion<f64>,
    sizes: Vector3<f64>,
    is_end: bool,
    reach: f64,
}

fn placed(body: &Body, layout: &Layout) -> Vec<Placed> {
    let centres = body.centres();
    layout
        .parts()
        .map(|part| {
            let sizes = *body.size(part);
            let is_end = !Part::ALL.iter().any(|it| it.parent() == Some(part) && layout.has(*it));
            Placed {
                part,
                centre: centres[part.index()],
                back: body.turn(part).inverse(),
                sizes,
                is_end,
                reach: sizes.norm(),
            }
        })
        .collect()
}

impl<'a> Fit<'a> {
    /// For the voxels of one frame. `predicted`: the prior covariance of each part decides to which part a face is assigned.
    pub fn new(field: &'a VoxelField, options: &'a FitOptions, predicted: Option<&BodyFilter>) -> Self {
        let step = field.faces().len().div_ceil(options.most_faces.max(1)).max(1);
        let mut fit = Self {
            field,
            options,
            step,
            area: field.size().powi(2) * step as f64 / 1.5,
            owners: Vec::new(),
            scales: [1.0; N_PARTS],
            support: Support::default(),
        };
        if let Some(filter) = predicted {
            for part in filter.layout().parts() {
                let covariance = filter.part_covariance(part);
                let arm = filter.body.size(part).z;
                // Of a place on the skin, on average over the part.
                let place = covariance.fixed_view::<3, 3>(0, 0).trace() / 3.0;
                let turn = covariance.fixed_view::<2, 2>(3, 3).trace() / 2.0 * arm * arm / 3.0;
                let own = fit.variance();
                // Not less than a quarter: what is hardly known would draw all to it.
                fit.scales[part.index()] = (own / (own + place + turn)).max(0.25);
            }
        }
        fit
    }

    fn variance(&self) -> f64 {
        // A skin lies anywhere between two centres.
        self.options.sigma.powi(2) + self.field.size().powi(2) / 12.0
    }

    /// Adds the equations of the voxels at `body`.
    pub fn measure(&mut self, body: &Body, normal: &mut Normal, layout: &Layout) {
        let parts = placed(body, layout);
        let options = self.options;
        let variance = self.variance();
        let weight = self.area / options.patch.powi(2) / variance;
        let mut information = [(Matrix9::zeros(), Vector9::zeros()); N_PARTS];
        let mut areas = [0.0; N_PARTS];
        let (mut n_used, mut n_free, mut squares, mut cost) = (0_usize, 0_usize, 0.0, 0.0);
        self.owners.clear();
        for face in self.field.faces().iter().step_by(self.step) {
            let mut best: Option<(f64, usize, super::solid::Skin, Vector3<f64>)> = None;
            for (number, at) in parts.iter().enumerate() {
                let away = face.position - at.centre;
                if away.norm_squared() > (at.reach + options.gate).powi(2) {
                    continue;
                }
                let point = at.back * away;
                let found = skin(at.part, &point, &at.sizes, at.is_end);
                if found.distance.abs() > options.gate && found.distance > 0.0 {
                    continue;
                }
                let cosine = found.normal.dot(&(at.back * face.normal));
                let cost = found.distance.powi(2) / variance * self.scales[at.part.index()]
                    + options.turned * (1.0 - cosine).powi(2) / 2.0;
                if cosine > -0.3 && best.as_ref().is_none_or(|it| cost < it.0) {
                    best = Some((cost, number, found, point));
                }
            }
            let Some((_, number, found, point)) = best else {
                n_free += 1;
                cost += weight * options.soft_outside.powi(2) / 2.0;
                self.owners.push(None);
                continue;
            };
            let at = &parts[number];
            self.owners.push(Some(at.part));
            let soft = if found.distance > 0.0 { options.soft_outside } else { options.soft_inside };
            let relative = (found.distance / soft).powi(2);
            let robust = (1.0 + relative).powi(-2);
            cost += weight * soft.powi(2) / 2.0 * relative / (1.0 + relative);
            n_used += 1;
            squares += found.distance.powi(2);
            areas[at.part.index()] += self.area * robust;
            let row = row(at, &found, &point);
            let (matrix, vector) = &mut information[at.part.index()];
            let w = weight * robust;
            let weighted = row * w;
            matrix.ger(1.0, &weighted, &row, 1.0);
            *vector += weighted * found.distance;
        }
        // From now on parts lie where faces have them.
        self.scales = [1.0; N_PARTS];
        self.support.unexplained = n_free as f64 / (n_free + n_used).max(1) as f64;
        self.support.rms = (squares / n_used.max(1) as f64).sqrt();
        self.support.cost = cost;
        for at in &parts {
            let i = at.part.index();
            self.support.covered[i] = areas[i] / skin_area(at.part, &at.sizes);
            self.support.inside[i] = self.contain(at, &mut information[i]);
            let (matrix, vector) = &information[i];
            normal.add_part(body, at.part, matrix, vector);
        }
    }

    /// The axis of a part should lie deep enough; gives the share of it that lies inside at all.
    fn contain(&mut self, at: &Placed, (matrix, vector): &mut (Matrix9, Vector9)) -> f64 {
        const PLACES: usize = 6;
        let options = self.options;
        let thick = at.sizes.x.min(at.sizes.y);
        let [low, high] = match at.part {
            Part::Torso => [-0.9, 0.8],
            Part::Head => [-0.3, 0.3],
            _ if at.is_end => [-1.0 + thick / at.sizes.z, 1.0],
            _ => [-1.0, 1.0],
        };
        let length = (high - low) * at.sizes.z;
        let weight = (length / PLACES as f64 / options.patch).min(1.0) / options.depth_sigma.powi(2);
        let forward = at.back.inverse();
        let mut n_inside = 0;
        for place in 0..PLACES {
            let t = low + (high - low) * (place as f64 + 0.5) / PLACES as f64;
            let reach = Vector3::new(0.0, 0.0, t * at.sizes.z);
            let place = at.centre + forward * reach;
            if self.field.is_beyond(&place) {
                continue;
            }
            let (depth, slope) = self.field.depth(&place);
            n_inside += usize::from(depth > -0.25 * self.field.size());
            // Depths of thin limbs in coarse voxels are too small by half a voxel now and then.
            let wanted = 0.75 * thick * (1.0 + taper(at.part) * t) - 0.3 * self.field.size();
            let missing = wanted.max(0.0) - depth;
            if missing <= 0.0 {
                continue;
            }
            let local = at.back * slope;
            let mut row = Vector9::zeros();
            row.fixed_rows_mut::<3>(0).copy_from(&-slope);
            // p = R reach: dp = −R [reach]× δ, so d(−depth) = slopeᵀ R [reach]× δ = (local × reach)ᵀ δ.
            row.fixed_rows_mut::<3>(3).copy_from(&local.cross(&reach));
            row[8] = -local.z * t;
            let missing = missing.min(0.25);
            let relative = (missing / SOFT_DEPTH).powi(2);
            self.support.cost += weight * SOFT_DEPTH.powi(2) / 2.0 * relative.ln_1p();
            let robust = (1.0 + relative).recip();
            matrix.ger(weight * robust, &row, &row, 1.0);
            *vector += row * (weight * robust * missing);
        }
        n_inside as f64 / PLACES as f64
    }
}

/// An axis that lacks so much of its depth counts half [m].
const SOFT_DEPTH: f64 = 0.08;

/// Derivative of a face's distance by (μ, δ, l).
fn row(at: &Placed, found: &super::solid::Skin, point: &Vector3<f64>) -> Vector9 {
    let mut row = Vector9::zeros();
    let outwards = at.back.inverse() * found.normal;
    row.fixed_rows_mut::<3>(0).copy_from(&-outwards);
    // p = Rᵀ(x − μ) becomes p + p × δ, so d = nᵀ(p × δ) = (n × p)ᵀ δ.
    row.fixed_rows_mut::<3>(3).copy_from(&found.normal.cross(point));
    row.fixed_rows_mut::<3>(6).copy_from(&found.by_sizes);
    row
}

/// The skins of a body's parts, for distance queries.
pub struct Skins(Vec<Placed>);

impl Skins {
    /// The skins of the parts in the model.
    pub fn of(body: &Body, layout: &Layout) -> Self {
        Self(placed(body, layout))
    }

    /// The skin of one part alone.
    pub fn only(mut self, part: Part) -> Self {
        self.0.retain(|it| it.part == part);
        self
    }

    /// All but these skins.
    pub fn without(mut self, parts: &[Part]) -> Self {
        self.0.retain(|it| !parts.contains(&it.part));
        self
    }

    /// Signed distance from the nearest skin, below 0 inside [m].
    pub fn distance(&self, place: &Point3<f64>) -> f64 {
        let mut nearest = f64::INFINITY;
        for at in &self.0 {
            let away = place - at.centre;
            // Not nearer than that, whatever its shape.
            if away.norm() - at.reach < nearest {
                nearest = nearest.min(skin(at.part, &(at.back * away), &at.sizes, at.is_end).distance);
            }
        }
        nearest
    }
}

/// Of a part, without what its neighbours hide [m²].
fn skin_area(part: Part, sizes: &Vector3<f64>) -> f64 {
    let pi = std::f64::consts::PI;
    match part {
        Part::Head => 4.0 * pi * (sizes.x * sizes.y * sizes.z).powf(2.0 / 3.0) * 0.85,
        // Side of an elliptic cylinder, of which arms and legs hide a fifth.
        Part::Torso => 2.0 * pi * ((sizes.x.powi(2) + sizes.y.powi(2)) / 2.0).sqrt() * 2.16 * sizes.z * 0.7,
        _ => 2.0 * pi * (sizes.x + sizes.y) / 2.0 * 2.0 * sizes.z * 0.85,
    }
}

/// Adds the equations of labelled points.
pub fn add_labelled(body: &Body, normal: &mut Normal, layout: &Layout, labelled: &[Labelled]) {
    for point in labelled.iter().filter(|it| layout.has(it.part)) {
        let r = body.turn(point.part).to_rotation_matrix();
        let reach = point.factors.component_mul(body.size(point.part));
        let mut jacobian = SMatrix::<f64, 3, 9>::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&-(r.matrix() * super::model::cross(&reach)));
        let stretch = r.matrix() * nalgebra::Matrix3::from_diagonal(&point.factors);
        jacobian.fixed_view_mut::<3, 3>(0, 6).copy_from(&stretch);
        let off = body.place(point.part, &point.factors) - point.position;
        let weight = point.sigma.powi(-2);
        let information = jacobian.transpose() * jacobian * weight;
        let gradient = jacobian.transpose() * off * weight;
        normal.add_part(body, point.part, &information, &gradient);
    }
}

/// Adds a row for each joint bent beyond its limit.
pub fn add_limits(body: &Body, normal: &mut Normal, layout: &Layout, limits: &Limits, facing_known: f64) {
    let weight = limits.sigma.powi(-2);
    let z = Vector3::z();
    // Between a direction of one part and one of another: `least` ≤ (Rₐ a)·(R_b b). d(Rₐ a) = −Rₐ [a]× δ, so the dot's derivative is a × (Rₐᵀ R_b b).
    let mut hold = |(first, a): (Part, Vector3<f64>), (second, b): (Part, Vector3<f64>), least: f64, weight: f64| {
        let (Some(at), Some(other)) = (layout.turn(first), layout.turn(second)) else { return };
        let (in_first, in_second) = (
            body.turn(first).inverse() * (body.turn(second) * b),
            body.turn(second).inverse() * (body.turn(first) * a),
        );
        let passed = least - a.dot(&in_first);
        if passed > 0.0 {
            normal.add_row(&[(at, -a.cross(&in_first)), (other, -b.cross(&in_second))], passed, weight);
        }
    };
    let front = Vector3::x();
    hold((Part::Head, z), (Part::Torso, z), limits.head_tilt.cos(), weight);
    for (upper, lower, is_leg, out) in [
        (Part::LeftUpperArm, Part::LeftLowerArm, false, 1.0),
        (Part::RightUpperArm, Part::RightLowerArm, false, -1.0),
        (Part::LeftThigh, Part::LeftCalf, true, 1.0),
        (Part::RightThigh, Part::RightCalf, true, -1.0),
    ] {
        hold((upper, z), (lower, z), limits.bend.cos(), weight);
        // −z points down the limb: not farther back than so.
        let back = if is_leg { limits.thigh_back } else { limits.arm_back };
        hold((upper, -z), (Part::Torso, front), -back.sin(), weight * facing_known);
        if is_leg {
            hold((upper, -z), (Part::Torso, Vector3::y() * out), -limits.thigh_across.sin(), weight);
            // The calf lies behind the line of the thigh: its upward direction is no farther back than the thigh's own front allows.
            let ahead = body.turn(upper).inverse() * (body.turn(Part::Torso) * front);
            let across = Vector3::new(ahead.x, ahead.y, 0.0);
            if let Some(across) = across.try_normalize(0.3) {
                hold((lower, z), (upper, across), -limits.knee_forward.sin(), weight * facing_known);
            }
        }
    }
}

/// Adds a row for each length that differs from the expectation for the stature by more than nearly all people's do:
/// hulls in which parts merge (sitting people) would let bodies shrink without end.
pub fn add_size_limits(body: &Body, normal: &mut Normal, layout: &Layout, proportions: &Proportions) {
    let spread = SIZE_SIGMAS * proportions.stature_spread.hypot(proportions.length_spread);
    for (part, expected) in Part::ALL.into_iter().zip(proportions.sizes()) {
        let (length, most) = (body.size(part).z, spread * expected.z);
        let passed = length - expected.z - (length - expected.z).clamp(-most, most);
        if passed != 0.0 {
            normal.add_row(&[(layout.size(part), Vector3::z())], passed, SIZE_SIGMA.powi(-2));
        }
    }
}

/// For a standing person, adds a row where the trunk's share of trunk and legs differs from nearly all people's: in
/// skirts and coats, legs do not part above the hem, and trunks would extend to there. For a standing person whose
/// legs do not show at all, the trunk is held within what this `stature` [m] gives for two people in three.
pub fn add_hip_limit(body: &Body, normal: &mut Normal, layout: &Layout, stature: Option<f64>) {
    const LEGS: [Part; 4] = [Part::LeftThigh, Part::RightThigh, Part::LeftCalf, Part::RightCalf];
    let both = |of: &dyn Fn(Part) -> f64| LEGS.into_iter().map(of).sum::<f64>() / 2.0;
    let (trunk, legs) = (body.size(Part::Torso).z, both(&|it| body.size(it).z));
    let (of_trunk, of_legs) = (share(Part::Torso).z, both(&|it| share(it).z));
    let mut hold = |off: f64, most: f64, to_legs: f64| {
        let passed = off - off.clamp(-most, most);
        if passed != 0.0 {
            let mut blocks = vec![(layout.size(Part::Torso), Vector3::z())];
            blocks.extend(LEGS.map(|it| (layout.size(it), Vector3::z() * (-to_legs / 2.0))));
            normal.add_row(&blocks, passed, SIZE_SIGMA.powi(-2));
        }
    };
    let to_legs = of_trunk / of_legs;
    hold(trunk - to_legs * legs, SIZE_SIGMAS * HIP_SPREAD * (trunk + legs), to_legs);
    if let Some(stature) = stature {
        let spread = (HIP_SPREAD * (of_trunk + of_legs)).hypot(STANDING_SPREAD * of_trunk);
        hold(trunk - of_trunk * stature, spread * stature, 0.0);
    }
}

/// How people differ in where the hips are between shoulders and soles, one standard deviation as a share of that [–]: sitting height is 0.52 of the stature, with a standard deviation of 0.014 [Frisancho 1990].
const HIP_SPREAD: f64 = 0.016;
/// Of 20 people one is farther off in one length [–].
const SIZE_SIGMAS: f64 = 2.0;
/// How soft that is [m].
const SIZE_SIGMA: f64 = 0.003;

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use nalgebra::DVector;

    use super::*;
    use crate::body::filter::Beginning;
    use crate::body::proportions::Proportions;

    fn some_body(seed: u64) -> Body {
        let mut random = Random::new(seed);
        let mut turn = || UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| random.normal()));
        Body {
            torso: Point3::new(0.1, 0.2, 1.2),
            turns: std::array::from_fn(|_| turn()),
            sizes: Proportions::default().sizes(),
        }
    }

    fn along(body: &Body, layout: &Layout, direction: &DVector<f64>, by: f64) -> Body {
        let mut other = body.clone();
        let vector = |at: usize| Vector3::new(direction[at], direction[at + 1], direction[at + 2]) * by;
        other.torso += vector(0);
        for part in Part::ALL {
            if let Some(at) = layout.turn(part) {
                other.turns[part.index()] *= UnitQuaternion::from_scaled_axis(vector(at));
            }
            other.sizes[part.index()] += vector(layout.size(part));
        }
        other
    }

    #[test]
    fn gradients_of_labelled_points_are_those_of_their_cost() {
        let layout = Layout::new(|_| true);
        let mut random = Random::new(5);
        let body = some_body(6);
        let labelled: Vec<Labelled> = Part::ALL
            .map(|part| Labelled {
                part,
                factors: Vector3::from_fn(|_, _| random.uniform_in(-1.0, 1.0)),
                position: Point3::from(Vector3::from_fn(|_, _| random.uniform_in(0.0, 1.5))),
                sigma: 0.1,
            })
            .to_vec();
        let cost = |body: &Body| {
            let off =
                |it: &Labelled| (body.place(it.part, &it.factors) - it.position).norm_squared() / it.sigma.powi(2);
            labelled.iter().map(off).sum::<f64>() / 2.0
        };
        let mut normal = Normal::new(layout);
        add_labelled(&body, &mut normal, &layout, &labelled);
        for _ in 0..5 {
            let direction = DVector::from_fn(layout.n_static(), |_, _| random.normal());
            let [ahead, behind] = [1e-6, -1e-6].map(|it| cost(&along(&body, &layout, &direction, it)));
            let slope = (ahead - behind) / 2e-6;
            assert!((slope - normal.vector.dot(&direction)).abs() < 1e-4 * (1.0 + slope.abs()), "{slope}");
        }
    }

    #[test]
    fn limits_act_only_where_they_are_passed_and_push_back() {
        let layout = Layout::new(|_| true);
        let mut body = some_body(1);
        body.turns = [UnitQuaternion::identity(); N_PARTS];
        let limits = Limits::default();
        let normal_of = |body: &Body| {
            let mut normal = Normal::new(layout);
            add_limits(body, &mut normal, &layout, &limits, 1.0);
            normal
        };
        assert_eq!(normal_of(&body).vector.amax(), 0.0);
        // A knee bent forwards: the foot goes to +x, the upward direction of the calf to −x.
        let bent = |angle: f64| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
        body.turns[Part::LeftCalf.index()] = bent(-0.6);
        let normal = normal_of(&body);
        let push = -normal.vector[layout.turn(Part::LeftCalf).unwrap() + 1];
        assert!(push > 0.0, "{push}");
        body.turns[Part::LeftCalf.index()] = bent(0.6);
        assert_eq!(normal_of(&body).vector.amax(), 0.0);
    }

    #[test]
    fn lengths_that_nearly_nobody_has_are_drawn_back_and_others_are_left_alone() {
        let layout = Layout::new(|_| true);
        let proportions = Proportions::default();
        let mut body = some_body(4);
        body.sizes[Part::LeftThigh.index()].z *= 0.85;
        let normal_of = |body: &Body| {
            let mut normal = Normal::new(layout);
            add_size_limits(body, &mut normal, &layout, &proportions);
            normal
        };
        assert_eq!(normal_of(&body).vector.amax(), 0.0);
        for (factor, sign) in [(0.6, 1.0), (1.4, -1.0)] {
            body.sizes[Part::LeftThigh.index()].z = proportions.sizes()[Part::LeftThigh.index()].z * factor;
            let normal = normal_of(&body);
            let at = layout.size(Part::LeftThigh) + 2;
            assert!(-normal.vector[at] * sign > 0.0 && normal.vector.iter().filter(|it| **it != 0.0).count() == 1);
        }
    }

    #[test]
    fn trunks_end_where_those_of_people_do_beside_their_legs_and_their_stature() {
        let proportions = Proportions::default();
        let layout = Layout::new(|_| true);
        let mut body = Body { sizes: proportions.sizes(), ..some_body(4) };
        let pull = |body: &Body, stature: Option<f64>| {
            let mut normal = Normal::new(layout);
            add_hip_limit(body, &mut normal, &layout, stature);
            [Part::Torso, Part::LeftThigh, Part::RightCalf].map(|it| -normal.vector[layout.size(it) + 2])
        };
        assert_eq!([None, Some(1.7), Some(1.65)].map(|it| pull(&body, it)), [[0.0; 3]; 3]);
        let [torso, thigh, calf] = pull(&body, Some(1.4));
        assert!(torso < 0.0 && thigh == 0.0 && calf == 0.0, "{torso} {thigh} {calf}");
        for (factor, sign) in [(1.2, 1.0), (0.8, -1.0)] {
            body.sizes[Part::Torso.index()].z = proportions.sizes()[Part::Torso.index()].z * factor;
            let [torso, thigh, calf] = pull(&body, None).map(|it| it * sign);
            assert!(torso < 0.0 && thigh > 0.0 && calf > 0.0, "{factor}: {torso} {thigh} {calf}");
        }
    }

    #[test]
    fn rows_and_columns_come_and_go_without_a_trace_on_the_rest() {
        let proportions = Proportions::default();
        let all = Layout::new(|_| true);
        let mut filter = BodyFilter::new(some_body(2), all, &proportions.covariance(), &Beginning::default());
        filter.rates[Part::LeftCalf.index()] = Vector3::new(1.0, 2.0, 3.0);
        filter.predict(0.1, &Default::default());
        let (before, n) = (filter.clone(), filter.covariance().nrows());
        let some = Layout::new(|it| it != Part::LeftCalf);
        filter.set_parts(some, &before.body, &Beginning::default());
        assert_eq!(filter.covariance().nrows(), n - 6);
        let size = |filter: &BodyFilter| {
            let at = filter.layout().size(Part::LeftCalf);
            filter.covariance().fixed_view::<3, 3>(at, at).into_owned()
        };
        assert_eq!(size(&filter), size(&before));
        filter.set_parts(all, &before.body, &Beginning::default());
        for part in Part::ALL.into_iter().filter(|it| *it != Part::LeftCalf) {
            assert!((filter.part_covariance(part) - before.part_covariance(part)).norm() < 1e-12, "{}", part.name());
        }
        assert_eq!(filter.rates[Part::LeftCalf.index()], Vector3::zeros());
    }
}
