//! Thins lines to the points that can be seen.

use crate::axes::Range;
use crate::svg::{Point, Rect};

/// Most points of all lines in a frame: about 200 kB.
pub const CHART_POINTS: usize = 20_000;

/// Drops points that lie closer than `tolerance` [px] to the last kept one; both ends stay.
fn spaced(points: &[Point], tolerance: f64) -> Vec<Point> {
    let mut kept: Vec<Point> = Vec::new();
    for (index, point) in points.iter().enumerate() {
        let far = kept.last().is_none_or(|last| (point[0] - last[0]).hypot(point[1] - last[1]) >= tolerance);
        if far || index + 1 == points.len() {
            kept.push(*point);
        }
    }
    kept
}

/// In each column of `width` [px] keeps the first, the last, the highest and the lowest point of a line that runs to the
/// right: it looks the same.
fn columns(points: &[Point], width: f64) -> Vec<Point> {
    let mut kept = Vec::new();
    for column in points.chunk_by(|a, b| (a[0] / width).floor() == (b[0] / width).floor()) {
        let last = column.len() - 1;
        let by_height = |index: &usize| column[*index][1];
        let lowest = (0..=last).max_by(|a, b| by_height(a).total_cmp(&by_height(b))).unwrap_or(0);
        let highest = (0..=last).min_by(|a, b| by_height(a).total_cmp(&by_height(b))).unwrap_or(0);
        let mut places = [0, lowest, highest, last];
        places.sort_unstable();
        for (index, place) in places.iter().enumerate() {
            if index == 0 || places[index - 1] != *place {
                kept.push(column[*place]);
            }
        }
    }
    kept
}

/// Thins lines of any shape, together, to about `limit` points.
pub fn thin_paths(lines: &mut [Vec<Point>], limit: usize) {
    thin(lines, limit, 0.4, spaced);
}

/// Thins lines that run to the right, together, to about `limit` points.
pub fn thin_courses(lines: &mut [Vec<Point>], limit: usize) {
    thin(lines, limit, 0.5, columns);
}

/// The first of all dots within half a pixel of one another in `rect`; none outside it.
pub fn thin_dots(dots: impl IntoIterator<Item = Point>, rect: Rect) -> Vec<Point> {
    let [columns, rows] = [rect.width, rect.height].map(|it| (2.0 * it).clamp(1.0, 10_000.0) as usize);
    let mut taken = vec![false; columns * rows];
    let mut is_free = |[x, y]: &Point| {
        let part = [(x - rect.left) / rect.width, (y - rect.top) / rect.height];
        if !part.iter().all(|it| (0.0..=1.0).contains(it)) {
            return false;
        }
        let cell = [(part[0] * columns as f64) as usize, (part[1] * rows as f64) as usize];
        !std::mem::replace(&mut taken[cell[1].min(rows - 1) * columns + cell[0].min(columns - 1)], true)
    };
    dots.into_iter().filter(|it| is_free(it)).collect()
}

/// At most `most` of the items, evenly spaced, starting with the first.
pub fn evenly<T>(items: &[T], most: usize) -> impl Iterator<Item = &T> {
    let n = items.len();
    let kept = n.min(most);
    (0..kept).map(move |it| &items[it * n / kept.max(1)])
}

fn thin(lines: &mut [Vec<Point>], limit: usize, start: f64, by: impl Fn(&[Point], f64) -> Vec<Point>) {
    let mut tolerance = start;
    for _ in 0..24 {
        lines.iter_mut().for_each(|line| *line = by(line, tolerance));
        if lines.iter().filter(|it| it.len() > 1).map(Vec::len).sum::<usize>() <= limit {
            break;
        }
        tolerance *= 1.5;
        // The ends of a line always stay, so of very many short lines those go that are only a dot.
        lines.iter_mut().filter(|line| extent(line) < tolerance).for_each(Vec::clear);
    }
}

/// The longer side of the box around `points` [px].
fn extent(points: &[Point]) -> f64 {
    [0, 1]
        .into_iter()
        .filter_map(|axis| Range::of(points.iter().map(|it| it[axis])))
        .map(|it| it.length())
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn course_keeps_its_envelope() {
        let points: Vec<Point> =
            (0..100_000_u32).map(|it| [f64::from(it) * 0.005, f64::from(it * 7919 % 1000)]).collect();
        let thinned = columns(&points, 1.0);
        assert!(thinned.len() <= 4 * 501, "{}", thinned.len());
        for (wide, thin) in points
            .chunk_by(|a, b| a[0].floor() == b[0].floor())
            .zip(thinned.chunk_by(|a, b| a[0].floor() == b[0].floor()))
        {
            let range = |points: &[Point]| {
                points.iter().fold((f64::MAX, f64::MIN), |(low, high), it| (low.min(it[1]), high.max(it[1])))
            };
            assert_eq!(range(wide), range(thin));
        }
    }

    #[test]
    fn path_keeps_its_ends_and_stays_near() {
        let points: Vec<Point> =
            (0..=1000).map(|it| f64::from(it) * 0.01).map(|it| [50.0 * it.cos(), 50.0 * it.sin()]).collect();
        let kept = spaced(&points, 2.0);
        assert!(kept.len() < 300);
        assert_eq!((kept.first(), kept.last()), (points.first(), points.last()));
    }

    #[test]
    fn dots_that_cannot_be_told_apart_are_one_and_those_outside_none() {
        let rect = Rect { left: 10.0, top: 20.0, width: 100.0, height: 50.0 };
        let many = (0..100_000_u32).map(|it| [10.0 + f64::from(it % 1009) * 0.1, 20.0 + f64::from(it % 997) * 0.06]);
        let kept = thin_dots(many.chain([[f64::NAN, 30.0], [30.0, f64::INFINITY], [500.0, 30.0]]), rect);
        assert!((10_000..=20_000).contains(&kept.len()), "{}", kept.len());
        assert!(kept.iter().all(|[x, y]| (10.0..=110.0).contains(x) && (20.0..=70.0).contains(y)));
        assert_eq!(thin_dots([[10.0, 20.0], [110.0, 70.0]], rect).len(), 2);
        assert!(thin_dots([[1.0, 1.0]], Rect::default()).is_empty());
    }

    #[test]
    fn even_choices_begin_with_the_first_and_hold_all_of_few() {
        assert_eq!(evenly(&[1, 2, 3, 4, 5, 6], 3).collect::<Vec<_>>(), [&1, &3, &5]);
        assert_eq!(evenly(&[1, 2], 7).count() + evenly::<u8>(&[], 7).count() + evenly(&[1], 0).count(), 2);
    }

    #[test]
    fn any_number_of_points_comes_below_the_limit() {
        let line: Vec<Point> = (0..200_000_u32).map(|it| [f64::from(it % 700), f64::from(it * 7919 % 600)]).collect();
        let mut lines = vec![line.clone(), line];
        thin_paths(&mut lines, 5000);
        assert!(lines.iter().map(Vec::len).sum::<usize>() <= 5000);
        let dots = |it: u32| vec![[f64::from(it) * 0.01, 0.0], [f64::from(it) * 0.01 + 0.3, 0.2]];
        let mut short: Vec<Vec<Point>> = (0..50_000).map(dots).collect();
        short.push(vec![[0.0, 0.0], [100.0, 100.0]]);
        thin_courses(&mut short, 5000);
        let kept: Vec<&Vec<Point>> = short.iter().filter(|it| it.len() > 1).collect();
        assert_eq!(kept, [&[[0.0, 0.0], [100.0, 100.0]]]);
    }
}
