//! People who touch when they are first detected: one component of voxels, in which a single body would be laid across two.
//!
//! Each high head takes the voxels that are nearer to it than to another one, seen from above; where each of these
//! sets is a person, there are several. A fist or a knee that looks like a head keeps an arm or a leg, which is no
//! person.

use nalgebra::Point3;

use super::super::acquire::find_heads;
use super::super::field::VoxelField;
use super::super::parts::Part;
use super::super::tracker::{BodyTracker, TrackerOptions, UPRIGHT};
use super::Cubes;

/// A head is at least so high above the lowest voxel, over the highest one's height [–]: a child beside an adult.
const HIGH: f64 = 0.55;
/// Heads are so far from each other, seen from above [m].
const APART: f64 = 0.25;
/// Largest distance of a body's head from the candidate that its search started at [m].
const NEAR: f64 = 0.1;

/// The bodies in connected voxels, if there are several.
pub(super) fn touching(cubes: &Cubes, voxels: &[usize], options: &TrackerOptions) -> Vec<BodyTracker> {
    let field_of = |voxels: &[usize]| {
        let own: Vec<[u16; 3]> = voxels.iter().map(|&it| cubes.indices[it]).collect();
        VoxelField::new(cubes.size, &cubes.origin, &own, cubes.cells)
    };
    let Some(field) = field_of(voxels) else { return Vec::new() };
    let across = |a: &Point3<f64>, b: &Point3<f64>| (a - b).xy().norm();
    let (found, _) = find_heads(&field, &options.acquisition);
    let lowest = field.voxels().iter().map(|&it| field.centre(it).z).fold(f64::INFINITY, f64::min);
    let highest = found.iter().map(|it| it.centre.z).fold(f64::NEG_INFINITY, f64::max);
    // The surest first.
    let mut heads: Vec<Point3<f64>> = Vec::new();
    for head in found.iter().filter(|it| it.centre.z - lowest > HIGH * (highest - lowest)) {
        if heads.iter().all(|it| across(it, &head.centre) > APART) {
            heads.push(head.centre);
        }
    }
    while heads.len() > 1 {
        let mut shares: Vec<Vec<usize>> = vec![Vec::new(); heads.len()];
        for &voxel in voxels {
            let centre = cubes.centre(voxel);
            let away = heads.iter().map(|it| across(it, &centre)).enumerate();
            if let Some((nearest, _)) = away.min_by(|a, b| a.1.total_cmp(&b.1)) {
                shares[nearest].push(voxel);
            }
        }
        let somebody = |(share, head): (&Vec<usize>, &Point3<f64>)| {
            let tracker = BodyTracker::acquire(&field_of(share)?, options).ok()?;
            let off = (tracker.filter().body.centre(Part::Head) - head).norm();
            (off < NEAR && tracker.upright() >= UPRIGHT).then_some(tracker)
        };
        let bodies: Vec<Option<BodyTracker>> = shares.iter().zip(&heads).map(somebody).collect();
        match bodies.iter().rposition(Option::is_none) {
            Some(nobody) => drop(heads.remove(nobody)),
            None => return bodies.into_iter().flatten().collect(),
        }
    }
    Vec::new()
}
