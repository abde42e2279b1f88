//! Where boxes stand in their columns: few crossings, short edges.

/// Sweeps over the columns; more than a few change nothing.
const SWEEPS: usize = 12;

/// Something that takes up room in a column: a box, or the route of an edge past one.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Slot {
    pub column: usize,
    pub height: f64,
    /// Centre.
    pub y: f64,
}

/// Two slots of neighbouring columns that should be at the same height.
#[derive(Debug, Clone, Copy)]
pub(super) struct Join {
    pub from: usize,
    pub to: usize,
    /// Its weight.
    pub weight: f64,
}

/// Sets the centres of `slots` so that those joined by `joins` stand level and no two of a column come closer than `gap`.
/// Returns how high the whole is; its top is 0.
pub(super) fn arrange(slots: &mut [Slot], joins: &[Join], gap: f64) -> f64 {
    let n_columns = slots.iter().map(|it| it.column + 1).max().unwrap_or(0);
    let mut columns: Vec<Vec<usize>> = vec![Vec::new(); n_columns];
    for (index, slot) in slots.iter().enumerate() {
        columns[slot.column].push(index);
    }
    let mut before: Vec<Vec<(usize, f64)>> = vec![Vec::new(); slots.len()];
    let mut after = before.clone();
    for &Join { from, to, weight } in joins {
        after[from].push((to, weight));
        before[to].push((from, weight));
    }
    for column in &columns {
        stack(slots, column, gap);
    }
    for sweep in 0..SWEEPS {
        let forward = sweep % 2 == 0;
        let near = if forward { &before } else { &after };
        for step in 0..n_columns {
            let column = &mut columns[if forward { step } else { n_columns - 1 - step }];
            let wish: Vec<(f64, usize)> =
                column.iter().map(|&it| (mean(slots, &near[it]).unwrap_or(slots[it].y), it)).collect();
            let mut sorted = wish;
            sorted.sort_by(|a, b| a.0.total_cmp(&b.0));
            *column = sorted.into_iter().map(|it| it.1).collect();
            stack(slots, column, gap);
        }
    }
    for sweep in 0..SWEEPS {
        for step in 0..n_columns {
            let column = &columns[if sweep % 2 == 0 { step } else { n_columns - 1 - step }];
            let wishes: Vec<f64> = column
                .iter()
                .map(|&it| {
                    let all: Vec<(usize, f64)> = before[it].iter().chain(&after[it]).copied().collect();
                    mean(slots, &all).unwrap_or(slots[it].y)
                })
                .collect();
            settle(slots, column, &wishes, gap);
        }
    }
    let top = slots.iter().map(|it| it.y - it.height / 2.0).fold(f64::INFINITY, f64::min);
    let bottom = slots.iter().map(|it| it.y + it.height / 2.0).fold(f64::NEG_INFINITY, f64::max);
    if slots.is_empty() {
        return 0.0;
    }
    slots.iter_mut().for_each(|it| it.y -= top);
    bottom - top
}

fn mean(slots: &[Slot], of: &[(usize, f64)]) -> Option<f64> {
    let weight: f64 = of.iter().map(|it| it.1).sum();
    (weight > 0.0).then(|| of.iter().map(|&(it, weight)| weight * slots[it].y).sum::<f64>() / weight)
}

/// One below the other, around 0.
fn stack(slots: &mut [Slot], column: &[usize], gap: f64) {
    let height: f64 = column.iter().map(|&it| slots[it].height + gap).sum::<f64>() - gap;
    let mut y = -height / 2.0;
    for &it in column {
        slots[it].y = y + slots[it].height / 2.0;
        y += slots[it].height + gap;
    }
}

/// The positions nearest to the desired ones that keep order and gap, in the least-squares sense: pool adjacent violators.
fn settle(slots: &mut [Slot], column: &[usize], wishes: &[f64], gap: f64) {
    // Where each would stand if all above it touched it, from the first one.
    let mut offsets = Vec::with_capacity(column.len());
    let mut offset = 0.0;
    for (index, &it) in column.iter().enumerate() {
        if index > 0 {
            offset += (slots[column[index - 1]].height + slots[it].height) / 2.0 + gap;
        }
        offsets.push(offset);
    }
    // Blocks that touch: mean wish for their start, and how many they are.
    let mut blocks: Vec<(f64, usize)> = Vec::new();
    for (wish, offset) in wishes.iter().zip(&offsets) {
        blocks.push((wish - offset, 1));
        while let [.., (above, n_above), (below, n_below)] = blocks[..] {
            if above <= below {
                break;
            }
            blocks.pop();
            let count = n_above + n_below;
            let mean = (above * n_above as f64 + below * n_below as f64) / count as f64;
            if let Some(last) = blocks.last_mut() {
                *last = (mean, count);
            }
        }
    }
    let starts = blocks.iter().flat_map(|&(start, count)| std::iter::repeat_n(start, count));
    for ((&it, start), offset) in column.iter().zip(starts).zip(offsets) {
        slots[it].y = start + offset;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn join(from: usize, to: usize) -> Join {
        Join { from, to, weight: 1.0 }
    }

    #[test]
    fn slots_keep_their_distance_and_crossings_are_undone() {
        let slot = |column| Slot { column, height: 10.0, y: 0.0 };
        let mut slots = [slot(0), slot(0), slot(1), slot(1)];
        let height = arrange(&mut slots, &[join(0, 3), join(1, 2)], 5.0);
        assert_eq!(height, 25.0);
        assert_eq!(slots[0].y, slots[3].y);
        assert_eq!(slots[1].y, slots[2].y);
        assert_eq!((slots[0].y - slots[1].y).abs(), 15.0);
    }

    #[test]
    fn lone_slot_stands_level_with_the_middle_of_those_it_joins() {
        let slot = |column| Slot { column, height: 10.0, y: 0.0 };
        let mut slots = [slot(0), slot(0), slot(0), slot(1)];
        arrange(&mut slots, &[join(0, 3), join(1, 3), join(2, 3)], 5.0);
        assert_eq!(slots[3].y, slots[1].y);
    }
}
