//! `foveate patterns`: the pictures that a projector shows, as PNG.

use std::path::PathBuf;

use clap::ValueEnum;
use foveate_structured_light::PatternSettings;
use foveate_structured_light::files::write_patterns;
use foveate_structured_light::pattern::{Code, InversePictures};

use super::complain;
use crate::exit;
use crate::output::say;

/// `foveate patterns`
#[derive(Debug, clap::Args)]
pub struct PatternsArgs {
    /// Columns and rows of the projector, as 1024x768 [px]
    #[arg(long, value_name = "COLUMNSxROWS", value_parser = size)]
    size: [u32; 2],
    /// What the patterns carry
    #[arg(long, value_enum, default_value_t = CodeKind::Gray)]
    code: CodeKind,
    /// Order of the pictures: words out of columns, rows, white, black; for a boundary code, which of columns and rows comes first
    #[arg(long, value_name = "WORDS", default_value = "columns rows white black")]
    order: String,
    /// No inverse pictures: white and black give the threshold
    #[arg(long)]
    no_inverse: bool,
    /// The code's middle is the projector's; of effect where columns or rows are no power of two
    #[arg(long)]
    centred: bool,
    /// Steps of a phase shift [default: 4]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(3..=32))]
    steps: Option<u32>,
    /// Period of a phase shift, a power of two [default: 16] [px]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(4..=1024))]
    period: Option<u32>,
    /// Width of a stripe of a boundary code [default: 4] [px]
    #[arg(long, value_name = "PX", value_parser = clap::value_parser!(u32).range(2..=1024))]
    stripe: Option<u32>,
    /// Gamma of the projector, so that sine waves of a phase shift are sine waves in light [default: 1]
    #[arg(long, value_parser = gamma)]
    gamma: Option<f64>,
    /// Folder for the pictures and `patterns.toml`
    #[arg(long, value_name = "DIR", value_hint = clap::ValueHint::DirPath)]
    out: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum CodeKind {
    /// Gray code down to single pixels
    Gray,
    /// A phase shift on top of a coarser Gray code
    Phase,
    /// Four pictures of stripes, shown again and again, for what moves
    Boundary,
}

/// `1024x768`
fn size(text: &str) -> Result<[u32; 2], String> {
    let sides = text.split_once('x').and_then(|(a, b)| Some([a.trim().parse().ok()?, b.trim().parse().ok()?]));
    sides
        .filter(|it| it.iter().all(|side| (1..=32_768).contains(side)))
        .ok_or_else(|| format!("found {text}, expected columns and rows from 1 to 32768, as 1024x768"))
}

fn gamma(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|it| (0.2..=5.0).contains(it));
    number.ok_or_else(|| format!("found {text}, expected a number from 0.2 to 5"))
}

/// An option that does not apply to the requested code.
fn without_effect(args: &PatternsArgs) -> Option<String> {
    use CodeKind::{Boundary, Gray, Phase};
    let given: [(&str, bool, &[CodeKind]); 6] = [
        ("--steps", args.steps.is_some(), &[Phase]),
        ("--period", args.period.is_some(), &[Phase]),
        ("--gamma", args.gamma.is_some(), &[Phase]),
        ("--stripe", args.stripe.is_some(), &[Boundary]),
        ("--no-inverse", args.no_inverse, &[Gray, Phase]),
        ("--centred", args.centred, &[Gray, Phase]),
    ];
    let name = |kind: CodeKind| kind.to_possible_value().map_or_else(String::new, |it| it.get_name().to_owned());
    let idle = given.iter().find(|it| it.1 && !it.2.contains(&args.code)).map(|(option, _, of)| {
        let of: Vec<String> = of.iter().map(|it| format!("`--code {}`", name(*it))).collect();
        format!("found `{option}` with `--code {}`, expected it with {} only", name(args.code), of.join(" or "))
    });
    let [columns, rows] = args.size;
    let is_whole = args.centred && args.size.iter().all(|it| it.is_power_of_two());
    idle.or_else(|| {
        is_whole.then(|| {
            format!("found `--centred` with {columns} x {rows}, expected columns or rows that are no power of two")
        })
    })
}

pub(super) fn run(args: &PatternsArgs) -> u8 {
    if let Some(fault) = without_effect(args) {
        return complain(&fault);
    }
    let usual = PatternSettings::default();
    let settings = PatternSettings {
        projector_px: args.size,
        code: match args.code {
            CodeKind::Gray => Code::Gray,
            CodeKind::Phase => Code::Phase,
            CodeKind::Boundary => Code::Boundary,
        },
        order: args.order.clone(),
        inverse: if args.no_inverse { InversePictures::None } else { InversePictures::After },
        centred: args.centred,
        steps: args.steps.unwrap_or(usual.steps),
        period_px: args.period.unwrap_or(usual.period_px),
        stripe_px: args.stripe.unwrap_or(usual.stripe_px),
        ..usual
    };
    if let Err(fault) = settings.stripe_code(None) {
        let option = match fault.setting.as_deref() {
            Some("period_px") => "--period",
            Some("steps") => "--steps",
            Some("stripe_px") => "--stripe",
            Some("code") => "--code",
            Some("projector_px") => "--size",
            _ => "--order",
        };
        return complain(&format!("`{option}`: {}", fault.message));
    }
    if args.out.join("patterns.toml").exists() {
        return complain(&format!("`{}` holds patterns already, expected another folder", args.out.display()));
    }
    match write_patterns(&settings, args.gamma.unwrap_or(1.0), &args.out) {
        Ok(names) => {
            let pictures = names.len() - 1;
            say(&format!("{pictures} pictures and patterns.toml in {}\n", args.out.display()));
            exit::DONE
        }
        Err(fault) => complain(&fault),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        args: PatternsArgs,
    }

    #[test]
    fn a_folder_that_has_patterns_is_left_as_it_is() {
        use clap::Parser;
        let folder = tempfile::tempdir().unwrap();
        let into = |code: &str| {
            let out = folder.path().display().to_string();
            run(&Line::parse_from(["patterns", "--size", "64x48", "--code", code, "--out", &out]).args)
        };
        assert_eq!(into("gray"), exit::DONE);
        let n_files = || std::fs::read_dir(folder.path()).unwrap().count();
        let before = n_files();
        assert_eq!((into("boundary"), n_files()), (exit::INPUT, before));
    }

    #[test]
    fn options_without_effect_are_refused() {
        use clap::Parser;
        let fault = |words: &str| {
            let words = format!("patterns --out x {words}");
            without_effect(&Line::try_parse_from(words.split_whitespace()).unwrap().args)
        };
        assert!(fault("--size 64x48 --steps 8").unwrap().contains("`--steps` with `--code gray`"));
        assert!(fault("--size 64x48 --gamma 2").unwrap().contains("`--gamma`"));
        assert!(fault("--size 64x64 --centred").unwrap().contains("64 x 64"));
        assert_eq!(fault("--size 64x48 --centred"), None);
        assert_eq!(fault("--size 64x48 --code phase --steps 8 --gamma 2"), None);
    }

    #[test]
    fn sizes_are_read() {
        assert_eq!(size("1024x768"), Ok([1024, 768]));
        for wrong in ["1024", "0x768", "1024x", "axb", "99999x4"] {
            assert!(size(wrong).unwrap_err().contains("as 1024x768"), "{wrong}");
        }
    }
}
