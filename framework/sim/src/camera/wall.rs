//! Renders a simulated wall as a camera sees it: one field, in gray levels, or in those of three planes.
//!
//! Which point of the wall each pixel sees is tabulated where the camera stands, at the corners of blocks and between them along straight lines. Order of events: the
//! wall's own picture, display by display, as bright as it shines → windows, or the board → red spots or the dot, no brighter than the wall can be → spots of pointers at several
//! moments of the exposure, smeared by the hand → noise → rounding and saturation.

use foveate_estimation::random::Random;
use foveate_messages::{CameraId, Image, Interval, PixelFormat, Time};
use foveate_node::ConfigError;
use nalgebra::{Point2, Point3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::noise::Noise;
use super::spot::Spot;
use super::steps;
use crate::timing::TimingSettings;
use crate::truth::TrueCamera;
use crate::wall::{ShownBoard, WHITE, Wall, WallLight};

/// Side of the blocks at whose corners the wall is looked up [px].
const BLOCK: usize = 8;

/// When a camera looks at a wall, and how it turns light into pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WallCameraSettings {
    /// Capture times, clock and delivery of its fields.
    #[serde(flatten)]
    pub timing: TimingSettings,
    /// Exposure time; what moves is smeared [ms].
    #[schemars(range(min = 0.01, max = 100.0))]
    pub exposure_ms: f64,
    /// Moments of the exposure at which spots of pointers are drawn [–].
    #[schemars(range(min = 1, max = 32))]
    pub blur_samples: u32,
    /// Iris and amplifier: multiplies all light [–].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub gain: f64,
    /// Black level: gray level of a pixel without light [gray level].
    #[schemars(range(min = 0.0, max = 128.0))]
    pub black_level: f64,
    /// Blur of the lens, standard deviation [px].
    #[schemars(range(min = 0.3, max = 20.0))]
    pub blur_px: f64,
    /// Standard deviation of the noise, drawn for each pixel and field [gray level].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub noise_sigma: f64,
    /// Whether its pictures are gray, as through a filter that passes red, or have red, green and blue planes [–].
    pub format: WallFormat,
    /// In colour pictures, how far the amplifiers of red and of blue are off that of green, standard deviation, drawn once for each camera [%].
    #[schemars(range(min = 0.0, max = 50.0))]
    pub balance_percent: f64,
}

/// What the pixels of a wall's camera measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum WallFormat {
    /// How bright they are.
    #[default]
    Gray,
    /// The same in three planes.
    Rgb,
}

impl Default for WallCameraSettings {
    fn default() -> Self {
        Self {
            timing: TimingSettings::default(),
            exposure_ms: 2.0,
            blur_samples: 6,
            gain: 1.0,
            black_level: 8.0,
            blur_px: 0.7,
            noise_sigma: 2.0,
            format: WallFormat::Gray,
            balance_percent: 5.0,
        }
    }
}

impl WallCameraSettings {
    /// Refuses what is out of range or contradicts itself.
    ///
    /// # Errors
    /// The first such setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        self.timing.check()?;
        ConfigError::unless_in("exposure_ms", self.exposure_ms, 0.01..=100.0)?;
        ConfigError::unless_in("blur_samples", self.blur_samples, 1..=32)?;
        ConfigError::unless_in("gain", self.gain, 0.0..=20.0)?;
        ConfigError::unless_in("black_level", self.black_level, 0.0..=128.0)?;
        ConfigError::unless_in("blur_px", self.blur_px, 0.3..=20.0)?;
        ConfigError::unless_in("noise_sigma", self.noise_sigma, 0.0..=20.0)?;
        ConfigError::unless_in("balance_percent", self.balance_percent, 0.0..=50.0)?;
        self.timing.check_light(self.exposure_ms, 0.0)
    }
}

/// Renders the fields of one camera before a wall.
pub struct WallRenderer {
    wall: Wall,
    camera: TrueCamera,
    eye: Point3<f64>,
    id: CameraId,
    settings: WallCameraSettings,
    /// What each pixel sees of the wall [m].
    places: Vec<[f32; 2]>,
    /// The wall's own picture where it shines fully, in steps above black.
    texture: Vec<i16>,
    /// Runs of pixels of one display: row by row, start, end, display.
    runs: Vec<(usize, usize, [u32; 2])>,
    /// The board at its place, and what it adds to which pixels, in steps.
    board: Option<(ShownBoard, Vec<(usize, i16)>)>,
    noise: Noise,
    /// Amplifiers of red, green and blue.
    balance: [f64; 3],
    canvas: Vec<i16>,
    plane: Vec<u8>,
}

