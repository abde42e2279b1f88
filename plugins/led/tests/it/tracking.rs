//! The tracker in a small lab with known truth: identities, accuracy, initiations, deaths.

use foveate::geometry::Camera;
use foveate::messages::{CameraId, Features, Interval, Provenance, TargetId, Targets, Time};
use foveate_led::tracker::{Entry, IntegratorSettings, LateRule, Tracker};
use foveate_testkit::lab::{Lab, Light, ROOM_M as ROOM, Score, ScoreOptions, cameras, feature, person, score};
use nalgebra::{Matrix2, Point2, Point3, Vector3};

fn ms(milliseconds: f64) -> Time {
    Time::ZERO + Interval::from_ms(milliseconds)
}

/// A tracker of the lab's cameras, fed by hand.
struct Rig {
    cameras: Vec<Camera>,
    tracker: Tracker,
}

impl Rig {
    fn new(n_cameras: usize, settings: IntegratorSettings) -> Self {
        let cameras = cameras(n_cameras);
        Self { tracker: Tracker::new(settings, cameras.clone(), Some(ROOM)), cameras }
    }

    /// What camera number `camera` sees of `lights`, without noise.
    fn observation(&self, camera: usize, lights: &[Point3<f64>]) -> Features {
        let list = lights.iter().filter_map(|it| Some(feature(self.cameras[camera].sees(it)?, 0.3))).collect();
        Features { camera: CameraId(camera as u16), list }
    }

    #[track_caller]
    fn see(&mut self, time: Time, camera: usize, lights: &[Point3<f64>]) -> Entry {
        let features = self.observation(camera, lights);
        assert_eq!(features.list.len(), lights.len(), "camera {camera} does not see all of it");
        self.tracker.observe(time, &features)
    }

    /// All cameras in turn see `lights`, from `from` to `to`, each at 60 Hz.
    fn watch(&mut self, from: Time, to: Time, only: &[usize], lights: &[Point3<f64>]) {
        let step = Interval::from_ms(1000.0 / 60.0 / self.cameras.len() as f64);
        let mut time = from;
        let mut camera = 0;
        while time < to {
            let lights = if only.is_empty() || only.contains(&camera) { lights } else { &[] };
            self.see(time, camera, lights);
            time = time + step;
            camera = (camera + 1) % self.cameras.len();
        }
    }

    fn targets(&self) -> Targets {
        let mut targets = Targets::default();
        self.tracker.write(&mut targets);
        targets
    }

    fn ids(&self) -> Vec<u32> {
        self.targets().list.iter().map(|it| it.id.0).collect()
    }
}

/// Settings under which a lost target stays lost, as in the paper.
fn forgetful() -> IntegratorSettings {
    IntegratorSettings { remember_ms: 0.0, ..IntegratorSettings::default() }
}

const SPOT: Point3<f64> = Point3::new(0.2, -0.3, 1.2);

fn walk(lab: &Lab, duration: f64) -> (Score, Tracker) {
    let mut tracker = Tracker::new(IntegratorSettings::default(), lab.cameras.clone(), Some(ROOM));
    let options = ScoreOptions { settled_s: 1.0, step_s: 0.0 };
    let score = score(&lab.frames(duration, &person), options, &person, |time, features, targets| {
        let entry = tracker.observe(time, features);
        tracker.write(targets);
        entry == Entry::Applied
    });
    (score, tracker)
}

/// Eight identities for eight lights, no ghost, no light missed, and an error below `rms_mm`.
#[track_caller]
fn check_walk(lab: &Lab, rms_mm: f64) {
    let (score, tracker) = walk(lab, 8.0);
    let found = format!("{score:?} {:?}", tracker.tally());
    assert_eq!((score.n_identities, score.ghosts, score.missed), (8, 0, 0), "{found}");
    assert!(score.identities.iter().all(|it| it.len() == 1), "{found}");
    assert!(score.rms < rms_mm * 1e-3, "{found}");
    // The covariance is honest: an average of 3 would be perfect; twice that would be a boast.
    assert!((0.8..4.0).contains(&score.consistency), "{found}");
}

