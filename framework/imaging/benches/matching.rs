//! Least squares matching beside what OpenCV and NumPy need (docs/surfaces.md): time, bias, noise and false matches of one affine match, growth with patch and views; on surfaces that are
//! rendered at their own places in both pictures, disks and knitted wool, and on a photograph.
//!
//! `cargo bench -p foveate-imaging --bench matching [-- PHOTO.pgm]`: the photograph of the peers' script is `skimage.data.camera()` of scikit-image, 512 × 512 px, saved as a binary PGM file.
//! Its second picture is taken between its pixels by a windowed sinc, which shares nothing with the splines here. Times are of the processor, not of the clock, for the machine may be shared.

use std::hint::black_box;
use std::time::Instant;

use foveate_imaging::ImageView;
use foveate_imaging::matching::{
    Match, MatchBuffers, MatchOptions, Place, Refused, SplineImage, Template, Warp, match_in_space, match_template,
};
use foveate_laws::texture::{Chance, Knitted, Texture, picture};

const SIZE: usize = 512;
/// Every so many pixels lies a patch: its share of the prefilter is that square.
const GRID: usize = 7;
/// Processor time of a measurement [s].
const LONG_ENOUGH_S: f64 = 0.4;

/// As in peers' scripts: about the middle, and off by parts of a pixel.
fn truth(x: f64, y: f64) -> [f64; 2] {
    let (u, v) = (x - 256.0, y - 256.0);
    [256.63 + 1.01 * u + 0.02 * v, 255.59 - 0.015 * u + 0.99 * v]
}

struct Pair {
    search: Vec<u8>,
    from: Vec<u8>,
}

fn view(pixels: &[u8]) -> ImageView<'_> {
    ImageView::new(pixels, SIZE, SIZE).expect("a square")
}

/// What both pictures of a pair show.
enum Surface {
    Disks(Texture),
    Wool(Knitted),
    /// Rows of [`SIZE`] levels.
    Photo(Vec<u8>),
}

/// Half the width of the windowed sinc that a photograph is taken by [px].
const SINC_PX: i64 = 8;

impl Surface {
    /// The level at (x, y) of the first picture, or of the second, whose pixels show `truth`.
    fn level(&self, is_second: bool, x: f64, y: f64) -> f64 {
        let at = if is_second { truth(x, y) } else { [x, y] };
        match self {
            Surface::Disks(texture) => texture.at(at[0], at[1]),
            Surface::Wool(wool) if is_second => wool.seen(at, [1.01, -0.015], [0.02, 0.99]),
            Surface::Wool(wool) => wool.seen(at, [1.0, 0.0], [0.0, 1.0]),
            Surface::Photo(pixels) => {
                let pi = std::f64::consts::PI;
                let sinc = |it: f64| if it == 0.0 { 1.0 } else { (pi * it).sin() / (pi * it) };
                let weight = |off: f64| {
                    let width = SINC_PX as f64;
                    if off.abs() < width { sinc(off) * sinc(off / width) } else { 0.0 }
                };
                let whole = at.map(|it| it.floor() as i64);
                let taps = |axis: usize| {
                    let from = whole[axis] - SINC_PX + 1;
                    (from..from + 2 * SINC_PX).map(move |it| (it, weight(at[axis] - it as f64)))
                };
                let (mut sum, mut weights) = (0.0, 0.0);
                for (row, down) in taps(1) {
                    for (column, across) in taps(0) {
                        let [column, row] = [column, row].map(|it| it.clamp(0, SIZE as i64 - 1) as usize);
                        sum += across * down * f64::from(pixels[row * SIZE + column]);
                        weights += across * down;
                    }
                }
                sum / weights
            }
        }
    }

    fn pair(&self, seed: u64, noise: f64) -> Pair {
        let of = |is_second: bool, seed: u64| picture(SIZE, noise, seed, |x, y| self.level(is_second, x, y));
        Pair { search: of(false, 2 * seed), from: of(true, 2 * seed + 1) }
    }
}

/// The pixels of a binary PGM file of [`SIZE`] × [`SIZE`] px.
fn read_pgm(path: &str) -> Vec<u8> {
    let bytes = std::fs::read(path).expect("the photograph can be read");
    let header = format!("P5\n{SIZE} {SIZE}\n255\n");
    let pixels = bytes.strip_prefix(header.as_bytes()).expect("a binary PGM file of 512 x 512 px, without comments");
    pixels.to_vec()
}

impl Pair {
    fn of(seed: u64, noise: f64) -> Pair {
        Surface::Disks(Texture(seed)).pair(seed, noise)
    }
}

fn places() -> Vec<[f64; 2]> {
    let along = || (50..SIZE - 50).step_by(GRID);
    along().flat_map(|y| along().map(move |x| [x as f64, y as f64])).collect()
}

/// The 60 best corners of a picture, 8 px apart: patches as the peers' script takes them.
fn corners(from: &SplineImage, places: &[[f64; 2]], options: &MatchOptions) -> Vec<[f64; 2]> {
    let mut template = Template::default();
    let mut strong: Vec<(f64, [f64; 2])> = places
        .iter()
        .filter_map(|it| template.take(from, *it, 6, options).ok().map(|()| (template.bound().trace(), *it)))
        .collect();
    strong.sort_by(|a, b| a.0.total_cmp(&b.0));
    strong.into_iter().take(60).map(|it| it.1).collect()
}

