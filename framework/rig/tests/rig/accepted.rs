//! Rigs without a fault: what becomes of them.

use foveate_node::Interval;
use foveate_node::port::InputPolicy;
use foveate_rig::graph::{Cost, Graph, OnError, PictureForm, Record, SessionPacking, WhenFull};

use crate::parts::good;

pub const LAB: &str = include_str!("lab.toml");

#[test]
fn lab_expands_to_one_instance_a_camera_in_the_order_of_its_edges() {
    let graph = good(LAB);
    let paths: Vec<&str> = graph.instances.iter().map(|it| it.path.as_str()).collect();
    assert_eq!(
        paths,
        [
            "room.video[wide-1]",
            "room.video[wide-2]",
            "room.video[wide-3]",
            "room.leds[wide-1]",
            "room.leds[wide-2]",
            "room.leds[wide-3]",
            "room.targets",
            "room.table",
            "face.anchor",
            "face.aim[ptz-1]",
            "face.aim[ptz-2]",
            "face.heads[ptz-1]",
            "face.heads[ptz-2]",
        ]
    );
    assert_eq!(graph.warnings.list, []);
    let edges: Vec<&str> = graph.edges.iter().map(|it| it.name.as_str()).collect();
    assert_eq!(edges[0], "room.video[wide-1].image -> room.leds[wide-1].image");
    assert_eq!(edges.len(), 3 + 3 + 3 + 1 + 1 + 2 + 2);
    let feedback: Vec<&str> = graph.edges.iter().filter(|it| it.feedback).map(|it| it.name.as_str()).collect();
    assert_eq!(feedback, [1, 2, 3].map(|it| format!("room.targets.hints -> room.leds[wide-{it}].hints")));
    let table = graph.edges.iter().find(|it| it.name.ends_with("table.targets")).unwrap();
    assert_eq!((table.queue.capacity, table.queue.when_full), (64, WhenFull::Wait));
    let promise = graph.edges.iter().find(|it| it.name.ends_with("targets.features")).unwrap().require.unwrap();
    assert_eq!((promise.age_s, promise.rate_hz, promise.must), (Some(0.02), Some(30.0), false));
    assert_eq!(graph.instances[0].on_error, OnError::Stop);
    assert_eq!(graph.scales[1].parent.as_deref(), Some("room"));
}

#[test]
fn sets_are_joined_within_the_tolerance_of_the_rig_and_sinks_have_room_for_a_pause() {
    let joined = |graph: &Graph| {
        graph.instances.iter().find_map(|it| it.takes.iter().copied().find(|it| matches!(it, InputPolicy::Synced(_))))
    };
    let lab = LAB.replace("test.integrator", "test.joiner").replace(", hints = \"targets.hints\"", "");
    let own = good(&lab);
    assert_eq!(joined(&own), Some(InputPolicy::Synced(Interval::from_ms(8.0))));
    let text =
        lab.replacen("features = \"leds.features\"", "features = { from = \"leds.features\", tolerance_ms = 2.5 }", 1);
    let graph = good(&text);
    assert_eq!(joined(&graph), Some(InputPolicy::Synced(Interval::from_ms(2.5))));
    assert!(graph.resolved.contains("tolerance_ms = 2.5"), "{}", graph.resolved);
    assert_eq!(joined(&good(&graph.resolved)), Some(InputPolicy::Synced(Interval::from_ms(2.5))));
    let sampled = LAB.replacen(
        "targets = { from = [\"targets.targets\"]",
        "targets = { tolerance_ms = 3, from = [\"targets.targets\"]",
        1,
    );
    let refused = crate::parts::load(&sampled).unwrap_err().to_string();
    assert!(refused.contains("joins nothing") && refused.contains("found `tolerance_ms`"), "{refused}");
    let sinks = good(&LAB.replace("capacity = 64, ", ""));
    let table = sinks.edges.iter().find(|it| it.name.ends_with("table.targets")).unwrap();
    assert_eq!(table.queue.capacity, 32);
}

#[test]
fn resolved_rig_has_the_defaults_and_is_its_own_resolution() {
    let graph = good(LAB);
    for line in ["offset = 25.0", "max_area = 400", "rate_hz = 60.0", "on_error = \"stop\"", "seed = 1"] {
        assert!(graph.resolved.lines().any(|it| it == line), "{line} in\n{}", graph.resolved);
    }
    let again = good(&graph.resolved);
    assert_eq!(again.resolved, graph.resolved);
    assert_eq!(format!("{again:?}"), format!("{graph:?}"));
    assert_eq!(again.edges, graph.edges);
    assert_eq!(again.scales, graph.scales);
}