#[test]
fn eight_lights_are_eight_identities_without_synchronisation() {
    for seed in 1..=3 {
        check_walk(&Lab { seed, ..Lab::new(18) }, 2.3);
    }
}

#[test]
fn eight_lights_are_eight_identities_with_six_cameras_and_more_noise() {
    for seed in 1..=3 {
        check_walk(&Lab { seed, noise: 0.5, clutter: 0.5, ..Lab::new(6) }, 5.5);
        check_walk(&Lab { seed, noise: 0.5, clutter: 0.5, synchronous: true, ..Lab::new(6) }, 5.5);
    }
}

#[test]
fn clutter_and_hidden_lights_cost_accuracy_but_no_identity() {
    for seed in 1..=3 {
        check_walk(&Lab { seed, clutter: 5.0, ..Lab::new(18) }, 2.3);
        check_walk(&Lab { seed, clutter: 0.5, hidden: 0.3, ..Lab::new(18) }, 2.8);
    }
}

#[test]
fn lights_that_shine_to_one_side_keep_their_identities() {
    for seed in 1..=3 {
        let lab = Lab { seed, clutter: 1.0, hidden: 0.2, directional: true, ..Lab::new(18) };
        let (score, tracker) = walk(&lab, 20.0);
        let found = format!("{score:?} {:?}", tracker.tally());
        // When one camera only sees a wrist for a quarter of a second its depth drifts by more than 0.1 m: not a ghost.
        assert_eq!(score.n_identities, 8, "{found}");
        assert!(score.ghosts < score.samples / 500 && score.missed < score.samples / 500, "{found}");
        assert!(score.rms < 3.5e-3, "{found}");
    }
}

#[test]
fn a_run_repeats_to_the_last_bit_and_the_order_of_features_does_not_matter() {
    let lab = Lab { clutter: 2.0, hidden: 0.2, ..Lab::new(18) };
    let frames = lab.frames(2.0, &person);
    let run = |reversed: bool| {
        let mut tracker = Tracker::new(IntegratorSettings::default(), lab.cameras.clone(), Some(ROOM));
        let mut last = Targets::default();
        for (time, features) in &frames {
            let mut features = features.clone();
            if reversed {
                features.list.reverse();
            }
            tracker.observe(*time, &features);
            tracker.write(&mut last);
        }
        last
    };
    assert_eq!(run(false), run(false));
    assert_eq!(run(false), run(true));
}

#[test]
fn no_initiation_before_three_cameras_agree() {
    let mut rig = Rig::new(6, IntegratorSettings::default());
    rig.see(ms(0.0), 0, &[SPOT]);
    assert_eq!(rig.tracker.n_targets(), 0);
    rig.see(ms(2.0), 2, &[SPOT]);
    assert_eq!(rig.tracker.n_targets(), 0);
    rig.see(ms(4.0), 2, &[]);
    rig.see(ms(20.0), 2, &[SPOT]);
    assert_eq!(rig.tracker.n_targets(), 0, "the same camera twice is no confirmation");
    rig.see(ms(22.0), 4, &[SPOT]);
    let targets = rig.targets();
    assert_eq!(targets.list.len(), 1);
    assert!((targets.list[0].position - SPOT).norm() < 1e-3, "{targets:?}");
    // It may have moved by 22 mm at 1 m/s since the oldest of the three.
    assert!((0.022..0.025).contains(&targets.list[0].position_sigma()), "{}", targets.list[0].position_sigma());
    assert_eq!((targets.time, targets.list[0].provenance), (ms(22.0), Provenance::Measured));
    assert_eq!(targets.list[0].cameras, [CameraId(4)].into_iter().collect());
}

#[test]
fn two_cameras_suffice_where_the_rig_says_so() {
    let mut rig = Rig::new(6, IntegratorSettings { initiation_cameras: 2, ..IntegratorSettings::default() });
    rig.see(ms(0.0), 0, &[SPOT]);
    rig.see(ms(2.0), 2, &[SPOT]);
    assert_eq!(rig.ids(), [0]);
}

