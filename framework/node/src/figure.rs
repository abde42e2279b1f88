//! Figures that a node type declares, as it declares its ports: name, unit, which values are better, and one line.

/// The figures of a node type, in the order in which people read them.
pub type Figures = &'static [FigureSpec];

/// Which values of a figure are better.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Better {
    /// The lower the better, such as an error.
    Low,
    /// The higher the better, such as a completeness.
    High,
    /// Neither: it says how much there was, or where something is.
    Neither,
}

impl Better {
    /// `low`, `high` or `neither`.
    pub const fn name(self) -> &'static str {
        match self {
            Better::Low => "low",
            Better::High => "high",
            Better::Neither => "neither",
        }
    }
}

/// One figure of a node type, or several that differ in a part of their names.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FigureSpec {
    /// Dotted name. `*` matches a part that is known at run time only, such as a camera's name (one character or more), `{median,p95}` for one
    /// of these, `(…)` for a part that may be missing; these do not nest, but for `*` inside `(…)`.
    pub name: &'static str,
    /// Unit of the value, such as `mm`; for what has none, `count`, `share` (0 to 1), `ratio` (any other) or `sigmas` (stated standard deviations).
    pub unit: &'static str,
    /// Which values are better.
    pub better: Better,
    /// One line: what is counted, over what, and what is left out.
    pub line: &'static str,
    /// A few words for the end of a run, where the figure is one of those that a person reads first.
    pub headline: Option<&'static str>,
}

/// Units of what has no dimension.
const PURE: [&str; 4] = ["count", "share", "ratio", "sigmas"];

/// Ends of names that are units, and these units.
const IN_NAMES: [(&str, &str); 11] = [
    ("_mm", "mm"),
    ("_m", "m"),
    ("_px", "px"),
    ("_deg", "deg"),
    ("_mrad", "mrad"),
    ("_ms", "ms"),
    ("_s", "s"),
    ("_hz", "Hz"),
    ("_ppm", "ppm"),
    ("_sigmas", "sigmas"),
    ("_bytes", "bytes"),
];

impl FigureSpec {
    /// All declared names, with `{…}` and `(…)` expanded and `*` kept.
    pub fn names(&self) -> Vec<String> {
        expand(self.name).unwrap_or_default()
    }

    /// Whether it declares the figure of that name.
    pub fn declares(&self, figure: &str) -> bool {
        expand(self.name).is_ok_and(|patterns| patterns.iter().any(|it| fits(it.as_bytes(), figure.as_bytes())))
    }

    /// The unit, or `None` for what has no dimension.
    pub fn dimension(&self) -> Option<&'static str> {
        (!PURE.contains(&self.unit)).then_some(self.unit)
    }

    /// The unit to be shown beside `figure`: `None` where its name says it already, or where it has no dimension.
    pub fn unit_beside(&self, figure: &str) -> Option<&'static str> {
        let is_said = figure.split('.').any(|part| IN_NAMES.iter().any(|it| it.1 == self.unit && part.ends_with(it.0)));
        (!is_said && !PURE.contains(&self.unit)).then_some(self.unit)
    }

    /// What is wrong with the declaration by itself.
    fn fault(&self) -> Option<String> {
        let patterns = match expand(self.name) {
            Ok(patterns) => patterns,
            Err(fault) => return Some(fault),
        };
        if let Some(empty) = patterns.iter().find(|it| !it.contains(|c: char| c.is_ascii_alphabetic())) {
            return Some(format!("`{empty}` has no word in it, expected a name that says what is measured"));
        }
        if self.unit.is_empty() || self.unit.contains(|c: char| c.is_whitespace() || c.is_control()) {
            return Some(format!("found `{}` for its unit, expected one word", self.unit));
        }
        if self.line.trim().is_empty() || self.line.contains('\n') {
            return Some("expected one line on what is counted, over what, and what is left out".to_owned());
        }
        // How many values a quantity was taken over has not the quantity's unit.
        let parts = patterns.iter().filter(|it| !it.ends_with(".count")).flat_map(|it| it.split('.'));
        let told = parts.filter_map(|part| IN_NAMES.iter().find(|it| part.ends_with(it.0)).map(|it| it.1));
        let other = told.into_iter().find(|it| *it != self.unit)?;
        Some(format!("its name says `{other}` and its unit is `{}`, expected the same", self.unit))
    }
}

