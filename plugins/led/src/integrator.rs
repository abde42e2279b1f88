//! `led.integrator`: the lights of all cameras, each in its own time, become targets in space.

use std::sync::Arc;

use foveate::estimation::consistency::Verdict;
use foveate::node::scale::Spaces;
use foveate::prelude::*;
use nalgebra::Point3;

pub use crate::tracker::IntegratorSettings;
use crate::tracker::{CameraTally, Entry, Tracker};

/// Mean normalised squared innovations are called too large beyond this many standard deviations of what chance does to them, and this
/// part of 1.
const CONSISTENCY_SIGMAS: f64 = 3.0;
const CONSISTENCY_TOLERANCE: f64 = 1.0;

/// A frame captured later than this after its delivery carries a wrong clock, unless clocks may be off by more [ms].
const CLOCK_TOLERANCE_MS: f64 = 100.0;

/// Runs that end so soon, after their start or behind the first light, may well be without a target, whatever the calibration [s].
const LEAST_S: f64 = 2.0;
const LEAST_LIT_S: f64 = 0.5;

ports! {
    FEATURES: In<Features> = each("features").many();
    SPACES: In<ScaleSpace> = latest("spaces").many().optional();
    TARGETS: Out<Targets> = "targets";
    PREDICTED: Out<Targets> = "predicted";
}

figures! {
    "integrator.initiations": count, neither, "Targets that began, those that were taken back later included";
    "integrator.identities_regained": count, neither, "Those of them that took up the identity of a lost one, and unseen targets that were found again";
    "integrator.deaths_unseen": count, low, "Targets that ended since no camera saw them";
    "integrator.deaths_single_view": count, low, "Targets that ended since only one camera saw them";
    "integrator.deaths_outside_volume": count, neither, "Targets that ended since they left the working volume";
    "integrator.deaths_unconfirmed": count, low, "Tentative targets that too few cameras confirmed: accidents of lines of sight";
    "integrator.deaths_duplicate": count, low, "Targets that ended since they followed the light of an older one";
    "integrator.targets_at_end": count, neither, "Targets that lived when the run ended";
    "integrator.ambiguities": count, neither, "Frames that left several answers open, which were kept; with association = hypotheses";
    "integrator.observations_used": count, neither, "Features that were taken as the observation of a target";
    "integrator.observations_shared": count, neither, "Features that were taken for two targets at once, whose images had run into one spot; with hypotheses only of frames that came late";
    "integrator.observations_unmatched": count, low, "Features that belonged to no target when they came; those that began one are among them";
    "integrator.observations_unusable": count, low, "Features without finite numbers, or with a covariance that is none";
    "integrator.observations_late": count, low, "Features in late or repeated frames, which were not used";
    "integrator.frames_applied": count, neither, "Camera frames that were used";
    "integrator.frames_applied_late(.*)": count, low, "Camera frames from before the filter's time that were used all the same; by camera where there are any";
    "integrator.frames_late(.*)": count, low, "Camera frames that came too long after newer ones and were not used; by camera where there are any";
    "integrator.frames_repeated(.*)": count, low, "Camera frames no newer than the camera's last one, not used; by camera where there are any";
    "integrator.frames_from_the_future": count, low, "Camera frames stamped so far after they came that the clock must be wrong; not used";
    "integrator.frames_of_unknown_cameras": count, low, "Camera frames of cameras that are not in the calibration; not used";
    "integrator.innovations_normalised_squared(.*)": ratio, neither, "Squared innovations over their covariance, mean; 1 is ideal, far above it calibration, clock or model are wrong; by camera where it is too large";
    "integrator.clock_offset_ms.*": ms, neither, "With clocks: how far that clock is ahead of the mean of all cameras' clocks, at its last frame";
    "integrator.clock_offset_sigma_ms.*": ms, low, "Standard deviation of that";
    "integrator.clock_drift_ppm.*": ppm, neither, "With clocks: by how much that clock runs faster than the mean of all";
}

/// One Kalman filter a target, each observation applied alone, at its own time and with its own camera.
///
/// After each camera frame it gives out all live targets as of that frame's time, on both ports the same value: `predicted`
/// is there for the feedback to detectors. A target is `measured` if a frame of that very time saw it.
///
/// In a scale whose space moves, `spaces` takes the anchors of that scale and of those around it: cameras of the calibration stand in the world, and targets are given out
/// in the scale's space. Without `spaces`, cameras are taken to stand in the scale's space.
pub struct Integrator {
    tracker: Tracker,
    /// Where the scale is whose targets these are, if cameras stand in the world and it moves.
    spaces: Option<Spaces>,
    /// What of that space is given out, its corners [m].
    volume: Option<[[f64; 3]; 2]>,
    /// How far ahead of its delivery a frame may have been captured.
    ahead: Interval,
    initiation_cameras: u32,
    initiation_features_max: u32,
    pool: Pool<Targets>,
    camera_names: Vec<String>,
    /// Frames whose capture time lies after their delivery.
    from_the_future: u64,
    unknown_camera: u64,
    /// When the first light was seen, and when the newest frame was.
    first_light: Option<Time>,
    newest: Option<Time>,
}

