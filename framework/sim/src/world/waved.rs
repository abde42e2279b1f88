//! One light on a stick, as a person waves it to calibrate a room: held still at some places, then all about the volume.

use foveate_node::ConfigError;
use nalgebra::Point3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// How long it is held still at each place [s].
const STOP_S: f64 = 1.5;
/// How long from one place to the next [s].
const BETWEEN_S: f64 = 1.0;
/// The wave's extent along x and y, of the area that it uses [–].
const EXTENT: f64 = 0.9;
/// Lowest and highest place without settings of its own [m].
const HEIGHTS_M: [f64; 2] = [0.2, 2.1];

/// Where a light is held still, and where and how fast it is waved afterwards.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct WaveSettings {
    /// Places at which it is held still at first for 1.5 s each, a second apart: the origin of the floor, on its X axis, on its Y axis unless others are
    /// named [m].
    pub stops_m: Vec<[f64; 3]>,
    /// Corner of the box in which it is waved, with the least coordinates. Left out, together with the other: the `walk_area_m`, 0.2 to 2.1 m high [m].
    pub min_m: Option<[f64; 3]>,
    /// Corner with the greatest coordinates [m].
    pub max_m: Option<[f64; 3]>,
    /// Cycles a second along x, y and z; they should be slow in a large box, since people do not run [Hz].
    #[schemars(inner(range(min = 0.001, max = 5.0)))]
    pub turns_hz: [f64; 3],
}

impl Default for WaveSettings {
    fn default() -> Self {
        Self {
            stops_m: vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]],
            min_m: None,
            max_m: None,
            // They repeat after minutes only.
            turns_hz: [0.23, 0.31, 0.53],
        }
    }
}

impl WaveSettings {
    /// Refuses numbers out of their ranges, and one corner of the box without the other.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        for place in self.stops_m.iter().flatten() {
            ConfigError::unless_in("wave.stops_m", *place, -1e4..=1e4)?;
        }
        for turns in self.turns_hz {
            ConfigError::unless_in("wave.turns_hz", turns, 0.001..=5.0)?;
        }
        for place in self.min_m.iter().chain(&self.max_m).flatten() {
            ConfigError::unless_in("wave.min_m", *place, -1e4..=1e4)?;
        }
        match (self.min_m, self.max_m) {
            (Some(low), Some(high)) if low.iter().zip(high).any(|(low, high)| *low > high) => {
                let message = format!("found {low:?} with `max_m = {high:?}`, expected no coordinate above that one's");
                Err(ConfigError::at("wave.min_m", message))
            }
            (Some(_), None) => Err(ConfigError::at("wave.min_m", "found without `max_m`, expected both or neither")),
            (None, Some(_)) => Err(ConfigError::at("wave.max_m", "found without `min_m`, expected both or neither")),
            _ => Ok(()),
        }
    }
}

/// The way of a waved light.
#[derive(Debug, Clone)]
pub(super) struct Wave {
    stops: Vec<Point3<f64>>,
    middle: Point3<f64>,
    /// How far it goes to either side [m].
    half: [f64; 3],
    turns_hz: [f64; 3],
}

impl Wave {
    /// In an area of these extents around the origin, where the settings name no box [m].
    pub fn new(settings: &WaveSettings, area_m: [f64; 2]) -> Wave {
        let [low, high] = match (settings.min_m, settings.max_m) {
            (Some(low), Some(high)) => [low, high],
            _ => [-1.0, 1.0].map(|side| {
                let [x, y] = area_m.map(|it| side * EXTENT * it / 2.0);
                [x, y, HEIGHTS_M[usize::from(side > 0.0)]]
            }),
        };
        Wave {
            stops: settings.stops_m.iter().map(|it| Point3::from(*it)).collect(),
            middle: nalgebra::center(&low.into(), &high.into()),
            half: [0, 1, 2].map(|axis| (high[axis] - low[axis]) / 2.0),
            turns_hz: settings.turns_hz,
        }
    }

