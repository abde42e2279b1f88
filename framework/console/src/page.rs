//! The files of the page.

use std::sync::Arc;

use foveate_node::page::{Page, PageFile};

const SCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! scripts {
    ($($name:literal),* $(,)?) => { [$(($name, include_str!(concat!("../page/", $name)))),*] };
}

/// One view a file.
const SCRIPTS: &[(&str, &str)] = &scripts![
    "arrange.js",
    "calibrating.js",
    "calibrating_maps.js",
    "calibrating_pairs.js",
    "camera_large.js",
    "camera_stage.js",
    "camera_tile.js",
    "cameras.js",
    "dom.js",
    "edge_table.js",
    "gl.js",
    "gl_shaders.js",
    "health.js",
    "heat.js",
    "help.js",
    "ledger.js",
    "link.js",
    "lookup.js",
    "main.js",
    "marks.js",
    "marks_draw.js",
    "marks_editor.js",
    "marks_held.js",
    "marks_list.js",
    "marks_note.js",
    "marks_rows.js",
    "masks.js",
    "matched.js",
    "node_panel.js",
    "overlay.js",
    "picture.js",
    "room.js",
    "room_data.js",
    "room_eye.js",
    "room_labels.js",
    "room_list.js",
    "room_palette.js",
    "room_style.js",
    "room_things.js",
    "room_tools.js",
    "settings.js",
    "space.js",
    "theme.js",
    "time.js",
    "tree.js",
    "zoom.js",
];

/// The page and all its files.
pub(crate) fn page() -> Page {
    Page {
        html: include_str!("../page/index.html"),
        files: Arc::new(|name| {
            if name == "style.css" {
                let bytes = include_bytes!("../page/style.css").to_vec();
                return Some(PageFile { content_type: "text/css; charset=utf-8", bytes });
            }
            let (_, text) = SCRIPTS.iter().find(|it| it.0 == name)?;
            Some(PageFile { content_type: SCRIPT, bytes: text.as_bytes().to_vec() })
        }),
    }
}
