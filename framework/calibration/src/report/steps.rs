//! How the solution was approached, as [Davis 2002, Fig. 25] shows it.

use std::fmt::Write as _;

use super::ReportInput;
use super::page::{Page, count, escaped, fixed};
use super::svg::{Axis, Plot, short};
use crate::solved::Step;

/// Steps that are drawn at most.
const DRAWN: usize = 2_000;
/// Stages in the table at most.
const STAGES: usize = 60;

pub(super) fn section(page: &mut Page, report: &ReportInput<'_>) {
    let own = report.solved.steps.as_slice();
    let (second_name, second) = report.second.unwrap_or(("", &[]));
    let usable = |steps: &[Step]| steps.iter().any(|it| it.rms_px > 0.0 && it.rms_px.is_finite());
    if !usable(own) && !usable(second) {
        return;
    }
    page.section(
        "convergence",
        "Convergence",
        "Root mean square of the residuals in use after each step. Steps that bring sightings in may raise it; the bands are the stages \
         in the table.",
    );
    let all = || own.iter().chain(second).map(|it| it.rms_px).filter(|it| *it > 0.0 && it.is_finite());
    let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max));
    let n = own.len().max(second.len());
    let x = Axis::linear(1.0, n.max(2) as f64, "step");
    let mut plot =
        Plot::new([720.0, 300.0], x, Axis::log(0.8 * low, 1.25 * high, "root mean square [px]"), "Convergence");
    let stages = stages(own);
    let [_, top, _, bottom] = plot.frame();
    for stage in stages.iter().skip(1).step_by(2) {
        let half = |step: usize| plot.x((step as f64 + 0.5).clamp(1.0, n.max(2) as f64));
        let (from, to) = (half(stage.from), half(stage.to));
        plot.raw(&format!(
            "<rect class=\"band\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\"/>",
            short(from),
            short(top),
            short(to - from),
            short(bottom - top)
        ));
    }
    for (class, steps) in [("s0", own), ("s1", second)] {
        let every = steps.len().div_ceil(DRAWN).max(1);
        let last = steps.len().saturating_sub(1);
        let shown = || {
            let numbered = steps.iter().enumerate().filter(move |(index, _)| index % every == 0 || *index == last);
            numbered.map(|(index, step)| (index as f64 + 1.0, step.rms_px))
        };
        plot.line(&format!("line {class}"), shown());
        if steps.len() <= 100 {
            plot.dots(&format!("marks {class}"), shown());
        }
    }
    let keys = if second.is_empty() {
        String::new()
    } else {
        format!(
            "<figcaption><span class=\"key s0\">bundle adjustment</span><span class=\"key s1\">{}</span></figcaption>",
            escaped(second_name)
        )
    };
    page.raw(&format!("<figure>{}{keys}</figure>", plot.finish()));
    if n > DRAWN {
        page.note(&format!("Of {} steps, every {} is drawn.", count(n), ordinal(n.div_ceil(DRAWN))));
    }
    let mut rows = String::new();
    for stage in stages.iter().take(STAGES) {
        let steps = if stage.to == stage.from + 1 {
            stage.to.to_string()
        } else {
            format!("{}–{}", stage.from + 1, stage.to)
        };
        let last = &own[stage.to - 1];
        let _ = write!(
            rows,
            "<tr><td>{}</td><td class=\"n\">{steps}</td><td class=\"n\">{}</td><td class=\"n\">{}</td></tr>",
            escaped(last.stage),
            fixed(last.rms_px, 4),
            count(last.used)
        ); // writing to a String cannot fail
    }
    page.raw(&format!(
        "<table class=\"steps\"><thead><tr><th>stage</th><th class=\"n\">steps</th><th class=\"n\">root mean square at its end [px]</th>\
         <th class=\"n\">sightings in use</th></tr></thead><tbody>{rows}</tbody></table>"
    ));
    if stages.len() > STAGES {
        page.note(&format!("{} further stages are left out.", count(stages.len() - STAGES)));
    }
}

fn ordinal(number: usize) -> String {
    let ending = match (number % 10, number % 100) {
        (_, 11..=13) => "th",
        (1, _) => "st",
        (2, _) => "nd",
        (3, _) => "rd",
        _ => "th",
    };
    format!("{number}{ending}")
}

/// Steps of one stage that follow each other: from `from`, counted from 0, to before `to`.
struct Stage {
    from: usize,
    to: usize,
}

fn stages(steps: &[Step]) -> Vec<Stage> {
    let mut stages: Vec<Stage> = Vec::new();
    for (index, step) in steps.iter().enumerate() {
        match stages.last_mut() {
            Some(last) if steps[last.from].stage == step.stage => last.to = index + 1,
            _ => stages.push(Stage { from: index, to: index + 1 }),
        }
    }
    stages
}
