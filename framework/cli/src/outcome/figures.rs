//! The figures of a run as a person reads them: by scale, accuracy first, what belongs together in one line. Where nodes declare headlines, these
//! alone, in words; all others are in `summary.json`.

use std::collections::BTreeMap;

use foveate_engine::Outcome;
use foveate_rig::graph::{Graph, Instance};

/// Lines shown of each scale at most, so that the end of a run is one screen; the rest is in the file.
const LINES_OF_SCALE: usize = 8;
/// Of so many cameras what a node without outputs measured of each is shown.
const FEW_CAMERAS: usize = 4;
/// Last parts of names that are statistics of one quantity.
const STATISTICS: [&str; 8] = ["median", "mean", "p90", "p95", "p99", "max", "min", "rms"];
/// Units of errors, at the end of the name of a quantity.
const UNITS: [&str; 7] = ["_mm", "_px", "_deg", "_mrad", "_sigmas", "_ms", "_m"];
/// What a node that judges counts besides: not how good it was but how much there was.
const HOW_MUCH: [&str; 8] = [
    "scored_messages",
    "unscored_messages",
    "targets_true",
    "identities",
    "pictures",
    "marks_measured",
    "marks_found",
    "filled",
];

/// One line: a quantity with all its statistics.
#[derive(Debug, Clone, PartialEq)]
struct Quantity<'a> {
    name: &'a str,
    /// What stands in brackets behind the statistic, such as a camera.
    of: &'a str,
    /// In words, where its node says it so.
    headline: Option<&'static str>,
    /// Name of the statistic, empty for a number by itself, and value.
    values: Vec<(&'a str, f64)>,
    /// Where what is shown does not say it.
    unit: Option<&'static str>,
    rank: Rank,
}

impl Quantity<'_> {
    fn words(&self) -> String {
        format!("{}{}", self.headline.unwrap_or(self.name), self.of)
    }
}

/// What is read first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Rank {
    /// How far what was recovered is from the truth, or from what was measured otherwise.
    Error,
    /// Other verdicts: what was missed, mixed up, invented.
    Verdict,
    /// Everything else.
    Other,
}

/// The lines, and how many figures are left out of them that are in the file.
pub(super) fn table(graph: &Graph, outcome: &Outcome) -> (Vec<String>, usize) {
    let report = &outcome.report;
    let headline = |name: &String| report.about.get(name).and_then(|it| it.headline);
    let has_headlines = report.figures.keys().any(|it| headline(it).is_some());
    let mut of_scales: BTreeMap<usize, Vec<Quantity<'_>>> = BTreeMap::new();
    let mut n_left_out = 0;
    for (name, value) in &report.figures {
        let node = report.origins.get(name).and_then(|path| graph.instances.iter().find(|it| it.path == *path));
        let is_shown = if has_headlines {
            headline(name).is_some() && is_of_all_or_few(graph, name)
        } else {
            // What is said of each camera, and a node's own bookkeeping, are for the file.
            !is_for_the_file(graph, name)
                || is_of_the_only_camera(graph, node, report.figures.keys(), name)
                || node.is_some_and(|it| is_result(graph, it, name) || is_result_of_few(graph, it, name))
        };
        if !is_shown {
            n_left_out += 1;
            continue;
        }
        let (stem, statistic, of) = split(name);
        let quantities = of_scales.entry(node.map_or(graph.scales.len(), |it| it.scale)).or_default();
        match quantities.iter_mut().find(|it| it.name == stem && it.of == of && !statistic.is_empty()) {
            Some(quantity) => quantity.values.push((statistic, *value)),
            None => {
                let rank = rank(node.map_or("", |it| it.node_type.name), stem);
                let about = report.about.get(name);
                let unit = about.and_then(|it| if has_headlines { it.dimension() } else { it.unit_beside(name) });
                let values = vec![(statistic, *value)];
                quantities.push(Quantity { name: stem, of, headline: headline(name), values, unit, rank });
            }
        }
    }
    let has_several = of_scales.len() > 1;
    let all = of_scales.values().flatten();
    let width = all.map(|it| it.words().chars().count()).max().unwrap_or(0);
    let mut lines = Vec::new();
    for (scale, mut quantities) in of_scales {
        // What is of the whole run comes before what is of one camera or head.
        quantities.sort_by_key(|it| (it.rank, of_camera(graph, it.name)));
        if has_several {
            lines.push(graph.scales.get(scale).map_or("the run", |it| &it.name).to_owned());
        }
        let (measured, empty): (Vec<_>, Vec<_>) =
            quantities.iter().partition(|it| it.values.iter().any(|it| it.1.is_finite()));
        lines.extend(measured.iter().take(LINES_OF_SCALE).map(|it| {
            let unit = it.unit.map_or(String::new(), |unit| format!(" {unit}"));
            format!("  {:width$}  {}{unit}", it.words(), numbers(&it.values))
        }));
        n_left_out += measured.iter().skip(LINES_OF_SCALE).map(|it| it.values.len()).sum::<usize>();
        let names: Vec<String> = empty.iter().map(|it| it.words()).collect();
        if !names.is_empty() {
            lines.push(format!("  nothing to measure: {}", names.join(", ")));
        }
    }
    (lines, n_left_out)
}

