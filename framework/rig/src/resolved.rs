//! A rig with every default filled in, as TOML that loads again to the same graph.

use std::collections::BTreeSet;
use std::fmt::Write;
use std::path::Path;

use foveate_messages::Interval;
use foveate_scene::AnchorRule;
use serde_json::Value as Json;
use toml::Value;

use super::budget::BudgetText;
use super::grammar::connection::WHEN_FULL;
use super::grammar::node::ON_ERROR;
use super::grammar::{self, Key};
use super::lookup::Names;
use super::node_text::RequireText;
use super::nodes::NodeDraft;
use super::read::RigText;
use super::record::{FORMS, PACKINGS};
use super::reference::Reference;
use super::scales::{Parent, ScaleDraft, anchored_to};
use super::targets;
use crate::graph::{Cost, PictureForm, Queue, Record};
use foveate_diagnostics::names::is_plain;
use foveate_node::Origin;
use foveate_node::port::InputPolicy;

/// What of the rig's own table the graph keeps.
pub(super) struct Head<'r> {
    pub rig: &'r RigText<'r>,
    pub seed: u64,
    pub duration_s: Option<f64>,
    /// Where relative paths start, absolute.
    pub folder: &'r Path,
}

/// Writes the whole rig.
///
/// # Errors
/// The index of a node whose settings TOML cannot hold, and why.
pub(super) fn write(head: &Head<'_>, names: &Names<'_, '_>) -> Result<String, (usize, String)> {
    let mut text = String::new();
    let _ = writeln!(text, "# Rig `{}` with every default filled in.\n\n[rig]", head.rig.name);
    line(&mut text, grammar::rig::NAME.name, &Value::from(head.rig.name.as_str()));
    line(&mut text, grammar::rig::FOLDER.name, &Value::from(head.folder.to_string_lossy().as_ref()));
    if let Some(calibration) = &head.rig.calibration {
        line(&mut text, grammar::rig::CALIBRATION.name, &Value::from(calibration.get_ref().as_str()));
    }
    line(&mut text, grammar::rig::SEED.name, &Value::from(i64::try_from(head.seed).unwrap_or(i64::MAX)));
    if let Some(duration_s) = head.duration_s {
        line(&mut text, grammar::rig::DURATION_S.name, &Value::from(duration_s));
    }
    line(&mut text, grammar::rig::REPORT_SPEED.name, &Value::from(head.rig.report_speed));
    line(&mut text, grammar::rig::PACED.name, &Value::from(head.rig.paced));
    let libraries: BTreeSet<&Path> = names.nodes.iter().filter_map(library).collect();
    if !libraries.is_empty() {
        let libraries: Vec<String> = libraries.into_iter().map(|it| it.to_string_lossy().into_owned()).collect();
        let _ = writeln!(text, "\n[plugins]");
        line(&mut text, grammar::plugins::LIBRARIES.name, &Value::from(libraries));
    }
    if let Some(record) = &head.rig.record {
        write_record(&mut text, record);
    }
    write_budgets(&mut text, &head.rig.budgets);
    let anchored = anchored_to(names.scales);
    let mut nodes = names.nodes.iter().enumerate().peekable();
    for (index, scale) in names.scales.iter().enumerate() {
        write_scale(&mut text, names.scales, scale);
        write_targets(&mut text, scale, &anchored[index]);
        while let Some((number, node)) = nodes.next_if(|it| it.1.scale == index) {
            if !node.is_implied {
                write_node(&mut text, names, node).map_err(|error| (number, error))?;
            }
        }
    }
    Ok(text)
}

/// The library that a node's type comes from.
fn library<'n>(node: &'n NodeDraft<'_>) -> Option<&'n Path> {
    match &node.node_type.as_ref()?.origin {
        Origin::Library(path) => Some(path),
        Origin::Linked(_) => None,
    }
}

fn line(text: &mut String, key: &str, value: &Value) {
    let _ = writeln!(text, "{} = {value}", quoted_key(key));
}

/// A key, in quotes where it needs them.
fn quoted_key(key: &str) -> String {
    let bare = !key.is_empty() && key.bytes().all(|it| it.is_ascii_alphanumeric() || it == b'_' || it == b'-');
    if bare { key.to_owned() } else { Value::from(key).to_string() }
}

