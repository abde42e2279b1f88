//! Report section: the verdict and the tables.

use std::fmt::Write as _;

use foveate_geometry::self_calibration::{CameraStatus, Link};
use foveate_plot::svg::{Pen, SMALL};
use foveate_plot::text::{count, escaped, fitted, fixed, rounded};
use foveate_plot::{Axis, Chart, Marks, Series};
use foveate_scene::Fixed;

use super::figures::{Figures, quantile, rms};
use super::page::{PLOT, Page, SERIES, THEME, small_length};
use super::{Grade, ReportInput};
use crate::solved::{Solved, SolvedCamera};

/// Verdict, key figures, what is fixed.
pub(super) fn head(page: &mut Page, report: &ReportInput<'_>, figures: &Figures) {
    let solved = report.solved;
    page.section("verdict", "Verdict", "");
    let (class, word, sentences) = match report.verdict {
        Some(verdict) => {
            let (class, word) = match verdict.grade {
                Grade::Good => ("good", "Good"),
                Grade::Usable => ("usable", "Usable"),
                Grade::Redo => ("redo", "Redo"),
            };
            (class, word, verdict.sentences)
        }
        None => ("none", "Not judged", [].as_slice()),
    };
    let items: String = sentences.iter().map(|it| format!("<li>{}</li>", escaped(it))).collect();
    let items = match report.verdict {
        Some(verdict) if verdict.more > 0 => format!("{items}<li>and {} more in verdict.txt</li>", verdict.more),
        _ => items,
    };
    let list = if items.is_empty() { String::new() } else { format!("<ul>{items}</ul>") };
    page.raw(&format!("<div class=\"verdict {class}\"><strong>{word}</strong>{list}</div>"));

    let n_calibrated = solved.cameras.iter().filter(|it| it.status == CameraStatus::Calibrated).count();
    let n_used: usize = figures.cameras.iter().map(|it| it.counts[0]).sum();
    let n_held_out: usize = figures.cameras.iter().map(|it| it.counts[1]).sum();
    let n_rejected: usize = figures.cameras.iter().map(|it| it.counts[2]).sum();
    let px = |list: &[f64], part: f64| format!("{} px", fixed(quantile(list, part), 3));
    let mut tiles = String::new();
    for (value, name) in [
        (format!("{n_calibrated} of {}", solved.cameras.len()), "cameras calibrated"),
        (count(figures.n_frames), "frames with the light"),
        (count(n_used), "observations used"),
        (px(&figures.used_px, 0.5), "median residual, used"),
        (px(&figures.held_out_px, 0.5), "median residual, held out"),
        (format!("{} px", fixed(rms(&figures.used_px), 3)), "root mean square, used"),
        (count(n_held_out), "observations held out"),
        (count(n_rejected), "observations rejected"),
    ] {
        let _ = write!(tiles, "<div class=\"tile\"><b>{value}</b><span>{name}</span></div>"); // writing to a String cannot fail
    }
    page.raw(&format!("<div class=\"tiles\">{tiles}</div>"));

    let fixed_rows = [
        ("Scale", &solved.fixed.scale, "the unit of length is arbitrary"),
        ("Vertical", &solved.fixed.gravity, "Z points anywhere"),
        ("Origin", &solved.fixed.origin, "the origin is arbitrary"),
    ];
    let mut rows = String::new();
    for (name, fixed_by, otherwise) in fixed_rows {
        let (by, sigma) = match fixed_by {
            Some(Fixed { by, sigma }) => {
                (escaped(by), sigma.map_or_else(|| "not known".to_owned(), |it| freedom_sigma(name, it, report.unit)))
            }
            None => (format!("<em>nothing: {otherwise}</em>"), "–".to_owned()),
        };
        let _ = write!(rows, "<tr><th scope=\"row\">{name}</th><td>{by}</td><td class=\"n\">{sigma}</td></tr>");
    }
    page.raw(&format!(
        "<table class=\"fixed\"><caption>What pictures do not determine</caption><thead><tr><th></th><th>fixed by</th><th class=\"n\">σ</th></tr>\
         </thead><tbody>{rows}</tbody></table>"
    ));
}

fn freedom_sigma(name: &str, sigma: f64, unit: &str) -> String {
    match name {
        "Scale" => format!("{} %", rounded(100.0 * sigma)),
        "Vertical" => format!("{}°", rounded(sigma.to_degrees())),
        _ => small_length(sigma, unit),
    }
}

/// Name of a camera by its number.
pub(super) fn name_of(solved: &Solved, camera: usize) -> String {
    solved.cameras.get(camera).map_or_else(|| format!("camera {camera}"), |it| it.name.clone())
}

