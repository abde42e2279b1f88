//! Messages about maps that give no cloud.

use foveate::prelude::ProjectorMap;

/// Message for a set with more misfitting pixels than points: these points are accidental.
pub(crate) fn misfit(name: &str, [misfits, unmet]: [u64; 2], points: u64, change: Option<String>) -> String {
    let why = change.unwrap_or_else(|| {
            "did anything move during the set, and are the order of the pictures, `centred`, and the calibrations of camera and projector right?".to_owned()
        });
    let apart = match unmet {
        0 => String::new(),
        it => format!(" at {it} pixels the rays of camera and projector do not meet in front of both,"),
    };
    format!(
        "{name}:{apart} at {misfits} pixels column and row of the projector do not belong to one point, at {points} they do; expected most to: {why}"
    )
}

/// Message for a map with many uncertain depths; `ratios` are their standard deviations over their distances, which come out sorted.
pub(crate) fn too_vague(map: &ProjectorMap, ratios: &mut [f32], points: u64) -> String {
    let (width, height) = (map.width as usize, map.height as usize);
    let all = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let is_known = |axis: usize| all.clone().any(|(x, y)| map.get(x, y).coordinate[axis].is_finite());
    ratios.sort_by(f32::total_cmp);
    let why = match [0, 1].map(is_known) {
        [true, false] if 2 * points < ratios.len() as u64 => {
            "columns alone do not determine depth here, as with a camera above or below the projector: show rows too"
                .to_owned()
        }
        [false, true] if 2 * points < ratios.len() as u64 => {
            "rows alone do not determine depth here, as with a camera beside the projector: show columns too".to_owned()
        }
        _ => {
            let most = ratios.get(ratios.len() * 9 / 10).copied().unwrap_or(f32::NAN);
            format!(
                "coordinates are too uncertain, or camera and projector are too close together for such a distant surface; `max_sigma = {}` would keep nine tenths of them, each with its sigma",
                rounded_up(most)
            )
        }
    };
    format!(
        "{}: depths of {} pixels would be less certain than `max_sigma`, and are left out; {points} are known: {why}",
        map.name,
        ratios.len()
    )
}

/// A number below 1 to one digit, upwards, as it is to be written.
fn rounded_up(number: f32) -> f64 {
    let digits = 10_f64.powf(-f64::from(number).log10().floor());
    // Noise of the number's own width is no digit more. A quotient of whole numbers is written with the digits that it has.
    (f64::from(number) * digits * (1.0 - 1e-6)).ceil() / digits.round().max(1.0)
}

#[cfg(test)]
mod tests {
    use super::rounded_up;

    #[test]
    fn a_sigma_that_would_do_is_written_with_one_digit() {
        let written = [0.000_95, 0.000_999_999_9, 0.001, 0.002_4, 0.000_3, 0.37].map(|it| rounded_up(it).to_string());
        assert_eq!(written, ["0.001", "0.001", "0.001", "0.003", "0.0003", "0.4"]);
    }
}
