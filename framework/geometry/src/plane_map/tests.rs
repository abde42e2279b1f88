//! Maps of walls, flat and bent, against known truth.

use foveate_estimation::Random;
use foveate_laws::check_jacobian;

use super::*;
use crate::{Camera, Intrinsics};

const SIZE: [u32; 2] = [640, 480];

/// A camera two metres before a wall that it sees at a slant, through a lens whose principal point is off.
fn camera(k1: f64) -> Camera {
    let eye = nalgebra::Point3::new(0.9, 1.4, -2.2);
    let rotation =
        nalgebra::Rotation3::face_towards(&(nalgebra::Point3::new(1.0, 0.6, 0.0) - eye), &-nalgebra::Vector3::y());
    let rotation =
        nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::z_axis(), std::f64::consts::PI) * rotation.inverse();
    Camera {
        image_size: SIZE,
        intrinsics: Intrinsics { focal: [900.0, 905.0], principal: [323.0, 236.0], skew: 0.2 },
        distortion: Distortion { k1, k2: 0.05, p1: 3e-4, p2: -2e-4, k3: 0.0 },
        camera_from_world: nalgebra::Isometry3::from_parts(
            nalgebra::Translation3::from(-(rotation * eye.coords)),
            rotation.into(),
        ),
    }
}

fn points(camera: &Camera, noise: f64, seed: u64) -> Vec<PlanePoint> {
    let mut random = Random::new(seed);
    let grid =
        (0..30).flat_map(|column| (0..20).map(move |row| Point2::new(f64::from(column) * 0.09, f64::from(row) * 0.09)));
    grid.filter_map(|point| {
        let pixel = camera.sees(&nalgebra::Point3::new(point.x, point.y, 0.0))?;
        let pixel = pixel + Vector2::new(random.normal(), random.normal()) * noise;
        Some(PlanePoint { point, pixel, sigma: noise.max(0.01) })
    })
    .collect()
}

#[test]
fn camera_over_a_plane_is_found_to_three_hundredths_of_a_pixel() {
    for k1 in [-0.2, 0.0, 0.1] {
        let camera = camera(k1);
        let seen = points(&camera, 0.0, 1);
        assert!(seen.len() > 60, "{}", seen.len());
        let map = PlaneMap::fit(SIZE, &seen).unwrap();
        for it in points(&camera, 0.0, 2) {
            let off = (map.pixel(&it.point).unwrap() - it.pixel).norm();
            assert!(off < 0.03, "k1 {k1}: {off} px at {}", it.pixel);
            let back = map.point(&it.pixel).unwrap();
            assert!((back - it.point).norm() < 9e-5, "{back} {}", it.point);
        }
    }
}

#[test]
fn errors_on_the_plane_are_as_large_as_the_covariance_says() {
    let camera = camera(-0.1);
    let (noise, mut normalised, mut n) = (0.2, 0.0, 0.0);
    for seed in 1..=40 {
        let map = PlaneMap::fit(SIZE, &points(&camera, noise, seed)).unwrap();
        let mut random = Random::new(seed + 1000);
        for it in points(&camera, 0.0, 1).iter().step_by(7) {
            let pixel = it.pixel + Vector2::new(random.normal(), random.normal()) * noise;
            let placed = map.place(&pixel, &(Matrix2::identity() * noise * noise)).unwrap();
            let off = placed.point - it.point;
            normalised += off.dot(&(placed.covariance.try_inverse().unwrap() * off));
            n += 2.0;
        }
    }
    let mean: f64 = normalised / n;
    assert!((0.85..1.2).contains(&mean), "normalised error squared {mean}, expected 1");
}

