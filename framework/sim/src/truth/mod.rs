//! What the cameras and heads of a simulated world are truly like: not as a rig's calibration says, but drawn around how they were planned to be.
//!
//! A plan is a file with cameras and heads, in the form of a calibration; only the simulation reads it. Around it a world draws where each camera was really mounted,
//! what its lens is really like (richer than what calibrations fit: see [`Lens`]), where the axes of its head really are. A rig knows of all this what it
//! has estimated itself, from what the simulated cameras saw.

mod camera;
mod lens;

use std::collections::BTreeMap;

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_geometry::pan_tilt::{Axis, PanTiltHead};
use foveate_node::{ConfigError, Setup};
use foveate_scene::{Calibration, LengthUnit};
use nalgebra::{Isometry3, Translation3, Unit, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use camera::TrueCamera;
pub use lens::Lens;

/// Errors are drawn normally and no larger than so many standard deviations: a larger error is drawn again.
const MOST_SIGMAS: f64 = 2.5;
/// Terms of a lens go on for so much more than the way from the middle of the picture to its corner.
const BEYOND: f64 = 1.1;
/// The higher terms of a lens are stated by what they do at this distance from its middle, half of the sensor's width [px].
const SIDES: f64 = 0.5;

/// How the real cameras and heads differ from how they were planned. All sizes are standard deviations, drawn for each camera by its name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TruthSettings {
    /// The file with the cameras and heads as planned, in the form of a calibration. `${NAME}` is an environment variable; a relative path starts at the
    /// rig's folder [–].
    pub plan: String,
    /// Another number, another world: of the rig's own seed nothing here depends on [–].
    pub seed: u64,
    /// Position of a camera, along each axis [mm].
    #[schemars(range(min = 0.0, max = 500.0))]
    pub position_mm: f64,
    /// Orientation of a camera, about each of its axes [°].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub direction_deg: f64,
    /// Focal length, as a part of it [–].
    #[schemars(range(min = 0.0, max = 0.2))]
    pub focal: f64,
    /// Principal point, along rows and columns [px].
    #[schemars(range(min = 0.0, max = 50.0))]
    pub principal_px: f64,
    /// Radial distortion of r², absolute [–].
    #[schemars(range(min = 0.0, max = 0.2))]
    pub radial: f64,
    /// Effect of radial terms that calibrations do not fit, at the left and right edge of the picture [px].
    #[schemars(range(min = 0.0, max = 5.0))]
    pub high_radial_px: f64,
    /// Effect of a thin prism there, which calibrations do not fit either [px].
    #[schemars(range(min = 0.0, max = 5.0))]
    pub prism_px: f64,
    /// Tilt of the sensor behind the lens, about each of its axes [°].
    #[schemars(range(min = 0.0, max = 5.0))]
    pub sensor_tilt_deg: f64,
    /// Inclination of a head's axes [°].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub axes_deg: f64,
    /// Position of a head's axes, along each coordinate [mm].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub axes_mm: f64,
    /// Step size of a head's counter, as a part of it [–].
    #[schemars(range(min = 0.0, max = 0.1))]
    pub unit: f64,
}

impl Default for TruthSettings {
    fn default() -> Self {
        Self {
            plan: String::new(),
            seed: 1,
            position_mm: 20.0,
            direction_deg: 1.0,
            focal: 0.01,
            principal_px: 4.0,
            radial: 0.01,
            high_radial_px: 0.1,
            prism_px: 0.1,
            sensor_tilt_deg: 0.2,
            axes_deg: 1.0,
            axes_mm: 5.0,
            unit: 0.002,
        }
    }
}

impl TruthSettings {
    fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("truth.position_mm", self.position_mm, 0.0..=500.0)?;
        ConfigError::unless_in("truth.direction_deg", self.direction_deg, 0.0..=20.0)?;
        ConfigError::unless_in("truth.focal", self.focal, 0.0..=0.2)?;
        ConfigError::unless_in("truth.principal_px", self.principal_px, 0.0..=50.0)?;
        ConfigError::unless_in("truth.radial", self.radial, 0.0..=0.2)?;
        ConfigError::unless_in("truth.high_radial_px", self.high_radial_px, 0.0..=5.0)?;
        ConfigError::unless_in("truth.prism_px", self.prism_px, 0.0..=5.0)?;
        ConfigError::unless_in("truth.sensor_tilt_deg", self.sensor_tilt_deg, 0.0..=5.0)?;
        ConfigError::unless_in("truth.axes_deg", self.axes_deg, 0.0..=10.0)?;
        ConfigError::unless_in("truth.axes_mm", self.axes_mm, 0.0..=100.0)?;
        ConfigError::unless_in("truth.unit", self.unit, 0.0..=0.1)
    }
}

