//! Resolves the order of a chessboard's corners, where cameras may see the wall upside down, or mirrored from behind.
//!
//! A board that is turned by half a turn or mirrored looks like itself, so that one picture of it is ambiguous. Boards at several places resolve it: under the right order of
//! corners one homography explains all pictures. From one board on, the next nearest is added in that order of its corners that the homography so far predicts
//! best; the best fit is taken.

use foveate::estimation::statistics::median;
use foveate::geometry::{PlaneMap, PlanePoint};
use nalgebra::{Matrix3, Point2};

/// Boards from which the search starts: one may be elsewhere than stated.
const STARTS: usize = 3;
/// The second best order must fit so many times worse than the best.
const CLEARLY: f64 = 4.0;
/// A board with a larger median error of its corners is elsewhere than stated [px].
const ELSEWHERE_PX: f64 = 3.0;

/// Inner corners of a board along its rows and columns.
pub type BoardSize = [u32; 2];

/// A board in a camera's pictures: its corners as numbered on the wall and as numbered by the detector.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SeenBoard {
    /// Its corners on the wall [m].
    pub(super) places: Vec<Point2<f64>>,
    /// The detector's pixels of the same corners, with standard deviations [px].
    pub(super) pixels: Vec<(Point2<f64>, f64)>,
}

impl SeenBoard {
    fn middle(&self) -> Point2<f64> {
        let sum = self.pixels.iter().fold(nalgebra::Vector2::zeros(), |sum, it| sum + it.0.coords);
        Point2::from(sum / self.pixels.len() as f64)
    }

    /// The four outer corners, or all, in an order of corners.
    fn points(&self, order: Order, size: BoardSize, outer: bool) -> Vec<PlanePoint> {
        let [columns, rows] = size.map(|it| it as usize);
        let is_outer =
            |at: usize| [0, columns - 1].contains(&(at % columns)) && [0, rows - 1].contains(&(at / columns));
        let own = self.places.iter().enumerate().filter(|it| !outer || is_outer(it.0));
        own.map(|(at, point)| {
            let (pixel, sigma) = self.pixels[order.corner(at, size)];
            PlanePoint { point: *point, pixel, sigma }
        })
        .collect()
    }
}

/// A symmetry of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Order {
    from_right: bool,
    from_below: bool,
    /// Columns and rows are exchanged: square boards only.
    crossed: bool,
}

impl Order {
    fn all(size: BoardSize) -> impl Iterator<Item = Order> {
        let n = if size[0] == size[1] { 8 } else { 4 };
        (0..n).map(|it| Order { from_right: it & 1 != 0, from_below: it & 2 != 0, crossed: it & 4 != 0 })
    }

    /// The detector's number of the wall's corner `at`.
    fn corner(self, at: usize, size: BoardSize) -> usize {
        let [columns, rows] = size.map(|it| it as usize);
        let (mut column, mut row) = (at % columns, at / columns);
        if self.crossed {
            (column, row) = (row, column);
        }
        if self.from_right {
            column = columns - 1 - column;
        }
        if self.from_below {
            row = rows - 1 - row;
        }
        row * columns + column
    }
}

