//! Tests of a camera that turns on a head, in a room of its own: walls with a pattern, seen from where the head's axes carry the camera, and a person in red.

use std::sync::Arc;

use foveate::estimation::Random;
use foveate::geometry::Camera;
use foveate::geometry::pan_tilt::Setting;
use foveate_testkit::check_node;
use nalgebra::{Matrix2, Matrix6, Point2, Point3};

use super::*;

const SIZE: [u32; 2] = [192, 144];
/// [rad]
const POSE_ERROR: f64 = 0.003;

fn setup(connected: &[&str]) -> Setup {
    let text = "[calibration]\nlength_unit = \"m\"\n[camera.head-1]\nimage_size_px = [192, 144]\nfocal_px = [170.0, 170.0]\n\
                principal_point_px = [95.5, 71.5]\nposition_m = [0.0, 0.0, 1.5]\ncamera_from_world_wxyz = [0.7071067811865476, 0.7071067811865476, 0.0, 0.0]\n\
                [head.head-1]\npan_axis = { point_m = [0.01, 0.0, -0.05], direction = [0.0, 1.0, 0.0] }\n\
                tilt_axis = { point_m = [0.0, 0.02, -0.03], direction = [1.0, 0.0, 0.0] }\n";
    let calibration = foveate::scene::calibration::Calibration::from_toml(text, std::path::Path::new("test")).unwrap();
    let mut setup = Setup::for_tests();
    setup.connected = connected.iter().map(|it| (*it).to_owned()).collect();
    (setup.calibration, setup.camera) = (Arc::new(calibration), Some(CameraId(0)));
    setup
}

fn settings() -> SilhouetteSettings {
    SilhouetteSettings { learn_frames: 60, min_area_px: 50, background_m: 3.0, ..SilhouetteSettings::default() }
}

/// The room is 6 m wide and deep and 3 m high; the camera stands in its middle.
fn wall(camera: &Camera, pixel: Point2<f64>) -> [f64; 3] {
    let ray = camera.ray(&pixel).unwrap();
    let reach = |axis: usize, low: f64, high: f64| {
        let way = ray.direction[axis];
        let end = if way > 0.0 { high } else { low };
        if way.abs() < 1e-9 { f64::INFINITY } else { (end - ray.origin[axis]) / way }
    };
    let ends = [reach(0, -3.0, 3.0), reach(1, -3.0, 3.0), reach(2, 0.0, 3.0)];
    let axis = (0..3).min_by(|a, b| ends[*a].total_cmp(&ends[*b])).unwrap();
    let at = ray.at(ends[axis]);
    let [u, v] = [at[(axis + 1) % 3], at[(axis + 2) % 3]];
    let wave = (9.0 * u + 2.0).sin() * (7.0 * v + f64::from(axis as u32)).cos()
        + 0.6 * ((23.0 * u - 17.0 * v).sin() + (31.0 * u + 27.0 * v).sin());
    [110.0, 120.0, 95.0].map(|it| it + 22.0 * wave)
}

/// A person of 0.5 by 1.7 m, 2 m away.
const BODY: Point3<f64> = Point3::new(0.3, 2.0, 1.0);

fn is_body(camera: &Camera, pixel: Point2<f64>) -> bool {
    let ray = camera.ray(&pixel).unwrap();
    let at = ray.at((BODY.y - ray.origin.y) / ray.direction.y);
    ray.direction.y > 0.1 && ((at.x - BODY.x) / 0.25).powi(2) + ((at.z - BODY.z) / 0.85).powi(2) < 1.0
}

fn pixels() -> impl Iterator<Item = Point2<f64>> {
    (0..SIZE[1]).flat_map(|y| (0..SIZE[0]).map(move |x| Point2::new(f64::from(x), f64::from(y))))
}

