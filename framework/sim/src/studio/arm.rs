//! An arm before cameras, bare or in a sweater, that bends and turns: for surfaces that are matched and tracked without marks [D'Apuzzo 1999, Fig. 1].
//!
//! Vertices are points of skin or cloth: each keeps its place in the texture. Where it lies follows from the joints in ways that no model of rigid or linear parts has: cloth slides up the forearm as the
//! elbow bends and about it as the forearm turns, wrinkles grow with the square of the bend and travel over the cloth, muscles bulge.

use std::f64::consts::TAU;
use std::sync::OnceLock;

use foveate_estimation::random::Random;
use foveate_messages::Time;
use foveate_node::ConfigError;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::body::Chain;
use super::clothes::{Cloth, Look, Pattern};
use super::loft::{Grid, along_table};
use super::texture::{Pyramid, size_for};
use super::{Patch, Posed, Thing};
use crate::painted::noise;

/// Upper arm and forearm [m].
const BONES_M: [f64; 2] = [0.29, 0.25];
/// About how far around an arm is [m].
const AROUND_M: f64 = 0.30;
/// A bone along which texture is stretched, about [m].
const UNIT_M: f64 = 0.27;
/// Over this length to both sides of the elbow the middle of the arm is bent [m].
const BEND_M: f64 = 0.045;
/// Distance of two wrinkles [m].
const WRINKLE_M: f64 = 0.024;
/// Standing folds of cloth are so high and so wide [m].
const FOLD_M: [f64; 2] = [0.0022, 0.045];
/// By how much the upper arm swells at the elbow's full bend [m].
const BULGE_M: f64 = 0.010;
/// Widths of a check and of a stripe; they repeat after two [m].
const CHECK_M: f64 = 5e-3;
const STRIPE_M: f64 = 4e-3;
/// A sleeve ends here, in bones from the shoulder.
const SLEEVE: f64 = 1.93;

/// Rings from above the shoulder to the fist: place in bones; to the side that the elbow bends to, away from it, and to both sides [m].
const RINGS: &[(f64, [f64; 4])] = &[
    (-0.26, [0.0, 0.0, 0.0, 0.0]),
    (-0.25, [0.030, 0.030, 0.030, 0.030]),
    (-0.14, [0.058, 0.058, 0.056, 0.056]),
    (0.05, [0.062, 0.062, 0.060, 0.058]),
    (0.30, [0.058, 0.053, 0.053, 0.051]),
    (0.60, [0.053, 0.048, 0.047, 0.046]),
    (0.90, [0.044, 0.045, 0.044, 0.043]),
    (1.05, [0.044, 0.047, 0.045, 0.043]),
    (1.25, [0.046, 0.044, 0.046, 0.044]),
    (1.55, [0.039, 0.037, 0.039, 0.037]),
    (1.85, [0.030, 0.030, 0.027, 0.026]),
    (2.02, [0.031, 0.029, 0.026, 0.026]),
    (2.12, [0.042, 0.038, 0.032, 0.031]),
    (2.28, [0.046, 0.040, 0.036, 0.034]),
    (2.37, [0.034, 0.030, 0.026, 0.025]),
    (2.40, [0.0, 0.0, 0.0, 0.0]),
];

/// What covers the arm.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ArmCloth {
    /// A sweater of flecked wool, down to the wrist.
    #[default]
    Sweater,
    /// Cloth with checks that repeat every 10 mm, and a weave that hardly shows.
    Checked,
    /// Cloth with stripes along the arm that repeat every 8 mm.
    Striped,
    /// Nothing: skin has little to match, and slides and folds little.
    Bare,
}

/// An arm that moves.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ArmSettings {
    /// Where its shoulder is [m].
    pub position_m: [f64; 3],
    /// Where the cameras are that it is shown to, from X towards Y; it reaches out at a right angle to that, to the right as they see it [°].
    #[schemars(range(min = -360.0, max = 360.0))]
    pub facing_deg: f64,
    /// `sweater`, `checked`, `striped` or `bare` [–].
    pub cloth: ArmCloth,
    /// Whether the hand is covered as the arm is: else it is bare [–].
    pub glove: bool,
    /// How far apart vertices are [mm].
    #[schemars(range(min = 1.0, max = 50.0))]
    pub mesh_mm: f64,
    /// How large a texel is [mm].
    #[schemars(range(min = 0.1, max = 20.0))]
    pub texel_mm: f64,
    /// How high wrinkles are when the elbow is bent by a right angle; a seventh of it on bare skin [mm].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub wrinkle_mm: f64,
    /// How far cloth slides up the forearm when the elbow is bent by a right angle; a seventh of it on bare skin [mm].
    #[schemars(range(min = 0.0, max = 60.0))]
    pub slide_mm: f64,
    /// How fast it moves: at 1 the wrist at up to about 0.5 m/s; 0: it is still [–].
    #[schemars(range(min = 0.0, max = 20.0))]
    pub speed: f64,
    /// From when on it moves [s].
    #[schemars(range(min = 0.0, max = 1e6))]
    pub moves_from_s: f64,
}

