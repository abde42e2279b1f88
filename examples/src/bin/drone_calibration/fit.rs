//! One camera's pose and clock against the path, and camera places against surveyed ones.

use foveate::estimation::Random;
use foveate::geometry::{Camera, ResectionFault, ResectionRules, refine_pose, resect};
use nalgebra::{Isometry3, Matrix3, Point2, Point3, Vector3};

use crate::read::Path3;

/// Start and end of the path are searched this far apart from those of the pictures [s].
const OFFSETS_S: std::ops::RangeInclusive<i32> = -120..=120;
const COARSE_STEPS_PER_S: i32 = 4;
/// Pixels closer together than this tell the same [s].
const THINNED_S: f64 = 0.2;
/// Hand labels, RTK antenna and lens together, as an angle [rad].
const SIGMA_RAD: f64 = 1.5e-3;
const RIGHT_RAD: f64 = 5e-3;
/// While the offset is known to a quarter second only [rad].
const COARSE_RAD: f64 = 2e-2;

/// A camera's pose and clock.
pub struct Fitted {
    /// World: that of the path.
    pub camera_from_world: Isometry3<f64>,
    /// Path time = `offset_s` + `rate` · camera time [s].
    pub offset_s: f64,
    /// See `offset_s`.
    pub rate: f64,
    /// Mean robust loss, in units of the squared sigma.
    pub loss: f64,
    /// Pixels that agree with the path.
    pub n_right: usize,
    /// All pixels.
    pub n_pairs: usize,
    /// Of those that agree [px].
    pub rms_px: f64,
    /// Root of the trace of the centre's covariance [m].
    pub centre_sigma_m: f64,
}

/// Fits `camera`'s pose and clock to what it saw (`seen`: picture number and pixel) while the path was between the times `between`.
pub fn fit_camera(
    camera: &Camera,
    frame_rate_hz: f64,
    seen: &[(f64, Point2<f64>)],
    path: &Path3,
    between: [f64; 2],
) -> Result<Fitted, String> {
    let focal = 0.5 * (camera.intrinsics.focal[0] + camera.intrinsics.focal[1]);
    let rules =
        |right: f64, trials: u32| ResectionRules { sigma_px: SIGMA_RAD * focal, inlier_px: right * focal, trials };
    let mut thinned: Vec<(f64, Point2<f64>)> = Vec::new();
    for &(picture, pixel) in seen {
        let time = picture / frame_rate_hz;
        if thinned.last().is_none_or(|it| time - it.0 >= THINNED_S) {
            thinned.push((time, pixel));
        }
    }
    let pairs = |offset: f64, rate: f64, every: usize| -> (Vec<Point3<f64>>, Vec<Point2<f64>>) {
        let at = |(camera_s, pixel): &(f64, Point2<f64>)| {
            let time = offset + rate * camera_s;
            Some((path.at(time).filter(|_| (between[0]..between[1]).contains(&time))?, *pixel))
        };
        thinned.iter().step_by(every).filter_map(at).unzip()
    };

    // The offset at which the most pixels agree with one pose.
    let coarse_rules = rules(COARSE_RAD, 150);
    let mut random = Random::new(1).fork("drone_calibration");
    let mut best: Option<(usize, f64, Isometry3<f64>)> = None;
    for step in OFFSETS_S.start() * COARSE_STEPS_PER_S..=OFFSETS_S.end() * COARSE_STEPS_PER_S {
        let offset = f64::from(step) / f64::from(COARSE_STEPS_PER_S);
        let (points, pixels) = pairs(offset, 1.0, 3);
        if points.len() < 30 {
            continue;
        }
        if let Ok(found) = resect(camera, &points, &pixels, &coarse_rules, |n| random.below(n)) {
            let n_right = found.right.iter().filter(|it| **it).count();
            if best.as_ref().is_none_or(|it| n_right > it.0) {
                best = Some((n_right, offset, found.camera_from_world));
            }
        }
    }
    let (_, start, pose) = best.ok_or("at no offset do 30 pixels meet the path")?;

    // Offset in the middle of what was seen, and rate, in turns; the pose follows each time.
    let fine = rules(RIGHT_RAD, 500);
    let (points, _) = pairs(start, 1.0, 1);
    let middle = 0.5 * (between[0] + between[1]) - start;
    let mut posed = Camera { camera_from_world: pose, ..camera.clone() };
    let (mut shift, mut rate) = (start + middle, 1.0);
    let solve = |posed: &Camera, shift: f64, rate: f64| {
        let (points, pixels) = pairs(shift - rate * middle, rate, 1);
        refine_pose(posed, &points, &pixels, &fine)
    };
    let loss = |posed: &Camera, shift: f64, rate: f64| {
        solve(posed, shift, rate).map_or(f64::INFINITY, |it| it.loss_px2 / fine.sigma_px.powi(2))
    };
    for (reach, reach_of_rate) in [(0.4, 0.0), (0.15, 2e-3), (0.1, 1e-3), (0.05, 5e-4), (0.02, 2e-4)] {
        shift = least(shift, reach, |it| loss(&posed, it, rate));
        if reach_of_rate > 0.0 {
            rate = least(rate, reach_of_rate, |it| loss(&posed, shift, it));
        }
        let found = solve(&posed, shift, rate).map_err(|fault: ResectionFault| fault.to_string())?;
        posed.camera_from_world = found.camera_from_world;
    }
    let found = solve(&posed, shift, rate).map_err(|fault| fault.to_string())?;
    Ok(Fitted {
        camera_from_world: found.camera_from_world,
        offset_s: shift - rate * middle,
        rate,
        loss: found.loss_px2 / fine.sigma_px.powi(2),
        n_right: found.right.iter().filter(|it| **it).count(),
        n_pairs: points.len().min(found.right.len()),
        rms_px: found.residuals_rms_px,
        centre_sigma_m: found.centre_covariance().trace().sqrt(),
    })
}

