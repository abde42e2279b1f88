//! The controls of a camera by name, and the rig's settings as values of controls.

use std::fmt::Write;

use foveate::prelude::ConfigError;

use super::settings::{ControlValue, V4lSettings};

/// Numbers of controls that have a setting of their own (`linux/v4l2-controls.h`).
const AUTOGAIN: u32 = 0x0098_0912;
const GAIN: u32 = 0x0098_0913;
const EXPOSURE_AUTO: u32 = 0x009a_0901;
const EXPOSURE_ABSOLUTE: u32 = 0x009a_0902;
/// Items of EXPOSURE_AUTO.
const ITEM_AUTO: i32 = 0;
const ITEM_MANUAL: i32 = 1;
const ITEM_SHUTTER_PRIORITY: i32 = 2;
const ITEM_APERTURE_PRIORITY: i32 = 3;
/// Unit of EXPOSURE_ABSOLUTE [us].
const EXPOSURE_STEP_US: f64 = 100.0;

/// One control.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Control {
    pub(crate) id: u32,
    pub(crate) name: String,
    pub(crate) kind: Kind,
    pub(crate) min: i64,
    pub(crate) max: i64,
    pub(crate) step: u64,
    pub(crate) default: i64,
    pub(crate) can_be_set: bool,
    /// What it is at.
    pub(crate) value: Option<i32>,
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Kind {
    Number,
    Switch,
    /// Number and name of each item.
    Menu(Vec<(u32, String)>),
    /// Does something when set.
    Button,
    /// Texts, matrices and other things that a rig cannot set.
    Other,
}

/// The settings of a rig as numbers and values of controls, in the order in which they have to be made: what switches an automatism off
/// comes before what the automatism would decide.
///
/// # Errors
/// The setting that the camera does not know or take, and what it offers.
pub(crate) fn plan(settings: &V4lSettings, controls: &[Control]) -> Result<Vec<(u32, i32)>, ConfigError> {
    let mut plan = Vec::new();
    let find = |id: u32| controls.iter().find(|it| it.id == id && it.can_be_set);
    if let Some(exposure_us) = settings.exposure_us {
        let items = match find(EXPOSURE_AUTO) {
            Some(Control { kind: Kind::Menu(items), .. }) => items.as_slice(),
            _ => &[],
        };
        let modes =
            if exposure_us > 0.0 { [ITEM_MANUAL, ITEM_SHUTTER_PRIORITY] } else { [ITEM_AUTO, ITEM_APERTURE_PRIORITY] };
        let mode = modes.into_iter().find(|mode| items.iter().any(|it| i64::from(it.0) == i64::from(*mode)));
        plan.extend(mode.map(|it| (EXPOSURE_AUTO, it)));
        if exposure_us > 0.0 {
            let exposure =
                find(EXPOSURE_ABSOLUTE).ok_or_else(|| missing("exposure_us", "an exposure time", controls))?;
            let steps = (exposure_us / EXPOSURE_STEP_US).round();
            if steps < exposure.min as f64 || steps > exposure.max as f64 {
                let [low, high] = [exposure.min, exposure.max].map(|it| it as f64 * EXPOSURE_STEP_US);
                return Err(ConfigError::at(
                    "exposure_us",
                    format_args!("found {exposure_us}, the device takes {low} to {high} us"),
                ));
            }
            plan.push((EXPOSURE_ABSOLUTE, steps as i32));
        } else if mode.is_none() {
            return Err(missing("exposure_us", "an automatic exposure", controls));
        }
    }
    if let Some(gain) = settings.gain {
        let control = find(GAIN).ok_or_else(|| missing("gain", "a gain", controls))?;
        plan.extend(find(AUTOGAIN).map(|it| (it.id, 0)));
        plan.push((GAIN, control.number("gain", gain)?));
    }
    let mut numbers = Vec::new();
    for (name, value) in &settings.controls {
        let setting = format!("controls.{name}");
        let control =
            controls.iter().find(|it| it.is_named(name)).ok_or_else(|| missing(&setting, "that", controls))?;
        if !control.can_be_set {
            return Err(ConfigError::at(&setting, "the device has this control, but it is read-only"));
        }
        let entry = (control.id, control.value_of(&setting, value)?);
        // Switches and menus decide whether a number counts.
        if control.kind == Kind::Number { numbers.push(entry) } else { plan.push(entry) }
    }
    plan.append(&mut numbers);
    Ok(plan)
}

