//! Escaped HTML, tables and the frame of the page.

use std::fmt::Write as _;

use foveate_plot::text::escaped;

const STYLE: &str = include_str!("style.css");
/// Marks a page of this crate, so that the next page does not list it among the results.
pub(crate) const MARKER: &str = "<meta name=\"generator\" content=\"foveate report\">";

/// HTML whose texts are escaped.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub(crate) struct Html(String);

impl Html {
    /// Escapes `text`.
    pub(crate) fn text(text: &str) -> Self {
        Self(escaped(text))
    }

    /// A text that does not break into lines.
    pub(crate) fn whole(text: &str) -> Self {
        Self(format!("<span class=\"u\">{}</span>", escaped(text)))
    }

    /// Sentences, in which a name between backticks is shown as one.
    pub(crate) fn prose(text: &str) -> Self {
        let text = escaped(text);
        let n_marks = text.matches('`').count();
        let mut html = String::new();
        for (index, part) in text.split('`').enumerate() {
            // Every second part is a name; the last mark of an odd number is a letter.
            html += match index {
                0 => "",
                _ if index == n_marks && index % 2 == 1 => "`",
                _ if index % 2 == 1 => "<code>",
                _ => "</code>",
            };
            html += part;
        }
        Self(html)
    }

    /// A name that may break into lines behind its dots, underscores and slashes.
    pub(crate) fn name(text: &str) -> Self {
        // No character that escaping adds is one of these.
        Self(escaped(text).replace('.', ".<wbr>").replace('_', "_<wbr>").replace('/', "/<wbr>"))
    }

    /// Text as in a terminal or a file.
    pub(crate) fn code(text: &str) -> Self {
        Self(format!("<code>{}</code>", Self::name(text).0))
    }

    /// Markup that is written in this crate. Never for what a file says.
    pub(crate) fn markup(markup: String) -> Self {
        Self(markup)
    }

    /// This, and `other` behind it.
    pub(crate) fn then(mut self, other: &Html) -> Self {
        self.0 += &other.0;
        self
    }

    pub(crate) fn as_str(&self) -> &str {
        &self.0
    }
}

