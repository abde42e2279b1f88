//! Starts for the search: from poses at several settings, and from all observations turned back as if by an aligned head.

use foveate_estimation::{Random, statistics};
use nalgebra::{Isometry3, Matrix2, Matrix2x3, Point3, Unit, Vector2, Vector3};

use super::equations::Parameters;
use super::{AxesRule, Prepared, UnitsRule};
use crate::pan_tilt::axis::Axis;
use crate::pan_tilt::head::{PanTiltHead, Setting, Stacking};
use crate::resection::{ResectionOptions, resect, three_points};

/// Settings with fewer targets give no pose.
const LEAST_TARGETS: usize = 6;
/// Poses of settings that fix how the camera turns with pan and tilt.
const LEAST_POSES: usize = 3;
const TRIALS_OF_SETTING: u32 = 300;
/// Triples of targets that are tried for each way to mount the camera.
const TRIALS: u32 = 120;
/// Observations that judge a pose.
const JUDGES: usize = 150;
/// Axes may be this far from aligned, and pixels that follow from it off [rad].
const MISALIGNED: f64 = 0.07;
/// The best few ways to mount the camera are refined.
const REFINED: usize = 2;

/// Starts worth refining, and how many settings gave a pose.
pub(super) fn find(prepared: &Prepared, random: &mut Random) -> (Vec<Parameters>, usize) {
    let poses = poses(prepared, random);
    let mut starts = Vec::new();
    let mut mounts: Vec<[Vector3<f64>; 2]> = Vec::new();
    for (pan, tilt) in [(Vector3::y(), Vector3::x()), (Vector3::x(), Vector3::y())] {
        mounts.extend([[pan, tilt], [pan, -tilt], [-pan, tilt], [-pan, -tilt]]);
    }
    let mut units = [0, 1].map(|axis| match prepared.options.units[axis] {
        UnitsRule::Known(it) | UnitsRule::Near(it) => Some(it.rad_per_unit),
        UnitsRule::Unknown { .. } => None,
    });
    if let Some(turns) = turns(prepared, &poses) {
        units = turns.rad_per_unit.map(Some);
        if prepared.options.axes == AxesRule::Free {
            starts.push(turns);
        }
    }
    if let [Some(pan), Some(tilt)] = units {
        starts.extend(pooled(prepared, &mounts, [pan, tilt], random));
    }
    (starts, poses.len())
}

/// A setting's pose.
struct Posed {
    units: [f64; 2],
    camera_from_world: Isometry3<f64>,
}

/// The camera's pose at each setting with enough targets.
fn poses(prepared: &Prepared, random: &mut Random) -> Vec<Posed> {
    let mut by_setting = vec![Vec::new(); prepared.n_settings];
    prepared.used.iter().enumerate().for_each(|(index, it)| by_setting[it.setting].push(index));
    let mut found = Vec::new();
    for members in by_setting.iter().filter(|it| it.len() >= LEAST_TARGETS) {
        let points: Vec<Point3<f64>> = members.iter().map(|it| prepared.observations[*it].point_in_world).collect();
        let pixels: Vec<_> = members.iter().map(|it| prepared.observations[*it].pixel).collect();
        let sigma_px = sigma(prepared, members);
        let options = ResectionOptions { sigma_px, inlier_px: 4.0 * sigma_px, trials: TRIALS_OF_SETTING };
        let Ok(pose) = resect(&prepared.optics, &points, &pixels, &options, |n| random.below(n)) else { continue };
        let right = pose.right.iter().filter(|it| **it).count();
        if right > LEAST_TARGETS.max(members.len() / 2) - 1 {
            found.push(Posed { units: prepared.used[members[0]].units, camera_from_world: pose.camera_from_world });
        }
    }
    found
}

/// A pixel's error with the target's own, the targets being about as far away as they are spread [px].
fn sigma(prepared: &Prepared, members: &[usize]) -> f64 {
    let places = members.iter().map(|it| prepared.observations[*it].point_in_world.coords);
    let centre = places.clone().sum::<Vector3<f64>>() / members.len() as f64;
    let spread = places.map(|it| (it - centre).norm()).fold(0.0, f64::max).max(f64::MIN_POSITIVE);
    let focal = prepared.optics.intrinsics.focal[0];
    let each = members.iter().map(|it| {
        let it = &prepared.observations[*it];
        it.sigma_px.hypot(focal * (it.point_covariance.trace() / 3.0).sqrt() / spread)
    });
    statistics::median(&each.collect::<Vec<f64>>()).unwrap_or(1.0)
}

