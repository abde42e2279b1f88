//! Parses what `ffmpeg` writes on its standard error, line by line.
//!
//! The filter `showinfo` announces each frame before its pixels leave, with the exact time stamp as a whole number of time
//! bases and with the size after rotation. That is a frame's true time, also for phones with a variable rate; one
//! process delivers times and pixels, so they stay matched.

use foveate::prelude::Interval;

/// A frame whose pixels follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Announced {
    /// Its time on the file's own clock, where the file knows it.
    pub(crate) time: Option<Interval>,
    /// Columns, rows [px].
    pub(crate) size: [u32; 2],
}

/// Parser of the lines.
#[derive(Debug)]
pub(crate) struct Listener {
    /// Length of one unit of the time stamps [s], as a fraction.
    time_base: (i64, i64),
    /// The first complaint, which often names the cause, and the last ones, each different from the one before.
    complaints: Vec<String>,
    n_complaints: u64,
}

impl Default for Listener {
    fn default() -> Self {
        Self { time_base: (0, 1), complaints: Vec::new(), n_complaints: 0 }
    }
}

impl Listener {
    const KEPT: usize = 3;

    /// Parses one line; returns the frame that it announces, if any.
    pub(crate) fn hear(&mut self, line: &str) -> Option<Announced> {
        let line = line.trim_end();
        if line.contains("[Parsed_showinfo_") && line.contains("[info]") {
            if let Some(base) = after(line, "config in time_base:").and_then(fraction) {
                self.time_base = base;
            }
            return self.announced(line);
        }
        let is_complaint = line.contains("[error]")
            || line.contains("[fatal]")
            || (line.contains("[warning]") && (line.contains("orrupt") || line.contains("EOI missing")));
        // About the raw pixels on the pipe, which carry no times.
        let is_about_the_pipe = line.contains("to muxer in stream");
        if is_complaint && !is_about_the_pipe {
            self.n_complaints += 1;
            let words = plain(line);
            if self.complaints.last() != Some(&words) {
                self.complaints.push(words);
            }
            if self.complaints.len() > Self::KEPT {
                self.complaints.remove(1);
            }
        }
        None
    }

    fn announced(&self, line: &str) -> Option<Announced> {
        after(line, " n:")?;
        let time = after(line, " pts:")?.parse().ok().and_then(|units: i64| self.time(units));
        let (columns, rows) = after(line, " s:")?.split_once('x')?;
        Some(Announced { time, size: [columns.parse().ok()?, rows.parse().ok()?] })
    }

    fn time(&self, units: i64) -> Option<Interval> {
        let (numerator, denominator) = self.time_base;
        let nanoseconds = i128::from(units) * i128::from(numerator) * 1_000_000_000;
        (numerator > 0 && denominator > 0).then(|| Interval((nanoseconds / i128::from(denominator)) as i64))
    }

    /// The stored error messages in one line; `None` without any.
    pub(crate) fn complaints(&self) -> Option<String> {
        (!self.complaints.is_empty()).then(|| self.complaints.join("; "))
    }

    /// Number of error messages.
    pub(crate) fn n_complaints(&self) -> u64 {
        self.n_complaints
    }

    /// Whether a complaint contains `words`.
    pub(crate) fn complained_of(&self, words: &str) -> bool {
        self.complaints.iter().any(|it| it.contains(words))
    }
}

/// The word that follows `label`, which may have spaces between.
fn after<'l>(line: &'l str, label: &str) -> Option<&'l str> {
    let rest = &line[line.find(label)? + label.len()..];
    rest.split_whitespace().next().map(|it| it.trim_end_matches(','))
}

/// `30000/1001`; nothing where a part is 0.
pub(crate) fn fraction(text: &str) -> Option<(i64, i64)> {
    let (numerator, denominator) = text.split_once('/')?;
    let fraction = (numerator.parse().ok()?, denominator.parse().ok()?);
    (fraction.0 > 0 && fraction.1 > 0).then_some(fraction)
}

/// Without `[h264 @ 0x55d0]` and `[error]`.
fn plain(line: &str) -> String {
    let mut rest = line.trim_start();
    while let Some((_, tail)) = rest.strip_prefix('[').and_then(|it| it.split_once(']')) {
        rest = tail.trim_start();
    }
    rest.chars().take(200).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = "[Parsed_showinfo_0 @ 0x5646] [info] config in time_base: 1/15360, frame_rate: 30/1";

    #[test]
    fn frames_are_announced_with_exact_times_and_sizes() {
        let mut listener = Listener::default();
        assert_eq!(listener.hear(CONFIG), None);
        let line = "[Parsed_showinfo_0 @ 0x5646] [info] n:  29 pts:  14848 pts_time:0.966667 pos:     5954 fmt:yuv420p sar:1/1 s:160x120 i:P iskey:0 type:P ";
        let frame = listener.hear(line).unwrap();
        assert_eq!(frame, Announced { time: Some(Interval(966_666_666)), size: [160, 120] });
        let without =
            listener.hear("[Parsed_showinfo_0 @ 0x5646] [info] n:   1 pts:NOPTS pts_time:NOPTS s:8x4 i:P").unwrap();
        assert_eq!(without, Announced { time: None, size: [8, 4] });
        assert_eq!(listener.hear("[Parsed_showinfo_0 @ 0x5646] [info] color_range:unknown color_space:unknown"), None);
        assert_eq!(listener.complaints(), None);
    }

    #[test]
    fn complaints_are_kept_and_chatter_is_not() {
        let mut listener = Listener::default();
        listener.hear("[info] Input #0, avi, from 'file:cut.avi':");
        listener.hear("[swscaler @ 0x55] [warning] deprecated pixel format used");
        listener.hear("[rawvideo @ 0x5] [error] Application provided invalid, non monotonically increasing dts to muxer in stream 0: 2 >= 2");
        assert_eq!(listener.complaints(), None);
        listener.hear("[mjpeg @ 0x55] [error] overread 8");
        listener.hear("[mjpeg @ 0x55] [error] overread 8");
        listener.hear("[warning] file:cut.avi: corrupt input packet in stream 0");
        assert_eq!(listener.complaints().unwrap(), "overread 8; file:cut.avi: corrupt input packet in stream 0");
        assert_eq!(listener.n_complaints(), 3);
        assert!(listener.complained_of("corrupt"));
        listener.hear("[error] that did not help");
        listener.hear("[fatal] the end");
        assert_eq!(listener.complaints().unwrap(), "overread 8; that did not help; the end");
    }

    #[test]
    fn fractions_without_a_meaning_are_none() {
        assert_eq!(fraction("30000/1001"), Some((30_000, 1001)));
        assert_eq!(fraction("0/0"), None);
        assert_eq!(fraction("30"), None);
    }
}
