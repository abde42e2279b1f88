//! Tracker of one body, from acquisition through all frames, with the parts that the data support.
//!
//! The model has levels [Mikić 2001 §6]: at least head and trunk; each limb absent, as one straight piece, or as two
//! parts. A limb is added when its template is found in free voxels; it is split when its bend is larger than its
//! uncertainty, and joined again when it has been straight for a while; it is removed when voxels do not support it.
//! Rows and columns of the filter follow.

use nalgebra::{Matrix6, Point3, Vector3};

use super::acquire::AcquisitionOptions;
use super::facing::{Facing, SURE};
use super::field::VoxelField;
use super::filter::{Beginning, BodyFilter, MotionOptions, Step};
use super::fit::{Fit, FitOptions, Labelled, Skins, Support, add_hip_limit, add_labelled, add_limits, add_size_limits};
use super::layout::Presence;
use super::parts::{Joint, Limb, N_PARTS, Part};
use super::proportions::{Limits, Proportions, joint_sigma};

mod beginning;
mod contradiction;
mod elsewhere;
mod levels;
mod rest;
mod room;

use beginning::standing;
use contradiction::Contradiction;

/// Options of a body tracker.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TrackerOptions {
    /// Acquisition.
    pub acquisition: AcquisitionOptions,
    /// Comparison of voxels with the body.
    pub fit: FitOptions,
    /// Motion model.
    pub motion: MotionOptions,
    /// Standard deviations of a new state.
    pub beginning: Beginning,
    /// Limits of joints.
    pub limits: Limits,
    /// Proportions of people.
    pub proportions: Proportions,
    /// When parts are added and removed.
    pub levels: LevelOptions,
}

/// When parts are added and removed, and when they count as measured.
#[derive(Debug, Clone, PartialEq)]
pub struct LevelOptions {
    /// Least share of a part's axis inside the voxels, for support [–].
    pub least_inside: f64,
    /// Least share of a part's skin that is present, for support [–].
    pub least_covered: f64,
    /// Least share of a part's skin that is present, for it to count as measured: with less it shares one volume with
    /// others, and may be anywhere in it [–].
    pub measured_covered: f64,
    /// The same for both parts of a leg, which hide less of each other than arms hide of a trunk [–].
    pub measured_leg: f64,
    /// A limb does not count as measured where the voxels around one of its parts hold more than so many times its
    /// volume: it may be anywhere in them [–].
    pub most_room: f64,
    /// An arm does not count as measured where voxels go on beyond its hand for longer: it lies in an object, usually a chair's back [m].
    pub most_beyond: f64,
    /// A body does not count as measured where views disagree on more than this share of its voxels, or on so much at its head [–, m³].
    pub most_contested: [f64; 2],
    /// A part, and a body, do not count as measured where a larger share of the voxels inside is missing [–].
    pub most_lacking: [f64; 2],
    /// A limb without support for so long is removed from the model; a trunk without support ends the track [s].
    pub lost_s: f64,
    /// A limb is split where its bend exceeds so many standard deviations [–].
    pub split_sigmas: f64,
    /// A limb that was straight for so long is joined again [s].
    pub join_s: f64,
}

impl Default for LevelOptions {
    /// Half a second is the longest that a limb of a walking person is hidden behind the body, and what counts as lost in the figures. Of parts that lie where they should, seven tenths of the skin
    /// and more are there, arms that hang beside the trunk in four views included. Of 1238 measured joints of drawn people in hulls of four views 85 were in another place, and
    /// are 21 of 1062 so (eight views: none of 1256).
    fn default() -> Self {
        Self {
            least_inside: 0.5,
            least_covered: 0.35,
            measured_covered: 0.5,
            measured_leg: 0.6,
            most_room: 1.8,
            most_beyond: 0.02,
            most_contested: [0.08, 0.0025],
            most_lacking: [0.3, 0.35],
            lost_s: 0.5,
            split_sigmas: 3.0,
            join_s: 3.0,
        }
    }
}

