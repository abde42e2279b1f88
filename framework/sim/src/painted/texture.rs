//! The colour of a surface, as shades of gray: painted once, on the rest shape, so that it moves with the skin.
//!
//! For each texel the point of the rest shape that it covers is looked up, and what is seen there is painted: marks by their distance in
//! space, so that they are round on the skin whatever the texture's own measures.

use std::sync::{Mutex, PoisonError};

use nalgebra::{Point3, Vector3};
use wide::{f32x4, i32x4};

use super::surface::{Material, Spot, Surface, Triangle};
use crate::rounding::floored;

/// Half the width of a mark's soft edge [mm].
const SOFT_MM: f64 = 0.35;
/// How bright paint is [–].
const PAINT: f32 = 0.05;

/// Shades, 0 to 255 for albedos from 0 to 1, in rows.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Texture {
    width: usize,
    shades: Vec<u8>,
}

impl Texture {
    /// Of rows of `width` shades.
    pub fn new(width: usize, shades: Vec<u8>) -> Self {
        Self { width, shades }
    }

    /// The albedos at four columns and four rows, in 65,536ths of a texel [–]; 0 outside.
    #[inline]
    pub fn at(&self, [columns, rows]: [i32x4; 2]) -> f32x4 {
        let [column, row]: [[i32; 4]; 2] = [columns, rows].map(|it| (it >> 16_u32).to_array());
        let around = i32x4::from(std::array::from_fn::<i32, 4, _>(|lane| {
            // What is left of the first column or above the first row wraps around to far beyond the end.
            let first = (row[lane] as usize).wrapping_mul(self.width).wrapping_add(column[lane] as usize);
            let end = first.checked_add(self.width + 2);
            let Some(texels) = end.and_then(|end| self.shades.get(first..end)) else { return 0 };
            i32::from_le_bytes([texels[0], texels[1], texels[self.width], texels[self.width + 1]])
        }));
        // Whole numbers below 2²⁴: exact.
        let number = |it: i32x4| f32x4::from_i32x4(it);
        let byte = |shift: u32| number((around >> shift) & i32x4::splat(0xFF));
        let [x, y] = [columns, rows].map(|it| number((it >> 4_u32) & i32x4::splat(0xFFF))); // in 4,096ths
        let (a, b, c, d) = (byte(0), byte(8), byte(16), byte(24));
        let above = a * f32x4::splat(4096.0) + (b - a) * x;
        let below = c * f32x4::splat(4096.0) + (d - c) * x;
        (above + (below - above) * (y * f32x4::splat(1.0 / 4096.0))) * f32x4::splat(1.0 / (4096.0 * 255.0))
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
/// are distributed over all cores; each row is the same whichever core paints it.
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
            for place in [Place::Within, Place::Beside] {
                patches.iter().for_each(|it| it.paint(place, band * BAND, rows, [width, height], paint, &albedo));
            }
        }
    };
    let n_threads = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        (1..n_threads).for_each(|_| {
            scope.spawn(work);
        });
        work();
    });
    Texture::new(width, shades)
}

/// Which texels of a triangle are painted.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Place {
    /// Those inside.
    Within,
    /// Those at most a texel and a half outside, which nothing else has painted: for those who read between texels.
    Beside,
}