/// The declaration of a figure; the first one where several fit.
pub fn find(figures: Figures, name: &str) -> Option<&'static FigureSpec> {
    figures.iter().find(|it| it.declares(name))
}

/// Checks declarations of figures.
///
/// # Errors
/// A sentence that names the figure: a name that cannot be read, a unit or a line that is missing, a name that says another unit, a figure that two declare.
pub fn check(figures: Figures) -> Result<(), String> {
    for (place, it) in figures.iter().enumerate() {
        if let Some(fault) = it.fault() {
            return Err(format!("figure `{}`: {fault}", it.name));
        }
        for other in &figures[..place] {
            // A `*` in a name is fitted by a `*` alone: names that only a strange camera name makes the same are two.
            let is_one_of =
                |a: &FigureSpec, b: &FigureSpec| expand(a.name).is_ok_and(|it| it.iter().any(|name| b.declares(name)));
            if is_one_of(it, other) || is_one_of(other, it) {
                return Err(format!("figure `{}` is declared by `{}` already", it.name, other.name));
            }
        }
    }
    Ok(())
}

/// All names that `name` describes, with `*` left in them.
fn expand(name: &str) -> Result<Vec<String>, String> {
    let mut names = vec![String::new()];
    let mut rest = name;
    while let Some(c) = rest.chars().next() {
        let (choices, after): (Vec<&str>, &str) = match c {
            '{' => {
                let (inner, after) = rest[1..].split_once('}').ok_or_else(|| format!("`{name}` lacks a `}}`"))?;
                (inner.split(',').collect(), after)
            }
            '(' => {
                let (inner, after) = rest[1..].split_once(')').ok_or_else(|| format!("`{name}` lacks a `)`"))?;
                (vec!["", inner], after)
            }
            _ => (vec![&rest[..c.len_utf8()]], &rest[c.len_utf8()..]),
        };
        let is_group = matches!(c, '{' | '(');
        for (place, choice) in choices.iter().enumerate() {
            let may_be_empty = c == '(' && place == 0;
            if choice.is_empty() && !may_be_empty {
                return Err(format!("`{name}` has an empty part"));
            }
            let is_allowed = |it: char| {
                it.is_ascii_alphanumeric() || matches!(it, '_' | '-' | '.' | '[' | ']') || (it == '*' && c != '{')
            };
            if let Some(found) = choice.chars().find(|it| !is_allowed(*it)) {
                let within = if is_group { " inside brackets" } else { "" };
                return Err(format!(
                    "found `{found}`{within} in `{name}`, expected letters, digits, `_`, `-`, `.`, `[`, `]`, and `*`, `{{…}}`, `(…)`"
                ));
            }
        }
        names = names.iter().flat_map(|it| choices.iter().map(move |choice| format!("{it}{choice}"))).collect();
        rest = after;
    }
    match names.iter().find(|it| it.is_empty() || it.contains("**") || it.split('.').any(str::is_empty)) {
        Some(found) => {
            Err(format!("`{name}` means `{found}`, expected words between dots, and no two `*` side by side"))
        }
        None => Ok(names),
    }
}

