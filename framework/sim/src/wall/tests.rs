//! What `wall` promises, tried.

use super::*;
use crate::camera::{WallCameraSettings, WallFormat, WallRenderer};
use foveate_geometry::{Camera, Distortion, Intrinsics};
use foveate_messages::{CameraId, Image, PixelFormat};

fn wall(settings: WallSettings) -> Wall {
    Wall::new(settings, Truth::default(), &Random::new(5))
}

fn camera() -> Camera {
    let eye = Point3::new(1.0, 0.7, -2.2);
    Camera {
        image_size: [640, 480],
        intrinsics: Intrinsics { focal: [915.0; 2], principal: [319.5, 239.5], skew: 0.0 },
        distortion: Distortion { k1: -0.05, ..Distortion::default() },
        camera_from_world: nalgebra::Isometry3::translation(-eye.x, -eye.y, -eye.z),
    }
}

fn picture(wall: &Wall, time_s: f64, settings: &WallCameraSettings) -> Image {
    let camera = wall.camera(None, &camera());
    let mut renderer = WallRenderer::new(wall.clone(), camera, CameraId(0), settings, &Random::new(1));
    let mut image = Image::default();
    renderer.render(Time::from_s(time_s), 0, &mut image);
    image
}

/// Middle of all light above `least` [px].
fn middle(image: &Image, least: u8) -> Point2<f64> {
    let (mut sum, mut moment) = (0.0, Vector2::zeros());
    for (index, &value) in image.pixels.iter().enumerate().filter(|it| *it.1 > least) {
        let weight = f64::from(value - least);
        sum += weight;
        moment += Vector2::new((index % 640) as f64, (index / 640) as f64) * weight;
    }
    Point2::from(moment / sum)
}

#[test]
fn hands_at_rest_shake_as_the_published_spectrum_says() {
    let settings = WallSettings::default();
    let hand = Hand::new(0, &settings, &Random::new(1));
    let n = 12_000;
    let shakes: Vec<f64> = (0..n).map(|it| hand.shakes(f64::from(it) * 0.005).x / 0.0008).collect();
    let mean = shakes.iter().sum::<f64>() / f64::from(n);
    let sigma = (shakes.iter().map(|it| (it - mean).powi(2)).sum::<f64>() / f64::from(n)).sqrt();
    assert!((3.2..4.5).contains(&sigma), "a range of 8 px to either side is two standard deviations: {sigma} px");
    let power = |hz: f64| {
        let (mut real, mut imaginary) = (0.0, 0.0);
        for (i, it) in shakes.iter().enumerate() {
            let angle = std::f64::consts::TAU * hz * i as f64 * 0.005;
            real += (it - mean) * angle.cos();
            imaginary += (it - mean) * angle.sin();
        }
        (real * real + imaginary * imaginary) / f64::from(n)
    };
    let band = |low: i32, high: i32| (low * 60..high * 60).map(|it| power(f64::from(it) / 60.0)).sum::<f64>();
    let (tremor, gap, above) = (band(8, 12), band(6, 8), band(13, 20));
    assert!(tremor > 20.0 * above && tremor > 3.0 * gap, "tremor {tremor}, below it {gap}, above it {above}");
    assert!((0.05..0.2).contains(&(tremor / band(0, 20))), "a tenth of the power is tremor");
}

#[test]
fn users_press_let_go_leave_and_return() {
    let wall = wall(WallSettings::default());
    let mut numbers = std::collections::BTreeMap::<u32, (u32, u32)>::new();
    let mut away = 0;
    for step in 0..12_000 {
        let time = Time::from_s(f64::from(step) * 0.005);
        let presses: Vec<Press> = wall.presses(time).collect();
        for press in &presses {
            let of = numbers.entry(press.number).or_insert((press.user, 0));
            assert_eq!(of.0, press.user, "two users with one press");
            of.1 += 1;
        }
        let down = wall.0.hands.iter().filter(|it| it.presses(time.as_s(), wall.settings()).is_some()).count();
        away += usize::from(presses.len() < down);
    }
    assert!((70..200).contains(&numbers.len()), "{} presses in a minute", numbers.len());
    assert!(numbers.values().any(|it| it.1 < 30) && numbers.values().any(|it| it.1 > 400), "clicks and long strokes");
    assert!((100..6000).contains(&away), "pointers leave the wall: {away} of 12000 moments");
}