fn starts(places: &[[f64; 2]]) -> Vec<Warp> {
    let mut chance = Chance::of([1, 2, 3, 4]);
    places.iter().map(|it| Warp::shift(truth(it[0], it[1]).map(|at| at + 1.4 * (chance.uniform() - 0.5)))).collect()
}

/// All matches of one pair: each with its place in the list.
fn matches(
    [search, from]: [&SplineImage; 2],
    places: &[[f64; 2]],
    starts: &[Warp],
    reach: usize,
    options: &MatchOptions,
) -> Vec<(usize, Result<Match, Refused>)> {
    let (mut template, mut buffers) = (Template::default(), MatchBuffers::default());
    let mut one = |at: [f64; 2], start: &Warp| {
        template.take(from, at, reach, options)?;
        match_template(&template, search, start, options, &mut buffers)
    };
    places.iter().zip(starts).enumerate().map(|(i, (at, start))| (i, one(*at, start))).collect()
}

/// Seconds that this thread has had of a processor, where the system says it (Linux); else those that have passed.
fn processor_seconds(since: Instant) -> f64 {
    let said = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let on_processor = said.and_then(|it| it.split_whitespace().next()?.parse::<f64>().ok());
    on_processor.map_or_else(|| since.elapsed().as_secs_f64(), |it| it * 1e-9)
}

/// Of one run, mean over many: what a thread has had is counted in ticks of milliseconds.
fn mean_seconds(mut run: impl FnMut()) -> f64 {
    let since = Instant::now();
    let mut n = 0;
    let start = processor_seconds(since);
    loop {
        run();
        n += 1;
        let spent = processor_seconds(since) - start;
        if spent > LONG_ENOUGH_S {
            return spent / f64::from(n);
        }
    }
}

fn percentile(sorted: &[f64], part: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * part) as usize]
}

/// Time of a match by the side of the patch, and of one match in several pictures by their number.
fn times(name: &str, pair: &Pair, places: &[[f64; 2]], starts: &[Warp], options: &MatchOptions) {
    println!("{name}: one affine match, prefilter of both pictures shared by patches every {GRID} px");
    let mut splines = [SplineImage::default(), SplineImage::default()];
    let prefilter = mean_seconds(|| splines[0].build(&view(black_box(&pair.search))));
    splines[1].build(&view(&pair.from));
    let per_px = prefilter / (SIZE * SIZE) as f64;
    let share = 2.0 * per_px * (GRID * GRID) as f64;
    println!("  prefilter {:.2} ns a pixel, {:.2} us a match", per_px * 1e9, share * 1e6);
    for reach in [3, 6, 10, 15, 20] {
        let both = [&splines[0], &splines[1]];
        let seconds = mean_seconds(|| {
            black_box(matches(both, places, starts, reach, options));
        });
        let found = matches(both, places, starts, reach, options);
        let steps: u32 = found.iter().filter_map(|it| Some(it.1.as_ref().ok()?.steps)).sum();
        let n = found.iter().filter(|it| it.1.is_ok()).count();
        let each = seconds / places.len() as f64 + share;
        let side = 2 * reach + 1;
        println!(
            "  {side}x{side}: {:.1} us, {:.1} steps, {:.0} a second, {n} of {} found",
            each * 1e6,
            f64::from(steps) / n as f64,
            1.0 / each,
            places.len()
        );
    }
    // The other picture, seen by several views along lines of different directions.
    let (mut template, mut buffers) = (Template::default(), MatchBuffers::default());
    for n_views in [1, 2, 4, 8] {
        let pictures = vec![&splines[0]; n_views];
        let bends = vec![[[1.01, 0.02], [-0.015, 0.99]]; n_views];
        let mut n_found = 0;
        let seconds = mean_seconds(|| {
            n_found = 0;
            for at in places {
                let place = |view: usize, depth: f64| {
                    let (sine, cosine) = (view as f64 * 0.7).sin_cos();
                    let [x, y] = truth(at[0], at[1]);
                    Some(Place { at: [x + depth * cosine, y + depth * sine], by_depth: [cosine, sine] })
                };
                let taken = template.take(&splines[1], *at, 6, options);
                let found = taken
                    .and_then(|()| match_in_space(&template, &pictures, &bends, 0.5, options, place, &mut buffers));
                n_found += usize::from(found.is_ok());
            }
        });
        let each = (seconds / places.len() as f64 + share / 2.0 * (1 + n_views) as f64) * 1e6;
        println!("  13x13, a point in space, {n_views} other views: {each:.1} us, {n_found} of {} found", places.len());
    }
}

