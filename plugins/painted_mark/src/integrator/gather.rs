//! Gathers the cameras' features and poses of one moment.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use foveate::geometry::pan_tilt::Setting;
use foveate::geometry::{Camera, Viewpoint};
use foveate::prelude::*;
use foveate::scene::CalibratedHead;
use nalgebra::Matrix6;

/// Pictures and poses with a smaller time difference are of one moment [s].
const SAME_S: f64 = 5e-4;
/// Poses that are kept of each head.
const POSES: usize = 16;
/// Sets that wait for poses; beyond that the oldest is used without missing ones.
const MOST_WAITING: usize = 3;

/// One camera at one moment.
pub(super) struct View {
    pub id: CameraId,
    pub viewpoint: Viewpoint,
    pub features: Arc<Features>,
}

/// All cameras at one moment.
pub(super) struct Frame {
    pub time: Time,
    pub views: Vec<View>,
}

/// A set of features of one moment.
struct Set {
    time: Time,
    features: Vec<Stamped<Arc<Features>>>,
}

/// Holds sets until their poses have come.
#[derive(Default)]
pub(super) struct Gather {
    /// As calibrated; for cameras on heads: at rest.
    cameras: BTreeMap<CameraId, (Camera, Option<CalibratedHead>)>,
    poses: BTreeMap<CameraId, VecDeque<Arc<HeadPose>>>,
    waiting: VecDeque<Set>,
    /// Pictures of cameras on heads without a pose.
    pub without_pose: u64,
}

impl Gather {
    pub fn new(setup: &Setup) -> Gather {
        let cameras = setup.calibration.cameras.iter().zip(0..);
        let known =
            cameras.map(|(it, number)| (CameraId(number), (it.camera.clone(), setup.head_of(CameraId(number)))));
        Gather { cameras: known.collect(), ..Gather::default() }
    }

    pub fn pose(&mut self, pose: Arc<HeadPose>) {
        let poses = self.poses.entry(pose.camera).or_default();
        if poses.len() == POSES {
            poses.pop_front();
        }
        poses.push_back(pose);
    }

    pub fn set(&mut self, features: Vec<Stamped<Arc<Features>>>) {
        if let Some(time) = features.iter().map(Stamped::time).min() {
            self.waiting.push_back(Set { time, features });
        }
    }

    /// The next complete moment.
    pub fn next(&mut self) -> Option<Frame> {
        let set = self.waiting.front()?;
        let is_open = |it: &Stamped<Arc<Features>>| {
            let on_head = self.cameras.get(&it.value.camera).is_some_and(|(_, head)| head.is_some());
            let newest = self.poses.get(&it.value.camera).and_then(|poses| Some(poses.back()?.time));
            on_head && newest.is_none_or(|newest| (it.time() - newest).as_s() > SAME_S)
        };
        if self.waiting.len() < MOST_WAITING && set.features.iter().any(is_open) {
            return None;
        }
        let Set { time, features } = self.waiting.pop_front()?;
        let mut views = Vec::with_capacity(features.len());
        for it in features {
            match self.viewpoint(it.value.camera, it.time()) {
                Some(viewpoint) => views.push(View { id: it.value.camera, viewpoint, features: it.value }),
                None => self.without_pose += 1,
            }
        }
        views.sort_by_key(|it| it.id);
        Some(Frame { time, views })
    }

    fn viewpoint(&self, id: CameraId, time: Time) -> Option<Viewpoint> {
        let (camera, head) = self.cameras.get(&id)?;
        let Some(head) = head else {
            return Some(Viewpoint { camera: camera.clone(), covariance: Matrix6::zeros() });
        };
        let poses = self.poses.get(&id)?;
        let pose = poses.iter().rev().find(|it| (it.time - time).abs().as_s() <= SAME_S)?;
        let [pan, tilt] = pose.angles;
        let turned = head.model.camera_at(&Setting { pan, tilt, zoom: pose.zoom });
        let camera = Camera { camera_from_world: pose.camera_from_world, ..turned };
        Some(Viewpoint { camera, covariance: pose.covariance })
    }
}
