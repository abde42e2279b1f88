//! What a simulated head is like. The defaults are the Sony EVI-D30 where its manuals give a figure, and say so where not.

use foveate_node::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Everything about a simulated head but its line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default)]
pub struct HeadSettings {
    /// Side to side, positive to the right [–].
    pub pan: PanSettings,
    /// Up and down, positive up [–].
    pub tilt: TiltSettings,
    /// Acceleration of both axes; no manual says for the EVI-D30 [°/s²].
    #[schemars(range(min = 1.0, max = 100_000.0))]
    pub acceleration_deg_per_s2: f64,
    /// Frequency at which the camera swings on the motors when they stop ([Davis 2002 §4.3] saw it, without figures); 0: it is rigid [Hz].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub vibration_hz: f64,
    /// Damping of that oscillation, as a part of the critical damping [–].
    #[schemars(range(min = 0.01, max = 1.0))]
    pub vibration_damping: f64,
    /// What drives the axes. Left out: motors that follow their orders exactly, within speed and acceleration [–].
    pub motor: Option<MotorSettings>,
    /// From the acknowledgement of a move to its first step, at least: [Davis 2002 §4.4] found 250 ms and more [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub latency_ms: f64,
    /// Additional random delay, uniform from 0 to this, for each move; moves keep their order [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub latency_jitter_ms: f64,
    /// From when a message is looked at until motors and zoom feel anything of it, a stop too, at least; no manual says. Two fields: one to look at it, one
    /// for the motors' own control. Pictures from this head are drawn ahead of the rest of the rig by at most so much, so that 0 makes a run slower [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub reaction_ms: f64,
    /// One message is looked at in each of these: a field of NTSC [ms].
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub field_ms: f64,
    /// From the acknowledgement of a command until it takes the place of the one before it, whose socket is then free. No manual says; this
    /// lets a head be directed at 30 Hz and not at 60, as [Davis 2002 §4.3] found [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub take_up_ms: f64,
    /// A new move takes the place of the one being made; otherwise it waits until that one is done [–].
    pub supersedes: bool,
    /// Time from the shortest to the longest focal length [ms].
    #[schemars(range(min = 1.0, max = 60_000.0))]
    pub zoom_travel_ms: f64,
    /// From "power on" to the first command that is executed; no manual says for the EVI-D30 [ms].
    #[schemars(range(min = 0.0, max = 60_000.0))]
    pub power_on_ms: f64,
}

/// Motors that are not ideal: a current that takes time to rise, friction, a gear with play, a counter whose zero wanders.
///
/// No manual gives such figures for the EVI-D30; the defaults are those of a small geared DC motor.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MotorSettings {
    /// Time in which the torque rises from none to that of `acceleration_deg_per_s2`, so that the jerk is limited [ms].
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rise_ms: f64,
    /// Gain of the position loop: commanded speed over remaining distance [1/s].
    #[schemars(range(min = 1.0, max = 100.0))]
    pub position_gain_per_s: f64,
    /// Sliding friction, as a part of the greatest torque; static friction is half as much again [–].
    #[schemars(range(min = 0.0, max = 0.5))]
    pub friction: f64,
    /// Friction that grows with the speed: at the greatest speed, as a part of the greatest torque [–].
    #[schemars(range(min = 0.0, max = 0.5))]
    pub viscous: f64,
    /// Play between the motor, which is counted, and the camera, from end to end [°].
    #[schemars(range(min = 0.0, max = 5.0))]
    pub backlash_deg: f64,
    /// Drift of the counter's zero, standard deviation [°].
    #[schemars(range(min = 0.0, max = 5.0))]
    pub zero_drift_deg: f64,
    /// Time constant of that drift [s].
    #[schemars(range(min = 1.0, max = 100_000.0))]
    pub zero_drift_s: f64,
}

impl Default for MotorSettings {
    fn default() -> Self {
        Self {
            rise_ms: 40.0,
            position_gain_per_s: 12.0,
            friction: 0.08,
            viscous: 0.1,
            backlash_deg: 0.04,
            zero_drift_deg: 0.03,
            zero_drift_s: 120.0,
        }
    }
}

