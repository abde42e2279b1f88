//! A surface as a camera sees it in the light of a projector: what each pixel sees is computed exactly, and again only when camera or surface have moved, so that
//! the pictures of a set of patterns cost little more than a look-up in the projector's picture.
//!
//! As with [`super::surface`], each moment of the exposure has its own small shift within the pixel.

use std::sync::Arc;

use nalgebra::{Point3, Rotation3, Vector3};
use wide::i32x4;

use super::STEPS;
use super::surface::View;
use super::triangles::LANES;
use crate::painted::{Part, Skin};
use crate::projector::Beam;
use crate::sight::{Facet, FirstHits, Lines, imaged};
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

/// Draws a surface in a projector's light; keeps what it needs from field to field.
#[derive(Default)]
pub(super) struct LitSurface {
    lines: Option<Lines>,
    /// What it was computed for.
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
            beam.light(&part.surface.triangles, &middle.skin);
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
        // Of moments that are not there nothing is seen.
        let profiles: [_; LANES] = std::array::from_fn(|lane| {
            let shown = shown.get(lane).copied().flatten()?;
            Some(beam.as_ref()?.projection().profile(shown))
        });
        let dark = beam.as_ref().map_or(0.0, |it| it.projection().black());
        let [columns, rows] = &self.area;
        for (row, seen) in rows.clone().zip(self.seen.chunks_exact(columns.len().max(1))) {
            for (pixel, seen) in canvas[row * width..][columns.clone()].iter_mut().zip(seen) {
                if seen.n_seen == 0 {
                    continue;
                }
                let mut light = f32::from(seen.n_seen) * black;
                for (lane, profile) in profiles.iter().enumerate() {
                    light += seen.room[lane] * white;
                    let direct = seen.direct[lane];
                    if direct > 0.0 {
                        let share = profile.map_or(dark, |it| it.at(seen.at[lane], seen.level[lane]));
                        light += direct * gain * share;
                    }
                }
                let behind = f32::from(*pixel) * (1.0 - f32::from(seen.n_seen) / n);
                *pixel = (behind + light * STEPS as f32 / n) as i16; // `as` saturates
            }
        }
    }

    /// Computes what each pixel sees.
    fn look(&mut self, part: &Part, views: &[View], beam: Option<&Beam>) {
        let image_size = views[0].camera.image_size;
        let width = image_size[0] as usize;
        Lines::know(&mut self.lines, &views[0].camera);
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
            let sight = Sight {
                lane,
                view,
                part,
                facets,
                hits: &self.hits,
                lines,
                beam,
                eye: view.camera.centre(),
                turn: view.camera.camera_from_world.rotation.inverse().to_rotation_matrix(),
            };
            // Rows are dealt out to all cores; each is the same whoever looks.
            let n_threads = std::thread::available_parallelism().map_or(1, usize::from).min(rows.len().max(1));
            let per_thread = rows.len().div_ceil(n_threads).max(1);
            let wide = columns.len().max(1);
            std::thread::scope(|scope| {
                for (share, seen) in self.seen.chunks_mut(wide * per_thread).enumerate() {
                    let (sight, columns, first) = (&sight, columns.clone(), rows.start + share * per_thread);
                    scope.spawn(move || {
                        for (row, seen) in (first..).zip(seen.chunks_exact_mut(wide)) {
                            columns.clone().zip(seen).for_each(|(column, seen)| sight.see(column, row, width, seen));
                        }
                    });
                }
            });
        }
    }

    /// Where the vertices are imaged at each moment; moments of one camera and one surface share that.
    fn places(&self, views: &[View]) -> Vec<Option<Vec<[f32; 3]>>> {
        let mut places: Vec<Option<Vec<[f32; 3]>>> = Vec::with_capacity(views.len());
        for (number, view) in views.iter().enumerate() {
            let before = number
                .checked_sub(1)
                .filter(|it| Arc::ptr_eq(&views[*it].skin, &view.skin) && views[*it].camera == view.camera);
            places.push(match before {
                Some(before) => places[before].clone(),
                None => imaged(&view.camera, &view.skin),
            });
        }
        places
    }
}

/// Inputs of one moment.
struct Sight<'a> {
    lane: usize,
    view: &'a View,
    part: &'a Part,
    facets: &'a [Facet],
    hits: &'a FirstHits,
    lines: &'a Lines,
    beam: Option<&'a Beam>,
    eye: Point3<f64>,
    turn: Rotation3<f64>,
}

