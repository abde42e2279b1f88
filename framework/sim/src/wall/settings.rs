//! What a simulated wall is like.

use foveate_node::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::board::BoardSettings;
use super::shape::{CurveSettings, StandSettings};
use super::wave::WaveSettings;
use crate::truth::TruthSettings;

/// Tiles, what they show, and who points at them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WallSettings {
    /// Displays along rows and columns, 1 to 16 each [–].
    pub tiles: [u32; 2],
    /// Pixels of each of them along rows and columns, 64 to 8192 each [px].
    pub tile_px: [u32; 2],
    /// Side of a pixel of the wall [mm].
    #[schemars(range(min = 0.05, max = 20.0))]
    pub pixel_mm: f64,
    /// From the last pixel of a display to the first of the next: two bezels and the slit between them [mm].
    #[schemars(range(min = 0.0, max = 200.0))]
    pub gap_mm: f64,
    /// A display that is off, as column and row from 0. Left out: all are on [–].
    pub dark_tile: Option<[u32; 2]>,
    /// People who point, each with a laser pointer [–].
    #[schemars(range(min = 0, max = 16))]
    pub users: u32,
    /// In every second part of their paths, pairs of users exchange places, on paths that cross in the middle [–].
    pub cross: bool,
    /// Duration of a part of a path: from one place to the next, with least jerk (T. Flash and N. Hogan, J. Neuroscience 5(7), 1985) [s].
    #[schemars(range(min = 0.2, max = 60.0))]
    pub part_s: f64,
    /// Half of the range in which a hand at rest moves the spot, taken as two standard deviations; the default is what B. Myers et al., "Interacting at a
    /// distance" (CHI 2002) saw [px of the wall].
    #[schemars(range(min = 0.0, max = 200.0))]
    pub tremor_px: f64,
    /// In each time of this length a user lets go of the button once or twice [s].
    #[schemars(range(min = 1.0, max = 600.0))]
    pub press_s: f64,
    /// What the middle of a spot would read in a camera of gain 1 that does not saturate [gray level].
    #[schemars(range(min = 0.0, max = 20000.0))]
    pub pointer_peak: f64,
    /// By user, what red, green and blue pixels of a colour camera read of the pointer, relative to `pointer_peak`; those of users beyond the list are white [–].
    pub pointer_rgb: Vec<[f64; 3]>,
    /// By user, how often the pointer goes dark: once in so long, for `dark_ms`; the pointers of users beyond the list are steady [ms].
    pub blink_ms: Vec<f64>,
    /// How long a pointer that blinks is dark each time [ms].
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub dark_ms: f64,
    /// By how much the clocks of pointers that blink are off, standard deviation, drawn once each [%].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub blink_clock_percent: f64,
    /// A spot's reflection in the bezel beside it, relative to the spot; cameras on the spot's side of the bezel see it, each elsewhere [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub reflection: f64,
    /// Gray level of the wall's white in a camera of gain 1 [gray level].
    #[schemars(range(min = 0.0, max = 500.0))]
    pub white: f64,
    /// Bright windows that move over the wall [–].
    #[schemars(range(min = 0, max = 16))]
    pub windows: u32,
    /// Small red spots in what the wall shows: a third stands still, a third moves, a third jumps [–].
    #[schemars(range(min = 0, max = 500))]
    pub red_spots: u32,
    /// What the brightest of them, and dots for calibrating, read in the middle in a camera of gain 1 [gray level].
    #[schemars(range(min = 0.0, max = 500.0))]
    pub red_peak: f64,
    /// Latency from the command to show something to its appearance [ms].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub display_latency_ms: f64,
    /// Pictures that the wall shows in a second [Hz].
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub refresh_hz: f64,
    /// Dots for calibrating, one at a time, in place of contents and users. Left out: none [–].
    pub dots: Option<DotSettings>,
    /// A chessboard for calibrating, at one place after another, in place of contents and users. Left out: none [–].
    pub board: Option<BoardSettings>,
    /// A pointer for calibrating, held at places of the wall and then waved over it, in place of users; the wall is dark. Left out: none [–].
    pub wave: Option<WaveSettings>,
    /// How the wall is bent. Left out: it is flat [–].
    pub curve: Option<CurveSettings>,
    /// Where it stands in the room of the cameras, of which only those before it see it. Left out: the cameras stand in the wall's own space [–].
    pub stand: Option<StandSettings>,
    /// Rate of the truth and of what is shown [Hz].
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub truth_hz: f64,
    /// True cameras, apart from the rig's calibration. Left out: they are as the calibration says [–].
    pub truth: Option<TruthSettings>,
}

/// Dots for calibrating.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DotSettings {
    /// On each display along rows and columns, 1 to 50 each [–].
    pub grid: [u32; 2],
    /// How long each is shown [ms].
    #[schemars(range(min = 20.0, max = 10000.0))]
    pub each_ms: f64,
    /// Standard deviation of its light about its middle [mm].
    #[schemars(range(min = 0.5, max = 50.0))]
    pub sigma_mm: f64,
}

impl Default for DotSettings {
    fn default() -> Self {
        Self { grid: [8, 5], each_ms: 100.0, sigma_mm: 5.0 }
    }
}

impl Default for WallSettings {
    fn default() -> Self {
        Self {
            tiles: [4, 2],
            tile_px: [1280, 800],
            pixel_mm: 0.8,
            gap_mm: 12.0,
            dark_tile: None,
            users: 4,
            cross: true,
            part_s: 1.2,
            tremor_px: 8.0,
            press_s: 3.0,
            pointer_peak: 2000.0,
            pointer_rgb: Vec::new(),
            blink_ms: Vec::new(),
            dark_ms: 20.0,
            blink_clock_percent: 0.2,
            reflection: 0.3,
            white: 120.0,
            windows: 3,
            red_spots: 24,
            red_peak: 190.0,
            display_latency_ms: 30.0,
            refresh_hz: 60.0,
            dots: None,
            board: None,
            wave: None,
            curve: None,
            stand: None,
            truth_hz: 60.0,
            truth: None,
        }
    }
}

