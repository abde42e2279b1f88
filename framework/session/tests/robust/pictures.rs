//! Pictures that several threads encode stand in a session in their order.

use std::path::Path;
use std::sync::Arc;

use foveate_engine::{self as engine, Options};
use foveate_messages::{Image, Time};
use foveate_node::{ConfigError, Due, Host, In, Io, Node, NodeError, Out, Ports, Registry, Role, Setup};
use foveate_rig::Overrides;
use foveate_session::{Packing, Pictures, Recorder, Recording, Session, picture};

use crate::parts::{Nothing, Read, messages, recording};

const N_PICTURES: u64 = 100;
const GIVEN: Out<Image> = Out::new(0, "image");
const SEEN: In<Image> = In::each(0, "image");

struct Lamp(u64);

impl Node for Lamp {
    const TYPE: &'static str = "test.lamp";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Pictures of several sizes, each brighter than the one before.";
    type Settings = Nothing;

    fn ports() -> Ports {
        Ports::new().output(&GIVEN)
    }
    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Self(0))
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let width = 8 + 300 * (self.0 as u32 % 3);
        let pixels = vec![2 * self.0 as u8; width as usize * 64];
        io.emit_at(&GIVEN, io.now(), Image { width, height: 64, pixels, ..Image::default() });
        self.0 += 1;
        Ok(())
    }
    fn due(&mut self) -> Due {
        if self.0 < N_PICTURES { Due::At(Time(self.0 as i64 * 1_000_000)) } else { Due::Never }
    }
}

struct Look;

impl Node for Look {
    const TYPE: &'static str = "test.look";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Takes pictures.";
    type Settings = Nothing;

    fn ports() -> Ports {
        Ports::new().input(&SEEN)
    }
    fn new(_: Nothing, _: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }
    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let _ = io.take(&SEEN);
        Ok(())
    }
}

/// The messages with pictures of a run that is recorded as JPEG.
fn recorded(path: &Path) -> Vec<Read> {
    let text = "[rig]\nname = \"lamp\"\n[scale.room.node.a]\ntype = \"test.lamp\"\n\
                [scale.room.node.b]\ntype = \"test.look\"\nin.image = \"a.image\"\n";
    let mut registry = Registry::new();
    registry.add::<Lamp>();
    registry.add::<Look>();
    let graph = match foveate_rig::load(text, Path::new("lamp.toml"), &registry, &Overrides::default()) {
        Ok(graph) => Arc::new(graph),
        Err(faults) => panic!("{}", faults.render(false)),
    };
    let jpeg = Recording { pictures: Pictures::Jpeg(90), ..recording(path, Packing::None) };
    let recorder = Recorder::begin(&graph, &jpeg, Host::default()).unwrap();
    let options = Options { tap: Some(recorder.tap()), ..Options::default() };
    engine::deterministic(graph, &options, &mut |_| {}).unwrap();
    assert_eq!(recorder.finish().failure, None);
    let mut all = messages(&mut Session::open(path).unwrap()).unwrap();
    all.retain(|it| it.0.ends_with("/image"));
    all
}

#[test]
fn pictures_are_in_order_and_the_same_each_time() {
    let folder = tempfile::tempdir().unwrap();
    let first = recorded(&folder.path().join("1.mcap"));
    let seen = first.iter().map(|(_, time, bytes)| {
        let (stamp, image) = picture::read("foxglove.CompressedImage", bytes).unwrap();
        (*time, stamp.time, image.pixels[0])
    });
    let given = (0..N_PICTURES).map(|n| (n * 1_000_000, Time(n as i64 * 1_000_000), 2 * n as u8));
    assert!(seen.eq(given), "in another order");
    assert!(recorded(&folder.path().join("2.mcap")) == first);
}
