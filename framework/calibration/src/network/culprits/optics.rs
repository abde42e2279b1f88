//! Finds a camera whose optics are not as stated, although the solution bends until everything fits.
//!
//! A focal length or a shape of pixels that is wrong need not show in the residuals: poses and the optics that are free make up for it, and the
//! world is off by a third. It shows when these are set free for all cameras alike: the room then fits better, and one camera's are far from
//! what was stated while the others' stay.

use foveate_estimation::statistics::median;
use foveate_geometry::bundle::Freedom;

use super::{Again, Repair};
use crate::cause::{CameraFault, Cause};
use crate::network::settle::Room;
use crate::recording::Recording;
use crate::stretches::{steadiness, steady_enough};

/// A room whose observations are off by less in the root mean square has no optics that are wrong [px].
const WELL_PX: f64 = 0.4;
/// What is set free must lower the cost of the observations to this part at the most [–].
const BETTER: f64 = 0.7;
/// It must be off by so much, as a natural logarithm [–]…
const OFF: f64 = 0.04;
/// … and by so many times what that of the median camera is off.
const MORE_THAN_OTHERS: f64 = 4.0;

/// Nothing is off by more; an adjustment that says so went astray.
const TOO_FAR: f64 = 0.75;
/// Putting something right must lower the cost of the observations to this part at the most [–].
const PUT_RIGHT: f64 = 0.8;
/// … and be no more than so many times what it is with all focal lengths free.
const NOTHING_LEFT: f64 = 1.5;
/// The principal points of a picture and of the same upside down are distinguishable when so many standard deviations
/// apart [–].
const HALF_TURN_SIGMAS: f64 = 5.0;
/// Optics are not as stated when off by so many standard deviations [–].
const OFF_SIGMAS: f64 = 5.0;
/// Names of so many cameras are exchanged on trial, and so many are turned [–].
const FEW: [usize; 2] = [6, 12];

/// Where optics are stated, a picture that is upside down and two cameras that have each other's names do not fit them: the room with these put
/// right, where one explains far more than the room as it is.
pub(super) fn told_by_optics<'a>(
    recording: &Recording,
    network: &Room<'a>,
    again: Again<'a, '_>,
) -> Option<(Room<'a>, Vec<CameraFault>)> {
    let members: Vec<usize> = (0..network.cameras.len()).filter(|it| network.cameras[*it].is_some()).collect();
    let camera = |it: usize| &recording.cameras[it].camera;
    if members.len() < 3 || members.iter().any(|it| recording.cameras[*it].free.focal) {
        return None;
    }
    let mut tried: Vec<(Repair, Vec<(usize, Cause)>)> = Vec::new();
    if members.len() <= FEW[1] {
        let turned = |it: &usize| {
            let size = camera(*it).image_size;
            (Repair::HalfTurn { camera: *it, size }, vec![(*it, Cause::UpsideDown)])
        };
        tried.extend(members.iter().map(turned));
    }
    if members.len() <= FEW[0] {
        for (index, a) in members.iter().enumerate() {
            for b in members[index + 1..].iter().filter(|it| camera(**it).image_size == camera(*a).image_size) {
                let swapped = |with: usize| Cause::Swapped { with, since_s: None };
                let repair = Repair::Exchange { cameras: [*a, *b], since_s: f64::NEG_INFINITY };
                tried.push((repair, vec![(*a, swapped(*b)), (*b, swapped(*a))]));
            }
        }
    }
    let before = network.cost();
    let rooms = tried.into_iter().filter_map(|(repair, causes)| Some((again(&[], Some(repair))?, causes)));
    let whole = |it: &Room<'_>| members.iter().all(|camera| it.cameras[*camera].is_some());
    let costs = network.costs();
    let is_steady = |it: &Room<'_>| {
        let gains: Vec<f64> = costs.iter().zip(it.costs()).map(|(before, after)| before - after).collect();
        steadiness(&gains) > steady_enough(gains.len())
    };
    let is_seen = |causes: &[(usize, Cause)]| match causes {
        [(camera, Cause::UpsideDown)] => principal_is_opposite(recording, network, *camera),
        _ => true,
    };
    // Any change lets a room with a wrong focal length fit a little better; the right one leaves nothing for other optics to explain.
    let limit = (PUT_RIGHT * before).min(NOTHING_LEFT * with_free_optics(network).cost());
    let right = rooms.filter(|it| whole(&it.0) && it.0.cost() < limit && is_steady(&it.0) && is_seen(&it.1));
    let (network, causes) = right.min_by(|a, b| a.0.cost().total_cmp(&b.0.cost()))?;
    let culprit = |(camera, cause): &(usize, Cause)| CameraFault { camera: *camera, cause: *cause, shares: [0.0, 1.0] };
    Some((network, causes.iter().map(culprit).collect()))
}

