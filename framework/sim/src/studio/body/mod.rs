//! A person's body as surfaces over rings around the bones: trunk, head, arms, hands, legs, feet. Rings follow the bones, bend around elbows and knees, and are uneven as flesh is.
//!
//! Sizes are those of a person of 1.755 m; each of the people has shares of their own. Nothing of it is an ellipsoid or a cylinder.

use foveate_estimation::random::Random;
use nalgebra::{Matrix3, Point3, Rotation3, UnitQuaternion, Vector3};

use super::loft::{Grid, along_table};
use crate::painted::{Triangle, noise};
use crate::person::Joints;

/// Around an elbow or a knee the middle of the limb is bent over this length to both sides [m].
const BEND_M: f64 = 0.035;
/// How far cloth stands off from where it would lie, at most, its folds being as wide [m].
const FOLD_M: [f64; 2] = [0.004, 0.07];
/// At a right angle of elbow or knee cloth is wrinkled so high, and has slid so far towards the joint [m].
const WRINKLE_M: [f64; 2] = [0.005, 0.010];
/// Wrinkles are so far apart, or as near to that as rings of vertices can show [m].
const WRINKLES_APART_M: f64 = 0.024;

/// What a surface is a part of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Limb {
    Trunk,
    Head,
    Arm,
    Hand,
    Thumb,
    Leg,
    Foot,
}

/// Rings of each kind: places along it (trunk: of the spine from hips to shoulders; head: from its middle up [m]; arm and leg: of the bones; hand, thumb and foot: along it [m]), and
/// radii: to the front, to the back, to the outer and the inner side [m].
type Table = &'static [(f64, [f64; 4])];

