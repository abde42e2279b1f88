//! Voxels that silhouettes support and few views deny, and places that they support and many deny.
//!
//! A pixel of body shows something: if no voxel lies behind it, a view has cut away what is there, since it lost that part of the body. Of the voxels that at most some views deny, those are
//! kept that lie behind such pixels in several other views. Where silhouettes fit each other nothing is added, so that the hull does not grow as it does where any voxel may be denied.
//!
//! Source: J.-L. Landabaso, M. Pardàs, J. R. Casas, "Shape from inconsistent silhouette", CVIU 112(2), 2008: the inconsistent silhouettes (body that the hull does not cover), the cones behind them, and in these alone a
//! decision by how many views deny a voxel. Here the pixels must be more than a rim, and supported by several views, since a shadow or another person is supported by one.

use std::collections::BTreeMap;

use foveate::geometry::voxels::{BODY, BitGrid, CarveError, CarveOptions, Carver, SilhouetteView, VoxelGrid};
use foveate::prelude::Contested;
use nalgebra::Vector3;

/// Adds what was lost; keeps its memory.
#[derive(Debug, Default)]
pub struct Losses {
    carver: Carver,
    /// By view and pixel: body that no voxel covers.
    asked: Vec<Vec<u8>>,
    /// By view: body where it may be. Who is in doubt denies nothing.
    wide: Vec<Vec<u8>>,
    /// Views that ask for more than `LEAST` of their silhouettes.
    n_loud: usize,
}

/// Edge of the blocks in which contested places are reported [m].
const BLOCK: f64 = 0.1;
/// Contested is what this part of the views in whose picture it lies calls body, three at least (ghosts of two agree anywhere), and this part of those asks for, two at least [–].
const CONTESTED_BODY: f64 = 0.5;
const LEAST_BODY: u32 = 3;
const CONTESTED_ASKED: f64 = 0.25;

/// How many views may deny what others ask for, and how loudly these have to ask.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rule {
    /// Views that may have lost a voxel.
    pub may_lose: usize,
    /// Views that must ask for it, at least.
    asking: usize,
    /// The part that must ask of those that call it body, and of those in whose picture it lies [–].
    asking_share: [f64; 2],
}

impl Rule {
    /// Of a few views.
    pub fn few(may_lose: usize) -> Self {
        Self { may_lose, asking: 2, asking_share: [1.0 / 3.0, 0.0] }
    }

    /// Of up to a third of `n_views`, what half of those that call it body ask for, which are three at least: with every view that may deny, a hull grows, and so does the chance that ghosts agree. `None` of fewer than six views.
    pub fn many(n_views: usize) -> Option<Self> {
        (n_views >= 6).then_some(Self { may_lose: n_views / 3, asking: 3, asking_share: [0.5, 0.375] })
    }
}

/// Smaller uncovered parts of a silhouette are ignored [–].
const LEAST: f64 = 0.01;

impl Losses {
    /// Begins a set of silhouettes.
    pub fn begin(&mut self) {
        self.asked.clear();
        self.wide.clear();
        self.n_loud = 0;
    }

    /// Takes in a view, whose pixels may be body from a confidence of `from` on, and what the hull covers of it (a byte a pixel), drawn with voxels of `voxel_px`.
    pub fn look(&mut self, view: &SilhouetteView, from: u8, drawn: &[u8], voxel_px: f64) {
        let width = view.width as usize;
        // Rims that a voxel's centre misses are half a voxel wide.
        let rim = (0.5 * voxel_px).ceil().clamp(1.0, 64.0) as usize;
        let covered = grown(drawn, width, rim);
        let lost: Vec<u8> =
            covered.iter().zip(view.confidence).map(|(it, body)| u8::from(*it == 0 && *body >= BODY)).collect();
        let [n_lost, n_body] =
            [lost.iter().filter(|it| **it > 0).count(), view.confidence.iter().filter(|it| **it >= BODY).count()];
        self.n_loud += usize::from(n_lost as f64 > LEAST * n_body as f64);
        // Up to the rim again.
        let mut asked = grown(&lost, width, rim);
        let not_covered = drawn.iter().zip(view.confidence).map(|(it, body)| u8::from(*it == 0 && *body >= BODY));
        asked.iter_mut().zip(not_covered).for_each(|(asked, it)| *asked &= it);
        self.asked.push(asked);
        self.wide.push(view.confidence.iter().map(|it| u8::from(*it >= from.min(BODY)) * u8::MAX).collect());
    }

    /// Whether there is enough support for `rule` to give voxels back.
    pub fn any(&self, rule: &Rule) -> bool {
        2 * self.n_loud >= rule.asking
    }

    /// A box that holds all that [`Self::add`] may add.
    ///
    /// # Errors
    /// As [`Carver::carve`].
    pub fn bounds(
        &mut self,
        grid: &VoxelGrid,
        views: &[SilhouetteView],
        options: &CarveOptions,
    ) -> Result<Option<[[u32; 3]; 2]>, CarveError> {
        let Self { carver, wide, .. } = self;
        carver.bounds(grid, &in_doubt(views, wide), options)
    }

