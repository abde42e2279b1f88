//! A body of ten parts: positions of its parts and joints, and their derivatives by its state.
//!
//! [Mikić 2001 §4]: the state is the position of the torso, and of each part its turn and its sizes; all else follows along the kinematic chain (3).
//!
//! | here | paper | meaning | unit |
//! |---|---|---|---|
//! | [`Body::torso`] | μ₀ | middle of the torso | m |
//! | [`Body::turns`] | qᵢ, Rᵢ | maps the part's axes to the world's | – |
//! | [`Body::sizes`] | lᵢ | half the extent of a part along its axes | m |
//! | `Part::hangs_at`, `Part::held_at` | J₀₂, J₂₀ … | joints in a part's axes: diag(·) lᵢ, linear in the sizes | – |
//!
//! With these, (3) is a sum over the parts from the torso on: μᵢ = μ₀ + Σₐ Rₐ diag(kₐ) lₐ. So for R ⊕ δ = R exp(δ): ∂μᵢ/∂δₐ = −Rₐ [diag(kₐ) lₐ]×,
//! ∂μᵢ/∂lₐ = Rₐ diag(kₐ), and all other columns are zero: at most three parts of ten enter.

use nalgebra::{Matrix3, Point3, UnitQuaternion, Vector3};

use super::parts::{Joint, N_PARTS, Part};

/// A body's posture and sizes at one moment.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Centre of the torso [m].
    pub torso: Point3<f64>,
    /// Orientation of each part, `world_from_part`.
    pub turns: [UnitQuaternion<f64>; N_PARTS],
    /// Half sizes along x, y, z of each part [m].
    pub sizes: [Vector3<f64>; N_PARTS],
}

/// The kinematic chain from the torso to a part: which sizes enter its centre, with which factors; at most three parts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Chain {
    links: [(Part, Vector3<f64>); 3],
    count: usize,
}

impl Chain {
    /// The chain to the centre of `part`.
    pub fn to(part: Part) -> Self {
        let none = (Part::Torso, Vector3::zeros());
        match part.parent() {
            None => Chain { links: [none; 3], count: 1 },
            Some(parent) => {
                let mut chain = Chain::to(parent);
                chain.links[chain.count - 1].1 += part.hangs_at();
                chain.links[chain.count] = (part, -part.held_at());
                chain.count += 1;
                chain
            }
        }
    }

    /// The parts of the chain with their factors.
    pub fn links(&self) -> &[(Part, Vector3<f64>)] {
        &self.links[..self.count]
    }
}

/// The matrix [v]×: cross(a) b = a × b.
pub fn cross(v: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -v.z, v.y, v.z, 0.0, -v.x, -v.y, v.x, 0.0)
}

impl Body {
    /// Orientation of a part.
    pub fn turn(&self, part: Part) -> &UnitQuaternion<f64> {
        &self.turns[part.index()]
    }

    /// Half sizes of a part [m].
    pub fn size(&self, part: Part) -> &Vector3<f64> {
        &self.sizes[part.index()]
    }

    /// Equation (3): the centre of a part [m].
    pub fn centre(&self, part: Part) -> Point3<f64> {
        let reach = |(part, factors): &(Part, Vector3<f64>)| {
            self.turns[part.index()] * factors.component_mul(&self.sizes[part.index()])
        };
        self.torso + Chain::to(part).links().iter().map(reach).sum::<Vector3<f64>>()
    }

    /// The centres of all parts [m].
    pub fn centres(&self) -> [Point3<f64>; N_PARTS] {
        let mut centres = [self.torso; N_PARTS];
        for part in Part::ALL {
            if let Some(parent) = part.parent() {
                let [p, i] = [parent.index(), part.index()];
                let hangs = self.turns[p] * part.hangs_at().component_mul(&self.sizes[p]);
                let held = self.turns[i] * part.held_at().component_mul(&self.sizes[i]);
                centres[i] = centres[p] + hangs - held;
            }
        }
        centres
    }

    /// Position on a part, given as factors of its sizes [m].
    pub fn place(&self, part: Part, factors: &Vector3<f64>) -> Point3<f64> {
        self.centre(part) + self.turn(part) * factors.component_mul(self.size(part))
    }

    /// Position of a joint [m].
    pub fn joint(&self, joint: Joint) -> Point3<f64> {
        let (part, factors) = self.place_of(joint);
        self.place(part, &factors)
    }

    /// The part that carries a joint, and the joint's position there as factors of that part's sizes:
    /// [`Joint::place`], except for the neck. On the chain the head hangs on the torso's axis, and heads are held in
    /// front of it by more or less, which turns the head's part without turning the head. People hold their heads
    /// level, whatever the trunk does (T. Pozzo, A. Berthoz, L. Lefort, "Head stabilization during various locomotor
    /// tasks in humans", Experimental Brain Research 82, 1990), so the neck is the pole of the head below its middle;
    /// the more a trunk lies, the more it is the pole along the trunk.
    pub fn place_of(&self, joint: Joint) -> (Part, Vector3<f64>) {
        if joint != Joint::Neck {
            return joint.place();
        }
        let trunk = self.turn(Part::Torso) * Vector3::z();
        let upright = trunk.z.max(0.0).powi(2);
        let up = trunk * (1.0 - upright) + Vector3::z() * upright;
        let down = up.try_normalize(1e-6).map_or(-trunk, |it| -it);
        let size = self.size(Part::Head);
        (Part::Head, (self.turn(Part::Head).inverse() * (down * size.z)).component_div(size))
    }

