//! Several bodies in one volume: a tracker each, and the assignment of voxels to them.
//!
//! A component of voxels near one body alone is that body's, however its limbs have moved in between; where two bodies
//! are near (they touch), each voxel goes to the nearer skin. Silhouettes that lose a strip across a knee cut a body
//! into several components: a component too small for a body is joined to what lies beside it
//! ([`PeopleOptions::gap`]). Voxels near no body may be a new one, and acquisition is tried until it succeeds, less
//! and less often where they do not change: no body is made of voxels without a head and a torso. Where a component
//! holds much that its body does not explain, the rest is tried too: a person who came in close to another. A trunk
//! without limbs at another person's feet is soon removed: silhouettes with a shadow make such hulls.

use std::collections::BTreeSet;

use nalgebra::{Point3, Vector3};

use super::acquire::AcquisitionFailure;
use super::field::VoxelField;
use super::fit::{Labelled, Skins};
use super::parts::{Limb, Part};
use super::tracker::{BodyTracker, LimbLevel, TrackerOptions, UPRIGHT};
use touching::touching;
use vain::InVain;

#[cfg(test)]
mod tests;
mod touching;
mod vain;

/// Options of tracking several bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct PeopleOptions {
    /// Options of each body's tracker.
    pub tracker: TrackerOptions,
    /// Voxels farther from a body's skin are not its own, unless they are connected to it alone [m].
    pub near: f64,
    /// Most bodies that are tracked [–].
    pub most: usize,
    /// Heads nearer to each other than this are one head [m].
    pub heads_apart: f64,
    /// Components across a gap of about this are joined unless both are as large as a body [m].
    pub gap: f64,
}

/// A single body leaves so much more of the skin unexplained than several do, where there are several [–]: laid across two who touch, one leaves 0.11 and more; a raised arm, with half of the body that it is
/// on, makes two bodies that leave hardly less than the one.
const FEWER: f64 = 0.06;

/// Trunks whose middles are nearer to each other, seen from above, may be two halves of one [m].
const HALVES: f64 = 0.5;

/// Voxels that reach the volume's top and are as thick as a neck may be a person's head or neck [m, half as thick], unless that head is so near to the top [m] or so far aside, seen from above [m].
const NECK: f64 = 0.04;
const HEAD_AT_TOP: f64 = 0.16;
const HEAD_ASIDE: f64 = 0.30;

/// A new person beside another has the head so far above the lowest voxel, as a share of the expected stature, and the torso upright: crouching and stooping are allowed.
const BESIDE_HEAD: f64 = 0.5;

impl Default for PeopleOptions {
    /// A hand at 6 m/s goes 0.2 m in a thirtieth of a second. Two heads that touch are 0.18 m apart. A seam or a shadow's edge that silhouettes lose is a few centimetres wide.
    fn default() -> Self {
        Self { tracker: TrackerOptions::default(), near: 0.20, most: 8, heads_apart: 0.16, gap: 0.06 }
    }
}

/// Voxels of one frame.
#[derive(Debug, Clone, Copy)]
pub struct Cubes<'a> {
    /// Edge of a voxel [m].
    pub size: f64,
    /// Corner of voxel (0, 0, 0) with the least x, y, z [m].
    pub origin: Point3<f64>,
    /// Size of the grid along x, y, z; bodies may continue beyond its ends, see [`VoxelField::new`].
    pub cells: [u32; 3],
    /// Indices of the voxels in the grid.
    pub indices: &'a [[u16; 3]],
    /// Connected component of each voxel.
    pub components: &'a [u16],
}

impl Cubes<'_> {
    fn centre(&self, voxel: usize) -> Point3<f64> {
        self.origin + Vector3::from(self.indices[voxel].map(|it| f64::from(it) + 0.5)) * self.size
    }
}

/// Voxels that are large enough for a body, but are not modelled as one.
#[derive(Debug, Clone, PartialEq)]
pub struct Unmodelled {
    /// Mean of their centres [m].
    pub centroid: Point3<f64>,
    /// Volume [m³].
    pub volume: f64,
    /// Why acquisition failed.
    pub reason: AcquisitionFailure,
}

