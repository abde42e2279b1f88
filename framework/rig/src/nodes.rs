//! Nodes one by one: the type looked up, the settings checked and decoded, one instance a camera, each made on trial.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use foveate_estimation::random::Random;
use foveate_messages::CameraId;
use foveate_scene::calibration::Calibration;
use serde::Deserialize;
use toml::de::DeTable;

use super::node_text::NodeText;
use super::scales::ScaleDraft;
use super::schema::written;
use super::settings;
use crate::graph::{SINK_CAPACITY, scale_id};
use foveate_diagnostics::names::{available, did_you_mean, likely, listed, shown};
use foveate_diagnostics::{Findings, Span};
use foveate_node::given;
use foveate_node::guard::guarded;
use foveate_node::node::{Plan, Role};
use foveate_node::page::Pages;
use foveate_node::registry::{NodeType, Registry, Settings};
use foveate_node::scale::{ScalePlace, ScaleTree};
use foveate_node::setup::{Claims, NameReference, Purpose, Setup};
use foveate_node::{ConfigError, Host};
use foveate_scene::selection::{SelectionError, select};

/// A node after what can be said of it alone. What is `None` was at fault and has been reported.
pub(super) struct NodeDraft<'t> {
    pub text: NodeText<'t>,
    /// Index in the rig's scales.
    pub scale: usize,
    pub node_type: Option<Arc<NodeType>>,
    pub settings: Option<Arc<dyn Settings>>,
    /// One entry an instance: its camera, if it has one.
    pub cameras: Option<Vec<Option<CameraId>>>,
    pub plan: Plan,
    /// Made for the scale's anchor, not written in the rig.
    pub is_implied: bool,
}

impl NodeDraft<'_> {
    /// The node's name in its scale.
    pub fn name(&self) -> &str {
        self.text.name.get_ref()
    }
}

/// The rig around a node.
pub(super) struct Surroundings<'r> {
    pub registry: &'r Registry,
    /// Whether every library of nodes that the rig names could be used; where not, that has been reported.
    pub has_all_libraries: bool,
    /// `None` when it could not be read, which has been reported.
    pub calibration: Option<Arc<Calibration>>,
    /// Whether the rig names a calibration.
    pub names_calibration: bool,
    pub rig_dir: &'r Path,
    pub claims: Claims,
    /// References from nodes to things of other nodes: the place in the rig, and the referring node.
    pub wanted: RefCell<Vec<(Span, String, NameReference)>>,
    pub seed: u64,
    pub places: Arc<[ScalePlace]>,
}

/// What a node needs to know of its scale.
pub(super) struct ScaleView<'r> {
    pub index: usize,
    pub scale: &'r ScaleDraft,
}

