//! Layout of the frames in a C3D file, where header and parameters may disagree.
//!
//! Header and parameters both count points, frames and analog values, name the first block of the data, and
//! distinguish floats from integers. Where they
//! contradict each other, the combination is taken whose frames fill the rest of the file to its last block; where
//! none does, points, channels and numbers as first named,
//! if they fit.

use super::order::Bytes;
use super::parameters::Parameters;
use super::read::Header;
use super::{BLOCK, C3dError, fault};

/// The most points that a header can count, and so the most that a parameter is believed.
const MOST_POINTS: usize = 65_535;

/// How the frames lie in the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Layout {
    pub n_points: usize,
    pub n_frames: usize,
    /// Values of all channels in a frame.
    pub n_analog: usize,
    /// `None`: the analog values are not a whole number of channels, and are ignored.
    pub n_channels: Option<usize>,
    /// Negative: points and channels are floats.
    pub scale: f32,
    /// The first byte.
    pub start: usize,
}

impl Layout {
    /// Of a coordinate or an analog value [bytes].
    pub fn size_of_value(&self) -> usize {
        if self.scale < 0.0 { 4 } else { 2 }
    }

    /// [bytes]
    pub fn size_of_frame(&self) -> usize {
        self.size_of_value() * (4 * self.n_points + self.n_analog)
    }

    /// What the frames leave of `length` bytes; `None`: they do not fit.
    fn left_of(&self, length: usize) -> Option<usize> {
        let needed = self.size_of_frame().checked_mul(self.n_frames)?;
        length.checked_sub(self.start)?.checked_sub(needed)
    }
}

/// The number of the first frame.
pub(super) fn first_frame(header: &Header, parameters: &Parameters) -> usize {
    parameters.double_word("TRIAL", "ACTUAL_START_FIELD").unwrap_or(header.first)
}

/// How many frames the file may have, the likeliest first.
fn numbers_of_frames(header: &Header, parameters: &Parameters) -> Result<Vec<usize>, C3dError> {
    let first = first_frame(header, parameters);
    let mut all = Vec::new();
    if let Some(last) = parameters.double_word("TRIAL", "ACTUAL_END_FIELD").filter(|it| *it >= first) {
        all.push(last - first + 1);
    }
    let counted = [parameters.count("POINT", "LONG_FRAMES"), parameters.count("POINT", "FRAMES")];
    if header.last == usize::from(u16::MAX) {
        all.extend(counted.iter().flatten().find(|it| **it >= header.last));
    }
    if header.last >= header.first {
        all.push(header.last - header.first + 1);
    }
    all.extend(counted.into_iter().flatten().filter(|it| *it > 0));
    if all.is_empty() {
        let found = format!("the last frame {} before the first one, {}", header.last, header.first);
        return fault(8, found, "a frame that is not before the first");
    }
    Ok(unique(all))
}

fn unique<T: PartialEq>(all: Vec<T>) -> Vec<T> {
    let mut once: Vec<T> = Vec::new();
    for it in all {
        if !once.contains(&it) {
            once.push(it);
        }
    }
    once
}

/// Values of all channels in a frame, the header's first: it alone tells where the next frame begins.
fn numbers_of_analog(header: &Header, parameters: &Parameters) -> Vec<usize> {
    let mut all = vec![header.n_analog];
    if let Some(used) = parameters.count("ANALOG", "USED").filter(|it| *it <= MOST_POINTS) {
        all.extend(by_rates(parameters).map(|per_frame| used * per_frame));
        all.push(used * header.analog_per_frame.max(1));
    }
    unique(all)
}

/// Samples of each channel in a frame, by the rates.
fn by_rates(parameters: &Parameters) -> Option<usize> {
    let ratio = parameters.number("ANALOG", "RATE")? / parameters.number("POINT", "RATE")?;
    (ratio.is_finite() && (0.5..=65_535.0).contains(&ratio)).then(|| ratio.round() as usize)
}