/// Whether a figure is of the whole run, or of one of few cameras; what is compared with it, and another node's version of it, are for the file.
fn is_of_all_or_few(graph: &Graph, name: &str) -> bool {
    let of = split(name).2.trim_matches(['[', ']']);
    let is_of_camera = of_camera(graph, name) || graph.calibration.index_of(of).is_some();
    if is_of_camera { graph.calibration.cameras.len() <= FEW_CAMERAS || !of.is_empty() } else { of.is_empty() }
}

fn is_for_the_file(graph: &Graph, name: &str) -> bool {
    let last = name.rsplit('.').next().unwrap_or(name);
    name.contains('[') || is_kept_by_a_node(graph, name) || graph.calibration.index_of(last).is_some()
}

/// Whether a figure is what a node that judges says of others: no bookkeeping, though it may begin with the name of the node that is judged.
fn is_verdict(node_type: &str, name: &str) -> bool {
    judges(node_type) && !keeps(node_type, name)
}

/// Whether a figure is a verdict, or what a node measured that gives out nothing: its result, and no bookkeeping.
fn is_result(graph: &Graph, node: &Instance, name: &str) -> bool {
    let is_of_all = !name.contains('[') && !of_camera(graph, name);
    if is_of_all && is_verdict(node.node_type.name, name) {
        return true;
    }
    node.node_type.ports.outputs.is_empty() && is_kept_by(node, name) && is_of_all && is_measured(name)
}

/// The same of each camera where there are few, as of the two that a target calibrates.
fn is_result_of_few(graph: &Graph, node: &Instance, name: &str) -> bool {
    let is_plain = !name.contains('[') && !is_kept_by(node, name) && is_measured(name);
    node.node_type.ports.outputs.is_empty() && is_plain && graph.calibration.cameras.len() <= FEW_CAMERAS
}

/// Whether a figure is a length, an angle or a time, and no count.
fn is_measured(name: &str) -> bool {
    name.split('.').any(|part| UNITS.iter().any(|it| part.ends_with(it)))
}

fn is_kept_by_a_node(graph: &Graph, name: &str) -> bool {
    graph.instances.iter().any(|it| is_kept_by(it, name))
}

fn is_kept_by(node: &Instance, name: &str) -> bool {
    keeps(node.node_type.name, name)
}

/// Whether the name of a figure begins with the name of a node's type.
fn keeps(node_type: &str, name: &str) -> bool {
    let short = node_type.rsplit('.').next().unwrap_or(node_type);
    name.strip_prefix(short).is_some_and(|rest| rest.starts_with('.'))
}

/// Whether a figure is of the one camera that a rig of a camera and a projector has: what is said of each camera is there said of all.
fn is_of_the_only_camera<'a>(
    graph: &Graph,
    node: Option<&Instance>,
    mut all: impl Iterator<Item = &'a String>,
    name: &str,
) -> bool {
    let Some((stem, last)) = name.rsplit_once('.').filter(|_| graph.calibration.cameras.len() <= 2) else {
        return false;
    };
    let is_of_other = |it: &&String| {
        it.rsplit_once('.')
            .is_some_and(|(own, camera)| own == stem && camera != last && graph.calibration.index_of(camera).is_some())
    };
    !name.contains('[')
        && graph.calibration.index_of(last).is_some()
        && node.is_some_and(|it| !is_kept_by(it, name))
        && all.find(is_of_other).is_none()
}

fn of_camera(graph: &Graph, name: &str) -> bool {
    name.split('.').any(|it| graph.calibration.index_of(it).is_some())
}

