//! `foveate sim`: simulated devices as processes, in real time.

use std::net::{Ipv4Addr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::Subcommand;
use foveate_sim::head::serve::serve_udp;
use foveate_sim::head::{HeadSettings, NetworkHead};

use super::complain;
use crate::exit;
use crate::output::say;

/// What `foveate sim` starts.
#[derive(Debug, Subcommand)]
pub(super) enum SimWhat {
    /// A pan-tilt head, a Sony EVI-D30, that speaks VISCA to whoever connects, until Ctrl-C
    Head(HeadArgs),
}

/// `foveate sim head`
#[derive(Debug, clap::Args)]
pub(super) struct HeadArgs {
    /// Answer on a pseudo terminal, at the pace of 9600 baud, and print its path [default]
    #[arg(long, conflicts_with = "udp")]
    serial: bool,
    /// Answer VISCA over IP on this UDP port of this host; 0: any free one
    #[arg(long, value_name = "PORT")]
    udp: Option<u16>,
    /// Share of the bytes of the serial line that are lost, and as many again that are changed
    #[arg(long, value_name = "SHARE", default_value_t = 0.0, conflicts_with = "udp")]
    noise: f64,
    /// Seed of everything random
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

pub(super) fn run(what: &SimWhat) -> u8 {
    let SimWhat::Head(args) = what;
    let stop = Arc::new(AtomicBool::new(false));
    let asked = Arc::clone(&stop);
    let handler = ctrlc::set_handler(move || asked.store(true, Ordering::Relaxed));
    let served = match (handler, args.udp) {
        (Err(error), _) => Err(format!("Ctrl-C cannot be caught: {error}")),
        (Ok(()), Some(port)) if !args.serial => on_udp(port, args.seed, &stop),
        (Ok(()), _) => on_terminal(args, &stop),
    };
    match served {
        Ok(()) => exit::DONE,
        Err(sentence) => complain(&sentence),
    }
}

fn on_udp(port: u16, seed: u64, stop: &AtomicBool) -> Result<(), String> {
    let fault = |error: std::io::Error| format!("UDP port {port}: {error}");
    let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, port)).map_err(fault)?;
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
