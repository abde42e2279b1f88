//! `export.mark_pictures`: figures of a painted surface's marks.
//!
//! | file | what it shows |
//! |---|---|
//! | `face_way.svg` | the marks of some moments over one another in the world [Davis 2002 Fig. 63] |
//! | `face_distances.svg` | the distances of two pairs of marks over time, less their means [Davis 2002 Fig. 64] |
//! | `face_counts.svg` | how many marks were measured and filled in, how well the model fits |
//! | `face_stills.svg` | the surface at some moments, from the front [Davis 2002 Fig. 62, 70] |

mod course;
mod draw;

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::row_file::write_pictures;
use course::Course;

ports! {
    MARKS: In<Marks> = each("marks");
    SHAPE: In<Marks> = each("shape").optional();
    COMPARED: In<Marks> = each("compared").optional();
}

/// Settings of [`ExportMarkPictures`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportMarkPicturesSettings {
    /// Prefix of the file names [–].
    pub prefix: String,
    /// Earlier moments are not drawn, where any later ones exist [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
}

impl Default for ExportMarkPicturesSettings {
    fn default() -> Self {
        Self { prefix: "face_".to_owned(), start_s: 0.0 }
    }
}

/// Measured marks, marks completed by a model (`shape`), and others to compare their distances with, into four SVG files. Long runs
/// are thinned.
pub struct ExportMarkPictures {
    settings: ExportMarkPicturesSettings,
    name: String,
    /// Contents of the figures: marks, shape, and marks to compare with.
    shown: [Course; 3],
    /// The same before `start_s`, while nothing has come after it.
    early: [Course; 3],
    out_dir: Option<std::path::PathBuf>,
}

