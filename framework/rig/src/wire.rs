//! Connects instances: each input's references looked up, their messages and spaces compared, one edge for each pair.

use foveate_messages::{CameraId, SpaceOwner};
use toml::Spanned;

use super::lookup::{Names, Source, outputs};
use super::node_text::InputText;
use super::nodes::NodeDraft;
use super::scales::Parent;
use foveate_diagnostics::names::{likely, listed, shown};
use foveate_diagnostics::{Findings, Span};
use foveate_node::node::Role;
use foveate_node::port::{InputPolicy, InputSpec, MessageType};

/// More edges than that are refused: a few lines with patterns can ask for any number of them.
const MOST_EDGES: usize = 4_000_000;

/// An edge between two instances.
#[derive(Debug, Clone)]
pub(super) struct EdgeDraft {
    /// Instance and output port.
    pub from: (usize, usize),
    /// Instance and input port.
    pub to: (usize, usize),
    /// Index among the consumer's inputs as written.
    pub input: usize,
    pub triggers: bool,
    /// The reference in the rig.
    pub place: Span,
}

/// Instances and edges.
pub(super) struct Wiring {
    /// Node and camera, by node, then by camera.
    pub instances: Vec<(usize, Option<CameraId>)>,
    pub edges: Vec<EdgeDraft>,
    /// By node: whether anything takes its outputs.
    pub used: Vec<bool>,
    /// By node: whether all its inputs could be connected.
    pub sound: Vec<bool>,
}

/// Connects everything that can be connected.
pub(super) fn wire(names: &Names<'_, '_>, findings: &mut Findings) -> Wiring {
    let n_nodes = names.nodes.len();
    let mut wiring =
        Wiring { instances: Vec::new(), edges: Vec::new(), used: vec![false; n_nodes], sound: vec![true; n_nodes] };
    let mut first = Vec::with_capacity(n_nodes);
    for (index, node) in names.nodes.iter().enumerate() {
        first.push(wiring.instances.len());
        wiring.instances.extend(node.cameras.iter().flatten().map(|&camera| (index, camera)));
    }
    for (index, node) in names.nodes.iter().enumerate() {
        let before = findings.count();
        let mut consumer = Consumer { names, node, index, first: &first, wiring: &mut wiring };
        consumer.connect(findings);
        if findings.count() > before || !node.text.inputs_sound || node.cameras.is_none() || node.settings.is_none() {
            wiring.sound[index] = false;
        }
        if wiring.edges.len() > MOST_EDGES {
            let title = format!("this rig has more than {MOST_EDGES} edges");
            findings.error(node.text.header.clone(), title, "found too many connections up to here");
            break;
        }
    }
    wiring
}

struct Consumer<'w, 'a, 't> {
    names: &'w Names<'a, 't>,
    node: &'w NodeDraft<'t>,
    index: usize,
    /// By node: its first instance.
    first: &'w [usize],
    wiring: &'w mut Wiring,
}

impl<'a> Consumer<'_, 'a, '_> {
    fn connect(&mut self, findings: &mut Findings) {
        let node = self.node;
        let known = node.node_type.as_ref().map(|it| it.ports.inputs.as_slice());
        if let Some((place, node_type)) = node.text.cost_place.as_ref().zip(node.node_type.as_ref())
            && node_type.role == Role::Source
        {
            let title = format!("`{}` is a source, and sources are as quick as their own settings say", node.name());
            findings
                .error(place.clone(), title, "found a cost, expected none")
                .help("give the cost to the nodes that its messages trigger");
        }
        for (number, input) in node.text.inputs.iter().enumerate() {
            let port = known.map(|ports| ports.iter().position(|it| it.name == input.port.get_ref()));
            if let (Some(None), Some(ports)) = (port, known) {
                self.no_such_port(&input.port, ports, findings);
            }
            let port = port.flatten().zip(known).map(|(index, ports)| (index, &ports[index]));
            self.connect_port(number, input, port, findings);
        }
        for require in &node.text.requires {
            let name = require.port.get_ref();
            match known.map(|ports| ports.iter().find(|it| it.name == name)) {
                Some(None) => self.no_such_port(&require.port, known.unwrap_or_default(), findings),
                Some(Some(port)) if port.optional && self.is_open(name) => {
                    let title = format!("`require.{name}` refers to an edge that does not exist");
                    let label = format!("found no source at port `{name}`");
                    findings
                        .error(require.port.span(), title, label)
                        .help(format_args!("connect it: `in.{name} = \"…\"`"));
                }
                _ => {}
            }
        }
        let is_known = |name: &str| known.unwrap_or_default().iter().any(|it| it.name == name);
        for port in known.unwrap_or_default().iter().filter(|it| !it.optional) {
            // A port whose name is written wrongly has been reported as such.
            let misspelt = node.text.inputs.iter().map(|it| it.port.get_ref()).find(|it| !is_known(it));
            let misspelt = misspelt.is_some_and(|it| likely(it, [port.name]).is_some());
            if node.text.inputs_sound && !misspelt && self.is_open(port.name) {
                let title = format!("input `{}` of `{}` is open", port.name, node.name());
                let label = format!("expected `in.{} = \"…\"` here: it takes `{}`", port.name, port.message.name);
                let offers = self.names.offers(port.message.id, node.scale);
                findings.error(node.text.header.clone(), title, label).help(match offers {
                    Some(offers) => format!("`{}` is given by {offers}", port.message.name),
                    None => format!("no node of this rig gives `{}`", port.message.name),
                });
            }
        }
    }

