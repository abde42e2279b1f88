//! Budgets as written, `[[budget]]`: read, and their two ends looked up.

use std::collections::HashMap;

use foveate_messages::CameraId;
use toml::Spanned;
use toml::de::DeValue;

use super::grammar::budget as grammar;
use super::lookup::{Names, outputs};
use super::nodes::NodeDraft;
use super::reference::{Reference, place_of_part};
use foveate_diagnostics::names::{likely, listed, shown};
use foveate_diagnostics::value::Value;
use foveate_diagnostics::{Findings, Span};
use foveate_node::port::InputSpec;

/// More budgets than that are refused: each is followed through the whole rig.
const MOST_BUDGETS: usize = 1000;

/// A budget as written.
pub(super) struct BudgetText {
    pub from: Option<Spanned<String>>,
    pub to: Option<Spanned<String>>,
    /// The age [ms], and where it stands.
    pub age_ms: Option<(f64, Span)>,
    pub must: bool,
    /// Where to point when the budget as a whole is meant.
    pub header: Span,
}

/// A budget whose ends exist.
pub(super) struct BudgetDraft<'r> {
    pub from: Place,
    pub to: Place,
    pub from_text: &'r Spanned<String>,
    pub to_text: &'r Spanned<String>,
    pub age_ms: f64,
    pub age_place: Span,
    pub must: bool,
}

/// A port of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Place {
    pub node: usize,
    pub port: Port,
    /// The camera whose instance is meant, where the rig names one.
    pub camera: Option<CameraId>,
}

/// The number of a port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) enum Port {
    Output(usize),
    Input(usize),
}

/// Reads the list of budgets.
pub(super) fn read(key: &Spanned<String>, value: Value<'_>, text: &str, findings: &mut Findings) -> Vec<BudgetText> {
    let expected = "tables `[[budget]]`";
    let span = value.span();
    if !matches!(value.get_ref(), DeValue::Array(_)) {
        findings.not_as_expected(key.get_ref(), &value, expected);
        return Vec::new();
    }
    let DeValue::Array(items) = value.into_inner() else { return Vec::new() };
    if items.len() > MOST_BUDGETS {
        let label = format!("found {}, expected at most {MOST_BUDGETS}", items.len());
        findings.error(span, "this rig has too many budgets", label);
        return Vec::new();
    }
    items.into_iter().filter_map(|it| read_one(key, it, text, expected, findings)).collect()
}

fn read_one(
    key: &Spanned<String>,
    value: Value<'_>,
    text: &str,
    expected: &str,
    findings: &mut Findings,
) -> Option<BudgetText> {
    let mut keys = findings.table(key, value, text, expected)?;
    let header = keys.header.clone();
    let needed =
        [(grammar::FROM, "\"SCALE.NODE.OUTPUT\""), (grammar::TO, "\"SCALE.NODE.PORT\""), (grammar::AGE_MS, "30")];
    for (key, example) in needed.iter().filter(|it| !keys.table.contains_key(it.0.name)) {
        let label = format!("expected `{} = {example}` here", key.name);
        findings.error(header.clone(), format_args!("a budget lacks `{}`", key.name), label);
    }
    let budget = BudgetText {
        from: grammar::FROM.text(&mut keys, findings),
        to: grammar::TO.text(&mut keys, findings),
        age_ms: grammar::AGE_MS.number(&mut keys, findings),
        must: grammar::MUST.flag(&mut keys, findings).unwrap_or_default(),
        header,
    };
    keys.close("a budget", findings);
    Some(budget)
}

