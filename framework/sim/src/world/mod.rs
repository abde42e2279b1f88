//! The simulated world: people with LEDs, and all that a camera may mistake for them.
//!
//! A [`World`] is a pure function of time and of its seed. Each random event (a window that opens on a monitor, a
//! glint in one lens) is drawn by the number of the event, so any camera may be asked at any time, in any order.
//!
//! Brightness is in gray levels of a camera with gain 1.

mod bodies;
mod bust;
mod clutter;
mod darts;
mod furniture;
mod mirror;
mod single;
mod waved;

use std::sync::Arc;

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Message, Provenance, Space, Target, TargetId, Targets, Time, Wire};
use nalgebra::{Matrix6, Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

pub use bodies::{Body, BodyMotion, BodySettings, BodySource};
use bust::Bust;
pub use bust::BustSettings;
pub use clutter::{BrightSpot, Glint, MAX_MONITORS, Monitor, PANES};
use darts::Dart;
pub use darts::DartSettings;
pub(crate) use furniture::room_hit;
pub use furniture::{Surface, room_light};
pub use mirror::Mirror;
use single::Single;
pub use single::{LightPath, SwingSettings};
use waved::Wave;
pub use waved::WaveSettings;

use crate::painted::{FaceSettings, Painted, Part, PartKind, RecordedHead, Skin, Triangle};
use crate::person::{Braid, COME_S, Headband, Joints, Led, N_LEDS, N_ON_HEADBAND, Person, Pose};
use crate::studio::{ArmJoints, ArmSettings, Posed, Studio, StudioSettings};
use crate::truth::{TrueCamera, Truth, TruthSettings};

/// At this distance [m] a LED seen along its normal has the brightness [`SceneSettings::led_peak`].
pub const REFERENCE_DISTANCE_M: f64 = 3.0;

/// How people walk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum WalkKind {
    /// One behind the other on a closed path.
    #[default]
    Round,
    /// On paths that cross closely.
    Crowd,
    /// One actor, who comes in, stays for `stand_s` facing +Y, and then walks to and fro along X, the face towards +Y nearly always.
    Stage,
}

