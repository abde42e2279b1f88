//! What `tracker` promises, tried.

use foveate::geometry::{Camera, Distortion, Intrinsics, PlaneMap, PlanePoint};
use foveate::scene::{WallCamera, WallMap};
use foveate_testkit::check_node;
use nalgebra::{Isometry3, Matrix2, Point2, Point3};

use super::*;

const SIZE: [u32; 2] = [640, 480];

/// Two cameras side by side before a wall of 2.4 m x 1.2 m: the left one sees x up to 1.44 m, the right one from 0.96 m on.
fn cameras() -> [Camera; 2] {
    [0.64, 1.76].map(|x| Camera {
        image_size: SIZE,
        intrinsics: Intrinsics { focal: [880.0; 2], principal: [321.0, 238.0], skew: 0.0 },
        distortion: Distortion { k1: -0.03, ..Distortion::default() },
        camera_from_world: Isometry3::translation(-x, -0.6, 2.2),
    })
}

fn map() -> WallMap {
    let cameras = cameras().into_iter().zip(["left", "right"]).map(|(camera, name)| {
        let grid = (0..25).flat_map(|column| (0..13).map(move |row| [0.1 * f64::from(column), 0.1 * f64::from(row)]));
        let points: Vec<PlanePoint> = grid
            .filter_map(|[x, y]| {
                let pixel = camera.sees(&Point3::new(x, y, 0.0))?;
                Some(PlanePoint { point: Point2::new(x, y), pixel, sigma: 0.02 })
            })
            .collect();
        let map = PlaneMap::fit(SIZE, &points).unwrap();
        (name.to_owned(), WallCamera { map, held_out_px: 0.1, brightest: 150.0 })
    });
    WallMap { size_m: [2.4, 1.2], pixel_m: 8e-4, cameras: cameras.collect() }
}

/// A spot on the wall: place, pixels that it takes up, brightest pixel.
type Spot = ([f64; 2], u32, u8);

/// What comes out when each camera looks `hz` times a second, in turn, at what `spots` says of a camera and a time.
struct Run {
    targets: Vec<(f64, usize, Vec<Target>)>,
    /// Of each frame, where users have codes.
    users: Vec<Users>,
    pointers: Pointers,
}

fn run(duration_s: f64, spots: impl Fn(usize, f64) -> Vec<Spot>) -> Run {
    run_with(TrackerSettings::default(), duration_s, spots)
}

fn run_with(settings: TrackerSettings, duration_s: f64, spots: impl Fn(usize, f64) -> Vec<Spot>) -> Run {
    let unlabelled = |camera: usize, time_s: f64| spots(camera, time_s).into_iter().map(|it| (it, None)).collect();
    run_labelled(settings, duration_s, unlabelled)
}

/// The same of spots that have labels.
fn run_labelled(
    settings: TrackerSettings,
    duration_s: f64,
    spots: impl Fn(usize, f64) -> Vec<(Spot, Option<u32>)>,
) -> Run {
    let names = ["left", "right"].map(str::to_owned);
    let mut pointers = Pointers::new(settings, &map(), &names);
    let (mut targets, mut users) = (Vec::new(), Vec::new());
    let cameras = cameras();
    for step in 0..(duration_s * 120.0) as usize {
        let (camera, time_s) = (step % 2, step as f64 / 120.0);
        let seen = spots(camera, time_s).into_iter().filter_map(|((place, area, peak), label)| {
            let centre = cameras[camera].sees(&Point3::new(place[0], place[1], 0.0))?;
            Some(Feature { centre, covariance: Matrix2::identity() * 0.0025, area, peak, label })
        });
        let features = Features { camera: CameraId(camera as u16), list: seen.collect() };
        let mut out = Targets::default();
        assert!(pointers.take_in(Time::from_s(time_s), &features, &mut out));
        targets.push((time_s, camera, out.list));
        users.extend(pointers.users(Time::from_s(time_s)));
    }
    Run { targets, users, pointers }
}