#[test]
fn what_a_initiation_explains_takes_part_in_no_other() {
    let mut rig = Rig::new(6, IntegratorSettings { initiation_cameras: 2, ..IntegratorSettings::default() });
    rig.see(ms(0.0), 0, &[SPOT]);
    rig.see(ms(1.0), 1, &[SPOT]);
    assert_eq!(rig.ids(), [0]);
    // A false feature of a third camera, whose line meets the one that camera 0 had to the light.
    let on_that_line = SPOT + (rig.cameras[0].centre() - SPOT) * 0.2;
    rig.see(ms(2.0), 2, &[on_that_line]);
    assert_eq!(rig.tracker.tally().initiations, 1);
}

#[test]
fn stale_features_give_no_initiation() {
    for (wait, initiated) in [(69.0, 1), (71.0, 0)] {
        let mut rig = Rig::new(6, IntegratorSettings::default());
        rig.see(ms(0.0), 0, &[SPOT]);
        rig.see(ms(2.0), 2, &[SPOT]);
        rig.see(ms(wait), 4, &[SPOT]);
        assert_eq!(rig.tracker.n_targets(), initiated, "after {wait} ms");
    }
}

#[test]
fn lines_that_miss_by_more_than_the_tolerance_give_no_initiation() {
    for (miss, initiated) in [(0.010, 1), (0.025, 0)] {
        let mut rig = Rig::new(6, IntegratorSettings::default());
        rig.see(ms(0.0), 0, &[SPOT]);
        rig.see(ms(2.0), 2, &[SPOT]);
        rig.see(ms(4.0), 4, &[SPOT + Vector3::z() * miss]);
        assert_eq!(rig.tracker.n_targets(), initiated, "{miss} m");
    }
}

#[test]
fn few_of_many_onlookers_give_no_initiation() {
    // Three of eighteen cameras agree on a point that the others look at and do not see.
    let mut rig = Rig::new(18, IntegratorSettings::default());
    for camera in 0..18 {
        let lights: &[Point3<f64>] = if [3, 8, 14].contains(&camera) { &[SPOT] } else { &[] };
        rig.see(ms(camera as f64), camera, lights);
    }
    assert_eq!(rig.tracker.tally().initiations, 0);
}

#[test]
fn a_target_few_cameras_agree_on_is_shown_when_it_has_been_confirmed() {
    let mut rig = Rig::new(12, IntegratorSettings::default());
    let mut shown_after = None;
    for k in 0..12 {
        let lights: &[Point3<f64>] = if k % 2 == 0 { &[SPOT] } else { &[] };
        rig.see(ms(k as f64), k, lights);
        if rig.tracker.n_targets() > 0 && shown_after.is_none() {
            shown_after = Some(k);
        }
    }
    // Born by 0, 2 and 4, at a share of 3/5 it is sure; at 3/6 it would have waited for 3 more.
    assert_eq!((rig.tracker.tally().initiations, shown_after), (1, Some(4)));
    let mut rig = Rig::new(12, IntegratorSettings { initiation_sure_share: 0.9, ..IntegratorSettings::default() });
    for k in 0..=9 {
        let lights: &[Point3<f64>] = if k % 2 == 0 { &[SPOT] } else { &[] };
        rig.see(ms(k as f64), k, lights);
        assert_eq!((rig.tracker.tally().initiations, rig.tracker.n_targets()), (u64::from(k >= 4), 0), "{k}");
    }
    rig.see(ms(10.0), 10, &[SPOT]);
    assert_eq!(rig.ids(), [0]);
}

#[test]
fn an_accident_is_taken_back() {
    let mut rig = Rig::new(12, IntegratorSettings::default());
    for camera in [0, 4, 8] {
        rig.see(ms(camera as f64), camera, &[SPOT]);
    }
    assert_eq!(rig.tracker.tally().initiations, 1);
    rig.watch(ms(20.0), ms(158.0), &[99], &[]);
    assert_eq!(rig.tracker.n_targets(), 1);
    rig.watch(ms(158.1), ms(165.0), &[99], &[]);
    assert_eq!((rig.tracker.n_targets(), rig.tracker.tally().terminated_unconfirmed), (0, 1));
}

