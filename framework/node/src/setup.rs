//! What a node gets when it is made: its place in the rig, its camera, randomness, folders.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::CameraId;
use foveate_scene::AnchorRule;
use foveate_scene::calibration::{Calibration, LengthUnit};
use foveate_scene::clocks::Clocks;
use foveate_scene::heads::{CalibratedHead, Heads};

use crate::error::ConfigError;
use crate::host::Host;
use crate::page::Pages;
use crate::port::In;
use crate::scale::ScaleTree;
use foveate_scene::selection::matches;

/// The folder of recordings where the environment variable `FOVEATE_DATA` is not set.
const DATA_DEFAULT: &str = "../shared/data";

/// Why a node is made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// To see whether its settings hold; it will not run. Write nothing, start nothing.
    Check,
    /// To run.
    Run,
}

/// What a node gets when it is made.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Full name: scale, node, camera: `room.leds[wide-3]`.
    pub instance: String,
    /// The scale that the node lies in.
    pub scale: String,
    /// All scales of the rig, seen from this one.
    pub scales: ScaleTree,
    /// The camera that this instance serves, where the rig says `each` or `camera`.
    pub camera: Option<CameraId>,
    /// All cameras by number; without cameras where the rig names no calibration.
    pub calibration: Arc<Calibration>,
    /// The input ports that the rig connects, for nodes that need one input or another.
    pub connected: Vec<String>,
    /// The working volume of the scale [m], opposite corners, where the rig states it.
    pub volume_m: Option<[[f64; 3]; 2]>,
    /// How far around its anchor the scale reaches [m], where the rig states it.
    pub radius_m: Option<f64>,
    /// Which target of the parent scale carries this scale; `None` for a scale that does not move.
    pub anchor: Option<AnchorRule>,
    /// This instance's own stream, from the rig's seed and the instance's name.
    pub random: Random,
    /// The folder of the rig file: relative paths in settings start here.
    pub rig_dir: PathBuf,
    /// The folder for results, where there is one.
    pub out_dir: Option<PathBuf>,
    /// Why the node is made.
    pub purpose: Purpose,
    /// Which node writes which file of the results; shared by all nodes of a rig.
    pub claims: Claims,
    /// What serves pages to browsers while the rig runs.
    pub pages: Pages,
    /// Who runs the rig.
    pub host: Host,
}

/// Which node writes which file of the results, and the references between nodes.
#[derive(Debug, Clone)]
pub struct Claims(Arc<Mutex<Claimed>>);

#[derive(Debug)]
struct Claimed {
    /// By thing.
    owners: BTreeMap<String, String>,
    /// By kind, the names that nodes offer.
    offered: BTreeMap<&'static str, BTreeSet<String>>,
    references: Vec<NameReference>,
}

/// A name that a node's setting states, of something that another node has.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NameReference {
    /// The setting.
    pub setting: String,
    /// What it is, as in "tile".
    pub kind: &'static str,
    /// Its name.
    pub name: String,
}

impl Claims {
    /// The references noted since the last call.
    pub fn take_references(&self) -> Vec<NameReference> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner).references)
    }

    /// The names of that kind that nodes offer, in order; none where no node offers any.
    pub fn offered(&self, kind: &str) -> Vec<String> {
        let claimed = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        claimed.offered.get(kind).into_iter().flatten().cloned().collect()
    }
}

/// Files of the results that belong to the program itself.
const RESERVED: [&str; 6] =
    ["summary.json", "ledger.csv", "events.csv", "timing.json", "rig.resolved.toml", "graph.svg"];

impl Default for Claims {
    /// Claims of the program itself, and of no node yet.
    fn default() -> Self {
        let owners = RESERVED.iter().map(|&it| (it.to_owned(), "foveate".to_owned())).collect();
        Self(Arc::new(Mutex::new(Claimed { owners, offered: BTreeMap::new(), references: Vec::new() })))
    }
}

impl Setup {
    /// A setup for tests: no cameras, seed 1, the current folder.
    pub fn for_tests() -> Self {
        Self {
            instance: "test.node".to_owned(),
            scale: "test".to_owned(),
            scales: ScaleTree::of_one("test"),
            camera: None,
            calibration: no_cameras(),
            connected: Vec::new(),
            volume_m: None,
            radius_m: None,
            anchor: None,
            random: Random::new(1),
            rig_dir: PathBuf::from("."),
            out_dir: None,
            purpose: Purpose::Run,
            claims: Claims::default(),
            pages: Pages::default(),
            host: Host::default(),
        }
    }

