//! Pictures of a set that creeps ([`drift`](super::drift)), brought to where the first of them saw the scene.
//!
//! What a camera that turns or moves a little sees moves as a whole, the stripes on it too. Each picture is taken from where the scene lies in it, by cubic interpolation of four pixels along rows and columns
//! (Catmull and Rom), in proportion to its place in the set. What is left of the creep is measured in the pictures that come of this, and taken off as well.
//!
//! Source: E. Catmull, R. Rom, "A class of local interpolating splines", Computer Aided Geometric Design, 1974.

use nalgebra::Vector2;

use super::Coordinates;
use super::code::StripeCode;
use super::drift::{Drift, Sums, widen};
use crate::ImageView;

/// Times that what is left is measured and taken off.
const TURNS: usize = 3;
/// What is left does not matter below this [px].
const NOTHING: f64 = 0.01;
/// What is not known of a creep for all that, of all of the way: rendered sets that crept by 0.3 to 1.9 px were off by up to 0.03 of it, one whose steps were uneven by 0.06 [–].
const UNKNOWN: f64 = 0.03;

/// A set that creeps no more.
#[derive(Debug, Clone, PartialEq)]
pub struct Steadied {
    /// All pictures, as the camera would have seen them where it stood in the first of the set.
    pub pictures: Vec<Vec<u8>>,
    /// By how much the scene crept from the first picture to the last [px].
    pub by: Vector2<f64>,
    /// What is not known of the place of a picture along rows and columns: how sums scatter about the creep, what is left of it, and a part of all of it, standard deviation [px].
    pub sigma: Vector2<f64>,
}

