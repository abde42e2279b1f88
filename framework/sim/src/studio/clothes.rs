//! What a body's surfaces look like: skin, face, hair, and clothes of plain, striped, checked, printed and knitted cloth.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use nalgebra::Point3;

use super::body::{Build, Limb, Piece};
use super::texture::{Colour, Pyramid, size_for};
use crate::painted::noise;

/// Width and height of a stitch of a knitted sweater [m].
const STITCH_M: [f64; 2] = [4.2e-3, 3.2e-3];
/// Faces are painted so much finer than clothes.
const FINER_FACE: f64 = 2.0;

/// How cloth is coloured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Pattern {
    Plain,
    /// Around the body, so wide [m].
    Hoops(f64),
    /// Along it.
    Stripes(f64),
    Checks(f64),
    /// Blots of this size.
    Print(f64),
    /// Knitted of flecked wool.
    Knitted,
}

/// A cloth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cloth {
    pub colours: [Colour; 2],
    pub pattern: Pattern,
    pub seed: u32,
}

/// Clothes and colours of a person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Look {
    pub shirt: Cloth,
    pub trousers: Cloth,
    pub skin: Colour,
    pub hair: Colour,
    pub shoes: Colour,
    pub seed: u32,
}

const SKINS: [Colour; 6] = [
    [0.62, 0.43, 0.34],
    [0.56, 0.37, 0.28],
    [0.50, 0.33, 0.24],
    [0.38, 0.23, 0.16],
    [0.24, 0.14, 0.095],
    [0.15, 0.085, 0.06],
];
const HAIRS: [Colour; 5] =
    [[0.02, 0.018, 0.016], [0.05, 0.03, 0.02], [0.11, 0.06, 0.035], [0.30, 0.20, 0.10], [0.32, 0.31, 0.30]];
const TROUSERS: [Colour; 6] = [
    [0.05, 0.075, 0.16],
    [0.10, 0.15, 0.27],
    [0.035, 0.035, 0.04],
    [0.30, 0.25, 0.17],
    [0.16, 0.16, 0.17],
    [0.12, 0.13, 0.08],
];

fn mixed(a: Colour, b: Colour, share: f32) -> Colour {
    [0, 1, 2].map(|it| a[it] + (b[it] - a[it]) * share)
}

fn times(a: Colour, by: f32) -> Colour {
    a.map(|it| it * by)
}

impl Cloth {
    fn draw_shirt(random: &mut Random) -> Self {
        let mut colour = || {
            // A hue at random, from pale to full.
            let (hue, full, bright) =
                (random.uniform_in(0.0, 6.0), random.uniform_in(0.1, 0.9), random.uniform_in(0.10, 0.65));
            let channel = |shift: f64| {
                let at = (hue + shift).rem_euclid(6.0);
                let pure = ((at - 3.0).abs() - 1.0).clamp(0.0, 1.0);
                (bright * (1.0 - full + full * pure)) as f32
            };
            [channel(0.0), channel(4.0), channel(2.0)]
        };
        let colours = [colour(), colour()];
        let pattern = match random.below(6) {
            0 | 1 => Pattern::Plain,
            2 => Pattern::Hoops(random.uniform_in(0.012, 0.06)),
            3 => Pattern::Stripes(random.uniform_in(0.008, 0.04)),
            4 => Pattern::Checks(random.uniform_in(0.02, 0.07)),
            _ => Pattern::Print(random.uniform_in(0.02, 0.08)),
        };
        Self { colours, pattern, seed: random.next_u64() as u32 }
    }

    /// A sweater of flecked wool with a pattern knitted into it.
    pub fn sweater(random: &mut Random) -> Self {
        let warm = random.uniform_in(0.0, 1.0) as f32;
        let colours =
            [mixed([0.50, 0.42, 0.30], [0.34, 0.42, 0.50], warm), mixed([0.10, 0.06, 0.05], [0.05, 0.07, 0.12], warm)];
        Self { colours, pattern: Pattern::Knitted, seed: random.next_u64() as u32 }
    }

