//! C3D writer.

use super::{
    BLOCK, ByteOrder, C3dError, FOUR_CHARACTERS, HEADER_EVENTS, LABELS_A_PARAMETER, MAGIC, Recording, Sample, fault,
};

/// Number format of the points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Coding {
    /// 32-bit floats; residuals in steps of `residual_step`, at most 255 of them, in the recording's unit.
    Float {
        /// Step of the residuals, above 0.
        residual_step: f32,
    },
    /// 16-bit integers in steps of `step`, at most 32,767 of them either way; residuals in the same steps, at most 255.
    Integer {
        /// Step of the coordinates, above 0; `None`: the smallest that covers all coordinates.
        step: Option<f32>,
    },
}

/// The most frames that the format counts: by a 32-bit float.
pub(super) const MOST_FRAMES: usize = 1 << 24;
/// The longest label, so that 255 of them can be stepped over by a 16-bit number [bytes].
const LONGEST_LABEL: usize = 120;
/// The longest parameter section [blocks].
const MOST_BLOCKS: usize = 255;

/// Encodes `recording` as a C3D file; a point with a coordinate that is not a number is written as missing.
///
/// # Errors
/// With offset 0, what the format cannot hold: samples that are no whole number of frames, too many points, too long
/// labels, analog channels, or a step that is not above 0 or too small for a coordinate.
pub fn write(recording: &Recording, coding: Coding, order: ByteOrder) -> Result<Vec<u8>, C3dError> {
    let n_points = recording.labels.len();
    let n_frames = recording.n_frames();
    if n_points > usize::from(u16::MAX) {
        return fault(0, format_args!("{n_points} points"), "at most 65535");
    }
    if recording.samples.len() != n_points * n_frames || !recording.analog.labels.is_empty() {
        let found = format!("{} samples of {n_points} points and analog channels", recording.samples.len());
        return fault(0, found, "whole frames of points alone");
    }
    if n_frames > MOST_FRAMES {
        return fault(0, format_args!("{n_frames} frames"), "at most 16777216: they are counted by a 32-bit float");
    }
    let (scale, step) = steps(recording, coding)?;
    let room = Room { long_frames: n_frames > usize::from(u16::MAX), label_bytes: 0 };
    let head = head(recording, n_frames, scale, order, room)?;

    let size = if scale < 0.0 { 16 } else { 8 };
    let mut out = Vec::with_capacity(head.len() + (size * recording.samples.len()).next_multiple_of(BLOCK));
    out.extend_from_slice(&head);
    match (scale < 0.0, order) {
        // The common case on its own, so that it is one straight loop.
        (true, ByteOrder::Intel) => floats(&mut out, &recording.samples, step, f32::to_le_bytes),
        (true, _) => floats(&mut out, &recording.samples, step, |it| order.float_bytes(it)),
        (false, _) => integers(&mut out, &recording.samples, step, order),
    }
    // Readers that go to the end of the file where the header cannot count its frames would take what fills it up for points.
    if n_frames <= usize::from(u16::MAX) {
        out.resize(out.len().next_multiple_of(BLOCK), 0);
    }
    Ok(out)
}

/// What the head of a file has room for, so that it keeps its length while frames are added.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Room {
    /// Whether there is `POINT:LONG_FRAMES`.
    pub long_frames: bool,
    /// Each label takes so many bytes at least.
    pub label_bytes: usize,
}

/// Header and parameters of a file with `n_frames` frames, whole blocks.
pub(super) fn head(
    recording: &Recording,
    n_frames: usize,
    scale: f32,
    order: ByteOrder,
    room: Room,
) -> Result<Vec<u8>, C3dError> {
    let parameters = parameters(recording, n_frames, scale, order, room)?;
    let mut head = header(recording, n_frames, scale, 2 + parameters.len() / BLOCK, order).to_vec();
    head.extend_from_slice(&parameters);
    Ok(head)
}

