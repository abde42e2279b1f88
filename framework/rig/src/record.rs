//! `[record]`: whether a run is recorded into a session, and how.

use toml::Spanned;

use super::grammar::record as key;
use crate::graph::{PictureForm, Record, SessionPacking};
use foveate_diagnostics::Findings;
use foveate_diagnostics::value::{Value, whole};

/// How pictures are recorded, by their words in rigs.
pub(super) const FORMS: [(&str, PictureForm); 3] =
    [("lossless", PictureForm::Lossless), ("jpeg", PictureForm::Jpeg), ("none", PictureForm::None)];
/// How a session is compressed, by its words in rigs.
pub(super) const PACKINGS: [(&str, SessionPacking); 3] =
    [("none", SessionPacking::None), ("lz4", SessionPacking::Lz4), ("zstd", SessionPacking::Zstd)];

/// Reads the table.
pub(super) fn read(name: &Spanned<String>, value: Value<'_>, text: &str, findings: &mut Findings) -> Option<Record> {
    let mut keys = findings.table(name, value, text, "a table `[record]`")?;
    let file = key::FILE.text(&mut keys, findings).map(Spanned::into_inner);
    let mut record = Record { file, ..Record::default() };
    if let Some((form, _)) = key::PICTURES.word(&FORMS, &mut keys, findings) {
        record.pictures = form;
    }
    if let Some(quality) = key::JPEG_QUALITY.whole(&mut keys, findings) {
        record.jpeg_quality = quality as u8;
    }
    if let Some((name, value)) = keys.take_entry(key::CAMERAS.name) {
        let expected = "`{ \"CAMERA\" = \"jpeg\" }`, cameras by name or pattern";
        for (pattern, value) in
            findings.table(&name, value, text, expected).map(|mut it| it.take_rest()).unwrap_or_default()
        {
            if let Some(form) = findings.choice(pattern.get_ref(), &value, &FORMS) {
                record.cameras.push((pattern.into_inner(), form));
            }
        }
    }
    if let Some((name, value)) = keys.take_entry(key::HIDE_PX.name) {
        let expected = "`{ \"CAMERA\" = [[LEFT, TOP, WIDTH, HEIGHT]] }`, cameras by name or pattern";
        for (pattern, value) in
            findings.table(&name, value, text, expected).map(|mut it| it.take_rest()).unwrap_or_default()
        {
            let rectangle = |it: &Value<'_>| -> Option<[u32; 4]> {
                let numbers = it.get_ref().as_array()?.iter().map(|it| whole(it.get_ref().as_integer()?));
                let numbers: Option<Vec<u32>> = numbers.map(|it| u32::try_from(it?).ok()).collect();
                numbers?.try_into().ok()
            };
            let list = value.get_ref().as_array().and_then(|it| it.iter().map(rectangle).collect::<Option<Vec<_>>>());
            match list {
                Some(list) => record.hide_px.push((pattern.into_inner(), list)),
                None => findings.not_as_expected(
                    pattern.get_ref(),
                    &value,
                    "rectangles, `[[LEFT, TOP, WIDTH, HEIGHT]]` [px]",
                ),
            }
        }
    }
    if let Some(value) = keys.take(key::HIDE_SCALES.name) {
        let names = value.get_ref().as_array().and_then(|it| {
            let names = it.iter().map(|it| it.get_ref().as_str().map(str::to_owned));
            names.collect::<Option<Vec<_>>>()
        });
        match names {
            Some(names) => record.hide_scales = names,
            None => findings.not_as_expected(key::HIDE_SCALES.name, &value, "names of scales, as `[\"face\"]`"),
        }
    }
    if let Some((packing, _)) = key::COMPRESSION.word(&PACKINGS, &mut keys, findings) {
        record.compression = packing;
    }
    if let Some(memory) = key::MEMORY_MB.whole(&mut keys, findings) {
        record.memory_mb = memory as u32;
    }
    keys.close("`[record]`", findings);
    Some(record)
}
