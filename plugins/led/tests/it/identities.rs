//! Who is who when lights vanish and come back, and where they cross.

use foveate::geometry::Camera;
use foveate::messages::{CameraId, Features, Interval, Targets, Time};
use foveate_led::tracker::{AssociationMethod, IntegratorSettings, MotionModel, Tracker};
use foveate_testkit::lab::{Crossings, Lab, Lights, ROOM_M, Score, ScoreOptions, Wanderers, cameras, feature, score};
use nalgebra::{Point3, Vector3};

/// A tracker of `n` cameras that look in turn, each at 60 Hz, without noise.
struct Rig {
    cameras: Vec<Camera>,
    tracker: Tracker,
    time: Time,
    turn: usize,
}

impl Rig {
    fn new(n: usize, settings: IntegratorSettings) -> Self {
        let cameras = cameras(n);
        let tracker = Tracker::new(settings, cameras.clone(), Some(ROOM_M));
        Self { cameras, tracker, time: Time::ZERO, turn: 0 }
    }

    /// Shows the lights that `lights` gives for a time [s] from now on for `duration_s`; `None` for one that is hidden.
    fn watch<const N: usize>(&mut self, duration_s: f64, lights: impl Fn(f64) -> [Option<Point3<f64>>; N]) {
        let end = self.time + Interval::from_s(duration_s);
        while self.time < end {
            let camera = self.turn % self.cameras.len();
            let seen = lights(self.time.as_s()).into_iter().flatten();
            let list = seen.filter_map(|it| Some(feature(self.cameras[camera].sees(&it)?, 0.3))).collect();
            self.tracker.observe(self.time, &Features { camera: CameraId(camera as u16), list });
            self.time = self.time + Interval::from_s(1.0 / 60.0 / self.cameras.len() as f64);
            self.turn += 1;
        }
    }

    /// Identities of the targets nearest to `places`; `None` where there is none within 50 mm.
    fn ids<const N: usize>(&self, places: [Point3<f64>; N]) -> [Option<u32>; N] {
        let mut targets = Targets::default();
        self.tracker.write(&mut targets);
        places.map(|place| targets.list.iter().find(|it| (it.position - place).norm() < 0.05).map(|it| it.id.0))
    }
}

/// Four lights of a stiff frame that walks along y, and a fifth by itself.
fn frame(t: f64) -> [Point3<f64>; 5] {
    let along = Vector3::y() * (0.8 * t - 1.0);
    let corner = |x: f64, z: f64| Point3::new(x, 0.0, z) + along;
    [corner(-0.2, 1.0), corner(0.25, 1.0), corner(-0.2, 1.5), corner(0.3, 1.6), Point3::new(-1.0, 1.2, 0.8)]
}

#[test]
fn a_light_that_comes_back_has_its_identity_again() {
    let mut rig = Rig::new(8, IntegratorSettings::default());
    rig.watch(1.0, |t| frame(t).map(Some));
    let before = rig.ids(frame(rig.time.as_s()));
    assert!(before.iter().all(Option::is_some), "{before:?}");
    rig.watch(0.6, |t| {
        let mut lights = frame(t).map(Some);
        lights[1] = None;
        lights
    });
    assert_eq!(rig.tracker.tally().terminated_unseen, 1);
    assert_eq!(rig.ids(frame(rig.time.as_s()))[1], None);
    rig.watch(0.3, |t| frame(t).map(Some));
    assert_eq!(rig.ids(frame(rig.time.as_s())), before);
    assert_eq!(rig.tracker.tally().regained, 1);
}

#[test]
fn two_lights_of_a_frame_come_back_each_as_itself_whichever_is_first() {
    for first in [1, 3] {
        let mut rig = Rig::new(8, IntegratorSettings::default());
        rig.watch(1.5, |t| frame(t).map(Some));
        let before = rig.ids(frame(rig.time.as_s()));
        let hide = |hidden: &[usize], t: f64| {
            let mut lights = frame(t).map(Some);
            hidden.iter().for_each(|&it| lights[it] = None);
            lights
        };
        rig.watch(0.5, |t| hide(&[1, 3], t));
        rig.watch(0.2, |t| hide(&[4 - first], t)); // the other one of 1 and 3
        rig.watch(0.3, |t| hide(&[], t));
        assert_eq!(rig.ids(frame(rig.time.as_s())), before, "{first} first");
    }
}

#[test]
fn a_light_that_stops_while_nobody_sees_it_comes_back_as_itself() {
    let mut rig = Rig::new(8, IntegratorSettings { lost_after_ms: 50.0, ..IntegratorSettings::default() });
    let way = |t: f64| Point3::new(0.2, -1.4 + 2.5 * t.min(1.05), 1.2);
    rig.watch(1.0, |t| [Some(way(t))]);
    rig.watch(0.25, |_| [None]);
    assert_eq!(rig.tracker.tally().terminated_unseen, 1);
    rig.watch(0.2, |t| [Some(way(t))]);
    assert_eq!(rig.ids([way(2.0)]), [Some(0)]);
}

