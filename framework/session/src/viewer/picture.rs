//! Pictures: `foxglove.RawImage` and `foxglove.CompressedImage`, and back.
//!
//! Viewers read the fields of the public schemas. What these cannot say (stamp, camera, window) lies in one more field, `foveate_picture`, which viewers skip.

use std::ops::Range;

use foveate_messages::{CameraId, Image, PixelFormat, SourceId, Stamp, Time, Window};

use super::schemas::{compressed_image, picture, raw_image};
use super::wire::{Reader, Value, Writer};

/// Upper bound of a picture's message without its pixels and the name of its frame [bytes].
const ROOM: usize = 192;

/// All of an [`Image`] but its pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PictureHeader {
    /// The camera that saw it.
    pub camera: CameraId,
    /// Columns [px].
    pub width: u32,
    /// Rows [px].
    pub height: u32,
    /// How to read the pixels.
    pub format: PixelFormat,
    /// Which part of the camera's picture this is.
    pub window: Window,
}

impl PictureHeader {
    /// The picture of these pixels.
    pub fn with_pixels(self, pixels: Vec<u8>) -> Image {
        let PictureHeader { camera, width, height, format, window } = self;
        Image { camera, width, height, format, pixels, window }
    }

    fn row_bytes(&self) -> u64 {
        u64::from(self.width) * self.format.channels() as u64
    }
}

impl From<&Image> for PictureHeader {
    fn from(image: &Image) -> Self {
        let &Image { camera, width, height, format, window, .. } = image;
        Self { camera, width, height, format, window }
    }
}

/// A picture in a message that was read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RecordedPicture {
    /// The stamp that it was recorded with.
    pub stamp: Stamp,
    /// What it is of.
    pub header: PictureHeader,
    /// Where in the message its content lies: pixels as in [`Image::pixels`], or a whole JPEG file.
    pub content: Range<usize>,
}

/// A `foxglove.RawImage`, its encoding `mono8` or `rgb8`. The pixels are copied once. [`read_raw_image`] refuses an image whose number of pixels is wrong.
pub fn raw_image(stamp: &Stamp, image: &Image, frame: &str, out: &mut Vec<u8>) {
    let header = PictureHeader::from(image);
    let mut it = Writer::new(out);
    it.reserve(image.pixels.len() + frame.len() + ROOM);
    it.time(raw_image::timestamp, stamp.time);
    it.string(raw_image::frame_id, frame);
    it.fixed32(raw_image::width, header.width);
    it.fixed32(raw_image::height, header.height);
    it.string(raw_image::encoding, encoding(header.format));
    it.fixed32(raw_image::step, header.row_bytes() as u32);
    it.message(raw_image::foveate_picture, |it| write_header(it, stamp, &header));
    it.bytes(raw_image::data, &image.pixels);
}

/// A `foxglove.CompressedImage` of a whole JPEG file, which is copied as it is.
pub fn compressed_image(stamp: &Stamp, header: &PictureHeader, jpeg: &[u8], frame: &str, out: &mut Vec<u8>) {
    let mut it = Writer::new(out);
    it.reserve(jpeg.len() + frame.len() + ROOM);
    it.time(compressed_image::timestamp, stamp.time);
    it.string(compressed_image::frame_id, frame);
    it.string(compressed_image::format, "jpeg");
    it.message(compressed_image::foveate_picture, |it| write_header(it, stamp, header));
    it.bytes(compressed_image::data, jpeg);
}

/// What [`raw_image()`] wrote; `Err` says why `bytes` are nothing of the kind. The content is as long as the header says.
pub fn read_raw_image(bytes: &[u8]) -> Result<RecordedPicture, String> {
    let read = read(bytes, raw_image::foveate_picture, raw_image::data)?;
    let (expected, found) = (read.header.row_bytes().checked_mul(read.header.height.into()), read.content.len() as u64);
    if expected != Some(found) {
        let PictureHeader { width, height, format, .. } = read.header;
        return Err(format!("the picture has {found} bytes, not {width} × {height} × {}", format.channels()));
    }
    Ok(read)
}

/// What [`compressed_image()`] wrote; `Err` says why `bytes` are nothing of the kind. Whether the content is a JPEG file is for its decoder to say.
pub fn read_compressed_image(bytes: &[u8]) -> Result<RecordedPicture, String> {
    read(bytes, compressed_image::foveate_picture, compressed_image::data)
}

