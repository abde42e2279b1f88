//! A surface as seen from the front, without perspective.

use foveate::prelude::*;
use nalgebra::{Matrix3, Point2, Point3, Vector3};

use crate::cloud::shade;

/// Part of the picture that stays empty at each edge.
const MARGIN: f64 = 0.03;
/// Largest ratio of columns to rows, or of rows to columns.
const MOST_STRETCHED: f64 = 4.0;

/// The mean normal of a closed surface is shorter than this [–].
const CLOSED: f64 = 0.2;
/// Cameras are on one side of a place where the mean of the directions to them is longer than this [–].
const ONE_SIDED: f64 = 0.5;

/// The direction to the cameras that are on one side of `place`; to the first one where they surround it.
fn side_of(cameras: &[Point3<f64>], place: &Point3<f64>) -> Option<Vector3<f64>> {
    let ways: Vec<Vector3<f64>> = cameras.iter().filter_map(|it| (it - place).try_normalize(1e-9)).collect();
    let mean = ways.iter().sum::<Vector3<f64>>() / ways.len() as f64;
    if mean.norm() > ONE_SIDED { Some(mean) } else { ways.first().copied() }
}

/// Pictures of a surface.
pub(super) struct View {
    /// Columns, rows.
    pub size: [u32; 2],
    /// 8 bits a pixel; 0 where there is no surface.
    pub shaded: Vec<u8>,
    /// Distance from a plane a little in front of the nearest point, by pixel; infinite where there is no surface [m].
    depths: Vec<f32>,
}

/// View and size of pictures of surfaces.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame {
    view_from_mesh: Matrix3<f64>,
    /// Centre of the picture, in the view [m].
    middle: Vector3<f64>,
    /// The plane that depths are measured from, along the view [m].
    before: f64,
    pixel_m: f64,
    size: [u32; 2],
}

impl Frame {
    /// From the front of the surface; for a closed one from the side of `cameras`. `None` for a surface without a triangle.
    pub fn of(mesh: &Mesh, cameras: &[Point3<f64>], rows: u32) -> Option<Frame> {
        mesh.triangles().next()?;
        let vertices: Vec<MeshVertex> = mesh.vertices().collect();
        let n = vertices.len() as f64;
        let facing = vertices.iter().map(|it| it.normal.cast::<f64>()).sum::<Vector3<f64>>() / n;
        let middle = Point3::from(vertices.iter().map(|it| it.position.cast::<f64>().coords).sum::<Vector3<f64>>() / n);
        let is_open = facing.norm() > CLOSED;
        let back = -Some(facing).filter(|_| is_open).or_else(|| side_of(cameras, &middle)).unwrap_or(facing);
        let back = back.try_normalize(1e-9).unwrap_or_else(Vector3::y);
        // As a camera: x to the right, y down, z away from who looks; up is up, or north where the view is from above.
        let up = if back.z.abs() < 0.95 { Vector3::z() } else { Vector3::y() };
        let right = back.cross(&up).normalize();
        let view_from_mesh = Matrix3::from_rows(&[right.transpose(), back.cross(&right).transpose(), back.transpose()]);
        let places = || vertices.iter().map(|it| view_from_mesh * it.position.coords.cast::<f64>());
        let low = places().fold(Vector3::repeat(f64::INFINITY), |sum, it| sum.inf(&it));
        let high = places().fold(Vector3::repeat(f64::NEG_INFINITY), |sum, it| sum.sup(&it));
        let extent = (high - low).map(|it| it.max(1e-9));
        let height = extent.y.max(extent.x / MOST_STRETCHED);
        let pixel_m = height * (1.0 + 2.0 * MARGIN) / f64::from(rows);
        let columns = ((extent.x / pixel_m + 2.0 * MARGIN * f64::from(rows)).ceil() as u32).max(rows / 4);
        // Beyond 0, which stands for nothing.
        let before = low.z - 1e-3;
        Some(Frame { view_from_mesh, middle: (low + high) / 2.0, before, pixel_m, size: [columns, rows] })
    }

