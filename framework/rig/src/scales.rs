//! Scales in order, parents before children.

use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use foveate_scene::AnchorRule;
use toml::Spanned;

use super::node_text::NodeText;
use super::read::ScaleText;
use super::targets::NamedTarget;
use crate::graph::scale_id;
use foveate_diagnostics::names::{did_you_mean, shown};
use foveate_diagnostics::{Findings, Span};
use foveate_node::scale::ScalePlace;

/// The scale that a scale nests in.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Parent {
    /// None: its space is a world of its own.
    Root,
    /// By index.
    Of(usize),
    /// At fault, which has been reported.
    Unclear,
}

/// A scale, checked but for its anchor.
pub(super) struct ScaleDraft {
    pub name: String,
    pub parent: Parent,
    pub anchor: Option<Spanned<String>>,
    /// Of a scale with parent and anchor: how the target is picked that carries it.
    pub rule: Option<AnchorRule>,
    pub volume_m: Option<[[f64; 3]; 2]>,
    pub radius_m: Option<f64>,
    pub targets: Vec<NamedTarget>,
    /// Whether volume, radius and the rule were understood.
    pub sound: bool,
}

/// In the form that nodes get; for scales in order.
pub(super) fn places(scales: &[ScaleDraft]) -> Arc<[ScalePlace]> {
    let place = |it: &ScaleDraft| ScalePlace {
        name: it.name.clone(),
        parent: match it.parent {
            Parent::Of(parent) => Some(scale_id(parent)),
            Parent::Root | Parent::Unclear => None,
        },
        is_anchored: it.rule.is_some(),
    };
    scales.iter().map(place).collect()
}

/// Puts scales in order, by the text wherever that is free; the nodes of each stand at the same index.
pub(super) fn arrange<'t>(
    scales: Vec<ScaleText<'t>>,
    findings: &mut Findings,
) -> (Vec<ScaleDraft>, Vec<Vec<NodeText<'t>>>) {
    let parents = parents(&scales, findings);
    let order = order(&parents);
    let mut place = vec![0; scales.len()];
    for (index, &scale) in order.iter().enumerate() {
        place[scale] = index;
    }
    let mut scales: Vec<Option<ScaleText<'t>>> = scales.into_iter().map(Some).collect();
    let (mut drafts, mut nodes): (Vec<ScaleDraft>, _) = (Vec::new(), Vec::new());
    let mut options: HashMap<(usize, String), AnchorRule> = HashMap::new();
    for scale in order {
        let Some(text) = scales[scale].take() else { continue };
        let parent = match parents[scale] {
            Parent::Of(parent) => Parent::Of(place[parent]),
            other => other,
        };
        if let (Parent::Root, Some(anchor)) = (parent, &text.anchor) {
            let title = format!("scale `{}` has an anchor and no parent", text.name.get_ref());
            findings
                .error(anchor.span(), title, "found a target of no scale")
                .help("name the scale that the target lies in: `parent = \"…\"`");
        }
        let ScaleText { name, anchor, volume_m, radius_m, targets, mut sound, nodes: texts, .. } = text;
        let mut rule = None;
        if let (Parent::Of(parent), Some(anchor)) = (parent, &anchor) {
            sound &= drafts[parent].sound;
            let target = target_name(anchor.get_ref()).unwrap_or_default();
            rule = Some(options.get(&(parent, target.to_owned())).copied().unwrap_or_default());
        }
        options.extend(targets.iter().map(|it| ((drafts.len(), it.name.get_ref().clone()), it.rule)));
        drafts.push(ScaleDraft { name: name.into_inner(), parent, anchor, rule, volume_m, radius_m, targets, sound });
        nodes.push(texts);
    }
    (drafts, nodes)
}

/// The name of the target in an anchor: what stands behind the node's.
fn target_name(anchor: &str) -> Option<&str> {
    anchor.split_once('.').map(|it| it.1)
}

/// By scale: the names of its targets that scales are anchored to, with their rules, in the order of those scales.
pub(super) fn anchored_to(scales: &[ScaleDraft]) -> Vec<Vec<(&str, &AnchorRule)>> {
    let mut anchored = vec![Vec::new(); scales.len()];
    for scale in scales {
        if let (Parent::Of(parent), Some(anchor), Some(rule)) = (scale.parent, &scale.anchor, &scale.rule) {
            anchored[parent].extend(target_name(anchor.get_ref()).map(|it| (it, rule)));
        }
    }
    anchored
}

fn parents(scales: &[ScaleText<'_>], findings: &mut Findings) -> Vec<Parent> {
    let by_name: HashMap<&str, usize> =
        scales.iter().enumerate().map(|(index, it)| (it.name.get_ref().as_str(), index)).collect();
    let mut parents = Vec::with_capacity(scales.len());
    for scale in scales {
        parents.push(match &scale.parent {
            None if scale.parent_unclear => Parent::Unclear,
            None => Parent::Root,
            Some(parent) => match by_name.get(parent.get_ref().as_str()) {
                Some(&index) => Parent::Of(index),
                None => {
                    let names = scales.iter().map(|it| it.name.get_ref().as_str());
                    let names = names.filter(|it| it != scale.name.get_ref());
                    findings
                        .error(
                            parent.span(),
                            format_args!("there is no scale `{}`", shown(parent.get_ref())),
                            "expected the name of a scale",
                        )
                        .help(did_you_mean(parent.get_ref(), "other scales", names));
                    Parent::Unclear
                }
            },
        });
    }
    break_circles(scales, &mut parents, findings);
    parents
}

/// Reports each circle of parents once and takes it apart.
fn break_circles(scales: &[ScaleText<'_>], parents: &mut [Parent], findings: &mut Findings) {
    // The walk that first came by each scale.
    let mut walk_of = vec![usize::MAX; scales.len()];
    for start in 0..scales.len() {
        let mut scale = start;
        while walk_of[scale] == usize::MAX {
            walk_of[scale] = start;
            match parents[scale] {
                Parent::Of(parent) => scale = parent,
                _ => break,
            }
        }
        let Parent::Of(mut next) = parents[scale] else { continue };
        if walk_of[scale] != start {
            continue;
        }
        let mut circle = vec![scale];
        while next != scale {
            circle.push(next);
            match parents[next] {
                Parent::Of(parent) => next = parent,
                _ => break,
            }
        }
        if next != scale {
            continue;
        }
        circle.sort_unstable();
        let place = |scale: usize| -> Span { scales[scale].parent.as_ref().map(Spanned::span).unwrap_or_default() };
        let names: Vec<String> = circle.iter().take(12).map(|&it| format!("`{}`", scales[it].name.get_ref())).collect();
        let fault = findings.error(
            place(circle[0]),
            format_args!("scales nest in a circle: {}", names.join(", ")),
            format_args!("found `{}` inside itself", scales[circle[0]].name.get_ref()),
        );
        for &scale in circle.iter().skip(1).take(8) {
            fault.also(place(scale), "and here");
        }
        fault.help("a scale without `parent` is the largest one");
        for scale in circle {
            parents[scale] = Parent::Unclear;
        }
    }
}

/// Parents before children, else by number.
fn order(parents: &[Parent]) -> Vec<usize> {
    let mut children = vec![Vec::new(); parents.len()];
    let mut free = BTreeSet::new();
    for (scale, parent) in parents.iter().enumerate() {
        match parent {
            Parent::Of(parent) => children[*parent].push(scale),
            _ => {
                free.insert(scale);
            }
        }
    }
    let mut order = Vec::with_capacity(parents.len());
    while let Some(scale) = free.pop_first() {
        order.push(scale);
        free.extend(&children[scale]);
    }
    order
}