/// A tracked body.
#[derive(Debug, Clone)]
pub struct TrackedBody {
    /// Identity: counts up, and is never reused.
    pub id: u32,
    /// Its tracker.
    pub tracker: BodyTracker,
    /// Time since track initiation [s].
    pub age_s: f64,
    /// Whether it had voxels in this frame.
    pub is_seen: bool,
    /// Whether its voxels are connected to those of another body.
    pub is_touching: bool,
    /// Time for which it was a trunk without limbs lying at another person's feet [s].
    pub doubt_s: f64,
    /// Frames since it was acquired in voxels connected to another body's, until it is seen apart: it may be half of that body.
    pub half: Option<u64>,
}

/// Counts of events since the start.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// Bodies acquired.
    pub found: u64,
    /// Bodies lost, or found to be half of another.
    pub lost: u64,
    /// Failed acquisitions in voxels as large as a body.
    pub failed: u64,
}

/// Who has which voxels.
struct Shares {
    /// By body.
    owners: Vec<Vec<usize>>,
    /// By body: whether it has voxels connected to those of another.
    is_shared: Vec<bool>,
    /// Components without voxels of any body.
    left: Vec<Vec<usize>>,
}

/// All bodies of a volume.
#[derive(Debug, Clone, Default)]
pub struct People {
    options: PeopleOptions,
    followed: Vec<TrackedBody>,
    next_id: u32,
    counts: Counts,
    in_vain: InVain,
}

impl People {
    /// No body yet.
    pub fn new(options: PeopleOptions) -> Self {
        Self { options, ..Self::default() }
    }

    /// The tracked bodies, ascending by identity.
    pub fn list(&self) -> &[TrackedBody] {
        &self.followed
    }

    /// The options in use.
    pub fn options(&self) -> &PeopleOptions {
        &self.options
    }

    /// Counts of events so far.
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// Advances to the voxels of `dt_s` later [s]; `labelled` gives known points of a body besides its voxels. Returns
    /// voxels that are large enough for a body but are not modelled as one.
    pub fn step(
        &mut self,
        cubes: &Cubes,
        dt_s: f64,
        labelled: impl Fn(u32, &BodyTracker) -> Vec<Labelled>,
    ) -> Vec<Unmodelled> {
        let Shares { mut owners, is_shared, left } = self.share_out(cubes);
        for (place, followed) in self.followed.iter_mut().enumerate() {
            followed.age_s += dt_s;
            followed.is_seen = !owners[place].is_empty();
            followed.is_touching = is_shared[place];
            followed.half = followed.half.filter(|_| is_shared[place]).map(|it| it + 1);
            let own: Vec<[u16; 3]> = owners[place].iter().map(|&it| cubes.indices[it]).collect();
            match VoxelField::new(cubes.size, &cubes.origin, &own, cubes.cells) {
                Some(field) => {
                    let points = labelled(followed.id, &followed.tracker);
                    followed.tracker.step(&field, dt_s, &points);
                }
                None => followed.tracker.coast(dt_s),
            }
            let tracker = &followed.tracker;
            let is_trunk = Limb::ALL.iter().all(|it| tracker.level(*it) == LimbLevel::Absent);
            let is_doubtful = is_shared[place] && is_trunk && tracker.upright() < UPRIGHT;
            followed.doubt_s = if is_doubtful { followed.doubt_s + dt_s } else { 0.0 };
        }
        self.join_halves(cubes, &mut owners);
        // A new person beside another: voxels connected to a body and not near it.
        let mut beside = Vec::new();
        for (place, followed) in self.followed.iter().enumerate() {
            if followed.tracker.support().unexplained > 0.3 {
                let skins = followed.tracker.skins();
                let far = |it: &usize| skins.distance(&cubes.centre(*it)) > self.options.near / 2.0;
                beside.push(owners[place].iter().copied().filter(far).collect());
            }
        }
        let before = self.followed.len();
        let most_s = self.options.tracker.levels.lost_s;
        self.followed.retain(|it| !it.tracker.is_lost() && it.doubt_s <= most_s);
        self.counts.lost += (before - self.followed.len()) as u64;
        let mut unmodelled = Vec::new();
        self.in_vain.next_frame();
        for voxels in left {
            self.acquire(cubes, voxels, false, &mut unmodelled);
        }
        for voxels in beside {
            self.acquire(cubes, voxels, true, &mut unmodelled);
        }
        self.mark_shared_limbs();
        unmodelled
    }

