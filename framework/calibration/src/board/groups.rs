//! Relative poses of cameras: pairs that see the board together, chained from the best pair on.
//!
//! A picture of the board leaves up to two poses open, and which way round a symmetric board lies. A pair of cameras has one relative
//! pose in all frames, so the choice that most frames share is the right one; where there is but one frame, or the board never turned,
//! more than one choice may remain, and that is said.

use foveate_geometry::{Camera, self_calibration::Link};
use nalgebra::{Isometry3, Point2, Point3};

use super::{BoardOptions, pattern::Board, plane::Posed};

/// What a camera saw in a frame, and the poses that explain it.
#[derive(Debug, Clone)]
pub(super) struct CameraFrame {
    pub camera: usize,
    pub frame: usize,
    pub ids: Vec<u32>,
    pub places: Vec<Point3<f64>>,
    pub pixels: Vec<Point2<f64>>,
    pub sigmas: Vec<f64>,
    pub poses: Vec<Posed>,
    /// Which of the board's turns takes its marks to those of the frame.
    pub turn: usize,
}

/// Frames from which relative poses of a pair are proposed, and frames on which they are tried.
const PROPOSING: usize = 12;
const TRYING: usize = 60;
/// Proposals further apart than this are different answers [rad].
const DIFFERENT: f64 = 0.15;

pub(super) struct Paired {
    pub link: Link,
    pub b_from_a: Isometry3<f64>,
    /// Mean loss over the frames tried, from 0 to 1.
    pub loss: f64,
    /// Whether another, different pose is as good.
    pub open: bool,
}

/// Mean distance of a few marks of `camera_frame` from where a board with `camera_from_board` has them [px].
fn distance(camera: &Camera, camera_from_board: &Isometry3<f64>, camera_frame: &CameraFrame) -> f64 {
    let eye = Camera { camera_from_world: *camera_from_board, ..camera.clone() };
    let n = camera_frame.places.len();
    let picked = [0, n / 3, 2 * n / 3, n - 1];
    let sum: f64 = picked
        .iter()
        .map(|it| eye.project(&camera_frame.places[*it]).map_or(1e6, |at| (at - camera_frame.pixels[*it]).norm()))
        .sum();
    sum / picked.len() as f64
}

/// A distance beyond which a camera frame simply does not agree [px].
fn cap(camera: &Camera, options: &BoardOptions) -> f64 {
    (0.02 * f64::from(camera.image_size[0])).max(3.0 * options.inlier_px)
}

/// The relative pose on which most common frames of two cameras agree.
pub(super) fn pair(
    cameras: &[Camera],
    a: usize,
    b: usize,
    common: &[(&CameraFrame, &CameraFrame)],
    board: &Board,
    guess: Option<&[Camera]>,
    options: &BoardOptions,
) -> Option<Paired> {
    let cap = cap(&cameras[b], options);
    let every = |n: usize| move |it: usize| it * common.len() / common.len().min(n);
    let loss = |b_from_a: &Isometry3<f64>| {
        let n = common.len().min(TRYING);
        let (mut sum, mut right) = (0.0, 0);
        for (of_a, of_b) in (0..n).map(every(TRYING)).map(|it| common[it]) {
            let mut least = f64::INFINITY;
            for pose in &of_a.poses {
                for turn in board.turns() {
                    least = least.min(distance(&cameras[b], &(b_from_a * pose.camera_from_board * turn), of_b));
                }
            }
            right += usize::from(least < cap);
            sum += (least / cap).min(1.0);
        }
        (sum / n as f64, right * common.len() / n)
    };
    let mut proposals = Vec::new();
    for (of_a, of_b) in (0..common.len().min(PROPOSING)).map(every(PROPOSING)).map(|it| common[it]) {
        for in_a in &of_a.poses {
            for in_b in &of_b.poses {
                for turn in board.turns() {
                    let b_from_a = in_b.camera_from_board * (in_a.camera_from_board * turn).inverse();
                    let (loss, right) = loss(&b_from_a);
                    // Of two poses of one camera frame the worse is less likely, even where all else is equal.
                    proposals.push((loss + 0.5 * (in_a.rms_px + in_b.rms_px) / cap, right, b_from_a));
                }
            }
        }
    }
    proposals.sort_by(|x, y| x.0.total_cmp(&y.0));
    let first = proposals.first()?;
    let as_good = 1.3 * first.0 + 0.01;
    let apart = |x: &Isometry3<f64>, y: &Isometry3<f64>| x.rotation.angle_to(&y.rotation);
    let rivals: Vec<_> = proposals.iter().filter(|it| it.0 <= as_good).collect();
    let mut open = rivals.iter().any(|it| apart(&it.2, &first.2) > DIFFERENT);
    let mut chosen = first;
    if let Some(guess) = guess.filter(|_| open) {
        let expected = guess[b].camera_from_world * guess[a].camera_from_world.inverse();
        chosen = rivals.iter().min_by(|x, y| apart(&x.2, &expected).total_cmp(&apart(&y.2, &expected)))?;
        open = false;
    }
    let link = Link { a, b, common: common.len(), right: chosen.1, planar_share: 1.0, consistent: chosen.1 > 0 };
    Some(Paired { link, b_from_a: chosen.2, loss: chosen.0, open })
}

