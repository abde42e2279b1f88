//! The keys of a rig's own tables. Each key is declared here once, with its purpose, its values and its default; the reader, the schema
//! and the writer of resolved rigs all use this declaration.

use serde_json::{Map, Value as Json, json};
use toml::Spanned;

use crate::values::read_point;
use foveate_diagnostics::names::one_of;
use foveate_diagnostics::value::Keys;
use foveate_diagnostics::{Findings, Span};

/// What a key takes.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kind {
    /// A text; how messages describe it, and the regular expression that it matches.
    Text(&'static str, Option<&'static str>),
    /// A number within a range, in a unit.
    Number(Range, &'static str),
    /// A whole number from the first to the second.
    Whole(i64, i64),
    /// True or false.
    Flag,
    /// One of a few words.
    Word(&'static [&'static str]),
    /// Three numbers [m].
    Point,
    /// Something with parts of its own: described and read where it belongs.
    Other,
}

/// Numbers that are taken; infinite ones never are.
#[derive(Debug, Clone, Copy)]
pub(super) enum Range {
    /// More than 0.
    Positive,
    /// More than 0, at most this.
    PositiveTo(f64),
    /// From the first to the second.
    Within(f64, f64),
}

impl Range {
    fn holds(self, number: f64) -> bool {
        match self {
            Range::Positive => number > 0.0 && number.is_finite(),
            Range::PositiveTo(most) => number > 0.0 && number <= most,
            Range::Within(least, most) => (least..=most).contains(&number),
        }
    }

    fn in_words(self) -> String {
        match self {
            Range::Positive => "more than 0".to_owned(),
            Range::PositiveTo(most) => format!("more than 0 and at most {most:e}"),
            Range::Within(least, most) => format!("{least} to {most}"),
        }
    }
}

/// A key of one of a rig's tables.
#[derive(Debug, Clone, Copy)]
pub(super) struct Key {
    pub name: &'static str,
    /// What it is for; its unit in brackets at the end.
    pub doc: &'static str,
    pub kind: Kind,
    /// What holds where the key is left out, if anything does.
    pub default: Option<fn() -> Json>,
}

impl Key {
    const fn new(name: &'static str, kind: Kind, doc: &'static str) -> Key {
        Key { name, doc, kind, default: None }
    }

    const fn or(self, default: fn() -> Json) -> Key {
        Key { default: Some(default), ..self }
    }

    /// The key's JSON Schema.
    pub fn schema(&self) -> Json {
        let mut schema = match self.kind {
            Kind::Text(_, None) => json!({ "type": "string" }),
            Kind::Text(_, Some(pattern)) => json!({ "type": "string", "pattern": pattern }),
            Kind::Number(Range::Positive, _) => json!({ "type": "number", "exclusiveMinimum": 0 }),
            Kind::Number(Range::PositiveTo(most), _) => {
                json!({ "type": "number", "exclusiveMinimum": 0, "maximum": most })
            }
            Kind::Number(Range::Within(least, most), _) => {
                json!({ "type": "number", "minimum": least, "maximum": most })
            }
            Kind::Whole(least, most) => json!({ "type": "integer", "minimum": least, "maximum": most }),
            Kind::Flag => json!({ "type": "boolean" }),
            Kind::Word(words) => json!({ "enum": words }),
            Kind::Point => json!({ "type": "array", "items": { "type": "number" }, "minItems": 3, "maxItems": 3 }),
            Kind::Other => json!({}),
        };
        schema["description"] = json!(self.doc);
        if let Some(default) = self.default {
            schema["default"] = default();
        }
        schema
    }

    /// What the key takes, in words.
    fn expected(&self) -> String {
        match self.kind {
            Kind::Text(expected, _) => expected.to_owned(),
            Kind::Number(range, unit) => format!("{} [{unit}]", range.in_words()),
            Kind::Whole(least, most) => format!("a whole number from {least} to {most}"),
            Kind::Flag => "true or false".to_owned(),
            Kind::Word(words) => one_of(words),
            Kind::Point => "three numbers [m]".to_owned(),
            Kind::Other => String::new(),
        }
    }

    /// The text that stands at this key of `keys`.
    pub fn text(&self, keys: &mut Keys<'_>, findings: &mut Findings) -> Option<Spanned<String>> {
        let value = keys.take(self.name)?;
        findings.text(self.name, value, &self.expected())
    }

    /// The number that stands at this key of `keys`, and where.
    pub fn number(&self, keys: &mut Keys<'_>, findings: &mut Findings) -> Option<(f64, Span)> {
        let value = keys.take(self.name)?;
        let Kind::Number(range, _) = self.kind else { return None };
        let found = findings.number(self.name, &value, &self.expected(), |it| range.holds(it))?;
        Some((found, value.span()))
    }

