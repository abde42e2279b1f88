//! A truncated signed distance field (TSDF), in blocks where there is a surface: the fusion of many clouds.
//!
//! Source: B. Curless and M. Levoy, "A volumetric method for building complex models from range images", SIGGRAPH 1996; stored by blocks as in M. Nießner, M. Zollhöfer, S. Izadi,
//! M. Stamminger, "Real-time 3D reconstruction at scale using voxel hashing", SIGGRAPH Asia 2013.
//!
//! Each point enters the voxels along its normal, up to `truncation` voxels to either side, with the distance from its plane: positive outside. In the two other directions its weight
//! falls linearly to 0 at one voxel. The weight is 1/σ² along the normal, so that a voxel holds the mean of least variance.
//!
//! A voxel also keeps the scatter of its points about their mean. Points that contradict each other beyond their noise
//! indicate another error, such as the pose of a cloud or a shape that changed, which more points do not reduce. On a
//! surface that `changes`, newer points take precedence: contradicting older ones are discarded.

use nalgebra::{Point3, Vector3};

use super::SurfacePoint;
use super::key::{CellTable, key};

/// Voxels along an edge of a block.
pub(super) const SIDE: usize = 8;
const VOLUME: usize = SIDE * SIDE * SIDE;

/// Options of a [`DistanceField`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldOptions {
    /// Edge of a voxel [m].
    pub voxel_m: f64,
    /// Truncation: distances are kept up to this far from the surface [voxels].
    pub truncation: f64,
    /// Most blocks of 8 × 8 × 8 voxels; each takes 16 kB.
    pub max_blocks: usize,
    /// Whether the surface may change its shape: points from before the last [`DistanceField::fade`] are replaced by later ones that contradict them.
    pub changes: bool,
}

/// One voxel.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Voxel {
    /// From the surface, positive outside [voxels].
    pub distance: f32,
    /// Σ of kernel / σ² [1/m²].
    pub weight: f32,
    /// Σ of kernel / σ², times the squared distance from the mean [voxels²/m²].
    pub scatter: f32,
    /// 1 where a point came near since the field was last made to fade, and what is left of that since [–].
    pub fresh: f32,
    /// Σ of kernel: how many points.
    pub n_points: f32,
    /// Mean [gray level].
    pub colour: [f32; 3],
}

/// A point contradicts older ones when it is off their mean by more than so much [voxels], and so much more for each voxel between it and the surface, where normals decide [–]. Of 0.1 to 0.3 voxels
/// all left no vertex of a face that moves wrong by more than 5 mm; less lets noise of boundaries count as motion.
const CONTRADICTS: [f32; 2] = [0.15, 0.3];
/// … and by more than so many of its own standard deviations [–].
const CONTRADICTS_SIGMAS: f64 = 3.0;
/// What older points count when they gave way [–].
const GIVES_WAY: f32 = 0.1;
/// A point speaks for a voxel in which its kernel is at least this [–].
const SPEAKS: f64 = 0.25;

/// Outcome of adding a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fused {
    /// The point is in the field.
    Yes,
    /// The point has no normal, or is not finite, or too far away.
    Unfit,
    /// The point would need more blocks than allowed.
    Full,
}

/// A truncated signed distance field that points are fused into.
#[derive(Debug, Clone)]
pub struct DistanceField {
    options: FieldOptions,
    table: CellTable,
    pub(super) places: Vec<[i32; 3]>,
    blocks: Vec<Box<[Voxel; VOLUME]>>,
}

impl DistanceField {
    /// An empty field.
    pub fn new(options: FieldOptions) -> DistanceField {
        DistanceField { options, table: CellTable::default(), places: Vec::new(), blocks: Vec::new() }
    }

    /// The options of the field.
    pub fn options(&self) -> &FieldOptions {
        &self.options
    }

    /// Number of blocks.
    pub fn n_blocks(&self) -> usize {
        self.blocks.len()
    }

