//! The node over a camera that fails on command, its settings, and what a program without cameras says.

use std::time::Instant;

use super::fake::{Act, Fake};
use super::*;
use crate::settings::tests::setup_with_camera;

/// Settings out of TOML, with a device.
#[track_caller]
pub(crate) fn settings(toml: &str) -> V4lSettings {
    toml::from_str(&format!("device = '/dev/video0'\n{toml}")).unwrap()
}

#[test]
fn node_keeps_its_promises() {
    foveate_testkit::check_node::<V4l>("device = '/dev/video0'\nwidth = 640\nrate_hz = 30.0\nexposure_us = 2000.0");
}

#[test]
fn settings_that_no_camera_could_take_are_refused_before_a_run() {
    let setup = Setup { purpose: Purpose::Check, ..setup_with_camera([640, 480]) };
    let refused = |toml: &str, setup: &Setup| {
        let error = V4l::new(settings(toml), setup).map(|_| ()).unwrap_err();
        (error.setting.unwrap_or_default(), error.message)
    };
    assert_eq!(refused("buffers = 1", &setup).0, "buffers");
    assert_eq!(refused("timeout_ms = 1.0", &setup).0, "timeout_ms");
    assert_eq!(refused("rate_hz = nan", &setup).0, "rate_hz");
    let (setting, message) = refused("device_format = 'H264'", &setup);
    assert_eq!(setting, "device_format");
    assert!(message.contains("`H264`, expected `auto` or one of `GREY`"), "{message}");
    let (setting, message) = refused("height = 720", &setup);
    assert_eq!(setting, "height");
    assert!(message.contains("found 720, expected 480"), "{message}");
    let no_camera = Setup { camera: None, ..setup };
    assert!(refused("", &no_camera).1.contains("each"));
}

#[test]
fn layouts_are_named_in_either_case_and_without_their_blank() {
    assert_eq!(settings("device_format = 'y16'").fourcc(), Ok(Some(*b"Y16 ")));
    assert_eq!(settings("").fourcc(), Ok(None));
}

#[cfg(not(all(feature = "hardware", target_os = "linux")))]
#[test]
fn program_without_cameras_says_how_to_build_it_with_them() {
    let refused = V4l::new(settings(""), &setup_with_camera([2, 2])).map(|_| ()).unwrap_err();
    assert!(refused.message.contains("--features hardware"), "{refused}");
    assert_eq!(describe_devices().unwrap_err(), refused.message);
}

#[cfg(all(feature = "hardware", target_os = "linux"))]
#[test]
fn device_that_is_not_there_or_is_none_is_refused_with_those_that_are() {
    for (path, what) in [("/dev/video4711", "is not there"), ("/dev/null", "is no video device")] {
        let settings = V4lSettings { device: path.to_owned(), ..settings("") };
        let refused = V4l::new(settings, &setup_with_camera([2, 2])).map(|_| ()).unwrap_err();
        assert_eq!(refused.setting.as_deref(), Some("device"));
        assert!(refused.message.contains(path) && refused.message.contains(what), "{refused}");
    }
    assert!(describe_devices().is_ok());
}

/// Waits until the node has something to give out, and returns when that is due.
fn wait(node: &mut V4l) -> Time {
    let started = Instant::now();
    loop {
        match node.due() {
            Due::At(time) => return time,
            Due::Waiting => std::thread::yield_now(),
            Due::Never => panic!("the camera is over"),
        }
        assert!(started.elapsed() < Duration::from_secs(20), "nothing came");
    }
}

#[test]
fn node_gives_out_pictures_on_the_session_clock_and_reports_figures() {
    let script = [vec![Act::Frame; 3], vec![Act::Lose(1), Act::Frame, Act::Unplug(1), Act::Frame]].concat();
    let fake = Fake::new(b"GREY", &script);
    let setup = setup_with_camera([2, 2]);
    let mut node = V4l::with_device(settings(""), &setup, Box::new(fake)).unwrap();
    assert_eq!(node.due(), Due::At(Time::ZERO), "the stream is started before the clock of the session");
    node.start_reading().unwrap();
    let (mut n_pictures, mut n_lost) = (0, 0);
    let mut last = i64::MIN;
    while n_pictures + n_lost < 6 {
        wait(&mut node);
        let turn = node.pending.take().unwrap();
        assert!(turn.stamp > last && turn.arrival >= turn.stamp);
        last = turn.stamp;
        n_lost += turn.lost.iter().map(|it| it.count).sum::<u64>();
        match turn.what {
            What::Picture(_) => {
                n_pictures += 1;
                node.statistics.add(turn.stamp, turn.arrival);
            }
            What::Gap(_) => n_lost += 1,
        }
    }
    let mut report = Report::default();
    node.finish(&mut report).unwrap();
    let figure = |name: &str| report.figures[&format!("v4l.{name}.{}", setup.camera_name().unwrap())];
    assert!(n_pictures >= 1);
    assert_eq!(figure("frames"), n_pictures as f64);
    assert!((figure("latency_ms.mean") - super::fake::LATENCY as f64 * 1e-6).abs() < 1e-9);
    assert!(report.remarks[0].contains("start of the exposure"), "{:?}", report.remarks);
}

