//! The extended Kalman filter of a body [Mikić 2001 §4]: state, prediction, and update by measurements of the parts.
//!
//! | block | numbers | meaning | unit |
//! |---|---|---|---|
//! | place | 3 | μ₀ | m |
//! | turns | 3 a part in the model | δ of Rᵢ ⊕ δ = Rᵢ exp(δ) | rad |
//! | sizes | 30 | lᵢ of all parts, in the model or not: the length of a limb stays known while it is hidden | m |
//! | velocity | 3 | of μ₀ | m/s |
//! | rates | 3 a part in the model | ωᵢ in the part's axes: beyond the paper, which predicts the torso only | rad/s |
//!
//! Rows and columns of parts are added and removed ([`BodyFilter::set_parts`], §6 of the paper). Velocities decay with
//! a time constant, since no limb turns the same way for long
//! (R. A. Singer, "Estimating optimal tracking filter performance for manned maneuvering targets", IEEE AES 6(4),
//! 1970, with velocity in place of acceleration).
//!
//! Measurements of a part (voxel faces, moments, labelled points) enter as information about nine numbers, (μᵢ, δᵢ,
//! lᵢ), and are carried to the state with the chain's sparse Jacobian. No measurement depends on velocities, so the
//! update solves for place, turns and sizes (a), iterated about its own result, and updates velocities (b) by
//! correlation: with G = P_ba P_aa⁻¹, x_b += G Δx_a and P_bb −= G (P_aa⁻ − P_aa⁺) Gᵀ, which equals the update of all.

use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Point3, SMatrix, SVector, UnitQuaternion, Vector3};

use super::layout::{Layout, N_SIZES, Presence};
use super::model::{Body, Chain, cross};
use super::parts::{Joint, N_PARTS, Part};

/// Information about (μᵢ, δᵢ, lᵢ) of a part.
pub type Matrix9 = SMatrix<f64, 9, 9>;
/// A row vector over (μᵢ, δᵢ, lᵢ).
pub type Vector9 = SVector<f64, 9>;

/// Motion model of a body.
#[derive(Debug, Clone, PartialEq)]
pub struct MotionOptions {
    /// Time after which a velocity has decayed to 1/e [s].
    pub memory_s: f64,
    /// Density of the white acceleration of the torso [m²/s³].
    pub torso_acceleration: f64,
    /// Density of the white angular acceleration of torso and head [rad²/s³].
    pub trunk_turning: f64,
    /// The same for upper arms and thighs [rad²/s³].
    pub upper_turning: f64,
    /// The same for lower arms and calves [rad²/s³].
    pub lower_turning: f64,
    /// Random walk of sizes [m²/s]: errors of a hull persist as long as a pose, so that its frames are not independent measurements of one size.
    pub size_drift: f64,
}

impl Default for MotionOptions {
    /// A walking person's torso accelerates by about 2 m/s² for 0.25 s: 1 m²/s³. Limbs of walkers reach 40 rad/s² for 0.2 s, of fast actions 120: 300 to 3000 rad²/s³; lower arms twice the
    /// upper ones. Sizes drift by 3 mm in a second.
    fn default() -> Self {
        Self {
            memory_s: 0.25,
            torso_acceleration: 4.0,
            trunk_turning: 60.0,
            upper_turning: 600.0,
            lower_turning: 1200.0,
            size_drift: 1e-5,
        }
    }
}

/// State of a body with velocities and covariance.
#[derive(Debug, Clone)]
pub struct BodyFilter {
    /// Estimated posture and sizes; turns of parts that are not in the model are a guess.
    pub body: Body,
    /// Velocity of the torso [m/s].
    pub velocity: Vector3<f64>,
    /// Angular velocities, each in its part's axes [rad/s].
    pub rates: [Vector3<f64>; N_PARTS],
    pub(super) layout: Layout,
    pub(super) covariance: DMatrix<f64>,
}

/// Standard deviations of a new state.
#[derive(Debug, Clone, PartialEq)]
pub struct Beginning {
    /// Position of the torso [m].
    pub place: f64,
    /// Turn of a part [rad].
    pub turn: f64,
    /// Velocity of the torso [m/s].
    pub velocity: f64,
    /// Angular velocity of a part [rad/s].
    pub rate: f64,
}

