//! `structured_light.triangulator`: projector maps in, point clouds out.
//!
//! A plane is linear in pixels when written as inverse depth, 1/z = a + b x + c y: so a point's neighbours give its normal, and which of them are on the
//! same surface. A point with too few such neighbours is left out.

mod around;
mod sights;

use std::collections::VecDeque;
use std::ops::{Range, RangeInclusive};
use std::sync::Arc;

use foveate::geometry::Camera;
use foveate::prelude::*;
use nalgebra::{Isometry3, Matrix3, Point2, SMatrix, Translation3, UnitQuaternion, Vector6};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::orientation::{likely_change, wrong_way};
use crate::pair::{OnRay, triangulate, triangulate_ray};
use crate::pattern::projector_of;
use crate::unfit::{misfit, too_vague};
use around::{Around, Grid};
use sights::{Ideals, Seen, Sights};

ports! {
    MAP: In<ProjectorMap> = each("map");
    WHITE: In<Image> = each("white").optional();
    POSE: In<HeadPose> = each("pose").optional();
    CLOUD: Out<PointCloud> = "cloud";
}

figures! {
    "cloud.points.*": count, neither, "Points, over all maps of the camera" => "points";
    "cloud.unmet.*": count, low, "Pixels of the camera whose ray does not meet the projector's ray or plane in front of both, left out";
    "cloud.misfits.*": count, low, "Pixels of the camera whose projector column and row do not belong to one point, left out";
    "cloud.vague.*": count, low, "Pixels of the camera whose depth would be known less well than `max_sigma`, left out";
    "cloud.alone.*": count, low, "Points of the camera with too few neighbours on the same surface, left out";
    "cloud.sigma_mm.*": mm, low, "Mean standard deviation of the points of the camera, over the three axes" => "stated standard deviation of a point";
}

/// Settings of [`Triangulator`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TriangulatorSettings {
    /// The projector's name in the calibration [–]
    pub projector: String,
    /// How far column and row may be from those of one point on the camera's ray; farther: the pixel is left out [px]
    #[schemars(range(min = 0.01, max = 1000.0))]
    pub max_misfit_px: f64,
    /// Standard deviation of a point along the camera's ray over its distance, at most; more: the pixel is left out. None: three times the median of the map's points, but 0.0005 to 0.002 [–]
    #[schemars(range(min = 0.000001, max = 1.0))]
    pub max_sigma: Option<f64>,
    /// Pixels around a point, to either side, that determine its normal and whether it is on a surface [px]
    #[schemars(range(min = 1, max = 10))]
    pub reach: usize,
    /// Part of these pixels that must be on the same surface for a point to be kept [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_confidence: f64,
    /// Neighbours whose depths differ by a larger part, beyond what noise explains, are on another surface: 0.01 at a slope of 80° a pixel of a thousandth of the distance [–]
    #[schemars(range(min = 0.0001, max = 1.0))]
    pub step: f64,
    /// How well the direction of a camera pixel is known, standard deviation: that of a good calibration [px]
    #[schemars(range(min = 0.0, max = 10.0))]
    pub camera_sigma_px: f64,
    /// Threads over which the rows are spread; the result is the same for any number [–]
    #[schemars(range(min = 1, max = 64))]
    pub threads: usize,
}

impl Default for TriangulatorSettings {
    fn default() -> Self {
        Self {
            projector: "projector".to_owned(),
            max_misfit_px: 2.0,
            max_sigma: None,
            reach: 2,
            min_confidence: 0.25,
            step: 0.01,
            camera_sigma_px: 0.1,
            threads: 2,
        }
    }
}

