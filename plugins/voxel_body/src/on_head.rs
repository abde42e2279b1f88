//! Pictures of a camera on a head, each with the pose that it was taken from, and what is behind it.

use std::collections::VecDeque;
use std::sync::Arc;

use foveate::geometry::Camera;
use foveate::geometry::pan_tilt::Setting;
use foveate::prelude::*;

use crate::finder::Refusal;
use crate::panorama::Panorama;

/// Pictures that wait for their pose.
const HELD: usize = 64;
/// A pose is that of a picture when both are of the same time but for this [s].
const SAME_S: f64 = 1e-6;

/// A picture whose turn it is.
pub(crate) struct Turn {
    pub image: Stamped<Arc<Image>>,
    /// Whether it is one of the empty scene.
    pub is_empty: bool,
    /// Pose at capture; `None`: unknown.
    pub from: Option<From>,
}

/// From where a picture was taken.
pub(crate) struct From {
    pub pose: Arc<HeadPose>,
    pub camera: Camera,
    /// How well that is known [px].
    pub sigma_px: f64,
}

/// The camera on its head, and its background.
pub(crate) struct OnHead {
    head: CalibratedHead,
    distance: f64,
    panorama: Option<Panorama>,
    held: VecDeque<(bool, Stamped<Arc<Image>>)>,
    poses: VecDeque<Arc<HeadPose>>,
    pub n_learnt: u32,
}

impl OnHead {
    /// The background is about `distance` away [m].
    pub fn new(head: CalibratedHead, distance: f64) -> Self {
        Self { head, distance, panorama: None, held: VecDeque::new(), poses: VecDeque::new(), n_learnt: 0 }
    }

    /// The head stood there.
    pub fn pose(&mut self, pose: Arc<HeadPose>) {
        if self.poses.len() == HELD {
            self.poses.pop_front();
        }
        self.poses.push_back(pose);
    }

    /// A picture came; `is_empty`: of the empty scene.
    pub fn hold(&mut self, image: Stamped<Arc<Image>>, is_empty: bool) {
        self.held.push_back((is_empty, image));
    }

    /// The next picture whose pose has come, or will not come any more.
    pub fn next(&mut self) -> Option<Turn> {
        let time = self.held.front()?.1.time();
        let pose = self.poses.iter().find(|it| (it.time - time).abs().as_s() < SAME_S);
        let is_late = self.poses.back().is_some_and(|it| it.time > time) || self.held.len() > HELD;
        if pose.is_none() && !is_late {
            return None;
        }
        let from = pose.map(|it| {
            let [pan, tilt] = it.angles;
            let camera = self.head.model.camera_at(&Setting { pan, tilt, zoom: it.zoom });
            let sigma = (it.angles_covariance.trace() / 2.0).max(0.0).sqrt();
            let sigma_px = sigma * camera.intrinsics.focal[0];
            From { pose: Arc::clone(it), camera, sigma_px }
        });
        let (is_empty, image) = self.held.pop_front()?;
        Some(Turn { image, is_empty, from })
    }

    /// The background of pictures like this one.
    ///
    /// # Errors
    /// A part of a picture: of a camera that turns only whole ones serve. Another size or kind than the first.
    pub fn panorama(&mut self, image: &Image) -> Result<&mut Panorama, Refusal> {
        if image.window != foveate::messages::Window::default() {
            return Err(Refusal::OtherPart { expected: foveate::messages::Window::default(), found: image.window });
        }
        let expected = self.head.model.at_rest.image_size;
        let found = [image.width, image.height];
        if found != expected {
            return Err(Refusal::WrongSize { expected, found });
        }
        let (size, channels) = (found.map(|it| it as usize), image.format.channels());
        let panorama = match self.panorama.take() {
            Some(panorama) if panorama.shape() != (size, channels) => {
                let kind = |channels: usize| if channels == 1 { "gray" } else { "in colour" };
                let expected = kind(panorama.shape().1);
                self.panorama = Some(panorama);
                return Err(Refusal::OtherKind { expected, found: kind(channels) });
            }
            Some(panorama) => panorama,
            None => Panorama::new(size, channels, self.distance)?,
        };
        Ok(self.panorama.insert(panorama))
    }

    /// Views of the background that are kept.
    pub fn n_views(&self) -> usize {
        self.panorama.as_ref().map_or(0, Panorama::n_views)
    }
}
