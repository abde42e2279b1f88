//! Blobs of any size, given and passed on without a copy or an allocation: for measuring what the engine itself costs.

use foveate_messages::{Message, Space, Wire};
use foveate_node::{ConfigError, Due, In, Io, Node, NodeError, Out, Pool, Ports, Role, Setup, Time};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Bytes of no meaning, of no space.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Blob(pub Vec<u8>);

impl Message for Blob {
    const NAME: &'static str = "blob";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::Local;
}

/// Settings of [`BlobSource`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BlobSourceSettings {
    /// How many blobs, one each microsecond [–].
    pub count: u64,
    /// Size of each [bytes].
    pub size: usize,
}

impl Default for BlobSourceSettings {
    fn default() -> Self {
        Self { count: 10, size: 64 }
    }
}

/// Settings of [`Pass`]: none.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PassSettings {}

const BLOBS: In<Blob> = In::each(0, "blob").many();
const BACK: In<Blob> = In::latest(1, "back").optional();
const GIVEN: Out<Blob> = Out::new(0, "blob");

/// Gives pooled blobs.
pub struct BlobSource {
    settings: BlobSourceSettings,
    given: u64,
    pool: Pool<Blob>,
}

impl BlobSource {
    fn time(&self) -> Time {
        Time(self.given as i64 * 1000)
    }
}

impl Node for BlobSource {
    const TYPE: &'static str = "testkit.blob_source";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "Gives blobs.";
    type Settings = BlobSourceSettings;

    fn ports() -> Ports {
        Ports::new().output(&GIVEN)
    }

    fn new(settings: BlobSourceSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self { settings, given: 0, pool: Pool::default() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let size = self.settings.size;
        let blob = self.pool.take(|| Blob(vec![7; size]));
        let blob = self.pool.share(blob);
        io.emit_at(&GIVEN, self.time(), blob);
        self.given += 1;
        Ok(())
    }

    fn due(&mut self) -> Due {
        if self.given < self.settings.count { Due::At(self.time()) } else { Due::Never }
    }
}

/// Passes blobs on; its `latest` input may close a cycle.
pub struct Pass;

impl Node for Pass {
    const TYPE: &'static str = "testkit.pass";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Passes blobs on.";
    type Settings = PassSettings;

    fn ports() -> Ports {
        Ports::new().input(&BLOBS).input(&BACK).output(&GIVEN)
    }

    fn new(_settings: PassSettings, _setup: &Setup) -> Result<Self, ConfigError> {
        Ok(Self)
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(blob) = io.take(&BLOBS) {
            io.emit(&GIVEN, blob.stamp, blob.value);
        }
        Ok(())
    }
}