impl Default for ArmSettings {
    fn default() -> Self {
        Self {
            position_m: [-0.30, 0.0, 1.20],
            facing_deg: -90.0,
            cloth: ArmCloth::Sweater,
            glove: false,
            mesh_mm: 3.0,
            texel_mm: 0.3,
            wrinkle_mm: 3.0,
            slide_mm: 12.0,
            speed: 1.0,
            moves_from_s: 0.0,
        }
    }
}

impl ArmSettings {
    /// Refuses numbers out of their ranges.
    pub(crate) fn check(&self) -> Result<(), ConfigError> {
        for position in self.position_m {
            ConfigError::unless_in("arm.position_m", position, -1e3..=1e3)?;
        }
        ConfigError::unless_in("arm.facing_deg", self.facing_deg, -360.0..=360.0)?;
        ConfigError::unless_in("arm.mesh_mm", self.mesh_mm, 1.0..=50.0)?;
        ConfigError::unless_in("arm.texel_mm", self.texel_mm, 0.1..=20.0)?;
        ConfigError::unless_in("arm.wrinkle_mm", self.wrinkle_mm, 0.0..=20.0)?;
        ConfigError::unless_in("arm.slide_mm", self.slide_mm, 0.0..=60.0)?;
        ConfigError::unless_in("arm.speed", self.speed, 0.0..=20.0)?;
        ConfigError::unless_in("arm.moves_from_s", self.moves_from_s, 0.0..=1e6)
    }
}

/// The joints of the arm at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ArmJoints {
    /// Shoulder, elbow, wrist [m].
    pub places: [Point3<f64>; 3],
    /// Between upper arm and forearm, 0 when it is stretched [rad].
    pub elbow: f64,
    /// Of the upper arm above the horizontal, and towards the cameras [rad].
    pub shoulder: [f64; 2],
    /// By how much the forearm is turned about itself [rad].
    pub twist: f64,
}

/// The arm of a world.
pub(super) struct Arm {
    settings: ArmSettings,
    grid: Grid,
    /// Of each ring, in bones from the shoulder.
    along: Vec<f64>,
    phases: [f64; 8],
    seed: u32,
}

impl Arm {
    pub fn new(settings: &ArmSettings, random: &mut Random) -> Self {
        let (from, to) = (RINGS[0].0, RINGS[RINGS.len() - 1].0);
        let mesh_m = settings.mesh_mm * 1e-3;
        let rings = (((to - from) * UNIT_M / mesh_m).ceil() as usize).max(24);
        let around = ((AROUND_M / mesh_m).ceil() as usize).max(12);
        let along = (0..rings).map(|it| from + (to - from) * it as f64 / (rings - 1) as f64).collect();
        let phases = [(); 8].map(|()| random.uniform_in(0.0, TAU));
        let grid = Grid { rings, around, first: 0 };
        Self { settings: settings.clone(), grid, along, phases, seed: random.next_u64() as u32 }
    }

    /// Its triangles and how they look.
    pub fn thing(&self, random: &mut Random) -> Thing {
        let mut triangles = Vec::new();
        self.grid.triangles(&mut triangles);
        let look = Look::draw(true, random);
        let cloth = Cloth::sweater(random);
        let cloth = match self.settings.cloth {
            ArmCloth::Checked => Cloth { pattern: Pattern::Checks(CHECK_M), ..cloth },
            ArmCloth::Striped => Cloth { pattern: Pattern::Stripes(STRIPE_M), ..cloth },
            ArmCloth::Sweater | ArmCloth::Bare => cloth,
        };
        let (along, settings) = (self.along.clone(), self.settings.clone());
        let paint = move || {
            let last = along.len() - 1;
            let long_m = (along[last] - along[0]) * UNIT_M;
            let size = size_for(AROUND_M / settings.texel_mm * 1e3, long_m / settings.texel_mm * 1e3);
            Pyramid::paint(size, |u, v| {
                let at = along[0] + (along[last] - along[0]) * v;
                let (angle, radius) = (u * TAU, AROUND_M / TAU);
                let p = Point3::new(radius * angle.cos(), radius * angle.sin(), at * UNIT_M);
                if settings.cloth != ArmCloth::Bare && (settings.glove || at < SLEEVE) {
                    cloth.colour(&p, u * AROUND_M, at * UNIT_M)
                } else {
                    look.skin(&p)
                }
            })
        };
        let gloss = if self.settings.cloth == ArmCloth::Bare { [0.05, 18.0] } else { [0.0, 1.0] };
        let patch = Patch { first: 0, texture: OnceLock::new(), paint: Box::new(paint), gloss, around_m: AROUND_M };
        Thing::new(triangles, vec![patch])
    }

