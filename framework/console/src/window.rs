//! One window: what it looks at, and what it was sent.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use foveate_node::io::Packet;
use foveate_node::page::Client;

use crate::view::Kind;

/// Topics of one window, at most: three forms of a thousand cameras.
pub(crate) const MOST_WANTS: usize = 4096;
/// Messages of one topic that a window gets, at most [Hz].
const MOST_HZ: f64 = 60.0;
const LEAST_HZ: f64 = 0.1;

/// A window in which the page is open.
pub(crate) struct Window {
    pub client: Client,
    pub wants: Vec<Want>,
    /// By name: which change of it was sent.
    pub sheets: BTreeMap<String, u64>,
}

/// Something that a window looks at.
pub(crate) struct Want {
    /// By its number in [`Index`](crate::hello::Index).
    pub topic: usize,
    pub kind: Kind,
    period: Duration,
    next: Instant,
    sent: Option<Mark>,
}

/// Tells messages of one topic apart.
type Mark = (i64, u64, usize);

impl Want {
    pub(crate) fn new(topic: usize, kind: Kind, hz: f64, now: Instant) -> Want {
        let hz = if hz.is_finite() { hz.clamp(LEAST_HZ, MOST_HZ) } else { LEAST_HZ };
        Want { topic, kind, period: Duration::from_secs_f64(1.0 / hz), next: now, sent: None }
    }

    /// Whether it is time for another message.
    pub(crate) fn is_due(&self, now: Instant) -> bool {
        now >= self.next
    }

    /// Whether `packet` is another message than the last one.
    pub(crate) fn is_news(&self, packet: &Packet) -> bool {
        self.sent != Some(mark(packet))
    }

    /// `packet` was sent at `now`. The next one is due at a multiple of the period since `epoch`: windows that want the same get it at once, and it is made once.
    pub(crate) fn send(&mut self, packet: &Packet, now: Instant, epoch: Instant) {
        self.sent = Some(mark(packet));
        let n_periods = (now.saturating_duration_since(epoch).as_secs_f64() / self.period.as_secs_f64()).floor() + 1.0;
        self.next = epoch + self.period.mul_f64(n_periods);
    }

    /// The number of what it shows, under which a later message replaces an earlier one that waits.
    pub(crate) fn slot(&self) -> u64 {
        (self.topic as u64) << 2 | u64::from(self.kind.number() - 1)
    }
}

fn mark(packet: &Packet) -> Mark {
    let at = std::sync::Arc::as_ptr(&packet.payload).cast::<()>();
    (packet.stamp.time.0, packet.stamp.sequence, at as usize)
}
