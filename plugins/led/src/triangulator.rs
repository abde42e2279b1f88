//! `led.triangulator`: the synchronised alternative to the integrator, for comparison [Davis 2002 §3.4].
//!
//! Each set of frames of one time is solved on its own: points where lines of sight meet, each refined on its pixels by least
//! squares, cameras that do not fit left out. Identity from set to set is by proximity alone, which the paper criticises.

use foveate::geometry::{Camera, PixelNoise, Triangulation, refine};
use foveate::prelude::*;
use nalgebra::{Matrix2, Matrix6, Point2, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use smallvec::SmallVec;

use crate::consensus::{Consensus, ConsensusOptions, Meeting, RayObservation};

ports! {
    FEATURES: In<Features> = synced("features", 4).many();
    TARGETS: Out<Targets> = "targets";
}

figures! {
    "triangulator.sets": count, neither, "Sets of synchronised frames";
        "triangulator.targets": count, neither, "Targets sent, over all sets";
        "triangulator.identities": count, neither, "Different identities of targets";
        "triangulator.outliers_rejected": count, low, "Lines of sight left out because they were more than outlier_px off";
}

/// Settings of [`TriangulatorNode`]; lengths as for the integrator.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TriangulatorSettings {
    /// Lines of sight this close to a point meet there [mm].
    #[schemars(range(min = 0.001, max = 1000000.0))]
    pub tolerance_mm: f64,
    /// Different cameras that a target needs [–].
    #[schemars(range(min = 2, max = 1000))]
    pub min_cameras: u32,
    /// Two lines of sight fix a point only at this angle or more [deg].
    #[schemars(range(min = 0.01, max = 90.0))]
    pub min_angle_deg: f64,
    /// A camera whose pixel is further than this from the point's projection is left out [px].
    #[schemars(range(min = 0.01, max = 10000.0))]
    pub outlier_px: f64,
    /// Error of a camera's model, one axis, standard deviation, added to each feature's own covariance [px].
    #[schemars(range(min = 0.001, max = 100.0))]
    pub camera_error_px: f64,
    /// A target of the last set within this distance is the same one [mm].
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub step_mm: f64,
    /// Targets lie within this distance of the scale's working volume, where the rig states one [mm].
    #[schemars(range(min = 0.0, max = 1000000.0))]
    pub volume_margin_mm: f64,
}

impl Default for TriangulatorSettings {
    fn default() -> Self {
        Self {
            tolerance_mm: 15.0,
            min_cameras: 3,
            min_angle_deg: 3.0,
            outlier_px: 3.0,
            camera_error_px: 0.3,
            step_mm: 100.0,
            volume_margin_mm: 250.0,
        }
    }
}

/// The targets of one time from the frames of that time.
#[derive(Debug)]
pub struct Triangulator {
    settings: TriangulatorSettings,
    cameras: Vec<Camera>,
    volume: Option<[[f64; 3]; 2]>,
    consensus: Consensus,
    observations: Vec<RayObservation>,
    meetings: Vec<Meeting>,
    /// Identities and places of the last set.
    last: Vec<(TargetId, Point3<f64>)>,
    last_time: Option<Time>,
    next_id: u32,
    /// Cameras left out of a target whose lines had met.
    pub outliers: u64,
}

impl Triangulator {
    /// Without targets; arguments as for [`Tracker::new`](crate::tracker::Tracker::new).
    pub fn new(settings: TriangulatorSettings, cameras: Vec<Camera>, volume: Option<[[f64; 3]; 2]>) -> Self {
        Self {
            settings,
            cameras,
            volume,
            consensus: Consensus::default(),
            observations: Vec::new(),
            meetings: Vec::new(),
            last: Vec::new(),
            last_time: None,
            next_id: 0,
            outliers: 0,
        }
    }

    /// Takes in one frame of the present set.
    pub fn add(&mut self, time: Time, features: &Features) {
        let Some(camera) = self.cameras.get(usize::from(features.camera.0)) else { return };
        for (feature, &Feature { centre: pixel, covariance, .. }) in features.list.iter().enumerate() {
            let sound = covariance[(0, 0)] >= 0.0 && covariance.determinant() >= 0.0 && covariance.sum().is_finite();
            if let Some(ray) = camera.ray(&pixel).filter(|_| sound) {
                self.observations.push(RayObservation {
                    camera: features.camera,
                    time,
                    ray,
                    pixel,
                    covariance,
                    feature,
                });
            }
        }
    }

    /// Fills `targets` with those of the set as of `time`, and begins the next set.
    pub fn solve(&mut self, time: Time, targets: &mut Targets) {
        targets.time = time;
        targets.list.clear();
        self.observations.sort_by_key(|it| (it.camera, it.feature));
        let options = ConsensusOptions {
            tolerance: self.settings.tolerance_mm * 1e-3,
            min_cameras: self.settings.min_cameras as usize,
            min_sine: self.settings.min_angle_deg.to_radians().sin(),
        };
        let (volume, margin) = (&self.volume, self.settings.volume_margin_mm * 1e-3);
        let inside = |point: &Point3<f64>| match volume {
            None => true,
            Some([a, b]) => (0..3).all(|axis| {
                let (low, high) = (a[axis].min(b[axis]) - margin, a[axis].max(b[axis]) + margin);
                (low..=high).contains(&point[axis])
            }),
        };
        let mut meetings = std::mem::take(&mut self.meetings);
        self.consensus.find(&self.observations, None, &options, |point, _| inside(point), &mut meetings);
        for meeting in &meetings {
            if let Some(target) = self.refined(meeting) {
                targets.list.push(target);
            }
        }
        self.meetings = meetings;
        self.identify(time, &mut targets.list);
        self.observations.clear();
    }

