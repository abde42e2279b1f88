//! Dark patches on bright ground.

use nalgebra::{Matrix2, Point2, Vector2};

use crate::ImageView;

/// A dark patch that looks like a rectangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DarkPatch {
    /// Its middle, weighted by darkness [px].
    pub centre: Point2<f64>,
    /// Pixels in it.
    pub area: u32,
    /// Columns and rows that it spans [px].
    pub size: [u32; 2],
    /// Darkness of its inside: 1 − gray level over that of its surroundings [–].
    pub contrast: f64,
}

/// A group of connected dark pixels.
#[derive(Debug, Clone, Copy)]
pub(super) struct Group {
    pub area: u32,
    /// First and last column and row.
    pub bounds: [usize; 4],
    pub mean: Point2<f64>,
    moment: Matrix2<f64>,
}

impl Group {
    pub fn width(&self) -> usize {
        self.bounds[2] - self.bounds[0] + 1
    }

    pub fn height(&self) -> usize {
        self.bounds[3] - self.bounds[1] + 1
    }

    /// 12 √|M| over the area: 1 for a parallelogram, 1.05⁻¹ for an ellipse, more for what has holes, arms or bends.
    fn spread(&self) -> f64 {
        12.0 * self.moment.determinant().max(0.0).sqrt() / f64::from(self.area)
    }
}

/// What is dark in a picture, beside what lies around it.
pub(super) struct Dark<'a> {
    image: ImageView<'a>,
    mask: Vec<bool>,
    /// By block: gray level of bright ground.
    ground: Vec<f32>,
    /// Blocks in a row.
    n_blocks: [usize; 2],
    block: usize,
    pub groups: Vec<Group>,
}

/// Blocks along the longer side of a picture: a few to each rectangle's surroundings.
const BLOCKS: usize = 80;
/// Bright ground is the level that this part of the pixels in 3 × 3 blocks do not reach.
const BRIGHT_PART: f64 = 0.8;
/// Dark is less than this part of it: half way for print that reflects some 15 %.
const DARK_PART: f32 = 0.58;
/// Nothing is printed on ground that is darker than this part of the bright one, [–]
const LEAST_GROUND_PART: f32 = 0.25;
/// that being the level which this part of the blocks do not reach; but what is brighter than the second is ground in any case, and what is darker than the first is not [–, gray level, gray level].
const BRIGHT_BLOCKS: f64 = 0.95;
const LEAST_GROUND: [f32; 2] = [8.0, 50.0];
/// Pixels of a rectangle, at least; its area against its moments, at most so far from a parallelogram's.
const LEAST_AREA: u32 = 60;
const SPREADS: std::ops::Range<f64> = 0.9..1.1;
/// A rectangle covers at most this part of the picture.
const LARGEST_PART: f64 = 1.0 / 300.0;
/// Part of the pixels around a rectangle that must be bright.
const BRIGHT_AROUND: f64 = 0.85;
/// How far around a rectangle is looked at [px].
const RIM: usize = 4;

impl<'a> Dark<'a> {
    pub fn of(image: &ImageView<'a>) -> Self {
        let (width, height) = image.size();
        let block = (width.max(height) / BLOCKS).max(8);
        let n_blocks = [width.div_ceil(block).max(1), height.div_ceil(block).max(1)];
        let ground = ground(image, block, n_blocks);
        let mut sorted = ground.clone();
        sorted.sort_by(f32::total_cmp);
        let bright = sorted.get((BRIGHT_BLOCKS * sorted.len() as f64) as usize).copied().unwrap_or(0.0);
        let least_ground = (LEAST_GROUND_PART * bright).clamp(LEAST_GROUND[0], LEAST_GROUND[1]);
        let mut this =
            Self { image: *image, mask: vec![false; width * height], ground, n_blocks, block, groups: Vec::new() };
        for y in 0..height {
            let row = image.row(y);
            for (x, level) in row.iter().enumerate() {
                let ground = this.ground_at(x, y);
                this.mask[y * width + x] = ground >= least_ground && f32::from(*level) < DARK_PART * ground;
            }
        }
        this.groups = groups(&this.mask, width, height);
        this
    }

    /// Between the middles of blocks, linearly.
    fn ground_at(&self, x: usize, y: usize) -> f32 {
        let along = |at: usize, n: usize| {
            let place = ((at as f32 + 0.5) / self.block as f32 - 0.5).clamp(0.0, (n - 1) as f32);
            let first = (place as usize).min(n.saturating_sub(2));
            (first, (first + 1).min(n - 1), place - first as f32)
        };
        let (x0, x1, fx) = along(x, self.n_blocks[0]);
        let (y0, y1, fy) = along(y, self.n_blocks[1]);
        let at = |x: usize, y: usize| self.ground[y * self.n_blocks[0] + x];
        let row = |y: usize| at(x0, y) + fx * (at(x1, y) - at(x0, y));
        row(y0) + fy * (row(y1) - row(y0))
    }

    pub fn is_dark(&self, x: usize, y: usize) -> bool {
        let (width, height) = self.image.size();
        x < width && y < height && self.mask[y * width + x]
    }

    pub fn rectangles(&self) -> Vec<DarkPatch> {
        let (width, height) = self.image.size();
        let largest = (LARGEST_PART * (width * height) as f64) as u32;
        let fits = |it: &&Group| {
            (LEAST_AREA..=largest).contains(&it.area)
                && it.width() >= 5
                && it.height() >= 5
                && SPREADS.contains(&it.spread())
        };
        self.groups.iter().filter(fits).filter_map(|it| self.measure(it)).collect()
    }

