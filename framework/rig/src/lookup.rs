//! Resolves a reference to an output, or lists the outputs that exist.

use std::any::TypeId;
use std::collections::HashMap;

use foveate_messages::CameraId;
use foveate_scene::calibration::Calibration;
use toml::Spanned;

use super::nodes::NodeDraft;
use super::reference::{Reference, place_of_part};
use super::scales::ScaleDraft;
use foveate_diagnostics::Findings;
use foveate_diagnostics::names::{did_you_mean, likely, listed, shown};
use foveate_node::port::OutputSpec;

/// Outputs of one message type that are offered where an input is open.
const MOST_OFFERED: usize = 6;

/// All names of a rig.
pub(super) struct Names<'a, 't> {
    pub text: &'a str,
    pub scales: &'a [ScaleDraft],
    pub nodes: &'a [NodeDraft<'t>],
    calibration: Option<&'a Calibration>,
    scale_by_name: HashMap<&'a str, usize>,
    node_by_name: HashMap<(usize, &'a str), usize>,
    /// The first scale that has a node of that name.
    scale_of_node: HashMap<&'a str, usize>,
    offers: HashMap<TypeId, Vec<(usize, &'static str)>>,
}

/// What a reference means.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Source {
    pub node: usize,
    /// `None`: the node's type is not known, which has been reported.
    pub output: Option<usize>,
    /// The camera whose instance is meant, where the reference says so.
    pub camera: Option<CameraId>,
}

