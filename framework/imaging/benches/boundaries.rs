//! Stripe boundary codes: the time of a picture of 640 × 480 and of 1280 × 1024, from its pixels to boundaries that are known.
//!
//! `cargo bench -p foveate-imaging --bench boundaries`. Stripes are 8 px wide and move by half a pixel a picture.

use std::hint::black_box;
use std::time::Instant;

use foveate_imaging::ImageView;
use foveate_imaging::stripes::boundary::{BoundaryCode, DetectOptions, FRAMES, TrackOptions, Tracker, detect, lines};

const PICTURES: usize = 64;

fn main() {
    for [width, height] in [[640, 480], [1280, 1024]] {
        let pictures: Vec<Vec<u8>> = (0..PICTURES).map(|it| picture(width, height, it)).collect();
        for threads in [1, 2] {
            let detecting = DetectOptions { threads, ..DetectOptions::default() };
            let options = TrackOptions { threads, ..TrackOptions::default() };
            let mut tracker = Tracker::new(height, options).unwrap();
            let (mut times, mut n) = (Vec::new(), 0);
            for (number, pixels) in pictures.iter().enumerate() {
                let view = ImageView::new(pixels, width, height).unwrap();
                let start = Instant::now();
                let edges = detect(black_box(&view), &detecting).unwrap();
                tracker.predict(1, &|_, _| [0.0; 2]);
                let shown = tracker.agreement(&edges).shows(number).picture(number).unwrap_or(number % FRAMES);
                tracker.update(&edges, shown);
                let found = lines(&tracker);
                // The first pictures have nothing to track yet.
                if number >= 8 {
                    times.push(start.elapsed().as_secs_f64() * 1e3);
                    n = found.iter().map(Vec::len).sum::<usize>();
                }
            }
            times.sort_by(f64::total_cmp);
            let [median, worst] = [times[times.len() / 2], times[times.len() - 1]];
            println!(
                "{width} x {height}, {threads} thread(s): {median:.2} ms a picture, worst {worst:.2} ms, {n} boundaries"
            );
        }
    }
}

fn picture(width: usize, height: usize, number: usize) -> Vec<u8> {
    let code = BoundaryCode::get();
    let mut noise = number as u32 + 1;
    let mut pixels = Vec::with_capacity(width * height);
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let light: f64 = (0..4)
            .map(|it| {
                let place = x as f64 + 0.08 * y as f64 + 0.5 * number as f64 + 0.7 * f64::from(it);
                f64::from(u8::from(code.is_lit((place / 8.0) as usize, number % FRAMES)))
            })
            .sum();
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let shade = 30.0 + 4.0 * (x as f64 / 40.0).sin();
        pixels.push(12 + (shade * light) as u8 + (noise >> 30) as u8);
    }
    pixels
}