impl Node for ExportMarkPictures {
    const TYPE: &'static str = "export.mark_pictures";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Draws paths and distances of painted marks, and which were filled in (SVG)";
    type Settings = ExportMarkPicturesSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportMarkPicturesSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        if crate::csv::file_part(&settings.prefix) != settings.prefix {
            let fault = format!("found `{}`, expected letters, digits, `-`, `_` and `.`", settings.prefix);
            return Err(ConfigError::at("prefix", fault));
        }
        setup.claim_file(Some("prefix"), &format!("{}way.svg", settings.prefix))?;
        Ok(Self {
            settings,
            name: setup.scale.clone(),
            shown: Default::default(),
            early: Default::default(),
            out_dir: setup.out_dir.clone(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let start_s = self.settings.start_s;
        for (index, port) in [&MARKS, &SHAPE, &COMPARED].into_iter().enumerate() {
            let Some(marks) = io.take(port) else { continue };
            if marks.value.time.as_s() >= start_s {
                self.early = Default::default();
                self.shown[index].push(&marks.value);
            } else if self.shown.iter().all(|it| it.moments.is_empty()) {
                self.early[index].push(&marks.value);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        if self.shown.iter().all(|it| it.moments.is_empty())
            && let Some(last_s) = self.early.iter().flat_map(|it| &it.moments).map(|it| it.time_s).reduce(f64::max)
        {
            report.remark(format!(
                "the figures `{}*.svg` show moments before `start_s` = {} s, as there are none after it (the last marks are at {last_s:.2} s)",
                self.settings.prefix, self.settings.start_s
            ));
            self.shown = std::mem::take(&mut self.early);
            self.name += &format!(" (all before start_s = {} s)", self.settings.start_s);
        }
        match &self.out_dir {
            None => Ok(()),
            Some(folder) => {
                report.open_first = Some(format!("{}stills.svg", self.settings.prefix).into());
                write_pictures(folder, &self.settings.prefix, &self.draw(), report)
            }
        }
    }
}

impl ExportMarkPictures {
    fn draw(&self) -> [(&'static str, String); 4] {
        let [marks, shape, compared] = &self.shown;
        let whole = if shape.moments.is_empty() { marks } else { shape };
        [
            ("way.svg", draw::way(whole, &self.name)),
            ("distances.svg", draw::distances(marks, compared, &self.name)),
            ("counts.svg", draw::counts(whole, &self.name)),
            ("stills.svg", draw::stills(whole, &self.name)),
        ]
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;
    use nalgebra::{Isometry3, Matrix3, Point3, Vector3};

    use super::*;

    fn marks(time_s: f64, n: u32) -> Marks {
        let mark = |label: u32| {
            let (x, z) = (f64::from(label % 6) * 0.02 - 0.05, f64::from(label / 6) * 0.02 - 0.05);
            let open = if label == 0 { 0.004 * (5.0 * time_s).sin() } else { 0.0 };
            Mark {
                label,
                position: Point3::new(x, 0.08 - 8.0 * (x * x + z * z), z + open),
                covariance: Matrix3::identity() * 1e-8,
                cameras: CameraSet::default(),
                provenance: if label % 7 == 3 { Provenance::Filled } else { Provenance::Measured },
            }
        };
        let world_from_marks = Isometry3::new(Vector3::new(time_s * 0.1, 0.0, 1.6), Vector3::z() * 0.3 * time_s.sin());
        Marks { time: Time::from_s(time_s), world_from_marks, list: (0..n).map(mark).collect(), ..Marks::default() }
    }

    fn node(folder: &std::path::Path) -> ExportMarkPictures {
        let setup = Setup { out_dir: Some(folder.to_owned()), scale: "face".to_owned(), ..Setup::for_tests() };
        ExportMarkPictures::new(ExportMarkPicturesSettings::default(), &setup).unwrap()
    }

    #[test]
    fn node_keeps_its_promises() {
        check_node::<ExportMarkPictures>("prefix = \"knee-\"\nstart_s = 3.0");
    }

    #[test]
    fn pictures_are_whole_with_many_moments_with_few_marks_and_with_nothing() {
        for (moments, n) in [(9000, 36), (3, 2), (0, 0)] {
            let folder = tempfile::tempdir().unwrap();
            let mut node = node(folder.path());
            for moment in 0..moments {
                let marks = marks(f64::from(moment) / 30.0, n);
                node.shown[0].push(&marks);
                node.shown[1].push(&marks);
            }
            let mut report = Report::default();
            node.finish(&mut report).unwrap();
            assert_eq!(report.files.len(), 4);
            for file in &report.files {
                let text = std::fs::read_to_string(folder.path().join(file)).unwrap();
                assert!(text.starts_with("<svg") && text.ends_with("</svg>\n") && text.len() < 1_500_000);
                assert!(!text.contains("NaN") && !text.contains("inf"), "{}", file.display());
            }
        }
    }

    #[test]
    fn the_pair_that_changes_most_is_drawn_and_faces_are_seen_from_the_front() {
        let folder = tempfile::tempdir().unwrap();
        let mut node = node(folder.path());
        (0..60).for_each(|it| node.shown[0].push(&marks(f64::from(it) / 30.0, 36)));
        let text = draw::distances(&node.shown[0], &node.shown[2], "face");
        assert!(text.contains("marks 0–") && text.contains("distance changes most"), "mark 0 moves");
        let moment = &node.shown[0].moments[0];
        let front = course::Front::of(moment).unwrap();
        // The face looks along +y with z up: seen from before it, -x is to the right.
        let [right, up] = front.place(&Point3::new(-0.05, 0.0, 0.05));
        let [other, _] = front.place(&Point3::new(0.05, 0.0, 0.05));
        assert!(right > other && up > 0.0, "{right} {other} {up}");
    }

    #[test]
    fn a_panel_without_a_fit_says_so_and_has_a_plain_axis() {
        let mut course = Course::default();
        (0..60).for_each(|it| course.push(&marks(f64::from(it) / 30.0, 36)));
        let svg = draw::counts(&course, "face");
        assert!(svg.contains("no shape was fitted in this run") && !svg.contains("0.0010"), "{svg}");
        let fit = foveate::messages::ShapeFit { rms: 0.001, out_of_distribution: 0.2, weights: Vec::new() };
        (60..90).for_each(|it| course.push(&Marks { fit: Some(fit.clone()), ..marks(f64::from(it) / 30.0, 36) }));
        let fitted = draw::counts(&course, "face");
        assert!(!fitted.contains("no shape was fitted"));
        assert!(
            fitted.contains("rms of the fit [mm]") && fitted.contains("out-of-distribution score [–]"),
            "an axis each"
        );
    }

    /// Places of the numbers along an axis: those of texts with this anchor [px], and what stands there.
    fn numbers(svg: &str, anchor: &str, key: &str) -> Vec<(f64, f64)> {
        let texts = svg.split("<text ").skip(1).filter(|it| it.contains(&format!("text-anchor=\"{anchor}\"")));
        let read = |it: &str| {
            let place = it.split(&format!("{key}=\"")).nth(1)?.split('"').next()?.parse().ok()?;
            let value = it.split('>').nth(1)?.split('<').next()?.replace('\u{2212}', "-").parse().ok()?;
            Some((place, value))
        };
        texts.filter_map(read).collect()
    }

    #[test]
    fn the_way_has_one_scale_along_all_axes_whatever_its_shape() {
        for reach in [Vector3::new(4.0, 0.05, 0.2), Vector3::new(0.1, 3.0, 0.3), Vector3::new(0.05, 0.05, 9.0)] {
            let mut course = Course::default();
            for step in 0..50 {
                let mut marks = marks(0.0, 36);
                marks.world_from_marks.translation.vector += reach * f64::from(step) / 50.0;
                course.push(&marks);
            }
            let svg = draw::way(&course, "face");
            let across = numbers(&svg, "middle", "x");
            let upwards = numbers(&svg, "end", "y");
            let scale = |it: &[(f64, f64)]| ((it[1].0 - it[0].0) / (it[1].1 - it[0].1)).abs();
            assert!(across.len() >= 2 && upwards.len() >= 2, "{reach}: {across:?} {upwards:?}");
            // Numbers next to one another may be of two axes; those of one axis tell its scale.
            let x = scale(&across);
            let is_same = upwards.windows(2).any(|it| (x / scale(it) - 1.0).abs() < 0.02);
            assert!(is_same, "{reach}: {x} px/m across, {upwards:?} up");
        }
    }

    #[test]
    fn a_run_that_ends_before_the_start_shows_what_there_was_and_says_so() {
        let folder = tempfile::tempdir().unwrap();
        let mut node = node(folder.path());
        node.settings.start_s = 13.0;
        (0..60).for_each(|it| node.early[0].push(&marks(f64::from(it) / 30.0, 36)));
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        assert!(report.remarks[0].contains("before `start_s` = 13 s") && report.remarks[0].contains("1.97 s"));
        let stills = std::fs::read_to_string(folder.path().join("face_stills.svg")).unwrap();
        assert!(stills.matches("<circle").count() > 8 * 30, "eight surfaces");
        let mut report = Report::default();
        let mut empty = self::node(folder.path());
        empty.finish(&mut report).unwrap();
        let stills = std::fs::read_to_string(folder.path().join("face_stills.svg")).unwrap();
        assert!(stills.contains("nothing to show"));
    }
}