    /// The maximum-likelihood point of a meeting, without the cameras that do not fit; `None` when too few are left.
    fn refined(&mut self, meeting: &Meeting) -> Option<Target> {
        let mut members = meeting.members.clone();
        let variance = Matrix2::identity() * self.settings.camera_error_px.powi(2);
        loop {
            let of = |&member: &usize| &self.cameras[usize::from(self.observations[member].camera.0)];
            let cameras: SmallVec<[&Camera; 20]> = members.iter().map(of).collect();
            let pixels: SmallVec<[Point2<f64>; 20]> = members.iter().map(|&it| self.observations[it].pixel).collect();
            let noise: SmallVec<[Matrix2<f64>; 20]> =
                members.iter().map(|&it| self.observations[it].covariance + variance).collect();
            let found = refine(&cameras, &pixels, PixelNoise::Covariances(&noise), meeting.position).ok()?;
            let residual = |place: usize| {
                cameras[place].project(&found.position).map_or(f64::INFINITY, |seen| (seen - pixels[place]).norm())
            };
            let worst = (0..members.len()).max_by(|&a, &b| residual(a).total_cmp(&residual(b)))?;
            if residual(worst) <= self.settings.outlier_px {
                let seen_by = members.iter().map(|&it| self.observations[it].camera).collect();
                return Some(target(&found, seen_by));
            }
            members.remove(worst);
            self.outliers += 1;
            if members.len() < self.settings.min_cameras as usize {
                return None;
            }
        }
    }

    /// Gives each target the identity of the nearest one of the last set, or a new one; sorts by identity.
    fn identify(&mut self, time: Time, list: &mut [Target]) {
        let mut pairs: SmallVec<[(f64, usize, usize); 32]> = SmallVec::new();
        for (now, target) in list.iter().enumerate() {
            for (before, (_, place)) in self.last.iter().enumerate() {
                let step = (target.position - place).norm();
                if step <= self.settings.step_mm * 1e-3 {
                    pairs.push((step, now, before));
                }
            }
        }
        pairs.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        let dt_s = self.last_time.map_or(0.0, |before| (time - before).as_s());
        let mut named: SmallVec<[bool; 32]> = SmallVec::from_elem(false, list.len());
        let mut taken: SmallVec<[bool; 32]> = SmallVec::from_elem(false, self.last.len());
        for (_, now, before) in pairs {
            if !named[now] && !taken[before] {
                (named[now], taken[before]) = (true, true);
                let (id, place) = self.last[before];
                list[now].id = id;
                if dt_s > 0.0 {
                    list[now].velocity = (list[now].position - place) / dt_s;
                }
            }
        }
        for target in list.iter_mut().zip(&named).filter(|(_, named)| !**named).map(|(target, _)| target) {
            target.id = TargetId(self.next_id);
            self.next_id += 1;
        }
        list.sort_unstable_by_key(|it| it.id);
        self.last.clear();
        self.last.extend(list.iter().map(|it| (it.id, it.position)));
        self.last_time = Some(time);
    }
}

/// Variance of an unknown velocity [m²/s²].
const UNKNOWN_VELOCITY: f64 = 1e6;

fn target(found: &Triangulation, cameras: CameraSet) -> Target {
    let mut covariance = Matrix6::zeros();
    covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&found.covariance);
    covariance.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(UNKNOWN_VELOCITY);
    Target {
        id: TargetId::default(),
        position: found.position,
        velocity: Vector3::zeros(),
        covariance,
        cameras,
        provenance: Provenance::Measured,
    }
}

/// Targets of each set of synchronised frames, without a motion model.
///
/// Frames whose times lie within 4 ms make a set, with the latest time among them. The velocity is the step
/// from the last set over its time, with a covariance of an unknown velocity.
pub struct TriangulatorNode {
    triangulator: Triangulator,
    pool: Pool<Targets>,
    sets: u64,
    targets: u64,
}