#[test]
fn a_light_is_remembered_for_as_long_as_the_rig_says() {
    for (gone_s, same) in [(0.7, true), (1.2, false)] {
        let mut rig = Rig::new(8, IntegratorSettings { remember_ms: 900.0, ..IntegratorSettings::default() });
        let here = Point3::new(0.2, -0.3, 1.2);
        rig.watch(1.0, |_| [Some(here)]);
        rig.watch(gone_s, |_| [None]);
        rig.watch(0.5, |_| [Some(here)]);
        assert_eq!(rig.ids([here]), [Some(u32::from(!same))], "after {gone_s} s");
    }
}

#[test]
fn a_light_that_appears_out_of_reach_is_someone_else() {
    let mut rig = Rig::new(8, IntegratorSettings::default());
    let (here, there) = (Point3::new(0.2, -1.3, 1.2), Point3::new(-0.4, 1.5, 0.9));
    rig.watch(1.0, |_| [Some(here)]);
    rig.watch(0.4, |_| [None]);
    rig.watch(0.3, |_| [Some(there)]);
    assert_eq!(rig.ids([there]), [Some(1)]);
    rig.watch(0.2, |_| [Some(there), Some(here)]);
    assert_eq!(rig.ids([there, here]), [Some(1), Some(0)], "the first one is still remembered");
}

#[test]
fn of_two_lost_ones_that_fit_alike_neither_is_taken() {
    let mut rig = Rig::new(8, IntegratorSettings::default());
    let (left, right) = (Point3::new(-0.12, 0.0, 1.2), Point3::new(0.12, 0.0, 1.2));
    rig.watch(1.0, |_| [Some(left), Some(right)]);
    rig.watch(0.6, |_| [None, None]);
    let middle = Point3::new(0.0, 0.0, 1.2);
    rig.watch(0.1, |_| [Some(middle)]);
    assert_eq!(rig.ids([middle]), [Some(2)]);
}

#[test]
fn an_accident_that_took_a_lost_identity_gives_it_back() {
    let mut rig = Rig::new(8, IntegratorSettings::default());
    let here = Point3::new(0.2, -0.3, 1.2);
    rig.watch(1.0, |_| [Some(here)]);
    rig.watch(0.5, |_| [None]);
    let flash = here + Vector3::x() * 0.1;
    rig.watch(0.012, |_| [Some(flash)]); // seen for less than a turn of the cameras
    assert_eq!(rig.ids([flash]), [Some(0)]);
    rig.watch(0.25, |_| [None]);
    assert_eq!((rig.ids([flash]), rig.tracker.tally().terminated_unconfirmed), ([None], 1));
    rig.watch(0.1, |_| [Some(here)]);
    assert_eq!(rig.ids([here]), [Some(0)]);
}

#[test]
fn one_camera_alone_does_not_keep_a_target_alive_whatever_order_the_cameras_had_before() {
    for before in [[0, 1, 2, 3], [3, 2, 1, 0], [0, 0, 1, 3]] {
        let cameras = cameras(4);
        let settings = IntegratorSettings { initiation_cameras: 2, ..IntegratorSettings::default() };
        let mut tracker = Tracker::new(settings, cameras.clone(), Some(ROOM_M));
        let here = Point3::new(0.2, -0.3, 1.2);
        let mut see = |ms: f64, camera: usize| {
            let list = vec![feature(cameras[camera].sees(&here).unwrap(), 0.3)];
            tracker.observe(Time::ZERO + Interval::from_ms(ms), &Features { camera: CameraId(camera as u16), list });
            tracker.n_targets()
        };
        for k in 0..40 {
            see(4.0 * f64::from(k), before[k as usize % 4]);
        }
        // From 160 ms on camera 3 alone, every 16 ms; the last other one saw it at 156 ms at the latest.
        let alive: Vec<i32> = (0..40).filter(|k| see(160.0 + 16.0 * f64::from(*k), 3) == 1).collect();
        let last = alive.last().copied().unwrap_or(-1);
        assert!((17..=20).contains(&last), "{before:?}: alive until {} ms", 160 + 16 * last);
    }
}

fn run(lab: &Lab, lights: &impl Lights, duration_s: f64, settings: &IntegratorSettings) -> (Score, u64) {
    let mut tracker = Tracker::new(settings.clone(), lab.cameras.clone(), Some(ROOM_M));
    let options = ScoreOptions { settled_s: 1.0, step_s: 1.0 / 60.0 };
    let score = score(&lab.frames(duration_s, lights), options, lights, |time, features, targets| {
        let taken = tracker.observe(time, features) == foveate_led::tracker::Entry::Applied;
        tracker.write(targets);
        taken
    });
    (score, tracker.tally().ambiguities)
}

const METHODS: [AssociationMethod; 3] =
    [AssociationMethod::Nearest, AssociationMethod::Global, AssociationMethod::Hypotheses];

