//! Settings as a rig gives them, whatever the language of the rig, and how they become the settings of a node: each fault has the path of its setting.
//!
//! One reader for all node types: every visitor of every type of settings is compiled for it alone. Readers that wrap others (of any
//! format, with the path beside them) made a quarter of the code of crates with many nodes.

use std::collections::{BTreeMap, btree_map};
use std::fmt::Display;
use std::iter::Enumerate;
use std::slice;

use serde::de::value::{BorrowedStrDeserializer, MapAccessDeserializer};
use serde::de::{DeserializeOwned, DeserializeSeed, Deserializer, Error, MapAccess, SeqAccess, Unexpected, Visitor};
use serde::forward_to_deserialize_any;
use serde::ser::{self, Serialize, Serializer};

use crate::error::ConfigError;

/// Settings by name.
pub type Table = BTreeMap<String, Value>;

/// One setting as it is given.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// `true` or `false`.
    Bool(bool),
    /// A whole number.
    Integer(i64),
    /// A number, also infinite or none.
    Float(f64),
    /// A text.
    Text(String),
    /// Several in order.
    List(Vec<Value>),
    /// Several by name.
    Table(Table),
    /// What no setting can be, in words: "a date".
    Other(&'static str),
}

impl Serialize for Value {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Value::Bool(it) => serializer.serialize_bool(*it),
            Value::Integer(it) => serializer.serialize_i64(*it),
            Value::Float(it) => serializer.serialize_f64(*it),
            Value::Text(it) => serializer.serialize_str(it),
            Value::List(it) => serializer.collect_seq(it),
            Value::Table(it) => serializer.collect_map(it),
            Value::Other(it) => {
                Err(ser::Error::custom(format_args!("found {it}, expected a value that a setting can have")))
            }
        }
    }
}

/// Reads settings.
///
/// # Errors
/// The first that cannot be read.
pub(crate) fn read<T: DeserializeOwned>(given: &Value) -> Result<T, ConfigError> {
    T::deserialize(Given(given))
}

impl Error for ConfigError {
    fn custom<T: Display>(message: T) -> Self {
        Self::node(message)
    }
}

impl ConfigError {
    /// Of what stands in `outer`.
    fn inside(self, outer: impl Display) -> Self {
        let setting = match self.setting {
            Some(inner) => format!("{outer}.{inner}"),
            None => outer.to_string(),
        };
        Self { setting: Some(setting), ..self }
    }
}

struct Given<'v>(&'v Value);

impl<'v> Given<'v> {
    fn not<V: Visitor<'v>>(&self, visitor: &V) -> ConfigError {
        let found = match self.0 {
            Value::Text(it) => Unexpected::Str(it),
            Value::Integer(it) => Unexpected::Signed(*it),
            Value::Float(it) => Unexpected::Float(*it),
            Value::Bool(it) => Unexpected::Bool(*it),
            Value::Other(it) => Unexpected::Other(it),
            Value::List(_) => Unexpected::Seq,
            Value::Table(_) => Unexpected::Map,
        };
        ConfigError::invalid_type(found, visitor)
    }
}

impl<'v> Deserializer<'v> for Given<'v> {
    type Error = ConfigError;

    fn deserialize_any<V: Visitor<'v>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match self.0 {
            Value::Text(it) => visitor.visit_borrowed_str(it),
            Value::Integer(it) => visitor.visit_i64(*it),
            Value::Float(it) => visitor.visit_f64(*it),
            Value::Bool(it) => visitor.visit_bool(*it),
            Value::Other(_) => Err(self.not(&visitor)),
            Value::List(_) => self.deserialize_seq(visitor),
            Value::Table(_) => self.deserialize_map(visitor),
        }
    }

    fn deserialize_option<V: Visitor<'v>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'v>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_seq<V: Visitor<'v>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        let Value::List(list) = self.0 else { return Err(self.not(&visitor)) };
        let mut items = Items(list.iter().enumerate());
        let value = visitor.visit_seq(&mut items)?;
        match items.0.len() {
            0 => Ok(value),
            more => Err(ConfigError::node(format_args!("found {} values, expected {}", list.len(), list.len() - more))),
        }
    }

    fn deserialize_tuple<V: Visitor<'v>>(self, _length: usize, visitor: V) -> Result<V::Value, ConfigError> {
        self.deserialize_seq(visitor)
    }

    fn deserialize_tuple_struct<V: Visitor<'v>>(
        self,
        _name: &'static str,
        _length: usize,
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        self.deserialize_seq(visitor)
    }

    fn deserialize_map<V: Visitor<'v>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        match self.0 {
            Value::Table(table) => visitor.visit_map(Entries::of(table)),
            _ => Err(self.not(&visitor)),
        }
    }

    fn deserialize_struct<V: Visitor<'v>>(
        self,
        _name: &'static str,
        _fields: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        self.deserialize_map(visitor)
    }

    /// A word, or the word and what belongs to it: `{ sphere = 0.1 }`.
    fn deserialize_enum<V: Visitor<'v>>(
        self,
        _name: &'static str,
        _variants: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ConfigError> {
        match self.0 {
            Value::Text(it) => visitor.visit_enum(BorrowedStrDeserializer::new(it)),
            Value::Table(table) if table.len() == 1 => {
                visitor.visit_enum(MapAccessDeserializer::new(Entries::of(table)))
            }
            _ => Err(self.not(&visitor)),
        }
    }

    fn deserialize_ignored_any<V: Visitor<'v>>(self, visitor: V) -> Result<V::Value, ConfigError> {
        visitor.visit_unit()
    }

    forward_to_deserialize_any! {
        <V: Visitor<'v>>
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf unit unit_struct identifier
    }
}

