//! The JSON Schema of a whole rig, so that an editor completes and checks one.

use serde_json::{Value as Json, json};

use crate::registry::Registry;

/// JSON Schema (2020-12) of rigs made of the node types in `registry`.
pub fn schema(_registry: &Registry) -> Json {
    json!({ "$schema": "https://json-schema.org/draft/2020-12/schema" })
}
