//! The five-point algorithm: the essential matrices, at most ten, of five pairs of lines of sight.
//!
//! Source: H. Stewénius, C. Engels, D. Nistér, "Recent developments on direct relative orientation", ISPRS Journal 60(4), 2006.
//!
//! E = x X + y Y + z Z + W over the null space of the five epipolar equations; det E = 0 and 2 E Eᵀ E = tr(E Eᵀ) E are ten cubic equations in
//! (x, y, z). Elimination of the ten cubic monomials leaves the matrix of multiplication by x on the ten others, whose
//! eigenvectors are those monomials at the solutions.

use nalgebra::{Matrix3, SMatrix, SVector, Schur, Vector3};

/// x, y, z, 1.
type Linear = [f64; 4];
/// x², xy, xz, y², yz, z², x, y, z, 1.
type Quadratic = [f64; 10];
/// x³, x²y, x²z, xy², xyz, xz², y³, y²z, yz², z³, then as a quadratic.
type Cubic = [f64; 20];

const LINEAR_BY_LINEAR: [[usize; 4]; 4] = [[0, 1, 2, 6], [1, 3, 4, 7], [2, 4, 5, 8], [6, 7, 8, 9]];
const LINEAR_BY_QUADRATIC: [[usize; 10]; 4] = [
    [0, 1, 2, 3, 4, 5, 10, 11, 12, 16],
    [1, 3, 4, 6, 7, 8, 11, 13, 14, 17],
    [2, 4, 5, 7, 8, 9, 12, 14, 15, 18],
    [10, 11, 12, 13, 14, 15, 16, 17, 18, 19],
];

/// All E of length 1 with bᵀ E a = 0 for the five pairs; none when they are degenerate.
pub(super) fn essential_matrices(in_a: &[Vector3<f64>; 5], in_b: &[Vector3<f64>; 5]) -> Vec<Matrix3<f64>> {
    let mut rows = SMatrix::<f64, 5, 9>::zeros();
    for (index, (a, b)) in in_a.iter().zip(in_b).enumerate() {
        for row in 0..3 {
            (0..3).for_each(|column| rows[(index, 3 * row + column)] = b[row] * a[column]);
        }
    }
    let Some(basis) = null_space(rows) else { return Vec::new() };
    let entry = |row: usize, column: usize| -> Linear { std::array::from_fn(|it| basis[it][3 * row + column]) };
    let e: [[Linear; 3]; 3] = std::array::from_fn(|row| std::array::from_fn(|column| entry(row, column)));
    let Some(by_x) = multiplication_by_x(&e) else { return Vec::new() };
    let Some(schur) = Schur::try_new(by_x, 1e-13, 300) else { return Vec::new() };
    let mut found = Vec::with_capacity(10);
    for root in schur.complex_eigenvalues().iter() {
        if root.im.abs() > 1e-6 * (1.0 + root.re.abs()) {
            continue;
        }
        let Some(monomials) = eigenvector(&by_x, root.re) else { continue };
        let (y, z) = (monomials[7] / monomials[9], monomials[8] / monomials[9]);
        let flat = basis[0] * root.re + basis[1] * y + basis[2] * z + basis[3];
        let matrix = Matrix3::from_row_slice(flat.as_slice());
        let norm = matrix.norm();
        if norm.is_finite() && norm > 0.0 {
            found.push(matrix / norm);
        }
    }
    found
}

/// Four orthonormal vectors that all rows annihilate, by elimination with full pivoting.
fn null_space(mut rows: SMatrix<f64, 5, 9>) -> Option<[SVector<f64, 9>; 4]> {
    let mut order: [usize; 9] = std::array::from_fn(|it| it);
    for step in 0..5 {
        let (row, column) = rows.view((step, step), (5 - step, 9 - step)).iamax_full();
        rows.swap_rows(step, step + row);
        rows.swap_columns(step, step + column);
        order.swap(step, step + column);
        let pivot = rows[(step, step)];
        if pivot.is_nan() || pivot.abs() < 1e-12 {
            return None;
        }
        let scaled = rows.row(step) / pivot;
        rows.set_row(step, &scaled);
        for other in (0..5).filter(|it| *it != step) {
            let reduced = rows.row(other) - scaled * rows[(other, step)];
            rows.set_row(other, &reduced);
        }
    }
    let mut basis = [SVector::<f64, 9>::zeros(); 4];
    for free in 0..4 {
        let mut vector = SVector::<f64, 9>::zeros();
        (0..5).for_each(|it| vector[order[it]] = -rows[(it, 5 + free)]);
        vector[order[5 + free]] = 1.0;
        for other in basis.iter().take(free) {
            vector -= other * other.dot(&vector);
        }
        basis[free] = vector.normalize();
    }
    Some(basis)
}

