//! Line traffic: what the message says went over the line is what the device at its other end got and gave.

use foveate::prelude::*;
use foveate_pan_tilt::line_traffic::{Direction, LinePiece};

use super::parts::{Heard, rig_text, run_rig, simulated};

const COMMAND: [u8; 15] = [0x81, 1, 6, 2, 24, 20, 0, 1, 0, 8, 0xF, 0xF, 8, 8, 0xFF];

/// Runs with one command at 1 s, and a tap between head and device.
#[track_caller]
fn tapped(settings: &str) -> Heard {
    let rest = simulated(settings).replace("reports =", "traffic = \"head.line_traffic\", reports =");
    let tap = "[scale.room.node.tap]\ntype = \"test.tap\"\ncamera = \"wide-3\"\nin = { line = \"device.line\" }";
    let wired = r#"in = { commands = "orders.commands", line = "tap.line" }"#;
    let (outcome, heard) = run_rig(&rig_text(3.0, "go = [[1, 30, -10, 80]]", wired, &format!("{rest}\n{tap}")));
    assert!(outcome.faults.is_empty(), "{:?}", outcome.faults);
    heard
}

fn pieces(heard: &Heard) -> Vec<&LinePiece> {
    heard.traffic.iter().flat_map(|it| &it.1.pieces).collect()
}

/// Frames with their times.
fn frames<'p>(pieces: impl Iterator<Item = &'p LinePiece>) -> Vec<(Time, &'p [u8])> {
    pieces.filter(|it| it.direction == Direction::Sent).map(|it| (it.time, it.bytes.as_slice())).collect()
}

/// All bytes that came, one after the other.
fn answers<'p>(pieces: impl Iterator<Item = &'p LinePiece>) -> Vec<u8> {
    pieces.filter(|it| it.direction == Direction::Received).flat_map(|it| it.bytes.iter().copied()).collect()
}

#[test]
fn traffic_is_what_the_head_got_and_what_it_answered() {
    for settings in ["", "over = \"network\"\nnetwork.lost = 0.1", "line = { lost = 0.01, flipped = 0.01 }"] {
        let heard = tapped(settings);
        let pieces = pieces(&heard);
        let (found, expected) = (frames(pieces.iter().copied()), frames(heard.tapped.iter()));
        assert!(found.len() > 20 && found == expected, "{settings}: {found:?}, expected {expected:?}");
        let (found, expected) = (answers(pieces.iter().copied()), answers(heard.tapped.iter()));
        // The end of a packet may come after the end of the run.
        assert!(expected.starts_with(&found) && expected.len() - found.len() < 16, "{settings}: {found:?}");
        assert!(found.len() > 100, "{settings}");
        assert!(pieces.windows(2).all(|it| it[0].time <= it[1].time), "{settings}");
        let known = |it: &&LinePiece| heard.tapped.iter().any(|at| (at.time, at.direction) == (it.time, it.direction));
        assert!(pieces.iter().all(known), "{settings}: pieces have the times of writes and reads");
        assert!(heard.traffic.iter().all(|(at, it)| it.lost == 0 && it.pieces.iter().all(|it| it.time <= *at)));
    }
}

#[test]
fn a_command_and_its_answers_are_pieces_of_their_own() {
    let heard = tapped("");
    let pieces = pieces(&heard);
    let sent = heard.events.iter().find(|it| matches!(it.1, HeadEvent::Sent(_))).unwrap().0;
    let at = pieces.iter().position(|it| it.bytes == COMMAND).unwrap_or_else(|| panic!("{pieces:?}"));
    assert_eq!((pieces[at].time, pieces[at].direction), (sent, Direction::Sent));
    let mut answers = pieces[at..].iter().filter(|it| it.direction == Direction::Received);
    let mut time_of =
        |answer: &[u8]| answers.find(|it| it.bytes == answer).unwrap_or_else(|| panic!("{pieces:?}")).time;
    let (accepted, completed) = (time_of(&[0x90, 0x41, 0xFF]), time_of(&[0x90, 0x51, 0xFF]));
    // The driver reads the last of three bytes 2 ms after the first.
    let arrived = heard.events.iter().find(|it| it.1 == HeadEvent::Arrived).unwrap().0;
    assert!(accepted > sent && (1.5..3.5).contains(&(arrived - completed).as_ms()), "{accepted} {completed} {arrived}");
    let n_bytes: usize = pieces.iter().map(|it| it.bytes.len()).sum();
    assert!(heard.traffic.len() * 4 < n_bytes, "{} messages of {n_bytes} bytes", heard.traffic.len());
}
