//! What lens, lamps and sensor do to the light beyond white noise: the faults of real cameras, each with a cause of its own.
//!
//! | fault | here |
//! |---|---|
//! | vignetting | light falls off as cos⁴ of an angle, set by what is lost in the corners |
//! | coma | a second, weaker and wider spot, farther out by the square of the distance from the middle |
//! | lamps on the mains | the light of the room pulses; the exposure averages it, rows that are read later see another phase |
//! | rolling shutter | rows are exposed one after the other: [`rolled`] |
//! | gain of each camera, gain of each pixel | drawn once, with the camera's own seed |
//! | shot noise | as many electrons as there are, normally distributed: variance in proportion to the light |
//! | dark pattern | an offset of each pixel and of each column, drawn once |
//! | interlaced fields | a camera for each half of the lines: [`field_of`] |
//! | pictures that are packed as JPEG (MJPG) | [`packed`] |
//!
//! Source of the model of a pixel: EMVA Standard 1288, release 4.0, sections 2 and 3 (linear model, temporal noise, spatial nonuniformity).

use foveate_estimation::random::Random;
use foveate_messages::{PixelFormat, Time};
use foveate_node::ConfigError;
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageFormat};
use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use wide::{f32x8, i16x8, i32x8};

use super::STEPS;
use super::spot::Spot;
use crate::chance::stream;
use crate::truth::TrueCamera;

const TABLE_SIZE: usize = 1 << 14;
/// Pixels at a time.
const LANES: usize = 8;
/// Light of the tail of a comatic spot relative to its head, and its width [–].
const TAIL: [f64; 2] = [0.35, 1.5];

/// Faults of a camera's lens and sensor, and of the lamps of its room. Those of `bits`, `noise_sigma` and `bloom` come on top.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SensorSettings {
    /// Electrons in a gray level: shot noise has the standard deviation of √(light / this); 0: none [1/gray level].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub electrons: f64,
    /// By how much the gain of one camera differs from another's, standard deviation, as a part of it [–].
    #[schemars(range(min = 0.0, max = 0.3))]
    pub gain_spread: f64,
    /// By how much the gain of one pixel differs from its neighbour's, likewise [–].
    #[schemars(range(min = 0.0, max = 0.2))]
    pub gain_pattern: f64,
    /// What pixels read without light, standard deviation about the black level, always the same [gray level].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub dark_pattern: f64,
    /// What all pixels of a column read without light, likewise [gray level].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub dark_columns: f64,
    /// Part of the light that is lost in the corners of the picture [–].
    #[schemars(range(min = 0.0, max = 0.9))]
    pub vignetting: f64,
    /// How far out the middle of a comatic spot's tail lies in the corners, towards the corner [px].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub coma_px: f64,
    /// How often the lamps of the room pulse: twice the mains' frequency [Hz].
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub flicker_hz: f64,
    /// By how much, as a part of their light [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub flicker: f64,
    /// Rolling shutter: from the exposure of the first row to that of the last one; the stamp is that of the middle row. Lights and painted skin are drawn
    /// with it, from heads that turn, too, and people of a `studio`; people as dark shapes and the room are drawn as they are at the middle row's time.
    /// 0: all rows at once [ms].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub readout_ms: f64,
    /// Whether the lines of every other field lie between those of the one before, as with television's cameras. The rig does not know: its camera has the
    /// lines of one field, in the middle between the two, so that lights move up and down by a quarter of a line [–].
    pub interlaced: bool,
    /// Quality with which each picture is packed as JPEG, as webcams do (MJPG): blocks and edges that ring; 0: not packed [–].
    #[schemars(range(max = 100))]
    pub jpeg_quality: u8,
}

impl Default for SensorSettings {
    /// An industrial camera with a small global shutter and a cheap lens, in a room with lamps on 50 Hz.
    fn default() -> Self {
        Self {
            electrons: 40.0,
            gain_spread: 0.1,
            gain_pattern: 0.01,
            dark_pattern: 0.5,
            dark_columns: 0.3,
            vignetting: 0.35,
            coma_px: 0.8,
            flicker_hz: 100.0,
            flicker: 0.15,
            readout_ms: 0.0,
            interlaced: false,
            jpeg_quality: 0,
        }
    }
}