#[test]
fn derivatives_are_those_of_the_map() {
    let map = PlaneMap::fit(SIZE, &points(&camera(-0.2), 0.1, 1)).unwrap();
    let point = Point2::new(0.7, 0.4);
    let pixel =
        |map: &PlaneMap, x: &[f64]| <[f64; 2]>::from(map.pixel(&Point2::new(x[0], x[1])).unwrap().coords).to_vec();
    let by_point = map.pixel_with_jacobian(&point).unwrap().1;
    check_jacobian(|x| pixel(&map, x), &DMatrix::from_fn(2, 2, |r, c| by_point[(r, c)]), &[0.7, 0.4], 1e-5);
    let by_unknowns = map.pixel_by_unknowns(&point).unwrap();
    let jacobian = DMatrix::from_fn(2, UNKNOWNS, |r, c| by_unknowns[(r, c)]);
    check_jacobian(|step| pixel(&map.moved(step), &[0.7, 0.4]), &jacobian, &[0.0; UNKNOWNS], 1e-4);
}

/// A wall of 2.6 m by 1.7 m along an arc whose ends come nearer, with swells of a centimetre, at even places, through the lens of `camera`.
fn bent(point: &Point2<f64>, radius: f64) -> nalgebra::Point3<f64> {
    let angle = (point.x - WALL[0] / 2.0) / radius;
    let swell = 0.01 * (2.5 * point.x + 0.4).sin() * (3.0 * point.y).cos();
    let out = radius * (1.0 - angle.cos()) + swell;
    nalgebra::Point3::new(WALL[0] / 2.0 + radius * angle.sin(), point.y, -out)
}

const WALL: [f64; 2] = [2.6, 1.7];

/// Dots of a grid of `step`, as a camera sees them on a wall that bends.
fn bent_points(camera: &Camera, radius: f64, step: f64, noise: f64, seed: u64) -> Vec<PlanePoint> {
    let mut random = Random::new(seed);
    let n = WALL.map(|it| (it / step) as u32);
    let grid = (0..=n[0]).flat_map(|column| (0..=n[1]).map(move |row| [column, row].map(|it| f64::from(it) * step)));
    grid.filter_map(|point| {
        let pixel = camera.sees(&bent(&point.into(), radius))?;
        let pixel = pixel + Vector2::new(random.normal(), random.normal()) * noise;
        Some(PlanePoint { point: point.into(), pixel, sigma: noise.max(0.01) })
    })
    .collect()
}

/// Median and 95th percentile of the error of a map at points between those it was fitted to [m].
fn errors(map: &PlaneMap, camera: &Camera, radius: f64) -> (f64, f64) {
    let all = bent_points(camera, radius, 0.037, 0.0, 1);
    let offs: Vec<f64> =
        all.iter().map(|it| map.point(&it.pixel).map_or(f64::INFINITY, |at| (at - it.point).norm())).collect();
    let of = |it: f64| foveate_estimation::statistics::percentile(&offs, it).unwrap();
    (of(50.0), of(95.0))
}

#[test]
fn wall_that_bends_is_found_to_tenths_of_a_millimetre_where_a_flat_map_is_off_by_ten_times_that() {
    for radius in [2.0, 4.0, -3.0] {
        let camera = camera(-0.1);
        let seen = bent_points(&camera, radius, 0.09, 0.05, 3);
        let flat = PlaneMap::fit(SIZE, &seen).unwrap();
        let map = PlaneMap::fit_bent(SIZE, &seen, WALL).unwrap();
        let (found, expected) = (errors(&map, &camera, radius), errors(&flat, &camera, radius));
        assert!(found.0 < 1.5e-4 && found.1 < 4e-4, "radius {radius}, {} dots: {found:?} m", seen.len());
        assert!(expected.1 > 10.0 * found.1, "flat {expected:?} m, bent {found:?} m");
        for it in &seen {
            let there = map.pixel(&map.point(&it.pixel).unwrap()).unwrap();
            assert!((there - it.pixel).norm() < 1e-5, "{there} {}", it.pixel);
        }
    }
}

