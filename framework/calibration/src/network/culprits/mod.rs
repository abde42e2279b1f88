//! Finds, diagnoses and leaves out faulty cameras whose observations contradict the rest so much that they would spoil the solution.
//!
//! A robust adjustment copes with wrong observations, not with a faulty camera: with few cameras it bends the solution until the faulty one fits a
//! little. So the room is also solved without each camera in turn, and the set of cameras that agree best with one another is kept:
//! the sum of the squared shares of observations that fit. Each camera outside of it, or that fits clearly less often than the others, is then
//! compared with where these alone have the light, under each hypothesis of what may be wrong ([`hypotheses`]). Exact hypotheses (a
//! mirrored picture, rows of earlier frames, two poses before and after a moment) are right or wrong at once, whatever the noise.

mod hypotheses;
mod optics;

use foveate_estimation::statistics::median;
use nalgebra::Point2;

use self::hypotheses::{Finding, Witnesses};
use super::moments::Moment;
use super::settle::Room;
use crate::cause::{CameraFault, Cause};
use crate::pose_change::PoseChange;
use crate::recording::Recording;

/// No camera is at fault where each fits at least this part of its observations [–].
const CLEAN: f64 = 0.9;
/// A camera is looked at when it fits less than this part of what the median camera fits [–].
const LESS: f64 = 0.85;
/// Cameras without which the room is solved again, at a time; those that fit least.
const TRIED: usize = 8;
/// Rooms are solved without at most so many cameras.
const MOST_OUT: usize = 3;
/// Fewer observations that others witness say nothing about a camera [–].
pub(super) const LEAST_ROWS: usize = 20;
/// A camera fits by chance when it fits no more than this part of its observations [–].
const BY_CHANCE: f64 = 0.15;

/// What the agreement of two cameras counts beside that of three [–].
const TWO_ALONE: f64 = 0.7;
/// Rows were exchanged when putting them right makes so many more cameras agree (in squared shares) [–].
const EXCHANGE_GAIN: f64 = 0.3;
/// Up to so many cameras what may be wrong is put right on trial [–].
const FEW_CAMERAS: usize = 3;
/// All cameras of a room that was put right fit so large a part of their observations [–].
const REPAIRED: f64 = 0.8;
/// Parts of the recording after which rows may be exchanged.
const CHANGES: [f64; 7] = [0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875];
/// Two poses, one before and one after a moment, must explain so much more for that [–].
const LEAST_CHANGE: f64 = 0.1;

/// What was found.
pub(super) struct Found<'a> {
    /// The network without the faulty cameras.
    pub network: Room<'a>,
    /// Cameras left out, and why.
    pub culprits: Vec<CameraFault>,
}

/// Solves a room without the cameras of a list, and with what is wrong with others put right.
type Again<'a, 'f> = &'f dyn Fn(&[usize], Option<Repair>) -> Option<Room<'a>>;

/// What can be put right in a recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Repair {
    /// The rows of two cameras are exchanged.
    Exchange {
        cameras: [usize; 2],
        /// From then on [s].
        since_s: f64,
    },
    /// A picture is turned left to right.
    Mirror { camera: usize, width: u32 },
    /// A picture of so many columns and rows is upside down.
    HalfTurn { camera: usize, size: [u32; 2] },
}

impl Repair {
    /// The moments with that put right.
    pub fn done_to(self, moments: &[Moment]) -> Vec<Moment> {
        let mut moments = moments.to_vec();
        for moment in &mut moments {
            let time_s = moment.time_s;
            for view in &mut moment.views {
                match self {
                    Repair::Exchange { cameras: [a, b], since_s } if time_s >= since_s => {
                        view.camera = if view.camera == a {
                            b
                        } else if view.camera == b {
                            a
                        } else {
                            view.camera
                        };
                    }
                    Repair::Mirror { camera, width } if view.camera == camera => {
                        view.spots.iter_mut().for_each(|it| it.x = f64::from(width) - 1.0 - it.x);
                    }
                    Repair::HalfTurn { camera, size } if view.camera == camera => {
                        let last = size.map(|it| f64::from(it) - 1.0);
                        view.spots.iter_mut().for_each(|it| *it = Point2::new(last[0] - it.x, last[1] - it.y));
                    }
                    _ => {}
                }
            }
        }
        moments
    }
}

