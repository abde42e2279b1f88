//! Stabilises the pictures of a set that drifts ([`drift`](super::drift)): all are resampled to the view of the first.
//!
//! What a camera that turns or moves a little sees moves as a whole, the stripes on it too. Each picture is taken from where the scene lies in it, by cubic interpolation of four pixels along rows and columns
//! (Catmull and Rom). What is left of the creep is measured in the pictures that come of this, and taken off as well.
//!
//! Source: E. Catmull, R. Rom, "A class of local interpolating splines", Computer Aided Geometric Design, 1974.

use nalgebra::Vector2;

use super::Coordinates;
use super::code::StripeCode;
use super::drift::{Drift, Pace, Sums, widen};
use super::way::reach;
use crate::ImageView;

/// Times that what is left is measured and taken off.
const TURNS: usize = 3;
/// What is left does not matter below this [px].
const NOTHING: f64 = 0.01;
/// What is not known of a creep for all that, of all of the way: rendered sets that crept by 0.3 to 1.9 px were off by up to 0.03 of it, one whose steps were uneven by 0.06 [–].
const UNKNOWN: f64 = 0.03;

/// The same of one that is not even, whatever its size: rendered sets that went there and back or settled by 0.3 to 0.6 px were off by up to 0.12 px for all that, those that went farther by 0.08 px [px].
const UNEVEN: f64 = 0.08;

/// A stabilised set.
#[derive(Debug, Clone, PartialEq)]
pub struct Steadied {
    /// All pictures, as the camera would have seen them from its place in the first.
    pub pictures: Vec<Vec<u8>>,
    /// How the scene crept.
    pub pace: Pace,
    /// Where the scene lay in each picture, from where it lay in the first [px].
    pub way: Vec<Vector2<f64>>,
    /// What is not known of the place of a picture along rows and columns: how sums scatter about the creep, what is left of it, and a part of all of it, standard deviation [px].
    pub sigma: Vector2<f64>,
}

