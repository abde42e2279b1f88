//! Bodies of metaballs: derivatives, the surface, and fits to points that other shapes gave.

use std::f64::consts::{FRAC_PI_2, PI};

use foveate_estimation::random::Random;
use foveate_laws::check_jacobian;
use nalgebra::{DMatrix, Isometry3, Point3, Unit, UnitQuaternion, Vector3};

use super::field::VISIBLE;
use super::fit::{BodyObservation, ResidualKind, fit_body};
use super::people::{Side, arm, person};
use super::skeleton::{Columns, Dof, Segment, Skeleton, SkeletonError};
use super::*;

fn bent(state: &State, seed: u64) -> State {
    let mut random = Random::new(seed);
    let mut step: Vec<f64> = (0..Columns::of(state).len()).map(|_| random.uniform_in(-0.2, 0.2)).collect();
    step[3] += 0.3;
    state.moved(&step)
}

#[test]
fn derivatives_of_the_field_are_those_of_differences() {
    let (body, rest) = person(1.75);
    for seed in 0..4 {
        let state = bent(&rest, seed);
        let posed = body.skeleton.pose(&state);
        let mut random = Random::new(100 + seed);
        for name in ["pelvis", "trunk", "forearm_left", "hand_right", "foot_left"] {
            let segment = body.skeleton.find(name).unwrap();
            let off = Vector3::from_fn(|_, _| random.uniform_in(-0.15, 0.15));
            let point = body.skeleton.end(&posed, &state, segment) + off;
            let d = |step: &[f64]| {
                let state = state.moved(step);
                vec![body.field_of(&body.skeleton.pose(&state), &state, segment, &point).unwrap().d]
            };
            let mut row = Vec::new();
            let found = body.linearised(&posed, &state, segment, &point, &mut row).unwrap();
            assert!((found - d(&vec![0.0; Columns::of(&state).len()])[0]).abs() < 1e-12);
            let mut jacobian = DMatrix::zeros(1, Columns::of(&state).len());
            row.iter().for_each(|(column, by)| jacobian[(0, *column)] += by);
            check_jacobian(d, &jacobian, &vec![0.0; jacobian.ncols()], 1e-5);
        }
    }
}

#[test]
fn gradient_by_the_point_is_that_of_differences() {
    let (body, rest) = arm(Side::Right, 1.8);
    let state = bent(&rest, 7);
    let posed = body.skeleton.pose(&state);
    let point = body.skeleton.end(&posed, &state, 0) + Vector3::new(0.05, -0.04, 0.02);
    let field = body.field(&posed, &state, &point).unwrap();
    let d = |at: &[f64]| vec![body.field(&posed, &state, &Point3::new(at[0], at[1], at[2])).unwrap().d];
    check_jacobian(d, &DMatrix::from_row_slice(1, 3, field.gradient.as_slice()), point.coords.as_slice(), 1e-6);
}

/// One ball of effective radius `radius` on one segment.
fn sphere(radius: f64) -> (Body, State) {
    let segment = Segment {
        name: "ball".to_owned(),
        parent: None,
        joint_in_parent: Vector3::zeros(),
        parent_from_rest: UnitQuaternion::identity(),
        dofs: Vec::new(),
        length: 1.0,
        scale: 0,
    };
    let skeleton = Skeleton::new(vec![segment]).unwrap();
    let ball = Ball { segment: 0, centre: Vector3::zeros(), segment_from_ball: UnitQuaternion::identity() };
    let state = State {
        world_from_root: Isometry3::identity(),
        angles: vec![],
        scales: vec![1.0],
        radii: vec![Vector3::repeat(radius)],
    };
    (Body::new(skeleton, vec![ball]), state)
}

#[test]
fn distance_from_a_sphere_is_exact_inside_and_far_away() {
    let (body, state) = sphere(0.1);
    let posed = body.skeleton.pose(&state);
    for r in [0.02, 0.05, 0.058_870_5, 0.1, 3.0] {
        let field = body.field(&posed, &state, &Point3::new(0.0, r, 0.0)).unwrap();
        assert!((field.distance(0.1) - (r - 0.1 * VISIBLE)).abs() < 1e-9, "{r}: {}", field.distance(0.1));
        // (8) and w_t.
        if r < 0.2 {
            let inside = (-2.0 * (r / 0.1).powi(2)).exp() > THRESHOLD;
            assert_eq!(field.distance(0.1) < 0.0, inside);
        }
    }
}

