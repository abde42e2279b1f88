//! What viewers draw of a session: channels beside those of the messages themselves, at most thirty times a second each.
//!
//! | of ours | topic | schema |
//! |---|---|---|
//! | targets, marks, clouds, tracked surfaces | the message's own and `/points` | `foxglove.PointCloud` |
//! | targets, marks | `/poses` | `foxglove.PosesInFrame` |
//! | targets, marks, meshes, skeletons | `/scene` | `foxglove.SceneUpdate` |
//! | features | `/annotations` | `foxglove.ImageAnnotations` |
//! | cameras, heads, scales | `/tf` | `foxglove.FrameTransforms` |
//! | lenses | `/cameras/NAME` | `foxglove.CameraCalibration` |
//! | failures and gaps | `/log` | `foxglove.Log` |
//! | rates of edges, figures of nodes | `/figures` | `foveate.Figures` |
//!
//! Frames are called as scales and cameras are.

use std::any::Any;
use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use foveate_messages::{
    Features, HeadPose, Marks, Mesh, PointCloud, ScaleCloud, ScaleSpace, Skeletons, Targets, Time, TrackedSurface,
    Window,
};
use foveate_node::io::Packet;
use foveate_rig::graph::Graph;

use crate::file::{Channel, SessionFile};
use crate::names::topic;
use crate::viewer::{self, CameraModel, Kind, LogLevel, Schema, Transform};

/// Shortest time between two messages of a topic [ns].
const PERIOD_NS: i64 = 33_000_000;
/// What does not move is written again after so long, so that a viewer may begin anywhere [ns].
const STILL_NS: i64 = 1_000_000_000;

type Encode<'m> = &'m dyn Fn(&mut Vec<u8>);

/// Writes what viewers draw.
pub struct Shown {
    graph: Arc<Graph>,
    channels: HashMap<String, Channel>,
    /// By topic: time of the last message [ns].
    last: HashMap<String, i64>,
    still_at: Option<i64>,
    bytes: Vec<u8>,
}

impl Shown {
    /// For a session of a run of `graph`.
    pub fn new(graph: Arc<Graph>) -> Shown {
        Shown { graph, channels: HashMap::new(), last: HashMap::new(), still_at: None, bytes: Vec::new() }
    }