#[test]
fn two_users_swap_places_and_meet_in_the_middle() {
    let settings = WallSettings { press_s: 600.0, ..WallSettings::default() };
    let wall = wall(settings.clone());
    let mut nearest = f64::MAX;
    // The second half of the second part is a swap.
    for step in 0..240 {
        let time_s = 1.2 + f64::from(step) * 0.005;
        let points: Vec<_> = wall.0.hands.iter().map(|it| it.points_at(time_s, &settings, wall.size())).collect();
        for (i, one) in points.iter().enumerate() {
            nearest = points[i + 1..].iter().map(|it| (it - one).norm()).fold(nearest, f64::min);
        }
    }
    assert!(nearest < 0.03, "{nearest} m");
}

#[test]
fn dot_is_rendered_where_the_camera_sees_it_and_later_by_the_displays_latency() {
    let dots = DotSettings { grid: [3, 3], ..DotSettings::default() };
    let wall = wall(WallSettings { dots: Some(dots), ..WallSettings::default() });
    let settings = WallCameraSettings { noise_sigma: 0.0, ..WallCameraSettings::default() };
    let mut in_view = 0;
    for number in 0..72 {
        let at_s = 0.1 * f64::from(number);
        let mut place = None;
        wall.commanded(Time::from_s(at_s + 0.001), |_, light| place = Some(light.point));
        let place = place.expect("a dot is commanded at any time before the last is over");
        let Some(pixel) = camera().sees(&wall.in_space(&place)) else { continue };
        if camera().image_size.iter().zip(pixel.iter()).any(|(size, at)| *at < 10.0 || *at > f64::from(*size) - 11.0) {
            continue;
        }
        in_view += 1;
        let image = picture(&wall, at_s + 0.08, &settings);
        let off = (middle(&image, 20) - pixel).norm();
        assert!(off < 0.02, "dot {number}: {off} px");
        let early = picture(&wall, at_s + 0.02, &settings);
        assert!((middle(&early, 20) - pixel).norm().is_nan() || (middle(&early, 20) - pixel).norm() > 5.0);
    }
    assert!(in_view >= 6, "{in_view} dots in view");
}

#[test]
fn display_that_is_off_shows_neither_dots_nor_contents() {
    let settings = |dots| WallSettings { dots, dark_tile: Some([0, 0]), users: 0, ..WallSettings::default() };
    let camera_settings = WallCameraSettings { noise_sigma: 0.0, ..WallCameraSettings::default() };
    let dark = wall(settings(Some(DotSettings::default())));
    assert!(
        picture(&dark, 0.05, &camera_settings).pixels.iter().all(|it| *it <= 8),
        "the first dot is on that display"
    );
    let image = picture(&wall(settings(None)), 0.5, &camera_settings);
    assert_eq!(image.pixels[100 * 640 + 100], 8, "contents on the first display");
    assert!(image.pixels[300 * 640 + 600] > 12, "contents of the next one are there");
}

#[test]
fn reflection_is_seen_from_its_side_alone_and_elsewhere_by_each_camera() {
    let wall = wall(WallSettings { users: 16, ..WallSettings::default() });
    let (mut from_left, mut from_right, mut n) = (Vec::new(), Vec::new(), 0);
    for step in 0..600 {
        let time = Time::from_s(f64::from(step) * 0.02);
        let real = wall.presses(time).count();
        let mut seen = |x: f64, into: &mut Vec<Point2<f64>>| {
            let mut lights = Vec::new();
            wall.spots(time, &Point3::new(x, 0.6, -2.0), |it| lights.push(it));
            into.extend(lights.iter().filter(|it| it.peak < 0.31 * 2000.0).map(|it| it.point));
            n += lights.len() - real;
        };
        seen(0.3, &mut from_left);
        seen(1.8, &mut from_right);
    }
    assert!(n > 20 && !from_left.is_empty() && !from_right.is_empty(), "{n} reflections");
    assert!(from_left.iter().any(|it| !from_right.contains(it)), "views disagree");
}

