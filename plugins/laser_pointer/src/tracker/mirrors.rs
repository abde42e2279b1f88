//! Bezels that mirror spots, learnt from the spots.
//!
//! The face of a bezel is a mirror: a camera before it sees a spot a second time, on the other side of a line of the wall, level or plumb with the spot and as far from the
//! line. The line belongs to the camera, since bezels stand out of the wall; spots on one side of it are mirrored to the other, never back. Two spots of which one
//! is much smaller vote for the line in the middle between them; where votes agree though the spots lie at different distances, at different times, there is a bezel. From then on
//! a spot is classified as a reflection by its place alone, regardless of brightness and size.

use foveate::prelude::*;
use nalgebra::Point2;

/// Spots that vote lie on one row or column to this [m]; reflections were level to 0.3 mm on the simulated wall, where maps are off by 0.1 mm.
const LEVEL_M: f64 = 1.5e-3;
/// Votes for one line agree to this [m]: over the height of a wall it wanders by a millimetre, as cameras are not square to it.
const LINE_M: f64 = 1.5e-3;
/// A spot is a reflection when it is this near to where one should be [m].
const PLACE_M: f64 = 3e-3;
/// A reflection that votes is this much smaller than its spot; on the simulated wall nine of ten are below 0.55 [–].
const SMALLER: f64 = 0.6;
/// Spots nearer to each other than this may be parts of one [m].
const APART_M: f64 = 6e-3;
/// What makes a line: votes, by how much distances differ [m], and from the first vote to the last [s]. Two people who pass each other on one row keep their middle, too, but not for long, and
/// not again.
const VOTES: u32 = 5;
const RANGE_M: f64 = 6e-3;
const SPAN_S: f64 = 0.5;
/// Most lines of one camera that are examined.
const MOST_LINES: usize = 64;

/// A spot on the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seen {
    /// On the wall [m].
    pub point: Point2<f64>,
    /// Area on the wall [m²].
    pub area: f64,
}

/// A line that one camera sees spots mirrored in.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Line {
    /// 0: the line is vertical and mirrors x; 1: it is horizontal and mirrors y.
    axis: usize,
    /// Its position on that axis [m].
    at: f64,
    /// Side of the reflections.
    is_after: bool,
    votes: u32,
    nearest: f64,
    farthest: f64,
    first: Time,
    last: Time,
}

impl Line {
    fn is_sure(&self) -> bool {
        self.votes >= VOTES && self.farthest - self.nearest >= RANGE_M && (self.last - self.first).as_s() >= SPAN_S
    }
}

/// The lines of all cameras.
#[derive(Debug, Clone, Default)]
pub(super) struct Mirrors {
    /// By camera.
    lines: Vec<Vec<Line>>,
}

impl Mirrors {
    /// For this many cameras, without any line.
    pub fn new(n_cameras: usize) -> Mirrors {
        Mirrors { lines: vec![Vec::new(); n_cameras] }
    }

    /// Certain lines, over all cameras.
    pub fn count(&self) -> usize {
        self.lines.iter().flatten().filter(|it| it.is_sure()).count()
    }

    /// Learns from the spots of one picture; spots farther apart than `reach` [m] are not of one bezel.
    pub fn learn(&mut self, camera: usize, time: Time, spots: &[Seen], reach: f64) {
        let lines = &mut self.lines[camera];
        for spot in spots {
            for other in spots.iter().filter(|it| it.area < SMALLER * spot.area) {
                let off = other.point - spot.point;
                let axis = if off.x.abs() > off.y.abs() { 0 } else { 1 };
                if off[1 - axis].abs() < LEVEL_M && (APART_M..reach).contains(&off[axis].abs()) {
                    let at = f64::midpoint(spot.point[axis], other.point[axis]);
                    vote(lines, axis, at, off[axis], time);
                }
            }
        }
    }

    /// Whether this camera sees at `spot` the reflection of the spot at `source`.
    pub fn mirrors(&self, camera: usize, spot: &Point2<f64>, source: &Point2<f64>) -> bool {
        self.lines[camera].iter().filter(|it| it.is_sure()).any(|it| {
            let off = spot[it.axis] - it.at;
            let expected = 2.0 * it.at - spot[it.axis];
            // On the line itself a spot is its own reflection.
            (off > 0.0) == it.is_after
                && off.abs() > APART_M / 2.0
                && (source[it.axis] - expected).abs() < PLACE_M
                && (source[1 - it.axis] - spot[1 - it.axis]).abs() < PLACE_M
        })
    }
}

