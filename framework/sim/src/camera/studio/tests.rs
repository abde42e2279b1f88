//! Pictures of the studio against what geometry and light say.

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Image, PixelFormat, Time};
use nalgebra::{Point2, Point3, Vector3};

use crate::camera::{CameraSettings, PeopleView, Renderer, SensorSettings};
use crate::studio::{LampSettings, StudioSettings};
use crate::truth::TrueCamera;
use crate::world::{SceneSettings, World};

const SIZE: [u32; 2] = [160, 120];

fn world(people: usize, change: impl Fn(&mut StudioSettings)) -> World {
    let mut studio = StudioSettings { texel_mm: 12.0, ..StudioSettings::default() };
    change(&mut studio);
    let settings = SceneSettings {
        people,
        people_enter_s: 0.0,
        led_peak: 0.0,
        glints_hz: 0.0,
        studio: Some(studio),
        ..SceneSettings::default()
    };
    World::new(settings, &Random::new(1))
}

fn plain() -> CameraSettings {
    CameraSettings { noise_sigma: 0.0, black_level: 0.0, blur_px: 0.0, ..CameraSettings::default() }
}

fn picture(world: &World, camera: &Camera, settings: &CameraSettings, time_s: f64, frame: u64) -> Image {
    let mut image = Image::default();
    let mut renderer = Renderer::new(camera, CameraId(0), world, settings, &Random::new(2));
    renderer.render(world, Time::from_s(time_s), frame, &mut image);
    image
}

/// Looks at the first person's middle from `from`.
fn camera_at(world: &World, from: [f64; 3], time_s: f64, focal: f64) -> Camera {
    let middle = world.joints(Time::from_s(time_s)).first().map_or(Point3::new(0.0, 0.0, 0.9), |it| it.1.centres()[2]);
    Camera::look_at(from.into(), middle, SIZE, focal)
}

#[test]
fn joints_are_seen_inside_the_silhouette_and_pixels_around_it_are_nobody() {
    let world = world(1, |_| ());
    let mut view = PeopleView::default();
    for (step, from) in [[2.4, 2.0, 1.5], [-2.5, -1.0, 2.4], [0.3, 3.5, 0.6]].into_iter().enumerate() {
        let time_s = 1.0 + 0.6 * step as f64;
        let camera = camera_at(&world, from, time_s, 130.0);
        view.look(&world, &TrueCamera::from(&camera), Time::from_s(time_s));
        let joints = &world.joints(Time::from_s(time_s))[0].1;
        for (joint, name) in joints.centres().iter().zip(crate::person::JOINT_NAMES) {
            let Some(pixel) = camera.sees(joint) else { continue };
            let place = pixel.y.round() as usize * SIZE[0] as usize + pixel.x.round() as usize;
            assert_eq!(view.seen[place], 1, "{name} at {pixel}");
        }
        // Nobody is wider than a body's surroundings: every seen pixel's line of sight passes within 0.35 m of a joint.
        for (place, _) in view.seen.iter().enumerate().filter(|it| *it.1 != 0) {
            let pixel = Point2::new((place % SIZE[0] as usize) as f64, (place / SIZE[0] as usize) as f64);
            let ray = camera.ray(&pixel).unwrap();
            let off = |joint: &Point3<f64>| (joint - ray.origin).cross(&ray.direction).norm();
            assert!(joints.centres().iter().map(off).fold(f64::INFINITY, f64::min) < 0.35);
        }
        let n_seen = view.seen.iter().filter(|it| **it != 0).count();
        assert!(n_seen > 150, "{n_seen}");
    }
}

#[test]
fn pixels_where_somebody_is_seen_change_when_they_come_and_their_edges_are_mixed() {
    let (empty, full) = (world(0, |it| it.lamps.clear()), world(1, |it| it.lamps.clear()));
    let camera = camera_at(&full, [2.4, 2.0, 1.5], 1.0, 130.0);
    let settings = CameraSettings { exposure_ms: 0.1, colour: true, ..plain() };
    let [empty, full_picture] = [&empty, &full].map(|it| picture(it, &camera, &settings, 1.0, 0));
    assert_eq!(empty.format, PixelFormat::Rgb8);
    let mut view = PeopleView::default();
    view.look(&full, &TrueCamera::from(&camera), Time::from_s(1.0));
    let width = SIZE[0] as usize;
    let (mut n_changed_inside, mut n_inside, mut n_changed_outside) = (0, 0, 0);
    for row in 2..SIZE[1] as usize - 2 {
        for column in 2..width - 2 {
            let place = row * width + column;
            let around = |far: usize| {
                [place - far, place + far, place - far * width, place + far * width].map(|it| view.seen[it] != 0)
            };
            let is_changed = empty.pixels[3 * place..3 * place + 3] != full_picture.pixels[3 * place..3 * place + 3];
            if view.seen[place] != 0 && around(2).iter().all(|it| *it) {
                n_inside += 1;
                n_changed_inside += usize::from(is_changed);
            }
            if view.seen[place] == 0 && around(1).iter().chain(&around(2)).all(|it| !it) {
                n_changed_outside += usize::from(is_changed);
            }
        }
    }
    // Without lamps there are no shadows: outside nothing changes, up to corners of the silhouette.
    assert!(n_inside > 100 && n_changed_inside * 50 > n_inside * 49, "{n_changed_inside} of {n_inside}");
    assert!(n_changed_outside * 5 < n_inside, "{n_changed_outside} beside {n_inside}");
}