    fn is_open(&self, port: &str) -> bool {
        self.node.text.inputs.iter().all(|it| it.port.get_ref() != port)
    }

    fn no_such_port(&self, port: &Spanned<String>, ports: &[InputSpec], findings: &mut Findings) {
        let name = port.get_ref();
        let type_name = self.node.node_type.as_ref().map_or("", |it| it.name);
        let all = listed(ports.iter().map(|it| it.name));
        let meant = likely(name, ports.iter().map(|it| it.name));
        findings
            .error(
                port.span(),
                format_args!("`{type_name}` has no input `{}`", shown(name)),
                format_args!("expected an input of `{type_name}`"),
            )
            .help(match (meant, all) {
                (Some(meant), Some(all)) => format!("did you mean `{meant}`? its inputs: {all}"),
                (None, Some(all)) => format!("its inputs: {all}"),
                (_, None) => format!("`{type_name}` has no inputs"),
            });
    }

    fn connect_port(
        &mut self,
        number: usize,
        input: &InputText,
        port: Option<(usize, &InputSpec)>,
        findings: &mut Findings,
    ) {
        let mut sources: Vec<(Source, &Spanned<String>)> = Vec::new();
        for reference in &input.from {
            let Some(source) = self.names.source(reference, self.node.scale, findings) else { continue };
            self.wiring.used[source.node] = true;
            match sources.iter().find(|it| it.0 == source && source.output.is_some()) {
                Some((_, earlier)) => {
                    findings
                        .error(
                            reference.span(),
                            format_args!("port `{}` names a source twice", input.port.get_ref()),
                            "found again",
                        )
                        .also(earlier.span(), "it stands here already");
                }
                None => sources.push((source, reference)),
            }
        }
        let Some((port_index, port)) = port else { return };
        if !port.many && input.from.len() > 1 {
            let title = format!("input `{}` of `{}` takes one source", port.name, self.node.name());
            findings
                .error(input.from[1].span(), title, format_args!("found {} sources, expected one", input.from.len()))
                .help("only inputs that take many can join sources: `foveate nodes TYPE` says which");
            return;
        }
        if let (Some((_, place)), false) = (&input.tolerance, matches!(port.policy, InputPolicy::Synced(_))) {
            let title = format!("input `{}` of `{}` joins nothing", port.name, self.node.name());
            let label = format!("found `tolerance_ms`, expected nothing: {}", port.policy.in_words());
            findings.error(place.clone(), title, label);
        }
        if let (Some((_, place)), false) = (&input.delay, port.policy == InputPolicy::Latest) {
            let title = format!("what comes into input `{}` of `{}` cannot be delayed", port.name, self.node.name());
            let label = format!("found `delay_ms`, expected nothing: {}", port.policy.in_words());
            findings.error(place.clone(), title, label).help("only inputs that are sampled see things later");
        }
        if let (Some((_, place)), None) = (&input.policy, port.policy.choice()) {
            let title = format!("how input `{}` of `{}` takes data cannot be chosen", port.name, self.node.name());
            let label = format!("found `policy`, expected nothing: {}", port.policy.in_words());
            findings
                .error(place.clone(), title, label)
                .help("only inputs that take each message, or the newest ones, let a rig choose");
        }
        for (source, reference) in sources {
            let Some(output) = source.output else { continue };
            let message = match outputs(&self.names.nodes[source.node]).nth(output) {
                Some(output) => output.message,
                None => continue,
            };
            if !self.fits(port, message, source, output, reference, findings) {
                continue;
            }
            for (from, to) in self.pairs(port, message, source, reference, findings) {
                self.wiring.edges.push(EdgeDraft {
                    from: (from, output),
                    to: (to, port_index),
                    input: number,
                    triggers: port.policy != InputPolicy::Latest,
                    place: reference.span(),
                });
            }
        }
    }

