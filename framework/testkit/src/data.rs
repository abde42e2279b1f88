//! Where the real recordings lie, if this machine has them.

use std::path::{Path, PathBuf};

/// The folder of real recordings: `$FOVEATE_DATA`, or `../shared/data` beside the workspace. `None` when there is no
/// such folder.
pub fn data_dir() -> Option<PathBuf> {
    let folder = expected();
    folder.is_dir().then_some(folder)
}

/// A file or folder in [`data_dir`]; when this machine lacks it, `None` and a line that says which test was skipped.
pub fn data_dir_or_skip(test: &str, path: &str) -> Option<PathBuf> {
    let found = expected().join(path);
    if found.exists() {
        return Some(found);
    }
    println!("skipped: {test} needs {}; set FOVEATE_DATA to the folder of recordings", found.display());
    None
}

fn expected() -> PathBuf {
    match std::env::var_os("FOVEATE_DATA") {
        Some(folder) => PathBuf::from(folder),
        None => workspace_root().join("../shared/data"),
    }
}

/// The folder of the workspace that this was built in.
pub fn workspace_root() -> &'static Path {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    here.ancestors().nth(2).unwrap_or(here)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn workspace_root_holds_the_workspace() {
        assert!(workspace_root().join("Cargo.lock").is_file());
    }

    #[test]
    fn what_is_missing_is_skipped() {
        assert_eq!(data_dir_or_skip("this test", "no such recording"), None);
    }
}
