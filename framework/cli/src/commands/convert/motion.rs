//! A motion file in another form: read, resampled, filled, smoothed, turned, written.

use std::collections::BTreeMap;
use std::path::Path;

use foveate_motion::Motion;
use foveate_motion::fill::fill;
use foveate_motion::forms::{self, Form, ReadOptions, WriteOptions, start_lost, unit_length};
use foveate_motion::motion::Up;
use foveate_motion::smooth::smooth;

use super::{ConvertArgs, FromUp};
use crate::commands::complain;
use crate::commands::motion_files::{describe, load, write_whole};
use crate::exit;
use crate::outcome::harmless;
use crate::output::{self, say, tell};

/// Of the balls in a scene [m].
const RADIUS_M: f64 = 0.015;
/// Frames of irregular times that are farther apart have a hole between them, as in `export.c3d` [s].
const GAP_S: f64 = 0.05;

/// What is written.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Target {
    Form(Form),
    Glb,
}

pub(super) fn run(args: &ConvertArgs, form: Form) -> u8 {
    match convert(args, form) {
        // Standard output is for the file.
        Ok(said) if args.output.as_os_str() == "-" => {
            tell(format_args!("{said}"));
            exit::DONE
        }
        Ok(said) => {
            say(&said);
            exit::DONE
        }
        Err(sentence) => complain(&sentence),
    }
}

fn convert(args: &ConvertArgs, form: Form) -> Result<String, String> {
    let target = target(args)?;
    let up = match args.from_up {
        None => None,
        Some(FromUp::Y) => Some(Up::Y),
        Some(FromUp::Z) => Some(Up::Z),
        Some(_) => return Err("motion files have y or z up, expected `--from-up y` or `--from-up z`".to_owned()),
    };
    let options = ReadOptions { metres_per_unit: args.metres_per_unit, up };
    let read = load(&args.input, form, &options)?;
    let mut said = format!("{}\n", describe(&args.input, read.form.to_string().as_str(), &read.motion));
    let mut motion = read.motion;
    said.extend(read.remarks.iter().map(|it| format!("note: {it}\n")));
    if motion.n_present() == 0 {
        return Err(no_samples(&args.input, &motion));
    }
    worked_on(&mut motion, args, target, &mut said)?;
    let name = args.output.file_name().map_or_else(String::new, |it| it.to_string_lossy().into_owned());
    let unit = args.motion.unit.as_deref();
    let (bytes, lost) = match target {
        Target::Form(Form::Bvh) if motion.skeleton.is_none() => {
            let unit_m = unit.and_then(unit_length).unwrap_or(0.01);
            let joints = joints(args.motion.joints.as_deref())?;
            let any_proportions = args.motion.any_proportions;
            let options = foveate_export::bvh::SkeletonOptions { joints, unit_m, any_proportions };
            let file = foveate_export::bvh::bvh(&motion, &options)?;
            let sites = file.sites.iter().map(|(site, points)| format!("{site} = {}", points.join("+")));
            said += &format!("joints: {}\n", sites.collect::<Vec<_>>().join(", "));
            (file.text.into_bytes(), file.lost)
        }
        Target::Form(form) => {
            let options = WriteOptions { unit, up: args.motion.up.map(Into::into) };
            let written =
                forms::write(&motion, form, &name, &options).map_err(|it| format!("{form} cannot be written: {it}"))?;
            said.extend(written.notes.iter().map(|it| format!("{it}\n")));
            (written.bytes, written.lost)
        }
        Target::Glb => (foveate_export::gltf::glb(&motion, RADIUS_M)?, lost_in_scene(&motion)),
    };
    let list: String = lost.iter().map(|it| format!("  {it}\n")).collect();
    if args.strict && !lost.is_empty() {
        return Err(format!("nothing is written, since `{}` would lose\n{list}", args.output.display()));
    }
    match args.output.as_os_str() == "-" {
        true => output::write(&bytes),
        false => write_whole(&args.output, &bytes, args.force)?,
    }
    let name = match target {
        Target::Form(form) => form.to_string(),
        Target::Glb => "GLB".to_owned(),
    };
    said += &format!("{}: {name}, {} bytes\n", args.output.display(), bytes.len());
    said += &if lost.is_empty() { "nothing is lost\n".to_owned() } else { format!("lost:\n{list}") };
    Ok(said)
}

/// That there is nothing to convert, and what there is instead.
fn no_samples(path: &Path, motion: &Motion) -> String {
    let (n_points, n_frames) = (motion.labels.len(), motion.n_frames());
    let besides =
        if motion.besides.is_empty() { String::new() } else { format!(", and {}", motion.besides.join(", ")) };
    let fault = format!("found no samples: {n_points} points in {n_frames} frames{besides}");
    harmless(&format!("`{}`: {fault}; expected one point in one frame at least", path.display()))
}

