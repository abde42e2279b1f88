//! Arms and legs in voxels [Mikić 2001 §3]: templates grown from the joint at the torso into voxels that neither head nor torso takes.
//!
//! The paper takes the four largest connected regions of the remaining voxels as limbs. Hulls join what touches (a
//! hand on a hip, two legs), so here a template of two parts is laid from the joint into the remaining voxels in all
//! directions that a limb can have; it is scored by how deep its axis lies in *free* voxels, and how many of these it
//! takes up. A template that sticks out, or that takes voxels of others, loses; without free voxels connected to the
//! joint no limb is found, and it is tried again in a later frame.

use nalgebra::{Point3, UnitQuaternion, Vector3};

use super::acquire::{turn_of, ways};
use super::field::VoxelField;
use super::model::Body;
use super::parts::{Limb, Part};
use super::solid::skin;

/// Options of the search for limbs.
#[derive(Debug, Clone, PartialEq)]
pub struct LimbOptions {
    /// Least share of its axis that lies in free voxels [–].
    pub least_inside: f64,
    /// Least share of its volume that free voxels fill [–].
    pub least_filled: f64,
    /// A limb that bends less is taken as one straight part [rad].
    pub straight: f64,
}

impl Default for LimbOptions {
    /// A limb beside the torso has a third of its axis in voxels that the torso takes as well. Below 15° an elbow is off its line by less than a radius.
    fn default() -> Self {
        Self { least_inside: 0.75, least_filled: 0.45, straight: 15f64.to_radians() }
    }
}

/// Which cells of a field belong to a part.
#[derive(Debug, Clone)]
pub struct Taken {
    cells: Vec<bool>,
}

impl Taken {
    /// Marks all voxels within or near the skin of the parts for which `is_taken`, and those connected only to them.
    pub fn by(field: &VoxelField, body: &Body, is_taken: impl Fn(Part) -> bool, near: f64) -> Self {
        let mut taken = Taken { cells: vec![false; field.n_cells()] };
        taken.add(field, body, is_taken, near);
        taken
    }

    /// Marks more voxels as taken.
    pub fn add(&mut self, field: &VoxelField, body: &Body, is_taken: impl Fn(Part) -> bool, near: f64) {
        let centres = body.centres();
        for part in Part::ALL.into_iter().filter(|it| is_taken(*it)) {
            let (centre, back, sizes) = (centres[part.index()], body.turn(part).inverse(), body.size(part));
            let reach = sizes.norm() + near;
            for &cell in field.voxels() {
                let away = field.centre(cell) - centre;
                if away.norm_squared() < reach * reach && skin(part, &(back * away), sizes, true).distance < near {
                    self.cells[cell as usize] = true;
                }
            }
        }
    }

    /// Whether a voxel is free.
    pub fn is_free(&self, field: &VoxelField, cell: u32) -> bool {
        field.holds(cell) && !self.cells[cell as usize]
    }

    /// Number of free voxels.
    pub fn n_free(&self, field: &VoxelField) -> usize {
        field.voxels().iter().filter(|&&it| !self.cells[it as usize]).count()
    }
}

/// A limb found in the voxels.
#[derive(Debug, Clone, PartialEq)]
pub struct LimbFound {
    /// Which limb.
    pub limb: Limb,
    /// Turns of its upper and its lower part.
    pub turns: [UnitQuaternion<f64>; 2],
    /// Share of its axis that lies in free voxels [–].
    pub inside: f64,
    /// Share of its volume that free voxels fill [–].
    pub filled: f64,
    /// Bend of the limb [rad].
    pub bend: f64,
    /// Score of the template [–].
    pub score: f64,
}

const N_UPPER: usize = 180;
const N_LOWER: usize = 120;
/// As many templates are looked at closely.
const N_CLOSE: usize = 40;

struct Search<'a> {
    field: &'a VoxelField,
    taken: &'a Taken,
    joint: Point3<f64>,
    lengths: [f64; 2],
    radii: [f64; 2],
    /// Centres of free voxels within reach of the joint.
    free: Vec<Point3<f64>>,
}

/// Finds the best template of a limb on a body; `None` where none is good enough.
pub fn find_limb(
    field: &VoxelField,
    body: &Body,
    limb: Limb,
    taken: &Taken,
    options: &LimbOptions,
    predicted: Option<&[Vector3<f64>; 2]>,
) -> Option<LimbFound> {
    let search = Search::new(field, body, limb, taken);
    let scored = search.scored(body, limb, predicted).into_iter();
    let best = search.uphill(scored.max_by(|a, b| a.0.total_cmp(&b.0))?, body, limb);
    search.found(&best, body, limb, options)
}

