//! The whole way, without faults.

use foveate::geometry::Camera;
use foveate::prelude::*;
use foveate::scene::Calibration;
use foveate_sim::head::{Axes, AxesSettings};

use super::parts::{Heard, WIRED, load, rig_text, run_rig, simulated};

/// A head that does not swing, so that its motors stand where its camera looks.
const RIGID: &str = "vibration_hz = 0";

#[track_caller]
fn angles_at(heard: &Heard, time_s: f64) -> [f64; 2] {
    heard.motion.as_ref().unwrap().angles_at(Time::from_s(time_s)).map(f64::to_degrees)
}

fn close(found: [f64; 2], expected: [f64; 2], within: f64) -> bool {
    found.iter().zip(expected).all(|(a, b)| (a - b).abs() < within)
}

#[test]
fn a_command_becomes_motion_and_a_report_of_it() {
    let text = rig_text(4.0, "go = [[1, 30, -10, 80]]", WIRED, &simulated(RIGID));
    let (outcome, heard) = run_rig(&text);
    assert!(outcome.faults.is_empty() && outcome.gaps.is_empty(), "{:?} {:?}", outcome.faults, outcome.gaps);
    assert!(close(angles_at(&heard, 1.2), [0.0, 0.0], 1e-9));
    assert!(close(angles_at(&heard, 3.9), [30.0, -10.0], 0.12), "{:?}", angles_at(&heard, 3.9));

    let when = |is: &dyn Fn(&HeadEvent) -> bool| heard.events.iter().find(|it| is(&it.1)).map(|it| it.0.as_s());
    let ready = when(&|it| matches!(it, HeadEvent::Link(HeadLink::Ready))).unwrap();
    assert!((0.0..0.5).contains(&ready), "{ready}");
    // The line may be taken by a question and its answer.
    let sent = when(&|it| matches!(it, HeadEvent::Sent(HeadOrder::Go { .. }))).unwrap();
    assert!((1.0..1.05).contains(&sent), "{sent}");
    // 15 bytes, a field, 250 ms of latency and up to 20 more, 30° at 80°/s with 400°/s², 3 bytes.
    let arrived = when(&|it| *it == HeadEvent::Arrived).unwrap();
    assert!((1.8..2.1).contains(&arrived), "{arrived}");
    let HeadEvent::Sent(HeadOrder::Go { angles, speeds }) =
        heard.events.iter().find(|it| matches!(it.1, HeadEvent::Sent(_))).unwrap().1
    else {
        panic!()
    };
    assert!(close(angles.map(f64::to_degrees), [30.0, -10.0], 0.06), "what the head's steps make of it: {angles:?}");
    assert!(close(speeds.map(f64::to_degrees), [80.0, 50.0], 1e-9));
    assert_eq!(outcome.report.figures["heads.wide-3.sent"], 1.0);
}

#[test]
fn positions_are_true_between_their_two_times() {
    let text = rig_text(6.0, "go = [[1, 80, 20, 70], [2.5, -60, -20, 40]]", WIRED, &simulated(RIGID));
    let (_, heard) = run_rig(&text);
    let motion = heard.motion.as_ref().unwrap();
    let mut widest_ms: f64 = 0.0;
    let mut n_moving = 0;
    for (at, event) in &heard.events {
        let HeadEvent::Position(HeadPosition { earliest, latest, angles }) = event else { continue };
        assert!(earliest <= latest && latest < at);
        widest_ms = widest_ms.max((*latest - *earliest).as_ms());
        for axis in 0..2 {
            let ends = [*earliest, *latest].map(|it| motion.angles_at(it)[axis]);
            let step = [1.0 / 8.8, 1.0 / 12.0][axis] * 1.01;
            let [low, high] = [ends[0].min(ends[1]), ends[0].max(ends[1])].map(f64::to_degrees);
            let said = angles[axis].to_degrees();
            assert!((low - step..=high + step).contains(&said), "{said}° is not within {low}° to {high}° at {at}");
            n_moving += usize::from(high - low > step);
        }
    }
    assert!(n_moving > 10, "only {n_moving} answers were of a moving head");
    // A field, and the resolution with which the line is looked at.
    assert!(widest_ms < 20.0, "{widest_ms} ms");
}

