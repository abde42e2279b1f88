//! A session that is read: opened, mended where it is unfinished, and what it holds.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::{Channel, ChunkIndex, Record, op};
use serde_json::Value;

use crate::names::{self, GraphNames};
use crate::records::{HEAD, Records, chunk_header, in_chunk};
use crate::summary::{Gathered, NoSummary, Summary};

/// Places of damage that are listed one by one.
const TOLD: usize = 5;

/// A session.
pub struct Session {
    /// The file.
    pub path: PathBuf,
    /// What it holds, and where.
    pub summary: Summary,
    /// What stands in its metadata: rig, seed, program, mode.
    pub facts: BTreeMap<String, String>,
    /// What its recorder said at the end; `None` where it did not come to that.
    pub end: Option<BTreeMap<String, String>>,
    /// By topic: messages that were wanted and left out.
    pub left_out: BTreeMap<String, u64>,
    /// What was found to be damaged or unfinished, and what was done about it.
    pub remarks: Vec<String>,
    /// What lies before the end of the recording is all there, as far as is known without reading it.
    pub is_gapless: bool,
    records: Records,
}

/// What a channel holds.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Contents {
    /// Length of its messages, unpacked [bytes].
    pub bytes: u64,
    /// When they were given out, in order [ns].
    pub times_ns: Vec<u64>,
}

impl Contents {
    /// Intervals between messages, in order of length [s].
    pub fn intervals_s(&self) -> Vec<f64> {
        let mut intervals: Vec<f64> = self.times_ns.windows(2).map(|it| (it[1] - it[0]) as f64 * 1e-9).collect();
        intervals.sort_by(f64::total_cmp);
        intervals
    }
}

/// What was found in a file without a usable summary.
struct Mended {
    summary: Summary,
    facts: BTreeMap<String, String>,
    remarks: Vec<String>,
    is_torn: bool,
}

impl Session {
    /// Opens a session. One whose recording did not end in good order gets its summary now.
    ///
    /// # Errors
    /// A sentence: no file, no MCAP, no session of ours, or one of a version that this program does not know.
    pub fn open(path: &Path) -> Result<Session, String> {
        let mut records = Records::open(path)?;
        let found = match Summary::read(&mut records) {
            Ok(summary) => {
                let facts = facts(path, &summary, &mut records, &[])?;
                Mended { summary, facts, remarks: Vec::new(), is_torn: false }
            }
            Err(_) => mend(path, &mut records)?,
        };
        let Mended { summary, facts, remarks, is_torn } = found;
        let mut session = Session {
            path: path.to_owned(),
            end: None,
            left_out: BTreeMap::new(),
            is_gapless: !is_torn,
            summary,
            facts,
            remarks,
            records,
        };
        let damaged = |what: String| format!("`{}` is damaged: {what}", path.display());
        session.end = session.summary.texts(&mut session.records, names::END).map_err(damaged)?;
        if let Some(clock) = session.summary.texts(&mut session.records, names::CLOCK).map_err(damaged)? {
            session.facts.extend(clock);
        }
        match session.read_left_out() {
            Ok(left_out) => session.left_out = left_out,
            Err(what) => session.remarks.push(format!("what was left out is not known: {what}")),
        }
        Ok(session)
    }

    /// One of the texts of [`Session::facts`]; empty where there is none.
    pub fn fact(&self, name: &str) -> &str {
        self.facts.get(name).map_or("", String::as_str)
    }

    /// A file within the session.
    ///
    /// # Errors
    /// A sentence: it is not there, or damaged.
    pub fn file(&mut self, name: &str) -> Result<Vec<u8>, String> {
        let index = self.summary.attachments.iter().find(|it| it.name == name).cloned();
        let index = index.ok_or_else(|| format!("`{}` holds no `{name}`", self.path.display()))?;
        let bytes = self.summary.attachment(&mut self.records, &index);
        bytes.map_err(|what| format!("`{name}` of `{}` is damaged: {what}", self.path.display()))
    }

    /// A text within the session.
    ///
    /// # Errors
    /// As [`Session::file`].
    pub fn text(&mut self, name: &str) -> Result<String, String> {
        String::from_utf8(self.file(name)?).map_err(|_| format!("`{name}` of `{}` is no text", self.path.display()))
    }

    /// The names of all files within the session.
    pub fn files(&self) -> Vec<String> {
        self.summary.attachments.iter().map(|it| it.name.clone()).collect()
    }

    /// The names of its instances and edges.
    ///
    /// # Errors
    /// That they cannot be read.
    pub fn graph(&mut self) -> Result<GraphNames, String> {
        let text = self.text(names::GRAPH)?;
        serde_json::from_str(&text).map_err(|error| format!("`{}` of `{}`: {error}", names::GRAPH, self.path.display()))
    }

    /// The channel of a topic.
    pub fn channel(&self, topic: &str) -> Option<&Channel> {
        self.summary.channels.values().find(|it| it.topic == topic)
    }

