//! `painted_mark.tracker`: tracks the painted marks in the pictures of one camera.

mod agree;
mod corrections;
mod eye;
mod mark_tracker;
mod naming;
mod neighbours;
mod rows;
mod settings;
mod track;

use foveate::prelude::*;
use nalgebra::Point2;

pub use corrections::{Correction, read as read_corrections};
pub use mark_tracker::MarkTracker;
pub use settings::{CorrectionRow, TrackerSettings};

ports! {
    IMAGE: In<Image> = each("image");
    GUIDE: In<MarkGuide> = latest("guide").optional();
    CHOSEN: In<Features> = each("chosen").optional();
    FEATURES: Out<Features> = "features";
}

figures! {
        "tracker.pictures.*": count, neither, "Pictures of the camera that were searched";
        "tracker.named.mean.*": count, high, "Labelled marks in a picture, mean over all pictures";
        "tracker.unnamed.mean.*": count, neither, "Unlabelled dots in a picture, mean over all pictures";
        "tracker.track_frames.median.*": frames, high, "Pictures from the labelling of a mark to its loss, or to the end of the run";
        "tracker.losses.*": count, low, "Labelled marks that were not found again within patience_frames";
        "tracker.regained.*": count, neither, "Labelled marks that were found again after a loss";
        "tracker.namings.*": count, neither, "Dots that were labelled by the guide";
        "tracker.disputed.*": count, low, "Labels removed because other cameras contradicted them";
    "tracker.searches.*": count, neither, "Searches of a whole picture for new dots";
        "tracker.corrected.*": count, neither, "Corrections by hand that were applied";
    "tracker.corrections_missed.*": count, low, "Corrections by hand for pictures that never came, or had come before";
        "tracker.restarts.*": count, low, "Times that all tracks ended because the size of the picture changed";
        "tracker.pictures_blurred.*": count, low, "Pictures not used because most marks were lost at once, as in motion blur";
        "tracker.pictures_refused.*": count, low, "Pictures that could not be used: wrong size or pixels";
}

/// Pictures in, painted marks out [Davis 2002 §5.1]: with a label where it was chosen by hand or given by the guide, without one for
/// other dots. Doubtful marks are left out.
pub struct TrackerNode {
    mark_tracker: MarkTracker,
    /// Rows of `corrections` that have been taken.
    taken: Vec<CorrectionRow>,
    camera: Option<CameraId>,
    camera_name: String,
    /// Marks chosen by hand in pictures that are still to come.
    chosen: Vec<Chosen>,
    pool: Pool<Features>,
}

/// Marks chosen by hand in one picture: its time, labels and positions [px].
type Chosen = (Time, Vec<(u32, Point2<f64>)>);

/// Largest time between marks chosen by hand and their picture.
const SAME_PICTURE: Interval = Interval(1_000_000);

