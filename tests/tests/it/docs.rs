//! What the pages tell people to type: the program understands it, the rigs that it names exist, and what takes a second is run.

use std::fs;

use clap::Parser;
use clap::error::ErrorKind;

use super::the_program::{foveate, root};

/// A command of a page, after `foveate`.
struct Command {
    /// Page and text, for people.
    place: String,
    arguments: Vec<String>,
    /// A line of its own, complete; otherwise a mention within a sentence.
    is_line: bool,
}

/// Words of a shell's line up to a comment, a pipe or a further command.
fn words(line: &str) -> Vec<String> {
    let (mut found, mut word, mut quote) = (Vec::new(), None::<String>, None);
    for c in line.chars().chain([' ']) {
        match (quote, c) {
            (Some(open), _) if c == open => quote = None,
            (None, '\'' | '"') => {
                quote = Some(c);
                word.get_or_insert_default();
            }
            (None, ' ') => found.extend(word.take()),
            (None, '#' | '&' | '|' | '>' | ';') if word.is_none() => break,
            _ => word.get_or_insert_default().push(c),
        }
    }
    found
}

fn commands() -> Vec<Command> {
    let mut pages: Vec<_> = fs::read_dir(root().join("docs")).unwrap().map(|it| it.unwrap().path()).collect();
    pages.extend(["README.md", "CONTRIBUTING.md", "examples/README.md"].map(|it| root().join(it)));
    pages.retain(|it| it.extension().is_some_and(|it| it == "md") && !it.ends_with("results.md"));
    pages.sort();
    let mut found = Vec::new();
    for page in pages {
        let name = page.strip_prefix(root()).unwrap().display().to_string();
        let text = fs::read_to_string(&page).unwrap();
        let mut add = |text: &str, is_line: bool| {
            let rest = text.strip_prefix("foveate ").or_else(|| text.strip_prefix("cargo run --release -- "));
            if let Some(rest) = rest.filter(|it| !it.contains('…') && !it.contains('$')) {
                found.push(Command { place: format!("{name}: {text}"), arguments: words(rest), is_line });
            }
        };
        for (at, block) in text.split("```").enumerate() {
            match at % 2 {
                1 => block.lines().for_each(|it| add(it.trim(), true)),
                _ => block.split('`').skip(1).step_by(2).for_each(|it| add(&it.replace('\n', " "), false)),
            }
        }
    }
    found
}

#[test]
fn commands_of_the_pages_are_understood_and_their_rigs_exist() {
    let commands = commands();
    assert!(commands.iter().filter(|it| it.is_line).count() > 20, "pages have commands");
    for Command { place, arguments, is_line } in commands {
        let line = std::iter::once("foveate").chain(arguments.iter().map(String::as_str));
        match foveate_cli::commands::Cli::try_parse_from(line).map_err(|it| it.kind()) {
            Ok(_) | Err(ErrorKind::DisplayHelp) => {}
            Err(ErrorKind::MissingRequiredArgument | ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand)
                if !is_line => {}
            Err(kind) => panic!("{place}: {kind}"),
        }
        for rig in arguments.iter().filter(|it| it.starts_with("graphs/") && it.ends_with(".toml")) {
            assert!(root().join(rig).exists(), "{place}: there is no {rig}");
        }
    }
}

#[test]
fn commands_that_take_a_second_do_what_the_pages_say() {
    let folder = tempfile::tempdir().unwrap();
    std::os::unix::fs::symlink(root().join("graphs"), folder.path().join("graphs")).unwrap();
    let mut n_run = 0;
    for Command { place, arguments, .. } in commands() {
        let [command, rest @ ..] = arguments.as_slice() else { continue };
        let needs_nothing = match command.as_str() {
            "nodes" | "figures" => {
                !rest.iter().any(|it| it.chars().all(|c| c.is_uppercase()) || it.starts_with("star_finder"))
            }
            "patterns" => rest.contains(&"--out".to_owned()),
            "convert" | "check" => rest.first().is_some_and(|it| it.starts_with("graphs/")),
            "schema" => true,
            _ => false,
        };
        if needs_nothing {
            let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
            let (code, said, complaint) = foveate(folder.path(), &arguments);
            assert_eq!(code, 0, "{place}: {complaint}");
            assert!(!said.is_empty(), "{place} prints nothing");
            n_run += 1;
        }
    }
    assert!(n_run > 8, "{n_run}");
}
