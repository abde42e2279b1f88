//! Places where the projector's columns (rows) run backwards.
//!
//! A surface that camera and projector see from the same side shows the projector's columns in one order, whatever its shape: the *ordering constraint* of stereo. Of two scenes in one set each pixel has the coarse bits of
//! the one and the fine bits of the other; where the two are of different coarse stripes, the stripe that comes of it is mirrored at their boundary, and runs backwards. So does what is seen in a mirror.
//! Each such stretch is left out, and what is beside it: where scenes lie several stripes apart, stretches that run forwards between those that run backwards are as wrong.
//!
//! Source: A. L. Yuille, T. Poggio, "A generalized ordering constraint for stereo correspondence", MIT AI Memo 777, 1984.

use super::code::Axis;
use super::edges::Coordinates;

/// A step from pixel to pixel beyond this, or beyond so many mean steps, is one to another surface [projector px, –].
const JUMP: f32 = 8.0;
const JUMPS: f32 = 3.0;
/// A stretch runs backwards by so much at least, over so many pixels that are known [projector px, px], and not by more than this part of it in one step [–]: less is noise and costs less, or it is an edge.
const LEAST_BACK: f32 = 4.0;
const LEAST_KNOWN: usize = 4;
const AT_ONCE: f32 = 0.5;
/// Steps that go forwards by less than this are noise [projector px].
const NOISE: f32 = 0.3;
/// Pixels without a coordinate that a stretch goes across [px].
const GAP: usize = 2;
/// What is left out on both sides of a stretch, of its length and beyond that [–, px].
const BESIDE: f32 = 1.5;
const BESIDE_ALWAYS: usize = 2;
/// An axis of which more than this is left out is wrong by itself [–].
const MOST_OF_ALL: f64 = 0.2;
/// What is left out in this part of the lines on both sides of a line is left out in it as well [px, –].
const LINES: usize = 6;
const OF_LINES: f32 = 0.25;

/// Leaves out coordinates that run backwards, and those beside them: by axis, which part of its known pixels they are. The other axis is left out there, too: what moved shows in both, and without one
/// of them nothing contradicts the other. Where it is more than a fifth of an axis it is that axis that is wrong.
pub fn leave_out_backwards(found: &mut Coordinates) -> [f64; 2] {
    let [width, height] = found.size;
    let places = Axis::BOTH.map(|axis| {
        let values = &found.values[axis.index()];
        if values.len() != width * height || values.is_empty() {
            return (Vec::new(), 0.0);
        }
        let along_rows = Lines { n: height, length: width, next_line: width, next: 1 };
        let along_columns = Lines { n: width, length: height, next_line: 1, next: width };
        // Along which the projector's columns (rows) follow each other faster, and by how much.
        let paces = [&along_rows, &along_columns].map(|it| it.pace(values));
        let (lines, pace) =
            if paces[0].abs() >= paces[1].abs() { (along_rows, paces[0]) } else { (along_columns, paces[1]) };
        let is_left_out = lines.backwards(values, pace);
        let known = || values.iter().zip(&is_left_out).filter(|it| it.0.is_finite());
        let part = known().filter(|it| *it.1).count() as f64 / known().count().max(1) as f64;
        (is_left_out, part)
    });
    for (of, (is_left_out, part)) in places.iter().enumerate().filter(|it| it.1.1 > 0.0) {
        for axis in (0..2).filter(|it| *it == of || *part <= MOST_OF_ALL) {
            let (values, sigmas) = (&mut found.values[axis], &mut found.sigmas[axis]);
            for ((value, sigma), _) in values.iter_mut().zip(sigmas).zip(is_left_out).filter(|it| *it.1) {
                (*value, *sigma) = (f32::NAN, f32::NAN);
            }
        }
    }
    places.map(|it| it.1)
}

/// The lines of a picture in one direction.
struct Lines {
    n: usize,
    length: usize,
    /// From a pixel to that of the next line, and to the next on its line, in the list of all.
    next_line: usize,
    next: usize,
}