    /// The whole number that stands at this key of `keys`.
    pub fn whole(&self, keys: &mut Keys<'_>, findings: &mut Findings) -> Option<i64> {
        let value = keys.take(self.name)?;
        let Kind::Whole(least, most) = self.kind else { return None };
        findings.whole(self.name, &value, least, most)
    }

    /// The flag that stands at this key of `keys`.
    pub fn flag(&self, keys: &mut Keys<'_>, findings: &mut Findings) -> Option<bool> {
        let value = keys.take(self.name)?;
        findings.flag(self.name, &value)
    }

    /// Which of `choices` stands at this key of `keys`, and where.
    pub fn word<T: Copy>(
        &self,
        choices: &[(&str, T)],
        keys: &mut Keys<'_>,
        findings: &mut Findings,
    ) -> Option<(T, Span)> {
        let value = keys.take(self.name)?;
        Some((findings.choice(self.name, &value, choices)?, value.span()))
    }

    /// The point that stands at this key of `keys` [m].
    pub fn point(&self, keys: &mut Keys<'_>, findings: &mut Findings) -> Option<[f64; 3]> {
        let value = keys.take(self.name)?;
        read_point(self.name, &value, findings)
    }
}

/// JSON Schema of a table that holds these keys and no others.
pub(super) fn table(description: &str, keys: &[&Key], required: &[&Key]) -> Json {
    let properties: Map<String, Json> = keys.iter().map(|it| (it.name.to_owned(), it.schema())).collect();
    let mut schema = json!({
        "description": description,
        "type": "object",
        "properties": properties,
        "additionalProperties": false
    });
    if !required.is_empty() {
        schema["required"] = required.iter().map(|it| it.name).collect();
    }
    schema
}

