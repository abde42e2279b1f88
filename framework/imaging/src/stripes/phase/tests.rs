//! Phases of walls whose places are known.

use super::super::gray::{DecodeOptions, decode};
use super::super::scene::{Scene, wall};
use super::*;

/// Share of the pixels with a coordinate, root mean square error, worst error outside the step.
fn judge(scene: &Scene, code: &StripeCode, spoil: impl Fn(&mut Vec<Vec<u8>>)) -> [f64; 3] {
    let mut pictures = scene.pictures(code);
    spoil(&mut pictures);
    let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
    let decoded = decode(code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
    let found = coordinates(code, &views, &decoded, &[], &PhaseOptions::default()).unwrap().coordinates;
    let errors: Vec<f64> = (0..19_200)
        .filter(|at| found.values[0][*at].is_finite() && !(84..93).contains(&(at % 160)))
        .map(|at| {
            let truth = (scene.projector)((at % 160) as f64, (at / 160) as f64)[0];
            (f64::from(found.values[0][at]) - truth).abs()
        })
        .collect();
    let n = errors.len() as f64;
    let rms = (errors.iter().map(|it| it * it).sum::<f64>() / n).sqrt();
    [n / 19_200.0, rms, errors.iter().copied().fold(0.0, f64::max)]
}

#[test]
fn phase_places_each_pixel_by_itself() {
    for (steps, period) in [(3, 16), (4, 16), (8, 8)] {
        for seed in 1..=3 {
            let code = StripeCode::phase([160, 120], steps, period);
            let [share, rms, worst] = judge(&wall(seed), &code, |_| ());
            // The scene's projector pixels are even squares: its waves are stairs, which stay within half a pixel.
            assert!(share > 0.9 && rms < 0.16 && worst < 0.5, "{steps} steps: {share} {rms} {worst}");
        }
    }
}

#[test]
fn phases_are_as_far_off_as_they_say() {
    // Waves so long in the camera's picture that the projector's pixels, which are even squares, are no stairs beside noise. Of that a gray level and a half is stated: there is one, that of rounding, and what the wave's form is off.
    for (steps, period) in [(3, 128), (4, 128), (8, 256)] {
        for seed in 1..=3 {
            let scene = Scene {
                projector: |x, y| [60.0 + 5.2 * x + 0.2 * y, 80.0 + 5.0 * y - 0.2 * x],
                shadow: |_, _| false,
                ..wall(seed)
            };
            let code = StripeCode::phase([1024, 768], steps, period);
            let pictures = scene.pictures(&code);
            let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
            let decoded = decode(&code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
            let found = coordinates(&code, &views, &decoded, &[], &PhaseOptions::default()).unwrap().coordinates;
            for axis in Axis::BOTH.map(Axis::index) {
                let known =
                    found.values[axis].iter().zip(&found.sigmas[axis]).enumerate().filter(|it| it.1.0.is_finite());
                let squares: Vec<f64> = known
                    .map(|(at, (value, sigma))| {
                        let truth = (scene.projector)((at % 160) as f64, (at / 160) as f64)[axis];
                        ((f64::from(*value) - truth) / f64::from(*sigma)).powi(2)
                    })
                    .collect();
                let normalised = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
                let about =
                    format!("{steps} steps, axis {axis}, seed {seed}: {normalised} sigma, {} pixels", squares.len());
                assert!((0.7..1.2).contains(&normalised) && squares.len() > 17_000, "{about}");
            }
        }
    }
}

#[test]
fn waves_of_a_projector_that_nobody_measured_are_told_by_themselves() {
    for (steps, period) in [(3, 8), (5, 8)] {
        for power in [0.5, 2.2] {
            let code = StripeCode::phase([160, 120], steps, period);
            let [share, rms, worst] = judge(&Scene { power, ..wall(7) }, &code, |_| ());
            assert!(share > 0.85 && rms < 0.2, "{steps} steps, power {power}: {share} {rms} {worst}");
        }
    }
}

#[test]
fn steps_of_other_programs_are_told_by_the_stripes_below_them() {
    let code = StripeCode::phase([160, 120], 4, 16);
    let step = |step| code.place(Shown::Phase { axis: Axis::Columns, step }).unwrap();
    let reorder = |order: [u32; 4]| {
        move |pictures: &mut Vec<Vec<u8>>| {
            let all = pictures.clone();
            for (to, from) in order.into_iter().enumerate() {
                pictures[step(to as u32)].clone_from(&all[step(from)]);
            }
        }
    };
    // Backwards, a quarter of a period later, both, two exchanged.
    for order in [[0, 3, 2, 1], [1, 2, 3, 0], [3, 2, 1, 0], [2, 1, 0, 3]] {
        let [share, rms, worst] = judge(&wall(3), &code, reorder(order));
        assert!(share > 0.9 && rms < 0.16 && worst < 0.5, "{order:?}: {share} {rms} {worst}");
    }
}

#[test]
fn waves_may_begin_anywhere_and_where_is_told_by_the_ends_of_stripes() {
    let code = StripeCode::phase([160, 120], 4, 16);
    let steps = [0, 1, 2, 3].map(|step| code.place(Shown::Phase { axis: Axis::Columns, step }).unwrap());
    // Half a pixel of a period of 16, as where pixels are counted from 0 and not from 0.5; and any other place.
    for periods in [0.5 / 16.0, -0.5 / 16.0, 0.125, 0.25 + 0.5 / 16.0, 0.4] {
        let begin = move |pictures: &mut Vec<Vec<u8>>| {
            let all = steps.map(|it| pictures[it].clone());
            for at in 0..all[0].len() {
                let [a, b, c, d] = all.each_ref().map(|it| f64::from(it[at]));
                for (step, place) in steps.into_iter().enumerate() {
                    let (sine, cosine) = (std::f64::consts::TAU * (step as f64 / 4.0 - periods)).sin_cos();
                    let level = (a + b + c + d) / 4.0 + cosine * (a - c) / 2.0 + sine * (b - d) / 2.0;
                    pictures[place][at] = level.round() as u8;
                }
            }
        };
        for seed in 4..=6 {
            let [share, rms, worst] = judge(&wall(seed), &code, begin);
            assert!(share > 0.85 && rms < 0.2 && worst < 0.75, "{periods}, {seed}: {share} {rms} {worst}");
        }
    }
}

#[test]
fn two_steps_that_are_exchanged_are_told_and_put_in_their_order() {
    for (steps, power) in [(4, 1.0), (5, 1.0), (8, 1.0), (8, 2.2), (12, 1.0)] {
        let code = StripeCode::phase([160, 120], steps, 16);
        let place = |step| code.place(Shown::Phase { axis: Axis::Columns, step }).unwrap();
        let pictures = Scene { power, ..wall(4) }.pictures(&code);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let decoded = decode(&code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
        let spoiled = |pairs: &[[u32; 2]]| {
            let mut views = views.clone();
            pairs.iter().for_each(|it| views.swap(place(it[0]), place(it[1])));
            coordinates(&code, &views, &decoded, &[], &PhaseOptions::default()).unwrap()
        };
        let whole = spoiled(&[]);
        assert_eq!(whole.exchanged, [None; 2]);
        for pair in (0..steps).flat_map(|b| (0..b).map(move |a| [a, b])) {
            // Opposite ones of four run the other way: that is told, and allowed for.
            if steps == 4 && pair[1] - pair[0] == 2 {
                continue;
            }
            let found = spoiled(&[pair]);
            let about = format!("{steps} steps, power {power}, {pair:?}");
            assert_eq!((found.exchanged, found.steps), ([Some(pair), None], whole.steps), "{about}");
            assert!(
                found.coordinates.values[0]
                    .iter()
                    .zip(&whole.coordinates.values[0])
                    .all(|(a, b)| a.to_bits() == b.to_bits()),
                "{about}"
            );
        }
        // Two pairs at once are not one.
        if steps == 8 {
            let found = spoiled(&[[0, 3], [2, 5]]);
            let n = found.coordinates.values[0].iter().filter(|it| it.is_finite()).count();
            assert!(found.exchanged == [None; 2] && n < 4000, "{:?} {n}", found.exchanged);
        }
    }
}

#[test]
fn saturated_steps_and_steps_off_the_wave_are_left_out() {
    let code = StripeCode::phase([160, 120], 4, 16);
    let [share, ..] = judge(&Scene { gain: 700.0, ..wall(1) }, &code, |_| ());
    assert!(share < 0.3, "{share}");
    let moved = |pictures: &mut Vec<Vec<u8>>| {
        let step = code.place(Shown::Phase { axis: Axis::Columns, step: 2 }).unwrap();
        pictures[step].rotate_right(6);
    };
    let [share, ..] = judge(&wall(1), &code, moved);
    assert!(share < 0.35, "{share}");
}

#[test]
fn pixels_that_see_two_surfaces_are_left_out() {
    // Two walls, one behind the other, and the end of the projector's light: pixels on both edges are mixtures.
    let two = Scene {
        projector: |x, y| {
            if x + 0.3 * y > 90.35 { [9.0 + x, 12.0 + 0.9 * y] } else { [11.0 + 1.1 * x, 10.0 + 0.9 * y] }
        },
        shadow: |x, _| x > 140.6,
        ..wall(2)
    };
    let code = StripeCode::phase([160, 120], 8, 16);
    let pictures = two.pictures(&code);
    let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
    let decoded = decode(&code, &views, &Axis::BOTH, &DecodeOptions::default()).unwrap();
    let found = coordinates(&code, &views, &decoded, &[], &PhaseOptions::default()).unwrap().coordinates;
    let (mut known, mut wrong) = (0, 0);
    for (at, value) in found.values[0].iter().enumerate().filter(|it| it.1.is_finite()) {
        let off = |dx: f64| (f64::from(*value) - (two.projector)((at % 160) as f64 + dx, (at / 160) as f64)[0]).abs();
        known += 1;
        wrong += usize::from(off(0.0).min(off(-1.0)).min(off(1.0)) > 1.0);
    }
    assert!(known > 14_000 && wrong == 0, "{wrong} of {known}");
}