    /// Claims file `name` of the results folder for this instance, so that no other node overwrites it.
    ///
    /// # Errors
    /// Points at `setting` and names the node that writes that file already.
    pub fn claim_file(&self, setting: Option<&str>, name: &str) -> Result<(), ConfigError> {
        match self.other_owner(name) {
            None => Ok(()),
            Some(owner) => {
                let message = format!(
                    "the file `{name}` of the results is written by `{owner}` already, expected a file of its own"
                );
                Err(ConfigError { setting: setting.map(str::to_owned), message })
            }
        }
    }

    /// Claims something else that only one node can have, such as a serial port.
    ///
    /// # Errors
    /// Points at `setting`, with the text of `message`, which gets the node that has claimed it already.
    pub fn claim(&self, setting: &str, thing: &str, message: impl Fn(&str) -> String) -> Result<(), ConfigError> {
        // No file of the results has a name like this.
        let owner = self.other_owner(&format!("{setting}/{thing}"));
        owner.map_or(Ok(()), |it| Err(ConfigError::at(setting, message(&it))))
    }

    /// Declares `name`, a thing of that kind (such as "tile"), for other nodes to refer to.
    pub fn offer(&self, kind: &'static str, name: &str) {
        let mut claims = self.claims.0.lock().unwrap_or_else(PoisonError::into_inner);
        claims.offered.entry(kind).or_default().insert(name.to_owned());
    }

    /// Refers to something of another node. Where nodes of the rig offer things of that kind and none of this name, the rig is refused at `setting`.
    pub fn refer(&self, setting: &str, kind: &'static str, name: &str) {
        let mut claims = self.claims.0.lock().unwrap_or_else(PoisonError::into_inner);
        claims.references.push(NameReference { setting: setting.to_owned(), kind, name: name.to_owned() });
    }

    fn other_owner(&self, thing: &str) -> Option<String> {
        let mut claims = self.claims.0.lock().unwrap_or_else(PoisonError::into_inner);
        let owner = claims.owners.entry(thing.to_owned()).or_insert_with(|| self.instance.clone());
        (*owner != self.instance).then(|| owner.clone())
    }

    /// As [`Self::claim_file`], of a name that `setting` states, which has to be that of a file right in the results folder.
    ///
    /// # Errors
    /// Points at `setting`: a path or nothing in place of a name, or a file that another node writes.
    pub fn claim_named_file(&self, setting: &str, name: &str) -> Result<(), ConfigError> {
        if Path::new(name).file_name().is_none_or(|it| it != name) {
            let message = format!("found `{name}`, expected the name of a file in the results folder");
            return Err(ConfigError::at(setting, message));
        }
        self.claim_file(Some(setting), name)
    }

    /// Whether the rig connects this input port.
    pub fn is_connected<T>(&self, port: &In<T>) -> bool {
        self.connected.iter().any(|it| it == port.name)
    }

    /// The name of this instance's camera.
    pub fn camera_name(&self) -> Option<&str> {
        let index = usize::from(self.camera?.0);
        Some(&self.calibration.cameras.get(index)?.name)
    }

    /// The model of this instance's camera.
    pub fn camera_model(&self) -> Option<&Camera> {
        let index = usize::from(self.camera?.0);
        Some(&self.calibration.cameras.get(index)?.camera)
    }

    /// The head that carries this instance's camera, as the calibration has it.
    pub fn head_model(&self) -> Option<CalibratedHead> {
        self.head_of(self.camera?)
    }

    /// The head that carries `camera`, as the calibration has it.
    pub fn head_of(&self, camera: CameraId) -> Option<CalibratedHead> {
        self.calibration.head(&self.calibration.cameras.get(usize::from(camera.0))?.name)
    }

    /// The cameras of the calibration whose names match `pattern`, with `*` for any characters and `?` for one, ascending.
    pub fn cameras_named<'a>(&'a self, pattern: &'a str) -> impl Iterator<Item = CameraId> + 'a {
        let named = self.calibration.cameras.iter().zip(0..);
        named.filter(move |(it, _)| matches(pattern, &it.name)).map(|(_, number)| CameraId(number))
    }

