//! A part of an actor's body that is painted with marks, moves and deforms: a face [Davis 2002, Figs. 54, 55 and 58] or a knee (§6.1).
//!
//! It is a surface of triangles with a texture. Of the modules, `surface` tells how it deforms, `head`, `expressions`, `ict` and `knee` what it is made
//! of, `drive` what a face does over time, `soft` how its skin swings, slides and bulges, `places`, `skin` and `texture` how it looks. Where the marks truly are at some time, and from where they
//! are seen, is [`Painted`]. All is a pure function of time and of the seed.

mod coarser;
mod drive;
mod expressions;
mod head;
mod ict;
mod knee;
mod places;
mod skin;
mod soft;
mod surface;
mod texture;

use std::collections::VecDeque;
use std::fmt;
use std::path::Path;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use foveate_estimation::random::Random;
use foveate_messages::Time;
use foveate_node::ConfigError;
use nalgebra::{Isometry3, Point3, Translation3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::person::{BodyPart, Pose};
use drive::Drive;
pub(crate) use places::MOST as MOST_MARKS;
pub use soft::SoftSettings;
use soft::{Carried, Soft};
use surface::Spot;
pub(crate) use surface::{Material, Surface, Triangle};
pub(crate) use texture::{Texture, noise};

/// Skins that are kept, so that cameras that look at the same moments share them.
const KEPT: usize = 32;
/// Triangles that are tested together for whether a line of sight meets them.
const BLOCK: usize = 24;
/// A line of sight to a mark may graze the skin this near to it [m].
const NEAR: f64 = 0.8e-3;
/// From the foot of the neck to the middle of a head that looks straight ahead [m].
const NECK: [f64; 3] = [0.02, 0.0, 0.17];
/// Among the parts of a [`Pose`]: head and neck, which a face's surface stands in for.
const HEAD_PARTS: [usize; 2] = [3, 4];
/// Among them: what never hides a face.
const SHOULDERS: usize = 1;

/// What is painted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PartKind {
    /// The face, with up to 76 marks.
    #[default]
    Face,
    /// The right knee, with up to 45 marks, and a ninth LED above it, target 8 n of n people. It is always the built-in one; on a `stage` the
    /// actor bends it while standing.
    Knee,
}

/// Where a face comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FaceSource {
    /// From recordings where they are there, built in otherwise.
    #[default]
    Auto,
    /// A head made of formulas.
    BuiltIn,
    /// The ICT Face Model Light, moved by recorded curves: `s13_ict_facekit_min` and `s20_arkit_curves` in the folder `data`.
    Ict,
}

/// A head and its motion, read from recordings.
pub struct RecordedHead(ict::Head);

impl RecordedHead {
    /// Reads the files of [`FaceSource::Ict`] in `folder`.
    ///
    /// # Errors
    /// A sentence with the file, what was found in it and what was expected.
    pub fn read(folder: &Path) -> Result<Self, String> {
        ict::read(folder).map(Self)
    }

    /// Whether `folder` holds all the files.
    pub fn is_in(folder: &Path) -> bool {
        ict::is_in(folder)
    }
}

/// The actor's painted face, or knee.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct FaceSettings {
    /// Which part of the body is painted [–].
    pub part: PartKind,
    /// How many marks are painted on it, 12 mm or more apart; a knee has room for 45 [–].
    #[schemars(range(min = 1, max = 76))]
    pub marks: usize,
    /// How large they are, about [mm].
    #[schemars(range(min = 0.5, max = 5.0))]
    pub radius_mm: f64,
    /// How bright a white surface looks that faces the light on the stage, in a room at full light, gain 1 [gray level].
    #[schemars(range(min = 0.0, max = 500.0))]
    pub light: f64,
    /// Where the face and its motion come from: `auto` takes recordings where they are there, and tells if not [–].
    pub source: FaceSource,
    /// Skin that swings after what carries it, slides over what lies below and bulges where it is pushed together; `{}` for that of a person. Left out: it
    /// deforms as its modes say [–].
    pub soft: Option<SoftSettings>,
    /// The folder of recordings. `${NAME}` is an environment variable; a relative path starts at the rig's folder [–].
    pub data: String,
}

