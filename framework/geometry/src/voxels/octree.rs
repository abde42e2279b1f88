//! Octree carving, from cubes of 64 cells down to bricks of 4: cubes that no view decides are halved.

use std::ops::Range;

use super::bits::BitGrid;
use super::mask::{BACKGROUND, Mask, UNSEEN};
use super::view::{BRICK, IN_BRICK, Verdict, View};
use super::{CarveError, CarveOptions, MOST_VIEWS, SilhouetteView, VoxelGrid};

/// Edge of the first cubes [cells]: a word of bits.
const FIRST: u32 = 64;

/// Carves visual hulls, and reuses its memory.
#[derive(Debug, Clone, Default)]
pub struct Carver {
    masks: Vec<Mask>,
    hull: BitGrid,
    /// By voxel: views that saw it, views that dissent. Only where these can differ; meaningless where the hull is not.
    counts: Vec<[u8; 2]>,
    /// What those are where they cannot differ.
    unanimous: Option<[u8; 2]>,
    undecided: Vec<u16>,
    body: Vec<u32>,
}

/// One carving.
struct Carving<'a> {
    views: Vec<View>,
    may_err: usize,
    min_views: usize,
    cells: [u32; 3],
    task: Task<'a>,
    /// Views that have not decided, cube within cube.
    undecided: &'a mut Vec<u16>,
}

/// What is to become of cubes that are not empty.
enum Task<'a> {
    /// The bits of the hull, and what the views say of each voxel.
    Carve { hull: &'a mut BitGrid, counts: Option<&'a mut Vec<[u8; 2]>> },
    /// First and last index of those met.
    Bound(Option<[[u32; 3]; 2]>),
}

/// Edge of the cubes that a bounding box is made of [cells].
const BOUND: u32 = 16;

/// What the views have said of all voxels of a cube.
#[derive(Debug, Clone, Copy, Default)]
struct Said {
    body: usize,
    background: usize,
    unseen: usize,
}

impl Carver {
    /// Carves `grid` with `views`.
    ///
    /// # Errors
    /// No view, too many, one with a wrong number of bytes, or as many that may err.
    pub fn carve(
        &mut self,
        grid: &VoxelGrid,
        views: &[SilhouetteView],
        options: &CarveOptions,
    ) -> Result<&BitGrid, CarveError> {
        check(views, options)?;
        let (views, order) = self.prepare(grid, views);
        self.hull.reset(grid.cells);
        let (n, min_views) = (views.len(), options.least(views.len()));
        self.unanimous = (options.may_err == 0 && min_views == n).then_some([n as u8, 0]);
        if self.unanimous.is_none() {
            let n_cells = grid.cells.iter().map(|it| *it as usize).product();
            self.counts.resize(n_cells, [0; 2]);
        }
        let counts = self.unanimous.is_none().then_some(&mut self.counts);
        let task = Task::Carve { hull: &mut self.hull, counts };
        let mut carving = Carving {
            views,
            may_err: options.may_err,
            min_views,
            cells: grid.cells,
            task,
            undecided: &mut self.undecided,
        };
        carving.visit_all();
        let views = std::mem::take(&mut carving.views);
        self.take_back(views, &order);
        Ok(&self.hull)
    }

    /// First and last index along x, y, z of a box that holds all voxels that [`Self::carve`] would keep, up to 15
    /// larger at each end; `None` if there are none. Much cheaper than carving, and without its memory.
    ///
    /// # Errors
    /// As [`Self::carve`].
    pub fn bounds(
        &mut self,
        grid: &VoxelGrid,
        views: &[SilhouetteView],
        options: &CarveOptions,
    ) -> Result<Option<[[u32; 3]; 2]>, CarveError> {
        check(views, options)?;
        let (views, order) = self.prepare(grid, views);
        let min_views = options.least(views.len());
        let (may_err, cells, undecided) = (options.may_err, grid.cells, &mut self.undecided);
        let mut carving = Carving { views, may_err, min_views, cells, task: Task::Bound(None), undecided };
        carving.visit_all();
        let views = std::mem::take(&mut carving.views);
        let Task::Bound(bounds) = carving.task else { unreachable!("the task stays what it was") };
        self.take_back(views, &order);
        let last =
            |[first, last]: [[u32; 3]; 2]| [first, std::array::from_fn(|axis| last[axis].min(grid.cells[axis] - 1))];
        Ok(bounds.map(last))
    }

