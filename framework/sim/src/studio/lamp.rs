//! Lamps of the studio: what they shine over time, and the soft shadows of what stands in their light.
//!
//! A shadow map holds how far a lamp sees. How wide a shadow's edge is follows from how far in front of the lit place that lies which holds the light up, and from the lamp's size:
//! R. Fernando, "Percentage-closer soft shadows", SIGGRAPH sketches 2005.

use foveate_estimation::random::Random;
use foveate_node::ConfigError;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::texture::Colour;
use crate::painted::Triangle;
use crate::sight::FirstHits;

/// A lamp's [`LampSettings::light`] is that on a surface at this distance [m].
const REFERENCE_M: f64 = 2.0;
/// Columns and rows of a shadow map.
const MAP_PX: u32 = 256;
/// A surface holds up light of its own only beyond this: it is seen as steps from the lamp [m].
const BIAS_M: f32 = 8e-3;
/// Samples of the shadow map in search of an occluder, and then for its shadow.
const N_SEARCH: usize = 10;
const N_TAPS: usize = 16;
/// A map looks at most so far aside [tangent].
const WIDEST: f64 = 2.5;
/// Periods of a lamp's slow drift [s].
const DRIFT_S: [f64; 3] = [7.3, 17.9, 41.0];

/// A lamp that shines to all sides.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct LampSettings {
    /// Where it hangs [m].
    pub position_m: [f64; 3],
    /// What a white surface shows that faces it from 2 m, gain 1 [gray level].
    #[schemars(range(min = 0.0, max = 2000.0))]
    pub light: f64,
    /// Its red, green and blue, relative to white [–].
    #[schemars(inner(range(min = 0.0, max = 2.0)))]
    pub colour: [f64; 3],
    /// Radius of what shines: the edges of shadows are soft by it [m].
    #[schemars(range(min = 0.001, max = 1.0))]
    pub radius_m: f64,
    /// When it is switched on [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub from_s: f64,
    /// When it is switched off again; 0: never [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub until_s: f64,
    /// How long it takes to come on and to go off [s].
    #[schemars(range(min = 0.0, max = 100.0))]
    pub fade_s: f64,
    /// By how much its light pulses with the mains, as a part of it [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub flicker: f64,
    /// How often: twice the mains' frequency [Hz].
    #[schemars(range(min = 0.1, max = 1000.0))]
    pub flicker_hz: f64,
    /// By how much its light goes up and down within seconds and minutes, as that of clouds before a window, as a part of it [–].
    #[schemars(range(min = 0.0, max = 0.9))]
    pub drift: f64,
}

impl Default for LampSettings {
    fn default() -> Self {
        Self {
            position_m: [-1.5, -1.8, 2.85],
            light: 320.0,
            colour: [1.0, 0.96, 0.88],
            radius_m: 0.12,
            from_s: 0.0,
            until_s: 0.0,
            fade_s: 0.0,
            flicker: 0.0,
            flicker_hz: 100.0,
            drift: 0.0,
        }
    }
}

impl LampSettings {
    /// Refuses numbers out of their ranges.
    pub(super) fn check(&self) -> Result<(), ConfigError> {
        for position in self.position_m {
            ConfigError::unless_in("studio.lamps.position_m", position, -1e3..=1e3)?;
        }
        ConfigError::unless_in("studio.lamps.light", self.light, 0.0..=2000.0)?;
        for share in self.colour {
            ConfigError::unless_in("studio.lamps.colour", share, 0.0..=2.0)?;
        }
        ConfigError::unless_in("studio.lamps.radius_m", self.radius_m, 0.001..=1.0)?;
        ConfigError::unless_in("studio.lamps.from_s", self.from_s, 0.0..=1e6)?;
        ConfigError::unless_in("studio.lamps.until_s", self.until_s, 0.0..=1e6)?;
        ConfigError::unless_in("studio.lamps.fade_s", self.fade_s, 0.0..=100.0)?;
        ConfigError::unless_in("studio.lamps.flicker", self.flicker, 0.0..=1.0)?;
        ConfigError::unless_in("studio.lamps.flicker_hz", self.flicker_hz, 0.1..=1000.0)?;
        ConfigError::unless_in("studio.lamps.drift", self.drift, 0.0..=0.9)
    }
}

/// A lamp of the studio.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Lamp {
    settings: LampSettings,
    phases: [f64; 3],
    pub position: Point3<f64>,
}

impl Lamp {
    pub fn new(settings: &LampSettings, random: &mut Random) -> Self {
        let phases = [(); 3].map(|()| random.uniform_in(0.0, std::f64::consts::TAU));
        Self { settings: settings.clone(), phases, position: Point3::from(settings.position_m) }
    }

