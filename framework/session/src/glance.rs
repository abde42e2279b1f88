//! A session as it was at any moment: the newest message of each output, forwards and backwards.

use std::collections::{BTreeMap, VecDeque};
use std::path::Path;

use foveate_engine::EdgeView;
use foveate_messages::Time;
use foveate_node::io::Packet;
use foveate_node::port::MessageType;
use foveate_rig::graph::Graph;

use crate::names::topic;
use crate::player::compatible;
use crate::session::Session;
use crate::viewer::Schema;
use crate::{body, picture};

/// Chunks that are kept unpacked, at most, and their bytes: what is looked at lies close together.
const MOST_CHUNKS: usize = 64;
const MOST_BYTES: usize = 256 << 20;

/// Messages of one channel in one chunk, by their time in the log [ns].
type Lane = Vec<(u64, Vec<u8>)>;

/// Looks into a session.
pub struct Glance {
    session: Session,
    /// By instance and output port.
    outputs: BTreeMap<(usize, usize), Output>,
    /// By chunk, the least recently used first.
    unpacked: VecDeque<(usize, BTreeMap<u16, Lane>, usize)>,
    /// Chunks that could not be read.
    damaged: Vec<usize>,
    /// What is shown of outputs that this session has not.
    base: Option<Box<Glance>>,
}

struct Output {
    channel: u16,
    message: MessageType,
    /// Of pictures: the schema that they are written in.
    schema: Option<String>,
}

impl Glance {
    /// Looks into `session`, whose rig is `graph`. Sentences about outputs whose messages this program cannot read.
    pub fn new(session: Session, graph: &Graph) -> (Glance, Vec<String>) {
        let (mut outputs, mut remarks) = (BTreeMap::new(), Vec::new());
        for (index, instance) in graph.instances.iter().enumerate() {
            for (port, output) in instance.node_type.ports.outputs.iter().enumerate() {
                let Some(channel) = session.channel(&topic(&instance.path, output.name)) else { continue };
                if let Err(what) = compatible(&session, channel, &output.message) {
                    remarks.push(what);
                    continue;
                }
                let is_picture = channel.message_encoding == Schema::ENCODING;
                let schema = session.summary.schemas.get(&channel.schema_id).filter(|_| is_picture);
                let schema = schema.map(|it| it.0.name.clone());
                outputs.insert((index, port), Output { channel: channel.id, message: output.message, schema });
            }
        }
        (Glance { session, outputs, unpacked: VecDeque::new(), damaged: Vec::new(), base: None }, remarks)
    }

    /// Shows what `base` has of the outputs that this session has not: a part of it that was made again.
    pub fn over(self, base: Glance) -> Glance {
        Glance { base: Some(Box::new(base)), ..self }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.session.path
    }

    /// Looks into the same files once more, from another thread.
    ///
    /// # Errors
    /// A sentence: a file is gone.
    pub fn again(&self, graph: &Graph) -> Result<Glance, String> {
        let again = Glance::new(Session::open(&self.session.path)?, graph).0;
        match &self.base {
            Some(base) => Ok(again.over(base.again(graph)?)),
            None => Ok(again),
        }
    }

    /// Every message of an output, in the order of time; those that cannot be read are passed over.
    pub fn each(&mut self, output: (usize, usize), take: &mut dyn FnMut(&Packet)) {
        let Some(Output { channel, .. }) = self.outputs.get(&output) else {
            return self.base.iter_mut().for_each(|it| it.each(output, take));
        };
        let channel = *channel;
        let mut found = Vec::new();
        for chunk in 0..self.session.summary.chunks.len() {
            let offsets = &self.session.summary.chunks[chunk].message_index_offsets;
            if !offsets.is_empty() && !offsets.contains_key(&channel) {
                continue;
            }
            let lane = self.lane(chunk, channel).to_vec();
            found.extend(lane.iter().filter_map(|it| Some((it.0, self.decode(output, &it.1)?))));
        }
        found.sort_by_key(|it| it.0);
        found.iter().for_each(|it| take(&it.1));
    }

    fn decode(&self, output: (usize, usize), bytes: &[u8]) -> Option<Packet> {
        let Output { message, schema, .. } = self.outputs.get(&output)?;
        match schema {
            Some(schema) => picture::decode(schema, bytes),
            None => body::decode(message, bytes),
        }
        .ok()
    }

    /// Session time of the first and the last message.
    pub fn span(&self) -> [Time; 2] {
        if let Some(base) = &self.base {
            return base.span();
        }
        self.session.summary.times().map(|it| Time(i64::try_from(it).unwrap_or(i64::MAX)))
    }