    /// Views made ready, those first that call most of their picture background, and which of `views` each is.
    fn prepare(&mut self, grid: &VoxelGrid, views: &[SilhouetteView]) -> (Vec<View>, Vec<usize>) {
        self.masks.resize(views.len().max(self.masks.len()), Mask::default());
        let made = views.iter().zip(&mut self.masks).map(|(view, mask)| View::new(view, grid, std::mem::take(mask)));
        let mut made: Vec<(usize, View)> = made.enumerate().collect();
        self.body.clear();
        self.body.extend(made.iter().map(|it| it.1.mask.n_body()));
        let share =
            |it: &View| u64::from(it.mask.n_body()) * 1000 / it.mask.size.map(u64::from).iter().product::<u64>().max(1);
        made.sort_by_key(|(_, it)| share(it));
        let (order, views) = made.into_iter().unzip();
        self.undecided.clear();
        (views, order)
    }

    fn take_back(&mut self, views: Vec<View>, order: &[usize]) {
        for (view, at) in views.into_iter().zip(order) {
            self.masks[*at] = view.mask;
        }
    }

    /// The hull that was carved last.
    pub fn hull(&self) -> &BitGrid {
        &self.hull
    }

    /// Body pixels of each silhouette that was last used [px].
    pub fn body_px(&self) -> &[u32] {
        &self.body
    }

    /// Number of pictures in which a voxel of the hull lies, and how many of them call it background.
    pub fn counts(&self, index: [u32; 3]) -> [u8; 2] {
        self.unanimous.unwrap_or_else(|| self.counts[self.hull.place(index)])
    }
}

fn check(views: &[SilhouetteView], options: &CarveOptions) -> Result<(), CarveError> {
    if views.is_empty() || views.len() > MOST_VIEWS {
        return Err(CarveError::Views { found: views.len() });
    }
    if options.may_err >= views.len() {
        return Err(CarveError::Rules { may_err: options.may_err, n_views: views.len() });
    }
    for (at, view) in views.iter().enumerate() {
        let (expected, found) = (view.width as usize * view.height as usize, view.confidence.len());
        if expected != found {
            let SilhouetteView { width, height, .. } = *view;
            return Err(CarveError::Length { view: at, width, height, expected, found });
        }
    }
    Ok(())
}

