//! Pictures in a session: as they are, packed as JPEG, or not at all; in the form that viewers read.

use std::sync::Arc;

use foveate_messages::{Image, PixelFormat, Stamp};
use foveate_node::guard::guarded;
use foveate_node::io::Packet;
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;

use crate::viewer::{self, Kind, PictureHeader};

/// How pictures are recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Pictures {
    /// Every level of every pixel.
    #[default]
    Lossless,
    /// As JPEG of this quality, 1 to 100: a replay from pixels is then near, and not the same.
    Jpeg(u8),
    /// Not at all.
    None,
}

impl Pictures {
    /// The kind of message that a picture becomes.
    pub fn kind(self) -> Kind {
        match self {
            Pictures::Jpeg(_) => Kind::CompressedImage,
            Pictures::Lossless | Pictures::None => Kind::RawImage,
        }
    }

    /// A picture as bytes, in place of what is in `out`.
    ///
    /// # Errors
    /// Why it cannot be packed.
    pub fn encode(self, stamp: &Stamp, image: &Image, frame: &str, out: &mut Vec<u8>) -> Result<(), String> {
        let Pictures::Jpeg(quality) = self else {
            viewer::raw_image(stamp, image, frame, out);
            return Ok(());
        };
        let mut jpeg = Vec::with_capacity(image.pixels.len() / 4);
        let colours = match image.format {
            PixelFormat::Gray8 => ExtendedColorType::L8,
            PixelFormat::Rgb8 => ExtendedColorType::Rgb8,
        };
        let n_bytes = u64::from(image.width) * u64::from(image.height) * image.format.channels() as u64;
        if n_bytes != image.pixels.len() as u64 {
            return Err(format!("a picture of {} x {} px has {} bytes", image.width, image.height, image.pixels.len()));
        }
        let packed =
            JpegEncoder::new_with_quality(&mut jpeg, quality).encode(&image.pixels, image.width, image.height, colours);
        packed.map_err(|error| error.to_string())?;
        viewer::compressed_image(stamp, &PictureHeader::from(image), &jpeg, frame, out);
        Ok(())
    }
}

/// Reads what [`Pictures::encode`] wrote, as a message; `schema` is the name of the schema of its channel.
///
/// # Errors
/// What is wrong with it.
pub fn decode(schema: &str, bytes: &[u8]) -> Result<Packet, String> {
    let (stamp, image) = read(schema, bytes)?;
    Ok(Packet { stamp, payload: Arc::new(image) })
}

/// Whether messages of this schema are pictures.
pub fn is_picture(schema: &str) -> bool {
    [Kind::RawImage, Kind::CompressedImage].iter().any(|it| it.name() == schema)
}

/// Reads what [`Pictures::encode`] wrote.
///
/// # Errors
/// What is wrong with it.
pub fn read(schema: &str, bytes: &[u8]) -> Result<(Stamp, Image), String> {
    let is_raw = schema == Kind::RawImage.name();
    let read = if is_raw { viewer::read_raw_image(bytes)? } else { viewer::read_compressed_image(bytes)? };
    let content = &bytes[read.content.clone()];
    let pixels = if is_raw { content.to_vec() } else { unpack(content, &read.header)? };
    Ok((read.stamp, read.header.with_pixels(pixels)))
}

fn unpack(jpeg: &[u8], header: &PictureHeader) -> Result<Vec<u8>, String> {
    let picture = guarded(|| image::load_from_memory_with_format(jpeg, image::ImageFormat::Jpeg))?;
    let picture = picture.map_err(|error| error.to_string())?;
    if (picture.width(), picture.height()) != (header.width, header.height) {
        let (width, height) = (picture.width(), picture.height());
        return Err(format!("found a JPEG of {width} x {height} px, expected {} x {} px", header.width, header.height));
    }
    Ok(match header.format {
        PixelFormat::Gray8 => picture.into_luma8().into_raw(),
        PixelFormat::Rgb8 => picture.into_rgb8().into_raw(),
    })
}
