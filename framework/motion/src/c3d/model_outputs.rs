//! Points of a C3D file that are outputs of a body model, not positions.
//!
//! Programs that compute joint angles, forces, moments and powers store them as points, three numbers each, and list their labels in `POINT:ANGLES`, `POINT:FORCES` and so on, with
//! `ANGLES2`, `ANGLES3`, … where one parameter does not hold them all. `POINT:TYPE_GROUPS` names more such lists, each with its kind, whose unit is `POINT:KIND_UNITS`.

use std::collections::{BTreeMap, BTreeSet};

use super::ModelOutputs;
use super::parameters::Parameters;
use crate::forms::unit_length;

/// Lists that are known, whatever their units: scalars can be lengths and are no places either.
const KNOWN: [&str; 6] = ["ANGLES", "FORCES", "MOMENTS", "POWERS", "REACTIONS", "SCALARS"];

/// A label without the name of a subject before it.
fn without_subject(label: &str) -> &str {
    label.rsplit(':').next().unwrap_or(label).trim()
}

/// Those among `labels`, by the lists of the group `POINT`.
pub(super) fn model_outputs(parameters: &Parameters<'_>, labels: &[String]) -> Vec<ModelOutputs> {
    let mut kinds: BTreeSet<String> = KNOWN.map(str::to_owned).into();
    for pair in parameters.continued_texts("POINT", "TYPE_GROUPS").chunks_exact(2) {
        let (list, kind) = (pair[0].trim().to_uppercase(), pair[1].trim().to_uppercase());
        let units = parameters.texts("POINT", &format!("{kind}_UNITS"));
        if units.first().is_some_and(|it| !it.is_empty() && unit_length(it).is_none()) {
            kinds.insert(list);
        }
    }
    let mut exact: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    let mut loose: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (place, label) in labels.iter().enumerate() {
        exact.entry(label.trim()).or_default().push(place);
        loose.entry(without_subject(label)).or_default().push(place);
    }
    let mut taken = BTreeSet::new();
    let mut found: Vec<ModelOutputs> = Vec::new();
    let mut names = parameters.names("POINT");
    names.sort_unstable();
    names.dedup();
    for name in names {
        let kind = name.trim_end_matches(|it: char| it.is_ascii_digit());
        if !kinds.contains(kind) {
            continue;
        }
        let listed = parameters.texts("POINT", name);
        let listed = listed.iter().map(|it| it.trim()).filter(|it| !it.is_empty());
        let of_label = |it: &str| exact.get(it).or_else(|| loose.get(without_subject(it)));
        let points: Vec<usize> =
            listed.filter_map(of_label).flatten().copied().filter(|it| taken.insert(*it)).collect();
        match found.iter_mut().find(|it| it.kind == kind) {
            _ if points.is_empty() => {}
            Some(of_kind) => of_kind.points.extend(points),
            None => found.push(ModelOutputs { kind: kind.to_owned(), points }),
        }
    }
    found
}