impl Run {
    fn ids(&self) -> Vec<u32> {
        let mut ids: Vec<u32> = self.targets.iter().flat_map(|it| it.2.iter().map(|it| it.id.0)).collect();
        ids.sort_unstable();
        ids.dedup();
        ids
    }
}

#[test]
fn a_camera_without_a_map_and_a_wall_of_another_size_than_the_volume_are_reported() {
    use foveate::scene::{Calibration, LengthUnit, NamedCamera};
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("wall.map.toml");
    let named = cameras().into_iter().zip(["left", "right"]);
    let named = named.map(|(camera, name)| NamedCamera { name: name.to_owned(), camera }).collect();
    let calibration = Calibration::new(named, LengthUnit::Metre, String::new()).unwrap();
    let remarks = |map: WallMap, width: f64| {
        std::fs::write(&file, map.to_toml()).unwrap();
        let volume_m = Some([[0.0, 0.0, -0.05], [width, 1.2, 0.05]]);
        let setup = Setup { calibration: calibration.clone().into(), volume_m, ..Setup::for_tests() };
        let settings = TrackerSettings { map: file.display().to_string(), ..TrackerSettings::default() };
        let mut bench = NodeBench::<Tracker>::with_setup(settings, &setup).unwrap();
        let spot = Feature {
            centre: Point2::new(320.0, 240.0),
            covariance: Matrix2::identity(),
            area: 9,
            peak: 255,
            label: None,
        };
        bench.feed(&FEATURES, Time::ZERO, Features { camera: CameraId(1), list: vec![spot; 3] }).unwrap();
        bench.finish().unwrap().remarks.join("; ")
    };
    assert_eq!(remarks(map(), 2.4), "");
    let mut left = map();
    left.cameras.remove("right");
    let said = remarks(left, 4.0);
    assert!(said.contains("camera `right` is not in the map: its 3 spots are left out"), "{said}");
    assert!(said.contains("2.400 m by 1.200 m") && said.contains("4.000 m by 1.200 m"), "{said}");
}

#[test]
fn a_pointer_that_goes_dark_for_longer_than_it_may_be_lost_is_refused() {
    let users = vec![UserCode { user: 1, period_ms: Some(60.0), colour: None }];
    let fault = TrackerSettings { users, lost_ms: 20.0, ..TrackerSettings::default() }.check().unwrap_err();
    assert!(fault.to_string().contains("found 20 ms, expected more than the 20 ms of `dark_ms`"), "{fault}");
}

#[test]
fn pointer_keeps_its_identity_from_camera_to_camera() {
    let place = |time_s: f64| [0.2 + 0.5 * time_s, 0.5 + 0.1 * (3.0 * time_s).sin()];
    let run = run(4.0, |_, time_s| vec![(place(time_s), 20, 255)]);
    assert_eq!(run.ids(), [1]);
    for (time_s, _, list) in &run.targets[6..] {
        let [target] = list.as_slice() else { panic!("{} targets at {time_s} s", list.len()) };
        let [x, y] = place(*time_s);
        let off = (target.position - Point3::new(x, y, 0.0)).norm();
        assert!(off < if target.provenance == Provenance::Measured { 5e-4 } else { 4e-3 }, "{off} m at {time_s} s");
        assert!((target.velocity.x - 0.5).abs() < 0.25 || *time_s < 0.3, "{}", target.velocity);
        assert_eq!((target.position.z, target.velocity.z), (0.0, 0.0));
    }
}

