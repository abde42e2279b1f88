//! Region growing from seeds over everything connected with them, the best first.
//!
//! G. P. Otto, T. K. W. Chau, "A region-growing algorithm for matching of terrain images", Image and Vision Computing 7(2), 1989: of all that was found,
//! the best is taken, and its four neighbours on the grid are tried with its own values as their start. What fails from one neighbour may be found from
//! another one later.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// A matched node of the grid.
#[derive(Debug, Clone, PartialEq)]
pub struct Grown<T> {
    /// Column, row on the grid.
    pub cell: [usize; 2],
    /// What was found.
    pub found: T,
    /// How good it is: the higher, the sooner its neighbours are tried.
    pub score: f64,
}

/// The extent of a grid, and how often a node is tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Growth {
    /// Columns of the grid.
    pub columns: usize,
    /// Rows of the grid.
    pub rows: usize,
    /// How many neighbours a node may be tried from before it counts as failed; at least 1.
    pub tries: u8,
}

struct Waiting {
    score: f64,
    cell: usize,
}

impl PartialEq for Waiting {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}
impl Eq for Waiting {}
impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}
impl Ord for Waiting {
    /// By score; of equals the first on the grid, so that the order is the same each time.
    fn cmp(&self, other: &Self) -> Ordering {
        self.score.total_cmp(&other.score).then(other.cell.cmp(&self.cell))
    }
}

/// Grows from `seeds` over the grid. `attempt(cell, from)` tries a node from what was found at its neighbour `from`. All that was found, seeds too, in
/// the order of the grid: row by row.
pub fn grow<T>(
    growth: Growth,
    seeds: impl IntoIterator<Item = Grown<T>>,
    mut attempt: impl FnMut([usize; 2], &Grown<T>) -> Option<(T, f64)>,
) -> Vec<Grown<T>> {
    let Growth { columns, rows, tries } = growth;
    let mut found: Vec<Option<Grown<T>>> = (0..columns * rows).map(|_| None).collect();
    let mut tried = vec![0u8; columns * rows];
    let mut waiting = BinaryHeap::new();
    for seed in seeds {
        let [x, y] = seed.cell;
        if x >= columns || y >= rows || !seed.score.is_finite() {
            continue;
        }
        let cell = y * columns + x;
        // Of two seeds of one node the better one stays.
        if found[cell].as_ref().is_none_or(|it| it.score < seed.score) {
            waiting.push(Waiting { score: seed.score, cell });
            found[cell] = Some(seed);
        }
    }
    while let Some(Waiting { cell, .. }) = waiting.pop() {
        let (x, y) = (cell % columns, cell / columns);
        for [right, down] in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
            let (Some(x), Some(y)) = (x.checked_add_signed(right), y.checked_add_signed(down)) else { continue };
            if x >= columns || y >= rows {
                continue;
            }
            let next = y * columns + x;
            if found[next].is_some() || tried[next] >= tries {
                continue;
            }
            tried[next] += 1;
            let Some(from) = &found[cell] else { continue };
            if let Some((what, score)) = attempt([x, y], from).filter(|it| it.1.is_finite()) {
                found[next] = Some(Grown { cell: [x, y], found: what, score });
                waiting.push(Waiting { score, cell: next });
            }
        }
    }
    found.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const GRID: Growth = Growth { columns: 9, rows: 7, tries: 4 };

    fn seed(cell: [usize; 2], score: f64) -> Grown<u32> {
        Grown { cell, found: 0, score }
    }

    #[test]
    fn all_that_hangs_together_is_found_and_nothing_else() {
        // A wall in column 5 with no gap.
        let grown = grow(GRID, [seed([1, 1], 1.0)], |[x, _], from| (x != 5).then(|| (from.found + 1, 0.5)));
        assert_eq!(grown.len(), 5 * 7);
        assert!(grown.iter().all(|it| it.cell[0] < 5));
        assert!(grown.windows(2).all(|it| it[0].cell[1] * 9 + it[0].cell[0] < it[1].cell[1] * 9 + it[1].cell[0]));
        assert!(grow(GRID, [seed([9, 0], 1.0), seed([0, 0], f64::NAN)], |_, _| Some((0, 1.0))).is_empty());
    }

    #[test]
    fn the_best_is_taken_first_and_a_failure_is_tried_from_other_sides() {
        // The node (4, 3) gives in at the third neighbour that asks.
        let mut asked = 0;
        let mut order = Vec::new();
        let grown = grow(GRID, [seed([4, 1], 1.0), seed([0, 6], 2.0)], |cell, _| {
            order.push(cell);
            if cell == [4, 3] {
                asked += 1;
                return (asked >= 3).then_some((1, 0.1));
            }
            Some((1, 0.1))
        });
        assert!(order[0] == [1, 6] && grown.len() == 63, "{:?}", order[0]);
        assert_eq!(asked, 3);
        let mut asked = 0;
        let once = Growth { tries: 1, ..GRID };
        let grown = grow(once, [seed([4, 1], 1.0)], |cell, _| {
            asked += usize::from(cell == [4, 3]);
            (cell != [4, 3]).then_some((1, 0.1))
        });
        assert_eq!((asked, grown.len()), (1, 62));
    }
}
