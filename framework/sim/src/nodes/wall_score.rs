//! Compares recovered pointers with the true ones on the simulated wall: figures, a picture.

use std::path::PathBuf;

use foveate_messages::{Pointers, Targets, Users};
use foveate_node::{ConfigError, Figures, Io, Node, NodeError, Ports, Purpose, Report, Role, Setup, figures, ports};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::score::wall::WallScorer;
use crate::wall::Wall;

ports! {
    WALL: In<Wall> = latest("wall");
    TARGETS: In<Targets> = each("targets");
    USERS: In<Users> = each("users").optional();
    POINTERS: In<Pointers> = each("pointers").optional();
}

figures! {
    "wall_px.{median,p95}": px, low, "Distance of a measured target from the true spot at the same time, in pixels of the wall, over all pairs within gate_mm" => "pointers off the truth, in pixels of the wall";
    "border_px.{median,p95}": px, low, "The same over the samples whose true spot is within 12 px of the edge of a camera's picture";
    "predicted_px.{median,p95}": px, low, "The same over targets that the message's own camera did not see, extrapolated to its time";
    "presses": count, neither, "Times that a spot appeared on the wall, from beside it too, and stayed for 50 ms or more";
    "missed_presses": count, low, "Those of them without any target" => "presses missed";
    "false_strokes": count, low, "Identities that were never near a true spot";
    "id_switches": count, low, "Times that a press was matched to an identity that another press had last";
    "broken_strokes": count, low, "Times that a press was matched to a new identity after it had had another one" => "strokes broken in two";
    "crossings": count, neither, "Times that the spots of two users came within 12 mm of each other";
    "press_ms.{median,p95}": ms, low, "From the first message after a spot appeared to the first with its target; capture times, delivery apart";
    "release_ms.median": ms, low, "From the last message before a spot vanished to the last with its target";
    "user_{right,wrong,undecided}": "–", neither, "Share of the presses with a target whose user, as it was known last, was right, wrong, or not decided; missing where no users are connected";
    "user_right_long": "–", high, "Share whose user was right of those that lasted for a second or more";
    "user_wrong_samples": "–", low, "Share of the targets with a user in which it was wrong at that time";
    "user_ms.{median,p95}": ms, low, "From the first message after a spot appeared to the first in which its target had a user";
    "identity_kept": "–", high, "Share of the presses with a target whose identity at the end was that at the beginning; missing where no users are connected";
    "press_events_missed": count, low, "Presses, as above, without an event; missing, as those below, where no events are connected";
    "press_events_doubled": count, low, "Events of a press for presses that had one already";
    "press_events_false": count, low, "Events of a press where no true spot was within gate_mm at their time";
    "release_event_ms.{median,p95}": ms, low, "From the last message in which a spot was there to the stated time of its release, without its sign";
    "scored_messages": count, neither, "Messages of targets that were compared with the truth; none before start_s";
}

/// Name of the picture in the folder for results.
const PICTURE: &str = "wall_strokes.svg";

/// Settings of [`WallScore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WallScoreSettings {
    /// Gate: a recovered target farther from a true spot than this is not matched to it [mm].
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub gate_mm: f64,
    /// Session time at which scoring begins [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
}

impl Default for WallScoreSettings {
    fn default() -> Self {
        Self { gate_mm: 25.0, start_s: 0.0 }
    }
}

/// The scoring sink.
pub struct WallScore {
    settings: WallScoreSettings,
    /// Names and what the calibration says of them, until the wall says how they truly are.
    setup: Setup,
    scorer: Option<(Wall, WallScorer)>,
    folder: Option<PathBuf>,
}

impl Node for WallScore {
    const TYPE: &'static str = "sim.wall_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Compares recovered pointers with the truth of the simulated wall";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = WallScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: WallScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("gate_mm", settings.gate_mm, 1.0..=1000.0)?;
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        setup.claim_file(None, PICTURE)?;
        let folder = setup.out_dir.as_ref().filter(|_| setup.purpose == Purpose::Run);
        Ok(Self { settings, setup: setup.clone(), scorer: None, folder: folder.cloned() })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if self.scorer.is_none()
            && let Some(wall) = io.latest(&WALL).map(|it| it.value.clone())
        {
            let named = &self.setup.calibration.cameras;
            let cameras = named.iter().map(|it| wall.camera(Some(&it.name), &it.camera)).collect();
            let scorer = WallScorer::new(self.settings.gate_mm * 1e-3, self.settings.start_s, cameras);
            self.scorer = Some((wall, scorer));
        }
        while let Some(users) = io.take(&USERS) {
            if let Some((_, scorer)) = &mut self.scorer {
                scorer.users(&users.value);
            }
        }
        if let Some(targets) = io.take(&TARGETS)
            && let Some((wall, scorer)) = &mut self.scorer
        {
            scorer.recovered(wall, &targets.value);
        }
        while let Some(pointers) = io.take(&POINTERS) {
            if let Some((wall, scorer)) = &mut self.scorer {
                scorer.pointers(wall, &pointers.value);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some((wall, scorer)) = &self.scorer else {
            report.remark("no target was compared with the simulated wall: none came");
            return Ok(());
        };
        scorer.finish(report);
        let Some(folder) = &self.folder else { return Ok(()) };
        report.save(folder, PICTURE, scorer.picture(wall.size()))
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;

    #[test]
    fn node_keeps_the_law_and_refuses_what_is_out_of_range() {
        check_node::<WallScore>("gate_mm = 10");
        let refused = |settings| WallScore::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting);
        let wrong = WallScoreSettings { gate_mm: 0.0, ..WallScoreSettings::default() };
        assert_eq!(refused(wrong).as_deref(), Some("gate_mm"));
        assert_eq!(refused(WallScoreSettings::default()), None);
    }
}
