//! Bodies of metaballs: derivatives, the surface, and fits to points that other shapes gave.

mod loft;

use std::f64::consts::{FRAC_PI_2, PI};

use foveate_estimation::random::Random;
use foveate_laws::check_jacobian;
use nalgebra::{DMatrix, Isometry3, Point3, Unit, UnitQuaternion, Vector3};

use self::loft::LoftArm;
use super::field::VISIBLE;
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
        cut: false,
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

/// Panics unless each edge belongs to two triangles, once in each direction, and the mesh holds a volume.
#[track_caller]
fn assert_closed(mesh: &crate::surface::TriangleMesh, what: &str) {
    let mut edges = std::collections::BTreeMap::new();
    for triangle in &mesh.triangles {
        for (from, to) in [(0, 1), (1, 2), (2, 0)].map(|(a, b)| (triangle[a], triangle[b])) {
            *edges.entry((from, to)).or_insert(0_u32) += 1;
        }
    }
    assert!(!edges.is_empty(), "{what}: no triangles");
    let open = edges.iter().filter(|((a, b), n)| **n != 1 || edges.get(&(*b, *a)) != Some(&1)).count();
    assert_eq!(open, 0, "{what}: {open} of {} edges belong to another number of triangles than two", edges.len());
    let at = |corner: u32| mesh.vertices[corner as usize].position.coords;
    let volume: f64 = mesh.triangles.iter().map(|it| at(it[0]).dot(&at(it[1]).cross(&at(it[2]))) / 6.0).sum();
    assert!(volume > 0.0, "{what}: {volume} m³, expected triangles counter-clockwise from outside");
}

#[test]
fn surfaces_are_closed_in_every_posture_at_every_spacing() {
    for (side, seed) in [(Side::Right, 1), (Side::Left, 2), (Side::Right, 3)] {
        let (body, rest) = arm(side, 1.6 + 0.1 * seed as f64);
        for voxel_m in [0.006, 0.015, 0.05] {
            assert_closed(&surface(&body, &bent(&rest, seed), voxel_m), &format!("arm {seed} at {voxel_m} m"));
        }
    }
    let (body, rest) = person(1.75);
    for seed in 10..14 {
        // Joints bent by more, so that limbs touch and pass through each other.
        let mut state = bent(&rest, seed);
        let mut random = Random::new(seed);
        for (angle, dof) in state.angles.iter_mut().zip(body.skeleton.dofs()) {
            *angle = random.uniform_in(dof.lowest, dof.highest);
        }
        assert_closed(&surface(&body, &state, 0.02), &format!("person {seed}"));
    }
}

#[test]
fn surfaces_of_what_no_body_is_are_closed_or_empty() {
    // A hand as thin as paper, a limb as thin as the spacing, and one that has vanished.
    let (body, rest) = arm(Side::Right, 1.75);
    for thin in [1e-3, 5e-3, 0.02] {
        let mut state = rest.clone();
        let hand = body.balls.len() - 1;
        state.radii[hand].x = thin;
        state.radii[1] = Vector3::repeat(thin);
        assert_closed(&surface(&body, &state, 0.008), &format!("{thin} m thin"));
    }
    // The grid passes through the middle of a ball, and its radius is a whole number of steps.
    let (ball, mut state) = sphere(0.1 / VISIBLE);
    assert_closed(&surface(&ball, &state, 0.05), "sphere on the grid");
    state.radii[0].x = f64::NAN;
    assert!(surface(&ball, &state, 0.05).triangles.is_empty());
    state.radii[0] = Vector3::repeat(1e-4);
    assert!(
        surface(&ball, &State { world_from_root: Isometry3::translation(0.02, 0.02, 0.02), ..state }, 0.05)
            .triangles
            .is_empty()
    );
}