impl SensorSettings {
    /// Refuses numbers out of their ranges.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("sensor.electrons", self.electrons, 0.0..=1e6)?;
        ConfigError::unless_in("sensor.gain_spread", self.gain_spread, 0.0..=0.3)?;
        ConfigError::unless_in("sensor.gain_pattern", self.gain_pattern, 0.0..=0.2)?;
        ConfigError::unless_in("sensor.dark_pattern", self.dark_pattern, 0.0..=20.0)?;
        ConfigError::unless_in("sensor.dark_columns", self.dark_columns, 0.0..=20.0)?;
        ConfigError::unless_in("sensor.vignetting", self.vignetting, 0.0..=0.9)?;
        ConfigError::unless_in("sensor.coma_px", self.coma_px, 0.0..=10.0)?;
        ConfigError::unless_in("sensor.flicker_hz", self.flicker_hz, 1.0..=1000.0)?;
        ConfigError::unless_in("sensor.flicker", self.flicker, 0.0..=1.0)?;
        ConfigError::unless_in("sensor.readout_ms", self.readout_ms, 0.0..=100.0)?;
        ConfigError::unless_in("sensor.jpeg_quality", self.jpeg_quality, 0..=100)
    }
}

/// One camera's sensor, as it was made.
pub(super) struct Sensor {
    settings: SensorSettings,
    size: [usize; 2],
    seed: u64,
    /// Of each pixel, lens and all [–].
    gains: Vec<f32>,
    /// Of each pixel, black level and all [steps].
    darks: Vec<f32>,
    black: f32,
    /// Variance of the noise without light [steps²].
    read_variance: f32,
    /// Two tables of normal numbers, see [`Noise`](super::noise::Noise).
    tables: [Vec<f32>; 2],
}

impl Sensor {
    /// Draws the patterns; `noise_sigma` and `black_level` in gray levels, `random` the camera's own.
    pub fn new(
        settings: &SensorSettings,
        [width, height]: [u32; 2],
        [black_level, noise_sigma]: [f64; 2],
        random: &Random,
    ) -> Self {
        let size = [width, height].map(|it| it as usize);
        let mut normals = random.fork("pattern");
        let own = 1.0 + settings.gain_spread * normals.normal().clamp(-2.5, 2.5);
        let columns: Vec<f64> = (0..width).map(|_| settings.dark_columns * normals.normal()).collect();
        // cos⁴ of the angle is 1 / (1 + tan²)²: in the corners that is what is left.
        let corner = (1.0 - settings.vignetting).powf(-0.5) - 1.0;
        let (mut gains, mut darks) = (Vec::with_capacity(size[0] * size[1]), Vec::with_capacity(size[0] * size[1]));
        for row in 0..height {
            for (column, dark) in (0..width).zip(&columns) {
                let out = from_middle([f64::from(column), f64::from(row)], size);
                let lens = (1.0 + corner * out[0].hypot(out[1]).powi(2)).powi(-2);
                gains.push((own * lens * (1.0 + settings.gain_pattern * normals.normal())).max(0.0) as f32);
                darks.push(((black_level + dark + settings.dark_pattern * normals.normal()) * STEPS) as f32);
            }
        }
        let tables = [0, 1].map(|number| {
            let mut random = random.fork(&format!("sensor {number}"));
            let length = TABLE_SIZE + size[0];
            (0..length).map(|_| (random.normal() / std::f64::consts::SQRT_2) as f32).collect()
        });
        Self {
            seed: random.fork("sensor rows").next_u64(),
            black: (black_level * STEPS) as f32,
            read_variance: (noise_sigma * STEPS).powi(2) as f32,
            settings: settings.clone(),
            size,
            gains,
            darks,
            tables,
        }
    }

