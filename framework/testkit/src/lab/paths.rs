//! Lights on paths: what moves in the lab, as a function of time.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use nalgebra::{Point3, Vector3};

/// A light at some moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Where [m].
    pub position: Point3<f64>,
    /// Where it shines to, of any length but 0; counts in a lab whose lights are directional.
    pub normal: Vector3<f64>,
}

impl Light {
    /// A light that shines upwards.
    pub fn at(position: Point3<f64>) -> Self {
        Self { position, normal: Vector3::z() }
    }
}

/// What shines in the lab. A function from seconds to an array of lights is one, too.
pub trait Lights {
    /// How many there are, always.
    fn count(&self) -> usize;
    /// Replaces the contents of `lights` with all of them at `time_s` [s].
    fn at(&self, time_s: f64, lights: &mut Vec<Light>);
}

impl<F, const N: usize> Lights for F
where
    F: Fn(f64) -> [Light; N],
{
    fn count(&self) -> usize {
        N
    }

    fn at(&self, time_s: f64, lights: &mut Vec<Light>) {
        lights.clear();
        lights.extend(self(time_s));
    }
}

/// A smooth path: a uniform cubic B-spline, whose acceleration is continuous and which stays within the hull of its
/// control points.
#[derive(Debug, Clone)]
pub struct Path {
    /// From one control point to the next [s].
    step_s: f64,
    control: Vec<Point3<f64>>,
}

impl Path {
    /// A walk through `volume` (opposite corners [m]) for `duration_s`, a new direction every `step_s`, at about
    /// `speed_m_s`.
    pub fn wander(duration_s: f64, volume: [[f64; 3]; 2], speed_m_s: f64, step_s: f64, random: &mut Random) -> Self {
        let [low, high] = volume;
        let mut place = std::array::from_fn::<_, 3, _>(|axis| random.uniform_in(low[axis], high[axis]));
        let mut control = Vec::new();
        for _ in 0..(duration_s / step_s).ceil() as usize + 4 {
            control.push(Point3::from(place));
            let away = Vector3::new(random.normal(), random.normal(), 0.5 * random.normal());
            let away = away.normalize() * speed_m_s * step_s * random.uniform_in(0.5, 1.5);
            for axis in 0..3 {
                // Off a wall and back into the room.
                let to = place[axis] + away[axis];
                let inside = if (low[axis]..=high[axis]).contains(&to) { to } else { place[axis] - away[axis] };
                place[axis] = inside.clamp(low[axis], high[axis]);
            }
        }
        Self { step_s, control }
    }

    /// The place at `time_s` [m]; before the start and after the end the path stands still.
    pub fn at(&self, time_s: f64) -> Point3<f64> {
        let last = self.control.len() - 4;
        let along = (time_s / self.step_s).clamp(0.0, last as f64 + 1.0);
        let first = (along as usize).min(last);
        let s = along - first as f64;
        let (s2, s3) = (s * s, s * s * s);
        let weights = [
            (1.0 - s).powi(3) / 6.0,
            (3.0 * s3 - 6.0 * s2 + 4.0) / 6.0,
            (-3.0 * s3 + 3.0 * s2 + 3.0 * s + 1.0) / 6.0,
            s3 / 6.0,
        ];
        let sum: Vector3<f64> = self.control[first..].iter().zip(weights).map(|(it, weight)| it.coords * weight).sum();
        sum.into()
    }
}

/// Lights that wander about, each on its own.
#[derive(Debug, Clone)]
pub struct Wanderers {
    paths: Vec<Path>,
}

impl Wanderers {
    /// `n` lights that walk through `volume` (opposite corners [m]) for `duration_s` at about `speed_m_s`; the same for the
    /// same `seed`.
    pub fn new(n: usize, duration_s: f64, volume: [[f64; 3]; 2], speed_m_s: f64, seed: u64) -> Self {
        let root = Random::new(seed).fork("wanderers");
        let path = |k: usize| Path::wander(duration_s, volume, speed_m_s, 0.5, &mut root.fork(&format!("light {k}")));
        Self { paths: (0..n).map(path).collect() }
    }
}

impl Lights for Wanderers {
    fn count(&self) -> usize {
        self.paths.len()
    }

    fn at(&self, time_s: f64, lights: &mut Vec<Light>) {
        lights.clear();
        lights.extend(self.paths.iter().map(|it| Light::at(it.at(time_s))));
    }
}

/// Pairs of lights that come close to each other again and again while both walk: every second pair crosses, the others
/// turn back.
#[derive(Debug, Clone)]
pub struct Crossings {
    pairs: Vec<Pair>,
}

