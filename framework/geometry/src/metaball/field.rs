//! Metaballs on segments, their field, and its derivatives.
//!
//! The field is (8) with w₀ = 1: F = Σ exp(−2 dᵢ), and the surface is where F = w_t = 0.5 (15). We work with D = −½ ln F, which is dᵢ itself where one ball is alone and blends as F
//! does, and with its root u = √D: for a sphere of effective radius L, u = |x| / L, so that (u − u₀) / |∇u| is the distance from the surface exactly, and for other shapes to first order (G. Taubin,
//! "Estimation of planar curves, surfaces, and nonplanar space curves defined by implicit equations", TPAMI 13(11), 1991). F itself is flat far away, which slows the fit; u is not.
//!
//! The field of a point is summed over the balls of one segment and of those that are joined to it end to end, as the paper segments a body into limbs; the whole body is all limbs together.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::skeleton::{Columns, Posed, Skeleton, State};

/// Value of the field on the surface, w_t (15).
pub const THRESHOLD: f64 = 0.5;
/// √(−½ ln w_t): effective radii times this are the visible ones of a ball by itself, r_t of Figure 12.
pub const VISIBLE: f64 = 0.588_705_011_257_737_3;
/// What a ball adds to the field at D farther than the nearest one's by this is less than a part in 10¹⁴ [–].
const UNFELT: f64 = 16.2;
/// Below this D the root continues as a straight line: inside a body, where many balls overlap, D falls below 0.
const ROOT_FROM: f64 = 0.02;

/// An ellipsoidal metaball, fixed to a segment; only its radii ([`State::radii`]) change.
#[derive(Debug, Clone, PartialEq)]
pub struct Ball {
    /// Index of the segment that carries it.
    pub segment: usize,
    /// Its centre in the segment's space, where that has the template's length [m].
    pub centre: Vector3<f64>,
    /// Its principal axes in the segment's space.
    pub segment_from_ball: UnitQuaternion<f64>,
}

/// A body: a skeleton with metaballs.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Its segments and joints.
    pub skeleton: Skeleton,
    /// Its metaballs.
    pub balls: Vec<Ball>,
    /// By segment: its own balls.
    own: Vec<Vec<usize>>,
    /// By segment: the balls that make its field, its own and those of segments joined to it end to end.
    near: Vec<Vec<usize>>,
}

/// The field about one point, as D = −½ ln F.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldAt {
    /// D [–].
    pub d: f64,
    /// Gradient of D in the world [1/m].
    pub gradient: Vector3<f64>,
}

impl FieldAt {
    /// √D, and its derivative by D [–].
    pub fn root(&self) -> (f64, f64) {
        if self.d >= ROOT_FROM {
            let root = self.d.sqrt();
            return (root, 0.5 / root);
        }
        let root = ROOT_FROM.sqrt();
        (root + 0.5 * (self.d - ROOT_FROM) / root, 0.5 / root)
    }

    /// Signed distance from the surface to first order, positive outside [m]; limited to `most_m` where the gradient
    /// vanishes, such as in the middle of a ball.
    pub fn distance(&self, most_m: f64) -> f64 {
        let (root, by_d) = self.root();
        (root - VISIBLE) / (by_d * self.gradient.norm()).max(1.0 / most_m)
    }
}

/// One ball about one point.
struct Term {
    squared_distance: f64,
    /// By the point in the segment's space [1/m].
    gradient: Vector3<f64>,
    /// By the logarithm of each radius [–].
    by_radii: Vector3<f64>,
    /// By the logarithm of the segment's scale, the ball's centre moving along [–].
    by_scale: f64,
}

impl Ball {
    /// d of (7) and its derivatives, at a point in the segment's space.
    fn at(&self, point: &Point3<f64>, scale: f64, radii: &Vector3<f64>) -> Term {
        let centre = self.centre * scale;
        let along = self.segment_from_ball.inverse() * (point.coords - centre);
        let in_radii = along.component_div(radii);
        let gradient = self.segment_from_ball * (2.0 * in_radii.component_div(radii));
        Term {
            squared_distance: in_radii.norm_squared(), // (7)
            gradient,
            by_radii: -2.0 * in_radii.component_mul(&in_radii),
            by_scale: -gradient.dot(&centre),
        }
    }
}