#[test]
fn crossing_lights_keep_their_identities_by_every_method_and_hypotheses_are_kept_where_they_are_needed() {
    for association in METHODS {
        let (mut id_switches, mut ambiguities, mut identities) = (0, 0, 0.0);
        for seed in 1..=4 {
            let lab = Lab { seed, melt: 3.0, ..Lab::new(6) };
            let lights = Crossings::new(4, 8.0, ROOM_M, [0.03, 0.1], seed);
            let settings = IntegratorSettings { association, ..IntegratorSettings::default() };
            let (score, kept) = run(&lab, &lights, 8.0, &settings);
            id_switches += score.id_switches;
            identities += score.identities_per_light() / 4.0;
            ambiguities += kept;
        }
        assert!(
            id_switches <= 2 && identities < 1.1,
            "{association:?}: {id_switches} id_switches, {identities} identities a light"
        );
        assert_eq!(ambiguities > 0, association == AssociationMethod::Hypotheses);
    }
}

#[test]
fn lights_whose_images_are_one_spot_for_a_while_are_drawn_off_by_little_and_stay_themselves() {
    for association in [AssociationMethod::Nearest, AssociationMethod::Global] {
        let (mut id_switches, mut identities, mut p95) = (0, 0.0, 0.0_f64);
        for seed in 21..=26 {
            let lab = Lab { seed, melt: 4.0, ..Lab::new(8) };
            let lights = Crossings::new(4, 8.0, ROOM_M, [0.03, 0.1], seed);
            let settings = IntegratorSettings { association, ..IntegratorSettings::default() };
            let (score, _) = run(&lab, &lights, 8.0, &settings);
            id_switches += score.id_switches;
            identities += score.identities_per_light() / 6.0;
            p95 = p95.max(score.error_p95);
        }
        assert!(
            id_switches == 0 && identities < 1.01 && p95 < 6.6e-3,
            "{association:?}: {id_switches} switches, {identities} identities a light, p95 {p95} m"
        );
    }
}

#[test]
fn each_method_gives_the_same_bits_again() {
    let lab = Lab { clutter: 2.0, hidden: 0.2, melt: 3.0, ..Lab::new(6) };
    let lights = Crossings::new(4, 3.0, ROOM_M, [0.03, 0.1], 5);
    let frames = lab.frames(3.0, &lights);
    for association in METHODS {
        for motion in [MotionModel::ConstantVelocity, MotionModel::ConstantAcceleration, MotionModel::Interacting] {
            let settings = IntegratorSettings { association, motion, ..IntegratorSettings::default() };
            let run = |reversed: bool| {
                let mut tracker = Tracker::new(settings.clone(), lab.cameras.clone(), Some(ROOM_M));
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
            assert_eq!(run(false), run(false), "{association:?} {motion:?}");
            assert_eq!(run(false), run(true), "{association:?} {motion:?}, features in another order");
        }
    }
}

#[test]
fn every_motion_model_follows_wandering_lights_and_says_honestly_how_well() {
    for (motion, adapt_noise) in [
        (MotionModel::ConstantVelocity, false),
        (MotionModel::ConstantVelocity, true),
        (MotionModel::ConstantAcceleration, false),
        (MotionModel::Interacting, false),
    ] {
        let lab = Lab { clutter: 0.5, hidden: 0.2, ..Lab::new(8) };
        let lights = Wanderers::new(8, 8.0, ROOM_M, 1.0, 3);
        let settings = IntegratorSettings { motion, adapt_noise, ..IntegratorSettings::default() };
        let (score, _) = run(&lab, &lights, 8.0, &settings);
        assert_eq!((score.n_identities, score.id_switches), (8, 0), "{motion:?} {score:?}");
        assert!(score.ghosts <= score.samples / 500, "{motion:?} {score:?}");
        assert!(score.rms < 4.5e-3 && (0.5..4.5).contains(&score.consistency), "{motion:?} {score:?}");
    }
}

#[test]
fn a_crowd_of_lights_at_one_place_is_settled_without_keeping_every_answer() {
    // Twelve lights within 60 mm: more than a group may hold.
    let mut rig = Rig::new(
        8,
        IntegratorSettings {
            association: AssociationMethod::Hypotheses,
            separation_mm: 5.0,
            ..IntegratorSettings::default()
        },
    );
    let apart = |t: f64| if t < 1.0 { 0.25 } else { 0.02 };
    let lights = |t: f64| -> [Option<Point3<f64>>; 12] {
        std::array::from_fn(|k| {
            let place = Vector3::new((k % 3) as f64, (k / 3 % 2) as f64, (k / 6) as f64) * apart(t);
            Some(Point3::new(-0.2, -0.1, 0.9) + place)
        })
    };
    rig.watch(0.9, lights);
    rig.watch(1.0, lights);
    assert!(rig.tracker.n_targets() >= 6, "{:?}", rig.tracker.tally());
    let mut targets = Targets::default();
    rig.tracker.write(&mut targets);
    assert!(targets.list.iter().all(|it| it.position.coords.iter().all(|it| it.is_finite())));
}