#[test]
fn surface_of_a_sphere_is_one_and_closed() {
    let (body, state) = sphere(0.1);
    let mesh = surface(&body, &state, 0.01);
    let radius = 0.1 * VISIBLE;
    assert!(mesh.vertices.iter().all(|it| (it.position.coords.norm() - radius).abs() < 5e-4));
    let (area, expected) = (mesh.area(), 4.0 * PI * radius * radius);
    assert!((area / expected - 1.0).abs() < 0.03, "{area}, expected {expected}");
    // Euler: a closed surface without holes.
    assert_eq!(mesh.vertices.len() as i64 - mesh.triangles.len() as i64 / 2, 2);
}

/// A two-part arm of tapered capsules, which no metaball is: points seen from one side, with noise across the surface.
struct CapsuleArm {
    shoulder: Point3<f64>,
    elbow: Point3<f64>,
    wrist: Point3<f64>,
    radii: [f64; 3],
}

impl CapsuleArm {
    /// Upper arm 0.30 m, forearm 0.26 m, turned by `abduction` and `flexion` of the shoulder and `elbow` [rad].
    fn new(abduction: f64, flexion: f64, elbow: f64) -> CapsuleArm {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), abduction)
            * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -flexion);
        let bend = turn * UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -elbow);
        let shoulder = Point3::new(0.2, 0.1, 1.4);
        let at = shoulder + turn * Vector3::new(0.0, 0.0, -0.30);
        CapsuleArm {
            shoulder,
            elbow: at,
            wrist: at + bend * Vector3::new(0.0, 0.0, -0.26),
            radii: [0.055, 0.043, 0.030],
        }
    }

    fn points(&self, n: usize, noise: f64, seed: u64) -> Vec<BodyObservation> {
        let mut random = Random::new(seed);
        let towards = Vector3::new(1.0, -0.6, 0.2).normalize();
        let parts = [
            (self.shoulder, self.elbow, self.radii[0], self.radii[1]),
            (self.elbow, self.wrist, self.radii[1], self.radii[2]),
        ];
        let mut points = Vec::new();
        while points.len() < n {
            let (from, to, first, last) = parts[random.below(2) as usize];
            let axis = (to - from).normalize();
            let part = random.uniform();
            let out = Vector3::from_fn(|_, _| random.normal());
            let out = (out - axis * out.dot(&axis)).normalize();
            if out.dot(&towards) < 0.0 {
                continue;
            }
            let radius = first + (last - first) * part + noise * random.normal();
            let at = from + (to - from) * part + out * radius;
            points.push(BodyObservation::Point { at, sigma_m: 0.003, segment: None });
        }
        points
    }
}

impl CapsuleArm {
    /// Shoulder, elbow and wrist as somebody clicks them, three centimetres off.
    fn clicked(&self, body: &Body, seed: u64) -> Vec<BodyObservation> {
        let mut random = Random::new(seed);
        let fore = body.skeleton.find("forearm_right").unwrap();
        let wrist = Vector3::new(0.0, 0.0, body.skeleton.segments()[fore].length);
        let clicks =
            [(0, Vector3::zeros(), self.shoulder), (fore, Vector3::zeros(), self.elbow), (fore, wrist, self.wrist)];
        let mut off = || Vector3::from_fn(|_, _| 0.02 * random.normal());
        clicks
            .map(|(segment, place, at)| BodyObservation::Anchored { segment, place, at: at + off(), sigma_m: 0.03 })
            .to_vec()
    }
}

/// The built-in arm without a hand, a few decimetres and many degrees off.
fn armless_start(shoulder: Vector3<f64>) -> (Body, State) {
    let (body, state) = arm(Side::Right, 1.75);
    let hand = body.skeleton.find("hand_right").unwrap();
    let kept: Vec<usize> = (0..body.balls.len()).filter(|it| body.balls[*it].segment != hand).collect();
    let balls = kept.iter().map(|it| body.balls[*it].clone()).collect();
    let radii = kept.iter().map(|it| state.radii[*it]).collect();
    let world_from_root = Isometry3::translation(shoulder.x, shoulder.y, shoulder.z) * state.world_from_root;
    (Body::new(body.skeleton.clone(), balls), State { world_from_root, radii, ..state })
}

fn arm_priors(body: &Body, state: &State) -> Priors {
    Priors {
        angles: vec![(0.0, 1.0); body.skeleton.n_angles()],
        scales: vec![(1.0, 0.08); state.scales.len()],
        radii: state.radii.clone(),
        radii_sigma: 0.2,
    }
}

