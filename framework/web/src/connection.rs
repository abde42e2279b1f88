//! One connection: a request and its answer, or a WebSocket. Nothing here waits: what cannot go on now goes on at the next turn.

use std::io::{ErrorKind, Read, Write};
use std::time::{Duration, Instant};

use foveate_node::page::Client;
use mio::net::TcpStream;
use tungstenite::error::CapacityError;
use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::frame::coding::CloseCode;
use tungstenite::protocol::{CloseFrame, Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

use crate::admission::{Admission, Refusal};
use crate::board::{Board, Out};
use crate::http::{self, Reading, Request};

/// A request must be there, and an answer or message taken, in this time.
const LONGEST_STALL: Duration = Duration::from_secs(5);
/// A socket is sent a ping so often, and closed when it does not answer: it reads nothing, or its computer was put to sleep.
const QUIET: Duration = Duration::from_secs(10);
/// Longest message of a page [bytes].
const MOST_MESSAGE: usize = 64 << 10;
/// Messages to a window go together up to so much [bytes].
const TOGETHER: usize = 128 << 10;
/// Messages and bytes that a window may send in a second: a page that follows a pointer sends 60 to 1000.
const MOST_A_SECOND: u32 = 4000;
const MOST_BYTES_A_SECOND: usize = 8 << 20;
/// Messages of one window looked at in one turn, so that it does not keep the others.
const A_TURN: u32 = 64;

/// State of a connection after a turn.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// It waits for the other end.
    Waits,
    /// There is more to do at once.
    Goes,
    /// It is over.
    Over,
}

/// A connection.
pub(crate) struct Connection {
    state: State,
    /// When what it is about began.
    since: Instant,
}

enum State {
    Head { stream: TcpStream, read: Vec<u8> },
    Answer { stream: TcpStream, bytes: Vec<u8>, written: usize },
    Socket(Box<Socket>),
    Over,
}

struct Socket {
    web: WebSocket<TcpStream>,
    client: Client,
    /// A message could not be written whole, since when.
    held: Option<Instant>,
    /// When it last answered a ping, and when it was sent one that it has not answered.
    answered: Instant,
    asked: Option<Instant>,
    second: Instant,
    n_heard: u32,
    bytes_heard: usize,
}

/// What a turn needs.
pub(crate) struct House<'a> {
    pub board: &'a Board,
    pub admission: &'a Admission,
    /// Fewer requests than a second may bring so far.
    pub has_room: bool,
}

impl Connection {
    pub(crate) fn new(stream: TcpStream) -> Connection {
        // Messages are small and wanted at once.
        drop(stream.set_nodelay(true));
        Connection { state: State::Head { stream, read: Vec::new() }, since: Instant::now() }
    }

    pub(crate) fn stream_mut(&mut self) -> Option<&mut TcpStream> {
        match &mut self.state {
            State::Head { stream, .. } | State::Answer { stream, .. } => Some(stream),
            State::Socket(socket) => Some(socket.web.get_mut()),
            State::Over => None,
        }
    }

    /// Whether its request is not there yet.
    pub(crate) fn is_head(&self) -> bool {
        matches!(self.state, State::Head { .. })
    }

    /// Does what it can without waiting.
    pub(crate) fn turn(&mut self, house: &House<'_>) -> Outcome {
        match std::mem::replace(&mut self.state, State::Over) {
            State::Head { stream, read } => self.read_head(house, stream, read),
            State::Answer { stream, bytes, written } => self.answer(house, stream, bytes, written),
            State::Socket(mut socket) => match socket.turn(house.board) {
                Ok(outcome) => {
                    self.state = State::Socket(socket);
                    outcome
                }
                Err(why) => {
                    house.board.closed(socket.client, why);
                    Outcome::Over
                }
            },
            State::Over => Outcome::Over,
        }
    }

    /// The run is over: says so to who listens, as far as that goes without waiting.
    pub(crate) fn farewell(&mut self, board: &Board) {
        if let State::Socket(socket) = &mut self.state {
            drop(socket.pump(board));
            socket.close(CloseCode::Away, "the program has ended");
            board.closed(socket.client, "the program has ended".to_owned());
        }
        self.state = State::Over;
    }

