//! A picture of a file, as one number a pixel.

use std::fs;
use std::io::Cursor;
use std::path::Path;

use foveate::imaging::jpeg;
use image::metadata::Orientation;
use image::{DynamicImage, ImageBuffer, ImageDecoder, ImageFormat, ImageReader, Limits};
use tiff::decoder::{Decoder, DecodingResult};
use tiff::tags::Tag;
use tiff::{ColorType, TiffError};

/// Most memory that a decoder may take [bytes].
const MEMORY_LIMIT: u64 = 1 << 30;

/// A picture as one number a pixel.
pub(crate) struct Gray {
    /// Columns and rows [px].
    pub(crate) size: [u32; 2],
    /// Row by row.
    pub(crate) levels: Levels,
    /// What is to be known of it.
    pub(crate) notes: Vec<Note>,
}

/// Gray levels.
pub(crate) enum Levels {
    /// 0 to 255.
    Eight(Vec<u8>),
    /// 0 to 65535, of which cameras with fewer bits leave the upper ones empty.
    Sixteen(Vec<u16>),
}

/// What is to be known of a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Note {
    /// It has more than 8 bits a channel.
    Wide,
    /// Some pixels are transparent.
    Alpha,
    /// It says that it is to be turned for viewing.
    Turned,
}

/// A picture as one number a pixel; colours as their luma.
///
/// # Errors
/// What is wrong with the file, to stand after its name.
pub(crate) fn decode(path: &Path) -> Result<Gray, String> {
    let bytes = fs::read(path).map_err(|error| format!("cannot be read: {error}"))?;
    if bytes.is_empty() {
        return Err("cannot be decoded: it is empty (0 bytes)".to_owned());
    }
    let (picture, is_turned) = match image::guess_format(&bytes) {
        Ok(ImageFormat::Tiff) => tiff(&bytes)?,
        Ok(kind @ (ImageFormat::Jpeg | ImageFormat::Png | ImageFormat::Bmp | ImageFormat::Pnm)) => {
            if kind == ImageFormat::Jpeg {
                jpeg::check_whole(&bytes)?;
            }
            let mut limits = Limits::default();
            limits.max_alloc = Some(MEMORY_LIMIT);
            let mut reader = ImageReader::with_format(Cursor::new(&bytes), kind);
            reader.limits(limits);
            let broken = |error: image::ImageError| format!("cannot be decoded: {error}");
            let mut decoder = reader.into_decoder().map_err(broken)?;
            let is_turned = decoder.orientation().is_ok_and(|it| it != Orientation::NoTransforms);
            (DynamicImage::from_decoder(decoder).map_err(broken)?, is_turned)
        }
        _ => return Err("cannot be decoded: it is neither PNG, JPEG, TIFF, BMP nor PGM or PPM".to_owned()),
    };
    let color = picture.color();
    let has_alpha = color.has_alpha() && picture.to_rgba8().pixels().any(|it| it[3] != u8::MAX);
    let is_wide = color.bytes_per_pixel() / color.channel_count() > 1;
    let notes = [(is_wide, Note::Wide), (has_alpha, Note::Alpha), (is_turned, Note::Turned)];
    let size = [picture.width(), picture.height()];
    let levels = match is_wide {
        true => Levels::Sixteen(picture.into_luma16().into_raw()),
        false => Levels::Eight(picture.into_luma8().into_raw()),
    };
    Ok(Gray { size, levels, notes: notes.into_iter().filter(|it| it.0).map(|it| it.1).collect() })
}

