//! `body.svg`: the fitted body over the points, as Figure 13 of [D'Apuzzo 1999].

use foveate::geometry::metaball::{Body, State, skin_patches};
use foveate::plot::svg::Pen;
use foveate::plot::{Axis, COLOURS, Chart, Figure, Marks as Drawn, Series};
use foveate::prelude::*;
use nalgebra::Point3;

const SIZE: [f64; 2] = [420.0, 380.0];
/// Points that are drawn at most.
const MOST_POINTS: usize = 1500;

/// One moment.
struct Moment {
    time: Time,
    points: Vec<Point3<f64>>,
    state: State,
}

/// First, middle and last moment.
#[derive(Default)]
pub(super) struct Picture {
    moments: Vec<Moment>,
    /// Every so many messages one is kept.
    stride: usize,
    n: usize,
}

impl Picture {
    pub fn add(&mut self, surface: &TrackedSurface, _body: &Body, state: &State) {
        self.stride = self.stride.max(1);
        let stride = surface.list.len().div_ceil(MOST_POINTS).max(1);
        let points = surface.list.iter().step_by(stride).map(|it| it.position).collect();
        let moment = Moment { time: surface.time, points, state: state.clone() };
        // The last one always stands at the end.
        if self.n > 0 && !(self.n - 1).is_multiple_of(self.stride) {
            self.moments.pop();
        }
        self.moments.push(moment);
        self.n += 1;
        if self.moments.len() > 16 {
            let mut place = 0;
            self.moments.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            self.stride *= 2;
        }
    }

    pub fn svg(&self, body: &Body) -> String {
        let n = self.moments.len();
        let mut chosen: Vec<usize> = [0, n / 2, n.saturating_sub(1)].into_iter().filter(|it| *it < n).collect();
        chosen.dedup();
        let mut charts = Vec::new();
        for moment in chosen.iter().map(|it| &self.moments[*it]) {
            for axes in [[(0, "x [mm]"), (2, "z [mm]")], [(1, "y [mm]"), (2, "z [mm]")]] {
                charts.push(chart(body, moment, axes));
            }
        }
        if charts.is_empty() {
            charts.push(Chart::new("", SIZE, Axis::new("x [mm]"), Axis::new("z [mm]")).if_empty("no body was fitted"));
        }
        Figure { title: "Fitted body over the points".to_owned(), n_columns: 2, charts }.svg()
    }
}

fn chart<'a>(body: &Body, moment: &Moment, [(x, across), (y, up)]: [(usize, &'static str); 2]) -> Chart<'a> {
    let flat = |it: &Point3<f64>| [1e3 * it[x], 1e3 * it[y]];
    let rings = skin_patches(body, &moment.state, 9, 24, 1).into_iter().flat_map(|patch| {
        let closed = |section: &Vec<Point3<f64>>| section.iter().chain(section.first()).map(flat).collect();
        let mut lines: Vec<Vec<[f64; 2]>> = patch.control.iter().map(closed).collect();
        // Lines along the limb, every fourth ray.
        let rays = patch.control.first().map_or(0, Vec::len);
        lines.extend((0..rays).step_by(4).map(|ray| patch.control.iter().map(|it| flat(&it[ray])).collect()));
        lines
    });
    let skin =
        Series { name: "body".to_owned(), marks: Drawn::Line, pen: Pen::new(COLOURS[1], 0.6), pieces: rings.collect() };
    let posed = body.skeleton.pose(&moment.state);
    let bone = |segment: usize| {
        vec![flat(&body.skeleton.joint(&posed, segment)), flat(&body.skeleton.end(&posed, &moment.state, segment))]
    };
    let pieces = (0..body.skeleton.segments().len()).map(bone).collect();
    let bones = Series { name: "bones".to_owned(), marks: Drawn::Line, pen: Pen::new(COLOURS[2], 2.0), pieces };
    Chart::new(format!("{:.2} s", moment.time.as_s()), SIZE, Axis::new(across), Axis::new(up))
        .equal()
        .with(Series::dots("points", COLOURS[0], moment.points.iter().map(flat).collect()))
        .with(skin)
        .with(bones)
}
