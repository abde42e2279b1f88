//! A joined surface against the true one, and the poses of its clouds against those of the thing that moved.

use std::collections::BTreeMap;
use std::sync::Arc;

use foveate_messages::{Mesh, ScaleCloud};
use nalgebra::{Isometry3, Point2, Point3, Vector3, Vector6};

use crate::nearest::{Nearest, cell};
use crate::painted::{Skin, Triangle};
use crate::projector::Beam;
use crate::sight::{Facet, FirstHits, imaged};
use crate::truth::TrueCamera;

/// Width of the cells in which true surface that was seen counts once [m].
const SEEN_M: f64 = 1e-3;

/// What surfaces and clouds so far are like.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct SurfaceTrack {
    /// Places of the true surface that a camera saw lit, in the space of the thing, once in each cell.
    seen: BTreeMap<[i64; 3], Point3<f64>>,
    /// By cloud: from the joined space to that of the thing, with the middle of the cloud's points in the joined space and what the pose's covariance says.
    poses: Vec<Placed>,
}

#[derive(Debug, Clone, PartialEq)]
struct Placed {
    thing_from_joined: Isometry3<f64>,
    middle: Point3<f64>,
    covariance: nalgebra::Matrix6<f64>,
}

/// How a surface compares.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct SurfaceErrors {
    /// Of vertices near the true surface: how far outside of it they are [m].
    pub errors: Vec<f64>,
    /// The same over what each states.
    pub normalised: Vec<f64>,
    /// Vertices that are farther from it than was looked.
    pub n_wrong: usize,
    /// Places of the true surface that were seen lit, and those of them near a vertex.
    pub n_seen: usize,
    pub n_complete: usize,
}

impl SurfaceTrack {
    /// Takes in a cloud that was registered: what could be seen when it was taken, and its registered pose.
    pub fn add(
        &mut self,
        cloud: &ScaleCloud,
        camera: &TrueCamera,
        (triangles, skin): (&[Triangle], &Arc<Skin>),
        beam: &mut Beam,
    ) {
        let thing_from_world = skin.world_from_part.inverse();
        let sum: Vector3<f64> = cloud.cloud.iter().map(|it| it.position.cast::<f64>().coords).sum();
        self.poses.push(Placed {
            thing_from_joined: thing_from_world * cloud.world_from_scale,
            middle: Point3::from(sum / cloud.cloud.len().max(1) as f64),
            covariance: cloud.covariance,
        });
        beam.light(triangles, skin);
        let facets = Facet::all(triangles, &skin.vertices);
        let mut hits = FirstHits::default();
        if let Some(places) = imaged(camera, skin) {
            hits.draw(&places, triangles, [0.0; 2], camera.image_size);
        }
        let [columns, rows] = hits.area();
        for (column, row) in rows.flat_map(|row| columns.clone().map(move |it| (it, row))) {
            let Some(number) = hits.triangle(column, row) else { continue };
            let Some(ray) = camera.ray(&Point2::new(column as f64, row as f64)) else { continue };
            let (triangle, facet) = (&triangles[number], &facets[number]);
            let point = ray.at(facet.depth(&ray.origin, &ray.direction));
            let weights = facet.weights(&point);
            let corners = triangle.corners.into_iter().zip(weights);
            let normal: Vector3<f64> = corners
                .fold(Vector3::zeros(), |sum, (it, weight)| sum + skin.normals[it as usize].cast::<f64>() * weight);
            let lit = beam.at(&point, triangle.corners, weights, &normal.normalize());
            if lit.is_some_and(|it| it.white > 0.0 && it.free > 0.5) {
                let place = thing_from_world * point;
                self.seen.entry(cell(&place, SEEN_M)).or_insert(place);
            }
        }
    }

