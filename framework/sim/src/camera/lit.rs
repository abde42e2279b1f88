//! A surface as a camera sees it in the light of a projector: what each pixel sees is found out exactly, and again only when camera or surface have moved, so that
//! the pictures of a set of patterns cost little more than looking up what the projector shows where.
//!
//! As with [`super::surface`], each moment of the exposure has its own small shift within the pixel.

use std::sync::Arc;

use nalgebra::{Isometry3, Vector3};
use wide::i32x4;

use super::STEPS;
use super::surface::View;
use super::triangles::LANES;
use crate::painted::{Part, Skin};
use crate::projector::Beam;
use crate::sight::{Facet, FirstHits, imaged};
use crate::truth::TrueCamera;

/// What a pixel sees at the moments of an exposure.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    /// Where in the projector it is lit from [px], and how blurred that is there.
    at: [[f32; 2]; LANES],
    level: [f32; LANES],
    /// Light that it throws back of a projector's white, and of the room [gray level].
    direct: [f32; LANES],
    room: [f32; LANES],
    /// How many moments see the surface.
    n_seen: u8,
}

/// Lines of sight of a camera's pixels, in its own space, at a depth of 1.
struct Lines {
    optics: TrueCamera,
    at: Vec<[f32; 2]>,
}

/// Draws a surface in a projector's light; keeps what it needs from field to field.
#[derive(Default)]
pub(super) struct LitSurface {
    lines: Option<Lines>,
    /// What it was worked out for.
    views: Vec<(TrueCamera, Arc<Skin>)>,
    area: [std::ops::Range<usize>; 2],
    seen: Vec<Seen>,
    hits: FirstHits,
}

impl LitSurface {
    /// Lays the mean of the moments over `canvas`. `white` is the room's light on a white surface that faces it, `gain` the camera's; `shown` says what the
    /// projector shows at each moment.
    pub fn draw(
        &mut self,
        part: &Part,
        views: &[View],
        beam: Option<(&mut Beam, &[Option<usize>])>,
        [white, gain, black_level]: [f64; 3],
        canvas: &mut [i16],
    ) {
        let Some(middle) = views.get(views.len() / 2) else { return };
        let (mut beam, shown) = beam.map_or((None, &[][..]), |(beam, shown)| (Some(beam), shown));
        if let Some(beam) = &mut beam {
            beam.light(part, &middle.skin);
        }
        let is_known = self.views.len() == views.len()
            && self.views.iter().zip(views).all(|(old, new)| Arc::ptr_eq(&old.1, &new.skin) && old.0 == new.camera);
        if !is_known {
            self.look(part, views, beam.as_deref());
            self.views = views.iter().map(|it| (it.camera.clone(), Arc::clone(&it.skin))).collect();
        }
        let width = middle.camera.image_size[0] as usize;
        let n = views.len() as f32;
        let (white, gain, black) = (white as f32, gain as f32, black_level as f32);
        let profiles: Vec<_> = shown.iter().map(|it| it.and_then(|it| Some(beam.as_ref()?.projection().profile(it)))).collect();
        let dark = beam.as_ref().map_or(0.0, |it| it.projection().black());
        let [columns, rows] = &self.area;
        for (row, seen) in rows.clone().zip(self.seen.chunks_exact(columns.len().max(1))) {
            for (pixel, seen) in canvas[row * width..][columns.clone()].iter_mut().zip(seen) {
                if seen.n_seen == 0 {
                    continue;
                }
                let mut light = f32::from(seen.n_seen) * black;
                for lane in 0..views.len() {
                    light += seen.room[lane] * white;
                    let direct = seen.direct[lane];
                    if direct > 0.0 {
                        let share = profiles[lane].map_or(dark, |it| it.at(seen.at[lane], seen.level[lane]));
                        light += direct * gain * share;
                    }
                }
                let behind = f32::from(*pixel) * (1.0 - f32::from(seen.n_seen) / n);
                *pixel = (behind + light * STEPS as f32 / n) as i16; // `as` saturates
            }
        }
    }

