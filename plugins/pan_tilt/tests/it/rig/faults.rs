//! A head that is unplugged, silent or garbled: shown, tried again, and the rig goes on.

use foveate::prelude::*;
use foveate_embed::engine::Outcome;

use super::parts::{Heard, WIRED, rig_text, run_rig, simulated};

/// Runs with a command before, one during and none after a fault from 2 s to 4 s.
#[track_caller]
fn with_fault(settings: &str) -> (Outcome, Heard) {
    let text = rig_text(9.0, "go = [[1, 20, 5, 80], [3, -30, -5, 80]]", WIRED, &simulated(settings));
    run_rig(&text)
}

#[track_caller]
fn check(settings: &str, said: &[&str]) {
    let (outcome, heard) = with_fault(settings);
    assert!(outcome.faults.is_empty(), "{:?}", outcome.faults);
    let reasons: Vec<&str> = outcome.gaps.iter().map(|it| it.reason.as_str()).collect();
    for said in said {
        assert!(reasons.iter().any(|it| it.contains("wide-3") && it.contains(said)), "{said}: {reasons:?}");
    }
    let links: Vec<(f64, HeadLink)> = heard
        .events
        .iter()
        .filter_map(|it| match it.1 {
            HeadEvent::Link(link) => Some((it.0.as_s(), link)),
            _ => None,
        })
        .collect();
    assert_eq!(links.first().map(|it| it.1), Some(HeadLink::Ready));
    assert_eq!(links.last().map(|it| it.1), Some(HeadLink::Ready), "{links:?}");
    let away = links.iter().find(|it| it.1 == HeadLink::Away).unwrap().0;
    assert!((2.0..4.6).contains(&away), "{links:?}");
    let figures = &outcome.report.figures;
    assert!(figures["heads.wide-3.lost"] >= 1.0 && figures["heads.wide-3.away_s"] > 0.5, "{figures:?}");
    // In the end it stands where it was told during the fault.
    let stands = heard.motion.unwrap().angles_at(Time::from_s(8.9)).map(f64::to_degrees);
    assert!((stands[0] + 30.0).abs() < 0.2 && (stands[1] + 5.0).abs() < 0.2, "{stands:?}");
}

#[test]
fn a_head_that_is_unplugged_and_back() {
    check("unplugged_s = [2, 4]", &["no answer"]);
    // Over IP each message is sent three times before it counts as unanswered.
    check("unplugged_s = [2, 5]\nover = \"network\"", &["no answer"]);
}

#[test]
fn a_head_that_says_nothing_for_a_while() {
    check("silent_s = [2, 4]", &["no answer"]);
}

#[test]
fn a_line_that_turns_bits_over() {
    check("garbage_s = [2, 4]\ngarbage = 0.9", &["is away"]);
}

#[test]
fn a_head_that_is_never_there_is_said_to_be_so() {
    let text = rig_text(3.0, "go = [[1, 20, 5, 80]]", WIRED, &simulated("unplugged_s = [0, 100]"));
    let (outcome, heard) = run_rig(&text);
    assert!(outcome.faults.is_empty());
    assert_eq!(outcome.report.figures["heads.wide-3.away_s"].round(), 3.0);
    assert!(outcome.report.remarks.iter().any(|it| it.contains("wide-3") && it.contains("no answer")));
    assert!(heard.events.is_empty() && !outcome.gaps.is_empty());
}

#[test]
fn commands_that_no_head_can_do_fail_with_what_was_found() {
    let text = rig_text(2.0, "go = [[1, 999, 5, 80]]", WIRED, &simulated(""));
    let (outcome, _) = run_rig(&text);
    assert!(format!("{:?}", outcome.faults).contains("expected finite numbers"), "{:?}", outcome.faults);
}