/// As viewers call it.
const fn encoding(format: PixelFormat) -> &'static str {
    match format {
        PixelFormat::Gray8 => "mono8",
        PixelFormat::Rgb8 => "rgb8",
    }
}

fn write_header(out: &mut Writer<'_>, stamp: &Stamp, header: &PictureHeader) {
    out.fixed64(picture::time, stamp.time.0 as u64);
    out.fixed32(picture::source, stamp.source.0);
    out.fixed64(picture::sequence, stamp.sequence);
    out.fixed32(picture::camera, header.camera.0.into());
    out.fixed32(picture::width, header.width);
    out.fixed32(picture::height, header.height);
    out.fixed32(picture::channels, header.format.channels() as u32);
    out.fixed32(picture::left, header.window.left);
    out.fixed32(picture::top, header.window.top);
    out.fixed32(picture::shrink, header.window.shrink);
}

fn read(bytes: &[u8], header_field: u32, content_field: u32) -> Result<RecordedPicture, String> {
    let (mut header, mut content) = (None, None);
    for field in Reader::new(bytes) {
        match field? {
            (field, Value::Bytes(range)) if field == header_field => header = Some(range),
            (field, Value::Bytes(range)) if field == content_field => content = Some(range),
            _ => {}
        }
    }
    let header = header.ok_or("the picture has no field `foveate_picture`: something else recorded it")?;
    let (stamp, header) = read_header(&bytes[header])?;
    Ok(RecordedPicture { stamp, header, content: content.ok_or("the picture has no field `data`")? })
}

fn read_header(bytes: &[u8]) -> Result<(Stamp, PictureHeader), String> {
    // By field number, all of them; 0 is none.
    let mut values = [None; picture::shrink as usize + 1];
    for field in Reader::new(bytes) {
        let (number, value) = field?;
        let value = match value {
            Value::Fixed32(it) => u64::from(it),
            Value::Fixed64(it) => it,
            Value::Varint(_) | Value::Bytes(_) => continue,
        };
        if let Some(place) = values.get_mut(number as usize) {
            *place = Some(value);
        }
    }
    let wide = |field: u32| values[field as usize].ok_or(format!("`foveate_picture` has no field {field}"));
    let narrow = |field: u32| wide(field).and_then(|it| u32::try_from(it).map_err(|_| too_large(field, it)));
    let camera = narrow(picture::camera)?;
    let camera = u16::try_from(camera).map_err(|_| too_large(picture::camera, camera.into()))?;
    let format = match narrow(picture::channels)? {
        1 => PixelFormat::Gray8,
        3 => PixelFormat::Rgb8,
        other => return Err(format!("`foveate_picture` has pixels of {other} bytes, not 1 or 3")),
    };
    let window = Window { left: narrow(picture::left)?, top: narrow(picture::top)?, shrink: narrow(picture::shrink)? };
    if window.shrink == 0 {
        return Err("`foveate_picture` has a window that shrinks by 0".to_owned());
    }
    let stamp = Stamp {
        time: Time(wide(picture::time)? as i64),
        source: SourceId(narrow(picture::source)?),
        sequence: wide(picture::sequence)?,
    };
    let (width, height) = (narrow(picture::width)?, narrow(picture::height)?);
    Ok((stamp, PictureHeader { camera: CameraId(camera), width, height, format, window }))
}