    /// At a point on a cylinder as wide as the limb, `around` [m] and `along` [m] on the cloth.
    pub fn colour(&self, p: &Point3<f64>, around: f64, along: f64) -> Colour {
        let [first, second] = self.colours;
        let seed = self.seed;
        let weave = 1.0 + 0.06 * noise(p, [3e-3; 3], seed) + 0.05 * noise(p, [0.02; 3], seed ^ 3);
        let band = |at: f64, wide: f64| {
            let edge = ((at / wide).rem_euclid(2.0) - 1.0).abs() - 0.5;
            (edge * wide / 1.5e-3 + 0.5).clamp(0.0, 1.0) as f32
        };
        let plain = match self.pattern {
            Pattern::Plain => first,
            Pattern::Hoops(wide) => mixed(first, second, band(along, wide)),
            Pattern::Stripes(wide) => mixed(first, second, band(around, wide)),
            Pattern::Checks(wide) => mixed(first, second, 0.5 * (band(around, wide) + band(along, wide))),
            Pattern::Print(size) => {
                let blot = noise(p, [size; 3], seed ^ 5) + 0.4 * noise(p, [0.4 * size; 3], seed ^ 6);
                mixed(first, second, (blot * 8.0 + 0.5).clamp(0.0, 1.0))
            }
            Pattern::Knitted => return self.knitted(p, around, along),
        };
        times(plain, weave)
    }

    /// Stitches like a V, dark between them; flecks of the yarn; a pattern of two colours that never repeats.
    fn knitted(&self, p: &Point3<f64>, around: f64, along: f64) -> Colour {
        let seed = self.seed;
        let column = around / STITCH_M[0];
        let slanted = along / STITCH_M[1] + (column.fract() - 0.5).abs() * 1.2;
        let across = (TAU * column).cos();
        let ridge = (0.5 + 0.5 * (TAU * slanted).cos()) as f32 * (0.75 + 0.25 * across) as f32;
        let stitch = 0.62 + 0.38 * ridge;
        let figure = noise(p, [0.016; 3], seed ^ 11) + 0.7 * noise(p, [0.006; 3], seed ^ 12);
        let flecks = 0.30 * noise(p, [2.2e-3; 3], seed ^ 13) + 0.20 * noise(p, [1.1e-3; 3], seed ^ 14);
        let tone = mixed(self.colours[0], self.colours[1], (figure * 1.6 + 0.5).clamp(0.0, 1.0));
        times(tone, (stitch * (1.0 + flecks)).max(0.05))
    }
}

impl Look {
    /// Of a person; `in_sweater` overrides what the shirt would be.
    pub fn draw(in_sweater: bool, random: &mut Random) -> Self {
        let mut shirt = Cloth::draw_shirt(random);
        if in_sweater {
            shirt = Cloth::sweater(random);
        }
        let pick = |of: usize, random: &mut Random| random.below(of as u32) as usize;
        let skin = SKINS[pick(SKINS.len(), random)];
        let hair = HAIRS[if skin[0] < 0.4 { pick(2, random) } else { pick(HAIRS.len(), random) }];
        let trousers = TROUSERS[pick(TROUSERS.len(), random)];
        let cloth = |colour: Colour, seed: u32| Cloth { colours: [colour; 2], pattern: Pattern::Plain, seed };
        let dark = random.uniform_in(0.02, 0.12) as f32;
        let shoes = if random.below(4) == 0 { [0.55, 0.55, 0.53] } else { [dark, dark * 0.9, dark * 0.8] };
        let trousers = cloth(trousers, random.next_u64() as u32);
        Self { shirt, trousers, skin, hair, shoes, seed: random.next_u64() as u32 }
    }

    /// Paints one of the body's surfaces, with texels of `texel_m`.
    pub fn paint(&self, build: &Build, piece: &Piece, texel_m: f64) -> Pyramid {
        let [around_m, long_m] = piece.limb.extent_m();
        let finer = if piece.limb == Limb::Head { FINER_FACE } else { 1.0 };
        let size = size_for(around_m / texel_m * finer, long_m / texel_m * finer);
        let last = piece.along.len() - 1;
        let radius = around_m / TAU;
        let unit_m = long_m / (piece.along[last] - piece.along[0]);
        Pyramid::paint(size, |u, v| {
            let at = (v * last as f64).clamp(0.0, last as f64 - 1e-9);
            let (ring, share) = (at as usize, at.fract());
            let along = piece.along[ring] + (piece.along[ring + 1] - piece.along[ring]) * share;
            let angle = u * TAU;
            let along_m = along * unit_m;
            let p = Point3::new(radius * angle.cos() + 0.4 * piece.side as f64, radius * angle.sin(), along_m);
            self.colour(build, piece, along, angle, &p, [u * around_m, along_m])
        })
    }