#[test]
fn exposure_and_gain_change_before_and_while_the_camera_streams() {
    let fake = Fake::new(b"GREY", &vec![Act::Frame; 50]);
    let log = std::sync::Arc::clone(&fake.log);
    let setup = setup_with_camera([2, 2]);
    let mut node = V4l::with_device(settings(""), &setup, Box::new(fake)).unwrap();
    assert_eq!(Node::change(&mut node, settings("gain = 5")), Ok(()));
    node.start_reading().unwrap();
    wait(&mut node);
    assert_eq!(Node::change(&mut node, settings("gain = 7")), Ok(()));
    let refused = Node::change(&mut node, settings("gain = 300")).unwrap_err();
    assert_eq!(
        (refused.setting.as_deref(), refused.message.as_str()),
        (Some("gain"), "found 300, the device takes 0 to 100")
    );
    assert_eq!(node.settings.gain, Some(7), "it goes on with what it had");
    assert_eq!(log.lock().unwrap().iter().filter(|it| **it == "change").count(), 3);
    wait(&mut node);
}

#[test]
fn check_opens_nothing() {
    let fake = Fake::new(b"GREY", &[]);
    let log = std::sync::Arc::clone(&fake.log);
    let setup = Setup { purpose: Purpose::Check, ..setup_with_camera([2, 2]) };
    let mut node = V4l::with_device(settings(""), &setup, Box::new(fake)).unwrap();
    assert_eq!(node.due(), Due::Never);
    assert!(log.lock().unwrap().is_empty());
}

/// The node over a camera that loses a frame, spoils one, and is unplugged for a while.
struct Troubled(V4l);

impl Node for Troubled {
    const TYPE: &'static str = "test.camera";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "A camera in trouble";
    type Settings = V4lSettings;

    fn ports() -> Ports {
        V4l::ports()
    }

    fn new(settings: V4lSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let trouble = [Act::Lose(3), Act::Frame, Act::Damaged, Act::Frame, Act::Unplug(3)];
        let script = [vec![Act::Frame; 30], trouble.to_vec(), vec![Act::Frame; 10]].concat();
        let mut fake = Fake::new(b"GREY", &script);
        fake.keeps_time = true;
        V4l::with_device(settings, setup, Box::new(fake)).map(Self)
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        self.0.process(io)
    }

    fn due(&mut self) -> Due {
        self.0.due()
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.0.finish(report)
    }
}

#[test]
fn live_run_has_a_gap_for_each_frame_that_is_missing_and_goes_on() {
    use foveate_embed::{engine, rig};

    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    write("cameras.toml", include_str!("../../../../tests/vivid/cameras.calibration.toml"));
    write(
        "rig.toml",
        "[rig]\nname = 'a'\ncalibration = 'cameras.toml'\nduration_s = 1.8\n\
         [scale.room.node.video]\ntype = 'test.camera'\ncamera = 'gray'\ndevice = 'x'\n",
    );
    let mut registry = Registry::new();
    registry.add::<Troubled>();
    let graph = rig::load_file(&folder.path().join("rig.toml"), &registry, &rig::Overrides::default());
    let graph = graph.unwrap_or_else(|faults| panic!("{}", faults.render(false)));
    let outcome = engine::live(graph.into(), &engine::Options::default(), &mut |_| {}).unwrap();
    let count =
        |reason: &str| -> u64 { outcome.gaps.iter().filter(|it| it.reason.contains(reason)).map(|it| it.count).sum() };
    assert_eq!((count("the driver lost"), count("damaged")), (3, 1), "{:?}", outcome.gaps);
    assert!(count("the camera is gone") >= 3, "the gap itself, and the frames of its absence: {:?}", outcome.gaps);
    let figure = |name: &str| outcome.report.figures[&format!("v4l.{name}.gray")];
    assert_eq!((figure("reopenings"), figure("lost_by_driver"), figure("unusable")), (1.0, 3.0, 1.0));
    let told: u64 = outcome.gaps.iter().map(|it| it.count).sum();
    assert_eq!(figure("gaps"), told as f64);
    assert!(outcome.gaps.iter().all(|it| it.time >= Time::ZERO && it.time <= outcome.ended));
    assert!(outcome.faults.is_empty(), "{:?}", outcome.faults);
}