impl Default for Beginning {
    /// Acquisition finds parts within a hand's width; people walk at 1 m/s and their limbs turn at 2 rad/s.
    fn default() -> Self {
        Self { place: 0.08, turn: 0.4, velocity: 0.7, rate: 2.0 }
    }
}

/// Normal equations of an update: H Δ = −g.
#[derive(Debug, Clone)]
pub struct Normal {
    layout: Layout,
    /// H = Σ JᵀWJ.
    pub matrix: DMatrix<f64>,
    /// g = Σ JᵀWr.
    pub vector: DVector<f64>,
}

impl Normal {
    /// Empty equations, without measurements.
    pub fn new(layout: Layout) -> Self {
        let n = layout.n_static();
        Self { layout, matrix: DMatrix::zeros(n, n), vector: DVector::zeros(n) }
    }

    /// Adds information about (μᵢ, δᵢ, lᵢ): `information` is Σ w hᵀh and `gradient` Σ w hᵀr, for residuals r with derivatives h at `body`.
    pub fn add_part(&mut self, body: &Body, part: Part, information: &Matrix9, gradient: &Vector9) {
        let blocks = part_blocks(body, &self.layout, part);
        for (at, block) in blocks.iter() {
            let by = block.transpose() * gradient;
            for row in 0..3 {
                self.vector[at + row] += by[row];
            }
            let weighted = information * block;
            for (other, other_block) in blocks.iter() {
                let product = other_block.transpose() * weighted;
                let mut view = self.matrix.fixed_view_mut::<3, 3>(*other, *at);
                view += product;
            }
        }
    }

    /// Adds one residual that depends on three numbers each at `blocks`, weighted by `weight` = 1/σ².
    pub fn add_row(&mut self, blocks: &[(usize, Vector3<f64>)], residual: f64, weight: f64) {
        for (at, by) in blocks {
            for row in 0..3 {
                self.vector[at + row] += weight * residual * by[row];
            }
            for (other, other_by) in blocks {
                let mut view = self.matrix.fixed_view_mut::<3, 3>(*other, *at);
                view += other_by * by.transpose() * weight;
            }
        }
    }
}

/// The derivative of (μᵢ, δᵢ, lᵢ) by the state, as blocks of three columns; a column may come twice, and adds.
fn part_blocks(body: &Body, layout: &Layout, part: Part) -> Vec<(usize, SMatrix<f64, 9, 3>)> {
    let on = |row: usize, block: Matrix3<f64>| {
        let mut whole = SMatrix::<f64, 9, 3>::zeros();
        whole.fixed_view_mut::<3, 3>(row, 0).copy_from(&block);
        whole
    };
    let mut blocks = vec![(0, on(0, Matrix3::identity()))];
    for (link, factors) in Chain::to(part).links() {
        let r = body.turn(*link).to_rotation_matrix();
        if let Some(at) = layout.turn(*link) {
            let reach = factors.component_mul(body.size(*link));
            let mut block = on(0, -(r.matrix() * cross(&reach)));
            if *link == part {
                block.fixed_view_mut::<3, 3>(3, 0).fill_with_identity();
            }
            blocks.push((at, block));
        }
        let mut block = on(0, r.matrix() * Matrix3::from_diagonal(factors));
        if *link == part {
            block.fixed_view_mut::<3, 3>(6, 0).fill_with_identity();
        }
        blocks.push((layout.size(*link), block));
    }
    blocks
}

/// A filter step, as the smoother needs it.
#[derive(Debug, Clone)]
pub struct Step {
    /// State predicted from the step before.
    pub predicted: BodyFilter,
    /// F: derivative of the prediction by the state before; `None` where parts were added or removed in between, or at the start.
    pub transition: Option<DMatrix<f64>>,
    /// State after the update.
    pub filtered: BodyFilter,
}

impl BodyFilter {
    /// A filter for a body with these parts, its sizes with the covariance `sizes_covariance`.
    pub fn new(body: Body, layout: Layout, sizes_covariance: &DMatrix<f64>, beginning: &Beginning) -> Self {
        let n = layout.n();
        let mut covariance = DMatrix::zeros(n, n);
        covariance.fixed_view_mut::<3, 3>(0, 0).fill_diagonal(beginning.place.powi(2));
        let sizes = layout.size(Part::Torso);
        covariance.view_mut((sizes, sizes), (N_SIZES, N_SIZES)).copy_from(sizes_covariance);
        covariance
            .fixed_view_mut::<3, 3>(layout.velocity(), layout.velocity())
            .fill_diagonal(beginning.velocity.powi(2));
        let mut filter =
            Self { body, velocity: Vector3::zeros(), rates: [Vector3::zeros(); N_PARTS], layout, covariance };
        for part in Part::ALL {
            filter.begin(part, beginning);
        }
        filter
    }

