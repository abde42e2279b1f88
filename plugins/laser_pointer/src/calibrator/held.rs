//! Times and places of a printed chessboard that was held flat on the wall.

use foveate::prelude::*;
use nalgebra::{Point2, Rotation2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{BoardSize, Shown};

/// One place of a board that was held flat on the wall.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct HeldBoard {
    /// Start of the time in which it was still, in session time [s].
    pub from_s: f64,
    /// End of that time [s].
    pub until_s: f64,
    /// Its first inner corner on the wall: the upper left one when its rows are level [m].
    pub corner_m: [f64; 2],
    /// Side of a square [mm].
    pub square_mm: f64,
    /// Angle from the wall's x, to the right, to the board's rows, clockwise as seen from the front [deg].
    #[serde(default)]
    pub turned_deg: f64,
}

impl HeldBoard {
    /// The same in the form of a board that the wall shows.
    ///
    /// # Errors
    /// Times that are no interval, squares without a side.
    pub(super) fn shown(&self, [columns, rows]: BoardSize) -> Result<Shown, ConfigError> {
        let HeldBoard { from_s, until_s, corner_m, square_mm, turned_deg } = self.clone();
        ConfigError::unless_in("held.from_s", from_s, 0.0..=1e6)?;
        ConfigError::unless_in("held.square_mm", square_mm, 0.1..=10_000.0)?;
        ConfigError::unless_in("held.turned_deg", turned_deg, -360.0..=360.0)?;
        for at in corner_m {
            ConfigError::unless_in("held.corner_m", at, -1000.0..=1000.0)?;
        }
        if until_s.is_nan() || until_s <= from_s || until_s > 1e6 {
            let message = format!("found {until_s}, expected a time after `from_s`, {from_s}");
            return Err(ConfigError::at("held.until_s", message));
        }
        let turn = Rotation2::new(turned_deg.to_radians());
        let places = (0..rows).flat_map(|row| (0..columns).map(move |column| (column, row)));
        let points = places.map(|(column, row)| {
            let step = Vector2::new(f64::from(column), f64::from(row)) * (square_mm * 1e-3);
            Point2::from(corner_m) + turn * step
        });
        Ok(Shown { points: points.collect(), from: Time::from_s(from_s), until: Time::from_s(until_s) })
    }
}
