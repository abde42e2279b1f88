//! `led.integrator`: the lights of all cameras, each in its own time, become targets in space.

use std::sync::Arc;

use foveate::prelude::*;

pub use crate::tracker::IntegratorSettings;
use crate::tracker::{CameraTally, Entry, Tracker};

/// A frame captured later than this after its delivery carries a wrong clock [ms].
const CLOCK_TOLERANCE_MS: f64 = 100.0;

const FEATURES: In<Features> = In::each(0, "features").many();
const TARGETS: Out<Targets> = Out::new(0, "targets");
const PREDICTED: Out<Targets> = Out::new(1, "predicted");

/// One Kalman filter a target, each observation applied alone, at its own time and with its own camera.
///
/// After each camera frame it gives out all live targets as of that frame's time, on both ports the same value: `predicted`
/// is there for the feedback to detectors. A target is `measured` if a frame of that very time saw it.
pub struct Integrator {
    tracker: Tracker,
    pool: Pool<Targets>,
    camera_names: Vec<String>,
    /// Frames whose capture time lies after their delivery.
    from_the_future: u64,
    unknown_camera: u64,
}

impl Node for Integrator {
    const TYPE: &'static str = "led.integrator";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Joins the lights that cameras see, each in its own time, into targets in space";
    type Settings = IntegratorSettings;

    fn ports() -> Ports {
        Ports::new().input(&FEATURES).output(&TARGETS).output(&PREDICTED)
    }

    fn new(settings: IntegratorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let cameras = &setup.calibration.cameras;
        if cameras.len() < 2 {
            let n = cameras.len();
            return Err(ConfigError::node(format_args!("found {n} cameras in the calibration, expected at least 2")));
        }
        if settings.birth_cameras as usize > cameras.len() {
            let (found, n) = (settings.birth_cameras, cameras.len());
            let message = format!(
                "found {found}, expected at most the {n} cameras of the calibration: no target would ever be born"
            );
            return Err(ConfigError::at("birth_cameras", message));
        }
        let models = cameras.iter().map(|it| it.camera.clone()).collect();
        Ok(Self {
            tracker: Tracker::new(settings, models, setup.volume_m),
            pool: Pool::default(),
            camera_names: cameras.iter().map(|it| it.name.clone()).collect(),
            from_the_future: 0,
            unknown_camera: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(features) = io.take(&FEATURES) else { return Ok(()) };
        if features.time() - io.now() > Interval::from_ms(CLOCK_TOLERANCE_MS) {
            self.from_the_future += 1; // applied, it would make every other camera late
            return Ok(());
        }
        match self.tracker.observe(features.time(), &features.value) {
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
        let targets = self.pool.share(targets);
        io.emit_at(&TARGETS, time, Arc::clone(&targets));
        io.emit_at(&PREDICTED, time, targets);
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let tally = self.tracker.tally();
        let mut figure = |name: &str, count: u64| report.figure(format!("integrator.{name}"), count as f64);
        figure("births", tally.births);
        figure("deaths_unseen", tally.deaths_unseen);
        figure("deaths_single_view", tally.deaths_single_view);
        figure("deaths_outside_volume", tally.deaths_outside);
        figure("deaths_unconfirmed", tally.deaths_unconfirmed);
        figure("deaths_duplicate", tally.deaths_duplicate);
        figure("targets_at_end", self.tracker.n_targets() as u64);
        figure("observations_used", tally.used);
        figure("observations_unmatched", tally.unmatched);
        figure("observations_unusable", tally.unusable);
        figure("observations_late", tally.late);
        let (late, applied) =
            tally.cameras.iter().fold((0, 0), |(late, applied), it| (late + it.late, applied + it.applied));
        figure("frames_late", late);
        figure("frames_applied", applied);
        figure("frames_from_the_future", self.from_the_future);
        figure("frames_of_unknown_cameras", self.unknown_camera);
        let total = |of: fn(&CameraTally) -> u64| tally.cameras.iter().map(of).sum();
        figure("frames_applied", total(|it| it.applied));
        figure("frames_late", total(|it| it.late));
        figure("frames_repeated", total(|it| it.repeated));
        // By camera only where something went wrong: a rig of many cameras has enough to read.
        if late > 0 {
            let all = late + applied;
            report.remark(format!(
                "{late} of {all} camera frames reached the integrator after newer ones and were not used; in a live run that means \
                 that the machine does not keep up"
            ));
        }
        let mut figure = |name: &str, count: u64| report.figure(format!("integrator.{name}"), count as f64);
        for (camera, name) in tally.cameras.iter().zip(&self.camera_names) {
            for (what, count) in [("late", camera.late), ("repeated", camera.repeated)] {
                if count > 0 {
                    figure(&format!("frames_{what}.{name}"), count);
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Integrator>("");
        check_node::<Integrator>("birth_cameras = 2\nlost_after_ms = 100");
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
