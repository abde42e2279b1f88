//! A head that was swept before a waved light, as messages; and what must be refused in words.

use foveate::estimation::Random;
use foveate::geometry::Camera;
use foveate::geometry::pan_tilt::{Limits, PanTiltHead, Setting};
use foveate::scene::{LengthUnit, NamedCamera};
use foveate_testkit::check_node;
use nalgebra::{Isometry3, Matrix2, Matrix6, Point2, Point3, Vector2, Vector3, Vector4};

use super::*;

const AT_EACH_S: f64 = 3.0;

/// A head whose axes are a degree and centimetres from where they should be.
fn crooked() -> PanTiltHead {
    let camera = Camera::look_at(Point3::new(-2.6, 0.3, 2.2), Point3::new(0.0, 0.0, 1.2), [640, 480], 700.0);
    let mut head = PanTiltHead::aligned(camera, Limits::symmetric(1.75, 0.43));
    head.pan = head.pan.moved(&Vector4::new(0.02, -0.03, 0.01, -0.035));
    head.tilt = head.tilt.moved(&Vector4::new(-0.012, 0.026, 0.015, -0.02));
    head
}

/// Of two cameras, the second on the head: its optics are right, its pose is anything.
fn calibration() -> Calibration {
    let camera = crooked().at_rest;
    let wide = NamedCamera { name: "wide-1".into(), camera: camera.clone() };
    let ptz =
        NamedCamera { name: "ptz-1".into(), camera: Camera { camera_from_world: Isometry3::identity(), ..camera } };
    Calibration::new(vec![wide, ptz], LengthUnit::Metre, "a test".into()).unwrap()
}

fn setup(out: Option<PathBuf>) -> Setup {
    Setup { calibration: Arc::new(calibration()), out_dir: out, ..Setup::for_tests() }
}

/// What happens in the run besides.
#[derive(Clone, Copy, Default)]
struct Trouble {
    /// A second light in the room from this time on [s].
    second_light_s: Option<f64>,
    /// The head says nothing of where it is.
    mute: bool,
    /// It only pans.
    no_tilt: bool,
}

/// The node after a run, before it ends.
fn run(settings: CalibratorSettings, out: Option<PathBuf>, trouble: Trouble) -> Calibrator {
    let mut node = Calibrator::new(settings, &setup(out)).ok().unwrap();
    let head = crooked();
    let ptz = CameraId(calibration().index_of("ptz-1").unwrap() as u16);
    let mut random = Random::new(4);
    let mut places: Vec<[f64; 2]> = (-5..=5).map(|it| [f64::from(10 * it), 0.0]).collect();
    places.extend((-4..=3).filter(|it| *it != 0).map(|it| [0.0, f64::from(5 * it)]));
    places.extend([[-40.0, -15.0], [40.0, 10.0]]);
    let mut number = 0;
    for (at, place) in places.into_iter().enumerate() {
        let angles = [place[0], if trouble.no_tilt { 0.0 } else { place[1] }].map(f64::to_radians);
        let camera = head.camera_at(&Setting::new(angles[0], angles[1]));
        for step in 0..(AT_EACH_S * 60.0) as u32 {
            let time_s = at as f64 * AT_EACH_S + f64::from(step) / 60.0;
            let pixel =
                |time_s: f64| Point2::new(320.0 + 270.0 * (1.9 * time_s).sin(), 240.0 + 200.0 * (2.7 * time_s).sin());
            let light = |time_s: f64| camera.ray(&pixel(time_s)).unwrap().at(2.4 + 1.2 * (1.1 * time_s).sin());
            let mut normal = || random.normal();
            let noise = Vector3::new(normal(), normal(), normal()) * 1e-3;
            let target = |id: u32, position| Target {
                id: TargetId(id),
                position,
                velocity: (light(time_s + 1e-3) - light(time_s - 1e-3)) / 2e-3,
                covariance: Matrix6::identity() * 1e-6,
                cameras: CameraSet::default(),
                provenance: Provenance::Measured,
            };
            let mut list = vec![target(at as u32, light(time_s) + noise)];
            if trouble.second_light_s.is_some_and(|it| time_s >= it) {
                list.push(target(99, Point3::new(0.0, 0.0, 1.0)));
            }
            node.add_targets(&Targets { time: Time::from_s(time_s), list });
            let seen_s = time_s + 0.005;
            let feature =
                |centre| Feature { centre, covariance: Matrix2::identity() * 0.09, area: 4, peak: 200, label: None };
            let mut list = vec![feature(pixel(seen_s) + Vector2::new(normal(), normal()) * 0.3)];
            if step % 50 == 0 {
                list.push(feature(Point2::new(5.0, 5.0)));
            }
            node.add_features(Time::from_s(seen_s), &Features { camera: ptz, list });
            if step % 6 == 0 && !trouble.mute {
                let (earliest, latest) = (Time::from_s(time_s - 0.03), Time::from_s(time_s + 0.001));
                let position = HeadEvent::Position(HeadPosition { earliest, latest, angles });
                let events = vec![(Time::from_s(time_s), position)];
                node.add_report(&HeadReport { camera: ptz, link: HeadLink::Ready, first: number, events });
                number += 1;
            }
        }
    }
    node
}

