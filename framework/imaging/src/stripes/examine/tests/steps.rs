//! Phase steps that are wrong or missing.

use super::super::super::faults::Found;
use super::*;

/// The faults of a wall's phase steps after `change`, and the axes that are left.
fn of_steps(steps: u32, change: impl Fn(&mut Vec<Vec<u8>>, &dyn Fn(u32) -> usize)) -> (Vec<SetFault>, Vec<Axis>) {
    let code = StripeCode::phase([160, 120], steps, 8);
    let mut pictures = wall(3).pictures(&code);
    let place = |step| code.place(Shown::Phase { axis: Axis::Columns, step }).unwrap();
    change(&mut pictures, &place);
    let found = examined(&code, &pictures);
    let usable = found.usable(&code);
    (found.faults, usable)
}

#[test]
fn a_missing_phase_step_is_named_and_worked_out_from_the_others() {
    named_and_worked_out(1.0);
}

#[test]
fn a_phase_step_of_a_projector_of_unknown_response_is_named_and_worked_out() {
    named_and_worked_out(2.2);
    named_and_worked_out(0.5);
}

/// Phase steps of a wall's set, under a projector of this power, taken away.
fn named_and_worked_out(power: f64) {
    let code = StripeCode::phase([160, 120], 8, 8);
    let whole = Scene { power, ..wall(3) }.pictures(&code);
    for (axis, step) in Axis::BOTH.into_iter().flat_map(|axis| [0, 1, 4, 7].map(move |step| (axis, step))) {
        let place = code.place(Shown::Phase { axis, step }).unwrap();
        let mut pictures = whole.clone();
        pictures.remove(place);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let found = examine(&code, &views, &[], 6);
        let last = found.faults.last().unwrap();
        let is_it = match step {
            // A wave may begin with the one or end with the other.
            0 | 7 => *last == SetFault::MissingSteps { axis, pictures: 1 },
            _ => matches!(last, SetFault::Missing { shown, .. } if *shown == Shown::Phase { axis, step }),
        };
        assert!(is_it && found.usable(&code) == Axis::BOTH, "{axis:?} {step}: {last:?}");
        let prepared = found.prepared(&code, &views);
        assert_eq!(prepared.pictures.len(), whole.len());
        if step == 0 {
            continue;
        }
        assert_eq!(prepared.worked_out, [Shown::Phase { axis, step }]);
        let off = |it: (&u8, &u8)| (f64::from(*it.0) - f64::from(*it.1)).powi(2);
        let n = whole[0].len() as f64;
        let rms = (prepared.pictures[place].iter().zip(&whole[place]).map(off).sum::<f64>() / n).sqrt();
        assert!(rms < 6.0, "{axis:?} {step}: {rms}");
    }
    // White behind the steps of the rows, or black, is no step.
    for what in [Shown::White, Shown::Black] {
        let mut pictures = whole.clone();
        pictures.remove(code.place(what).unwrap());
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let found = examine(&code, &views, &[], 6);
        let is_step = |it: &SetFault| match it {
            SetFault::Missing { shown, .. } | SetFault::Shows { expected: shown, .. } => {
                matches!(shown, Shown::Phase { .. })
            }
            _ => matches!(it, SetFault::MissingSteps { .. }),
        };
        assert!(!found.faults.iter().any(is_step), "{what}: {:?}", found.faults);
    }
}

#[test]
fn phase_steps_that_are_none_are_named() {
    let (said, usable) = of_steps(4, |_, _| ());
    assert!(said.is_empty() && usable == Axis::BOTH, "{said:?}");
    let (said, usable) = of_steps(4, |pictures, place| pictures[place(2)].fill(0));
    let shows = |faults: &[SetFault], what: Shown| {
        let step = Shown::Phase { axis: Axis::Columns, step: 2 };
        matches!(faults, [SetFault::Shows { found, expected, .. }] if *found == Found::Shown(what) && *expected == step)
    };
    assert!(shows(&said, Shown::Black) && usable == [Axis::Rows], "{said:?}");
    let white = |pictures: &mut Vec<Vec<u8>>, place: &dyn Fn(u32) -> usize| {
        let last = pictures.len() - 2;
        let white = pictures[last].clone();
        pictures[place(2)] = white;
    };
    let (said, usable) = of_steps(4, white);
    assert!(shows(&said, Shown::White) && usable == [Axis::Rows], "{said:?}");
    for step in 0..4 {
        let (said, usable) = of_steps(4, |pictures, place| drop(pictures.remove(place(step))));
        let expected = SetFault::MissingSteps { axis: Axis::Columns, pictures: 1 };
        assert!(said.len() == 2 && said[1] == expected && usable == [Axis::Rows], "step {step}: {said:?}");
    }
    let (said, _) = of_steps(4, |pictures, place| pictures[place(1)].iter_mut().for_each(|it| *it = 255 - *it));
    let step = Shown::Phase { axis: Axis::Columns, step: 1 };
    assert!(matches!(&said[..], [SetFault::Negative { shown, .. }] if *shown == step), "{said:?}");
}

