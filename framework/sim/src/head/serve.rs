//! A simulated head as a process, in real time: on a pseudo terminal or a UDP port, for any VISCA client.

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use foveate_messages::Time;

use super::datagrams::NetworkHead;

/// Nothing looks at the head more often than this.
const PERIOD: Duration = Duration::from_millis(1);

/// Time since `start` on the head's clock.
fn since(start: Instant) -> Time {
    Time(i64::try_from(start.elapsed().as_nanos()).unwrap_or(i64::MAX))
}

/// A socket for a head at `address`; port 0: any free one. Two heads never share one.
///
/// Clients on the same machine may take the same port at another address of it, as some do (`visca-over-ip` receives answers to inquiries at the
/// head's own port of all addresses): such a client works with a head at 127.0.0.2, say.
///
/// # Errors
/// What the system reports.
pub fn bind(address: SocketAddr) -> io::Result<UdpSocket> {
    let socket = UdpSocket::bind(address)?;
    // Only now, so that it lets others in and does not itself push in where another head is.
    #[cfg(unix)]
    nix::sys::socket::setsockopt(&socket, nix::sys::socket::sockopt::ReuseAddr, &true)?;
    Ok(socket)
}

/// Lets a head answer on `socket`, each controller what it asked, until `stop`.
///
/// # Errors
/// What the socket reports.
pub fn serve_udp(head: &mut NetworkHead, socket: &UdpSocket, stop: &AtomicBool) -> io::Result<()> {
    let start = Instant::now();
    let mut buffer = [0; 2048];
    socket.set_read_timeout(Some(PERIOD))?;
    while !stop.load(Ordering::Relaxed) {
        match socket.recv_from(&mut buffer) {
            Ok((length, from)) => head.receive_from(since(start), from, &buffer[..length]),
            Err(error) if is_nothing(&error) => {}
            Err(error) => return Err(error),
        }
        while let Some((controller, datagram)) = head.send_to(since(start)) {
            // A controller that cannot be reached, or that gave an impossible address, is not the end of the head.
            if let Some(controller) = controller {
                drop(socket.send_to(&datagram, controller));
            }
        }
    }
    Ok(())
}

/// Nothing came in time, or the controller is gone: not the end of the head.
fn is_nothing(error: &io::Error) -> bool {
    use io::ErrorKind::{ConnectionRefused, ConnectionReset, Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted | ConnectionRefused | ConnectionReset)
}

#[cfg(unix)]
pub use terminal::Terminal;

#[cfg(unix)]
mod terminal {
    //! The pseudo terminal.

    use std::fs::File;
    use std::io::{self, Read, Write};
    use std::os::fd::OwnedFd;
    use std::path::{Path, PathBuf};
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::time::Instant;

    use nix::fcntl::{FcntlArg, OFlag, fcntl};
    use nix::pty::openpty;
    use nix::sys::termios::{SetArg, cfmakeraw, tcgetattr, tcsetattr};
    use nix::unistd::ttyname;

    use super::{PERIOD, is_nothing, since};
    use crate::head::line::SerialHead;

    /// A pseudo terminal: controllers open its path as if it were a serial port.
    #[derive(Debug)]
    pub struct Terminal {
        ours: File,
        /// Kept open, so that the line stays when a controller goes.
        _theirs: OwnedFd,
        path: PathBuf,
    }

    impl Terminal {
        /// Makes one, that passes bytes on as they are.
        ///
        /// # Errors
        /// What the system reports.
        pub fn new() -> io::Result<Terminal> {
            let pair = openpty(None, None)?;
            let mut mode = tcgetattr(&pair.slave)?;
            cfmakeraw(&mut mode);
            tcsetattr(&pair.slave, SetArg::TCSANOW, &mode)?;
            fcntl(&pair.master, FcntlArg::F_SETFL(OFlag::O_NONBLOCK))?;
            let path = ttyname(&pair.slave)?;
            Ok(Terminal { ours: File::from(pair.master), _theirs: pair.slave, path })
        }

        /// What controllers open.
        pub fn path(&self) -> &Path {
            &self.path
        }

        /// Lets a head answer here until `stop`; the time that bytes take on a line is the head's own.
        ///
        /// # Errors
        /// What the system reports.
        pub fn serve(&mut self, head: &mut SerialHead, stop: &AtomicBool) -> io::Result<()> {
            let start = Instant::now();
            let mut buffer = [0; 256];
            while !stop.load(Ordering::Relaxed) {
                // What comes faster than the line waits in the terminal, and then with its writer.
                let length = if head.n_bytes() < buffer.len() { buffer.len() } else { 0 };
                match self.ours.read(&mut buffer[..length]) {
                    Ok(length) => head.write(since(start), &buffer[..length]),
                    Err(error) if is_nothing(&error) => {}
                    Err(error) => return Err(error),
                }
                let bytes = head.read(since(start));
                // A terminal that nobody reads fills up: what does not fit is lost, as on a line.
                match self.ours.write(&bytes) {
                    Err(error) if !is_nothing(&error) => return Err(error),
                    _ => {}
                }
                std::thread::sleep(PERIOD);
            }
            Ok(())
        }
    }
}