/// What is in the room.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct SceneSettings {
    /// People who walk about, each with eight LEDs; more than four walk in a `crowd` only [–].
    #[schemars(range(min = 0, max = 32))]
    pub people: usize,
    /// Whether they follow each other on one round, all there from one moment to the next, cross each other's paths in a crowd,
    /// which they walk into from outside, or one of them acts on a stage: stands facing +Y, then walks to and fro along X [–].
    pub walk: WalkKind,
    /// Extents along x and y of the area that they walk about in, its middle at the origin [m].
    #[schemars(inner(range(min = 1.0, max = 200.0)))]
    pub walk_area_m: [f64; 2],
    /// In a crowd: least distance between two people, centre to centre; they do come that close [m].
    #[schemars(range(min = 0.4, max = 10.0))]
    pub closest_m: f64,
    /// When they come in, or in a crowd the first of them: before, the empty room lets detectors learn what it looks like [s].
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub people_enter_s: f64,
    /// In a crowd: how long a person stays, at least, before walking out again; 0: for good [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub stay_s: f64,
    /// In a crowd: how long a person who walked out stays away, at least; 0: for good. Persons who return have new targets [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub away_s: f64,
    /// On a `stage`: how long the actor stands, which begins 2.5 s after coming in [s].
    #[schemars(range(min = 0.0, max = 3600.0))]
    pub stand_s: f64,
    /// On a `stage`: from one end to the other, along X, its middle at the origin [m].
    #[schemars(range(min = 0.2, max = 20.0))]
    pub stage_m: f64,
    /// Mean walking speed; they slow down in turns [m/s].
    #[schemars(range(min = 0.1, max = 2.0))]
    pub speed_m_s: f64,
    /// Peak of a LED's spot, seen along its normal from 3 m with gain 1; above 255 it saturates
    /// [gray level].
    #[schemars(range(min = 0.0, max = 5000.0))]
    pub led_peak: f64,
    /// Reflectance of floor and display as mirrors, seen straight on; at an angle they reflect more. LEDs then
    /// show up a second and a third time; 0: nothing shines [–].
    #[schemars(range(min = 0.0, max = 1.0))]
    pub reflections: f64,
    /// Small bright things that stay where they are: lamps, reflections [–].
    #[schemars(range(min = 0, max = 200))]
    pub bright_spots: usize,
    /// Monitors that flicker, and whose windows change at random times [–].
    #[schemars(range(min = 0, max = 8))]
    pub monitors: usize,
    /// Mean time between two changes of one window on a monitor [s].
    #[schemars(range(min = 0.05, max = 3600.0))]
    pub window_change_s: f64,
    /// Rate of the truth [Hz].
    #[schemars(range(min = 1.0, max = 10_000.0))]
    pub truth_hz: f64,
    /// Short glints, each in one camera only: how many a second and camera [Hz].
    #[schemars(range(min = 0.0, max = 30.0))]
    pub glints_hz: f64,
    /// The face, or a knee, of the first of the people, painted with marks: pan-tilt cameras see it in its details. Left out: nothing is painted [–]
    pub face: Option<FaceSettings>,
    /// The first of the people wears a band about the head, with three lights more, which come after all others: a display follows it [–]
    pub headband: bool,
    /// Movements of the people's bodies from a recording, such as `{ file = "${FOVEATE_DATA}/s18_bvh/131_03.bvh" }`. Left out: a walk that is built in [–]
    pub body: Option<BodySettings>,
    /// In place of people, an invisible hand waves one light that shines to all sides, to calibrate with: from `people_enter_s` on it
    /// is held on the floor at the origin, 1 m along X and 1 m along Y, then it goes all about `walk_area_m`, unless `wave` says otherwise [–]
    pub waved_light: bool,
    /// Where a `waved_light` is held and waved, and how fast [–].
    pub wave: WaveSettings,
    /// In place of people, one light that shines to all sides is swung from side to side, from `people_enter_s` on [–]
    pub swing: Option<SwingSettings>,
    /// In place of people, lights that dart about, turn sharply and stop dead, from `people_enter_s` on [–]
    pub darts: Option<DartSettings>,
    /// In place of people, one light that shines to all sides goes along the path of a file, from `people_enter_s` on: `time_s,x_m,y_m,z_m`,
    /// a heading and a row for each time; or several do, with a column `target` behind the time, as in `truth.csv`. `${NAME}` is an environment variable; a relative path starts at the rig's folder [–]
    pub light_path: Option<String>,
    /// In place of people, a bust on a stand, or moved to and fro by hand, with a light above it. Left out: there is none [–]
    pub bust: Option<BustSettings>,
    /// People in clothes, furniture and lamps as textured surfaces in the lab's room, with shadows, in place of dark shapes. Left out: dark shapes [–]
    pub studio: Option<StudioSettings>,
    /// In place of people, an arm that bends and turns, bare or in a sweater, in a `studio`, which need not be named. Left out: there is none [–]
    pub arm: Option<ArmSettings>,
    /// The true cameras and heads, which differ from the rig's calibration. Left out: the calibration is the truth [–]
    pub truth: Option<TruthSettings>,
}

impl Default for SceneSettings {
    fn default() -> Self {
        Self {
            people: 1,
            walk: WalkKind::Round,
            walk_area_m: [2.5, 4.0],
            closest_m: 0.6,
            people_enter_s: 1.0,
            stay_s: 0.0,
            away_s: 0.0,
            stand_s: 10.0,
            stage_m: 2.0,
            speed_m_s: 0.9,
            led_peak: 800.0,
            reflections: 0.0,
            bright_spots: 14,
            monitors: 4,
            window_change_s: 4.0,
            truth_hz: 60.0,
            glints_hz: 0.2,
            face: None,
            headband: false,
            body: None,
            waved_light: false,
            wave: WaveSettings::default(),
            swing: None,
            darts: None,
            light_path: None,
            bust: None,
            studio: None,
            arm: None,
            truth: None,
        }
    }
}

/// What the files of [`SceneSettings`] hold.
#[derive(Default)]
pub struct Recordings {
    /// Of [`SceneSettings::light_path`], one for each light.
    pub light_paths: Vec<LightPath>,
    /// Of [`SceneSettings::face`].
    pub head: Option<RecordedHead>,
    /// Of [`SceneSettings::body`]: the people take them in turn.
    pub bodies: Vec<Body>,
    /// Of [`SceneSettings::truth`].
    pub truth: Option<Truth>,
}