    /// Whether message and scale are what the port takes.
    fn fits(
        &self,
        port: &InputSpec,
        message: MessageType,
        source: Source,
        output: usize,
        reference: &Spanned<String>,
        findings: &mut Findings,
    ) -> bool {
        let producer = &self.names.nodes[source.node];
        let output_name = outputs(producer).nth(output).map_or("", |it| it.name);
        if message.id != port.message.id {
            let version = |it: MessageType| match message.name == port.message.name {
                true => format!("`{}` (version {})", it.name, it.version),
                false => format!("`{}`", it.name),
            };
            let (found, expected) = (version(message), version(port.message));
            let title = format!(
                "output `{}.{output_name}` gives {found}, input `{}.{}` takes {expected}",
                producer.name(),
                self.node.name(),
                port.name
            );
            let offers = self.names.offers(port.message.id, self.node.scale);
            findings
                .error(reference.span(), title, format_args!("found {found}, expected {expected}"))
                .maybe_help(offers.map(|it| format!("{expected} is given by {it}")));
            return false;
        }
        match message.space.owner {
            SpaceOwner::Scale => self.points_fit(port, producer, reference, findings),
            SpaceOwner::ParentScale => {
                let around = |scale: usize| match self.names.scales[scale].parent {
                    Parent::Of(parent) => Some(parent),
                    Parent::Root | Parent::Unclear => None,
                };
                let (found, wanted) = (around(producer.scale), around(self.node.scale));
                found == wanted || self.other_space(port, message, producer, [found, wanted], reference, findings)
            }
            SpaceOwner::World => {
                let (found, wanted) = (self.root_of(producer.scale), self.root_of(self.node.scale));
                found == wanted
                    || self.other_space(port, message, producer, [found, wanted].map(Some), reference, findings)
            }
            SpaceOwner::Nobody
            | SpaceOwner::Camera
            | SpaceOwner::EachCamera
            | SpaceOwner::Stated
            | SpaceOwner::Other(_) => true,
        }
    }

    /// The outermost scale around `scale`.
    fn root_of(&self, mut scale: usize) -> usize {
        // No more steps than there are scales: that they nest in a circle is said elsewhere.
        for _ in 0..self.names.scales.len() {
            match self.names.scales[scale].parent {
                Parent::Of(parent) => scale = parent,
                Parent::Root | Parent::Unclear => break,
            }
        }
        scale
    }

    /// Refuses a message whose coordinates are in the first of two scales, where this node reads them as of the second.
    fn other_space(
        &self,
        port: &InputSpec,
        message: MessageType,
        producer: &NodeDraft<'_>,
        scales: [Option<usize>; 2],
        reference: &Spanned<String>,
        findings: &mut Findings,
    ) -> bool {
        let named = |it: Option<usize>| {
            it.map_or("no scale".to_owned(), |it| format!("scale `{}`", self.names.scales[it].name))
        };
        let [found, wanted] = scales.map(named);
        let unit = message.space.unit;
        let title = format!(
            "output of `{}` is in {found}, input `{}` of `{}` takes it as in {wanted}",
            producer.name(),
            port.name,
            self.node.name()
        );
        findings
            .error(reference.span(), title, format_args!("found {unit} in {found}, expected {unit} in {wanted}"))
            .help(format_args!("a `{}` holds {}", message.name, message.space.in_words()));
        false
    }

    /// Whether points of the producer's scale are what the port takes.
    fn points_fit(
        &self,
        port: &InputSpec,
        producer: &NodeDraft<'_>,
        reference: &Spanned<String>,
        findings: &mut Findings,
    ) -> bool {
        let scale_name = |scale: usize| &self.names.scales[scale].name;
        let wanted = match (port.of_parent, self.names.scales[self.node.scale].parent) {
            (false, _) => self.node.scale,
            (true, Parent::Of(parent)) => parent,
            (true, Parent::Unclear) => return true,
            (true, Parent::Root) => {
                let title = format!(
                    "input `{}` of `{}` takes points of the parent scale, and `{}` has none",
                    port.name,
                    self.node.name(),
                    scale_name(self.node.scale)
                );
                let label = format!("found points of scale `{}`", scale_name(producer.scale));
                findings
                    .error(reference.span(), title, label)
                    .help(format_args!("add `parent = \"…\"` to `[scale.{}]`", scale_name(self.node.scale)));
                return false;
            }
        };
        if producer.scale != wanted {
            let title = format!(
                "points of scale `{}` cannot enter input `{}` of `{}`, which takes points of scale `{}`",
                scale_name(producer.scale),
                port.name,
                self.node.name(),
                scale_name(wanted)
            );
            let label = format!(
                "found metres in `{}`, expected metres in `{}`",
                scale_name(producer.scale),
                scale_name(wanted)
            );
            findings.error(reference.span(), title, label);
            return false;
        }
        true
    }