    /// The newest message of an output that was given out by `at`; `None`: there was none yet, or it cannot be read.
    pub fn newest(&mut self, output: (usize, usize), at: Time) -> Option<Packet> {
        let Some(Output { channel, .. }) = self.outputs.get(&output) else {
            return self.base.as_mut()?.newest(output, at);
        };
        let channel = *channel;
        let at = u64::try_from(at.0).ok()?;
        let has = |it: &mcap::records::ChunkIndex| {
            it.message_start_time <= at
                && (it.message_index_offsets.is_empty() || it.message_index_offsets.contains_key(&channel))
        };
        let mut found: Option<(u64, Vec<u8>)> = None;
        // Chunks overlap a little, since threads write at their own pace.
        for chunk in (0..self.session.summary.chunks.len()).rev() {
            let index = &self.session.summary.chunks[chunk];
            if !has(index) {
                continue;
            }
            if found.as_ref().is_some_and(|it| index.message_end_time < it.0) {
                break;
            }
            let lane = self.lane(chunk, channel);
            let place = lane.partition_point(|it| it.0 <= at);
            if let Some(it) = place.checked_sub(1).map(|it| &lane[it])
                && found.as_ref().is_none_or(|found| it.0 > found.0)
            {
                found = Some(it.clone());
            }
        }
        self.decode(output, &found?.1)
    }

    /// When the next picture was given out after `at`, or the last one before it; of all messages where there are no pictures.
    pub fn neighbour(&mut self, at: Time, is_forward: bool) -> Option<Time> {
        if let Some(base) = &mut self.base {
            return base.neighbour(at, is_forward);
        }
        let at = u64::try_from(at.0).unwrap_or(0);
        let pictures: Vec<u16> = self.outputs.values().filter(|it| it.schema.is_some()).map(|it| it.channel).collect();
        let n = self.session.summary.chunks.len();
        let mut best: Option<u64> = None;
        let order: Box<dyn Iterator<Item = usize>> = if is_forward { Box::new(0..n) } else { Box::new((0..n).rev()) };
        for chunk in order {
            let it = &self.session.summary.chunks[chunk];
            let is_beyond = if is_forward { it.message_end_time <= at } else { it.message_start_time >= at };
            let is_farther = best.is_some_and(|best| match is_forward {
                true => it.message_start_time > best,
                false => it.message_end_time < best,
            });
            if is_beyond || is_farther {
                continue;
            }
            let times = self.session.index(chunk).unwrap_or_default().into_iter();
            let times = times.filter(|it| pictures.is_empty() || pictures.contains(&it.0)).map(|it| it.1);
            let nearest =
                if is_forward { times.filter(|it| *it > at).min() } else { times.filter(|it| *it < at).max() };
            best = match (best, nearest) {
                (Some(a), Some(b)) => Some(if is_forward { a.min(b) } else { a.max(b) }),
                (a, b) => a.or(b),
            };
        }
        best.map(|it| Time(i64::try_from(it).unwrap_or(i64::MAX)))
    }

    /// What the recording says of each edge as a whole: messages, and how many a second.
    pub fn edges(&self, graph: &Graph) -> Vec<EdgeView> {
        if let Some(base) = &self.base {
            return base.edges(graph);
        }
        let [first, last] = self.span();
        let span_s = (last - first).as_s();
        let edge = |from: &(usize, usize)| {
            let channel = self.outputs.get(from).map(|it| it.channel);
            let count = channel.and_then(|it| self.session.summary.counts.get(&it).copied()).unwrap_or(0);
            let rate_hz = (count > 1 && span_s > 0.0).then(|| (count - 1) as f64 / span_s);
            EdgeView { delivered: count, rate_hz, ..EdgeView::default() }
        };
        graph.edges.iter().map(|it| edge(&it.from)).collect()
    }

    /// The messages of a channel in a chunk.
    fn lane(&mut self, chunk: usize, channel: u16) -> &[(u64, Vec<u8>)] {
        if let Some(place) = self.unpacked.iter().position(|it| it.0 == chunk) {
            if let Some(it) = self.unpacked.remove(place) {
                self.unpacked.push_back(it);
            }
        } else if !self.damaged.contains(&chunk) {
            self.unpack(chunk);
        }
        let newest = self.unpacked.back().filter(|it| it.0 == chunk);
        newest.and_then(|it| it.1.get(&channel)).map_or(&[], Vec::as_slice)
    }

    fn unpack(&mut self, chunk: usize) {
        let known: Vec<u16> = self.outputs.values().map(|it| it.channel).collect();
        let (mut lanes, mut n_bytes) = (BTreeMap::<u16, Lane>::new(), 0);
        let read = self.session.messages(chunk, |channel, log_ns, bytes| {
            if known.contains(&channel) {
                n_bytes += bytes.len();
                lanes.entry(channel).or_default().push((log_ns, bytes.to_vec()));
            }
            Ok(())
        });
        if read.is_err() {
            self.damaged.push(chunk);
            return;
        }
        lanes.values_mut().for_each(|it| it.sort_by_key(|it| it.0));
        self.unpacked.push_back((chunk, lanes, n_bytes));
        let bytes = |it: &VecDeque<(usize, BTreeMap<u16, Lane>, usize)>| it.iter().map(|it| it.2).sum::<usize>();
        while self.unpacked.len() > MOST_CHUNKS || (self.unpacked.len() > 1 && bytes(&self.unpacked) > MOST_BYTES) {
            self.unpacked.pop_front();
        }
    }
}
