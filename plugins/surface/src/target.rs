//! `surface.target`: finds a target of numbered columns of dark rectangles in the pictures of one camera.

use foveate::imaging::ImageView;
use foveate::imaging::column_target::{DarkPatch, TargetFound, TargetPattern, find_target};
use foveate::imaging::plane::{self, Channel};
use foveate::prelude::*;
use nalgebra::Matrix2;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    pub(crate) fn declared_ports;
    IMAGE: In<Image> = each("image");
    FEATURES: Out<Features> = "features";
}

figures! {
    "target.pictures.*": count, neither, "Pictures of the camera that were searched for the target";
        "target.found.*": count, high, "Pictures in which the target was found";
        "target.rectangles.*": count, high, "Labelled rectangles, over all pictures of the camera";
        "target.others.*": count, low, "Dark rectangles of incomplete columns: sent without a label";
}

/// Settings of [`TargetDetector`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct TargetSettings {
    /// Rectangles in a column [–]
    #[schemars(range(min = 4, max = 100))]
    pub rows: usize,
    /// Columns all around, numbered from 1 and from left to right as seen from outside [–]
    #[schemars(range(min = 3, max = 200))]
    pub columns: usize,
    /// Number of the leftmost column that a camera sees, where its number is illegible: `[{ camera = "201", column = 1 }]` [–]
    pub leftmost: Vec<LeftmostColumn>,
}

/// The leftmost column of a camera's view.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct LeftmostColumn {
    /// The camera's name [–]
    pub camera: String,
    /// The column's number, from 1 [–]
    #[schemars(range(min = 1, max = 200))]
    pub column: usize,
}

impl Default for TargetSettings {
    fn default() -> Self {
        Self { rows: 20, columns: 14, leftmost: Vec::new() }
    }
}

/// A rectangle's centre: its rim is some 60 pixels of which each says it to a fraction [px].
const SIGMA_PX: f64 = 0.1;

/// Pictures in, centres of rectangles out: that in row r (0 at the top) of column c has the label (c − 1) · `rows` + r; those of incomplete columns have none.
pub struct TargetDetector {
    settings: TargetSettings,
    camera: Option<CameraId>,
    name: String,
    gray: Vec<u8>,
    pictures: u64,
    found: u64,
    rectangles: u64,
    others: u64,
    why: Option<String>,
    /// The leftmost column that was said, and the one that its number says.
    otherwise: Option<[usize; 2]>,
}

