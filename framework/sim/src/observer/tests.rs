//! What an observer sees against what there is.

use super::*;
use crate::camera::{CameraSettings, Renderer};
use crate::lab::wide_cameras;
use crate::world::SceneSettings;
use foveate_messages::Image;

fn world(people: usize) -> World {
    World::new(SceneSettings { people, people_enter_s: 0.0, ..SceneSettings::default() }, &Random::new(1))
}

fn quiet() -> ObserverSettings {
    ObserverSettings { missed: 0.0, clutter: 0.0, spot_width_px: 0.0, ..ObserverSettings::default() }
}

fn observer(number: usize, settings: &ObserverSettings) -> Observer {
    let (_, camera) = wide_cameras().swap_remove(number);
    Observer::new(&camera, CameraId(number as u16), settings, &Random::new(4).fork(&format!("camera {number}")))
}

fn seen(observer: &mut Observer, world: &World, time_s: f64) -> Vec<Feature> {
    let mut features = Features::default();
    observer.look(world, Time::from_s(time_s), &mut features);
    assert_eq!(features.camera, observer.id);
    assert!(features.list.is_sorted_by(|a, b| (a.centre.y, a.centre.x) <= (b.centre.y, b.centre.x)));
    features.list
}

/// One light 1 m above the floor, and others beside it at the given distances along x [m].
fn row(distances: &[f64]) -> Vec<(TargetId, Point3<f64>)> {
    distances.iter().zip(0..).map(|(x, i)| (TargetId(i), Point3::new(*x, 0.2, 1.0))).collect()
}

#[test]
fn errors_are_as_large_as_the_covariance_says() {
    let mut observer = observer(2, &ObserverSettings { noise_px: 0.4, ..quiet() });
    let lights = row(&[0.0]);
    let truth = observer.camera.sees(&lights[0].1).unwrap();
    let (n, mut sums, mut features) = (20_000, [0.0; 3], Features::default());
    for i in 0..n {
        observer.look_at(&lights, Time::from_s(f64::from(i) / 60.0), &mut features);
        let [found] = features.list[..] else { panic!("{features:?}") };
        let error = found.centre - truth;
        let normalised = error.dot(&(found.covariance.try_inverse().unwrap() * error));
        sums = [sums[0] + normalised, sums[1] + error.x * error.x, sums[2] + error.y * error.y];
    }
    let [normalised, x, y] = sums.map(|it| it / f64::from(n));
    // Two degrees of freedom; four standard errors of a mean over 20,000.
    assert!((normalised - 2.0).abs() < 0.06, "{normalised}");
    assert!(
        (x.sqrt() - 0.4).abs() < 0.01 && (y.sqrt() - 0.2).abs() < 0.005,
        "{x} {y}: pixels are twice as high as wide"
    );
}

#[test]
fn what_is_close_together_is_one_feature_that_spans_it() {
    let mut observer = observer(2, &ObserverSettings { noise_px: 0.001, spot_width_px: 6.0, ..quiet() });
    let (lights, mut features) = (row(&[0.0, 0.02, 0.6]), Features::default());
    observer.look_at(&lights, Time::ZERO, &mut features);
    assert_eq!(features.list.len(), 2, "{features:?}");
    let pixels: Vec<_> = lights.iter().map(|it| observer.camera.sees(&it.1).unwrap()).collect();
    let middle = nalgebra::center(&pixels[0], &pixels[1]);
    let joined = features.list.iter().find(|it| (it.centre - middle).norm() < 0.1).unwrap();
    let half = pixels[0] - middle;
    assert!((joined.covariance.m11 - half.x * half.x).abs() < 1e-3, "{joined:?} {half}");
    let alone = features.list.iter().find(|it| (it.centre - pixels[2]).norm() < 0.1).unwrap();
    assert!(alone.covariance.m11 < 1e-5);
}

