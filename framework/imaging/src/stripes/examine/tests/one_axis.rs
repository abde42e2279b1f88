//! What is wrong with one axis leaves the other as it is.

use super::super::super::code::Inverse;
use super::super::super::faults::Found;
use super::*;

#[test]
fn a_black_or_white_picture_in_a_set_without_inverse_pictures_is_named_and_the_other_axis_kept() {
    let code = StripeCode { inverse: Inverse::None, ..wall_code() };
    let whole = wall(1).pictures(&code);
    for seed in 1..=3 {
        for (axis, plane) in [Axis::Columns, Axis::Rows].into_iter().flat_map(|axis| (2..6).map(move |it| (axis, it))) {
            for as_shown in [Shown::White, Shown::Black] {
                let mut pictures = wall(seed).pictures(&code);
                let place = code.place(Shown::Bit { axis, plane, inverse: false }).unwrap();
                pictures[place].clone_from(&whole[code.place(as_shown).unwrap()]);
                let found = examined(&code, &pictures);
                let about = format!("seed {seed}, bit {plane} of {axis:?} {as_shown}: {:?}", found.faults);
                let is_it = |it: &SetFault| matches!(it, SetFault::Shows { picture, found: Found::Shown(it), .. } if *picture == place && *it == as_shown);
                assert!(found.faults.iter().any(is_it), "{about}");
                assert!(found.usable(&code).contains(&Axis::BOTH[1 - axis.index()]), "{about}");
                let is_whole = found.usable(&code).contains(&axis);
                let is_worked_out = found.faults.iter().any(|it| matches!(it, SetFault::Unfolded { .. }));
                assert!(!is_whole || is_worked_out, "{about}");
            }
        }
    }
}

#[test]
fn what_is_wrong_with_one_axis_names_no_picture_of_the_other() {
    // A frame that was dropped, a bit inverted, two bits in each other's places; stripes that are hardly resolved.
    let cases = [(Inverse::None, 2, 5), (Inverse::After, 3, 4)];
    for (inverse, seed, plane) in cases {
        let code = StripeCode { inverse, ..wall_code() };
        let whole = Scene { blur: 1.3, ..wall(seed) }.pictures(&code);
        let [white, black] = [Shown::White, Shown::Black].map(|it| &whole[code.place(it).unwrap()]);
        for axis in Axis::BOTH {
            let other = Axis::BOTH[1 - axis.index()];
            let place = |plane| code.place(Shown::Bit { axis, plane, inverse: false }).unwrap();
            let [at, before] = [place(plane), place(plane - 1)];
            let levels = whole[at].iter().zip(white).zip(black);
            let turned = levels.map(|((it, white), black)| white.saturating_sub(*it).saturating_add(*black)).collect();
            let changes: [Vec<(usize, Vec<u8>)>; 3] = [
                vec![(at, whole[before].clone())],
                vec![(at, turned)],
                vec![(at, whole[before].clone()), (before, whole[at].clone())],
            ];
            for (change, others) in changes.into_iter().enumerate() {
                let mut pictures = whole.clone();
                others.into_iter().for_each(|(at, picture)| pictures[at] = picture);
                let found = examined(&code, &pictures);
                let about = format!("{inverse:?}, seed {seed}, {axis:?} {plane}, change {change}: {:?}", found.faults);
                let is_other = |it: &SetFault| it.axes().is_some_and(|it| it.contains(&other));
                assert!(!found.faults.is_empty() && !found.faults.iter().any(is_other), "{about}");
                assert!(found.usable(&code).contains(&other), "{about}");
            }
        }
    }
}

#[test]
fn many_bits_out_of_place_spoil_both_axes_and_few_their_own() {
    let usable = |n: u32| {
        let fault = SetFault::OutOfPlace { axis: Axis::Columns, planes: (1..=n).collect() };
        let places = (0..wall_code().pictures().len()).map(Some).collect();
        Examination { faults: vec![fault], places, ..Examination::default() }.usable(&wall_code())
    };
    assert_eq!(usable(4), [Axis::Rows]);
    assert_eq!(usable(5), []);
}

#[test]
fn a_shadow_is_known_from_an_axis_that_cannot_be_decoded() {
    let code = StripeCode { inverse: Inverse::None, ..wall_code() };
    let lit = Scene { shadow: |_, _| false, ..wall(3) };
    // A shadow moves off between columns and rows, and one of the columns' pictures is black.
    let mut pictures = lit.pictures(&code);
    pictures[..8].clone_from_slice(&wall(3).pictures(&code)[..8]);
    pictures[5].fill(14);
    let found = examined(&code, &pictures);
    assert_eq!(found.usable(&code), [Axis::Rows], "{:?}", found.faults);
    let views: Vec<ImageView<'_>> = pictures.iter().map(|it| ImageView::new(it, 160, 120).unwrap()).collect();
    let dark = found.dark_in(&code, &views, Axis::Columns);
    let n_dark = |columns: std::ops::Range<usize>| {
        (0..160 * 120).filter(|at| columns.contains(&(at % 160)) && dark[*at]).count()
    };
    assert!(
        n_dark(87..90) == 3 * 120 && n_dark(0..86) + n_dark(91..160) == 0,
        "{} and {}",
        n_dark(87..90),
        n_dark(0..160)
    );
    // With inverse pictures shadows show by themselves.
    assert_eq!(found.dark_in(&wall_code(), &views, Axis::Columns), []);
}