    /// Adds to `hull` the voxels of `grid` that `options` keep and `rule` supports; `views` are those that [`Self::look`] took in, in that order.
    ///
    /// # Errors
    /// As [`Carver::carve`].
    pub fn add(
        &mut self,
        hull: &mut BitGrid,
        grid: &VoxelGrid,
        views: &[SilhouetteView],
        options: &CarveOptions,
        rule: &Rule,
    ) -> Result<(), CarveError> {
        let Self { carver, wide, asked, .. } = self;
        let possible = carver.carve(grid, &in_doubt(views, wide), options)?;
        for index in possible.iter() {
            if hull.get(index) {
                continue;
            }
            let centre = grid.centre(index);
            let (mut n_seen, mut n_body, mut n_asked) = (0u32, 0u32, 0);
            for (view, asked) in views.iter().zip(&*asked) {
                let Some(at) = pixel_at(view, &centre) else { continue };
                n_seen += 1;
                n_body += u32::from(view.confidence[at] >= BODY);
                n_asked += usize::from(asked[at]);
            }
            let [of_body, of_seen] = rule.asking_share;
            let least = (of_body * f64::from(n_body)).max(of_seen * f64::from(n_seen));
            if n_asked >= rule.asking && n_asked as f64 >= least {
                hull.set(index);
            }
        }
        Ok(())
    }

    /// What views disagree on of `grid`, in blocks: places that many of them call body, several of these without a voxel behind it, and that the others deny. `views` are those that [`Self::look`] took in, with the hull as it
    /// stands.
    ///
    /// # Errors
    /// As [`Carver::carve`].
    pub fn contested(
        &mut self,
        grid: &VoxelGrid,
        views: &[SilhouetteView],
        min_views: usize,
    ) -> Result<Vec<Contested>, CarveError> {
        let Self { carver, asked, n_loud, .. } = self;
        if *n_loud < 2 || views.len() < LEAST_BODY as usize {
            return Ok(Vec::new());
        }
        let may_err = views.len() - (CONTESTED_BODY * views.len() as f64).ceil() as usize;
        let options = CarveOptions { may_err, min_views };
        let possible = carver.carve(grid, views, &options)?;
        let step = (BLOCK / grid.size).round().max(1.0) as u32;
        let mut blocks: BTreeMap<[u32; 3], (u32, Vector3<f64>)> = BTreeMap::new();
        for index in possible.iter() {
            let centre = grid.centre(index);
            let (mut n_seen, mut n_body, mut n_asked) = (0u32, 0u32, 0u32);
            for (view, asked) in views.iter().zip(&*asked) {
                let Some(at) = pixel_at(view, &centre) else { continue };
                n_seen += 1;
                n_body += u32::from(view.confidence[at] >= BODY);
                n_asked += u32::from(asked[at] > 0);
            }
            let [seen, body, asked] = [n_seen, n_body, n_asked].map(f64::from);
            if n_asked >= 2 && n_body >= LEAST_BODY && asked >= CONTESTED_ASKED * body && body >= CONTESTED_BODY * seen
            {
                let [x, y, z] = index.map(|it| it / step);
                let (n, sum) = blocks.entry([z, y, x]).or_default();
                *n += 1;
                *sum += centre.coords;
            }
        }
        let block = |(n, sum): (u32, Vector3<f64>)| Contested {
            centroid: (sum / f64::from(n)).into(),
            volume: f64::from(n) * grid.size.powi(3),
        };
        Ok(blocks.into_values().map(block).collect())
    }
}

/// The views, body where it may be.
fn in_doubt<'a>(views: &[SilhouetteView<'a>], wide: &'a [Vec<u8>]) -> Vec<SilhouetteView<'a>> {
    views.iter().zip(wide).map(|(view, wide)| SilhouetteView { confidence: wide, ..*view }).collect()
}

/// The place in the silhouette of the pixel that a point falls into.
fn pixel_at(view: &SilhouetteView, point: &nalgebra::Point3<f64>) -> Option<usize> {
    let pixel = view.camera.project(point)?;
    let place = |pixel: f64, start: u32| ((pixel + 0.5 - f64::from(start)) / f64::from(view.shrink)).floor();
    let (x, y) = (place(pixel.x, view.left), place(pixel.y, view.top));
    let is_inside = x >= 0.0 && y >= 0.0 && x < f64::from(view.width) && y < f64::from(view.height);
    is_inside.then(|| y as usize * view.width as usize + x as usize)
}

/// Set within `by` pixels, along rows and columns.
fn grown(set: &[u8], width: usize, by: usize) -> Vec<u8> {
    let along = |row: &[u8], out: &mut [u8]| {
        let mut until = 0;
        for (x, it) in row.iter().enumerate() {
            if *it > 0 {
                let (first, end) = (x.saturating_sub(by).max(until), (x + by + 1).min(row.len()));
                out[first..end].fill(1);
                until = end;
            }
        }
    };
    let mut wide = vec![0; set.len()];
    set.chunks_exact(width.max(1)).zip(wide.chunks_exact_mut(width.max(1))).for_each(|(row, out)| along(row, out));
    let rows = set.len() / width.max(1);
    let mut high = vec![0; set.len()];
    for y in 0..rows {
        let row = &wide[y * width..][..width];
        if row.iter().all(|it| *it == 0) {
            continue;
        }
        for to in y.saturating_sub(by)..(y + by + 1).min(rows) {
            high[to * width..][..width].iter_mut().zip(row).for_each(|(high, it)| *high |= it);
        }
    }
    high
}
