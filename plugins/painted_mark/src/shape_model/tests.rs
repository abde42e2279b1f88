//! Tests of the node: marks out as measured or filled, models acquired and read, targets in the space of the scale.

use foveate::estimation::Random;
use foveate::estimation::statistics::median;
use foveate::messages::ScaleId;
use foveate::node::scale::{ScalePlace, ScaleTree};
use foveate_testkit::check_node;
use nalgebra::{Isometry3, UnitQuaternion};

use super::*;

const N_MARKS: usize = 40;
const SIGMA: f64 = 2e-4;

/// A face of 40 marks that walks about while it moves in three ways.
struct Face {
    places: Vec<Point3<f64>>,
    random: Random,
    /// Of waves that run over the skin, which nobody showed while the model was acquired [m].
    swing: f64,
    /// That see each of its marks.
    cameras: u16,
}

impl Face {
    fn new() -> Self {
        let mut random = Random::new(40);
        let place = |_| {
            let (y, z) = (random.uniform_in(-0.07, 0.07), random.uniform_in(-0.09, 0.09));
            Point3::new(0.08 - 6.0 * y * y - 3.0 * z * z, y, z)
        };
        Self { places: (0..N_MARKS).map(place).collect(), random: Random::new(41), swing: 0.0, cameras: 2 }
    }

    fn world_from_face(time_s: f64) -> Isometry3<f64> {
        let place = Vector3::new(0.3 * time_s.sin(), 0.2 * time_s, 1.6);
        Isometry3::from_parts(
            place.into(),
            UnitQuaternion::from_euler_angles(0.1 * time_s.sin(), 0.2 * time_s.cos(), 0.4),
        )
    }

    /// Where the marks truly are in the world.
    fn truth(&self, time_s: f64) -> Vec<Point3<f64>> {
        let ways = [(0.0, -0.05, 2.1, 0.02), (0.03, -0.03, 3.3, 0.008), (0.0, 0.06, 1.3, 0.006)];
        let moved = |it: &Point3<f64>| {
            let mut place = *it;
            for (y, z, rate, size) in ways {
                let apart = ((it.y - y).powi(2) + (it.z - z).powi(2)) / (2.0 * 0.03_f64.powi(2));
                place.z -= size * (-apart).exp() * (0.5 - 0.5 * (rate * time_s).cos());
            }
            place.x += self.swing * (50.0 * it.y + 30.0 * it.z + 7.0 * time_s).sin();
            Self::world_from_face(time_s) * place
        };
        self.places.iter().map(moved).collect()
    }

    /// As an integrator would tell it: the world's axes, the origin near the marks' middle.
    fn marks(&mut self, time_s: f64, is_seen: impl Fn(usize) -> bool) -> Marks {
        let truth = self.truth(time_s);
        let world_from_marks = Isometry3::translation(0.01, 0.2 * time_s, 1.61);
        let mut noise = || Vector3::new(self.random.normal(), self.random.normal(), self.random.normal()) * SIGMA;
        let mark = |(label, place): (usize, &Point3<f64>)| Mark {
            label: label as u32,
            position: world_from_marks.inverse() * (place + noise()),
            covariance: Matrix3::identity() * SIGMA * SIGMA,
            cameras: (1..=self.cameras).map(CameraId).collect(),
            provenance: Provenance::Measured,
        };
        Marks {
            time: Time::from_s(time_s),
            world_from_marks,
            covariance: Matrix6::identity() * 1e-8,
            list: truth.iter().enumerate().filter(|it| is_seen(it.0)).map(mark).collect(),
            fit: None,
        }
    }
}

fn acquiring() -> ShapeSettings {
    ShapeSettings { acquire_from_s: 0.5, acquire_until_s: 6.5, frames: 90, ..ShapeSettings::default() }
}

fn node(settings: ShapeSettings) -> Shape {
    Shape::new(settings, &Setup::for_tests()).unwrap()
}

/// A node that has acquired a model by 7 s.
fn modelled(face: &mut Face, settings: ShapeSettings, setup: &Setup) -> Shape {
    let mut shape = Shape::new(settings, setup).unwrap();
    for frame in 0..105 {
        let (marks, _) = shape.step(&face.marks(f64::from(frame) / 15.0, |_| true)).unwrap();
        assert_eq!(marks.fit.is_some(), frame >= 98, "{frame}");
    }
    shape
}