impl Steadied {
    /// Of a set that creeps by `drift`; `None` where what is left after it cannot be measured.
    pub fn of(code: &StripeCode, pictures: &[ImageView<'_>], drift: &Drift, min_contrast: u8) -> Option<Steadied> {
        let size = pictures.first()?.size();
        let mut by = drift.by;
        let mut steady = all_moved(pictures, drift, by);
        for turn in 0..TURNS {
            let views: Vec<ImageView<'_>> =
                steady.iter().map(|it| ImageView::new(it, size.0, size.1)).collect::<Result<_, _>>().ok()?;
            let left = Sums::of(code, &views)?.creep(&views, min_contrast)?;
            if left.by.norm() < NOTHING || turn + 1 == TURNS {
                // Half of what is left lies between a set's middle and its ends.
                let known = left.by.map(|it| (it / 2.0).hypot(left.scatter / 2_f64.sqrt()));
                let sigma = known.zip_map(&by, |known, by| known.hypot(UNKNOWN * by));
                return Some(Steadied { pictures: steady, by, sigma });
            }
            by += left.by;
            steady = all_moved(pictures, drift, by);
        }
        None
    }

    /// Makes coordinates as vague as the places of pictures are, and leaves out what the camera did not see in all of them.
    pub fn widen(&self, coordinates: &mut Coordinates) {
        widen(coordinates, self.sigma);
        let [width, height] = coordinates.size;
        let [left, right] = ends(self.by.x);
        let [above, below] = ends(self.by.y);
        let is_seen = |at: usize| {
            let (x, y) = (at % width, at / width);
            x >= left && x + right < width && y >= above && y + below < height
        };
        for (values, sigmas) in coordinates.values.iter_mut().zip(&mut coordinates.sigmas) {
            for (at, value) in values.iter_mut().enumerate().filter(|it| !is_seen(it.0)) {
                *value = f32::NAN;
                sigmas[at] = f32::NAN;
            }
        }
    }
}

/// Pixels at both ends of rows or columns that some picture did not see where all lies elsewhere by up to `by` [px].
fn ends(by: f64) -> [usize; 2] {
    [-by, by].map(|it| it.max(0.0).ceil() as usize)
}

/// All pictures with what they saw where the first of the set saw it, the scene having moved by `by` from the first to the last.
fn all_moved(pictures: &[ImageView<'_>], drift: &Drift, by: Vector2<f64>) -> Vec<Vec<u8>> {
    let range = (drift.first - drift.last).max(1) as f64;
    let places = (0..pictures.len()).map(|it| by * ((it as f64 - drift.last as f64) / range));
    pictures.iter().zip(places).map(|(picture, by)| moved(picture, by)).collect()
}

/// Weights of four pixels for a place `part` of a pixel after the second.
fn weights(part: f32) -> [f32; 4] {
    let (a, b, c) = (part, part * part, part * part * part);
    [0.5 * (2.0 * b - a - c), 0.5 * (2.0 - 5.0 * b + 3.0 * c), 0.5 * (a + 4.0 * b - 3.0 * c), 0.5 * (c - b)]
}

/// A picture with what lies `by` further on in it; its edge goes on beyond it [px].
fn moved(picture: &ImageView<'_>, by: Vector2<f64>) -> Vec<u8> {
    let (width, height) = picture.size();
    let whole = by.map(f64::floor);
    let along = weights((by.x - whole.x) as f32);
    let down = weights((by.y - whole.y) as f32);
    let place = |at: usize, whole: f64, tap: usize, n: usize| {
        (at as isize + whole as isize + tap as isize - 1).clamp(0, n as isize - 1) as usize
    };
    let mut column = vec![0.0_f32; width];
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        column.fill(0.0);
        for (tap, weight) in down.iter().enumerate() {
            let row = picture.row(place(y, whole.y, tap, height));
            column.iter_mut().zip(row).for_each(|(to, it)| *to += weight * f32::from(*it));
        }
        for x in 0..width {
            let level: f32 = (0..4).map(|tap| along[tap] * column[place(x, whole.x, tap, width)]).sum();
            pixels.push(level.round().clamp(0.0, 255.0) as u8);
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::super::code::Axis;
    use super::super::drift::drift;
    use super::super::edges::{EdgeOptions, coordinates};
    use super::super::gray::{DecodeOptions, decode};
    use super::super::scene::{Scene, wall};
    use super::*;

    const SIZE: [usize; 2] = [160, 120];

    fn views(pictures: &[Vec<u8>]) -> Vec<ImageView<'_>> {
        pictures.iter().map(|it| ImageView::new(it, SIZE[0], SIZE[1]).unwrap()).collect()
    }

    #[test]
    fn a_picture_is_taken_from_where_the_scene_lies_in_it() {
        let level = |x: f64, y: f64| 120.0 + 60.0 * (x / 9.0).sin() + 40.0 * (y / 7.0).cos();
        let of = |dx: f64, dy: f64| -> Vec<u8> {
            let at = |it: usize| level((it % SIZE[0]) as f64 - dx, (it / SIZE[0]) as f64 - dy);
            (0..SIZE[0] * SIZE[1]).map(|it| at(it).round() as u8).collect()
        };
        let still = of(0.0, 0.0);
        for (dx, dy) in [(0.3, 0.0), (0.0, -0.7), (-1.4, 0.6), (2.0, -3.0)] {
            let seen = of(dx, dy);
            let back = moved(&ImageView::new(&seen, SIZE[0], SIZE[1]).unwrap(), Vector2::new(dx, dy));
            let is_inside =
                |it: &usize| (6..SIZE[0] - 6).contains(&(it % SIZE[0])) && (6..114).contains(&(it / SIZE[0]));
            let worst = (0..still.len()).filter(is_inside).map(|it| still[it].abs_diff(back[it])).max().unwrap();
            assert!(worst <= 2, "({dx}, {dy}): {worst} gray levels");
        }
    }

    /// The wall's set, seen by a camera that creeps along rows by a twentieth of a pixel from each fifth of a station to the next: nine stations in all.
    fn crept(code: &StripeCode, seed: u64) -> Vec<Vec<u8>> {
        fn at<const STATION: usize>(code: &StripeCode, seed: u64) -> Vec<Vec<u8>> {
            fn by<const STATION: usize>(x: f64) -> f64 {
                x - STATION as f64 * 0.15
            }
            Scene {
                projector: |x, y| (wall(1).projector)(by::<STATION>(x), y),
                albedo: |x, y| (wall(1).albedo)(by::<STATION>(x), y),
                shadow: |x, y| (wall(1).shadow)(by::<STATION>(x), y),
                ..wall(seed)
            }
            .pictures(code)
        }
        let stations = [at::<0>, at::<1>, at::<2>, at::<3>, at::<4>, at::<5>, at::<6>, at::<7>, at::<8>];
        let stations: Vec<Vec<Vec<u8>>> = stations.iter().map(|it| it(code, seed)).collect();
        let n = stations[0].len();
        (0..n).map(|it| stations[(it * 8 + (n - 1) / 2) / (n - 1)][it].clone()).collect()
    }

    /// Of the columns of a set on the wall as its first picture saw it: median of what they are off, root mean square of that over what they state, how many there are.
    fn judged(code: &StripeCode, pictures: &[Vec<u8>], settle: &dyn Fn(&mut Coordinates)) -> (f64, f64, usize) {
        let views = views(pictures);
        let decoded = decode(code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
        let mut found = coordinates(code, &views, &decoded, &EdgeOptions::default()).unwrap();
        settle(&mut found);
        let errors = found.values[0].iter().zip(&found.sigmas[0]).enumerate().filter_map(|(at, (value, sigma))| {
            let (x, y) = ((at % SIZE[0]) as f64, (at / SIZE[0]) as f64);
            let off = f64::from(*value) - (wall(1).projector)(x, y)[0];
            (off.is_finite() && !(82.0..94.0).contains(&x)).then_some((off.abs(), off / f64::from(*sigma)))
        });
        let errors: Vec<(f64, f64)> = errors.collect();
        let mut off: Vec<f64> = errors.iter().map(|it| it.0).collect();
        off.sort_by(f64::total_cmp);
        let n = errors.len();
        (off[n / 2], (errors.iter().map(|it| it.1 * it.1).sum::<f64>() / n as f64).sqrt(), n)
    }

    #[test]
    fn places_of_a_set_that_creeps_are_those_of_its_first_picture() {
        let code = StripeCode::gray([160, 120]);
        for seed in 31..=33 {
            let pictures = crept(&code, seed);
            let drift = drift(&code, &views(&pictures), 12).unwrap();
            assert!(drift.creeps, "seed {seed}: {drift:?}");
            let steadied = Steadied::of(&code, &views(&pictures), &drift, 12).unwrap();
            assert!((steadied.by - Vector2::new(1.2, 0.0)).norm() < 0.12, "seed {seed}: {}", steadied.by);
            let before = judged(&code, &pictures, &|_| {});
            let after = judged(&code, &steadied.pictures, &|it| steadied.widen(it));
            assert!(after.0 < 0.25 * before.0, "seed {seed}: {before:?}, then {after:?}");
            assert!((0.2..1.5).contains(&after.1), "seed {seed}: {after:?}");
            assert!(after.2 > 14_000, "seed {seed}: {after:?}");
        }
    }

    #[test]
    fn what_some_picture_did_not_see_is_left_out() {
        let of = |by: Vector2<f64>| {
            let mut coordinates = Coordinates {
                size: SIZE,
                values: [vec![1.0; SIZE[0] * SIZE[1]], vec![1.0; SIZE[0] * SIZE[1]]],
                sigmas: [vec![0.1; SIZE[0] * SIZE[1]], vec![0.1; SIZE[0] * SIZE[1]]],
                ..Coordinates::default()
            };
            Steadied { pictures: Vec::new(), by, sigma: Vector2::zeros() }.widen(&mut coordinates);
            let known = |x: usize, y: usize| coordinates.values.iter().all(|it| it[y * SIZE[0] + x].is_finite());
            [known(0, 60), known(159, 60), known(80, 0), known(80, 119), known(2, 2), known(157, 117)]
        };
        assert_eq!(of(Vector2::new(1.2, 0.0)), [true, false, true, true, true, true]);
        assert_eq!(of(Vector2::new(-0.4, -1.7)), [false, true, false, true, true, true]);
    }
}
