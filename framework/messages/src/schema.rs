//! JSON Schemas of what nalgebra writes: lists of numbers (matrices column by column) and poses.

use std::borrow::Cow;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};

/// `N` numbers.
pub(crate) struct Numbers<const N: usize>;

impl<const N: usize> JsonSchema for Numbers<N> {
    fn inline_schema() -> bool {
        true
    }
    fn schema_name() -> Cow<'static, str> {
        Cow::Owned(format!("{N} numbers"))
    }
    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "array", "items": { "type": "number" }, "minItems": N, "maxItems": N })
    }
}

/// A rotation and a translation.
#[derive(JsonSchema)]
#[expect(dead_code, reason = "only its schema is used")]
pub(crate) struct Pose {
    /// Unit quaternion (x, y, z, w) [–].
    #[schemars(with = "Numbers<4>")]
    rotation: [f64; 4],
    /// Applied after the rotation [m].
    #[schemars(with = "Numbers<3>")]
    translation: [f64; 3],
}
