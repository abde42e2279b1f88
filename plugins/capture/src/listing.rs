//! Which files of a folder make a sequence, and which frame each of them is.
//!
//! The number in a name is the last run of digits before the extension: `arctic1.pvi.0042.jpg` is frame 42.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use foveate::scene::natural_order;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Extensions that a folder without a pattern is searched for.
const ENDINGS: [&str; 3] = ["jpg", "jpeg", "png"];
/// Numbers may span this many frames per file, and [`SPAN_FREE`] more; otherwise they are no frame numbers.
const SPAN_PER_FILE: u64 = 100;
const SPAN_FREE: u64 = 10_000;

/// How the frame of a file is found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Numbering {
    /// By the number in its name; a missing number is a gap.
    #[default]
    Name,
    /// By its place in the natural order of the names; no frame can be missing.
    Order,
}

/// One file of a sequence.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Frame {
    pub(crate) path: PathBuf,
    /// Counted from the first frame of the sequence.
    pub(crate) index: u64,
}

/// The files of a sequence, ascending by index.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub(crate) struct Listing {
    pub(crate) frames: Vec<Frame>,
    /// Number in the name of the first frame.
    pub(crate) first: u64,
    /// Files left out because their number lies before `first_number`.
    pub(crate) before_first: usize,
}

impl Listing {
    /// The files of `pattern`: a folder, or a folder and a file name with `*` and `?`.
    ///
    /// # Errors
    /// A sentence with the folder, the pattern, what was found and what is expected.
    pub(crate) fn of(pattern: &Path, numbering: Numbering, first_number: Option<u64>) -> Result<Self, String> {
        let mut files = matching(pattern)?;
        files.sort_by(|a, b| natural_order(&name_of(a), &name_of(b)));
        let numbers: Vec<Option<u64>> = files.iter().map(|path| number_in(&name_of(path))).collect();
        if numbering == Numbering::Order || (files.len() == 1 && numbers[0].is_none()) {
            let frames = files.into_iter().zip(0..).map(|(path, index)| Frame { path, index }).collect();
            return Ok(Self { frames, first: 0, before_first: 0 });
        }
        let mut by_number: BTreeMap<u64, PathBuf> = BTreeMap::new();
        for (path, number) in files.into_iter().zip(numbers) {
            let Some(number) = number else {
                return Err(format!(
                    "`{}` has no number in its name (up to 18 digits), so its time is unknown; narrow the pattern, or set numbering = \"order\"",
                    path.display()
                ));
            };
            if let Some(other) = by_number.get(&number) {
                return Err(format!(
                    "`{}` and `{}` have the same number {number}; narrow the pattern",
                    other.display(),
                    name_of(&path)
                ));
            }
            by_number.insert(number, path);
        }
        let n_files = by_number.len();
        let smallest = by_number.keys().next().copied().unwrap_or(0);
        let kept = by_number.split_off(&first_number.unwrap_or(0));
        let first = first_number.unwrap_or(smallest);
        let Some(&last) = kept.keys().next_back() else {
            return Err(format!(
                "all numbers in `{}` lie before first_number = {first}: they begin at {smallest}",
                pattern.display()
            ));
        };
        if last - first > SPAN_FREE + SPAN_PER_FILE * n_files as u64 {
            return Err(format!(
                "the numbers in the names of `{}` run from {first} to {last} for {n_files} files, so they are no frame numbers; set numbering = \"order\"",
                pattern.display()
            ));
        }
        let before_first = n_files - kept.len();
        let frames = kept.into_iter().map(|(number, path)| Frame { path, index: number - first }).collect();
        Ok(Self { frames, first, before_first })
    }

    /// Frames from the first to the last, present or not.
    pub(crate) fn length(&self) -> u64 {
        self.frames.last().map_or(0, |it| it.index + 1)
    }
}

