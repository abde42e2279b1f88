//! A textured surface as a camera sees it: triangles with a depth for each pixel, at several moments of the exposure.
//!
//! Each moment is drawn with its own small shift within the pixel, so that the mean of all has smooth edges and the smear of what moved,
//! the camera included.

use foveate_geometry::{Camera, Intrinsics};
use nalgebra::{Vector2, Vector3};

use super::STEPS;
use crate::painted::{Part, Skin, Texture, key_light};

/// Nothing is drawn of a surface that comes nearer to the camera than this [m].
const NEAREST_M: f64 = 0.15;
/// How bright the shine on skin is at its brightest, relative to a white surface that faces the light.
const SHINE: f32 = 0.13;

/// A vertex as it is drawn.
#[derive(Debug, Clone, Copy, Default)]
struct Corner {
    x: f32,
    y: f32,
    /// [m]
    depth: f32,
    /// What the surface throws back to all sides, for an albedo of 1 [steps].
    light: f32,
    /// What it throws back as a mirror does [steps].
    shine: f32,
}

/// Pixels: from column and row, to column and row, the latter not included.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Area {
    from: [usize; 2],
    to: [usize; 2],
}

/// Draws a surface; keeps its memory from field to field.
#[derive(Default)]
pub(super) struct Surfaces {
    corners: Vec<Corner>,
    depths: Vec<f32>,
    lights: Vec<f32>,
    /// Of all moments so far: light [steps], and how many of them saw the surface.
    sums: Vec<(f32, f32)>,
    area: Option<Area>,
}

impl Surfaces {
    /// Forgets the moments drawn so far; `n_pixels` of the image.
    pub fn begin(&mut self, n_pixels: usize) {
        self.area = None;
        self.depths.resize(n_pixels, f32::INFINITY);
        self.lights.resize(n_pixels, 0.0);
        self.sums.resize(n_pixels, (0.0, 0.0));
    }

    /// Draws the surface as `camera` sees it at moment number `moment` of `n_moments`. `white` [gray level] is what a white surface shows
    /// that faces the light.
    pub fn add(&mut self, camera: &Camera, part: &Part, skin: &Skin, white: f64, [moment, n_moments]: [u32; 2]) {
        let shift = shift(moment, n_moments);
        let Some(area) = self.project(camera, skin, (white * STEPS) as f32, shift) else { return };
        let width = camera.image_size[0] as usize;
        for row in area.from[1]..area.to[1] {
            self.depths[row * width..][area.from[0]..area.to[0]].fill(f32::INFINITY);
        }
        let texture = part.texture();
        for triangle in &part.surface.triangles {
            let corners = triangle.corners.map(|it| self.corners[it as usize]);
            let mut canvas = Canvas { width, area, depths: &mut self.depths, lights: &mut self.lights };
            canvas.draw(corners, &triangle.texels, texture);
        }
        let within = self.area.get_or_insert(area);
        for axis in 0..2 {
            within.from[axis] = within.from[axis].min(area.from[axis]);
            within.to[axis] = within.to[axis].max(area.to[axis]);
        }
        for row in area.from[1]..area.to[1] {
            let span = row * width + area.from[0]..row * width + area.to[0];
            let drawn = self.depths[span.clone()].iter().zip(&self.lights[span.clone()]);
            for ((light, count), (depth, seen)) in self.sums[span].iter_mut().zip(drawn) {
                let is_seen = if *depth < f32::INFINITY { 1.0 } else { 0.0 };
                *light += is_seen * seen;
                *count += is_seen;
            }
        }
    }

    /// Lays the mean of all moments over `canvas`.
    pub fn finish(&mut self, width: usize, n_moments: u32, black_level: f64, canvas: &mut [i16]) {
        let Some(area) = self.area.take() else { return };
        let (black, share) = ((black_level * STEPS) as f32, 1.0 / n_moments as f32);
        for row in area.from[1]..area.to[1] {
            let span = row * width + area.from[0]..row * width + area.to[0];
            for (pixel, sum) in canvas[span.clone()].iter_mut().zip(&mut self.sums[span]) {
                let (light, count) = std::mem::take(sum);
                if count > 0.0 {
                    let behind = f32::from(*pixel) * (1.0 - count * share);
                    *pixel = (behind + (light + count * black) * share) as i16; // `as` saturates
                }
            }
        }
    }

