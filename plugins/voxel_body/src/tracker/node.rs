//! `voxel_body.tracker`: finds and tracks bodies of parts and joints in voxels [Mikić 2001].

use foveate::geometry::body::filter::MotionOptions;
use foveate::geometry::body::tracker::LevelOptions;
use foveate::geometry::body::{
    AcquisitionOptions, Joint, Labelled, Part, People, PeopleOptions, TrackerOptions, proportions::Proportions,
};
use foveate::prelude::*;
use nalgebra::{Matrix6, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::bounded::{Bounded, MOST_VOXELS, is_huge};
use super::message::{cameras_of, skeleton_of};
use super::smoother::Smoother;

ports! {
    pub(super) fn declared_ports;
    VOXELS: In<Voxels> = each("voxels");
    MARKS: In<Targets> = latest("marks").optional();
    SKELETONS: Out<Skeletons> = "skeletons";
    SMOOTHED: Out<Skeletons> = "smoothed";
    JOINTS: Out<Targets> = "joints";
    HEAD: Out<Targets> = "head";
    TORSO: Out<Targets> = "torso";
    HAND_LEFT: Out<Targets> = "hand_left";
    HAND_RIGHT: Out<Targets> = "hand_right";
}

figures! {
        "voxel_body.bodies": count, neither, "Bodies tracked, mean over all messages of voxels" => "bodies followed, on average";
    "voxel_body.found": count, neither, "Times that a body was found";
    "voxel_body.lost": count, low, "Times that a body was lost: voxels did not support its head or torso for lost_ms";
        "voxel_body.unmodelled": count, low, "Voxel pieces as large as a body without a fitted body, over all messages";
        "voxel_body.measured": share, high, "Joints measured from voxels at that time, over fourteen for each body and message" => "joints measured";
    "voxel_body.limbs": count, high, "Limbs in the model of a body, mean over bodies and messages";
        "voxel_body.unexplained": share, low, "Surface of a body's voxels that no part of it explains, mean over bodies and messages";
    "voxel_body.contradicted": share, low, "Share of the sent bodies without measured joints because views contradict each other around them; missing without any body";
    "voxel_body.parts_found_s": s, low, "From the first message with voxels as large as a body until one body had all ten parts; missing if none had";
}

/// A target worn on a body, such as a LED.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct MarkOn {
    /// Number of the target [–]
    pub target: u32,
    /// The part that it is on, such as `left-lower-arm` [–]
    pub part: String,
    /// Its place there, as shares of the part's half lengths along its x, y, z: [0, 0, −1] is the far end of a limb [–]
    pub at: [f64; 3],
    /// Standard deviation of that place [mm]
    #[serde(default = "default_mark_sigma")]
    #[schemars(range(min = 1.0, max = 500.0))]
    pub sigma_mm: f64,
}

/// A LED on a strap sits on the skin, a part's radius from its axis, and slips.
fn default_mark_sigma() -> f64 {
    30.0
}

/// Settings of [`BodyTrackerNode`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct BodyTrackerSettings {
    /// Expected stature; it adapts to each body [m]
    #[schemars(range(min = 0.5, max = 2.5))]
    pub stature_m: f64,
    /// Its standard deviation [%]
    #[schemars(range(min = 1.0, max = 40.0))]
    pub stature_spread_percent: f64,
    /// A head is accepted where at least this part of the directions from its centre leave the voxels within the crust between the smallest and the largest head [–]
    #[schemars(range(min = 0.3, max = 1.0))]
    pub crust_share: f64,
    /// Radius of the smallest and of the largest head, with hair [mm]
    pub crust_mm: [f64; 2],
    /// Smallest volume of a body [l]
    #[schemars(range(min = 1.0, max = 1000.0))]
    pub least_l: f64,
    /// Largest volume of a piece with bodies: a larger one is left out and reported. Searching a hull of a whole room would take minutes [l]
    #[schemars(range(min = 1.0, max = 1000000.0))]
    pub most_l: f64,
    /// Time without support by voxels after which a limb leaves the model; for a head or torso, the body is lost [ms]
    #[schemars(range(min = 0.0, max = 60000.0))]
    pub lost_ms: f64,
    /// Error of the hull beyond that of its voxels: few views, clothes, bodies that are no cylinders [mm]
    #[schemars(range(min = 1.0, max = 200.0))]
    pub sigma_mm: f64,
    /// Process noise of limbs: density of the angular acceleration of upper arms and thighs, twice as much for lower arms and calves [rad²/s³]
    #[schemars(range(min = 1.0, max = 1e5))]
    pub turning: f64,
    /// Most bodies that are tracked [–]
    #[schemars(range(min = 1, max = 64))]
    pub most: u32,
    /// Lag of a second output at `smoothed`, which also uses later measurements: for recordings; 0: none [ms]
    #[schemars(range(min = 0.0, max = 10000.0))]
    pub smooth_ms: f64,
    /// Targets at `marks` that are worn on parts of the body: they are used in the filter together with the voxels [–]
    pub marks: Vec<MarkOn>,
}

