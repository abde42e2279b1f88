//! Figures 65 and 66: some marks hidden for 100 frames.

use std::path::Path;

use foveate::estimation::Random;
use foveate::estimation::statistics::median;
use foveate::geometry::ShapeFitter;
use foveate::plot::{Axis, Chart, Series};

use crate::chart::save;
use crate::methods::{Method, NOISE, fill, methods, percentile_mm};
use crate::takes::{Frame, Head, recorded, simulated, spread};

const COLOURS: [&str; 7] = ["#888888", "#cc79a7", "#d55e00", "#999933", "#009e73", "#56b4e9", "#0072b2"];

struct Case {
    name: &'static str,
    model_of: Vec<Frame>,
    tried_on: Vec<Frame>,
    n_hidden: usize,
    /// The two axes of the frontal plane.
    frontal: [usize; 2],
}

fn cases() -> Vec<Case> {
    let mut cases = Vec::new();
    for (name, head) in
        [("simulated actor, 11 of 69", Head::BuiltIn), ("simulated actor, recorded head, 11 of 69", Head::Ict)]
    {
        let Some([shown, acted]) = simulated(head, 69, 40.0, NOISE) else { continue };
        let (model_of, tried_on) = (spread(&shown, 200, 0.0), spread(&acted, 100, 0.0));
        cases.push(Case { name, model_of, tried_on, n_hidden: 11, frontal: [1, 2] });
    }
    if let (Some(jaw), Some(cheeks)) = (recorded("Jaw"), recorded("Cheeks")) {
        let (jaw_half, jaw_rest) = jaw.split_at(jaw.len() / 2);
        let mut case = |name, model_of: Vec<Frame>, tried_on: Vec<Frame>, n_hidden| {
            cases.push(Case { name, model_of, tried_on, n_hidden, frontal: [0, 1] });
        };
        for (name, n_hidden) in [("Jaw, frames between, 7 of 41", 7), ("Jaw, frames between, 11 of 41", 11)] {
            case(name, spread(&jaw, 200, 0.0), spread(&jaw, 100, 0.25), n_hidden);
        }
        case("Cheeks, frames between, 11 of 41", spread(&cheeks, 200, 0.0), spread(&cheeks, 100, 0.25), 11);
        case("Jaw, first half to second, 11 of 41", spread(jaw_half, 200, 0.0), spread(jaw_rest, 100, 0.0), 11);
        case("Jaw to Cheeks, 11 of 41", spread(&jaw, 200, 0.0), spread(&cheeks, 100, 0.0), 11);
    }
    cases
}

/// `count` different marks of `n`.
fn some(count: usize, n: usize, random: &mut Random) -> Vec<usize> {
    let mut all: Vec<usize> = (0..n).collect();
    for place in (1..n).rev() {
        all.swap(place, random.below(place as u32 + 1) as usize);
    }
    all.truncate(count);
    all
}

/// Tables, and the scatter of errors in the frontal plane.
pub fn filled(out: Option<&Path>) {
    let mut charts = Vec::new();
    for case in cases() {
        println!("{}: model of {} frames, tried on {}", case.name, case.model_of.len(), case.tried_on.len());
        println!(
            "| way | median | p95 | largest | (error / stated)² | outside | a fit |\n|---|---|---|---|---|---|---|"
        );
        for (method, colour) in methods(&case.model_of, false).into_iter().zip(COLOURS) {
            let scatter = try_one(&case, method);
            let name = scatter.0;
            if ["80 faces, weights 0 to 1", "80 components, prior"].contains(&name) {
                let points = scatter.1;
                let (x, y) = (Axis::new("to the side [mm]"), Axis::new("up [mm]"));
                let chart = Chart::new(format!("{}: {name}", case.name), [300.0, 300.0], x, y)
                    .equal()
                    .with(Series::dots(name, colour, points))
                    .with(Series::line("1.5 mm, the paper's", "#000000", circle(1.5)));
                charts.push(chart);
            }
        }
        println!();
    }
    save(out, "faces_filled", "Errors of filled marks, frontal plane (Figure 66)", 2, charts);
}

/// Four different choices of hidden marks, each for all frames, as in the paper.
fn try_one(case: &Case, method: Method) -> (&'static str, Vec<[f64; 2]>) {
    let mut fitter = ShapeFitter::new(method.model);
    let (mut lengths, mut points, mut squares, mut out_of_distribution, mut times) =
        (vec![], vec![], 0.0, vec![], vec![]);
    let mut random = Random::new(11);
    for _ in 0..4 {
        let hidden = some(case.n_hidden, case.tried_on[0].len(), &mut random);
        for frame in &case.tried_on {
            let Some(one) = fill(&mut fitter, frame, &hidden) else { continue };
            lengths.extend(one.errors.iter().map(|it| it.norm()));
            points.extend(one.errors.iter().map(|it| case.frontal.map(|axis| it[axis] * 1e3)));
            squares += one.squares / 3.0;
            out_of_distribution.push(one.out_of_distribution);
            times.push(one.ms);
        }
    }
    let mean_out_of_distribution = out_of_distribution.iter().sum::<f64>() / out_of_distribution.len() as f64;
    println!(
        "| {} | {:.2} mm | {:.2} mm | {:.1} mm | {:.2} | {mean_out_of_distribution:.2} | {:.2} ms |",
        method.name,
        percentile_mm(&lengths, 50.0),
        percentile_mm(&lengths, 95.0),
        percentile_mm(&lengths, 100.0),
        squares / lengths.len() as f64,
        median(&times).unwrap_or(f64::NAN),
    );
    (method.name, points)
}

fn circle(radius: f64) -> Vec<[f64; 2]> {
    (0..=72).map(|it| f64::from(it * 5).to_radians()).map(|it| [radius * it.cos(), radius * it.sin()]).collect()
}
