//! Tests of fits between bounds: the least of all ways, rows that come and go, what cannot be fitted.

use proptest::prelude::*;

use super::*;
use crate::random::Random;

/// The least |A w − b|² over all ways of putting weights to bounds, each solved on its own; for a few weights only.
fn by_trying_all(matrix: &DMatrix<f64>, values: &[f64], lower: &[f64], upper: &[f64]) -> f64 {
    let n = matrix.ncols();
    let b = nalgebra::DVector::from_column_slice(values);
    let mut least = f64::INFINITY;
    for code in 0..3_usize.pow(n as u32) {
        let side = |index: usize| code / 3_usize.pow(index as u32) % 3;
        let mut weights: Vec<f64> = (0..n).map(|it| [0.0, lower[it], upper[it]][side(it)]).collect();
        if weights.iter().any(|it| !it.is_finite()) {
            continue;
        }
        let free: Vec<usize> = (0..n).filter(|it| side(*it) == 0).collect();
        if !free.is_empty() {
            let rest = &b - matrix * nalgebra::DVector::from_column_slice(&weights);
            let part = matrix.select_columns(&free);
            let solved = part.svd(true, true).solve(&rest, 1e-10).unwrap();
            free.iter().zip(solved.iter()).for_each(|(index, it)| weights[*index] = *it);
        }
        if (0..n).all(|it| (lower[it] - 1e-9..=upper[it] + 1e-9).contains(&weights[it])) {
            least = least.min((&b - matrix * nalgebra::DVector::from_column_slice(&weights)).norm_squared());
        }
    }
    least
}

#[track_caller]
fn check(solver: &mut BoundedLeastSquares, values: &[f64], counts: &[bool]) -> Bounded {
    let found = solver.solve(values, counts).unwrap();
    for (index, weight) in found.weights.iter().enumerate() {
        assert!((solver.lower[index]..=solver.upper[index]).contains(weight), "{index}: {weight}");
    }
    // Columns that nearly follow from each other (here by chance) leave a slope over.
    assert!(found.slope < 1e-4, "{found:?}");
    found
}

proptest! {
    #[test]
    fn the_least_of_all_ways_is_found(
        seed in 0_u64..10_000, rows in 1_usize..9, n in 1_usize..5, rank in 1_usize..5, bounds in 0..4,
    ) {
        let mut random = Random::new(seed);
        let mut normal = |rows: usize, columns: usize| DMatrix::from_fn(rows, columns, |_, _| random.normal());
        // Of a rank that is often less than there are columns.
        let matrix = normal(rows, rank) * normal(rank, n);
        let values: Vec<f64> = normal(rows, 1).iter().map(|it| it * 2.0).collect();
        let (lower, upper) = match bounds {
            0 => (vec![0.0; n], vec![1.0; n]),
            1 => (vec![0.0; n], vec![f64::INFINITY; n]),
            2 => (vec![f64::NEG_INFINITY; n], vec![f64::INFINITY; n]),
            _ => (normal(n, 1).iter().map(|it| it - 1.0).collect(), vec![2.5; n]),
        };
        let (lower, upper): (Vec<f64>, Vec<f64>) = (lower.iter().map(|it| f64::min(*it, 2.5)).collect(), upper);
        let mut solver = BoundedLeastSquares::new(matrix.clone(), &lower, &upper).unwrap();
        let least = by_trying_all(&matrix, &values, &lower, &upper);
        let found = check(&mut solver, &values, &vec![true; rows]);
        // Trying all ways is itself no better than its singular values, where columns follow from each other.
        let slack = 1e-7 * (1.0 + least);
        prop_assert!(found.cost < least + slack, "{} for {least}", found.cost);
        // From an answer to something else the same is found.
        let other: Vec<f64> = values.iter().map(|it| 1.0 - 2.0 * it).collect();
        check(&mut solver, &other, &vec![true; rows]);
        let again = check(&mut solver, &values, &vec![true; rows]);
        prop_assert!((again.cost - found.cost).abs() < slack);
    }
}

/// Faces as in the peers' script: 69 marks, 80 faces that 12 ways of moving make, millimetres.
fn faces(n_faces: usize, random: &mut Random) -> DMatrix<f64> {
    let (rows, n_modes) = (207, 12);
    let mean: Vec<f64> = (0..rows).map(|_| 60.0 * random.normal()).collect();
    let modes = DMatrix::from_fn(rows, n_modes, |_, mode| random.normal() * (6.0 - 0.5 * mode as f64));
    let ways = DMatrix::from_fn(n_modes, n_faces, |_, _| random.uniform_in(-1.0, 1.0));
    let mut faces = modes * ways;
    for mut face in faces.column_iter_mut() {
        face.iter_mut().zip(&mean).for_each(|(it, mean)| *it += mean + 0.4 * random.normal());
    }
    faces
}