/// Level of a limb in the model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum LimbLevel {
    /// Not in the model.
    Absent,
    /// One straight piece: its middle joint follows from proportions.
    Straight,
    /// Two parts.
    Bent,
}

/// Provenance of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointSource {
    /// Its part is visible in the voxels.
    Measured,
    /// Its part is extrapolated.
    Predicted,
    /// Its position follows from proportions.
    Filled,
}

/// An estimated joint.
#[derive(Debug, Clone, PartialEq)]
pub struct JointEstimate {
    /// Which joint.
    pub joint: Joint,
    /// Position [m].
    pub position: Point3<f64>,
    /// Velocity [m/s].
    pub velocity: Vector3<f64>,
    /// Covariance of (position, velocity) [m², m²/s, m²/s²].
    pub covariance: Matrix6<f64>,
    /// Provenance.
    pub source: JointSource,
}

#[derive(Debug, Clone, PartialEq)]
struct LimbTrack {
    level: LimbLevel,
    weak_s: f64,
    straight_s: f64,
}

/// The track of a body.
#[derive(Debug, Clone)]
pub struct BodyTracker {
    options: TrackerOptions,
    /// Proportions of a child, in place of those of the options.
    child: Option<Proportions>,
    filter: BodyFilter,
    limbs: [LimbTrack; 4],
    support: Support,
    facing: Facing,
    trunk_weak_s: f64,
    is_lost: bool,
    frame: u64,
    /// The frame from which on it is acquired again, and how long to wait when no better state is found.
    next_look: u64,
    wait: u64,
    /// Of each limb, what the voxels around its parts hold over their volume [–].
    room: [f64; 4],
    /// How far voxels go on beyond the hand of each arm [m].
    beyond: [f64; 2],
    /// Of each limb, whether it lies at another body that touches.
    shared: [bool; 4],
    /// How views contradict each other around it.
    contradiction: Contradiction,
    /// Of what a frame says of sizes, what is taken [–].
    share: f64,
    /// Edge of the last voxels [m].
    voxel: f64,
    last: Option<Step>,
}

/// Frames between two looks whether straight limbs bend, and between two searches for absent ones: each takes as long as a frame.
const LOOK_EVERY: u64 = 3;

/// Limbs reach for what no part has where that is a larger share of the skin [–]: a calf is a tenth of it.
const REST_FROM: f64 = 0.03;

/// A body that leaves this share of the skin to no part is acquired again, once in so many frames; the new body takes its place if it leaves so much less.
const ANEW_FROM: f64 = 0.12;
const ANEW_EVERY: u64 = 10;
const ANEW_GAIN: f64 = 0.06;
/// Of a head that is one, so much of the skin is present, and so much of all skin may belong to no part [–]; another body is that much more likely [–, logarithm].
const HEAD_SEEN: f64 = 0.8;
const HEAD_REST: f64 = 0.03;
const HEAD_BETTER: f64 = 10.0;
/// Middles of trunks farther apart are two people's [m]: a head that is taken for a chest, or a chest for a belly, moves it by half as much.
const ONE_PERSON: f64 = 0.6;
/// The same share and gain for who was taken for a child.
const CHILD_ANEW: [f64; 2] = [0.04, 0.02];

/// Of the head's skin, what may lack, what the limbs' sizes may be less likely, and what may lack of all parts' skin, of which limbs that are not there have none, for a doubt of 1 each [–]. Parts of chairs
/// have half of their skin and no arms as a rule, those of people in hulls of four views and more 0.7 and more.
const HEAD_LACKS: f64 = 0.3;
const LIMBS_UNUSUAL: f64 = 30.0;
const SKIN_LACKS: f64 = 0.58;
/// The same for the skin that a lying body leaves unexplained [–], to the fourth power: table tops leave 0.14 and more, people who lie or stoop 0.11 at most.
const LYING_REST: f64 = 0.19;

/// A trunk as upright as this stands or stoops by up to 50°: cosine of its angle to the vertical [–].
pub(super) const UPRIGHT: f64 = 0.64;