    /// Reports where views contradict each other, after a step: positions, and the volume that each represents [m, m³].
    pub fn set_contested(&mut self, contested: &[(Point3<f64>, f64)]) {
        self.followed.iter_mut().for_each(|it| it.tracker.set_contested(contested));
    }

    /// Reports how many views carved the voxels, after a step.
    pub fn set_n_views(&mut self, n_views: usize) {
        self.followed.iter_mut().for_each(|it| it.tracker.set_n_views(n_views));
    }

    /// Merges two bodies that are halves of one: silhouettes that lost a person's head leave shoulders that look like two heads, and each half becomes a body. Tried in the frames after acquisition, less and less often;
    /// a body that was seen apart is kept.
    fn join_halves(&mut self, cubes: &Cubes, owners: &mut Vec<Vec<usize>>) {
        let is_due = |it: &TrackedBody| it.half.is_some_and(u64::is_power_of_two);
        let middle = |it: &TrackedBody| it.tracker.filter().body.torso;
        let near = |a: &TrackedBody, b: &TrackedBody| (middle(a) - middle(b)).xy().norm() < HALVES;
        let mut second = 1;
        while second < self.followed.len() {
            let pair = |first: &usize| {
                let [a, b] = [&self.followed[*first], &self.followed[second]];
                a.is_touching && b.is_touching && (is_due(a) || is_due(b)) && near(a, b)
            };
            let joined = |first: usize| Some((first, self.one_of(cubes, owners, [first, second])?));
            let one = (0..second).filter(pair).find_map(joined);
            let Some((first, one)) = one else {
                second += 1;
                continue;
            };
            self.followed[first].tracker = one;
            self.followed.remove(second);
            let voxels = owners.remove(second);
            owners[first].extend(voxels);
            self.counts.lost += 1;
        }
    }

    /// The one body in the voxels of two, if these leave hardly less of the skin unexplained.
    fn one_of(&self, cubes: &Cubes, owners: &[Vec<usize>], pair: [usize; 2]) -> Option<BodyTracker> {
        let own: Vec<[u16; 3]> = pair.iter().flat_map(|it| &owners[*it]).map(|it| cubes.indices[*it]).collect();
        let field = VoxelField::new(cubes.size, &cubes.origin, &own, cubes.cells)?;
        let one = BodyTracker::acquire(&field, &self.options.tracker).ok()?;
        let unexplained = pair.map(|it| self.followed[it].tracker.support().unexplained).iter().sum::<f64>() / 2.0;
        (unexplained > one.support().unexplained - FEWER).then_some(one)
    }

    /// Limbs that lie at another body that touches may be that body's, or lie elsewhere on it.
    fn mark_shared_limbs(&mut self) {
        let skins: Vec<Skins> = self.followed.iter().map(|it| it.tracker.skins()).collect();
        for (place, followed) in self.followed.iter_mut().enumerate() {
            let body = &followed.tracker.filter().body;
            let is_near = |at: &Point3<f64>| {
                skins.iter().enumerate().any(|it| it.0 != place && it.1.distance(at) < self.options.near)
            };
            let shared = Limb::ALL.map(|limb| {
                let ends = limb.parts().map(|part| body.place(part, &-Vector3::z()));
                followed.is_touching && ends.iter().any(is_near)
            });
            followed.tracker.share_limbs(shared);
        }
    }

