//! A bust: a head that does not deform, on a stand or moved to and fro by hand, with a light above it for the large scale to track.

use std::collections::VecDeque;
use std::f64::consts::PI;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

use foveate_estimation::random::Random;
use foveate_node::ConfigError;
use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::painted::{FaceSettings, FaceSource, MOST_MARKS, Part, Skin};

/// How long a hand keeps its pace before it turns: with 1 it would turn within no time.
const STRAIGHT: f64 = 0.95;

/// A bust with the built-in head's shape and skin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BustSettings {
    /// Where the middle of its head is, at rest [m].
    pub position_m: [f64; 3],
    /// Where it looks, from X towards Y [°].
    #[schemars(range(min = -360.0, max = 360.0))]
    pub facing_deg: f64,
    /// Marks that are painted on it [–].
    #[schemars(range(min = 0, max = 76))]
    pub marks: usize,
    /// How fast it is moved to and fro, but for the turns; 0: it stays [m/s].
    #[schemars(range(min = 0.0, max = 5.0))]
    pub speed_m_s: f64,
    /// How far to either side [m].
    #[schemars(range(min = 0.001, max = 10.0))]
    pub reach_m: f64,
    /// Along which direction over the floor, from X towards Y [°].
    #[schemars(range(min = -360.0, max = 360.0))]
    pub direction_deg: f64,
    /// How long it rests wherever it turns [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub rests_s: f64,
    /// From when on it is moved [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub moves_from_s: f64,
    /// How bright a white surface looks that faces the light of the room, gain 1: as of a painted face [gray level].
    #[schemars(range(min = 0.0, max = 500.0))]
    pub light: f64,
    /// Where a light is fixed to it, forward, left and up from the middle of its head. Left out: there is none [m].
    pub light_m: Option<[f64; 3]>,
}

impl Default for BustSettings {
    fn default() -> Self {
        Self {
            position_m: [0.0, 0.0, 1.5],
            facing_deg: 90.0,
            marks: 0,
            speed_m_s: 0.0,
            reach_m: 0.3,
            direction_deg: 0.0,
            rests_s: 0.0,
            moves_from_s: 0.0,
            light: 260.0,
            light_m: Some([0.0, 0.0, 0.16]),
        }
    }
}

impl BustSettings {
    /// Refuses numbers out of their ranges.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        for position in self.position_m {
            ConfigError::unless_in("bust.position_m", position, -1e3..=1e3)?;
        }
        ConfigError::unless_in("bust.facing_deg", self.facing_deg, -360.0..=360.0)?;
        ConfigError::unless_in("bust.marks", self.marks, 0..=MOST_MARKS)?;
        ConfigError::unless_in("bust.speed_m_s", self.speed_m_s, 0.0..=5.0)?;
        ConfigError::unless_in("bust.reach_m", self.reach_m, 1e-3..=10.0)?;
        ConfigError::unless_in("bust.direction_deg", self.direction_deg, -360.0..=360.0)?;
        ConfigError::unless_in("bust.rests_s", self.rests_s, 0.0..=1e6)?;
        ConfigError::unless_in("bust.moves_from_s", self.moves_from_s, 0.0..=1e6)?;
        ConfigError::unless_in("bust.light", self.light, 0.0..=500.0)?;
        self.light_m.iter().flatten().try_for_each(|it| ConfigError::unless_in("bust.light_m", *it, -1.0..=1.0))
    }

    pub(super) fn has_light(&self) -> bool {
        self.light_m.is_some()
    }

    /// How far it is to the side at `time_s` [m].
    fn side(&self, time_s: f64) -> f64 {
        let mut since_s = time_s - self.moves_from_s;
        if self.speed_m_s == 0.0 || since_s <= 0.0 {
            return 0.0;
        }
        // asin(k sin φ) goes from one end to the other nearly evenly; in the middle with the slope k.
        let steep = STRAIGHT.asin();
        let lasts_s = |way: f64| way.abs() * PI * STRAIGHT / (2.0 * steep * self.speed_m_s);
        let along = |share: f64| 0.5 + (STRAIGHT * (PI * (share - 0.5)).sin()).asin() / (2.0 * steep);
        let first_s = lasts_s(self.reach_m);
        if since_s < first_s {
            return self.reach_m * along(since_s / first_s);
        }
        since_s -= first_s;
        let way_s = lasts_s(2.0 * self.reach_m);
        let turns = (since_s / (self.rests_s + way_s)).floor();
        let share = ((since_s - turns * (self.rests_s + way_s) - self.rests_s) / way_s).max(0.0);
        let sign = if turns.rem_euclid(2.0) == 0.0 { 1.0 } else { -1.0 };
        sign * self.reach_m * (1.0 - 2.0 * along(share))
    }

    /// Where it stands at `time_s`.
    fn world_from_bust(&self, time_s: f64) -> Isometry3<f64> {
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), self.facing_deg.to_radians());
        let (sin, cos) = self.direction_deg.to_radians().sin_cos();
        let place = Vector3::from(self.position_m) + Vector3::new(cos, sin, 0.0) * self.side(time_s);
        Isometry3::from_parts(Translation3::from(place), turn)
    }

    /// Where its light is at `time_s`; in the middle of its head where it has none [m].
    pub(super) fn light(&self, time_s: f64) -> Point3<f64> {
        self.world_from_bust(time_s) * Point3::from(self.light_m.unwrap_or_default())
    }
}