/// A picture that is upside down has its principal point on the other side of its middle, and by that alone it differs from one that is not, but for a
/// roll. Whether the principal point, found from what was seen, is nearer to there than to where it is stated, beyond doubt.
fn principal_is_opposite(recording: &Recording, network: &Room<'_>, camera: usize) -> bool {
    let mut free = network.clone();
    free.freed[camera] = Freedom { principal: true, ..network.freed[camera] };
    free.know_nothing_of_principal(camera);
    free.settle(&[3.0, 1.0, 1.0]);
    let (Some(found), Some(sigma)) = (&free.cameras[camera], free.optics_sigma(camera)) else { return false };
    let stated = &recording.cameras[camera].camera;
    let on = |axis: usize| {
        let middle = 0.5 * (f64::from(stated.image_size[axis]) - 1.0);
        let way = 2.0 * (middle - stated.intrinsics.principal[axis]);
        (way, found.intrinsics.principal[axis] - stated.intrinsics.principal[axis], sigma.principal[axis])
    };
    // Along either axis what is found in units of what it must be, weighed by how well it is known.
    let (mut sum, mut weights) = (0.0, 0.0);
    for (way, went, sigma) in [on(0), on(1)] {
        sum += way * went / sigma.powi(2);
        weights += way * way / sigma.powi(2);
    }
    weights.sqrt() > HALF_TURN_SIGMAS && (sum / weights - 1.0).abs() < 0.5
}

/// The room with all focal lengths and shapes of pixels set free.
fn with_free_optics<'a>(network: &Room<'a>) -> Room<'a> {
    let mut free = network.clone();
    for camera in (0..network.cameras.len()).filter(|it| network.cameras[*it].is_some()) {
        free.freed[camera] = Freedom { focal: true, aspect: true, ..network.freed[camera] };
        free.know_nothing_of_shape(camera);
    }
    free.settle(&[3.0, 2.0, 1.0, 1.0]);
    free
}

/// The room without a camera whose focal length or pixels are not as stated, and which that is; the room as it is where there is none.
pub(super) fn told_wrong<'a>(
    recording: &Recording,
    network: Room<'a>,
    again: Again<'a, '_>,
) -> (Room<'a>, Vec<CameraFault>) {
    let members: Vec<usize> = (0..network.cameras.len()).filter(|it| network.cameras[*it].is_some()).collect();
    if members.len() < 3 {
        return (network, Vec::new());
    }
    let free = with_free_optics(&network);
    if network.cost() < WELL_PX * WELL_PX || free.cost() > BETTER * network.cost() {
        return (network, Vec::new());
    }
    let off = |camera: usize| {
        let focal = |network: &Room<'_>, axis: usize| {
            network.cameras[camera].as_ref().map_or(1.0, |it| it.intrinsics.focal[axis])
        };
        let is_known = !recording.cameras[camera].free.focal;
        let focal_off = if is_known { (focal(&free, 0) / focal(&network, 0)).ln() } else { 0.0 };
        let shape_off = ((focal(&free, 1) / focal(&free, 0)) / (focal(&network, 1) / focal(&network, 0))).ln();
        [focal_off, shape_off]
    };
    let mut found: Option<(f64, CameraFault)> = None;
    for which in [1, 0] {
        // All of them may be off by the same for want of depth; one that is off otherwise is not as stated.
        let offs: Vec<f64> = members.iter().map(|it| off(*it)[which]).collect();
        let common = median(&offs).unwrap_or(0.0);
        let sizes: Vec<f64> = offs.iter().map(|it| (it - common).abs()).collect();
        let usual = median(&sizes).unwrap_or(0.0);
        for (camera, size) in members.iter().zip(&sizes) {
            let sigma = free.optics_sigma(*camera).map_or(f64::INFINITY, |it| [it.focal, it.aspect][which]);
            let is_off = *size > OFF && *size < TOO_FAR && *size > (MORE_THAN_OTHERS * usual).max(OFF_SIGMAS * sigma);
            if is_off && found.as_ref().is_none_or(|it| *size > it.0) {
                let factor = (off(*camera)[which] - common).exp();
                let cause = if which == 1 { Cause::PixelShape { factor } } else { Cause::Focal { factor } };
                found = Some((*size, CameraFault { camera: *camera, cause, shares: [0.0, 1.0] }));
            }
        }
    }
    match found {
        Some((_, culprit)) => {
            let rest = again(&[culprit.camera], None).unwrap_or(network);
            (rest, vec![culprit])
        }
        None => (network, Vec::new()),
    }
}