    fn share_out(&self, cubes: &Cubes) -> Shares {
        let groups = groups(cubes, self.options.gap, self.options.tracker.acquisition.least_volume);
        let mut members: Vec<Vec<usize>> = vec![Vec::new(); groups.len()];
        for (voxel, component) in cubes.components.iter().enumerate() {
            members[groups[usize::from(*component)]].push(voxel);
        }
        members.retain(|it| !it.is_empty());
        let skins: Vec<Skins> = self.followed.iter().map(|it| it.tracker.skins()).collect();
        let mut owners: Vec<Vec<usize>> = vec![Vec::new(); self.followed.len()];
        let mut is_shared = vec![false; self.followed.len()];
        let mut left = Vec::new();
        for voxels in members {
            // One voxel in eight tells who is near, all if they are few.
            let stride = if voxels.len() > 400 { 8 } else { 1 };
            let mut near = vec![0_usize; self.followed.len()];
            for &voxel in voxels.iter().step_by(stride) {
                let centre = cubes.centre(voxel);
                for (place, skins) in skins.iter().enumerate() {
                    near[place] += usize::from(skins.distance(&centre) < self.options.near / 2.0);
                }
            }
            let close: Vec<usize> = (0..near.len()).filter(|&it| near[it] > 0).collect();
            match close[..] {
                [] => {
                    // A hand that a hole has cut off still belongs to a person.
                    let places = voxels.iter().step_by(stride).map(|&it| cubes.centre(it));
                    let nearest = places
                        .flat_map(|place| skins.iter().map(move |it| it.distance(&place)).enumerate())
                        .min_by(|a, b| a.1.total_cmp(&b.1))
                        .filter(|it| it.1 < self.options.near);
                    match nearest {
                        Some((place, _)) => owners[place].extend(voxels),
                        None => left.push(voxels),
                    }
                }
                [one] => owners[one].extend(voxels),
                _ => {
                    close.iter().for_each(|it| is_shared[*it] = true);
                    for voxel in voxels {
                        let centre = cubes.centre(voxel);
                        let away = close.iter().map(|&it| (skins[it].distance(&centre), it));
                        if let Some((_, place)) = away.min_by(|a, b| a.0.total_cmp(&b.0)) {
                            owners[place].push(voxel);
                        }
                    }
                }
            }
        }
        Shares { owners, is_shared, left }
    }

    /// Makes a body of voxels, or says why not. `beside`: they are connected to another body.
    fn acquire(&mut self, cubes: &Cubes, mut voxels: Vec<usize>, beside: bool, unmodelled: &mut Vec<Unmodelled>) {
        let cube = cubes.size.powi(3);
        while voxels.len() as f64 * cube >= self.options.tracker.acquisition.least_volume {
            let sum: Vector3<f64> = voxels.iter().map(|&it| cubes.centre(it).coords).sum();
            let centroid = Point3::from(sum / voxels.len() as f64);
            let volume = voxels.len() as f64 * cube;
            if let Some(reason) = self.in_vain.holds(&centroid, volume) {
                unmodelled.push(Unmodelled { centroid, volume, reason });
                return;
            }
            let own: Vec<[u16; 3]> = voxels.iter().map(|&it| cubes.indices[it]).collect();
            let Some(field) = VoxelField::new(cubes.size, &cubes.origin, &own, cubes.cells) else { return };
            let found = BodyTracker::acquire(&field, &self.options.tracker);
            let found = if beside {
                found.and_then(|it| self.upright(it, &field)).map(|it| vec![it])
            } else {
                let several = touching(cubes, &voxels, &self.options.tracker);
                let unexplained = several.iter().map(|it| it.support().unexplained).sum::<f64>() / several.len() as f64;
                match found {
                    Err(failure) if several.is_empty() => Err(failure),
                    Ok(one) if several.is_empty() || unexplained > one.support().unexplained - FEWER => Ok(vec![one]),
                    _ => Ok(several),
                }
            };
            let found = found.and_then(|it| below_top(it, &field));
            let failure = match found {
                Ok(mut found) => {
                    found.retain(|it| !self.is_known(it));
                    found.truncate(self.options.most.saturating_sub(self.followed.len()));
                    for tracker in &found {
                        let skins = tracker.skins();
                        voxels.retain(|&it| skins.distance(&cubes.centre(it)) > self.options.near / 2.0);
                    }
                    if !found.is_empty() {
                        let is_touching = beside || found.len() > 1;
                        found.into_iter().for_each(|it| self.follow(it, is_touching));
                        continue;
                    }
                    AcquisitionFailure::Known { most: self.options.most }
                }
                Err(failure) => failure,
            };
            self.counts.failed += 1;
            let failed = Unmodelled { centroid, volume, reason: failure };
            // Whether a person is tracked already depends on the present tracks.
            if !matches!(failed.reason, AcquisitionFailure::Known { .. }) {
                self.in_vain.keep(failed.clone());
            }
            unmodelled.push(failed);
            return;
        }
    }

