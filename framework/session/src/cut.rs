//! A part of a session: a time, some cameras, some kinds.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use foveate_engine::tap::Entry;
use foveate_scene::selection::matches;
use mcap::records::Channel as ChannelRecord;
use serde_json::json;

use crate::file::{Channel, Packing, SessionFile};
use crate::session::Session;
use crate::{names, order, picture};

/// What is kept.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Cut {
    /// From this session time on [s].
    pub start_s: Option<f64>,
    /// Up to this session time [s].
    pub end_s: Option<f64>,
    /// Cameras by name or pattern; empty: all, and what no camera has is always kept.
    pub cameras: Vec<String>,
    /// Pictures are left away.
    pub no_pictures: bool,
    /// Topics, or patterns of topics, that are left away.
    pub without: Vec<String>,
}

/// What a cut left.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Kept {
    /// Messages that were kept.
    pub kept: u64,
    /// Messages that were left away.
    pub left_away: u64,
    /// Whether the part can be replayed in the recorded order: it begins where the session does.
    pub has_order: bool,
    /// What could not be read, and is left away.
    pub damaged: Vec<String>,
}

/// Writes a part of `session` to the file `path`, which must not be there yet.
///
/// # Errors
/// A sentence: a pattern that nothing fits, a session that cannot be read, a file that cannot be written.
pub fn cut(session: &mut Session, path: &Path, cut: &Cut) -> Result<Kept, String> {
    let ns = |it: f64| (it * 1e9).round() as u64;
    let (start, end) = (cut.start_s.map_or(0, ns), cut.end_s.map_or(u64::MAX, ns));
    if start >= end {
        return Err(format!(
            "found a part from {} s to {} s, expected it to end after it begins",
            start as f64 / 1e9,
            end as f64 / 1e9
        ));
    }
    let dropped = dropped(session, cut)?;
    let file = SessionFile::create(path, Packing::Lz4)?;
    let kept = write(session, file, cut, (start, end), &dropped);
    let kept = kept.map_err(|what| format!("`{}` cannot be written: {what}", path.display()));
    let kept = kept.and_then(|it| match it.kept {
        0 => Err(format!("`{}` holds nothing of that part", session.path.display())),
        _ => Ok(it),
    });
    if kept.is_err() {
        drop(std::fs::remove_file(path)); // what cannot be removed stays
    }
    kept
}

