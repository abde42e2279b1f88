//! A textured surface as a camera sees it: triangles with a depth for each pixel, at several moments of the exposure.
//!
//! Each moment is drawn with its own small shift within the pixel, so that the mean of all has smooth edges and the smear of what moved,
//! the camera included.

use std::sync::Arc;

use foveate_geometry::Intrinsics;
use nalgebra::{Matrix3, Point3, Vector2, Vector3};

use super::STEPS;
use super::triangles::{Area, Canvas, Corner, LANES, Pixel};
use crate::painted::{Part, Skin, key_light};
use crate::truth::TrueCamera;

/// Nothing is drawn of a surface that comes nearer to the camera than this [m].
const NEAREST_M: f64 = 0.15;
/// How bright the shine on skin is at its brightest, relative to a white surface that faces the light.
const SHINE: f32 = 0.13;

/// The camera and the surface at one moment of the exposure.
pub(super) struct View {
    pub camera: TrueCamera,
    pub skin: Arc<Skin>,
    /// By how much it is drawn aside: see [`shift`] [px].
    pub shift: [f64; 2],
    /// Rolling shutter: the same at even steps from the time of the first row to that of the last one. Empty: all rows at once.
    pub rows: Vec<(TrueCamera, Arc<Skin>)>,
}

/// A camera where it stands.
struct Eye<'c> {
    camera: &'c TrueCamera,
    rotation: Matrix3<f64>,
    is_ideal: bool,
}

impl<'c> Eye<'c> {
    fn new(camera: &'c TrueCamera) -> Self {
        let rotation = camera.camera_from_world.rotation.to_rotation_matrix().into_inner();
        Self { rotation, is_ideal: camera.is_ideal(), camera }
    }

    /// Column, row [px] and depth [m]; `None` of what is too near, or where the lens has no answer.
    fn image(&self, point: &Point3<f64>) -> Option<[f64; 3]> {
        let seen = self.rotation * point.coords + self.camera.camera_from_world.translation.vector;
        if seen.z < NEAREST_M {
            return None;
        }
        let Intrinsics { focal, principal, skew } = self.camera.intrinsics;
        let ideal = Vector2::new(seen.x, seen.y) / seen.z;
        let place = if self.is_ideal { ideal } else { self.camera.distort(&ideal)? };
        Some([focal[0] * place.x + skew * place.y + principal[0], focal[1] * place.y + principal[1], seen.z])
    }
}

