//! Compares where a display draws points behind it with where the true eyes should see them.

use foveate_estimation::random::Random;
use foveate_estimation::statistics::percentile;
use foveate_messages::{TileView, Views};
use foveate_node::{ConfigError, Figures, Io, Node, NodeError, Ports, Report, Role, Setup, figures, ports};
use nalgebra::{Point2, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::score::warmup::Warmup;
use crate::world::World;

ports! {
    WORLD: In<World> = latest("world");
    VIEWS: In<Views> = each("views");
    UNPREDICTED: In<Views> = each("unpredicted").optional();
    VELOCITY: In<Views> = each("velocity").optional();
}

figures! {
    "display_px.{median,p95}": px, low, "Distance on a tile between where a point behind it is drawn and where the true eye should see it, when people see the picture: mean over points, eyes and tiles, over all messages" => "drawn off where the eyes need it";
    "display_px.{median,p95}[unpredicted]": px, low, "The same of the views at `unpredicted`";
    "display_px.{median,p95}[velocity]": px, low, "The same of the views at `velocity`";
    "display_scored": count, neither, "Messages of views that were scored, since start_s";
    "display_blind": count, low, "Messages since start_s in which a tile had no view for an eye that is truly before it";
}

/// How far behind a tile the points are [m], and where on it they are seen from straight ahead, in parts of its size.
const DEPTHS: [f64; 2] = [0.3, 1.5];
const PLACES: [[f64; 2]; 4] = [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]];

/// Settings of [`DisplayScore`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct DisplayScoreSettings {
    /// Session time at which scoring begins [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub start_s: f64,
    /// How far the true corners of the tiles are from where the rig has them, standard deviation on each axis [mm]
    #[schemars(range(min = 0.0, max = 100.0))]
    pub registration_mm: f64,
}

impl Default for DisplayScoreSettings {
    fn default() -> Self {
        Self { start_s: 0.0, registration_mm: 1.0 }
    }
}

/// Compares views with true eyes and true tiles.
pub struct DisplayScore {
    settings: DisplayScoreSettings,
    random: Random,
    warmup: Warmup,
    /// Of each port, in their order: mean errors of messages [px].
    errors: [Vec<f64>; 3],
    n_scored: u64,
    n_blind: u64,
}

impl Node for DisplayScore {
    const TYPE: &'static str = "sim.display_score";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str =
        "Measures how far a head-tracked display draws things from where the eyes should see them";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = DisplayScoreSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: DisplayScoreSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("start_s", settings.start_s, 0.0..=1e6)?;
        ConfigError::unless_in("registration_mm", settings.registration_mm, 0.0..=100.0)?;
        let (random, warmup) = (setup.random.clone(), Warmup::default());
        Ok(Self { settings, random, warmup, errors: Default::default(), n_scored: 0, n_blind: 0 })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        for (place, port) in [&VIEWS, &UNPREDICTED, &VELOCITY].into_iter().enumerate() {
            let Some(views) = io.take(port) else { continue };
            if !self.warmup.is_scored(views.stamp.time, self.settings.start_s) {
                continue;
            }
            let Some(world) = io.latest(&WORLD) else { continue };
            let Some(eyes) = world.value.eyes(views.value.shown_at) else { continue };
            let mut found = Vec::new();
            let mut is_blind = false;
            for tile in &views.value.tiles {
                is_blind |= !self.compare(tile, &eyes, &mut found);
            }
            if !found.is_empty() {
                self.errors[place].push(found.iter().sum::<f64>() / found.len() as f64);
            }
            if place == 0 {
                self.n_scored += 1;
                self.n_blind += u64::from(is_blind);
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        for (errors, suffix) in self.errors.iter().zip(["", "[unpredicted]", "[velocity]"]) {
            if !errors.is_empty() || suffix.is_empty() {
                for (name, percent) in [("median", 50.0), ("p95", 95.0)] {
                    let value = percentile(errors, percent).unwrap_or(f64::NAN);
                    report.figure(format!("display_px.{name}{suffix}"), value);
                }
            }
        }
        report.figure("display_scored", self.n_scored as f64);
        report.figure("display_blind", self.n_blind as f64);
        if let Some(sentence) = self.warmup.remark(self.settings.start_s) {
            report.remark(format!("display: {sentence}"));
        }
        Ok(())
    }
}

impl DisplayScore {
    /// Errors of all points on one tile, for both eyes [px]; `false` where an eye has no view.
    fn compare(&self, tile: &TileView, eyes: &[Point3<f64>; 2], found: &mut Vec<f64>) -> bool {
        let (corner, right, up) = self.true_tile(tile);
        let normal = right.cross(&up).normalize();
        let size = tile.size_px.map(f64::from);
        let mut has_all = true;
        for (eye, view) in eyes.iter().zip(&tile.eyes) {
            let distance = normal.dot(&(eye - corner));
            if distance <= 0.0 {
                continue;
            }
            let Some(view) = view else {
                has_all = false;
                continue;
            };
            for depth in DEPTHS {
                for [x, y] in PLACES {
                    let point = corner + right * x + up * y - normal * depth;
                    // Where the line from the eye to the point goes through the tile.
                    let at = eye + (point - eye) * (distance / (distance + depth)) - corner;
                    let part = |edge: &Vector3<f64>| edge.dot(&at) / edge.norm_squared();
                    let expected = Point2::new(part(&right) * size[0], part(&up) * size[1]);
                    let clip = view.clip_from_space * point.to_homogeneous();
                    let drawn =
                        Point2::new((clip.x / clip.w + 1.0) / 2.0 * size[0], (clip.y / clip.w + 1.0) / 2.0 * size[1]);
                    found.push((drawn - expected).norm());
                }
            }
        }
        has_all
    }