#[test]
fn node_keeps_the_law() {
    check_node::<Shape>("");
    check_node::<Shape>("acquire_from_s = 2\nacquire_until_s = 8\nwrite = \"face.model.toml\"\nkind = \"faces\"");
}

#[test]
fn settings_that_do_not_go_together_are_refused() {
    let refused = |change: fn(&mut ShapeSettings)| {
        let mut settings = ShapeSettings::default();
        change(&mut settings);
        Shape::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting)
    };
    assert_eq!(refused(|_| ()), None);
    assert_eq!(refused(|it| it.bases = 0).as_deref(), Some("bases"));
    assert_eq!(refused(|it| it.noise_mm = f64::NAN).as_deref(), Some("noise_mm"));
    assert_eq!(refused(|it| it.gate_sigmas = 1.0).as_deref(), Some("gate_sigmas"));
    assert_eq!(refused(|it| it.model = "no/such.toml".to_owned()).as_deref(), Some("model"));
    assert_eq!(refused(|it| it.write = "a.toml".to_owned()).as_deref(), Some("write"));
    let backwards = refused(|it| (it.acquire_from_s, it.acquire_until_s) = (5.0, 4.0));
    assert_eq!(backwards.as_deref(), Some("acquire_until_s"));
}

#[test]
fn without_a_model_marks_go_out_as_measured_with_a_pose() {
    let (mut face, mut shape) = (Face::new(), node(ShapeSettings::default()));
    let first = shape.step(&face.marks(0.0, |it| it < 30)).unwrap().0;
    let start = first.world_from_marks;
    for frame in 1..40 {
        let time_s = f64::from(frame) / 10.0;
        // Other marks come into view as the head turns.
        let measured = face.marks(time_s, |it| it >= frame as usize / 4 || it == 2);
        let (marks, targets) = shape.step(&measured).unwrap();
        assert!(marks.fit.is_none() && marks.list.len() == measured.list.len());
        for (given, out) in measured.list.iter().zip(&marks.list) {
            assert!(
                (measured.in_world(given) - marks.in_world(out)).norm() < 1e-12
                    && out.provenance == Provenance::Measured
            );
        }
        // The face deforms by centimetres, the pose hardly notices.
        let turned = Face::world_from_face(time_s) * Face::world_from_face(0.0).inverse();
        let off = (turned * start).inverse() * marks.world_from_marks;
        assert!(off.rotation.angle() < 0.06 && off.translation.vector.norm() < 0.008, "{frame}: {off}");
        assert_eq!(targets.unwrap().list.len(), measured.list.len());
    }
}

#[test]
fn hidden_marks_are_filled_in_their_place_and_measured_ones_stay() {
    for kind in [Kind::Components, Kind::Faces] {
        let mut face = Face::new();
        let mut shape = modelled(&mut face, ShapeSettings { kind, ..acquiring() }, &Setup::for_tests());
        let (mut errors, mut squares) = (Vec::new(), 0.0);
        for frame in 0..30 {
            let time_s = 7.0 + f64::from(frame) / 9.0;
            let is_seen = |it: usize| !(it + frame as usize).is_multiple_of(4);
            let measured = face.marks(time_s, is_seen);
            let (marks, targets) = shape.step(&measured).unwrap();
            let targets = targets.unwrap();
            assert_eq!((marks.list.len(), targets.list.len()), (N_MARKS, N_MARKS));
            for ((mark, target), truth) in marks.list.iter().zip(&targets.list).zip(face.truth(time_s)) {
                assert_eq!(
                    (target.id.0, target.provenance, target.cameras.len()),
                    (mark.label, mark.provenance, mark.cameras.len())
                );
                assert!((target.position - marks.in_world(mark)).norm() < 1e-12);
                match measured.get(mark.label) {
                    Some(given) => assert!((measured.in_world(given) - target.position).norm() < 1e-12),
                    None => {
                        assert_eq!((mark.provenance, mark.cameras.len()), (Provenance::Filled, 0));
                        let off = target.position - truth;
                        errors.push(off.norm());
                        let known = target.covariance.fixed_view::<3, 3>(0, 0).try_inverse().unwrap();
                        squares += off.dot(&(known * off)) / 3.0;
                    }
                }
            }
            assert!(marks.fit.unwrap().out_of_distribution < 1.0);
        }
        let stated = squares / errors.len() as f64;
        assert!(median(&errors).unwrap() < 4e-4, "{kind:?}: {:?}", median(&errors));
        assert!((0.2..2.5).contains(&stated), "{kind:?}: {stated}");
        let mut report = Report::default();
        shape.finish(&mut report).unwrap();
        assert_eq!(report.figures["shape.filled"], errors.len() as f64);
        assert_eq!(report.figures["shape.acquired_from_frames"], 90.0);
        assert!(report.figures["shape.fit_rms_mm.median"] < 0.6, "{:?}", report.figures);
    }
}

