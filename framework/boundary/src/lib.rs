//! The nodes of a plugin, and what crosses between a program and a library of them once the two fit.
//!
//! [`plugin!`](crate::plugin) lists the nodes of a crate, which is then linked into a program or built as a shared library by `foveate plugin build`.
//!
//! Settings cross as TOML text, which the library parses with its own registry of trait objects (typetag). Every call into the
//! library comes back with its panics caught, as words: a panic that leaves the image it began in ends the program. Who calls goes on
//! with them on its own side ([`foveate_node::guard::resume`]).

use std::any::Any;

use foveate_node::given;
use foveate_node::guard::guarded;
use foveate_node::node::Plan;
use foveate_node::port::Ports;
use foveate_node::registry::ErasedNode;
use foveate_node::{ConfigError, Due, Figures, Io, Node, NodeError, Report, Role, Setup};
use schemars::Schema;

#[doc(hidden)]
pub use foveate_node as node;
#[doc(hidden)]
pub use serde;
#[doc(hidden)]
pub use typetag;

/// Something that may panic, with the panic caught.
pub type Caught<T> = Result<T, String>;

/// The nodes of a crate: see [`plugin!`](crate::plugin).
pub struct Library {
    /// Of the crate.
    pub name: &'static str,
    /// Of the crate.
    pub version: &'static str,
    /// Its node types.
    pub describe: fn() -> Vec<Described>,
}

/// A node type of a library.
pub struct Described {
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
    /// Of the settings.
    pub schema: Schema,
}

impl Described {
    /// Of node type `N`.
    pub fn of<N: Node>() -> Self {
        let schema = schemars::schema_for!(N::Settings);
        Self { name: N::TYPE, role: N::ROLE, summary: N::SUMMARY, ports: N::ports(), figures: N::FIGURES, schema }
    }
}

/// The settings of one node of a library, written and read under the name of its type: a table `["star.finder"]` with the settings in it.
/// [`plugin!`](crate::plugin) writes one for each node type.
#[typetag::serde]
pub trait Spec: Send + Sync {
    /// [`Node::new`].
    ///
    /// # Errors
    /// [`Node::new`]'s.
    fn build(&self, setup: &Setup) -> Result<Box<dyn ErasedNode>, ConfigError>;
    /// [`Node::plan`].
    fn plan(&self) -> Plan;
    /// [`Node::is_live`].
    fn is_live(&self) -> bool;
    /// [`Node::Settings`].
    fn as_any(&self) -> &dyn Any;
}

/// Lists the node types of a library.
type Describe = fn() -> Vec<Described>;

/// Reads settings inside a library.
pub type Parse = fn(&str) -> Caught<Result<Box<dyn LibrarySettings>, ConfigError>>;

/// What a program gets from a compatible library.
pub struct Contents {
    name: &'static str,
    describe: Describe,
    parse: Parse,
    /// Calls `describe` inside the library.
    guarded: fn(Describe) -> Caught<Vec<Described>>,
}

impl Contents {
    /// Of `library`, whose code runs this.
    pub fn of(library: &Library) -> Self {
        Self { name: library.name, describe: library.describe, parse, guarded: |describe| guarded(describe) }
    }

    /// The crate.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// The node types.
    ///
    /// # Errors
    /// The words of a panic.
    pub fn describe(&self) -> Caught<Vec<Described>> {
        (self.guarded)(self.describe)
    }

    /// Reads the settings of a node out of TOML: a table under the name of its type.
    ///
    /// # Errors
    /// What cannot be read, with the dotted path of the setting; the words of a panic.
    pub fn parse(&self) -> Parse {
        self.parse
    }
}

/// The TOML of the settings `table` of a node of type `name`.
///
/// # Errors
/// What TOML cannot hold.
pub fn tagged(name: &str, table: given::Table) -> Result<String, ConfigError> {
    let whole = given::Table::from([(name.to_owned(), given::Value::Table(table))]);
    toml::to_string(&whole).map_err(ConfigError::node)
}

