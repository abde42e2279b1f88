//! Renders the world as a camera sees it: one field, in gray levels.
//!
//! Order of events for one field, after the background, which is rendered once where the camera stands still:
//! monitors → people, dark against the room and in front of all else → LEDs that no person hides, at several moments of the
//! exposure, and their images in floor and display → glints → noise → rounding and saturation.
//!
//! Light is summed in fixed point, 64 steps to a gray level, so that the passes over the whole image are plain 16-bit
//! arithmetic; 512 gray levels is as bright as it gets before saturation at 255 anyway.

mod backdrop;
mod board;
mod lights;
mod lit;
mod noise;
mod people;
mod sensor;
mod silhouette;
mod spot;
mod studio;
mod surface;
mod triangles;
mod wall;

use foveate_estimation::random::Random;
use foveate_messages::{CameraId, Image, Interval, PixelFormat, Time};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::bump::BumpSettings;
use crate::head::HeadMotion;
use crate::projector::{Beam, Projection};
use crate::rounding::rounded;
use crate::timing::TimingSettings;
use crate::truth::TrueCamera;
use crate::world::{Moment, World};
use backdrop::{Backdrop, MovingBackdrop};
pub use board::BoardSettings;
use lit::LitSurface;
use noise::Noise;
pub(crate) use people::PeopleView;
use sensor::Sensor;
pub use sensor::{SensorSettings, field_of};
use silhouette::{Instead, Silhouettes};
use spot::Spot;
use studio::{StudioView, Take};
use surface::{Surfaces, View};
pub use wall::{WallCameraSettings, WallFormat, WallRenderer};

/// Steps of a gray level in the sums.
const STEPS: f64 = 64.0;

/// Width of a halo relative to the spot's.
const HALO_WIDTH: f64 = 6.0;

/// A painted face is drawn where a metre of it takes up more than this; smaller ones are shapes as the rest of the body [px].
const SEEN_FROM_PX_M: f64 = 250.0;
/// A painted face is drawn at least this often in each exposure: that makes its edges smooth.
const LEAST_FACE_MOMENTS: u32 = 4;
/// Between such steps of a rolling shutter skin and camera go straight ahead [ms].
const ROWS_MS: f64 = 4.0;
/// A surface in a projector's light is drawn at so many moments of each exposure.
const LIT_MOMENTS: u32 = 4;

/// When a camera looks, and how it turns light into pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CameraSettings {
    /// Capture times, clock and delivery of its fields.
    #[serde(flatten)]
    pub timing: TimingSettings,
    /// Exposure time; what moves is smeared [ms].
    #[schemars(range(min = 0.01, max = 100.0))]
    pub exposure_ms: f64,
    /// Moments of the exposure at which LEDs and a painted face (it at 4 or more) are drawn, each with its share of the light [–].
    #[schemars(range(min = 1, max = 32))]
    pub blur_samples: u32,
    /// Iris and amplifier: multiplies all light [–].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub gain: f64,
    /// Black level: gray level of a pixel without light [gray level].
    #[schemars(range(min = 0.0, max = 128.0))]
    pub black_level: f64,
    /// Light of the room relative to that of the LEDs: below 1 the lab is dimmed [–].
    #[schemars(range(min = 0.0, max = 4.0))]
    pub room_light: f64,
    /// Standard deviation of a LED's spot along a row; along a column divided by the pixels' aspect [px].
    #[schemars(range(min = 0.3, max = 20.0))]
    pub spot_sigma_px: f64,
    /// Height of the halo around a LED, six times as wide as its spot, relative to the spot: very bright LEDs bloom [–].
    #[schemars(range(min = 0.0, max = 0.5))]
    pub bloom: f64,
    /// Standard deviation of the noise, drawn for each pixel and field [gray level].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub noise_sigma: f64,
    /// Resolution of the digitiser: 8 gives 256 gray levels [bit].
    #[schemars(range(min = 1, max = 8))]
    pub bits: u32,
    /// Whether pictures of a `studio` are in colour: red, green, blue. Without a studio all is gray [–].
    pub colour: bool,
    /// Standard deviation of the blur of the lens, in pictures of a `studio` [px].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub blur_px: f64,
    /// Faults of a real lens, a real sensor and real lamps, `{}` for those of an industrial camera. Left out: none [–].
    pub sensor: Option<SensorSettings>,
    /// The camera belongs to a framework that is carried about, and has its place in that framework's own space: the origin of that space while the
    /// framework stands still to be calibrated, with its axes along the world's. Left out: the camera's place is in the world [m].
    pub stand_m: Option<[f64; 3]>,
    /// A dark board before the cameras for a while, in a `studio`. Left out: none [–].
    pub board: Option<BoardSettings>,
    /// A camera that is knocked at some time and stays turned. Left out: none is [–].
    pub bump: Option<BumpSettings>,
}

