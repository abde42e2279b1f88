//! Bundle adjustment of two small public problems in the BAL format (S. Agarwal et al., "Bundle adjustment in the large", ECCV 2010), held
//! against the optimum that SciPy's `least_squares` finds.

use foveate::geometry::bundle::{Adjusted, BundleOptions, Freedom, Observation, adjust};
use foveate::geometry::{Camera, Distortion, Intrinsics};
use foveate_testkit::data_dir_or_skip;
use nalgebra::{Isometry3, Point2, Point3, Rotation3, Translation3, UnitQuaternion, Vector3};

struct Problem {
    cameras: Vec<Camera>,
    points: Vec<Point3<f64>>,
    observations: Vec<Observation>,
}

/// BAL's cameras look along −z with y up: half a turn about x makes them ours, and the sign of the rows turns.
fn read(text: &str) -> Option<Problem> {
    let mut numbers = text.split_whitespace().map(|it| it.parse::<f64>().ok());
    let mut next = || numbers.next().flatten();
    let [n_cameras, n_points, n_observations] = [next()?, next()?, next()?];
    let mut problem = Problem { cameras: Vec::new(), points: Vec::new(), observations: Vec::new() };
    for _ in 0..n_observations as usize {
        let (camera, point) = (next()? as usize, next()? as usize);
        let pixel = Point2::new(next()?, -next()?);
        problem.observations.push(Observation { camera, point, pixel, sigma_px: 1.0 });
    }
    for _ in 0..n_cameras as usize {
        let turn = Vector3::new(next()?, next()?, next()?);
        let shift = Vector3::new(next()?, next()?, next()?);
        let (focal, k1, k2) = (next()?, next()?, next()?);
        let half = Rotation3::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let rotation = UnitQuaternion::from_rotation_matrix(&(half * Rotation3::new(turn)));
        problem.cameras.push(Camera {
            image_size: [1, 1],
            intrinsics: Intrinsics { focal: [focal; 2], principal: [0.0; 2], skew: 0.0 },
            distortion: Distortion { k1, k2, ..Distortion::default() },
            camera_from_world: Isometry3::from_parts(Translation3::from(half * shift), rotation),
        });
    }
    for _ in 0..n_points as usize {
        problem.points.push(Point3::new(next()?, next()?, next()?));
    }
    Some(problem)
}

#[track_caller]
fn adjusted(problem: &Problem, freedom: Freedom) -> Adjusted {
    let freedoms = vec![freedom; problem.cameras.len()];
    let options =
        BundleOptions { relative_gain: 1e-12, max_iterations: 500, covariance: true, ..BundleOptions::default() };
    adjust(&problem.cameras, &freedoms, &problem.points, &problem.observations, &options).unwrap()
}

#[test]
fn public_problems_end_at_the_optimum_of_the_reference() {
    let Some(folder) = data_dir_or_skip("public_problems_end_at_the_optimum_of_the_reference", "s19_bal") else {
        return;
    };
    // ½ Σ r² at the start, and SciPy's optimum over poses and points, and with the focal lengths free too.
    let expected = [
        ("dubrovnik-3-7-pre.txt", 2764.2199844221745, 2.3199139921017755, 0.21499291620962063),
        ("dubrovnik-3-7-18-pre.txt", 2753.173946790546, 0.10210382319247811, 0.01387050823823977),
    ];
    for (name, start, of_poses, with_focal) in expected {
        let problem = read(&std::fs::read_to_string(folder.join(name)).unwrap()).unwrap();
        let found = adjusted(&problem, Freedom::POSE);
        assert!((found.costs[0] - start).abs() < 1e-6 * start, "{name} {} {start}", found.costs[0]);
        let cost = *found.costs.last().unwrap();
        assert!((cost - of_poses).abs() < 1e-6 * of_poses, "{name} {cost} {of_poses}");
        assert!(found.covariance.unwrap().is_ok());
        let cost = *adjusted(&problem, Freedom { focal: true, ..Freedom::POSE }).costs.last().unwrap();
        assert!((cost - with_focal).abs() < 1e-6 * with_focal, "{name} {cost} {with_focal}");
        // With k1 and k2 too there are more unknowns than numbers, and the answer says which are open.
        let optics = Freedom { focal: true, k1: true, k2: true, ..Freedom::POSE };
        let found = adjusted(&problem, optics);
        assert!(*found.costs.last().unwrap() < with_focal, "{name} {:?}", found.costs.last());
        assert!(found.covariance.unwrap().is_err());
    }
}
