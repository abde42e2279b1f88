//! Where lines of sight first meet a surface of triangles, exactly: which triangle by drawing all of them with a depth, then the point by the line and the
//! triangle's plane. Cameras, projectors (what they do not see is in shadow) and scores use it.

use nalgebra::{Isometry3, Point2, Point3, Vector3};

use crate::painted::{Skin, Triangle};
use crate::truth::TrueCamera;

/// No triangle.
const NONE: u32 = u32::MAX;
/// Nothing is seen of a surface that comes nearer than this [m].
const NEAREST_M: f64 = 0.15;
/// A triangle reaches so far beyond its edges, so that no gaps are left between two of them, as a part of its weights.
const OVERLAP: f32 = 1e-4;

/// A triangle's plane, and how weights of its corners follow from a point on it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Facet {
    corner: Point3<f64>,
    normal: Vector3<f64>,
    to_second: Vector3<f64>,
    to_third: Vector3<f64>,
}

impl Facet {
    /// Of all triangles of a surface.
    pub fn all(triangles: &[Triangle], vertices: &[Point3<f64>]) -> Vec<Facet> {
        triangles.iter().map(|it| Facet::of(it, vertices)).collect()
    }

    /// Of one triangle.
    #[inline]
    pub fn of(triangle: &Triangle, vertices: &[Point3<f64>]) -> Facet {
        let [a, b, c] = triangle.corners.map(|it| vertices[it as usize]);
        let (ab, ac) = (b - a, c - a);
        let normal = ab.cross(&ac);
        let square = normal.norm_squared().max(1e-30);
        Facet { corner: a, normal, to_second: ac.cross(&normal) / square, to_third: normal.cross(&ab) / square }
    }

    /// How far along a line it meets the plane [lengths of `along`].
    #[inline]
    pub fn depth(&self, from: &Point3<f64>, along: &Vector3<f64>) -> f64 {
        (self.corner - from).dot(&self.normal) / along.dot(&self.normal)
    }

    /// The weights of the corners at a point on the plane; they add up to 1.
    #[inline]
    pub fn weights(&self, point: &Point3<f64>) -> [f64; 3] {
        let off = point - self.corner;
        let (second, third) = (off.dot(&self.to_second), off.dot(&self.to_third));
        [1.0 - second - third, second, third]
    }
}

/// Vertices as a camera images them: column, row [px], and 1 / depth [1/m].
pub(crate) fn imaged(camera: &TrueCamera, skin: &Skin) -> Option<Vec<[f32; 3]>> {
    let one = |vertex: &Point3<f64>| {
        let depth = (camera.camera_from_world * vertex).z;
        let pixel = camera.project(vertex).filter(|_| depth > NEAREST_M)?;
        Some([pixel.x as f32, pixel.y as f32, (1.0 / depth) as f32])
    };
    skin.vertices.iter().map(one).collect()
}

/// Lines of sight of a camera's pixels, in its own space, at a depth of 1.
pub(crate) struct Lines {
    optics: TrueCamera,
    at: Vec<[f32; 2]>,
}

