//! A wall of displays, what it shows, and the spots of laser pointers on it: a pure function of time.
//!
//! The space of the wall: origin at the top left corner of its first pixel, x to the right, y down, z into the wall; what it shows lies in z = 0 [m], unless it is bent: then x and y
//! run along what it shows, and `shape` has it in space.

mod board;
mod contents;
mod hand;
mod settings;
mod shape;
mod wave;

use std::sync::Arc;

use foveate_estimation::random::Random;
use foveate_geometry::{Camera, Ray};
use foveate_messages::{Message, Space, Time, Wire};
use nalgebra::{Isometry3, Point2, Point3, Vector2};

pub use board::BoardSettings;
pub(crate) use board::ShownBoard;
use contents::Contents;
pub(crate) use contents::Window;
use hand::Hand;
pub use settings::{DotSettings, WallSettings};
pub use shape::{CurveSettings, StandSettings};
use wave::Wave;
pub use wave::WaveSettings;

use crate::truth::{TrueCamera, Truth};

/// The beam's spot on the wall, standard deviation: a pointer's beam is some millimetres wide after a few metres [m].
const BEAM_SIGMA_M: f64 = 1.5e-3;
/// A spot this near to a bezel is seen in it [m].
const REFLECTION_REACH_M: f64 = 0.06;
/// How far a bezel stands out of the wall [m].
const BEZEL_M: f64 = 0.008;

/// A simulated wall; a handle.
#[derive(Debug, Clone)]
pub struct Wall(Arc<Inner>);

#[derive(Debug)]
struct Inner {
    settings: WallSettings,
    size: [f64; 2],
    hands: Vec<Hand>,
    /// By user: how the pointer blinks.
    blinks: Vec<Blink>,
    wave: Option<Wave>,
    contents: Contents,
    /// Where it stands in the cameras' space, if that is not its own.
    room_from_wall: Option<Isometry3<f64>>,
    truth: Truth,
}

/// A pointer that is dark once in each period.
#[derive(Debug, Clone, Copy)]
struct Blink {
    period_s: f64,
    /// When it was dark first.
    first_s: f64,
}

/// Light of something small on the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WallLight {
    /// Its middle [m].
    pub point: Point2<f64>,
    /// Standard deviation of its light about its middle [m].
    pub sigma: f64,
    /// What its middle reads in a camera of gain 1 if nothing blurs it [gray level].
    pub peak: f64,
    /// What the red, green and blue pixels of a colour camera read of it, relative to that.
    pub colour: [f64; 3],
}

/// Red as the wall's own pixels show it: its filters let some of the other light pass.
pub(crate) const RED: [f64; 3] = [1.0, 0.16, 0.1];
/// Light without a colour.
pub(crate) const WHITE: [f64; 3] = [1.0; 3];

/// A press of a pointer whose spot is on the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Press {
    /// Which: no two presses have one number.
    pub number: u32,
    /// Whose.
    pub user: u32,
    /// Where [m].
    pub point: Point2<f64>,
}

impl Message for Wall {
    const NAME: &'static str = "wall";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::Local;
}

impl Wall {
    /// The wall that `settings` describe; settings out of range are taken as they are. `random` is the wall's own.
    pub fn new(settings: WallSettings, truth: Truth, random: &Random) -> Wall {
        let size = [0, 1].map(|axis| {
            let (n, px) = (f64::from(settings.tiles[axis]), f64::from(settings.tile_px[axis]));
            (n * px * settings.pixel_mm + (n - 1.0) * settings.gap_mm) * 1e-3
        });
        let hands = (0..settings.users).map(|it| Hand::new(it, &settings, random)).collect();
        let blinks = settings.blink_ms.iter().enumerate().map(|(user, period_ms)| {
            let mut own = random.fork(&format!("blink {user}"));
            let period_s = period_ms * 1e-3 * (1.0 + settings.blink_clock_percent * 0.01 * own.normal());
            Blink { period_s, first_s: own.uniform() * period_s }
        });
        let blinks = blinks.collect();
        let contents = Contents::new(&settings, size, random);
        let edge = settings.pixel_mm * 0.5e-3;
        let wave = settings.wave.as_ref().map(|it| Wave::new(it, size, edge, random));
        let room_from_wall = settings.stand.as_ref().map(StandSettings::room_from_wall);
        Wall(Arc::new(Inner { room_from_wall, settings, size, hands, blinks, wave, contents, truth }))
    }

    /// What it was made from.
    pub fn settings(&self) -> &WallSettings {
        &self.0.settings
    }

    /// Width and height [m].
    pub fn size(&self) -> [f64; 2] {
        self.0.size
    }

