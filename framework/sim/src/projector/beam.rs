//! Where a projector's light falls on a surface: which of its pixels lights a point, how strongly, and what stands in its way.

use std::sync::Arc;

use nalgebra::{Point3, Vector3};

use super::{Projection, profile};
use crate::painted::{Skin, Triangle};
use crate::sight::{FirstHits, imaged};
use crate::truth::TrueCamera;
use crate::world::World;

/// A surface shadows itself only beyond this: pixels of the projector see slopes as steps [m].
const BIAS_M: f32 = 2.5e-3;

/// Light on a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lit {
    /// The projector's column and row [px].
    pub at: [f32; 2],
    /// Blur of its picture there, as a level of its profiles.
    pub level: f32,
    /// What a white surface shows that is turned as this one is, lit white, gain 1; in shadow 0 [gray level].
    pub white: f32,
    /// The share of the light that nothing holds up [–].
    pub free: f32,
}

/// A projector and the surface that it lights.
pub(crate) struct Beam {
    projection: Projection,
    optics: TrueCamera,
    centre: Point3<f64>,
    skin: Option<Arc<Skin>>,
    /// Of each vertex, by how much the lens images it beside where a pinhole does [px].
    bent: Vec<[f32; 2]>,
    seen: FirstHits,
}

impl Beam {
    /// Of the projector as it truly is.
    pub fn new(projection: &Projection, world: &World) -> Beam {
        let optics = world.camera(Some(projection.name()), projection.calibrated());
        Beam {
            centre: optics.centre(),
            projection: projection.clone(),
            optics,
            skin: None,
            bent: Vec::new(),
            seen: FirstHits::default(),
        }
    }

    /// What it shows.
    pub fn projection(&self) -> &Projection {
        &self.projection
    }

    /// How it truly stands and images.
    pub fn optics(&self) -> &TrueCamera {
        &self.optics
    }

    /// Takes a surface as what is lit, and what throws shadows.
    pub fn light(&mut self, triangles: &[Triangle], skin: &Arc<Skin>) {
        if self.skin.as_ref().is_some_and(|it| Arc::ptr_eq(it, skin)) {
            return;
        }
        self.skin = Some(Arc::clone(skin));
        let Some(places) = imaged(&self.optics, skin) else {
            // It reaches behind the projector: nothing of it is lit.
            self.bent.clear();
            return;
        };
        let bent = |(place, vertex): (&[f32; 3], &Point3<f64>)| {
            let [x, y] = self.pinhole(vertex);
            [place[0] - x, place[1] - y]
        };
        self.bent = places.iter().zip(&skin.vertices).map(bent).collect();
        self.seen.draw(&places, triangles, [0.0; 2], self.optics.image_size);
    }

    fn pinhole(&self, point: &Point3<f64>) -> [f32; 2] {
        let local = self.optics.camera_from_world * point;
        let optics = &self.optics.intrinsics;
        let (x, y) = (local.x / local.z, local.y / local.z);
        let column = optics.focal[0] * x + optics.skew * y + optics.principal[0];
        [column as f32, (optics.focal[1] * y + optics.principal[1]) as f32]
    }

    /// The light on a point of the surface, between these vertices with these weights; `None` where the projector's picture does not reach.
    pub fn at(&self, point: &Point3<f64>, corners: [u32; 3], weights: [f64; 3], normal: &Vector3<f64>) -> Option<Lit> {
        if self.bent.is_empty() {
            return None;
        }
        let mut at = self.pinhole(point);
        for (corner, weight) in corners.into_iter().zip(weights) {
            let bent = self.bent[corner as usize];
            at = [at[0] + bent[0] * weight as f32, at[1] + bent[1] * weight as f32];
        }
        let [width, height] = self.optics.image_size.map(|it| it as f32);
        if !(-0.5..width - 0.5).contains(&at[0]) || !(-0.5..height - 0.5).contains(&at[1]) {
            return None;
        }
        let to_light = self.centre - point;
        let square = to_light.norm_squared();
        let settings = self.projection.settings();
        let facing = normal.dot(&to_light) / square.sqrt();
        let depth = (self.optics.camera_from_world * point).z;
        let free = self.reached(at, depth as f32);
        let white = settings.light * facing.max(0.0) / square * f64::from(free);
        // A disc's standard deviation along an axis is a quarter of its diameter.
        let disc =
            settings.aperture_mm * 1e-3 * self.optics.intrinsics.focal[0] * (1.0 / depth - 1.0 / settings.focus_m);
        let sigma = settings.blur_px.hypot(0.25 * disc);
        Some(Lit { at, level: profile::level(sigma as f32), white: white as f32, free })
    }

    /// The share of the light that nothing holds up, from the four pixels around.
    fn reached(&self, [x, y]: [f32; 2], depth: f32) -> f32 {
        let (left, top) = (x.max(0.0) as usize, y.max(0.0) as usize);
        let (right, down) = ((x - left as f32).clamp(0.0, 1.0), (y - top as f32).clamp(0.0, 1.0));
        let free = |column: usize, row: usize| {
            f32::from(u8::from(self.seen.depth(column, row).is_none_or(|it| depth <= it + BIAS_M)))
        };
        let above = free(left, top) * (1.0 - right) + free(left + 1, top) * right;
        let below = free(left, top + 1) * (1.0 - right) + free(left + 1, top + 1) * right;
        above * (1.0 - down) + below * down
    }
}
