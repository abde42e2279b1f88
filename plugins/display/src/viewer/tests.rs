//! What `viewer` promises, tried.

use foveate_testkit::{check_node, check_runs};
use nalgebra::{Isometry3, Matrix6};

use super::*;

const LIGHTS_MM: [[f64; 3]; 4] = [[24.0, 0.0, 118.0], [135.0, 20.0, 50.0], [0.0, 140.0, 30.0], [-30.0, -135.0, 60.0]];

/// A display of two tiles side by side in the plane y = 2.5 m, seen from below that: right is −x... of who looks along +y it is +x.
fn settings() -> ViewerSettings {
    let tile = |name: &str, x: f64| TileSettings {
        name: name.to_owned(),
        lower_left_m: [x, 2.5, 0.8],
        lower_right_m: [x + 1.2, 2.5, 0.8],
        upper_left_m: [x, 2.5, 1.6],
        size_px: [1200, 800],
    };
    ViewerSettings {
        lights_mm: LIGHTS_MM.into(),
        tiles: vec![tile("left", -1.2), tile("right", 0.0)],
        display_latency_ms: 40.0,
        ..ViewerSettings::default()
    }
}

/// A head that looks along +y and walks along x at this speed, nodding and looking about.
fn head(time_s: f64, speed: f64) -> Isometry3<f64> {
    let place = Vector3::new(-1.0 + speed * time_s, 0.0, 1.65 + 0.02 * (8.0 * time_s).sin());
    let heading = UnitQuaternion::from_scaled_axis(Vector3::z() * (1.57 + 0.3 * (1.5 * time_s).sin()));
    Isometry3::from_parts(place.into(), heading)
}

fn targets(time: Time, speed: f64) -> Targets {
    let (now, next) = (head(time.as_s(), speed), head(time.as_s() + 1e-4, speed));
    let target = |(it, id): (&[f64; 3], u32)| {
        let light = Point3::from(*it) * 1e-3;
        Target {
            id: TargetId(id),
            position: now * light,
            velocity: (next * light - now * light) * 1e4,
            covariance: Matrix6::identity() * 1e-6,
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        }
    };
    Targets { time, list: LIGHTS_MM.iter().zip(3..).map(target).collect() }
}

/// Feeds so many seconds at 120 Hz, delivered 10 ms after capture; the views given.
fn walk(settings: ViewerSettings, seconds: f64, speed: f64) -> Vec<Views> {
    let mut bench = NodeBench::<Viewer>::new(settings).unwrap();
    let mut given = Vec::new();
    for step in 0..(seconds * 120.0) as i64 {
        let time = Time(step * 1_000_000_000 / 120);
        let source = foveate::messages::SourceId(1);
        bench.feed_from(&TARGETS, source, time, Interval::from_ms(10.0), targets(time, speed)).unwrap();
        given.extend(bench.outputs(&VIEWS).iter().map(|it| (*it.value).clone()));
    }
    given
}

/// Largest distance of the eyes from where they truly are when the picture is seen, after the first two seconds [mm].
fn worst(views: &[Views], speed: f64) -> f64 {
    let mut worst = 0.0_f64;
    for it in views.iter().filter(|it| it.time > Time::from_s(2.0)) {
        for (eye, place) in it.tiles[0].eyes.iter().zip(ViewerSettings::default().eyes_mm) {
            let truth = head(it.shown_at.as_s(), speed) * (Point3::from(place) * 1e-3);
            worst = worst.max(1e3 * (eye.as_ref().unwrap().eye - truth).norm());
        }
    }
    worst
}

#[test]
fn node_keeps_the_law() {
    check_node::<Viewer>("");
    check_node::<Viewer>(
        "lights_mm = [[0, 70, 0], [0, -70, 0]]\nforetell = \"still\"\n[[tiles]]\nname = \"a\"\nlower_left_m = [0, 0, 0]\nlower_right_m = [1, 0, 0]\n\
         upper_left_m = [0, 0, 1]\nsize_px = [4, 3]",
    );
    check_runs::<Viewer>(&settings(), &Setup::for_tests(), |bench, time| {
        bench.feed(&TARGETS, time, targets(time, 1.0))
    });
}