impl Default for CameraSettings {
    fn default() -> Self {
        Self {
            timing: TimingSettings::default(),
            exposure_ms: 4.0,
            blur_samples: 4,
            gain: 1.0,
            black_level: 12.0,
            room_light: 1.0,
            spot_sigma_px: 1.3,
            bloom: 0.0,
            noise_sigma: 2.0,
            bits: 8,
            colour: false,
            blur_px: 0.5,
            sensor: None,
            stand_m: None,
            board: None,
            bump: None,
        }
    }
}

/// Renders the fields of one camera.
pub struct Renderer {
    camera: TrueCamera,
    centre: Point3<f64>,
    id: CameraId,
    settings: CameraSettings,
    /// Of a camera that stands still; made when it is needed, where it was not made before.
    backdrop: Option<Backdrop>,
    moving_backdrop: MovingBackdrop,
    silhouettes: Silhouettes,
    surfaces: Surfaces,
    lit: LitSurface,
    /// Of a projector, where one is there.
    beam: Option<Beam>,
    noise: Noise,
    sensor: Option<Sensor>,
    canvas: Vec<i16>,
    /// Of a studio: gray levels, or those of each colour [steps].
    planes: Vec<Vec<i16>>,
    studio: StudioView,
    /// One colour of a picture.
    bytes: Vec<u8>,
    /// What each 8-bit value becomes, where the digitiser has fewer bits.
    coarse: Option<[u8; 256]>,
    moment: Moment,
}

impl Renderer {
    /// Gets ready: renders what does not change. `random` is the camera's own.
    pub fn new(
        camera: impl Into<TrueCamera>,
        id: CameraId,
        world: &World,
        settings: &CameraSettings,
        random: &Random,
    ) -> Self {
        let camera = camera.into();
        let backdrop = world.studio().is_none().then(|| Backdrop::new(&camera, world, settings));
        Self { backdrop, ..Self::on_head(camera, id, settings, random) }
    }

    /// For a camera on a head, of which nothing stays the same: see [`Self::render_on`].
    pub fn on_head(camera: impl Into<TrueCamera>, id: CameraId, settings: &CameraSettings, random: &Random) -> Self {
        let camera = camera.into();
        let camera_size = camera.image_size;
        let [width, height] = camera_size.map(|it| it as usize);
        Self {
            centre: camera.centre(),
            camera,
            id,
            settings: settings.clone(),
            backdrop: None,
            moving_backdrop: MovingBackdrop::default(),
            silhouettes: Silhouettes::default(),
            surfaces: Surfaces::default(),
            lit: LitSurface::default(),
            beam: None,
            noise: Noise::new(width, settings.noise_sigma, &random.fork("noise")),
            sensor: settings.sensor.as_ref().map(|sensor| {
                let [black_level, noise_sigma] = [settings.black_level, settings.noise_sigma];
                Sensor::new(sensor, camera_size, [black_level, noise_sigma], &random.fork("sensor"))
            }),
            canvas: vec![0; width * height],
            planes: Vec::new(),
            studio: StudioView::default(),
            bytes: Vec::new(),
            coarse: coarse_levels(settings.bits),
            moment: Moment::default(),
        }
    }

    /// From now on this projector lights the surfaces that are measured, a bust or a painted face, and nothing else.
    pub fn light_with(&mut self, projection: &Projection, world: &World) {
        self.beam = Some(Beam::new(projection, world));
    }

    /// Whether [`Self::light_with`] was called.
    pub fn is_lit(&self) -> bool {
        self.beam.is_some()
    }