#[test]
fn filled_marks_are_stated_as_well_as_held_out_ones_were() {
    for (swing, least) in [(0.0, 0.1), (1e-3, 0.4), (3e-3, 0.4)] {
        let mut face = Face::new();
        let mut shape = modelled(&mut face, acquiring(), &Setup::for_tests());
        face.swing = swing;
        let far_side: Vec<bool> = face.places.iter().map(|it| it.y > 0.035).collect();
        let (mut squares, mut n) = (0.0, 0.0);
        for frame in 0..160 {
            let time_s = 7.0 + f64::from(frame) / 15.0;
            let (marks, targets) = shape.step(&face.marks(time_s, |it| !far_side[it])).unwrap();
            let targets = targets.unwrap();
            let filled = marks.list.iter().zip(&targets.list).zip(face.truth(time_s));
            for ((_, target), truth) in filled.filter(|it| it.0.0.provenance == Provenance::Filled) {
                let off = target.position - truth;
                let known = target.covariance.fixed_view::<3, 3>(0, 0).try_inverse().unwrap();
                squares += off.dot(&(known * off)) / 3.0;
                n += 1.0;
            }
        }
        let stated = squares / n;
        assert!(n > 500.0 && (least..1.5).contains(&stated), "{n} marks, swing {swing}: {stated}");
        let mut report = Report::default();
        shape.finish(&mut report).unwrap();
        let [median, p95] = ["median", "p95"].map(|it| report.figures[&format!("shape.held_out_mm.{it}")]);
        assert!(median < p95 && (0.05..3.0).contains(&median), "{median} {p95}");
    }
}

#[test]
fn a_mark_that_cameras_would_see_where_the_model_has_it_is_stated_vaguer_and_left_out_where_that_is_asked() {
    let face = Face::new();
    let apart = |it: usize| {
        let others = face.places.iter().enumerate().filter(|other| other.0 != it);
        others.map(|other| (other.1 - face.places[it]).norm()).fold(f64::INFINITY, f64::min)
    };
    let alone = (0..N_MARKS).max_by(|a, b| apart(*a).total_cmp(&apart(*b))).unwrap();
    let turned_away: Vec<bool> = face.places.iter().map(|it| it.y > 0.0).collect();
    let far = (0..N_MARKS).max_by(|a, b| face.places[*a].y.total_cmp(&face.places[*b].y)).unwrap();
    // What is stated of mark number `of` after half a second in which marks are hidden, and the marks left out by then.
    let stated = |of: usize, is_hidden: &dyn Fn(usize) -> bool, most_sigma_mm: f64| {
        let mut face = Face { cameras: 3, ..Face::new() };
        let settings = ShapeSettings { most_sigma_mm, ..acquiring() };
        let mut shape = modelled(&mut face, settings, &Setup::for_tests());
        let frames = (0..8).map(|it| 7.1 + f64::from(it) / 15.0);
        let last = frames.map(|time_s| shape.step(&face.marks(time_s, |it| !is_hidden(it))).unwrap().0).last().unwrap();
        let mut report = Report::default();
        shape.finish(&mut report).unwrap();
        (last.get(of as u32).map(Mark::sigma), report.figures["shape.left_out"])
    };
    let folded = stated(alone, &|it| it == alone, 0.0).0.unwrap();
    assert!(folded > 0.8 * apart(alone) / 12.0_f64.sqrt() && folded > 1e-3, "{folded} m, {} m", apart(alone));
    assert_eq!(stated(alone, &|it| it == alone, 1.0), (None, 8.0));
    let away = stated(far, &|it| turned_away[it], 0.0).0.unwrap();
    assert!(away < 1e-3, "{away} m: no camera sees what is around it");
    assert!(stated(far, &|it| turned_away[it], 1.0).0.is_some());
}