impl Default for FaceSettings {
    fn default() -> Self {
        Self {
            part: PartKind::Face,
            marks: 69,
            radius_mm: 1.8,
            light: 260.0,
            source: FaceSource::Auto,
            soft: None,
            data: "${FOVEATE_DATA}".to_owned(),
        }
    }
}

impl FaceSettings {
    /// Refuses numbers out of their ranges.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("face.marks", self.marks, 1..=MOST_MARKS)?;
        ConfigError::unless_in("face.radius_mm", self.radius_mm, 0.5..=5.0)?;
        ConfigError::unless_in("face.light", self.light, 0.0..=500.0)?;
        self.soft.as_ref().map_or(Ok(()), SoftSettings::check)
    }
}

/// The painted part of an actor: what does not change over time.
pub(crate) struct Part {
    pub surface: Surface,
    pub light: f64,
    painter: Painter,
    /// Painted when a camera first looks: a rig that is only checked waits for no paint.
    texture: OnceLock<Texture>,
    names: Vec<String>,
    spots: Vec<Spot>,
    /// What a face does; a knee does what the leg does.
    drive: Option<Drive>,
    soft: Option<Soft>,
    recent: Mutex<VecDeque<(Time, Arc<Skin>)>>,
}

/// What is needed to paint the texture.
struct Painter {
    /// Columns, rows [texel].
    size: [usize; 2],
    marks: texture::Paint,
    albedo: Albedo,
}

/// What the bare surface is made of.
enum Albedo {
    /// The leg, by its seed.
    Knee(u32),
    /// The built-in head.
    BuiltIn(skin::Features),
    /// The recorded head.
    Recorded(skin::Features),
}

impl Albedo {
    /// At a point of the rest shape [m].
    fn at(&self, p: &Point3<f64>, material: Material) -> f32 {
        match (self, material) {
            (Albedo::Knee(seed), _) => knee::albedo(p, *seed),
            (_, Material::Eye) => ict::eye_albedo(p),
            (_, Material::Mouth) => 0.06,
            (Albedo::BuiltIn(features), Material::Skin) => features.albedo(&(p * 1e3)),
            (Albedo::Recorded(features), Material::Skin) => {
                let skin = features.albedo(&ict::as_built_in(p));
                let covered = ict::cloth(p);
                if covered == 0.0 { skin } else { skin + (features.cloth(p) - skin) * covered }
            }
        }
    }
}

/// The surface at one time, in the world.
#[derive(Debug, PartialEq)]
pub(crate) struct Skin {
    pub vertices: Vec<Point3<f64>>,
    pub normals: Vec<Vector3<f32>>,
    /// How much light each vertex throws back to all sides, relative to a white surface that faces the light.
    pub light: Vec<f32>,
    pub world_from_part: Isometry3<f64>,
}

/// Where the light on the stage comes from.
pub(crate) fn key_light() -> Vector3<f32> {
    Vector3::new(-0.45, 0.72, 0.55).normalize()
}