    /// By cloud after the first: how far its middle lies from where the first one has it on the thing [m], and the squared error of the pose over its covariance, 1 on average for honest ones.
    pub fn drifts(&self) -> Vec<(f64, f64)> {
        let Some((first, others)) = self.poses.split_first() else { return Vec::new() };
        let drift = |it: &Placed| {
            let off = first.thing_from_joined.inverse() * it.thing_from_joined;
            let (turn, shift) = (off.rotation.scaled_axis(), off.translation.vector);
            let error = Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z);
            let normalised = it.covariance.try_inverse().map_or(f64::NAN, |weight| error.dot(&(weight * error)) / 6.0);
            ((off * it.middle - it.middle).norm(), normalised)
        };
        others.iter().map(drift).collect()
    }

    /// Compares a surface with the true one as it lay at the surface's time. Vertices farther from it than `wrong_m` are wrong; a place counts as complete with a vertex nearer than `near_m`.
    pub fn compare(
        &self,
        mesh: &Mesh,
        (triangles, skin): (&[Triangle], &Arc<Skin>),
        wrong_m: f64,
        near_m: f64,
    ) -> SurfaceErrors {
        let thing_from_mesh = skin.world_from_part.inverse() * mesh.world_from_mesh;
        let thing_from_world = skin.world_from_part.inverse();
        let vertices: Vec<Point3<f64>> = skin.vertices.iter().map(|it| thing_from_world * it).collect();
        let truth = Nearest::new(triangles, &vertices, wrong_m);
        let mut found = SurfaceErrors { n_seen: self.seen.len(), ..SurfaceErrors::default() };
        let mut cells: BTreeMap<[i64; 3], Vec<Point3<f64>>> = BTreeMap::new();
        for vertex in mesh.vertices() {
            let place = thing_from_mesh * vertex.position.cast::<f64>();
            match truth.find(&place).map(|it| it.distance) {
                Some(error) => {
                    found.errors.push(error);
                    found.normalised.push(error / f64::from(vertex.sigma));
                }
                None => found.n_wrong += 1,
            }
            cells.entry(cell(&place, near_m)).or_default().push(place);
        }
        for place in self.seen.values() {
            let [x, y, z] = cell(place, near_m);
            let mut around =
                (-1..=1).flat_map(|dx| (-1..=1).flat_map(move |dy| (-1..=1).map(move |dz| [x + dx, y + dy, z + dz])));
            let is_near =
                |it: [i64; 3]| cells.get(&it).is_some_and(|list| list.iter().any(|it| (it - place).norm() <= near_m));
            found.n_complete += usize::from(around.any(is_near));
        }
        found
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_messages::{MeshVertex, Time};
    use nalgebra::Matrix6;

    use super::*;
    use crate::world::{BustSettings, SceneSettings, World};

    fn world() -> World {
        let settings = SceneSettings { people: 0, bust: Some(BustSettings::default()), ..SceneSettings::default() };
        World::new(settings, &Random::new(3))
    }

    #[test]
    fn a_surface_that_stands_off_is_off_by_that_and_what_is_missing_is_missing() {
        let world = world();
        let (triangles, skin) = world.shape(Time::ZERO).unwrap();
        let mut track = SurfaceTrack::default();
        let back = skin.world_from_part.inverse();
        for (vertex, normal) in skin.vertices.iter().zip(&skin.normals) {
            let place = back * vertex;
            if (back.rotation * normal.cast::<f64>()).x > 0.3 {
                track.seen.insert(cell(&place, SEEN_M), place);
            }
        }
        for (off, half) in [(0.0, false), (3e-4, false), (-1e-3, true), (0.02, false)] {
            let vertices = skin.vertices.iter().zip(&skin.normals).filter(|(it, _)| !half || (back * *it).y > 0.0);
            let vertices = vertices.map(|(it, normal)| MeshVertex {
                position: (back * (it + normal.cast::<f64>() * off)).cast(),
                normal: *normal,
                weight: 1.0,
                sigma: 1e-4,
                colour: [0; 3],
            });
            let mesh = Mesh { world_from_mesh: skin.world_from_part, ..Mesh::new(vertices, &[]) };
            let found = track.compare(&mesh, (triangles, &skin), 5e-3, 2e-3);
            let mut errors = found.errors.clone();
            errors.sort_by(f64::total_cmp);
            let complete = found.n_complete as f64 / found.n_seen as f64;
            if off > 5e-3 {
                assert!(found.n_wrong > errors.len() && complete < 0.2, "{complete}");
                continue;
            }
            assert!((errors[errors.len() / 2] - off).abs() < 2e-5, "{off}: {}", errors[errors.len() / 2]);
            assert!(if half { (0.4..0.6).contains(&complete) } else { complete > 0.99 }, "{off}: {complete}");
        }
    }

    #[test]
    fn poses_that_agree_do_not_drift_and_others_do_by_what_they_are_off() {
        let placed = |shift: f64| Placed {
            thing_from_joined: Isometry3::translation(1.0 + shift, 2.0, 3.0),
            middle: Point3::origin(),
            covariance: Matrix6::identity() * 1e-8,
        };
        let track = SurfaceTrack { poses: vec![placed(0.0), placed(0.0), placed(3e-4)], ..SurfaceTrack::default() };
        let drifts = track.drifts();
        assert!(drifts[0].0 < 1e-12 && (drifts[1].0 - 3e-4).abs() < 1e-12 && (drifts[1].1 - 1.5).abs() < 1e-9);
    }
}
