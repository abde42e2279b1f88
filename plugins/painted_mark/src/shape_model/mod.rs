//! `painted_mark.shape_model`: estimates the pose and shape of a head or knee, and its hidden marks [Davis 2002 §5.4].

mod capture;
mod held_out;
mod leftover;
mod settings;
#[cfg(test)]
mod tests;
mod unseen;

use std::collections::BTreeMap;
use std::path::PathBuf;

use foveate::estimation::Summary;
use foveate::geometry::{FitOptions, FittedShape, MarkObservation, ShapeFitter};
use foveate::messages::ShapeFit;
use foveate::node::scale::Spaces;
use foveate::prelude::*;
use foveate::scene::{UncertainPose, load_shape_model, shape_model_to_toml};
use nalgebra::{Matrix3, Matrix6, Point3, Vector3};

use capture::{Capture, Rigid};
use held_out::HeldOut;
use leftover::Leftover;
pub use settings::{Kind, ShapeSettings};
use unseen::Unseen;

ports! {
    MARKS_IN: In<Marks> = each("marks");
    SPACE: In<ScaleSpace> = latest("space").many().optional();
    MARKS: Out<Marks> = "marks";
    TARGETS: Out<Targets> = "targets";
}

figures! {
        "shape.frames": count, neither, "Frames of marks received";
        "shape.frames_without_fit": count, low, "Frames with too few marks for a pose";
    "shape.acquired_from_frames": count, neither, "Frames of this run that the model was made from";
    "shape.marks": count, neither, "Marks of the model";
        "shape.fitted_frames": count, neither, "Frames that the model was fitted to; earlier ones are left out";
    "shape.all_marks_measured": share, high, "Fitted frames in which no mark had to be filled";
    "shape.filled": count, neither, "Marks filled by the model, over all fitted frames";
        "shape.left_out": count, low, "Hidden marks left out because their standard deviation exceeds most_sigma_mm, over all fitted frames";
    "shape.contradicting": count, low, "Measured marks that contradicted all others and were filled, over all fitted frames";
    "shape.frames_out_of_distribution": count, low, "Fitted frames whose out-of-distribution score is 1 or more";
    "shape.fit_rms_mm.{median,p95}": mm, low, "Root mean square distance of the measured marks of a frame from the fitted model, over fitted frames";
    "shape.filled_sigma_mm.median": mm, low, "Stated standard deviation of filled marks, of one axis";
    "shape.held_out_mm.{median,p95}": mm, low, "Distance of measured marks from their filled positions when held out of a fit with their neighbours, as if they were hidden";
}

/// Variance of an unknown velocity [m²/s²].
const UNKNOWN_VELOCITY: f64 = 1e6;

/// Measured marks in, all marks of the model out, in a space that moves with the head (the knee): measured ones at their measured
/// positions, hidden ones `filled` by the model and the residuals of their neighbours, with a covariance. That of a filled mark includes the uncertainty of the head's pose: it describes the
/// mark's position relative to the measured ones; it grows with the errors of held-out measured marks, and where cameras should see the mark but do not. Measured marks that contradict all others are filled as well.
///
/// The model is read from a file, or acquired from this session. Without a model the surface is assumed to be rigid: marks are sent as measured, with
/// a pose. The axes of the space are those of the first complete frame, which are the world's for marks from `painted_mark.integrator`; its origin is in the middle of the mean shape.
///
/// `targets` are the same marks in the space of the node's scale, numbered by label; for a moving scale, `space` has to be connected to its anchors, otherwise they are in the world.
pub struct Shape {
    settings: ShapeSettings,
    stage: Stage,
    fitter: Option<ShapeFitter>,
    held_out: Option<HeldOut>,
    unseen: Option<Unseen>,
    spaces: Option<Spaces>,
    /// Whether points of the world can be given in the scale's space: it stands still, or its place is known.
    is_placed: bool,
    /// Last positions of the marks in the scale's space.
    last: BTreeMap<u32, Point3<f64>>,
    last_time: Option<Time>,
    write_to: Option<PathBuf>,
    faults: Vec<String>,
    tally: Tally,
}

