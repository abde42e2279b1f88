//! People as a camera sees them: dark shapes in front of the room.
//!
//! A capsule's image is taken as the hull of the images of spheres along it, each an ellipse with the aspect of the pixels; that
//! is exact for a pinhole at the axis and good to a few percent of the radius at the edge, which no detector minds.

use crate::truth::TrueCamera;
use nalgebra::Point3;

use super::steps;
use crate::person::BodyPart;
use crate::world::Moment;

/// Spheres along each capsule that looks small: at least.
const FEWEST_SPHERES: usize = 6;
/// Spheres along one that looks large: at most.
const MOST_SPHERES: usize = 40;
/// A capsule of a larger radius looks large [px].
const LARGE_PX: f64 = 25.0;

/// Draws people; keeps its memory from field to field.
#[derive(Default)]
pub(super) struct Silhouettes {
    /// Squared distance from the camera [m²], and the part.
    order: Vec<(f64, BodyPart)>,
}

/// What stands in for parts of the first person's body.
pub(super) struct Instead<'s> {
    /// What is left of a part beside it.
    pub beside: &'s dyn Fn(usize, BodyPart) -> Option<BodyPart>,
    /// Squared distance from the camera [m²].
    pub distance: f64,
    /// Draws it.
    pub draw: &'s mut dyn FnMut(&mut [i16]),
}

impl Silhouettes {
    /// Draws all body parts, far ones first. `light` [gray level] is what a white cloth would show.
    pub fn draw(
        &mut self,
        camera: &TrueCamera,
        moment: &Moment,
        light: f64,
        black_level: f64,
        mut instead: Option<Instead<'_>>,
        canvas: &mut [i16],
    ) {
        let eye = camera.centre();
        let distance = |part: &BodyPart| (nalgebra::center(&part.ends[0], &part.ends[1]) - eye).norm_squared();
        self.order.clear();
        for (person, pose) in moment.poses.iter().enumerate() {
            for (number, part) in pose.parts.iter().enumerate() {
                let left = match &instead {
                    Some(instead) if person == 0 => (instead.beside)(number, *part),
                    _ => Some(*part),
                };
                self.order.extend(left.map(|part| (distance(&part), part)));
            }
        }
        self.order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
        for (distance, part) in &self.order {
            if let Some(instead) = instead.take_if(|it| it.distance > *distance) {
                (instead.draw)(canvas);
            }
            draw_part(camera, &eye, part, light * part.albedo, black_level, canvas);
        }
        if let Some(instead) = instead {
            (instead.draw)(canvas);
        }
    }
}

/// Image of a sphere: centre and half axes [px].
#[derive(Clone, Copy)]
struct Ellipse {
    centre: [f64; 2],
    half: [f64; 2],
}

fn draw_part(
    camera: &TrueCamera,
    eye: &Point3<f64>,
    part: &BodyPart,
    light: f64,
    black_level: f64,
    canvas: &mut [i16],
) {
    let [width, height] = camera.image_size.map(f64::from);
    // Close up, few spheres would look like beads.
    let distance = (nalgebra::center(&part.ends[0], &part.ends[1]) - eye).norm();
    let is_large = part.radius * camera.intrinsics.focal[0] > LARGE_PX * distance;
    let n_close = ((part.ends[1] - part.ends[0]).norm() / (0.2 * part.radius)) as usize;
    let n = if is_large { n_close.clamp(FEWEST_SPHERES, MOST_SPHERES) } else { FEWEST_SPHERES };
    let mut ellipses = [Ellipse { centre: [0.0; 2], half: [0.0; 2] }; MOST_SPHERES];
    let ellipses = &mut ellipses[..n];
    for (i, ellipse) in ellipses.iter_mut().enumerate() {
        let along = i as f64 / (n - 1) as f64;
        let middle = part.ends[0] + (part.ends[1] - part.ends[0]) * along;
        let Some(pixel) = camera.project(&middle) else { return };
        let distance = (middle - eye).norm();
        if distance <= 2.0 * part.radius {
            return;
        }
        *ellipse = Ellipse {
            centre: [pixel.x, pixel.y],
            half: camera.intrinsics.focal.map(|focal| focal * part.radius / distance),
        };
    }
    let top = ellipses.iter().map(|it| it.centre[1] - it.half[1]).fold(f64::INFINITY, f64::min).ceil().max(0.0);
    let bottom = ellipses.iter().map(|it| it.centre[1] + it.half[1]).fold(f64::NEG_INFINITY, f64::max).floor();
    let bottom = bottom.min(height - 1.0);
    if top > bottom {
        return;
    }
    for row in top as usize..=bottom as usize {
        let (mut left, mut right) = (f64::INFINITY, f64::NEG_INFINITY);
        for Ellipse { centre, half } in ellipses.iter() {
            let up = row as f64 - centre[1];
            if up.abs() >= half[1] {
                continue;
            }
            let rise = up / half[1];
            let reach = half[0] * (1.0 - rise * rise).max(0.0).sqrt();
            if reach > 0.0 {
                left = left.min(centre[0] - reach);
                right = right.max(centre[0] + reach);
            }
        }
        let (first, last) = (left.ceil().max(0.0), right.floor().min(width - 1.0));
        if first > last {
            continue;
        }
        let start = row * width as usize;
        let span = &mut canvas[start + first as usize..=start + last as usize];
        // Lit from above the middle, darker towards both sides.
        let (middle, half) = ((left + right) / 2.0, ((right - left) / 2.0).max(1.0));
        for (i, pixel) in span.iter_mut().enumerate() {
            let aside = (first + i as f64 - middle) / half;
            *pixel = steps(light * (1.0 - 0.55 * aside * aside) + black_level);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::wide_cameras;

    #[test]
    fn a_part_covers_its_axis_and_little_beyond_its_radius() {
        let part =
            BodyPart { ends: [Point3::new(0.1, 0.2, 0.9), Point3::new(0.3, -0.1, 1.5)], radius: 0.12, albedo: 0.5 };
        for (name, camera) in wide_cameras() {
            let eye = camera.centre();
            let mut canvas = vec![i16::MAX; 640 * 240];
            draw_part(&TrueCamera::from(&camera), &eye, &part, 60.0, 10.0, &mut canvas);
            for i in 0..=10 {
                let on_axis = part.ends[0] + (part.ends[1] - part.ends[0]) * (f64::from(i) / 10.0);
                let Some(pixel) = camera.sees(&on_axis) else { continue };
                let value = canvas[pixel.y.round() as usize * 640 + pixel.x.round() as usize];
                assert!((10 * 64..=70 * 64).contains(&value), "{name}: {value} at {pixel}");
            }
            // Each painted pixel's line of sight passes within the radius of the capsule, or nearly so.
            let wide = BodyPart { radius: part.radius * 1.15, ..part };
            let mut n_painted = 0;
            for (i, _) in canvas.iter().enumerate().filter(|(_, value)| **value != i16::MAX) {
                let pixel = nalgebra::Point2::new((i % 640) as f64, (i / 640) as f64);
                let ray = camera.ray(&pixel).unwrap();
                assert!(wide.blocks(&eye, &(eye + ray.direction.into_inner() * 10.0)), "{name}: {pixel} is painted");
                n_painted += 1;
            }
            assert!(n_painted > 100 || camera.sees(&part.ends[0]).is_none(), "{name}: {n_painted} pixels");
        }
    }
}
