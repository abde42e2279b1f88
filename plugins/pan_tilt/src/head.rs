//! A head on its line: a [`Driver`], a port, and a receiving thread.
//!
//! A command is written to the port by the thread that gives it: no other thread has to wake up in between. The receiving
//! thread reads, opens and re-opens the port, and handles due actions.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use foveate::prelude::Time;

use crate::driver::{CommandId, Counts, Driver, Event, Link};
use crate::line_traffic::LineTraffic;
use crate::port::{Port, Receiver, Sender};
use crate::visca::{Command, OutOfRange};

/// Reads the session clock; called from several threads.
pub type Clock = Arc<dyn Fn() -> Time + Send + Sync>;

/// Longest time between checks for due actions.
const LONGEST_WAIT: Duration = Duration::from_millis(20);

/// A running head. The port is closed when it is dropped.
pub struct Head {
    shared: Arc<Shared>,
    listener: Option<JoinHandle<()>>,
}

struct Shared {
    clock: Clock,
    stop: AtomicBool,
    driven: Mutex<Driven>,
}

struct Driven {
    driver: Driver,
    sender: Option<Box<dyn Sender>>,
}

impl Head {
    /// Begins to open the port and to greet the head. The outcome comes as [`events`](Self::events).
    pub fn start(driver: Driver, port: Port, clock: Clock) -> Head {
        let driven = Mutex::new(Driven { driver, sender: None });
        let shared = Arc::new(Shared { clock, stop: AtomicBool::new(false), driven });
        let listener = {
            let shared = Arc::clone(&shared);
            std::thread::spawn(move || shared.listen(&port))
        };
        Head { shared, listener: Some(listener) }
    }

    /// Gives a command, see [`Driver::command`]. If line and head have room it is written before this returns.
    ///
    /// # Errors
    /// A number out of the model's range.
    pub fn command(&self, command: Command) -> Result<CommandId, OutOfRange> {
        let mut driven = self.shared.lock();
        let now = (self.shared.clock)();
        let id = driven.driver.command(now, command)?;
        driven.send_due(now);
        Ok(id)
    }

    /// Events since the last call, oldest first.
    pub fn events(&self) -> Vec<Event> {
        let mut driven = self.shared.lock();
        std::iter::from_fn(|| driven.driver.next_event()).collect()
    }

    /// Frames and bytes since the last call, see [`Driver::traffic`].
    pub fn traffic(&self) -> Option<LineTraffic> {
        let mut driven = self.shared.lock();
        driven.driver.traffic((self.shared.clock)())
    }

    /// State of the link.
    pub fn link(&self) -> Link {
        self.shared.lock().driver.link().clone()
    }

    /// Whether every command was sent and completed.
    pub fn is_idle(&self) -> bool {
        self.shared.lock().driver.is_idle()
    }

    /// Counts so far.
    pub fn counts(&self) -> Counts {
        self.shared.lock().driver.counts()
    }
}

impl Drop for Head {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        if let Some(listener) = self.listener.take() {
            // A panic of the listener has been printed; there is nothing left to do about it.
            drop(listener.join());
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Driven> {
        self.driven.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn listen(&self, port: &Port) {
        let mut receiver: Option<Box<dyn Receiver>> = None;
        let mut buffer = [0; 256];
        while !self.stop.load(Ordering::Relaxed) {
            let Some(open) = &mut receiver else {
                receiver = self.open(port);
                if receiver.is_none() {
                    std::thread::sleep(LONGEST_WAIT);
                }
                continue;
            };
            let received = open.receive(&mut buffer, self.wait());
            let now = (self.clock)();
            let mut driven = self.lock();
            match received {
                Ok(n) => driven.driver.receive(now, &buffer[..n]),
                Err(error) => driven.lose(now, &error.to_string()),
            }
            driven.send_due(now);
            if driven.sender.is_none() {
                receiver = None;
            }
        }
    }

    /// Opens the port if it is due.
    fn open(&self, port: &Port) -> Option<Box<dyn Receiver>> {
        let is_due = self.lock().driver.open_at().is_some_and(|it| (self.clock)() >= it);
        if !is_due {
            return None;
        }
        // Not under the lock: some ports take their time.
        let opened = port.open();
        let mut driven = self.lock();
        let now = (self.clock)();
        match opened {
            Ok((sender, receiver)) => {
                driven.sender = Some(sender);
                driven.driver.opened(now);
                driven.send_due(now);
                Some(receiver)
            }
            Err(reason) => {
                driven.driver.lost(now, &reason);
                None
            }
        }
    }

    /// Time until the next due action, but short: a command of another thread may be earlier.
    fn wait(&self) -> Duration {
        let due = self.lock().driver.wake();
        let nanoseconds = due.map_or(i64::MAX, |it| (it - (self.clock)()).0);
        Duration::from_nanos(nanoseconds.max(0) as u64).clamp(Duration::from_millis(1), LONGEST_WAIT)
    }
}

impl Driven {
    fn send_due(&mut self, now: Time) {
        while let Some(sender) = &mut self.sender {
            let Some(frame) = self.driver.poll(now) else { return };
            if let Err(error) = sender.send(&frame.0) {
                self.lose(now, &error.to_string());
            }
        }
    }

    fn lose(&mut self, now: Time, reason: &str) {
        self.sender = None;
        self.driver.lost(now, reason);
    }
}