    /// Adds what is unknown of a part that turns by itself from now on.
    fn begin(&mut self, part: Part, beginning: &Beginning) {
        if !self.layout.is_own(part) {
            return;
        }
        for (at, sigma) in [(self.layout.turn(part), beginning.turn), (self.layout.rate(part), beginning.rate)] {
            let Some(at) = at else { continue };
            (at..at + 3).for_each(|it| self.covariance[(it, it)] += sigma.powi(2));
        }
    }

    /// Resets the sizes of a part to `sizes` with standard deviations `sigmas` [m].
    pub fn forget_sizes(&mut self, part: Part, sizes: &Vector3<f64>, sigmas: &Vector3<f64>) {
        self.body.sizes[part.index()] = *sizes;
        for axis in 0..3 {
            let at = self.layout.size(part) + axis;
            self.covariance.row_mut(at).fill(0.0);
            self.covariance.column_mut(at).fill(0.0);
            self.covariance[(at, at)] = sigmas[axis].powi(2);
        }
    }

    /// Layout of the state's blocks.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Covariance of the whole state, in the order of the layout.
    pub fn covariance(&self) -> &DMatrix<f64> {
        &self.covariance
    }

    /// Adds or removes parts: rows and columns of state and covariance follow. `body` has the turns of new ones.
    pub fn set_parts(&mut self, layout: Layout, body: &Body, beginning: &Beginning) {
        let before = std::mem::replace(&mut self.layout, layout);
        let old = std::mem::replace(&mut self.covariance, DMatrix::zeros(layout.n(), layout.n()));
        // Where each block of three was.
        let mut from: Vec<(usize, usize)> = vec![(0, 0), (layout.velocity(), before.velocity())];
        for part in Part::ALL {
            from.push((layout.size(part), before.size(part)));
            // A slot that is shared is its owner's.
            if layout.is_own(part) {
                from.extend(layout.turn(part).zip(before.turn(part)));
                from.extend(layout.rate(part).zip(before.rate(part)));
            }
        }
        for (to, was) in &from {
            for (other, other_was) in &from {
                let block = old.fixed_view::<3, 3>(*was, *other_was);
                self.covariance.fixed_view_mut::<3, 3>(*to, *other).copy_from(&block);
            }
        }
        for part in Part::ALL {
            match (layout.presence(part), before.presence(part)) {
                (Presence::Own, Presence::Absent) => {
                    self.body.turns[part.index()] = body.turns[part.index()];
                    self.rates[part.index()] = Vector3::zeros();
                    self.begin(part, beginning);
                }
                // It goes on from its parent, with which it has turned so far.
                (Presence::Own, Presence::Tied) => self.begin(part, beginning),
                _ => {}
            }
        }
        self.tie();
    }

    /// What is tied turns as its parent does.
    fn tie(&mut self) {
        for part in Part::ALL {
            if let (Presence::Tied, Some(parent)) = (self.layout.presence(part), part.parent()) {
                self.body.turns[part.index()] = self.body.turns[parent.index()];
                self.rates[part.index()] = self.rates[parent.index()];
            }
        }
    }

    /// Resets the turns of parts that were found elsewhere to those of `body`, with the covariance of a new state.
    pub fn replace(&mut self, parts: &[Part], body: &Body, beginning: &Beginning) {
        let before = self.layout;
        let with = Layout::of(|it| if parts.contains(&it) { Presence::Own } else { before.presence(it) });
        let without = Layout::of(|it| if parts.contains(&it) { Presence::Absent } else { before.presence(it) });
        self.set_parts(without, body, beginning);
        self.set_parts(with, body, beginning);
    }

