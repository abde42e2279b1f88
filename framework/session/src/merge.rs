//! The sessions of several machines as one, on the clock of the one that began first.
//!
//! A session says when its time 0 was by the clock on the wall of its machine, so that machines with a common clock (PTP, NTP, a GPS receiver) need nothing else.
//! All times in the messages of the others move. There is no common order of delivery: a merged session is a source for other rigs, and for replays that begin at a node.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;

use foveate_messages::Interval;
use serde_json::{Value, json};

use crate::file::{Channel, Packing, SessionFile};
use crate::session::Session;
use crate::viewer::Schema;
use crate::{names, shift, viewer};

/// A session and its place in the merged one.
pub struct Part {
    /// The session.
    pub session: Session,
    /// When its time 0 is after that of the earliest [s]; left out: by its clock on the wall.
    pub offset_s: Option<f64>,
}

/// What was merged.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Merged {
    /// By part: when its time 0 is, on the clock of the merged session [s].
    pub offsets_s: Vec<f64>,
    /// Messages.
    pub messages: u64,
    /// Topics that several parts have, and the names that they got: before, now.
    pub renamed: Vec<(String, String)>,
}

/// A channel of a part: where it goes, and what moves the times of its messages.
struct Way {
    channel: Channel,
    clock: Clock,
}

enum Clock {
    /// A message of ours, by its JSON Schema.
    Message(Value),
    /// What viewers read, by the name of its schema.
    Viewer(String),
}

/// A part that is being read.
struct Reading<'p> {
    session: &'p mut Session,
    by: Interval,
    ways: BTreeMap<u16, Way>,
    chunk: usize,
    messages: VecDeque<(u64, u16, Vec<u8>)>,
}

/// Merges sessions into the file `path`, which must not be there yet.
///
/// # Errors
/// A sentence: a part without a known clock, one that cannot be read, a file that cannot be written.
pub fn merge(parts: &mut [Part], path: &Path) -> Result<Merged, String> {
    for (place, part) in parts.iter().enumerate() {
        if parts[..place].iter().any(|it| it.session.path == part.session.path) {
            return Err(format!("`{}` is named twice", part.session.path.display()));
        }
    }
    let offsets = offsets(parts)?;
    let file = SessionFile::create(path, Packing::Lz4)?;
    let merged = merge_into(file, parts, offsets);
    if merged.is_err() {
        drop(std::fs::remove_file(path)); // what cannot be removed stays
    }
    merged.map_err(|what| format!("`{}` cannot be written: {what}", path.display()))
}

fn merge_into(mut file: SessionFile, parts: &mut [Part], offsets: Vec<Interval>) -> Result<Merged, String> {
    let names = names_of(parts);
    begin(&mut file, parts, &names, &offsets)?;
    let mut merged = Merged { offsets_s: offsets.iter().map(|it| it.as_s()).collect(), ..Merged::default() };
    let mut channels: BTreeMap<(String, u16, usize), Channel> = BTreeMap::new();
    let mut taken: BTreeSet<String> = BTreeSet::new();
    let mut readings = Vec::new();
    for (place, (part, by)) in parts.iter_mut().zip(offsets).enumerate() {
        let session = &mut part.session;
        let own: Vec<_> = session.summary.channels.values().cloned().collect();
        let clashing: BTreeSet<&str> =
            own.iter().filter(|it| is_ours(it) && taken.contains(&it.topic)).map(|it| it.topic.as_str()).collect();
        let mut ways = BTreeMap::new();
        for it in &own {
            if [names::ORDER, names::STATUS].contains(&it.topic.as_str()) {
                continue;
            }
            // What is drawn of a topic follows it.
            let of = it.topic.rsplit_once('/').map_or("", |parts| parts.0);
            let topic = match clashing.contains(it.topic.as_str()) || clashing.contains(of) {
                true => format!("/{}{}", names[place], it.topic),
                false => it.topic.clone(),
            };
            let schema = session.summary.schemas.get(&it.schema_id);
            let (name, bytes) = schema.map_or(("", &[][..]), |it| (it.0.name.as_str(), it.1.as_slice()));
            let clock = match it.message_encoding == Schema::ENCODING {
                true => Clock::Viewer(name.to_owned()),
                false => Clock::Message(serde_json::from_slice(bytes).unwrap_or_default()),
            };
            if clashing.contains(it.topic.as_str()) {
                merged.renamed.push((it.topic.clone(), topic.clone()));
            }
            // Frames, lenses and lines of the log of all parts stand together.
            let key = (topic.clone(), 0, if is_ours(it) { place + 1 } else { 0 });
            let channel = match channels.get(&key) {
                Some(channel) => *channel,
                None => {
                    let schema = schema.map(|it| (it.0.name.as_str(), it.0.encoding.as_str(), it.1.as_slice()));
                    let channel = file.channel(&topic, &it.message_encoding, schema, &it.metadata)?;
                    channels.insert(key, channel);
                    channel
                }
            };
            ways.insert(it.id, Way { channel, clock });
        }
        taken.extend(own.iter().map(|it| it.topic.clone()));
        readings.push(Reading { session, by, ways, chunk: 0, messages: VecDeque::new() });
    }
    merged.messages = write(&mut file, &mut readings)?;
    let left_out: BTreeMap<&String, &u64> = readings.iter().flat_map(|it| &it.session.left_out).collect();
    if !left_out.is_empty() {
        let status = file.channel(names::STATUS, "json", None, &BTreeMap::new())?;
        file.message(status, 0, 0, json!({ "left_out": left_out }).to_string().as_bytes())?;
    }
    file.finish()?;
    Ok(merged)
}

