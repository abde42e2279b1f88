//! A solved camera network as a calibration: cameras by name, with uncertainty and provenance.

use foveate_estimation::statistics::median;
use foveate_geometry::CameraStatus;
use foveate_scene::{
    Calibration, CalibrationError, CameraClock, CameraUncertainty, LengthUnit, NamedCamera, Provenance,
};

use crate::solved::{ObservationRole, Solved, SolvedCamera};

/// Provenance of a calibration.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Origin {
    /// Program and method.
    pub method: String,
    /// When, in whatever form the caller gives.
    pub date: Option<String>,
    /// The files it was made of.
    pub sources: Vec<String>,
    /// A line for people.
    pub note: String,
}

impl Solved {
    /// The cameras that were calibrated; in metres if the scale is fixed.
    ///
    /// # Errors
    /// When no camera was calibrated, or two have one name.
    pub fn to_calibration(&self, origin: Origin) -> Result<Calibration, CalibrationError> {
        let known: Vec<&SolvedCamera> =
            self.cameras.iter().filter(|it| it.status == CameraStatus::Calibrated).collect();
        let cameras = known.iter().map(|it| NamedCamera { name: it.name.clone(), camera: it.camera.clone() }).collect();
        let unit = if self.fixed.scale.is_some() { LengthUnit::Metre } else { LengthUnit::Unknown };
        let mut calibration = Calibration::new(cameras, unit, origin.note)?;
        let used = self.observations.iter().filter(|it| it.role == ObservationRole::Used);
        let errors: Vec<f64> = used.filter_map(|it| Some(it.residual?.norm())).collect();
        calibration.provenance = Some(Provenance {
            method: origin.method,
            date: origin.date,
            sources: origin.sources,
            residual_median_px: median(&errors),
            scale: self.fixed.scale.clone(),
            gravity: self.fixed.gravity.clone(),
            origin: self.fixed.origin.clone(),
        });
        for camera in known {
            if let Some(uncertainty) = camera.uncertainty() {
                calibration.uncertainties.insert(camera.name.clone(), uncertainty);
            }
            if let Some(fit) = camera.clock {
                let clock = CameraClock {
                    // The file has camera = offset + rate · session.
                    offset_s: -fit.offset_s / (1.0 + fit.drift),
                    rate: 1.0 / (1.0 + fit.drift),
                    offset_sigma_s: Some(fit.sigma_s).filter(|it| it.is_finite() && *it > 0.0),
                    frame_rate_hz: None,
                };
                calibration.clocks.0.insert(camera.name.clone(), clock);
            }
        }
        Ok(calibration)
    }
}

impl SolvedCamera {
    /// How well it is known, in the terms of a calibration file.
    fn uncertainty(&self) -> Option<CameraUncertainty> {
        let covariance = self.covariance.as_ref()?;
        let (optics, freed) = (&covariance.optics, &self.freed);
        let focal = self.camera.intrinsics.focal;
        let mut distortion = foveate_geometry::Distortion::default();
        [distortion.k1, distortion.k2, distortion.k3] = optics.radial;
        [distortion.p1, distortion.p2] = optics.decentering;
        let bent = freed.k1 || freed.k2 || freed.k3 || freed.decentering;
        Some(CameraUncertainty {
            focal_sigma_px: freed
                .focal
                .then(|| [optics.focal * focal[0], optics.focal.hypot(optics.aspect) * focal[1]]),
            principal_point_sigma_px: freed.principal.then_some(optics.principal),
            distortion_sigma: bent.then_some(distortion),
            pose_covariance: Some((covariance.pose + covariance.pose.transpose()) / 2.0),
        })
    }
}