/// The words of a list of choices.
const fn words<T, const N: usize>(choices: &[(&'static str, T); N]) -> [&'static str; N] {
    let mut words = [""; N];
    let mut index = 0;
    while index < N {
        words[index] = choices[index].0;
        index += 1;
    }
    words
}

/// `[rig]`.
pub(super) mod rig {
    use super::*;

    pub const NAME: Key = Key::new(
        "name",
        Kind::Text("a text", Some("^[a-z0-9_-]+$")),
        "Results are filed under it: lower-case letters, digits, `_` and `-`.",
    );
    pub const CALIBRATION: Key = Key::new(
        "calibration",
        Kind::Text("the path of a file", None),
        "The cameras: a file, or a folder with results of MultiCamSelfCal. `${NAME}` is an environment variable.",
    );
    pub const FOLDER: Key = Key::new(
        "folder",
        Kind::Text("the path of a folder", None),
        "Where relative paths start; left out: where this file lies.",
    );
    pub const SEED: Key =
        Key::new("seed", Kind::Whole(0, i64::MAX), "Of all random numbers: the same seed gives the same results.")
            .or(|| json!(1));
    /// Longest run [s].
    pub const LONGEST_S: f64 = 9e9;
    pub const DURATION_S: Key = Key::new(
        "duration_s",
        Kind::Number(Range::PositiveTo(LONGEST_S), "s"),
        "Where simulated and file-fed sources are cut off [s].",
    );
    pub const REPORT_SPEED: Key = Key::new(
        "report_speed",
        Kind::Flag,
        "Whether `summary.json` has the `real_time_factor` too, the one line in it that then differs from run to run.",
    )
    .or(|| json!(false));
    pub const PACED: Key = Key::new(
        "paced",
        Kind::Flag,
        "Whether `foveate run` keeps to the pace of the wall clock, for people and programs that watch; the results are the same.",
    )
    .or(|| json!(false));
    pub const ALL: [&Key; 7] = [&NAME, &FOLDER, &CALIBRATION, &SEED, &DURATION_S, &REPORT_SPEED, &PACED];
}

/// `[plugins]`.
pub(super) mod plugins {
    use super::*;

    pub const LIBRARIES: Key = Key::new(
        "libraries",
        Kind::Other,
        "Shared libraries that `foveate plugin build` made, by path; their node types can be used in this rig.",
    );
    pub const ALL: [&Key; 1] = [&LIBRARIES];
}

/// `[[budget]]`.
pub(super) mod budget {
    use super::*;

    pub const FROM: Key = Key::new(
        "from",
        Kind::Text("an output: \"SCALE.NODE.OUTPUT\"", Some("^[^.\\[\\]]+\\.[^.\\[\\]]+(\\[.+\\])?\\.[^.\\[\\]]+$")),
        "The output at which the path begins: SCALE.NODE.OUTPUT or SCALE.NODE[CAMERA].OUTPUT.",
    );
    pub const TO: Key = Key {
        name: "to",
        doc: "The port at which the path ends: an output, or an input such as that of an actuator; an output where both have that name.",
        ..FROM
    };
    pub const AGE_MS: Key = Key::new(
        "age_ms",
        Kind::Number(Range::Positive, "ms"),
        "Age of what leaves or arrives there, from the capture of what it was made of, 99th percentile, at most [ms].",
    );
    pub const MUST: Key = super::requirement::MUST;
    pub const ALL: [&Key; 4] = [&FROM, &TO, &AGE_MS, &MUST];
}

/// `[record]`.
pub(super) mod record {
    use super::*;
    use crate::record::{FORMS, PACKINGS};

    pub const FILE: Key = Key::new(
        "file",
        Kind::Text("the path of a file `….mcap`", None),
        "The session; left out: `session.mcap` in the results folder.",
    );
    pub const PICTURES: Key = Key::new("pictures", Kind::Word(&const { words(&FORMS) }), "How pictures are recorded.")
        .or(|| json!("lossless"));
    pub const JPEG_QUALITY: Key =
        Key::new("jpeg_quality", Kind::Whole(1, 100), "Quality of pictures that are recorded as JPEG.")
            .or(|| json!(90));
    pub const CAMERAS: Key = Key::new(
        "cameras",
        Kind::Other,
        "How the pictures of single cameras are recorded, by name or pattern; the first that matches decides.",
    );
    pub const HIDE_PX: Key = Key::new(
        "hide_px",
        Kind::Other,
        "Parts of pictures that are recorded black, by camera or pattern: rectangles `[left, top, width, height]` [px].",
    );
    pub const HIDE_SCALES: Key = Key::new(
        "hide_scales",
        Kind::Other,
        "Scales, such as a face, that are recorded black in pictures of other scales; their own pictures are not recorded.",
    );
    pub const COMPRESSION: Key =
        Key::new("compression", Kind::Word(&const { words(&PACKINGS) }), "How the file is compressed.")
            .or(|| json!("lz4"));
    pub const MEMORY_MB: Key = Key::new(
        "memory_mb",
        Kind::Whole(16, 1_000_000),
        "What may wait for the disk; beyond that a live run leaves pictures out [MB].",
    )
    .or(|| json!(256));
    pub const ALL: [&Key; 8] =
        [&FILE, &PICTURES, &JPEG_QUALITY, &CAMERAS, &HIDE_PX, &HIDE_SCALES, &COMPRESSION, &MEMORY_MB];
}

/// `[scale.NAME]`.
pub(super) mod scale {
    use super::*;

    pub const PARENT: Key =
        Key::new("parent", Kind::Text("the name of a scale", None), "The scale that this one nests in.");
    pub const ANCHOR: Key = Key::new(
        "anchor",
        Kind::Text("a target: \"NODE.TARGET\"", Some("^[^.]+\\..+$")),
        "The target that this scale's space moves with: a node of the parent that gives targets, a dot, the name of a target; \
         `[scale.PARENT.target.NAME]` says how that target is picked.",
    );
    pub const VOLUME_M: Key =
        Key::new("volume_m", Kind::Other, "Where targets can be, in this scale's space: opposite corners [m].");
    pub const RADIUS_M: Key =
        Key::new("radius_m", Kind::Number(Range::Positive, "m"), "How far around its anchor this scale reaches [m].");
    pub const TARGET: Key = Key::new("target", Kind::Other, "Names for targets that scales can be anchored to.");
    pub const NODE: Key = Key::new("node", Kind::Other, "The nodes by name.");
    pub const ALL: [&Key; 6] = [&PARENT, &ANCHOR, &VOLUME_M, &RADIUS_M, &TARGET, &NODE];
}

/// `[scale.NAME.target.TARGET]`.
pub(super) mod target {
    use foveate_scene::AnchorRule;

    use super::*;

    /// Nanoseconds.
    pub const NS_PER_MS: f64 = 1e6;
    pub const NS_PER_S: f64 = 1e9;
    /// Longest time that a target has to last, or may be unseen [ms].
    const LONGEST_MS: f64 = 3_600_000.0;
    /// Longest time of searching near the place of a loss [s].
    const LONGEST_S: f64 = 3_600.0;

    /// A word of `pick`.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Word {
        First,
        Highest,
        Lowest,
        Nearest,
        Id,
    }

    /// The words of `pick`.
    pub const PICKS: [(&str, Word); 5] = [
        ("first", Word::First),
        ("highest", Word::Highest),
        ("lowest", Word::Lowest),
        ("nearest", Word::Nearest),
        ("id", Word::Id),
    ];

    const PICK_WORDS: [&str; PICKS.len()] = words(&PICKS);
    pub const PICK: Key = Key::new(
        "pick",
        Kind::Word(&PICK_WORDS),
        "The one of smallest identity, of greatest or smallest z, the nearest to `near_m`, or the one numbered `id`.",
    )
    .or(|| json!("first"));
    pub const NEAR_M: Key =
        Key::new("near_m", Kind::Point, "With `pick = \"nearest\"`: nearest to this place in the scale's space [m].");
    pub const ID: Key =
        Key::new("id", Kind::Whole(0, u32::MAX as i64), "With `pick = \"id\"`: the number of the target.");
    pub const OFFSET_M: Key = Key::new(
        "offset_m",
        Kind::Point,
        "Offset from the target to the anchor point, in the axes of the scale's space: a face lies below a light on the head [m].",
    )
    .or(|| json!([0.0, 0.0, 0.0]));
    pub const KEEP: Key = Key::new(
        "keep",
        Kind::Flag,
        "Whether the name stays with its target as long as the target exists; otherwise it moves to the target that `pick` selects now.",
    )
    .or(|| json!(AnchorRule::default().keep));
    pub const SETTLE_MS: Key = Key::new(
        "settle_ms",
        Kind::Number(Range::Within(0.0, LONGEST_MS), "ms"),
        "A target gets the name once `pick` has selected it for this long, so that a momentary detection does not [ms].",
    )
    .or(|| json!(AnchorRule::default().settle_ns as f64 / NS_PER_MS));
    pub const LOST_MS: Key = Key::new(
        "lost_ms",
        Kind::Number(Range::Within(1.0, LONGEST_MS), "ms"),
        "A target that was not measured for longer than this is lost [ms].",
    )
    .or(|| json!(AnchorRule::default().lost_ns as f64 / NS_PER_MS));
    pub const AGAIN_WITHIN_M: Key = Key::new(
        "again_within_m",
        Kind::Number(Range::Positive, "m"),
        "After a loss, only targets within this distance of its last position are picked, for `again_s`, the nearest first; left out: anywhere, by `pick` [m].",
    );
    pub const AGAIN_S: Key = Key::new(
        "again_s",
        Kind::Number(Range::Within(0.001, LONGEST_S), "s"),
        "How long `again_within_m` holds after a loss [s].",
    )
    .or(|| json!(AnchorRule::default().again_ns as f64 / NS_PER_S));
    pub const ALL: [&Key; 9] = [&PICK, &NEAR_M, &ID, &OFFSET_M, &KEEP, &SETTLE_MS, &LOST_MS, &AGAIN_WITHIN_M, &AGAIN_S];
}

/// What a node's table may hold beside its settings.
pub(super) mod node {
    use super::*;
    use crate::graph::OnError;

    /// Names of [`OnError`] in rigs.
    pub const ON_ERROR: [(&str, OnError); 3] =
        [("stop", OnError::Stop), ("skip", OnError::Skip), ("restart", OnError::Restart)];

    /// Longest activation [ms].
    const LONGEST_COST_MS: f64 = 60_000.0;

    pub const TYPE: Key =
        Key::new("type", Kind::Text("the name of a node type", None), "The node type; `foveate nodes` lists them.");
    pub const EACH: Key = Key::new(
        "each",
        Kind::Other,
        "One instance for each camera of that name; `*` matches any characters, `?` one. A list takes every camera that one of its patterns matches; \
         `!` before a pattern leaves out what it matches.",
    );
    pub const CAMERA: Key =
        Key::new("camera", Kind::Text("the name of a camera", None), "The one camera that it serves.");
    const ON_ERROR_WORDS: [&str; ON_ERROR.len()] = words(&ON_ERROR);
    pub const ON_ERROR_KEY: Key = Key::new(
        "on_error",
        Kind::Word(&ON_ERROR_WORDS),
        "What happens when it fails on a message: it stops, the message is dropped, or it is restarted.",
    )
    .or(|| json!("stop"));
    pub const COST_MS: Key = Key::new(
        "cost_ms",
        Kind::Number(Range::Within(0.0, LONGEST_COST_MS), "ms"),
        "How long an activation keeps it busy on the logical clock of a run that is not live [ms].",
    )
    .or(|| json!(0));
    pub const COST_JITTER_MS: Key = Key::new(
        "cost_jitter_ms",
        Kind::Number(Range::Within(0.0, LONGEST_COST_MS), "ms"),
        "By how much the cost of an activation varies up and down, uniformly [ms].",
    )
    .or(|| json!(0));
    pub const IN: Key = Key::new("in", Kind::Other, "What each input takes.");
    pub const REQUIRE: Key = Key::new("require", Kind::Other, "What the edges into each input promise.");
    pub const ALL: [&Key; 8] = [&TYPE, &EACH, &CAMERA, &ON_ERROR_KEY, &COST_MS, &COST_JITTER_MS, &IN, &REQUIRE];
}

/// A connection written as a table: `in.PORT = { from = "…" }`.
pub(super) mod connection {
    use super::*;
    use crate::graph::{Queue, WhenFull};
    use foveate_node::port::InputPolicy;

    /// Longest queue: more messages than that are a mistake, and memory.
    const MOST_QUEUED: i64 = 1_000_000;
    /// Capture times of one set lie at most so far apart [ms].
    const MOST_TOLERANCE_MS: f64 = 60_000.0;
    /// Longest delay of an edge [ms].
    const MOST_DELAY_MS: f64 = 60_000.0;

    pub const FROM: Key = Key::new("from", Kind::Other, "NODE.OUTPUT, SCALE.NODE.OUTPUT or NODE[CAMERA].OUTPUT");
    pub const CAPACITY: Key = Key::new("capacity", Kind::Whole(1, MOST_QUEUED), "Messages that may wait.")
        .or(|| json!(Queue::default().capacity));
    /// Names of [`WhenFull`] in rigs.
    pub const WHEN_FULL: [(&str, WhenFull); 3] =
        [("drop_oldest", WhenFull::DropOldest), ("drop_newest", WhenFull::DropNewest), ("wait", WhenFull::Wait)];

    const WHEN_FULL_WORDS: [&str; WHEN_FULL.len()] = words(&WHEN_FULL);
    pub const WHEN_FULL_KEY: Key = Key::new(
        "when_full",
        Kind::Word(&WHEN_FULL_WORDS),
        "What happens to one more: an old one is dropped, the new one is dropped, or its sender waits.",
    )
    .or(|| json!("drop_oldest"));
    const POLICY_WORDS: [&str; InputPolicy::CHOICES.len()] = words(&InputPolicy::CHOICES);
    pub const POLICY: Key = Key::new(
        "policy",
        Kind::Word(&POLICY_WORDS),
        "Which of the waiting messages it takes when its node is free; the others are dropped and counted.",
    );
    pub const DELAY_MS: Key = Key::new(
        "delay_ms",
        Kind::Number(Range::Within(0.0, MOST_DELAY_MS), "ms"),
        "Delay after which messages on this edge are seen, in runs that are not live [ms]. Left out: feedback into a camera's nodes that run ahead of the rest \
         is seen one period of the camera later, everything else at once.",
    );
    pub const TOLERANCE_MS: Key = Key::new(
        "tolerance_ms",
        Kind::Number(Range::Within(0.0, MOST_TOLERANCE_MS), "ms"),
        "How far apart the capture times of one set may lie [ms].",
    );
}

/// What the edges into a port promise: `require.PORT`.
pub(super) mod requirement {
    use super::*;

    pub const AGE_MS: Key =
        Key::new("age_ms", Kind::Number(Range::Positive, "ms"), "Age at delivery, 99th percentile, at most [ms].");
    pub const RATE_HZ: Key =
        Key::new("rate_hz", Kind::Number(Range::Positive, "Hz"), "Messages a second, at least [Hz].");
    pub const SIGMA: Key = Key::new(
        "sigma",
        Kind::Number(Range::Positive, "px or m"),
        "Mean standard deviation that the payload states, at most [px or m].",
    );
    pub const LOSS: Key = Key::new(
        "loss",
        Kind::Number(Range::Within(0.0, 1.0), "–"),
        "Fraction of the messages that were lost, at most [–].",
    );
    pub const MUST: Key =
        Key::new("must", Kind::Flag, "Whether not meeting it fails the run, with exit code 3.").or(|| json!(false));
    pub const ALL: [&Key; 5] = [&AGE_MS, &RATE_HZ, &SIGMA, &LOSS, &MUST];
}

#[cfg(test)]
mod tests {
    #[test]
    fn authors_of_nodes_know_the_words_that_rigs_take() {
        assert_eq!(super::node::ALL.map(|it| it.name), foveate_node::registry::RIG_WORDS);
    }
}