impl Node for TrackerNode {
    const TYPE: &'static str = "painted_mark.tracker";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str =
        "Tracks painted marks in one camera's pictures, chosen by hand or found automatically";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = TrackerSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: TrackerSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let mut corrections = match settings.marks.as_str() {
            "" => Vec::new(),
            text => read_marks(&setup.path("marks", text)?, setup)?,
        };
        let taken = settings.corrections.clone();
        corrections.extend(of_camera(&taken, setup.camera_name()));
        corrections.sort_by_key(|it| (it.frame, it.mark));
        let camera = setup.camera.and_then(|it| setup.calibration.cameras.get(usize::from(it.0)));
        Ok(Self {
            mark_tracker: MarkTracker::new(settings, corrections, camera.map(|it| it.camera.image_size[1]))?,
            taken,
            camera: setup.camera,
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            chosen: Vec::new(),
            pool: Pool::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(chosen) = io.take(&CHOSEN) {
            let named = chosen.value.list.iter().filter_map(|it| Some((it.label?, it.centre)));
            self.chosen.push((chosen.time(), named.collect()));
        }
        let Some(image) = io.take(&IMAGE) else { return Ok(()) };
        let time = image.time();
        for (chosen, marks) in self.chosen.extract_if(.., |it| it.0 <= time + SAME_PICTURE) {
            let is_of_this = chosen + SAME_PICTURE >= time;
            self.mark_tracker.choose(&marks, is_of_this.then_some(image.stamp.sequence));
        }
        let mut features = self.pool.take(Features::default);
        features.camera = self.camera.unwrap_or(image.value.camera);
        let camera = features.camera;
        let guide = io.latest(&GUIDE).map(|it| (it.value.time, it.value.of(camera)));
        let seen = self.mark_tracker.see(&image.value, image.stamp, guide, &mut features);
        let features = self.pool.share(features);
        match seen {
            Ok(()) => io.emit(&FEATURES, image.stamp, features),
            Err(reason) => io.gap(&FEATURES, image.time(), reason),
        }
        Ok(())
    }

    fn change(&mut self, settings: TrackerSettings) -> Result<(), ConfigError> {
        settings.check()?;
        let rows = settings.corrections.clone();
        let new: Vec<CorrectionRow> = rows.iter().filter(|it| !self.taken.contains(it)).cloned().collect();
        let camera = self.camera.map(|_| self.camera_name.as_str());
        self.mark_tracker.change(settings, &of_camera(&new, camera));
        self.taken = rows;
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.mark_tracker.report(&self.camera_name, report);
        Ok(())
    }
}

/// The rows of one camera; all where it has no name.
fn of_camera(rows: &[CorrectionRow], camera: Option<&str>) -> Vec<Correction> {
    let own = rows.iter().filter(|it| camera.is_none_or(|camera| it.camera == camera));
    own.map(CorrectionRow::correction).collect()
}

fn read_marks(path: &std::path::Path, setup: &Setup) -> Result<Vec<Correction>, ConfigError> {
    let refuse = |text: String| ConfigError::at("marks", format_args!("`{}`: {text}", path.display()));
    let text =
        foveate::diagnostics::file::read_text(path).map_err(|error| refuse(format!("cannot be read: {error}")))?;
    let known = |name: &str| setup.calibration.cameras.iter().any(|it| it.name == name);
    read_corrections(&text, setup.camera_name(), known).map_err(refuse)
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_testkit::check_node;
    use foveate_testkit::scene::ring_calibration;
    use nalgebra::Vector2;

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        check_node::<TrackerNode>("");
        check_node::<TrackerNode>("colour = [20, 40, 200]\nchecks = false\nreanchor = false\nwindow_px = 21");
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let setting = |change: fn(&mut TrackerSettings)| {
            let mut settings = TrackerSettings::default();
            change(&mut settings);
            TrackerNode::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting)
        };
        assert_eq!(setting(|_| ()), None);
        assert_eq!(setting(|it| it.radius_px = f64::NAN).as_deref(), Some("radius_px"));
        assert_eq!(setting(|it| it.min_contrast = 0.0).as_deref(), Some("min_contrast"));
        assert_eq!(setting(|it| it.window_px = 14).as_deref(), Some("window_px"));
        assert_eq!(setting(|it| it.window_px = 33).as_deref(), Some("window_px"));
        assert_eq!(setting(|it| it.levels = 0).as_deref(), Some("levels"));
        assert_eq!(setting(|it| it.reach_px = 1001).as_deref(), Some("reach_px"));
        assert_eq!(setting(|it| it.patience_frames = 5000).as_deref(), Some("patience_frames"));
        assert_eq!(setting(|it| it.readout_ms = -1.0).as_deref(), Some("readout_ms"));
        assert_eq!(setting(|it| it.min_correlation = 1.5).as_deref(), Some("min_correlation"));
        assert_eq!(setting(|it| it.back_px = 0.0).as_deref(), Some("back_px"));
        assert_eq!(setting(|it| it.jump_px = -1.0).as_deref(), Some("jump_px"));
        assert_eq!(setting(|it| it.name_px = f64::INFINITY).as_deref(), Some("name_px"));
        assert_eq!(setting(|it| it.search_every = 0).as_deref(), Some("search_every"));
        assert_eq!(setting(|it| it.max_marks = 0).as_deref(), Some("max_marks"));
        assert_eq!(setting(|it| it.marks = "/no/such.csv".into()).as_deref(), Some("marks"));
        let row = CorrectionRow { camera: "a".to_owned(), mark: 1, frame: 0, u_px: Some(1.0), v_px: None };
        let settings = TrackerSettings { corrections: vec![row], ..TrackerSettings::default() };
        let refused = TrackerNode::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting);
        assert_eq!(refused.as_deref(), Some("corrections[0]"));
    }

    #[test]
    fn a_fault_in_the_file_of_marks_names_file_and_line() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("marks.csv");
        let calibration = Arc::new(ring_calibration(3));
        let name = calibration.cameras[0].name.clone();
        let setup = Setup { camera: Some(CameraId(0)), calibration, ..Setup::for_tests() };
        let new = |text: String| {
            std::fs::write(&path, text).unwrap();
            let settings = TrackerSettings { marks: path.display().to_string(), ..TrackerSettings::default() };
            TrackerNode::new(settings, &setup).map(|_| ()).map_err(|it| (it.setting, it.message))
        };
        assert_eq!(new(format!("camera,mark,frame,u_px,v_px\n{name},1,0,30,40\n")), Ok(()));
        let (setting, message) = new("camera,mark,frame,u_px,v_px\nnobody,1,0,30,40\n".to_owned()).unwrap_err();
        assert_eq!(setting.as_deref(), Some("marks"));
        assert!(
            message.contains("marks.csv") && message.contains("line 2") && message.contains("`nobody`"),
            "{message}"
        );
    }

    /// A row that comes while the tracker works.
    fn row(mark: u32, frame: u64, place: Option<[f64; 2]>) -> CorrectionRow {
        let [u_px, v_px] = [0, 1].map(|at| place.map(|it| it[at]));
        CorrectionRow { camera: String::new(), mark, frame, u_px, v_px }
    }

    #[test]
    fn rows_that_come_while_it_works_hold_from_the_last_picture_on_also_where_it_has_moved_meanwhile() {
        // A dot that moves by 3 px a picture, on a pattern that moves with it.
        let picture = |number: u64| {
            let shift = 3.0 * number as f64;
            let place = |at: usize| Vector2::new((at % 160) as f64 - shift, (at / 160) as f64);
            let wave = |it: Vector2<f64>, x: f64, y: f64| (it.x * x + it.y * y).sin();
            let gray = |at: usize| {
                let it = place(at);
                let ground = wave(it, 0.13, 0.2) + wave(it, 0.31, -0.17) + wave(it, 0.07, 0.41) + wave(it, -0.5, 0.09);
                if (it - Vector2::new(30.0, 40.0)).norm() < 3.2 { 40 } else { (170.0 + 18.0 * ground) as u8 }
            };
            Image { width: 160, height: 120, pixels: (0..160 * 120).map(gray).collect(), ..Image::default() }
        };
        let settings = TrackerSettings { find: false, ..TrackerSettings::default() };
        let mut tracker = MarkTracker::new(settings.clone(), Vec::new(), None).unwrap();
        let mut rows: Vec<CorrectionRow> = Vec::new();
        let mut seen: Vec<Vec<(Option<u32>, f64)>> = Vec::new();
        for number in 0..9 {
            let stamp = Stamp { time: Time::from_s(0.03 * number as f64), sequence: number, ..Stamp::default() };
            let mut features = Features::default();
            tracker.see(&picture(number), stamp, None, &mut features).unwrap();
            seen.push(features.list.iter().map(|it| (it.label, (it.centre.x - 3.0 * number as f64).round())).collect());
            // Of the last picture; of two before that; of one that is to come; one that is long past.
            let new = match number {
                1 => row(7, 1, Some([33.4, 40.3])),
                4 => row(8, 2, Some([36.0, 40.0])),
                5 => row(8, 7, None),
                8 => row(9, 70, Some([1.0, 1.0])),
                _ => continue,
            };
            rows.push(new.clone());
            tracker.change(TrackerSettings { corrections: rows.clone(), ..settings.clone() }, &[new.correction()]);
        }
        let none: Vec<(Option<u32>, f64)> = Vec::new();
        let mark = |label| vec![(Some(label), 30.0)];
        let expected = [none.clone(), none.clone(), mark(7), mark(7), mark(7), mark(8), mark(8), none.clone(), none];
        assert_eq!(seen, expected);
    }

    #[test]
    fn marks_chosen_by_hand_have_their_names_from_the_picture_of_that_moment_on() {
        let picture = || {
            let dot = |at: usize| ((at % 64) as f64 - 30.0).hypot((at / 64) as f64 - 40.0) < 3.2;
            let pixels = (0..64 * 64).map(|at| if dot(at) { 40 } else { 190 }).collect();
            Image { width: 64, height: 64, pixels, ..Image::default() }
        };
        let chosen = |label: u32| {
            let place = Point2::new(30.9, 39.2);
            let feature =
                Feature { centre: place, covariance: Default::default(), area: 0, peak: 0, label: Some(label) };
            Features { list: vec![feature], ..Features::default() }
        };
        let mut bench = NodeBench::<TrackerNode>::new(TrackerSettings::default()).unwrap();
        let mut names = Vec::new();
        let of = [None, Some((1, Some(7))), None, Some((4, Some(8))), None, Some((3, Some(9))), Some((6, None))];
        for (number, of) in (0..).zip(of) {
            if let Some((moment, label)) = of {
                let features = label.map_or_else(Features::default, chosen);
                bench.feed(&CHOSEN, Time::from_s(0.1 * f64::from(moment)), features).unwrap();
            }
            bench.feed(&IMAGE, Time::from_s(0.1 * f64::from(number)), picture()).unwrap();
            let seen = bench.outputs(&FEATURES);
            let dot = seen[0].value.list.iter().find(|it| (it.centre - Point2::new(30.0, 40.0)).norm() < 0.1);
            names.push(dot.and_then(|it| it.label));
        }
        // The second choice is for a picture that is still to come, the third for one that is past, the last one says that nothing is visible.
        assert_eq!(names, [None, Some(7), Some(7), Some(7), Some(8), Some(8), None]);
        let report = bench.finish().unwrap();
        let figure = |name: &str| report.figures.iter().find(|it| it.0.contains(name)).map(|it| *it.1);
        assert_eq!((figure("corrected."), figure("corrections_missed")), (Some(4.0), Some(1.0)));
    }
}
