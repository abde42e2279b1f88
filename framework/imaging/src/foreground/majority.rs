//! The majority of each 3 × 3 neighbourhood: takes specks away and closes pinholes.

/// Keeps its buffer from picture to picture.
#[derive(Debug, Clone, Default)]
pub(crate) struct Majority {
    /// How many of three rows are foreground in a column, with one column more at each side.
    columns: Vec<u8>,
}

impl Majority {
    /// Writes to `mask` 0 where fewer than 5 of the 9 around a pixel of `raw` are above 0 or the pixel is not `open` (255), else
    /// 2 where `raw` has it, else 1; returns how many are not 0. Beyond the picture stands what its rim has.
    pub fn filter(&mut self, raw: &[u8], open: &[u8], width: usize, height: usize, mask: &mut [u8]) -> u64 {
        if width == 0 {
            return 0;
        }
        self.columns.resize(width + 2, 0);
        let mut n = 0;
        for y in 0..height {
            let row = |y: usize| &raw[y * width..(y + 1) * width];
            let (above, here, below) = (row(y.saturating_sub(1)), row(y), row((y + 1).min(height - 1)));
            let inner = &mut self.columns[1..=width];
            for x in 0..width {
                inner[x] = above[x].min(1) + here[x].min(1) + below[x].min(1);
            }
            (self.columns[0], self.columns[width + 1]) = (self.columns[1], self.columns[width]);
            let (left, middle, right) = (&self.columns[..width], &self.columns[1..=width], &self.columns[2..]);
            let (open, mask) = (&open[y * width..][..width], &mut mask[y * width..][..width]);
            for x in 0..width {
                let most = u8::from(left[x] + middle[x] + right[x] >= 5);
                mask[x] = (most + (most & (here[x] >> 1))) & open[x];
            }
            // Summed in bytes, in parts short enough for a byte.
            n += mask.chunks(255).map(|part| u64::from(part.iter().map(|&it| it.min(1)).sum::<u8>())).sum::<u64>();
        }
        n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn filter(raw: &[u8], open: &[u8], width: usize) -> (Vec<u8>, u64) {
        let mut mask = vec![9; raw.len()];
        let n = Majority::default().filter(raw, open, width, raw.len() / width.max(1), &mut mask);
        (mask, n)
    }

    #[test]
    fn agrees_with_counting() {
        let (width, height) = (13, 9);
        let raw: Vec<u8> = (0..width * height).map(|i| ((i * i * i * 7 + i * i / 3 + i * 31) % 11 / 4) as u8).collect();
        let open: Vec<u8> = (0..width * height).map(|i| if i % 11 == 3 { 0 } else { 255 }).collect();
        let (mask, n) = filter(&raw, &open, width);
        let mut lit = 0;
        for y in 0..height as i64 {
            for x in 0..width as i64 {
                let at = |x: i64, y: i64| {
                    raw[(y.clamp(0, height as i64 - 1) * width as i64 + x.clamp(0, width as i64 - 1)) as usize]
                };
                let count = (-1..=1).flat_map(|j| (-1..=1).map(move |i| (i, j))).filter(|(i, j)| at(x + i, y + j) > 0);
                let i = (y * width as i64 + x) as usize;
                let expected = if count.count() < 5 || open[i] == 0 { 0 } else { raw[i].max(1) };
                assert_eq!(mask[i], expected, "({x}, {y})");
                lit += u64::from(expected > 0);
            }
        }
        assert!(lit > 0 && n == lit);
    }

    #[test]
    fn smallest_pictures() {
        assert_eq!(filter(&[2], &[255], 1), (vec![2], 1));
        assert_eq!(filter(&[], &[], 0), (vec![], 0));
        assert_eq!(filter(&[1; 600], &[255; 600], 600), (vec![1; 600], 600));
    }
}
