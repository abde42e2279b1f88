//! Least squares matching against surfaces that were rendered at the places of each picture.

use foveate_laws::texture::{Chance, Texture};

use super::*;
use crate::ImageView;

/// The affine map of the peers' script: about the middle, and off by parts of a pixel.
const MATRIX: [[f64; 2]; 2] = [[1.01, 0.02], [-0.015, 0.99]];
const SIZE: usize = 200;
const REACH: usize = 6;

/// Where in the search picture pixel (x, y) of the template's picture lies.
fn truth(x: f64, y: f64) -> [f64; 2] {
    let (u, v) = (x - 100.0, y - 100.0);
    let [[a, b], [c, d]] = MATRIX;
    [100.63 + a * u + b * v, 99.59 + c * u + d * v]
}

fn spline(pixels: &[u8]) -> SplineImage {
    SplineImage::of(&ImageView::new(pixels, SIZE, SIZE).unwrap())
}

/// Errors of all matches, with what each said of itself; and the reasons of the others.
struct Tried {
    errors: Vec<[f64; 2]>,
    found: Vec<Match>,
    bounds: Vec<f64>,
    refused: Vec<Refused>,
}

/// Matches patches everywhere from starts up to 0.7 px off, with noise in both pictures.
fn tried(seed: u64, noise: f64, reach: usize, options: &MatchOptions) -> Tried {
    let texture = Texture(seed);
    let search = spline(&texture.picture(SIZE, noise, 2 * seed, |x, y| [x, y]));
    let from = spline(&texture.picture(SIZE, noise, 2 * seed + 1, truth));
    let mut tried = Tried { errors: Vec::new(), found: Vec::new(), bounds: Vec::new(), refused: Vec::new() };
    let (mut template, mut buffers) = (Template::default(), MatchBuffers::default());
    let mut chance = Chance::of([seed, 1, 2, 3]);
    for y in (30..=170).step_by(7) {
        for x in (30..=170).step_by(7) {
            let expected = truth(x as f64, y as f64);
            let start = Warp::shift(expected.map(|it| it + 1.4 * (chance.uniform() - 0.5)));
            let found = template
                .take(&from, [x as f64, y as f64], reach, options)
                .and_then(|()| match_template(&template, &search, &start, options, &mut buffers));
            match found {
                Ok(found) => {
                    tried.errors.push([0, 1].map(|it| found.warp.at[it] - expected[it]));
                    // Both pictures have the noise.
                    tried.bounds.push((template.bound().trace() / 2.0).sqrt() * noise * 2f64.sqrt());
                    tried.found.push(found);
                }
                Err(reason) => tried.refused.push(reason),
            }
        }
    }
    tried
}

fn rms(errors: &[[f64; 2]]) -> f64 {
    (errors.iter().map(|it| it[0] * it[0] + it[1] * it[1]).sum::<f64>() / (2.0 * errors.len() as f64)).sqrt()
}

fn bias(errors: &[[f64; 2]]) -> f64 {
    let mean = [0, 1].map(|it| errors.iter().map(|error| error[it]).sum::<f64>() / errors.len() as f64);
    mean[0].hypot(mean[1])
}

#[test]
fn without_noise_a_place_is_known_to_thousandths_of_a_pixel() {
    for seed in [1, 2, 3] {
        let Tried { errors, refused, .. } = tried(seed, 0.0, REACH, &MatchOptions::default());
        assert!(errors.len() > 420, "{} of 441 found, {refused:?}", errors.len());
        assert!(bias(&errors) < 0.002, "bias {}", bias(&errors));
        // Rounding to whole levels is noise of 0.29 levels in either picture; and edges are as sharp as a spline can hardly follow.
        assert!(rms(&errors) < 0.01, "rms {}", rms(&errors));
    }
}