/// A handle to the simulated world; cloning it is cheap.
#[derive(Debug, Clone)]
pub struct World(Arc<Scene>);

#[derive(Debug)]
struct Scene {
    settings: SceneSettings,
    people: Vec<Person>,
    spots: Vec<BrightSpot>,
    monitors: Vec<Monitor>,
    /// Of each monitor: read along every line of sight.
    monitor_normals: Vec<Vector3<f64>>,
    /// Lights by themselves, in place of people.
    singles: Vec<Single>,
    face: Option<Arc<Part>>,
    headband: Option<Headband>,
    bust: Option<Bust>,
    studio: Option<Studio>,
    truth: Option<Truth>,
    seed: u64,
}

impl Message for World {
    const NAME: &'static str = "world";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::Local;
}

/// A LED at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Its target.
    pub id: TargetId,
    /// Where it is [m].
    pub position: Point3<f64>,
    /// Brightness at 3 m in the requested direction [gray level].
    pub brightness: f64,
}

/// All people at one time; reused from frame to frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Moment {
    /// Those who are there, in the order of their numbers.
    pub poses: Vec<Pose>,
    /// Of each of them, the identity of the first LED.
    first_ids: Vec<u32>,
    /// Where the lights by themselves are [m]; people are not there then, and their identities are their places here.
    singles: Vec<Point3<f64>>,
    /// The LED above a painted knee, and its identity.
    knee: Option<(TargetId, Led)>,
    /// The lights of the headband, and the identity of the first of them.
    headband: Option<(u32, [Led; N_ON_HEADBAND])>,
}

/// The people of a scene. Where a crowd finds no room to keep apart it walks as it does with the least distance that there is.
fn people(settings: &SceneSettings, random: &Random) -> Vec<Person> {
    let SceneSettings { people, walk, walk_area_m: area, speed_m_s: speed, people_enter_s: enter_s, .. } = *settings;
    let braid = || match settings.braid() {
        Ok(braid) => Some(braid),
        Err(widest) => Braid::new(people, area, widest).ok(),
    };
    match (walk, braid) {
        (WalkKind::Round, _) => (0..people).map(|i| Person::new(i, people, area, speed, random)).collect(),
        (WalkKind::Stage, _) => {
            let SceneSettings { stand_s, stage_m, .. } = *settings;
            let shows_knee = settings.has_knee();
            (0..people).map(|_| Person::on_stage(enter_s, stand_s, stage_m, speed, shows_knee, random)).collect()
        }
        (WalkKind::Crowd, braid) => {
            let Some(braid) = braid() else { return Vec::new() };
            let stay_away_s = [settings.stay_s, settings.away_s];
            (0..people).map(|i| Person::in_crowd(i, &braid, speed, enter_s, stay_away_s, random)).collect()
        }
    }
}

/// The lights by themselves of a scene; `light_paths` are those of its file.
fn singles(settings: &SceneSettings, light_paths: Vec<LightPath>, random: &Random) -> Vec<Single> {
    if let Some(darts) = &settings.darts {
        let mut random = random.fork("darts");
        return (0..darts.lights).map(|_| Single::Darting(Dart::new(darts, &mut random))).collect();
    }
    if !light_paths.is_empty() {
        return light_paths.into_iter().map(Single::Path).collect();
    }
    let single = match &settings.swing {
        Some(swing) => Some(Single::Swung(swing.clone())),
        None => match &settings.bust {
            Some(bust) => bust.has_light().then(|| Single::OnBust(bust.clone(), settings.people_enter_s)),
            None => settings.waved_light.then(|| Single::Waved(Wave::new(&settings.wave, settings.walk_area_m))),
        },
    };
    single.into_iter().collect()
}

impl SceneSettings {
    /// Whether it is a knee that is painted.
    fn has_knee(&self) -> bool {
        self.face.as_ref().is_some_and(|it| it.part == PartKind::Knee)
    }

