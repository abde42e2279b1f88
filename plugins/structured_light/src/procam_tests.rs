//! Real pictures: three poses of a chessboard under Gray code, decoded and calibrated node by node.

use std::sync::Arc;

use foveate::prelude::*;
use foveate::scene::Calibration;

use crate::calibrator::{self, Calibrator, CalibratorSettings};
use crate::corners::{self, Corners, CornersSettings};
use crate::decoder::{self, Decoder, DecoderSettings};
use crate::pictures;

const CAMERAS: &str = r#"
[calibration]
length_unit = "m"
[camera.camera]
image_size_px = [1280, 1024]
focal_px = [3000.0, 3000.0]
principal_point_px = [639.5, 511.5]
position_m = [0.0, 0.0, 0.0]
camera_from_world_wxyz = [1.0, 0.0, 0.0, 0.0]
[camera.projector]
image_size_px = [1024, 768]
focal_px = [1800.0, 1800.0]
principal_point_px = [511.5, 383.5]
position_m = [0.0, 0.5, 0.0]
camera_from_world_wxyz = [1.0, 0.0, 0.0, 0.0]
"#;

#[test]
fn a_real_projector_is_calibrated_from_three_poses_of_a_board() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("projector calibration", "s11_procam_graycode") else {
        return;
    };
    let calibration = Calibration::from_toml(CAMERAS, std::path::Path::new("procam.toml")).unwrap();
    let setup = Setup { camera: Some(CameraId(0)), calibration: Arc::new(calibration), ..Setup::for_tests() };
    let mut decode = NodeBench::<Decoder>::with_setup(DecoderSettings::default(), &setup).unwrap();
    let board = CornersSettings { columns: 9, rows: 7, square_mm: 75.0, projector: "projector".into(), reach: 0.5 };
    let mut find = NodeBench::<Corners>::with_setup(board, &setup).unwrap();
    let settings = CalibratorSettings {
        columns: 9,
        rows: 7,
        square_mm: 75.0,
        projector: "projector".into(),
        file: "c.toml".into(),
    };
    let mut solve = NodeBench::<Calibrator>::with_setup(settings, &setup).unwrap();
    for (at, files) in pictures::sets(&folder.join("capture_*"), "*").unwrap().iter().enumerate() {
        let (time, set) = (Time::from_s(at as f64), pictures::read(files).unwrap().set);
        decode.feed(&decoder::PICTURES, time, set).unwrap();
        let white = decode.outputs(&decoder::WHITE).last().unwrap().value.clone();
        let map = decode.outputs(&decoder::MAP).last().unwrap().value.clone();
        find.feed(&corners::WHITE, time, Image::clone(&white)).unwrap();
        find.feed(&corners::MAP, time, ProjectorMap::clone(&map)).unwrap();
        solve.feed(&calibrator::MAP, time, ProjectorMap::clone(&map)).unwrap();
        for features in find.outputs(&corners::FEATURES).iter().rev().take(2) {
            solve.feed(&calibrator::FEATURES, time, Features::clone(&features.value)).unwrap();
        }
    }
    let report = decode.finish().unwrap();
    assert_eq!(report.remarks, Vec::<String>::new());
    assert!(report.figures["decoder.known_share.camera"] > 0.6);
    let report = solve.finish().unwrap();
    let figure = |name: &str| report.figures[name];
    // The board is bent by 2 mm at one corner of one set: what lies off the plane is rejected there.
    assert!(figure("both.used_px.rms") < 0.2, "{}", figure("both.used_px.rms"));
    assert!(figure("both.rms_px") < 0.45, "{}", figure("both.rms_px"));
    assert!(figure("projector.held_out_px.rms") < 0.45, "{}", figure("projector.held_out_px.rms"));
    assert!(figure("projector.held_out_px.worst") < 0.47, "{}", figure("projector.held_out_px.worst"));
    assert!(figure("flatness_mm.worst") < 0.65, "{}", figure("flatness_mm.worst"));
    // Its black squares send back fewer gray levels than the camera's noise needs.
    assert!(figure("coverage") > 0.5, "{}", figure("coverage"));
}

/// The first real set.
fn real_set(folder: &std::path::Path) -> PatternPictures {
    pictures::read(&pictures::sets(&folder.join("capture_0"), "*").unwrap()[0]).unwrap().set
}

/// What is said of a set, and the share of the pixels of it whose column and whose row are known.
fn decoded(set: PatternPictures) -> (String, [f64; 2]) {
    let n = f64::from(set.width * set.height);
    let (said, places) = mapped(set);
    let known = |axis: usize| places.iter().filter(|it| it[axis].is_finite()).count() as f64 / n;
    (said, [known(0), known(1)])
}