/// Errors of 13 × 13 over pairs of pictures.
fn errors(what: &str, pairs: &[Pair], noise: f64, only_corners: bool, options: &MatchOptions) {
    let (mut biases, mut lines): (Vec<f64>, Vec<(f64, f64)>) = (Vec::new(), Vec::new());
    for pair in pairs {
        let splines = [SplineImage::of(&view(&pair.search)), SplineImage::of(&view(&pair.from))];
        let places = if only_corners { corners(&splines[1], &places(), options) } else { places() };
        let starts = self::starts(&places);
        let mut errors = Vec::new();
        let mut bounds = Vec::new();
        let mut template = Template::default();
        for (i, found) in matches([&splines[0], &splines[1]], &places, &starts, 6, options) {
            let Ok(found) = found else { continue };
            let expected = truth(places[i][0], places[i][1]);
            errors.push([0, 1].map(|it| found.warp.at[it] - expected[it]));
            template.take(&splines[1], places[i], 6, options).expect("was matched");
            bounds.push(template.bound().trace() / 2.0 * 2.0 * noise * noise);
        }
        let n = errors.len() as f64;
        let mean = [0, 1].map(|it| errors.iter().map(|error| error[it]).sum::<f64>() / n);
        biases.push(mean[0].abs().max(mean[1].abs()));
        let squares: f64 = errors.iter().map(|it| it[0] * it[0] + it[1] * it[1]).sum();
        lines.push(((squares / (2.0 * n)).sqrt(), (bounds.iter().sum::<f64>() / n).sqrt()));
    }
    biases.sort_by(f64::total_cmp);
    lines.sort_by(|a, b| a.0.total_cmp(&b.0));
    let (median, worst) = (lines[lines.len() / 2], lines[lines.len() - 1]);
    println!(
        "  {what}, noise {noise}: bias median {:.4}, worst {:.4}; rms median {:.4} (bound {:.4}), worst {:.4} (bound {:.4})",
        biases[biases.len() / 2],
        biases[biases.len() - 1],
        median.0,
        median.1,
        worst.0,
        worst.1
    );
}

/// Patches of one surface searched on another one: everything that is accepted is wrong.
fn false_matches(name: &str, of: impl Fn(u64) -> Surface, places: &[[f64; 2]], options: MatchOptions) {
    println!("{name}: patches of one surface searched on another one, noise 2");
    for (reach, least) in [(6, 0.8), (6, 0.85), (6, 0.9), (6, 0.95), (10, 0.8), (10, 0.9)] {
        let options = MatchOptions { min_correlation: least, ..options };
        let (mut wrong, mut tries, mut correlations) = (0, 0, Vec::new());
        for seed in 1..=8 {
            let search = SplineImage::of(&view(&of(seed).pair(seed, 2.0).search));
            let from = SplineImage::of(&view(&of(seed + 100).pair(seed + 100, 2.0).search));
            let starts: Vec<Warp> = places.iter().map(|it| Warp::shift(*it)).collect();
            for (_, found) in matches([&search, &from], places, &starts, reach, &options) {
                match found {
                    Err(Refused::NoTexture) => continue,
                    Ok(found) => {
                        wrong += 1;
                        correlations.push(found.correlation);
                    }
                    Err(_) => {}
                }
                tries += 1;
            }
        }
        correlations.sort_by(f64::total_cmp);
        let most = if correlations.is_empty() { 0.0 } else { percentile(&correlations, 1.0) };
        let side = 2 * reach + 1;
        println!("  {side}x{side}, min_correlation {least}: {wrong} of {tries} accepted, best correlation {most:.3}");
    }
}

fn main() {
    let options = MatchOptions::default();
    let places = places();
    let starts = starts(&places);
    let photo = std::env::args().skip(1).find(|it| it.ends_with(".pgm")).map(|it| Surface::Photo(read_pgm(&it)));

    times("disks", &Pair::of(1, 2.0), &places, &starts, &options);
    times("wool", &Surface::Wool(Knitted(1)).pair(1, 2.0), &places, &starts, &options);
    if let Some(photo) = &photo {
        times("photograph", &photo.pair(1, 2.0), &places, &starts, &options);
    }

    println!("errors of 13x13 [px]: largest mean along an axis, rms along an axis, beside the Cramer-Rao bound");
    for noise in [0.0, 2.0] {
        let disks: Vec<Pair> = (1..=8).map(|seed| Pair::of(seed, noise)).collect();
        errors("disks, 8 surfaces, all places with texture", &disks, noise, false, &options);
        errors("disks, the 60 best corners of each", &disks, noise, true, &options);
        let wool: Vec<Pair> = (1..=8).map(|seed| Surface::Wool(Knitted(seed)).pair(seed, noise)).collect();
        errors("wool, 8 surfaces, all places", &wool, noise, false, &options);
        if let Some(photo) = &photo {
            // Other noise each time.
            let photos: Vec<Pair> = (1..=if noise > 0.0 { 4 } else { 1 }).map(|it| photo.pair(it, noise)).collect();
            errors("photograph, all places with texture", &photos, noise, false, &options);
            errors("photograph, its 60 best corners", &photos, noise, true, &options);
        }
    }
    false_matches("disks", |seed| Surface::Disks(Texture(seed)), &places, options);
    false_matches("wool", |seed| Surface::Wool(Knitted(seed)), &places, options);
}
