//! `foveate figures`: what the figures of a summary mean.

use std::cmp::Reverse;
use std::collections::BTreeMap;
use std::fmt::Write;

use foveate_diagnostics::names::{likely, listed, matches};
use foveate_engine::{OF_BUDGETS, OF_SCALES};
use foveate_node::Registry;
use foveate_node::figure::{Better, FigureSpec};

use super::nodes::wrap;
use crate::exit;
use crate::output::say;
use crate::results::OF_THE_RUN;

/// Names that are suggested at most for one that is unknown.
const SUGGESTIONS: usize = 5;

/// How names of figures are written.
const NOTATION: &str = "`*` is a part that the rig decides, such as a camera's name; `{a,b}` is one of these; `(…)` may be missing.\n\
    `name[node]` in a summary is the same figure of a second node. Units without dimension: count; share (0 to 1);\n\
    ratio; sigmas (stated standard deviations). `null` in a summary: there was nothing to measure.\n";

pub(super) fn run(name: Option<&str>, registry: &Registry) -> u8 {
    match name.map_or_else(|| Ok(list(registry)), |it| explain(it, registry)) {
        Ok(text) => {
            say(&text);
            exit::DONE
        }
        Err(sentence) => super::complain(&sentence),
    }
}

/// A figure and those that report it: node types, or the run itself.
struct Entry {
    figure: &'static FigureSpec,
    origins: Vec<&'static str>,
}

/// All figures in short, grouped by what reports them.
pub fn list(registry: &Registry) -> String {
    let mut text = String::new();
    for (origin, figures) in groups(registry) {
        let _ = writeln!(text, "{origin}");
        let width = figures.iter().map(|it| it.name.len()).max().unwrap_or(0);
        for it in figures {
            let _ = writeln!(text, "  {:width$}  {}{}", it.name, it.unit, direction(it));
        }
        text.push('\n');
    }
    text += NOTATION;
    text += "`foveate figures NAME` explains one; NAME may hold `*`, or be the name of a node type.\n";
    text
}

/// Explains the figures that `query` names: a declared name, a name of a summary, a node type or a pattern with `*`.
///
/// # Errors
/// A sentence with the nearest names where no figure has that name.
pub fn explain(query: &str, registry: &Registry) -> Result<String, String> {
    let entries = entries(registry);
    let (found, others) = find(query, &entries);
    if found.is_empty() {
        return Err(unknown(query, &entries));
    }
    let mut text = String::new();
    for it in &found {
        let _ = writeln!(text, "{}  ({}{})", it.figure.name, it.figure.unit, direction(it.figure));
        for line in wrap(it.figure.line, 96) {
            let _ = writeln!(text, "    {line}");
        }
        let _ = writeln!(text, "    reported by {}", it.origins.join(", "));
    }
    for it in others {
        let _ = writeln!(text, "Less likely: {}, reported by {}", it.figure.name, it.origins.join(", "));
    }
    if found.iter().any(|it| it.figure.name.contains(['*', '{', '('])) {
        text.push('\n');
        text += NOTATION;
    }
    Ok(text)
}

/// What is meant by `query`, and what else it could be: a concrete name may fit several declarations, of which the most specific one is meant.
fn find<'e>(query: &str, entries: &'e [Entry]) -> (Vec<&'e Entry>, Vec<&'e Entry>) {
    let all = |fits: &dyn Fn(&Entry) -> bool| entries.iter().filter(|it| fits(it)).collect::<Vec<_>>();
    let is_declaration = query.contains(['*', '{', '(']);
    let exact = all(&|it| (is_declaration && it.figure.name == query) || it.origins.contains(&query));
    if !exact.is_empty() {
        return (exact, Vec::new());
    }
    if query.contains(['*', '?']) {
        return (all(&|it| it.figure.names().iter().any(|name| matches(query, name))), Vec::new());
    }
    // `name[node]` is the figure `name` of a second node.
    let plain = query.split_once('[').map_or(query, |it| it.0);
    for name in [query, plain] {
        let fitting = all(&|it| it.figure.declares(name));
        if let Some(most) = fitting.iter().map(|it| literal_length(it.figure, name)).max() {
            return fitting.into_iter().partition(|it| literal_length(it.figure, name) == most);
        }
    }
    (Vec::new(), Vec::new())
}

