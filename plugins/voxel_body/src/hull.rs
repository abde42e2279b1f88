//! From the silhouettes of one time to voxels: which views carve, the bounding volume, the hull, its parts, its colours.

use foveate::geometry::Camera;
use foveate::geometry::voxels::{
    BitGrid, CarveError, CarveOptions, Carver, Cover, Doubt, DoubtOptions, Part, Parts, Picture, SilhouetteView,
    VoxelGrid, colours, cover, opinions,
};
use foveate::prelude::*;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A box along the axes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Volume {
    /// Least x, y, z [m]
    pub min: [f64; 3],
    /// Greatest x, y, z [m]
    pub max: [f64; 3],
}

/// How a [`Hull`] is made.
#[derive(Debug, Clone, PartialEq)]
pub struct HullOptions {
    /// Edge of a voxel [m].
    pub size: f64,
    /// Views that may call a voxel background although it is body.
    pub may_err: usize,
    /// Views in whose picture a voxel has to lie; 0: in all that carve.
    pub min_views: usize,
    /// Smaller parts are left out [m³].
    pub min_component: f64,
    /// A view without which the silhouettes of all others are covered, and with which less than this part of one is not, is left out [–].
    pub min_completeness: f64,
    /// How far a target may be from the part that it names [m].
    pub target_reach: f64,
    /// When voxels are kept that some views only call perhaps body.
    pub doubt: DoubtOptions,
}

/// One camera's part.
pub struct View<'a> {
    /// In the space of the voxels, as it stood.
    pub camera: Camera,
    /// What it saw.
    pub silhouette: &'a Silhouette,
    /// In what colours.
    pub picture: Option<&'a Image>,
    /// Whether it is known where it stood.
    pub is_placed: bool,
}

/// Makes hulls; keeps its memory.
pub struct Hull {
    options: HullOptions,
    grid: VoxelGrid,
    carver: Carver,
    /// Tries views.
    trials: Carver,
    doubt: Doubt,
    drawn: Vec<u8>,
}

/// Views, at least, for one of them to be found in contradiction to the others.
const TO_CONTRADICT: usize = 4;
/// How many times larger voxels are while views are tried.
const COARSE: f64 = 2.0;

impl Hull {
    /// For a volume.
    ///
    /// # Errors
    /// A volume that is none, or too many voxels.
    pub fn new(options: HullOptions, volume: Volume) -> Result<Hull, CarveError> {
        let grid = VoxelGrid::covering(Point3::from(volume.min), Point3::from(volume.max), options.size)?;
        Ok(Hull {
            options,
            grid,
            carver: Carver::default(),
            trials: Carver::default(),
            doubt: Doubt::default(),
            drawn: Vec::new(),
        })
    }

    /// Fills `voxels` (all but its time and place) with what `views` leave over; `cameras` are all that should have one, `targets` who may be there. Gives how many small parts
    /// were left out.
    ///
    /// # Errors
    /// Why nothing can be carved; the statements about the views are there all the same.
    pub fn carve(
        &mut self,
        views: &[View],
        cameras: &[CameraId],
        targets: &[(TargetId, Point3<f64>)],
        voxels: &mut Voxels,
    ) -> Result<usize, String> {
        let mut statuses: Vec<ViewStatus> = views.iter().map(|it| self.status(it)).collect();
        leave_out_empty(&mut statuses, views);
        let result = self.carve_with(views, &mut statuses, targets, voxels);
        let missing = cameras.iter().filter(|it| !views.iter().any(|view| view.silhouette.camera == **it));
        voxels.views.extend(missing.map(|&camera| statement(camera, ViewStatus::Missing, Cover::default())));
        for (view, status) in views.iter().zip(&statuses) {
            let camera = view.silhouette.camera;
            if !voxels.views.iter().any(|it| it.camera == camera) {
                let cover = Cover { body: view.silhouette.n_body, ..Cover::default() };
                voxels.views.push(statement(camera, *status, cover));
            }
        }
        voxels.views.sort_by_key(|it| it.camera);
        result
    }

