//! Small node types to make rigs of, four cameras, and one way to load a rig.

use std::path::Path;

use foveate_messages::{Features, Image, Marks, ScaleSpace, SubRegion, Targets};
use foveate_node::{ConfigError, In, Io, Message, Node, NodeError, Out, Plan, Ports, Registry, Role, Setup};
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Diagnostics, Overrides};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where the next points are to be looked for; of no camera and no scale.
pub struct Hints;

impl Message for Hints {
    const NAME: &'static str = "hints";
    const SPACE: foveate_messages::Space = foveate_messages::Space::NONE;
    const WIRE: foveate_messages::Wire = foveate_messages::Wire::Local;
}

macro_rules! part {
    ($name:ident, $settings:ty, $type:literal, $role:ident, $ports:expr) => {
        part!($name, $settings, $type, $role, $ports, |_, _| Ok(()), |_| Plan::default());
    };
    ($name:ident, $settings:ty, $type:literal, $role:ident, $ports:expr, $check:expr, $plan:expr) => {
        pub struct $name;
        impl Node for $name {
            const TYPE: &'static str = $type;
            const ROLE: Role = Role::$role;
            const SUMMARY: &'static str = "A part for tests.";
            type Settings = $settings;
            fn ports() -> Ports {
                $ports
            }
            fn new(settings: Self::Settings, setup: &Setup) -> Result<Self, ConfigError> {
                let check: fn(&$settings, &Setup) -> Result<(), ConfigError> = $check;
                check(&settings, setup).map(|()| $name)
            }
            fn process(&mut self, _io: &mut Io<'_>) -> Result<(), NodeError> {
                Ok(())
            }
            fn plan(settings: &Self::Settings) -> Plan {
                let plan: fn(&$settings) -> Plan = $plan;
                plan(settings)
            }
        }
    };
}

#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Nothing {}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CameraSettings {
    /// Pictures a second [Hz].
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
    /// Time from the shutter to the first byte [ms].
    #[schemars(range(min = 0.0))]
    pub latency_ms: f64,
    /// Where the pictures lie; `{camera}` is the camera's name [path].
    pub folder: Option<String>,
}

impl Default for CameraSettings {
    fn default() -> Self {
        Self { rate_hz: 60.0, latency_ms: 5.0, folder: None }
    }
}

fn camera_plan(settings: &CameraSettings) -> Plan {
    Plan { rate_hz: Some(settings.rate_hz), latency_s: settings.latency_ms * 1e-3, ..Plan::default() }
}

fn camera_check(settings: &CameraSettings, setup: &Setup) -> Result<(), ConfigError> {
    match &settings.folder {
        Some(folder) => {
            let path = setup.path("folder", folder)?;
            if path.is_dir() {
                Ok(())
            } else {
                Err(ConfigError::at(
                    "folder",
                    format_args!("there is no folder `{folder}` of camera {}", setup.camera_name().unwrap_or("-")),
                ))
            }
        }
        None => Ok(()),
    }
}

part!(
    Camera,
    CameraSettings,
    "test.camera",
    Source,
    Ports::new().output(&Out::<Image>::new(0, "image")),
    camera_check,
    camera_plan
);

/// How a spot's centre is found.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Centre {
    /// Weighted by intensity.
    #[default]
    Weighted,
    /// The middle of the box.
    Middle,
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Window {
    /// Edge of the square [px].
    #[schemars(range(min = 1, max = 640))]
    pub size_px: u32,
    /// Corners cut away [px].
    pub corners: Vec<[f64; 2]>,
}

impl Default for Window {
    fn default() -> Self {
        Self { size_px: 40, corners: Vec::new() }
    }
}

#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum Mask {
    /// Everything is looked at.
    #[default]
    Open,
    /// A circle is looked at.
    Circle {
        /// Its radius [px].
        radius_px: f64,
    },
}

#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorSettings {
    /// Brighter than the background by this [gray level, 0..=255].
    #[schemars(range(min = 1.0, max = 255.0))]
    pub offset: f64,
    /// Smallest spot [px²].
    pub min_area: u32,
    /// Largest spot [px²].
    pub max_area: u32,
    /// How the centre is found [word].
    pub centre: Centre,
    /// Where to look first [px].
    pub window: Window,
    /// What is looked at at all [word].
    pub mask: Mask,
    /// Stops on too much light [fraction].
    pub relearn: Option<f64>,
}

impl Default for DetectorSettings {
    fn default() -> Self {
        Self {
            offset: 20.0,
            min_area: 1,
            max_area: 400,
            centre: Centre::Weighted,
            window: Window::default(),
            mask: Mask::Open,
            relearn: Some(0.25),
        }
    }
}

