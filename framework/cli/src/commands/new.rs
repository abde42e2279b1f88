//! `foveate new`: something of one's own to start from. Works offline: the templates are in the program.

use std::fs::OpenOptions;
use std::io::Write;

use foveate_sim::lab::hall_calibration;

use super::complain;
use crate::exit;
use crate::output::say;

const RIG: &str = include_str!("../../../../graphs/room.toml");
const CALIBRATION: &str = include_str!("../../../../graphs/ideal_lab.calibration.toml");
/// Lines of the lab's rig that give it a world apart from its calibration: a new rig's world is as its calibration says.
const OF_ITS_WORLD: [&str; 2] = ["# The true cameras", "truth = "];
const HALL_RIG: &str = include_str!("../../../../graphs/crowd.toml");

/// From the walls of a hall to the volume, and to where people walk [m].
const TO_VOLUME_M: f64 = 1.5;
const TO_PEOPLE_M: f64 = 2.5;

/// The lab, or a hall with so many cameras and of this size [m].
pub(super) fn rig(name: &str, hall: Option<(u16, [f64; 3])>) -> u8 {
    let is_fine = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_' || c == '-';
    if name.is_empty() || !name.chars().all(is_fine) {
        return complain(&format!("found the name `{name}`, expected small letters, digits, `_` and `-`"));
    }
    let (rig_file, calibration_file) = (format!("{name}.toml"), format!("{name}.calibration.toml"));
    let named = |template: &str, of: &str| {
        template
            .replacen(&format!("name = \"{of}\""), &format!("name = \"{name}\""), 1)
            .replacen(&format!("{of}.calibration.toml"), &calibration_file, 1)
            .replacen(&format!("foveate run graphs/{of}.toml"), &format!("foveate run {rig_file}"), 1)
    };
    let (rig, calibration) = match hall {
        None => (lab_rig(&named(RIG, "room"), &calibration_file), CALIBRATION.to_owned()),
        Some((cameras, size)) => match hall_calibration(usize::from(cameras), size) {
            Ok(calibration) => (hall_rig(&named(HALL_RIG, "crowd"), cameras, size), calibration.to_toml()),
            Err(error) => return complain(&error.to_string()),
        },
    };
    for (file, text) in [(&calibration_file, &calibration), (&rig_file, &rig)] {
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

/// The rig of the lab with another calibration, which is its world, too.
fn lab_rig(template: &str, calibration_file: &str) -> String {
    let lines = template.lines().filter(|line| !OF_ITS_WORLD.iter().any(|it| line.starts_with(it)));
    let lines = lines.map(|line| match line.split_once(" = ") {
        Some(("calibration", _)) => format!("calibration = \"{calibration_file}\"\n"),
        _ => format!("{line}\n"),
    });
    lines.collect()
}

/// The rig of the crowd with another hall's measures in it.
fn hall_rig(template: &str, cameras: u16, [x, y, z]: [f64; 3]) -> String {
    let [half_x, half_y] = [x, y].map(|it| it / 2.0 - TO_VOLUME_M);
    let volume = format!("volume_m = {{ min = [-{half_x:?}, -{half_y:?}, 0.0], max = [{half_x:?}, {half_y:?}, 2.2] }}");
    let area = format!("walk_area_m = [{:?}, {:?}]", x - 2.0 * TO_PEOPLE_M, y - 2.0 * TO_PEOPLE_M);
    let lines = template.lines().map(|line| match line.split_once(" = ") {
        Some(("volume_m", _)) => volume.clone(),
        Some(("walk_area_m", _)) => area.clone(),
        _ => line.replace(
            "a hall of 12 x 9 m, under 64 cameras",
            &format!("a hall of {x} x {y} x {z} m, under {cameras} cameras"),
        ),
    });
    lines.map(|line| line + "\n").collect()
}
