//! The section on how to reproduce the results.

use toml::Value;

use crate::folder::Folder;
use crate::page::Page;
use crate::words;

/// Writes the section; `version` is the one of the program that writes the page.
pub(crate) fn write(page: &mut Page, folder: &Folder, version: &str) {
    page.section("again", "How to reproduce this");
    if let Some(session) = &folder.session {
        page.paragraph(
            "These results were made from a recorded session; the following makes them again, byte by byte:",
        );
        page.terminal(&format!("foveate replay {}", session.name));
        page.paragraph(&format!("This page was written by foveate {version}."));
        return;
    }
    let command =
        folder.rig_text.lines().next().and_then(|it| it.strip_prefix("# ")).filter(|it| it.starts_with("foveate "));
    if let Some(command) = command {
        page.paragraph("These results were made from a recorded session, by the following:");
        page.terminal(command);
        page.paragraph(&format!("This page was written by foveate {version}."));
        return;
    }
    match &folder.rig {
        Err(sentence) => {
            page.missing(sentence);
            page.paragraph("Without the resolved rig, run the rig that these results came from once more.");
        }
        Ok(_) => {
            page.paragraph(
                "In this folder, the following runs the same rig with the same settings, into a folder `again`:",
            );
            page.terminal("foveate run rig.resolved.toml --out again");
            if let Some(seed) = folder.of_rig("seed").and_then(Value::as_integer) {
                page.paragraph(&format!(
                    "The seed is {seed}, and every default is filled in. The same rig, seed, program and input files give the same bytes; only `timing.json` and `real_time_factor` differ. \
                     A live run (`--live`, or cameras on hardware) depends on the clock and is not repeated."
                ));
            }
            if let Some(place) = folder.of_rig("folder").and_then(Value::as_str) {
                page.note(&format!("Files that the rig names, such as its calibration, are searched in `{place}`."));
            }
        }
    }
    page.paragraph(&format!(
        "This page was written by foveate {version}; the results do not say which version made them."
    ));
    match &folder.timing {
        Err(sentence) => page.missing(sentence),
        Ok(timing) => {
            let number = |name: &str| timing.get(name).and_then(serde_json::Value::as_f64);
            if let (Some(wall_s), Some(factor)) = (number("wall_s"), number("real_time_factor")) {
                page.note(&format!(
                    "The run took {} of wall time, {} times real time.",
                    words::duration(wall_s),
                    words::number(factor)
                ));
            }
        }
    }
}