impl WallSettings {
    /// Refuses what is out of range or contradicts itself.
    ///
    /// # Errors
    /// The first such setting.
    pub fn check(&self) -> Result<(), ConfigError> {
        for axis in 0..2 {
            ConfigError::unless_in("tiles", self.tiles[axis], 1..=16)?;
            ConfigError::unless_in("tile_px", self.tile_px[axis], 64..=8192)?;
        }
        ConfigError::unless_in("pixel_mm", self.pixel_mm, 0.05..=20.0)?;
        ConfigError::unless_in("gap_mm", self.gap_mm, 0.0..=200.0)?;
        ConfigError::unless_in("users", self.users, 0..=16)?;
        ConfigError::unless_in("part_s", self.part_s, 0.2..=60.0)?;
        ConfigError::unless_in("tremor_px", self.tremor_px, 0.0..=200.0)?;
        ConfigError::unless_in("press_s", self.press_s, 1.0..=600.0)?;
        ConfigError::unless_in("pointer_peak", self.pointer_peak, 0.0..=20_000.0)?;
        for part in self.pointer_rgb.iter().flatten() {
            ConfigError::unless_in("pointer_rgb", *part, 0.0..=1.0)?;
        }
        ConfigError::unless_in("dark_ms", self.dark_ms, 0.1..=1000.0)?;
        ConfigError::unless_in("blink_clock_percent", self.blink_clock_percent, 0.0..=10.0)?;
        for period in &self.blink_ms {
            ConfigError::unless_in("blink_ms", *period, self.dark_ms..=10_000.0)?;
        }
        ConfigError::unless_in("reflection", self.reflection, 0.0..=1.0)?;
        ConfigError::unless_in("white", self.white, 0.0..=500.0)?;
        ConfigError::unless_in("windows", self.windows, 0..=16)?;
        ConfigError::unless_in("red_spots", self.red_spots, 0..=500)?;
        ConfigError::unless_in("red_peak", self.red_peak, 0.0..=500.0)?;
        ConfigError::unless_in("display_latency_ms", self.display_latency_ms, 0.0..=1000.0)?;
        ConfigError::unless_in("refresh_hz", self.refresh_hz, 1.0..=1000.0)?;
        ConfigError::unless_in("truth_hz", self.truth_hz, 1.0..=1000.0)?;
        if let Some([column, row]) = self.dark_tile
            && (column >= self.tiles[0] || row >= self.tiles[1])
        {
            let [columns, rows] = self.tiles;
            let message = format!("found [{column}, {row}], expected a column below {columns} and a row below {rows}");
            return Err(ConfigError::at("dark_tile", message));
        }
        if let Some(DotSettings { grid, each_ms, sigma_mm }) = self.dots {
            for axis in grid {
                ConfigError::unless_in("dots.grid", axis, 1..=50)?;
            }
            ConfigError::unless_in("dots.each_ms", each_ms, 20.0..=10_000.0)?;
            ConfigError::unless_in("dots.sigma_mm", sigma_mm, 0.5..=50.0)?;
        }
        self.check_board()?;
        if let Some(WaveSettings { touch_m, hold_s, miss_mm }) = &self.wave {
            ConfigError::unless_in("wave.hold_s", *hold_s, 0.1..=60.0)?;
            ConfigError::unless_in("wave.miss_mm", *miss_mm, 0.0..=100.0)?;
            for at in touch_m.iter().flatten() {
                ConfigError::unless_in("wave.touch_m", *at, -1000.0..=1000.0)?;
            }
        }
        if let Some(CurveSettings { radius_m, sag_mm }) = self.curve {
            ConfigError::unless_in("curve.sag_mm", sag_mm, 0.0..=500.0)?;
            ConfigError::unless_in("curve.radius_m", radius_m.abs(), 1.0..=1e6)?;
        }
        if let Some(StandSettings { upper_left_m, turned_deg }) = self.stand {
            ConfigError::unless_in("stand.turned_deg", turned_deg, -360.0..=360.0)?;
            for at in upper_left_m {
                ConfigError::unless_in("stand.upper_left_m", at, -1000.0..=1000.0)?;
            }
        }
        let shown = [("dots", self.dots.is_some()), ("board", self.board.is_some()), ("wave", self.wave.is_some())];
        let mut shown = shown.into_iter().filter(|it| it.1).map(|it| it.0);
        if let (Some(first), Some(second)) = (shown.next(), shown.next()) {
            return Err(ConfigError::at(second, format!("found it beside `{first}`, expected one of them at a time")));
        }
        Ok(())
    }

    fn check_board(&self) -> Result<(), ConfigError> {
        let Some(BoardSettings { corners, square_px, grid, each_ms }) = self.board else { return Ok(()) };
        ConfigError::unless_in("board.square_px", square_px, 4..=1000)?;
        ConfigError::unless_in("board.each_ms", each_ms, 20.0..=10_000.0)?;
        for axis in 0..2 {
            ConfigError::unless_in("board.corners", corners[axis], 3..=30)?;
            ConfigError::unless_in("board.grid", grid[axis], 1..=20)?;
            // A margin of a square to either side of the outer squares.
            let (found, most) = ((corners[axis] + 3) * square_px, self.tile_px[axis]);
            if found > most {
                let message = format!(
                    "found squares that take up {found} px with their margin, expected at most the display's {most}"
                );
                return Err(ConfigError::at("board.square_px", message));
            }
        }
        Ok(())
    }
}
