//! The static part of the studio as a camera sees it: by how much each lamp lights each pixel, and where people block that light.

use nalgebra::{Point3, Vector3};

use super::blur::{Area, blur};
use super::motion::Projector;
use super::{GRAY, TILE};
use crate::camera::{CameraSettings, STEPS};
use crate::sight::{Facet, FirstHits, Lines};
use crate::studio::{Lighting, Studio, place};
use crate::truth::TrueCamera;

/// By channel, then by pixel [steps].
type Planes = Vec<Vec<i16>>;

/// The static scene, as a camera sees it.
pub(super) struct Still {
    pub camera: TrueCamera,
    pub samples: usize,
    /// By lamp, at its full light, and last the light from all around; then by channel [steps].
    lit_by: Vec<Vec<Vec<i16>>>,
    /// Where each pixel's line of sight ends [m], and how far along the optical axis [m].
    points: Vec<[f32; 3]>,
    pub depths: Vec<f32>,
    /// By tile: opposite corners of the box around its points [m].
    tiles: Vec<[[f32; 3]; 2]>,
    /// The sum for these levels of the lamps, sharp and as the lens blurs it.
    sums: Option<(Vec<f32>, [Planes; 2])>,
}

impl Still {
    pub fn new(
        camera: &TrueCamera,
        lines: &Lines,
        studio: &Studio,
        settings: &CameraSettings,
        samples: usize,
        n_channels: usize,
    ) -> Self {
        let [width, height] = camera.image_size.map(|it| it as usize);
        let eye = camera.centre();
        let turn = camera.camera_from_world.rotation.inverse().to_rotation_matrix();
        let n = samples as f64;
        let shifts: Vec<[f64; 2]> = (0..samples * samples)
            .map(|it| [it % samples, it / samples].map(|it| (it as f64 + 0.5) / n - 0.5))
            .collect();
        let projector = Projector::new(camera);
        let imaged: Vec<[f32; 3]> =
            studio.props.vertices.iter().map(|it| projector.image(it).unwrap_or([0.0; 3])).collect();
        let hits: Vec<FirstHits> = shifts
            .iter()
            .map(|shift| {
                let mut hits = FirstHits::default();
                hits.draw(&imaged, &studio.props.triangles, *shift, camera.image_size);
                hits
            })
            .collect();
        let n_lights = studio.lamps.len() + 1;
        let resolved = (1.0 / n / camera.intrinsics.focal[0]).max(1e-6);
        let look = |column: usize, row: usize, shift: [f64; 2], hits: &FirstHits| {
            let [x, y] = lines.at_shifted(column, row, width, shift);
            let along = turn * Vector3::new(x, y, 1.0);
            let mut place = place(&eye, &along, resolved * 3.0);
            if let Some(triangle) = hits.triangle(column, row) {
                let facet = Facet::of(&studio.props.triangles[triangle], &studio.props.vertices);
                let depth = facet.depth(&eye, &along);
                if depth < place.depth {
                    place.depth = depth;
                    place.point = eye + along * depth;
                    place.normal = studio.props.normal(triangle);
                    place.colour = studio.props.colour(triangle, &place.point);
                }
            }
            place
        };
        let scale = (settings.room_light * settings.gain * STEPS) as f32;
        // By pixel: point, depth, then by light and channel.
        let n_values = n_lights * n_channels;
        let mut seen = vec![([0.0_f32; 3], 0.0_f32); width * height];
        let mut lit = vec![0_i16; width * height * n_values];
        let n_threads = std::thread::available_parallelism().map_or(1, usize::from).min(height);
        let per_thread = height.div_ceil(n_threads);
        let one_row = |row: usize, seen: &mut [([f32; 3], f32)], lit: &mut [i16]| {
            let mut lights = vec![[0.0_f32; 3]; n_lights];
            for (column, (seen, lit)) in seen.iter_mut().zip(lit.chunks_exact_mut(n_values)).enumerate() {
                lights.iter_mut().for_each(|it| *it = [0.0; 3]);
                for (number, (shift, hits)) in shifts.iter().zip(&hits).enumerate() {
                    let place = look(column, row, *shift, hits);
                    if number == shifts.len() / 2 {
                        *seen = (place.point.cast::<f32>().coords.into(), place.depth as f32);
                    }
                    for (number, light) in lights.iter_mut().enumerate() {
                        let by = match studio.lamps.get(number) {
                            None => [studio.ambient(&place.normal); 3],
                            Some(lamp) => {
                                let free = studio.prop_maps.get(number).map_or(1.0, |it| it.free(&place.point));
                                let falls = lamp.falls_on(&place.point, &place.normal) * free;
                                lamp.colour().map(|it| it * falls)
                            }
                        };
                        [0, 1, 2].into_iter().for_each(|it| light[it] += place.colour[it] * by[it]);
                    }
                }
                for (light, lit) in lights.iter().zip(lit.chunks_exact_mut(n_channels)) {
                    let of = light.map(|it| it * scale / shifts.len() as f32);
                    let gray = GRAY[0] * of[0] + GRAY[1] * of[1] + GRAY[2] * of[2];
                    let of = if n_channels == 1 { [gray; 3] } else { of };
                    lit.iter_mut().zip(of).for_each(|(lit, of)| *lit = of.round() as i16);
                }
            }
        };
        std::thread::scope(|scope| {
            let rows = seen.chunks_mut(width * per_thread).zip(lit.chunks_mut(width * per_thread * n_values));
            for (share, (seen, lit)) in rows.enumerate() {
                let one_row = &one_row;
                scope.spawn(move || {
                    let rows = seen.chunks_mut(width).zip(lit.chunks_mut(width * n_values));
                    for (row, (seen, lit)) in rows.enumerate() {
                        one_row(share * per_thread + row, seen, lit);
                    }
                });
            }
        });
        let plane = |value: usize| lit.iter().skip(value).step_by(n_values).copied().collect::<Vec<i16>>();
        let lit_by =
            (0..n_lights).map(|light| (0..n_channels).map(|it| plane(light * n_channels + it)).collect()).collect();
        let points: Vec<[f32; 3]> = seen.iter().map(|it| it.0).collect();
        Self {
            camera: camera.clone(),
            samples,
            lit_by,
            tiles: boxes(&points, [width, height]),
            points,
            depths: seen.iter().map(|it| it.1).collect(),
            sums: None,
        }
    }

