//! What `examine` promises, tried.

use foveate_estimation::random::Random;

use super::super::code::{Group, Inverse};
use super::super::pattern::picture;
use super::super::scene::{Scene, wall, wall_code, wall_set};
use super::*;

mod one_axis;
mod steps;

pub(super) const MIN_CONTRAST: u8 = 12;

pub(super) fn examined(code: &StripeCode, pictures: &[Vec<u8>]) -> Examination {
    let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
    examine(code, &views, &[], MIN_CONTRAST)
}

/// A fault that is expected.
type Expected<'a> = &'a dyn Fn(&SetFault) -> bool;

/// The wall's pictures after `change` have the `expected` faults, in this order, and the axes `usable` are left.
#[track_caller]
pub(super) fn check(change: impl Fn(&mut Vec<Vec<u8>>), expected: &[Expected<'_>], usable: &[Axis]) {
    for seed in 1..=2 {
        let mut pictures = wall_set(seed);
        change(&mut pictures);
        let found = examined(&wall_code(), &pictures);
        let faults = &found.faults;
        assert_eq!(faults.len(), expected.len(), "seed {seed}: {faults:#?}");
        for (at, (fault, is_expected)) in faults.iter().zip(expected).enumerate() {
            assert!(is_expected(fault), "seed {seed}, fault {at}: {faults:#?}");
        }
        assert_eq!(found.usable(&wall_code()), usable, "seed {seed}: {faults:?}");
    }
}

/// `found` pictures rather than the 32 of the wall's code.
fn count(n: usize) -> impl Fn(&SetFault) -> bool {
    move |it| matches!(it, SetFault::Count { found, expected: 32, .. } if *found == n)
}

fn missing(what: Shown, after: usize) -> impl Fn(&SetFault) -> bool {
    move |it| matches!(it, SetFault::Missing { shown, after: Some(at), .. } if *shown == what && *at == after)
}

/// Picture `picture` is the one that should show `expected` and shows what `same_as` does.
fn doubled(picture: usize, same_as: usize, expected: Option<Shown>) -> impl Fn(&SetFault) -> bool {
    move |it| {
        let is_shown = |it: &Option<Shown>| expected.is_none() || *it == expected;
        matches!(it, SetFault::Doubled { picture: a, same_as: b, expected: it } if [*a, *b] == [picture, same_as] && is_shown(it))
    }
}

fn extra(what: Shown) -> impl Fn(&SetFault) -> bool {
    move |it| matches!(it, SetFault::Extra { shown: Some(it), .. } if *it == what)
}

fn exchanged(a: usize, b: usize) -> impl Fn(&SetFault) -> bool {
    move |it| matches!(it, SetFault::Exchanged { pictures, .. } if *pictures == [a, b])
}

fn negative(at: usize) -> impl Fn(&SetFault) -> bool {
    move |it| matches!(it, SetFault::Negative { picture, shown, .. } if *picture == at && *shown == wall_code().pictures()[at])
}

fn bit(axis: Axis, plane: u32, inverse: bool) -> Shown {
    Shown::Bit { axis, plane, inverse }
}

/// How `code` orders its pictures: the values of the settings that state it.
fn order(code: &StripeCode) -> (Vec<Group>, Inverse, bool) {
    (code.order.clone(), code.inverse, code.fine_first)
}

/// The order that pictures were found to have.
fn other_order(faults: &[SetFault]) -> (Vec<Group>, Inverse, bool) {
    let [SetFault::OtherOrder { code }] = faults else { panic!("{faults:?}") };
    order(code)
}

const COLUMNS: Group = Group::Stripes(Axis::Columns);
const ROWS: Group = Group::Stripes(Axis::Rows);

#[test]
fn good_sets_are_good() {
    check(|_| (), &[], &Axis::BOTH);
    for inverse in [Inverse::Before, Inverse::Apart, Inverse::None] {
        let order = vec![Group::Black, Group::White, Group::Stripes(Axis::Rows), Group::Stripes(Axis::Columns)];
        let code = StripeCode { inverse, order, fine_first: true, ..wall_code() }.with_bits([None, None], true);
        let found = examined(&code, &wall(1).pictures(&code));
        assert_eq!(found.faults, [], "{inverse:?}");
    }
    let glossy = Scene { gamma: 2.2, global: |_, _| 0.2, defocus: 0.7, ..wall(2) };
    assert_eq!(examined(&wall_code(), &glossy.pictures(&wall_code())).faults, []);
}

#[test]
fn a_camera_that_sees_the_projector_pixel_for_pixel_is_in_step_with_no_sample() {
    let mut random = Random::new(11);
    for size in [[1280, 1024], [640, 480], [480, 640], [1600, 1200]] {
        for code in [StripeCode::gray(size), StripeCode::phase(size, 4, 16)] {
            let mut seen = |shown| -> Vec<u8> {
                let shown = picture(&code, shown, 1.0);
                shown.iter().map(|it| (0.7 * f64::from(*it) + 20.0 + random.normal()).round() as u8).collect()
            };
            let pictures: Vec<Vec<u8>> = code.pictures().into_iter().map(&mut seen).collect();
            let [width, height] = size.map(|it| it as usize);
            let views: Vec<ImageView<'_>> =
                pictures.iter().map(|it| ImageView::new(it, width, height).unwrap()).collect();
            let found = examine(&code, &views, &[], MIN_CONTRAST);
            assert_eq!((found.faults.as_slice(), found.usable(&code)), (&[][..], Axis::BOTH.to_vec()), "{size:?}");
        }
    }
}

#[test]
fn a_missing_picture_is_named_and_worked_out_from_the_others() {
    check(|it| drop(it.remove(7)), &[&count(31), &missing(bit(Axis::Columns, 3, true), 6)], &Axis::BOTH);
    // The coarsest bit of the rows, then white: there is light enough to decode without it.
    let by_way = |it: &SetFault| *it == SetFault::ByWay { axis: Axis::Rows, plane: 0 };
    let shows_none =
        |it: &SetFault| matches!(it, SetFault::Missing { shown, .. } if *shown == bit(Axis::Rows, 0, false));
    check(|it| drop(it.remove(16)), &[&count(31), &shows_none, &by_way], &Axis::BOTH);
    check(|it| drop(it.remove(30)), &[&count(31), &missing(Shown::White, 29)], &Axis::BOTH);
}

#[test]
fn every_missing_picture_is_named() {
    for seed in 1..=1 {
        let all = wall_set(seed);
        for missing in 0..32 {
            let mut pictures = all.clone();
            pictures.remove(missing);
            let faults = examined(&wall_code(), &pictures).faults;
            let shown = wall_code().pictures()[missing];
            let is_it =
                |it: &SetFault| matches!(it, SetFault::Missing { shown: it, or_inverse: false, .. } if *it == shown);
            let n_told = faults.iter().filter(|it| !matches!(it, SetFault::ByWay { .. })).count();
            assert!(n_told == 2 && faults.iter().any(is_it), "seed {seed}, {shown}: {faults:?}");
        }
    }
}

#[test]
fn a_picture_too_many_is_named_and_nothing_lost() {
    let double = |it: &mut Vec<Vec<u8>>| {
        let again = it[9].clone();
        it.insert(9, again);
    };
    check(double, &[&count(33), &extra(bit(Axis::Columns, 4, true))], &Axis::BOTH);
}

#[test]
fn a_doubled_picture_is_named_and_the_one_that_it_replaces_is_worked_out() {
    check(|it| it[9] = it[8].clone(), &[&doubled(9, 8, Some(bit(Axis::Columns, 4, true)))], &Axis::BOTH);
    // The place of the stripes decides which of the coarsest bit's two pictures is there; no other picture is named.
    check(|it| it[1] = it[0].clone(), &[&doubled(1, 0, None)], &Axis::BOTH);
    let by_way = |it: &SetFault| *it == SetFault::ByWay { axis: Axis::Rows, plane: 0 };
    check(|it| it[17] = it[16].clone(), &[&doubled(17, 16, None), &by_way], &Axis::BOTH);
    // The inverse of the coarsest bit again in place of the next bit.
    check(|it| it[2] = it[1].clone(), &[&doubled(2, 1, Some(bit(Axis::Columns, 1, false)))], &Axis::BOTH);
    let twice = |it: &mut Vec<Vec<u8>>| it.insert(1, it[0].clone());
    check(twice, &[&count(33), &extra(bit(Axis::Columns, 0, false))], &Axis::BOTH);
}

#[test]
fn a_set_for_a_larger_projector_is_told_its_size() {
    for (made, stated, bits, sizes) in [
        (StripeCode::gray([160, 120]), StripeCode::gray([128, 120]), [8, 7], "129 to 256 x 65 to 128"),
        (StripeCode::gray([160, 120]), StripeCode::gray([128, 60]), [8, 7], "128 x 60 px"),
        (StripeCode::phase([160, 120], 8, 8), StripeCode::phase([128, 120], 8, 8), [6, 5], "129 to 256 x 65 to 128"),
    ] {
        for seed in 1..=2 {
            let pictures = wall(seed).pictures(&made);
            let n = pictures.len();
            let found = examined(&stated, &pictures);
            assert_eq!(found.faults, [SetFault::OtherSize { bits, found: n }], "seed {seed}, {n} pictures");
            let said = found.faults[0].describe(&stated, &|at| at.to_string());
            assert!(said.contains(sizes), "{said}");
            assert_eq!(found.usable(&stated), []);
            // Two pictures that are there twice are no larger projector's.
            let mut twice = wall(seed).pictures(&stated);
            for at in [7, 3] {
                twice.insert(at, twice[at].clone());
            }
            let found = examined(&stated, &twice);
            assert!(!found.faults.iter().any(|it| matches!(it, SetFault::OtherSize { .. })), "{:?}", found.faults);
        }
    }
}

#[test]
fn a_negative_is_named_and_no_other_picture() {
    for at in [0, 5, 14, 17, 28, 30] {
        check(|it| it[at].iter_mut().for_each(|it| *it = 255 - *it), &[&negative(at)], &Axis::BOTH);
    }
}

#[test]
fn a_picture_of_another_exposure_is_named() {
    check(
        |it| it[6].iter_mut().for_each(|it| *it = (f64::from(*it) * 0.45).round() as u8),
        &[
            &|it| matches!(it, SetFault::Uneven { pictures } if matches!(pictures[..], [(6, factor)] if (0.4..0.5).contains(&factor))),
        ],
        &Axis::BOTH,
    );
}

#[test]
fn exposures_that_differ_are_evened_out_and_name_no_other_picture() {
    let darker = |it: &mut Vec<Vec<u8>>, at: usize, factor: f64| {
        it[at].iter_mut().for_each(|it| *it = (f64::from(*it) * factor).round() as u8);
    };
    check(
        |it| [5, 13, 24].into_iter().for_each(|at| darker(it, at, 0.7)),
        &[&|it| {
            let SetFault::Uneven { pictures } = it else { return false };
            let places: Vec<usize> = pictures.iter().map(|it| it.0).collect();
            places == [5, 13, 24] && pictures.iter().all(|it| (it.1 - 0.7).abs() < 0.005)
        }],
        &Axis::BOTH,
    );
    let many = |it: &SetFault| matches!(it, SetFault::Uneven { pictures } if pictures.len() > 6);
    check(|it| (18..32).for_each(|at| darker(it, at, 0.7)), &[&many], &Axis::BOTH);
    check(
        |it| (0..32).for_each(|at| darker(it, at, 1.0 - 0.01 * at as f64)),
        &[&|it| matches!(it, SetFault::Faded { factor, .. } if (0.6..0.7).contains(factor))],
        &Axis::BOTH,
    );
    // What is decoded is what would have been.
    let right = wall_set(2);
    let mut pictures = right.clone();
    darker(&mut pictures, 13, 0.7);
    let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
    let prepared = examined(&wall_code(), &pictures).prepared(&wall_code(), &views);
    let off = prepared.pictures[13].iter().zip(&right[13]).map(|(a, b)| a.abs_diff(*b));
    assert!(off.max() < Some(6), "the evened picture");
}

#[test]
fn a_saturated_set_names_no_picture() {
    check(
        |it| it.iter_mut().flatten().for_each(|it| *it = (4 * u16::from(*it)).min(255) as u8),
        &[&|it| matches!(it, SetFault::TooBright { .. })],
        &Axis::BOTH,
    );
}

#[test]
fn a_dim_set_is_named() {
    // In which few pixels have enough contrast.
    let is_dim = |it: &SetFault| matches!(it, SetFault::Dim { .. });
    check(|it| it.iter_mut().flatten().for_each(|it| *it /= 12), &[&is_dim], &Axis::BOTH);
}

#[test]
fn a_light_of_the_room_that_changes_is_no_want_of_light() {
    // It reaches the whole picture, the projector a third of it.
    for inverse in [Inverse::None, Inverse::After] {
        let code = StripeCode { inverse, ..wall_code() };
        for seed in 1..=2 {
            let mut pictures = Scene { shadow: |x, _| x > 55.0, ..wall(seed) }.pictures(&code);
            for (at, picture) in pictures.iter_mut().enumerate() {
                picture.iter_mut().for_each(|it| *it = it.saturating_add(at as u8));
            }
            let found = examined(&code, &pictures);
            let is_dim = |it: &SetFault| matches!(it, SetFault::Dim { .. });
            assert!(!found.faults.iter().any(is_dim), "{inverse:?}, seed {seed}: {:?}", found.faults);
        }
    }
}

/// The wall, moved to the side and nearer.
fn moved_wall(seed: u64) -> Vec<Vec<u8>> {
    let moved = Scene {
        projector: |x, y| [26.0 + 0.63 * x + 0.02 * y, 9.0 + 0.6 * y - 0.01 * x],
        albedo: |x, y| 0.35 + 0.3 * (((x + 11.0) / 7.0).sin() * ((y - 6.0) / 9.0).cos() + 1.0),
        shadow: |x, _| (60.0..=66.0).contains(&x),
        ..wall(seed)
    };
    moved.pictures(&wall_code())
}

#[test]
fn what_is_moved_in_the_middle_of_a_set_is_named_and_the_axis_before_it_is_kept() {
    for (first, last, usable) in [(18, 17, Axis::Columns), (21, 20, Axis::Columns), (9, 8, Axis::Rows)] {
        let moved = |it: &SetFault| matches!(it, SetFault::Moved { last: a, first: b, light: None, .. } if [*a, *b] == [last, first]);
        let replace = |it: &mut Vec<Vec<u8>>| it.splice(first.., moved_wall(4).split_off(first)).for_each(drop);
        check(replace, &[&moved], &[usable]);
    }
}

#[test]
fn one_picture_of_another_scene_is_named_and_worked_out() {
    for (at, what) in [(12, bit(Axis::Columns, 6, false)), (21, bit(Axis::Rows, 2, true))] {
        let other = |it: &SetFault| *it == SetFault::OtherScene { picture: at, shown: what };
        check(|it| it[at] = moved_wall(5).swap_remove(at), &[&other], &Axis::BOTH);
    }
}

#[test]
fn pictures_for_a_projector_of_another_size_are_named() {
    // One bit more, or one less, than the pictures have.
    for projector in [[160, 60], [300, 60]] {
        let found = examined(&StripeCode::gray(projector), &wall_set(1));
        assert_eq!(found.faults, [SetFault::OtherSize { bits: [8, 7], found: 30 + 2 }], "{projector:?}");
        assert!(found.usable(&StripeCode::gray(projector)).is_empty());
    }
    // Both pictures of one bit may be missing as well: the other axis is as it should be.
    let code = StripeCode::gray([300, 120]);
    let found = examined(&code, &wall_set(1));
    let is_it = |it: &SetFault| matches!(it, SetFault::MissingBits { axis: Axis::Columns, pictures: 2, .. });
    assert!(is_it(&found.faults[1]), "{:?}", found.faults);
    let said = found.faults[1].describe(&code, &|_| String::new());
    assert!(said.contains("256 columns"), "the projector that the pictures may be for instead: {said}");
    assert_eq!(found.usable(&code), [Axis::Rows]);
}

#[test]
fn pictures_in_each_others_places_are_named_and_taken_for_each_other() {
    let inverted = |it: &SetFault| matches!(it, SetFault::Inverted { axis: Axis::Columns, planes, all: false, mended: true } if planes[..] == [3]);
    check(|it| it.swap(6, 7), &[&inverted], &Axis::BOTH);
    let exchanges = [vec![(6, 7)], vec![(3, 12)], vec![(20, 30)], vec![(4, 10), (5, 11)], vec![(6, 7), (24, 25)]];
    for exchanged in exchanges {
        let mut pictures = wall_set(1);
        exchanged.iter().for_each(|(a, b)| pictures.swap(*a, *b));
        let found = examined(&wall_code(), &pictures);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let prepared = found.prepared(&wall_code(), &views);
        assert_eq!(prepared.worked_out, [], "{exchanged:?}");
        assert!(prepared.pictures.iter().zip(wall_set(1)).all(|(a, b)| a[..] == b[..]), "{exchanged:?}");
    }
}

#[test]
fn what_is_not_sound_with_pictures_exchanged_leaves_its_axis_out() {
    // A bit and its inverse exchanged, and another bit of its axis shifted by some pixels.
    let spoil = |it: &mut Vec<Vec<u8>>| {
        it.swap(6, 7);
        it[8].rotate_left(9);
        it[9].rotate_left(9);
    };
    check(spoil, &[&|it| matches!(it, SetFault::Inverted { mended: false, .. })], &[Axis::Rows]);
}

#[test]
fn another_order_is_recognised() {
    let fits = |expected: (Vec<Group>, Inverse, bool)| move |it: &SetFault| matches!(it, SetFault::OtherOrder { code } if order(code) == expected);
    let [white, black] = [Group::White, Group::Black];
    let swap_all = |it: &mut Vec<Vec<u8>>| (0..15).for_each(|pair| it.swap(2 * pair, 2 * pair + 1));
    check(swap_all, &[&fits((vec![COLUMNS, ROWS, white, black], Inverse::Before, false))], &[]);
    check(|it| it.rotate_right(2), &[&fits((vec![white, black, COLUMNS, ROWS], Inverse::After, false))], &[]);
    check(|it| it.reverse(), &[&fits((vec![black, white, ROWS, COLUMNS], Inverse::Before, true))], &[]);
}

#[test]
fn inverses_after_the_bits_of_both_axes_are_recognised_and_decoded() {
    let last = StripeCode { inverse: Inverse::Last, ..wall_code() };
    let as_others: Vec<Vec<u8>> = {
        let (pictures, shown) = (wall_set(1), wall_code().pictures());
        let of = |it: &Shown| pictures[shown.iter().position(|other| other == it).unwrap()].clone();
        last.pictures().iter().map(of).collect()
    };
    let found = examined(&wall_code(), &as_others);
    assert_eq!(other_order(&found.faults), (vec![COLUMNS, ROWS, Group::White, Group::Black], Inverse::Last, false));
    assert_eq!(examined(&last, &as_others).faults, []);
    assert_eq!(examined(&last, &as_others).usable(&last), Axis::BOTH);
}

#[test]
fn bits_in_each_others_places_are_named_and_no_third() {
    let exchange = |a: usize, b: usize| {
        move |it: &mut Vec<Vec<u8>>| {
            it.swap(a, b);
            it.swap(a + 1, b + 1);
        }
    };
    for (a, b) in [(4, 10), (6, 8), (6, 22)] {
        check(exchange(a, b), &[&exchanged(a, b), &exchanged(a + 1, b + 1)], &Axis::BOTH);
    }
    for (a, b) in [(3, 12), (20, 30)] {
        check(|it| it.swap(a, b), &[&exchanged(a, b)], &Axis::BOTH);
    }
}

#[test]
fn a_dropped_frame_is_named_and_pictures_are_known_where_they_stand() {
    // From picture 11 on, each is the one before.
    let drop_frame = |it: &mut Vec<Vec<u8>>| {
        let again = it[10].clone();
        it.insert(11, again);
        it.pop();
    };
    let no_black = |it: &SetFault| matches!(it, SetFault::Missing { shown: Shown::Black, .. });
    check(drop_frame, &[&extra(bit(Axis::Columns, 5, false)), &no_black], &Axis::BOTH);
}

#[test]
fn noise_is_no_fault() {
    for seed in 1..=2 {
        let noisy = Scene { noise: 8.0, ..wall(seed) };
        let found = examined(&wall_code(), &noisy.pictures(&wall_code()));
        assert_eq!(found.faults, [], "seed {seed}");
        assert!((6.0..9.5).contains(&found.noise), "{}", found.noise);
    }
}

#[test]
fn pictures_that_could_not_be_read_name_no_other() {
    let bit = Shown::Bit { axis: Axis::Columns, plane: 2, inverse: true };
    for (absent, worked_out) in [(5, vec![bit]), (30, Vec::new())] {
        let mut pictures = wall_set(1);
        pictures[absent].fill(0);
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        let found = examine(&wall_code(), &views, &[absent], MIN_CONTRAST);
        let shown = wall_code().pictures()[absent];
        assert_eq!(found.faults, [SetFault::Unreadable { picture: absent, shown }]);
        assert_eq!(found.usable(&wall_code()), Axis::BOTH);
        let prepared = found.prepared(&wall_code(), &views);
        assert_eq!(prepared.code.pictures().len(), prepared.pictures.len());
        assert_eq!(prepared.worked_out, worked_out);
    }
}

#[test]
fn white_and_black_exchanged_are_named() {
    check(|it| it.swap(30, 31), &[&|it| *it == SetFault::WhiteIsBlack { white: 30, black: 31 }], &Axis::BOTH);
    let mut pictures = wall_set(1);
    pictures.swap(30, 31);
    let found = examined(&wall_code(), &pictures);
    assert_eq!([30, 31].map(|it| found.picture_at(it)), [Some(31), Some(30)]);
}

#[test]
fn white_of_another_scene_is_left_out_where_inverse_pictures_tell_what_is_lit() {
    let spoil = |it: &mut Vec<u8>| it.chunks_exact_mut(160).for_each(|row| row[..100].fill(10));
    let other = |it: &mut Vec<Vec<u8>>| spoil(&mut it[30]);
    let not_white = |it: &SetFault| matches!(it, SetFault::NotWhite { picture: 30, shown: Shown::White, .. });
    check(other, &[&not_white], &Axis::BOTH);
    let mut pictures = wall_set(1);
    other(&mut pictures);
    let found = examined(&wall_code(), &pictures);
    let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
    let prepared = found.prepared(&wall_code(), &views);
    assert_eq!((prepared.code.place(Shown::White), prepared.pictures.len()), (None, 31));
    // Without inverse pictures nothing else says what is lit.
    let alone = StripeCode { inverse: Inverse::None, ..wall_code() };
    let mut pictures = wall(1).pictures(&alone);
    let white = alone.place(Shown::White).unwrap();
    spoil(&mut pictures[white]);
    assert_eq!(examined(&alone, &pictures).usable(&alone), []);
}

#[test]
fn sets_that_end_in_the_middle_or_have_columns_alone_keep_their_columns() {
    // All of the columns and one picture of the rows; columns, white and black.
    let half: &dyn Fn(&mut Vec<Vec<u8>>) = &|it| it.truncate(17);
    let columns: &dyn Fn(&mut Vec<Vec<u8>>) = &|it| drop(it.drain(16..30));
    for (change, n, is_whole) in [(half, 17, false), (columns, 18, true)] {
        let mut pictures = wall_set(1);
        change(&mut pictures);
        let found = examined(&wall_code(), &pictures);
        let faults = &found.faults;
        let has = |is_it: &dyn Fn(&SetFault) -> bool| faults.iter().any(is_it);
        assert!(has(&count(n)), "{faults:?}");
        assert!(has(&|it| *it == SetFault::NoAxis { axis: Axis::Rows, pictures: 14 }), "{faults:?}");
        // The picture of the rows is neither white nor black.
        let no_black = has(&|it| matches!(it, SetFault::Missing { shown: Shown::Black, .. }));
        let is_extra = has(&|it| matches!(it, SetFault::Extra { picture: 16, .. }));
        assert_eq!([no_black, is_extra], [!is_whole; 2], "{faults:?}");
        assert_eq!((found.usable(&wall_code()), faults.len() == 2), (vec![Axis::Columns], is_whole), "{faults:?}");
    }
}

#[test]
fn stripes_decide_which_axis_is_which_where_both_have_as_many_bits() {
    // 16 bits each, and more rows than the projector has.
    let code = StripeCode::gray([250, 140]);
    let rotated = Scene { projector: |x, y| [20.0 + 1.3 * x, 10.0 + y], ..wall(1) };
    let pictures = rotated.pictures(&code);
    let examined = |pictures: &[Vec<u8>]| {
        let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
        examine(&code, &views, &[], MIN_CONTRAST)
    };
    for (kept, axis) in [(0..16, Axis::Columns), (16..32, Axis::Rows)] {
        let alone: Vec<Vec<u8>> = pictures[kept].iter().chain(&pictures[32..]).cloned().collect();
        assert_eq!(examined(&alone).usable(&code), [axis]);
    }
    let mut rows_first = pictures.clone();
    rows_first[..32].rotate_left(16);
    let found = examined(&rows_first);
    assert_eq!(other_order(&found.faults).0, [ROWS, COLUMNS, Group::White, Group::Black]);
    assert_eq!((examined(&pictures).faults, found.usable(&code)), (vec![], vec![]));
}

#[test]
fn a_set_without_inverse_pictures_is_told_the_setting_that_it_needs() {
    let alone = StripeCode { inverse: Inverse::None, ..wall_code() };
    let found = examined(&wall_code(), &wall(1).pictures(&alone));
    assert_eq!(other_order(&found.faults).1, Inverse::None);
}

#[test]
fn stripes_as_fine_as_two_pixels_are_put_in_order() {
    let code = StripeCode::gray([256, 192]);
    for seed in 1..=2 {
        // Runs of the finest bit are two pixels of the camera wide.
        let fine =
            Scene { projector: |x, y| [30.0 + 0.95 * x + 0.03 * y, 20.0 + 0.97 * y], defocus: 0.3, ..wall(seed) };
        let fine = Scene { size: [200, 150], ..fine };
        let mut pictures = fine.pictures(&code);
        let examined = |pictures: &[Vec<u8>]| {
            let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 200, 150).unwrap()).collect();
            examine(&code, &views, &[], MIN_CONTRAST)
        };
        assert_eq!(examined(&pictures).faults, [], "seed {seed}");
        let n = pictures.len();
        pictures.rotate_right(2);
        let found = examined(&pictures);
        assert_eq!(other_order(&found.faults).0, [Group::White, Group::Black, COLUMNS, ROWS], "seed {seed}");
        // Back in order, but for two bits.
        pictures.rotate_left(2);
        pictures.swap(4, 10);
        let found = examined(&pictures);
        let [SetFault::Exchanged { pictures: [4, 10], .. }] = found.faults[..] else {
            panic!("seed {seed}, {n} pictures: {:?}", found.faults)
        };
    }
}

