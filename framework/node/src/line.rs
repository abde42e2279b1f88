//! Byte lines between a driver and a device that is simulated in the same run.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate_messages::{Message, Space, Time, Wire};

/// A device at the other end of a line, on the logical clock of the run: written bytes arrive after their transmission time.
///
/// Times passed in never decrease.
pub trait Device: Send {
    /// The driver writes `bytes` at `now`.
    fn write(&mut self, now: Time, bytes: &[u8]);

    /// The bytes that have reached the driver by `now` since it read last: any piece of a stream, or one datagram.
    fn read(&mut self, now: Time, bytes: &mut Vec<u8>);

    /// Whether bytes travel as datagrams: one per write, at most one per read. Otherwise they are a stream.
    fn has_datagrams(&self) -> bool {
        false
    }
}

/// A [`Device`] as a message: emitted once at the start, held by each node that talks to the device.
#[derive(Clone)]
pub struct Line(Arc<Mutex<dyn Device>>);

impl Line {
    /// A line to `device`.
    pub fn new(device: Arc<Mutex<dyn Device>>) -> Line {
        Line(device)
    }

    /// The device, for one write or read.
    pub fn device(&self) -> MutexGuard<'_, dyn Device + 'static> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Message for Line {
    const NAME: &'static str = "line";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::Local;
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Echo(Vec<u8>);

    impl Device for Echo {
        fn write(&mut self, _now: Time, bytes: &[u8]) {
            self.0.extend_from_slice(bytes);
        }

        fn read(&mut self, _now: Time, bytes: &mut Vec<u8>) {
            bytes.append(&mut self.0);
        }
    }

    #[test]
    fn all_holders_of_a_line_talk_to_one_device() {
        let line = Line::new(Arc::new(Mutex::new(Echo(Vec::new()))));
        let other = line.clone();
        line.device().write(Time::ZERO, b"abc");
        let mut heard = Vec::new();
        other.device().read(Time::ZERO, &mut heard);
        assert_eq!(heard, b"abc");
    }
}
