//! Checks that hold for every camera and node: one call each.

use foveate_geometry::Camera;
use foveate_node::registry::RIG_WORDS;
use foveate_node::{Interval, Node, NodeBench, NodeError, Registry, Setup, Time};
use nalgebra::Point2;
use serde_json::Value;

/// Checks, on a grid over the whole image, that a pixel's ray starts at the camera's centre, that points along it project
/// back to the pixel within 1e-6 px, and that points behind the camera are not seen.
///
/// # Panics
/// When the law does not hold.
#[track_caller]
pub fn check_camera_model(camera: &Camera) {
    let ray = |pixel: &Point2<f64>| camera.ray(pixel).map(|it| (it.origin, it.direction.into_inner()));
    foveate_laws::check_camera_model(camera.image_size, &camera.centre(), ray, |point| camera.project(point));
}

/// Checks what every node type promises about its settings and ports, given TOML that it accepts:
/// - `plugin.node`, lower case; a summary of one line; port names in lower case, each port at its number;
/// - settings survive writing and reading, and filling in defaults twice changes nothing;
/// - no setting has a name that means something else in a rig ([`RIG_WORDS`]);
/// - a key that it does not know is refused, at the top and in each sub-table;
/// - the schema describes every setting, the description ends in a unit in brackets (`[px]`, `[–]`), and what may be left
///   out has a default.
///
/// # Panics
/// When one of these does not hold.
#[track_caller]
pub fn check_node<N: Node>(settings: &str) {
    let mut registry = Registry::new();
    registry.add::<N>();
    assert!(is_name(N::TYPE, '.'), "`{}` is not lower case", N::TYPE);
    assert!(!N::SUMMARY.is_empty() && !N::SUMMARY.contains('\n'), "the summary of `{}` is not one line", N::TYPE);
    let ports = N::ports();
    let names = ports.inputs.iter().map(|it| it.name).chain(ports.outputs.iter().map(|it| it.name));
    names.for_each(|name| assert!(is_name(name, '_'), "port `{name}` of `{}` is not lower case", N::TYPE));

    let read = |text: &str| toml::from_str::<N::Settings>(text);
    let write = |it: &N::Settings| {
        toml::Table::try_from(it).unwrap_or_else(|error| panic!("settings of `{}` cannot be written: {error}", N::TYPE))
    };
    let given = read(settings).unwrap_or_else(|error| panic!("`{}` refuses the settings:\n{error}", N::TYPE));
    let resolved = write(&given);
    let again = read(&resolved.to_string())
        .unwrap_or_else(|error| panic!("`{}` cannot read what it wrote:\n{error}\n{resolved}", N::TYPE));
    assert_eq!(write(&again), resolved, "settings of `{}` change when written and read", N::TYPE);

    for path in tables(&resolved) {
        let mut with_typo = resolved.clone();
        let table = path.iter().fold(&mut with_typo, |table, key| match table.get_mut(key) {
            Some(toml::Value::Table(inner)) => inner,
            other => unreachable!("`{key}` was a table and is {other:?}"),
        });
        table.insert("no_such_setting".to_owned(), toml::Value::Integer(1));
        assert!(
            read(&with_typo.to_string()).is_err(),
            "`{}` accepts an unknown key in {path:?}; #[serde(deny_unknown_fields)] is missing",
            N::TYPE
        );
    }

    let schema = schemars::schema_for!(N::Settings);
    let root = schema.as_value();
    check_schema(N::TYPE, root);
    let settings = root.get("properties").and_then(Value::as_object).into_iter().flatten();
    settings.for_each(|(name, _)| {
        assert!(
            !RIG_WORDS.contains(&name.as_str()),
            "`{name}` of `{}` is a word of rigs: it could not be set",
            N::TYPE
        );
    });
    if let Some(Value::Object(definitions)) = root.get("$defs") {
        definitions.values().for_each(|it| check_schema(N::TYPE, it));
    }
}

/// Checks what every node type promises of its runs, with `settings` in `setup`. `feed` gives it what it is to work on at one moment (a message at each
/// port, or a source's turn); it is called for moments a sixtieth of a second apart.
/// - the same messages give the same bytes again: no clock, no randomness but its own;
/// - two nodes that take turns give what each would give alone: no shared state;
/// - a node that was suspended for a minute works on.
///
/// # Panics
/// When one of these does not hold, or `feed` fails.
#[track_caller]
pub fn check_runs<N: Node>(
    settings: &N::Settings,
    setup: &Setup,
    feed: impl Fn(&mut NodeBench<N>, Time) -> Result<(), NodeError>,
) {
    const STEPS: i64 = 30;
    let new =
        || NodeBench::<N>::with_setup(settings.clone(), setup).unwrap_or_else(|error| panic!("`{}`: {error}", N::TYPE));
    let step = |bench: &mut NodeBench<N>, at: i64, after: Interval| {
        let time = Time(at * 1_000_000_000 / 60) + after;
        feed(bench, time).unwrap_or_else(|error| panic!("`{}` at {time}: {error}", N::TYPE));
    };
    let told = |mut bench: NodeBench<N>| {
        let text = bench.transcript().unwrap_or_else(|error| panic!("`{}`: {error}", N::TYPE));
        let report = bench.finish().unwrap_or_else(|error| panic!("`{}` while finishing: {error}", N::TYPE));
        (text, format!("{:?}", report.figures))
    };
    let alone = || {
        let mut bench = new();
        (0..STEPS).for_each(|at| step(&mut bench, at, Interval(0)));
        told(bench)
    };
    let first = alone();
    assert!(!first.0.is_empty() || N::ports().outputs.is_empty(), "`{}` gave nothing out at all", N::TYPE);
    assert_eq!(alone(), first, "`{}` gives something else the second time", N::TYPE);
    let mut both = [new(), new()];
    for at in 0..STEPS {
        both.iter_mut().for_each(|it| step(it, at, Interval(0)));
    }
    for bench in both {
        assert_eq!(told(bench), first, "`{}` gives something else beside another one of its kind", N::TYPE);
    }
    let mut suspended = new();
    (0..STEPS / 2).for_each(|at| step(&mut suspended, at, Interval(0)));
    (STEPS / 2..STEPS).for_each(|at| step(&mut suspended, at, Interval::from_s(60.0)));
    told(suspended);
}

