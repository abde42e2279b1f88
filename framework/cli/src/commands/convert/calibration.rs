//! A calibration in the form of another program.

use std::io::ErrorKind;
use std::path::Path;

use foveate_motion::forms::MOTION_FORMS;
use foveate_scene::{
    CALIBRATION_FORMS, Calibration, DltOrigin, Export, ExportContent, Format, ImportOptions, LengthUnit,
};

use super::{ConvertArgs, FromUp};
use crate::commands::complain;
use crate::exit;
use crate::output::{say, tell};

pub(super) fn run(args: &ConvertArgs) -> u8 {
    let options = ImportOptions {
        image_size: args.calibration.image_size,
        projector_size: args.calibration.projector_size,
        metres_per_unit: args.metres_per_unit,
        dlt_origin: if args.calibration.dlt_top_left { DltOrigin::TopLeft } else { DltOrigin::BottomLeft },
        lenses_at_origin: args.calibration.lenses,
    };
    let mut calibration = match Calibration::load_with(&args.input, &options) {
        Ok(calibration) => calibration,
        Err(error) => {
            let is_unknown = error.faults.iter().any(|it| it.expected == CALIBRATION_FORMS);
            let or = if is_unknown { format!("; or {MOTION_FORMS}") } else { String::new() };
            return complain(&format!("{error}{or}"));
        }
    };
    if let Some(up) = args.from_up.filter(|it| *it != FromUp::Z) {
        calibration = calibration.with_up(&up.direction());
        calibration.origin += &format!("; turned: {} was up", up.name());
    }
    for (told, flag) in [(options.image_size, "--image-size"), (options.projector_size, "--projector-size")]
        .into_iter()
        .filter_map(|(size, flag)| Some((size?, flag)))
    {
        if calibration.cameras.iter().all(|it| it.camera.image_size != told) {
            let sizes = calibration.cameras.iter().map(|it| {
                let [width, height] = it.camera.image_size;
                format!("{width} x {height} px of `{}`", it.name)
            });
            return complain(&format!(
                "`{flag} {},{}` contradicts `{}`, expected the file's own: {}",
                told[0],
                told[1],
                args.input.display(),
                sizes.collect::<Vec<_>>().join(", ")
            ));
        }
    }
    if let Some(name) = args.to.as_ref().filter(|name| Format::ALL.into_iter().all(|it| it.name() != name.as_str())) {
        return complain(&format!("`{}` is a calibration, and {name} is a form of motion files", args.input.display()));
    }
    let named = args.to.as_ref().and_then(|name| Format::ALL.into_iter().find(|it| it.name() == name));
    let format = match named.map_or_else(|| by_ending(&args.output, calibration.cameras.len()), Ok) {
        Ok(format) => format,
        Err(sentence) => return complain(&sentence),
    };
    let export = match calibration.export(format) {
        Ok(export) => export,
        Err(error) => return complain(&format!("cannot be written in the form {format}: {error}")),
    };
    if args.strict && !export.lost.is_empty() {
        return complain(&format!("nothing is written, since the form {format} loses\n{}", list(&export)));
    }
    let out = args.output.display();
    if args.output.as_os_str() == "-" {
        let ExportContent::File(text) = &export.content else {
            return complain(&format!("the form {format} is a folder of files, and `-` (standard output) is one"));
        };
        say(text);
        tell(format_args!("{}", export.lost.iter().map(|it| format!("lost: {it}\n")).collect::<String>()));
        return exit::DONE;
    }
    match export.write(&args.output, args.force) {
        Ok(()) => {
            let unit = match calibration.length_unit {
                LengthUnit::Metre => "metres",
                LengthUnit::Unknown => "an unknown unit",
            };
            let lost = match export.lost.is_empty() {
                true => "nothing is lost\n".to_owned(),
                false => format!("lost:\n{}", list(&export)),
            };
            let cameras = match calibration.cameras.len() {
                1 => "1 camera".to_owned(),
                n => format!("{n} cameras"),
            };
            say(&format!("{}\n{out}: {cameras}, lengths in {unit}, {format}\n{lost}", calibration.origin));
            exit::DONE
        }
        Err(error) if error.kind() == ErrorKind::AlreadyExists => {
            complain(&format!("`{out}` is there already and is left as it is; choose another name, or --force"))
        }
        Err(error) => complain(&format!("`{out}` cannot be written: {error}")),
    }
}

fn list(export: &Export) -> String {
    export.lost.iter().map(|it| format!("  {it}\n")).collect()
}

/// The form that the ending of `out` means.
fn by_ending(out: &Path, n_cameras: usize) -> Result<Format, String> {
    let ending = out.extension().and_then(|it| it.to_str()).unwrap_or_default().to_ascii_lowercase();
    match (ending.as_str(), n_cameras) {
        ("toml", _) => Ok(Format::Foveate),
        ("xml", _) => Ok(Format::Qualisys),
        ("csv", _) => Ok(Format::Dlt),
        ("yml" | "yaml", 1) => Ok(Format::OpenCv),
        ("yml" | "yaml", 2) => Ok(Format::OpenCvStereo),
        ("yml" | "yaml", n) => {
            Err(format!("found {n} cameras for one file of OpenCV, expected 1 or 2, or `--to opencv` and a folder"))
        }
        _ => {
            let names = Format::ALL.map(Format::name).join(", ");
            Err(format!("found `{}`, whose ending names no form, expected --to with one of {names}", out.display()))
        }
    }
}