#[derive(Debug, Clone)]
struct Pair {
    /// Of their middle.
    path: Path,
    /// Along which they meet, and across: where they are when they are nearest. Of length 1.
    along: Vector3<f64>,
    across: Vector3<f64>,
    /// Least distance [m].
    nearest: f64,
    period_s: f64,
    phase: f64,
    turns_back: bool,
}

/// Largest distance of a pair [m].
const APART_M: f64 = 0.8;

impl Crossings {
    /// `n_pairs` that walk through `volume` (opposite corners [m]) for `duration_s` and come as near as `nearest_m` (least,
    /// largest); the same for the same `seed`. A pair meets about every two seconds, at about 1 m/s where it crosses.
    pub fn new(n_pairs: usize, duration_s: f64, volume: [[f64; 3]; 2], nearest_m: [f64; 2], seed: u64) -> Self {
        let root = Random::new(seed).fork("crossings");
        let [low, high] = volume;
        let inner = [low.map(|it| it + APART_M / 2.0), high.map(|it| it - APART_M / 2.0)];
        let pairs = (0..n_pairs).map(|k| {
            let mut random = root.fork(&format!("pair {k}"));
            let mut direction = || Vector3::from_fn(|_, _| random.normal()).normalize();
            let along = direction();
            let across = along.cross(&direction()).normalize();
            Pair {
                along,
                across,
                nearest: random.uniform_in(nearest_m[0], nearest_m[1]),
                period_s: random.uniform_in(3.5, 5.0),
                phase: random.uniform(),
                turns_back: k % 2 == 1,
                path: Path::wander(duration_s, inner, 0.6, 0.8, &mut random),
            }
        });
        Self { pairs: pairs.collect() }
    }
}

impl Lights for Crossings {
    fn count(&self) -> usize {
        2 * self.pairs.len()
    }

    fn at(&self, time_s: f64, lights: &mut Vec<Light>) {
        lights.clear();
        for pair in &self.pairs {
            let turn = TAU * (time_s / pair.period_s + pair.phase);
            // The same rate of meetings for both kinds.
            let apart = if pair.turns_back { (1.0 - (2.0 * turn).cos()) / 2.0 } else { turn.sin() };
            let half = (pair.along * (APART_M * apart) + pair.across * pair.nearest) / 2.0;
            let middle = pair.path.at(time_s);
            lights.extend([middle + half, middle - half].map(Light::at));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VOLUME: [[f64; 3]; 2] = [[-1.5, -2.0, 0.5], [1.5, 2.0, 2.0]];

    fn lights(of: &impl Lights, time_s: f64) -> Vec<Point3<f64>> {
        let mut lights = Vec::new();
        of.at(time_s, &mut lights);
        lights.iter().map(|it| it.position).collect()
    }

    #[test]
    fn wanderers_stay_inside_and_move_smoothly() {
        let wanderers = Wanderers::new(8, 20.0, VOLUME, 1.2, 3);
        let (dt, mut speeds) = (0.005, Vec::new());
        for step in 1..3990 {
            let t = f64::from(step) * dt;
            let [before, now, after] = [t - dt, t, t + dt].map(|it| lights(&wanderers, it));
            for k in 0..8 {
                assert!((0..3).all(|axis| (VOLUME[0][axis]..=VOLUME[1][axis]).contains(&now[k][axis])), "{}", now[k]);
                speeds.push((after[k] - before[k]).norm() / (2.0 * dt));
                let acceleration = ((after[k] - now[k]) - (now[k] - before[k])) / (dt * dt);
                assert!(acceleration.norm() < 12.0, "{acceleration}");
            }
        }
        let mean = speeds.iter().sum::<f64>() / speeds.len() as f64;
        assert!((0.5..1.5).contains(&mean), "{mean}");
    }

    #[test]
    fn pairs_come_as_near_as_asked_and_go_apart_again() {
        let crossings = Crossings::new(6, 20.0, VOLUME, [0.03, 0.1], 5);
        assert_eq!(crossings.count(), 12);
        let moments: Vec<_> = (0..20_000).map(|it| lights(&crossings, f64::from(it) * 1e-3)).collect();
        for pair in 0..6 {
            let apart: Vec<f64> = moments.iter().map(|it| (it[2 * pair] - it[2 * pair + 1]).norm()).collect();
            let (least, most) = apart.iter().fold((f64::MAX, 0.0), |(a, b): (f64, f64), it| (a.min(*it), b.max(*it)));
            assert!((0.03..=0.1001).contains(&least) && most > 0.7, "pair {pair}: {least} {most}");
        }
    }

    #[test]
    fn seeds_differ_and_repeat() {
        let of = |seed| lights(&Wanderers::new(3, 5.0, VOLUME, 1.0, seed), 2.0);
        assert_eq!(of(1), of(1));
        assert_ne!(of(1), of(2));
    }
}
