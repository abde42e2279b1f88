//! Perfect tracking as a source: points of skin and cloth where they truly are, with noise, and joints as a person clicks them.

use std::sync::Arc;

use foveate_estimation::random::Random;
use foveate_messages::{
    BODY_JOINTS, CameraId, CameraSet, Provenance, Target, TargetId, Targets, TrackedPoint, TrackedSurface,
};
use foveate_node::{
    ConfigError, Due, Figures, Io, Node, NodeError, Plan, Ports, Report, Role, Setup, Time, figures, ports,
};
use foveate_scene::calibration::Calibration;
use nalgebra::{Matrix3, Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::score::body::true_joints;
use crate::studio::SurfacePoint;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    TRACKED: Out<TrackedSurface> = "tracked";
    JOINTS: Out<Targets> = "joints";
}

figures! {
    "true_surface.points": count, neither, "Points that two cameras or more see, mean over all moments";
}

/// Settings of [`TrueSurface`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrueSurfaceSettings {
    /// Rate at which it emits points [Hz]
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub rate_hz: f64,
    /// Points on all surfaces, seen or not [–]
    #[schemars(range(min = 1, max = 100000))]
    pub points: usize,
    /// Standard deviation of each axis of a point [mm]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub noise_mm: f64,
    /// Part of the points that are wrong, each by up to a decimetre along each axis [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub wrong: f64,
    /// A camera sees a point within this angle of its normal; occlusion is ignored [°]
    #[schemars(range(min = 1.0, max = 90.0))]
    pub facing_deg: f64,
    /// How far each joint is clicked off, in a direction of its own [mm]
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub click_mm: f64,
}

impl Default for TrueSurfaceSettings {
    fn default() -> Self {
        Self { rate_hz: 25.0, points: 3000, noise_mm: 0.3, wrong: 0.01, facing_deg: 65.0, click_mm: 40.0 }
    }
}

/// Surfaces of the studio as a perfect tracker would have them.
pub struct TrueSurface {
    settings: TrueSurfaceSettings,
    calibration: Arc<Calibration>,
    random: Random,
    chosen: Vec<SurfacePoint>,
    clicks: Vec<Vector3<f64>>,
    next: u64,
    n_points: u64,
}

impl Node for TrueSurface {
    const TYPE: &'static str = "sim.true_surface";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "True positions of points on simulated skin and cloth, without pictures";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TrueSurfaceSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TrueSurfaceSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("rate_hz", settings.rate_hz, 0.1..=1000.0)?;
        ConfigError::unless_in("points", settings.points, 1..=100_000)?;
        ConfigError::unless_in("noise_mm", settings.noise_mm, 0.0..=100.0)?;
        ConfigError::unless_in("wrong", settings.wrong, 0.0..=1.0)?;
        ConfigError::unless_in("facing_deg", settings.facing_deg, 1.0..=90.0)?;
        ConfigError::unless_in("click_mm", settings.click_mm, 0.0..=1000.0)?;
        let mut random = setup.random.fork("true surface");
        let click = settings.click_mm * 1e-3;
        let clicks = BODY_JOINTS.map(|_| Vector3::from_fn(|_, _| random.normal()).normalize() * click).to_vec();
        let calibration = Arc::clone(&setup.calibration);
        Ok(Self { settings, calibration, random, chosen: Vec::new(), clicks, next: 0, n_points: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time = self.next_time();
        self.next += 1;
        let Some(world) = io.latest(&WORLD).map(|it| it.value.clone()) else {
            io.gap(&TRACKED, time, "no world has come");
            io.gap(&JOINTS, time, "no world has come");
            return Ok(());
        };
        let tracked = self.tracked(&world, time);
        self.n_points += tracked.list.len() as u64;
        let joints = self.joints(&world, time);
        io.emit_at(&TRACKED, time, tracked);
        io.emit_at(&JOINTS, time, joints);
        Ok(())
    }

    fn due(&mut self) -> Due {
        Due::At(self.next_time())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        report.figure("true_surface.points", self.n_points as f64 / self.next as f64);
        Ok(())
    }

    fn plan(settings: &TrueSurfaceSettings) -> Plan {
        Plan { rate_hz: Some(settings.rate_hz), reacts_after_s: f64::INFINITY, ..Plan::default() }
    }
}

impl TrueSurface {
    fn next_time(&self) -> Time {
        Time::from_s(self.next as f64 / self.settings.rate_hz)
    }

