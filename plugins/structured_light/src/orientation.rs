//! Pictures that are mirrored or turned, told from points that fit where they would not be; and stripes of one axis that are taken for those of the other, told from how they run.

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

/// Why columns alone cannot be columns, or rows rows: how a coordinate changes over the camera's picture follows from how camera and projector stand, and little from the surface, of which
/// only slopes along the epipolar lines turn it; `None` where it agrees, or both coordinates are there, which contradict each other by themselves.
pub(crate) fn other_axis(camera: &Camera, projector: &Camera, map: &ProjectorMap) -> Option<String> {
    let (width, height) = (map.width as usize, map.height as usize);
    let places: Vec<(usize, usize)> = (0..height.saturating_sub(STRIDE))
        .step_by(STRIDE)
        .flat_map(|y| (0..width.saturating_sub(STRIDE)).step_by(STRIDE).map(move |x| (x, y)))
        .collect();
    let is_known = |axis: usize| places.iter().any(|it| map.get(it.0, it.1).coordinate[axis].is_finite());
    let stated = match [0, 1].map(is_known) {
        [true, false] => 0,
        [false, true] => 1,
        _ => return None,
    };
    let distance = FAR * (camera.centre() - projector.centre()).norm().max(0.1);
    let lit_from = |x: f64, y: f64| projector.project(&camera.ray(&Point2::new(x, y))?.at(distance));
    let mut seen: [Vec<f64>; 2] = Default::default();
    let mut expected = [Vector2::zeros(); 2];
    for (x, y) in places {
        let at = |x: usize, y: usize| f64::from(map.get(x, y).coordinate[stated]);
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
        for axis in 0..2 {
            seen[axis].push(change[axis]);
            expected[axis] += Vector2::new(right[axis] - from[axis], below[axis] - from[axis]);
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
    let like = expected.map(|it| it.try_normalize(1e-9).map_or(0.0, |it| it.dot(&seen).abs()));
    let other = 1 - stated;
    (like[other] > OTHER_WAY && like[other] > 2.0 * like[stated]).then(|| {
        let words = ["columns", "rows"];
        format!(
            "{}: what is decoded as {} of the projector changes over the picture as its {} would, expected otherwise as camera and projector stand: does `pattern.order` name the right stripes?",
            map.name, words[stated], words[other]
        )
    })
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
const EXCHANGED: &str = "columns and rows were exchanged (`pattern.order`)";

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
    Some(format!("{:.0} % of them would if {}", 100.0 * best, words.join(", or if ")))
}