#[test]
fn rows_are_kept_with_their_steps_where_something_moved_before_them() {
    // Before the last bit of the columns, before their steps, and among these.
    for (step, before) in [(0, 1), (0, 0), (3, 0)] {
        let (said, usable) = of_steps(8, |pictures, place| {
            pictures[place(step) - before..].iter_mut().for_each(|it| it.rotate_right(5));
        });
        assert!(
            said.iter().any(|it| matches!(it, SetFault::Moved { .. })) && usable == [Axis::Rows],
            "{step}, {before}: {said:?}"
        );
    }
}

#[test]
fn the_settings_of_a_set_of_other_steps_or_another_period_are_named() {
    let set = |steps, period| StripeCode::phase([160, 120], steps, period);
    for ((steps, period), (stated_steps, stated_period)) in
        [((8, 8), (4, 8)), ((4, 8), (8, 8)), ((8, 16), (8, 8)), ((8, 8), (8, 16)), ((8, 16), (6, 8)), ((6, 8), (8, 16))]
    {
        let pictures = wall(3).pictures(&set(steps, period));
        let found = examined(&set(stated_steps, stated_period), &pictures);
        let n = pictures.len();
        assert_eq!(found.faults, [SetFault::OtherWaves { steps, period, found: n }], "{stated_steps}, {stated_period}");
        assert_eq!(found.usable(&set(stated_steps, stated_period)), []);
    }
}

#[test]
fn a_bit_and_a_phase_step_in_each_others_places_are_no_exposure() {
    // Of a projector whose waves are no sines a step is darker than half of the light, which a bit in its place would make another exposure.
    let code = StripeCode::phase([160, 120], 8, 8);
    let whole = Scene { power: 2.2, ..wall(3) }.pictures(&code);
    for (bit, step) in [(2, 0), (7, 1)] {
        let mut pictures = whole.clone();
        let at = code.place(Shown::Phase { axis: Axis::Columns, step }).unwrap();
        pictures.swap(bit, at);
        let faults = examined(&code, &pictures).faults;
        let is_it =
            matches!(&faults[..], [SetFault::Exchanged { pictures, mended: true, .. }] if *pictures == [bit, at]);
        assert!(is_it, "{bit}, {step}: {faults:?}");
    }
    let mut n_mended = 0;
    for (bit, step) in [2, 7].into_iter().flat_map(|bit| (0..8).map(move |step| (bit, step))) {
        let (said, usable) = of_steps(8, |pictures, place| pictures.swap(bit, place(step)));
        let is_mended = said.iter().any(|it| matches!(it, SetFault::Exchanged { .. }));
        assert!(!is_mended || said.len() == 1 && usable == Axis::BOTH, "{bit}, {step}: {said:?}");
        n_mended += usize::from(is_mended);
    }
    assert!(n_mended >= 8, "{n_mended}");
}

#[test]
fn an_exchanged_pair_is_named_where_stripes_that_show_it_are_few_and_blurred() {
    // The projector reaches a part of the rows, and pixels lie in the middle of its boundaries.
    let code = StripeCode::gray([160, 128]);
    let part = Scene { shadow: |_, y| y < 60.0, projector: |x, y| [0.3 + x, 1.0 + y], defocus: 0.7, ..wall(4) };
    let pictures = part.pictures(&code);
    assert_eq!(examined(&code, &pictures).faults, []);
    for plane in 1..7 {
        let mut changed = pictures.clone();
        changed.swap(2 * plane, 2 * plane + 1);
        let found = examined(&code, &changed);
        let planes = vec![plane as u32];
        let expected = SetFault::Inverted { axis: Axis::Columns, planes, all: false, mended: true };
        assert_eq!(found.faults, [expected], "bit {plane}");
    }
}

