//! Settings of the tracker of painted marks, with the reasons for their defaults.

use foveate::imaging::{DotLimits, FlowSettings, StabiliserSettings};
use foveate::prelude::ConfigError;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Settings of [`TrackerNode`](super::TrackerNode). `checks = false`, `reanchor = false` and no `guide` track as [Davis 2002 §5.1] does.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrackerSettings {
    /// A table of places put right by hand, read at the start: `camera,mark,frame,u_px,v_px` with this heading; `frame` is the sequence number of the picture. Rows of the
    /// first picture choose marks, later ones put a mark right, an empty place ends it; `{camera}` is the camera's name, `${NAME}` an environment variable; empty: none [–].
    pub marks: String,
    /// Look for dots. They have no names until the guide gives them some [–].
    pub find: bool,
    /// The radius of a dot in the picture; dots of half to twice that are found [px].
    #[schemars(range(min = 1.0, max = 20.0))]
    pub radius_px: f64,
    /// How much darker than its surroundings a dot is in its middle, at least [–].
    #[schemars(range(min = 0.02, max = 1.0))]
    pub min_contrast: f64,
    /// The colour of the dots in colour pictures, red, green, blue; left out: they are darker than the surface [gray level].
    pub colour: Option<[u8; 3]>,
    /// Columns and rows of the patch that is looked for, odd. Dots 12 px apart: their neighbours do not come in [px].
    #[schemars(range(min = 5, max = 31))]
    pub window_px: u32,
    /// Levels of the pyramid that are searched, each half of the one before [–].
    #[schemars(range(min = 1, max = 8))]
    pub levels: u32,
    /// The largest motion of the whole from one picture to the next that is made up for, along rows and columns; 0: none is [px].
    #[schemars(range(min = 0, max = 1000))]
    pub reach_px: u32,
    /// Following pictures in which a mark that was lost is tried again: motion blur passes [frames].
    #[schemars(range(min = 0, max = 1000))]
    pub patience_frames: u32,
    /// Leave out what does not come back to where it was, does not look like before, moves unlike its neighbours or sits on another's dot [–].
    pub checks: bool,
    /// Rolling shutter: from the exposure of the camera's first row to that of its last one; pictures are stamped by the middle row. Places go out as that row would have had
    /// them, by how each mark moves from picture to picture. 0: all rows at once [ms].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub readout_ms: f64,
    /// Put each mark on the middle of its dot again, or on the place of its reference patch; otherwise small errors add up to drift [–].
    pub reanchor: bool,
    /// A patch that correlates less with what it was is not it [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_correlation: f64,
    /// How far a patch that is searched back in the picture before may come from where it was [px].
    #[schemars(range(min = 0.01, max = 100.0))]
    pub back_px: f64,
    /// How far a mark may move from one picture to the next beyond what its neighbours do; less than half of what dots are apart [px].
    #[schemars(range(min = 0.1, max = 100.0))]
    pub jump_px: f64,
    /// How far from where it should be a dot may be to be given a name, where no other is half as near [px].
    #[schemars(range(min = 0.1, max = 100.0))]
    pub name_px: f64,
    /// Pictures from one search of the whole for dots to the next; a picture after a loss is searched, too [frames].
    #[schemars(range(min = 1, max = 10000))]
    pub search_every: u32,
    /// Marks and dots followed at a time, at most [–].
    #[schemars(range(min = 1, max = 10000))]
    pub max_marks: u32,
}

impl Default for TrackerSettings {
    /// For dots of 4 to 5 px, 12 px apart, on a face of 200 px at 30 Hz.
    fn default() -> Self {
        Self {
            marks: String::new(),
            find: true,
            radius_px: 2.0,
            min_contrast: 0.12,
            colour: None,
            window_px: 15,
            levels: 4,
            reach_px: 80,
            patience_frames: 5,
            checks: true,
            readout_ms: 0.0,
            reanchor: true,
            min_correlation: 0.75,
            back_px: 0.7,
            jump_px: 4.0,
            name_px: 4.0,
            search_every: 3,
            max_marks: 200,
        }
    }
}

impl TrackerSettings {
    /// Names the first setting that is out of its range.
    ///
    /// # Errors
    /// The setting, what was found, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("radius_px", self.radius_px, 1.0..=20.0)?;
        ConfigError::unless_in("min_contrast", self.min_contrast, 0.02..=1.0)?;
        ConfigError::unless_in("window_px", self.window_px, 5..=31)?;
        if self.window_px.is_multiple_of(2) {
            let text = format_args!("found {}, expected an odd number from 5 to 31", self.window_px);
            return Err(ConfigError::at("window_px", text));
        }
        ConfigError::unless_in("levels", self.levels, 1..=8)?;
        ConfigError::unless_in("reach_px", self.reach_px, 0..=1000)?;
        ConfigError::unless_in("patience_frames", self.patience_frames, 0..=1000)?;
        ConfigError::unless_in("readout_ms", self.readout_ms, 0.0..=100.0)?;
        ConfigError::unless_in("min_correlation", self.min_correlation, 0.0..=1.0)?;
        ConfigError::unless_in("back_px", self.back_px, 0.01..=100.0)?;
        ConfigError::unless_in("jump_px", self.jump_px, 0.1..=100.0)?;
        ConfigError::unless_in("name_px", self.name_px, 0.1..=100.0)?;
        ConfigError::unless_in("search_every", self.search_every, 1..=10_000)?;
        ConfigError::unless_in("max_marks", self.max_marks, 1..=10_000)
    }

    pub(super) fn flow(&self) -> FlowSettings {
        let (window_px, levels) = (self.window_px as usize, self.levels as usize);
        FlowSettings { window_px, levels, ..FlowSettings::default() }
    }

    pub(super) fn dots(&self) -> DotLimits {
        DotLimits { radius_px: self.radius_px, min_contrast: self.min_contrast, ..DotLimits::default() }
    }

    pub(super) fn stabiliser(&self) -> StabiliserSettings {
        StabiliserSettings { reach_px: self.reach_px as usize, ..StabiliserSettings::default() }
    }
}