/// How the camera turns with pan and tilt, from poses, with both axes through its centre. From one pose to another it turns by −(Δpan v₁ + Δtilt v₂), as far as turns add up; v₁ and v₂ are axes times units. By
/// least squares, repeated with less weight for poses that do not fit.
fn turns(prepared: &Prepared, poses: &[Posed]) -> Option<Parameters> {
    if poses.len() < LEAST_POSES {
        return None;
    }
    let ranges = prepared.ranges(|_| true);
    let scaled = |it: &Posed| Vector2::new(it.units[0] / ranges[0], it.units[1] / ranges[1]);
    let reference = poses.iter().min_by(|a, b| scaled(a).norm().total_cmp(&scaled(b).norm()))?;
    let turned: Vec<(Vector2<f64>, Vector3<f64>)> = poses
        .iter()
        .map(|it| {
            let turn = it.camera_from_world.rotation * reference.camera_from_world.rotation.inverse();
            (scaled(it), -turn.scaled_axis())
        })
        .collect();
    let mut weights = vec![1.0; turned.len()];
    let mut vectors = Matrix2x3::zeros();
    for _ in 0..10 {
        let total: f64 = weights.iter().sum();
        let mean = |sum: &dyn Fn(usize) -> f64| (0..turned.len()).map(|it| weights[it] * sum(it)).sum::<f64>() / total;
        let at = Vector2::from_fn(|row, _| mean(&|it| turned[it].0[row]));
        let by = Vector3::from_fn(|row, _| mean(&|it| turned[it].1[row]));
        let (mut normal, mut right) = (Matrix2::zeros(), Matrix2x3::zeros());
        for ((units, turn), weight) in turned.iter().zip(&weights) {
            normal += (units - at) * (units - at).transpose() * *weight;
            right += (units - at) * (turn - by).transpose() * *weight;
        }
        // Settings along a line do not tell pan from tilt.
        if normal.determinant() < 1e-4 * normal.trace().powi(2) {
            return None;
        }
        vectors = normal.try_inverse()? * right;
        let lengths: Vec<f64> =
            turned.iter().map(|(units, turn)| (turn - by - vectors.transpose() * (units - at)).norm()).collect();
        let scale = statistics::median(&lengths)?.max(1e-6);
        weights.iter_mut().zip(&lengths).for_each(|(weight, it)| *weight = 1.0 / (1.0 + (it / scale).powi(2)));
    }
    let mut rad_per_unit = [0.0; 2];
    let mut axes = Vec::with_capacity(2);
    for axis in 0..2 {
        let vector = vectors.row(axis).transpose() / ranges[axis];
        rad_per_unit[axis] = match prepared.options.units[axis] {
            UnitsRule::Known(it) | UnitsRule::Near(it) => it.rad_per_unit,
            UnitsRule::Unknown { .. } => vector.norm(),
        };
        axes.push(Axis::through_origin(vector * rad_per_unit[axis].signum())?);
    }
    let angles = [0, 1].map(|axis| reference.units[axis] * rad_per_unit[axis]);
    // Seen from the camera, the carried axis is always the same, the other is turned back by it.
    let (outer, inner) = match prepared.options.stacking {
        Stacking::TiltOnPan => (0, 1),
        Stacking::PanOnTilt => (1, 0),
    };
    axes[outer].direction = axes[inner].turn(angles[inner]).rotation * axes[outer].direction;
    let mut head = prepared.head([axes[0], axes[1]]);
    let camera_from_rest = head.camera_from_rest(&Setting::new(angles[0], angles[1]));
    head.at_rest.camera_from_world = camera_from_rest.inverse() * reference.camera_from_world;
    Some(prepared.parameters(head, rad_per_unit))
}

/// For the best few of `mounts` (directions of pan and tilt in the camera): the pose at rest by which most observations, turned back by the
/// mount's angles, lie in the directions of their targets.
fn pooled(
    prepared: &Prepared,
    mounts: &[[Vector3<f64>; 2]],
    rad_per_unit: [f64; 2],
    random: &mut Random,
) -> Vec<Parameters> {
    let usable: Vec<usize> = (0..prepared.used.len()).filter(|it| prepared.directions[*it].is_some()).collect();
    let n = usable.len() as u32;
    if n < 4 {
        return Vec::new();
    }
    let judges: Vec<usize> = (0..usable.len().min(JUDGES)).map(|_| random.below(n) as usize).collect();
    let limit = MISALIGNED + 3.0 * sigma(prepared, &usable) / prepared.optics.intrinsics.focal[0];
    let points: Vec<Point3<f64>> = usable.iter().map(|it| prepared.observations[*it].point_in_world).collect();
    let mut found: Vec<(f64, Parameters)> = Vec::new();
    for mount in mounts {
        let through = |direction| Axis { point: Point3::origin(), direction: Unit::new_normalize(direction) };
        let head = prepared.head(mount.map(through));
        let mut parameters = prepared.parameters(head, rad_per_unit);
        let turned_back = usable.iter().filter_map(|it| {
            let [pan, tilt] = parameters.angles(&prepared.used[*it]);
            let turn = parameters.head.camera_from_rest(&Setting::new(pan, tilt)).rotation;
            Some(Unit::new_normalize(turn.inverse() * prepared.directions[*it]?))
        });
        let directions: Vec<Unit<Vector3<f64>>> = turned_back.collect();
        let cost_of = |pose: &Isometry3<f64>| {
            let miss = |it: &usize| {
                let place = (pose * points[*it]).coords;
                place.cross(&directions[*it]).norm().atan2(place.dot(&directions[*it])).min(limit).powi(2)
            };
            judges.iter().map(miss).sum::<f64>()
        };
        let mut best: Option<(f64, Isometry3<f64>)> = None;
        for _ in 0..TRIALS {
            let drawn = [(); 3].map(|()| random.below(n) as usize);
            for pose in three_points::poses(&drawn.map(|it| points[it]), &drawn.map(|it| directions[it])) {
                let cost = cost_of(&pose);
                if best.as_ref().is_none_or(|it| cost < it.0) {
                    best = Some((cost, pose));
                }
            }
        }
        if let Some((cost, pose)) = best {
            parameters.head.at_rest.camera_from_world = pose;
            found.push((cost, parameters));
        }
    }
    found.sort_by(|a, b| a.0.total_cmp(&b.0));
    found.into_iter().take(REFINED).map(|it| it.1).collect()
}

impl Prepared<'_> {
    fn head(&self, [pan, tilt]: [Axis; 2]) -> PanTiltHead {
        let aligned = PanTiltHead::aligned(self.optics.clone(), self.options.limits);
        PanTiltHead { pan, tilt, stacking: self.options.stacking, ..aligned }
    }
}