#[test]
fn an_arm_beside_the_trunk_is_as_thick_as_by_itself() {
    let (body, state) = person(1.75);
    let posed = body.skeleton.pose(&state);
    let upper = body.skeleton.find("upper_arm_left").unwrap();
    let middle = Point3::new(0.0, 0.0, 0.16);
    // The outer side: away from the trunk.
    let on_surface = (0..400).map(|it| 2e-4 * f64::from(it)).find(|out| {
        let point = posed.world_from_segment[upper] * (middle + Vector3::new(0.0, -out, 0.0));
        body.field(&posed, &state, &point).unwrap().d > VISIBLE * VISIBLE
    });
    let alone = body.thickness_at(&state, upper, middle.z, Vector3::y());
    assert!((on_surface.unwrap() - alone).abs() < 1e-3, "{on_surface:?} and {alone} m");
    // A point just outside is the arm's, though the trunk's balls reach farther in units of their radii.
    let point = posed.world_from_segment[upper] * (middle + Vector3::new(0.0, -alone - 0.01, 0.0));
    assert_eq!(body.nearest_segment(&posed, &state, &point), Some(upper));
}

#[test]
fn somebody_taller_and_stouter_than_said_is_a_person_and_a_giant_is_none() {
    let fit = |stature: f64, girth: f64| {
        let (body, start) = person(1.75);
        let (_, mut truth) = person(1.75 * stature);
        truth.scales.iter_mut().for_each(|it| *it *= stature);
        truth.radii.iter_mut().for_each(|it| *it = Vector3::new(it.x * girth, it.y * girth, it.z));
        // Arms and legs away from the body, elbows bent.
        for (angle, dof) in truth.angles.iter_mut().zip(body.skeleton.dofs()) {
            let by = [("shoulder_abduction", 0.7), ("hip_abduction", 0.25), ("elbow_flexion", 0.6)];
            *angle = by.iter().find(|it| dof.name.starts_with(it.0)).map_or(0.0, |it| it.1);
        }
        let posed = body.skeleton.pose(&truth);
        let mesh = surface(&body, &truth, 0.05);
        let points = mesh.vertices.iter().step_by(3).map(|it| BodyObservation::Point {
            at: it.position,
            sigma_m: 5e-4,
            segment: None,
        });
        let clicks = (1..body.skeleton.segments().len()).map(|segment| BodyObservation::Anchored {
            segment,
            place: Vector3::zeros(),
            at: body.skeleton.joint(&posed, segment),
            sigma_m: 0.04,
        });
        let observations: Vec<_> = points.chain(clicks).collect();
        let mut priors = Priors { stature: 0.08, ..anthropometric(&start) };
        priors.radii.iter_mut().for_each(|it| it.girth = 0.15);
        let near = State { world_from_root: truth.world_from_root, angles: truth.angles.clone(), ..start.clone() };
        let options = BodyFitOptions { rough: false, ..BodyFitOptions::default() };
        let fit = fit_body(&body, &observations, &near, &priors, &options).unwrap();
        fit.doubts
            .iter()
            .filter(|it| matches!(it, Doubt::Misshapen { .. }))
            .map(ToString::to_string)
            .collect::<Vec<_>>()
    };
    assert_eq!(fit(1.12, 1.25), Vec::<String>::new());
    let giant = fit(1.5, 1.0);
    assert!(giant.iter().any(|it| it.contains("stature of the whole body")), "{giant:?}");
}

/// A rough start for an arm, five centimetres and any turn off.
fn start_near(truth: &LoftArm) -> (Body, State) {
    let (body, mut start) = arm(Side::Right, 1.75);
    let shoulder = truth.joints[0] + Vector3::new(0.05, -0.05, 0.05);
    start.world_from_root = Isometry3::translation(shoulder.x, shoulder.y, shoulder.z) * start.world_from_root;
    (body, start)
}

/// Priors of a person, without one for the direction of the arm.
fn priors(start: &State) -> Priors {
    let mut priors = anthropometric(start);
    priors.root.iter_mut().for_each(|it| it.turn_sigma = 2.0);
    priors
}