/// A TIFF of one picture, and whether it says that it is to be turned.
fn tiff(bytes: &[u8]) -> Result<(DynamicImage, bool), String> {
    let broken = |error: TiffError| format!("cannot be decoded: {error}");
    let mut limits = tiff::decoder::Limits::default();
    limits.decoding_buffer_size = MEMORY_LIMIT as usize;
    limits.intermediate_buffer_size = MEMORY_LIMIT as usize;
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(broken)?.with_limits(limits);
    if decoder.more_images() {
        return Err("holds several pictures, expected one: save each as a file of its own".to_owned());
    }
    let (width, height) = decoder.dimensions().map_err(broken)?;
    let colour = decoder.colortype().map_err(broken)?;
    let turned = decoder.find_tag(Tag::Orientation).map_err(broken)?;
    let is_turned = turned.and_then(|it| it.into_u16().ok()).is_some_and(|it| it != 1);
    let levels = decoder.read_image().map_err(broken)?;
    let picture = match (colour, levels) {
        (ColorType::Gray(8), DecodingResult::U8(it)) => {
            ImageBuffer::from_raw(width, height, it).map(DynamicImage::ImageLuma8)
        }
        (ColorType::Gray(16), DecodingResult::U16(it)) => {
            ImageBuffer::from_raw(width, height, it).map(DynamicImage::ImageLuma16)
        }
        (ColorType::RGB(8), DecodingResult::U8(it)) => {
            ImageBuffer::from_raw(width, height, it).map(DynamicImage::ImageRgb8)
        }
        (ColorType::RGB(16), DecodingResult::U16(it)) => {
            ImageBuffer::from_raw(width, height, it).map(DynamicImage::ImageRgb16)
        }
        (ColorType::RGBA(8), DecodingResult::U8(it)) => {
            ImageBuffer::from_raw(width, height, it).map(DynamicImage::ImageRgba8)
        }
        (ColorType::RGBA(16), DecodingResult::U16(it)) => {
            ImageBuffer::from_raw(width, height, it).map(DynamicImage::ImageRgba16)
        }
        (other, _) => return Err(format!("is a TIFF of {other:?}, expected gray, RGB or RGBA of 8 or 16 bits")),
    };
    let picture = picture.ok_or_else(|| "cannot be decoded: it is a truncated TIFF".to_owned())?;
    Ok((picture, is_turned))
}

#[cfg(test)]
mod tests {
    use tiff::encoder::{TiffEncoder, colortype};

    use super::*;

    /// The file `name` with `n` pictures of 4 × 2 pixels whose gray levels are 0, 600, 1200 …
    fn wide(folder: &Path, name: &str, n: usize) -> std::path::PathBuf {
        let path = folder.join(name);
        let mut encoder = TiffEncoder::new(fs::File::create(&path).unwrap()).unwrap();
        let levels: Vec<u16> = (0..8).map(|it| 600 * it).collect();
        (0..n).for_each(|_| encoder.write_image::<colortype::Gray16>(4, 2, &levels).unwrap());
        path
    }

    #[test]
    fn a_tiff_is_read_as_its_bits_and_what_it_lacks_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let path = wide(folder.path(), "1.tif", 1);
        let Gray { size, levels: Levels::Sixteen(levels), notes } = decode(&path).unwrap() else { panic!("8 bits") };
        assert_eq!((size, levels[7], notes), ([4, 2], 4200, vec![Note::Wide]));
        let several = wide(folder.path(), "2.tif", 2);
        assert!(decode(&several).err().unwrap().contains("several pictures, expected one"));
        let whole = fs::read(&path).unwrap();
        fs::write(&path, &whole[..whole.len() / 2]).unwrap();
        assert!(decode(&path).err().unwrap().contains("cannot be decoded"));
        let colours = folder.path().join("3.tif");
        let mut encoder = TiffEncoder::new(fs::File::create(&colours).unwrap()).unwrap();
        encoder.write_image::<colortype::RGB8>(1, 1, &[200, 200, 200]).unwrap();
        let Gray { levels: Levels::Eight(levels), .. } = decode(&colours).unwrap() else { panic!("16 bits") };
        assert_eq!(levels, [200]);
        let broken = folder.path().join("4.tif");
        let mut encoder = TiffEncoder::new(fs::File::create(&broken).unwrap()).unwrap();
        encoder.write_image::<colortype::Gray32Float>(1, 1, &[0.5]).unwrap();
        assert!(decode(&broken).err().unwrap().contains("expected gray, RGB or RGBA of 8 or 16 bits"));
    }
}
