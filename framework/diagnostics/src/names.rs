//! Names in messages: what was probably meant, what there is, what a pattern matches.

use std::fmt::Display;

/// Names that a list shows before it only counts.
const MOST_LISTED: usize = 12;
/// Names among which a likely one is searched.
const MOST_COMPARED: usize = 5_000;

/// The one of `known` that was probably meant by `found`.
pub fn likely<'n>(found: &str, known: impl IntoIterator<Item = &'n str>) -> Option<&'n str> {
    if found.len() > 100 {
        return None;
    }
    let near = |name: &str| {
        let distance = strsim::damerau_levenshtein(found, name);
        let allowed = 1 + found.chars().count().min(name.chars().count()) / 3;
        let is_part = || name.split(['.', '_', '-']).any(|part| part == found);
        (distance <= allowed || is_part()).then_some(distance)
    };
    let known = known.into_iter().take(MOST_COMPARED).filter(|name| name.len().abs_diff(found.len()) < 40);
    known.filter_map(|name| Some((near(name)?, name))).min_by_key(|it| it.0).map(|it| it.1)
}

/// "did you mean …?", or what there is.
pub fn did_you_mean<'n, I>(found: &str, what: &str, known: I) -> String
where
    I: IntoIterator<Item = &'n str>,
    I::IntoIter: Clone,
{
    let known = known.into_iter();
    match likely(found, known.clone()) {
        Some(name) => format!("did you mean `{name}`?"),
        None => available(what, known),
    }
}

/// What there is: "`a`, `b` and `c`", or that there is none.
pub fn available<'n>(what: &str, known: impl IntoIterator<Item = &'n str>) -> String {
    match listed(known) {
        Some(list) => format!("{what}: {list}"),
        None => format!("{what}: none"),
    }
}

/// Names in backticks, the first twelve of them; `None` when there are none.
pub fn listed<N: Display>(names: impl IntoIterator<Item = N>) -> Option<String> {
    let mut names = names.into_iter();
    let mut list: Vec<String> = names.by_ref().take(MOST_LISTED).map(|it| format!("`{}`", shown(&it))).collect();
    let more = names.count();
    if more > 0 {
        return Some(format!("{} and {more} more", list.join(", ")));
    }
    let last = list.pop()?;
    Some(if list.is_empty() { last } else { format!("{} and {last}", list.join(", ")) })
}

/// Words in quotes: `"a", "b" or "c"`.
pub fn one_of(words: &[&str]) -> String {
    let words: Vec<String> = words.iter().map(|it| format!("\"{it}\"")).collect();
    match words.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
        _ => words.concat(),
    }
}

/// Text from a rig as messages show it: without control characters, at most 80 characters of it.
pub fn shown(text: &impl Display) -> String {
    let text = text.to_string();
    let mut short: String = text.chars().take(80).flat_map(printable).collect();
    if text.chars().nth(80).is_some() {
        short.push('…');
    }
    short
}

fn printable(letter: char) -> impl Iterator<Item = char> {
    let escaped = letter.is_control().then(|| letter.escape_default());
    let plain = (!letter.is_control()).then_some(letter);
    escaped.into_iter().flatten().chain(plain)
}

/// Whether `pattern`, with `*` for any characters and `?` for one, matches the whole of `name`.
pub fn matches(pattern: &str, name: &str) -> bool {
    let pattern: Vec<char> = pattern.chars().collect();
    let name: Vec<char> = name.chars().collect();
    let (mut p, mut n) = (0, 0);
    let mut star: Option<(usize, usize)> = None;
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, n));
                p += 1;
            }
            Some(&letter) if letter == '?' || letter == name[n] => {
                p += 1;
                n += 1;
            }
            _ => match star {
                // The last star takes one character more.
                Some((at, taken)) => {
                    star = Some((at, taken + 1));
                    p = at + 1;
                    n = taken + 1;
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|&it| it == '*')
}

/// Whether a rig, scale or node may be called so.
pub fn is_plain(name: &str) -> bool {
    !name.is_empty()
        && name.bytes().all(|it| it.is_ascii_lowercase() || it.is_ascii_digit() || it == b'_' || it == b'-')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_match_whole_names() {
        for (pattern, name) in [("wide-*", "wide-3"), ("*", ""), ("?-*-?", "a--b"), ("a*b*c", "a1b2b3c"), ("**", "x")] {
            assert!(matches(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [("wide-*", "ptz-wide-1"), ("?", ""), ("a*b", "abc"), ("", "a"), ("[a]", "a")] {
            assert!(!matches(pattern, name), "{pattern} {name}");
        }
    }

    #[test]
    fn likely_name_is_near() {
        let known = ["threshold", "offset", "min_area"];
        assert_eq!(likely("treshold", known), Some("threshold"));
        assert_eq!(likely("offest", known), Some("offset"));
        assert_eq!(likely("colour", known), None);
        assert_eq!(likely("detector", ["led.integrator", "led.detector"]), Some("led.detector"));
    }

    #[test]
    fn control_characters_do_not_reach_the_terminal() {
        assert_eq!(shown(&"a\u{1b}[2Jb"), "a\\u{1b}[2Jb");
    }
}
