//! `surface.pictures`: trajectories and the vector field of a tracked surface, as Figures 8 and 9 of [D'Apuzzo 1999].
//!
//! | file | what it shows |
//! |---|---|
//! | `trajectories.svg` | where points went, from the front and from the side, to scale |
//! | `vector_field.svg` | the step of every point at the last moment, longer by a stated factor, the same two views |
//! | `surface_time.svg` | points, and points that are lost, appear and are found again, over time |

use std::collections::BTreeMap;

use foveate::plot::svg::Pen;
use foveate::plot::{Axis, COLOURS, Chart, Figure, Marks as Drawn, Series};
use foveate::prelude::*;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    TRACKED: In<TrackedSurface> = each("tracked");
}

figures! {
        "trajectories.drawn": count, neither, "Trajectories drawn in the picture of trajectories";
}

/// Settings of [`Pictures`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct PicturesSettings {
    /// Most trajectories that are drawn, spread evenly over their identities [–]
    #[schemars(range(min = 1, max = 100000))]
    pub trajectories: usize,
    /// Most arrows that are drawn [–]
    #[schemars(range(min = 1, max = 100000))]
    pub arrows: usize,
    /// Prefix of the file names, for a second node of this type in one rig [–]
    pub prefix: String,
}

impl Default for PicturesSettings {
    fn default() -> Self {
        Self { trajectories: 400, arrows: 1500, prefix: String::new() }
    }
}

/// The longest arrow is this part of the surface's extent.
const LONGEST: f64 = 0.12;
const SIZE: [f64; 2] = [420.0, 520.0];

/// Tracked points in, pictures in the results folder.
pub struct Pictures {
    settings: PicturesSettings,
    out_dir: Option<std::path::PathBuf>,
    paths: BTreeMap<u32, Vec<Point3<f64>>>,
    last: Vec<(Point3<f64>, Vector3<f64>)>,
    last_step_s: f64,
    last_time: Option<Time>,
    /// Time, points, ended, new.
    counts: Vec<[f64; 4]>,
}

