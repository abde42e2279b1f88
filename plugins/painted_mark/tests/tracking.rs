//! The tracker of painted marks on rendered sequences with known truth.

mod support;

use foveate::messages::{Features, GuidedMark, Image, Interval, PixelFormat, Time, Window};
use foveate_painted_mark::tracker::{Correction, MarkTracker, TrackerSettings};
use nalgebra::{Matrix2, Point2, Vector2};
use support::{HEIGHT, Names, Play, Score, Sequence, WIDTH, run};

/// Follows through `n` pictures; none may be wrong, and this part of those that can be seen well has to be named.
#[track_caller]
fn check(play: Play, n: usize, names: Names, least_seen: f64) -> Score {
    let score = run(&mut Sequence::new(play, n, 7), TrackerSettings::default(), names);
    let seen = score.seen as f64 / score.visible as f64;
    assert_eq!((score.wrong, score.swapped), (0, 0), "wrong as found of {}", score.named);
    assert!(seen >= least_seen, "{seen} of those that could be seen");
    score
}

#[test]
fn marks_chosen_by_hand_are_followed_on_a_surface_that_turns_and_deforms() {
    let score = check(Play::default(), 60, Names::ByHand, 0.95);
    assert!(score.rms_px < 0.05, "{} px", score.rms_px);
    assert!((0.5..1.5).contains(&score.consistency), "errors are {} of what is said", score.consistency);
}

#[test]
fn fifty_pixels_a_picture_are_usual() {
    let score = check(Play { speed_px: 50.0, ..Play::default() }, 60, Names::ByHand, 0.95);
    assert_eq!(score.median_length(), 60);
}

#[test]
fn pictures_without_a_mark_to_be_seen_are_bridged() {
    let score = check(Play { speed_px: 9.0, blur_every: 12, ..Play::default() }, 60, Names::ByHand, 0.93);
    assert_eq!(score.median_length(), 60);
}

#[test]
fn who_was_hidden_gets_its_name_again_from_the_guide() {
    check(Play { passer: true, speed_px: 6.0, ..Play::default() }, 90, Names::ByGuide, 0.93);
}

#[test]
fn dots_get_their_names_from_the_guide() {
    let score = check(Play::default(), 30, Names::ByGuide, 0.95);
    assert!(score.unnamed <= 80, "{} without a name, of which 69 in the first picture", score.unnamed);
}

#[test]
fn without_checks_hidden_marks_are_reported_and_errors_add_up() {
    let play = Play { passer: true, speed_px: 6.0, ..Play::default() };
    let with = run(&mut Sequence::new(play.clone(), 60, 7), TrackerSettings::default(), Names::ByHand);
    let as_paper = TrackerSettings { checks: false, reanchor: false, find: false, ..TrackerSettings::default() };
    let without = run(&mut Sequence::new(play, 60, 7), as_paper, Names::ByHand);
    assert_eq!(with.wrong, 0);
    assert!(without.wrong > 100, "{}", without.wrong);
    assert!(without.rms_px > 3.0 * with.rms_px, "{} and {} px", without.rms_px, with.rms_px);
    // Marks were chosen to the pixel, and nothing puts them right: what is said has to hold that.
    assert!((0.3..1.5).contains(&without.consistency), "errors are {} of what is said", without.consistency);
}

fn mark_tracker(corrections: Vec<Correction>) -> MarkTracker {
    MarkTracker::new(TrackerSettings::default(), corrections, None).unwrap()
}

fn label_at(features: &Features, place: Point2<f64>) -> Option<u32> {
    let near = features.list.iter().find(|it| (it.centre - place).norm() < 2.0);
    near.and_then(|it| it.label)
}

#[test]
fn a_correction_puts_a_mark_right_or_ends_it_at_its_picture() {
    let mut sequence = Sequence::new(Play::default(), 12, 7);
    let (truth, mut features) = (sequence.truth(5), Features::default());
    let row = |frame, mark, pixel| Correction { frame, mark, pixel };
    let mut corrections = vec![row(0, 3, Some(sequence.truth(0)[3].0)), row(0, 4, Some(sequence.truth(0)[4].0))];
    corrections.extend([row(5, 3, Some(truth[8].0 + Vector2::new(1.0, -1.0))), row(5, 4, None)]);
    let mut mark_tracker = mark_tracker(corrections);
    for t in 0..8 {
        mark_tracker.see(&sequence.picture(t), Sequence::stamp(t), None, &mut features).unwrap();
        let truth = sequence.truth(t);
        let expected = if t < 5 { (3, Some(4)) } else { (8, None) };
        assert_eq!(label_at(&features, truth[expected.0].0), Some(3), "picture {t}");
        assert_eq!(label_at(&features, truth[4].0), expected.1, "picture {t}");
        assert_eq!(features.list.iter().filter(|it| it.label == Some(3)).count(), 1);
    }
}