fn fitted(truth: &LoftArm, observations: &[BodyObservation], seed: u64, options: &BodyFitOptions) -> (Body, BodyFit) {
    let (body, start) = start_near(truth);
    let mut all = truth.clicks(&body, 0.04, seed);
    all.extend_from_slice(observations);
    let fit = fit_body(&body, &all, &start, &priors(&start), options).unwrap();
    (body, fit)
}

fn sorted(values: impl IntoIterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.into_iter().map(f64::abs).collect();
    values.sort_by(f64::total_cmp);
    values
}

#[test]
fn arms_of_other_shapes_are_fitted_from_joints_that_were_clicked_four_centimetres_off() {
    let (mut bones, mut elbows, mut radii) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 200..212 {
        let truth = LoftArm::draw(seed);
        let (body, fit) = fitted(&truth, &truth.points(400, 0.0005, seed), seed, &BodyFitOptions::default());
        let (angles, widths) = truth.errors(&body, &fit.state);
        bones.extend_from_slice(&angles[..2]);
        elbows.push(angles[2]);
        radii.extend(widths);
    }
    let (bones, elbows, radii) = (sorted(bones), sorted(elbows), sorted(radii));
    let middle = |values: &[f64]| values[values.len() / 2];
    let said = format!("bones {bones:.1?}, elbows {elbows:.1?} degrees, radii {radii:.4?} m");
    assert!(middle(&bones) < 2.0 && middle(&elbows) < 2.0 && bones[bones.len() * 9 / 10] < 6.0, "{said}");
    assert!(middle(&radii) < 0.0045, "{said}");
}

#[test]
fn one_ellipsoid_a_limb_fits_worse_than_three() {
    let mut errors = [Vec::new(), Vec::new()];
    for seed in 300..304 {
        let truth = LoftArm::draw(seed);
        let points = truth.points(300, 0.0005, seed);
        for (balls, errors) in [3, 1].into_iter().zip(&mut errors) {
            let (mut body, mut start) = start_near(&truth);
            for segment in 0..if balls == 1 { 2 } else { 0 } {
                (body, start) = body.refined(&start, segment, balls);
            }
            let mut all = truth.clicks(&body, 0.04, seed);
            all.extend_from_slice(&points);
            let fit = fit_body(&body, &all, &start, &priors(&start), &BodyFitOptions::default()).unwrap();
            errors.push(fit.rms_m);
        }
    }
    let [three, one] = errors.map(sorted);
    assert!(one.iter().sum::<f64>() > 1.2 * three.iter().sum::<f64>(), "rms of three {three:?}, of one {one:?} m");
}

#[test]
fn in_turn_and_together_come_to_the_same_arm() {
    let truth = LoftArm::draw(21);
    let points = truth.points(300, 0.0005, 21);
    let (body, together) = fitted(&truth, &points, 21, &BodyFitOptions::default());
    let (_, in_turn) = fitted(&truth, &points, 21, &BodyFitOptions { in_turn: true, ..BodyFitOptions::default() });
    let bone = |fit: &BodyFit, it: usize| body.skeleton.pose(&fit.state).world_from_segment[it] * Vector3::z();
    for segment in 0..2 {
        let apart = bone(&together, segment).angle(&bone(&in_turn, segment)).to_degrees();
        assert!(apart < 2.0, "segment {segment} is {apart} degrees apart");
    }
    assert!(in_turn.rounds > together.rounds, "{} and {} rounds", in_turn.rounds, together.rounds);
}

#[test]
fn one_point_in_five_that_is_wrong_does_not_pull() {
    let truth = LoftArm::draw(31);
    let mut points = truth.points(400, 0.0005, 31);
    let mut random = Random::new(5);
    for point in points.iter_mut().step_by(5) {
        if let BodyObservation::Point { at, .. } = point {
            *at += Vector3::from_fn(|_, _| random.uniform_in(-0.2, 0.2));
        }
    }
    let (body, fit) = fitted(&truth, &points, 31, &BodyFitOptions::default());
    let ([upper, fore, _], _) = truth.errors(&body, &fit.state);
    assert!(upper < 4.0 && fore < 4.0, "{upper}, {fore} degrees");
    assert!((45..120).contains(&fit.outliers), "{} outliers of about 88", fit.outliers);
}

