//! `foveate convert`: a calibration or a motion file in another form, and what is lost on the way. What is in the file decides which of the two it is.

mod calibration;
mod motion;

use std::path::PathBuf;

use clap::ValueEnum;
use clap::builder::PossibleValuesParser;
use foveate_motion::forms::Form;
use foveate_scene::Format;
use nalgebra::Vector3;

use super::complain;
use super::motion_files::{UpArg, kind_of, nearly_table, seconds_of_gap};

/// `foveate convert`
#[derive(Debug, clap::Args)]
pub struct ConvertArgs {
    /// A calibration (a file or folder of any form that is known) or a motion file (C3D, TRC, BVH, targets.csv, marks.csv, NPZ); what is in it decides
    #[arg(value_name = "IN", value_hint = clap::ValueHint::AnyPath)]
    input: PathBuf,
    /// What to write: a file, or a folder for calibrations of several files; `-`: standard output, with --to
    #[arg(value_name = "OUT", value_hint = clap::ValueHint::AnyPath)]
    output: PathBuf,
    /// The form to write [default: by OUT's ending. Calibrations: .toml foveate, .yml opencv or opencv-stereo, .xml qualisys, .csv dlt. Motion: .c3d
    /// .trc .bvh .glb .npz .csv]
    #[arg(long, value_name = "FORMAT", value_parser = PossibleValuesParser::new(forms()))]
    to: Option<String>,
    /// How long a unit of IN is, for forms that do not say; 0.001 for millimetres [m]
    #[arg(long, value_name = "METRES", value_parser = length)]
    metres_per_unit: Option<f64>,
    /// Which axis is up in IN: y or z in motion files [default: as a C3D file says, y in TRC and BVH, else z]; in calibrations any, and OUT is turned so that z is [default: z]
    #[arg(long, value_name = "AXIS", value_enum, allow_hyphen_values = true)]
    from_up: Option<FromUp>,
    /// Write nothing if anything would be lost
    #[arg(long)]
    strict: bool,
    /// Write over what is there
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    calibration: CalibrationOptions,
    #[command(flatten)]
    motion: MotionOptions,
}

/// An axis of IN, either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum FromUp {
    /// x
    X,
    /// −x
    #[value(name = "-x")]
    MinusX,
    /// y
    Y,
    /// −y, as where cameras' own axes became the world's
    #[value(name = "-y")]
    MinusY,
    /// z
    Z,
    /// −z
    #[value(name = "-z")]
    MinusZ,
}

impl FromUp {
    /// As on the command line.
    fn name(self) -> String {
        self.to_possible_value().map_or_else(String::new, |it| it.get_name().to_owned())
    }

    /// Of length 1.
    fn direction(self) -> Vector3<f64> {
        match self {
            FromUp::X => Vector3::x(),
            FromUp::MinusX => -Vector3::x(),
            FromUp::Y => Vector3::y(),
            FromUp::MinusY => -Vector3::y(),
            FromUp::Z => Vector3::z(),
            FromUp::MinusZ => -Vector3::z(),
        }
    }
}

/// Calibrations alone have these.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Calibrations")]
struct CalibrationOptions {
    /// Columns and rows of the images, for forms that do not hold them [px]
    #[arg(long, value_name = "W,H", value_parser = image_size)]
    image_size: Option<[u32; 2]>,
    /// Columns and rows of the projector, for forms with a camera and a projector that do not hold them [px]
    #[arg(long, value_name = "W,H", value_parser = image_size)]
    projector_size: Option<[u32; 2]>,
    /// Pixels of DLT coefficients in IN count from the top left, as MATLAB does, not from the bottom left, as easyWand does
    #[arg(long)]
    dlt_top_left: bool,
    /// Take lenses without poses: their cameras stand at the origin
    #[arg(long)]
    lenses: bool,
}