    fn carve_with(
        &mut self,
        views: &[View],
        statuses: &mut [ViewStatus],
        targets: &[(TargetId, Point3<f64>)],
        voxels: &mut Voxels,
    ) -> Result<usize, String> {
        if !statuses.contains(&ViewStatus::Used) {
            return Err("no camera has a silhouette that is worth anything".to_owned());
        }
        let mut found = self.hull_of(views, statuses, self.grid)?;
        // What views say of each voxel is asked of the carver later: trials have one of their own.
        std::mem::swap(&mut self.carver, &mut self.trials);
        let contradicting = self.contradicting(views, statuses, found.as_ref());
        std::mem::swap(&mut self.carver, &mut self.trials);
        if let Some(at) = contradicting? {
            statuses[at] = ViewStatus::Contradicts;
            found = self.hull_of(views, statuses, self.grid)?;
        }
        (voxels.size, voxels.origin, voxels.cells) = (self.grid.size, self.grid.origin, self.grid.cells);
        let Some(Found { grid, offset, hull, sure, surface }) = found else { return Ok(0) };
        for (view, status) in views.iter().zip(&*statuses) {
            let cover = cover(&grid, &surface, &silhouette_view(view), &mut self.drawn);
            voxels.views.push(statement(view.silhouette.camera, *status, cover));
        }
        let parts = Parts::of(&hull);
        let least = (self.options.min_component / grid.size.powi(3)).ceil().max(1.0);
        let n_kept = parts.list.iter().take_while(|it| f64::from(it.n_voxels) >= least).count().min(1 << 16);
        voxels.components = parts.list[..n_kept].iter().map(|it| self.component(it, &grid, offset)).collect();
        name(&mut voxels.components, targets, &self.grid, self.options.target_reach);
        let pictures: Vec<Picture> = views
            .iter()
            .zip(&*statuses)
            .filter(|it| *it.1 == ViewStatus::Used)
            .filter_map(|it| picture(it.0))
            .collect();
        let colours = match pictures.is_empty() {
            true => Vec::new(),
            false => colours(&grid, &hull, &surface, &pictures),
        };
        let used = used_views(views, statuses);
        let mut of_surface = colours.into_iter();
        for index in hull.iter() {
            let is_surface = surface.get(index);
            let colour = if is_surface { of_surface.next().unwrap_or_default() } else { [0; 3] };
            let Some(component) = parts.part(index).filter(|it| (*it as usize) < n_kept) else { continue };
            let [seen, dissent] = match sure.get(index) {
                true => self.carver.counts(index),
                false => said(&grid, index, &used),
            };
            voxels.push(&Voxel {
                index: std::array::from_fn(|axis| (index[axis] + offset[axis]) as u16),
                colour,
                is_surface,
                seen,
                dissent,
                component: component as u16,
            });
        }
        Ok(parts.list.len() - n_kept)
    }

    fn status(&self, view: &View) -> ViewStatus {
        match view.silhouette.status {
            _ if !view.is_placed => ViewStatus::Unplaced,
            SilhouetteStatus::Learning => ViewStatus::Learning,
            SilhouetteStatus::Full => ViewStatus::Full,
            SilhouetteStatus::Moved => ViewStatus::Moved,
            SilhouetteStatus::Seen | SilhouetteStatus::Empty if self.is_out_of_view(view) => ViewStatus::OutOfView,
            SilhouetteStatus::Seen | SilhouetteStatus::Empty => ViewStatus::Used,
        }
    }

    /// Whether none of the volume lies in the picture: by its corners, its middle, and the middles of its faces, which a camera that looks past it misses all.
    fn is_out_of_view(&self, view: &View) -> bool {
        let extent = Vector3::from(self.grid.cells.map(f64::from)) * self.grid.size;
        let silhouette = silhouette_view(view);
        (0..125).all(|at| {
            let part = Vector3::new(f64::from(at % 5), f64::from(at / 5 % 5), f64::from(at / 25)) / 4.0;
            let point = self.grid.origin + extent.component_mul(&part);
            let Some(pixel) = view.camera.project(&point) else { return true };
            let place = |at: f64, start: u32| (at + 0.5 - f64::from(start)) / f64::from(silhouette.shrink.max(1));
            let (x, y) = (place(pixel.x, silhouette.left), place(pixel.y, silhouette.top));
            !(x >= 0.0 && y >= 0.0 && x < silhouette.width.into() && y < silhouette.height.into())
        })
    }

