//! The colour of a surface, as shades of gray: painted once, on the rest shape, so that it moves with the skin.
//!
//! For each texel the point of the rest shape that it covers is looked up, and what is seen there is painted: marks by their distance in
//! space, so that they are round on the skin whatever the texture's own measures.

use std::sync::{Mutex, PoisonError};

use nalgebra::{Point3, Vector3};

use super::surface::{Material, Spot, Surface, Triangle};

/// Half the width of a mark's soft edge [mm].
const SOFT_MM: f64 = 0.35;
/// How bright paint is [–].
const PAINT: f32 = 0.05;

/// Shades, 0 to 255 for albedos from 0 to 1, in rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Texture {
    pub width: usize,
    pub shades: Vec<u8>,
}

impl Texture {
    /// The albedo at a column and a row, in 65,536ths of a texel [–].
    #[inline]
    pub fn at(&self, [column, row]: [i32; 2]) -> f32 {
        let first = (row >> 16) as usize * self.width + (column >> 16) as usize;
        let Some(texels) = first.checked_add(self.width + 2).and_then(|end| self.shades.get(first..end)) else {
            return 0.0;
        };
        let [x, y] = [column, row].map(|it| it >> 4 & 0xFFF); // in 4,096ths
        let [a, b] = [0, 1].map(|it| i32::from(texels[it]));
        let [c, d] = [self.width, self.width + 1].map(|it| i32::from(texels[it]));
        let above = (a << 12) + (b - a) * x;
        let below = (c << 12) + (d - c) * x;
        (above as f32 + (below - above) as f32 * (y as f32 * (1.0 / 4096.0))) * (1.0 / (4096.0 * 255.0))
    }
}

/// Round marks of paint.
pub(super) struct Paint {
    /// Where [m], and how large [mm].
    pub dots: Vec<(Point3<f64>, f64)>,
}

impl Paint {
    /// Marks at `spots` of a surface at rest, about `radius_mm` large.
    pub fn new(surface: &Surface, spots: &[Spot], radius_mm: f64, seed: u32) -> Self {
        // Painted by hand: not all are of one size.
        let radius = |i: usize| radius_mm * (1.0 + 0.07 * f64::from(hash([i as i32, 7, 7], seed)));
        let place = |(i, spot): (usize, &Spot)| (surface.place(spot, &surface.rest), radius(i));
        Self { dots: spots.iter().enumerate().map(place).collect() }
    }

    /// How much of `under` is left at `p`, and what is seen [–].
    fn over(&self, near: &[u32], p: &Point3<f64>, under: f32) -> f32 {
        near.iter().fold(under, |seen, &dot| {
            let (centre, radius) = self.dots[dot as usize];
            let edge = ((p - centre).norm() * 1e3 - radius) / (2.0 * SOFT_MM) + 0.5;
            let bare = edge.clamp(0.0, 1.0) as f32;
            PAINT + (seen - PAINT) * (bare * bare * (3.0 - 2.0 * bare))
        })
    }
}

/// Rows that are painted in one go.
const BAND: usize = 32;

/// Paints a texture of `size` (columns, rows): `albedo` tells what is at a point of the rest shape [m], for each material. Bands of rows
/// are dealt out to all cores; each row is the same whoever paints it.
pub(super) fn paint(
    surface: &Surface,
    [width, height]: [usize; 2],
    paint: &Paint,
    albedo: impl Fn(&Point3<f64>, Material) -> f32 + Sync,
) -> Texture {
    let mut shades = vec![0_u8; width * height];
    let patches: Vec<Patch<'_>> = surface.triangles.iter().filter_map(|it| Patch::new(surface, it, paint)).collect();
    let bands = Mutex::new(shades.chunks_mut(width * BAND).enumerate());
    // In a call of its own, so that the lock is not held while a band is painted.
    let next = || bands.lock().unwrap_or_else(PoisonError::into_inner).next();
    let work = || {
        while let Some((band, rows)) = next() {
            patches.iter().for_each(|it| it.paint(band * BAND, rows, [width, height], paint, &albedo));
        }
    };
    let n_threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        (1..n_threads).for_each(|_| {
            scope.spawn(work);
        });
        work();
    });
    Texture { width, shades }
}

/// A triangle in the texture.
struct Patch<'s> {
    triangle: &'s Triangle,
    corners: [Point3<f64>; 3],
    /// Its corners in the texture [texel].
    texels: [[f64; 2]; 3],
    doubled: f64,
    /// Columns and rows that it may reach [texel].
    extent: [(f64, f64); 2],
    /// The marks that may lie on it.
    near: Vec<u32>,
}