#[test]
fn with_noise_the_error_is_near_what_theory_allows_and_what_the_match_says() {
    for seed in [4, 5] {
        let Tried { errors, found, bounds, .. } = tried(seed, 2.0, REACH, &MatchOptions::default());
        assert!(errors.len() > 400, "{} found", errors.len());
        let relative = |scale: &dyn Fn(usize) -> f64| {
            let squares = errors.iter().enumerate().map(|(i, it)| (it[0] * it[0] + it[1] * it[1]) / scale(i).powi(2));
            (squares.sum::<f64>() / (2.0 * errors.len() as f64)).sqrt()
        };
        let over_bound = relative(&|i| bounds[i]);
        // The bound takes the template's derivatives for exact; where texture is faint they are not.
        assert!((0.85..1.4).contains(&over_bound), "{over_bound} times the bound");
        let over_said = relative(&|i| (found[i].covariance.trace() / 2.0).sqrt());
        assert!((0.85..1.4).contains(&over_said), "{over_said} times what was said");
        let by_chance = 3.0 * rms(&errors) / (errors.len() as f64).sqrt();
        assert!(bias(&errors) < 0.002 + by_chance, "bias {}, by chance {by_chance}", bias(&errors));
        // The bending too: 1 % and 2 % of the truth.
        let mean = |row: usize, column: usize| {
            found.iter().map(|it| it.warp.matrix[row][column]).sum::<f64>() / found.len() as f64
        };
        for (row, line) in MATRIX.iter().enumerate() {
            for (column, expected) in line.iter().enumerate() {
                assert!((mean(row, column) - expected).abs() < 0.002, "({row}, {column}): {}", mean(row, column));
            }
        }
    }
}

#[test]
fn larger_patches_are_better_and_gain_and_offset_do_not_matter() {
    let [small, large] = [3, 12].map(|reach| rms(&tried(6, 2.0, reach, &MatchOptions::default()).errors));
    assert!(large < 0.4 * small, "{small} {large}");
    let texture = Texture(7);
    let [plain, dim] = [(1.0, 0.0), (0.6, 40.0)].map(|(gain, offset)| {
        let pixels = texture.picture(SIZE, 0.0, 1, |x, y| [x, y]);
        spline(&pixels.iter().map(|it| (f64::from(*it) * gain + offset).round() as u8).collect::<Vec<_>>())
    });
    let from = spline(&texture.picture(SIZE, 0.0, 2, truth));
    let (mut template, mut buffers, options) = (Template::default(), MatchBuffers::default(), MatchOptions::default());
    template.take(&from, [90.0, 80.0], 8, &options).unwrap();
    let start = Warp::shift([91.0, 80.0]);
    let [plain, dim] = [&plain, &dim].map(|it| match_template(&template, it, &start, &options, &mut buffers).unwrap());
    assert!((dim.gain / plain.gain - 0.6).abs() < 0.01, "{}", dim.gain);
    assert!((0..2).all(|it| (dim.warp.at[it] - plain.warp.at[it]).abs() < 0.01));
}

#[test]
fn a_wrong_place_is_not_taken_for_a_match() {
    // Patches of one surface, held against another one: everything that is accepted is wrong.
    let options = MatchOptions::default();
    let (mut wrong, mut tries) = (0, 0);
    for seed in 10..13 {
        let search = spline(&Texture(seed).picture(SIZE, 2.0, 1, |x, y| [x, y]));
        let from = spline(&Texture(seed + 50).picture(SIZE, 2.0, 2, |x, y| [x, y]));
        let (mut template, mut buffers) = (Template::default(), MatchBuffers::default());
        for y in (20..=180).step_by(5) {
            for x in (20..=180).step_by(5) {
                let at = [x as f64, y as f64];
                if template.take(&from, at, REACH, &options).is_err() {
                    continue;
                }
                tries += 1;
                wrong +=
                    usize::from(match_template(&template, &search, &Warp::shift(at), &options, &mut buffers).is_ok());
            }
        }
    }
    assert!(tries > 2500 && wrong <= 1, "{wrong} of {tries}");
}

