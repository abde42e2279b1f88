//! The studio: people in clothes, furniture and lamps as textured surfaces, in place of the dark shapes that rigs of lights are content with.
//!
//! `body` makes surfaces around the joints of a person, `clothes` paints them, `lamp` lights them, `room` and `props` are what stands still. All is a pure function of time and of the seed;
//! what several cameras need at the same time is computed once.

mod arm;
mod body;
mod clothes;
mod lamp;
mod loft;
mod props;
mod recent;
mod room;
mod texture;
mod truth;

use std::fmt;
use std::sync::{Arc, OnceLock};

use foveate_estimation::random::Random;
use foveate_messages::Time;
use foveate_node::ConfigError;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::painted::{Skin, Triangle};
use crate::person::Pose;
use arm::Arm;
pub use arm::{ArmCloth, ArmJoints, ArmSettings};
use body::{Body, Build};
use clothes::{Look, gloss};
pub use lamp::LampSettings;
pub(crate) use lamp::{Lamp, ShadowMap};
pub(crate) use props::Props;
use recent::Recent;
pub(crate) use room::place;
pub(crate) use texture::{Colour, Pyramid};
pub use truth::{SurfaceFinder, SurfacePoint, TrueSurfaces};

/// Sleeves of sweaters reach so far down [bones].
const SWEATER_SLEEVE: f64 = 1.9;
/// Moments whose bodies are kept, and moments whose light is.
const KEPT: [usize; 2] = [24, 6];

/// People in clothes, furniture and lamps.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct StudioSettings {
    /// Lamps, eight at most; `[]` leaves only the light from all around [–].
    #[schemars(length(max = 8))]
    pub lamps: Vec<LampSettings>,
    /// Light from all around: what a white surface shows by it, gain 1 [gray level].
    #[schemars(range(min = 0.0, max = 1000.0))]
    pub ambient: f64,
    /// Chairs: where each stands, along X and Y [m], and where it faces, from X towards Y [m, m, °].
    #[schemars(length(max = 20))]
    pub chairs: Vec<[f64; 3]>,
    /// Standard deviation of people's stature as a part of it; those of `body.motion = "whole"` are as tall as recorded [–].
    #[schemars(range(min = 0.0, max = 0.15))]
    pub stature_spread: f64,
    /// Whether all people wear a sweater of flecked wool [–].
    pub sweaters: bool,
    /// How large a texel of clothes is; half of it on faces [mm].
    #[schemars(range(min = 0.2, max = 50.0))]
    pub texel_mm: f64,
    /// How many times finer than usual bodies are divided into triangles, along and around: 1 for people who are seen whole, 25 mm [–].
    #[schemars(range(min = 1, max = 6))]
    pub finer: usize,
}

impl Default for StudioSettings {
    fn default() -> Self {
        let fill = LampSettings {
            position_m: [1.8, 1.6, 2.85],
            light: 230.0,
            colour: [0.92, 0.97, 1.05],
            ..LampSettings::default()
        };
        Self {
            lamps: vec![LampSettings::default(), fill],
            ambient: 120.0,
            chairs: Vec::new(),
            stature_spread: 0.05,
            sweaters: false,
            texel_mm: 3.0,
            finer: 1,
        }
    }
}

impl StudioSettings {
    /// Refuses numbers out of their ranges.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        ConfigError::unless_in("studio.lamps", self.lamps.len(), 0..=8)?;
        self.lamps.iter().try_for_each(LampSettings::check)?;
        ConfigError::unless_in("studio.ambient", self.ambient, 0.0..=1000.0)?;
        ConfigError::unless_in("studio.chairs", self.chairs.len(), 0..=20)?;
        for value in self.chairs.iter().flatten() {
            ConfigError::unless_in("studio.chairs", *value, -1e3..=1e3)?;
        }
        ConfigError::unless_in("studio.stature_spread", self.stature_spread, 0.0..=0.15)?;
        ConfigError::unless_in("studio.texel_mm", self.texel_mm, 0.2..=50.0)?;
        ConfigError::unless_in("studio.finer", self.finer, 1..=6)
    }
}

/// One texture of a thing.
pub(crate) struct Patch {
    /// The first of its triangles.
    first: usize,
    texture: OnceLock<Pyramid>,
    paint: Box<dyn Fn() -> Pyramid + Send + Sync>,
    /// How much of a lamp it mirrors, and how sharply.
    pub gloss: [f32; 2],
    /// How far around it is [m].
    around_m: f64,
}

impl Patch {
    /// The colour at a place, given in shares of both sides; what is finer than `resolved` [m] is left out.
    #[inline]
    pub fn colour(&self, place: [f32; 2], resolved: f32) -> Colour {
        let texture = self.texture.get_or_init(&self.paint);
        texture.at(place, resolved * (texture.size()[0] as f64 / self.around_m) as f32)
    }
}