    fn follow(&mut self, tracker: BodyTracker, is_touching: bool) {
        let id = self.next_id;
        let half = is_touching.then_some(0);
        self.followed.push(TrackedBody { id, tracker, age_s: 0.0, is_seen: true, is_touching, doubt_s: 0.0, half });
        self.next_id += 1;
        self.counts.found += 1;
    }

    /// A person who comes in close to another walks in; a lying person is found once apart.
    fn upright(&self, tracker: BodyTracker, field: &VoxelField) -> Result<BodyTracker, AcquisitionFailure> {
        let upright = tracker.upright();
        let lowest = field.voxels().iter().map(|&it| field.centre(it).z).fold(f64::INFINITY, f64::min);
        let found = tracker.filter().body.centre(Part::Head).z - lowest;
        let expected = BESIDE_HEAD * self.options.tracker.proportions.stature;
        if upright >= UPRIGHT && found >= expected {
            return Ok(tracker);
        }
        Err(AcquisitionFailure::Beside { found, expected, upright, least_upright: UPRIGHT })
    }

    fn is_known(&self, tracker: &BodyTracker) -> bool {
        let head = |it: &BodyTracker| it.filter().body.centre(Part::Head);
        let found = head(tracker);
        self.followed.iter().any(|it| (head(&it.tracker) - found).norm() < self.options.heads_apart)
    }
}

/// Those whose head is no chest or shoulder below a head that the volume's top cuts off.
fn below_top(mut found: Vec<BodyTracker>, field: &VoxelField) -> Result<Vec<BodyTracker>, AcquisitionFailure> {
    let Some((place, thick)) = field.thickest_at_top().filter(|it| it.1 >= NECK) else { return Ok(found) };
    let mut failure = None;
    found.retain(|it| {
        let off = place - it.filter().body.centre(Part::Head);
        let [above, away] = [off.z, off.xy().norm()];
        let is_head = above < HEAD_AT_TOP || away > HEAD_ASIDE;
        if !is_head {
            failure = Some(AcquisitionFailure::CutAbove { thick: 2.0 * thick, above, away });
        }
        is_head
    });
    match failure {
        Some(failure) if found.is_empty() => Err(failure),
        _ => Ok(found),
    }
}

/// Of each component, the number of one that it goes with: small ones go with what lies across a gap, as far as cubes of its size that touch tell.
fn groups(cubes: &Cubes, gap: f64, least_volume: f64) -> Vec<usize> {
    let n_components = cubes.components.iter().map(|&it| usize::from(it) + 1).max().unwrap_or(0);
    let mut group: Vec<usize> = (0..n_components).collect();
    if n_components < 2 {
        return group;
    }
    let mut counts = vec![0_usize; n_components];
    cubes.components.iter().for_each(|it| counts[usize::from(*it)] += 1);
    let is_large = |it: u16| counts[usize::from(it)] as f64 * cubes.size.powi(3) >= least_volume;
    let step = (gap / cubes.size).round().max(1.0) as u16;
    // Which components each cell of the size of the gap holds, in order.
    let cell = |voxel: usize| cubes.indices[voxel].map(|it| i32::from(it / step));
    let mut cells: Vec<([i32; 3], u16)> = (0..cubes.indices.len()).map(|it| (cell(it), cubes.components[it])).collect();
    // Neighbours in the list are so in space, mostly: few are left to be sorted.
    cells.dedup();
    let cells: BTreeSet<([i32; 3], u16)> = cells.into_iter().collect();
    for (at, one) in &cells {
        for shift in 0..27 {
            let beside = [at[0] + shift % 3 - 1, at[1] + shift / 3 % 3 - 1, at[2] + shift / 9 - 1];
            for (_, other) in cells.range((beside, 0)..=(beside, u16::MAX)) {
                if one < other && !(is_large(*one) && is_large(*other)) {
                    let [a, b] = [one, other].map(|it| root(&group, usize::from(*it)));
                    let [large, small] = if is_large(b as u16) { [b, a] } else { [a, b] };
                    // Two bodies stay two, though something small lies between them.
                    if a != b && !is_large(small as u16) {
                        group[small] = large;
                    }
                }
            }
        }
    }
    (0..n_components).map(|it| root(&group, it)).collect()
}

fn root(group: &[usize], of: usize) -> usize {
    let mut at = of;
    while group[at] != at {
        at = group[at];
    }
    at
}
