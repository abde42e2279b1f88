//! Texts that are compared with a committed file; `UPDATE_GOLDEN=1` rewrites it.

use std::path::Path;

use crate::data::workspace_root;

/// Compares `text` with the file at `path`, relative to the workspace. With the environment variable `UPDATE_GOLDEN`
/// set to 1 the file is written instead.
///
/// # Panics
/// At the first line that differs, or when the file cannot be read or written.
#[track_caller]
pub fn check(path: impl AsRef<Path>, text: &str) {
    let path = workspace_root().join(path);
    if std::env::var("UPDATE_GOLDEN").is_ok_and(|it| it == "1") {
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
        }
        return std::fs::write(&path, text).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    }
    let expected = std::fs::read_to_string(&path)
        .unwrap_or_else(|error| panic!("{}: {error}; UPDATE_GOLDEN=1 writes it", path.display()));
    if let Some(difference) = first_difference(&expected, text) {
        panic!("{}: {difference}\nUPDATE_GOLDEN=1 rewrites the file", path.display());
    }
}

/// Where two texts differ first, in words; `None` when they are equal.
fn first_difference(expected: &str, found: &str) -> Option<String> {
    if expected == found {
        return None;
    }
    let (mut expected, mut found) = (expected.lines(), found.lines());
    for number in 1.. {
        match (expected.next(), found.next()) {
            (None, None) => break,
            (before, now) if before == now => {}
            (before, now) => {
                let line = |it: Option<&str>| it.map_or("the end".to_owned(), |it| format!("`{it}`"));
                return Some(format!("line {number}: found {}, expected {}", line(now), line(before)));
            }
        }
    }
    Some("the texts differ in how lines end".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_line_that_differs_is_named() {
        assert_eq!(first_difference("a\nb\n", "a\nb\n"), None);
        assert_eq!(first_difference("a\nb\n", "a\nc\n").unwrap(), "line 2: found `c`, expected `b`");
        assert_eq!(first_difference("a\n", "a\nb\n").unwrap(), "line 2: found `b`, expected the end");
        assert!(first_difference("a\n", "a").unwrap().contains("how lines end"));
    }
}
