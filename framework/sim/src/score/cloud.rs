//! Recovered points of a surface against the true surface, along the true camera's lines of sight.

use foveate_messages::PointCloud;
use nalgebra::{Point2, Point3, Vector3};

use crate::painted::{Skin, Triangle};
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

/// How much of each there is, to part one cloud from those before it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Counts {
    pub n_errors: usize,
    pub n_beside: usize,
    pub n_visible: usize,
    pub n_covered: usize,
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
        (triangles, skin): (&[Triangle], &std::sync::Arc<Skin>),
        beam: &mut Beam,
        near_px: f64,
    ) {
        self.n_clouds += 1;
        beam.light(triangles, skin);
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

    pub fn counts(&self) -> Counts {
        let CloudTrack { errors, n_beside, n_visible, n_covered, .. } = self;
        Counts { n_errors: errors.len(), n_beside: *n_beside, n_visible: *n_visible, n_covered: *n_covered }
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

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_geometry::Camera;
    use foveate_messages::{CameraId, CloudPoint, Time};
    use nalgebra::Matrix3;

    use super::*;
    use crate::projector::{Projection, ProjectorSettings};
    use crate::world::{BustSettings, SceneSettings, World};

    fn camera() -> Camera {
        Camera::look_at([-0.7, 2.9, 1.7].into(), [0.0, 0.0, 1.5].into(), [160, 120], 1450.0)
    }

    /// A cloud of every `step`-th pixel that sees the bust, each point `off` metres behind it; then points beside the bust.
    fn track(step: usize, off: f64, n_beside: usize) -> CloudTrack {
        let settings = SceneSettings { people: 0, bust: Some(BustSettings::default()), ..SceneSettings::default() };
        let world = World::new(settings, &Random::new(3));
        let projector = Camera::look_at([1.0, 2.2, 1.9].into(), [0.0, 0.0, 1.5].into(), [512, 384], 1300.0);
        let projection =
            Projection::new("projector", CameraId(1), &projector, &ProjectorSettings::default(), &Random::new(4))
                .unwrap();
        let (triangles, skin) = world.shape(Time::ZERO).unwrap();
        let camera = TrueCamera::from(&camera());
        let mut hits = FirstHits::default();
        hits.draw(&imaged(&camera, &skin).unwrap(), triangles, [0.0; 2], camera.image_size);
        let facets = Facet::all(triangles, &skin.vertices);
        let mut cloud = PointCloud::default();
        let mut push = |column: usize, row: usize, depth: f64| {
            let ray = camera.ray(&Point2::new(column as f64, row as f64)).unwrap();
            cloud.push(&CloudPoint {
                position: ray.at(depth).cast(),
                covariance: Matrix3::identity(),
                normal: Vector3::y(),
                confidence: 1.0,
                pixel: [column as u16, row as u16],
                colour: [200; 3],
            });
        };
        for (column, row) in (0..120).step_by(step).flat_map(|row| (0..160).step_by(step).map(move |it| (it, row))) {
            if let Some(number) = hits.triangle(column, row) {
                let ray = camera.ray(&Point2::new(column as f64, row as f64)).unwrap();
                push(column, row, facets[number].depth(&ray.origin, &ray.direction) + off);
            }
        }
        (0..n_beside).for_each(|it| push(it, 0, 3.0));
        let mut found = CloudTrack::default();
        found.add(&cloud, &camera, (triangles, &skin), &mut Beam::new(&projection, &world), 2.0);
        found
    }

    #[test]
    fn points_behind_the_surface_are_as_far_off_as_they_are_and_wrong_beyond_the_limit() {
        for off in [0.0, 3e-4, -2e-3, 8e-3] {
            let track = track(2, off, 0);
            assert!(track.errors.len() > 1000 && track.n_beside == 0);
            assert!(track.errors.iter().all(|it| (it - off).abs() < 1e-6), "{off}");
            assert_eq!(track.n_wrong(5e-3), if off > 5e-3 { track.n_points() } else { 0 });
        }
        let beside = track(4, 0.0, 7);
        assert!(beside.n_beside == 7 && beside.n_wrong(5e-3) == 7);
    }

    #[test]
    fn the_surface_is_covered_where_points_are_near_in_the_projectors_picture() {
        // A camera pixel is about 0.9 pixels of the projector.
        let [dense, sparse] = [1, 10].map(|it| {
            let track = track(it, 0.0, 0);
            (track.n_covered as f64 / track.n_visible as f64, track.n_visible)
        });
        assert!(dense.0 > 0.999 && dense.1 > 4000, "{dense:?}");
        // Discs of 2 px around points 9 px apart.
        assert!((0.1..0.3).contains(&sparse.0) && sparse.1 == dense.1, "{sparse:?}");
    }
}
