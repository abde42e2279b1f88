//! Figures are declared: the rigs that come with the program report no other, and `foveate figures` explains them all.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_cli::commands::figures::{self, explain};
use foveate_cli::commands::nodes;
use foveate_cli::results::OF_THE_RUN;
use foveate_engine::{self as engine, Options, Outcome};
use foveate_node::figure::{self, Better, FigureSpec};
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::data::{data_dir, workspace_root};
use serde_json::Value;

/// Enough for every simulated rig to have seen its lights, and for no more [s].
const DURATION_S: f64 = 1.2;

fn load(path: &Path, duration_s: f64) -> Arc<Graph> {
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    let graph = rig::load_file(path, &foveate_cli::registry(), &overrides).unwrap_or_else(|faults| panic!("{faults}"));
    Arc::new(graph)
}

fn run(path: PathBuf, duration_s: f64) -> (Arc<Graph>, Outcome) {
    let graph = load(&path, duration_s);
    let folder = tempfile::tempdir().unwrap();
    let options = Options { out_dir: Some(folder.path().to_owned()), ..Options::default() };
    let outcome = engine::deterministic(Arc::clone(&graph), &options, &mut |_| ()).unwrap();
    (graph, outcome)
}

/// The rig of most node types; `.ci/run` asks the same of each rig that it runs.
#[test]
fn shipped_rig_reports_declared_figures_only() {
    let (graph, outcome) = run(workspace_root().join("graphs/face_body.toml"), DURATION_S);
    let report = &outcome.report;
    let undeclared: Vec<_> = report.figures.keys().filter(|it| !report.about.contains_key(*it)).collect();
    assert!(undeclared.is_empty(), "{undeclared:?} are not declared");
    for (figure, about) in &report.about {
        assert!(explained(figure).contains(&(about.name.to_owned(), about.unit.to_owned())), "{figure}");
    }
    assert!(report.remarks.iter().all(|it| !it.contains("does not declare")), "{:?}", report.remarks);
    let mut reported: BTreeMap<&str, usize> = BTreeMap::new();
    for instance in &graph.instances {
        let n_own = report.origins.values().filter(|it| **it == instance.path).count();
        *reported.entry(instance.node_type.name).or_default() += n_own;
    }
    for node_type in
        ["sim.score", "led.integrator", "led.detector", "painted_mark.tracker", "pan_tilt.selector", "export.targets"]
    {
        assert!(reported.get(node_type).is_some_and(|it| *it > 0), "no figures of {node_type}: {reported:?}");
    }
}

/// What the recordings make of nodes that no simulated rig has: a few, and those that need no long run.
#[test]
fn recorded_rigs_report_declared_figures_only() {
    let Some(folder) = data_dir() else { return eprintln!("skipped: FOVEATE_DATA names no folder") };
    for (name, recording) in [
        ("drones.toml", "s04_drone_multicam"),
        ("motion_file.toml", "s10_btk_c3d_trc"),
        ("straw_lab.toml", "s02_strawlab_selfcal"),
    ] {
        if !folder.join(recording).exists() {
            eprintln!("skipped: {name}, as {recording} is missing");
            continue;
        }
        let path = workspace_root().join("graphs").join(name);
        let text = fs::read_to_string(&path)
            .unwrap()
            .replace("${FOVEATE_DATA}", &folder.canonicalize().unwrap().display().to_string());
        let copy = tempfile::tempdir().unwrap();
        for entry in fs::read_dir(workspace_root().join("graphs")).unwrap() {
            let from = entry.unwrap().path();
            fs::copy(&from, copy.path().join(from.file_name().unwrap())).unwrap();
        }
        let rig = copy.path().join(name);
        fs::write(&rig, text).unwrap();
        let report = run(rig, 2.0).1.report;
        let undeclared: Vec<_> = report.figures.keys().filter(|it| !report.about.contains_key(*it)).collect();
        assert!(!report.figures.is_empty() && undeclared.is_empty(), "{name}: {undeclared:?} are not declared");
    }
}

#[test]
fn summary_says_unit_and_what_is_better_of_every_figure() {
    let (_, outcome) = run(workspace_root().join("graphs/room.toml"), DURATION_S);
    let text = foveate_cli::results::summary(&outcome, true);
    let summary: Value = serde_json::from_str(&text).unwrap();
    let Value::Object(entries) = &summary else { panic!("{text}") };
    let about = summary["figures_about"].as_object().unwrap();
    // Numbers and what could not be measured; `interrupted` is neither.
    let figures: Vec<&String> = entries.iter().filter(|it| it.1.is_number() || it.1.is_null()).map(|it| it.0).collect();
    assert_eq!(about.keys().collect::<Vec<_>>(), figures, "the same names in the same order");
    assert_eq!(about["error_mm.median"], serde_json::json!({ "unit": "mm", "better": "low" }));
    assert_eq!(about["completeness"], serde_json::json!({ "unit": "share", "better": "high" }));
    assert_eq!(about["session_s"]["unit"], "s");
    assert_eq!(text.lines().filter(|it| it.contains("\"unit\"")).count(), figures.len(), "a line each");
    let mut nothing = outcome.clone();
    nothing.report.about.clear();
    let text = foveate_cli::results::summary(&nothing, false);
    let summary: Value = serde_json::from_str(&text).unwrap();
    assert!(summary["figures_about"].get("error_mm.median").is_none() && !summary["error_mm.median"].is_object());
}