const ARM: BodyFitOptions = BodyFitOptions {
    free: Free { root: FreedomOfRoot::Shifts, angles: true, scales: true, radii: true },
    residual: ResidualKind::Distance,
    in_turn: false,
    loss: foveate_estimation::least_squares::Loss::CAUCHY,
    max_rounds: 40,
    max_iterations: 6,
    settled_m: 2e-5,
    limit_sigma: 0.017,
    outlier_sigmas: 5.0,
};

/// Angle between two directions [deg].
fn between(a: Vector3<f64>, b: Vector3<f64>) -> f64 {
    a.angle(&b).to_degrees()
}

/// What a fit makes of a capsule arm: angle of the upper arm, of the forearm [deg], and the fit.
fn fitted(truth: &CapsuleArm, observations: &[BodyObservation], options: &BodyFitOptions) -> (f64, f64, BodyFit) {
    let (body, start) = armless_start(Vector3::new(0.22, 0.08, 1.42));
    let mut all = truth.clicked(&body, 77);
    all.extend_from_slice(observations);
    let fit = fit_body(&body, &all, &start, &arm_priors(&body, &start), options).unwrap();
    let posed = body.skeleton.pose(&fit.state);
    let bone = |segment: usize| posed.world_from_segment[segment] * Vector3::z();
    println!(
        "DIAG rounds {} it {} rms {} out {} angles {:.2?} scales {:.2?} settled {}",
        fit.rounds, fit.iterations, fit.rms_m, fit.outliers, fit.state.angles, fit.state.scales, fit.settled
    );
    let upper = between(bone(0), truth.elbow - truth.shoulder);
    let fore = between(bone(1), truth.wrist - truth.elbow);
    (upper, fore, fit)
}

#[test]
fn arm_of_capsules_seen_from_one_side_is_fitted_to_a_degree_or_two() {
    let mut errors = Vec::new();
    for seed in 0..6 {
        let mut random = Random::new(300 + seed);
        let truth =
            CapsuleArm::new(random.uniform_in(-0.5, 0.3), random.uniform_in(-0.2, 0.8), random.uniform_in(0.3, 1.2));
        let points = truth.points(300, 0.001, seed);
        let (upper, fore, fit) = fitted(&truth, &points, &ARM);
        assert!(fit.rms_m < 0.003 && fit.outliers < 30, "seed {seed}: {} m, {} outliers", fit.rms_m, fit.outliers);
        errors.extend([upper, fore]);
    }
    errors.sort_by(f64::total_cmp);
    let (median, worst) = (errors[errors.len() / 2], errors[errors.len() - 1]);
    assert!(median < 2.0 && worst < 5.0, "median {median}, worst {worst} degrees: {errors:?}");
}

#[test]
fn the_papers_equation_fits_too() {
    let truth = CapsuleArm::new(-0.2, 0.2, 0.5);
    let points = truth.points(300, 0.001, 1);
    let options = BodyFitOptions { residual: ResidualKind::Field, in_turn: true, ..ARM };
    let (upper, fore, fit) = fitted(&truth, &points, &options);
    assert!(upper < 4.0 && fore < 4.0, "{upper}, {fore} degrees, {fit:?}");
}

#[test]
fn one_point_in_five_that_is_wrong_does_not_pull() {
    let truth = CapsuleArm::new(-0.3, 0.4, 0.9);
    let mut points = truth.points(300, 0.001, 2);
    let mut random = Random::new(5);
    for point in points.iter_mut().step_by(5) {
        if let BodyObservation::Point { at, .. } = point {
            *at += Vector3::from_fn(|_, _| random.uniform_in(-0.2, 0.2));
        }
    }
    let (upper, fore, fit) = fitted(&truth, &points, &ARM);
    assert!(upper < 3.0 && fore < 3.0, "{upper}, {fore} degrees");
    assert!((40..110).contains(&fit.outliers), "{} outliers of 60", fit.outliers);
}