#[test]
fn eyes_are_where_they_will_be_when_the_picture_is_seen() {
    let with = |foretell: EyePrediction| ViewerSettings { foretell, ..settings() };
    let views = walk(with(EyePrediction::Weighted), 4.0, 0.6);
    assert_eq!(views.len(), 480, "from the first message on");
    assert_eq!(views[9].shown_at - views[9].time, Interval::from_ms(50.0));
    let (still, velocity, ours) = (
        worst(&walk(with(EyePrediction::Still), 4.0, 0.6), 0.6),
        worst(&walk(with(EyePrediction::Velocity), 4.0, 0.6), 0.6),
        worst(&views, 0.6),
    );
    // 0.6 m/s for 50 ms, and what the head does besides.
    assert!((25.0..45.0).contains(&still), "{still} mm");
    assert!(velocity < still / 3.0 && ours < still / 3.0, "{velocity} mm, {ours} mm, {still} mm without");
}

#[test]
fn each_tile_has_the_corners_of_its_own_clip_space() {
    let views = walk(settings(), 1.0, 0.0);
    for tile in &views.last().unwrap().tiles {
        for eye in tile.eyes.iter().flatten() {
            for (corner, expected) in tile.corners.iter().zip([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0]]) {
                let clip = eye.clip_from_space * corner.to_homogeneous();
                assert!((clip.x / clip.w - expected[0]).abs() < 1e-9 && (clip.y / clip.w - expected[1]).abs() < 1e-9);
            }
        }
    }
    let [left, right] = [0, 1].map(|it| views[100].tiles[0].eyes[it].as_ref().unwrap().eye);
    assert!(left.x < right.x && ((right - left).norm() - 0.063).abs() < 1e-4, "{left} {right}");
}

#[test]
fn a_head_that_is_lost_is_carried_on_for_a_while_and_found_again() {
    let mut bench = NodeBench::<Viewer>::new(settings()).unwrap();
    let mut given = Vec::new();
    for step in 0..360 {
        let time = Time(step * 1_000_000_000 / 120);
        let hidden = (120..240).contains(&step);
        let list = if hidden { Targets { time, list: Vec::new() } } else { targets(time, 0.5) };
        bench.feed(&TARGETS, time, list).unwrap();
        given.push(bench.outputs(&VIEWS).len());
    }
    // 200 ms are 24 messages after the last one in which it was seen.
    let n: usize = given[..240].iter().sum();
    assert_eq!((n, given[240..].iter().sum::<usize>()), (120 + 24, 120));
    assert!((bench.finish().unwrap().figures["viewer.found"] - 240.0 / 263.0).abs() < 0.01);
}

#[test]
fn an_eye_behind_a_tile_has_no_view_and_the_other_tiles_go_on() {
    let mut turned = settings();
    // Seen from the other side: right and left exchanged.
    turned.tiles[1].lower_left_m = [1.2, 2.5, 0.8];
    turned.tiles[1].lower_right_m = [0.0, 2.5, 0.8];
    turned.tiles[1].upper_left_m = [1.2, 2.5, 1.6];
    let views = walk(turned, 0.5, 0.0);
    assert!(views[30].tiles[0].eyes.iter().all(Option::is_some) && views[30].tiles[1].eyes == [None, None]);
}

