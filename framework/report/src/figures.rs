//! The figures of a summary as a person reads them: what belongs together in one row, cameras together, errors first.

use std::collections::BTreeMap;

use serde_json::{Map, Value};

use crate::page::{Html, Page, Table};
use crate::words::{natural, number};

/// Last parts of names that are statistics of one quantity, in the order in which people read them.
const STATISTICS: [&str; 8] = ["median", "mean", "p90", "p95", "p99", "max", "min", "rms"];
/// Figures of the run itself, which `foveate run` adds up.
const OF_THE_RUN: [&str; 9] = [
    "session_s",
    "messages.delivered",
    "messages.dropped",
    "messages.suspended",
    "messages.late",
    "gaps",
    "faults",
    "requirements_unmet",
    "real_time_factor",
];
/// Units of errors: of what is measured, not counted.
const MEASURED: [&str; 9] = ["mm", "m", "px", "deg", "mrad", "ms", "s", "sigmas", "ppm"];
/// Up to so many cameras, each one's value is shown.
const FEW_CAMERAS: usize = 4;

/// What is read first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Group {
    Errors,
    Verdicts,
    Amounts,
    Work,
    Run,
}

impl Group {
    fn title(self) -> &'static str {
        match self {
            Group::Errors => "Errors and delays",
            Group::Verdicts => "Other verdicts: what was covered, missed, mixed up or failed",
            Group::Amounts => "How much there was, and where",
            Group::Work => "The work of single nodes",
            Group::Run => "The run",
        }
    }
}

/// One row: a quantity with its statistics, or one statistic with its value for each camera.
#[derive(Debug, Clone, PartialEq)]
struct Quantity {
    group: Group,
    /// With `*` in place of a camera.
    name: String,
    is_of_cameras: bool,
    /// Statistic or camera, and value.
    values: Vec<(String, Option<f64>)>,
    unit: String,
    better: String,
}

impl Quantity {
    /// Whether nothing of what should not happen did.
    fn is_zero_as_it_should_be(&self) -> bool {
        matches!(self.group, Group::Verdicts | Group::Work)
            && self.better == "low"
            && self.values.iter().all(|it| it.1 == Some(0.0))
    }
}

/// What figures are about.
pub(crate) struct Context {
    pub(crate) cameras: Vec<String>,
    /// What figures of the work of one node begin with.
    pub(crate) workers: Vec<String>,
}

/// Writes figures as a table in groups, then the names of those that are 0, as is best, and of those that have no value. Returns whether there was any.
pub(crate) fn write(
    page: &mut Page,
    caption: &str,
    summary: &Map<String, Value>,
    context: &Context,
    is_wanted: impl Fn(&str) -> bool,
) -> bool {
    let mut table = Table::new(caption, &[("figure", false), ("value", false), ("unit", false), ("better", false)]);
    let (mut zero, mut empty) = (Vec::new(), Vec::new());
    let mut group = None;
    for it in quantities(summary, context, is_wanted) {
        if it.values.iter().all(|it| it.1.is_none()) {
            empty.push(it.name);
            continue;
        }
        if it.is_zero_as_it_should_be() {
            zero.push(it.name);
            continue;
        }
        if group != Some(it.group) {
            table.group(it.group.title());
            group = Some(it.group);
        }
        let better = match it.better.as_str() {
            "low" => "lower",
            "high" => "higher",
            _ => "",
        };
        let unit = Html::whole(shown(&it.unit));
        table.row(&[Html::name(&it.name), values(&it), unit, Html::text(better)]);
    }
    page.table(&table);
    let mut names = |words: &str, names: &[String]| {
        if !names.is_empty() {
            page.html(&Html::markup(format!(
                "<p class=\"names\">{words}: {}.</p>",
                Html::name(&names.join(", ")).as_str()
            )));
        }
    };
    names("0, which is best", &zero);
    names("Nothing to measure", &empty);
    !(table.is_empty() && zero.is_empty() && empty.is_empty())
}

/// A unit as people write it; that a count is a count is seen.
fn shown(unit: &str) -> &str {
    match unit {
        "count" | "ratio" => "",
        "share" => "share of 1",
        "sigmas" => "σ",
        other => other,
    }
}

