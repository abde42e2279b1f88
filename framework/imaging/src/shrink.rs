//! A smaller picture whose pixels are means: less to do, less noise.

use crate::{ImageView, ImagingError};

/// Fills `smaller` with the means of `factor` × `factor` pixels of `image`; returns its columns and rows. What is left over at
/// the right and at the bottom is cut off. Pixel (x, y) there has its centre at (x + ½) · factor − ½ here.
///
/// # Errors
/// [`ImagingError::Setting`] for a factor that is not 1 to 16.
pub fn shrink(image: &ImageView, factor: usize, smaller: &mut Vec<u8>) -> Result<(usize, usize), ImagingError> {
    ImagingError::unless((1..=16).contains(&factor), "factor", "1 to 16", factor as f64)?;
    let (width, height) = (image.width() / factor, image.height() / factor);
    smaller.resize(width * height, 0);
    // 16 × 16 × 255 fits; the fraction is rounded by adding half the divisor.
    let (n, half) = ((factor * factor) as u32, (factor * factor / 2) as u32);
    for (y, out) in smaller.chunks_exact_mut(width.max(1)).enumerate() {
        for (x, out) in out.iter_mut().enumerate() {
            let mut sum = half;
            for row in y * factor..(y + 1) * factor {
                let block = &image.row(row)[x * factor..(x + 1) * factor];
                sum += block.iter().map(|&it| u32::from(it)).sum::<u32>();
            }
            *out = (sum / n) as u8;
        }
    }
    Ok((width, height))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_are_rounded_and_the_rest_is_cut_off() {
        let pixels = [1, 2, 9, 3, 5, 9, 9, 9, 9, 255, 255, 9];
        let view = ImageView::new(&pixels, 3, 4).unwrap();
        let mut smaller = vec![7; 30];
        assert_eq!(shrink(&view, 2, &mut smaller), Ok((1, 2)));
        assert_eq!(smaller, [3, 132]); // 11/4 = 2.75 and 528/4
        assert_eq!(shrink(&view, 1, &mut smaller), Ok((3, 4)));
        assert_eq!(smaller, pixels);
        assert_eq!(shrink(&view, 4, &mut smaller), Ok((0, 1)));
        assert_eq!(smaller, []);
        assert!(shrink(&view, 0, &mut smaller).is_err());
    }
}
