//! `display.osc`: the matrices of each eye and tile over OSC and UDP, for other renderers.
//!
//! A datagram a tile, an OSC bundle of `/foveate/view` messages: name of the tile (s), eye (i: 0 left, 1 right), session time at which the picture is seen (d) [s],
//! the eye's place (fff) [m], and sixteen numbers (f) that map a point of the space to clip space, column by column, as in OpenGL. An eye that is not in front of
//! the tile has no message. At most `rate_hz` a second of session time are sent; messages between them are replaced by newer ones, and counted.

use std::io::ErrorKind;
use std::net::{ToSocketAddrs, UdpSocket};

use foveate::prelude::*;
use rosc::{OscBundle, OscMessage, OscPacket, OscTime, OscType, encoder};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    VIEWS: In<Views> = each("views");
}

figures! {
    "views_osc.sent": count, neither, "Datagrams sent";
        "views_osc.superseded": count, neither, "Messages replaced by a newer one to keep to `rate_hz`";
        "views_osc.failed": count, low, "Datagrams that the system did not send";
}

/// Settings of [`OscViews`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct OscViewsSettings {
    /// Address of the renderer, HOST:PORT [–]
    pub to: String,
    /// Most messages per tile and second of session time [Hz]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub rate_hz: f64,
}

impl Default for OscViewsSettings {
    fn default() -> Self {
        Self { to: "127.0.0.1:7000".to_owned(), rate_hz: 120.0 }
    }
}

/// Views in, datagrams out.
pub struct OscViews {
    to: String,
    period: Interval,
    line: Option<UdpSocket>,
    /// Whether the last datagrams reached no program.
    has_no_listener: bool,
    sent: Option<Time>,
    n_sent: u64,
    n_superseded: u64,
    n_failed: u64,
    fault: Option<String>,
}

