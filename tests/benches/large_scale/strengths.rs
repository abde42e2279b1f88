//! The motion model at three strengths on a line and on a circle, up to one that loses the target again and again
//! [Davis 2002 §3.7, Figures 42 to 44].

use std::f64::consts::TAU;

use foveate::geometry::Camera;
use foveate::messages::{Targets, Time};
use foveate::plot::colours::REFERENCE;
use foveate::plot::svg::{Pen, Point};
use foveate::plot::{Axis, COLOURS, Chart, Marks, Series};
use foveate_led::tracker::Tracker;
use foveate_testkit::lab::{Lab, Light, ROOM_M};
use nalgebra::Point3;

use crate::Options;
use crate::chart::save;
use crate::variants::settings;

/// The weaker the belief in a constant velocity, the larger the acceleration that is expected. Who is lost is not remembered,
/// as in the paper.
const STRENGTHS: [(&str, &str); 3] = [
    ("low", "acceleration_m_s2 = 20.0\nremember_ms = 0.0"),
    ("medium", "acceleration_m_s2 = 1.0\nremember_ms = 0.0"),
    ("high", "acceleration_m_s2 = 0.01\nremember_ms = 0.0"),
];

const DURATION_S: f64 = 8.0;
const CIRCLE: Point3<f64> = Point3::new(0.0, 0.0, 1.2);

/// Back and forth along x, smoothly, 0.8 m in 2 s.
fn line(time_s: f64) -> [Light; 1] {
    [Light::at(Point3::new(0.4 * (TAU * time_s / 4.0).sin(), 0.2, 1.2))]
}

/// 0.5 m around the middle, once in 2 s: 1.6 m/s and 4.9 m/s².
fn circle(time_s: f64) -> [Light; 1] {
    let (s, c) = (TAU * time_s / 2.0).sin_cos();
    [Light::at(CIRCLE + nalgebra::Vector3::new(0.5 * c, 0.5 * s, 0.0))]
}

/// What one strength made of it.
struct Run {
    /// Of one target after the other: time [s] and place [m].
    paths: Vec<Vec<(f64, Point3<f64>)>>,
    initiations: u64,
    /// Observed and predicted points of camera 0, in turn [px].
    strokes: Vec<Point>,
    error_mm: f64,
}

fn run(text: &str, lab: &Lab, scene: fn(f64) -> [Light; 1]) -> Run {
    let settings = settings(text).expect("a setting since the first version");
    let mut tracker = Tracker::new(settings, lab.cameras.clone(), Some(ROOM_M));
    let (mut targets, mut ids) = (Targets::default(), Vec::new());
    let mut run = Run { paths: Vec::new(), initiations: 0, strokes: Vec::new(), error_mm: f64::NAN };
    let mut errors = Vec::new();
    for (time, features) in lab.frames(DURATION_S, &scene) {
        if features.camera.0 == 0 && time.as_s() > DURATION_S - 2.0 {
            let predicted = predicted(&targets, time, &lab.cameras[0]);
            for feature in &features.list {
                let distance = |it: &Point| (it[0] - feature.centre.x).hypot(it[1] - feature.centre.y);
                if let Some(near) = predicted.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))) {
                    run.strokes.extend([[feature.centre.x, -feature.centre.y], [near[0], -near[1]]]);
                }
            }
        }
        tracker.observe(time, &features);
        tracker.write(&mut targets);
        for target in &targets.list {
            let path = ids.iter().position(|it| *it == target.id).unwrap_or_else(|| {
                ids.push(target.id);
                run.paths.push(Vec::new());
                ids.len() - 1
            });
            run.paths[path].push((targets.time.as_s(), target.position));
            errors.push((target.position - scene(targets.time.as_s())[0].position).norm());
        }
    }
    run.initiations = tracker.tally().initiations;
    run.error_mm = 1e3 * errors.iter().sum::<f64>() / errors.len() as f64;
    run
}

/// Where camera 0 should see each target at `time`.
fn predicted(targets: &Targets, time: Time, camera: &Camera) -> Vec<Point> {
    let later = time - targets.time;
    let seen = targets.list.iter().filter_map(|it| camera.project(&it.position_after(later)));
    seen.map(|it| [it.x, it.y]).collect()
}