/// Searches the cameras at fault in `network`, the solution from all cameras as far as there is one. `None` where
/// neither that solution nor a corrected one is accepted.
pub(super) fn find<'a>(
    recording: &Recording,
    moments: &[Moment],
    network: Option<Room<'a>>,
    again: Again<'a, '_>,
) -> Option<Found<'a>> {
    let n = recording.cameras.len();
    let rows = |camera: usize| moments.iter().filter(|it| sees(it, camera)).count();
    let heard: Vec<usize> = (0..n).filter(|it| rows(*it) >= LEAST_ROWS).collect();
    let is_clean = |network: &Room<'_>| {
        let shares = network.shares();
        heard.iter().all(|it| network.cameras[*it].is_some() && shares[*it].is_none_or(|it| it >= CLEAN))
    };
    if heard.len() < 3 {
        return Some(Found { network: network?, culprits: Vec::new() });
    }
    let network = match network {
        Some(network) => {
            if let Some(change) = network.pose_change() {
                return Some(without_moved(network, &change, again));
            }
            if let Some((network, culprits)) = optics::told_by_optics(recording, &network, again) {
                return Some(Found { network, culprits });
            }
            let (network, culprits) = optics::told_wrong(recording, network, again);
            if is_clean(&network) || !culprits.is_empty() {
                return Some(Found { network, culprits });
            }
            Some(network)
        }
        None => None,
    };
    if heard.len() <= FEW_CAMERAS
        && let Some(found) = put_right(recording, moments, network.as_ref(), &heard, again)
    {
        return Some(found);
    }
    let network = network?;
    let mut best = agreeing(network, &heard, again);
    let shares = best.network.shares();
    let members: Vec<usize> = heard.iter().copied().filter(|it| best.network.cameras[*it].is_some()).collect();
    let known: Vec<f64> = members.iter().filter_map(|it| shares[*it]).collect();
    let usual = median(&known).unwrap_or(1.0);
    let is_flagged = |it: &usize| match (&best.network.cameras[*it], shares[*it]) {
        (None, _) => true,
        (Some(_), share) => share.is_some_and(|it| it < LESS * usual),
    };
    let mut findings: Vec<Finding> = Vec::new();
    for camera in heard.iter().copied().filter(is_flagged) {
        // What a camera is compared with must not have been bent to it.
        let without: Vec<usize> = best.out.iter().copied().chain([camera]).collect();
        let others = match best.network.cameras[camera] {
            Some(_) if members.len() > 2 => best.without(&without, again),
            _ => None,
        };
        let others = others.as_ref().map_or(&best.network, |it| &it.network);
        let witnesses = Witnesses::new(others, camera, recording);
        findings.extend(witnesses.examine(&recording.cameras[camera], usual));
    }
    if let Some(network) = exchanged(&mut findings, &best, again) {
        best = network;
    }
    Some(conclude(recording, best, findings, again))
}

/// The room without a camera that was moved while it was recorded.
fn without_moved<'a>(network: Room<'a>, change: &PoseChange, again: Again<'a, '_>) -> Found<'a> {
    let best = Subset { network, out: Vec::new() };
    let rest = best.without(&[change.camera], again).map(|it| it.network);
    let mut network = rest.unwrap_or(best.network);
    network.cameras[change.camera] = None;
    Found { network, culprits: vec![change.culprit()] }
}

