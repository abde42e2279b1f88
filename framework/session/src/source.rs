//! `capture.session`: the pictures of a camera, or what was found in them, out of a session.

use std::collections::{BTreeMap, HashMap};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, Weak};

use foveate_messages::{CameraId, Features, Image, Message};
use foveate_node::error::{ConfigError, NodeError};
use foveate_node::io::Io;
use foveate_node::node::{Due, Node, Plan, Role};
use foveate_node::port::{MessageType, Ports};
use foveate_node::registry::Registry;
use foveate_node::setup::{Purpose, Setup};
use foveate_rig::graph::Graph;
pub use mcap::records::Channel;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::reading::{Item, Reading};
use crate::session::Session;

foveate_node::ports! {
    IMAGE: Out<Image> = "image";
    FEATURES: Out<Features> = "features";
}

/// Settings of [`SessionSource`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SessionSourceSettings {
    /// The session (MCAP); `${NAME}` is an environment variable [–]
    pub path: String,
    /// Topic of the pictures, where the session has several of this camera: `/room/video/{camera}/image` [–]
    #[serde(default)]
    pub images: Option<String>,
    /// Topic of the features, where the session has several of this camera: `/room/leds/{camera}/features` [–]
    #[serde(default)]
    pub features: Option<String>,
}

/// Gives out the pictures of its camera, and the features that were found in them, when they came then.
pub struct SessionSource {
    reading: Arc<Mutex<Reading>>,
    line: usize,
    camera: CameraId,
}

/// Sessions that are open, by path: the cameras of a rig read theirs together.
type Open = Arc<Mutex<HashMap<PathBuf, Weak<Mutex<Reading>>>>>;

/// Adds the node to a registry.
pub fn register(registry: &mut Registry) {
    let open = Open::default();
    registry.add_with::<SessionSource>(move |settings, setup| SessionSource::open(&settings, setup, &open));
}

impl SessionSource {
    fn open(settings: &SessionSourceSettings, setup: &Setup, open: &Open) -> Result<SessionSource, ConfigError> {
        let Some(camera) = setup.camera else {
            return Err(ConfigError::at("path", "found no camera, expected `each` or `camera` at this node"));
        };
        let name = setup.camera_name().unwrap_or_default();
        let path = setup.path("path", &settings.path)?;
        let mut open = open.lock().unwrap_or_else(PoisonError::into_inner);
        let reading = match open.get(&path).and_then(Weak::upgrade) {
            Some(reading) => reading,
            None => {
                let session = Session::open(&path).map_err(|sentence| ConfigError::at("path", sentence))?;
                let reading = Arc::new(Mutex::new(Reading::new(session)));
                open.insert(path, Arc::downgrade(&reading));
                reading
            }
        };
        let line = {
            let mut reading = reading.lock().unwrap_or_else(PoisonError::into_inner);
            let line = reading.line();
            let images = play::<Image>(&mut reading, (line, 0), ("images", &settings.images), name)?;
            let features = play::<Features>(&mut reading, (line, 1), ("features", &settings.features), name)?;
            if !images && !features {
                let known = cameras(reading.session()).join(", ");
                let message =
                    format!("found neither pictures nor features of camera `{name}`; it has those of {known}");
                return Err(ConfigError::at("path", message));
            }
            line
        };
        Ok(SessionSource { reading, line, camera })
    }
}

/// Sentences about what nodes of `graph` want of sessions that do not have it.
pub fn lacking(graph: &Graph) -> Vec<String> {
    let mut sessions: HashMap<PathBuf, Option<Session>> = HashMap::new();
    // By session and kind of message: cameras.
    let mut lacking: BTreeMap<(PathBuf, &str), Vec<String>> = BTreeMap::new();
    for (index, instance) in graph.instances.iter().enumerate() {
        let Some(settings) = instance.settings.as_any().downcast_ref::<SessionSourceSettings>() else { continue };
        let setup = graph.setup(index, None, Purpose::Check);
        let (Ok(path), Some(camera)) = (setup.path("path", &settings.path), setup.camera_name()) else { continue };
        let session = sessions.entry(path.clone()).or_insert_with(|| Session::open(&path).ok());
        let Some(session) = session else { continue };
        for (port, output) in instance.node_type.ports.outputs.iter().enumerate() {
            let message = output.message.name;
            let mut channels = session.summary.channels.values();
            let is_there = channels.any(|it| fact(it, "message") == message && camera_of(it) == Some(camera));
            if !is_there && graph.edges.iter().any(|it| it.from == (index, port)) {
                let kind = if message == Image::NAME { "pictures" } else { message };
                lacking.entry((path.clone(), kind)).or_default().push(camera.to_owned());
            }
        }
    }
    let sentence = |((path, kind), cameras): ((PathBuf, &str), Vec<String>)| {
        let (path, cameras) = (path.display(), cameras.join(", "));
        format!(
            "`{path}` has no {kind} of {cameras}, which nodes of this rig take; `foveate info {path}` lists what it has"
        )
    };
    lacking.into_iter().map(sentence).collect()
}

