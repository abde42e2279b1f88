//! The last steps over the whole rig: cycles, schedule, promises, warnings, and the graph itself.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;

use foveate_messages::Interval;
use foveate_scene::calibration::Calibration;

use super::anchors;
use super::budget;
use super::lookup::{Names, outputs};
use super::nodes::{NodeDraft, instance_path};
use super::order::{Arrow, cycles, schedule, way_around};
use super::paths::{self, Path};
use super::promise;
use super::read::RigText;
use super::resolved;
use super::scales::{Parent, ScaleDraft, places};
use super::wire::{EdgeDraft, Wiring, wire};
use crate::graph::{Edge, Graph, Instance, Queue, Requirement, Scale};
use foveate_diagnostics::names::listed;
use foveate_diagnostics::{Diagnostics, Findings};
use foveate_node::Host;
use foveate_node::node::Role;
use foveate_node::page::Pages;
use foveate_node::port::InputPolicy;
use foveate_node::setup::Claims;

/// More node instances than that are refused: a few lines with patterns can ask for any number of them.
const MOST_INSTANCES: usize = 1_000_000;
/// Pixels of one picture of each camera of all sources together, at most: each is held several times over while a rig runs [px].
const MOST_PIXELS: u64 = 1 << 31;
/// Places that the fault of a cycle shows.
const MOST_PLACES: usize = 8;

/// A rig whose nodes have been checked one by one.
pub(super) struct Finish<'r, 't> {
    pub rig: &'r RigText<'t>,
    pub text: &'r str,
    pub scales: &'r [ScaleDraft],
    pub nodes: &'r [NodeDraft<'t>],
    pub calibration: Option<Arc<Calibration>>,
    pub rig_dir: PathBuf,
    pub seed: u64,
    pub duration_s: Option<f64>,
}

impl Finish<'_, '_> {
    /// Checks what concerns several nodes; `None` when there is any fault.
    pub fn graph(self, findings: &mut Findings) -> Option<Graph> {
        let n_instances: usize = self.nodes.iter().map(|it| it.cameras.as_ref().map_or(0, Vec::len)).sum();
        if n_instances > MOST_INSTANCES {
            let label = format!("found {n_instances} with one for each camera, expected at most {MOST_INSTANCES}");
            findings.error(self.rig.header.clone(), "this rig has too many nodes", label);
            return None;
        }
        self.refuse_absurd_pictures(findings);
        let names = Names::new(self.text, self.scales, self.nodes, self.calibration.as_deref());
        let mut wiring = wire(&names, findings);
        anchors::check(&names, &mut wiring.used, findings);
        let budgets = budget::look_up(&names, &self.rig.budgets, findings);
        let arrows: Vec<Arrow> =
            wiring.edges.iter().map(|it| Arrow { from: it.from.0, to: it.to.0, triggers: it.triggers }).collect();
        let triggering = arrows.iter().copied().filter(|it| it.triggers);
        let circles = cycles(n_instances, triggering.clone());
        if !circles.is_empty() {
            report_cycles(&names, &wiring, &circles, findings);
            return None;
        }
        let order = schedule(n_instances, &arrows);
        let best = promise::carried(&names, &wiring, &order);
        promise::check(&names, &wiring, &best, findings);
        let budgets = paths::follow(&names, &wiring, &order, &best, &budgets, findings);
        if findings.any_error() {
            return None;
        }
        warn(&names, &wiring, findings);
        let folder = std::path::absolute(&self.rig_dir).unwrap_or_else(|_| self.rig_dir.clone());
        let head = resolved::Head { rig: self.rig, seed: self.seed, duration_s: self.duration_s, folder: &folder };
        match resolved::write(&head, &names) {
            Ok(resolved) => self.build(&names, &wiring, &order, &budgets, resolved),
            Err((node, error)) => {
                let node = &self.nodes[node];
                let title = format!("the settings of `{}` cannot be written as TOML", node.name());
                findings.error(node.text.header.clone(), title, error);
                None
            }
        }
    }

