//! A camera that is out of focus: how much, and what it does to boundaries and phases.
//!
//! What a blurred pixel sees of a boundary or a wave is a mean over its neighbourhood, in which bright places count for more. Where the surface's own light grows by a part of g from
//! pixel to pixel, and the camera blurs by σ, all places are drawn by g σ² towards the bright side: ∫ (1 + g x) s(x − d) G(x) dx is that of a surface of one colour at d − g σ², for a wave s as
//! for a step. A projector that is out of focus blurs the stripes alone, and draws nothing. So σ is that of the sharpest edges of the surface's colours.
//!
//! Two surfaces beside one another go over into each other in a picture that is out of focus, through places where there is nothing.

/// How far out of focus a camera is.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Defocus {
    /// Standard deviation of its blur, no more than a pixel's own where edges of colours do not tell it [px].
    pub sigma: f64,
    /// Of its gray levels, standard deviation [gray levels].
    noise: f64,
}

/// Nothing is done about a camera that blurs no more than its pixels do, standard deviation [px].
const PIXEL: f64 = 0.5;
/// An edge is looked at within so many pixels.
const WINDOW: usize = 14;
/// Lines whose mean is looked at, against noise.
const LINES: usize = 5;
/// The steepest step of an edge is so many standard deviations of a pixel's noise high, the whole edge so many.
const STEP: f64 = 2.0;
const EDGE: f64 = 20.0;
/// Its sides begin so many standard deviations from it, are at least so many pixels wide, and differ in themselves by this part of its height at most.
const BESIDE: f64 = 2.0;
const FLAT: usize = 5;
const EVEN: f64 = 0.1;
/// The darker side of an edge has at least this [gray levels].
const LIT: f64 = 12.0;
/// So many edges tell a blur …
const MIN_EDGES: usize = 30;
/// … which is that of which this part of them is sharper: others are no single edges.
const SHARPEST: f64 = 0.3;
/// Stripes cannot be sharper than the camera; where they are by more than this factor, it is not the camera that blurs [–].
const SHARPER: f64 = 0.8;
/// Height over steepest step of an edge of blur 1: √(2 π).
const OF_AN_EDGE: f64 = 2.506_628_274_631;
/// Colours are looked at within so many standard deviations of the blur.
const REACH: f64 = 2.0;
const MAX_REACH: usize = 12;
/// How wrong it may be what places are drawn by, standard deviation [–].
const DOUBT: f64 = 0.3;
/// Where light ends, what is seen beyond the end is light from this side of it: places are drawn by more than so many standard deviations of the blur …
const MOST: f64 = 0.4;
/// … and near it, if the blur is above [`BLURRED`], light is less than this part of a pixel's own.
const NO_LIGHT: f64 = 0.25;
/// Surfaces go over into each other where a coordinate bends by more than this within two standard deviations of a blur that is above [`BLURRED`], beyond
/// so many standard deviations [projector px, px, –].
const BENDS: f64 = 1.0;
const BLURRED: f64 = 1.0;
const SIGMAS: f64 = 3.0;

impl Defocus {
    /// Looks at the light of a projector on a scene, white − black, of `size` columns and rows, whose noise has a standard deviation of `noise` gray levels, and at how
    /// `blurred` the boundaries of its stripes are, by camera and projector together, standard deviations [px].
    pub fn of(contrast: &[u8], size: [usize; 2], noise: f64, mut blurred: Vec<f64>) -> Defocus {
        let [width, height] = size;
        let mut widths = Vec::new();
        let mut profile = Vec::new();
        for (length, n_lines, along, across) in [(width, height, 1, width), (height, width, width, 1)] {
            for first in (0..(n_lines + 1).saturating_sub(LINES)).step_by(LINES) {
                let sum = |it: usize| -> f64 {
                    (first..first + LINES).map(|line| f64::from(contrast[it * along + line * across])).sum()
                };
                profile.clear();
                profile.extend((0..length).map(|it| sum(it) / LINES as f64));
                edges(&profile, noise, &mut widths);
            }
        }
        widths.sort_by(f64::total_cmp);
        blurred.sort_by(f64::total_cmp);
        let [colours, stripes] = [&widths, &blurred].map(|it| it.get((SHARPEST * it.len() as f64) as usize));
        let sigma = match (colours, stripes) {
            (Some(colours), Some(stripes)) if widths.len().min(blurred.len()) >= MIN_EDGES => {
                // Where stripes are sharper than what was taken for edges, these are no edges.
                if *stripes < SHARPER * colours { PIXEL } else { *colours }
            }
            _ => PIXEL,
        };
        Defocus { sigma: sigma.max(PIXEL), noise }
    }