    /// Fills the corners; the pixels that they take up, or `None` where nothing is seen.
    fn project(&mut self, camera: &Camera, skin: &Skin, white: f32, shift: [f64; 2]) -> Option<Area> {
        let rotation = camera.camera_from_world.rotation.to_rotation_matrix();
        let translation = camera.camera_from_world.translation.vector;
        let eye = camera.centre();
        let to_eye = (eye - skin.vertices[0]).normalize().cast::<f32>();
        // Everything is far away against its own size: one direction to the camera for all.
        let half_way: Vector3<f32> = (to_eye + key_light()).normalize();
        let Intrinsics { focal, principal, skew } = camera.intrinsics;
        let is_ideal = camera.distortion == Default::default();
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        self.corners.clear();
        for ((vertex, normal), light) in skin.vertices.iter().zip(&skin.normals).zip(&skin.light) {
            let seen = rotation * vertex.coords + translation;
            if seen.z < NEAREST_M {
                return None;
            }
            let ideal = Vector2::new(seen.x, seen.y) / seen.z;
            let place = if is_ideal { ideal } else { camera.distortion.distort(&ideal)? };
            let x = (focal[0] * place.x + skew * place.y + principal[0] + shift[0]) as f32;
            let y = (focal[1] * place.y + principal[1] + shift[1]) as f32;
            let mirrored = normal.dot(&half_way).max(0.0);
            let (square, fourth) = (mirrored * mirrored, mirrored.powi(4));
            let shine = SHINE * fourth * fourth * fourth * square * light.min(1.0);
            self.corners.push(Corner { x, y, depth: seen.z as f32, light: light * white, shine: shine * white });
            low = [low[0].min(x), low[1].min(y)];
            high = [high[0].max(x), high[1].max(y)];
        }
        let from = [0, 1].map(|axis| low[axis].floor().max(0.0) as usize);
        let to = [0, 1].map(|axis| ((high[axis] + 1.0).ceil().max(0.0) as usize).min(camera.image_size[axis] as usize));
        (from[0] < to[0] && from[1] < to[1]).then_some(Area { from, to })
    }
}

/// By how much moment number `moment` is shifted within the pixel [px]: evenly spread, 0 on average. Along rows, where most things move, moments
/// go from one side of the pixel to the other in their order: so they lie evenly along a smear, too.
fn shift(moment: u32, n_moments: u32) -> [f64; 2] {
    let n = f64::from(n_moments);
    let golden = |moment: u32| (0.5 + 0.618_033_988_749_894_9 * f64::from(moment)).fract();
    let mean = (0..n_moments).map(golden).sum::<f64>() / n;
    [(f64::from(moment) + 0.5) / n - 0.5, 0.8 * (golden(moment) - mean)]
}

struct Canvas<'s> {
    width: usize,
    area: Area,
    depths: &'s mut [f32],
    lights: &'s mut [f32],
}

/// What changes linearly over a triangle: depth, light, shine.
type Values = [f32; 3];

/// A triangle reaches this far beyond its edges [px], so that no gaps are left between two of them.
const OVERLAP: f32 = 1e-3;