    /// The light of lamps at these levels, sharp and blurred.
    pub fn sum(&mut self, levels: &[f32], settings: &CameraSettings) -> &[Vec<Vec<i16>>; 2] {
        let known = self.sums.take().filter(|it| it.0 == levels);
        let known = known.unwrap_or_else(|| {
            let black = (settings.black_level * STEPS) as f32;
            let [width, height] = self.camera.image_size.map(|it| it as usize);
            let mut sums = vec![0.0_f32; width * height];
            let sharp: Vec<Vec<i16>> = (0..self.lit_by[0].len())
                .map(|channel| {
                    sums.fill(black);
                    for (lit, level) in self.lit_by.iter().zip(levels.iter().chain([&1.0])) {
                        sums.iter_mut().zip(&lit[channel]).for_each(|(sum, it)| *sum += f32::from(*it) * level);
                    }
                    sums.iter().map(|it| it.round() as i16).collect()
                })
                .collect();
            let mut blurred = sharp.clone();
            let all = Area { columns: 0..width, rows: 0..height };
            for (plane, sharp) in blurred.iter_mut().zip(&sharp) {
                blur(sharp, plane, width, &all, settings.blur_px);
            }
            (levels.to_vec(), [sharp, blurred])
        });
        &self.sums.insert(known).1
    }

    /// Takes away the light that people block.
    pub fn shade(&self, lighting: &Lighting, planes: &mut [Vec<i16>], changed: &mut Area) {
        let [width, height] = self.camera.image_size.map(|it| it as usize);
        let n_columns = width.div_ceil(TILE);
        for (number, [low, high]) in self.tiles.iter().enumerate() {
            let (column, row) = (number % n_columns * TILE, number / n_columns * TILE);
            let corners: [Point3<f64>; 8] = std::array::from_fn(|corner| {
                let at = |axis: usize| f64::from(if corner >> axis & 1 == 1 { high[axis] } else { low[axis] });
                Point3::new(at(0), at(1), at(2))
            });
            let mut is_changed = false;
            for (lamp, (level, maps)) in lighting.levels.iter().zip(&lighting.maps).enumerate() {
                let near = maps.iter().filter(|it| it.may_shade(&corners));
                let near: Vec<_> = if *level > 0.0 { near.collect() } else { Vec::new() };
                if near.is_empty() {
                    continue;
                }
                for row in row..(row + TILE).min(height) {
                    for column in column..(column + TILE).min(width) {
                        let pixel = row * width + column;
                        if self.lit_by[lamp].iter().all(|it| it[pixel] == 0) {
                            continue;
                        }
                        let point = Point3::from(self.points[pixel]).cast::<f64>();
                        let free: f32 = near.iter().map(|it| it.free(&point)).product();
                        if free < 1.0 {
                            is_changed = true;
                            for (plane, lit) in planes.iter_mut().zip(&self.lit_by[lamp]) {
                                let less = f32::from(lit[pixel]) * level * (1.0 - free);
                                plane[pixel] -= less.round() as i16;
                            }
                        }
                    }
                }
            }
            if is_changed {
                changed.add(&(column..(column + TILE).min(width)), &(row..(row + TILE).min(height)));
            }
        }
    }
}

/// By tile, opposite corners of the box around its points.
fn boxes(points: &[[f32; 3]], [width, height]: [usize; 2]) -> Vec<[[f32; 3]; 2]> {
    let tiles = (0..height).step_by(TILE).flat_map(|row| (0..width).step_by(TILE).map(move |it| (it, row)));
    let of = |(column, row): (usize, usize)| {
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for row in row..(row + TILE).min(height) {
            for point in &points[row * width + column..row * width + (column + TILE).min(width)] {
                for axis in 0..3 {
                    (low[axis], high[axis]) = (low[axis].min(point[axis]), high[axis].max(point[axis]));
                }
            }
        }
        [low, high]
    };
    tiles.map(of).collect()
}