    /// Predicts the state `dt_s` ahead [s] and returns F; `None`, without effect, for a time that is not above 0.
    pub fn predict(&mut self, dt_s: f64, options: &MotionOptions) -> Option<DMatrix<f64>> {
        if !(dt_s > 0.0 && dt_s.is_finite()) {
            return None;
        }
        let layout = self.layout;
        let n = layout.n();
        let kept = (-dt_s / options.memory_s).exp();
        let carried = options.memory_s * (1.0 - kept);
        let mut transition = DMatrix::identity(n, n);
        let mut noise: Vec<(usize, usize, f64)> = vec![(0, layout.velocity(), options.torso_acceleration)];
        self.body.torso += self.velocity * carried;
        self.velocity *= kept;
        transition.fixed_view_mut::<3, 3>(0, layout.velocity()).fill_diagonal(carried);
        transition.fixed_view_mut::<3, 3>(layout.velocity(), layout.velocity()).fill_diagonal(kept);
        for part in layout.parts().filter(|it| layout.is_own(*it)) {
            let (Some(turn), Some(rate)) = (layout.turn(part), layout.rate(part)) else { continue };
            let step = UnitQuaternion::from_scaled_axis(self.rates[part.index()] * carried);
            self.body.turns[part.index()] *= step;
            self.body.turns[part.index()].renormalize();
            self.rates[part.index()] *= kept;
            // exp(δ′) = exp(−s) exp(δ) exp(s + δω t) to first order.
            transition.fixed_view_mut::<3, 3>(turn, turn).copy_from(step.inverse().to_rotation_matrix().matrix());
            transition.fixed_view_mut::<3, 3>(turn, rate).fill_diagonal(carried);
            transition.fixed_view_mut::<3, 3>(rate, rate).fill_diagonal(kept);
            let density = match part {
                Part::Torso | Part::Head => options.trunk_turning,
                _ if part.parent() == Some(Part::Torso) => options.upper_turning,
                _ => options.lower_turning,
            };
            noise.push((turn, rate, density));
        }
        self.tie();
        self.covariance = &transition * &self.covariance * transition.transpose();
        for (position, velocity, density) in noise {
            for axis in 0..3 {
                let (p, v) = (position + axis, velocity + axis);
                self.covariance[(p, p)] += density * dt_s.powi(3) / 3.0;
                self.covariance[(p, v)] += density * dt_s.powi(2) / 2.0;
                self.covariance[(v, p)] += density * dt_s.powi(2) / 2.0;
                self.covariance[(v, v)] += density * dt_s;
            }
        }
        let sizes = layout.size(Part::Torso);
        (sizes..sizes + N_SIZES).for_each(|it| self.covariance[(it, it)] += options.size_drift * dt_s);
        self.make_symmetric();
        Some(transition)
    }

    pub(super) fn make_symmetric(&mut self) {
        let n = self.covariance.nrows();
        for row in 0..n {
            for column in 0..row {
                let mean = (self.covariance[(row, column)] + self.covariance[(column, row)]) / 2.0;
                self.covariance[(row, column)] = mean;
                self.covariance[(column, row)] = mean;
            }
        }
    }