/// Motion files alone have these.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Motion files")]
struct MotionOptions {
    /// Cross gaps whose ends are at most so far apart by a cubic; the samples keep the flag `filled` [s]
    #[arg(long, value_name = "SECONDS", value_parser = seconds_of_gap)]
    fill: Option<f64>,
    /// Low-pass with this cut-off, without a lag (Butterworth, forwards and backwards), behind --fill [Hz]
    #[arg(long, value_name = "HZ", value_parser = frequency)]
    smooth: Option<f64>,
    /// Frames a second in OUT [default: those of IN] [Hz]
    #[arg(long, value_name = "HZ", value_parser = frequency)]
    rate: Option<f64>,
    /// Turn the points so that this axis is up [default: as in IN; z in our own forms, y in TRC, BVH and glTF]
    #[arg(long, value_enum)]
    up: Option<UpArg>,
    /// Unit of lengths in C3D, TRC and BVH [default: that of IN, else mm; cm in BVH]
    #[arg(long, value_name = "UNIT", value_parser = PossibleValuesParser::new(["mm", "cm", "m"]))]
    unit: Option<String>,
    /// For BVH: the points that joints sit on, as `waist=LASI+RASI+SACR,head=LFHD+RFHD` (the middle of several); of head, waist, left_ and right_shoulder,
    /// _elbow, _wrist [default: by names in use]
    #[arg(long, value_name = "JOINT=POINT,…")]
    joints: Option<String>,
    /// For BVH: write it though the points' distances are not those of a body
    #[arg(long)]
    any_proportions: bool,
}

impl CalibrationOptions {
    fn first_used(&self) -> Option<&'static str> {
        let used = [
            (self.image_size.is_some(), "--image-size"),
            (self.projector_size.is_some(), "--projector-size"),
            (self.dlt_top_left, "--dlt-top-left"),
            (self.lenses, "--lenses"),
        ];
        used.into_iter().find(|it| it.0).map(|it| it.1)
    }
}

impl MotionOptions {
    fn first_used(&self) -> Option<&'static str> {
        let used = [
            (self.fill.is_some(), "--fill"),
            (self.smooth.is_some(), "--smooth"),
            (self.rate.is_some(), "--rate"),
            (self.up.is_some(), "--up"),
            (self.unit.is_some(), "--unit"),
            (self.joints.is_some(), "--joints"),
            (self.any_proportions, "--any-proportions"),
        ];
        used.into_iter().find(|it| it.0).map(|it| it.1)
    }
}

/// Everything that --to takes.
fn forms() -> Vec<&'static str> {
    Format::ALL.map(Format::name).into_iter().chain(Form::ALL.map(Form::name)).chain(["glb"]).collect()
}

pub(super) fn run(args: &ConvertArgs) -> u8 {
    let path = args.input.display();
    let (unused, what, other) = match kind_of(&args.input) {
        Ok(Some(form)) => match args.calibration.first_used() {
            None => return motion::run(args, form),
            Some(option) => (option, "a motion file", "calibrations"),
        },
        Ok(None) => match args.motion.first_used() {
            _ if let Some(why) = nearly_table(&args.input) => return complain(&why),
            None => return calibration::run(args),
            Some(option) => (option, "no motion file", "motion files"),
        },
        Err(error) => return complain(&format!("`{path}` cannot be read: {error}")),
    };
    complain(&format!("`{path}` is {what}, and {unused} is for {other}"))
}

/// Columns and rows on the command line.
fn image_size(text: &str) -> Result<[u32; 2], String> {
    let sides: Option<Vec<u32>> = text.split([',', 'x']).map(|it| it.trim().parse().ok()).collect();
    let size = sides.and_then(|it| <[u32; 2]>::try_from(it).ok());
    let fits = size.filter(|it| it.iter().all(|it| (1..=65535).contains(it)));
    fits.ok_or_else(|| format!("found {text}, expected W,H: two whole numbers from 1 to 65535 [px]"))
}

/// A length on the command line.
pub(super) fn length(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| it.is_finite() && *it > 0.0);
    number.ok_or_else(|| format!("found {text}, expected a length above 0 [m]"))
}

/// A frequency on the command line.
fn frequency(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| *it > 0.0 && *it <= 1e6);
    number.ok_or_else(|| format!("found {text}, expected a frequency above 0, to 1e6 [Hz]"))
}
