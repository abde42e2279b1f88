//! People over an exposure as a camera images them, row by row where these are exposed one after the other.

use std::sync::Arc;

use foveate_messages::{Interval, Time};
use nalgebra::{Point3, Vector3};

use super::Take;
use crate::camera::CameraSettings;
use crate::studio::Posed;
use crate::truth::TrueCamera;

/// People are posed at least this often, between which their surface moves in straight lines [ms].
const KEY_MS: f64 = 8.0;
/// Nothing is seen of a triangle with a corner nearer than this [m].
const NEAREST_M: f64 = 0.1;

pub(super) type PosedAt<'p> = dyn Fn(Time) -> Vec<(usize, Arc<Posed>)> + 'p;

/// People over an exposure, with a rolling shutter from the first row's to the last one's.
pub(super) struct Motion {
    /// When they are posed, from the capture on.
    times: Vec<Interval>,
    /// By time, then by thing that is there.
    pub keys: Vec<Vec<(usize, Arc<Posed>)>>,
}

impl Motion {
    pub fn new(take: &Take<'_>, settings: &CameraSettings, posed: &PosedAt<'_>) -> Self {
        let all_ms = settings.exposure_ms + take.readout_ms;
        let n = ((all_ms / KEY_MS).ceil() as usize).max(1) + 1;
        let times: Vec<Interval> =
            (0..n).map(|it| Interval::from_ms(all_ms * (it as f64 / (n - 1) as f64 - 0.5))).collect();
        let keys = times.iter().map(|it| posed(take.capture + *it)).collect();
        Self { times, keys }
    }

    /// The key before `late`, and how far it lies towards the next one.
    #[inline]
    fn between(&self, late: f64) -> (usize, f64) {
        let last = self.times.len() - 1;
        let (first, end) = (self.times[0].as_s(), self.times[last].as_s());
        let at = ((late - first) / (end - first).max(1e-12)).clamp(0.0, 1.0) * last as f64;
        let key = (at as usize).min(last - 1);
        (key, at - key as f64)
    }

    /// Vertices at a moment of the exposure, each as the row sees it that images it, and where they are imaged; 1 / depth is 0 where they are not.
    pub fn image(
        &self,
        camera: &TrueCamera,
        late: Interval,
        readout_ms: f64,
        vertices: &mut Vec<Vec<Point3<f64>>>,
        imaged: &mut Vec<Vec<[f32; 3]>>,
    ) {
        let n_things = self.keys[0].len();
        vertices.resize(n_things, Vec::new());
        imaged.resize(n_things, Vec::new());
        let projector = Projector::new(camera);
        let last_row = f64::from(camera.image_size[1].max(2) - 1);
        let (key, share) = self.between(late.as_s());
        for thing in 0..n_things {
            let [from, to] = [key, key + 1].map(|it| &self.keys[it][thing].1.vertices);
            let (vertices, imaged) = (&mut vertices[thing], &mut imaged[thing]);
            vertices.clear();
            imaged.clear();
            for (number, (from, to)) in from.iter().zip(to).enumerate() {
                let mut vertex = from + (to - from) * share;
                let mut place = projector.image(&vertex);
                if readout_ms > 0.0 {
                    // The row says when, when says the row: its rate is far below that of the readout.
                    for _ in 0..3 {
                        let row = f64::from(place.map_or(0.5 * last_row as f32, |it| it[1]))
                            .clamp(-0.2 * last_row, 1.2 * last_row);
                        let rolled = late.as_s() + (row / last_row - 0.5) * readout_ms * 1e-3;
                        let (key, share) = self.between(rolled);
                        let [from, to] = [key, key + 1].map(|it| self.keys[it][thing].1.vertices[number]);
                        vertex = from + (to - from) * share;
                        place = projector.image(&vertex);
                    }
                }
                vertices.push(vertex);
                imaged.push(place.unwrap_or([0.0; 3]));
            }
        }
    }

    /// By thing, normals of the key next to a moment.
    pub fn normals(&self, late: Interval) -> Vec<&[Vector3<f32>]> {
        let (key, share) = self.between(late.as_s());
        let key = if share < 0.5 { key } else { key + 1 };
        self.keys[key].iter().map(|it| it.1.normals.as_slice()).collect()
    }
}

/// The projection of points, with the common terms precomputed.
pub(in crate::camera) struct Projector<'c> {
    camera: &'c TrueCamera,
    rotation: nalgebra::Rotation3<f64>,
    is_ideal: bool,
}

impl<'c> Projector<'c> {
    pub fn new(camera: &'c TrueCamera) -> Self {
        let rotation = camera.camera_from_world.rotation.to_rotation_matrix();
        Self { camera, rotation, is_ideal: camera.is_ideal() }
    }

    /// Column, row [px], and 1 / depth [1/m].
    #[inline]
    pub fn image(&self, point: &Point3<f64>) -> Option<[f32; 3]> {
        let seen = self.rotation * point.coords + self.camera.camera_from_world.translation.vector;
        if seen.z < NEAREST_M {
            return None;
        }
        let inverse = 1.0 / seen.z;
        let ideal = nalgebra::Vector2::new(seen.x * inverse, seen.y * inverse);
        let place = if self.is_ideal { ideal } else { self.camera.distort(&ideal)? };
        let optics = &self.camera.intrinsics;
        let x = optics.focal[0] * place.x + optics.skew * place.y + optics.principal[0];
        Some([x as f32, (optics.focal[1] * place.y + optics.principal[1]) as f32, inverse as f32])
    }
}
