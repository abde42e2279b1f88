//! How soon a bumped camera is named among the eighteen of the simulated lab, and how often an unmoved camera is reported.
//!
//! `cargo bench -p foveate-led --bench camera_watch`; `-- 3600` for six quiet hours instead of one.

use std::sync::Arc;

use foveate::estimation::random::Random;
use foveate::messages::{CameraId, Features, Targets, Time};
use foveate_led::camera_watch::{CameraWatchSettings, Watch};
use foveate_led::tracker::{IntegratorSettings, Tracker};
use foveate_sim::bump::BumpSettings;
use foveate_sim::lab::{VOLUME_M, lab_calibration};
use foveate_sim::observer::{Observer, ObserverSettings};
use foveate_sim::world::{SceneSettings, World};

const RATE_HZ: f64 = 60.0;
const BUMP_AT_S: f64 = 10.2;

/// What the watch reported in `lasts_s` of a person walking, with a bump of camera `bumped`.
fn watched(seed: u64, lasts_s: f64, bumped: Option<(usize, [f64; 3])>) -> Watch {
    let random = Random::new(seed);
    let world = World::new(SceneSettings::default(), &random.fork("world"));
    let calibration = lab_calibration();
    let models: Vec<_> = calibration.cameras.iter().map(|it| it.camera.clone()).collect();
    let settings = ObserverSettings { noise_px: 0.15, clutter: 0.5, ..ObserverSettings::default() };
    let mut observers: Vec<Observer> = Vec::new();
    for (index, named) in calibration.cameras.iter().enumerate() {
        observers.push(Observer::new(&named.camera, CameraId(index as u16), &settings, &random.fork(&named.name)));
    }
    let mut offsets = random.fork("offsets");
    let offsets: Vec<f64> = models.iter().map(|_| offsets.uniform() / RATE_HZ).collect();
    let mut order: Vec<usize> = (0..models.len()).collect();
    order.sort_by(|a, b| offsets[*a].total_cmp(&offsets[*b]));
    let mut watch = Watch::new(CameraWatchSettings::default().options(), models.clone());
    let mut tracker = Tracker::new(IntegratorSettings::default(), models.clone(), Some(VOLUME_M));
    for frame in 0..(lasts_s * RATE_HZ) as u64 {
        for &camera in &order {
            let time = Time::from_s(offsets[camera] + frame as f64 / RATE_HZ);
            if let Some((which, [pitch_mrad, yaw_mrad, roll_mrad])) = bumped
                && which == camera
                && time.as_s() >= BUMP_AT_S
                && time.as_s() < BUMP_AT_S + 1.0 / RATE_HZ
            {
                let named = &calibration.cameras[camera];
                let bump =
                    BumpSettings { camera: named.name.clone(), at_s: BUMP_AT_S, yaw_mrad, pitch_mrad, roll_mrad };
                let turned = bump.turned(&named.camera);
                observers[camera] =
                    Observer::new(&turned, CameraId(camera as u16), &settings, &random.fork(&named.name));
            }
            let (mut features, mut targets) = (Features::default(), Targets::default());
            observers[camera].look(&world, time, &mut features);
            tracker.observe(time, &features);
            tracker.write(&mut targets);
            watch.add_features(time, Arc::new(features));
            watch.add_targets(Arc::new(targets));
        }
    }
    watch.finish();
    watch
}

fn main() {
    let quiet_s = std::env::args().filter_map(|it| it.parse::<f64>().ok()).next_back().unwrap_or(600.0);
    println!(
        "18 cameras, one person with 8 lights, 0.15 px, 0.5 wrong features a picture; bump of one camera at {BUMP_AT_S} s"
    );
    println!(
        "{:>6} {:>6} {:>8} {:>10} {:>11} {:>16} {:>14}",
        "mrad", "px", "named", "median s", "slowest s", "size error mrad", "others reported"
    );
    for mrad in [0.5, 1.0, 2.0, 5.0, 20.0] {
        let (mut delays, mut errors, mut shifts, mut others) = (Vec::new(), Vec::new(), Vec::new(), 0);
        let cameras: Vec<usize> = (0..18).step_by(2).collect();
        for (index, &camera) in cameras.iter().enumerate() {
            let axis = [[0.2, 0.97, 0.1], [0.9, -0.4, 0.2], [-0.3, -0.9, 0.3]][index % 3];
            let norm = axis.iter().map(|it: &f64| it * it).sum::<f64>().sqrt();
            let watch = watched(index as u64 + 1, 30.0, Some((camera, axis.map(|it| it * mrad / norm))));
            let found = watch.bumps().iter().find(|it| it.cameras == [camera]);
            for other in watch.bumps().iter().filter(|it| Some(*it) != found) {
                others += 1;
                println!(
                    "        beside camera {camera}: {:?} at {:.1} s, {:.1} mrad, {:.2} px, {:.1} standard deviations",
                    other.cameras,
                    other.at.as_s(),
                    other.turn.norm() * 1e3,
                    other.shift_px,
                    other.sigmas
                );
            }
            delays.extend(found.map(|it| it.detected_at.as_s() - BUMP_AT_S));
            errors.extend(found.map(|it| (it.turn.norm() * 1e3 - mrad).abs()));
            shifts.extend(found.map(|it| it.shift_px));
        }
        let middle = |list: &mut Vec<f64>| {
            list.sort_by(f64::total_cmp);
            list.get(list.len() / 2).copied().unwrap_or(f64::NAN)
        };
        println!(
            "{mrad:>6} {:>6.2} {:>8} {:>10.1} {:>11.1} {:>16.2} {others:>14}",
            middle(&mut shifts),
            format!("{}/{}", delays.len(), cameras.len()),
            middle(&mut delays),
            delays.last().copied().unwrap_or(f64::NAN),
            middle(&mut errors)
        );
    }
    let (mut alone, mut undecided, mut observations, mut turns, mut largest) = (0, 0, 0, 0, 0.0_f64);
    for seed in 101..107 {
        let quiet = watched(seed, quiet_s, None);
        alone += quiet.bumps().iter().filter(|it| it.cameras.len() == 1).count();
        undecided += quiet.bumps().iter().filter(|it| it.cameras.len() > 1).count();
        observations += quiet.observations().iter().sum::<u64>();
        turns += quiet.rows().len();
        largest = quiet.rows().iter().map(|it| it.sigmas).filter(|it| it.is_finite()).fold(largest, f64::max);
    }
    println!(
        "quiet, 6 seeds of {quiet_s} s: {alone} accusations, {undecided} undecided, {observations} observations, {turns} turns"
    );
    println!(
        "largest change seen: {largest:.1} standard deviations (reported from {} on)",
        CameraWatchSettings::default().sigmas
    );
}
