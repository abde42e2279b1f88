//! Rims of silhouettes: a lens blurs them, so that pixels beside the body differ from the background, too, and a body is found a pixel too wide at each side.
//!
//! A pixel at the rim is a mixture α·i + (1 − α)·o of the colours i a few pixels further in and o a few pixels further out, so α = (p − o)·(i − o) / |i − o|²; below one half it is background. Where both hardly differ, as in
//! clothes of the background's colour, and in limbs that are too thin to have an inside, the rim stays.

use foveate::messages::Silhouette;

/// How far in and out colours are taken [px]: beyond the blur of a lens.
const REACH: f64 = 3.0;
/// Smallest difference of colours for a mixture [gray level].
const CONTRAST: f64 = 30.0;

/// Takes pixels at the rim of the body in `confidence` away, layer by layer, that are more background than body: their confidence is the highest that is none. `pixels` has `channels` bytes a pixel.
pub(crate) fn trim(pixels: &[u8], channels: usize, width: usize, layers: u32, confidence: &mut [u8]) {
    let height = confidence.len() / width.max(1);
    let mut removed = Vec::new();
    for _ in 0..layers {
        removed.clear();
        let is_body = |x: i64, y: i64| {
            (0..width as i64).contains(&x)
                && (0..height as i64).contains(&y)
                && confidence[y as usize * width + x as usize] >= Silhouette::BODY
        };
        for (y, row) in confidence.chunks_exact(width.max(1)).enumerate() {
            let (Some(first), Some(last)) = (body(row.iter()), body(row.iter().rev())) else { continue };
            for (x, value) in row.iter().enumerate().take(width - last).skip(first) {
                let at = [x as i64, y as i64];
                let inside = is_body(at[0], at[1] - 1)
                    && is_body(at[0], at[1] + 1)
                    && is_body(at[0] - 1, at[1])
                    && is_body(at[0] + 1, at[1]);
                if *value < Silhouette::BODY || inside {
                    continue;
                }
                let Some([inner, outer]) = across(at, [width, height], is_body) else { continue };
                let colour = |[x, y]: [i64; 2]| &pixels[(y as usize * width + x as usize) * channels..][..channels];
                if share(colour(at), colour(inner), colour(outer)).is_some_and(|it| it < 0.5) {
                    removed.push(y * width + x);
                }
            }
        }
        if removed.is_empty() {
            return;
        }
        removed.iter().for_each(|it| confidence[*it] = Silhouette::BODY - 1);
    }
}

fn body<'a>(mut of: impl Iterator<Item = &'a u8>) -> Option<usize> {
    of.position(|it| *it >= Silhouette::BODY)
}

/// A pixel inside the body and one outside, across the rim at `at`; none in limbs that are too thin, and at the end of the picture.
fn across(at: [i64; 2], size: [usize; 2], is_body: impl Fn(i64, i64) -> bool) -> Option<[[i64; 2]; 2]> {
    let mut out = [0.0; 2];
    for (dx, dy) in (-2..=2).flat_map(|dy| (-2..=2).map(move |dx| (dx, dy))) {
        if !is_body(at[0] + dx, at[1] + dy) {
            out[0] += dx as f64;
            out[1] += dy as f64;
        }
    }
    let length = f64::hypot(out[0], out[1]);
    if length < 1e-9 {
        return None;
    }
    let step = |by: f64| [0, 1].map(|axis| at[axis] + (by * out[axis] / length).round() as i64);
    let (inner, between, outer) = (step(-REACH), step(-0.5 * REACH), step(REACH));
    let in_picture = (0..2).all(|axis| (0..size[axis] as i64).contains(&outer[axis]));
    let is_rim = is_body(inner[0], inner[1]) && is_body(between[0], between[1]) && !is_body(outer[0], outer[1]);
    (in_picture && is_rim).then_some([inner, outer])
}

/// The part of the inner colour in a mixture; `None` where the two hardly differ.
fn share(mixed: &[u8], inner: &[u8], outer: &[u8]) -> Option<f64> {
    let (mut along, mut apart) = (0.0, 0.0);
    for ((p, i), o) in mixed.iter().zip(inner).zip(outer) {
        let (p, i, o) = (f64::from(*p), f64::from(*i), f64::from(*o));
        along += (p - o) * (i - o);
        apart += (i - o) * (i - o);
    }
    (apart >= CONTRAST * CONTRAST * mixed.len() as f64 / 3.0).then(|| along / apart)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 60;

    /// A disc of 12.3 px before another gray, blurred, and a silhouette that is too wide by 1.5 px.
    fn blurred(body: f64, background: f64) -> (Vec<u8>, Vec<u8>) {
        let places = (0..SIZE).flat_map(|y| (0..SIZE).map(move |x| (x as f64 - 29.8).hypot(y as f64 - 30.3) - 12.3));
        let pixels = places.clone().map(|it| background + (body - background) / (1.0 + (2.0 * it).exp()));
        (pixels.map(|it| it.round() as u8).collect(), places.map(|it| if it < 1.5 { 200 } else { 0 }).collect())
    }

    fn area(confidence: &[u8]) -> f64 {
        confidence.iter().filter(|it| **it >= Silhouette::BODY).count() as f64
    }

    #[test]
    fn a_blurred_rim_ends_where_half_of_it_is_body() {
        let truth = std::f64::consts::PI * 12.3 * 12.3;
        let (pixels, mut confidence) = blurred(180.0, 60.0);
        assert!(area(&confidence) > 1.2 * truth);
        trim(&pixels, 1, SIZE, 2, &mut confidence);
        assert!((area(&confidence) / truth - 1.0).abs() < 0.03, "{}", area(&confidence) / truth);
        // What is no body any more may be body.
        assert!(confidence.contains(&(Silhouette::BODY - 1)));
        // A silhouette that is right stays.
        let before = confidence.clone();
        trim(&pixels, 1, SIZE, 2, &mut confidence);
        assert!((area(&confidence) / area(&before) - 1.0).abs() < 0.01);
    }

    #[test]
    fn rims_without_contrast_and_thin_limbs_stay() {
        let (pixels, before) = blurred(70.0, 60.0);
        let mut confidence = before.clone();
        trim(&pixels, 1, SIZE, 2, &mut confidence);
        assert_eq!(confidence, before);
        let line = |thick: usize, value: u8| {
            (0..SIZE * SIZE)
                .map(|it| if (30..30 + thick).contains(&(it % SIZE)) { value } else { 0 })
                .collect::<Vec<u8>>()
        };
        let mut thin = line(3, 200);
        trim(&line(1, 200), 1, SIZE, 2, &mut thin);
        assert_eq!(thin, line(3, 200));
    }
}
