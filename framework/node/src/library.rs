//! Where node types come from: linked into the program, or out of libraries that it opens while it runs.
//!
//! This room opens nothing itself: a program gives its [`Registry`] a function that does.

use std::fmt;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::registry::{NodeType, Registry};

/// Where a node type comes from.
#[derive(Debug, Clone, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Origin {
    /// A crate that is linked into the program, by its name in code: `foveate_led`.
    Linked(&'static str),
    /// A shared library, by its path.
    Library(PathBuf),
}

impl fmt::Display for Origin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Origin::Linked(name) => write!(f, "{}", name.replace('_', "-")),
            Origin::Library(path) => write!(f, "{}", path.display()),
        }
    }
}

/// Why a library cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LibraryError {
    /// What was found and expected, in one line.
    pub what: String,
    /// What differs, one line each.
    pub differences: Vec<String>,
    /// What to do about it.
    pub help: Option<String>,
}

impl LibraryError {
    /// A refusal in one line.
    pub fn new(what: impl fmt::Display) -> Self {
        Self { what: what.to_string(), differences: Vec::new(), help: None }
    }

    /// With what to do about it.
    #[must_use]
    pub fn help(self, help: impl fmt::Display) -> Self {
        Self { help: Some(help.to_string()), ..self }
    }
}

impl fmt::Display for LibraryError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.what)?;
        self.differences.iter().try_for_each(|it| write!(f, "\n  {it}"))?;
        self.help.iter().try_for_each(|it| write!(f, "\n  help: {it}"))
    }
}

impl std::error::Error for LibraryError {}

/// Opens a library and gives the node types in it. A library that was opened stays open until the program ends.
pub type OpenLibrary = fn(&Path) -> Result<Vec<Arc<NodeType>>, LibraryError>;

impl Registry {
    /// From now on libraries are opened by `open`; a registry opens none by itself.
    pub fn open_libraries_with(&mut self, open: OpenLibrary) {
        self.open = Some(open);
    }

    /// Registers the node types of the library at `path`. One that was opened already changes nothing. After an error nothing has changed.
    ///
    /// # Errors
    /// Why it cannot be used: it is no library, fits another program, or has a node type whose name is taken.
    pub fn open_library(&mut self, path: &Path) -> Result<(), LibraryError> {
        let Some(open) = self.open else {
            return Err(LibraryError::new("this program opens no libraries: link the plugin into it"));
        };
        let found = open(path)?;
        let taken = found.iter().find_map(|it| {
            let before = self.types.get(it.name)?;
            (before.origin != it.origin).then(|| (it.name, before.origin.clone()))
        });
        if let Some((name, origin)) = taken {
            let what = format!("found the node type `{name}`, which {origin} has already, expected another name");
            return Err(LibraryError::new(what).help("leave one of the two out, or rename the node type"));
        }
        self.types.extend(found.into_iter().map(|it| (it.name, it)));
        Ok(())
    }

    /// The libraries that node types come from, each once.
    pub fn libraries(&self) -> Vec<&Path> {
        let mut paths: Vec<&Path> = self
            .iter()
            .filter_map(|it| match &it.origin {
                Origin::Library(path) => Some(path.as_path()),
                Origin::Linked(_) => None,
            })
            .collect();
        paths.sort_unstable();
        paths.dedup();
        paths
    }
}
