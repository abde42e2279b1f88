//! Sets of a small projector, whole and spoilt, decoded.

use foveate::imaging::stripes::code::Axis;
use foveate::imaging::stripes::phase::Steps;

use super::*;

/// Camera pixels in a row and in a column of each pixel of the projector.
const SCALE: usize = 4;
/// Pixels of a picture.
const PIXELS: usize = 64 * 48 * SCALE * SCALE;

/// A set whose camera sees each pixel of a small projector on 4 × 4 of its own, in gray levels 20 to 220.
fn set(code: &StripeCode) -> PatternPictures {
    let [width, height] = code.projector;
    let columns = width as usize;
    let seen = |it: &Shown| {
        let shown = foveate::imaging::stripes::pattern::picture(code, *it, 1.0);
        let rows = (0..height as usize * SCALE).map(move |row| row / SCALE * columns);
        let levels = rows.flat_map(move |start| (0..columns * SCALE).map(move |it| start + it / SCALE));
        levels.map(|it| 20 + (u16::from(shown[it]) * 200 / 255) as u8).collect::<Vec<u8>>()
    };
    let pixels: Vec<u8> = code.pictures().iter().flat_map(seen).collect();
    let names = (0..code.pictures().len()).map(|it| format!("{it:02}.png")).collect();
    let [width, height] = [width, height].map(|it| it * SCALE as u32);
    PatternPictures { name: "scan".into(), width, height, names, pixels, ..PatternPictures::default() }
}

/// What a map says of the middle of a projector pixel.
fn at(map: &ProjectorMap, column: usize, row: usize) -> [f32; 2] {
    // Between the second and the third of four pixels.
    let [a, b] = [1, 2].map(|it| map.get(SCALE * column + it, SCALE * row + it).coordinate);
    [0, 1].map(|it| 0.5 * (a[it] + b[it]))
}

fn settings() -> DecoderSettings {
    let pattern = PatternSettings { projector_px: [64, 48], ..PatternSettings::default() };
    DecoderSettings { pattern, min_direct: 0.0, ..DecoderSettings::default() }
}

/// The map, if there is one, and what was said.
fn run(set: PatternPictures) -> (Option<std::sync::Arc<ProjectorMap>>, String) {
    let mut bench = NodeBench::<Decoder>::new(settings()).unwrap();
    bench.feed(&PICTURES, Time::ZERO, set).unwrap();
    let map = bench.outputs(&MAP).pop().map(|it| it.value);
    let gaps = bench.gaps(&MAP);
    assert_eq!(map.is_none(), gaps.len() == 1, "{gaps:?}");
    let said = gaps.into_iter().map(|it| it.reason).chain(bench.finish().unwrap().remarks);
    (map, said.collect::<Vec<_>>().join("; "))
}

#[test]
fn node_keeps_its_promises() {
    foveate_testkit::check_node::<Decoder>("pattern.projector_px = [64, 48]\nmin_contrast = 20");
}

#[test]
fn what_a_picture_should_show_is_worked_out_or_its_axis_left_out() {
    let code = StripeCode::gray([64, 48]);
    let mut set = set(&code);
    let n = PIXELS;
    // The inverse of a bit of the rows was not shown.
    let (bit, inverse) = (16, 17);
    let again = set.pixels[bit * n..(bit + 1) * n].to_vec();
    set.pixels[inverse * n..(inverse + 1) * n].copy_from_slice(&again);
    let (map, said) = run(set.clone());
    let [u, v] = at(&map.unwrap_or_else(|| panic!("{said}")), 30, 20);
    assert!((u - 30.0).abs() < 0.1 && (v - 20.0).abs() < 0.1, "{u} {v}");
    assert!(said.contains("`17.png` shows the same stripes as `16.png`"), "{said}");
    assert!(said.contains("reconstructed") && said.contains("bit 2 of the rows, inverse"), "{said}");
    // Without black nothing says what it should have shown.
    let (mut shorter, black) = (set.clone(), 25);
    shorter.pixels[black * n..].fill(0);
    shorter.unreadable.push(black as u32);
    let (map, said) = run(shorter);
    let [u, v] = at(&map.unwrap_or_else(|| panic!("{said}")), 30, 20);
    assert!((u - 30.0).abs() < 0.1 && v.is_nan(), "{u} {v}");
    let why = "the rows are left out for lack of bit 2 of the rows, inverse";
    assert!(said.contains(why), "{said}");
}

#[test]
fn a_set_without_black_is_decoded_by_its_bits() {
    let mut short = set(&StripeCode::gray([64, 48]));
    short.names.pop();
    short.pixels.truncate(25 * PIXELS);
    let (map, said) = run(short);
    let [u, v] = at(&map.unwrap_or_else(|| panic!("{said}")), 30, 20);
    assert!((u - 30.0).abs() < 0.1 && (v - 20.0).abs() < 0.1, "{u} {v}");
    assert!(said.contains("no picture shows black, expected after `24.png`"), "{said}");
}

#[test]
fn parts_that_change_during_a_set_are_left_out_and_told() {
    let mut moved = set(&StripeCode::gray([64, 48]));
    // From the tenth picture on a dark thing covers some columns.
    for picture in moved.pixels.chunks_exact_mut(PIXELS).skip(9) {
        picture
            .chunks_exact_mut(64 * SCALE)
            .for_each(|row| row[32 * SCALE..48 * SCALE].iter_mut().for_each(|it| *it = *it / 2 + 10));
    }
    let (map, said) = run(moved);
    let map = map.unwrap();
    assert!(at(&map, 40, 20).iter().all(|it| it.is_nan()), "{said}");
    assert!((at(&map, 10, 20)[0] - 10.0).abs() < 0.1 && at(&map, 60, 20)[1].is_finite());
    assert!(said.contains("in 25 % of the lit pixels"), "{said}");
    let (whole, said) = run(set(&StripeCode::gray([64, 48])));
    assert!(at(&whole.unwrap(), 40, 20)[0].is_finite() && said.is_empty(), "{said}");
}