    /// Renders field number `frame`, exposed around `capture`, into `image`, whose memory is used again. The same numbers
    /// give the same field of the same world, whatever was rendered before.
    pub fn render(&mut self, world: &World, capture: Time, frame: u64, image: &mut Image) {
        let camera = self.camera.clone();
        if world.studio().is_some() {
            self.render_studio(world, capture, frame, &|_| camera.clone(), None, image);
            return;
        }
        let backdrop = self.backdrop.get_or_insert_with(|| Backdrop::new(&self.camera, world, &self.settings));
        backdrop.draw(world, capture, &mut self.canvas);
        self.draw_people(world, capture, &|_| camera.clone());
        self.draw_lights(world, capture, None);
        self.finish(world, capture, frame, image);
    }

    /// As [`Self::render`] with the camera on a head: `at_rest` turned by `motion`, and turning while it is exposed. LEDs are smeared by
    /// that, and so is a painted face; people and the room are drawn as they are seen in the middle of the exposure.
    pub fn render_on(
        &mut self,
        motion: &HeadMotion,
        at_rest: &TrueCamera,
        world: &World,
        capture: Time,
        frame: u64,
        image: &mut Image,
    ) {
        self.stand(motion.camera_at(at_rest, capture));
        if world.studio().is_some() {
            let camera_at = |moment: Time| motion.camera_at(at_rest, moment);
            self.render_studio(world, capture, frame, &camera_at, Some((motion, at_rest)), image);
            return;
        }
        self.moving_backdrop.draw(&self.camera, world, &self.settings, capture, &mut self.canvas);
        self.draw_people(world, capture, &|moment| motion.camera_at(at_rest, moment));
        self.draw_lights(world, capture, Some((motion, at_rest)));
        self.finish(world, capture, frame, image);
    }

    /// The studio, and lights in it.
    fn render_studio(
        &mut self,
        world: &World,
        capture: Time,
        frame: u64,
        camera_at: &dyn Fn(Time) -> TrueCamera,
        on_head: Option<(&HeadMotion, &TrueCamera)>,
        image: &mut Image,
    ) {
        let Some(studio) = world.studio() else { return };
        let n_pixels = self.canvas.len();
        self.planes.resize(if self.settings.colour { 3 } else { 1 }, Vec::new());
        self.planes.iter_mut().for_each(|it| it.resize(n_pixels, 0));
        let readout_ms = self.sensor.as_ref().and_then(Sensor::readout_ms).unwrap_or(0.0);
        if let (Some(beam), Some((triangles, skin))) = (&mut self.beam, world.shape(capture)) {
            beam.light(triangles, &skin);
        }
        let beam = self.beam.as_ref();
        let take = Take { world, capture, camera_at, is_on_head: on_head.is_some(), readout_ms, beam };
        self.studio.draw(studio, &take, &self.settings, &mut self.planes);
        if let Some(board) = &self.settings.board {
            let dark = (self.settings.black_level * STEPS) as i16;
            self.planes.iter_mut().for_each(|it| board.hide(&self.camera, capture, dark, it));
        }
        for plane in 0..self.planes.len() {
            std::mem::swap(&mut self.canvas, &mut self.planes[plane]);
            self.draw_lights(world, capture, on_head);
            std::mem::swap(&mut self.canvas, &mut self.planes[plane]);
        }
        let mut planes = std::mem::take(&mut self.planes);
        self.finish_planes(world, capture, frame, &mut planes, image);
        self.planes = planes;
    }

    fn stand(&mut self, camera: TrueCamera) {
        self.centre = camera.centre();
        self.camera = camera;
    }

