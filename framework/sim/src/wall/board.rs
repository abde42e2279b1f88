//! A chessboard that a simulated wall shows at one place after another, and how a camera that blurs it sees it.

use nalgebra::{Point2, Vector2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A chessboard for calibrating.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BoardSettings {
    /// Inner corners along its rows and columns, 3 to 30 each [–].
    pub corners: [u32; 2],
    /// Side of a square [px of the wall].
    #[schemars(range(min = 4, max = 1000))]
    pub square_px: u32,
    /// Places on each display along rows and columns, 1 to 20 each [–].
    pub grid: [u32; 2],
    /// How long it is at each [ms].
    #[schemars(range(min = 20.0, max = 10000.0))]
    pub each_ms: f64,
}

impl Default for BoardSettings {
    fn default() -> Self {
        Self { corners: [7, 4], square_px: 70, grid: [3, 3], each_ms: 400.0 }
    }
}

/// The board at one of its places, with a bright margin as wide as a square.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct ShownBoard {
    /// Which place.
    pub number: u64,
    /// The first inner corner [m].
    pub first: Point2<f64>,
    /// Side of a square [m].
    pub square: f64,
    /// Inner corners along rows and columns.
    pub corners: [u32; 2],
}

impl ShownBoard {
    /// The inner corners, row by row [m].
    pub fn points(&self) -> impl Iterator<Item = Point2<f64>> + '_ {
        let [columns, rows] = self.corners;
        let all = (0..rows).flat_map(move |row| (0..columns).map(move |column| (column, row)));
        all.map(|(column, row)| self.first + Vector2::new(f64::from(column), f64::from(row)) * self.square)
    }

    /// Upper left and lower right of the margin [m].
    pub fn bounds(&self) -> [Point2<f64>; 2] {
        let [columns, rows] = self.corners.map(f64::from);
        let reach = Vector2::new(columns + 1.0, rows + 1.0) * self.square;
        [self.first - Vector2::repeat(2.0 * self.square), self.first + reach]
    }

    /// How bright it is at a point, between black and white, where a camera blurs it by `sigma` along x and y [m].
    pub fn level(&self, point: &Point2<f64>, sigma: [f64; 2]) -> f64 {
        let [mut paper, mut inside, mut wave] = [1.0; 3];
        for axis in 0..2 {
            let at = (point[axis] - self.first[axis]) / self.square;
            let width = (sigma[axis] / self.square).max(1e-6);
            let n = self.corners[axis];
            let last = f64::from(n);
            let step = |edge: f64| blurred_step((at - edge) / width);
            paper *= step(-2.0) - step(last + 1.0);
            inside *= step(-1.0) - step(last);
            // The first square is 1, the next −1, and so on; 0 beside the board.
            let mut sum = step(-1.0);
            let mut sign = -2.0;
            for edge in 0..n {
                sum += sign * step(f64::from(edge));
                sign = -sign;
            }
            wave *= sum + sign / 2.0 * step(last);
        }
        // Where both waves have one sign a square is dark.
        paper - (inside + wave) / 2.0
    }
}

/// From 0 to 1 around 0, by about a standard deviation to either side: the logistic curve nearest to the normal distribution.
fn blurred_step(sigmas: f64) -> f64 {
    const STEEPNESS: f64 = 1.702;
    const FAR: f64 = 8.0;
    if sigmas.abs() > FAR {
        return if sigmas > 0.0 { 1.0 } else { 0.0 };
    }
    1.0 / (1.0 + (-STEEPNESS * sigmas).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn squares_are_dark_and_bright_in_turn_and_half_way_at_their_corners() {
        for corners in [[7, 4], [4, 4], [3, 5]] {
            let board = ShownBoard { number: 0, first: Point2::new(1.0, 0.5), square: 0.05, corners };
            let at = |column: f64, row: f64| {
                board.level(&(board.first + Vector2::new(column, row) * board.square), [0.003, 0.002])
            };
            for row in -2..=corners[1] as i32 {
                for column in -2..=corners[0] as i32 {
                    let margin = [column, row].contains(&-2) || column == corners[0] as i32 || row == corners[1] as i32;
                    let expected = if !margin && (column + row) % 2 == 0 { 0.0 } else { 1.0 };
                    let found = at(f64::from(column) + 0.5, f64::from(row) + 0.5);
                    assert!((found - expected).abs() < 1e-3, "{corners:?}, square {column}, {row}: {found}");
                }
            }
            for point in board.points() {
                assert!((board.level(&point, [0.003, 0.002]) - 0.5).abs() < 1e-3);
            }
            assert!(at(-2.5, 0.5) < 1e-3, "beside the margin it is dark");
        }
    }
}
