//! The four ways in which an input port takes data.

use std::collections::VecDeque;

use foveate_estimation::random::Random;
use foveate_messages::{Interval, Time};

use crate::io::Packet;
use crate::port::Take;

/// A set is closed without a source that is silent once another source has this many messages waiting.
const SYNC_DEPTH: usize = 4;

/// What waits at one input port. Sources are numbered in the order of the port's edges.
pub(crate) enum Inbox {
    Each(VecDeque<Packet>),
    Latest,
    Synced(Synced),
    NewestOfEach(NewestOfEach),
}

/// What became of a message that was put into an inbox.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Put {
    /// The port may trigger.
    Triggers,
    /// It is kept and triggers nothing now.
    Waits,
    /// It took the place of an older message of the same source, which is lost.
    Replaces,
}

impl Inbox {
    pub(crate) fn new(take: Take, n_sources: usize, random: Random) -> Self {
        match take {
            Take::Each => Inbox::Each(VecDeque::new()),
            Take::Latest => Inbox::Latest,
            Take::Synced(tolerance) => {
                Inbox::Synced(Synced { tolerance, waiting: (0..n_sources).map(|_| VecDeque::new()).collect() })
            }
            Take::NewestOfEach => {
                Inbox::NewestOfEach(NewestOfEach { fresh: (0..n_sources).map(|_| None).collect(), random })
            }
        }
    }

    /// Puts in a message of source number `source`; `latest` ports keep theirs elsewhere.
    pub(crate) fn put(&mut self, source: usize, packet: Packet) -> Put {
        match self {
            Inbox::Each(queue) => {
                queue.push_back(packet);
                Put::Triggers
            }
            Inbox::Latest => Put::Waits,
            Inbox::Synced(synced) => {
                synced.waiting[source].push_back(packet);
                if synced.is_ready() { Put::Triggers } else { Put::Waits }
            }
            Inbox::NewestOfEach(newest) => match newest.fresh[source].replace(packet) {
                None => Put::Triggers,
                Some(_) => Put::Replaces,
            },
        }
    }

    /// Whether [`Inbox::next`] may find something.
    pub(crate) fn may_trigger(&self) -> bool {
        match self {
            Inbox::Each(queue) => !queue.is_empty(),
            Inbox::Latest => false,
            Inbox::Synced(synced) => synced.is_ready(),
            Inbox::NewestOfEach(newest) => newest.fresh.iter().any(Option::is_some),
        }
    }

    /// Takes out what the next turn is about, into `packets` (empty before and, if nothing is ready, after).
    /// `lost` is told the source of each message that is passed over or missing, and which of the two it is.
    pub(crate) fn next(&mut self, packets: &mut Vec<Packet>, lost: &mut dyn FnMut(usize, Lost)) -> bool {
        match self {
            Inbox::Each(queue) => match queue.pop_front() {
                Some(packet) => packets.push(packet),
                None => return false,
            },
            Inbox::Latest => return false,
            Inbox::Synced(synced) => return synced.is_ready() && synced.close_set(packets, lost),
            Inbox::NewestOfEach(newest) => match newest.pick(lost) {
                Some(packet) => packets.push(packet),
                None => return false,
            },
        }
        true
    }

    /// At the end of the data: closes the oldest set even though some of its sources could still have come.
    pub(crate) fn flush(&mut self, packets: &mut Vec<Packet>, lost: &mut dyn FnMut(usize, Lost)) -> bool {
        match self {
            Inbox::Synced(synced) => synced.close_set(packets, lost),
            Inbox::Each(_) | Inbox::Latest | Inbox::NewestOfEach(_) => self.next(packets, lost),
        }
    }
}

/// Why a message does not reach its consumer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lost {
    /// It was there and another one was chosen.
    PassedOver,
    /// It was expected in a set and did not come.
    Missing,
}

/// Joins one message of each source by capture time.
pub(crate) struct Synced {
    tolerance: Interval,
    waiting: Vec<VecDeque<Packet>>,
}

impl Synced {
    /// The earliest capture time that waits: the set to be closed next begins there.
    fn start(&self) -> Option<Time> {
        self.waiting.iter().filter_map(|queue| Some(queue.front()?.stamp.time)).min()
    }