impl Node for TriangulatorNode {
    const TYPE: &'static str = "led.triangulator";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str =
        "Triangulates lights from synchronised cameras without a motion model, for comparison";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TriangulatorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TriangulatorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let cameras = &setup.calibration.cameras;
        if cameras.len() < 2 {
            let n = cameras.len();
            return Err(ConfigError::node(format_args!("found {n} cameras in the calibration, expected at least 2")));
        }
        let models = cameras.iter().map(|it| it.camera.clone()).collect();
        let triangulator = Triangulator::new(settings, models, setup.volume_m);
        Ok(Self { triangulator, pool: Pool::default(), sets: 0, targets: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut latest: Option<Time> = None;
        for features in io.take_set(&FEATURES) {
            self.triangulator.add(features.time(), &features.value);
            latest = latest.max(Some(features.time()));
        }
        let Some(time) = latest else { return Ok(()) };
        let mut targets = self.pool.take(Targets::default);
        self.triangulator.solve(time, &mut targets);
        self.sets += 1;
        self.targets += targets.list.len() as u64;
        io.emit_at(&TARGETS, time, self.pool.share(targets));
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("triangulator.sets", self.sets as f64);
        report.figure("triangulator.targets", self.targets as f64);
        report.figure("triangulator.identities", f64::from(self.triangulator.next_id));
        report.figure("triangulator.outliers_rejected", self.triangulator.outliers as f64);
        Ok(())
    }
}

impl TriangulatorSettings {
    /// Checks the range of each setting.
    ///
    /// # Errors
    /// The first setting out of its range, what was found, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        let check = ConfigError::unless_in::<f64>;
        check("tolerance_mm", self.tolerance_mm, 0.001..=1e6)?;
        ConfigError::unless_in("min_cameras", self.min_cameras, 2..=1000)?;
        check("min_angle_deg", self.min_angle_deg, 0.01..=90.0)?;
        check("outlier_px", self.outlier_px, 0.01..=1e4)?;
        check("camera_error_px", self.camera_error_px, 0.001..=100.0)?;
        check("step_mm", self.step_mm, 0.0..=1e6)?;
        check("volume_margin_mm", self.volume_margin_mm, 0.0..=1e6)
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::scene::point_cloud;
    use foveate_testkit::{camera_ring, check_node};

    use super::*;

    fn feature(centre: Point2<f64>) -> Feature {
        Feature { centre, covariance: Matrix2::identity() * 0.01, area: 4, peak: 200, label: None }
    }

    /// What all cameras of a ring of 6 see of `lights`.
    fn observations(lights: &[Point3<f64>]) -> Vec<Features> {
        let of = |(k, camera): (usize, &Camera)| Features {
            camera: CameraId(k as u16),
            list: lights.iter().map(|it| feature(camera.sees(it).unwrap())).collect(),
        };
        camera_ring(6).iter().enumerate().map(of).collect()
    }

    fn triangulator() -> Triangulator {
        Triangulator::new(TriangulatorSettings::default(), camera_ring(6), None)
    }

    fn solve(triangulator: &mut Triangulator, ms: f64, observations: &[Features]) -> Vec<Target> {
        let time = Time::ZERO + Interval::from_ms(ms);
        let mut targets = Targets::default();
        observations.iter().for_each(|it| triangulator.add(time, it));
        triangulator.solve(time, &mut targets);
        targets.list
    }

    #[test]
    fn node_keeps_its_promises() {
        check_node::<TriangulatorNode>("");
        check_node::<TriangulatorNode>("min_cameras = 2");
    }

    #[test]
    fn all_lights_are_found_and_keep_their_identities_from_set_to_set() {
        let mut triangulator = triangulator();
        let lights = point_cloud(8, 5);
        let first = solve(&mut triangulator, 0.0, &observations(&lights));
        assert_eq!(first.len(), 8);
        let moved: Vec<_> = lights.iter().map(|it| it + Vector3::new(0.02, 0.0, 0.0)).collect();
        let second = solve(&mut triangulator, 20.0, &observations(&moved));
        assert_eq!(second.len(), 8);
        for (a, b) in first.iter().zip(&second) {
            assert_eq!(a.id, b.id);
            assert!((b.position - a.position - Vector3::x() * 0.02).norm() < 1e-6);
            assert!((b.velocity - Vector3::x()).norm() < 1e-4);
            assert_eq!((b.provenance, b.cameras.len()), (Provenance::Measured, 6));
        }
    }

    #[test]
    fn a_camera_that_does_not_fit_is_left_out() {
        let mut triangulator = triangulator();
        let light = Point3::new(0.1, 0.2, 1.0);
        let mut observations = observations(&[light]);
        observations[2].list[0].centre.x += 1.7; // 8 mm: inside the tolerance of the meeting
        let settings = TriangulatorSettings { outlier_px: 1.0, ..TriangulatorSettings::default() };
        triangulator.settings = settings;
        let found = solve(&mut triangulator, 0.0, &observations);
        assert_eq!((found.len(), triangulator.outliers), (1, 1));
        assert!(!found[0].cameras.contains(CameraId(2)));
        assert!((found[0].position - light).norm() < 1e-6);
    }

    #[test]
    fn nothing_seen_broken_features_and_strangers_give_no_target() {
        let mut triangulator = triangulator();
        assert!(solve(&mut triangulator, 0.0, &[]).is_empty());
        let mut observations = observations(&[Point3::new(0.1, 0.2, 1.0)]);
        observations.iter_mut().for_each(|it| it.list[0].centre.x = f64::NAN);
        observations[0].camera = CameraId(99);
        assert!(solve(&mut triangulator, 1.0, &observations).is_empty());
    }
}