    /// A path from a setting: `{camera}` becomes the camera's name, `${NAME}` an environment variable, and what is relative
    /// starts at the rig's folder (at the current folder where it comes out of a variable).
    ///
    /// # Errors
    /// `{camera}` in a node without one; a variable that is not set.
    pub fn path(&self, setting: &str, text: &str) -> Result<PathBuf, ConfigError> {
        let text = match (text.contains("{camera}"), self.camera_name()) {
            (false, _) => text.to_owned(),
            (true, Some(name)) => text.replace("{camera}", name),
            (true, None) => {
                return Err(ConfigError::at(
                    setting,
                    "`{camera}` needs a node with `each` or `camera`; this one has neither",
                ));
            }
        };
        expand_path(&text, &self.rig_dir).map_err(|message| ConfigError::at(setting, message))
    }
}

/// The calibration of a rig that names none.
pub fn no_cameras() -> Arc<Calibration> {
    Arc::new(Calibration {
        cameras: Vec::new(),
        length_unit: LengthUnit::Metre,
        clocks: Clocks::default(),
        heads: Heads::default(),
        provenance: None,
        uncertainties: Default::default(),
        origin: String::new(),
    })
}

/// Replaces each `${NAME}` by the environment variable of that name; what is relative and does not begin with a
/// variable starts at `base`.
///
/// # Errors
/// A sentence about a variable that is not set, or a `${` that never closes.
pub fn expand_path(text: &str, base: &Path) -> Result<PathBuf, String> {
    let mut expanded = String::new();
    let mut rest = text;
    while let Some(start) = rest.find("${") {
        expanded.push_str(&rest[..start]);
        let Some(length) = rest[start..].find('}') else {
            return Err(format!("`{text}` opens `${{` and never closes it"));
        };
        let name = &rest[start + 2..start + length];
        match std::env::var(name).ok().filter(|value| !value.is_empty()) {
            Some(value) => expanded.push_str(&value),
            None if name == "FOVEATE_DATA" && Path::new(DATA_DEFAULT).is_dir() => expanded.push_str(DATA_DEFAULT),
            None => return Err(format!("the environment variable `{name}` in `{text}` is not set")),
        }
        rest = &rest[start + length + 1..];
    }
    expanded.push_str(rest);
    Ok(if text.starts_with("${") { PathBuf::from(expanded) } else { base.join(expanded) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn relative_paths_start_at_the_rig_and_variables_at_the_current_folder() {
        let base = Path::new("/rigs");
        assert_eq!(expand_path("a/b.toml", base), Ok(PathBuf::from("/rigs/a/b.toml")));
        assert_eq!(expand_path("/abs", base), Ok(PathBuf::from("/abs")));
        let with_variable = expand_path("${CARGO_MANIFEST_DIR}/x", base);
        assert!(with_variable.is_ok_and(|path| !path.starts_with("/rigs") && path.ends_with("x")));
    }

    #[test]
    fn unset_variable_and_open_brace_are_named() {
        let base = Path::new("/rigs");
        assert!(expand_path("${NO_SUCH_VARIABLE_HERE}/x", base).is_err_and(|it| it.contains("NO_SUCH_VARIABLE_HERE")));
        assert!(expand_path("${HOME/x", base).is_err_and(|it| it.contains("never closes")));
    }

    #[test]
    fn file_of_the_results_has_one_writer_who_may_come_again() {
        let first = Setup::for_tests();
        let second = Setup { instance: "test.other".to_owned(), ..first.clone() };
        assert_eq!(first.claim_file(Some("file"), "targets.csv"), Ok(()));
        assert_eq!(first.claim_file(Some("file"), "targets.csv"), Ok(()), "a node that is made anew");
        assert_eq!(second.claim_file(Some("file"), "others.csv"), Ok(()));
        assert!(second.claim_file(Some("file"), "summary.json").is_err_and(|it| it.message.contains("`foveate`")));
        let refused = second.claim_file(Some("file"), "targets.csv");
        assert!(refused.is_err_and(|it| it.message.contains("`test.node`") && it.setting.as_deref() == Some("file")));
    }

    #[test]
    fn camera_in_a_path_needs_a_camera() {
        let refused = Setup::for_tests().path("path", "{camera}/*.jpg");
        assert!(refused.is_err_and(|it| it.message.contains("neither")));
    }
}
