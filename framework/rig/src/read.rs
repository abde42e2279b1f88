//! A rig's text as written: scales and nodes with the place of each word, before anything is looked up.

use toml::Spanned;
use toml::de::DeTable;

use super::budget::{self, BudgetText};
use super::grammar::{rig as head, scale};
use super::libraries;
use super::node_text::NodeText;
use super::record;
use super::targets::{self, NamedTarget};
use super::values::{plain_name, read_point};
use crate::graph::Record;
use foveate_diagnostics::names::shown;
use foveate_diagnostics::value::{Keys, Value};
use foveate_diagnostics::{Findings, Span};

/// A rig as written.
pub(super) struct RigText<'t> {
    /// `[rig]`, or the start of the text.
    pub header: Span,
    pub name: String,
    pub calibration: Option<Spanned<String>>,
    pub folder: Option<Spanned<String>>,
    pub seed: u64,
    pub duration_s: Option<f64>,
    pub report_speed: bool,
    pub paced: bool,
    /// `[plugins] libraries`.
    pub libraries: Vec<Spanned<String>>,
    /// In the order of the text.
    pub budgets: Vec<BudgetText>,
    /// `[record]`.
    pub record: Option<Record>,
    /// In the order of the text.
    pub scales: Vec<ScaleText<'t>>,
}

/// A scale as written.
pub(super) struct ScaleText<'t> {
    pub name: Spanned<String>,
    pub parent: Option<Spanned<String>>,
    /// Whether a parent stands there that was not understood.
    pub parent_unclear: bool,
    pub anchor: Option<Spanned<String>>,
    pub volume_m: Option<[[f64; 3]; 2]>,
    pub radius_m: Option<f64>,
    /// In the order of the text.
    pub targets: Vec<NamedTarget>,
    /// Whether volume, radius and named targets were understood.
    pub sound: bool,
    /// In the order of the text.
    pub nodes: Vec<NodeText<'t>>,
}

/// Takes a parsed document apart.
pub(super) fn read<'t>(document: DeTable<'t>, text: &str, findings: &mut Findings) -> RigText<'t> {
    let mut top = Keys::new(document, 0..0);
    let mut rig = read_rig(&mut top, text, findings);
    if let Some((key, value)) = top.take_entry("plugins") {
        rig.libraries = libraries::read(&key, value, text, findings);
    }
    if let Some((key, value)) = top.take_entry("record") {
        rig.record = record::read(&key, value, text, findings);
    }
    if let Some((key, value)) = top.take_entry("budget") {
        rig.budgets = budget::read(&key, value, text, findings);
    }
    if let Some((key, value)) = top.take_entry("scale") {
        let scales = findings.table(&key, value, text, "tables `[scale.NAME]`");
        for (name, value) in scales.map(|mut it| it.take_rest()).unwrap_or_default() {
            rig.scales.extend(read_scale(name, value, text, findings));
        }
    }
    if rig.scales.iter().all(|it| it.nodes.is_empty()) && findings.count() == 0 {
        findings
            .error(rig.header.clone(), "this rig has no nodes", "expected at least one table `[scale.NAME.node.NODE]`")
            .help("`foveate new rig` writes one to start from");
    }
    top.close("a rig", findings);
    rig
}