/// Letters of `name` that the declaration states, not counting those that a `*` takes.
fn literal_length(figure: &FigureSpec, name: &str) -> usize {
    let fitting = figure.names().into_iter().filter(|it| matches(it, name));
    fitting.map(|it| it.len() - it.matches('*').count()).max().unwrap_or(0)
}

/// What reports figures, and which: the run first, then node types by name.
fn groups(registry: &Registry) -> impl Iterator<Item = (&'static str, Vec<&'static FigureSpec>)> + '_ {
    let of_the_run = OF_THE_RUN.iter().chain(OF_SCALES).chain(OF_BUDGETS).collect();
    let of_nodes = registry.iter().filter(|it| !it.figures.is_empty()).map(|it| (it.name, it.figures.iter().collect()));
    [("every run", of_the_run)].into_iter().chain(of_nodes)
}

/// Each declaration once, with all that report it.
fn entries(registry: &Registry) -> Vec<Entry> {
    let mut entries: Vec<Entry> = Vec::new();
    let mut places: BTreeMap<(&str, &str), usize> = BTreeMap::new();
    for (origin, figures) in groups(registry) {
        for figure in figures {
            let place = *places.entry((figure.name, figure.line)).or_insert(entries.len());
            if place == entries.len() {
                entries.push(Entry { figure, origins: Vec::new() });
            }
            entries[place].origins.push(origin);
        }
    }
    entries
}

fn direction(figure: &FigureSpec) -> &'static str {
    match figure.better {
        Better::Low => ", low is better",
        Better::High => ", high is better",
        Better::Neither => "",
    }
}

/// The complaint about a name that is not declared, with the nearest ones.
fn unknown(query: &str, entries: &[Entry]) -> String {
    let names: Vec<String> = entries.iter().flat_map(|it| it.figure.names()).collect();
    let mut near: Vec<&str> = Vec::new();
    while near.len() < SUGGESTIONS {
        let left = names.iter().map(String::as_str).filter(|it| !near.contains(it));
        match likely(query, left) {
            Some(it) => near.push(it),
            None => break,
        }
    }
    // Then those that begin in the same way.
    let shared = |name: &str| query.bytes().zip(name.bytes()).take_while(|it| it.0 == it.1).count();
    let mut alike: Vec<&str> = names.iter().map(String::as_str).filter(|it| shared(it) >= 4).collect();
    alike.sort_by_key(|it| Reverse(shared(it)));
    for it in alike {
        if near.len() < SUGGESTIONS && !near.contains(&it) {
            near.push(it);
        }
    }
    let near = listed(near).map_or(String::new(), |it| format!(" (nearest: {it})"));
    format!("no figure is named `{query}`{near}; `foveate figures` lists them all")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_unknown_name_ends_with_the_code_of_wrong_input() {
        let registry = crate::registry();
        assert_eq!(run(Some("no.such.figure"), &registry), exit::INPUT);
        assert_eq!(run(Some("gaps"), &registry), exit::DONE);
    }

    #[test]
    fn the_most_specific_declaration_is_meant() {
        const WIDE: FigureSpec =
            FigureSpec { name: "*.{median,p90}", unit: "m", better: Better::Low, line: "Of a path", headline: None };
        const NARROW: FigureSpec = FigureSpec {
            name: "error_mm.{median,p95}",
            unit: "mm",
            better: Better::Low,
            line: "Of a target",
            headline: None,
        };
        let entries = [&WIDE, &NARROW].map(|figure| Entry { figure, origins: vec!["test.node"] });
        let (meant, others) = find("error_mm.median", &entries);
        assert_eq!(meant.iter().map(|it| it.figure).collect::<Vec<_>>(), [&NARROW]);
        assert_eq!(others.iter().map(|it| it.figure).collect::<Vec<_>>(), [&WIDE]);
        assert_eq!(find("error_mm.p90", &entries).0[0].figure, &WIDE);
        assert!(find("error_mm.p96", &entries).0.is_empty());
    }
}
