//! One HTTP request read, one answer written. Each connection serves one request: a run has few pages and few requests.

use std::fmt::Write;

/// Longest head of a request [bytes], and most fields in it: what servers allow.
pub(crate) const MOST_HEAD: usize = 8192;
const MOST_FIELDS: usize = 64;

/// What of a request matters here.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Request {
    pub is_get: bool,
    /// Percent-decoded, without the query.
    pub path: String,
    pub token: Option<String>,
    pub host: Option<String>,
    pub origin: Option<String>,
    pub cookie: Option<String>,
    /// The key of a WebSocket request.
    pub socket_key: Option<String>,
    /// An invalid WebSocket request.
    pub is_bad_socket: bool,
    /// Bytes of the head.
    pub length: usize,
}

/// What has come in so far.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Reading {
    /// Not all of the head.
    Partial,
    /// All of it.
    Whole(Box<Request>),
    /// No request of HTTP/1.1, or one that is too long.
    Wrong,
}

/// Reads the head of a request.
pub(crate) fn read(bytes: &[u8]) -> Reading {
    let mut fields = [httparse::EMPTY_HEADER; MOST_FIELDS];
    let mut head = httparse::Request::new(&mut fields);
    let length = match head.parse(bytes) {
        Ok(httparse::Status::Complete(length)) if length <= MOST_HEAD => length,
        Ok(httparse::Status::Partial) if bytes.len() < MOST_HEAD => return Reading::Partial,
        _ => return Reading::Wrong,
    };
    let all = |name: &str| -> Vec<&str> {
        let of = head.headers.iter().filter(|it| it.name.eq_ignore_ascii_case(name));
        of.map(|it| std::str::from_utf8(it.value).unwrap_or("\u{fffd}").trim()).collect()
    };
    // Of a field that comes twice nobody knows which one the next reader believes.
    let one = |name: &str| match all(name)[..] {
        [] => Ok(None),
        [value] => Ok(Some(value.to_owned())),
        _ => Err(()),
    };
    let (Ok(host), Ok(origin)) = (one("host"), one("origin")) else { return Reading::Wrong };
    let has = |name: &str, word: &str| {
        all(name).iter().flat_map(|it| it.split(',')).any(|it| it.trim().eq_ignore_ascii_case(word))
    };
    let target = head.path.unwrap_or_default();
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let Some(path) = decoded(path) else { return Reading::Wrong };
    let wants_socket = has("upgrade", "websocket");
    let is_socket = has("connection", "upgrade") && all("sec-websocket-version") == ["13"];
    let key = one("sec-websocket-key").ok().flatten();
    Reading::Whole(Box::new(Request {
        is_get: head.method == Some("GET"),
        path,
        token: query.split('&').find_map(|it| it.strip_prefix("token=")).map(str::to_owned),
        host,
        origin,
        cookie: Some(all("cookie").join("; ")).filter(|it| !it.is_empty()),
        is_bad_socket: wants_socket && !(is_socket && key.is_some()),
        socket_key: key.filter(|_| wants_socket && is_socket),
        length,
    }))
}

/// A path with its `%41` replaced; `None` where one is none.
fn decoded(path: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(path.len());
    let mut rest = path.bytes();
    while let Some(byte) = rest.next() {
        if byte != b'%' {
            bytes.push(byte);
            continue;
        }
        let mut digit = || char::from(rest.next()?).to_digit(16);
        let (high, low) = (digit()?, digit()?);
        bytes.push((high * 16 + low) as u8);
    }
    String::from_utf8(bytes).ok()
}

/// What a page may do: nothing but what comes from this server.
const POLICY: &str = "default-src 'none'; script-src 'self' 'unsafe-inline'; style-src 'self' 'unsafe-inline'; connect-src 'self'; img-src 'self' data:; \
                      base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// An answer, whole.
pub(crate) fn answer(status: &str, content_type: &str, more: &str, body: &[u8]) -> Vec<u8> {
    let mut head = format!("HTTP/1.1 {status}\r\nContent-Length: {}\r\n", body.len());
    let _ = write!(head, "Content-Type: {content_type}\r\nContent-Security-Policy: {POLICY}\r\n");
    // Alone in its process a page has a clock of 5 µs in place of 100 µs.
    head.push_str("Cross-Origin-Opener-Policy: same-origin\r\nCross-Origin-Embedder-Policy: require-corp\r\n");
    head.push_str("Cross-Origin-Resource-Policy: same-origin\r\nX-Content-Type-Options: nosniff\r\n");
    head.push_str("Referrer-Policy: no-referrer\r\nCache-Control: no-store\r\nConnection: close\r\n");
    head.push_str(more);
    head.push_str("\r\n");
    let mut bytes = head.into_bytes();
    bytes.extend_from_slice(body);
    bytes
}

/// An answer in words.
pub(crate) fn words(status: &str, text: &str) -> Vec<u8> {
    answer(status, "text/plain; charset=utf-8", "", format!("{text}\n").as_bytes())
}

/// Characters that mean something in HTML replaced.
pub(crate) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn whole(text: &str) -> Request {
        match read(text.as_bytes()) {
            Reading::Whole(request) => *request,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn requests_are_read() {
        let request = whole("GET /a%20b/?x=1&token=abc HTTP/1.1\r\nHost: localhost:1\r\nCookie: a=b\r\n\r\n");
        assert_eq!((request.is_get, request.path.as_str(), request.token.as_deref()), (true, "/a b/", Some("abc")));
        assert_eq!((request.host.as_deref(), request.cookie.as_deref()), (Some("localhost:1"), Some("a=b")));
        assert_eq!((request.socket_key, request.is_bad_socket), (None, false));
        assert!(!whole("POST / HTTP/1.1\r\n\r\n").is_get);
        let socket = "GET /s HTTP/1.1\r\nUpgrade: websocket\r\nConnection: keep-alive, Upgrade\r\nSec-WebSocket-Key: k\r\nSec-WebSocket-Version: ";
        assert_eq!(whole(&format!("{socket}13\r\n\r\n")).socket_key.as_deref(), Some("k"));
        assert!(whole(&format!("{socket}8\r\n\r\n")).is_bad_socket);
    }

    #[test]
    fn what_is_no_request_is_refused_and_half_of_one_waited_for() {
        assert_eq!(read(b"GET / HTTP/1.1\r\nHost: x\r\n"), Reading::Partial);
        assert_eq!(read(b""), Reading::Partial);
        assert_eq!(read(b"\x16\x03\x01\x02\x00"), Reading::Wrong, "TLS");
        assert_eq!(read(b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n"), Reading::Wrong);
        assert_eq!(read(b"GET /%zz HTTP/1.1\r\n\r\n"), Reading::Wrong);
        let long = format!("GET /{} HTTP/1.1\r\n", "x".repeat(MOST_HEAD));
        assert_eq!(read(long.as_bytes()), Reading::Wrong);
        let many = format!("GET / HTTP/1.1\r\n{}\r\n", "a: b\r\n".repeat(MOST_FIELDS + 1));
        assert_eq!(read(many.as_bytes()), Reading::Wrong);
    }
}