    /// Draws those who are there at `capture`, and the actor's face, if it is large enough to be seen, over all of the exposure, in which the
    /// camera stands as `camera_at` says.
    fn draw_people(&mut self, world: &World, capture: Time, camera_at: &dyn Fn(Time) -> TrueCamera) {
        world.at(capture, &mut self.moment);
        let CameraSettings { room_light, gain, black_level, .. } = self.settings;
        if world.has_bust() {
            let mut canvas = std::mem::take(&mut self.canvas);
            self.draw_shape(world, capture, camera_at, &mut canvas);
            self.canvas = canvas;
            return;
        }
        let cloth_light = 60.0 * room_light * gain;
        let n_moments = self.settings.blur_samples.max(LEAST_FACE_MOMENTS);
        let moments = self.moments(capture, n_moments);
        let readout_ms = self.sensor.as_ref().and_then(Sensor::readout_ms);
        let painted = world.painted_part(capture).zip(self.moment.poses.first());
        let face = painted.and_then(|(part, pose)| {
            let distance = (part.middle(pose) - self.centre).norm();
            let is_large = self.camera.intrinsics.focal[0] / distance > SEEN_FROM_PX_M;
            is_large.then_some((part, distance * distance))
        });
        if self.beam.is_some() && face.is_some() {
            let distance = face.map_or(0.0, |it| it.1);
            let mut behind = std::mem::take(&mut self.canvas);
            let mut silhouettes = std::mem::take(&mut self.silhouettes);
            let (camera, moment) = (self.camera.clone(), std::mem::take(&mut self.moment));
            let mut draw = |canvas: &mut [i16]| self.draw_shape(world, capture, camera_at, canvas);
            if let Some((part, _)) = face {
                let instead = Instead { beside: &|number, body| part.beside(number, body), distance, draw: &mut draw };
                silhouettes.draw(&camera, &moment, cloth_light, black_level, Some(instead), &mut behind);
            }
            (self.canvas, self.silhouettes, self.moment) = (behind, silhouettes, moment);
            return;
        }
        let (surfaces, image_size) = (&mut self.surfaces, self.camera.image_size);
        let Some((part, distance)) = face else {
            self.silhouettes.draw(&self.camera, &self.moment, cloth_light, black_level, None, &mut self.canvas);
            return;
        };
        let mut draw = |canvas: &mut [i16]| {
            // Who is there in the middle of the exposure may not have come in at its start.
            let sight = |moment: Time| world.part(moment).map(|(_, skin)| (camera_at(moment), skin));
            let views: Vec<View> = (0..)
                .zip(moments.clone())
                .filter_map(|(number, (_, moment))| {
                    let (camera, skin) = sight(moment)?;
                    let rows = steps_of_rows(readout_ms).map(|it| sight(moment + it)).collect::<Option<_>>()?;
                    Some(View { camera, skin, shift: surface::shift(number, n_moments), rows })
                })
                .collect();
            surfaces.draw(canvas.len(), part, part.light * room_light * gain, &views);
            surfaces.finish(image_size[0] as usize, n_moments, black_level, canvas);
        };
        let instead = Instead { beside: &|number, body| part.beside(number, body), distance, draw: &mut draw };
        self.silhouettes.draw(&self.camera, &self.moment, cloth_light, black_level, Some(instead), &mut self.canvas);
    }

    /// Draws the bust, or the painted face, in the light of the room and of a projector.
    fn draw_shape(&mut self, world: &World, capture: Time, camera_at: &dyn Fn(Time) -> TrueCamera, canvas: &mut [i16]) {
        let CameraSettings { room_light, gain, black_level, .. } = self.settings;
        let moments: Vec<Time> = self.moments(capture, LIT_MOMENTS).map(|it| it.1).collect();
        let shape = |(number, moment): (u32, &Time)| {
            let (part, skin) = world.part(*moment)?;
            let shift = surface::shift(number, LIT_MOMENTS);
            Some((part, View { camera: camera_at(*moment), skin, shift, rows: Vec::new() }))
        };
        let Some(shapes) = (0..).zip(&moments).map(shape).collect::<Option<Vec<_>>>() else { return };
        let (parts, views): (Vec<_>, Vec<View>) = shapes.into_iter().unzip();
        let Some(part) = parts.first() else { return };
        let shown: Vec<Option<usize>> = match &self.beam {
            Some(beam) => moments.iter().map(|it| beam.projection().shows(*it)).collect(),
            None => Vec::new(),
        };
        let beam = self.beam.as_mut().map(|it| (it, shown.as_slice()));
        self.lit.draw(part, &views, beam, [part.light * room_light * gain, gain, black_level], canvas);
    }

    /// This many moments of the exposure around `capture`, each with its share of the light.
    fn moments(&self, capture: Time, samples: u32) -> impl Iterator<Item = (f64, Time)> + Clone + use<> {
        let exposure_ms = self.settings.exposure_ms;
        (0..samples).map(move |sample| {
            let place = (f64::from(sample) + 0.5) / f64::from(samples) - 0.5;
            (1.0 / f64::from(samples), capture + Interval::from_ms(place * exposure_ms))
        })
    }

