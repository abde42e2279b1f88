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

/// The faults of the wall's pictures after `change`, in words, and the axes that are left.
#[track_caller]
pub(super) fn check(change: impl Fn(&mut Vec<Vec<u8>>), expected: &[&str], usable: &[Axis]) {
    for seed in 1..=3 {
        let mut pictures = wall_set(seed);
        change(&mut pictures);
        let found = examined(&wall_code(), &pictures);
        let words: Vec<String> =
            found.faults.iter().map(|it| it.describe(&wall_code(), &|at| format!("`{at}.png`"))).collect();
        assert_eq!(words.len(), expected.len(), "seed {seed}: {words:#?}");
        for (words, expected) in words.iter().zip(expected) {
            assert!(words.contains(expected), "seed {seed}: {words} lacks {expected}");
        }
        assert_eq!(found.usable(&wall_code()), usable, "seed {seed}: {words:?}");
    }
}

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
    check(
        |it| drop(it.remove(7)),
        &[
            "found 31 pictures, expected 32 of this code for 160 x 120",
            "no picture shows bit 3 of the columns, inverse, expected after `6.png`",
        ],
        &Axis::BOTH,
    );
    // The coarsest bit of the rows, then white: there is light enough to tell without it.
    let by_way = "bit 0 of the rows is told from its inverse by the way in which columns and rows run";
    check(|it| drop(it.remove(16)), &["found 31", "no picture shows bit 0 of the rows", by_way], &Axis::BOTH);
    check(|it| drop(it.remove(30)), &["found 31", "no picture shows white, expected after `29.png`"], &Axis::BOTH);
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
    check(double, &["found 33 pictures", "shows bit 4 of the columns, inverse once more"], &Axis::BOTH);
}

#[test]
fn a_doubled_picture_is_named_and_what_it_stands_for_is_worked_out() {
    check(
        |it| it[9] = it[8].clone(),
        &["`9.png` shows the same stripes as `8.png`, expected bit 4 of the columns, inverse"],
        &Axis::BOTH,
    );
    // Which of the coarsest bit's two pictures is there is told by where its stripes are, and no other picture accused.
    check(|it| it[1] = it[0].clone(), &["`1.png` shows the same stripes as `0.png`"], &Axis::BOTH);
    let by_way = "bit 0 of the rows is told from its inverse by the way in which columns and rows run";
    check(|it| it[17] = it[16].clone(), &["`17.png` shows the same stripes as `16.png`", by_way], &Axis::BOTH);
    // The inverse of the coarsest bit once more in place of the next bit.
    check(
        |it| it[2] = it[1].clone(),
        &["`2.png` shows the same stripes as `1.png`, expected bit 1 of the columns"],
        &Axis::BOTH,
    );
    let twice = |it: &mut Vec<Vec<u8>>| it.insert(1, it[0].clone());
    check(twice, &["found 33 pictures", "shows bit 0 of the columns once more"], &Axis::BOTH);
}

