//! What a page asks for, read from its texts.

use std::time::Instant;

use foveate_messages::Time;
use foveate_node::given::{Table, Value as Given};
use serde_json::Value;

use crate::settings::from_json;
use crate::view::Kind;
use crate::window::{MOST_WANTS, Want};

/// Longest note [characters].
const LONGEST_NOTE: usize = 500;

/// Rows of corrections in one command, at most.
const MOST_ROWS: usize = 1000;

/// Something that a page asks for.
pub(crate) enum Command {
    /// Looks at these from now on, and at nothing else.
    Subscribe(Vec<Want>),
    /// Settings of a node change.
    Set { node: usize, values: Table },
    /// Changed settings go into the rig file.
    Save,
    /// Time stands, goes on or moves.
    Time(TimeCommand),
    /// It ends, and its results are written.
    Stop,
    /// Marks of a node are corrected by hand: rows, each to be put in or taken away.
    Correct { node: usize, rows: Vec<Value> },
    /// A session is tracked again with the rows.
    Again,
    /// Where the tracker of a node may have gone wrong is looked up.
    Problems { node: usize },
    /// A recording begins, or ends.
    Record(bool),
    /// A note at a time of the session [s].
    Bookmark { at_s: f64, note: String },
}

/// What a page wants of time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum TimeCommand {
    /// It stands.
    Pause,
    /// It goes on.
    Go,
    /// It goes on by one picture, or back.
    Step { is_forward: bool },
    /// This moment is shown.
    Seek(Time),
    /// A part is repeated; `None`: it is played on to the end.
    Repeat(Option<[Time; 2]>),
    /// It goes so many times as fast as it was recorded.
    Speed(f64),
}

/// Reads a command, and the number that its answer gets.
///
/// # Errors
/// What was found and what is expected, with the number where there is one.
pub(crate) fn read(
    text: &str,
    n_topics: usize,
    n_nodes: usize,
) -> Result<(Command, Option<i64>), (String, Option<i64>)> {
    let it: Value = serde_json::from_str(text).map_err(|error| (format!("no command: {error}"), None))?;
    let number = it.get("n").and_then(Value::as_i64);
    of(&it, n_topics, n_nodes).map(|it| (it, number)).map_err(|what| (what, number))
}

fn of(it: &Value, n_topics: usize, n_nodes: usize) -> Result<Command, String> {
    match it.get("do").and_then(Value::as_str).unwrap_or_default() {
        "subscribe" => {
            let list = it.get("topics").and_then(Value::as_array).ok_or("found no `topics`, expected a list")?;
            if list.len() > MOST_WANTS {
                return Err(format!("found {} topics, expected at most {MOST_WANTS}", list.len()));
            }
            let now = Instant::now();
            list.iter().map(|it| want(it, n_topics, now)).collect::<Result<_, _>>().map(Command::Subscribe)
        }
        "set" => {
            let node = index(it, "node", n_nodes)?;
            let values = it.get("values").and_then(from_json);
            match values {
                Some(Given::Table(values)) if !values.is_empty() => Ok(Command::Set { node, values }),
                _ => Err("found no `values`, expected settings by name".to_owned()),
            }
        }
        "save" => Ok(Command::Save),
        "pause" => Ok(Command::Time(TimeCommand::Pause)),
        "go" => Ok(Command::Time(TimeCommand::Go)),
        "step" => {
            let by = it.get("by").and_then(Value::as_f64).unwrap_or(1.0);
            Ok(Command::Time(TimeCommand::Step { is_forward: by > 0.0 }))
        }
        "seek" => Ok(Command::Time(TimeCommand::Seek(time(it, "to_s")?))),
        "loop" if it.get("from_s").is_none() => Ok(Command::Time(TimeCommand::Repeat(None))),
        "loop" => Ok(Command::Time(TimeCommand::Repeat(Some([time(it, "from_s")?, time(it, "to_s")?])))),
        "speed" => {
            let factor = it.get("factor").and_then(Value::as_f64).filter(|it| *it > 0.0);
            factor
                .map(|it| Command::Time(TimeCommand::Speed(it)))
                .ok_or_else(|| "expected a `factor` above 0".to_owned())
        }
        "stop" => Ok(Command::Stop),
        "record" => Ok(Command::Record(it.get("on").is_none_or(|it| *it != false))),
        "correct" => {
            let rows = it.get("rows").and_then(Value::as_array).filter(|it| !it.is_empty() && it.len() <= MOST_ROWS);
            let rows = rows.ok_or_else(|| format!("found no `rows`, expected 1 to {MOST_ROWS}"))?.clone();
            Ok(Command::Correct { node: index(it, "node", n_nodes)?, rows })
        }
        "again" => Ok(Command::Again),
        "problems" => Ok(Command::Problems { node: index(it, "node", n_nodes)? }),
        "bookmark" => {
            let at_s = time(it, "at_s")?.as_s();
            let note = it.get("note").and_then(Value::as_str).unwrap_or_default();
            match note.chars().count() {
                0..=LONGEST_NOTE => Ok(Command::Bookmark { at_s, note: note.to_owned() }),
                n => Err(format!("found a note of {n} characters, expected at most {LONGEST_NOTE}")),
            }
        }
        other => Err(format!("found the command `{}`, expected one of docs/console.md", other.escape_debug())),
    }
}

