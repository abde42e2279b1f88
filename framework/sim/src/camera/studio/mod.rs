//! People in clothes and the room around them as a camera sees them, in colour.
//!
//! The static scene is rendered once for a static camera: by how much each lamp lights each pixel. For each picture the light of the lamps is summed, the part that people block is taken
//! away, and people are drawn over it, at several moments of the exposure, each with its own small shift within the pixel, every pixel where its true line of sight meets the surface. At last
//! the lens blurs what has changed.

mod blur;
mod motion;
mod still;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use foveate_messages::{Interval, Time};
use nalgebra::{Point3, Vector3};

use blur::{Area, blur_within};
pub(super) use motion::Projector;
use motion::{Motion, PosedAt};
use still::Still;

use super::surface::shift;
use super::{CameraSettings, STEPS};
use crate::projector::Beam;
use crate::sight::{Facet, FirstHits, Lines};
use crate::studio::{Colour, Lighting, Posed, Studio};
use crate::truth::TrueCamera;
use crate::world::World;

/// Edge of the square tiles in which shadows are searched [px].
const TILE: usize = 8;
/// Samples along each side of a pixel of what stands still, for a camera that stands still, and for one that moves: odd, so that one is in its middle.
const SAMPLES: [usize; 2] = [3, 1];
/// Shares of red, green and blue in gray (Rec. ITU-R BT.601).
const GRAY: Colour = [0.299, 0.587, 0.114];
/// Things in a picture's first hits are counted from the bits above these.
pub(super) const THING_BIT: u32 = 22;
/// Of what is sharper than a pixel, so much is left in each of its samples [–].
const RESOLVED: f32 = 0.7;

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
    /// Of a projector that lights the arm.
    pub beam: Option<&'t Beam>,
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
            let [_, blurred] = still.sum(&lighting.levels, settings);
            blur_within(planes, blurred, camera.image_size, &changed, settings.blur_px);
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
                beam: take.beam.map(|it| (it, it.projection().shows(take.capture + late))),
                beam_gain: (1.0 / settings.room_light.max(1e-6)) as f32,
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

/// What a pixel's line of sight meets at one moment.
struct Sight<'a> {
    studio: &'a Studio,
    lighting: &'a Lighting,
    things: &'a [(usize, Arc<Posed>)],
    normals: Vec<&'a [Vector3<f32>]>,
    vertices: &'a [Vec<Point3<f64>>],
    /// A projector and which picture it shows.
    beam: Option<(&'a Beam, Option<usize>)>,
    /// By how much its light is to be larger, since the room's is scaled later.
    beam_gain: f32,
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
        let exact = facet.weights(&point);
        let weights = exact.map(|it| it as f32);
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
        if let Some((beam, shown)) = self.beam
            && self.studio.arm() == Some(self.things[index].0)
            && let Some(lit) = beam.at(&point, triangle.corners, exact, &normal.cast().normalize())
        {
            let share = match shown {
                Some(picture) => beam.projection().profile(picture).at(lit.at, lit.level),
                None => beam.projection().black(),
            };
            light.iter_mut().for_each(|it| *it += lit.white * share * self.beam_gain);
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
                let shine = mirrors * main * square * cosine.powi(sharpness as i32);
                let of_lamp = lamp.colour();
                [0, 1, 2].into_iter().for_each(|it| colour[it] += shine * of_lamp[it]);
            }
        }
        colour
    }
}
