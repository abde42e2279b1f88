//! Bytes that went over the line, kept until they are fetched.

use std::collections::VecDeque;

use foveate::prelude::{Interval, Time};

use super::Medium;
use crate::line_traffic::{Direction, LinePiece, LineTraffic};
use crate::visca::VISCA_END;
use crate::visca::packet::LONGEST;

/// Most pieces that are kept: more than a minute of inquiries and answers.
const MOST_PIECES: usize = 4096;
/// Longest pause between two bytes of a piece: a byte takes 33 ms at 300 baud, the slowest line.
const LONGEST_PAUSE: Interval = Interval(50_000_000);

/// What went over a line.
#[derive(Debug, Clone, Default)]
pub(super) struct Traffic {
    pieces: VecDeque<LinePiece>,
    /// Time of the last byte, where the last piece is the beginning of a packet.
    begun: Option<Time>,
    lost: u64,
}

impl Traffic {
    pub(super) fn send(&mut self, now: Time, frame: &[u8]) {
        self.begun = None;
        self.push(LinePiece { time: now, direction: Direction::Sent, bytes: frame.to_vec() });
    }

    /// Serial bytes of one packet become one piece, up to the longest packet.
    pub(super) fn receive(&mut self, now: Time, bytes: &[u8], medium: Medium) {
        if bytes.is_empty() {
            return;
        }
        let is_same = self.is_open(now);
        let is_whole = medium == Medium::Ip || bytes.ends_with(&[VISCA_END]);
        self.begun = (!is_whole).then_some(now);
        match self.pieces.back_mut().filter(|it| is_same && it.bytes.len() + bytes.len() <= LONGEST) {
            Some(piece) => piece.bytes.extend_from_slice(bytes),
            None => self.push(LinePiece { time: now, direction: Direction::Received, bytes: bytes.to_vec() }),
        }
    }

    /// Everything since the last call except a packet whose end may still come; `None` if there is nothing.
    pub(super) fn take(&mut self, now: Time) -> Option<LineTraffic> {
        let n_open = usize::from(self.is_open(now));
        let n_whole = self.pieces.len().saturating_sub(n_open);
        if n_whole == 0 {
            return None;
        }
        Some(LineTraffic { lost: std::mem::take(&mut self.lost), pieces: self.pieces.drain(..n_whole).collect() })
    }

    /// Whether the last piece is the beginning of a packet whose next byte may still come.
    fn is_open(&self, now: Time) -> bool {
        self.begun.is_some_and(|it| now - it <= LONGEST_PAUSE)
    }

    fn push(&mut self, piece: LinePiece) {
        if self.pieces.len() == MOST_PIECES {
            self.pieces.pop_front();
            self.lost += 1;
        }
        self.pieces.push_back(piece);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at_ms(ms: i64) -> Time {
        Time(ms * 1_000_000)
    }

    /// Time [ms] and bytes of each piece that is given out at `ms`.
    fn take(traffic: &mut Traffic, ms: i64) -> Vec<(i64, Vec<u8>)> {
        let pieces = traffic.take(at_ms(ms)).map(|it| it.pieces).unwrap_or_default();
        pieces.into_iter().map(|it| (it.time.0 / 1_000_000, it.bytes)).collect()
    }

    #[test]
    fn a_packet_that_comes_byte_by_byte_is_one_piece_of_the_time_of_its_first_byte() {
        let mut traffic = Traffic::default();
        for (ms, byte) in [(1, 0x90), (2, 0x41)] {
            traffic.receive(at_ms(ms), &[byte], Medium::Serial);
            assert_eq!(take(&mut traffic, ms), [], "its end may still come");
        }
        traffic.receive(at_ms(3), &[0xFF], Medium::Serial);
        traffic.receive(at_ms(4), &[0x90], Medium::Serial);
        assert_eq!(take(&mut traffic, 4), [(1, vec![0x90, 0x41, 0xFF])]);
        // Its end does not come: a pause ends the piece.
        assert_eq!(take(&mut traffic, 54), []);
        assert_eq!(take(&mut traffic, 55), [(4, vec![0x90])]);
        traffic.receive(at_ms(56), &[0x51, 0xFF], Medium::Serial);
        assert_eq!(take(&mut traffic, 56), [(56, vec![0x51, 0xFF])]);
        assert_eq!(traffic.take(at_ms(57)), None);
    }

    #[test]
    fn datagrams_and_frames_are_pieces_of_their_own() {
        let mut traffic = Traffic::default();
        traffic.receive(at_ms(1), &[1, 2], Medium::Ip);
        traffic.receive(at_ms(1), &[3], Medium::Ip);
        traffic.receive(at_ms(2), &[], Medium::Ip);
        traffic.receive(at_ms(3), &[0x90], Medium::Serial);
        traffic.send(at_ms(4), &[0x81, 0xFF]);
        traffic.receive(at_ms(5), &[0x41], Medium::Serial);
        let expected = [(1, vec![1, 2]), (1, vec![3]), (3, vec![0x90]), (4, vec![0x81, 0xFF])];
        assert_eq!(take(&mut traffic, 5), expected);
        // Noise without an end is divided by the length of the longest packet.
        (6..40).for_each(|ms| traffic.receive(at_ms(ms), &[7], Medium::Serial));
        let lengths: Vec<usize> = take(&mut traffic, 100).iter().map(|it| it.1.len()).collect();
        assert_eq!(lengths, [16, 16, 3]);
    }

    #[test]
    fn what_is_not_fetched_is_dropped_and_counted() {
        let mut traffic = Traffic::default();
        (0..MOST_PIECES as i64 + 3).for_each(|ms| traffic.send(at_ms(ms), &[1]));
        let kept = traffic.take(at_ms(10_000)).unwrap();
        assert_eq!((kept.lost, kept.pieces.len(), kept.pieces[0].time), (3, MOST_PIECES, at_ms(3)));
        traffic.send(at_ms(10_001), &[1]);
        assert_eq!(traffic.take(at_ms(10_001)).map(|it| it.lost), Some(0));
    }
}
