//! Figures that a node reports without having declared them are kept, and remarked on.

use std::path::Path;
use std::sync::Arc;

use foveate_engine::{self as engine, Options};
use foveate_node::{ConfigError, Due, Figures, Io, Node, NodeError, Ports, Registry, Report, Role, Setup, figures};
use foveate_rig::{self as rig, Overrides};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

figures! {
    "length_m.*": m, low, "Length of the thing of that name";
}

/// It has none.
#[derive(Debug, Clone, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct TalkerSettings {}

/// Reports more than it declares.
struct Talker;

impl Node for Talker {
    const TYPE: &'static str = "test.talker";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Reports more than it declares";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TalkerSettings;

    fn ports() -> Ports {
        Ports::new()
    }

    fn new(_settings: TalkerSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }

    fn process(&mut self, _io: &mut Io<'_>) -> Result<(), NodeError> {
        Ok(())
    }

    fn due(&mut self) -> Due {
        Due::Never
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("length_m.rope", 3.0);
        report.figure("length_m", 4.0);
        report.figure("width", 5.0);
        Err(NodeError::input("what was reported before a failure counts all the same"))
    }
}

#[test]
fn undeclared_figure_is_kept_and_named_with_its_node() {
    let mut registry = Registry::new();
    registry.add::<Talker>();
    let nodes = "[scale.room.node.one]\ntype = \"test.talker\"\n[scale.room.node.two]\ntype = \"test.talker\"\n";
    let text = format!("[rig]\nname = \"test\"\n[scale.room]\n{nodes}");
    for run in [engine::deterministic, engine::live] {
        let graph = match rig::load(&text, Path::new("test.toml"), &registry, &Overrides::default()) {
            Ok(graph) => Arc::new(graph),
            Err(faults) => panic!("{}", faults.render(false)),
        };
        let report = run(graph, &Options::default(), &mut |_| {}).unwrap().report;
        assert_eq!(report.figures["length_m.rope"], 3.0);
        assert_eq!((report.figures["length_m"], report.figures["width"]), (4.0, 5.0), "kept");
        let remarks: Vec<&String> = report.remarks.iter().filter(|it| it.contains("does not declare")).collect();
        assert_eq!(remarks.len(), 2, "one for each node: {remarks:?}");
        for (remark, node) in remarks.iter().zip(["room.one", "room.two"]) {
            for word in [node, "`length_m`", "`width`", "`test.talker`"] {
                assert!(remark.contains(word), "`{word}` is not in: {remark}");
            }
            assert!(!remark.contains("rope"), "that one is declared: {remark}");
        }
        assert_eq!(report.about.keys().collect::<Vec<_>>(), ["length_m.rope", "length_m.rope[room.two]"]);
        assert_eq!(report.about["length_m.rope[room.two]"].unit, "m");
    }
}