impl Part {
    /// A face that shows its range from `start_s` on for `shown_s`: `recorded`, or the built-in one.
    pub fn new(
        settings: &FaceSettings,
        recorded: Option<RecordedHead>,
        start_s: f64,
        shown_s: f64,
        random: &Random,
    ) -> Self {
        let seed = random.fork("texture").next_u64() as u32;
        if settings.part == PartKind::Knee {
            let (mut surface, size) = knee::knee();
            surface.sort_triangles();
            let spots = knee::spots(&surface, settings.marks);
            let marks = texture::Paint::new(&surface, &spots, settings.radius_mm, seed);
            let painter = Painter { size, marks, albedo: Albedo::Knee(seed) };
            let soft = settings.soft.as_ref().map(|it| Soft::knee(it, &surface));
            return Self { soft, ..Self::of(settings, surface, painter, spots, None) };
        }
        let features = skin::Features { seed, is_built_in: recorded.is_none() };
        let is_built_in = recorded.is_none();
        let (mut surface, size, curves) = match recorded {
            Some(RecordedHead(head)) => (head.surface, head.texture_size, Some(head.curves)),
            None => {
                let (surface, size) = head::head();
                (surface, size, None)
            }
        };
        surface.sort_triangles();
        let place = if is_built_in { |at| at } else { ict::place };
        let spots = places::on_face(&surface, settings.marks, place);
        let marks = texture::Paint::new(&surface, &spots, settings.radius_mm, seed);
        let albedo = if is_built_in { Albedo::BuiltIn(features) } else { Albedo::Recorded(features) };
        let painter = Painter { size, marks, albedo };
        let drive = Drive::new(start_s, shown_s, curves, &mut random.fork("expressions"));
        let as_built_in = if is_built_in { |p: &Point3<f64>| p * 1e3 } else { ict::as_built_in };
        let soft = settings.soft.as_ref().map(|it| Soft::head(it, &surface, as_built_in));
        Self { soft, ..Self::of(settings, surface, painter, spots, Some(drive)) }
    }

    fn of(settings: &FaceSettings, surface: Surface, painter: Painter, spots: Vec<Spot>, drive: Option<Drive>) -> Self {
        Self {
            names: surface.modes.iter().map(|it| it.name.clone()).collect(),
            light: settings.light,
            recent: Mutex::default(),
            surface,
            painter,
            texture: OnceLock::new(),
            spots,
            drive,
            soft: None,
        }
    }

    /// What the surface looks like, painted on first use.
    pub fn texture(&self) -> &Texture {
        let Painter { size, marks, albedo } = &self.painter;
        self.texture.get_or_init(|| texture::paint(&self.surface, *size, marks, |p, material| albedo.at(p, material)))
    }

    /// Whether it takes the place of a part of the body, or of some of it.
    fn replaces(&self, part: usize) -> bool {
        if self.drive.is_some() { HEAD_PARTS.contains(&part) } else { knee::PARTS.contains(&part) }
    }

    /// What is left of a part of the body beside it.
    pub fn beside(&self, part: usize, body: BodyPart) -> Option<BodyPart> {
        match (&self.drive, self.replaces(part)) {
            (None, _) => Some(knee::beside(part, body)),
            (Some(_), is_replaced) => (!is_replaced).then_some(body),
        }
    }

    /// Its middle on the body `pose` [m].
    pub fn middle(&self, pose: &Pose) -> Point3<f64> {
        match self.drive {
            Some(_) => pose.head.translation.vector.into(),
            None => pose.parts[knee::PARTS[1]].ends[0],
        }
    }