    /// How a crowd of these people walks.
    ///
    /// # Errors
    /// How near they would come at best, where that is nearer than `closest_m` [m].
    pub(crate) fn braid(&self) -> Result<Braid, f64> {
        Braid::new(self.people, self.walk_area_m, self.closest_m)
    }
}

impl World {
    /// The world of these settings; out-of-range values are taken as they are. Same seed, same world. No file is read: face and bodies are
    /// built-in ones, and there is no [`SceneSettings::light_path`]; see [`Self::with_recordings`].
    pub fn new(settings: SceneSettings, random: &Random) -> Self {
        Self::with_recordings(settings, Recordings::default(), random)
    }

    /// As [`Self::new`], with a recorded head in place of the built-in one, where the settings have a painted face.
    pub fn with_head(settings: SceneSettings, head: RecordedHead, random: &Random) -> Self {
        Self::with_recordings(settings, Recordings { head: Some(head), ..Recordings::default() }, random)
    }

    /// As [`Self::new`], with what files hold.
    pub fn with_recordings(settings: SceneSettings, recordings: Recordings, random: &Random) -> Self {
        let Recordings { light_paths, head, bodies, truth } = recordings;
        let singles = singles(&settings, light_paths, random);
        // The face shows its range while the actor stands; elsewhere from the first moment on, for as long.
        let comes_s = if settings.walk == WalkKind::Stage { COME_S } else { 0.0 };
        let face = settings.face.as_ref().map(|face| {
            let start_s = settings.people_enter_s + comes_s;
            Arc::new(Part::new(face, head, start_s, settings.stand_s, &random.fork("face")))
        });
        let mut people = people(&settings, &random.fork("people"));
        let mut ahead = random.fork("bodies");
        let as_recorded = |(index, (person, body)): (usize, (Person, &Body))| match body {
            Body::Limbs(body) => person.recorded(Arc::clone(body), &mut ahead),
            Body::Whole(body) => Person::whole(Arc::clone(body), settings.place_of(index), &mut ahead),
        };
        if !bodies.is_empty() {
            people = people.into_iter().zip(bodies.iter().cycle()).enumerate().map(as_recorded).collect();
        }
        let around_arm = settings.arm.as_ref().map(|_| StudioSettings::default());
        let studio = settings.studio.as_ref().or(around_arm.as_ref()).map(|it| {
            let random = random.fork("studio");
            let mut statures = random.fork("statures");
            for person in &mut people {
                let stature = 1.0 + it.stature_spread * statures.normal().clamp(-2.0, 2.0);
                person.grow(stature);
            }
            Studio::new(it, people.len(), settings.arm.as_ref(), &random)
        });
        let monitors = clutter::monitors(settings.monitors, &mut random.fork("monitors"));
        let scene = Scene {
            singles,
            face,
            headband: settings.headband.then(|| Headband::new(random.fork("headband"))),
            bust: settings.bust.as_ref().map(|it| Bust::new(it, &random.fork("bust"))),
            people,
            spots: clutter::bright_spots(settings.bright_spots, &mut random.fork("spots")),
            monitor_normals: monitors.iter().map(Monitor::normal).collect(),
            monitors,
            studio,
            truth,
            seed: random.fork("events").next_u64(),
            settings,
        };
        Self(Arc::new(scene))
    }

    /// What it was made of.
    pub fn settings(&self) -> &SceneSettings {
        &self.0.settings
    }

    /// The camera of this name as it truly is, which a calibration says is like `calibrated`.
    pub(crate) fn camera(&self, name: Option<&str>, calibrated: &Camera) -> TrueCamera {
        let known = self.0.truth.as_ref().zip(name).and_then(|(truth, name)| truth.camera(name));
        known.cloned().unwrap_or_else(|| TrueCamera::from(calibrated))
    }

    /// How many targets there are once all people have come in.
    pub fn n_targets(&self) -> usize {
        let on_band = if self.0.headband.is_some() { N_ON_HEADBAND } else { 0 };
        let alone = self.0.singles.len() + usize::from(self.0.settings.has_knee());
        self.0.people.len() * N_LEDS + alone + on_band
    }

    /// The identity of the LED above a painted knee.
    fn knee_id(&self) -> TargetId {
        TargetId((self.0.people.len() * N_LEDS) as u32)
    }