/// Connected cameras, and the pose of each in the space of the first.
pub(super) struct Group {
    pub members: Vec<(usize, Isometry3<f64>)>,
    /// Members whose place hangs on a pair with more than one answer.
    pub open: Vec<usize>,
}

/// Chains pairs, the best first, into groups; the largest group comes first.
pub(super) fn groups(n_cameras: usize, pairs: &[Paired], usable: &[bool]) -> Vec<Group> {
    let mut order: Vec<&Paired> =
        pairs.iter().filter(|it| it.link.right > 0 && 2 * it.link.right >= it.link.common.min(2)).collect();
    order.sort_by(|x, y| {
        let strength = |it: &Paired| it.link.right as f64 * (1.0 - it.loss);
        x.open.cmp(&y.open).then(strength(y).total_cmp(&strength(x)))
    });
    let mut groups: Vec<Group> = (0..n_cameras)
        .filter(|it| usable[*it])
        .map(|it| Group { members: vec![(it, Isometry3::identity())], open: Vec::new() })
        .collect();
    for pair in order {
        let of = |camera: usize| groups.iter().position(|it| it.members.iter().any(|member| member.0 == camera));
        let (Some(at_a), Some(at_b)) = (of(pair.link.a), of(pair.link.b)) else { continue };
        if at_a == at_b {
            continue;
        }
        let pose = |at: usize, camera: usize| groups[at].members.iter().find(|it| it.0 == camera).map(|it| it.1);
        let (Some(a_from_first), Some(b_from_other)) = (pose(at_a, pair.link.a), pose(at_b, pair.link.b)) else {
            continue;
        };
        // other ← b ← a ← first
        let other_from_first = b_from_other.inverse() * pair.b_from_a * a_from_first;
        let other = groups.remove(at_b);
        let at_a = at_a - usize::from(at_b < at_a);
        let group = &mut groups[at_a];
        if pair.open {
            group.open.extend(other.members.iter().map(|it| it.0));
        }
        group.open.extend(other.open);
        group.members.extend(other.members.into_iter().map(|(camera, pose)| (camera, pose * other_from_first)));
    }
    groups.sort_by_key(|it| std::cmp::Reverse(it.members.len()));
    groups
}

/// A pose of the board is given up for another under which what was seen is off by less than this part of what it is now.
const MUCH_BETTER: f64 = 0.5;

/// Where the board is in a frame, given the cameras, and how each camera frame is turned: the pose, mirrored or turned, of one camera frame on which the
/// looks agree best; `now`, where that is known and no other is much better. `None` when no camera that is placed saw it.
pub(super) fn place(
    cameras: &[Camera],
    placed: &[bool],
    now: Option<&Isometry3<f64>>,
    camera_frames: &mut [&mut CameraFrame],
    board: &Board,
    options: &BoardOptions,
) -> Option<Isometry3<f64>> {
    let seeing: Vec<usize> = (0..camera_frames.len()).filter(|it| placed[camera_frames[*it].camera]).collect();
    let judged = |world_from_board: &Isometry3<f64>| {
        let (mut sum, mut turned) = (0.0, vec![0; camera_frames.len()]);
        for &at in &seeing {
            let camera = &cameras[camera_frames[at].camera];
            let camera_from_board = camera.camera_from_world * world_from_board;
            let turns = board.turns().iter().enumerate();
            let tried = turns.map(|(it, turn)| (distance(camera, &(camera_from_board * turn), camera_frames[at]), it));
            let (least, turn) = tried.min_by(|x, y| x.0.total_cmp(&y.0))?;
            sum += (least / cap(camera, options)).min(1.0);
            turned[at] = turn;
        }
        Some((sum, *world_from_board, turned))
    };
    let of_frame = |at: &usize| {
        let world_from_camera = cameras[camera_frames[*at].camera].camera_from_world.inverse();
        camera_frames[*at].poses.iter().map(move |pose| world_from_camera * pose.camera_from_board).collect::<Vec<_>>()
    };
    let candidates: Vec<Isometry3<f64>> = seeing.iter().flat_map(of_frame).collect();
    let best = candidates.iter().filter_map(judged).min_by(|x, y| x.0.total_cmp(&y.0));
    let kept = now.and_then(judged).filter(|now| best.as_ref().is_none_or(|it| it.0 > MUCH_BETTER * now.0));
    let (_, world_from_board, turned) = kept.or(best)?;
    camera_frames.iter_mut().zip(turned).for_each(|(camera_frame, turn)| camera_frame.turn = turn);
    Some(world_from_board)
}

/// The pixels' places on the board as the frame has it.
pub(super) fn turned_place(board: &Board, camera_frame: &CameraFrame, mark: usize) -> Point3<f64> {
    board.turns()[camera_frame.turn] * camera_frame.places[mark]
}
