//! The server's thread: looks after all connections in turn, and waits for none of them.

use std::collections::BTreeMap;
use std::io;
use std::time::{Duration, Instant};

use mio::net::TcpListener;
use mio::{Events, Interest, Poll, Token, Waker};

use crate::admission::Admission;
use crate::board::Board;
use crate::connection::{Connection, House, Outcome};

const LISTENER: Token = Token(0);
const WAKER: Token = Token(1);
/// Connections at once: a wall of sixteen tiles and what browsers open beside them.
const MOST_CONNECTIONS: usize = 64;
/// Requests a second: a page that loads the pictures of a set asks for a hundred.
const MOST_REQUESTS: u32 = 500;
/// Longest sleep: bounds how late a stall is seen.
const LONGEST_SLEEP: Duration = Duration::from_millis(500);

/// All that the thread has.
pub(crate) struct Turns {
    poll: Poll,
    listener: TcpListener,
    admission: Admission,
    connections: BTreeMap<usize, Connection>,
    next: usize,
    second: Instant,
    n_requests: u32,
}

impl Turns {
    /// Ready to run; and who wakes it.
    ///
    /// # Errors
    /// The system's.
    pub(crate) fn new(listener: std::net::TcpListener, admission: Admission) -> io::Result<(Turns, Waker)> {
        listener.set_nonblocking(true)?;
        let mut listener = TcpListener::from_std(listener);
        let poll = Poll::new()?;
        poll.registry().register(&mut listener, LISTENER, Interest::READABLE)?;
        let waker = Waker::new(poll.registry(), WAKER)?;
        let connections = BTreeMap::new();
        Ok((Turns { poll, listener, admission, connections, next: 2, second: Instant::now(), n_requests: 0 }, waker))
    }

    /// Serves until the board says that it is over.
    pub(crate) fn run(mut self, board: &Board) {
        let mut events = Events::with_capacity(128);
        let mut is_going = true;
        while !board.is_ending() {
            let sleep = if is_going { Duration::ZERO } else { LONGEST_SLEEP };
            match self.poll.poll(&mut events, Some(sleep)) {
                Err(error) if error.kind() != io::ErrorKind::Interrupted => break,
                _ => {}
            }
            is_going = self.accept(board);
            let ends: Vec<usize> = self.connections.keys().copied().collect();
            for key in ends {
                is_going |= self.look_after(key, board);
            }
        }
        self.connections.values_mut().for_each(|it| it.farewell(board));
    }

    /// Takes those who wait at the door, a few at a time; whether there may be more.
    fn accept(&mut self, board: &Board) -> bool {
        for _ in 0..16 {
            let mut stream = match self.listener.accept() {
                Ok((stream, _)) => stream,
                Err(error) => return error.kind() == io::ErrorKind::Interrupted,
            };
            if self.connections.len() >= MOST_CONNECTIONS {
                board.count(|it| it.too_many += 1);
                continue;
            }
            let both = Interest::READABLE | Interest::WRITABLE;
            if self.poll.registry().register(&mut stream, Token(self.next), both).is_ok() {
                self.connections.insert(self.next, Connection::new(stream));
                self.next += 1;
            }
        }
        true
    }

    /// One turn of one connection; whether it has more to do at once.
    fn look_after(&mut self, key: usize, board: &Board) -> bool {
        if self.second.elapsed() > Duration::from_secs(1) {
            (self.second, self.n_requests) = (Instant::now(), 0);
        }
        let Some(connection) = self.connections.get_mut(&key) else { return false };
        let house = House { board, admission: &self.admission, has_room: self.n_requests < MOST_REQUESTS };
        let was_head = connection.is_head();
        let outcome = connection.turn(&house);
        self.n_requests += u32::from(was_head && !connection.is_head());
        if outcome == Outcome::Over {
            if let Some(mut gone) = self.connections.remove(&key)
                && let Some(stream) = gone.stream_mut()
            {
                drop(self.poll.registry().deregister(stream));
            }
            return false;
        }
        outcome == Outcome::Goes
    }
}