#[test]
fn a_set_for_a_larger_projector_is_told_its_size() {
    for (made, stated, bits, words) in [
        (StripeCode::gray([160, 120]), StripeCode::gray([128, 120]), [8, 7], "129 to 256 x 65 to 128 px"),
        (StripeCode::gray([160, 120]), StripeCode::gray([128, 60]), [8, 7], "expected 7 and 6 bits for 128 x 60 px"),
        (StripeCode::phase([160, 120], 8, 8), StripeCode::phase([128, 120], 8, 8), [6, 5], "129 to 256 x 65 to 128 px"),
    ] {
        for seed in 1..=2 {
            let pictures = wall(seed).pictures(&made);
            let n = pictures.len();
            let found = examined(&stated, &pictures);
            assert_eq!(found.faults, [SetFault::OtherSize { bits, found: n }], "seed {seed}, {n} pictures");
            let said = found.faults[0].describe(&stated, &|at| at.to_string());
            assert!(said.contains(words), "{said}");
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
fn a_negative_is_named_and_accuses_no_other() {
    for negative in [0, 5, 14, 17, 28] {
        let name = format!("`{negative}.png` is a negative, expected bit {}", negative % 16 / 2);
        check(|it| it[negative].iter_mut().for_each(|it| *it = 255 - *it), &[&name], &Axis::BOTH);
    }
    let expected = ["`30.png` is a negative, expected white"];
    check(|it| it[30].iter_mut().for_each(|it| *it = 255 - *it), &expected, &Axis::BOTH);
}

#[test]
fn a_picture_of_another_exposure_is_named() {
    check(
        |it| it[6].iter_mut().for_each(|it| *it = (f64::from(*it) * 0.45).round() as u8),
        &["`6.png` is 0.4"],
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
        &["`5.png` is 0.70, `13.png` is 0.70, `24.png` is 0.70 times as bright as most pictures"],
        &Axis::BOTH,
    );
    check(|it| (18..32).for_each(|at| darker(it, at, 0.7)), &["more are of another exposure"], &Axis::BOTH);
    check(
        |it| (0..32).for_each(|at| darker(it, at, 1.0 - 0.01 * at as f64)),
        &["the light or the exposure faded evenly, by 3"],
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
fn a_saturated_set_accuses_no_picture() {
    check(
        |it| it.iter_mut().flatten().for_each(|it| *it = (4 * u16::from(*it)).min(255) as u8),
        &["of the lit pixels are saturated"],
        &Axis::BOTH,
    );
}

#[test]
fn a_dim_set_is_told() {
    // In which few pixels have contrast enough.
    check(|it| it.iter_mut().flatten().for_each(|it| *it /= 12), &["too dark: a longer exposure"], &Axis::BOTH);
}

#[test]
fn a_light_of_the_room_that_changes_is_no_want_of_light() {
    // It reaches the whole picture, the projector a third of it.
    for inverse in [Inverse::None, Inverse::After] {
        let code = StripeCode { inverse, ..wall_code() };
        for seed in 1..=3 {
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
        let name = format!("between `{last}.png` and `{first}.png` something moved");
        let replace = |it: &mut Vec<Vec<u8>>| it.splice(first.., moved_wall(4).split_off(first)).for_each(drop);
        check(replace, &[&name], &[usable]);
    }
}

#[test]
fn one_picture_of_another_scene_is_named_and_worked_out() {
    check(
        |it| it[12] = moved_wall(5).swap_remove(12),
        &["`12.png` shows bit 6 of the columns on another scene"],
        &Axis::BOTH,
    );
    check(
        |it| it[21] = moved_wall(5).swap_remove(21),
        &["`21.png` shows bit 2 of the rows, inverse on another scene"],
        &Axis::BOTH,
    );
}

#[test]
fn pictures_for_a_projector_of_another_size_are_told() {
    // One bit more, or one less, than the pictures have.
    for projector in [[160, 60], [300, 60]] {
        let found = examined(&StripeCode::gray(projector), &wall_set(1));
        assert_eq!(found.faults, [SetFault::OtherSize { bits: [8, 7], found: 30 + 2 }], "{projector:?}");
        assert!(found.usable(&StripeCode::gray(projector)).is_empty());
    }
    // Both pictures of one bit may lack as well: the other axis is as it should be.
    let code = StripeCode::gray([300, 120]);
    let found = examined(&code, &wall_set(1));
    let words: Vec<String> = found.faults.iter().map(|it| it.describe(&code, &|_| String::new())).collect();
    assert!(words[1].contains("2 pictures are missing") && words[1].contains("at most 256 columns"), "{words:?}");
    assert_eq!(found.usable(&code), [Axis::Rows]);
}

#[test]
fn pictures_in_each_others_places_are_named_and_taken_for_each_other() {
    check(|it| it.swap(6, 7), &["of the columns: picture and inverse are exchanged, and taken for each"], &Axis::BOTH);
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
    check(spoil, &["exchanged"], &[Axis::Rows]);
}

#[test]
fn another_order_is_recognised() {
    let swap_all = |it: &mut Vec<Vec<u8>>| (0..15).for_each(|pair| it.swap(2 * pair, 2 * pair + 1));
    check(swap_all, &["they fit order = \"columns rows white black\", inverse = \"before\""], &[]);
    check(|it| it.rotate_right(2), &["they fit order = \"white black columns rows\", inverse = \"after\""], &[]);
    check(
        |it| it.reverse(),
        &["they fit order = \"black white rows columns\", inverse = \"before\", fine_first = true"],
        &[],
    );
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
    let said: Vec<String> = found.faults.iter().map(|it| it.describe(&wall_code(), &|at| at.to_string())).collect();
    assert!(
        said.len() == 1 && said[0].contains("order = \"columns rows white black\", inverse = \"last\""),
        "{said:?}"
    );
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
    let expected = ["`4.png` and `10.png` stand in each other's places", "`5.png` and `11.png`"];
    check(exchange(4, 10), &expected, &Axis::BOTH);
    check(exchange(6, 8), &["`6.png` and `8.png`", "`7.png` and `9.png`"], &Axis::BOTH);
    check(exchange(6, 22), &["`6.png` and `22.png`", "`7.png` and `23.png`"], &Axis::BOTH);
    check(|it| it.swap(3, 12), &["`3.png` and `12.png` stand in each other's places"], &Axis::BOTH);
    check(|it| it.swap(20, 30), &["`20.png` and `30.png` stand in each other's places"], &Axis::BOTH);
}

#[test]
fn a_dropped_frame_is_named_and_pictures_are_known_where_they_stand() {
    // From picture 11 on, each is the one before.
    let drop_frame = |it: &mut Vec<Vec<u8>>| {
        let again = it[10].clone();
        it.insert(11, again);
        it.pop();
    };
    check(drop_frame, &["shows bit 5 of the columns once more", "no picture shows black"], &Axis::BOTH);
}

#[test]
fn noise_is_no_fault() {
    for seed in 1..=3 {
        let noisy = Scene { noise: 8.0, ..wall(seed) };
        let found = examined(&wall_code(), &noisy.pictures(&wall_code()));
        assert_eq!(found.faults, [], "seed {seed}");
        assert!((6.0..9.5).contains(&found.noise), "{}", found.noise);
    }
}

#[test]
fn pictures_that_could_not_be_read_accuse_no_other() {
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
fn white_and_black_exchanged_are_told() {
    check(|it| it.swap(30, 31), &["`30.png` is darker than `31.png`"], &Axis::BOTH);
    let mut pictures = wall_set(1);
    pictures.swap(30, 31);
    let found = examined(&wall_code(), &pictures);
    assert_eq!([30, 31].map(|it| found.picture_at(it)), [Some(31), Some(30)]);
}

#[test]
fn white_of_another_scene_is_left_out_where_inverse_pictures_tell_what_is_lit() {
    let spoil = |it: &mut Vec<u8>| it.chunks_exact_mut(160).for_each(|row| row[..100].fill(10));
    let other = |it: &mut Vec<Vec<u8>>| spoil(&mut it[30]);
    check(other, &["`30.png` is not the brightest picture in"], &Axis::BOTH);
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
        let words: Vec<String> =
            found.faults.iter().map(|it| it.describe(&wall_code(), &|at| format!("`{at}.png`"))).collect();
        let said = words.join("; ");
        assert!(said.contains(&format!("found {n} pictures")), "{said}");
        assert!(said.contains("no picture shows all stripes of the rows, of which there should be 14"), "{said}");
        // The picture of the rows is neither white nor black.
        assert_eq!(
            ["no picture shows black", "`16.png` has no place"].map(|it| said.contains(it)),
            [!is_whole; 2],
            "{said}"
        );
        assert_eq!((found.usable(&wall_code()), words.len() == 2), (vec![Axis::Columns], is_whole), "{said}");
    }
}

#[test]
fn which_axis_is_which_is_told_by_the_looks_of_stripes_where_both_have_as_many_bits() {
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
    let [fault @ SetFault::OtherOrder { .. }] = &found.faults[..] else { panic!("{:?}", found.faults) };
    assert!(fault.describe(&code, &|_| String::new()).contains("order = \"rows columns white black\""), "{fault:?}");
    assert_eq!((examined(&pictures).faults, found.usable(&code)), (vec![], vec![]));
}

#[test]
fn a_set_without_inverse_pictures_is_told_the_setting_that_it_needs() {
    let alone = StripeCode { inverse: Inverse::None, ..wall_code() };
    let found = examined(&wall_code(), &wall(1).pictures(&alone));
    let [fault @ SetFault::OtherOrder { .. }] = &found.faults[..] else { panic!("{:?}", found.faults) };
    assert!(fault.describe(&wall_code(), &|_| String::new()).contains("inverse = \"none\""), "{fault:?}");
}

#[test]
fn stripes_as_fine_as_two_pixels_are_put_in_order() {
    let code = StripeCode::gray([256, 192]);
    for seed in 1..=3 {
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
        let [fault @ SetFault::OtherOrder { .. }] = &found.faults[..] else {
            panic!("seed {seed}: {:?}", found.faults)
        };
        assert!(
            fault.describe(&code, &|_| String::new()).contains("order = \"white black columns rows\""),
            "{fault:?}"
        );
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
fn dark_and_bright_scenes_are_told() {
    let faults = |scene: Scene| {
        let found = examined(&wall_code(), &scene.pictures(&wall_code()));
        let words: Vec<String> =
            found.faults.iter().map(|it| it.describe(&wall_code(), &|at| at.to_string())).collect();
        words.join("; ")
    };
    assert!(faults(Scene { gain: 3.0, ..wall(1) }).contains("too dark"));
    assert!(faults(Scene { gain: 900.0, ..wall(1) }).contains("too bright"));
    assert!(faults(Scene { ambient: 2000.0, ..wall(1) }).contains("too bright"));
}

#[test]
fn pictures_without_stripes_are_not_called_dark() {
    let faults = |pictures: &[Vec<u8>]| {
        let found = examined(&wall_code(), pictures);
        assert_eq!(found.usable(&wall_code()), [], "{:?}", found.faults);
        found.faults.iter().map(|it| it.describe(&wall_code(), &|at| at.to_string())).collect::<Vec<String>>()
    };
    let mut chance = foveate_estimation::Random::new(3);
    for sigma in [2.0, 8.0, 60.0] {
        let mut level = |_| (90.0 + sigma * chance.normal()).round().clamp(0.0, 255.0) as u8;
        let noise: Vec<Vec<u8>> = (0..32).map(|_| (0..160 * 120).map(&mut level).collect()).collect();
        let words = faults(&noise);
        assert!(words.len() == 1 && words[0].contains("no picture shows stripes"), "{sigma}: {words:?}");
    }
    let white = wall_set(1)[30].clone();
    assert!(faults(&vec![white.clone(); 32])[0].contains("no picture shows stripes"));
    let alone = faults(&[white]);
    assert!(alone.len() == 1 && alone[0].starts_with("found 1 picture, expected 32"), "{alone:?}");
}

#[test]
fn a_code_that_is_centred_is_told_where_nothing_says_so() {
    // 160 columns of 256, from 48 on: at the right of the picture they are beyond 160.
    let code = wall_code();
    let centred = code.with_other_centre().unwrap();
    assert_eq!((centred.offset, centred.with_other_centre().as_ref()), ([48, 4], Some(&code)));
    for seed in 1..=2 {
        let far = Scene { projector: |x, y| [60.0 + 0.6 * x, 12.0 + 0.58 * y], ..wall(seed) };
        let found = examined(&code, &far.pictures(&centred));
        let [fault] = &found.faults[..] else { panic!("{:?}", found.faults) };
        let words = fault.describe(&code, &|at| at.to_string());
        assert!(words.ends_with("all fit `centred = true`"), "{words}");
        assert!(examined(&centred, &far.pictures(&centred)).faults.is_empty());
    }
}

#[test]
fn rows_taken_for_columns_are_told() {
    // 160 columns need eight bits and 120 rows seven; with eight bits each, 160 columns do not fit 120 rows.
    let right = wall_code().with_bits([Some(8), Some(8)], false);
    let order = vec![Group::Stripes(Axis::Rows), Group::Stripes(Axis::Columns), Group::White, Group::Black];
    let wrong = StripeCode { order, projector: [160, 60], ..right.clone() }.with_bits([Some(8), Some(8)], false);
    let found = examined(&wrong, &wall(1).pictures(&right));
    let [SetFault::OtherOrder { code }] = &found.faults[..] else { panic!("{:?}", found.faults) };
    assert_eq!(code.order, right.order);
}