/// The corners of all boards as points of known place, by board; `None` for a board that is elsewhere than stated.
///
/// # Errors
/// Why the order of corners is ambiguous.
pub(super) fn untangled(
    image_size: [u32; 2],
    boards: &[SeenBoard],
    size: BoardSize,
) -> Result<Vec<Option<Vec<PlanePoint>>>, String> {
    if boards.len() < 2 {
        return Err(format!(
            "it saw the board at {} places, expected several, in two or more rows and columns: from one place the orientation of the board is ambiguous",
            boards.len()
        ));
    }
    let mut found: Vec<(f64, Vec<Order>)> = (0..boards.len().min(STARTS))
        .flat_map(|start| Order::all(size).filter_map(move |order| grown(image_size, boards, size, start, order)))
        .collect();
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut found = found.into_iter();
    let Some((misses, orders)) = found.next() else {
        return Err("no homography fits its pictures of the board: was the board at the stated places?".into());
    };
    // Most ways to begin end at the same orders; another answer has most boards the other way round.
    let differs = |it: &Vec<Order>| 2 * it.iter().zip(&orders).filter(|(a, b)| a != b).count() >= boards.len();
    let second = found.find(|it| differs(&it.1)).map_or(f64::INFINITY, |it| it.0);
    if second < CLEARLY * misses.max(0.25) {
        return Err(format!(
            "it saw the board at {} places in one line: whether it sees them mirrored is ambiguous; expected places in two or more rows and columns",
            boards.len()
        ));
    }
    let all = |boards: &[(&SeenBoard, Order)]| -> Vec<PlanePoint> {
        boards.iter().flat_map(|(board, order)| board.points(*order, size, false)).collect()
    };
    let pairs: Vec<(&SeenBoard, Order)> = boards.iter().zip(orders).collect();
    let map = PlaneMap::fit(image_size, &all(&pairs)).map_err(|error| error.to_string())?;
    let kept = pairs.into_iter().map(|(board, order)| {
        let points = board.points(order, size, false);
        let misses: Vec<f64> = points
            .iter()
            .map(|it| map.pixel(&it.point).map_or(f64::INFINITY, |pixel| (pixel - it.pixel).norm()))
            .collect();
        median(&misses).is_some_and(|it| it < ELSEWHERE_PX).then_some(points)
    });
    Ok(kept.collect())
}

/// Orders of all boards when that of board `start` is `order`, and how well they fit: the median distance of outer corners [px].
fn grown(
    image_size: [u32; 2],
    boards: &[SeenBoard],
    size: BoardSize,
    start: usize,
    order: Order,
) -> Option<(f64, Vec<Order>)> {
    let mut orders: Vec<Option<Order>> = vec![None; boards.len()];
    orders[start] = Some(order);
    let mut points = boards[start].points(order, size, true);
    let mut homography = PlaneMap::homography(image_size, &points)?;
    let off = |homography: &Matrix3<f64>, points: &[PlanePoint]| -> f64 {
        let misses = points.iter().map(|it| {
            let at = homography * it.point.coords.push(1.0);
            if at.z > 0.0 { (at.xy() / at.z - it.pixel.coords).norm() } else { f64::INFINITY }
        });
        misses.sum::<f64>() / points.len() as f64
    };
    while let Some(next) = (0..boards.len()).filter(|it| orders[*it].is_none()).min_by(|a, b| {
        let away = |it: usize| {
            let known = orders.iter().zip(boards).filter(|it| it.0.is_some());
            known.map(|other| (other.1.middle() - boards[it].middle()).norm()).fold(f64::INFINITY, f64::min)
        };
        away(*a).total_cmp(&away(*b))
    }) {
        let of = |order: Order| off(&homography, &boards[next].points(order, size, true));
        let order = Order::all(size).min_by(|a, b| of(*a).total_cmp(&of(*b)))?;
        orders[next] = Some(order);
        points.extend(boards[next].points(order, size, true));
        homography = PlaneMap::homography(image_size, &points)?;
    }
    // Where others outvoted it, a board takes the order that they predict.
    let of = |board: &SeenBoard, order: Order| off(&homography, &board.points(order, size, true));
    let orders: Vec<Order> = boards
        .iter()
        .map(|board| Order::all(size).min_by(|a, b| of(board, *a).total_cmp(&of(board, *b))))
        .collect::<Option<_>>()?;
    let points: Vec<PlanePoint> =
        boards.iter().zip(&orders).flat_map(|(board, order)| board.points(*order, size, true)).collect();
    let homography = PlaneMap::homography(image_size, &points)?;
    let misses: Vec<f64> = points.iter().map(|it| off(&homography, std::slice::from_ref(it))).collect();
    Some((median(&misses)?, orders))
}