    /// How bright it is, relative to [`LampSettings::light`], on average over an exposure around `time_s`.
    pub fn level(&self, time_s: f64, exposure_s: f64) -> f64 {
        let LampSettings { from_s, until_s, fade_s, flicker, flicker_hz, drift, .. } = self.settings;
        let ramp = |since: f64| {
            if fade_s > 0.0 { (since / fade_s).clamp(0.0, 1.0) } else { f64::from(u8::from(since >= 0.0)) }
        };
        let mut level = ramp(time_s - from_s);
        if until_s > 0.0 {
            level *= 1.0 - ramp(time_s - until_s);
        }
        if flicker > 0.0 {
            // The mean of a sine over the exposure.
            let half_turn = std::f64::consts::PI * flicker_hz * exposure_s;
            let smeared = if half_turn > 1e-9 { half_turn.sin() / half_turn } else { 1.0 };
            let phase = std::f64::consts::TAU * (flicker_hz * time_s).fract() + self.phases[0];
            level *= 1.0 + flicker * smeared * phase.sin();
        }
        if drift > 0.0 {
            let waves = DRIFT_S
                .iter()
                .zip(self.phases)
                .map(|(period_s, phase)| (std::f64::consts::TAU * time_s / period_s + phase).sin() / 3.0);
            level *= 1.0 + drift * waves.sum::<f64>();
        }
        level
    }

    /// Of a white surface that faces it from 2 m [gray level].
    pub fn colour(&self) -> Colour {
        self.settings.colour.map(|it| (it * self.settings.light) as f32)
    }

    /// The share of its light that falls on a place that is turned this way, relative to one that faces it from 2 m, where nothing blocks it.
    #[inline]
    pub fn falls_on(&self, point: &Point3<f64>, normal: &Vector3<f32>) -> f32 {
        let to_lamp = self.position - point;
        let square = to_lamp.norm_squared().max(1e-4);
        let facing = normal.cast::<f64>().dot(&to_lamp) / square.sqrt();
        (facing.max(0.0) * REFERENCE_M * REFERENCE_M / square) as f32
    }
}

/// How far a lamp sees towards one thing.
#[derive(Debug, Default)]
pub(crate) struct ShadowMap {
    lamp: Point3<f64>,
    radius: f32,
    axes: [Vector3<f64>; 3],
    focal: f32,
    /// Of what is nearest [m].
    nearest: f32,
    hits: FirstHits,
}

impl ShadowMap {
    /// Of a lamp that shines on `vertices`, of which `used` count.
    pub fn new(lamp: &Lamp, vertices: &[Point3<f64>], triangles: &[Triangle]) -> Self {
        let (mut low, mut high) = (vertices[0].coords, vertices[0].coords);
        for vertex in vertices {
            low = low.inf(&vertex.coords);
            high = high.sup(&vertex.coords);
        }
        let middle = Point3::from((low + high) / 2.0);
        let to_middle = middle - lamp.position;
        let ahead = to_middle.try_normalize(1e-6).unwrap_or(-Vector3::z());
        let across = ahead.cross(&Vector3::y()).try_normalize(1e-3).unwrap_or(Vector3::x());
        let axes = [across, ahead.cross(&across), ahead];
        let seen: Vec<Option<[f64; 3]>> = vertices
            .iter()
            .map(|it| {
                let off = it - lamp.position;
                let depth = off.dot(&axes[2]);
                (depth > 0.05).then(|| [off.dot(&axes[0]) / depth, off.dot(&axes[1]) / depth, depth])
            })
            .collect();
        let reach = seen.iter().flatten().map(|it| it[0].abs().max(it[1].abs())).fold(0.01, f64::max).min(WIDEST);
        let nearest = seen.iter().flatten().map(|it| it[2]).fold(f64::INFINITY, f64::min);
        let half = 0.5 * f64::from(MAP_PX - 1);
        let focal = (half - 2.0) / reach;
        let place = |it: [f64; 3]| [(half + focal * it[0]) as f32, (half + focal * it[1]) as f32, (1.0 / it[2]) as f32];
        // What lies beside the lamp's view is nowhere.
        let imaged: Vec<[f32; 3]> = seen.iter().map(|it| it.map_or([0.0; 3], place)).collect();
        let mut hits = FirstHits::default();
        hits.draw(&imaged, triangles, [0.0; 2], [MAP_PX; 2]);
        Self {
            lamp: lamp.position,
            radius: lamp.settings.radius_m as f32,
            axes,
            focal: focal as f32,
            nearest: nearest as f32,
            hits,
        }
    }

    /// Where the line from the lamp to a point passes [px], and how far away that is [m]; `None` behind the lamp, and where nothing of the thing is nearer.
    #[inline]
    fn place(&self, point: &Point3<f64>) -> Option<[f32; 3]> {
        let off = (point - self.lamp).cast::<f32>();
        let along = |axis: usize| off.dot(&self.axes[axis].cast());
        let depth = along(2);
        if depth <= self.nearest {
            return None;
        }
        let half = 0.5 * (MAP_PX - 1) as f32;
        Some([half + self.focal * along(0) / depth, half + self.focal * along(1) / depth, depth])
    }

