//! The server from outside: over sockets, as browsers, other sites and broken clients come to it.

use std::io::{ErrorKind, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use foveate_node::page::{Client, Page, PageEvent, PageFile, PageLink, PageNews, PageServer};
use foveate_web::{Counts, Listen, Server};
use tungstenite::client::IntoClientRequest;
use tungstenite::{Message, WebSocket};

const PATIENCE: Duration = Duration::from_secs(60);

struct House {
    server: Server,
    link: Box<dyn PageLink>,
    at: SocketAddr,
    /// With the token, where there is one.
    address: String,
}

fn page() -> Page {
    let files = |name: &str| match name {
        "big" => Some(PageFile { content_type: "application/octet-stream", bytes: vec![7; 32 << 20] }),
        "boom" => panic!("it broke"),
        _ => None,
    };
    Page { html: "<p>the page</p>", files: Arc::new(files) }
}

fn house(listen: &str) -> House {
    let told = Arc::new(Mutex::new(String::new()));
    let heard = Arc::clone(&told);
    let server = Server::new(listen.parse().unwrap(), move |instance, address| {
        assert_eq!(instance, "room.show[left]");
        *heard.lock().unwrap() = address.to_owned();
    });
    assert!(!server.is_serving(), "it listens from the first page on");
    let link = server.open("room.show[left]", page()).unwrap();
    let address = told.lock().unwrap().clone();
    let port = address.split(':').nth(2).unwrap().split('/').next().unwrap().parse().unwrap();
    House { server, link, at: SocketAddr::from(([127, 0, 0, 1], port)), address }
}

impl House {
    /// What comes back for a request with these lines after the first.
    fn ask(&self, target: &str, lines: &str) -> String {
        let mut stream = TcpStream::connect(self.at).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        // Who is refused in the middle of a long request may find the connection closed, before or after the answer.
        drop(write!(stream, "GET {target} HTTP/1.1\r\n{lines}\r\n"));
        let mut answer = Vec::new();
        drop(stream.read_to_end(&mut answer));
        String::from_utf8_lossy(&answer).into_owned()
    }

    fn own(&self) -> String {
        format!("Host: {}\r\n", self.at)
    }

    fn open(&self) -> WebSocket<TcpStream> {
        self.open_as(None).unwrap()
    }

    fn open_as(&self, origin: Option<&str>) -> Result<WebSocket<TcpStream>, String> {
        let mut request = format!("ws://{}/room.show-left/socket", self.at).into_client_request().unwrap();
        if let Some(origin) = origin {
            request.headers_mut().insert("Origin", origin.parse().unwrap());
        }
        let stream = TcpStream::connect(self.at).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        tungstenite::client(request, stream).map(|it| it.0).map_err(|error| error.to_string())
    }

    fn next(&mut self) -> PageEvent {
        let until = Instant::now() + PATIENCE;
        loop {
            match self.link.take() {
                Some(event) => return event,
                None if Instant::now() > until => panic!("nothing happened"),
                None => std::thread::sleep(Duration::from_millis(1)),
            }
        }
    }

    fn opened(&mut self) -> Client {
        let event = self.next();
        assert_eq!(event.what, PageNews::Opened);
        event.client
    }

    fn closed(&mut self) -> String {
        loop {
            if let PageNews::Closed(why) = self.next().what {
                return why;
            }
        }
    }

    /// Waits until the counts are so.
    fn counts(&self, are: impl Fn(&Counts) -> bool) {
        let until = Instant::now() + PATIENCE;
        while !are(&self.server.counts()) {
            assert!(Instant::now() < until, "{:?}", self.server.counts());
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

#[test]
fn pages_files_and_the_list_are_served_and_nothing_else() {
    let house = house("0");
    let own = house.own();
    assert_eq!(house.address, format!("http://{}/room.show-left/", house.at), "this machine needs no token");
    let page = house.ask("/room.show-left/", &own);
    assert!(page.starts_with("HTTP/1.1 200 OK\r\n") && page.ends_with("\r\n\r\n<p>the page</p>"), "{page}");
    for field in [
        "Content-Security-Policy: default-src 'none'",
        "Cross-Origin-Opener-Policy: same-origin",
        "frame-ancestors 'none'",
        "nosniff",
    ] {
        assert!(page.contains(field), "{field}");
    }
    assert!(house.ask("/", &own).contains("<a href=\"/room.show-left/\">room.show[left]</a>"));
    assert!(house.ask("/foveate.js", &own).contains("function foveate("));
    assert!(house.ask("/room.show-left", &own).starts_with("HTTP/1.1 308"));
    assert!(house.ask("/room.show-left/big", &own).len() > 32 << 20);
    let failed = house.ask("/room.show-left/boom", &own);
    assert!(failed.starts_with("HTTP/1.1 500") && failed.contains("it broke"), "{failed}");
    for missing in ["/x", "/room.show-left/x", "/../../etc/passwd", "/%2e%2e/etc/passwd"] {
        assert!(house.ask(missing, &own).starts_with("HTTP/1.1 404"), "{missing}");
    }
    let mut stream = TcpStream::connect(house.at).unwrap();
    write!(stream, "POST / HTTP/1.1\r\n{own}\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    assert!(answer.starts_with("HTTP/1.1 405"), "{answer}");
}

#[test]
fn messages_go_both_ways_and_clocks_are_compared() {
    let mut house = house("0");
    house.link.greet("welcome");
    let mut socket = house.open();
    let client = house.opened();
    assert_eq!(socket.read().unwrap(), Message::text("welcome"));
    let before = house.link.now();
    socket.send(Message::text("hello")).unwrap();
    let event = house.next();
    assert_eq!((event.client, event.what), (client, PageNews::Text("hello".to_owned())));
    assert!((before..=house.link.now()).contains(&event.arrival));
    assert!(house.link.send(client, "good day"));
    assert_eq!(socket.read().unwrap(), Message::text("good day"));
    let before = house.link.now() as f64 * 1e-6;
    socket.send(Message::text("ping 12.5")).unwrap();
    let pong = socket.read().unwrap().into_text().unwrap();
    let words: Vec<&str> = pong.split(' ').collect();
    assert_eq!(words[..2], ["pong", "12.5"]);
    let host: f64 = words[2].parse().unwrap();
    assert!((before..=house.link.now() as f64 * 1e-6).contains(&host), "{before} {pong}");
    assert_eq!(house.link.take(), None, "a comparison of clocks is no news");
    socket.close(None).unwrap();
    assert_eq!(house.closed(), "it was closed");
    assert!(!house.link.send(client, "still there?"));
    // Another window is another client; a connection that breaks is told, too.
    let other = house.open();
    assert_ne!(house.opened(), client);
    drop(other);
    assert_eq!(house.closed(), "the connection broke");
}

#[test]
fn other_sites_and_rebound_names_are_refused_and_counted() {
    let house = house("0");
    let own = format!("http://{}", house.at);
    assert!(house.open_as(Some(&own)).is_ok());
    assert!(house.open_as(Some(&format!("http://localhost:{}", house.at.port()))).is_ok());
    for origin in ["http://evil.example", "null", "https://evil.example:8017"] {
        let refused = house.open_as(Some(origin)).unwrap_err();
        assert!(refused.contains("403"), "{origin}: {refused}");
    }
    let rebound = format!("Host: evil.example:{0}\r\nOrigin: http://evil.example:{0}\r\n", house.at.port());
    assert!(house.ask("/room.show-left/", &rebound).starts_with("HTTP/1.1 403"));
    assert!(house.ask("/", "").starts_with("HTTP/1.1 403"), "without `Host`");
    let counts = house.server.end();
    assert_eq!((counts.foreign_origins, counts.foreign_hosts, counts.windows), (3, 2, 2));
    let words = counts.in_words().join("\n");
    assert!(words.contains("3 requests by pages of other sites") && words.contains("DNS rebinding"), "{words}");
}

#[test]
fn from_elsewhere_the_token_is_needed_and_kept_in_a_cookie() {
    let house = house("0.0.0.0:0");
    let token = house.address.split("?token=").nth(1).unwrap();
    assert_eq!(token.len(), 32);
    let own = house.own();
    assert!(house.ask("/room.show-left/", &own).starts_with("HTTP/1.1 403"));
    assert!(house.ask("/room.show-left/?token=00000000000000000000000000000000", &own).starts_with("HTTP/1.1 403"));
    assert!(house.open_as(None).unwrap_err().contains("403"), "nor is there a socket without");
    let first = house.ask(&format!("/room.show-left/?token={token}"), &own);
    assert!(first.starts_with("HTTP/1.1 303") && first.contains("Location: /room.show-left/\r\n"), "{first}");
    let cookie = first.lines().find_map(|it| it.strip_prefix("Set-Cookie: ")).unwrap();
    let cookie = cookie.split(';').next().unwrap();
    assert!(house.ask("/room.show-left/", &format!("{own}Cookie: {cookie}\r\n")).ends_with("<p>the page</p>"));
    assert!(!house.link.address().contains(token), "what nodes write down holds no secret");
    assert_eq!(house.server.counts().without_token, 3);
}

#[test]
fn a_window_that_floods_is_closed_and_counted_and_the_others_go_on() {
    let mut house = house("0");
    let mut good = house.open();
    house.opened();
    let mut bad = house.open();
    let flood = std::thread::spawn(move || {
        for _ in 0..200_000 {
            if bad.send(Message::text("x")).is_err() {
                return true;
            }
        }
        false
    });
    assert!(flood.join().unwrap(), "it was not stopped");
    // The node took nothing: its queue held what it holds.
    house.counts(|it| it.flooding == 1 && it.dropped > 1000);
    good.send(Message::text("ping 1")).unwrap();
    assert!(good.read().unwrap().into_text().unwrap().starts_with("pong 1 "));
    good.send(Message::text("still here")).unwrap();
    let until = Instant::now() + PATIENCE;
    let mut n_taken = 0;
    while house.next().what != PageNews::Text("still here".to_owned()) {
        n_taken += 1;
        assert!(Instant::now() < until);
    }
    assert!(n_taken < 300, "{n_taken} of the other's messages were kept");
}

#[test]
fn a_window_that_does_not_read_is_skipped_then_closed_and_the_node_never_waits() {
    let mut house = house("0");
    let stalled = house.open();
    let client = house.opened();
    let text = "x".repeat(60_000);
    let begun = Instant::now();
    let mut longest = Duration::ZERO;
    // Until the system's own buffers are full, too.
    let why = loop {
        let before = Instant::now();
        house.link.send(client, &text);
        longest = longest.max(before.elapsed());
        match house.link.take().map(|it| it.what) {
            Some(PageNews::Closed(why)) => break why,
            _ => std::thread::sleep(Duration::from_millis(1)),
        }
        assert!(begun.elapsed() < PATIENCE);
    };
    assert!(longest < Duration::from_secs(2), "sending took {longest:?}");
    assert!(why.contains("it did not read for 5 s"), "{why}");
    house.counts(|it| it.stalled == 1 && it.skipped > 0);
    drop(stalled);
    // Nor does one that asks for a large file and leaves it.
    let mut lazy = TcpStream::connect(house.at).unwrap();
    write!(lazy, "GET /room.show-left/big HTTP/1.1\r\n{}\r\n", house.own()).unwrap();
    house.counts(|it| it.stalled == 2);
}

#[test]
fn windows_that_send_and_never_read_keep_no_place_for_ever() {
    let house = house("0");
    let mut deaf: Vec<_> = (0..64).map(|_| house.open()).collect();
    let until = Instant::now() + PATIENCE;
    while house.server.counts().stalled < 64 {
        assert!(Instant::now() < until, "{:?}", house.server.counts());
        deaf.iter_mut().for_each(|it| drop(it.send(Message::text("x"))));
        std::thread::sleep(Duration::from_millis(100));
    }
    assert!(house.ask("/", &house.own()).starts_with("HTTP/1.1 200"), "there is room again");
}

#[test]
fn messages_that_are_too_long_and_what_is_no_protocol_end_the_window() {
    let mut house = house("0");
    let mut socket = house.open();
    house.opened();
    socket.send(Message::text("x".repeat(64 << 10))).unwrap();
    assert_eq!(house.next().what, PageNews::Text("x".repeat(64 << 10)));
    drop(socket.send(Message::text("x".repeat((64 << 10) + 1))));
    assert!(house.closed().contains("65537 bytes, expected at most 65536"));
    let mut socket = house.open();
    house.opened();
    socket.get_mut().write_all(b"this is no frame of a WebSocket").unwrap();
    assert!(house.closed().contains("broke the protocol"));
    house.counts(|it| it.too_large == 1 && it.malformed == 1);
    let mut tls = TcpStream::connect(house.at).unwrap();
    tls.write_all(&[0x16, 3, 1, 2, 0, 1, 0]).unwrap();
    house.counts(|it| it.malformed == 2);
    let long = house.ask(&format!("/{}", "x".repeat(9000)), &house.own());
    assert!(long.starts_with("HTTP/1.1 400") || long.is_empty(), "{long}");
    house.counts(|it| it.malformed == 3);
}

#[test]
fn half_a_request_does_not_keep_a_place_for_ever_and_places_are_counted() {
    let house = house("0");
    let mut slow: Vec<TcpStream> = (0..64).map(|_| TcpStream::connect(house.at).unwrap()).collect();
    slow.iter_mut().for_each(|it| it.write_all(b"GET / HT").unwrap());
    house.counts(|_| true);
    std::thread::sleep(Duration::from_millis(300));
    let mut one_more = TcpStream::connect(house.at).unwrap();
    one_more.set_read_timeout(Some(PATIENCE)).unwrap();
    let mut nothing = [0];
    let refused = one_more.read(&mut nothing);
    assert!(matches!(&refused, Ok(0)) || refused.is_err_and(|it| it.kind() == ErrorKind::ConnectionReset));
    house.counts(|it| it.too_many == 1 && it.malformed == 64);
    assert!(house.ask("/", &house.own()).starts_with("HTTP/1.1 200"), "there is room again");
}

#[test]
fn a_thousand_connections_at_once_are_bounded_and_leave_the_windows_alone() {
    let mut house = house("0");
    let mut socket = house.open();
    let client = house.opened();
    let crowd: Vec<TcpStream> = (0..1000).filter_map(|_| TcpStream::connect(house.at).ok()).collect();
    house.counts(|it| it.too_many >= 500);
    assert!(house.link.send(client, "still here"));
    assert_eq!(socket.read().unwrap(), Message::text("still here"));
    drop(crowd);
    assert!(house.ask("/", &house.own()).starts_with("HTTP/1.1 200"), "there is room again");
}

#[test]
fn bytes_go_to_windows_the_newest_of_each_topic_and_none_come_from_them() {
    let mut house = house("0");
    let mut socket = house.open();
    let client = house.opened();
    // More than the system's buffers hold: what waits is replaced.
    for number in 0..200_u8 {
        house.link.send_latest(client, vec![(1, vec![number; 300_000]), (2, vec![number])]);
    }
    let (mut n, mut last) = (0, [0; 2]);
    while last != [199, 199] {
        let Message::Binary(bytes) = socket.read().unwrap() else { continue };
        let place = usize::from(bytes.len() == 1);
        assert!(bytes[0] >= last[place] && bytes.iter().all(|it| *it == bytes[0]), "in order and whole");
        last[place] = bytes[0];
        n += 1;
    }
    assert!(n < 400, "{n}: some were replaced");
    socket.send(Message::binary(vec![1, 2, 3])).unwrap();
    assert!(house.closed().contains("3 bytes that are no text"));
    house.counts(|it| it.malformed == 1 && it.skipped == 0);
}

#[test]
fn the_end_closes_windows_and_the_port_at_once_even_with_clients_that_hang() {
    let mut house = house("0");
    let mut socket = house.open();
    let client = house.opened();
    let _half = TcpStream::connect(house.at).unwrap();
    let stalled = house.open();
    assert!(house.link.send(client, "last words"));
    let begun = Instant::now();
    house.server.end();
    assert!(begun.elapsed() < Duration::from_secs(1), "it took {:?}", begun.elapsed());
    assert_eq!(socket.read().unwrap(), Message::text("last words"));
    match socket.read() {
        Ok(Message::Close(Some(frame))) => assert_eq!(frame.reason.as_str(), "the program has ended"),
        other => panic!("{other:?}"),
    }
    drop(stalled.get_ref().shutdown(Shutdown::Both));
    assert!(TcpListener::bind(house.at).is_ok(), "the port is free again");
    assert!(!house.link.send(client, "more"));
    assert!(!house.server.is_serving());
}

#[test]
fn a_port_that_is_taken_is_named() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let listen: Listen = taken.local_addr().unwrap().to_string().parse().unwrap();
    let server = Server::new(listen, |_, _| {});
    let fault = server.open("room.show[left]", page()).err().unwrap();
    assert!(
        fault.contains(&taken.local_addr().unwrap().to_string()) && fault.contains("expected a free port"),
        "{fault}"
    );
}

#[test]
fn a_page_that_is_put_up_anew_is_opened_anew() {
    let mut house = house("0");
    let mut socket = house.open();
    house.opened();
    house.link = house.server.open("room.show[left]", page()).unwrap();
    match socket.read() {
        Ok(Message::Close(Some(frame))) => assert!(frame.reason.as_str().contains("page"), "{frame:?}"),
        other => panic!("{other:?}"),
    }
    let _again = house.open();
    let mut news = house.next();
    while news.what != PageNews::Opened {
        news = house.next();
    }
}