    /// Lets the lamps pulse, before lights of their own are drawn: the canvas as it is at `capture`, exposed for `exposure_ms`.
    pub fn flicker(&self, capture: Time, exposure_ms: f64, canvas: &mut [i16]) {
        let SensorSettings { flicker_hz, flicker, readout_ms, .. } = self.settings;
        if flicker == 0.0 {
            return;
        }
        let turns = flicker_hz * exposure_ms * 1e-3 * std::f64::consts::PI;
        let depth = flicker * turns.sin() / turns;
        let last = (self.size[1] - 1).max(1) as f64;
        for (row, pixels) in canvas.chunks_exact_mut(self.size[0]).enumerate() {
            let late_s = (row as f64 / last - 0.5) * readout_ms * 1e-3;
            let phase = std::f64::consts::TAU * (flicker_hz * (capture.as_s() + late_s)).fract();
            let factor = (1.0 + depth * phase.sin()) as f32;
            for pixels in pixels.chunks_mut(LANES) {
                let lights = (floats(pixels) - self.black) * factor + self.black;
                let lights = i16x8::from_i32x8_saturate(lights.fast_trunc_int()).to_array();
                pixels.copy_from_slice(&lights[..pixels.len()]);
            }
        }
    }

    /// The parts of a light's spot.
    pub fn spots(&self, spot: Spot) -> [Option<Spot>; 2] {
        let out = from_middle(spot.centre, self.size);
        let shift = self.settings.coma_px * out[0].hypot(out[1]);
        let [light, width] = TAIL;
        // The light of a spot is its peak times its area.
        let tail = Spot {
            centre: [0, 1].map(|it| spot.centre[it] + shift * out[it]),
            sigma: spot.sigma.map(|it| it * width),
            peak: spot.peak * light / (1.0 + light) / (width * width),
        };
        let head = Spot { peak: spot.peak / (1.0 + light), ..spot };
        if shift > 0.0 { [Some(head), Some(tail)] } else { [Some(spot), None] }
    }

    /// From light to bytes: this channel of field `frame`.
    pub fn digitise(&self, canvas: &[i16], frame: u64, channel: u64, bytes: &mut [u8]) {
        let width = self.size[0];
        let mut random = stream(self.seed, channel, frame as i64);
        let per_step = if self.settings.electrons > 0.0 { (STEPS / self.settings.electrons) as f32 } else { 0.0 };
        let patterns = self.gains.chunks_exact(width).zip(self.darks.chunks_exact(width));
        for ((lights, bytes), (gains, darks)) in
            canvas.chunks_exact(width).zip(bytes.chunks_exact_mut(width)).zip(patterns)
        {
            let bits = random.next_u64() as usize;
            let places = [bits % TABLE_SIZE, (bits >> 32) % TABLE_SIZE];
            let one = &self.tables[0][places[0]..places[0] + width];
            let other = &self.tables[1][places[1]..places[1] + width];
            let chunks = bytes.chunks_mut(LANES).zip(lights.chunks(LANES));
            let patterns = gains.chunks(LANES).zip(darks.chunks(LANES));
            let noise = one.chunks(LANES).zip(other.chunks(LANES));
            for (((bytes, lights), (gains, darks)), (one, other)) in chunks.zip(patterns).zip(noise) {
                let signal = (floats(lights) - self.black) * eight(gains);
                let sigma = (signal.fast_max(f32x8::ZERO) * per_step + self.read_variance).sqrt();
                let steps = eight(darks) + signal + sigma * (eight(one) + eight(other));
                let levels = (steps * (1.0 / STEPS as f32) + 0.5).fast_max(f32x8::ZERO).fast_min(f32x8::splat(255.0));
                let levels = i16x8::from_i32x8_saturate(levels.fast_trunc_int()).to_array().map(|it| it as u8);
                match bytes.first_chunk_mut() {
                    Some(all) => *all = levels,
                    None => bytes.copy_from_slice(&levels[..bytes.len()]),
                }
            }
        }
    }

    /// What is left of a picture when it was packed for the way to the host.
    pub fn pack(&self, bytes: &mut [u8], format: PixelFormat) {
        if self.settings.jpeg_quality > 0 {
            packed(bytes, self.size, format, self.settings.jpeg_quality);
        }
    }

