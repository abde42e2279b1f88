//! A camera as it truly is.

use std::ops::Deref;
use std::sync::Arc;

use foveate_geometry::pan_tilt::{PanTiltHead, Setting};
use foveate_geometry::{Camera, Ray};
use nalgebra::{Point2, Point3, Translation3};

use super::lens::Lens;

/// A camera with a real lens and, where it stands on a head, the head's real axes. Dereferences to the camera without what its lens does beyond the
/// calibrations' model: where it stands, the size of its picture.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueCamera {
    plain: Camera,
    lens: Option<Lens>,
    /// The head that carries it, and how much a step of its two counters is of what it should be.
    head: Option<Arc<(PanTiltHead, [f64; 2])>>,
}

impl Deref for TrueCamera {
    type Target = Camera;

    fn deref(&self) -> &Camera {
        &self.plain
    }
}

impl From<&Camera> for TrueCamera {
    /// Just as a calibration says.
    fn from(camera: &Camera) -> TrueCamera {
        TrueCamera { plain: camera.clone(), lens: None, head: None }
    }
}

impl From<&TrueCamera> for TrueCamera {
    fn from(camera: &TrueCamera) -> TrueCamera {
        camera.clone()
    }
}

impl TrueCamera {
    pub(super) fn new(plain: Camera, lens: Lens, head: Option<(PanTiltHead, [f64; 2])>) -> TrueCamera {
        TrueCamera { plain, lens: Some(lens), head: head.map(Arc::new) }
    }

    /// The same camera with its picture `rows` further down [px].
    pub(crate) fn shifted_down(&self, rows: f64) -> TrueCamera {
        let mut camera = self.clone();
        camera.plain.intrinsics.principal[1] += rows;
        camera
    }

    /// The camera without what its lens does beyond the calibrations' model.
    pub fn plain(&self) -> &Camera {
        &self.plain
    }

    /// As [`Camera::project`], through the real lens.
    pub fn project(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        let pixel = self.plain.project(point)?;
        Some(self.lens.map_or(pixel, |it| it.bend(&self.plain.intrinsics, pixel)))
    }

    /// As [`Camera::sees`], through the real lens.
    pub fn sees(&self, point: &Point3<f64>) -> Option<Point2<f64>> {
        self.project(point).filter(|it| self.plain.has_pixel(it))
    }

    /// As [`Camera::ray`], through the real lens.
    pub fn ray(&self, pixel: &Point2<f64>) -> Option<Ray> {
        match &self.lens {
            None => self.plain.ray(pixel),
            Some(lens) => self.plain.ray(&lens.unbend(&self.plain.intrinsics, *pixel)),
        }
    }

    /// The axes of its head, and how much a step of its counters is of what it should be.
    pub(super) fn head(&self) -> Option<&(PanTiltHead, [f64; 2])> {
        self.head.as_deref()
    }

    /// Where a point at these ideal normalised coordinates is imaged, in normalised coordinates; `None` as for
    /// [`Distortion::distort`](foveate_geometry::Distortion::distort).
    pub(crate) fn distort(&self, ideal: &nalgebra::Vector2<f64>) -> Option<nalgebra::Vector2<f64>> {
        let place = self.plain.distortion.distort(ideal)?;
        Some(self.lens.map_or(place, |it| it.bend_normalised(&place)))
    }

    /// Whether a pinhole would image the same.
    pub(crate) fn is_ideal(&self) -> bool {
        self.lens.is_none() && self.plain.distortion == Default::default()
    }

    /// The same optics elsewhere.
    pub(crate) fn standing(&self, camera_from_world: nalgebra::Isometry3<f64>) -> TrueCamera {
        TrueCamera { plain: Camera { camera_from_world, ..self.plain.clone() }, ..self.clone() }
    }

    /// As it stands in the world while the space that its place is stated in has its origin at `origin`, and its axes along the world's.
    pub(crate) fn on_stand(&self, origin: Point3<f64>) -> TrueCamera {
        self.standing(self.plain.camera_from_world * Translation3::from(-origin.coords))
    }

    /// As it stands when its head is turned and zoomed: by its own head's axes, or by those of `stated` where nothing else is known.
    pub(crate) fn turned(&self, stated: &PanTiltHead, [pan, tilt, zoom]: [f64; 3]) -> TrueCamera {
        let (head, steps) = self.head.as_deref().map_or((stated, [1.0; 2]), |it| (&it.0, it.1));
        let setting = Setting::new(pan * steps[0], tilt * steps[1]);
        let mut turned = self.standing(head.camera_from_rest(&setting) * self.plain.camera_from_world);
        if let Some(table) = &head.zoom {
            (turned.plain.intrinsics, turned.plain.distortion) = table.optics_at(zoom);
        }
        turned
    }
}