#[test]
fn what_cannot_be_matched_says_why() {
    let options = MatchOptions::default();
    let (mut template, mut buffers) = (Template::default(), MatchBuffers::default());
    let flat = spline(&[90; SIZE * SIZE]);
    assert_eq!(template.take(&flat, [50.0, 50.0], REACH, &options), Err(Refused::NoTexture));
    // One straight edge fixes nothing along itself.
    let edge: Vec<u8> = (0..SIZE * SIZE).map(|i| if i % SIZE < 50 { 30 } else { 200 }).collect();
    assert_eq!(template.take(&spline(&edge), [50.0, 50.0], REACH, &options), Err(Refused::NoTexture));
    let texture = spline(&Texture(20).picture(SIZE, 0.0, 1, |x, y| [x, y]));
    assert_eq!(template.take(&texture, [6.0, 50.0], REACH, &options), Err(Refused::Outside));
    template.take(&texture, [60.0, 60.0], REACH, &options).unwrap();
    let mut at = |picture: &SplineImage, start: Warp, options: &MatchOptions| {
        match_template(&template, picture, &start, options, &mut buffers).map(|it| it.warp.at)
    };
    assert!(at(&texture, Warp::shift([60.4, 59.7]), &options).is_ok());
    assert_eq!(at(&texture, Warp::shift([195.0, 60.0]), &options), Err(Refused::Outside));
    assert_eq!(at(&flat, Warp::shift([60.0, 60.0]), &options), Err(Refused::Radiometry));
    let inverted: Vec<u8> = Texture(20).picture(SIZE, 0.0, 1, |x, y| [x, y]).iter().map(|it| 255 - it).collect();
    assert_eq!(at(&spline(&inverted), Warp::shift([60.0, 60.0]), &options), Err(Refused::Radiometry));
    let squeezed = spline(&Texture(20).picture(SIZE, 0.0, 1, |x, y| [60.0 + 2.6 * (x - 60.0), y]));
    let narrow = Warp { at: [60.0, 60.0], matrix: [[1.0 / 2.6, 0.0], [0.0, 1.0]] };
    assert_eq!(at(&squeezed, narrow, &options), Err(Refused::Bent));
    let strict = MatchOptions { max_sigma_px: 1e-4, ..options };
    let noisy = spline(&Texture(20).picture(SIZE, 4.0, 9, |x, y| [x, y]));
    assert_eq!(at(&noisy, Warp::shift([60.0, 60.0]), &strict), Err(Refused::Vague));
    let near = MatchOptions { max_shift_px: 0.2, ..options };
    assert_eq!(at(&texture, Warp::shift([60.6, 60.0]), &near), Err(Refused::Wandered));
    let short = MatchOptions { max_steps: 1, ..options };
    assert_eq!(at(&texture, Warp::shift([60.6, 60.0]), &short), Err(Refused::NoConvergence));
    assert!(MatchOptions { max_stretch: 1.0, ..options }.check().is_err() && options.check().is_ok());
}

#[test]
fn a_translation_alone_is_better_known_where_nothing_bends() {
    let texture = Texture(30);
    let search = spline(&texture.picture(SIZE, 3.0, 1, |x, y| [x, y]));
    let from = spline(&texture.picture(SIZE, 3.0, 2, |x, y| [x + 0.35, y - 0.2]));
    let (mut template, mut buffers) = (Template::default(), MatchBuffers::default());
    let mut rms_of = |freedom: Freedom| {
        let options = MatchOptions { freedom, ..MatchOptions::default() };
        let mut errors = Vec::new();
        for i in 0..200 {
            let at = [30.0 + (i % 20) as f64 * 7.0, 30.0 + (i / 20) as f64 * 14.0];
            let taken = template.take(&from, at, 4, &options);
            let found =
                taken.and_then(|()| match_template(&template, &search, &Warp::shift(at), &options, &mut buffers));
            errors.extend(found.map(|it| [it.warp.at[0] - at[0] - 0.35, it.warp.at[1] - at[1] + 0.2]));
        }
        assert!(errors.len() > 150, "{}", errors.len());
        rms(&errors)
    };
    let (affine, translation) = (rms_of(Freedom::Affine), rms_of(Freedom::Translation));
    assert!(translation < 0.8 * affine, "{translation} {affine}");
}

