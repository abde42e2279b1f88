//! Voxels of tubes with round ends, for tests.

use std::collections::BTreeMap;

use foveate_estimation::random::Random;
use nalgebra::{Point3, Rotation3, Vector3};

use super::field::{ENDLESS, VoxelField};
use super::parts::Joint;
use super::tracker::{BodyTracker, TrackerOptions};

/// Edge of a voxel [m].
pub(super) const SIZE: f64 = 0.03;
/// The corner of voxel (0, 0, 0) that is least in x, y, z [m].
pub(super) const ORIGIN: Point3<f64> = Point3::new(-0.6, -0.9, 0.0);

/// Ends and radius [m].
pub(super) type Tube = ([Point3<f64>; 2], f64);

/// A person who stands at the origin with hanging arms.
pub(super) fn somebody() -> Vec<Tube> {
    let p = |x: f64, y: f64, z: f64| Point3::new(x, y, z);
    let mut tubes =
        vec![([p(0.0, 0.0, 1.62), p(0.0, 0.0, 1.65)], 0.10), ([p(0.0, 0.0, 1.40), p(0.0, 0.0, 1.60)], 0.055)];
    for side in [-1.0, 1.0] {
        tubes.push(([p(0.0, side * 0.08, 0.95), p(0.0, side * 0.09, 1.36)], 0.105));
        tubes.push(([p(0.0, 0.0, 1.42), p(0.0, side * 0.18, 1.42)], 0.06));
        tubes.push(([p(0.0, side * 0.18, 1.42), p(0.0, side * 0.27, 1.14)], 0.046));
        tubes.push(([p(0.0, side * 0.27, 1.14), p(0.08, side * 0.30, 0.80)], 0.04));
        tubes.push(([p(0.0, side * 0.09, 0.90), p(0.10, side * 0.16, 0.50)], 0.075));
        tubes.push(([p(0.10, side * 0.16, 0.50), p(0.0, side * 0.18, 0.06)], 0.055));
        tubes.push(([p(0.0, side * 0.18, 0.06), p(0.16, side * 0.18, 0.06)], 0.04));
    }
    tubes
}

/// Places in the grid of what lies in any of the tubes.
pub(super) fn indices(tubes: &[Tube]) -> Vec<[u16; 3]> {
    let is_in = |index: &[u16; 3]| {
        let place = ORIGIN + Vector3::from(index.map(|it| f64::from(it) + 0.5)) * SIZE;
        tubes.iter().any(|([a, b], radius)| {
            let along = b - a;
            let share = ((place - a).dot(&along) / along.norm_squared()).clamp(0.0, 1.0);
            (place - (a + along * share)).norm() < *radius
        })
    };
    let all = (0..80_u16).flat_map(|x| (0..60_u16).flat_map(move |y| (0..60_u16).map(move |z| [x, y, z])));
    all.filter(is_in).collect()
}

pub(super) fn field(tubes: &[Tube]) -> VoxelField {
    VoxelField::new(SIZE, &ORIGIN, &indices(tubes), ENDLESS).unwrap()
}

/// How a person stands.
#[derive(Debug, Clone)]
pub(super) struct Stance {
    /// [m]
    pub stature: f64,
    /// Across, over what is common [–].
    pub wide: f64,
    /// Legs outwards [rad].
    pub spread: f64,
    /// Arms outwards, left and right [rad].
    pub arms: [f64; 2],
    /// Elbows, left and right [rad].
    pub elbows: [f64; 2],
    /// Knees, left and right; thighs go forward half as far [rad].
    pub knees: [f64; 2],
    /// With thighs ahead and calves down, whatever the knees are.
    pub sits: bool,
    /// The trunk forwards [rad].
    pub lean: f64,
    /// [rad]
    pub heading: f64,
    /// [m]
    pub at: [f64; 2],
}

impl Stance {
    /// An upright person whose legs are parallel or nearly so, of any size.
    pub fn upright(random: &mut Random) -> Self {
        let arm = random.uniform_in(0.12, 1.4);
        Self {
            stature: random.uniform_in(1.15, 1.95),
            wide: random.uniform_in(0.85, 1.2),
            spread: random.uniform_in(0.0, 0.12),
            arms: [arm, arm + random.uniform_in(-0.1, 0.1)],
            elbows: [random.uniform_in(0.05, 0.3), random.uniform_in(0.05, 0.3)],
            knees: [0.05; 2],
            sits: false,
            lean: random.uniform_in(-0.05, 0.1),
            heading: random.uniform_in(0.0, std::f64::consts::TAU),
            at: [random.uniform_in(-0.3, 0.3), random.uniform_in(-0.3, 0.3)],
        }
    }

