//! Finds a target of dark rectangles in rows and numbered columns on something bright, as they are printed for calibrating cameras around a cylinder.
//!
//! 1. `patches`: what is dark on bright, whole, and a parallelogram (area against second moments, which no affine map changes) has a centre to hundredths of a pixel.
//! 2. `lattice`: patches below one another at even steps are a column; a column that has as many patches as the target has rows is whole.
//! 3. `numbers`: which column of the target the first one is, is read from the numbers above them, by how many figures they have and how many holes these have:
//!    9 has one as 6 has, 8 has two, 12 has none in two figures. No single one says much; a row of columns of which each is one more than the last does.
//!
//! Columns that are turned away, in glare or cut by the picture's edge are left out, not guessed; what is not labelled is given back too.

mod lattice;
mod numbers;
mod patches;
#[cfg(test)]
mod tests;

use nalgebra::Point2;

use crate::ImageView;
pub use patches::DarkPatch;

/// Size of the target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TargetPattern {
    /// Rectangles below one another.
    pub rows: usize,
    /// Columns all around, numbered from 1 and from left to right as seen from outside.
    pub columns: usize,
}

/// One rectangle of the target, identified by column and row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Labelled {
    /// Number of its column, from 1.
    pub column: usize,
    /// Its row, 0 at the top of the picture.
    pub row: usize,
    /// Where and how it looks.
    pub patch: DarkPatch,
}

/// The rectangles of the target in one picture, found by [`find_target`].
#[derive(Debug, Clone, PartialEq)]
pub struct TargetFound {
    /// By column, then by row.
    pub labelled: Vec<Labelled>,
    /// Patches that look like rectangles and belong to no whole column.
    pub others: Vec<DarkPatch>,
    /// Numbers of the whole columns, ascending.
    pub columns: Vec<usize>,
    /// How many of the numbers above columns agree with these, and how many would with the next best numbering; 0, 0 where the first column was given.
    pub votes: [f64; 2],
}

/// Why no target was found.
#[derive(Debug, Clone, PartialEq)]
pub enum NoTarget {
    /// Too few whole columns.
    Columns {
        /// Patches that look like rectangles.
        patches: usize,
        /// The longest column.
        longest: usize,
        /// Rows of the target.
        rows: usize,
        /// Whole columns.
        whole: usize,
    },
    /// Numbers above the columns do not say which they are.
    Numbers {
        /// Columns, whole or not, from left to right.
        columns: usize,
        /// Agreement of the best numbering and of the next.
        votes: [f64; 2],
    },
}

impl std::fmt::Display for NoTarget {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            NoTarget::Columns { patches, longest, rows, whole } => write!(
                to,
                "{patches} dark rectangles on bright ground, the longest column with {longest}, {whole} complete columns; expected at least 2 columns of {rows} rectangles"
            ),
            NoTarget::Numbers { columns, votes: [best, next] } => write!(
                to,
                "the numbers above the {columns} columns are ambiguous (the best numbering agrees with {best:.1} of them, the next with {next:.1}); expected them legible, \
                 upright and not mirrored, or the number of the leftmost column stated"
            ),
        }
    }
}

/// Whole columns that a target must show.
const MIN_COLUMNS: usize = 2;

/// Finds the target in a picture. `leftmost`: the number, from 1, of the column that appears first from the left, whole or not; `None`: by
/// the numbers above them.
///
/// # Errors
/// See [`NoTarget`].
pub fn find_target(
    image: &ImageView<'_>,
    pattern: TargetPattern,
    leftmost: Option<usize>,
) -> Result<TargetFound, NoTarget> {
    let dark = patches::Dark::of(image);
    let patches = dark.rectangles();
    let chains = lattice::columns(&patches, pattern.rows);
    let whole = chains.iter().filter(|it| it.len() == pattern.rows).count();
    if whole < MIN_COLUMNS {
        let longest = chains.iter().map(Vec::len).max().unwrap_or(0);
        return Err(NoTarget::Columns { patches: patches.len(), longest, rows: pattern.rows, whole });
    }
    let (first, votes) = match leftmost {
        Some(first) => (first, [0.0, 0.0]),
        None => {
            let numbers::Reading { first, votes } = numbers::read(&dark, &patches, &chains, pattern);
            (first.ok_or(NoTarget::Numbers { columns: chains.len(), votes })?, votes)
        }
    };
    let mut labelled = Vec::new();
    let mut columns = Vec::new();
    let mut named = vec![false; patches.len()];
    for (index, chain) in chains.iter().enumerate() {
        // All around: after the last comes the first.
        let column = (first - 1 + index) % pattern.columns + 1;
        if chain.len() != pattern.rows {
            continue;
        }
        columns.push(column);
        for (row, patch) in chain.iter().enumerate() {
            named[*patch] = true;
            labelled.push(Labelled { column, row, patch: patches[*patch] });
        }
    }
    columns.sort_unstable();
    labelled.sort_by_key(|it| (it.column, it.row));
    let others = patches.iter().zip(&named).filter(|it| !it.1).map(|it| *it.0).collect();
    Ok(TargetFound { labelled, others, columns, votes })
}

/// The distance of two centres [px].
fn apart(a: &Point2<f64>, b: &Point2<f64>) -> f64 {
    (a - b).norm()
}