fn missing(setting: &str, what: &str, controls: &[Control]) -> ConfigError {
    let names: Vec<_> = controls.iter().filter(|it| it.can_be_set).map(|it| format!("`{}`", it.name)).collect();
    let offered = if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
    ConfigError::at(setting, format_args!("the device has no control for {what}; found these: {offered}"))
}

/// Letters and digits alone: `Power Line Frequency` and `power_line_frequency` are one name.
fn plain(name: &str) -> String {
    name.chars().filter(|it| it.is_alphanumeric()).flat_map(char::to_lowercase).collect()
}

impl Control {
    fn is_named(&self, name: &str) -> bool {
        plain(&self.name) == plain(name)
    }

    fn value_of(&self, setting: &str, value: &ControlValue) -> Result<i32, ConfigError> {
        let wrong =
            |found: &str| ConfigError::at(setting, format_args!("found {found}, the device takes {}", self.range()));
        match (&self.kind, value) {
            (Kind::Switch, ControlValue::Switch(on)) => Ok(i32::from(*on)),
            (Kind::Switch, ControlValue::Number(number @ (0 | 1))) => Ok(*number),
            (Kind::Menu(items), ControlValue::Item(name)) => {
                let item = items.iter().find(|it| plain(&it.1) == plain(name));
                item.map(|it| it.0 as i32).ok_or_else(|| wrong(&format!("`{name}`")))
            }
            (Kind::Menu(items), ControlValue::Number(number)) => {
                let is_there = items.iter().any(|it| i64::from(it.0) == i64::from(*number));
                if is_there { Ok(*number) } else { Err(wrong(&number.to_string())) }
            }
            (Kind::Number, ControlValue::Number(number)) => self.number(setting, *number),
            (Kind::Button, ControlValue::Number(_) | ControlValue::Switch(true)) => Ok(1),
            (_, ControlValue::Switch(it)) => Err(wrong(&it.to_string())),
            (_, ControlValue::Number(it)) => Err(wrong(&it.to_string())),
            (_, ControlValue::Item(it)) => Err(wrong(&format!("`{it}`"))),
        }
    }

    fn number(&self, setting: &str, number: i32) -> Result<i32, ConfigError> {
        let wide = i64::from(number);
        let fits =
            (self.min..=self.max).contains(&wide) && (wide - self.min).unsigned_abs().is_multiple_of(self.step.max(1));
        if fits {
            Ok(number)
        } else {
            Err(ConfigError::at(setting, format_args!("found {number}, the device takes {}", self.range())))
        }
    }

    fn range(&self) -> String {
        match &self.kind {
            Kind::Number if self.step > 1 => format!("{} to {} in steps of {}", self.min, self.max, self.step),
            Kind::Number => format!("{} to {}", self.min, self.max),
            Kind::Switch => "true or false".to_owned(),
            Kind::Menu(items) => {
                items.iter().map(|(number, name)| format!("{number} `{name}`")).collect::<Vec<_>>().join(", ")
            }
            Kind::Button => "true, which presses it".to_owned(),
            Kind::Other => "no value that a rig can hold".to_owned(),
        }
    }
}

