//! Settings of a head and its connection.

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::driver::DriverSettings;
use crate::port::Port;
use crate::visca::{Profile, ip};

/// Supported models of heads.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Model {
    /// Sony EVI-D30 and EVI-D31.
    #[default]
    EviD30,
    /// Sony EVI-D100, not in its D30 mode.
    EviD100,
}

/// Settings of [`Actuator`](super::Actuator).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ActuatorSettings {
    /// Port of the head: the path of a serial port, preferably a lasting name under `/dev/serial/by-id`, or `udp://HOST` or `udp://HOST:PORT` for
    /// VISCA over IP; `{camera}` becomes the camera's name. Left out: it is simulated, at the input `line` [–].
    pub port: Option<String>,
    /// Baud rate of the serial line: 9600 for most heads, some support 38400 [bit/s].
    #[schemars(range(min = 300, max = 1_000_000))]
    pub baud: u32,
    /// Model of the head: `evi-d30` or `evi-d100` [–].
    pub model: Model,
    /// Any other model: digits, units, ranges and speeds, in place of `model` [–].
    pub profile: Option<Profile>,
    /// Smallest interval between two reports; events in between are in the next one [ms].
    #[schemars(range(min = 0.0, max = 500.0))]
    pub report_every_ms: f64,
    /// Settings of the driver.
    #[serde(flatten)]
    pub driver: DriverSettings,
}

impl Default for ActuatorSettings {
    fn default() -> Self {
        Self {
            port: None,
            baud: 9600,
            model: Model::default(),
            profile: None,
            report_every_ms: 10.0,
            driver: DriverSettings::default(),
        }
    }
}

impl ActuatorSettings {
    /// The model's profile.
    pub fn profile(&self) -> Profile {
        self.profile.clone().unwrap_or_else(|| match self.model {
            Model::EviD30 => Profile::evi_d30(),
            Model::EviD100 => Profile::evi_d100(),
        })
    }

    /// Port of the head; `None` when it is simulated.
    ///
    /// # Errors
    /// Points at `port`: an address without a host, or a path as [`Setup::path`] refuses it.
    pub(super) fn port(&self, setup: &Setup) -> Result<Option<Port>, ConfigError> {
        let Some(port) = &self.port else { return Ok(None) };
        let Some(address) = port.strip_prefix("udp://") else {
            if port.is_empty() || port.contains("://") {
                let message = format!("found `{port}`, expected the path of a serial port, or `udp://HOST:PORT`");
                return Err(ConfigError::at("port", message));
            }
            return Ok(Some(Port::Serial { path: setup.path("port", port)?, baud: self.baud }));
        };
        let address = address.replace("{camera}", setup.camera_name().unwrap_or_default());
        let (host, number) = match address.rsplit_once(':') {
            // The colons of a bare IPv6 address are none before a port.
            Some((host, number)) if !host.contains(':') || host.ends_with(']') => (host, number.parse::<u16>().ok()),
            _ => (address.as_str(), Some(ip::PORT)),
        };
        match number {
            Some(number) if !host.is_empty() && number > 0 => Ok(Some(Port::Udp { host: host.to_owned(), number })),
            _ => {
                let message =
                    format!("found `{port}`, expected `udp://HOST` or `udp://HOST:PORT` with a port from 1 to 65535");
                Err(ConfigError::at("port", message))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn port(text: &str) -> Result<Option<Port>, ConfigError> {
        ActuatorSettings { port: Some(text.to_owned()), ..ActuatorSettings::default() }.port(&Setup::for_tests())
    }

    #[test]
    fn ports_are_paths_or_addresses() {
        let udp = |host: &str, number| Ok(Some(Port::Udp { host: host.to_owned(), number }));
        assert_eq!(port("udp://10.0.0.7"), udp("10.0.0.7", 52_381));
        assert_eq!(port("udp://head.local:1259"), udp("head.local", 1259));
        assert_eq!(port("udp://[fe80::1]:1259"), udp("[fe80::1]", 1259));
        assert_eq!(port("udp://[fe80::1]"), udp("[fe80::1]", 52_381));
        let serial = port("/dev/serial/by-id/usb-head");
        assert_eq!(serial, Ok(Some(Port::Serial { path: "/dev/serial/by-id/usb-head".into(), baud: 9600 })));
        for wrong in ["", "udp://", "udp://:80", "udp://host:0", "udp://host:99999", "tcp://host:80", "udp://h:http"] {
            assert!(port(wrong).is_err_and(|it| it.setting.as_deref() == Some("port")), "{wrong}");
        }
        assert!(port("/dev/head-{camera}").is_err(), "there is no camera here");
    }
}