/// Surfaces that are kept: those of moments that several ask for.
const KEPT: usize = 16;

/// The bust of a world.
pub(super) struct Bust {
    settings: BustSettings,
    part: Part,
    recent: Mutex<VecDeque<Arc<Skin>>>,
}

impl Bust {
    pub fn new(settings: &BustSettings, random: &Random) -> Bust {
        let face = FaceSettings {
            marks: settings.marks,
            light: settings.light,
            source: FaceSource::BuiltIn,
            ..FaceSettings::default()
        };
        let part = Part::new(&face, None, 0.0, 0.0, random);
        Bust { settings: settings.clone(), part, recent: Mutex::default() }
    }

    pub fn part(&self) -> &Part {
        &self.part
    }

    /// Its surface at `time_s`; the very same while it is at rest.
    pub fn skin(&self, time_s: f64) -> Arc<Skin> {
        let stands = self.settings.world_from_bust(time_s);
        let recent = || self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = recent().iter().find(|it| it.world_from_part == stands) {
            return Arc::clone(known);
        }
        let skin = Arc::new(self.part.skin_at_rest(stands));
        let mut recent = recent();
        recent.truncate(KEPT - 1);
        recent.push_front(Arc::clone(&skin));
        skin
    }
}

impl fmt::Debug for Bust {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Bust").field("settings", &self.settings).finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bust_moves_at_its_speed_and_no_farther_than_its_reach() {
        let bust = BustSettings { speed_m_s: 0.2, reach_m: 0.3, moves_from_s: 2.0, ..BustSettings::default() };
        let place = |time_s: f64| bust.world_from_bust(time_s).translation.vector;
        assert!(place(0.0) == place(2.0) && place(2.0) == Vector3::new(0.0, 0.0, 1.5));
        let steps: Vec<Vector3<f64>> = (200..3000).map(|it| place(f64::from(it) * 0.01)).collect();
        let speeds: Vec<f64> = steps.windows(2).map(|it| (it[1] - it[0]).norm() / 0.01).collect();
        let near = speeds.iter().filter(|it| (**it - 0.2).abs() < 0.03).count() as f64 / speeds.len() as f64;
        assert!(near > 0.5 && speeds.iter().all(|it| *it < 0.26), "{near}");
        let most = steps.iter().map(|it| it.x.abs()).fold(0.0, f64::max);
        assert!((0.29..0.3001).contains(&most), "{most}");
        let resting = BustSettings { rests_s: 1.5, ..bust.clone() };
        let sides: Vec<f64> = (0..4000).map(|it| resting.side(f64::from(it) * 0.01)).collect();
        let still = sides.windows(2).filter(|it| it[0] == it[1] && (it[0].abs() - 0.3).abs() < 1e-9).count();
        // Rests of 150 steps, at either end in turn, with ways of about 3.9 s between them.
        assert!((1050..=1200).contains(&still), "{still}");
        assert!(sides.windows(2).all(|it| (it[1] - it[0]).abs() < 0.0026));
        assert!(sides.iter().any(|it| *it < -0.29) && sides.iter().any(|it| *it > 0.29));
    }

    #[test]
    fn the_light_stands_above_the_head_and_the_surface_is_shared_at_rest() {
        let settings = BustSettings::default();
        let bust = Bust::new(&settings, &Random::new(1));
        assert!((settings.light(1.0) - Point3::new(0.0, 0.0, 1.66)).norm() < 1e-12);
        assert!(Arc::ptr_eq(&bust.skin(0.0), &bust.skin(5.0)));
        let nose = bust.skin(0.0).vertices.iter().map(|it| it.y).fold(f64::MIN, f64::max);
        assert!((0.08..0.13).contains(&nose), "it looks along +Y: {nose}");
    }
}