/// The status with the names of cameras in place of their numbers.
pub(super) fn status_in_words(solved: &Solved, camera: &SolvedCamera) -> String {
    let name = |it: &usize| name_of(solved, *it);
    match &camera.status {
        CameraStatus::NoPartner { best: Some(best), common, needed } => {
            format!("shares {common} frames with {} and fewer with others, {needed} are needed", name(best))
        }
        CameraStatus::Inconsistent { best, common, right } if *common > 0 => {
            format!("no pose explains its pixels: with {}, {right} of {common} common frames fit", name(best))
        }
        CameraStatus::ClockOpen { best: Some(best) } => {
            format!("its clock could not be found; closest was that of {}", name(best))
        }
        CameraStatus::NoDepth { best } => {
            format!("is at the same place as {}, or the light is too far away", name(best))
        }
        CameraStatus::Separate { group } => {
            let names: Vec<String> = group.iter().take(6).map(name).collect();
            let more = if group.len() > names.len() { " and others" } else { "" };
            format!("shares too few frames with the larger group; its own is {}{more}", names.join(", "))
        }
        other => other.to_string(),
    }
}

/// The table of the cameras.
pub(super) fn cameras(page: &mut Page, report: &ReportInput<'_>, figures: &Figures) {
    let solved = report.solved;
    let unit = escaped(report.unit);
    page.section(
        "cameras",
        "Cameras",
        "Residuals are distances between where a light was seen and where the solution has it. Held-out observations were not used in the \
         solution: where theirs are much larger than those of the used, the solution follows the noise. ± is one standard deviation.",
    );
    let mut rows = String::new();
    for (camera, of) in solved.cameras.iter().zip(&figures.cameras) {
        let calibrated = camera.status == CameraStatus::Calibrated;
        let (class, mark) = if calibrated { ("good", "●") } else { ("redo", "▲") };
        let status = escaped(&status_in_words(solved, camera));
        let pair = |list: &[f64]| format!("{} / {}", fixed(quantile(list, 0.5), 2), fixed(quantile(list, 0.9), 2));
        let [focal_x, focal_y] = camera.camera.intrinsics.focal;
        let focal = if (focal_x / focal_y - 1.0).abs() < 1e-6 {
            fixed(focal_x, 1)
        } else {
            format!("{}, {}", fixed(focal_x, 1), fixed(focal_y, 1))
        };
        let focal_sigma = match &camera.covariance {
            Some(it) if camera.freed.focal => format!(" ± {}", rounded(it.optics.focal * focal_x)),
            _ if camera.freed.focal => String::new(),
            _ => " <small>given</small>".to_owned(),
        };
        let centre = if calibrated {
            let centre = camera.camera.centre();
            format!("{}, {}, {}", fixed(centre.x, 3), fixed(centre.y, 3), fixed(centre.z, 3))
        } else {
            "–".to_owned()
        };
        let centre_sigma = camera
            .covariance
            .as_ref()
            .filter(|it| calibrated && it.centre.iter().all(|it| it.is_finite()))
            .map_or_else(
                || "–".to_owned(),
                |it| small_length(it.centre.symmetric_eigenvalues().max().max(0.0).sqrt(), report.unit),
            );
        let clock = camera.clock.map_or_else(
            || "–".to_owned(),
            |it| format!("{} ± {}", fixed(1e3 * it.offset_s, 2), rounded(1e3 * it.sigma_s)),
        );
        let _ = write!(
            rows,
            "<tr><th scope=\"row\">{}</th><td class=\"s\"><span class=\"{class}\">{mark}</span> {status}</td><td class=\"n\">{}</td>\
             <td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{focal}{focal_sigma}</td><td class=\"n\">{centre}</td>\
             <td class=\"n\">{centre_sigma}</td><td class=\"n\">{clock}</td><td class=\"n\">{}</td></tr>",
            escaped(&camera.name),
            count(of.counts[0] + of.counts[1]),
            pair(&of.used_px),
            pair(&of.held_out_px),
            of.links,
        );
    }
    page.raw(&format!(
        "<div class=\"wide\"><table class=\"cameras\"><thead><tr><th>camera</th><th>status</th><th class=\"n\">observations</th>\
         <th class=\"n\">used, median / 90 % [px]</th><th class=\"n\">held out, median / 90 % [px]</th><th class=\"n\">focal length [px]</th>\
         <th class=\"n\">centre x, y, z [{unit}]</th><th class=\"n\">σ of it, longest axis</th><th class=\"n\">clock offset [ms]</th>\
         <th class=\"n\">links</th></tr></thead><tbody>{rows}</tbody></table></div>"
    ));
}