/// Measures and draws.
pub fn strengths(options: &Options) {
    println!("## Strength of the constant-velocity model, 6 cameras, one light [Davis 2002, Figures 42 to 44]\n");
    println!("| strength | setting | line: initiations, mean error mm | circle: initiations, mean error mm |");
    println!("|---|---|---|---|");
    let lab = Lab { noise: 1.0, ..Lab::new(6) };
    let runs: Vec<[Run; 2]> =
        STRENGTHS.iter().map(|(_, text)| [line, circle].map(|scene| run(text, &lab, scene))).collect();
    for ((name, text), [on_line, on_circle]) in STRENGTHS.iter().zip(&runs) {
        println!(
            "| {name} | {} | {}, {:.1} | {}, {:.1} |",
            text.lines().next().unwrap_or_default(),
            on_line.initiations,
            on_line.error_mm,
            on_circle.initiations,
            on_circle.error_mm
        );
    }
    println!();
    let out = options.out.as_deref();
    let over_time = |run: &Run, from: f64, to: f64| -> Vec<Vec<Point>> {
        let within = |path: &Vec<(f64, Point3<f64>)>| {
            path.iter().filter(|it| (from..to).contains(&it.0)).map(|it| [it.0, 1e3 * it.1.x]).collect()
        };
        run.paths.iter().map(within).collect()
    };
    let position = |title: &str, from: f64, to: f64| {
        let truth = (0..=500).map(|it| from + (to - from) * f64::from(it) / 500.0);
        let (x, y) = (Axis::new("time [s]"), Axis::new("x [mm]"));
        let truth = truth.map(|t| [t, 1e3 * line(t)[0].position.x]).collect();
        let truth = Series::line("truth", REFERENCE, truth).dashed();
        let mut chart = Chart::new(title, [640.0, 200.0], x, y).with(truth);
        for (run, colour) in [(0, COLOURS[0]), (1, COLOURS[1])] {
            let pieces = over_time(&runs[run][0], from, to);
            let name = format!("{} strength", STRENGTHS[run].0);
            chart = chart.with(Series { pieces, ..Series::line(name, colour, Vec::new()) });
        }
        chart
    };
    let charts = vec![position("all of it", 0.0, DURATION_S), position("enlarged", 4.8, 5.2)];
    let title = "Position on the line at two strengths (Figure 42)";
    save(out, "strengths_fig42_position", title, 1, charts);
    let around = |index: usize| {
        let pieces = runs[index][1].paths.iter().map(|path| path.iter().map(|it| [it.1.x, it.1.y]).collect()).collect();
        let truth = (0..=200).map(|it| circle(f64::from(it) / 100.0)[0].position).map(|it| [it.x, it.y]).collect();
        let title = format!("{} strength, initiations: {}", STRENGTHS[index].0, runs[index][1].initiations);
        Chart::new(title, [330.0, 330.0], Axis::new("x [m]"), Axis::new("y [m]"))
            .equal()
            .with(Series { pieces, ..Series::line("recovered", COLOURS[0], Vec::new()) })
            .with(Series::line("truth", REFERENCE, truth).dashed())
    };
    save(out, "strengths_fig43_circle", "Path on the circle (Figure 43)", 2, vec![around(0), around(2)]);
    let seen = |index: usize| {
        let strokes = &runs[index][1].strokes;
        let every = |first: usize| strokes.iter().skip(first).step_by(2).copied().collect();
        let title = format!("{} strength", STRENGTHS[index].0);
        Chart::new(title, [560.0, 230.0], Axis::new("x [px]"), Axis::new("−y [px]"))
            .equal()
            .with(Series::new("", Marks::Strokes, Pen::new("#777777", 0.7), strokes.clone()))
            .with(Series::dots("predicted", "#222222", every(1)))
            .with(Series::dots("observed", COLOURS[0], every(0)))
    };
    let title = "Observed and predicted points of one camera (Figure 44)";
    save(out, "strengths_fig44_predicted", title, 1, vec![seen(0), seen(1), seen(2)]);
}
