//! Anchors of scales: each a target that a node of the parent scale recovers.

use super::fault::Findings;
use super::lookup::{Names, outputs};
use super::names::{did_you_mean, shown};
use super::nodes::NodeDraft;
use super::scales::Parent;

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
        }
    }
}