#[test]
fn a_mark_that_follows_something_else_is_filled_instead() {
    let mut face = Face::new();
    let mut shape = modelled(&mut face, acquiring(), &Setup::for_tests());
    let mut measured = face.marks(7.3, |_| true);
    measured.list[11].position.z += 0.02;
    let (marks, _) = shape.step(&measured).unwrap();
    let off = marks.in_world(&marks.list[11]) - face.truth(7.3)[11];
    assert!(marks.list[11].provenance == Provenance::Filled && off.norm() < 1e-3, "{}", off.norm());
    assert_eq!(marks.list.iter().filter(|it| it.provenance == Provenance::Filled).count(), 1);
}

#[test]
fn too_few_marks_are_a_gap_with_its_reason() {
    let (mut face, mut shape) = (Face::new(), node(ShapeSettings::default()));
    assert_eq!(shape.step(&face.marks(0.0, |it| it < 7)).unwrap_err(), "7 marks are measured, expected 8 or more");
    assert!(shape.step(&face.marks(0.1, |it| it < 8)).is_ok(), "a start with few leads nowhere wrong");
    let mut shape = modelled(&mut face, acquiring(), &Setup::for_tests());
    assert_eq!(shape.step(&face.marks(7.1, |it| it == 3)).unwrap_err(), "1 marks are measured, expected 8 or more");
    assert!(shape.step(&face.marks(7.2, |_| true)).is_ok());
    assert!(shape.step(&Marks::default()).is_err());
}

#[test]
fn the_acquired_model_serves_another_session() {
    let folder = tempfile::tempdir().unwrap();
    let mut setup = Setup::for_tests();
    setup.out_dir = Some(folder.path().to_owned());
    let mut face = Face::new();
    let mut first = modelled(&mut face, ShapeSettings { write: "face.model.toml".to_owned(), ..acquiring() }, &setup);
    let path = folder.path().join("face.model.toml");
    let mut second = node(ShapeSettings { model: path.display().to_string(), ..ShapeSettings::default() });
    let measured = face.marks(7.4, |it| it % 3 != 1);
    assert_eq!(first.step(&measured).unwrap().0, second.step(&measured).unwrap().0);
}

#[test]
fn a_session_without_marks_says_why_there_is_no_model() {
    let mut shape = node(acquiring());
    let mut face = Face::new();
    let mut line = face.marks(1.0, |_| true);
    line.list.iter_mut().for_each(|it| it.position = Point3::new(f64::from(it.label) * 0.01, 0.0, 0.0));
    assert!(shape.step(&line).is_err());
    assert!(shape.step(&face.marks(8.0, |_| true)).is_ok());
    let mut report = Report::default();
    shape.finish(&mut report).unwrap();
    assert!(report.remarks[0].contains("no model of the shape was acquired"), "{:?}", report.remarks);
}

#[test]
fn targets_are_in_the_space_of_the_scale() {
    let place =
        |name: &str, parent: Option<ScaleId>, is_anchored| ScalePlace { name: name.to_owned(), parent, is_anchored };
    let mut setup = Setup::for_tests();
    setup.scales = ScaleTree {
        own: ScaleId(1),
        places: vec![place("room", None, false), place("face", Some(ScaleId(0)), true)].into(),
    };
    setup.connected = vec!["space".to_owned()];
    let (mut face, mut shape) = (Face::new(), Shape::new(ShapeSettings::default(), &setup).unwrap());
    let measured = face.marks(1.0, |_| true);
    assert!(shape.step(&measured).unwrap().1.unwrap_err().contains("face"), "its pose is unknown yet");
    let parent_from_scale = Isometry3::translation(0.5, 0.2, 1.5);
    shape.spaces.as_mut().unwrap().learn(&ScaleSpace {
        scale: ScaleId(1),
        time: Time::from_s(1.0),
        target: Some(TargetId(0)),
        parent_from_scale,
        covariance: Matrix6::identity() * 1e-6,
        velocity: Vector3::zeros(),
        motion_covariance: Matrix6::zeros(),
    });
    let (marks, targets) = shape.step(&measured).unwrap();
    let target = &targets.unwrap().list[5];
    assert!((parent_from_scale * target.position - marks.in_world(&marks.list[5])).norm() < 1e-12);
    assert!(target.covariance[(0, 0)] > 1e-6, "what is uncertain of the scale is in it");
}