    /// Position of a part's joint to its parent [m].
    pub fn held(&self, part: Part) -> Point3<f64> {
        self.place(part, &part.held_at())
    }

    /// The same body with left and right exchanged, facing the other way: voxels look the same, only the names change.
    pub fn faced_about(&self) -> Body {
        let about = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::PI);
        let mut body = self.clone();
        for part in Part::ALL {
            let [to, from] = [part.index(), part.mirrored().index()];
            body.turns[to] = self.turns[from] * about;
            body.sizes[to] = self.sizes[from];
        }
        body
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_laws::check_jacobian;
    use nalgebra::DMatrix;

    use super::*;

    fn some_body(seed: u64) -> Body {
        let mut random = Random::new(seed);
        let mut vector = |scale: f64| Vector3::from_fn(|_, _| scale * random.normal());
        let turns = std::array::from_fn(|_| UnitQuaternion::from_scaled_axis(vector(1.5)));
        let sizes = std::array::from_fn(|_| vector(0.1).abs() + Vector3::repeat(0.03));
        Body { torso: Point3::from(vector(1.0)), turns, sizes }
    }

    #[test]
    fn lower_arm_lies_where_equation_3_says() {
        let body = some_body(1);
        let [torso, upper, lower] = [Part::Torso, Part::RightUpperArm, Part::RightLowerArm];
        let [l0, l2, l4] = [torso, upper, lower].map(|it| *body.size(it));
        let [r0, r2, r4] = [torso, upper, lower].map(|it| *body.turn(it));
        let j02 = Vector3::new(0.0, -l0.y, super::super::parts::SHOULDER_UP * l0.z);
        let (j20, j24, j42) =
            (Vector3::new(0.0, 0.0, l2.z), Vector3::new(0.0, 0.0, -l2.z), Vector3::new(0.0, 0.0, l4.z));
        let expected = body.torso + r0 * j02 - r2 * j20 + r2 * j24 - r4 * j42;
        assert!((body.centre(lower) - expected).norm() < 1e-12);
    }

    #[test]
    fn parts_meet_at_their_joints() {
        for seed in 0..20 {
            let body = some_body(seed);
            let centres = body.centres();
            for part in Part::ALL {
                assert!((centres[part.index()] - body.centre(part)).norm() < 1e-12);
                let Some(parent) = part.parent() else { continue };
                let gap = body.place(parent, &part.hangs_at()) - body.held(part);
                assert!(gap.norm() < 1e-12, "{} is {} m off its joint", part.name(), gap.norm());
            }
        }
    }

    #[test]
    fn derivatives_of_the_chain_are_those_of_its_middles() {
        for (seed, part) in (0..3).flat_map(|seed| Part::ALL.map(|part| (seed, part))) {
            let body = some_body(seed);
            // Columns: torso, then turn and sizes of each part.
            let mut stated = DMatrix::zeros(3, 3 + 6 * N_PARTS);
            stated.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
            for (link, factors) in Chain::to(part).links() {
                let r = body.turn(*link).to_rotation_matrix();
                let at = 3 + 6 * link.index();
                let reach = factors.component_mul(body.size(*link));
                stated.fixed_view_mut::<3, 3>(0, at).copy_from(&(-(r.matrix() * cross(&reach))));
                let by_sizes = r.matrix() * Matrix3::from_diagonal(factors);
                stated.fixed_view_mut::<3, 3>(0, at + 3).copy_from(&by_sizes);
            }
            let moved = |x: &[f64]| {
                let vector = |at: usize| Vector3::new(x[at], x[at + 1], x[at + 2]);
                let mut other = body.clone();
                other.torso += vector(0);
                for i in 0..N_PARTS {
                    other.turns[i] *= UnitQuaternion::from_scaled_axis(vector(3 + 6 * i));
                    other.sizes[i] += vector(6 + 6 * i);
                }
                other.centre(part).coords.as_slice().to_vec()
            };
            check_jacobian(moved, &stated, &vec![0.0; 3 + 6 * N_PARTS], 1e-7);
        }
    }

    #[test]
    fn neck_is_below_the_head_wherever_the_head_is_held() {
        let mut body = some_body(7);
        for tilt in [0.0, 0.3, -0.5] {
            body.turns[0] = UnitQuaternion::identity();
            body.turns[1] = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), tilt);
            let below = body.centre(Part::Head) - Vector3::z() * body.size(Part::Head).z;
            assert!((body.joint(Joint::Neck) - below).norm() < 1e-12, "{tilt}");
        }
        // Who lies has it along the trunk.
        body.turns[0] = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::FRAC_PI_2);
        let below = body.centre(Part::Head) - Vector3::x() * body.size(Part::Head).z;
        assert!((body.joint(Joint::Neck) - below).norm() < 1e-9);
    }

    #[test]
    fn facing_about_changes_names_only() {
        let mut body = some_body(4);
        // Hips and shoulders of one body are alike on both sides.
        for part in [Part::LeftUpperArm, Part::LeftThigh, Part::LeftLowerArm, Part::LeftCalf] {
            body.sizes[part.mirrored().index()] = body.sizes[part.index()];
        }
        let other = body.faced_about();
        for part in Part::ALL {
            assert!((other.centre(part) - body.centre(part.mirrored())).norm() < 1e-12, "{}", part.name());
        }
        let again = other.faced_about();
        assert!(Joint::ALL.iter().all(|&it| (again.joint(it) - body.joint(it)).norm() < 1e-12));
    }
}
