//! Anchors of scales: each a target that a node of the parent scale recovers, and a node `anchor` that follows it.

use std::collections::BTreeSet;

use foveate_messages::Targets;
use toml::Spanned;
use toml::de::DeTable;

use super::lookup::{Names, outputs};
use super::node_text::{InputText, NodeText};
use super::nodes::NodeDraft;
use super::reference::place_of_part;
use super::scales::{Parent, ScaleDraft, anchored_to};
use crate::graph::{Cost, OnError, Queue};
use foveate_diagnostics::Findings;
use foveate_diagnostics::names::{did_you_mean, likely, shown};
use foveate_node::node::Node;
use foveate_node::port::MessageType;
use foveate_node::scale::ScaleAnchor;

/// The name of the node that a scale with an anchor is given.
const NODE: &str = "anchor";

/// Nodes of the rig that take the place or the name of the one that a scale with an anchor is given.
pub(super) fn refuse_own(scale: &ScaleDraft, nodes: &[NodeText<'_>], findings: &mut Findings) {
    for type_name in nodes.iter().filter_map(|it| it.type_name.as_ref()).filter(|it| it.get_ref() == ScaleAnchor::TYPE)
    {
        findings
            .error(
                type_name.span(),
                format_args!("a `{}` is not written in a rig", ScaleAnchor::TYPE),
                "found one, expected none",
            )
            .help("a scale with `anchor = \"NODE.TARGET\"` is given one, named `anchor`");
    }
    let Some(anchor) = &scale.anchor else { return };
    for node in nodes.iter().filter(|it| it.name.get_ref() == NODE) {
        findings
            .error(
                node.name.span(),
                format_args!("scale `{}` has a node `{NODE}` of its own", shown(&scale.name)),
                "found another one of that name",
            )
            .also(anchor.span(), "it follows this target, and gives `anchor.space`")
            .help("give this node another name");
    }
}

/// The node that follows the anchor of `scale`, where its target could be made out; all faults are left to [`check`].
pub(super) fn implied<'t>(
    scales: &[ScaleDraft],
    scale: &ScaleDraft,
    own: &[NodeText<'_>],
    drafts: &[NodeDraft<'_>],
) -> Option<NodeText<'t>> {
    let (Some(anchor), Parent::Of(parent)) = (&scale.anchor, scale.parent) else { return None };
    let (name, target) = anchor.get_ref().split_once('.')?;
    let before = drafts.partition_point(|it| it.scale < parent);
    let node = drafts[before..].iter().take_while(|it| it.scale == parent).find(|it| it.name() == name)?;
    // An output of the target's own name holds such targets only; else all targets of the node are looked at.
    let of_targets = || outputs(node).filter(|it| it.message.id == MessageType::of::<Targets>().id);
    let output = of_targets().find(|it| it.name == target).or_else(|| of_targets().next())?;
    if own.iter().any(|it| it.name.get_ref() == NODE) || node.cameras.as_ref().is_none_or(|it| it.len() != 1) {
        return None;
    }
    let here = |text: String| Spanned::new(anchor.span(), text);
    let from = here(format!("{}.{name}.{}", scales[parent].name, output.name));
    let input = InputText {
        port: here("targets".to_owned()),
        from: vec![from],
        queue: Queue::default(),
        has_capacity: false,
        tolerance: None,
        delay: None,
        policy: None,
    };
    Some(NodeText {
        name: here(NODE.to_owned()),
        header: anchor.span(),
        type_name: Some(here(ScaleAnchor::TYPE.to_owned())),
        has_type: true,
        each: None,
        camera: None,
        cameras_unclear: false,
        inputs: vec![input],
        inputs_sound: true,
        requires: Vec::new(),
        on_error: OnError::default(),
        cost: Cost::default(),
        cost_place: None,
        settings: DeTable::new(),
    })
}

/// Checks all anchors and notes the nodes they use.
pub(super) fn check(names: &Names<'_, '_>, used: &mut [bool], findings: &mut Findings) {
    for scale in names.scales {
        let (Some(anchor), Parent::Of(parent)) = (&scale.anchor, scale.parent) else { continue };
        let parent_name = &names.scales[parent].name;
        let Some((node_name, target)) =
            anchor.get_ref().split_once('.').filter(|it| !it.0.is_empty() && !it.1.is_empty())
        else {
            findings.error(
                anchor.span(),
                format_args!("`{}` does not name a target", shown(anchor.get_ref())),
                format_args!("expected \"NODE.TARGET\" with a node of scale `{parent_name}`"),
            );
            continue;
        };
        let Some(node) = names.node(parent, node_name) else {
            let known = names.nodes.iter().filter(|it| it.scale == parent).map(NodeDraft::name);
            findings
                .error(
                    anchor.span(),
                    format_args!("scale `{parent_name}` has no node `{}`", shown(&node_name)),
                    format_args!(
                        "expected a node of the parent scale that gives `targets`, then `.{}`",
                        shown(&target)
                    ),
                )
                .help(did_you_mean(node_name, &format!("the nodes of scale `{parent_name}`"), known));
            continue;
        };
        used[node] = true;
        let node = &names.nodes[node];
        if node.node_type.is_some() && outputs(node).all(|it| it.message.name != "targets") {
            let type_name = node.node_type.as_ref().map_or("", |it| it.name);
            findings.error(
                anchor.span(),
                format_args!("`{node_name}` recovers no targets: a scale cannot be anchored to it"),
                format_args!("found a `{type_name}`, expected a node with an output of message `targets`"),
            );
        } else if let Some(cameras) = node.cameras.as_ref().filter(|it| it.len() > 1) {
            findings
                .error(
                    anchor.span(),
                    format_args!(
                        "`{node_name}` runs for {} cameras: a scale is anchored to one list of targets",
                        cameras.len()
                    ),
                    "found several instances, expected a node that runs once",
                )
                .help("anchor to what joins the cameras");
        }
        let named = || names.scales[parent].targets.iter().map(|it| it.name.get_ref().as_str());
        if let Some(meant) = likely(target, named()).filter(|_| named().all(|it| it != target)) {
            let part = node_name.len() + 1..anchor.get_ref().len();
            findings
                .error(
                    place_of_part(names.text, anchor, &part),
                    format_args!("scale `{parent_name}` names no target `{}`", shown(&target)),
                    format_args!("expected a name, as in `[scale.{parent_name}.target.{meant}]`"),
                )
                .help(format_args!("did you mean `{meant}`?"));
        }
    }
    warn_of_unused(names, findings);
}

/// A named target that nothing is anchored to.
fn warn_of_unused(names: &Names<'_, '_>, findings: &mut Findings) {
    if findings.any_error() {
        return;
    }
    let used = anchored_to(names.scales);
    for (scale, used) in names.scales.iter().zip(&used) {
        let used: BTreeSet<&str> = used.iter().map(|it| it.0).collect();
        for name in scale.targets.iter().map(|it| &it.name).filter(|it| !used.contains(it.get_ref().as_str())) {
            let help = format!("`anchor = \"NODE.{}\"` in a scale with `parent = \"{}\"`", name.get_ref(), scale.name);
            findings
                .warning(
                    name.span(),
                    format_args!("nothing is anchored to target `{}`", shown(name.get_ref())),
                    "no scale uses this name",
                )
                .help(help);
        }
    }
}