/// Whether `text` is what `pattern` says, with one byte or more for each `*`. Goes back to the last `*` only, which is enough: what an earlier one
/// took longer, the later one can take.
fn fits(pattern: &[u8], text: &[u8]) -> bool {
    let (mut p, mut t) = (0, 0);
    let mut star: Option<(usize, usize)> = None;
    while t < text.len() {
        if pattern.get(p) == Some(&b'*') {
            star = Some((p + 1, t + 1));
            (p, t) = (p + 1, t + 1);
        } else if pattern.get(p) == Some(&text[t]) {
            (p, t) = (p + 1, t + 1);
        } else if let Some((after, taken)) = star.filter(|it| it.1 < text.len()) {
            star = Some((after, taken + 1));
            (p, t) = (after, taken + 1);
        } else {
            return false;
        }
    }
    p == pattern.len()
}

/// Declares the figures of a node, next to its [`ports!`](crate::ports): a constant `DECLARED_FIGURES`, which
/// [`Node::FIGURES`](crate::Node::FIGURES) gives back. Each has a name, a unit, `low`, `high` or `neither` for what is better, and one line: what is
/// counted, over what, and what is left out. Units that are no word stand in quotes.
///
/// ```
/// foveate_node::figures! {
///     "error_mm.{median,p95}": mm, low, "Distance of a target from its light, over all matched targets";
///     "detector.features.*": count, neither, "Features found, of each camera";
/// }
///
/// assert_eq!(DECLARED_FIGURES[0].unit, "mm");
/// assert!(DECLARED_FIGURES[1].declares("detector.features.wide-1"));
/// assert_eq!(foveate_node::figure::check(DECLARED_FIGURES), Ok(()));
/// ```
///
/// What several nodes share is declared with `pub(crate) const NAME;` before the figures: the name of the constant in place of `DECLARED_FIGURES`.
#[macro_export]
macro_rules! figures {
    (@unit $unit:literal) => { $unit };
    (@unit $unit:ident) => { stringify!($unit) };
    (@better low) => { $crate::figure::Better::Low };
    (@better high) => { $crate::figure::Better::High };
    (@better neither) => { $crate::figure::Better::Neither };
    (@headline) => { None };
    (@headline $headline:literal) => { Some($headline) };
    ($scope:vis const $all:ident; $($name:literal: $unit:tt, $better:ident, $line:literal $(=> $headline:literal)?;)*) => {
        /// The figures, in the order of their declarations.
        $scope const $all: $crate::Figures = &[$($crate::figure::FigureSpec {
            name: $name,
            unit: $crate::figures!(@unit $unit),
            better: $crate::figures!(@better $better),
            line: $line,
            headline: $crate::figures!(@headline $($headline)?),
        }),*];
    };
    // With the first name, so that a mistake is reported where it is and does not come here again.
    ($first:literal: $($figures:tt)*) => {
        $crate::figures!(const DECLARED_FIGURES; $first: $($figures)*);
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn spec(name: &'static str, unit: &'static str) -> FigureSpec {
        FigureSpec { name, unit, better: Better::Low, line: "What is counted", headline: None }
    }

    fn all<const N: usize>(specs: [FigureSpec; N]) -> Figures {
        Box::leak(Box::new(specs))
    }

    #[track_caller]
    fn declares(name: &'static str, yes: &[&str], no: &[&str]) {
        for figure in yes {
            assert!(spec(name, "count").declares(figure), "`{name}` declares `{figure}`");
        }
        for figure in no {
            assert!(!spec(name, "count").declares(figure), "`{name}` does not declare `{figure}`");
        }
    }

    #[test]
    fn names_stand_for_what_they_say_and_nothing_else() {
        declares("samples", &["samples"], &["sample", "samples.x", "a.samples", ""]);
        declares("gate.*", &["gate.wide-1", "gate.a.b", "gate.*"], &["gate.", "gate", "gates.a"]);
        declares(
            "heads.*.sent",
            &["heads.a.sent", "heads.sent.sent", "heads.a.sent.sent"],
            &["heads..sentx", "heads.sent", "heads..sent"],
        );
        declares("e.{median,p95}", &["e.median", "e.p95"], &["e.max", "e.median.p95", "e.", "e.medianp95"]);
        declares("(*.)missed", &["missed", "whole.missed"], &[".missed", "wholemissed", "missed.x"]);
        declares("in_view([*])", &["in_view", "in_view[wide-1]"], &["in_view[]", "in_view[wide-1", "in_view.wide-1"]);
        declares("*.{a,b}(.*)", &["x.a", "x.b.c"], &["a", "x.c", ".a"]);
    }

    #[test]
    fn malformed_declarations_are_refused_with_what_was_found() {
        let cases: &[(&str, &str, &str)] = &[
            ("", "mm", "``"),
            ("*", "mm", "no word"),
            ("(*.)*", "mm", "no word"),
            ("a b", "mm", "` `"),
            ("a{b", "mm", "lacks a `}`"),
            ("a(b", "mm", "lacks a `)`"),
            ("a}b", "mm", "`}`"),
            ("a{b,}", "mm", "empty part"),
            ("a()", "mm", "empty part"),
            ("a(b(c))", "mm", "`(`"),
            ("a{*,b}", "mm", "`*`"),
            ("a**", "mm", "side by side"),
            ("a..b", "mm", "between dots"),
            (".a", "mm", "between dots"),
            ("größe", "mm", "`ö`"),
            ("error", "", "unit"),
            ("error", "m m", "one word"),
            ("error_mm", "px", "says `mm`"),
            ("error_mm.{median,max}(.*)", "m", "says `mm`"),
            ("latency_ms.mean", "s", "says `ms`"),
        ];
        for &(name, unit, word) in cases {
            let list = all([spec(name, unit)]);
            let fault = check(list).expect_err(name);
            assert!(fault.contains(word) && fault.contains(name), "`{name}` [{unit}]: {fault}");
        }
        let silent = all([FigureSpec { line: " ", ..spec("a", "mm") }]);
        assert!(check(silent).is_err_and(|it| it.contains("one line")));
        let long = all([FigureSpec { line: "a\nb", ..spec("a", "mm") }]);
        assert!(check(long).is_err_and(|it| it.contains("one line")));
    }

    #[test]
    fn a_figure_is_declared_once() {
        #[track_caller]
        fn twice(a: &'static str, b: &'static str) {
            for (a, b) in [(a, b), (b, a)] {
                let list = all([spec(a, "count"), spec(b, "count")]);
                assert!(check(list).is_err_and(|it| it.contains(a) && it.contains(b)), "{a} and {b}");
            }
        }
        twice("a", "a");
        twice("a.*", "a.*");
        twice("a.*", "a.b");
        twice("e.{median,p95}", "e.p95");
        twice("(*.)missed", "missed");
        twice("(*.)missed", "whole.missed");
        let apart = all([
            spec("marks.frames", "count"),
            spec("marks.pose.*", "count"),
            spec("e(.*)", "count"),
            spec("e.{b,c}.d.*", "count"),
        ]);
        assert!(check(apart).is_err(), "`e.*` declares `e.b.d.*`");
        assert_eq!(check(&apart[..3]), Ok(()));
        let labelled = all([spec("(*.)marks.frames", "count"), spec("(*.)marks.pose.*", "count")]);
        assert_eq!(check(labelled), Ok(()), "a camera called `marks.frames` makes no two of them one");
    }

    #[test]
    fn a_unit_stands_beside_a_figure_whose_name_does_not_say_it() {
        let unit = |unit: &'static str, figure: &str| spec("a", unit).unit_beside(figure);
        assert_eq!(unit("mm", "whole.error_mm.median"), None);
        assert_eq!(unit("m", "drone.median"), Some("m"));
        assert_eq!(unit("m", "error_mm.median"), Some("m"), "another unit is not said");
        assert_eq!(unit("s", "motions"), Some("s"), "an end of a word is no unit");
        assert_eq!(unit("Hz", "v4l.rate_hz.wide-1"), None);
        for pure in PURE {
            assert_eq!(unit(pure, "identities"), None);
        }
    }
}
