//! Boundaries of stripes between camera pixels, and the projector coordinate of each camera pixel from them.
//!
//! 1. Two neighbouring camera pixels of neighbouring stripes have a boundary between them (`placed`).
//! 2. The projector coordinate of a pixel is that of a plane through the boundaries around it (`plane`).
//! 3. A pixel whose plane is not in the stripe that it was decoded to, or does not fit, lies at a discontinuity and is left out.

mod placed;
mod plane;

pub use self::placed::{Boundary, boundaries, defocus, stripe_blur};
use self::placed::{Stripes, placed};
use self::plane::Field;
use super::code::{Axis, StripeCode};
use super::gray::{Decoded, NONE};
use crate::{ImageView, ImagingError};

/// Options of [`coordinates`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeOptions {
    /// How far around a pixel boundaries are taken from; 0: one and a half stripes, at least 2 [px].
    pub reach: usize,
    /// Noise of the camera, standard deviation, for the weights of boundaries [gray levels].
    pub noise: f64,
    /// A pixel whose boundaries lie farther off their plane than this, root mean square, is left out [projector px].
    pub max_rms: f64,
    /// Threads.
    pub threads: usize,
}

impl Default for EdgeOptions {
    fn default() -> Self {
        Self { reach: 0, noise: 1.5, max_rms: 0.3, threads: 1 }
    }
}

/// The projector coordinates of camera pixels.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Coordinates {
    /// Columns and rows of the camera's pictures [px].
    pub size: [usize; 2],
    /// By axis, row by row: projector column (row), NaN where there is none; empty for an axis that was not decoded [px].
    pub values: [Vec<f32>; 2],
    /// Their standard deviations, NaN where there is none [px].
    pub sigmas: [Vec<f32>; 2],
    /// Blur of the camera, standard deviation; 0.5 for a sharp one, or where it cannot be measured [px].
    pub blur: f64,
}

/// The projector coordinate of each camera pixel, between stripes, from the boundaries around it.
///
/// # Errors
/// Another number or size of pictures than `code` has.
pub fn coordinates(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    options: &EdgeOptions,
) -> Result<Coordinates, ImagingError> {
    coordinates_where(code, pictures, decoded, options, [None, None])
}

