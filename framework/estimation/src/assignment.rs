//! Optimal and greedy assignment of rows to columns with a gate: measurements to tracks, heads to targets.
//!
//! Costs are a row-major matrix; a cost above the gate, or NaN, forbids the pair. Rows and columns may stay unassigned.
//!
//! [`optimal`] minimises the sum of the costs of the pairs plus the gate for each unassigned row: a pair is made exactly when its
//! cost does not exceed what it saves. It augments along shortest paths, row after row, in O(rows² × columns), after
//! R. Jonker and A. Volgenant, "A shortest augmenting path algorithm for dense and sparse linear assignment problems",
//! Computing 38, 1987; staying unassigned is a column of the row's own, which no other row reaches.
//! [`nearest_greedy`] takes the cheapest remaining pair again and again: faster, and wrong where targets are close together.
//!
//! ```
//! use foveate_estimation::{Workspace, nearest_greedy, optimal};
//!
//! // Squared distances of two tracks (rows) to three detections (columns); pairs above the gate are forbidden.
//! let costs = [
//!     1.0, 2.0, 30.0, // track 0
//!     0.5, 4.0, 30.0, // track 1
//! ];
//! let (mut workspace, mut assigned) = (Workspace::default(), Vec::new());
//! optimal(&costs, 2, 3, 9.0, &mut workspace, &mut assigned);
//! assert_eq!(assigned, [Some(1), Some(0)]); // 2.0 + 0.5; detection 2 is left for a new track
//!
//! // With a gate of 1.5, track 0 stays unassigned: its 1.0 would cost track 1 its 0.5.
//! optimal(&costs, 2, 3, 1.5, &mut workspace, &mut assigned);
//! assert_eq!(assigned, [None, Some(0)]);
//!
//! nearest_greedy(&costs, 2, 3, 9.0, &mut workspace, &mut assigned);
//! assert_eq!(assigned, [Some(1), Some(0)]);
//! ```
/// Memory that both functions reuse: after the first call of a size they allocate nothing.
#[derive(Debug, Clone, Default)]
pub struct Workspace {
    row_of_column: Vec<Option<usize>>,
    row_price: Vec<f64>,
    column_price: Vec<f64>,
    distance: Vec<f64>,
    reached_from: Vec<usize>,
    settled: Vec<bool>,
    pairs: Vec<(f64, usize, usize)>,
}

/// Assigns each row a column, or none, so that the sum of the costs plus `gate` for each unassigned row is least.
///
/// `costs[row * columns + column]`; costs may be negative. With an infinite `gate`, as many rows as possible get a
/// column. The result, one entry a row, replaces the contents of `assigned`.
///
/// # Panics
/// When `costs` does not have `rows × columns` entries.
pub fn optimal(
    costs: &[f64],
    rows: usize,
    columns: usize,
    gate: f64,
    workspace: &mut Workspace,
    assigned: &mut Vec<Option<usize>>,
) {
    assert_eq!(costs.len(), rows * columns, "a cost matrix has rows x columns entries");
    let allowed = |cost: f64| cost <= gate && cost.is_finite();
    // Alone: the gate, or without one more than any exchange along a path could save.
    let alone = if gate.is_finite() {
        gate
    } else {
        let largest = costs.iter().copied().filter(|cost| allowed(*cost)).fold(0.0, |most: f64, it| most.max(it.abs()));
        1.0 + 2.0 * largest * (rows + 1) as f64
    };
    reset(assigned, rows, None);
    let w = workspace;
    reset(&mut w.row_of_column, columns, None);
    reset(&mut w.row_price, rows, 0.0);
    reset(&mut w.column_price, columns, 0.0);
    for start in 0..rows {
        reset(&mut w.distance, columns, f64::INFINITY);
        reset(&mut w.reached_from, columns, usize::MAX);
        reset(&mut w.settled, columns, false);
        let of_start = &costs[start * columns..(start + 1) * columns];
        let reduced = of_start.iter().zip(&w.column_price).filter(|(cost, _)| allowed(**cost));
        w.row_price[start] = reduced.map(|(cost, price)| cost - price).fold(alone, f64::min);

        // Dijkstra over reduced costs, which are not negative, until a free column or a row that may stay alone.
        let (mut row, mut walked) = (start, 0.0);
        let (mut nearest_exit, mut exit_row) = (f64::INFINITY, start);
        let (free_column, length) = loop {
            let exit = walked + alone - w.row_price[row];
            if exit < nearest_exit {
                (nearest_exit, exit_row) = (exit, row);
            }
            let mut nearest = None;
            let mut nearest_distance = f64::INFINITY;
            for column in 0..columns {
                if w.settled[column] {
                    continue;
                }
                let cost = costs[row * columns + column];
                if allowed(cost) {
                    let through_row = walked + cost - w.row_price[row] - w.column_price[column];
                    if through_row < w.distance[column] {
                        w.distance[column] = through_row;
                        w.reached_from[column] = row;
                    }
                }
                if w.distance[column] < nearest_distance {
                    nearest_distance = w.distance[column];
                    nearest = Some(column);
                }
            }
            let Some(column) = nearest.filter(|_| nearest_distance <= nearest_exit) else {
                break (None, nearest_exit);
            };
            match w.row_of_column[column] {
                None => break (Some(column), nearest_distance),
                Some(owner) => {
                    w.settled[column] = true;
                    (row, walked) = (owner, nearest_distance);
                }
            }
        };

        w.row_price[start] += length;
        for column in 0..columns {
            if let (true, Some(owner)) = (w.settled[column], w.row_of_column[column]) {
                w.row_price[owner] += length - w.distance[column];
                w.column_price[column] -= length - w.distance[column];
            }
        }
        // The row that stays alone gives up its column, which is then the free one.
        let mut free = free_column.or_else(|| assigned[exit_row].take());
        while let Some(column) = free {
            let taker = w.reached_from[column];
            w.row_of_column[column] = Some(taker);
            free = assigned[taker].replace(column);
        }
    }
}