/// Templates of a limb, none of which has its end within `apart` of that of a better one [m], the best first: at most `most`, none turned uphill, each good enough.
pub(super) fn limb_templates(
    field: &VoxelField,
    body: &Body,
    limb: Limb,
    taken: &Taken,
    options: &LimbOptions,
    (most, apart): (usize, f64),
) -> Vec<LimbFound> {
    let search = Search::new(field, body, limb, taken);
    let mut scored = search.scored(body, limb, None);
    scored.sort_by(|a, b| b.0.total_cmp(&a.0));
    let mut found: Vec<(Point3<f64>, LimbFound)> = Vec::new();
    for (_, ways) in scored {
        let end = search.end(&ways);
        if found.len() < most && found.iter().all(|it| (it.0 - end).norm() > apart) {
            found.extend(search.found(&ways, body, limb, options).map(|it| (end, it)));
        }
    }
    found.into_iter().map(|it| it.1).collect()
}

/// Whether the upper part of a limb can point there from its joint.
pub(super) fn can_point(body: &Body, limb: Limb, way: &Vector3<f64>) -> bool {
    let torso = body.turn(Part::Torso);
    // Legs do not go up past the horizontal by much, nor to the other side: hips are a hand's width apart, and either leg could be taken for the other. Arms reach across.
    let side = if matches!(limb, Limb::LeftArm | Limb::LeftLeg) { 1.0 } else { -1.0 };
    let out = way.dot(&(torso * Vector3::y())) * side;
    if limb.is_leg() { way.dot(&(torso * Vector3::z())) < 0.4 && out > -0.2 } else { out > -0.6 }
}

impl<'a> Search<'a> {
    fn new(field: &'a VoxelField, body: &Body, limb: Limb, taken: &'a Taken) -> Self {
        let [upper, lower] = limb.parts();
        let joint = body.place(Part::Torso, &upper.hangs_at());
        let lengths = [upper, lower].map(|it| 2.0 * body.size(it).z);
        let radii = [upper, lower].map(|it| (body.size(it).x + body.size(it).y) / 2.0);
        let reach = lengths[0] + lengths[1] + 0.1;
        let free: Vec<Point3<f64>> = field
            .voxels()
            .iter()
            .filter(|&&it| taken.is_free(field, it))
            .map(|&it| field.centre(it))
            .filter(|it| (it - joint).norm() < reach)
            .collect();
        Self { field, taken, joint, lengths, radii, free }
    }

    /// The end of a limb that lies so.
    fn end(&self, ways: &[Vector3<f64>; 2]) -> Point3<f64> {
        self.joint + ways[0] * self.lengths[0] + ways[1] * self.lengths[1]
    }

    /// The limb that lies so, if it is good enough.
    fn found(&self, ways: &[Vector3<f64>; 2], body: &Body, limb: Limb, options: &LimbOptions) -> Option<LimbFound> {
        let (inside, filled) = (self.inside(ways), self.filled(ways));
        if inside < options.least_inside || filled < options.least_filled {
            return None;
        }
        let left = body.turn(Part::Torso) * Vector3::y();
        // z points up the limb.
        let turns = ways.map(|it| turn_of(&-it, &left));
        Some(LimbFound { limb, turns, inside, filled, bend: ways[0].angle(&ways[1]), score: inside + 2.0 * filled })
    }

    /// How good a place on the axis is, from −1 to 1: as deep in free voxels as the part is thick.
    fn at(&self, place: &Point3<f64>, radius: f64, must_be_free: bool) -> f64 {
        let Some(cell) = self.field.cell(place) else { return -1.0 };
        let depth = self.field.depth_of(cell);
        if must_be_free && depth > 0.0 && !self.taken.is_free(self.field, cell) {
            return -0.3;
        }
        (depth / (0.7 * radius)).clamp(-1.0, 1.0)
    }

    fn along(&self, from: &Point3<f64>, way: &Vector3<f64>, length: f64, radius: f64, skip: f64) -> f64 {
        const N: usize = 7;
        let sum: f64 = (0..N)
            .map(|i| {
                let share = (i as f64 + 0.5) / N as f64;
                self.at(&(from + way * (share * length)), radius, share > skip)
            })
            .sum();
        sum / N as f64
    }

    fn depth_score(&self, ways: &[Vector3<f64>; 2]) -> f64 {
        let [upper, lower] = *ways;
        let elbow = self.joint + upper * self.lengths[0];
        let first = self.along(&self.joint, &upper, self.lengths[0], self.radii[0], 0.35);
        first + self.along(&elbow, &lower, self.lengths[1] - self.radii[1], self.radii[1], 0.0)
    }