impl Body {
    /// A body of metaballs on a skeleton.
    ///
    /// # Panics
    /// When a ball names a segment that does not exist.
    pub fn new(skeleton: Skeleton, balls: Vec<Ball>) -> Body {
        let n = skeleton.segments().len();
        assert!(balls.iter().all(|it| it.segment < n), "a ball on a segment that does not exist");
        // A limb that hangs beside its parent's bone, as arms and thighs do on the trunk, does not blend with it: thick balls would reach through an arm that hangs beside them, and make it thin.
        let hangs_on = |a: usize, b: usize| {
            let it = &skeleton.segments()[a];
            it.parent == Some(b) && it.joint_in_parent.xy().norm() == 0.0
        };
        let joined = |a: usize, b: usize| a == b || hangs_on(a, b) || hangs_on(b, a);
        let near = (0..n).map(|a| (0..balls.len()).filter(|b| joined(a, balls[*b].segment)).collect()).collect();
        let own = (0..n).map(|a| (0..balls.len()).filter(|b| balls[*b].segment == a).collect()).collect();
        Body { skeleton, balls, own, near }
    }

    /// The thickest ball's least radius: inside a body, where balls overlap, the field is taken to be no flatter than it is at the surface of that one [m].
    pub(super) fn thickness_m(&self, state: &State) -> f64 {
        state.radii.iter().map(|it| it.min()).fold(0.0, f64::max).max(1e-6)
    }

    /// The balls that make a segment's field, by number.
    pub(super) fn near(&self, segment: usize) -> &[usize] {
        &self.near[segment]
    }

    /// The field that one segment and its neighbours make at a point of the world; `None` where no ball is near it.
    pub fn field_of(&self, posed: &Posed, state: &State, segment: usize, point: &Point3<f64>) -> Option<FieldAt> {
        self.blend(posed, state, &self.near[segment], point)
    }

    /// The field of the whole body at a point of the world: that of the segment in which it lies deepest; `None` for a body without balls.
    pub fn field(&self, posed: &Posed, state: &State, point: &Point3<f64>) -> Option<FieldAt> {
        let term = |(number, ball): (usize, &Ball)| {
            let term = self.term(posed, state, ball, number, point);
            (term.squared_distance, posed.world_from_segment[ball.segment].rotation * term.gradient)
        };
        let terms: Vec<(f64, Vector3<f64>)> = self.balls.iter().enumerate().map(term).collect();
        let of = |near: &Vec<usize>| {
            let mut sum = Blend::default();
            near.iter().for_each(|it| sum.add(terms[*it].0, &terms[*it].1));
            sum.finish().map(|(d, gradient, weight)| FieldAt { d, gradient: gradient / weight })
        };
        self.near.iter().filter_map(of).min_by(|a, b| a.d.total_cmp(&b.d))
    }

    /// The segment with the nearest bone to a point, bones being as thick as the balls on them; only segments with
    /// balls. For a rough posture, where the field is far away.
    pub fn nearest_bone(&self, posed: &Posed, state: &State, point: &Point3<f64>) -> Option<usize> {
        let away = |segment: usize| {
            let local = posed.world_from_segment[segment].inverse_transform_point(point).coords;
            let bone = &self.skeleton.segments()[segment];
            let length = bone.length * state.scales[bone.scale];
            let own = self.balls.iter().zip(&state.radii).filter(|it| it.0.segment == segment);
            let (n, sum) = own.fold((0, 0.0), |(n, sum), it| (n + 1, sum + 0.5 * VISIBLE * (it.1.x + it.1.y)));
            let beside = local - Vector3::z() * local.z.clamp(0.0, length);
            (n > 0).then(|| (beside.norm() - sum / f64::from(n), segment))
        };
        let nearest = (0..self.near.len()).filter_map(away).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map(|it| it.1)
    }

    /// The segment in whose own balls a point lies deepest, or to which it is nearest, in metres.
    pub fn nearest_segment(&self, posed: &Posed, state: &State, point: &Point3<f64>) -> Option<usize> {
        let most_m = self.thickness_m(state);
        let away = |(segment, own): (usize, &Vec<usize>)| {
            Some((self.blend(posed, state, own, point)?.distance(most_m), segment))
        };
        let nearest = self.own.iter().enumerate().filter_map(away).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.map(|it| it.1)
    }

    fn term(&self, posed: &Posed, state: &State, ball: &Ball, number: usize, point: &Point3<f64>) -> Term {
        let local = posed.world_from_segment[ball.segment].inverse_transform_point(point);
        let scale = state.scales[self.skeleton.segments()[ball.segment].scale];
        ball.at(&local, scale, &state.radii[number])
    }