impl<'a, 't> Names<'a, 't> {
    pub fn new(
        text: &'a str,
        scales: &'a [ScaleDraft],
        nodes: &'a [NodeDraft<'t>],
        calibration: Option<&'a Calibration>,
    ) -> Self {
        let scale_by_name = scales.iter().enumerate().map(|(index, it)| (it.name.as_str(), index)).collect();
        let node_by_name = nodes.iter().enumerate().map(|(index, it)| ((it.scale, it.name()), index)).collect();
        let mut scale_of_node = HashMap::new();
        let mut offers: HashMap<TypeId, Vec<(usize, &'static str)>> = HashMap::new();
        for (index, node) in nodes.iter().enumerate() {
            scale_of_node.entry(node.name()).or_insert(node.scale);
            for output in outputs(node) {
                let offers = offers.entry(output.message.id).or_default();
                if offers.len() < MOST_OFFERED {
                    offers.push((index, output.name));
                }
            }
        }
        Self { text, scales, nodes, calibration, scale_by_name, node_by_name, scale_of_node, offers }
    }

    /// The node of that name in a scale.
    pub fn node(&self, scale: usize, name: &str) -> Option<usize> {
        self.node_by_name.get(&(scale, name)).copied()
    }

    /// Outputs that give messages of one type, as a node of `scale` would write them.
    pub fn offers(&self, message: TypeId, scale: usize) -> Option<String> {
        let offers = self.offers.get(&message)?;
        listed(offers.iter().map(|&(node, output)| {
            let node = &self.nodes[node];
            let prefix = if node.scale == scale { String::new() } else { format!("{}.", self.scales[node.scale].name) };
            format!("{prefix}{}.{output}", node.name())
        }))
    }

    /// A camera's name.
    pub fn camera_name(&self, camera: CameraId) -> &'a str {
        self.calibration.and_then(|it| it.cameras.get(usize::from(camera.0))).map_or("", |it| it.name.as_str())
    }

    /// What `reference` means to a node of `scale`; faults are reported.
    pub fn source(&self, reference: &Spanned<String>, scale: usize, findings: &mut Findings) -> Option<Source> {
        let written = reference.get_ref();
        let Some(parts) = Reference::parse(written) else {
            let fault = findings.error(
                reference.span(),
                format_args!("`{}` does not name an output", shown(written)),
                "expected \"NODE.OUTPUT\", \"SCALE.NODE.OUTPUT\" or \"NODE[CAMERA].OUTPUT\"",
            );
            if let Some(node) = self.node(scale, written) {
                let names = outputs(&self.nodes[node]).map(|it| format!("{written}.{}", it.name));
                fault.maybe_help(listed(names).map(|it| format!("the outputs of `{written}`: {it}")));
            }
            return None;
        };
        let (node, camera) = self.node_and_camera(reference, &parts, scale, findings)?;
        let name = &written[parts.node.clone()];
        let output = &written[parts.output.clone()];
        let Some(node_type) = &self.nodes[node].node_type else {
            return Some(Source { node, output: None, camera });
        };
        let index = node_type.ports.outputs.iter().position(|it| it.name == output);
        if index.is_none() {
            let known = node_type.ports.outputs.iter().map(|it| it.name);
            let all = listed(known.clone());
            let help = match (likely(output, known), all) {
                (Some(meant), Some(all)) => {
                    format!("did you mean `{meant}`? the outputs of `{}`: {all}", node_type.name)
                }
                (None, Some(all)) => format!("the outputs of `{}`: {all}", node_type.name),
                (_, None) => format!("`{}` has no outputs: it is a {}", node_type.name, node_type.role.name()),
            };
            findings
                .error(
                    place_of_part(self.text, reference, &parts.output),
                    format_args!("`{}` has no output `{}`", shown(&name), shown(&output)),
                    format_args!("expected an output of `{}`", node_type.name),
                )
                .help(help);
            return None;
        }
        Some(Source { node, output: index, camera })
    }

    /// The node that a reference names, of `scale` where it names none, and the camera whose instance is meant, where it names one; faults are reported.
    pub fn node_and_camera(
        &self,
        reference: &Spanned<String>,
        parts: &Reference,
        scale: usize,
        findings: &mut Findings,
    ) -> Option<(usize, Option<CameraId>)> {
        let written = reference.get_ref();
        let scale = match &parts.scale {
            Some(part) => match self.scale_by_name.get(&written[part.clone()]) {
                Some(&found) => found,
                None => {
                    let name = &written[part.clone()];
                    let known = self.scales.iter().map(|it| it.name.as_str());
                    findings
                        .error(
                            place_of_part(self.text, reference, part),
                            format_args!("there is no scale `{}`", shown(&name)),
                            "expected the name of a scale",
                        )
                        .help(did_you_mean(name, "scales", known));
                    return None;
                }
            },
            None => scale,
        };
        let name = &written[parts.node.clone()];
        let Some(node) = self.node(scale, name) else {
            self.no_such_node(reference, parts, scale, findings);
            return None;
        };
        let camera = match &parts.camera {
            Some(part) => Some(self.camera(reference, part, node, findings)?),
            None => None,
        };
        Some((node, camera))
    }

    fn no_such_node(&self, reference: &Spanned<String>, parts: &Reference, scale: usize, findings: &mut Findings) {
        let written = reference.get_ref();
        let name = &written[parts.node.clone()];
        let output = &written[parts.output.clone()];
        let scale_name = &self.scales[scale].name;
        let known = self.nodes.iter().filter(|it| it.scale == scale).map(NodeDraft::name);
        let help = match (likely(name, known.clone()), self.scale_of_node.get(name)) {
            (_, Some(&other)) => {
                let other = &self.scales[other].name;
                format!("did you mean `{other}.{name}.{output}`? scale `{other}` has a node `{name}`")
            }
            (None, None) if parts.scale.is_none() && self.scale_by_name.contains_key(name) => {
                format!("`{name}` is a scale: name an output of one of its nodes, `{name}.{output}.OUTPUT`")
            }
            _ => did_you_mean(name, &format!("the nodes of scale `{scale_name}`"), known),
        };
        findings
            .error(
                place_of_part(self.text, reference, &parts.node),
                format_args!("scale `{scale_name}` has no node `{}`", shown(&name)),
                format_args!("expected the name of a node of `{scale_name}`"),
            )
            .help(help);
    }

    fn camera(
        &self,
        reference: &Spanned<String>,
        part: &std::ops::Range<usize>,
        node: usize,
        findings: &mut Findings,
    ) -> Option<CameraId> {
        let node = &self.nodes[node];
        let cameras = node.cameras.as_ref()?;
        let name = &reference.get_ref()[part.clone()];
        let found = cameras.iter().flatten().copied().find(|&it| self.camera_name(it) == name);
        if found.is_none() {
            let known: Vec<&str> = cameras.iter().flatten().map(|&it| self.camera_name(it)).collect();
            let help = if known.is_empty() {
                format!("`{}` runs once, for no camera: write `{}.OUTPUT`", node.name(), node.name())
            } else {
                did_you_mean(name, "its cameras", known)
            };
            findings
                .error(
                    place_of_part(self.text, reference, part),
                    format_args!("`{}` does not run for a camera `{}`", node.name(), shown(&name)),
                    format_args!("expected a camera of `{}`", node.name()),
                )
                .help(help);
        }
        found
    }
}

/// The outputs of a node whose type is known.
pub(super) fn outputs<'n>(node: &'n NodeDraft<'_>) -> impl Iterator<Item = &'n OutputSpec> + Clone {
    node.node_type.iter().flat_map(|it| &it.ports.outputs)
}
