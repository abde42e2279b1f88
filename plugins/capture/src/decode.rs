//! One picture file into an [`Image`], or a sentence about what is wrong with it.
//!
//! Decoders accept truncated files: a JPEG that was cut off is gray from there on, without an error. So a JPEG's own
//! structure is walked first ([`foveate::imaging::jpeg`]), and one without its end marker is refused.

use std::fs::File;
use std::io::{Cursor, Read};
use std::path::Path;

use foveate::prelude::*;
use image::{ColorType, ImageDecoder, ImageFormat, ImageReader, Limits};

use crate::settings::Format;

/// Largest file that is read [bytes].
const FILE_LIMIT: u64 = 256 << 20;
/// Largest picture, per side [px]: a small file may claim any size.
pub(crate) const SIDE_LIMIT: u32 = 16_384;
/// Most memory that a decoder may take [bytes].
const MEMORY_LIMIT: u64 = 1 << 30;

/// Decodes pictures; keeps its buffers.
#[derive(Debug, Default)]
pub(crate) struct Decoder {
    file: Vec<u8>,
    as_stored: Vec<u8>,
}

impl Decoder {
    /// Reads `path` into `image`, whose buffer is used again; `expected` is the size that the picture must have [px].
    /// The orientation tag of a photograph is not followed: pixels stay as the sensor gave them.
    ///
    /// # Errors
    /// What was found instead of a whole picture of that size; `image` is then in no particular state.
    pub(crate) fn read(
        &mut self,
        path: &Path,
        format: Format,
        expected: Option<[u32; 2]>,
        image: &mut Image,
    ) -> Result<(), String> {
        self.file.clear();
        let file = File::open(path).map_err(|error| format!("cannot be opened: {error}"))?;
        let length = file
            .take(FILE_LIMIT + 1)
            .read_to_end(&mut self.file)
            .map_err(|error| format!("cannot be read: {error}"))?;
        if length as u64 > FILE_LIMIT {
            return Err(format!("is larger than {} MiB", FILE_LIMIT >> 20));
        }
        let file = std::mem::take(&mut self.file);
        let result = self.decode(&file, format, expected, image);
        self.file = file;
        result
    }

    /// As [`Self::read`], for a picture that is in memory already.
    ///
    /// # Errors
    /// [`Self::read`]'s.
    pub(crate) fn decode(
        &mut self,
        bytes: &[u8],
        format: Format,
        expected: Option<[u32; 2]>,
        image: &mut Image,
    ) -> Result<(), String> {
        if bytes.is_empty() {
            return Err("is empty (0 bytes)".to_owned());
        }
        let kind = match image::guess_format(bytes) {
            Ok(kind @ (ImageFormat::Jpeg | ImageFormat::Png)) => kind,
            _ => return Err(format!("is neither JPEG nor PNG: it begins with {}", first_bytes(bytes))),
        };
        if kind == ImageFormat::Jpeg {
            foveate::imaging::jpeg::check_whole(bytes)?;
        }
        let broken = |error: image::ImageError| {
            format!("is a broken {}: {error}", if kind == ImageFormat::Jpeg { "JPEG" } else { "PNG" })
        };
        // How large it claims to be is judged below, where the size can be told.
        let mut limits = Limits::default();
        limits.max_alloc = Some(MEMORY_LIMIT);
        let mut reader = ImageReader::with_format(Cursor::new(bytes), kind);
        reader.limits(limits);
        let decoder = reader.into_decoder().map_err(broken)?;
        let (width, height) = decoder.dimensions();
        if let Some([columns, rows]) = expected.filter(|it| *it != [width, height]) {
            return Err(format!("is {width} x {height} px, expected {columns} x {rows} px"));
        }
        if width > SIDE_LIMIT || height > SIDE_LIMIT || width == 0 || height == 0 {
            return Err(format!("claims to be {width} x {height} px, expected 1 to {SIDE_LIMIT} px per side"));
        }
        let stored = decoder.color_type();
        let size = usize::try_from(decoder.total_bytes()).ok().filter(|it| *it as u64 <= MEMORY_LIMIT);
        let size = size.ok_or_else(|| {
            let (needs, most) = (decoder.total_bytes() >> 20, MEMORY_LIMIT >> 20);
            format!("is {width} x {height} px of {stored:?}, which takes {needs} MiB, expected at most {most} MiB")
        })?;
        let as_wanted = matches!((stored, format), (ColorType::L8, Format::Gray) | (ColorType::Rgb8, Format::Rgb));
        let target = if as_wanted { &mut image.pixels } else { &mut self.as_stored };
        target.resize(size, 0);
        decoder.read_image(target).map_err(broken)?;
        if !as_wanted {
            convert(&self.as_stored, stored, format, &mut image.pixels)?;
        }
        (image.width, image.height, image.format) = (width, height, format.pixel_format());
        Ok(())
    }
}