impl Node for Integrator {
    const TYPE: &'static str = "led.integrator";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Joins the lights that cameras see, each in its own time, into targets in space";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = IntegratorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: IntegratorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let cameras = &setup.calibration.cameras;
        if cameras.len() < 2 {
            let n = cameras.len();
            return Err(ConfigError::node(format_args!("found {n} cameras in the calibration, expected at least 2")));
        }
        if settings.initiation_cameras as usize > cameras.len() {
            let (found, n) = (settings.initiation_cameras, cameras.len());
            let message = format!(
                "found {found}, expected at most the {n} cameras of the calibration: no target would ever be initiated"
            );
            return Err(ConfigError::at("initiation_cameras", message));
        }
        let ahead = Interval::from_ms(settings.clocks_off_ms().max(CLOCK_TOLERANCE_MS));
        let initiation_cameras = settings.initiation_cameras;
        let initiation_features_max = settings.initiation_features_max;
        let spaces = setup.is_connected(&SPACES).then(|| Spaces::new(&setup.scales)).filter(Spaces::is_moving);
        let models = cameras.iter().map(|it| it.camera.clone()).collect();
        Ok(Self {
            tracker: Tracker::new(settings, models, setup.volume_m.filter(|_| spaces.is_none())),
            volume: setup.volume_m.filter(|_| spaces.is_some()),
            spaces,
            ahead,
            initiation_cameras,
            initiation_features_max,
            pool: Pool::default(),
            camera_names: cameras.iter().map(|it| it.name.clone()).collect(),
            from_the_future: 0,
            unknown_camera: 0,
            first_light: None,
            newest: None,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(features) = io.take(&FEATURES) else { return Ok(()) };
        if features.time() - io.now() > self.ahead {
            self.from_the_future += 1; // applied, it would make every other camera late
            return Ok(());
        }
        match self.observe(features.time(), &features.value) {
            Entry::Applied => {}
            Entry::Late | Entry::Repeated => return Ok(()),
            Entry::UnknownCamera => {
                self.unknown_camera += 1;
                return Ok(());
            }
        }
        let mut targets = self.pool.take(Targets::default);
        self.tracker.write(&mut targets);
        let time = targets.time;
        if let Some(spaces) = &mut self.spaces {
            io.latest_of_each(&SPACES).for_each(|it| spaces.learn(it.value));
            let moved = |it: &Target| spaces.target_in(spaces.own(), spaces.root(), time, it);
            match targets.list.iter().map(moved).collect() {
                Ok(list) => {
                    targets.list = list;
                    targets.list.retain(|it| self.volume.is_none_or(|volume| is_inside(&it.position, &volume)));
                }
                Err(error) => {
                    io.gap(&TARGETS, time, format_args!("it is not known where the scale is: {error}"));
                    io.gap(&PREDICTED, time, format_args!("it is not known where the scale is: {error}"));
                    return Ok(());
                }
            }
        }
        let targets = self.pool.share(targets);
        io.emit_at(&TARGETS, time, Arc::clone(&targets));
        io.emit_at(&PREDICTED, time, targets);
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let tally = self.tracker.tally();
        let mut figure = |name: &str, count: u64| report.figure(format!("integrator.{name}"), count as f64);
        figure("initiations", tally.initiations);
        figure("identities_regained", tally.regained);
        figure("deaths_unseen", tally.deaths_unseen);
        figure("deaths_single_view", tally.deaths_single_view);
        figure("deaths_outside_volume", tally.deaths_outside);
        figure("deaths_unconfirmed", tally.deaths_unconfirmed);
        figure("deaths_duplicate", tally.deaths_duplicate);
        figure("targets_at_end", self.tracker.n_targets() as u64);
        figure("ambiguities", tally.ambiguities);
        figure("observations_used", tally.used);
        figure("observations_shared", tally.shared);
        figure("observations_unmatched", tally.unmatched);
        figure("observations_unusable", tally.unusable);
        figure("observations_late", tally.late);
        let total = |of: fn(&CameraTally) -> u64| tally.cameras.iter().map(of).sum::<u64>();
        let (applied, late) = (total(|it| it.applied), total(|it| it.late));
        figure("frames_applied", applied);
        figure("frames_applied_late", total(|it| it.applied_late));
        figure("frames_late", late);
        figure("frames_repeated", total(|it| it.repeated));
        figure("frames_from_the_future", self.from_the_future);
        figure("frames_of_unknown_cameras", self.unknown_camera);
        if late > 0 {
            let worst = tally.cameras.iter().zip(&self.camera_names).max_by_key(|it| it.0.late);
            let worst = worst.map_or("", |it| it.1.as_str());
            report.remark(format!(
                "{late} of {} camera frames came too long after newer ones and were not used, most of them of {worst}: that machine does not \
                 keep up, or its clock is off; late = \"out_of_sequence\", a larger history_ms and clocks = \"correct\" use them",
                late + applied
            ));
        }
        if self.from_the_future > 0 {
            report.remark(format!(
                "{} camera frames were stamped more than {} ms after they came, and were not used: that clock is wrong",
                self.from_the_future,
                self.ahead.as_s() * 1e3
            ));
        }
        self.report_nothing(report);
        // By camera only where something went wrong: a rig of many cameras has enough to read.
        for (camera, name) in tally.cameras.iter().zip(&self.camera_names) {
            for (what, count) in
                [("applied_late", camera.applied_late), ("late", camera.late), ("repeated", camera.repeated)]
            {
                if count > 0 {
                    report.figure(format!("integrator.frames_{what}.{name}"), count as f64);
                }
            }
        }
        self.report_consistency(report);
        self.report_clocks(report);
        Ok(())
    }
}

impl Integrator {
    /// Why nothing was recovered, if nothing was.
    fn report_nothing(&self, report: &mut Report) {
        let tally = self.tracker.tally();
        let n_seeing = tally.cameras.iter().filter(|it| it.applied > 0).count();
        if tally.initiations > 0 {
            return;
        }
        let why = if n_seeing == 0 {
            "no camera gave a frame".to_owned()
        } else if let Some(why) = self.too_short() {
            why
        } else if n_seeing < self.initiation_cameras as usize {
            format!(
                "{n_seeing} cameras gave frames, and a target needs {} (initiation_cameras)",
                self.initiation_cameras
            )
        } else if tally.unmatched == 0 {
            "the cameras saw no light".to_owned()
        } else if tally.unmatched > tally.frames() * u64::from(self.initiation_features_max) {
            format!(
                "frames hold more features than initiation_features_max = {}, and count as noise",
                self.initiation_features_max
            )
        } else {
            format!(
                "of {} features in {} frames, no lines of sight of {} cameras met: look at the calibration, the clocks and the volume, and \
                 at initiation_tolerance_mm, initiation_share and stale_after_ms",
                tally.unmatched,
                tally.frames(),
                self.initiation_cameras
            )
        };
        report.remark(format!("no target was ever initiated: {why}"));
    }