/// As [`coordinates`], at those camera pixels alone that are `wanted` by axis, row by row; `None`: at all.
///
/// # Errors
/// [`coordinates`]'s.
pub fn coordinates_where(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    options: &EdgeOptions,
    wanted: [Option<&[bool]>; 2],
) -> Result<Coordinates, ImagingError> {
    let mut found = Coordinates { size: decoded.size, ..Coordinates::default() };
    let ([width, height], n) = (decoded.size, decoded.size[0] * decoded.size[1]);
    for axis in Axis::BOTH {
        let index = axis.index();
        if decoded.stripes[index].len() != n || n == 0 {
            continue;
        }
        let (mut values, mut sigmas) = (vec![f32::NAN; n], vec![f32::NAN; n]);
        let wanted = wanted[index];
        if wanted.is_some_and(|it| !it.contains(&true)) {
            (found.values[index], found.sigmas[index]) = (values, sigmas);
            continue;
        }
        let all = Stripes::new(code, pictures, decoded, axis)?;
        let defocus = all.defocus(options.noise);
        found.blur = found.blur.max(defocus.sigma);
        let (list, starts) = placed(&all, code, axis, options.noise, &defocus);
        let lit = decoded.stripes[index].iter().filter(|it| **it != NONE).count();
        let reach = match options.reach {
            0 => ((1.5 * lit as f64 / list.len().max(1) as f64).ceil() as usize).clamp(2, 24),
            it => it,
        };
        // One of the two coordinates is a whole number.
        let phase = |it: &Boundary| (std::f32::consts::TAU * (it.x.fract() + it.y.fract())).sin_cos().into();
        let phases: Vec<[f32; 2]> = list.iter().map(phase).collect();
        let (list, phases, starts, max_rms) = (&list, &phases, &starts, options.max_rms);
        let field = Field { list, phases, starts, decoded, index, code, reach, max_rms, wanted };
        let rows = height.div_ceil(options.threads.max(1)).max(1);
        std::thread::scope(|scope| {
            let parts = values.chunks_mut(rows * width).zip(sigmas.chunks_mut(rows * width));
            for (part, (values, sigmas)) in parts.enumerate() {
                let field = &field;
                let mut run = move || field.fill(part * rows, values, sigmas);
                if rows == height {
                    run();
                } else {
                    scope.spawn(run);
                }
            }
        });
        defocus.settle(&mut values, &mut sigmas, &decoded.contrast, decoded.size, false);
        (found.values[index], found.sigmas[index]) = (values, sigmas);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::super::code::{Axis, Shown, StripeCode};
    use super::super::gray::{DecodeOptions, decode};
    use super::super::scene::{Scene, wall};
    use super::*;

    struct Judged {
        share: f64,
        rms: f64,
        worst: f64,
        /// Root mean square of errors over their standard deviations.
        normalised: f64,
    }

    /// The least over the pixel's area, which may lie on both sides of a step.
    fn error(scene: &Scene, at: usize, index: usize, value: f64) -> f64 {
        let (x, y) = ((at % scene.size[0]) as f64, (at / scene.size[0]) as f64);
        let off = |dx: f64| value - (scene.projector)(x + dx, y)[index];
        if off(-0.5).abs().max(off(0.5).abs()) < 2.0 {
            off(0.0)
        } else {
            [off(-0.5), off(0.5)].into_iter().min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap()
        }
    }

    fn judge(scene: &Scene, code: &StripeCode, axis: Axis) -> Judged {
        let pictures = scene.pictures(code);
        let [width, height] = scene.size;
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, width, height).unwrap()).collect();
        let decoded = decode(code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
        let found = coordinates(code, &views, &decoded, &EdgeOptions { threads: 2, ..EdgeOptions::default() }).unwrap();
        let index = axis.index();
        let mut errors: Vec<(f64, f64)> = Vec::new();
        for (at, (value, sigma)) in found.values[index].iter().zip(&found.sigmas[index]).enumerate() {
            if value.is_finite() {
                errors.push((error(scene, at, index, f64::from(*value)), f64::from(*sigma)));
            }
        }
        let n = errors.len() as f64;
        Judged {
            share: n / (width * height) as f64,
            rms: (errors.iter().map(|it| it.0 * it.0).sum::<f64>() / n).sqrt(),
            worst: errors.iter().map(|it| it.0.abs()).fold(0.0, f64::max),
            normalised: (errors.iter().map(|it| (it.0 / it.1).powi(2)).sum::<f64>() / n).sqrt(),
        }
    }

    #[track_caller]
    fn check(make: impl Fn(u64) -> Scene, code: &StripeCode, share: f64, rms: f64, worst: f64) {
        for seed in 1..=4 {
            for axis in Axis::BOTH {
                let it = judge(&make(seed), code, axis);
                assert!(it.share >= share, "{axis:?}, seed {seed}: {} of the pixels", it.share);
                assert!(it.rms <= rms && it.worst <= worst, "{axis:?}, seed {seed}: rms {} worst {}", it.rms, it.worst);
                assert!((0.2..2.0).contains(&it.normalised), "{axis:?}, seed {seed}: {} sigma", it.normalised);
            }
        }
    }

    #[test]
    fn coordinates_are_known_to_a_part_of_a_projector_pixel() {
        // The middles of stripes would be 0.29 px off; the worst pixels lie half in shadow.
        check(wall, &StripeCode::gray([160, 120]), 0.95, 0.04, 0.95);
    }

    #[test]
    fn a_gamma_and_blur_do_not_move_boundaries() {
        check(|seed| Scene { gamma: 2.2, defocus: 0.8, ..wall(seed) }, &StripeCode::gray([160, 120]), 0.95, 0.04, 0.95);
    }

    #[test]
    fn coarse_stripes_are_placed_by_their_edges_too() {
        let far = |x: f64, y: f64| [20.0 + 0.193 * x, 14.0 + 0.21 * y];
        check(
            |seed| Scene { projector: far, shadow: |_, _| false, ..wall(seed) },
            &StripeCode::gray([160, 120]),
            0.9,
            0.04,
            0.3,
        );
    }

    #[test]
    fn nothing_is_made_up_across_a_step() {
        let scene = wall(5);
        let pictures = scene.pictures(&StripeCode::gray([160, 120]));
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let code = StripeCode::gray([160, 120]);
        let decoded = decode(&code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
        let found = coordinates(&code, &views, &decoded, &EdgeOptions::default()).unwrap();
        for y in 0..120 {
            for x in 84..94 {
                let value = f64::from(found.values[0][y * 160 + x]);
                let off = error(&scene, y * 160 + x, 0, value);
                assert!(value.is_nan() || off.abs() < 0.8, "({x}, {y}): {value} is off by {off}");
            }
        }
    }

    #[test]
    fn places_by_levels_that_are_cut_off_are_vaguer() {
        let code = StripeCode::gray([160, 120]);
        for seed in 6..=8 {
            // Twice as much light as the camera takes, and as much as it takes.
            let [bright, right] = [420.0, 200.0].map(|gain| {
                let scene = Scene { gain, ..wall(seed) };
                let pictures = scene.pictures(&code);
                let views: Vec<ImageView<'_>> =
                    pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
                let decoded = decode(&code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
                let found = coordinates(&code, &views, &decoded, &EdgeOptions::default()).unwrap();
                (found, pictures[code.place(Shown::White).unwrap()].clone())
            });
            let known = |at: &usize| {
                let is_known = |it: &Coordinates| it.values[0][*at].is_finite();
                is_known(&bright.0) && is_known(&right.0) && !(84..94).contains(&(at % 160))
            };
            let cut_off: Vec<usize> = (0..19_200)
                .filter(known)
                .filter(|at| bright.1[*at] >= placed::SATURATED && right.1[*at] < placed::SATURATED)
                .collect();
            let mean_square = |of: &dyn Fn(usize) -> f64| {
                (cut_off.iter().map(|at| of(*at).powi(2)).sum::<f64>() / cut_off.len() as f64).sqrt()
            };
            let sigma = |of: &Coordinates| mean_square(&|at| f64::from(of.sigmas[0][at]));
            let sigmas = [&bright.0, &right.0].map(sigma);
            assert!(cut_off.len() > 3000 && sigmas[0] > 1.3 * sigmas[1], "seed {seed}: {} {sigmas:?}", cut_off.len());
            let scene = wall(seed);
            let normalised = mean_square(&|at| {
                error(&scene, at, 0, f64::from(bright.0.values[0][at])) / f64::from(bright.0.sigmas[0][at])
            });
            assert!(normalised < 1.0, "seed {seed}: {normalised}");
        }
    }
}