    /// The surface at `time` on a body whose poses over time [s] are `pose_at`.
    pub fn skin(&self, time: Time, pose_at: &dyn Fn(f64) -> Pose) -> Arc<Skin> {
        let recent = || self.recent.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, known)) = recent().iter().find(|it| it.0 == time) {
            return Arc::clone(known);
        }
        let skin = Arc::new(self.skin_at(time.as_s(), pose_at));
        let mut recent = recent();
        recent.truncate(KEPT - 1);
        recent.push_front((time, Arc::clone(&skin)));
        skin
    }

    fn skin_at(&self, time_s: f64, pose_at: &dyn Fn(f64) -> Pose) -> Skin {
        let now = self.carried(time_s, pose_at);
        let vertices = self.surface.deform(&now.weights, &now.world_from_part, &now.world_from_next);
        let vertices = match &self.soft {
            Some(soft) => soft.settle(&self.surface, &now, &vertices, time_s, |it| self.carried(it, pose_at)),
            None => vertices,
        };
        self.skin_of(vertices, now.world_from_part)
    }

    fn carried(&self, time_s: f64, pose_at: &dyn Fn(f64) -> Pose) -> Carried {
        let (pose, mut weights) = (pose_at(time_s), Vec::new());
        let [world_from_part, world_from_next] = match &self.drive {
            Some(drive) => {
                drive.weights(&self.names, time_s, &mut weights);
                [pose.head, world_from_trunk(&pose)]
            }
            None => {
                knee::weights(&pose, &mut weights);
                knee::frames(&pose)
            }
        };
        Carried { weights, world_from_part, world_from_next }
    }

    /// The surface as it is at rest, carried as a whole.
    pub fn skin_at_rest(&self, world_from_part: Isometry3<f64>) -> Skin {
        self.skin_of(self.surface.deform(&[], &world_from_part, &world_from_part), world_from_part)
    }

    fn skin_of(&self, vertices: Vec<Point3<f64>>, world_from_part: Isometry3<f64>) -> Skin {
        let normals = self.surface.normals(&vertices);
        let key = key_light();
        let fill = Vector3::new(0.75, 0.6, 0.1).normalize();
        let light = normals.iter().zip(&self.surface.openness).map(|(normal, open)| {
            // Light goes through skin a little: shadows begin softly.
            let direct = ((normal.dot(&key) + 0.12) / 1.12).max(0.0);
            let sky = 0.24 + 0.10 * normal.z;
            open * (0.62 * direct * (0.5 + 0.5 * open) + 0.20 * normal.dot(&fill).max(0.0) + sky)
        });
        Skin { light: light.collect(), vertices, normals, world_from_part }
    }

    /// The truth about the marks of `skin`.
    fn painted(self: &Arc<Self>, skin: Arc<Skin>, pose: &Pose) -> Painted {
        let blockers = pose.parts.iter().enumerate().filter(|(part, _)| !self.replaces(*part) && *part != SHOULDERS);
        let corner = |corner: u32| skin.vertices[corner as usize];
        let bounds = self.surface.triangles.chunks(BLOCK).map(|block| {
            let corners = || block.iter().flat_map(|it| it.corners).map(corner);
            let n = (block.len() * 3) as f64;
            let middle = Point3::from(corners().fold(Vector3::zeros(), |sum, it| sum + it.coords) / n);
            (middle, corners().map(|it| (it - middle).norm_squared()).fold(0.0, f64::max))
        });
        Painted {
            world_from_part: skin.world_from_part,
            marks: self.spots.iter().map(|it| self.surface.place(it, &skin.vertices)).collect(),
            normals: self.spots.iter().map(|it| self.surface.normal_at(it, &skin.normals)).collect(),
            blockers: blockers.map(|it| *it.1).collect(),
            bounds: bounds.collect(),
            part: Arc::clone(self),
            skin,
        }
    }

    /// [`Self::painted`] at `time` of a body whose poses over time [s] are `pose_at`.
    pub fn painted_at(self: &Arc<Self>, time: Time, pose_at: &dyn Fn(f64) -> Pose) -> Painted {
        self.painted(self.skin(time, pose_at), &pose_at(time.as_s()))
    }
}

impl fmt::Debug for Part {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Part").field("n_vertices", &self.surface.rest.len()).finish_non_exhaustive()
    }
}

/// Where a head that looks straight ahead would be: what the foot of the neck follows.
fn world_from_trunk(pose: &Pose) -> Isometry3<f64> {
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.forward.y.atan2(pose.forward.x));
    let foot = pose.parts[HEAD_PARTS[1]].ends[0];
    Isometry3::from_parts(Translation3::from(foot + turn * Vector3::from(NECK)), turn)
}

