//! The edges of the view graph: pairs of cameras that see the light in common frames, each with its relative pose.

use foveate_estimation::Random;
use nalgebra::{Isometry3, Matrix2, Point2, Vector2};

use super::{CameraStatus, LightObservation, SelfCalibrationOptions};
use crate::bundle::{Freedom, OpticsPrior};
use crate::camera::Camera;
use crate::epipolar::{EpipolarError, EpipolarOptions, relative_pose};

/// A pair of cameras with its relative pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Index of the camera with the lower number.
    pub a: usize,
    /// Index of the other camera.
    pub b: usize,
    /// Frames in which both see the light.
    pub common: usize,
    /// Number of these that fit the relative pose.
    pub right: usize,
    /// Part of the inliers that one plane explains [–].
    pub planar_share: f64,
    /// Whether the rotations of the other pairs agree.
    pub consistent: bool,
}

/// The observations, by camera.
pub(super) struct Tracks<'a> {
    /// As the caller gave them.
    pub given: &'a [Camera],
    /// With the optics that are tried.
    pub cameras: &'a [Camera],
    /// What is known of optics that are free.
    pub priors: Vec<OpticsPrior>,
    /// What is free of each.
    pub free: &'a [Freedom],
    pub observations: &'a [LightObservation],
    /// By camera: its observations in the order of frames.
    pub of_camera: Vec<Vec<usize>>,
    /// By frame: its observations in the order of cameras.
    pub of_frame: Vec<Vec<usize>>,
}

/// A link, its pose and the observations that fit.
pub(super) struct Oriented {
    pub link: Link,
    pub b_from_a: Isometry3<f64>,
    pub right: Vec<[usize; 2]>,
}

pub(super) struct Orientations {
    pub links: Vec<Oriented>,
    /// [`CameraStatus::Calibrated`] where there is a link.
    pub status: Vec<CameraStatus>,
}

impl<'a> Tracks<'a> {
    pub(super) fn new(
        given: &'a [Camera],
        cameras: &'a [Camera],
        free: &'a [Freedom],
        observations: &'a [LightObservation],
    ) -> Self {
        let mut order: Vec<usize> = (0..observations.len()).collect();
        order.sort_by_key(|it| (observations[*it].frame, observations[*it].camera));
        let n_frames = observations.iter().map(|it| it.frame + 1).max().unwrap_or(0);
        let (mut of_camera, mut of_frame) = (vec![Vec::new(); cameras.len()], vec![Vec::new(); n_frames]);
        for index in order {
            of_camera[observations[index].camera].push(index);
            of_frame[observations[index].frame].push(index);
        }
        let priors = given.iter().map(OpticsPrior::of_guess).collect();
        Self { given, cameras, priors, free, observations, of_camera, of_frame }
    }

    /// Observations of both cameras in the frames that both see.
    fn common(&self, a: usize, b: usize) -> Vec<[usize; 2]> {
        let frame = |it: usize| self.observations[it].frame;
        let (mut in_a, mut in_b) = (self.of_camera[a].iter().peekable(), self.of_camera[b].iter().peekable());
        let mut both = Vec::new();
        while let (Some(&&x), Some(&&y)) = (in_a.peek(), in_b.peek()) {
            if frame(x) == frame(y) {
                both.push([x, y]);
            }
            if frame(x) <= frame(y) {
                in_a.next();
            }
            if frame(y) <= frame(x) {
                in_b.next();
            }
        }
        both
    }

    fn pixel(&self, observation: usize) -> Point2<f64> {
        self.observations[observation].pixel
    }

    /// Standard deviation of a camera's pixels across the line along which they spread most [px].
    fn spread_across(&self, camera: usize) -> f64 {
        let n = self.of_camera[camera].len() as f64;
        let pixels = || self.of_camera[camera].iter().map(|it| self.pixel(*it).coords);
        let centroid = pixels().fold(Vector2::zeros(), |sum, it| sum + it / n);
        let mut scatter = Matrix2::zeros();
        pixels().for_each(|it| scatter += (it - centroid) * (it - centroid).transpose() / n);
        scatter.symmetric_eigenvalues().min().max(0.0).sqrt()
    }
}

