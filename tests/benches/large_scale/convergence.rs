//! Figure 25: pixel error on independent observations against the turns of the paper's calibration, and of what takes its place.

use foveate::estimation::Random;
use foveate::geometry::bundle::Observation;
use foveate::geometry::{Camera, path_error};
use foveate::plot::{Axis, COLOURS, Chart, Series};
use foveate_calibration::convergence::{poor_start, settled, side_by_side};
use nalgebra::{Point2, Point3};

use super::Options;
use super::chart::save;

const N_CAMERAS: usize = 18;
const N_POINTS: usize = 600;
const TURNS: usize = 300;
const STEPS: u32 = 30;
const SIGMA_PX: f64 = 0.5;
/// Every camera that can see a point has its observation of it.
const STARTS: [(f64, f64); 2] = [(3.0, 0.1), (10.0, 0.4)];

/// Cameras under the ceiling around 3.5 × 5 m, as §3.1 has them.
fn lab(random: &mut Random) -> Vec<Camera> {
    let camera = |index: usize| {
        let angle = std::f64::consts::TAU * index as f64 / N_CAMERAS as f64;
        let centre = Point3::new(2.6 * angle.cos(), 3.4 * angle.sin(), 2.7 + 0.2 * random.normal());
        let mut across = || angle + std::f64::consts::PI * (0.6 + 0.8 * random.uniform());
        let target = Point3::new(0.9 * across().cos(), 1.3 * across().sin(), 1.0);
        Camera::look_at(centre, target, [640, 480], 420.0)
    };
    (0..N_CAMERAS).map(camera).collect()
}

/// A path through 3.5 × 5 m from 0.5 to 2 m of height, other for each `phase`, and what all cameras see of it.
fn observations(cameras: &[Camera], phase: f64, random: &mut Random) -> Vec<Observation> {
    let mut all = Vec::new();
    for point in 0..N_POINTS {
        let turn = std::f64::consts::TAU * point as f64 / N_POINTS as f64;
        let at = |amplitude: f64, speed: f64| amplitude * (speed * turn + phase * speed).sin();
        let place = Point3::new(at(1.7, 5.0), at(2.4, 3.3), 1.25 + at(0.7, 7.1));
        for (camera, it) in cameras.iter().enumerate() {
            let Some(seen) = it.sees(&place) else { continue };
            let pixel = Point2::new(seen.x + SIGMA_PX * random.normal(), seen.y + SIGMA_PX * random.normal());
            all.push(Observation { camera, point, pixel, sigma_px: SIGMA_PX });
        }
    }
    all
}

pub fn convergence(options: &Options) {
    let mut random = Random::new(25);
    let truth = lab(&mut random);
    let seen = observations(&truth, 0.3, &mut random);
    let independent = observations(&truth, 1.1, &mut random);
    println!(
        "Figure 25: {N_CAMERAS} cameras, {} observations of {N_POINTS} points, {SIGMA_PX} px of noise; error on {} independent ones",
        seen.len(),
        independent.len()
    );
    println!("truth itself: {:.4} px\n", path_error(&truth, &independent).unwrap_or(f64::NAN));
    println!(
        "| start off by | method | at the start | after 1 | 3 | 10 | 30 | 100 | at the end | within 1 % of it after |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let mut series = Vec::new();
    for (index, start) in STARTS.into_iter().enumerate() {
        let cameras = poor_start(&truth, start.0, start.1, &mut random);
        let (of_steps, of_turns) = side_by_side(&cameras, &seen, &independent, TURNS, STEPS).unwrap_or_default();
        let name = format!("{} degrees, {} m", start.0, start.1);
        for (what, errors) in [("in turn", of_turns), ("together", of_steps)] {
            let at = |turn: usize| errors.get(turn).map_or_else(|| "".to_owned(), |it| format!("{it:.3}"));
            let columns: Vec<String> = [0, 1, 3, 10, 30, 100, errors.len().max(1) - 1].into_iter().map(at).collect();
            println!("| {name} | {what} | {} | {} |", columns.join(" | "), settled(&errors));
            // The logarithm has no 0: the start stands at 1.
            let points = errors.iter().enumerate().map(|(turn, it)| [turn as f64 + 1.0, *it]).collect();
            let line = Series::line(format!("{what}, {name}"), COLOURS[index], points);
            series.push(if what == "together" { line.dashed() } else { line });
        }
    }
    let x = Axis::new("estimates so far: 1 is the start, then each turn or step").log();
    let y = Axis::new("root mean square [px]").log();
    let chart = Chart { series, ..Chart::new("error on independent observations", [520.0, 300.0], x, y) };
    let title = "Convergence of calibration: path and cameras in turn, or together";
    save(options.out.as_deref(), "convergence", title, 1, vec![chart]);
}