#[test]
fn pointers_that_cross_keep_their_identities() {
    for slope in [0.05, 0.3, 1.0] {
        // They meet at (1.2, 0.6) at 1 s; spots that touch are one.
        let places = move |time_s: f64| {
            let s = time_s - 1.0;
            [[1.2 + 0.6 * s, 0.6 + 0.6 * slope * s], [1.2 - 0.6 * s, 0.6 + 0.6 * slope * s]]
        };
        let run = run(2.0, |_, time_s| {
            let [a, b] = places(time_s);
            if (a[0] - b[0]).hypot(a[1] - b[1]) < 0.008 {
                return vec![([(a[0] + b[0]) / 2.0, (a[1] + b[1]) / 2.0], 30, 255)];
            }
            vec![(a, 20, 255), (b, 20, 255)]
        });
        assert_eq!(run.ids(), [1, 2], "slope {slope}");
        let of = |at: usize, id: u32| run.targets[at].2.iter().find(|it| it.id.0 == id).unwrap().position.x;
        let end = run.targets.len() - 1;
        assert!(
            (of(20, 1) - 1.2) * (of(end, 1) - 1.2) < 0.0 && (of(20, 2) - 1.2) * (of(end, 2) - 1.2) < 0.0,
            "{slope}"
        );
    }
}

#[test]
fn pointer_that_vanishes_on_another_one_is_gone() {
    let run = run(2.0, |_, time_s| {
        let mut spots = vec![([1.2, 0.6], 20, 255)];
        if time_s < 1.0 {
            spots.push(([1.2 + 0.1 * (1.0 - time_s), 0.63 - 0.03 * time_s], 20, 255));
        }
        spots
    });
    assert_eq!(run.targets.last().unwrap().2.len(), 1);
    assert_eq!(run.ids().len(), 2);
}

#[test]
fn press_is_reported_within_three_frames_and_a_release_as_soon_as_it_is_certain() {
    // In the overlap, and where the left camera is alone.
    for (x, most_s) in [(1.2, 0.02), (0.3, 0.04)] {
        let run = run(2.0, |_, time_s| if (0.5..1.0).contains(&time_s) { vec![([x, 0.5], 20, 255)] } else { vec![] });
        let with = |it: &&(f64, usize, Vec<Target>)| !it.2.is_empty();
        let (first, last) = (run.targets.iter().find(with).unwrap().0, run.targets.iter().rfind(with).unwrap().0);
        assert!(first - 0.5 < most_s && last - 1.0 < 0.055, "x {x}: from {first} s to {last} s");
        assert_eq!(run.ids(), [1]);
    }
}

#[test]
fn a_pointer_that_comes_back_after_more_than_it_may_be_lost_is_another_one() {
    // Where one camera alone looks, once each 17 ms: the first frame after the gap is the one that sees the pointer again.
    let of_gap = |frames: usize| {
        let run = run(1.0, |camera, time_s| {
            let frame = (time_s * 60.0) as usize;
            if camera == 0 && !(30..30 + frames).contains(&frame) { vec![([0.3, 0.5], 20, 255)] } else { vec![] }
        });
        run.ids().len()
    };
    // 2 frames missed are 50 ms from sight to sight.
    assert_eq!([of_gap(1), of_gap(2), of_gap(3), of_gap(4)], [1, 1, 2, 2]);
}

#[test]
fn next_press_has_another_identity() {
    let run = run(2.0, |_, time_s| if time_s % 0.5 < 0.4 { vec![([1.2, 0.5], 20, 255)] } else { vec![] });
    assert_eq!(run.ids(), [1, 2, 3, 4]);
}

#[test]
fn what_the_wall_can_show_and_what_is_no_spot_begins_nothing() {
    let run = run(1.0, |_, time_s| {
        vec![
            ([0.5 + time_s, 0.3], 20, 170), // red, as the wall shows it
            ([1.1, 0.7], 2000, 255),        // a lamp
            ([-0.1, 0.5], 20, 255),         // beside the wall
        ]
    });
    assert!(run.ids().is_empty());
    let tally = run.pointers.tally();
    assert!(tally.dim > 80 && tally.large > 100 && tally.beside > 50, "{tally:?}");
}

#[test]
fn reflection_beside_its_spot_begins_nothing_though_cameras_agree_on_it() {
    let real = |time_s: f64| [1.15 + 0.03 * (2.0 * time_s).sin(), 0.5 + 0.2 * time_s];
    let run = run(2.0, |_, time_s| {
        let [x, y] = real(time_s);
        vec![([x, y], 30, 255), ([2.0 * 1.2 - x, y], 12, 255)]
    });
    assert_eq!(run.ids(), [1]);
}