    /// Reads the messages of a chunk, by its place in [`Summary::chunks`]: channel, time in the log [ns], bytes.
    ///
    /// # Errors
    /// A sentence: the chunk is damaged, or `take` refused.
    pub fn messages(
        &mut self,
        chunk: usize,
        mut take: impl FnMut(u16, u64, &[u8]) -> Result<(), String>,
    ) -> Result<(), String> {
        let index = &self.summary.chunks[chunk];
        let damaged =
            |what: String| format!("`{}` is damaged at byte {}: {what}", self.path.display(), index.chunk_start_offset);
        let body = read_chunk(&mut self.records, index).map_err(damaged)?;
        in_chunk(body, |record| match record {
            Record::Message { header, data } => take(header.channel_id, header.log_time, &data),
            _ => Ok(()),
        })
        .map_err(damaged)
    }

    /// The messages of a chunk, without reading them where the file has an index of them: channel, log time [ns], length [bytes].
    ///
    /// # Errors
    /// A sentence: what is damaged, and where.
    pub fn index(&mut self, chunk: usize) -> Result<Vec<(u16, u64, u64)>, String> {
        let it = &self.summary.chunks[chunk];
        let whole = it.uncompressed_size;
        let mut found: Vec<(u64, u16, u64)> = Vec::new();
        for (channel, at) in it.message_index_offsets.clone() {
            let damaged = |what: String| format!("`{}` is damaged at byte {at}: {what}", self.path.display());
            match self.summary.record(&mut self.records, at, op::MESSAGE_INDEX).map_err(damaged)? {
                Record::MessageIndex(index) => {
                    found.extend(index.records.iter().map(|it| (it.offset, channel, it.log_time)));
                }
                _ => return Err(damaged("found another record than an index of messages".to_owned())),
            }
        }
        if found.is_empty() {
            let mut read = Vec::new();
            self.messages(chunk, |channel, log_ns, bytes| {
                read.push((channel, log_ns, bytes.len() as u64));
                Ok(())
            })?;
            return Ok(read);
        }
        found.sort_unstable();
        let ends = found.iter().skip(1).map(|it| it.0).chain([whole]).collect::<Vec<_>>();
        Ok(found
            .iter()
            .zip(ends)
            .map(|(&(start, channel, time), end)| (channel, time, end.saturating_sub(start)))
            .collect())
    }

    /// What each channel holds, and sentences about chunks that are damaged, whose messages are not counted.
    pub fn contents(&mut self) -> (BTreeMap<u16, Contents>, Vec<String>) {
        let mut contents: BTreeMap<u16, Contents> = BTreeMap::new();
        let mut damage = Vec::new();
        for chunk in 0..self.summary.chunks.len() {
            let found = self.index(chunk).map_err(|what| damage.push(what));
            for (channel, time, bytes) in found.unwrap_or_default() {
                let it = contents.entry(channel).or_default();
                it.bytes += bytes;
                it.times_ns.push(time);
            }
        }
        contents.values_mut().for_each(|it| it.times_ns.sort_unstable());
        (contents, damage)
    }

    /// The last status that the recorder wrote.
    fn read_left_out(&mut self) -> Result<BTreeMap<String, u64>, String> {
        let Some(status) = self.channel(names::STATUS).map(|it| it.id) else { return Ok(BTreeMap::new()) };
        if self.summary.counts.get(&status).is_none_or(|it| *it == 0) {
            return Ok(BTreeMap::new());
        }
        for chunk in (0..self.summary.chunks.len()).rev() {
            let offsets = &self.summary.chunks[chunk].message_index_offsets;
            if !offsets.is_empty() && !offsets.contains_key(&status) {
                continue;
            }
            let mut last = None;
            self.messages(chunk, |channel, _, bytes| {
                if channel == status {
                    last = Some(bytes.to_vec());
                }
                Ok(())
            })?;
            if let Some(bytes) = last {
                let value: Value = serde_json::from_slice(&bytes).unwrap_or_default();
                let counts = value.get("left_out").and_then(Value::as_object).into_iter().flatten();
                return Ok(counts.filter_map(|(topic, it)| Some((topic.clone(), it.as_u64()?))).collect());
            }
        }
        Ok(BTreeMap::new())
    }
}

/// The body of the chunk that is where `index` says and as it says.
fn read_chunk<'r>(records: &'r mut Records, index: &ChunkIndex) -> Result<&'r [u8], String> {
    if index.chunk_start_offset >= records.length() {
        return Err(format!("the file ends at byte {}, expected a chunk", records.length()));
    }
    records.go_to(index.chunk_start_offset)?;
    let found = records.read().map_err(|damage| damage.what)?;
    let (place, body) = found.ok_or("the file ends, expected a chunk")?;
    if place.opcode != op::CHUNK {
        return Err(format!("found a record of kind {:#04x}, expected a chunk", place.opcode));
    }
    let length = body.len() as u64 + HEAD;
    let header = chunk_header(body)?;
    let found =
        (length, header.message_start_time, header.message_end_time, header.uncompressed_size, &*header.compression);
    let it = index;
    let expected =
        (it.chunk_length, it.message_start_time, it.message_end_time, it.uncompressed_size, &*it.compression);
    if found == expected {
        Ok(body)
    } else {
        Err(format!(
            "found a chunk of {found:?}, expected {expected:?} by the summary (length, first and last time, length unpacked, compression)"
        ))
    }
}

