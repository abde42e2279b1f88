//! `foveate convert`: a calibration in the form of another program, and what is lost on the way.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use clap::builder::PossibleValuesParser;
use foveate_scene::{Calibration, DltOrigin, Export, Format, ImportOptions, LengthUnit};

use super::complain;
use crate::exit;
use crate::output::say;

/// `foveate convert`
#[derive(Debug, clap::Args)]
pub struct ConvertArgs {
    /// The calibration: a file or folder of any form that is known; what is in it decides
    #[arg(value_name = "IN", value_hint = clap::ValueHint::AnyPath)]
    input: PathBuf,
    /// What to write: a file, or a folder for forms of several files
    #[arg(value_name = "OUT", value_hint = clap::ValueHint::AnyPath)]
    output: PathBuf,
    /// The form to write [default: by OUT's ending: .toml foveate, .yml opencv or opencv-stereo, .xml qualisys, .csv dlt]
    #[arg(long, value_name = "FORMAT", value_parser = PossibleValuesParser::new(Format::ALL.map(Format::name)))]
    to: Option<String>,
    /// Columns and rows of the images, for forms that do not hold them [px]
    #[arg(long, value_name = "W,H", value_parser = image_size)]
    image_size: Option<[u32; 2]>,
    /// How long a unit of IN is, for forms that do not say; 0.001 for millimetres [m]
    #[arg(long, value_name = "METRES", value_parser = length)]
    metres_per_unit: Option<f64>,
    /// Pixels of DLT coefficients in IN count from the top left, as MATLAB does, not from the bottom left, as easyWand does
    #[arg(long)]
    dlt_top_left: bool,
    /// Take lenses without poses: their cameras stand at the origin
    #[arg(long)]
    lenses: bool,
    /// Write nothing if anything would be lost
    #[arg(long)]
    strict: bool,
    /// Write over what is there
    #[arg(long)]
    force: bool,
}

pub(super) fn run(args: &ConvertArgs) -> u8 {
    let options = ImportOptions {
        image_size: args.image_size,
        metres_per_unit: args.metres_per_unit,
        dlt_origin: if args.dlt_top_left { DltOrigin::TopLeft } else { DltOrigin::BottomLeft },
        lenses_at_origin: args.lenses,
    };
    let calibration = match Calibration::load_with(&args.input, &options) {
        Ok(calibration) => calibration,
        Err(error) => return complain(&error.to_string()),
    };
    let named = args.to.as_ref().and_then(|name| Format::ALL.into_iter().find(|it| it.name() == name));
    let format = match named.map_or_else(|| by_ending(&args.output, calibration.cameras.len()), Ok) {
        Ok(format) => format,
        Err(sentence) => return complain(&sentence),
    };
    let export = match calibration.export(format) {
        Ok(export) => export,
        Err(error) => return complain(&format!("cannot be said in the form {format}: {error}")),
    };
    if args.strict && !export.lost.is_empty() {
        return complain(&format!("nothing is written, since the form {format} loses\n{}", list(&export)));
    }
    let out = args.output.display();
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

/// The form that the ending of `out` stands for.
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

/// Columns and rows on the command line.
fn image_size(text: &str) -> Result<[u32; 2], String> {
    let sides: Option<Vec<u32>> = text.split([',', 'x']).map(|it| it.trim().parse().ok()).collect();
    let size = sides.and_then(|it| <[u32; 2]>::try_from(it).ok());
    let fits = size.filter(|it| it.iter().all(|it| (1..=65535).contains(it)));
    fits.ok_or_else(|| format!("found {text}, expected W,H: two whole numbers from 1 to 65535 [px]"))
}

/// A length on the command line.
fn length(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| it.is_finite() && *it > 0.0);
    number.ok_or_else(|| format!("found {text}, expected a length above 0 [m]"))
}