/// Regular files that `pattern` selects, at least one.
fn matching(pattern: &Path) -> Result<Vec<PathBuf>, String> {
    let has_wildcard = name_of(pattern).contains(['*', '?']);
    if !has_wildcard && !pattern.exists() {
        return Err(format!(
            "`{}` does not exist, expected a folder of pictures{}",
            pattern.display(),
            nearest(pattern)
        ));
    }
    let (folder, name_pattern) = if pattern.is_dir() {
        (pattern.to_owned(), None)
    } else {
        let name = pattern.file_name().map(|it| it.to_string_lossy().into_owned());
        let folder = pattern.parent().filter(|it| !it.as_os_str().is_empty()).unwrap_or(Path::new("."));
        (folder.to_owned(), name)
    };
    let entries = fs::read_dir(&folder)
        .map_err(|error| format!("the folder `{}` cannot be read: {error}{}", folder.display(), nearest(&folder)))?;
    let mut selected = Vec::new();
    let mut others: BTreeMap<String, usize> = BTreeMap::new();
    for entry in entries {
        let path = entry.map_err(|error| format!("the folder `{}` cannot be read: {error}", folder.display()))?.path();
        let name = name_of(&path);
        if name.starts_with('.') || !path.is_file() {
            continue;
        }
        let ending = path.extension().map(|it| it.to_string_lossy().to_lowercase()).unwrap_or_default();
        let taken = match &name_pattern {
            Some(name_pattern) => fits(&name, name_pattern),
            None => ENDINGS.contains(&ending.as_str()),
        };
        if taken {
            selected.push(path);
        } else {
            *others.entry(ending).or_default() += 1;
        }
    }
    if selected.is_empty() {
        let sought = name_pattern.unwrap_or_else(|| ENDINGS.map(|it| format!("*.{it}")).join(", "));
        let mut by_count: Vec<_> = others.into_iter().collect();
        by_count.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
        let found: Vec<String> =
            by_count.iter().take(4).map(|(ending, count)| format!("{count} `*.{ending}`")).collect();
        let found = if found.is_empty() { "no files at all".to_owned() } else { found.join(", ") };
        return Err(format!("no file in `{}` fits `{sought}`; it holds {found}", folder.display()));
    }
    Ok(selected)
}

/// The part of a path that exists, as the end of a sentence.
fn nearest(path: &Path) -> String {
    let parent = path.ancestors().skip(1).find(|it| it.is_dir());
    parent.map_or(String::new(), |it| format!("; found `{}`", it.display()))
}

