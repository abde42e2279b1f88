//! Several messages may be of one time, each knowing more than the one before: the last one counts.

use std::sync::Arc;

use foveate::prelude::*;

/// Holds a message back until time has moved on.
#[derive(Debug, Default)]
pub(crate) struct LastOfTime {
    held: Option<Arc<Targets>>,
    /// Messages of an earlier time than one before them.
    late: u64,
}

impl LastOfTime {
    /// Takes a message in; gives out the last one of a time that is over. A late message comes out at once.
    pub(crate) fn push(&mut self, message: Arc<Targets>) -> Option<Arc<Targets>> {
        match &self.held {
            Some(held) if message.time < held.time => {
                self.late += 1;
                Some(message)
            }
            Some(held) if message.time == held.time => {
                self.held = Some(message);
                None
            }
            _ => self.held.replace(message),
        }
    }

    /// The one that is still held, at the end.
    pub(crate) fn finish(&mut self) -> Option<Arc<Targets>> {
        self.held.take()
    }

    /// How many came late.
    pub(crate) fn late(&self) -> u64 {
        self.late
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn last_message_of_a_time_comes_out_when_time_moves_on() {
        let mut last = LastOfTime::default();
        let message = |time: i64, count: usize| {
            let target = crate::target_rows::tests::target(1, [0.0; 3], How::Measured);
            Arc::new(Targets { time: Time(time), list: vec![target; count] })
        };
        let mut outcome = Vec::new();
        for (time, count) in [(1, 1), (1, 2), (1, 3), (2, 1), (1, 9), (4, 2)] {
            outcome.extend(last.push(message(time, count)).map(|it| (it.time.0, it.list.len())));
        }
        outcome.extend(last.finish().map(|it| (it.time.0, it.list.len())));
        assert_eq!(outcome, [(1, 3), (1, 9), (2, 1), (4, 2)]);
        assert_eq!(last.late(), 1);
    }
}
