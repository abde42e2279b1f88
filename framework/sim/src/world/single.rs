//! Lights by themselves, in place of people: one waved by hand, swung from side to side, or on a path from a file, or several that dart about.

use foveate_diagnostics::fields::Splitter;
use foveate_node::ConfigError;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::bust::BustSettings;
use super::darts::Dart;
use super::waved::Wave;

/// Step of derivatives [s].
const STEP_S: f64 = 1e-4;
/// How the width and the pace of a swing wander, each with a rate of its own [rad/s]: they repeat after minutes only.
const WANDER_RAD_S: [f64; 2] = [0.83, 0.59];

/// A light that is swung from side to side, in turns now wider, now faster.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SwingSettings {
    /// The middle [m].
    pub middle_m: [f64; 3],
    /// How far it goes to either side [m].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub amplitude_m: f64,
    /// Direction of the swing over the floor, from X towards Y [°].
    #[schemars(range(min = -360.0, max = 360.0))]
    pub direction_deg: f64,
    /// To the other side and back [s].
    #[schemars(range(min = 0.2, max = 600.0))]
    pub period_s: f64,
    /// By how much width and pace wander, relative to themselves; 0: a pendulum [–].
    #[schemars(range(min = 0.0, max = 0.9))]
    pub variation: f64,
    /// How far it bobs up and down, twice in each period [m].
    #[schemars(range(min = 0.0, max = 10.0))]
    pub bob_m: f64,
}

impl Default for SwingSettings {
    fn default() -> Self {
        Self {
            middle_m: [0.0, 0.0, 1.5],
            amplitude_m: 0.5,
            direction_deg: 90.0,
            period_s: 2.4,
            variation: 0.1,
            bob_m: 0.03,
        }
    }
}

impl SwingSettings {
    /// Refuses numbers out of their ranges.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        for middle in self.middle_m {
            ConfigError::unless_in("swing.middle_m", middle, -1e4..=1e4)?;
        }
        ConfigError::unless_in("swing.amplitude_m", self.amplitude_m, 0.0..=100.0)?;
        ConfigError::unless_in("swing.direction_deg", self.direction_deg, -360.0..=360.0)?;
        ConfigError::unless_in("swing.period_s", self.period_s, 0.2..=600.0)?;
        ConfigError::unless_in("swing.variation", self.variation, 0.0..=0.9)?;
        ConfigError::unless_in("swing.bob_m", self.bob_m, 0.0..=10.0)
    }

    fn position(&self, time_s: f64) -> Point3<f64> {
        let [width, pace] = WANDER_RAD_S;
        // The phase is the integral of a pace that wanders: ω (1 + v cos Ωt).
        let omega = std::f64::consts::TAU / self.period_s;
        let phase = omega * (time_s + self.variation / pace * (pace * time_s).sin());
        let side = self.amplitude_m * (1.0 + self.variation * (width * time_s).sin()) * phase.sin();
        let (sin, cos) = self.direction_deg.to_radians().sin_cos();
        Point3::from(self.middle_m) + Vector3::new(side * cos, side * sin, self.bob_m * (2.0 * phase).sin())
    }
}

/// A path as it was measured.
#[derive(Debug, Clone, PartialEq)]
pub struct LightPath(Vec<(f64, Point3<f64>)>);