    /// The identity of the first light of the headband.
    fn headband_id(&self) -> u32 {
        (self.0.people.len() * N_LEDS + usize::from(self.0.settings.has_knee())) as u32
    }

    /// The true eyes, left and right, of the person with the headband, at `time`; `None` without one [m].
    pub fn eyes(&self, time: Time) -> Option<[Point3<f64>; 2]> {
        let band = self.0.headband.as_ref()?;
        let (_, person) = self.people_at(time).next()?;
        Some(band.eyes(&person.pose(time.as_s())))
    }

    /// The lights by themselves that are there at `time`, with their identities, and since when they are there [s].
    fn singles(&self, time: Time) -> impl Iterator<Item = (TargetId, &Single, f64)> {
        let since_s = time.as_s() - self.0.settings.people_enter_s;
        let there: &[Single] = if since_s >= 0.0 { &self.0.singles } else { &[] };
        (0..).map(TargetId).zip(there).map(move |(id, single)| (id, single, since_s))
    }

    /// Those who are there at `time`, each with the identity of the first LED.
    fn people_at(&self, time: Time) -> impl Iterator<Item = (u32, &Person)> {
        let has_begun = time.as_s() >= self.0.settings.people_enter_s;
        let people: &[Person] = if has_begun { &self.0.people } else { &[] };
        people.iter().zip(0_u32..).filter_map(move |(person, number)| {
            let visit = person.visit(time.as_s())?;
            Some(((visit * self.0.people.len() as u32 + number) * N_LEDS as u32, person))
        })
    }

    /// Fills `moment` with the people as they are at `time`.
    pub fn at(&self, time: Time, moment: &mut Moment) {
        moment.poses.clear();
        moment.first_ids.clear();
        for (first_id, person) in self.people_at(time) {
            moment.poses.push(person.pose(time.as_s()));
            moment.first_ids.push(first_id);
        }
        let knee = || moment.poses.first().filter(|_| self.0.settings.has_knee()).map(Pose::knee_led);
        moment.knee = knee().map(|led| (self.knee_id(), led));
        let worn = self.0.headband.as_ref().zip(moment.poses.first());
        moment.headband = worn.map(|(band, pose)| (self.headband_id(), band.lights(pose)));
        moment.singles.clear();
        moment.singles.extend(self.singles(time).map(|(_, single, since_s)| single.position(since_s)));
    }

    /// Where all LEDs truly are at `time`: measured, without uncertainty, seen by no camera in particular. Person p's LED l, in
    /// the order of [`LED_NAMES`](crate::person::LED_NAMES), is target 8 p + l; at the v-th visit, counted from 0,
    /// of p out of n people it is target 8 (n v + p) + l. Lights by themselves are targets from 0 on.
    pub fn truth(&self, time: Time) -> Targets {
        let mut truth = Targets::default();
        self.truth_into(time, &mut truth);
        truth
    }

    /// As [`Self::truth`], in memory that is used again.
    pub fn truth_into(&self, time: Time, truth: &mut Targets) {
        truth.time = time;
        truth.list.clear();
        for (first_id, person) in self.people_at(time) {
            let leds = person.motion(time.as_s()).into_iter().zip(first_id..);
            truth.list.extend(leds.map(|((position, velocity), id)| Target {
                id: TargetId(id),
                position,
                velocity,
                covariance: Matrix6::zeros(),
                cameras: Default::default(),
                provenance: Provenance::Measured,
            }));
        }
        let wearer = self.0.headband.as_ref().zip(self.people_at(time).next());
        truth.list.extend(wearer.into_iter().flat_map(|(band, (_, person))| {
            let on_band = band.motion(person, time.as_s());
            on_band.into_iter().zip(self.headband_id()..).map(|((position, velocity), id)| Target {
                id: TargetId(id),
                position,
                velocity,
                covariance: Matrix6::zeros(),
                cameras: Default::default(),
                provenance: Provenance::Measured,
            })
        }));
        let actor = self.people_at(time).next().filter(|_| self.0.settings.has_knee());
        truth.list.extend(actor.map(|(_, actor)| {
            let (position, velocity) = actor.knee_motion(time.as_s());
            let (cameras, provenance) = (Default::default(), Provenance::Measured);
            Target { id: self.knee_id(), position, velocity, covariance: Matrix6::zeros(), cameras, provenance }
        }));
        truth.list.extend(self.singles(time).map(|(id, single, since_s)| Target {
            id,
            position: single.position(since_s),
            velocity: single.velocity(since_s),
            covariance: Matrix6::zeros(),
            cameras: Default::default(),
            provenance: Provenance::Measured,
        }));
        truth.list.sort_unstable_by_key(|it| it.id);
    }

