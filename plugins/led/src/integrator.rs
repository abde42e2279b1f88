//! `led.integrator`: tracks targets in space from the lights of all cameras, each in its own time.

use std::sync::Arc;

use foveate::estimation::consistency::Verdict;
use foveate::node::scale::Spaces;
use foveate::prelude::*;
use nalgebra::Point3;

pub use crate::tracker::IntegratorSettings;
use crate::tracker::{CameraTally, Entry, Tracker};

/// Mean normalised squared innovations are too large beyond this many standard deviations of their sampling error, and this
/// part of 1.
const CONSISTENCY_SIGMAS: f64 = 3.0;
const CONSISTENCY_TOLERANCE: f64 = 1.0;

/// A frame captured later than this after its delivery carries a wrong clock, unless clocks may be off by more [ms].
const CLOCK_TOLERANCE_MS: f64 = 100.0;

/// A run that ends this soon after its start or its first light may lack targets with any calibration [s].
const LEAST_S: f64 = 2.0;
const LEAST_LIT_S: f64 = 0.5;

ports! {
    FEATURES: In<Features> = each("features").many();
    SPACES: In<ScaleSpace> = latest("spaces").many().optional();
    TARGETS: Out<Targets> = "targets";
    PREDICTED: Out<Targets> = "predicted";
}

figures! {
        "integrator.initiations": count, neither, "Targets initiated, those terminated as false included";
        "integrator.identities_regained": count, neither, "Initiated targets that got the identity of a lost one, and unseen targets that were found again";
        "integrator.deaths_unseen": count, low, "Targets terminated because no camera saw them";
        "integrator.deaths_single_view": count, low, "Targets terminated because only one camera saw them";
        "integrator.deaths_outside_volume": count, neither, "Targets terminated because they left the working volume";
        "integrator.deaths_unconfirmed": count, low, "Tentative targets terminated because too few cameras confirmed them: accidental intersections of lines of sight";
        "integrator.deaths_duplicate": count, low, "Targets terminated because they tracked the light of an older one";
        "integrator.targets_at_end": count, neither, "Live targets when the run ended";
        "integrator.ambiguities": count, neither, "Frames with an ambiguous association for which several hypotheses were kept; with association = hypotheses";
        "integrator.observations_used": count, neither, "Features associated with a target";
        "integrator.observations_shared": count, neither, "Features associated with two targets at once, whose images had merged into one spot; with hypotheses only in frames that come late";
        "integrator.observations_unmatched": count, low, "Features without a target when they came, including those that initiated one";
        "integrator.observations_unusable": count, low, "Features without finite numbers, or with an invalid covariance";
    "integrator.observations_late": count, low, "Features in late or repeated frames, which were not used";
        "integrator.frames_applied": count, neither, "Camera frames used";
        "integrator.frames_applied_late(.*)": count, low, "Camera frames used although captured before the filter's time; by camera where there are any";
        "integrator.frames_late(.*)": count, low, "Camera frames not used because they came too long after newer ones; by camera where there are any";
    "integrator.frames_repeated(.*)": count, low, "Camera frames no newer than the camera's last one, not used; by camera where there are any";
        "integrator.frames_from_the_future": count, low, "Camera frames not used because their stamps are so far after their arrival that the clock must be wrong";
    "integrator.frames_of_unknown_cameras": count, low, "Camera frames of cameras that are not in the calibration; not used";
    "integrator.innovations_normalised_squared(.*)": ratio, neither, "Mean squared innovation over its covariance; 1 is ideal, a far larger value means a wrong calibration, clock or model; by camera where it is too large";
    "integrator.clock_offset_ms.*": ms, neither, "With clocks: offset of that clock ahead of the mean of all cameras' clocks, at its last frame";
        "integrator.clock_offset_sigma_ms.*": ms, low, "Standard deviation of that offset";
    "integrator.clock_drift_ppm.*": ppm, neither, "With clocks: how much faster that clock runs than the mean of all";
}

/// One Kalman filter per target; each observation is applied alone, at its own time and with its own camera.
///
/// After each camera frame it sends all live targets as of that frame's time, the same value on both ports: `predicted`
/// is the feedback to detectors. A target is `measured` if a frame of exactly that time saw it.
///
/// In a scale whose space moves, `spaces` takes the anchors of that scale and of those around it: cameras of the calibration are in the world, and targets are sent
/// in the scale's space. Without `spaces`, cameras are assumed to be in the scale's space.
pub struct Integrator {
    tracker: Tracker,
    /// Pose of the targets' scale, if it moves relative to the cameras.
    spaces: Option<Spaces>,
    /// Part of that space that is sent, its corners [m].
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
    /// Times of the first light and of the newest frame.
    first_light: Option<Time>,
    newest: Option<Time>,
}

impl Node for Integrator {
    const TYPE: &'static str = "led.integrator";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Tracks lights in space from the features of all cameras, each in its own time";
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
                    io.gap(&TARGETS, time, format_args!("the scale's pose is unknown: {error}"));
                    io.gap(&PREDICTED, time, format_args!("the scale's pose is unknown: {error}"));
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
        figure("deaths_unseen", tally.terminated_unseen);
        figure("deaths_single_view", tally.terminated_single_view);
        figure("deaths_outside_volume", tally.terminated_outside);
        figure("deaths_unconfirmed", tally.terminated_unconfirmed);
        figure("deaths_duplicate", tally.terminated_duplicate);
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
                "{late} of {} camera frames came too long after newer ones and were not used, most of them from {worst}: that machine is too \
                 slow, or its clock is wrong; a larger history_ms (with late = \"out_of_sequence\") and clocks = \"correct\" use them",
                late + applied
            ));
        }
        if self.from_the_future > 0 {
            report.remark(format!(
                "{} camera frames had stamps more than {} ms after their arrival, and were not used: that clock is wrong",
                self.from_the_future,
                self.ahead.as_s() * 1e3
            ));
        }
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
        self.report_nothing(report)
    }
}

