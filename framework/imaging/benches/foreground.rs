//! Time of foreground and blobs, on the scene that `benches/peer_foreground.py` gives to OpenCV's MOG2.
//!
//! 640 × 480 px, texture of 40 gray levels and noise of 3 over 100, two discs of radius 40 px that move.
//! `cargo bench -p foveate-imaging --bench foreground`; median and least of 20 rounds over 30 pictures.

use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_imaging::{BlobFinder, BlobLimits, Foreground, ForegroundConfig, ImageView};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const N_PICTURES: usize = 30;

fn picture(room: &[f64], discs: &[[f64; 2]], random: &mut Random) -> Vec<u8> {
    let level = |i: usize| {
        let inside = |disc: &[f64; 2]| ((i % WIDTH) as f64 - disc[0]).hypot((i / WIDTH) as f64 - disc[1]) < 40.0;
        if discs.iter().any(inside) { 220.0 } else { room[i] }
    };
    (0..WIDTH * HEIGHT).map(|i| (level(i) + 3.0 * random.normal()).round().clamp(0.0, 255.0) as u8).collect()
}

fn main() {
    let mut random = Random::new(20020601);
    let room: Vec<f64> = (0..WIDTH * HEIGHT).map(|_| random.uniform_in(80.0, 120.0)).collect();
    let discs = |k: usize| [[100.0 + 10.0 * k as f64, 150.0], [500.0 - 8.0 * k as f64, 330.0]];
    let empty: Vec<_> = (0..N_PICTURES).map(|_| picture(&room, &[], &mut random)).collect();
    let moving: Vec<_> = (0..N_PICTURES).map(|k| picture(&room, &discs(k), &mut random)).collect();
    let view = |pixels| ImageView::new(pixels, WIDTH, HEIGHT).expect("made at this size");
    let mut foreground = Foreground::new(ForegroundConfig::default(), WIDTH, HEIGHT).expect("settings in range");
    for pixels in &empty {
        foreground.update(&view(pixels)).expect("sizes agree");
    }
    let (mut finder, mut blobs, mut errors) = (BlobFinder::default(), Vec::new(), 0.0);
    let mut times: Vec<f64> = (0..20)
        .map(|_| {
            let start = Instant::now();
            for (k, pixels) in moving.iter().enumerate() {
                foreground.update(&view(pixels)).expect("sizes agree");
                finder.find(&foreground, &BlobLimits::default(), &[], &mut blobs).expect("limits in range");
                assert_eq!(blobs.len(), 2, "picture {k}");
                let [x, y] = discs(k)[0];
                errors += (blobs[0].centroid.x - x).hypot(blobs[0].centroid.y - y);
            }
            start.elapsed().as_secs_f64() * 1e3 / N_PICTURES as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("640x480 foreground and blobs: median {:.3} ms, least {:.3} ms", times[10], times[0]);
    println!("centroid: mean error {:.3} px", errors / (20 * N_PICTURES) as f64);
}