#[test]
fn board_is_found_where_the_wall_shows_it() {
    let board = BoardSettings { grid: [2, 2], each_ms: 100.0, ..BoardSettings::default() };
    let wall = wall(WallSettings { board: Some(board), display_latency_ms: 0.0, ..WallSettings::default() });
    let mut found = 0;
    for number in 0..32 {
        let time = Time::from_s(0.05 + 0.1 * f64::from(number));
        let mut commanded = Vec::new();
        wall.commanded(time, |label, light| commanded.push((label, light.point)));
        assert_eq!(commanded.len(), 28);
        let image = picture(&wall, time.as_s(), &WallCameraSettings::default());
        let view = foveate_imaging::ImageView::new(&image.pixels, 640, 480).unwrap();
        let Some(corners) = foveate_imaging::chessboard::find_chessboard(&view, 7, 4) else { continue };
        found += 1;
        for ((label, point), corner) in commanded.iter().zip(&corners) {
            let pixel = camera().project(&wall.in_space(point)).unwrap();
            assert!((pixel - corner.centre).norm() < 0.15, "corner {label}: {} for {pixel}", corner.centre);
        }
    }
    assert!(found >= 4, "{found}");
}

#[test]
fn waved_pointer_is_held_at_the_corners_first_and_then_covers_the_wall() {
    let wave = WaveSettings { miss_mm: 0.0, ..WaveSettings::default() };
    let wall = wall(WallSettings { wave: Some(wave), ..WallSettings::default() });
    let [width, height] = wall.size();
    let at = |time_s: f64| {
        let presses: Vec<Press> = wall.presses(Time::from_s(time_s)).collect();
        assert!(presses.len() < 2 && presses.iter().all(|it| it.number == 0));
        presses.first().map(|it| it.point)
    };
    for (corner, time_s) in
        [[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]].into_iter().zip([0.0, 2.7, 5.4, 8.1])
    {
        for into in [0.1, 1.4] {
            assert!((at(time_s + into).unwrap() - Point2::from(corner)).norm() < 1e-3);
        }
    }
    let mut cells = std::collections::BTreeSet::new();
    for step in 0..6000 {
        if let Some(it) = at(11.0 + 0.01 * f64::from(step)) {
            cells.insert(((it.x / width * 8.0) as u32, (it.y / height * 4.0) as u32));
        }
    }
    assert!(cells.len() >= 28, "{} of 32 parts of the wall", cells.len());
}

#[test]
fn pointer_that_blinks_is_dark_once_in_its_period_and_held_down_all_the_same() {
    let steady = wall(WallSettings { reflection: 0.0, ..WallSettings::default() });
    let settings = WallSettings { blink_ms: vec![80.0, 100.0], blink_clock_percent: 0.0, ..steady.settings().clone() };
    let blinking = wall(settings);
    let eye = Point3::new(2.0, 0.6, -2.0);
    let lit = |wall: &Wall, time: Time| {
        let mut points = Vec::new();
        wall.spots(time, &eye, |it| points.push(it.point));
        points
    };
    let (mut held, mut dark, mut onsets) = ([0.0; 4], [0.0; 4], Vec::<i32>::new());
    let mut was_dark = false;
    for step in 0..40_000 {
        let time = Time::from_s(f64::from(step) * 1e-3);
        let presses: Vec<Press> = blinking.presses(time).collect();
        assert_eq!(presses, steady.presses(time).collect::<Vec<_>>());
        assert_eq!(lit(&steady, time).len(), presses.len());
        let seen = lit(&blinking, time);
        for press in presses {
            let is_dark = !seen.contains(&press.point);
            held[press.user as usize] += 1.0;
            dark[press.user as usize] += f64::from(u8::from(is_dark));
            if press.user == 0 {
                if is_dark && !was_dark {
                    onsets.push(step);
                }
                was_dark = is_dark;
            }
        }
    }
    let share = [0, 1, 2, 3].map(|it| dark[it] / held[it]);
    assert!((share[0] - 0.25).abs() < 0.01 && (share[1] - 0.2).abs() < 0.01, "{share:?}");
    assert_eq!(share[2..], [0.0, 0.0], "users beyond the list have steady pointers");
    let regular = onsets.windows(2).filter(|it| (it[1] - it[0] - 80).abs() <= 1).count();
    assert!(regular * 10 > onsets.len() * 8, "{onsets:?}");
}

