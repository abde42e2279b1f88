//! `foveate plugin build`: makes a shared library out of a crate of nodes, so that it fits the program that asks for it.
//!
//! Cargo gives a crate its identity by its place *relative to the root of its workspace*, its version, features and dependencies. So the library is built
//! in a workspace that looks like the program's own: a folder with links to all its rooms, its lock file and its profiles, and in it two packages more,
//! the plugin and the shell that exports its symbols. Program and plugin are built in one invocation, so that features
//! are unified as one. Measured: all identities agree, nothing of the program is compiled again, and a plugin takes seconds. Other approaches do
//! not work: a path from another workspace to a room of ours, or the plugin without the program, gives other types.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use toml::{Table, Value};

use crate::{open, sources};

/// Where the workspaces are made, under the program's target folder.
const FOLDER: &str = "plugins";

/// The program that a library is to fit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Program {
    /// The folder of the workspace that it was built from.
    pub checkout: PathBuf,
    /// Cargo's folder for what it builds.
    pub target_dir: PathBuf,
    /// Cargo's name of the profile: `release`, `dev`, or one of its own.
    pub profile: String,
    /// The target, where one was named.
    pub triple: Option<String>,
    /// Environment variables that changed its profile, with their values: they change the identity of every crate.
    pub changes: Vec<(String, String)>,
    /// Flags for the compiler, each by itself.
    pub rustflags: Vec<String>,
    /// The package that makes the program.
    pub package: String,
    /// Features that it was built with, as `package/feature`.
    pub features: Vec<String>,
}

/// A library that was built.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Built {
    /// The file.
    pub library: PathBuf,
    /// The node types in it.
    pub node_types: Vec<String>,
}

impl Program {
    /// The running program, which `package` makes with `features`.
    pub fn this(package: &str, features: Vec<&str>) -> Self {
        let profile = match env!("FOVEATE_BUILD_PROFILE_NAME") {
            // Cargo's folder of the profile `dev` has another name.
            "debug" => "dev",
            name => name,
        };
        let changes = env!("FOVEATE_BUILD_CHANGES").split('\x1f').filter_map(|it| it.split_once('='));
        let flags = env!("FOVEATE_BUILD_RUSTFLAGS").split('\x1f').filter(|it| !it.is_empty());
        Self {
            checkout: env!("FOVEATE_BUILD_CHECKOUT").into(),
            target_dir: env!("FOVEATE_BUILD_TARGET_DIR").into(),
            profile: profile.to_owned(),
            triple: Some(env!("FOVEATE_BUILD_TRIPLE").to_owned()).filter(|it| !it.is_empty()),
            changes: changes.map(|(key, value)| (key.to_owned(), value.to_owned())).collect(),
            rustflags: flags.map(str::to_owned).collect(),
            package: package.to_owned(),
            features: features.into_iter().map(str::to_owned).collect(),
        }
    }

    /// The manifest of the checkout.
    ///
    /// # Errors
    /// When the checkout is gone.
    pub(crate) fn manifest(&self) -> Result<Table, String> {
        let path = self.checkout.join("Cargo.toml");
        let text = fs::read_to_string(&path).map_err(|error| {
            format!(
                "the checkout that this program was built from is gone: {} cannot be read ({error}); put it back there, or build the program again \
                 where it is now (`cargo build --release`) and use that one",
                path.display()
            )
        })?;
        read(&text, &path)
    }
}