impl<'s> Patch<'s> {
    fn new(surface: &Surface, triangle: &'s Triangle, paint: &Paint) -> Option<Self> {
        let corners = triangle.corners.map(|it| surface.rest[it as usize]);
        let texels @ [a, b, c] = triangle.texels.map(|it| it.map(f64::from));
        let doubled = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1]);
        let middle = (corners[0].coords + corners[1].coords + corners[2].coords) / 3.0;
        let reach = corners.iter().map(|it| (it.coords - middle).norm()).fold(0.0, f64::max);
        let is_near = |dot: &u32| {
            let (centre, radius) = paint.dots[*dot as usize];
            triangle.material == Material::Skin
                && (centre.coords - middle).norm() < 1.6 * reach + (radius + 3.0 * SOFT_MM) * 1e-3
        };
        let extent = [0, 1].map(|axis| {
            let [low, high] = [f64::min, f64::max].map(|pick| pick(pick(a[axis], b[axis]), c[axis]));
            (low - 1.0, high + 1.0)
        });
        let near = (0..paint.dots.len() as u32).filter(is_near).collect();
        (doubled != 0.0).then_some(Self { triangle, corners, texels, doubled, extent, near })
    }

    /// Paints what of it lies in the rows `shades`, of which the first is row `from` of the texture.
    fn paint(
        &self,
        from: usize,
        shades: &mut [u8],
        [width, height]: [usize; 2],
        paint: &Paint,
        albedo: &impl Fn(&Point3<f64>, Material) -> f32,
    ) {
        let ([a, b, c], doubled, corners) = (self.texels, self.doubled, &self.corners);
        let [(left, right), (top, bottom)] = self.extent;
        let rows = from..(from + shades.len() / width);
        let first_row = (top.floor().max(0.0) as usize).max(rows.start);
        let last_row = ((bottom.ceil().max(0.0) as usize).min(height - 1)).min(rows.end - 1);
        for row in first_row..=last_row {
            for column in left.floor().max(0.0) as usize..=(right.ceil().max(0.0) as usize).min(width - 1) {
                let (u, v) = (column as f64, row as f64);
                let second = ((u - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (v - a[1])) / doubled;
                let third = ((b[0] - a[0]) * (v - a[1]) - (u - a[0]) * (b[1] - a[1])) / doubled;
                let first = 1.0 - second - third;
                // A texel beyond the edges, for those who read between texels; inside wins.
                let beyond = first.min(second).min(third);
                let shade = &mut shades[(row - from) * width + column];
                if beyond < -1e-9 && (*shade != 0 || !within_a_texel([a, b, c], [u, v])) {
                    continue;
                }
                let p = corners[0].coords * first + corners[1].coords * second + corners[2].coords * third;
                let p = Point3::from(p);
                let seen = paint.over(&self.near, &p, albedo(&p, self.triangle.material));
                *shade = (seen.clamp(0.0, 1.0) * 254.0) as u8 + 1;
            }
        }
    }
}

/// Whether a point lies within a texel and a half of a triangle.
fn within_a_texel(corners: [[f64; 2]; 3], [u, v]: [f64; 2]) -> bool {
    (0..3).any(|i| {
        let ([ax, ay], [bx, by]) = (corners[i], corners[(i + 1) % 3]);
        let (along, to) = ([bx - ax, by - ay], [u - ax, v - ay]);
        let length = along[0] * along[0] + along[1] * along[1];
        let share = ((to[0] * along[0] + to[1] * along[1]) / length.max(1e-12)).clamp(0.0, 1.0);
        (to[0] - along[0] * share).hypot(to[1] - along[1] * share) < 1.5
    })
}

/// A number from −1 to 1 for a cell of a lattice.
fn hash(cell: [i32; 3], seed: u32) -> f32 {
    let mut bits = seed ^ 0x9e37_79b9;
    for it in cell {
        bits = (bits ^ it as u32).wrapping_mul(0x85eb_ca6b);
        bits ^= bits >> 13;
        bits = bits.wrapping_mul(0xc2b2_ae35);
        bits ^= bits >> 16;
    }
    (bits >> 8) as f32 / 8_388_608.0 - 1.0
}

/// Smooth noise in space with details of `size` [m], about −1 to 1.
pub(super) fn noise(p: &Point3<f64>, size: [f64; 3], seed: u32) -> f32 {
    let at = Vector3::from_fn(|i, _| p[i] / size[i]);
    let floor = at.map(f64::floor);
    let t = (at - floor).map(|it| (it * it * (3.0 - 2.0 * it)) as f32);
    let cell = [0, 1, 2].map(|i| floor[i] as i32);
    let corner = |x: i32, y: i32, z: i32| hash([cell[0] + x, cell[1] + y, cell[2] + z], seed);
    let along_x = |y: i32, z: i32| corner(0, y, z) + (corner(1, y, z) - corner(0, y, z)) * t.x;
    let along_y = |z: i32| along_x(0, z) + (along_x(1, z) - along_x(0, z)) * t.y;
    along_y(0) + (along_y(1) - along_y(0)) * t.z
}

/// Small round spots, at most one in each cell of `size` [m] where `share` of the cells have one of `radius` [m]: 0 to 1.
pub(super) fn freckles(p: &Point3<f64>, size: f64, share: f32, radius: f64, seed: u32) -> f32 {
    let cell = [0, 1, 2].map(|i| (p[i] / size).floor() as i32);
    if hash(cell, seed) * 0.5 + 0.5 > share {
        return 0.0;
    }
    let inside = |i: usize| {
        let place = f64::from(hash(cell, seed ^ (i as u32 + 1))) * 0.25 + 0.5;
        p[i] - (f64::from(cell[i]) + place) * size
    };
    let distance = Vector3::new(inside(0), inside(1), inside(2)).norm();
    (1.0 - (distance / radius).powi(2)).max(0.0) as f32
}