    /// Fuses a point with its colour [gray level] into the field.
    pub fn fuse(&mut self, point: &SurfacePoint, colour: [u8; 3]) -> Fused {
        let variance = point.variance_along(&point.normal);
        let normal = point.normal;
        if !point.is_sound() || normal == Vector3::zeros() || variance <= 0.0 {
            return Fused::Unfit;
        }
        let voxel_m = self.options.voxel_m;
        let place = point.position.coords / voxel_m;
        let contradicts = (CONTRADICTS_SIGMAS * variance.sqrt() / voxel_m) as f32;
        let contradicts = self.options.changes.then_some(contradicts);
        let axis = normal.iamax();
        let [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
        let reach = self.options.truncation * normal[axis].abs();
        let (first, last) = ((place[axis] - reach).ceil(), (place[axis] + reach).floor());
        let mut cursor = Cursor { block: [i32::MAX; 3], place: 0 };
        let mut result = Fused::Yes;
        let mut along = first;
        while along <= last {
            // Where the line along the normal passes this layer of voxels.
            let t = (along - place[axis]) / normal[axis];
            let at = place + normal * t;
            let (low_u, low_v) = (at[u].floor(), at[v].floor());
            for (du, dv) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)] {
                let mut voxel = Vector3::zeros();
                voxel[axis] = along;
                voxel[u] = low_u + du;
                voxel[v] = low_v + dv;
                let kernel = (1.0 - (voxel[u] - at[u]).abs()) * (1.0 - (voxel[v] - at[v]).abs());
                if kernel <= 0.0 {
                    continue;
                }
                let distance = (voxel - place).dot(&normal);
                match self.voxel_mut([0, 1, 2].map(|it| voxel[it] as i32), &mut cursor) {
                    Ok(there) => {
                        if kernel >= SPEAKS {
                            there.freshen(distance as f32, contradicts);
                        }
                        there.add(distance, kernel, variance, colour);
                    }
                    Err(why) => result = why,
                }
            }
            along += 1.0;
        }
        result
    }

    /// Multiplies the weight of all points so far by `share`, 0 to 1, so that later points count more.
    pub fn fade(&mut self, share: f64) {
        let share = share as f32;
        for voxel in self.blocks.iter_mut().flat_map(|it| it.iter_mut()) {
            voxel.fade(share);
            voxel.fresh *= share;
        }
    }

    fn voxel_mut(&mut self, voxel: [i32; 3], cursor: &mut Cursor) -> Result<&mut Voxel, Fused> {
        let block = voxel.map(|it| it.div_euclid(SIDE as i32));
        if block != cursor.block {
            let key = key(block).ok_or(Fused::Unfit)?;
            let place = match self.table.get(&key) {
                Some(&place) => place as usize,
                None if self.blocks.len() >= self.options.max_blocks => return Err(Fused::Full),
                None => {
                    self.blocks.push(Box::new([Voxel::default(); VOLUME]));
                    self.places.push(block);
                    self.table.insert(key, (self.blocks.len() - 1) as u32);
                    self.blocks.len() - 1
                }
            };
            *cursor = Cursor { block, place };
        }
        Ok(&mut self.blocks[cursor.place][within(voxel)])
    }

    /// Block and place in it of a voxel.
    #[inline]
    pub(super) fn find(&self, voxel: [i32; 3]) -> Option<(usize, usize)> {
        let block = self.table.get(&key(voxel.map(|it| it.div_euclid(SIDE as i32)))?)?;
        Some((*block as usize, within(voxel)))
    }

    /// A voxel that enough points made.
    #[inline]
    pub(super) fn voxel(&self, voxel: [i32; 3], min_points: f32) -> Option<&Voxel> {
        let (block, place) = self.find(voxel)?;
        Some(&self.blocks[block][place]).filter(|it| it.n_points >= min_points)
    }

    /// Signed distance of a point from the surface [m], positive outside; `None` where the field is empty.
    pub fn distance(&self, point: &Point3<f64>) -> Option<f64> {
        let place = point.coords / self.options.voxel_m;
        let low = place.map(f64::floor);
        let part = place - low;
        let mut sum = 0.0;
        for corner in 0..8_usize {
            let step = [corner & 1, corner >> 1 & 1, corner >> 2 & 1];
            let voxel = [0, 1, 2].map(|it| low[it] as i32 + step[it] as i32);
            let weight: f64 = (0..3).map(|it| if step[it] == 1 { part[it] } else { 1.0 - part[it] }).product();
            sum += weight * f64::from(self.voxel(voxel, f32::MIN_POSITIVE)?.distance);
        }
        Some(sum * self.options.voxel_m)
    }
}

/// The block that was used last.
struct Cursor {
    block: [i32; 3],
    place: usize,
}

#[inline]
fn within(voxel: [i32; 3]) -> usize {
    let [x, y, z] = voxel.map(|it| it.rem_euclid(SIDE as i32) as usize);
    (z * SIDE + y) * SIDE + x
}

impl Voxel {
    /// Makes all points so far count `share` of what they did.
    fn fade(&mut self, share: f32) {
        self.weight *= share;
        self.scatter *= share;
        self.n_points *= share;
    }

    /// Notes a point that speaks for this voxel; older ones give way where it is off them by more than `contradicts` [voxels].
    #[inline]
    fn freshen(&mut self, distance: f32, contradicts: Option<f32>) {
        let [least, slope] = CONTRADICTS;
        let is_older = self.weight > 0.0 && self.fresh < 1.0;
        if let Some(by_noise) = contradicts.filter(|_| is_older) {
            let limit = (least + slope * distance.abs().min(self.distance.abs())).max(by_noise);
            if (distance - self.distance).abs() > limit {
                self.fade(GIVES_WAY);
            }
        }
        self.fresh = 1.0;
    }

    #[inline]
    fn add(&mut self, distance: f64, kernel: f64, variance: f64, colour: [u8; 3]) {
        let weight = (kernel / variance) as f32;
        self.weight += weight;
        self.n_points += kernel as f32;
        let share = weight / self.weight;
        let off = distance as f32 - self.distance;
        self.distance += off * share;
        self.scatter += weight * off * off * (1.0 - share);
        for (mean, it) in self.colour.iter_mut().zip(colour) {
            *mean += (f32::from(it) - *mean) * share;
        }
    }
}