    /// How far towards the bright side pixel `at` sees along a line, of which it has `place`: (length, distance from one pixel to the next in `contrast`), where something there is blurred by
    /// `blurred` in all, camera and projector together [px].
    pub(super) fn drawn(
        &self,
        contrast: &[u8],
        at: usize,
        place: usize,
        (length, by): (usize, usize),
        blurred: f64,
    ) -> f64 {
        let sigma = self.sigma.min(blurred);
        if sigma <= PIXEL {
            return 0.0;
        }
        let light = |it: usize| f64::from(contrast[at + it * by - place * by].max(1)).ln();
        let around = |reach: usize| place.saturating_sub(reach)..(place + reach + 1).min(length);
        let near = around(((REACH * sigma).round() as usize).clamp(1, MAX_REACH));
        let (mut low, mut high, mut steepest) = (f64::MAX, f64::MIN, 0.0_f64);
        let mut last = f64::NAN;
        for it in near {
            let light = light(it);
            (low, high, steepest) = (low.min(light), high.max(light), steepest.max((light - last).abs()));
            last = light;
        }
        // An edge of the colour that is sharper here than elsewhere says so itself.
        let by_noise = 2.0 * self.noise / high.exp();
        let here = (high - low) / (OF_AN_EDGE * (steepest - 2.0 * by_noise).max(1e-6));
        let ends = around((sigma.round() as usize).max(1));
        let slope = (light(ends.end - 1) - light(ends.start)) / (ends.len() - 1).max(1) as f64;
        slope * (sigma.min(here).powi(2) - PIXEL * PIXEL).max(0.0)
    }

    /// What is left to do with coordinates that boundaries or phases gave: phases, which are `as_seen`, are drawn back to where they belong; all are believed less where there was much to draw, and
    /// left out where one surface goes over into another.
    pub(super) fn settle(
        &self,
        values: &mut [f32],
        sigmas: &mut [f32],
        contrast: &[u8],
        size: [usize; 2],
        as_seen: bool,
    ) {
        if self.sigma <= PIXEL {
            return;
        }
        let [width, height] = size;
        let (seen, scatter) = (values.to_vec(), sigmas.to_vec());
        let reach = (REACH * self.sigma).ceil() as usize;
        for at in (0..values.len()).filter(|it| seen[*it].is_finite()) {
            let mut off = 0.0;
            let mut is_out = false;
            for (place, length, by) in [(at % width, width, 1), (at / width, height, width)] {
                let drawn = self.drawn(contrast, at, place, (length, by), f64::INFINITY);
                is_out |= drawn.abs() > MOST * self.sigma;
                if place > 0 && place + 1 < length {
                    let slope = f64::from(seen[at + by] - seen[at - by]) / 2.0;
                    off += if slope.is_finite() { slope * drawn } else { 0.0 };
                }
                if self.sigma <= BLURRED {
                    continue;
                }
                let before = (place >= reach).then(|| at - reach * by);
                let after = (place + reach < length).then(|| at + reach * by);
                let least = NO_LIGHT * f64::from(contrast[at]);
                is_out |= [before, after].into_iter().flatten().any(|it| f64::from(contrast[it]) < least);
                if let (Some(before), Some(after)) = (before, after) {
                    let [a, b, c] = [before, at, after].map(|it| [f64::from(seen[it]), f64::from(scatter[it])]);
                    let most = BENDS + SIGMAS * a[1].hypot(2.0 * b[1]).hypot(c[1]);
                    is_out |= (a[0] - 2.0 * b[0] + c[0]).abs() > most;
                }
            }
            if as_seen {
                values[at] -= off as f32;
            }
            sigmas[at] = f64::from(scatter[at]).hypot(DOUBT * off) as f32;
            if is_out {
                (values[at], sigmas[at]) = (f32::NAN, f32::NAN);
            }
        }
    }
}

