//! Named targets and the anchors that use them.

use std::sync::{Arc, Mutex};

use foveate_messages::ScaleId;
use foveate_node::Purpose;
use foveate_rig::{self as rig, Overrides};
use foveate_scene::{AnchorRule, Pick};
use nalgebra::{Point3, Vector3};

use crate::accepted::LAB;
use crate::faults::{expect, whole};
use crate::parts::{Aim, bad, good, path, registry_without_aim};

/// The laboratory with a named target; its keys stand from line 43 on.
fn named(keys: &str) -> String {
    format!("{LAB}[scale.room.target.head]\n{keys}\n")
}

#[track_caller]
fn rule(keys: &str) -> AnchorRule {
    let graph = good(&named(keys));
    assert_eq!(graph.warnings.list, []);
    let again = good(&graph.resolved);
    assert_eq!((&again.resolved, &again.scales), (&graph.resolved, &graph.scales));
    graph.scales[1].anchor_rule.expect("the face is anchored")
}

#[test]
fn rule_is_read_with_all_its_keys_and_defaults() {
    let default = AnchorRule::default();
    assert_eq!(good(LAB).scales[1].anchor_rule, Some(default), "without a table");
    assert_eq!(good(LAB).scales[0].anchor_rule, None);
    assert_eq!(rule(""), default);
    assert_eq!(rule("pick = \"lowest\""), AnchorRule { pick: Pick::Lowest, ..default });
    let near = Pick::Nearest(Point3::new(1.0, 0.5, -2.0));
    assert_eq!(rule("pick = \"nearest\"\nnear_m = [1, 0.5, -2]"), AnchorRule { pick: near, ..default });
    assert_eq!(rule("pick = \"id\"\nid = 7"), AnchorRule { pick: Pick::Id(7), ..default });
    let all = "pick = \"highest\"\noffset_m = [0, 0.1, -0.12]\nkeep = false\nsettle_ms = 0\nlost_ms = 33.3\n\
               again_within_m = 0.4\nagain_s = 1.5";
    let expected = AnchorRule {
        pick: Pick::Highest,
        offset: Vector3::new(0.0, 0.1, -0.12),
        keep: false,
        settle_ns: 0,
        lost_ns: 33_300_000,
        again_within: Some(0.4),
        again_ns: 1_500_000_000,
    };
    assert_eq!(rule(all), expected);
}

#[test]
fn resolved_rig_stores_the_rule_that_was_left_out() {
    let graph = good(LAB);
    assert!(graph.resolved.contains("[scale.room.target.head]\npick = \"first\"\n"), "{}", graph.resolved);
    assert!(graph.resolved.contains("settle_ms = 100.0\nlost_ms = 500.0\n"), "{}", graph.resolved);
}

#[test]
fn nodes_of_the_scale_are_given_its_rule_and_radius() {
    let given = Arc::new(Mutex::new(Vec::new()));
    let mut registry = registry_without_aim();
    let seen = Arc::clone(&given);
    registry.add_with::<Aim>(move |_, setup| {
        seen.lock().unwrap().push((setup.anchor, setup.radius_m));
        Ok(Aim)
    });
    let graph = rig::load(&named("pick = \"highest\""), path(), &registry, &Overrides::default()).unwrap();
    let expected = (Some(AnchorRule { pick: Pick::Highest, ..AnchorRule::default() }), Some(0.25));
    assert_eq!(*given.lock().unwrap(), [expected, expected], "while it is checked, for each camera");
    let setup = |node: &str| {
        let index = graph.instances.iter().position(|it| it.node == node).unwrap();
        graph.setup(index, None, Purpose::Run)
    };
    assert_eq!((setup("aim").anchor, setup("aim").radius_m), expected);
    assert_eq!((setup("targets").anchor, setup("targets").radius_m), (None, None));
}