impl Lines {
    /// Those of a camera: `known` ones where it has the same optics.
    pub fn know<'l>(known: &'l mut Option<Lines>, camera: &TrueCamera) -> &'l Lines {
        let optics = camera.standing(Isometry3::identity());
        match known.take().filter(|it| it.optics == optics) {
            Some(lines) => known.insert(lines),
            None => known.insert(Lines::new(optics)),
        }
    }

    fn new(optics: TrueCamera) -> Lines {
        let [width, height] = optics.image_size;
        let places = (0..height).flat_map(|row| (0..width).map(move |column| [column, row].map(f64::from)));
        let at = places.map(|[column, row]| {
            let ray = optics.ray(&Point2::new(column, row));
            // Where a lens has no inverse nothing is seen: a line to the side meets nothing.
            ray.map_or([f32::NAN; 2], |it| {
                [(it.direction.x / it.direction.z) as f32, (it.direction.y / it.direction.z) as f32]
            })
        });
        Lines { at: at.collect(), optics }
    }

    /// Of a place that lies `shift` beside the pixel's middle, against the way in which the surface was moved.
    #[inline]
    pub fn at_shifted(&self, column: usize, row: usize, width: usize, shift: [f64; 2]) -> [f64; 2] {
        let height = self.at.len() / width;
        let at = |column: usize, row: usize| self.at[row * width + column].map(f64::from);
        let here = at(column, row);
        let slope = |[ahead, behind]: [[f64; 2]; 2], steps: usize| {
            [0, 1].map(|it| (ahead[it] - behind[it]) / steps.max(1) as f64)
        };
        let (left, right) = (column.saturating_sub(1), (column + 1).min(width - 1));
        let (up, down) = (row.saturating_sub(1), (row + 1).min(height - 1));
        let across = slope([at(right, row), at(left, row)], right - left);
        let along = slope([at(column, down), at(column, up)], down - up);
        [0, 1].map(|it| here[it] - across[it] * shift[0] - along[it] * shift[1])
    }
}

/// The first triangle along each pixel's line of sight, over the part of the picture that the surface takes up.
#[derive(Debug, Default)]
pub(crate) struct FirstHits {
    from: [usize; 2],
    size: [usize; 2],
    /// By pixel of that part: 1 / depth, and the triangle.
    nearest: Vec<(f32, u32)>,
}

impl FirstHits {
    /// Draws the surface, whose vertices lie at `imaged`, moved by `shift` [px], into a picture of `image_size`.
    pub fn draw(&mut self, imaged: &[[f32; 3]], triangles: &[Triangle], shift: [f64; 2], image_size: [u32; 2]) {
        self.begin(imaged.iter(), shift, image_size);
        self.add(imaged, triangles, 0, shift);
    }