    /// Whether no source can add to the next set any more, or one has waited too long for the others.
    fn is_ready(&self) -> bool {
        self.start().is_some()
            && (self.waiting.iter().all(|queue| !queue.is_empty())
                || self.waiting.iter().any(|queue| queue.len() >= SYNC_DEPTH))
    }

    fn close_set(&mut self, packets: &mut Vec<Packet>, lost: &mut dyn FnMut(usize, Lost)) -> bool {
        let Some(start) = self.start() else { return false };
        for (source, queue) in self.waiting.iter_mut().enumerate() {
            let joins = queue.front().is_some_and(|packet| packet.stamp.time - start <= self.tolerance);
            match if joins { queue.pop_front() } else { None } {
                Some(packet) => packets.push(packet),
                None => lost(source, Lost::Missing),
            }
        }
        true
    }
}

/// Keeps the newest message of each source; picks a source at random [Davis 2002 §3.5].
pub(crate) struct NewestOfEach {
    fresh: Vec<Option<Packet>>,
    random: Random,
}

impl NewestOfEach {
    fn pick(&mut self, lost: &mut dyn FnMut(usize, Lost)) -> Option<Packet> {
        let n_fresh = self.fresh.iter().flatten().count() as u32;
        if n_fresh == 0 {
            return None;
        }
        let chosen = if n_fresh == 1 { 0 } else { self.random.below(n_fresh) };
        let mut picked = None;
        let fresh = self.fresh.iter_mut().enumerate().filter_map(|(source, slot)| Some((source, slot.take()?)));
        for (place, (source, packet)) in fresh.enumerate() {
            if place as u32 == chosen {
                picked = Some(packet);
            } else {
                lost(source, Lost::PassedOver);
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

    /// Puts `messages` (source, capture time) in one by one and takes out what is ready; gives the sets and the losses.
    fn play(take: Take, n_sources: usize, messages: &[(usize, i64)]) -> (Vec<Vec<Seen>>, Vec<(usize, Lost)>) {
        let mut inbox = Inbox::new(take, n_sources, Random::new(5));
        let (mut sets, mut losses) = (Vec::new(), Vec::new());
        for &(source, time_ms) in messages {
            inbox.put(source, packet(source as u32, time_ms));
            let mut packets = Vec::new();
            while inbox.next(&mut packets, &mut |source, lost| losses.push((source, lost))) {
                let stamps = packets.drain(..).map(|it| (it.stamp.source.0, it.stamp.time.0 / 1_000_000));
                sets.push(stamps.collect());
            }
        }
        (sets, losses)
    }

    const TOLERANCE: Take = Take::Synced(Interval(4_000_000));

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
        assert_eq!(sets.len(), 10 - (SYNC_DEPTH - 1));
        assert!(losses.iter().all(|&it| it == (1, Lost::Missing)));
    }

    #[test]
    fn newest_of_each_starves_no_source_and_accounts_for_all() {
        let mut inbox = Inbox::new(Take::NewestOfEach, 3, Random::new(1));
        let (mut picked, mut passed, mut replaced) = ([0; 3], 0, 0);
        for turn in 0..3000 {
            for source in 0..3 {
                for _ in 0..2 {
                    replaced += usize::from(inbox.put(source, packet(source as u32, turn)) == Put::Replaces);
                }
            }
            let mut packets = Vec::new();
            assert!(inbox.next(&mut packets, &mut |_, lost| passed += usize::from(lost == Lost::PassedOver)));
            picked[packets[0].stamp.source.0 as usize] += 1;
            assert!(!inbox.next(&mut Vec::new(), &mut |_, _| {}), "the queues are emptied at each turn");
        }
        assert!(picked.iter().all(|&count| (850..1150).contains(&count)), "{picked:?}");
        assert_eq!(picked.iter().sum::<usize>() + passed + replaced, 3000 * 6);
    }

    #[test]
    fn each_keeps_the_order_of_delivery() {
        let (sets, _) = play(Take::Each, 2, &[(1, 5), (0, 3), (1, 4)]);
        assert_eq!(sets, [vec![(1, 5)], vec![(0, 3)], vec![(1, 4)]]);
    }
}