fn quantities(summary: &Map<String, Value>, context: &Context, is_wanted: impl Fn(&str) -> bool) -> Vec<Quantity> {
    let mut all: BTreeMap<(Group, bool, String), Quantity> = BTreeMap::new();
    let about = summary.get("figures_about");
    for (name, value) in summary {
        if !(value.is_number() || value.is_null()) || !is_wanted(name) {
            continue;
        }
        let of = |key: &str| about.and_then(|it| it.get(name)?.get(key)?.as_str()).unwrap_or("").to_owned();
        let (unit, better) = (of("unit"), of("better"));
        let is_of_work =
            context.workers.iter().any(|it| name.strip_prefix(it).is_some_and(|rest| rest.starts_with('.')));
        let group = match better.as_str() {
            _ if OF_THE_RUN.contains(&name.as_str()) => Group::Run,
            "low" if MEASURED.contains(&unit.as_str()) => Group::Errors,
            "low" | "high" if unit == "share" => Group::Verdicts,
            _ if is_of_work => Group::Work,
            "low" | "high" => Group::Verdicts,
            _ => Group::Amounts,
        };
        let (name, label, is_of_cameras) = match without_camera(name, &context.cameras) {
            Some((starred, camera)) => (starred, camera, true),
            None => {
                let (name, statistic) = without_statistic(name);
                (name, statistic, false)
            }
        };
        let quantity = all.entry((group, is_of_cameras, name.clone())).or_insert_with(|| Quantity {
            group,
            name,
            is_of_cameras,
            values: Vec::new(),
            unit,
            better,
        });
        quantity.values.push((label, value.as_f64().filter(|it| it.is_finite())));
    }
    all.into_values().collect()
}

/// A name without its statistic, and that: `off_mm.max[compared]` is the largest `off_mm[compared]`.
fn without_statistic(name: &str) -> (String, String) {
    let (stem, of) = name.find('[').map_or((name, ""), |at| name.split_at(at));
    match stem.rsplit_once('.').filter(|it| STATISTICS.contains(&it.1) && !it.0.is_empty()) {
        Some((quantity, statistic)) => (format!("{quantity}{of}"), statistic.to_owned()),
        None => (name.to_owned(), String::new()),
    }
}

/// A name with `*` in place of its camera, and the camera: a part between dots, or what stands in brackets.
fn without_camera(name: &str, cameras: &[String]) -> Option<(String, String)> {
    let is_camera = |it: &str| cameras.iter().any(|known| known == it);
    if let Some((start, rest)) = name.split_once('[')
        && let Some((camera, end)) = rest.split_once(']')
        && is_camera(camera)
    {
        return Some((format!("{start}[*]{end}"), camera.to_owned()));
    }
    let parts: Vec<&str> = name.split('.').collect();
    let at = parts.iter().position(|it| is_camera(it))?;
    let starred: Vec<&str> = parts.iter().enumerate().map(|(index, it)| if index == at { "*" } else { it }).collect();
    Some((starred.join("."), parts[at].to_owned()))
}

/// The values of a row: each with its statistic or camera, or the range over many cameras.
fn values(quantity: &Quantity) -> Html {
    let mut finite: Vec<(&str, f64)> =
        quantity.values.iter().filter_map(|(label, it)| Some((label.as_str(), (*it)?))).collect();
    if quantity.is_of_cameras && quantity.values.len() > FEW_CAMERAS {
        return over_cameras(finite, quantity.values.len());
    }
    if quantity.is_of_cameras {
        finite.sort_by_key(|it| natural(it.0));
    } else {
        finite.sort_by_key(|it| STATISTICS.iter().position(|known| *known == it.0));
    }
    let parts: Vec<Html> = finite.iter().map(|(label, value)| labelled(label, *value)).collect();
    joined(&parts)
}

/// Lowest, median and highest value over cameras.
fn over_cameras(mut values: Vec<(&str, f64)>, n_cameras: usize) -> Html {
    values.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (low, high) = (values[0], values[values.len() - 1]);
    if low.1 == high.1 {
        let who = if values.len() == n_cameras {
            format!("each of {n_cameras}")
        } else {
            format!("{} of {n_cameras}", values.len())
        };
        return joined(&[Html::text(&number(low.1)), Html::text(&format!("for {who}"))]);
    }
    let middle = (values[(values.len() - 1) / 2].1 + values[values.len() / 2].1) / 2.0;
    let of = |(camera, value): (&str, f64)| Html::text(&format!("{} ({camera})", number(value)));
    let label = |text: &str| Html::markup(format!("<small>{text}</small> "));
    joined(&[
        label("lowest").then(&of(low)),
        labelled("median", middle),
        label("highest").then(&of(high)),
        Html::text(&format!("over {}", values.len())),
    ])
}

fn labelled(label: &str, value: f64) -> Html {
    let value = Html::text(&number(value));
    if label.is_empty() {
        return value;
    }
    Html::markup(format!("<small>{}</small> ", Html::text(label).as_str())).then(&value)
}

