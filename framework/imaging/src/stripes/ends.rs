//! The ends of the projector's picture. Where it is out of focus its light fades there, and with it the pattern's last stripes: phases and boundaries are drawn inwards, by pixels, without a trace in the pattern itself. How far the light fades
//! tells how far.

use super::code::Axis;
use super::edges::Coordinates;

/// Columns from an end over which light may fade, and as many behind them, which say what there is of it where it does not [projector px].
const FADES: usize = 24;
/// Light of an end that is out of focus by σ is at 0.5 at the end, and at this part of the full light one σ inside [–].
const ONE_SIGMA: f64 = 0.841;
/// So far inside an end nothing is drawn by more than a hundredth of a pixel [σ].
const CLEAR: f64 = 2.7;
/// An end is in focus where the outermost column has this part of the light [–].
const IN_FOCUS: f64 = 0.66;
/// Light that fades is at most so far off how it fades, in the mean [–].
const OFF: f64 = 0.08;
/// Or it fades to less than this part, within so few columns: those that are drawn inwards bring the light of what lies farther out with them [–, px].
const FAINT: f64 = 0.35;
const MOST_DRAWN: f64 = 7.0;
/// Pixels that see a column, at least, for it to say something.
const LEAST: f64 = 8.0;
/// And all columns behind together.
const LEAST_BEHIND: f64 = 300.0;

/// Leaves out coordinates too near an end of the projector's picture that is out of focus: how far its light fades there, of the softest end of each axis, as a standard deviation [projector px].
pub fn leave_out_soft_ends(found: &mut Coordinates, contrast: &[u8], projector: [u32; 2]) -> [f64; 2] {
    Axis::BOTH.map(|axis| {
        let (values, sigmas) = (&mut found.values[axis.index()], &mut found.sigmas[axis.index()]);
        let size = f64::from(projector[axis.index()]);
        if values.len() != contrast.len() || size < 8.0 * FADES as f64 {
            return 0.0;
        }
        let soft = [false, true].map(|is_last| {
            let from_end = |it: &f32| if is_last { size - 0.5 - f64::from(*it) } else { f64::from(*it) + 0.5 };
            sigma_of(values.iter().map(from_end).zip(contrast.iter().copied()))
        });
        for (value, sigma) in values.iter_mut().zip(sigmas).filter(|it| it.0.is_finite()) {
            let place = f64::from(*value) + 0.5;
            if place < CLEAR * soft[0] || size - place < CLEAR * soft[1] {
                (*value, *sigma) = (f32::NAN, f32::NAN);
            }
        }
        soft[0].max(soft[1])
    })
}

/// How far light fades at an end, by pixels' distance from it and contrast; 0 where it does not, or nothing tells it [px].
fn sigma_of(pixels: impl Iterator<Item = (f64, u8)>) -> f64 {
    let mut columns = [[0.0; 2]; 2 * FADES];
    for (away, contrast) in pixels.filter(|it| (0.0..(2 * FADES) as f64).contains(&it.0)) {
        let column = &mut columns[away as usize];
        *column = [column[0] + f64::from(contrast), column[1] + 1.0];
    }
    let sum = |list: &[[f64; 2]]| list.iter().fold([0.0; 2], |sum, it| [sum[0] + it[0], sum[1] + it[1]]);
    let [light, n] = sum(&columns[FADES..]);
    if n < LEAST_BEHIND {
        return 0.0;
    }
    let full = light / n;
    let part = |column: &[f64; 2]| (column[1] >= LEAST).then(|| column[0] / column[1] / full);
    let seen = || columns[..FADES].iter().enumerate().filter_map(|(at, it)| Some((at, part(it)?)));
    if seen().next().is_none_or(|it| it.0 > 2 || it.1 >= IN_FOCUS) {
        return 0.0;
    }
    // Between the last column that is darker and the one behind it.
    let Some(at) = seen().position(|it| it.1 >= ONE_SIGMA) else { return 0.0 };
    let (column, beyond) = seen().nth(at).unwrap_or_default();
    let place = column as f64 + 0.5;
    let sigma = match at.checked_sub(1).and_then(|it| seen().nth(it)) {
        Some((near, less)) => {
            let near = near as f64 + 0.5;
            near + (place - near) * (ONE_SIGMA - less) / (beyond - less)
        }
        None => place,
    };
    // The end of a dark surface does not fade so.
    let off = |(at, part): (usize, f64)| (part - normal((at as f64 + 0.5) / sigma)).abs();
    let fading: Vec<f64> = seen().take_while(|it| it.0 as f64 <= 2.0 * sigma).map(off).collect();
    let is_drawn = sigma <= MOST_DRAWN && seen().next().is_some_and(|it| it.1 < FAINT);
    if is_drawn || fading.iter().sum::<f64>() <= OFF * fading.len() as f64 { sigma } else { 0.0 }
}