impl Node for OscViews {
    const TYPE: &'static str = "display.osc";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Sends the matrices of each eye and tile over OSC and UDP";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = OscViewsSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: OscViewsSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("rate_hz", settings.rate_hz, 1.0..=1000.0)?;
        let OscViewsSettings { to, rate_hz } = settings;
        let fault = |why: &dyn std::fmt::Display| {
            ConfigError::at("to", format!("found `{to}`, expected HOST:PORT of a renderer: {why}"))
        };
        to.rsplit_once(':').and_then(|it| it.1.parse::<u16>().ok()).ok_or_else(|| fault(&"no port"))?;
        let (mut line, mut unreached) = (None, None);
        if setup.purpose == Purpose::Run {
            let address = to.to_socket_addrs().map_err(|error| fault(&error))?.next();
            let address = address.ok_or_else(|| fault(&"the name has no address"))?;
            let socket = UdpSocket::bind(if address.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" });
            let socket = socket.and_then(|it| it.set_nonblocking(true).map(|()| it)).map_err(|error| fault(&error))?;
            // Connected, it is told when nobody listens there.
            unreached = socket.connect(address).err().map(|error| error.to_string());
            line = Some(socket);
        }
        let period = Interval::from_s(1.0 / rate_hz);
        Ok(Self {
            to,
            period,
            line,
            has_no_listener: false,
            sent: None,
            n_sent: 0,
            n_superseded: 0,
            n_failed: 0,
            fault: unreached,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(Stamped { value: views, .. }) = io.take(&VIEWS) else { return Ok(()) };
        if self.sent.is_some_and(|it| io.now() - it < self.period) {
            self.n_superseded += 1;
            return Ok(());
        }
        self.sent = Some(io.now());
        let Some(socket) = &self.line else { return Ok(()) };
        for tile in &views.tiles {
            // Writing into a vector fails never.
            let Ok(datagram) = encoder::encode(&bundle(views.shown_at, tile)) else { continue };
            let mut sent = socket.send(&datagram);
            // What is said is of a datagram before: its port is closed. This one has not left yet.
            self.has_no_listener = sent.as_ref().is_err_and(|it| it.kind() == ErrorKind::ConnectionRefused);
            if self.has_no_listener {
                sent = socket.send(&datagram);
            }
            match sent {
                Ok(_) => self.n_sent += 1,
                Err(error) => {
                    self.n_failed += 1;
                    let is_full = error.kind() == ErrorKind::WouldBlock;
                    let why = if is_full { "the system's queue was full".to_owned() } else { error.to_string() };
                    self.fault.get_or_insert(why);
                }
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("views_osc.sent", self.n_sent as f64);
        report.figure("views_osc.superseded", self.n_superseded as f64);
        report.figure("views_osc.failed", self.n_failed as f64);
        if self.has_no_listener {
            report.remark(format!(
                "no program listened at `{}` at the end of the run: is the renderer up, and is that its port?",
                self.to
            ));
        }
        if let Some(why) = self.fault.as_ref().filter(|_| self.n_failed > 0) {
            report.remark(format!("{} datagrams to the renderer `{}` were not sent: {why}", self.n_failed, self.to));
        }
        Ok(())
    }
}

fn bundle(shown_at: Time, tile: &TileView) -> OscPacket {
    let message = |(eye, view): (i32, &EyeView)| {
        let mut args = vec![OscType::String(tile.name.clone()), OscType::Int(eye), OscType::Double(shown_at.as_s())];
        let numbers = view.eye.iter().chain(view.clip_from_space.iter());
        args.extend(numbers.map(|it| OscType::Float(*it as f32)));
        OscPacket::Message(OscMessage { addr: "/foveate/view".to_owned(), args })
    };
    let content = (0..).zip(&tile.eyes).filter_map(|(eye, view)| Some(message((eye, view.as_ref()?)))).collect();
    // "At once", as OSC 1.0 has it: the time is in the messages.
    OscPacket::Bundle(OscBundle { timetag: OscTime { seconds: 0, fractional: 1 }, content })
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use foveate_testkit::check_node;
    use nalgebra::{Matrix4, Point3};
    use rosc::decoder;

    use super::*;

    fn views(ms: f64) -> Views {
        let eye =
            EyeView { eye: Point3::new(1.0, 2.0, 3.0), clip_from_space: Matrix4::from_fn(|r, c| (10 * r + c) as f64) };
        let tile =
            TileView { name: "left".into(), size_px: [4, 3], corners: [Point3::origin(); 3], eyes: [None, Some(eye)] };
        Views { time: Time::ZERO, shown_at: Time::ZERO + Interval::from_ms(ms), tiles: vec![tile] }
    }

    #[test]
    fn node_keeps_the_law() {
        check_node::<OscViews>("");
        let fault = NodeBench::<OscViews>::new(OscViewsSettings { to: "nowhere".into(), ..Default::default() });
        assert!(fault.map(|_| ()).unwrap_err().to_string().contains("`nowhere`, expected HOST:PORT"));
    }

    #[test]
    fn a_renderer_gets_matrices_column_by_column_no_more_often_than_it_wants() {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.set_read_timeout(Some(Duration::from_millis(200))).unwrap();
        let to = socket.local_addr().unwrap().to_string();
        let mut bench = NodeBench::<OscViews>::new(OscViewsSettings { to, rate_hz: 50.0 }).unwrap();
        for ms in 0..100 {
            let ms = f64::from(ms);
            bench.feed(&VIEWS, Time::ZERO + Interval::from_ms(ms), views(ms)).unwrap();
        }
        let mut buffer = [0; 2048];
        let mut times = Vec::new();
        while let Ok(n) = socket.recv(&mut buffer) {
            let (_, OscPacket::Bundle(bundle)) = decoder::decode_udp(&buffer[..n]).unwrap() else {
                panic!("no bundle")
            };
            assert_eq!(bundle.content.len(), 1, "an eye that is not before the tile has no message");
            let OscPacket::Message(message) = &bundle.content[0] else { panic!("a bundle within") };
            assert_eq!((message.addr.as_str(), &message.args[1]), ("/foveate/view", &OscType::Int(1)));
            let floats: Vec<f32> = message.args[3..].iter().map(|it| it.clone().float().unwrap()).collect();
            assert_eq!(floats[..5], [1.0, 2.0, 3.0, 0.0, 10.0], "down the first column");
            assert_eq!((floats.len(), floats[18]), (19, 33.0));
            times.push(message.args[2].clone().double().unwrap());
        }
        let milliseconds: Vec<f64> = times.iter().map(|it| (it * 1e3_f64).round()).collect();
        assert_eq!(milliseconds, [0.0, 20.0, 40.0, 60.0, 80.0]);
        let figures = bench.finish().unwrap().figures;
        assert_eq!((figures["views_osc.sent"], figures["views_osc.superseded"]), (5.0, 95.0));
    }
}