    /// The hull of the views that are used; `None` without a voxel.
    fn hull_of(&mut self, views: &[View], statuses: &[ViewStatus], grid: VoxelGrid) -> Result<Option<Found>, String> {
        let used = used_views(views, statuses);
        // With fewer views than planned for, fewer may err.
        let may_err = self.options.may_err.min(used.len().saturating_sub(1));
        let options = CarveOptions { may_err, min_views: self.options.min_views };
        let words = |error: CarveError| error.to_string();
        let doubt = self.options.doubt;
        let any_doubt = self.doubt.look(&used, &doubt);
        let bounds = match any_doubt {
            true => self.doubt.bounds(&grid, &used, &options),
            false => self.carver.bounds(&grid, &used, &options),
        };
        let Some([low, high]) = bounds.map_err(words)? else { return Ok(None) };
        // An empty layer around it, where there is one, so that its surface is known.
        let low = low.map(|it| it.saturating_sub(1));
        let high: [u32; 3] = std::array::from_fn(|axis| (high[axis] + 2).min(grid.cells[axis]));
        let inner = VoxelGrid {
            origin: grid.origin + Vector3::from(low.map(f64::from)) * grid.size,
            cells: std::array::from_fn(|axis| high[axis] - low[axis]),
            ..grid
        };
        let sure = self.carver.carve(&inner, &used, &options).map_err(words)?.clone();
        let mut hull = sure.clone();
        if any_doubt {
            self.doubt.add(&mut hull, &inner, &used, &options, &doubt).map_err(words)?;
        }
        let surface = hull.surface();
        Ok((surface.count() > 0).then_some(Found { grid: inner, offset: low, hull, sure, surface }))
    }

    /// The view that contradicts the others, if one does: with it the hull leaves much of a silhouette uncovered, without it hardly any of the others'.
    fn contradicting(
        &mut self,
        views: &[View],
        statuses: &[ViewStatus],
        found: Option<&Found>,
    ) -> Result<Option<usize>, String> {
        let used: Vec<usize> = (0..views.len()).filter(|it| statuses[*it] == ViewStatus::Used).collect();
        let limit = self.options.min_completeness;
        if used.len() < TO_CONTRADICT || limit == 0.0 {
            return Ok(None);
        }
        // Half-way between what is too little and all.
        let good = 0.5 * (1.0 + limit);
        let with_all = found.map_or(0.0, |it| self.least_covered(views, &used, it, None));
        if with_all >= limit {
            return Ok(None);
        }
        let size = COARSE * self.grid.size;
        let cells = self.grid.cells.map(|it| (f64::from(it) / COARSE).ceil() as u32);
        let coarse = VoxelGrid { size, cells, ..self.grid };
        let mut best: Option<(usize, f64)> = None;
        for &left_out in &used {
            let mut statuses = statuses.to_vec();
            statuses[left_out] = ViewStatus::Contradicts;
            let Some(found) = self.hull_of(views, &statuses, coarse)? else { continue };
            let covered = self.least_covered(views, &used, &found, Some(left_out));
            if covered >= good && best.is_none_or(|it| covered > it.1) {
                best = Some((left_out, covered));
            }
        }
        Ok(best.map(|it| it.0))
    }

    /// The least part of a silhouette that the hull covers, over the used views but one.
    fn least_covered(&mut self, views: &[View], used: &[usize], found: &Found, but: Option<usize>) -> f64 {
        let used = used.iter().filter(|it| Some(**it) != but);
        let drawn = &mut self.drawn;
        let of = |at: &usize| cover(&found.grid, &found.surface, &silhouette_view(&views[*at]), drawn).completeness();
        used.map(of).fold(1.0, f64::min)
    }

