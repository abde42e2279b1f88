//! From the bytes of a C3D file to what it holds.

use super::order::{Bytes, text};
use super::parameters::Parameters;
use super::{
    Analog, BLOCK, ByteOrder, C3dError, Event, FOUR_CHARACTERS, HEADER_EVENTS, MAGIC, Recording, Sample, fault,
};

/// What a header says, in the names of the format's guide.
struct Header {
    n_points: usize,
    n_analog: usize,
    first: usize,
    last: usize,
    scale: f32,
    data_start: usize,
    analog_per_frame: usize,
    rate_hz: f32,
}

/// How the frames lie in the file.
struct Layout {
    n_points: usize,
    n_frames: usize,
    /// Values of all channels in a frame, and how many of them each channel has.
    n_analog: usize,
    analog_per_frame: usize,
    /// Negative: points and channels are floats.
    scale: f32,
    /// The first byte.
    start: usize,
}

/// Reads a whole file.
///
/// Where header and parameters disagree the parameters count, but for the place of the data and the layout of the channels, which are the
/// header's. Points without a label are called `unlabelled-N`, counted from 1.
///
/// # Errors
/// The byte, what is there and what should be: no C3D, or one that is broken or cut off.
pub fn read(file: &[u8]) -> Result<Recording, C3dError> {
    let mut bytes = Bytes { all: file, order: ByteOrder::Intel };
    bytes.range(0, BLOCK, "a header")?;
    if file[1] != MAGIC {
        return fault(1, format_args!("{:#04x}", file[1]), format_args!("{MAGIC:#04x}, the mark of a C3D file"));
    }
    if file[0] < 2 {
        return fault(0, format_args!("parameters in block {}", file[0]), "block 2 or later: the header is block 1");
    }
    let section = (usize::from(file[0]) - 1) * BLOCK;
    let head = bytes.range(section, 4, "the head of the parameters")?;
    bytes.order = match ByteOrder::of_processor(head[3]) {
        Some(order) => order,
        None => return fault(section + 3, head[3], "a processor: 84 (Intel), 85 (DEC) or 86 (SGI)"),
    };
    let header = header(bytes)?;
    let parameters = Parameters::read(bytes, section + 4)?;
    let layout = layout(bytes, &header, &parameters)?;

    let mut labels = parameters.continued_texts("POINT", "LABELS");
    labels.truncate(layout.n_points);
    labels.extend((labels.len()..layout.n_points).map(|it| format!("unlabelled-{}", it + 1)));
    let rate = parameters.number("POINT", "RATE").map(|it| it as f32).filter(|it| it.is_finite() && *it > 0.0);
    let (samples, raw) = frames(bytes, &layout, parameters.texts("ANALOG", "FORMAT"));
    Ok(Recording {
        rate_hz: rate.unwrap_or(header.rate_hz),
        units: parameters.texts("POINT", "UNITS").first().cloned().unwrap_or_default(),
        first_frame: first_frame(&header, &parameters) as u32,
        labels,
        samples,
        events: events(bytes, &parameters)?,
        analog: analog(raw, &layout, &parameters),
        start_s: parameters.texts("FOVEATE", "START_S").first().and_then(|it| it.parse().ok()),
        cameras: parameters.texts("FOVEATE", "CAMERAS"),
    })
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

fn first_frame(header: &Header, parameters: &Parameters) -> usize {
    parameters.double_word("TRIAL", "ACTUAL_START_FIELD").unwrap_or(header.first)
}

/// How many frames the file says that it has.
fn n_frames(header: &Header, parameters: &Parameters) -> Result<usize, C3dError> {
    let first = first_frame(header, parameters);
    if let Some(last) = parameters.double_word("TRIAL", "ACTUAL_END_FIELD")
        && last >= first
    {
        return Ok(last - first + 1);
    }
    if header.last == usize::from(u16::MAX)
        && let Some(number) = parameters.count("POINT", "LONG_FRAMES").or(parameters.count("POINT", "FRAMES"))
        && number >= header.last
    {
        return Ok(number);
    }
    if header.last < header.first {
        let found = format!("the last frame {} before the first one, {}", header.last, header.first);
        return fault(8, found, "a frame that is not before the first");
    }
    Ok(header.last - header.first + 1)
}

fn layout(bytes: Bytes, header: &Header, parameters: &Parameters) -> Result<Layout, C3dError> {
    let n_points = parameters.count("POINT", "USED").unwrap_or(header.n_points);
    let scale = parameters.number("POINT", "SCALE").map_or(header.scale, |it| it as f32);
    if !(scale.is_finite() && scale != 0.0) && n_points > 0 {
        return fault(12, format_args!("a scale of {scale}"), "a number other than 0");
    }
    let start = match header.data_start {
        block @ 2.. => (block - 1) * BLOCK,
        block => return fault(16, format_args!("data in block {block}"), "a block behind the parameters"),
    };
    let n_analog = header.n_analog;
    let analog_per_frame = header.analog_per_frame.max(1);
    if !n_analog.is_multiple_of(analog_per_frame) {
        let found = format!("{n_analog} analog values a frame, {analog_per_frame} of each channel");
        return fault(4, found, "a whole number of channels");
    }
    let size_of_value = if scale < 0.0 { 4 } else { 2 };
    let frame = size_of_value * (4 * n_points + n_analog);
    let n_frames = if frame == 0 { 0 } else { n_frames(header, parameters)? };
    let room = bytes.all.len().saturating_sub(start);
    if n_frames > room.checked_div(frame).unwrap_or(0) {
        let found = format!("{room} bytes of data");
        return fault(start.min(bytes.all.len()), found, format_args!("{n_frames} frames of {frame} bytes each"));
    }
    Ok(Layout { n_points, n_frames, n_analog, analog_per_frame, scale, start })
}

/// All points, and the raw values of all channels. The layout has been checked against the file.
fn frames(bytes: Bytes, layout: &Layout, format: Vec<String>) -> (Vec<Sample>, Vec<f32>) {
    let Layout { n_points, n_frames, n_analog, scale, .. } = *layout;
    let order = bytes.order;
    let size = if scale < 0.0 { 4 } else { 2 };
    let frame = size * (4 * n_points + n_analog);
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
    if last < 0 {
        return Sample::MISSING;
    }
    Sample { position, residual: f32::from(last & 0xff) * unit, cameras: (last >> 8) as u8 }
}

fn analog(mut values: Vec<f32>, layout: &Layout, parameters: &Parameters) -> Analog {
    let n_channels = layout.n_analog / layout.analog_per_frame;
    if n_channels == 0 {
        return Analog::default();
    }
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
    Analog { labels, per_frame: layout.analog_per_frame, values }
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