#[test]
fn reflection_as_large_as_its_spot_begins_nothing_once_the_bezel_is_known() {
    // A pointer comes to a bezel again and again; in the fifth second a bright window behind its reflection makes that as large as the spot.
    let run = run(6.0, |_, time_s| {
        let off = 0.012 + 0.02 * (std::f64::consts::TAU * time_s).cos().abs();
        let y = 0.5 + 0.02 * time_s;
        let area = if time_s > 4.0 { 30 } else { 10 };
        // A press that begins beside the bezel: no pointer is there yet whose reflection it could be.
        if (4.6..4.8).contains(&time_s) {
            return vec![];
        }
        vec![([1.2 - off, y], 30, 255), ([1.2 + off, y], area, 255)]
    });
    assert_eq!(run.ids(), [1, 2]);
    for (time_s, _, list) in run.targets.iter().filter(|it| it.0 > 5.0) {
        assert!(list.len() == 1 && list[0].position.x < 1.2, "{list:?} at {time_s} s");
    }
    assert_eq!(run.pointers.tally().bezels, 2, "one for each camera");
}

#[test]
fn pointer_that_turns_back_at_a_bezel_stays_with_its_spot_though_the_reflection_goes_on() {
    // The bezel is learnt in four seconds. Then the pointer runs against it and turns back: what goes on at the old speed, and is as large, is the reflection.
    let off_at = |time_s: f64| match time_s {
        ..4.0 => 0.012 + 0.02 * (std::f64::consts::TAU * time_s).cos().abs(),
        _ => (0.002 + 0.6 * (time_s - 4.55).abs()).min(0.032),
    };
    let run = run(5.0, |_, time_s| {
        let (off, y) = (off_at(time_s), 0.5 + 0.02 * time_s);
        if off < 0.004 {
            return vec![([1.2, y], 40, 255)];
        }
        vec![([1.2 - off, y], 30, 255), ([1.2 + off, y], if time_s < 4.0 { 10 } else { 30 }, 255)]
    });
    assert_eq!(run.ids(), [1]);
    let (time_s, _, list) = run.targets.last().unwrap();
    assert!((list[0].position.x - 1.168).abs() < 2e-3, "{} at {time_s} s", list[0].position);
}

#[test]
fn spot_that_one_camera_sees_shifted_does_not_throw_its_pointer_off() {
    // One with its reflection in one picture of the right camera.
    let run = run(2.0, |camera, time_s| {
        let shift = if camera == 1 && (1.0..1.012).contains(&time_s) { 0.009 } else { 0.0 };
        // Another pointer, which is not shifted, stands before it in every list.
        vec![([1.1 + 0.1 * time_s, 0.9], 20, 255), ([1.1 + 0.1 * time_s, 0.5 + shift], 20, 255)]
    });
    assert_eq!(run.ids(), [1, 2]);
    for (time_s, _, list) in &run.targets[8..] {
        let list: Vec<&Target> = list.iter().filter(|it| it.position.y < 0.7).collect();
        assert_eq!((list.len(), list[0].provenance), (1, Provenance::Measured), "at {time_s} s");
        // 9 mm taken as they are would be 8.8 mm and 1.2 m/s.
        assert!((list[0].position.y - 0.5).abs() < 3e-3, "{} at {time_s} s", list[0].position);
        assert!(list[0].velocity.y.abs() < 0.5, "{} at {time_s} s", list[0].velocity);
    }
}