    /// Which instance of the producer goes to which instance of this node.
    fn pairs(
        &self,
        port: &InputSpec,
        message: MessageType,
        source: Source,
        reference: &Spanned<String>,
        findings: &mut Findings,
    ) -> Vec<(usize, usize)> {
        let producer = &self.names.nodes[source.node];
        let (Some(theirs), Some(ours)) = (&producer.cameras, &self.node.cameras) else { return Vec::new() };
        let (their_first, our_first) = (self.first[source.node], self.first[self.index]);
        let pixels = message.space.owner == SpaceOwner::Camera;
        let chosen: Vec<(usize, Option<CameraId>)> = theirs
            .iter()
            .enumerate()
            .filter(|(_, it)| source.camera.is_none() || **it == source.camera)
            .map(|(index, &camera)| (their_first + index, camera))
            .collect();
        let mut pairs = Vec::new();
        // The rig's words, not the number of cameras that happen to match them, say whether it runs once.
        let of_any_camera = !pixels && (source.camera.is_some() || producer.text.each.is_none());
        // Cameras of ours that this source cannot serve.
        let mut unserved = Vec::new();
        for (index, &camera) in ours.iter().enumerate() {
            let to = our_first + index;
            match (camera, chosen.as_slice()) {
                (Some(camera), [(from, theirs)]) if theirs.is_none() || *theirs == Some(camera) || of_any_camera => {
                    pairs.push((*from, to));
                }
                (Some(camera), several) => match several.iter().find(|it| it.1 == Some(camera)) {
                    Some((from, _)) => pairs.push((*from, to)),
                    None => unserved.push(camera),
                },
                (None, [(from, _)]) => pairs.push((*from, to)),
                (None, several) if port.many => pairs.extend(several.iter().map(|it| (it.0, to))),
                (None, several) => {
                    let title = format!(
                        "input `{}` of `{}` takes one source, and `{}` runs for {} cameras",
                        port.name,
                        self.node.name(),
                        producer.name(),
                        several.len()
                    );
                    let example = several.first().and_then(|it| it.1).map_or("CAMERA", |it| self.names.camera_name(it));
                    findings
                        .error(reference.span(), title, format_args!("found {} sources, expected one", several.len()))
                        .help(format_args!(
                            "name one, `{}[{example}].{}`, or run `{}` for each camera too: `each = \"…\"`",
                            producer.name(),
                            outputs(producer).nth(source.output.unwrap_or_default()).map_or("OUTPUT", |it| it.name),
                            self.node.name()
                        ));
                }
            }
        }
        if let Some(&camera) = unserved.first() {
            self.other_cameras(producer, &chosen, camera, &unserved, pixels, reference, findings);
        }
        pairs
    }

    #[expect(clippy::too_many_arguments, reason = "one message, of all that there is to say")]
    fn other_cameras(
        &self,
        producer: &NodeDraft<'_>,
        theirs: &[(usize, Option<CameraId>)],
        camera: CameraId,
        unserved: &[CameraId],
        pixels: bool,
        reference: &Spanned<String>,
        findings: &mut Findings,
    ) {
        let ours = self.names.camera_name(camera);
        let (us, them) = (self.node.name(), producer.name());
        let example = theirs.first().and_then(|it| it.1).map_or("", |it| self.names.camera_name(it));
        let title = if pixels {
            format!("pixels of one camera cannot enter a node of another: `{them}[{example}]` to `{us}[{ours}]`")
        } else {
            format!("`{them}` does not run for camera `{ours}` as `{us}` does")
        };
        let their_names: Vec<&str> = theirs.iter().filter_map(|it| it.1).map(|it| self.names.camera_name(it)).collect();
        let missing = listed(unserved.iter().map(|&it| self.names.camera_name(it))).unwrap_or_default();
        let label = match their_names.as_slice() {
            [one] => format!("found camera `{one}`, expected {missing}"),
            several => format!("found cameras {}, expected also {missing}", listed(several).unwrap_or_default()),
        };
        let fault = findings.error(reference.span(), title, label);
        let same = "give both nodes the same cameras with `each` or `camera`";
        match pixels {
            true => fault.help(same),
            false => fault.help(format_args!("{same}, or name one: `{them}[{example}].OUTPUT`")),
        };
        let text = &self.node.text;
        if let Some(place) = text.each.as_ref().map(Spanned::span).or(text.camera.as_ref().map(Spanned::span)) {
            fault.also(place, format_args!("the cameras of `{us}`"));
        }
    }
}