    fn colour(
        &self,
        build: &Build,
        piece: &Piece,
        along: f64,
        angle: f64,
        p: &Point3<f64>,
        [around_m, along_m]: [f64; 2],
    ) -> Colour {
        let is_covered = piece.is_covered(build, along);
        match piece.limb {
            Limb::Trunk if is_covered && along > 0.0 => self.shirt.colour(p, around_m, along_m),
            Limb::Trunk if is_covered => {
                // A belt below the shirt.
                let belt = if along > -0.03 { 0.4 } else { 1.0 };
                times(self.trousers.colour(p, around_m, along_m), belt)
            }
            Limb::Arm if is_covered => self.shirt.colour(p, around_m, along_m),
            Limb::Leg if is_covered => self.trousers.colour(p, around_m, along_m),
            Limb::Head => self.face(build, along, angle, p),
            Limb::Foot => {
                let sole = if (TAU * 0.25..TAU * 0.75).contains(&angle) && angle.cos() < -0.75 { 0.4 } else { 1.0 };
                let laces = noise(p, [0.02, 0.02, 0.006], self.seed ^ 81) * 0.15;
                times(self.shoes, sole * (1.0 + laces))
            }
            _ => self.skin(p),
        }
    }

    /// Skin has little to see: blotches, pores, hairs.
    pub fn skin(&self, p: &Point3<f64>) -> Colour {
        let seed = self.seed;
        let tone = 1.0
            + 0.05 * noise(p, [0.03; 3], seed ^ 51)
            + 0.035 * noise(p, [8e-3; 3], seed ^ 52)
            + 0.03 * noise(p, [2.5e-3; 3], seed ^ 53)
            + 0.02 * noise(p, [1.0e-3; 3], seed ^ 54);
        let red = 0.04 * noise(p, [0.02; 3], seed ^ 55);
        [self.skin[0] * (tone + red), self.skin[1] * tone, self.skin[2] * (tone - 0.5 * red)]
    }

    fn face(&self, build: &Build, along: f64, angle: f64, p: &Point3<f64>) -> Colour {
        let aside = angle.min(TAU - angle);
        let mut seen = self.skin(p);
        // Where it lies on the face: to the side [m] and up [m].
        let (side, up) = (aside * 0.085, along);
        let blot = |at: [f64; 2], wide: f64, tall: f64| {
            let off = ((side - at[0]) / wide).powi(2) + ((up - at[1]) / tall).powi(2);
            ((1.0 - off) * 4.0).clamp(0.0, 1.0) as f32
        };
        let cheeks = blot([0.042, -0.03], 0.03, 0.02) * 0.25;
        seen = mixed(seen, [seen[0], seen[1] * 0.82, seen[2] * 0.82], cheeks);
        let lips = mixed(self.skin, [0.42, 0.14, 0.13], 0.55);
        seen = mixed(seen, lips, blot([0.0, -0.070], 0.026, 0.008));
        seen = mixed(seen, times(lips, 0.3), blot([0.0, -0.070], 0.024, 0.0014));
        seen = mixed(seen, [0.62, 0.61, 0.58], blot([0.031, 0.010], 0.015, 0.0065));
        seen = mixed(seen, self.hair, blot([0.031, 0.010], 0.0062, 0.0062));
        seen = mixed(seen, [0.02; 3], blot([0.031, 0.010], 0.003, 0.003));
        seen = mixed(seen, self.hair, 0.8 * blot([0.033, 0.029], 0.021, 0.0045));
        seen = mixed(seen, times(self.skin, 0.35), blot([0.007, -0.046], 0.005, 0.0035));
        let hair = build.hair(along, angle, self.seed) as f32;
        let strands = 1.0 + 0.35 * noise(p, [2.5e-3, 2.5e-3, 0.02], self.seed ^ 61);
        mixed(seen, times(self.hair, strands), hair)
    }
}

/// How a surface shines: how much of a lamp it mirrors, and how sharply, as a whole power of a cosine. Cloth does not.
pub(crate) fn gloss(limb: Limb) -> [f32; 2] {
    match limb {
        Limb::Head => [0.05, 18.0],
        Limb::Hand | Limb::Thumb => [0.04, 18.0],
        Limb::Foot => [0.10, 30.0],
        Limb::Arm | Limb::Leg | Limb::Trunk => [0.0, 1.0],
    }
}
