//! What points promise, tried.

use std::sync::Arc;

use foveate::scene::{Calibration, LengthUnit, NamedCamera};
use nalgebra::{Point3, Vector3};

use super::*;
use crate::pair::tests::rig;

fn setup() -> Setup {
    let (camera, projector) = rig();
    let named = |name: &str, camera: Camera| NamedCamera { name: name.to_owned(), camera };
    let cameras = vec![named("camera", camera), named("projector", projector)];
    let calibration = Calibration::new(cameras, LengthUnit::Metre, String::new()).unwrap();
    Setup { camera: Some(CameraId(0)), calibration: Arc::new(calibration), ..Setup::for_tests() }
}

/// A slanted wall with a box before it, as the projector lights it.
fn truth(x: f64, y: f64) -> (Point3<f64>, Vector3<f64>) {
    let (camera, _) = rig();
    let ray = camera.ray(&Point2::new(x, y)).unwrap();
    let (normal, offset) = match (250.0..330.0).contains(&x) && (180.0..260.0).contains(&y) {
        true => (Vector3::new(0.0, 0.1, -1.0).normalize(), -1.4),
        false => (Vector3::new(0.4, -0.1, -1.0).normalize(), -1.8),
    };
    let depth = offset / normal.dot(&ray.direction.into_inner());
    (ray.at(depth), normal)
}

fn map(noise: f64) -> ProjectorMap {
    let (_, projector) = rig();
    let mut random = foveate::estimation::random::Random::new(5);
    let mut map = ProjectorMap { projector_size: [1024, 768], width: 640, height: 480, ..ProjectorMap::default() };
    for at in 0..640 * 480 {
        let lit = projector.project(&truth((at % 640) as f64, (at / 640) as f64).0).unwrap();
        let one = |it: f64, random: &mut foveate::estimation::random::Random| (it + noise * random.normal()) as f32;
        let coordinate = [one(lit.x, &mut random), one(lit.y, &mut random)];
        map.push(ProjectorSample { coordinate, sigma: [noise as f32; 2] });
    }
    map
}

#[test]
fn node_keeps_its_promises() {
    foveate_testkit::check_node::<Triangulator>("max_misfit_px = 3.0");
}

#[test]
fn a_wall_and_a_box_come_back_with_normals_and_errors_as_large_as_stated() {
    let mut node = Triangulator::new(TriangulatorSettings::default(), &setup()).unwrap();
    let cloud = node.cloud(&map(0.05), Time::ZERO, None, None);
    assert!(cloud.len() > 290_000, "{}", cloud.len());
    let (mut errors, mut turned, mut squares) = (Vec::new(), Vec::new(), 0.0);
    for point in cloud.iter().step_by(7) {
        let (place, normal) = truth(f64::from(point.pixel[0]), f64::from(point.pixel[1]));
        let error = (point.position.cast::<f64>() - place).norm();
        errors.push(error);
        squares += error * error / f64::from(point.covariance.trace());
        turned.push(normal.angle(&point.normal.cast()).to_degrees());
    }
    let median = |list: &mut Vec<f64>| {
        list.sort_by(f64::total_cmp);
        list[list.len() / 2]
    };
    let normalised = (squares / errors.len() as f64).sqrt();
    let (error, angle) = (median(&mut errors), median(&mut turned));
    assert!(error < 3e-4 && angle < 8.0, "{error} m, {angle} degrees");
    assert!((0.7..1.2).contains(&normalised), "{normalised}");
}

#[test]
fn a_cloud_is_the_same_for_any_number_of_threads_and_at_any_place_of_the_camera() {
    let map = map(0.05);
    let made = |threads: usize, before: Option<Camera>| {
        let settings = TriangulatorSettings { threads, min_confidence: 0.9, ..TriangulatorSettings::default() };
        let mut node = Triangulator::new(settings, &setup()).unwrap();
        // A cloud from elsewhere, before: what is kept of the camera holds for its lens alone.
        let here = node.camera.clone();
        node.camera = before.unwrap_or(here.clone());
        node.cloud(&map, Time::ZERO, None, None);
        node.camera = here;
        let cloud = node.cloud(&map, Time::ZERO, None, None);
        (cloud, [node.unmet, node.misfits, node.vague, node.alone, node.points], node.sigmas)
    };
    let (cloud, counts, sigmas) = made(1, None);
    assert!(cloud.len() > 100_000 && counts[3] > 0, "{} {counts:?}", cloud.len());
    for threads in [2, 3, 7, 64] {
        assert!(made(threads, None) == (cloud.clone(), counts, sigmas), "{threads} threads");
    }
    let (camera, _) = rig();
    let moved = Isometry3::translation(0.1, 0.0, 0.02) * camera.camera_from_world;
    assert!(made(2, Some(Camera { camera_from_world: moved, ..camera })).0 == cloud);
}

