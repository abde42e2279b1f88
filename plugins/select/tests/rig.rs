//! The nodes in a rig: pictures of cameras around a target whose path is known.

use std::fs;
use std::sync::Arc;

use foveate::prelude::*;
use foveate_embed::engine::{self, Options};
use foveate_embed::rig::{self, Overrides};
use foveate_testkit::scene::ring_calibration;
use nalgebra::{Matrix6, Point2, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const RATE_HZ: f64 = 30.0;
const TARGETS: Out<Targets> = Out::new(0, "targets");
const IMAGE_OUT: Out<Image> = Out::new(0, "image");
const IMAGE_IN: In<Image> = In::each(0, "image");

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct NoSettings {}

/// Along a circle of 0.8 m, once in 6 s.
fn path(time_s: f64) -> (Point3<f64>, Vector3<f64>) {
    let (sine, cosine) = (std::f64::consts::TAU / 6.0 * time_s).sin_cos();
    let speed = 0.8 * std::f64::consts::TAU / 6.0;
    (Point3::new(0.8 * cosine, 0.8 * sine, 1.0), Vector3::new(-speed * sine, speed * cosine, 0.0))
}

/// Knows the target, seen by all of eight cameras, from the first second to the fifth.
struct Walk(u32);

impl Node for Walk {
    const TYPE: &'static str = "test.walk";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "A target.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().output(&TARGETS)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self(0))
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time = io.now();
        let (position, velocity) = path(time.as_s());
        let cameras = (0..8).map(CameraId).collect();
        let covariance = Matrix6::identity() * 1e-6;
        let target =
            Target { id: TargetId(3), position, velocity, covariance, cameras, provenance: Provenance::Measured };
        let list = if (1.0..5.0).contains(&time.as_s()) { vec![target] } else { vec![] };
        self.0 += 1;
        io.emit_at(&TARGETS, time, Targets { time, list });
        Ok(())
    }
    fn due(&mut self) -> Due {
        Due::At(Time::from_s(f64::from(self.0) / RATE_HZ))
    }
}

/// A camera that looks 10 ms after the target was measured.
struct Film(CameraId, u32);

impl Node for Film {
    const TYPE: &'static str = "test.film";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Pictures.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().output(&IMAGE_OUT)
    }
    fn new(_settings: NoSettings, setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self(setup.camera.unwrap_or_default(), 0))
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        self.1 += 1;
        let image = Image { camera: self.0, width: 640, height: 480, pixels: vec![9; 640 * 480], ..Image::default() };
        io.emit_at(&IMAGE_OUT, io.now(), image);
        Ok(())
    }
    fn due(&mut self) -> Due {
        Due::At(Time::from_s(0.01 + f64::from(self.1) / RATE_HZ))
    }
}

/// How far the target is from the middle of each picture that comes.
struct Judge {
    instance: String,
    model: foveate::geometry::Camera,
    count: u32,
    worst_px: f64,
}

impl Node for Judge {
    const TYPE: &'static str = "test.judge";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Knows the path.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&IMAGE_IN)
    }
    fn new(_settings: NoSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let model = setup.camera_model().ok_or_else(|| ConfigError::node("expected a camera"))?.clone();
        Ok(Self { instance: setup.instance.clone(), model, count: 0, worst_px: 0.0 })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(image) = io.take(&IMAGE_IN) else { return Ok(()) };
        let [width, height] = [image.value.width, image.value.height].map(f64::from);
        let middle = image.value.window.in_camera(&Point2::new((width - 1.0) / 2.0, (height - 1.0) / 2.0));
        let off = self.model.project(&path(image.time().as_s()).0).map_or(f64::INFINITY, |it| (it - middle).norm());
        self.count += 1;
        self.worst_px = off.max(self.worst_px);
        Ok(())
    }
    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure(format!("count.{}", self.instance), self.count.into());
        report.figure(format!("worst_px.{}", self.instance), self.worst_px);
        Ok(())
    }
}

const RIG: &str = r#"
    [rig]
    name = "select"
    calibration = "ring.toml"
    duration_s = 6
    [scale.room.node.walk]
    type = "test.walk"
    [scale.room.node.video]
    type = "test.film"
    each = "ring-*"
    [scale.room.node.choice]
    type = "select.cameras"
    in = { targets = "walk.targets" }
    [scale.room.node.gate]
    type = "select.gate"
    each = "ring-*"
    in = { image = "video.image", choice = "choice.choice" }
    [scale.room.node.passed]
    type = "test.judge"
    each = "ring-*"
    in = { image = "gate.image" }
    [scale.face]
    parent = "room"
    anchor = "walk.head"
    radius_m = 0.2
    [scale.face.node.crop]
    type = "select.crop"
    each = "ring-*"
    in = { image = "room.video.image", target = "room.walk.targets" }
    width_px = 81
    height_px = 61
    [scale.face.node.inside]
    type = "test.judge"
    each = "ring-*"
    in = { image = "crop.inside" }
    [scale.face.node.coarse]
    type = "test.judge"
    each = "ring-*"
    in = { image = "crop.coarse" }
"#;

#[test]
fn parts_follow_the_target_and_the_gate_lets_through_those_that_see_it() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("ring.toml"), ring_calibration(8).to_toml()).unwrap();
    let mut registry = Registry::default();
    foveate_select::register(&mut registry);
    registry.add::<Walk>();
    registry.add::<Film>();
    registry.add::<Judge>();
    let graph = rig::load(RIG, &folder.path().join("select.toml"), &registry, &Overrides::default())
        .unwrap_or_else(|faults| panic!("{}", faults.render(false)));
    let outcome = engine::deterministic(Arc::new(graph), &Options::default(), &mut |_| {}).unwrap();
    let figures = outcome.report.figures;
    let each = |what: &str, name: fn(&str, u32) -> String| -> Vec<f64> {
        (1..=8).map(|it| figures[&name(what, it)]).collect()
    };
    let instance: fn(&str, u32) -> String = |what, it| format!("{what}[ring-{it}]");
    let camera: fn(&str, u32) -> String = |what, it| format!("{what}.ring-{it}");
    // Four seconds of the target, less the 100 ms that it is watched first, in the middle but for whole pixels.
    let counts = each("count.face.inside", instance);
    assert!(counts.iter().all(|it| (110.0..122.0).contains(it)), "{counts:?}");
    let off = each("worst_px.face.inside", instance);
    assert!(off.iter().all(|it| *it < 1.0), "{off:?}");
    assert_eq!(each("count.face.coarse", instance), [180.0; 8]);
    // All of eight for two seconds, three or four for four, and the looks of the others.
    let sum = |list: Vec<f64>| list.iter().sum::<f64>();
    let passed = sum(each("count.room.passed", instance));
    assert_eq!(passed, sum(each("gate.passed", camera)) + sum(each("gate.looks", camera)));
    assert_eq!(passed + sum(each("gate.left_out", camera)), 8.0 * 180.0, "nothing is lost uncounted");
    assert!((840.0..1100.0).contains(&passed), "{passed}");
}
