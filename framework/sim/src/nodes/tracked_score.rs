//! How well points of a surface are measured and tracked: against where each point of skin or cloth truly is.

use std::collections::BTreeMap;
use std::sync::Arc;

use foveate_estimation::statistics::percentile;
use foveate_messages::TrackedSurface;
use foveate_node::{ConfigError, Figures, Io, Node, NodeError, Ports, Report, Role, Setup, figures, ports};
use foveate_scene::calibration::Calibration;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::studio::SurfacePoint;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    TRACKED: In<TrackedSurface> = each("tracked");
}

figures! {
    "surface_mm.{median,p95}": mm, low, "Distance of points from the true surface, over all points of all moments; points farther than reach_mm from any surface count as that far" => "points off the true surface";
    "drift_mm.{median,p95}": mm, low, "Distance of a point from where the place of the surface that it was first measured at truly is now, over all samples but the first of trajectories" => "points off where their first place has gone";
    "wrong_trajectories": share, low, "Trajectories of two samples or more of which some sample is farther than wrong_mm from there, over all of these" => "wrong trajectories";
    "wrong_points": share, low, "Points farther than wrong_mm from the true surface, over all points of all moments";
    "coverage": share, high, "Of the vertices of the true surface that two cameras or more see within facing_deg of straight on, those within near_mm of a point, over all moments; that something else may stand before them is left out" => "part covered of what could be seen";
    "normal_deg.median": deg, low, "Angle between a point's normal and that of the true surface there; points without one are left out";
    "speed_px.{median,p95}": px, neither, "How far the true places of tracked points move from moment to moment in the pictures of the first camera that sees them";
    "trajectories.scored": count, neither, "Trajectories of two samples or more";
}

/// Settings of [`TrackedScore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TrackedScoreSettings {
    /// A sample farther than this from the truth is wrong [mm]
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub wrong_mm: f64,
    /// How far around a point the true surface is searched [mm]
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub reach_mm: f64,
    /// A vertex of the true surface is covered by a point at most this far away [mm]
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub near_mm: f64,
    /// A camera sees a vertex well from within this angle of its normal [°]
    #[schemars(range(min = 1.0, max = 90.0))]
    pub facing_deg: f64,
}

impl Default for TrackedScoreSettings {
    fn default() -> Self {
        Self { wrong_mm: 3.0, reach_mm: 20.0, near_mm: 5.0, facing_deg: 60.0 }
    }
}

/// One trajectory so far.
struct Followed {
    /// The place of the surface that it was first measured at; `None` where there was none near.
    place: Option<SurfacePoint>,
    n_samples: u32,
    is_wrong: bool,
    /// Where that place was last [m].
    last: Option<Point3<f64>>,
}

/// Compares tracked points with the truth.
pub struct TrackedScore {
    settings: TrackedScoreSettings,
    calibration: Arc<Calibration>,
    followed: BTreeMap<u32, Followed>,
    distances: Vec<f64>,
    drifts: Vec<f64>,
    angles: Vec<f64>,
    speeds: Vec<f64>,
    n_wrong: usize,
    visible: usize,
    covered: usize,
}