    /// The actor's painted marks as they truly are at `time`; `None` where there is no painted face, or the actor is not there.
    pub fn painted(&self, time: Time) -> Option<Painted> {
        let face = self.0.face.as_ref()?;
        let (_, actor) = self.people_at(time).next().filter(|it| self.is_actor(it.1))?;
        Some(face.painted_at(time, &|time_s| actor.pose(time_s)))
    }

    /// The painted part of the actor, where there is one and the actor is there at `time`: then the first of [`Moment::poses`].
    pub(crate) fn painted_part(&self, time: Time) -> Option<&Part> {
        let face = self.0.face.as_ref()?;
        self.people_at(time).next().filter(|it| self.is_actor(it.1)).map(|_| &**face)
    }

    /// The surfaces of which a projector's light shows the shape, as they are at `time`: a bust, the painted part of the actor, or the arm of a studio.
    pub(crate) fn shape(&self, time: Time) -> Option<(&[Triangle], Arc<Skin>)> {
        if let Some(arm) = self.studio().and_then(|it| it.arm_surface(time)) {
            return Some(arm);
        }
        self.part(time).map(|(part, skin)| (part.surface.triangles.as_slice(), skin))
    }

    /// A bust, or the painted part of the actor, as it is at `time`.
    pub(crate) fn part(&self, time: Time) -> Option<(&Part, Arc<Skin>)> {
        if let Some(bust) = &self.0.bust {
            return Some((bust.part(), bust.skin(time.as_s())));
        }
        let face = self.0.face.as_deref()?;
        let (_, actor) = self.people_at(time).next().filter(|it| self.is_actor(it.1))?;
        Some((face, face.skin(time, &|time_s| actor.pose(time_s))))
    }

    /// The studio, where there is one.
    pub(crate) fn studio(&self) -> Option<&Studio> {
        self.0.studio.as_ref()
    }

    /// The numbers of those who are there at `time`, and of the arm of the studio.
    pub(crate) fn present(&self, time: Time) -> Vec<usize> {
        let people = self.people_at(time).map(|it| it.1);
        let numbers = people.filter_map(|person| self.0.people.iter().position(|it| std::ptr::eq(it, person)));
        numbers.chain(self.studio().and_then(Studio::arm)).collect()
    }

    /// A thing of the studio as it is at `time`, its person being there or not.
    pub(crate) fn posed(&self, studio: &Studio, number: usize, time: Time) -> Arc<Posed> {
        studio.posed(number, time, || self.0.people[number].pose(time.as_s()))
    }

    /// Where the joints of those who are there at `time` truly are, with their numbers: [`Joints::centres`] and [`crate::person::JOINT_NAMES`] name them.
    pub fn joints(&self, time: Time) -> Vec<(usize, Joints)> {
        let of = |number: usize| (number, self.0.people[number].pose(time.as_s()).joints());
        self.present(time).into_iter().filter(|it| *it < self.0.people.len()).map(of).collect()
    }

    /// The joints of the arm as they truly are at `time`.
    pub fn arm_joints(&self, time: Time) -> Option<ArmJoints> {
        self.studio()?.arm_joints(time)
    }

    /// Whether there is a bust.
    pub(crate) fn has_bust(&self) -> bool {
        self.0.bust.is_some()
    }

    fn is_actor(&self, person: &Person) -> bool {
        self.0.people.first().is_some_and(|first| std::ptr::eq(first, person))
    }

    /// Small bright things that stay where they are.
    pub fn bright_spots(&self) -> &[BrightSpot] {
        &self.0.spots
    }

    /// The monitors; [`Self::pane_brightness`] tells how bright they are.
    pub fn monitors(&self) -> &[Monitor] {
        &self.0.monitors
    }