/// `POINT:SCALE`, and what positions (of integers) and residuals are divided by.
fn steps(recording: &Recording, coding: Coding) -> Result<(f32, f32), C3dError> {
    let step = match coding {
        Coding::Float { residual_step } => residual_step,
        Coding::Integer { step: Some(step) } => step,
        Coding::Integer { step: None } => {
            let largest = farthest(&recording.samples) / f32::from(i16::MAX);
            // A little larger, so that the farthest point is not rounded beyond the last number.
            if largest > 0.0 { largest * 1.000_001 } else { 1.0 }
        }
    };
    if !(step.is_finite() && step > 0.0) {
        return fault(0, format_args!("a step of {step}"), "a number above 0");
    }
    match coding {
        Coding::Float { .. } => Ok((-step, step)),
        Coding::Integer { .. } => {
            let farthest = farthest(&recording.samples);
            if (farthest / step).round() > f32::from(i16::MAX) {
                let found = format!("a coordinate of {farthest} with a step of {step}");
                return fault(0, found, "at most 32767 steps");
            }
            Ok((step, step))
        }
    }
}

fn farthest(samples: &[Sample]) -> f32 {
    let there = samples.iter().filter(|it| it.is_present());
    there.flat_map(|it| it.position).map(f32::abs).filter(|it| it.is_finite()).fold(0.0, f32::max)
}

/// Cameras in the upper byte, residual in the lower one; −1 where the point is missing.
fn last_word(sample: &Sample, per_step: f32) -> i16 {
    // A residual that is not 0 stays so: 0 says that the point was not measured.
    let residual = match (sample.residual * per_step).round() {
        0.0 if sample.residual > 0.0 => 1,
        steps => steps.min(255.0) as u8,
    };
    i16::from(sample.cameras & 0x7f) << 8 | i16::from(residual)
}

pub(super) fn floats(out: &mut Vec<u8>, samples: &[Sample], step: f32, bytes_of: impl Fn(f32) -> [u8; 4]) {
    let per_step = 1.0 / step;
    for sample in samples {
        let [x, y, z] = sample.position;
        let is_there = sample.is_present() && (x + y + z).is_finite();
        let of_four = if is_there { [x, y, z, f32::from(last_word(sample, per_step))] } else { [0.0, 0.0, 0.0, -1.0] };
        let mut point = [0; 16];
        for (to, value) in point.chunks_exact_mut(4).zip(of_four) {
            to.copy_from_slice(&bytes_of(value));
        }
        out.extend_from_slice(&point);
    }
}

pub(super) fn integers(out: &mut Vec<u8>, samples: &[Sample], step: f32, order: ByteOrder) {
    for sample in samples {
        let [x, y, z] = sample.position;
        let is_there = sample.is_present() && (x + y + z).is_finite();
        // Checked to fit; what were beyond would saturate.
        let number = |it: f32| (f64::from(it) / f64::from(step)).round() as i16;
        let words =
            if is_there { [number(x), number(y), number(z), last_word(sample, 1.0 / step)] } else { [0, 0, 0, -1] };
        words.into_iter().for_each(|it| out.extend_from_slice(&order.word_bytes(it as u16)));
    }
}

/// Lower and higher word of a number.
fn two_words(number: usize) -> [u16; 2] {
    [number as u16, (number >> 16) as u16]
}