#[test]
fn each_mistake_in_a_named_target_is_pointed_at() {
    let one = |keys: &str, place: &str, underlined: &str, said: &[&str]| whole(&named(keys), place, underlined, said);
    one("pick = \"heighest\"", "43:8", "\"heighest\"", &["did you mean \"highest\"?"]);
    one("pick = 3", "43:8", "3", &["found 3, expected"]);
    one("pik = \"first\"", "43:1", "pik", &["unknown key `pik` in a named target", "did you mean `pick`?"]);
    one("pick = \"nearest\"", "43:8", "\"nearest\"", &["needs `near_m`", "near_m = [x, y, z]"]);
    one("near_m = [0, 0, 0]", "43:10", "[0, 0, 0]", &["`near_m` goes with `pick = \"nearest\"`"]);
    one("pick = \"id\"\nid = -1", "44:6", "-1", &["found -1, expected a whole number from 0 to 4294967295"]);
    one("id = 1", "43:6", "1", &["`id` goes with `pick = \"id\"`"]);
    one("offset_m = [0, 1]", "43:12", "[0, 1]", &["expected three numbers [m]"]);
    one("lost_ms = 0", "43:11", "0", &["expected 1 to 3600000 [ms]"]);
    one("settle_ms = -1", "43:13", "-1", &["expected 0 to 3600000 [ms]"]);
    one("again_within_m = 0.0", "43:18", "0.0", &["expected more than 0 [m]"]);
    one("again_s = 2", "43:11", "2", &["`again_s` says how long `again_within_m` holds"]);
    one("keep = 1", "43:8", "1", &["expected true or false"]);
    whole(&format!("{LAB}[scale.room]\n"), "42:8", "room", &["stands here twice"]);
    whole(
        &format!("{LAB}[scale.face.target]\n\"A b\" = {{}}\n"),
        "43:1",
        "\"A b\"",
        &["a target cannot be named `A b`"],
    );
}

#[test]
fn name_that_is_nearly_a_named_target_is_a_fault_and_one_that_nothing_uses_a_warning() {
    let text = format!("{}[scale.room.target.hand]\n", named("")).replace("targets.head", "targets.haed");
    let faults = bad(&text);
    assert_eq!(faults.list.len(), 1, "{faults}");
    expect(&faults, 0, "29:19", "haed", &["scale `room` names no target `haed`", "did you mean `head`?"]);
    let graph = good(&format!("{}[scale.room.target.hand]\n", named("")));
    assert_eq!(graph.warnings.list.len(), 1, "{}", graph.warnings);
    assert_eq!(graph.warnings.list[0].title, "nothing is anchored to target `hand`");
    let other = good(&named("").replace("targets.head", "targets.foot"));
    assert_eq!(other.scales[1].anchor_rule, Some(AnchorRule::default()), "a name like none of those there");
}

#[test]
fn anchored_scale_is_given_a_node_that_follows_its_target() {
    let ear = "[scale.face.node.ear]\ntype = \"test.spaces\"\nin.spaces = \"anchor.space\"\n";
    let graph = good(&format!("{LAB}{ear}"));
    let anchor = graph.instances.iter().position(|it| it.path == "face.anchor").unwrap();
    assert_eq!(graph.instances[anchor].node_type.name, "scale.anchor");
    let edges: Vec<&str> = graph.edges.iter().map(|it| it.name.as_str()).filter(|it| it.contains("anchor")).collect();
    let expected = ["room.targets.targets -> face.anchor.targets", "face.anchor.space -> face.ear.spaces"];
    assert_eq!(edges, expected);
    assert_eq!(graph.warnings.list, []);
    assert!(!graph.resolved.contains("scale.anchor"), "{}", graph.resolved);
    assert_eq!(good(&graph.resolved).edges, graph.edges);
    let places: Vec<(&str, Option<ScaleId>, bool)> =
        graph.places.iter().map(|it| (it.name.as_str(), it.parent, it.is_anchored)).collect();
    assert_eq!(places, [("room", None, false), ("face", Some(ScaleId(0)), true)]);
    assert_eq!(graph.setup(anchor, None, Purpose::Run).scales.own, ScaleId(1));
    assert!(graph.to_svg().contains("scale.anchor"));
}

#[test]
fn nobody_else_makes_an_anchor_or_takes_its_name() {
    let own = format!("{LAB}[scale.face.node.anchor]\ntype = \"test.listener\"\nin.hints = \"aim.command\"\n");
    let said = ["scale `face` has a node `anchor` of its own", "give this node another name", "gives `anchor.space`"];
    whole(&own, "42:18", "anchor", &said);
    let by_hand =
        format!("{LAB}[scale.face.node.other]\ntype = \"scale.anchor\"\nin.targets = \"room.targets.targets\"\n");
    whole(&by_hand, "43:8", "\"scale.anchor\"", &["is not written in a rig", "is given one, named `anchor`"]);
    good(&format!("{LAB}[scale.room.node.anchor]\ntype = \"test.listener\"\nin.hints = \"targets.hints\"\n"));
}

#[test]
fn scale_is_anchored_to_a_node_that_runs_once() {
    let text = LAB.replace("[scale.room.node.targets]", "[scale.room.node.targets]\neach = \"wide-*\"");
    let text = text.replace(
        "in.targets = { from = \"targets.targets\", capacity = 64, when_full = \"wait\" }",
        "in.targets = \"targets.targets\"",
    );
    let faults = bad(&text);
    let found = faults.list.iter().find(|it| it.title.contains("a scale is anchored to one list of targets"));
    assert!(found.is_some_and(|it| it.line_column() == (30, 10)), "{faults}");
}