/// Where vertex number `number` is seen by rows that are exposed one after the other, from the `eyes` and skins at even steps from the time of the first row to that of
/// the last one; the row of a picture of `height` rows that images it is the one that is exposed just then.
fn rolled(eyes: &[Eye<'_>], skins: &[(TrueCamera, Arc<Skin>)], number: usize, height: u32) -> Option<[f64; 3]> {
    let last = (eyes.len() - 1) as f64;
    let at = |step: usize| {
        let place = eyes[step].image(&skins[step].1.vertices[number])?;
        // How far ahead of the row being exposed it lies, in heights of the picture.
        Some((place, place[1] / f64::from(height - 1) - step as f64 / last))
    };
    let mut from = at(0)?;
    for step in 1..eyes.len() {
        let to = at(step)?;
        if to.1 <= 0.0 || step + 1 == eyes.len() {
            let share = (from.1 / (from.1 - to.1)).clamp(-last, last);
            return Some([0, 1, 2].map(|it| from.0[it] + (to.0[it] - from.0[it]) * share));
        }
        from = to;
    }
    None
}

/// Draws a surface; keeps its memory from field to field.
#[derive(Default)]
pub(super) struct Surfaces {
    corners: Vec<Corner>,
    /// Of the area that is drawn; empty but while moments are drawn.
    pixels: Vec<Pixel>,
    /// Of all moments so far: light [steps], and how many of them saw the surface.
    sums: Vec<(f32, f32)>,
    area: Option<Area>,
}

impl Surfaces {
    /// Draws all `views` of `n_pixels` each. `white` [gray level] is what a white surface shows that faces the light.
    pub fn draw(&mut self, n_pixels: usize, part: &Part, white: f64, views: &[View]) {
        self.area = None;
        self.sums.resize(n_pixels, (0.0, 0.0));
        for views in views.chunks(LANES) {
            let Some(area) = self.draw_together(part, white, views) else { continue };
            self.sum_up(area, views[0].camera.image_size[0] as usize);
            self.area = Some(self.area.map_or(area, |it| it.with(area)));
        }
    }

    /// Draws up to four moments, and says which pixels they take up, if any.
    fn draw_together(&mut self, part: &Part, white: f64, views: &[View]) -> Option<Area> {
        let mut area: Option<Area> = None;
        self.corners.resize(part.surface.rest.len(), Corner::default());
        for lane in 0..LANES {
            match views.get(lane).and_then(|view| self.project(view, (white * STEPS) as f32, lane)) {
                Some(of_lane) => area = Some(area.map_or(of_lane, |it| it.with(of_lane))),
                None => self.corners.iter_mut().for_each(|it| (it.x[lane], it.y[lane]) = (0.0, 0.0)),
            }
        }
        let area = area?;
        if self.pixels.len() < area.n_pixels() {
            self.pixels.resize(area.n_pixels(), Pixel::EMPTY);
        }
        let mut canvas = Canvas { area, pixels: &mut self.pixels };
        let texture = part.texture();
        part.surface.triangles.iter().for_each(|it| canvas.draw(&self.corners, it, texture));
        Some(area)
    }

    /// Adds what the moments show to the sums, in their order, and makes room for the next ones.
    fn sum_up(&mut self, area: Area, width: usize) {
        for row in area.from[1]..area.to[1] {
            let sums = &mut self.sums[row * width..][area.from[0]..area.to[0]];
            for ((light, count), pixel) in sums.iter_mut().zip(&mut self.pixels[area.row(row)]) {
                let is_seen = pixel.depth.simd_lt(Pixel::EMPTY.depth);
                let moments = is_seen.to_bitmask();
                if moments != 0 {
                    *light = (is_seen & pixel.light).to_array().iter().fold(*light, |sum, it| sum + it);
                    *count += moments.count_ones() as f32;
                    *pixel = Pixel::EMPTY;
                }
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

    /// Fills in where the corners are at a moment; the pixels that they take up, or `None` where nothing is seen.
    fn project(&mut self, view: &View, white: f32, lane: usize) -> Option<Area> {
        let View { camera, skin, shift, rows } = view;
        let eye = Eye::new(camera);
        let of_rows: Vec<Eye<'_>> = rows.iter().map(|it| Eye::new(&it.0)).collect();
        let to_eye = (camera.centre() - skin.vertices[0]).normalize().cast::<f32>();
        // Everything is far away against its own size: one direction to the camera for all.
        let half_way: Vector3<f32> = (to_eye + key_light()).normalize();
        let (mut low, mut high) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2]);
        let vertices = skin.vertices.iter().zip(&skin.normals).zip(&skin.light);
        for (number, (corner, ((vertex, normal), light))) in self.corners.iter_mut().zip(vertices).enumerate() {
            let place =
                if rows.is_empty() { eye.image(vertex) } else { rolled(&of_rows, rows, number, camera.image_size[1]) };
            let [column, row, depth] = place?;
            let (x, y) = ((column + shift[0]) as f32, (row + shift[1]) as f32);
            let mirrored = normal.dot(&half_way).max(0.0);
            let (square, fourth) = (mirrored * mirrored, mirrored.powi(4));
            let shine = SHINE * fourth * fourth * fourth * square * light.min(1.0);
            (corner.x[lane], corner.y[lane], corner.depth[lane]) = (x, y, depth as f32);
            (corner.light[lane], corner.shine[lane]) = (light * white, shine * white);
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
pub(super) fn shift(moment: u32, n_moments: u32) -> [f64; 2] {
    let n = f64::from(n_moments);
    let golden = |moment: u32| (0.5 + 0.618_033_988_749_894_9 * f64::from(moment)).fract();
    let mean = (0..n_moments).map(golden).sum::<f64>() / n;
    [(f64::from(moment) + 0.5) / n - 0.5, 0.8 * (golden(moment) - mean)]
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_geometry::Camera;
    use foveate_messages::{CameraId, Image, Interval, Time};
    use nalgebra::Point3;

    use super::*;
    use crate::camera::{CameraSettings, Renderer, SensorSettings};
    use crate::painted::{FaceSettings, FaceSource};
    use crate::world::{SceneSettings, WalkKind, World};

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

    fn picture(world: &World, camera: &Camera, [exposure_ms, readout_ms]: [f64; 2], time: Time) -> Image {
        let sensor = SensorSettings {
            readout_ms,
            electrons: 0.0,
            gain_spread: 0.0,
            gain_pattern: 0.0,
            dark_pattern: 0.0,
            dark_columns: 0.0,
            vignetting: 0.0,
            flicker: 0.0,
            ..SensorSettings::default()
        };
        let sensor = (readout_ms > 0.0).then_some(sensor);
        let settings =
            CameraSettings { noise_sigma: 0.0, exposure_ms, blur_samples: 12, sensor, ..CameraSettings::default() };
        let mut image = Image::default();
        Renderer::on_head(camera, CameraId(0), &settings, &Random::new(2)).render(world, time, 0, &mut image);
        image
    }

    const PLACES: [[f64; 3]; 4] = [[0.0, 3.0, 2.0], [-1.6, 2.5, 1.7], [1.6, 2.4, 1.9], [0.3, 3.0, 1.3]];

    /// Marks on the ridge and the wings of the nose are bent: their middle seems to lie up to half a pixel beside their centre.
    const BENT: std::ops::RangeInclusive<usize> = 13..=18;

    /// When the row is exposed that shows a mark, of a picture whose middle row is exposed at `time`.
    fn shown_at(world: &World, camera: &Camera, mark: usize, time: Time, readout_ms: f64) -> Option<Time> {
        (0..5).try_fold(time, |at, _| {
            let row = camera.sees(&world.painted(at)?.marks[mark])?.y;
            Some(time + Interval::from_ms((row / 479.0 - 0.5) * readout_ms))
        })
    }

    /// How far the middle of what is dark lies from where marks truly are, ascending [px].
    fn off_the_truth(times_s: [f64; 3], readout_ms: f64) -> Vec<f64> {
        let [world, bare] = [69, 1].map(world);
        let mut errors = Vec::new();
        for (time, place) in times_s.into_iter().flat_map(|it| PLACES.map(|place| (Time::from_s(it), place))) {
            let camera = camera(&world, time, place);
            let [image, bare] = [&world, &bare].map(|it| picture(it, &camera, [0.02, readout_ms], time));
            for mark in (1..69).filter(|it| !BENT.contains(it)) {
                let Some(at) = shown_at(&world, &camera, mark, time, readout_ms) else { continue };
                let painted = world.painted(at).unwrap();
                let (position, normal) = (painted.marks[mark], painted.normals[mark]);
                let to_eye = (camera.centre() - position).normalize();
                if to_eye.dot(&normal) < 0.6 || !painted.sees(&camera.centre(), mark) {
                    continue;
                }
                let pixel = camera.sees(&position).unwrap();
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
        errors
    }

    #[test]
    fn marks_are_dark_where_they_truly_are() {
        let errors = off_the_truth([2.6, 3.73, 4.86], 0.0);
        let share = |share: f64| errors[(errors.len() as f64 * share) as usize];
        let most = errors[errors.len() - 1];
        println!("{} marks: median {:.3}, 90 % {:.3}, most {most:.3} px", errors.len(), share(0.5), share(0.9));
        assert!(errors.len() > 400 && share(0.5) < 0.04 && share(0.9) < 0.1, "{} marks", errors.len());
    }

    #[test]
    fn rows_that_are_exposed_later_show_marks_where_they_are_then() {
        // While the actor walks.
        let errors = off_the_truth([8.6, 9.3, 10.1], 14.0);
        let share = |share: f64| errors[(errors.len() as f64 * share) as usize];
        println!("{} marks: median {:.3}, 90 % {:.3} px", errors.len(), share(0.5), share(0.9));
        assert!(errors.len() > 300 && share(0.5) < 0.06 && share(0.9) < 0.15, "{} marks", errors.len());
    }

    #[test]
    fn depths_of_the_picture_and_lines_of_sight_agree_on_what_is_hidden() {
        let world = world(69);
        let (mut surfaces, mut counts) = (Surfaces::default(), [0; 3]);
        for (step, angle) in (0..4).flat_map(|step| (0..12).map(move |it| (step, f64::from(it) * 0.52))) {
            let time = Time::from_s(3.0 + 0.61 * f64::from(step));
            let head = world.painted(time).unwrap().world_from_part.translation.vector;
            let from = [head.x + 3.0 * angle.sin(), head.y + 3.0 * angle.cos(), head.z + angle.sin() * 0.4];
            let (camera, painted) = (camera(&world, time, from), world.painted(time).unwrap());
            let (part, skin) = world.part(time).unwrap();
            surfaces.pixels.fill(Pixel::EMPTY);
            let view = View { camera: TrueCamera::from(&camera), skin, shift: shift(0, 1), rows: Vec::new() };
            let area = surfaces.draw_together(part, 200.0, &[view]).unwrap();
            for (mark, (position, normal)) in painted.marks.iter().zip(&painted.normals).enumerate() {
                let to_eye = (camera.centre() - position).normalize();
                // At the very edge a pixel decides.
                if to_eye.dot(normal).abs() < 0.2 {
                    continue;
                }
                let pixel = camera.project(position).unwrap();
                let depth = (camera.camera_from_world * position).z as f32;
                let [column, row] = [pixel.x, pixel.y].map(|it| it.round() as usize);
                let drawn = surfaces.pixels[area.row(row)][column - area.from[0]];
                // Of four moments at once, the first is the only one here.
                let [drawn, nothing @ ..] = drawn.depth.to_array();
                assert_eq!(nothing, [f32::INFINITY; 3]);
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
                (head(time + Interval::from_ms(1.0)) - head(time)).abs()
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
        let [sharp, smeared] =
            [0.02, 20.0].map(|exposure_ms| changes(&picture(&world, &camera, [exposure_ms, 0.0], time)));
        let left = [0, 1].map(|axis| smeared[axis] / sharp[axis]);
        assert!(left[0] < 0.5 && left[1] > 1.4 * left[0], "{left:?}");
    }

    #[test]
    fn pictures_depend_on_their_time_alone() {
        let pictures = |order: &[i32]| -> Vec<(i32, Image)> {
            let world = world(69);
            let times = order.iter().map(|it| (*it, Time::from_s(2.5 + 0.033 * f64::from(*it))));
            times.map(|(it, time)| (it, picture(&world, &camera(&world, time, PLACES[1]), [4.0, 0.0], time))).collect()
        };
        let (forth, mut back) = (pictures(&[0, 1, 2, 200]), pictures(&[200, 1, 2, 0]));
        back.sort_by_key(|it| it.0);
        assert!(forth == back);
        assert!(forth[0].1 != forth[1].1);
    }
}