#[test]
fn a_box_is_searched_for_the_right_place_and_a_repeated_one_is_ambiguous() {
    let texture = Texture(40);
    let picture = |of: &dyn Fn(f64, f64) -> [f64; 2], noise: f64| {
        let mut pyramid = SearchPyramid::default();
        let pixels = texture.picture(SIZE, noise, 3, of);
        pyramid.build(&ImageView::new(&pixels, SIZE, SIZE).unwrap(), 3);
        pyramid
    };
    let from = picture(&|x, y| [x, y], 2.0);
    let to = picture(&|x, y| [x - 31.3, y + 17.6], 2.0); // what was at (x, y) is now at (x + 31.3, y − 17.6)
    let mut buffers = Default::default();
    let start = Warp::shift([80.0, 100.0]);
    let found = to.search_from(&from, [80.0, 100.0], REACH, &start, 40.0, &mut buffers).unwrap();
    assert!((found.warp.at[0] - 111.3).abs() < 1.0 && (found.warp.at[1] - 82.4).abs() < 1.0, "{found:?}");
    assert!(found.correlation > 0.8, "{found:?}");
    // Period 20 px: what is found may be a period off, and says so.
    let repeated = picture(&|x, y| [x.rem_euclid(20.0) + 40.0, y.rem_euclid(20.0) + 40.0], 1.0);
    let ambiguous = repeated.search_from(&repeated, [80.0, 100.0], REACH, &start, 24.0, &mut buffers).unwrap();
    assert!(ambiguous.second > 0.95 * ambiguous.correlation, "{ambiguous:?}");
    assert!(found.second < 0.9 * found.correlation, "{found:?}");
    // Which places look the same, at the border of a picture those that its half shows.
    let mut template = Template::default();
    let mut repeated_around = |of: &SearchPyramid, at: [f64; 2], box_px: usize| {
        template.take(of.finest(), at, REACH, &MatchOptions::default()).unwrap();
        repeats(&template, of.finest(), box_px, 0.9, &mut buffers.1)
    };
    let around = repeated_around(&repeated, [80.0, 100.0], 24);
    let is_period = |it: &[f64; 2]| it.iter().all(|it| it.rem_euclid(20.0).min(20.0 - it.rem_euclid(20.0)) <= 1.0);
    assert!(around.len() == 8 && around.iter().all(is_period), "{around:?}");
    assert_eq!(repeated_around(&repeated, [80.0, 100.0], 16), Vec::<[f64; 2]>::new());
    assert_eq!(repeated_around(&from, [80.0, 100.0], 24), Vec::<[f64; 2]>::new());
    let beside = repeated_around(&repeated, [36.0, 100.0], 40);
    assert!(beside.len() == 8 && beside.iter().all(is_period), "{beside:?}");
    // Patch and box together wider than the largest patch.
    let wide = to.search_from(&from, [100.0, 100.0], 30, &Warp::shift([125.0, 85.0]), 12.0, &mut buffers).unwrap();
    assert!((wide.warp.at[0] - 131.3).abs() < 1.0 && (wide.warp.at[1] - 82.4).abs() < 1.0, "{wide:?}");
    assert!(to.search_from(&from, [80.0, 100.0], REACH, &Warp::shift([2.0, 100.0]), 8.0, &mut buffers).is_none());
}