#[test]
fn eighty_faces_are_fitted_with_rows_that_come_and_go() {
    let mut random = Random::new(60);
    let all = faces(120, &mut random);
    let matrix = all.columns(0, 80).into_owned();
    let (lower, upper) = (vec![0.0; 80], vec![1.0; 80]);
    let mut solver = BoundedLeastSquares::new(matrix.clone(), &lower, &upper).unwrap();
    for frame in 0..40 {
        let values: Vec<f64> = all.column(80 + frame).iter().copied().collect();
        let counts: Vec<bool> = (0..207).map(|row| (row / 3 + frame) % 7 != 0).collect();
        let warm = check(&mut solver, &values, &counts);
        assert!(warm.slope < 1e-8, "{}", warm.slope);
        // As if nothing had been before, on a matrix without the rows.
        let kept: Vec<usize> = (0..207).filter(|it| counts[*it]).collect();
        let mut fresh = BoundedLeastSquares::new(matrix.select_rows(&kept), &lower, &upper).unwrap();
        let kept_values: Vec<f64> = kept.iter().map(|it| values[*it]).collect();
        let cold = check(&mut fresh, &kept_values, &vec![true; kept.len()]);
        assert!((warm.cost - cold.cost).abs() < 1e-9 * cold.cost, "{} {}", warm.cost, cold.cost);
        for (a, b) in warm.weights.iter().zip(&cold.weights) {
            assert!((a - b).abs() < 1e-7, "{a} {b}");
        }
    }
}

#[test]
fn the_same_frame_again_takes_one_system() {
    let mut random = Random::new(61);
    let all = faces(81, &mut random);
    let mut solver = BoundedLeastSquares::new(all.columns(0, 80).into_owned(), &[0.0; 80], &[1.0; 80]).unwrap();
    let values: Vec<f64> = all.column(80).iter().copied().collect();
    let first = check(&mut solver, &values, &[true; 207]);
    let second = check(&mut solver, &values, &[true; 207]);
    assert!(first.n_solved > 3 && second.n_solved <= 3, "{} {}", first.n_solved, second.n_solved);
}

#[test]
fn fewer_rows_than_weights_and_equal_columns_leave_weights_undetermined() {
    let matrix = DMatrix::from_fn(2, 5, |row, column| [1.0, 2.0][row] * (1.0 + column as f64));
    let mut solver = BoundedLeastSquares::new(matrix, &[0.0; 5], &[1.0; 5]).unwrap();
    let found = check(&mut solver, &[3.0, 6.0], &[true; 2]);
    assert!(found.cost < 1e-20 && found.n_free == found.n_undetermined + 1, "{found:?}");
    let zero = DMatrix::zeros(3, 2);
    let mut solver = BoundedLeastSquares::new(zero, &[-1.0; 2], &[1.0; 2]).unwrap();
    assert_eq!(check(&mut solver, &[1.0, 2.0, 2.0], &[true; 3]).cost, 9.0);
    let mut none = BoundedLeastSquares::new(DMatrix::zeros(3, 0), &[], &[]).unwrap();
    assert_eq!(check(&mut none, &[1.0, 2.0, 2.0], &[true; 3]).weights, []);
}

#[test]
fn numbers_that_differ_much_in_size_are_borne() {
    let matrix = DMatrix::from_fn(12, 4, |row, column| {
        ((row * 7 + column * 5) % 11) as f64 * 10_f64.powi(4 * column as i32 - 6)
    });
    let truth = [0.5, 0.25, 1.0, 0.75];
    let values: Vec<f64> = (&matrix * nalgebra::DVector::from_column_slice(&truth)).iter().copied().collect();
    let mut solver = BoundedLeastSquares::new(matrix, &[0.0; 4], &[1.0; 4]).unwrap();
    let found = check(&mut solver, &values, &[true; 12]);
    for (found, truth) in found.weights.iter().zip(&truth) {
        assert!((found - truth).abs() < 1e-3, "{found} for {truth}");
    }
}

#[test]
fn what_is_no_problem_is_refused_and_the_next_one_solved() {
    let one = DMatrix::from_element(2, 1, 1.0);
    let new = |matrix: &DMatrix<f64>, lower: &[f64], upper: &[f64]| {
        BoundedLeastSquares::new(matrix.clone(), lower, upper).unwrap_err()
    };
    assert_eq!(new(&one, &[0.0, 0.0], &[1.0]), BoundedError::Lengths { what: "lower bounds", found: 2, expected: 1 });
    assert_eq!(new(&one, &[0.0], &[f64::NAN]), BoundedError::NotFinite { what: "upper bounds", index: 0 });
    assert_eq!(new(&one, &[2.0], &[1.0]), BoundedError::Crossed { index: 0, lower: 2.0, upper: 1.0 });
    let mut broken = one.clone();
    broken[1] = f64::INFINITY;
    assert!(matches!(new(&broken, &[0.0], &[1.0]), BoundedError::NotFinite { index: 1, .. }));
    let mut solver = BoundedLeastSquares::new(one, &[0.0], &[1.0]).unwrap();
    assert_eq!(solver.solve(&[1.0, 0.5], &[false; 2]), Err(BoundedError::NoRows { rows: 2 }));
    assert_eq!(solver.solve(&[1.0, f64::NAN], &[true; 2]), Err(BoundedError::NotFinite { what: "value", index: 1 }));
    assert!(matches!(solver.solve(&[1.0], &[true; 2]), Err(BoundedError::Lengths { what: "values", .. })));
    assert!(matches!(solver.solve(&[f64::MAX, -f64::MAX], &[true; 2]), Ok(_) | Err(BoundedError::Lost { .. })));
    assert_eq!(check(&mut solver, &[1.0, f64::NAN], &[true, false]).weights, [1.0]);
    assert_eq!(check(&mut solver, &[1.0, 0.5], &[true; 2]).weights, [0.75]);
}
