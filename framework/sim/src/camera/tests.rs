//! What the renderer of lights promises, tried.

use foveate_geometry::Camera;

use super::*;
use crate::lab::wide_cameras;
use crate::world::{Mirror, SceneSettings};

const SIZE: usize = 640 * 240;

fn world(change: impl Fn(&mut SceneSettings)) -> World {
    let mut settings = SceneSettings { people_enter_s: 0.0, ..SceneSettings::default() };
    change(&mut settings);
    World::new(settings, &Random::new(1))
}

fn camera(number: usize) -> Camera {
    wide_cameras().swap_remove(number).1
}

fn field(world: &World, number: usize, settings: &CameraSettings, time_s: f64) -> Image {
    render(&camera(number), CameraId(number as u16), world, settings, Time::from_s(time_s), &Random::new(2))
}

#[test]
fn a_field_depends_on_its_number_and_time_alone() {
    let (world, settings) = (world(|_| ()), CameraSettings::default());
    let fields = |order: &[u64]| -> Vec<(u64, Image)> {
        let mut renderer = Renderer::new(&camera(3), CameraId(3), &world, &settings, &Random::new(5));
        order
            .iter()
            .map(|&frame| {
                let mut image = Image::default();
                renderer.render(&world, Time::from_s(frame as f64 / 60.0), frame, &mut image);
                (frame, image)
            })
            .collect()
    };
    let (forth, mut back) = (fields(&[0, 1, 2, 300, 301]), fields(&[301, 2, 300, 0, 1]));
    back.sort_by_key(|it| it.0);
    assert!(forth == back);
    assert_eq!(forth[0].1.pixels.len(), SIZE);
    let differ = forth[0].1.pixels.iter().zip(&forth[1].1.pixels).filter(|(a, b)| a != b).count();
    assert!(differ > SIZE / 2, "the noise repeats: only {differ} pixels differ");
}

#[test]
fn leds_appear_where_they_are() {
    // Nothing but LEDs: dark room, no clutter, no noise, a short exposure.
    let world = world(|it| (it.bright_spots, it.monitors, it.glints_hz, it.led_peak) = (0, 0, 0.0, 400.0));
    let settings = CameraSettings {
        room_light: 0.0,
        black_level: 0.0,
        noise_sigma: 0.0,
        exposure_ms: 0.01,
        gain: 0.3,
        ..CameraSettings::default()
    };
    let mut moment = Moment::default();
    let (mut n_checked, mut spread) = (0, [0.0; 2]);
    for (number, time) in (0..18).flat_map(|number| [0.7, 5.3, 9.1].map(|time| (number, time))) {
        let image = field(&world, number, &settings, time);
        let (camera, eye) = (camera(number), camera(number).centre());
        world.at(Time::from_s(time), &mut moment);
        let pixels: Vec<_> =
            moment.lights_seen_from(&eye, 400.0).filter_map(|it| Some((camera.sees(&it.position)?, it))).collect();
        for (pixel, light) in &pixels {
            let alone = pixels.iter().filter(|(other, _)| (other - pixel).norm() < 16.0).count() == 1;
            let inside = (8.0..631.0).contains(&pixel.x) && (8.0..231.0).contains(&pixel.y);
            if !alone || !inside || light.brightness < 150.0 {
                continue;
            }
            let (mut sum, mut moments) = (0.0, [0.0; 2]);
            for y in pixel.y as usize - 3..=pixel.y as usize + 4 {
                for x in pixel.x as usize - 6..=pixel.x as usize + 7 {
                    let weight = f64::from(image.pixels[y * 640 + x]);
                    sum += weight;
                    moments[0] += weight * x as f64;
                    moments[1] += weight * y as f64;
                }
            }
            for (i, value) in image.pixels.iter().enumerate() {
                let aside = [(i % 640) as f64 - pixel.x, (i / 640) as f64 - pixel.y];
                if aside[0].abs() < 6.0 && aside[1].abs() < 3.0 {
                    (0..2).for_each(|axis| spread[axis] += f64::from(*value) / sum * aside[axis].powi(2));
                }
            }
            let error = [moments[0] / sum - pixel.x, moments[1] / sum - pixel.y];
            assert!(error[0].abs() < 0.1 && error[1].abs() < 0.1, "camera {number} at {time} s: {error:?} px");
            n_checked += 1;
        }
    }
    assert!(n_checked > 100, "only {n_checked} spots were looked at");
    // Round on the sensor: half as many rows as columns. A pixel's own extent adds 1/12 to each variance.
    let [across, down] = spread.map(|it| (it / f64::from(n_checked) - 1.0 / 12.0).sqrt());
    assert!((across - 1.3).abs() < 0.1 && (down - 0.65).abs() < 0.1, "{across} {down}");
}