/// A picture from pan and tilt [°], and the pose that the head says.
fn seen(
    setup: &Setup,
    degrees: [f64; 2],
    time: Time,
    is_there: bool,
    random: &mut Random,
) -> (Camera, Image, HeadPose) {
    let head = setup.head_model().unwrap();
    let [pan, tilt] = degrees.map(f64::to_radians);
    let camera = head.model.camera_at(&Setting::new(pan, tilt));
    let mut image = Image { width: SIZE[0], height: SIZE[1], format: PixelFormat::Rgb8, ..Image::default() };
    for pixel in pixels() {
        let colour = if is_there && is_body(&camera, pixel) { [190.0, 50.0, 45.0] } else { wall(&camera, pixel) };
        image.pixels.extend(colour.map(|it| (it + 2.0 * random.normal()).round().clamp(0.0, 255.0) as u8));
    }
    let angles = [pan, tilt].map(|it| it + POSE_ERROR * random.normal());
    let said = head.model.camera_at(&Setting::new(angles[0], angles[1]));
    let pose = HeadPose {
        camera: CameraId(0),
        time,
        angles,
        angles_covariance: Matrix2::identity() * POSE_ERROR.powi(2),
        rates: [0.0; 2],
        zoom: None,
        camera_from_world: said.camera_from_world,
        covariance: Matrix6::identity() * 1e-6,
        age: Interval(0),
    };
    (camera, image, pose)
}

/// A head that has looked around in the empty room from -25° to 25°; and the time.
fn taught(setup: &Setup, random: &mut Random) -> (NodeBench<SilhouetteNode>, f64) {
    let mut bench = NodeBench::<SilhouetteNode>::with_setup(settings(), setup).unwrap();
    for k in 0..60 {
        let time = Time::from_s(f64::from(k) / 10.0);
        let degrees = [-25.0 + 50.0 * f64::from(k % 20) / 19.0, f64::from(k / 20 - 1) * 8.0];
        let (_, image, pose) = seen(setup, degrees, time, false, random);
        bench.feed(&IMAGE, time, image).unwrap();
        bench.feed(&POSE, time, pose).unwrap();
    }
    (bench, 6.0)
}

#[test]
fn node_keeps_the_law_with_what_only_heads_use() {
    check_node::<SilhouetteNode>("background_m = 2.5");
}

#[test]
fn a_person_is_seen_from_a_head_that_turns_and_the_poses_become_better() {
    let setup = setup(&["pose"]);
    let mut random = Random::new(31);
    let (mut bench, mut s) = taught(&setup, &mut random);
    let statuses: Vec<SilhouetteStatus> = bench.outputs(&SILHOUETTE).iter().map(|it| it.value.status).collect();
    assert_eq!(statuses, [SilhouetteStatus::Learning; 60]);
    let (mut overlaps, mut off) = (Vec::new(), [Vec::new(), Vec::new()]);
    for _ in 0..30 {
        s += 0.1;
        let degrees = [random.uniform_in(-6.0, 20.0), random.uniform_in(-7.0, 7.0)];
        let (camera, image, pose) = seen(&setup, degrees, Time::from_s(s), true, &mut random);
        let before = pose.camera_from_world;
        bench.feed(&IMAGE, Time::from_s(s), image).unwrap();
        bench.feed(&POSE, Time::from_s(s), pose).unwrap();
        let found = bench.outputs(&SILHOUETTE).last().unwrap().value.clone();
        assert_eq!(found.status, SilhouetteStatus::Seen, "{degrees:?}");
        let (mut both, mut either) = (0, 0);
        for pixel in pixels() {
            let at = found.window.in_image(&pixel);
            let [x, y] = [at.x, at.y].map(|it| it.round());
            if x < 0.0 || y < 0.0 || x >= f64::from(found.width) || y >= f64::from(found.height) {
                continue;
            }
            let (truly, said) = (is_body(&camera, pixel), found.is_body(x as usize, y as usize));
            both += u32::from(truly && said);
            either += u32::from(truly || said);
        }
        overlaps.push(f64::from(both) / f64::from(either));
        let after = bench.outputs(&ALIGNED).last().unwrap().value.camera_from_world;
        for (off, pose) in off.iter_mut().zip([before, after]) {
            off.push(pose.rotation.angle_to(&camera.camera_from_world.rotation));
        }
    }
    overlaps.sort_by(f64::total_cmp);
    assert!(overlaps[0] > 0.9 && overlaps[15] > 0.95, "overlap {overlaps:.3?}");
    let [before, after] = off.map(|it| it.iter().sum::<f64>() / it.len() as f64);
    assert!(after < 0.4 * before, "poses are {after} rad off, {before} before");
    let figures = bench.finish().unwrap().figures;
    assert!(figures["silhouette.aligned.head-1"] > 0.95 && figures["silhouette.views.head-1"] > 4.0);
}