/// The true cameras of a world, by name.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Truth {
    cameras: BTreeMap<String, TrueCamera>,
    /// As far as a calibration can say it.
    stated: String,
}

impl Truth {
    /// Draws them around the plan that `settings` name.
    ///
    /// # Errors
    /// Settings out of their ranges; a plan that cannot be read, or that lacks a camera of the rig's calibration.
    pub fn draw(settings: &TruthSettings, setup: &Setup) -> Result<Truth, ConfigError> {
        settings.check()?;
        if settings.plan.is_empty() {
            return Err(ConfigError::at("truth.plan", "found nothing, expected the file with the cameras as planned"));
        }
        let path = setup.path("truth.plan", &settings.plan)?;
        let plan = Calibration::load(&path).map_err(|error| ConfigError::at("truth.plan", error.to_string()))?;
        if plan.length_unit != LengthUnit::Metre {
            let message = format!("{}: found an unknown unit of length, expected metres", path.display());
            return Err(ConfigError::at("truth.plan", message));
        }
        for camera in &setup.calibration.cameras {
            if plan.camera(&camera.name).is_none() {
                let message = format!(
                    "{}: found no camera `{}`, which the rig's calibration has, expected all of its cameras",
                    path.display(),
                    camera.name
                );
                return Err(ConfigError::at("truth.plan", message));
            }
        }
        Ok(Truth::around(&plan, settings))
    }

    fn around(plan: &Calibration, settings: &TruthSettings) -> Truth {
        let random = Random::new(settings.seed).fork("truth");
        let cameras = plan.cameras.iter().map(|it| {
            let mut errors = Errors(random.fork(&it.name));
            let camera = drawn(&it.camera, settings, &mut errors);
            let lens = lens(&it.camera, settings, &mut errors);
            let head = plan.head(&it.name).map(|head| {
                let axes = axes(&head.model, settings, &mut errors);
                (axes, [0, 1].map(|_| 1.0 + errors.of(settings.unit)))
            });
            (it.name.clone(), TrueCamera::new(camera, lens, head))
        });
        let cameras: BTreeMap<String, TrueCamera> = cameras.collect();
        let mut stated = plan.clone();
        stated.origin = format!("the truth of world {}, less what its lenses do beyond this model", settings.seed);
        for named in &mut stated.cameras {
            let Some(camera) = cameras.get(&named.name) else { continue };
            named.camera = camera.plain().clone();
            if let (Some(head), Some((axes, steps))) = (stated.heads.0.get_mut(&named.name), camera.head()) {
                (head.pan, head.tilt) = (axes.pan, axes.tilt);
                head.units.iter_mut().zip(steps).for_each(|(unit, step)| unit.rad_per_unit *= step);
            }
        }
        Truth { cameras, stated: stated.to_toml() }
    }

    /// The truth in the form of a calibration, for people to compare with.
    pub fn stated(&self) -> &str {
        &self.stated
    }

    /// The camera of this name.
    pub fn camera(&self, name: &str) -> Option<&TrueCamera> {
        self.cameras.get(name)
    }
}

/// Errors of one camera, in a fixed order.
struct Errors(Random);

impl Errors {
    /// With this standard deviation.
    fn of(&mut self, sigma: f64) -> f64 {
        loop {
            let normal = self.0.normal();
            if normal.abs() <= MOST_SIGMAS {
                return normal * sigma;
            }
        }
    }

    fn vector(&mut self, sigma: f64) -> Vector3<f64> {
        Vector3::new(self.of(sigma), self.of(sigma), self.of(sigma))
    }
}

fn drawn(planned: &Camera, settings: &TruthSettings, errors: &mut Errors) -> Camera {
    let mut camera = planned.clone();
    let moved = errors.vector(settings.position_mm * 1e-3);
    let turned = UnitQuaternion::from_scaled_axis(errors.vector(settings.direction_deg.to_radians()));
    let world_from_camera = Translation3::from(moved) * planned.camera_from_world.inverse();
    camera.camera_from_world = Isometry3::from_parts(Translation3::identity(), turned) * world_from_camera.inverse();
    let focal = 1.0 + errors.of(settings.focal);
    camera.intrinsics.focal = planned.intrinsics.focal.map(|it| it * focal);
    camera.intrinsics.principal = planned.intrinsics.principal.map(|it| it + errors.of(settings.principal_px));
    camera.distortion.k1 += errors.of(settings.radial);
    camera
}

