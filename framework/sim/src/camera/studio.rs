//! People in clothes and the room around them as a camera sees them, in colour.
//!
//! What stands still is rendered once for a camera that stands still: by how much each lamp lights each pixel. For each picture the light of the lamps is summed, what people hold up of it is taken
//! away, and people are drawn over it, at several moments of the exposure, each with its own small shift within the pixel, every pixel where its true line of sight meets the surface. At last
//! the lens blurs what has changed.

use std::sync::Arc;

use foveate_messages::{Interval, Time};
use nalgebra::{Point3, Vector3};

use super::surface::shift;
use super::{CameraSettings, STEPS};
use crate::sight::{Facet, FirstHits, Lines};
use crate::studio::{Colour, Lighting, Posed, Studio, place};
use crate::truth::TrueCamera;
use crate::world::World;

/// Shadows are looked for in squares of so many pixels.
const TILE: usize = 8;
/// Samples along each side of a pixel of what stands still, for a camera that stands still, and for one that moves.
const SAMPLES: [usize; 2] = [3, 1];
/// People are posed at least this often, between which their surface moves in straight lines [ms].
const KEY_MS: f64 = 8.0;
/// Nothing is seen of a triangle with a corner nearer than this [m].
const NEAREST_M: f64 = 0.1;
/// Shares of red, green and blue in gray (Rec. ITU-R BT.601).
const GRAY: Colour = [0.299, 0.587, 0.114];
/// Things in a picture's first hits are counted from the bits above these.
pub(super) const THING_BIT: u32 = 22;
/// Of what is sharper than a pixel, so much is left in each of its samples [–].
const RESOLVED: f32 = 0.7;

/// What stands still, as a camera sees it.
struct Still {
    camera: TrueCamera,
    samples: usize,
    /// By lamp, at its full light, and last the light from all around; then by channel [steps].
    lit_by: Vec<Vec<Vec<i16>>>,
    /// Where each pixel's line of sight ends [m], and how far along the optical axis [m].
    points: Vec<[f32; 3]>,
    depths: Vec<f32>,
    /// By tile: opposite corners of the box around its points [m].
    tiles: Vec<[[f32; 3]; 2]>,
    /// The sum for these levels of the lamps, sharp and as the lens blurs it.
    sums: Option<(Vec<f32>, [Vec<Vec<i16>>; 2])>,
}

/// Draws the studio; keeps its memory from picture to picture.
#[derive(Default)]
pub(super) struct StudioView {
    lines: Option<Lines>,
    still: Option<Still>,
    hits: FirstHits,
    imaged: Vec<Vec<[f32; 3]>>,
    vertices: Vec<Vec<Point3<f64>>>,
    /// Light of people, and how many moments saw them, over the area that they take up.
    sums: Vec<(Colour, u16)>,
}

/// When and how a picture is taken.
pub(super) struct Take<'t> {
    pub world: &'t World,
    pub capture: Time,
    /// How the camera stands at some time.
    pub camera_at: &'t dyn Fn(Time) -> TrueCamera,
    pub is_on_head: bool,
    /// From the first row's exposure to the last one's [ms].
    pub readout_ms: f64,
}

impl StudioView {
    /// Overwrites `planes`, one of gray levels or three of colours, with the picture [steps].
    pub fn draw(&mut self, studio: &Studio, take: &Take<'_>, settings: &CameraSettings, planes: &mut [Vec<i16>]) {
        let camera = (take.camera_at)(take.capture);
        let lines = Lines::know(&mut self.lines, &camera);
        let samples = SAMPLES[usize::from(take.is_on_head)];
        let is_known = |it: &Still| it.camera == camera && it.samples == samples;
        let mut still = match self.still.take().filter(is_known) {
            Some(known) => known,
            None => Still::new(&camera, lines, studio, settings, samples, planes.len()),
        };
        let there = take.world.present(take.capture);
        let posed = |time: Time| {
            let of = |it: &usize| (*it, take.world.posed(studio, *it, time));
            there.iter().map(of).collect::<Vec<_>>()
        };
        let middle = posed(take.capture);
        let lighting = studio.lighting(take.capture, settings.exposure_ms * 1e-3, &middle);
        let [sharp, blurred] = still.sum(&lighting.levels, settings);
        for (plane, (sharp, blurred)) in planes.iter_mut().zip(sharp.iter().zip(blurred)) {
            plane.copy_from_slice(if there.is_empty() { blurred } else { sharp });
        }
        if !there.is_empty() {
            let mut changed = Area::default();
            still.shade(&lighting, planes, &mut changed);
            let white = (settings.room_light * settings.gain) as f32;
            self.draw_people(studio, take, settings, (&still, &lighting, &posed, white), planes, &mut changed);
            let [sharp, blurred] = still.sum(&lighting.levels, settings);
            blur_within(planes, [sharp, blurred], camera.image_size, changed, settings.blur_px);
        }
        self.still = Some(still);
    }

