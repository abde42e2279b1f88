//! `select.gate`: passes on the pictures of a camera while they are worth processing.

use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    IMAGE_IN: In<Image> = each("image").optional();
    FEATURES_IN: In<Features> = each("features").optional();
    CHOICE: In<CameraChoice> = latest("choice");
    IMAGE_OUT: Out<Image> = "image";
    FEATURES_OUT: Out<Features> = "features";
}

figures! {
        "gate.passed.*": count, neither, "Pictures or features passed on while the camera was chosen, or before the first choice";
        "gate.looks.*": count, neither, "Pictures or features passed on now and then while the camera was not chosen";
        "gate.left_out.*": count, neither, "Pictures or features left out";
}

/// Settings of [`Gate`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct GateSettings {
    /// While the camera is not chosen, every n-th picture is passed on, so that new targets are found; the turns of cameras that
    /// are neighbours in the calibration follow each other; 0: none [frames].
    #[schemars(range(min = 0, max = 100000))]
    pub look_every: u32,
}

impl Default for GateSettings {
    /// Six such pictures a second at 60 Hz.
    fn default() -> Self {
        Self { look_every: 10 }
    }
}

/// Pictures of one camera in, the same out while `select.cameras` has chosen it, or before the first choice; otherwise every n-th. Pictures left out
/// are counted. The output is renumbered, so that later edges do not count them as lost.
///
/// Features are passed on likewise, of sources without pictures.
pub struct Gate {
    settings: GateSettings,
    camera: CameraId,
    camera_name: String,
    /// Pictures so far while the camera was not chosen.
    n_unchosen: u64,
    tally: Tally,
}

#[derive(Default)]
struct Tally {
    passed: u64,
    looks: u64,
    left_out: u64,
}

impl Node for Gate {
    const TYPE: &'static str = "select.gate";
    const ROLE: Role = Role::Selector;
    const SUMMARY: &'static str = "Passes on a camera's pictures while it is chosen, and every n-th otherwise";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = GateSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: GateSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("look_every", settings.look_every, 0..=100_000)?;
        let Some(camera) = setup.camera else {
            return Err(ConfigError::node("found no camera, expected `each` or `camera`: a gate is for one camera"));
        };
        let camera_name = setup.camera_name().unwrap_or(&setup.instance).to_owned();
        Ok(Self { settings, camera, camera_name, n_unchosen: 0, tally: Tally::default() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let choice = io.latest(&CHOICE).map(|it| it.value.cameras.contains(self.camera));
        if let Some(image) = io.take(&IMAGE_IN)
            && self.opens(choice)
        {
            io.emit_at(&IMAGE_OUT, image.time(), image.value);
        } else if let Some(features) = io.take(&FEATURES_IN)
            && self.opens(choice)
        {
            io.emit_at(&FEATURES_OUT, features.time(), features.value);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Tally { passed, looks, left_out } = self.tally;
        for (what, count) in [("passed", passed), ("looks", looks), ("left_out", left_out)] {
            report.figure(format!("gate.{what}.{}", self.camera_name), count as f64);
        }
        Ok(())
    }
}

impl Gate {
    /// Whether the next one is passed on; `None`: before the first choice.
    fn opens(&mut self, chosen: Option<bool>) -> bool {
        if chosen.unwrap_or(true) {
            self.tally.passed += 1;
            return true;
        }
        let turn = self.n_unchosen + u64::from(self.camera.0);
        self.n_unchosen += 1;
        let looks = self.settings.look_every > 0 && turn.is_multiple_of(u64::from(self.settings.look_every));
        *if looks { &mut self.tally.looks } else { &mut self.tally.left_out } += 1;
        looks
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_testkit::check_node;
    use foveate_testkit::scene::ring_calibration;

    use super::*;

    fn gate(camera: u16, look_every: u32) -> Gate {
        let calibration = Arc::new(ring_calibration(6));
        let setup = Setup { camera: Some(CameraId(camera)), calibration, ..Setup::for_tests() };
        Gate::new(GateSettings { look_every }, &setup).unwrap()
    }

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Gate>("");
        check_node::<Gate>("look_every = 0");
    }

    #[test]
    fn a_gate_without_a_camera_is_refused() {
        assert!(Gate::new(GateSettings::default(), &Setup::for_tests()).is_err());
    }

    #[test]
    fn everything_passes_before_the_first_choice_and_losses_are_counted() {
        let mut gate = gate(2, 5);
        assert!((0..7).all(|_| gate.opens(None)));
        assert!((0..3).all(|_| gate.opens(Some(true))));
        let open: Vec<bool> = (0..10).map(|_| gate.opens(Some(false))).collect();
        assert_eq!((0..10).filter(|it| open[*it]).collect::<Vec<usize>>(), [3, 8]);
        assert_eq!([gate.tally.passed, gate.tally.looks, gate.tally.left_out], [10, 2, 8]);
        let mut report = Report::default();
        gate.finish(&mut report).unwrap();
        assert!(report.figures.iter().any(|it| it.0 == "gate.left_out.ring-3" && *it.1 == 8.0));
    }

    #[test]
    fn without_looks_the_others_are_shut() {
        let mut gate = gate(0, 0);
        assert!((0..100).all(|_| !gate.opens(Some(false))));
    }

    #[test]
    fn neighbours_look_one_after_another() {
        let first: Vec<Option<usize>> = (0..4)
            .map(|camera| {
                (0..4).map(|_| ()).scan(gate(camera, 4), |it, ()| Some(it.opens(Some(false)))).position(|it| it)
            })
            .collect();
        assert_eq!(first, [Some(0), Some(3), Some(2), Some(1)]);
    }
}