/// Assigns the pair of least cost, then the cheapest among the rest, and so on up to `gate`; ties in the order of
/// rows, then columns. Arguments, result and panic as for [`optimal`].
pub fn nearest_greedy(
    costs: &[f64],
    rows: usize,
    columns: usize,
    gate: f64,
    workspace: &mut Workspace,
    assigned: &mut Vec<Option<usize>>,
) {
    assert_eq!(costs.len(), rows * columns, "a cost matrix has rows x columns entries");
    reset(assigned, rows, None);
    reset(&mut workspace.row_of_column, columns, None);
    workspace.pairs.clear();
    let allowed = costs.iter().enumerate().filter(|(_, cost)| **cost <= gate && cost.is_finite());
    workspace.pairs.extend(allowed.map(|(place, cost)| (*cost, place / columns, place % columns)));
    workspace.pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then_with(|| (a.1, a.2).cmp(&(b.1, b.2))));
    for &(_, row, column) in &workspace.pairs {
        if assigned[row].is_none() && workspace.row_of_column[column].is_none() {
            assigned[row] = Some(column);
            workspace.row_of_column[column] = Some(row);
        }
    }
}

fn reset<T: Clone>(list: &mut Vec<T>, length: usize, value: T) {
    list.clear();
    list.resize(length, value);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    type Method = fn(&[f64], usize, usize, f64, &mut Workspace, &mut Vec<Option<usize>>);

    /// Runs `method`, checks that its answer is one at all, and gives it.
    #[track_caller]
    fn assign(method: Method, costs: &[f64], rows: usize, columns: usize, gate: f64) -> Vec<Option<usize>> {
        let mut assigned = vec![Some(99); 3]; // left over from another call
        method(costs, rows, columns, gate, &mut Workspace::default(), &mut assigned);
        assert_eq!(assigned.len(), rows);
        let mut taken: Vec<usize> = assigned.iter().copied().flatten().collect();
        taken.sort_unstable();
        assert!(taken.windows(2).all(|pair| pair[0] < pair[1]), "a column twice: {assigned:?}");
        for (row, column) in assigned.iter().enumerate().filter_map(|(row, column)| Some((row, (*column)?))) {
            assert!(costs[row * columns + column] <= gate, "a forbidden pair: {assigned:?}");
        }
        assigned
    }

    fn total(costs: &[f64], columns: usize, gate: f64, assigned: &[Option<usize>]) -> f64 {
        let each = assigned.iter().enumerate();
        each.map(|(row, column)| column.map_or(gate, |column| costs[row * columns + column])).sum()
    }

    /// The least total over all assignments of the rows from `row` on.
    fn brute_force(costs: &[f64], columns: usize, gate: f64, row: usize, taken: &mut Vec<bool>) -> f64 {
        if row * columns == costs.len() {
            return 0.0;
        }
        let mut best = gate + brute_force(costs, columns, gate, row + 1, taken);
        for column in 0..columns {
            let cost = costs[row * columns + column];
            if !taken[column] && cost <= gate {
                taken[column] = true;
                best = best.min(cost + brute_force(costs, columns, gate, row + 1, taken));
                taken[column] = false;
            }
        }
        best
    }

    fn matrices() -> impl Strategy<Value = (Vec<f64>, usize, usize)> {
        (1usize..7, 1usize..7).prop_flat_map(|(rows, columns)| {
            // Whole numbers make ties; NaN and infinity forbid.
            let cost = prop_oneof![
                5 => -5.0..10.0,
                3 => (-3..6).prop_map(f64::from),
                1 => Just(f64::NAN),
                1 => Just(f64::INFINITY),
            ];
            (prop::collection::vec(cost, rows * columns), Just(rows), Just(columns))
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn no_assignment_is_cheaper((costs, rows, columns) in matrices(), gate in -1.0..12.0) {
            let assigned = assign(optimal, &costs, rows, columns, gate);
            let best = brute_force(&costs, columns, gate, 0, &mut vec![false; columns]);
            prop_assert!((total(&costs, columns, gate, &assigned) - best).abs() < 1e-9, "{:?} {}", assigned, best);
        }

        #[test]
        fn greedy_leaves_no_allowed_pair_alone((costs, rows, columns) in matrices(), gate in -1.0..12.0) {
            let assigned = assign(nearest_greedy, &costs, rows, columns, gate);
            for row in 0..rows {
                for column in 0..columns {
                    let cost = costs[row * columns + column];
                    let owner = assigned.iter().position(|it| *it == Some(column));
                    let row_s = assigned[row].map(|it| costs[row * columns + it]);
                    let column_s = owner.map(|it| costs[it * columns + column]);
                    let beaten = [row_s, column_s].into_iter().flatten().any(|it| it <= cost);
                    prop_assert!(cost.is_nan() || cost > gate || beaten);
                }
            }
        }

        #[test]
        fn without_a_gate_as_many_as_possible_are_assigned((costs, rows, columns) in matrices()) {
            let assigned = assign(optimal, &costs, rows, columns, f64::INFINITY);
            let unit: Vec<f64> = costs.iter().map(|it| if it.is_finite() { 0.0 } else { f64::NAN }).collect();
            let alone = brute_force(&unit, columns, 1.0, 0, &mut vec![false; columns]);
            prop_assert_eq!(assigned.iter().filter(|it| it.is_none()).count(), alone as usize);
        }
    }

    #[test]
    fn two_targets_close_together_need_the_optimal_one() {
        let costs = [1.0, 2.0, 0.9, 5.0];
        assert_eq!(assign(optimal, &costs, 2, 2, 10.0), [Some(1), Some(0)]);
        assert_eq!(assign(nearest_greedy, &costs, 2, 2, 10.0), [Some(1), Some(0)]);
        let costs = [1.0, 2.0, 1.1, 5.0];
        assert_eq!(assign(optimal, &costs, 2, 2, 10.0), [Some(1), Some(0)]);
        assert_eq!(assign(nearest_greedy, &costs, 2, 2, 10.0), [Some(0), Some(1)]);
        // A lower gate makes it cheaper to leave the second alone.
        assert_eq!(assign(optimal, &costs, 2, 2, 2.05), [Some(0), None]);
    }

    #[test]
    fn nothing_to_assign_is_an_answer() {
        for method in [optimal as Method, nearest_greedy] {
            assert_eq!(assign(method, &[], 0, 0, 1.0), []);
            assert_eq!(assign(method, &[], 0, 5, 1.0), []);
            assert_eq!(assign(method, &[], 3, 0, 1.0), [None; 3]);
            assert_eq!(assign(method, &[0.0; 4], 2, 2, f64::NAN), [None; 2]);
            assert_eq!(assign(method, &[f64::NAN; 4], 2, 2, f64::INFINITY), [None; 2]);
        }
    }

    #[test]
    #[should_panic(expected = "rows x columns")]
    fn a_matrix_of_another_size_is_a_mistake_of_the_caller() {
        assign(optimal, &[1.0; 5], 2, 3, 1.0);
    }

    #[test]
    fn memory_is_reused() {
        let costs: Vec<f64> = (0..300).map(|it| f64::from(it * 7919 % 101)).collect();
        let (mut workspace, mut assigned) = (Workspace::default(), Vec::new());
        let mut sizes = Vec::new();
        for _ in 0..3 {
            optimal(&costs, 20, 15, 60.0, &mut workspace, &mut assigned);
            nearest_greedy(&costs, 20, 15, 60.0, &mut workspace, &mut assigned);
            let w = &workspace;
            sizes.push((w.pairs.as_ptr(), w.distance.as_ptr(), w.row_price.as_ptr(), assigned.as_ptr()));
        }
        assert!(sizes.windows(2).all(|pair| pair[0] == pair[1]));
    }
}
