//! How well painted marks are tracked, recovered and filled in: against the truth of the simulated world.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;

use foveate_estimation::statistics::percentile;
use foveate_messages::{CameraId, Feature, Features, Marks};
use foveate_node::{
    ConfigError, Figures, Io, Node, NodeError, Ports, Purpose, Report, Role, Setup, Time, figures, ports,
};
use foveate_scene::calibration::Calibration;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::table::save_table;
use crate::head::HeadMotion;
use crate::painted::Painted;
use crate::score::marks::{InView, MarkObservationTrack, MarkTrack, Names, ReportedMark};
use crate::score::warmup::Warmup;
use crate::truth::TrueCamera;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    MOTION: In<HeadMotion> = latest("motion").many().optional();
    FEATURES: In<Features> = each("features").many().optional();
    MARKS: In<Marks> = each("marks");
    SHAPE: In<Marks> = each("shape").optional();
    COMPARED: In<Marks> = each("compared").optional();
}

figures! {
    "pair_distance_mm.{median,p95,max}([compared])": mm, low, "Deviation of the distance of two marks from its mean, over the 60 pairs, 15 to 80 mm apart, whose true distance changes least [Davis 2002 Fig. 64]; with [compared] of the marks that come in there" => "pairs of marks that keep their distance, off their mean";
    "group_distance_mm.{median,p95,max}([compared])": mm, low, "Deviation of distances from their means within four marks, one and the three nearest to it, whose true distances change least: the six pairs below the eye of [Davis 2002 §5.5]";
    "pair_error_mm.{median,p95,max}([compared])": mm, low, "Error of the distance of two measured marks 15 to 80 mm apart; pairs seen together in less than a fifth of the frames are left out";
    "mark_identity_errors([compared])": count, low, "Measured samples more than 4 mm off their own true mark and closer to another one";
    "marks_extra([compared])": count, low, "Names given to what is no mark, or a second time to one" => "names given to what is no mark, or a second time to one";
    "marks_extra.{measured,filled}([compared])": count, low, "Samples of these labels, over all frames: no other figure counts them";
    "marks_measured([compared])": count, neither, "Measured samples of labels that are a true mark, over all frames";
    "face_mm.{median,p95}": mm, low, "Distance of all marks, measured and filled, from the truth, once the rigid motion of the frame is taken off" => "all marks off the truth, motion of the head taken off";
    "face_world_mm.{median,p95}": mm, low, "Distance of all marks, measured and filled, from the truth, in the world: with what the poses of the pan-tilt heads and the calibration are off";
    "filled_mm.{median,p95}": mm, low, "Distance of filled marks from the truth, once the rigid motion of the frame is taken off" => "filled marks off the truth";
    "filled_in_view_mm.{median,p95}": mm, low, "The same of those filled marks that two cameras or more could see, from 72° off their normal at most: marks that were not found, rather than hidden";
    "filled_in_view": count, low, "Filled samples of marks that two cameras or more could see, over all frames";
    "filled_sigmas.rms": sigmas, neither, "Error of filled marks in their stated standard deviations; 1: as large as stated";
    "filled_sigmas.{sure_half,vague_half}": sigmas, neither, "The same of the half of them with the smaller stated standard deviations, and of the other half";
    "filled": count, neither, "Filled samples that were compared, over all frames";
    "frames_with_all_marks": share, high, "Frames with every true mark, measured or filled" => "frames with every mark, measured or filled";
    "frames_with_all_measured": share, high, "Frames with every true mark measured";
    "frames_out_of_distribution": share, low, "Frames whose out-of-distribution score is above 0.5";
    "marks_found": count, neither, "Marks that pictures reported under the label of a true mark";
    "marks_false_positives": count, low, "Of these, those farther than wrong_px from where their mark truly is" => "marks reported where they are not";
    "marks_false_positives.per_10000": ratio, low, "The same for 10000 marks found";
    "mark_px.{median,p95}": px, low, "Distance of the other marks found from where they truly are";
}

const TABLE_FILE: &str = "face_score.csv";
const WRONG_FILE: &str = "marks_wrong.csv";
const FILLED_FILE: &str = "marks_filled.csv";
/// A mark that is seen at a flatter angle than this, from its normal, is a line: no camera finds it [°].
const MOST_OBLIQUE_DEG: f64 = 72.0;
/// A dot this close to where a mark truly is is that mark's [px].
const DOT_PX: f64 = 1.5;
/// Moments whose dots are remembered until the shape of that moment comes.
const MOMENTS: usize = 16;