/// One axis: how it counts, how far and how fast it goes. A type for each, since each has its own defaults.
macro_rules! axis_settings {
    ($name:ident, $which:literal, $units_per_deg:literal, $reach_units:literal, $speeds:literal, $max_speed:literal) => {
        #[doc = $which]
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
        #[serde(default, deny_unknown_fields)]
        pub struct $name {
            /// Positions in a degree [units/°].
            #[schemars(range(min = 1.0, max = 1000.0))]
            pub units_per_deg: f64,
            /// From the middle to either end [units].
            #[schemars(range(min = 1, max = 32_767))]
            pub reach_units: i32,
            /// Number of speeds [–].
            #[schemars(range(min = 1, max = 127))]
            pub speeds: u8,
            /// The fastest; the others are even parts of it [°/s].
            #[schemars(range(min = 0.1, max = 1000.0))]
            pub max_speed_deg_per_s: f64,
        }

        impl Default for $name {
            fn default() -> Self {
                Self {
                    units_per_deg: $units_per_deg,
                    reach_units: $reach_units,
                    speeds: $speeds,
                    max_speed_deg_per_s: $max_speed,
                }
            }
        }

        impl $name {
            /// The same, whichever axis it is.
            pub(super) fn axis(&self) -> AxisSettings {
                let Self { units_per_deg, reach_units, speeds, max_speed_deg_per_s } = *self;
                AxisSettings { units_per_deg, reach_units, speeds, max_speed_deg_per_s }
            }
        }
    };
}

axis_settings!(PanSettings, "The axis from side to side.", 8.8, 880, 24, 80.0);
axis_settings!(TiltSettings, "The axis up and down.", 12.0, 300, 20, 50.0);

/// Either axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct AxisSettings {
    /// Positions in a degree.
    pub units_per_deg: f64,
    /// From the middle to either end.
    pub reach_units: i32,
    /// How many there are.
    pub speeds: u8,
    /// The fastest of them.
    pub max_speed_deg_per_s: f64,
}

/// The line to the head: 8 data bits, no parity, 1 stop bit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LineSettings {
    /// Bits a second; a byte is ten of them [1/s].
    #[schemars(range(min = 300.0, max = 1_000_000.0))]
    pub baud: f64,
    /// Share of the bytes that get lost, in both directions [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub lost: f64,
    /// Share of the bytes of which one bit is turned over [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub flipped: f64,
    /// Share of the bytes that another byte follows, from nowhere [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub inserted: f64,
}

/// The network to a head that is reached by UDP.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct NetworkSettings {
    /// How long a datagram takes one way, at least [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub delay_ms: f64,
    /// Additional random delay, uniform from 0 to this, for each, so that datagrams may overtake each other [ms].
    #[schemars(range(min = 0.0, max = 10_000.0))]
    pub delay_jitter_ms: f64,
    /// Share of the datagrams that get lost, in both directions [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub lost: f64,
    /// Share of the bytes of which one bit is turned over [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub garbage: f64,
}

/// Where the axes of a head are, in the space of its camera at pan 0, tilt 0: x to the right, y down, z forward.
///
/// The pan axis would be y and the tilt axis x, both through the centre of projection, if heads were built as models have
/// them. The defaults are a plausible EVI-D30; [Davis 2002] gives no figures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct AxesSettings {
    /// By how much the pan axis leans about x and about z, each -45 to 45 [°].
    pub pan_leans_deg: [f64; 2],
    /// A point of the pan axis, each number -1000 to 1000 [mm].
    pub pan_point_mm: [f64; 3],
    /// By how much the tilt axis leans about y and about z, each -45 to 45 [°].
    pub tilt_leans_deg: [f64; 2],
    /// A point of the tilt axis, each number -1000 to 1000 [mm].
    pub tilt_point_mm: [f64; 3],
}

impl Default for HeadSettings {
    fn default() -> Self {
        Self {
            pan: PanSettings::default(),
            tilt: TiltSettings::default(),
            acceleration_deg_per_s2: 400.0,
            vibration_hz: 8.0,
            vibration_damping: 0.15,
            motor: None,
            latency_ms: 250.0,
            latency_jitter_ms: 20.0,
            reaction_ms: 2000.0 / 59.94,
            field_ms: 1000.0 / 59.94,
            take_up_ms: 20.0,
            supersedes: true,
            zoom_travel_ms: 2500.0,
            power_on_ms: 3000.0,
        }
    }
}

impl Default for LineSettings {
    fn default() -> Self {
        Self { baud: 9600.0, lost: 0.0, flipped: 0.0, inserted: 0.0 }
    }
}