fn guided(label: u32, pixel: Point2<f64>) -> GuidedMark {
    GuidedMark { label, pixel, covariance: Matrix2::identity() * 0.25, disputed: false }
}

#[test]
fn a_disputed_mark_is_dropped_at_once_and_an_ambiguous_place_gives_no_name() {
    let mut sequence = Sequence::new(Play { speed_px: 20.0, ..Play::default() }, 12, 7);
    let (mut mark_tracker, mut features) = (mark_tracker(vec![]), Features::default());
    let mut see = |t: usize, guide: &[GuidedMark]| {
        let guide = (!guide.is_empty()).then(|| (Sequence::stamp(t - 1).time, guide));
        mark_tracker.see(&sequence.picture(t), Sequence::stamp(t), guide, &mut features).unwrap();
        (features.clone(), sequence.truth(t))
    };
    let (first, truth) = see(0, &[]);
    assert!(first.list.iter().all(|it| it.label.is_none()) && first.list.len() > 50);
    // Carried on by the motion of the whole: none has a name yet.
    let others = (6..12).map(|it| guided(20 + it as u32, truth[it].0));
    let guide: Vec<_> = [guided(5, truth[0].0), guided(9, truth[1].0)].into_iter().chain(others).collect();
    let (named, now) = see(1, &guide);
    assert_eq!((label_at(&named, now[0].0), label_at(&named, now[1].0)), (Some(5), Some(9)));
    let (disputed, now) = see(2, &[GuidedMark { disputed: true, ..guided(5, now[0].0) }, guided(9, now[1].0)]);
    assert_eq!((label_at(&disputed, now[0].0), label_at(&disputed, now[1].0)), (None, Some(9)));
    // Two marks that both may be the dot, and a mark between two dots.
    let beside = Vector2::new(1.0, 0.0);
    let between = now[2].0 + (now[3].0 - now[2].0) / 2.0;
    let guide = [guided(7, now[4].0 + beside), guided(8, now[4].0 - beside), guided(6, between)];
    let (ambiguous, now) = see(3, &guide);
    assert_eq!(label_at(&ambiguous, now[4].0), None);
    assert!(!ambiguous.list.iter().any(|it| [6, 7, 8].iter().any(|label| it.label == Some(*label))));
    // What is no number, or far out of the picture, names nobody; a time that nobody remembers neither.
    let bad = [guided(1, Point2::new(f64::NAN, 3.0)), guided(2, Point2::new(1e300, -1e300))];
    let (bad, now) = see(4, &bad);
    assert!(!bad.list.iter().any(|it| it.label.is_some_and(|it| it < 3)));
    let guide = [guided(4, now[5].0)];
    mark_tracker
        .see(&sequence.picture(5), Sequence::stamp(5), Some((Time::from_s(99.0), &guide)), &mut features)
        .unwrap();
    assert!(!features.list.iter().any(|it| it.label == Some(4)));
}

#[test]
fn a_dot_beside_where_a_mark_should_be_is_that_mark_only_if_others_see_it() {
    for (sigma, is_named) in [(0.2, true), (2.0, false)] {
        let mut sequence = Sequence::new(Play::default(), 12, 7);
        let (mut mark_tracker, mut features) = (mark_tracker(vec![]), Features::default());
        let mut see = |t: usize, guide: &[GuidedMark]| {
            let guide = (!guide.is_empty()).then(|| (Sequence::stamp(t - 1).time, guide));
            mark_tracker.see(&sequence.picture(t), Sequence::stamp(t), guide, &mut features).unwrap();
            (features.clone(), sequence.truth(t))
        };
        let others =
            |truth: &[(Point2<f64>, bool)]| (1..12).map(|it| guided(20 + it as u32, truth[it].0)).collect::<Vec<_>>();
        let (_, truth) = see(0, &[]);
        let (_, truth) = see(1, &others(&truth));
        // The others have names by now, and say how the surface moved.
        let beside = truth[0].0 + Vector2::new(2.7, 0.0);
        let hidden = GuidedMark { covariance: Matrix2::identity() * sigma * sigma, ..guided(5, beside) };
        let guide: Vec<GuidedMark> = others(&truth).into_iter().chain([hidden]).collect();
        let (named, truth) = see(2, &guide);
        assert_eq!(label_at(&named, truth[0].0), is_named.then_some(5), "known to {sigma} px");
        assert_eq!(label_at(&named, truth[3].0), Some(23));
    }
}

