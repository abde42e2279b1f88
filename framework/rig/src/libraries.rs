//! `[plugins] libraries`: shared libraries with node types, opened before any node is looked up.

use std::borrow::Cow;
use std::path::Path;

use super::grammar::plugins::LIBRARIES;
use foveate_diagnostics::names::shown;
use foveate_diagnostics::value::Value;
use foveate_diagnostics::{Findings, names};
use foveate_node::Registry;
use foveate_node::setup::expand_path;
use toml::Spanned;

/// What stands in `[plugins]`: the paths of libraries, as written.
pub(super) fn read(
    key: &Spanned<String>,
    value: Value<'_>,
    text: &str,
    findings: &mut Findings,
) -> Vec<Spanned<String>> {
    let Some(mut keys) = findings.table(key, value, text, "a table `[plugins]`") else { return Vec::new() };
    let mut paths = Vec::new();
    if let Some(list) = keys.take(LIBRARIES.name) {
        match list.get_ref().as_array() {
            Some(items) => {
                let items = items.iter().cloned();
                paths.extend(items.filter_map(|it| findings.text(LIBRARIES.name, it, "the path of a library")));
            }
            None => findings.not_as_expected(LIBRARIES.name, &list, "a list of paths of libraries"),
        }
    }
    keys.close("`[plugins]`", findings);
    paths
}

/// `registry` with the node types of the rig's libraries, and whether all of them could be used.
pub(super) fn open<'r>(
    registry: &'r Registry,
    libraries: &[Spanned<String>],
    rig_dir: &Path,
    findings: &mut Findings,
) -> (Cow<'r, Registry>, bool) {
    let mut registry = Cow::Borrowed(registry);
    let mut all = true;
    for library in libraries {
        let path = match expand_path(library.get_ref(), rig_dir) {
            Ok(path) => path,
            Err(message) => {
                findings.error(library.span(), "a library of nodes cannot be found", message);
                all = false;
                continue;
            }
        };
        if let Err(error) = registry.to_mut().open_library(&path) {
            all = false;
            let differences = (!error.differences.is_empty()).then(|| error.differences.join("\n"));
            let help = [differences, error.help].into_iter().flatten().collect::<Vec<_>>().join("\n");
            let title = format!("the library `{}` cannot be used", shown(library.get_ref()));
            findings
                .error(library.span(), title, names::shown(&error.what))
                .maybe_help((!help.is_empty()).then_some(help));
        }
    }
    (registry, all)
}