impl Default for BodyTrackerSettings {
    /// As the library has them: see `docs/bodies.md`. A heap of six people in hulls of four views holds less than 1500 l.
    fn default() -> Self {
        let people = PeopleOptions::default();
        let TrackerOptions { acquisition, fit, motion, levels, proportions, .. } = people.tracker;
        Self {
            stature_m: proportions.stature,
            stature_spread_percent: proportions.stature_spread * 100.0,
            crust_share: acquisition.crust_share,
            crust_mm: acquisition.crust.map(|it| it * 1e3),
            least_l: acquisition.least_volume * 1e3,
            most_l: 1500.0,
            lost_ms: levels.lost_s * 1e3,
            sigma_mm: fit.sigma * 1e3,
            turning: motion.upper_turning,
            most: people.most as u32,
            smooth_ms: 0.0,
            marks: Vec::new(),
        }
    }
}

impl BodyTrackerSettings {
    fn options(&self) -> PeopleOptions {
        let defaults = PeopleOptions::default();
        let TrackerOptions { acquisition, mut fit, motion, beginning, limits, levels, proportions } = defaults.tracker;
        fit.sigma = self.sigma_mm * 1e-3;
        let tracker = TrackerOptions {
            acquisition: AcquisitionOptions {
                crust: self.crust_mm.map(|it| it * 1e-3),
                crust_share: self.crust_share,
                least_volume: self.least_l * 1e-3,
                ..acquisition
            },
            fit,
            motion: MotionOptions { upper_turning: self.turning, lower_turning: 2.0 * self.turning, ..motion },
            beginning,
            limits,
            levels: LevelOptions { lost_s: self.lost_ms * 1e-3, ..levels },
            proportions: Proportions {
                stature: self.stature_m,
                stature_spread: self.stature_spread_percent * 1e-2,
                ..proportions
            },
        };
        PeopleOptions { tracker, most: self.most as usize, ..defaults }
    }
}

/// Voxels in, bodies out; targets of heads and hands, for finer scales to anchor to, carry the body's identity.
pub struct BodyTrackerNode {
    people: People,
    marks: Vec<(u32, Part, Vector3<f64>, f64)>,
    smoother: Option<Smoother>,
    last: Option<Time>,
    first_voxels: Option<Time>,
    complete: Option<Time>,
    n_messages: u64,
    n_bodies: u64,
    n_measured: u64,
    n_limbs: u64,
    n_contradicted: u64,
    /// The same where too few views carved them.
    n_few_views: u64,
    n_unmodelled: u64,
    /// Messages without a body but with a piece that is nearly large enough, and the volume of the largest [m³].
    n_small: u64,
    largest_small: f64,
    unexplained: f64,
    reasons: Vec<(String, u64)>,
    most: f64,
    bounded: Bounded,
    n_coarse: u64,
}