fn write(
    session: &mut Session,
    mut file: SessionFile,
    cut: &Cut,
    (start, end): (u64, u64),
    dropped: &BTreeSet<String>,
) -> Result<Kept, String> {
    let has_order = start == 0;
    let mut facts = session.facts.clone();
    let away: BTreeSet<String> = serde_json::from_str(session.fact("left_away")).unwrap_or_default();
    facts.insert("left_away".to_owned(), json!(away.union(dropped).collect::<Vec<_>>()).to_string());
    let to = cut.end_s.map_or("the end".to_owned(), |it| format!("{it} s"));
    facts.insert("cut".to_owned(), format!("from {} s to {to}", cut.start_s.unwrap_or(0.0)));
    file.metadata(names::SESSION, facts)?;
    for index in session.summary.attachments.clone() {
        let bytes = session.file(&index.name)?;
        file.attach(&index.name, &index.media_type, &bytes)?;
    }
    let mut channels: BTreeMap<u16, Channel> = BTreeMap::new();
    for (id, channel) in session.summary.channels.clone() {
        if dropped.contains(&channel.topic) || (channel.topic == names::ORDER && !has_order) {
            continue;
        }
        let schema = session.summary.schemas.get(&channel.schema_id);
        let schema = schema.map(|it| (it.0.name.as_str(), it.0.encoding.as_str(), it.1.as_slice()));
        channels.insert(id, file.channel(&channel.topic, &channel.message_encoding, schema, &channel.metadata)?);
    }
    let mut kept = Kept { has_order, ..Kept::default() };
    let order_channel = session.channel(names::ORDER).map(|it| it.id).filter(|_| has_order);
    // Events are written in batches: the last one that matters may begin before the end and reach beyond it.
    let mut is_past = false;
    for chunk in 0..session.summary.chunks.len() {
        let index = &session.summary.chunks[chunk];
        let is_beyond = index.message_start_time > end && (is_past || order_channel.is_none());
        if index.message_end_time < start || is_beyond {
            continue;
        }
        // All of a chunk or nothing of it.
        let mut messages = Vec::new();
        let read = session.messages(chunk, |channel, log_ns, bytes| {
            messages.push((channel, log_ns, bytes.to_vec()));
            Ok(())
        });
        if let Err(what) = read {
            kept.damaged.push(what);
            continue;
        }
        for (channel, log_ns, bytes) in messages {
            let written = channels.get(&channel);
            if order_channel == Some(channel)
                && let Some(written) = written
            {
                let (mut encoder, mut batch) = (order::Encoder::default(), Vec::new());
                let within = |it: &Entry| u64::try_from(it.now.0).unwrap_or(0) <= end;
                order::decode(&bytes)?.iter().filter(|it| within(it)).for_each(|it| encoder.add(it, &mut batch));
                is_past = batch.is_empty();
                if !is_past {
                    kept.kept += 1;
                    let time = i64::try_from(log_ns.min(end)).unwrap_or(i64::MAX);
                    file.message(*written, time, time, &batch)?;
                }
                continue;
            }
            match written.filter(|_| (start..=end).contains(&log_ns)) {
                Some(channel) => {
                    kept.kept += 1;
                    let time = i64::try_from(log_ns).unwrap_or(i64::MAX);
                    file.message(*channel, time, time, &bytes)?;
                }
                None => kept.left_away += 1,
            }
        }
    }
    // What ends before the session does has no last words.
    if let Some(end) = session.end.as_ref().filter(|_| cut.end_s.is_none()) {
        file.metadata(names::END, end.clone())?;
    }
    file.finish()?;
    Ok(kept)
}

/// The topics that are left away, with those that viewers draw of them.
fn dropped(session: &Session, cut: &Cut) -> Result<BTreeSet<String>, String> {
    let channels: Vec<&ChannelRecord> = session.summary.channels.values().collect();
    let is_picture = |it: &ChannelRecord| {
        session.summary.schemas.get(&it.schema_id).is_some_and(|schema| picture::is_picture(&schema.0.name))
    };
    let camera = |it: &ChannelRecord| {
        let instance = it.metadata.get("instance")?;
        Some(instance.split_once('[')?.1.strip_suffix(']')?.to_owned())
    };
    let cameras: BTreeSet<String> = channels.iter().filter_map(|it| camera(it)).collect();
    if let Some(pattern) = cut.cameras.iter().find(|it| !cameras.iter().any(|name| matches(it, name))) {
        let known: Vec<&str> = cameras.iter().map(String::as_str).collect();
        return Err(format!("found no camera `{pattern}`, expected one of {}", known.join(", ")));
    }
    if let Some(pattern) = cut.without.iter().find(|it| !channels.iter().any(|channel| matches(it, &channel.topic))) {
        return Err(format!("found no topic `{pattern}`; `foveate info` lists those of the session"));
    }
    let mut dropped: BTreeSet<String> = channels
        .iter()
        .filter(|it| {
            let other = camera(it).is_some_and(|name| !cut.cameras.iter().any(|pattern| matches(pattern, &name)));
            (cut.no_pictures && is_picture(it))
                || (!cut.cameras.is_empty() && other)
                || cut.without.iter().any(|pattern| matches(pattern, &it.topic))
        })
        .map(|it| it.topic.clone())
        .collect();
    let drawn: Vec<String> = channels
        .iter()
        .filter(|it| it.topic.rsplit_once('/').is_some_and(|(of, _)| dropped.contains(of)))
        .map(|it| it.topic.clone())
        .collect();
    dropped.extend(drawn);
    dropped.remove(names::ORDER);
    Ok(dropped)
}
