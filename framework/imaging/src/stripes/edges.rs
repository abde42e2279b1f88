//! Boundaries of stripes between camera pixels, and the projector coordinate of each camera pixel from them.
//!
//! 1. Two neighbouring camera pixels of neighbouring stripes have a boundary between them. It belongs to one bit of the Gray code, whose
//!    picture is brighter than its inverse on one side and darker on the other: the boundary is where the difference, over white − black, passes through zero
//!    between the two. The projector coordinate of a boundary is known exactly. Where a level is cut off, the boundary may be anywhere from there to the pixel that is brighter than it seems.
//! 2. The projector coordinate of a pixel is that of a plane through the boundaries around it, u = a + b x + c y, with what lies off that plane left out.
//!    Its standard deviation follows from how far boundaries are off the plane, and from how alike they lie between their pixels: what they are off by that averages out only as far as they do not.
//! 3. A pixel whose plane is not in the stripe that it was decoded to, or does not fit, lies at a discontinuity and is left out.

use super::code::{Axis, Shown, StripeCode};
use super::defocus::Defocus;
use super::gray::{Decoded, NONE, same_size};
use crate::{ImageView, ImagingError};

/// How coordinates are made from boundaries.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgeOptions {
    /// How far around a pixel boundaries are taken from; 0: one and a half stripes, at least 2 [px].
    pub reach: usize,
    /// Of a camera's gray levels, standard deviation, for how boundaries weigh [gray levels].
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
    /// Blur of the camera, standard deviation; a sharp one's is 0.5, as is that of one on whose pictures nothing tells it [px].
    pub blur: f64,
}

/// A boundary of two stripes in the camera's picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Boundary {
    /// Where it passes between two pixels, one of its coordinates being a whole number [px].
    pub x: f32,
    /// As above.
    pub y: f32,
    /// Projector column (row) of the boundary [px].
    pub at: f32,
    /// Standard deviation along the line of the two pixels, of what is different for each [px].
    pub sigma: f32,
    /// Standard deviation by levels that are cut off, alike for boundaries that lie alike between their pixels [px].
    pub cut_off: f32,
}

/// No boundary counts for more than one placed as well as this, however strong: what is between two pixels is not quite a straight line [px].
const BEST_SIGMA: f64 = 0.05;
/// Two pixels between which a boundary is placed differ in white − black by no more than this: on an edge of the surface's own colour they differ by more [–].
const MAX_RATIO: f64 = 1.5;
/// Boundaries farther off their plane than so many standard deviations are left out.
const OUTLIER: f64 = 3.0;
/// And never those nearer than this [projector px].
const NEAR: f64 = 0.2;
/// Boundaries that make a plane.
const MIN_BOUNDARIES: usize = 4;
/// How far a plane may be outside the stripe that its pixel was decoded to [projector px].
const OUTSIDE: f64 = 0.4;
/// A coordinate known less well than this is none [projector px].
const MAX_SIGMA: f64 = 0.5;
/// What is usual of boundaries counts as much as the scatter of so many of them [–].
const USUAL: f64 = 4.0;
/// What is between two pixels is no straight line: a boundary is off by up to this times √2, as a sine of where it lies between them, and alike for all that lie alike [px].
const BETWEEN_PIXELS: f64 = 0.07;
/// Boundaries of one edge in neighbouring rows are off alike in part, by the surface's texture and curvature: so large a part of them tells as much as one [–].
const SHARED: f64 = 0.3;
/// No coordinate is known better than this, over the slope [px].
const LEAST_SIGMA: f64 = 0.015;

/// Blur of an edge from −1 to 1 times its slope: √(2 / π).
const OF_A_SLOPE: f64 = 0.797_884_560_802_865;

/// A gray level that may be cut off.
const SATURATED: u8 = 250;

/// Every so many rows and columns boundaries tell how blurred they are; so many tell it.
const SAMPLED: usize = 4;
const MIN_BLURS: usize = 50;
/// Of how blurred they are those tell that are ends of stripes which are wider than the finest by so many powers of two.
const WIDE: u32 = 2;

/// The picture of a bit and its inverse.
type Pair<'a> = (&'a [u8], Option<&'a [u8]>);

