//! `export.overlay`: the points that a detector found, ringed in their picture.
//!
//! Features come after the picture of the same stamp, so the pictures that are to be drawn are kept until then; at most
//! four of them, so that a detector that skips pictures costs no memory. A picture whose features never come is not
//! drawn, and the report counts it: without rings it would look as if nothing had been found. Where any feature of a picture has a
//! label, those without one (hair, rims of ears, shadows beside painted marks) are drawn as gray rings, under the others.

use std::collections::VecDeque;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use foveate::plot::canvas::Canvas;
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::file_part;
use crate::row_file::write_whole;

ports! {
    IMAGE: In<Image> = each("image");
    FEATURES: In<Features> = each("features");
}

/// Pictures kept until their features come.
const HELD: usize = 4;
/// The folder within the results.
const FOLDER: &str = "overlay";
/// Magenta: rare among the lights of a room.
const COLOUR: [u8; 3] = [255, 0, 255];
/// Gray: features without a label, in a picture where others have one.
const UNLABELLED: [u8; 3] = [150, 150, 150];
/// Free space between a spot and its ring [px].
const CLEARANCE: f64 = 4.0;

/// Settings of [`ExportOverlay`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ExportOverlaySettings {
    /// Every n-th picture of the camera is drawn [–]
    #[serde(default = "default_every_n")]
    #[schemars(range(min = 1, max = 1000000))]
    pub every_n: u64,
    /// Pictures drawn at most [–]
    #[serde(default = "default_max_pictures")]
    #[schemars(range(min = 1, max = 10000))]
    pub max_pictures: u64,
    /// Each pixel is drawn as this many pixels in width and height [–]
    #[serde(default = "default_zoom")]
    #[schemars(range(min = 1, max = 8))]
    pub zoom: u32,
    /// Gray levels are multiplied by this, to see into dark pictures [–]
    #[serde(default = "default_gain")]
    #[schemars(range(min = 0.1, max = 100.0))]
    pub gain: f64,
}

fn default_every_n() -> u64 {
    100
}

fn default_max_pictures() -> u64 {
    20
}

fn default_zoom() -> u32 {
    1
}

fn default_gain() -> f64 {
    1.0
}

/// Pictures with rings into `overlay/<camera>_<number>.png`.
pub struct ExportOverlay {
    settings: ExportOverlaySettings,
    instance: String,
    name: String,
    out_dir: Option<PathBuf>,
    held: VecDeque<(Stamp, Arc<Image>)>,
    /// Features that came before their picture, which threads allow.
    early: VecDeque<(Stamp, Arc<Features>)>,
    n_drawn: u64,
    n_unanswered: u64,
    report: Report,
    fault: Option<String>,
}

impl ExportOverlay {
    fn is_wanted(&self, stamp: Stamp) -> bool {
        stamp.sequence.is_multiple_of(self.settings.every_n)
            && self.n_drawn + (self.held.len() as u64) < self.settings.max_pictures
    }

    fn take_image(&mut self, stamp: Stamp, image: Arc<Image>) {
        if !self.is_wanted(stamp) {
            return;
        }
        if let Some(at) = self.early.iter().position(|(early, _)| *early == stamp) {
            if let Some((stamp, features)) = self.early.remove(at) {
                self.draw(stamp, &image, &features);
            }
            return;
        }
        self.held.push_back((stamp, image));
        if self.held.len() > HELD {
            self.held.pop_front();
            self.n_unanswered += 1;
        }
    }

    fn take_features(&mut self, stamp: Stamp, features: Arc<Features>) {
        if let Some(at) = self.held.iter().position(|(held, _)| *held == stamp) {
            if let Some((stamp, image)) = self.held.remove(at) {
                self.draw(stamp, &image, &features);
            }
        } else if self.is_wanted(stamp) {
            self.early.push_back((stamp, features));
            if self.early.len() > HELD {
                self.early.pop_front();
            }
        }
    }

