//! Which pattern each picture of a recording shows, where no projector reports it.

use std::fmt::Display;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use foveate::imaging::stripes::boundary::FRAMES;
use foveate::prelude::*;

use super::BoundariesSettings;
use crate::pattern::{Code, MANIFEST, PatternSettings};

/// Patterns in their order, one to a picture.
pub(super) struct Recorded {
    /// The patterns, as a projector would say them.
    manifest: String,
    /// The pattern that a picture of sequence number 0 is said to show, 0 to 3.
    first: u64,
}

impl Recorded {
    /// As the settings and the file that they name say, for a projector of so many columns and rows.
    pub(super) fn new(
        settings: &BoundariesSettings,
        projector: [u32; 2],
        setup: &Setup,
    ) -> Result<Recorded, ConfigError> {
        let pattern = match &settings.patterns {
            Some(text) => written(settings, &setup.path("patterns", text)?)?,
            None => {
                // Whatever it is taken to be, the codes fit: a wrong width makes a surface at another distance.
                let stripe_px = settings.stripe_px.ok_or_else(|| {
                    let message = "found none, nothing connected to `shown`, and no `patterns`, expected the width of the recording's stripes in pixels of the projector, or the `patterns.toml` that states it";
                    ConfigError::at("stripe_px", message)
                })?;
                PatternSettings {
                    code: Code::Boundary,
                    order: settings.stripes.clone().unwrap_or_else(|| "columns".to_owned()),
                    stripe_px,
                    ..PatternSettings::default()
                }
            }
        };
        pattern.stripe_code(Some(projector)).map_err(|it| match &settings.patterns {
            Some(text) => ConfigError::at("patterns", format!("`{text}`: {}", it.message)),
            None => it,
        })?;
        let manifest = toml::to_string(&PatternSettings { projector_px: projector, ..pattern });
        let manifest = manifest.map_err(ConfigError::node)?;
        Ok(Recorded { manifest, first: u64::from(settings.first_shows.unwrap_or(0)) })
    }

    /// What a picture should show. Missing numbers are missing pictures.
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

/// The patterns that a file says, which the settings may state as well and not otherwise.
fn written(settings: &BoundariesSettings, path: &Path) -> Result<PatternSettings, ConfigError> {
    let file = if path.is_dir() { path.join(MANIFEST) } else { path.to_owned() };
    let name = file.display();
    let text = fs::read_to_string(&file)
        .map_err(|error| ConfigError::at("patterns", format!("`{name}` cannot be read: {error}")))?;
    let pattern = PatternSettings::read(&text)
        .map_err(|fault| ConfigError::at("patterns", format!("`{name}`: {}", fault.trim_end())))?;
    if pattern.code != Code::Boundary {
        let message = format!(
            "`{name}` is of a static code, expected `code = \"boundary\"`: `structured_light.decoder` reads its pictures"
        );
        return Err(ConfigError::at("patterns", message));
    }
    let other = |setting: &str, stated: &dyn Display, found: &dyn Display| {
        ConfigError::at(setting, format!("found {stated}, expected {found} as `{name}` says, or nothing"))
    };
    if let Some(it) = settings.stripe_px.filter(|it| *it != pattern.stripe_px) {
        return Err(other("stripe_px", &it, &pattern.stripe_px));
    }
    let first = pattern.order.split_whitespace().find(|it| ["columns", "rows"].contains(it)).unwrap_or("columns");
    if let Some(it) = settings.stripes.as_ref().filter(|it| *it != first) {
        return Err(other("stripes", it, &first));
    }
    Ok(pattern)
}