#[test]
fn twist_of_the_forearm_comes_from_tracked_points() {
    let (body, start) = armless_start(Vector3::new(0.2, 0.1, 1.4));
    let fore = body.skeleton.find("forearm_right").unwrap();
    let twist = body.skeleton.angles_of(fore).start + 1;
    // With a straight elbow the shoulder's rotation would do the same.
    let mut turned = start.clone();
    (turned.angles[twist - 1], turned.angles[twist]) = (0.8, 0.5);
    let place = |number: usize| {
        let around = 0.7 * number as f64;
        Vector3::new(0.03 * around.cos(), 0.03 * around.sin(), 0.02 + 0.02 * number as f64)
    };
    let posed = body.skeleton.pose(&turned);
    let seen = |number: usize| BodyObservation::Anchored {
        segment: fore,
        place: place(number),
        at: posed.world_from_segment[fore] * Point3::from(place(number)),
        sigma_m: 1e-3,
    };
    let observations: Vec<_> = (0..8).map(seen).collect();
    let options = BodyFitOptions { free: Free { root: FreedomOfRoot::Held, ..Free::POSTURE }, ..ARM };
    let priors = Priors { angles: vec![(0.0, 1.0); body.skeleton.n_angles()], ..Priors::default() };
    let fit = fit_body(&body, &observations, &start, &priors, &options).unwrap();
    assert!((fit.state.angles[twist] - 0.5).abs() < 0.01, "{:?}", fit.state.angles);
    assert!(fit.rms_m < 1e-4);
}

#[test]
fn silhouettes_of_two_cameras_find_the_elbow() {
    let truth = CapsuleArm::new(-0.2, 0.3, 0.8);
    let mut rays = Vec::new();
    for eye in [Point3::new(2.5, -1.0, 1.3), Point3::new(0.3, -2.6, 1.1), Point3::new(-0.5, 0.3, 3.6)] {
        for (from, to, first, last) in
            [(truth.shoulder, truth.elbow, 0.055, 0.043), (truth.elbow, truth.wrist, 0.043, 0.030)]
        {
            for step in 1..14 {
                let part = f64::from(step) / 14.0;
                let middle = from + (to - from) * part;
                let sight = (middle - eye).normalize();
                let side = sight.cross(&(to - from)).normalize();
                for sign in [-1.0, 1.0] {
                    let touch = middle + side * (sign * (first + (last - first) * part));
                    rays.push(BodyObservation::Ray {
                        origin: eye,
                        direction: Unit::new_normalize(touch - eye),
                        sigma_m: 0.002,
                    });
                }
            }
        }
    }
    let (upper, fore, fit) = fitted(&truth, &rays, &ARM);
    assert!(upper < 3.0 && fore < 3.0, "{upper}, {fore} degrees, rms {}", fit.rms_m);
}

#[test]
fn joints_stay_within_their_limits() {
    let (body, start) = armless_start(Vector3::new(0.2, 0.1, 1.4));
    let fore = body.skeleton.find("forearm_right").unwrap();
    let flexion = body.skeleton.angles_of(fore).start;
    // An elbow that bends backwards by 40 degrees.
    let mut backwards = start.clone();
    backwards.angles[flexion] = -0.7;
    let posed = body.skeleton.pose(&backwards);
    let observations: Vec<_> = (0..6)
        .map(|it| Vector3::new(0.0, 0.0, 0.03 * f64::from(it)))
        .map(|place| BodyObservation::Anchored {
            segment: fore,
            place,
            at: posed.world_from_segment[fore] * Point3::from(place),
            sigma_m: 0.02,
        })
        .collect();
    let options = BodyFitOptions { free: Free { root: FreedomOfRoot::Held, ..Free::POSTURE }, ..ARM };
    let priors = Priors { angles: vec![(0.0, 1.0); body.skeleton.n_angles()], ..Priors::default() };
    let fit = fit_body(&body, &observations, &start, &priors, &options).unwrap();
    assert!(fit.state.angles[flexion] > -0.1, "{:?}", fit.state.angles);
}

#[test]
fn bad_input_is_named() {
    let (body, start) = armless_start(Vector3::zeros());
    let point =
        |at: f64, sigma_m: f64, segment| BodyObservation::Point { at: Point3::new(at, 0.0, 0.0), sigma_m, segment };
    let fit =
        |observations: &[BodyObservation]| fit_body(&body, observations, &start, &Priors::default(), &ARM).unwrap_err();
    assert_eq!(fit(&[]), BodyFitError::TooFew { found: 0, expected: 3 });
    let good = point(0.1, 0.01, None);
    for bad in [point(f64::NAN, 0.01, None), point(0.1, 0.0, None), point(0.1, 0.01, Some(9))] {
        assert!(matches!(fit(&[good.clone(), good.clone(), bad]), BodyFitError::Unfit { index: 2, .. }));
    }
    let other = State { angles: vec![0.0], ..start.clone() };
    let error = fit_body(&body, &vec![good; 3], &other, &Priors::default(), &ARM).unwrap_err();
    assert!(matches!(error, BodyFitError::OtherBody { found: 1, .. }), "{error}");
}