/// What stands in the metadata of a session that this program can read.
fn facts(
    path: &Path,
    summary: &Summary,
    records: &mut Records,
    damage: &[(u64, String)],
) -> Result<BTreeMap<String, String>, String> {
    let shown = path.display();
    let damaged = |what: String| format!("`{shown}` is damaged: {what}");
    let Some(facts) = summary.texts(records, names::SESSION).map_err(damaged)? else {
        let first = damage.first().map_or_else(String::new, |(at, what)| format!(" (byte {at}: {what})"));
        return Err(format!(
            "`{shown}` is an MCAP file, but no session: it has no metadata `{}`{first}",
            names::SESSION
        ));
    };
    let fact = |name: &str| facts.get(name).map_or("", String::as_str);
    let version = fact("version");
    if version.parse::<u32>().ok().is_none_or(|it| it == 0 || it > names::VERSION) {
        return Err(format!(
            "`{shown}` is a session of version `{version}`, written by foveate {}; this program (foveate {}) reads versions to {}",
            fact("program"),
            env!("CARGO_PKG_VERSION"),
            names::VERSION
        ));
    }
    Ok(facts)
}

/// Gathers what a file without a usable summary holds, and writes the summary at its end where that loses nothing.
fn mend(path: &Path, records: &mut Records) -> Result<Mended, String> {
    let file = open_to_mend(path);
    // A recorder holds its file as long as it writes.
    let locked = file.as_ref().map_or(Ok(()), |it| it.file.try_lock());
    if matches!(locked, Err(TryLockError::WouldBlock)) {
        let recorded = "it is still being recorded: this is what it holds so far".to_owned();
        let gathered = Summary::gather(records)?;
        let facts =
            facts(path, &gathered.summary, records, &gathered.damage).map_err(|it| format!("{it}; {recorded}"))?;
        return Ok(Mended { summary: gathered.summary, facts, remarks: vec![recorded], is_torn: gathered.is_torn });
    }
    // It may have been finished meanwhile.
    *records = Records::open(path)?;
    let mut remarks = Vec::new();
    match Summary::read(records) {
        Ok(summary) => {
            let facts = facts(path, &summary, records, &[])?;
            return Ok(Mended { summary, facts, remarks, is_torn: false });
        }
        Err(NoSummary::Unfinished) => remarks.push("its recording did not end in good order".to_owned()),
        Err(NoSummary::Damaged(what)) => remarks.push(format!("its summary is damaged: {what}")),
    }
    let gathered = Summary::gather(records)?;
    // Nothing is written to a file that is no session, or one of a version that this program does not know.
    let facts = facts(path, &gathered.summary, records, &gathered.damage)?;
    remarks.extend(gathered.damage.iter().take(TOLD).map(|(at, what)| format!("byte {at}: {what}")));
    if gathered.damage.len() > TOLD {
        remarks.push(format!("{} more places are damaged", gathered.damage.len() - TOLD));
    }
    if gathered.is_torn {
        remarks.push("what lies behind that is read; the file is left as it is".to_owned());
    } else {
        remarks.push(write_summary(&gathered, file, records.length()));
        *records = Records::open(path)?;
    }
    Ok(Mended { summary: gathered.summary, facts, remarks, is_torn: gathered.is_torn })
}

/// A file that may be mended: open for writing, or else why it is not.
struct ToMend {
    file: File,
    refused: Option<std::io::Error>,
}

/// Opens a file for writing, or for reading alone where it cannot or must not be written.
fn open_to_mend(path: &Path) -> std::io::Result<ToMend> {
    // Marked so, it is left alone even by who could write it.
    let opened = match std::fs::metadata(path)?.permissions().readonly() {
        true => Err(std::io::ErrorKind::PermissionDenied.into()),
        false => OpenOptions::new().read(true).write(true).open(path),
    };
    match opened {
        Ok(file) => Ok(ToMend { file, refused: None }),
        Err(error) => File::open(path).map(|file| ToMend { file, refused: Some(error) }),
    }
}

/// Writes the summary at the end of the data, and says so.
fn write_summary(gathered: &Gathered, file: std::io::Result<ToMend>, length: u64) -> String {
    let written = file.and_then(|ToMend { mut file, refused }| {
        refused.map_or(Ok(()), Err)?;
        file.set_len(gathered.end)?;
        file.seek(SeekFrom::Start(gathered.end))?;
        gathered.summary.write(gathered.end, &mut file)?;
        file.sync_all()
    });
    match written {
        Ok(()) => {
            let rest = length.saturating_sub(gathered.end);
            format!("its summary was written; the last {rest} bytes were no whole record")
        }
        Err(error) => format!("its summary could not be written: {error}"),
    }
}
