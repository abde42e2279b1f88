//! `painted_mark.integrator`: recovers marks in space from the marks in the pictures of several cameras.

mod coherence;
mod constellation;
mod gather;
mod initiation;
mod matching;
mod pair;
mod registration;
mod settings;
mod shapes;
#[cfg(test)]
pub(crate) mod tests;
mod track_store;

use std::collections::{BTreeMap, BTreeSet};

use foveate::geometry::{Camera, Joint, JointObservation, JointOptions, JointPoint, Viewpoint, triangulate_jointly};
use foveate::messages::GuidedMark;
use foveate::prelude::*;
use nalgebra::{Isometry3, Matrix3, Point2, Point3};

use coherence::{Coherence, Verdict};
use gather::{Frame, Gather, View};
use pair::{Blend, Choice, Offer, middle};
pub use settings::{IntegratorSettings, Views};
use shapes::Shapes;
use track_store::TrackStore;

ports! {
    FEATURES: In<Features> = synced("features", 4).many();
    POSES: In<HeadPose> = each("poses").many().optional();
    FILLED: In<Marks> = latest("filled").optional();
    MARKS: Out<Marks> = "marks";
    GUIDE: Out<MarkGuide> = "guide";
}

figures! {
        "(*.)marks.measured.mean": count, high, "Marks measured in a frame, mean over all frames";
        "(*.)marks.views.mean": count, high, "Cameras used for a mark, mean over all measured marks";
        "(*.)marks.frames": count, neither, "Moments with pictures";
        "(*.)marks.frames_without": count, low, "Moments at which no mark was recovered";
        "(*.)marks.known": count, neither, "Confirmed marks when the run ends, including face features that look like dots (irises, corners of eyes) and marks that were initiated twice";
        "(*.)marks.disputed": count, low, "Observations that contradicted those of the other cameras; not used";
    "(*.)marks.frames_incoherent": count, low, "With pose_errors: moments rejected because too many marks were off their predictions";
    "(*.)marks.searches": count, low, "Times that the surface was found without a prior";
    "(*.)marks.pair_changes": count, low, "With views = best_pair: changes of the pair of cameras";
    "(*.)marks.pictures_without_pose": count, low, "Pictures of cameras on heads for which no pose came; not used";
    "(*.)marks.pose_error_mrad.*": mrad, low, "With pose_errors: root mean square rotation between the stated and the estimated pose of that camera";
}

/// With fewer marks than this the search restarts without a prior.
const LEAST_TO_GO_ON: usize = 6;
/// Standard deviation of the predicted position of an unseen mark [m].
const CARRIED_SIGMA: f64 = 0.002;
/// A single camera's observation of a hidden mark is rejected beyond this distance from its prediction: it is the contour of a nose in front of the mark
/// [standard deviations].
const LONE_SIGMAS: f64 = 1.5;
const DEFAULT_RADIUS_M: f64 = 0.25;

/// Labelled marks and unlabelled dots come in from trackers. Dots that enough cameras agree on become marks, and `guide` sends each tracker
/// the predicted pixel of each of them, which gives marks their labels, also after they were lost. Marks are sent when two cameras
/// or more agree on them, in a space with the world's axes and its origin at their mean.
///
/// Cameras on heads have the poses of `poses`, cameras without a head those of the calibration. The pictures have to be taken at the same
/// moment: painted marks move while a face does.
pub struct Integrator {
    settings: IntegratorSettings,
    radius: f64,
    /// Names of the calibration's cameras.
    cameras: Vec<String>,
    gather: Gather,
    track_store: TrackStore,
    shapes: Shapes,
    coherence: Coherence,
    choice: Choice,
    blend: Blend,
    last: Option<Time>,
    tally: Tally,
}

#[derive(Default)]
struct Tally {
    frames: u64,
    marks: u64,
    views: u64,
    disputed: u64,
    incoherent: u64,
    without_answer: u64,
    starts: u64,
    /// Cameras that reported at one moment, at most.
    most_views: usize,
    /// By camera: sum of squared pose errors (rotation) [rad²], and number of frames.
    turns: BTreeMap<CameraId, (f64, u64)>,
}