#[test]
fn misses_clutter_and_hidden_lights_come_as_often_as_said() {
    let count = |settings: &ObserverSettings, lights: &[(TargetId, Point3<f64>)]| -> Vec<usize> {
        let (mut observer, mut features) = (observer(2, settings), Features::default());
        (0..12_000)
            .map(|i| {
                observer.look_at(lights, Time::from_s(f64::from(i) / 60.0), &mut features);
                features.list.len()
            })
            .collect()
    };
    let mean = |found: &[usize]| found.iter().sum::<usize>() as f64 / found.len() as f64;
    let lights = row(&[0.0, 0.3]);
    assert_eq!(mean(&count(&quiet(), &lights)), 2.0);
    let missed = mean(&count(&ObserverSettings { missed: 0.2, ..quiet() }, &lights));
    assert!((missed - 1.6).abs() < 0.03, "{missed}");
    let clutter = count(&ObserverSettings { clutter: 3.0, ..quiet() }, &[]);
    let variance = clutter.iter().map(|it| (*it as f64 - 3.0).powi(2)).sum::<f64>() / clutter.len() as f64;
    assert!((mean(&clutter) - 3.0).abs() < 0.08 && (variance - 3.0).abs() < 0.2, "{} {variance}", mean(&clutter));
    let hidden = count(&ObserverSettings { hidden_every_s: 5.0, hidden_lasts_s: 1.0, ..quiet() }, &row(&[0.0]));
    assert!((mean(&hidden) - 0.8).abs() < 0.03, "{}", mean(&hidden));
    let ends = hidden.windows(2).filter(|it| it[0] == 0 && it[1] == 1).count();
    assert!((35..=40).contains(&ends), "a light came back {ends} times in 200 s");
}

#[test]
fn fields_depend_on_their_time_alone() {
    let (world, settings) = (world(2), ObserverSettings::default());
    let (mut forth, mut back) = (observer(5, &settings), observer(5, &settings));
    let times: Vec<f64> = (0..50).map(|i| f64::from(i) * 0.21).collect();
    let one: Vec<_> = times.iter().map(|it| seen(&mut forth, &world, *it)).collect();
    let mut other: Vec<_> = times.iter().rev().map(|it| seen(&mut back, &world, *it)).collect();
    other.reverse();
    assert_eq!(one, other);
    assert!(one.iter().any(|it| it.len() > 3));
}

#[test]
fn glass_bodies_hide_nothing_and_real_ones_much() {
    let (world, mut moment) = (world(2), Moment::default());
    let (mut solid, mut glass) = (observer(3, &quiet()), observer(3, &ObserverSettings { bodies: false, ..quiet() }));
    let (mut n_solid, mut n_glass, mut n_in_view) = (0, 0, 0);
    for step in 0..200 {
        let time = f64::from(step) * 0.1;
        world.at(Time::from_s(time), &mut moment);
        n_in_view += moment.lights().filter(|it| solid.camera.sees(&it.position).is_some()).count();
        n_solid += seen(&mut solid, &world, time).len();
        n_glass += seen(&mut glass, &world, time).len();
    }
    // Noise may push a light at the border out of the picture.
    assert!(n_glass <= n_in_view && n_glass + 20 > n_in_view, "{n_glass} of {n_in_view}");
    assert!((n_glass / 5..n_glass * 4 / 5).contains(&n_solid), "{n_solid} of {n_glass}");
}

/// Both ways of looking at a world agree: a bright pixel lies where the observer finds a light.
#[test]
fn observer_and_picture_agree() {
    let settings = CameraSettings { exposure_ms: 0.01, noise_sigma: 0.0, room_light: 0.0, ..CameraSettings::default() };
    let (world, time) = (world(1), Time::from_s(2.2));
    let mut n_lights = 0;
    for number in 0..18 {
        let mut observer = observer(number, &ObserverSettings { noise_px: 0.001, ..quiet() });
        let (id, random) = (CameraId(number as u16), Random::new(1));
        let mut image = Image::default();
        Renderer::new(&observer.camera, id, &world, &settings, &random).render(&world, time, 0, &mut image);
        for found in seen(&mut observer, &world, 2.2) {
            let place = found.centre.y.round() as usize * 640 + found.centre.x.round() as usize;
            // Lights seen from far behind are dim.
            n_lights += usize::from(image.pixels[place] > 60);
        }
    }
    assert!(n_lights > 60, "only {n_lights} lights are in the pictures too");
}
