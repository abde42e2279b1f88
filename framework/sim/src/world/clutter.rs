//! What a camera may mistake for a LED: lamps and reflections, monitors, glints.

use foveate_estimation::random::Random;
use foveate_messages::CameraId;
use nalgebra::{Point3, Vector3};

use super::furniture::{DESK_HEIGHT_M, MONITOR_PLACES};
use crate::chance::stream;
use crate::lab::ROOM_M;

/// Panes of a monitor: three columns by two rows, each with a brightness of its own.
pub const PANES: usize = 6;
const PANE_COLUMNS: usize = 3;
const PANE_ROWS: usize = 2;

/// Extent of the frame relative to the panes.
const FRAME: f64 = 1.18;

/// More monitors than this there is no room for.
pub const MAX_MONITORS: usize = MONITOR_PLACES.len();

/// Vertical refresh of the monitors [Hz]; it beats with the cameras' rate.
const REFRESH_HZ: f64 = 72.0;
/// Timelines of events take numbers from here on; those of panes begin at 0.
const GLINTS: u64 = 1 << 32;

/// A small bright thing that stays where it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrightSpot {
    /// [m]
    pub position: Point3<f64>,
    /// Standard deviation of its brightness across the line of sight [m].
    pub sigma: f64,
    /// In its middle [gray level].
    pub peak: f64,
}

/// Spots on walls (lamps, chrome) and on the floor near them (reflections), none in or below the volume.
pub(super) fn bright_spots(count: usize, random: &mut Random) -> Vec<BrightSpot> {
    let [min, max] = ROOM_M;
    let spot = |_| {
        let along = |random: &mut Random, axis: usize| random.uniform_in(min[axis] + 0.2, max[axis] - 0.2);
        let height = random.uniform_in(0.2, 2.3);
        let position = match random.below(5) {
            0 => Point3::new(min[0] + 0.01, along(random, 1), height),
            1 => Point3::new(max[0] - 0.01, along(random, 1), height),
            2 => Point3::new(along(random, 0), min[1] + 0.01, height),
            3 => Point3::new(along(random, 0), max[1] - 0.01, height),
            _ => {
                let side = if random.below(2) == 0 { -1.0 } else { 1.0 };
                Point3::new(side * random.uniform_in(1.9, 2.2), along(random, 1), 0.01)
            }
        };
        BrightSpot { position, sigma: random.uniform_in(0.006, 0.03), peak: random.uniform_in(70.0, 320.0) }
    };
    (0..count).map(spot).collect()
}

/// A screen; all sides in metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Monitor {
    /// Middle of the screen.
    pub centre: Point3<f64>,
    /// From the middle to the middle of the right edge, seen from before it.
    pub half_right: Vector3<f64>,
    /// From the middle to the middle of the upper edge.
    pub half_up: Vector3<f64>,
}

impl Monitor {
    /// Where the screen points, of length 1.
    pub fn normal(&self) -> Vector3<f64> {
        self.half_right.cross(&self.half_up).normalize()
    }

    /// What a ray meets (a pane, or `None` for the dark frame around them), and how far along the ray that is [lengths of
    /// `direction`]. `None` when the ray misses or comes from behind.
    pub fn hit(&self, origin: &Point3<f64>, direction: &Vector3<f64>) -> Option<(Option<usize>, f64)> {
        self.hit_with(&self.normal(), origin, direction)
    }

    /// As [`Self::hit`] for who knows the [`Self::normal`].
    pub(crate) fn hit_with(
        &self,
        normal: &Vector3<f64>,
        origin: &Point3<f64>,
        direction: &Vector3<f64>,
    ) -> Option<(Option<usize>, f64)> {
        let towards = direction.dot(normal);
        if towards >= 0.0 {
            return None;
        }
        let depth = (self.centre - origin).dot(normal) / towards;
        let on_screen = origin + direction * depth - self.centre;
        let across = on_screen.dot(&self.half_right) / self.half_right.norm_squared();
        let up = on_screen.dot(&self.half_up) / self.half_up.norm_squared();
        let outermost = across.abs().max(up.abs());
        if depth <= 0.0 || outermost >= FRAME {
            return None;
        }
        let cell = |share: f64, n: usize| (((share + 1.0) / 2.0 * n as f64) as usize).min(n - 1);
        let pane = cell(up, PANE_ROWS) * PANE_COLUMNS + cell(across, PANE_COLUMNS);
        Some(((outermost < 1.0).then_some(pane), depth))
    }
}

/// Monitors on the desks, turned a little this way and that.
pub(super) fn monitors(count: usize, random: &mut Random) -> Vec<Monitor> {
    let monitor = |(position, facing): &([f64; 2], [f64; 2])| {
        let (sine, cosine) = random.uniform_in(-0.35, 0.35).sin_cos();
        let normal = Vector3::new(facing[0] * cosine - facing[1] * sine, facing[0] * sine + facing[1] * cosine, 0.0);
        let tilt = 0.15;
        let half_up = (Vector3::z() - normal * tilt).normalize() * 0.14;
        Monitor {
            centre: Point3::new(position[0], position[1], DESK_HEIGHT_M + 0.24),
            half_right: Vector3::z().cross(&normal).normalize() * 0.19,
            half_up,
        }
    };
    MONITOR_PLACES.iter().take(count).map(monitor).collect()
}