#[test]
fn what_was_never_looked_at_is_left_out_or_said_not_to_be_known() {
    let setup = setup(&["pose"]);
    let mut random = Random::new(32);
    let (mut bench, s) = taught(&setup, &mut random);
    let mut look = |s: f64, pan: f64| {
        let (_, image, pose) = seen(&setup, [pan, 0.0], Time::from_s(s), false, &mut random);
        bench.feed(&IMAGE, Time::from_s(s), image).unwrap();
        bench.feed(&POSE, Time::from_s(s), pose).unwrap();
        bench.outputs(&SILHOUETTE).last().unwrap().value.clone()
    };
    // The picture is 59° wide: at 45° a third of it has never been seen.
    let beyond = look(s + 0.1, 45.0);
    assert!(beyond.width < SIZE[0] * 4 / 5 && beyond.width > SIZE[0] / 2, "{} columns", beyond.width);
    assert_eq!((beyond.status, beyond.n_body), (SilhouetteStatus::Empty, 0));
    let far = look(s + 0.2, 80.0);
    assert_eq!((far.status, far.width), (SilhouetteStatus::Learning, SIZE[0]));
    assert_eq!(bench.outputs(&ALIGNED).len(), 62, "each picture's pose comes out again");
    let remarks = bench.finish().unwrap().remarks.join("; ");
    assert!(remarks.contains("in 1 pictures less than half of the background is known"), "{remarks}");
}

#[test]
fn a_picture_waits_for_its_pose_and_is_a_gap_without() {
    let setup = setup(&["pose"]);
    let mut random = Random::new(33);
    let (mut bench, s) = taught(&setup, &mut random);
    bench.outputs(&SILHOUETTE);
    let [one, two] = [0.1, 0.2].map(|it| Time::from_s(s + it));
    let (_, image, _) = seen(&setup, [0.0, 0.0], one, true, &mut random);
    let (_, next, pose) = seen(&setup, [0.0, 0.0], two, true, &mut random);
    bench.feed(&IMAGE, one, image).unwrap();
    bench.feed(&IMAGE, two, next).unwrap();
    assert_eq!(bench.outputs(&SILHOUETTE).len(), 0);
    bench.feed(&POSE, two, pose).unwrap();
    let times: Vec<Time> = bench.outputs(&SILHOUETTE).iter().map(Stamped::time).collect();
    assert_eq!(times, [two]);
    assert!(bench.gaps(&SILHOUETTE)[0].reason.contains("pose is unknown"));
    assert_eq!(bench.finish().unwrap().figures["silhouette.without_pose.head-1"], 1.0);
}

#[test]
fn what_a_camera_that_turns_has_no_use_for_is_refused() {
    let refused = |settings: SilhouetteSettings, setup: &Setup| {
        SilhouetteNode::new(settings, setup).err().map(|it| it.to_string()).unwrap_or_default()
    };
    let setup = setup(&["pose"]);
    let absorbing = SilhouetteSettings { absorb_frames: 100, ..settings() };
    assert!(refused(absorbing, &setup).contains("expected 0: for a camera that turns"));
    let masked = SilhouetteSettings { masks: vec![vec![[0.0, 0.0], [9.0, 0.0], [0.0, 9.0]]], ..settings() };
    assert!(refused(masked, &setup).contains("found 1 masks, expected none"));
    let pictured = SilhouetteSettings { background: "empty.png".to_owned(), ..settings() };
    assert!(refused(pictured, &setup).contains("one picture is no background for a camera that turns"));
    let fixed = Setup { connected: ["pose".to_owned()].into_iter().collect(), ..Setup::for_tests() };
    assert!(refused(settings(), &fixed).contains("has no head in the calibration"));
}