impl Lines {
    /// The mean step from pixel to pixel, in the direction in which all of them together go [projector px].
    fn pace(&self, values: &[f32]) -> f32 {
        let (mut sum, mut together, mut n) = (0.0, 0.0, 0);
        for line in 0..self.n {
            let at = |it: usize| values[line * self.next_line + it * self.next];
            // NaN where one of two is not known.
            for step in (1..self.length).map(|it| at(it) - at(it - 1)).filter(|it| it.abs() <= JUMP) {
                sum += f64::from(step.abs());
                together += f64::from(step);
                n += 1;
            }
        }
        let mean = (sum / f64::from(n.max(1))) as f32;
        if together < 0.0 { -mean } else { mean }
    }

    /// Pixels that are to be left out where most steps are as `pace`.
    fn backwards(&self, values: &[f32], pace: f32) -> Vec<bool> {
        let mut found = vec![false; values.len()];
        let (way, jump) = (pace.signum(), JUMP.max(JUMPS * pace.abs()));
        let mut is_any = false;
        for line in 0..self.n {
            let at = |it: usize| line * self.next_line + it * self.next;
            let place = |it: usize| way * values[at(it)];
            let mut begin = 0;
            while begin < self.length {
                if !place(begin).is_finite() {
                    begin += 1;
                    continue;
                }
                let (mut last, mut lowest, mut n_known, mut most) = (begin, place(begin), 1, 0.0_f32);
                for it in begin + 1..self.length {
                    if it - last > GAP + 1 {
                        break;
                    }
                    let here = place(it);
                    if !here.is_finite() {
                        continue;
                    }
                    if here > lowest + NOISE || here < lowest - jump {
                        break;
                    }
                    most = most.max(lowest - here);
                    (last, lowest, n_known) = (it, lowest.min(here), n_known + 1);
                }
                let (length, back) = (last + 1 - begin, place(begin) - lowest);
                if n_known >= LEAST_KNOWN && back >= LEAST_BACK && most <= AT_ONCE * back {
                    let beside = (BESIDE * length as f32) as usize + BESIDE_ALWAYS;
                    let stretch = begin.saturating_sub(beside)..(last + 1 + beside).min(self.length);
                    stretch.for_each(|it| found[at(it)] = true);
                    is_any = true;
                }
                begin = last.max(begin + 1);
            }
        }
        if is_any { self.closed(&found) } else { found }
    }

    /// Lines with what lines beside them leave out.
    fn closed(&self, found: &[bool]) -> Vec<bool> {
        let mut closed = found.to_vec();
        let least = (OF_LINES * (2 * LINES + 1) as f32).ceil() as usize;
        for it in 0..self.length {
            let at = |line: usize| line * self.next_line + it * self.next;
            let mut n = (0..LINES.min(self.n)).filter(|line| found[at(*line)]).count();
            for line in 0..self.n {
                n += usize::from(line + LINES < self.n && found[at(line + LINES)]);
                n -= usize::from(line > LINES && found[at(line - LINES - 1)]);
                closed[at(line)] |= n >= least;
            }
        }
        closed
    }
}

#[cfg(test)]
mod tests {
    use super::super::code::{Group, Inverse, StripeCode};
    use super::super::edges::{EdgeOptions, coordinates};
    use super::super::gray::{DecodeOptions, decode};
    use super::super::scene::{Scene, wall};
    use super::*;
    use crate::ImageView;

    /// What the two scenes have in common: all is seen in the middle third of the picture, and what stands there may have gone.
    fn moved(seed: u64) -> [Scene; 2] {
        let at_first = |x: f64, y: f64| [20.0 + 0.61 * x + 0.04 * y, 12.0 + 0.58 * y - 0.03 * x];
        let then = |x: f64, y: f64| {
            let far = if (50.0..110.0).contains(&x) && (30.0..90.0).contains(&y) { 9.0 } else { 0.0 };
            [20.0 + 0.61 * x + 0.04 * y + far, 12.0 + 0.58 * y - 0.03 * x]
        };
        let albedo = |_: f64, _: f64| 0.7;
        let flat = |projector| Scene { projector, albedo, shadow: |_, _| false, ..wall(seed) };
        [flat(at_first), flat(then)]
    }