    /// Makes room for what [`Self::add`] draws, which lies where `imaged` does: vertices with a depth of 0 do not count.
    pub fn begin<'v>(&mut self, imaged: impl Iterator<Item = &'v [f32; 3]>, shift: [f64; 2], image_size: [u32; 2]) {
        let shift = shift.map(|it| it as f32);
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        for vertex in imaged.filter(|it| it[2] > 0.0) {
            for axis in 0..2 {
                low[axis] = low[axis].min(vertex[axis] + shift[axis]);
                high[axis] = high[axis].max(vertex[axis] + shift[axis]);
            }
        }
        let from = [0, 1].map(|axis| low[axis].floor().max(0.0) as usize);
        let to = [0, 1].map(|axis| ((high[axis] + 1.0).ceil().max(0.0) as usize).min(image_size[axis] as usize));
        self.from = from;
        self.size = [0, 1].map(|axis| to[axis].saturating_sub(from[axis]));
        self.nearest.clear();
        self.nearest.resize(self.size[0] * self.size[1], (0.0, NONE));
    }

    /// Draws triangles that are counted from `first` on; those with a corner whose depth is 0 are left out.
    pub fn add(&mut self, imaged: &[[f32; 3]], triangles: &[Triangle], first: u32, shift: [f64; 2]) {
        if self.nearest.is_empty() {
            return;
        }
        let off = [0, 1].map(|axis| shift[axis] as f32 - self.from[axis] as f32);
        for (number, triangle) in (first..).zip(triangles) {
            let corners = triangle.corners.map(|it| {
                let [x, y, inverse] = imaged[it as usize];
                [x + off[0], y + off[1], inverse]
            });
            if corners.iter().all(|it| it[2] > 0.0) {
                self.draw_one(number, corners);
            }
        }
    }

    fn draw_one(&mut self, number: u32, [a, b, c]: [[f32; 3]; 3]) {
        let (ab, ac) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
        // Rows run downwards: seen from outside corners run clockwise here.
        let doubled = ac[0] * ab[1] - ab[0] * ac[1];
        if doubled <= 1e-9 {
            return;
        }
        let bound = |axis: usize| {
            let low = a[axis].min(b[axis]).min(c[axis]).ceil().max(0.0) as usize;
            let high = a[axis].max(b[axis]).max(c[axis]).floor();
            (low, if high < 0.0 { 0 } else { (high as usize + 1).min(self.size[axis]) })
        };
        let ((left, right), (top, bottom)) = (bound(0), bound(1));
        let per = 1.0 / doubled;
        for row in top..bottom {
            let dy = row as f32 - a[1];
            for column in left..right {
                let dx = column as f32 - a[0];
                let second = (ac[0] * dy - ac[1] * dx) * per;
                let third = (ab[1] * dx - ab[0] * dy) * per;
                if second < -OVERLAP || third < -OVERLAP || second + third > 1.0 + OVERLAP {
                    continue;
                }
                let inverse = a[2] + (b[2] - a[2]) * second + (c[2] - a[2]) * third;
                let place = &mut self.nearest[row * self.size[0] + column];
                if inverse > place.0 {
                    *place = (inverse, number);
                }
            }
        }
    }

    fn at(&self, column: usize, row: usize) -> Option<&(f32, u32)> {
        let (x, y) = (column.checked_sub(self.from[0])?, row.checked_sub(self.from[1])?);
        (x < self.size[0] && y < self.size[1]).then(|| &self.nearest[y * self.size[0] + x]).filter(|it| it.1 != NONE)
    }

    /// The triangle that a pixel sees.
    #[inline]
    pub fn triangle(&self, column: usize, row: usize) -> Option<usize> {
        self.at(column, row).map(|it| it.1 as usize)
    }

    /// How far away the surface is at a pixel, along the optical axis [m].
    #[inline]
    pub fn depth(&self, column: usize, row: usize) -> Option<f32> {
        self.at(column, row).map(|it| 1.0 / it.0)
    }

    /// Columns and rows that it takes up.
    pub fn area(&self) -> [std::ops::Range<usize>; 2] {
        [0, 1].map(|axis| self.from[axis]..self.from[axis] + self.size[axis])
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_geometry::Camera;
    use nalgebra::Point2;

    use super::*;
    use crate::world::{BustSettings, SceneSettings, World};

    #[test]
    fn each_pixel_sees_the_triangle_that_its_line_of_sight_meets_first() {
        let settings = SceneSettings { people: 0, bust: Some(BustSettings::default()), ..SceneSettings::default() };
        let world = World::new(settings, &Random::new(3));
        let (part, skin) = world.part(foveate_messages::Time::ZERO).unwrap();
        let camera = Camera::look_at([-1.2, 1.9, 1.8].into(), [0.0, 0.0, 1.5].into(), [160, 120], 700.0);
        let camera = TrueCamera::from(&camera);
        let facets = Facet::all(&part.surface.triangles, &skin.vertices);
        let mut hits = FirstHits::default();
        hits.draw(&imaged(&camera, &skin).unwrap(), &part.surface.triangles, [0.0; 2], camera.image_size);
        let (mut n_seen, mut n_wrong) = (0, 0);
        for (column, row) in (0..120).step_by(5).flat_map(|row| (0..160).step_by(5).map(move |it| (it, row))) {
            let ray = camera.ray(&Point2::new(f64::from(column), f64::from(row))).unwrap();
            let along = ray.direction.into_inner();
            // By the book: every triangle, from outside.
            let met = facets.iter().filter(|it| it.normal.dot(&along) < 0.0).filter_map(|it| {
                let depth = it.depth(&ray.origin, &along);
                it.weights(&ray.at(depth)).iter().all(|weight| *weight >= 0.0).then_some(depth)
            });
            let expected = met.fold(f64::INFINITY, f64::min);
            let found = hits.triangle(column as usize, row as usize);
            let found = found.map_or(f64::INFINITY, |it| facets[it].depth(&ray.origin, &along));
            n_seen += i32::from(expected.is_finite());
            // At the very rim a hair decides.
            n_wrong +=
                i32::from(found != expected && (found - expected).abs().partial_cmp(&1e-6).is_none_or(|it| it.is_gt()));
        }
        assert!(n_seen > 100 && n_wrong <= 1, "{n_wrong} of {n_seen}");
    }
}