/// Runs inside the library: its registry of trait objects reads the settings.
fn parse(text: &str) -> Caught<Result<Box<dyn LibrarySettings>, ConfigError>> {
    guarded(|| {
        let whole: toml::Table = toml::from_str(text).map_err(|error| ConfigError::node(error.message()))?;
        let name = whole.keys().next().cloned().unwrap_or_default();
        let spec: Box<dyn Spec> = serde_path_to_error::deserialize(whole).map_err(|error| {
            // The path begins with the name of the type, which has a dot in it.
            let path = error.path().to_string().replace('[', ".").replace(']', "");
            let setting = path.strip_prefix(&name).map(|it| it.trim_start_matches('.').to_owned());
            let message = error.into_inner().message().trim().to_owned();
            ConfigError { setting: setting.filter(|it| !it.is_empty()), message }
        })?;
        let text = toml::to_string(&spec)
            .map_err(|error| ConfigError::node(format_args!("cannot be written as TOML: {error}")))?;
        Ok(Box::new(Inside { spec, text }) as Box<dyn LibrarySettings>)
    })
}

/// What the program calls of the settings of a library's node. Its code is the library's.
pub trait LibrarySettings: Send + Sync {
    /// Makes the node.
    ///
    /// # Errors
    /// The words of a panic; inside, what the node refuses.
    fn build(&self, setup: &Setup) -> Caught<Result<Box<dyn LibraryNode>, ConfigError>>;
    /// See [`Spec::plan`].
    ///
    /// # Errors
    /// The words of a panic.
    fn plan(&self) -> Caught<Plan>;
    /// See [`Spec::is_live`].
    ///
    /// # Errors
    /// The words of a panic.
    fn is_live(&self) -> Caught<bool>;
    /// See [`Spec::as_any`].
    fn as_any(&self) -> &dyn Any;
    /// All settings with their defaults, as TOML under the name of their type.
    fn text(&self) -> &str;
}

/// What the program calls of a library's node. Its code is the library's.
pub trait LibraryNode: Send {
    /// [`Node::process`].
    ///
    /// # Errors
    /// The words of a panic.
    fn process(&mut self, io: &mut Io<'_>) -> Caught<Result<(), NodeError>>;
    /// [`Node::change`], to settings of its own type.
    ///
    /// # Errors
    /// The words of a panic.
    fn change(&mut self, settings: &dyn Any) -> Caught<Result<(), ConfigError>>;
    /// [`Node::due`].
    ///
    /// # Errors
    /// The words of a panic.
    fn due(&mut self) -> Caught<Due>;
    /// [`Node::finish`].
    ///
    /// # Errors
    /// The words of a panic.
    fn finish(&mut self, report: &mut Report) -> Caught<Result<(), NodeError>>;
    /// Drops the node; nothing else is called after that.
    ///
    /// # Errors
    /// The words of a panic.
    fn let_go(&mut self) -> Caught<()>;
}

/// Settings inside the library.
struct Inside {
    spec: Box<dyn Spec>,
    text: String,
}

impl LibrarySettings for Inside {
    fn build(&self, setup: &Setup) -> Caught<Result<Box<dyn LibraryNode>, ConfigError>> {
        guarded(|| {
            let node = self.spec.build(setup)?;
            Ok(Box::new(Running(Some(node))) as Box<dyn LibraryNode>)
        })
    }
    fn plan(&self) -> Caught<Plan> {
        guarded(|| self.spec.plan())
    }
    fn is_live(&self) -> Caught<bool> {
        guarded(|| self.spec.is_live())
    }
    fn as_any(&self) -> &dyn Any {
        self.spec.as_any()
    }
    fn text(&self) -> &str {
        &self.text
    }
}

/// A node inside the library, until it is let go.
struct Running(Option<Box<dyn ErasedNode>>);

impl LibraryNode for Running {
    fn process(&mut self, io: &mut Io<'_>) -> Caught<Result<(), NodeError>> {
        guarded(|| self.0.as_mut().map_or(Ok(()), |it| it.process(io)))
    }
    fn change(&mut self, settings: &dyn Any) -> Caught<Result<(), ConfigError>> {
        guarded(|| self.0.as_mut().map_or(Ok(()), |it| it.change(settings)))
    }
    fn due(&mut self) -> Caught<Due> {
        guarded(|| self.0.as_mut().map_or(Due::Never, |it| it.due()))
    }
    fn finish(&mut self, report: &mut Report) -> Caught<Result<(), NodeError>> {
        guarded(|| self.0.as_mut().map_or(Ok(()), |it| it.finish(report)))
    }
    fn let_go(&mut self) -> Caught<()> {
        guarded(|| drop(self.0.take()))
    }
}

/// Whether two texts are the same, at compile time.
pub const fn is_same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut at = 0;
    while at < a.len() && at < b.len() && a[at] == b[at] {
        at += 1;
    }
    at == a.len() && at == b.len()
}

