//! What is printed on a board: its marks, their places on it, and the ways in which it may be turned without looking different.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::BoardError;

/// A rigid board with numbered marks on a plane.
///
/// Its space [m]: the origin is at mark 0, X along the first row of marks, Y against the order of the rows, Z out of the printed face: of a
/// board that lies on the floor, Z is up.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    /// A description with its size, for messages.
    pub name: String,
    places: BTreeMap<u32, Point3<f64>>,
    turns: Vec<Isometry3<f64>>,
}

impl Board {
    /// A chessboard of `columns` × `rows` inner corners; corner `row · columns + column`.
    ///
    /// Turned by 180° it looks the same if `columns + rows` is even; a square one also turned by 90° if `columns` is even. Which way
    /// round it lies in a picture is then open; [`super::calibrate`] settles it by what several cameras saw.
    ///
    /// # Errors
    /// [`BoardError::BadBoard`] for fewer than 2 × 2 corners or a square that is not larger than 0.
    pub fn chessboard(columns: u32, rows: u32, square_m: f64) -> Result<Board, BoardError> {
        let name = format!("chessboard of {columns} x {rows} corners, squares of {} mm", square_m * 1e3);
        let mut board = Board::grid(name, columns, rows, square_m)?;
        let middle = Vector3::new(f64::from(columns - 1), -f64::from(rows - 1), 0.0) * (square_m / 2.0);
        let quarters: &[u32] = match (columns == rows, (columns + rows).is_multiple_of(2), columns.is_multiple_of(2)) {
            (true, _, true) => &[1, 2, 3],
            (_, true, _) => &[2],
            _ => &[],
        };
        board.turns.extend(quarters.iter().map(|quarter| {
            let turn =
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), f64::from(*quarter) * std::f64::consts::FRAC_PI_2);
            Translation3::from(middle) * turn * Translation3::from(-middle)
        }));
        Ok(board)
    }

    /// The inner corners of a ChArUco board of `columns` × `rows` **squares**, numbered along the rows as OpenCV does.
    ///
    /// # Errors
    /// [`BoardError::BadBoard`] for fewer than 3 × 3 squares or a square that is not larger than 0.
    pub fn charuco(columns: u32, rows: u32, square_m: f64) -> Result<Board, BoardError> {
        let name = format!("ChArUco board of {columns} x {rows} squares of {} mm", square_m * 1e3);
        Board::grid(name, columns.saturating_sub(1), rows.saturating_sub(1), square_m)
    }

    fn grid(name: String, columns: u32, rows: u32, square_m: f64) -> Result<Board, BoardError> {
        if !((2..=200).contains(&columns) && (2..=200).contains(&rows) && square_m.is_finite() && square_m > 0.0) {
            let found = format!("{columns} x {rows} inner corners, squares of {square_m} m");
            return Err(BoardError::BadBoard {
                found,
                expected: "2 to 200 inner corners each way, squares larger than 0 m",
            });
        }
        let place = |id: u32| {
            let (column, row) = (f64::from(id % columns), f64::from(id / columns));
            Point3::new(column * square_m, -row * square_m, 0.0)
        };
        let places = (0..columns * rows).map(|id| (id, place(id))).collect();
        Ok(Board { name, places, turns: vec![Isometry3::identity()] })
    }

    /// Place of mark `id` on the board [m]; `None` if it has no such mark.
    pub fn place(&self, id: u32) -> Option<Point3<f64>> {
        self.places.get(&id).copied()
    }

    /// All marks with their places, by number.
    pub fn marks(&self) -> impl Iterator<Item = (u32, Point3<f64>)> + '_ {
        self.places.iter().map(|(id, place)| (*id, *place))
    }

    /// Symmetries: rotations of the board in its plane after which it looks the same, the identity first.
    pub fn turns(&self) -> &[Isometry3<f64>] {
        &self.turns
    }

    /// Largest distance between two marks [m].
    pub fn size(&self) -> f64 {
        let points: Vec<&Point3<f64>> = self.places.values().collect();
        let farthest = |a: &Point3<f64>| points.iter().map(|b| (a - *b).norm()).fold(0.0, f64::max);
        points.iter().map(|it| farthest(it)).fold(0.0, f64::max)
    }

    /// The same board with rows that are longer by a part of their length.
    #[cfg(test)]
    pub(super) fn with_longer_rows(mut self, by: f64) -> Board {
        self.places.values_mut().for_each(|it| it.x *= 1.0 + by);
        self
    }

    /// The mark nearest to a place on the board.
    pub(super) fn nearest(&self, place: &Point3<f64>) -> u32 {
        let distance = |it: &Point3<f64>| (it - place).norm_squared();
        let nearest = self.places.iter().min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)));
        nearest.map_or(0, |(id, _)| *id)
    }
}