fn write_record(text: &mut String, record: &Record) {
    use grammar::record::{CAMERAS, COMPRESSION, FILE, HIDE_PX, HIDE_SCALES, JPEG_QUALITY, MEMORY_MB, PICTURES};
    let form = |it: PictureForm| FORMS.iter().find(|word| word.1 == it).map_or("lossless", |word| word.0);
    let _ = writeln!(text, "\n[record]");
    if let Some(file) = &record.file {
        line(text, FILE.name, &Value::from(file.as_str()));
    }
    line(text, PICTURES.name, &Value::from(form(record.pictures)));
    line(text, JPEG_QUALITY.name, &Value::from(i64::from(record.jpeg_quality)));
    let cameras = record.cameras.iter().map(|(name, it)| format!("{} = \"{}\"", quoted_key(name), form(*it)));
    let cameras: Vec<String> = cameras.collect();
    if !cameras.is_empty() {
        let _ = writeln!(text, "{} = {{ {} }}", CAMERAS.name, cameras.join(", "));
    }
    let hidden = record.hide_px.iter().map(|(name, list)| format!("{} = {list:?}", quoted_key(name)));
    let hidden: Vec<String> = hidden.collect();
    if !hidden.is_empty() {
        let _ = writeln!(text, "{} = {{ {} }}", HIDE_PX.name, hidden.join(", "));
    }
    if !record.hide_scales.is_empty() {
        line(text, HIDE_SCALES.name, &Value::from(record.hide_scales.clone()));
    }
    let packing = PACKINGS.iter().find(|it| it.1 == record.compression).map_or("lz4", |it| it.0);
    line(text, COMPRESSION.name, &Value::from(packing));
    line(text, MEMORY_MB.name, &Value::from(i64::from(record.memory_mb)));
}

fn write_budgets(text: &mut String, budgets: &[BudgetText]) {
    use grammar::budget::{AGE_MS, FROM, MUST, TO};
    for budget in budgets {
        let (Some(from), Some(to), Some((age_ms, _))) = (&budget.from, &budget.to, &budget.age_ms) else { continue };
        let _ = writeln!(text, "\n[[budget]]");
        line(text, FROM.name, &Value::from(from.get_ref().as_str()));
        line(text, TO.name, &Value::from(to.get_ref().as_str()));
        line(text, AGE_MS.name, &Value::from(*age_ms));
        line(text, MUST.name, &Value::from(budget.must));
    }
}

fn write_scale(text: &mut String, scales: &[ScaleDraft], scale: &ScaleDraft) {
    let _ = writeln!(text, "\n[scale.{}]", quoted_key(&scale.name));
    if let Parent::Of(parent) = scale.parent {
        line(text, grammar::scale::PARENT.name, &Value::from(scales[parent].name.as_str()));
    }
    if let Some(anchor) = &scale.anchor {
        line(text, grammar::scale::ANCHOR.name, &Value::from(anchor.get_ref().as_str()));
    }
    if let Some(corners) = scale.volume_m {
        let [min, max] = corners.map(|corner| Value::from(corner.to_vec()));
        let _ = writeln!(text, "{} = {{ min = {min}, max = {max} }}", grammar::scale::VOLUME_M.name);
    }
    if let Some(radius_m) = scale.radius_m {
        line(text, grammar::scale::RADIUS_M.name, &Value::from(radius_m));
    }
}

/// The scale's named targets, then those of `anchored` without a table of their own.
fn write_targets(text: &mut String, scale: &ScaleDraft, anchored: &[(&str, &AnchorRule)]) {
    let mut written = BTreeSet::new();
    let named = scale.targets.iter().map(|it| (it.name.get_ref().as_str(), &it.rule));
    for (name, rule) in named.chain(anchored.iter().copied().filter(|it| is_plain(it.0))) {
        if written.insert(name) {
            let _ = writeln!(text, "\n[scale.{}.target.{}]", quoted_key(&scale.name), quoted_key(name));
            targets::write(text, rule);
        }
    }
}