part!(
    Detector,
    DetectorSettings,
    "test.detector",
    Detector,
    Ports::new()
        .input(&In::<Image>::each(0, "image"))
        .input(&In::<Hints>::latest(1, "hints").optional())
        .output(&Out::<Features>::new(0, "features")),
    |settings, _| ConfigError::unless_in("min_area", settings.min_area, 1..=settings.max_area),
    |_| Plan { latency_s: 0.002, ..Plan::default() }
);

part!(
    Integrator,
    Nothing,
    "test.integrator",
    Integrator,
    Ports::new()
        .input(&In::<Features>::newest_of_each(0, "features").many())
        .output(&Out::<Targets>::new(0, "targets"))
        .output(&Out::<Hints>::new(1, "hints"))
);

part!(
    Joiner,
    Nothing,
    "test.joiner",
    Integrator,
    Ports::new().input(&In::<Features>::synced(0, "features", 8).many()).output(&Out::<Targets>::new(0, "targets"))
);

part!(
    Smoother,
    Nothing,
    "test.smoother",
    ModelFilter,
    Ports::new().input(&In::<Targets>::each(0, "targets")).output(&Out::<Targets>::new(0, "targets"))
);

part!(Spaces, Nothing, "test.spaces", Sink, Ports::new().input(&In::<ScaleSpace>::each(0, "spaces").many()));

part!(
    Region,
    Nothing,
    "test.region",
    Selector,
    Ports::new()
        .input(&In::<Targets>::each(0, "targets").of_parent())
        .output(&Out::<SubRegion>::new(0, "region"))
        .output(&Out::<Marks>::new(1, "marks"))
);

part!(
    RegionUser,
    Nothing,
    "test.region_user",
    Sink,
    Ports::new().input(&In::<SubRegion>::each(0, "region").optional()).input(&In::<Marks>::each(1, "marks").optional())
);

part!(Listener, Nothing, "test.listener", Sink, Ports::new().input(&In::<Hints>::latest(0, "hints").many()));

/// Settings without defaults.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct AimSettings {
    /// From command to motion [ms].
    #[schemars(range(min = 0.0, max = 2000.0))]
    pub latency_ms: f64,
}

part!(
    Aim,
    AimSettings,
    "test.aim",
    Selector,
    Ports::new().input(&In::<Targets>::each(0, "target").of_parent()).output(&Out::<Hints>::new(0, "command"))
);

part!(Motor, Nothing, "test.motor", Actuator, Ports::new().input(&In::<Hints>::each(0, "command")));

part!(
    SlowMotor,
    Nothing,
    "test.slow_motor",
    Actuator,
    Ports::new().input(&In::<Hints>::each(0, "command")).output(&Out::<Hints>::new(0, "report")),
    |_, _| Ok(()),
    |_| Plan { latency_s: 0.040, ..Plan::default() }
);

part!(Table, Nothing, "test.table", Sink, Ports::new().input(&In::<Targets>::each(0, "targets").many()));

part!(
    Panic,
    Nothing,
    "test.panic",
    Sink,
    Ports::new().input(&In::<Targets>::each(0, "targets").optional()),
    |_, _| panic!("no hands"),
    |_| Plan::default()
);

pub fn registry() -> Registry {
    let mut registry = registry_of_calm_parts();
    registry.add::<Panic>();
    registry
}

/// All but the one that panics.
pub fn registry_of_calm_parts() -> Registry {
    let mut registry = registry_without_aim();
    registry.add::<Aim>();
    registry
}

/// All but the one that panics and the one that aims.
pub fn registry_without_aim() -> Registry {
    let mut registry = Registry::new();
    registry.add::<Camera>();
    registry.add::<Detector>();
    registry.add::<Integrator>();
    registry.add::<Joiner>();
    registry.add::<Smoother>();
    registry.add::<Region>();
    registry.add::<RegionUser>();
    registry.add::<Spaces>();
    registry.add::<Motor>();
    registry.add::<SlowMotor>();
    registry.add::<Table>();
    registry.add::<Listener>();
    registry
}

/// The path of a rig that lies beside the calibration.
pub fn path() -> &'static Path {
    Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/rig/lab.toml"))
}

pub fn load(text: &str) -> Result<Graph, Diagnostics> {
    rig::load(text, path(), &registry(), &Overrides::default())
}

#[track_caller]
pub fn good(text: &str) -> Graph {
    load(text).unwrap_or_else(|faults| panic!("{faults}"))
}

#[track_caller]
pub fn bad(text: &str) -> Diagnostics {
    match load(text) {
        Ok(graph) => panic!("no fault in {graph:?}"),
        Err(faults) => faults,
    }
}