/// Errors of hulls last so long [s]: chosen on people that are not in the figures, among 0.1 to 0.5.
const POSE_S: f64 = 0.3;

/// How far a joint that voxels do not show lies from where its limb goes on, one standard deviation along an axis [m]: most lie there, in one volume with others, some elsewhere in it. Of simulated people that are not
/// in the figures.
fn hidden_sigma(joint: Joint) -> f64 {
    match joint {
        Joint::LeftElbow | Joint::RightElbow | Joint::LeftKnee | Joint::RightKnee => 0.06,
        Joint::LeftWrist | Joint::RightWrist | Joint::LeftAnkle | Joint::RightAnkle => 0.10,
        _ => 0.03,
    }
}

/// Hips of who sits, and of whose legs do not show, lie so much farther from where the model has them, one standard deviation along an axis [m]: flesh and seat go below them, and a chair's back is beside the trunk. Of 13 seated people of another renderer, whose
/// hips were 54 to 96 mm off.
const VAGUE_HIP_SIGMA: f64 = 0.04;

/// Who is lower than this part of what is expected may sit [–]: heads of who sits are at 0.8 of the stature at most.
const LEAST_STANDING: f64 = 0.9;

/// Joints are off by this part of a voxel's edge besides [–]: of people that are not in the figures.
const VOXEL_SHARE: f64 = 0.25;

impl BodyTracker {
    /// Advances to the next frame, `dt_s` later [s].
    pub fn step(&mut self, field: &VoxelField, dt_s: f64, labelled: &[Labelled]) {
        self.frame += 1;
        self.share = (dt_s / POSE_S).min(1.0);
        let transition = self.filter.predict(dt_s, &self.options.motion);
        let predicted = self.filter.clone();
        self.update(field, labelled, self.options.fit.iterations);
        self.uncross(field, labelled);
        self.unfold(field, labelled, &predicted);
        self.judge_limbs(dt_s);
        self.search_weak(field, labelled);
        if self.frame.is_multiple_of(LOOK_EVERY) {
            self.split(field, labelled);
            self.reconsider(field, labelled);
            if self.limbs.iter().any(|it| it.level == LimbLevel::Absent) && self.search_absent(field) {
                self.update(field, labelled, self.options.fit.iterations);
            }
        }
        self.judge_trunk(field, dt_s);
        self.judge_facing(field, dt_s);
        if self.look_anew(field) {
            return;
        }
        if self.frame.is_multiple_of(ANEW_EVERY) && self.support.unexplained > REST_FROM {
            self.reach_for_rest(field, labelled, 1);
        }
        self.look_around(field);
        self.look_inside(field, dt_s);
        let same = predicted.layout() == self.filter.layout();
        self.last = Some(Step { predicted, transition: transition.filter(|_| same), filtered: self.filter.clone() });
    }

    /// A fit that began wrong explains little and hardly finds out by itself: a body found in these voxels alone, without what went before, takes its place if it explains more.
    ///
    /// Begun in silhouettes that lost the head, it took the chest for one: such a head lacks a fifth of its skin, and lies below a head that belongs to no body.
    fn look_anew(&mut self, field: &VoxelField) -> bool {
        let left = self.support.unexplained;
        // A child may be an adult whose head the silhouettes had lost.
        let [from, gain] = if self.child.is_some() { CHILD_ANEW } else { [ANEW_FROM, ANEW_GAIN] };
        let is_doubtful = self.has_doubtful_head();
        if !(left >= from || is_doubtful) || self.frame < self.next_look {
            return false;
        }
        match Self::acquire(field, &self.options) {
            Ok(anew)
                if self.is_same(&anew)
                    && (anew.support.unexplained < left - gain
                        || is_doubtful && !anew.has_doubtful_head() && anew.cost() + HEAD_BETTER < self.cost()) =>
            {
                *self = Self { frame: self.frame, ..anew };
                true
            }
            _ => {
                // In voxels that are no better nothing better is found soon.
                self.wait = (2 * self.wait).min(if left >= from { ANEW_EVERY } else { 3 * ANEW_EVERY });
                self.next_look = self.frame + self.wait;
                false
            }
        }
    }

