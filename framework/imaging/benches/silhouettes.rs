//! Time of silhouettes: colour pictures of 644 × 486 px, a body of 4 % of the picture with a shadow, noise of 1.5 gray levels.
//!
//! `cargo bench -p foveate-imaging --bench silhouettes`; median and least of 60 rounds over 20 pictures, one thread: in the learnt light, under a lamp that
//! changes all of it, and with the blobs and holes that a silhouette is cleaned by. Peers on as large pictures: `docs/results.md`.

use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_imaging::{BlobFinder, BlobLimits, HoleFiller, Segmenter, SegmenterConfig};

const WIDTH: usize = 644;
const HEIGHT: usize = 486;
const N_PICTURES: usize = 20;
const ROUNDS: usize = 60;

fn picture(room: &[[f64; 3]], at: Option<f64>, light: f64, random: &mut Random) -> Vec<u8> {
    let level = |i: usize| {
        let (x, y) = ((i % WIDTH) as f64, (i / WIDTH) as f64);
        let offset = at.map_or([1e9, 0.0], |at| [(x - at) / 40.0, (y - 250.0) / 100.0]);
        let is_shadow = at.is_some_and(|at| (x - at - 60.0).abs() < 50.0 && (y - 340.0).abs() < 10.0);
        match offset[0].hypot(offset[1]) < 1.0 {
            true => [70.0, 60.0, 50.0],
            false if is_shadow => room[i].map(|it| it * 0.7),
            false => room[i],
        }
    };
    let value = |it: f64, random: &mut Random| (light * it + 1.5 * random.normal()).round().clamp(0.0, 255.0) as u8;
    (0..WIDTH * HEIGHT).flat_map(|i| level(i).map(|it| value(it, random))).collect()
}

fn main() {
    let mut random = Random::new(19);
    let room: Vec<[f64; 3]> = (0..WIDTH * HEIGHT)
        .map(|i| {
            let texture = if (i % WIDTH / 40 + i / WIDTH / 40).is_multiple_of(2) { 1.0 } else { 0.8 };
            [60.0, 150.0, 130.0].map(|it| it * texture)
        })
        .collect();
    let mut learnt = Segmenter::new(SegmenterConfig::default(), WIDTH, HEIGHT).expect("settings in range");
    for _ in 0..30 {
        learnt.teach(&picture(&room, None, 1.0, &mut random)).expect("sizes agree");
    }
    for (name, light) in [("in the learnt light", 1.0), ("at 0.8 of the light", 0.8)] {
        let pictures: Vec<_> =
            (0..N_PICTURES).map(|k| picture(&room, Some(150.0 + 15.0 * k as f64), light, &mut random)).collect();
        let (mut finder, mut filler, mut blobs) = (BlobFinder::default(), HoleFiller::default(), Vec::new());
        let mut times = Vec::new();
        for _ in 0..ROUNDS {
            let mut segmenter = learnt.clone();
            let (mut split, mut clean) = (0.0, 0.0);
            for pixels in &pictures {
                let start = Instant::now();
                segmenter.update(pixels).expect("sizes agree");
                split += start.elapsed().as_secs_f64();
                let start = Instant::now();
                let limits = BlobLimits::default();
                finder.find_in(segmenter.mask(), segmenter.size(), &limits, &[], &mut blobs).expect("limits in range");
                let mut filled = 0;
                blobs.iter().for_each(|it| filler.find(segmenter.mask(), WIDTH, it, 100, |_, _, _| filled += 1));
                clean += start.elapsed().as_secs_f64();
                assert_eq!(blobs.len(), 1);
                assert!((11_500..13_500).contains(&blobs[0].area), "{} px", blobs[0].area);
            }
            times.push([split, clean].map(|it| it * 1e3 / N_PICTURES as f64));
        }
        for (axis, what) in ["split", "blobs and holes"].into_iter().enumerate() {
            times.sort_by(|a, b| a[axis].total_cmp(&b[axis]));
            let [median, least] = [times[ROUNDS / 2][axis], times[0][axis]];
            println!("644x486 {name}, {what}: median {median:.3} ms, least {least:.3} ms");
        }
    }
}