#[test]
fn one_run_is_like_another_to_the_last_bit() {
    let text = |settings: &str| {
        let rest = simulated(settings);
        rig_text(3.0, "go = [[0.1, 30, 10, 80], [0.2, 31, 9, 80], [1.5, -20, 0, 33]]", WIRED, &rest)
    };
    let reports = |settings: &str| run_rig(&text(settings)).1.reports;
    for settings in ["", "over = \"network\"\nnetwork.lost = 0.1\nnetwork.delay_jitter_ms = 20", "line.flipped = 0.02"]
    {
        let first = reports(settings);
        assert!(first.len() > 20, "{settings}: {} reports", first.len());
        assert!(first == reports(settings), "{settings}");
    }
    assert!(reports("") != reports("latency_jitter_ms = 60"));
}

#[test]
fn reports_are_no_more_frequent_than_asked_and_lose_nothing() {
    let count = |every_ms: f64| {
        let head = format!("{WIRED}\nreport_every_ms = {every_ms}\nposition_every_ms = 30");
        let (_, heard) = run_rig(&rig_text(5.0, "go = [[1, 30, 10, 80]]", &head, &simulated("")));
        let gaps = heard.reports.windows(2).map(|it| (it[1].0 - it[0].0).as_ms());
        assert!(gaps.fold(f64::INFINITY, f64::min) >= every_ms - 1e-6);
        (heard.reports.len(), heard.events)
    };
    let ((many, all), (few, same)) = (count(0.0), count(400.0));
    assert!(few <= 13 && many > 100, "{few} {many}");
    // What the last report would have told is not told.
    assert!(same.len() > all.len() * 8 / 10 && all[..same.len()] == same[..]);
}

#[test]
fn a_head_turns_at_a_rate_until_it_is_told_otherwise() {
    let text = rig_text(4.0, "turn = [[1, 20, -10], [2, 0, 0]]", WIRED, &simulated(RIGID));
    let (_, heard) = run_rig(&text);
    let [before, after] = [1.5, 2.0].map(|it| angles_at(&heard, it));
    assert!(close([after[0] - before[0], after[1] - before[1]], [10.0, -5.0], 0.15), "{before:?} {after:?}");
    let [early, late] = [2.6, 3.9].map(|it| angles_at(&heard, it));
    assert!(close(early, late, 1e-9) && late[0] > 15.0, "{early:?} {late:?}");
    let turns = heard.events.iter().filter(|it| matches!(it.1, HeadEvent::Sent(HeadOrder::Turn { .. }))).count();
    assert_eq!(turns, 2);
    assert!(!heard.events.iter().any(|it| it.1 == HeadEvent::Arrived), "a head that turns is nowhere there");
}

#[test]
fn commands_at_sixty_hertz_do_not_overflow_the_head() {
    let orders: Vec<String> = (0..240)
        .map(|it| {
            let at = 1.0 + f64::from(it) / 60.0;
            format!("[{at:?}, {:?}, 0, 80]", 20.0 * (at * 2.0).sin())
        })
        .collect();
    let text = rig_text(7.0, &format!("go = [{}]", orders.join(", ")), WIRED, &simulated(""));
    let (outcome, heard) = run_rig(&text);
    let figures = &outcome.report.figures;
    assert_eq!((figures["heads.wide-3.buffer_full"], figures["sim_head.buffer_full.wide-3"]), (0.0, 0.0));
    assert!(figures["heads.wide-3.sent"] > 60.0 && figures["heads.wide-3.replaced"] > 10.0, "{figures:?}");
    let last = 20.0 * f64::sin(2.0 * (1.0 + 239.0 / 60.0));
    assert!((angles_at(&heard, 6.9)[0] - last).abs() < 0.12);
}