/// A surface that moves: its triangles and how they look.
pub(crate) struct Thing {
    pub triangles: Vec<Triangle>,
    patches: Vec<Patch>,
    /// By triangle.
    patch_of: Vec<u8>,
}

impl Thing {
    fn new(triangles: Vec<Triangle>, patches: Vec<Patch>) -> Self {
        let mut patch_of = Vec::with_capacity(triangles.len());
        for (number, patch) in patches.iter().enumerate() {
            let end = patches.get(number + 1).map_or(triangles.len(), |it| it.first);
            patch_of.resize(end.max(patch.first), number as u8);
        }
        Self { triangles, patches, patch_of }
    }

    /// The patch that a triangle is a part of.
    #[inline]
    pub fn patch(&self, triangle: usize) -> &Patch {
        &self.patches[usize::from(self.patch_of[triangle])]
    }
}

/// A thing at one time.
#[derive(Debug, PartialEq)]
pub(crate) struct Posed {
    pub vertices: Vec<Point3<f64>>,
    pub normals: Vec<Vector3<f32>>,
}

/// Light on a vertex.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Lit {
    /// What a white surface throws back there, gain 1 [gray level].
    pub light: Colour,
    /// The share of the main lamp that nothing holds up [–].
    pub main: f32,
}

/// The lamps at one time, and what their light falls on.
#[derive(Debug)]
pub(crate) struct Lighting {
    /// By lamp, how bright it is relative to its full light.
    pub levels: Vec<f32>,
    /// By lamp, then by thing that is there.
    pub maps: Vec<Vec<ShadowMap>>,
    /// By thing that is there, then by vertex.
    pub lit: Vec<Vec<Lit>>,
}

/// The studio of a world.
pub(crate) struct Studio {
    pub settings: StudioSettings,
    pub lamps: Vec<Lamp>,
    pub props: Props,
    /// By lamp, where there are props.
    pub prop_maps: Vec<ShadowMap>,
    /// The brightest lamp: it is what shines in what is glossy.
    pub main_lamp: Option<usize>,
    bodies: Vec<Body>,
    arm: Option<Arm>,
    /// Of the bodies, and last of the arm.
    things: Vec<Thing>,
    posed: Recent<(Time, usize), Arc<Posed>>,
    lighting: Recent<(Time, u64, Vec<usize>), Arc<Lighting>>,
    /// The arm for what asks for one surface alone.
    skins: Recent<Time, Arc<Skin>>,
}

impl fmt::Debug for Studio {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.debug_struct("Studio").field("settings", &self.settings).finish_non_exhaustive()
    }
}

impl Studio {
    /// With so many people, and an arm.
    pub fn new(settings: &StudioSettings, n_people: usize, arm: Option<&ArmSettings>, random: &Random) -> Self {
        let mut of_lamps = random.fork("lamps");
        let lamps: Vec<Lamp> = settings.lamps.iter().map(|it| Lamp::new(it, &mut of_lamps)).collect();
        let props = Props::chairs(&settings.chairs);
        let prop_maps = if props.triangles.is_empty() {
            Vec::new()
        } else {
            lamps.iter().map(|it| ShadowMap::new(it, &props.vertices, &props.triangles)).collect()
        };
        let main_lamp = (0..lamps.len()).max_by(|a, b| settings.lamps[*a].light.total_cmp(&settings.lamps[*b].light));
        let drawn = (0..n_people).map(|it| actor(settings, &random.fork(&format!("actor {it}"))));
        let (bodies, mut things): (Vec<Body>, Vec<Thing>) = drawn.unzip();
        let mut of_arm = random.fork("arm");
        let arm = arm.map(|it| Arm::new(it, &mut of_arm));
        things.extend(arm.iter().map(|it| it.thing(&mut of_arm)));
        Self {
            settings: settings.clone(),
            lamps,
            props,
            prop_maps,
            main_lamp,
            bodies,
            arm,
            things,
            posed: Recent::new(KEPT[0]),
            lighting: Recent::new(KEPT[1]),
            skins: Recent::new(KEPT[1]),
        }
    }

    /// A thing by its number: that of the person, or that of [`Self::arm`].
    pub fn thing(&self, number: usize) -> &Thing {
        &self.things[number]
    }

    /// The number of the arm, where there is one.
    pub fn arm(&self) -> Option<usize> {
        self.arm.as_ref().map(|_| self.bodies.len())
    }

    /// The joints of the arm at `time`.
    pub fn arm_joints(&self, time: Time) -> Option<ArmJoints> {
        self.arm.as_ref().map(|it| it.joints(time))
    }