const TRUNK: Table = &[
    (-0.19, [0.0, 0.0, 0.0, 0.0]),
    (-0.185, [0.04, 0.045, 0.07, 0.07]),
    (-0.12, [0.085, 0.10, 0.14, 0.14]),
    (-0.02, [0.102, 0.122, 0.172, 0.172]),
    (0.10, [0.104, 0.118, 0.170, 0.170]),
    (0.30, [0.104, 0.092, 0.145, 0.145]),
    (0.45, [0.110, 0.092, 0.146, 0.146]),
    (0.65, [0.122, 0.105, 0.165, 0.165]),
    (0.82, [0.120, 0.112, 0.180, 0.180]),
    (0.93, [0.098, 0.105, 0.188, 0.188]),
    (1.01, [0.070, 0.090, 0.176, 0.176]),
    (1.06, [0.054, 0.074, 0.130, 0.130]),
    (1.10, [0.052, 0.066, 0.086, 0.086]),
    (1.15, [0.052, 0.060, 0.060, 0.060]),
    (1.25, [0.052, 0.056, 0.054, 0.054]),
    (1.38, [0.050, 0.054, 0.052, 0.052]),
];
const HEAD: Table = &[
    (-0.128, [0.0, 0.0, 0.0, 0.0]),
    (-0.124, [0.050, 0.020, 0.026, 0.026]),
    (-0.112, [0.078, 0.044, 0.044, 0.044]),
    (-0.085, [0.088, 0.060, 0.058, 0.058]),
    (-0.045, [0.092, 0.078, 0.067, 0.067]),
    (0.0, [0.093, 0.096, 0.073, 0.073]),
    (0.04, [0.094, 0.103, 0.076, 0.076]),
    (0.075, [0.086, 0.097, 0.071, 0.071]),
    (0.10, [0.066, 0.078, 0.055, 0.055]),
    (0.115, [0.038, 0.046, 0.033, 0.033]),
    (0.121, [0.0, 0.0, 0.0, 0.0]),
];
const ARM: Table = &[
    (-0.15, [0.0, 0.0, 0.0, 0.0]),
    (-0.14, [0.026, 0.026, 0.022, 0.030]),
    (-0.08, [0.048, 0.048, 0.044, 0.050]),
    (0.05, [0.060, 0.061, 0.057, 0.055]),
    (0.30, [0.058, 0.052, 0.053, 0.050]),
    (0.60, [0.052, 0.048, 0.046, 0.045]),
    (0.90, [0.043, 0.044, 0.043, 0.042]),
    (1.05, [0.043, 0.046, 0.044, 0.042]),
    (1.25, [0.045, 0.043, 0.045, 0.043]),
    (1.55, [0.038, 0.036, 0.038, 0.036]),
    (1.85, [0.029, 0.029, 0.026, 0.025]),
    (2.08, [0.028, 0.028, 0.022, 0.021]),
];
const HAND: Table = &[
    (-0.01, [0.026, 0.026, 0.020, 0.019]),
    (0.02, [0.036, 0.034, 0.019, 0.018]),
    (0.06, [0.044, 0.040, 0.017, 0.019]),
    (0.095, [0.042, 0.041, 0.014, 0.016]),
    (0.14, [0.036, 0.036, 0.010, 0.012]),
    (0.172, [0.022, 0.024, 0.007, 0.009]),
    (0.185, [0.0, 0.0, 0.0, 0.0]),
];
const THUMB: Table = &[
    (0.0, [0.014, 0.014, 0.014, 0.014]),
    (0.03, [0.013, 0.013, 0.012, 0.012]),
    (0.06, [0.010, 0.010, 0.009, 0.009]),
    (0.072, [0.0, 0.0, 0.0, 0.0]),
];
const LEG: Table = &[
    (-0.20, [0.070, 0.085, 0.060, 0.050]),
    (0.0, [0.094, 0.108, 0.088, 0.070]),
    (0.20, [0.094, 0.096, 0.086, 0.080]),
    (0.55, [0.079, 0.076, 0.070, 0.066]),
    (0.85, [0.062, 0.058, 0.056, 0.055]),
    (1.0, [0.062, 0.053, 0.054, 0.053]),
    (1.15, [0.053, 0.056, 0.051, 0.051]),
    (1.35, [0.046, 0.070, 0.054, 0.053]),
    (1.60, [0.040, 0.052, 0.044, 0.042]),
    (1.85, [0.035, 0.041, 0.034, 0.032]),
    (2.02, [0.037, 0.043, 0.034, 0.033]),
];
/// Of feet: upwards, downwards, and to both sides, of a middle 35 mm above the sole.
const FOOT: Table = &[
    (-0.070, [0.0, 0.0, 0.0, 0.0]),
    (-0.066, [0.028, 0.026, 0.020, 0.020]),
    (-0.045, [0.050, 0.034, 0.032, 0.031]),
    (0.0, [0.058, 0.035, 0.036, 0.034]),
    (0.05, [0.044, 0.033, 0.038, 0.034]),
    (0.10, [0.026, 0.034, 0.046, 0.038]),
    (0.145, [0.014, 0.035, 0.047, 0.040]),
    (0.185, [0.004, 0.034, 0.033, 0.034]),
    (0.200, [-0.008, 0.030, 0.016, 0.018]),
    (0.206, [-0.020, 0.024, 0.0, 0.0]),
];

impl Limb {
    pub fn table(self) -> Table {
        match self {
            Limb::Trunk => TRUNK,
            Limb::Head => HEAD,
            Limb::Arm => ARM,
            Limb::Hand => HAND,
            Limb::Thumb => THUMB,
            Limb::Leg => LEG,
            Limb::Foot => FOOT,
        }
    }

    /// Rings, and places around each, at the coarseness of people that are seen whole.
    fn counts(self) -> [usize; 2] {
        match self {
            Limb::Trunk => [42, 32],
            Limb::Head => [30, 36],
            Limb::Arm => [34, 18],
            Limb::Hand => [14, 16],
            Limb::Thumb => [8, 10],
            Limb::Leg => [40, 22],
            Limb::Foot => [18, 18],
        }
    }

    /// Whether rings are more like rounded boxes than like ellipses: exponent of Lamé's curve.
    fn power(self) -> f64 {
        match self {
            Limb::Trunk => 2.5,
            Limb::Hand | Limb::Foot => 2.6,
            _ => 2.0,
        }
    }

    /// About how far around it is, and how long [m].
    pub fn extent_m(self) -> [f64; 2] {
        match self {
            Limb::Trunk => [0.95, 0.86],
            Limb::Head => [0.55, 0.30],
            Limb::Arm => [0.30, 0.62],
            Limb::Hand => [0.18, 0.20],
            Limb::Thumb => [0.07, 0.08],
            Limb::Leg => [0.45, 0.93],
            Limb::Foot => [0.24, 0.28],
        }
    }
}

