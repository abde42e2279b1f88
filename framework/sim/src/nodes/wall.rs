//! The simulated wall as a source: the world that cameras look at, the truth, what is shown.

use foveate_messages::{CameraSet, Provenance, Target, TargetId, Targets};
use foveate_node::{ConfigError, Due, Io, Node, NodeError, Plan, Ports, Report, Role, Setup, Time, ports};
use nalgebra::{Matrix6, Vector3};

use crate::truth::Truth;
use crate::wall::{Wall, WallSettings, in_wall_space};

ports! {
    WALL: Out<Wall> = "wall";
    TRUTH: Out<Targets> = "truth";
    SHOWN: Out<Targets> = "shown";
}

/// Name of the file with the true cameras in the folder for results.
const TRUTH_FILE: &str = "truth.calibration.toml";

/// Gives the wall once, at time 0. Then, `truth_hz` times a second, the spots of pointers as they are (`truth`: the identity is the number of the press), and what the
/// wall is commanded to show that is small and bright (`shown`: dots, corners of the board or red spots by their number, whose covariance is their extent): it appears later by the display's latency.
pub struct SimWall {
    wall: Wall,
    stated: Option<(String, std::path::PathBuf)>,
    truth_hz: f64,
    next: u64,
}

impl Node for SimWall {
    const TYPE: &'static str = "sim.wall";
    const ROLE: Role = Role::Source;
    const SUMMARY: &'static str = "A simulated wall of displays with moving contents and the spots of laser pointers";
    type Settings = WallSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: WallSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let truth = settings.truth.as_ref().map_or(Ok(Truth::default()), |it| Truth::draw(it, setup))?;
        let mut stated = None;
        if let (true, Some(folder)) = (settings.truth.is_some(), &setup.out_dir) {
            setup.claim_file(Some("truth"), TRUTH_FILE)?;
            stated = Some((truth.stated().to_owned(), folder.clone()));
        }
        let truth_hz = settings.truth_hz;
        Ok(Self { wall: Wall::new(settings, truth, &setup.random), stated, truth_hz, next: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let time = self.next_time();
        if self.next == 0 {
            io.emit_at(&WALL, time, self.wall.clone());
        }
        let mut truth = Targets { time, list: Vec::new() };
        truth.list.extend(self.wall.presses(time).map(|it| Target {
            id: TargetId(it.number),
            position: in_wall_space(&it.point),
            velocity: Vector3::zeros(),
            covariance: Matrix6::zeros(),
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        }));
        truth.list.sort_by_key(|it| it.id);
        io.emit_at(&TRUTH, time, truth);
        let mut shown = Targets { time, list: Vec::new() };
        self.wall.commanded(time, |number, light| {
            let mut covariance = Matrix6::zeros();
            covariance.fixed_view_mut::<2, 2>(0, 0).fill_diagonal(light.sigma * light.sigma);
            shown.list.push(Target {
                id: TargetId(number),
                position: in_wall_space(&light.point),
                velocity: Vector3::zeros(),
                covariance,
                cameras: CameraSet::default(),
                provenance: Provenance::Measured,
            });
        });
        io.emit_at(&SHOWN, time, shown);
        self.next += 1;
        Ok(())
    }

    fn due(&mut self) -> Due {
        Due::At(self.next_time())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Some((text, folder)) = &self.stated else { return Ok(()) };
        report.save(folder, TRUTH_FILE, text)
    }

    fn plan(settings: &WallSettings) -> Plan {
        // The wall is as it is: nobody changes it.
        Plan { rate_hz: Some(settings.truth_hz), reacts_after_s: f64::INFINITY, ..Plan::default() }
    }
}

impl SimWall {
    fn next_time(&self) -> Time {
        Time::from_s(self.next as f64 / self.truth_hz)
    }
}

#[cfg(test)]
mod tests {
    use foveate_testkit::check_node;

    use super::*;
    use crate::wall::{BoardSettings, DotSettings};

    #[test]
    fn node_keeps_the_law() {
        check_node::<SimWall>("");
        check_node::<SimWall>("users = 2\ncross = false\ntiles = [2, 1]\nred_spots = 3");
        check_node::<SimWall>("dots = { grid = [2, 2] }\ndark_tile = [3, 1]");
        check_node::<SimWall>("board = { grid = [2, 2] }\ncurve = { radius_m = -3 }");
        check_node::<SimWall>("wave = { hold_s = 1 }");
    }

    #[test]
    fn values_out_of_range_are_refused_by_name() {
        let refused = |change: fn(&mut WallSettings)| {
            let mut settings = WallSettings::default();
            change(&mut settings);
            SimWall::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting)
        };
        assert_eq!(refused(|_| ()), None);
        assert_eq!(refused(|it| it.pointer_rgb = vec![[1.0, 1.5, 0.0]]).as_deref(), Some("pointer_rgb"));
        assert_eq!(refused(|it| it.users = 17).as_deref(), Some("users"));
        assert_eq!(refused(|it| it.part_s = f64::NAN).as_deref(), Some("part_s"));
        assert_eq!(refused(|it| it.dark_tile = Some([4, 0])).as_deref(), Some("dark_tile"));
        assert_eq!(refused(|it| it.reflection = 1.5).as_deref(), Some("reflection"));
        let dots = |it: &mut WallSettings| it.dots = Some(DotSettings { grid: [0, 3], ..DotSettings::default() });
        assert_eq!(refused(dots).as_deref(), Some("dots.grid"));
        let board =
            |it: &mut WallSettings| it.board = Some(BoardSettings { square_px: 90, ..BoardSettings::default() });
        assert_eq!(refused(board), None);
        let board =
            |it: &mut WallSettings| it.board = Some(BoardSettings { square_px: 130, ..BoardSettings::default() });
        assert_eq!(refused(board).as_deref(), Some("board.square_px"));
        let both =
            |it: &mut WallSettings| (it.dots, it.wave) = (Some(DotSettings::default()), Some(Default::default()));
        assert_eq!(refused(both).as_deref(), Some("wave"));
        let truth = |it: &mut WallSettings| it.truth = Some(Default::default());
        assert_eq!(refused(truth).as_deref(), Some("truth.plan"));
    }
}
