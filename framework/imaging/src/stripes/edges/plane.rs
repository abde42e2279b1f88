//! The projector coordinate of a pixel: that of a plane through the boundaries around it, u = a + b x + c y, with what lies off that plane left out.
//!
//! Its standard deviation follows from how far boundaries are off the plane, and from how alike they lie between their pixels: what they are off by that averages out only as far as they do not.

use super::super::code::StripeCode;
use super::super::gray::{Decoded, NONE};
use super::placed::Boundary;

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

/// Boundaries of one axis.
pub(super) struct Field<'a> {
    pub list: &'a [Boundary],
    /// Of each: sine and cosine of where it lies between its pixels, a turn from one to the next.
    pub phases: &'a [[f32; 2]],
    pub starts: &'a [usize],
    pub decoded: &'a Decoded,
    pub index: usize,
    pub code: &'a StripeCode,
    pub reach: usize,
    pub max_rms: f64,
    pub wanted: Option<&'a [bool]>,
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
    pub fn fill(&self, first: usize, values: &mut [f32], sigmas: &mut [f32]) {
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