    fn component(&self, part: &Part, grid: &VoxelGrid, offset: [u32; 3]) -> VoxelComponent {
        let whole = |index: [u32; 3]| -> [u16; 3] { std::array::from_fn(|axis| (index[axis] + offset[axis]) as u16) };
        let (min, max) = (whole(part.min), whole(part.max));
        // Who stands reaches the floor, where a volume ends.
        let reaches = |axis: usize| (axis < 2 && min[axis] == 0) || u32::from(max[axis]) + 1 == self.grid.cells[axis];
        VoxelComponent {
            n_voxels: part.n_voxels,
            centroid: grid.origin + (part.centroid + Vector3::repeat(0.5)) * grid.size,
            min,
            max,
            is_cut_off: (0..3).any(reaches),
            target: None,
        }
    }
}

/// A hull, in a part of the grid that begins at `offset`.
struct Found {
    grid: VoxelGrid,
    offset: [u32; 3],
    hull: BitGrid,
    /// Without what is in doubt.
    sure: BitGrid,
    surface: BitGrid,
}

fn used_views<'a>(views: &'a [View], statuses: &[ViewStatus]) -> Vec<SilhouetteView<'a>> {
    views.iter().zip(statuses).filter(|it| *it.1 == ViewStatus::Used).map(|it| silhouette_view(it.0)).collect()
}

/// In how many pictures a voxel lies, and how many of them do not call it body.
fn said(grid: &VoxelGrid, index: [u32; 3], views: &[SilhouetteView]) -> [u8; 2] {
    let (seen, dissent) = opinions(&grid.centre(index), views);
    [seen as u8, dissent as u8]
}

fn statement(camera: CameraId, status: ViewStatus, cover: Cover) -> VoxelView {
    let covered = if cover.body == 0 { 0.0 } else { cover.completeness() };
    VoxelView { camera, status, body_px: cover.body, covered, outside: cover.outside() }
}

fn silhouette_view<'a>(view: &'a View<'a>) -> SilhouetteView<'a> {
    let Silhouette { width, height, window, confidence, .. } = view.silhouette;
    SilhouetteView {
        camera: &view.camera,
        left: window.left,
        top: window.top,
        shrink: window.shrink,
        width: *width,
        height: *height,
        confidence,
    }
}

fn picture<'a>(view: &'a View<'a>) -> Option<Picture<'a>> {
    let Image { width, height, format, pixels, window, .. } = view.picture?;
    Some(Picture {
        camera: &view.camera,
        left: window.left,
        top: window.top,
        shrink: window.shrink,
        width: *width,
        height: *height,
        channels: format.channels(),
        pixels,
    })
}

/// A camera that sees nobody where more cameras see somebody has not found the body; where most see nobody, nobody is there.
fn leave_out_empty(statuses: &mut [ViewStatus], views: &[View]) {
    let is_used = |at: &usize| statuses[*at] == ViewStatus::Used;
    let (empty, seen): (Vec<usize>, Vec<usize>) =
        (0..views.len()).filter(is_used).partition(|at| views[*at].silhouette.status == SilhouetteStatus::Empty);
    if seen.len() >= 2 && seen.len() > empty.len() {
        empty.into_iter().for_each(|at| statuses[at] = ViewStatus::Empty);
    }
}

/// Each component gets the target nearest to its box, each target names one.
fn name(components: &mut [VoxelComponent], targets: &[(TargetId, Point3<f64>)], grid: &VoxelGrid, reach: f64) {
    let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
    for (at, component) in components.iter().enumerate() {
        let corner =
            |index: [u16; 3], by: f64| grid.origin + Vector3::from(index.map(|it| f64::from(it) + by)) * grid.size;
        let (min, max) = (corner(component.min, 0.0), corner(component.max, 1.0));
        for (target, (_, position)) in targets.iter().enumerate() {
            let gap = (0..3).map(|axis| (min[axis] - position[axis]).max(position[axis] - max[axis]).max(0.0));
            let gap = gap.map(|it| it * it).sum::<f64>().sqrt();
            if gap <= reach {
                // Within both boxes the nearer middle counts.
                pairs.push((gap + 1e-3 * (component.centroid - position).norm(), at, target));
            }
        }
    }
    pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).then(a.2.cmp(&b.2)));
    let mut taken = vec![false; targets.len()];
    for (_, at, target) in pairs {
        if components[at].target.is_none() && !taken[target] {
            components[at].target = Some(targets[target].0);
            taken[target] = true;
        }
    }
}