/// Builds the crate in `folder` as a shared library in `out`; `show` is given cargo's lines.
///
/// # Errors
/// One or more sentences for the person.
pub fn library(program: &Program, folder: &Path, out: &Path, show: &mut dyn FnMut(&str)) -> Result<Built, String> {
    let workspace = program.manifest()?;
    if sources::hash(&program.checkout.join("framework")) != env!("FOVEATE_BUILD_SOURCES") {
        return Err(format!(
            "the checkout {} has changed since this program was built, so that a library of it would not fit: build the program again",
            program.checkout.display()
        ));
    }
    let folder =
        folder.canonicalize().map_err(|error| format!("the folder `{}` cannot be read: {error}", folder.display()))?;
    let manifest_path = folder.join("Cargo.toml");
    let text = fs::read_to_string(&manifest_path).map_err(|error| {
        format!("`{}` cannot be read: {error}; expected the folder of a crate", manifest_path.display())
    })?;
    let manifest = read(&text, &manifest_path)?;
    let package = Package::of(&manifest, &manifest_path)?;
    let overlay = Overlay::new(program, &package.name, &folder)?;
    overlay.write(&workspace, &package, manifest)?;
    let is_offline = overlay.cargo(program, &["metadata", "--format-version", "1", "--offline"]).is_ok_and(|it| it.0);
    let differences = overlay.differences(program, &package, is_offline)?;
    if !differences.is_empty() {
        return Err(format!(
            "`{}` needs other dependencies than the program was built with, so that the two would not fit:\n  {}\n  help: ask for the same versions and \
             features as the program, or build a program with the plugin linked in (see docs/write-a-plugin.md)",
            package.name,
            differences.join("\n  ")
        ));
    }
    let made = overlay.build(program, &package, is_offline, show)?;
    let name = format!("{}{}{}", std::env::consts::DLL_PREFIX, package.lib, std::env::consts::DLL_SUFFIX);
    let target = put(&made, &out.join(name))?;
    let types = open::open(&target).map_err(|error| {
        format!("{} was built and does not fit this program: {error}{}", target.display(), changed(program))
    })?;
    Ok(Built { library: target, node_types: types.iter().map(|it| it.name.to_owned()).collect() })
}

/// What to think of a library that was just built and does not fit.
fn changed(program: &Program) -> String {
    format!(
        "\n  The checkout {} or its compiler have changed since this program was built: build the program again.",
        program.checkout.display()
    )
}

/// Puts a library in its place in one step: a program that has the old one open keeps it.
fn put(made: &Path, target: &Path) -> Result<PathBuf, String> {
    let failed = |error: std::io::Error| format!("`{}` cannot be written: {error}", target.display());
    let beside = target.with_extension("new");
    if let Some(folder) = target.parent() {
        fs::create_dir_all(folder).map_err(failed)?;
    }
    fs::copy(made, &beside).map_err(failed)?;
    fs::rename(&beside, target).map_err(failed)?;
    target.canonicalize().map_err(failed)
}

fn read(text: &str, path: &Path) -> Result<Table, String> {
    text.parse::<Table>().map_err(|error| format!("`{}` is not TOML: {error}", path.display()))
}

/// What its manifest says of a plugin.
struct Package {
    name: String,
    version: String,
    /// Of its library, in code.
    lib: String,
}

impl Package {
    fn of(manifest: &Table, path: &Path) -> Result<Self, String> {
        let expected = |what: &str| format!("`{}` {what}", path.display());
        let package = manifest.get("package").and_then(Value::as_table);
        let package = package.ok_or_else(|| expected("has no `[package]`, expected the crate of a plugin"))?;
        let text = |key: &str| match package.get(key) {
            Some(Value::String(text)) => Ok(Some(text.clone())),
            Some(Value::Table(_)) => Ok(None),
            _ => Err(expected(&format!("has no `{key}` under `[package]`"))),
        };
        let name = text("name")?.ok_or_else(|| expected("has no name"))?;
        let lib = manifest.get("lib").and_then(|it| it.get("name")).and_then(Value::as_str);
        let lib = lib.map_or_else(|| name.replace('-', "_"), str::to_owned);
        let version = if package.contains_key("version") { text("version")? } else { None };
        Ok(Self { name, version: version.unwrap_or_else(|| "0.0.0".to_owned()), lib })
    }
}