/// Longest session time [s]: thirty years.
const LONGEST_S: f64 = 1e9;

fn time(it: &Value, name: &str) -> Result<Time, String> {
    let seconds = it.get(name).and_then(Value::as_f64).filter(|it| it.abs() <= LONGEST_S);
    seconds.map(Time::from_s).ok_or_else(|| format!("found {name} {}, expected a time in seconds", it[name]))
}

fn index(it: &Value, name: &str, n: usize) -> Result<usize, String> {
    let found = it.get(name).and_then(Value::as_u64).and_then(|it| usize::try_from(it).ok());
    found.filter(|it| *it < n).ok_or_else(|| format!("found {name} {}, expected a number below {n}", it[name]))
}

fn want(it: &Value, n_topics: usize, now: Instant) -> Result<Want, String> {
    let topic = index(it, "topic", n_topics)?;
    let kind = match it.get("as").and_then(Value::as_str).unwrap_or("value") {
        "value" => Kind::Value,
        "picture" => {
            let width = it.get("width").and_then(Value::as_u64).unwrap_or(0);
            Kind::Picture { width: u32::try_from(width).unwrap_or(0) }
        }
        "points" => Kind::Points,
        "mesh" => Kind::Mesh,
        other => {
            return Err(format!("found the form `{}`, expected value, picture, points or mesh", other.escape_debug()));
        }
    };
    Ok(Want::new(topic, kind, it.get("hz").and_then(Value::as_f64).unwrap_or(10.0), now))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_command_is_answered_with_what_was_expected() {
        for (text, words) in [
            ("", "no command"),
            ("[1,2]", "the command ``"),
            ("{\"do\":\"explode\",\"n\":3}", "`explode`"),
            ("{\"do\":\"set\",\"node\":2,\"values\":{\"a\":1}}", "node 2, expected a number below 2"),
            ("{\"do\":\"set\",\"node\":-1,\"values\":{\"a\":1}}", "node -1"),
            ("{\"do\":\"set\",\"node\":0,\"values\":{}}", "`values`"),
            ("{\"do\":\"set\",\"node\":0,\"values\":{\"a\":null}}", "`values`"),
            ("{\"do\":\"subscribe\",\"topics\":[{\"topic\":9}]}", "topic 9"),
            ("{\"do\":\"subscribe\",\"topics\":[{\"topic\":0,\"as\":\"soup\"}]}", "`soup`"),
            ("{\"do\":\"bookmark\"}", "at_s"),
        ] {
            let (what, _) = read(text, 3, 2).err().unwrap();
            assert!(what.contains(words), "{text}: {what}");
        }
        assert_eq!(read("{\"do\":\"explode\",\"n\":3}", 3, 2).err().unwrap().1, Some(3));
        let long = format!("{{\"do\":\"bookmark\",\"at_s\":1,\"note\":\"{}\"}}", "x".repeat(LONGEST_NOTE + 1));
        assert!(read(&long, 3, 2).is_err());
        let deep = "[".repeat(100_000);
        assert!(read(&deep, 3, 2).is_err());
    }

    #[test]
    fn a_rate_that_cannot_be_is_bounded() {
        for hz in ["1e300", "-5", "0", "null"] {
            let text = format!(
                "{{\"do\":\"subscribe\",\"topics\":[{{\"topic\":2,\"as\":\"picture\",\"width\":320,\"hz\":{hz}}}]}}"
            );
            let Ok((Command::Subscribe(wants), None)) = read(&text, 3, 2) else { panic!("{hz}") };
            assert_eq!((wants[0].topic, wants[0].kind), (2, Kind::Picture { width: 320 }));
        }
    }
}