impl Carving<'_> {
    fn visit_all(&mut self) {
        let n = self.views.len();
        self.undecided.extend(0..n as u16);
        let [nx, ny, nz] = self.cells;
        let firsts = |cells: u32| (0..cells).step_by(FIRST as usize);
        for z in firsts(nz) {
            for y in firsts(ny) {
                for x in firsts(nx) {
                    self.visit([x, y, z], FIRST, 0..n, Said::default());
                }
            }
        }
    }

    /// Decides about the cube whose first cell is `first`, as far as it lies in the grid. `undecided`: the views that have not yet.
    fn visit(&mut self, first: [u32; 3], edge: u32, undecided: Range<usize>, mut said: Said) {
        let half = (edge - 1) as f32 / 2.0;
        let middle = first.map(|it| it as f32 + half);
        let (n, start) = (self.views.len(), self.undecided.len());
        // Voxels that are kept are body in so many views.
        let needed = self.min_views.saturating_sub(self.may_err).max(1);
        let mut cannot_agree = 0;
        for at in undecided {
            let view = self.undecided[at];
            match self.views[view as usize].verdict(middle, half) {
                Verdict::Unseen => said.unseen += 1,
                Verdict::Background => said.background += 1,
                Verdict::Body => said.body += 1,
                Verdict::Mixed { may_agree } => {
                    cannot_agree += usize::from(!may_agree);
                    self.undecided.push(view);
                }
            }
            let may_agree = n - said.unseen - said.background - cannot_agree;
            if said.background > self.may_err || n - said.unseen < self.min_views || may_agree < needed {
                self.undecided.truncate(start);
                return;
            }
        }
        let end = self.undecided.len();
        if let Task::Bound(bounds) = &mut self.task
            && (start == end || edge == BOUND)
        {
            let (low, high) = bounds.map_or((first, first), |[low, high]| (low, high));
            *bounds = Some([
                std::array::from_fn(|axis| low[axis].min(first[axis])),
                std::array::from_fn(|axis| high[axis].max(first[axis] + edge - 1)),
            ]);
        } else if start == end {
            self.fill(first, edge, said);
        } else if edge as usize == BRICK {
            self.look(first, start..end, said);
        } else {
            let half = edge / 2;
            for octant in 0..8 {
                let at: [u32; 3] = std::array::from_fn(|axis| first[axis] + (octant >> axis & 1) * half);
                if at.iter().zip(&self.cells).all(|(at, cells)| at < cells) {
                    self.visit(at, half, start..end, said);
                }
            }
        }
        self.undecided.truncate(start);
    }

    /// All of the cube is kept.
    fn fill(&mut self, [x, y, z]: [u32; 3], edge: u32, said: Said) {
        let mask = if edge == 64 { u64::MAX } else { ((1 << edge) - 1) << (x % 64) };
        let counts = [(said.body + said.background) as u8, said.background as u8];
        let Task::Carve { hull, counts: all } = &mut self.task else { return };
        for z in z..(z + edge).min(self.cells[2]) {
            for y in y..(y + edge).min(self.cells[1]) {
                hull.set_in_row(y, z, x as usize / 64, mask);
                if let Some(all) = all {
                    let last = (x + edge).min(self.cells[0]) - 1;
                    all[hull.place([x, y, z])..=hull.place([last, y, z])].fill(counts);
                }
            }
        }
    }

    /// Asks the undecided views about each voxel of a brick.
    fn look(&mut self, first: [u32; 3], undecided: Range<usize>, said: Said) {
        let mut codes = [0; IN_BRICK];
        let mut background = [said.background as u8; IN_BRICK];
        let mut unseen = [said.unseen as u8; IN_BRICK];
        let (may_err, n) = (self.may_err as u8, self.views.len() as u8);
        let may_miss = n - self.min_views as u8;
        for at in undecided {
            self.views[self.undecided[at] as usize].look(first, &mut codes);
            let mut any = 0;
            for at in 0..IN_BRICK {
                background[at] += u8::from(codes[at] == BACKGROUND);
                unseen[at] += u8::from(codes[at] == UNSEEN);
                any |= u8::from(background[at] <= may_err) & u8::from(unseen[at] <= may_miss);
            }
            if any == 0 {
                return;
            }
        }
        let is_kept = |at: usize| {
            // One view at least says that it is body.
            background[at] <= may_err && unseen[at] <= may_miss && background[at] + unseen[at] < n
        };
        let [x, y, z] = first;
        let Task::Carve { hull, counts: all } = &mut self.task else { return };
        for row in 0..BRICK * BRICK {
            let (dy, dz) = ((row % BRICK) as u32, (row / BRICK) as u32);
            if y + dy >= self.cells[1] || z + dz >= self.cells[2] {
                continue;
            }
            let bits = (0..BRICK).fold(0, |bits, dx| bits | u64::from(is_kept(row * BRICK + dx)) << dx);
            if bits == 0 {
                continue;
            }
            hull.set_in_row(y + dy, z + dz, x as usize / 64, bits << (x % 64));
            if let Some(all) = all {
                let start = hull.place([x, y + dy, z + dz]);
                let n_inside = BRICK.min((self.cells[0] - x) as usize);
                for (dx, counts) in all[start..start + n_inside].iter_mut().enumerate() {
                    let at = row * BRICK + dx;
                    *counts = [n - unseen[at], background[at]];
                }
            }
        }
    }
}
