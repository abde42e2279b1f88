//! Pictures as data URIs, within limits.
//!
//! An SVG stands in an `img` element: browsers run no script in it, load nothing for it, and keep its ids apart from those of the page.

use std::fs;

use foveate_plot::text::escaped;

use crate::folder::{Entry, Found};
use crate::page::Html;
use crate::words;

/// A picture with more bytes is named and left out.
pub(crate) const PICTURE_BYTES_MAX: u64 = 4_000_000;
/// All pictures of a page have at most so many bytes; the page is a third larger than they are.
pub(crate) const ALL_BYTES_MAX: u64 = 40_000_000;

/// How many bytes of pictures are in the page.
#[derive(Debug, Default)]
pub(crate) struct Budget {
    used: u64,
}

/// A picture that can stand in the page.
pub(crate) struct Picture {
    uri: String,
    is_drawing: bool,
    /// Width and height [px], where the file says them.
    size: Option<[f64; 2]>,
}

/// Kinds of pictures: the end of the name, and the type in a data URI.
const KINDS: [(&str, &str); 4] =
    [("svg", "image/svg+xml"), ("png", "image/png"), ("jpg", "image/jpeg"), ("jpeg", "image/jpeg")];

/// Whether a file is a picture by its name.
pub(crate) fn is_picture(entry: &Entry) -> bool {
    KINDS.iter().any(|it| it.0 == entry.extension())
}

/// Whether a picture is drawn, not taken by a camera.
pub(crate) fn is_drawing(entry: &Entry) -> bool {
    entry.extension() == "svg"
}

impl Budget {
    /// Reads a picture.
    ///
    /// # Errors
    /// A sentence when it is too large, damaged, or no file at all.
    pub(crate) fn picture(&mut self, entry: &Entry) -> Found<Picture> {
        let (name, bytes) = (&entry.name, entry.bytes);
        if bytes > PICTURE_BYTES_MAX {
            let most = words::size(PICTURE_BYTES_MAX);
            return Err(format!("`{name}` has {}, more than the {most} of one picture.", words::size(bytes)));
        }
        if self.used + bytes > ALL_BYTES_MAX {
            let most = words::size(ALL_BYTES_MAX);
            return Err(format!(
                "`{name}` has {}; all pictures together would have more than {most}.",
                words::size(bytes)
            ));
        }
        let content = fs::read(&entry.path).map_err(|error| format!("`{name}` cannot be read: {error}."))?;
        let extension = entry.extension();
        let kind = KINDS.iter().find(|it| it.0 == extension).map_or("", |it| it.1);
        let size = match kind {
            "image/svg+xml" => of_svg(&content),
            "image/png" => of_png(&content),
            _ => of_jpeg(&content),
        };
        let size = size.map_err(|what| format!("`{name}` is damaged: {what}."))?;
        self.used += bytes;
        Ok(Picture { uri: format!("data:{kind};base64,{}", base64(&content)), is_drawing: is_drawing(entry), size })
    }
}

impl Picture {
    /// A figure with a caption and the name of its file. A drawing takes a line of the page for itself, so that its letters can be read.
    pub(crate) fn figure(&self, caption: &str, name: &str) -> Html {
        let class = if self.is_drawing { " class=\"whole\"" } else { "" };
        let (caption, name) = (escaped(caption), Html::code(name));
        Html::markup(format!(
            "<figure{class}>{}<figcaption>{caption} · {}</figcaption></figure>",
            self.image(&caption),
            name.as_str()
        ))
    }

    /// A figure that can be looked at in its own size, without a script.
    pub(crate) fn figure_that_grows(&self, id: &'static str, caption: &str) -> Html {
        Html::markup(format!(
            "<figure class=\"grows\"><input type=\"checkbox\" id=\"{id}\"><label for=\"{id}\"> in its own size</label>\
             <div class=\"wide\" role=\"region\" tabindex=\"0\" aria-label=\"{caption}\">{}</div><figcaption>{caption}</figcaption></figure>",
            self.image(&escaped(caption)),
            caption = escaped(caption),
        ))
    }

    /// `alternative` is escaped.
    fn image(&self, alternative: &str) -> String {
        let size = self.size.map_or(String::new(), |[width, height]| {
            format!(" width=\"{}\" height=\"{}\"", width.round(), height.round())
        });
        format!("<img src=\"{}\" alt=\"{alternative}\"{size}>", self.uri)
    }
}