/// A workspace that looks like the program's own, with a plugin in it.
struct Overlay {
    root: PathBuf,
    /// The folder of the plugin.
    plugin: PathBuf,
    /// Where the plugin lies in the checkout, if it does.
    inside: Option<PathBuf>,
    checkout: PathBuf,
}

impl Overlay {
    fn new(program: &Program, name: &str, plugin: &Path) -> Result<Self, String> {
        let checkout = program.checkout.canonicalize().map_err(|error| error.to_string())?;
        let inside = plugin.strip_prefix(&checkout).ok().map(Path::to_owned);
        let root = program.target_dir.join(FOLDER).join(name);
        Ok(Self { root, plugin: plugin.to_owned(), inside, checkout })
    }

    /// The plugin's folder in the workspace.
    fn member(&self) -> PathBuf {
        self.inside.clone().unwrap_or_else(|| "plugin".into())
    }

    fn write(&self, workspace: &Table, package: &Package, manifest: Table) -> Result<(), String> {
        let failed = |what: &Path| {
            let what = what.to_owned();
            move |error: std::io::Error| format!("`{}` cannot be written: {error}", what.display())
        };
        let _ = fs::remove_dir_all(&self.root);
        fs::create_dir_all(&self.root).map_err(failed(&self.root))?;
        let members = self.members(workspace);
        for first in members.iter().filter_map(|it| it.split('/').next()).collect::<BTreeSet<_>>() {
            link(&self.checkout.join(first), &self.root.join(first)).map_err(failed(&self.root.join(first)))?;
        }
        let lock = "Cargo.lock";
        fs::copy(self.checkout.join(lock), self.root.join(lock)).map_err(failed(&self.root.join(lock)))?;
        let toolchain = "rust-toolchain.toml";
        if self.checkout.join(toolchain).exists() {
            link(&self.checkout.join(toolchain), &self.root.join(toolchain)).map_err(failed(&self.root))?;
        }
        self.write_root(workspace, members)?;
        if self.inside.is_none() {
            self.write_plugin(manifest)?;
        }
        self.write_shell(package)
    }

    fn members(&self, workspace: &Table) -> Vec<String> {
        let list = workspace.get("workspace").and_then(|it| it.get("members")).and_then(Value::as_array);
        list.into_iter().flatten().filter_map(Value::as_str).map(str::to_owned).collect()
    }

    fn write_root(&self, workspace: &Table, mut members: Vec<String>) -> Result<(), String> {
        let mut root = workspace.clone();
        if self.inside.is_none() {
            members.push("plugin".to_owned());
        }
        members.push("library".to_owned());
        if let Some(Value::Table(workspace)) = root.get_mut("workspace") {
            workspace.insert("members".to_owned(), Value::from(members));
            workspace.remove("default-members");
        }
        write(&self.root.join("Cargo.toml"), &root.to_string())
    }

    /// The plugin's files by links, and its manifest with the paths in it put right.
    fn write_plugin(&self, mut manifest: Table) -> Result<(), String> {
        let folder = self.root.join("plugin");
        fs::create_dir_all(&folder).map_err(|error| format!("`{}` cannot be made: {error}", folder.display()))?;
        let entries = fs::read_dir(&self.plugin).map_err(|error| error.to_string())?;
        for entry in entries.flatten() {
            let name = entry.file_name();
            let left_out = ["Cargo.toml", "Cargo.lock", "target", ".git"];
            if left_out.iter().all(|it| *it != name) {
                link(&entry.path(), &folder.join(&name)).map_err(|error| error.to_string())?;
            }
        }
        for key in ["workspace", "profile", "patch", "replace", "dev-dependencies", "bench", "test", "example", "bin"] {
            manifest.remove(key);
        }
        if let Some(Value::Table(lib)) = manifest.get_mut("lib") {
            lib.remove("crate-type");
        }
        let inherited = inherited(&manifest, "");
        if !inherited.is_empty() {
            return Err(format!(
                "`{}` takes {} from a workspace of its own (`workspace = true`), expected them written out in the plugin",
                self.plugin.join("Cargo.toml").display(),
                inherited.join(", ")
            ));
        }
        self.set_paths(&mut manifest);
        write(&folder.join("Cargo.toml"), &manifest.to_string())
    }

