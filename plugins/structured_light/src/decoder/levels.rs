//! Coordinates of all pixels: by all bits, or where these are undetermined, by the bits that the camera resolves there.

use foveate::imaging::ImageView;
use foveate::imaging::stripes::code::{Axis, StripeCode};
use foveate::imaging::stripes::finest::TooFine;
use foveate::imaging::stripes::gray::{DecodeOptions, decode_into};
use foveate::imaging::stripes::phase::PhaseOptions;
use foveate::imaging::stripes::{Coordinates, EdgeOptions, edges, phase};

use super::Decoder;

/// Bits beyond those that are too fine all over the picture, without which pixels are tried that cannot be decoded with them.
const COARSER: u32 = 2;

impl Decoder {
    /// Coordinates of all pixels: by all bits, or where these are undetermined, by the bits that the camera resolves there; with the part of the lit pixels that only coarser bits determined, of columns and rows.
    pub(super) fn coordinates(
        &mut self,
        code: &StripeCode,
        views: &[ImageView<'_>],
        axes: &[Axis],
        options: &DecodeOptions,
        too_fine: &TooFine,
        noise: f64,
    ) -> Result<(Coordinates, [f64; 2]), String> {
        let mut too_fine = too_fine.clone();
        let mut n_filled = [0_usize; 2];
        let most = too_fine.overall().map(|it| it + COARSER);
        let mut all: Option<Coordinates> = None;
        // Levels that all pixels which want them have been tried with.
        let mut tried: Option<TooFine> = None;
        loop {
            for level in too_fine.levels() {
                let width = views.first().map_or(1, |it| it.width());
                let wants = |at: usize, grid: &TooFine| grid.at(at % width, at / width) == level;
                let is_new = |at: usize| wants(at, &too_fine) && !tried.as_ref().is_some_and(|it| wants(at, it));
                let open = all.as_ref().map(|all| {
                    let is_open = |(at, it): (usize, &f32)| it.is_nan() && is_new(at);
                    all.values.each_ref().map(|it| it.iter().enumerate().map(is_open).collect::<Vec<bool>>())
                });
                if open.as_ref().is_some_and(|it| !it.iter().flatten().any(|it| *it)) {
                    continue;
                }
                let (coarse, views) = coarser(code, views, level);
                self.level = level;
                decode_into(&coarse, &views, axes, options, &mut self.decoded).map_err(|fault| fault.to_string())?;
                let (Some(all), Some(open)) = (&mut all, open) else {
                    all = Some(self.of_bits(&coarse, &views, noise, [None, None])?);
                    continue;
                };
                let found = self.of_bits(&coarse, &views, noise, open.each_ref().map(|it| Some(it.as_slice())))?;
                for (axis, open) in open.iter().enumerate() {
                    for at in (0..open.len()).filter(|it| open[*it]) {
                        all.values[axis][at] = found.values[axis][at];
                        all.sigmas[axis][at] = found.sigmas[axis][at];
                        n_filled[axis] += usize::from(found.values[axis][at].is_finite());
                    }
                }
            }
            let Some(all) = all.as_ref().filter(|_| code.steps == 0) else { break };
            let least = options.min_contrast;
            let is_open = |at: usize, axis: usize| {
                let value = all.values[axis].get(at).filter(|_| self.decoded.contrast[at] >= least)?;
                Some(value.is_nan())
            };
            let Some(coarser) = too_fine.coarser_where(all.size, most, is_open) else { break };
            tried = Some(std::mem::replace(&mut too_fine, coarser));
        }
        let n_lit = self.decoded.contrast.iter().filter(|it| **it >= options.min_contrast).count().max(1);
        Ok((all.unwrap_or_default(), n_filled.map(|it| it as f64 / n_lit as f64)))
    }

    fn of_bits(
        &mut self,
        code: &StripeCode,
        views: &[ImageView<'_>],
        noise: f64,
        wanted: [Option<&[bool]>; 2],
    ) -> Result<Coordinates, String> {
        let edges = EdgeOptions { noise, threads: self.settings.threads, ..EdgeOptions::default() };
        (self.off_wave, self.steps, self.exchanged) = Default::default();
        if code.steps == 0 {
            let found = edges::coordinates_where(code, views, &self.decoded, &edges, wanted);
            return found.map_err(|fault| fault.to_string());
        }
        let options = PhaseOptions { noise, ..PhaseOptions::default() };
        let found = phase::coordinates(code, views, &self.decoded, &self.worked_out, &options);
        let found = found.map_err(|fault| fault.to_string())?;
        (self.off_wave, self.steps, self.exchanged) = (found.off_wave, found.steps, found.exchanged);
        Ok(found.coordinates)
    }
}

/// A code without its finest bits of columns and rows, so many, and its pictures.
pub(super) fn coarser<'a>(
    code: &StripeCode,
    views: &[ImageView<'a>],
    without: [u32; 2],
) -> (StripeCode, Vec<ImageView<'a>>) {
    let coarse = code.without_finest(without);
    let (shown, is_kept) = (code.pictures(), coarse.pictures());
    let views = shown.iter().zip(views).filter(|it| is_kept.contains(it.0)).map(|it| *it.1).collect();
    (coarse, views)
}
