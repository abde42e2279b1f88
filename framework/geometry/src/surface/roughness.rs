//! Roughness of a cloud: the deviation of points from a smooth surface around them.

use std::collections::HashMap;

use nalgebra::{Point3, SMatrix, SVector, Vector3};

use super::SurfacePoint;

/// Neighbours beyond the six numbers of a quadric, at least.
const SPARE: usize = 3;

/// By point: root mean square deviation of it and its neighbours within `radius_m`, along its normal, from the
/// least-squares quadric, corrected for degrees of freedom [m]; `None` where there are too few neighbours or no
/// normal. Only every `stride`-th point is computed.
pub fn roughness(points: &[SurfacePoint], radius_m: f64, stride: usize) -> Vec<Option<f64>> {
    let cell = |position: &Point3<f64>| [0, 1, 2].map(|axis| (position[axis] / radius_m).floor() as i64);
    let mut cells: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for (index, it) in points.iter().enumerate() {
        cells.entry(cell(&it.position)).or_default().push(index);
    }
    let around = |at: &SurfacePoint| {
        let [x, y, z] = cell(&at.position);
        let mut near: Vec<Vector3<f64>> = Vec::new();
        for dx in -1..=1 {
            for dy in -1..=1 {
                for dz in -1..=1 {
                    for index in cells.get(&[x + dx, y + dy, z + dz]).into_iter().flatten() {
                        let off = points[*index].position - at.position;
                        if off.norm() <= radius_m {
                            near.push(off / radius_m);
                        }
                    }
                }
            }
        }
        near
    };
    points.iter().step_by(stride.max(1)).map(|it| Some(radius_m * deviation(&around(it), &it.normal)?)).collect()
}

fn deviation(near: &[Vector3<f64>], normal: &Vector3<f64>) -> Option<f64> {
    const N: usize = 6;
    if near.len() < N + SPARE || normal.norm_squared() < 0.5 {
        return None;
    }
    let first = normal.cross(&Vector3::ith(normal.iamin(), 1.0)).normalize();
    let second = normal.cross(&first);
    let row = |off: &Vector3<f64>| {
        let (x, y) = (off.dot(&first), off.dot(&second));
        SVector::<f64, N>::from([1.0, x, y, x * x, x * y, y * y])
    };
    let (mut matrix, mut side) = (SMatrix::<f64, N, N>::zeros(), SVector::<f64, N>::zeros());
    for off in near {
        let row = row(off);
        matrix += row * row.transpose();
        side += row * off.dot(normal);
    }
    let quadric = matrix.cholesky()?.solve(&side);
    let squares: f64 = near.iter().map(|off| (off.dot(normal) - row(off).dot(&quadric)).powi(2)).sum();
    Some((squares / (near.len() - N) as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn noise_is_found_on_what_bends_and_bending_is_not_noise() {
        let mut random = Random::new(5);
        let mut surface = |noise: f64| -> Vec<SurfacePoint> {
            (0..4000)
                .map(|_| {
                    let (angle, along) = (random.uniform_in(-0.5, 0.5), random.uniform_in(0.0, 0.05));
                    let normal = Vector3::new(angle.cos(), angle.sin(), 0.0);
                    let position = Point3::from(normal * (0.057 + noise * random.normal()) + Vector3::z() * along);
                    SurfacePoint { position, covariance: Matrix3::identity(), normal }
                })
                .collect()
        };
        let typical = |points: &[SurfacePoint]| {
            let all: Vec<f64> = roughness(points, 0.003, 7).into_iter().flatten().collect();
            assert!(all.len() > 500, "{}", all.len());
            (all.iter().map(|it| it * it).sum::<f64>() / all.len() as f64).sqrt()
        };
        let (smooth, rough) = (typical(&surface(0.0)), typical(&surface(7e-6)));
        assert!(smooth < 1e-6, "{smooth}");
        assert!((rough - 7e-6).abs() < 5e-7, "{rough}");
        let few = surface(0.0);
        assert!(roughness(&few[..5], 0.003, 1).iter().all(Option::is_none));
    }
}