impl LightPath {
    /// Reads `time_s,x_m,y_m,z_m`, a heading and then a row for each time, ascending; or the paths of several lights, `time_s,target,x_m,y_m,z_m` as in `truth.csv`, in the order of their names' first rows.
    ///
    /// # Errors
    /// The line, what it holds and what was expected.
    pub fn parse_all(text: &str) -> Result<Vec<LightPath>, String> {
        const ONE: [&str; 4] = ["time_s", "x_m", "y_m", "z_m"];
        const SEVERAL: [&str; 5] = ["time_s", "target", "x_m", "y_m", "z_m"];
        const EXPECTED: &str = "`time_s,x_m,y_m,z_m`, or `time_s,target,x_m,y_m,z_m`";
        let mut lights: Vec<(String, LightPath)> = Vec::new();
        let mut splitter = Splitter::new(',');
        let mut has_names = None;
        let lines = (1..).zip(text.trim_start_matches('\u{feff}').lines());
        for (number, line) in lines.filter(|it| !it.1.trim().is_empty()) {
            let words: Vec<String> = splitter.split(line).iter().map(|it| it.trim().to_owned()).collect();
            let is_heading = has_names.is_none() && words.iter().all(|it| it.parse::<f64>().is_err());
            if is_heading {
                // Other lengths than metres are named as such, other words are not.
                let plain = |it: &String| it.replace([' ', ','], if it.contains(' ') { "" } else { "_" });
                let names: Vec<String> = words.iter().map(plain).collect();
                let is_other = |(name, told): (&String, &str)| {
                    let unit = |it: &str| it.rsplit_once('_').map(|it| it.1.to_owned());
                    unit(name).is_some_and(|it| Some(it) != unit(told))
                };
                let told: &[&str] = if names.len() == SEVERAL.len() { &SEVERAL } else { &ONE };
                if let Some(at) = names.iter().zip(told.iter().copied()).position(is_other) {
                    return Err(format!("line {number}: found a column `{}`, expected {EXPECTED}", words[at]));
                }
                has_names = Some(names.len() == SEVERAL.len());
                continue;
            }
            let has_names = *has_names.get_or_insert(false);
            let (name, numbers) = match (has_names, words.as_slice()) {
                (true, [time, name, place @ ..]) => (name.clone(), [std::slice::from_ref(time), place].concat()),
                (_, all) => (String::new(), all.to_vec()),
            };
            let fields: Vec<Option<f64>> = numbers.iter().map(|it| it.parse().ok()).collect();
            let [Some(time), Some(x), Some(y), Some(z)] = fields[..] else {
                let found: String = line.chars().take(60).collect();
                let expected = if has_names { SEVERAL.join(",") } else { ONE.join(",") };
                return Err(format!(
                    "line {number}: found `{found}`, expected {} values: {expected}",
                    4 + usize::from(has_names)
                ));
            };
            if ![time, x, y, z].iter().all(|it| it.is_finite()) {
                return Err(format!("line {number}: found `{line}`, expected numbers"));
            }
            let at = lights.iter().position(|it| it.0 == name).unwrap_or(lights.len());
            if at == lights.len() {
                lights.push((name, LightPath(Vec::new())));
            }
            let LightPath(rows) = &mut lights[at].1;
            if let Some((last, _)) = rows.last().filter(|it| it.0 >= time) {
                return Err(format!("line {number}: found time {time} after {last}, expected ascending times"));
            }
            rows.push((time, Point3::new(x, y, z)));
        }
        let short = lights.iter().find(|it| it.1.0.len() < 2);
        if lights.is_empty() || short.is_some() {
            let (n, whose) = short.map_or((0, String::new()), |(name, LightPath(rows))| {
                (rows.len(), if name.is_empty() { String::new() } else { format!(" of `{name}`") })
            });
            return Err(format!("found {n} rows{whose}, expected two or more of {EXPECTED}"));
        }
        Ok(lights.into_iter().map(|it| it.1).collect())
    }

    /// On smooth curves through the rows (Catmull and Rom's, by the times); before the first and after the last it rests there.
    fn position(&self, time_s: f64) -> Point3<f64> {
        let rows = &self.0;
        let place = rows.partition_point(|it| it.0 <= time_s);
        if place == 0 || place == rows.len() {
            return rows[place.min(rows.len() - 1)].1;
        }
        let (before, after) = (place - 1, place);
        let slope = |at: usize| {
            let (low, high) = (at.saturating_sub(1), (at + 1).min(rows.len() - 1));
            (rows[high].1 - rows[low].1) / (rows[high].0 - rows[low].0)
        };
        let gap = rows[after].0 - rows[before].0;
        let part = (time_s - rows[before].0) / gap;
        let (square, cube) = (part * part, part * part * part);
        let way = rows[after].1 - rows[before].1;
        rows[before].1
            + way * (3.0 * square - 2.0 * cube)
            + slope(before) * (gap * (cube - 2.0 * square + part))
            + slope(after) * (gap * (cube - square))
    }
}

/// What one light does.
#[derive(Debug, Clone)]
pub(super) enum Single {
    /// As a person waves it to calibrate.
    Waved(Wave),
    Swung(SwingSettings),
    Path(LightPath),
    Darting(Dart),
    /// On a bust that is there from the session's start on, taken up so much later [s].
    OnBust(BustSettings, f64),
}

impl Single {
    /// Where it is, `time_s` after it was taken up [m].
    pub fn position(&self, time_s: f64) -> Point3<f64> {
        match self {
            Single::Waved(wave) => wave.position(time_s),
            Single::Swung(swing) => swing.position(time_s),
            Single::Path(path) => path.position(time_s),
            Single::Darting(dart) => dart.position(time_s),
            Single::OnBust(bust, since_s) => bust.light(since_s + time_s),
        }
    }