/// What boundaries of one axis are placed by.
struct Stripes<'a> {
    decoded: &'a Decoded,
    stripes: &'a [u16],
    /// By plane: the picture and its inverse, or twice the picture less white and black.
    pairs: Vec<Option<Pair<'a>>>,
    white: Option<&'a [u8]>,
    black: Option<&'a [u8]>,
    /// Boundaries before the first stripe of the code.
    first: u32,
}

/// A boundary between two neighbouring pixels.
struct Between {
    /// Which one, of the code.
    number: u32,
    /// How far from the first pixel to the second [px].
    part: f64,
    /// How much the difference of picture and inverse, over white − black, changes from one to the other [–].
    change: f64,
    /// Where a level is cut off, what is cut off leaves open where the boundary is: standard deviation [px].
    cut_off: f64,
}

impl<'a> Stripes<'a> {
    fn new(
        code: &StripeCode,
        pictures: &'a [ImageView<'_>],
        decoded: &'a Decoded,
        axis: Axis,
    ) -> Result<Stripes<'a>, ImagingError> {
        same_size(code, pictures)?;
        let index = axis.index();
        let shown = code.pictures();
        let picture = |what: Shown| shown.iter().position(|it| *it == what).map(|it| pictures[it].pixels());
        let pairs = (0..code.bits[index])
            .map(|plane| {
                let lit = picture(Shown::Bit { axis, plane, inverse: false })?;
                Some((lit, picture(Shown::Bit { axis, plane, inverse: true })))
            })
            .collect();
        Ok(Stripes {
            decoded,
            stripes: &decoded.stripes[index],
            pairs,
            white: picture(Shown::White),
            black: picture(Shown::Black),
            first: code.offset[index] / code.stripe[index],
        })
    }

    fn difference(&self, plane: usize, at: usize) -> f64 {
        let Some((lit, unlit)) = self.pairs[plane] else { return f64::NAN };
        let lit = f64::from(lit[at]);
        let difference = match (unlit, self.white, self.black) {
            (Some(unlit), ..) => lit - f64::from(unlit[at]),
            (None, Some(white), Some(black)) => 2.0 * lit - f64::from(white[at]) - f64::from(black[at]),
            (None, ..) => f64::NAN,
        };
        difference / f64::from(self.decoded.contrast[at].max(1))
    }

    /// Whether a level that tells the difference of a pixel is cut off: the difference is as large as it seems, or larger.
    fn is_cut_off(&self, plane: usize, at: usize) -> bool {
        let Some((lit, unlit)) = self.pairs[plane] else { return false };
        unlit.or(self.white).is_some_and(|it| it[at] >= SATURATED) || lit[at] >= SATURATED
    }

    /// Boundaries between two neighbouring pixels.
    fn between(&self, from: usize, to: usize) -> impl Iterator<Item = Between> {
        let (a, b) = (self.stripes[from], self.stripes[to]);
        let (contrast, other) = (self.decoded.contrast[from], self.decoded.contrast[to]);
        // Where bright meets dark each pixel is a mixture of both, and the boundary is not where the line says.
        let is_even = f64::from(contrast.max(other)) <= MAX_RATIO * f64::from(contrast.min(other));
        // Two boundaries between two pixels are of different bits, and each can be placed; more cannot be told from a step.
        let numbers = if is_even && a != NONE && b != NONE && a.abs_diff(b) <= 2 {
            u32::from(a.min(b)) + 1..u32::from(a.max(b)) + 1
        } else {
            0..0
        };
        numbers.filter_map(move |number| {
            let number = number + self.first;
            let plane = self.pairs.len().checked_sub(1 + number.trailing_zeros() as usize)?;
            let (before, after) = (self.difference(plane, from), self.difference(plane, to));
            let part = before / (before - after);
            // Anywhere from where it seems to the pixel that is brighter than it seems.
            let open = match [from, to].map(|it| self.is_cut_off(plane, it)) {
                [false, false] => 0.0,
                [true, false] => 1.0 - part,
                [false, true] => part,
                [true, true] => 1.0,
            };
            let cut_off = open / 12_f64.sqrt();
            (0.0..=1.0).contains(&part).then_some(Between { number, part, change: (before - after).abs(), cut_off })
        })
    }

    /// How far out of focus the camera is.
    fn defocus(&self, noise: f64) -> Defocus {
        let [width, height] = self.decoded.size;
        let mut blurred = Vec::new();
        for at in (0..height).step_by(SAMPLED).flat_map(|y| (0..width).step_by(SAMPLED).map(move |x| y * width + x)) {
            if at % width + 1 < width {
                blurred.extend(self.between(at, at + 1).map(|it| OF_A_SLOPE / it.change));
            }
            if at + width < width * height {
                blurred.extend(self.between(at, at + width).map(|it| OF_A_SLOPE / it.change));
            }
        }
        Defocus::of(&self.decoded.contrast, self.decoded.size, noise, blurred)
    }
}