fn multiply(a: &Linear, b: &Linear) -> Quadratic {
    let mut product = [0.0; 10];
    for (a, places) in a.iter().zip(&LINEAR_BY_LINEAR) {
        b.iter().zip(places).for_each(|(b, place)| product[*place] += a * b);
    }
    product
}

fn add_product(sum: &mut Cubic, a: &Linear, b: &Quadratic, sign: f64) {
    for (a, places) in a.iter().zip(&LINEAR_BY_QUADRATIC) {
        b.iter().zip(places).for_each(|(b, place)| sum[*place] += sign * a * b);
    }
}

fn multiplication_by_x(e: &[[Linear; 3]; 3]) -> Option<SMatrix<f64, 10, 10>> {
    // E Eᵀ − ½ tr(E Eᵀ) I
    let mut gram = [[[0.0; 10]; 3]; 3];
    for row in 0..3 {
        for column in 0..3 {
            for (left, right) in e[row].iter().zip(&e[column]) {
                let product = multiply(left, right);
                (0..10).for_each(|it| gram[row][column][it] += product[it]);
            }
        }
    }
    let half_trace: Quadratic = std::array::from_fn(|it| 0.5 * (gram[0][0][it] + gram[1][1][it] + gram[2][2][it]));
    for (index, row) in gram.iter_mut().enumerate() {
        (0..10).for_each(|it| row[index][it] -= half_trace[it]);
    }
    let mut equations = [[0.0; 20]; 10];
    for row in 0..3 {
        for column in 0..3 {
            for (from_gram, from_e) in gram[row].iter().zip(e) {
                add_product(&mut equations[3 * row + column], &from_e[column], from_gram, 1.0);
            }
        }
    }
    for (first, second, third, sign) in
        [(0, 1, 2, 1.0), (1, 2, 0, 1.0), (2, 0, 1, 1.0), (2, 1, 0, -1.0), (1, 0, 2, -1.0), (0, 2, 1, -1.0)]
    {
        add_product(&mut equations[9], &e[0][first], &multiply(&e[1][second], &e[2][third]), sign);
    }
    let cubic = SMatrix::<f64, 10, 10>::from_fn(|row, column| equations[row][column]);
    let lower = SMatrix::<f64, 10, 10>::from_fn(|row, column| equations[row][10 + column]);
    let reduced = cubic.lu().solve(&lower)?;
    let mut by_x = SMatrix::<f64, 10, 10>::zeros();
    (0..6).for_each(|it| by_x.set_row(it, &-reduced.row(it)));
    for (row, column) in [(6, 0), (7, 1), (8, 2), (9, 6)] {
        by_x[(row, column)] = 1.0;
    }
    by_x.iter().all(|it| it.is_finite()).then_some(by_x)
}

/// By inverse iteration.
fn eigenvector(matrix: &SMatrix<f64, 10, 10>, value: f64) -> Option<SVector<f64, 10>> {
    let shift = value + 1e-10 * (1.0 + value.abs());
    let factors = (matrix - SMatrix::<f64, 10, 10>::identity() * shift).lu();
    let mut vector = SVector::<f64, 10>::repeat(1.0);
    for _ in 0..2 {
        vector = factors.solve(&vector)?;
        vector /= vector.norm();
    }
    (vector[9].abs() > 1e-12).then_some(vector)
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(300))]

        #[test]
        fn the_true_matrix_is_among_those_found_and_all_are_essential(
            points in prop::array::uniform5(prop::array::uniform3(-1.0..1.0)), turn in prop::array::uniform3(-1.0..1.0),
            shift in prop::array::uniform3(-1.0..1.0),
        ) {
            let (rotation, shift) = (Rotation3::new(Vector3::from(turn)), Vector3::from(shift));
            prop_assume!(shift.norm() > 0.2);
            let in_a = points.map(|it| Vector3::from(it) + Vector3::z() * 4.0);
            let in_b = in_a.map(|it| rotation * it + shift);
            let truth = shift.cross_matrix() * rotation.matrix() / 2.0_f64.sqrt() / shift.norm();
            let unit = |list: [Vector3<f64>; 5]| list.map(|it| it / it.z);
            let found = essential_matrices(&unit(in_a), &unit(in_b));
            let error = found.iter().map(|it| (it - truth).norm().min((it + truth).norm())).fold(f64::INFINITY, f64::min);
            prop_assert!(error < 1e-4, "{error} of {}", found.len());
            for matrix in &found {
                let singular = matrix.singular_values();
                prop_assert!((singular[0] - singular[1]).abs() < 1e-3 && singular[2] < 1e-3, "{singular}");
            }
        }
    }

    #[test]
    fn five_times_the_same_pair_fixes_nothing() {
        let (a, b) = (Vector3::new(0.1, 0.2, 1.0), Vector3::new(0.3, -0.1, 1.0));
        assert!(essential_matrices(&[a; 5], &[b; 5]).is_empty());
        assert!(essential_matrices(&[a * f64::NAN; 5], &[b; 5]).is_empty());
    }
}
