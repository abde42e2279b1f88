//! Which row belongs to which column, at what cost: measurements to tracks, heads to targets.
//!
//! Costs come as a row-major matrix; one above the gate, or NaN, forbids the pair. Rows and columns may stay alone.
//!
//! [`optimal`] minimises the sum of the costs of the pairs plus the gate for each row left alone: a pair pays exactly when its
//! cost does not exceed what it saves. It augments along shortest paths, row after row, in O(rows² × columns), after
//! R. Jonker and A. Volgenant, "A shortest augmenting path algorithm for dense and sparse linear assignment problems",
//! Computing 38, 1987; staying alone is a column of the row's own, which no other row reaches.
//! [`nearest_greedy`] takes the cheapest pair again and again: quicker, and wrong where targets are close together.

/// Memory that the functions here reuse: after the first call of a size they allocate nothing.
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

/// Assigns each row a column, or none, so that the sum of the costs plus `gate` for each row without one is least.
///
/// `costs[row * columns + column]`; costs may be negative. With an infinite `gate` as many rows as possible get a
/// column. The answer, one entry a row, replaces the contents of `assigned`.
///
/// # Panics
/// When `costs` has not `rows × columns` entries.
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

/// Assigns the pair of least cost, then the cheapest among the rest, and so on up to `gate`; equal costs in the order of
/// rows, then columns. Arguments, answer and panic as for [`optimal`].
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
