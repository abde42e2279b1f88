//! Brings all pictures to one light before it is known which picture shows what.
//!
//! Wherever a picture stands in its set and whatever stripes it shows, a pixel is lit in it or dark. With the middle m
//! and half of the difference h of these two, a picture under a light of the room that is a times L brighter has the
//! level m ± k h + a L there: k is below 1 where fine stripes are blurred, which takes as much from what is lit as it
//! adds to what is dark. The estimates alternate: the lights of each picture from all of its pixels, then m, h and L of
//! each pixel from all pictures. The light may differ along the rows of a picture, as a lamp's does that flickers while
//! a rolling shutter reads them. That is good enough to judge which picture shows what; once that is known, pairs of
//! opposite pictures tell the same better ([`super::light`]).

use super::super::faults::SetFault;
use super::lit::spread;
use crate::ImageView;

/// Pixels that tell it, at most and at least.
const SAMPLES: usize = 4000;
const MIN_SAMPLES: usize = 500;
/// Pictures that tell it, at least.
const MIN_PICTURES: usize = 8;
/// A gray level that may be cut off.
const SATURATED: u8 = 250;
/// Stretches of rows of which each has a light of its own.
const BANDS: usize = 24;
/// Turns in which pictures and pixels are found.
const ROUNDS: usize = 20;
/// Bands to either side over which lights are means, round by round: all of the picture at first, then what follows a light that flickers several times in a picture.
const REACH: [usize; 16] = [24, 24, 16, 8, 4, 2, 2, 2, 2, 2, 2, 2, 1, 1, 1, 1];
/// Turns in which a pixel's light is found alone, at most, and the part of it that is left open [–].
const TURNS: usize = 8;
const SETTLED: f64 = 0.02;
/// How firmly stripes are taken to be sharp, of what pixels tell: pictures with one kind of pixels alone, such as white, leave it open [–].
const SHARP: f64 = 0.02;
/// Pixels count less from so many standard deviations of noise on, this many gray levels, and this part of half of the difference of lit and dark.
const SIGMAS: f64 = 3.0;
const LEVELS: f64 = 1.0;
const PART: f64 = 0.15;
/// A pixel is not lit where its levels scatter by no more than so many standard deviations of noise, and a gray level.
const NO_STRIPES: f64 = 1.5;
/// … or by no more than this part of what they do without the light taken off: stripes are in step with no light [–].
const LIGHT_ALONE: f64 = 0.35;
/// Lights that differ by less than this are alike [gray levels].
const LIGHT: f64 = 2.0;
/// A light of the room that differs by more than this, half of what a picture shows at all, is none [gray levels].
const MOST_LIGHT: f64 = 128.0;
/// Of lights by picture and band, what is said is the highest but for the rest [–].
const NEARLY_ALL: f64 = 0.95;
/// Lights are what differs where they leave no more than this part of what pixels are off without them: of rendered sets whose lamp flickers by 7 gray levels and more they leave 0.2 to 0.47, another exposure of each picture or a
/// scene that moves leaves more [–].
const EXPLAINED: f64 = 0.5;

/// Pictures in one light.
pub(super) struct Levelled {
    /// All that were looked at.
    pub(super) pictures: Vec<(usize, Vec<u8>)>,
    /// What is said of it.
    pub(super) fault: SetFault,
}

/// How sharp a picture's stripes are, and its light by band.
#[derive(Debug, Clone)]
struct Lighting {
    contrast: f64,
    light: Vec<f64>,
}

impl Lighting {
    fn level(&self, pixel: &Pixel, is_lit: bool, band: usize) -> f64 {
        let half = if is_lit { pixel.half } else { -pixel.half };
        pixel.middle + self.contrast * half + self.light[band] * pixel.light
    }

    /// The light at a row, between the middles of bands.
    fn light_at(&self, row: usize, height: usize) -> f64 {
        let at = ((row as f64 + 0.5) / height as f64 * BANDS as f64 - 0.5).clamp(0.0, (BANDS - 1) as f64);
        let (first, part) = (at as usize, at.fract());
        self.light[first] + part * (self.light[(first + 1).min(BANDS - 1)] - self.light[first])
    }
}

/// What is known of a pixel in the light of most pictures.
#[derive(Debug, Clone, Copy, Default)]
struct Pixel {
    middle: f64,
    half: f64,
    light: f64,
}

