//! How well, and how fast, arms of other shapes are fitted: `cargo bench -p foveate-geometry --bench bodies` (100 arms; another number behind `--` for more or fewer).
//!
//! Joints are clicked 40 mm off, 500 points have noise of 0.5 mm, one in fifty is wrong by up to a decimetre. Three metaballs a limb, all together and shape and posture in turn; one ellipsoid a limb; then
//! an arm whose shape is known, from a posture 0.05 rad off, as from message to message.

use std::time::Instant;

use foveate_estimation::statistics::percentile;
use foveate_geometry::metaball::{BodyFitOptions, Free, ResidualKind, Side, State, anthropometric, arm, fit_body};
use nalgebra::Isometry3;

/// The names that [`loft`] knows.
mod metaball {
    pub use foveate_geometry::metaball::{Body, BodyObservation, State};
}
#[path = "../src/metaball/tests/loft.rs"]
mod loft;

use loft::LoftArm;

/// Seeds that nothing was tuned on begin here.
const FIRST_SEED: u64 = 1000;

fn said(values: &[f64]) -> String {
    let at = |percent: f64| percentile(values, percent).unwrap_or(f64::NAN);
    format!("{:.2} / {:.2} / {:.2}", at(50.0), at(90.0), at(100.0))
}

fn main() {
    let n = std::env::args().filter_map(|it| it.parse().ok()).next().unwrap_or(100);
    println!("{n} arms; median / 90 % / worst");
    let cases = [
        ("three, together", 3, false, ResidualKind::Field),
        ("three, in turn", 3, true, ResidualKind::Field),
        ("three, distances", 3, false, ResidualKind::Distance),
        ("one ellipsoid", 1, false, ResidualKind::Field),
    ];
    for (name, balls, in_turn, residual) in cases {
        let [mut bones, mut elbows, mut radii] = [const { Vec::new() }; 3];
        let (mut steps, mut doubted, mut near_steps) = (0, 0, 0);
        let [mut whole_s, mut near_s] = [f64::INFINITY; 2];
        for seed in FIRST_SEED..FIRST_SEED + n {
            let truth = LoftArm::draw(seed);
            let (mut body, mut start) = arm(Side::Right, 1.75);
            for segment in 0..if balls == 3 { 0 } else { 2 } {
                (body, start) = body.refined(&start, segment, balls);
            }
            let at = truth.joints[0];
            start.world_from_root =
                Isometry3::translation(at.x + 0.05, at.y - 0.05, at.z + 0.05) * start.world_from_root;
            let points = truth.points(500, 0.0005, seed);
            let all = [truth.clicks(&body, 0.04, seed), points.clone()].concat();
            let mut priors = anthropometric(&start);
            priors.root.iter_mut().for_each(|it| it.turn_sigma = 2.0);
            let options = BodyFitOptions { in_turn, residual, ..BodyFitOptions::default() };
            let began = Instant::now();
            let Ok(fit) = fit_body(&body, &all, &start, &priors, &options) else { continue };
            whole_s = whole_s.min(began.elapsed().as_secs_f64());
            let (angles, widths) = truth.errors(&body, &fit.state);
            bones.extend(angles[..2].iter().map(|it| it.abs()));
            elbows.push(angles[2].abs());
            radii.extend(widths.iter().map(|it| 1e3 * it.abs()));
            steps += fit.iterations;
            doubted += u32::from(!fit.doubts.is_empty());
            let angles = fit.state.angles.iter().map(|it| it + 0.05).collect();
            let off = State { angles, ..fit.state.clone() };
            let near = BodyFitOptions { free: Free::POSTURE, rough: false, ..options };
            let began = Instant::now();
            if let Ok(fit) = fit_body(&body, &points, &off, &priors, &near) {
                near_s = near_s.min(began.elapsed().as_secs_f64());
                near_steps += fit.iterations;
            }
        }
        println!("{name}: bones {} deg, elbow {} deg, radii {} mm", said(&bones), said(&elbows), said(&radii));
        println!(
            "    {:.0} steps, {:.1} ms at best, {doubted} doubted; shape known: {:.0} steps, {:.2} ms at best",
            f64::from(steps) / n as f64,
            1e3 * whole_s,
            f64::from(near_steps) / n as f64,
            1e3 * near_s
        );
    }
}