/// Plays the one topic of that camera with messages of type `M`, or the one that `setting` names; whether there is one.
fn play<M: Message>(
    reading: &mut Reading,
    (line, port): (usize, usize),
    (setting, named): (&str, &Option<String>),
    camera: &str,
) -> Result<bool, ConfigError> {
    let refused = |message: String| ConfigError::at(setting, message);
    let channels = reading.session().summary.channels.values();
    let of_camera = channels.filter(|it| fact(it, "message") == M::NAME && camera_of(it) == Some(camera));
    let topics: Vec<String> = of_camera.map(|it| it.topic.clone()).collect();
    let topic = match (named, &topics[..]) {
        (Some(topic), _) => topic.replace("{camera}", camera),
        (None, []) => return Ok(false),
        (None, [one]) => one.clone(),
        (None, several) => {
            return Err(refused(format!("found {} of camera `{camera}`, expected one of them", several.join(", "))));
        }
    };
    if !topics.contains(&topic) {
        let known = if topics.is_empty() { "none".to_owned() } else { topics.join(", ") };
        return Err(refused(format!("found `{topic}`, expected a topic of camera `{camera}`: {known}")));
    }
    reading.play(line, port, &topic, MessageType::of::<M>(), None).map_err(refused)?;
    Ok(true)
}

/// A fact that a channel states of itself; empty where it does not.
pub fn fact<'c>(channel: &'c Channel, name: &str) -> &'c str {
    channel.metadata.get(name).map_or("", String::as_str)
}

/// The camera of a channel: what stands in brackets in the name of its node.
pub fn camera_of(channel: &Channel) -> Option<&str> {
    fact(channel, "instance").split_once('[')?.1.strip_suffix(']')
}

fn cameras(session: &Session) -> Vec<String> {
    let wanted = |it: &&Channel| [Image::NAME, Features::NAME].contains(&fact(it, "message"));
    let mut names: Vec<String> =
        session.summary.channels.values().filter(wanted).filter_map(camera_of).map(str::to_owned).collect();
    names.sort();
    names.dedup();
    names
}

impl Node for SessionSource {
    const TYPE: &'static str = "capture.session";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Pictures and features of a recorded session, for any rig with the same cameras";
    type Settings = SessionSourceSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SessionSourceSettings, setup: &Setup) -> Result<Self, ConfigError> {
        SessionSource::open(&settings, setup, &Open::default())
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let mut reading = self.reading.lock().unwrap_or_else(PoisonError::into_inner);
        while let Some((now, item)) = reading.take(self.line, io.now()) {
            let Item::Message(channel, bytes) = item else { continue };
            let failed = |what: String| NodeError::input(format_args!("at {now}: {what}"));
            if let Ok((stamp, image)) = reading.decode_picture(channel, &bytes) {
                io.emit_numbered(&IMAGE, stamp.time, stamp.sequence, Image { camera: self.camera, ..image });
                continue;
            }
            let (_, packet) = reading.decode(channel, &bytes).map_err(failed)?;
            let Some(features) = packet.as_typed::<Features>() else { continue };
            let stamp = packet.stamp;
            let features = Features { camera: self.camera, ..features.clone() };
            io.emit_numbered(&FEATURES, stamp.time, stamp.sequence, features);
        }
        reading.failure()
    }

    fn due(&mut self) -> Due {
        self.reading.lock().unwrap_or_else(PoisonError::into_inner).due(self.line)
    }

    fn plan(_settings: &SessionSourceSettings) -> Plan {
        Plan::default()
    }
}