#[test]
fn printed_results_are_headlines_with_their_units() {
    const FRUIT: FigureSpec = FigureSpec {
        name: "targets",
        unit: "apples",
        better: Better::Neither,
        line: "Fruit",
        headline: Some("Apples"),
    };
    let (graph, mut outcome) = run(workspace_root().join("graphs/room.toml"), DURATION_S);
    outcome.report.about.insert("targets".to_owned(), &FRUIT);
    let said = foveate_cli::outcome::describe(&graph, &outcome, Path::new("out"));
    let line =
        |words: &str| said.lines().find(|it| it.trim_start().starts_with(words)).unwrap_or_else(|| panic!("{said}"));
    assert!(line("Apples").ends_with(" apples") && line("targets off the truth").ends_with(" mm"), "{said}");
    assert!(!line("part of the truth").ends_with("share"), "{said}");
    // A figure without a headline is for the file.
    assert!(outcome.report.figures.keys().any(|it| it.contains("gospa")) && !said.contains("gospa"), "{said}");
    assert!(line("open ").contains("path_top.svg"), "{said}");
    // Unless a node names another picture.
    outcome.report.open_first = Some("path_side.svg".into());
    let said = foveate_cli::outcome::describe(&graph, &outcome, Path::new("out"));
    assert!(said.lines().any(|it| it.starts_with("open ") && it.contains("path_side.svg")), "{said}");
    assert_eq!(said.matches("path_side.svg").count(), 1, "{said}");
}

/// The declared names and units that an explanation of `query` states.
#[track_caller]
fn explained(query: &str) -> Vec<(String, String)> {
    let text = explain(query, &foveate_cli::registry()).unwrap_or_else(|complaint| panic!("{complaint}"));
    let heads = text.lines().take_while(|it| !it.is_empty() && !it.starts_with("Less likely"));
    let heads = heads.filter(|it| !it.starts_with(' ')).map(|it| it.split_once("  (").unwrap());
    let unit = |rest: &str| rest.trim_end_matches(')').split(',').next().unwrap().to_owned();
    heads.map(|(name, rest)| (name.to_owned(), unit(rest))).collect()
}

#[test]
fn every_declared_figure_is_listed_and_explained() {
    let registry = foveate_cli::registry();
    let of_the_run: Vec<_> = OF_THE_RUN.iter().chain(engine::OF_SCALES).chain(engine::OF_BUDGETS).copied().collect();
    assert_eq!(figure::check(Box::leak(of_the_run.clone().into_boxed_slice())), Ok(()));
    let of_nodes = registry.iter().flat_map(|it| it.figures.iter().map(move |figure| (it.name, *figure)));
    let listed = figures::list(&registry);
    let mut n_figures = 0;
    for (origin, it) in of_the_run.into_iter().map(|it| ("every run", it)).chain(of_nodes) {
        let group = listed.split("\n\n").find(|group| group.lines().next() == Some(origin)).unwrap();
        assert!(group.lines().any(|line| line.split_whitespace().next() == Some(it.name)), "{origin}: {}", it.name);
        let text = explain(it.name, &registry).unwrap();
        let words: Vec<&str> = text.split_whitespace().collect();
        let line: Vec<&str> = it.line.split_whitespace().collect();
        assert!(words.windows(line.len()).any(|window| window == line), "{}: {text}", it.name);
        let reporters = text.lines().filter_map(|line| line.trim().strip_prefix("reported by "));
        assert!(reporters.flat_map(|line| line.split(", ")).any(|name| name == origin), "{origin}: {text}");
        n_figures += 1;
    }
    assert!(n_figures > 500, "{n_figures}");
}

#[test]
fn figures_are_found_by_name_pattern_and_node_type() {
    let registry = foveate_cli::registry();
    let names = |query: &str| explained(query).into_iter().map(|it| it.0).collect::<Vec<_>>();
    assert_eq!(names("v4l.drift_ppm.wide-3"), ["v4l.drift_ppm.*"]);
    assert_eq!(names("c3d.frames[second.c3d]"), ["c3d.frames"]);
    assert_eq!(names("views_osc.*"), ["views_osc.sent", "views_osc.superseded", "views_osc.failed"]);
    assert_eq!(names("v4l.latency_ms.m?x.*"), ["v4l.latency_ms.{mean,max}.*"]);
    let of_type: Vec<&str> = registry.get("capture.v4l").unwrap().figures.iter().map(|it| it.name).collect();
    assert_eq!(names("capture.v4l"), of_type);
}

#[test]
fn an_unknown_figure_is_refused_with_the_nearest_names() {
    let registry = foveate_cli::registry();
    for (found, near) in
        [("gospa", "`gospa_mm.mean`"), ("v4l.frmes.wide-1", "`v4l.frames.*`"), ("messages.lost", "`messages.late`")]
    {
        let complaint = explain(found, &registry).unwrap_err();
        assert!(complaint.contains(near) && complaint.contains(&format!("`{found}`")), "{complaint}");
    }
    assert!(!explain("zzz", &registry).unwrap_err().contains("nearest"));
    assert!(explain("nothing.like.*", &registry).is_err());
}

#[test]
fn node_types_are_listed_once_under_their_plugins() {
    let registry = foveate_cli::registry();
    let text = nodes::list(&registry);
    let mut plugins: Vec<&str> = Vec::new();
    let mut types: Vec<&str> = Vec::new();
    for line in text.lines().take_while(|it| !it.starts_with('`')).filter(|it| !it.is_empty()) {
        match line.strip_prefix("  ") {
            None => {
                assert!(!plugins.contains(&line), "`{line}` twice");
                plugins.push(line);
            }
            Some(line) => {
                let (name, summary) = line.split_once(' ').unwrap();
                assert_eq!(name.split('.').next(), plugins.last().copied());
                let length = summary.trim().chars().count();
                assert!((10..=90).contains(&length), "{length} characters: {line}");
                types.push(name);
            }
        }
    }
    assert_eq!(types, registry.iter().map(|it| it.name).collect::<Vec<_>>());
}
