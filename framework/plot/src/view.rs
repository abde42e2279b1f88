//! Parallel projection of space, rotated about the vertical and tilted.

use crate::svg::Point;

/// A view of space in parallel projection, z upwards.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    turn: f64,
    tilt: f64,
    middle: [f64; 3],
    scale: f64,
    centre: Point,
}

impl View {
    /// A view from `turn` about the vertical and `tilt` above the horizon [rad], scaled so that all of `places` lie
    /// within `size` [px] around `middle`.
    pub fn of(
        places: impl Iterator<Item = [f64; 3]>,
        middle: [f64; 3],
        [turn, tilt]: [f64; 2],
        size: [f64; 2],
    ) -> Self {
        let mut view = Self { turn, tilt, middle, scale: 1.0, centre: [0.0; 2] };
        let reach = places.map(|it| view.place(it)).filter(|it| it.iter().all(|it| it.is_finite()));
        let [across, up] = reach.fold([1e-9_f64; 2], |far, it| [0, 1].map(|axis| far[axis].max(it[axis].abs())));
        view.scale = (0.46 * size[0] / across).min(0.46 * size[1] / up);
        view.centre = size.map(|it| 0.5 * it);
        view
    }

    /// Position of a place in the figure [px].
    pub fn place(&self, place: [f64; 3]) -> Point {
        let [x, y, z] = [0, 1, 2].map(|axis| place[axis] - self.middle[axis]);
        let across = x * self.turn.cos() - y * self.turn.sin();
        let away = x * self.turn.sin() + y * self.turn.cos();
        let up = away * self.tilt.sin() + z * self.tilt.cos();
        [self.centre[0] + self.scale * across, self.centre[1] - self.scale * up]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_places_lie_within_the_size_up_is_up_and_far_is_high() {
        let corners = || (0..8).map(|it| [0, 1, 2].map(|axis| if it >> axis & 1 == 1 { 3.0 } else { -1.0 }));
        let view = View::of(corners(), [1.0; 3], [0.6, 0.45], [400.0, 200.0]);
        assert!(
            corners().map(|it| view.place(it)).all(|[x, y]| (0.0..400.0).contains(&x) && (0.0..200.0).contains(&y))
        );
        let [low, high] = [0.0, 2.0].map(|z| view.place([1.0, 1.0, z]));
        assert!(high[1] < low[1] && (high[0] - low[0]).abs() < 1e-9);
        assert!(view.place([1.0, 2.0, 0.0])[1] < low[1], "what is further off lies higher");
        let point = View::of([[5.0; 3]].into_iter(), [5.0; 3], [0.6, 0.45], [400.0, 200.0]);
        assert_eq!(point.place([5.0; 3]), [200.0, 100.0]);
    }
}
