//! The pixel layouts of cameras into gray or red, green, blue.
//!
//! Gray is the luma as the camera sends it, deeper layouts cut to their upper 8 bits. Colours come by Rec. 601 out of the
//! range that the driver states; a driver that states none means 16 to 235, as V4L2 lays down.

use foveate::prelude::*;

use super::device::{FourCc, Layout};
use super::huffman::with_tables;
use crate::decode::{Decoder, luma};
use crate::settings::Format;

/// How a layout is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Reading {
    Gray,
    /// Little-endian 16 bits, of which so many are used from below.
    Deep(u32),
    /// Two pixels in four bytes; place of the first luma and of the chroma byte U.
    Pairs {
        luma: usize,
        u: usize,
        v: usize,
    },
    /// Three bytes; places of red and blue.
    Colours {
        red: usize,
        blue: usize,
    },
    Jpeg,
}

const LAYOUTS: [(&FourCc, Reading); 11] = [
    (b"GREY", Reading::Gray),
    (b"YUYV", Reading::Pairs { luma: 0, u: 1, v: 3 }),
    (b"UYVY", Reading::Pairs { luma: 1, u: 0, v: 2 }),
    (b"YVYU", Reading::Pairs { luma: 0, u: 3, v: 1 }),
    (b"Y16 ", Reading::Deep(16)),
    (b"Y12 ", Reading::Deep(12)),
    (b"Y10 ", Reading::Deep(10)),
    (b"RGB3", Reading::Colours { red: 0, blue: 2 }),
    (b"BGR3", Reading::Colours { red: 2, blue: 0 }),
    (b"MJPG", Reading::Jpeg),
    (b"JPEG", Reading::Jpeg),
];

/// The layouts that can be read, those that cost least first where `format` is wanted.
pub(crate) fn readable(format: Format) -> Vec<FourCc> {
    let is_costly = |reading: Reading| match reading {
        Reading::Jpeg => 2,
        Reading::Gray | Reading::Deep(_) => u8::from(format == Format::Rgb) * 3,
        Reading::Colours { .. } => u8::from(format == Format::Gray),
        Reading::Pairs { .. } => u8::from(format == Format::Rgb),
    };
    let mut layouts: Vec<_> = LAYOUTS.iter().map(|&(name, reading)| (is_costly(reading), *name)).collect();
    layouts.sort_by_key(|it| it.0);
    layouts.into_iter().map(|it| it.1).collect()
}

/// Reads what camera `camera` sent into `image`, whose buffer is used again.
///
/// # Errors
/// What is wrong with the picture; `image` is then in no particular state.
pub(crate) fn read(
    layout: &Layout,
    bytes: &[u8],
    format: Format,
    decoder: &mut Decoder,
    image: &mut Image,
) -> Result<(), String> {
    let [width, height] = layout.size;
    let Some(&(_, reading)) = LAYOUTS.iter().find(|it| *it.0 == layout.fourcc) else {
        return Err(format!("is in the layout `{}`, which cannot be read", in_letters(layout.fourcc)));
    };
    if reading == Reading::Jpeg {
        return decoder.decode(&with_tables(bytes), format, Some(layout.size), image);
    }
    let row_bytes = width as usize * bytes_a_pixel(reading);
    let stride = (layout.stride as usize).max(row_bytes);
    let needed = stride * (height as usize).saturating_sub(1) + row_bytes;
    if bytes.len() < needed {
        return Err(format!("has {} bytes, expected {needed}", bytes.len()));
    }
    (image.width, image.height, image.format) = (width, height, format.pixel_format());
    let pixels = &mut image.pixels;
    pixels.clear();
    for row in bytes.chunks(stride).take(height as usize) {
        read_row(reading, &row[..row_bytes], format, layout.full_range, pixels);
    }
    Ok(())
}

fn bytes_a_pixel(reading: Reading) -> usize {
    match reading {
        Reading::Gray => 1,
        Reading::Deep(_) | Reading::Pairs { .. } => 2,
        Reading::Colours { .. } => 3,
        Reading::Jpeg => 0,
    }
}