/// Lists the nodes of a crate, each under its name in rigs. The crate then has `register(&mut Registry)`, for programs that link it in, and
/// `LIBRARY`, of which `foveate plugin build` makes a shared library.
///
/// ```
/// # mod finder {
/// # use foveate_node::*;
/// # #[derive(Clone, serde::Serialize, serde::Deserialize, schemars::JsonSchema)]
/// # #[serde(default, deny_unknown_fields)]
/// # pub struct FinderSettings { threshold: u8 }
/// # impl Default for FinderSettings { fn default() -> Self { Self { threshold: 40 } } }
/// # pub struct Finder;
/// # impl Node for Finder {
/// #     const TYPE: &'static str = "star.finder";
/// #     const ROLE: Role = Role::Detector;
/// #     const SUMMARY: &'static str = "Finds stars";
/// #     type Settings = FinderSettings;
/// #     fn ports() -> Ports { Ports::new() }
/// #     fn new(_: FinderSettings, _: &Setup) -> Result<Self, ConfigError> { Ok(Self) }
/// #     fn process(&mut self, _: &mut Io<'_>) -> Result<(), NodeError> { Ok(()) }
/// # }
/// # }
/// # use finder::Finder;
/// foveate_boundary::plugin! {
///     "star.finder" => Finder,
/// }
/// ```
#[macro_export]
macro_rules! plugin {
    ($($name:literal => $node:ty),+ $(,)?) => {
        /// Registers the nodes of this crate.
        pub fn register(registry: &mut $crate::node::Registry) {
            $(registry.add::<$node>();)+
        }

        /// The nodes of this crate, for a shared library of them.
        pub const LIBRARY: $crate::Library = $crate::Library {
            name: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            describe: || vec![$($crate::Described::of::<$node>()),+],
        };

        $(const _: () = {
            use $crate::{serde, typetag};

            assert!(
                $crate::is_same(<$node as $crate::node::Node>::TYPE, $name),
                "`plugin!` lists a node under another name than its TYPE"
            );

            #[derive(serde::Serialize, serde::Deserialize)]
            #[serde(crate = "serde", transparent)]
            struct Settings(<$node as $crate::node::Node>::Settings);

            #[typetag::serde(name = $name)]
            impl $crate::Spec for Settings {
                fn build(
                    &self,
                    setup: &$crate::node::Setup,
                ) -> Result<Box<dyn $crate::node::registry::ErasedNode>, $crate::node::ConfigError> {
                    Ok(Box::new(<$node as $crate::node::Node>::new(self.0.clone(), setup)?))
                }
                fn plan(&self) -> $crate::node::Plan {
                    <$node as $crate::node::Node>::plan(&self.0)
                }
                fn is_live(&self) -> bool {
                    <$node as $crate::node::Node>::is_live(&self.0)
                }
                fn as_any(&self) -> &dyn ::std::any::Any {
                    &self.0
                }
            }
        };)+
    };
}
