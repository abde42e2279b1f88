//! Finds all inner corners of a chessboard in a gray picture, to a fraction of a pixel.
//!
//! 1. `saddles`: where four squares meet, brightness has a saddle; each is known to a fraction of a pixel, with the directions of the
//!    two edges that cross there and which of the four quadrants are bright.
//! 2. `grid`: from a saddle on, neighbours are added where the steps so far lead to expect one whose quadrants are the other way
//!    round, until nothing more fits. Squares may be slanted and of any proportion; a corner that is hidden is supplied by its neighbours.
//! 3. Each corner is placed where the edges around it meet: all gradients are across the way to it (W. Förstner, E. Gülch, "A fast
//!    operator for detection and precise location of distinct points, corners and centres of circular features", 1987).
//!
//! Order: rows of corners, seen with the printed face towards the camera, so that rows follow one another clockwise from columns. The square
//! before corner 0, and with it that between the corners 0, 1, `columns` and `columns + 1`, is dark where the board has such an end; what is
//! still open (see `Board::chessboard` in `calibration`) begins at the upper left of the picture.

mod grid;
mod saddles;

use nalgebra::{Matrix2, Point2, Vector2};

use crate::ImageView;
use saddles::{Plane, from_resized};

/// An inner corner.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Its place in the picture [px].
    pub centre: Point2<f64>,
    /// Covariance of the place [px²].
    pub covariance: Matrix2<f64>,
}

/// How a picture is searched, in turn until the board is found: with so many times as many columns and rows, smoothed so often.
const SEARCHES: [([f64; 2], u32); 4] = [
    ([1.0, 1.0], 1),
    // Blurred squares.
    ([0.5, 0.5], 1),
    // Boards that lie far off on a floor; where white outshines black, squares no longer touch unless smoothed.
    ([0.5, 2.0], 2),
    // Small squares; this takes the longest.
    ([2.0, 2.0], 1),
];
/// Difference between dark and bright squares, at least [gray level].
const MIN_CONTRAST: f64 = 8.0;
/// No corner is taken to be known better than this [px].
const BEST_SIGMA: f64 = 0.02;
/// Corners are placed by what is at most this far to either side, in squares.
const REACH: f64 = 0.55;
/// And in pixels.
const REACH_PX: f64 = 8.0;
/// Samples to either side.
const SAMPLES: i32 = 8;
/// A corner that is placed further than this from where it was found is another, in squares.
const FAR: f64 = 0.5;

/// Detects a board of `columns` × `rows` inner corners: corner `row · columns + column` of the result. `None` when the whole of such a board is
/// not in the picture, or when fewer than 3 corners either way were requested.
///
/// ```
/// use foveate_imaging::{ImageView, find_chessboard};
///
/// // 8 x 6 squares of 20 px on white, so 7 x 5 inner corners; edges lie between pixels, at 39.5, 59.5, ... px.
/// let (size, square) = ([240, 200], 20);
/// let level = |at: usize| {
///     let [x, y] = [at % size[0], at / size[0]];
///     let is_board = (40..200).contains(&x) && (40..160).contains(&y);
///     if is_board && (x / square + y / square) % 2 == 0 { 40 } else { 220 }
/// };
/// let pixels: Vec<u8> = (0..size[0] * size[1]).map(level).collect();
/// let image = ImageView::new(&pixels, size[0], size[1])?;
///
/// let corners = find_chessboard(&image, 7, 5).expect("the whole board is in view");
/// assert_eq!(corners.len(), 7 * 5);
/// for corner in &corners {
///     let [x, y] = [corner.centre.x, corner.centre.y].map(|it| (it - 19.5) / 20.0);
///     assert!((x - x.round()).hypot(y - y.round()) * 20.0 < 0.05, "px off the true grid: {corner:?}");
/// }
/// assert!(find_chessboard(&image, 8, 5).is_none(), "another board");
/// # Ok::<(), foveate_imaging::ImagingError>(())
/// ```
pub fn find_chessboard(image: &ImageView<'_>, columns: usize, rows: usize) -> Option<Vec<Corner>> {
    if columns < 3 || rows < 3 || columns.saturating_mul(rows) > 10_000 {
        return None;
    }
    let whole = Plane::of(image);
    if !may_hold_board(&whole) {
        return None;
    }
    SEARCHES.into_iter().find_map(|(size, passes)| {
        let size = Vector2::from(size);
        let mut smooth = whole.resized(size);
        (0..passes).for_each(|_| smooth = smooth.blurred());
        let grid = grid::grow(&smooth, &saddles::find(&smooth), columns, rows)?;
        let ordered: Vec<Point2<f64>> =
            ordered(&smooth, &grid, columns, rows)?.into_iter().map(|it| from_resized(it, size)).collect();
        (0..ordered.len()).map(|at| place(&whole, ordered[at], steps(&ordered, at, columns))).collect()
    })
}

/// Corners (columns, rows) of the largest chessboard in the picture, the longer side first; `None` without one of at least 3 × 3. For messages about
/// a picture in which [`find_chessboard`] did not find the expected board.
pub fn largest_grid(image: &ImageView<'_>) -> Option<[usize; 2]> {
    let whole = Plane::of(image);
    if !may_hold_board(&whole) {
        return None;
    }
    let grids = SEARCHES.into_iter().filter_map(|(size, passes)| {
        let mut smooth = whole.resized(Vector2::from(size));
        (0..passes).for_each(|_| smooth = smooth.blurred());
        grid::largest(&saddles::find(&smooth))
    });
    grids.max_by_key(|it| it[0] * it[1])
}

