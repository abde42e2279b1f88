//! The state of a run on a terminal, where there is no browser: cameras, targets, heads, what goes wrong.

use std::fmt::Write as _;
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

use foveate_calibration::words::counted;
use foveate_engine::{EdgeView, Progress};
use foveate_rig::graph::Graph;

use crate::terminal::{self, Drawing};

/// Between two drawings on a terminal, and elsewhere.
const PERIOD: Duration = Duration::from_millis(500);
const PLAIN_PERIOD: Duration = Duration::from_secs(5);
/// A camera without a picture for this long is quiet [s].
const QUIET_S: f64 = 2.0;
/// Edges with warnings that are named, at most.
const WARNINGS: usize = 5;

/// Draws the state of a run over and over.
pub struct Status {
    cameras: Vec<Camera>,
    /// Edges that carry what was recovered, each once for its producer.
    recovered: Vec<(String, usize)>,
    edges: Vec<String>,
    duration_s: Option<f64>,
    is_terminal: bool,
    last: Option<Instant>,
    drawing: Drawing,
}

/// A camera, and the edges that tell of it.
struct Camera {
    name: String,
    images: Vec<usize>,
    features: Vec<usize>,
    /// Pictures so far, and the session time at which that had grown last [s].
    heard: (u64, f64),
}

impl Status {
    /// Of runs of `graph`.
    pub fn new(graph: &Graph) -> Status {
        let carried = |edge: usize| {
            let from = graph.edges[edge].from;
            graph.instances[from.0].node_type.ports.outputs[from.1].message.name
        };
        let of = |camera: usize, message: &str| -> Vec<usize> {
            let is_of = |it: &usize| {
                let from = &graph.instances[graph.edges[*it].from.0];
                from.camera.is_some_and(|it| usize::from(it.0) == camera) && carried(*it) == message
            };
            (0..graph.edges.len()).filter(is_of).collect()
        };
        let cameras = graph.calibration.cameras.iter().enumerate().map(|(camera, it)| {
            let (images, features) = (of(camera, "image"), of(camera, "features"));
            Camera { name: it.name.clone(), images, features, heard: (0, 0.0) }
        });
        let mut recovered: Vec<(String, usize)> = Vec::new();
        for (number, edge) in graph.edges.iter().enumerate().filter(|it| !it.1.feedback) {
            let from = &graph.instances[edge.from.0];
            let is_result = ["targets", "marks", "skeletons"].contains(&carried(number));
            if is_result && !from.node_type.name.starts_with("sim.") && recovered.iter().all(|it| it.0 != from.path) {
                recovered.push((from.path.clone(), number));
            }
        }
        Status {
            cameras: cameras.filter(|it| !it.images.is_empty() || !it.features.is_empty()).collect(),
            recovered,
            edges: graph.edges.iter().map(|it| it.name.clone()).collect(),
            duration_s: graph.duration.map(|it| it.as_s()),
            is_terminal: std::io::stderr().is_terminal(),
            last: None,
            drawing: Drawing::default(),
        }
    }

    /// Draws, if it is time to.
    pub fn show(&mut self, progress: &Progress) {
        let period = if self.is_terminal { PERIOD } else { PLAIN_PERIOD };
        if self.last.is_some_and(|it| it.elapsed() < period) {
            return;
        }
        self.last = Some(Instant::now());
        let mut text = self.text(progress);
        if self.is_terminal {
            text = self.drawing.over(&text, terminal::size());
        }
        let mut err = std::io::stderr().lock();
        drop(err.write_all(text.as_bytes()).and_then(|()| err.flush()));
    }

    fn text(&mut self, progress: &Progress) -> String {
        let now = progress.now.as_s();
        let edges = &progress.edges;
        let whole = self.duration_s.map_or_else(String::new, |it| format!(" of {it}"));
        let speed = now / progress.wall.as_secs_f64().max(1e-3);
        let mut text = String::new();
        let n = counted(self.cameras.len(), "camera");
        let _ = writeln!(text, "{now:.1}{whole} s   {speed:.1}× real time   {n}"); // writing to a text cannot fail
        let width = self.cameras.iter().map(|it| it.name.chars().count()).max().unwrap_or(0).max(6);
        let _ = writeln!(
            text,
            "{:width$}  {:>7}  {:>5}  {:>5}  {:>7}  {:>8}",
            "camera", "Hz", "gaps", "drops", "age ms", "features"
        );
        for camera in &mut self.cameras {
            let of =
                |list: &[usize]| list.iter().map(|it| edges[*it]).max_by_key(|it| it.delivered).unwrap_or_default();
            let seen = of(if camera.images.is_empty() { &camera.features } else { &camera.images });
            if seen.delivered != camera.heard.0 {
                camera.heard = (seen.delivered, now);
            }
            let quiet_s = now - camera.heard.1;
            let state = match (seen.delivered, quiet_s > QUIET_S) {
                (0, _) => "no pictures yet".to_owned(),
                (_, true) => format!("no pictures for {quiet_s:.0} s"),
                _ => String::new(),
            };
            let features = of(&camera.features).count.map_or_else(|| "–".to_owned(), |it| it.to_string());
            let age = seen.age_s.map_or_else(|| "–".to_owned(), |it| format!("{:.1}", it[0] * 1e3));
            let rate = seen.rate_hz.map_or_else(|| "–".to_owned(), |it| format!("{it:.1}"));
            let (gaps, drops, name) = (seen.gaps, seen.dropped, &camera.name);
            let line = format!("{name:width$}  {rate:>7}  {gaps:>5}  {drops:>5}  {age:>7}  {features:>8}  {state}");
            let _ = writeln!(text, "{}", line.trim_end());
        }
        for (name, edge) in &self.recovered {
            let count = edges[*edge].count.unwrap_or(0);
            let rate = edges[*edge].rate_hz.map_or_else(String::new, |it| format!(", {it:.1} Hz"));
            let _ = writeln!(text, "{name}: {count}{rate}");
        }
        let is_bad = |it: &EdgeView| it.unmet || it.dropped > 0;
        let bad: Vec<usize> = (0..edges.len()).filter(|it| is_bad(&edges[*it])).collect();
        for &edge in bad.iter().take(WARNINGS) {
            let what = match edges[edge] {
                EdgeView { unmet: true, .. } => "requirement not met".to_owned(),
                EdgeView { dropped, .. } => format!("{dropped} dropped"),
            };
            let _ = writeln!(text, "! {}: {what}", self.edges[edge]);
        }
        if bad.len() > WARNINGS {
            let _ = writeln!(text, "! and {} more edges", bad.len() - WARNINGS);
        }
        text
    }
}