    /// The true camera of this name: as drawn, or as `calibrated` where none was.
    pub fn camera(&self, name: Option<&str>, calibrated: &Camera) -> TrueCamera {
        name.and_then(|it| self.0.truth.camera(it)).cloned().unwrap_or_else(|| TrueCamera::from(calibrated))
    }

    /// The display at a point, as column and row; `None` beside the wall and between displays.
    pub fn tile(&self, point: &Point2<f64>) -> Option<[u32; 2]> {
        let WallSettings { tiles, tile_px, pixel_mm, gap_mm, .. } = self.0.settings;
        let mut found = [0; 2];
        for axis in 0..2 {
            let side = f64::from(tile_px[axis]) * pixel_mm * 1e-3;
            let step = side + gap_mm * 1e-3;
            let number = (point[axis] / step).floor();
            if !(0.0..f64::from(tiles[axis])).contains(&number) || point[axis] - number * step >= side {
                return None;
            }
            found[axis] = number as u32;
        }
        Some(found)
    }

    /// Whether a point lies on the wall, bezels between displays included.
    pub fn has(&self, point: &Point2<f64>) -> bool {
        (0.0..self.0.size[0]).contains(&point.x) && (0.0..self.0.size[1]).contains(&point.y)
    }

    /// A point of the wall in the space that cameras stand in [m].
    pub(crate) fn in_space(&self, point: &Point2<f64>) -> Point3<f64> {
        let own = shape::in_space(self.0.settings.curve.as_ref(), self.0.size, point);
        self.0.room_from_wall.map_or(own, |it| it * own)
    }

    /// Where a ray of that space meets the wall, its surroundings in the same bend included [m].
    pub(crate) fn met_by(&self, ray: &Ray) -> Option<Point2<f64>> {
        let ray = self.0.room_from_wall.map_or(*ray, |it| Ray {
            origin: it.inverse_transform_point(&ray.origin),
            direction: it.inverse() * ray.direction,
        });
        shape::met(self.0.settings.curve.as_ref(), self.0.size, &ray)
    }

    /// Whether an eye of the cameras' space sees what the wall shows: one that stands in a room is not seen through.
    pub(crate) fn faces(&self, eye: &Point3<f64>) -> bool {
        self.0.room_from_wall.is_none_or(|it| it.inverse_transform_point(eye).z < 0.0)
    }

    /// How many pixels a metre on the wall takes up at `point`, as the root of the area of a square metre's picture [px/m].
    pub(crate) fn pixels_a_metre(&self, camera: &TrueCamera, point: &Point2<f64>) -> Option<f64> {
        let at = |x: f64, y: f64| camera.project(&self.in_space(&(point + Vector2::new(x, y))));
        let (here, right, down) = (at(0.0, 0.0)?, at(1e-3, 0.0)?, at(0.0, 1e-3)?);
        Some(((right - here).perp(&(down - here))).abs().sqrt() * 1e3)
    }

    /// Whether it is dark but for what it is calibrated by.
    fn calibrates(&self) -> bool {
        let WallSettings { dots, board, wave, .. } = &self.0.settings;
        dots.is_some() || board.is_some() || wave.is_some()
    }

    fn is_dark(&self, point: &Point2<f64>) -> bool {
        self.tile(point).is_none_or(|tile| Some(tile) == self.0.settings.dark_tile)
    }