#[test]
fn a_recording_has_its_defaults_and_is_its_own_resolution() {
    assert_eq!(good(LAB).record, None);
    assert_eq!(good(&format!("{LAB}\n[record]\n")).record, Some(Record::default()));
    let text = "[record]\nfile = \"a.mcap\"\npictures = \"jpeg\"\njpeg_quality = 80\ncompression = \"zstd\"\nmemory_mb = 64\n\
                cameras = { \"wide-*\" = \"none\", wide-9 = \"lossless\" }\n\
                hide_px = { \"wide-*\" = [[0, 1, 20, 30], [5, 5, 6, 6]] }\nhide_scales = [\"room\"]\n";
    let graph = good(&format!("{LAB}\n{text}"));
    let cameras = [("wide-*", PictureForm::None), ("wide-9", PictureForm::Lossless)];
    let record = Record {
        file: Some("a.mcap".to_owned()),
        pictures: PictureForm::Jpeg,
        jpeg_quality: 80,
        cameras: cameras.map(|(name, form)| (name.to_owned(), form)).into(),
        hide_px: vec![("wide-*".to_owned(), vec![[0, 1, 20, 30], [5, 5, 6, 6]])],
        hide_scales: vec!["room".to_owned()],
        compression: SessionPacking::Zstd,
        memory_mb: 64,
    };
    assert_eq!(graph.record.as_ref(), Some(&record));
    let again = good(&graph.resolved);
    assert_eq!((again.record, again.resolved), (graph.record, graph.resolved));
}

#[test]
fn what_is_probably_not_meant_is_a_warning() {
    let graph = good(&format!(
        "{LAB}\n[scale.room.node.smooth]\ntype = \"test.smoother\"\nin.targets = \"targets.targets\"\n\
         [scale.room.node.idle]\ntype = \"test.listener\"\nin.hints = \"targets.hints\"\n"
    ));
    let about = |at: usize, node: &str| graph.warnings.list[at].title.contains(node);
    assert!(about(0, "`smooth`") && about(1, "`idle`"), "{}", graph.warnings);
    assert_eq!((graph.warnings.n_errors(), graph.warnings.n_warnings()), (0, 2));
    assert_eq!(graph.warnings.list[0].line_column(), (43, 1));
}

#[test]
fn cameras_can_be_named_one_by_one() {
    let text = LAB.replace("\"leds.features\"", "[\"leds[wide-3].features\", \"room.leds[wide-1].features\"]");
    let graph = good(&text);
    let joined: Vec<&str> =
        graph.edges.iter().map(|it| it.name.as_str()).filter(|it| it.ends_with("targets.features")).collect();
    assert_eq!(
        joined,
        ["room.leds[wide-1].features -> room.targets.features", "room.leds[wide-3].features -> room.targets.features"]
    );
    let one = LAB.replacen("each = \"wide-*\"", "camera = \"wide-2\"", 2);
    let graph = good(&one);
    assert_eq!(graph.instances[0].path, "room.video[wide-2]");
    assert_eq!(graph.instances[0].camera, graph.instances[1].camera);
}

#[test]
fn what_is_sampled_comes_first_where_no_cycle_forbids_it() {
    // The listener stands before the integrator in the text.
    let listener = "[scale.room.node.ear]\ntype = \"test.listener\"\nin.hints = \"targets.hints\"\n";
    let graph = good(&LAB.replace("[scale.room.node.targets]", &format!("{listener}[scale.room.node.targets]")));
    let place = |path: &str| graph.instances.iter().position(|it| it.path == path).unwrap();
    assert!(place("room.targets") < place("room.ear"));
    let edge = graph.edges.iter().find(|it| it.to.0 == place("room.ear")).unwrap();
    assert!(!edge.feedback);
}

#[test]
fn variables_in_paths_are_replaced() {
    let lab = std::path::absolute(crate::parts::path().parent().unwrap()).unwrap();
    let home = std::env::var("CARGO_MANIFEST_DIR").unwrap();
    let rest = lab.strip_prefix(&home).unwrap().display().to_string();
    let graph = good(&LAB.replace("\"lab.", &format!("\"${{CARGO_MANIFEST_DIR}}/{rest}/lab.")));
    assert_eq!(graph.calibration.cameras.len(), 5);
    assert!(graph.resolved.contains("${CARGO_MANIFEST_DIR}"), "as written: it is another folder elsewhere");
}

#[test]
fn rig_chooses_how_a_port_takes_data_and_what_a_turn_costs() {
    let own = good(LAB);
    let of = |graph: &Graph| {
        let targets = graph.instances.iter().find(|it| it.node == "targets").unwrap();
        (targets.takes.clone(), targets.cost)
    };
    assert_eq!(of(&own), (vec![InputPolicy::NewestOfEach], Cost::default()));
    assert!(own.resolved.contains("policy = \"newest_of_each\""), "{}", own.resolved);
    assert!(!own.to_svg().contains("round_robin"), "{}", own.to_svg());
    let chosen = good(&LAB.replace(
        "in = { features = \"leds.features\" }",
        "cost_ms = 2.3\ncost_jitter_ms = 1\nin.features = { from = \"leds.features\", policy = \"round_robin\" }",
    ));
    let cost = Cost { time: Interval(2_300_000), jitter: Interval(1_000_000) };
    assert_eq!(of(&chosen), (vec![InputPolicy::RoundRobin], cost));
    assert!(chosen.to_svg().contains("features (round_robin)"));
    assert!(chosen.resolved.contains("policy = \"round_robin\""), "{}", chosen.resolved);
    assert!(chosen.resolved.lines().any(|it| it == "cost_ms = 2.3"), "{}", chosen.resolved);
    assert_eq!(of(&good(&chosen.resolved)), of(&chosen));
    assert_eq!(good(&chosen.resolved).resolved, chosen.resolved);
}