    /// A fault where the pictures of all cameras do not fit into memory: reported here rather than by a failed allocation during a run.
    fn refuse_absurd_pictures(&self, findings: &mut Findings) {
        let Some(calibration) = &self.calibration else { return };
        let pixels_of = |node: &NodeDraft<'_>| {
            let gives_pictures = node.node_type.as_ref().is_some_and(|it| {
                it.role == Role::Source && it.ports.outputs.iter().any(|it| it.message.name == "image")
            });
            let cameras = node.cameras.iter().flatten().flatten().filter(|_| gives_pictures);
            let sizes = cameras.filter_map(|it| Some(calibration.cameras.get(usize::from(it.0))?.camera.image_size));
            sizes.map(|[columns, rows]| u64::from(columns) * u64::from(rows)).sum::<u64>()
        };
        let all: u64 = self.nodes.iter().map(pixels_of).sum();
        let largest = self.nodes.iter().max_by_key(|it| pixels_of(it)).filter(|_| all > MOST_PIXELS);
        if let Some(node) = largest {
            let label = format!(
                "found {all} px in one picture of each camera of all sources, {} of them here, expected at most {MOST_PIXELS}",
                pixels_of(node)
            );
            findings
                .error(node.text.header.clone(), "the pictures of this rig do not fit into memory", label)
                .help("look at `image_size_px` in the calibration, and at the cameras that `each` names");
        }
    }

    fn build(
        &self,
        names: &Names<'_, '_>,
        wiring: &Wiring,
        order: &[usize],
        budgets: &[Path<'_>],
        resolved: String,
    ) -> Option<Graph> {
        let mut place = vec![0; order.len()];
        for (index, &instance) in order.iter().enumerate() {
            place[instance] = index;
        }
        let mut instances = Vec::with_capacity(order.len());
        for &instance in order {
            let (node, camera) = wiring.instances[instance];
            let node = &self.nodes[node];
            let camera_name = camera.map(|it| names.camera_name(it));
            instances.push(Instance {
                path: instance_path(&self.scales[node.scale].name, node.name(), camera_name),
                node: node.name().to_owned(),
                scale: node.scale,
                camera,
                node_type: Arc::clone(node.node_type.as_ref()?),
                settings: Arc::clone(node.settings.as_ref()?),
                on_error: node.text.on_error,
                takes: takes(node),
                cost: node.text.cost,
            });
        }
        let mut edges: Vec<Edge> = wiring.edges.iter().map(|it| self.edge(it, wiring, &place, &instances)).collect();
        edges.sort_by_key(|it| (it.from, it.to));
        let budgets = budgets.iter().map(|it| it.budget(&place, &edges)).collect();
        let scales = self.scales.iter().map(|it| self.scale(it)).collect();
        Some(Graph {
            name: self.rig.name.clone(),
            seed: self.seed,
            duration: self.duration_s.map(Interval::from_s),
            report_speed: self.rig.report_speed,
            paced: self.rig.paced,
            rig_dir: self.rig_dir.clone(),
            claims: Claims::default(),
            pages: Pages::default(),
            host: Host::default(),
            calibration: Arc::clone(self.calibration.as_ref()?),
            scales,
            places: places(self.scales),
            instances,
            edges,
            budgets,
            record: self.rig.record.clone(),
            resolved,
            warnings: Diagnostics::default(),
        })
    }

    fn scale(&self, scale: &ScaleDraft) -> Scale {
        let parent = match scale.parent {
            Parent::Of(parent) => Some(self.scales[parent].name.clone()),
            Parent::Root | Parent::Unclear => None,
        };
        Scale {
            name: scale.name.clone(),
            parent,
            anchor: scale.anchor.as_ref().map(|it| it.get_ref().clone()),
            anchor_rule: scale.rule,
            volume_m: scale.volume_m,
            radius_m: scale.radius_m,
        }
    }

    fn edge(&self, edge: &EdgeDraft, wiring: &Wiring, place: &[usize], instances: &[Instance]) -> Edge {
        let (from, to) = (place[edge.from.0], place[edge.to.0]);
        let consumer = &self.nodes[wiring.instances[edge.to.0].0];
        let input = consumer.text.inputs.get(edge.input);
        let port = input.map_or("", |it| it.port.get_ref());
        let output = instances[from].node_type.ports.outputs.get(edge.from.1).map_or("", |it| it.name);
        let require = consumer.text.requires.iter().find(|it| it.port.get_ref() == port);
        let promised = |it: &Requirement| it.must || *it != Requirement::default();
        Edge {
            from: (from, edge.from.1),
            to: (to, edge.to.1),
            name: format!("{}.{output} -> {}.{port}", instances[from].path, instances[to].path),
            feedback: from >= to,
            delay: input.and_then(|it| it.delay.as_ref()).map(|it| it.0),
            queue: input.map_or_else(Queue::default, |it| it.queue),
            require: require.map(|it| it.requirement).filter(promised),
        }
    }
}