impl Node for BodyTrackerNode {
    const TYPE: &'static str = "voxel_body.tracker";
    const ROLE: Role = Role::ModelFilter;
    const SUMMARY: &'static str = "Fits bodies of ten parts to voxels and tracks them";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = BodyTrackerSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: BodyTrackerSettings, setup: &Setup) -> Result<Self, ConfigError> {
        let [smallest, largest] = settings.crust_mm;
        if !(smallest > 0.0 && largest > smallest && largest < 1000.0) {
            let message =
                format!("found {smallest} and {largest}, expected a smaller and a larger radius between 0 and 1000 mm");
            return Err(ConfigError::at("crust_mm", message));
        }
        if !settings.marks.is_empty() && !setup.is_connected(&MARKS) {
            return Err(ConfigError::at("marks", "found marks, expected their targets at the input `marks`"));
        }
        if settings.most_l < settings.least_l {
            let message = format!("found {}, expected `least_l` or more: {}", settings.most_l, settings.least_l);
            return Err(ConfigError::at("most_l", message));
        }
        let mut marks = Vec::new();
        for mark in &settings.marks {
            let Some(part) = Part::ALL.into_iter().find(|it| it.name() == mark.part) else {
                let names = Part::ALL.map(|it| format!("`{}`", it.name())).join(", ");
                return Err(ConfigError::at(
                    "marks",
                    format!("found the part `{}`, expected one of {names}", mark.part),
                ));
            };
            marks.push((mark.target, part, Vector3::from(mark.at), mark.sigma_mm * 1e-3));
        }
        Ok(Self {
            people: People::new(settings.options()),
            marks,
            smoother: (settings.smooth_ms > 0.0).then(|| Smoother::new(Interval::from_s(settings.smooth_ms * 1e-3))),
            last: None,
            first_voxels: None,
            complete: None,
            n_messages: 0,
            n_bodies: 0,
            n_measured: 0,
            n_limbs: 0,
            n_contradicted: 0,
            n_few_views: 0,
            n_unmodelled: 0,
            n_small: 0,
            largest_small: 0.0,
            unexplained: 0.0,
            reasons: Vec::new(),
            most: settings.most_l * 1e-3,
            bounded: Bounded::default(),
            n_coarse: 0,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(message) = io.take(&VOXELS) else { return Ok(()) };
        let voxels = &*message.value;
        let time = voxels.time;
        let dt_s = self.last.map_or(0.0, |it| (time - it).as_s());
        if dt_s < 0.0 {
            io.gap(&SKELETONS, time, "voxels of an earlier time came later");
            return Ok(());
        }
        self.last = Some(time);
        self.bounded.take(voxels, self.most);
        self.n_coarse += u64::from(self.bounded.merged() > 1);
        let cubes = self.bounded.cubes(voxels);
        let marks = io.latest(&MARKS).filter(|it| (time - it.value.time).as_s().abs() < 0.1);
        let seen: Vec<Labelled> = marks.map_or(Vec::new(), |it| self.labelled(it.value, time));
        // Marks of one person: of several bodies the nearest wears them.
        let unmodelled = self.people.step(&cubes, dt_s, |_, tracker| {
            let near = |it: &&Labelled| (tracker.filter().body.place(it.part, &it.factors) - it.position).norm() < 0.5;
            seen.iter().filter(near).cloned().collect()
        });
        let contested: Vec<_> = voxels.contested.iter().map(|it| (it.centroid, it.volume)).collect();
        self.people.set_contested(&contested);
        let cameras = cameras_of(voxels);
        // Voxels of other programs do not say by whom they were seen.
        if !voxels.views.is_empty() {
            self.people.set_n_views(cameras.len());
        }
        let list: Vec<Skeleton> = self.people.list().iter().map(|it| skeleton_of(it, &cameras)).collect();
        self.count(&list, voxels, time);
        let unmodelled: Vec<Unmodelled> = unmodelled
            .into_iter()
            .map(|it| {
                let component = voxels
                    .components
                    .iter()
                    .min_by(|a, b| (a.centroid - it.centroid).norm().total_cmp(&(b.centroid - it.centroid).norm()));
                let reason = it.reason.to_string();
                Unmodelled {
                    centroid: it.centroid,
                    volume: it.volume,
                    target: component.and_then(|it| it.target),
                    reason,
                }
            })
            .collect();
        let huge = voxels.components.iter().filter(|it| is_huge(it, voxels.size, self.most)).map(|it| Unmodelled {
            centroid: it.centroid,
            volume: f64::from(it.n_voxels) * voxels.size.powi(3),
            target: it.target,
            reason: format!(
                "more than a heap of bodies holds: {:.0} l, expected `most_l` = {:.0} l at most",
                1e3 * f64::from(it.n_voxels) * voxels.size.powi(3),
                1e3 * self.most
            ),
        });
        let unmodelled: Vec<Unmodelled> = unmodelled.into_iter().chain(huge).collect();
        self.n_unmodelled += unmodelled.len() as u64;
        for it in &unmodelled {
            // Without the numbers in it.
            let kind = it.reason.split([':', ',']).next().unwrap_or_default().to_owned();
            match self.reasons.iter().position(|(known, _)| *known == kind) {
                Some(place) => self.reasons[place].1 += 1,
                None if self.reasons.len() < 12 => self.reasons.push((kind, 1)),
                None => {}
            }
        }
        let hand = Vector3::new(0.0, 0.0, HAND);
        io.emit(&HEAD, message.stamp, self.anchors(time, &cameras, Part::Head, &Vector3::zeros()));
        io.emit(&TORSO, message.stamp, self.anchors(time, &cameras, Part::Torso, &Vector3::zeros()));
        io.emit(&HAND_LEFT, message.stamp, self.anchors(time, &cameras, Part::LeftLowerArm, &hand));
        io.emit(&HAND_RIGHT, message.stamp, self.anchors(time, &cameras, Part::RightLowerArm, &hand));
        if let Some(smoother) = &mut self.smoother {
            for (stamp, smoothed) in smoother.push(message.stamp, time, self.people.list(), &cameras) {
                io.emit(&SMOOTHED, stamp, smoothed);
            }
        }
        io.emit(&JOINTS, message.stamp, joints_as_targets(&list, time));
        io.emit(&SKELETONS, message.stamp, Skeletons { time, list, unmodelled });
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let per = |sum: f64, n: u64| if n == 0 { f64::NAN } else { sum / n as f64 };
        let counts = self.people.counts();
        report.figure("voxel_body.bodies", per(self.n_bodies as f64, self.n_messages));
        report.figure("voxel_body.found", counts.found as f64);
        report.figure("voxel_body.lost", counts.lost as f64);
        report.figure("voxel_body.unmodelled", self.n_unmodelled as f64);
        if self.n_bodies > 0 {
            report.figure(
                "voxel_body.measured",
                self.n_measured as f64 / (self.n_bodies as f64 * Joint::ALL.len() as f64),
            );
            report.figure("voxel_body.limbs", per(self.n_limbs as f64, self.n_bodies));
            report.figure("voxel_body.unexplained", per(self.unexplained, self.n_bodies));
        }
        if self.n_contradicted > 0 {
            report.figure("voxel_body.contradicted", per(self.n_contradicted as f64, self.n_bodies));
            report.remark(format!(
                "None of a body is called measured at {} of {} times: silhouettes contradict each other around it: many show body where others show none, or bodies have holes. Check poses, pictures of another camera or time, \
                 and silhouettes that lack pieces in the overlays.",
                self.n_contradicted, self.n_bodies
            ));
        }
        if let Some((first, complete)) = self.first_voxels.zip(self.complete) {
            report.figure("voxel_body.parts_found_s", (complete - first).as_s());
        }
        if self.n_coarse > 0 {
            report.remark(format!(
                "In {} of {} messages there were more than {MOST_VOXELS} voxels: bodies were searched in voxels twice as large or larger (`voxel_mm` of the carver).",
                self.n_coarse, self.n_messages
            ));
        }
        if self.n_few_views > 0 {
            report.remark(format!(
                "None of a body is called measured at {} of {} times: fewer than 3 views carved it, expected 4 or more, from all around. The intersection of two views need not look like a person.",
                self.n_few_views, self.n_bodies
            ));
        }
        if 2 * self.n_small > self.n_messages {
            report.remark(format!(
                "In {} of {} messages there was no body, and the largest piece had at most {:.0} l, expected `least_l` = {:.0} l or more: for a child set a smaller one, and its `stature_m`.",
                self.n_small,
                self.n_messages,
                1e3 * self.largest_small,
                1e3 * self.people.options().tracker.acquisition.least_volume
            ));
        }
        for (reason, count) in &self.reasons {
            report.remark(format!("No body was fitted to voxels large enough for one, {count} times: {reason}."));
        }
        Ok(())
    }
}

/// A piece smaller than a body by less than this is reported where no body is found [–].
const NEARLY_LARGE: f64 = 0.3;

/// The middle of the hand on the lower arm: between the wrist at 0.664 of it from the elbow and its end [–].
const HAND: f64 = 1.0 - 2.0 * 0.83;

impl BodyTrackerNode {
    fn labelled(&self, targets: &Targets, time: Time) -> Vec<Labelled> {
        let one = |target: &Target| {
            let (_, part, factors, sigma) = *self.marks.iter().find(|it| it.0 == target.id.0)?;
            let position = target.position_after(time - targets.time);
            let own = target.position_sigma();
            let is_measured = target.provenance == Provenance::Measured;
            is_measured.then(|| Labelled { part, factors, position, sigma: sigma.hypot(own) })
        };
        targets.list.iter().filter_map(one).collect()
    }