    /// Where each of the monitors points, of length 1.
    pub(crate) fn monitor_normals(&self) -> &[Vector3<f64>] {
        &self.0.monitor_normals
    }

    /// How bright a pane of a monitor (both counted from 0) is at `time` [gray level].
    pub fn pane_brightness(&self, monitor: usize, pane: usize, time: Time) -> f64 {
        clutter::pane_brightness(self.0.seed, monitor * PANES + pane, self.0.settings.window_change_s, time.as_s())
    }

    /// The glints in this camera's image at `time`.
    pub fn glints(&self, camera: CameraId, time: Time) -> impl Iterator<Item = Glint> {
        clutter::glints(self.0.seed, camera, self.0.settings.glints_hz, time.as_s())
    }
}

impl Moment {
    /// The LEDs that are seen from `eye` [m], with their brightness in that direction; those that a body part hides, and those
    /// that shine away from it, are left out.
    pub fn lights_seen_from<'s>(&'s self, eye: &'s Point3<f64>, led_peak: f64) -> impl Iterator<Item = Light> + 's {
        self.lights_towards(eye, led_peak).filter(|it| !self.occluded(eye, &it.position))
    }

    /// As [`Self::lights_seen_from`], with those that a body part hides: a caller that needs only a few checks these with [`Self::occluded`].
    pub fn lights_towards<'s>(&'s self, eye: &'s Point3<f64>, led_peak: f64) -> impl Iterator<Item = Light> + 's {
        let of_people = self.leds().filter_map(move |(id, led)| {
            let brightness = led_peak * led.emission_towards(eye);
            (brightness > 0.0).then_some(Light { id, position: led.position, brightness })
        });
        of_people.chain(self.singles_of(led_peak))
    }

    /// The images of the LEDs in `mirror` that are seen from `eye` [m], where they seem to be behind it, with their brightness;
    /// what a body hides on either side of the mirror is left out, and so is a light by itself. `reflectance` as in [`SceneSettings::reflections`].
    pub fn reflections_seen_from<'s>(
        &'s self,
        eye: &'s Point3<f64>,
        mirror: &'s Mirror,
        led_peak: f64,
        reflectance: f64,
    ) -> impl Iterator<Item = Light> + 's {
        self.leds().filter_map(move |(id, led)| {
            let (on_mirror, cosine) = mirror.reflect(eye, &led.position)?;
            let brightness = led_peak * led.emission_towards(&on_mirror) * Mirror::share(reflectance, cosine);
            let seen = brightness > 0.0 && !self.occluded(eye, &on_mirror) && !self.occluded(&on_mirror, &led.position);
            seen.then(|| Light { id, position: mirror.image(&led.position), brightness })
        })
    }

    /// All LEDs with their full brightness, 1, wherever they shine to.
    pub fn lights(&self) -> impl Iterator<Item = Light> + '_ {
        let of_people = self.leds().map(|(id, led)| Light { id, position: led.position, brightness: 1.0 });
        of_people.chain(self.singles_of(1.0))
    }

    fn singles_of(&self, brightness: f64) -> impl Iterator<Item = Light> + '_ {
        let singles = (0..).map(TargetId).zip(&self.singles);
        singles.map(move |(id, position)| Light { id, position: *position, brightness })
    }

    fn leds(&self) -> impl Iterator<Item = (TargetId, Led)> + '_ {
        let of = |(pose, first_id): (&Pose, &u32)| pose.leds.into_iter().zip(*first_id..);
        let worn = self.poses.iter().zip(&self.first_ids).flat_map(of).map(|(led, id)| (TargetId(id), led));
        let on_band = |(first, leds): (u32, [Led; N_ON_HEADBAND])| (first..).map(TargetId).zip(leds);
        worn.chain(self.knee).chain(self.headband.into_iter().flat_map(on_band))
    }

    /// Whether a person's body lies between `eye` and `point` [m].
    pub fn occluded(&self, eye: &Point3<f64>, point: &Point3<f64>) -> bool {
        self.poses.iter().any(|pose| pose.occluded(eye, point))
    }
}

#[cfg(test)]
mod tests;
