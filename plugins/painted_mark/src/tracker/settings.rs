//! Settings of the tracker of painted marks, with the reasons for their defaults.

use foveate::imaging::{DotLimits, FlowSettings, StabiliserSettings};
use foveate::prelude::ConfigError;
use nalgebra::Point2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::corrections::Correction;

/// Settings of [`TrackerNode`](super::TrackerNode). `checks = false`, `reanchor = false` and no `guide` track as in [Davis 2002 §5.1].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct TrackerSettings {
    /// A table of corrections by hand, read at the start: `camera,mark,frame,u_px,v_px` with this heading; `frame` is the sequence number of the picture. Rows of the
    /// first picture choose marks, later ones correct a mark, an empty position ends it; `{camera}` is the camera's name, `${NAME}` an environment variable; empty: none [–].
    pub marks: String,
    /// More rows of such a table, as they come from a page while the rig runs: a row about a picture that is past is carried to the present by the dominant motion [–].
    #[schemars(extend("live" = true))]
    pub corrections: Vec<CorrectionRow>,
    /// Whether dots are searched. They have no labels until the guide gives them some [–].
    #[schemars(extend("live" = true))]
    pub find: bool,
    /// Radius of a dot in the picture; dots of half to twice that are found [px].
    #[schemars(range(min = 1.0, max = 20.0))]
    pub radius_px: f64,
    /// Smallest relative contrast of a dot's centre against its surroundings [–].
    #[schemars(range(min = 0.02, max = 1.0))]
    pub min_contrast: f64,
    /// Colour of the dots in colour pictures, red, green, blue; left out: they are darker than the surface [gray level].
    pub colour: Option<[u8; 3]>,
    /// Columns and rows of the searched patch, odd. For dots 12 px apart: neighbouring dots stay outside [px].
    #[schemars(range(min = 5, max = 31))]
    pub window_px: u32,
    /// Levels of the search pyramid, each half of the one before [–].
    #[schemars(range(min = 1, max = 8))]
    pub levels: u32,
    /// Largest compensated dominant motion from one picture to the next, along rows and columns; 0: no compensation [px].
    #[schemars(range(min = 0, max = 1000))]
    pub reach_px: u32,
    /// Pictures in which a lost mark is searched again, which bridges motion blur [frames].
    #[schemars(range(min = 0, max = 1000), extend("live" = true))]
    pub patience_frames: u32,
    /// Whether marks are rejected that fail the backward search, change their look, move unlike their neighbours or lie on another's dot [–].
    #[schemars(extend("live" = true))]
    pub checks: bool,
    /// Rolling shutter: from the exposure of the camera's first row to that of its last one; pictures are stamped by the middle row. Positions are converted to the time of that row
    /// by the motion of each mark from picture to picture. 0: all rows at once [ms].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub readout_ms: f64,
    /// Whether each mark is moved to the centre of its dot, or of its reference patch; otherwise small errors accumulate to drift [–].
    #[schemars(extend("live" = true))]
    pub reanchor: bool,
    /// Smallest correlation of a patch with its predecessor [–].
    #[schemars(range(min = 0.0, max = 1.0), extend("live" = true))]
    pub min_correlation: f64,
    /// Largest distance of the result of a backward search from its origin [px].
    #[schemars(range(min = 0.01, max = 100.0), extend("live" = true))]
    pub back_px: f64,
    /// Largest motion of a mark from one picture to the next relative to its neighbours; less than half of the spacing of dots [px].
    #[schemars(range(min = 0.1, max = 100.0), extend("live" = true))]
    pub jump_px: f64,
    /// Largest distance of a dot from a mark's predicted position for labelling, where no other is half as near [px].
    #[schemars(range(min = 0.1, max = 100.0), extend("live" = true))]
    pub name_px: f64,
    /// Pictures between two searches of the whole picture for dots; a picture after a loss is searched, too [frames].
    #[schemars(range(min = 1, max = 10000), extend("live" = true))]
    pub search_every: u32,
    /// Most marks and dots tracked at a time [–].
    #[schemars(range(min = 1, max = 10000))]
    pub max_marks: u32,
}

/// A correction by hand: where a mark is in one picture of one camera.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CorrectionRow {
    /// Name of the camera [–].
    pub camera: String,
    /// Which mark [–].
    pub mark: u32,
    /// Sequence number of the picture [–].
    pub frame: u64,
    /// Column of the mark, in pixels of the whole picture; left out with `v_px`: it is not visible from there on [px].
    #[serde(default)]
    pub u_px: Option<f64>,
    /// Row of the mark [px].
    #[serde(default)]
    pub v_px: Option<f64>,
}

impl CorrectionRow {
    /// As the tracker applies it.
    pub(super) fn correction(&self) -> Correction {
        let pixel = self.u_px.zip(self.v_px).map(|(u, v)| Point2::new(u, v));
        Correction { frame: self.frame, mark: self.mark, pixel }
    }

    fn check(&self, place: usize) -> Result<(), ConfigError> {
        let setting = format!("corrections[{place}]");
        let is_finite = |it: Option<f64>| it.is_none_or(f64::is_finite);
        match (self.u_px, self.v_px) {
            (Some(_), None) | (None, Some(_)) => {
                Err(ConfigError::at(&setting, "found one coordinate, expected `u_px` and `v_px` or neither"))
            }
            (u, v) if !is_finite(u) || !is_finite(v) => Err(ConfigError::at(&setting, "expected finite numbers")),
            _ => Ok(()),
        }
    }
}

impl Default for TrackerSettings {
    /// For dots of 4 to 5 px, 12 px apart, on a face of 200 px at 30 Hz.
    fn default() -> Self {
        Self {
            marks: String::new(),
            corrections: Vec::new(),
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
    /// Checks the range of each setting.
    ///
    /// # Errors
    /// The first setting out of its range, what was found, and the range.
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
        self.corrections.iter().enumerate().try_for_each(|(place, it)| it.check(place))?;
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
