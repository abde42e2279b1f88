//! C3D reader.

use super::layout::{Layout, first_frame, layout};
use super::model_outputs::model_outputs;
use super::order::{Bytes, text};
use super::parameters::{Parameters, Section};
use super::{
    Analog, BLOCK, ByteOrder, C3dError, Event, FOUR_CHARACTERS, HEADER_EVENTS, MAGIC, Recording, Sample, fault,
};

/// What a header says, in the names of the format's guide.
pub(super) struct Header {
    pub n_points: usize,
    /// Values of all channels in a frame.
    pub n_analog: usize,
    pub first: usize,
    pub last: usize,
    pub scale: f32,
    /// The block, counted from 1.
    pub data_start: usize,
    pub analog_per_frame: usize,
    pub rate_hz: f32,
}

/// Reads a whole file. [`read_with_remarks`] also says how contradictions in it were resolved.
///
/// # Errors
/// As [`read_with_remarks`].
pub fn read(file: &[u8]) -> Result<Recording, C3dError> {
    read_with_remarks(file).map(|it| it.0)
}

/// Reads a whole file, with remarks on contradictions in it and how they were resolved.
///
/// Where header and parameters disagree on the frames, the values that fit the file's length count, parameters before
/// the header. Points without a label are called `unlabelled-N`, counted from 1. A coordinate that is not a number
/// makes its point missing.
///
/// # Errors
/// The byte, what was found and what was expected: no C3D file, or one that is broken or cut off.
pub fn read_with_remarks(file: &[u8]) -> Result<(Recording, Vec<String>), C3dError> {
    let mut bytes = Bytes { all: file, order: ByteOrder::Intel };
    bytes.range(0, BLOCK, "a header")?;
    if file[1] != MAGIC {
        return fault(1, format_args!("{:#04x}", file[1]), format_args!("{MAGIC:#04x}, the mark of a C3D file"));
    }
    if file[0] < 2 {
        return fault(0, format_args!("parameters in block {}", file[0]), "block 2 or later: the header is block 1");
    }
    let start = (usize::from(file[0]) - 1) * BLOCK;
    let head = bytes.range(start, 4, "the head of the parameters")?;
    bytes.order = match ByteOrder::of_processor(head[3]) {
        Some(order) => order,
        None => return fault(start + 3, head[3], "a processor: 84 (Intel), 85 (DEC) or 86 (SGI)"),
    };
    let header = header(bytes)?;
    let section =
        Section { start, n_blocks: usize::from(head[2]), data_start: header.data_start.saturating_sub(1) * BLOCK };
    let mut parameters = Parameters::read(bytes, section)?;
    let mut remarks = std::mem::take(&mut parameters.remarks);
    let layout = layout(bytes, &header, &parameters, &mut remarks)?;

    let mut labels = parameters.continued_texts("POINT", "LABELS");
    labels.truncate(layout.n_points);
    let n_named = labels.len();
    labels.extend((n_named..layout.n_points).map(|it| format!("unlabelled-{}", it + 1)));
    if n_named < layout.n_points {
        remarks.push(format!("{n_named} labels for {} points; the others are `unlabelled-N`", layout.n_points));
    }
    let rate = parameters.number("POINT", "RATE").map(|it| it as f32).filter(|it| it.is_finite() && *it > 0.0);
    let model_outputs = model_outputs(&parameters, &labels);
    let (samples, raw) = frames(bytes, &layout, parameters.texts("ANALOG", "FORMAT"));
    let recording = Recording {
        rate_hz: rate.unwrap_or(header.rate_hz),
        units: parameters.texts("POINT", "UNITS").first().cloned().unwrap_or_default(),
        first_frame: first_frame(&header, &parameters) as u32,
        labels,
        samples,
        events: events(bytes, &parameters)?,
        analog: analog(raw, &layout, &parameters),
        start_s: parameters.texts("FOVEATE", "START_S").first().and_then(|it| it.parse().ok()),
        cameras: parameters.texts("FOVEATE", "CAMERAS"),
        y_is_up: parameters
            .texts("POINT", "Y_SCREEN")
            .first()
            .is_some_and(|it| matches!(it.as_str(), "+Y" | "Y" | "+y" | "y")),
        model_outputs,
    };
    Ok((recording, remarks))
}

fn header(bytes: Bytes) -> Result<Header, C3dError> {
    // Words are counted from 1 in the guide; all are within the block that is there.
    let word = |number: usize| bytes.word((number - 1) * 2, "the header").map(usize::from);
    let float = |number: usize| bytes.float((number - 1) * 2, "the header");
    Ok(Header {
        n_points: word(2)?,
        n_analog: word(3)?,
        first: word(4)?,
        last: word(5)?,
        scale: float(7)?,
        data_start: word(9)?,
        analog_per_frame: word(10)?,
        rate_hz: float(11)?,
    })
}