#[test]
fn what_points_do_not_support_is_named() {
    let truth = LoftArm::draw(41);
    let points = truth.points(400, 0.0005, 41);
    let (_, good) = fitted(&truth, &points, 41, &BodyFitOptions::default());
    assert!(good.doubts.iter().all(|it| !matches!(it, Doubt::Elsewhere { .. })), "{:?}", good.doubts);
    assert!(good.support[0] > 20.0 && good.support[1] > 15.0, "{:?}", good.support);
    // No point beyond the middle of the upper arm.
    let [shoulder, elbow, _] = truth.joints;
    let is_near = |it: &&BodyObservation| match it {
        BodyObservation::Point { at, .. } => (at - shoulder).norm() < 0.6 * (elbow - shoulder).norm(),
        _ => false,
    };
    let some: Vec<_> = points.iter().filter(is_near).cloned().collect();
    let (_, fit) = fitted(&truth, &some, 41, &BodyFitOptions::default());
    let named = |fit: &BodyFit, name: &str| {
        fit.doubts.iter().any(|it| matches!(it, Doubt::Unsupported { segment, .. } if segment == name))
    };
    assert!(named(&fit, "forearm_right") && !named(&fit, "upper_arm_right"), "{:?}", fit.doubts);
    // A leg: half as long again, and nearly twice as thick.
    let mut leg = LoftArm::draw(41);
    let [hip, knee, ankle] = leg.joints;
    leg.joints = [hip, hip + 1.5 * (knee - hip), hip + 1.5 * (ankle - hip)];
    leg.girth *= 1.8;
    let (_, fit) = fitted(&leg, &leg.points(400, 0.0005, 41), 41, &BodyFitOptions::default());
    let is_size = |it: &Doubt| matches!(it, Doubt::Misshapen { .. } | Doubt::Elsewhere { .. });
    assert!(fit.doubts.iter().any(is_size), "{:?} {:?}", fit.doubts, fit.state.scales);
    // A table.
    let table: Vec<_> = (0..400)
        .map(|it| BodyObservation::Point {
            at: shoulder + Vector3::new(0.0, 0.03 * f64::from(it % 20), -0.03 * f64::from(it / 20)),
            sigma_m: 5e-4,
            segment: None,
        })
        .collect();
    let (_, fit) = fitted(&truth, &table, 41, &BodyFitOptions::default());
    assert!(fit.doubts.iter().any(is_size), "{:?}", fit.doubts);
}

#[test]
fn points_that_lie_close_together_count_as_one() {
    let truth = LoftArm::draw(51);
    let points = truth.points(150, 0.0005, 51);
    let (_, once) = fitted(&truth, &points, 51, &BodyFitOptions::default());
    let (_, twice) = fitted(&truth, &[&points[..], &points[..]].concat(), 51, &BodyFitOptions::default());
    let elbow = |fit: &BodyFit| {
        let place = Columns::of(&fit.state).angle(0);
        fit.covariance.as_ref().map(|it| it[(place, place)].sqrt()).unwrap()
    };
    assert!((elbow(&once) / elbow(&twice) - 1.0).abs() < 0.1, "{} and {} rad", elbow(&once), elbow(&twice));
    assert!((0.001..0.05).contains(&elbow(&once)), "{} rad", elbow(&once));
}

#[test]
fn twist_of_the_forearm_comes_from_tracked_points() {
    let (body, start) = arm(Side::Right, 1.75);
    let fore = body.skeleton.find("forearm_right").unwrap();
    let twist = body.skeleton.angles_of(fore).start + 1;
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
    let options =
        BodyFitOptions { free: Free { root: RootFreedom::Held, ..Free::POSTURE }, ..BodyFitOptions::default() };
    let fit = fit_body(&body, &observations, &start, &anthropometric(&start), &options).unwrap();
    assert!((fit.state.angles[twist] - 0.5).abs() < 0.01, "{:?}", fit.state.angles);
    assert!(fit.distances_m.iter().all(|it| *it < 1e-3));
}