#[test]
fn floor_is_as_bright_as_lamp_distance_and_angle_say() {
    // One lamp, nothing from all around; a wide mean levels the carpet out.
    let lamp =
        |position_m: [f64; 3]| LampSettings { position_m, light: 400.0, colour: [1.0; 3], ..LampSettings::default() };
    let mean = |position_m: [f64; 3]| {
        let world = world(0, |it| (it.lamps, it.ambient) = (vec![lamp(position_m)], 0.0));
        let camera = Camera::look_at([0.01, 0.0, 2.5].into(), [0.0, 0.0, 0.0].into(), [64, 64], 400.0);
        let image = picture(&world, &camera, &plain(), 1.0, 0);
        image.pixels.iter().map(|it| f64::from(*it)).sum::<f64>() / image.pixels.len() as f64
    };
    let [near, far, aside] = [[0.0, 0.0, 2.0], [0.0, 0.0, 2.8], [2.0, 0.0, 2.0]].map(mean);
    assert!(near > 40.0, "{near}");
    assert!((near / far - 1.96).abs() < 0.06, "{near} {far}");
    // Twice the square of the distance, and the cosine of 45°.
    assert!((near / aside - 2.828).abs() < 0.1, "{near} {aside}");
}

#[test]
fn shadow_of_a_person_falls_away_from_the_lamp() {
    let time_s = 1.0;
    // Where people are does not depend on lamps.
    let pelvis = world(1, |_| ()).joints(Time::from_s(time_s))[0].1.centres()[2];
    let from = pelvis + Vector3::new(-0.7, -0.5, 2.8 - pelvis.z);
    let lamp = LampSettings { position_m: from.into(), light: 400.0, radius_m: 0.05, ..LampSettings::default() };
    let [empty, full] = [0, 1].map(|people| world(people, |it| (it.lamps, it.ambient) = (vec![lamp.clone()], 30.0)));
    // From the side of the shadow, so that nobody stands before it.
    let camera = Camera::look_at(pelvis + Vector3::new(1.1, -1.4, 1.4), [pelvis.x, pelvis.y, 0.0].into(), SIZE, 110.0);
    let mut view = PeopleView::default();
    view.look(&full, &TrueCamera::from(&camera), Time::from_s(time_s));
    let studio = full.studio().unwrap();
    // Where the line from the lamp through the pelvis meets the floor, and the same to the other side.
    let shade = from + (pelvis - from) * (from.z / (from.z - pelvis.z));
    let opposite = Point3::new(2.0 * pelvis.x - shade.x, 2.0 * pelvis.y - shade.y, 0.0);
    let pixel = |point: &Point3<f64>| camera.sees(point).unwrap().map(|it| it.round() as usize);
    let is_shaded = |point: &Point3<f64>| view.is_shaded(studio, pixel(point).x, pixel(point).y);
    assert!(is_shaded(&shade) && !is_shaded(&opposite));
    let [without, with] = [&empty, &full].map(|it| picture(it, &camera, &plain(), time_s, 0));
    let gray = |image: &Image, point: &Point3<f64>| {
        f64::from(image.pixels[pixel(point).y * SIZE[0] as usize + pixel(point).x])
    };
    assert!(gray(&with, &shade) < 0.6 * gray(&without, &shade), "{} {}", gray(&with, &shade), gray(&without, &shade));
    assert_eq!(gray(&with, &opposite), gray(&without, &opposite));
}

#[test]
fn a_picture_depends_on_its_number_and_time_alone_and_colours_have_noise_of_their_own() {
    let world = world(2, |it| it.chairs = vec![[0.4, 0.2, 30.0]]);
    let settings = CameraSettings {
        colour: true,
        sensor: Some(SensorSettings { readout_ms: 6.0, jpeg_quality: 85, ..SensorSettings::default() }),
        ..CameraSettings::default()
    };
    let camera = Camera::look_at([2.3, 2.0, 2.2].into(), [0.0, 0.0, 0.9].into(), [96, 72], 80.0);
    let pictures = |order: &[u64]| -> Vec<(u64, Image)> {
        let mut renderer = Renderer::new(&camera, CameraId(0), &world, &settings, &Random::new(5));
        let mut one = |frame: u64| {
            let mut image = Image::default();
            renderer.render(&world, Time::from_s(0.5 + frame as f64 / 25.0), frame, &mut image);
            (frame, image)
        };
        order.iter().map(|it| one(*it)).collect()
    };
    let (forth, mut back) = (pictures(&[0, 1, 2, 30]), pictures(&[30, 1, 0, 2]));
    back.sort_by_key(|it| it.0);
    assert!(forth == back);
    assert_eq!(forth[0].1.pixels.len(), 96 * 72 * 3);
}

