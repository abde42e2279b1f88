//! Maps the wall to the desktop of its displays, in units of the input device.

use foveate::prelude::ConfigError;
use nalgebra::Vector2;

use crate::wall::Wall;

/// Largest resolution [1/mm]: a tenth of a millimetre is less than a hand's tremor.
const FINEST: f64 = 10.0;
/// Most units of the longer side, which old touch-screen drivers use too.
const MOST_UNITS: f64 = 65_535.0;

/// The desktop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Desktop {
    tiles: [u32; 2],
    /// Size of a display and of the gap after it, as a share of the wall [–].
    tile: [f64; 2],
    gap: [f64; 2],
    /// The position at the right and lower edges; the left and upper ones are 0 [units].
    pub(super) last: [i32; 2],
    /// Units per millimetre of the displays [1/mm].
    pub(super) per_mm: i32,
}

impl Desktop {
    /// The desktop on `wall` of `tiles` displays with gaps between them.
    ///
    /// # Errors
    /// No display, or gaps that fill the wall.
    pub(super) fn new(wall: &Wall, tiles: [u32; 2], gap_mm: f64) -> Result<Desktop, ConfigError> {
        ConfigError::unless_in("gap_mm", gap_mm, 0.0..=200.0)?;
        let (mut tile, mut gap, mut shown_mm) = ([1.0; 2], [0.0; 2], [0.0; 2]);
        for axis in 0..2 {
            ConfigError::unless_in("tiles", tiles[axis], 1..=100)?;
            let whole_mm = wall.size[axis] * 1e3;
            let n = f64::from(tiles[axis]);
            shown_mm[axis] = whole_mm - (n - 1.0) * gap_mm;
            if shown_mm[axis] < 1.0 {
                let message = format!(
                    "found {} gaps of {gap_mm} mm on {whole_mm:.0} mm of the wall, expected less than the wall",
                    n - 1.0
                );
                return Err(ConfigError::at("gap_mm", message));
            }
            (tile[axis], gap[axis]) = (shown_mm[axis] / n / whole_mm, gap_mm / whole_mm);
        }
        let per_mm = (MOST_UNITS / shown_mm[0].max(shown_mm[1])).min(FINEST).floor().max(1.0);
        let last = shown_mm.map(|it| (it * per_mm).round() as i32);
        Ok(Desktop { tiles, tile, gap, last, per_mm: per_mm as i32 })
    }

    /// Converts shares of the wall's width and height to units of the device. Points beyond the wall are clamped to its edge; points in a gap to the edge before it.
    pub(super) fn units(&self, part: &Vector2<f64>) -> [i32; 2] {
        [0, 1].map(|axis| {
            let (tile, gap) = (self.tile[axis], self.gap[axis]);
            let n = f64::from(self.tiles[axis]);
            let part = part[axis].clamp(0.0, 1.0);
            let before = (part / (tile + gap)).floor().min(n - 1.0);
            let within = ((part - before * (tile + gap)) / tile).min(1.0);
            ((before + within) / n * f64::from(self.last[axis])).round() as i32
        })
    }
}