    fn has_doubtful_head(&self) -> bool {
        self.support.covered[Part::Head.index()] < HEAD_SEEN || self.support.unexplained > HEAD_REST
    }

    /// Whether the newly acquired body is the same person, not another one beside.
    fn is_same(&self, found: &Self) -> bool {
        (found.filter.body.torso - self.filter.body.torso).norm() < ONE_PERSON
    }

    /// Advances by a frame without voxels: the state is extrapolated.
    pub fn coast(&mut self, dt_s: f64) {
        let transition = self.filter.predict(dt_s, &self.options.motion);
        self.support = Support::default();
        self.judge_limbs(dt_s);
        self.trunk_weak_s += dt_s;
        self.is_lost |= self.trunk_weak_s > self.options.levels.lost_s;
        let filtered = self.filter.clone();
        self.last = Some(Step { predicted: filtered.clone(), transition, filtered });
    }

    fn update(&mut self, field: &VoxelField, labelled: &[Labelled], iterations: usize) {
        let options = &self.options;
        let mut fit = Fit::new(field, &options.fit, Some(&self.filter));
        let layout = *self.filter.layout();
        let known = self.facing();
        let people = self.child.as_ref().unwrap_or(&options.proportions);
        let (stature, hides_legs) = (self.standing_stature(field, people), self.hides_legs());
        self.filter.update(iterations, self.share, |body, normal| {
            fit.measure(body, normal, &layout);
            add_limits(body, normal, &layout, &options.limits, known);
            add_size_limits(body, normal, &layout, people);
            if let Some(stature) = stature {
                add_hip_limit(body, normal, &layout, hides_legs.then_some(stature));
            }
            add_labelled(body, normal, &layout, labelled);
        });
        self.support = fit.support;
        self.voxel = field.size();
        self.beyond = self.beyond_hands(field);
    }

    /// Stature of a standing person [m]; `None` where the body is much lower than expected, as on a chair.
    fn standing_stature(&self, field: &VoxelField, people: &Proportions) -> Option<f64> {
        let top = self.filter.body.centre(Part::Head).z + self.filter.body.size(Part::Head).z;
        let stature = standing(field, top, self.upright(), people)?.stature;
        (stature > LEAST_STANDING * people.stature).then_some(stature)
    }

    /// Whether neither leg shows; of the first frame it is not known yet.
    fn hides_legs(&self) -> bool {
        let is_hidden = |it: Limb| self.level(it) == LimbLevel::Absent || !self.is_sure(it);
        self.frame > 0 && is_hidden(Limb::LeftLeg) && is_hidden(Limb::RightLeg)
    }

    /// How unlike a person this is, with limbs whose sizes are so unusual [–].
    fn doubt(&self, unusual: f64) -> f64 {
        let lacks = (1.0 - self.support.covered[Part::Head.index()]).max(0.0);
        let skin = self.support.covered.iter().map(|it| it.min(1.0)).sum::<f64>() / N_PARTS as f64;
        (lacks / HEAD_LACKS).powi(2)
            + (unusual / LIMBS_UNUSUAL).powi(2)
            + ((1.0 - skin) / SKIN_LACKS).powi(2)
            + if self.upright() < UPRIGHT { (self.support.unexplained / LYING_REST).powi(4) } else { 0.0 }
    }

    /// Cosine between the torso and the vertical [–].
    pub fn upright(&self) -> f64 {
        (self.filter.body.turn(Part::Torso) * Vector3::z()).z
    }

    /// How far the limbs' sizes are from those of people, in standard deviations, root mean square [–].
    fn sigmas_of_limbs(&self) -> f64 {
        let n = Limb::ALL.into_iter().filter(|it| self.level(*it) != LimbLevel::Absent).count();
        // Two numbers of two parts each.
        (2.0 * self.unusual_limbs() / (4 * n.max(1)) as f64).sqrt()
    }