/// A triangle in the texture.
struct Patch<'s> {
    triangle: &'s Triangle,
    corners: [Point3<f64>; 3],
    /// Its corners in the texture [texel].
    texels: [[f64; 2]; 3],
    doubled: f64,
    /// Columns and rows that it takes up [texel].
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
            (low, high)
        });
        let near = (0..paint.dots.len() as u32).filter(is_near).collect();
        (doubled != 0.0).then_some(Self { triangle, corners, texels, doubled, extent, near })
    }

    /// Paints what of it lies in the rows `shades`, of which the first is row `from` of the texture.
    fn paint(
        &self,
        place: Place,
        from: usize,
        shades: &mut [u8],
        [width, height]: [usize; 2],
        paint: &Paint,
        albedo: &impl Fn(&Point3<f64>, Material) -> f32,
    ) {
        let ([a, b, c], doubled, corners) = (self.texels, self.doubled, &self.corners);
        // Texels on an edge are inside, whatever rounding says.
        let [columns, in_texture] = self.extent.map(|(low, high)| match place {
            Place::Within => ((low - 1e-3).ceil(), (high + 1e-3).floor()),
            Place::Beside => ((low - 1.0).floor(), (high + 1.0).ceil()),
        });
        let span =
            |(low, high): (f64, f64), end: usize| low.max(0.0) as usize..((high + 1.0).max(0.0) as usize).min(end);
        let (columns, in_texture) = (span(columns, width), span(in_texture, height));
        for row in in_texture.start.max(from)..in_texture.end.min(from + shades.len() / width) {
            for column in columns.clone() {
                let shade = &mut shades[(row - from) * width + column];
                if place == Place::Beside && *shade != 0 {
                    continue;
                }
                let (u, v) = (column as f64, row as f64);
                let second = ((u - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (v - a[1])) / doubled;
                let third = ((b[0] - a[0]) * (v - a[1]) - (u - a[0]) * (b[1] - a[1])) / doubled;
                let first = 1.0 - second - third;
                let is_inside = first.min(second).min(third) >= -1e-9;
                if !is_inside && (place == Place::Within || !within_a_texel([a, b, c], [u, v])) {
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
    fraction(cell.into_iter().fold(begun(seed), mixed))
}

/// The bits of a hash before any number is mixed in.
fn begun(seed: u32) -> u32 {
    seed ^ 0x9e37_79b9
}

#[inline]
fn mixed(mut bits: u32, number: i32) -> u32 {
    bits = (bits ^ number as u32).wrapping_mul(0x85eb_ca6b);
    bits ^= bits >> 13;
    bits = bits.wrapping_mul(0xc2b2_ae35);
    bits ^ bits >> 16
}

#[inline]
fn fraction(bits: u32) -> f32 {
    (bits >> 8) as f32 / 8_388_608.0 - 1.0
}

/// Smooth noise in space with details of `size` [m], from −1 to 1.
pub(crate) fn noise(p: &Point3<f64>, size: [f64; 3], seed: u32) -> f32 {
    let at = Vector3::from_fn(|i, _| p[i] / size[i]);
    let cell = at.map(floored);
    let t = (at - cell.map(|it| it as f64)).map(|it| (it * it * (3.0 - 2.0 * it)) as f32);
    let [x, y, z] = [0, 1, 2].map(|i| cell[i] as i32);
    // The [`hash`] of each corner of the cell, what two of them share mixed once.
    let of_x = [0, 1].map(|dx| mixed(begun(seed), x.wrapping_add(dx)));
    let along_y = |dz: i32| {
        let [low, high] = [0, 1].map(|dy| {
            let [near, far] = of_x.map(|it| fraction(mixed(mixed(it, y.wrapping_add(dy)), z.wrapping_add(dz))));
            near + (far - near) * t.x
        });
        low + (high - low) * t.y
    };
    let low = along_y(0);
    low + (along_y(1) - low) * t.z
}

/// Small round spots, at most one in each cell of `size` [m] where `share` of the cells have one of `radius` [m]: 0 to 1.
pub(super) fn freckles(p: &Point3<f64>, size: f64, share: f32, radius: f64, seed: u32) -> f32 {
    let cell = [0, 1, 2].map(|i| floored(p[i] / size) as i32);
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

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    #[test]
    fn albedos_lie_between_those_of_the_four_texels_around() {
        let mut random = Random::new(3);
        let (width, height) = (37, 23);
        let shades: Vec<u8> = (0..width * height).map(|_| random.below(256) as u8).collect();
        let texture = Texture::new(width, shades.clone());
        for _ in 0..5000 {
            let places = [(); 4].map(|()| {
                [width, height].map(|side| random.uniform_in(0.0, side as f64 - 1.001)).map(|it| (it * 65_536.0) as i32)
            });
            let found = texture.at([0, 1].map(|axis| i32x4::from(places.map(|it| it[axis])))).to_array();
            for ([column, row], found) in places.into_iter().zip(found) {
                let [x, y] = [column, row].map(|it| f64::from(it & 0xFFFF) / 65_536.0);
                let first = (row >> 16) as usize * width + (column >> 16) as usize;
                let [a, b, c, d] = [0, 1, width, width + 1].map(|it| f64::from(shades[first + it]) / 255.0);
                let expected = (a * (1.0 - x) + b * x) * (1.0 - y) + (c * (1.0 - x) + d * x) * y;
                assert!((f64::from(found) - expected).abs() < 1e-3, "{found} {expected} at {column}, {row}");
            }
        }
        // Outside there is nothing, wherever that is.
        let far = |it: i32| texture.at([i32x4::splat(0), i32x4::splat(it)]).to_array();
        assert_eq!([i32::MIN, -65_536, 23 << 16, i32::MAX].map(far), [[0.0; 4]; 4]);
        assert_eq!(Texture::default().at([i32x4::splat(0); 2]).to_array(), [0.0; 4]);
    }

    #[test]
    fn noise_is_that_of_the_lattice_and_stays_within_one() {
        let mut random = Random::new(9);
        for _ in 0..5000 {
            let p = Point3::from([(); 3].map(|()| random.uniform_in(-0.2, 0.2)));
            let size = [(); 3].map(|()| random.uniform_in(0.5e-3, 20e-3));
            let found = noise(&p, size, 77);
            let at = [0, 1, 2].map(|i| p[i] / size[i]);
            let mut expected = 0.0;
            for corner in 0..8 {
                let side = [0, 1, 2].map(|i| corner >> i & 1);
                let cell = [0, 1, 2].map(|i| at[i].floor() as i32 + side[i]);
                let weight = |i: usize| {
                    let t = at[i] - at[i].floor();
                    let smooth = t * t * (3.0 - 2.0 * t);
                    if side[i] == 1 { smooth } else { 1.0 - smooth }
                };
                expected += f64::from(hash(cell, 77)) * weight(0) * weight(1) * weight(2);
            }
            assert!((f64::from(found) - expected).abs() < 1e-5 && found.abs() <= 1.0, "{found} {expected} at {p}");
        }
    }

    #[test]
    fn every_triangle_is_painted_itself_and_a_texel_beyond() {
        let corner = |x: f64, y: f64| Point3::new(x, y, 0.0);
        // Two triangles that meet along a diagonal; texels are millimetres.
        let rest = vec![corner(10.0, 10.0), corner(40.0, 10.0), corner(10.0, 40.0), corner(40.0, 40.0)];
        let triangle = |corners: [u32; 3], material| {
            let texels = corners.map(|it| [rest[it as usize].x as f32, rest[it as usize].y as f32]);
            Triangle { corners, texels, material }
        };
        let triangles = vec![triangle([0, 1, 2], Material::Eye), triangle([1, 3, 2], Material::Mouth)];
        let (follow, openness) = (vec![0.0; 4], vec![1.0; 4]);
        let surface = Surface { rest, triangles, modes: Vec::new(), follow, openness };
        let albedo = |_: &Point3<f64>, material| if material == Material::Eye { 0.2 } else { 0.8 };
        let texture = super::paint(&surface, [60, 70], &Paint { dots: Vec::new() }, albedo);
        let [eye, mouth] = [0.2_f32, 0.8].map(|it| (it * 254.0) as u8 + 1);
        for (i, &shade) in texture.shades.iter().enumerate() {
            let (x, y) = (i % 60, i / 60);
            let is_inside = (10..=40).contains(&x) && (10..=40).contains(&y);
            let outside = [x, y].map(|it| 10_usize.saturating_sub(it) + it.saturating_sub(40));
            match x + y {
                // On the diagonal the latter one wins.
                50.. if is_inside => assert_eq!(shade, mouth, "{x} {y}"),
                _ if is_inside => assert_eq!(shade, eye, "{x} {y}"),
                _ if outside.iter().sum::<usize>() == 1 => assert!(shade == eye || shade == mouth, "{x} {y}"),
                _ if outside.iter().any(|it| *it > 1) => assert_eq!(shade, 0, "{x} {y}"),
                _ => (),
            }
        }
    }
}
