//! Plugins: crates of nodes opened by a program as shared libraries, nodes that are processes, and what their authors need.
//!
//! | module | what it holds |
//! |---|---|
//! | [`descriptor`] | the descriptor of a library: how it was built, checked before anything else of it is used |
//! | [`open`] | the program's side: opens a library, refuses one that does not fit, and gives its node types |
//! | [`build`] | `foveate plugin build`: makes a library out of a crate, so that it fits the program |
//! | `process` (on Linux) | nodes that are processes of their own, in any language |
//! | [`scaffold`] | `foveate new plugin`: a crate of one node to start from |
//!
//! What crosses once program and library fit stands in [`foveate_boundary`], with the macro that lists the nodes of a crate: authors compile
//! against that, and not against this room.

pub mod build;
mod crash;
pub mod descriptor;
pub mod open;
#[cfg(target_os = "linux")]
pub mod process;
pub mod scaffold;
mod sources;
mod whole;

#[doc(hidden)]
pub use foveate_boundary as boundary;

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