    /// The same in any stance: arms up or down, elbows and knees bent, stooping.
    pub fn vary(&mut self, random: &mut Random) {
        self.arms = [0; 2].map(|_| random.uniform_in(0.1, 2.7));
        self.elbows = [0; 2].map(|_| random.uniform_in(0.0, 2.0));
        self.knees = [0; 2].map(|_| random.uniform_in(0.0, 1.0));
        self.lean = random.uniform_in(-0.1, 0.6);
    }

    /// Its tubes, and where its joints are. Its proportions are not those of the model.
    pub fn drawn(&self) -> (Vec<Tube>, Vec<(Joint, Point3<f64>)>) {
        let s = self.stature / 1.75;
        let w = s * self.wide;
        let lean = Rotation3::from_axis_angle(&Vector3::y_axis(), self.lean);
        let v = |x: f64, y: f64, z: f64| Vector3::new(x, y, z);
        let pelvis = Vector3::zeros();
        let chest = lean * v(0.0, 0.0, 0.44 * s);
        let neck = chest + lean * v(0.0, 0.0, 0.09 * s);
        let head = neck + v(0.03, 0.0, 0.16) * s;
        let mut joints = vec![(Joint::Head, head), (Joint::Neck, neck)];
        let mut tubes = vec![
            ([pelvis, pelvis + lean * v(0.0, 0.0, 0.12 * s)], 0.115 * w),
            ([chest, head], 0.055 * s),
            ([head - v(0.0, 0.0, 0.03 * s), head + v(0.0, 0.0, 0.035 * s)], 0.085 * s),
        ];
        for (i, side) in [1.0, -1.0].into_iter().enumerate() {
            let names = if i == 0 {
                [
                    Joint::LeftShoulder,
                    Joint::LeftElbow,
                    Joint::LeftWrist,
                    Joint::LeftHip,
                    Joint::LeftKnee,
                    Joint::LeftAnkle,
                ]
            } else {
                [
                    Joint::RightShoulder,
                    Joint::RightElbow,
                    Joint::RightWrist,
                    Joint::RightHip,
                    Joint::RightKnee,
                    Joint::RightAnkle,
                ]
            };
            tubes.push((
                [v(0.0, side * 0.07 * w, 0.03 * s), chest + lean * v(0.0, side * 0.088 * w, -0.02 * s)],
                0.105 * w,
            ));
            let shoulder = chest + lean * v(0.0, side * 0.185 * w, 0.03 * s);
            let way = lean * v(0.0, side * self.arms[i].sin(), -self.arms[i].cos());
            let elbow = shoulder + way * (0.29 * s);
            // Elbows bend forwards.
            let about = nalgebra::Unit::new_normalize(way.cross(&Vector3::x()));
            let lower = Rotation3::from_axis_angle(&about, self.elbows[i]) * way;
            let wrist = elbow + lower * (0.26 * s);
            tubes.push(([shoulder, elbow], 0.047 * s * self.wide.sqrt()));
            tubes.push(([elbow, wrist], 0.038 * s));
            tubes.push(([wrist, wrist + lower * (0.1 * s)], 0.036 * s));
            let hip = v(0.0, side * 0.09 * w, -0.02 * s);
            let bends = if self.sits { [1.5, 0.1] } else { [self.knees[i] / 2.0, -self.knees[i] / 2.0] };
            let [thigh, calf] = bends.map(|it| v(it.sin(), side * self.spread, -it.cos()).normalize());
            let knee = hip + thigh * (0.43 * s);
            let ankle = knee + calf * (0.42 * s);
            tubes.push(([hip, knee], 0.075 * s * self.wide.sqrt()));
            tubes.push(([knee, ankle], 0.052 * s));
            tubes.push(([ankle, ankle + v(0.17, 0.0, -0.04) * s], 0.04 * s));
            joints.extend(names.into_iter().zip([shoulder, elbow, wrist, hip, knee, ankle]));
        }
        let lowest = tubes.iter().map(|([a, b], radius)| a.z.min(b.z) - radius).fold(f64::INFINITY, f64::min);
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), self.heading);
        let stand = |it: Vector3<f64>| Point3::from(turn * (it - v(0.0, 0.0, lowest)) + v(self.at[0], self.at[1], 0.0));
        let tubes = tubes.into_iter().map(|(ends, radius)| (ends.map(stand), radius)).collect();
        (tubes, joints.into_iter().map(|(joint, at)| (joint, stand(at))).collect())
    }
}

