//! `export.mark_pictures`: what was recovered of a painted surface, as figures.
//!
//! | file | what it shows |
//! |---|---|
//! | `face_way.svg` | the marks of some moments over one another in the world [Davis 2002 Fig. 63] |
//! | `face_distances.svg` | the distances of two pairs of marks over time, less their means [Davis 2002 Fig. 64] |
//! | `face_counts.svg` | how many marks were measured and filled in, how well the model fits |
//! | `face_stills.svg` | the surface at some moments, from before it [Davis 2002 Fig. 62, 70] |

mod course;
mod draw;

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::row_file::write_pictures;
use course::Course;

const MARKS: In<Marks> = In::each(0, "marks");
const SHAPE: In<Marks> = In::each(1, "shape").optional();
const COMPARED: In<Marks> = In::each(2, "compared").optional();

/// Settings of [`ExportMarkPictures`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportMarkPicturesSettings {
    /// What the names of the files begin with [–].
    pub prefix: String,
    /// What happens before this session time is not drawn [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
}

impl Default for ExportMarkPicturesSettings {
    fn default() -> Self {
        Self { prefix: "face_".to_owned(), start_s: 0.0 }
    }
}

/// Marks as they were measured, as a model completed them (`shape`), and others to compare their distances with, into four SVG files. Long runs
/// are thinned.
pub struct ExportMarkPictures {
    settings: ExportMarkPicturesSettings,
    name: String,
    marks: Course,
    shape: Course,
    compared: Course,
    out_dir: Option<std::path::PathBuf>,
}

impl Node for ExportMarkPictures {
    const TYPE: &'static str = "export.mark_pictures";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Draws painted marks: their way, their distances, what was filled in, as SVG figures";
    type Settings = ExportMarkPicturesSettings;

    fn ports() -> Ports {
        Ports::new().input(&MARKS).input(&SHAPE).input(&COMPARED)
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
            marks: Course::default(),
            shape: Course::default(),
            compared: Course::default(),
            out_dir: setup.out_dir.clone(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let start_s = self.settings.start_s;
        let is_shown = |marks: &Marks| marks.time.as_s() >= start_s;
        for (port, course) in [(&MARKS, &mut self.marks), (&SHAPE, &mut self.shape), (&COMPARED, &mut self.compared)] {
            if let Some(marks) = io.take(port).filter(|it| is_shown(&it.value)) {
                course.push(&marks.value);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        match &self.out_dir {
            None => Ok(()),
            Some(folder) => write_pictures(folder, &self.settings.prefix, &self.draw(), report),
        }
    }
}

impl ExportMarkPictures {
    fn draw(&self) -> [(&'static str, String); 4] {
        let whole = if self.shape.moments.is_empty() { &self.marks } else { &self.shape };
        [
            ("way.svg", draw::way(whole, &self.name)),
            ("distances.svg", draw::distances(&self.marks, &self.compared, &self.name)),
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
                how: if label % 7 == 3 { How::Filled } else { How::Measured },
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
                node.marks.push(&marks);
                node.shape.push(&marks);
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
        (0..60).for_each(|it| node.marks.push(&marks(f64::from(it) / 30.0, 36)));
        let text = draw::distances(&node.marks, &node.compared, "face");
        assert!(text.contains("(changes most)") && text.contains(">0–"), "mark 0 moves");
        let moment = &node.marks.moments[0];
        let front = course::Front::of(moment).unwrap();
        // The face looks along +y with z up: seen from before it, -x is to the right.
        let [right, up] = front.place(&Point3::new(-0.05, 0.0, 0.05));
        let [other, _] = front.place(&Point3::new(0.05, 0.0, 0.05));
        assert!(right > other && up > 0.0, "{right} {other} {up}");
    }
}