#[test]
fn a_lamp_that_is_switched_on_lights_the_room_and_people() {
    let world = world(1, |it| {
        it.lamps = vec![LampSettings { from_s: 2.0, ..LampSettings::default() }];
        it.ambient = 20.0;
    });
    let camera = camera_at(&world, [2.4, 2.0, 1.5], 1.0, 110.0);
    let mean = |time_s: f64| {
        let image = picture(&world, &camera, &plain(), time_s, 0);
        image.pixels.iter().map(|it| f64::from(*it)).sum::<f64>() / image.pixels.len() as f64
    };
    let (dark, bright) = (mean(1.9), mean(2.1));
    assert!(bright > 1.5 * dark, "{dark} {bright}");
}

#[test]
fn rows_of_a_rolling_shutter_see_people_at_their_own_times() {
    let world = world(1, |it| it.lamps.clear());
    let time_s = 1.3;
    let camera = camera_at(&world, [2.4, 2.0, 1.2], time_s, 130.0);
    let settings = |readout_ms: f64| CameraSettings {
        exposure_ms: 0.1,
        sensor: Some(SensorSettings {
            readout_ms,
            flicker: 0.0,
            electrons: 0.0,
            gain_spread: 0.0,
            gain_pattern: 0.0,
            dark_pattern: 0.0,
            dark_columns: 0.0,
            vignetting: 0.0,
            coma_px: 0.0,
            ..SensorSettings::default()
        }),
        ..plain()
    };
    let rolled = picture(&world, &camera, &settings(60.0), time_s, 0);
    let last = f64::from(SIZE[1] - 1);
    let width = SIZE[0] as usize;
    let difference = |row: usize, late_s: f64| {
        let global = picture(&world, &camera, &settings(0.0), time_s + late_s, 0);
        let of = |image: &Image| {
            image.pixels[row * width..(row + 1) * width].iter().map(|it| f64::from(*it)).collect::<Vec<_>>()
        };
        of(&rolled).iter().zip(of(&global)).map(|(a, b)| (a - b).abs()).sum::<f64>()
    };
    let (mut own, mut middle) = (0.0, 0.0);
    for row in [30, 45, 75, 90] {
        own += difference(row, (row as f64 / last - 0.5) * 0.06);
        middle += difference(row, 0.0);
    }
    assert!(own < 0.5 * middle, "{own} {middle}");
}

#[test]
fn points_of_an_arm_are_found_and_go_where_their_texture_goes() {
    let arm = crate::studio::ArmSettings { mesh_mm: 8.0, texel_mm: 4.0, ..crate::studio::ArmSettings::default() };
    let settings = SceneSettings { people: 0, arm: Some(arm), ..SceneSettings::default() };
    let world = World::new(settings, &Random::new(4));
    let (before, after) = (world.surfaces(Time::from_s(1.0)), world.surfaces(Time::from_s(1.2)));
    let finder = before.finder(0.01);
    let (vertices, _) = before.mesh(0).unwrap();
    let (mut moved, mut n, mut n_outside) = (0.0_f64, 0, 0);
    for vertex in vertices.iter().skip(60).step_by(37) {
        let (point, off) = finder.nearest(vertex).unwrap();
        assert!(off.abs() < 1e-9);
        assert!((before.place(&point).unwrap() - vertex).norm() < 1e-9);
        let normal = before.normal(&point).unwrap();
        let (_, outside) = finder.nearest(&(vertex + normal * 3e-3)).unwrap();
        n += 1;
        n_outside += i32::from((1.5e-3..3.1e-3).contains(&outside));
        moved = moved.max((after.place(&point).unwrap() - vertex).norm());
    }
    // Inside the bend of the elbow surfaces meet.
    assert!(n > 40 && n_outside * 10 >= n * 9, "{n_outside} of {n}");
    assert!((0.01..0.4).contains(&moved), "{moved}");
    assert!(finder.nearest(&Point3::new(0.0, 0.0, 5.0)).is_none());
    let joints = world.arm_joints(Time::from_s(1.0)).unwrap();
    let [shoulder, elbow, wrist] = joints.places;
    let angle = (elbow - shoulder).angle(&(wrist - elbow));
    assert!((angle - joints.elbow).abs() < 1e-9);
    assert!((joints.places[0] - Point3::new(-0.30, 0.0, 1.20)).norm() < 1e-12);
}