#[test]
fn exposure_smears_what_moves() {
    let world = world(|it| (it.bright_spots, it.monitors, it.glints_hz, it.speed_m_s) = (0, 0, 0.0, 2.0));
    let sharp = CameraSettings {
        room_light: 0.0,
        black_level: 0.0,
        noise_sigma: 0.0,
        exposure_ms: 0.01,
        gain: 0.2,
        ..CameraSettings::default()
    };
    let smeared = CameraSettings { exposure_ms: 16.0, blur_samples: 16, ..sharp.clone() };
    let lit = |settings: &CameraSettings| -> usize {
        let images = (0..6).map(|i| field(&world, i * 3, settings, 1.7 * i as f64));
        images.map(|image| image.pixels.iter().filter(|it| **it > 4).count()).sum()
    };
    let (sharp, smeared) = (lit(&sharp), lit(&smeared));
    assert!(smeared > sharp * 5 / 4, "{smeared} pixels lit instead of {sharp}");
}

#[test]
fn gray_levels_are_saturated_and_as_coarse_as_asked() {
    let world = world(|_| ());
    let bright = field(&world, 0, &CameraSettings { gain: 20.0, ..CameraSettings::default() }, 1.0);
    assert!(bright.pixels.iter().filter(|it| **it == 255).count() > SIZE / 2);
    let coarse = field(&world, 0, &CameraSettings { bits: 3, black_level: 0.0, ..CameraSettings::default() }, 1.0);
    let levels = [0, 36, 73, 109, 146, 182, 219, 255];
    assert!(coarse.pixels.iter().all(|it| levels.contains(it)));
    assert!(levels.iter().filter(|it| coarse.pixels.contains(it)).count() > 5);
}

#[test]
fn bright_spots_shine_where_they_are() {
    let settings = CameraSettings { noise_sigma: 0.0, ..CameraSettings::default() };
    let with = world(|it| (it.people, it.monitors, it.glints_hz, it.bright_spots) = (0, 0, 0.0, 20));
    let without = world(|it| (it.people, it.monitors, it.glints_hz, it.bright_spots) = (0, 0, 0.0, 0));
    let (lit, dark) = (field(&with, 0, &settings, 0.0), field(&without, 0, &settings, 0.0));
    let seen: Vec<_> = with.bright_spots().iter().filter_map(|spot| camera(0).sees(&spot.position)).collect();
    assert!(seen.len() > 3);
    for pixel in seen {
        let place = pixel.y.round() as usize * 640 + pixel.x.round() as usize;
        assert!(lit.pixels[place] > dark.pixels[place], "nothing shines at {pixel}");
    }
}

#[test]
fn reflections_and_halos_add_light_where_they_should() {
    let settings = CameraSettings { noise_sigma: 0.0, exposure_ms: 0.01, ..CameraSettings::default() };
    let plain = world(|it| (it.monitors, it.glints_hz) = (0, 0.0));
    let shiny = world(|it| (it.monitors, it.glints_hz, it.reflections) = (0, 0.0, 0.2));
    let (mut moment, mut n_brighter) = (Moment::default(), 0);
    shiny.at(Time::from_s(1.4), &mut moment);
    for number in 0..18 {
        let [before, after] = [&plain, &shiny].map(|it| field(it, number, &settings, 1.4));
        assert!(before.pixels.iter().zip(&after.pixels).all(|(a, b)| a <= b));
        let eye = camera(number).centre();
        for light in moment.reflections_seen_from(&eye, &Mirror::FLOOR, 800.0, 0.2) {
            assert!(light.position.z < 0.0);
            let Some(pixel) = camera(number).sees(&light.position) else { continue };
            let place = pixel.y.round() as usize * 640 + pixel.x.round() as usize;
            n_brighter += usize::from(after.pixels[place] > before.pixels[place]);
        }
        let blooming = field(&plain, number, &CameraSettings { bloom: 0.1, ..settings.clone() }, 1.4);
        assert!(before.pixels.iter().zip(&blooming.pixels).all(|(a, b)| a <= b));
    }
    assert!(n_brighter > 20, "{n_brighter} reflections are brighter than the floor");
}