#[test]
fn a_target_dies_when_unseen_for_too_long_and_its_identity_is_not_used_again() {
    let mut rig = Rig::new(6, forgetful());
    rig.watch(ms(0.0), ms(500.0), &[], &[SPOT]);
    assert_eq!(rig.ids(), [0]);
    let last = rig.tracker.time().unwrap();
    rig.see(last + Interval::from_ms(299.0), 0, &[]);
    assert_eq!(rig.targets().list[0].provenance, Provenance::Predicted);
    assert!(rig.targets().list[0].cameras.is_empty());
    rig.see(last + Interval::from_ms(301.0), 1, &[]);
    assert!(rig.ids().is_empty());
    assert_eq!(rig.tracker.tally().terminated_unseen, 1);
    rig.watch(last + Interval::from_ms(400.0), last + Interval::from_ms(500.0), &[], &[SPOT]);
    assert_eq!(rig.ids(), [1]);
}

#[test]
fn a_target_dies_when_one_camera_only_sees_it_for_too_long() {
    let mut rig = Rig::new(6, forgetful());
    rig.watch(ms(0.0), ms(1000.0), &[], &[SPOT]);
    rig.watch(ms(1000.0), ms(1290.0), &[3], &[SPOT]);
    assert_eq!(rig.ids(), [0]);
    rig.watch(ms(1290.0), ms(1330.0), &[3], &[SPOT]);
    assert!(rig.ids().is_empty());
    assert_eq!((rig.tracker.tally().terminated_single_view, rig.tracker.tally().terminated_unseen), (1, 0));
    // Two cameras are enough to stay alive.
    rig.watch(ms(2000.0), ms(2200.0), &[], &[SPOT]);
    rig.watch(ms(2200.0), ms(4000.0), &[1, 3], &[SPOT]);
    assert_eq!(rig.ids(), [1]);
}

#[test]
fn a_feature_beyond_the_gate_is_not_taken() {
    for (off, used) in [(9.0, true), (11.0, false)] {
        let settings = IntegratorSettings { gate_px: 10.0, gate_sigma: 100.0, ..IntegratorSettings::default() };
        let mut rig = Rig::new(6, settings);
        rig.watch(ms(0.0), ms(200.0), &[], &[SPOT]);
        let before = rig.tracker.tally().used;
        let mut features = rig.observation(2, &[SPOT]);
        features.list[0].centre.x += off;
        rig.tracker.observe(ms(210.0), &features);
        assert_eq!(rig.tracker.tally().used - before, u64::from(used), "{off} px");
    }
}

#[test]
fn cameras_with_slow_clocks_do_not_starve_and_very_late_frames_are_discarded() {
    // [Davis 2002, Figure 35]: one clock is 4 ms ahead, so that all other frames come late by a few milliseconds.
    let mut rig = Rig::new(3, IntegratorSettings { late: LateRule::Apply, ..IntegratorSettings::default() });
    for k in 0..60 {
        let start = 16.0 * k as f64;
        assert_eq!(rig.see(ms(start + 6.0), 0, &[SPOT]), Entry::Applied);
        assert_eq!(rig.see(ms(start + 3.0), 1, &[SPOT]), Entry::Applied);
        assert_eq!(rig.see(ms(start + 4.0), 2, &[SPOT]), Entry::Applied);
        let targets = rig.targets();
        assert_eq!(targets.time, ms(start + 6.0), "late frames are applied as if at the filter's time");
        assert_eq!(targets.list[0].cameras.len(), if k == 0 { 1 } else { 3 });
    }
    let now = rig.tracker.time().unwrap();
    let late = rig.observation(1, &[SPOT]);
    assert_eq!(rig.tracker.observe(now - Interval::from_ms(10.1), &late), Entry::Late);
    assert_eq!(rig.tracker.observe(now - Interval::from_ms(3.0), &late), Entry::Repeated);
    let tally = rig.tracker.tally();
    assert_eq!((tally.late, tally.cameras[1].late, tally.cameras[1].repeated), (2, 1, 1));
    assert_eq!(rig.tracker.time(), Some(now));
}

