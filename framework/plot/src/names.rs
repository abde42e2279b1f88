//! Names beside points: placed where there is room, never over one another.

use crate::svg::{Anchor, Font, Point, Rect, SMALL, Svg};
use crate::text::{fitted, text_width};

/// The widest name [px].
const WIDEST: f64 = 170.0;

/// Occupied places of a panel.
#[derive(Debug)]
pub struct Names {
    bounds: Rect,
    taken: Vec<Rect>,
}

impl Names {
    /// No names yet, for names within `bounds`.
    pub fn within(bounds: Rect) -> Self {
        Self { bounds, taken: Vec::new() }
    }

    /// Keeps names off a point.
    pub fn keep_off(&mut self, [x, y]: Point) {
        self.taken.push(Rect { left: x - 4.0, top: y - 4.0, width: 8.0, height: 8.0 });
    }

    /// Keeps names off a line, except at its first point.
    pub fn keep_off_line(&mut self, from: Point, to: Point) {
        for part in [0.25, 0.5, 0.75, 1.0] {
            self.keep_off([0, 1].map(|it| from[it] + (to[it] - from[it]) * part));
        }
    }

    /// Writes `name` beside a point. Returns `false`, and writes nothing, where there is no room.
    pub fn write(&mut self, svg: &mut Svg, [x, y]: Point, name: &str) -> bool {
        let name = fitted(name, SMALL, WIDEST);
        let (width, height) = (text_width(&name, SMALL), SMALL);
        let places = [9.0, 16.0, 26.0, 40.0].into_iter().flat_map(|away| {
            let (right, left, centred) = (x + away, x - away - width, x - width / 2.0);
            let (above, beside, below) = (y - away, y + height * 0.35, y + away + height * 0.75);
            let (up, down) = (y - away * 0.7, y + away * 0.7 + height * 0.7);
            let straight = [(centred, above), (centred, below), (right, beside), (left, beside)];
            straight.into_iter().chain([(right, up), (left, up), (right, down), (left, down)])
        });
        let free = places
            .map(|(left, base)| Rect { left, top: base - height, width, height: height * 1.25 })
            .find(|it| self.bounds.holds(it) && self.taken.iter().all(|other| !it.overlaps(other)));
        if let Some(rect) = free {
            let at = [rect.left + width / 2.0, rect.top + height];
            svg.text(at, Anchor::Middle, Font::new(SMALL).with_halo(), &name);
            self.taken.push(rect);
        }
        free.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_lie_apart_and_within_and_are_left_out_where_there_is_no_room() {
        let bounds = Rect { left: 0.0, top: 0.0, width: 200.0, height: 200.0 };
        let mut names = Names::within(bounds);
        let mut svg = Svg::new(200.0, 200.0, "");
        let points: Vec<Point> = (0..60).map(|it| [f64::from(it * 37 % 200), f64::from(it * 91 % 200)]).collect();
        points.iter().for_each(|it| names.keep_off(*it));
        let n_points = names.taken.len();
        let n_written = points.iter().filter(|it| names.write(&mut svg, **it, "wide-12")).count();
        assert!((5..60).contains(&n_written), "{n_written}");
        for (index, name) in names.taken.iter().enumerate().skip(n_points) {
            assert!(bounds.holds(name) && names.taken[..index].iter().all(|it| !it.overlaps(name)));
        }
        assert!(!names.write(&mut svg, [f64::NAN, 3.0], "nowhere"));
    }
}