#[test]
fn a_guide_of_the_first_of_several_cameras_is_for_the_picture_next_to_its_time() {
    for (early_ms, is_heeded) in [(0.0, true), (5.0, true), (-5.0, false)] {
        let mut sequence = Sequence::new(Play { speed_px: 20.0, ..Play::default() }, 12, 7);
        let (mut mark_tracker, mut features) = (mark_tracker(vec![]), Features::default());
        mark_tracker.see(&sequence.picture(0), Sequence::stamp(0), None, &mut features).unwrap();
        mark_tracker.see(&sequence.picture(1), Sequence::stamp(1), None, &mut features).unwrap();
        let guide: Vec<_> = (0..).zip(sequence.truth(1)).map(|(label, it)| guided(label, it.0)).collect();
        let time = Sequence::stamp(1).time - Interval::from_ms(early_ms);
        mark_tracker.see(&sequence.picture(2), Sequence::stamp(2), Some((time, &guide)), &mut features).unwrap();
        let truth = sequence.truth(2);
        let right = (0..12).filter(|it| label_at(&features, truth[*it].0) == Some(*it as u32)).count();
        assert_eq!(right > 8, is_heeded, "{early_ms} ms early: {right}");
    }
}

#[test]
fn parts_of_pictures_and_colour_give_the_same_marks() {
    let mut sequence = Sequence::new(Play::default(), 6, 7);
    let corrections = sequence.by_hand();
    let (mut whole, mut part, mut colour) =
        (mark_tracker(corrections.clone()), mark_tracker(corrections.clone()), mark_tracker(corrections));
    let [mut in_whole, mut in_part, mut in_colour] = [(); 3].map(|()| Features::default());
    for t in 0..6 {
        let (image, stamp) = (sequence.picture(t), Sequence::stamp(t));
        whole.see(&image, stamp, None, &mut in_whole).unwrap();
        // A part that moves.
        let (left, top, width, height) = (60 + 3 * t, 10 + t, 300, 280);
        let rows = (top..top + height).flat_map(|y| &image.pixels[y * WIDTH + left..][..width]);
        let window = Window { left: left as u32, top: top as u32, shrink: 1 };
        let pixels = rows.copied().collect();
        let cut = Image { width: width as u32, height: height as u32, window, pixels, ..image.clone() };
        part.see(&cut, stamp, None, &mut in_part).unwrap();
        let pixels = image.pixels.iter().flat_map(|it| [*it; 3]).collect();
        let rgb = Image { format: PixelFormat::Rgb8, pixels, ..image };
        colour.see(&rgb, stamp, None, &mut in_colour).unwrap();
        assert_eq!(in_colour.list, in_whole.list);
        let named = |it: &Features| it.list.iter().filter(|it| it.label.is_some()).count();
        assert!(named(&in_part) >= named(&in_whole) - 4, "{} of {}", named(&in_part), named(&in_whole));
        for feature in in_part.list.iter().filter(|it| it.label.is_some()) {
            if let Some(same) = in_whole.list.iter().find(|it| it.label == feature.label) {
                assert!((same.centre - feature.centre).norm() < 0.05, "picture {t}: {same:?} {feature:?}");
            }
        }
    }
}

#[test]
fn marks_of_a_colour_are_found_where_the_surface_is_as_bright() {
    // Green dots on red, of the same luma.
    let (surface, paint) = ([150u8, 60, 60], [31u8, 120, 60]);
    let centre = Point2::new(40.3, 30.6);
    let pixels = (0..80 * 60).flat_map(|i| {
        let offset = Point2::new(f64::from(i % 80), f64::from(i / 80)) - centre;
        let part = (2.5 - offset.norm()).clamp(0.0, 1.0);
        [0, 1, 2].map(|k| (f64::from(surface[k]) * (1.0 - part) + f64::from(paint[k]) * part).round() as u8)
    });
    let image =
        Image { width: 80, height: 60, format: PixelFormat::Rgb8, pixels: pixels.collect(), ..Image::default() };
    let found = |colour| {
        let settings = TrackerSettings { colour, ..TrackerSettings::default() };
        let (mut mark_tracker, mut features) = (MarkTracker::new(settings, vec![], None).unwrap(), Features::default());
        mark_tracker.see(&image, Sequence::stamp(0), None, &mut features).unwrap();
        features.list.iter().map(|it| it.centre).collect::<Vec<_>>()
    };
    assert_eq!(found(None), []);
    let dots = found(Some(paint));
    assert!(dots.len() == 1 && (dots[0] - centre).norm() < 0.1, "{dots:?}");
}