impl Steadied {
    /// Stabilises a set that drifts by `drift`; `None` where the remaining drift cannot be measured.
    pub fn of(code: &StripeCode, pictures: &[ImageView<'_>], drift: &Drift, min_contrast: u8) -> Option<Steadied> {
        let (size, pace) = (pictures.first()?.size(), drift.pace);
        let mut way = drift.way.clone();
        let mut steady = all_moved(pictures, &way);
        for turn in 0..TURNS {
            let views: Vec<ImageView<'_>> =
                steady.iter().map(|it| ImageView::new(it, size.0, size.1)).collect::<Result<_, _>>().ok()?;
            let (left, scatter) = Sums::of(code, &views)?.way(&views, min_contrast, pace)?;
            let far = reach(&left);
            if far.norm() < NOTHING || turn + 1 == TURNS {
                // Half of what is left lies between a set's middle and its ends.
                let known = far.map(|it| (it / 2.0).hypot(scatter / 2_f64.sqrt()));
                let far = reach(&way);
                let more = if pace == Pace::Uneven { UNEVEN / far.norm().max(NOTHING) } else { 0.0 };
                let sigma = known.zip_map(&far, |known, far| known.hypot(UNKNOWN.hypot(more) * far));
                return Some(Steadied { pictures: steady, pace, way, sigma });
            }
            way.iter_mut().zip(&left).for_each(|(place, left)| *place += left);
            steady = all_moved(pictures, &way);
        }
        None
    }

    /// How far apart the two places of the scene are that lie farthest from each other, along rows and columns [px].
    pub fn reach(&self) -> Vector2<f64> {
        reach(&self.way)
    }

    /// Widens the standard deviations of coordinates by the uncertainty of the pictures' places, and removes pixels that are not in all pictures.
    pub fn widen(&self, coordinates: &mut Coordinates) {
        widen(coordinates, self.sigma);
        let [width, height] = coordinates.size;
        let [left, right] = ends(self.way.iter().map(|it| it.x));
        let [above, below] = ends(self.way.iter().map(|it| it.y));
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

/// Pixels at both ends of rows or columns that some picture did not see where what it saw lies elsewhere by `way` [px].
fn ends(way: impl Iterator<Item = f64>) -> [usize; 2] {
    let (least, most) = way.fold((0.0_f64, 0.0_f64), |(least, most), it| (least.min(it), most.max(it)));
    [-least, most].map(|it| it.ceil() as usize)
}

/// All pictures with what they saw where the first of the set saw it, the scene having gone by `way`.
fn all_moved(pictures: &[ImageView<'_>], way: &[Vector2<f64>]) -> Vec<Vec<u8>> {
    pictures.iter().zip(way).enumerate().map(|(at, (picture, by))| moved(picture, *by, at)).collect()
}

/// Weights of four pixels for a place `part` of a pixel after the second.
fn weights(part: f32) -> [f32; 4] {
    let (a, b, c) = (part, part * part, part * part * part);
    [0.5 * (2.0 * b - a - c), 0.5 * (2.0 - 5.0 * b + 3.0 * c), 0.5 * (a + 4.0 * b - 3.0 * c), 0.5 * (c - b)]
}

/// Where gray levels are rounded up, of each whole one: all parts come equally often over few pixels and pictures, by a sequence of low discrepancy (M. Roberts' R2). Rounded at a half, a picture that is moved by less than
/// its slopes show in half a gray level would stay where it is.
fn rounds_up_from(x: usize, y: usize, picture: usize) -> f32 {
    let place = 0.754_877_67 * x as f64 + 0.569_840_29 * y as f64 + 0.618_033_99 * picture as f64;
    place.fract() as f32
}

/// Picture number `number` with what lies `by` further on in it; its edge goes on beyond it [px].
fn moved(picture: &ImageView<'_>, by: Vector2<f64>, number: usize) -> Vec<u8> {
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
            // A level that is whole stays as it is.
            pixels.push((level + 1e-3 + 0.998 * rounds_up_from(x, y, number)).floor().clamp(0.0, 255.0) as u8);
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

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
            let back = moved(&ImageView::new(&seen, SIZE[0], SIZE[1]).unwrap(), Vector2::new(dx, dy), 3);
            let is_inside =
                |it: &usize| (6..SIZE[0] - 6).contains(&(it % SIZE[0])) && (6..114).contains(&(it / SIZE[0]));
            let worst = (0..still.len()).filter(is_inside).map(|it| still[it].abs_diff(back[it])).max().unwrap();
            assert!(worst <= 2, "({dx}, {dy}): {worst} gray levels");
        }
    }

    thread_local! {
        /// How much farther to the right and down the wall lies [px].
        static OFF: Cell<[f64; 2]> = const { Cell::new([0.0; 2]) };
    }

    /// The wall's set, seen by a camera for which the wall lies elsewhere by `way` in each picture, from part 0 to part 1 of the set [px].
    fn crept(code: &StripeCode, way: impl Fn(f64) -> [f64; 2], seed: u64) -> Vec<Vec<u8>> {
        fn place(x: f64, y: f64) -> (f64, f64) {
            let [right, down] = OFF.get();
            (x - right, y - down)
        }
        let scene = Scene {
            projector: |x, y| {
                let (x, y) = place(x, y);
                (wall(1).projector)(x, y)
            },
            albedo: |x, y| {
                let (x, y) = place(x, y);
                (wall(1).albedo)(x, y)
            },
            shadow: |x, y| {
                let (x, y) = place(x, y);
                (wall(1).shadow)(x, y)
            },
            ..wall(seed)
        };
        let n = code.pictures().len();
        let of = |picture: usize| {
            OFF.set(way(picture as f64 / (n - 1) as f64));
            scene.picture(code, picture)
        };
        (0..n).map(of).collect()
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
            let pictures = crept(&code, |it| [1.2 * it, 0.0], seed);
            let drift = drift(&code, &views(&pictures), 12).unwrap();
            assert!(drift.pace == Pace::Even, "seed {seed}: {drift:?}");
            let steadied = Steadied::of(&code, &views(&pictures), &drift, 12).unwrap();
            assert!((steadied.reach() - Vector2::new(1.2, 0.0)).norm() < 0.12, "seed {seed}: {}", steadied.reach());
            let before = judged(&code, &pictures, &|_| {});
            let after = judged(&code, &steadied.pictures, &|it| steadied.widen(it));
            assert!(after.0 < 0.25 * before.0, "seed {seed}: {before:?}, then {after:?}");
            assert!((0.2..1.5).contains(&after.1), "seed {seed}: {after:?}");
            assert!(after.2 > 14_000, "seed {seed}: {after:?}");
        }
    }

    #[test]
    fn a_creep_that_is_not_even_is_taken_off_as_far_as_is_stated() {
        type Way = fn(f64) -> f64;
        let ways: [(&str, Way); 5] = [
            ("there and back", |it| 1.0 - (2.0 * it - 1.0).abs()),
            ("faster", |it| it * it),
            ("settles", |it| 1.0 - (-4.0 * it).exp()),
            ("stops", |it| (2.0 * it).min(1.0)),
            ("to and fro", |it| (7.0 * it).sin() / 2.0),
        ];
        let check = |code: &StripeCode, name: &str, way: Way, px: f64, seed: u64| {
            let pictures = crept(code, |it| [px * way(it), 0.5 * px * way(it)], seed);
            let drift = drift(code, &views(&pictures), 12).unwrap();
            let steadied = Steadied::of(code, &views(&pictures), &drift, 12).unwrap();
            let before = judged(code, &pictures, &|_| {});
            let after = judged(code, &steadied.pictures, &|it| steadied.widen(it));
            let case = format!("{name}, {px} px, {} steps: {before:?}, then {after:?}", code.steps);
            assert!(drift.pace == Pace::Uneven && after.0 < 0.55 * before.0, "{case}");
            // Pixels that see two surfaces are off by more than phases state, also where nothing moves.
            assert!((0.15..2.0).contains(&after.1) || code.steps > 0, "{case}");
        };
        let [gray, phase] = [StripeCode::gray([160, 120]), StripeCode::phase([160, 120], 4, 16)];
        for ((name, way), px) in ways.into_iter().zip([0.3, 0.6, 0.6, 1.0, 2.0]) {
            check(&gray, name, way, px, 43);
        }
        check(&phase, ways[0].0, ways[0].1, 0.6, 44);
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
            let way = vec![Vector2::zeros(), by];
            let sigma = Vector2::zeros();
            Steadied { pictures: Vec::new(), pace: Pace::Even, way, sigma }.widen(&mut coordinates);
            let known = |x: usize, y: usize| coordinates.values.iter().all(|it| it[y * SIZE[0] + x].is_finite());
            [known(0, 60), known(159, 60), known(80, 0), known(80, 119), known(2, 2), known(157, 117)]
        };
        assert_eq!(of(Vector2::new(1.2, 0.0)), [true, false, true, true, true, true]);
        assert_eq!(of(Vector2::new(-0.4, -1.7)), [false, true, false, true, true, true]);
    }
}
