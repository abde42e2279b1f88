//! From the silhouettes of one time to voxels: which views carve, the bounding volume, the hull, its parts, its colours.

mod contradiction;
mod displaced;
mod losses;
mod mirrored;

pub use contradiction::Contradiction;
pub use displaced::{Fit, fit};

use std::collections::BTreeMap;

use foveate::geometry::Camera;
use foveate::geometry::voxels::{
    BitGrid, CarveError, CarveOptions, Carver, Cover, Doubt, DoubtOptions, Part, Parts, Picture, SilhouetteView,
    VoxelGrid, colours, cover, opinions,
};
use foveate::prelude::*;
use nalgebra::{Point3, Vector3};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use losses::{Losses, Rule};

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
    /// Cameras of the calibration.
    pub n_cameras: usize,
    /// Part of the views that may have lost a voxel that others ask for [–].
    pub may_lose: f64,
    /// Smaller parts are left out [m³]; `None`: those below a litre and below a twentieth of the largest.
    pub min_component: Option<f64>,
    /// Below this mean coverage of the silhouettes, a view that contradicts the others is searched; 0: never [–].
    pub min_completeness: f64,
    /// How far a target may be from the part that it names [m].
    pub target_reach: f64,
    /// When voxels are kept that some views only call perhaps body.
    pub doubt: DoubtOptions,
}

/// What a set of voxels leaves out.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Dropped {
    /// Pieces that were left out for their size.
    pub count: usize,
    /// Of the largest of these [m³].
    pub largest: f64,
    /// Whether silhouettes go on below the volume's floor.
    pub goes_below: bool,
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
    /// Tries views without changing the other carver's state.
    trials: Carver,
    doubt: Doubt,
    losses: Losses,
    /// Coverage of each used view, for the search of losses.
    covers: Vec<Cover>,
    drawn: Vec<u8>,
    /// Who contradicts the others, as found last.
    contradictions: Vec<Contradiction>,
    /// Who was found before, and for how many searches more that holds.
    suspects: BTreeMap<CameraId, (Contradiction, u32)>,
    /// Sets until the next search.
    until_search: u32,
    /// Whether the last set fitted much better mirrored; `None`: that was not asked.
    is_mirrored: Option<bool>,
}

/// Why one view carves nothing.
pub(crate) const ONE_VIEW: &str =
    "one view alone bounds no body: no other camera has a silhouette of this time that is worth anything";
