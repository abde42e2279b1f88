//! A view of a grid: bounds of cubes in the picture, in single precision.
//!
//! The place of a cube is given in cells from the centre of cell (0, 0, 0), so that a step along an axis adds a fixed vector in the camera.
//!
//! *Bounds.* Let the middle of a box have (X, Y, Z) in the camera, u = X/Z, and let dX, dZ range over the box, which is symmetric. Then
//! (X + dX)/(Z + dZ) − u = (dX − u dZ)/(Z + dZ), so that |Δu| ≤ e = Σ |Xᵢ − u Zᵢ| h / (Z − Σ |Zᵢ| h), the sums over the three axes with half-edge h. Of
//! the lens x' = x R(s) + 2 p₁ x y + p₂ (s + 2 x²), s = x² + y²: |Δs| ≤ S = 2 (|x| eₓ + |y| e_y) + eₓ² + e_y², |ΔR| ≤ S (|k₁| + 2 |k₂| t + 3 |k₃| t²) up to
//! t = s + S, and the rest term by term.

use super::mask::Mask;
use super::{SilhouetteView, VoxelGrid};
use crate::Distortion;

/// Edge of the cubes that are projected voxel by voxel [cells].
pub(super) const BRICK: usize = 4;
/// Voxels in such a cube.
pub(super) const IN_BRICK: usize = BRICK * BRICK * BRICK;
/// What single precision may be off, and more: 1/64 [px].
const MARGIN: f32 = 1.0 / 64.0;
/// Adding this to a number from 0 to 2²² rounds it to the nearest whole one, which then stands in its lowest bits.
const ROUND: f32 = 8_388_608.0;

/// What a view says of all voxels of a cube.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// No voxel lies in its picture.
    Unseen,
    /// All lie in it, none is body.
    Background,
    /// All are body.
    Body,
    /// The view cannot decide for all at once.
    Mixed {
        /// Whether any of them may be body.
        may_agree: bool,
    },
}

#[derive(Debug, Clone)]
pub(super) struct View {
    /// The camera's x, y, z at the centre of cell (0, 0, 0) [m].
    start: [f32; 3],
    /// How each changes by a cell along each axis of the grid [m].
    step: [[f32; 3]; 3],
    focal: [f32; 2],
    principal: [f32; 2],
    skew: f32,
    /// k1, k2, k3.
    radial: [f32; 3],
    /// p1, p2.
    decentering: [f32; 2],
    /// Squared radius at which the lens ends.
    domain: f32,
    /// Of the voxels of a brick, along z, y, x: what to add to its first one's x, y, z.
    offsets: Box<[[f32; IN_BRICK]; 3]>,
    pub mask: Mask,
}

impl View {
    pub fn new(view: &SilhouetteView, grid: &VoxelGrid, mut mask: Mask) -> View {
        mask.set(view.confidence, view.width as usize, view.height as usize);
        let pose = &view.camera.camera_from_world;
        let rotation = pose.rotation.to_rotation_matrix();
        let start = pose * grid.centre([0; 3]);
        let step: [[f32; 3]; 3] =
            std::array::from_fn(|row| std::array::from_fn(|axis| (rotation[(row, axis)] * grid.size) as f32));
        let offset = |row: usize, at: usize| {
            let [x, y, z] = [at % BRICK, at / BRICK % BRICK, at / (BRICK * BRICK)].map(|it| it as f32);
            step[row][0] * x + step[row][1] * y + step[row][2] * z
        };
        let optics = &view.camera.intrinsics;
        let shrink = f64::from(view.shrink.max(1));
        let place = |at: f64, start: u32| ((at + 0.5 - f64::from(start)) / shrink - 0.5) as f32;
        let Distortion { k1, k2, p1, p2, k3 } = view.camera.distortion;
        View {
            start: [start.x, start.y, start.z].map(|it| it as f32),
            step,
            focal: optics.focal.map(|it| (it / shrink) as f32),
            principal: [place(optics.principal[0], view.left), place(optics.principal[1], view.top)],
            skew: (optics.skew / shrink) as f32,
            radial: [k1 as f32, k2 as f32, k3 as f32],
            decentering: [p1 as f32, p2 as f32],
            domain: view.camera.distortion.domain() as f32,
            offsets: Box::new(std::array::from_fn(|row| std::array::from_fn(|at| offset(row, at)))),
            mask,
        }
    }