#[test]
fn points_alone_and_maps_of_other_sizes_are_left_out() {
    let mut node = Triangulator::new(TriangulatorSettings::default(), &setup()).unwrap();
    let whole = map(0.02);
    let mut few = ProjectorMap { samples: Vec::new(), ..whole.clone() };
    for at in 0..640 * 480 {
        let keep = at % 7 == 0 && at / 640 % 7 == 0;
        few.push(if keep { whole.get(at % 640, at / 640) } else { ProjectorSample::NONE });
    }
    assert_eq!(node.cloud(&few, Time::ZERO, None, None).len(), 0);
    assert!(node.alone > 5000);
    let other = ProjectorMap { projector_size: [800, 600], ..whole };
    assert!(node.unfit(&other).unwrap().contains("the projector is 800 x 600 px, expected 1024 x 768 px"));
}

#[test]
fn points_have_the_gray_levels_of_the_white_picture_even_where_it_comes_after_the_map() {
    let setup = Setup { connected: vec!["map".to_owned(), "white".to_owned()], ..setup() };
    let mut bench = NodeBench::<Triangulator>::with_setup(TriangulatorSettings::default(), &setup).unwrap();
    let white = Image { width: 640, height: 480, pixels: vec![77; 640 * 480], ..Image::default() };
    bench.feed(&MAP, Time::ZERO, map(0.05)).unwrap();
    bench.feed(&WHITE, Time::ZERO, white).unwrap();
    let clouds = bench.outputs(&CLOUD);
    assert_eq!(clouds.len(), 1);
    assert_eq!(clouds[0].value.iter().next().unwrap().colour, [77; 3]);
}

#[test]
fn a_pair_in_millimetres_is_told() {
    for (per_metre, is_told) in [(1.0, false), (1000.0, true)] {
        let mut setup = setup();
        let mut calibration = (*setup.calibration).clone();
        for it in &mut calibration.cameras {
            it.camera.camera_from_world.translation.vector *= per_metre;
        }
        setup.calibration = Arc::new(calibration);
        let mut bench = NodeBench::<Triangulator>::with_setup(TriangulatorSettings::default(), &setup).unwrap();
        bench.feed(&MAP, Time::ZERO, map(0.05)).unwrap();
        let remarks = bench.finish().unwrap().remarks.concat();
        assert_eq!(remarks.contains("expected less than 10 m"), is_told, "{remarks}");
    }
}

/// The map with what `of` makes of each pixel's sample and place.
fn changed(whole: &ProjectorMap, of: impl Fn(usize, usize) -> ProjectorSample) -> ProjectorMap {
    let mut map = ProjectorMap { samples: Vec::new(), name: "scan".to_owned(), ..whole.clone() };
    (0..640 * 480).for_each(|at| map.push(of(at % 640, at / 640)));
    map
}

#[track_caller]
fn refused(map: ProjectorMap, expected: &str) {
    let alone = Setup { connected: vec!["map".to_owned()], ..setup() };
    let mut bench = NodeBench::<Triangulator>::with_setup(TriangulatorSettings::default(), &alone).unwrap();
    bench.feed(&MAP, Time::ZERO, map).unwrap();
    assert_eq!(bench.outputs(&CLOUD).len(), 0);
    let gaps = bench.gaps(&CLOUD);
    assert!(gaps[0].reason.contains(expected), "{gaps:?}");
}

#[test]
fn columns_alone_that_are_called_rows_make_no_cloud_and_both_exchanged_are_told() {
    let whole = map(0.05);
    let exchanged = |sample: ProjectorSample| ProjectorSample {
        coordinate: [sample.coordinate[1], sample.coordinate[0]],
        sigma: [sample.sigma[1], sample.sigma[0]],
    };
    let alone = |mut sample: ProjectorSample, axis: usize| {
        sample.coordinate[1 - axis] = f32::NAN;
        sample
    };
    for (axis, expected) in [(0, "`rows` in place of `columns`"), (1, "`columns` in place of `rows`")] {
        refused(changed(&whole, |x, y| alone(exchanged(whole.get(x, y)), axis)), expected);
        let right = changed(&whole, |x, y| alone(whole.get(x, y), axis));
        let node = Triangulator::new(TriangulatorSettings::default(), &setup()).unwrap();
        assert_eq!(node.unfit(&right), None);
    }
    let expected = "`columns` and `rows` in `pattern.order`";
    refused(changed(&whole, |x, y| exchanged(whole.get(x, y))), expected);
}