    /// Paths of dependencies: into the program's workspace where they lead into its checkout, absolute otherwise.
    fn set_paths(&self, table: &mut Table) {
        for (key, value) in table.iter_mut() {
            let Value::Table(inner) = value else { continue };
            if key.ends_with("dependencies") {
                for (_, dependency) in inner.iter_mut() {
                    let Some(Value::String(path)) = dependency.as_table_mut().and_then(|it| it.get_mut("path")) else {
                        continue;
                    };
                    let whole = self.plugin.join(&*path);
                    let whole = whole.canonicalize().unwrap_or(whole);
                    let moved = whole.strip_prefix(&self.checkout).map(|it| self.root.join(it)).unwrap_or(whole);
                    *path = moved.to_string_lossy().into_owned();
                }
            } else if key != "package" {
                self.set_paths(inner);
            }
        }
    }

    /// The crate that is the library: nothing but its symbols.
    fn write_shell(&self, package: &Package) -> Result<(), String> {
        let folder = self.root.join("library/src");
        fs::create_dir_all(&folder).map_err(|error| format!("`{}` cannot be made: {error}", folder.display()))?;
        let (name, member) = (&package.name, self.member());
        let manifest = format!(
            "[package]\nname = \"{name}-library\"\nversion = \"{}\"\nedition = \"2024\"\npublish = false\n\n[lib]\nname = \"{}\"\n\
             crate-type = [\"cdylib\"]\ntest = false\ndoctest = false\n\n[dependencies]\nfoveate-plugin = {{ path = \"../framework/plugin\" }}\n\
             {name} = {{ path = \"../{}\" }}\n",
            package.version,
            shell_name(package),
            member.display()
        );
        write(&self.root.join("library/Cargo.toml"), &manifest)?;
        let code = format!(
            "//! The symbols of `{name}` as a shared library.\n\nfoveate_plugin::export_library!({}::LIBRARY);\n",
            package.lib
        );
        write(&folder.join("lib.rs"), &code)
    }

    fn command(&self, program: &Program, arguments: &[&str]) -> Command {
        let mut cargo = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
        cargo.args(arguments).current_dir(&self.root).env("CARGO_TARGET_DIR", &program.target_dir);
        let changes = std::env::vars_os().filter(|it| {
            let key = it.0.to_string_lossy();
            key == "CARGO_INCREMENTAL" || key.starts_with("CARGO_PROFILE_")
        });
        changes.for_each(|it| {
            cargo.env_remove(it.0);
        });
        cargo.envs(program.changes.iter().map(|it| (&it.0, &it.1)));
        cargo.env_remove("RUSTFLAGS").env("CARGO_ENCODED_RUSTFLAGS", program.rustflags.join("\x1f"));
        cargo
    }

    /// Whether cargo was content, what it gave and what it said.
    fn cargo(&self, program: &Program, arguments: &[&str]) -> Result<(bool, String, String), String> {
        let output = self.command(program, arguments).output();
        let output = output.map_err(|error| format!("`cargo` cannot be started: {error}; is Rust installed?"))?;
        let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
        Ok((output.status.success(), text(&output.stdout), text(&output.stderr)))
    }