fn header(recording: &Recording, n_frames: usize, scale: f32, data_start: usize, order: ByteOrder) -> [u8; BLOCK] {
    let mut block = [0; BLOCK];
    block[0] = 2;
    block[1] = MAGIC;
    let at = |number: usize| (number - 1) * 2;
    let mut word = |number: usize, value: usize| {
        let value = value.min(usize::from(u16::MAX)) as u16;
        block[at(number)..at(number) + 2].copy_from_slice(&order.word_bytes(value));
    };
    let first = recording.first_frame as usize;
    word(2, recording.labels.len());
    word(4, first);
    word(5, (first + n_frames).saturating_sub(1));
    word(9, data_start);
    // Samples of a channel in a frame, which readers hold against `ANALOG:RATE` even where there are no channels.
    word(10, 1);
    word(150, usize::from(FOUR_CHARACTERS));
    word(151, recording.events.len().min(HEADER_EVENTS));
    let mut float = |number: usize, value: f32| {
        block[at(number)..at(number) + 4].copy_from_slice(&order.float_bytes(value));
    };
    float(7, scale);
    float(11, recording.rate_hz);
    for (i, event) in recording.events.iter().take(HEADER_EVENTS).enumerate() {
        float(153 + 2 * i, event.time_s as f32);
    }
    for (i, event) in recording.events.iter().take(HEADER_EVENTS).enumerate() {
        block[at(189) + i] = 1;
        let label = event.label.as_bytes().iter().copied().chain([b' '; 4]).take(4);
        block[at(199) + 4 * i..].iter_mut().zip(label).for_each(|(to, it)| *to = it);
    }
    block
}

/// The parameter section, whole blocks.
fn parameters(
    recording: &Recording,
    n_frames: usize,
    scale: f32,
    order: ByteOrder,
    room: Room,
) -> Result<Vec<u8>, C3dError> {
    let first = recording.first_frame as usize;
    let last = (first + n_frames).saturating_sub(1);
    let mut to = Section { bytes: vec![1, MAGIC, 0, order.processor()], order, group: 0 };

    to.group("POINT");
    to.words("USED", &[recording.labels.len() as u16]);
    to.words("FRAMES", &[n_frames.min(usize::from(u16::MAX)) as u16]);
    if room.long_frames {
        to.floats("LONG_FRAMES", &[1], &[n_frames as f32]);
    }
    let data_start_at = to.bytes.len();
    to.words("DATA_START", &[0]);
    to.floats("SCALE", &[1], &[scale]);
    to.floats("RATE", &[1], &[recording.rate_hz]);
    to.texts("UNITS", &[&recording.units])?;
    to.texts("X_SCREEN", &["+X"])?;
    to.texts("Y_SCREEN", &[if recording.y_is_up { "+Y" } else { "+Z" }])?;
    to.many_texts("LABELS", &recording.labels, room.label_bytes)?;
    // Readers warn where they are missing, and want one for each label.
    to.many_texts("DESCRIPTIONS", &vec![String::new(); recording.labels.len()], 0)?;

    to.group("ANALOG");
    to.words("USED", &[0]);
    to.floats("GEN_SCALE", &[1], &[1.0]);
    to.floats("RATE", &[1], &[recording.rate_hz]);

    to.group("FORCE_PLATFORM");
    to.words("USED", &[0]);

    to.group("TRIAL");
    to.words("ACTUAL_START_FIELD", &two_words(first));
    to.words("ACTUAL_END_FIELD", &two_words(last));

    if !recording.events.is_empty() {
        let events = &recording.events;
        if events.len() > LABELS_A_PARAMETER {
            return fault(0, format_args!("{} events", events.len()), "at most 255");
        }
        to.group("EVENT");
        to.words("USED", &[events.len() as u16]);
        to.texts("CONTEXTS", &events.iter().map(|it| it.context.as_str()).collect::<Vec<_>>())?;
        to.texts("LABELS", &events.iter().map(|it| it.label.as_str()).collect::<Vec<_>>())?;
        let times: Vec<f32> = events
            .iter()
            .flat_map(|it| {
                let minutes = (it.time_s / 60.0).floor();
                [minutes as f32, (it.time_s - minutes * 60.0) as f32]
            })
            .collect();
        to.floats("TIMES", &[2, events.len() as u8], &times);
    }
    to.group("FOVEATE");
    if !recording.cameras.is_empty() {
        to.many_texts("CAMERAS", &recording.cameras, 0)?;
    }
    if let Some(start_s) = recording.start_s {
        to.texts("START_S", &[&start_s.to_string()])?;
    }
    to.group("MANUFACTURER");
    to.texts("COMPANY", &["Foveate"])?;

    let mut bytes = to.bytes;
    bytes.push(0);
    bytes.resize(bytes.len().next_multiple_of(BLOCK), 0);
    let n_blocks = bytes.len() / BLOCK;
    if n_blocks > MOST_BLOCKS {
        let found = format!("labels of {} points that take {n_blocks} blocks", recording.labels.len());
        return fault(0, found, "at most 255 blocks: fewer points, or shorter labels");
    }
    bytes[2] = n_blocks as u8;
    let value_at = data_start_at + 2 + "DATA_START".len() + 2 + 1 + 1 + 1;
    bytes[value_at..value_at + 2].copy_from_slice(&order.word_bytes((2 + n_blocks) as u16));
    Ok(bytes)
}