impl WallRenderer {
    /// Gets ready; `random` is the camera's own.
    pub fn new(wall: Wall, camera: TrueCamera, id: CameraId, settings: &WallCameraSettings, random: &Random) -> Self {
        let [width, height] = camera.image_size.map(|it| it as usize);
        let places = places(&wall, &camera);
        let white = wall.settings().white * settings.gain;
        let (mut texture, mut runs) = (vec![0; width * height], Vec::<(usize, usize, [u32; 2])>::new());
        for (pixel, place) in places.iter().enumerate() {
            let point = Point2::new(f64::from(place[0]), f64::from(place[1]));
            let Some(tile) = wall.tile(&point) else { continue };
            texture[pixel] = steps(white * wall.texture(&point));
            match runs.last_mut() {
                Some((_, end, of)) if *end == pixel && *of == tile && pixel % width != 0 => *end += 1,
                _ => runs.push((pixel, pixel + 1, tile)),
            }
        }
        let mut own = random.fork("balance");
        let mut off = || 1.0 + settings.balance_percent * 0.01 * own.normal();
        Self {
            balance: [off(), 1.0, off()],
            plane: Vec::new(),
            noise: Noise::new(width, settings.noise_sigma, &random.fork("noise")),
            eye: camera.centre(),
            id,
            settings: settings.clone(),
            canvas: vec![0; width * height],
            board: None,
            wall,
            camera,
            places,
            texture,
            runs,
        }
    }

    /// Renders the field around `capture`, whose number is `frame`, into `image`, whose memory is used again.
    pub fn render(&mut self, capture: Time, frame: u64, image: &mut Image) {
        let [width, height] = self.camera.image_size;
        let n = (width * height) as usize;
        image.camera = self.id;
        (image.width, image.height) = (width, height);
        let mut canvas = std::mem::take(&mut self.canvas);
        match self.settings.format {
            WallFormat::Gray => {
                self.draw(capture, &|_| 1.0, &mut canvas);
                image.format = PixelFormat::Gray8;
                image.pixels.resize(n, 0);
                self.noise.digitise(&canvas, width as usize, frame, 0, &mut image.pixels);
            }
            WallFormat::Rgb => {
                image.format = PixelFormat::Rgb8;
                image.pixels.resize(3 * n, 0);
                let mut bytes = std::mem::take(&mut self.plane);
                bytes.resize(n, 0);
                for plane in 0..3 {
                    let balance = self.balance[plane];
                    self.draw(capture, &|colour| colour[plane] * balance, &mut canvas);
                    self.noise.digitise(&canvas, width as usize, frame, plane as u64, &mut bytes);
                    image.pixels.iter_mut().skip(plane).step_by(3).zip(&bytes).for_each(|(to, from)| *to = *from);
                }
                self.plane = bytes;
            }
        }
        self.canvas = canvas;
    }

    /// Draws what reaches the pixels; `of` says how much light of a colour counts.
    fn draw(&mut self, capture: Time, of: &dyn Fn([f64; 3]) -> f64, canvas: &mut [i16]) {
        let WallCameraSettings { exposure_ms, blur_samples, gain, black_level, .. } = self.settings;
        let black = steps(black_level);
        canvas.fill(black);
        for &(start, end, tile) in &self.runs {
            // 7 bits of the factor keep products in 32 bits and the loop plain.
            let shine = (self.wall.shine(tile, capture) * of(self.wall.tint(tile)) * 128.0) as i32;
            for (to, from) in canvas[start..end].iter_mut().zip(&self.texture[start..end]) {
                *to = black.saturating_add(((i32::from(*from) * shine) >> 7) as i16);
            }
        }
        self.draw_windows(capture, black, of, canvas);
        self.draw_board(capture, of, canvas);
        let wall = self.wall.clone();
        wall.shown_lights(capture, |light| self.draw_light(&light, of(light.colour), canvas));
        let most = steps(wall.settings().red_peak.max(wall.settings().white) * gain + black_level);
        canvas.iter_mut().for_each(|it| *it = (*it).min(most));
        let moments = i64::from(blur_samples);
        let eye = self.eye;
        for moment in 0..moments {
            let part = (moment as f64 + 0.5) / moments as f64 - 0.5;
            let time = capture + Interval::from_ms(part * exposure_ms);
            let share = 1.0 / moments as f64;
            wall.spots(time, &eye, |light| self.draw_light(&light, share * of(light.colour), canvas));
        }
    }

    fn draw_windows(&self, capture: Time, black: i16, of: &dyn Fn([f64; 3]) -> f64, canvas: &mut [i16]) {
        let width = self.camera.image_size[0] as usize;
        for window in self.wall.windows(capture) {
            let [low, high] = window.corners;
            let Some([(left, right), (top, bottom)]) = self.bounds([low, high]) else { continue };
            let [low, high] = [low, high].map(|it| [it.x as f32, it.y as f32]);
            let level = black.saturating_add(steps(window.level * self.settings.gain * of(window.colour)));
            for row in top..bottom {
                let pixels = row * width + left..row * width + right.max(left);
                for (to, at) in canvas[pixels.clone()].iter_mut().zip(&self.places[pixels]) {
                    let is_inside = (low[0]..high[0]).contains(&at[0]) && (low[1]..high[1]).contains(&at[1]);
                    // Bezels and displays that are off stay black.
                    if is_inside && *to > black {
                        *to = level;
                    }
                }
            }
        }
    }