    /// The arm as a surface by itself at `time`: its triangles, and where they are.
    pub fn arm_surface(&self, time: Time) -> Option<(&[Triangle], Arc<Skin>)> {
        let number = self.arm()?;
        let skin = self.skins.get(time, || {
            let posed = self.posed(number, time, || unreachable!("an arm belongs to no person"));
            let (vertices, normals) = (posed.vertices.clone(), posed.normals.clone());
            Arc::new(Skin { vertices, normals, light: Vec::new(), world_from_part: nalgebra::Isometry3::identity() })
        });
        Some((&self.things[number].triangles, skin))
    }

    /// A thing as it is at `time`, when its person stands as `pose` says.
    pub fn posed(&self, number: usize, time: Time, pose: impl FnOnce() -> Pose) -> Arc<Posed> {
        self.posed.get((time, number), || {
            if let Some(arm) = self.arm.as_ref().filter(|_| number == self.bodies.len()) {
                return Arc::new(arm.pose(time));
            }
            let (mut vertices, mut normals) = (Vec::new(), Vec::new());
            self.bodies[number].pose(&pose().joints(), &mut vertices, &mut normals);
            Arc::new(Posed { vertices, normals })
        })
    }

    /// The light in an exposure of `exposure_s` around `time`, when these things are there.
    pub fn lighting(&self, time: Time, exposure_s: f64, there: &[(usize, Arc<Posed>)]) -> Arc<Lighting> {
        let key = (time, exposure_s.to_bits(), there.iter().map(|it| it.0).collect());
        self.lighting.get(key, || {
            let levels: Vec<f32> = self.lamps.iter().map(|it| it.level(time.as_s(), exposure_s) as f32).collect();
            let map = |lamp: &Lamp| -> Vec<ShadowMap> {
                let of = |(thing, posed): &(usize, Arc<Posed>)| {
                    ShadowMap::new(lamp, &posed.vertices, &self.thing(*thing).triangles)
                };
                there.iter().map(of).collect()
            };
            let maps: Vec<Vec<ShadowMap>> = self.lamps.iter().map(map).collect();
            let lit = there.iter().map(|(_, posed)| self.lit(posed, &levels, &maps)).collect();
            Arc::new(Lighting { levels, maps, lit })
        })
    }

    /// Light from all around on a surface that is turned this way [gray level].
    pub fn ambient(&self, normal: &Vector3<f32>) -> f32 {
        self.settings.ambient as f32 * (0.78 + 0.22 * normal.z)
    }

    fn lit(&self, posed: &Posed, levels: &[f32], maps: &[Vec<ShadowMap>]) -> Vec<Lit> {
        let colours: Vec<Colour> = self.lamps.iter().map(Lamp::colour).collect();
        let lit = |(vertex, normal): (&Point3<f64>, &Vector3<f32>)| {
            let mut lit = Lit { light: [self.ambient(normal); 3], main: 0.0 };
            // A little before the surface, so that it does not shade itself.
            let before = vertex + normal.cast::<f64>() * 6e-3;
            for (number, lamp) in self.lamps.iter().enumerate() {
                let falls = lamp.falls_on(vertex, normal) * levels[number];
                if falls <= 0.0 {
                    continue;
                }
                let of_props = self.prop_maps.get(number).into_iter();
                let free: f32 = maps[number].iter().chain(of_props).map(|it| it.free(&before)).product();
                [0, 1, 2].into_iter().for_each(|it| lit.light[it] += colours[number][it] * falls * free);
                if Some(number) == self.main_lamp {
                    lit.main = free * levels[number];
                }
            }
            lit
        };
        posed.vertices.iter().zip(&posed.normals).map(lit).collect()
    }
}

/// A person: a body, and how it looks.
fn actor(settings: &StudioSettings, random: &Random) -> (Body, Thing) {
    let mut build = Build::draw(&mut random.fork("build"));
    if settings.sweaters {
        build.sleeve = SWEATER_SLEEVE;
    }
    let look = Look::draw(settings.sweaters, &mut random.fork("look"));
    let body = Body::new(build, settings.finer, look.seed);
    let (triangles, starts) = body.triangles();
    let texel_m = settings.texel_mm * 1e-3;
    let patch = |(piece, first): (&body::Piece, usize)| {
        let gloss = gloss(piece.limb);
        let around_m = piece.limb.extent_m()[0];
        let piece = piece.clone();
        let paint = move || look.paint(&build, &piece, texel_m);
        Patch { first, texture: OnceLock::new(), paint: Box::new(paint), gloss, around_m }
    };
    let patches = body.pieces.iter().zip(starts).map(patch).collect();
    (body, Thing::new(triangles, patches))
}
