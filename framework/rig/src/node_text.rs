//! A node's table as written: the reserved keys taken out, the settings left as they are.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::grammar::connection::WHEN_FULL;
use crate::grammar::node::ON_ERROR;
use crate::grammar::{connection, node as grammar, requirement};
use crate::graph::{Cost, OnError, Queue, Requirement};
use foveate_diagnostics::value::{Keys, Value};
use foveate_diagnostics::{Findings, Span};
use foveate_messages::Interval;
use foveate_node::port::InputPolicy;

/// A node as written.
pub(super) struct NodeText<'t> {
    pub name: Spanned<String>,
    /// Where to point when the node as a whole is meant.
    pub header: Span,
    pub type_name: Option<Spanned<String>>,
    /// Whether a `type` stands there at all.
    pub has_type: bool,
    /// Patterns of names, of which those with a `!` leave cameras out; and where they stand.
    pub each: Option<Spanned<Vec<Spanned<String>>>>,
    pub camera: Option<Spanned<String>>,
    /// Whether one of the two stands there but was not understood.
    pub cameras_unclear: bool,
    pub inputs: Vec<InputText>,
    /// Whether all of `in` was understood.
    pub inputs_sound: bool,
    pub requires: Vec<RequireText>,
    pub on_error: OnError,
    pub cost: Cost,
    /// Where the cost stands, if it is not 0.
    pub cost_place: Option<Span>,
    /// All other keys.
    pub settings: DeTable<'t>,
}

/// What is connected to one input port, as written.
pub(super) struct InputText {
    pub port: Spanned<String>,
    pub from: Vec<Spanned<String>>,
    pub queue: Queue,
    /// Whether the rig states how many messages may wait.
    pub has_capacity: bool,
    /// Of a port that joins sources: how far their capture times may lie apart, and where that stands.
    pub tolerance: Option<(Interval, Span)>,
    /// Of a port that is sampled: how much later what comes is seen, and where that stands.
    pub delay: Option<(Interval, Span)>,
    /// How the port is to take data, and where that stands.
    pub policy: Option<(InputPolicy, Span)>,
}

/// What the edges into one port promise, as written.
pub(super) struct RequireText {
    pub port: Spanned<String>,
    pub requirement: Requirement,
    /// The age as written [ms], and where.
    pub age_ms: Option<(f64, Span)>,
    /// Where the rate stands.
    pub rate: Option<Span>,
}

impl<'t> NodeText<'t> {
    /// Takes the reserved keys out of a node's table.
    pub fn read(name: Spanned<String>, value: Value<'t>, text: &str, findings: &mut Findings) -> Option<Self> {
        let mut keys = findings.table(&name, value, text, "a table `[scale.NAME.node.NODE]`")?;
        let has_type = keys.table.contains_key(grammar::TYPE.name);
        let type_name = grammar::TYPE.text(&mut keys, findings);
        let n_camera_keys =
            [grammar::EACH, grammar::CAMERA].iter().filter(|it| keys.table.contains_key(it.name)).count();
        let each = keys.take(grammar::EACH.name).and_then(|it| read_patterns(it, findings));
        let camera = grammar::CAMERA.text(&mut keys, findings);
        if let (Some(each), Some(camera)) = (&each, &camera) {
            findings
                .error(camera.span(), "a node has `each` or `camera`, not both", "found `camera`")
                .also(each.span(), "and `each`");
        }
        let cameras_unclear = n_camera_keys != usize::from(each.is_some() != camera.is_some());
        let on_error = grammar::ON_ERROR_KEY.word(&ON_ERROR, &mut keys, findings).map(|it| it.0);
        let (cost, cost_place) = read_cost(&mut keys, findings);
        let before = findings.count();
        let mut inputs = Vec::new();
        if let Some((key, value)) = keys.take_entry(grammar::IN.name) {
            let ports = findings.table(&key, value, text, "a table: `in = { PORT = \"NODE.OUTPUT\" }`");
            for (port, value) in ports.map(|mut it| it.take_rest()).unwrap_or_default() {
                inputs.push(read_input(port, value, text, findings));
            }
        }
        let inputs_sound = findings.count() == before;
        let mut requires = Vec::new();
        if let Some((key, value)) = keys.take_entry(grammar::REQUIRE.name) {
            let ports = findings.table(&key, value, text, "a table: `require.PORT = { age_ms = 20 }`");
            for (port, value) in ports.map(|mut it| it.take_rest()).unwrap_or_default() {
                requires.extend(read_require(port, value, text, findings));
            }
        }
        let Keys { table: settings, header, .. } = keys;
        Some(Self {
            name,
            header,
            type_name,
            has_type,
            each,
            camera,
            cameras_unclear,
            inputs,
            inputs_sound,
            requires,
            on_error: on_error.unwrap_or_default(),
            cost,
            cost_place,
            settings,
        })
    }
}

/// One pattern or a list of them; `None` where one is no text.
fn read_patterns(value: Value<'_>, findings: &mut Findings) -> Option<Spanned<Vec<Spanned<String>>>> {
    let expected = "a pattern of camera names, \"wide-*\", or a list of them, [\"wide-*\", \"!wide-3\"]";
    let span = value.span();
    let patterns: Vec<Spanned<String>> = match value.get_ref() {
        DeValue::Array(items) if !items.is_empty() => {
            let read =
                items.iter().map(|it| findings.text("each", it.clone(), "a pattern of camera names: \"wide-*\""));
            read.collect::<Option<_>>()?
        }
        DeValue::String(_) => vec![findings.text("each", value, expected)?],
        _ => {
            findings.not_as_expected("each", &value, expected);
            return None;
        }
    };
    Some(Spanned::new(span, patterns))
}