struct Items<'v>(Enumerate<slice::Iter<'v, Value>>);

impl<'v> SeqAccess<'v> for &mut Items<'v> {
    type Error = ConfigError;

    fn next_element_seed<T: DeserializeSeed<'v>>(&mut self, seed: T) -> Result<Option<T::Value>, ConfigError> {
        let Some((index, value)) = self.0.next() else { return Ok(None) };
        seed.deserialize(Given(value)).map(Some).map_err(|error| error.inside(index))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.0.len())
    }
}

struct Entries<'v> {
    rest: btree_map::Iter<'v, String, Value>,
    /// Of which the key has been read.
    now: Option<(&'v str, &'v Value)>,
}

impl<'v> Entries<'v> {
    fn of(table: &'v Table) -> Self {
        Self { rest: table.iter(), now: None }
    }
}

impl<'v> MapAccess<'v> for Entries<'v> {
    type Error = ConfigError;

    fn next_key_seed<K: DeserializeSeed<'v>>(&mut self, seed: K) -> Result<Option<K::Value>, ConfigError> {
        let Some((key, value)) = self.rest.next() else { return Ok(None) };
        self.now = Some((key, value));
        seed.deserialize(BorrowedStrDeserializer::new(key)).map(Some).map_err(|error: ConfigError| error.inside(key))
    }

    fn next_value_seed<T: DeserializeSeed<'v>>(&mut self, seed: T) -> Result<T::Value, ConfigError> {
        let (key, value) = self.now.take().ok_or_else(|| ConfigError::node("a value was read before its key"))?;
        seed.deserialize(Given(value)).map_err(|error| error.inside(key))
    }

    fn size_hint(&self) -> Option<usize> {
        Some(self.rest.len())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use serde::Deserialize;

    use super::*;

    #[derive(Debug, Default, PartialEq, Deserialize)]
    #[serde(default, deny_unknown_fields)]
    struct Whole {
        count: u8,
        length: f64,
        name: Option<String>,
        pair: [f32; 2],
        list: Vec<Part>,
        by_name: BTreeMap<String, Shape>,
        wrapped: Option<Wrapped>,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(deny_unknown_fields)]
    struct Part {
        is_on: bool,
        shape: Shape,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    struct Wrapped(i64);

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(rename_all = "snake_case")]
    enum Shape {
        Point,
        Sphere(f64),
        Box { size: [f64; 3] },
    }

    #[derive(Debug, PartialEq, Deserialize)]
    struct Flat {
        at: f64,
        #[serde(flatten)]
        part: Part,
        #[serde(default)]
        tagged: Option<Tagged>,
    }

    #[derive(Debug, PartialEq, Deserialize)]
    #[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
    enum Tagged {
        Near { at: f64 },
        Far,
    }

    fn of<T: DeserializeOwned>(text: &str) -> Result<T, ConfigError> {
        read(&given(toml::Value::Table(text.parse().unwrap())))
    }

    fn given(value: toml::Value) -> Value {
        match value {
            toml::Value::Boolean(it) => Value::Bool(it),
            toml::Value::Integer(it) => Value::Integer(it),
            toml::Value::Float(it) => Value::Float(it),
            toml::Value::String(it) => Value::Text(it),
            toml::Value::Array(it) => Value::List(it.into_iter().map(given).collect()),
            toml::Value::Table(it) => Value::Table(it.into_iter().map(|(key, value)| (key, given(value))).collect()),
            toml::Value::Datetime(_) => Value::Other("a date"),
        }
    }

    #[test]
    fn whatever_toml_holds_is_read_into_any_settings() {
        let text = "count = 7\nlength = 2\nname = 'x'\npair = [1, inf]\nwrapped = -3\n\
            [[list]]\nis_on = true\nshape = 'point'\n[[list]]\nis_on = false\nshape = { sphere = 1 }\n\
            [by_name]\n'a b' = { box = { size = [1, 2, 3] } }\n";
        let expected = Whole {
            count: 7,
            length: 2.0,
            name: Some("x".to_owned()),
            pair: [1.0, f32::INFINITY],
            list: vec![Part { is_on: true, shape: Shape::Point }, Part { is_on: false, shape: Shape::Sphere(1.0) }],
            by_name: BTreeMap::from([("a b".to_owned(), Shape::Box { size: [1.0, 2.0, 3.0] })]),
            wrapped: Some(Wrapped(-3)),
        };
        assert_eq!(of::<Whole>(text), Ok(expected));
        assert_eq!(of::<Whole>(""), Ok(Whole::default()));
        let flat = of::<Flat>("at = 1.5\nis_on = true\nshape = 'point'\ntagged = { kind = 'near', at = 1 }");
        let part = Part { is_on: true, shape: Shape::Point };
        assert_eq!(flat, Ok(Flat { at: 1.5, part, tagged: Some(Tagged::Near { at: 1.0 }) }));
    }

    #[test]
    fn what_is_given_is_written_as_it_was_read() {
        let text = "at = [1, 2.5, -inf]\nis_on = true\n\n[inner]\nname = \"x\"\n";
        let value = given(toml::Value::Table(text.parse().unwrap()));
        assert_eq!(toml::to_string(&value).unwrap(), text);
        assert!(toml::to_string(&given(toml::Value::Table("day = 1979-05-27".parse().unwrap()))).is_err());
    }

    #[test]
    fn a_fault_says_in_which_setting_it_is_what_was_found_and_what_was_expected() {
        for (text, setting, words) in [
            ("count = 300", "count", "invalid value: integer `300`, expected u8"),
            ("count = -1", "count", "integer `-1`"),
            ("count = 1.5", "count", "invalid type: floating point `1.5`, expected u8"),
            ("length = 'two'", "length", "invalid type: string \"two\", expected f64"),
            ("length = 1979-05-27", "length", "invalid type: a date, expected f64"),
            ("name = [1]", "name", "invalid type: sequence, expected a string"),
            ("pair = [1]", "pair", "invalid length 1"),
            ("pair = [1, 2, 3]", "pair", "found 3 values, expected 2"),
            ("pair = [1, true]", "pair.1", "boolean `true`"),
            ("list = { is_on = true }", "list", "invalid type: map"),
            ("[[list]]\nis_on = true\nshape = 'point'\n[[list]]\nis_on = true", "list.1", "missing field `shape`"),
            ("[[list]]\nis_on = 1\nshape = 'point'", "list.0.is_on", "integer `1`"),
            ("[[list]]\nis_on = true\nshape = 'cone'", "list.0.shape", "unknown variant `cone`"),
            ("[[list]]\nis_on = true\nshape = { sphere = 'x' }", "list.0.shape.sphere", "expected f64"),
            ("[[list]]\nis_on = true\nshape = { sphere = 1, box = 2 }", "list.0.shape", "invalid type: map"),
            ("[[list]]\nis_on = true\nshape = 3", "list.0.shape", "invalid type: integer `3`"),
            ("[by_name]\na = { box = { size = [1, 2, 'x'] } }", "by_name.a.box.size.2", "string \"x\""),
            ("colour = 3", "colour", "unknown field `colour`"),
            ("wrapped = 'x'", "wrapped", "expected i64"),
        ] {
            let error = of::<Whole>(text).unwrap_err();
            assert_eq!(error.setting.as_deref(), Some(setting), "{text}: {error}");
            assert!(error.message.contains(words), "{text}: {error}");
        }
        let error = of::<Flat>("is_on = true\nshape = 'point'").unwrap_err();
        assert_eq!((error.setting, error.message.as_str()), (None, "missing field `at`"));
    }
}
