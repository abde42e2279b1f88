//! `foveate new`: something of one's own to start from. Works offline: the templates are in the program.

use std::fs::OpenOptions;
use std::io::Write;

use super::complain;
use crate::exit;
use crate::output::say;

const RIG: &str = include_str!("../../../../graphs/room.toml");
const CALIBRATION: &str = include_str!("../../../../graphs/room.calibration.toml");

pub(super) fn rig(name: &str) -> u8 {
    let is_fine = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-';
    if name.is_empty() || !name.chars().all(is_fine) {
        return complain(&format!("found the name `{name}`, expected small letters, digits, `_` and `-`"));
    }
    let (rig_file, calibration_file) = (format!("{name}.toml"), format!("{name}.calibration.toml"));
    let rig = RIG
        .replacen("name = \"room\"", &format!("name = \"{name}\""), 1)
        .replacen("room.calibration.toml", &calibration_file, 1)
        .replacen("foveate run graphs/room.toml", &format!("foveate run {rig_file}"), 1);
    for (file, text) in [(&calibration_file, CALIBRATION), (&rig_file, &rig)] {
        let created = OpenOptions::new().write(true).create_new(true).open(file);
        if let Err(error) = created.and_then(|mut it| it.write_all(text.as_bytes())) {
            if error.kind() == std::io::ErrorKind::AlreadyExists {
                return complain(&format!("`{file}` is there already and is left as it is; choose another name"));
            }
            return complain(&format!("`{file}` cannot be written: {error}"));
        }
    }
    say(&format!(
        "{rig_file}, {calibration_file}\n\nNext:\n  foveate check {rig_file}\n  foveate run {rig_file}\n  foveate graph {rig_file}\n\n\
         For completion in an editor: foveate schema > rig.schema.json, and `#:schema ./rig.schema.json` as the first line of the rig.\n"
    ));
    exit::DONE
}
