//! `structured_light.points`: matches pixels of cameras and projector that show the same point of any lit scene.
//!
//! The projector's picture is a grid of cells. The camera pixel that is lit from the middle of a cell follows from the pixels around it: u and v as linear functions of x and y, inverted.
//! So a set of a static code gives many numbered points, which the projector and all cameras that decoded it share, and `foveate calibrate` calibrates the
//! projector like a camera. No board is needed.

use std::collections::{BTreeMap, BTreeSet};

use foveate::prelude::*;
use nalgebra::{Matrix2, Matrix3, Point2, Vector2, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::pattern::projector_of;

ports! {
    MAP: In<ProjectorMap> = each("map").many();
    FEATURES: Out<Features> = "features";
}

figures! {
    "points.features.*": count, high, "Cells of the projector found in the maps of a camera, over all sets";
    "points.sets.*": count, high, "Maps of the camera with at least one cell";
}

/// Settings of [`Points`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PointsSettings {
    /// The projector's name in the calibration [–]
    pub projector: String,
    /// Side of a cell of the projector's picture, in each of which one point is taken [px]
    #[schemars(range(min = 8, max = 512))]
    pub cell_px: u32,
    /// Pixels of the camera around a point, to either side, that place it [px]
    #[schemars(range(min = 2, max = 20))]
    pub reach: usize,
    /// Largest root mean square distance of these from the fitted surface: edges are left out [projector px]
    #[schemars(range(min = 0.01, max = 10.0))]
    pub max_misfit_px: f64,
}

impl Default for PointsSettings {
    fn default() -> Self {
        // Cells of 32 px make 768 points of a projector of 1024 × 768: more add time, and no directions.
        Self { projector: crate::pattern::default_projector(), cell_px: 32, reach: 4, max_misfit_px: 0.3 }
    }
}

/// Of the pixels around a point, this part must know both coordinates [–].
const MIN_KNOWN: f64 = 0.8;
/// Neighbouring pixels share the boundaries that they come from: so many of them tell as much as one [–].
const SHARED: f64 = 16.0;
/// No point is taken to be known better than this [px].
const BEST_SIGMA: f64 = 0.05;

/// Maps of one or more cameras in; numbered points out, for each camera what it saw, and for the projector where it lit them.
pub struct Points {
    settings: PointsSettings,
    projector: CameraId,
    names: Vec<String>,
    /// The set in work, and the points that the projector was said to light in it.
    lit: (Time, BTreeSet<u32>),
    /// By camera: sets and points.
    found: BTreeMap<CameraId, [u64; 2]>,
    remarks: Vec<String>,
}

