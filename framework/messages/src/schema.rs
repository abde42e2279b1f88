//! JSON Schemas of what nalgebra writes: lists of numbers (matrices column by column); poses such that reading gives what was written to the last bit.

use std::borrow::Cow;

use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion};
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

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
#[derive(Serialize, Deserialize, JsonSchema)]
pub(crate) struct Pose {
    /// Unit quaternion (x, y, z, w) [–].
    #[schemars(with = "Numbers<4>")]
    rotation: [f64; 4],
    /// Applied after the rotation [m].
    #[schemars(with = "Numbers<3>")]
    translation: [f64; 3],
}

/// How far from 1 the length of a rotation that is read may be [–].
const LENGTH_TOLERANCE: f64 = 1e-6;

impl Pose {
    /// For `#[serde(with = "Pose")]`.
    pub(crate) fn serialize<S: Serializer>(pose: &Isometry3<f64>, to: S) -> Result<S::Ok, S::Error> {
        let rotation = pose.rotation.coords.into();
        Serialize::serialize(&Pose { rotation, translation: pose.translation.vector.into() }, to)
    }

    /// For `#[serde(with = "Pose")]`: the rotation is taken as it is, since scaling it to length 1 again would change its last bits.
    pub(crate) fn deserialize<'d, D: Deserializer<'d>>(from: D) -> Result<Isometry3<f64>, D::Error> {
        use serde::de::Error;
        let Pose { rotation, translation } = Deserialize::deserialize(from)?;
        let rotation = Quaternion::from_vector(rotation.into());
        let length = rotation.norm();
        if (length - 1.0).abs() > LENGTH_TOLERANCE || length.is_nan() {
            return Err(D::Error::custom(format_args!(
                "found a rotation of length {length}, expected a unit quaternion"
            )));
        }
        Ok(Isometry3::from_parts(Translation3::from(translation), UnitQuaternion::new_unchecked(rotation)))
    }
}
