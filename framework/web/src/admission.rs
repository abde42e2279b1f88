//! Which requests are accepted.
//!
//! A page of another site that a person has open could send requests here from that person's browser: its `Origin` is another one. A site whose name was made to
//! point to this machine (DNS rebinding) has an `Origin` that looks right, but its name stands in `Host`: only addresses and names of this machine are
//! taken there. From elsewhere than this machine the token is needed on top.

use std::net::{IpAddr, SocketAddr};

use crate::http::Request;

/// Which names and tokens the server accepts.
#[derive(Debug, Clone)]
pub(crate) struct Admission {
    address: SocketAddr,
    /// The name of its listening address.
    name: String,
    token: Option<String>,
}

/// Why a request is refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Refusal {
    Host,
    Origin,
    Token,
}

impl Refusal {
    /// What the client reads.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Refusal::Host => "refused: `Host` is no address of this server",
            Refusal::Origin => "refused: `Origin` is another site",
            Refusal::Token => "refused: expected the address with its token, as the program printed it",
        }
    }
}

impl Admission {
    pub(crate) fn new(address: SocketAddr, name: &str, token: Option<String>) -> Admission {
        Admission { address, name: name.to_owned(), token }
    }

    /// Whether `request` is accepted.
    pub(crate) fn check(&self, request: &Request) -> Result<(), Refusal> {
        if !request.host.as_deref().is_some_and(|it| self.is_own(it)) {
            return Err(Refusal::Host);
        }
        let is_own = |origin: &str| origin.strip_prefix("http://").is_some_and(|it| self.is_own(it));
        // Programs that are no browsers send none, and are nobody's page.
        if !request.origin.as_deref().is_none_or(is_own) {
            return Err(Refusal::Origin);
        }
        let Some(token) = &self.token else { return Ok(()) };
        let cookie = format!("{}=", self.cookie_name());
        let cookies = request.cookie.iter().flat_map(|it| it.split(';'));
        let cookie = cookies.filter_map(|it| it.trim().strip_prefix(cookie.as_str())).next();
        let given = request.token.as_deref().or(cookie);
        if given.is_some_and(|it| is_same(it, token)) { Ok(()) } else { Err(Refusal::Token) }
    }

    /// The field that makes a browser keep the token, for who came with it in the address.
    pub(crate) fn cookie(&self, request: &Request) -> Option<String> {
        let (token, _) = (self.token.as_ref()?, request.token.as_ref()?);
        Some(format!("Set-Cookie: {}={token}; Path=/; HttpOnly; SameSite=Strict\r\n", self.cookie_name()))
    }

    /// Cookies are those of a host, whatever the port.
    fn cookie_name(&self) -> String {
        format!("foveate_{}", self.address.port())
    }

    /// Whether `HOST:PORT` is this server.
    fn is_own(&self, host: &str) -> bool {
        let (name, port) = match host.rsplit_once(':') {
            Some((name, port)) if !host.ends_with(']') => (name, port.parse().ok()),
            _ => (host, Some(80)),
        };
        if port != Some(self.address.port()) {
            return false;
        }
        let bare = name.trim_start_matches('[').trim_end_matches(']');
        if name.eq_ignore_ascii_case("localhost") || name.eq_ignore_ascii_case(&self.name) {
            return true;
        }
        // A name can be made to point anywhere, an address cannot.
        bare.parse::<IpAddr>().is_ok_and(|it| if self.address.ip().is_loopback() { it.is_loopback() } else { true })
    }
}

/// Whether two texts are the same, in a time that does not tell how far they are.
fn is_same(a: &str, b: &str) -> bool {
    a.len() == b.len() && a.bytes().zip(b.bytes()).fold(0, |all, it| all | (it.0 ^ it.1)) == 0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn asks(host: &str, origin: Option<&str>) -> Request {
        Request { host: Some(host.to_owned()), origin: origin.map(str::to_owned), ..Request::default() }
    }

    fn here() -> Admission {
        Admission::new("127.0.0.1:8017".parse().unwrap(), "127.0.0.1", None)
    }

    #[test]
    fn this_machine_has_several_names_and_no_other() {
        for host in ["127.0.0.1:8017", "localhost:8017", "LOCALHOST:8017", "[::1]:8017", "127.0.0.2:8017"] {
            assert_eq!(here().check(&asks(host, None)), Ok(()), "{host}");
        }
        let wrong = [
            "evil.example:8017",
            "127.0.0.1",
            "127.0.0.1:80",
            "192.168.0.4:8017",
            "",
            "localhost.evil.example:8017",
            "[::1]",
        ];
        for host in wrong {
            assert_eq!(here().check(&asks(host, None)), Err(Refusal::Host), "{host}");
        }
        assert_eq!(here().check(&Request::default()), Err(Refusal::Host));
    }

    #[test]
    fn pages_of_other_sites_are_refused() {
        let check = |origin: &str| here().check(&asks("localhost:8017", Some(origin)));
        assert_eq!(check("http://localhost:8017"), Ok(()));
        assert_eq!(check("http://127.0.0.1:8017"), Ok(()));
        for origin in [
            "http://evil.example",
            "http://evil.example:8017",
            "null",
            "https://localhost:8017",
            "http://localhost:3000",
        ] {
            assert_eq!(check(origin), Err(Refusal::Origin), "{origin}");
        }
        // After rebinding both agree, and are still not ours.
        let rebound = asks("evil.example:8017", Some("http://evil.example:8017"));
        assert_eq!(here().check(&rebound), Err(Refusal::Host));
    }

    #[test]
    fn from_elsewhere_the_token_is_needed() {
        let secret = "0123456789abcdef";
        let server = Admission::new("0.0.0.0:9000".parse().unwrap(), "lab-pc", Some(secret.to_owned()));
        let with = |token: Option<&str>, cookie: Option<&str>| Request {
            token: token.map(str::to_owned),
            cookie: cookie.map(str::to_owned),
            ..asks("192.168.0.4:9000", None)
        };
        assert_eq!(server.check(&with(None, None)), Err(Refusal::Token));
        assert_eq!(server.check(&with(Some("0123456789abcdee"), None)), Err(Refusal::Token));
        assert_eq!(server.check(&with(Some(""), None)), Err(Refusal::Token));
        assert_eq!(server.check(&with(Some(secret), None)), Ok(()));
        assert_eq!(server.check(&with(None, Some("a=b; foveate_9000=0123456789abcdef"))), Ok(()));
        assert_eq!(server.check(&with(None, Some("foveate_9001=0123456789abcdef"))), Err(Refusal::Token));
        assert_eq!(
            server.check(&asks("lab-pc:9000", None)),
            Err(Refusal::Token),
            "its own name is known, the token not given"
        );
        assert_eq!(server.check(&asks("other-pc:9000", None)), Err(Refusal::Host));
        let cookie = server.cookie(&with(Some(secret), None)).unwrap();
        assert!(cookie.contains("HttpOnly; SameSite=Strict") && server.cookie(&with(None, None)).is_none());
    }
}