impl Node for Pictures {
    const TYPE: &'static str = "surface.pictures";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Draws the trajectories and the velocity field of a tracked surface";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = PicturesSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: PicturesSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("trajectories", settings.trajectories, 1..=100_000)?;
        ConfigError::unless_in("arrows", settings.arrows, 1..=100_000)?;
        for name in ["trajectories.svg", "vector_field.svg", "surface_time.svg"] {
            setup.claim_file(Some("prefix"), &format!("{}{name}", settings.prefix))?;
        }
        Ok(Self {
            settings,
            out_dir: setup.out_dir.clone(),
            paths: BTreeMap::new(),
            last: Vec::new(),
            last_step_s: 0.0,
            last_time: None,
            counts: Vec::new(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(tracked) = io.take(&TRACKED) else { return Ok(()) };
        let surface = &tracked.value;
        for point in &surface.list {
            self.paths.entry(point.id).or_default().push(point.position);
        }
        self.last = surface.list.iter().filter(|it| it.n_samples > 1).map(|it| (it.position, it.velocity)).collect();
        self.last_step_s = self.last_time.map_or(0.0, |before| (surface.time - before).as_s());
        self.last_time = Some(surface.time);
        let new = surface.list.iter().filter(|it| it.n_samples == 1).count();
        self.counts.push([surface.time.as_s(), surface.list.len() as f64, surface.ended.len() as f64, new as f64]);
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let moving: Vec<&Vec<Point3<f64>>> = self.paths.values().filter(|it| it.len() > 1).collect();
        let stride = moving.len().div_ceil(self.settings.trajectories).max(1);
        let drawn: Vec<&Vec<Point3<f64>>> = moving.into_iter().step_by(stride).collect();
        report.figure("trajectories.drawn", drawn.len() as f64);
        let Some(folder) = &self.out_dir else { return Ok(()) };
        let files = [
            ("trajectories.svg", trajectories(&drawn)),
            (
                "vector_field.svg",
                both(&format!("Steps of a surface at the last moment, {} times as long", self.factor()), |axes| {
                    self.field(axes)
                }),
            ),
            ("surface_time.svg", self.over_time()),
        ];
        for (name, svg) in files {
            let saved = report.save(folder, &format!("{}{name}", self.settings.prefix), svg);
            saved.map_err(|it| NodeError::input(it.to_string()))?;
        }
        Ok(())
    }
}

/// Two axes of space and what they are called.
type Axes = [(usize, &'static str); 2];

/// From the front and from the side.
fn both<'a>(title: &str, chart: impl Fn(Axes) -> Chart<'a>) -> String {
    let charts = vec![chart([(0, "x [mm]"), (2, "z [mm]")]), chart([(1, "y [mm]"), (2, "z [mm]")])];
    Figure { title: title.to_owned(), n_columns: 2, charts }.svg()
}

/// Paths, drawn longer than they are where they would be no more than dots.
fn trajectories(paths: &[&Vec<Point3<f64>>]) -> String {
    let starts: Vec<&Point3<f64>> = paths.iter().filter_map(|it| it.first()).collect();
    let way = |path: &Vec<Point3<f64>>| path.iter().map(|it| (it - path[0]).norm()).fold(0.0, f64::max);
    let longest = paths.iter().map(|it| way(it)).fold(0.0, f64::max);
    let factor = round_factor(LONGEST * extent(&starts) / longest).max(1.0);
    let title = match factor {
        1.0 => "Trajectories of a surface".to_owned(),
        _ => format!("Trajectories of a surface, {factor} times as long"),
    };
    let drawn: Vec<Vec<Point3<f64>>> =
        paths.iter().map(|path| path.iter().map(|it| path[0] + (it - path[0]) * factor).collect()).collect();
    both(&title, |[(x, across), (y, up)]| {
        let place = |it: &Point3<f64>| [1e3 * it[x], 1e3 * it[y]];
        let pieces = drawn.iter().map(|path| path.iter().map(place).collect()).collect();
        let ends = drawn.iter().filter_map(|it| it.last()).map(place).collect();
        Chart::new("", SIZE, Axis::new(across), Axis::new(up))
            .equal()
            .if_empty("no point was tracked")
            .with(Series { name: String::new(), marks: Drawn::Line, pen: Pen::new(COLOURS[0], 0.9), pieces })
            .with(Series::dots(String::new(), COLOURS[0], ends))
    })
}

/// The longest side of a box around places [m].
fn extent(places: &[&Point3<f64>]) -> f64 {
    let along = |axis: usize| {
        let all = || places.iter().map(|it| it[axis]);
        all().fold(f64::NEG_INFINITY, f64::max) - all().fold(f64::INFINITY, f64::min)
    };
    along(0).max(along(1)).max(along(2))
}

impl Pictures {
    /// How much longer than steps arrows are [–].
    fn factor(&self) -> f64 {
        let places: Vec<&Point3<f64>> = self.last.iter().map(|it| &it.0).collect();
        let longest = self.last.iter().map(|it| it.1.norm()).fold(0.0, f64::max) * self.last_step_s;
        round_factor(LONGEST * extent(&places) / longest)
    }

    fn field<'a>(&self, [(x, across), (y, up)]: Axes) -> Chart<'a> {
        let factor = self.factor();
        let stride = self.last.len().div_ceil(self.settings.arrows).max(1);
        let pieces = self.last.iter().step_by(stride).map(|(to, velocity)| {
            let step = velocity * self.last_step_s * factor;
            let from = to - velocity * self.last_step_s;
            let tip = [1e3 * (from[x] + step[x]), 1e3 * (from[y] + step[y])];
            let foot = [1e3 * from[x], 1e3 * from[y]];
            // Two barbs, of a quarter of the arrow.
            let (dx, dy) = (tip[0] - foot[0], tip[1] - foot[1]);
            let barb = |side: f64| [tip[0] - 0.25 * dx + side * 0.1 * dy, tip[1] - 0.25 * dy - side * 0.1 * dx];
            vec![foot, tip, barb(1.0), tip, barb(-1.0), tip]
        });
        Chart::new("", SIZE, Axis::new(across), Axis::new(up)).equal().if_empty("no point was tracked").with(Series {
            name: String::new(),
            marks: Drawn::Strokes,
            pen: Pen::new(COLOURS[0], 0.8),
            pieces: pieces.collect(),
        })
    }

    fn over_time(&self) -> String {
        let of = |which: usize| self.counts.iter().map(|it| [it[0], it[which]]).collect::<Vec<_>>();
        let chart = Chart::new("", [640.0, 300.0], Axis::new("time [s]"), Axis::new("points [–]").from_zero())
            .with(Series::line("points", COLOURS[0], of(1)))
            .with(Series::line("ended", COLOURS[1], of(2)))
            .with(Series::line("new", COLOURS[2], of(3)));
        Figure { title: "Points of the surface".to_owned(), n_columns: 1, charts: vec![chart] }.svg()
    }
}

/// The largest of 1, 2 or 5 times a power of ten that is at most `factor`.
fn round_factor(factor: f64) -> f64 {
    if !(factor.is_finite() && factor > 0.0) {
        return 1.0;
    }
    let power = 10f64.powf(factor.log10().floor());
    let leading = factor / power;
    power
        * if leading >= 5.0 {
            5.0
        } else if leading >= 2.0 {
            2.0
        } else {
            1.0
        }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        foveate_testkit::check_node::<Pictures>("trajectories = 3");
    }

    #[test]
    fn factors_are_round() {
        assert_eq!([7.3, 2.0, 1.9, 0.04, 130.0].map(round_factor), [5.0, 2.0, 1.0, 0.02, 100.0]);
        assert_eq!(round_factor(f64::NAN), 1.0);
    }
}
