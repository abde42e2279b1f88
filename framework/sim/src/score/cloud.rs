//! Recovered points of a surface against the true surface, along the true camera's lines of sight.

use foveate_messages::PointCloud;
use nalgebra::{Point2, Point3, Vector3};

use crate::painted::Part;
use crate::painted::Skin;
use crate::projector::Beam;
use crate::sight::{Facet, FirstHits, imaged};
use crate::truth::TrueCamera;

/// What clouds so far are like.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct CloudTrack {
    /// Of points that were seen on the surface, how much farther away they are than it [m].
    pub errors: Vec<f64>,
    /// Points of pixels that do not see the surface at all, and have no neighbour that does.
    pub n_beside: usize,
    /// Pixels that see a part of the surface which the projector lights; those of them near a point.
    pub n_visible: usize,
    pub n_covered: usize,
    /// Distances on the surface between neighbouring pixels of the camera [m].
    pub pixels_m: Vec<f64>,
    pub n_clouds: usize,
}

/// Whether a point is near in the projector's picture.
struct Near {
    size: [usize; 2],
    /// Points by projector pixel.
    cells: Vec<Vec<[f32; 2]>>,
    reach: f32,
}

impl Near {
    fn new(size: [u32; 2], reach: f32) -> Near {
        let size = size.map(|it| it as usize);
        Near { size, cells: vec![Vec::new(); size[0] * size[1]], reach }
    }

    fn cell(&self, at: f32, axis: usize) -> usize {
        ((at + 0.5).max(0.0) as usize).min(self.size[axis] - 1)
    }

    fn add(&mut self, at: [f32; 2]) {
        let place = self.cell(at[1], 1) * self.size[0] + self.cell(at[0], 0);
        self.cells[place].push(at);
    }

    fn has(&self, at: [f32; 2]) -> bool {
        let range = |axis: usize| self.cell(at[axis] - self.reach, axis)..=self.cell(at[axis] + self.reach, axis);
        range(1).any(|row| {
            range(0).any(|column| {
                let cell = &self.cells[row * self.size[0] + column];
                cell.iter().any(|it| (it[0] - at[0]).hypot(it[1] - at[1]) <= self.reach)
            })
        })
    }
}

/// The triangle that a pixel sees. A pixel is an area: where its middle just misses the surface, that of a neighbour.
fn seen_at(hits: &FirstHits, pixel: [u16; 2]) -> Option<usize> {
    let [column, row] = pixel.map(usize::from);
    let beside = [(1, 1), (0, 1), (2, 1), (1, 0), (1, 2)];
    beside.into_iter().find_map(|(x, y)| hits.triangle((column + x).checked_sub(1)?, (row + y).checked_sub(1)?))
}

impl CloudTrack {
    /// Compares a cloud with the surface as the camera truly saw it. `near_px` is how near to a point the surface counts as covered, in the projector's picture.
    pub fn add(
        &mut self,
        cloud: &PointCloud,
        camera: &TrueCamera,
        (part, skin): (&Part, &std::sync::Arc<Skin>),
        beam: &mut Beam,
        near_px: f64,
    ) {
        self.n_clouds += 1;
        beam.light(part, skin);
        let triangles = &part.surface.triangles;
        let facets = Facet::all(triangles, &skin.vertices);
        let mut hits = FirstHits::default();
        if let Some(places) = imaged(camera, skin) {
            hits.draw(&places, triangles, [0.0; 2], camera.image_size);
        }
        let mut near = Near::new(beam.optics().image_size, near_px as f32);
        for point in cloud.iter() {
            let pixel = point.pixel.map(f64::from);
            let place = point.position.cast::<f64>();
            if let Some(at) = beam.optics().project(&place).filter(|it| beam.optics().has_pixel(it)) {
                near.add([at.x as f32, at.y as f32]);
            }
            let Some((ray, number)) = camera.ray(&Point2::from(pixel)).zip(seen_at(&hits, point.pixel)) else {
                self.n_beside += 1;
                continue;
            };
            let depth = facets[number].depth(&ray.origin, &ray.direction);
            self.errors.push(ray.depth_of(&place) - depth);
        }
        let [columns, rows] = hits.area();
        for (column, row) in rows.flat_map(|row| columns.clone().map(move |it| (it, row))) {
            let Some(number) = hits.triangle(column, row) else { continue };
            let Some(ray) = camera.ray(&Point2::new(column as f64, row as f64)) else { continue };
            let (triangle, facet) = (&triangles[number], &facets[number]);
            let point: Point3<f64> = ray.at(facet.depth(&ray.origin, &ray.direction));
            let weights = facet.weights(&point);
            let corners = triangle.corners.into_iter().zip(weights);
            let normal: Vector3<f64> = corners.fold(Vector3::zeros(), |sum, (corner, weight)| {
                sum + skin.normals[corner as usize].cast::<f64>() * weight
            });
            let lit = beam.at(&point, triangle.corners, weights, &normal.normalize());
            // Half in shadow is in shadow; so is what turns away from the light.
            let Some(lit) = lit.filter(|it| it.white > 0.0 && it.free > 0.5) else { continue };
            self.n_visible += 1;
            self.n_covered += usize::from(near.has(lit.at));
            self.pixels_m.push((point - ray.origin).norm() / camera.intrinsics.focal[0]);
        }
    }

    /// Points that are wrong: farther than `wrong_m` from the surface along the line of sight, or where there is none.
    pub fn n_wrong(&self, wrong_m: f64) -> usize {
        self.n_beside + self.errors.iter().filter(|it| it.is_nan() || it.abs() > wrong_m).count()
    }

    /// Points in all.
    pub fn n_points(&self) -> usize {
        self.errors.len() + self.n_beside
    }
}
