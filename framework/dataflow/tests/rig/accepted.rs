//! Rigs without a fault: what becomes of them.

use foveate_dataflow::graph::{OnError, WhenFull};

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
            "face.aim[ptz-1]",
            "face.aim[ptz-2]",
            "face.heads[ptz-1]",
            "face.heads[ptz-2]",
        ]
    );
    assert_eq!(graph.warnings.list, []);
    let edges: Vec<&str> = graph.edges.iter().map(|it| it.name.as_str()).collect();
    assert_eq!(edges[0], "room.video[wide-1].image -> room.leds[wide-1].image");
    assert_eq!(edges.len(), 3 + 3 + 3 + 1 + 2 + 2);
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