#[test]
fn flat_wall_loses_little_by_a_map_that_could_bend() {
    let (mut flat, mut could) = (0.0, 0.0);
    for seed in 1..=10 {
        let camera = camera(-0.1);
        let seen = bent_points(&camera, 1e9, 0.09, 0.05, seed);
        let seen: Vec<PlanePoint> = seen
            .into_iter()
            .filter_map(|it| {
                let pixel = camera.sees(&nalgebra::Point3::new(it.point.x, it.point.y, 0.0))?;
                let mut random = Random::new(seed * 1000 + (it.point.x * 977.0 + it.point.y * 7919.0) as u64);
                Some(PlanePoint { pixel: pixel + Vector2::new(random.normal(), random.normal()) * 0.05, ..it })
            })
            .collect();
        let rms = |map: &PlaneMap| -> f64 {
            let all = points(&camera, 0.0, 1);
            let offs = all.iter().filter_map(|it| Some((map.point(&it.pixel)? - it.point).norm_squared()));
            let offs: Vec<f64> = offs.collect();
            (offs.iter().sum::<f64>() / offs.len() as f64).sqrt()
        };
        flat += rms(&PlaneMap::fit(SIZE, &seen).unwrap());
        could += rms(&PlaneMap::fit_bent(SIZE, &seen, WALL).unwrap());
    }
    assert!(could < 1.5 * flat, "flat {flat}, with shifts {could}");
}

#[test]
fn errors_on_a_wall_that_bends_are_as_large_as_the_covariance_says() {
    let camera = camera(-0.1);
    let (noise, mut normalised, mut n) = (0.2, 0.0, 0.0);
    for seed in 1..=20 {
        let map = PlaneMap::fit_bent(SIZE, &bent_points(&camera, 3.0, 0.11, noise, seed), WALL).unwrap();
        let mut random = Random::new(seed + 1000);
        for it in bent_points(&camera, 3.0, 0.09, 0.0, 1).iter().step_by(7) {
            let pixel = it.pixel + Vector2::new(random.normal(), random.normal()) * noise;
            let placed = map.place(&pixel, &(Matrix2::identity() * noise * noise)).unwrap();
            let off = placed.point - it.point;
            normalised += off.dot(&(placed.covariance.try_inverse().unwrap() * off));
            n += 2.0;
        }
    }
    let mean: f64 = normalised / n;
    assert!((0.7..1.4).contains(&mean), "normalised error squared {mean}, expected 1");
}

#[test]
fn where_a_wall_that_bends_showed_no_dots_its_map_says_that_it_does_not_know() {
    let camera = camera(-0.1);
    let all = bent_points(&camera, 3.0, 0.09, 0.1, 1);
    // The corner that is missing.
    let is_there = |it: &&PlanePoint| it.point.x > 0.7 || it.point.y > 0.6;
    let (seen, missing): (Vec<&PlanePoint>, Vec<&PlanePoint>) = all.iter().partition(is_there);
    assert!(missing.len() > 8, "{}", missing.len());
    let seen: Vec<PlanePoint> = seen.into_iter().copied().collect();
    let map = PlaneMap::fit_bent(SIZE, &seen, WALL).unwrap();
    let place = |it: &PlanePoint| map.place(&it.pixel, &(Matrix2::identity() * 0.01)).unwrap();
    let sigma = |it: &PlanePoint| place(it).covariance.trace().sqrt();
    let known = foveate_estimation::statistics::median(&seen.iter().map(sigma).collect::<Vec<_>>()).unwrap();
    let mut normalised = 0.0;
    for it in &missing {
        let off = place(it).point - it.point;
        normalised += off.dot(&(place(it).covariance.try_inverse().unwrap() * off));
    }
    let farthest = missing.iter().max_by(|a, b| sigma(a).total_cmp(&sigma(b))).unwrap();
    assert!(sigma(farthest) > 10.0 * known, "{} m where nothing was seen, {known} m elsewhere", sigma(farthest));
    let mean = normalised / (2 * missing.len()) as f64;
    assert!(mean < 4.0, "normalised error squared {mean} where nothing was seen");
}

#[test]
fn dots_seen_wrongly_do_not_bend_a_wall_that_bends() {
    let camera = camera(-0.1);
    let mut seen = bent_points(&camera, 3.0, 0.09, 0.05, 1);
    for it in seen.iter_mut().step_by(9) {
        it.pixel.x += 60.0;
    }
    let map = PlaneMap::fit_bent(SIZE, &seen, WALL).unwrap();
    let found = errors(&map, &camera, 3.0);
    assert!(found.0 < 2e-4 && found.1 < 1e-3, "{found:?} m");
}

