//! `foveate info`: what is in a session.

use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

use foveate_session::Session;
use foveate_session::names::{FILES, ORDER, RIG, STATUS};

use super::complain;
use super::layout::layout;
use crate::exit;
use crate::output::say;
use crate::results::write_whole;

pub(super) fn run(path: &Path, layout: Option<&Path>, whole: bool) -> u8 {
    let mut n_damaged = 0;
    let describe = |mut session: Session| {
        let mut text = describe(&mut session)?;
        for chunk in 0..if whole { session.summary.chunks.len() } else { 0 } {
            if let Err(what) = session.messages(chunk, |_, _, _| Ok(())) {
                n_damaged += 1;
                text += &format!("note: {what}; `foveate cut` keeps the rest\n");
            }
        }
        if let Some(path) = layout {
            write_layout(&mut session, path)?;
        }
        Ok(text)
    };
    match Session::open(path).and_then(describe) {
        Ok(text) => {
            say(&text);
            if n_damaged == 0 { exit::DONE } else { exit::INPUT }
        }
        Err(sentence) => complain(&sentence),
    }
}

fn describe(session: &mut Session) -> Result<String, String> {
    let (contents, damage) = session.contents();
    let mut text = String::new();
    let mut line = |it: String| {
        text += &it;
        text.push('\n');
    };
    let bytes = std::fs::metadata(&session.path).map_err(|error| error.to_string())?.len();
    let [first, last] = session.summary.times();
    let seconds = last.saturating_sub(first) as f64 * 1e-9;
    line(format!(
        "{}: rig `{}`, seed {}, {} run, {seconds:.2} s, {} in {} chunks, by foveate {}",
        session.path.display(),
        session.fact("rig"),
        session.fact("seed"),
        session.fact("mode"),
        size(bytes),
        session.summary.chunks.len(),
        session.fact("program"),
    ));
    session.remarks.iter().chain(&damage).for_each(|it| line(format!("note: {it}")));
    if !session.fact("cut").is_empty() {
        line(format!("a part, {}", session.fact("cut")));
    }
    if !session.fact("merged").is_empty() {
        line(format!("of several sessions: {}", session.fact("merged")));
    }
    match &session.end {
        None if !session.fact("merged").is_empty() => {}
        None if !session.fact("cut").is_empty() => {}
        None => line("it ends without the last words of its recorder".to_owned()),
        Some(end) => {
            for (_, value) in end.iter().filter(|it| it.0.starts_with("remark_")) {
                line(format!("note: {value}"));
            }
        }
    }
    line(format!(
        "\n{:<48} {:>9} {:>9} {:>9} {:>9} {:>9}  kind",
        "topic", "messages", "rate Hz", "pause s", "size MB", "left out"
    ));
    let mut of_kinds: BTreeMap<String, u64> = BTreeMap::new();
    let mut channels: Vec<_> = session.summary.channels.values().collect();
    channels.sort_by(|a, b| a.topic.cmp(&b.topic));
    for channel in channels.into_iter().filter(|it| it.topic != STATUS) {
        let count = session.summary.counts.get(&channel.id).copied().unwrap_or(0);
        let rate = count as f64 / seconds.max(1e-9);
        let its = contents.get(&channel.id);
        let pause = its.and_then(|it| it.intervals_s().last().copied());
        let pause = pause.map_or_else(String::new, |it| format!("{it:.3}"));
        let bytes = its.map_or(0, |it| it.bytes);
        let left_out = session.left_out.get(&channel.topic).copied().unwrap_or(0);
        let kind = match channel.topic.as_str() {
            ORDER => "order of delivery, in batches",
            _ => channel.metadata.get("message").map_or("for viewers", String::as_str),
        };
        *of_kinds.entry(kind.to_owned()).or_default() += bytes;
        let left_out = if left_out == 0 { String::new() } else { left_out.to_string() };
        line(format!(
            "{:<48} {count:>9} {rate:>9.1} {pause:>9} {:>9.2} {left_out:>9}  {kind}",
            channel.topic,
            bytes as f64 * 1e-6
        ));
    }
    line("\npause: the longest time without a message; size: before it is compressed, by kind:".to_owned());
    let mut of_kinds: Vec<_> = of_kinds.into_iter().collect();
    of_kinds.sort_by_key(|it| std::cmp::Reverse(it.1));
    line(of_kinds.iter().map(|(kind, bytes)| format!("{kind} {}", size(*bytes))).collect::<Vec<_>>().join(" · "));
    let files: Vec<&str> =
        session.summary.attachments.iter().map(|it| it.name.strip_prefix(FILES).unwrap_or(&it.name)).collect();
    line(format!("\nfiles: {}", files.join("  ")));
    Ok(text)
}

fn write_layout(session: &mut Session, path: &Path) -> Result<(), String> {
    let rig: toml::Table =
        session.text(RIG)?.parse().map_err(|error| format!("the rig of the session is no TOML: {error}"))?;
    let scales = rig.get("scale").and_then(toml::Value::as_table);
    // The outermost scale has no parent.
    let outer = scales.and_then(|it| it.iter().find(|it| it.1.get("parent").is_none()));
    let edges = session.graph()?.edges;
    let layout = layout(session, outer.map_or("room", |it| it.0), &edges);
    write_whole(path, layout.as_bytes())
}

/// A size for people.
pub(super) fn size(bytes: u64) -> String {
    let mut text = String::new();
    let _ = match bytes {
        0..10_000 => write!(text, "{bytes} bytes"),
        10_000..10_000_000 => write!(text, "{:.0} kB", bytes as f64 / 1e3),
        10_000_000..10_000_000_000 => write!(text, "{:.0} MB", bytes as f64 / 1e6),
        _ => write!(text, "{:.1} GB", bytes as f64 / 1e9),
    };
    text
}