#[test]
fn a_repeated_frame_counts_once() {
    let mut rig = Rig::new(6, IntegratorSettings::default());
    rig.watch(ms(0.0), ms(100.0), &[], &[SPOT]);
    assert_eq!(rig.see(ms(110.0), 0, &[SPOT]), Entry::Applied);
    let before = (rig.targets(), rig.tracker.tally().used);
    assert_eq!(rig.see(ms(110.0), 0, &[SPOT]), Entry::Repeated);
    assert_eq!((rig.targets(), rig.tracker.tally().used), before);
    assert_eq!(rig.tracker.tally().cameras[0].repeated, 1);
}

#[test]
fn broken_features_are_left_out_and_counted() {
    let mut rig = Rig::new(6, IntegratorSettings::default());
    rig.watch(ms(0.0), ms(100.0), &[], &[SPOT]);
    let mut features = rig.observation(0, &[SPOT]);
    let good = features.list[0];
    for (x, covariance) in [
        (f64::NAN, good.covariance),
        (f64::INFINITY, good.covariance),
        (good.centre.x, Matrix2::new(f64::NAN, 0.0, 0.0, 1.0)),
        (good.centre.x, Matrix2::new(-1.0, 0.0, 0.0, -1.0)),
        (good.centre.x, Matrix2::new(1.0, 5.0, 5.0, 1.0)),
    ] {
        let centre = Point2::new(x, good.centre.y);
        features.list.push(foveate::messages::Feature { centre, covariance, ..good });
    }
    let used = rig.tracker.tally().used;
    assert_eq!(rig.tracker.observe(ms(110.0), &features), Entry::Applied);
    assert_eq!((rig.tracker.tally().used - used, rig.tracker.tally().unusable), (1, 5));
    assert!(rig.targets().list[0].position.coords.iter().all(|it| it.is_finite()));
}

#[test]
fn unknown_cameras_empty_frames_and_no_frame_at_all() {
    let mut rig = Rig::new(6, IntegratorSettings::default());
    assert_eq!(rig.targets(), Targets::default());
    let stranger = Features { camera: CameraId(6), list: Vec::new() };
    assert_eq!(rig.tracker.observe(ms(1.0), &stranger), Entry::UnknownCamera);
    assert_eq!(rig.tracker.time(), None);
    assert_eq!(rig.see(ms(-5.0), 3, &[]), Entry::Applied);
    assert_eq!((rig.targets().time, rig.tracker.n_targets()), (ms(-5.0), 0));
}

#[test]
fn cameras_at_one_place_confirm_nothing() {
    let one = cameras(1).remove(0);
    let mut tracker = Tracker::new(IntegratorSettings::default(), vec![one.clone(), one.clone(), one.clone()], None);
    for k in 0..30 {
        let list = vec![feature(one.sees(&SPOT).unwrap(), 0.3)];
        tracker.observe(ms(5.0 * f64::from(k)), &Features { camera: CameraId(k as u16 % 3), list });
    }
    assert_eq!(tracker.tally().initiations, 0);
}

#[test]
fn lights_behind_every_camera_leave_targets_alone() {
    // Cameras that look outwards: the target's projection does not exist, whatever they report.
    let mut inward = cameras(3);
    for camera in cameras(3) {
        let centre = camera.centre();
        inward.push(Camera::look_at(centre, Point3::new(centre.x * 3.0, centre.y * 3.0, 2.0), [640, 240], 400.0));
    }
    let mut tracker = Tracker::new(IntegratorSettings::default(), inward.clone(), Some(ROOM));
    for (camera, model) in inward.iter().enumerate().take(3) {
        let list = vec![feature(model.sees(&SPOT).unwrap(), 0.3)];
        tracker.observe(ms(camera as f64), &Features { camera: CameraId(camera as u16), list });
    }
    assert_eq!(tracker.n_targets(), 1);
    for camera in 3..6 {
        let list = vec![feature(Point2::new(320.0, 120.0), 0.3)];
        tracker.observe(ms(camera as f64), &Features { camera: CameraId(camera as u16), list });
    }
    assert_eq!((tracker.n_targets(), tracker.tally().used, tracker.tally().initiations), (1, 0, 1));
}

