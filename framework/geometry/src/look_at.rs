//! A camera aimed at a point, upright in a world whose Z is up.

use nalgebra::{Isometry3, Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

use crate::camera::{Camera, Distortion, Intrinsics};

/// Below this sine of the angle to the vertical, "up in the image" is taken from +Y of the world instead of +Z.
const VERTICAL: f64 = 1e-6;

impl Camera {
    /// A camera at `centre` with `target` on its axis and the world's Z pointing up in the image; square pixels of
    /// focal length `focal` [px], the principal point in the middle of `image_size` [px], no distortion.
    ///
    /// Looking straight down or up, the world's +Y points up in the image. With `target` at `centre` the camera looks along +Y.
    pub fn look_at(centre: Point3<f64>, target: Point3<f64>, image_size: [u32; 2], focal: f64) -> Camera {
        let forward = (target - centre).try_normalize(0.0).unwrap_or_else(Vector3::y);
        let sideways = forward.cross(&Vector3::z());
        let right = if sideways.norm() > VERTICAL { sideways } else { forward.cross(&Vector3::y()) }.normalize();
        let down = forward.cross(&right);
        let axes = Matrix3::from_rows(&[right.transpose(), down.transpose(), forward.transpose()]);
        let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
        Camera {
            image_size,
            intrinsics: Intrinsics {
                focal: [focal, focal],
                principal: image_size.map(|it| (f64::from(it) - 1.0) / 2.0),
                skew: 0.0,
            },
            distortion: Distortion::default(),
            camera_from_world: Isometry3::from_parts((rotation * -centre.coords).into(), rotation),
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector2;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn target_is_in_the_middle_and_up_is_up(
            centre in prop::array::uniform3(-5.0..5.0), target in prop::array::uniform3(-5.0..5.0),
        ) {
            let (centre, target) = (Point3::from(centre), Point3::from(target));
            prop_assume!((target - centre).norm() > 0.1);
            let camera = Camera::look_at(centre, target, [641, 481], 500.0);
            camera.check().unwrap();
            prop_assert!((camera.centre() - centre).norm() < 1e-12);
            let middle = camera.project(&target).unwrap();
            prop_assert!((middle.coords - Vector2::new(320.0, 240.0)).norm() < 1e-8);
            let above = camera.project(&(target + Vector3::z() * 0.01)).unwrap();
            prop_assert!(above.y <= 240.0 && (above.x - 320.0).abs() < 1e-6);
        }
    }

    #[test]
    fn straight_down_has_north_up_and_east_right() {
        let camera = Camera::look_at(Point3::new(1.0, 2.0, 3.0), Point3::new(1.0, 2.0, 0.0), [641, 481], 300.0);
        let pixel = camera.project(&Point3::new(1.5, 2.0, 0.0)).unwrap();
        assert!((pixel.coords - Vector2::new(370.0, 240.0)).norm() < 1e-9);
        let pixel = camera.project(&Point3::new(1.0, 2.5, 0.0)).unwrap();
        assert!((pixel.coords - Vector2::new(320.0, 190.0)).norm() < 1e-9);
    }

    #[test]
    fn a_target_at_the_centre_still_gives_a_rotation() {
        let camera = Camera::look_at(Point3::origin(), Point3::origin(), [4, 4], 300.0);
        camera.check().unwrap();
        assert!(camera.project(&Point3::new(0.0, 1.0, 0.0)).is_some());
    }
}