    fn tracked(&mut self, world: &World, time: Time) -> TrackedSurface {
        let surfaces = world.surfaces(time);
        if self.chosen.is_empty() {
            let counts: Vec<(usize, u32)> = surfaces
                .things()
                .filter_map(|it| Some((it, surfaces.mesh(it)?.1.len() as u32)))
                .filter(|it| it.1 > 0)
                .collect();
            for _ in 0..if counts.is_empty() { 0 } else { self.settings.points } {
                let (thing, n) = counts[self.random.below(counts.len() as u32) as usize];
                let (a, b) = (self.random.uniform(), self.random.uniform());
                let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
                let triangle = self.random.below(n) as usize;
                self.chosen.push(SurfacePoint { thing, triangle, weights: [a, b, 1.0 - a - b] });
            }
        }
        let least = self.settings.facing_deg.to_radians().cos();
        let noise = self.settings.noise_mm * 1e-3;
        let eyes: Vec<Point3<f64>> = (self.calibration.cameras.iter())
            .map(|it| Point3::from(it.camera.camera_from_world.inverse().translation.vector))
            .collect();
        let mut list = Vec::new();
        for (id, point) in self.chosen.iter().enumerate() {
            // Each draws its numbers, seen or not: what one does not see changes nothing of another.
            let off = Vector3::from_fn(|_, _| noise * self.random.normal());
            let wrong = Vector3::from_fn(|_, _| self.random.uniform_in(-0.1, 0.1));
            let is_wrong = self.random.uniform() < self.settings.wrong;
            let Some((place, normal)) = surfaces.place(point).zip(surfaces.normal(point)) else { continue };
            let mut cameras = CameraSet::default();
            for (number, eye) in eyes.iter().enumerate() {
                if normal.dot(&(eye - place).normalize()) > least {
                    cameras.insert(CameraId(number as u16));
                }
            }
            if cameras.len() < 2 {
                continue;
            }
            let position = place + off + if is_wrong { wrong } else { Vector3::zeros() };
            list.push(TrackedPoint {
                id: id as u32,
                position,
                velocity: Vector3::zeros(),
                acceleration: Vector3::zeros(),
                covariance: Matrix3::identity() * noise.max(1e-6).powi(2),
                normal,
                cameras,
                provenance: Provenance::Measured,
                n_samples: 1,
            });
        }
        TrackedSurface { time, list, ended: Vec::new() }
    }

    /// Joints of the first person or of the arm, by their places in [`BODY_JOINTS`].
    fn joints(&self, world: &World, time: Time) -> Targets {
        let of_arm = world.arm_joints(time).map(|arm| [3, 5, 7].into_iter().zip(arm.places).collect::<Vec<_>>());
        let of_person = || world.joints(time).first().map(|it| true_joints(&it.1).into_iter().enumerate().collect());
        let joints: Vec<(usize, Point3<f64>)> = of_arm.or_else(of_person).unwrap_or_default();
        let sigma = (self.settings.click_mm * 1e-3).max(1e-6);
        let target = |(joint, place): (usize, Point3<f64>)| Target {
            id: TargetId(joint as u32),
            position: place + self.clicks[joint],
            velocity: Vector3::zeros(),
            covariance: Matrix6::identity() * (sigma * sigma / 3.0),
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        };
        Targets { time, list: joints.into_iter().map(target).collect() }
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<TrueSurface>("");
        check_node::<TrueSurface>("points = 100\nnoise_mm = 0");
    }
}