#[test]
fn what_cannot_be_is_refused_with_its_place() {
    let refused = |change: &dyn Fn(&mut ViewerSettings)| {
        let mut settings = settings();
        change(&mut settings);
        NodeBench::<Viewer>::new(settings).map(|_| ()).unwrap_err()
    };
    let fault = refused(&|it| it.tiles[1].lower_right_m = [0.0, 2.5, 0.8]);
    assert_eq!(fault.setting.as_deref(), Some("tiles[1].lower_left_m"));
    assert!(fault.message.contains("found edges of 0 m and 0.8"), "{fault}");
    let fault = refused(&|it| it.tiles[1].name = "left".to_owned());
    assert!(fault.message.contains("expected a name that no other tile has"), "{fault}");
    let fault = refused(&|it| {
        let TileSettings { lower_left_m, lower_right_m, upper_left_m, .. } = it.tiles[0].clone();
        (it.tiles[1].lower_left_m, it.tiles[1].lower_right_m) = (lower_left_m, lower_right_m);
        it.tiles[1].upper_left_m = upper_left_m;
    });
    assert!(fault.message.contains("found the place of tile `left` again"), "{fault}");
    let fault = refused(&|it| it.tiles[0].size_px = [4 * it.tiles[0].size_px[0], it.tiles[0].size_px[1]]);
    assert!(fault.message.contains("times as wide as high, expected 0.5 to 2"), "{fault}");
    let mut settings = settings();
    for it in &mut settings.tiles {
        for corner in [&mut it.lower_left_m, &mut it.lower_right_m, &mut it.upper_left_m] {
            *corner = corner.map(|it| 100.0 * it);
        }
    }
    let setup = Setup { volume_m: Some([[-2.0, 0.0, 0.0], [2.0, 3.0, 2.5]]), ..Setup::for_tests() };
    let fault = NodeBench::<Viewer>::with_setup(settings, &setup).map(|_| ()).unwrap_err();
    assert!(fault.message.contains("are all in metres?"), "{fault}");
    let fault = refused(&|it| it.lights_mm[3] = [24.0, 5.0, 118.0]);
    assert_eq!(fault.setting.as_deref(), Some("lights_mm[3]"));
    assert!(refused(&|it| it.lights_mm.clear()).message.contains("found 0 lights, expected 2 to 8"));
    assert!(refused(&|it| it.tiles.clear()).message.contains("found 0 tiles"));
    assert!(refused(&|it| it.eyes_mm.swap(0, 1)).message.contains("expected the left eye first"));
    let in_metres = refused(&|it| it.eyes_mm = it.eyes_mm.map(|eye| eye.map(|it| it * 1e-3)));
    assert!(in_metres.message.contains("0.06 mm apart, expected 40 to 90 mm"), "{}", in_metres.message);
    assert_eq!(refused(&|it| it.eyes_mm[0][2] = f64::NAN).setting.as_deref(), Some("eyes_mm"));
    assert!(refused(&|it| it.far_m = 0.01).setting.as_deref() == Some("far_m"));
}

/// What is said at the end of three seconds with other settings than those of the head that walks.
fn said_with(change: impl Fn(&mut ViewerSettings)) -> String {
    let mut settings = settings();
    change(&mut settings);
    let mut bench = NodeBench::<Viewer>::new(settings).unwrap();
    for step in 0..360 {
        let time = Time(step * 1_000_000_000 / 120);
        bench.feed(&TARGETS, time, targets(time, 0.5)).unwrap();
    }
    bench.finish().unwrap().remarks.join("; ")
}

#[test]
fn lights_that_are_mirrored_misplaced_or_in_other_axes_are_reported() {
    assert_eq!(said_with(|_| ()), "");
    let mirrored = said_with(|it| it.lights_mm.iter_mut().for_each(|it| it[1] = -it[1]));
    assert!(mirrored.contains("left and right exchanged"), "{mirrored}");
    let moved = said_with(|it| it.lights_mm[1][2] += 80.0);
    assert!(moved.contains("light 2 of `lights_mm`"), "{moved}");
    // y forward, x to the right.
    let turned = said_with(|it| it.lights_mm.iter_mut().for_each(|it| *it = [-it[1], it[0], it[2]]));
    assert!(turned.contains("past the display"), "{turned}");
    // Three lights have a mirror image that fits: a head on its side.
    let three = said_with(|it| {
        it.lights_mm.truncate(3);
        it.lights_mm.iter_mut().for_each(|it| it[1] = -it[1]);
    });
    assert!(three.contains("from straight up"), "{three}");
}

#[test]
fn a_tile_that_faces_away_is_told_and_one_that_faces_away_from_the_volume_is_refused() {
    let away = |it: &mut ViewerSettings| {
        it.tiles[1].lower_left_m = [1.2, 2.5, 0.8];
        it.tiles[1].lower_right_m = [0.0, 2.5, 0.8];
        it.tiles[1].upper_left_m = [1.2, 2.5, 1.6];
    };
    let said = said_with(away);
    assert!(said.contains("tile `right`"), "{said}");
    let mut settings = settings();
    let setup = Setup { volume_m: Some([[-2.0, -2.5, 0.0], [2.0, 2.5, 2.0]]), ..Setup::for_tests() };
    assert!(Viewer::new(settings.clone(), &setup).is_ok());
    away(&mut settings);
    let fault = Viewer::new(settings, &setup).err().unwrap();
    assert_eq!(fault.setting.as_deref(), Some("tiles[1].lower_left_m"));
}
