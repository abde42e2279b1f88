//! Lines of a log, `foxglove.Log`, and figures over time, `foveate.Figures`.

use foveate_messages::Time;

use super::schemas::{figure, figures, log};
use super::wire::Writer;

/// How much a line of a log matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum LogLevel {
    /// Details for debugging.
    Debug = 1,
    /// Normal progress.
    Info = 2,
    /// Something may be wrong.
    Warning = 3,
    /// Something failed.
    Error = 4,
    /// The session ends because of it.
    Fatal = 5,
}

/// A `foxglove.Log`: what `name`, such as a node, said at `time`.
pub fn log_line(time: Time, level: LogLevel, name: &str, message: &str, out: &mut Vec<u8>) {
    let mut it = Writer::new(out);
    it.time(log::timestamp, time);
    it.varint(log::level, level as u64);
    it.string(log::message, message);
    it.string(log::name, name);
}

/// A `foveate.Figures`: names and values at `time`, in the order given.
pub fn figures<'n>(time: Time, list: impl IntoIterator<Item = (&'n str, f64)>, out: &mut Vec<u8>) {
    let mut it = Writer::new(out);
    it.time(figures::timestamp, time);
    for (name, value) in list {
        it.message(figures::figures, |it| {
            it.string(figure::name, name);
            it.double(figure::value, value);
        });
    }
}

#[cfg(test)]
mod tests {
    use super::super::Kind;
    use super::super::decoded::Decoded;
    use super::*;

    #[test]
    fn a_line_says_who_what_and_how_grave() {
        let mut out = Vec::new();
        log_line(Time(2_000_000_003), LogLevel::Warning, "tracker", "2 frames lost", &mut out);
        let decoded = Decoded::of(Kind::Log, &out);
        assert_eq!((decoded.number("timestamp.seconds"), decoded.number("timestamp.nanos")), (2.0, 3.0));
        assert_eq!((decoded.text("name"), decoded.text("message")), ("tracker", "2 frames lost"));
        assert_eq!((decoded.number("level"), LogLevel::Fatal as u32), (3.0, 5));
    }

    #[test]
    fn figures_keep_their_names_and_values() {
        let mut out = Vec::new();
        figures(Time(1), [("age_ms", 12.5), ("count", -0.0), ("lost", f64::NAN)], &mut out);
        let decoded = Decoded::of(Kind::Figures, &out);
        assert_eq!(decoded.count("figures"), 3);
        assert_eq!((decoded.text("figures[0].name"), decoded.number("figures[0].value")), ("age_ms", 12.5));
        assert!(decoded.number("figures[2].value").is_nan());
    }
}