enum Stage {
    /// The fitter has a model without bases, from the marks seen so far.
    Rigid { surface: Rigid, capture: Option<Capture> },
    /// The fitter has a model.
    Modelled { n_frames: Option<usize> },
}

#[derive(Default)]
struct Tally {
    frames: u64,
    fitted: u64,
    all_measured: u64,
    filled: u64,
    left_out: u64,
    wrong: u64,
    out_of_distribution: u64,
    gaps: u64,
    rms_mm: Vec<f64>,
    filled_sigmas_mm: Vec<f64>,
}

impl Node for Shape {
    const TYPE: &'static str = "painted_mark.shape_model";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Fits a shape model of a face or knee to marks, and fills in hidden marks";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = ShapeSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ShapeSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let write_to = match settings.write.as_str() {
            "" => None,
            name => {
                setup.claim_named_file("write", name)?;
                setup.out_dir.as_ref().map(|it| it.join(name))
            }
        };
        let (stage, fitter) = if settings.model.is_empty() {
            let capture = (settings.acquire_until_s > 0.0).then(Capture::default);
            (Stage::Rigid { surface: Rigid::default(), capture }, None)
        } else {
            let path = setup.path("model", &settings.model)?;
            let model = load_shape_model(&path).map_err(|error| ConfigError::at("model", error))?;
            (Stage::Modelled { n_frames: None }, Some(ShapeFitter::new(model)))
        };
        let (is_told, spaces) = (setup.is_connected(&SPACE), Spaces::new(&setup.scales));
        Ok(Self {
            settings,
            stage,
            held_out: fitter.as_ref().map(HeldOut::of),
            unseen: fitter.as_ref().map(|it| Unseen::of(it.model())),
            fitter,
            is_placed: is_told || !spaces.is_moving(),
            spaces: is_told.then_some(spaces).filter(Spaces::is_moving),
            last: BTreeMap::new(),
            last_time: None,
            write_to,
            faults: Vec::new(),
            tally: Tally::default(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(spaces) = &mut self.spaces {
            io.latest_of_each(&SPACE).for_each(|it| spaces.learn(it.value));
        }
        let Some(Stamped { stamp, value: measured }) = io.take(&MARKS_IN) else { return Ok(()) };
        match self.step(&measured) {
            Ok((marks, targets)) => {
                io.emit(&MARKS, stamp, marks);
                match targets {
                    _ if !self.is_placed => {}
                    Ok(targets) => io.emit(&TARGETS, stamp, targets),
                    Err(reason) => io.gap(&TARGETS, measured.time, reason),
                }
            }
            Err(reason) => {
                io.gap(&MARKS, measured.time, &reason);
                if self.is_placed {
                    io.gap(&TARGETS, measured.time, &reason);
                }
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        // A session that ended before the acquisition should have: what there is makes a model for the next one.
        if matches!(&self.stage, Stage::Rigid { capture: Some(capture), .. } if !capture.is_empty()) {
            self.make_model();
        }
        let tally = &self.tally;
        report.figure("shape.frames", tally.frames as f64);
        report.figure("shape.frames_without_fit", tally.gaps as f64);
        if let Stage::Modelled { n_frames } = &self.stage {
            if let Some(n_frames) = n_frames {
                report.figure("shape.acquired_from_frames", *n_frames as f64);
            }
            let n_marks = self.fitter.as_ref().map_or(0, |it| it.model().labels.len());
            report.figure("shape.marks", n_marks as f64);
            report.figure("shape.fitted_frames", tally.fitted as f64);
            report.figure("shape.all_marks_measured", tally.all_measured as f64 / tally.fitted as f64);
            report.figure("shape.filled", tally.filled as f64);
            report.figure("shape.left_out", tally.left_out as f64);
            report.figure("shape.contradicting", tally.wrong as f64);
            report.figure("shape.frames_out_of_distribution", tally.out_of_distribution as f64);
            if let Some(rms) = Summary::of(&tally.rms_mm) {
                report.figure("shape.fit_rms_mm.median", rms.median);
                report.figure("shape.fit_rms_mm.p95", rms.p95);
            }
            if let Some(sigma) = Summary::of(&tally.filled_sigmas_mm) {
                report.figure("shape.filled_sigma_mm.median", sigma.median);
            }
            if let Some(off) = self.held_out.as_ref().and_then(HeldOut::off_mm) {
                report.figure("shape.held_out_mm.median", off.median);
                report.figure("shape.held_out_mm.p95", off.p95);
            }
        }
        self.faults.drain(..).for_each(|it| report.remark(it));
        if let (Some(path), Stage::Modelled { n_frames: Some(_) }) = (&self.write_to, &self.stage) {
            report.file(path.file_name().map_or_else(|| path.clone(), PathBuf::from));
        }
        Ok(())
    }
}

impl Shape {
    /// The output for the marks of one time, or why there is none: no output at all, or no targets.
    fn step(&mut self, measured: &Marks) -> Result<(Marks, Result<Targets, String>), String> {
        self.tally.frames += 1;
        self.acquire(measured);
        let fitted = self.fit(measured).inspect_err(|_| self.tally.gaps += 1)?;
        let is_modelled = matches!(self.stage, Stage::Modelled { .. });
        let most_mm = self.settings.most_sigma_mm;
        let most_sigma = if most_mm > 0.0 { most_mm * 1e-3 } else { f64::INFINITY };
        if let (Some(unseen), Some(fitter)) = (&mut self.unseen, &self.fitter) {
            unseen.see(fitter.model(), &measured.list);
        }
        let filling = Filling { held_out: self.held_out.as_ref(), unseen: self.unseen.as_ref(), most_sigma };
        let marks = place(measured, &fitted, self.fitter.as_ref().filter(|_| is_modelled), &filling);
        self.count(&marks, &fitted, is_modelled);
        let own_from_world = self.own_from_world(measured.time);
        let targets = own_from_world.map(|it| self.targets(measured, &marks, &it));
        Ok((marks, targets))
    }

    /// Gathers frames for the model, and makes it when the time has come.
    fn acquire(&mut self, measured: &Marks) {
        let Stage::Rigid { capture: Some(capture), .. } = &mut self.stage else { return };
        let time_s = measured.time.as_s();
        if time_s < self.settings.acquire_until_s {
            if time_s >= self.settings.acquire_from_s {
                capture.add(measured);
            }
        } else {
            self.make_model();
        }
    }

    fn make_model(&mut self) {
        let Stage::Rigid { capture, .. } = &mut self.stage else { return };
        let Some(capture) = capture.take() else { return };
        match capture.model(&self.settings) {
            Ok((model, n_frames)) => {
                if let Some(path) = &self.write_to
                    && let Err(error) = std::fs::write(path, shape_model_to_toml(&model))
                {
                    self.faults.push(format!("the model was not written to {}: {error}", path.display()));
                }
                let fitter = ShapeFitter::new(model);
                self.held_out = Some(HeldOut::of(&fitter));
                self.unseen = Some(Unseen::of(fitter.model()));
                self.fitter = Some(fitter);
                self.stage = Stage::Modelled { n_frames: Some(n_frames) };
            }
            Err(fault) => self.faults.push(format!("no model of the shape was acquired: {fault}")),
        }
    }

    fn fit(&mut self, measured: &Marks) -> Result<FittedShape, String> {
        let observations: Vec<MarkObservation> = measured
            .list
            .iter()
            .filter(|it| it.provenance == Provenance::Measured)
            .map(|it| MarkObservation::new(it.label, it.position, it.covariance))
            .collect();
        let least = self.settings.min_marks as usize;
        if let Stage::Rigid { surface, .. } = &mut self.stage
            && self.fitter.is_none()
            && observations.len() >= least
            && surface.learn(measured, None)
        {
            self.fitter = Some(ShapeFitter::new(surface.model()));
        }
        let too_few = |known: usize, enough: usize| format!("{known} marks are measured, expected {enough} or more");
        let fitter = self.fitter.as_mut().ok_or_else(|| too_few(observations.len(), least))?;
        let known = observations.iter().filter(|it| fitter.model().index_of(it.label).is_some()).count();
        let enough = least.min(fitter.model().labels.len());
        if known < enough {
            return Err(too_few(known, enough));
        }
        let options = FitOptions { gate_sigmas: self.settings.gate_sigmas, ..FitOptions::default() };
        let fitted = fitter.fit(&observations, &options);
        if let (Some(held_out), Ok(fitted)) = (&mut self.held_out, &fitted) {
            held_out.learn(&observations, fitted, enough, &options);
        }
        if let Stage::Rigid { surface, .. } = &mut self.stage {
            match &fitted {
                Ok(fitted) if surface.learn(measured, Some(&fitted.measured_from_shape)) => {
                    self.fitter = Some(ShapeFitter::new(surface.model()));
                }
                Ok(_) => {}
                // Begun with marks that fix no pose: the next frame begins anew.
                Err(_) => (*surface, self.fitter) = (Rigid::default(), None),
            }
        }
        fitted.map_err(|fault| fault.to_string())
    }

    fn count(&mut self, marks: &Marks, fitted: &FittedShape, is_modelled: bool) {
        if !is_modelled {
            return;
        }
        let tally = &mut self.tally;
        tally.fitted += 1;
        let filled = || marks.list.iter().filter(|it| it.provenance == Provenance::Filled);
        tally.filled += filled().count() as u64;
        let labels = self.fitter.iter().flat_map(|it| &it.model().labels);
        tally.left_out += labels.filter(|it| marks.get(**it).is_none()).count() as u64;
        tally.all_measured += u64::from(filled().next().is_none());
        tally.wrong += fitted.wrong.len() as u64;
        tally.out_of_distribution += u64::from(fitted.out_of_distribution >= 1.0);
        tally.rms_mm.push(fitted.rms * 1e3);
        tally.filled_sigmas_mm.extend(filled().map(|it| it.sigma() * 1e3));
    }

    fn own_from_world(&self, time: Time) -> Result<UncertainPose, String> {
        match &self.spaces {
            None => Ok(UncertainPose::exact(nalgebra::Isometry3::identity())),
            Some(spaces) => spaces.a_from_b(spaces.own(), spaces.root(), time).map_err(|error| error.to_string()),
        }
    }

    /// The same marks in the scale's space. The uncertainty of the whole is that of the received marks.
    fn targets(&mut self, measured: &Marks, marks: &Marks, own_from_world: &UncertainPose) -> Targets {
        let whole = UncertainPose { transform: measured.world_from_marks, covariance: measured.covariance };
        let own_from_marks = own_from_world.then_from(&whole);
        let marks_from_shape = measured.world_from_marks.inverse() * marks.world_from_marks;
        let turn = marks_from_shape.rotation.to_rotation_matrix();
        let dt_s = self.last_time.map_or(0.0, |before| (marks.time - before).as_s());
        let mut now = BTreeMap::new();
        let target = |mark: &Mark| {
            let covariance = turn * mark.covariance * turn.transpose();
            let (position, spread) = own_from_marks.transform_point(&(marks_from_shape * mark.position), &covariance);
            let before = self.last.get(&mark.label).filter(|_| dt_s > 0.0);
            now.insert(mark.label, position);
            let mut covariance = Matrix6::zeros();
            covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&spread);
            covariance.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(UNKNOWN_VELOCITY);
            Target {
                id: TargetId(mark.label),
                position,
                velocity: before.map_or(Vector3::zeros(), |before| (position - before) / dt_s),
                covariance,
                cameras: mark.cameras.clone(),
                provenance: mark.provenance,
            }
        };
        let list = marks.list.iter().map(target).collect();
        self.last = now;
        self.last_time = Some(marks.time);
        Targets { time: marks.time, list }
    }
}

/// Model positions of the marks of `seen`, and their residuals, in the model's space [m].
fn left_of(seen: &[Mark], fitted: &FittedShape, fitter: &ShapeFitter) -> Vec<(Point3<f64>, Vector3<f64>)> {
    let left = |it: &Mark| {
        let place = fitted.marks[fitter.model().index_of(it.label)?].position;
        Some((place, it.position - place))
    };
    seen.iter().filter_map(left).collect()
}

/// How hidden marks are filled.
struct Filling<'a> {
    held_out: Option<&'a HeldOut>,
    unseen: Option<&'a Unseen>,
    /// Largest standard deviation of one axis; hidden marks with a larger one are left out [m].
    most_sigma: f64,
}

impl Filling<'_> {
    /// Covariance of the filled mark number `mark`, with the model's `covariance` and its neighbours' variance `open` on each axis [m²].
    fn covariance(&self, mark: usize, covariance: &Matrix3<f64>, open: f64) -> Matrix3<f64> {
        let as_stated = (covariance + Matrix3::identity() * open) * self.held_out.map_or(1.0, HeldOut::factor);
        as_stated + Matrix3::identity() * self.unseen.map_or(0.0, |it| it.variance(mark))
    }
}