/// Parts that stay whole where the line breaks.
fn joined(parts: &[Html]) -> Html {
    let parts: Vec<String> = parts.iter().map(|it| format!("<span class=\"v\">{}</span>", it.as_str())).collect();
    Html::markup(parts.join(" "))
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn summary(value: Value) -> Map<String, Value> {
        value.as_object().unwrap().clone()
    }

    fn context(cameras: &[&str]) -> Context {
        let cameras = cameras.iter().map(|&it| it.to_owned()).collect();
        Context { cameras, workers: vec!["tracker".to_owned()] }
    }

    fn of(value: Value, cameras: &[&str]) -> Vec<Quantity> {
        quantities(&summary(value), &context(cameras), |_| true)
    }

    #[test]
    fn statistics_are_one_row_and_errors_come_first() {
        let found = of(
            json!({
                "a.count": 3, "a.error_mm.p95": 2.0, "a.error_mm.median": 1.0, "faults": 0, "z.share": 0.5, "interrupted": false,
                "figures_about": {
                    "a.error_mm.p95": { "unit": "mm", "better": "low" }, "a.error_mm.median": { "unit": "mm", "better": "low" },
                    "z.share": { "unit": "share", "better": "high" }, "faults": { "unit": "count", "better": "low" },
                },
            }),
            &[],
        );
        let names: Vec<(&str, Group)> = found.iter().map(|it| (it.name.as_str(), it.group)).collect();
        assert_eq!(
            names,
            [
                ("a.error_mm", Group::Errors),
                ("z.share", Group::Verdicts),
                ("a.count", Group::Amounts),
                ("faults", Group::Run)
            ]
        );
        assert_eq!(
            values(&found[0]).as_str(),
            "<span class=\"v\"><small>median</small> 1</span> <span class=\"v\"><small>p95</small> 2</span>"
        );
    }

    #[test]
    fn cameras_are_one_row() {
        let found =
            of(json!({ "off_px.mean[c1]": 1, "off_px.mean[c2]": 2, "sent.c1": 5, "sent.c2": null }), &["c1", "c2"]);
        let names: Vec<&str> = found.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(names, ["off_px.mean[*]", "sent.*"]);
        assert_eq!(found[1].values, [("c1".to_owned(), Some(5.0)), ("c2".to_owned(), None)]);
        assert_eq!(values(&found[1]).as_str(), "<span class=\"v\"><small>c1</small> 5</span>");
    }

    #[test]
    fn many_cameras_are_a_range() {
        let five = of(json!({ "n.a": 1, "n.b": 5, "n.c": 2, "n.d": 9, "n.e": 3 }), &["a", "b", "c", "d", "e"]);
        let text = values(&five[0]).as_str().replace("<span class=\"v\">", "").replace("</span>", "");
        assert_eq!(text, "<small>lowest</small> 1 (a) <small>median</small> 3 <small>highest</small> 9 (d) over 5");
        let same = of(json!({ "n.a": 7, "n.b": 7, "n.c": 7, "n.d": 7, "n.e": 7 }), &["a", "b", "c", "d", "e"]);
        assert!(values(&same[0]).as_str().contains("for each of 5"));
    }

    #[test]
    fn what_stands_in_brackets_and_is_no_camera_stays_with_its_statistics() {
        let found = of(json!({ "off_mm.median[compared]": 1, "off_mm.max[compared]": 2, "off_mm.max": 3 }), &["c1"]);
        let names: Vec<(&str, usize)> = found.iter().map(|it| (it.name.as_str(), it.values.len())).collect();
        assert_eq!(names, [("off_mm", 1), ("off_mm[compared]", 2)]);
        assert_eq!(without_statistic(".max"), (".max".to_owned(), String::new()));
    }

    #[test]
    fn zeros_that_should_be_and_figures_without_values_are_named_apart() {
        let summary = summary(json!({
            "gone_mm.median": null, "gone_mm.max": null, "n": 1, "tracker.lost": 0, "tracker.seen": 0, "trackers": 2, "missed": 0,
            "figures_about": {
                "tracker.lost": { "unit": "count", "better": "low" }, "missed": { "unit": "share", "better": "low" },
            },
        }));
        let mut page = Page::new("t", &[]);
        page.section("s", "S");
        assert!(write(&mut page, "figures", &summary, &context(&[]), |_| true));
        assert!(!write(&mut page, "none", &summary, &context(&[]), |_| false));
        let page = page.finish();
        for it in [
            "0, which is best: missed, tracker.<wbr>lost.",
            "Nothing to measure: gone_<wbr>mm.",
            "The work of single nodes</th></tr>\n<tr><th scope=\"row\">tracker.<wbr>seen<",
            "How much there was, and where</th></tr>\n<tr><th scope=\"row\">n</th>",
        ] {
            assert!(page.contains(it), "{it}: {page}");
        }
    }
}
