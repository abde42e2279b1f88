//! Predictions for a picture before boundaries are decoded: how far its pixels move from the picture before, and which columns of the projector can light them.
//!
//! Between the nearest and the farthest distance that the surface may have, a pixel is lit from a range of columns; where a code repeats, that range says which repetition it is. Where the
//! surface is about at a known distance, and comes nearer at a known speed, it says how far boundaries move: a boundary stays on its plane of light, which the camera's turning and the
//! surface's motion move in the picture.
//!
//! Both change slowly over the picture: they are worked out on a grid and interpolated.

use foveate::geometry::Camera;
use nalgebra::{Point2, Point3, Vector3};

/// From one place of the grid to the next [px].
const STEP: usize = 32;

/// Two numbers for each place of a picture, interpolated between places of a grid; NaN where they are not known.
pub(crate) struct Field {
    columns: usize,
    rows: usize,
    values: Vec<[f32; 2]>,
}

impl Field {
    pub(crate) fn new(size: [u32; 2], of: impl Fn(&Point2<f64>) -> Option<[f64; 2]>) -> Field {
        let [columns, rows] = size.map(|it| (it as usize).div_ceil(STEP) + 1);
        let place = |at: usize| Point2::new((at % columns * STEP) as f64, (at / columns * STEP) as f64);
        let values = (0..columns * rows).map(|at| of(&place(at)).map_or([f32::NAN; 2], |it| it.map(|it| it as f32)));
        Field { columns, rows, values: values.collect() }
    }

    pub(crate) fn at(&self, x: f32, y: f32) -> [f32; 2] {
        let (x, y) = (x.max(0.0) / STEP as f32, y.max(0.0) / STEP as f32);
        let (left, top) = ((x as usize).min(self.columns - 2), (y as usize).min(self.rows - 2));
        let (right, down) = (x - left as f32, y - top as f32);
        let of = |column: usize, row: usize| self.values[row * self.columns + column];
        let [a, b, c, d] = [of(left, top), of(left + 1, top), of(left, top + 1), of(left + 1, top + 1)];
        [0, 1].map(|it| {
            let (above, below) = (a[it] + (b[it] - a[it]) * right, c[it] + (d[it] - c[it]) * right);
            above + (below - above) * down
        })
    }
}

/// The projector's columns (rows, with `axis` 1) that light each place at the nearest and at the farthest distance.
pub(crate) fn lit_from(camera: &Camera, projector: &Camera, axis: usize, [near, far]: [f64; 2]) -> Field {
    Field::new(camera.image_size, |pixel| {
        let ray = camera.ray(pixel)?;
        let of = |distance: f64| projector.project(&ray.at(distance)).map(|it| it[axis]);
        Some([of(near)?, of(far)?])
    })
}

/// How far boundaries on what is about `distance` away move from the picture of the camera as it stood `before` to the one `now`, while the surface moves by `by` in the world [px].
pub(crate) fn shift(before: &Camera, now: &Camera, projector: &Camera, distance: f64, by: &Vector3<f64>) -> Field {
    let light = projector.centre();
    Field::new(now.image_size, |pixel| {
        let ray = before.ray(pixel)?;
        let point: Point3<f64> = ray.at(distance);
        // Along the projector's ray, as far as the surface moves along the camera's: it is taken to face the camera.
        let along = (point - light).normalize();
        let line_of_sight = ray.direction.into_inner();
        let moved = point + along * (by.dot(&line_of_sight) / along.dot(&line_of_sight));
        let there = now.project(&moved)?;
        Some([there.x - pixel.x, there.y - pixel.y])
    })
}

/// Columns (rows, with `axis` 1) of the projector for each pixel along a row and along a column in the middle of the picture, on what is `distance` away.
pub(crate) fn slope(camera: &Camera, projector: &Camera, axis: usize, distance: f64) -> Option<[f64; 2]> {
    let [width, height] = camera.image_size.map(f64::from);
    let of = |x: f64, y: f64| -> Option<f64> {
        let ray = camera.ray(&Point2::new(width / 2.0 + x, height / 2.0 + y))?;
        projector.project(&ray.at(distance)).map(|it| it[axis])
    };
    Some([(of(8.0, 0.0)? - of(-8.0, 0.0)?) / 16.0, (of(0.0, 8.0)? - of(0.0, -8.0)?) / 16.0])
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;

    use super::*;
    use crate::pair::tests::rig;

    #[test]
    fn fields_are_what_they_are_of_between_the_places_of_their_grid() {
        let field = Field::new([100, 70], |it| Some([0.5 * it.x + 2.0 * it.y, it.x - it.y]));
        for (x, y) in [(0.0, 0.0), (31.0, 40.5), (99.0, 69.0), (64.0, 64.0)] {
            let [a, b] = field.at(x, y);
            assert!((a - 0.5 * x - 2.0 * y).abs() < 1e-3 && (b - x + y).abs() < 1e-3);
        }
        assert!(Field::new([100, 70], |_| None).at(50.0, 3.0)[0].is_nan());
    }

    #[test]
    fn boundaries_move_as_the_surface_and_the_camera_do() {
        let (camera, projector) = rig();
        let distance = 1.5;
        let turn = UnitQuaternion::from_euler_angles(0.002, 0.004, 0.0);
        let turned = Camera {
            camera_from_world: nalgebra::Isometry3::from_parts(nalgebra::Translation3::identity(), turn)
                * camera.camera_from_world,
            ..camera.clone()
        };
        for (now, by) in [
            (&camera, Vector3::new(0.0, 0.0, 0.004)),
            (&turned, Vector3::zeros()),
            (&turned, Vector3::new(0.002, 0.0, -0.003)),
        ] {
            let field = shift(&camera, now, &projector, distance, &by);
            // A plane that faces the camera's middle: where is the same column of light on it before and after?
            let pixel = Point2::new(320.0, 238.0);
            let before = camera.ray(&pixel).unwrap().at(distance);
            let column = projector.project(&before).unwrap().x;
            let plane = before.z + by.z;
            let lit = |x: f64| {
                let y = pixel.y + f64::from(field.at(320.0, 238.0)[1]);
                let ray = now.ray(&Point2::new(x, y)).unwrap();
                let along = (plane - ray.origin.z) / ray.direction.z;
                projector.project(&ray.at(along)).unwrap().x
            };
            let found = pixel.x + f64::from(field.at(320.0, 238.0)[0]);
            assert!((lit(found) - column).abs() < 0.05, "{} for {column}", lit(found));
            assert!((lit(found + 1.0) - column).abs() > 0.3);
        }
    }

    #[test]
    fn a_distance_says_which_columns_can_light_a_pixel() {
        let (camera, projector) = rig();
        let field = lit_from(&camera, &projector, 0, [1.0, 2.0]);
        let pixel = Point2::new(400.0, 200.0);
        let lit = |it: f64| projector.project(&camera.ray(&pixel).unwrap().at(it)).unwrap().x as f32;
        let [near, far] = field.at(400.0, 200.0);
        assert!((near - lit(1.0)).abs() < 1.0 && (far - lit(2.0)).abs() < 1.0);
        assert!((near.min(far)..near.max(far)).contains(&lit(1.4)));
        let [along, across] = slope(&camera, &projector, 0, 1.5).unwrap();
        assert!(along > 1.0 && across.abs() < 0.2, "{along} {across}");
    }
}