/// A quantity, which statistic of it this is, and what stands in brackets behind both.
fn split(name: &str) -> (&str, &str, &str) {
    let (rest, of) = name.split_at(name.find('[').unwrap_or(name.len()));
    let (stem, statistic) = rest.rsplit_once('.').filter(|it| STATISTICS.contains(&it.1)).unwrap_or((rest, ""));
    (stem, statistic, of)
}

/// Whether nodes of a type hold what others recovered against the truth, or against what was measured otherwise.
fn judges(node_type: &str) -> bool {
    ["score", "error", "reprojection", "watch"].iter().any(|it| node_type.contains(it))
}

fn rank(node_type: &str, name: &str) -> Rank {
    let last = name.rsplit('.').next().unwrap_or(name);
    if !judges(node_type) || HOW_MUCH.contains(&last) {
        Rank::Other
    } else if UNITS.iter().any(|it| last.ends_with(it)) && !last.starts_with("time_") {
        Rank::Error
    } else {
        Rank::Verdict
    }
}

fn numbers(values: &[(&str, f64)]) -> String {
    let place = |statistic: &str| STATISTICS.iter().position(|it| *it == statistic);
    let mut values: Vec<_> = values.to_vec();
    values.sort_by_key(|it| place(it.0));
    let one = |(statistic, value): &(&str, f64)| match *statistic {
        "" => short(*value),
        statistic => format!("{statistic} {}", short(*value)),
    };
    values.iter().map(one).collect::<Vec<_>>().join("   ")
}

/// Four digits where there are that many to show.
fn short(value: f64) -> String {
    let size = value.abs();
    if !value.is_finite() {
        "–".to_owned()
    } else if value.fract() == 0.0 && size < 1e9 {
        format!("{value}")
    } else if !(1e-4..1e9).contains(&size) {
        format!("{value:.2e}")
    } else {
        let decimals = (3.0 - size.log10().floor()).clamp(0.0, 6.0) as usize;
        let text = format!("{value:.decimals$}");
        // 0.9980 is 0.998.
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_four_digits() {
        let cases = [
            (0.915, "0.915"),
            (0.99851, "0.9985"),
            (105.4259, "105.4"),
            (51621.3, "51621"),
            (0.0101, "0.0101"),
            (8.0, "8"),
            (-2.455, "-2.455"),
            (2e-6, "2.00e-6"),
            (f64::NAN, "–"),
        ];
        for (value, expected) in cases {
            assert_eq!(short(value), expected);
        }
    }

    #[test]
    fn statistics_of_a_quantity_are_one_line_in_their_usual_order() {
        assert_eq!(split("body.error_mm.median"), ("body.error_mm", "median", ""));
        assert_eq!(split("body.completeness"), ("body.completeness", "", ""));
        assert_eq!(split("off_centre_px.mean[ptz-1]"), ("off_centre_px", "mean", "[ptz-1]"));
        assert_eq!(numbers(&[("max", 9.0), ("p95", 2.455), ("median", 0.915)]), "median 0.915   p95 2.455   max 9");
    }

    #[test]
    fn lengths_and_angles_are_measured_and_counts_are_not() {
        for (name, expected) in [
            ("cylinder.radius_mm", true),
            ("cylinder.radius_mm.spread", true),
            ("clocks.miss_mrad.median", true),
            ("cylinder.points", false),
            ("gltf.frames", false),
        ] {
            assert_eq!(is_measured(name), expected, "{name}");
        }
    }

    #[test]
    fn what_a_judge_says_of_a_surface_is_a_verdict_and_what_the_surface_says_of_itself_is_not() {
        assert!(is_verdict("sim.surface_score", "surface.wrong_per_10000"));
        assert!(!is_verdict("structured_light.surface", "surface.sigma_mm"));
        assert!(!is_verdict("sim.score", "score.messages"));
    }

    #[test]
    fn errors_come_before_verdicts_and_those_before_counts() {
        assert_eq!(rank("sim.score", "body.error_mm"), Rank::Error);
        assert_eq!(rank("sim.head_score", "off_centre_px"), Rank::Error);
        assert_eq!(rank("sim.score", "completeness"), Rank::Verdict);
        assert_eq!(rank("sim.score", "time_to_initiation_ms"), Rank::Verdict);
        assert_eq!(rank("sim.score", "body.scored_messages"), Rank::Other);
        assert_eq!(rank("export.targets", "path_length_m"), Rank::Other);
        assert!(Rank::Error < Rank::Verdict && Rank::Verdict < Rank::Other);
    }
}
