//! Which pattern each picture of a recording shows, where no projector says it.

use std::sync::Arc;

use foveate::imaging::stripes::boundary::FRAMES;
use foveate::prelude::*;

use super::BoundariesSettings;
use crate::pattern::{Code, PatternSettings};

/// Patterns in their order, one to a picture.
pub(super) struct Recorded {
    /// The patterns, as a projector would say them.
    manifest: String,
    /// The pattern that a picture of sequence number 0 is said to show, 0 to 3.
    first: u64,
}

impl Recorded {
    /// As the settings say, for a projector of so many columns and rows.
    pub(super) fn new(settings: &BoundariesSettings, projector: [u32; 2]) -> Result<Recorded, ConfigError> {
        // Whatever it is taken to be, the codes fit: a wrong width makes a surface at another distance.
        let stripe_px = settings.stripe_px.ok_or_else(|| {
            let message = "found none, and nothing connected to `shown`, expected the width of the recording's stripes in pixels of the projector, which its pictures do not tell";
            ConfigError::at("stripe_px", message)
        })?;
        let pattern = PatternSettings {
            projector_px: projector,
            code: Code::Boundary,
            order: settings.stripes.clone(),
            stripe_px,
            ..PatternSettings::default()
        };
        pattern.stripe_code(None)?;
        let manifest = toml::to_string(&pattern).map_err(ConfigError::node)?;
        Ok(Recorded { manifest, first: u64::from(settings.first_shows.unwrap_or(0)) })
    }

    /// What a picture is said to show. Numbers that lack are of pictures that lack.
    pub(super) fn shown(&self, stamp: &Stamp) -> Arc<PatternShown> {
        Arc::new(PatternShown {
            index: ((self.first + stamp.sequence) % FRAMES as u64) as u32,
            count: FRAMES as u32,
            from: stamp.time,
            manifest: self.manifest.clone(),
            ..PatternShown::default()
        })
    }
}
