//! Pairs within a gate, and the groups that these connect.
//!
//! Large scenes fall apart into small groups, each of which is assigned by itself: the cost grows with the number of targets and
//! not with its cube.

use nalgebra::Point3;

/// Pairs of rows and columns within a gate; keeps its memory.
#[derive(Default)]
pub(super) struct Pairs {
    /// Ascending by row, then column.
    list: Vec<Pair>,
    by_x: Vec<(f64, usize)>,
    near_any: Vec<bool>,
}

/// Two points within the gate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pair {
    pub row: usize,
    pub column: usize,
    /// [m]
    pub distance: f64,
}

impl Pairs {
    /// Finds all pairs at most `gate` [m] apart. A position that is not finite is far from everything.
    pub fn find(&mut self, rows: &[Point3<f64>], columns: &[Point3<f64>], gate: f64) {
        self.list.clear();
        self.near_any.clear();
        self.near_any.resize(columns.len(), false);
        self.by_x.clear();
        let finite = columns.iter().enumerate().filter(|(_, it)| it.coords.iter().all(|it| it.is_finite()));
        self.by_x.extend(finite.map(|(i, it)| (it.x, i)));
        self.by_x.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        for (row, point) in rows.iter().enumerate() {
            let begun = self.list.len();
            let first = self.by_x.partition_point(|it| it.0 < point.x - gate);
            for &(_, column) in self.by_x[first..].iter().take_while(|it| it.0 <= point.x + gate) {
                let distance = (point - columns[column]).norm();
                if distance <= gate {
                    self.list.push(Pair { row, column, distance });
                    self.near_any[column] = true;
                }
            }
            self.list[begun..].sort_unstable_by_key(|it| it.column);
        }
    }

    /// All pairs, ascending by row, then column.
    pub fn list(&self) -> &[Pair] {
        &self.list
    }

    /// How far row and column are apart; `None` beyond the gate.
    pub fn distance(&self, row: usize, column: usize) -> Option<f64> {
        let place = self.list.binary_search_by_key(&(row, column), |it| (it.row, it.column)).ok()?;
        Some(self.list[place].distance)
    }

    /// How many columns are near no row.
    pub fn n_far(&self) -> usize {
        self.near_any.iter().filter(|it| !**it).count()
    }
}

/// Rows and columns that pairs tie together, directly or through others; keeps its memory.
#[derive(Default)]
pub(super) struct Groups {
    /// By row, then by column: another member of the group, in the end its head.
    parents: Vec<usize>,
    /// (head, row or n_rows + column), ascending.
    members: Vec<(usize, usize)>,
    rows: Vec<usize>,
    columns: Vec<usize>,
}

impl Groups {
    /// Calls `each` with the rows and columns of every group, ascending; rows and columns in no pair are left out.
    pub fn for_each(
        &mut self,
        n_rows: usize,
        n_columns: usize,
        pairs: impl Iterator<Item = Pair>,
        mut each: impl FnMut(&[usize], &[usize]),
    ) {
        self.parents.clear();
        self.parents.extend(0..n_rows + n_columns);
        for pair in pairs {
            let (a, b) = (self.head(pair.row), self.head(n_rows + pair.column));
            self.parents[a.max(b)] = a.min(b);
        }
        self.members.clear();
        for i in 0..self.parents.len() {
            let head = self.head(i);
            self.members.push((head, i));
        }
        self.members.sort_unstable();
        for group in self.members.chunk_by(|a, b| a.0 == b.0).filter(|it| it.len() > 1) {
            let split = group.partition_point(|it| it.1 < n_rows);
            self.rows.clear();
            self.rows.extend(group[..split].iter().map(|it| it.1));
            self.columns.clear();
            self.columns.extend(group[split..].iter().map(|it| it.1 - n_rows));
            each(&self.rows, &self.columns);
        }
    }

    fn head(&mut self, mut i: usize) -> usize {
        while self.parents[i] != i {
            self.parents[i] = self.parents[self.parents[i]];
            i = self.parents[i];
        }
        i
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    fn points(random: &mut Random, n: usize) -> Vec<Point3<f64>> {
        (0..n).map(|_| Point3::from([(); 3].map(|()| random.uniform()))).collect()
    }

    #[test]
    fn pairs_are_all_those_within_the_gate() {
        let mut random = Random::new(1);
        let (rows, mut columns) = (points(&mut random, 60), points(&mut random, 80));
        columns[7].y = f64::NAN;
        columns[8].x = f64::INFINITY;
        let mut pairs = Pairs::default();
        pairs.find(&rows, &columns, 0.2);
        let mut n = 0;
        for (i, row) in rows.iter().enumerate() {
            for (j, column) in columns.iter().enumerate() {
                let distance = Some((row - column).norm()).filter(|it| *it <= 0.2);
                assert_eq!(pairs.distance(i, j), distance);
                n += usize::from(distance.is_some());
            }
        }
        assert!(n > 50 && n == pairs.list().len() && pairs.n_far() >= 2);
    }

    #[test]
    fn groups_hold_together_what_pairs_tie_and_nothing_else() {
        let pair = |row, column| Pair { row, column, distance: 0.0 };
        let tied = [pair(0, 2), pair(1, 2), pair(1, 0), pair(4, 4)];
        let mut found = Vec::new();
        Groups::default().for_each(5, 6, tied.into_iter(), |rows, columns| {
            found.push((rows.to_vec(), columns.to_vec()));
        });
        assert_eq!(found, [(vec![0, 1], vec![0, 2]), (vec![4], vec![4])]);
    }
}