    fn count(&mut self, list: &[Skeleton], voxels: &Voxels, time: Time) {
        self.n_messages += 1;
        self.n_bodies += list.len() as u64;
        let bodies = || self.people.list().iter().map(|it| &it.tracker);
        self.n_contradicted += bodies().filter(|it| it.is_contradicted()).count() as u64;
        self.n_few_views += bodies().filter(|it| it.is_of_few_views()).count() as u64;
        let least = self.people.options().tracker.acquisition.least_volume;
        if self.first_voxels.is_none() && voxels.volume() >= least {
            self.first_voxels = Some(time);
        }
        let largest =
            voxels.components.iter().map(|it| f64::from(it.n_voxels) * voxels.size.powi(3)).fold(0.0, f64::max);
        if list.is_empty() && (NEARLY_LARGE * least..least).contains(&largest) {
            self.n_small += 1;
            self.largest_small = self.largest_small.max(largest);
        }
        for body in list {
            let measured = body.joints.iter().filter(|it| it.provenance == Provenance::Measured).count();
            self.n_measured += measured as u64;
            self.n_limbs += body.limbs.iter().filter(|it| **it != LimbDetail::Absent).count() as u64;
            self.unexplained += body.unexplained;
            if self.complete.is_none() && body.parts.len() == Part::ALL.len() {
                self.complete = Some(time);
            }
        }
    }