    /// Rolling shutter, if there is one [ms].
    pub fn readout_ms(&self) -> Option<f64> {
        (self.settings.readout_ms > 0.0).then_some(self.settings.readout_ms)
    }
}

/// The camera that takes field `frame` of an interlaced one, whose mean is `camera`: even fields have the upper lines.
pub fn field_of(camera: &TrueCamera, frame: u64) -> TrueCamera {
    camera.shifted_down(if frame.is_multiple_of(2) { 0.25 } else { -0.25 })
}

/// Levels of a picture of `size` as they come out of a JPEG of this quality.
fn packed(bytes: &mut [u8], [width, height]: [usize; 2], format: PixelFormat, quality: u8) {
    let mut file = Vec::with_capacity(bytes.len() / 4);
    let colours = match format {
        PixelFormat::Gray8 => ExtendedColorType::L8,
        PixelFormat::Rgb8 => ExtendedColorType::Rgb8,
    };
    let encoded = JpegEncoder::new_with_quality(&mut file, quality).encode(bytes, width as u32, height as u32, colours);
    encoded.expect("a picture with as many bytes as pixels can be packed in memory, up to 65535 pixels a side");
    let picture =
        image::load_from_memory_with_format(&file, ImageFormat::Jpeg).expect("what was packed just now can be read");
    match format {
        PixelFormat::Gray8 => bytes.copy_from_slice(&picture.into_luma8()),
        PixelFormat::Rgb8 => bytes.copy_from_slice(&picture.into_rgb8()),
    }
}

/// Eight values, or as many as are left and zeros.
#[inline]
fn eight(values: &[f32]) -> f32x8 {
    let mut padded = [0.0; LANES];
    match values.first_chunk() {
        Some(all) => f32x8::new(*all),
        None => {
            padded[..values.len()].copy_from_slice(values);
            f32x8::new(padded)
        }
    }
}

/// The same of integers.
#[inline]
fn floats(values: &[i16]) -> f32x8 {
    let mut padded = [0; LANES];
    match values.first_chunk() {
        Some(all) => padded = *all,
        None => padded[..values.len()].copy_from_slice(values),
    }
    i32x8::from_i16x8(i16x8::new(padded)).round_float()
}

/// Where a pixel lies: 0 in the middle, length 1 in the corners.
fn from_middle(pixel: [f64; 2], size: [usize; 2]) -> [f64; 2] {
    [0, 1].map(|it| {
        let half = 0.5 * (size[it] - 1).max(1) as f64;
        (pixel[it] - half) / half / std::f64::consts::SQRT_2
    })
}

