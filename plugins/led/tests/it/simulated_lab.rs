//! From pictures to targets in the simulated lab: eighteen cameras without synchronisation, a walking person with eight
//! LEDs, monitors, glints, noise, and a background that was learnt with the person in view.

use foveate::estimation::random::Random;
use foveate::geometry::Camera;
use foveate::messages::{CameraId, Features, Image, Provenance, Targets, Time};
use foveate_led::detector::DetectorSettings;
use foveate_led::led_detector::LedDetector;
use foveate_led::tracker::{IntegratorSettings, Tracker};
use foveate_sim::camera::{CameraSettings, Renderer};
use foveate_sim::lab::{VOLUME_M, lab_calibration};
use foveate_sim::world::{SceneSettings, World};
use nalgebra::Point2;

const DURATION_S: f64 = 5.0;
const RATE_HZ: f64 = 60.0;
/// From here on everything counts: the background has been learnt and all lights have been seen [s].
const SETTLED_S: f64 = 1.5;

/// Renders and searches the fields of one camera.
struct Eye {
    camera: Camera,
    offset_s: f64,
    renderer: Renderer,
    led_detector: LedDetector,
}

#[test]
fn eight_leds_are_eight_targets_and_nothing_else_is() {
    let random = Random::new(2);
    let world = World::new(SceneSettings::default(), &random.fork("world"));
    let mut offsets = random.fork("offsets");
    let eye = |(k, named): (usize, &foveate::scene::calibration::NamedCamera)| Eye {
        camera: named.camera.clone(),
        offset_s: offsets.uniform() / RATE_HZ,
        renderer: Renderer::new(
            &named.camera,
            CameraId(k as u16),
            &world,
            &CameraSettings::default(),
            &random.fork(&named.name),
        ),
        led_detector: LedDetector::new(DetectorSettings::default(), Some(named.camera.image_size), k as u64).unwrap(),
    };
    let mut eyes: Vec<Eye> = lab_calibration().cameras.iter().enumerate().map(eye).collect();
    let cameras = eyes.iter().map(|it| it.camera.clone()).collect();
    let mut tracker = Tracker::new(IntegratorSettings::default(), cameras, Some(VOLUME_M));
    let mut fields: Vec<(Time, usize, u64)> = Vec::new();
    for (k, eye) in eyes.iter().enumerate() {
        let times = (0..(DURATION_S * RATE_HZ) as u64).map(|it| (eye.offset_s + it as f64 / RATE_HZ, it));
        fields.extend(times.map(|(time_s, field)| (Time::from_s(time_s), k, field)));
    }
    fields.sort();

    let (mut image, mut features, mut targets) = (Image::default(), Features::default(), Targets::default());
    let mut identities = vec![Vec::new(); world.n_targets()];
    let (mut n_ghosts, mut n_missed, mut squares, mut n) = (0, 0, 0.0, 0);
    for (time, k, field) in fields {
        let eye = &mut eyes[k];
        eye.renderer.render(&world, time, field, &mut image);
        let later = time - targets.time;
        let predicted: Vec<Point2<f64>> =
            targets.list.iter().filter_map(|it| eye.camera.project(&it.position_after(later))).collect();
        features.camera = CameraId(k as u16);
        eye.led_detector.find(&image, predicted.into_iter(), &mut features).unwrap();
        tracker.observe(time, &features);
        tracker.write(&mut targets);
        if time.as_s() < SETTLED_S {
            continue;
        }
        let truth = world.truth(targets.time).list;
        let mut found = vec![false; truth.len()];
        for target in &targets.list {
            let error = |light: usize| (truth[light].position - target.position).norm();
            let nearest = (0..truth.len()).min_by(|&a, &b| error(a).total_cmp(&error(b))).unwrap();
            if error(nearest) > 0.1 {
                n_ghosts += 1;
                continue;
            }
            found[nearest] = true;
            if !identities[nearest].contains(&target.id) {
                identities[nearest].push(target.id);
            }
            if target.provenance == Provenance::Measured {
                squares += error(nearest).powi(2);
                n += 1;
            }
        }
        n_missed += found.iter().filter(|it| !**it).count();
    }
    let rms_mm = (squares / f64::from(n)).sqrt() * 1e3;
    println!("rms {rms_mm:.2} mm, identities {identities:?}, {:?}", tracker.tally());
    assert_eq!((n_ghosts, n_missed), (0, 0));
    assert!(identities.iter().all(|it| it.len() == 1), "{identities:?}");
    let tally = tracker.tally();
    assert_eq!(tally.initiations - tally.terminated_unconfirmed, 8, "accidents are tentative, and taken back");
    assert!(rms_mm < 2.5, "{rms_mm} mm");
}