#[test]
fn a_set_that_is_none_gives_no_map_and_says_why() {
    let code = StripeCode::gray([64, 48]);
    let mut short = set(&code);
    // Both of a bit of the columns, both of one of the rows.
    for missing in [17, 16, 5, 4] {
        short.names.remove(missing);
        short.pixels.drain(missing * PIXELS..(missing + 1) * PIXELS);
    }
    let (map, said) = run(short);
    assert!(map.is_none() && said.contains("found 22 pictures, expected 26"), "{said}");
    let manifest = "projector_px = [32, 32]\nodrer = \"columns\"".to_owned();
    let (map, said) = run(PatternPictures { manifest, ..set(&code) });
    assert!(map.is_none() && said.contains("odrer"), "{said}");
}

#[test]
fn a_camera_out_of_focus_is_told_where_colours_have_edges() {
    let code = StripeCode::gray([64, 48]);
    let [width, height] = [64 * SCALE, 48 * SCALE];
    let said = |times: usize| {
        let mut set = set(&code);
        for picture in set.pixels.chunks_exact_mut(PIXELS) {
            let mut light: Vec<f64> = (0..PIXELS)
                .map(|at| f64::from(picture[at]) * if (at % width / 32 + at / width / 32) % 2 == 0 { 1.0 } else { 0.6 })
                .collect();
            // Each time a variance of 1/2 px² along rows and columns.
            for by in [1, width].into_iter().cycle().take(2 * times) {
                let seen = |at: usize| {
                    0.25 * (light[at.saturating_sub(by)] + 2.0 * light[at] + light[(at + by).min(width * height - 1)])
                };
                light = (0..PIXELS).map(seen).collect();
            }
            picture.iter_mut().zip(&light).for_each(|(to, light)| *to = light.round() as u8);
        }
        run(set).1
    };
    assert!(!said(0).contains("out of focus"), "{}", said(0));
    assert!(said(8).contains("out of focus") && said(8).contains(" 2."), "{}", said(8));
}

/// The same of a surface with colours, each picture of which lies `way` of its part of the set farther to the right and half as far down [px].
fn crept(code: &StripeCode, way: impl Fn(f64) -> f64) -> PatternPictures {
    let still = set(code);
    let [columns, rows] = code.projector.map(|it| it as usize);
    let (width, n) = (columns * SCALE, still.names.len());
    let mut random = foveate::estimation::random::Random::new(9);
    let mut pixels = Vec::with_capacity(still.pixels.len());
    for (number, it) in code.pictures().iter().enumerate() {
        let shown = foveate::imaging::stripes::pattern::picture(code, *it, 1.0);
        let by = way(number as f64 / (n - 1) as f64);
        for at in 0..PIXELS {
            let sample = |part: usize| {
                let x = (at % width) as f64 + (part % 4) as f64 / 4.0 - 0.375 - by;
                let y = (at / width) as f64 + (part / 4) as f64 / 4.0 - 0.375 - by / 2.0;
                let place = |it: f64, n: usize| (((it + 0.5) / SCALE as f64).floor().max(0.0) as usize).min(n - 1);
                let lit = f64::from(shown[place(y, rows) * columns + place(x, columns)]) / 255.0;
                let colour = 0.6 + 0.25 * (x / 6.0 + 0.4 * (y / 9.0).cos()).sin() * (y / 7.0).cos();
                20.0 + 190.0 * colour * lit
            };
            let level = (0..16).map(sample).sum::<f64>() / 16.0;
            pixels.push((level + random.normal()).round().clamp(0.0, 255.0) as u8);
        }
    }
    PatternPictures { pixels, ..still }
}

#[test]
fn a_set_that_crept_far_is_decoded_as_its_first_picture_saw_it() {
    let code = StripeCode::gray([64, 48]);
    for (px, words) in [(0.6, "drifted by 0.6"), (4.0, "drifted by 4"), (5.0, "drifted")] {
        let (map, said) = run(crept(&code, |it| px * it));
        assert!(said.contains(words), "{px} px: {said}");
        let map = map.unwrap();
        let mut off: Vec<f32> = (4..60)
            .flat_map(|column| (4..44).map(move |row| (column, row)))
            .map(|(column, row)| (at(&map, column, row)[0] - column as f32).abs())
            .filter(|it| it.is_finite())
            .collect();
        off.sort_by(f32::total_cmp);
        assert!(off.len() > 1500 && off[off.len() / 2] < 0.03, "{px} px: {} of {}", off[off.len() / 2], off.len());
    }
}

#[test]
fn waves_that_begin_where_they_should_are_no_remark() {
    let said = |is_reversed: bool, ahead: f64| {
        super::words::steps_in_words(Axis::Columns, Steps::Otherwise { is_reversed, ahead })
    };
    assert_eq!([0.0, 0.002, -0.002, 0.999].map(|it| said(false, it)), [const { None }; 4]);
    assert!(said(false, 0.01).unwrap().contains("begin 0.010 of a period elsewhere"));
    assert!(said(false, 0.25).unwrap().contains("begin 0.25 of a period elsewhere"));
    assert!(said(true, 0.0).unwrap().contains("backwards"));
}
