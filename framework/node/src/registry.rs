//! The node types that a program knows.

use std::any::{Any, type_name};
use std::collections::BTreeMap;
use std::sync::Arc;

use schemars::Schema;

use crate::error::{ConfigError, NodeError};
use crate::figure::{self, Figures};
use crate::given;
use crate::io::Io;
use crate::library::{OpenLibrary, Origin};
use crate::node::{Due, Node, Plan, Role};
use crate::port::Ports;
use crate::report::Report;
use crate::scale::ScaleAnchor;
use crate::setup::Setup;

/// The reserved keys of a node's table in a rig: no setting can have such a name.
pub const RIG_WORDS: [&str; 8] = ["type", "each", "camera", "on_error", "cost_ms", "cost_jitter_ms", "in", "require"];

/// The node types that a program knows, by name.
#[derive(Clone)]
pub struct Registry {
    pub(crate) types: BTreeMap<&'static str, Arc<NodeType>>,
    pub(crate) open: Option<OpenLibrary>,
}

/// One node type, type-erased.
pub struct NodeType {
    /// [`Node::TYPE`].
    pub name: &'static str,
    /// [`Node::ROLE`].
    pub role: Role,
    /// [`Node::SUMMARY`].
    pub summary: &'static str,
    /// [`Node::ports`].
    pub ports: Ports,
    /// [`Node::FIGURES`].
    pub figures: Figures,
    /// JSON Schema of the settings (an object); names, units in brackets, ranges and defaults are read from it.
    pub schema: Schema,
    /// Where it comes from.
    pub origin: Origin,
    /// Reads its settings: see [`NodeType::decode`].
    pub decoder: Box<Decode>,
}

impl NodeType {
    /// Reads the settings of a node of this type.
    ///
    /// # Errors
    /// What cannot be read, with the dotted path of the setting.
    pub fn decode(&self, given: given::Table) -> Result<Box<dyn Settings>, ConfigError> {
        (self.decoder)(given)
    }
}

/// Reads the settings of a node type.
pub type Decode = dyn Fn(given::Table) -> Result<Box<dyn Settings>, ConfigError> + Send + Sync;

/// Makes a node out of its settings.
type Make<N> = dyn Fn(<N as Node>::Settings, &Setup) -> Result<N, ConfigError> + Send + Sync;

/// The settings of one node, type-erased.
pub trait Settings: Send + Sync {
    /// Makes the node.
    ///
    /// # Errors
    /// [`Node::new`]'s.
    fn build(&self, setup: &Setup) -> Result<Box<dyn ErasedNode>, ConfigError>;
    /// All settings, defaults filled in, to be written in any format.
    fn resolved(&self) -> &dyn erased_serde::Serialize;
    /// The settings themselves: [`Node::Settings`].
    fn as_any(&self) -> &dyn Any;
    /// [`Node::plan`].
    fn plan(&self) -> Plan;
    /// [`Node::is_live`].
    fn is_live(&self) -> bool;
}

/// Of a node without live settings.
pub(crate) const FIXED: &str = "its settings are fixed while the rig runs";

/// A node, type-erased.
pub trait ErasedNode: Send {
    /// [`Node::process`].
    ///
    /// # Errors
    /// [`Node::process`]'s.
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError>;
    /// [`Node::change`], to `settings` as [`Settings::as_any`] gives them.
    ///
    /// # Errors
    /// [`Node::change`]'s.
    fn change(&mut self, _settings: &dyn Any) -> Result<(), ConfigError> {
        Err(ConfigError::node(FIXED))
    }
    /// [`Node::due`].
    fn due(&mut self) -> Due;
    /// [`Node::finish`].
    ///
    /// # Errors
    /// [`Node::finish`]'s.
    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError>;
}

impl<N: Node> ErasedNode for N {
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        Node::process(self, io)
    }
    fn change(&mut self, settings: &dyn Any) -> Result<(), ConfigError> {
        match settings.downcast_ref::<N::Settings>() {
            Some(settings) => Node::change(self, settings.clone()),
            None => unreachable!("settings of another type than `{}`", N::TYPE),
        }
    }
    fn due(&mut self) -> Due {
        Node::due(self)
    }
    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        Node::finish(self, report)
    }
}

impl Default for Registry {
    fn default() -> Self {
        Self::new()
    }
}

struct SettingsOf<N: Node> {
    given: N::Settings,
    make: Arc<Make<N>>,
}

impl<N: Node> Settings for SettingsOf<N> {
    fn build(&self, setup: &Setup) -> Result<Box<dyn ErasedNode>, ConfigError> {
        Ok(Box::new((self.make)(self.given.clone(), setup)?))
    }
    fn resolved(&self) -> &dyn erased_serde::Serialize {
        &self.given
    }
    fn as_any(&self) -> &dyn Any {
        &self.given
    }
    fn plan(&self) -> Plan {
        N::plan(&self.given)
    }
    fn is_live(&self) -> bool {
        N::is_live(&self.given)
    }
}

