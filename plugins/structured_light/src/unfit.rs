//! What a map is told that makes no cloud.

use foveate::prelude::ProjectorMap;

/// What a set with more pixels that do not fit than points is told: these points are accidents.
pub(crate) fn misfit(name: &str, [misfits, unmet]: [u64; 2], points: u64, change: Option<String>) -> String {
    let why = change.unwrap_or_else(|| {
            "did nothing move during the set, is the order of the pictures, is `centred`, are the calibrations of camera and projector those of this set?".to_owned()
        });
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

/// What a map is told many of whose depths would be too vague; `ratios` are their standard deviations over their distances, which come out sorted.
pub(crate) fn too_vague(map: &ProjectorMap, ratios: &mut [f32], points: u64) -> String {
    let (width, height) = (map.width as usize, map.height as usize);
    let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let is_known = |axis: usize| all.clone().any(|(x, y)| map.get(x, y).coordinate[axis].is_finite());
    ratios.sort_by(f32::total_cmp);
    let why = match [0, 1].map(is_known) {
        [true, false] if 2 * points < ratios.len() as u64 => {
            "columns alone tell no depth here, as where camera and projector stand above one another: show rows too"
                .to_owned()
        }
        [false, true] if 2 * points < ratios.len() as u64 => {
            "rows alone tell no depth here, as where camera and projector stand side by side: show columns too"
                .to_owned()
        }
        _ => {
            let most = ratios.get(ratios.len() * 9 / 10).copied().unwrap_or(f32::NAN);
            // To one digit, upwards.
            let digit = 10_f32.powf(most.log10().floor());
            format!(
                "coordinates are known too vaguely, or camera and projector stand too near each other for so far a surface; `max_sigma = {}` would keep nine tenths of them, each with its sigma",
                (most / digit).ceil() * digit
            )
        }
    };
    format!(
        "{}: depths of {} pixels would be vaguer than `max_sigma`, and are left out; {points} are known: {why}",
        map.name,
        ratios.len()
    )
}