/// With three cameras the two that are left when one is out agree too easily to tell who it is. So what can be wrong with one or two is
/// put right, each in turn; the one by which all agree is what it was.
fn put_right<'a>(
    recording: &Recording,
    moments: &[Moment],
    network: Option<&Room<'a>>,
    heard: &[usize],
    again: Again<'a, '_>,
) -> Option<Found<'a>> {
    let score = |network: &Room<'a>| Subset { network: network.clone(), out: Vec::new() }.score();
    let before = network.map_or(0.0, score);
    let mut tried: Vec<(Repair, Vec<(usize, Cause)>)> = heard
        .iter()
        .map(|camera| {
            let width = recording.cameras[*camera].camera.image_size[0];
            (Repair::Mirror { camera: *camera, width }, vec![(*camera, Cause::Mirrored)])
        })
        .collect();
    if heard.len() == 3 {
        let times: Vec<f64> = moments.iter().map(|it| it.time_s).collect();
        for (a, b) in [(0, 1), (0, 2), (1, 2)].map(|(a, b)| (heard[a], heard[b])) {
            let same_size = recording.cameras[a].camera.image_size == recording.cameras[b].camera.image_size;
            for since_s in CHANGES.map(|it| times[(it * times.len() as f64) as usize]).into_iter().filter(|_| same_size)
            {
                let swapped = |with: usize| Cause::Swapped { with, since_s: Some(since_s) };
                let causes = vec![(a, swapped(b)), (b, swapped(a))];
                tried.push((Repair::Exchange { cameras: [a, b], since_s }, causes));
            }
        }
    }
    let enough = |network: &Room<'a>| {
        let shares = network.shares();
        heard.iter().all(|it| network.cameras[*it].is_some() && shares[*it].is_none_or(|it| it >= REPAIRED))
    };
    let rooms = tried.into_iter().filter_map(|(repair, causes)| Some((again(&[], Some(repair))?, repair, causes)));
    let standing = rooms.filter(|it| enough(&it.0) && score(&it.0) > before + EXCHANGE_GAIN);
    let (mut network, repair, causes) = standing.max_by(|a, b| score(&a.0).total_cmp(&score(&b.0)))?;
    if let Repair::Mirror { camera, .. } = repair {
        network.cameras[camera] = None;
        network.settle(&[1.0]);
    }
    let culprit = |(camera, cause): &(usize, Cause)| CameraFault { camera: *camera, cause: *cause, shares: [0.0, 1.0] };
    Some(Found { network, culprits: causes.iter().map(culprit).collect() })
}

/// The room without those that are at fault, and with those that only seemed to be.
fn conclude<'a>(recording: &Recording, best: Subset<'a>, findings: Vec<Finding>, again: Again<'a, '_>) -> Found<'a> {
    let is_out = |it: &Finding| match it.cause {
        Some(Cause::FalseObservations { share }) => 1.0 - share < BY_CHANCE,
        // The room was solved with their rows put right.
        Some(Cause::Swapped { .. }) => false,
        Some(_) => true,
        None => false,
    };
    let culprits: Vec<CameraFault> = findings
        .iter()
        .filter_map(|it| Some(CameraFault { camera: it.camera, cause: it.cause?, shares: it.shares }))
        .collect();
    let out: Vec<usize> = findings.iter().filter(|it| is_out(it)).map(|it| it.camera).collect();
    let in_use = out.iter().any(|it| best.network.cameras[*it].is_some());
    let all: Vec<usize> = best.out.iter().chain(&out).copied().collect();
    let cleared = if in_use { best.without(&all, again) } else { None };
    let mut kept = cleared.map_or(best.network, |it| it.network);
    out.iter().for_each(|it| kept.cameras[*it] = None);
    let mut is_rescued = false;
    for finding in findings.iter().filter(|it| !is_out(it)) {
        if kept.cameras[finding.camera].is_some() {
            continue;
        }
        kept.cameras[finding.camera] = Some(finding.fitted.clone());
        kept.freed[finding.camera] = recording.cameras[finding.camera].free;
        kept.freed[finding.camera].pose = true;
        is_rescued = true;
    }
    if is_rescued {
        kept.settle(&[1.5, 1.0, 1.0]);
    }
    Found { network: kept, culprits }
}

/// A room solved from some of the cameras.
struct Subset<'a> {
    network: Room<'a>,
    out: Vec<usize>,
}

/// The set of cameras that agree best, found by leaving out one after the other.
fn agreeing<'a>(network: Room<'a>, heard: &[usize], again: Again<'a, '_>) -> Subset<'a> {
    let mut best = Subset { network, out: Vec::new() };
    while best.out.len() < MOST_OUT && !(best.is_clean() && best.n_in_use() >= heard.len().min(3)) {
        let shares = best.network.shares();
        let mut members: Vec<usize> = heard.iter().copied().filter(|it| !best.out.contains(it)).collect();
        if members.len() < 3 {
            break;
        }
        let share = |it: &usize| best.network.cameras[*it].as_ref().map_or(0.0, |_| shares[*it].unwrap_or(1.0));
        members.sort_by(|a, b| share(a).total_cmp(&share(b)));
        let mut next: Option<Subset> = None;
        for camera in members.iter().take(TRIED) {
            let out: Vec<usize> = best.out.iter().copied().chain([*camera]).collect();
            let Some(tried) = best.without(&out, again) else { continue };
            let is_enough = tried.is_clean() && tried.n_in_use() + 1 >= members.len() && tried.n_in_use() >= 3;
            if next.as_ref().is_none_or(|it| tried.score() > it.score()) {
                next = Some(tried);
            }
            if is_enough {
                break;
            }
        }
        match next.filter(|it| it.score() > best.score() + 1e-9) {
            Some(next) => best = next,
            None => break,
        }
    }
    best
}