/// How far out of focus the camera is, of a set of `pictures` as `code` says, by the stripes of `axis`; `noise`: of its gray levels, standard deviation.
///
/// # Errors
/// A set of pictures that is not as `code` says.
pub fn defocus(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    axis: Axis,
    noise: f64,
) -> Result<Defocus, ImagingError> {
    Ok(Stripes::new(code, pictures, decoded, axis)?.defocus(noise))
}

/// How blurred the boundaries of the stripes of `axis` are, by camera and projector together, on a set's pixels whose coordinates are `values`: of the sharper third of them, standard deviation [projector px]. `None` where too
/// few tell it.
///
/// # Errors
/// A set of pictures that is not as `code` says.
pub fn stripe_blur(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    axis: Axis,
    values: &[f32],
) -> Result<Option<f64>, ImagingError> {
    let all = Stripes::new(code, pictures, decoded, axis)?;
    let [width, height] = decoded.size;
    let mut blurs: Vec<f64> = Vec::new();
    for at in (0..height).step_by(SAMPLED).flat_map(|y| (0..width).step_by(SAMPLED).map(move |x| y * width + x)) {
        let beside = [(at % width + 1 < width, at + 1), (at + width < width * height, at + width)];
        for (_, other) in beside.into_iter().filter(|it| it.0) {
            let [from, to] = [at, other].map(|it| values.get(it).copied().unwrap_or(f32::NAN));
            let apart = f64::from((to - from).abs());
            // Beside the ends of narrow stripes the next ones take light off, too.
            let is_wide = |it: &Between| it.number.trailing_zeros() >= WIDE || code.steps > 0;
            let of_pair = all.between(at, other).filter(is_wide).map(|it| OF_A_SLOPE / it.change * apart);
            blurs.extend(of_pair.filter(|it| it.is_finite()));
        }
    }
    blurs.sort_by(f64::total_cmp);
    Ok(blurs.get(blurs.len() / 3).copied().filter(|_| blurs.len() >= MIN_BLURS))
}

/// All boundaries of the stripes of `axis`, row by row, in a row ascending by `x`; with, by row, where it begins, and the end.
///
/// # Errors
/// A set of pictures that is not as `code` says.
pub fn boundaries(
    code: &StripeCode,
    pictures: &[ImageView<'_>],
    decoded: &Decoded,
    axis: Axis,
    noise: f64,
) -> Result<(Vec<Boundary>, Vec<usize>), ImagingError> {
    let all = Stripes::new(code, pictures, decoded, axis)?;
    let defocus = all.defocus(noise);
    Ok(placed(&all, code, axis, noise, &defocus))
}

fn placed(
    all: &Stripes<'_>,
    code: &StripeCode,
    axis: Axis,
    noise: f64,
    defocus: &Defocus,
) -> (Vec<Boundary>, Vec<usize>) {
    let decoded = all.decoded;
    let [width, height] = decoded.size;
    let (stripe_width, offset) = (code.stripe[axis.index()], code.offset[axis.index()]);
    let (mut list, mut starts) = (Vec::new(), Vec::with_capacity(height + 1));
    let between = |from: usize, to: usize, down: bool, list: &mut Vec<Boundary>| {
        for Between { number, part, change, cut_off } in all.between(from, to) {
            let weakest = f64::from(decoded.contrast[from].min(decoded.contrast[to]).max(1));
            let along = noise * std::f64::consts::SQRT_2 / weakest * part.hypot(1.0 - part) / change;
            let place = [from % width, from / width];
            let line = if down { (height, width) } else { (width, 1) };
            let drawn = defocus.drawn(&decoded.contrast, from, place[usize::from(down)], line, OF_A_SLOPE / change);
            let (x, y) = (place[0] as f64, place[1] as f64);
            let (x, y) = if down { (x, y + part + drawn) } else { (x + part + drawn, y) };
            let at = f64::from(number * stripe_width) - 0.5 - f64::from(offset);
            list.push(Boundary {
                x: x as f32,
                y: y as f32,
                at: at as f32,
                sigma: along.hypot(BEST_SIGMA) as f32,
                cut_off: cut_off as f32,
            });
        }
    };
    for y in 0..height {
        starts.push(list.len());
        for x in 0..width {
            let at = y * width + x;
            if x + 1 < width {
                between(at, at + 1, false, &mut list);
            }
            if y + 1 < height {
                between(at, at + width, true, &mut list);
            }
        }
        let row = *starts.last().unwrap_or(&0);
        list[row..].sort_by(|a, b| a.x.total_cmp(&b.x));
    }
    starts.push(list.len());
    (list, starts)
}

/// The projector coordinate of each camera pixel from the boundaries around it.
///
/// # Errors
/// A set of pictures that is not as `code` says.
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

/// Boundaries of one axis.
struct Field<'a> {
    list: &'a [Boundary],
    /// Of each: sine and cosine of where it lies between its pixels, a turn from one to the next.
    phases: &'a [[f32; 2]],
    starts: &'a [usize],
    decoded: &'a Decoded,
    index: usize,
    code: &'a StripeCode,
    reach: usize,
    max_rms: f64,
    wanted: Option<&'a [bool]>,
}