fn write_node(text: &mut String, names: &Names<'_, '_>, node: &NodeDraft<'_>) -> Result<(), String> {
    let (Some(node_type), Some(settings)) = (&node.node_type, &node.settings) else { return Ok(()) };
    let scale = quoted_key(&names.scales[node.scale].name);
    let _ = writeln!(text, "\n[scale.{scale}.node.{}]", quoted_key(node.name()));
    line(text, grammar::node::TYPE.name, &Value::from(node_type.name));
    if let Some(each) = &node.text.each {
        let patterns: Vec<&str> = each.get_ref().iter().map(|it| it.get_ref().as_str()).collect();
        let value = match patterns[..] {
            [one] => Value::from(one),
            _ => Value::from(patterns),
        };
        line(text, grammar::node::EACH.name, &value);
    }
    if let Some(camera) = &node.text.camera {
        line(text, grammar::node::CAMERA.name, &Value::from(camera.get_ref().as_str()));
    }
    let on_error = ON_ERROR.iter().find(|it| it.1 == node.text.on_error).map_or("stop", |it| it.0);
    line(text, grammar::node::ON_ERROR_KEY.name, &Value::from(on_error));
    // Nothing where activations cost nothing: the rig may be one for cameras and motors.
    if node.text.cost != Cost::default() {
        line(text, grammar::node::COST_MS.name, &in_ms(node.text.cost.time));
        line(text, grammar::node::COST_JITTER_MS.name, &in_ms(node.text.cost.jitter));
    }
    for input in &node.text.inputs {
        let from: Vec<String> = input.from.iter().map(|it| full_reference(names, node, it.get_ref())).collect();
        let from = match from.as_slice() {
            [one] => Value::from(one.as_str()),
            several => Value::from(several.to_vec()),
        };
        let Queue { capacity, when_full } = input.queue;
        let when_full = WHEN_FULL.iter().find(|it| it.1 == when_full).map_or("drop_oldest", |it| it.0);
        let own = node_type.ports.inputs.iter().find(|it| it.name == input.port.get_ref()).map(|it| it.policy);
        let policy = input.policy.as_ref().map(|it| it.0).or(own).and_then(InputPolicy::choice);
        let tolerance = match (&input.tolerance, own) {
            (Some((stated, _)), _) => Some(*stated),
            (None, Some(InputPolicy::Synced(own))) => Some(own),
            (None, _) => None,
        };
        use grammar::connection::{CAPACITY, DELAY_MS, FROM, POLICY, TOLERANCE_MS, WHEN_FULL_KEY};
        let keys = [
            (FROM, Some(from)),
            (CAPACITY, Some(Value::from(capacity as i64))),
            (WHEN_FULL_KEY, Some(Value::from(when_full))),
            (POLICY, policy.map(Value::from)),
            (TOLERANCE_MS, tolerance.map(in_ms)),
            (DELAY_MS, input.delay.as_ref().map(|it| in_ms(it.0))),
        ];
        let _ = writeln!(text, "in.{} = {}", quoted_key(input.port.get_ref()), inline(&keys));
    }
    for require in &node.text.requires {
        let _ = writeln!(text, "require.{} = {}", quoted_key(require.port.get_ref()), requirement(require));
    }
    let mut table = toml::Table::try_from(settings.resolved()).map_err(|error| error.to_string())?;
    // In the order of the source, as far as the schema tells it.
    let properties = node_type.schema.as_value().get("properties").and_then(Json::as_object);
    for name in properties.into_iter().flat_map(|it| it.keys()) {
        if let Some(value) = table.remove(name) {
            line(text, name, &value);
        }
    }
    for (name, value) in &table {
        line(text, name, value);
    }
    Ok(())
}

/// In milliseconds; a quotient, unlike a product, gives back the very number that was read.
fn in_ms(interval: Interval) -> Value {
    Value::from(interval.0 as f64 / 1e6)
}

/// A reference with its scale.
fn full_reference(names: &Names<'_, '_>, consumer: &NodeDraft<'_>, written: &str) -> String {
    match Reference::parse(written) {
        Some(Reference { scale: None, .. }) => format!("{}.{written}", names.scales[consumer.scale].name),
        _ => written.to_owned(),
    }
}

fn requirement(require: &RequireText) -> String {
    let it = &require.requirement;
    use grammar::requirement::{AGE_MS, LOSS, MUST, RATE_HZ, SIGMA};
    inline(&[
        (AGE_MS, require.age_ms.as_ref().map(|it| Value::from(it.0))),
        (RATE_HZ, it.rate_hz.map(Value::from)),
        (SIGMA, it.sigma.map(Value::from)),
        (LOSS, it.loss.map(Value::from)),
        (MUST, Some(Value::from(it.must))),
    ])
}

/// A table in one line, of the keys that have a value.
fn inline(keys: &[(Key, Option<Value>)]) -> String {
    let parts = keys.iter().filter_map(|(key, value)| Some(format!("{} = {}", key.name, value.as_ref()?)));
    format!("{{ {} }}", parts.collect::<Vec<_>>().join(", "))
}
