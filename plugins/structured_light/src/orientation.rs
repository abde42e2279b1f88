//! Pictures that are mirrored or turned, told from points that fit where they would not be.

use foveate::geometry::Camera;
use foveate::prelude::*;
use nalgebra::Point2;

use crate::pair::triangulate;

/// Pixels that are looked at.
const SAMPLES: usize = 4000;
/// Of these at least so many must have both coordinates.
const MIN_SAMPLES: usize = 200;
/// Part of them that has to fit, and how many times as many as of the pictures as they are [–].
const FITTING: f64 = 0.7;
const CLEARLY: f64 = 1.5;

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
    let share = |of_camera: [bool; 2], of_projector: [bool; 2]| {
        let fits = |&&(x, y): &&(usize, usize)| {
            let mut sample = map.get(x, y);
            sample.coordinate = [0, 1]
                .map(|it| flipped(of_projector[it], f64::from(sample.coordinate[it]), map.projector_size[it]) as f32);
            let pixel =
                Point2::new(flipped(of_camera[0], x as f64, map.width), flipped(of_camera[1], y as f64, map.height));
            triangulate(camera, projector, &pixel, &sample).is_some_and(|it| it.misfit <= max_misfit)
        };
        some.iter().filter(fits).count() as f64 / some.len() as f64
    };
    let as_it_is = share([false; 2], [false; 2]);
    let mut found: Vec<(f64, &str)> = CHANGES.iter().map(|it| (share(it.0, it.1), it.2)).collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let best = found[0].0;
    if best < FITTING || best < CLEARLY * as_it_is {
        return None;
    }
    let words: Vec<&str> = found.iter().filter(|it| it.0 > 0.9 * best).map(|it| it.1).collect();
    Some(format!("{:.0} % of them would if {}", 100.0 * best, words.join(", or if ")))
}