    fn is_supported(&self, part: Part) -> bool {
        let levels = &self.options.levels;
        self.support.inside[part.index()] >= levels.least_inside
            && self.support.covered[part.index()] >= levels.least_covered
    }

    fn judge_trunk(&mut self, field: &VoxelField, dt_s: f64) {
        let inside = |part: Part| self.support.inside[part.index()];
        if inside(Part::Torso) >= 0.6 && inside(Part::Head) >= 0.6 {
            self.trunk_weak_s = 0.0;
            return;
        }
        self.trunk_weak_s += dt_s;
        self.is_lost |= self.trunk_weak_s > self.options.levels.lost_s;
        // The same body begins again, as large as it is known to be.
        let mut options = self.options.clone();
        options.proportions.stature = 2.0 * self.filter.body.size(Part::Torso).z / 0.34;
        if let Ok(found) = Self::acquire(field, &options)
            && self.is_same(&found)
        {
            let kept = self.options.clone();
            *self = Self { options: kept, frame: self.frame, ..found };
        }
    }

    fn judge_facing(&mut self, field: &VoxelField, dt_s: f64) {
        self.hear_facing(field, dt_s);
        if self.facing.is_behind(false) {
            self.turn_about();
        }
    }

    fn hear_facing(&mut self, field: &VoxelField, dt_s: f64) {
        let tell = |limb: Limb| limb.parts().into_iter().all(|it| self.is_supported(it)) && self.is_sure(limb);
        let mut facing = self.facing;
        facing.hear(&self.filter, field, tell, dt_s);
        self.facing = facing;
    }

    fn turn_about(&mut self) {
        self.filter.face_about();
        self.facing.turn_about();
        self.limbs.swap(0, 1);
        self.limbs.swap(2, 3);
        self.room.swap(0, 1);
        self.room.swap(2, 3);
        self.beyond.swap(0, 1);
        self.shared.swap(0, 1);
        self.shared.swap(2, 3);
        self.contradiction.turn_about();
        let support = self.support;
        for part in Part::ALL {
            self.support.covered[part.index()] = support.covered[part.mirrored().index()];
            self.support.inside[part.index()] = support.inside[part.mirrored().index()];
        }
    }

    /// Whether head or trunk have had no support for too long.
    pub fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// Sets which limbs lie at another body that touches: these do not count as measured.
    pub fn share_limbs(&mut self, shared: [bool; 4]) {
        self.shared = shared;
    }

    /// The skins of its parts, for distance queries.
    pub fn skins(&self) -> Skins {
        Skins::of(&self.filter.body, self.filter.layout())
    }

    /// The filter.
    pub fn filter(&self) -> &BodyFilter {
        &self.filter
    }

    /// The tracker with another estimate of the same parts, such as a smoothed one.
    pub fn with_filter(&self, filter: BodyFilter) -> Self {
        Self { filter, ..self.clone() }
    }

    /// The last step, for the smoother.
    pub fn last_step(&self) -> Option<&Step> {
        self.last.as_ref()
    }

    /// Support of the body by the last voxels.
    pub fn support(&self) -> &Support {
        &self.support
    }

    /// Level of a limb.
    pub fn level(&self, limb: Limb) -> LimbLevel {
        self.limbs[limb.index()].level
    }

    /// Certainty of left and right: 0 for a guess, 1 for certain.
    pub fn facing(&self) -> f64 {
        (self.facing.log_odds() / SURE).clamp(0.0, 1.0)
    }

    /// Presence of each part in the model.
    pub fn presence(&self) -> [Presence; N_PARTS] {
        Part::ALL.map(|it| self.filter.layout().presence(it))
    }

