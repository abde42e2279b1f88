//! Names in CSV files and file names, deterministic for the same values.

pub(crate) use foveate::diagnostics::fields::field;
pub(crate) use foveate::motion::csv::{fixed, scientific};
use foveate::prelude::*;

/// The names of all cameras of a setup as written in files; `+` joins them, so it becomes `_` within one.
pub(crate) fn camera_names(setup: &Setup) -> Vec<String> {
    setup.calibration.cameras.iter().map(|it| it.name.replace('+', "_")).collect()
}

/// A name as part of a file name: letters, digits, `-`, `_` and `.` are kept.
pub(crate) fn file_part(name: &str) -> String {
    let kept = |it: char| it.is_alphanumeric() || matches!(it, '-' | '_' | '.');
    let part: String = name.chars().map(|it| if kept(it) { it } else { '_' }).collect();
    part.trim_start_matches('.').to_owned()
}

/// Refuses a name that is not a plain file name.
pub(crate) fn check_file_name(setting: &str, name: &str) -> Result<(), ConfigError> {
    if name.is_empty() || file_part(name) != name {
        let rule = "expected a plain file name: letters, digits, `-`, `_` and `.`, without folders";
        return Err(ConfigError::at(setting, format_args!("found `{name}`, {rule}")));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_inside_their_folder() {
        assert_eq!(file_part("../wide 1/é"), "_wide_1_é");
        assert!(check_file_name("file", "targets.csv").is_ok());
        for wrong in ["", "..", "a/b.csv", ".hidden", "/etc/passwd"] {
            assert!(check_file_name("file", wrong).is_err(), "{wrong}");
        }
    }
}
