//! `led.detector`: finds bright lights in the pictures of one camera [Davis 2002 §3.3].

use std::collections::BTreeMap;

use foveate::imaging::hue_between;
use foveate::node::detector::{DetectorPorts, DetectorShell, Polygon, check_masks};
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::led_detector::LedDetector;

ports! {
    IMAGE: In<Image> = each("image");
    PREDICTED: In<Targets> = latest("predicted").optional();
    FEATURES: Out<Features> = "features";
}

const PORTS: DetectorPorts = DetectorPorts { image: &IMAGE, predicted: &PREDICTED, features: &FEATURES };

figures! {
        "detector.features.*": count, neither, "Lights found in all pictures of the camera";
        "detector.pictures_searched.*": count, neither, "Pictures searched; the pictures of the three figures below are not among them";
        "detector.pictures_learning.*": count, neither, "Pictures used only to learn the background";
        "detector.pictures_flooded.*": count, low, "Pictures not searched because too much of them differed from the background";
    "detector.pictures_refused.*": count, low, "Pictures that could not be read: wrong size, part, colour or pixels";
}

/// Settings of [`Detector`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct DetectorSettings {
    /// Colour plane that is searched; the colour of the lights, or `max` where they differ [–].
    pub channel: ColourPlane,
    /// A pixel is lit when brighter than its learnt background by more than this: about three times the noise, and slow
    /// changes of the light [gray level].
    #[schemars(extend("live" = true))]
    pub offset: u8,
    /// Lowest threshold, for dark backgrounds [gray level].
    #[schemars(extend("live" = true))]
    pub min_threshold: u8,
    /// Smallest brightness of a light's brightest pixel. The rim of a light, down to the threshold, sharpens its centre; an area no
    /// brighter than a rim, such as a wall that a person has uncovered, is no light [gray level].
    #[schemars(extend("live" = true))]
    pub min_peak: u8,
    /// Pictures that the background is learnt from; 0: no background, and `min_threshold` is used everywhere, which moving parts of pictures
    /// require [frames].
    #[schemars(range(min = 0, max = 10000))]
    pub learn_frames: u32,
    /// The background of a pixel is the brightest that was learnt, after this many brighter ones: a light that moves away within
    /// as many pictures leaves no trace. 0 is the paper's maximum; fewer than `learn_frames`, unless that is 0 [frames].
    #[schemars(range(min = 0, max = 15))]
    pub left_out_frames: u8,
    /// Output until the background has been learnt for the first time: none, or what exceeds `min_threshold` [–].
    pub while_learning: WhileLearning,
    /// When a larger part of the picture is lit, the room has changed and the background is learnt again [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub relearn_fraction: f64,
    /// How far the background of a pixel that has become darker is lowered per visit, once every 8 rows' worth of
    /// pictures; 0: never, as in the paper [gray level].
    pub sink: u8,
    /// Centre of a spot: the mean of its light, or that of its pixels rounded to whole pixels, as in the
    /// paper [–].
    pub centroid: CentroidKind,
    /// Regions that are not searched, such as monitors: a list of polygons, each a list of corners (x, y) [px].
    #[schemars(extend("live" = true))]
    pub masks: Vec<Polygon>,
    /// Regions of single cameras, by their names: `{ wide-3 = [[[0, 0], [9, 0], [0, 9]]] }` [px].
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    #[schemars(extend("default" = {}, "live" = true))]
    pub camera_masks: BTreeMap<String, Vec<Polygon>>,
    /// `full`: every pixel; `sampled`: one row in `grid_px`, and windows where lights are expected [–].
    pub search: Search,
    /// In a sampled search, the distance of the searched rows. They shift from picture to picture, so that a small light at
    /// rest is found within this many pictures [px].
    #[schemars(range(min = 1, max = 1000), extend("live" = true))]
    pub grid_px: u32,
    /// In a sampled search, the side of the windows in which every pixel is searched [px].
    #[schemars(range(min = 1, max = 10000), extend("live" = true))]
    pub window_px: u32,
    /// Smallest spot kept; removes hot pixels and noise [px²].
    #[schemars(range(min = 1, max = 10000000), extend("live" = true))]
    pub min_area_px: u32,
    /// Largest spot kept; removes lamps and windows [px²].
    #[schemars(range(min = 1, max = 10000000), extend("live" = true))]
    pub max_area_px: u32,
    /// Largest ratio of a spot's longer to its shorter axis; removes reflections on edges [–].
    #[schemars(range(min = 1.0, max = 1000.0), extend("live" = true))]
    pub max_elongation: f64,
    /// Smallest part of its bounding box that a spot fills; removes hollow and branched objects [–].
    #[schemars(range(min = 0.0, max = 1.0), extend("live" = true))]
    pub min_fill: f64,
    /// Whether touching lights are separated, and a light is separated from touching skin or cloth that is brighter than the learnt background; not
    /// with whole pixels (`centroid = "integer"`), as in the paper [–].
    pub part: bool,
    /// Most spots of one picture [–].
    #[schemars(range(min = 1, max = 10000), extend("live" = true))]
    pub max_features: u32,
    /// Noise of a pixel, standard deviation, from which the centres' covariance follows [gray level].
    #[schemars(range(min = 0.0, max = 255.0))]
    pub pixel_noise: f64,
    /// Lights of these colours get labels, in colour pictures: identified by the flanks of a spot, whose middle may be saturated. Left out: none [–].
    pub colours: Vec<LightColour>,
    /// A light whose hue is farther than this from every colour's, or nearly as near to a second one, has no label [deg].
    #[schemars(range(min = 1.0, max = 60.0))]
    pub hue_tolerance_deg: f64,
    /// A paler light has no label: 0 is white, 1 light of one plane alone [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub min_saturation: f64,
}