/// What is said of a set, and the column and the row of each pixel, row by row; none without a map.
fn mapped(set: PatternPictures) -> (String, Vec<[f64; 2]>) {
    let pattern = crate::PatternSettings { projector_px: [1024, 768], ..crate::PatternSettings::default() };
    let settings = DecoderSettings { pattern, ..DecoderSettings::default() };
    let mut bench = NodeBench::<Decoder>::new(settings).unwrap();
    bench.feed(&decoder::PICTURES, Time::ZERO, set).unwrap();
    let map = bench.outputs(&decoder::MAP).pop().map(|it| it.value);
    let gaps = bench.gaps(&decoder::MAP).into_iter().map(|it| it.reason);
    let said = gaps.chain(bench.finish().unwrap().remarks).collect::<Vec<_>>().join("; ");
    let places = map.iter().flat_map(|map| {
        let pixels = (0..map.height as usize).flat_map(|y| (0..map.width as usize).map(move |x| (x, y)));
        pixels.map(|(x, y)| map.get(x, y).coordinate.map(f64::from))
    });
    (said, places.collect())
}

/// What is done to the pictures of a set and their names.
type Change = dyn Fn(&mut Vec<Vec<u8>>, &mut Vec<String>);

#[test]
fn faults_of_a_real_set_are_named_and_no_other_picture() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("faults of a real set", "s11_procam_graycode") else { return };
    let whole = real_set(&folder);
    let n = (whole.width * whole.height) as usize;
    let (said, all) = decoded(whole.clone());
    assert!(said.is_empty() && all[0] > 0.3 && all[1] > 0.3, "{said} {all:?}");
    // With `columns` and `rows`: whether these are still decoded.
    let check = |change: &Change, expected: &[&str], columns: bool, rows: bool| {
        let mut pictures: Vec<Vec<u8>> = whole.pixels.chunks_exact(n).map(<[u8]>::to_vec).collect();
        let mut names = whole.names.clone();
        change(&mut pictures, &mut names);
        let (said, known) = decoded(PatternPictures { pixels: pictures.concat(), names, ..whole.clone() });
        assert!(expected.iter().all(|it| said.contains(it)), "{said} lacks one of {expected:?}");
        // One more says which axis is left out.
        let left_out = said.matches(", and points come from").count();
        assert_eq!(left_out, usize::from(columns != rows), "{said}");
        let worked_out = said.matches("reconstructed from the other picture").count();
        assert_eq!(
            said.matches("; ").count() + 1,
            expected.len() + left_out + worked_out,
            "{said} says more than {expected:?}"
        );
        let is_kept = |axis: usize| known[axis] > 0.8 * all[axis];
        assert_eq!([is_kept(0), is_kept(1)], [columns, rows], "{expected:?}: {known:?} of {all:?}");
    };
    let negative =
        |at: usize| move |it: &mut Vec<Vec<u8>>, _: &mut Vec<String>| it[at].iter_mut().for_each(|it| *it = 255 - *it);
    check(&negative(6), &["graycode_06.jpg` is a negative, expected bit 3 of the columns"], true, true);
    check(&negative(39), &["graycode_39.jpg` is a negative, expected bit 9 of the rows, inverse"], true, true);
    let drop = |at: usize| {
        move |it: &mut Vec<Vec<u8>>, names: &mut Vec<String>| {
            it.remove(at);
            names.remove(at);
        }
    };
    check(&drop(9), &["found 41 pictures", "no picture shows bit 4 of the columns, inverse"], true, true);
    check(&drop(38), &["found 41 pictures", "no picture shows bit 9 of the rows, expected after"], true, true);
    check(&drop(40), &["found 41 pictures", "no picture shows white"], true, true);
    let swap = |a: usize, b: usize| move |it: &mut Vec<Vec<u8>>, _: &mut Vec<String>| it.swap(a, b);
    check(&swap(5, 12), &["graycode_05.jpg` and `capture_0/graycode_12.jpg` are swapped"], true, true);
    check(&swap(22, 23), &["of the rows: picture and inverse are swapped"], true, true);
    let lose = |at: usize| {
        move |it: &mut Vec<Vec<u8>>, names: &mut Vec<String>| {
            it.drain(at..at + 2);
            names.drain(at..at + 2);
        }
    };
    let both = [
        "found 40 pictures",
        "no picture shows bit 3 of the columns, expected",
        "shows bit 3 of the columns, inverse",
        "bit 3 of the columns: both pictures are missing",
    ];
    check(&lose(6), &both, true, true);
    let double = |it: &mut Vec<Vec<u8>>, _: &mut Vec<String>| it[15] = it[14].clone();
    check(
        &double,
        &["graycode_15.jpg` shows the same stripes as `capture_0/graycode_14.jpg`, expected bit 7"],
        true,
        true,
    );
    let dark = |it: &mut Vec<Vec<u8>>, _: &mut Vec<String>| it[8].iter_mut().for_each(|it| *it /= 2);
    check(&dark, &["graycode_08.jpg` is 0.5"], true, true);
    let fading = |it: &mut Vec<Vec<u8>>, _: &mut Vec<String>| {
        for (at, picture) in it.iter_mut().enumerate() {
            picture.iter_mut().for_each(|it| *it = (f64::from(*it) * (1.0 - 0.3 * at as f64 / 41.0)).round() as u8);
        }
    };
    check(&fading, &["faded evenly, by 3"], true, true);
    // The board was put elsewhere in the middle of the set, or for one picture.
    let other = pictures::read(&pictures::sets(&folder.join("capture_1"), "*").unwrap()[0]).unwrap().set;
    let put = |from: usize, until: usize| {
        let pixels = other.pixels[from * n..until * n].to_vec();
        move |it: &mut Vec<Vec<u8>>, _: &mut Vec<String>| {
            it.splice(from..until, pixels.chunks_exact(n).map(<[u8]>::to_vec)).for_each(std::mem::drop);
        }
    };
    check(
        &put(25, 42),
        &["between `capture_0/graycode_24.jpg` and `capture_0/graycode_25.jpg` something moved"],
        true,
        false,
    );
    check(&put(12, 13), &["graycode_12.jpg` shows bit 6 of the columns on another scene"], true, true);
}