#[test]
fn bad_pictures_are_passed_over_and_other_sizes_begin_anew() {
    let mut sequence = Sequence::new(Play::default(), 6, 7);
    let (mut mark_tracker, mut features) = (mark_tracker(sequence.by_hand()), Features::default());
    let mut see = |image: &Image, t: usize| {
        let seen = mark_tracker.see(image, Sequence::stamp(t), None, &mut features);
        seen.map(|()| features.list.iter().filter(|it| it.label.is_some()).count())
    };
    assert!(see(&sequence.picture(0), 0).unwrap() > 60);
    let broken = Image { pixels: vec![0; 7], ..sequence.picture(1) };
    assert!(see(&broken, 1).is_err_and(|it| it.contains("7 bytes, expected 120000")));
    assert!(see(&sequence.picture(2), 2).unwrap() > 60, "a picture is missing");
    for (width, height) in [(0, 0), (0, 9), (1, 1), (10, 3), (14, 14), (40, 30)] {
        let pixels = vec![100; (width * height) as usize];
        let small = Image { width, height, pixels, ..Image::default() };
        assert_eq!(see(&small, 3), Ok(0), "{width} x {height}");
        assert_eq!(see(&small, 3), Ok(0), "{width} x {height}");
    }
    assert_eq!(see(&sequence.picture(4), 4), Ok(0), "names are not guessed");
    let flat = Image { pixels: vec![128; WIDTH * HEIGHT], ..sequence.picture(5) };
    assert_eq!(see(&flat, 5), Ok(0));
}

#[test]
fn a_mark_without_a_dot_is_followed_by_its_patch() {
    // The middle of three dots is no dot.
    let mut sequence = Sequence::new(Play { turn: 0.1, ..Play::default() }, 30, 7);
    let truth = sequence.truth(0);
    let middle = |truth: &[(Point2<f64>, bool)], [a, b]: [usize; 2]| truth[a].0 + (truth[b].0 - truth[a].0) / 2.0;
    let near = |a: usize, b: usize| (truth[a].0 - truth[b].0).norm();
    let pairs: Vec<[usize; 2]> = (0..truth.len())
        .flat_map(|a| (0..a).map(move |b| [a, b]))
        .filter(|[a, b]| near(*a, *b) < 14.0)
        .take(8)
        .collect();
    let rows = (0..).zip(&pairs);
    let corrections = rows.map(|(mark, it)| Correction { frame: 0, mark, pixel: Some(middle(&truth, *it)) }).collect();
    let settings = TrackerSettings { find: false, ..TrackerSettings::default() };
    let mut mark_tracker = MarkTracker::new(settings, corrections, None).unwrap();
    let mut features = Features::default();
    let mut n = 0;
    for t in 0..30 {
        mark_tracker.see(&sequence.picture(t), Sequence::stamp(t), None, &mut features).unwrap();
        let truth = sequence.truth(t);
        for feature in &features.list {
            let pair = pairs[feature.label.unwrap() as usize];
            let error = (feature.centre - middle(&truth, pair)).norm();
            assert!(error < 1.0, "picture {t}: {error} px");
            n += 1;
        }
    }
    assert!(n > 7 * 30, "{n}");
}

/// Prints a row a case: `cargo test -p foveate-painted-mark --test tracking how_long -- --nocapture`.
#[test]
fn how_long_marks_live_and_how_many_are_wrong() {
    let fast = Play { speed_px: 50.0, ..Play::default() };
    let mut n_named = 0;
    for (name, play, names) in [
        ("3 px a picture", Play::default(), Names::ByHand),
        ("50 px a picture", fast.clone(), Names::ByHand),
        ("the same, 2 of 25 blurred", Play { blur_every: 25, ..fast.clone() }, Names::ByHand),
        ("something passes before it", Play { passer: true, speed_px: 6.0, ..Play::default() }, Names::ByHand),
        ("the same, with a guide", Play { passer: true, speed_px: 6.0, ..Play::default() }, Names::ByGuide),
        ("dots 9 px apart, turns by 0.5 rad", Play { apart_px: 9.0, turn: 0.5, ..fast }, Names::ByHand),
    ] {
        let score = run(&mut Sequence::new(play.clone(), 120, 11), TrackerSettings::default(), names);
        println!(
            "{name}: {} named, {} wrong, {} on another mark, {:.1} % of the visible, rms {:.3} px, median length {} of 120",
            score.named,
            score.wrong,
            score.swapped,
            100.0 * score.seen as f64 / score.visible as f64,
            score.rms_px,
            score.median_length()
        );
        assert_eq!((score.wrong, score.swapped), (0, 0), "{name}");
        n_named += score.named;
    }
    assert!(n_named > 20_000, "{n_named}");
}