/// Settings of [`MarkScore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct MarkScoreSettings {
    /// Session time at which scoring begins, such as after the capture of the model; earlier samples still count for the matching of labels [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
    /// A mark reported in a picture farther than this from where it truly is was reported wrongly: a third of the distance between marks [px].
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub wrong_px: f64,
    /// Whether errors over time are saved as `face_score.csv`, marks that were reported where they are not as `marks_wrong.csv`, and each filled mark as `marks_filled.csv` [–].
    pub write: bool,
}

impl Default for MarkScoreSettings {
    fn default() -> Self {
        Self { start_s: 0.0, wrong_px: 4.0, write: true }
    }
}

/// Compares marks with those truly painted on a person in a simulated world. Each label is matched to the true mark that it is mostly closest to.
///
/// What it reports: the figures declared for `sim.mark_score`.
pub struct MarkScore {
    settings: MarkScoreSettings,
    calibration: Arc<Calibration>,
    folder: Option<PathBuf>,
    /// All of the session, for who is who; what is scored; the same of the model, and of the marks to compare with.
    whole: MarkTrack,
    marks: MarkTrack,
    shape: MarkTrack,
    compared: MarkTrack,
    reported: MarkObservationTrack,
    /// Of the last moments: by true mark, how many pictures had a dot there.
    dots: VecDeque<(Time, Vec<u8>)>,
    n_true: usize,
    warmup: Warmup,
}