/// Gray and colour into each other, alpha left out, 16 bits cut to the upper 8.
fn convert(stored: &[u8], kind: ColorType, format: Format, pixels: &mut Vec<u8>) -> Result<(), String> {
    let (channels, wide) = match kind {
        ColorType::L8 | ColorType::La8 | ColorType::Rgb8 | ColorType::Rgba8 => {
            (usize::from(kind.channel_count()), false)
        }
        ColorType::L16 | ColorType::La16 | ColorType::Rgb16 | ColorType::Rgba16 => {
            (usize::from(kind.channel_count()), true)
        }
        other => return Err(format!("has pixels of kind {other:?}, expected 8 or 16 bits a channel")),
    };
    let bytes = if wide { 2 } else { 1 };
    // The decoder gives 16-bit samples in the byte order of this machine.
    let upper = if wide && cfg!(target_endian = "little") { 1 } else { 0 };
    let groups = stored.chunks_exact(channels * bytes);
    let (green, blue) = (bytes + upper, 2 * bytes + upper);
    pixels.clear();
    match (format, channels >= 3) {
        (Format::Gray, false) => pixels.extend(groups.map(|it| it[upper])),
        (Format::Gray, true) => pixels.extend(groups.map(|it| luma(it[upper], it[green], it[blue]))),
        (Format::Rgb, false) => pixels.extend(groups.flat_map(|it| [it[upper]; 3])),
        (Format::Rgb, true) => pixels.extend(groups.flat_map(|it| [it[upper], it[green], it[blue]])),
    }
    Ok(())
}

/// Rec. 601 luma, the Y of JPEG, in 1/256.
pub(crate) fn luma(red: u8, green: u8, blue: u8) -> u8 {
    ((77 * u32::from(red) + 150 * u32::from(green) + 29 * u32::from(blue) + 128) >> 8) as u8
}