impl Default for NetworkSettings {
    fn default() -> Self {
        Self { delay_ms: 0.3, delay_jitter_ms: 0.2, lost: 0.0, garbage: 0.0 }
    }
}

impl Default for AxesSettings {
    fn default() -> Self {
        Self {
            pan_leans_deg: [1.2, -0.8],
            pan_point_mm: [3.0, 0.0, -32.0],
            tilt_leans_deg: [-0.7, 1.5],
            tilt_point_mm: [0.0, 4.0, -21.0],
        }
    }
}

impl HeadSettings {
    /// Refuses what no head can be.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        for (name, axis) in [("pan", self.pan.axis()), ("tilt", self.tilt.axis())] {
            axis.check().map_err(|fault| {
                let setting = fault.setting.as_deref().unwrap_or_default();
                ConfigError::at(&format!("{name}.{setting}"), fault.message)
            })?;
        }
        ConfigError::unless_in("acceleration_deg_per_s2", self.acceleration_deg_per_s2, 1.0..=100_000.0)?;
        ConfigError::unless_in("vibration_hz", self.vibration_hz, 0.0..=100.0)?;
        ConfigError::unless_in("vibration_damping", self.vibration_damping, 0.01..=1.0)?;
        self.motor.as_ref().map_or(Ok(()), MotorSettings::check)?;
        ConfigError::unless_in("latency_ms", self.latency_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("latency_jitter_ms", self.latency_jitter_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("reaction_ms", self.reaction_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("field_ms", self.field_ms, 1.0..=1000.0)?;
        ConfigError::unless_in("take_up_ms", self.take_up_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("zoom_travel_ms", self.zoom_travel_ms, 1.0..=60_000.0)?;
        ConfigError::unless_in("power_on_ms", self.power_on_ms, 0.0..=60_000.0)
    }
}

impl MotorSettings {
    fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("motor.rise_ms", self.rise_ms, 1.0..=1000.0)?;
        ConfigError::unless_in("motor.position_gain_per_s", self.position_gain_per_s, 1.0..=100.0)?;
        ConfigError::unless_in("motor.friction", self.friction, 0.0..=0.5)?;
        ConfigError::unless_in("motor.viscous", self.viscous, 0.0..=0.5)?;
        ConfigError::unless_in("motor.backlash_deg", self.backlash_deg, 0.0..=5.0)?;
        ConfigError::unless_in("motor.zero_drift_deg", self.zero_drift_deg, 0.0..=5.0)?;
        ConfigError::unless_in("motor.zero_drift_s", self.zero_drift_s, 1.0..=100_000.0)
    }
}

impl AxisSettings {
    fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("units_per_deg", self.units_per_deg, 1.0..=1000.0)?;
        ConfigError::unless_in("reach_units", self.reach_units, 1..=32_767)?;
        ConfigError::unless_in("speeds", self.speeds, 1..=127)?;
        ConfigError::unless_in("max_speed_deg_per_s", self.max_speed_deg_per_s, 0.1..=1000.0)
    }
}

impl LineSettings {
    /// Refuses what no line can be.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("baud", self.baud, 300.0..=1_000_000.0)?;
        ConfigError::unless_in("lost", self.lost, 0.0..=1.0)?;
        ConfigError::unless_in("flipped", self.flipped, 0.0..=1.0)?;
        ConfigError::unless_in("inserted", self.inserted, 0.0..=1.0)
    }
}

impl NetworkSettings {
    /// Refuses what no network can be.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("delay_ms", self.delay_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("delay_jitter_ms", self.delay_jitter_ms, 0.0..=10_000.0)?;
        ConfigError::unless_in("lost", self.lost, 0.0..=1.0)?;
        ConfigError::unless_in("garbage", self.garbage, 0.0..=1.0)
    }
}

impl AxesSettings {
    /// Refuses axes that no head has.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        for (name, leans) in [("pan_leans_deg", self.pan_leans_deg), ("tilt_leans_deg", self.tilt_leans_deg)] {
            leans.into_iter().try_for_each(|it| ConfigError::unless_in(name, it, -45.0..=45.0))?;
        }
        for (name, point) in [("pan_point_mm", self.pan_point_mm), ("tilt_point_mm", self.tilt_point_mm)] {
            point.into_iter().try_for_each(|it| ConfigError::unless_in(name, it, -1000.0..=1000.0))?;
        }
        Ok(())
    }
}
