//! Pages of simulated rooms; they are left in `target/tmp` to be looked at.

use std::collections::BTreeSet;
use std::f64::consts::{PI, TAU};

use foveate_calibration::convergence::{ConvergenceOptions, convergence, settled};
use foveate_calibration::report::{Grade, ReportInput, Verdict, html};
use foveate_calibration::solved::{
    ClockFit, FixedFreedoms, ObservationRole, Solved, SolvedCamera, SolvedObservation, SolvedPoint, Step,
};
use foveate_estimation::Random;
use foveate_geometry::{
    Camera, CameraStatus, Freedom, LightObservation, SelfCalibrationOptions, self_calibrate, triangulate_rays,
};
use foveate_scene::{Fixed, Provenance};
use nalgebra::{Point2, Point3, Vector2};

/// A room of `n` cameras that was calibrated from a light waved for `frames`, each frame seen by `views` cameras at most.
fn network(n: usize, frames: usize, views: usize, focal_free: bool) -> Solved {
    let mut random = Random::new(n as u64);
    let truth: Vec<Camera> = (0..n)
        .map(|index| {
            let angle = TAU * index as f64 / n as f64;
            let centre = Point3::new(2.6 * angle.cos(), 3.4 * angle.sin(), 2.7 + 0.2 * random.normal());
            let mut across = || angle + PI * random.uniform_in(0.6, 1.4);
            let target = Point3::new(0.9 * across().cos(), 1.3 * across().sin(), 1.0);
            Camera::look_at(centre, target, [640, 480], 420.0)
        })
        .collect();
    let mut observations = Vec::new();
    for frame in 0..frames {
        let phase = TAU * frame as f64 / frames as f64;
        let (x, y) = (1.6 * (5.0 * phase + 0.3).sin(), 2.2 * (3.3 * phase).sin());
        let light = Point3::new(x, y, 1.2 + 0.7 * (7.1 * phase).sin());
        let mut seen: Vec<(usize, Point2<f64>)> =
            truth.iter().enumerate().filter_map(|(camera, it)| Some((camera, it.sees(&light)?))).collect();
        for at in (1..seen.len()).rev() {
            seen.swap(at, random.below(at as u32 + 1) as usize);
        }
        for (camera, pixel) in seen.into_iter().take(views) {
            let mut pixel = pixel + Vector2::new(random.normal(), random.normal()) * 0.4;
            if random.uniform() < 0.03 {
                pixel = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
            }
            observations.push(LightObservation { camera, frame, pixel });
        }
    }
    let is_held_out = |it: &LightObservation| it.frame % 7 == 3;
    let trained: Vec<LightObservation> = observations.iter().filter(|it| !is_held_out(it)).copied().collect();
    let freedom = Freedom { focal: focal_free, ..Freedom::POSE };
    let found = self_calibrate(&truth, &vec![freedom; n], &trained, &SelfCalibrationOptions::default()).unwrap();
    let mut points = Vec::new();
    let mut point_of = vec![None; frames];
    for (frame, position) in found.points.iter().enumerate() {
        let held_out = observations.iter().filter(|it| it.frame == frame && is_held_out(it));
        let rays: Vec<_> = held_out.filter_map(|it| found.cameras[it.camera].ray(&it.pixel)).collect();
        if let Some(position) = position.or_else(|| triangulate_rays(&rays)) {
            point_of[frame] = Some(points.len());
            points.push(SolvedPoint { frame, time_s: frame as f64 / 30.0, label: 0, position });
        }
    }
    let observations = observations.iter().map(|it| {
        let point = point_of.get(it.frame).copied().flatten();
        let seen = point.and_then(|at: usize| found.cameras[it.camera].project(&points[at].position));
        let residual = seen.map(|seen| seen - it.pixel);
        let far = residual.is_none_or(|it| it.norm() > 3.0);
        let role = match (point, is_held_out(it)) {
            (None, _) => ObservationRole::Unsolved,
            _ if far => ObservationRole::Rejected,
            (_, true) => ObservationRole::HeldOut,
            (_, false) => ObservationRole::Used,
        };
        SolvedObservation { camera: it.camera, frame: it.frame, point, pixel: it.pixel, residual, role }
    });
    let observations: Vec<SolvedObservation> = observations.collect();
    let n_used = observations.iter().filter(|it| it.role == ObservationRole::Used).count();
    let stage = |stage, from: f64, n: usize| {
        (0..n).map(move |it| Step {
            stage,
            rms_px: found.rms_px * (1.0 + from * (-0.9 * it as f64).exp()),
            used: n_used,
        })
    };
    let steps = stage("placed from pairs", 40.0, 4).chain(stage("adjusted", 6.0, 7)).chain(stage(
        "adjusted with optics",
        0.4,
        5,
    ));
    let cameras = found.cameras.iter().enumerate().map(|(index, camera)| SolvedCamera {
        name: format!("wide-{}", index + 1),
        camera: camera.clone(),
        status: found.status[index].clone(),
        freed: found.freed[index],
        prior: None,
        covariance: found.covariance[index].clone(),
        clock: (n < 10).then_some(ClockFit {
            offset_s: 0.004 * index as f64 - 0.01,
            drift: 1e-5 * index as f64,
            sigma_s: 0.0007,
            pairs: n - 1,
        }),
    });
    Solved {
        cameras: cameras.collect(),
        points,
        observations,
        steps: steps.collect(),
        links: found.links.clone(),
        fixed: FixedFreedoms::default(),
        ..Solved::default()
    }
}