/// By --to, else by the ending.
fn target(args: &ConvertArgs) -> Result<Target, String> {
    let ending = args.output.extension().and_then(|it| it.to_str()).unwrap_or_default().to_ascii_lowercase();
    let name = args.to.as_deref().unwrap_or(&ending);
    let all = || Form::ALL.map(Form::name).join(", ");
    match (name, Form::of_ending(name)) {
        ("glb", _) => Ok(Target::Glb),
        (_, Some(form)) => Ok(Target::Form(form)),
        _ if args.to.is_some() => {
            Err(format!("`{}` is a motion file, and {name} is a form of calibrations", args.input.display()))
        }
        _ => Err(format!(
            "found `{}`, whose ending names no form of motion, expected .{}, .glb, or --to",
            args.output.display(),
            all().replace(", ", ", .")
        )),
    }
}

/// Applies the requested steps to the motion, and reports what was done.
fn worked_on(motion: &mut Motion, args: &ConvertArgs, target: Target, said: &mut String) -> Result<(), String> {
    let needs_rate = !matches!(target, Target::Form(Form::Table | Form::Npz)) || args.motion.smooth.is_some();
    let is_irregular = motion.rate_hz.is_none() && motion.n_frames() > 1;
    let usual = if needs_rate && is_irregular { motion.usual_rate_hz() } else { None };
    if let Some(longest_s) = args.motion.fill {
        let filled = fill(motion, longest_s);
        *said += &format!("filled {} gaps with {} samples", filled.n_gaps, filled.n_samples);
        *said += &match filled.n_too_long {
            0 => "\n".to_owned(),
            n => format!("; {n} are longer than {longest_s} s\n"),
        };
    }
    if let Some(rate_hz) = args.motion.rate.or(usual) {
        let before = motion.rate_hz.map_or("irregular times".to_owned(), |it| format!("{it} Hz"));
        if motion.rate_hz != Some(rate_hz) {
            *motion = motion.resampled(rate_hz, motion.neighbours_s(GAP_S))?;
            *said += &format!("resampled from {before} to {rate_hz:.3} Hz, {} frames\n", motion.n_frames());
        }
    }
    if let Some(cutoff_hz) = args.motion.smooth {
        let smoothed = smooth(motion, cutoff_hz)?;
        *said += &format!("smoothed {} samples at {cutoff_hz} Hz", smoothed.n_samples);
        *said += &match smoothed.n_too_short {
            0 => "\n".to_owned(),
            n => format!("; {n} are in runs too short for it, and stay as they are\n"),
        };
    }
    if let Some(up) = args.motion.up {
        let up: Up = up.into();
        if motion.turn(up) {
            *said += &format!("turned: {} is up\n", up.name());
        }
    }
    Ok(())
}

/// What a scene of points cannot hold.
fn lost_in_scene(motion: &Motion) -> Vec<String> {
    use foveate_messages::Provenance;
    let mut lost = motion.besides.clone();
    let count = |n: usize, what: &str| (n > 0).then(|| format!("{n} {what}"));
    let n_known = motion.samples.iter().flatten().filter(|it| it.sigma().is_some_and(|it| it > 0.0)).count();
    lost.extend(count(n_known, "residuals or covariances"));
    lost.extend(count(motion.n_of(Provenance::Filled), "samples were filled in, and now look measured"));
    lost.extend(count(motion.n_of(Provenance::Predicted), "samples that were only predicted, now missing"));
    lost.extend(count(motion.events.len(), "events"));
    if motion.start_s() != 0.0 {
        lost.push(start_lost(motion));
    }
    if motion.skeleton.is_some() {
        lost.push("the skeleton: its joints stand as points".to_owned());
    }
    lost
}

/// `waist=LASI+RASI,head=HEAD`.
fn joints(text: Option<&str>) -> Result<BTreeMap<String, Vec<String>>, String> {
    let mut all = BTreeMap::new();
    for part in text.unwrap_or("").split(',').filter(|it| !it.trim().is_empty()) {
        let Some((joint, points)) = part.split_once('=').filter(|it| !it.1.trim().is_empty()) else {
            return Err(format!("--joints: found `{part}`, expected JOINT=POINT or JOINT=POINT+POINT"));
        };
        all.insert(joint.trim().to_owned(), points.split('+').map(|it| it.trim().to_owned()).collect());
    }
    Ok(all)
}