fn ended(mut node: Calibrator) -> Report {
    let mut report = Report::default();
    node.finish(&mut report).unwrap();
    report
}

#[test]
fn node_keeps_the_law() {
    check_node::<Calibrator>("");
    check_node::<Calibrator>("units = \"estimated\"\nunits_per_deg = [8.8, 12]\nstacking = \"pan_on_tilt\"");
}

#[test]
fn a_swept_head_is_calibrated_and_stands_in_a_file_with_all_other_cameras() {
    let folder = tempfile::tempdir().unwrap();
    let estimated =
        CalibratorSettings { units: Units::Estimated, units_per_deg: Some([8.8, 12.0]), ..Default::default() };
    let report = ended(run(estimated, Some(folder.path().to_owned()), Trouble::default()));
    let figure = |name: &str| report.figures[&format!("head_calibration.ptz-1.{name}")];
    assert_eq!((report.figures["head_calibration.heads"], figure("settings")), (1.0, 20.0));
    assert!(figure("several_lights") == 20.0 * 4.0 && figure("free_px.median") < 0.7, "{report:?}");
    assert!(figure("aligned_px.rms") > 5.0 * figure("free_px.rms") && figure("home_px.rms") > figure("aligned_px.rms"));
    assert!(figure("holdout_px.rms") < 1.2 * figure("free_px.rms") && figure("pan_place_sigma_mm") < 3.0);
    assert!((figure("pan_range_deg") - 100.0).abs() < 1.0 && (figure("tilt_range_deg") - 35.0).abs() < 1.0);
    let read = Calibration::load(&folder.path().join("heads.calibration.toml")).unwrap();
    let off = read.camera("wide-1").unwrap().camera_from_world * crooked().at_rest.camera_from_world.inverse();
    assert!(off.translation.vector.norm() + off.rotation.angle() < 1e-6, "the other cameras stay where they are");
    let (head, truth) = (read.head("ptz-1").unwrap(), crooked());
    for (found, truth) in [(head.model.pan, truth.pan), (head.model.tilt, truth.tilt)] {
        let step = found.step_to(&truth).unwrap();
        let (degrees, mm) = (step.fixed_rows::<2>(0).norm().to_degrees(), 1e3 * step.fixed_rows::<2>(2).norm());
        assert!(degrees < 0.15 && mm < 5.0, "{degrees}° {mm} mm");
    }
    assert!((head.model.at_rest.centre() - truth.at_rest.centre()).norm() < 3e-3);
    assert!((head.units[0].rad_per_unit.to_degrees() * 8.8 - 1.0).abs() < 1e-3, "{:?}", head.units);
    let drawn = std::fs::read_to_string(folder.path().join("head_models.ptz-1.svg")).unwrap();
    assert!(drawn.contains("The head of ptz-1: errors of"));
    assert_eq!(report.files, [PathBuf::from("head_models.ptz-1.svg"), PathBuf::from("heads.calibration.toml")]);
}

#[track_caller]
fn refused(settings: CalibratorSettings, trouble: Trouble) -> String {
    let folder = tempfile::tempdir().unwrap();
    let report = ended(run(settings, Some(folder.path().to_owned()), trouble));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written");
    report.remarks.join("\n")
}

#[test]
fn what_holds_no_axes_is_refused_with_the_reason() {
    let settings = CalibratorSettings::default;
    let said = refused(settings(), Trouble { no_tilt: true, ..Default::default() });
    assert!(said.contains("the head of ptz-1 is not calibrated: tilt was moved over 0.00°, expected 10.0°"), "{said}");
    let said = refused(settings(), Trouble { second_light_s: Some(0.0), ..Default::default() });
    assert!(said.contains("several lights in the room") && said.contains("position in the room was unknown"), "{said}");
    let said = refused(CalibratorSettings { units: Units::Estimated, ..settings() }, Trouble::default());
    assert!(said.contains("neither `units_per_deg` nor `[head.ptz-1]`"), "{said}");
    let said = refused(CalibratorSettings { most_place_sigma_mm: 0.05, ..settings() }, Trouble::default());
    assert!(said.contains("mm, expected 0.05 mm or better"), "{said}");
    // A camera that no head carries, or whose head says nothing, is left alone.
    assert_eq!(refused(settings(), Trouble { mute: true, ..Default::default() }), "");
}

#[test]
fn settings_out_of_range_are_refused() {
    let refusal = |change: fn(&mut CalibratorSettings)| {
        let mut settings = CalibratorSettings::default();
        change(&mut settings);
        Calibrator::new(settings, &setup(None)).err().and_then(|it| it.setting)
    };
    assert_eq!(refusal(|_| ()), None);
    assert_eq!(refusal(|it| it.units_per_deg = Some([8.8, 0.0])).as_deref(), Some("units_per_deg"));
    assert_eq!(refusal(|it| it.least_tilt_deg = 0.0).as_deref(), Some("least_tilt_deg"));
    assert_eq!(refusal(|it| it.file = "../x".into()).as_deref(), Some("file"));
    assert!(Calibrator::new(CalibratorSettings::default(), &Setup::for_tests()).is_err_and(|it| it.setting.is_none()));
}
