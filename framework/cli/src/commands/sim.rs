//! `foveate sim`: simulated devices as processes, in real time.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use clap::Subcommand;
use foveate_sim::head::serve::{bind, serve_udp};
use foveate_sim::head::{HeadSettings, NetworkHead};

use super::complain;
use crate::output::say;
use crate::{exit, interrupt};

/// What `foveate sim` starts.
#[derive(Debug, Subcommand)]
pub(super) enum SimWhat {
    /// A pan-tilt head, a Sony EVI-D30, that answers VISCA to every client, until Ctrl-C
    Head(HeadArgs),
}

/// `foveate sim head`
#[derive(Debug, clap::Args)]
pub(super) struct HeadArgs {
    /// Answer on a pseudo terminal, at the pace of 9600 baud, and print its path [default]
    #[arg(long, conflicts_with_all = ["udp", "bind"])]
    serial: bool,
    /// Answer VISCA over IP on this UDP port; 0: any free one; without a number: 52381, the usual one
    #[arg(long, value_name = "PORT", num_args = 0..=1, default_missing_value = "52381")]
    udp: Option<u16>,
    /// Answer VISCA over IP at this address of this host, as 192.168.1.20, ::1, or 0.0.0.0 for all of them [default with --udp: 127.0.0.1]
    #[arg(long, value_name = "ADDRESS", value_parser = address)]
    bind: Option<IpAddr>,
    /// Share of the bytes of the serial line that are lost, and as many again that are changed
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, conflicts_with_all = ["udp", "bind"])]
    noise: f64,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

/// VISCA over IP, where no other port is named.
const USUAL_PORT: u16 = 52381;

/// An address of this host on the command line.
fn address(text: &str) -> Result<IpAddr, String> {
    let expected = || {
        format!(
            "found {text}, expected an address of this host, as 127.0.0.2, 192.168.1.20 or ::1; the port goes to --udp"
        )
    };
    if text == "localhost" { Ok(Ipv4Addr::LOCALHOST.into()) } else { text.parse().map_err(|_| expected()) }
}

pub(super) fn run(what: &SimWhat) -> u8 {
    let SimWhat::Head(args) = what;
    let stop = Arc::new(AtomicBool::new(false));
    let on_network = args.udp.is_some() || args.bind.is_some();
    // To be ended is what a device is started for: nothing is cut short by it.
    let served = interrupt::stops(&stop).and_then(|()| match on_network {
        true => {
            let host = args.bind.unwrap_or(Ipv4Addr::LOCALHOST.into());
            on_udp(SocketAddr::new(host, args.udp.unwrap_or(USUAL_PORT)), args.seed, &stop)
        }
        false => on_terminal(args, &stop),
    });
    match served {
        Ok(()) => exit::DONE,
        Err(sentence) => complain(&sentence),
    }
}

fn on_udp(wanted: SocketAddr, seed: u64, stop: &AtomicBool) -> Result<(), String> {
    let fault = |error: std::io::Error| format!("UDP {wanted}: {error}");
    let socket = bind(wanted).map_err(fault)?;
    let mut head = NetworkHead::new(&HeadSettings::default(), seed).map_err(|fault| fault.message)?;
    let address = socket.local_addr().map_err(fault)?;
    say(&format!("EVI-D30 at UDP {address}, VISCA over IP. Ctrl-C ends it.\n"));
    serve_udp(&mut head, &socket, stop).map_err(fault)
}

#[cfg(unix)]
fn on_terminal(args: &HeadArgs, stop: &AtomicBool) -> Result<(), String> {
    use foveate_sim::head::serve::Terminal;
    use foveate_sim::head::{LineSettings, SerialHead};

    let line = LineSettings { lost: args.noise, flipped: args.noise, ..LineSettings::default() };
    let head = SerialHead::new(&HeadSettings::default(), &line, args.seed);
    let mut head = head.map_err(|fault| format!("--noise: {}", fault.message))?;
    let fault = |error: std::io::Error| format!("pseudo terminal: {error}");
    let mut terminal = Terminal::new().map_err(fault)?;
    say(&format!("EVI-D30 at {}, 9600 baud 8N1, address 1. Ctrl-C ends it.\n", terminal.path().display()));
    terminal.serve(&mut head, stop).map_err(fault)
}

#[cfg(not(unix))]
fn on_terminal(_args: &HeadArgs, _stop: &AtomicBool) -> Result<(), String> {
    Err("a pseudo terminal needs Unix; --udp PORT works here".to_owned())
}