    /// Radius on the map of the cone from a place at `depth` to the lamp, where it passes `nearer` [px].
    fn cone(&self, depth: f32, nearer: f32) -> f32 {
        self.focal * self.radius * (depth - nearer).max(0.0) / (depth * nearer)
    }

    /// Whether some of its light may be held up somewhere in a box around these points.
    pub fn may_shade(&self, corners: &[Point3<f64>]) -> bool {
        let [columns, rows] = self.hits.area();
        let (mut low, mut high, mut reach) = ([f32::INFINITY; 2], [f32::NEG_INFINITY; 2], 0.0_f32);
        let mut is_behind = false;
        for corner in corners {
            let off = corner - self.lamp;
            let depth = off.dot(&self.axes[2]);
            if depth < 0.05 {
                is_behind = true;
                continue;
            }
            let half = 0.5 * f64::from(MAP_PX - 1);
            for axis in 0..2 {
                let at = (half + f64::from(self.focal) * off.dot(&self.axes[axis]) / depth) as f32;
                (low[axis], high[axis]) = (low[axis].min(at), high[axis].max(at));
            }
            reach = reach.max(self.cone(depth as f32, self.nearest));
        }
        // Beside the lamp a straight box is none on the map.
        if is_behind {
            return high[0] >= low[0];
        }
        let meets = |axis: usize, range: &std::ops::Range<usize>| {
            low[axis] - reach <= range.end as f32 && high[axis] + reach + 1.0 >= range.start as f32
        };
        meets(0, &columns) && meets(1, &rows)
    }

    /// The share of the lamp's light that the thing lets through to a point [–].
    #[inline]
    pub fn free(&self, point: &Point3<f64>) -> f32 {
        let Some([x, y, depth]) = self.place(point) else { return 1.0 };
        let [columns, rows] = self.hits.area();
        let reach = self.cone(depth, self.nearest).max(1.0);
        let is_aside =
            |at: f32, range: &std::ops::Range<usize>| at + reach < range.start as f32 || at - reach > range.end as f32;
        if is_aside(x, &columns) || is_aside(y, &rows) {
            return 1.0;
        }
        let limit = depth - BIAS_M;
        let (mut sum, mut n) = (0.0, 0);
        for place in &SEARCH {
            let [column, row] = [x + place[0] * reach, y + place[1] * reach];
            if let Some(found) = self.depth(column, row)
                && found < limit
            {
                sum += 1.0 / found;
                n += 1;
            }
        }
        // They lie as far aside as anything in the way can make a difference.
        if n == 0 || n == N_SEARCH {
            return f32::from(u8::from(n == 0));
        }
        let wide = self.cone(depth, n as f32 / sum).max(0.8);
        let free = TAPS.iter().map(|place| self.lets_through(x + place[0] * wide, y + place[1] * wide, limit));
        free.sum::<f32>() / N_TAPS as f32
    }

    #[inline]
    fn depth(&self, column: f32, row: f32) -> Option<f32> {
        if column < 0.0 || row < 0.0 {
            return None;
        }
        self.hits.depth((column + 0.5) as usize, (row + 0.5) as usize)
    }

    /// Between the four places around.
    #[inline]
    fn lets_through(&self, column: f32, row: f32, limit: f32) -> f32 {
        // Left of the map and above it nothing is; whole numbers are cut off without a call.
        if column < 0.0 || row < 0.0 {
            return 1.0;
        }
        let (left, top) = (column as usize, row as usize);
        let (right, down) = (column - left as f32, row - top as f32);
        let free = |dx: usize, dy: usize| {
            f32::from(u8::from(self.hits.depth(left + dx, top + dy).is_none_or(|it| it >= limit)))
        };
        let above = free(0, 0) * (1.0 - right) + free(1, 0) * right;
        let below = free(0, 1) * (1.0 - right) + free(1, 1) * right;
        above * (1.0 - down) + below * down
    }
}

/// Places spread evenly over a disc of radius 1, by the golden angle.
const SEARCH: [[f32; 2]; N_SEARCH] = [
    [0.224, 0.0],
    [-0.286, 0.262],
    [0.044, -0.498],
    [0.360, 0.469],
    [-0.661, -0.117],
    [0.626, -0.398],
    [-0.205, 0.780],
    [-0.403, -0.767],
    [0.869, 0.305],
    [-0.894, 0.387],
];
const TAPS: [[f32; 2]; N_TAPS] = [
    [0.177, 0.0],
    [-0.226, 0.207],
    [0.035, -0.394],
    [0.284, 0.371],
    [-0.522, -0.092],
    [0.495, -0.315],
    [-0.162, 0.617],
    [-0.3176, -0.6061],
    [0.687, 0.241],
    [-0.707, 0.306],
    [0.329, -0.740],
    [0.273, 0.803],
    [-0.772, -0.438],
    [0.876, -0.278],
    [-0.498, 0.812],
    [-0.175, -0.968],
];