/// What one of the people is like: shares of the average.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Build {
    /// Girth of trunk and limbs.
    pub girth: f64,
    /// Breadth of shoulders, of hips, and depth of the belly.
    pub shoulders: f64,
    pub hips: f64,
    pub belly: f64,
    /// Length of hands and feet.
    pub hands: f64,
    /// Of arms up to where a sleeve ends, and of legs to where trousers end [bones].
    pub sleeve: f64,
    pub trousers: f64,
    /// How far cloth stands off [m].
    pub loose_m: f64,
    /// Hair stands off the head so far [m], and reaches down behind it to this height above its middle [m].
    pub hair_m: [f64; 2],
    /// How high over the head's middle the hair line is in front [m].
    pub hair_line_m: f64,
}

impl Build {
    /// Of a person.
    pub fn draw(random: &mut Random) -> Self {
        let mut share = |spread: f64| 1.0 + spread * random.normal().clamp(-2.0, 2.0);
        let (girth, shoulders, hips, belly, hands) = (share(0.07), share(0.04), share(0.05), share(0.10), share(0.04));
        let sleeve = [0.75, 1.85, 1.9][random.below(3) as usize];
        let trousers = [1.95, 1.95, 1.95, 1.05][random.below(4) as usize];
        let has_long_hair = random.below(3) == 0;
        Self {
            girth,
            shoulders,
            hips,
            belly,
            hands,
            sleeve,
            trousers,
            loose_m: random.uniform_in(0.005, 0.014),
            hair_m: if has_long_hair { [0.018, -0.17] } else { [random.uniform_in(0.006, 0.014), -0.055] },
            hair_line_m: random.uniform_in(0.055, 0.072),
        }
    }

    /// How much hair there is at a place of the head, 0 to 1.
    pub fn hair(&self, along: f64, angle: f64, seed: u32) -> f64 {
        let aside = angle.min(std::f64::consts::TAU - angle);
        // The line runs from the forehead back over the temples, and down behind the ears.
        let behind = ((aside - 0.9) / 0.9).clamp(0.0, 1.0);
        let line = self.hair_line_m + (self.hair_m[1] - self.hair_line_m) * behind * behind * (3.0 - 2.0 * behind);
        let at = Point3::new(0.08 * angle.cos(), 0.08 * angle.sin(), along);
        let ragged = 0.006 * f64::from(noise(&at, [0.012; 3], seed ^ 91));
        ((along + ragged - line) / 0.008 + 0.5).clamp(0.0, 1.0)
    }
}

/// One surface of a body.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Piece {
    pub limb: Limb,
    /// 0 left, 1 right; of trunk and head 0.
    pub side: usize,
    pub grid: Grid,
    /// Where along its table each ring lies.
    pub along: Vec<f64>,
    /// By how much each vertex stands off where its ring has it [m].
    relief: Vec<f32>,
}

/// The surfaces of a person's body.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Body {
    pub build: Build,
    pub pieces: Vec<Piece>,
}

/// The middle and the axes of a ring: where its angle begins, where it is a quarter on, the way along the limb.
pub(super) type Ring = (Point3<f64>, Matrix3<f64>);

impl Body {
    /// `finer` times as many rings, and places around each, as people have who are seen whole.
    pub fn new(build: Build, finer: usize, seed: u32) -> Self {
        let mut pieces: Vec<Piece> = Vec::new();
        let mut first = 0;
        for (limb, side) in [
            (Limb::Trunk, 0),
            (Limb::Head, 0),
            (Limb::Arm, 0),
            (Limb::Arm, 1),
            (Limb::Hand, 0),
            (Limb::Hand, 1),
            (Limb::Thumb, 0),
            (Limb::Thumb, 1),
            (Limb::Leg, 0),
            (Limb::Leg, 1),
            (Limb::Foot, 0),
            (Limb::Foot, 1),
        ] {
            let piece = Piece::new(limb, side, first, finer, &build, seed);
            first += piece.grid.n_vertices();
            pieces.push(piece);
        }
        Self { build, pieces }
    }

