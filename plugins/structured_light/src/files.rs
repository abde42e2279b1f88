//! Patterns as files: a PNG for each picture and `patterns.toml`, which says what they show.

use std::fs;
use std::path::Path;

use foveate::imaging::stripes::pattern::picture;
use image::GrayImage;

use crate::pattern::{MANIFEST, PatternSettings};

/// Writes all pictures of `settings` into `folder`, which is made if need be; their names in order, the manifest last. `gamma` is that of the projector, of
/// effect on phase shifts only.
///
/// # Errors
/// A code that cannot be, a folder that holds other pictures, a file that cannot be written.
pub fn write_patterns(settings: &PatternSettings, gamma: f64, folder: &Path) -> Result<Vec<String>, String> {
    let code = settings.stripe_code(None).map_err(|fault| fault.message)?;
    fs::create_dir_all(folder).map_err(|error| format!("`{}` cannot be made: {error}", folder.display()))?;
    let shown = code.pictures();
    let name = |at: usize| format!("pattern_{at:03}.png");
    let mine: Vec<String> = (0..shown.len()).map(name).collect();
    let entries = fs::read_dir(folder).map_err(|error| format!("`{}` cannot be read: {error}", folder.display()))?;
    for entry in entries.flatten() {
        let other = entry.file_name().to_string_lossy().into_owned();
        if other.ends_with(".png") && !mine.contains(&other) {
            return Err(format!(
                "`{}` holds `{other}` already, expected a folder without other pictures",
                folder.display()
            ));
        }
    }
    let [columns, rows] = code.projector;
    for (name, shown) in mine.iter().zip(&shown) {
        let path = folder.join(name);
        let pixels = GrayImage::from_raw(columns, rows, picture(&code, *shown, gamma));
        let Some(pixels) = pixels else { unreachable!("a picture has as many pixels as its projector") };
        pixels.save(&path).map_err(|error| format!("`{}` cannot be written: {error}", path.display()))?;
    }
    let text = toml::to_string(settings).map_err(|fault| fault.to_string())?;
    let head = "# What the pictures beside this file show. Put it into the folder of what a camera saw of them, taken in the same order.\n";
    let path = folder.join(MANIFEST);
    fs::write(&path, format!("{head}{text}"))
        .map_err(|error| format!("`{}` cannot be written: {error}", path.display()))?;
    Ok(mine.into_iter().chain([MANIFEST.to_owned()]).collect())
}

#[cfg(test)]
mod tests {
    use foveate::prelude::*;

    use super::*;
    use crate::decoder::{self, Decoder, DecoderSettings};
    use crate::pattern::Code;
    use crate::pictures;

    /// The patterns taken for what a camera saw of them, each of whose pixels is one of the projector's: columns and rows come back.
    #[track_caller]
    fn there_and_back(settings: PatternSettings, bound: f32) {
        let folder = tempfile::tempdir().unwrap();
        write_patterns(&settings, 1.0, folder.path()).unwrap();
        let set = pictures::read(&pictures::sets(folder.path(), "*").unwrap()[0]).unwrap().set;
        let mut bench =
            NodeBench::<Decoder>::new(DecoderSettings { min_direct: 0.0, ..DecoderSettings::default() }).unwrap();
        // A camera does not reach the ends of its gray levels.
        let pixels = set.pixels.iter().map(|it| 20 + (u16::from(*it) * 200 / 255) as u8).collect();
        bench.feed(&decoder::PICTURES, Time::ZERO, PatternPictures { pixels, ..set }).unwrap();
        let map = bench.outputs(&decoder::MAP).pop().unwrap().value;
        let mut known = 0;
        for y in 4..44 {
            for x in 4..60 {
                let [u, v] = map.get(x, y).coordinate;
                known += usize::from(u.is_finite() && v.is_finite());
                assert!(u.is_nan() || (u - x as f32).abs() < bound, "column {u} for {x}");
                assert!(v.is_nan() || (v - y as f32).abs() < bound, "row {v} for {y}");
            }
        }
        assert!(known > 2000, "{known} of 2240 pixels");
    }

    #[test]
    fn what_is_written_is_decoded_by_its_manifest() {
        let small = PatternSettings { projector_px: [64, 48], ..PatternSettings::default() };
        there_and_back(small.clone(), 0.1);
        let order = "white black rows columns".to_owned();
        there_and_back(PatternSettings { order, centred: true, projector_px: [66, 49], ..small.clone() }, 0.1);
        there_and_back(PatternSettings { code: Code::Phase, ..small.clone() }, 0.1);
        there_and_back(PatternSettings { code: Code::Phase, steps: 8, period_px: 8, ..small }, 0.1);
    }

    #[test]
    fn other_pictures_are_not_mixed_in() {
        let folder = tempfile::tempdir().unwrap();
        let large = PatternSettings { projector_px: [64, 48], ..PatternSettings::default() };
        let names = write_patterns(&large, 1.0, folder.path()).unwrap();
        assert_eq!((names.len(), names[26].as_str()), (27, "patterns.toml"));
        let small = PatternSettings { projector_px: [8, 8], ..PatternSettings::default() };
        assert!(write_patterns(&small, 1.0, folder.path()).unwrap_err().contains("already"));
    }
}
