//! `foveate graph`: a rig as a picture.

use std::path::{Path, PathBuf};

use foveate_node::Registry;
use foveate_rig::Overrides;

use super::{PictureFormat, complain, load};
use crate::exit;
use crate::output::say;
use crate::results::write_whole;

pub(super) fn run(rig: &Path, registry: &Registry, format: PictureFormat, output: Option<PathBuf>) -> u8 {
    let graph = match load(rig, registry, &Overrides::default()) {
        Ok(graph) => graph,
        Err(code) => return code,
    };
    let (picture, extension) = match format {
        PictureFormat::Svg => (graph.to_svg(), "svg"),
        PictureFormat::Mermaid => (graph.to_mermaid(), "mmd"),
    };
    let output = output.unwrap_or_else(|| PathBuf::from(format!("{}.{extension}", graph.name)));
    if output.as_os_str() == "-" {
        say(&picture);
        return exit::DONE;
    }
    match write_whole(&output, picture.as_bytes()) {
        Ok(()) => {
            say(&format!("{}\n", output.display()));
            exit::DONE
        }
        Err(sentence) => complain(&sentence),
    }
}