    fn draw(&mut self, stamp: Stamp, image: &Image, features: &Features) {
        self.n_drawn += 1;
        let Some(out_dir) = &self.out_dir else { return };
        let channels = image.format.channels();
        let mut canvas = Canvas::of(&image.pixels, image.width, channels, self.settings.zoom, self.settings.gain);
        let mut ring = |feature: &Feature, colour: [u8; 3]| {
            let radius =
                (f64::from(feature.area) / std::f64::consts::PI).sqrt() / f64::from(image.window.shrink.max(1));
            let centre = image.window.in_image(&feature.centre);
            canvas.ring(centre.x, centre.y, radius + CLEARANCE, colour);
        };
        let (labelled, unlabelled): (Vec<_>, Vec<_>) = features.list.iter().partition(|it| it.label.is_some());
        let colour = if labelled.is_empty() { COLOUR } else { UNLABELLED };
        unlabelled.into_iter().for_each(|it| ring(it, colour));
        labelled.into_iter().for_each(|it| ring(it, COLOUR));
        let name = format!("{FOLDER}/{}_{:06}.png", self.name, stamp.sequence);
        let written = canvas
            .png()
            .map_err(|error| format!("`{name}` cannot be encoded: {error}"))
            .and_then(|bytes| {
                fs::create_dir_all(out_dir.join(FOLDER))
                    .map_err(|error| format!("`{}`: {error}", out_dir.join(FOLDER).display()))
                    .map(|()| bytes)
            })
            .and_then(|bytes| write_whole(Some(out_dir), &name, &bytes, &mut self.report));
        if let Err(fault) = written {
            self.fault.get_or_insert(fault);
        }
    }
}