    /// The part of a surface that is in the frame.
    pub fn view(&self, mesh: &Mesh) -> View {
        let Frame { view_from_mesh, middle, before, pixel_m, size } = *self;
        let [columns, rows] = size;
        let vertices: Vec<MeshVertex> = mesh.vertices().collect();
        let places: Vec<Point3<f64>> = vertices.iter().map(|it| view_from_mesh * it.position.cast::<f64>()).collect();
        let pixel = |it: &Point3<f64>| {
            let at = (it.coords - middle).xy() / pixel_m;
            Point2::new(at.x + f64::from(columns - 1) / 2.0, at.y + f64::from(rows - 1) / 2.0)
        };
        let n = columns as usize * rows as usize;
        let mut view = View { size, shaded: vec![0; n], depths: vec![f32::INFINITY; n] };
        for corners in mesh.triangles() {
            let corners = corners.map(|it| it as usize);
            let [a, b, c] = corners.map(|it| pixel(&places[it]));
            let double = (b - a).perp(&(c - a));
            if double == 0.0 || !double.is_finite() {
                continue;
            }
            let range = |of: fn(&Point2<f64>) -> f64, size: u32| {
                let (low, high) = (of(&a).min(of(&b)).min(of(&c)), of(&a).max(of(&b)).max(of(&c)));
                low.ceil().max(0.0) as u32..(high.floor() + 1.0).clamp(0.0, f64::from(size)) as u32
            };
            for (x, y) in range(|it| it.y, rows).flat_map(|y| range(|it| it.x, columns).map(move |x| (x, y))) {
                let at = Point2::new(f64::from(x), f64::from(y));
                let weights =
                    [(c - b).perp(&(at - b)), (a - c).perp(&(at - c)), (b - a).perp(&(at - a))].map(|it| it / double);
                if weights.iter().any(|it| *it < 0.0) {
                    continue;
                }
                let place = (y * columns + x) as usize;
                let depth: f64 =
                    corners.iter().zip(weights).map(|(it, weight)| places[*it].z * weight).sum::<f64>() - before;
                if depth < f64::from(view.depths[place]) {
                    view.depths[place] = depth as f32;
                    let normal: Vector3<f64> = corners
                        .iter()
                        .zip(weights)
                        .map(|(it, weight)| vertices[*it].normal.cast::<f64>() * weight)
                        .sum();
                    view.shaded[place] = shade(&(view_from_mesh * normal.normalize()));
                }
            }
        }
        view
    }
}

impl View {
    /// 16 bits a pixel, big endian, in units of `unit_m`.
    pub fn range(&self, unit_m: f64) -> Vec<u8> {
        let level = |it: &f32| {
            if it.is_finite() { (f64::from(*it) / unit_m).round().clamp(1.0, 65_535.0) as u16 } else { 0 }
        };
        self.depths.iter().map(level).flat_map(u16::to_be_bytes).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_roof_is_seen_from_where_it_faces_with_up_upwards() {
        let roof = super::super::tests::roof();
        let view = Frame::of(&roof, &[], 100).unwrap().view(&roof);
        // As wide as it is high, but for rounding up.
        let [columns, rows] = view.size.map(|it| it as usize);
        assert!(rows == 100 && (100..=101).contains(&columns), "{columns}");
        let filled = view.shaded.iter().filter(|it| **it > 0).count() as f64 / view.shaded.len() as f64;
        assert!((0.8..0.9).contains(&filled), "{filled}");
        let nearest = (0..view.depths.len()).min_by(|a, b| view.depths[*a].total_cmp(&view.depths[*b])).unwrap();
        let (x, y) = (nearest % columns, nearest / columns);
        assert!((48..=52).contains(&x) && (48..=51).contains(&y), "{x} {y}");
        assert!(Frame::of(&Mesh::new([], &[]), &[], 100).is_none());
    }

    #[test]
    fn a_closed_surface_is_seen_from_its_cameras() {
        // A cube with a dent in its near side, along -x: of its corners one pair is nearer together there.
        let corner = |index: usize| {
            let [x, y, z] = [0, 1, 2].map(|axis| if index >> axis & 1 == 1 { 0.1_f32 } else { -0.1 });
            let place = Point3::new(x, if x < 0.0 { 0.5 * y } else { y }, z);
            MeshVertex { position: place, normal: place.coords.normalize(), weight: 1.0, sigma: 1e-4, colour: [0; 3] }
        };
        let faces = [[0, 2, 6, 4], [1, 5, 7, 3], [0, 4, 5, 1], [2, 3, 7, 6], [0, 1, 3, 2], [4, 6, 7, 5]];
        let triangles: Vec<[u32; 3]> = faces.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
        let cube = Mesh::new((0..8).map(corner), &triangles);
        let nearest_is_narrow = |cameras: &[Point3<f64>]| {
            let view = Frame::of(&cube, cameras, 100).unwrap().view(&cube);
            let near = view.depths.iter().filter(|it| **it < 0.01).count() as f64;
            near / (view.depths.iter().filter(|it| it.is_finite()).count() as f64) < 0.75
        };
        let at = |x: f64, y: f64| Point3::new(x, y, 0.0);
        assert!(nearest_is_narrow(&[at(-2.0, 0.3), at(-2.0, -0.3)]));
        assert!(!nearest_is_narrow(&[at(2.0, 0.3), at(2.0, -0.3)]));
        // All around it: from the first.
        assert!(nearest_is_narrow(&[at(-2.0, 0.0), at(0.0, 2.0), at(2.0, 0.0), at(0.0, -2.0)]));
    }
}