/// The painted marks at one time, as they truly are.
#[derive(Debug, Clone)]
pub struct Painted {
    /// Takes points of the part's space to the world: for a face that of the head (x forward, y left, z up, the origin in its middle), for a knee
    /// that of the thigh (z up along it, the origin in the joint).
    pub world_from_part: Isometry3<f64>,
    /// Where the marks are in the world, by their number [m].
    pub marks: Vec<Point3<f64>>,
    /// The skin's outward normals there, in the world, of length 1.
    pub normals: Vec<Vector3<f64>>,
    /// What else of the body may hide it.
    blockers: Vec<BodyPart>,
    /// Of each block of triangles: a sphere around it, its middle [m] and squared radius [m²].
    bounds: Vec<(Point3<f64>, f64)>,
    part: Arc<Part>,
    skin: Arc<Skin>,
}

impl Painted {
    /// Whether nothing of the actor hides a mark, counted from 0, from who looks from `eye` [m]: neither the skin that it is painted on, nor
    /// the rest of the body. A mark that does not exist is not seen.
    pub fn sees(&self, eye: &Point3<f64>, mark: usize) -> bool {
        let (Some(place), Some(normal)) = (self.marks.get(mark), self.normals.get(mark)) else { return false };
        let to_eye = eye - place;
        if to_eye.dot(normal) <= 0.0 || self.blockers.iter().any(|part| part.blocks(eye, place)) {
            return false;
        }
        let length = to_eye.norm();
        let along = to_eye / length;
        let own = self.part.spots[mark].triangle as usize;
        !self.bounds.iter().enumerate().any(|(block, (middle, reach))| {
            let to_middle = middle - place;
            let ahead = to_middle.dot(&along);
            let beside = to_middle.norm_squared() - ahead * ahead;
            beside <= *reach && ahead > -reach.sqrt() && self.meets(block, own, place, &along)
        })
    }

    /// Whether a line from `place` meets a triangle of a block, but `own`, from outside.
    fn meets(&self, block: usize, own: usize, place: &Point3<f64>, along: &Vector3<f64>) -> bool {
        let first = block * BLOCK;
        let triangles = &self.part.surface.triangles[first..];
        triangles.iter().take(BLOCK).enumerate().any(|(i, triangle)| {
            let [a, b, c] = triangle.corners.map(|it| self.skin.vertices[it as usize]);
            first + i != own && crossing(place, along, [a, b, c]).is_some_and(|at| at > NEAR)
        })
    }
}

