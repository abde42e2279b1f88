//! Values that several of a rig's tables hold: names and points.

use toml::Spanned;

use foveate_diagnostics::Findings;
use foveate_diagnostics::names::{is_plain, shown};
use foveate_diagnostics::value::Value;

/// What a scale's, node's or rig's name looks like.
const PLAIN: &str = "lower-case letters, digits, `_` and `-`";

/// Refuses a name that is not plain.
pub(super) fn plain_name(what: &str, name: &Spanned<String>, findings: &mut Findings) {
    if !is_plain(name.get_ref()) {
        let title = format!("a {what} cannot be named `{}`", shown(name.get_ref()));
        findings.error(name.span(), title, format_args!("expected {PLAIN}"));
    }
}

/// Three numbers [m].
pub(super) fn read_point(key: &str, value: &Value<'_>, findings: &mut Findings) -> Option<[f64; 3]> {
    let expected = "three numbers [m]";
    let items = value.get_ref().as_array().filter(|it| it.len() == 3);
    let Some(items) = items else {
        findings.not_as_expected(key, value, expected);
        return None;
    };
    let mut point = [None; 3];
    for (number, item) in point.iter_mut().zip(items) {
        *number = findings.number(key, item, "a number [m]", f64::is_finite);
    }
    Some([point[0]?, point[1]?, point[2]?])
}
