//! The section on what was recovered: figures, pictures, tables, other files.

use std::fs::File;
use std::io::{BufRead, BufReader};
use std::path::Path;

use crate::folder::{Entry, Folder};
use crate::page::{Html, Page, Table};
use crate::pictures::{self, Budget};
use crate::{figures, uncertainty, words};

/// Writes the section.
pub(crate) fn write(page: &mut Page, folder: &Folder, budget: &mut Budget) {
    page.section("recovered", "What was recovered");
    match &folder.summary {
        Err(sentence) => page.missing(sentence),
        Ok(summary) => {
            page.note(
                "A star means any camera. `foveate figures NAME` says what a figure counts. Figures of stated uncertainty are in the next section.",
            );
            if !figures::write(page, "Figures", summary, &folder.context(), |it| !uncertainty::is_sigma(it)) {
                page.missing("`summary.json` holds no figure.");
            }
        }
    }
    show_pictures(page, folder, budget);
    list_files(page, folder);
}

fn show_pictures(page: &mut Page, folder: &Folder, budget: &mut Budget) {
    let mut left_out = Vec::new();
    let mut shown = String::new();
    let mut entries: Vec<&Entry> = folder.files.iter().filter(|it| pictures::is_picture(it)).collect();
    entries.sort_by_key(|it| !pictures::is_drawing(it));
    for entry in entries {
        match budget.picture(entry) {
            Ok(picture) => shown += picture.figure(&caption(&entry.name), &entry.name).as_str(),
            Err(sentence) => left_out.push(Html::prose(&sentence)),
        }
    }
    if !shown.is_empty() {
        page.heading("Pictures");
        page.html(&Html::markup(format!("<div class=\"pictures\">{shown}</div>")));
    }
    if !left_out.is_empty() {
        page.missing(&format!("Left out of this page: {}.", words::so_many(left_out.len(), "picture")));
        page.list(&left_out);
    }
}

/// `overlay/wide-1_000060.png` is "overlay: wide-1 000060".
fn caption(name: &str) -> String {
    let stem = name.rsplit_once('.').map_or(name, |it| it.0);
    stem.replace('_', " ").replace('/', ": ")
}

fn list_files(page: &mut Page, folder: &Folder) {
    let mut tables = Table::new("Tables", &[("table", false), ("rows", true), ("size", true), ("columns", false)]);
    let mut others = Table::new("Other files", &[("file", false), ("size", true), ("what it is", false)]);
    for entry in folder.files.iter().filter(|it| !pictures::is_picture(it)) {
        let (name, size) = (Html::name(&entry.name), Html::text(&words::size(entry.bytes)));
        if entry.extension() == "csv" {
            let (rows, columns) = match rows(&entry.path) {
                Ok((rows, columns)) => (foveate_plot::text::count(rows), columns),
                Err(error) => ("–".to_owned(), format!("cannot be read: {error}")),
            };
            tables.row(&[name, Html::text(&rows), size, Html::name(&columns)]);
        } else {
            others.row(&[name, size, Html::text(kind(entry))]);
        }
    }
    if !(tables.is_empty() && others.is_empty()) {
        page.heading("Files");
    }
    page.table(&tables);
    page.table(&others);
    folder.unlisted.iter().for_each(|it| page.missing(it));
    if folder.files.is_empty() {
        page.paragraph("The nodes of this rig wrote no files.");
    }
}

/// Rows below the heads of a table, and the heads. Lines that are empty or comments do not count.
fn rows(path: &Path) -> std::io::Result<(usize, String)> {
    let mut reader = BufReader::new(File::open(path)?);
    let (mut line, mut heads, mut n_rows) = (Vec::new(), None, 0);
    while reader.read_until(b'\n', &mut line)? > 0 {
        let content = line.trim_ascii();
        if !content.is_empty() && !content.starts_with(b"#") {
            match heads {
                None => heads = Some(String::from_utf8_lossy(content).chars().take(400).collect::<String>()),
                Some(_) => n_rows += 1,
            }
        }
        line.clear();
    }
    let heads = heads.unwrap_or_default();
    Ok((n_rows, heads.split(',').map(str::trim).collect::<Vec<_>>().join(", ")))
}

/// What a file is by the end of its name.
fn kind(entry: &Entry) -> &'static str {
    match entry.extension().as_str() {
        "c3d" => "motion, for programs of motion analysis",
        "trc" => "motion of points (TRC)",
        "bvh" => "motion of a skeleton (BVH)",
        "glb" | "gltf" => "motion in space (glTF), for Blender and browsers",
        "ply" => "points or a surface (PLY)",
        "obj" | "stl" => "a surface",
        "npy" | "npz" => "arrays for NumPy",
        "toml" if entry.name.ends_with(".calibration.toml") => "a calibration",
        "toml" => "settings or a model (TOML)",
        "json" => "values (JSON)",
        "html" => "a page",
        "mp4" | "avi" | "mkv" => "a video",
        _ => "",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_counted_without_heads_comments_and_empty_lines() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("a.csv");
        for (text, expected) in [
            ("time_s,x\n1,2\n3,4\n", (2, "time_s, x")),
            ("# by hand\ntime_s,x\n1,2\n\n3,4", (2, "time_s, x")),
            ("time_s\n", (0, "time_s")),
            ("", (0, "")),
        ] {
            std::fs::write(&path, text).unwrap();
            assert_eq!(rows(&path).unwrap(), (expected.0, expected.1.to_owned()), "{text:?}");
        }
    }

    #[test]
    fn captions_are_words() {
        assert_eq!(caption("path_top.svg"), "path top");
        assert_eq!(caption("overlay/wide-1_000060.png"), "overlay: wide-1 000060");
    }
}