    fn inside(&self, ways: &[Vector3<f64>; 2]) -> f64 {
        const N: usize = 10;
        let elbow = self.joint + ways[0] * self.lengths[0];
        let mut n = 0;
        for i in 0..N {
            let share = (i as f64 + 0.5) / N as f64;
            let places = [
                (self.joint + ways[0] * (share * self.lengths[0]), share > 0.35, self.radii[0]),
                (elbow + ways[1] * (share * (self.lengths[1] - self.radii[1])), true, self.radii[1]),
            ];
            for (place, must_be_free, radius) in places {
                n += usize::from(self.at(&place, radius, must_be_free) > 0.0);
            }
        }
        n as f64 / (2 * N) as f64
    }

    /// Free voxels in the template over its volume, at most 1 for each part.
    fn filled(&self, ways: &[Vector3<f64>; 2]) -> f64 {
        let elbow = self.joint + ways[0] * self.lengths[0];
        let mut volumes = [0.0; 2];
        for place in &self.free {
            let off = |from: &Point3<f64>, way: &Vector3<f64>, length: f64| {
                let away = place - from;
                (away - way * away.dot(way).clamp(0.0, length)).norm()
            };
            let upper = off(&self.joint, &ways[0], self.lengths[0]);
            let lower = off(&elbow, &ways[1], self.lengths[1]);
            let half = 0.3 * self.field.size();
            if lower < self.radii[1] + half && lower <= upper {
                volumes[1] += 1.0;
            } else if upper < self.radii[0] + half {
                volumes[0] += 1.0;
            }
        }
        let cube = self.field.size().powi(3);
        let share = |i: usize| {
            let whole = std::f64::consts::PI * self.radii[i].powi(2) * self.lengths[i];
            (volumes[i] * cube / whole).min(1.0)
        };
        (share(0) + share(1)) / 2.0
    }

    fn score(&self, ways: &[Vector3<f64>; 2]) -> f64 {
        self.depth_score(ways) + 2.0 * self.filled(ways)
    }

    /// Templates that lie in the voxels, none within 12° of a better one, each with its score.
    fn scored(&self, body: &Body, limb: Limb, predicted: Option<&[Vector3<f64>; 2]>) -> Vec<(f64, [Vector3<f64>; 2])> {
        let is_possible = |way: &Vector3<f64>| can_point(body, limb, way);
        let mut close: Vec<(f64, [Vector3<f64>; 2])> = Vec::new();
        let lowers = ways::<N_LOWER>();
        for upper in ways::<N_UPPER>().into_iter().filter(is_possible) {
            let first = self.along(&self.joint, &upper, self.lengths[0], self.radii[0], 0.35);
            // Directions are 15° apart: what is wanted may lie half in between, and is turned uphill below.
            if first < 0.0 {
                continue;
            }
            let elbow = self.joint + upper * self.lengths[0];
            for lower in lowers {
                // 150° is the most that a limb bends.
                if lower.dot(&upper) < -0.87 {
                    continue;
                }
                let second = self.along(&elbow, &lower, self.lengths[1] - self.radii[1], self.radii[1], 0.0);
                if second > -0.2 {
                    close.push((first + second, [upper, lower]));
                }
            }
        }
        close.extend(predicted.filter(|it| is_possible(&it[0])).map(|it| (f64::INFINITY, *it)));
        close.sort_by(|a, b| b.0.total_cmp(&a.0));
        // Not all of one bundle: of those within 12° of a better one only the best is looked at.
        let mut chosen: Vec<[Vector3<f64>; 2]> = Vec::new();
        for (_, ways) in &close {
            if chosen.len() >= N_CLOSE {
                break;
            }
            if chosen.iter().all(|it| it[0].dot(&ways[0]) < 0.978 || it[1].dot(&ways[1]) < 0.978) {
                chosen.push(*ways);
            }
        }
        chosen.into_iter().map(|it| (self.score(&it), it)).collect()
    }

    /// A template turned to where it scores best, in ever smaller steps.
    fn uphill(&self, start: (f64, [Vector3<f64>; 2]), body: &Body, limb: Limb) -> [Vector3<f64>; 2] {
        let mut best = start;
        let mut step: f64 = 0.15;
        while step > 0.02 {
            let mut is_better = false;
            for part in 0..2 {
                let axis = best.1[part];
                let first = axis.cross(&if axis.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() }).normalize();
                let second = axis.cross(&first);
                for turn in [first, -first, second, -second] {
                    let mut ways = best.1;
                    ways[part] = (axis + turn * step).normalize();
                    let score = self.score(&ways);
                    if score > best.0 + 1e-9 && can_point(body, limb, &ways[0]) {
                        best = (score, ways);
                        is_better = true;
                    }
                }
            }
            if !is_better {
                step *= 0.6;
            }
        }
        best.1
    }
}