    /// The presses at a time whose spots are on the wall, by user.
    pub fn presses(&self, time: Time) -> impl Iterator<Item = Press> + '_ {
        let time_s = time.as_s();
        let inner = &self.0;
        let calibrates = self.calibrates();
        let waved = inner.wave.iter().filter(move |_| time_s >= 0.0).map(move |it| Press {
            number: 0,
            user: 0,
            point: self.waved(it, time_s),
        });
        let hands = inner.hands.iter().zip(0..).filter(move |_| !calibrates);
        let users = hands.filter_map(move |(hand, user)| {
            let number = hand.presses(time_s, &inner.settings)?;
            let point = hand.points_at(time_s, &inner.settings, inner.size);
            self.has(&point).then_some(Press { number, user, point })
        });
        waved.chain(users)
    }

    /// Where the waved pointer points: still while it touches the wall, else with the hand tremor of the first user.
    fn waved(&self, wave: &Wave, time_s: f64) -> Point2<f64> {
        let (point, is_held) = wave.at(time_s);
        match self.0.hands.first() {
            Some(hand) if !is_held => point + hand.shakes(time_s),
            _ => point,
        }
    }

    /// The spots of pointers as an eye at `eye` sees them: those of [`Self::presses`], and their reflections in bezels.
    pub fn spots(&self, time: Time, eye: &Point3<f64>, mut each: impl FnMut(WallLight)) {
        // In the wall's own space.
        let eye = self.0.room_from_wall.map_or(*eye, |it| it.inverse_transform_point(eye));
        let WallSettings { pointer_peak, reflection, tiles, tile_px, pixel_mm, gap_mm, .. } = self.0.settings;
        for Press { point, user, .. } in self.presses(time) {
            if self.blinks_dark(user, time) {
                continue;
            }
            let colour = self.0.settings.pointer_rgb.get(user as usize).copied().unwrap_or(WHITE);
            let light = WallLight { point, sigma: BEAM_SIGMA_M, peak: pointer_peak, colour };
            each(light);
            for axis in (0..2).filter(|_| reflection > 0.0) {
                let side = f64::from(tile_px[axis]) * pixel_mm * 1e-3;
                let step = side + gap_mm * 1e-3;
                // The bezel's face beside the display that the spot is on.
                let nearest = (point[axis] / step).round();
                if nearest < 1.0 || nearest >= f64::from(tiles[axis]) {
                    continue;
                }
                let ends = nearest * step - gap_mm * 1e-3;
                let face = if point[axis] < ends { ends } else { nearest * step };
                let off = point[axis] - face;
                // From behind the face nobody sees into it.
                if off.abs() > REFLECTION_REACH_M || off.abs() < 1e-3 || off * (eye[axis] - face) <= 0.0 {
                    continue;
                }
                let slant = (eye[axis] - point[axis]) / eye.z.abs().max(0.1);
                let mut mirrored = point;
                mirrored[axis] = 2.0 * face - point[axis] - 2.0 * BEZEL_M * slant;
                let fades = 1.0 - off.abs() / REFLECTION_REACH_M;
                each(WallLight { point: mirrored, peak: pointer_peak * reflection * fades, ..light });
            }
        }
    }

    /// Whether a user's pointer is dark though it is held down.
    fn blinks_dark(&self, user: u32, time: Time) -> bool {
        let blink = self.0.blinks.get(user as usize).filter(|_| !self.calibrates());
        blink.is_some_and(|it| (time.as_s() - it.first_s).rem_euclid(it.period_s) < self.0.settings.dark_ms * 1e-3)
    }

    /// The time of the picture that the wall shows at `time` [s]; negative before the first.
    fn shown_s(&self, time: Time) -> f64 {
        let WallSettings { display_latency_ms, refresh_hz, .. } = self.0.settings;
        ((time.as_s() - display_latency_ms * 1e-3) * refresh_hz).floor() / refresh_hz
    }

    /// What is small and bright in what the wall shows at `time`: red spots of contents, or the dot.
    pub fn shown_lights(&self, time: Time, mut each: impl FnMut(WallLight)) {
        let at_s = self.shown_s(time);
        if self.0.settings.board.is_some() || self.0.settings.wave.is_some() {
            return;
        }
        let mut lit = |light: WallLight| {
            if !self.is_dark(&light.point) {
                each(light);
            }
        };
        if self.0.settings.dots.is_some() {
            if let Some((_, light)) = self.dot(at_s) {
                lit(light);
            }
            return;
        }
        self.0.contents.spots(at_s).for_each(|it| lit(it.1));
    }

    /// What the wall is commanded to show at `time`: number, light. It appears later by the display's latency.
    pub fn commanded(&self, time: Time, mut each: impl FnMut(u32, WallLight)) {
        if self.0.settings.dots.is_some() {
            if let Some((number, light)) = self.dot(time.as_s()) {
                each(number, light);
            }
            return;
        }
        let WallSettings { white, pixel_mm, .. } = self.0.settings;
        if let Some(board) = self.board_at(time.as_s()) {
            let light = |point| WallLight { point, sigma: pixel_mm * 1e-3, peak: white, colour: WHITE };
            board.points().zip(0..).for_each(|(point, number)| each(number, light(point)));
        }
        if self.calibrates() {
            return;
        }
        self.0.contents.spots(time.as_s()).for_each(|(number, light)| each(number, light));
    }

    /// The dot that is due at `time_s` after all before it; `None` before the first and after the last.
    fn dot(&self, time_s: f64) -> Option<(u32, WallLight)> {
        let WallSettings { tiles, tile_px, pixel_mm, gap_mm, red_peak, dots, .. } = self.0.settings;
        let DotSettings { grid, each_ms, sigma_mm } = dots?;
        if time_s < 0.0 {
            return None;
        }
        let number = (time_s * 1e3 / each_ms).floor() as u64;
        let [columns, rows] = [0, 1].map(|axis| u64::from(tiles[axis] * grid[axis]));
        if number >= columns * rows {
            return None;
        }
        let cell = [number % columns, number / columns];
        let place = [0, 1].map(|axis| {
            let of_tile = u64::from(grid[axis]);
            let (tile, within) = (cell[axis] / of_tile, cell[axis] % of_tile);
            let side = f64::from(tile_px[axis]) * pixel_mm;
            // Dots lie in the middles of pixels, the outermost a dot's width from the display's edge.
            let edge = 4.0 * sigma_mm;
            let part = if of_tile > 1 { within as f64 / (of_tile - 1) as f64 } else { 0.5 };
            let at = edge + part * (side - 2.0 * edge);
            let pixel = ((at / pixel_mm).floor() + 0.5) * pixel_mm;
            (tile as f64 * (side + gap_mm) + pixel) * 1e-3
        });
        let light = WallLight { point: Point2::from(place), sigma: sigma_mm * 1e-3, peak: red_peak, colour: RED };
        Some((number as u32, light))
    }

    /// The board as the wall shows it at `time`; `None` on a display that is off.
    pub(crate) fn board(&self, time: Time) -> Option<ShownBoard> {
        self.board_at(self.shown_s(time)).filter(|it| !self.is_dark(&it.first))
    }

    /// The board at the place that is due at `time_s` after all before it; `None` before the first and after the last.
    fn board_at(&self, time_s: f64) -> Option<ShownBoard> {
        let WallSettings { tiles, tile_px, pixel_mm, gap_mm, board, .. } = self.0.settings;
        let BoardSettings { corners, square_px, grid, each_ms } = board?;
        let number = Some((time_s * 1e3 / each_ms).floor()).filter(|it| *it >= 0.0)? as u64;
        let [columns, rows] = [0, 1].map(|axis| u64::from(tiles[axis] * grid[axis]));
        if number >= columns * rows {
            return None;
        }
        let cell = [number % columns, number / columns];
        let first = [0, 1].map(|axis| {
            let of_tile = u64::from(grid[axis]);
            let (tile, within) = (cell[axis] / of_tile, cell[axis] % of_tile);
            let free = f64::from(tile_px[axis] - (corners[axis] + 3) * square_px);
            let part = if of_tile > 1 { within as f64 / (of_tile - 1) as f64 } else { 0.5 };
            let pixel = (part * free).floor() + f64::from(2 * square_px);
            (tile as f64 * (f64::from(tile_px[axis]) * pixel_mm + gap_mm) + pixel * pixel_mm) * 1e-3
        });
        Some(ShownBoard { number, first: first.into(), square: f64::from(square_px) * pixel_mm * 1e-3, corners })
    }

    /// When the last dot ends, by its command [s]; 0 without dots.
    pub fn dots_end_s(&self) -> f64 {
        let WallSettings { tiles, dots, .. } = self.0.settings;
        dots.map_or(0.0, |it| f64::from(tiles[0] * it.grid[0]) * f64::from(tiles[1] * it.grid[1]) * it.each_ms * 1e-3)
    }

    /// Windows at `time`, the last one in front; none while dots are shown.
    pub(crate) fn windows(&self, time: Time) -> impl Iterator<Item = Window> + '_ {
        let at_s = self.shown_s(time);
        let has_contents = !self.calibrates();
        self.0.contents.windows(at_s).filter(move |_| has_contents)
    }

    /// How bright a display is at `time`, relative to how its contents are by themselves: they shine and fade.
    pub(crate) fn shine(&self, tile: [u32; 2], time: Time) -> f64 {
        if Some(tile) == self.0.settings.dark_tile || self.calibrates() {
            return 0.0;
        }
        self.0.contents.shine(tile, self.shown_s(time))
    }

    /// Of which colour a display's contents are, by plane, none above 1.
    pub(crate) fn tint(&self, tile: [u32; 2]) -> [f64; 3] {
        self.0.contents.tint(tile)
    }

    /// What the wall's own picture reads at a point that belongs to a display, between black and white, without windows and spots [0, 1].
    pub(crate) fn texture(&self, point: &Point2<f64>) -> f64 {
        // Gradients, and lines of text in blocks.
        let wave = 0.5 + 0.25 * (3.1 * point.x + 1.7 * point.y).sin() + 0.2 * (1.3 * point.x - 4.3 * point.y).sin();
        let block = ((point.x / 0.31).floor() + (point.y / 0.23).floor()).rem_euclid(2.0) < 1.0;
        let line = (point.y / 0.012).floor().rem_euclid(2.0) < 1.0;
        if block && line { 0.15 * wave } else { wave }
    }
}

/// A point of the wall as messages have it: in the wall's own space, whose z is 0.
pub(crate) fn in_wall_space(point: &Point2<f64>) -> Point3<f64> {
    Point3::new(point.x, point.y, 0.0)
}

#[cfg(test)]
mod tests;