/// Groups and parameters as they are written one after the other.
struct Section {
    bytes: Vec<u8>,
    order: ByteOrder,
    group: i8,
}

impl Section {
    fn group(&mut self, name: &str) {
        self.group += 1;
        self.bytes.extend([name.len() as u8, (-self.group) as u8]);
        self.bytes.extend(name.as_bytes());
        // To the next one: these two bytes and the length of no description.
        self.bytes.extend(self.order.word_bytes(3));
        self.bytes.push(0);
    }

    fn parameter(&mut self, name: &str, kind: i8, dimensions: &[u8], values: &[u8]) {
        self.bytes.extend([name.len() as u8, self.group as u8]);
        self.bytes.extend(name.as_bytes());
        let step = 2 + 2 + dimensions.len() + values.len() + 1;
        self.bytes.extend(self.order.word_bytes(step as u16));
        self.bytes.extend([kind as u8, dimensions.len() as u8]);
        self.bytes.extend(dimensions);
        self.bytes.extend(values);
        self.bytes.push(0);
    }

    fn words(&mut self, name: &str, values: &[u16]) {
        let bytes: Vec<u8> = values.iter().flat_map(|&it| self.order.word_bytes(it)).collect();
        self.parameter(name, 2, &[values.len() as u8], &bytes);
    }

    fn floats(&mut self, name: &str, dimensions: &[u8], values: &[f32]) {
        let bytes: Vec<u8> = values.iter().flat_map(|&it| self.order.float_bytes(it)).collect();
        self.parameter(name, 4, dimensions, &bytes);
    }

    /// At most 255 texts, filled up with spaces to the longest.
    fn texts(&mut self, name: &str, texts: &[&str]) -> Result<(), C3dError> {
        self.texts_of(name, texts, 0)
    }

    /// As [`Self::texts`], each of so many bytes at least.
    fn texts_of(&mut self, name: &str, texts: &[&str], bytes: usize) -> Result<(), C3dError> {
        let length = texts.iter().map(|it| it.len()).max().unwrap_or(0).max(bytes).max(1);
        if let Some(long) = texts.iter().find(|it| it.len() > LONGEST_LABEL) {
            return fault(0, format_args!("`{long}` in `{name}`"), format_args!("at most {LONGEST_LABEL} bytes"));
        }
        let mut values = Vec::with_capacity(texts.len() * length);
        for text in texts {
            values.extend_from_slice(text.as_bytes());
            values.resize(values.len() + length - text.len(), b' ');
        }
        self.parameter(name, -1, &[length as u8, texts.len() as u8], &values);
        Ok(())
    }

    /// Any number of texts, in `NAME`, `NAME2` and so on.
    fn many_texts(&mut self, name: &str, texts: &[String], bytes: usize) -> Result<(), C3dError> {
        if texts.is_empty() {
            return self.texts(name, &[]);
        }
        for (part, of_it) in texts.chunks(LABELS_A_PARAMETER).enumerate() {
            let of_it: Vec<&str> = of_it.iter().map(String::as_str).collect();
            let name = if part == 0 { name.to_owned() } else { format!("{name}{}", part + 1) };
            self.texts_of(&name, &of_it, bytes)?;
        }
        Ok(())
    }
}
