//! Three scales in one another. `graphs/nested.toml`: what the innermost recovers, carried to the world, against the truth, while the
//! person who carries the two inner ones walks out and comes back. `graphs/stadium.toml`: a body recovered in a space that moves by cameras that do not, and
//! heads that follow what is known in that space.
//!
//! `cargo test -p foveate-tests --test it nested -- --nocapture` prints the table of docs/results.md.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::Arc;

use foveate_engine::{self as engine, Options, Outcome};
use foveate_rig::graph::Graph;
use foveate_rig::{self as rig, Overrides};
use nalgebra::{Matrix3, Point3};

/// Long enough to be lost and found again [s].
const DURATION_S: f64 = 26.0;
/// The 99th percentile of χ² with three degrees of freedom.
const CHI_SQUARED_99: f64 = 11.34;
/// The truth is told at 60 Hz; a hand may leave the straight line between two samples by this much [m].
const TRUTH_SIGMA_M: f64 = 0.0005;

/// Runs a rig of `graphs`, its text changed.
fn run_in(rig: &str, change: fn(String) -> String, duration_s: f64, folder: &Path) -> (Arc<Graph>, Outcome) {
    let path = foveate_testkit::data::workspace_root().join("graphs").join(rig);
    let overrides = Overrides { duration_s: Some(duration_s), ..Overrides::default() };
    let text = change(fs::read_to_string(&path).unwrap());
    let graph =
        rig::load(&text, &path, &foveate_cli::registry(), &overrides).unwrap_or_else(|faults| panic!("{faults}"));
    let graph = Arc::new(graph);
    let options = Options { out_dir: Some(folder.to_owned()), ..Options::default() };
    let outcome = engine::deterministic(Arc::clone(&graph), &options, &mut |_| ()).unwrap();
    assert_eq!(outcome.faults, []);
    (graph, outcome)
}

/// In a world that is as its calibration says: the plan is both.
fn as_planned(rig: String) -> String {
    let (planned, lines) = (rig.replace("nested.calibration.toml", "nested.plan.toml"), "truth = {");
    assert!(planned != rig && planned.contains(lines));
    planned.lines().filter(|it| !it.starts_with(lines)).map(|it| it.to_owned() + "\n").collect()
}

/// Median and 99th percentile [m].
fn median_and_p99(mut errors: Vec<(f64, f64)>) -> [f64; 2] {
    errors.sort_by(|a, b| a.0.total_cmp(&b.0));
    [0.5, 0.99].map(|it: f64| errors[(it * errors.len() as f64) as usize].0)
}

/// True paths by light: time [s] and place [m].
fn truth(folder: &Path) -> BTreeMap<u32, Vec<(f64, Point3<f64>)>> {
    let mut paths: BTreeMap<u32, Vec<(f64, Point3<f64>)>> = BTreeMap::new();
    for row in fs::read_to_string(folder.join("truth.csv")).unwrap().lines().skip(1) {
        let cells: Vec<f64> = row.split(',').map(|it| it.parse().unwrap()).collect();
        paths.entry(cells[1] as u32).or_default().push((cells[0], Point3::new(cells[2], cells[3], cells[4])));
    }
    paths
}

/// Where a light was, if it was there.
fn at(path: &[(f64, Point3<f64>)], time_s: f64) -> Option<Point3<f64>> {
    let after = path.partition_point(|it| it.0 <= time_s);
    let (&(from_s, from), &(to_s, to)) = (path.get(after.checked_sub(1)?)?, path.get(after)?);
    Some(from + (to - from) * ((time_s - from_s) / (to_s - from_s)))
}

/// Of each measured row of a table that the world's columns place while somebody is there: the distance from the nearest light [m], and
/// its square in terms of what is stated.
fn errors(folder: &Path, table: &str) -> Vec<(f64, f64)> {
    let truth = truth(folder);
    let mut errors = Vec::new();
    for row in fs::read_to_string(folder.join(table)).unwrap().lines().skip(1) {
        let cells: Vec<&str> = row.split(',').collect();
        if cells[12] != "measured" || cells[13].is_empty() {
            continue;
        }
        let number = |index: usize| cells[index].parse::<f64>().unwrap();
        let place = Point3::new(number(13), number(14), number(15));
        let [xx, xy, xz, yy, yz, zz] = [16, 17, 18, 19, 20, 21].map(number);
        let stated = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) + Matrix3::identity() * TRUTH_SIGMA_M.powi(2);
        let lights = truth.values().filter_map(|path| at(path, number(0)));
        let nearest = lights.map(|light| place - light).min_by(|a, b| a.norm().total_cmp(&b.norm()));
        if let Some(error) = nearest {
            errors.push((error.norm(), error.dot(&(stated.try_inverse().unwrap() * error))));
        }
    }
    errors
}

