//! The JSON Schema of rigs: complete, closed, and every reference leads somewhere.

use foveate_rig as rig;
use serde_json::Value;

use crate::parts::registry;

fn references<'s>(schema: &'s Value, found: &mut Vec<&'s str>) {
    match schema {
        Value::Object(map) => {
            found.extend(map.get("$ref").and_then(Value::as_str));
            map.values().for_each(|it| references(it, found));
        }
        Value::Array(list) => list.iter().for_each(|it| references(it, found)),
        _ => {}
    }
}

#[test]
fn every_reference_leads_somewhere() {
    let schema = rig::schema(&registry());
    let mut found = Vec::new();
    references(&schema, &mut found);
    assert!(found.iter().any(|it| it.contains("Window")), "{found:?}");
    for reference in found {
        assert!(schema.pointer(reference.strip_prefix('#').unwrap()).is_some(), "{reference}");
    }
}

#[test]
fn each_node_type_has_its_settings_ports_and_words() {
    let schema = rig::schema(&registry());
    for node_type in registry().iter().filter(|it| it.name != "scale.anchor") {
        let node = &schema["$defs"][format!("node:{}", node_type.name)];
        assert_eq!(node["additionalProperties"], false, "{}", node_type.name);
        for key in ["type", "each", "camera", "in", "require", "on_error"] {
            assert!(node["properties"].get(key).is_some(), "{} {key}", node_type.name);
        }
        for port in &node_type.ports.inputs {
            assert!(
                node["properties"]["in"]["properties"].get(port.name).is_some(),
                "{} {}",
                node_type.name,
                port.name
            );
        }
    }
    let detector = &schema["$defs"]["node:test.detector"];
    assert_eq!(detector["properties"]["offset"]["maximum"], 255.0);
    assert!(detector["properties"]["offset"]["description"].as_str().unwrap().contains("[gray level"));
    assert_eq!(detector["required"], serde_json::json!(["type", "in"]));
    assert_eq!(schema["$defs"]["node:test.aim"]["required"], serde_json::json!(["type", "in", "latency_ms"]));
    assert_eq!(schema["$defs"]["node"]["allOf"].as_array().unwrap().len(), registry().iter().count() - 1);
    assert!(schema["$defs"].get("node:scale.anchor").is_none(), "the loader makes these");
}