/// Where `of` is least, within `reach` of `middle`: by the golden section, to a thousandth of it.
fn least(middle: f64, reach: f64, of: impl Fn(f64) -> f64) -> f64 {
    let golden = 0.5 * (5.0_f64.sqrt() - 1.0);
    let (mut low, mut high) = (middle - reach, middle + reach);
    let mut inner = [high - golden * (high - low), low + golden * (high - low)];
    let mut values = inner.map(&of);
    while high - low > 2e-3 * reach {
        if values[0] < values[1] {
            high = inner[1];
            inner = [high - golden * (high - low), inner[0]];
            values = [of(inner[0]), values[0]];
        } else {
            low = inner[0];
            inner = [inner[1], low + golden * (high - low)];
            values = [values[1], of(inner[1])];
        }
    }
    0.5 * (low + high)
}

/// The order of `surveyed` in which it fits `centres` best after a rotation and a shift: root mean square distance [m], and the row of each.
pub fn best_rigid_fit(centres: &[Point3<f64>], surveyed: &[Point3<f64>]) -> Result<(f64, Vec<usize>), String> {
    if centres.len() != surveyed.len() || centres.len() > 8 {
        return Err(format!(
            "{} cameras and {} surveyed places, expected as many of each, at most 8",
            centres.len(),
            surveyed.len()
        ));
    }
    let mut best = (f64::INFINITY, Vec::new());
    let mut rows: Vec<usize> = (0..centres.len()).collect();
    permute(&mut rows, 0, &mut |rows| {
        let rms = rigid_rms(centres, &rows.iter().map(|it| surveyed[*it]).collect::<Vec<_>>());
        if rms < best.0 {
            best = (rms, rows.to_vec());
        }
    });
    Ok(best)
}

fn permute(rows: &mut [usize], from: usize, each: &mut impl FnMut(&[usize])) {
    if from == rows.len() {
        return each(rows);
    }
    for other in from..rows.len() {
        rows.swap(from, other);
        permute(rows, from + 1, each);
        rows.swap(from, other);
    }
}

/// Distance left after the best rotation and shift (S. Umeyama, TPAMI 13(4), 1991), root mean square.
fn rigid_rms(a: &[Point3<f64>], b: &[Point3<f64>]) -> f64 {
    let n = a.len() as f64;
    let centroid = |list: &[Point3<f64>]| list.iter().fold(Vector3::zeros(), |sum, it| sum + it.coords) / n;
    let (of_a, of_b) = (centroid(a), centroid(b));
    let mut covariance = Matrix3::zeros();
    for (a, b) in a.iter().zip(b) {
        covariance += (b.coords - of_b) * (a.coords - of_a).transpose();
    }
    let svd = covariance.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else { return f64::INFINITY };
    let sign = (u.determinant() * v_t.determinant()).signum();
    let rotation = u * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, sign)) * v_t;
    let squares = a.iter().zip(b).map(|(a, b)| (b.coords - of_b - rotation * (a.coords - of_a)).norm_squared());
    (squares.sum::<f64>() / n).sqrt()
}