    fn observe(&mut self, time: Time, features: &Features) -> Entry {
        let entry = self.tracker.observe(time, features);
        if entry == Entry::Applied {
            self.newest = self.newest.max(Some(time));
            if !features.list.is_empty() && self.first_light.is_none_or(|it| time < it) {
                self.first_light = Some(time);
            }
        }
        entry
    }

    /// That a run without targets ended too early to tell why; `None`: it did not.
    fn too_short(&self) -> Option<String> {
        let newest = self.newest?.as_s();
        match self.first_light.map(Time::as_s) {
            None if newest < LEAST_S => Some(format!(
                "this run is too short to tell why: it ended at {newest:.2} s, and no light was seen before"
            )),
            Some(first) if newest < LEAST_S || newest - first < LEAST_LIT_S => Some(format!(
                "this run is too short to tell why: the first light was seen at {first:.2} s, and the run ended at {newest:.2} s"
            )),
            _ => None,
        }
    }

    /// Whether errors are as large as the filters say: the normalised squared innovations over their number of degrees of freedom.
    fn report_consistency(&self, report: &mut Report) {
        let tally = self.tracker.tally();
        let Some(mean) = tally.consistency.mean() else { return };
        report.figure("integrator.innovations_normalised_squared", mean);
        let mut too_large = Vec::new();
        for (camera, name) in tally.cameras.iter().zip(&self.camera_names) {
            if camera.consistency.verdict(CONSISTENCY_SIGMAS, CONSISTENCY_TOLERANCE) == Verdict::Overconfident {
                too_large.push(name.as_str());
                if let Some(mean) = camera.consistency.mean() {
                    report.figure(format!("integrator.innovations_normalised_squared.{name}"), mean);
                }
            }
        }
        if !too_large.is_empty() {
            report.remark(format!(
                "the lights that {} saw were further from where they were expected than the integrator was told to expect; look at the \
                 calibration and the clock of these cameras, at the noise in their pictures, at camera_error_px, and at acceleration_m_s2",
                too_large.join(", ")
            ));
        }
    }