/// Each property of an object schema has a description with a unit at its end, and a default unless required.
#[track_caller]
fn check_schema(node: &str, schema: &Value) {
    let Some(Value::Object(properties)) = schema.get("properties") else { return };
    let required: Vec<&str> =
        schema.get("required").and_then(Value::as_array).into_iter().flatten().filter_map(Value::as_str).collect();
    for (name, property) in properties {
        let description = property.get("description").and_then(Value::as_str).unwrap_or_default().trim_end();
        assert!(
            ends_in_unit(description),
            "setting `{name}` of `{node}`: the description must end in its unit in brackets, as `[px]` or `[–]`; it is \
             `{description}`"
        );
        let known = required.contains(&name.as_str()) || property.get("default").is_some();
        assert!(known, "setting `{name}` of `{node}` is neither required nor has a default in the schema");
    }
}

fn ends_in_unit(description: &str) -> bool {
    let text = description.trim_end_matches('.');
    text.ends_with(']') && text.rfind('[').is_some_and(|open| open + 2 < text.len())
}

fn is_name(text: &str, separator: char) -> bool {
    let allowed = |it: char| it.is_ascii_lowercase() || it.is_ascii_digit() || it == '_' || it == separator;
    !text.is_empty() && text.chars().all(allowed)
}

/// The paths of all tables in `table`, itself (the empty path) first.
fn tables(table: &toml::Table) -> Vec<Vec<String>> {
    let mut paths = vec![Vec::new()];
    for (key, value) in table {
        if let toml::Value::Table(inner) = value {
            paths.extend(tables(inner).into_iter().map(|path| [vec![key.clone()], path].concat()));
        }
    }
    paths
}

#[cfg(test)]
mod tests {
    use std::panic::catch_unwind;
    use std::sync::atomic::{AtomicU64, Ordering};

    use foveate_messages::Targets;
    use foveate_node::{ConfigError, Due, Io, Out, Ports, Role};
    use schemars::JsonSchema;
    use serde::{Deserialize, Serialize};

    use super::*;
    use crate::scene::camera_ring;

    #[test]
    fn real_camera_keeps_the_law() {
        camera_ring(3).iter().for_each(check_camera_model);
    }

    #[test]
    fn units_are_looked_for_at_the_end() {
        assert!(ends_in_unit("How bright [gray level, 0..=255]."));
        assert!(ends_in_unit("A share [–]"));
        assert!(!ends_in_unit("How [bright] it is") && !ends_in_unit("Nothing []") && !ends_in_unit(""));
    }

    const OUT: Out<Targets> = Out::new(0, "targets");
    static CALLS: AtomicU64 = AtomicU64::new(0);

    /// What a node must not do, one thing each.
    #[derive(Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
    enum Vice {
        None,
        SharedState,
        LongPause,
    }

    struct Vicious(Vice, Time);

    impl Node for Vicious {
        const TYPE: &'static str = "testkit.vicious";
        const ROLE: Role = Role::Source;
        const SUMMARY: &'static str = "Does what a node must not";
        type Settings = Vice;
        fn ports() -> Ports {
            Ports::new().output(&OUT)
        }
        fn new(vice: Vice, _setup: &Setup) -> Result<Self, ConfigError> {
            Ok(Self(vice, Time::ZERO))
        }
        fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
            let shared = if self.0 == Vice::SharedState { CALLS.fetch_add(1, Ordering::Relaxed) as i64 } else { 0 };
            assert!(self.0 != Vice::LongPause || io.now() - self.1 < Interval::from_s(1.0), "what a long pause");
            self.1 = io.now();
            io.emit_at(&OUT, io.now(), Targets { time: Time(shared), list: Vec::new() });
            Ok(())
        }
        fn due(&mut self) -> Due {
            Due::At(self.1 + Interval(1))
        }
    }

    #[test]
    fn shared_state_and_a_node_that_does_not_stand_a_pause_are_found() {
        let check = |vice: Vice| {
            catch_unwind(|| {
                check_runs::<Vicious>(&vice, &Setup::for_tests(), |bench, time| bench.activate(time));
            })
        };
        assert!(check(Vice::None).is_ok());
        let words = |vice: Vice| check(vice).unwrap_err().downcast_ref::<String>().cloned().unwrap_or_default();
        assert!(words(Vice::SharedState).contains("something else the second time"));
        assert!(words(Vice::LongPause).contains("what a long pause"));
    }

    #[test]
    fn nested_tables_are_found() {
        let table: toml::Table = toml::from_str("a = 1\n[b]\nc = 1\n[b.d]\n").unwrap();
        assert_eq!(tables(&table), [vec![], vec!["b".to_owned()], vec!["b".to_owned(), "d".to_owned()]]);
    }
}
