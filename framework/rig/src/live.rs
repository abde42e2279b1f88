//! Settings that change while a rig runs.

use foveate_node::error::ConfigError;
use foveate_node::given::{Table, Value};
use foveate_node::registry::Settings;
use foveate_node::setting_docs::setting_docs;

use crate::graph::Instance;
use crate::nodes::given_table;

/// The settings of `instance`, which are `present`, with `values` in place of some of them.
///
/// # Errors
/// A setting that is not there or is fixed while the rig runs, or what cannot be read.
pub fn changed(instance: &Instance, present: &dyn Settings, values: &Table) -> Result<Box<dyn Settings>, ConfigError> {
    let docs = setting_docs(&instance.node_type);
    for name in values.keys() {
        let expected = match docs.iter().find(|it| it.name == *name) {
            Some(it) if it.is_live => continue,
            Some(_) => "is fixed while the rig runs, expected one that `foveate nodes` calls live",
            None => "is no setting of this node",
        };
        return Err(ConfigError::at(name, expected));
    }
    let mut all = table(present)?;
    all.extend(values.clone());
    instance.node_type.decode(all)
}

/// All settings, by name.
///
/// # Errors
/// One that TOML cannot hold.
pub fn table(settings: &dyn Settings) -> Result<Table, ConfigError> {
    toml::Table::try_from(settings.resolved()).map(given_table).map_err(ConfigError::node)
}

/// Settings as a text, and back: TOML.
///
/// # Errors
/// A value that TOML cannot hold.
pub fn in_toml(values: &Table) -> Result<String, ConfigError> {
    toml::to_string(&Value::Table(values.clone())).map_err(ConfigError::node)
}

/// What [`in_toml`] wrote.
///
/// # Errors
/// What is no TOML.
pub fn from_toml(text: &str) -> Result<Table, ConfigError> {
    text.parse::<toml::Table>().map(given_table).map_err(ConfigError::node)
}

/// One value as it stands behind `=`.
///
/// # Errors
/// A value that TOML cannot hold.
pub fn value_in_toml(value: &Value) -> Result<String, ConfigError> {
    toml::Value::try_from(value).map(|it| it.to_string()).map_err(ConfigError::node)
}