    /// Where it is, `time_s` after it was taken up [m].
    pub fn position(&self, time_s: f64) -> Point3<f64> {
        let period = STOP_S + BETWEEN_S;
        let index = (time_s / period).floor().clamp(0.0, self.stops.len() as f64) as usize;
        let begin = index as f64 * period;
        let Some(&stop) = self.stops.get(index) else { return self.waved(time_s - begin) };
        let next = self.stops.get(index + 1).copied().unwrap_or_else(|| self.waved(0.0));
        let part = ((time_s - begin - STOP_S) / BETWEEN_S).clamp(0.0, 1.0);
        stop + (next - stop) * (part * part * (3.0 - 2.0 * part))
    }

    fn waved(&self, time_s: f64) -> Point3<f64> {
        let turn = |axis: usize| (std::f64::consts::TAU * self.turns_hz[axis] * time_s).sin();
        Point3::from([0, 1, 2].map(|axis| self.middle[axis] + self.half[axis] * turn(axis)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA_M: [f64; 2] = [2.5, 4.0];

    fn wave() -> Wave {
        Wave::new(&WaveSettings::default(), AREA_M)
    }

    /// Extent along each axis from 7.5 s on, and the middle [m].
    fn extent(wave: &Wave, from_s: f64) -> [[f64; 3]; 2] {
        let waved: Vec<Point3<f64>> = (0..8000).map(|it| wave.position(from_s + 0.01 * f64::from(it))).collect();
        let of =
            |axis: usize, start: f64, better: fn(f64, f64) -> f64| waved.iter().map(|it| it[axis]).fold(start, better);
        let [low, high] = [0, 1].map(|end: usize| {
            [0, 1, 2].map(|axis| match end {
                0 => of(axis, f64::INFINITY, f64::min),
                _ => of(axis, f64::NEG_INFINITY, f64::max),
            })
        });
        [[0, 1, 2].map(|axis| high[axis] - low[axis]), [0, 1, 2].map(|axis| (high[axis] + low[axis]) / 2.0)]
    }

    #[test]
    fn light_stands_on_the_floor_three_times_and_then_goes_everywhere() {
        for (index, stop) in WaveSettings::default().stops_m.iter().enumerate() {
            let begin = 2.5 * index as f64;
            for time_s in [begin, begin + 0.7, begin + 1.499] {
                assert_eq!(wave().position(time_s), Point3::from(*stop));
            }
        }
        let [extents, _] = extent(&wave(), 7.5);
        for (found, expected) in extents.into_iter().zip([2.25, 3.6, 1.9]) {
            assert!((found - expected).abs() < 0.02);
        }
    }

    #[test]
    fn box_and_stops_are_those_of_the_settings() {
        let settings = WaveSettings {
            stops_m: vec![[0.0, 0.0, 1.6], [0.5, 0.0, 1.6]],
            min_m: Some([-1.0, 2.0, 0.5]),
            max_m: Some([3.0, 4.0, 1.5]),
            turns_hz: [0.1, 0.07, 0.3],
        };
        assert!(settings.check().is_ok());
        let wave = Wave::new(&settings, AREA_M);
        assert_eq!(wave.position(3.0), Point3::new(0.5, 0.0, 1.6));
        let [extents, middle] = extent(&wave, 5.0);
        for (found, expected) in extents.into_iter().chain(middle).zip([4.0, 2.0, 1.0, 1.0, 3.0, 1.0]) {
            assert!((found - expected).abs() < 0.01, "{found} m, expected {expected} m");
        }
        let refused = |change: fn(&mut WaveSettings)| {
            let mut settings = settings.clone();
            change(&mut settings);
            settings.check().err().and_then(|it| it.setting).unwrap()
        };
        assert_eq!(refused(|it| it.max_m = None), "wave.min_m");
        assert_eq!(refused(|it| it.min_m = None), "wave.max_m");
        assert_eq!(refused(|it| it.min_m = Some([0.0, 5.0, 0.0])), "wave.min_m");
        assert_eq!(refused(|it| it.turns_hz[1] = 0.0), "wave.turns_hz");
        assert_eq!(refused(|it| it.stops_m[1][2] = f64::NAN), "wave.stops_m");
    }

    #[test]
    fn it_never_jumps() {
        let wave = wave();
        let mut last = wave.position(0.0);
        for it in 1..20_000 {
            let here = wave.position(f64::from(it) * 1e-3);
            assert!((here - last).norm() < 6e-3, "{} s", f64::from(it) * 1e-3);
            last = here;
        }
    }
}
