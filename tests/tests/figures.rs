//! Figures are declared: the rigs that come with the program report no other, and `docs/figures.md` lists them all.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use foveate_engine::{self as engine, Options, Outcome};
use foveate_node::Figures;
use foveate_node::figure::{self, Better, FigureSpec};
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::data::{data_dir, workspace_root};
use serde_json::Value;

/// Enough for every simulated rig to have seen its lights, and for no more [s].
const DURATION_S: f64 = 1.2;
/// Rigs of so many pixels or cameras that a run takes long; their node types are those of the others.
const LARGE: [&str; 2] = ["crowd.toml", "stadium.toml"];

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

/// The rigs of `graphs/` that run by themselves, and whether they read a recording.
fn shipped() -> Vec<(PathBuf, bool)> {
    let files = fs::read_dir(workspace_root().join("graphs")).unwrap().map(|it| it.unwrap().path());
    let mut rigs: Vec<(PathBuf, bool)> = files
        .filter(|it| it.extension().is_some_and(|it| it == "toml"))
        .filter(|it| LARGE.iter().all(|large| !it.ends_with(large)))
        .filter_map(|it| {
            let text = fs::read_to_string(&it).unwrap();
            text.contains("[rig]").then(|| (it, text.contains("${FOVEATE_DATA}")))
        })
        .collect();
    rigs.sort();
    rigs
}

/// Of rigs, few that have all types of nodes that all have: each the one with most types that those before it lack.
fn of_all_types(rigs: Vec<PathBuf>) -> Vec<PathBuf> {
    let types = |it: &PathBuf| -> BTreeSet<&'static str> {
        load(it, DURATION_S).instances.iter().map(|it| it.node_type.name).collect()
    };
    let mut rigs: Vec<(BTreeSet<&str>, PathBuf)> = rigs.into_iter().map(|it| (types(&it), it)).collect();
    let mut chosen = Vec::new();
    while let Some(most) = (0..rigs.len()).rev().max_by_key(|it| rigs[*it].0.len()) {
        let (types, path) = rigs.swap_remove(most);
        if types.is_empty() {
            break;
        }
        rigs.iter_mut().for_each(|it| it.0.retain(|of| !types.contains(of)));
        chosen.push(path);
    }
    chosen
}

/// Every type of node at least once; each rig is run by `.ci/run`.
#[test]
fn shipped_rigs_report_declared_figures_only() {
    let (with_data, alone): (Vec<_>, Vec<_>) = shipped().into_iter().partition(|it| it.1);
    let rigs = of_all_types(alone.into_iter().map(|it| it.0).collect());
    assert!(rigs.len() >= 5, "{rigs:?}");
    let mut reported: BTreeMap<&str, usize> = BTreeMap::new();
    for path in rigs {
        let (graph, outcome) = run(path.clone(), DURATION_S);
        let report = &outcome.report;
        assert!(!report.figures.is_empty(), "{}: no figure at all", path.display());
        let undeclared: Vec<_> = report.figures.keys().filter(|it| !report.about.contains_key(*it)).collect();
        assert!(undeclared.is_empty(), "{}: nobody declares {undeclared:?}", path.display());
        assert!(report.remarks.iter().all(|it| !it.contains("does not declare")), "{:?}", report.remarks);
        for instance in &graph.instances {
            let n_own = report.origins.values().filter(|it| **it == instance.path).count();
            *reported.entry(instance.node_type.name).or_default() += n_own;
        }
    }
    for node_type in
        ["sim.score", "led.integrator", "led.detector", "painted_mark.tracker", "pan_tilt.selector", "export.targets"]
    {
        assert!(reported.get(node_type).is_some_and(|it| *it > 0), "no rig had figures of {node_type}: {reported:?}");
    }
    if data_dir().is_none() {
        eprintln!("skipped: {} rigs that read recordings; FOVEATE_DATA names no folder", with_data.len());
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
        assert!(!report.figures.is_empty() && undeclared.is_empty(), "{name}: nobody declares {undeclared:?}");
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
fn printed_results_show_a_unit_that_the_name_does_not_say() {
    const FRUIT: FigureSpec = FigureSpec { name: "targets", unit: "apples", better: Better::Neither, line: "Fruit" };
    let (graph, mut outcome) = run(workspace_root().join("graphs/room.toml"), DURATION_S);
    outcome.report.about.insert("targets".to_owned(), &FRUIT);
    let said = foveate_cli::outcome::describe(&graph, &outcome, Path::new("out"));
    let line = |name: &str| {
        said.lines().find(|it| it.split_whitespace().next() == Some(name)).unwrap_or_else(|| panic!("{said}"))
    };
    assert!(line("targets").ends_with(" apples"), "{said}");
    assert!(!line("gospa_mm").ends_with("mm") && !line("targets_true").ends_with("count"), "{said}");
}

fn table(text: &mut String, figures: Figures) {
    *text += "| figure | unit | better | what it counts |\n|---|---|---|---|\n";
    for it in figures {
        let better = if it.better == Better::Neither { "" } else { it.better.name() };
        let _ = writeln!(text, "| `{}` | {} | {better} | {} |", it.name, it.unit, it.line);
    }
}

#[test]
fn document_lists_what_is_declared() {
    let mut text = "# Figures\n\n\
        What a run measures stands in `summary.json` under these names; `figures_about` there gives unit and what is better, `foveate nodes TYPE` lists those of one node.\n\n\
        `*` stands for a part that the rig decides, such as a camera's name, `{a,b}` for one of these, `(…)` for a part that may be missing. A figure that a second node gives too is kept\n\
        as `name[node]`. Units of what has none: `count`; `share`, 0 to 1; `ratio`, any other number; `sigmas`, stated standard deviations. `null`: there was nothing to measure.\n\n\
        This page is made of the declarations: `UPDATE_GOLDEN=1 cargo test -p foveate-tests --test figures` writes it anew.\n\n\
        ## The run\n\n"
        .to_owned();
    let of_the_run: Vec<_> = foveate_cli::results::OF_THE_RUN.iter().chain(engine::OF_SCALES).copied().collect();
    let of_the_run: Figures = Box::leak(of_the_run.into_boxed_slice());
    assert_eq!(figure::check(of_the_run), Ok(()));
    table(&mut text, of_the_run);
    for node_type in foveate_cli::registry().iter().filter(|it| !it.figures.is_empty()) {
        let _ = write!(text, "\n## {}\n\n", node_type.name);
        table(&mut text, node_type.figures);
        assert!(node_type.figures.iter().all(|it| !it.line.contains('|')), "{}: `|` ends a cell", node_type.name);
    }
    foveate_testkit::golden::check("docs/figures.md", &text);
}