    fn read_head(&mut self, house: &House<'_>, mut stream: TcpStream, mut read: Vec<u8>) -> Outcome {
        let mut buffer = [0; 2048];
        let is_at_end = loop {
            match stream.read(&mut buffer) {
                Ok(0) => break true,
                Ok(n) => read.extend_from_slice(&buffer[..n]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break false,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Outcome::Over,
            }
            if read.len() > http::MOST_HEAD {
                break false;
            }
        };
        match http::read(&read) {
            Reading::Whole(request) => {
                if !house.has_room {
                    house.board.count(|it| it.too_many += 1);
                    return self.say(
                        house,
                        stream,
                        http::words("503 Service Unavailable", "too many requests a second"),
                    );
                }
                self.route(house, stream, &read[request.length..], &request)
            }
            Reading::Wrong => {
                house.board.count(|it| it.malformed += 1);
                self.say(house, stream, http::words("400 Bad Request", "found no request of HTTP/1.1, expected one"))
            }
            Reading::Partial if is_at_end || self.since.elapsed() > LONGEST_STALL => {
                // Browsers open connections beforehand that they may never use.
                if !read.is_empty() {
                    house.board.count(|it| it.malformed += 1);
                }
                Outcome::Over
            }
            Reading::Partial => {
                self.state = State::Head { stream, read };
                Outcome::Waits
            }
        }
    }

    /// Answers a request.
    fn route(&mut self, house: &House<'_>, stream: TcpStream, rest: &[u8], request: &Request) -> Outcome {
        if let Err(refusal) = house.admission.check(request) {
            house.board.count(|it| match refusal {
                Refusal::Host => it.foreign_hosts += 1,
                Refusal::Origin => it.foreign_origins += 1,
                Refusal::Token => it.without_token += 1,
            });
            return self.say(house, stream, http::words("403 Forbidden", refusal.words()));
        }
        if !request.is_get {
            return self.say(house, stream, http::words("405 Method Not Allowed", "expected GET"));
        }
        if request.is_bad_socket {
            let text = "found an invalid WebSocket request, expected version 13 with a key";
            return self.say(
                house,
                stream,
                http::answer("426 Upgrade Required", "text/plain", "Sec-WebSocket-Version: 13\r\n", text.as_bytes()),
            );
        }
        let path = request.path.trim_start_matches('/');
        if let Some(key) = &request.socket_key {
            return match path.strip_suffix("/socket").and_then(|page| house.board.opened(page)) {
                Some(client) => self.upgrade(house, stream, rest, key, client),
                None => self.say(house, stream, http::words("404 Not Found", "no page has this socket")),
            };
        }
        let answer = content(house.board, path, house.admission.cookie(request));
        self.say(house, stream, answer)
    }

    fn upgrade(&mut self, house: &House<'_>, mut stream: TcpStream, rest: &[u8], key: &str, client: Client) -> Outcome {
        let head = format!(
            "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {}\r\n\r\n",
            derive_accept_key(key.as_bytes())
        );
        // The first bytes of a connection always find room.
        if stream.write(head.as_bytes()).ok() != Some(head.len()) {
            house.board.closed(client, "it was gone before it was there".to_owned());
            return Outcome::Over;
        }
        let config = WebSocketConfig::default()
            .read_buffer_size(8 << 10)
            .write_buffer_size(TOGETHER)
            .max_message_size(Some(MOST_MESSAGE))
            .max_frame_size(Some(MOST_MESSAGE));
        let now = Instant::now();
        self.state = State::Socket(Box::new(Socket {
            web: WebSocket::from_partially_read(stream, rest.to_vec(), Role::Server, Some(config)),
            client,
            held: None,
            answered: now,
            asked: None,
            second: now,
            n_heard: 0,
            bytes_heard: 0,
        }));
        Outcome::Goes
    }

    fn say(&mut self, house: &House<'_>, stream: TcpStream, bytes: Vec<u8>) -> Outcome {
        self.since = Instant::now();
        self.answer(house, stream, bytes, 0)
    }

    fn answer(&mut self, house: &House<'_>, mut stream: TcpStream, bytes: Vec<u8>, mut written: usize) -> Outcome {
        while written < bytes.len() {
            match stream.write(&bytes[written..]) {
                Ok(n) if n > 0 => {
                    written += n;
                    self.since = Instant::now();
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => {
                    if self.since.elapsed() > LONGEST_STALL {
                        house.board.count(|it| it.stalled += 1);
                        return Outcome::Over;
                    }
                    self.state = State::Answer { stream, bytes, written };
                    return Outcome::Waits;
                }
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                _ => return Outcome::Over,
            }
        }
        drop(stream.shutdown(std::net::Shutdown::Write));
        Outcome::Over
    }
}

/// The answer to a request for `path`; `cookie` where it came with the token in its address, which then goes from there.
fn content(board: &Board, path: &str, cookie: Option<String>) -> Vec<u8> {
    const HTML: &str = "text/html; charset=utf-8";
    let is_page = path.is_empty() || path.ends_with('/');
    if let Some(cookie) = cookie.filter(|_| is_page) {
        return http::answer("303 See Other", "text/plain", &format!("{cookie}Location: /{path}\r\n"), b"");
    }
    let missing = || http::words("404 Not Found", "found nothing of that name; `/` lists the pages");
    match path {
        "" => {
            let pages = board.pages().into_iter();
            let list: String = pages
                .map(|(name, instance)| format!("<li><a href=\"/{name}/\">{}</a>", http::escaped(&instance)))
                .collect();
            let html = format!(
                "<!doctype html><meta charset=utf-8><title>Foveate</title><h1>Pages of this run</h1><ul>{list}</ul>"
            );
            http::answer("200 OK", HTML, "", html.as_bytes())
        }
        "foveate.js" => http::answer("200 OK", "text/javascript; charset=utf-8", "", include_bytes!("foveate.js")),
        "favicon.ico" => http::answer("204 No Content", "image/png", "", b""),
        _ => match path.split_once('/') {
            None if board.html(path).is_some() => {
                http::answer("308 Permanent Redirect", "text/plain", &format!("Location: /{path}/\r\n"), b"")
            }
            None => missing(),
            Some((page, "")) => {
                board.html(page).map_or_else(missing, |it| http::answer("200 OK", HTML, "", it.as_bytes()))
            }
            Some((page, file)) => match board.file(page, file) {
                Some(Ok(file)) => http::answer("200 OK", file.content_type, "", &file.bytes),
                Some(Err(said)) => http::words("500 Internal Server Error", &format!("the page's node {said}")),
                None => missing(),
            },
        },
    }
}

impl Socket {
    /// Reads and writes; why it is over, where it is.
    fn turn(&mut self, board: &Board) -> Result<Outcome, String> {
        let mut outcome = Outcome::Goes;
        for _ in 0..A_TURN {
            match self.web.read() {
                Ok(message) => self.hear(board, &message)?,
                Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => {
                    outcome = Outcome::Waits;
                    break;
                }
                Err(error) => return Err(self.give_up(board, &error)),
            }
        }
        self.pump(board)?;
        if let Some(why) = board.must_close(self.client) {
            self.close(CloseCode::Restart, why);
            return Err(why.to_owned());
        }
        if self.held.is_some_and(|it| it.elapsed() > LONGEST_STALL) {
            board.count(|it| it.stalled += 1);
            return Err(format!("it did not read for {} s", LONGEST_STALL.as_secs()));
        }
        if self.asked.is_some_and(|it| it.elapsed() > LONGEST_STALL) {
            board.count(|it| it.stalled += 1);
            return Err(format!("it did not answer a ping for {} s", LONGEST_STALL.as_secs()));
        }
        if self.asked.is_none() && self.answered.elapsed() > QUIET {
            self.asked = Some(Instant::now());
            self.write(Message::Ping(Default::default()))?;
        }
        Ok(outcome)
    }

    fn hear(&mut self, board: &Board, message: &Message) -> Result<(), String> {
        let now = Instant::now();
        if message.is_pong() {
            (self.answered, self.asked) = (now, None);
        }
        if now - self.second > Duration::from_secs(1) {
            (self.second, self.n_heard, self.bytes_heard) = (now, 0, 0);
        }
        self.n_heard += 1;
        self.bytes_heard += message.len();
        if self.n_heard > MOST_A_SECOND || self.bytes_heard > MOST_BYTES_A_SECOND {
            board.count(|it| it.flooding += 1);
            self.close(CloseCode::Policy, "too many messages a second");
            return Err(format!(
                "it sent more than {MOST_A_SECOND} messages or {} MiB in a second",
                MOST_BYTES_A_SECOND >> 20
            ));
        }
        if message.is_binary() {
            board.count(|it| it.malformed += 1);
            self.close(CloseCode::Unsupported, "pages send texts");
            return Err(format!("it sent {} bytes that are no text", message.len()));
        }
        if let Message::Text(text) = message {
            match text.strip_prefix("ping ") {
                Some(sent) if sent.len() < 40 && sent.bytes().all(|it| it.is_ascii_graphic()) => {
                    // A clock that is asked behind a message that waits would answer late.
                    if self.held.is_none() {
                        let pong = format!("pong {sent} {:.6}", board.now() as f64 * 1e-6);
                        self.write(Message::text(pong))?;
                    }
                }
                _ => board.heard(self.client, text.as_str().to_owned()),
            }
        }
        Ok(())
    }

    /// Sends what waits, as far as the window takes it.
    fn pump(&mut self, board: &Board) -> Result<(), String> {
        if self.held.is_some() {
            match self.web.flush() {
                Ok(()) => self.held = None,
                Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(format!("the connection broke: {error}")),
            }
        }
        while self.held.is_none() {
            let Some(next) = board.next_out(self.client) else { break };
            let message = match next {
                Out::Text(text) => Message::text(&*text),
                Out::Latest(_, bytes) => Message::binary(bytes),
            };
            let written = self.web.write(message);
            self.note(written)?;
        }
        // Small ones go together.
        let flushed = if self.held.is_none() { self.web.flush() } else { Ok(()) };
        self.note(flushed)
    }

    fn write(&mut self, message: Message) -> Result<(), String> {
        let sent = self.web.send(message);
        self.note(sent)
    }

    /// Notes that the other end takes no more for now.
    fn note(&mut self, written: Result<(), Error>) -> Result<(), String> {
        match written {
            Ok(()) => Ok(()),
            Err(Error::Io(error)) if error.kind() == ErrorKind::WouldBlock => {
                self.held.get_or_insert_with(Instant::now);
                Ok(())
            }
            Err(error) => Err(format!("the connection broke: {error}")),
        }
    }

    /// Says farewell, as far as that goes without waiting.
    fn close(&mut self, code: CloseCode, why: &'static str) {
        drop(self.web.close(Some(CloseFrame { code, reason: why.into() })));
        drop(self.web.flush());
    }

    fn give_up(&mut self, board: &Board, error: &Error) -> String {
        match error {
            Error::ConnectionClosed | Error::AlreadyClosed => "it was closed".to_owned(),
            Error::Capacity(CapacityError::MessageTooLong { size, .. }) => {
                board.count(|it| it.too_large += 1);
                self.close(CloseCode::Size, "the message is too long");
                format!("it sent a message of {size} bytes, expected at most {MOST_MESSAGE}")
            }
            Error::Io(_) | Error::Protocol(tungstenite::error::ProtocolError::ResetWithoutClosingHandshake) => {
                "the connection broke".to_owned()
            }
            other => {
                board.count(|it| it.malformed += 1);
                self.close(CloseCode::Protocol, "not as RFC 6455 has it");
                format!("it broke the protocol: {other}")
            }
        }
    }
}
