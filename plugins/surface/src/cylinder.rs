//! `surface.cylinder`: fits a cylinder of unknown size to a cloud, and reports the deviations.

use foveate::geometry::surface::{Cylinder, SurfacePoint, roughness};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    CLOUD: In<PointCloud> = each("cloud");
}

figures! {
    "cylinder.radius_mm": mm, neither, "Radius of the cylinder that fits a cloud best, mean over the clouds" => "radius of the cylinder";
    "cylinder.radius_mm.spread": mm, low, "Largest difference of two clouds' radii";
    "cylinder.rms_mm": mm, low, "Root mean square distance of a cloud's points from its cylinder, all of them, mean over the clouds" => "points off the cylinder";
    "cylinder.points": count, high, "Points of a cloud, the least over the clouds";
    "cylinder.roughness_mm": mm, low, "Root mean square deviation of points, along their normal, from the quadric through their neighbours within `radius_mm`, for its degrees of freedom, over all clouds";
    "cylinder.clouds": count, neither, "Clouds that a cylinder was fitted to";
        "cylinder.refused": count, low, "Clouds without a cylinder: too few points, or a plane";
}

/// Settings of [`CylinderFit`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct CylinderSettings {
    /// Radius of the neighbourhood for the roughness [mm]
    #[schemars(range(min = 0.001, max = 1000.0))]
    pub radius_mm: f64,
}

impl Default for CylinderSettings {
    fn default() -> Self {
        Self { radius_mm: 3.0 }
    }
}

/// Most points of a cloud for the roughness.
const ASKED: usize = 4000;

/// Clouds in, figures out.
pub struct CylinderFit {
    settings: CylinderSettings,
    fits: Vec<(Cylinder, usize)>,
    /// Sum of squares, and of how many.
    rough: (f64, usize),
    refused: u64,
}

impl Node for CylinderFit {
    const TYPE: &'static str = "surface.cylinder";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Fits a cylinder to each point cloud, and reports deviations and roughness";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CylinderSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CylinderSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("radius_mm", settings.radius_mm, 0.001..=1000.0)?;
        Ok(Self { settings, fits: Vec::new(), rough: (0.0, 0), refused: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(cloud) = io.take(&CLOUD) else { return Ok(()) };
        let points: Vec<SurfacePoint> = cloud
            .value
            .iter()
            .map(|it| SurfacePoint {
                position: it.position.cast(),
                covariance: it.covariance.cast(),
                normal: it.normal.cast(),
            })
            .collect();
        match Cylinder::fit(&points) {
            Some(cylinder) => {
                let all = roughness(&points, self.settings.radius_mm * 1e-3, points.len().div_ceil(ASKED));
                for it in all.into_iter().flatten() {
                    self.rough = (self.rough.0 + it * it, self.rough.1 + 1);
                }
                self.fits.push((cylinder, points.len()));
            }
            None => self.refused += 1,
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let n = self.fits.len() as f64;
        let radii = || self.fits.iter().map(|it| it.0.radius);
        let spread = radii().fold(f64::NEG_INFINITY, f64::max) - radii().fold(f64::INFINITY, f64::min);
        report.figure("cylinder.clouds", n);
        report.figure("cylinder.refused", self.refused as f64);
        report.figure("cylinder.radius_mm", 1e3 * radii().sum::<f64>() / n);
        report.figure("cylinder.radius_mm.spread", if self.fits.is_empty() { f64::NAN } else { 1e3 * spread });
        report.figure("cylinder.rms_mm", 1e3 * self.fits.iter().map(|it| it.0.rms).sum::<f64>() / n);
        report.figure("cylinder.points", self.fits.iter().map(|it| it.1).min().map_or(f64::NAN, |it| it as f64));
        report.figure("cylinder.roughness_mm", 1e3 * (self.rough.0 / self.rough.1 as f64).sqrt());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix3, Point3, Vector3};

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<CylinderFit>("radius_mm = 2.0");
    }

    #[test]
    fn a_cylinder_is_measured_and_a_plane_is_refused() {
        let mut bench = NodeBench::<CylinderFit>::new(CylinderSettings::default()).unwrap();
        let mut cloud = PointCloud::default();
        let mut flat = PointCloud::default();
        for i in 0..60u32 {
            for j in 0..40u32 {
                let (angle, along) = (0.02 * f64::from(i), 0.001 * f64::from(j));
                let normal = Vector3::new(angle.cos(), angle.sin(), 0.0);
                let mut point = CloudPoint {
                    position: Point3::from(normal * 0.0574 + Vector3::z() * along).cast(),
                    covariance: Matrix3::identity() * 1e-10,
                    normal: normal.cast(),
                    confidence: 1.0,
                    pixel: [i as u16, j as u16],
                    colour: [0; 3],
                };
                cloud.push(&point);
                point.position.x = 0.0;
                point.normal = Vector3::x();
                flat.push(&point);
            }
        }
        bench.feed(&CLOUD, Time::ZERO, cloud).unwrap();
        bench.feed(&CLOUD, Time::from_s(1.0), flat).unwrap();
        let figures = bench.finish().unwrap().figures;
        assert!(
            (figures["cylinder.radius_mm"] - 57.4).abs() < 1e-3 && figures["cylinder.rms_mm"] < 1e-4,
            "{figures:?}"
        );
        assert!(figures["cylinder.roughness_mm"] < 1e-3 && figures["cylinder.refused"] == 1.0, "{figures:?}");
    }
}
