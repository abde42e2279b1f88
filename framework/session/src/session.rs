//! A session that is read: opened, mended where it is unfinished, and what it holds.

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Seek, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::{Channel, Record};
use serde_json::Value;

use crate::names::{self, GraphNames};
use crate::records::{Records, in_chunk, parse};
use crate::summary::Summary;

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
    records: Records,
}

impl Session {
    /// Opens a session. One whose recording did not end in good order gets its summary now.
    ///
    /// # Errors
    /// A sentence: no file, no MCAP, no session of ours, or one of a version that this program does not know.
    pub fn open(path: &Path) -> Result<Session, String> {
        let mut records = Records::open(path)?;
        let mut remarks = Vec::new();
        let summary = match Summary::read(&mut records) {
            Some(summary) => summary,
            None => mend(path, &mut records, &mut remarks)?,
        };
        let mut session = Session {
            path: path.to_owned(),
            facts: BTreeMap::new(),
            end: None,
            left_out: BTreeMap::new(),
            remarks,
            records,
            summary,
        };
        session.facts = session.summary.texts(&mut session.records, names::SESSION)?.ok_or_else(|| {
            format!("`{}` is an MCAP file, but no session: it has no metadata `{}`", path.display(), names::SESSION)
        })?;
        let version = session.fact("version");
        if version.parse::<u32>().ok().is_none_or(|it| it == 0 || it > names::VERSION) {
            return Err(format!(
                "`{}` is a session of version `{version}`, written by foveate {}; this program (foveate {}) reads versions to {}",
                path.display(),
                session.fact("program"),
                env!("CARGO_PKG_VERSION"),
                names::VERSION
            ));
        }
        session.end = session.summary.texts(&mut session.records, names::END)?;
        session.left_out = session.read_left_out()?;
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
        self.summary.attachment(&mut self.records, &index)
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
        let at = self.summary.chunks[chunk].chunk_start_offset;
        let damaged = |path: &Path, what: String| format!("`{}` is damaged at byte {at}: {what}", path.display());
        if at >= self.records.length() {
            return Err(damaged(&self.path, "the summary names a place beyond the end".to_owned()));
        }
        self.records.go_to(at)?;
        let record = self.records.next(|_| true).map_err(|it| damaged(&self.path, it.what))?;
        let Some((place, body)) = record else { return Err(damaged(&self.path, "no chunk is there".to_owned())) };
        let parsed = parse(place.opcode, body).map_err(|what| damaged(&self.path, what))?;
        let Record::Chunk { header, data } = parsed else {
            return Err(damaged(&self.path, "another record than a chunk is there".to_owned()));
        };
        in_chunk(header, &data, |record| match record {
            Record::Message { header, data } => take(header.channel_id, header.log_time, &data),
            _ => Ok(()),
        })
        .map_err(|what| damaged(&self.path, what))
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

/// Gathers what a file without a usable summary holds, and writes the summary at its end where that loses nothing.
fn mend(path: &Path, records: &mut Records, remarks: &mut Vec<String>) -> Result<Summary, String> {
    let shown = path.display();
    // A recorder holds its file as long as it writes.
    let file = OpenOptions::new().read(true).write(true).open(path);
    let locked = file.as_ref().map_or(Ok(()), File::try_lock);
    if matches!(locked, Err(TryLockError::WouldBlock)) {
        let gathered = Summary::gather(records)?;
        remarks.push("it is still being recorded: this is what it holds so far".to_owned());
        return Ok(gathered.summary);
    }
    // It may have been finished meanwhile.
    let mut again = Records::open(path)?;
    if let Some(summary) = Summary::read(&mut again) {
        *records = again;
        return Ok(summary);
    }
    let gathered = Summary::gather(&mut again)?;
    let rest = again.length().saturating_sub(gathered.end);
    remarks.push("its recording did not end in good order".to_owned());
    for (at, what) in gathered.damage.iter().take(5) {
        remarks.push(format!("byte {at}: {what}"));
    }
    if gathered.is_torn {
        remarks.push("what lies behind that is read; the file is left as it is".to_owned());
    } else {
        let written = file.and_then(|mut file| {
            file.set_len(gathered.end)?;
            file.seek(SeekFrom::Start(gathered.end))?;
            gathered.summary.write(gathered.end, &mut file)?;
            file.sync_all()
        });
        match written {
            Ok(()) => remarks.push(format!("its summary was written; the last {rest} bytes were no whole record")),
            Err(error) => remarks.push(format!("its summary could not be written to `{shown}`: {error}")),
        }
    }
    *records = Records::open(path)?;
    Ok(gathered.summary)
}