fn report<'a>(title: &'a str, solved: &'a Solved) -> ReportInput<'a> {
    ReportInput { title, verdict: None, solved, unit: "units", convergence: None, provenance: None, rejected: &[] }
}

/// Writes the page to where it can be looked at.
fn page(name: &str, report: &ReportInput<'_>) -> String {
    let page = html(report);
    std::fs::write(std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name), &page).unwrap();
    check(&page);
    page
}

/// Tags are closed in order, attributes are quoted, nothing is loaded, no number is none.
#[track_caller]
fn check(page: &str) {
    let mut open: Vec<String> = Vec::new();
    let mut rest = page.strip_prefix("<!DOCTYPE html>").unwrap();
    while let Some(start) = rest.find('<') {
        let text = &rest[..start];
        assert!(!text.contains("NaN") && !text.contains("inf "), "{text}");
        let end = start + rest[start..].find('>').unwrap();
        let tag = &rest[start + 1..end];
        rest = &rest[end + 1..];
        let name: String = tag.chars().take_while(|it| it.is_ascii_alphanumeric() || *it == '/').collect();
        assert!(!name.is_empty(), "a bare < before {}", &rest[..rest.len().min(60)]);
        assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
        assert!(!tag.contains("NaN") && !tag.contains("inf"), "{tag}");
        // What is quoted may say anything.
        let mut quoted = tag.split('"').skip(1).step_by(2);
        let bare: String = tag.split('"').step_by(2).collect();
        assert!(!quoted.any(|it| it.starts_with("http") || it.starts_with('/')), "{tag}");
        for attribute in ["src=", "onload", "onclick", "onerror", "url("] {
            assert!(!bare.contains(attribute), "{tag}");
        }
        if let Some(closed) = name.strip_prefix('/') {
            assert_eq!(open.pop().as_deref(), Some(closed), "{}", &rest[..rest.len().min(60)]);
        } else if name == "script" || name == "style" {
            let closing = format!("</{name}>");
            let end = rest.find(&closing).unwrap();
            assert!(!rest[..end].contains("NaN"), "{name}");
            rest = &rest[end + closing.len()..];
        } else if !tag.ends_with('/') && !["meta", "br", "input"].contains(&name.as_str()) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?}");
    let after = |mark: &'static str| page.split(mark).skip(1).map(|it| it.split('"').next().unwrap());
    let ids: Vec<&str> = after(" id=\"").collect();
    assert_eq!(ids.iter().collect::<BTreeSet<_>>().len(), ids.len(), "an id is there twice");
    assert!(after(" href=\"#").all(|it| ids.contains(&it)));
    assert!(!page.contains("http"), "nothing outside the page is named");
}