    fn draw_people(
        &mut self,
        studio: &Studio,
        take: &Take<'_>,
        settings: &CameraSettings,
        (still, lighting, posed, white): (&Still, &Lighting, &PosedAt<'_>, f32),
        planes: &mut [Vec<i16>],
        changed: &mut Area,
    ) {
        let Some(lines) = &self.lines else { return };
        let n_moments = settings.blur_samples.max(super::LEAST_FACE_MOMENTS);
        let motion = Motion::new(take, settings, posed);
        let [width, height] = still.camera.image_size.map(|it| it as usize);
        self.sums.resize(width * height, ([0.0; 3], 0));
        let mut area = Area::default();
        let resolved = RESOLVED;
        for number in 0..n_moments {
            let share = (f64::from(number) + 0.5) / f64::from(n_moments) - 0.5;
            let late = Interval::from_ms(share * settings.exposure_ms);
            let camera = (take.camera_at)(take.capture + late);
            let shift = shift(number, n_moments);
            motion.image(&camera, late, take.readout_ms, &mut self.vertices, &mut self.imaged);
            self.hits.begin(self.imaged.iter().flatten(), shift, camera.image_size);
            for (index, (thing, _)) in motion.keys[0].iter().enumerate() {
                let triangles = &studio.thing(*thing).triangles;
                self.hits.add(&self.imaged[index], triangles, (index as u32) << THING_BIT, shift);
            }
            let [columns, rows] = self.hits.area();
            area.add(&columns, &rows);
            let sight = Sight {
                studio,
                lighting,
                things: &motion.keys[0],
                normals: motion.normals(late),
                vertices: &self.vertices,
                eye: camera.centre(),
                pixel: (resolved as f64 / camera.intrinsics.focal[0]) as f32,
            };
            let turn = camera.camera_from_world.rotation.inverse().to_rotation_matrix();
            for row in rows {
                for column in columns.clone() {
                    let Some(hit) = self.hits.triangle(column, row) else { continue };
                    let pixel = row * width + column;
                    let depth = self.hits.depth(column, row).unwrap_or(f32::INFINITY);
                    if depth >= still.depths[pixel] {
                        continue;
                    }
                    let [x, y] = lines.at_shifted(column, row, width, shift);
                    let along = turn * Vector3::new(x, y, 1.0);
                    let colour = sight.colour(hit as u32, &along, depth);
                    let (sum, count) = &mut self.sums[pixel];
                    [0, 1, 2].into_iter().for_each(|it| sum[it] += colour[it]);
                    *count += 1;
                }
            }
        }
        let black = (settings.black_level * STEPS) as f32;
        let scale = white * STEPS as f32;
        for row in area.rows.clone() {
            for column in area.columns.clone() {
                let pixel = row * width + column;
                let (sum, count) = std::mem::take(&mut self.sums[pixel]);
                if count == 0 {
                    continue;
                }
                let share = 1.0 / n_moments as f32;
                let covered = f32::from(count) * share;
                let gray = GRAY[0] * sum[0] + GRAY[1] * sum[1] + GRAY[2] * sum[2];
                let lights = if planes.len() == 1 { [gray; 3] } else { sum };
                for (plane, light) in planes.iter_mut().zip(lights) {
                    let behind = f32::from(plane[pixel]) * (1.0 - covered);
                    plane[pixel] = (behind + light * share * scale + black * covered).round() as i16; // `as` saturates
                }
            }
        }
        changed.add(&area.columns, &area.rows);
    }
}

type PosedAt<'p> = dyn Fn(Time) -> Vec<(usize, Arc<Posed>)> + 'p;

/// People over an exposure, with a rolling shutter from the first row's to the last one's.
struct Motion {
    /// When they are posed, from the capture on.
    times: Vec<Interval>,
    /// By time, then by thing that is there.
    keys: Vec<Vec<(usize, Arc<Posed>)>>,
}

impl Motion {
    fn new(take: &Take<'_>, settings: &CameraSettings, posed: &PosedAt<'_>) -> Self {
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
    fn image(
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
    fn normals(&self, late: Interval) -> Vec<&[Vector3<f32>]> {
        let (key, share) = self.between(late.as_s());
        let key = if share < 0.5 { key } else { key + 1 };
        self.keys[key].iter().map(|it| it.1.normals.as_slice()).collect()
    }
}

/// What a camera makes of a point, with what is the same for all of them worked out.
pub(super) struct Projector<'c> {
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

/// What a pixel's line of sight meets at one moment.
struct Sight<'a> {
    studio: &'a Studio,
    lighting: &'a Lighting,
    things: &'a [(usize, Arc<Posed>)],
    normals: Vec<&'a [Vector3<f32>]>,
    vertices: &'a [Vec<Point3<f64>>],
    eye: Point3<f64>,
    /// What is resolved at a depth of 1 [m].
    pixel: f32,
}

impl Sight<'_> {
    /// The light that comes from there [gray level of gain 1].
    #[inline]
    fn colour(&self, hit: u32, along: &Vector3<f64>, depth: f32) -> Colour {
        let (index, number) = ((hit >> THING_BIT) as usize, (hit & ((1 << THING_BIT) - 1)) as usize);
        let thing = self.studio.thing(self.things[index].0);
        let triangle = &thing.triangles[number];
        let facet = Facet::of(triangle, &self.vertices[index]);
        let point = self.eye + along * facet.depth(&self.eye, along);
        let weights = facet.weights(&point).map(|it| it as f32);
        let lit = &self.lighting.lit[index];
        let (mut light, mut main, mut normal) = ([0.0_f32; 3], 0.0, Vector3::zeros());
        let (mut u, mut v) = (0.0, 0.0);
        for ((corner, weight), texel) in triangle.corners.into_iter().zip(weights).zip(triangle.texels) {
            let of = &lit[corner as usize];
            [0, 1, 2].into_iter().for_each(|it| light[it] += of.light[it] * weight);
            main += of.main * weight;
            normal += self.normals[index][corner as usize] * weight;
            u += texel[0] * weight;
            v += texel[1] * weight;
        }
        let patch = thing.patch(number);
        let albedo = patch.colour([u, v], self.pixel * depth);
        let mut colour = [0, 1, 2].map(|it| albedo[it] * light[it].max(0.0));
        let [mirrors, sharpness] = patch.gloss;
        if mirrors > 0.0
            && main > 0.0
            && let Some(lamp) = self.studio.main_lamp
        {
            let lamp = &self.studio.lamps[lamp];
            let (to_lamp, to_eye) = ((lamp.position - point).cast::<f32>(), (self.eye - point).cast::<f32>());
            let half_way = (to_lamp.normalize() + to_eye.normalize()).normalize();
            let cosine = normal.dot(&half_way) / normal.norm().max(1e-6);
            if cosine > 0.0 {
                let square = 4.0 / to_lamp.norm_squared().max(1e-4);
                let shine = mirrors * main * square * cosine.powf(sharpness);
                let of_lamp = lamp.colour();
                [0, 1, 2].into_iter().for_each(|it| colour[it] += shine * of_lamp[it]);
            }
        }
        colour
    }
}

/// Columns and rows.
#[derive(Debug, Clone, PartialEq, Default)]
struct Area {
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
}

impl Area {
    /// Takes in others.
    fn add(&mut self, columns: &std::ops::Range<usize>, rows: &std::ops::Range<usize>) {
        if columns.is_empty() || rows.is_empty() {
            return;
        }
        if self.columns.is_empty() {
            *self = Area { columns: columns.clone(), rows: rows.clone() };
            return;
        }
        let with = |a: &std::ops::Range<usize>, b: &std::ops::Range<usize>| a.start.min(b.start)..a.end.max(b.end);
        *self = Area { columns: with(&self.columns, columns), rows: with(&self.rows, rows) };
    }
}

impl Still {
    fn new(
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
        // The last one is for where a pixel's middle looks.
        let hits: Vec<FirstHits> = shifts
            .iter()
            .chain([&[0.0; 2]])
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
                for (shift, hits) in shifts.iter().zip(&hits) {
                    let place = look(column, row, *shift, hits);
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
                let middle = look(column, row, [0.0; 2], &hits[shifts.len()]);
                *seen = (middle.point.cast::<f32>().coords.into(), middle.depth as f32);
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
    fn sum(&mut self, levels: &[f32], settings: &CameraSettings) -> &[Vec<Vec<i16>>; 2] {
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

    /// Takes away the light that people hold up.
    fn shade(&self, lighting: &Lighting, planes: &mut [Vec<i16>], changed: &mut Area) {
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

/// Blurs what has changed, and takes the rest as it is known blurred.
fn blur_within(
    planes: &mut [Vec<i16>],
    [sharp, blurred]: [&Vec<Vec<i16>>; 2],
    size: [u32; 2],
    changed: Area,
    sigma: f64,
) {
    let [width, height] = size.map(|it| it as usize);
    let reach = weights(sigma).len() - 1;
    let wider = |it: &std::ops::Range<usize>, end: usize| it.start.saturating_sub(reach)..(it.end + reach).min(end);
    let area = Area { columns: wider(&changed.columns, width), rows: wider(&changed.rows, height) };
    for ((plane, sharp), blurred) in planes.iter_mut().zip(sharp).zip(blurred) {
        if changed.columns.is_empty() {
            plane.copy_from_slice(blurred);
            continue;
        }
        let mut result = blurred.clone();
        blur(plane, &mut result, width, &area, sigma);
        debug_assert_eq!(plane.len(), sharp.len());
        std::mem::swap(plane, &mut result);
    }
}

/// Weights of a normal distribution on one side, the middle first; integrated over each pixel's width by its middle.
fn weights(sigma: f64) -> Vec<f32> {
    if sigma <= 0.0 {
        return vec![1.0];
    }
    let reach = (3.0 * sigma).ceil() as usize;
    let raw: Vec<f64> = (0..=reach).map(|it| (-0.5 * (it as f64 / sigma).powi(2)).exp()).collect();
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    raw.iter().map(|it| (it / sum) as f32).collect()
}

/// Blurs an area of `from` into `into`, along rows and then along columns; beyond the picture its rim goes on.
fn blur(from: &[i16], into: &mut [i16], width: usize, area: &Area, sigma: f64) {
    let height = from.len() / width;
    let weights = weights(sigma);
    let reach = weights.len() - 1;
    let rows = area.rows.start.saturating_sub(reach)..(area.rows.end + reach).min(height);
    let n = area.columns.len();
    let mut along = vec![0.0_f32; n * rows.len()];
    let mut padded = vec![0.0_f32; n + 2 * reach];
    for (row, along) in rows.clone().zip(along.chunks_exact_mut(n)) {
        let pixels = &from[row * width..][..width];
        for (place, padded) in padded.iter_mut().enumerate() {
            let column = (area.columns.start + place).saturating_sub(reach).min(width - 1);
            *padded = f32::from(pixels[column]);
        }
        if area.columns.start < reach {
            // `saturating_sub` repeats the rim from where it is reached.
            for place in 0..reach - area.columns.start {
                padded[place] = f32::from(pixels[0]);
            }
        }
        along.iter_mut().zip(&padded[reach..]).for_each(|(sum, it)| *sum = it * weights[0]);
        for (off, weight) in weights.iter().enumerate().skip(1) {
            let sides = padded[reach - off..].iter().zip(&padded[reach + off..]);
            along.iter_mut().zip(sides).for_each(|(sum, (left, right))| *sum += (left + right) * weight);
        }
    }
    let mut sums = vec![0.0_f32; n];
    for row in area.rows.clone() {
        let at = |row: usize| &along[(row.clamp(rows.start, rows.end - 1) - rows.start) * n..][..n];
        sums.iter_mut().zip(at(row)).for_each(|(sum, it)| *sum = it * weights[0]);
        for (off, weight) in weights.iter().enumerate().skip(1) {
            let sides = at(row.saturating_sub(off)).iter().zip(at(row + off));
            sums.iter_mut().zip(sides).for_each(|(sum, (above, below))| *sum += (above + below) * weight);
        }
        let into = &mut into[row * width + area.columns.start..][..n];
        into.iter_mut().zip(&sums).for_each(|(it, sum)| *it = (sum + 0.5).floor() as i16);
    }
}