impl Node for ExportOverlay {
    const TYPE: &'static str = "export.overlay";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes camera pictures as PNG, detected points ringed (gray: no label)";
    type Settings = ExportOverlaySettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportOverlaySettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("every_n", settings.every_n, 1..=1_000_000)?;
        ConfigError::unless_in("max_pictures", settings.max_pictures, 1..=10_000)?;
        ConfigError::unless_in("zoom", settings.zoom, 1..=8)?;
        ConfigError::unless_in("gain", settings.gain, 0.1..=100.0)?;
        let name = file_part(setup.camera_name().unwrap_or(&setup.instance));
        setup.claim_file(None, &format!("{FOLDER}/{name}_*.png"))?;
        Ok(Self {
            settings,
            instance: setup.instance.clone(),
            name,
            out_dir: setup.out_dir.clone(),
            held: VecDeque::new(),
            early: VecDeque::new(),
            n_drawn: 0,
            n_unanswered: 0,
            report: Report::default(),
            fault: None,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(image) = io.take(&IMAGE) {
            self.take_image(image.stamp, image.value);
        }
        while let Some(features) = io.take(&FEATURES) {
            self.take_features(features.stamp, features.value);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let n_unanswered = self.n_unanswered + self.held.len() as u64;
        if n_unanswered > 0 {
            let pictures = if n_unanswered == 1 { "1 picture was" } else { &format!("{n_unanswered} pictures were") };
            report.remark(format!(
                "{}: {pictures} not drawn: no features came for it, which is normal while a scale waits for its target",
                self.instance
            ));
        }
        report.files.append(&mut self.report.files);
        self.fault.take().map_or(Ok(()), |fault| Err(NodeError::input(fault)))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Point2};

    use super::*;

    fn settings(every_n: u64, max_pictures: u64) -> ExportOverlaySettings {
        ExportOverlaySettings { every_n, max_pictures, zoom: 2, gain: 1.0 }
    }

    fn stamp(sequence: u64) -> Stamp {
        Stamp { sequence, ..Stamp::default() }
    }

    fn picture() -> Arc<Image> {
        Arc::new(Image { width: 40, height: 30, pixels: vec![20; 1200], ..Image::default() })
    }

    fn found(points: &[(f64, f64)]) -> Arc<Features> {
        labelled(points, &[])
    }

    /// The first features have these labels, the others none.
    fn labelled(points: &[(f64, f64)], labels: &[u32]) -> Arc<Features> {
        let feature = |(at, &(x, y)): (usize, &(f64, f64))| Feature {
            centre: Point2::new(x, y),
            covariance: Matrix2::identity(),
            area: 9,
            peak: 99,
            label: labels.get(at).copied(),
        };
        Arc::new(Features { camera: CameraId(0), list: points.iter().enumerate().map(feature).collect() })
    }

    struct Bench {
        folder: tempfile::TempDir,
        node: ExportOverlay,
    }

    fn bench(settings: ExportOverlaySettings) -> Bench {
        let folder = tempfile::tempdir().unwrap();
        let setup = Setup { out_dir: Some(folder.path().to_owned()), ..Setup::for_tests() };
        Bench { node: ExportOverlay::new(settings, &setup).unwrap(), folder }
    }

    impl Bench {
        /// File names, and how many pixels of each are of the rings' colour.
        fn finish(mut self) -> Vec<(String, usize)> {
            let mut report = Report::default();
            self.node.finish(&mut report).unwrap();
            let rings = |name: &PathBuf| {
                let image = image::open(self.folder.path().join(name)).unwrap().into_rgb8();
                assert_eq!(image.dimensions(), (80, 60));
                image.pixels().filter(|it| it.0 == COLOUR).count()
            };
            report.files.iter().map(|it| (it.display().to_string(), rings(it))).collect()
        }
    }

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<ExportOverlay>("every_n = 7");
    }

    #[test]
    fn every_nth_picture_is_drawn_with_its_own_features() {
        let mut bench = bench(settings(3, 100));
        for sequence in 0..7 {
            bench.node.take_image(stamp(sequence), picture());
            let points = [(20.0, 15.0), (8.0, 8.0)];
            bench.node.take_features(stamp(sequence), found(&points[..usize::from(sequence == 3)]));
        }
        let files = bench.finish();
        let names: Vec<&str> = files.iter().map(|it| it.0.as_str()).collect();
        assert_eq!(names, [0, 3, 6].map(|it| format!("overlay/test.node_{it:06}.png")));
        assert!(files[0].1 == 0 && files[1].1 > 30 && files[2].1 == 0, "{files:?}");
    }

    #[test]
    fn features_without_a_label_are_gray_only_beside_labelled_ones() {
        let points = [(9.0, 15.0), (30.0, 15.0)];
        let drawn = |labels: &[u32]| {
            let mut bench = bench(settings(1, 1));
            bench.node.take_image(stamp(0), picture());
            bench.node.take_features(stamp(0), labelled(&points, labels));
            let image = image::open(bench.folder.path().join("overlay/test.node_000000.png")).unwrap().into_rgb8();
            // Pixels of a colour around each point; the picture is drawn at twice its size.
            points.map(|(x, _)| {
                let columns = (2.0 * x) as u32 - 16..(2.0 * x) as u32 + 18;
                let count = |colour: [u8; 3]| {
                    image.enumerate_pixels().filter(|(u, _, it)| columns.contains(u) && it.0 == colour).count()
                };
                [count(COLOUR) > 30, count(UNLABELLED) > 30]
            })
        };
        assert_eq!(drawn(&[5]), [[true, false], [false, true]], "the first one has a label");
        assert_eq!(drawn(&[5, 6]), [[true, false]; 2], "both have labels");
        assert_eq!(drawn(&[]), [[true, false]; 2], "no feature has a label");
    }

    #[test]
    fn features_may_be_late_early_or_never_come() {
        let mut bench = bench(settings(1, 100));
        bench.node.take_features(stamp(2), found(&[(20.0, 15.0)]));
        (0..9).for_each(|sequence| bench.node.take_image(stamp(sequence), picture()));
        assert!(bench.node.held.len() <= HELD);
        bench.node.take_features(stamp(7), found(&[(20.0, 15.0)]));
        let files = bench.finish();
        assert_eq!(
            files.iter().map(|it| it.0.as_str()).collect::<Vec<_>>(),
            [2, 7].map(|it| format!("overlay/test.node_{it:06}.png"))
        );
        assert!(files.iter().all(|it| it.1 > 30), "{files:?}");
    }

    #[test]
    fn number_of_pictures_is_bounded() {
        let mut bench = bench(settings(1, 3));
        for sequence in 0..50 {
            bench.node.take_image(stamp(sequence), picture());
            bench.node.take_features(stamp(sequence), found(&[]));
        }
        assert_eq!(bench.finish().len(), 3);
    }

    #[test]
    fn folder_that_cannot_be_written_is_named() {
        let mut bench = bench(settings(1, 3));
        fs::write(bench.folder.path().join(FOLDER), "in the way").unwrap();
        bench.node.take_image(stamp(0), picture());
        bench.node.take_features(stamp(0), found(&[]));
        let complaint = bench.node.finish(&mut Report::default()).unwrap_err().message;
        assert!(complaint.contains("overlay"), "{complaint}");
    }
}