/// How wide edges of a profile are, standard deviations.
fn edges(profile: &[f64], noise: f64, widths: &mut Vec<f64>) {
    let step = |it: usize| (profile[it + 1] - profile[it]).abs();
    for at in WINDOW..profile.len().saturating_sub(WINDOW + 1) {
        let here = step(at);
        if here < STEP * noise || (at - WINDOW..at + WINDOW).any(|it| step(it) > here) {
            continue;
        }
        let around = &profile[at + 1 - WINDOW..=at + WINDOW];
        let [low, high] = around.iter().fold([f64::MAX, f64::MIN], |it, value| [it[0].min(*value), it[1].max(*value)]);
        let (height, sigma) = (high - low, (high - low) / (OF_AN_EDGE * here));
        let ramp = (BESIDE * sigma).ceil() as usize;
        if low < LIT || height < EDGE * noise || ramp + FLAT > WINDOW {
            continue;
        }
        // Colours that change little by little are no edges: these have two even sides.
        let ends = [&around[..WINDOW - ramp], &around[WINDOW + ramp..]];
        let is_even = |side: &[f64]| {
            let [low, high] =
                side.iter().fold([f64::MAX, f64::MIN], |it, value| [it[0].min(*value), it[1].max(*value)]);
            high - low <= EVEN * height
        };
        if ends.into_iter().all(is_even) {
            widths.push(sigma);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::code::{Axis, StripeCode};
    use super::super::gray::{DecodeOptions, decode};
    use super::super::scene::Scene;
    use super::super::{edges, phase};
    use super::*;
    use crate::ImageView;

    /// A wall of squares, bright and dark, with a strip of shadow.
    fn squares(blur: f64, seed: u64) -> Scene {
        Scene {
            size: [160, 120],
            projector: |x, y| [20.0 + 0.61 * x + 0.04 * y, 12.0 + 0.58 * y - 0.03 * x],
            albedo: |x, y| {
                let [column, row] = [x + 0.2 * y, y - 0.2 * x].map(|it| (it / 24.0).floor() as i64);
                if (column + row) % 2 == 0 { 0.9 } else { 0.5 }
            },
            shadow: |x, _| (130.0..=140.0).contains(&x),
            blur,
            ..super::super::scene::wall(seed)
        }
    }

    struct Judged {
        defocus: Defocus,
        rms: f64,
        worst: f64,
        /// Root mean square of errors over their standard deviations.
        normalised: f64,
        share: f64,
    }

    fn judge(scene: &Scene, code: &StripeCode) -> Judged {
        let pictures = scene.pictures(code);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let decoded = decode(code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
        let found = match code.steps {
            0 => edges::coordinates(code, &views, &decoded, &edges::EdgeOptions::default()).unwrap(),
            _ => phase::coordinates(code, &views, &decoded, &[], &phase::PhaseOptions::default()).unwrap().coordinates,
        };
        let place = |at: usize| (scene.projector)((at % 160) as f64, (at / 160) as f64);
        let off = |at: usize| Axis::BOTH.map(|it| f64::from(found.values[it.index()][at]) - place(at)[it.index()]);
        let known: Vec<(f64, f64)> = (0..160 * 120)
            .flat_map(|at| [0, 1].map(|it| (off(at)[it], f64::from(found.sigmas[it][at]))))
            .filter(|it| it.0.is_finite())
            .collect();
        let n = known.len() as f64;
        Judged {
            defocus: edges::defocus(code, &views, &decoded, Axis::Columns, 1.0).unwrap(),
            rms: (known.iter().map(|it| it.0 * it.0).sum::<f64>() / n).sqrt(),
            worst: known.iter().map(|it| it.0.abs()).fold(0.0, f64::max),
            normalised: (known.iter().map(|it| (it.0 / it.1).powi(2)).sum::<f64>() / n).sqrt(),
            share: n / (2 * 160 * 120) as f64,
        }
    }

    #[test]
    fn a_camera_out_of_focus_is_told_from_edges_of_colours() {
        for seed in 1..=2 {
            for blur in [0.0, 1.0, 2.0, 3.0] {
                let judged = judge(&squares(blur, seed), &StripeCode::gray([160, 120]));
                let found = judged.defocus.sigma;
                assert!((found - blur.max(PIXEL)).abs() < 0.2 + 0.15 * blur, "{found} px of {blur}");
            }
            // A projector out of focus blurs no colours.
            let found = judge(&Scene { defocus: 2.0, ..squares(0.0, seed) }, &StripeCode::gray([160, 120])).defocus;
            assert!(found.sigma < 0.8, "{} px", found.sigma);
        }
    }

    #[test]
    fn colours_move_what_a_blurred_camera_sees_and_that_is_put_right() {
        for seed in 1..=2 {
            let coarse = StripeCode::gray([160, 120]).without_finest([2, 2]);
            // Without, the rms is 0.10 and 0.22 px.
            for (code, rms, worst) in [(coarse, 0.04, 1.5), (StripeCode::phase([160, 120], 8, 16), 0.12, 2.6)] {
                let it = judge(&squares(2.0, seed), &code);
                assert!(it.share > 0.75, "{} of the pixels", it.share);
                assert!(it.rms < rms && it.worst < worst, "rms {}, worst {} px", it.rms, it.worst);
                assert!(it.normalised < 2.5, "{} sigma", it.normalised);
            }
        }
    }
}