/// Where a light is seen by rows of a picture of `height` rows that are exposed one after the other, from where it would be seen at the time of the first row and at
/// that of the last: on the straight line between the two, in the row that is exposed just then. `None` where no row meets it.
pub(super) fn rolled(first: &Point2<f64>, last: &Point2<f64>, height: u32) -> Option<Point2<f64>> {
    // y = y₀ + (y₁ − y₀) s is read at s = y / (height − 1).
    let way = last - first;
    let rows = f64::from(height - 1) - way.y;
    let share = first.y / rows;
    // A little more than the picture: spots reach into it.
    (rows > 0.0 && (-0.2..=1.2).contains(&share)).then(|| first + way * share)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [64, 48];
    const NONE: SensorSettings = SensorSettings {
        electrons: 0.0,
        gain_spread: 0.0,
        gain_pattern: 0.0,
        dark_pattern: 0.0,
        dark_columns: 0.0,
        vignetting: 0.0,
        coma_px: 0.0,
        flicker_hz: 100.0,
        flicker: 0.0,
        readout_ms: 0.0,
        interlaced: false,
        jpeg_quality: 0,
    };

    fn fields(settings: &SensorSettings, level: f64, noise: f64, count: u64) -> Vec<Vec<f64>> {
        let sensor = Sensor::new(settings, SIZE, [10.0, noise], &Random::new(3));
        let canvas = vec![((level + 10.0) * STEPS) as i16; 64 * 48];
        let mut bytes = vec![0; 64 * 48];
        (0..count)
            .map(|frame| {
                sensor.digitise(&canvas, frame, 0, &mut bytes);
                bytes.iter().map(|it| f64::from(*it)).collect()
            })
            .collect()
    }

    fn moments(values: &[f64]) -> [f64; 2] {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        [mean, values.iter().map(|it| (it - mean).powi(2)).sum::<f64>() / values.len() as f64]
    }

    #[test]
    fn without_faults_light_is_rounded_and_saturates() {
        assert!(fields(&NONE, 50.2, 0.0, 1)[0].iter().all(|it| *it == 60.0));
        assert!(fields(&NONE, 400.0, 0.0, 1)[0].iter().all(|it| *it == 255.0));
        assert!(fields(&NONE, -30.0, 0.0, 1)[0].iter().all(|it| *it == 0.0));
    }

    #[test]
    fn shot_noise_grows_with_the_light_as_electrons_have_it() {
        let shot = SensorSettings { electrons: 25.0, ..NONE };
        for (level, read) in [(20.0, 0.0), (100.0, 0.0), (200.0, 3.0), (0.0, 2.0)] {
            let [mean, variance] = moments(&fields(&shot, level, read, 12).concat());
            let expected = level / 25.0 + read * read + 1.0 / 12.0;
            assert!((mean - level - 10.0).abs() < 0.1, "{mean}");
            assert!((variance / expected - 1.0).abs() < 0.1, "{level}: {variance} instead of {expected}");
        }
    }

    #[test]
    fn patterns_are_the_same_in_every_field_and_as_large_as_is_said() {
        let pattern = SensorSettings { dark_pattern: 3.0, dark_columns: 2.0, gain_pattern: 0.02, ..NONE };
        let dark = fields(&pattern, 0.0, 0.0, 2);
        assert_eq!(dark[0], dark[1]);
        let columns: Vec<f64> =
            (0..64).map(|column| (0..48).map(|row| dark[0][row * 64 + column]).sum::<f64>() / 48.0).collect();
        let [_, of_columns] = moments(&columns);
        let [_, of_all] = moments(&dark[0]);
        assert!((1.5..2.5).contains(&of_columns.sqrt()), "{of_columns}");
        assert!((of_all - of_columns).sqrt() > 2.7 && (of_all - of_columns).sqrt() < 3.3, "{of_all}");
        // The pattern of gains shows where there is light.
        let gains = SensorSettings { gain_pattern: 0.02, ..NONE };
        let [_, variance] = moments(&fields(&gains, 200.0, 0.0, 1)[0]);
        assert!((variance.sqrt() - 4.0).abs() < 0.4, "{variance}");
    }

    #[test]
    fn corners_lose_what_is_said_and_the_middle_nothing() {
        let field = fields(&SensorSettings { vignetting: 0.4, ..NONE }, 200.0, 0.0, 1).remove(0);
        assert_eq!([field[0], field[63], field[47 * 64]], [130.0; 3]);
        assert!((209.0..=210.0).contains(&field[24 * 64 + 32]));
    }

    #[test]
    fn coma_keeps_the_light_and_moves_its_centre_outwards_with_the_square_of_the_distance() {
        let sensor = Sensor::new(&SensorSettings { coma_px: 2.0, ..NONE }, SIZE, [0.0, 0.0], &Random::new(1));
        let of = |centre: [f64; 2]| {
            let spots: Vec<Spot> =
                sensor.spots(Spot { centre, sigma: [1.2, 1.2], peak: 100.0 }).into_iter().flatten().collect();
            let light: f64 = spots.iter().map(|it| it.peak * it.sigma[0] * it.sigma[1]).sum();
            let x: f64 = spots.iter().map(|it| it.peak * it.sigma[0] * it.sigma[1] * it.centre[0]).sum();
            assert!((light - 144.0).abs() < 1e-9);
            x / light - centre[0]
        };
        assert!(of([31.5, 23.5]).abs() < 1e-12);
        let (half, edge) = (of([47.25, 23.5]), of([63.0, 23.5]));
        assert!(half > 0.0 && (edge / half - 4.0).abs() < 1e-9, "{half} {edge}");
    }

    #[test]
    fn lamps_pulse_with_the_mains_and_rows_that_are_read_later_see_another_phase() {
        let lamps = SensorSettings { flicker: 0.2, ..NONE };
        let seen = |settings: &SensorSettings, time_s: f64, exposure_ms: f64| {
            let sensor = Sensor::new(settings, SIZE, [10.0, 0.0], &Random::new(1));
            let mut canvas = vec![(110.0 * STEPS) as i16; 64 * 48];
            sensor.flicker(Time::from_s(time_s), exposure_ms, &mut canvas);
            [canvas[0], canvas[24 * 64], canvas[47 * 64]].map(|it| f64::from(it) / STEPS - 110.0)
        };
        let [top, middle, bottom] = seen(&lamps, 0.0025, 0.01);
        assert!((middle - 20.0).abs() < 0.1 && top == middle && middle == bottom, "{middle}");
        assert!(seen(&lamps, 0.0025, 10.0)[1].abs() < 0.1, "a whole period of exposure sees no pulse");
        let [top, _, bottom] = seen(&SensorSettings { readout_ms: 5.0, ..lamps }, 0.0, 0.01);
        assert!((top + 20.0).abs() < 0.1 && (bottom - 20.0).abs() < 0.1, "{top} {bottom}");
    }

    #[test]
    fn rows_meet_a_light_when_they_are_read() {
        let (first, last) = (Point2::new(10.0, 100.0), Point2::new(30.0, 120.0));
        let met = rolled(&first, &last, 241).unwrap();
        let share = (met.x - 10.0) / 20.0;
        assert!((met.y / 240.0 - share).abs() < 1e-12 && (met.y - 100.0 - 20.0 * share).abs() < 1e-12);
        let still = rolled(&first, &first, 241).unwrap();
        assert_eq!(still, first);
        assert_eq!(rolled(&first, &Point2::new(10.0, 400.0), 241), None, "faster than the rows are read");
    }

    #[test]
    fn packing_keeps_a_spot_where_it_is_and_rings_about_it() {
        let [width, height] = SIZE.map(|it| it as usize);
        let spot = |x: usize, y: usize| {
            let off = (x as f64 - 30.3).powi(2) + (y as f64 - 20.6).powi(2);
            (12.0 + 200.0 * (-off / (2.0 * 1.5f64.powi(2))).exp()).round() as u8
        };
        let clean: Vec<u8> = (0..height).flat_map(|y| (0..width).map(move |x| spot(x, y))).collect();
        let off = |quality: u8| {
            let mut bytes = clean.clone();
            packed(&mut bytes, [width, height], PixelFormat::Gray8, quality);
            let differences: f64 = clean.iter().zip(&bytes).map(|(a, b)| f64::from(a.abs_diff(*b)).powi(2)).sum();
            let light = |it: usize| (f64::from(bytes[it]) - 40.0).max(0.0);
            let sum: f64 = (0..bytes.len()).map(light).sum();
            let x: f64 = (0..bytes.len()).map(|it| light(it) * (it % width) as f64).sum();
            ((differences / bytes.len() as f64).sqrt(), (x / sum - 30.3).abs())
        };
        let ((fine, fine_x), (rough, rough_x)) = (off(95), off(30));
        assert!(fine < 1.5 && rough > 2.0 * fine && rough < 8.0, "{fine} {rough} gray levels");
        assert!(fine_x < 0.05 && rough_x < 0.3, "{fine_x} {rough_x} px");
    }

    #[test]
    fn fields_of_an_interlaced_camera_lie_half_a_line_apart_about_the_calibrated_one() {
        let camera = TrueCamera::from(&crate::lab::lab_calibration().cameras[0].camera);
        let ahead = camera.ray(&Point2::new(100.0, 50.0)).unwrap();
        let point = ahead.origin + ahead.direction.into_inner() * 3.0;
        let row = |camera: TrueCamera| camera.project(&point).unwrap().y;
        let rows = [0, 1, 2, 7].map(|frame| row(field_of(&camera, frame)) - 50.0);
        assert!(rows.iter().zip([0.25, -0.25, 0.25, -0.25]).all(|(a, b)| (a - b).abs() < 1e-6), "{rows:?}");
    }
}
