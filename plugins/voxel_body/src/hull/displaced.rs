//! Where a silhouette would fit what the other views leave over: a camera that was moved, turned or mounted the wrong way shows by that.
//!
//! The hull of all other views is drawn into the picture, and shifted until it fits: body that it does not cover counts one, what it covers beside the body counts a half, for the hull of few views is larger
//! than the body. Shifts are searched from coarse to fine, in pictures of half the size each.

/// Which shift of a drawn hull fits a silhouette best.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// What the hull must be shifted by, columns and rows [px].
    pub shift: [i32; 2],
    /// Mismatch with that shift, of what it is without; 1 where it fits nowhere better [–].
    pub left_over: f64,
}

/// Cells of the coarsest picture along its longer side.
const COARSEST: usize = 40;
/// Shifts tried there, in cells, to each side.
const REACH: i32 = 14;
/// Shifts tried on each finer picture around twice the one before.
const AROUND: i32 = 2;

/// The best shift of `drawn` (not 0: hull) onto `body`, both of `width` columns; `None` where one of them is empty.
pub fn fit(body: &[bool], drawn: &[u8], width: usize) -> Option<Fit> {
    let drawn: Vec<bool> = drawn.iter().map(|it| *it > 0).collect();
    let boxes = [bounds(body, width)?, bounds(&drawn, width)?];
    // A frame that holds both.
    let low: [usize; 2] = std::array::from_fn(|axis| boxes[0][0][axis].min(boxes[1][0][axis]));
    let high: [usize; 2] = std::array::from_fn(|axis| boxes[0][1][axis].max(boxes[1][1][axis]));
    let cut = |of: &[bool]| Plane {
        columns: high[0] - low[0],
        rows: high[1] - low[1],
        set: (low[1]..high[1]).flat_map(|y| of[y * width + low[0]..y * width + high[0]].iter().copied()).collect(),
    };
    let mut levels = vec![(cut(body), cut(&drawn))];
    while levels.last().is_some_and(|it| it.0.columns.max(it.0.rows) > COARSEST) {
        let finest = levels.last().map(|(body, drawn)| (body.halved(), drawn.halved()));
        levels.extend(finest);
    }
    let (mut shift, mut reach) = ([0; 2], REACH);
    for (body, drawn) in levels.iter().rev() {
        let around = shift.map(|it| 2 * it);
        let tries = (-reach..=reach).flat_map(|y| (-reach..=reach).map(move |x| [around[0] + x, around[1] + y]));
        // Of equal ones the shortest, so that what is symmetric does not wander.
        let cost = |it: &[i32; 2]| (body.mismatch(drawn, *it), it[0] * it[0] + it[1] * it[1]);
        shift = tries.min_by_key(cost).unwrap_or_default();
        reach = AROUND;
    }
    let (body, drawn) = &levels[0];
    let [before, after] = [[0; 2], shift].map(|it| body.mismatch(drawn, it));
    Some(Fit { shift, left_over: after as f64 / before.max(1) as f64 })
}

/// First and one behind the last column and row that have any.
fn bounds(set: &[bool], width: usize) -> Option<[[usize; 2]; 2]> {
    let mut bounds: Option<[[usize; 2]; 2]> = None;
    for (y, row) in set.chunks_exact(width.max(1)).enumerate() {
        let (Some(first), Some(last)) = (row.iter().position(|it| *it), row.iter().rposition(|it| *it)) else {
            continue;
        };
        let [low, high] = bounds.get_or_insert([[first, y], [last + 1, y + 1]]);
        *low = [low[0].min(first), low[1].min(y)];
        *high = [high[0].max(last + 1), high[1].max(y + 1)];
    }
    bounds
}

struct Plane {
    columns: usize,
    rows: usize,
    set: Vec<bool>,
}

impl Plane {
    /// Half as large: set where two of four are.
    fn halved(&self) -> Plane {
        let (columns, rows) = (self.columns.div_ceil(2), self.rows.div_ceil(2));
        let at = |x: usize, y: usize| x < self.columns && y < self.rows && self.set[y * self.columns + x];
        let count = |x: usize, y: usize| {
            [[0, 0], [1, 0], [0, 1], [1, 1]].iter().filter(|[dx, dy]| at(2 * x + dx, 2 * y + dy)).count()
        };
        Plane {
            columns,
            rows,
            set: (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))).map(|(x, y)| count(x, y) >= 2).collect(),
        }
    }

    /// Twice what of this `other`, shifted, does not cover, and what it covers beside.
    fn mismatch(&self, other: &Plane, [dx, dy]: [i32; 2]) -> u64 {
        let mut sum = 0;
        for y in 0..self.rows {
            let row = &self.set[y * self.columns..][..self.columns];
            let from = y as i64 - i64::from(dy);
            let beside = (from >= 0 && from < self.rows as i64)
                .then(|| &other.set[from as usize * self.columns..][..self.columns]);
            let n_body = row.iter().filter(|it| **it).count();
            let Some(beside) = beside else {
                sum += 2 * n_body as u64;
                continue;
            };
            // Where both have columns.
            let first = dx.clamp(0, self.columns as i32) as usize;
            let last = (self.columns as i32 + dx).clamp(0, self.columns as i32) as usize;
            let (mut both, mut n_other) = (0, 0);
            if first < last {
                let shifted = &beside[(first as i32 - dx) as usize..(last as i32 - dx) as usize];
                for (body, other) in row[first..last].iter().zip(shifted) {
                    both += u64::from(*body & *other);
                    n_other += u64::from(*other);
                }
            }
            sum += 2 * (n_body as u64 - both) + (n_other - both);
        }
        sum
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const WIDTH: usize = 160;

    /// A disc with an arm to the right.
    fn figure(x: f64, y: f64) -> Vec<bool> {
        let is_set = |column: f64, row: f64| {
            (column - x).hypot(row - y) < 14.0 || ((row - y).abs() < 3.0 && (0.0..30.0).contains(&(column - x)))
        };
        (0..120)
            .flat_map(|row| (0..WIDTH).map(move |column| (column, row)))
            .map(|(column, row)| is_set(column as f64, f64::from(row)))
            .collect()
    }

    fn bytes(of: &[bool]) -> Vec<u8> {
        of.iter().map(|it| u8::from(*it)).collect()
    }

    #[test]
    fn the_shift_between_two_pictures_of_one_figure_is_found() {
        for (x, y) in [(60.0, 60.0), (67.0, 60.0), (55.0, 71.0), (90.0, 40.0)] {
            let found = fit(&figure(x, y), &bytes(&figure(60.0, 60.0)), WIDTH).unwrap();
            assert_eq!(found.shift, [(x - 60.0) as i32, (y - 60.0) as i32]);
            let expected = if x == 60.0 { 0.0..=1.0 } else { 0.0..=0.01 };
            assert!(expected.contains(&found.left_over), "{found:?}");
        }
    }

    #[test]
    fn a_silhouette_without_its_arm_fits_best_where_it_is() {
        let mut body = figure(60.0, 60.0);
        (0..body.len()).filter(|it| it % WIDTH > 74).for_each(|it| body[it] = false);
        let found = fit(&body, &bytes(&figure(60.0, 60.0)), WIDTH).unwrap();
        assert_eq!((found.shift, found.left_over), ([0; 2], 1.0));
        assert_eq!(fit(&body, &vec![0; body.len()], WIDTH), None);
    }
}