    /// The verdict on the voxels whose indices lie within `half` of `middle` along each axis [cells].
    pub fn verdict(&self, middle: [f32; 3], half: f32) -> Verdict {
        const MIXED: Verdict = Verdict::Mixed { may_agree: true };
        let at = |row: usize| {
            let step = &self.step[row];
            self.start[row] + step[0] * middle[0] + step[1] * middle[1] + step[2] * middle[2]
        };
        let (depth, steps) = (at(2), &self.step[2]);
        let depth_reach = half * (steps[0].abs() + steps[1].abs() + steps[2].abs());
        if depth + depth_reach <= 0.0 {
            return Verdict::Unseen;
        }
        let nearest = depth - depth_reach;
        if nearest <= 0.0 {
            return MIXED;
        }
        let per_depth = 1.0 / depth;
        let (x, y) = (at(0) * per_depth, at(1) * per_depth);
        let reach = |row: usize, at: f32| {
            let by = |axis: usize| (self.step[row][axis] - at * self.step[2][axis]).abs();
            half * (by(0) + by(1) + by(2)) / nearest
        };
        let (ex, ey) = (reach(0, x), reach(1, y));
        let ([k1, k2, k3], [p1, p2]) = (self.radial, self.decentering);
        let s = x * x + y * y;
        let (ax, ay) = (x.abs(), y.abs());
        let s_reach = 2.0 * (ax * ex + ay * ey) + ex * ex + ey * ey;
        let s_most = s + s_reach;
        if s_most >= self.domain {
            let (nearest_x, nearest_y) = ((ax - ex).max(0.0), (ay - ey).max(0.0));
            let s_least = nearest_x * nearest_x + nearest_y * nearest_y;
            return if s_least >= self.domain { Verdict::Unseen } else { MIXED };
        }
        let radial = 1.0 + s * (k1 + s * (k2 + s * k3));
        let radial_reach = s_reach * (k1.abs() + s_most * (2.0 * k2.abs() + 3.0 * k3.abs() * s_most));
        let cross = 2.0 * (ax * ey + ay * ex + ex * ey);
        let distorted_x = x * radial + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x);
        let distorted_y = y * radial + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y;
        let reach_x = radial.abs() * ex
            + (ax + ex) * radial_reach
            + p1.abs() * cross
            + p2.abs() * (s_reach + 2.0 * ex * (2.0 * ax + ex));
        let reach_y = radial.abs() * ey
            + (ay + ey) * radial_reach
            + p1.abs() * (s_reach + 2.0 * ey * (2.0 * ay + ey))
            + p2.abs() * cross;
        let u = self.focal[0] * distorted_x + self.skew * distorted_y + self.principal[0];
        let v = self.focal[1] * distorted_y + self.principal[1];
        let u_reach = self.focal[0] * reach_x + self.skew.abs() * reach_y + MARGIN;
        let v_reach = self.focal[1] * reach_y + MARGIN;
        self.in_rectangle([u - u_reach, u + u_reach], [v - v_reach, v + v_reach])
    }

    /// What the picture says of pixel coordinates between these.
    #[inline]
    fn in_rectangle(&self, u: [f32; 2], v: [f32; 2]) -> Verdict {
        let [width, height] = self.mask.size.map(|it| it as f32);
        // Written so that a bound that is not a number is undecided.
        if u[1] < -0.5 || v[1] < -0.5 || u[0] >= width - 0.5 || v[0] >= height - 0.5 {
            return Verdict::Unseen;
        }
        let is_inside = u[0] >= -0.5 && v[0] >= -0.5 && u[1] < width - 0.5 && v[1] < height - 0.5;
        let pixels = |[first, last]: [f32; 2], most: f32| {
            [(first + 0.5).max(0.0) as u32, (last + 0.5).min(most - 1.0) as u32 + 1]
        };
        let (columns, rows) = (pixels(u, width), pixels(v, height));
        let n_body = self.mask.count(columns, rows);
        if !is_inside {
            Verdict::Mixed { may_agree: n_body > 0 }
        } else if n_body == 0 {
            Verdict::Background
        } else if n_body == (columns[1] - columns[0]) * (rows[1] - rows[0]) {
            Verdict::Body
        } else {
            Verdict::Mixed { may_agree: true }
        }
    }

    /// The verdict on each voxel of the brick whose first one is `first`: along x, then y, then z.
    pub fn look(&self, first: [u32; 3], codes: &mut [u8; IN_BRICK]) {
        let [i, j, k] = first.map(|it| it as f32);
        let base: [f32; 3] = std::array::from_fn(|row| {
            let step = &self.step[row];
            self.start[row] + step[0] * i + step[1] * j + step[2] * k
        });
        let [k1, k2, k3] = self.radial;
        let [p1, p2] = self.decentering;
        let [width, height] = self.mask.size.map(|it| it as f32 - 0.5);
        let [columns, rows] = self.mask.extent.map(|it| it as f32 + 1.0);
        let [left, top] = self.mask.start.map(|it| it as f32 - 1.0);
        let stride = self.mask.extent[0] + 2;
        let mut places = [0u32; IN_BRICK];
        let [ox, oy, oz] = &*self.offsets;
        for at in 0..IN_BRICK {
            let depth = base[2] + oz[at];
            let per_depth = 1.0 / depth;
            let (x, y) = ((base[0] + ox[at]) * per_depth, (base[1] + oy[at]) * per_depth);
            let s = x * x + y * y;
            let radial = 1.0 + s * (k1 + s * (k2 + s * k3));
            let (twice_xy, dx, dy) = (2.0 * x * y, x * radial, y * radial);
            let distorted_x = dx + p1 * twice_xy + p2 * (s + 2.0 * x * x);
            let distorted_y = dy + p1 * (s + 2.0 * y * y) + p2 * twice_xy;
            let u = self.focal[0] * distorted_x + self.skew * distorted_y + self.principal[0];
            let v = self.focal[1] * distorted_y + self.principal[1];
            let seen = (depth > 0.0) & (s < self.domain) & (u >= -0.5) & (v >= -0.5) & (u < width) & (v < height);
            let column = whole(u - left, columns);
            let row = whole(v - top, rows);
            places[at] = if seen { 1 + row * stride + column } else { 0 };
        }
        let table = &self.mask.codes[..];
        for (code, place) in codes.iter_mut().zip(&places) {
            *code = table[*place as usize];
        }
    }
}

/// The whole number nearest to `at`, between 0 and `most`.
#[inline(always)]
fn whole(at: f32, most: f32) -> u32 {
    let at = if at > 0.0 { at } else { 0.0 };
    let at = if at < most { at } else { most };
    (at + ROUND).to_bits() & 0x3f_ffff
}
