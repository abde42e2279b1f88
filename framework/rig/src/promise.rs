//! Checks requirements against the plan: rates and least ages, propagated from the sources along the schedule.

use super::lookup::Names;
use super::nodes::instance_path;
use super::wire::{EdgeDraft, Wiring};
use foveate_diagnostics::Findings;
use foveate_node::node::Role;
use foveate_node::port::InputPolicy;

/// The best that an instance can give.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Best {
    /// Messages a second on each output, at most; `None`: not known beforehand.
    rate_hz: Option<f64>,
    /// Age of what it gives out, at least [s].
    pub age_s: f64,
    /// The instance that gives it the youngest messages that trigger it.
    pub youngest: Option<usize>,
}

/// What triggers one input port of an instance.
#[derive(Debug, Clone, Copy)]
struct Port {
    index: usize,
    rate_hz: Option<f64>,
}

/// Reports every requirement that no run of this rig can meet.
pub(super) fn check(names: &Names<'_, '_>, wiring: &Wiring, best: &[Best], findings: &mut Findings) {
    for edge in &wiring.edges {
        check_edge(names, wiring, edge, best[edge.from.0], findings);
    }
}

/// By instance: the best that it can give.
pub(super) fn carried(names: &Names<'_, '_>, wiring: &Wiring, order: &[usize]) -> Vec<Best> {
    let mut incoming: Vec<Vec<usize>> = vec![Vec::new(); wiring.instances.len()];
    for (number, edge) in wiring.edges.iter().enumerate().filter(|it| it.1.triggers) {
        incoming[edge.to.0].push(number);
    }
    let mut best = vec![Best::default(); wiring.instances.len()];
    for &instance in order {
        let node = &names.nodes[wiring.instances[instance].0];
        let mut least_age: Option<(f64, usize)> = None;
        let mut ports: Vec<Port> = Vec::new();
        for &edge in &incoming[instance] {
            let edge = &wiring.edges[edge];
            let of = best[edge.from.0];
            if least_age.is_none_or(|it| of.age_s < it.0) {
                least_age = Some((of.age_s, edge.from.0));
            }
            let joined = node.node_type.as_ref().is_some_and(|it| {
                it.ports.inputs.get(edge.to.1).is_some_and(|port| matches!(port.policy, InputPolicy::Synced(_)))
            });
            match ports.iter_mut().find(|it| it.index == edge.to.1) {
                Some(port) => {
                    // A joined set comes no more often than its fastest source; otherwise every message counts.
                    let both = port.rate_hz.zip(of.rate_hz);
                    port.rate_hz = both.map(|(a, b)| if joined { a.max(b) } else { a + b });
                }
                None => ports.push(Port { index: edge.to.1, rate_hz: of.rate_hz }),
            }
        }
        let known = wiring.sound[wiring.instances[instance].0] && !ports.is_empty();
        let triggered = if known { ports.iter().map(|it| it.rate_hz).sum::<Option<f64>>() } else { None };
        let least_age = least_age.filter(|_| wiring.sound[wiring.instances[instance].0]);
        let is_source = node.node_type.as_ref().is_some_and(|it| it.role == Role::Source);
        best[instance] = Best {
            rate_hz: node.plan.rate_hz.or(if is_source { None } else { triggered }),
            age_s: node.plan.latency_s.max(0.0) + least_age.map_or(0.0, |it| it.0),
            youngest: least_age.map(|it| it.1),
        };
    }
    best
}

fn check_edge(names: &Names<'_, '_>, wiring: &Wiring, edge: &EdgeDraft, best: Best, findings: &mut Findings) {
    let (consumer, _) = wiring.instances[edge.to.0];
    let consumer = &names.nodes[consumer];
    let port = consumer.text.inputs[edge.input].port.get_ref();
    let Some(require) = consumer.text.requires.iter().find(|it| it.port.get_ref() == port) else { return };
    let path = |instance: usize| {
        let (node, camera) = wiring.instances[instance];
        let node = &names.nodes[node];
        instance_path(&names.scales[node.scale].name, node.name(), camera.map(|it| names.camera_name(it)))
    };
    // Instances of one node share their settings, so the first edge of each reference says it all; `dedup` in the
    // findings would not see that, as the paths differ.
    let mut refuse = |span: &foveate_diagnostics::Span, title: String, label: String| {
        if findings.is_new(span, &label) {
            findings
                .error(span.clone(), title, label)
                .help("the plan is what the nodes' settings promise; no run can do better")
                .also(edge.place.clone(), format_args!("given by `{}`", path(edge.from.0)));
        }
    };
    if let (Some((age_ms, span)), Some(wanted)) = (&require.age_ms, require.requirement.age_s)
        && best.age_s > wanted * (1.0 + 1e-9)
    {
        let least = round(best.age_s * 1e3);
        let title = format!("input `{port}` of `{}` cannot be as young as required", consumer.name());
        refuse(
            span,
            title,
            format!("found {age_ms} ms, expected at least {least} ms: the least age at which messages can arrive"),
        );
    }
    if let (Some(span), Some(wanted), Some(most)) = (&require.rate, require.requirement.rate_hz, best.rate_hz)
        && most < wanted * (1.0 - 1e-9)
    {
        let most = round(most);
        let title = format!("input `{port}` of `{}` cannot come as often as required", consumer.name());
        refuse(span, title, format!("found {wanted} Hz, expected at most {most} Hz: the most that can arrive"));
    }
}

/// For messages: three decimals.
pub(super) fn round(value: f64) -> f64 {
    (value * 1e3).round() * 1e-3
}