fn vote(lines: &mut Vec<Line>, axis: usize, at: f64, off: f64, time: Time) {
    let (is_after, apart) = (off > 0.0, off.abs());
    let near = lines.iter_mut().filter(|it| it.axis == axis && it.is_after == is_after && (it.at - at).abs() < LINE_M);
    if let Some(line) = near.min_by(|a, b| (a.at - at).abs().total_cmp(&(b.at - at).abs())) {
        line.votes = line.votes.saturating_add(1);
        // The mean of all votes at first, of the last hundred later.
        line.at += (at - line.at) / f64::from(line.votes.min(100));
        (line.nearest, line.farthest) = (line.nearest.min(apart), line.farthest.max(apart));
        line.last = time;
        return;
    }
    if lines.len() >= MOST_LINES {
        let weakest = lines.iter().enumerate().filter(|it| !it.1.is_sure()).min_by_key(|it| it.1.last).map(|it| it.0);
        let Some(weakest) = weakest else { return };
        lines.swap_remove(weakest);
    }
    lines.push(Line { axis, at, is_after, votes: 1, nearest: apart, farthest: apart, first: time, last: time });
}

#[cfg(test)]
mod tests {
    use super::*;

    /// After a spot has come as near as 5 mm to the face of a bezel at x = 1 m, from the left, three times, one camera sees its reflection at this place.
    fn learnt(area: f64, again_s: f64) -> Mirrors {
        let mut mirrors = Mirrors::new(2);
        for visit in 0..3 {
            for step in 0..8 {
                let off = 5e-3 + 1e-3 * f64::from(step);
                let y = 0.3 + 0.01 * f64::from(step);
                let spot = Seen { point: Point2::new(1.0 - off, y), area: 1e-4 };
                let other = Seen { point: Point2::new(1.0 + off + 3e-4, y + 2e-4), area };
                let time = Time::from_s(f64::from(visit) * again_s + f64::from(step) / 60.0);
                mirrors.learn(1, time, &[spot, other], 0.15);
            }
        }
        mirrors
    }

    #[test]
    fn line_is_found_and_mirrors_one_way_for_the_camera_that_saw_it() {
        let mirrors = learnt(3e-5, 1.0);
        assert_eq!(mirrors.count(), 1);
        let (left, right) = (Point2::new(0.98, 0.7), Point2::new(1.0203, 0.7));
        assert!(mirrors.mirrors(1, &right, &left));
        assert!(!mirrors.mirrors(1, &left, &right), "the spot is no reflection of its reflection");
        assert!(!mirrors.mirrors(0, &right, &left), "another camera sees other lines");
        assert!(!mirrors.mirrors(1, &Point2::new(1.03, 0.7), &left), "not symmetric");
        assert!(!mirrors.mirrors(1, &Point2::new(1.0203, 0.71), &left), "not level");
        let on_line = Point2::new(1.001, 0.7);
        assert!(!mirrors.mirrors(1, &on_line, &on_line), "a spot on the line is by itself");
    }

    #[test]
    fn pointers_that_pass_each_other_once_and_spots_of_one_size_make_no_line() {
        assert_eq!(learnt(9e-5, 1.0).count(), 0);
        assert_eq!(learnt(3e-5, 0.0).count(), 0);
    }

    #[test]
    fn chance_votes_are_forgotten() {
        let mut mirrors = Mirrors::new(1);
        for number in 0..1000 {
            let x = 0.002 * f64::from(number);
            let spots = [
                Seen { point: Point2::new(x, 0.5), area: 1e-4 },
                Seen { point: Point2::new(x + 0.01, 0.5), area: 2e-5 },
            ];
            mirrors.learn(0, Time::from_s(f64::from(number)), &spots, 0.15);
        }
        assert!(mirrors.lines[0].len() <= MOST_LINES);
        assert_eq!(mirrors.count(), 0);
    }
}