#[test]
fn pictures_that_are_mirrored_or_turned_make_no_cloud_whichever_coordinates_there_are() {
    let whole = map(0.05);
    for (known, flips, expected) in [
        ([true, true], [true, false], "columns of the projector run the wrong way"),
        ([true, true], [false, true], "are mirrored top to bottom; "),
        ([true, true], [true, true], "are turned by 180 degrees; "),
        ([true, false], [true, false], "are mirrored left to right or turned by 180 degrees"),
        ([true, false], [true, true], "are mirrored left to right or turned by 180 degrees"),
        ([false, true], [false, true], "are mirrored top to bottom or turned by 180 degrees"),
    ] {
        for is_camera in [true, false] {
            let flip = |is: bool, at: usize, side: usize| if is { side - 1 - at } else { at };
            let one = |x: usize, y: usize| {
                let (x, y) = if is_camera { (flip(flips[0], x, 640), flip(flips[1], y, 480)) } else { (x, y) };
                let mut sample = whole.get(x, y);
                for axis in 0..2 {
                    let side = [1023.0, 767.0][axis];
                    let at = sample.coordinate[axis];
                    sample.coordinate[axis] = match (known[axis], !is_camera && flips[axis]) {
                        (false, _) => f32::NAN,
                        (true, true) => side - at,
                        (true, false) => at,
                    };
                }
                sample
            };
            refused(changed(&whole, one), expected);
        }
    }
}

#[test]
fn an_axis_that_tells_no_depth_and_a_lens_that_is_off_are_told() {
    // A projector that stands beside the camera, of which rows alone are known.
    let whole = map(0.05);
    let vague = changed(&whole, |x, y| ProjectorSample {
        coordinate: [f32::NAN, whole.get(x, y).coordinate[1]],
        sigma: [f32::NAN, 3.0],
    });
    refused(vague, "rows alone do not determine depth");
    let mut bench = NodeBench::<Triangulator>::with_setup(TriangulatorSettings::default(), &setup()).unwrap();
    let white = Image { width: 640, height: 480, pixels: vec![77; 640 * 480], ..Image::default() };
    // As at the rim of a lens that is not calibrated.
    let off = changed(&whole, |x, y| {
        let mut sample = whole.get(x, y);
        sample.coordinate[1] += if x < 100 { 8.0 } else { 0.0 };
        sample
    });
    bench.feed(&WHITE, Time::ZERO, white).unwrap();
    bench.feed(&MAP, Time::ZERO, off).unwrap();
    assert_eq!(bench.outputs(&CLOUD).len(), 1);
    let said = bench.finish().unwrap().remarks.concat();
    assert!(said.contains("scan: at 16 % of the pixels column and row"), "{said}");
}

#[test]
fn rays_that_do_not_meet_are_told_rather_than_an_empty_cloud() {
    let whole = map(0.05);
    // Lit from where the projector would have to stand on the other side.
    let beyond = changed(&whole, |x, y| {
        let mut sample = whole.get(x, y);
        sample.coordinate = [sample.coordinate[0] + 600.0, f32::NAN];
        sample
    });
    refused(beyond, "at 307200 pixels the rays of camera and projector do not meet");
}

#[test]
fn a_map_that_mostly_does_not_fit_makes_no_cloud() {
    let mut bench = NodeBench::<Triangulator>::with_setup(TriangulatorSettings::default(), &setup()).unwrap();
    let whole = map(0.05);
    let mut mirrored = ProjectorMap { samples: Vec::new(), ..whole.clone() };
    for at in 0..640 * 480 {
        mirrored.push(whole.get(639 - at % 640, at / 640));
    }
    let white = Image { width: 640, height: 480, pixels: vec![77; 640 * 480], ..Image::default() };
    bench.feed(&WHITE, Time::ZERO, white).unwrap();
    bench.feed(&MAP, Time::ZERO, mirrored).unwrap();
    assert_eq!(bench.outputs(&CLOUD).len(), 0);
    let gaps = bench.gaps(&CLOUD);
    let expected = "100 % of them would if the camera's pictures were mirrored left to right: ";
    assert!(gaps[0].reason.contains(expected), "{gaps:?}");
}

#[test]
fn what_is_too_vague_follows_the_map_within_limits() {
    let of = |median: f32| (0..101).map(|it| median * (it as f32 / 50.0).powi(3)).collect::<Vec<f32>>();
    for (median, expected) in [(5e-5, 5e-4), (3e-4, 9e-4), (5e-3, 2e-3)] {
        assert!((max_sigma(None, &mut of(median)) - expected).abs() < 1e-7, "{median}");
        assert_eq!(max_sigma(Some(1e-4), &mut of(median)), 1e-4);
    }
    assert_eq!(max_sigma(None, &mut []), 5e-4);
}