/// The clocks with their error bars.
pub(super) fn clocks(page: &mut Page, report: &ReportInput<'_>) {
    let known: Vec<(&str, f64, f64, f64)> = report
        .solved
        .cameras
        .iter()
        .filter_map(|it| {
            it.clock.map(|clock| (it.name.as_str(), 1e3 * clock.offset_s, 1e3 * clock.sigma_s, 1e6 * clock.drift))
        })
        .filter(|it| it.1.is_finite())
        .collect();
    if known.is_empty() {
        return;
    }
    page.section(
        "clocks",
        "Clocks",
        "Added to a camera's time to get the network's time. Bars are ± 2 σ; where they are shorter than the dot, they hide \
         behind it. Drift is how much faster the network's clock runs.",
    );
    let ends = known.iter().flat_map(|it| [it.1 - 2.0 * finite(it.2), it.1 + 2.0 * finite(it.2)]);
    let (low, high) = ends.fold((0.0_f64, 0.0_f64), |(low, high), it| (low.min(it), high.max(it)));
    let margin = 0.05 * (high - low).max(1e-3);
    let rows = known.iter().map(|it| format!("{}  {} ppm", fitted(it.0, SMALL, 100.0), fixed(it.3, 1)));
    let (mut bars, mut centres) = (Vec::new(), Vec::new());
    for (index, &(_, offset, sigma, _)) in known.iter().enumerate() {
        let (row, reach) = (Axis::row(index), 2.0 * finite(sigma));
        bars.extend([[offset - reach, row], [offset + reach, row]]);
        centres.push([offset, row]);
    }
    let x = Axis::new("offset [ms]").over(low - margin, high + margin);
    let chart = Chart::new("", [520.0, 18.0 * known.len() as f64], x, Axis::of_rows(rows))
        .with(Series::new("", Marks::Strokes, Pen::new(SERIES[0], 2.0), bars))
        .with(Series::new("", Marks::Dots(3.0), Pen::new(SERIES[0], 1.0), centres));
    page.raw(&chart.element(THEME, PLOT, "Clock offsets"));
}

fn finite(value: f64) -> f64 {
    if value.is_finite() { value } else { 0.0 }
}

/// What was not used, and why.
pub(super) fn rejected(page: &mut Page, report: &ReportInput<'_>, figures: &Figures) {
    let solved = report.solved;
    page.section("rejected", "What was left out", "");
    let mut items: Vec<String> = report.rejected.to_vec();
    for camera in solved.cameras.iter().filter(|it| it.status != CameraStatus::Calibrated) {
        items.push(format!("camera {}: {}", camera.name, status_in_words(solved, camera)));
    }
    for (camera, of) in solved.cameras.iter().zip(&figures.cameras) {
        let [used, held_out, rejected, unsolved] = of.counts;
        let all = used + held_out + rejected + unsolved;
        if rejected > 0 {
            let share = 100.0 * rejected as f64 / all as f64;
            items.push(format!(
                "camera {}: {} of {} {} the rest ({} %)",
                camera.name,
                count(rejected),
                count(all),
                if all == 1 { "observation contradicts" } else { "observations contradict" },
                fixed(share, 1)
            ));
        }
        if unsolved > 0 && camera.status == CameraStatus::Calibrated {
            items.push(format!(
                "camera {}: {} of lights whose place was not found",
                camera.name,
                observations(unsolved)
            ));
        }
    }
    let apart: Vec<&Link> = solved.links.iter().filter(|it| !it.consistent).collect();
    let share = |it: &&Link| it.right as f64 / it.common.max(1) as f64;
    if let Some(worst) = apart.iter().copied().min_by(|a, b| share(a).total_cmp(&share(b))) {
        let [a, b] = [worst.a, worst.b].map(|it| name_of(solved, it));
        let who = match apart.len() {
            1 => format!("the link of {a} and {b} contradicts the other links"),
            n => format!("{n} links between cameras contradict the other links; the worst is that of {a} and {b}"),
        };
        items.push(format!("{who} ({} of {} frames fit)", worst.right, worst.common));
    }
    if figures.n_bad > 0 {
        items.push(format!("{} by cameras that do not exist", observations(figures.n_bad)));
    }
    if items.is_empty() {
        page.raw("<p>Nothing.</p>");
        return;
    }
    let list: String = items.iter().map(|it| format!("<li>{}</li>", escaped(it))).collect();
    page.raw(&format!("<ul class=\"rejected\">{list}</ul>"));
}

fn observations(n: usize) -> String {
    format!("{} {}", count(n), if n == 1 { "observation" } else { "observations" })
}

/// How the calibration was made.
pub(super) fn provenance(page: &mut Page, report: &ReportInput<'_>) {
    let Some(provenance) = report.provenance else { return };
    page.section("provenance", "How it was made", "");
    let mut rows = format!("<tr><th scope=\"row\">Method</th><td>{}</td></tr>", escaped(&provenance.method));
    if let Some(date) = &provenance.date {
        let _ = write!(rows, "<tr><th scope=\"row\">Date</th><td>{}</td></tr>", escaped(date));
    }
    if !provenance.sources.is_empty() {
        let sources: Vec<String> =
            provenance.sources.iter().map(|it| format!("<code>{}</code>", escaped(it))).collect();
        let _ = write!(rows, "<tr><th scope=\"row\">Sources</th><td>{}</td></tr>", sources.join("<br>"));
    }
    if let Some(median) = provenance.residual_median_px {
        let _ = write!(rows, "<tr><th scope=\"row\">Median residual</th><td>{} px</td></tr>", fixed(median, 3));
    }
    page.raw(&format!("<table class=\"fixed\"><tbody>{rows}</tbody></table>"));
}