/// A boundary seen from a pixel.
#[derive(Clone, Copy)]
struct Near {
    x: f64,
    y: f64,
    u: f64,
    weight: f64,
    phase: [f32; 2],
    /// What it is off by as a sine of where it lies between its pixels [px].
    between: f64,
}

impl Field<'_> {
    /// Fills some rows from `first` on.
    fn fill(&self, first: usize, values: &mut [f32], sigmas: &mut [f32]) {
        let [width, height] = self.decoded.size;
        let stripes = &self.decoded.stripes[self.index];
        let (stripe_width, offset) = (self.code.stripe[self.index], self.code.offset[self.index]);
        let middle = f64::from(stripe_width - 1) / 2.0 - f64::from(offset % stripe_width);
        let reach = self.reach as f32;
        let mut near: Vec<Near> = Vec::new();
        let mut begins: Vec<usize> = Vec::new();
        for (row, (values, sigmas)) in values.chunks_mut(width).zip(sigmas.chunks_mut(width)).enumerate() {
            let y = first + row;
            let rows = y.saturating_sub(self.reach)..(y + self.reach + 1).min(height);
            begins.clear();
            begins.extend(rows.clone().map(|it| self.starts[it]));
            for x in 0..width {
                let stripe = stripes[y * width + x];
                if stripe == NONE || self.wanted.is_some_and(|it| !it[y * width + x]) {
                    continue;
                }
                let centre = f64::from(stripe) * f64::from(stripe_width) + middle;
                near.clear();
                for (begin, row) in begins.iter_mut().zip(rows.clone()) {
                    let end = self.starts[row + 1];
                    while *begin < end && self.list[*begin].x < x as f32 - reach {
                        *begin += 1;
                    }
                    let both = self.list[*begin..end].iter().zip(&self.phases[*begin..end]);
                    for (it, phase) in both.take_while(|it| it.0.x <= x as f32 + reach) {
                        let u = f64::from(it.at) - centre;
                        near.push(Near {
                            x: f64::from(it.x) - x as f64,
                            y: f64::from(it.y) - y as f64,
                            u,
                            weight: 1.0 / f64::from(it.sigma * it.sigma),
                            phase: *phase,
                            between: BETWEEN_PIXELS.hypot(f64::from(it.cut_off)),
                        });
                    }
                }
                let half = f64::from(stripe_width) / 2.0;
                if let Some((value, sigma)) = plane(&mut near, half, self.max_rms) {
                    values[x] = (centre + value) as f32;
                    sigmas[x] = sigma as f32;
                }
            }
        }
    }
}

