//! Closing: gaps between body and body that are narrower than a square are body.
//!
//! A dilation with a square and an erosion with the same one, each along rows and along columns, by counts of a window that slides (J. Serra, *Image Analysis and Mathematical Morphology*, 1982).

/// Closes gaps; keeps its memory.
#[derive(Debug, Clone, Default)]
pub struct Closing {
    /// Of the picture after each pass: 1 where body.
    rows: Vec<u8>,
    columns: Vec<u8>,
    counts: Vec<u16>,
}

impl Closing {
    /// Marks with 1 what is 0 in `mask` (`width` columns, row by row) and lies in a gap that no square of 2 `radius` + 1 pixels fits into. Beyond the picture nothing is body.
    pub fn close(&mut self, mask: &mut [u8], width: usize, radius: usize) {
        let n = mask.len();
        if width == 0 || n < width || radius == 0 {
            return;
        }
        self.rows.resize(n, 0);
        self.columns.resize(n, 0);
        along_rows(mask, &mut self.rows, width, radius, |count, _| count > 0);
        self.along_columns(width, radius, |count, _| count > 0);
        std::mem::swap(&mut self.rows, &mut self.columns);
        let dilated = std::mem::take(&mut self.rows);
        self.rows.resize(n, 0);
        along_rows(&dilated, &mut self.rows, width, radius, |count, size| count == size);
        self.columns = dilated;
        self.along_columns(width, radius, |count, size| count == size);
        for (it, closed) in mask.iter_mut().zip(&self.columns) {
            *it = (*it).max(*closed);
        }
    }

    /// From `rows` to `columns`.
    fn along_columns(&mut self, width: usize, radius: usize, is_body: impl Fn(u16, u16) -> bool) {
        let height = self.rows.len() / width;
        self.counts.clear();
        self.counts.resize(width, 0);
        let row = |y: usize| y * width..(y + 1) * width;
        for y in 0..height + radius {
            if y < height {
                self.counts.iter_mut().zip(&self.rows[row(y)]).for_each(|(count, it)| *count += u16::from(*it));
            }
            let Some(middle) = y.checked_sub(radius) else { continue };
            let size = window(middle, radius, height);
            for (out, count) in self.columns[row(middle)].iter_mut().zip(&self.counts) {
                *out = u8::from(is_body(*count, size));
            }
            if let Some(last) = middle.checked_sub(radius) {
                self.counts.iter_mut().zip(&self.rows[row(last)]).for_each(|(count, it)| *count -= u16::from(*it));
            }
        }
    }
}

/// Places of a window about `middle` that lie in the picture.
fn window(middle: usize, radius: usize, size: usize) -> u16 {
    ((middle + radius + 1).min(size) - middle.saturating_sub(radius)) as u16
}

fn along_rows(from: &[u8], to: &mut [u8], width: usize, radius: usize, is_body: impl Fn(u16, u16) -> bool) {
    for (from, to) in from.chunks_exact(width).zip(to.chunks_exact_mut(width)) {
        let one = |x: usize| u16::from(from[x] != 0);
        let mut count = 0;
        for x in 0..width + radius {
            if x < width {
                count += one(x);
            }
            let Some(middle) = x.checked_sub(radius) else { continue };
            to[middle] = u8::from(is_body(count, window(middle, radius, width)));
            if let Some(last) = middle.checked_sub(radius) {
                count -= one(last);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By the definition: a pixel stays open if some square about some pixel covers it and touches no body.
    fn expected(mask: &[u8], width: usize, radius: usize) -> Vec<u8> {
        let height = mask.len() / width;
        let around = |at: usize, size: usize| at.saturating_sub(radius)..(at + radius + 1).min(size);
        let is_free = |x: usize, y: usize| {
            around(y, height).all(|row| around(x, width).all(|column| mask[row * width + column] == 0))
        };
        (0..mask.len())
            .map(|i| {
                let (x, y) = (i % width, i / width);
                let is_open = around(y, height).any(|row| around(x, width).any(|column| is_free(column, row)));
                if is_open { mask[i] } else { mask[i].max(1) }
            })
            .collect()
    }

    #[test]
    fn agrees_with_the_definition() {
        for (width, height, radius) in [(17, 11, 1), (17, 11, 2), (9, 23, 3), (5, 4, 6), (1, 9, 2), (12, 1, 2)] {
            let mask: Vec<u8> =
                (0..width * height).map(|i| u8::from(i * i * 7 % 11 == 0) * (1 + (i % 2) as u8)).collect();
            let mut closed = mask.clone();
            Closing::default().close(&mut closed, width, radius);
            assert_eq!(closed, expected(&mask, width, radius), "{width} x {height}, {radius}");
        }
    }

    #[test]
    fn a_seam_is_closed_a_wider_one_is_not_and_memory_of_another_picture_is_no_matter() {
        let stripes =
            |gap: usize| -> Vec<u8> { (0..40 * 6).map(|i| u8::from(!(10..10 + gap).contains(&(i % 40)))).collect() };
        let mut closing = Closing::default();
        let mut close = |gap: usize, radius: usize| {
            let mut mask = stripes(gap);
            closing.close(&mut mask, 40, radius);
            mask.iter().filter(|it| **it == 0).count()
        };
        assert_eq!([close(4, 2), close(5, 2), close(9, 5), close(5, 0)], [0, 30, 0, 30]);
        closing.close(&mut [0, 1], 2, 3);
        closing.close(&mut [], 0, 3);
    }
}
