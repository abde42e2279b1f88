//! Where the pixels of one picture lie in another one of the same camera, which stood otherwise; and what is there.

use nalgebra::Point2;

/// Pixels between places that are computed; between them they are linear.
const STEP: usize = 16;

/// Gray levels of a background are kept in steps of one in so many.
pub(super) const FINE: f32 = 256.0;

/// The places of one picture's pixels in another one of the same size.
#[derive(Debug, Clone, Default)]
pub(super) struct Warp {
    size: [usize; 2],
    columns: usize,
    /// Row by row, every [`STEP`] pixels; not a number where there is no such place [px].
    places: Vec<[f32; 2]>,
}

impl Warp {
    /// For pictures of `size` (columns, rows): `place` says where a pixel lies.
    pub fn set(&mut self, size: [usize; 2], place: impl Fn(&Point2<f64>) -> Option<Point2<f64>>) {
        let [columns, rows] = size.map(|it| it.div_ceil(STEP) + 1);
        (self.size, self.columns) = (size, columns);
        self.places.clear();
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let at = Point2::new((column * STEP) as f64, (row * STEP) as f64);
            self.places.push(place(&at).map_or([f32::NAN; 2], |it| [it.x as f32, it.y as f32]));
        }
    }

    /// Calls `see` with the number of each pixel of row `y` that lies in the other picture, and where it does.
    pub fn along_row(&self, y: usize, mut see: impl FnMut(usize, f32, f32)) {
        let [width, height] = self.size;
        let [last_x, last_y] = [width as f32 - 1.0, height as f32 - 1.0];
        let down = (y % STEP) as f32 / STEP as f32;
        let above = &self.places[y / STEP * self.columns..][..self.columns];
        let below = &self.places[(y / STEP + 1) * self.columns..][..self.columns];
        let at = |column: usize, axis: usize| above[column][axis] + down * (below[column][axis] - above[column][axis]);
        for first in (0..width).step_by(STEP) {
            let column = first / STEP;
            let [left, right] = [column, column + 1].map(|it| [at(it, 0), at(it, 1)]);
            let step = [0, 1].map(|axis| (right[axis] - left[axis]) / STEP as f32);
            for x in first..(first + STEP).min(width) {
                let along = (x - first) as f32;
                let [u, v] = [0, 1].map(|axis| left[axis] + along * step[axis]);
                if u >= 0.0 && v >= 0.0 && u < last_x && v < last_y {
                    see(y * width + x, u, v);
                }
            }
        }
    }

    /// Takes the pixels that are not `covered` yet from `levels`, the other picture in steps of 1/[`FINE`] gray level, and marks them.
    pub fn take(&self, levels: &[u16], channels: usize, pixels: &mut [u8], covered: &mut [bool]) {
        let width = self.size[0];
        for y in 0..self.size[1] {
            self.along_row(y, |pixel, u, v| {
                if covered[pixel] {
                    return;
                }
                covered[pixel] = true;
                for channel in 0..channels {
                    let level = between(|at| f32::from(levels[at * channels + channel]), width, u, v);
                    pixels[pixel * channels + channel] = (level / FINE + 0.5) as u8;
                }
            });
        }
    }
}

/// Between the four pixels around a place, in proportion.
pub(super) fn between(level: impl Fn(usize) -> f32, width: usize, u: f32, v: f32) -> f32 {
    let (column, row) = (u as usize, v as usize);
    let (across, down) = (u - column as f32, v - row as f32);
    let at = row * width + column;
    let upper = level(at) + across * (level(at + 1) - level(at));
    let lower = level(at + width) + across * (level(at + width + 1) - level(at + width));
    upper + down * (lower - upper)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shifted_picture_comes_back_and_what_lies_outside_stays_as_it_was() {
        let size = [40, 30];
        let level = |x: f32, y: f32| 20.0 + 3.0 * x + 2.0 * y;
        let levels: Vec<u16> =
            (0..40 * 30).map(|at| (level((at % 40) as f32, (at / 40) as f32) * FINE) as u16).collect();
        let mut warp = Warp::default();
        warp.set(size, |at| Some(Point2::new(at.x + 2.25, at.y - 1.5)));
        let (mut pixels, mut covered) = (vec![7; 1200], vec![false; 1200]);
        covered[5 * 40 + 5] = true;
        warp.take(&levels, 1, &mut pixels, &mut covered);
        for (x, y) in (0..30).flat_map(|y| (0..40).map(move |x| (x, y))) {
            let (u, v) = (x as f32 + 2.25, y as f32 - 1.5);
            let is_inside = u < 39.0 && v >= 0.0;
            let expected = if is_inside && (x, y) != (5, 5) { (level(u, v) + 0.5) as u8 } else { 7 };
            assert!(pixels[y * 40 + x].abs_diff(expected) <= 1, "{x} {y}: {} for {expected}", pixels[y * 40 + x]);
            assert_eq!(covered[y * 40 + x], is_inside, "{x} {y}");
        }
        warp.set(size, |_| None);
        covered.fill(false);
        warp.take(&levels, 1, &mut pixels, &mut covered);
        assert!(covered.iter().all(|it| !it));
    }
}
