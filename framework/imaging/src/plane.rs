//! One plane out of interleaved RGB.

use crate::ImagingError;

/// Which plane of an RGB picture is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Channel {
    /// (77 R + 150 G + 29 B) / 256, rounded: the weights of ITU-R BT.601 luma.
    #[default]
    Luma,
    /// Red: for red LEDs, which luma would dim to 30 %.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
    /// The brightest of the three: no LED colour is dimmed, at the price of the noisiest background.
    Max,
}

/// Fills `plane` with one byte for each three of `rgb`; its memory is reused.
///
/// [`ImagingError::WrongLength`] when `rgb` is not a whole number of pixels.
pub fn extract(channel: Channel, rgb: &[u8], plane: &mut Vec<u8>) -> Result<(), ImagingError> {
    let (triples, rest) = rgb.as_chunks::<3>();
    if !rest.is_empty() {
        return Err(ImagingError::WrongLength { what: "RGB picture", expected: triples.len() * 3, found: rgb.len() });
    }
    plane.resize(triples.len(), 0);
    match channel {
        Channel::Luma => fill(plane, triples, |&[r, g, b]| {
            ((77 * u16::from(r) + 150 * u16::from(g) + 29 * u16::from(b) + 128) >> 8) as u8
        }),
        Channel::Red => fill(plane, triples, |it| it[0]),
        Channel::Green => fill(plane, triples, |it| it[1]),
        Channel::Blue => fill(plane, triples, |it| it[2]),
        Channel::Max => fill(plane, triples, |&[r, g, b]| r.max(g).max(b)),
    }
    Ok(())
}

/// `plane[i] = of(triples[i])`; one loop for each channel, so that each is vectorised on its own.
fn fill(plane: &mut [u8], triples: &[[u8; 3]], of: impl Fn(&[u8; 3]) -> u8) {
    for (out, triple) in plane.iter_mut().zip(triples) {
        *out = of(triple);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(channel: Channel, rgb: &[u8]) -> Vec<u8> {
        let mut plane = vec![9; 40]; // stale, and too long
        extract(channel, rgb, &mut plane).unwrap();
        plane
    }

    #[test]
    fn each_channel_gives_its_byte() {
        let rgb = [10, 20, 30, 200, 100, 50];
        assert_eq!(of(Channel::Red, &rgb), [10, 200]);
        assert_eq!(of(Channel::Green, &rgb), [20, 100]);
        assert_eq!(of(Channel::Blue, &rgb), [30, 50]);
        assert_eq!(of(Channel::Max, &rgb), [30, 200]);
    }

    #[test]
    fn luma_is_within_one_level_of_bt_601_and_keeps_gray() {
        for level in 0..=255 {
            assert_eq!(of(Channel::Luma, &[level; 3]), [level]);
        }
        for rgb in [[255, 0, 0], [0, 255, 0], [0, 0, 255], [12, 200, 97], [255, 254, 1]] {
            let [r, g, b] = rgb.map(f64::from);
            let truth = 0.299 * r + 0.587 * g + 0.114 * b;
            assert!((f64::from(of(Channel::Luma, &rgb)[0]) - truth).abs() <= 1.0, "{rgb:?}");
        }
    }

    #[test]
    fn half_a_pixel_is_refused_and_no_pixel_is_none() {
        assert!(extract(Channel::Luma, &[1, 2, 3, 4], &mut Vec::new()).is_err());
        assert_eq!(of(Channel::Luma, &[]), []);
    }
}