impl Integrator {
    /// The reason if no target was recovered. Refused input of the node itself comes first: the rest follows from it.
    ///
    /// # Errors
    /// All of it was refused.
    fn report_nothing(&self, report: &mut Report) -> Result<(), NodeError> {
        let tally = self.tracker.tally();
        let n_seeing = tally.cameras.iter().filter(|it| it.applied > 0).count();
        if tally.initiations > 0 {
            return Ok(());
        }
        let n_good = tally.used + tally.unmatched;
        let bad_numbers =
            "features have a place or a covariance that is not finite, or a covariance that is not positive";
        let (n_refused, refused) = match n_seeing {
            0 if self.unknown_camera > 0 => (self.unknown_camera, "frames are of cameras that the calibration lacks"),
            0 => (self.from_the_future, "frames are stamped later than they came"),
            _ if n_good == 0 => (tally.unusable, bad_numbers),
            _ => (0, ""),
        };
        if n_refused > 0 {
            return Err(NodeError::input(format!("no target was ever initiated: all {n_refused} {refused}")));
        }
        let why = if n_seeing == 0 {
            "no camera delivered a frame".to_owned()
        } else if tally.unusable > n_good {
            format!("{} of {} {bad_numbers}", tally.unusable, tally.unusable + n_good)
        } else if let Some(why) = self.too_short() {
            why
        } else if n_seeing < self.initiation_cameras as usize {
            format!(
                "{n_seeing} cameras delivered frames, expected at least {} for a target (initiation_cameras)",
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
                "of {} features in {} frames, no lines of sight of {} cameras met: check the calibration, the clocks and the volume, and \
                 initiation_tolerance_mm, initiation_share and stale_after_ms",
                tally.unmatched,
                tally.frames(),
                self.initiation_cameras
            )
        };
        report.remark(format!("no target was ever initiated: {why}"));
        Ok(())
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

    /// Whether a run without targets ended too early to find the reason.
    fn too_short(&self) -> Option<String> {
        let newest = self.newest?.as_s();
        match self.first_light.map(Time::as_s) {
            None if newest < LEAST_S => Some(format!(
                "this run is too short to find the reason: it ended at {newest:.2} s, and no light was seen before"
            )),
            Some(first) if newest < LEAST_S || newest - first < LEAST_LIT_S => Some(format!(
                "this run is too short to find the reason: the first light was seen at {first:.2} s, and the run ended at {newest:.2} s"
            )),
            _ => None,
        }
    }

    /// Consistency of the filters: the normalised squared innovations over their number of degrees of freedom.
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
                "the lights of {} were farther from their predictions than the filters' covariances; check the \
                 calibration and the clock of these cameras, the noise in their pictures, camera_error_px, and acceleration_m_s2",
                too_large.join(", ")
            ));
        }
    }

    /// Offset of each camera's clock ahead of the mean of all.
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
    use foveate::node::error::Blame;
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Integrator>("");
        check_node::<Integrator>("initiation_cameras = 2\nlost_after_ms = 100");
    }

    /// What is said of a run of two cameras that see lights from `first_s` on and end at `end_s`, and nothing meets.
    fn said(first_s: f64, end_s: f64) -> String {
        run(first_s, end_s, 1.0).unwrap().remarks.join("\n")
    }

    /// Two cameras see a light each from `first_s` to `end_s`, at places with this variance [px²].
    fn run(first_s: f64, end_s: f64, variance: f64) -> Result<Report, NodeError> {
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
                let covariance = nalgebra::Matrix2::identity() * variance;
                let light = Feature { centre, covariance, area: 9, peak: 200, label: None };
                let list = if time >= Time::from_s(first_s) { vec![light] } else { Vec::new() };
                node.observe(time, &Features { camera: CameraId(camera), list });
            }
        }
        let mut report = Report::default();
        node.finish(&mut report).map(|()| report)
    }

    #[test]
    fn features_that_were_refused_are_the_cause_and_not_that_no_light_was_seen() {
        let fault = run(0.5, 3.0, f64::NAN).unwrap_err();
        assert_eq!(fault.blame, Blame::Input);
        // 51 frames of two cameras from 0.5 s on.
        assert!(fault.message.contains("all 102 features") && !fault.message.contains("saw no light"), "{fault}");
        assert_eq!(run(9.0, 3.0, f64::NAN).map(|it| it.figures["integrator.observations_unusable"]), Ok(0.0));
    }

    #[test]
    fn short_runs_are_called_short_and_blame_nothing() {
        assert!(said(9.0, 0.05).contains("ended at 0.05 s"), "{}", said(9.0, 0.05));
        // Lights that are seen all the time, outside the volume until then.
        assert!(said(0.0, 1.0).contains("too short"), "{}", said(0.0, 1.0));
        let late = said(4.8, 5.0);
        assert!(late.contains("the first light was seen at 4.80 s"), "{late}");
        let lit = said(0.9, 1.0);
        assert!(lit.contains("the first light was seen at 0.90 s, and the run ended at 1.00 s"), "{lit}");
        assert!(said(9.0, 3.0).contains("the cameras saw no light"), "{}", said(9.0, 3.0));
        assert!(said(0.5, 3.0).contains("check the calibration"), "{}", said(0.5, 3.0));
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