/// A body that reaches so far below the volume's floor stands on another one [m]: below a foot, cameras that look down by 45° or less do not call so much body.
const BELOW: f64 = 0.15;
/// Part of the area standing on the floor that has silhouettes below it [–], and number of sampled places along a side.
const BELOW_SHARE: f64 = 0.3;
const BELOW_PLACES: u32 = 32;
/// A litre, and the part of the largest piece, below which pieces are left out where nothing is said [m³, –].
const SMALLEST: [f64; 2] = [1e-3, 0.05];

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
            losses: Losses::default(),
            covers: Vec::new(),
            drawn: Vec::new(),
            contradictions: Vec::new(),
            suspects: BTreeMap::new(),
            until_search: 0,
            is_mirrored: None,
        })
    }

    /// The views that were left out of the last set for contradicting the others.
    pub fn contradictions(&self) -> &[Contradiction] {
        &self.contradictions
    }

    /// Whether the silhouettes of the last set would fit each other much better mirrored left to right; `None`: they fit as they are, or it was not asked this time.
    pub fn is_mirrored(&self) -> Option<bool> {
        self.is_mirrored
    }

    /// Fills `voxels` (all but its time and place) with what `views` leave over; `cameras` are all that should have one, `targets` who may be there. Gives which small pieces
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
    ) -> Result<Dropped, String> {
        let mut statuses: Vec<ViewStatus> = views.iter().map(|it| self.status(it)).collect();
        self.is_mirrored = None;
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
    ) -> Result<Dropped, String> {
        if !statuses.contains(&ViewStatus::Used) {
            return Err("no camera has a silhouette that is worth anything".to_owned());
        }
        let n_used = statuses.iter().filter(|it| **it == ViewStatus::Used).count();
        if n_used == 1 && self.options.n_cameras > 1 {
            return Err(ONE_VIEW.to_owned());
        }
        let found = self.leave_out_contradicting(views, statuses)?;
        self.covers.clear();
        let found = self.with_losses(views, statuses, found)?;
        (voxels.size, voxels.origin, voxels.cells) = (self.grid.size, self.grid.origin, self.grid.cells);
        voxels.contested = self.contested(views, statuses, found.as_ref())?;
        let Some(Found { grid, offset, hull, sure, surface }) = found else { return Ok(Dropped::default()) };
        let mut known = std::mem::take(&mut self.covers).into_iter();
        for (view, status) in views.iter().zip(&*statuses) {
            let known = if *status == ViewStatus::Used { known.next() } else { None };
            let cover = known.unwrap_or_else(|| cover(&grid, &surface, &silhouette_view(view), &mut self.drawn));
            voxels.views.push(statement(view.silhouette.camera, *status, cover));
        }
        let parts = Parts::of(&hull);
        let largest = parts.list.first().map_or(0.0, |it| f64::from(it.n_voxels));
        let least = match self.options.min_component {
            Some(least) => least / grid.size.powi(3),
            None => (SMALLEST[0] / grid.size.powi(3)).min(SMALLEST[1] * largest),
        };
        let least = least.ceil().max(1.0);
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
        let left_out = &parts.list[n_kept..];
        let largest = left_out.first().map_or(0.0, |it| f64::from(it.n_voxels) * grid.size.powi(3));
        let goes_below = self.goes_below(&grid, offset, &surface, &used_views(views, statuses));
        Ok(Dropped { count: left_out.len(), largest, goes_below })
    }

    /// Whether what stands on the volume's floor goes on below it: silhouettes of views that do not look down steeply have a body there, too.
    fn goes_below(&self, grid: &VoxelGrid, offset: [u32; 3], surface: &BitGrid, used: &[SilhouetteView]) -> bool {
        if offset[2] > 0 {
            return false;
        }
        let floor: Vec<[u32; 3]> = surface.iter().filter(|it| it[2] == 0).collect();
        let bound = |axis: usize| {
            let places = floor.iter().map(|it| it[axis]);
            Some([places.clone().min()?, places.max()?])
        };
        let (Some([west, east]), Some([south, north])) = (bound(0), bound(1)) else { return false };
        // A leg that slants comes out beside the place where it goes in.
        let aside = (BELOW / grid.size).ceil() as u32;
        let step = ((east - west).max(north - south) + 2 * aside).div_ceil(BELOW_PLACES).max(1);
        let n_below = (0..=(east - west + 2 * aside) / step)
            .flat_map(|x| (0..=(north - south + 2 * aside) / step).map(move |y| [x * step, y * step]))
            .filter(|[x, y]| {
                let off =
                    Vector3::new(f64::from(*x), f64::from(*y), 0.0) - Vector3::new(1.0, 1.0, 0.0) * f64::from(aside);
                let below = grid.centre([west, south, 0]) + off * grid.size - Vector3::z() * BELOW;
                let is_flat = |it: &&SilhouetteView| {
                    let away = it.camera.centre() - below;
                    away.z.abs() < away.xy().norm()
                };
                let flat: Vec<SilhouetteView> = used.iter().filter(is_flat).copied().collect();
                let (seen, dissent) = opinions(&below, &flat);
                seen >= 2 && dissent == 0
            })
            .count();
        (n_below * step.pow(2) as usize) as f64 > BELOW_SHARE * floor.len() as f64
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
        let options = self.rules(used.len());
        let any_doubt = self.doubt.look(&used, &self.options.doubt);
        let bounds = match any_doubt {
            true => self.doubt.bounds(&grid, &used, &options),
            false => self.carver.bounds(&grid, &used, &options),
        };
        let Some(bounds) = bounds.map_err(|it| it.to_string())? else { return Ok(None) };
        let (inner, low) = self.inner(grid, bounds);
        let found = self.hull_in(views, statuses, inner, low)?;
        Ok((found.surface.count() > 0).then_some(found))
    }

    /// With fewer views than planned for, fewer may err.
    fn rules(&self, n_used: usize) -> CarveOptions {
        CarveOptions { may_err: self.options.may_err.min(n_used.saturating_sub(1)), min_views: self.options.min_views }
    }

    /// The part of a grid from its first to its last cell, with an empty layer around it, where there is one, so that its surface is known; and where it begins.
    fn inner(&self, grid: VoxelGrid, [low, high]: [[u32; 3]; 2]) -> (VoxelGrid, [u32; 3]) {
        let low = low.map(|it| it.saturating_sub(1));
        let high: [u32; 3] = std::array::from_fn(|axis| (high[axis] + 2).min(grid.cells[axis]));
        let inner = VoxelGrid {
            origin: grid.origin + Vector3::from(low.map(f64::from)) * grid.size,
            cells: std::array::from_fn(|axis| high[axis] - low[axis]),
            ..grid
        };
        (inner, low)
    }

    /// The hull in a part of the grid; it may be empty.
    fn hull_in(
        &mut self,
        views: &[View],
        statuses: &[ViewStatus],
        grid: VoxelGrid,
        offset: [u32; 3],
    ) -> Result<Found, String> {
        let used = used_views(views, statuses);
        let options = self.rules(used.len());
        let words = |error: CarveError| error.to_string();
        let doubt = self.options.doubt;
        let any_doubt = self.doubt.look(&used, &doubt);
        let sure = self.carver.carve(&grid, &used, &options).map_err(words)?.clone();
        let mut hull = sure.clone();
        if any_doubt {
            self.doubt.add(&mut hull, &grid, &used, &options, &doubt).map_err(words)?;
        }
        let surface = hull.surface();
        Ok(Found { grid, offset, hull, sure, surface })
    }

    /// The hull with what few views have lost and others ask for.
    fn with_losses(
        &mut self,
        views: &[View],
        statuses: &[ViewStatus],
        found: Option<Found>,
    ) -> Result<Option<Found>, String> {
        let used = used_views(views, statuses);
        let few = Rule::few((self.options.may_lose * used.len() as f64) as usize);
        if few.may_lose == 0 {
            return Ok(found);
        }
        let many = Rule::many(used.len()).filter(|it| it.may_lose > few.may_lose);
        let Some(found) = self.with_lost(&used, views, statuses, found, &few)? else { return Ok(None) };
        match many {
            // What few gave back is asked for no more.
            Some(rule) if self.losses.any(&rule) => self.with_lost(&used, views, statuses, Some(found), &rule),
            _ => Ok(Some(found)),
        }
    }

    /// What views disagree on of a hull that has all that is given back.
    fn contested(
        &mut self,
        views: &[View],
        statuses: &[ViewStatus],
        found: Option<&Found>,
    ) -> Result<Vec<Contested>, String> {
        let used = used_views(views, statuses);
        if self.covers.is_empty() {
            self.look_for_losses(&used, found);
        }
        self.losses.contested(&self.coarse(), &used, self.options.min_views).map_err(|it| it.to_string())
    }

    /// What each view shows that no voxel covers; `covers` are of this hull until voxels are added.
    fn look_for_losses(&mut self, used: &[SilhouetteView], found: Option<&Found>) {
        self.losses.begin();
        self.covers.clear();
        for view in used {
            let voxel_px = self.voxel_px(view, found);
            match found {
                Some(it) => self.covers.push(cover(&it.grid, &it.surface, view, &mut self.drawn)),
                None => {
                    self.drawn.clear();
                    self.drawn.resize(view.confidence.len(), 0);
                }
            }
            self.losses.look(view, self.options.doubt.from, &self.drawn, voxel_px);
        }
    }

    /// The hull with what `rule` gives back.
    fn with_lost(
        &mut self,
        used: &[SilhouetteView],
        views: &[View],
        statuses: &[ViewStatus],
        found: Option<Found>,
        rule: &Rule,
    ) -> Result<Option<Found>, String> {
        self.look_for_losses(used, found.as_ref());
        if !self.losses.any(rule) {
            return Ok(found);
        }
        let words = |error: CarveError| error.to_string();
        let may_err = (self.options.may_err + rule.may_lose).min(used.len() - 1);
        let options = CarveOptions { may_err, min_views: self.options.min_views };
        let Some(bounds) = self.losses.bounds(&self.grid, used, &options).map_err(words)? else { return Ok(found) };
        // What is there already lies within: fewer views may deny it; what is in doubt may not.
        let bounds = found.as_ref().map_or(bounds, |it| it.united(bounds));
        let (grid, offset) = self.inner(self.grid, bounds);
        let before = found;
        let mut found = self.hull_in(views, statuses, grid, offset)?;
        if let Some(before) = before {
            found.keep(&before);
        }
        self.losses.add(&mut found.hull, &grid, used, &options, rule).map_err(words)?;
        self.covers.clear();
        found.surface = found.hull.surface();
        Ok((found.surface.count() > 0).then_some(found))
    }

    /// How large a voxel appears, about [px].
    fn voxel_px(&self, view: &SilhouetteView, found: Option<&Found>) -> f64 {
        let grid = found.map_or(&self.grid, |it| &it.grid);
        let middle = grid.origin + Vector3::from(grid.cells.map(f64::from)) * (0.5 * grid.size);
        let depth = (view.camera.camera_from_world * middle).z;
        let focal = view.camera.intrinsics.focal[0] / f64::from(view.shrink.max(1));
        if depth > grid.size { focal * grid.size / depth } else { focal }
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

impl Found {
    /// Keeps what was found in a part of this grid.
    fn keep(&mut self, part: &Found) {
        for index in part.hull.iter() {
            self.hull.set(std::array::from_fn(|axis| index[axis] + part.offset[axis] - self.offset[axis]));
        }
    }

    /// First and last index in the whole grid of what holds this and `bounds`.
    fn united(&self, [low, high]: [[u32; 3]; 2]) -> [[u32; 3]; 2] {
        let own = |axis: usize| self.offset[axis] + self.grid.cells[axis] - 1;
        [
            std::array::from_fn(|axis| low[axis].min(self.offset[axis])),
            std::array::from_fn(|axis| high[axis].max(own(axis))),
        ]
    }
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

/// A camera without a person where more cameras see one has lost the body; where most see none, there is none.
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