/// Where nothing is said, points are left out whose standard deviation is above so many times the median of all, within these limits of it over the distance [–].
const TIMES_MEDIAN: f64 = 3.0;
const USUAL_SIGMA: RangeInclusive<f64> = 5e-4..=2e-3;
/// Pixels whose column and row do not belong together are reported from this part on [–].
const TOLD_MISFITS: f64 = 0.05;
/// With this many times as many too uncertain points as others, the cloud is refused: the remaining points are accidental [–].
const TOLD_VAGUE: f64 = 0.15;
const MOST_VAGUE: f64 = 8.0;
/// A pair that is farther apart is reported: its calibration may have another unit than stated [m].
const FAR_APART: f64 = 10.0;
/// White pictures that wait for their map.
const HELD: usize = 4;
/// Poses of a head that wait for their map: as many as a set may have pictures, and again.
const HELD_POSES: usize = 256;
/// Step of derivatives with respect to a pose [rad, m].
const POSE_STEP: f64 = 1e-6;

/// Projector maps in, point clouds out. With `pose` connected the camera stands on a head: as it stood at the time of the map, with the covariance that this pose has, which
/// all points of a cloud share.
pub struct Triangulator {
    settings: TriangulatorSettings,
    camera_name: String,
    camera: Camera,
    projector: Camera,
    ideals: Ideals,
    white: VecDeque<(Time, Arc<Image>)>,
    /// Those that wait for their white pictures.
    maps: VecDeque<Stamped<Arc<ProjectorMap>>>,
    has_white: bool,
    poses: VecDeque<Arc<HeadPose>>,
    has_pose: bool,
    points: u64,
    unmet: u64,
    misfits: u64,
    clouds: u64,
    /// Why the first map that made no cloud made none.
    refused: Option<String>,
    /// What is said of clouds.
    remarks: Vec<String>,
    vague: u64,
    /// Standard deviations of those of the last map, over their distance [–].
    too_vague: Vec<f32>,
    alone: u64,
    sigmas: f64,
}