/// A colour of lights.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LightColour {
    /// The label that lights of this colour get [–].
    pub label: u32,
    /// Their hue in this camera's pictures: 0 red, 60 yellow, 120 green, 240 blue [deg].
    #[schemars(range(min = 0.0, max = 360.0))]
    pub hue_deg: f64,
}

/// Smallest distance of hues that can be distinguished [deg].
const LEAST_APART_DEG: f64 = 15.0;

impl Default for DetectorSettings {
    /// The paper's grid, windows and rules; thresholds and sizes for LEDs 2 m to 6 m from a camera of 640 × 240 px.
    fn default() -> Self {
        Self {
            channel: ColourPlane::Luma,
            offset: 20,
            min_threshold: 40,
            min_peak: 70,
            learn_frames: 30,
            left_out_frames: 3,
            while_learning: WhileLearning::Wait,
            relearn_fraction: 0.02,
            sink: 0,
            centroid: CentroidKind::Weighted,
            masks: Vec::new(),
            camera_masks: BTreeMap::new(),
            search: Search::Sampled,
            grid_px: 5,
            window_px: 40,
            min_area_px: 2,
            max_area_px: 400,
            max_elongation: 4.0,
            min_fill: 0.3,
            part: true,
            max_features: 256,
            pixel_noise: 3.0,
            colours: Vec::new(),
            hue_tolerance_deg: 30.0,
            min_saturation: 0.35,
        }
    }
}

/// Which plane of a colour picture is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ColourPlane {
    /// Perceived brightness.
    Luma,
    /// Red.
    Red,
    /// Green.
    Green,
    /// Blue.
    Blue,
    /// The brightest of the three.
    Max,
}

/// Centre of a spot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum CentroidKind {
    /// The mean position of its light.
    Weighted,
    /// The mean position of its pixels, rounded to whole ones: the paper's.
    Integer,
}

/// How much of a picture is searched.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Search {
    /// Every pixel.
    Full,
    /// Some rows, and windows.
    Sampled,
}

/// Output until the background has been learnt for the first time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WhileLearning {
    /// Empty lists: the camera is alive, and sees nothing yet.
    Wait,
    /// All spots above the lowest threshold, clutter included; for recordings that begin with the lights.
    Search,
}

/// Pictures in, lights out in scan order, each with a sub-pixel centre and its covariance.
///
/// Parts of pictures, such as those of `select.crop`, are allowed: the output is in pixels of the whole picture.
///
/// Nothing seen, or the background not learnt yet: an empty list. A picture of the wrong size, a broken picture, and a picture
/// with too much light are gaps on the output; the detector continues with the next picture.
pub struct Detector {
    led_detector: LedDetector,
    shell: DetectorShell,
}

impl Node for Detector {
    const TYPE: &'static str = "led.detector";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Finds bright lights in the pictures of one camera, each with a sub-pixel centre";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = DetectorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: DetectorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let shell = DetectorShell::new(setup);
        let settings = of_camera(settings, &shell)?;
        let size = setup.camera_model().map(|it| it.image_size);
        let phase = setup.random.clone().next_u64();
        let led_detector = LedDetector::new(settings, size, phase).map_err(ConfigError::node)?;
        Ok(Self { led_detector, shell })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Self { led_detector, shell } = self;
        let flooded = "too much of the picture is lit: the background is being learnt again";
        shell.process(io, &PORTS, flooded, |image, predicted, _, features| {
            led_detector.find(image, predicted, features)
        });
        Ok(())
    }

    fn change(&mut self, settings: DetectorSettings) -> Result<(), ConfigError> {
        settings.check()?;
        self.led_detector.change(of_camera(settings, &self.shell)?).map_err(ConfigError::node)
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.shell.report(report);
        Ok(())
    }
}