impl Surroundings<'_> {
    /// Checks one node.
    pub fn draft<'t>(&self, mut text: NodeText<'t>, scale: &ScaleView<'_>, findings: &mut Findings) -> NodeDraft<'t> {
        let node_type = self.node_type(&text, findings);
        let cameras = self.cameras(&text, findings);
        if node_type.as_ref().is_some_and(|it| it.role == Role::Sink) {
            for input in text.inputs.iter_mut().filter(|it| !it.has_capacity) {
                input.queue.capacity = SINK_CAPACITY;
            }
        }
        let given = std::mem::take(&mut text.settings);
        let settings = node_type.as_ref().and_then(|it| decode(it, &text, &given, findings));
        let plan = settings.as_ref().and_then(|it| match guarded(|| it.plan()) {
            Ok(plan) => Some(plan),
            Err(said) => {
                let title = format!("the plan of `{}` cannot be read", text.name.get_ref());
                findings.error(text.header.clone(), title, format_args!("the node {said}: a mistake in its program"));
                None
            }
        });
        let plan = plan.unwrap_or_default();
        if let (Some(settings), Some(cameras), true) = (&settings, &cameras, scale.scale.sound) {
            self.try_out(&text, scale, &given, settings, cameras, findings);
        }
        NodeDraft { text, scale: scale.index, node_type, settings, cameras, plan, is_implied: false }
    }

    fn node_type(&self, text: &NodeText<'_>, findings: &mut Findings) -> Option<Arc<NodeType>> {
        let Some(name) = &text.type_name else {
            if !text.has_type {
                let title = format!("node `{}` has no type", text.name.get_ref());
                findings
                    .error(text.header.clone(), title, "expected `type = \"PLUGIN.NODE\"` here")
                    .help("`foveate nodes` lists the node types");
            }
            return None;
        };
        let found = self.registry.get(name.get_ref());
        // One that is not known may stand in a library that was refused.
        if found.is_none() && self.has_all_libraries {
            let known = written(self.registry).map(|it| it.name).collect::<Vec<_>>();
            findings
                .error(
                    name.span(),
                    format_args!("unknown node type `{}`", shown(name.get_ref())),
                    "expected the name of a node type",
                )
                .help(match likely(name.get_ref(), known.iter().copied()) {
                    Some(meant) => format!("did you mean `{meant}`? `foveate nodes` lists all types"),
                    None => format!("{}; `foveate nodes` lists them with what they do", available("the types", known)),
                });
        }
        found.cloned()
    }

    fn cameras(&self, text: &NodeText<'_>, findings: &mut Findings) -> Option<Vec<Option<CameraId>>> {
        if text.cameras_unclear {
            return None;
        }
        let (span, key) = match (&text.each, &text.camera) {
            (Some(each), _) => (each.span(), "each"),
            (None, Some(camera)) => (camera.span(), "camera"),
            (None, None) => return Some(vec![None]),
        };
        let calibration = self.calibration.as_ref()?;
        if !self.names_calibration {
            findings
                .error(
                    span,
                    format_args!("`{key}` needs cameras, and the rig names no calibration"),
                    "found no cameras",
                )
                .help("add `calibration = \"FILE\"` under `[rig]`");
            return None;
        }
        let names: Vec<&str> = calibration.cameras.iter().map(|it| it.name.as_str()).collect();
        let instance = |index: usize| u16::try_from(index).ok().map(|it| Some(CameraId(it)));
        if let Some(each) = &text.each {
            let patterns: Vec<&str> = each.get_ref().iter().map(|it| it.get_ref().as_str()).collect();
            return match select(&patterns, &names) {
                Ok(found) => Some(found.into_iter().filter_map(instance).collect()),
                Err(SelectionError { pattern, found, help }) => {
                    let place = pattern.map_or(span, |it| each.get_ref()[it].span());
                    findings.error(place, found, "expected a pattern of camera names").help(help);
                    None
                }
            };
        }
        let wish = text.camera.as_ref()?;
        let found: Vec<Option<CameraId>> =
            (0..names.len()).filter(|it| names[*it] == wish.get_ref()).filter_map(instance).collect();
        if found.is_empty() {
            let help = did_you_mean(wish.get_ref(), "its cameras", names);
            findings
                .error(
                    span,
                    format_args!("no camera of the calibration is `{}`", shown(wish.get_ref())),
                    "expected the name of a camera",
                )
                .help(help);
            return None;
        }
        Some(found)
    }

    /// References that no node resolves, once all nodes were tried out.
    pub fn refuse_unknown_names(&self, findings: &mut Findings) {
        for (place, node, NameReference { setting, kind, name }) in self.wanted.take() {
            let offered = self.claims.offered(kind);
            if offered.is_empty() || offered.contains(&name) {
                continue;
            }
            let title = format!("`{node}` cannot work with this `{setting}`");
            let label = format!("no {kind} is `{}`, expected the name of one", shown(&name));
            let known = offered.iter().map(String::as_str);
            findings.error(place, title, label).help(did_you_mean(&name, &format!("the {kind}s"), known));
        }
    }

    /// Makes every instance once, so that what is missing for one camera only is found too.
    fn try_out(
        &self,
        text: &NodeText<'_>,
        ScaleView { index, scale }: &ScaleView<'_>,
        given: &DeTable<'_>,
        settings: &Arc<dyn Settings>,
        cameras: &[Option<CameraId>],
        findings: &mut Findings,
    ) {
        let Some(calibration) = &self.calibration else { return };
        // By setting and by message with the camera's name taken out: the first message and the cameras it is about.
        let mut complaints: BTreeMap<(Option<String>, String), (String, Vec<String>)> = BTreeMap::new();
        let random = Random::new(self.seed);
        for camera in cameras {
            let camera_name =
                camera.and_then(|it| calibration.cameras.get(usize::from(it.0))).map(|it| it.name.as_str());
            let instance = instance_path(&scale.name, text.name.get_ref(), camera_name);
            let setup = Setup {
                random: random.fork(&instance),
                instance,
                scale: scale.name.clone(),
                scales: ScaleTree { own: scale_id(*index), places: Arc::clone(&self.places) },
                camera: *camera,
                calibration: Arc::clone(calibration),
                connected: text.inputs.iter().map(|it| it.port.get_ref().to_string()).collect(),
                volume_m: scale.volume_m,
                radius_m: scale.radius_m,
                anchor: scale.rule,
                rig_dir: self.rig_dir.to_owned(),
                out_dir: None,
                purpose: Purpose::Check,
                claims: self.claims.clone(),
                pages: Pages::default(),
                host: Host::default(),
            };
            let (setting, message) = match guarded(|| settings.build(&setup).map(drop)) {
                Ok(Ok(())) => continue,
                Ok(Err(error)) => (error.setting, error.message),
                Err(said) => (None, format!("the node {said}: a mistake in its program")),
            };
            let alike = camera_name.map_or_else(|| message.clone(), |it| message.replace(it, "{camera}"));
            let entry = complaints.entry((setting, alike)).or_insert_with(|| (message, Vec::new()));
            entry.1.extend(camera_name.map(str::to_owned));
        }
        let wanted = self.claims.take_references().into_iter().map(|it| {
            let place = settings::place_of(given, &it.setting).unwrap_or_else(|| text.header.clone());
            (place, text.name.get_ref().to_string(), it)
        });
        self.wanted.borrow_mut().extend(wanted);
        for ((setting, alike), (message, of)) in complaints {
            let place = setting.as_deref().and_then(|it| settings::place_of(given, it));
            let name = text.name.get_ref();
            let title = match &setting {
                Some(setting) => format!("`{name}` cannot work with this `{setting}`"),
                None => format!("`{name}` cannot be made"),
            };
            let left_out = setting.filter(|_| place.is_none()).map(|it| format!(" (`{it}` is left out: its default)"));
            let label = format!("{message}{}", left_out.unwrap_or_default());
            let fault = findings.error(place.unwrap_or_else(|| text.header.clone()), title, label);
            // All cameras and not a word about any: the cameras do not matter.
            if of.len() < cameras.len() || (of.len() > 1 && alike != message) {
                fault.maybe_help(
                    listed(&of).map(|it| format!("so for the camera{} {it}", if of.len() == 1 { "" } else { "s" })),
                );
            }
        }
    }
}