#[test]
fn derivatives_are_those_of_the_map_where_it_bends() {
    let map = PlaneMap::fit_bent(SIZE, &bent_points(&camera(-0.2), 3.0, 0.09, 0.1, 1), WALL).unwrap();
    // Within, and beyond the edge, where shifts go on in a straight line.
    for at in [[0.7, 0.4], [1.3, -0.1]] {
        let by_point = map.pixel_with_jacobian(&at.into()).unwrap().1;
        let pixel = |x: &[f64]| <[f64; 2]>::from(map.pixel(&Point2::new(x[0], x[1])).unwrap().coords).to_vec();
        check_jacobian(pixel, &DMatrix::from_fn(2, 2, |r, c| by_point[(r, c)]), &at, 1e-5);
    }
}

#[test]
fn points_seen_wrongly_do_not_bend_the_map() {
    let camera = camera(-0.1);
    let mut seen = points(&camera, 0.05, 1);
    for it in seen.iter_mut().step_by(9) {
        it.pixel.x += 60.0;
    }
    let map = PlaneMap::fit(SIZE, &seen).unwrap();
    for it in points(&camera, 0.0, 1) {
        assert!((map.pixel(&it.point).unwrap() - it.pixel).norm() < 0.15, "{}", it.pixel);
    }
}

#[test]
fn too_few_points_and_points_on_a_line_are_refused_by_name() {
    let all = points(&camera(0.0), 0.0, 1);
    assert_eq!(PlaneMap::fit(SIZE, &all[..7]), Err(PlaneMapError::TooFew { count: 7, least: LEAST_POINTS }));
    let few = PlaneMap::fit_bent(SIZE, &all[..20], [4.0; 2]);
    assert_eq!(few, Err(PlaneMapError::TooFew { count: 20, least: LEAST_BENT_POINTS }));
    let beside = PlaneMap::fit_bent(SIZE, &all, [1.0, 0.5]).unwrap_err().to_string();
    assert!(beside.contains("the rectangle of 1 m by 0.5 m"), "{beside}");
    let line: Vec<PlanePoint> = all.iter().copied().filter(|it| (it.point.y - 0.45).abs() < 1e-9).collect();
    assert!(matches!(PlaneMap::fit(SIZE, &line), Err(PlaneMapError::OnALine { .. })), "{}", line.len());
    let one = vec![all[0]; 20];
    assert!(matches!(PlaneMap::fit(SIZE, &one), Err(PlaneMapError::OnALine { count: 20, ratio: 0.0 })));
}

#[test]
fn nothing_is_imaged_behind_the_camera_or_above_the_horizon() {
    let mut camera = camera(0.0);
    let eye = nalgebra::Point3::new(0.0, 0.0, -0.5);
    // Nearly along the wall: it sees the horizon.
    camera.camera_from_world = {
        let z = nalgebra::Vector3::new(1.0, 0.0, 0.15).normalize();
        let y = nalgebra::Vector3::y();
        let x = y.cross(&z);
        let rotation = nalgebra::Rotation3::from_matrix_unchecked(Matrix3::from_rows(&[
            x.transpose(),
            y.transpose(),
            z.transpose(),
        ]));
        nalgebra::Isometry3::from_parts(nalgebra::Translation3::from(-(rotation * eye.coords)), rotation.into())
    };
    let grid = (0..40)
        .flat_map(|column| (-20..20).map(move |row| Point2::new(0.5 + 0.1 * f64::from(column), 0.1 * f64::from(row))));
    let seen: Vec<PlanePoint> = grid
        .filter_map(|point| {
            let pixel = camera.sees(&nalgebra::Point3::new(point.x, point.y, 0.0))?;
            Some(PlanePoint { point, pixel, sigma: 0.01 })
        })
        .collect();
    let map = PlaneMap::fit(SIZE, &seen).unwrap();
    assert_eq!(map.pixel(&Point2::new(-3.0, 0.0)), None, "behind the camera");
    let sky = (0..640).map(|column| Point2::new(f64::from(column), 240.0)).filter(|it| map.point(it).is_none()).count();
    assert!((50..600).contains(&sky), "{sky} columns show no wall");
}