impl Node for Triangulator {
    const TYPE: &'static str = "structured_light.triangulator";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Triangulates camera and projector to a point cloud with covariances and normals";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TriangulatorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TriangulatorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("max_misfit_px", settings.max_misfit_px, 0.01..=1000.0)?;
        if let Some(it) = settings.max_sigma {
            ConfigError::unless_in("max_sigma", it, 1e-6..=1.0)?;
        }
        ConfigError::unless_in("reach", settings.reach, 1..=10)?;
        ConfigError::unless_in("min_confidence", settings.min_confidence, 0.0..=1.0)?;
        ConfigError::unless_in("step", settings.step, 1e-4..=1.0)?;
        ConfigError::unless_in("camera_sigma_px", settings.camera_sigma_px, 0.0..=10.0)?;
        ConfigError::unless_in("threads", settings.threads, 1..=64)?;
        let camera = setup.camera_model().cloned().ok_or_else(|| {
            ConfigError::node(format_args!("`{}` serves one camera: say which with `camera = \"name\"`", Self::TYPE))
        })?;
        let projector = setup.calibration.cameras[projector_of(setup, &settings.projector)?].camera.clone();
        Ok(Self {
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            has_white: setup.is_connected(&WHITE),
            poses: VecDeque::new(),
            has_pose: setup.is_connected(&POSE),
            settings,
            ideals: Ideals::default(),
            camera,
            projector,
            white: VecDeque::new(),
            maps: VecDeque::new(),
            points: 0,
            unmet: 0,
            misfits: 0,
            clouds: 0,
            refused: None,
            remarks: Vec::new(),
            vague: 0,
            too_vague: Vec::new(),
            alone: 0,
            sigmas: 0.0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(white) = io.take(&WHITE) {
            self.white.push_back((white.time(), white.value));
            if self.white.len() > HELD {
                self.white.pop_front();
            }
        }
        while let Some(pose) = io.take(&POSE) {
            self.poses.push_back(pose.value);
            if self.poses.len() > HELD_POSES {
                self.poses.pop_front();
            }
        }
        while let Some(map) = io.take(&MAP) {
            self.maps.push_back(map);
        }
        // The white picture of a map may come after it.
        let is_whole =
            |it: &Self, map: &Stamped<Arc<ProjectorMap>>| !it.has_white || it.white.iter().any(|it| it.0 == map.time());
        while self.maps.len() > HELD || self.maps.front().is_some_and(|map| is_whole(self, map)) {
            let Some(map) = self.maps.pop_front() else { break };
            let pose = self.poses.iter().find(|it| it.time == map.time()).cloned();
            match &pose {
                Some(pose) => self.camera.camera_from_world = pose.camera_from_world,
                None if self.has_pose => {
                    io.gap(
                        &CLOUD,
                        map.time(),
                        "found no pose of the camera's head at the time of the map, expected one",
                    );
                    continue;
                }
                None => {}
            }
            let white = self.white.iter().find(|it| it.0 == map.time()).map(|it| Arc::clone(&it.1));
            if let Some(fault) = self.unfit(&map.value) {
                self.refused.get_or_insert_with(|| fault.clone());
                io.gap(&CLOUD, map.time(), fault);
                continue;
            }
            let white = white.as_deref().filter(|_| self.has_white);
            let before = [self.misfits, self.unmet, self.vague, self.alone];
            self.too_vague.clear();
            let cloud = self.cloud(&map.value, map.time(), white, pose.as_deref());
            let now = [self.misfits, self.unmet, self.vague, self.alone];
            let [misfits, unmet, vague, alone] = [0, 1, 2, 3].map(|it| now[it] - before[it]);
            let points = cloud.len() as u64;
            // Sets of pictures have names, maps of what moves do not: of these many come, and each may lack much.
            let is_set = !map.value.name.is_empty();
            let lost = if is_set { misfits + unmet } else { misfits };
            if is_set && vague as f64 > TOLD_VAGUE * points as f64 && vague > misfits + unmet {
                let fault = too_vague(&map.value, &mut self.too_vague, points);
                if vague as f64 > MOST_VAGUE * points as f64 {
                    self.points -= points;
                    self.refused.get_or_insert_with(|| fault.clone());
                    io.gap(&CLOUD, map.time(), fault);
                    continue;
                }
                self.remarks.push(fault);
            }
            if is_set && misfits as f64 > TOLD_MISFITS * (misfits + points) as f64 && misfits <= points {
                self.remarks.push(format!(
                    "{}: at {:.0} % of the pixels column and row of the projector do not belong to one point, and these are left out, expected few: the calibration of camera or projector is wrong, or \
                     something moved; other points may be off by as much",
                    map.value.name,
                    100.0 * misfits as f64 / (misfits + points) as f64
                ));
            }
            if lost > points {
                self.points -= points;
                let limit = self.settings.max_misfit_px;
                let change = likely_change(&self.camera, &self.projector, &map.value, limit);
                let fault = misfit(&map.value.name, [misfits, unmet], points, change);
                self.refused.get_or_insert_with(|| fault.clone());
                io.gap(&CLOUD, map.time(), fault);
                continue;
            }
            if points == 0 && is_set {
                let fault = format!(
                    "{}: no point: {} pixels have a projector coordinate, expected most of the lit ones; {vague} depths would be less certain than `max_sigma`, {alone} are without neighbours on \
                     the same surface",
                    map.value.name, map.value.n_known
                );
                self.refused.get_or_insert_with(|| fault.clone());
                io.gap(&CLOUD, map.time(), fault);
                continue;
            }
            self.clouds += 1;
            io.emit(&CLOUD, map.stamp, cloud);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = &self.camera_name;
        report.figure(format!("cloud.points.{name}"), self.points as f64);
        report.figure(format!("cloud.unmet.{name}"), self.unmet as f64);
        report.figure(format!("cloud.misfits.{name}"), self.misfits as f64);
        report.figure(format!("cloud.vague.{name}"), self.vague as f64);
        report.figure(format!("cloud.alone.{name}"), self.alone as f64);
        report.figure(format!("cloud.sigma_mm.{name}"), 1e3 * self.sigmas / self.points as f64);
        let apart = (self.camera.centre() - self.projector.centre()).norm();
        if apart > FAR_APART {
            report.remark(format!(
                "{name}: camera and projector are {apart:.1} m apart by the calibration, expected less than {FAR_APART} m: is it in metres? Points have its unit"
            ));
        }
        std::mem::take(&mut self.remarks).into_iter().for_each(|it| report.remark(it));
        match self.refused.take().filter(|_| self.clouds == 0) {
            Some(fault) => Err(NodeError::input(format!("no set of pictures made a point cloud: {fault}"))),
            None => Ok(()),
        }
    }
}

/// How large a standard deviation over the distance a point may have: what is `stated`, or what suits all `ratios`, which change their order [–].
pub(crate) fn max_sigma(stated: Option<f64>, ratios: &mut [f32]) -> f64 {
    let middle = ratios.len() / 2;
    stated.unwrap_or_else(|| {
        let median =
            if ratios.is_empty() { 0.0 } else { f64::from(*ratios.select_nth_unstable_by(middle, f32::total_cmp).1) };
        (TIMES_MEDIAN * median).clamp(*USUAL_SIGMA.start(), *USUAL_SIGMA.end())
    })
}

impl Triangulator {
    fn unfit(&self, map: &ProjectorMap) -> Option<String> {
        let sizes =
            [([map.width, map.height], self.camera.image_size), (map.projector_size, self.projector.image_size)];
        let whose = ["the camera's pictures are", "the projector is"];
        let fault = |((found, expected), whose): (([u32; 2], [u32; 2]), &str)| {
            let [[a, b], [c, d]] = [found, expected];
            (found != expected).then(|| format!("{whose} {a} x {b} px, expected {c} x {d} px as in the calibration"))
        };
        let of_size = sizes.into_iter().zip(whose).find_map(fault);
        of_size.or_else(|| if map.name.is_empty() { None } else { wrong_way(&self.camera, &self.projector, map) })
    }

    fn cloud(&mut self, map: &ProjectorMap, time: Time, white: Option<&Image>, pose: Option<&HeadPose>) -> PointCloud {
        let (width, height) = (map.width as usize, map.height as usize);
        let ideals = std::mem::take(&mut self.ideals).of(&self.camera);
        let sights = Sights::new(&self.camera, &ideals);
        let (max_misfit, projector) = (self.settings.max_misfit_px, &self.projector);
        let bands = over_rows(height, self.settings.threads, |rows| {
            let mut band = Band { found: vec![Seen::NONE; rows.len() * width], ..Band::default() };
            for (at, seen) in (rows.start * width..rows.end * width).zip(&mut band.found) {
                let sample = map.get(at % width, at / width);
                match triangulate_ray(|| sights.ray(at % width, at / width), projector, &sample) {
                    None => band.unmet += u64::from(sample.coordinate.iter().any(|it| it.is_finite())),
                    Some(point) if point.misfit > max_misfit => band.misfits += 1,
                    Some(point) => {
                        *seen = sights.seen(&point);
                        band.ratios.push((point.sigma / point.depth) as f32);
                    }
                }
            }
            band
        });
        self.unmet += bands.iter().map(|it| it.unmet).sum::<u64>();
        self.misfits += bands.iter().map(|it| it.misfits).sum::<u64>();
        let n = width * height;
        let (mut found, mut ratios) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for band in &bands {
            found.extend_from_slice(&band.found);
            ratios.extend_from_slice(&band.ratios);
        }
        let limit = max_sigma(self.settings.max_sigma, &mut ratios) as f32;
        for it in found.iter_mut().filter(|it| it.sigma > limit * it.depth) {
            self.vague += 1;
            self.too_vague.push(it.sigma / it.depth);
            *it = Seen::NONE;
        }
        let mut cloud = PointCloud {
            time,
            camera: map.camera,
            name: map.name.clone(),
            camera_size: [map.width, map.height],
            viewpoint: Some(Viewpoint { camera_from_space: self.camera.camera_from_world }),
            ..PointCloud::default()
        };
        let angle_sigma = self.settings.camera_sigma_px / self.camera.intrinsics.focal[0];
        let of_pose = pose.map_or_else(Matrix3::zeros, |it| self.by_pose(map, &found, it));
        let grid = Grid { found: &found, width, height, sights: &sights, settings: &self.settings };
        let bands = over_rows(height, self.settings.threads, |rows| {
            let (mut points, mut alone) = (Vec::new(), 0);
            for at in (rows.start * width..rows.end * width).filter(|it| !found[*it].depth.is_nan()) {
                let (x, y, point) = (at % width, at / width, &found[at]);
                let Some(ray) = sights.ray(x, y) else { continue };
                let Around { normal, confidence } = grid.around(x, y, point);
                if confidence < grid.settings.min_confidence {
                    alone += 1;
                    continue;
                }
                let (depth, sigma) = (f64::from(point.depth), f64::from(point.sigma));
                let point = OnRay { ray, depth, sigma, misfit: 0.0 };
                let covariance: Matrix3<f64> = point.covariance(angle_sigma) + of_pose;
                points.push(CloudPoint {
                    position: point.point().cast(),
                    covariance: covariance.cast(),
                    normal: normal.cast(),
                    confidence: confidence as f32,
                    pixel: [x as u16, y as u16],
                    colour: white.map_or([255; 3], |it| colour(it, at)),
                });
            }
            (points, alone)
        });
        for (points, alone) in bands {
            self.alone += alone;
            self.points += points.len() as u64;
            for one in &points {
                self.sigmas += f64::from(one.sigma());
                cloud.push(one);
            }
        }
        self.ideals = ideals;
        cloud
    }

    /// The covariance that the camera's pose gives to the points of a map, that in the middle of all points standing for all [m²].
    fn by_pose(&self, map: &ProjectorMap, found: &[Seen], pose: &HeadPose) -> Matrix3<f64> {
        let places: Vec<usize> = (0..found.len()).filter(|it| found[*it].depth.is_finite()).collect();
        let Some(&middle) = places.get(places.len() / 2) else { return Matrix3::zeros() };
        let (x, y) = (middle % map.width as usize, middle / map.width as usize);
        let (pixel, sample) = (Point2::new(x as f64, y as f64), map.get(x, y));
        let moved = |axis: usize, step: f64| {
            let mut off = Vector6::zeros();
            off[axis] = step;
            let turn = UnitQuaternion::from_scaled_axis(off.fixed_rows::<3>(0).into_owned());
            let off = Isometry3::from_parts(Translation3::from(off.fixed_rows::<3>(3).into_owned()), turn);
            let camera = Camera { camera_from_world: pose.camera_from_world * off, ..self.camera.clone() };
            triangulate(&camera, &self.projector, &pixel, &sample).map(|it| it.point())
        };
        let mut slopes = SMatrix::<f64, 3, 6>::zeros();
        for axis in 0..6 {
            if let (Some(ahead), Some(behind)) = (moved(axis, POSE_STEP), moved(axis, -POSE_STEP)) {
                slopes.set_column(axis, &((ahead - behind) / (2.0 * POSE_STEP)));
            }
        }
        slopes * pose.covariance * slopes.transpose()
    }
}

fn colour(image: &Image, at: usize) -> [u8; 3] {
    match image.format {
        PixelFormat::Gray8 => [image.pixels.get(at).copied().unwrap_or(0); 3],
        PixelFormat::Rgb8 => [0, 1, 2].map(|it| image.pixels.get(3 * at + it).copied().unwrap_or(0)),
    }
}

/// What rows of a map have.
#[derive(Default)]
struct Band {
    found: Vec<Seen>,
    /// Standard deviations over distances [–].
    ratios: Vec<f32>,
    unmet: u64,
    misfits: u64,
}

/// What `work` makes of bands of rows, in their order.
fn over_rows<T: Send>(height: usize, threads: usize, work: impl Fn(Range<usize>) -> T + Sync) -> Vec<T> {
    let rows = height.div_ceil(threads).max(1);
    let bands = (0..height).step_by(rows).map(|it| it..(it + rows).min(height));
    if threads == 1 {
        return bands.map(work).collect();
    }
    std::thread::scope(|scope| {
        let work = &work;
        let running: Vec<_> = bands.map(|it| scope.spawn(move || work(it))).collect();
        running.into_iter().map(|it| it.join().unwrap_or_else(|fault| std::panic::resume_unwind(fault))).collect()
    })
}

#[cfg(test)]
mod tests;
