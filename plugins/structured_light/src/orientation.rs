//! Detects pictures that are mirrored or rotated, by points that fit only then; and swapped axes, by the directions of the stripes.

use foveate::geometry::Camera;
use foveate::prelude::*;
use nalgebra::{Point2, Vector2};

use crate::pair::triangulate;

/// Pixels that are looked at.
const SAMPLES: usize = 4000;
/// Of these at least so many must have both coordinates.
const MIN_SAMPLES: usize = 200;
/// Part of them that has to fit, and how many times as many as of the pictures as they are [–].
const FITTING: f64 = 0.7;
const CLEARLY: f64 = 1.5;

/// Pixels between two whose coordinates are compared, and depth at which they are expected to differ, over the distance of camera and projector [–].
const STRIDE: usize = 8;
const FAR: f64 = 6.0;
/// Cosine of the angle between the way a coordinate changes and the way that the other one should, at least, for them to be exchanged [–].
const OTHER_WAY: f64 = 0.8;
/// The same of the way that it should change itself, at most, for the picture to be mirrored [–].
const AGAINST: f64 = -0.5;

/// Why a map contradicts the calibration; `None` where they agree. The poses of camera and projector determine the
/// direction in which a coordinate grows over the camera's picture. The surface changes that direction little: only by
/// slopes along the epipolar lines, and never to the opposite. So the check finds columns that are rows (or the
/// reverse), and mirrored or turned pictures. Two exchanged coordinates contradict each other without this check.
pub(crate) fn wrong_way(camera: &Camera, projector: &Camera, map: &ProjectorMap) -> Option<String> {
    let [columns, rows] = [0, 1].map(|axis| changes(camera, projector, map, axis));
    if let Some((axis, one)) = match (&columns, &rows) {
        (Some(it), None) => Some((0, it)),
        (None, Some(it)) => Some((1, it)),
        _ => None,
    } {
        let like = one.expected.map(|it| it.dot(&one.seen).abs());
        if like[1 - axis] > OTHER_WAY && like[1 - axis] > 2.0 * like[axis] {
            let words = ["columns", "rows"];
            return Some(format!(
                "{}: the decoded {} of the projector change over the picture as its {} would, given the poses of camera and projector: write `{}` in place of `{}` in `pattern.order`, if that is what was shown",
                map.name,
                words[axis],
                words[1 - axis],
                words[1 - axis],
                words[axis]
            ));
        }
    }
    let is_against =
        |it: &Option<Changes>, axis: usize| it.as_ref().map(|it| it.expected[axis].dot(&it.seen) < AGAINST);
    let (what, how) = match [is_against(&columns, 0), is_against(&rows, 1)] {
        [Some(true), Some(true)] => ("columns and rows", "turned by 180 degrees"),
        [Some(true), None] => ("columns", "mirrored left to right or turned by 180 degrees"),
        [None, Some(true)] => ("rows", "mirrored top to bottom or turned by 180 degrees"),
        [Some(true), Some(false)] => ("columns", "mirrored left to right"),
        [Some(false), Some(true)] => ("rows", "mirrored top to bottom"),
        _ => return None,
    };
    let remedy = remedy(how);
    Some(format!(
        "{}: {what} of the projector run the wrong way over the picture, given the poses of camera and projector in the calibration: the camera's pictures or the projector's are {how}; {remedy}",
        map.name
    ))
}

/// What to do about pictures that are mirrored, turned, or one of both.
fn remedy(how: &str) -> &'static str {
    match [how.contains("mirrored"), how.contains("turned")] {
        [true, false] => {
            "mirror them back, since mirrored pictures fit no calibration (projectors have a setting for rear projection and mirrors)"
        }
        [true, true] => {
            "rotate or mirror them back; rotated pictures can be calibrated as they are, mirrored ones cannot"
        }
        _ => "rotate them back, or calibrate with pictures that are rotated alike",
    }
}

/// How one coordinate changes over the camera's picture.
struct Changes {
    /// To the right and down, in the middle of all pixels, as a direction.
    seen: Vector2<f64>,
    /// As columns and as rows would on a surface far away.
    expected: [Vector2<f64>; 2],
}