    /// Glints, noise, rounding.
    fn finish(&mut self, world: &World, capture: Time, frame: u64, image: &mut Image) {
        let mut planes = [std::mem::take(&mut self.canvas)];
        self.finish_planes(world, capture, frame, &mut planes, image);
        [self.canvas] = planes;
    }

    /// As [`Self::finish`], of gray levels or of red, green and blue.
    fn finish_planes(&mut self, world: &World, capture: Time, frame: u64, planes: &mut [Vec<i16>], image: &mut Image) {
        let [width, height] = self.camera.image_size;
        for glint in world.glints(self.id, capture) {
            let sigma = self.sigmas().map(|it| it * glint.width);
            let centre = [glint.place[0] * f64::from(width) - 0.5, glint.place[1] * f64::from(height) - 0.5];
            let spot = Spot { centre, sigma, peak: glint.peak * self.settings.gain };
            planes.iter_mut().for_each(|it| spot.add_to(it, [width, height]));
        }
        image.camera = self.id;
        image.format = if planes.len() == 1 { PixelFormat::Gray8 } else { PixelFormat::Rgb8 };
        (image.width, image.height) = (width, height);
        let n_pixels = width as usize * height as usize;
        image.pixels.resize(n_pixels * planes.len(), 0);
        let digitise = |channel: usize, plane: &[i16], bytes: &mut [u8]| match &self.sensor {
            Some(sensor) => sensor.digitise(plane, frame, channel as u64, bytes),
            None => self.noise.digitise(plane, width as usize, frame, channel as u64, bytes),
        };
        if let [plane] = planes {
            digitise(0, plane, &mut image.pixels);
        } else {
            let (n, mut bytes) = (planes.len(), std::mem::take(&mut self.bytes));
            bytes.resize(n_pixels, 0);
            for (channel, plane) in planes.iter().enumerate() {
                digitise(channel, plane, &mut bytes);
                image.pixels.chunks_exact_mut(n).zip(&bytes).for_each(|(pixel, byte)| pixel[channel] = *byte);
            }
            self.bytes = bytes;
        }
        if let Some(levels) = &self.coarse {
            image.pixels.iter_mut().for_each(|it| *it = levels[usize::from(*it)]);
        }
        if let Some(sensor) = &self.sensor {
            sensor.pack(&mut image.pixels, image.format);
        }
    }

    /// Standard deviations of a LED's spot along rows and columns [px]: round on the sensor.
    fn sigmas(&self) -> [f64; 2] {
        let [across, down] = self.camera.intrinsics.focal;
        [self.settings.spot_sigma_px, self.settings.spot_sigma_px * down / across]
    }
}

/// Renders a single field; to render many, keep a [`Renderer`].
pub fn render(
    camera: impl Into<TrueCamera>,
    id: CameraId,
    world: &World,
    settings: &CameraSettings,
    capture: Time,
    random: &Random,
) -> Image {
    let mut image = Image::default();
    Renderer::new(camera, id, world, settings, random).render(world, capture, 0, &mut image);
    image
}

/// From a moment of the middle row to those at which skin is looked at for a rolling shutter, from the first row to the last one; none where all rows are exposed at once.
fn steps_of_rows(readout_ms: Option<f64>) -> impl Iterator<Item = Interval> {
    let n = readout_ms.map_or(0, |it| (it / ROWS_MS).ceil() as usize + 1);
    (0..n).map(move |it| Interval::from_ms((it as f64 / (n - 1) as f64 - 0.5) * readout_ms.unwrap_or_default()))
}

/// Rounds 8-bit values to 2^`bits` levels, from 0 to 255; `None` when that changes nothing.
fn coarse_levels(bits: u32) -> Option<[u8; 256]> {
    let top = f64::from((1_u32 << bits.clamp(1, 8)) - 1);
    (bits < 8).then(|| std::array::from_fn(|it| ((it as f64 / 255.0 * top).round() / top * 255.0).round() as u8))
}

/// A gray level in steps, saturating.
#[inline]
fn steps(gray: f64) -> i16 {
    rounded(gray * STEPS).clamp(i16::MIN.into(), i16::MAX.into()) as i16
}

#[cfg(test)]
mod tests;
