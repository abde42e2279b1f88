//! The variants of the tracker that are compared, each as it would stand in a rig.

use foveate_led::tracker::IntegratorSettings;

/// Name, settings that differ from the default.
pub const VARIANTS: &[(&str, &str)] = &[
    ("default", ""),
    ("nearest", "association = \"nearest\""),
    ("hypotheses", "association = \"hypotheses\""),
    ("steady noise", "adapt_noise = false"),
    ("constant acceleration", "motion = \"constant_acceleration\""),
    ("interacting", "motion = \"interacting\""),
    ("no remembering", "remember_ms = 0.0"),
    ("remember 2 s", "remember_ms = 2000.0"),
    ("all of it", "association = \"hypotheses\"\nmotion = \"interacting\"\nremember_ms = 2000.0"),
];

/// The settings of `text`; why not where the tracker does not know them.
pub fn settings(text: &str) -> Result<IntegratorSettings, String> {
    let settings: IntegratorSettings = toml::from_str(text).map_err(|error| error.message().to_owned())?;
    settings.check().map_err(|error| error.to_string())?;
    Ok(settings)
}

/// Those of `variants` that this tracker knows; says which ones it does not.
pub fn available(variants: &[(&'static str, &str)]) -> Vec<(&'static str, IntegratorSettings)> {
    let mut known = Vec::new();
    for (name, text) in variants {
        match settings(text) {
            Ok(settings) => known.push((*name, settings)),
            Err(_) => println!("{name}: not available"),
        }
    }
    known
}