fn decode<N: Node>(given: given::Table, make: &Arc<Make<N>>) -> Result<Box<dyn Settings>, ConfigError> {
    let given = given::read(&given::Value::Table(given))?;
    Ok(Box::new(SettingsOf::<N> { given, make: Arc::clone(make) }))
}

impl Registry {
    /// A registry with the one node type that every rig may need: `scale.anchor`.
    pub fn new() -> Self {
        let mut registry = Self { types: BTreeMap::new(), open: None };
        registry.add::<ScaleAnchor>();
        registry
    }

    /// Registers node type `N`.
    ///
    /// # Panics
    /// When the name is taken or is not `plugin.node`, or a figure is declared twice or wrongly ([`figure::check`]): a mistake in the program's source.
    pub fn add<N: Node>(&mut self) {
        self.add_with::<N>(N::new);
    }

    /// Registers node type `N` with the constructor `make` in place of [`Node::new`], so that a program can hand its nodes something of
    /// its own, such as a channel to itself.
    ///
    /// # Panics
    /// As [`Registry::add`].
    pub fn add_with<N: Node>(
        &mut self,
        make: impl Fn(N::Settings, &Setup) -> Result<N, ConfigError> + Send + Sync + 'static,
    ) {
        assert!(N::TYPE.split('.').count() == 2, "a node type is named `plugin.node`, not `{}`", N::TYPE);
        if let Err(fault) = figure::check(N::FIGURES) {
            panic!("{}: {fault}", N::TYPE);
        }
        let make: Arc<Make<N>> = Arc::new(make);
        let taken = self.types.insert(
            N::TYPE,
            Arc::new(NodeType {
                name: N::TYPE,
                role: N::ROLE,
                summary: N::SUMMARY,
                ports: N::ports(),
                figures: N::FIGURES,
                schema: schemars::schema_for!(N::Settings),
                origin: Origin::Linked(type_name::<N>().split("::").next().unwrap_or_default()),
                decoder: Box::new(move |given| decode::<N>(given, &make)),
            }),
        );
        assert!(taken.is_none(), "two node types are named `{}`", N::TYPE);
    }

    /// The same types by name, each as `with` makes it.
    pub fn replaced(&self, with: impl Fn(&Arc<NodeType>) -> NodeType) -> Registry {
        Registry { types: self.types.iter().map(|(name, it)| (*name, Arc::new(with(it)))).collect(), ..self.clone() }
    }

    /// The type of that name.
    pub fn get(&self, name: &str) -> Option<&Arc<NodeType>> {
        self.types.get(name)
    }

    /// All types by name.
    pub fn iter(&self) -> impl Iterator<Item = &Arc<NodeType>> {
        self.types.values()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::figures;

    macro_rules! node {
        ($node:ident, $name:literal, $figures:expr) => {
            struct $node;

            impl Node for $node {
                const TYPE: &'static str = $name;
                const ROLE: Role = Role::Sink;
                const SUMMARY: &'static str = "For tests";
                const FIGURES: Figures = $figures;
                type Settings = BTreeMap<String, f64>;

                fn ports() -> Ports {
                    Ports::new()
                }

                fn new(_settings: Self::Settings, _setup: &Setup) -> Result<Self, ConfigError> {
                    Ok(Self)
                }

                fn process(&mut self, _io: &mut Io<'_>) -> Result<(), NodeError> {
                    Ok(())
                }
            }
        };
    }

    figures! {
        const GOOD;
        "error_mm.{median,p95}": mm, low, "Distance from the truth, over all targets";
        "speed": "m/s", neither, "Mean speed, over all targets";
    }
    figures! {
        const TWICE;
        "samples.*": count, neither, "Samples of a camera";
        "samples.all": count, neither, "Samples of all cameras";
    }
    figures! {
        const OTHER_UNIT;
        "error_mm": m, low, "Distance from the truth";
    }
    node!(Good, "test.good", GOOD);
    node!(Twice, "test.twice", TWICE);
    node!(OtherUnit, "test.other_unit", OTHER_UNIT);

    #[test]
    fn type_carries_its_figures() {
        let mut registry = Registry::new();
        registry.add::<Good>();
        assert_eq!(registry.get("test.good").unwrap().figures, GOOD);
        assert_eq!((GOOD[1].unit, GOOD[1].better.name()), ("m/s", "neither"));
    }

    #[test]
    #[should_panic(expected = "test.twice: figure `samples.all` is declared by `samples.*` already")]
    fn figure_that_is_declared_twice_is_refused() {
        Registry::new().add::<Twice>();
    }

    #[test]
    #[should_panic(expected = "test.other_unit: figure `error_mm`: its name says `mm` and its unit is `m`")]
    fn malformed_figure_is_refused() {
        Registry::new().add::<OtherUnit>();
    }
}
