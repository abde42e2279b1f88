//! What a camera makes of the world: one field, in gray levels.
//!
//! Order of events for one field, after a static background that is rendered once:
//! monitors → people, dark against the room and in front of all else → LEDs that nobody hides, at several moments of the
//! exposure → glints → noise → rounding and saturation.
//!
//! Light is summed in fixed point, 64 steps to a gray level, so that the passes over the whole image are plain 16-bit
//! arithmetic; 512 gray levels is as bright as it gets before saturation at 255 anyway.

mod backdrop;
mod noise;
mod silhouette;
mod spot;

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Image, Interval, PixelFormat, Time};
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::world::{Moment, REFERENCE_DISTANCE_M, World};
use backdrop::Backdrop;
use noise::Noise;
use silhouette::Silhouettes;
use spot::Spot;

/// Steps of a gray level in the sums.
const STEPS: f64 = 64.0;

/// How a camera turns light into pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct Sensor {
    /// How long light is gathered; what moves is smeared [ms].
    #[schemars(range(min = 0.01, max = 100.0))]
    pub exposure_ms: f64,
    /// Moments of the exposure at which LEDs are drawn, each with its share of the light [–].
    #[schemars(range(min = 1, max = 32))]
    pub blur_samples: u32,
    /// Iris and amplifier: multiplies all light [–].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub gain: f64,
    /// What a pixel without light reads [gray level].
    #[schemars(range(min = 0.0, max = 128.0))]
    pub black_level: f64,
    /// Light of the room relative to that of the LEDs: below 1 the lab is dimmed [–].
    #[schemars(range(min = 0.0, max = 4.0))]
    pub room_light: f64,
    /// Standard deviation of a LED's spot along a row; along a column it is that divided by the pixels' aspect [px].
    #[schemars(range(min = 0.3, max = 20.0))]
    pub spot_sigma_px: f64,
    /// Standard deviation of the noise, drawn anew for each pixel and field [gray level].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub noise_sigma: f64,
    /// Resolution of the digitiser: 8 gives 256 gray levels [bit].
    #[schemars(range(min = 1, max = 8))]
    pub bits: u32,
}

impl Default for Sensor {
    fn default() -> Self {
        Self {
            exposure_ms: 4.0,
            blur_samples: 4,
            gain: 1.0,
            black_level: 12.0,
            room_light: 1.0,
            spot_sigma_px: 1.3,
            noise_sigma: 2.0,
            bits: 8,
        }
    }
}

/// Renders the fields of one camera.
pub struct Renderer {
    camera: Camera,
    centre: Point3<f64>,
    id: CameraId,
    sensor: Sensor,
    backdrop: Backdrop,
    silhouettes: Silhouettes,
    noise: Noise,
    canvas: Vec<i16>,
    /// What each 8-bit value becomes, where the digitiser has fewer bits.
    coarse: Option<[u8; 256]>,
    moment: Moment,
}

impl Renderer {
    /// Gets ready: renders what does not change. `random` is the camera's own.
    pub fn new(camera: &Camera, id: CameraId, world: &World, sensor: &Sensor, random: &Random) -> Self {
        let [width, height] = camera.image_size.map(|it| it as usize);
        Self {
            camera: camera.clone(),
            centre: camera.centre(),
            id,
            sensor: sensor.clone(),
            backdrop: Backdrop::new(camera, world, sensor),
            silhouettes: Silhouettes::default(),
            noise: Noise::new(width, sensor.noise_sigma, &random.fork("noise")),
            canvas: vec![0; width * height],
            coarse: coarse_levels(sensor.bits),
            moment: Moment::default(),
        }
    }

    /// Renders field number `frame`, exposed around `capture`, into `image`, whose memory is used again. The same numbers
    /// give the same field, whatever was rendered before.
    pub fn render(&mut self, world: &World, capture: Time, frame: u64, image: &mut Image) {
        let [width, height] = self.camera.image_size;
        image.camera = self.id;
        (image.width, image.height, image.format) = (width, height, PixelFormat::Gray8);
        image.pixels.resize(width as usize * height as usize, 0);

        self.backdrop.draw(world, capture, &mut self.canvas);
        world.at(capture, &mut self.moment);
        let cloth_light = 60.0 * self.sensor.room_light * self.sensor.gain;
        let black_level = self.sensor.black_level;
        self.silhouettes.draw(&self.camera, &self.moment, cloth_light, black_level, &mut self.canvas);
        self.draw_leds(world, capture);
        for glint in world.glints(self.id, capture) {
            let sigma = self.sigmas().map(|it| it * glint.width);
            let centre = [glint.place[0] * f64::from(width) - 0.5, glint.place[1] * f64::from(height) - 0.5];
            Spot { centre, sigma, peak: glint.peak * self.sensor.gain }.add_to(&mut self.canvas, [width, height]);
        }
        self.noise.digitise(&self.canvas, width as usize, frame, &mut image.pixels);
        if let Some(levels) = &self.coarse {
            image.pixels.iter_mut().for_each(|it| *it = levels[usize::from(*it)]);
        }
    }

    fn draw_leds(&mut self, world: &World, capture: Time) {
        let samples = self.sensor.blur_samples.max(1);
        let (sigma, led_peak) = (self.sigmas(), world.settings().led_peak * self.sensor.gain / f64::from(samples));
        for sample in 0..samples {
            let share = (f64::from(sample) + 0.5) / f64::from(samples) - 0.5;
            world.at(capture + Interval::from_ms(share * self.sensor.exposure_ms), &mut self.moment);
            for light in self.moment.lights_seen_from(&self.centre, led_peak) {
                if let Some(pixel) = self.camera.project(&light.position) {
                    let distance = (light.position - self.centre).norm();
                    let peak = light.brightness * (REFERENCE_DISTANCE_M / distance).powi(2);
                    let spot = Spot { centre: [pixel.x, pixel.y], sigma, peak };
                    spot.add_to(&mut self.canvas, self.camera.image_size);
                }
            }
        }
    }

    /// Standard deviations of a LED's spot along rows and columns [px]: round on the sensor.
    fn sigmas(&self) -> [f64; 2] {
        let [across, down] = self.camera.intrinsics.focal;
        [self.sensor.spot_sigma_px, self.sensor.spot_sigma_px * down / across]
    }
}

/// Renders a single field; to render many, keep a [`Renderer`].
pub fn render(camera: &Camera, id: CameraId, world: &World, sensor: &Sensor, capture: Time, random: &Random) -> Image {
    let mut image = Image::default();
    Renderer::new(camera, id, world, sensor, random).render(world, capture, 0, &mut image);
    image
}

/// Rounds 8-bit values to 2^`bits` levels, from 0 to 255; `None` when that changes nothing.
fn coarse_levels(bits: u32) -> Option<[u8; 256]> {
    let top = f64::from((1_u32 << bits.clamp(1, 8)) - 1);
    (bits < 8).then(|| std::array::from_fn(|it| ((it as f64 / 255.0 * top).round() / top * 255.0).round() as u8))
}

/// A gray level in steps, saturating.
fn steps(gray: f64) -> i16 {
    (gray * STEPS).round() as i16 // `as` saturates
}