    /// How it moves [m/s].
    pub fn velocity(&self, time_s: f64) -> Vector3<f64> {
        (self.position(time_s + STEP_S) - self.position(time_s - STEP_S)) / (2.0 * STEP_S)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_swing_keeps_its_width_and_its_direction() {
        let swing = SwingSettings { direction_deg: 0.0, ..SwingSettings::default() };
        let places: Vec<Point3<f64>> = (0..6000).map(|it| swing.position(f64::from(it) * 0.01)).collect();
        let most = places.iter().map(|it| it.x.abs()).fold(0.0, f64::max);
        assert!((0.5..0.551).contains(&most), "{most}");
        assert!(places.iter().all(|it| it.y.abs() < 1e-12 && (it.z - 1.5).abs() <= 0.03));
        let turns = places.windows(2).filter(|it| it[0].x * it[1].x < 0.0).count();
        assert!((47..=53).contains(&turns), "{turns} half periods of 1.2 s in 60 s");
    }

    #[test]
    fn a_path_goes_through_its_rows_and_never_jumps() {
        let [path] = &LightPath::parse_all("time_s,x_m,y_m,z_m\n0,0,0,1\n0.5, 1,0,1\n\n2,1,3,1\n").unwrap()[..] else {
            panic!()
        };
        assert_eq!(path.position(0.5), Point3::new(1.0, 0.0, 1.0));
        assert_eq!(path.position(-1.0), Point3::new(0.0, 0.0, 1.0));
        assert_eq!(path.position(9.0), Point3::new(1.0, 3.0, 1.0));
        let places: Vec<Point3<f64>> = (0..2500).map(|it| path.position(f64::from(it) * 1e-3)).collect();
        assert!(places.windows(2).all(|it| (it[1] - it[0]).norm() < 6e-3));
    }

    #[test]
    fn several_lights_have_their_own_paths() {
        let text = "time_s,target,x_m,y_m,z_m\n0,7,0,0,1\n0,left,2,0,1\n1,7,2,0,1\n1,left,0,0,1\n2,left,0,1,1\n";
        let [one, other] = &LightPath::parse_all(text).unwrap()[..] else { panic!() };
        // They pass each other.
        assert!((one.position(0.5).x - 1.0).abs() < 1e-9 && (0.8..1.2).contains(&other.position(0.5).x));
        assert_eq!((one.position(1.0).x, other.position(1.0).x, other.position(2.0).y), (2.0, 0.0, 1.0));
        let refused = |text: &str| LightPath::parse_all(text).unwrap_err();
        assert!(
            refused("time_s,target,x_m,y_m,z_m\n0,7,0,0,1\n0,8,2,0,1\n1,7,2,0,1\n").contains("found 1 rows of `8`")
        );
        assert!(refused("time_s,target,x_m,y_m,z_m\n0,0,0,1\n").contains("expected 5 values"));
    }

    #[test]
    fn bad_rows_are_named() {
        let refused = |text: &str| LightPath::parse_all(text).unwrap_err();
        assert!(refused("time_s,x_m,y_m,z_m\n0,0,0,1\n0,1,1,1").contains("line 3: found time 0 after 0"));
        assert!(refused("0,0,0,1\n1,2,3").contains("line 2: found `1,2,3`"));
        assert!(
            refused("0,0,0,1\n1,\"2,5\",0,1").contains("line 2: found `1,\"2,5\",0,1`"),
            "a comma inside of quotes"
        );
        assert!(LightPath::parse_all("\u{feff}\"time, s\",x_m,y_m,z_m\r\n\"0\", \"0\",0,1\r\n1,0,0,1\r\n").is_ok());
        assert!(refused("0,0,0,NaN\n1,2,3,4").contains("line 1: found `0,0,0,NaN`, expected numbers"));
        assert!(refused("0,0,0,1").contains("found 1 rows"));
        assert!(refused("time_s,x_mm,y_mm,z_mm\n0,0,0,1\n1,0,0,1").contains("line 1: found a column `x_mm`, expected"));
        assert!(refused("time_ms,x_m,y_m,z_m\n0,0,0,1\n1,0,0,1").contains("`time_ms`"));
        assert!(refused("").contains("found 0 rows"));
    }
}
