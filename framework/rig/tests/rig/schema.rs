//! The JSON Schema of rigs: complete, closed, and every reference leads somewhere.

use foveate_rig as rig;
use serde_json::Value;

use crate::parts::{bad, registry};

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

/// Every key that the schema has for a table is read: a date, which nothing takes, is refused by its name, and not as a key that nothing reads.
#[test]
fn what_the_schema_describes_is_what_the_loader_reads() {
    let schema = rig::schema(&registry());
    let detector = "/$defs/node:test.detector/properties";
    let tables = [
        ("[rig]\n", "/properties/rig".to_owned()),
        ("[plugins]\n", "/properties/plugins".to_owned()),
        ("[[budget]]\n", "/properties/budget/items".to_owned()),
        ("[scale.room]\n", "/$defs/scale".to_owned()),
        ("[scale.room.target.head]\n", "/$defs/scale/properties/target/additionalProperties".to_owned()),
        ("[scale.room.node.leds.require.image]\n", "/$defs/require".to_owned()),
        ("[scale.room.node.leds.in.image]\n", format!("{detector}/in/properties/image")),
    ];
    let mut n_keys = 0;
    for (header, pointer) in tables {
        let properties = schema.pointer(&pointer).unwrap_or_else(|| panic!("{pointer}"))["properties"].as_object();
        for key in properties.unwrap().keys() {
            let faults = bad(&format!("{header}{key} = 1979-05-27\n"));
            let of_key =
                faults.list.iter().find(|it| it.title.contains(&format!("`{key}`")) || it.label.contains("date"));
            let fault = of_key.unwrap_or_else(|| panic!("{header}{key} is not read:\n{faults}"));
            assert!(!fault.title.contains("unknown key"), "{header}{key}: {faults}");
            n_keys += 1;
        }
        let faults = bad(&format!("{header}nothing_reads_this = 1\n"));
        assert!(faults.list.iter().any(|it| it.title.contains("unknown key")), "{header}: {faults}");
    }
    assert!(n_keys >= 33, "{n_keys} keys");
}