impl Node for TrackedScore {
    const TYPE: &'static str = "sim.tracked_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares tracked surface points with the true points of skin and cloth";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TrackedScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TrackedScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("wrong_mm", settings.wrong_mm, 1e-3..=1e3)?;
        ConfigError::unless_in("reach_mm", settings.reach_mm, 0.1..=1e3)?;
        ConfigError::unless_in("near_mm", settings.near_mm, 0.1..=1e3)?;
        ConfigError::unless_in("facing_deg", settings.facing_deg, 1.0..=90.0)?;
        Ok(Self {
            settings,
            calibration: Arc::clone(&setup.calibration),
            followed: BTreeMap::new(),
            distances: Vec::new(),
            drifts: Vec::new(),
            angles: Vec::new(),
            speeds: Vec::new(),
            n_wrong: 0,
            visible: 0,
            covered: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(tracked) = io.take(&TRACKED) {
            if let Some(world) = io.latest(&WORLD).map(|it| it.value.clone()) {
                self.compare(&world, &tracked.value);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let at = |list: &[f64], part: f64| percentile(list, part).unwrap_or(f64::NAN);
        report.figure("surface_mm.median", 1e3 * at(&self.distances, 50.0));
        report.figure("surface_mm.p95", 1e3 * at(&self.distances, 95.0));
        report.figure("drift_mm.median", 1e3 * at(&self.drifts, 50.0));
        report.figure("drift_mm.p95", 1e3 * at(&self.drifts, 95.0));
        report.figure("normal_deg.median", at(&self.angles, 50.0).to_degrees());
        report.figure("speed_px.median", at(&self.speeds, 50.0));
        report.figure("speed_px.p95", at(&self.speeds, 95.0));
        let scored = || self.followed.values().filter(|it| it.n_samples > 1);
        let n = scored().count() as f64;
        report.figure("trajectories.scored", n);
        report.figure("wrong_trajectories", scored().filter(|it| it.is_wrong).count() as f64 / n);
        report.figure("wrong_points", self.n_wrong as f64 / self.distances.len() as f64);
        report.figure("coverage", self.covered as f64 / self.visible as f64);
        Ok(())
    }
}

impl TrackedScore {
    fn compare(&mut self, world: &World, tracked: &TrackedSurface) {
        let surfaces = world.surfaces(tracked.time);
        let (wrong_m, reach_m) = (self.settings.wrong_mm * 1e-3, self.settings.reach_mm * 1e-3);
        let finder = surfaces.finder(reach_m);
        for point in &tracked.list {
            let nearest = finder.nearest(&point.position);
            let distance = nearest.as_ref().map_or(reach_m, |it| it.1.abs().min(reach_m));
            self.distances.push(distance);
            self.n_wrong += usize::from(distance > wrong_m);
            if let Some((place, _)) = &nearest
                && point.normal.norm() > 0.5
                && let Some(truth) = surfaces.normal(place)
            {
                self.angles.push(point.normal.angle(&truth));
            }
            let followed = self.followed.entry(point.id).or_insert_with(|| Followed {
                place: nearest.map(|it| it.0),
                n_samples: 0,
                is_wrong: distance > wrong_m,
                last: None,
            });
            followed.n_samples += 1;
            let now = followed.place.and_then(|it| surfaces.place(&it));
            if followed.n_samples > 1 {
                let drift = now.map_or(reach_m, |it| (it - point.position).norm());
                self.drifts.push(drift);
                followed.is_wrong |= drift > wrong_m;
                let seen = |it: &Point3<f64>| self.calibration.cameras.iter().find_map(|of| of.camera.sees(it));
                if let Some((a, b)) = followed.last.as_ref().and_then(seen).zip(now.as_ref().and_then(seen)) {
                    self.speeds.push((a - b).norm());
                }
            }
            followed.last = now;
        }
        self.cover(&surfaces, tracked);
    }

    fn cover(&mut self, surfaces: &crate::studio::TrueSurfaces, tracked: &TrackedSurface) {
        let near_m = self.settings.near_mm * 1e-3;
        let cell = |it: &Point3<f64>| [0, 1, 2].map(|axis| (it[axis] / near_m).floor() as i64);
        let mut cells: BTreeMap<[i64; 3], Vec<Point3<f64>>> = BTreeMap::new();
        for point in &tracked.list {
            cells.entry(cell(&point.position)).or_default().push(point.position);
        }
        let is_near = |vertex: &Point3<f64>| {
            let [x, y, z] = cell(vertex);
            (0..27).any(|it| {
                let there = [x + it % 3 - 1, y + it / 3 % 3 - 1, z + it / 9 - 1];
                cells.get(&there).is_some_and(|list| list.iter().any(|it| (it - vertex).norm() <= near_m))
            })
        };
        let least = self.settings.facing_deg.to_radians().cos();
        for thing in surfaces.things() {
            let Some((vertices, triangles)) = surfaces.mesh(thing) else { continue };
            // Normals by the triangles around each vertex, from outside.
            let mut normals = vec![Vector3::zeros(); vertices.len()];
            for [a, b, c] in triangles {
                let [p, q, r] = [a, b, c].map(|it| vertices[it as usize]);
                let normal = (q - p).cross(&(r - p));
                for corner in [a, b, c] {
                    normals[corner as usize] += normal;
                }
            }
            for (vertex, normal) in vertices.iter().zip(&normals) {
                let Some(normal) = normal.try_normalize(0.0) else { continue };
                let sees_well = |it: &&foveate_scene::NamedCamera| {
                    let towards = (it.camera.centre() - vertex).normalize();
                    normal.dot(&towards) > least && it.camera.sees(vertex).is_some()
                };
                if self.calibration.cameras.iter().filter(sees_well).count() >= 2 {
                    self.visible += 1;
                    self.covered += usize::from(is_near(vertex));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<TrackedScore>("wrong_mm = 2.0");
    }
}
