//! Values of settings: between rigs (TOML), pages (JSON) and nodes; and how changed ones are written into the rig.

use std::path::{Path, PathBuf};

use foveate_node::given::{Table, Value as Given};
use serde_json::Value;
use toml_edit::{DocumentMut, Item, TableLike};

/// Settings as a page gets them. A number that JSON cannot hold is a text: `inf`, `nan`.
pub fn in_json(table: &Table) -> Value {
    table.iter().map(|(key, it)| (key.clone(), value_in_json(it))).collect()
}

fn value_in_json(it: &Given) -> Value {
    match it {
        Given::Bool(it) => Value::from(*it),
        Given::Integer(it) => Value::from(*it),
        Given::Float(it) if it.is_finite() => Value::from(*it),
        Given::Float(it) => Value::from(it.to_string()),
        Given::Text(it) => Value::from(it.as_str()),
        Given::List(list) => list.iter().map(value_in_json).collect(),
        Given::Table(table) => in_json(table),
        Given::Other(it) => Value::from(*it),
    }
}

/// What a page sent as the value of a setting; `None`: nothing that a setting can be.
pub fn from_json(it: &Value) -> Option<Given> {
    Some(match it {
        Value::Null => return None,
        Value::Bool(it) => Given::Bool(*it),
        Value::Number(it) => match it.as_i64() {
            Some(whole) => Given::Integer(whole),
            None => Given::Float(it.as_f64()?),
        },
        Value::String(it) => Given::Text(it.clone()),
        Value::Array(list) => Given::List(list.iter().map(from_json).collect::<Option<_>>()?),
        Value::Object(map) => {
            Given::Table(map.iter().map(|(key, it)| Some((key.clone(), from_json(it)?))).collect::<Option<_>>()?)
        }
    })
}

/// One changed setting.
#[derive(Debug, Clone, PartialEq)]
pub struct Changed {
    /// Scale and node, as `["room", "leds"]`.
    pub node: [String; 2],
    /// The setting.
    pub name: String,
    /// Its value from now on.
    pub value: Given,
}

/// The text of a rig with these settings; all else, comments and order too, stays as it is.
///
/// # Errors
/// A sentence: the text is no TOML, or has no such node.
pub fn with_settings(rig: &str, changed: &[Changed]) -> Result<String, String> {
    let mut document: DocumentMut = rig.parse().map_err(|error| format!("the rig is no TOML any more: {error}"))?;
    for Changed { node: [scale, node], name, value } in changed {
        let path = ["scale", scale, "node", node];
        let mut table: Option<&mut dyn TableLike> = Some(document.as_table_mut());
        for key in path {
            table = table.and_then(|it| it.get_mut(key)).and_then(Item::as_table_like_mut);
        }
        let table = table.ok_or_else(|| format!("the rig has no `[{}]` any more", path.join(".")))?;
        let mut new = in_toml(value).ok_or_else(|| format!("`{name}` cannot be written as TOML"))?;
        match table.get_mut(name) {
            // What stands around the value is a person's: its comment.
            Some(Item::Value(present)) => {
                *new.decor_mut() = present.decor().clone();
                *present = new;
            }
            _ => drop(table.insert(name, toml_edit::value(new))),
        }
    }
    Ok(document.to_string())
}

fn in_toml(it: &Given) -> Option<toml_edit::Value> {
    Some(match it {
        Given::Bool(it) => (*it).into(),
        Given::Integer(it) => (*it).into(),
        Given::Float(it) => (*it).into(),
        Given::Text(it) => it.into(),
        Given::List(list) => toml_edit::Value::Array(list.iter().map(in_toml).collect::<Option<_>>()?),
        Given::Table(table) => {
            let entries = table.iter().map(|(key, it)| Some((key.as_str(), in_toml(it)?)));
            toml_edit::Value::InlineTable(entries.collect::<Option<_>>()?)
        }
        Given::Other(_) => return None,
    })
}

/// Writes the settings into the rig file at `path`, all or none.
///
/// # Errors
/// A sentence; the file is as it was.
pub fn save(path: &Path, changed: &[Changed]) -> Result<(), String> {
    let shown = path.display();
    let text = std::fs::read_to_string(path).map_err(|error| format!("`{shown}` cannot be read: {error}"))?;
    let text = with_settings(&text, changed)?;
    // What the name leads to is replaced, and not the link.
    let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let mut name = target.file_name().unwrap_or_default().to_owned();
    name.push(".saving");
    let beside: PathBuf = target.with_file_name(name);
    let written = std::fs::write(&beside, text).and_then(|()| {
        let permissions = std::fs::metadata(&target)?.permissions();
        std::fs::set_permissions(&beside, permissions)?;
        std::fs::rename(&beside, &target)
    });
    written.map_err(|error| {
        drop(std::fs::remove_file(&beside));
        format!("`{shown}` cannot be written: {error}")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: &str = "# My lab\n[rig]\nname = \"lab\"\n\n# Lights\n[scale.room.node.leds]\ntype = \"led.detector\" # all cameras\noffset = 20   # by hand, 3 May\n\
                       window_px = 40\n\n[scale.room.node.other]\ntype = \"x.y\"\n";

    fn changed(node: &str, name: &str, value: Given) -> Changed {
        Changed { node: ["room".to_owned(), node.to_owned()], name: name.to_owned(), value }
    }

    #[test]
    fn a_changed_setting_keeps_its_comment_and_its_place_and_a_new_one_follows() {
        let masks = Given::List(vec![Given::List(vec![Given::Float(1.5), Given::Integer(2)])]);
        let all = [changed("leds", "offset", Given::Integer(31)), changed("leds", "masks", masks)];
        let expected = RIG
            .replace("offset = 20   # by hand", "offset = 31   # by hand")
            .replace("window_px = 40\n", "window_px = 40\nmasks = [[1.5, 2]]\n");
        assert_eq!(with_settings(RIG, &all), Ok(expected));
    }

    #[test]
    fn a_node_that_is_gone_is_named_and_nothing_is_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rig.toml");
        std::fs::write(&path, RIG).unwrap();
        let gone = changed("gone", "offset", Given::Integer(1));
        assert!(
            save(&path, &[changed("leds", "offset", Given::Integer(1)), gone]).unwrap_err().contains("room.node.gone")
        );
        assert_eq!(std::fs::read_to_string(&path).unwrap(), RIG);
        save(&path, &[changed("leds", "offset", Given::Integer(7))]).unwrap();
        assert!(std::fs::read_to_string(&path).unwrap().contains("offset = 7   # by hand, 3 May"));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn inline_tables_are_rigs_too() {
        let rig = "[scale.room.node]\nleds = { type = \"led.detector\", offset = 20 }\n";
        let text = with_settings(rig, &[changed("leds", "offset", Given::Integer(5))]).unwrap();
        assert_eq!(text, rig.replace("20", "5"));
    }

    #[test]
    fn values_come_back_from_a_page_as_they_went() {
        let table: Table = [
            ("a".to_owned(), Given::Integer(-3)),
            ("b".to_owned(), Given::Float(0.25)),
            ("c".to_owned(), Given::List(vec![Given::Bool(true), Given::Text("x".to_owned())])),
        ]
        .into();
        assert_eq!(from_json(&in_json(&table)), Some(Given::Table(table)));
        assert_eq!(from_json(&Value::Null), None);
    }
}