/// The measured marks in the space of the shape, and the model's marks that were not measured, or wrong, by `filling`.
fn place(measured: &Marks, fitted: &FittedShape, model: Option<&ShapeFitter>, filling: &Filling<'_>) -> Marks {
    let turn = fitted.measured_from_shape.rotation.to_rotation_matrix();
    let into_shape = |covariance: &Matrix3<f64>| turn.transpose() * covariance * turn;
    let is_kept =
        |it: &&Mark| it.provenance == Provenance::Measured && !(model.is_some() && fitted.wrong.contains(&it.label));
    let mut list: Vec<Mark> = measured
        .list
        .iter()
        .filter(is_kept)
        .map(|it| Mark {
            position: fitted.measured_from_shape.inverse_transform_point(&it.position),
            covariance: into_shape(&it.covariance),
            ..it.clone()
        })
        .collect();
    let n_kept = list.len();
    let leftover = model.and_then(|it| Leftover::of(&left_of(&list, fitted, it)));
    for (number, (label, mark)) in model.iter().flat_map(|it| it.model().labels.iter().zip(&fitted.marks)).enumerate() {
        if list[..n_kept].binary_search_by_key(label, |it| it.label).is_err() {
            let (moved, open) = leftover
                .as_ref()
                .map_or((Vector3::zeros(), 0.0), |it| (it.at(&mark.position), it.variance_at(&mark.position)));
            let filled = Mark {
                label: *label,
                position: mark.position + moved,
                covariance: filling.covariance(number, &mark.covariance, open),
                cameras: CameraSet::default(),
                provenance: Provenance::Filled,
            };
            if filled.sigma() <= filling.most_sigma {
                list.push(filled);
            }
        }
    }
    list.sort_by_key(|it| it.label);
    let whole = UncertainPose { transform: measured.world_from_marks, covariance: measured.covariance };
    let pose = UncertainPose { transform: fitted.measured_from_shape, covariance: fitted.covariance };
    let world_from_shape = whole.then_from(&pose);
    Marks {
        time: measured.time,
        world_from_marks: world_from_shape.transform,
        covariance: world_from_shape.covariance,
        list,
        fit: model.map(|_| ShapeFit {
            rms: fitted.rms,
            out_of_distribution: fitted.out_of_distribution,
            weights: fitted.weights.clone(),
        }),
    }
}