    fn code(size: [u32; 2]) -> StripeCode {
        let order = vec![Group::Stripes(Axis::Columns), Group::White, Group::Black];
        StripeCode { order, inverse: Inverse::None, ..StripeCode::gray(size) }
    }

    fn decoded(code: &StripeCode, pictures: &[Vec<u8>], [width, height]: [usize; 2]) -> Coordinates {
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, width, height).unwrap()).collect();
        let decoded = decode(code, &views, &[Axis::Columns], &DecodeOptions::default()).unwrap();
        coordinates(code, &views, &decoded, &EdgeOptions::default()).unwrap()
    }

    /// Pixels that are off both scenes by more than four columns, and all that are known.
    fn judged(scenes: &[Scene; 2], found: &Coordinates) -> (usize, usize) {
        let width = found.size[0];
        let off = |at: usize, value: f32| {
            let (x, y) = ((at % width) as f64, (at / width) as f64);
            let of = |it: &Scene| ((it.projector)(x, y)[0] - f64::from(value)).abs();
            of(&scenes[0]).min(of(&scenes[1]))
        };
        let known = found.values[0].iter().enumerate().filter(|it| it.1.is_finite());
        known.fold((0, 0), |(wrong, n), (at, value)| (wrong + usize::from(off(at, *value) > 4.0), n + 1))
    }

    #[test]
    fn stripes_of_two_scenes_are_left_out_where_they_run_backwards() {
        let code = code([160, 120]);
        for seed in 1..=3 {
            let scenes = moved(seed);
            let all = scenes.clone().map(|it| it.pictures(&code));
            for step in [3, 4, 5] {
                let pictures = [&all[0][..step], &all[1][step..]].concat();
                let mut found = decoded(&code, &pictures, scenes[0].size);
                let before = judged(&scenes, &found);
                let [part, rows] = leave_out_backwards(&mut found);
                let after = judged(&scenes, &found);
                let told = format!("seed {seed}, step at {step}: {before:?}, then {after:?}, {part} left out");
                assert!(before.0 > 150 && after.0 * 8 < before.0, "{told}");
                assert!((0.005..0.25).contains(&part) && rows == 0.0, "{told}");
                // The rest of the picture stays.
                let stay = (0..found.values[0].len()).filter(|it| it % 160 < 30);
                assert!(stay.filter(|it| found.values[0][*it].is_nan()).count() < 300, "{told}");
            }
        }
    }

    #[test]
    fn surfaces_in_one_order_stay_whatever_way_the_camera_is_turned() {
        // As it is, upside down, on its side, and by an eighth of a turn; upside down and so near that a column is seven pixels wide. A step to another surface in most.
        let turns: [fn(f64, f64) -> [f64; 2]; 5] = [
            |x, y| [100.0 - 0.14 * x, 80.0 - 0.14 * y],
            |x, y| [20.0 + 0.61 * x + 0.04 * y + if x > 90.0 { -17.0 } else { 0.0 }, 12.0 + 0.58 * y],
            |x, y| [140.0 - 0.61 * x - 0.04 * y, 100.0 - 0.58 * y + if y > 50.0 { -17.0 } else { 0.0 }],
            |x, y| [20.0 + 0.61 * y + if y > 60.0 { 13.0 } else { 0.0 }, 110.0 - 0.58 * x],
            |x, y| [10.0 + 0.41 * (x + y), 60.0 + 0.41 * (y - x)],
        ];
        for projector in turns {
            let scene = Scene { projector, ..wall(5) };
            let code = StripeCode::gray([160, 120]);
            let pictures = scene.pictures(&code);
            let views: Vec<ImageView<'_>> =
                pictures.iter().map(|it| ImageView::new(it, scene.size[0], scene.size[1]).unwrap()).collect();
            let decoded = decode(&code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
            let mut found = coordinates(&code, &views, &decoded, &EdgeOptions::default()).unwrap();
            let before = found.values.clone().map(|it| it.iter().filter(|it| it.is_finite()).count());
            assert_eq!(leave_out_backwards(&mut found), [0.0, 0.0]);
            assert!(before.iter().all(|it| *it > 10_000), "{before:?}");
        }
    }
}