    /// Updates with measurements: `measure` adds the normal equations at a body (first the predicted one, then each
    /// better one). Returns `false`, without effect, when the equations have no solution.
    ///
    /// Sizes take only a `share` of the measured correction, from 0 to 1 (K. Brink, "Partial-update Schmidt–Kalman
    /// filter", Journal of Guidance, Control, and Dynamics 40(9), 2017, with γ² = 1 − share): errors of hulls persist
    /// as long as a pose, so that many frames say no more of a size than a few poses.
    pub fn update(&mut self, iterations: usize, share: f64, mut measure: impl FnMut(&Body, &mut Normal)) -> bool {
        let layout = self.layout;
        let n = layout.n_static();
        let prior: DMatrix<f64> = self.covariance.view((0, 0), (n, n)).into_owned();
        let Some(factor) = prior.clone().cholesky() else { return false };
        let information = factor.inverse();
        let mut body = self.body.clone();
        let mut posterior = None;
        for _ in 0..iterations.max(1) {
            let mut normal = Normal::new(layout);
            measure(&body, &mut normal);
            let away = difference(&body, &self.body, &layout);
            let gradient = normal.vector + &information * away;
            let Some(factor) = (normal.matrix + &information).cholesky() else { return false };
            let step = -factor.solve(&gradient);
            if !step.iter().all(|it| it.is_finite()) {
                return false;
            }
            // Beyond half a radian or 0.3 m nothing is linear: the whole step is shortened.
            let longest = (0..3)
                .map(|it| step[it].abs() / 0.3)
                .chain((3..layout.size(Part::Torso)).map(|it| step[it].abs() / 0.5));
            let scale = 1.0 / longest.fold(1.0, f64::max);
            body = moved(&body, &(&step * scale), &layout);
            posterior = Some(factor);
            if step.amax() < 1e-4 {
                break;
            }
        }
        let Some(factor) = posterior else { return false };
        let mut after = factor.inverse();
        let change = difference(&body, &self.body, &layout);
        let n_rest = layout.n() - n;
        let gain = self.covariance.view((n, 0), (n_rest, n)) * &information;
        let rest = &gain * change;
        self.velocity += rest.fixed_rows::<3>(0);
        for part in layout.parts() {
            if let Some(at) = layout.rate(part) {
                self.rates[part.index()] += rest.fixed_rows::<3>(at - n);
            }
        }
        let lower = &gain * (&after - &prior) * gain.transpose();
        let cross_term = &gain * &after;
        // γ of a limb's sizes is the root of what is kept of their covariance; of all else it is 0.
        let kept = (1.0 - share).max(0.0).sqrt();
        let slow: Vec<(Part, usize)> =
            Part::ALL.into_iter().filter(|it| it.is_limb()).flat_map(|it| (0..3).map(move |axis| (it, axis))).collect();
        let at = |(part, axis): (Part, usize)| layout.size(part) + axis;
        for &(part, axis) in &slow {
            let size = &mut body.sizes[part.index()][axis];
            *size += (self.body.size(part)[axis] - *size) * kept;
        }
        for &one in &slow {
            for &other in &slow {
                let place = (at(one), at(other));
                after[place] += (prior[place] - after[place]) * kept * kept;
            }
        }
        self.covariance.view_mut((0, 0), (n, n)).copy_from(&after);
        self.covariance.view_mut((n, 0), (n_rest, n)).copy_from(&cross_term);
        self.covariance.view_mut((0, n), (n, n_rest)).copy_from(&cross_term.transpose());
        let mut corner = self.covariance.view_mut((n, n), (n_rest, n_rest));
        corner += lower;
        self.make_symmetric();
        self.body = body;
        true
    }

    /// Covariance of (μᵢ, δᵢ, lᵢ) of a part.
    pub fn part_covariance(&self, part: Part) -> Matrix9 {
        let blocks = part_blocks(&self.body, &self.layout, part);
        let mut sum = Matrix9::zeros();
        for (at, block) in &blocks {
            for (other, other_block) in &blocks {
                sum += block * self.covariance.fixed_view::<3, 3>(*at, *other) * other_block.transpose();
            }
        }
        sum
    }

    /// Position, velocity and their covariance of a place on a part, given as factors of its sizes [m, m/s].
    pub fn place(&self, part: Part, factors: &Vector3<f64>) -> (Point3<f64>, Vector3<f64>, Matrix6<f64>) {
        // Derivatives of the position by the static state, and the same of the velocity by velocities: p = μ₀ + Σ R k l, v = v₀ + Σ R (ω × k l).
        let mut links: Vec<(Part, Vector3<f64>)> = Chain::to(part).links().to_vec();
        if let Some(last) = links.last_mut() {
            last.1 += factors;
        }
        let n = self.layout.n();
        let mut by_state = DMatrix::zeros(6, n);
        by_state.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        by_state.fixed_view_mut::<3, 3>(3, self.layout.velocity()).fill_with_identity();
        let (mut position, mut velocity) = (self.body.torso, self.velocity);
        for (link, factors) in links {
            let r = self.body.turn(link).to_rotation_matrix();
            let reach = factors.component_mul(self.body.size(link));
            let swing = -(r.matrix() * cross(&reach));
            position += r * reach;
            let turning = self.rates[link.index()].cross(&reach);
            velocity += r * turning;
            if let (Some(turn), Some(rate)) = (self.layout.turn(link), self.layout.rate(link)) {
                // Parts that are tied share their columns.
                let mut add = |row: usize, at: usize, block: Matrix3<f64>| {
                    let mut view = by_state.fixed_view_mut::<3, 3>(row, at);
                    view += block;
                };
                add(0, turn, swing);
                add(3, rate, swing);
                add(3, turn, -(r.matrix() * cross(&turning)));
            }
            let stretch = r.matrix() * Matrix3::from_diagonal(&factors);
            let size = self.layout.size(link);
            by_state.fixed_view_mut::<3, 3>(0, size).copy_from(&stretch);
            let spin = r.matrix() * cross(&self.rates[link.index()]) * Matrix3::from_diagonal(&factors);
            by_state.fixed_view_mut::<3, 3>(3, size).copy_from(&spin);
        }
        let covariance = &by_state * &self.covariance * by_state.transpose();
        let covariance = Matrix6::from_fn(|row, column| (covariance[(row, column)] + covariance[(column, row)]) / 2.0);
        (position, velocity, covariance)
    }