#[test]
fn innermost_scale_lies_in_the_world_where_the_truth_does_within_what_is_stated() {
    let folders = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let (graph, outcome) = run_in("nested.toml", as_planned, DURATION_S, folders[0].path());
    for (table, least_rows) in [("body.csv", 20_000), ("hands.csv", 15_000)] {
        let errors = errors(folders[0].path(), table);
        assert!(errors.len() > least_rows, "{table}: {} rows", errors.len());
        let within = errors.iter().filter(|it| it.1 < CHI_SQUARED_99).count() as f64 / errors.len() as f64;
        assert!(within >= 0.99, "{table}: {within} of the rows are within what is stated");
        let n_rows = errors.len();
        let [median_m, p99_m] = median_and_p99(errors);
        println!(
            "{table}: {n_rows} rows, error median {:.2} mm, 99 % {:.2} mm, {:.2} % within what is stated",
            median_m * 1e3,
            p99_m * 1e3,
            within * 1e2
        );
        assert!(median_m < 0.002 && p99_m < 0.01, "{table}: median {median_m} m, 99 % {p99_m} m");
    }

    // Lost when the person has gone, found with the next visit; the hip hangs on the body.
    let [body, hip] = &outcome.suspensions[..] else { panic!("{:?}", outcome.suspensions) };
    assert_eq!((body.scale.as_str(), body.count, hip.scale.as_str()), ("body", 2, "hip"));
    assert!(body.spells[1].why.contains("`people.head` is lost") && body.spells[1].until.is_some(), "{body:?}");
    let outer = "scale `body` around it is suspended";
    let with_body = hip.spells.iter().find(|it| it.why == outer).unwrap_or_else(|| panic!("{hip:?}"));
    assert_eq!((with_body.from, with_body.until), (body.spells[1].from, body.spells[1].until));
    let mut n_held_up = 0;
    for (edge, ledger) in graph.edges.iter().zip(&outcome.ledgers) {
        let is_filter = edge.name.ends_with("joints.features") || edge.name.ends_with("hands.features");
        assert_eq!(ledger.suspended > 0, is_filter, "{}", edge.name);
        n_held_up += usize::from(is_filter);
        if is_filter {
            let sent = ledger.delivered + ledger.dropped + ledger.suspended;
            assert!((1550..=1560).contains(&sent), "{}: {sent} sent in {DURATION_S} s at 60 Hz", edge.name);
        }
    }
    assert_eq!(n_held_up, 8);

    run_in("nested.toml", as_planned, DURATION_S, folders[1].path());
    for file in ["body.csv", "hands.csv", "truth.csv"] {
        let [first, second] = folders.each_ref().map(|it| fs::read(it.path().join(file)).unwrap());
        assert!(first == second, "{file} differs between two runs");
    }
}

#[test]
fn innermost_scale_lies_near_the_truth_with_cameras_that_were_calibrated_in_three_places() {
    let folder = tempfile::tempdir().unwrap();
    run_in("nested.toml", |it| it, 12.0, folder.path());
    for table in ["body.csv", "hands.csv"] {
        let errors = errors(folder.path(), table);
        assert!(errors.len() > 8_000, "{table}: {} rows", errors.len());
        let [median_m, p99_m] = median_and_p99(errors);
        println!("{table}, estimated: error median {:.2} mm, 99 % {:.2} mm", median_m * 1e3, p99_m * 1e3);
        // A framework that stands elsewhere than it says, by a hand's width, or is turned by two degrees, does not keep this.
        assert!(median_m < 0.008 && p99_m < 0.03, "{table}: median {median_m} m, 99 % {p99_m} m");
    }
}

#[test]
fn player_and_face_are_recovered_in_spaces_that_move_over_a_field() {
    let folder = tempfile::tempdir().unwrap();
    let (_, outcome) = run_in("stadium.toml", |it| it, 11.0, folder.path());
    let figure = |name: &str| outcome.report.figures[name];
    let errors = errors(folder.path(), "player.csv");
    let n_rows = errors.len();
    let [median_m, p99_m] = median_and_p99(errors);
    println!("player.csv: {n_rows} rows, error median {:.2} mm, 99 % {:.2} mm", median_m * 1e3, p99_m * 1e3);
    // The wide cameras alone: 4 mm.
    assert!(n_rows > 7_000 && median_m < 0.002 && p99_m < 0.02, "median {median_m} m, 99 % {p99_m} m");
    // Some of the 69 marks lie where no three cameras see them yet.
    assert!(figure("marks.known") > 62.0, "{}", figure("marks.known"));
    assert_eq!((figure("mark_identity_errors"), figure("marks_extra")), (0.0, 0.0));
    assert!(figure("pair_error_mm.median") < 0.2, "{}", figure("pair_error_mm.median"));
    assert!(figure("off_centre_px.median") < 200.0, "{}", figure("off_centre_px.median"));
}