fn read_row(reading: Reading, row: &[u8], format: Format, full_range: bool, pixels: &mut Vec<u8>) {
    match (reading, format) {
        (Reading::Gray, Format::Gray) => pixels.extend_from_slice(row),
        (Reading::Gray, Format::Rgb) => pixels.extend(row.iter().flat_map(|&it| [it; 3])),
        (Reading::Deep(bits), _) => {
            let upper = row.chunks_exact(2).map(|it| (u16::from_le_bytes([it[0], it[1]]) >> (bits - 8)).min(255) as u8);
            match format {
                Format::Gray => pixels.extend(upper),
                Format::Rgb => pixels.extend(upper.flat_map(|it| [it; 3])),
            }
        }
        (Reading::Pairs { luma, .. }, Format::Gray) => pixels.extend(row.iter().skip(luma).step_by(2)),
        (Reading::Pairs { luma, u, v }, Format::Rgb) => {
            let pairs = row.chunks(4).filter(|it| it.len() == 4);
            pixels.extend(pairs.flat_map(|it| {
                let [first, second] = [it[luma], it[luma + 2]].map(|y| colours(y, it[u], it[v], full_range));
                [first[0], first[1], first[2], second[0], second[1], second[2]]
            }));
        }
        (Reading::Colours { red, blue }, Format::Gray) => {
            pixels.extend(row.chunks_exact(3).map(|it| luma(it[red], it[1], it[blue])));
        }
        (Reading::Colours { red, blue }, Format::Rgb) => {
            pixels.extend(row.chunks_exact(3).flat_map(|it| [it[red], it[1], it[blue]]));
        }
        (Reading::Jpeg, _) => unreachable!("compressed pictures have no rows"),
    }
}

/// Rec. 601 in 1/65536, rounded.
fn colours(y: u8, u: u8, v: u8, full_range: bool) -> [u8; 3] {
    // Full range: R = Y + 1.402 V, G = Y − 0.344136 U − 0.714136 V, B = Y + 1.772 U. Limited: Y' = 255/219 (Y − 16), U and V times 255/224.
    let (scale, black, to_red, u_to_green, v_to_green, to_blue) = if full_range {
        (65_536, 0, 91_881, 22_554, 46_802, 116_130)
    } else {
        (76_309, 16, 104_597, 25_675, 53_279, 132_201)
    };
    let luma = (i32::from(y) - black) * scale + 32_768;
    let (u, v) = (i32::from(u) - 128, i32::from(v) - 128);
    [luma + to_red * v, luma - u_to_green * u - v_to_green * v, luma + to_blue * u]
        .map(|it| (it >> 16).clamp(0, 255) as u8)
}

