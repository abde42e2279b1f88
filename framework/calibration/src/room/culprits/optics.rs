//! A camera whose optics are not as stated, in a room that bends until all fits.
//!
//! A focal length or a shape of pixels that is wrong need not show in the residuals: poses and the optics that are free make up for it, and the
//! world is off by a third. It shows when these are set free for all cameras alike: the room then fits better, and one camera's are far from
//! what was stated while the others' stay.

use foveate_estimation::statistics::median;
use foveate_geometry::bundle::Freedom;

use super::Again;
use crate::cause::{Cause, Culprit};
use crate::recording::Recording;
use crate::room::settle::Room;

/// What is set free must lower the cost of the observations to this part at the most [–].
const BETTER: f64 = 0.7;
/// It must be off by so much, as a natural logarithm [–]…
const OFF: f64 = 0.04;
/// … and by so many times what that of the median camera is off.
const MORE_THAN_OTHERS: f64 = 4.0;

/// The room without a camera whose focal length or pixels are not as stated, and which that is; the room as it is where there is none.
pub(super) fn told_wrong<'a>(recording: &Recording, room: Room<'a>, again: Again<'a, '_>) -> (Room<'a>, Vec<Culprit>) {
    let members: Vec<usize> = (0..room.cameras.len()).filter(|it| room.cameras[*it].is_some()).collect();
    if members.len() < 3 {
        return (room, Vec::new());
    }
    let mut free = room.clone();
    for camera in &members {
        let own = free.freed[*camera];
        free.freed[*camera] = Freedom { focal: true, aspect: true, ..own };
    }
    free.settle(&[2.0, 1.0, 1.0]);
    if free.cost() > BETTER * room.cost() {
        return (room, Vec::new());
    }
    let off = |camera: usize| {
        let focal = |room: &Room<'_>, axis: usize| room.cameras[camera].as_ref().map_or(1.0, |it| it.intrinsics.focal[axis]);
        let is_known = !recording.cameras[camera].free.focal;
        let focal_off = if is_known { (focal(&free, 0) / focal(&room, 0)).ln() } else { 0.0 };
        let shape_off = ((focal(&free, 1) / focal(&free, 0)) / (focal(&room, 1) / focal(&room, 0))).ln();
        [focal_off, shape_off]
    };
    let mut found: Option<(f64, Culprit)> = None;
    for which in [1, 0] {
        let sizes: Vec<f64> = members.iter().map(|it| off(*it)[which].abs()).collect();
        let usual = median(&sizes).unwrap_or(0.0);
        for (camera, size) in members.iter().zip(&sizes) {
            let is_off = *size > OFF && *size > MORE_THAN_OTHERS * usual;
            if is_off && found.as_ref().is_none_or(|it| *size > it.0) {
                let factor = off(*camera)[which].exp();
                let cause = if which == 1 { Cause::PixelShape { factor } } else { Cause::Focal { factor } };
                found = Some((*size, Culprit { camera: *camera, cause, shares: [0.0, 1.0] }));
            }
        }
    }
    match found {
        Some((_, culprit)) => {
            let rest = again(&[culprit.camera], None).unwrap_or(room);
            (rest, vec![culprit])
        }
        None => (room, Vec::new()),
    }
}