#[test]
fn targets_are_born_in_the_working_volume_only_and_die_outside() {
    let outside = Point3::new(0.0, 0.0, 0.6);
    let low = [[-1.75, -2.5, 1.0], [1.75, 2.5, 2.2]];
    for (volume, margin, initiated) in [(None, 250.0, 1), (Some(low), 250.0, 0), (Some(low), 450.0, 1)] {
        let settings = IntegratorSettings { volume_margin_mm: margin, ..IntegratorSettings::default() };
        let mut rig = Rig::new(6, settings.clone());
        rig.tracker = Tracker::new(settings, rig.cameras.clone(), volume);
        rig.watch(ms(0.0), ms(100.0), &[], &[outside]);
        assert_eq!(rig.tracker.n_targets(), initiated, "{volume:?} {margin}");
    }
    let settings = IntegratorSettings { volume_margin_mm: 100.0, ..IntegratorSettings::default() };
    let mut rig = Rig::new(6, settings.clone());
    rig.tracker = Tracker::new(settings, rig.cameras.clone(), Some(low));
    let mut z = 1.2;
    let mut time = ms(0.0);
    while rig.tracker.tally().terminated_outside == 0 && z > 0.5 {
        rig.watch(time, time + Interval::from_ms(16.0), &[], &[Point3::new(0.0, 0.0, z)]);
        time = time + Interval::from_ms(16.0);
        z -= 0.008;
    }
    assert!((0.76..0.82).contains(&z), "died at {z} m, with the floor of the volume at 1 m and a margin of 0.1 m");
}

#[test]
fn a_light_that_shows_twice_is_one_target() {
    // A reflection on the light's housing, 15 mm beside it, in every camera.
    let mut rig = Rig::new(12, IntegratorSettings::default());
    rig.watch(ms(0.0), ms(2000.0), &[], &[SPOT, SPOT + Vector3::z() * 0.015]);
    assert_eq!(rig.ids().len(), 1, "{:?}", rig.tracker.tally());
}

#[test]
fn of_two_targets_whose_lights_become_one_the_older_stays() {
    let mut rig = Rig::new(12, IntegratorSettings::default());
    let other = |apart: f64| SPOT + Vector3::x() * apart;
    rig.watch(ms(0.0), ms(200.0), &[], &[SPOT]);
    rig.watch(ms(200.0), ms(400.0), &[], &[SPOT, other(0.2)]);
    assert_eq!(rig.ids(), [0, 1]);
    let mut time = ms(400.0);
    for k in 0..=40 {
        let apart = 0.2 * (1.0 - f64::from(k) / 40.0);
        let lights = if apart > 0.012 { vec![SPOT, other(apart)] } else { vec![other(apart)] };
        rig.watch(time, time + Interval::from_ms(16.0), &[], &lights);
        time = time + Interval::from_ms(16.0);
    }
    rig.watch(time, time + Interval::from_ms(250.0), &[], &[SPOT]);
    assert_eq!(rig.ids(), [0], "{:?}", rig.tracker.tally());
}

#[test]
fn a_light_comes_back_from_behind_something_with_its_identity() {
    let scene = |t: f64| [Light::at(Point3::new(0.6 * t - 0.6, 0.3, 1.2))];
    let lab = Lab::new(12);
    let mut tracker = Tracker::new(IntegratorSettings::default(), lab.cameras.clone(), Some(ROOM));
    let mut targets = Targets::default();
    for (time, mut features) in lab.frames(2.0, &scene) {
        if (1.0..1.25).contains(&time.as_s()) {
            features.list.clear();
        }
        tracker.observe(time, &features);
        tracker.write(&mut targets);
        if time.as_s() > 0.2 {
            assert_eq!(targets.list.iter().map(|it| it.id).collect::<Vec<_>>(), [TargetId(0)]);
            let error = (targets.list[0].position - scene(targets.time.as_s())[0].position).norm();
            assert!(error < 5.0 * targets.list[0].position_sigma(), "{error} m at {time}");
        }
    }
}
