//! Colours of surface voxels, from the pictures in which they are visible.
//!
//! A voxel is visible to a camera when no surface voxel in front of its pixel is nearer by more than two edges: this
//! comes from a depth map into which each voxel is drawn as large as it appears. The colours are averaged over the
//! cameras with the squared cosine between line of sight and normal, so that grazing views count least; the normal
//! points away from the voxels among the 26 neighbours.

use nalgebra::{Point2, Vector3};

use super::{BitGrid, VoxelGrid};
use crate::Camera;

/// A picture taken by a camera.
#[derive(Debug, Clone, Copy)]
pub struct Picture<'a> {
    /// Model and pose of the camera.
    pub camera: &'a Camera,
    /// Columns of the camera's image to the left of the picture [px].
    pub left: u32,
    /// Rows of the camera's image above the picture [px].
    pub top: u32,
    /// Width and height of one of its pixels in camera pixels, at least 1.
    pub shrink: u32,
    /// Width [px].
    pub width: u32,
    /// Height [px].
    pub height: u32,
    /// Bytes per pixel: 1 gray, 3 red, green, blue.
    pub channels: usize,
    /// Pixels row by row; missing ones at the end are black.
    pub pixels: &'a [u8],
}

/// How much nearer another voxel must lie to hide one [edges].
const HIDES: f64 = 2.0;
/// The cosine that a look at a right angle to the normal counts with, so that a voxel that is only seen so has a colour.
const FLATTEST: f64 = 0.05;

/// The colour of each voxel of `surface`, in its order; black where it is not visible in any picture.
pub fn colours(grid: &VoxelGrid, hull: &BitGrid, surface: &BitGrid, pictures: &[Picture]) -> Vec<[u8; 3]> {
    let voxels: Vec<[u32; 3]> = surface.iter().collect();
    let normals: Vec<Vector3<f64>> = voxels.iter().map(|it| normal(hull, *it)).collect();
    let mut sums = vec![([0.0f64; 3], 0.0f64); voxels.len()];
    for picture in pictures {
        let looks = looks(grid, &voxels, picture);
        let depths = Depths::of(picture, &looks, grid.size);
        let eye = picture.camera.centre();
        for (((look, voxel), normal), (sum, weight)) in looks.iter().zip(&voxels).zip(&normals).zip(&mut sums) {
            let Some((pixel, depth)) = look else { continue };
            if depths.at(pixel) + HIDES * grid.size < *depth {
                continue;
            }
            let Some(colour) = picture.colour(pixel) else { continue };
            let to_eye = (eye - grid.centre(*voxel)).normalize();
            let cosine = normal.dot(&to_eye).max(FLATTEST);
            let w = cosine * cosine;
            *weight += w;
            sum.iter_mut().zip(colour).for_each(|(sum, it)| *sum += w * f64::from(it));
        }
    }
    let mean =
        |(sum, weight): ([f64; 3], f64)| sum.map(|it| if weight > 0.0 { (it / weight).round() as u8 } else { 0 });
    sums.into_iter().map(mean).collect()
}

/// Where each voxel lies in the picture, and how deep [m].
fn looks(grid: &VoxelGrid, voxels: &[[u32; 3]], picture: &Picture) -> Vec<Option<(Point2<f64>, f64)>> {
    let shrink = f64::from(picture.shrink.max(1));
    let place = |at: f64, start: u32| (at + 0.5 - f64::from(start)) / shrink - 0.5;
    let look = |voxel: &[u32; 3]| {
        let centre = grid.centre(*voxel);
        let pixel = picture.camera.project(&centre)?;
        let depth = (picture.camera.camera_from_world * centre).z;
        Some((Point2::new(place(pixel.x, picture.left), place(pixel.y, picture.top)), depth))
    };
    voxels.iter().map(look).collect()
}

/// Out of the voxels, of length 1; zero where there is no such way.
fn normal(hull: &BitGrid, index: [u32; 3]) -> Vector3<f64> {
    let mut sum = Vector3::zeros();
    for z in -1i32..=1 {
        for y in -1i32..=1 {
            for x in -1i32..=1 {
                let [Some(a), Some(b), Some(c)] =
                    [(index[0], x), (index[1], y), (index[2], z)].map(|(at, by)| at.checked_add_signed(by))
                else {
                    continue;
                };
                if hull.get([a, b, c]) {
                    sum -= Vector3::new(x.into(), y.into(), z.into());
                }
            }
        }
    }
    sum.try_normalize(1e-9).unwrap_or_default()
}

impl Picture<'_> {
    fn colour(&self, pixel: &Point2<f64>) -> Option<[u8; 3]> {
        let (x, y) = ((pixel.x + 0.5).floor(), (pixel.y + 0.5).floor());
        if !(x >= 0.0 && y >= 0.0 && x < self.width.into() && y < self.height.into()) {
            return None;
        }
        let at = (y as usize * self.width as usize + x as usize) * self.channels;
        let channel = |it: usize| self.pixels.get(at + it.min(self.channels - 1)).copied().unwrap_or(0);
        Some([channel(0), channel(1), channel(2)])
    }
}

/// The depth of the nearest voxel, cell by cell of a picture.
struct Depths {
    /// Pixels that a cell is wide and high.
    cell: f64,
    columns: usize,
    rows: usize,
    depths: Vec<f32>,
}

impl Depths {
    fn of(picture: &Picture, looks: &[Option<(Point2<f64>, f64)>], size: f64) -> Depths {
        let focal = picture.camera.intrinsics.focal;
        let focal = focal[0].max(focal[1]) / f64::from(picture.shrink.max(1));
        let nearest = looks.iter().flatten().map(|it| it.1).fold(f64::INFINITY, f64::min);
        // A cell as large as the nearest voxel: each voxel then covers its own cell and those next to it at most.
        let cell = (focal * size / nearest).clamp(1.0, 64.0);
        let cells = |pixels: u32| (f64::from(pixels) / cell).ceil() as usize;
        let (columns, rows) = (cells(picture.width), cells(picture.height));
        let mut depths = Depths { cell, columns, rows, depths: vec![f32::INFINITY; columns * rows] };
        for (pixel, depth) in looks.iter().flatten() {
            let half = 0.5 * focal * size / depth;
            let range = |at: f64, n: usize| {
                let [first, last] = [-half, half].map(|by| ((at + 0.5 + by) / cell).floor());
                first.max(0.0) as usize..((last + 1.0).max(0.0) as usize).min(n)
            };
            for row in range(pixel.y, rows) {
                for column in range(pixel.x, columns) {
                    let at = &mut depths.depths[row * columns + column];
                    *at = at.min(*depth as f32);
                }
            }
        }
        depths
    }

    /// Infinite outside the picture.
    fn at(&self, pixel: &Point2<f64>) -> f64 {
        let [column, row] = [pixel.x, pixel.y].map(|it| ((it + 0.5) / self.cell).floor());
        let inside = column >= 0.0 && row >= 0.0 && column < self.columns as f64 && row < self.rows as f64;
        if inside { self.depths[row as usize * self.columns + column as usize].into() } else { f64::INFINITY }
    }
}