impl<'a> Subset<'a> {
    /// Without the cameras in `out`: settled from where the others stand here, or else solved from nothing.
    fn without(&self, out: &[usize], again: Again<'a, '_>) -> Option<Subset<'a>> {
        let mut network = self.network.clone();
        out.iter().for_each(|it| network.cameras[*it] = None);
        let settled = (network.cameras.iter().flatten().count() >= 2).then(|| {
            network.settle(&[6.0, 2.0, 1.0]);
            Subset { network, out: out.to_vec() }
        });
        let anew = match &settled {
            Some(it) if it.is_clean() && it.n_in_use() >= 3 => None,
            _ => again(out, None).map(|network| Subset { network, out: out.to_vec() }),
        };
        [settled, anew].into_iter().flatten().max_by(|a, b| a.score().total_cmp(&b.score()))
    }

    fn n_in_use(&self) -> usize {
        self.network.cameras.iter().flatten().count()
    }

    /// Whether all cameras in use agree.
    fn is_clean(&self) -> bool {
        let shares = self.network.shares();
        self.network
            .cameras
            .iter()
            .zip(shares)
            .all(|(camera, share)| camera.is_none() || share.is_none_or(|it| it >= CLEAN))
    }

    /// As many cameras as agree, and how well.
    fn score(&self) -> f64 {
        let shares = self.network.shares();
        let known = self.network.cameras.iter().zip(shares).filter(|it| it.0.is_some());
        let sum: f64 = known.map(|it| it.1.unwrap_or(1.0).powi(2)).sum();
        // Two cameras agree on anything along their epipolar lines.
        if self.n_in_use() == 2 { TWO_ALONE * sum } else { sum }
    }
}

/// Two cameras that seem to change at one moment may have exchanged their rows: the room is solved with these put right, and where more
/// cameras agree then, that is what it was.
fn exchanged<'a>(findings: &mut [Finding], best: &Subset<'a>, again: Again<'a, '_>) -> Option<Subset<'a>> {
    let mut found: Option<(Subset<'a>, [usize; 2], f64)> = None;
    for first in 0..findings.len() {
        for second in first + 1..findings.len() {
            let parts = [&findings[first].parts, &findings[second].parts].into_iter().flatten();
            let Some(parts) = parts.max_by(|a, b| a.gain.total_cmp(&b.gain)).filter(|it| it.gain > LEAST_CHANGE) else {
                continue;
            };
            let cameras = [findings[first].camera, findings[second].camera];
            let exchange = Repair::Exchange { cameras, since_s: parts.at_s };
            let Some(network) = again(&[], Some(exchange)) else { continue };
            let tried = Subset { network, out: Vec::new() };
            if tried.score() > found.as_ref().map_or(best.score() + EXCHANGE_GAIN, |it| it.0.score()) {
                found = Some((tried, [first, second], parts.at_s));
            }
        }
    }
    let (network, pair, since_s) = found?;
    let cameras = pair.map(|it| findings[it].camera);
    for (index, with) in pair.into_iter().zip([cameras[1], cameras[0]]) {
        findings[index].cause = Some(Cause::Swapped { with, since_s: Some(since_s) });
        findings[index].shares[1] = 1.0;
    }
    // Who was suspected of what those two did is free again.
    for finding in findings.iter_mut().filter(|it| !cameras.contains(&it.camera)) {
        if network.network.cameras[finding.camera].is_some() {
            finding.cause = None;
        }
    }
    Some(network)
}

fn sees(moment: &Moment, camera: usize) -> bool {
    moment.views.iter().any(|it| it.camera == camera)
}
