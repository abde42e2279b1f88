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
    /// What follows what: words out of columns, rows, white, black; of a boundary code, the first of columns and rows
    #[arg(long, value_name = "WORDS", default_value = "columns rows white black")]
    order: String,
    /// No inverse pictures: white and black give the threshold
    #[arg(long)]
    no_inverse: bool,
    /// The code's middle is the projector's; of effect where columns or rows are no power of two
    #[arg(long)]
    centred: bool,
    /// Steps of a phase shift
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u32).range(3..=32))]
    steps: u32,
    /// Period of a phase shift, a power of two [px]
    #[arg(long, value_name = "PX", default_value_t = 16, value_parser = clap::value_parser!(u32).range(4..=1024))]
    period: u32,
    /// Width of a stripe of a boundary code [px]
    #[arg(long, value_name = "PX", default_value_t = 4, value_parser = clap::value_parser!(u32).range(2..=1024))]
    stripe: u32,
    /// Gamma of the projector, so that sine waves are sine waves in light; stripes are either lit or not
    #[arg(long, default_value_t = 1.0, value_parser = gamma)]
    gamma: f64,
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

pub(super) fn run(args: &PatternsArgs) -> u8 {
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
        steps: args.steps,
        period_px: args.period,
        stripe_px: args.stripe,
        ..PatternSettings::default()
    };
    match write_patterns(&settings, args.gamma, &args.out) {
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

    #[test]
    fn sizes_are_read() {
        assert_eq!(size("1024x768"), Ok([1024, 768]));
        for wrong in ["1024", "0x768", "1024x", "axb", "99999x4"] {
            assert!(size(wrong).unwrap_err().contains("as 1024x768"), "{wrong}");
        }
    }
}
