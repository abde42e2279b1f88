//! The files that a rig reads travel in its session, so that a replay needs nothing else.
//!
//! Settings of nodes that name a file, and the calibration, get a name within the session; `rig.replay.toml` is the rig with those names. What sources read is not taken along: they
//! are not made in a replay.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Component, Path, PathBuf};

use foveate_node::Role;
use foveate_node::setup::expand_path;
use foveate_rig::graph::Graph;
use toml::Value;

use crate::names::FILES;

/// Largest file that is taken along [bytes].
const LARGEST: u64 = 64 << 20;
/// Largest file of a folder that is taken along, and beside a calibration of another program [bytes].
const LARGEST_BESIDE: u64 = 4 << 20;
/// Most files of a folder.
const MOST_BESIDE: usize = 256;

/// What a session takes along.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Attached {
    /// The rig with the names that its files have in the session.
    pub rig: String,
    /// Files by name, below `files/`.
    pub files: BTreeMap<String, Vec<u8>>,
    /// Those of them that are programs.
    pub programs: BTreeSet<String>,
    /// Sentences about what could not be taken along.
    pub missing: Vec<String>,
}

/// Gathers the files of a rig.
///
/// # Errors
/// That the resolved rig is no TOML: a mistake in the program.
pub fn gather(graph: &Graph) -> Result<Attached, String> {
    let rig: Value = graph.resolved.parse::<toml::Table>().map(Value::Table).map_err(|error| error.to_string())?;
    let mut gathering = Gathering { graph, attached: Attached::default(), renamed: BTreeMap::new() };
    if let Some(path) = rig.get("rig").and_then(|it| it.get("calibration")).and_then(Value::as_str) {
        gathering.calibration(path);
    }
    for (scale_name, scale) in rig.get("scale").and_then(Value::as_table).into_iter().flatten() {
        for (node_name, node) in scale.get("node").and_then(Value::as_table).into_iter().flatten() {
            let path = format!("{scale_name}.{node_name}");
            let instances: Vec<_> =
                graph.instances.iter().filter(|it| it.path.split('[').next() == Some(path.as_str())).collect();
            if instances.iter().any(|it| it.node_type.role == Role::Source) {
                continue;
            }
            let cameras = instances.iter().filter_map(|it| graph.calibration.cameras.get(usize::from(it.camera?.0)));
            let names: Vec<&str> = cameras.map(|it| it.name.as_str()).collect();
            for (key, setting) in node.as_table().into_iter().flatten() {
                if !["type", "in", "each", "camera"].contains(&key.as_str()) {
                    gathering.setting(setting, &names);
                }
            }
        }
    }
    let Gathering { mut attached, renamed, .. } = gathering;
    attached.rig = in_session(&graph.resolved, &renamed);
    Ok(attached)
}

/// A resolved rig (a line for each key) without its folder.
pub fn without_folder(resolved: &str) -> String {
    let mut text = resolved.to_owned();
    // That of the rig itself stands first; a node may have a setting of this name.
    if let Some(start) = text.find("\nfolder = ") {
        let end = text[start + 1..].find('\n').map_or(text.len(), |it| start + 1 + it);
        text.replace_range(start..end, "");
    }
    text
}

/// The same with texts in place of others.
fn in_session(resolved: &str, renamed: &BTreeMap<String, String>) -> String {
    let mut text = without_folder(resolved);
    for (from, to) in renamed {
        text = text.replace(&Value::from(from.as_str()).to_string(), &Value::from(to.as_str()).to_string());
    }
    text
}

struct Gathering<'g> {
    graph: &'g Graph,
    attached: Attached,
    /// Texts of the rig, and what stands in their place in the session.
    renamed: BTreeMap<String, String>,
}