/// How each input port of a node takes data: its own way where the rig does not choose another one.
fn takes(node: &NodeDraft<'_>) -> Vec<InputPolicy> {
    let chosen = |port: &str| {
        let input = node.text.inputs.iter().find(|it| it.port.get_ref() == port)?;
        let tolerance = input.tolerance.as_ref().map(|it| InputPolicy::Synced(it.0));
        tolerance.or(input.policy.as_ref().map(|it| it.0))
    };
    let ports = node.node_type.iter().flat_map(|it| &it.ports.inputs);
    ports.map(|it| chosen(it.name).unwrap_or(it.policy)).collect()
}

fn report_cycles(names: &Names<'_, '_>, wiring: &Wiring, circles: &[Vec<usize>], findings: &mut Findings) {
    let node_of = |instance: usize| wiring.instances[instance].0;
    // The instances of one node for each camera make the same circle each.
    let mut told: BTreeSet<Vec<usize>> = BTreeSet::new();
    for circle in circles {
        let members: BTreeSet<usize> = circle.iter().map(|&it| node_of(it)).collect();
        let members: Vec<usize> = members.into_iter().collect();
        if !told.insert(members.clone()) {
            continue;
        }
        let inside = |edge: &&EdgeDraft| {
            edge.triggers && circle.binary_search(&edge.from.0).is_ok() && circle.binary_search(&edge.to.0).is_ok()
        };
        let edges: Vec<&EdgeDraft> = wiring.edges.iter().filter(inside).collect();
        let arrows = edges.iter().map(|it| Arrow { from: node_of(it.from.0), to: node_of(it.to.0), triggers: true });
        let way = way_around(&members, arrows);
        let full_name = |node: usize| {
            let node = &names.nodes[node];
            format!("{}.{}", names.scales[node.scale].name, node.name())
        };
        let around: Vec<String> = way.iter().chain(way.first()).map(|&it| full_name(it)).collect();
        let mut title = format!("nodes trigger each other in a cycle: {}", around.join(" -> "));
        let beside: Vec<String> = members.iter().filter(|it| !way.contains(it)).map(|&it| full_name(it)).collect();
        if let Some(beside) = listed(beside) {
            title.push_str(&format!("; in cycles with them: {beside}"));
        }
        let mut places: Vec<_> =
            edges.iter().map(|it| (it.place.clone(), node_of(it.from.0), node_of(it.to.0))).collect();
        places.sort_by_key(|it| (it.0.start, it.1, it.2));
        places.dedup();
        let label = |from: usize, to: usize| format!("`{}` triggers `{}`", full_name(from), full_name(to));
        let Some(((first, from, to), rest)) = places.split_first() else { continue };
        let fault = findings.error(first.clone(), title, label(*from, *to));
        for (place, from, to) in rest.iter().take(MOST_PLACES) {
            fault.also(place.clone(), label(*from, *to));
        }
        fault.help(
            "only an input that samples the latest message may close a cycle: `foveate nodes TYPE` says which do",
        );
    }
}

fn warn(names: &Names<'_, '_>, wiring: &Wiring, findings: &mut Findings) {
    let mut triggered = vec![false; names.nodes.len()];
    for edge in wiring.edges.iter().filter(|it| it.triggers) {
        triggered[wiring.instances[edge.to.0].0] = true;
    }
    for (index, node) in names.nodes.iter().enumerate() {
        let Some(node_type) = &node.node_type else { continue };
        let place = node.text.header.clone();
        // A sink that can do without any input has its work from elsewhere, such as a file that its settings name.
        let needs_none = node_type.role == Role::Sink && node_type.ports.inputs.iter().all(|it| it.optional);
        if node_type.role != Role::Source && !needs_none && !triggered[index] {
            findings
                .warning(
                    place.clone(),
                    format_args!("`{}` never runs", node.name()),
                    "none of its inputs that trigger it is connected",
                )
                .help("connect one, or take the node out");
        }
        let is_end = matches!(node_type.role, Role::Sink | Role::Actuator);
        if !wiring.used[index]
            && !is_end
            && !node.is_implied
            && let Some(names) = listed(outputs(node).map(|it| it.name))
        {
            findings
                .warning(
                    place,
                    format_args!("the output of `{}` is not used", node.name()),
                    format_args!("no input is connected to {names}"),
                )
                .help("connect it to a node that takes it, or take the node out");
        }
    }
}