/// A column of a table: its head, and whether it holds numbers.
pub(crate) type Column = (&'static str, bool);

/// A table with a caption; the first cell of each row is its head.
pub(crate) struct Table {
    caption: String,
    columns: Vec<Column>,
    bodies: String,
    n_rows: usize,
}

impl Table {
    pub(crate) fn new(caption: &str, columns: &[Column]) -> Self {
        Self { caption: caption.to_owned(), columns: columns.to_vec(), bodies: "<tbody>".to_owned(), n_rows: 0 }
    }

    /// Begins a group of rows with a line of its own.
    pub(crate) fn group(&mut self, title: &str) {
        let n_columns = self.columns.len();
        let start = if self.n_rows == 0 { "" } else { "</tbody>\n<tbody>" };
        // Writing to a String cannot fail, here and below.
        let _ = writeln!(
            self.bodies,
            "{start}<tr class=\"group\"><th colspan=\"{n_columns}\" scope=\"rowgroup\">{}</th></tr>",
            escaped(title)
        );
    }

    pub(crate) fn row(&mut self, cells: &[Html]) {
        self.n_rows += 1;
        self.bodies += "<tr>";
        for (index, (cell, column)) in cells.iter().zip(&self.columns).enumerate() {
            let class = if column.1 { " class=\"n\"" } else { "" };
            let _ = match index {
                0 => write!(self.bodies, "<th scope=\"row\">{}</th>", cell.0),
                _ => write!(self.bodies, "<td{class}>{}</td>", cell.0),
            };
        }
        self.bodies += "</tr>\n";
    }

    pub(crate) fn is_empty(&self) -> bool {
        self.n_rows == 0
    }

    fn html(&self) -> String {
        let caption = escaped(&self.caption);
        let heads: String = self
            .columns
            .iter()
            .map(|(head, is_number)| {
                format!("<th scope=\"col\"{}>{}</th>", if *is_number { " class=\"n\"" } else { "" }, escaped(head))
            })
            .collect();
        // The box of a wide table scrolls, and so must be reachable by keys.
        format!(
            "<div class=\"wide\" role=\"region\" tabindex=\"0\" aria-label=\"{caption}\"><table><caption>{caption}</caption>\n\
             <thead><tr>{heads}</tr></thead>\n{}</tbody></table></div>\n",
            self.bodies
        )
    }
}

/// The page as it grows.
pub(crate) struct Page {
    title: Html,
    facts: Vec<(String, String)>,
    contents: Vec<(&'static str, &'static str)>,
    text: String,
}

impl Page {
    /// Begins a page with facts, name and value, below its title.
    pub(crate) fn new(title: &str, facts: &[(String, String)]) -> Self {
        Self { title: Html::text(title), facts: facts.to_vec(), contents: Vec::new(), text: String::new() }
    }

    /// Begins a section.
    pub(crate) fn section(&mut self, id: &'static str, title: &'static str) {
        if !self.contents.is_empty() {
            self.text += "</section>\n";
        }
        self.contents.push((id, title));
        let _ = writeln!(
            self.text,
            "<section id=\"{id}\" aria-labelledby=\"{id}-title\"><h2 id=\"{id}-title\">{title}</h2>"
        );
    }

    /// A heading inside a section.
    pub(crate) fn heading(&mut self, title: &str) {
        let _ = writeln!(self.text, "<h3>{}</h3>", escaped(title));
    }

    /// A paragraph.
    pub(crate) fn paragraph(&mut self, text: &str) {
        let _ = writeln!(self.text, "<p>{}</p>", Html::prose(text).0);
    }

    /// A paragraph that says how to read what is near it.
    pub(crate) fn note(&mut self, text: &str) {
        let _ = writeln!(self.text, "<p class=\"note\">{}</p>", Html::prose(text).0);
    }

    /// A paragraph on what is missing, damaged or left out.
    pub(crate) fn missing(&mut self, text: &str) {
        let _ = writeln!(self.text, "<p class=\"missing\">{}</p>", Html::prose(text).0);
    }

    /// A verdict: good news or bad.
    pub(crate) fn verdict(&mut self, is_good: bool, text: &str) {
        let (class, sign) = if is_good { ("good", "✓") } else { ("bad", "▲") };
        let _ = writeln!(
            self.text,
            "<p class=\"verdict {class}\"><span aria-hidden=\"true\">{sign}</span> {}</p>",
            escaped(text)
        );
    }

    /// A table, unless it has no row.
    pub(crate) fn table(&mut self, table: &Table) {
        if !table.is_empty() {
            self.text += &table.html();
        }
    }

    /// A list of entries.
    pub(crate) fn list(&mut self, entries: &[Html]) {
        let entries: String = entries.iter().map(|it| format!("<li>{}</li>\n", it.0)).collect();
        let _ = writeln!(self.text, "<ul>\n{entries}</ul>");
    }

    /// Lines as in a terminal.
    pub(crate) fn terminal(&mut self, lines: &str) {
        let lines: Vec<String> = lines.lines().map(escaped).collect();
        let _ = writeln!(self.text, "<pre>{}</pre>", lines.join("\n"));
    }

    pub(crate) fn html(&mut self, html: &Html) {
        self.text += &html.0;
        self.text.push('\n');
    }

    pub(crate) fn finish(self) -> String {
        let Page { title: Html(title), facts, contents, text } = self;
        let links: String =
            contents.iter().map(|(id, title)| format!("<li><a href=\"#{id}\">{title}</a></li>")).collect();
        let facts: String = facts
            .iter()
            .map(|(name, value)| format!("<div><dt>{}</dt><dd>{}</dd></div>", escaped(name), escaped(value)))
            .collect();
        // What a file says cannot load or run anything, even if some of it were not escaped.
        let policy = "default-src 'none'; img-src data:; style-src 'unsafe-inline'";
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n{MARKER}\n\
             <meta http-equiv=\"Content-Security-Policy\" content=\"{policy}\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n<title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <header><h1>{title}</h1><dl class=\"facts\">{facts}</dl>\n<nav aria-label=\"Sections\"><ul>{links}</ul></nav></header>\n\
             <main>\n{text}</section>\n</main>\n</body>\n</html>\n"
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_file_says_is_escaped_everywhere() {
        let bad = "<script>alert(1)</script>\"'&";
        let mut page = Page::new(bad, &[(bad.to_owned(), bad.to_owned())]);
        page.section("a", "A");
        page.heading(bad);
        page.paragraph(bad);
        page.note(bad);
        page.missing(bad);
        page.verdict(false, bad);
        page.terminal(bad);
        page.list(&[Html::text(bad), Html::code(bad), Html::name(bad)]);
        let mut table = Table::new(bad, &[("one", false), ("two", true)]);
        table.group(bad);
        table.row(&[Html::text(bad), Html::name(bad)]);
        page.table(&table);
        let page = page.finish();
        assert!(!page.contains("<script"), "{page}");
        assert_eq!(page.matches("&lt;script&gt;").count(), 18, "{page}");
    }

    #[test]
    fn names_between_backticks_are_code_and_a_single_backtick_is_a_letter() {
        let of = |text: &str| Html::prose(text).0;
        assert_eq!(of("`a<b` and `c`"), "<code>a&lt;b</code> and <code>c</code>");
        assert_eq!([of("no"), of("5` long"), of("`a` 5`")], ["no", "5` long", "<code>a</code> 5`"]);
    }

    #[test]
    fn a_row_has_its_head_and_numbers_are_marked() {
        let mut table = Table::new("lengths", &[("name", false), ("mm", true)]);
        assert!(table.is_empty());
        table.row(&[Html::name("a.b"), Html::text("2")]);
        assert!(
            table.html().contains("<tr><th scope=\"row\">a.<wbr>b</th><td class=\"n\">2</td></tr>"),
            "{}",
            table.html()
        );
        assert!(table.html().contains("<th scope=\"col\" class=\"n\">mm</th>"));
    }
}