#[test]
fn missing_bits_of_a_real_set_are_decoded_rightly() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("missing bits", "s11_procam_graycode") else { return };
    let whole = real_set(&folder);
    let n = (whole.width * whole.height) as usize;
    let (_, all) = mapped(whole.clone());
    // Bits 3 and 5 of the columns, bit 4 of the rows.
    for at in [6, 10, 28] {
        let mut set = whole.clone();
        set.pixels.drain(at * n..(at + 2) * n);
        set.names.drain(at..at + 2);
        let (said, found) = mapped(set);
        let both = all.iter().zip(&found).filter(|(a, b)| a.iter().chain(*b).all(|it| it.is_finite()));
        let far = |(a, b): &(&[f64; 2], &[f64; 2])| (0..2).any(|axis| (a[axis] - b[axis]).abs() > 2.0);
        let (n_both, n_far) = (both.clone().count(), both.filter(far).count());
        assert!(n_far * 2000 < n_both && n_both * 3 > n, "{at}: {n_far} of {n_both} are elsewhere, {said}");
    }
}

#[test]
fn a_real_set_that_is_too_dark_is_refused_for_that_alone() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("a dark real set", "s11_procam_graycode") else { return };
    let mut set = real_set(&folder);
    set.pixels.iter_mut().for_each(|it| *it = (0.08 * f64::from(*it)) as u8);
    let (said, known) = decoded(set);
    assert!(said.contains("too dark"), "{said}");
    assert!(!said.contains("graycode_"), "names pictures: {said}");
    assert_eq!(known, [0.0; 2], "{said}");
}

#[test]
fn noise_is_no_fault_of_a_real_set() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("a noisy real set", "s11_procam_graycode") else { return };
    let mut set = real_set(&folder);
    let mut random = foveate::estimation::random::Random::new(5);
    set.pixels.iter_mut().for_each(|it| *it = (f64::from(*it) + 8.0 * random.normal()).round().clamp(0.0, 255.0) as u8);
    let (said, known) = decoded(set);
    assert!(said.is_empty() && known[0] > 0.1, "{said} {known:?}");
}

#[test]
fn a_camera_with_a_curved_response_costs_a_real_set_little() {
    let Some(folder) = foveate_testkit::data_dir_or_skip("a curved response", "s11_procam_graycode") else { return };
    let whole = real_set(&folder);
    let (_, all) = decoded(whole.clone());
    for power in [0.45, 0.6] {
        let mut set = whole.clone();
        let table: Vec<u8> = (0..256).map(|it| (255.0 * (f64::from(it) / 255.0).powf(power)).round() as u8).collect();
        set.pixels.iter_mut().for_each(|it| *it = table[usize::from(*it)]);
        let (said, known) = decoded(set);
        let exponent: f64 = said.rsplit("exponent ").next().unwrap().parse().unwrap();
        assert!((exponent * power - 1.0).abs() < 0.15, "{power}: {said}");
        assert_eq!(said.matches("; ").count(), 0, "{power}: {said}");
        assert!((0..2).all(|it| known[it] > 0.9 * all[it]), "{power}: {known:?} of {all:?}");
    }
}