    /// Whether the last voxels show a part.
    pub fn shows(&self, part: Part) -> bool {
        self.filter.layout().has(part)
            && !self.is_contradicted()
            && !self.is_of_few_views()
            && self.contradiction.lacks_of(part) <= self.options.levels.most_lacking[0]
            && self.is_supported(part)
            && self.support.covered[part.index()] >= self.options.levels.measured_covered
            && Limb::ALL.into_iter().filter(|it| it.parts().contains(&part)).all(|it| self.is_sure(it))
    }

    /// Whether a limb that the voxels support lies there and nowhere else.
    fn is_sure(&self, limb: Limb) -> bool {
        let LevelOptions { measured_leg, most_room, .. } = self.options.levels;
        let covered = limb.parts().map(|it| self.support.covered[it.index()]);
        let is_held = self.room[limb.index()] <= most_room;
        !self.is_nobodys(limb)
            && !self.shared[limb.index()]
            && is_held
            && !self.is_in_thing(limb)
            && self.bend(limb) <= self.options.limits.bend + self.options.limits.sigma
            && (!limb.is_leg() || covered.iter().all(|it| *it >= measured_leg))
    }

    /// Whether a joint is the hip of a thigh that is turned from the trunk, as of who sits, or does not show, as in a skirt.
    fn is_vague_hip(&self, joint: Joint) -> bool {
        let thigh = match joint {
            Joint::LeftHip => Part::LeftThigh,
            Joint::RightHip => Part::RightThigh,
            _ => return false,
        };
        let limb = if joint == Joint::LeftHip { Limb::LeftLeg } else { Limb::RightLeg };
        self.filter.layout().has(thigh) && (room::is_seated(&self.filter.body, thigh) || !self.is_sure(limb))
    }

    /// Whether an arm lies in a thing: in something that goes on beyond its hand, or where the back of a chair is.
    fn is_in_thing(&self, limb: Limb) -> bool {
        let goes_on = self.beyond.get(limb.index()).is_some_and(|it| *it > self.options.levels.most_beyond);
        goes_on || self.is_behind_back(limb)
    }

    /// All joints of the model. Their covariances include the model error ([`joint_sigma`]): the filter knows only the positions of its own parts.
    pub fn joints(&self) -> Vec<JointEstimate> {
        let mut list = joints(&self.filter, |joint| {
            let (part, _) = joint.place();
            let tied = joint.limb().is_some_and(|it| self.level(it) == LimbLevel::Straight)
                && matches!(joint, Joint::LeftElbow | Joint::RightElbow | Joint::LeftKnee | Joint::RightKnee);
            // Where an upper arm does not show, what lies farther down may be another body's forearm, or a chair's.
            let hangs_on_shown = part.parent().filter(|it| it.is_limb()).is_none_or(|it| self.shows(it));
            if !(self.shows(part) && hangs_on_shown) {
                JointSource::Predicted
            } else if tied {
                JointSource::Filled
            } else {
                JointSource::Measured
            }
        });
        let contradicted = self.contradiction.sigma();
        for it in &mut list {
            let hidden = if it.source == JointSource::Predicted { hidden_sigma(it.joint) } else { 0.0 };
            let seated = if self.is_vague_hip(it.joint) { VAGUE_HIP_SIGMA } else { 0.0 };
            let own = joint_sigma(it.joint).powi(2) + seated.powi(2);
            let variance = own + (VOXEL_SHARE * self.voxel).powi(2) + hidden.powi(2) + contradicted.powi(2);
            (0..3).for_each(|axis| it.covariance[(axis, axis)] += variance);
        }
        list
    }
}

/// The joints of a filter's parts, each with its provenance.
pub fn joints(filter: &BodyFilter, source: impl Fn(Joint) -> JointSource) -> Vec<JointEstimate> {
    let layout = filter.layout();
    let is_there = |it: &Joint| layout.has(it.place().0) && it.limb().is_none_or(|limb| layout.has(limb.parts()[0]));
    let one = |joint: Joint| {
        let (position, velocity, covariance) = filter.joint(joint);
        JointEstimate { joint, position, velocity, covariance, source: source(joint) }
    };
    Joint::ALL.into_iter().filter(is_there).map(one).collect()
}