/// Looks up both ends of each budget; what is not found, or stands there twice, is reported.
pub(super) fn look_up<'r>(
    names: &Names<'_, '_>,
    budgets: &'r [BudgetText],
    findings: &mut Findings,
) -> Vec<BudgetDraft<'r>> {
    let mut drafts = Vec::new();
    let mut known: HashMap<(Place, Place), &Span> = HashMap::new();
    for budget in budgets {
        let from = budget.from.as_ref().and_then(|it| place(names, it, false, findings));
        let to = budget.to.as_ref().and_then(|it| place(names, it, true, findings));
        let (Some(from), Some(to)) = (from, to) else { continue };
        if let Some(&earlier) = known.get(&(from, to)) {
            findings
                .error(budget.header.clone(), "this budget stands here twice", "found the same `from` and `to` again")
                .also(earlier.clone(), "they stand here already");
            continue;
        }
        known.insert((from, to), &budget.header);
        if let (Some(from_text), Some(to_text), Some((age_ms, age_place))) = (&budget.from, &budget.to, &budget.age_ms)
        {
            let (age_ms, age_place) = (*age_ms, age_place.clone());
            drafts.push(BudgetDraft { from, to, from_text, to_text, age_ms, age_place, must: budget.must });
        }
    }
    drafts
}

/// The output that a reference names, or, at the end of a path, also the input.
fn place(names: &Names<'_, '_>, reference: &Spanned<String>, is_end: bool, findings: &mut Findings) -> Option<Place> {
    let written = reference.get_ref();
    let parts = Reference::parse(written);
    let Some(parts) = parts.as_ref().filter(|it| it.scale.is_some()) else {
        findings
            .error(
                reference.span(),
                format_args!("`{}` does not name a port with its scale", shown(written)),
                format_args!("expected \"SCALE.NODE.{0}\" or \"SCALE.NODE[CAMERA].{0}\"", port_word(is_end)),
            )
            .maybe_help(meant(names, written, parts.as_ref()));
        return None;
    };
    let (node, camera) = names.node_and_camera(reference, parts, 0, findings)?;
    let draft = &names.nodes[node];
    let node_type = draft.node_type.as_ref()?;
    let name = &written[parts.output.clone()];
    let output = outputs(draft).position(|it| it.name == name).map(Port::Output);
    let input = || inputs(draft).position(|it| it.name == name).map(Port::Input);
    if let Some(port) = output.or_else(|| if is_end { input() } else { None }) {
        return Some(Place { node, port, camera });
    }
    let known: Vec<&str> =
        outputs(draft).map(|it| it.name).chain(inputs(draft).map(|it| it.name).filter(|_| is_end)).collect();
    let all = listed(&known).map_or("it has none".to_owned(), |it| format!("it has {it}"));
    let word = if is_end { "port" } else { "output" };
    findings
        .error(
            place_of_part(names.text, reference, &parts.output),
            format_args!("`{}` has no {word} `{}`", shown(&draft.name()), shown(&name)),
            format_args!("expected an output of `{}`{}", node_type.name, if is_end { ", or an input" } else { "" }),
        )
        .help(match likely(name, known) {
            Some(meant) => format!("did you mean `{meant}`? {all}"),
            None => all,
        });
    None
}

fn port_word(is_end: bool) -> &'static str {
    if is_end { "PORT" } else { "OUTPUT" }
}

fn inputs<'n>(node: &'n NodeDraft<'_>) -> impl Iterator<Item = &'n InputSpec> {
    node.node_type.iter().flat_map(|it| &it.ports.inputs)
}

/// What a reference without a scale, or without a port, probably means.
fn meant(names: &Names<'_, '_>, written: &str, parts: Option<&Reference>) -> Option<String> {
    let parts = parts?;
    let node = &written[parts.node.clone()];
    let named = names.nodes.iter().filter(|it| it.name() == node);
    let with_scale = listed(named.map(|it| format!("{}.{written}", names.scales[it.scale].name)));
    if let Some(known) = with_scale {
        return Some(format!("did you mean {known}?"));
    }
    let of_scale = names
        .nodes
        .iter()
        .find(|it| names.scales[it.scale].name == node && *it.name() == written[parts.output.clone()])?;
    let ports = listed(outputs(of_scale).map(|it| format!("{written}.{}", it.name)))?;
    Some(format!("the outputs of `{written}`: {ports}"))
}
