//! Decoding of a Gray code, 42 pictures of 1280 × 1024: the time of a set, of reading its pictures once, and of telling whether the camera moved meanwhile.
//!
//! `cargo bench -p foveate-imaging --bench stripes`. Its peer: `peer_stripes.py` beside it.

use std::hint::black_box;
use std::time::Instant;

use foveate_imaging::ImageView;
use foveate_imaging::stripes::drift::drift;
use foveate_imaging::stripes::{Axis, DecodeOptions, Shown, StripeCode, decode, gray, pattern};

const WIDTH: usize = 1280;
const HEIGHT: usize = 1024;

fn main() {
    let code = StripeCode::gray([1024, 768]);
    let mut noise = 1_u32;
    let mut seen = |shown: &Shown| -> Vec<u8> {
        let projected = pattern::picture(&code, *shown, 1.0);
        let pixel = |at: usize| {
            let (x, y) = (at % WIDTH, at / WIDTH);
            noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let lit = projected[(y * 3 / 4) * 1024 + x * 4 / 5];
            20 + (u32::from(lit) * (60 + (x as u32 / 40) % 120) / 255) as u8 + (noise >> 30) as u8
        };
        (0..WIDTH * HEIGHT).map(pixel).collect()
    };
    let pictures: Vec<Vec<u8>> = code.pictures().iter().map(&mut seen).collect();
    let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, WIDTH, HEIGHT).unwrap()).collect();
    let read = || -> u64 {
        let words = pictures.iter().flat_map(|it| it.chunks_exact(8));
        words.map(|it| u64::from_le_bytes(it.try_into().unwrap())).fold(0, u64::wrapping_add)
    };
    println!(
        "reading 42 pictures once: {:.2} ms",
        median(|| {
            black_box(read());
        })
    );
    for threads in [1, 2] {
        let options = DecodeOptions { threads, ..DecodeOptions::default() };
        let mut decoded = gray::Decoded::default();
        let run = || gray::decode_into(&code, &views, &Axis::BOTH, &options, black_box(&mut decoded)).unwrap();
        println!("decoding, {threads} thread(s): {:.2} ms", median(run));
    }
    // A surface with colours of its own says where it lies; one without is asked for all its pixels.
    let mut textured = pictures.clone();
    for (at, pixel) in textured.iter_mut().flat_map(|it| it.iter_mut().enumerate()) {
        let (x, y) = (at % WIDTH, at / WIDTH);
        let shade = 0.75 + 0.25 * (x as f32 / 7.0).sin() * (y as f32 / 9.0).cos();
        *pixel = (f32::from(*pixel) * shade) as u8;
    }
    for (name, set) in [("coloured", &textured), ("plain", &pictures)] {
        let views: Vec<ImageView<'_>> = set.iter().map(|it| ImageView::new(it, WIDTH, HEIGHT).unwrap()).collect();
        println!(
            "whether the camera moved, a {name} surface: {:.2} ms",
            median(|| {
                black_box(drift(&code, &views, 12));
            })
        );
    }
    let decoded = decode(&code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
    let found = decoded.stripes[0].iter().filter(|it| **it != u16::MAX).count();
    println!("pixels with a column: {:.1} %", 100.0 * found as f64 / (WIDTH * HEIGHT) as f64);
}

/// Median of 31 runs after three [ms].
fn median(mut run: impl FnMut()) -> f64 {
    (0..3).for_each(|_| run());
    let mut times: Vec<f64> = (0..31)
        .map(|_| {
            let start = Instant::now();
            run();
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times.sort_by(f64::total_cmp);
    times[15]
}