#[test]
fn silhouettes_of_three_cameras_find_the_elbow() {
    let (mut uppers, mut fores) = (Vec::new(), Vec::new());
    for seed in 61..66 {
        let [upper, fore] = bones_from_silhouettes(seed);
        uppers.push(upper);
        fores.push(fore);
    }
    let (uppers, fores) = (sorted(uppers), sorted(fores));
    let said = format!("upper arms {uppers:.1?}, forearms {fores:.1?} degrees");
    assert!(uppers[2] < 2.0 && fores[2] < 3.0 && uppers[4] < 5.0 && fores[4] < 5.0, "{said}");
}

/// How far upper arm and forearm are off that only borders of silhouettes and clicked joints tell of [°].
fn bones_from_silhouettes(seed: u64) -> [f64; 2] {
    // A tapered capsule each for upper arm and forearm, clicked like the others.
    let truth = LoftArm::draw(seed);
    let [shoulder, elbow, wrist] = truth.joints;
    let mut rays = Vec::new();
    for eye in [Point3::new(2.5, -1.0, 1.3), Point3::new(0.3, -2.6, 1.1), Point3::new(-0.5, 0.3, 3.6)] {
        for (from, to, first, last) in [(shoulder, elbow, 0.053, 0.042), (elbow, wrist, 0.042, 0.028)] {
            for step in 1..14 {
                let part = f64::from(step) / 14.0;
                let middle = from + (to - from) * part;
                let sight = (middle - eye).normalize();
                let side = sight.cross(&(to - from)).normalize();
                for sign in [-1.0, 1.0] {
                    let touch = middle + side * (sign * (first + (last - first) * part));
                    let direction = Unit::new_normalize(touch - eye);
                    rays.push(BodyObservation::Ray { origin: eye, direction, sigma_m: 0.002 });
                }
            }
        }
    }
    let (body, fit) = fitted(&truth, &rays, seed, &BodyFitOptions::default());
    let ([upper, fore, _], _) = truth.errors(&body, &fit.state);
    [upper, fore]
}

#[test]
fn joints_stay_within_their_limits() {
    let (body, start) = arm(Side::Right, 1.75);
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
    let options =
        BodyFitOptions { free: Free { root: RootFreedom::Held, ..Free::POSTURE }, ..BodyFitOptions::default() };
    let fit = fit_body(&body, &observations, &start, &anthropometric(&start), &options).unwrap();
    assert!(fit.state.angles[flexion] > -0.1, "{:?}", fit.state.angles);
}

#[test]
fn bad_input_is_named() {
    let (body, start) = arm(Side::Right, 1.75);
    let options = BodyFitOptions::default();
    let point =
        |at: f64, sigma_m: f64, segment| BodyObservation::Point { at: Point3::new(at, 0.0, 0.0), sigma_m, segment };
    let fit = |observations: &[BodyObservation]| {
        fit_body(&body, observations, &start, &Priors::default(), &options).unwrap_err()
    };
    assert_eq!(fit(&[]), BodyFitError::TooFew { found: 0, expected: 3 });
    let good = point(0.1, 0.01, None);
    for bad in [point(f64::NAN, 0.01, None), point(0.1, 0.0, None), point(0.1, 0.01, Some(9))] {
        assert!(matches!(fit(&[good.clone(), good.clone(), bad]), BodyFitError::Unfit { index: 2, .. }));
    }
    let other = State { angles: vec![0.0], ..start.clone() };
    let error = fit_body(&body, &vec![good; 3], &other, &Priors::default(), &options).unwrap_err();
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
        cut: false,
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
    assert!(tip.y > 0.17 && (0.5..0.8).contains(&tip.z), "{tip}");
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