/// All points, and the raw values of all channels. The layout has been checked against the file.
fn frames(bytes: Bytes, layout: &Layout, format: Vec<String>) -> (Vec<Sample>, Vec<f32>) {
    let Layout { n_points, n_frames, n_analog, scale, .. } = *layout;
    let order = bytes.order;
    let (size, frame) = (layout.size_of_value(), layout.size_of_frame());
    let mut samples = Vec::with_capacity(n_points * n_frames);
    let mut raw = Vec::with_capacity(n_analog * n_frames);
    let is_unsigned = format.first().is_some_and(|it| it.eq_ignore_ascii_case("UNSIGNED"));
    let unit = scale.abs();
    let float = |it: &[u8]| order.float([it[0], it[1], it[2], it[3]]);
    let word = |it: &[u8]| order.word([it[0], it[1]]);
    for frame in bytes.all[layout.start..].chunks_exact(frame.max(1)).take(n_frames) {
        let (points, channels) = frame.split_at(size * 4 * n_points);
        if size == 4 {
            samples.extend(points.chunks_exact(16).map(|it| {
                let position = [float(it), float(&it[4..]), float(&it[8..])];
                // Saturates, and NaN is 0.
                sample(position, float(&it[12..]) as i16, unit)
            }));
            raw.extend(channels.chunks_exact(4).map(float));
        } else {
            samples.extend(points.chunks_exact(8).map(|it| {
                let position = [0, 2, 4].map(|at| f32::from(word(&it[at..]) as i16) * unit);
                sample(position, word(&it[6..]) as i16, unit)
            }));
            raw.extend(channels.chunks_exact(2).map(|it| match is_unsigned {
                true => f32::from(word(it)),
                false => f32::from(word(it) as i16),
            }));
        }
    }
    (samples, raw)
}

/// A point by its last word: the residual in the lower byte, the cameras in the upper one.
pub(super) fn sample(position: [f32; 3], last: i16, unit: f32) -> Sample {
    if last < 0 || !position.iter().all(|it| it.is_finite()) {
        return Sample::MISSING;
    }
    Sample { position, residual: f32::from(last & 0xff) * unit, cameras: (last >> 8) as u8 }
}

fn analog(mut values: Vec<f32>, layout: &Layout, parameters: &Parameters) -> Analog {
    let Some(n_channels) = layout.n_channels.filter(|it| *it > 0) else { return Analog::default() };
    let mut labels = parameters.continued_texts("ANALOG", "LABELS");
    labels.truncate(n_channels);
    labels.extend((labels.len()..n_channels).map(|it| format!("unlabelled-{}", it + 1)));
    let [scales, mut offsets] = ["SCALE", "OFFSET"].map(|it| parameters.continued_numbers("ANALOG", it));
    if parameters.texts("ANALOG", "FORMAT").first().is_some_and(|it| it.eq_ignore_ascii_case("UNSIGNED")) {
        offsets.iter_mut().for_each(|it| *it = it.rem_euclid(65_536.0));
    }
    let general = parameters.number("ANALOG", "GEN_SCALE").unwrap_or(1.0);
    for of_one_time in values.chunks_mut(n_channels) {
        for (channel, value) in of_one_time.iter_mut().enumerate() {
            let offset = offsets.get(channel).copied().unwrap_or(0.0);
            let scale = scales.get(channel).copied().unwrap_or(1.0);
            *value = ((f64::from(*value) - offset) * scale * general) as f32;
        }
    }
    Analog { labels, per_frame: layout.n_analog / n_channels, values }
}

/// Those of the group `EVENT`, or of the header where there is no such group.
fn events(bytes: Bytes, parameters: &Parameters) -> Result<Vec<Event>, C3dError> {
    let times = parameters.continued_numbers("EVENT", "TIMES");
    let n_events = parameters.count("EVENT", "USED").unwrap_or(0).min(times.len() / 2);
    if n_events > 0 {
        let mut labels = parameters.continued_texts("EVENT", "LABELS").into_iter();
        let mut contexts = parameters.continued_texts("EVENT", "CONTEXTS").into_iter();
        let event = |it: &[f64]| Event {
            label: labels.next().unwrap_or_default(),
            context: contexts.next().unwrap_or_default(),
            time_s: it[0] * 60.0 + it[1],
        };
        return Ok(times.chunks_exact(2).take(n_events).map(event).collect());
    }
    let word = |number: usize| (number - 1) * 2;
    if bytes.word(word(150), "the header")? != FOUR_CHARACTERS {
        return Ok(Vec::new());
    }
    let n_events = usize::from(bytes.word(word(151), "the header")?).min(HEADER_EVENTS);
    let event = |i: usize| {
        let time = bytes.float(word(153) + 4 * i, "the time of an event")?;
        let label = text(bytes.range(word(199) + 4 * i, 4, "the label of an event")?);
        Ok(Event { label, context: String::new(), time_s: f64::from(time) })
    };
    (0..n_events).map(event).collect()
}