#[test]
fn colour_pictures_have_pointers_in_their_colours_and_the_gray_ones_are_as_before() {
    let colours = vec![[1.0, 0.1, 0.0], [0.0, 1.0, 0.1], [0.1, 0.0, 1.0], [1.0, 1.0, 1.0]];
    let dark = WallSettings { white: 0.0, windows: 0, red_spots: 0, reflection: 0.0, ..WallSettings::default() };
    let gray = wall(dark.clone());
    let wall = wall(WallSettings { pointer_rgb: colours.clone(), pointer_peak: 150.0, ..dark.clone() });
    let plain = WallCameraSettings { noise_sigma: 0.0, balance_percent: 0.0, ..WallCameraSettings::default() };
    let rgb = WallCameraSettings { format: WallFormat::Rgb, ..plain.clone() };
    let mut seen = [0; 4];
    for step in 0..60 {
        let time_s = 0.5 * f64::from(step);
        let image = picture(&wall, time_s, &rgb);
        assert_eq!((image.format, image.pixels.len()), (PixelFormat::Rgb8, 3 * 640 * 480));
        let eye = wall.camera(None, &camera());
        let presses: Vec<Press> = wall.presses(Time::from_s(time_s)).collect();
        for it in &presses {
            let Some(pixel) = eye.sees(&wall.in_space(&it.point)) else { continue };
            let is_alone = presses.iter().all(|other| other == it || (other.point - it.point).norm() > 0.05);
            if !is_alone || pixel.x < 2.0 || pixel.y < 2.0 || pixel.x > 637.0 || pixel.y > 477.0 {
                continue;
            }
            let at = 3 * (pixel.y.round() as usize * 640 + pixel.x.round() as usize);
            let light = [0, 1, 2].map(|plane| f64::from(image.pixels[at + plane]) - 8.0);
            let most = light.into_iter().fold(0.0, f64::max);
            for plane in 0..3 {
                let expected = colours[it.user as usize][plane];
                assert!((light[plane] / most - expected).abs() < 0.05, "{light:?} of user {}", it.user);
            }
            seen[it.user as usize] += 1;
        }
        if step < 3 {
            let as_gray = picture(&gray, time_s, &plain);
            assert_eq!((as_gray.format, as_gray.pixels.len()), (PixelFormat::Gray8, 640 * 480));
        }
    }
    assert!(seen.iter().all(|it| *it > 3), "{seen:?}");
}

#[test]
fn a_wall_that_stands_in_a_room_is_where_it_was_put_and_is_seen_from_before_it_only() {
    let stand = StandSettings { upper_left_m: [-1.5, 2.5, 1.9], turned_deg: 20.0 };
    let wall = wall(WallSettings { stand: Some(stand), ..WallSettings::default() });
    let (right, turn) = (2.0, 20.0_f64.to_radians());
    let expected = Point3::new(-1.5 + right * turn.cos(), 2.5 + right * turn.sin(), 1.9 - 0.7);
    assert!((wall.in_space(&Point2::new(right, 0.7)) - expected).norm() < 1e-12);
    let eye = Point3::new(0.0, -1.0, 1.5);
    let ray = Ray { origin: eye, direction: nalgebra::Unit::new_normalize(expected - eye) };
    assert!((wall.met_by(&ray).unwrap() - Point2::new(right, 0.7)).norm() < 1e-9);
    assert!(wall.faces(&eye) && !wall.faces(&Point3::new(0.0, 6.0, 1.5)));
}