#[test]
fn press_that_begins_in_anothers_spot_does_not_take_its_identity() {
    // The first pointer goes on upwards; the second one is pressed 6 mm before it and goes down: for four frames both are one spot.
    let first = |time_s: f64| [1.2, 0.5 + 0.3 * (time_s - 1.0)];
    let second = |time_s: f64| [1.2, 0.506 - 0.3 * (time_s - 1.0)];
    let run = run(1.5, |_, time_s| {
        let (a, b) = (first(time_s), second(time_s));
        if time_s < 1.0 {
            return vec![(a, 20, 255)];
        }
        if (a[1] - b[1]).abs() < 0.008 {
            return vec![([1.2, f64::midpoint(a[1], b[1])], 36, 255)];
        }
        vec![(a, 20, 255), (b, 20, 255)]
    });
    assert_eq!(run.ids(), [1, 2]);
    let (time_s, _, list) = run.targets.last().unwrap();
    assert!((list[0].position.y - first(*time_s)[1]).abs() < 2e-3, "{} at {time_s} s", list[0].position);
}

#[test]
fn place_that_one_camera_alone_reports_though_another_sees_it_is_disputed() {
    let run = run(2.0, |camera, _| if camera == 0 { vec![([1.2, 0.5], 20, 255)] } else { vec![] });
    assert!(run.ids().is_empty());
    let disputes: Vec<_> = run.pointers.disputes().collect();
    assert!(matches!(disputes[..], [(CameraId(0), CameraId(1), 3..)]), "{disputes:?}");
}

#[test]
fn pointer_that_two_cameras_saw_goes_on_where_one_is_hidden() {
    let run = run(2.0, |camera, time_s| if camera == 1 && time_s > 1.0 { vec![] } else { vec![([1.2, 0.5], 20, 255)] });
    assert_eq!(run.ids(), [1]);
    assert_eq!(run.targets.last().unwrap().2.len(), 1);
}

#[test]
fn frames_that_come_after_a_later_one_and_cameras_without_a_map_are_left_out() {
    let mut pointers = Pointers::new(TrackerSettings::default(), &map(), &["left", "other"].map(str::to_owned));
    let mut out = Targets::default();
    let features = |camera: u16| Features { camera: CameraId(camera), list: Vec::new() };
    assert!(pointers.take_in(Time::from_s(1.0), &features(0), &mut out));
    assert!(!pointers.take_in(Time::from_s(0.99), &features(0), &mut out));
    assert!(!pointers.take_in(Time::from_s(1.01), &features(1), &mut out));
    assert_eq!(pointers.tally().late, 1);
}

#[test]
fn node_names_what_is_wrong_with_its_settings() {
    let folder = tempfile::tempdir().unwrap();
    let mut setup = Setup::for_tests();
    setup.rig_dir = folder.path().to_owned();
    let refusal = |settings: TrackerSettings| {
        let error = Tracker::new(settings, &setup).err().unwrap();
        (error.setting.unwrap_or_default(), error.message)
    };
    assert_eq!(refusal(TrackerSettings::default()).0, "map");
    let with = |map: &str| TrackerSettings { map: map.to_owned(), ..TrackerSettings::default() };
    assert!(refusal(with("none.toml")).1.contains("none.toml"));
    std::fs::write(folder.path().join("wall.map.toml"), map().to_toml()).unwrap();
    let (setting, message) = refusal(with("wall.map.toml"));
    assert!(setting == "map" && message.contains("found left, right"), "{message}");
    assert_eq!(refusal(TrackerSettings { lost_ms: 0.0, ..with("wall.map.toml") }).0, "lost_ms");
}

#[test]
fn settings_are_read_and_written() {
    check_node::<Tracker>("map = \"wall.map.toml\"");
}

/// Three users with codes.
fn with_users() -> TrackerSettings {
    let users = [(1, 60.0), (2, 71.0), (3, 84.0)].map(|(user, period_ms)| UserCode {
        user,
        period_ms: Some(period_ms),
        colour: None,
    });
    TrackerSettings { users: users.to_vec(), lost_ms: 75.0, ..TrackerSettings::default() }
}

/// Whether a light that is dark for 20 ms every `period_ms` is seen at `time_s`.
fn is_lit(period_ms: f64, time_s: f64) -> bool {
    !(1.0..19.0).contains(&(time_s * 1e3 + 7.0).rem_euclid(period_ms))
}

