//! Detectors are exchangeable: in one rig only `type` and settings of the detector change, all connections stay.

use std::fs;
use std::sync::Arc;

use foveate::prelude::*;
use foveate_engine::{self as engine, Options};
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::scene::{add_spot, ring_calibration};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

const RATE_HZ: f64 = 30.0;
/// Until then the room is empty and detectors learn it [s].
const ENTERS_S: f64 = 1.5;
/// From here on the target must be there [s].
const SETTLED_S: f64 = 2.0;
const END_S: f64 = 5.0;

const IMAGE: Out<Image> = Out::new(0, "image");
const TARGETS: In<Targets> = In::each(0, "targets");

/// The ball's path.
fn ball_at(time_s: f64) -> Point3<f64> {
    let (sine, cosine) = (1.5 * time_s).sin_cos();
    Point3::new(0.6 * cosine, 0.6 * sine, 1.0 + 0.2 * (2.0 * time_s).sin())
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
struct NoSettings {}

/// Shows a camera a gray room, and later a bright ball in it.
struct Film {
    id: CameraId,
    model: foveate::geometry::Camera,
    frame: u32,
}

impl Node for Film {
    const TYPE: &'static str = "test.film";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Shows a ball.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().output(&IMAGE)
    }
    fn new(_settings: NoSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let model = setup.camera_model().ok_or_else(|| ConfigError::node("expected a camera"))?.clone();
        Ok(Self { id: setup.camera.unwrap_or_default(), model, frame: 0 })
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time_s = f64::from(self.frame) / RATE_HZ;
        let [width, height] = self.model.image_size;
        let pixels = vec![60; (width * height) as usize];
        let mut image =
            Image { camera: self.id, width, height, format: PixelFormat::Gray8, pixels, ..Image::default() };
        if let Some(pixel) = self.model.project(&ball_at(time_s)).filter(|_| time_s >= ENTERS_S) {
            add_spot(&mut image, [pixel.x, pixel.y], 4.0, 180.0);
        }
        self.frame += 1;
        io.emit_at(&IMAGE, io.now(), image);
        Ok(())
    }
    fn due(&mut self) -> Due {
        Due::At(Time::from_s(f64::from(self.frame) / RATE_HZ))
    }
}

/// Compares the targets with the path.
#[derive(Default)]
struct Judge {
    samples: u32,
    wrong_count: u32,
    errors_m: Vec<f64>,
}

impl Node for Judge {
    const TYPE: &'static str = "test.judge";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Knows the path.";
    type Settings = NoSettings;
    fn ports() -> Ports {
        Ports::new().input(&TARGETS)
    }
    fn new(_settings: NoSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self::default())
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(targets) = io.take(&TARGETS) else { return Ok(()) };
        let time_s = targets.value.time.as_s();
        if time_s >= SETTLED_S {
            self.samples += 1;
            self.wrong_count += u32::from(targets.value.list.len() != 1);
            self.errors_m.extend(targets.value.list.iter().map(|it| (it.position - ball_at(time_s)).norm()));
        }
        Ok(())
    }
    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.errors_m.sort_by(f64::total_cmp);
        report.figure("samples", self.samples.into());
        report.figure("wrong_count", self.wrong_count.into());
        report.figure("error_m.median", self.errors_m.get(self.errors_m.len() / 2).copied().unwrap_or(f64::NAN));
        report.figure("error_m.max", self.errors_m.last().copied().unwrap_or(f64::NAN));
        Ok(())
    }
}

#[test]
fn only_the_type_and_its_settings_change_between_detectors() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("ring.toml"), ring_calibration(4).to_toml()).unwrap();
    let mut registry = foveate_cli::registry();
    registry.add::<Film>();
    registry.add::<Judge>();
    for detector in
        ["type = \"led.detector\"\noffset = 20", "type = \"blob.detector\"\nmin_area_px = 20\nshape_error = 0.02"]
    {
        let text = format!(
            r#"
            [rig]
            name = "exchange"
            calibration = "ring.toml"
            duration_s = {END_S}
            [scale.room]
            volume_m = {{ min = [-1.5, -1.5, 0], max = [1.5, 1.5, 2] }}
            [scale.room.node.video]
            type = "test.film"
            each = "ring-*"
            [scale.room.node.seen]
            {detector}
            each = "ring-*"
            in = {{ image = "video.image", predicted = "targets.predicted" }}
            [scale.room.node.targets]
            type = "led.integrator"
            in = {{ features = "seen.features" }}
            [scale.room.node.judge]
            type = "test.judge"
            in = {{ targets = "targets.targets" }}
            "#
        );
        let path = folder.path().join("exchange.toml");
        let graph = rig::load(&text, &path, &registry, &Overrides::default())
            .unwrap_or_else(|faults| panic!("{detector}: {}", faults.render(false)));
        let outcome = engine::deterministic(Arc::new(graph), &Options::default(), &mut |_| {}).unwrap();
        let figure = |name: &str| outcome.report.figures[name];
        println!("{detector}\n{:?}", outcome.report.figures);
        let expected = 4.0 * (END_S - SETTLED_S) * RATE_HZ;
        assert!((figure("samples") - expected).abs() < 0.1 * expected, "{detector}: {} samples", figure("samples"));
        assert_eq!(figure("wrong_count"), 0.0, "{detector}: one ball is one target");
        assert!(figure("error_m.median") < 0.003, "{detector}: median {} m", figure("error_m.median"));
        assert!(figure("error_m.max") < 0.02, "{detector}: at most {} m", figure("error_m.max"));
    }
}