fn read_cost(keys: &mut Keys<'_>, findings: &mut Findings) -> (Cost, Option<Span>) {
    let (time, jitter) = (grammar::COST_MS.number(keys, findings), grammar::COST_JITTER_MS.number(keys, findings));
    let time_ms = time.as_ref().map_or(0.0, |it| it.0);
    let place = time.filter(|it| it.0 > 0.0).map(|it| it.1);
    if let Some((jitter_ms, span)) = jitter.as_ref().filter(|it| it.0 > time_ms) {
        let label = format!("found {jitter_ms} ms, expected at most `cost_ms`, which is {time_ms} ms");
        findings.error(span.clone(), "an activation cannot take less than no time", label);
    }
    let jitter_ms = jitter.map_or(0.0, |it| it.0);
    (Cost { time: Interval::from_ms(time_ms), jitter: Interval::from_ms(jitter_ms) }, place)
}

fn read_input(port: Spanned<String>, value: Value<'_>, text: &str, findings: &mut Findings) -> InputText {
    let mut queue = Queue::default();
    let (mut policy, mut tolerance, mut delay, mut has_capacity) = (None, None, None, false);
    let from = match value.get_ref() {
        DeValue::Table(_) => match findings.table(&port, value, text, "") {
            Some(mut keys) => {
                has_capacity = keys.table.contains_key(connection::CAPACITY.name);
                let capacity = connection::CAPACITY.whole(&mut keys, findings);
                queue.capacity = capacity.and_then(|it| usize::try_from(it).ok()).unwrap_or(queue.capacity);
                let when_full = connection::WHEN_FULL_KEY.word(&WHEN_FULL, &mut keys, findings);
                queue.when_full = when_full.map_or(queue.when_full, |it| it.0);
                keys.renamed("take", connection::POLICY.name, findings);
                policy = connection::POLICY.word(&InputPolicy::CHOICES, &mut keys, findings);
                let stated = connection::TOLERANCE_MS.number(&mut keys, findings);
                tolerance = stated.map(|(ms, place)| (Interval::from_ms(ms), place));
                let stated = connection::DELAY_MS.number(&mut keys, findings);
                delay = stated.map(|(ms, place)| (Interval::from_ms(ms), place));
                let from = keys.take(connection::FROM.name);
                if from.is_none() {
                    let title = format!("port `{}` names no source", port.get_ref());
                    findings.error(keys.header.clone(), title, "expected `from = \"NODE.OUTPUT\"`");
                }
                keys.close("a connection", findings);
                from.map(|it| read_sources(&port, it, findings))
            }
            None => None,
        },
        _ => Some(read_sources(&port, value, findings)),
    };
    InputText { port, from: from.unwrap_or_default(), queue, has_capacity, tolerance, delay, policy }
}

fn read_sources(port: &Spanned<String>, value: Value<'_>, findings: &mut Findings) -> Vec<Spanned<String>> {
    let expected = "an output, \"NODE.OUTPUT\", or a list of them";
    let span = value.span();
    let sources: Vec<Spanned<String>> = match value.get_ref() {
        DeValue::String(_) => return findings.text(port.get_ref(), value, expected).into_iter().collect(),
        DeValue::Array(items) => items
            .iter()
            .filter_map(|it| findings.text(port.get_ref(), it.clone(), "an output: \"NODE.OUTPUT\""))
            .collect(),
        _ => {
            findings.not_as_expected(port.get_ref(), &value, expected);
            return Vec::new();
        }
    };
    if value.get_ref().as_array().is_some_and(|it| it.is_empty()) {
        findings
            .error(
                span,
                format_args!("port `{}` names no source", port.get_ref()),
                "found an empty list, expected outputs",
            )
            .help("leave the port out to keep it open");
    }
    sources
}

fn read_require(port: Spanned<String>, value: Value<'_>, text: &str, findings: &mut Findings) -> Option<RequireText> {
    let mut keys = findings.table(&port, value, text, "a table: `{ age_ms = 20, rate_hz = 30 }`")?;
    let mut read = RequireText { port, requirement: Requirement::default(), age_ms: None, rate: None };
    if let Some((age_ms, span)) = requirement::AGE_MS.number(&mut keys, findings) {
        read.requirement.age_s = Some(age_ms * 1e-3);
        read.age_ms = Some((age_ms, span));
    }
    if let Some((rate_hz, span)) = requirement::RATE_HZ.number(&mut keys, findings) {
        read.requirement.rate_hz = Some(rate_hz);
        read.rate = Some(span);
    }
    read.requirement.sigma = requirement::SIGMA.number(&mut keys, findings).map(|it| it.0);
    read.requirement.loss = requirement::LOSS.number(&mut keys, findings).map(|it| it.0);
    read.requirement.must = requirement::MUST.flag(&mut keys, findings).unwrap_or_default();
    keys.close("a requirement", findings);
    Some(read)
}