/// How far along a line it crosses a triangle; `None` where it does not.
///
/// Source: T. Möller and B. Trumbore, "Fast, minimum storage ray/triangle intersection", J. Graphics Tools 2(1), 1997.
fn crossing(from: &Point3<f64>, along: &Vector3<f64>, [a, b, c]: [Point3<f64>; 3]) -> Option<f64> {
    let (ab, ac) = (b - a, c - a);
    let p = along.cross(&ac);
    let determinant = ab.dot(&p);
    if determinant.abs() < 1e-18 {
        return None;
    }
    let to = from - a;
    let u = to.dot(&p) / determinant;
    let q = to.cross(&ab);
    let v = along.dot(&q) / determinant;
    (u >= 0.0 && v >= 0.0 && u + v <= 1.0).then(|| ac.dot(&q) / determinant)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::{SceneSettings, WalkKind, World};

    fn world() -> World {
        let settings = SceneSettings {
            walk: WalkKind::Stage,
            stand_s: 6.0,
            people_enter_s: 0.0,
            face: Some(FaceSettings { marks: MOST_MARKS, source: FaceSource::BuiltIn, ..FaceSettings::default() }),
            ..SceneSettings::default()
        };
        World::new(settings, &Random::new(3))
    }

    fn in_head(painted: &Painted) -> Vec<Point3<f64>> {
        painted.marks.iter().map(|it| painted.world_from_part.inverse_transform_point(it)).collect()
    }

    #[test]
    fn marks_keep_apart_and_move_by_as_much_as_faces_do() {
        let world = world();
        let at = |time_s: f64| world.painted(Time::from_s(time_s)).unwrap();
        let rest = at(2.45);
        assert_eq!(rest.marks.len(), MOST_MARKS);
        for i in 0..MOST_MARKS {
            for j in 0..i {
                let distance = (rest.marks[i] - rest.marks[j]).norm() * 1e3;
                assert!(distance > 11.5, "marks {i} and {j} are {distance} mm apart");
            }
        }
        let (first, mut farthest) = (in_head(&rest), vec![0.0_f64; MOST_MARKS]);
        for step in 0..900 {
            let now = in_head(&at(2.5 + f64::from(step) * 0.05));
            for (far, (a, b)) in farthest.iter_mut().zip(first.iter().zip(&now)) {
                *far = far.max((a - b).norm() * 1e3);
            }
        }
        let most = farthest.iter().copied().fold(0.0, f64::max);
        let moved = farthest.iter().filter(|it| **it > 3.0).count();
        println!("{farthest:.1?}");
        assert!((15.0..27.0).contains(&most) && moved > 40, "{moved} marks move, by {most} mm at most");
    }

    #[test]
    fn a_knee_bends_its_marks_with_the_leg() {
        let settings = SceneSettings {
            walk: WalkKind::Stage,
            stand_s: 6.0,
            people_enter_s: 0.0,
            face: Some(FaceSettings { part: PartKind::Knee, ..FaceSettings::default() }),
            ..SceneSettings::default()
        };
        let world = World::new(settings, &Random::new(3));
        const N: usize = 45;
        let (mut ranges, mut seen) = (vec![[f64::INFINITY, 0.0_f64]; N], 0);
        for step in 0..400 {
            let time = Time::from_s(2.5 + f64::from(step) * 0.05);
            let painted = world.painted(time).unwrap();
            assert_eq!(painted.marks.len(), N);
            for i in 0..N {
                (0..i).for_each(|j| {
                    assert!((painted.marks[i] - painted.marks[j]).norm() > 0.0105, "{i} {j} at {time:?}")
                });
            }
            // From the highest mark in the middle to the others.
            for (range, mark) in ranges.iter_mut().zip(&painted.marks) {
                let distance = (mark - painted.marks[0]).norm() * 1e3;
                *range = [range[0].min(distance), range[1].max(distance)];
            }
            seen += (0..N).filter(|it| painted.sees(&Point3::new(0.5, 3.0, 0.9), *it)).count();
            // The LED above it goes with it, and is the ninth target.
            let truth = world.truth(time);
            let led = truth.list.iter().find(|it| it.id.0 == 8).unwrap();
            let in_part = painted.world_from_part.inverse_transform_point(&led.position);
            assert!((in_part.z - 0.12).abs() < 0.01 && in_part.coords.xy().norm() < 0.1, "{in_part}");
        }
        let stretched = ranges.iter().filter(|it| it[1] - it[0] > 4.0).count();
        assert!(stretched > 20, "{ranges:.1?}");
        assert!(seen > 400 * 25, "{seen}");
    }

    #[test]
    fn marks_are_seen_from_the_front_and_hidden_by_the_head_from_behind() {
        let painted = world().painted(Time::from_s(5.0)).unwrap();
        let eye = |x: f64, y: f64, z: f64| painted.world_from_part * Point3::new(x, y, z);
        let seen = |eye: Point3<f64>| (0..MOST_MARKS).filter(|mark| painted.sees(&eye, *mark)).count();
        let [ahead, left, right, behind] =
            [eye(3.0, 0.0, 0.2), eye(1.2, 2.7, 0.3), eye(1.2, -2.7, 0.3), eye(-3.0, 0.0, 0.5)].map(seen);
        println!("{ahead} {left} {right} {behind}");
        assert!(ahead >= MOST_MARKS - 6 && behind == 0, "{ahead} {behind}");
        assert!((25..65).contains(&left) && (25..65).contains(&right), "{left} {right}");
        assert!(!painted.sees(&eye(3.0, 0.0, 0.0), MOST_MARKS));
    }
}