/// The pictures of a wall's phase code as they are to be decoded after `change`, with what is said of them.
fn prepared(steps: u32, power: f64, change: impl Fn(&mut [Vec<u8>])) -> (Vec<Vec<u8>>, Vec<SetFault>) {
    let code = StripeCode::phase([160, 120], steps, 8);
    let mut pictures = Scene { power, ..wall(3) }.pictures(&code);
    change(&mut pictures);
    let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
    let found = examine(&code, &views, &[], 6);
    assert_eq!(found.usable(&code), Axis::BOTH, "{:?}", found.faults);
    let prepared = found.prepared(&code, &views);
    assert_eq!(prepared.worked_out, []);
    (prepared.pictures.into_iter().map(|it| it.into_owned()).collect(), found.faults)
}

#[test]
fn a_step_of_the_columns_in_the_place_of_one_of_the_rows_is_taken_for_it() {
    for (steps, power) in [(3, 1.0), (4, 2.2), (8, 1.0)] {
        let code = StripeCode::phase([160, 120], steps, 8);
        let place = |axis, step| code.place(Shown::Phase { axis, step }).unwrap();
        let (whole, faults) = prepared(steps, power, |_| ());
        assert_eq!(faults, [], "{steps} steps, power {power}");
        for (a, b) in [(0, 0), (1, 2), (2, 1), (steps - 1, 0)] {
            let places = [place(Axis::Columns, a), place(Axis::Rows, b)];
            let (pictures, faults) = prepared(steps, power, |it| it.swap(places[0], places[1]));
            let is_it =
                |it: &SetFault| matches!(it, SetFault::Exchanged { pictures, mended: true, .. } if *pictures == places);
            assert!(faults.len() == 1 && is_it(&faults[0]), "{steps} steps, {a} and {b}: {faults:?}");
            assert!(pictures == whole, "{steps} steps, {a} and {b}");
        }
        // Steps of one axis are told later, by the wave.
        let (_, faults) = prepared(steps, power, |it| it.swap(place(Axis::Columns, 0), place(Axis::Columns, 2)));
        assert_eq!(faults, [], "{steps} steps, power {power}");
    }
}

#[test]
fn phase_steps_that_are_negatives_are_turned_back() {
    let code = StripeCode::phase([160, 120], 8, 8);
    let (whole, _) = prepared(8, 1.0, |_| ());
    let steps = |axis: Axis| (0..8).map(move |step| Shown::Phase { axis, step });
    let all: Vec<Shown> = Axis::BOTH.into_iter().flat_map(steps).collect();
    for negatives in [&all[3..4], &all[..8], &all[8..], &all[..]] {
        let places: Vec<usize> = negatives.iter().map(|it| code.place(*it).unwrap()).collect();
        let (pictures, faults) = prepared(8, 1.0, |pictures| {
            places.iter().for_each(|at| pictures[*at].iter_mut().for_each(|it| *it = 255 - *it));
        });
        let named = negatives.iter().zip(&places);
        let named: Vec<SetFault> =
            named.map(|(shown, at)| SetFault::Negative { picture: *at, shown: *shown, mended: true }).collect();
        assert_eq!(faults, named);
        assert!(pictures == whole, "{negatives:?}");
    }
}

#[test]
fn a_set_most_of_whose_bits_are_not_as_stated_is_refused_with_both_axes() {
    let code = StripeCode::phase([160, 120], 4, 4);
    let whole = wall(3).pictures(&code);
    // Bits of the columns in an order of their own, some of them before and some behind their inverses: no two of them are exchanged.
    let mut pictures = whole.clone();
    for (at, (bit, inverse)) in [(6, 1), (3, 0), (4, 1), (2, 1), (5, 1), (0, 1), (1, 0)].into_iter().enumerate() {
        pictures[2 * at].clone_from(&whole[2 * bit + inverse]);
        pictures[2 * at + 1].clone_from(&whole[2 * bit + 1 - inverse]);
    }
    let found = examined(&code, &pictures);
    assert!(
        matches!(&found.faults[0], SetFault::OutOfPlace { axis: Axis::Columns, planes } if planes[..2] == [1, 2]),
        "{:?}",
        found.faults
    );
    assert_eq!(found.usable(&code), [], "{:?}", found.faults);
    // One bit that shows another one leaves the rows as they are.
    let mut pictures = whole;
    (pictures[6], pictures[7]) = (pictures[2].clone(), pictures[3].clone());
    let found = examined(&code, &pictures);
    assert_eq!(found.usable(&code), [Axis::Rows], "{:?}", found.faults);
}