    /// How far each camera's clock is ahead of the mean of all.
    fn report_clocks(&self, report: &mut Report) {
        for (camera, name) in self.camera_names.iter().enumerate() {
            let id = CameraId(camera as u16);
            let Some(stamp) = self.tracker.newest_stamp(id) else { continue };
            let Some(clock) = self.tracker.clock(id, stamp).filter(|it| it.n_observations > 0) else { continue };
            let mut figure = |what: &str, value: f64| report.figure(format!("integrator.clock_{what}.{name}"), value);
            figure("offset_ms", clock.offset_s * 1e3);
            figure("offset_sigma_ms", clock.offset_sigma_s * 1e3);
            figure("drift_ppm", clock.drift * 1e6);
        }
    }
}

fn is_inside(point: &Point3<f64>, [min, max]: &[[f64; 3]; 2]) -> bool {
    (0..3).all(|axis| (min[axis]..=max[axis]).contains(&point[axis]))
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Integrator>("");
        check_node::<Integrator>("initiation_cameras = 2\nlost_after_ms = 100");
    }

    /// What is said of a run of two cameras that see lights from `first_s` on and end at `end_s`, and nothing meets.
    fn said(first_s: f64, end_s: f64) -> String {
        let camera = |name: &str, x: f64| {
            format!(
                "[camera.{name}]\nimage_size_px = [640, 480]\nfocal_px = [600, 600]\nprincipal_point_px = [319.5, 239.5]\n\
                 distortion = {{ k1 = 0.0 }}\nposition_m = [{x}, 0, 0]\ncamera_from_world_wxyz = [1, 0, 0, 0]\n"
            )
        };
        let text = format!("[calibration]\nlength_unit = \"m\"\n{}{}", camera("a", 0.0), camera("b", 1.0));
        let calibration = foveate::scene::Calibration::from_toml(&text, std::path::Path::new("lab.toml")).unwrap();
        let setup = Setup { calibration: Arc::new(calibration), ..Setup::for_tests() };
        let mut node =
            Integrator::new(IntegratorSettings { initiation_cameras: 2, ..Default::default() }, &setup).unwrap();
        for frame in 0..=(end_s * 20.0).round() as usize {
            let time = Time::from_s(frame as f64 / 20.0);
            for camera in 0..2 {
                let centre = [10.0 + 300.0 * f64::from(camera), 20.0].into();
                let light =
                    Feature { centre, covariance: nalgebra::Matrix2::identity(), area: 9, peak: 200, label: None };
                let list = if time >= Time::from_s(first_s) { vec![light] } else { Vec::new() };
                node.observe(time, &Features { camera: CameraId(camera), list });
            }
        }
        let mut report = Report::default();
        node.finish(&mut report).unwrap();
        report.remarks.join("\n")
    }

    #[test]
    fn short_runs_are_called_short_and_blame_nothing() {
        assert!(
            said(9.0, 0.05).contains("too short to tell why: it ended at 0.05 s, and no light"),
            "{}",
            said(9.0, 0.05)
        );
        // Lights that are seen all the time, outside the volume until then.
        assert!(said(0.0, 1.0).contains("too short"), "{}", said(0.0, 1.0));
        let late = said(4.8, 5.0);
        assert!(late.contains("the first light was seen at 4.80 s"), "{late}");
        let lit = said(0.9, 1.0);
        assert!(lit.contains("the first light was seen at 0.90 s, and the run ended at 1.00 s"), "{lit}");
        assert!(said(9.0, 3.0).contains("the cameras saw no light"), "{}", said(9.0, 3.0));
        assert!(said(0.5, 3.0).contains("look at the calibration"), "{}", said(0.5, 3.0));
    }

    #[test]
    fn settings_out_of_range_and_missing_cameras_are_named() {
        let one_camera = Integrator::new(IntegratorSettings::default(), &Setup::for_tests()).err();
        assert!(one_camera.is_some_and(|it| it.message.contains("expected at least 2")));
        let settings = IntegratorSettings { gate_px: -1.0, ..IntegratorSettings::default() };
        let refused = Integrator::new(settings, &Setup::for_tests()).err();
        assert_eq!(refused.and_then(|it| it.setting).as_deref(), Some("gate_px"));
    }
}
