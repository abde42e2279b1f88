//! Initiations of lights that move, and of many at once.

use foveate::messages::Targets;
use foveate_led::tracker::{IntegratorSettings, Tracker};
use foveate_testkit::lab::{Lab, Light, Lights, ROOM_M};
use nalgebra::{Point3, Vector3};

/// The tracker after it has seen `duration_s` of `lights`.
fn watch(lab: &Lab, settings: IntegratorSettings, duration_s: f64, lights: &impl Lights) -> (Tracker, Targets) {
    let mut tracker = Tracker::new(settings, lab.cameras.clone(), Some(ROOM_M));
    for (time, features) in lab.frames(duration_s, lights) {
        tracker.observe(time, &features);
    }
    let mut targets = Targets::default();
    tracker.write(&mut targets);
    (tracker, targets)
}

/// A light that crosses the room at `speed` [m/s].
fn flying(speed: f64) -> impl Fn(f64) -> [Light; 1] {
    move |t: f64| [Light::at(Point3::new(0.2, -1.0 + speed * t, 1.2))]
}

/// Four cameras at 15 Hz without synchronisation: 17 ms between two that look, on average.
fn slow_lab() -> Lab {
    Lab { rate: 15.0, ..Lab::new(4) }
}

#[test]
fn a_fast_light_is_born_where_its_motion_is_taken_into_account() {
    let lab = slow_lab();
    for speed in [1.5, 3.0] {
        let (tracker, targets) = watch(&lab, IntegratorSettings::default(), 0.3, &flying(speed));
        assert_eq!((tracker.tally().initiations, targets.list.len()), (1, 1), "{speed} m/s: {:?}", tracker.tally());
        let truth = flying(speed)(targets.time.as_s())[0].position;
        assert!((targets.list[0].position - truth).norm() < 0.015, "{speed} m/s: {targets:?}");
        assert!((targets.list[0].velocity - Vector3::y() * speed).norm() < 0.25 * speed, "{speed} m/s: {targets:?}");
    }
    // The paper's rule: lines of different moments meet by luck only.
    let after = |initiation_motion_px: f64| -> f64 {
        let times = (1..=8).map(|seed| {
            let lab = Lab { seed, ..slow_lab() };
            let settings = IntegratorSettings { initiation_motion_px, ..IntegratorSettings::default() };
            let mut tracker = Tracker::new(settings, lab.cameras.clone(), Some(ROOM_M));
            let frames = lab.frames(1.0, &flying(3.0));
            let initiated = frames.iter().find(|(time, features)| {
                tracker.observe(*time, features);
                tracker.n_targets() > 0
            });
            initiated.map_or(1.0, |it| it.0.as_s())
        });
        times.sum::<f64>() / 8.0
    };
    let (moving, still) = (after(40.0), after(0.0));
    assert!(moving < 0.2 && still > 1.5 * moving, "initiated after {moving} s and {still} s");
}

#[test]
fn the_velocity_at_initiation_is_that_of_the_light() {
    let mut known = 0;
    for seed in 1..=8 {
        let lab = Lab { seed, ..slow_lab() };
        let mut tracker = Tracker::new(IntegratorSettings::default(), lab.cameras.clone(), Some(ROOM_M));
        let mut targets = Targets::default();
        for (time, features) in lab.frames(0.5, &flying(3.0)) {
            tracker.observe(time, &features);
            tracker.write(&mut targets);
            if !targets.list.is_empty() {
                break;
            }
        }
        let off = targets.list[0].velocity - Vector3::y() * 3.0;
        let sigma = targets.list[0].covariance.fixed_view::<3, 3>(3, 3).trace().sqrt();
        assert!(off.norm() < 4.0 * sigma, "seed {seed}: {targets:?}");
        known += u32::from(sigma < 0.8 && off.norm() < 1.0);
    }
    assert!(known >= 4, "known of {known} of 8");
}

#[test]
fn many_lights_that_appear_at_once_are_all_born_at_once() {
    let lab = Lab { noise: 0.3, ..Lab::new(12) };
    let grid = |t: f64| -> [Light; 24] {
        std::array::from_fn(|k| {
            let place =
                Point3::new(-0.9 + 0.6 * (k % 4) as f64, -1.0 + 0.9 * (k / 4 % 3) as f64, 0.8 + 0.5 * (k / 12) as f64);
            Light::at(place + Vector3::new(0.0, 0.8 * t, 0.0))
        })
    };
    let (tracker, targets) = watch(&lab, IntegratorSettings::default(), 0.25, &grid);
    let truth = grid(targets.time.as_s());
    for light in truth {
        let near = targets.list.iter().filter(|it| (it.position - light.position).norm() < 0.02).count();
        assert_eq!(near, 1, "{:?}", light.position);
    }
    assert_eq!(targets.list.len(), 24, "{:?}", tracker.tally());
}

#[test]
fn a_light_in_a_hall_of_hundreds_of_cameras_is_born_as_in_a_room() {
    let mut lab = Lab::new(8);
    // Rooms side by side: each camera has partners in its own room, and none elsewhere.
    let room = lab.cameras.clone();
    for k in 1..30 {
        let aside = Vector3::new(20.0 * f64::from(k), 0.0, 0.0);
        lab.cameras.extend(room.iter().map(|it| {
            let mut camera = it.clone();
            camera.camera_from_world.translation.vector -= camera.camera_from_world.rotation * aside;
            camera
        }));
    }
    let lights = |_: f64| [0.0, 160.0, 580.0].map(|x| Light::at(Point3::new(0.2 + x, 0.3, 1.2)));
    let mut tracker = Tracker::new(IntegratorSettings::default(), lab.cameras.clone(), None);
    for (time, features) in lab.frames(0.2, &lights) {
        tracker.observe(time, &features);
    }
    assert_eq!((tracker.tally().initiations, tracker.n_targets()), (3, 3), "{:?}", tracker.tally());
}
