//! The centre line of points along a limb, from one end to the other, along which candidate joints are moved.

use nalgebra::{Point3, Vector3};

/// Points whose distance along the limb differs by less make one place of the line [m].
const STEP_M: f64 = 0.02;
/// Fewer points make no place [–].
const LEAST_POINTS: usize = 3;
/// Of all points so many may be strays beyond an end [–].
const STRAYS: f64 = 0.02;

/// Places along a limb, about [`STEP_M`] apart.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct MiddleLine {
    places: Vec<Point3<f64>>,
}

impl MiddleLine {
    /// From the end that lies farthest from all; `None` of too few points.
    pub fn of(points: &[Point3<f64>]) -> Option<MiddleLine> {
        let nearest_last = |distances: &[f64]| {
            let mut order: Vec<usize> = (0..points.len()).collect();
            order.sort_by(|a, b| distances[*a].total_cmp(&distances[*b]));
            order.get(((1.0 - STRAYS) * points.len() as f64) as usize).copied()
        };
        let end = nearest_last(&along(points, 0)?)?;
        let distances = along(points, end)?;
        let last = distances[nearest_last(&distances)?];
        let n = (last / STEP_M).ceil() as usize;
        let mut cells = vec![(Vector3::zeros(), 0_usize); n + 1];
        for (point, distance) in points.iter().zip(&distances) {
            if let Some((sum, count)) = cells.get_mut((distance / STEP_M) as usize) {
                (*sum, *count) = (*sum + point.coords, *count + 1);
            }
        }
        let full = cells.iter().filter(|it| it.1 >= LEAST_POINTS);
        let places: Vec<Point3<f64>> = full.map(|(sum, count)| Point3::from(sum / *count as f64)).collect();
        (places.len() > 1).then_some(MiddleLine { places })
    }

    /// The same from its other end.
    pub fn reversed(&self) -> MiddleLine {
        MiddleLine { places: self.places.iter().rev().copied().collect() }
    }

    /// From end to end [m].
    pub fn length(&self) -> f64 {
        self.places.windows(2).map(|it| (it[1] - it[0]).norm()).sum()
    }

    /// The place at a distance along the line from its start [m]; before it and beyond its end it goes on straight.
    pub fn at(&self, distance: f64) -> Point3<f64> {
        let mut left = distance;
        let n = self.places.len();
        for (number, pair) in self.places.windows(2).enumerate() {
            let step = pair[1] - pair[0];
            if left <= step.norm() || number + 2 == n {
                return pair[0] + step.try_normalize(0.0).unwrap_or_else(Vector3::zeros) * left;
            }
            left -= step.norm();
        }
        self.places[0]
    }
}

/// How far each point is from the one at `start`, from point to point along the surface [m]: of all ways the one whose hops have the least sum of cubes, which keeps to the surface and takes no short cut. `None` where there is no such point.
fn along(points: &[Point3<f64>], start: usize) -> Option<Vec<f64>> {
    let n = points.len();
    let (mut cost, mut length, mut is_done) = (vec![f64::INFINITY; n], vec![0.0; n], vec![false; n]);
    *cost.get_mut(start)? = 0.0;
    for _ in 0..n {
        let here = (0..n).filter(|it| !is_done[*it]).min_by(|a, b| cost[*a].total_cmp(&cost[*b]))?;
        is_done[here] = true;
        for there in 0..n {
            let hop = (points[there] - points[here]).norm();
            if cost[here] + hop.powi(3) < cost[there] {
                (cost[there], length[there]) = (cost[here] + hop.powi(3), length[here] + hop);
            }
        }
    }
    Some(length)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points about a line that turns back on itself like an arm whose hand is at the shoulder, and strays beyond one end.
    #[test]
    fn a_line_follows_a_limb_round_its_bend_and_not_across() {
        // Out by 0.25 m, across by 0.14 m, and back.
        let on = |part: f64| match part {
            part if part < 0.25 => Point3::new(part, 0.0, 0.0),
            part if part < 0.39 => Point3::new(0.25, part - 0.25, 0.0),
            part => Point3::new(0.64 - part, 0.14, 0.0),
        };
        let mut points: Vec<Point3<f64>> = (0..640)
            .map(|it| {
                let (part, angle) = (f64::from(it) / 1000.0, f64::from(it) * 2.4);
                let around = Vector3::new(0.0, angle.cos(), angle.sin()) * 0.03;
                on(part) + if (0.25..0.39).contains(&part) { Vector3::new(around.y, 0.0, around.z) } else { around }
            })
            .collect();
        points.extend((0..6).map(|it| Point3::new(-1.0 - f64::from(it), 0.0, 0.0)));
        let line = MiddleLine::of(&points).unwrap();
        assert!((0.5..0.75).contains(&line.length()), "{}", line.length());
        let ends = [line.at(0.0), line.at(line.length())];
        let near = |at: &Point3<f64>, to: Point3<f64>| (at - to).norm() < 0.06;
        let is_along = |[a, b]: [Point3<f64>; 2]| near(&a, on(0.0)) && near(&b, on(0.64));
        assert!(is_along(ends) || is_along([ends[1], ends[0]]), "{ends:?}");
        let back = line.reversed();
        assert!((back.at(0.1) - line.at(line.length() - 0.1)).norm() < 1e-9);
        assert!((line.at(-0.05) - line.at(0.0)).norm() > 0.049, "straight on before its start");
    }
}
