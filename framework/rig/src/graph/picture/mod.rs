//! A graph as a picture: Mermaid for documents, SVG for everything else.
//!
//! Both show a rig's nodes rather than its instances: one box for all cameras.

mod layout;
mod order;
mod svg;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fmt::Write;

use crate::graph::Graph;
use foveate_node::node::Role;

impl Graph {
    /// A Mermaid flow chart: scales as nested frames, feedback edges dotted, messages on the edges.
    pub fn to_mermaid(&self) -> String {
        let sketch = Sketch::of(self);
        let mut text = String::from("flowchart LR\n");
        let mut of_scale = vec![Vec::new(); sketch.scales.len()];
        for (index, node) in sketch.nodes.iter().enumerate() {
            of_scale[node.scale].push(index);
        }
        for step in sketch.walk() {
            match step {
                Step::Into(scale) => {
                    let _ = writeln!(text, "  subgraph s{scale}[\"{}\"]", mermaid_text(sketch.scales[scale].name));
                    for &index in &of_scale[scale] {
                        let node = &sketch.nodes[index];
                        let count = if node.count > 1 { format!(" ×{}", node.count) } else { String::new() };
                        let class = class(node.role);
                        let (name, type_name) = (mermaid_text(node.name), node.type_name);
                        let _ = writeln!(text, "    n{index}[\"{name}{count}<br/><i>{type_name}</i>\"]:::{class}");
                    }
                }
                Step::OutOf(_) => text.push_str("  end\n"),
            }
        }
        for link in &sketch.links {
            let arrow = if link.feedback { "-.->" } else { "-->" };
            let _ = writeln!(text, "  n{} {arrow}|{}| n{}", link.from, mermaid_text(&link.label), link.to);
        }
        for role in sketch.roles() {
            let (fill, stroke) = colours(role);
            let _ = writeln!(text, "  classDef {} fill:{fill},stroke:{stroke},color:#1b2733", class(role));
        }
        text
    }

    /// An SVG document: time runs from left to right, scales are nested frames, feedback edges are dashed.
    pub fn to_svg(&self) -> String {
        svg::draw(&Sketch::of(self))
    }
}

/// What is drawn of a graph.
struct Sketch<'g> {
    title: &'g str,
    cameras: usize,
    scales: Vec<Frame<'g>>,
    nodes: Vec<Part<'g>>,
    links: Vec<Link<'g>>,
}

/// A scale.
struct Frame<'g> {
    name: &'g str,
    parent: Option<usize>,
    /// Anchor and extent, in words.
    about: String,
}

/// A node of a rig, with all its instances.
struct Part<'g> {
    scale: usize,
    name: &'g str,
    type_name: &'static str,
    role: Role,
    count: usize,
}

/// All edges between the same two ports.
struct Link<'g> {
    from: usize,
    output: usize,
    to: usize,
    input: usize,
    /// The message, and the output's name where that is another.
    label: Cow<'g, str>,
    feedback: bool,
    /// Ports in full, for tooltips.
    about: String,
}

/// A walk over nested scales.
enum Step {
    Into(usize),
    OutOf(usize),
}