#[test]
fn pointer_that_blinks_keeps_its_identity_and_gets_its_user_alone_or_in_two_cameras() {
    for (period_ms, user) in [(60.0, 1), (71.0, 2), (84.0, 3)] {
        for x in [0.3, 1.2] {
            let run = run_with(with_users(), 3.0, |_, time_s| {
                let spot = ([x + 0.2 * (2.0 * time_s).sin(), 0.5 + 0.05 * time_s], 20, 255);
                if is_lit(period_ms, time_s) { vec![spot] } else { vec![] }
            });
            assert_eq!(run.ids(), [1], "user {user} at {x} m");
            let known = run.users.iter().position(|it| !it.list.is_empty()).expect("no user was decided");
            assert!(run.users[known..].iter().all(|it| it.of(TargetId(1)) == Some(user)), "user {user} at {x} m");
            assert!((10..180).contains(&known), "user {user} at {x} m: after {known} frames");
        }
    }
    let run = run(0.5, |_, _| vec![([1.2, 0.5], 20, 255)]);
    assert!(run.users.is_empty() && run.pointers.users_tally().is_none(), "without codes nothing is decided");
}

#[test]
fn identities_that_a_meeting_exchanged_are_given_back() {
    // Both come from the left and meet; then each turns back to its own row, where a tracker sees them cross.
    let place = |side: f64, time_s: f64| {
        let off = 0.12 * (time_s - 1.5).abs();
        [1.1 + 0.1 * (time_s - 1.5), 0.6 + side * off]
    };
    let run = run_with(with_users(), 3.0, |_, time_s| {
        let lit = [(-1.0, 60.0), (1.0, 84.0)].into_iter().filter(|it| is_lit(it.1, time_s));
        let spots: Vec<[f64; 2]> = lit.map(|it| place(it.0, time_s)).collect();
        match spots[..] {
            [a, b] if (a[1] - b[1]).abs() < 0.008 => vec![([a[0], 0.6], 30, 255)],
            _ => spots.into_iter().map(|it| (it, 20, 255)).collect(),
        }
    });
    assert_eq!(run.ids(), [1, 2]);
    let exchanged: Vec<&Exchange> = run.users.iter().flat_map(|it| &it.exchanged).collect();
    let [exchange] = exchanged[..] else { panic!("{exchanged:?}") };
    assert!((exchange.since.as_s() - 1.5).abs() < 0.2, "{exchange:?}");
    assert_eq!(run.pointers.users_tally().unwrap().mended, 1);
    let of = |at: usize, user: u32| {
        let id = run.users[at].list.iter().find(|it| it.user == user).unwrap().id;
        (id, run.targets[at].2.iter().find(|it| it.id == id).unwrap().position.y)
    };
    let end = run.targets.len() - 1;
    for (user, above) in [(1, true), (3, false)] {
        let ((before, y), (after, y_after)) = (of(160, user), of(end, user));
        assert_eq!(before, after, "user {user}");
        assert_eq!([y < 0.6, y_after < 0.6], [above; 2], "user {user}: {y} m, {y_after} m");
    }
}

#[test]
fn pointer_with_an_unknown_code_and_a_second_one_with_the_same_get_no_user_and_are_counted() {
    let run = run_with(with_users(), 4.0, |_, time_s| {
        let lights = [(0.3, 60.0, 0.0), (0.7, 60.0, 1.0), (1.2, 120.0, 0.0), (2.0, 1e9, 0.5)];
        let lit = lights.into_iter().filter(|it| time_s >= it.2 && is_lit(it.1, time_s + 0.3 * it.2));
        lit.map(|it| ([it.0, 0.5], 20, 255)).collect()
    });
    let with_user: Vec<TargetUser> = run.users.iter().flat_map(|it| it.list.clone()).collect();
    assert!(!with_user.is_empty() && with_user.iter().all(|it| *it == with_user[0] && it.user == 1), "{with_user:?}");
    let tally = run.pointers.users_tally().unwrap();
    assert_eq!((tally.decided, tally.shared.get(&1), tally.unknown.get(&120)), (1, Some(&1), Some(&1)), "{tally:?}");
}