#[test]
fn a_picture_of_another_size_is_named() {
    let pictures = wall_set(1);
    let mut views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
    views[3] = ImageView::new(&pictures[3], 120, 160).unwrap();
    let found = examine(&wall_code(), &views, &[], MIN_CONTRAST);
    assert_eq!(found.faults, [SetFault::Size { picture: 3, found: (120, 160), expected: (160, 120) }]);
}

#[test]
fn dark_and_bright_scenes_are_named() {
    let has = |scene: Scene, is_it: Expected<'_>| {
        let faults = examined(&wall_code(), &scene.pictures(&wall_code())).faults;
        assert!(faults.iter().any(is_it), "{faults:?}");
    };
    has(Scene { gain: 3.0, ..wall(1) }, &|it| matches!(it, SetFault::TooDark { .. } | SetFault::Dim { .. }));
    has(Scene { gain: 900.0, ..wall(1) }, &|it| matches!(it, SetFault::TooBright { .. }));
    has(
        Scene { ambient: 2000.0, ..wall(1) },
        &|it| matches!(it, SetFault::Alike { saturated, .. } if *saturated > 0.0),
    );
}

#[test]
fn pictures_without_stripes_are_not_called_dark() {
    let faults = |pictures: &[Vec<u8>]| {
        let found = examined(&wall_code(), pictures);
        assert_eq!(found.usable(&wall_code()), [], "{:?}", found.faults);
        found.faults
    };
    let is_alike = |it: &SetFault| matches!(it, SetFault::Alike { saturated: 0.0, .. });
    let mut chance = foveate_estimation::Random::new(3);
    for sigma in [2.0, 8.0, 60.0] {
        let mut level = |_| (90.0 + sigma * chance.normal()).round().clamp(0.0, 255.0) as u8;
        let noise: Vec<Vec<u8>> = (0..32).map(|_| (0..160 * 120).map(&mut level).collect()).collect();
        let found = faults(&noise);
        assert!(found.len() == 1 && is_alike(&found[0]), "{sigma}: {found:?}");
    }
    let white = wall_set(1)[30].clone();
    assert!(is_alike(&faults(&vec![white.clone(); 32])[0]));
    let alone = faults(&[white]);
    assert!(alone.len() == 1 && count(1)(&alone[0]), "{alone:?}");
}