fn too_large(field: u32, found: u64) -> String {
    format!("field {field} of `foveate_picture` is {found}: too large")
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::decoded::Decoded;
    use super::super::{Kind, schemas};
    use super::*;

    fn stamp() -> Stamp {
        Stamp { time: Time(-1_500_000_000), source: SourceId(u32::MAX), sequence: u64::MAX - 4 }
    }

    fn image(format: PixelFormat) -> Image {
        let n = 3 * 2 * format.channels() as u8;
        let window = Window { left: 640, top: 8, shrink: 2 };
        Image { camera: CameraId(513), width: 3, height: 2, format, pixels: (0..n).collect(), window }
    }

    fn encoded(image: &Image) -> Vec<u8> {
        let mut out = b"of the picture before".to_vec();
        raw_image(&stamp(), image, "left", &mut out);
        out
    }

    #[test]
    fn a_picture_has_the_fields_that_viewers_read() {
        let rgb = Decoded::of(Kind::RawImage, &encoded(&image(PixelFormat::Rgb8)));
        assert_eq!((rgb.number("timestamp.seconds"), rgb.number("timestamp.nanos")), (-2.0, 5e8));
        assert_eq!((rgb.text("frame_id"), rgb.text("encoding")), ("left", "rgb8"));
        assert_eq!(["width", "height", "step"].map(|it| rgb.number(it)), [3.0, 2.0, 9.0]);
        assert_eq!(rgb.bytes("data"), (0..18).collect::<Vec<u8>>());
        let gray = Decoded::of(Kind::RawImage, &encoded(&image(PixelFormat::Gray8)));
        assert_eq!((gray.text("encoding"), gray.number("step"), gray.bytes("data").len()), ("mono8", 3.0, 6));
    }

    #[test]
    fn a_picture_comes_back_as_it_was() {
        for format in [PixelFormat::Gray8, PixelFormat::Rgb8] {
            let (image, bytes) = (image(format), encoded(&image(format)));
            let read = read_raw_image(&bytes).unwrap();
            assert_eq!(read.stamp, stamp());
            assert_eq!(read.header.with_pixels(bytes[read.content].to_vec()), image);
        }
    }

    #[test]
    fn a_jpeg_comes_back_as_it_was() {
        let header = PictureHeader::from(&image(PixelFormat::Rgb8));
        let mut out = Vec::new();
        compressed_image(&stamp(), &header, b"\xff\xd8 and so on", "right", &mut out);
        let decoded = Decoded::of(Kind::CompressedImage, &out);
        assert_eq!((decoded.text("frame_id"), decoded.text("format")), ("right", "jpeg"));
        assert_eq!(decoded.bytes("data"), b"\xff\xd8 and so on");
        let read = read_compressed_image(&out).unwrap();
        assert_eq!((read.stamp, read.header), (stamp(), header));
        assert_eq!(&out[read.content], b"\xff\xd8 and so on");
    }

    #[test]
    fn a_picture_is_encoded_into_memory_that_is_there() {
        let large = Image { width: 640, height: 480, pixels: vec![1; 640 * 480], ..Image::default() };
        let mut out = Vec::new();
        raw_image(&stamp(), &large, "a frame of some camera", &mut out);
        let (place, room) = (out.as_ptr(), out.capacity());
        assert!(room <= large.pixels.len() + 22 + ROOM, "{room} bytes: it was reserved once");
        raw_image(&stamp(), &large, "a frame of some camera", &mut out);
        assert_eq!((out.as_ptr(), out.capacity()), (place, room));
    }

    #[test]
    fn what_is_wrong_is_said() {
        let why = |bytes: &[u8]| read_raw_image(bytes).unwrap_err();
        let mut short = image(PixelFormat::Gray8);
        short.pixels.pop();
        assert_eq!(why(&encoded(&short)), "the picture has 5 bytes, not 3 × 2 × 1");
        assert!(why(&[]).contains("no field `foveate_picture`"));
        let shrunk = Image { window: Window { shrink: 0, ..Window::default() }, ..image(PixelFormat::Gray8) };
        assert!(why(&encoded(&shrunk)).contains("shrinks by 0"));
        let mut out = Vec::new();
        Writer::new(&mut out).message(schemas::raw_image::foveate_picture, |it| it.fixed32(picture::camera, 65_536));
        assert_eq!(why(&out), "field 4 of `foveate_picture` is 65536: too large");
    }

    #[test]
    fn a_picture_that_is_cut_off_anywhere_is_refused() {
        let bytes = encoded(&image(PixelFormat::Rgb8));
        for end in 0..bytes.len() {
            assert!(read_raw_image(&bytes[..end]).is_err(), "cut off at {end}");
        }
    }

    proptest! {
        #[test]
        fn no_bytes_make_the_reader_panic(
            random in proptest::collection::vec(any::<u8>(), 0..200),
            place in any::<prop::sample::Index>(),
            byte in any::<u8>(),
        ) {
            let mut changed = encoded(&image(PixelFormat::Gray8));
            let place = place.index(changed.len());
            changed[place] = byte;
            for bytes in [&random, &changed] {
                for read in [read_raw_image(bytes), read_compressed_image(bytes)].into_iter().flatten() {
                    prop_assert!(read.content.end <= bytes.len());
                }
            }
        }
    }
}