fn first_bytes(bytes: &[u8]) -> String {
    let start = &bytes[..bytes.len().min(8)];
    if start.iter().all(|it| it.is_ascii_graphic() || it.is_ascii_whitespace()) {
        return format!("`{}`", start.escape_ascii());
    }
    start.iter().map(|it| format!("{it:02x}")).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
pub(crate) mod tests {
    use image::codecs::jpeg::JpegEncoder;
    use image::codecs::png::PngEncoder;
    use image::{ExtendedColorType, ImageEncoder};

    use super::*;

    /// A picture that compresses badly, so that a cut hits the pixels.
    fn texture(width: u32, height: u32, channels: u32) -> Vec<u8> {
        (0..width * height * channels).map(|it| (it.wrapping_mul(2_654_435_761) >> 24) as u8).collect()
    }

    pub(crate) fn jpeg(width: u32, height: u32) -> Vec<u8> {
        let mut bytes = Vec::new();
        let pixels = texture(width, height, 1);
        JpegEncoder::new(&mut bytes).write_image(&pixels, width, height, ExtendedColorType::L8).unwrap();
        bytes
    }

    fn png(pixels: &[u8], width: u32, height: u32, kind: ExtendedColorType) -> Vec<u8> {
        let mut bytes = Vec::new();
        PngEncoder::new(&mut bytes).write_image(pixels, width, height, kind).unwrap();
        bytes
    }

    fn decode(bytes: &[u8], format: Format, expected: Option<[u32; 2]>) -> Result<Image, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture");
        std::fs::write(&path, bytes).unwrap();
        let mut image = Image::default();
        Decoder::default().read(&path, format, expected, &mut image)?;
        assert_eq!(image.pixels.len(), image.width as usize * image.height as usize * image.format.channels());
        Ok(image)
    }

    #[test]
    fn png_comes_out_as_it_went_in() {
        let gray = texture(7, 5, 1);
        assert_eq!(decode(&png(&gray, 7, 5, ExtendedColorType::L8), Format::Gray, None).unwrap().pixels, gray);
        let rgb = texture(7, 5, 3);
        let bytes = png(&rgb, 7, 5, ExtendedColorType::Rgb8);
        let image = decode(&bytes, Format::Rgb, Some([7, 5])).unwrap();
        assert_eq!((image.width, image.height, image.format), (7, 5, PixelFormat::Rgb8));
        assert_eq!(image.pixels, rgb);
        let luma = decode(&bytes, Format::Gray, None).unwrap().pixels;
        for (found, pixel) in luma.iter().zip(rgb.chunks(3)) {
            let exact = 0.299 * f64::from(pixel[0]) + 0.587 * f64::from(pixel[1]) + 0.114 * f64::from(pixel[2]);
            assert!((f64::from(*found) - exact).abs() < 1.2, "{found} for {exact}");
        }
    }

    #[test]
    fn sixteen_bits_and_alpha_are_reduced_to_gray() {
        let rgba = [10, 20, 30, 0, 200, 200, 200, 255];
        assert_eq!(decode(&png(&rgba, 2, 1, ExtendedColorType::Rgba8), Format::Gray, None).unwrap().pixels, [18, 200]);
        let wide: Vec<u8> = [0x1234_u16, 0xfe00].iter().flat_map(|it| it.to_ne_bytes()).collect();
        let bytes = png(&wide, 2, 1, ExtendedColorType::L16);
        assert_eq!(decode(&bytes, Format::Gray, None).unwrap().pixels, [0x12, 0xfe]);
        assert_eq!(decode(&bytes, Format::Rgb, None).unwrap().pixels, [0x12, 0x12, 0x12, 0xfe, 0xfe, 0xfe]);
    }

    #[test]
    fn every_cut_through_a_jpeg_is_noticed() {
        let whole = jpeg(64, 48);
        assert!(decode(&whole, Format::Gray, Some([64, 48])).is_ok());
        for length in (1..whole.len() - 1).step_by(37).chain([whole.len() - 2, whole.len() - 1]) {
            let refused = decode(&whole[..length], Format::Gray, None);
            assert!(refused.is_err(), "{length} of {} bytes were taken for a whole picture", whole.len());
        }
        let half = decode(&whole[..whole.len() / 2], Format::Gray, None).unwrap_err();
        assert!(half.contains("truncated JPEG"), "{half}");
    }

    #[test]
    fn every_cut_through_a_png_is_noticed() {
        let whole = png(&texture(64, 48, 1), 64, 48, ExtendedColorType::L8);
        for length in (1..whole.len() - 16).step_by(37) {
            assert!(decode(&whole[..length], Format::Gray, None).is_err(), "{length} of {} bytes", whole.len());
        }
    }

    #[test]
    fn other_content_is_named() {
        assert!(decode(b"", Format::Gray, None).unwrap_err().contains("empty"));
        assert!(decode(b"GIF89a..", Format::Gray, None).unwrap_err().contains("`GIF89a..`"));
        assert!(decode(b"hi\n", Format::Gray, None).unwrap_err().contains("`hi\\n`"));
        assert!(decode(&[0, 1, 2], Format::Gray, None).unwrap_err().contains("00 01 02"));
        let mut corrupt = jpeg(64, 48);
        corrupt[30..120].fill(7);
        assert!(decode(&corrupt, Format::Gray, None).unwrap_err().contains("JPEG"));
    }

    #[test]
    fn wrong_size_says_both_sizes() {
        let refused = decode(&jpeg(64, 48), Format::Gray, Some([640, 480])).unwrap_err();
        assert_eq!(refused, "is 64 x 48 px, expected 640 x 480 px");
    }

    #[test]
    fn claimed_size_is_refused_before_memory_is_taken() {
        // The check sum of a PNG's header, ISO/IEC 15948 annex D.
        let crc = |bytes: &[u8]| {
            !bytes.iter().fold(u32::MAX, |crc, byte| {
                (0..8).fold(crc ^ u32::from(*byte), |it, _| if it & 1 == 1 { 0xEDB8_8320 ^ (it >> 1) } else { it >> 1 })
            })
        };
        let claims = |size: u32| {
            let mut bomb = png(&[0; 4], 2, 2, ExtendedColorType::L8);
            bomb[16..20].copy_from_slice(&size.to_be_bytes());
            bomb[20..24].copy_from_slice(&size.to_be_bytes());
            let sum = crc(&bomb[12..29]);
            bomb[29..33].copy_from_slice(&sum.to_be_bytes());
            decode(&bomb, Format::Gray, None).unwrap_err()
        };
        let refused = claims(65_535);
        assert!(refused.contains("65535 x 65535 px, expected 1 to 16384 px per side"), "{refused}");
        assert!(!claims(3).contains("16384"), "a header in order, and too little after it");
    }

    #[test]
    fn random_damage_never_panics() {
        let whole = jpeg(48, 32);
        let mut state = 1_u32;
        for _ in 0..300 {
            let mut damaged = whole.clone();
            for _ in 0..4 {
                state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                let place = (state >> 8) as usize % damaged.len();
                damaged[place] = state as u8;
            }
            drop(decode(&damaged, Format::Gray, None));
        }
    }
}