    /// Triangles of all pieces, and of each where its own begin.
    pub fn triangles(&self) -> (Vec<Triangle>, Vec<usize>) {
        let (mut triangles, mut starts) = (Vec::new(), Vec::new());
        for piece in &self.pieces {
            starts.push(triangles.len());
            piece.grid.triangles(&mut triangles);
        }
        (triangles, starts)
    }

    /// Vertices and normals of the body around these joints.
    pub fn pose(&self, joints: &Joints, vertices: &mut Vec<Point3<f64>>, normals: &mut Vec<Vector3<f32>>) {
        vertices.clear();
        let frames = Frames::new(joints);
        for piece in &self.pieces {
            piece.pose(&self.build, &frames, vertices);
        }
        normals.resize(vertices.len(), Vector3::zeros());
        self.pieces.iter().for_each(|it| it.grid.normals(vertices, normals));
    }
}

impl Piece {
    fn new(limb: Limb, side: usize, first: usize, finer: usize, build: &Build, seed: u32) -> Self {
        let [rings, around] = limb.counts();
        let grid = Grid { rings: rings * finer, around: around * finer, first };
        let table = limb.table();
        let (from, to) = (table[0].0, table[table.len() - 1].0);
        let mut along: Vec<f64> =
            (0..grid.rings).map(|it| from + (to - from) * it as f64 / (grid.rings - 1) as f64).collect();
        // Ends that are closed are rounded off by rings that crowd there.
        for (end, at) in [(0, 1), (table.len() - 1, grid.rings - 2)] {
            if table[end].1.iter().all(|it| *it <= 0.0) {
                let beside = if end == 0 { 1 } else { end - 1 };
                along[at] = table[beside].0;
            }
        }
        let mut piece = Self { limb, side, grid, along, relief: Vec::new() };
        let relief = |ring: usize, place: usize| {
            let angle = std::f64::consts::TAU * place as f64 / grid.around as f64;
            piece.relief(build, piece.along[ring], angle, seed.wrapping_add(side as u32 * 77)) as f32
        };
        let relief = (0..grid.n_vertices()).map(|it| relief(it / grid.around, it % grid.around)).collect();
        piece.relief = relief;
        piece
    }

    /// How long a unit along the table is, about [m].
    fn unit_m(&self) -> f64 {
        match self.limb {
            Limb::Trunk => 0.54,
            Limb::Arm => 0.27,
            Limb::Leg => 0.42,
            _ => 1.0,
        }
    }

    /// Whether cloth covers it there.
    pub fn is_covered(&self, build: &Build, along: f64) -> bool {
        match self.limb {
            Limb::Trunk => along < 1.09,
            Limb::Arm => along < build.sleeve,
            Limb::Leg => along < build.trousers,
            _ => false,
        }
    }

    /// What stands off the average: cloth with its folds and hems, a nose, hair.
    fn relief(&self, build: &Build, along: f64, angle: f64, seed: u32) -> f64 {
        let (cosine, sine) = (angle.cos(), angle.sin());
        match self.limb {
            Limb::Trunk | Limb::Arm | Limb::Leg if self.is_covered(build, along) => {
                let at = Point3::new(0.1 * cosine, 0.1 * sine, along * self.unit_m());
                let folds = FOLD_M[0] * f64::from(noise(&at, [FOLD_M[1], FOLD_M[1], 0.4 * FOLD_M[1]], seed));
                // A shirt hangs over the trousers' waist.
                let hem = if self.limb == Limb::Trunk && along > 0.0 { 0.008 } else { 0.0 };
                let is_narrow = self.limb == Limb::Trunk && along > 1.0;
                if is_narrow { 0.003 } else { build.loose_m + folds + hem }
            }
            Limb::Head => {
                let aside = angle.min(std::f64::consts::TAU - angle);
                let bump = |height: f64, at: f64, wide: f64, tall: f64| {
                    height * (-(aside / wide).powi(2) - ((along - at) / tall).powi(2)).exp()
                };
                let nose = bump(0.024, -0.030, 0.15, 0.016) + bump(0.012, -0.005, 0.12, 0.022);
                let eyes = -0.006 * (-((aside - 0.34) / 0.15).powi(2) - ((along - 0.010) / 0.012).powi(2)).exp();
                let lips = bump(0.005, -0.070, 0.25, 0.012);
                let ears = 0.016 * (-((aside - 1.62) / 0.14).powi(2) - ((along + 0.012) / 0.028).powi(2)).exp();
                let is_hair = build.hair(along, angle, seed);
                nose + eyes + lips + ears + build.hair_m[0] * is_hair
            }
            _ => 0.0,
        }
    }

