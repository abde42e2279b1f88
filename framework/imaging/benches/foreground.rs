//! Time of foreground and blobs, on the scene that `benches/peer_foreground.py` gives to OpenCV's MOG2.
//!
//! 640 × 480 px, texture of 40 gray levels and noise of 3 over 100, two discs of radius 40 px that move.
//! `cargo bench -p foveate-imaging --bench foreground`; median and least of 60 rounds over 30 pictures,
//! each after the same 30 pictures of the empty room.

use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_imaging::{BlobFinder, BlobLimits, Foreground, ForegroundConfig, ImageView};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const N_PICTURES: usize = 30;
const ROUNDS: usize = 60;

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
    let discs = |k: usize| [[100.3 + 10.37 * k as f64, 150.4], [500.2 - 8.21 * k as f64, 330.7]];
    let empty: Vec<_> = (0..N_PICTURES).map(|_| picture(&room, &[], &mut random)).collect();
    let moving: Vec<_> = (0..N_PICTURES).map(|k| picture(&room, &discs(k), &mut random)).collect();
    let view = |pixels| ImageView::new(pixels, WIDTH, HEIGHT).expect("made at this size");
    let mut learnt = Foreground::new(ForegroundConfig::default(), WIDTH, HEIGHT).expect("settings in range");
    for pixels in &empty {
        learnt.update(&view(pixels)).expect("sizes agree");
    }
    let (mut finder, mut blobs, mut errors) = (BlobFinder::default(), Vec::new(), Vec::new());
    let mut times: Vec<f64> = (0..ROUNDS)
        .map(|_| {
            let mut foreground = learnt.clone();
            let start = Instant::now();
            for (k, pixels) in moving.iter().enumerate() {
                foreground.update(&view(pixels)).expect("sizes agree");
                finder.find(&foreground, &BlobLimits::default(), &[], &mut blobs).expect("limits in range");
                assert_eq!(blobs.len(), 2, "picture {k}");
                let [x, y] = discs(k)[0];
                errors.push((blobs[0].centroid.x - x).hypot(blobs[0].centroid.y - y));
            }
            start.elapsed().as_secs_f64() * 1e3 / N_PICTURES as f64
        })
        .collect();
    times.sort_by(f64::total_cmp);
    println!("640x480 foreground and blobs: median {:.3} ms, least {:.3} ms", times[ROUNDS / 2], times[0]);
    errors.sort_by(f64::total_cmp);
    println!("centroid: median error {:.3} px, largest {:.3} px", errors[errors.len() / 2], errors[errors.len() - 1]);
}