/// Whether the messages of a channel are those of a node.
fn is_ours(channel: &mcap::records::Channel) -> bool {
    channel.metadata.contains_key("instance")
}

/// When the time 0 of each part is, after that of the earliest.
fn offsets(parts: &[Part]) -> Result<Vec<Interval>, String> {
    let zero = |it: &Part| -> Option<i128> {
        let fact = ["zero_unix_ns", "began_unix_ns"].iter().find_map(|name| it.session.facts.get(*name));
        fact?.parse().ok().filter(|it| *it > 0)
    };
    let known = parts.iter().filter(|it| it.offset_s.is_none()).filter_map(zero).min();
    let mut offsets = Vec::new();
    for part in parts {
        offsets.push(match (part.offset_s, zero(part), known) {
            (Some(offset_s), _, _) => Interval::from_s(offset_s),
            (None, Some(zero), Some(first)) => Interval(i64::try_from(zero - first).unwrap_or(i64::MAX)),
            (None, ..) => {
                return Err(format!(
                    "`{}` is of a run on a logical clock and does not say when it began, expected its offset in seconds",
                    part.session.path.display()
                ));
            }
        });
    }
    let first = offsets.iter().copied().min().unwrap_or_default();
    Ok(offsets.into_iter().map(|it| Interval(it.0.saturating_sub(first.0))).collect())
}

/// What each part is called in topics: as its file, with a number where two have the same name.
fn names_of(parts: &[Part]) -> Vec<String> {
    let mut names: Vec<String> = Vec::new();
    for part in parts {
        let stem =
            part.session.path.file_stem().map_or_else(|| "part".to_owned(), |it| it.to_string_lossy().into_owned());
        let name =
            (1..).map(|n| if n == 1 { stem.clone() } else { format!("{stem}-{n}") }).find(|it| !names.contains(it));
        names.extend(name);
    }
    names
}

/// What stands at the beginning of the file: facts and files of the first part, and the files of the others below its name.
fn begin(file: &mut SessionFile, parts: &mut [Part], names: &[String], offsets: &[Interval]) -> Result<(), String> {
    let mut facts = parts.first().map(|it| it.session.facts.clone()).unwrap_or_default();
    let earliest = parts.iter().zip(offsets).find(|it| it.1.0 == 0).map(|it| &it.0.session);
    for key in ["began_unix_ns", "zero_unix_ns"] {
        let value = earliest.and_then(|it| it.facts.get(key)).cloned();
        value.into_iter().for_each(|it| drop(facts.insert(key.to_owned(), it)));
    }
    let shown: Vec<String> = names.iter().zip(offsets).map(|(name, by)| format!("{name} at {} s", by.as_s())).collect();
    facts.insert("merged".to_owned(), shown.join(", "));
    facts.insert("mode".to_owned(), "merged".to_owned());
    file.metadata(names::SESSION, facts)?;
    for (place, part) in parts.iter_mut().enumerate() {
        for index in part.session.summary.attachments.clone() {
            let bytes = part.session.file(&index.name)?;
            let name = if place == 0 { index.name.clone() } else { format!("merged/{}/{}", names[place], index.name) };
            file.attach(&name, &index.media_type, &bytes)?;
        }
    }
    Ok(())
}

/// Writes the messages of all parts in the order of time, as each part has them; gives their number.
fn write(file: &mut SessionFile, readings: &mut [Reading<'_>]) -> Result<u64, String> {
    let (mut count, mut moved) = (0, Vec::new());
    loop {
        let mut first: Option<(u64, usize)> = None;
        for (place, reading) in readings.iter_mut().enumerate() {
            let next = reading.next()?.map(|time| (time, place));
            first = [first, next].into_iter().flatten().min();
        }
        let Some((now, place)) = first else { return Ok(count) };
        let reading = &mut readings[place];
        let Some((_, channel, bytes)) = reading.messages.pop_front() else { continue };
        let Some(way) = reading.ways.get(&channel) else { continue };
        match &way.clock {
            Clock::Message(schema) => moved = shift::message(schema, &bytes, reading.by)?,
            Clock::Viewer(schema) => viewer::shifted(schema, &bytes, reading.by, &mut moved)?,
        }
        let now = i64::try_from(now).unwrap_or(i64::MAX);
        file.message(way.channel, now, now, &moved)?;
        count += 1;
    }
}

impl Reading<'_> {
    /// When the next message is, on the clock of the merged session [ns].
    fn next(&mut self) -> Result<Option<u64>, String> {
        while self.messages.is_empty() && self.chunk < self.session.summary.chunks.len() {
            let (messages, ways) = (&mut self.messages, &self.ways);
            self.session.messages(self.chunk, |channel, log_ns, bytes| {
                if ways.contains_key(&channel) {
                    messages.push_back((log_ns, channel, bytes.to_vec()));
                }
                Ok(())
            })?;
            self.chunk += 1;
        }
        Ok(self.messages.front().map(|it| it.0.saturating_add(self.by.0.unsigned_abs())))
    }
}