/// Orients each camera with those that it shares most frames with.
pub(super) fn orient(tracks: &Tracks<'_>, options: &SelfCalibrationOptions, random: &Random) -> Orientations {
    let n = tracks.cameras.len();
    let needed = options.min_common.max(6);
    let mut counts = vec![vec![0_usize; n]; n];
    for frame in &tracks.of_frame {
        for (index, first) in frame.iter().enumerate() {
            for second in &frame[index + 1..] {
                let [a, b] = [first, second].map(|it| tracks.observations[*it].camera);
                counts[a][b] += 1;
                counts[b][a] += 1;
            }
        }
    }
    let mut wanted = vec![vec![false; n]; n];
    for (camera, counts) in counts.iter().enumerate() {
        let mut partners: Vec<usize> = (0..n).filter(|it| counts[*it] >= needed).collect();
        partners.sort_by_key(|it| (std::cmp::Reverse(counts[*it]), *it));
        partners.truncate(options.max_partners);
        for partner in partners {
            wanted[camera.min(partner)][camera.max(partner)] = true;
        }
    }
    // Wrong optics bend the epipolar geometry by more than noise.
    let slack = |it: usize| if tracks.free[it].k1 { 3.0 } else { 1.0 + f64::from(u8::from(tracks.free[it].focal)) };
    let mut links: Vec<Oriented> = Vec::new();
    let mut best_fit = vec![None::<(usize, usize, usize)>; n];
    let mut shallow = vec![None::<usize>; n];
    for a in 0..n {
        for b in (a + 1..n).filter(|it| wanted[a][*it]) {
            let common = tracks.common(a, b);
            let pixels = [0, 1].map(|side| common.iter().map(|it| tracks.pixel(it[side])).collect::<Vec<_>>());
            let pair_options = EpipolarOptions {
                sigma_px: options.sigma_px,
                inlier_px: slack(a).max(slack(b)) * options.inlier_px,
                min_right: needed,
                ..EpipolarOptions::default()
            };
            let mut draws = random.fork(&format!("{a} {b}"));
            let pair = [&tracks.cameras[a], &tracks.cameras[b]];
            let found = relative_pose(pair, [&pixels[0], &pixels[1]], &pair_options, &mut draws);
            let mut note = |right: usize| {
                for (own, other) in [(a, b), (b, a)] {
                    if best_fit[own].is_none_or(|it| right > it.2) {
                        best_fit[own] = Some((other, common.len(), right));
                    }
                }
            };
            match found {
                Ok(found) => {
                    note(found.n_right);
                    let right = common.iter().zip(&found.points_in_a);
                    let right = right.filter(|(_, point)| point.is_some()).map(|(pair, _)| *pair).collect();
                    let (right_count, planar_share) = (found.n_right, found.planar_share);
                    let link = Link { a, b, common: common.len(), right: right_count, planar_share, consistent: false };
                    links.push(Oriented { link, b_from_a: found.b_from_a, right });
                }
                Err(EpipolarError::NoConsensus { agreeing, .. }) => note(agreeing),
                Err(EpipolarError::NoDepth { .. }) => {
                    shallow[a] = shallow[a].or(Some(b));
                    shallow[b] = shallow[b].or(Some(a));
                }
                Err(_) => note(0),
            }
        }
    }
    let status = (0..n).map(|camera| {
        let frames = tracks.of_camera[camera].len();
        let best = (0..n).filter(|it| counts[camera][*it] > 0).max_by_key(|it| (counts[camera][*it], n - it));
        let common = best.map_or(0, |it| counts[camera][it]);
        let spread_px = tracks.spread_across(camera);
        if links.iter().any(|it| it.link.a == camera || it.link.b == camera) {
            CameraStatus::Calibrated
        } else if frames < needed {
            CameraStatus::TooFewObservations { frames, needed }
        } else if spread_px < 3.0 * options.sigma_px {
            CameraStatus::LightStill { spread_px }
        } else if common < needed {
            CameraStatus::NoPartner { best, common, needed }
        } else if let Some(best) = shallow[camera] {
            CameraStatus::NoDepth { best }
        } else if let Some((best, common, right)) = best_fit[camera] {
            CameraStatus::Inconsistent { best, common, right }
        } else {
            CameraStatus::NoPartner { best, common, needed }
        }
    });
    Orientations { status: status.collect(), links }
}