impl Node for MarkScore {
    const TYPE: &'static str = "sim.mark_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares painted marks with the truth: distances, identities, filled-in marks";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = MarkScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: MarkScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        ConfigError::unless_in("wrong_px", settings.wrong_px, 0.1..=1000.0)?;
        if settings.write {
            setup.claim_file(Some("write"), TABLE_FILE)?;
            setup.claim_file(Some("write"), WRONG_FILE)?;
            setup.claim_file(Some("write"), FILLED_FILE)?;
        }
        let folder = setup.out_dir.clone().filter(|_| settings.write && setup.purpose == Purpose::Run);
        Ok(Self {
            settings,
            calibration: Arc::clone(&setup.calibration),
            folder,
            whole: MarkTrack::default(),
            marks: MarkTrack::default(),
            shape: MarkTrack::default(),
            compared: MarkTrack::default(),
            reported: MarkObservationTrack::default(),
            dots: VecDeque::new(),
            n_true: 0,
            warmup: Warmup::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let world = io.latest(&WORLD).map(|it| it.value.clone());
        let truth = |time: Time| world.as_ref().and_then(|it| it.painted(time));
        let (warmup, start_s) = (&mut self.warmup, self.settings.start_s);
        let mut is_scored = |time: Time| warmup.is_scored(time, start_s);
        if let Some(marks) = io.take(&MARKS) {
            if let Some(painted) = truth(marks.value.time) {
                self.n_true = painted.marks.len();
                if is_scored(marks.value.time) {
                    self.marks.add(&marks.value, painted.marks.clone(), Vec::new());
                }
                self.whole.add(&marks.value, painted.marks, Vec::new());
            }
        } else if let Some(marks) = io.take(&SHAPE) {
            if let Some(painted) = truth(marks.value.time).filter(|_| is_scored(marks.value.time)) {
                let in_view = self.in_view(io, &painted, marks.value.time);
                self.shape.add(&marks.value, painted.marks, in_view);
            }
        } else if let Some(marks) = io.take(&COMPARED) {
            if let Some(painted) = truth(marks.value.time).filter(|_| is_scored(marks.value.time)) {
                self.compared.add(&marks.value, painted.marks, Vec::new());
            }
        } else if let Some(features) = io.take(&FEATURES)
            && is_scored(features.stamp.time)
            && let Some(painted) = truth(features.stamp.time)
            && let Some(camera) = self.camera(io, features.value.camera, features.stamp.time)
        {
            self.count_dots(&painted, &camera, &features.value.list, features.stamp.time);
            for feature in &features.value.list {
                let Some(label) = feature.label else { continue };
                let off = |mark| camera.project(mark).map_or(f32::NAN, |it| (it - feature.centre).norm() as f32);
                let distances = painted.marks.iter().map(off).collect();
                let (time, camera) = (features.stamp.time, features.value.camera);
                self.reported.add(ReportedMark { time, camera, label, distances });
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let names = self.whole.names();
        if let Some(sentence) = self.warmup.remark(self.settings.start_s) {
            report.remark(format!("marks: {sentence}"));
        } else if names.is_empty() {
            report.remark("No mark was recovered, or no person with painted marks was there: nothing was scored.");
        }
        self.marks.report_distances(&names, "", report);
        if self.compared != MarkTrack::default() {
            // Their names need not be the same.
            self.compared.report_distances(&self.compared.names(), "[compared]", report);
        }
        if self.shape != MarkTrack::default() {
            self.shape.report_shape(&names, self.n_true, report);
        }
        self.report_observations(&names, report);
        let Some(folder) = &self.folder else { return Ok(()) };
        let track = if self.shape == MarkTrack::default() { &self.marks } else { &self.shape };
        let name = |id: CameraId| {
            self.calibration.cameras.get(usize::from(id.0)).map_or_else(String::new, |it| it.name.clone())
        };
        let wrong = self.reported.wrong_rows(&names, self.settings.wrong_px, name);
        let tables = [
            (TABLE_FILE, MarkTrack::HEADING, track.rows(&names)),
            (WRONG_FILE, MarkObservationTrack::HEADING, wrong),
            (FILLED_FILE, MarkTrack::FILLED_HEADING, self.shape.filled_rows(&names)),
        ];
        for (file, heading, rows) in tables {
            save_table(folder, file, heading, &rows, report)?;
        }
        Ok(())
    }
}

impl MarkScore {
    /// A camera as it truly stands.
    fn camera(&self, io: &Io<'_>, id: CameraId, time: Time) -> Option<TrueCamera> {
        let calibrated = self.calibration.cameras.get(usize::from(id.0))?;
        let at_rest = io.latest(&WORLD)?.value.camera(Some(&calibrated.name), &calibrated.camera);
        let motion = io.latest_of_each(&MOTION).map(|it| it.value).find(|it| it.camera() == id);
        Some(match motion {
            Some(motion) => motion.camera_at(&at_rest, time),
            None => at_rest,
        })
    }

    /// Takes in where the dots of one picture are.
    fn count_dots(&mut self, painted: &Painted, camera: &TrueCamera, list: &[Feature], time: Time) {
        if self.dots.back().is_none_or(|it| it.0 != time) {
            if self.dots.len() == MOMENTS {
                self.dots.pop_front();
            }
            self.dots.push_back((time, vec![0; painted.marks.len()]));
        }
        let Some((_, counts)) = self.dots.back_mut() else { return };
        for (count, place) in counts.iter_mut().zip(&painted.marks) {
            let pixel = camera.project(place);
            let is_there = pixel.is_some_and(|it| list.iter().any(|dot| (dot.centre - it).norm() < DOT_PX));
            *count += u8::from(is_there);
        }
    }

    /// By true mark, in how many pictures of the cameras on heads it could be found.
    fn in_view(&self, io: &Io<'_>, painted: &Painted, time: Time) -> Vec<InView> {
        let cameras = io.latest_of_each(&MOTION).filter_map(|it| self.camera(io, it.value.camera(), time));
        let mut in_view = vec![InView::default(); painted.marks.len()];
        if let Some((_, dots)) = self.dots.iter().find(|it| it.0 == time) {
            in_view.iter_mut().zip(dots).for_each(|(it, dots)| it.dots = *dots);
        }
        for camera in cameras {
            let eye = camera.centre();
            for (mark, (place, normal)) in painted.marks.iter().zip(&painted.normals).enumerate() {
                let is_steep = normal.dot(&(eye - place).normalize()) > MOST_OBLIQUE_DEG.to_radians().cos();
                in_view[mark].cameras += u8::from(is_steep && camera.sees(place).is_some() && painted.sees(&eye, mark));
            }
        }
        in_view
    }

    fn report_observations(&self, names: &Names, report: &mut Report) {
        let (all, wrong) = self.reported.wrong(names, self.settings.wrong_px);
        let wrong = wrong.count();
        if all > 0 {
            report.figure("marks_found", all as f64);
            report.figure("marks_false_positives", wrong as f64);
            report.figure("marks_false_positives.per_10000", wrong as f64 * 1e4 / all as f64);
            let right = self.reported.right(names, self.settings.wrong_px);
            for (which, percent) in [("median", 50.0), ("p95", 95.0)] {
                report.figure(format!("mark_px.{which}"), percentile(&right, percent).unwrap_or(f64::NAN));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law() {
        check_node::<MarkScore>("");
        check_node::<MarkScore>("start_s = 12\nwrong_px = 3\nwrite = false");
    }

    #[test]
    fn settings_out_of_range_are_refused() {
        let refused = |settings| MarkScore::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting);
        let wrong = MarkScoreSettings { wrong_px: f64::NAN, ..MarkScoreSettings::default() };
        assert_eq!(refused(wrong).as_deref(), Some("wrong_px"));
        let start = MarkScoreSettings { start_s: -1.0, ..MarkScoreSettings::default() };
        assert_eq!(refused(start).as_deref(), Some("start_s"));
    }
}
