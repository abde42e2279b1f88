//! Figure 67: more and more marks hidden as the frames go on.

use std::path::Path;

use foveate::estimation::Random;
use foveate::geometry::ShapeFitter;
use foveate::plot::{Axis, Chart, Series};

use crate::chart::save;
use crate::methods::{NOISE, fill, methods, percentile_mm};
use crate::takes::{Frame, Head, recorded, simulated, spread};

const COLOURS: [&str; 3] = ["#999933", "#009e73", "#0072b2"];
const FRAMES: usize = 431;
const MODEL_FRAMES: usize = 321;
/// Frames that one point of the plot stands for.
const GROUP: usize = 24;

struct Case {
    name: &'static str,
    model_of: Vec<Frame>,
    tried_on: Vec<Frame>,
    /// Marks seen in the first frame and in the last one.
    seen: [usize; 2],
}

/// Table, and error over the number of marks that are hidden.
pub fn fewer(out: Option<&Path>) {
    let mut cases = Vec::new();
    for (name, head) in
        [("simulated actor, 76 marks", Head::BuiltIn), ("simulated actor, recorded head, 76 marks", Head::Ict)]
    {
        let Some([shown, acted]) = simulated(head, 76, 16.0, NOISE) else { continue };
        let (model_of, tried_on) = (spread(&shown, MODEL_FRAMES, 0.0), spread(&acted, FRAMES, 0.0));
        cases.push(Case { name, model_of, tried_on, seen: [42, 16] });
    }
    if let (Some(jaw), Some(cheeks)) = (recorded("Jaw"), recorded("Cheeks")) {
        for (name, take) in [("Jaw, 41 marks, frames between", jaw), ("Cheeks, 41 marks, frames between", cheeks)] {
            let (model_of, tried_on) = (spread(&take, MODEL_FRAMES, 0.0), spread(&take, FRAMES, 0.5));
            cases.push(Case { name, model_of, tried_on, seen: [23, 9] });
        }
    }
    let mut charts = Vec::new();
    for case in cases {
        println!("{}: {} to {} marks seen over {FRAMES} frames", case.name, case.seen[0], case.seen[1]);
        println!("| way | median | p95 | median of the last 60 frames | (error / stated)² |\n|---|---|---|---|---|");
        let mut series = Vec::new();
        for (method, colour) in methods(&case.model_of, true).into_iter().zip(COLOURS) {
            let (all, by_frame, stated) = run(&case, &mut ShapeFitter::new(method.model));
            let last: Vec<f64> = by_frame[FRAMES - 60..].iter().flatten().copied().collect();
            println!(
                "| {} | {:.2} mm | {:.2} mm | {:.2} mm | {stated:.2} |",
                method.name,
                percentile_mm(&all, 50.0),
                percentile_mm(&all, 95.0),
                percentile_mm(&last, 50.0),
            );
            let curve = |percent: f64| -> Vec<[f64; 2]> {
                let point = |group: &[Vec<f64>]| {
                    let lengths: Vec<f64> = group.iter().flatten().copied().collect();
                    let hidden = lengths.len() as f64 / group.len() as f64;
                    [hidden, percentile_mm(&lengths, percent)]
                };
                by_frame.chunks(GROUP).map(point).collect()
            };
            series.push(Series::line(format!("{}, median", method.name), colour, curve(50.0)));
            series.push(Series::line(format!("{}, p95", method.name), colour, curve(95.0)).dashed());
        }
        println!();
        let (x, y) = (Axis::new("hidden marks [–]"), Axis::new("error of filled marks [mm]"));
        charts.push(Chart { series, ..Chart::new(case.name, [560.0, 240.0], x, y) });
    }
    save(out, "faces_fewer", "Fewer and fewer marks seen (Figure 67)", 1, charts);
}

/// By frame: the errors of the hidden marks.
type ByFrame = Vec<Vec<f64>>;

fn run(case: &Case, fitter: &mut ShapeFitter) -> (Vec<f64>, ByFrame, f64) {
    let n = case.tried_on[0].len();
    let mut order: Vec<usize> = (0..n).collect();
    let mut random = Random::new(67);
    for place in (1..n).rev() {
        order.swap(place, random.below(place as u32 + 1) as usize);
    }
    let (mut all, mut by_frame, mut squares) = (Vec::new(), Vec::new(), 0.0);
    for (index, frame) in case.tried_on.iter().enumerate() {
        let part = index as f64 / (FRAMES - 1) as f64;
        let seen = (case.seen[0] as f64 + part * (case.seen[1] as f64 - case.seen[0] as f64)).round() as usize;
        let Some(one) = fill(fitter, frame, &order[seen..]) else { continue };
        let lengths: Vec<f64> = one.errors.iter().map(|it| it.norm()).collect();
        squares += one.squares / 3.0;
        all.extend(&lengths);
        by_frame.push(lengths);
    }
    let stated = squares / all.len() as f64;
    (all, by_frame, stated)
}