/// Terms by what they do at the sides of the picture.
fn lens(planned: &Camera, settings: &TruthSettings, errors: &mut Errors) -> Lens {
    let focal = planned.intrinsics.focal[0];
    let side = SIDES * f64::from(planned.image_size[0]) / focal;
    let (square, pixel) = (side * side, 1.0 / focal);
    let prism_px = settings.prism_px * pixel;
    Lens {
        k4: errors.of(settings.high_radial_px * pixel) / (side * square.powi(4)),
        prism: [square, square, square * square, square * square].map(|it| errors.of(prism_px) / it),
        tilt: [errors.of(settings.sensor_tilt_deg.to_radians()), errors.of(settings.sensor_tilt_deg.to_radians())],
        widest: BEYOND * side.hypot(SIDES * f64::from(planned.image_size[1]) / planned.intrinsics.focal[1]),
    }
}

fn axes(planned: &PanTiltHead, settings: &TruthSettings, errors: &mut Errors) -> PanTiltHead {
    let mut off = |axis: &Axis| Axis {
        point: axis.point + errors.vector(settings.axes_mm * 1e-3),
        direction: Unit::new_normalize(
            UnitQuaternion::from_scaled_axis(errors.vector(settings.axes_deg.to_radians()))
                * axis.direction.into_inner(),
        ),
    };
    let (pan, tilt) = (off(&planned.pan), off(&planned.tilt));
    PanTiltHead { pan, tilt, ..planned.clone() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lab::lab_calibration;

    #[test]
    fn plans_that_do_not_do_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let plan = lab_calibration().to_toml();
        let refusal = |text: &str, file: &str| {
            std::fs::write(folder.path().join("plan.toml"), text).unwrap();
            let mut setup = Setup::for_tests();
            setup.rig_dir = folder.path().to_owned();
            setup.calibration = std::sync::Arc::new(lab_calibration());
            let settings = TruthSettings { plan: file.to_owned(), ..TruthSettings::default() };
            Truth::draw(&settings, &setup).err().map(|it| it.message)
        };
        assert_eq!(refusal(&plan, "plan.toml"), None);
        let says = |text: &str, file: &str, what: &str| refusal(text, file).is_some_and(|it| it.contains(what));
        assert!(says(&plan, "", "expected the file"));
        assert!(says(&plan, "other.toml", "cannot be read"));
        assert!(says(&plan.replace("camera.wide-3]", "camera.tall-3]"), "plan.toml", "found no camera `wide-3`"));
        assert!(says(&plan.replace("\"m\"", "\"unknown\""), "plan.toml", "expected metres"));
    }

    #[test]
    fn worlds_differ_by_their_seed_alone_and_as_much_as_is_said() {
        let plan = lab_calibration();
        let truth = |seed: u64| Truth::around(&plan, &TruthSettings { seed, ..TruthSettings::default() });
        assert_eq!(truth(1), truth(1));
        let (mut off_m, mut off_rad, mut n) = (0.0, 0.0, 0.0);
        for seed in 0..20 {
            for named in &plan.cameras {
                let drawn = truth(seed).camera(&named.name).unwrap().clone();
                off_m += (drawn.centre() - named.camera.centre()).norm_squared();
                let turn = drawn.camera_from_world.rotation.angle_to(&named.camera.camera_from_world.rotation);
                off_rad += turn.powi(2);
                n += 3.0;
                // Through its own lens it sees along the line that it images.
                let pixel = nalgebra::Point2::new(40.0, 30.0);
                let there = drawn.ray(&pixel).unwrap().at(3.0);
                assert!((drawn.project(&there).unwrap() - pixel).norm() < 1e-6);
            }
        }
        let (position_mm, direction_deg) = ((off_m / n).sqrt() * 1e3, (off_rad / n).sqrt().to_degrees());
        assert!((17.0..21.0).contains(&position_mm), "{position_mm}");
        assert!((0.85..1.05).contains(&direction_deg), "{direction_deg}");
        let exact = TruthSettings {
            position_mm: 0.0,
            direction_deg: 0.0,
            focal: 0.0,
            principal_px: 0.0,
            radial: 0.0,
            high_radial_px: 0.0,
            prism_px: 0.0,
            sensor_tilt_deg: 0.0,
            ..TruthSettings::default()
        };
        let exact = Truth::around(&plan, &exact);
        let point = nalgebra::Point3::new(0.3, -0.2, 1.1);
        for named in &plan.cameras {
            let (Some(here), Some(there)) =
                (named.camera.project(&point), exact.camera(&named.name).unwrap().project(&point))
            else {
                continue;
            };
            assert!((here - there).norm() < 1e-9);
        }
    }
}