/// All controls that can be set, a line each.
pub(crate) fn in_lines(controls: &[Control], indent: &str) -> String {
    let mut text = String::new();
    for control in controls.iter().filter(|it| it.can_be_set && it.kind != Kind::Other) {
        let default =
            if control.kind == Kind::Button { String::new() } else { format!(", default {}", control.default) };
        let now = control.value.map_or(String::new(), |it| format!(", now {it}"));
        let _ = writeln!(text, "{indent}{}: {}{default}{now}", control.name, control.range());
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn control(id: u32, name: &str, kind: Kind, range: [i64; 2]) -> Control {
        let [min, max] = range;
        Control { id, name: name.to_owned(), kind, min, max, step: 1, default: min, can_be_set: true, value: None }
    }

    fn webcam() -> Vec<Control> {
        let menu = |items: &[(u32, &str)]| Kind::Menu(items.iter().map(|it| (it.0, it.1.to_owned())).collect());
        let mut temperature = control(7, "White Balance Temperature", Kind::Number, [2800, 6500]);
        temperature.step = 10;
        let mut shown = control(9, "Temperature of the Chip", Kind::Number, [0, 100]);
        shown.can_be_set = false;
        vec![
            control(GAIN, "Gain", Kind::Number, [0, 255]),
            control(AUTOGAIN, "Gain, Automatic", Kind::Switch, [0, 1]),
            control(6, "White Balance, Automatic", Kind::Switch, [0, 1]),
            temperature,
            control(8, "Power Line Frequency", menu(&[(0, "Disabled"), (1, "50 Hz"), (2, "60 Hz")]), [0, 2]),
            control(EXPOSURE_AUTO, "Auto Exposure", menu(&[(1, "Manual Mode"), (3, "Aperture Priority Mode")]), [0, 3]),
            control(EXPOSURE_ABSOLUTE, "Exposure Time, Absolute", Kind::Number, [3, 2047]),
            shown,
        ]
    }

    /// The plan for a rig's settings, written as TOML.
    #[track_caller]
    fn planned(toml: &str) -> Result<Vec<(u32, i32)>, ConfigError> {
        plan(&crate::v4l::tests::settings(toml), &webcam())
    }

    #[test]
    fn names_are_matched_by_their_letters_and_items_by_name_or_number() {
        assert_eq!(planned("controls = { 'Power Line Frequency' = 1 }"), Ok(vec![(8, 1)]));
        assert_eq!(planned("controls = { power_line_frequency = '60 Hz' }"), Ok(vec![(8, 2)]));
        assert_eq!(planned(""), Ok(vec![]));
    }

    #[test]
    fn automatism_is_switched_off_before_what_it_decides_is_set() {
        let text = "controls = { 'White Balance Temperature' = 4000, 'white balance automatic' = false }";
        assert_eq!(planned(text), Ok(vec![(6, 0), (7, 4000)]));
        assert_eq!(planned("gain = 12"), Ok(vec![(AUTOGAIN, 0), (GAIN, 12)]));
        assert_eq!(planned("exposure_us = 5000"), Ok(vec![(EXPOSURE_AUTO, ITEM_MANUAL), (EXPOSURE_ABSOLUTE, 50)]));
        assert_eq!(planned("exposure_us = 0"), Ok(vec![(EXPOSURE_AUTO, ITEM_APERTURE_PRIORITY)]));
    }

    #[test]
    fn refusal_names_the_setting_and_what_the_device_takes() {
        let refused = |toml: &str| {
            let error = planned(toml).unwrap_err();
            (error.setting.unwrap(), error.message)
        };
        let (setting, message) = refused("controls = { 'power line frequency' = 7 }");
        assert_eq!(setting, "controls.power line frequency");
        assert_eq!(message, "found 7, the device takes 0 `Disabled`, 1 `50 Hz`, 2 `60 Hz`");
        assert!(refused("controls = { 'power line frequency' = '70 Hz' }").1.contains("`70 Hz`"));
        assert!(refused("controls = { Zoom = 1 }").1.contains("`Gain`, `Gain, Automatic`"));
        assert!(refused("controls = { 'Temperature of the chip' = 1 }").1.contains("read-only"));
        let step = refused("controls = { 'White Balance Temperature' = 4005 }").1;
        assert_eq!(step, "found 4005, the device takes 2800 to 6500 in steps of 10");
        assert!(refused("controls = { 'White Balance, Automatic' = 2 }").1.contains("true or false"));
        assert_eq!(refused("gain = 300"), ("gain".to_owned(), "found 300, the device takes 0 to 255".to_owned()));
        assert_eq!(refused("exposure_us = 100").1, "found 100, the device takes 300 to 204700 us");
        let nothing = plan(&crate::v4l::tests::settings("exposure_us = 100"), &[]).unwrap_err();
        assert!(nothing.message.ends_with("found these: nothing"), "{nothing}");
    }

    #[test]
    fn list_shows_what_can_be_set() {
        let text = in_lines(&webcam(), "  ");
        assert!(text.contains("  Power Line Frequency: 0 `Disabled`, 1 `50 Hz`, 2 `60 Hz`, default 0\n"), "{text}");
        assert!(!text.contains("Chip"));
    }
}