/// The pictures `present` in one light, as all of them together tell it; `None` where they are that already, or something else is different.
pub(super) fn levelled(pictures: &[ImageView<'_>], present: &[usize], noise: f64) -> Option<Levelled> {
    let (width, height) = pictures.get(*present.first()?)?.size();
    if present.len() < MIN_PICTURES || present.iter().any(|it| pictures[*it].size() != (width, height)) {
        return None;
    }
    let step = ((width * height) as f64 / SAMPLES as f64).sqrt().ceil() as usize;
    let is_whole = |at: &usize| present.iter().all(|it| pictures[*it].pixels()[*at] < SATURATED);
    let places: Vec<usize> = spread((width, height), step).into_iter().filter(is_whole).collect();
    if places.len() < MIN_SAMPLES {
        return None;
    }
    let rows: Vec<Vec<f64>> =
        places.iter().map(|at| present.iter().map(|it| f64::from(pictures[*it].pixels()[*at])).collect()).collect();
    let bands: Vec<usize> = places.iter().map(|at| at / width * BANDS / height).collect();
    let [none, best] = [false, true].map(|differs| Fit::of(&rows, &bands, noise, differs));
    let by = best.differ_by();
    // More light than is there says that stripes were taken for it.
    if best.off > EXPLAINED * none.off || !(LIGHT..=MOST_LIGHT).contains(&by) {
        return None;
    }
    let mut evened: Vec<(usize, Vec<u8>)> = present.iter().map(|it| (*it, pictures[*it].pixels().to_vec())).collect();
    let mut levels = vec![0.0; present.len()];
    let mut spare = Vec::new();
    let mut lights = vec![0.0; present.len()];
    for row in 0..height {
        lights.iter_mut().zip(&best.lightings).for_each(|(to, it)| *to = it.light_at(row, height));
        for at in row * width..(row + 1) * width {
            levels.iter_mut().zip(present).for_each(|(to, it)| *to = f64::from(pictures[*it].pixels()[at]));
            let pixel = best.pixel(&levels, &lights, noise, None, &mut spare);
            for (((_, to), level), light) in evened.iter_mut().zip(&levels).zip(&lights) {
                if *level < f64::from(SATURATED) {
                    to[at] = (level - light * pixel.light).round().clamp(0.0, 255.0) as u8;
                }
            }
        }
    }
    Some(Levelled { pictures: evened, fault: SetFault::Unsteady { by } })
}

/// Lightings of pictures.
struct Fit {
    /// Whether lights differ; else all pictures are in one.
    differs: bool,
    lightings: Vec<Lighting>,
    /// How far pixels are off, the mean of what counts [gray levels].
    off: f64,
    /// The light over what is dark, in the middle one of the pixels [–].
    over_dark: f64,
    /// The light in the middle one of the pixels [gray levels].
    usual_light: f64,
}

impl Fit {
    /// `rows` are levels by pixel and picture, `bands` where pixels lie.
    fn of(rows: &[Vec<f64>], bands: &[usize], noise: f64, differs: bool) -> Fit {
        let n = rows[0].len();
        let start = Lighting { contrast: 1.0, light: vec![0.0; BANDS] };
        let mut fit = Fit { differs, lightings: vec![start; n], off: f64::INFINITY, over_dark: 1.0, usual_light: 0.0 };
        let mut pixels: Vec<Option<Pixel>> = vec![None; rows.len()];
        let (mut spare, mut lights) = (Vec::new(), vec![0.0; n]);
        for round in 0..ROUNDS {
            for ((row, band), pixel) in rows.iter().zip(bands).zip(&mut pixels) {
                lights.iter_mut().zip(&fit.lightings).for_each(|(to, it)| *to = it.light[*band]);
                *pixel = Some(fit.pixel(row, &lights, noise, *pixel, &mut spare));
            }
            let known: Vec<Pixel> = pixels.iter().flatten().copied().collect();
            fit.off = 0.0;
            for picture in 0..n {
                fit.off += fit.find_picture(picture, rows, bands, &known, noise) / n as f64;
            }
            fit.centre();
            fit.smooth(REACH.get(round).copied().unwrap_or(0));
        }
        let mut over_dark: Vec<f64> =
            pixels.iter().flatten().map(|it| it.light / (it.middle - it.half).max(1.0)).collect();
        over_dark.sort_by(f64::total_cmp);
        fit.over_dark = over_dark[over_dark.len() / 2];
        let mut lights: Vec<f64> = pixels.iter().flatten().map(|it| it.light).collect();
        lights.sort_by(f64::total_cmp);
        fit.usual_light = lights[lights.len() / 2];
        fit
    }

    /// A pixel by its levels, under so much light in each picture; as it was found before, or at first.
    fn pixel(&self, levels: &[f64], lights: &[f64], noise: f64, before: Option<Pixel>, spare: &mut Vec<f64>) -> Pixel {
        let n = levels.len();
        if self.differs
            && let Some(it) = Self::unlit_pixel(levels, lights, noise)
        {
            return it;
        }
        let mut pixel = before.unwrap_or_default();
        for turn in 0..if before.is_some() || !self.differs { 1 } else { TURNS } {
            let light = pixel.light;
            let even = |it: usize| levels[it] - lights[it] * light;
            spare.clear();
            spare.extend((0..n).map(even));
            // The middle ones of what is dark and of what is lit: half of the pictures each.
            let dark = *spare.select_nth_unstable_by(n / 4, f64::total_cmp).1;
            let lit = *spare.select_nth_unstable_by(n - 1 - n / 4, f64::total_cmp).1;
            pixel = Pixel { middle: (dark + lit) / 2.0, half: (lit - dark) / 2.0, ..pixel };
            if !self.differs {
                break;
            }
            if turn == 0 && before.is_none() {
                // What is dark is lit by the room.
                pixel.light = self.over_dark * dark;
                continue;
            }
            let (mut product, mut square) = (0.0, 0.0);
            for it in 0..n {
                let is_lit = even(it) > pixel.middle;
                let half = if is_lit { pixel.half } else { -pixel.half };
                let off = levels[it] - pixel.middle - self.lightings[it].contrast * half;
                let weight = weight(off - lights[it] * pixel.light, &pixel, noise);
                (product, square) = (product + weight * lights[it] * off, square + weight * lights[it] * lights[it]);
            }
            let found = if square > 0.0 { (product / square).max(0.0) } else { light };
            pixel.light = found;
            if (found - light).abs() <= SETTLED * light {
                break;
            }
        }
        pixel
    }

    /// A pixel that the projector does not light, where its levels are those of one under the light of the room alone: what flickers there is no stripe.
    fn unlit_pixel(levels: &[f64], lights: &[f64], noise: f64) -> Option<Pixel> {
        let n = levels.len() as f64;
        let [level, light] = [levels, lights].map(|it| it.iter().sum::<f64>() / n);
        let off = levels.iter().zip(lights).map(|(y, a)| [y - level, a - light]);
        let [yy, ya, aa] = off.fold([0.0; 3], |[yy, ya, aa], [y, a]| [yy + y * y, ya + y * a, aa + a * a]);
        let times = if aa > 0.0 { (ya / aa).max(0.0) } else { 0.0 };
        let left = ((yy - times * (2.0 * ya - times * aa)).max(0.0) / n).sqrt();
        let scatter = (yy / n).sqrt();
        let is_unlit = left <= (NO_STRIPES * noise + LEVELS).max(LIGHT_ALONE * scatter);
        is_unlit.then_some(Pixel { middle: level - times * light, half: 0.0, light: times })
    }

    /// Finds a picture's light, by what is known of pixels; what it is off by.
    fn find_picture(
        &mut self,
        picture: usize,
        rows: &[Vec<f64>],
        bands: &[usize],
        pixels: &[Pixel],
        noise: f64,
    ) -> f64 {
        let now = &self.lightings[picture];
        // Of each band: products of the light with itself, with stripes, and with levels less the middle; and those of stripes, of all.
        let mut of_bands = vec![[0.0; 3]; BANDS];
        let [mut hh, mut ho, mut off_sum, mut weights] = [0.0; 4];
        for ((row, band), pixel) in rows.iter().zip(bands).zip(pixels) {
            let level = row[picture];
            let is_lit = level - now.light[*band] * pixel.light > pixel.middle;
            let off = level - now.level(pixel, is_lit, *band);
            let weight = weight(off, pixel, noise);
            let (h, o) = (if is_lit { pixel.half } else { -pixel.half }, level - pixel.middle);
            (off_sum, weights) = (off_sum + weight * off.abs(), weights + weight);
            let light = weight * pixel.light;
            let [ll, lh, lo] = &mut of_bands[*band];
            (*ll, *lh, *lo) = (*ll + light * pixel.light, *lh + light * h, *lo + light * o);
            (hh, ho) = (hh + weight * h * h, ho + weight * h * o);
        }
        let firm = SHARP * hh;
        if self.differs {
            for [ll, lh, lo] in of_bands.iter().filter(|it| it[0] > 0.0) {
                (hh, ho) = (hh - lh * lh / ll, ho - lh * lo / ll);
            }
        }
        let contrast = (ho + firm) / (hh + firm);
        let now = &mut self.lightings[picture];
        if contrast.is_finite() {
            now.contrast = contrast.clamp(0.0, 1.0);
        }
        if self.differs {
            for (light, [ll, lh, lo]) in now.light.iter_mut().zip(&of_bands).filter(|it| it.1[0] > 0.0) {
                *light = (lo - now.contrast * lh) / ll;
            }
        }
        off_sum / f64::max(weights, 1.0)
    }

    /// Lights over those of the middle picture.
    fn centre(&mut self) {
        for band in 0..BANDS {
            let mut all: Vec<f64> = self.lightings.iter().map(|it| it.light[band]).collect();
            all.sort_by(f64::total_cmp);
            self.lightings.iter_mut().for_each(|it| it.light[band] -= all[all.len() / 2]);
        }
    }

    /// Lights of bands as means over neighbours, `reach` to either side: where the projector lights nothing, nothing but neighbours tells light from stripes at first.
    fn smooth(&mut self, reach: usize) {
        for it in &mut self.lightings {
            let bands = |at: usize| at.saturating_sub(reach)..(at + reach + 1).min(BANDS);
            let mean = |at: usize| it.light[bands(at)].iter().sum::<f64>() / bands(at).len() as f64;
            it.light = (0..BANDS).map(mean).collect();
        }
    }

    /// By how much pictures differ from their mean, in the middle one of the pixels [gray levels].
    fn differ_by(&self) -> f64 {
        let n = self.lightings.len() as f64;
        let off_mean = |band: usize| {
            let mean = self.lightings.iter().map(|it| it.light[band]).sum::<f64>() / n;
            self.lightings.iter().map(move |it| (it.light[band] - mean).abs())
        };
        let mut lights: Vec<f64> = (0..BANDS).flat_map(off_mean).collect();
        lights.sort_by(f64::total_cmp);
        // But for the last ones: of a band in which stripes are like the light it is known less well.
        self.usual_light * lights[(NEARLY_ALL * (lights.len() - 1) as f64) as usize]
    }
}

/// How much a pixel counts that is off by so much.
fn weight(off: f64, pixel: &Pixel, noise: f64) -> f64 {
    let usual = SIGMAS * noise + LEVELS + PART * pixel.half;
    1.0 / (1.0 + (off / usual).powi(2))
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::super::super::code::{Axis, Shown, StripeCode};
    use super::super::super::scene::{Scene, wall, wall_code};
    use super::super::tests::examined;
    use super::*;

    /// Pictures of a scene, each under a light of the room that is so many gray levels times the surface's albedo brighter, by picture and row.
    fn under(light: impl Fn(usize, usize) -> f64, scene: &Scene) -> Vec<Vec<u8>> {
        let change = |(picture, pixels): (usize, Vec<u8>)| {
            let more = |at: usize| light(picture, at / 160) * (scene.albedo)((at % 160) as f64, (at / 160) as f64);
            let level = |(at, it): (usize, u8)| 0.7 * (f64::from(it) + more(at));
            pixels.into_iter().enumerate().map(|it| level(it).round().clamp(0.0, 255.0) as u8).collect()
        };
        scene.pictures(&wall_code()).into_iter().enumerate().map(change).collect()
    }

    /// By picture what a lamp adds that flickers.
    fn flicker(levels: f64, seed: u64) -> Vec<f64> {
        let mut random = Random::new(seed);
        (0..wall_code().pictures().len()).map(|_| levels * (1.0 + random.normal().clamp(-1.0, 1.0))).collect()
    }

    /// What is said of pictures but for their light.
    #[track_caller]
    fn beside_light(pictures: &[Vec<u8>], what: &str) -> Vec<SetFault> {
        let found = examined(&wall_code(), pictures);
        // All of the wall is lit: a light there is much like another exposure.
        let is_light = |it: &SetFault| matches!(it, SetFault::Unsteady { .. } | SetFault::Uneven { .. });
        assert!(found.faults.iter().any(is_light), "{what}: {:?}", found.faults);
        assert_eq!(found.usable(&wall_code()), Axis::BOTH, "{what}: {:?}", found.faults);
        found.faults.into_iter().filter(|it| !is_light(it)).collect()
    }

    #[test]
    fn a_lamp_that_flickers_is_no_other_fault() {
        for seed in 1..=2 {
            // The camera sees beyond what the projector lights.
            let scene = Scene { projector: |x, y| [-60.0 + 1.4 * x, 12.0 + 0.58 * y], ..wall(seed) };
            for levels in [15.0, 30.0, 60.0] {
                let light = flicker(levels, seed);
                let pictures = under(|picture, _| light[picture], &scene);
                assert_eq!(beside_light(&pictures, "flicker"), [], "seed {seed}, {levels} gray levels");
            }
        }
    }

    #[test]
    fn real_faults_are_named_under_a_lamp_that_flickers() {
        for seed in 1..=2 {
            let light = flicker(40.0, seed);
            let sound = under(|picture, _| light[picture], &wall(seed));
            let mut exchanged = sound.clone();
            exchanged.swap(3, 12);
            let told = beside_light(&exchanged, "exchanged");
            assert!(matches!(told[..], [SetFault::Exchanged { pictures: [3, 12], mended: true, .. }]), "{told:?}");
            let mut doubled = sound.clone();
            doubled[10] = doubled[9].clone();
            let told = beside_light(&doubled, "doubled");
            assert!(matches!(told[..], [SetFault::Doubled { picture: 10, same_as: 9, .. }]), "{told:?}");
            let mut lacking = sound;
            let missing = wall_code().pictures()[20];
            lacking.remove(20);
            let told = beside_light(&lacking, "lacking");
            let is_it = |it: &SetFault| matches!(it, SetFault::Missing { shown, .. } if *shown == missing);
            assert!(told.len() == 2 && told.iter().any(is_it), "{told:?}");
        }
    }

    #[test]
    fn a_light_that_differs_along_rows_is_taken_off() {
        let code = wall_code();
        for seed in 1..=2 {
            let mut random = Random::new(seed);
            let phases: Vec<f64> = code.pictures().iter().map(|_| 3.2 * random.normal()).collect();
            let light = |picture: usize, row: usize| 25.0 * (1.0 + (0.07 * row as f64 + phases[picture]).sin());
            let pictures = under(light, &wall(seed));
            let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
            let present: Vec<usize> = (0..views.len()).collect();
            let levelled = levelled(&views, &present, 1.0).unwrap().pictures;
            // Of pictures of one bit the sums are those of white and black, in one light.
            let [white, black] = [Shown::White, Shown::Black].map(|it| code.place(it).unwrap());
            let sums =
                |of: &[Vec<u8>], pair: [usize; 2], at: usize| f64::from(of[pair[0]][at]) + f64::from(of[pair[1]][at]);
            let off = |of: &[Vec<u8>]| {
                let all = (0..white).step_by(2).flat_map(|it| (0..19_200).step_by(7).map(move |at| (it, at)));
                let all = all.map(|(it, at)| (sums(of, [it, it + 1], at) - sums(of, [white, black], at)).powi(2));
                let (sum, n) = all.fold((0.0, 0.0), |(sum, n), it| (sum + it, n + 1.0));
                (sum / n).sqrt()
            };
            let evened: Vec<Vec<u8>> = levelled.into_iter().map(|it| it.1).collect();
            let [before, after] = [off(&pictures), off(&evened)];
            assert!(after < 0.3 * before, "seed {seed}: {before:.2} -> {after:.2}");
        }
    }

    #[test]
    fn sound_sets_have_nothing_to_level() {
        for (code, seed) in [(wall_code(), 1), (wall_code(), 2), (StripeCode::phase([160, 120], 4, 8), 3)] {
            let pictures = wall(seed).pictures(&code);
            let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
            assert!(levelled(&views, &(0..views.len()).collect::<Vec<_>>(), 1.0).is_none(), "seed {seed}");
        }
    }
}