#[test]
fn one_depth_fits_all_pictures_and_is_better_known_than_from_one() {
    // Three pictures of a plane: depth t moves them along directions of their own.
    let texture = Texture(50);
    let directions = [[4.0, 0.3], [-2.5, 1.5], [0.4, 3.0]];
    let bends = [[[1.0, 0.02], [0.0, 1.0]], [[0.98, 0.0], [0.01, 1.01]], [[1.0, 0.0], [0.03, 0.97]]];
    let depth_at = |x: f64| 0.4 + 0.002 * (x - 100.0);
    let from = spline(&texture.picture(SIZE, 2.0, 60, |x, y| [x, y]));
    let matrix_of = |k: usize| {
        let [[a, b], [c, d]] = bends[k];
        // The depth's slope adds to the bending.
        nalgebra::Matrix2::new(a + 0.002 * directions[k][0], b, c + 0.002 * directions[k][1], d)
    };
    let place_of = |k: usize, u: f64, v: f64| {
        let offset = matrix_of(k) * nalgebra::Vector2::new(u, v);
        [100.0 + 0.4 * directions[k][0] + offset.x, 100.0 + 0.4 * directions[k][1] + offset.y]
    };
    let pictures: Vec<SplineImage> = (0..3)
        .map(|k| {
            let back = matrix_of(k).try_inverse().unwrap();
            let shown = |x: f64, y: f64| {
                let [cx, cy] = place_of(k, 0.0, 0.0);
                let offset = back * nalgebra::Vector2::new(x - cx, y - cy);
                [100.0 + offset.x, 100.0 + offset.y]
            };
            spline(&texture.picture(SIZE, 2.0, 70 + k as u64, shown))
        })
        .collect();
    let options = MatchOptions::default();
    let (mut template, mut buffers) = (Template::default(), MatchBuffers::default());
    let mut errors_of = |which: &[usize]| {
        let views: Vec<&SplineImage> = which.iter().map(|it| &pictures[*it]).collect();
        let starts = vec![[[1.0, 0.0], [0.0, 1.0]]; which.len()];
        let mut errors = Vec::new();
        for i in 0..144 {
            let (x, y) = (45.0 + (i % 12) as f64 * 10.0, 45.0 + (i / 12) as f64 * 10.0);
            if template.take(&from, [x, y], REACH, &options).is_err() {
                continue;
            }
            let expected = depth_at(x);
            let found = match_in_space(
                &template,
                &views,
                &starts,
                expected + 0.12,
                &options,
                |k, depth| {
                    let k = which[k];
                    let [[a, b], [c, d]] = bends[k];
                    let (u, v) = (x - 100.0, y - 100.0);
                    let [dx, dy] = directions[k];
                    let at = [100.0 + a * u + b * v + depth * dx, 100.0 + c * u + d * v + depth * dy];
                    Some(Place { at, by_depth: [dx, dy] })
                },
                &mut buffers,
            );
            if let Ok(found) = found {
                if found.n_pictures() < which.len() {
                    continue;
                }
                errors.push((found.depth - expected, found.variance.sqrt()));
            }
        }
        errors
    };
    let rms = |errors: &[(f64, f64)]| (errors.iter().map(|it| it.0 * it.0).sum::<f64>() / errors.len() as f64).sqrt();
    let (one, three) = (errors_of(&[1]), errors_of(&[0, 1, 2]));
    assert!(one.len() > 120 && three.len() > 110, "{} {}", one.len(), three.len());
    assert!(rms(&three) < 0.75 * rms(&one), "{} {}", rms(&three), rms(&one));
    // The template's own noise is common to all three, which its equations do not know: up to √2 more than they say.
    let relative =
        |it: &[(f64, f64)]| (it.iter().map(|it| (it.0 / it.1).powi(2)).sum::<f64>() / it.len() as f64).sqrt();
    assert!((0.8..1.3).contains(&relative(&one)), "{}", relative(&one));
    assert!((0.8..1.7).contains(&relative(&three)), "{}", relative(&three));
}
