//! A simulated pan-tilt head as a source: the line to it, and its motion.

use foveate_node::{
    ConfigError, Due, Figures, Io, Line, Node, NodeError, Plan, Ports, Report, Role, Setup, Time, figures, ports,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::head::{Axes, AxesSettings, HeadMotion, HeadSettings, LineFaults, LineHead, LineSettings, NetworkSettings};

ports! {
    LINE: Out<Line> = "line";
    MOTION: Out<HeadMotion> = "motion";
}

figures! {
    "sim_head.buffer_full.*": count, low, "Messages that the simulated head refused because its buffer was full";
}

/// How a head is reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Over {
    /// A serial line.
    Serial,
    /// UDP.
    Network,
}

/// What a simulated head and its line are like.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SimHeadSettings {
    /// The head: by default a Sony EVI-D30.
    #[serde(flatten)]
    pub head: HeadSettings,
    /// `serial`, or `network`: VISCA over IP [–].
    pub over: Over,
    /// The serial line, if that is what it is reached by [–].
    pub line: LineSettings,
    /// The network, if that is what it is reached by [–].
    pub network: NetworkSettings,
    /// Where its axes really are. Left out: those of the calibration, and where that has none, those of a plausible EVI-D30, a degree and
    /// centimetres off. What its optics are at each zoom position is always the calibration's table [–].
    pub axes: Option<AxesSettings>,
    /// From when until when its line is pulled out [s].
    pub unplugged_s: Option<[f64; 2]>,
    /// From when until when it answers nothing, and still executes commands [s].
    pub silent_s: Option<[f64; 2]>,
    /// From when until when the line turns bits over [s].
    pub garbage_s: Option<[f64; 2]>,
    /// Share of the bytes that it then changes [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub garbage: f64,
}

impl Default for SimHeadSettings {
    fn default() -> Self {
        Self {
            head: HeadSettings::default(),
            over: Over::Serial,
            line: LineSettings::default(),
            network: NetworkSettings::default(),
            axes: None,
            unplugged_s: None,
            silent_s: None,
            garbage_s: None,
            garbage: 0.5,
        }
    }
}

/// Gives the line and the motion once, at time 0, before any camera looks. Both lead to one head, which lives on the clock of the run.
pub struct SimHead {
    motion: HeadMotion,
    name: String,
    is_up: bool,
}

impl Node for SimHead {
    const TYPE: &'static str = "sim.head";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "A simulated pan-tilt head: mechanics, VISCA, serial line, and faults on demand";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = SimHeadSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SimHeadSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let (Some(id), Some(camera)) = (setup.camera, setup.camera_model()) else {
            return Err(ConfigError::node(
                "found no camera, expected `each` or `camera` to name the cameras of the calibration that stand on heads",
            ));
        };
        let calibrated = setup.head_model();
        let mut mechanics = match (&settings.axes, &calibrated) {
            (None, Some(head)) => head.model.clone(),
            (axes, _) => {
                let axes = axes.clone().unwrap_or_default();
                axes.check().map_err(|fault| within("axes", fault))?;
                Axes::new(&axes).carrying(camera)
            }
        };
        mechanics.zoom = calibrated.and_then(|it| it.model.zoom);
        let faults = settings.faults()?;
        let seed = setup.random.fork("head").next_u64();
        let head = match settings.over {
            Over::Serial => {
                settings.line.check().map_err(|fault| within("line", fault))?;
                LineHead::serial(&settings.head, &settings.line, faults, seed)?
            }
            Over::Network => {
                settings.network.check().map_err(|fault| within("network", fault))?;
                LineHead::network(&settings.head, &settings.network, faults, seed)?
            }
        };
        Ok(Self {
            motion: HeadMotion::new(id, head, mechanics),
            name: setup.camera_name().unwrap_or_default().to_owned(),
            is_up: false,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if !std::mem::replace(&mut self.is_up, true) {
            io.emit_at(&LINE, Time::ZERO, self.motion.line());
            io.emit_at(&MOTION, Time::ZERO, self.motion.clone());
        }
        Ok(())
    }

    fn due(&mut self) -> Due {
        if self.is_up { Due::Never } else { Due::At(Time::ZERO) }
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure(format!("sim_head.buffer_full.{}", self.name), self.motion.n_refused_full() as f64);
        Ok(())
    }

    fn plan(settings: &SimHeadSettings) -> Plan {
        Plan { reacts_after_s: settings.head.reaction_ms * 1e-3, ..Plan::default() }
    }
}