/// The settings with all masks of the camera among `masks`.
fn of_camera(settings: DetectorSettings, shell: &DetectorShell) -> Result<DetectorSettings, ConfigError> {
    let masks = shell.masks(&settings.masks, &settings.camera_masks)?;
    Ok(DetectorSettings { masks, ..settings })
}

impl DetectorSettings {
    /// Checks the range of each setting.
    ///
    /// # Errors
    /// The first setting out of its range, what was found, and the range.
    pub fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("learn_frames", self.learn_frames, 0..=10_000)?;
        ConfigError::unless_in("left_out_frames", self.left_out_frames, 0..=15)?;
        if self.learn_frames > 0 && u32::from(self.left_out_frames) >= self.learn_frames {
            let (found, frames) = (self.left_out_frames, self.learn_frames);
            let text = format_args!("found {found}, expected fewer than learn_frames, which is {frames}");
            return Err(ConfigError::at("left_out_frames", text));
        }
        ConfigError::unless_in("relearn_fraction", self.relearn_fraction, 0.0..=1.0)?;
        ConfigError::unless_in("grid_px", self.grid_px, 1..=1000)?;
        ConfigError::unless_in("window_px", self.window_px, 1..=10_000)?;
        ConfigError::unless_in("min_area_px", self.min_area_px, 1..=10_000_000)?;
        ConfigError::unless_in("max_area_px", self.max_area_px, self.min_area_px..=10_000_000)?;
        ConfigError::unless_in("max_elongation", self.max_elongation, 1.0..=1000.0)?;
        ConfigError::unless_in("min_fill", self.min_fill, 0.0..=1.0)?;
        ConfigError::unless_in("max_features", self.max_features, 1..=10_000)?;
        ConfigError::unless_in("pixel_noise", self.pixel_noise, 0.0..=255.0)?;
        ConfigError::unless_in("hue_tolerance_deg", self.hue_tolerance_deg, 1.0..=60.0)?;
        ConfigError::unless_in("min_saturation", self.min_saturation, 0.0..=1.0)?;
        for (place, it) in self.colours.iter().enumerate() {
            let setting = format!("colours[{place}]");
            ConfigError::unless_in(&format!("{setting}.hue_deg"), it.hue_deg, 0.0..=360.0)?;
            let is_near = |other: &&LightColour| hue_between(other.hue_deg, it.hue_deg).abs() < LEAST_APART_DEG;
            if let Some(other) = self.colours[..place].iter().find(is_near) {
                let text = format_args!(
                    "found hues of {}° and {}°, expected them {LEAST_APART_DEG}° apart or more",
                    other.hue_deg, it.hue_deg
                );
                return Err(ConfigError::at(&setting, text));
            }
        }
        check_masks(&self.masks, &self.camera_masks)
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Detector>("");
        check_node::<Detector>(
            "channel = \"max\"\ncolours = [{ label = 1, hue_deg = 0 }, { label = 2, hue_deg = 120 }]",
        );
        check_node::<Detector>("offset = 30\nchannel = \"green\"\nmasks = [[[0, 0], [10, 0], [0, 10.5]]]");
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let setting = |change: fn(&mut DetectorSettings)| {
            let mut settings = DetectorSettings::default();
            change(&mut settings);
            Detector::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting)
        };
        assert_eq!(setting(|_| ()), None);
        assert_eq!(setting(|it| it.grid_px = 0).as_deref(), Some("grid_px"));
        assert_eq!(setting(|it| it.left_out_frames = 30).as_deref(), Some("left_out_frames"));
        assert_eq!(setting(|it| it.max_area_px = 1).as_deref(), Some("max_area_px"));
        assert_eq!(setting(|it| it.hue_tolerance_deg = 90.0).as_deref(), Some("hue_tolerance_deg"));
        let near = |it: &mut DetectorSettings| {
            it.colours = [355.0, 5.0].map(|hue_deg| LightColour { label: 1, hue_deg }).to_vec()
        };
        assert_eq!(setting(near).as_deref(), Some("colours[1]"));
        assert_eq!(setting(|it| it.pixel_noise = f64::NAN).as_deref(), Some("pixel_noise"));
        assert_eq!(setting(|it| it.masks = vec![vec![[0.0; 2]; 2]]).as_deref(), Some("masks[0]"));
    }
}