#[test]
fn zoom_goes_where_it_is_told() {
    let head = format!("{WIRED}\nzoom_every_ms = 200");
    let (_, heard) = run_rig(&rig_text(4.0, "zoom = [[1, 700]]", &head, &simulated("")));
    let said = heard.events.iter().rev().find_map(|it| match it.1 {
        HeadEvent::Zoom(units) => Some(units),
        _ => None,
    });
    assert_eq!(said, Some(700.0));
    assert_eq!(heard.motion.unwrap().zoom_at(Time::from_s(3.9)), 700.0);
}

#[test]
fn a_camera_on_a_head_sees_as_it_is_turned() {
    let rest = format!(
        r#"{}
        [scale.room.node.lab]
        type = "sim.lab"
        people_enter_s = 0

        [scale.room.node.eye]
        type = "sim.observer"
        camera = "wide-3"
        in = {{ world = "lab.world", head = "device.motion" }}
        bodies = false
        missed = 0
        clutter = 0
        noise_px = 0.001
        spot_width_px = 0
        "#,
        simulated("").replace("in = {", "in = { features = \"eye.features\",")
    );
    let (outcome, heard) = run_rig(&rig_text(3.0, "go = [[0.2, 15, -8, 80]]", WIRED, &rest));
    assert!(outcome.faults.is_empty(), "{:?}", outcome.faults);
    let path = foveate_testkit::data::workspace_root().join("graphs/ideal_lab.calibration.toml");
    let calibration = Calibration::load(&path).unwrap();
    let at_rest = &calibration.cameras[calibration.index_of("wide-3").unwrap()].camera;
    let world = foveate_sim::world::World::new(
        foveate_sim::world::SceneSettings { people_enter_s: 0.0, ..Default::default() },
        &foveate::estimation::random::Random::new(7).fork("room.lab"),
    );
    let motion = heard.motion.as_ref().unwrap();
    let (mut n_checked, mut moved_px) = (0, 0.0_f64);
    for (time, features) in &heard.features {
        // By the simulation's own axes, which know nothing of the calibrated model.
        let [pan, tilt] = motion.angles_at(*time);
        let camera_from_rest = Axes::new(&AxesSettings::default()).rest_from_camera(pan, tilt).inverse();
        let camera_from_world = camera_from_rest * at_rest.camera_from_world;
        let camera = Camera { camera_from_world, ..at_rest.clone() };
        let mut moment = foveate_sim::world::Moment::default();
        world.at(*time, &mut moment);
        let seen: Vec<_> = moment.lights().filter_map(|it| camera.sees(&it.position)).collect();
        assert_eq!(seen.len(), features.list.len(), "at {time}");
        for feature in &features.list {
            let nearest = seen.iter().map(|it| (it - feature.centre).norm()).fold(f64::INFINITY, f64::min);
            assert!(nearest < 0.01, "{nearest} px at {time}");
            n_checked += 1;
        }
        for light in moment.lights() {
            if let (Some(a), Some(b)) = (camera.sees(&light.position), at_rest.project(&light.position)) {
                moved_px = moved_px.max((a - b).norm());
            }
        }
    }
    assert!(n_checked > 200 && moved_px > 100.0, "{n_checked} features, moved by {moved_px} px");
}

#[test]
fn a_head_is_real_or_simulated() {
    let neither = load(&rig_text(1.0, "", r#"in = { commands = "orders.commands" }"#, "")).err().unwrap();
    assert!(neither.contains("neither `port` nor the input `line`"), "{neither}");
    let both = load(&rig_text(1.0, "", &format!("{WIRED}\nport = \"udp://localhost\""), &simulated(""))).err().unwrap();
    assert!(both.contains("a head is real or simulated"), "{both}");
}