/// How coordinate `axis` changes; `None` where too few pixels have it.
fn changes(camera: &Camera, projector: &Camera, map: &ProjectorMap, axis: usize) -> Option<Changes> {
    let (width, height) = (map.width as usize, map.height as usize);
    let places = (0..height.saturating_sub(STRIDE))
        .step_by(STRIDE)
        .flat_map(|y| (0..width.saturating_sub(STRIDE)).step_by(STRIDE).map(move |x| (x, y)));
    let distance = FAR * (camera.centre() - projector.centre()).norm().max(0.1);
    let lit_from = |x: f64, y: f64| projector.project(&camera.ray(&Point2::new(x, y))?.at(distance));
    let mut seen: [Vec<f64>; 2] = Default::default();
    let mut expected = [Vector2::zeros(); 2];
    for (x, y) in places {
        let at = |x: usize, y: usize| f64::from(map.get(x, y).coordinate[axis]);
        let change = [at(x + STRIDE, y) - at(x, y), at(x, y + STRIDE) - at(x, y)];
        if !change.iter().all(|it| it.is_finite()) {
            continue;
        }
        let (x, y, step) = (x as f64, y as f64, STRIDE as f64);
        let Some([from, right, below]) = lit_from(x, y)
            .zip(lit_from(x + step, y))
            .zip(lit_from(x, y + step))
            .map(|((from, right), below)| [from, right, below])
        else {
            continue;
        };
        for it in 0..2 {
            seen[it].push(change[it]);
            expected[it] += Vector2::new(right[it] - from[it], below[it] - from[it]);
        }
    }
    if seen[0].len() < MIN_SAMPLES {
        return None;
    }
    let median = |list: &mut Vec<f64>| {
        let middle = list.len() / 2;
        *list.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    let [along, down] = seen.each_mut().map(median);
    let seen = Vector2::new(along, down).try_normalize(1e-9)?;
    Some(Changes { seen, expected: expected.map(|it| it.try_normalize(1e-9).unwrap_or_else(Vector2::zeros)) })
}

/// What may have been done to pictures, in words: whether the camera's are flipped along x and y, and those of the projector.
const CHANGES: [([bool; 2], [bool; 2], &str); 6] = [
    ([true, true], [false, false], "the camera's pictures were turned by 180 degrees"),
    ([true, false], [false, false], "the camera's pictures were mirrored left to right"),
    ([false, true], [false, false], "the camera's pictures were mirrored top to bottom"),
    ([false, false], [true, true], "the projector showed its pictures turned by 180 degrees, as set for a ceiling"),
    (
        [false, false],
        [true, false],
        "the projector showed its pictures mirrored left to right, as set for the back of a screen",
    ),
    ([false, false], [false, true], "the projector showed its pictures mirrored top to bottom"),
];

/// The same of the order of the stripes.
const EXCHANGED: &str = "columns and rows were swapped";

/// What would make most pixels of `map` fit, columns and rows of which do not belong to one point as they are; `None` where nothing does. Points fit
/// within `max_misfit` [projector px].
pub(crate) fn likely_change(
    camera: &Camera,
    projector: &Camera,
    map: &ProjectorMap,
    max_misfit: f64,
) -> Option<String> {
    let (width, height) = (map.width as usize, map.height as usize);
    let is_known = |it: &(usize, usize)| map.get(it.0, it.1).coordinate.iter().all(|it| it.is_finite());
    let known: Vec<(usize, usize)> =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(is_known).collect();
    if known.len() < MIN_SAMPLES {
        return None;
    }
    let some: Vec<(usize, usize)> = known.iter().copied().step_by(known.len().div_ceil(SAMPLES)).collect();
    let flipped = |is_flipped: bool, at: f64, side: u32| if is_flipped { f64::from(side) - 1.0 - at } else { at };
    let share = |of_camera: [bool; 2], of_projector: [bool; 2], is_exchanged: bool| {
        let fits = |&&(x, y): &&(usize, usize)| {
            let mut sample = map.get(x, y);
            if is_exchanged {
                sample.coordinate.reverse();
                sample.sigma.reverse();
            }
            sample.coordinate = [0, 1]
                .map(|it| flipped(of_projector[it], f64::from(sample.coordinate[it]), map.projector_size[it]) as f32);
            let pixel =
                Point2::new(flipped(of_camera[0], x as f64, map.width), flipped(of_camera[1], y as f64, map.height));
            triangulate(camera, projector, &pixel, &sample).is_some_and(|it| it.misfit <= max_misfit)
        };
        some.iter().filter(fits).count() as f64 / some.len() as f64
    };
    let as_it_is = share([false; 2], [false; 2], false);
    let mut found: Vec<(f64, &str)> = CHANGES.iter().map(|it| (share(it.0, it.1, false), it.2)).collect();
    found.push((share([false; 2], [false; 2], true), EXCHANGED));
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let best = found[0].0;
    if best < FITTING || best < CLEARLY * as_it_is {
        return None;
    }
    let words: Vec<&str> = found.iter().filter(|it| it.0 > 0.9 * best).map(|it| it.1).collect();
    let mend = if words == [EXCHANGED] {
        "swap `columns` and `rows` in `pattern.order` of the decoder"
    } else {
        remedy(&words.join(" "))
    };
    Some(format!("{:.0} % of them would if {}: {mend}", 100.0 * best, words.join(", or if ")))
}
