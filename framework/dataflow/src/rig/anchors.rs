//! Anchors of scales: each a target that a node of the parent scale recovers.

use super::fault::Findings;
use super::lookup::{Names, outputs};
use super::names::{did_you_mean, likely, shown};
use super::nodes::NodeDraft;
use super::reference::place_of_part;
use super::scales::{Parent, target_name};

/// Checks all anchors and notes the nodes they use.
pub(super) fn check(names: &Names<'_, '_>, used: &mut [bool], findings: &mut Findings) {
    for scale in names.scales {
        let (Some(anchor), Parent::Of(parent)) = (&scale.anchor, scale.parent) else { continue };
        let parent_name = &names.scales[parent].name;
        let Some((node_name, target)) =
            anchor.get_ref().split_once('.').filter(|it| !it.0.is_empty() && !it.1.is_empty())
        else {
            findings.fault(
                anchor.span(),
                format_args!("`{}` does not name a target", shown(anchor.get_ref())),
                format_args!("expected \"NODE.TARGET\" with a node of scale `{parent_name}`"),
            );
            continue;
        };
        let Some(node) = names.node(parent, node_name) else {
            let known = names.nodes.iter().filter(|it| it.scale == parent).map(NodeDraft::name);
            findings
                .fault(
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
            findings.fault(
                anchor.span(),
                format_args!("`{node_name}` recovers no targets: a scale cannot be anchored to it"),
                format_args!("found a `{type_name}`, expected a node with an output of message `targets`"),
            );
        } else if let Some(cameras) = node.cameras.as_ref().filter(|it| it.len() > 1) {
            findings
                .fault(
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
                .fault(
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
    if findings.any_fault() {
        return;
    }
    for (index, scale) in names.scales.iter().enumerate() {
        for target in &scale.targets {
            let children = names.scales.iter().filter(|it| it.parent == Parent::Of(index));
            let mut anchored = children.filter_map(|it| target_name(it.anchor.as_ref()?.get_ref()));
            if !anchored.any(|it| it == target.name.get_ref()) {
                findings
                    .warning(
                        target.name.span(),
                        format_args!("nothing is anchored to target `{}`", shown(target.name.get_ref())),
                        "no scale uses this name",
                    )
                    .help(format_args!(
                        "`anchor = \"NODE.{}\"` in a scale with `parent = \"{}\"`",
                        target.name.get_ref(),
                        scale.name
                    ));
            }
        }
    }
}
