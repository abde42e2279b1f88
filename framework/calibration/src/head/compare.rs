//! Three models of a camera on a head, fitted to the same observations: [Davis 2002 §4.5], Figures 51 and 52.
//!
//! | here | there |
//! |---|---|
//! | [`Comparison::home`] | the pose by what was seen at home alone; axes as they should be |
//! | [`Comparison::aligned`] | the pose by all that was seen; axes as they should be: equation (1) |
//! | [`Comparison::free`] | pose and axes by all that was seen: equation (2) |

use foveate_estimation::{Random, statistics};
use foveate_geometry::pan_tilt::{
    AxesRule, AxisUnits, HeadCalibration, HeadCalibrationError, HeadObservation, HeadOptions, PanTiltHead, Setting,
    calibrate_head, refine_head,
};
use foveate_geometry::{Camera, ResectionOptions, resect};
use nalgebra::{Point2, Point3, Vector2};

/// Fewer targets at home give no pose.
const LEAST_AT_HOME: usize = 6;
const TRIALS: u32 = 500;

/// A fitted model and its errors.
#[derive(Debug, Clone, PartialEq)]
pub struct ModelFit {
    /// The head by that model.
    pub head: PanTiltHead,
    /// By observation: seen − measured [px]; `None` where the model's camera does not see the target.
    pub errors: Vec<Option<Vector2<f64>>>,
    /// Median length of all errors; infinite when most targets are not seen [px].
    pub median_px: f64,
    /// Root of the mean squared length of those of right observations, as the last model has it [px].
    pub rms_px: f64,
}

/// Three models of one head.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// The model from observations at home alone; `None` when too little was seen there.
    pub home: Option<ModelFit>,
    /// The model with aligned axes; `None` when it explains nothing.
    pub aligned: Option<ModelFit>,
    /// The model with free axes, which a calibration keeps.
    pub free: ModelFit,
    /// All details of the last fit.
    pub calibration: HeadCalibration,
}

impl Comparison {
    /// The three models under the paper's names, in its order.
    pub fn models(&self) -> [(&'static str, Option<&ModelFit>); 3] {
        [
            ("home position alone", self.home.as_ref()),
            ("aligned axes (1)", self.aligned.as_ref()),
            ("free axes (2)", Some(&self.free)),
        ]
    }
}

/// Fits the three models. `options` are those of the last; the others use them except for the axes. Where the observations alone give no start, the search begins at the
/// head that is `stated` (a plan, an older calibration) with its units, and is accepted if it explains most observations.
///
/// # Errors
/// When the last cannot be fitted, or is undetermined.
pub fn compare(
    optics: &Camera,
    stated: Option<(&PanTiltHead, [AxisUnits; 2])>,
    observations: &[HeadObservation],
    options: &HeadOptions,
) -> Result<Comparison, HeadCalibrationError> {
    let calibration = calibrate_head(optics, observations, options).or_else(|fault| {
        let refined = stated.and_then(|(head, units)| refine_head(head, units, observations, options).ok());
        let explains = |it: &HeadCalibration| 2 * it.right.iter().filter(|it| **it).count() > observations.len();
        refined.filter(explains).ok_or(fault)
    })?;
    // It misses by more than its noise, which is no reason to refuse it here.
    let loose = HeadOptions {
        axes: AxesRule::Aligned,
        most_place_sigma: f64::MAX,
        most_direction_sigma: f64::MAX,
        holdout_parts: 0,
        ..options.clone()
    };
    let aligned = calibrate_head(optics, observations, &loose).ok();
    let units = calibration.units;
    let fit = |head: PanTiltHead, units| model_fit(head, units, observations, &calibration.right);
    let home = at_home(optics, observations, &calibration, aligned.as_ref());
    Ok(Comparison {
        home: home.map(|head| fit(head, units)),
        aligned: aligned.map(|it| fit(it.head, it.units)),
        free: fit(calibration.head.clone(), units),
        calibration,
    })
}

fn model_fit(head: PanTiltHead, units: [AxisUnits; 2], observations: &[HeadObservation], right: &[bool]) -> ModelFit {
    let error = |it: &HeadObservation| {
        let setting = Setting::new(units[0].angle(it.pan), units[1].angle(it.tilt));
        Some(head.camera_at(&setting).project(&it.point_in_world)? - it.pixel)
    };
    let errors: Vec<Option<Vector2<f64>>> = observations.iter().map(error).collect();
    let lengths: Vec<f64> = errors.iter().map(|it| it.map_or(f64::INFINITY, |it| it.norm())).collect();
    let squares: Vec<f64> = lengths.iter().zip(right).filter(|it| *it.1).map(|it| it.0 * it.0).collect();
    let rms_px = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
    ModelFit { head, median_px: statistics::median(&lengths).unwrap_or(f64::INFINITY), rms_px, errors }
}

/// The pose by what was seen at the setting nearest to rest that has enough, carried to rest by axes that are as they should be: along the image
/// and through the lens, in the way that the camera is mounted.
fn at_home(
    optics: &Camera,
    observations: &[HeadObservation],
    found: &HeadCalibration,
    aligned: Option<&HeadCalibration>,
) -> Option<PanTiltHead> {
    let mut settings: Vec<[f64; 2]> = Vec::new();
    for it in observations {
        if !settings.contains(&[it.pan, it.tilt]) {
            settings.push([it.pan, it.tilt]);
        }
    }
    let angles = |it: &[f64; 2]| [found.units[0].angle(it[0]), found.units[1].angle(it[1])];
    let from_rest = |it: &[f64; 2]| {
        let [pan, tilt] = angles(it);
        pan.hypot(tilt)
    };
    settings.sort_by(|a, b| from_rest(a).total_cmp(&from_rest(b)));
    let here = |home: &[f64; 2]| -> Vec<&HeadObservation> {
        observations.iter().filter(|it| [it.pan, it.tilt] == *home).collect()
    };
    let home = settings.iter().find(|it| here(it).len() >= LEAST_AT_HOME)?;
    let list = here(home);
    let points: Vec<Point3<f64>> = list.iter().map(|it| it.point_in_world).collect();
    let pixels: Vec<Point2<f64>> = list.iter().map(|it| it.pixel).collect();
    let sigma_px = statistics::median(&list.iter().map(|it| it.sigma_px).collect::<Vec<f64>>())?;
    // As far off as the pixels and targets together are found to be.
    let sigma_px = sigma_px * found.noise_factor.max(1.0);
    let inlier_px = 4.0 * sigma_px.max(found.median_px);
    let mut random = Random::new(1);
    let options = ResectionOptions { sigma_px, inlier_px, trials: TRIALS };
    let pose = resect(optics, &points, &pixels, &options, |n| random.below(n)).ok()?.camera_from_world;
    let mut head = match aligned {
        Some(it) => it.head.clone(),
        None => PanTiltHead::aligned(optics.clone(), found.head.limits),
    };
    let [pan, tilt] = angles(home);
    head.at_rest.camera_from_world = head.camera_from_rest(&Setting::new(pan, tilt)).inverse() * pose;
    Some(head)
}