    pub(super) fn blend(&self, posed: &Posed, state: &State, balls: &[usize], point: &Point3<f64>) -> Option<FieldAt> {
        let mut sum = Blend::default();
        for &number in balls {
            let ball = &self.balls[number];
            let term = self.term(posed, state, ball, number, point);
            let gradient = posed.world_from_segment[ball.segment].rotation * term.gradient;
            sum.add(term.squared_distance, &gradient);
        }
        sum.finish().map(|(d, gradient, weight)| FieldAt { d, gradient: gradient / weight })
    }

    /// D of the field of `segment` at a point that rests in the world, and its derivatives by all parameters that it depends on, as (number of the parameter, derivative). `row` is
    /// emptied first; it may name a parameter more than once.
    pub(super) fn linearised(
        &self,
        posed: &Posed,
        state: &State,
        segment: usize,
        point: &Point3<f64>,
        row: &mut Vec<(usize, f64)>,
    ) -> Option<f64> {
        row.clear();
        let columns = Columns::of(state);
        let balls = &self.near[segment];
        let mut terms: Vec<Term> = Vec::with_capacity(balls.len());
        // Balls of a segment follow each other: the point in its space is that of the ball before.
        let mut local: Option<(usize, Point3<f64>)> = None;
        for &number in balls {
            let ball = &self.balls[number];
            let here = match local {
                Some((segment, here)) if segment == ball.segment => here,
                _ => posed.world_from_segment[ball.segment].inverse_transform_point(point),
            };
            local = Some((ball.segment, here));
            let scale = state.scales[self.skeleton.segments()[ball.segment].scale];
            terms.push(ball.at(&here, scale, &state.radii[number]));
        }
        let least = terms.iter().map(|it| it.squared_distance).fold(f64::INFINITY, f64::min);
        if !least.is_finite() {
            return None;
        }
        // wᵢ = exp(−2 dᵢ) / F, computed from the nearest ball on so that nothing underflows. Balls of a segment move together: their gradients are summed before the chain is walked.
        let mut sum = 0.0;
        let mut run: Option<(usize, Vector3<f64>)> = None;
        let walk = |(segment, gradient): (usize, Vector3<f64>), row: &mut Vec<(usize, f64)>| {
            self.skeleton
                .derivatives(posed, &columns, segment, point, |column, by| row.push((column, gradient.dot(&by))));
        };
        for (&number, term) in balls.iter().zip(&terms) {
            let ball = &self.balls[number];
            // Far balls of the same limb are felt, if little (§3.4.4); beyond this a number of the row would not change.
            if term.squared_distance - least > UNFELT {
                continue;
            }
            let weight = (-2.0 * (term.squared_distance - least)).exp();
            sum += weight;
            let gradient = weight * term.gradient;
            match &mut run {
                Some((segment, total)) if *segment == ball.segment => *total += gradient,
                _ => {
                    if let Some(done) = run.replace((ball.segment, gradient)) {
                        walk(done, row);
                    }
                }
            }
            row.push((columns.scale(self.skeleton.segments()[ball.segment].scale), weight * term.by_scale));
            for axis in 0..3 {
                row.push((columns.radius(number, axis), weight * term.by_radii[axis]));
            }
        }
        if let Some(done) = run {
            walk(done, row);
        }
        row.iter_mut().for_each(|it| it.1 /= sum);
        Some(least - 0.5 * sum.ln())
    }
}

/// Σ exp(−2 dᵢ) and a sum weighted with it, without underflow.
struct Blend {
    least: f64,
    weight: f64,
    total: Vector3<f64>,
}

impl Default for Blend {
    fn default() -> Self {
        Self { least: f64::INFINITY, weight: 0.0, total: Vector3::zeros() }
    }
}

impl Blend {
    fn add(&mut self, d: f64, gradient: &Vector3<f64>) {
        if d < self.least {
            let shrink = if self.least.is_finite() { (-2.0 * (self.least - d)).exp() } else { 0.0 };
            self.weight *= shrink;
            self.total *= shrink;
            self.least = d;
        }
        let weight = (-2.0 * (d - self.least)).exp();
        self.weight += weight;
        self.total += weight * gradient;
    }

    /// D, the weighted sum and the weights' sum.
    fn finish(self) -> Option<(f64, Vector3<f64>, f64)> {
        self.least.is_finite().then(|| (self.least - 0.5 * self.weight.ln(), self.total, self.weight))
    }
}