    /// A place on each body as targets.
    fn anchors(&self, time: Time, cameras: &CameraSet, part: Part, factors: &Vector3<f64>) -> Targets {
        let is_there = |it: &&foveate::geometry::body::TrackedBody| it.tracker.filter().layout().has(part);
        let target = |it: &foveate::geometry::body::TrackedBody| {
            let (position, velocity, covariance) = it.tracker.filter().place(part, factors);
            let is_measured = it.is_seen && it.tracker.shows(part);
            let provenance = if is_measured { Provenance::Measured } else { Provenance::Predicted };
            let cameras = if is_measured { cameras.clone() } else { CameraSet::default() };
            Target { id: TargetId(it.id), position, velocity, covariance, cameras, provenance }
        };
        Targets { time, list: self.people.list().iter().filter(is_there).map(target).collect() }
    }
}

/// Numbers of targets for one body's joints: body 3, joint 5 is target 305.
const TARGETS_A_BODY: u32 = 100;

fn joints_as_targets(list: &[Skeleton], time: Time) -> Targets {
    let mut targets = Targets { time, list: Vec::new() };
    for body in list {
        for joint in &body.joints {
            let is_measured = joint.provenance == Provenance::Measured;
            let covariance: Matrix6<f64> = joint.covariance;
            targets.list.push(Target {
                id: TargetId(body.id * TARGETS_A_BODY + u32::from(joint.joint)),
                position: joint.position,
                velocity: joint.velocity,
                covariance,
                cameras: if is_measured { body.cameras.clone() } else { CameraSet::default() },
                provenance: joint.provenance,
            });
        }
    }
    targets
}