    /// The program's dependencies that would be others beside this plugin, one line each.
    fn differences(&self, program: &Program, package: &Package, is_offline: bool) -> Result<Vec<String>, String> {
        let shell = format!("{}-library", package.name);
        let tree = |packages: &[&str]| -> Result<BTreeSet<String>, String> {
            let mut arguments = vec!["tree", "-e", "normal,build", "-f", "{p}|{f}", "--prefix", "none", "--no-dedupe"];
            arguments.extend(packages.iter().flat_map(|it| ["-p", it]));
            if is_offline {
                arguments.push("--offline");
            }
            let features = program.features.join(",");
            if !features.is_empty() {
                arguments.extend(["--features", features.as_str()]);
            }
            let (content, list, said) = self.cargo(program, &arguments)?;
            if !content {
                return Err(format!("cargo refuses the plugin `{}`:\n{}", package.name, said.trim_end()));
            }
            Ok(list.lines().filter(|it| !it.is_empty()).map(str::to_owned).collect())
        };
        let alone = tree(&[&program.package])?;
        let together = tree(&[&program.package, &shell])?;
        let name = |line: &str| line.split(' ').next().unwrap_or_default().to_owned();
        let lost: Vec<&String> = alone.difference(&together).collect();
        let lines = lost.into_iter().map(|before| {
            let after = together.difference(&alone).find(|it| name(it) == name(before));
            let after = after.map_or("nothing".to_owned(), |it| shown(it));
            format!("{}: the program has {}, with the plugin it would be {after}", name(before), shown(before))
        });
        Ok(lines.collect())
    }

    fn build(
        &self,
        program: &Program,
        package: &Package,
        is_offline: bool,
        show: &mut dyn FnMut(&str),
    ) -> Result<PathBuf, String> {
        let shell = format!("{}-library", package.name);
        let mut arguments = vec![
            "build",
            "--lib",
            "--profile",
            program.profile.as_str(),
            "-p",
            program.package.as_str(),
            "-p",
            shell.as_str(),
        ];
        if is_offline {
            arguments.push("--offline");
        }
        let features = program.features.join(",");
        if !features.is_empty() {
            arguments.extend(["--features", features.as_str()]);
        }
        if let Some(triple) = &program.triple {
            arguments.extend(["--target", triple.as_str()]);
        }
        let (content, _, said) = self.cargo(program, &arguments)?;
        said.lines().for_each(&mut *show);
        if !content {
            return Err(format!("`{}` cannot be built: cargo's words stand above", package.name));
        }
        let profile = if program.profile == "dev" { "debug" } else { &program.profile };
        let folder = program.triple.iter().fold(program.target_dir.clone(), |folder, it| folder.join(it)).join(profile);
        let name = format!("{}{}{}", std::env::consts::DLL_PREFIX, shell_name(package), std::env::consts::DLL_SUFFIX);
        Ok(folder.join(name))
    }
}

/// The shell's library, under a name that no other file of the target folder has.
fn shell_name(package: &Package) -> String {
    format!("{}_library", package.lib)
}

/// "1.0.5 with std,derive" of a line of `cargo tree`.
fn shown(line: &str) -> String {
    let (package, features) = line.split_once('|').unwrap_or((line, ""));
    let version = package.split(' ').nth(1).unwrap_or_default();
    if features.is_empty() { version.to_owned() } else { format!("{version} with {features}") }
}

/// The dotted keys that a manifest takes from its workspace.
fn inherited(table: &Table, path: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (key, value) in table {
        let Value::Table(inner) = value else { continue };
        let path = if path.is_empty() { key.clone() } else { format!("{path}.{key}") };
        if inner.get("workspace") == Some(&Value::Boolean(true)) {
            found.push(format!("`{path}`"));
        } else {
            found.extend(inherited(inner, &path));
        }
    }
    found
}

fn write(path: &Path, text: &str) -> Result<(), String> {
    fs::write(path, text).map_err(|error| format!("`{}` cannot be written: {error}", path.display()))
}

#[cfg(unix)]
fn link(to: &Path, at: &Path) -> std::io::Result<()> {
    std::os::unix::fs::symlink(to, at)
}

#[cfg(not(unix))]
fn link(_: &Path, _: &Path) -> std::io::Result<()> {
    Err(std::io::Error::other("libraries are built on Unix only: it needs symbolic links"))
}