/// Value and standard deviation in the middle of a plane through boundaries; `None` where they make no plane, or one that is more than [`OUTSIDE`]
/// beyond `half` a stripe.
fn plane(near: &mut Vec<Near>, half: f64, max_rms: f64) -> Option<(f64, f64)> {
    // Boundaries of another surface are far off at first: the median says what is usual here.
    for round in 0..4 {
        // Points of one boundary alone do not tell the slope across it.
        if near.len() < MIN_BOUNDARIES || near.iter().all(|it| it.u == near[0].u) {
            return None;
        }
        let Plane { at, slope, variance } = Plane::fit(near)?;
        let residual = |it: &Near| it.u - at - slope[0] * it.x - slope[1] * it.y;
        let steep = slope[0].hypot(slope[1]);
        let n = near.len() as f64;
        let rms = (near.iter().map(|it| residual(it).powi(2)).sum::<f64>() / (n - 3.0).max(1.0)).sqrt();
        let limit = (OUTLIER * rms.min(max_rms)).max(NEAR * steep.max(1.0).min(2.0 * half));
        let before = near.len();
        if round < 3 {
            near.retain(|it| residual(it).abs() <= limit);
        }
        if near.len() == before {
            // How far they are off their plane says how well they are placed; few of them say it with less weight than what is usual.
            let factor = {
                let sum: f64 = near.iter().map(|it| residual(it).powi(2) * it.weight).sum();
                (sum + USUAL * steep * steep) / ((n - 3.0).max(0.0) + USUAL)
            };
            let ends = near.iter().fold([f64::MAX, f64::MIN], |it, near| [it[0].min(near.u), it[1].max(near.u)]);
            let n_edges = (ends[1] - ends[0]) / (2.0 * half) + 1.0;
            let of_scatter = (variance * factor * (SHARED * n / n_edges).max(1.0)).sqrt();
            let sigma = of_scatter.hypot(steep * between_pixels(near)).hypot(LEAST_SIGMA * steep);
            let good =
                at.abs() <= half + OUTSIDE && rms <= max_rms * (2.0 * half).max(1.0) && sigma <= MAX_SIGMA * 2.0 * half;
            return (good && sigma.is_finite()).then_some((at, sigma));
        }
    }
    None
}

/// What boundaries are off by together: all of it where they lie alike between their pixels, near 0 where it averages out [px].
fn between_pixels(near: &[Near]) -> f64 {
    let (mut sine, mut cosine, mut all) = (0.0, 0.0, 0.0);
    for Near { weight, phase: [s, c], between, .. } in near {
        let off = weight * between;
        (sine, cosine, all) = (sine + off * f64::from(*s), cosine + off * f64::from(*c), all + weight);
    }
    cosine.hypot(sine) / all
}

struct Plane {
    at: f64,
    slope: [f64; 2],
    /// Of `at`, for weights that are inverse variances.
    variance: f64,
}

impl Plane {
    fn fit(near: &[Near]) -> Option<Plane> {
        let (mut s, mut sx, mut sy, mut sxx, mut sxy, mut syy) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut su, mut sxu, mut syu) = (0.0, 0.0, 0.0);
        for Near { x, y, u, weight, .. } in near {
            let (wx, wy) = (weight * x, weight * y);
            s += weight;
            sx += wx;
            sy += wy;
            sxx += wx * x;
            sxy += wx * y;
            syy += wy * y;
            su += weight * u;
            sxu += wx * u;
            syu += wy * u;
        }
        let (a, b, c) = (sxx * syy - sxy * sxy, sxy * sy - sx * syy, sx * sxy - sxx * sy);
        let determinant = s * a + sx * b + sy * c;
        if determinant.is_nan() || determinant <= 1e-9 * s * sxx * syy || determinant <= 0.0 {
            return None;
        }
        let (d, e, f) = (s * syy - sy * sy, sx * sy - s * sxy, s * sxx - sx * sx);
        Some(Plane {
            at: (a * su + b * sxu + c * syu) / determinant,
            slope: [(b * su + d * sxu + e * syu) / determinant, (c * su + e * sxu + f * syu) / determinant],
            variance: a / determinant,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::code::{Axis, StripeCode};
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
            let cut_off: Vec<usize> =
                (0..19_200).filter(known).filter(|at| bright.1[*at] >= SATURATED && right.1[*at] < SATURATED).collect();
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
