//! An integrator that is too slow for its cameras: what each of them gets under each way to empty the queues
//! [Davis 2002 §3.5, Figure 35].

use std::path::Path;
use std::sync::Arc;

use foveate::plot::svg::Pen;
use foveate::plot::{Axis, COLOURS, Chart, Marks, Series};
use foveate_engine::{self as engine, Options as RunOptions};
use foveate_node::Registry;
use foveate_rig::{self as rig, Overrides};
use foveate_testkit::nodes::collected;

use crate::Options;
use crate::chart::save;

/// What the integrator needs for a frame, by the logical clock [ms].
const COST_MS: f64 = 8.0;
/// Name, first frame by the camera's clock [ms], latency by it [ms]: A's clock is 4 ms ahead.
const CAMERAS: [(&str, f64, f64); 3] = [("a", 6.0, 6.0), ("b", 3.0, 10.0), ("c", 4.0, 10.0)];
const TAKES: [&str; 4] = ["each", "newest", "round_robin", "newest_of_each"];
/// The part that is drawn.
const SHOWN_MS: f64 = 300.0;

/// Measures and draws.
pub fn overload(options: &Options) {
    println!(
        "## Three cameras at 60 Hz for 10 s, the clock of A 4 ms ahead, an integrator that needs {COST_MS} ms a frame\n"
    );
    println!("| take | A | B | C | greatest age at an update ms |");
    println!("|---|---|---|---|---|");
    let mut charts = Vec::new();
    for take in TAKES {
        match play(take) {
            Ok((updates, oldest_ms)) => {
                let counts = updates.each_ref().map(Vec::len);
                println!("| {take} | {} | {} | {} | {oldest_ms:.1} |", counts[0], counts[1], counts[2]);
                charts.push(timeline(&format!("{take}: {}, {}, {}", counts[0], counts[1], counts[2]), &updates));
            }
            Err(why) => println!("| {take} | not available: {why} | | | |"),
        }
    }
    println!();
    let title = "Updates of each camera under overload (Figure 35)";
    save(options.out.as_deref(), "overload_fig35", title, 2, charts);
}

/// When each camera had a say, by its clock [s], and the greatest age of a frame when it had [ms].
fn play(take: &str) -> Result<([Vec<f64>; 3], f64), String> {
    let mut registry = Registry::new();
    foveate_testkit::register(&mut registry);
    let mut text = "[rig]\nname = \"overload\"\nseed = 1\n[scale.room]\n".to_owned();
    for (name, phase_ms, latency_ms) in CAMERAS {
        text += &format!(
            "[scale.room.node.{name}]\ntype = \"testkit.counter\"\ncount = 600\nrate_hz = 60.0\nphase_ms = {phase_ms:?}\n\
             latency_ms = {latency_ms:?}\n"
        );
    }
    let shelf = format!("overload {take}");
    text += &format!(
        "[scale.room.node.t]\ntype = \"testkit.collect\"\ninto = \"{shelf}\"\ncost_ms = {COST_MS:?}\n\
         in.numbers = {{ from = [\"a.numbers\", \"b.numbers\", \"c.numbers\"], policy = \"{take}\" }}\n"
    );
    let graph = rig::load(&text, Path::new("overload.toml"), &registry, &Overrides::default());
    let graph = Arc::new(graph.map_err(|faults| faults.render(false))?);
    let outcome =
        engine::deterministic(graph, &RunOptions::default(), &mut |_| {}).map_err(|error| error.to_string())?;
    let mut updates = [const { Vec::new() }; 3];
    for it in collected(&shelf) {
        if let Some(of_camera) = updates.get_mut(it.stamp.source.0 as usize) {
            of_camera.push(it.stamp.time.as_s());
        }
    }
    let ages = outcome.ledgers.iter().filter_map(|it| it.age_max_s());
    Ok((updates, 1e3 * ages.fold(0.0, f64::max)))
}

/// A dot for each update, a row for each camera.
pub fn timeline(title: &str, updates: &[Vec<f64>; 3]) -> Chart<'static> {
    let x = Axis::new("capture time by the camera's clock [ms]").over(0.0, SHOWN_MS);
    let y = Axis::of_rows(["A", "B", "C"].map(String::from));
    let rows = (0..3).flat_map(|row| [[0.0, Axis::row(row)], [SHOWN_MS, Axis::row(row)]]).collect();
    let mut chart =
        Chart::new(title, [400.0, 90.0], x, y).with(Series::new("", Marks::Strokes, Pen::new("#d0d0d0", 1.3), rows));
    for (camera, times) in updates.iter().enumerate() {
        let shown = times.iter().map(|it| 1e3 * it).filter(|it| *it < SHOWN_MS);
        let dots = shown.map(|it| [it, Axis::row(camera)]).collect();
        chart = chart.with(Series::dots(["A, 4 ms ahead", "B", "C"][camera], COLOURS[camera], dots));
    }
    chart
}