pub(super) fn layout(
    bytes: Bytes,
    header: &Header,
    parameters: &Parameters,
    remarks: &mut Vec<String>,
) -> Result<Layout, C3dError> {
    let used = parameters.count("POINT", "USED").filter(|it| *it <= MOST_POINTS);
    let points = unique(used.into_iter().chain([header.n_points]).collect());
    let stated = parameters.number("POINT", "SCALE").map(|it| it as f32);
    let is_scale = |it: &f32| it.is_finite() && *it != 0.0;
    let mut scales: Vec<f32> = stated.into_iter().chain([header.scale]).filter(is_scale).collect();
    // Of two of one sign the parameter's counts.
    scales.dedup_by_key(|it| *it < 0.0);
    if scales.is_empty() && points.iter().any(|it| *it > 0) {
        return fault(12, format_args!("a scale of {}", stated.unwrap_or(header.scale)), "a number other than 0");
    }
    if scales.is_empty() {
        scales.push(-1.0);
    }
    let told_start = parameters.count("POINT", "DATA_START").unwrap_or(0);
    let starts = unique(
        [header.data_start, told_start].into_iter().filter(|it| (2..=usize::from(u16::MAX)).contains(it)).collect(),
    );
    if starts.is_empty() {
        return fault(16, format_args!("data in block {}", header.data_start), "a block behind the parameters");
    }
    let analog = numbers_of_analog(header, parameters);
    // Where a frame is empty its number does not matter, and may be nonsense.
    let frames = match points.iter().chain(&analog).all(|it| *it == 0) {
        true => vec![0],
        false => numbers_of_frames(header, parameters)?,
    };
    let mut all = Vec::new();
    for &start in &starts {
        for &scale in &scales {
            for &n_points in &points {
                for &n_analog in &analog {
                    for &n_frames in &frames {
                        let n_frames = if n_points + n_analog == 0 { 0 } else { n_frames };
                        all.push(Layout {
                            n_points,
                            n_frames,
                            n_analog,
                            n_channels: None,
                            scale,
                            start: (start - 1) * BLOCK,
                        });
                    }
                }
            }
        }
    }
    let length = bytes.all.len();
    let fills = |it: &&Layout| it.left_of(length).is_some_and(|left| left < BLOCK) && it.n_frames > 0;
    let first = |it: &&Layout| {
        (it.n_points, it.n_analog, it.scale, it.start) == (all[0].n_points, all[0].n_analog, all[0].scale, all[0].start)
    };
    let fits = |it: &&Layout| first(it) && it.left_of(length).is_some();
    let Some(mut chosen) = all.iter().find(fills).or_else(|| all.iter().find(fits)).copied() else {
        let wanted = all[0];
        let found = format!("{} bytes of data", length.saturating_sub(wanted.start));
        let expected = format!("{} frames of {} bytes each", wanted.n_frames, wanted.size_of_frame());
        return fault(wanted.start.min(length), found, expected);
    };
    chosen.n_channels = channels(&chosen, header, parameters);
    let contents = Contents { header, parameters, points: &points, frames: &frames, starts: &starts, scales: &scales };
    contents.remark(&chosen, remarks);
    Ok(chosen)
}

/// How many channels the analog values of a frame are of.
fn channels(layout: &Layout, header: &Header, parameters: &Parameters) -> Option<usize> {
    let n_analog = layout.n_analog;
    let used = parameters.count("ANALOG", "USED").filter(|it| *it > 0 && n_analog.is_multiple_of(*it));
    let per_frame = header.analog_per_frame.max(1);
    let of_header = n_analog.is_multiple_of(per_frame).then(|| n_analog / per_frame);
    // Both agree as a rule; of the two ways to share them out the parameters' one has names.
    if n_analog == 0 { Some(0) } else { used.or(of_header) }
}

/// What header and parameters say, to hold against what was taken.
struct Contents<'a> {
    header: &'a Header,
    parameters: &'a Parameters<'a>,
    points: &'a [usize],
    frames: &'a [usize],
    starts: &'a [usize],
    scales: &'a [f32],
}

impl Contents<'_> {
    fn remark(&self, chosen: &Layout, remarks: &mut Vec<String>) {
        let Contents { header, parameters, points, frames, starts, scales } = self;
        if let [used, counted] = points {
            let taken = chosen.n_points;
            remarks.push(format!("POINT:USED says {used} points and the header {counted}; taken: {taken}"));
        }
        // The header saturates, and some makers leave the other counts as they were before a trial was cut.
        if frames.first().is_some_and(|it| *it != chosen.n_frames) && chosen.n_frames > 0 {
            let list: Vec<String> = frames.iter().map(ToString::to_string).collect();
            remarks.push(format!("numbers of frames are {}; taken: {}", list.join(", "), chosen.n_frames));
        }
        if starts.len() == 2 || header.data_start != starts[0] {
            let (stated, taken) = (starts[starts.len() - 1], chosen.start / BLOCK + 1);
            remarks.push(format!(
                "the data begin in block {} by the header, {stated} by POINT:DATA_START; taken: {taken}",
                header.data_start
            ));
        }
        if scales.len() == 2 {
            let kind = if chosen.scale < 0.0 { "floats" } else { "integers" };
            remarks.push(format!("header and POINT:SCALE disagree whether points are floats; taken: {kind}"));
        }
        let per_frame = header.analog_per_frame;
        let Some(n_channels) = chosen.n_channels else {
            remarks.push(format!(
                "{} analog values a frame, {per_frame} of each channel, are not a whole number of channels, and are ignored",
                chosen.n_analog
            ));
            return;
        };
        let taken = chosen.n_analog.checked_div(n_channels).unwrap_or(0);
        let used = parameters.count("ANALOG", "USED").unwrap_or(n_channels);
        let by_rates = by_rates(parameters).unwrap_or(taken);
        let alike = taken == per_frame.max(1) && taken == by_rates || chosen.n_analog == 0;
        if !alike || header.n_analog != chosen.n_analog || used != n_channels {
            remarks.push(format!(
                "header and parameters disagree on analog samples: {} values a frame with {per_frame} of each channel, {used} channels with {by_rates} by \
                 their rates; taken: {n_channels} channels, {taken} samples a frame",
                header.n_analog
            ));
        }
    }
}
