//! What a map is told that makes no cloud.

use foveate::prelude::ProjectorMap;

/// What a set with more pixels that do not fit than points is told: these points are accidents.
pub(crate) fn misfit(name: &str, [misfits, unmet]: [u64; 2], points: u64, change: Option<String>) -> String {
    let why = change.map_or_else(
        || {
            "did nothing move during the set, is the order of the pictures, is `centred`, are the calibrations of camera and projector those of this set?".to_owned()
        },
        |it| format!("{it}: turn them back, or calibrate with pictures as these are"),
    );
    let apart = match unmet {
        0 => String::new(),
        it => format!(
            " at {it} pixels the camera's ray and what the projector lights from there do not meet before both,"
        ),
    };
    format!(
        "{name}:{apart} at {misfits} pixels column and row of the projector do not belong to one point, at {points} they do; expected most to: {why}"
    )
}

/// What a map is told whose depths would nearly all be too vague.
pub(crate) fn too_vague(map: &ProjectorMap, vague: u64, points: u64) -> String {
    let (width, height) = (map.width as usize, map.height as usize);
    let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let is_known = |axis: usize| all.clone().any(|(x, y)| map.get(x, y).coordinate[axis].is_finite());
    let why = match [0, 1].map(is_known) {
        [true, false] => {
            "columns alone tell no depth here, as where camera and projector stand above one another: show rows too"
        }
        [false, true] => {
            "rows alone tell no depth here, as where camera and projector stand side by side: show columns too"
        }
        _ => {
            "camera and projector stand too near each other for so far a surface, or coordinates are known too vaguely"
        }
    };
    format!(
        "{}: depths of {vague} pixels would be vaguer than `max_sigma`, of {points} they are known: {why}",
        map.name
    )
}