#[test]
fn monitors_change_and_the_rest_of_an_empty_room_does_not() {
    let world = world(|it| (it.people, it.glints_hz) = (0, 0.0));
    let settings = CameraSettings { noise_sigma: 0.0, ..CameraSettings::default() };
    let (one, other) = (field(&world, 0, &settings, 0.0), field(&world, 0, &settings, 20.004));
    let changed = one.pixels.iter().zip(&other.pixels).filter(|(a, b)| a != b).count();
    assert!((200..SIZE / 50).contains(&changed), "{changed} pixels changed");
}

/// A camera on a head that was told to go far to the left at full speed, at 0 s.
fn turning(camera: &Camera) -> HeadMotion {
    use crate::head::{Axes, AxesSettings, HeadSettings, LineFaults, LineHead, LineSettings};
    let head = LineHead::serial(&HeadSettings::default(), &LineSettings::default(), LineFaults::default(), 1);
    let motion = HeadMotion::new(CameraId(0), head.unwrap(), Axes::new(&AxesSettings::default()).carrying(camera));
    let left = [0x81, 0x01, 0x06, 0x02, 0x18, 0x14, 0xF, 0xC, 0x9, 0x0, 0, 0, 0, 0, 0xFF];
    motion.line().device().write(Time::ZERO, &left);
    motion
}

fn field_on(motion: &HeadMotion, world: &World, settings: &CameraSettings, time_s: f64) -> Image {
    let mut image = Image::default();
    let mut renderer = Renderer::on_head(&camera(0), CameraId(0), settings, &Random::new(2));
    renderer.render_on(motion, &TrueCamera::from(&camera(0)), world, Time::from_s(time_s), 0, &mut image);
    image
}

#[test]
fn a_head_at_rest_shows_what_a_camera_without_one_sees_but_for_soft_edges() {
    let lit = world(|it| it.glints_hz = 0.0);
    let settings = CameraSettings { noise_sigma: 0.0, ..CameraSettings::default() };
    let (still, on_head) = (field(&lit, 0, &settings, 0.1), field_on(&turning(&camera(0)), &lit, &settings, 0.1));
    let differences = still.pixels.iter().zip(&on_head.pixels).map(|(a, b)| a.abs_diff(*b));
    let far = differences.clone().filter(|it| *it > 25).count();
    let mean = differences.map(f64::from).sum::<f64>() / SIZE as f64;
    // The texture of the room is up to 4.5 gray levels up and down.
    assert!(far < SIZE / 25 && mean < 5.0, "{far} pixels, {mean} gray levels on average");
    // In the dark there are no edges: lights and people are the same.
    let dark = world(|it| (it.monitors, it.glints_hz) = (0, 0.0));
    let settings = CameraSettings { room_light: 0.0, ..settings };
    let (still, on_head) = (field(&dark, 0, &settings, 0.1), field_on(&turning(&camera(0)), &dark, &settings, 0.1));
    assert!(still.pixels.iter().zip(&on_head.pixels).all(|(a, b)| a.abs_diff(*b) <= 1));
    assert!(still.pixels.iter().any(|it| *it > 60), "there is something to see");
}

#[test]
fn a_head_that_turns_while_light_is_gathered_smears_lights_along_its_way() {
    let world = world(|it| (it.bright_spots, it.monitors, it.glints_hz) = (0, 0, 0.0));
    let dark = CameraSettings {
        room_light: 0.0,
        black_level: 0.0,
        noise_sigma: 0.0,
        exposure_ms: 0.01,
        blur_samples: 20,
        gain: 1.0,
        ..CameraSettings::default()
    };
    let smeared = CameraSettings { exposure_ms: 20.0, ..dark.clone() };
    let motion = turning(&camera(0));
    let lit = |settings: &CameraSettings, time_s: f64| {
        field_on(&motion, &world, settings, time_s).pixels.iter().filter(|it| **it > 4).count() as f64
    };
    // At 0.1 s the head stands and only people move; at 0.6 s it turns by 80 °/s: 20 ms are 1.6°, about a dozen pixels.
    let [rest, turning] = [0.1, 0.6].map(|time_s| lit(&smeared, time_s) / lit(&dark, time_s));
    assert!(rest < 1.3 && turning > 1.6, "{rest} {turning}");
}