impl<'g> Sketch<'g> {
    fn of(graph: &'g Graph) -> Self {
        let by_name: BTreeMap<&str, usize> =
            graph.scales.iter().enumerate().map(|(index, it)| (it.name.as_str(), index)).collect();
        let scales = graph.scales.iter().map(|it| Frame {
            name: &it.name,
            parent: it.parent.as_deref().and_then(|name| by_name.get(name).copied()),
            about: about_scale(it),
        });
        let mut nodes: Vec<Part<'g>> = Vec::new();
        let mut seen: BTreeMap<(usize, &str), usize> = BTreeMap::new();
        let mut node_of = Vec::with_capacity(graph.instances.len());
        for instance in &graph.instances {
            let node = *seen.entry((instance.scale, &instance.node)).or_insert_with(|| {
                nodes.push(Part {
                    scale: instance.scale,
                    name: &instance.node,
                    type_name: instance.node_type.name,
                    role: instance.node_type.role,
                    count: 0,
                });
                nodes.len() - 1
            });
            nodes[node].count += 1;
            node_of.push(node);
        }
        let mut links: Vec<Link<'g>> = Vec::new();
        let mut drawn: BTreeMap<(usize, usize, usize, usize), usize> = BTreeMap::new();
        for edge in &graph.edges {
            let key = (node_of[edge.from.0], edge.from.1, node_of[edge.to.0], edge.to.1);
            let index = *drawn.entry(key).or_insert_with(|| {
                let (producer, consumer) = (&graph.instances[edge.from.0], &graph.instances[edge.to.0]);
                let output = producer.node_type.ports.outputs.get(edge.from.1);
                let input = consumer.node_type.ports.inputs.get(edge.to.1);
                let (name, message) = output.map_or(("", ""), |it| (it.name, it.message.name));
                // Shown where the rig has chosen another way than the port's own.
                let policy = consumer.takes.get(edge.to.1).filter(|it| input.is_some_and(|port| port.policy != **it));
                let choice = policy.and_then(|it| it.choice()).map(|it| format!(" ({it})")).unwrap_or_default();
                let label = match (name == message, choice.is_empty()) {
                    (true, true) => message.into(),
                    (true, false) => format!("{message}{choice}").into(),
                    (false, _) => format!("{name}: {message}{choice}").into(),
                };
                let about = format!(
                    "{}.{} → {}.{} ({message}){}",
                    producer.node,
                    name,
                    consumer.node,
                    input.map_or("", |it| it.name),
                    policy.map(|it| format!(": {}", it.in_words())).unwrap_or_default()
                );
                links.push(Link { from: key.0, output: key.1, to: key.2, input: key.3, label, feedback: false, about });
                links.len() - 1
            });
            links[index].feedback |= edge.feedback;
        }
        Self { title: &graph.name, cameras: graph.calibration.cameras.len(), scales: scales.collect(), nodes, links }
    }

    /// Every scale, its children right behind it.
    fn walk(&self) -> Vec<Step> {
        let mut children = vec![Vec::new(); self.scales.len()];
        let mut stack = Vec::new();
        for (index, scale) in self.scales.iter().enumerate().rev() {
            match scale.parent {
                Some(parent) => children[parent].push(index),
                None => stack.push(Step::Into(index)),
            }
        }
        let mut steps = Vec::new();
        while let Some(step) = stack.pop() {
            if let Step::Into(scale) = step {
                stack.push(Step::OutOf(scale));
                stack.extend(children[scale].iter().map(|&it| Step::Into(it)));
            }
            steps.push(step);
        }
        steps
    }

    /// The roles that occur, in the order of the data flow.
    fn roles(&self) -> impl Iterator<Item = Role> + '_ {
        const ALL: [Role; 7] = [
            Role::Source,
            Role::Detector,
            Role::Integrator,
            Role::ModelFilter,
            Role::Selector,
            Role::Actuator,
            Role::Sink,
        ];
        ALL.into_iter().filter(|role| self.nodes.iter().any(|it| it.role == *role))
    }
}

fn about_scale(scale: &super::Scale) -> String {
    let mut about = Vec::new();
    if let Some(anchor) = &scale.anchor {
        about.push(format!("moves with {anchor}"));
    }
    if let Some(radius_m) = scale.radius_m {
        about.push(format!("radius {radius_m} m"));
    }
    if let Some([min, max]) = scale.volume_m {
        let [x, y, z] = [0, 1, 2].map(|axis| ((max[axis] - min[axis]) * 1e3).round() / 1e3);
        about.push(format!("{x} × {y} × {z} m"));
    }
    about.join(", ")
}

/// Fill and line of a role's boxes.
const fn colours(role: Role) -> (&'static str, &'static str) {
    match role {
        Role::Source => ("#e1effa", "#2b6ea6"),
        Role::Detector => ("#e2f4e8", "#2a8a50"),
        Role::Integrator => ("#fdf0d8", "#b9770e"),
        Role::ModelFilter => ("#f1e7f8", "#8149ab"),
        Role::Selector => ("#fce4ea", "#bd3a5a"),
        Role::Actuator => ("#fae6dc", "#ad4d24"),
        Role::Sink => ("#e9edf1", "#566676"),
    }
}

const fn class(role: Role) -> &'static str {
    match role {
        Role::Source => "source",
        Role::Detector => "detector",
        Role::Integrator => "integrator",
        Role::ModelFilter => "filter",
        Role::Selector => "selector",
        Role::Actuator => "actuator",
        Role::Sink => "sink",
    }
}

fn mermaid_text(text: &str) -> String {
    text.replace('#', "#35;").replace('"', "#quot;").replace('<', "#lt;").replace('>', "#gt;")
}