/// `YUYV`, with what is no letter replaced.
pub(crate) fn in_letters(fourcc: FourCc) -> String {
    fourcc.iter().map(|&it| if it.is_ascii_graphic() || it == b' ' { char::from(it) } else { '?' }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::tests::jpeg;

    fn layout(fourcc: &FourCc, size: [u32; 2], stride: u32) -> Layout {
        Layout { fourcc: *fourcc, size, stride, full_range: true, period: None }
    }

    #[track_caller]
    fn pixels(layout: Layout, bytes: &[u8], format: Format) -> Result<Vec<u8>, String> {
        let mut image = Image { pixels: vec![7; 5], ..Image::default() };
        read(&layout, bytes, format, &mut Decoder::default(), &mut image)?;
        assert_eq!([image.width, image.height], layout.size);
        assert_eq!(image.pixels.len(), (image.width * image.height) as usize * image.format.channels());
        Ok(image.pixels)
    }

    #[test]
    fn padding_at_the_end_of_rows_is_left_out_and_the_last_row_may_lack_it() {
        let padded = layout(b"GREY", [2, 3], 4);
        assert_eq!(pixels(padded, &[1, 2, 0, 0, 3, 4, 0, 0, 5, 6], Format::Gray).unwrap(), [1, 2, 3, 4, 5, 6]);
        assert_eq!(pixels(padded, &[1, 2, 0, 0, 3, 4, 0, 0, 5], Format::Gray).unwrap_err(), "has 9 bytes, expected 10");
        let pairs = layout(b"YUYV", [2, 2], 6);
        assert_eq!(pixels(pairs, &[1, 9, 2, 9, 0, 0, 3, 9, 4, 9, 0, 0], Format::Gray).unwrap(), [1, 2, 3, 4]);
        assert_eq!(pixels(layout(b"GREY", [2, 1], 0), &[1, 2], Format::Rgb).unwrap(), [1, 1, 1, 2, 2, 2]);
    }

    #[test]
    fn luma_stands_where_the_layout_says() {
        for (fourcc, expected) in [(b"YUYV", [10, 30]), (b"YVYU", [10, 30]), (b"UYVY", [20, 40])] {
            assert_eq!(pixels(layout(fourcc, [2, 1], 4), &[10, 20, 30, 40], Format::Gray).unwrap(), expected);
        }
    }

    /// Luma and chroma of a colour by the definition, Kr = 0.299 and Kb = 0.114.
    fn chroma(rgb: [u8; 3], full_range: bool) -> [u8; 3] {
        let [r, g, b] = rgb.map(|it| f64::from(it) / 255.0);
        let y = 0.299 * r + 0.587 * g + 0.114 * b;
        let (u, v) = ((b - y) / 1.772, (r - y) / 1.402);
        let (low, luma, colour) = if full_range { (0.0, 255.0, 255.0) } else { (16.0, 219.0, 224.0) };
        [low + luma * y, 128.0 + colour * u, 128.0 + colour * v].map(|it| it.round().clamp(0.0, 255.0) as u8)
    }

    #[test]
    fn colours_come_back_out_of_luma_and_chroma() {
        for full_range in [true, false] {
            for rgb in [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255], [0, 0, 0], [200, 30, 90], [17, 99, 201]]
            {
                let [y, u, v] = chroma(rgb, full_range);
                for (fourcc, bytes) in [(b"YUYV", [y, u, y, v]), (b"YVYU", [y, v, y, u]), (b"UYVY", [u, y, v, y])] {
                    let layout = Layout { full_range, ..layout(fourcc, [2, 1], 4) };
                    let found = pixels(layout, &bytes, Format::Rgb).unwrap();
                    for (found, expected) in found.iter().zip(rgb.iter().chain(&rgb)) {
                        assert!(found.abs_diff(*expected) <= 2, "{found:?} for {rgb:?}, full range {full_range}");
                    }
                }
            }
        }
    }

    #[test]
    fn deep_pixels_keep_their_upper_bits_and_saturate() {
        let bytes = [0xff, 0x03, 0x00, 0x02, 0xff, 0xff];
        assert_eq!(pixels(layout(b"Y10 ", [3, 1], 6), &bytes, Format::Gray).unwrap(), [255, 128, 255]);
        assert_eq!(pixels(layout(b"Y12 ", [3, 1], 6), &bytes, Format::Gray).unwrap(), [63, 32, 255]);
        assert_eq!(pixels(layout(b"Y16 ", [3, 1], 6), &bytes, Format::Gray).unwrap(), [3, 2, 255]);
    }

    #[test]
    fn three_bytes_are_read_in_their_order() {
        assert_eq!(pixels(layout(b"BGR3", [1, 1], 3), &[1, 2, 3], Format::Rgb).unwrap(), [3, 2, 1]);
        assert_eq!(pixels(layout(b"RGB3", [1, 1], 3), &[255, 0, 0], Format::Gray).unwrap(), [77]);
        assert_eq!(pixels(layout(b"BGR3", [1, 1], 3), &[255, 0, 0], Format::Gray).unwrap(), [29]);
    }

    /// The picture without its Huffman tables, as many USB cameras send it.
    fn without_tables(jpeg: &[u8]) -> Vec<u8> {
        let mut bytes = jpeg[..2].to_vec();
        let mut at = 2;
        while jpeg[at + 1] != 0xda {
            let length = 2 + usize::from(u16::from_be_bytes([jpeg[at + 2], jpeg[at + 3]]));
            if jpeg[at + 1] != 0xc4 {
                bytes.extend_from_slice(&jpeg[at..at + length]);
            }
            at += length;
        }
        bytes.extend_from_slice(&jpeg[at..]);
        bytes
    }

    #[test]
    fn compressed_pictures_are_read_also_without_their_tables_and_with_a_padded_end() {
        let whole = jpeg(32, 16);
        let motion = layout(b"MJPG", [32, 16], 0);
        let expected = pixels(motion, &whole, Format::Gray).unwrap();
        let bare = without_tables(&whole);
        assert!(bare.len() + 100 < whole.len());
        assert_eq!(pixels(motion, &[&bare[..], &[0; 64]].concat(), Format::Gray).unwrap(), expected);
        assert!(pixels(motion, &whole[..whole.len() / 2], Format::Gray).unwrap_err().contains("truncated"));
        assert!(pixels(motion, &jpeg(16, 16), Format::Gray).unwrap_err().contains("16 x 16 px, expected 32 x 16"));
        assert!(pixels(motion, &[], Format::Gray).unwrap_err().contains("empty"));
    }

    #[test]
    fn cheapest_layout_comes_first() {
        assert_eq!(readable(Format::Gray)[0], *b"GREY");
        assert_eq!(readable(Format::Rgb)[0], *b"RGB3");
        assert!(pixels(layout(b"H264", [2, 2], 0), &[0; 9], Format::Gray).unwrap_err().contains("`H264`"));
    }
}
