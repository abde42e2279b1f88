//! Where the server listens, and the token that addresses other than this machine's own need.

use std::fmt::{self, Write};
use std::net::{SocketAddr, TcpListener, ToSocketAddrs};
use std::str::FromStr;

/// The first port that is tried where none is given, and how many after it.
const FIRST_PORT: u16 = 8017;
const PORTS_TRIED: u16 = 20;

/// An address to listen at: `PORT`, `HOST`, or `HOST:PORT`. Port 0: any that is free. Without a port: 8017, or the next one that is free.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Listen {
    host: String,
    port: Option<u16>,
}

impl Default for Listen {
    /// This machine alone.
    fn default() -> Self {
        Self { host: "127.0.0.1".to_owned(), port: None }
    }
}

impl FromStr for Listen {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let expected = || format!("found `{text}`, expected PORT, HOST or HOST:PORT, as 8017 or 0.0.0.0:8017");
        if text.is_empty() {
            return Err(expected());
        }
        if text.bytes().all(|it| it.is_ascii_digit()) {
            let port = text.parse().map_err(|_| expected())?;
            return Ok(Self { port: Some(port), ..Self::default() });
        }
        // An IPv6 address has colons of its own, and brackets before a port.
        let is_bare_v6 = text.matches(':').count() > 1 && !text.starts_with('[');
        let (host, port) = match text.rsplit_once(':') {
            Some((host, port)) if !is_bare_v6 && !text.ends_with(']') => {
                (host, Some(port.parse().map_err(|_| expected())?))
            }
            _ => (text, None),
        };
        let host = host.trim_start_matches('[').trim_end_matches(']');
        if host.is_empty() || host.chars().any(|it| it.is_whitespace() || it == '/') {
            return Err(expected());
        }
        Ok(Self { host: host.to_owned(), port })
    }
}

impl fmt::Display for Listen {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let host = if self.host.contains(':') { format!("[{}]", self.host) } else { self.host.clone() };
        match self.port {
            Some(port) => write!(f, "{host}:{port}"),
            None => f.write_str(&host),
        }
    }
}

impl Listen {
    /// The requested name.
    pub(crate) fn host(&self) -> &str {
        &self.host
    }

    /// A socket that listens, and its address.
    ///
    /// # Errors
    /// A sentence that names the address: nothing has that name, or the port is taken.
    pub(crate) fn bind(&self) -> Result<(TcpListener, SocketAddr), String> {
        let (first, tried) = match self.port {
            Some(port) => (port, 1),
            None => (FIRST_PORT, PORTS_TRIED),
        };
        let mut fault = String::new();
        for port in first..first.saturating_add(tried) {
            let found = (self.host.as_str(), port).to_socket_addrs();
            let found = found.map_err(|error| format!("pages cannot be served at `{self}`: {error}"))?;
            for address in found {
                match TcpListener::bind(address).and_then(|it| Ok((it.local_addr()?, it))) {
                    Ok((address, listener)) => return Ok((listener, address)),
                    Err(error) => fault = error.to_string(),
                }
            }
        }
        Err(match self.port {
            Some(_) => format!("pages cannot be served at `{self}`: {fault}; expected a free port, 0 for any"),
            None => format!(
                "pages cannot be served at `{self}`, ports {first} to {}: {fault}; expected a free port, 0 for any",
                first + tried - 1
            ),
        })
    }
}

/// A secret of 128 bits from the operating system, as 32 hexadecimal digits.
///
/// # Errors
/// The system gives no random numbers.
pub(crate) fn token() -> Result<String, String> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes).map_err(|error| format!("the system gives no random numbers for a token: {error}"))?;
    Ok(bytes.iter().fold(String::new(), |mut text, it| {
        let _ = write!(text, "{it:02x}");
        text
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_are_read_and_written() {
        let parts = |text: &str| text.parse::<Listen>().map(|it| (it.host, it.port));
        assert_eq!(parts("8017"), Ok(("127.0.0.1".into(), Some(8017))));
        assert_eq!(parts("0.0.0.0:80"), Ok(("0.0.0.0".into(), Some(80))));
        assert_eq!(parts("lab-pc"), Ok(("lab-pc".into(), None)));
        assert_eq!(parts("[::1]:0"), Ok(("::1".into(), Some(0))));
        assert_eq!(parts("::1"), Ok(("::1".into(), None)));
        for wrong in ["", "70000", "host:", "host:port", ":80", "http://x:80", "a b"] {
            assert!(parts(wrong).is_err_and(|it| it.contains("HOST:PORT")), "{wrong}");
        }
        assert_eq!("[::1]:0".parse::<Listen>().unwrap().to_string(), "[::1]:0");
    }

    #[test]
    fn a_port_that_was_asked_for_and_is_taken_is_named_and_otherwise_the_next_is_had() {
        let (first, address) = Listen::default().bind().unwrap();
        let again: Listen = address.port().to_string().parse().unwrap();
        let fault = again.bind().unwrap_err();
        assert!(fault.contains(&format!("127.0.0.1:{}", address.port())) && fault.contains("in use"), "{fault}");
        let (_second, other) = Listen::default().bind().unwrap();
        assert!(address.port() >= FIRST_PORT && other.port() > address.port(), "{address} {other}");
        drop(first);
        let (_any, free) = "0".parse::<Listen>().unwrap().bind().unwrap();
        assert!(free.port() != 0 && free.ip().is_loopback());
        let nowhere: Listen = "no-such-host.invalid:80".parse().unwrap();
        assert!(nowhere.bind().unwrap_err().contains("`no-such-host.invalid:80`"));
    }

    #[test]
    fn tokens_are_long_and_never_the_same() {
        let (a, b) = (token().unwrap(), token().unwrap());
        assert!(a.len() == 32 && a.bytes().all(|it| it.is_ascii_hexdigit()) && a != b);
    }
}