fn words(list: &[&str]) -> Vec<String> {
    list.iter().map(|it| (*it).to_owned()).collect()
}

#[test]
fn a_small_room_has_every_section_and_says_what_it_was_told() {
    let mut solved = network(4, 600, 4, true);
    let fixed = |by: &str, sigma| Some(Fixed { by: by.to_owned(), sigma });
    solved.fixed = FixedFreedoms {
        scale: fixed("a wand of 0.4 m", Some(0.0005)),
        gravity: fixed("a falling light", Some(0.002)),
        origin: fixed("an L-frame", None),
    };
    for (index, right) in [(0, 90), (1, 10)] {
        let it = &mut solved.links[index];
        (it.consistent, it.common, it.right) = (false, 100, right);
    }
    let provenance = Provenance {
        method: "one waved light".to_owned(),
        date: Some("2026-03-14".to_owned()),
        sources: words(&["take_3.csv", "wand & floor.csv"]),
        residual_median_px: Some(0.41),
        ..Provenance::default()
    };
    let sentences =
        words(&["held-out observations fit as well as those used", "the upper left of wide-2 is empty: wave there"]);
    let verdict = Verdict { grade: Grade::Usable, sentences: &sentences, more: 1 };
    let convergence = convergence(&solved, &ConvergenceOptions { turns: 20, ..ConvergenceOptions::default() }).unwrap();
    let [together, in_turn] = [&convergence.together, &convergence.in_turn].map(|it| it.last().copied().unwrap());
    assert!(in_turn >= 0.999 * together && in_turn < 0.5 * convergence.in_turn[0], "{convergence:?}");
    assert!(settled(&convergence.together) < settled(&convergence.in_turn), "{convergence:?}");
    let rejected = words(&["312 frames in which camera wide-3 saw two lights"]);
    let text = page(
        "report_4.html",
        &ReportInput {
            verdict: Some(verdict),
            unit: "m",
            convergence: Some(&convergence),
            provenance: Some(&provenance),
            rejected: &rejected,
            ..report("Laser room, take 3", &solved)
        },
    );
    for part in [
        "<strong>Usable</strong>",
        "the upper left of wide-2 is empty",
        "<li>and 1 more in verdict.txt</li>",
        "2 links",
        "wide-1 and wide-3 (10 of 100 frames fit)",
        "4 of 4</b><span>cameras calibrated",
        "a wand of 0.4 m</td><td class=\"n\">0.0500 %",
        "a falling light</td><td class=\"n\">0.115°",
        "The grid is the plane z = 0.",
        "wand &amp; floor.csv",
        "312 frames in which",
        "From cameras that are 3° and 3 % of the size of the room off",
        "observations contradict the rest",
        "id=\"clocks\"",
        "id=\"depth\"",
        "adjusted with optics",
        "centre x, y, z [m]",
    ] {
        assert!(text.contains(part), "{part}");
    }
    assert!(text.len() < 500_000, "{}", text.len());
}

#[test]
fn a_large_room_stays_readable_and_small() {
    let solved = network(64, 900, 12, false);
    let text = page("report_64.html", &report("Hall with 64 cameras", &solved));
    assert!(text.len() < 2_500_000, "{}", text.len());
    assert!(text.contains("The vertical is not known"));
}

#[test]
fn the_same_room_gives_the_same_bytes() {
    let solved = network(4, 300, 4, false);
    assert_eq!(html(&report("a", &solved)), html(&report("a", &solved)));
}