/// Windows that open and close: one change in each slot of `mean_s` seconds, at a random time within it; and the beam's
/// flicker of a quarter.
pub(super) fn pane_brightness(seed: u64, pane: usize, mean_s: f64, time_s: f64) -> f64 {
    let what = pane as u64;
    let slot = (time_s / mean_s).floor();
    let mut change = stream(seed, what, slot as i64);
    let changed = time_s - slot * mean_s >= change.uniform() * mean_s;
    if !changed {
        change = stream(seed, what, slot as i64 - 1);
        change.uniform();
    }
    // Mostly dark windows, some gray ones, some white ones.
    let level = match change.below(4) {
        0 | 1 => change.uniform_in(5.0, 60.0),
        2 => change.uniform_in(60.0, 180.0),
        _ => change.uniform_in(200.0, 330.0),
    };
    let beam = std::f64::consts::TAU * (REFRESH_HZ * time_s + pane as f64 / PANES as f64);
    level * (1.0 + 0.25 * beam.sin())
}

/// A short bright spot in one camera's image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Glint {
    /// Place in the image, from 0 to 1 along columns and rows.
    pub place: [f64; 2],
    /// In its middle [gray level].
    pub peak: f64,
    /// Width relative to a LED's spot.
    pub width: f64,
}

/// In each slot of 1/`rate_hz` seconds one glint begins, at a random time within it, for 15 to 120 ms.
pub(super) fn glints(seed: u64, camera: CameraId, rate_hz: f64, time_s: f64) -> impl Iterator<Item = Glint> {
    let slot = (time_s * rate_hz).floor() as i64;
    let reach = if rate_hz > 0.0 { (0.12 * rate_hz).ceil() as i64 } else { -1 };
    (slot - reach..=slot).filter_map(move |number| {
        let mut random = stream(seed, GLINTS + u64::from(camera.0), number);
        let start = (number as f64 + random.uniform()) / rate_hz;
        let lasts = random.uniform_in(0.015, 0.12);
        let glint = Glint {
            place: [random.uniform(), random.uniform()],
            peak: random.uniform_in(80.0, 400.0),
            width: random.uniform_in(0.7, 1.6),
        };
        (start..start + lasts).contains(&time_s).then_some(glint)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn glints_come_as_often_and_last_as_long_as_said() {
        for rate in [0.2, 1.0, 20.0] {
            let (seconds, step) = (400.0, 0.004);
            let n = (seconds / step) as usize;
            let lit: usize = (0..n).map(|i| glints(1, CameraId(3), rate, i as f64 * step).count()).sum();
            let expected = rate * 0.0675;
            let found = lit as f64 / n as f64;
            assert!((found / expected - 1.0).abs() < 0.25, "{found} of the time instead of {expected}, at {rate} Hz");
        }
        assert_eq!((0..100).map(|i| glints(1, CameraId(0), 0.0, f64::from(i)).count()).sum::<usize>(), 0);
    }

    #[test]
    fn glints_of_two_cameras_are_not_the_same() {
        let starts = |camera: u16| -> Vec<bool> {
            (0..2000).map(|i| glints(1, CameraId(camera), 1.0, f64::from(i) * 0.02).count() > 0).collect()
        };
        assert_ne!(starts(0), starts(1));
    }

    #[test]
    fn windows_change_at_the_mean_interval() {
        let level = |time: f64| {
            let flicker = 1.0 + 0.25 * (std::f64::consts::TAU * (REFRESH_HZ * time)).sin();
            pane_brightness(7, 0, 2.0, time) / flicker
        };
        let n = 20_000;
        let changes =
            (0..n).filter(|&i| (level(f64::from(i) * 0.05) - level(f64::from(i + 1) * 0.05)).abs() > 1e-6).count();
        assert!((400..=500).contains(&changes), "{changes} changes in 1000 s");
        let at_borders =
            (1..500).filter(|&i| (level(f64::from(i) * 2.0 - 1e-6) - level(f64::from(i) * 2.0)).abs() > 1e-6);
        assert!(at_borders.count() < 5, "windows change in step with the slots");
    }

    #[test]
    fn a_monitor_is_hit_from_before_it_only() {
        let monitor = monitors(1, &mut Random::new(1))[0];
        let before = monitor.centre + monitor.normal();
        let mut panes: Vec<usize> = Vec::new();
        for i in -10_i32..=10 {
            for j in -10_i32..=10 {
                let aim =
                    monitor.centre + monitor.half_right * (f64::from(i) / 9.5) + monitor.half_up * (f64::from(j) / 9.5);
                let hit = monitor.hit(&before, &(aim - before));
                assert!(hit.is_some(), "{i} {j}");
                let pane = hit.and_then(|(pane, _)| pane);
                assert_eq!(pane.is_some(), i.abs() < 10 && j.abs() < 10, "{i} {j}");
                panes.extend(pane);
                let behind = monitor.centre - monitor.normal();
                assert_eq!(monitor.hit(&behind, &(aim - behind)), None);
                assert_eq!(monitor.hit(&before, &(before - aim)), None);
            }
        }
        panes.sort_unstable();
        panes.dedup();
        assert_eq!(panes, [0, 1, 2, 3, 4, 5]);
    }
}
