//! `surface.matcher`: pictures of one moment in, a point cloud of the surface out [D'Apuzzo 1999 §2.3].

use foveate::prelude::*;

use crate::clouds::Clouds;
use crate::engine::Engine;
use crate::measure::{Sample, sigma};
use crate::settings::{Prepared, SurfaceSettings};
use crate::views::Moment;

ports! {
    pub(crate) fn declared_ports;
    IMAGE: In<Image> = synced("image", 4).many();
    CLOUD: Out<PointCloud> = "cloud";
}

figures! {
        "surface.points": count, neither, "Points sent, over all moments";
        "surface.measured": count, neither, "Points measured, seeds included, before they are compared with their neighbours";
    "surface.refused.*": count, low, "Attempts at a point that failed for this reason; a place may be tried from several neighbours";
        "surface.seeds.tried": count, neither, "Seeds that were named, or textured patches that were searched along their epipolar lines";
        "surface.seeds.ambiguous": count, low, "Seeds with a second place nearly as good in some view: a repeated texture";
        "surface.seeds.found": count, high, "Seeds that became points";
    "surface.unseen": share, low, "Points that some camera does not see though they face it within 60° and lie in its picture, over all points of all moments: occluded, or cameras not synchronised or moved";
        "surface.misfit_px.median": px, low, "Residual of a point's lines of sight, median over the points of a moment and over the moments";
        "surface.misfit_px.max": px, low, "The same for the moment in which it is largest";
        "surface.out_of_step": count, low, "Moments left out because their residuals are far larger than earlier";
        "surface.stuck": count, low, "Pictures not used because they equal the one before, byte for byte, while another camera's had changed";
    "surface.coverage": share, high, "Places of the grid with a point, over those in the smallest rectangle around all points of a cloud, mean over the clouds";
    "surface.sigma_mm": mm, low, "Mean standard deviation of the points, over the three axes, by their matches and contradictions between cameras";
}

/// Pictures of several cameras in, clouds out.
pub struct Matcher {
    engine: Engine,
    clouds: Clouds,
    moment: Moment,
    moments: u64,
    points: u64,
    /// By reference.
    points_of: Vec<u64>,
    sigmas: f64,
    coverages: Vec<f64>,
    faults: Vec<String>,
}

/// Most faults that are reported one by one.
const MOST_FAULTS: usize = 5;

impl Node for Matcher {
    const TYPE: &'static str = "surface.matcher";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Measures a textured surface densely by least-squares matching between views";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = SurfaceSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: SurfaceSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let engine = Engine::new(settings.prepare(setup)?);
        let points_of = vec![0; engine.prepared.references.len()];
        let (moment, coverages, faults) = (Moment::default(), Vec::new(), Vec::new());
        Ok(Self {
            engine,
            clouds: Clouds::default(),
            moment,
            moments: 0,
            points: 0,
            points_of,
            sigmas: 0.0,
            coverages,
            faults,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let images: Vec<_> = io.take_set(&IMAGE).collect();
        let Some(time) = images.iter().map(Stamped::time).max() else { return Ok(()) };
        let n_levels = self.engine.prepared.seeds.n_levels;
        self.faults.extend(self.engine.take(&mut self.moment, &images, n_levels));
        self.moments += 1;
        let n_references = self.engine.prepared.references.len();
        let (mut numbers, mut surfaces) = (Vec::new(), Vec::new());
        for number in 0..n_references {
            self.engine.look_from(number);
            if let Some(why) = missing(&self.engine, &self.moment) {
                io.gap(&CLOUD, time, why);
                continue;
            }
            let seeds = self.engine.begin(&self.moment);
            let is_named = self.engine.is_named();
            let surface = self.engine.grow(&self.moment, &seeds, is_named);
            io.still_working();
            numbers.push(number);
            surfaces.push((self.engine.prepared.reference, surface));
        }
        let Prepared { views, cover, .. } = &self.engine.prepared;
        self.clouds.settle(views, &mut surfaces, cover);
        let points = || surfaces.iter().flat_map(|it| &it.1);
        if surfaces.is_empty() {
            return Ok(());
        }
        if let Some(why) = self.engine.give(points().map(|it| (&it.sample, &it.normal))) {
            io.gap(&CLOUD, time, why);
            return Ok(());
        }
        let samples: Vec<&Sample> = points().map(|it| &it.sample).collect();
        let places = self.engine.straightened(&samples);
        self.points += samples.len() as u64;
        self.sigmas += self.engine.widened().sqrt() * places.iter().map(|it| sigma(&it.1)).sum::<f64>();
        let mut places = &places[..];
        for (number, (_, surface)) in numbers.into_iter().zip(&surfaces) {
            self.engine.look_from(number);
            self.points_of[number] += surface.len() as u64;
            self.coverages.extend(coverage(surface.iter().map(|it| it.cell)));
            let own;
            (own, places) = places.split_at(surface.len());
            let name = if n_references > 1 { self.moments.to_string() } else { String::new() };
            io.emit_at(&CLOUD, time, self.engine.cloud(&self.moment, surface, own, name));
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.engine.report(report);
        report.figure("surface.points", self.points as f64);
        report.figure("surface.sigma_mm", 1e3 * self.sigmas / self.points as f64);
        report.figure("surface.coverage", self.coverages.iter().sum::<f64>() / self.coverages.len() as f64);
        let Prepared { views, references, .. } = &self.engine.prepared;
        self.clouds.report(views, report);
        let empty = references.iter().zip(&self.points_of).filter(|it| *it.1 == 0);
        let empty: Vec<String> = empty.map(|it| format!("`{}`", views[it.0.0].name)).collect();
        if self.points > 0 && !empty.is_empty() {
            report.remark(format!(
                "no points were measured from {}: expected its pictures of the same time, and a neighbour that sees the same surface",
                empty.join(", ")
            ));
        }
        report.figure("surface.refused.clouds", self.clouds.n_left_out() as f64);
        if let Some(sides) = self.engine.other_sides() {
            report.remark(format!("{sides}; `reference = \"*\"` gives a cloud for each camera"));
        }
        report_faults(&mut self.faults, report);
        Ok(())
    }
}

/// Why a moment cannot be matched.
pub(crate) fn missing(engine: &Engine, moment: &Moment) -> Option<String> {
    let prepared = &engine.prepared;
    let reference = &prepared.views[prepared.reference].name;
    match () {
        () if moment.pictures[prepared.reference].is_none() => {
            Some(format!("found no picture of the reference `{reference}` at this time, expected one"))
        }
        () if moment.n_pictures() < prepared.measure.min_views => Some(format!(
            "found pictures of {} cameras at this time, expected {}",
            moment.n_pictures(),
            prepared.measure.min_views
        )),
        () => None,
    }
}

/// Part of the grid that has points, in the rectangle around them.
pub(crate) fn coverage(cells: impl Iterator<Item = [usize; 2]> + Clone) -> Option<f64> {
    let extent = |axis: usize| {
        let all = cells.clone().map(move |it| it[axis]);
        Some(all.clone().max()? - all.min()? + 1)
    };
    Some(cells.clone().count() as f64 / (extent(0)? * extent(1)?) as f64)
}

/// The first few faults as remarks.
pub(crate) fn report_faults(faults: &mut Vec<String>, report: &mut Report) {
    let n = faults.len();
    faults.iter().take(MOST_FAULTS).for_each(|it| report.remark(it.clone()));
    if n > MOST_FAULTS {
        report.remark(format!("and {} more pictures that could not be used", n - MOST_FAULTS));
    }
    faults.clear();
}