fn name_of(path: &Path) -> String {
    path.file_name().map(|it| it.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Whether `name` fits `pattern`, in which `*` is any run of characters and `?` any one.
fn fits(name: &str, pattern: &str) -> bool {
    let (name, pattern): (Vec<char>, Vec<char>) = (name.chars().collect(), pattern.chars().collect());
    let (mut at, mut in_pattern) = (0, 0);
    let mut star: Option<(usize, usize)> = None;
    while at < name.len() {
        match pattern.get(in_pattern) {
            Some('*') => {
                star = Some((in_pattern, at));
                in_pattern += 1;
            }
            Some(&it) if it == '?' || it == name[at] => {
                at += 1;
                in_pattern += 1;
            }
            _ => match star {
                // The last star takes one character more.
                Some((star_in_pattern, taken)) => {
                    star = Some((star_in_pattern, taken + 1));
                    at = taken + 1;
                    in_pattern = star_in_pattern + 1;
                }
                None => return false,
            },
        }
    }
    pattern[in_pattern..].iter().all(|&it| it == '*')
}

/// The last run of digits before the extension; `None` without one, or with more than 18 digits.
fn number_in(name: &str) -> Option<u64> {
    let stem = name.rsplit_once('.').map_or(name, |(stem, _)| stem);
    let end = stem.rfind(|it: char| it.is_ascii_digit())? + 1;
    let start = stem[..end]
        .rfind(|it: char| !it.is_ascii_digit())
        .map_or(0, |it| it + stem[it..].chars().next().map_or(1, char::len_utf8));
    let digits = stem[start..end].trim_start_matches('0');
    match digits.len() {
        0 => Some(0),
        1..=18 => digits.parse().ok(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder_of(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        names.iter().for_each(|name| fs::write(folder.path().join(name), "x").unwrap());
        folder
    }

    #[track_caller]
    fn indices(names: &[&str], pattern: &str, first_number: Option<u64>) -> Result<Vec<(String, u64)>, String> {
        let folder = folder_of(names);
        let listing = Listing::of(&folder.path().join(pattern), Numbering::Name, first_number)?;
        Ok(listing.frames.iter().map(|it| (name_of(&it.path), it.index)).collect())
    }

    #[test]
    fn number_is_the_last_run_of_digits_before_the_extension() {
        assert_eq!(number_in("arctic1.pvi.0042.jpg"), Some(42));
        assert_eq!(number_in("img_7_left.png"), Some(7));
        assert_eq!(number_in("é12ü.png"), Some(12));
        assert_eq!(number_in("0000.jp2"), Some(0));
        assert_eq!(number_in("mask.jpg2"), None);
        assert_eq!(number_in("1234567890123456789.jpg"), None);
    }

    #[test]
    fn numbers_make_indices_and_missing_numbers_leave_holes() {
        let found = indices(&["a10.jpg", "a9.jpg", "a12.jpg", "notes.txt"], "", None).unwrap();
        let expected = [("a9.jpg", 0), ("a10.jpg", 1), ("a12.jpg", 3)].map(|(name, index)| (name.to_owned(), index));
        assert_eq!(found, expected);
        let from_ten = indices(&["a10.jpg", "a9.jpg", "a12.jpg"], "*.jpg", Some(8)).unwrap();
        assert_eq!(from_ten.iter().map(|it| it.1).collect::<Vec<_>>(), [1, 2, 4]);
    }

    #[test]
    fn files_before_the_first_number_are_left_out_and_counted() {
        let folder = folder_of(&["a1.png", "a2.png", "a3.png"]);
        let listing = Listing::of(folder.path(), Numbering::Name, Some(2)).unwrap();
        assert_eq!((listing.frames.len(), listing.before_first, listing.length()), (2, 1, 2));
        assert!(Listing::of(folder.path(), Numbering::Name, Some(9)).unwrap_err().contains("first_number = 9"));
    }

    #[test]
    fn order_of_names_can_count_instead() {
        let folder = folder_of(&["b.png", "a10.png", "a9.png"]);
        let listing = Listing::of(folder.path(), Numbering::Order, None).unwrap();
        let names: Vec<String> = listing.frames.iter().map(|it| name_of(&it.path)).collect();
        assert_eq!(names, ["a9.png", "a10.png", "b.png"]);
    }

    #[test]
    fn names_that_do_not_count_frames_are_refused_with_the_way_out() {
        let refused = |names: &[&str]| indices(names, "*.png", None).unwrap_err();
        assert!(refused(&["a1.png", "mean.png"]).contains("mean.png"));
        assert!(refused(&["a1.png", "b1.png"]).contains("number 1"));
        let stamps = refused(&["1610000000123.png", "1610009999999.png"]);
        assert!(stamps.contains("numbering = \"order\""), "{stamps}");
    }

    #[test]
    fn empty_and_missing_folders_are_named_with_what_they_hold() {
        let refused = indices(&["a.bmp", "b.bmp", "c.txt"], "", None).unwrap_err();
        assert!(refused.contains("*.jpg") && refused.contains("2 `*.bmp`, 1 `*.txt`"), "{refused}");
        assert!(indices(&[], "*.jpg", None).unwrap_err().contains("no files at all"));
        assert!(indices(&[], "nowhere/*.jpg", None).unwrap_err().contains("nowhere"));
        assert!(indices(&[], "nowhere", None).unwrap_err().contains("does not exist"));
    }

    #[test]
    fn patterns() {
        for (name, pattern) in [("a1.jpg", "*.jpg"), ("a1.jpg", "a?.jpg"), ("abab.x", "*ab.x"), ("x", "x*"), ("", "*")]
        {
            assert!(fits(name, pattern), "{name} {pattern}");
        }
        for (name, pattern) in [("a1.jpeg", "*.jpg"), ("a12.jpg", "a?.jpg"), ("abac.x", "*ab.x"), ("x", "y*")] {
            assert!(!fits(name, pattern), "{name} {pattern}");
        }
    }
}
