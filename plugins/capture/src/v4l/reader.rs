//! The thread that waits for a camera, and the bounded box that it puts pictures into.
//!
//! When the rig does not take them in time, the oldest picture goes, and counts as a gap at the next one.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use foveate::prelude::ConfigError;

use super::device::DeviceClock;
use super::settings::V4lSettings;
use super::stream::{Counts, Lost, Step, Stream, Turn, What};

/// A camera takes its settings between two pictures, in milliseconds.
const PATIENCE: Duration = Duration::from_secs(2);
/// Turns that wait for the rig at most.
const CAPACITY: usize = 4;

/// A stream on a thread of its own, which ends when this is dropped.
pub(crate) struct Reader {
    shared: Arc<Shared>,
    clock: DeviceClock,
    thread: Option<JoinHandle<Counts>>,
}

/// Settings for the camera, and where to say what became of them.
type Change = (V4lSettings, SyncSender<Result<(), ConfigError>>);

#[derive(Default)]
struct Shared {
    turns: Mutex<Waiting>,
    /// Settings that the camera is to get.
    change: Mutex<Option<Change>>,
    stop: AtomicBool,
}

#[derive(Default)]
struct Waiting {
    turns: VecDeque<Turn>,
    /// Losses of turns that were thrown away, for the next one.
    lost: Vec<Lost>,
}

impl Waiting {
    fn put(&mut self, turn: Turn) {
        if self.turns.len() >= CAPACITY
            && let Some(old) = self.turns.pop_front()
        {
            let reason = match old.what {
                What::Picture(_) => "the rig did not take this frame in time".to_owned(),
                What::Gap(reason) => reason,
            };
            let own = Lost { count: 1, reason };
            for lost in old.lost.into_iter().chain([own]) {
                add(&mut self.lost, lost);
            }
            if let Some(next) = self.turns.front_mut() {
                for lost in std::mem::take(&mut next.lost) {
                    add(&mut self.lost, lost);
                }
                next.lost = std::mem::take(&mut self.lost);
            }
        }
        self.turns.push_back(turn);
    }
}

/// Adds to a list of losses; the same reason is one entry.
fn add(list: &mut Vec<Lost>, lost: Lost) {
    match list.iter_mut().find(|it| it.reason == lost.reason) {
        Some(same) => same.count += lost.count,
        None => list.push(lost),
    }
}

impl Reader {
    /// Starts reading.
    ///
    /// # Errors
    /// The system gives no thread.
    pub(crate) fn start(mut stream: Stream, name: &str) -> std::io::Result<Reader> {
        let shared = Arc::new(Shared::default());
        let own = Arc::clone(&shared);
        let clock = stream.clock();
        let thread = std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            while !own.stop.load(Ordering::Relaxed) {
                let change = own.change.lock().unwrap_or_else(PoisonError::into_inner).take();
                if let Some((settings, done)) = change {
                    let _ = done.try_send(stream.change(&settings)); // who asked may not wait any more
                }
                match stream.step() {
                    Step::Turn(turn) => own.turns.lock().unwrap_or_else(PoisonError::into_inner).put(turn),
                    Step::Nothing => {}
                    // Dropping the reader wakes it.
                    Step::Pause(length) => std::thread::park_timeout(length),
                }
            }
            stream.close();
            stream.counts
        })?;
        Ok(Reader { shared, clock, thread: Some(thread) })
    }

    /// The oldest turn that waits.
    pub(crate) fn take(&self) -> Option<Turn> {
        self.shared.turns.lock().unwrap_or_else(PoisonError::into_inner).turns.pop_front()
    }

    /// Gives the camera other settings, and waits until it has taken them.
    ///
    /// # Errors
    /// What it does not take, or that it does not answer.
    pub(crate) fn change(&self, settings: &V4lSettings) -> Result<(), ConfigError> {
        let (done, answer) = sync_channel(1);
        *self.shared.change.lock().unwrap_or_else(PoisonError::into_inner) = Some((settings.clone(), done));
        self.thread.iter().for_each(|it| it.thread().unpark());
        answer.recv_timeout(PATIENCE).unwrap_or_else(|_| Err(ConfigError::node("the camera does not answer")))
    }

    /// The thread has ended by itself, which it never should.
    pub(crate) fn is_dead(&self) -> bool {
        self.thread.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// The device clock now [ns].
    pub(crate) fn device_now(&self) -> i64 {
        (self.clock)()
    }

    /// Ends the thread; its counts, if it did not die.
    pub(crate) fn end(&mut self) -> Option<Counts> {
        self.shared.stop.store(true, Ordering::Relaxed);
        let thread = self.thread.take()?;
        thread.thread().unpark();
        thread.join().ok()
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(stamp: i64, lost: &[(u64, &str)]) -> Turn {
        let lost = lost.iter().map(|it| Lost { count: it.0, reason: it.1.to_owned() }).collect();
        Turn { stamp, arrival: stamp, what: What::Picture(Arc::default()), lost }
    }

    #[test]
    fn oldest_goes_when_nobody_takes_and_every_frame_is_counted_once() {
        let mut waiting = Waiting::default();
        for stamp in 0..10 {
            let lost: &[(u64, &str)] = if stamp == 2 { &[(3, "the driver lost this frame")] } else { &[] };
            waiting.put(picture(stamp, lost));
        }
        assert_eq!(waiting.turns.iter().map(|it| it.stamp).collect::<Vec<_>>(), [6, 7, 8, 9]);
        let lost: Vec<_> = waiting.turns[0].lost.iter().map(|it| (it.count, it.reason.as_str())).collect();
        assert_eq!(lost, [(6, "the rig did not take this frame in time"), (3, "the driver lost this frame")]);
        assert!(waiting.turns.iter().skip(1).all(|it| it.lost.is_empty()));
    }
}