    fn pose(&self, build: &Build, frames: &Frames<'_>, vertices: &mut Vec<Point3<f64>>) {
        let size = frames.joints.size;
        let power = self.limb.power();
        let places: Vec<[f64; 2]> = (0..self.grid.around)
            .map(|place| {
                let angle = std::f64::consts::TAU * place as f64 / self.grid.around as f64;
                let (cosine, sine) = (angle.cos(), angle.sin());
                let length = (cosine.abs().powf(power) + sine.abs().powf(power)).powf(-1.0 / power);
                [cosine * length, sine * length]
            })
            .collect();
        let bend = match self.limb {
            Limb::Arm => Some(frames.arms[self.side].bend()),
            Limb::Leg => Some(frames.legs[self.side].bend()),
            _ => None,
        };
        let spacing = (self.along[self.along.len() - 1] - self.along[0]) * self.unit_m() / self.along.len() as f64;
        let apart = WRINKLES_APART_M.max(3.2 * spacing);
        for (ring, &along) in self.along.iter().enumerate() {
            let bend = bend.filter(|_| self.is_covered(build, along));
            let near = (-((along - 1.0) / 0.34).powi(2)).exp();
            let slid = bend.map_or(0.0, |(bent, _)| {
                WRINKLE_M[1] * bent.powf(1.5) * (-((along - 1.45) / 0.45).powi(2)).exp() / self.unit_m()
            });
            let (middle, axes) = self.ring(build, frames, along - slid);
            let [mut front, mut back, mut outer, mut inner] = along_table(self.limb.table(), along);
            match self.limb {
                Limb::Trunk => {
                    let wide = build.hips + (build.shoulders - build.hips) * ((along - 0.2) / 0.6).clamp(0.0, 1.0);
                    let round = if along < 1.05 { build.girth * wide } else { 1.0 };
                    let belly = 1.0 + (build.belly * build.girth - 1.0) * (-((along - 0.3) / 0.35).powi(2)).exp();
                    (front, back) = (front * belly * build.girth, back * build.girth);
                    (outer, inner) = (outer * round, inner * round);
                }
                Limb::Arm | Limb::Leg => {
                    [front, back, outer, inner] = [front, back, outer, inner].map(|it| it * build.girth);
                }
                _ => (),
            }
            // Sideways is to the left on the trunk, to the right on limbs.
            let [quarter, opposite] = if self.side == 0 { [inner, outer] } else { [outer, inner] };
            let relief = &self.relief[ring * self.grid.around..][..self.grid.around];
            let is_end = front <= 0.0 && back <= 0.0 && outer <= 0.0;
            vertices.extend(places.iter().zip(relief).enumerate().map(|(place, ([cosine, sine], relief))| {
                let wrinkle = bend.map_or(0.0, |(bent, towards)| {
                    let angle = std::f64::consts::TAU * place as f64 / self.grid.around as f64;
                    let inner = (0.5 + 0.5 * (angle - towards).cos()).powi(2);
                    let waves = std::f64::consts::TAU * along * self.unit_m() / apart;
                    WRINKLE_M[0] * bent * bent * near * inner * (waves + 3.0 * bent + (2.0 * angle + bent).sin()).sin()
                });
                let off = if is_end { 0.0 } else { f64::from(*relief) + wrinkle };
                let x = cosine * ((if *cosine >= 0.0 { front } else { back }) + off);
                let y = sine * ((if *sine >= 0.0 { quarter } else { opposite }) + off);
                middle + axes * Vector3::new(x * size, y * size, 0.0)
            }));
        }
    }