/// A long coat around a standing person: it hides all of the legs but the shins, and goes out to the hem.
pub(super) fn coat(joints: &[(Joint, Point3<f64>)]) -> Vec<Tube> {
    let at = |joint: Joint| joints.iter().find(|it| it.0 == joint).unwrap().1;
    let [neck, left, right] = [Joint::Neck, Joint::LeftHip, Joint::RightHip].map(at);
    let across = (left - right).normalize();
    let ahead = across.cross(&Vector3::z());
    let hem = nalgebra::center(&at(Joint::LeftKnee), &at(Joint::RightKnee)) - Vector3::z() * 0.05;
    let waist = neck - Vector3::z() * 0.22;
    let corners = [
        (1.0, 1.0),
        (1.0, -1.0),
        (-1.0, 1.0),
        (-1.0, -1.0),
        (0.0, 1.0),
        (0.0, -1.0),
        (1.0, 0.0),
        (-1.0, 0.0),
        (0.0, 0.0),
    ];
    let from_waist = |(x, y): (f64, f64)| {
        let way = across * x + ahead * y * 0.7;
        ([waist + way * 0.06, hem + way * 0.13], 0.09)
    };
    corners.map(from_waist).to_vec()
}

/// A chair of any size with a seat, a back and four legs, or one column.
pub(super) fn chair(at: [f64; 2], random: &mut Random) -> Vec<Tube> {
    let mut of = |low: f64, high: f64| random.uniform_in(low, high);
    let [x, y] = [of(0.18, 0.25), of(0.19, 0.25)];
    let [seat, back, leg] = [of(0.40, 0.5), of(0.8, 1.15), of(0.018, 0.03)];
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), of(0.0, std::f64::consts::TAU));
    let has_column = of(0.0, 1.0) < 0.3;
    let p = |x: f64, y: f64, z: f64| Point3::from(turn * Vector3::new(x, y, z) + Vector3::new(at[0], at[1], 0.0));
    // Slats beside each other make a plate.
    let slats = (-8..=8).map(|it| y * f64::from(it) / 8.0);
    let mut tubes: Vec<Tube> = slats
        .flat_map(|y| [([p(-x, y, seat), p(x, y, seat)], 0.03), ([p(-x, y, seat), p(-x, y, back)], 0.025)])
        .collect();
    if has_column {
        tubes.push(([p(0.0, 0.0, 0.06), p(0.0, 0.0, seat)], 0.035));
        let foot = |it: u8| Rotation3::from_axis_angle(&Vector3::z_axis(), 1.2566 * f64::from(it)) * Vector3::x() * 0.3;
        tubes.extend((0..5).map(foot).map(|it| ([p(0.0, 0.0, 0.08), p(it.x, it.y, 0.04)], 0.03)));
    } else {
        let corners = [[-x, -y], [-x, y], [x, -y], [x, y]];
        tubes.extend(corners.map(|[x, y]| ([p(0.9 * x, 0.9 * y, 0.02), p(0.9 * x, 0.9 * y, seat)], leg)));
    }
    tubes
}

/// A table of any size on four legs.
pub(super) fn table(at: [f64; 2], random: &mut Random) -> Vec<Tube> {
    let mut of = |low: f64, high: f64| random.uniform_in(low, high);
    let [x, y, z] = [of(0.4, 0.9), of(0.28, 0.5), of(0.4, 0.8)];
    let [thick, leg] = [of(0.02, 0.035), of(0.02, 0.04)];
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), of(0.0, std::f64::consts::TAU));
    let p = |x: f64, y: f64, z: f64| Point3::from(turn * Vector3::new(x, y, z) + Vector3::new(at[0], at[1], 0.0));
    let slats = (-14..=14).map(|it| y * f64::from(it) / 14.0);
    let mut tubes: Vec<Tube> = slats.map(|y| ([p(-x, y, z), p(x, y, z)], thick)).collect();
    let corners = [[-x, -y], [-x, y], [x, -y], [x, y]];
    tubes.extend(corners.map(|[x, y]| ([p(0.92 * x, 0.9 * y, 0.02), p(0.92 * x, 0.9 * y, z)], leg)));
    tubes
}

/// A pot with a stem and up to 18 thick branches.
pub(super) fn plant(at: [f64; 2], random: &mut Random) -> Vec<Tube> {
    let height = random.uniform_in(0.9, 1.9);
    let p = |x: f64, y: f64, z: f64| Point3::new(at[0] + x, at[1] + y, z);
    let mut tubes = vec![
        ([p(0.0, 0.0, 0.1), p(0.0, 0.0, 0.25)], random.uniform_in(0.12, 0.2)),
        ([p(0.0, 0.0, 0.2), p(0.0, 0.0, 0.7 * height)], 0.03),
    ];
    for _ in 0..5 + random.below(14) {
        let mut of = |low: f64, high: f64| random.uniform_in(low, high);
        let (angle, length, from) = (of(0.0, std::f64::consts::TAU), of(0.15, 0.45), of(0.4, 0.75) * height);
        let (to, radius) = ((from + of(-0.1, 0.35)).min(height), of(0.03, 0.09));
        tubes.push(([p(0.0, 0.0, from), p(length * angle.cos(), length * angle.sin(), to)], radius));
    }
    tubes
}

