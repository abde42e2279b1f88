//! Plugins: the same crate of nodes linked into a program or opened by it as a shared library, and what their authors need.
//!
//! | module | what it holds |
//! |---|---|
//! | [`descriptor`] | the frozen door of a library: what it says of its build before anything else of it is touched |
//! | [`boundary`] | what crosses between a program and a library once the two fit, with every panic caught inside the library |
//! | [`open`] | the program's side: opens a library, refuses one that does not fit, and gives its node types |
//! | [`build`] | `foveate plugin build`: makes a library out of a crate, so that it fits the program |
//! | `process` (on Linux) | nodes that are processes of their own, in any language |
//! | [`scaffold`] | `foveate new plugin`: a crate of one node to start from |
//!
//! [`plugin!`](crate::plugin) lists the nodes of a crate.

pub mod boundary;
pub mod build;
pub mod descriptor;
pub mod open;
#[cfg(target_os = "linux")]
pub mod process;
pub mod scaffold;
mod sources;
mod whole;

#[doc(hidden)]
pub use foveate_node as node;
#[doc(hidden)]
pub use serde;
#[doc(hidden)]
pub use typetag;

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
/// foveate_plugin::plugin! {
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
        pub const LIBRARY: $crate::boundary::Library = $crate::boundary::Library {
            name: env!("CARGO_PKG_NAME"),
            version: env!("CARGO_PKG_VERSION"),
            describe: || vec![$($crate::boundary::Described::of::<$node>()),+],
        };

        $(const _: () = {
            use $crate::{serde, typetag};

            assert!(
                $crate::boundary::is_same(<$node as $crate::node::Node>::TYPE, $name),
                "`plugin!` lists a node under another name than its TYPE"
            );

            #[derive(serde::Serialize, serde::Deserialize)]
            #[serde(crate = "serde", transparent)]
            struct Settings(<$node as $crate::node::Node>::Settings);

            #[typetag::serde(name = $name)]
            impl $crate::boundary::Spec for Settings {
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

/// Makes the symbols of a shared library out of the `LIBRARY` of a crate: `export_library!(star_finder::LIBRARY);` in a crate whose `crate-type` is
/// `cdylib`. `foveate plugin build` writes that crate.
#[macro_export]
macro_rules! export_library {
    ($library:path) => {
        /// What the library says of its build.
        #[unsafe(no_mangle)]
        pub extern "C" fn foveate_plugin_descriptor() -> *const $crate::descriptor::Descriptor {
            static DESCRIPTOR: $crate::descriptor::Lazy = $crate::descriptor::Lazy::new();
            DESCRIPTOR.get($library.name, $library.version)
        }

        /// What is in it, for a program that fits.
        #[unsafe(no_mangle)]
        pub fn foveate_plugin_contents() -> $crate::boundary::Contents {
            $crate::boundary::Contents::of(&$library)
        }
    };
}