    fn ring(&self, build: &Build, frames: &Frames<'_>, along: f64) -> Ring {
        let joints = frames.joints;
        let size = joints.size;
        match self.limb {
            Limb::Trunk => frames.trunk(along),
            Limb::Head => {
                let axes = joints.head.rotation.to_rotation_matrix();
                (joints.head * Point3::new(0.0, 0.0, along * size), *axes.matrix())
            }
            Limb::Arm => frames.arms[self.side].ring(along, BEND_M * size),
            Limb::Leg => frames.legs[self.side].ring(along, BEND_M * size),
            Limb::Hand => {
                let (_, axes) = frames.arms[self.side].ring(2.0, 0.0);
                (joints.wrists[self.side] + axes.column(2) * (along * build.hands * size), axes)
            }
            Limb::Thumb => {
                let (_, axes) = frames.arms[self.side].ring(2.0, 0.0);
                let begin = joints.wrists[self.side] + axes * Vector3::new(0.028, 0.0, 0.035) * size;
                let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), 0.6);
                let axes = axes * turn.matrix();
                (begin + axes.column(2) * (along * build.hands * size), axes)
            }
            Limb::Foot => {
                let axes = frames.foot(self.side);
                // 35 mm above the sole, which the ankle is 60 mm above.
                let middle = joints.ankles[self.side] - axes.column(0) * (0.025 * size);
                (middle + axes.column(2) * (along * build.hands * size), axes)
            }
        }
    }
}

/// What rings stand on.
struct Frames<'j> {
    joints: &'j Joints,
    pelvis: UnitQuaternion<f64>,
    chest: UnitQuaternion<f64>,
    arms: [Chain; 2],
    legs: [Chain; 2],
}

/// Two bones, one after the other.
pub(super) struct Chain {
    joints: [Point3<f64>; 3],
    /// Axes at each: x to the front, y to the right, z along it.
    turns: [UnitQuaternion<f64>; 2],
}

/// The axes to the front, to the left and up, that have `left` about to the left.
fn upright(left: Vector3<f64>, up: Vector3<f64>, forward: Vector3<f64>) -> UnitQuaternion<f64> {
    let up = up.try_normalize(1e-9).unwrap_or(Vector3::z());
    let front = left.cross(&up).try_normalize(1e-9).unwrap_or(forward);
    let left = up.cross(&front).try_normalize(1e-9).unwrap_or(Vector3::y());
    let axes = Matrix3::from_columns(&[left.cross(&up), left, up]);
    UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes))
}

/// The shortest turn from one direction to another; half a turn about an axis across where they are opposite.
fn between(from: &Vector3<f64>, to: &Vector3<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::rotation_between(from, to).unwrap_or_else(|| {
        let across = nalgebra::Unit::new_normalize(from.cross(&Vector3::new(0.31, 0.52, 0.79)));
        UnitQuaternion::from_axis_angle(&across, std::f64::consts::PI)
    })
}

impl Chain {
    /// Bones from joint to joint; the first one's axes are those of `rest`, whose z points along `hangs`, turned the shortest way.
    fn new(joints: [Point3<f64>; 3], rest: &UnitQuaternion<f64>, hangs: Vector3<f64>) -> Self {
        let bone = |from: usize| (joints[from + 1] - joints[from]).try_normalize(1e-9).unwrap_or(-Vector3::z());
        let [first, second] = [bone(0), bone(1)];
        let down = rest * Vector3::z();
        // By way of where it hangs when at ease: opposite of that no arm goes.
        let eased = between(&down, &hangs) * rest;
        let upper = between(&hangs, &first) * eased;
        Self { joints, turns: [upper, between(&first, &second) * upper] }
    }

    /// Bones from joint to joint; the first one's axes are `first`, whose z points along it.
    pub fn of(joints: [Point3<f64>; 3], first: UnitQuaternion<f64>) -> Self {
        let second = (joints[2] - joints[1]).try_normalize(1e-9).unwrap_or(-Vector3::z());
        Self { joints, turns: [first, between(&(first * Vector3::z()), &second) * first] }
    }

    /// By how many right angles it is bent, and towards where around the first bone [rad].
    fn bend(&self) -> (f64, f64) {
        let second = self.turns[0].inverse() * (self.turns[1] * Vector3::z());
        (second.z.clamp(-1.0, 1.0).acos() / std::f64::consts::FRAC_PI_2, second.y.atan2(second.x))
    }