    /// Works out what each pixel sees.
    fn look(&mut self, part: &Part, views: &[View], beam: Option<&Beam>) {
        let image_size = views[0].camera.image_size;
        let width = image_size[0] as usize;
        self.know_lines(&views[0].camera);
        let places: Vec<Option<Vec<[f32; 3]>>> = self.places(views);
        // All moments, with a pixel around for their shifts.
        let (mut low, mut high) = ([usize::MAX; 2], [0; 2]);
        for vertex in places.iter().flatten().flatten() {
            for axis in 0..2 {
                let last = f64::from(image_size[axis]);
                low[axis] = low[axis].min((f64::from(vertex[axis]) - 1.0).clamp(0.0, last) as usize);
                high[axis] = high[axis].max((f64::from(vertex[axis]) + 3.0).clamp(0.0, last) as usize);
            }
        }
        self.area = [0, 1].map(|axis| low[axis].min(high[axis])..high[axis]);
        let [columns, rows] = self.area.clone();
        self.seen.clear();
        self.seen.resize(columns.len() * rows.len(), Seen::default());
        let (Some(lines), triangles) = (&self.lines, &part.surface.triangles) else { return };
        let mut facets: Option<(Arc<Skin>, Vec<Facet>)> = None;
        for (lane, (view, places)) in views.iter().zip(&places).enumerate() {
            let Some(places) = places else { continue };
            self.hits.draw(places, triangles, view.shift, image_size);
            let is_of = |it: &(Arc<Skin>, Vec<Facet>)| Arc::ptr_eq(&it.0, &view.skin);
            let (_, facets) = match facets.take().filter(is_of) {
                Some(known) => facets.insert(known),
                None => facets.insert((Arc::clone(&view.skin), Facet::all(triangles, &view.skin.vertices))),
            };
            let eye = view.camera.centre();
            let turn = view.camera.camera_from_world.rotation.inverse().to_rotation_matrix();
            for (row, seen) in rows.clone().zip(self.seen.chunks_exact_mut(columns.len().max(1))) {
                for (column, seen) in columns.clone().zip(seen) {
                    let Some(number) = self.hits.triangle(column, row) else { continue };
                    let (triangle, facet) = (&triangles[number], &facets[number]);
                    let [x, y] = lines.at_shifted(column, row, width, view.shift);
                    let along = turn * Vector3::new(x, y, 1.0);
                    let point = eye + along * facet.depth(&eye, &along);
                    let weights = facet.weights(&point);
                    let skin = &view.skin;
                    let mut normal = Vector3::<f64>::zeros();
                    let mut room = 0.0;
                    for (corner, weight) in triangle.corners.into_iter().zip(weights) {
                        normal += skin.normals[corner as usize].cast::<f64>() * weight;
                        room += f64::from(skin.light[corner as usize]) * weight;
                    }
                    let albedo = albedo(part, triangle.texels, weights);
                    seen.n_seen += 1;
                    seen.room[lane] = albedo * room as f32;
                    let lit = beam.and_then(|it| it.at(&point, triangle.corners, weights, &normal.normalize()));
                    if let Some(lit) = lit {
                        (seen.at[lane], seen.level[lane], seen.direct[lane]) = (lit.at, lit.level, albedo * lit.white);
                    }
                }
            }
        }
    }

    /// Where the vertices are imaged at each moment; moments of one camera and one surface share that.
    fn places(&self, views: &[View]) -> Vec<Option<Vec<[f32; 3]>>> {
        let mut places: Vec<Option<Vec<[f32; 3]>>> = Vec::with_capacity(views.len());
        for (number, view) in views.iter().enumerate() {
            let before = number.checked_sub(1).filter(|it| {
                Arc::ptr_eq(&views[*it].skin, &view.skin) && views[*it].camera == view.camera
            });
            places.push(match before {
                Some(before) => places[before].clone(),
                None => imaged(&view.camera, &view.skin),
            });
        }
        places
    }

    fn know_lines(&mut self, camera: &TrueCamera) {
        let optics = camera.standing(Isometry3::identity());
        if self.lines.as_ref().is_some_and(|it| it.optics == optics) {
            return;
        }
        let [width, height] = optics.image_size;
        let places = (0..height).flat_map(|row| (0..width).map(move |column| [column, row].map(f64::from)));
        let at = places.map(|[column, row]| {
            let ray = optics.ray(&nalgebra::Point2::new(column, row));
            // Where a lens has no inverse nothing is seen: a line to the side meets nothing.
            ray.map_or([f32::NAN; 2], |it| [(it.direction.x / it.direction.z) as f32, (it.direction.y / it.direction.z) as f32])
        });
        self.lines = Some(Lines { at: at.collect(), optics });
    }
}

impl Lines {
    /// Of a place that lies `shift` beside the pixel's middle, against the way in which the surface was moved.
    fn at_shifted(&self, column: usize, row: usize, width: usize, shift: [f64; 2]) -> [f64; 2] {
        let height = self.at.len() / width;
        let at = |column: usize, row: usize| self.at[row * width + column].map(f64::from);
        let here = at(column, row);
        let slope = |[ahead, behind]: [[f64; 2]; 2], steps: usize| {
            [0, 1].map(|it| (ahead[it] - behind[it]) / steps.max(1) as f64)
        };
        let (left, right) = (column.saturating_sub(1), (column + 1).min(width - 1));
        let (up, down) = (row.saturating_sub(1), (row + 1).min(height - 1));
        let across = slope([at(right, row), at(left, row)], right - left);
        let along = slope([at(column, down), at(column, up)], down - up);
        [0, 1].map(|it| here[it] - across[it] * shift[0] - along[it] * shift[1])
    }
}

/// The albedo at a point of a triangle.
fn albedo(part: &Part, texels: [[f32; 2]; 3], weights: [f64; 3]) -> f32 {
    let place = [0, 1].map(|axis| {
        let at: f64 = texels.iter().zip(weights).map(|(it, weight)| f64::from(it[axis]) * weight).sum();
        i32x4::splat((at * 65_536.0) as i32)
    });
    part.texture().at(place).to_array()[0]
}
