//! Tracks the two ends of a wand through the pictures of one camera, by their small motion between pictures.

use nalgebra::{Point2, Vector2};

use crate::recording::{Recording, Spot};

/// A spot is that of an end when it is this much nearer to where the end must be than any other spot is [–].
const CLEARLY: f64 = 2.0;
/// And this much beside [px].
const BESIDE_PX: f64 = 2.0;

/// An end on its way.
#[derive(Clone, Copy)]
struct End {
    time_s: f64,
    pixel: Point2<f64>,
    velocity: Option<Vector2<f64>>,
}

impl End {
    fn at(&self, time_s: f64) -> Point2<f64> {
        self.pixel + self.velocity.unwrap_or_else(Vector2::zeros) * (time_s - self.time_s)
    }

    fn moved_on(&self, time_s: f64, pixel: Point2<f64>) -> End {
        End { time_s, pixel, velocity: Some((pixel - self.pixel) / (time_s - self.time_s)) }
    }
}

/// The recording with the two ends in each picture labelled 2n and 2n + 1 in the n-th stretch of its camera, through which they could be
/// followed; other spots are gone. A stretch begins with a picture of just two spots, and ends where an end is missing, where
/// the ends come so close that they cannot be distinguished, and in a gap. Pictures are in order.
pub(super) fn follow(recording: &Recording, max_gap_s: f64) -> Recording {
    let mut followed = recording.clone();
    for camera in 0..recording.cameras.len() {
        let (mut ends, mut stretch): (Option<[End; 2]>, u32) = (None, 0);
        for camera_frame in followed.camera_frames.iter_mut().filter(|it| it.camera == camera) {
            let time_s = camera_frame.time_s;
            let known = ends.filter(|it| time_s > it[0].time_s && time_s - it[0].time_s <= max_gap_s);
            let next = known.and_then(|it| continued(&it.map(|it| it.at(time_s)), &camera_frame.spots));
            let (spots, now) = match (known, next, &camera_frame.spots[..]) {
                (Some(known), Some(spots), _) => {
                    let now = [0, 1].map(|it| known[it].moved_on(time_s, spots[it].pixel));
                    (Some(spots), Some(now))
                }
                (_, None, [a, b]) => {
                    stretch += 1;
                    (Some([*a, *b]), Some([*a, *b].map(|it| End { time_s, pixel: it.pixel, velocity: None })))
                }
                _ => (None, None),
            };
            let label = |(end, it): (u32, Spot)| Spot { label: Some(2 * stretch + end), ..it };
            camera_frame.spots = spots.map_or_else(Vec::new, |it| (0..2).zip(it).map(label).collect());
            ends = now;
        }
    }
    followed
}

/// The spots that are the ends, where these must be at `expected`; `None` where that is not clear.
fn continued(expected: &[Point2<f64>; 2], spots: &[Spot]) -> Option<[Spot; 2]> {
    let nearest = |place: &Point2<f64>| {
        let off = |it: &Spot| (it.pixel - place).norm();
        let best = (0..spots.len()).min_by(|a, b| off(&spots[*a]).total_cmp(&off(&spots[*b])))?;
        let others = (0..spots.len()).filter(|it| *it != best);
        let next = others.map(|it| off(&spots[it])).fold(f64::INFINITY, f64::min);
        (CLEARLY * off(&spots[best]) + BESIDE_PX < next).then_some(best)
    };
    let [a, b] = [nearest(&expected[0])?, nearest(&expected[1])?];
    (a != b).then(|| [spots[a], spots[b]])
}
