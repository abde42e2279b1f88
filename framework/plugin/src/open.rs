//! The program's side of a library: opened, compared with the program's own build, and only then used.

use std::any::Any;
use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use foveate_node::given::Table;
use foveate_node::guard::resume;
use foveate_node::registry::{ErasedNode, NodeType, Settings};
use foveate_node::{ConfigError, Due, Io, LibraryError, NodeError, Origin, Plan, Registry, Report, Setup};
use libloading::Library;

use crate::boundary::{Caught, Contents, Described, LibraryNode, LibrarySettings, Parse, tagged};
use crate::crash;
use crate::descriptor::{Descriptor, REBUILD};

/// The environment variable with folders of libraries, with `:` between them (`;` on Windows).
pub const SEARCH_PATH: &str = "FOVEATE_PLUGINS";

/// Libraries that are open, by their path. They are never closed: what they gave may be alive anywhere.
static OPEN: Mutex<BTreeMap<PathBuf, Vec<Arc<NodeType>>>> = Mutex::new(BTreeMap::new());

/// Opens the library at `path` and gives its node types; see [`foveate_node::library::OpenLibrary`].
///
/// # Errors
/// Why it cannot be used, with all that differs from this program.
pub fn open(path: &Path) -> Result<Vec<Arc<NodeType>>, LibraryError> {
    let path = path
        .canonicalize()
        .map_err(|error| LibraryError::new(format_args!("{}: {error}", path.display())).help(REBUILD))?;
    let mut all = OPEN.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(types) = all.get(&path) {
        return Ok(types.clone());
    }
    let types = load(&path)?;
    all.insert(path, types.clone());
    Ok(types)
}

/// Opens every library in the folders of [`SEARCH_PATH`] for `registry`; gives what was refused, each with its path.
pub fn open_search_path(registry: &mut Registry) -> Vec<(PathBuf, LibraryError)> {
    let mut refused = Vec::new();
    let path = std::env::var_os(SEARCH_PATH).unwrap_or_default();
    for folder in std::env::split_paths(&path).filter(|it| !it.as_os_str().is_empty()) {
        let found = match std::fs::read_dir(&folder) {
            Ok(found) => found,
            Err(error) => {
                refused.push((
                    folder,
                    LibraryError::new(format_args!("a folder of {SEARCH_PATH} cannot be read: {error}")),
                ));
                continue;
            }
        };
        let mut libraries: Vec<PathBuf> = found.flatten().map(|it| it.path()).filter(|it| is_library(it)).collect();
        libraries.sort();
        for library in libraries {
            if let Err(error) = registry.open_library(&library) {
                refused.push((library, error));
            }
        }
    }
    refused
}

fn is_library(path: &Path) -> bool {
    path.extension() == Some(OsStr::new(std::env::consts::DLL_EXTENSION))
}

/// The library that this program opened at a path, checked against this program.
#[expect(unsafe_code, reason = "runs what a library holds")]
fn load(path: &Path) -> Result<Vec<Arc<NodeType>>, LibraryError> {
    let no_library = |error: libloading::Error| {
        LibraryError::new(format_args!("this is no library that can be opened: {}", cause(&error)))
    };
    crate::whole::check(path)?;
    crash::listen();
    // SAFETY: opening runs what the library has for its start, which nobody can look at before; naming it is asking for that.
    let library = unsafe { open_now(path) }.map_err(no_library)?;
    // Never closed, even when it is refused: its start may have left something behind.
    let library: &'static Library = Box::leak(Box::new(library));
    let missing = |symbol: &str| {
        let what = format!("found no symbol `{symbol}`: this library is no plugin for foveate");
        LibraryError::new(what).help(REBUILD)
    };
    type Describe = extern "C" fn() -> *const Descriptor;
    // SAFETY: a symbol of this name is the C function that `export_library!` writes, whose form is frozen.
    let describe = unsafe { library.get::<Describe>(b"foveate_plugin_descriptor") };
    let describe = describe.map_err(|_| missing("foveate_plugin_descriptor"))?;
    // SAFETY: it gives the place of a descriptor.
    let descriptor = unsafe { Descriptor::read(describe()) }?;
    let differences = Descriptor::of_program().differences(&descriptor);
    if !differences.is_empty() {
        let what = format!("{} was built for another program than this one", descriptor.title());
        return Err(LibraryError { differences, ..LibraryError::new(what).help(REBUILD) });
    }
    // SAFETY: the descriptor says that the library is of the same sources, compiler and dependencies, so that Rust's types are the same.
    let contents = unsafe { library.get::<fn() -> Contents>(b"foveate_plugin_contents") };
    let contents = contents.map_err(|_| missing("foveate_plugin_contents"))?;
    let contents = contents();
    let described = contents.describe().map_err(|said| {
        LibraryError::new(format_args!("{} {said}, while its node types were listed", contents.name()))
    })?;
    Ok(described.into_iter().map(|it| Arc::new(node_type(it, contents.parse(), path))).collect())
}

