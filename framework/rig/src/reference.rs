//! What `in` names: `node.output`, `scale.node.output`, `node[camera].output`.

use std::ops::Range;

use toml::Spanned;

use foveate_diagnostics::Span;

/// A reference, taken apart; the parts are ranges of its text.
#[derive(Debug, PartialEq)]
pub(super) struct Reference {
    pub scale: Option<Range<usize>>,
    pub node: Range<usize>,
    pub camera: Option<Range<usize>>,
    pub output: Range<usize>,
}

impl Reference {
    /// `None` when `text` has another form.
    pub fn parse(text: &str) -> Option<Self> {
        let (path, camera, output) = match text.find('[') {
            Some(open) => {
                let close = text.rfind(']').filter(|it| *it > open)?;
                let output = text.get(close + 1..)?.strip_prefix('.')?;
                (0..open, Some(open + 1..close), text.len() - output.len()..text.len())
            }
            None => {
                let dot = text.rfind('.')?;
                (0..dot, None, dot + 1..text.len())
            }
        };
        let (scale, node) = match text[path.clone()].find('.') {
            Some(dot) => (Some(0..dot), dot + 1..path.end),
            None => (None, path),
        };
        let parts = [Some(&node), Some(&output), scale.as_ref(), camera.as_ref()];
        let complete = parts.into_iter().flatten().all(|it| !it.is_empty());
        let simple = !text[node.clone()].contains('.') && !text[output.clone()].contains('.');
        (complete && simple).then_some(Self { scale, node, camera, output })
    }
}

/// Where a part of a text stands in the rig; the whole text where it is written with escapes.
pub(super) fn place_of_part(rig: &str, text: &Spanned<String>, part: &Range<usize>) -> Span {
    let whole = text.span();
    let quoted = rig.get(whole.start + 1..whole.end.saturating_sub(1));
    if quoted == Some(text.get_ref().as_str()) {
        whole.start + 1 + part.start..whole.start + 1 + part.end
    } else {
        whole
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn forms_are_told_apart() {
        let parts = |text: &str| {
            let it = Reference::parse(text)?;
            let part = |range: Range<usize>| text[range].to_owned();
            Some((it.scale.map(part), part(it.node), it.camera.map(part), part(it.output)))
        };
        let owned = |it: &str| Some(it.to_owned());
        assert_eq!(parts("a.b"), Some((None, "a".into(), None, "b".into())));
        assert_eq!(parts("s.a.b"), Some((owned("s"), "a".into(), None, "b".into())));
        assert_eq!(parts("a[c.1].b"), Some((None, "a".into(), owned("c.1"), "b".into())));
        assert_eq!(parts("s.a[c].b"), Some((owned("s"), "a".into(), owned("c"), "b".into())));
        for bad in
            ["", "a", ".", "a.", ".b", "s.a.b.c", "a[].b", "a[c]b", "a[c].", "[c].b", "a]c[.b", "a[c].b.d", "s..b"]
        {
            assert_eq!(parts(bad), None, "{bad}");
        }
    }
}