    /// At `along` bones from the first joint on.
    pub fn ring(&self, along: f64, bend: f64) -> Ring {
        let [a, b, c] = self.joints;
        let lengths = [(b - a).norm(), (c - b).norm()];
        let at = if along < 1.0 { along * lengths[0] - lengths[0] } else { (along - 1.0) * lengths[1] };
        let [first, second] = self.turns.map(|it| it * Vector3::z());
        let share =
            if bend > 0.0 { ((at + bend) / (2.0 * bend)).clamp(0.0, 1.0) } else { f64::from(u8::from(at > 0.0)) };
        let middle = if share <= 0.0 {
            b + first * at
        } else if share >= 1.0 {
            b + second * at
        } else {
            // Bézier's curve from one bone to the other.
            b - first * (bend * (1.0 - share).powi(2)) + second * (bend * share * share)
        };
        let smooth = share * share * (3.0 - 2.0 * share);
        let turn = self.turns[0].try_slerp(&self.turns[1], smooth, 1e-9).unwrap_or(self.turns[1]);
        (middle, *turn.to_rotation_matrix().matrix())
    }
}

impl<'j> Frames<'j> {
    fn new(joints: &'j Joints) -> Self {
        let middle = |[a, b]: [Point3<f64>; 2]| nalgebra::center(&a, &b);
        let spine = middle(joints.shoulders) - middle(joints.hips);
        let pelvis = upright(joints.hips[0] - joints.hips[1], spine, joints.forward);
        let chest = upright(joints.shoulders[0] - joints.shoulders[1], spine, joints.forward);
        // Front, right, down.
        let over = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::PI);
        let chain = |side: usize, is_arm: bool| {
            let out = if side == 0 { 1.0 } else { -1.0 };
            if is_arm {
                let hangs = (chest * Vector3::new(0.25, 0.5 * out, -0.83)).normalize();
                let of = [joints.shoulders[side], joints.elbows[side], joints.wrists[side]];
                Chain::new(of, &(chest * over), hangs)
            } else {
                let hangs = (pelvis * Vector3::new(0.3, 0.1 * out, -0.95)).normalize();
                Chain::new([joints.hips[side], joints.knees[side], joints.ankles[side]], &(pelvis * over), hangs)
            }
        };
        let arms = [chain(0, true), chain(1, true)];
        Self { joints, pelvis, chest, arms, legs: [chain(0, false), chain(1, false)] }
    }

    fn trunk(&self, along: f64) -> Ring {
        let middle = |[a, b]: [Point3<f64>; 2]| nalgebra::center(&a, &b);
        let (hips, neck) = (middle(self.joints.hips), middle(self.joints.shoulders));
        let head = Point3::from(self.joints.head.translation.vector);
        // A neck as long as that of the built-in body reaches its head's middle at 1.39.
        let place =
            if along <= 1.0 { hips + (neck - hips) * along } else { neck + (head - neck) * ((along - 1.0) / 0.39) };
        let share = (along / 0.9).clamp(0.0, 1.0);
        let share = share * share * (3.0 - 2.0 * share);
        let mut turn = self.pelvis.try_slerp(&self.chest, share, 1e-9).unwrap_or(self.chest);
        if along > 1.0 {
            turn = turn.try_slerp(&self.joints.head.rotation, ((along - 1.0) / 0.39).min(1.0), 1e-9).unwrap_or(turn);
        }
        (place, *turn.to_rotation_matrix().matrix())
    }

    /// Axes of a foot: up, to the right, ahead.
    fn foot(&self, side: usize) -> Matrix3<f64> {
        let (_, leg) = self.legs[side].ring(2.0, 0.0);
        let ahead: Vector3<f64> = leg.column(0).into();
        let ankle = self.joints.ankles[side];
        // On the floor it lies flat; in the air it hangs a little.
        let level = Vector3::new(ahead.x, ahead.y, 0.0).try_normalize(0.1).unwrap_or(ahead);
        let high = ((ankle.z / self.joints.size - 0.08) / 0.10).clamp(0.0, 1.0);
        let hangs = (ahead + Vector3::from(leg.column(2)) * 0.35).normalize();
        let ahead = level.lerp(&hangs, high).try_normalize(1e-6).unwrap_or(level);
        let right = Vector3::from(leg.column(1));
        let up = right.cross(&ahead).try_normalize(1e-6).unwrap_or(Vector3::z());
        // x × y = z: up × right' = ahead.
        Matrix3::from_columns(&[up, ahead.cross(&up), ahead])
    }
}

#[cfg(test)]
mod tests;
