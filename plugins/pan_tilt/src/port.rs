//! Lines to heads: serial ports and UDP sockets, each with a sender and a receiver.

use std::io;
use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs, UdpSocket};
use std::path::PathBuf;
use std::time::Duration;

use crate::driver::Medium;

/// Port of a head.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Port {
    /// A serial port by its path, 8 data bits, no parity, 1 stop bit.
    Serial {
        /// `/dev/ttyUSB0`, preferably a lasting name under `/dev/serial/by-id`.
        path: PathBuf,
        /// Baud rate: 9600 for most heads, some support 38400.
        baud: u32,
    },
    /// VISCA over IP. The name is looked up each time the port is opened.
    Udp {
        /// Name or address; an IPv6 address in brackets.
        host: String,
        /// Most heads listen on [`crate::visca::ip::PORT`].
        number: u16,
    },
}

/// The end that sends.
pub(crate) trait Sender: Send {
    /// Sends all of a frame.
    fn send(&mut self, frame: &[u8]) -> io::Result<()>;
}

/// The end that receives.
pub(crate) trait Receiver: Send {
    /// Waits for bytes, at most for `wait`; returns their number, 0 if none came.
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize>;
}

/// The two ends of a line at the controller.
pub(crate) type Ends = (Box<dyn Sender>, Box<dyn Receiver>);

impl Port {
    /// The kind of line.
    pub fn medium(&self) -> Medium {
        match self {
            Port::Serial { .. } => Medium::Serial,
            Port::Udp { .. } => Medium::Ip,
        }
    }

    /// Opens both ends.
    pub(crate) fn open(&self) -> Result<Ends, String> {
        match self {
            #[cfg(feature = "hardware")]
            Port::Serial { path, baud } => {
                serial::open(path, *baud).map_err(|error| format!("`{}`: {error}", path.display()))
            }
            #[cfg(not(feature = "hardware"))]
            Port::Serial { path, .. } => {
                Err(format!("`{}`: this program was built without the feature `hardware`", path.display()))
            }
            Port::Udp { host, number } => {
                let address = format!("{host}:{number}");
                open_udp(&address).map_err(|error| format!("`udp://{address}`: {error}"))
            }
        }
    }
}

fn open_udp(address: &str) -> io::Result<Ends> {
    let unknown = || io::Error::new(io::ErrorKind::NotFound, "the host has no address");
    let address = address.to_socket_addrs()?.next().ok_or_else(unknown)?;
    let any = if address.is_ipv4() {
        SocketAddr::from((Ipv4Addr::UNSPECIFIED, 0))
    } else {
        SocketAddr::from((Ipv6Addr::UNSPECIFIED, 0))
    };
    let socket = UdpSocket::bind(any)?;
    // Connected: datagrams of others are not received, and an absent head may be reported by its host.
    socket.connect(address)?;
    let receiver = Datagrams { socket: socket.try_clone()? };
    Ok((Box::new(Datagrams { socket }), Box::new(receiver)))
}

struct Datagrams {
    socket: UdpSocket,
}

/// A time-out, or "port unreachable" for an earlier datagram: a missing head on the network is silent, not a lost port.
fn is_nothing(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionRefused, ConnectionReset, Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted | ConnectionRefused | ConnectionReset)
}

impl Sender for Datagrams {
    fn send(&mut self, frame: &[u8]) -> io::Result<()> {
        match self.socket.send(frame) {
            Err(error) if !is_nothing(&error) => Err(error),
            _ => Ok(()),
        }
    }
}

impl Receiver for Datagrams {
    fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize> {
        self.socket.set_read_timeout(Some(wait))?;
        match self.socket.recv(buffer) {
            Err(error) if is_nothing(&error) => Ok(0),
            result => result,
        }
    }
}

#[cfg(feature = "hardware")]
mod serial {
    //! Serial ports through the crate `serialport`.

    use std::io::{self, Read, Write};
    use std::path::Path;
    use std::time::Duration;

    use serialport::{DataBits, FlowControl, Parity, SerialPort, StopBits};

    use super::{Ends, Receiver, Sender, is_nothing};

    /// A frame is shorter than what drivers buffer: this is for ports that hang [s].
    const WRITE_TIMEOUT: Duration = Duration::from_secs(1);

    pub(super) fn open(path: &Path, baud: u32) -> serialport::Result<Ends> {
        let builder = serialport::new(path.to_string_lossy(), baud)
            .data_bits(DataBits::Eight)
            .parity(Parity::None)
            .stop_bits(StopBits::One)
            .flow_control(FlowControl::None)
            .timeout(WRITE_TIMEOUT);
        let port = builder.open()?;
        let receiver = port.try_clone()?;
        Ok((Box::new(Line(port)), Box::new(Line(receiver))))
    }

    struct Line(Box<dyn SerialPort>);

    impl Sender for Line {
        fn send(&mut self, frame: &[u8]) -> io::Result<()> {
            self.0.write_all(frame)
        }
    }

    impl Receiver for Line {
        fn receive(&mut self, buffer: &mut [u8], wait: Duration) -> io::Result<usize> {
            self.0.set_timeout(wait)?;
            match self.0.read(buffer) {
                Err(error) if is_nothing(&error) => Ok(0),
                Ok(0) => Err(io::Error::new(io::ErrorKind::UnexpectedEof, "the other end of the line is gone")),
                result => result,
            }
        }
    }
}