/// `room.leds[wide-3]`, or `room.targets` without a camera.
pub(super) fn instance_path(scale: &str, node: &str, camera: Option<&str>) -> String {
    match camera {
        Some(camera) => format!("{scale}.{node}[{camera}]"),
        None => format!("{scale}.{node}"),
    }
}

/// Settings for a node, which knows no TOML.
pub(super) fn given_table(table: toml::Table) -> given::Table {
    table.into_iter().map(|(key, value)| (key, given_value(value))).collect()
}

fn given_value(value: toml::Value) -> given::Value {
    match value {
        toml::Value::Boolean(it) => given::Value::Bool(it),
        toml::Value::Integer(it) => given::Value::Integer(it),
        toml::Value::Float(it) => given::Value::Float(it),
        toml::Value::String(it) => given::Value::Text(it),
        toml::Value::Array(it) => given::Value::List(it.into_iter().map(given_value).collect()),
        toml::Value::Table(it) => given::Value::Table(given_table(it)),
        toml::Value::Datetime(_) => given::Value::Other("a date"),
    }
}

fn decode(
    node_type: &NodeType,
    text: &NodeText<'_>,
    given: &DeTable<'_>,
    findings: &mut Findings,
) -> Option<Arc<dyn Settings>> {
    let mut found = Findings::default();
    settings::check(node_type.schema.as_value(), node_type.name, given, text.header.clone(), &mut found);
    let refused = found.any_error();
    findings.append(found);
    if refused {
        return None;
    }
    let whole = toml::Spanned::new(0..0, toml::de::DeValue::Table(given.clone()));
    let table = match toml::Table::deserialize(toml::de::ValueDeserializer::from(whole)) {
        Ok(table) => table,
        Err(error) => {
            let place = error.span().filter(|it| !it.is_empty()).unwrap_or_else(|| text.header.clone());
            findings.error(place, format_args!("`{}` cannot read its settings", node_type.name), error.message());
            return None;
        }
    };
    let decoded = guarded(|| node_type.decode(given_table(table)))
        .unwrap_or_else(|said| Err(ConfigError::node(format_args!("the node {said}: a mistake in its program"))));
    match decoded {
        Ok(settings) => Some(Arc::from(settings)),
        Err(error) => {
            let place = error.setting.and_then(|it| settings::place_of(given, &it));
            let title = format!("`{}` cannot read its settings", node_type.name);
            findings.error(place.unwrap_or_else(|| text.header.clone()), title, shown(&error.message));
            None
        }
    }
}