    /// Position, velocity and their covariance of a joint [m, m/s].
    pub fn joint(&self, joint: Joint) -> (Point3<f64>, Vector3<f64>, Matrix6<f64>) {
        let (part, factors) = self.body.place_of(joint);
        let (position, velocity, mut covariance) = self.place(part, &factors);
        if joint == Joint::Neck {
            let sigma = HEAD_LEVEL * self.body.size(Part::Head).z;
            (0..3).for_each(|it| covariance[(it, it)] += sigma.powi(2));
        }
        (position, velocity, covariance)
    }

    /// Exchanges left and right, and front and back, in state, covariance and velocities.
    pub fn face_about(&mut self) {
        let about = Vector3::new(-1.0, -1.0, 1.0);
        let before = self.layout;
        let layout = Layout::of(|part| before.presence(part.mirrored()));
        let mut from: Vec<(usize, usize, Vector3<f64>)> =
            vec![(0, 0, Vector3::repeat(1.0)), (layout.velocity(), before.velocity(), Vector3::repeat(1.0))];
        for part in Part::ALL {
            let other = part.mirrored();
            from.push((layout.size(part), before.size(other), Vector3::repeat(1.0)));
            from.extend(layout.turn(part).zip(before.turn(other)).map(|(to, was)| (to, was, about)));
            from.extend(layout.rate(part).zip(before.rate(other)).map(|(to, was)| (to, was, about)));
        }
        let mut covariance = DMatrix::zeros(layout.n(), layout.n());
        for (to, was, signs) in &from {
            for (other, other_was, other_signs) in &from {
                let block = self.covariance.fixed_view::<3, 3>(*was, *other_was).into_owned();
                let signed = block.component_mul(&(signs * other_signs.transpose()));
                covariance.fixed_view_mut::<3, 3>(*to, *other).copy_from(&signed);
            }
        }
        self.covariance = covariance;
        self.body = self.body.faced_about();
        let rates = self.rates;
        for part in Part::ALL {
            self.rates[part.index()] = rates[part.mirrored().index()].component_mul(&about);
        }
        self.layout = layout;
    }
}

/// How far heads are from level, one standard deviation [rad]: 15°.
const HEAD_LEVEL: f64 = 0.26;

/// `body` ⊖ `from`.
pub(super) fn difference(body: &Body, from: &Body, layout: &Layout) -> DVector<f64> {
    let mut difference = DVector::zeros(layout.n_static());
    difference.fixed_rows_mut::<3>(0).copy_from(&(body.torso - from.torso));
    for part in Part::ALL {
        let i = part.index();
        if let Some(at) = layout.turn(part) {
            let turn = from.turns[i].inverse() * body.turns[i];
            difference.fixed_rows_mut::<3>(at).copy_from(&turn.scaled_axis());
        }
        difference.fixed_rows_mut::<3>(layout.size(part)).copy_from(&(body.sizes[i] - from.sizes[i]));
    }
    difference
}

/// No part is thinner or shorter than this [m].
const LEAST_SIZE: f64 = 0.01;

/// `body` ⊕ `step`.
pub(super) fn moved(body: &Body, step: &DVector<f64>, layout: &Layout) -> Body {
    let vector = |at: usize| Vector3::new(step[at], step[at + 1], step[at + 2]);
    let mut other = body.clone();
    other.torso += vector(0);
    for part in Part::ALL {
        let i = part.index();
        if let Some(at) = layout.turn(part) {
            other.turns[i] *= UnitQuaternion::from_scaled_axis(vector(at));
            other.turns[i].renormalize();
        }
        other.sizes[i] = (other.sizes[i] + vector(layout.size(part))).map(|it| it.max(LEAST_SIZE));
    }
    other
}