#[cfg(test)]
mod tests {
    use super::*;

    /// A square of `half` metres each way, level at `height`, seen from above.
    fn square(half: f64, height: f64) -> (Vec<Point3<f64>>, Vec<Triangle>) {
        let vertices =
            [[-half, -half], [half, -half], [half, half], [-half, half]].map(|[x, y]| Point3::new(x, y, height));
        let triangle =
            |corners: [u32; 3]| Triangle { corners, texels: [[0.0; 2]; 3], material: crate::painted::Material::Skin };
        (vertices.to_vec(), vec![triangle([0, 1, 2]), triangle([0, 2, 3])])
    }

    fn lamp(change: fn(&mut LampSettings)) -> Lamp {
        let mut settings = LampSettings { position_m: [0.0, 0.0, 3.0], radius_m: 0.1, ..LampSettings::default() };
        change(&mut settings);
        Lamp::new(&settings, &mut Random::new(1))
    }

    #[test]
    fn shadow_lies_where_lines_from_the_lamp_say_and_its_edge_is_as_wide_as_the_lamp_makes_it() {
        let (vertices, triangles) = square(0.3, 1.0);
        let map = ShadowMap::new(&lamp(|_| ()), &vertices, &triangles);
        // On the floor the shadow of an edge at 0.3 m lies at 0.3 · 3 / 2 = 0.45 m; half its width is 0.1 · 1 / 2 = 0.05 m.
        let free = |x: f64| map.free(&Point3::new(x, 0.05, 0.0));
        assert!(free(0.2) == 0.0 && free(0.38) < 0.03, "{} {}", free(0.2), free(0.38));
        assert!(free(0.52) > 0.97 && free(0.8) == 1.0, "{} {}", free(0.52), free(0.8));
        let half = (300..600).map(|it| f64::from(it) * 1e-3).find(|it| free(*it) > 0.5).unwrap();
        assert!((half - 0.45).abs() < 0.01, "{half}");
        // The share of a disc beyond a line at half its radius: 0.196.
        assert!((free(0.425) - 0.196).abs() < 0.09, "{}", free(0.425));
        // Above it and beside it all is light.
        assert!(map.free(&Point3::new(0.0, 0.0, 1.2)) == 1.0 && map.free(&Point3::new(0.0, 0.0, 1.0)) == 1.0);
        let boxed = |x: f64| map.may_shade(&[Point3::new(x, -0.1, 0.0), Point3::new(x + 0.1, 0.1, 0.0)]);
        assert!(boxed(0.0) && boxed(0.45) && !boxed(0.7) && !boxed(-0.9));
    }

    #[test]
    fn light_falls_off_with_the_square_of_the_distance_and_the_cosine() {
        let lamp = lamp(|_| ());
        let up = Vector3::new(0.0, 0.0, 1.0);
        assert!((lamp.falls_on(&Point3::new(0.0, 0.0, 1.0), &up) - 1.0).abs() < 1e-6);
        assert!((lamp.falls_on(&Point3::new(0.0, 0.0, -1.0), &up) - 0.25).abs() < 1e-6);
        let aside = lamp.falls_on(&Point3::new(2.0, 0.0, 1.0), &up);
        assert!((aside - 0.5 * 0.5_f32.sqrt()).abs() < 1e-6, "{aside}");
        assert_eq!(lamp.falls_on(&Point3::new(0.0, 0.0, 4.0), &up), 0.0);
    }

    #[test]
    fn lamps_are_switched_fade_and_flicker() {
        let switched = lamp(|it| (it.from_s, it.until_s, it.fade_s) = (2.0, 5.0, 1.0));
        let levels = [1.9, 2.5, 4.0, 5.25, 6.5].map(|it| switched.level(it, 4e-3));
        assert_eq!(levels, [0.0, 0.5, 1.0, 0.75, 0.0]);
        let pulsing = lamp(|it| (it.flicker, it.flicker_hz) = (0.3, 100.0));
        let range = |exposure_s: f64| {
            let all = (0..100).map(|it| pulsing.level(f64::from(it) * 1e-4, exposure_s));
            all.fold([f64::INFINITY, 0.0], |[low, high], it| [f64::min(low, it), f64::max(high, it)])
        };
        let [low, high] = range(0.0);
        assert!((low - 0.7).abs() < 0.01 && (high - 1.3).abs() < 0.01, "{low} {high}");
        // Over a whole period nothing is left of it.
        let [low, high] = range(10e-3);
        assert!(high - low < 1e-9);
    }
}