impl Canvas<'_> {
    /// Draws a triangle that faces the camera.
    #[inline]
    fn draw(&mut self, [a, b, c]: [Corner; 3], texels: &[[f32; 2]; 3], texture: &Texture) {
        let (abx, aby, acx, acy) = (b.x - a.x, b.y - a.y, c.x - a.x, c.y - a.y);
        // Rows run downwards: seen from outside corners run clockwise here.
        let doubled = acx * aby - abx * acy;
        if doubled <= 1e-6 {
            return;
        }
        let bound = |a: f32, b: f32, c: f32, axis: usize| {
            let from = (ceiling(a.min(b).min(c) - OVERLAP).max(0) as usize).max(self.area.from[axis]);
            let to = ((floored(a.max(b).max(c) + OVERLAP) + 1).max(0) as usize).min(self.area.to[axis]);
            (from, to)
        };
        let ((left, right), (top, bottom)) = (bound(a.x, b.x, c.x, 0), bound(a.y, b.y, c.y, 1));
        if left >= right || top >= bottom {
            return;
        }
        let per = 1.0 / doubled;
        // Weights of b and c: linear in column and row.
        let (b_dx, b_dy) = (-acy * per, acx * per);
        let (c_dx, c_dy) = (aby * per, -abx * per);
        let values = |corner: Corner| [corner.depth, corner.light, corner.shine];
        let (at_a, at_b, at_c) = (values(a), values(b), values(c));
        let (to_b, to_c): (Values, Values) =
            (std::array::from_fn(|i| at_b[i] - at_a[i]), std::array::from_fn(|i| at_c[i] - at_a[i]));
        let across: Values = std::array::from_fn(|i| to_b[i] * b_dx + to_c[i] * c_dx);
        // Places in the texture, in steps of a texel.
        let texel = |axis: usize, of_b: f32, of_c: f32| {
            (texels[1][axis] - texels[0][axis]) * of_b + (texels[2][axis] - texels[0][axis]) * of_c
        };
        let texel_across = [0, 1].map(|axis| texel_steps(texel(axis, b_dx, c_dx)));
        // Where a weight that changes by `dx` in a column is 0: a reciprocal for each of the three.
        let slopes = [b_dx, c_dx, -(b_dx + c_dx)];
        let reciprocals = slopes.map(|it| if it == 0.0 { 0.0 } else { -1.0 / it });
        for row in top..bottom {
            let (dx, dy) = (left as f32 - a.x, row as f32 - a.y);
            let of_b = b_dx * dx + b_dy * dy;
            let of_c = c_dx * dx + c_dy * dy;
            let weights = [of_b, of_c, 1.0 - of_b - of_c];
            let (mut first, mut end) = (0.0_f32, (right - left) as f32 - 1.0);
            for i in 0..3 {
                let zero = weights[i] * reciprocals[i];
                if slopes[i] > 0.0 {
                    first = first.max(zero - OVERLAP);
                } else if slopes[i] < 0.0 {
                    end = end.min(zero + OVERLAP);
                }
            }
            let (first, end) = (ceiling(first), floored(end) + 1);
            if first >= end {
                continue;
            }
            let skipped = first as f32;
            let (of_b, of_c) = (of_b + b_dx * skipped, of_c + c_dx * skipped);
            let mut now: Values = std::array::from_fn(|i| at_a[i] + to_b[i] * of_b + to_c[i] * of_c);
            let mut place = [0, 1].map(|axis| texel_steps(texels[0][axis] + texel(axis, of_b, of_c)));
            let start = row * self.width + left;
            let pixels = start + first as usize..start + end as usize;
            let depths = &mut self.depths[pixels.clone()];
            for (depth, light) in depths.iter_mut().zip(&mut self.lights[pixels]) {
                if now[0] < *depth {
                    *depth = now[0];
                    *light = now[1] * texture.at(place) + now[2];
                }
                now = [now[0] + across[0], now[1] + across[1], now[2] + across[2]];
                place = [place[0].wrapping_add(texel_across[0]), place[1].wrapping_add(texel_across[1])];
            }
        }
    }
}

/// ⌈x⌉, for numbers that fit.
#[inline]
fn ceiling(x: f32) -> i32 {
    let whole = x as i32;
    whole + i32::from((whole as f32) < x)
}

/// ⌊x⌋, for numbers that fit.
#[inline]
fn floored(x: f32) -> i32 {
    let whole = x as i32;
    whole - i32::from((whole as f32) > x)
}

