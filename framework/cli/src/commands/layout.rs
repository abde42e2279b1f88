//! A layout of Foxglove and Lichtblick for a session: what it draws, in the panels that draw it.

use std::collections::BTreeMap;

use foveate_session::source::{Channel, camera_of, fact};
use foveate_session::{Session, picture};
use serde_json::{Map, Value, json};

/// Most panels of pictures: more are too small to be read.
const MOST_PICTURES: usize = 4;
/// Most lines of a plot.
const MOST_LINES: usize = 8;

/// The layout, as their menu "Import from file" reads it. `space` is the frame that is looked at from outside, `edges` what passes along edges.
pub(super) fn layout(session: &Session, space: &str, edges: &[String]) -> String {
    let channels: Vec<&Channel> = session.summary.channels.values().collect();
    let schema = |id: u16| session.summary.schemas.get(&id).map_or("", |it| it.0.name.as_str());
    let drawn =
        channels.iter().filter(|it| ["foxglove.SceneUpdate", "foxglove.PointCloud"].contains(&schema(it.schema_id)));
    // Where there are both, the scene shows more.
    let is_doubled = |topic: &str| {
        topic.strip_suffix("/points").is_some_and(|of| channels.iter().any(|it| it.topic == format!("{of}/scene")))
    };
    let topics: Map<String, Value> =
        drawn.map(|it| (it.topic.clone(), json!({ "visible": !is_doubled(&it.topic) }))).collect();
    let mut panels = Map::new();
    panels.insert(
        "3D!scene".to_owned(),
        json!({
            "followMode": "follow-none", "followTf": space, "topics": topics,
            "cameraState": { "distance": 8, "phi": 60, "thetaOffset": 45, "perspective": true, "fovy": 45, "near": 0.05, "far": 1000,
                "target": [0, 0, 0], "targetOffset": [0, 0, 1], "targetOrientation": [0, 0, 0, 1] },
            "layers": { "grid": { "layerId": "foxglove.Grid", "instanceId": "grid", "visible": true, "frameId": space, "size": 10, "divisions": 10 } },
        }),
    );
    let mut rows = Vec::new();
    for (place, channel) in pictures(&channels, schema).into_iter().enumerate() {
        let camera = camera_of(channel).unwrap_or_default();
        let marks = channels.iter().filter(|it| {
            let of = it.topic.strip_suffix("/annotations").and_then(|of| channels.iter().find(|it| it.topic == of));
            of.is_some_and(|it| camera_of(it) == Some(camera))
        });
        let annotations: Map<String, Value> = marks.map(|it| (it.topic.clone(), json!({ "visible": true }))).collect();
        let id = format!("Image!picture{place}");
        let mode = json!({
            "imageTopic": channel.topic, "calibrationTopic": format!("/cameras/{camera}"), "annotations": annotations,
        });
        panels.insert(id.clone(), json!({ "imageMode": mode }));
        rows.push(Value::from(id));
    }
    panels.insert("Log!log".to_owned(), json!({ "topicToRender": "/log" }));
    let path = |edge: &String| {
        let name = format!("{edge}: came").replace('"', "\\\"");
        json!({ "value": format!("/figures.figures[:]{{name==\"{name}\"}}.value"), "label": edge, "enabled": true,
            "timestampMethod": "receiveTime" })
    };
    let paths: Vec<Value> = edges.iter().take(MOST_LINES).map(path).collect();
    panels
        .insert("Plot!passed".to_owned(), json!({ "title": "messages that came", "paths": paths, "showLegend": true }));
    let below = split("row", vec!["Plot!passed".into(), "Log!log".into()]);
    let first = split("column", vec!["3D!scene".into(), below]);
    let layout = match rows.is_empty() {
        true => first,
        false => split("row", vec![first, split("column", rows)]),
    };
    let whole = json!({
        "configById": panels, "globalVariables": {}, "userNodes": {}, "playbackConfig": { "speed": 1 }, "layout": layout,
    });
    format!("{whole:#}\n")
}

/// Channels of pictures: of each node one camera, then of each a second one.
fn pictures<'c>(channels: &[&'c Channel], schema: impl Fn(u16) -> &'c str) -> Vec<&'c Channel> {
    let mut of_nodes: BTreeMap<&str, Vec<&'c Channel>> = BTreeMap::new();
    for channel in channels.iter().filter(|it| picture::is_picture(schema(it.schema_id))) {
        let node = fact(channel, "instance").split('[').next().unwrap_or_default();
        of_nodes.entry(node).or_default().push(channel);
    }
    let most = of_nodes.values().map(Vec::len).max().unwrap_or(0);
    let turns = (0..most).flat_map(|turn| of_nodes.values().filter_map(move |it| it.get(turn).copied()));
    turns.take(MOST_PICTURES).collect()
}

/// Panels beside each other (`row`) or above each other (`column`), each as large as the others.
fn split(direction: &str, mut panels: Vec<Value>) -> Value {
    let Some(first) = (!panels.is_empty()).then(|| panels.remove(0)) else { return Value::Null };
    if panels.is_empty() {
        return first;
    }
    let percentage = 100.0 / (panels.len() + 1) as f64;
    json!({ "direction": direction, "first": first, "second": split(direction, panels), "splitPercentage": percentage })
}