impl Node for TargetDetector {
    const TYPE: &'static str = "surface.target";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Finds numbered columns of dark rectangles, such as those of a calibration cylinder";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TargetSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TargetSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("rows", settings.rows, 4..=100)?;
        ConfigError::unless_in("columns", settings.columns, 3..=200)?;
        for LeftmostColumn { camera: name, column: first } in &settings.leftmost {
            let known =
                setup.calibration.cameras.is_empty() || setup.calibration.cameras.iter().any(|it| it.name == *name);
            if !known || !(1..=settings.columns).contains(first) {
                return Err(ConfigError::at(
                    "leftmost",
                    format_args!(
                        "found column {first} of `{name}`, expected a camera of the calibration and a column from 1 to {}",
                        settings.columns
                    ),
                ));
            }
        }
        Ok(Self {
            camera: setup.camera,
            name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            settings,
            gray: Vec::new(),
            pictures: 0,
            found: 0,
            rectangles: 0,
            others: 0,
            why: None,
            otherwise: None,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(image) = io.take(&IMAGE) else { return Ok(()) };
        self.pictures += 1;
        match self.find(&image.value) {
            Ok(list) => {
                self.found += 1;
                let camera = self.camera.unwrap_or(image.value.camera);
                io.emit(&FEATURES, image.stamp, Features { camera, list });
            }
            Err(why) => {
                io.gap(&FEATURES, image.time(), &why);
                self.why.get_or_insert(why);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = &self.name;
        report.figure(format!("target.pictures.{name}"), self.pictures as f64);
        report.figure(format!("target.found.{name}"), self.found as f64);
        report.figure(format!("target.rectangles.{name}"), self.rectangles as f64);
        report.figure(format!("target.others.{name}"), self.others as f64);
        if let Some(why) = self.why.take().filter(|_| self.found == 0) {
            report.remark(format!("{name} saw no target: {why}"));
        }
        if let Some([said, read]) = self.otherwise {
            report.remark(format!(
                "the numbers above the columns that {name} sees are legible: the leftmost is column {read}, but column {said} by `leftmost`, which was used: expected both to agree, \
                 or no `leftmost` for this camera"
            ));
        }
        Ok(())
    }
}

impl TargetDetector {
    fn find(&mut self, image: &Image) -> Result<Vec<Feature>, String> {
        let pixels = match image.format {
            PixelFormat::Gray8 => &image.pixels,
            PixelFormat::Rgb8 => {
                plane::extract(Channel::Luma, &image.pixels, &mut self.gray).map_err(|it| it.to_string())?;
                &self.gray
            }
        };
        let view = ImageView::new(pixels, image.width as usize, image.height as usize).map_err(|it| it.to_string())?;
        let TargetSettings { rows, columns, leftmost } = &self.settings;
        let pattern = TargetPattern { rows: *rows, columns: *columns };
        let said = leftmost.iter().find(|it| it.camera == self.name).map(|it| it.column);
        let found = find_target(&view, pattern, said).map_err(|it| it.to_string())?;
        if let Some(said) = said
            && let Ok(read) = find_target(&view, pattern, None)
            && let [Some(named), Some(read)] = [&found, &read].map(column_of_first)
            && named != read
        {
            self.otherwise = Some([said, (said + columns + read - named - 1) % columns + 1]);
        }
        self.rectangles += found.labelled.len() as u64;
        self.others += found.others.len() as u64;
        let feature = |patch: &DarkPatch, label: Option<u32>| Feature {
            centre: image.window.in_camera(&patch.centre),
            covariance: Matrix2::identity() * SIGMA_PX * SIGMA_PX,
            area: patch.area,
            peak: 0,
            label,
        };
        let labelled =
            found.labelled.iter().map(|it| feature(&it.patch, Some(((it.column - 1) * rows + it.row) as u32)));
        Ok(labelled.chain(found.others.iter().map(|it| feature(it, None))).collect())
    }
}

/// The column of the rectangle farthest left.
fn column_of_first(found: &TargetFound) -> Option<usize> {
    let first = found.labelled.iter().min_by(|a, b| a.patch.centre.x.total_cmp(&b.patch.centre.x));
    first.map(|it| it.column)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<TargetDetector>("rows = 12\ncolumns = 10");
    }

    #[test]
    fn a_picture_without_a_target_is_a_gap_that_says_what_was_seen() {
        let mut bench = NodeBench::<TargetDetector>::new(TargetSettings::default()).unwrap();
        let image = Image { width: 64, height: 64, pixels: vec![200; 64 * 64], ..Image::default() };
        bench.feed(&IMAGE, Time::ZERO, image).unwrap();
        let gaps = bench.gaps(&FEATURES);
        assert!(
            gaps[0].reason.contains("0 dark rectangles") && gaps[0].reason.contains("columns of 20"),
            "{}",
            gaps[0].reason
        );
        assert!(bench.finish().unwrap().remarks[0].contains("saw no target"));
    }

    #[test]
    fn a_leftmost_column_that_legible_numbers_contradict_is_told() {
        let test = "surface.target on a real target";
        let Some(folder) = foveate_testkit::data_dir_or_skip(test, "s12_multidic_speckle") else { return };
        let picture = image::open(folder.join("calibration_object_201.jpg")).unwrap().into_luma8();
        let (width, height) = picture.dimensions();
        let image = Image { width, height, pixels: picture.into_raw(), ..Image::default() };
        let name = Setup::for_tests().instance;
        let remarks = |leftmost: &[usize]| {
            let leftmost = leftmost.iter().map(|it| LeftmostColumn { camera: name.clone(), column: *it }).collect();
            let mut bench =
                NodeBench::<TargetDetector>::new(TargetSettings { leftmost, ..TargetSettings::default() }).unwrap();
            bench.feed(&IMAGE, Time::ZERO, image.clone()).unwrap();
            let labels = bench.outputs(&FEATURES).remove(0).value.list.iter().filter_map(|it| it.label).min();
            (labels.unwrap() as usize / 20 + 1, bench.finish().unwrap().remarks)
        };
        let (least, none) = remarks(&[]);
        assert!(none.is_empty(), "{none:?}");
        // The number that is read is no contradiction; whatever it is, one of these two is another one.
        let said: Vec<String> = [5, 6].iter().flat_map(|it| remarks(&[*it]).1).collect();
        assert!(!said.is_empty() && said.iter().all(|it| it.contains("are legible")), "{least}: {said:?}");
        let read: usize =
            said[0].split("leftmost is column ").nth(1).unwrap().split(',').next().unwrap().parse().unwrap();
        assert!(remarks(&[read]).1.is_empty() && remarks(&[read]).0 == least, "{read}");
    }
}