    /// The joints at `time`.
    pub fn joints(&self, time: Time) -> ArmJoints {
        let since_s = (time.as_s() - self.settings.moves_from_s).max(0.0);
        // It starts from rest.
        let begun = since_s.min(1.0);
        let ramp = begun * begun * (3.0 - 2.0 * begun);
        let wave = |number: usize, period_s: f64| {
            let at = |period_s: f64, phase: f64| (TAU * since_s * self.settings.speed / period_s + phase).sin();
            let [a, b] = [self.phases[number], self.phases[number + 1]];
            ramp * (0.72 * at(period_s, a) + 0.28 * at(0.53 * period_s, b))
        };
        let elbow = (48.0 + 30.0 * wave(0, 3.4)).to_radians();
        let shoulder = [(-14.0 + 9.0 * wave(2, 4.3)).to_radians(), (10.0 + 10.0 * wave(4, 5.1)).to_radians()];
        let twist = (24.0 * wave(6, 4.9)).to_radians();
        let (sine, cosine) = self.settings.facing_deg.to_radians().sin_cos();
        let facing = Vector3::new(cosine, sine, 0.0);
        let across = Vector3::z().cross(&facing);
        let upper = (across * shoulder[1].cos() + facing * shoulder[1].sin()) * shoulder[0].cos()
            + Vector3::z() * shoulder[0].sin();
        let hinge = nalgebra::Unit::new_normalize(upper.cross(&(Vector3::z() * 0.8 + facing * 0.6)));
        let fore = UnitQuaternion::from_axis_angle(&hinge, elbow) * upper;
        let from = Point3::from(self.settings.position_m);
        let at = from + upper * BONES_M[0];
        ArmJoints { places: [from, at, at + fore * BONES_M[1]], elbow, shoulder, twist }
    }

    /// The surface at `time`.
    pub fn pose(&self, time: Time) -> Posed {
        let joints = self.joints(time);
        let [shoulder, elbow, wrist] = joints.places;
        let (upper, fore) = ((elbow - shoulder).normalize(), (wrist - elbow).normalize());
        // The elbow bends towards x.
        let towards = (fore - upper * upper.dot(&fore)).normalize();
        let axes = nalgebra::Matrix3::from_columns(&[towards, upper.cross(&towards), upper]);
        let turn = UnitQuaternion::from_rotation_matrix(&nalgebra::Rotation3::from_matrix_unchecked(axes));
        let chain = Chain::of(joints.places, turn);
        let is_bare = self.settings.cloth == ArmCloth::Bare;
        let share = if is_bare { 1.0 / 7.0 } else { 1.0 };
        let bent = joints.elbow / (0.25 * TAU);
        let slide = self.settings.slide_mm * 1e-3 * share * bent.powf(1.5);
        let wrinkle = self.settings.wrinkle_mm * 1e-3 * share * bent * bent;
        let fold = if is_bare { 0.0 } else { FOLD_M[0] };
        let mut vertices = Vec::with_capacity(self.grid.n_vertices());
        for &own in &self.along {
            // Hands do not slide.
            let covered = ((SLEEVE + 0.1 - own) / 0.15).clamp(0.0, 1.0);
            let loose = (-((own - 1.45) / 0.45).powi(2)).exp() * covered;
            let along = own - slide * loose / UNIT_M;
            let (middle, axes) = chain.ring(along, BEND_M);
            let [front, back, one, other] = along_table(RINGS, along);
            let is_end = front <= 0.0 && back <= 0.0;
            let twisted = joints.twist * ((own - 1.0) / 0.95).clamp(0.0, 1.0).powf(1.2);
            // Cloth lags behind the skin that turns below it.
            let lag = if is_bare { 0.0 } else { -0.25 * twisted * loose + 0.10 * bent * loose };
            let near_elbow = (-((own - 1.0) / 0.34).powi(2)).exp();
            let bulge = BULGE_M * bent * (-((own - 0.5) / 0.28).powi(2)).exp();
            for place in 0..self.grid.around {
                let angle = TAU * place as f64 / self.grid.around as f64;
                let (sine, cosine) = (angle + twisted + lag).sin_cos();
                let inner = (0.5 + 0.5 * cosine).powi(2);
                let at = Point3::new(0.048 * angle.cos(), 0.048 * angle.sin(), own * UNIT_M + 0.3 * slide);
                let standing = fold * f64::from(noise(&at, [FOLD_M[1], FOLD_M[1], 0.6 * FOLD_M[1]], self.seed));
                let phase = TAU * own * UNIT_M / WRINKLE_M + 3.0 * bent + 1.1 * (2.0 * angle + bent).sin();
                let wrinkles = wrinkle * near_elbow * inner * phase.sin();
                let off = if is_end { 0.0 } else { (standing + wrinkles) * covered + bulge * (0.5 + 0.5 * cosine) };
                let x = cosine * ((if cosine >= 0.0 { front } else { back }) + off);
                let y = sine * ((if sine >= 0.0 { one } else { other }) + off);
                vertices.push(middle + axes * Vector3::new(x, y, 0.0));
            }
        }
        let mut normals = vec![Vector3::zeros(); vertices.len()];
        self.grid.normals(&vertices, &mut normals);
        Posed { vertices, normals }
    }
}