/// The labelled features of one frame as observations, with the labels of points and the origin of each observation.
struct Observations {
    labels: Vec<u32>,
    list: Vec<JointObservation>,
}

impl Observations {
    /// By label, how many cameras see it.
    fn seen_by(&self) -> BTreeMap<u32, usize> {
        let mut counts = BTreeMap::new();
        self.list.iter().for_each(|it| *counts.entry(self.labels[it.point]).or_default() += 1);
        counts
    }
}

impl Node for Integrator {
    const TYPE: &'static str = "painted_mark.integrator";
    const ROLE: Role = Role::Integrator;
    const SUMMARY: &'static str = "Recovers painted marks in space from all cameras or the best pair, and names them";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = IntegratorSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: IntegratorSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let radius =
            if settings.radius_m > 0.0 { settings.radius_m } else { setup.radius_m.unwrap_or(DEFAULT_RADIUS_M) };
        Ok(Self {
            radius,
            cameras: setup.calibration.cameras.iter().map(|it| it.name.clone()).collect(),
            gather: Gather::new(setup),
            track_store: TrackStore::default(),
            shapes: Shapes::default(),
            coherence: Coherence::default(),
            choice: Choice::default(),
            blend: Blend::new(settings.blend_ms * 1e-3),
            last: None,
            tally: Tally::default(),
            settings,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(pose) = io.take(&POSES) {
            self.gather.pose(pose.value);
        } else {
            let set = io.take_set(&FEATURES).collect();
            self.gather.set(set);
        }
        while let Some(frame) = self.gather.next() {
            let filled = io.latest(&FILLED).map(|it| it.value.clone());
            let (marks, guide) = self.integrate(&frame, filled.as_ref());
            match marks {
                Some(marks) => io.emit_at(&MARKS, frame.time, marks),
                None => io.gap(&MARKS, frame.time, "no mark is seen by two cameras"),
            }
            io.emit_at(&GUIDE, frame.time, guide);
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Tally { frames, marks, views, disputed, incoherent, without_answer, starts, turns, most_views } =
            &self.tally;
        let mut figure = |name: &str, value: f64| {
            let dot = if self.settings.label.is_empty() { "" } else { "." };
            report.figure(format!("{}{dot}marks.{name}", self.settings.label), value);
        };
        figure("frames", *frames as f64);
        if *frames > 0 {
            figure("measured.mean", *marks as f64 / *frames as f64);
            figure("views.mean", *views as f64 / (*marks).max(1) as f64);
        }
        figure("known", self.track_store.marks.values().filter(|it| it.is_believed).count() as f64);
        figure("disputed", *disputed as f64);
        if self.settings.pose_errors {
            figure("frames_incoherent", *incoherent as f64);
        }
        figure("frames_without", *without_answer as f64);
        figure("searches", *starts as f64);
        if self.settings.views == Views::BestPair {
            figure("pair_changes", self.choice.changes as f64);
        }
        if self.gather.without_pose > 0 {
            figure("pictures_without_pose", self.gather.without_pose as f64);
        }
        for (camera, (sum, n)) in turns.iter().filter(|_| self.settings.pose_errors) {
            let name = self.cameras.get(usize::from(camera.0)).map_or("", String::as_str);
            figure(&format!("pose_error_mrad.{name}"), (sum / *n as f64).sqrt() * 1e3);
        }
        if *frames > 0 && *most_views < 2 {
            report.remark(format!(
                "No mark could be recovered: {most_views} camera reported at a time, expected 2 or more whose pictures are taken at the same moment."
            ));
        }
        Ok(())
    }
}

impl Integrator {
    fn integrate(&mut self, frame: &Frame, filled: Option<&Marks>) -> (Option<Marks>, MarkGuide) {
        self.tally.frames += 1;
        self.tally.most_views = self.tally.most_views.max(frame.views.len());
        if let Some(last) = self.last.replace(frame.time) {
            self.blend.fade((frame.time - last).as_s().max(0.0));
        }
        let observations = self.observations(frame);
        let solved = self.solve(frame, &observations);
        let (solved, strays) = self.without_strays(&observations, solved);
        let cameras: Vec<Camera> = match &solved {
            Some(joint) => joint.cameras.clone(),
            None => frame.views.iter().map(|it| it.viewpoint.camera.clone()).collect(),
        };
        let mut disputed = BTreeSet::new();
        let mut measured = BTreeMap::new();
        if let Some(joint) = &solved {
            for (observation, _) in observations.list.iter().zip(&joint.disputed).filter(|it| *it.1) {
                disputed.insert((frame.views[observation.viewpoint].id, observations.labels[observation.point]));
            }
            for (label, point) in observations.labels.iter().zip(&joint.points) {
                measured.extend(point.map(|it| (*label, it.position)));
            }
            self.count_turns(frame, joint);
        }
        let is_stray = |it: &&JointObservation| strays.contains(&observations.labels[it.point]);
        for observation in observations.list.iter().filter(is_stray) {
            disputed.insert((frame.views[observation.viewpoint].id, observations.labels[observation.point]));
        }
        self.tally.disputed += disputed.len() as u64;
        for (label, position) in &measured {
            if !self.track_store.marks.contains_key(label) {
                self.track_store.named(*label, *position);
            }
        }
        let weak = self.weak(&observations, self.initiation_views(frame));
        self.track_store.update(&measured, &weak, filled, self.settings.initiation_frames);
        self.shapes.remember(&self.track_store);
        let mut doubted = BTreeSet::new();
        let cameras = if measured.len() < LEAST_TO_GO_ON {
            self.look_for_surface(frame).unwrap_or(cameras)
        } else {
            doubted = self.look_for_new(frame, &cameras, &weak);
            cameras
        };
        let seen_twice = observations.seen_by().into_iter().filter(|it| it.1 > 1);
        let agreed = |label: u32| measured.contains_key(&label) && !doubted.contains(&label);
        self.track_store.judge(seen_twice.map(|it| (it.0, agreed(it.0))));
        let guide = self.guide(frame, &cameras, &disputed, &observations.seen_by());
        let marks = solved.and_then(|joint| self.marks(frame, &observations, joint));
        match &marks {
            Some(marks) => {
                self.tally.marks += marks.list.len() as u64;
                self.tally.views += marks.list.iter().map(|it| it.cameras.len() as u64).sum::<u64>();
            }
            None => self.tally.without_answer += 1,
        }
        (marks, guide)
    }

    /// Labels given here that fewer than `n_views` cameras see.
    fn weak(&self, observations: &Observations, n_views: usize) -> BTreeSet<u32> {
        let few =
            observations.seen_by().into_iter().filter(|(label, n)| *n < n_views && self.track_store.is_own(*label));
        few.map(|it| it.0).collect()
    }

    fn observations(&self, frame: &Frame) -> Observations {
        let mut observations = Observations { labels: Vec::new(), list: Vec::new() };
        let mut places = BTreeMap::new();
        for (viewpoint, view) in frame.views.iter().enumerate() {
            let mut here = BTreeSet::new();
            for feature in &view.features.list {
                let Some(label) = feature.label.filter(|it| here.insert(*it)) else { continue };
                if self.track_store.retired.contains(&label) {
                    continue;
                }
                let point = *places.entry(label).or_insert_with(|| {
                    observations.labels.push(label);
                    observations.labels.len() - 1
                });
                let Feature { centre: pixel, covariance, .. } = *feature;
                observations.list.push(JointObservation { viewpoint, point, pixel, covariance });
            }
        }
        observations
    }

    fn options(&self) -> JointOptions {
        JointOptions {
            estimate_poses: self.settings.pose_errors,
            rotation_floor: self.settings.rotation_floor_mrad * 1e-3,
            translation_floor: self.settings.translation_floor_mm * 1e-3,
            pixel_floor: self.settings.pixel_floor_px,
            // Poses that are off and taken as they are make every mark seem wrong.
            outlier_sigmas: if self.settings.pose_errors { self.settings.outlier_sigmas } else { f64::INFINITY },
        }
    }

    /// The solution without marks that jumped among their neighbours, and their labels; `None` for an incoherent shape. Without estimated pose errors, marks seem to
    /// jump that do not.
    fn without_strays(&mut self, observations: &Observations, solved: Option<Joint>) -> (Option<Joint>, BTreeSet<u32>) {
        let Some(mut joint) = solved else { return (None, BTreeSet::new()) };
        if !self.settings.pose_errors {
            return (Some(joint), BTreeSet::new());
        }
        let is_own = |label: &u32| self.track_store.is_own(*label);
        let known = self.track_store.marks.iter().filter(|it| it.1.is_believed && is_own(it.0));
        let known: BTreeMap<u32, Point3<f64>> = known.map(|it| (*it.0, it.1.position)).collect();
        let found = observations.labels.iter().zip(&joint.points);
        let measured = found.filter_map(|(label, point)| Some((*label, point.as_ref()?.position))).collect();
        match self.coherence.judge(&known, &measured) {
            Verdict::Incoherent => {
                self.tally.incoherent += 1;
                (None, BTreeSet::new())
            }
            Verdict::Strays(strays) => {
                for (label, point) in observations.labels.iter().zip(&mut joint.points) {
                    if strays.contains(label) {
                        *point = None;
                    }
                }
                (Some(joint), strays)
            }
        }
    }

    /// Marks from the pictures that the settings select. `None` where no mark is seen twice.
    fn solve(&mut self, frame: &Frame, observations: &Observations) -> Option<Joint> {
        let viewpoints: Vec<Viewpoint> = frame.views.iter().map(|it| it.viewpoint.clone()).collect();
        let options = self.options();
        let of = |list: &[JointObservation]| {
            triangulate_jointly(&viewpoints, observations.labels.len(), list, &options).ok()
        };
        if self.settings.views == Views::All {
            return of(&observations.list);
        }
        let offers = offers(frame, observations);
        let (pair, last) = self.choice.choose(&offers, self.settings.pair_gain)?;
        let by = |pair: [CameraId; 2]| {
            let is_in = |it: &JointObservation| pair.contains(&frame.views[it.viewpoint].id);
            // The others stay in the list, so that what is said of observations stays in its place, but see nothing.
            let list: Vec<JointObservation> = observations.list.iter().filter(|it| is_in(it)).copied().collect();
            of(&list).map(|joint| with_all_observations(joint, &observations.list, is_in))
        };
        let joint = by(pair)?;
        if let Some(old) = last.and_then(by) {
            let both = joint.points.iter().zip(&old.points);
            let both = both.filter_map(|(new, old)| Some((new.as_ref()?.position, old.as_ref()?.position)));
            let (new, old): (Vec<_>, Vec<_>) = both.unzip();
            self.blend.step(&new, &old);
        }
        Some(self.blended(joint))
    }

    /// Applies the rest of a step between two pairs to all points.
    fn blended(&self, mut joint: Joint) -> Joint {
        let known: Vec<Point3<f64>> = joint.points.iter().flatten().map(|it| it.position).collect();
        let motion = self.blend.motion(&middle(&known));
        for point in joint.points.iter_mut().flatten() {
            point.position = motion * point.position;
        }
        joint.middle = motion * joint.middle;
        joint
    }

    fn count_turns(&mut self, frame: &Frame, joint: &Joint) {
        for (view, camera) in frame.views.iter().zip(&joint.cameras) {
            let turn = view.viewpoint.camera.camera_from_world.rotation.angle_to(&camera.camera_from_world.rotation);
            let (sum, n) = self.tally.turns.entry(view.id).or_default();
            *sum += turn * turn;
            *n += 1;
        }
    }

    fn guide(
        &self,
        frame: &Frame,
        cameras: &[Camera],
        disputed: &BTreeSet<(CameraId, u32)>,
        seen_by: &BTreeMap<u32, usize>,
    ) -> MarkGuide {
        let of = |(view, camera): (&View, &Camera)| {
            let is_lone = |label: u32| seen_by.get(&label) == Some(&1);
            let lone = view.features.list.iter().filter_map(|it| Some((it.label?, it.centre)));
            let lone: BTreeMap<u32, Point2<f64>> = lone.filter(|it| is_lone(it.0)).collect();
            let guided = self.track_store.marks.iter().filter_map(|(label, mark)| {
                let (pixel, by_point) = camera.project_with_jacobian(&mark.position)?;
                let sigma = if mark.is_seen { self.settings.translation_floor_mm * 1e-3 } else { CARRIED_SIGMA };
                let covariance = by_point * by_point.transpose() * sigma.powi(2);
                let is_beside = lone.get(label).is_some_and(|seen| {
                    let off = seen - pixel;
                    covariance.cholesky().is_some_and(|it| it.solve(&off).dot(&off) > LONE_SIGMAS.powi(2))
                });
                let disputed = is_beside || disputed.contains(&(view.id, *label));
                Some(GuidedMark { label: *label, pixel, covariance, disputed })
            });
            let void = view.features.list.iter().filter_map(|it| {
                let label = it.label.filter(|label| self.track_store.retired.contains(label))?;
                Some(GuidedMark { label, pixel: it.centre, covariance: it.covariance, disputed: true })
            });
            (view.id, guided.chain(void).collect())
        };
        MarkGuide { time: frame.time, cameras: frame.views.iter().zip(cameras).map(of).collect() }
    }

    fn marks(&self, frame: &Frame, observations: &Observations, joint: Joint) -> Option<Marks> {
        let mut cameras = vec![CameraSet::default(); observations.labels.len()];
        for (observation, _) in observations.list.iter().zip(&joint.residuals).filter(|it| it.1.is_some()) {
            cameras[observation.point].insert(frame.views[observation.viewpoint].id);
        }
        let is_believed = |label: &u32| self.track_store.marks.get(label).is_some_and(|it| it.is_believed);
        let mark = |((label, point), cameras): ((&u32, &Option<JointPoint>), CameraSet)| {
            let point = point.filter(|_| is_believed(label))?;
            Some(Mark {
                label: *label,
                position: Point3::from(point.position - joint.middle),
                covariance: symmetric(&point.covariance),
                cameras,
                provenance: Provenance::Measured,
            })
        };
        let mut list: Vec<Mark> = observations.labels.iter().zip(&joint.points).zip(cameras).filter_map(mark).collect();
        if list.is_empty() {
            return None;
        }
        list.sort_by_key(|it| it.label);
        let middle = joint.middle.coords;
        let world_from_marks = Isometry3::translation(middle.x, middle.y, middle.z);
        Some(Marks { time: frame.time, world_from_marks, covariance: joint.covariance, list, fit: None })
    }
}

fn symmetric(covariance: &Matrix3<f64>) -> Matrix3<f64> {
    (covariance + covariance.transpose()) / 2.0
}

/// The solution from the observations that `is_in` selects, with the others in their places, unused.
fn with_all_observations(joint: Joint, all: &[JointObservation], is_in: impl Fn(&JointObservation) -> bool) -> Joint {
    let mut residuals = joint.residuals.into_iter();
    let mut disputed = joint.disputed.into_iter();
    let mut at_place = |it: &JointObservation| {
        if is_in(it) { (residuals.next().flatten(), disputed.next().unwrap_or(false)) } else { (None, false) }
    };
    let (residuals, disputed) = all.iter().map(&mut at_place).unzip();
    Joint { residuals, disputed, ..joint }
}

/// Quality of each pair of views.
fn offers(frame: &Frame, observations: &Observations) -> Vec<Offer> {
    let mut seen = vec![BTreeSet::new(); frame.views.len()];
    for it in &observations.list {
        seen[it.viewpoint].insert(it.point);
    }
    let axis = |view: &View| {
        let camera = &view.viewpoint.camera;
        let [width, height] = camera.image_size.map(f64::from);
        camera.ray(&Point2::new(width / 2.0, height / 2.0)).map(|it| it.direction)
    };
    let mut offers = Vec::new();
    for a in 0..frame.views.len() {
        for b in a + 1..frame.views.len() {
            let [one, other] = [a, b].map(|it| &frame.views[it]);
            if let (Some(first), Some(second)) = (axis(one), axis(other)) {
                let common = seen[a].intersection(&seen[b]).count();
                offers.push(Offer { pair: [one.id, other.id], common, angle: first.angle(&second) });
            }
        }
    }
    offers
}
