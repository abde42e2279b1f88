//! Bases of a model, from aligned frames.

use foveate_estimation::principal::{Principal, PrincipalError, principal, principal_of};
use nalgebra::{DMatrix, Point3};

use super::{AcquisitionOptions, Bases, ShapeKind};

/// Shapes with more numbers than this get no ways of moving but captured ones: the covariance would take too long.
const MOST_NUMBERS: usize = 1200;

/// Bases with what they leave over.
pub(super) struct Based {
    pub(super) shapes: DMatrix<f64>,
    pub(super) bases: Bases,
    pub(super) unexplained: Vec<f64>,
}

/// Of `frames`, one a column.
pub(super) fn bases_of(
    frames: &DMatrix<f64>,
    spreads: &[f64],
    options: &AcquisitionOptions,
) -> Result<Based, PrincipalError> {
    match options.kind {
        ShapeKind::Components => components(frames, spreads, options),
        ShapeKind::Faces => faces(frames, options),
    }
}

fn components(frames: &DMatrix<f64>, spreads: &[f64], options: &AcquisitionOptions) -> Result<Based, PrincipalError> {
    let (numbers, n_marks) = (frames.nrows(), frames.nrows() / 3);
    let Principal { mut directions, mut variances, .. } = match options.unseen > 0.0 && numbers <= MOST_NUMBERS {
        false => principal(frames)?,
        true => {
            let mean = frames.column_mean();
            let mut centred = frames.clone();
            centred.column_iter_mut().for_each(|mut it| it -= &mean);
            let mut covariance = &centred * centred.transpose() / (frames.ncols().max(2) - 1) as f64;
            let place = |mark: usize| Point3::new(mean[3 * mark], mean[3 * mark + 1], mean[3 * mark + 2]);
            for a in 0..n_marks {
                for b in 0..n_marks {
                    let apart = (place(a) - place(b)).norm_squared() / (2.0 * options.reach * options.reach);
                    let together = options.unseen.powi(2) * spreads[a] * spreads[b] * (-apart).exp();
                    (0..3).for_each(|axis| covariance[(3 * a + axis, 3 * b + axis)] += together);
                }
            }
            principal_of(mean, covariance)?
        }
    };
    let noise = options.noise * options.noise;
    let n_kept = variances.iter().take_while(|it| **it > noise).count().min(options.n_bases);
    let mut unexplained = vec![options.least_unexplained(); n_marks];
    for (direction, variance) in directions.column_iter().zip(&variances).skip(n_kept) {
        for (mark, left) in unexplained.iter_mut().enumerate() {
            *left += variance * direction.fixed_rows::<3>(3 * mark).norm_squared() / 3.0;
        }
    }
    directions = directions.columns(0, n_kept).into_owned();
    variances.truncate(n_kept);
    Ok(Based { shapes: directions, bases: Bases::Components { variances }, unexplained })
}

/// Of each principal component in turn the frame that lies furthest along it, either way; so often that there are enough.
fn faces(frames: &DMatrix<f64>, options: &AcquisitionOptions) -> Result<Based, PrincipalError> {
    let found = principal(frames)?;
    let mut along = found.directions.transpose() * frames;
    let offset = found.directions.transpose() * &found.mean;
    along.column_iter_mut().for_each(|mut it| it -= &offset);
    let wanted = options.n_bases.min(frames.ncols());
    let mut chosen: Vec<usize> = Vec::with_capacity(wanted);
    let mut is_chosen = vec![false; frames.ncols()];
    // Frames that do not vary have no component; one of them is as good as another.
    let turns = along.nrows().max(1);
    for turn in (0..turns).cycle().take(turns * wanted) {
        if chosen.len() == wanted {
            break;
        }
        let extreme = |frame: usize| if along.nrows() == 0 { 0.0 } else { along[(turn, frame)].abs() };
        let furthest = (0..frames.ncols()).rev().filter(|it| !is_chosen[*it]);
        if let Some(frame) = furthest.max_by(|a, b| extreme(*a).total_cmp(&extreme(*b))) {
            is_chosen[frame] = true;
            chosen.push(frame);
            if along.nrows() == 0 {
                break;
            }
        }
    }
    Ok(Based {
        shapes: frames.select_columns(&chosen),
        bases: Bases::Faces { lowest: 0.0, highest: 1.0 },
        unexplained: vec![options.least_unexplained(); frames.nrows() / 3],
    })
}