impl SimHeadSettings {
    fn faults(&self) -> Result<LineFaults, ConfigError> {
        ConfigError::unless_in("garbage", self.garbage, 0.0..=1.0)?;
        let span = |name: &str, given: Option<[f64; 2]>| match given {
            None => Ok(None),
            Some([from, to]) if (0.0..=1e9).contains(&from) && from < to && to <= 1e9 => {
                Ok(Some(Time::from_s(from)..Time::from_s(to)))
            }
            Some([from, to]) => {
                let message =
                    format!("found {from} to {to}, expected two times, the later one second, within 0 to 1e9");
                Err(ConfigError::at(name, message))
            }
        };
        Ok(LineFaults {
            unplugged: span("unplugged_s", self.unplugged_s)?,
            silent: span("silent_s", self.silent_s)?,
            garbage: span("garbage_s", self.garbage_s)?.map(|it| (it, self.garbage)),
        })
    }
}

/// A fault of a setting inside the table `name`.
fn within(name: &str, fault: ConfigError) -> ConfigError {
    let setting = fault.setting.as_deref().unwrap_or_default();
    ConfigError::at(&format!("{name}.{setting}"), fault.message)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_messages::CameraId;
    use foveate_testkit::check_node;

    use super::*;
    use crate::lab::lab_calibration;

    fn setup() -> Setup {
        let mut setup = Setup::for_tests();
        (setup.calibration, setup.camera) = (Arc::new(lab_calibration()), Some(CameraId(0)));
        setup
    }

    #[test]
    fn node_keeps_the_law() {
        check_node::<SimHead>("");
        check_node::<SimHead>("over = \"network\"\nvibration_hz = 0\nnetwork.lost = 0.1\ntilt.speeds = 10");
        check_node::<SimHead>(
            "unplugged_s = [1, 2]\nsilent_s = [3, 4]\ngarbage_s = [0, 9]\naxes.pan_leans_deg = [0, 3]",
        );
    }

    #[test]
    fn settings_out_of_range_and_a_missing_camera_are_refused() {
        let refusal = |change: fn(&mut SimHeadSettings)| {
            let mut settings = SimHeadSettings::default();
            change(&mut settings);
            SimHead::new(settings, &setup()).err().and_then(|it| it.setting)
        };
        assert_eq!(refusal(|_| ()), None);
        assert_eq!(refusal(|it| it.head.tilt.speeds = 0).as_deref(), Some("tilt.speeds"));
        assert_eq!(refusal(|it| it.line.baud = 0.0).as_deref(), Some("line.baud"));
        let network = |it: &mut SimHeadSettings| (it.over, it.network.lost) = (Over::Network, f64::NAN);
        assert_eq!(refusal(network).as_deref(), Some("network.lost"));
        assert_eq!(refusal(|it| it.unplugged_s = Some([2.0, 1.0])).as_deref(), Some("unplugged_s"));
        assert_eq!(refusal(|it| it.garbage = 1.5).as_deref(), Some("garbage"));
        let axes = |it: &mut SimHeadSettings| {
            it.axes = Some(AxesSettings { tilt_leans_deg: [f64::NAN, 0.0], ..AxesSettings::default() });
        };
        assert_eq!(refusal(axes).as_deref(), Some("axes.tilt_leans_deg"));
        let without_camera = SimHead::new(SimHeadSettings::default(), &Setup::for_tests());
        assert!(without_camera.is_err_and(|it| it.setting.is_none()));
    }
}
