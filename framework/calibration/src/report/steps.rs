//! How the solution was approached, as [Davis 2002, Fig. 25] shows it.

use std::fmt::Write as _;

use foveate_plot::svg::Pen;
use foveate_plot::text::{count, escaped, fixed};
use foveate_plot::{Axis, Chart, Marks, Series};

use super::ReportInput;
use super::page::{PLOT, Page, SERIES, THEME};
use crate::convergence::{Convergence, settled};
use crate::solved::Step;

/// Steps that are drawn at most.
const DRAWN: usize = 2_000;
/// Stages in the table at most.
const STAGES: usize = 60;

pub(super) fn section(page: &mut Page, report: &ReportInput<'_>) {
    let own = report.solved.steps.as_slice();
    let usable = |it: &Step| it.rms_px > 0.0 && it.rms_px.is_finite();
    if !own.iter().any(usable) {
        return;
    }
    page.section(
        "convergence",
        "Convergence",
        "Root mean square of the residuals in use after each step. Steps that bring observations in may raise it; the bands are the stages \
         in the table.",
    );
    let all = || own.iter().filter(|it| usable(it)).map(|it| it.rms_px);
    let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max));
    let n = own.len();
    let last = n.max(2) as f64;
    let (bottom, top) = (0.8 * low, 1.25 * high);
    let stages = stages(own);
    let bands = stages.iter().skip(1).step_by(2).map(|stage| {
        let [from, to] = [stage.from, stage.to].map(|step| (step as f64 + 0.5).clamp(1.0, last));
        // Beyond the axis at either end, wherever its decades end.
        let (bottom, top) = (1e-3 * bottom, 1e3 * top);
        vec![[from, bottom], [to, bottom], [to, top], [from, top]]
    });
    let bands = Series {
        pieces: bands.collect(),
        ..Series::new("", Marks::Areas(0.45), Pen::new(THEME.grid, 1.0), Vec::new())
    };
    let every = n.div_ceil(DRAWN).max(1);
    let numbered = own.iter().enumerate().filter(|(index, _)| index % every == 0 || index + 1 == n);
    let shown: Vec<[f64; 2]> = numbered.map(|(index, step)| [index as f64 + 1.0, step.rms_px]).collect();
    let y = Axis::new("root mean square [px]").over(bottom, top).log();
    let mut chart = Chart::new("", [640.0, 250.0], Axis::new("step").over(1.0, last), y).with(bands).with(Series::new(
        "",
        Marks::Line,
        Pen::new(SERIES[0], 1.8),
        shown.clone(),
    ));
    if n <= 100 {
        chart = chart.with(Series::new("", Marks::Dots(3.0), Pen::new(SERIES[0], 1.0), shown));
    }
    page.raw(&format!("<figure>{}</figure>", chart.element(THEME, PLOT, "Convergence")));
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
         <th class=\"n\">observations in use</th></tr></thead><tbody>{rows}</tbody></table>"
    ));
    if stages.len() > STAGES {
        page.note(&format!("{} further stages are left out.", count(stages.len() - STAGES)));
    }
    if let Some(both) = report.convergence {
        from_a_poor_start(page, both);
    }
}

/// [Davis 2002, Fig. 25], in steps of which the first is the start, for the logarithm has no 0.
fn from_a_poor_start(page: &mut Page, both: &Convergence) {
    let all = || both.together.iter().chain(&both.in_turn).copied().filter(|it| *it > 0.0 && it.is_finite());
    let (low, high) = (all().fold(f64::INFINITY, f64::min), all().fold(0.0, f64::max));
    if !low.is_finite() {
        return;
    }
    let n = both.together.len().max(both.in_turn.len()).max(2);
    let x = Axis::new("1 is the start, then each turn or step").over(1.0, n as f64).log();
    let y = Axis::new("root mean square on moments held out [px]").over(0.8 * low, 1.25 * high).log();
    let mut chart = Chart::new("", [640.0, 260.0], x, y);
    for (colour, errors) in SERIES.into_iter().zip([&both.together, &both.in_turn]) {
        let points = errors.iter().enumerate().map(|(index, it)| [index as f64 + 1.0, *it]).collect();
        chart = chart.with(Series::new("", Marks::Line, Pen::new(colour, 1.8), points));
    }
    page.raw(&format!(
        "<figure>{}<figcaption><span class=\"key s0\">path and cameras together (bundle adjustment)</span><span class=\"key s1\">in turn \
         [Davis 2002 §3.2]</span></figcaption></figure>",
        chart.element(THEME, PLOT, "From a poor start")
    ));
    page.note(&format!(
        "From cameras that are {} off: within 1 % of the end after {} steps together, and after {} turns of path and cameras; {} px and {} px \
         at the end.",
        escaped(&both.start),
        settled(&both.together),
        settled(&both.in_turn),
        fixed(both.together.last().copied().unwrap_or(f64::NAN), 3),
        fixed(both.in_turn.last().copied().unwrap_or(f64::NAN), 3)
    ));
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