    /// Columns and rows of pixels that a rectangle of the wall lies in; `None` where the camera does not see all of its corners.
    fn bounds(&self, [low, high]: [Point2<f64>; 2]) -> Option<[(usize, usize); 2]> {
        let corners = [low, Point2::new(high.x, low.y), high, Point2::new(low.x, high.y)];
        let mut bounds = [(f64::MAX, f64::MIN); 2];
        for corner in corners {
            let pixel = self.camera.project(&self.wall.in_space(&corner))?;
            for axis in 0..2 {
                bounds[axis] = (bounds[axis].0.min(pixel[axis]), bounds[axis].1.max(pixel[axis]));
            }
        }
        // A lens bends edges by a few pixels.
        let within = |axis: usize, at: f64| at.clamp(0.0, f64::from(self.camera.image_size[axis])) as usize;
        Some([0, 1].map(|axis| (within(axis, bounds[axis].0 - 4.0), within(axis, bounds[axis].1 + 5.0))))
    }

    /// Adds the board, which is rendered once for each of its places.
    fn draw_board(&mut self, capture: Time, of: &dyn Fn([f64; 3]) -> f64, canvas: &mut [i16]) {
        let Some(board) = self.wall.board(capture) else { return };
        if self.board.as_ref().is_none_or(|it| it.0 != board) {
            self.board = Some((board, self.rendered(&board)));
        }
        let share = of(WHITE);
        for (pixel, level) in self.board.iter().flat_map(|it| &it.1) {
            canvas[*pixel] = canvas[*pixel].saturating_add((f64::from(*level) * share) as i16);
        }
    }

    fn rendered(&self, board: &ShownBoard) -> Vec<(usize, i16)> {
        let white = self.wall.settings().white * self.settings.gain;
        let [width, height] = self.camera.image_size.map(|it| it as usize);
        let Some([(left, right), (top, bottom)]) = self.bounds(board.bounds()) else { return Vec::new() };
        // Blur of the lens, and the pixel's own side.
        let blur = self.settings.blur_px.hypot(1.0 / 12.0_f64.sqrt());
        let mut rendered = Vec::new();
        for row in top..bottom {
            for column in left..right.max(left) {
                let at = |column: usize, row: usize| self.places[row * width + column].map(f64::from);
                let here = at(column, row);
                // From the pixel to a neighbour within the picture.
                let across = at(if column + 1 < width { column + 1 } else { column - 1 }, row);
                let down = at(column, if row + 1 < height { row + 1 } else { row - 1 });
                let sigma = [0, 1].map(|axis| blur * (across[axis] - here[axis]).hypot(down[axis] - here[axis]));
                let level = board.level(&here.into(), sigma);
                if level > 0.0 {
                    rendered.push((row * width + column, steps(white * level)));
                }
            }
        }
        rendered
    }

    /// Adds `share` of a light.
    fn draw_light(&self, light: &WallLight, share: f64, canvas: &mut [i16]) {
        if !self.wall.faces(&self.eye) {
            return;
        }
        let Some(pixel) = self.camera.sees(&self.wall.in_space(&light.point)) else { return };
        let Some(scale) = self.wall.pixels_a_metre(&self.camera, &light.point) else { return };
        let own = light.sigma * scale;
        let sigma = own.hypot(self.settings.blur_px);
        let peak = light.peak * self.settings.gain * share * (own / sigma).powi(2);
        Spot { centre: [pixel.x, pixel.y], sigma: [sigma; 2], peak }.add_to(canvas, self.camera.image_size);
    }
}

/// What each pixel sees of the wall, or of where it would go on [m]; NaN where that is nothing.
fn places(wall: &Wall, camera: &TrueCamera) -> Vec<[f32; 2]> {
    let [width, height] = camera.image_size.map(|it| it as usize);
    let is_before = wall.faces(&camera.centre());
    let on_wall = |column: usize, row: usize| -> [f64; 2] {
        let ray = camera.ray(&Point2::new(column as f64, row as f64));
        ray.filter(|_| is_before).and_then(|ray| wall.met_by(&ray)).map_or([f64::NAN; 2], |it| [it.x, it.y])
    };
    let [columns, rows] = [width, height].map(|it| it.div_ceil(BLOCK) + 1);
    let corners: Vec<[f64; 2]> =
        (0..columns * rows).map(|it| on_wall(it % columns * BLOCK, it / columns * BLOCK)).collect();
    let mut places = Vec::with_capacity(width * height);
    for row in 0..height {
        let (block_row, down) = (row / BLOCK, (row % BLOCK) as f64 / BLOCK as f64);
        for column in 0..width {
            let (block, right) = (column / BLOCK, (column % BLOCK) as f64 / BLOCK as f64);
            let corner = |across: usize, along: usize| corners[(block_row + along) * columns + block + across];
            let mix = |axis: usize| {
                let [upper, lower] = [0, 1].map(|it| corner(0, it)[axis] * (1.0 - right) + corner(1, it)[axis] * right);
                (upper * (1.0 - down) + lower * down) as f32
            };
            places.push([mix(0), mix(1)]);
        }
    }
    places
}
