//! Points of a cloud drawn as squares in their camera's picture, each as wide as the distance between points.
//!
//! A cloud of every tenth pixel is invisible as single pixels. The distance is that to the nearest other point, along the farther axis, median over the points. A pixel that several squares reach
//! belongs to the point that is nearest to it.

use foveate::prelude::*;

/// Largest width: points of a cloud that is too sparse do not become a surface [px].
const WIDEST_PX: u16 = 32;
/// Points of a cloud whose neighbours are searched.
const ASKED: usize = 1000;

/// Owner of each pixel.
pub(crate) struct Dots {
    size: [u16; 2],
    /// Side of a square [px].
    side: u16,
    /// Square of the distance to the nearest point so far, by pixel [px²].
    nearest: Vec<u16>,
}

impl Dots {
    /// For the points of `cloud`, in pictures of its camera's size.
    pub fn of(cloud: &PointCloud) -> Dots {
        let size = cloud.camera_size.map(|it| it.min(u32::from(u16::MAX)) as u16);
        let mut is_point = vec![false; usize::from(size[0]) * usize::from(size[1])];
        let pixels: Vec<[u16; 2]> =
            cloud.iter().map(|it| it.pixel).filter(|it| it[0] < size[0] && it[1] < size[1]).collect();
        let at = |[x, y]: [u16; 2]| usize::from(y) * usize::from(size[0]) + usize::from(x);
        pixels.iter().for_each(|it| is_point[at(*it)] = true);
        let to_next = |pixel: [u16; 2]| {
            let is_other = |other: [u16; 2]| other != pixel && is_point[at(other)];
            (1..=WIDEST_PX).find(|reach| square(pixel, *reach, *reach, size).any(is_other))
        };
        let mut steps: Vec<u16> =
            pixels.iter().step_by(pixels.len().div_ceil(ASKED).max(1)).filter_map(|it| to_next(*it)).collect();
        steps.sort_unstable();
        let side = steps.get(steps.len() / 2).copied().unwrap_or(1);
        Dots { size, side, nearest: vec![u16::MAX; is_point.len()] }
    }

    /// Calls `draw` with the index of each pixel, row by row, that is nearer to this point than to all before.
    pub fn around(&mut self, pixel: [u16; 2], mut draw: impl FnMut(usize)) {
        let after = self.side / 2;
        for other in square(pixel, self.side - 1 - after, after, self.size) {
            let squared: u16 = [0, 1].map(|axis| other[axis].abs_diff(pixel[axis]).pow(2)).iter().sum();
            let at = usize::from(other[1]) * usize::from(self.size[0]) + usize::from(other[0]);
            if squared < self.nearest[at] {
                self.nearest[at] = squared;
                draw(at);
            }
        }
    }
}

/// Pixels of a picture from `before` pixels before one to `after` behind it, in rows and columns alike.
fn square(pixel: [u16; 2], before: u16, after: u16, size: [u16; 2]) -> impl Iterator<Item = [u16; 2]> {
    let [columns, rows] =
        [0, 1].map(|axis| pixel[axis].saturating_sub(before)..pixel[axis].saturating_add(after + 1).min(size[axis]));
    rows.flat_map(move |y| columns.clone().map(move |x| [x, y]))
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3, Vector3};

    use super::*;

    fn dots(pixels: &[[u16; 2]]) -> Dots {
        let mut cloud = PointCloud { camera_size: [40, 30], ..PointCloud::default() };
        for pixel in pixels {
            cloud.push(&CloudPoint {
                position: Point3::origin(),
                covariance: Matrix3::identity(),
                normal: Vector3::z(),
                confidence: 1.0,
                pixel: *pixel,
                colour: [0; 3],
            });
        }
        Dots::of(&cloud)
    }

    #[test]
    fn squares_of_a_grid_fill_it_and_each_pixel_is_the_nearest_points() {
        let grid: Vec<[u16; 2]> = (1..8).flat_map(|x| (1..6).map(move |y| [5 * x, 5 * y])).collect();
        let mut dots = dots(&grid);
        assert_eq!(dots.side, 5);
        let mut owner = vec![usize::MAX; 40 * 30];
        for (number, pixel) in grid.iter().enumerate() {
            dots.around(*pixel, |at| owner[at] = number);
        }
        let drawn = owner.iter().filter(|it| **it != usize::MAX).count();
        assert_eq!(drawn, grid.len() * 25);
        assert!([(10, 10), (8, 12), (12, 8)].iter().all(|(x, y)| grid[owner[y * 40 + x]] == [10, 10]));
    }

    #[test]
    fn of_two_that_overlap_each_has_its_side_and_clouds_of_every_pixel_stay_as_they_are() {
        let mut dots = dots(&[[2, 2], [8, 2], [20, 20], [26, 20], [32, 20], [34, 20]]);
        assert_eq!(dots.side, 6);
        let mut owner = [0; 40 * 30];
        for (number, x) in [(1, 32), (2, 34)] {
            dots.around([x, 20], |at| owner[at] = number);
        }
        assert_eq!([owner[20 * 40 + 31], owner[20 * 40 + 32], owner[20 * 40 + 34]], [1, 1, 2]);
        let every: Vec<[u16; 2]> = (0..40).flat_map(|x| (0..30).map(move |y| [x, y])).collect();
        assert_eq!(super::tests::dots(&every).side, 1);
        assert_eq!(super::tests::dots(&[[3, 3]]).side, 1);
    }

    #[test]
    fn squares_end_with_the_picture() {
        let mut dots = dots(&[[0, 0], [39, 29], [33, 29], [0, 6]]);
        let mut n = 0;
        dots.around([39, 29], |_| n += 1);
        assert_eq!((dots.side, n), (6, 9));
    }
}
