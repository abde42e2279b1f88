//! What unsteady ambient light adds to the phase steps of a set, which have no inverse pictures.

use super::{MIN_SAMPLES, SATURATED, at_share};

/// White − black of pixels that tell the light of phase steps [gray levels]; their waves are as high as most, but for this factor.
const LEAST_CONTRAST: f64 = 12.0;
const WAVE: f64 = 1.5;
/// Turns in which phases and the light of steps are found.
const WAVE_ROUNDS: usize = 40;
/// A light that is everywhere the same part of white − black cannot be distinguished from the mean of waves, where 1 less the square of their correlation is below this [–].
const ALIKE_EVERYWHERE: f64 = 0.01;

/// What is known of the waves of some pixels: white and black in one light, and what a light that is not steady adds to a picture.
pub(super) struct Waves {
    pub white: Vec<f64>,
    pub black: Vec<f64>,
    pub light: Vec<f64>,
}

impl Waves {
    /// How many times the light each step of a wave has, by what pixels see of all steps.
    ///
    /// A wave's mean and height are the same parts of white − black everywhere. Its phase differs from pixel to pixel,
    /// and what a light adds does not: the search alternates between phases without the light, and the light of each
    /// step as the residual of waves with these phases. Each round leaves half of the error that the light causes in
    /// the wave itself.
    pub fn light_of_steps(&self, rows: &[Vec<f64>]) -> Option<Vec<f64>> {
        let n = rows.first()?.len();
        let count = n as f64;
        let turns: Vec<[f64; 2]> =
            (0..n).map(|it| (std::f64::consts::TAU * it as f64 / count).sin_cos()).map(|(s, c)| [c, s]).collect();
        let is_whole = |it: &usize| {
            self.white[*it] - self.black[*it] >= LEAST_CONTRAST
                && self.white[*it] < f64::from(SATURATED)
                && rows[*it].iter().all(|level| *level < f64::from(SATURATED))
        };
        let seen: Vec<usize> = (0..rows.len()).filter(is_whole).collect();
        if seen.len() < MIN_SAMPLES {
            return None;
        }
        let mut times = vec![0.0; n];
        for _ in 0..WAVE_ROUNDS {
            let waves: Vec<(usize, [f64; 4])> = seen
                .iter()
                .map(|at| {
                    let [mut mean, mut cosine, mut sine] = [0.0; 3];
                    for ((level, times), [c, s]) in rows[*at].iter().zip(&times).zip(&turns) {
                        let level = (level - times * self.light[*at] - self.black[*at]) / count;
                        (mean, cosine, sine) = (mean + level, cosine + 2.0 * level * c, sine + 2.0 * level * s);
                    }
                    (*at, [mean, cosine, sine, cosine.hypot(sine)])
                })
                .collect();
            let contrast = |at: usize| self.white[at] - self.black[at];
            // Parts of white − black, in the middle one of the pixels.
            let part = |which: usize| at_share(0.5, waves.iter().map(|(at, it)| it[which] / contrast(*at)).collect());
            let (mean_part, height_part) = (part(0), part(3));
            let is_wave = |(at, [.., height]): &&(usize, [f64; 4])| {
                let usual = height_part * contrast(*at);
                (usual / WAVE..=usual * WAVE).contains(height)
            };
            let mut products = vec![0.0; n];
            let mut square = 0.0;
            for (at, [_, cosine, sine, height]) in waves.iter().filter(is_wave) {
                let (light, contrast) = (self.light[*at], contrast(*at));
                let scale = height_part * contrast / height;
                for ((product, level), [c, s]) in products.iter_mut().zip(&rows[*at]).zip(&turns) {
                    let wave = self.black[*at] + mean_part * contrast + scale * (cosine * c + sine * s);
                    *product += light * (level - wave);
                }
                square += light * light;
            }
            times = products.iter().map(|it| it / square.max(1e-9)).collect();
        }
        // What all steps have alike adds to the mean of waves, which is a part of white − black.
        let [mut cc, mut cl, mut ll, mut co, mut lo] = [0.0; 5];
        for at in seen {
            let (contrast, light) = (self.white[at] - self.black[at], self.light[at]);
            let steps = rows[at].iter().zip(&times).map(|(level, times)| level - times * light);
            let mean = steps.sum::<f64>() / count - self.black[at];
            (cc, cl, ll) = (cc + contrast * contrast, cl + contrast * light, ll + light * light);
            (co, lo) = (co + contrast * mean, lo + light * mean);
        }
        let determinant = cc * ll - cl * cl;
        if determinant > ALIKE_EVERYWHERE * cc * ll {
            let alike = (cc * lo - cl * co) / determinant;
            times.iter_mut().for_each(|it| *it += alike);
        }
        times.iter().all(|it| it.is_finite()).then_some(times)
    }
}
