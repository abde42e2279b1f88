//! One light on a stick, as somebody waves it to calibrate a room: three stops on the floor, then all about the volume.

use nalgebra::Point3;

/// Where it is held still at first [m]: the origin, on the X axis, on the Y axis.
const STOPS: [[f64; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
/// How long at each [s].
const STOP_S: f64 = 1.5;
/// How long from one place to the next [s].
const BETWEEN_S: f64 = 1.0;
/// The wave's extent along each axis, of the area and of the heights, that it uses [–].
const EXTENT: f64 = 0.9;
/// Lowest and highest place [m].
const HEIGHTS_M: [f64; 2] = [0.2, 2.1];
/// Turns a second along x, y, z [Hz]; they repeat after minutes only.
const RATES_HZ: [f64; 3] = [0.23, 0.31, 0.53];

/// Where it is, `time_s` after it was taken up, in an area of these extents around the origin [m].
pub(super) fn position(time_s: f64, area_m: [f64; 2]) -> Point3<f64> {
    let period = STOP_S + BETWEEN_S;
    let index = (time_s / period).floor().clamp(0.0, STOPS.len() as f64) as usize;
    let begin = index as f64 * period;
    let Some(stop) = STOPS.get(index).map(|it| Point3::from(*it)) else { return wave(time_s - begin, area_m) };
    let next = STOPS.get(index + 1).map_or_else(|| wave(0.0, area_m), |it| Point3::from(*it));
    let part = ((time_s - begin - STOP_S) / BETWEEN_S).clamp(0.0, 1.0);
    stop + (next - stop) * (part * part * (3.0 - 2.0 * part))
}

fn wave(time_s: f64, area_m: [f64; 2]) -> Point3<f64> {
    let turn = |axis: usize| (std::f64::consts::TAU * RATES_HZ[axis] * time_s).sin();
    let [low, high] = HEIGHTS_M;
    Point3::new(
        EXTENT * area_m[0] / 2.0 * turn(0),
        EXTENT * area_m[1] / 2.0 * turn(1),
        (low + high) / 2.0 + (high - low) / 2.0 * turn(2),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    const AREA_M: [f64; 2] = [2.5, 4.0];

    #[test]
    fn light_stands_on_the_floor_three_times_and_then_goes_everywhere() {
        for (index, stop) in STOPS.iter().enumerate() {
            let begin = 2.5 * index as f64;
            for time_s in [begin, begin + 0.7, begin + 1.499] {
                assert_eq!(position(time_s, AREA_M), Point3::from(*stop));
            }
        }
        let waved: Vec<Point3<f64>> = (0..4000).map(|it| position(7.5 + 0.01 * f64::from(it), AREA_M)).collect();
        for (axis, extent) in [2.25, 3.6, 1.9].into_iter().enumerate() {
            let of = |start: f64, better: fn(f64, f64) -> f64| waved.iter().map(|it| it[axis]).fold(start, better);
            assert!((of(f64::NEG_INFINITY, f64::max) - of(f64::INFINITY, f64::min) - extent).abs() < 0.02);
        }
    }

    #[test]
    fn it_never_jumps() {
        let mut last = position(0.0, AREA_M);
        for it in 1..20_000 {
            let here = position(f64::from(it) * 1e-3, AREA_M);
            assert!((here - last).norm() < 6e-3, "{} s", f64::from(it) * 1e-3);
            last = here;
        }
    }
}