    /// The centre of a group, weighted by darkness beside a plane through its surroundings.
    fn measure(&self, group: &Group) -> Option<DarkPatch> {
        let (width, height) = self.image.size();
        let [left, top, right, bottom] = group.bounds;
        if left < RIM || top < RIM || right + RIM >= width || bottom + RIM >= height {
            return None;
        }
        let (outer_x, outer_y) = (left - RIM..=right + RIM, top - RIM..=bottom + RIM);
        let is_rim = |x: usize, y: usize| x < left - 1 || x > right + 1 || y < top - 1 || y > bottom + 1;
        // A plane through what is bright around it.
        let (mut normal, mut side) = (nalgebra::Matrix3::zeros(), nalgebra::Vector3::zeros());
        let (mut n_rim, mut n_bright) = (0, 0);
        for y in outer_y.clone() {
            for x in outer_x.clone() {
                if is_rim(x, y) {
                    n_rim += 1;
                    if !self.mask[y * width + x] {
                        n_bright += 1;
                        let place = nalgebra::Vector3::new(1.0, x as f64 - group.mean.x, y as f64 - group.mean.y);
                        normal += place * place.transpose();
                        side += place * f64::from(self.image.row(y)[x]);
                    }
                }
            }
        }
        if f64::from(n_bright) < BRIGHT_AROUND * f64::from(n_rim) {
            return None;
        }
        let plane = normal.try_inverse()? * side;
        let mut inside = 0.0;
        for y in top..=bottom {
            for x in left..=right {
                if self.mask[y * width + x] {
                    inside += f64::from(self.image.row(y)[x]);
                }
            }
        }
        let inside = inside / f64::from(group.area);
        let ground = plane[0];
        // Darkness 0 to 1; what is fainter than a tenth is noise, and what shines inside does not count.
        let (mut sum, mut place) = (0.0, Vector2::zeros());
        for y in outer_y {
            for x in outer_x.clone() {
                let off = Vector2::new(x as f64 - group.mean.x, y as f64 - group.mean.y);
                let here = plane[0] + plane[1] * off.x + plane[2] * off.y;
                let level = f64::from(self.image.row(y)[x]);
                let dark = (here - level) / (here - inside).max(1.0);
                let weight = ((dark - 0.1) / 0.8).clamp(0.0, 1.0);
                let far = off.x.abs() > group.width() as f64 / 2.0 + RIM as f64;
                if !far {
                    sum += weight;
                    place += off * weight;
                }
            }
        }
        Some(DarkPatch {
            centre: group.mean + place / sum.max(1.0),
            area: group.area,
            size: [group.width() as u32, group.height() as u32],
            contrast: 1.0 - inside / ground.max(1.0),
        })
    }
}

/// By block, the level that most pixels of the block and its neighbours do not reach.
fn ground(image: &ImageView<'_>, block: usize, [columns, rows]: [usize; 2]) -> Vec<f32> {
    let mut histograms = vec![[0u32; 256]; columns * rows];
    for y in 0..image.height() {
        let line = &mut histograms[y / block * columns..(y / block + 1) * columns];
        for (x, level) in image.row(y).iter().enumerate() {
            line[x / block][usize::from(*level)] += 1;
        }
    }
    let mut ground = Vec::with_capacity(columns * rows);
    for y in 0..rows {
        for x in 0..columns {
            let mut sum = [0u32; 256];
            for v in y.saturating_sub(1)..=(y + 1).min(rows - 1) {
                for u in x.saturating_sub(1)..=(x + 1).min(columns - 1) {
                    sum.iter_mut().zip(&histograms[v * columns + u]).for_each(|(to, from)| *to += from);
                }
            }
            let wanted = (f64::from(sum.iter().sum::<u32>()) * BRIGHT_PART) as u32;
            let mut below = 0;
            let level = sum.iter().position(|it| {
                below += it;
                below > wanted
            });
            ground.push(level.unwrap_or(255) as f32);
        }
    }
    ground
}

/// Groups of pixels of `mask` that share sides, in the order of their first pixels.
fn groups(mask: &[bool], width: usize, height: usize) -> Vec<Group> {
    let mut taken = vec![false; mask.len()];
    let mut groups = Vec::new();
    let mut frontier = Vec::new();
    for first in 0..mask.len() {
        if !mask[first] || taken[first] {
            continue;
        }
        taken[first] = true;
        frontier.push(first);
        let mut bounds = [width, height, 0, 0];
        let (mut area, mut sum, mut squares) = (0u32, Vector2::zeros(), Matrix2::zeros());
        let start = Vector2::new((first % width) as f64, (first / width) as f64);
        while let Some(at) = frontier.pop() {
            let (x, y) = (at % width, at / width);
            bounds = [bounds[0].min(x), bounds[1].min(y), bounds[2].max(x), bounds[3].max(y)];
            let off = Vector2::new(x as f64, y as f64) - start;
            area += 1;
            sum += off;
            squares += off * off.transpose();
            let mut visit = |next: usize| {
                if mask[next] && !taken[next] {
                    taken[next] = true;
                    frontier.push(next);
                }
            };
            if x > 0 {
                visit(at - 1);
            }
            if x + 1 < width {
                visit(at + 1);
            }
            if y > 0 {
                visit(at - width);
            }
            if y + 1 < height {
                visit(at + width);
            }
        }
        let mean = sum / f64::from(area);
        // Pixels are squares.
        let moment = squares / f64::from(area) - mean * mean.transpose() + Matrix2::identity() / 12.0;
        groups.push(Group { area, bounds, mean: Point2::from(start + mean), moment });
    }
    groups
}