#[test]
fn light_that_becomes_another_users_gets_a_new_identity() {
    // The first user lets go in the very place and moment in which the third one presses.
    let run = run_with(with_users(), 4.0, |_, time_s| {
        let period_ms = if time_s < 1.5 { 60.0 } else { 84.0 };
        if is_lit(period_ms, time_s) { vec![([1.2, 0.5], 20, 255)] } else { vec![] }
    });
    assert_eq!(run.ids(), [1, 2]);
    let last = run.users.last().unwrap();
    assert_eq!((last.list.len(), last.of(TargetId(2))), (1, Some(3)));
    assert_eq!(run.pointers.users_tally().unwrap().changed, 1);
}

#[test]
fn codes_that_cannot_be_told_apart_are_refused() {
    let refused = |users: &[(u32, f64)]| {
        let users = users
            .iter()
            .map(|(user, period_ms)| UserCode { user: *user, period_ms: Some(*period_ms), colour: None })
            .collect();
        let error = TrackerSettings { users, ..TrackerSettings::default() }.check().err();
        error.map(|it| (it.setting.unwrap_or_default(), it.message)).unwrap_or_default()
    };
    assert_eq!(refused(&[(1, 60.0), (2, 64.0)]).0, "");
    assert_eq!(refused(&[(1, 60.0), (1, 80.0)]).0, "users[1]");
    let (setting, message) = refused(&[(1, 60.0), (2, 80.0), (3, 62.0)]);
    assert!(setting == "users[2]" && message.contains("60 ms and 62 ms, expected them to be 5 % apart"), "{message}");
    assert_eq!(refused(&[(1, 30.0)]).0, "users[0].period_ms");
}

fn of_colours(labels: &[u32]) -> TrackerSettings {
    let users = labels.iter().zip(1..).map(|(label, user)| UserCode { user, period_ms: None, colour: Some(*label) });
    TrackerSettings { users: users.collect(), ..TrackerSettings::default() }
}

#[test]
fn a_user_is_known_by_colour_within_a_tenth_of_a_second() {
    let run = run_labelled(of_colours(&[10, 20]), 0.5, |_, time_s| {
        vec![(([0.6 + 0.3 * time_s, 0.5], 20, 255), Some(20)), (([1.8, 0.7], 20, 255), Some(10))]
    });
    let users = run.users.iter().find(|it| it.list.len() == 2).unwrap();
    assert!(users.time < Time::from_s(0.1), "{:?}", users.time);
    let last = &run.targets.last().unwrap().2;
    for target in last {
        let expected = if target.position.x < 1.2 { 2 } else { 1 };
        assert_eq!(run.users.last().unwrap().of(target.id), Some(expected));
    }
}

#[test]
fn two_that_rest_on_one_another_and_part_either_way_keep_their_identities_by_colour() {
    // They come together, rest as one spot for a tenth of a second, and part again the way they came: velocities say that they went through each other.
    for bounces in [false, true] {
        let place = move |who: f64, time_s: f64| {
            let off = match time_s {
                ..0.5 => 0.6 * (0.5 - time_s),
                0.5..0.6 => 0.0,
                _ if bounces => 0.6 * (time_s - 0.6),
                _ => -0.6 * (time_s - 0.6),
            };
            [1.2 + who * off, 0.6]
        };
        let run = run_labelled(of_colours(&[10, 20]), 1.2, |_, time_s| {
            let [a, b] = [place(1.0, time_s), place(-1.0, time_s)];
            if (a[0] - b[0]).abs() < 0.008 {
                return vec![(([f64::midpoint(a[0], b[0]), 0.6], 30, 255), None)];
            }
            vec![((a, 20, 255), Some(10)), ((b, 20, 255), Some(20))]
        });
        assert_eq!(run.ids(), [1, 2], "bounces {bounces}");
        let user_at = |at: usize, right: bool| {
            let (_, _, list) = &run.targets[at];
            let target = list.iter().find(|it| (it.position.x > 1.2) == right).unwrap();
            (target.id, run.users[at].of(target.id))
        };
        let end = run.targets.len() - 1;
        // User 1 comes from the right.
        assert_eq!(user_at(40, true).1, Some(1));
        assert_eq!(user_at(end, bounces), user_at(40, true));
        assert_eq!(user_at(end, !bounces), user_at(40, false));
    }
}