/// The normal distribution, to 0.01.
fn normal(x: f64) -> f64 {
    1.0 / (1.0 + (-1.702 * x).exp())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Columns of a projector of 800 as a camera of the same pixels sees them, 40 rows, fading by `sigma` at the first end; textured.
    fn seen(sigma: f64, texture: f64) -> (Coordinates, Vec<u8>) {
        let places: Vec<f32> = (0..40 * 800).map(|it| (it % 800) as f32).collect();
        let light = |at: usize| {
            let away = (at % 800) as f64 + 0.5;
            let fades = match sigma {
                0.0 => 1.0,
                // A dark surface.
                sigma if sigma < 0.0 => {
                    if away < -sigma {
                        0.4
                    } else {
                        1.0
                    }
                }
                sigma => normal(away / sigma),
            };
            (120.0 * fades * (1.0 + texture * (0.9 * (at / 800) as f64 + 0.13 * away).sin())).round() as u8
        };
        let contrast = (0..places.len()).map(light).collect();
        let sigmas = [vec![0.1; places.len()], Vec::new()];
        (Coordinates { size: [800, 40], values: [places, Vec::new()], sigmas, blur: 0.5 }, contrast)
    }

    #[test]
    fn places_that_are_drawn_inwards_are_left_out() {
        // As phases of an end that is out of focus by 2.4 px are: what lies at the end or outside is seen 1.9 px and less inside.
        let (mut found, mut contrast) = seen(0.0, 0.2);
        for (at, (value, level)) in found.values[0].iter_mut().zip(&mut contrast).enumerate() {
            let x = (at % 800) as f64 - 4.5;
            let drawn = x.max(0.0) + 1.9 * (-0.5 * (x / 2.4).powi(2)).exp();
            *level = (f64::from(*level) * normal(x / 2.4)).round() as u8;
            *value = if x < 12.0 { (drawn - 0.5) as f32 } else { (x - 0.5) as f32 };
        }
        let [soft, _] = leave_out_soft_ends(&mut found, &contrast, [795, 600]);
        assert!((2.0..5.0).contains(&soft), "{soft}");
        let nearest = found.values[0].iter().copied().filter(|it| it.is_finite()).fold(f32::INFINITY, f32::min);
        assert!((6.0..13.0).contains(&nearest), "{nearest}");
    }

    #[test]
    fn soft_ends_are_left_out_as_far_as_they_are_soft_and_sharp_ones_stay() {
        for texture in [0.0, 0.3] {
            for sigma in [-3.0, -9.0, -15.0, 0.0, 0.2, 1.0, 2.4, 5.0] {
                let (mut found, contrast) = seen(sigma, texture);
                let [soft, other] = leave_out_soft_ends(&mut found, &contrast, [800, 600]);
                let row: Vec<bool> = found.values[0][..800].iter().map(|it| it.is_nan()).collect();
                let out = row.iter().take_while(|it| **it).count() as f64;
                assert_eq!(other, 0.0);
                assert!(row[out as usize..].iter().all(|it| !it), "{sigma}");
                if sigma < 2.0 {
                    assert_eq!((soft, out), (0.0, 0.0), "{sigma}, {texture}");
                } else {
                    assert!((soft - sigma).abs() < 0.25 * sigma, "{soft} for {sigma}, {texture}");
                    assert!(out >= 2.0 * sigma && out <= 3.6 * sigma, "{out} for {sigma}");
                }
            }
        }
    }
}
