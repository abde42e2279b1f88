//! Words that do not come back in documentation, messages and doc comments: they read as translated, or the field has others (see `CONTRIBUTING.md`).

use std::fs;
use std::path::{Path, PathBuf};

/// What is not written, and what to write.
const WORDS: [(&str, &str); 40] = [
    ("told", "resolved, inferred, distinguished, reported"),
    ("foretold", "predicted"),
    ("foretell", "predict"),
    ("foretells", "predicts"),
    ("nobody", "no camera, no person, no node"),
    ("nobody's", "of no camera"),
    ("somebody", "a person"),
    ("somebody's", "a person's"),
    ("anybody", "a person"),
    ("everybody", "all"),
    ("whom", "a sentence of its own"),
    ("whoever", "the person who, the camera that"),
    ("culprit", "the camera at fault"),
    ("culprits", "the cameras at fault"),
    ("accuse", "diagnose"),
    ("accuses", "diagnoses"),
    ("accused", "diagnosed"),
    ("accusation", "diagnosis"),
    ("beheld", "observed"),
    ("looked for", "searched"),
    ("held against", "compared with"),
    ("stand for", "represent"),
    ("stands for", "represents, means"),
    ("such as was", "a sentence of its own"),
    ("anew", "again"),
    ("hang together", "are connected"),
    ("hangs together", "is connected"),
    ("at first sight", "initially"),
    ("of late", "recently"),
    ("in vain", "without success"),
    ("wish", "option, request"),
    ("wishes", "options, requests"),
    ("heard of", "received from"),
    ("asked for", "requested, required"),
    ("tell it from", "distinguish it from"),
    ("tells it from", "distinguishes it from"),
    ("thereof", "of it"),
    ("hitherto", "so far"),
    ("by turns", "alternately"),
    ("goes on as", "continues as"),
];

/// Files that may hold any word, and why.
const EXCEPTIONS: [(&str, &str); 1] = [("tests/tests/words.rs", "names the words")];

/// String literals of a file that may hold a word because they name a figure, and why.
const NAMES: [(&str, &str, &str); 2] = [
    ("plugins/voxel_body/src/carver/mod.rs", "\"voxels.nobody\"", "name of a figure in existing results"),
    ("plugins/voxel_body/src/carver/mod.rs", "\"nobody\"", "last part of that name"),
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// Files of the repository with one of `extensions`, but for tests and benches of the code.
fn files(folder: &Path, extensions: &[&str], found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        let name = entry.file_name().to_string_lossy().into_owned();
        if path.is_dir() {
            if !["target", "tests", "benches", "fuzz", ".git", "results"].contains(&name.as_str()) {
                files(&path, extensions, found);
            }
        } else if name != "tests.rs" && path.extension().is_some_and(|it| extensions.iter().any(|of| it == *of)) {
            found.push(path);
        }
    }
}

/// Doc comments and string literals before the tests of a source file, each with its first line.
fn spoken(text: &str) -> Vec<(usize, &str)> {
    let tests = text
        .match_indices("#[cfg(test)]\nmod ")
        .find(|(at, it)| text[at + it.len()..].lines().next().is_some_and(|line| line.ends_with('{')));
    let text = &text[..tests.map_or(text.len(), |it| it.0)];
    let bytes = text.as_bytes();
    let (mut i, mut line, mut found) = (0, 1, Vec::new());
    while i < bytes.len() {
        let rest = &text[i..];
        let (end, is_spoken) = if rest.starts_with("//") {
            (rest.find('\n').unwrap_or(rest.len()), rest.starts_with("///") || rest.starts_with("//!"))
        } else if let Some(hashes) = raw_string(rest) {
            let close = format!("\"{}", "#".repeat(hashes));
            (rest[hashes + 2..].find(&close).map_or(rest.len(), |it| it + hashes + 2 + close.len()), true)
        } else if bytes[i] == b'"' {
            (string_end(rest), true)
        } else if bytes[i] == b'\'' {
            (character_end(rest), false)
        } else {
            (rest.chars().next().map_or(1, char::len_utf8), false)
        };
        if is_spoken {
            found.push((line, &rest[..end]));
        }
        line += rest[..end].matches('\n').count();
        i += end;
    }
    found
}

/// How many `#` a raw string begins with, if one begins here.
fn raw_string(rest: &str) -> Option<usize> {
    let after = rest.strip_prefix('r')?;
    let hashes = after.len() - after.trim_start_matches('#').len();
    after[hashes..].starts_with('"').then_some(hashes)
}

fn string_end(rest: &str) -> usize {
    let mut is_escaped = false;
    for (at, c) in rest.char_indices().skip(1) {
        match c {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return at + 1,
            _ => {}
        }
    }
    rest.len()
}

/// The end of `'x'` or `'\n'`; of the mark alone where it begins a lifetime.
fn character_end(rest: &str) -> usize {
    let mut chars = rest.char_indices().skip(1);
    match (chars.next(), chars.next()) {
        (Some((_, '\\')), _) => rest[2..].find('\'').map_or(1, |it| it + 3),
        (Some(_), Some((at, '\''))) => at + 1,
        _ => 1,
    }
}

/// The words of [`WORDS`] that `text` holds, with what to write; parts of names and of `code` are none.
fn unwanted(text: &str) -> Vec<(&'static str, &'static str)> {
    let lower = text.to_lowercase();
    let is_part = |c: Option<char>| c.is_some_and(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | '`' | '\''));
    let holds = |word: &str| {
        lower.match_indices(word).any(|(at, it)| {
            let before = lower[..at].chars().next_back();
            let after = lower[at + it.len()..].chars().next();
            !is_part(before) && !is_part(after.filter(|it| *it != '\''))
        })
    };
    WORDS.into_iter().filter(|it| holds(it.0)).collect()
}

#[test]
fn plain_words_are_used() {
    let mut paths = Vec::new();
    files(&root(), &["rs", "md", "html", "js"], &mut paths);
    assert!(paths.len() > 300, "{} files", paths.len());
    let mut complaints = Vec::new();
    for path in paths {
        let name = path.strip_prefix(root()).unwrap_or(&path).display().to_string();
        if EXCEPTIONS.iter().any(|it| it.0 == name) {
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        let pieces: Vec<(usize, &str)> = if name.ends_with(".rs") {
            spoken(&text)
        } else {
            text.lines().enumerate().map(|it| (it.0 + 1, it.1)).collect()
        };
        let is_name = |piece: &str| NAMES.iter().any(|it| it.0 == name && it.1 == piece);
        for (line, piece) in pieces.into_iter().filter(|it| !is_name(it.1)) {
            for (word, instead) in unwanted(piece) {
                complaints.push(format!("{name}:{line}: `{word}`, write: {instead}"));
            }
        }
    }
    assert!(complaints.is_empty(), "{} places:\n{}", complaints.len(), complaints.join("\n"));
}

#[test]
fn words_are_found_in_what_is_spoken_and_nowhere_else() {
    let text = "/// It was told.\n// nobody\nlet a = \"x \\\" somebody\"; let told = '\"'; fn f<'a>() {}\nlet b = r#\"anew\"#; \"nobody_else\"";
    let found: Vec<(usize, &str)> =
        spoken(text).into_iter().flat_map(|(line, it)| unwanted(it).into_iter().map(move |it| (line, it.0))).collect();
    assert_eq!(found, [(1, "told"), (3, "somebody"), (4, "anew")]);
    assert!(unwanted("the figure `told_at_s`, untold, a wishbone").is_empty());
    assert_eq!(unwanted("Nobody's camera").len(), 2);
}