/// Checks that an SVG is whole, and reads its size.
fn of_svg(content: &[u8]) -> Found<Option<[f64; 2]>> {
    let text = std::str::from_utf8(content).map_err(|_| "it is no text in UTF-8".to_owned())?;
    let start = text.find("<svg").ok_or_else(|| "it has no `svg` element".to_owned())?;
    if !text.trim_end().ends_with("</svg>") {
        return Err("its end is missing".to_owned());
    }
    let head = text[start..].split('>').next().unwrap_or_default();
    let length = |name: &str| {
        let value = head.split_once(&format!(" {name}=\""))?.1.split('"').next()?;
        value.trim_end_matches("px").parse::<f64>().ok().filter(|it| (1.0..1e5).contains(it))
    };
    Ok(length("width").zip(length("height")).map(|(width, height)| [width, height]))
}

/// Checks that a PNG is whole, and reads its size.
fn of_png(content: &[u8]) -> Found<Option<[f64; 2]>> {
    if !content.starts_with(b"\x89PNG\r\n\x1a\n") || content.get(12..16) != Some(b"IHDR") {
        return Err("it does not begin as a PNG".to_owned());
    }
    // The last chunk has a length, its name and a check sum, and nothing else.
    let tail = content.len().checked_sub(8).and_then(|at| content.get(at..at + 4));
    if tail != Some(b"IEND") {
        return Err("its end is missing".to_owned());
    }
    let length =
        |at: usize| content.get(at..at + 4).map(|it| it.iter().fold(0.0, |sum, &byte| 256.0 * sum + f64::from(byte)));
    Ok(length(16)
        .zip(length(20))
        .map(|(width, height)| [width, height])
        .filter(|it| it.iter().all(|it| (1.0..1e5).contains(it))))
}

/// Checks that a JPEG begins and ends as one; its size is left to the browser.
fn of_jpeg(content: &[u8]) -> Found<Option<[f64; 2]>> {
    let is_whole = content.starts_with(b"\xff\xd8\xff") && content.ends_with(b"\xff\xd9");
    if is_whole { Ok(None) } else { Err("it does not begin and end as a JPEG".to_owned()) }
}

/// Bytes in the letters of base 64 (RFC 4648), with `=` at the end.
fn base64(bytes: &[u8]) -> String {
    const LETTERS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut text = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for group in bytes.chunks(3) {
        let byte = |place: usize| u32::from(group.get(place).copied().unwrap_or(0));
        let bits = byte(0) << 16 | byte(1) << 8 | byte(2);
        for place in 0..4 {
            let letter = LETTERS[(bits >> (18 - 6 * place)) as usize & 63];
            text.push(if place > group.len() { '=' } else { char::from(letter) });
        }
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_is_that_of_the_standard() {
        // The cases of RFC 4648, section 10.
        let cases = [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ];
        for (bytes, text) in cases {
            assert_eq!(base64(bytes.as_bytes()), text);
        }
        assert_eq!(base64(&[0xfb, 0xff, 0xfe]), "+//+");
    }

    #[test]
    fn pictures_that_were_cut_are_damaged_and_whole_ones_say_their_size() {
        let svg = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"775.6\" height=\"720px\"><g/></svg>\n";
        assert_eq!(of_svg(svg.as_bytes()), Ok(Some([775.6, 720.0])));
        assert_eq!(of_svg(b"<?xml version=\"1.0\"?><svg viewBox=\"0 0 1 1\"></svg>"), Ok(None));
        assert!(of_svg(&svg.as_bytes()[..60]).is_err_and(|it| it.contains("end")));
        let mut png =
            b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\x02\x80\0\0\x01\xe0\x08\x02\0\0\0....\0\0\0\0IEND....".to_vec();
        assert_eq!(of_png(&png), Ok(Some([640.0, 480.0])));
        png.truncate(40);
        assert!(of_png(&png).is_err_and(|it| it.contains("end")));
        assert!(of_png(b"GIF89a").is_err_and(|it| it.contains("begin")));
        assert!(of_jpeg(b"\xff\xd8\xff\xe0").is_err());
        assert_eq!(of_jpeg(b"\xff\xd8\xff\xe0..\xff\xd9"), Ok(None));
    }

    #[test]
    fn large_pictures_are_named_and_left_out() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("a.svg");
        fs::write(&path, "<svg></svg>").unwrap();
        let entry = |bytes| Entry { name: "a.svg".to_owned(), path: path.clone(), bytes };
        let mut budget = Budget::default();
        let refused = budget.picture(&entry(PICTURE_BYTES_MAX + 1)).err();
        assert_eq!(refused.as_deref(), Some("`a.svg` has 4.0 MB, more than the 4.0 MB of one picture."));
        for _ in 0..10 {
            assert!(budget.picture(&entry(PICTURE_BYTES_MAX)).is_ok());
        }
        let refused = budget.picture(&entry(1)).err();
        assert!(refused.is_some_and(|it| it.contains("more than 40 MB")));
    }
}