/// A place in a texture in 65,536ths of a texel.
#[inline]
fn texel_steps(texels: f32) -> i32 {
    (texels * 65_536.0) as i32
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_messages::{CameraId, Image, Time};
    use nalgebra::Point3;

    use super::*;
    use crate::camera::{CameraSettings, Renderer};
    use crate::painted::{FaceSettings, FaceSource};
    use crate::world::{Moment, SceneSettings, WalkKind, World};

    fn world(marks: usize) -> World {
        let settings = SceneSettings {
            walk: WalkKind::Stage,
            stand_s: 4.0,
            people_enter_s: 0.0,
            glints_hz: 0.0,
            face: Some(FaceSettings { marks, source: FaceSource::BuiltIn, ..FaceSettings::default() }),
            ..SceneSettings::default()
        };
        World::new(settings, &Random::new(3))
    }

    /// Looks at the actor's head as it is at `time`, from `from`.
    fn camera(world: &World, time: Time, from: [f64; 3]) -> Camera {
        let head = world.painted(time).unwrap().world_from_part.translation.vector;
        Camera::look_at(Point3::from(from), Point3::from(head), [640, 480], 2600.0)
    }

    fn picture(world: &World, camera: &Camera, exposure_ms: f64, time: Time) -> Image {
        let settings = CameraSettings { noise_sigma: 0.0, exposure_ms, blur_samples: 12, ..CameraSettings::default() };
        let mut image = Image::default();
        Renderer::on_head(camera, CameraId(0), &settings, &Random::new(2)).render(world, time, 0, &mut image);
        image
    }

    const PLACES: [[f64; 3]; 4] = [[0.0, 3.0, 2.0], [-1.6, 2.5, 1.7], [1.6, 2.4, 1.9], [0.3, 3.0, 1.3]];

    /// Marks on the ridge and the wings of the nose are bent: their middle seems to lie up to half a pixel beside their centre.
    const BENT: std::ops::RangeInclusive<usize> = 13..=18;

    #[test]
    fn marks_are_dark_where_they_truly_are() {
        let [world, bare] = [69, 1].map(world);
        let mut errors = Vec::new();
        for (step, place) in (0..3).flat_map(|step| PLACES.map(|place| (step, place))) {
            let time = Time::from_s(2.6 + 1.13 * f64::from(step));
            let (camera, painted) = (camera(&world, time, place), world.painted(time).unwrap());
            let [image, bare] = [&world, &bare].map(|it| picture(it, &camera, 0.02, time));
            for (mark, (position, normal)) in painted.marks.iter().zip(&painted.normals).enumerate().skip(1) {
                let to_eye = (camera.centre() - position).normalize();
                if to_eye.dot(normal) < 0.6 || BENT.contains(&mark) || !painted.sees(&camera.centre(), mark) {
                    continue;
                }
                let pixel = camera.sees(position).unwrap();
                let others =
                    painted.marks.iter().filter_map(|it| camera.sees(it)).filter(|it| (it - pixel).norm() < 8.5);
                if others.count() > 1 {
                    continue;
                }
                let (mut sum, mut moments) = (0.0, Vector2::zeros());
                for (x, y) in (-4..=4).flat_map(|y| {
                    (-4..=4).map(move |x| (pixel.x.round() + f64::from(x), pixel.y.round() + f64::from(y)))
                }) {
                    let place = y as usize * 640 + x as usize;
                    let dark = f64::from(bare.pixels[place]) - f64::from(image.pixels[place]);
                    sum += dark;
                    moments += Vector2::new(x - pixel.x, y - pixel.y) * dark;
                }
                // Hardly anything is to be seen where a mark is on a brow or half hidden.
                if sum > 250.0 {
                    errors.push((moments / sum).norm());
                }
            }
        }
        errors.sort_by(f64::total_cmp);
        let share = |share: f64| errors[(errors.len() as f64 * share) as usize];
        let most = errors[errors.len() - 1];
        println!("{} marks: median {:.3}, 90 % {:.3}, most {most:.3} px", errors.len(), share(0.5), share(0.9));
        assert!(errors.len() > 400 && share(0.5) < 0.04 && share(0.9) < 0.1, "{} marks", errors.len());
    }

    #[test]
    fn depths_of_the_picture_and_lines_of_sight_agree_on_what_is_hidden() {
        let world = world(69);
        let (mut surfaces, mut moment, mut counts) = (Surfaces::default(), Moment::default(), [0; 3]);
        for (step, angle) in (0..4).flat_map(|step| (0..12).map(move |it| (step, f64::from(it) * 0.52))) {
            let time = Time::from_s(3.0 + 0.61 * f64::from(step));
            let head = world.painted(time).unwrap().world_from_part.translation.vector;
            let from = [head.x + 3.0 * angle.sin(), head.y + 3.0 * angle.cos(), head.z + angle.sin() * 0.4];
            let (camera, painted) = (camera(&world, time, from), world.painted(time).unwrap());
            world.at(time, &mut moment);
            let part = world.painted_part(time).unwrap();
            let skin = part.skin(time, &moment.poses[0]);
            surfaces.begin(640 * 480);
            surfaces.add(&camera, part, &skin, 200.0, [0, 1]);
            for (mark, (position, normal)) in painted.marks.iter().zip(&painted.normals).enumerate() {
                let to_eye = (camera.centre() - position).normalize();
                // At the very edge a pixel decides.
                if to_eye.dot(normal).abs() < 0.2 {
                    continue;
                }
                let pixel = camera.project(position).unwrap();
                let depth = (camera.camera_from_world * position).z as f32;
                let drawn = surfaces.depths[pixel.y.round() as usize * 640 + pixel.x.round() as usize];
                let is_seen = painted.sees(&camera.centre(), mark);
                // Where something lies hardly before the mark, or it lies on the outline, half a pixel aside may be another thing.
                let before = depth - drawn;
                if (0.5e-3..10e-3).contains(&before) || drawn == f32::INFINITY {
                    counts[2] += 1;
                    continue;
                }
                counts[usize::from(is_seen)] += 1;
                assert_eq!(is_seen, before < 1e-3, "mark {mark} at {time:?} from {from:?}: {drawn} m, {depth} m");
            }
        }
        assert!(counts[0] > 700 && counts[1] > 700 && counts[2] < 350, "{counts:?}");
    }

    #[test]
    fn what_moves_across_is_smeared_across() {
        let world = world(69);
        // In the middle of the stage at full pace.
        let crossing = (0..200).map(|it| Time::from_s(7.5 + 0.01 * f64::from(it))).max_by(|a, b| {
            let speed = |time: Time| {
                let head = |time| world.painted(time).unwrap().world_from_part.translation.vector.x;
                (head(time + foveate_messages::Interval::from_ms(1.0)) - head(time)).abs()
            };
            speed(*a).total_cmp(&speed(*b))
        });
        let time = crossing.unwrap();
        let camera = camera(&world, time, PLACES[0]);
        let changes = |image: &Image| {
            let at = |x: usize, y: usize| f64::from(image.pixels[y * 640 + x]);
            let face = || (180..300).flat_map(|y| (270..370).map(move |x| (x, y)));
            let across: f64 = face().map(|(x, y)| (at(x + 1, y) - at(x, y)).abs()).sum();
            let down: f64 = face().map(|(x, y)| (at(x, y + 1) - at(x, y)).abs()).sum();
            [across, down]
        };
        let [sharp, smeared] = [0.02, 20.0].map(|exposure_ms| changes(&picture(&world, &camera, exposure_ms, time)));
        let left = [0, 1].map(|axis| smeared[axis] / sharp[axis]);
        assert!(left[0] < 0.5 && left[1] > 1.4 * left[0], "{left:?}");
    }

    #[test]
    fn pictures_depend_on_their_time_alone() {
        let pictures = |order: &[i32]| -> Vec<(i32, Image)> {
            let world = world(69);
            let times = order.iter().map(|it| (*it, Time::from_s(2.5 + 0.033 * f64::from(*it))));
            times.map(|(it, time)| (it, picture(&world, &camera(&world, time, PLACES[1]), 4.0, time))).collect()
        };
        let (forth, mut back) = (pictures(&[0, 1, 2, 200]), pictures(&[200, 1, 2, 0]));
        back.sort_by_key(|it| it.0);
        assert!(forth == back);
        assert!(forth[0].1 != forth[1].1);
    }
}