impl Gathering<'_> {
    fn setting(&mut self, value: &Value, cameras: &[&str]) {
        match value {
            Value::String(text) => self.path(text, cameras),
            Value::Array(list) => list.iter().for_each(|it| self.setting(it, cameras)),
            Value::Table(table) => table.iter().for_each(|(_, it)| self.setting(it, cameras)),
            _ => {}
        }
    }

    /// A text that names a file, or one for each camera, gets the name that the file has in the session.
    fn path(&mut self, text: &str, cameras: &[&str]) {
        let within = self.within(text);
        let mut found = false;
        if text.contains("{camera}") {
            for camera in cameras {
                found |= self.take(&text.replace("{camera}", camera), &within.replace("{camera}", camera), LARGEST);
            }
        } else {
            found = self.take(text, &within, LARGEST);
        }
        if found && within != text {
            self.renamed.insert(text.to_owned(), within);
        }
    }

    /// The name in the session of what `text` names: relative names stay, since the name of a file that a node writes may be one of them.
    fn within(&self, text: &str) -> String {
        let path = Path::new(text);
        let is_plain = path.components().all(|it| matches!(it, Component::Normal(_) | Component::CurDir));
        if is_plain && !text.contains("${") {
            return text.to_owned();
        }
        let name = path.file_name().and_then(|it| it.to_str()).unwrap_or("file");
        let parent = path.parent().map_or(0, |it| fnv(it.to_string_lossy().as_bytes()));
        format!("elsewhere/{parent:016x}/{name}")
    }

    /// Takes a file along; whether it is one.
    fn take(&mut self, text: &str, within: &str, largest: u64) -> bool {
        let Ok(path) = expand_path(text, &self.graph.rig_dir) else { return false };
        let Ok(facts) = fs::metadata(&path) else { return false };
        let is_program = is_program(&facts);
        // A program of the machine, such as an interpreter, works where it is.
        if !facts.is_file() || (is_program && Path::new(text).is_absolute()) {
            return false;
        }
        if facts.len() > largest {
            let size = facts.len() >> 20;
            let shown = path.display();
            self.attached.missing.push(format!("`{shown}` ({size} MB) is not in the session: a replay needs it"));
            return false;
        }
        match fs::read(&path) {
            Ok(bytes) => {
                let name = format!("{FILES}{within}");
                if is_program {
                    self.attached.programs.insert(name.clone());
                }
                self.attached.files.insert(name, bytes);
                true
            }
            Err(error) => {
                self.attached.missing.push(format!("`{}` cannot be read: {error}", path.display()));
                false
            }
        }
    }

    /// A calibration is a file of ours, or one or several of other programs', which may belong together.
    fn calibration(&mut self, text: &str) {
        let Ok(path) = expand_path(text, &self.graph.rig_dir) else { return };
        let within = self.within(text);
        let is_ours = path.extension().is_some_and(|it| it == "toml");
        if path.is_file() {
            self.take(text, &within, LARGEST);
        }
        let (folder, prefix) = match path.is_dir() {
            true => (path.clone(), PathBuf::from(&within)),
            false if is_ours => (PathBuf::new(), PathBuf::new()),
            false => (
                path.parent().map_or_else(PathBuf::new, Path::to_path_buf),
                Path::new(&within).parent().map_or_else(PathBuf::new, Path::to_path_buf),
            ),
        };
        let mut beside: Vec<_> = fs::read_dir(&folder).into_iter().flatten().flatten().map(|it| it.path()).collect();
        beside.sort();
        for file in beside.iter().filter(|it| it.is_file()).take(MOST_BESIDE) {
            let (Some(name), Some(whole)) = (file.file_name().and_then(|it| it.to_str()), file.to_str()) else {
                continue;
            };
            if let Ok(whole) = std::path::absolute(whole) {
                self.take(&whole.to_string_lossy(), &prefix.join(name).to_string_lossy(), LARGEST_BESIDE);
            }
        }
        if within != text {
            self.renamed.insert(text.to_owned(), within);
        }
    }
}

#[cfg(unix)]
fn is_program(facts: &fs::Metadata) -> bool {
    use std::os::unix::fs::PermissionsExt;
    facts.permissions().mode() & 0o111 != 0
}

#[cfg(not(unix))]
fn is_program(_: &fs::Metadata) -> bool {
    false
}

/// FNV-1a: distinguishes two folders that hold files of one name.
fn fnv(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0xcbf2_9ce4_8422_2325, |hash, byte| (hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01b3))
}

/// A file of a session.
pub struct File {
    /// With `files/` before it.
    pub name: String,
    /// Content.
    pub bytes: Vec<u8>,
    /// Whether it is a program.
    pub is_program: bool,
}

/// Writes the files of a session below `folder`.
///
/// # Errors
/// A sentence: a name that leads out of the folder, or what cannot be written.
pub fn unpack(files: &[File], folder: &Path) -> Result<(), String> {
    for File { name, bytes, is_program } in files {
        let Some(within) = name.strip_prefix(FILES) else { continue };
        if !Path::new(within).components().all(|it| matches!(it, Component::Normal(_) | Component::CurDir)) {
            return Err(format!("the session holds a file `{name}`, which would be written elsewhere"));
        }
        let path = folder.join(within);
        let parent = path.parent().unwrap_or(folder);
        fs::create_dir_all(parent)
            .and_then(|()| fs::write(&path, bytes))
            .and_then(|()| if *is_program { make_program(&path) } else { Ok(()) })
            .map_err(|error| format!("`{}` cannot be written: {error}", path.display()))?;
    }
    Ok(())
}

#[cfg(unix)]
fn make_program(path: &Path) -> std::io::Result<()> {
    use std::os::unix::fs::PermissionsExt;
    fs::set_permissions(path, fs::Permissions::from_mode(0o755))
}

#[cfg(not(unix))]
fn make_program(_: &Path) -> std::io::Result<()> {
    Ok(())
}
