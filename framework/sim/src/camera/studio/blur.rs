//! The blur of the lens, where a picture has changed.

use std::ops::Range;

/// Columns and rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Area {
    pub columns: Range<usize>,
    pub rows: Range<usize>,
}

impl Area {
    /// Takes in others.
    pub fn add(&mut self, columns: &Range<usize>, rows: &Range<usize>) {
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        if self.columns.is_empty() {
            *self = Area { columns: columns.clone(), rows: rows.clone() };
            return;
        }
        let with = |a: &Range<usize>, b: &Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        *self = Area { columns: with(&self.columns, columns), rows: with(&self.rows, rows) };
    }
}

/// Blurs what has changed, and takes the rest as it is known blurred.
pub(super) fn blur_within(planes: &mut [Vec<i16>], blurred: &[Vec<i16>], size: [u32; 2], changed: &Area, sigma: f64) {
    let [width, height] = size.map(|it| it as usize);
    let reach = weights(sigma).len() - 1;
    let wider = |it: &Range<usize>, end: usize| it.start.saturating_sub(reach)..(it.end + reach).min(end);
    let area = Area { columns: wider(&changed.columns, width), rows: wider(&changed.rows, height) };
    for (plane, blurred) in planes.iter_mut().zip(blurred) {
        let mut result = blurred.clone();
        if !changed.columns.is_empty() {
            blur(plane, &mut result, width, &area, sigma);
        }
        *plane = result;
    }
}

/// Weights of a normal distribution on one side, the middle first; integrated over each pixel's width by its middle.
fn weights(sigma: f64) -> Vec<f32> {
    if sigma <= 0.0 {
        return vec![1.0];
    }
    let reach = (3.0 * sigma).ceil() as usize;
    let raw: Vec<f64> = (0..=reach).map(|it| (-0.5 * (it as f64 / sigma).powi(2)).exp()).collect();
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    raw.iter().map(|it| (it / sum) as f32).collect()
}

/// Blurs an area of `from` into `into`, along rows and then along columns; beyond the picture its rim goes on.
pub(super) fn blur(from: &[i16], into: &mut [i16], width: usize, area: &Area, sigma: f64) {
    let height = from.len() / width;
    let weights = weights(sigma);
    let reach = weights.len() - 1;
    let rows = area.rows.start.saturating_sub(reach)..(area.rows.end + reach).min(height);
    let n = area.columns.len();
    let mut along = vec![0.0_f32; n * rows.len()];
    let mut padded = vec![0.0_f32; n + 2 * reach];
    for (row, along) in rows.clone().zip(along.chunks_exact_mut(n)) {
        let pixels = &from[row * width..][..width];
        for (place, padded) in padded.iter_mut().enumerate() {
            let column = (area.columns.start + place).saturating_sub(reach).min(width - 1);
            *padded = f32::from(pixels[column]);
        }
        along.iter_mut().zip(&padded[reach..]).for_each(|(sum, it)| *sum = it * weights[0]);
        for (off, weight) in weights.iter().enumerate().skip(1) {
            let sides = padded[reach - off..].iter().zip(&padded[reach + off..]);
            along.iter_mut().zip(sides).for_each(|(sum, (left, right))| *sum += (left + right) * weight);
        }
    }
    let mut sums = vec![0.0_f32; n];
    for row in area.rows.clone() {
        let at = |row: usize| &along[(row.clamp(rows.start, rows.end - 1) - rows.start) * n..][..n];
        sums.iter_mut().zip(at(row)).for_each(|(sum, it)| *sum = it * weights[0]);
        for (off, weight) in weights.iter().enumerate().skip(1) {
            let sides = at(row.saturating_sub(off)).iter().zip(at(row + off));
            sums.iter_mut().zip(sides).for_each(|(sum, (above, below))| *sum += (above + below) * weight);
        }
        let into = &mut into[row * width + area.columns.start..][..n];
        into.iter_mut().zip(&sums).for_each(|(it, sum)| *it = (sum + 0.5).floor() as i16);
    }
}