/// The connected component of each voxel, corners included.
pub(super) fn components(indices: &[[u16; 3]]) -> Vec<u16> {
    let place_of: BTreeMap<[u16; 3], usize> = indices.iter().enumerate().map(|(place, it)| (*it, place)).collect();
    let mut components = vec![u16::MAX; indices.len()];
    let mut n = 0;
    for first in 0..indices.len() {
        if components[first] != u16::MAX {
            continue;
        }
        let mut open = vec![first];
        while let Some(place) = open.pop() {
            if std::mem::replace(&mut components[place], n) == n {
                continue;
            }
            for shift in 0..27_u16 {
                let steps = [shift % 3, shift / 3 % 3, shift / 9];
                let beside = [0, 1, 2].map(|axis| (indices[place][axis] + steps[axis]).wrapping_sub(1));
                open.extend(place_of.get(&beside).filter(|it| components[**it] == u16::MAX));
            }
        }
        n += 1;
    }
    components
}

/// Cameras in a ring of 3.5 m at two heights, not quite even.
pub(super) fn ring(n: usize, random: &mut Random) -> Vec<Point3<f64>> {
    let place = |i: usize, random: &mut Random| {
        let angle = std::f64::consts::TAU * i as f64 / n as f64 + 0.08 * random.normal();
        let height = if i.is_multiple_of(2) { 1.0 } else { 1.9 };
        Point3::new(3.5 * angle.cos(), 3.5 * angle.sin(), height + 0.1 * random.normal())
    };
    (0..n).map(|it| place(it, random)).collect()
}

/// What perfect silhouettes from these places leave over: cubes whose middles lie before or behind a tube in each.
pub(super) fn hull(tubes: &[Tube], cameras: &[Point3<f64>], size: f64) -> VoxelField {
    let (low, inside) = hull_cells(tubes, cameras, size);
    VoxelField::new(size, &low, &inside, ENDLESS).unwrap()
}

/// The same as the corner of cube (0, 0, 0) and places in the grid.
pub(super) fn hull_cells(tubes: &[Tube], cameras: &[Point3<f64>], size: f64) -> (Point3<f64>, Vec<[u16; 3]>) {
    let (mut low, mut high) = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
    for (ends, radius) in tubes {
        for end in ends {
            for axis in 0..3 {
                low[axis] = low[axis].min(end[axis] - radius - 0.15);
                high[axis] = high[axis].max(end[axis] + radius + 0.15);
            }
        }
    }
    low.z = 0.0;
    let n = (high - low).map(|it| (it / size).ceil() as u16);
    let is_seen = |place: &Point3<f64>| {
        cameras.iter().all(|from| tubes.iter().any(|(ends, radius)| passes(from, place, ends) < *radius))
    };
    let all = (0..n.x).flat_map(|x| (0..n.y).flat_map(move |y| (0..n.z).map(move |z| [x, y, z])));
    let inside = all.filter(|it| is_seen(&(low + Vector3::from(it.map(|it| f64::from(it) + 0.5)) * size)));
    (low, inside.collect())
}

/// What is left of cubes where a view lacks whatever it sees nearer to a place than a radius: from where it looks, the place, the radius [m].
pub(super) fn without(
    origin: &Point3<f64>,
    cells: &[[u16; 3]],
    size: f64,
    lost: &[(Point3<f64>, Point3<f64>, f64)],
) -> Vec<[u16; 3]> {
    let is_seen = |it: &&[u16; 3]| {
        let at = origin + Vector3::from(it.map(|it| f64::from(it) + 0.5)) * size;
        lost.iter().all(|(from, place, radius)| passes(from, &at, &[*place; 2]) > *radius)
    };
    cells.iter().filter(is_seen).copied().collect()
}

/// How near the line of sight from `from` through `place` passes a piece of a line [m].
fn passes(from: &Point3<f64>, place: &Point3<f64>, [a, b]: &[Point3<f64>; 2]) -> f64 {
    let way = (place - from).normalize();
    let off = |it: &Point3<f64>| {
        let away = it - from;
        away - way * away.dot(&way)
    };
    // Both seen along the line of sight: distance of the origin from a piece in a plane.
    let (first, along) = (off(a), off(b) - off(a));
    let share = (-first.dot(&along) / along.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    (first + along * share).norm()
}

/// Who is found in voxels, and followed for a few frames.
pub(super) fn followed(field: &VoxelField) -> BodyTracker {
    let mut tracker = BodyTracker::acquire(field, &TrackerOptions::default()).unwrap();
    (0..3).for_each(|_| tracker.step(field, 0.04, &[]));
    tracker
}
