//! Input policies: how an input port takes data.

use std::collections::VecDeque;

use foveate_estimation::random::Random;
use foveate_messages::{Interval, Time};

use foveate_node::io::Packet;
use foveate_node::port::InputPolicy;
use foveate_rig::graph::{Queue, WhenFull};

/// A source is silent once another one has this many messages waiting for it: from then on until it comes again, no set waits for it.
const SYNC_DEPTH: usize = 4;

/// What waits at one input port. Sources are numbered in the order of the port's edges.
pub(crate) enum Inbox {
    /// In order of delivery, each with its source.
    Each(VecDeque<(usize, Packet)>),
    Latest,
    Synced(Synced),
    Fresh(Fresh),
}

/// Outcome of putting a message into an inbox.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Put {
    /// The port may trigger.
    Triggers,
    /// It is kept and triggers nothing now.
    Waits,
    /// Of it and a waiting message of the same source only one is kept; the other one is lost.
    Replaces,
    /// It is not kept.
    Refused,
}

/// Outcome of a message that waits.
pub(crate) enum DeliveryOutcome<'p> {
    /// It goes to the node.
    Taken(&'p Packet),
    /// It was there and another one was chosen.
    PassedOver,
    /// It was expected in a set and did not come.
    Missing,
}

/// Called with the source of a message and its outcome.
pub(crate) type OnOutcome<'t> = &'t mut dyn FnMut(usize, DeliveryOutcome<'_>);

impl Inbox {
    pub(crate) fn new(policy: InputPolicy, n_sources: usize, random: Random) -> Self {
        let fresh = |pick| {
            let waiting = (0..n_sources).map(|_| None).collect();
            Inbox::Fresh(Fresh { waiting, pick })
        };
        match policy {
            InputPolicy::Each => Inbox::Each(VecDeque::new()),
            InputPolicy::Latest => Inbox::Latest,
            InputPolicy::Synced(tolerance) => {
                let waiting = (0..n_sources).map(|_| VecDeque::new()).collect();
                Inbox::Synced(Synced { tolerance, waiting, is_silent: vec![false; n_sources] })
            }
            InputPolicy::NewestOfEach => fresh(Pick::AtRandom(random)),
            InputPolicy::Newest => fresh(Pick::Newest),
            InputPolicy::RoundRobin => fresh(Pick::InTurn(0)),
        }
    }

    /// Puts in a message of source number `source`; `latest` ports keep theirs elsewhere.
    pub(crate) fn put(&mut self, source: usize, packet: Packet) -> Put {
        match self {
            Inbox::Each(queue) => {
                queue.push_back((source, packet));
                Put::Triggers
            }
            Inbox::Latest => Put::Waits,
            Inbox::Synced(synced) => {
                synced.waiting[source].push_back(packet);
                synced.is_silent[source] = false;
                if synced.is_ready() { Put::Triggers } else { Put::Waits }
            }
            Inbox::Fresh(fresh) => fresh.put(source, packet),
        }
    }

    /// Puts in a message while the node is busy: of each source no more than the edge's queue holds may wait. A producer
    /// cannot be made to wait on a logical clock, so that `wait` lets the queue grow.
    pub(crate) fn put_bounded(&mut self, source: usize, packet: Packet, limit: Queue) -> Put {
        if self.waiting(source) < limit.capacity {
            return self.put(source, packet);
        }
        match limit.when_full {
            WhenFull::DropNewest => return Put::Refused,
            WhenFull::Wait => return self.put(source, packet),
            WhenFull::DropOldest => {}
        }
        match self {
            Inbox::Each(queue) => {
                let oldest = queue.iter().position(|it| it.0 == source);
                oldest.map(|it| queue.remove(it));
            }
            Inbox::Synced(synced) => drop(synced.waiting[source].pop_front()),
            Inbox::Latest | Inbox::Fresh(_) => {}
        }
        self.put(source, packet);
        Put::Replaces
    }

    /// Messages of `source` that wait, of those that are not replaced by newer ones.
    pub(crate) fn waiting(&self, source: usize) -> usize {
        match self {
            Inbox::Each(queue) => queue.iter().filter(|it| it.0 == source).count(),
            Inbox::Synced(synced) => synced.waiting[source].len(),
            Inbox::Latest | Inbox::Fresh(_) => 0,
        }
    }

    /// Whether [`Inbox::next`] may find something.
    pub(crate) fn may_trigger(&self) -> bool {
        match self {
            Inbox::Each(queue) => !queue.is_empty(),
            Inbox::Latest => false,
            Inbox::Synced(synced) => synced.is_ready(),
            Inbox::Fresh(fresh) => fresh.waiting.iter().any(Option::is_some),
        }
    }

    /// Takes out what the next activation is about, into `packets` (empty before and, if nothing is ready, after).
    pub(crate) fn next(&mut self, packets: &mut Vec<Packet>, on_outcome: OnOutcome<'_>) -> bool {
        match self {
            Inbox::Each(queue) => match queue.pop_front() {
                Some((source, packet)) => {
                    on_outcome(source, DeliveryOutcome::Taken(&packet));
                    packets.push(packet);
                }
                None => return false,
            },
            Inbox::Latest => return false,
            Inbox::Synced(synced) => return synced.is_ready() && synced.close_set(packets, on_outcome),
            Inbox::Fresh(fresh) => match fresh.pick(on_outcome) {
                Some(packet) => packets.push(packet),
                None => return false,
            },
        }
        true
    }

    /// At the end of the data: closes the oldest set even though some of its sources could still have come.
    pub(crate) fn flush(&mut self, packets: &mut Vec<Packet>, on_outcome: OnOutcome<'_>) -> bool {
        match self {
            Inbox::Synced(synced) => synced.close_set(packets, on_outcome),
            Inbox::Each(_) | Inbox::Latest | Inbox::Fresh(_) => self.next(packets, on_outcome),
        }
    }

    /// The node will not come any more: all that waits is passed over, and nothing will be kept.
    pub(crate) fn close(&mut self, on_outcome: OnOutcome<'_>) {
        match std::mem::replace(self, Inbox::Latest) {
            Inbox::Each(queue) => queue.iter().for_each(|it| on_outcome(it.0, DeliveryOutcome::PassedOver)),
            Inbox::Latest => {}
            Inbox::Synced(synced) => {
                for (source, queue) in synced.waiting.iter().enumerate() {
                    queue.iter().for_each(|_| on_outcome(source, DeliveryOutcome::PassedOver));
                }
            }
            Inbox::Fresh(fresh) => {
                let waiting = fresh.waiting.iter().enumerate().filter(|it| it.1.is_some());
                waiting.for_each(|it| on_outcome(it.0, DeliveryOutcome::PassedOver));
            }
        }
    }
}

/// Joins one message of each source by capture time.
pub(crate) struct Synced {
    tolerance: Interval,
    waiting: Vec<VecDeque<Packet>>,
    /// By source: whether sets are closed without it.
    is_silent: Vec<bool>,
}

impl Synced {
    /// The earliest capture time that waits: the set to be closed next begins there.
    fn start(&self) -> Option<Time> {
        self.waiting.iter().filter_map(|queue| Some(queue.front()?.stamp.time)).min()
    }

    /// Whether no source can add to the next set any more, or one has waited too long for the others.
    fn is_ready(&self) -> bool {
        self.start().is_some()
            && (self.waiting.iter().zip(&self.is_silent).all(|(queue, &is_silent)| is_silent || !queue.is_empty())
                || self.waiting.iter().any(|queue| queue.len() >= SYNC_DEPTH))
    }

    fn close_set(&mut self, packets: &mut Vec<Packet>, on_outcome: OnOutcome<'_>) -> bool {
        let Some(start) = self.start() else { return false };
        if self.waiting.iter().any(|queue| queue.len() >= SYNC_DEPTH) {
            for (queue, is_silent) in self.waiting.iter().zip(&mut self.is_silent) {
                *is_silent |= queue.is_empty();
            }
        }
        for (source, queue) in self.waiting.iter_mut().enumerate() {
            let joins = queue.front().is_some_and(|packet| packet.stamp.time - start <= self.tolerance);
            match if joins { queue.pop_front() } else { None } {
                Some(packet) => {
                    on_outcome(source, DeliveryOutcome::Taken(&packet));
                    packets.push(packet);
                }
                None => on_outcome(source, DeliveryOutcome::Missing),
            }
        }
        true
    }
}

/// Keeps the newest message of each source, and picks one of them when the node is free [Davis 2002 §3.5].
pub(crate) struct Fresh {
    waiting: Vec<Option<Packet>>,
    pick: Pick,
}

/// Which source is picked.
enum Pick {
    /// Any of those that have a message; the others lose theirs.
    AtRandom(Random),
    /// The one with the newest message, the first of several; the others lose theirs.
    Newest,
    /// The first that has one from this number on; the others keep theirs.
    InTurn(usize),
}

impl Fresh {
    fn put(&mut self, source: usize, packet: Packet) -> Put {
        match &mut self.waiting[source] {
            Some(kept) => {
                if packet.stamp.time >= kept.stamp.time {
                    *kept = packet;
                }
                Put::Replaces
            }
            empty => {
                *empty = Some(packet);
                Put::Triggers
            }
        }
    }

    fn pick(&mut self, on_outcome: OnOutcome<'_>) -> Option<Packet> {
        let n_sources = self.waiting.len();
        let fresh = self.waiting.iter().enumerate().filter_map(|(source, it)| Some((source, it.as_ref()?)));
        let chosen = match &mut self.pick {
            Pick::AtRandom(random) => match fresh.clone().count() as u32 {
                0 => None,
                1 => fresh.map(|it| it.0).next(),
                several => fresh.map(|it| it.0).nth(random.below(several) as usize),
            },
            Pick::Newest => fresh.rev().max_by_key(|it| it.1.stamp.time).map(|it| it.0),
            Pick::InTurn(activation) => {
                let chosen = fresh.map(|it| it.0).min_by_key(|source| (source + n_sources - *activation) % n_sources);
                let chosen = chosen?;
                *activation = (chosen + 1) % n_sources;
                let packet = self.waiting[chosen].take()?;
                on_outcome(chosen, DeliveryOutcome::Taken(&packet));
                return Some(packet);
            }
        }?;
        let mut picked = None;
        for (source, slot) in self.waiting.iter_mut().enumerate() {
            let Some(packet) = slot.take() else { continue };
            if source == chosen {
                on_outcome(source, DeliveryOutcome::Taken(&packet));
                picked = Some(packet);
            } else {
                on_outcome(source, DeliveryOutcome::PassedOver);
            }
        }
        picked
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_messages::{SourceId, Stamp, Targets};

    use super::*;

    fn packet(source: u32, time_ms: i64) -> Packet {
        let stamp = Stamp { time: Time(time_ms * 1_000_000), source: SourceId(source), sequence: 0 };
        Packet { stamp, payload: Arc::new(Targets::default()) }
    }

    /// Source and capture time [ms].
    type Seen = (u32, i64);

    /// What became of a message that the node did not get.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    enum Lost {
        PassedOver,
        Missing,
    }

    fn lost(outcome: DeliveryOutcome<'_>) -> Option<Lost> {
        match outcome {
            DeliveryOutcome::Taken(_) => None,
            DeliveryOutcome::PassedOver => Some(Lost::PassedOver),
            DeliveryOutcome::Missing => Some(Lost::Missing),
        }
    }

    /// Puts `messages` (source, capture time) in one by one and takes out what is ready; gives the sets and the losses.
    fn play(policy: InputPolicy, n_sources: usize, messages: &[(usize, i64)]) -> (Vec<Vec<Seen>>, Vec<(usize, Lost)>) {
        let mut inbox = Inbox::new(policy, n_sources, Random::new(5));
        let (mut sets, mut losses) = (Vec::new(), Vec::new());
        for &(source, time_ms) in messages {
            inbox.put(source, packet(source as u32, time_ms));
            let mut packets = Vec::new();
            while inbox.next(&mut packets, &mut |source, outcome| losses.extend(lost(outcome).map(|it| (source, it)))) {
                let stamps = packets.drain(..).map(|it| (it.stamp.source.0, it.stamp.time.0 / 1_000_000));
                sets.push(stamps.collect());
            }
        }
        (sets, losses)
    }

    const TOLERANCE: InputPolicy = InputPolicy::Synced(Interval(4_000_000));

    #[test]
    fn set_is_complete_when_every_source_has_come_within_the_tolerance() {
        let (sets, losses) = play(TOLERANCE, 3, &[(0, 0), (2, 3), (1, 1), (1, 17), (0, 16), (2, 18)]);
        assert_eq!(sets, [vec![(0, 0), (1, 1), (2, 3)], vec![(0, 16), (1, 17), (2, 18)]]);
        assert_eq!(losses, []);
    }

    #[test]
    fn source_that_skips_a_frame_is_missing_from_that_set_only() {
        let (sets, losses) = play(TOLERANCE, 2, &[(0, 0), (1, 16), (0, 16)]);
        assert_eq!(sets, [vec![(0, 0)], vec![(0, 16), (1, 16)]]);
        assert_eq!(losses, [(1, Lost::Missing)]);
    }

    #[test]
    fn dead_source_does_not_hold_up_the_others() {
        let messages: Vec<_> = (0..10).map(|frame| (0, frame * 16)).collect();
        let (sets, losses) = play(TOLERANCE, 2, &messages);
        assert_eq!(sets.len(), 10, "only the first sets wait for it");
        assert!(losses.iter().all(|&it| it == (1, Lost::Missing)));
    }

    #[test]
    fn source_that_comes_again_is_waited_for_again() {
        let first: Vec<_> = (0..5).map(|frame| (0, frame * 16)).collect();
        let messages = [&first[..], &[(1, 81), (0, 80), (0, 96), (1, 96)]].concat();
        let (sets, losses) = play(TOLERANCE, 2, &messages);
        assert_eq!(sets.len(), 7);
        assert_eq!(sets[5..], [vec![(0, 80), (1, 81)], vec![(0, 96), (1, 96)]]);
        assert_eq!(losses.len(), 5);
    }

    /// How often each of three sources is picked in 3000 activations, when two messages of each wait at every activation; source 0 is ahead.
    fn picked(policy: InputPolicy) -> [usize; 3] {
        let mut inbox = Inbox::new(policy, 3, Random::new(1));
        let (mut picked, mut passed, mut replaced) = ([0; 3], 0, 0);
        for activation in 0..3000 {
            for source in 0..3 {
                for _ in 0..2 {
                    let ahead = if source == 0 { 4 } else { 0 };
                    replaced +=
                        usize::from(inbox.put(source, packet(source as u32, activation + ahead)) == Put::Replaces);
                }
            }
            let mut packets = Vec::new();
            let mut on_outcome =
                |_: usize, outcome: DeliveryOutcome<'_>| passed += usize::from(lost(outcome) == Some(Lost::PassedOver));
            assert!(inbox.next(&mut packets, &mut on_outcome));
            picked[packets[0].stamp.source.0 as usize] += 1;
            let emptied = policy != InputPolicy::RoundRobin;
            assert_eq!(inbox.may_trigger(), !emptied, "the queues are emptied at each activation");
        }
        inbox.close(&mut |_, _| passed += 1);
        assert_eq!(picked.iter().sum::<usize>() + passed + replaced, 3000 * 6, "all are accounted for");
        picked
    }

    #[test]
    fn newest_of_each_and_taking_turns_starve_no_source_and_the_newest_does() {
        let at_random = picked(InputPolicy::NewestOfEach);
        assert!(at_random.iter().all(|&count| (850..1150).contains(&count)), "{at_random:?}");
        assert_eq!(picked(InputPolicy::RoundRobin), [1000; 3]);
        assert_eq!(picked(InputPolicy::Newest), [3000, 0, 0]);
    }

    #[test]
    fn older_message_does_not_take_the_place_of_a_newer_one() {
        let mut inbox = Inbox::new(InputPolicy::NewestOfEach, 1, Random::new(1));
        assert_eq!([20, 30, 10].map(|it| inbox.put(0, packet(0, it))), [Put::Triggers, Put::Replaces, Put::Replaces]);
        let mut packets = Vec::new();
        inbox.next(&mut packets, &mut |_, _| {});
        assert_eq!(packets[0].stamp.time, Time(30_000_000));
    }

    #[test]
    fn turns_pass_over_sources_that_have_nothing() {
        let (sets, losses) = play(InputPolicy::RoundRobin, 3, &[(2, 1), (2, 2), (0, 3), (0, 4), (1, 5)]);
        assert_eq!(sets.concat(), [(2, 1), (2, 2), (0, 3), (0, 4), (1, 5)]);
        assert_eq!(losses, []);
    }

    #[test]
    fn bounded_queue_keeps_to_its_policy_for_each_source_alone() {
        for (when_full, kept, lost) in [
            (WhenFull::DropOldest, vec![(1, 0), (0, 3), (0, 4)], Put::Replaces),
            (WhenFull::DropNewest, vec![(1, 0), (0, 2), (0, 3)], Put::Refused),
            (WhenFull::Wait, vec![(1, 0), (0, 2), (0, 3), (0, 4)], Put::Triggers),
        ] {
            let mut inbox = Inbox::new(InputPolicy::Each, 2, Random::new(1));
            let limit = Queue { capacity: 2, when_full };
            let mut put = |source, time| inbox.put_bounded(source, packet(source as u32, time), limit);
            assert_eq!(
                [put(1, 0), put(0, 2), put(0, 3), put(0, 4)],
                [Put::Triggers, Put::Triggers, Put::Triggers, lost]
            );
            let mut packets = Vec::new();
            while inbox.next(&mut packets, &mut |_, _| {}) {}
            let found: Vec<Seen> = packets.iter().map(|it| (it.stamp.source.0, it.stamp.time.0 / 1_000_000)).collect();
            assert_eq!(found, kept, "{when_full:?}");
        }
    }

    #[test]
    fn each_keeps_the_order_of_delivery() {
        let (sets, _) = play(InputPolicy::Each, 2, &[(1, 5), (0, 3), (1, 4)]);
        assert_eq!(sets, [vec![(1, 5)], vec![(0, 3)], vec![(1, 4)]]);
    }
}