/// Symbols are looked up at once, so that one that is missing refuses the library and does not end a run.
#[cfg(unix)]
#[expect(unsafe_code, reason = "opening a library runs its start")]
unsafe fn open_now(path: &Path) -> Result<Library, libloading::Error> {
    use libloading::os::unix::{Library as Unix, RTLD_LOCAL, RTLD_NOW};
    // SAFETY: the caller's.
    unsafe { Unix::open(Some(path), RTLD_NOW | RTLD_LOCAL) }.map(Library::from)
}

#[cfg(not(unix))]
#[expect(unsafe_code, reason = "opening a library runs its start")]
unsafe fn open_now(path: &Path) -> Result<Library, libloading::Error> {
    // SAFETY: the caller's.
    unsafe { Library::new(path) }
}

/// What the system said.
fn cause(error: &libloading::Error) -> String {
    std::error::Error::source(error).map_or_else(|| error.to_string(), |it| it.to_string())
}

fn node_type(it: Described, parse: Parse, path: &Path) -> NodeType {
    let name = it.name;
    let origin: Arc<str> = format!("`{name}` of {}", path.display()).into();
    NodeType {
        name,
        role: it.role,
        summary: it.summary,
        ports: it.ports,
        figures: it.figures,
        schema: it.schema,
        origin: Origin::Library(path.to_owned()),
        decoder: Box::new(move |given| decode(name, &origin, parse, given)),
    }
}

fn decode(name: &'static str, origin: &Arc<str>, parse: Parse, given: Table) -> Result<Box<dyn Settings>, ConfigError> {
    let inside = on_this_side(parse(&tagged(name, given)?))?;
    let resolved: toml::Table = toml::from_str(inside.text()).map_err(|error| ConfigError::node(error.message()))?;
    let resolved = match resolved.into_iter().next() {
        Some((_, toml::Value::Table(table))) => table,
        _ => toml::Table::new(),
    };
    Ok(Box::new(Outside { inside, resolved, origin: Arc::clone(origin) }))
}

/// The result of a call into a library; its panic is resumed here.
fn on_this_side<T>(caught: Caught<T>) -> T {
    caught.unwrap_or_else(|said| resume(said))
}

/// The program's view of the settings of a library's node.
struct Outside {
    inside: Box<dyn LibrarySettings>,
    resolved: toml::Table,
    origin: Arc<str>,
}

impl Settings for Outside {
    fn build(&self, setup: &Setup) -> Result<Box<dyn ErasedNode>, ConfigError> {
        let words = format!("\nerror: {} ({}) crashed the program\n", setup.instance, self.origin);
        let node = on_this_side(crash::named(&words, || self.inside.build(setup)))?;
        Ok(Box::new(OutsideNode { node, words }))
    }
    fn resolved(&self) -> &dyn erased_serde::Serialize {
        &self.resolved
    }
    fn as_any(&self) -> &dyn Any {
        self.inside.as_any()
    }
    fn plan(&self) -> Plan {
        on_this_side(self.inside.plan())
    }
    fn is_live(&self) -> bool {
        on_this_side(self.inside.is_live())
    }
}

/// The program's view of a library's node.
struct OutsideNode {
    node: Box<dyn LibraryNode>,
    /// What a crash inside is to say.
    words: String,
}

impl ErasedNode for OutsideNode {
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        on_this_side(crash::named(&self.words, || self.node.process(io)))
    }
    fn change(&mut self, settings: &dyn Any) -> Result<(), ConfigError> {
        on_this_side(crash::named(&self.words, || self.node.change(settings)))
    }
    fn due(&mut self) -> Due {
        on_this_side(crash::named(&self.words, || self.node.due()))
    }
    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        on_this_side(crash::named(&self.words, || self.node.finish(report)))
    }
}

impl Drop for OutsideNode {
    fn drop(&mut self) {
        let caught = crash::named(&self.words, || self.node.let_go());
        // A second panic on top of one that is under way would end the program.
        if !std::thread::panicking() {
            on_this_side(caught);
        }
    }
}