/// Whether a picture has enough contrast for a board anywhere, noise of single pixels apart.
fn may_hold_board(whole: &Plane) -> bool {
    let smooth = whole.blurred();
    let (least, most) = smooth.values.iter().fold((f32::MAX, f32::MIN), |(a, b), it| (a.min(*it), b.max(*it)));
    f64::from(most - least) >= MIN_CONTRAST
}

/// From a corner to the next in its row and in its column, as columns: the mean of both sides where it has two.
fn steps(corners: &[Point2<f64>], at: usize, columns: usize) -> Matrix2<f64> {
    let (column, row, rows) = (at % columns, at / columns, corners.len() / columns);
    let step = |place: usize, n: usize, stride: usize| {
        let (before, after) = (usize::from(place > 0), usize::from(place + 1 < n));
        (corners[at + after * stride] - corners[at - before * stride]) / (before + after) as f64
    };
    Matrix2::from_columns(&[step(column, columns, 1), step(row, rows, columns)])
}

/// Moves a corner to where the edges around it meet. The surroundings are as slanted as the squares are.
fn place(plane: &Plane, start: Point2<f64>, steps: Matrix2<f64>) -> Option<Corner> {
    let in_squares = steps.try_inverse()?;
    let reach = |step: f64| REACH.min(REACH_PX / step);
    let reaches = Matrix2::from_diagonal(&Vector2::new(reach(steps.column(0).norm()), reach(steps.column(1).norm())));
    let window = steps * reaches / f64::from(SAMPLES);
    let mut centre = start;
    let mut covariance = Matrix2::zeros();
    for _ in 0..12 {
        let (mut normal, mut side, mut gradients) = (Matrix2::zeros(), Vector2::zeros(), Vec::new());
        for down in -SAMPLES..=SAMPLES {
            for across in -SAMPLES..=SAMPLES {
                let offset = window * Vector2::new(f64::from(across), f64::from(down));
                let gradient = plane.gradient(centre + offset)?;
                let outer = gradient * gradient.transpose();
                normal += outer;
                side += outer * offset;
                gradients.push((gradient, offset));
            }
        }
        let inverse = normal.try_inverse()?;
        let step = inverse * side;
        centre += step;
        let moved = in_squares * (centre - start);
        if moved.norm().is_nan() || moved.norm() > FAR {
            return None;
        }
        let misses: f64 = gradients.iter().map(|(gradient, offset)| gradient.dot(&(offset - step)).powi(2)).sum();
        covariance = inverse * (misses / gradients.len() as f64) + Matrix2::identity() * (BEST_SIGMA * BEST_SIGMA);
        if step.norm() < 1e-3 {
            break;
        }
    }
    Some(Corner { centre, covariance })
}

/// The corners, which come as `columns` × `rows` or turned or mirrored, in the order that the module promises.
fn ordered(plane: &Plane, grid: &grid::Grid, columns: usize, rows: usize) -> Option<Vec<Point2<f64>>> {
    let mut best: Option<(bool, f64, Vec<Point2<f64>>)> = None;
    for turn in 0..8 {
        let corner = |column: usize, row: usize| {
            let (x, y) = if turn & 4 == 0 { (column, row) } else { (row, column) };
            let x = if turn & 1 == 0 { x } else { grid.width - 1 - x };
            let y = if turn & 2 == 0 { y } else { grid.height - 1 - y };
            grid.corners[y * grid.width + x]
        };
        let fits = if turn & 4 == 0 {
            (grid.width, grid.height) == (columns, rows)
        } else {
            (grid.width, grid.height) == (rows, columns)
        };
        if !fits {
            continue;
        }
        let (along, down) = (corner(1, 0) - corner(0, 0), corner(0, 1) - corner(0, 0));
        if along.perp(&down) <= 0.0 {
            continue;
        }
        let mut difference = 0.0;
        for row in 0..rows - 1 {
            for column in 0..columns - 1 {
                let middle = (corner(column, row).coords
                    + corner(column + 1, row + 1).coords
                    + corner(column + 1, row).coords
                    + corner(column, row + 1).coords)
                    / 4.0;
                let sign = if (column + row) % 2 == 0 { -1.0 } else { 1.0 };
                difference += sign * plane.at(middle.into())?;
            }
        }
        let squares = ((rows - 1) * (columns - 1)) as f64;
        if 2.0 * difference.abs() / squares < MIN_CONTRAST {
            return None;
        }
        let first = corner(0, 0);
        let candidate = (difference > 0.0, -(first.x + first.y));
        if best.as_ref().is_none_or(|it| candidate.0 && !it.0 || candidate.0 == it.0 && candidate.1 > it.1) {
            let all = (0..rows)
                .flat_map(|row| (0..columns).map(move |column| (column, row)))
                .map(|(column, row)| corner(column, row));
            best = Some((candidate.0, candidate.1, all.collect()));
        }
    }
    best.map(|it| it.2)
}

#[cfg(test)]
mod tests;