    /// Writes what viewers draw of a message.
    ///
    /// # Errors
    /// Why it cannot be written.
    pub fn message(
        &mut self,
        file: &mut SessionFile,
        (instance, port): (usize, usize),
        packet: &Packet,
        now: i64,
    ) -> Result<(), String> {
        self.still(file, now)?;
        let graph = Arc::clone(&self.graph);
        let node = &graph.instances[instance];
        let own = topic(&node.path, node.node_type.ports.outputs[port].name);
        let (scale, world) = (graph.scales[node.scale].name.as_str(), self.world(node.scale));
        let payload: &dyn Any = &*packet.payload;
        let mut put = |kind: Kind, suffix: &str, encode: Encode<'_>| {
            self.put(file, kind, &format!("{own}/{suffix}"), now, PERIOD_NS, encode)
        };
        if let Some(it) = payload.downcast_ref::<Targets>() {
            put(Kind::PointCloud, "points", &|out| viewer::targets_cloud(it, scale, out))?;
            put(Kind::PosesInFrame, "poses", &|out| viewer::targets_poses(it, scale, out))?;
            put(Kind::SceneUpdate, "scene", &|out| viewer::targets_scene(it, scale, &own, out))
        } else if let Some(it) = payload.downcast_ref::<Marks>() {
            put(Kind::PointCloud, "points", &|out| viewer::marks_cloud(it, &world, out))?;
            put(Kind::PosesInFrame, "poses", &|out| viewer::marks_poses(it, &world, out))?;
            put(Kind::SceneUpdate, "scene", &|out| viewer::marks_scene(it, &world, &own, out))
        } else if let Some(it) = payload.downcast_ref::<Features>() {
            let time = packet.stamp.time;
            put(Kind::ImageAnnotations, "annotations", &|out| viewer::features(time, it, &Window::default(), out))
        } else if let Some(it) = payload.downcast_ref::<PointCloud>() {
            put(Kind::PointCloud, "points", &|out| viewer::cloud(it, &world, out))
        } else if let Some(it) = payload.downcast_ref::<ScaleCloud>() {
            put(Kind::PointCloud, "points", &|out| viewer::scale_cloud(it, &world, out))
        } else if let Some(it) = payload.downcast_ref::<TrackedSurface>() {
            put(Kind::PointCloud, "points", &|out| viewer::tracked_cloud(it, &world, out))
        } else if let Some(it) = payload.downcast_ref::<Mesh>() {
            put(Kind::SceneUpdate, "scene", &|out| viewer::mesh(it, &world, &own, out))
        } else if let Some(it) = payload.downcast_ref::<Skeletons>() {
            put(Kind::SceneUpdate, "scene", &|out| viewer::skeletons(it, scale, &own, out))
        } else if let Some(it) = payload.downcast_ref::<HeadPose>() {
            let camera = graph.calibration.cameras.get(usize::from(it.camera.0));
            let camera = camera.map_or("camera", |it| it.name.as_str());
            self.put(file, Kind::FrameTransforms, "/tf", now, 0, &|out| viewer::head_pose(it, &world, camera, out))
        } else if let Some(it) = payload.downcast_ref::<ScaleSpace>() {
            let place = graph.places.get(it.scale.0 as usize);
            let Some((place, parent)) = place.and_then(|it| Some((it, graph.places.get(it.parent?.0 as usize)?)))
            else {
                return Ok(());
            };
            let encode = |out: &mut Vec<u8>| viewer::scale_space(it, &parent.name, &place.name, out);
            self.put(file, Kind::FrameTransforms, "/tf", now, 0, &encode)
        } else {
            Ok(())
        }
    }

    /// A line of the log.
    ///
    /// # Errors
    /// Why it cannot be written.
    pub fn log(
        &mut self,
        file: &mut SessionFile,
        now: i64,
        level: LogLevel,
        name: &str,
        line: &str,
    ) -> Result<(), String> {
        self.put(file, Kind::Log, "/log", now, 0, &|out| viewer::log_line(Time(now), level, name, line, out))
    }

    /// Figures at one time.
    ///
    /// # Errors
    /// Why they cannot be written.
    pub fn figures(&mut self, file: &mut SessionFile, now: i64, list: &[(String, f64)]) -> Result<(), String> {
        let figures = |out: &mut Vec<u8>| viewer::figures(Time(now), list.iter().map(|it| (it.0.as_str(), it.1)), out);
        self.put(file, Kind::Figures, "/figures", now, 0, &figures)
    }

    /// The outermost scale around one.
    fn world(&self, scale: usize) -> String {
        let mut place = &self.graph.places[scale];
        while let Some(parent) = place.parent.and_then(|it| self.graph.places.get(it.0 as usize)) {
            place = parent;
        }
        place.name.clone()
    }

    /// Cameras that stand still, their lenses, and scales that do not move.
    fn still(&mut self, file: &mut SessionFile, now: i64) -> Result<(), String> {
        if self.still_at.is_some_and(|it| now < it + STILL_NS) {
            return Ok(());
        }
        let is_first = self.still_at.is_none();
        self.still_at = Some(now);
        let graph = Arc::clone(&self.graph);
        let Some(world) = graph.places.first().map(|it| it.name.clone()) else { return Ok(()) };
        let cameras = graph.calibration.cameras.iter().filter(|it| graph.calibration.head(&it.name).is_none());
        let cameras = cameras.map(|it| Transform {
            parent: &world,
            child: &it.name,
            parent_from_child: it.camera.camera_from_world.inverse(),
        });
        let scales = graph.places.iter().filter(|it| !it.is_anchored).filter_map(|it| {
            let parent = graph.places.get(it.parent?.0 as usize)?;
            Some(Transform {
                parent: &parent.name,
                child: &it.name,
                parent_from_child: nalgebra::Isometry3::identity(),
            })
        });
        let all: Vec<Transform<'_>> = cameras.chain(scales).collect();
        if !all.is_empty() {
            let encode = |out: &mut Vec<u8>| {
                let all = all.iter().map(|it| Transform {
                    parent: it.parent,
                    child: it.child,
                    parent_from_child: it.parent_from_child,
                });
                viewer::transforms(Time(now), all, out);
            };
            self.put(file, Kind::FrameTransforms, "/tf", now, 0, &encode)?;
        }
        for it in graph.calibration.cameras.iter().filter(|_| is_first) {
            let lens = CameraModel {
                size: it.camera.image_size,
                focal: it.camera.intrinsics.focal,
                principal: it.camera.intrinsics.principal,
                skew: it.camera.intrinsics.skew,
                distortion: {
                    let lens = it.camera.distortion;
                    [lens.k1, lens.k2, lens.p1, lens.p2, lens.k3]
                },
            };
            let own = format!("/cameras/{}", it.name);
            self.put(file, Kind::CameraCalibration, &own, now, 0, &|out| {
                viewer::camera_calibration(Time(now), &lens, &it.name, out);
            })?;
        }
        Ok(())
    }

    fn put(
        &mut self,
        file: &mut SessionFile,
        kind: Kind,
        topic: &str,
        now: i64,
        period: i64,
        encode: Encode<'_>,
    ) -> Result<(), String> {
        if let Some(last) = self.last.get_mut(topic) {
            if now < *last + period {
                return Ok(());
            }
            *last = now;
        } else {
            self.last.insert(topic.to_owned(), now);
        }
        let channel = match self.channels.get(topic) {
            Some(channel) => *channel,
            None => {
                let Schema { name, descriptor } = kind.schema();
                let schema = (name, Schema::ENCODING, descriptor.as_slice());
                let channel = file.channel(topic, Schema::ENCODING, Some(schema), &BTreeMap::new())?;
                self.channels.insert(topic.to_owned(), channel);
                channel
            }
        };
        self.bytes.clear();
        encode(&mut self.bytes);
        file.message(channel, now, now, &self.bytes)
    }
}