#[test]
fn skeletons_that_cannot_be_are_refused() {
    let segment = |name: &str, parent| Segment {
        name: name.to_owned(),
        parent,
        joint_in_parent: Vector3::zeros(),
        parent_from_rest: UnitQuaternion::identity(),
        dofs: vec![Dof { name: format!("{name}_turn"), axis: Vector3::x_axis(), lowest: -1.0, highest: 1.0 }],
        length: 0.3,
        scale: 0,
    };
    assert_eq!(Skeleton::new(vec![]), Err(SkeletonError::Empty));
    assert!(matches!(
        Skeleton::new(vec![segment("a", None), segment("b", Some(1))]),
        Err(SkeletonError::Parent { .. })
    ));
    assert!(matches!(Skeleton::new(vec![segment("a", None), segment("a", Some(0))]), Err(SkeletonError::Name { .. })));
    let flat = Segment { length: 0.0, ..segment("a", None) };
    assert!(matches!(Skeleton::new(vec![flat]), Err(SkeletonError::Number { .. })));
}

#[test]
fn person_stands_on_the_floor_with_arms_at_the_sides() {
    let (body, state) = person(1.8);
    let mesh = surface(&body, &state, 0.02);
    let z = mesh.vertices.iter().map(|it| it.position.z);
    let (low, high) = (z.clone().fold(f64::INFINITY, f64::min), z.fold(f64::NEG_INFINITY, f64::max));
    assert!(low.abs() < 0.06 && (high - 1.8).abs() < 0.08, "from {low} to {high} m");
    let posed = body.skeleton.pose(&state);
    let left = body.skeleton.find("hand_left").unwrap();
    let tip = body.skeleton.end(&posed, &state, left);
    assert!(tip.y > 0.2 && (0.5..0.8).contains(&tip.z), "{tip}");
    // Flexion of the left shoulder lifts the hand forward, abduction to the left.
    for (angle, direction) in [(0, Vector3::x()), (1, Vector3::y())] {
        let mut raised = state.clone();
        raised.angles[body.skeleton.angles_of(body.skeleton.find("upper_arm_left").unwrap()).start + angle] = FRAC_PI_2;
        let tip = body.skeleton.end(&body.skeleton.pose(&raised), &raised, left);
        let shoulder = body.skeleton.joint(&posed, body.skeleton.find("upper_arm_left").unwrap());
        assert!((tip - shoulder).normalize().dot(&direction) > 0.99, "{angle}: {tip}");
    }
    // A bent knee puts the foot behind.
    let shank = body.skeleton.find("shank_right").unwrap();
    let mut kneeling = state.clone();
    kneeling.angles[body.skeleton.angles_of(shank).start] = FRAC_PI_2;
    let ankle = body.skeleton.end(&body.skeleton.pose(&kneeling), &kneeling, shank);
    assert!(ankle.x < -0.3, "{ankle}");
}

#[test]
fn patches_lie_on_the_surface() {
    let (body, state) = arm(Side::Left, 1.75);
    let posed = body.skeleton.pose(&state);
    let patches = skin_patches(&body, &state, 8, 16, 3);
    assert_eq!(patches.len(), 3);
    for patch in &patches {
        let mut off: Vec<f64> = Vec::new();
        for vertex in &patch.mesh.vertices {
            let field = body.field_of(&posed, &state, patch.segment, &vertex.position).unwrap();
            off.push(field.distance(0.1).abs());
        }
        off.sort_by(f64::total_cmp);
        // A B-spline lies inside its control points: by a sixth of their second difference.
        assert!(off[off.len() / 2] < 0.004, "{} m", off[off.len() / 2]);
    }
    // Normals point out of the limb.
    let patch = &patches[0];
    let bone = posed.world_from_segment[patch.segment];
    let outward = |it: &&crate::surface::SurfaceVertex| {
        let local = bone.inverse_transform_point(&it.position);
        (bone * Vector3::new(local.x, local.y, 0.0)).dot(&it.normal) > 0.0
    };
    let n = patch.mesh.vertices.len();
    assert!(patch.mesh.vertices.iter().filter(outward).count() > n * 9 / 10);
}

#[test]
fn more_balls_keep_the_shape() {
    let (body, state) = arm(Side::Left, 1.75);
    let (finer, finer_state) = body.refined(&state, 0, 8);
    assert_eq!(finer.balls.iter().filter(|it| it.segment == 0).count(), 8);
    let (before, after) = (surface(&body, &state, 0.01), surface(&finer, &finer_state, 0.01));
    assert!((after.area() / before.area() - 1.0).abs() < 0.15, "{} and {} m²", before.area(), after.area());
}
