//! A calibrated head as sections of a calibration.

use foveate_geometry::pan_tilt::{AxisUnits, HeadCalibration};
use foveate_scene::{Calibration, CameraUncertainty, Head};

/// Replaces the head of `camera` and its pose at rest in `calibration`; limits and zoom stay. `angles_in` says how the device's numbers relate to
/// the angles of the observations.
///
/// `None` when there is no such camera.
pub fn calibrated_head(
    calibration: &mut Calibration,
    camera: &str,
    found: &HeadCalibration,
    angles_in: [AxisUnits; 2],
) -> Option<()> {
    let index = calibration.index_of(camera)?;
    let at_rest = &mut calibration.cameras[index].camera;
    (at_rest.camera_from_world, at_rest.intrinsics) =
        (found.head.at_rest.camera_from_world, found.head.at_rest.intrinsics);
    let pose = found.covariance.pose();
    let known = calibration.uncertainties.entry(camera.to_owned()).or_default();
    *known = CameraUncertainty { pose_covariance: Some((pose + pose.transpose()) / 2.0), ..*known };
    if found.focal_sigma > 0.0 {
        known.focal_sigma_px = Some(found.head.at_rest.intrinsics.focal.map(|it| it * found.focal_sigma));
    }
    let older = calibration.heads.0.get(camera);
    // An angle as reported is (units − at rest) · rad per unit; that times the angle of an angle is the angle of the axis.
    let units = [0, 1].map(|axis| AxisUnits {
        rad_per_unit: angles_in[axis].rad_per_unit * found.units[axis].rad_per_unit,
        at_rest: angles_in[axis].units(found.units[axis].at_rest),
    });
    let covariance = &found.covariance.whole;
    let head = Head {
        pan: found.head.pan,
        tilt: found.head.tilt,
        stacking: found.head.stacking,
        limits: older.map_or(found.head.limits, |it| it.limits),
        units,
        zoom: older.and_then(|it| it.zoom.clone()),
        covariance: Some(foveate_geometry::pan_tilt::HeadCovariance {
            whole: (covariance + covariance.transpose()) / 2.0,
        }),
    };
    calibration.heads.0.insert(camera.to_owned(), head);
    Some(())
}