    /// The true tile: its lower left corner, and its edges to the right and up [m]. The same for a tile each time.
    fn true_tile(&self, tile: &TileView) -> (Point3<f64>, Vector3<f64>, Vector3<f64>) {
        let mut random = self.random.fork(&tile.name);
        let sigma = self.settings.registration_mm * 1e-3;
        let corners = tile.corners.map(|it| it + Vector3::from_fn(|_, _| random.normal() * sigma));
        (corners[0], corners[1] - corners[0], corners[2] - corners[0])
    }
}

#[cfg(test)]
mod tests {
    use foveate_geometry::Screen;
    use foveate_messages::EyeView;
    use foveate_node::{NodeBench, Time};

    use super::*;
    use crate::world::SceneSettings;

    /// The score of views for eyes that are so far to the right of the true ones [m], on a tile before the walker.
    fn score(off: f64, registration_mm: f64) -> f64 {
        let settings = SceneSettings { headband: true, people_enter_s: 0.0, ..SceneSettings::default() };
        let world = World::new(settings, &Random::new(3));
        let corners = [[-0.6, 2.5, 0.9], [0.6, 2.5, 0.9], [-0.6, 2.5, 1.8]].map(Point3::from);
        let screen = Screen::from_corners(corners[0], corners[1], corners[2]).unwrap();
        let mut bench = NodeBench::<DisplayScore>::new(DisplayScoreSettings { registration_mm, start_s: 0.0 }).unwrap();
        bench.feed(&WORLD, Time::ZERO, world.clone()).unwrap();
        for step in 1..20 {
            let shown_at = Time::from_s(0.3 * f64::from(step));
            let eyes = world.eyes(shown_at).unwrap().map(|it| it + Vector3::x() * off);
            let view = |eye: Point3<f64>| {
                let found = screen.off_axis(&eye, [0.05, 50.0]).ok()?;
                Some(EyeView { eye, clip_from_space: found.clip_from_world })
            };
            let tile = TileView { name: "a".into(), size_px: [1200, 900], corners, eyes: eyes.map(view) };
            bench.feed(&VIEWS, shown_at, Views { time: shown_at, shown_at, tiles: vec![tile] }).unwrap();
        }
        let figures = bench.finish().unwrap().figures;
        assert_eq!((figures["display_scored"], figures["display_blind"]), (19.0, 0.0));
        figures["display_px.median"]
    }

    #[test]
    fn views_of_the_true_eyes_have_no_error_and_others_have_what_they_should() {
        assert!(score(0.0, 0.0) < 1e-6);
        // 10 mm to the side; a point 0.3 m or 1.5 m behind a tile at 1 m to 4 m shifts by 10 mm · b/(a + b): 0.7 to 6 mm, at 1000 px/m.
        let shifted = score(0.01, 0.0);
        assert!((0.7..6.0).contains(&shifted), "{shifted} px");
        assert!((0.2..5.0).contains(&score(0.0, 1.0)), "a millimetre at the corners is about a pixel");
    }
}