#[test]
fn two_hundred_cameras_and_a_million_observations_stay_below_five_megabytes_and_the_page_says_what_it_left_out() {
    let mut solved = network(8, 300, 6, false);
    solved.cameras = (0..200)
        .map(|index| SolvedCamera { name: format!("seat-{index}"), ..solved.cameras[index % 8].clone() })
        .collect();
    let mut random = Random::new(3);
    solved.points = (0..20_000)
        .map(|frame| {
            let mut draw = || random.uniform_in(-1.0, 1.0);
            let position = Point3::new(draw(), draw(), draw());
            SolvedPoint { frame, time_s: frame as f64 / 30.0, label: 0, position }
        })
        .collect();
    solved.observations = (0..1_000_000)
        .map(|index| {
            let pixel = Point2::new(random.uniform_in(0.0, 639.0), random.uniform_in(0.0, 479.0));
            let residual = Some(Vector2::new(random.normal(), random.normal()));
            let (camera, point) = (index % 200, Some(index / 50));
            let role = if index % 9 == 0 { ObservationRole::HeldOut } else { ObservationRole::Used };
            SolvedObservation { camera, frame: index / 50, point, pixel, residual, role }
        })
        .collect();
    let text = page("report_200.html", &report("Stadium", &solved));
    assert!(text.len() < 5_000_000, "{}", text.len());
    assert!(text.contains("4000 of 20\u{202f}000 points are drawn"));
    assert!(text.contains("at most 200 observations of each camera"));
}

#[test]
fn names_cannot_break_the_page() {
    let mut solved = network(4, 300, 4, false);
    let nasty = ["</script><b>", "\"><img src=x onerror=alert(1)>", "a&b 'c' \"d\"", "\u{2028}\u{0}\\ü"];
    solved.cameras.iter_mut().zip(nasty).for_each(|(camera, name)| camera.name = name.to_owned());
    solved.cameras[1].status = CameraStatus::NoDepth { best: 0 };
    let rejected = words(&["<script>alert(1)</script>"]);
    let sentences = rejected.clone();
    let verdict = Some(Verdict { grade: Grade::Redo, sentences: &sentences, more: 0 });
    let provenance = Provenance { method: "<m>".to_owned(), sources: rejected.clone(), ..Provenance::default() };
    let input = ReportInput {
        verdict,
        provenance: Some(&provenance),
        rejected: &rejected,
        unit: "<u>",
        ..report("<title>&", &solved)
    };
    let text = page("report_names.html", &input);
    assert!(text.contains("&lt;/script&gt;&lt;b&gt;") && text.contains("\\u003c/script\\u003e\\u003cb\\u003e"));
    assert_eq!(text.matches("<script").count(), 2);
    assert!(!text.contains("<img") && !text.contains("alert(1)>"));
}

#[test]
fn rooms_that_were_not_solved_and_numbers_that_are_none_have_a_page() {
    let empty = Solved::default();
    page("report_empty.html", &report("nothing", &empty));
    let mut broken = network(4, 300, 4, false);
    for (index, observation) in broken.observations.iter_mut().enumerate() {
        match index % 5 {
            0 => observation.residual = Some(Vector2::new(f64::NAN, 1.0)),
            1 => observation.pixel.x = f64::INFINITY,
            2 => observation.point = Some(1_000_000),
            3 => observation.camera = 99,
            _ => {}
        }
    }
    broken.points[3].position.x = f64::NAN;
    broken.points[4].time_s = f64::NAN;
    broken.steps[1].rms_px = f64::NAN;
    broken.cameras[0].camera.intrinsics.focal = [f64::NAN; 2];
    broken.cameras[1].camera.image_size = [0, 0];
    broken.cameras[2].clock = Some(ClockFit { offset_s: f64::NAN, drift: 0.0, sigma_s: f64::INFINITY, pairs: 1 });
    broken.cameras[3].clock = Some(ClockFit { offset_s: 0.1, drift: f64::NAN, sigma_s: f64::INFINITY, pairs: 1 });
    if let Some(covariance) = &mut broken.cameras[3].covariance {
        covariance.centre[(0, 0)] = f64::NAN;
    }
    let text = page("report_broken.html", &report("broken", &broken));
    assert!(text.contains("observations by cameras that do not exist"));
    for observation in &mut broken.observations {
        (observation.residual, observation.point, observation.role) = (None, None, ObservationRole::Unsolved);
    }
    broken.points.clear();
    page("report_unsolved.html", &report("unsolved", &broken));
}