impl Node for Points {
    const TYPE: &'static str = "structured_light.points";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Matches scene points between cameras and projector, to calibrate without a board";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = PointsSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: PointsSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("cell_px", settings.cell_px, 8..=512)?;
        ConfigError::unless_in("reach", settings.reach, 2..=20)?;
        ConfigError::unless_in("max_misfit_px", settings.max_misfit_px, 0.01..=10.0)?;
        let projector = CameraId(projector_of(setup, &settings.projector)? as u16);
        let names = setup.calibration.cameras.iter().map(|it| it.name.clone()).collect();
        let (lit, found) = ((Time::ZERO, BTreeSet::new()), BTreeMap::new());
        Ok(Self { settings, projector, names, lit, found, remarks: Vec::new() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(map) = io.take(&MAP) {
            if self.lit.0 != map.time() {
                self.lit = (map.time(), BTreeSet::new());
            }
            let list = self.points(&map.value);
            let counts = self.found.entry(map.value.camera).or_default();
            counts[0] += u64::from(!list.is_empty());
            counts[1] += list.len() as u64;
            if list.is_empty() {
                self.remarks.push(format!(
                    "{}: no surface around any middle of a cell of {} px: {} pixels have a projector coordinate, expected {} x {} of them with both coordinates",
                    map.value.name,
                    self.settings.cell_px,
                    map.value.n_known,
                    2 * self.settings.reach + 1,
                    2 * self.settings.reach + 1
                ));
                continue;
            }
            // The projector lights a point once, however many cameras see it.
            let fresh = |it: &&Feature| it.label.is_some_and(|it| !self.lit.1.contains(&it));
            let columns = self.columns(&map.value);
            let lit: Vec<Feature> = list.iter().filter(fresh).map(|it| self.in_projector(columns, it)).collect();
            self.lit.1.extend(lit.iter().filter_map(|it| it.label));
            io.emit(&FEATURES, map.stamp, Features { camera: map.value.camera, list });
            io.emit(&FEATURES, map.stamp, Features { camera: self.projector, list: lit });
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        for (camera, [sets, points]) in &self.found {
            let name = self.names.get(usize::from(camera.0)).cloned().unwrap_or_else(|| camera.0.to_string());
            report.figure(format!("points.sets.{name}"), *sets as f64);
            report.figure(format!("points.features.{name}"), *points as f64);
        }
        report.remarks.append(&mut self.remarks);
        Ok(())
    }
}

impl Points {
    fn columns(&self, map: &ProjectorMap) -> u32 {
        map.projector_size[0].div_ceil(self.settings.cell_px)
    }

    /// The middle of a cell [projector px].
    fn middle(&self, columns: u32, label: u32) -> Point2<f64> {
        let of = |it: u32| (f64::from(it) + 0.5) * f64::from(self.settings.cell_px) - 0.5;
        Point2::new(of(label % columns), of(label / columns))
    }

    fn in_projector(&self, columns: u32, seen: &Feature) -> Feature {
        let label = seen.label.unwrap_or_default();
        let covariance = Matrix2::identity() * BEST_SIGMA * BEST_SIGMA;
        Feature { centre: self.middle(columns, label), covariance, area: 0, peak: 0, label: seen.label }
    }

    /// Where the camera sees the middles of cells.
    fn points(&self, map: &ProjectorMap) -> Vec<Feature> {
        let columns = self.columns(map);
        let cell = f64::from(self.settings.cell_px);
        // By cell the pixel that is lit from nearest to its middle.
        let mut nearest: BTreeMap<u32, (f64, [usize; 2])> = BTreeMap::new();
        for y in 0..map.height as usize {
            for x in 0..map.width as usize {
                let [u, v] = map.get(x, y).coordinate.map(f64::from);
                let [columns_px, rows_px] = map.projector_size.map(f64::from);
                if !((0.0..columns_px).contains(&u) && (0.0..rows_px).contains(&v)) {
                    continue;
                }
                let label = ((u + 0.5) / cell) as u32 + columns * ((v + 0.5) / cell) as u32;
                let off = (Point2::new(u, v) - self.middle(columns, label)).norm();
                let entry = nearest.entry(label).or_insert((off, [x, y]));
                if off < entry.0 {
                    *entry = (off, [x, y]);
                }
            }
        }
        let point =
            |(label, (_, at)): (u32, (f64, [usize; 2]))| self.point(map, label, self.middle(columns, label), at);
        nearest.into_iter().filter_map(point).collect()
    }

    fn point(&self, map: &ProjectorMap, label: u32, middle: Point2<f64>, at: [usize; 2]) -> Option<Feature> {
        let reach = self.settings.reach;
        let [left, top] = [at[0].checked_sub(reach)?, at[1].checked_sub(reach)?];
        let mut samples: Vec<(Vector3<f64>, Vector2<f64>)> = Vec::new();
        for y in top..=at[1] + reach {
            for x in left..=at[0] + reach {
                let [u, v] = map.get(x, y).coordinate.map(f64::from);
                if u.is_finite() && v.is_finite() {
                    let beside = Vector3::new(1.0, x as f64 - at[0] as f64, y as f64 - at[1] as f64);
                    samples.push((beside, Vector2::new(u, v) - middle.coords));
                }
            }
        }
        let n = ((2 * reach + 1) * (2 * reach + 1)) as f64;
        if (samples.len() as f64) < MIN_KNOWN * n {
            return None;
        }
        let normal: Matrix3<f64> = samples.iter().map(|it| it.0 * it.0.transpose()).sum();
        let inverse = normal.try_inverse()?;
        let fit = [0, 1].map(|axis| inverse * samples.iter().map(|it| it.0 * it.1[axis]).sum::<Vector3<f64>>());
        let off = |it: &(Vector3<f64>, Vector2<f64>)| [0, 1].map(|axis| fit[axis].dot(&it.0) - it.1[axis]);
        let squares: f64 = samples.iter().map(|it| off(it).iter().map(|it| it * it).sum::<f64>()).sum();
        let variance = squares / (2.0 * samples.len() as f64);
        if variance.sqrt() > self.settings.max_misfit_px {
            return None;
        }
        let slope = Matrix2::new(fit[0].y, fit[0].z, fit[1].y, fit[1].z);
        let back = slope.try_inverse()?;
        let step = back * -Vector2::new(fit[0].x, fit[1].x);
        // Beyond the pixels that tell it, the surface is not known.
        if !step.iter().all(|it| it.abs() <= reach as f64) {
            return None;
        }
        let beside = Vector3::new(1.0, step.x, step.y);
        let of_fit = variance * SHARED * (beside.transpose() * inverse * beside).x;
        let covariance = back * back.transpose() * of_fit + Matrix2::identity() * BEST_SIGMA * BEST_SIGMA;
        let centre = Point2::new(at[0] as f64 + step.x, at[1] as f64 + step.y);
        Some(Feature { centre, covariance, area: 0, peak: 0, label: Some(label) })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;

    /// A projector whose columns and rows a camera sees turned by a little and 1.7 times as wide, from column 3 on; nothing is known right of `known`.
    fn map(camera: u16, known: usize) -> ProjectorMap {
        let mut map = ProjectorMap {
            camera: CameraId(camera),
            projector_size: [128, 96],
            width: 240,
            height: 180,
            ..ProjectorMap::default()
        };
        for (y, x) in (0..180).flat_map(|y| (0..240).map(move |x| (y, x))) {
            let coordinate = [place(x as f64, y as f64).x as f32, place(x as f64, y as f64).y as f32];
            map.push(if x < known { ProjectorSample { coordinate, sigma: [0.05; 2] } } else { ProjectorSample::NONE });
        }
        map
    }

    fn place(x: f64, y: f64) -> Point2<f64> {
        Point2::new(3.0 + 0.58 * x + 0.03 * y, 2.0 - 0.02 * x + 0.55 * y)
    }

    fn bench() -> NodeBench<Points> {
        let calibration = foveate_testkit::scene::ring_calibration(3);
        let projector = calibration.cameras[2].name.clone();
        let setup = Setup { calibration: Arc::new(calibration), ..Setup::for_tests() };
        let settings = PointsSettings { projector, cell_px: 16, ..PointsSettings::default() };
        NodeBench::with_setup(settings, &setup).unwrap()
    }

    #[test]
    fn a_camera_sees_the_middle_of_each_cell_where_it_is_lit_from_it() {
        let mut bench = bench();
        bench.feed(&MAP, Time::ZERO, map(0, 150)).unwrap();
        let out = bench.outputs(&FEATURES);
        let [seen, lit] = [&out[0].value, &out[1].value];
        assert_eq!((seen.camera, lit.camera, seen.list.len()), (CameraId(0), CameraId(2), lit.list.len()));
        assert!(seen.list.len() >= 30, "{}", seen.list.len());
        for (seen, lit) in seen.list.iter().zip(&lit.list) {
            assert_eq!(seen.label, lit.label);
            assert!((place(seen.centre.x, seen.centre.y) - lit.centre).norm() < 1e-4, "{seen:?} {lit:?}");
            assert!(seen.centre.x < 150.0);
        }
        let report = bench.finish().unwrap();
        assert_eq!(report.remarks, Vec::<String>::new());
    }

    #[test]
    fn two_cameras_share_numbers_and_the_projector_lights_each_point_once() {
        let mut bench = bench();
        bench.feed(&MAP, Time::ZERO, map(0, 120)).unwrap();
        bench.feed(&MAP, Time::ZERO, map(1, 240)).unwrap();
        let out = bench.outputs(&FEATURES);
        let labels = |at: usize| -> BTreeSet<u32> { out[at].value.list.iter().filter_map(|it| it.label).collect() };
        assert!(labels(0).is_subset(&labels(2)) && labels(0).len() < labels(2).len());
        assert!(labels(1).is_disjoint(&labels(3)));
        assert_eq!(labels(1).union(&labels(3)).copied().collect::<BTreeSet<u32>>(), labels(2));
    }

    #[test]
    fn edges_are_left_out_and_a_map_without_surfaces_is_told() {
        let mut bench = bench();
        let whole = map(0, 240);
        let mut broken = ProjectorMap { samples: Vec::new(), n_known: 0, name: "pose".to_owned(), ..whole.clone() };
        for (y, x) in (0..180).flat_map(|y| (0..240).map(move |x| (y, x))) {
            let mut sample = whole.get(x, y);
            sample.coordinate[0] += 3.0 * ((x / 4 + y / 4) % 2) as f32;
            broken.push(sample);
        }
        bench.feed(&MAP, Time::ZERO, broken).unwrap();
        assert_eq!(bench.outputs(&FEATURES).len(), 0);
        let said = bench.finish().unwrap().remarks.concat();
        assert!(said.contains("pose: no surface around any middle of a cell of 16 px"), "{said}");
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<Points>("cell_px = 24");
    }
}