fn read_rig<'t>(top: &mut Keys<'t>, text: &str, findings: &mut Findings) -> RigText<'t> {
    let mut rig = RigText {
        header: 0..0,
        name: String::new(),
        calibration: None,
        folder: None,
        seed: 1,
        duration_s: None,
        report_speed: false,
        paced: false,
        libraries: Vec::new(),
        budgets: Vec::new(),
        record: None,
        scales: Vec::new(),
    };
    let Some((key, value)) = top.take_entry("rig") else {
        findings
            .error(0..0, "the rig has no name", "expected a table `[rig]` with `name = \"…\"`")
            .help("write `[rig]` and under it `name = \"my-lab\"`");
        return rig;
    };
    let Some(mut keys) = findings.table(&key, value, text, "a table `[rig]`") else { return rig };
    rig.header = keys.header.clone();
    if keys.table.contains_key(head::NAME.name) {
        if let Some(name) = head::NAME.text(&mut keys, findings) {
            plain_name("rig", &name, findings);
            rig.name = name.into_inner();
        }
    } else {
        findings
            .error(rig.header.clone(), "the rig has no name", "expected `name` here")
            .help("add `name = \"my-lab\"`: results are filed under it");
    }
    rig.calibration = head::CALIBRATION.text(&mut keys, findings);
    rig.folder = head::FOLDER.text(&mut keys, findings);
    rig.seed = head::SEED.whole(&mut keys, findings).map_or(rig.seed, i64::unsigned_abs);
    rig.duration_s = head::DURATION_S.number(&mut keys, findings).map(|it| it.0);
    rig.report_speed = head::REPORT_SPEED.flag(&mut keys, findings).unwrap_or(rig.report_speed);
    rig.paced = head::PACED.flag(&mut keys, findings).unwrap_or(rig.paced);
    keys.close("`[rig]`", findings);
    rig
}

/// Whether a run may be cut off after `seconds`.
pub(super) fn is_duration(seconds: f64) -> bool {
    seconds > 0.0 && seconds <= head::LONGEST_S
}

fn read_scale<'t>(
    name: Spanned<String>,
    value: Value<'t>,
    text: &str,
    findings: &mut Findings,
) -> Option<ScaleText<'t>> {
    let mut keys = findings.table(&name, value, text, "a table `[scale.NAME]`")?;
    plain_name("scale", &name, findings);
    let faults_before = findings.count();
    let volume_m = match keys.take_entry(scale::VOLUME_M.name) {
        Some((key, value)) => read_volume(&key, value, text, findings),
        None => None,
    };
    let radius_m = scale::RADIUS_M.number(&mut keys, findings).map(|it| it.0);
    let targets = targets::read(&mut keys, text, findings);
    let sound = findings.count() == faults_before;
    let has_parent = keys.table.contains_key(scale::PARENT.name);
    let parent = scale::PARENT.text(&mut keys, findings);
    let anchor = scale::ANCHOR.text(&mut keys, findings);
    let mut nodes = Vec::new();
    if let Some((key, value)) = keys.take_entry(scale::NODE.name) {
        let tables = findings.table(&key, value, text, "tables `[scale.NAME.node.NODE]`");
        for (node, value) in tables.map(|mut it| it.take_rest()).unwrap_or_default() {
            plain_name("node", &node, findings);
            nodes.extend(NodeText::read(node, value, text, findings));
        }
    }
    keys.close(&format!("`[scale.{}]`", shown(name.get_ref())), findings);
    Some(ScaleText {
        parent_unclear: has_parent && parent.is_none(),
        name,
        parent,
        anchor,
        volume_m,
        radius_m,
        targets,
        sound,
        nodes,
    })
}

fn read_volume(key: &Spanned<String>, value: Value<'_>, text: &str, findings: &mut Findings) -> Option<[[f64; 3]; 2]> {
    let whole = value.span();
    let mut keys = findings.table(key, value, text, "`{ min = [x, y, z], max = [x, y, z] }` [m]")?;
    let mut corners = [None; 2];
    for (corner, name) in corners.iter_mut().zip(["min", "max"]) {
        match keys.take(name) {
            Some(value) => *corner = read_point(name, &value, findings),
            None => {
                let label = format!("expected `{name} = [x, y, z]` [m]");
                findings.error(keys.header.clone(), format_args!("`volume_m` lacks `{name}`"), label);
            }
        }
    }
    keys.close("`volume_m`", findings);
    let volume = [corners[0]?, corners[1]?];
    if let Some(axis) = (0..3).find(|&axis| volume[0][axis] >= volume[1][axis]) {
        let [min, max] = [volume[0][axis], volume[1][axis]];
        let name = ["x", "y", "z"][axis];
        let label = format!("found {min} to {max} m in {name}, expected `min` below `max`");
        findings.error(whole, "`volume_m` is empty", label);
        return None;
    }
    Some(volume)
}