impl Sight<'_> {
    /// Adds what a pixel sees at this moment.
    fn see(&self, column: usize, row: usize, width: usize, seen: &mut Seen) {
        let Some(number) = self.hits.triangle(column, row) else { return };
        let (triangle, facet) = (&self.part.surface.triangles[number], &self.facets[number]);
        let [x, y] = self.lines.at_shifted(column, row, width, self.view.shift);
        let along = self.turn * Vector3::new(x, y, 1.0);
        let point = self.eye + along * facet.depth(&self.eye, &along);
        let weights = facet.weights(&point);
        let skin = &self.view.skin;
        let mut normal = Vector3::<f64>::zeros();
        let mut room = 0.0;
        for (corner, weight) in triangle.corners.into_iter().zip(weights) {
            normal += skin.normals[corner as usize].cast::<f64>() * weight;
            room += f64::from(skin.light[corner as usize]) * weight;
        }
        let albedo = albedo(self.part, triangle.texels, weights);
        seen.n_seen += 1;
        seen.room[self.lane] = albedo * room as f32;
        let lit = self.beam.and_then(|it| it.at(&point, triangle.corners, weights, &normal.normalize()));
        if let Some(lit) = lit {
            let lane = self.lane;
            (seen.at[lane], seen.level[lane], seen.direct[lane]) = (lit.at, lit.level, albedo * lit.white);
        }
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

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use foveate_geometry::{Camera, Ray};
    use foveate_imaging::stripes::{Axis, Shown};
    use foveate_messages::{CameraId, Image, Time};
    use nalgebra::{Point2, Point3};

    use crate::camera::{CameraSettings, Renderer};
    use crate::painted::{Part, Skin};
    use crate::projector::{PatternCode, Projection, ProjectorSettings};
    use crate::timing::TimingSettings;
    use crate::world::{BustSettings, SceneSettings, World};

    const SIZE: [u32; 2] = [320, 240];

    fn world(speed_m_s: f64) -> World {
        let bust = BustSettings { speed_m_s, light_m: None, ..BustSettings::default() };
        let clutter =
            SceneSettings { people: 0, bright_spots: 0, monitors: 0, glints_hz: 0.0, ..SceneSettings::default() };
        World::new(SceneSettings { bust: Some(bust), ..clutter }, &Random::new(3))
    }

    fn camera() -> Camera {
        Camera::look_at([-0.7, 2.9, 1.7].into(), [0.0, 0.0, 1.5].into(), SIZE, 2900.0)
    }

    fn projector(place: [f64; 3]) -> Camera {
        let mut camera = Camera::look_at(place.into(), [0.0, 0.0, 1.5].into(), [512, 384], 1300.0);
        camera.distortion.k1 = 0.05;
        camera
    }

    fn projection(place: [f64; 3]) -> Projection {
        let settings = ProjectorSettings {
            code: PatternCode::Gray,
            order: "white black columns".to_owned(),
            light: 900.0,
            aperture_mm: 2.0,
            ..ProjectorSettings::default()
        };
        Projection::new("projector", CameraId(1), &projector(place), &settings, &Random::new(4)).unwrap()
    }

    /// The picture that shows pattern `index` of the first set.
    fn picture(renderer: &mut Renderer, world: &World, projection: &Projection, index: usize) -> Image {
        let commanded = projection.command(index as u64).from;
        let time = Time(commanded.0 + 38_000_000);
        let mut image = Image::default();
        renderer.render(world, time, index as u64, &mut image);
        image
    }

    fn renderer(world: &World, projection: &Projection) -> Renderer {
        let settings = CameraSettings {
            timing: TimingSettings::default(),
            room_light: 0.05,
            noise_sigma: 0.0,
            exposure_ms: 4.0,
            ..CameraSettings::default()
        };
        let mut renderer = Renderer::new(&camera(), CameraId(0), world, &settings, &Random::new(2));
        renderer.light_with(projection, world);
        renderer
    }

    /// The first triangle along a ray from outside, and how far away, by the book (Möller and Trumbore, with both sides).
    fn first(part: &Part, skin: &Skin, from: &Point3<f64>, along: &nalgebra::Vector3<f64>) -> Option<(usize, f64)> {
        let met = part.surface.triangles.iter().enumerate().filter_map(|(number, triangle)| {
            let [a, b, c] = triangle.corners.map(|it| skin.vertices[it as usize]);
            let (ab, ac) = (b - a, c - a);
            let p = along.cross(&ac);
            let determinant = ab.dot(&p);
            let to = from - a;
            let u = to.dot(&p) / determinant;
            let q = to.cross(&ab);
            let v = along.dot(&q) / determinant;
            let depth = ac.dot(&q) / determinant;
            (u >= 0.0 && v >= 0.0 && u + v <= 1.0 && depth > 1e-6).then_some((number, depth))
        });
        met.min_by(|a, b| a.1.total_cmp(&b.1))
    }

    #[test]
    fn each_pixel_shows_the_bit_of_the_projector_column_that_lights_it_and_shadows_show_none() {
        let place = [1.0, 2.2, 1.9];
        let (world, projection) = (world(0.0), projection(place));
        let mut renderer = renderer(&world, &projection);
        let n_bits = 9;
        let pictures: Vec<Image> =
            (0..projection.pictures().len()).map(|it| picture(&mut renderer, &world, &projection, it)).collect();
        let at = |shown: Shown| &pictures[projection.pictures().iter().position(|it| *it == shown).unwrap()];
        let (part, skin) = world.part(Time::ZERO).unwrap();
        let (camera, projector) = (camera(), projector(place));
        let (mut n_bits_seen, mut n_bits_wrong, mut n_shadows, mut n_shadows_wrong) = (0, 0, 0, 0);
        for (column, row) in (0..SIZE[1]).step_by(4).flat_map(|row| (0..SIZE[0]).step_by(4).map(move |it| (it, row))) {
            let ray: Ray = camera.ray(&Point2::new(f64::from(column), f64::from(row))).unwrap();
            let Some((_, depth)) = first(part, &skin, &ray.origin, &ray.direction) else { continue };
            let point = ray.at(depth);
            let pixel = row as usize * SIZE[0] as usize + column as usize;
            let gray = |shown: Shown| f64::from(at(shown).pixels[pixel]);
            let contrast = gray(Shown::White) - gray(Shown::Black);
            let to_light = projector.centre() - point;
            let blocked = first(part, &skin, &point, &to_light.normalize()).filter(|it| it.1 > 8e-3);
            // Beside a shadow's edge pixels are lit in part.
            let around = |off: [i32; 2]| {
                let near = Point2::new(f64::from(column as i32 + off[0]), f64::from(row as i32 + off[1]));
                let ray = camera.ray(&near).unwrap();
                let Some((_, depth)) = first(part, &skin, &ray.origin, &ray.direction) else { return false };
                let near = ray.at(depth);
                let shadow = first(part, &skin, &near, &(projector.centre() - near).normalize());
                (near - point).norm() < 0.01 && shadow.filter(|it| it.1 > 8e-3).is_some() == blocked.is_some()
            };
            if ![[3, 0], [-3, 0], [0, 3], [0, -3]].into_iter().all(around) {
                continue;
            }
            if blocked.is_some() {
                n_shadows += 1;
                n_shadows_wrong += i32::from(contrast > 3.0);
                continue;
            }
            let lit = projector.project(&point).unwrap();
            if contrast < 24.0 || !projector.has_pixel(&lit) {
                continue;
            }
            for plane in 0..n_bits {
                // The reflected binary code by its definition: bit k of the stripe's number, xor the one above.
                let stripe = (lit.x + 0.5).floor() as u32;
                let width = 1 << (n_bits - 1 - plane);
                let expected = (stripe / width % 2) ^ (stripe / width / 2 % 2) == 1;
                // Where in the period of the bit's pattern it lies; boundaries stand at odd multiples of half a stripe of it.
                let phase = ((lit.x + 0.5) / f64::from(width) + 1.0).rem_euclid(2.0);
                let from_edge = (phase.min(2.0 - phase)).min(f64::INFINITY) * f64::from(width);
                if from_edge < 1.5 {
                    continue;
                }
                let bit = |inverse: bool| gray(Shown::Bit { axis: Axis::Columns, plane, inverse });
                n_bits_seen += 1;
                n_bits_wrong += i32::from((bit(false) > bit(true)) != expected);
            }
        }
        println!("{n_bits_wrong} of {n_bits_seen} bits, {n_shadows_wrong} of {n_shadows} shadows");
        assert!(n_bits_seen > 4000 && n_bits_wrong == 0, "{n_bits_wrong} of {n_bits_seen} bits");
        assert!(n_shadows > 20 && n_shadows_wrong * 50 <= n_shadows, "{n_shadows_wrong} of {n_shadows} shadows");
    }

    #[test]
    fn light_falls_off_with_the_square_of_the_distance() {
        let world = world(0.0);
        let mean = |place: [f64; 3]| {
            let projection = projection(place);
            let mut renderer = renderer(&world, &projection);
            let [white, black] = [0, 1].map(|it| picture(&mut renderer, &world, &projection, it));
            // The middle of the forehead.
            let forehead = camera().project(&Point3::new(0.0, 0.09, 1.545)).unwrap();
            let near = |image: &Image| {
                let pixels = (-3..=3).flat_map(|dy| (-3..=3).map(move |dx| (dx, dy)));
                let at = |(dx, dy): (i32, i32)| {
                    (forehead.y as i32 + dy) as usize * SIZE[0] as usize + (forehead.x as i32 + dx) as usize
                };
                pixels.map(|it| f64::from(image.pixels[at(it)])).sum::<f64>() / 49.0
            };
            near(&white) - near(&black)
        };
        // Along one line from the bust, so that the angle stays.
        let [near, far] = [2.0, 3.0].map(|away| mean([0.3 * away, 0.95 * away, 1.5 + 0.05 * away]));
        assert!((near / far / 2.25 - 1.0).abs() < 0.12, "{near} {far}");
    }

    #[test]
    fn a_field_depends_on_its_time_alone_even_while_the_surface_moves() {
        let place = [1.0, 2.2, 1.9];
        let (world, projection) = (world(0.2), projection(place));
        let fields = |order: &[usize]| -> Vec<(usize, Image)> {
            let mut renderer = renderer(&world, &projection);
            order.iter().map(|it| (*it, picture(&mut renderer, &world, &projection, *it))).collect()
        };
        let (forth, mut back) = (fields(&[0, 1, 2, 9]), fields(&[9, 0, 2, 1]));
        back.sort_by_key(|it| it.0);
        assert!(forth == back);
    }
}