#[test]
fn a_code_that_is_centred_is_named_where_it_is_not_stated() {
    // 160 columns of 256, from 48 on: at the right of the picture they are beyond 160.
    let code = wall_code();
    let centred = code.with_other_centre().unwrap();
    assert_eq!((centred.offset, centred.with_other_centre().as_ref()), ([48, 4], Some(&code)));
    for seed in 1..=2 {
        let far = Scene { projector: |x, y| [60.0 + 0.6 * x, 12.0 + 0.58 * y], ..wall(seed) };
        let found = examined(&code, &far.pictures(&centred));
        let [SetFault::OtherOrder { code: other }] = &found.faults[..] else { panic!("{:?}", found.faults) };
        assert_eq!((&other.order, other.offset), (&code.order, [48, 4]));
        assert!(examined(&centred, &far.pictures(&centred)).faults.is_empty());
    }
}

#[test]
fn rows_taken_for_columns_are_named() {
    // 160 columns need eight bits and 120 rows seven; with eight bits each, 160 columns do not fit 120 rows.
    let right = wall_code().with_bits([Some(8), Some(8)], false);
    let order = vec![Group::Stripes(Axis::Rows), Group::Stripes(Axis::Columns), Group::White, Group::Black];
    let wrong = StripeCode { order, projector: [160, 60], ..right.clone() }.with_bits([Some(8), Some(8)], false);
    let found = examined(&wrong, &wall(1).pictures(&right));
    let [SetFault::OtherOrder { code }] = &found.faults[..] else { panic!("{:?}", found.faults) };
    assert_eq!(code.order, right.order);
}