#[test]
fn a_press_of_another_colour_where_one_ended_is_another_pointer_and_a_light_that_stays_is_the_same() {
    let with_gap = |gap_s: f64| {
        let run = run_labelled(of_colours(&[10, 20]), 1.0, |_, time_s| match time_s - 0.5 {
            since if since < 0.0 => vec![(([1.2, 0.5], 20, 255), Some(10))],
            since if since < gap_s => Vec::new(),
            _ => vec![(([1.2, 0.5], 20, 255), Some(20))],
        });
        let users: Vec<u32> = run.users.last().unwrap().list.iter().map(|it| it.user).collect();
        (run.ids().len(), users)
    };
    assert_eq!(with_gap(0.04), (2, vec![2]), "dark in between: another light");
    assert_eq!(with_gap(0.0), (1, vec![2]), "seen all the time: its colour was wrong before");
}

#[test]
fn pointers_far_from_each_other_are_never_exchanged_whatever_their_labels_say() {
    // Contents behind both give each the other's label for a tenth of a second, and then for good.
    for until_s in [0.6, 2.0] {
        let run = run_labelled(of_colours(&[10, 20]), 1.2, |_, time_s| {
            let wrong = (0.5..until_s).contains(&time_s);
            let labels = if wrong { [20, 10] } else { [10, 20] };
            vec![(([0.6, 0.5], 20, 255), Some(labels[0])), (([1.8, 0.5], 20, 255), Some(labels[1]))]
        });
        assert_eq!(run.ids().len(), 2, "until {until_s} s");
        assert!(run.users.iter().all(|it| it.exchanged.is_empty()));
        let sides = run.targets.iter().flat_map(|(_, _, list)| list.iter().map(|it| (it.id, it.position.x > 1.2)));
        let right: Vec<bool> = sides.filter(|it| it.0 == TargetId(1)).map(|it| it.1).collect();
        assert!(right.windows(2).all(|it| it[0] == it[1]), "each stays on its side");
    }
}

#[test]
fn users_that_nothing_tells_apart_are_refused() {
    let refused = |users: &[(u32, Option<f64>, Option<u32>)]| {
        let users = users.iter().map(|(user, period_ms, colour)| UserCode {
            user: *user,
            period_ms: *period_ms,
            colour: *colour,
        });
        let fault = TrackerSettings { users: users.collect(), ..TrackerSettings::default() }.check().unwrap_err();
        (fault.setting.unwrap_or_default(), fault.message)
    };
    assert_eq!(refused(&[(1, None, Some(3)), (2, None, None)]).0, "users[1]");
    let alike = refused(&[(1, None, Some(3)), (2, None, Some(3))]);
    assert!(alike.1.contains("the colour of user 1 again"), "{}", alike.1);
    let both = [(1, Some(60.0), Some(3)), (2, Some(80.0), Some(3))];
    let users = both.map(|(user, period_ms, colour)| UserCode { user, period_ms, colour }).to_vec();
    assert!(TrackerSettings { users: users.clone(), ..TrackerSettings::default() }.check().is_ok());
    let long = TrackerSettings { users, dark_ms: 200.0, lost_ms: 300.0, ..TrackerSettings::default() }.check();
    let long = long.unwrap_err();
    assert!(long.to_string().contains("expected at most 150 ms"), "{long}");
}
