//! Blobs: connected foreground, joined where it is close, each with a point, its covariance and its shape.
//!
//! The centroid of a blob is the mean of its pixels. What makes it uncertain is the rim: whether a pixel there belongs to
//! the blob is a matter of noise, contrast and where the outline falls. With an independent error of variance `RIM` for each
//! of the P pixels of the rim, the centroid's covariance is RIM / A² · Σ (xᵢ − c)(xᵢ − c)ᵀ over the rim. For a disc the
//! second moment of the rim is twice that of the area, M, so it is stated as RIM · P · 2 M / A², P being twice the number
//! of runs and columns. A blob that meets the edge of the picture may be missing as much as is seen of it.
//!
//! That is how well the centroid of *what is foreground* is known (tests/blobs.rs holds it against truth). That a body seen
//! from different sides has no one centre is for the caller to add; [`Blob::moment`] gives the scale.

use std::ops::Range;

use nalgebra::{Matrix2, Point2, Vector2};

use crate::spots::component::{Component, Frame, Run};
use crate::{Foreground, ImagingError};

/// A blob: a connected, or nearly connected, region of foreground.
#[derive(Debug, Clone, PartialEq)]
pub struct Blob {
    /// Mean of its pixels [px].
    pub centroid: Point2<f64>,
    /// Covariance of the centroid [px²].
    pub covariance: Matrix2<f64>,
    /// Second moments of its pixels about the centroid, over their number [px²].
    pub moment: Matrix2<f64>,
    /// Its pixels [px²].
    pub area: u64,
    /// First and last column and row: [x0, y0, x1, y1], all four part of it [px].
    pub bounds: [u32; 4],
    /// Whether it touches the picture's edge, where a part of it may be missing.
    pub touches_border: bool,
    /// Its pieces, in [`BlobFinder::pieces`].
    pieces: (usize, usize),
}

/// Limits on what counts as a blob.
#[derive(Debug, Clone, PartialEq)]
pub struct BlobLimits {
    /// Smallest blob kept, at least 1 [px²].
    pub min_area: u64,
    /// Largest blob kept [px²].
    pub max_area: u64,
    /// Pieces whose boxes are no further apart than this, in rows and in columns, are one blob [px].
    pub merge_px: u32,
    /// At most this many blobs are reported, the largest.
    pub max_blobs: usize,
}

impl Default for BlobLimits {
    /// 100 px² and more, merged over 8 px, 64 of them.
    fn default() -> Self {
        Self { min_area: 100, max_area: u64::MAX, merge_px: 8, max_blobs: 64 }
    }
}

impl BlobLimits {
    /// [`ImagingError::Setting`] that names the first setting out of its range.
    pub fn check(&self) -> Result<(), ImagingError> {
        ImagingError::unless(self.min_area >= 1, "min_area", "at least 1 px²", self.min_area as f64)?;
        ImagingError::unless(self.max_area >= self.min_area, "max_area", "at least min_area", self.max_area as f64)
    }
}

/// Variance of whether a pixel of the rim belongs to the blob; tests/blobs.rs measures it.
const RIM: f64 = 0.06;
/// Pieces that are looked at for merging, at most: the largest.
const MAX_PIECES: usize = 512;
/// A piece smaller than this part of `min_area` is a speck, and joins nothing.
const SPECK: u64 = 16;
/// The end of a blob is this part of its length.
const END_SHARE: f64 = 0.05;

/// What hides beyond the picture's edge moves an end of the blob only if that end lies there.
fn cut_off(blob: &Blob, point: &Point2<f64>) -> Matrix2<f64> {
    let [x0, y0, x1, y1] = blob.bounds.map(f64::from);
    let is_end = (point - blob.centroid).norm_squared() > 0.0;
    let extent = Vector2::new(x1 - x0 + 1.0, y1 - y0 + 1.0);
    if is_end && blob.touches_border {
        Matrix2::from_diagonal(&(extent.component_mul(&extent) / 4.0))
    } else {
        Matrix2::zeros()
    }
}

/// Connected foreground.
#[derive(Debug, Clone, Copy)]
struct Piece {
    area: u64,
    mean: Point2<f64>,
    moment: Matrix2<f64>,
    bounds: [usize; 4],
    /// In [`Component::runs`].
    runs: (usize, usize),
    sure: bool,
    /// Number of the blob that it belongs to: the place of its first piece.
    blob: usize,
}

/// Finds blobs; keeps its buffers from picture to picture and allocates only when pictures, or what is in them, grow.
#[derive(Default)]
pub struct BlobFinder {
    component: Component,
    pieces: Vec<Piece>,
    /// One threshold of 0 for each pixel.
    zeros: Vec<u8>,
    width: usize,
    height: usize,
}

impl BlobFinder {
    /// Fills `blobs` with the blobs of the foreground's last picture, from the top down: see [`Self::find_in`].
    pub fn find(
        &mut self,
        foreground: &Foreground,
        limits: &BlobLimits,
        expected: &[Point2<f64>],
        blobs: &mut Vec<Blob>,
    ) -> Result<(), ImagingError> {
        self.find_in(foreground.mask(), foreground.size(), limits, expected, blobs)
    }

    /// Fills `blobs` with the blobs of a mask of `size` (columns, rows), from the top down: 0 background, 1 foreground, 2 surely.
    ///
    /// A blob holds a pixel that is surely foreground, unless one of the `expected` points lies in its box, widened by
    /// `merge_px`.
    pub fn find_in(
        &mut self,
        mask: &[u8],
        size: (usize, usize),
        limits: &BlobLimits,
        expected: &[Point2<f64>],
        blobs: &mut Vec<Blob>,
    ) -> Result<(), ImagingError> {
        blobs.clear();
        limits.check()?;
        let expected_len = size.0 * size.1;
        if mask.len() != expected_len {
            return Err(ImagingError::WrongLength { what: "mask", expected: expected_len, found: mask.len() });
        }
        (self.width, self.height) = size;
        self.take_pieces(mask, limits.min_area.div_ceil(SPECK));
        self.merge(limits.merge_px as usize);
        let mut start = 0;
        while start < self.pieces.len() {
            let blob = self.pieces[start].blob;
            let n = self.pieces[start..].iter().take_while(|it| it.blob == blob).count();
            blobs.extend(self.blob((start, start + n), limits, expected));
            start += n;
        }
        if blobs.len() > limits.max_blobs {
            blobs.sort_unstable_by_key(|it| (std::cmp::Reverse(it.area), it.bounds));
            blobs.truncate(limits.max_blobs);
        }
        blobs.sort_unstable_by_key(|it| (it.bounds[1], it.bounds[0], it.bounds));
        Ok(())
    }

    /// The end of a blob of the last search that lies furthest in `direction`: the mean of the last twentieth of its length, and
    /// its covariance. `None` for a direction without length.
    ///
    /// Its error along the direction is taken to be that of the outline, one pixel, besides that of a blob so small.
    pub fn end(&self, blob: &Blob, direction: Vector2<f64>) -> Option<(Point2<f64>, Matrix2<f64>)> {
        let direction = direction.try_normalize(1e-12)?;
        let along = |x: usize, y: usize| direction.x * x as f64 + direction.y * y as f64;
        let (mut nearest, mut furthest) = (f64::INFINITY, f64::NEG_INFINITY);
        for run in self.runs(blob) {
            for at in [along(run.x0, run.y), along(run.x1 - 1, run.y)] {
                (nearest, furthest) = (nearest.min(at), furthest.max(at));
            }
        }
        let limit = furthest - (END_SHARE * (furthest - nearest)).max(0.5);
        let (mut n, mut sum) = (0.0, Vector2::zeros());
        let (mut xx, mut xy, mut yy, mut n_runs) = (0.0, 0.0, 0.0, 0.0);
        for run in self.runs(blob) {
            let before = n;
            for x in (run.x0..run.x1).filter(|&x| along(x, run.y) >= limit) {
                let offset = Vector2::new(x as f64, run.y as f64) - blob.centroid.coords;
                n += 1.0;
                sum += offset;
                (xx, xy, yy) = (xx + offset.x * offset.x, xy + offset.x * offset.y, yy + offset.y * offset.y);
            }
            n_runs += if n > before { 1.0 } else { 0.0 };
        }
        let mean: Vector2<f64> = sum / n;
        let square = Matrix2::identity() / 12.0;
        let moment = Matrix2::new(xx, xy, xy, yy) / n - mean * mean.transpose() + square;
        let rim = 4.0 * (n_runs + n / n_runs);
        let covariance = moment * (2.0 * RIM * rim / (n * n)) + direction * direction.transpose() + square;
        Some((blob.centroid + mean, covariance))
    }

    /// The pixels of a blob of the last search: row, columns.
    pub fn pixels(&self, blob: &Blob) -> impl Iterator<Item = (usize, Range<usize>)> {
        self.runs(blob).map(|it| (it.y, it.x0..it.x1))
    }

    /// The reference point of a blob of the last search and its covariance: its end in `direction`, or its centroid where that has no length. `shape_error`:
    /// how far this point is from what other cameras see of the same body, one standard deviation, in standard deviations of the blob's pixels.
    pub fn point(&self, blob: &Blob, direction: Vector2<f64>, shape_error: f64) -> (Point2<f64>, Matrix2<f64>) {
        let (point, covariance) = self.end(blob, direction).unwrap_or((blob.centroid, blob.covariance));
        (point, covariance + cut_off(blob, &point) + blob.moment * (shape_error * shape_error))
    }

    fn runs<'a>(&'a self, blob: &Blob) -> impl Iterator<Item = &'a Run> {
        let (start, end) = blob.pieces;
        let pieces = self.pieces.get(start..end).unwrap_or_default();
        pieces.iter().flat_map(|it| &self.component.runs()[it.runs.0..it.runs.1])
    }

    /// Connected foreground of at least `min_area`.
    fn take_pieces(&mut self, mask: &[u8], min_area: u64) {
        let (width, height) = (self.width, self.height);
        self.zeros.resize(mask.len(), 0);
        self.component.begin(mask.len(), width);
        self.pieces.clear();
        let frame = Frame { pixels: mask, thresholds: &self.zeros, width, height, raised: 0 };
        const BLOCK: usize = 64;
        for start in (0..mask.len()).step_by(BLOCK) {
            let end = (start + BLOCK).min(mask.len());
            if mask[start..end].iter().fold(0, |any, &it| any | it) == 0 {
                continue;
            }
            for (i, &value) in (start..).zip(&mask[start..end]) {
                if value == 0 || self.component.taken(i) {
                    continue;
                }
                let first = self.component.runs().len();
                let shape = self.component.take(&frame, i % width, i / width);
                if shape.area >= min_area {
                    self.pieces.push(Piece {
                        area: shape.area,
                        mean: shape.mean,
                        moment: shape.moment,
                        bounds: shape.bounds,
                        runs: (first, self.component.runs().len()),
                        sure: shape.peak > 1,
                        blob: 0,
                    });
                }
            }
        }
        if self.pieces.len() > MAX_PIECES {
            self.pieces.sort_unstable_by_key(|it| (std::cmp::Reverse(it.area), it.runs));
            self.pieces.truncate(MAX_PIECES);
        }
    }

    /// Gives the pieces that are close to one another the same number, and sorts by it.
    fn merge(&mut self, merge_px: usize) {
        let near = |a: &Piece, b: &Piece| {
            (0..2).all(|axis| {
                let (first, second) = if a.bounds[axis] <= b.bounds[axis] { (a, b) } else { (b, a) };
                second.bounds[axis] <= first.bounds[axis + 2] + 1 + merge_px
            })
        };
        for i in 0..self.pieces.len() {
            self.pieces[i].blob = i;
            for j in 0..i {
                let (mine, other) = (self.pieces[i].blob, self.pieces[j].blob);
                if mine != other && near(&self.pieces[i], &self.pieces[j]) {
                    let (low, high) = (mine.min(other), mine.max(other));
                    self.pieces[..=i].iter_mut().filter(|it| it.blob == high).for_each(|it| it.blob = low);
                }
            }
        }
        self.pieces.sort_unstable_by_key(|it| (it.blob, it.runs));
    }

    /// The blob of these pieces, if it is one.
    fn blob(&self, range: (usize, usize), limits: &BlobLimits, expected: &[Point2<f64>]) -> Option<Blob> {
        let pieces = &self.pieces[range.0..range.1];
        let area: u64 = pieces.iter().map(|it| it.area).sum();
        if !(limits.min_area..=limits.max_area).contains(&area) {
            return None;
        }
        let mut bounds = pieces[0].bounds;
        for piece in &pieces[1..] {
            for axis in 0..2 {
                bounds[axis] = bounds[axis].min(piece.bounds[axis]);
                bounds[axis + 2] = bounds[axis + 2].max(piece.bounds[axis + 2]);
            }
        }
        let is_expected = |point: &Point2<f64>| {
            let margin = f64::from(limits.merge_px);
            (0..2).all(|axis| {
                let (low, high) = (bounds[axis] as f64 - margin, bounds[axis + 2] as f64 + margin);
                (low..=high).contains(&point[axis])
            })
        };
        if !pieces.iter().any(|it| it.sure) && !expected.iter().any(is_expected) {
            return None;
        }
        let n = area as f64;
        let weighted = |it: &Piece| it.mean.coords * (it.area as f64 / n);
        let centroid = Point2::from(pieces.iter().map(weighted).sum::<Vector2<f64>>());
        let mut moment = Matrix2::zeros();
        let mut rim = 0.0;
        for piece in pieces {
            let off = piece.mean - centroid;
            moment += (piece.moment + off * off.transpose()) * (piece.area as f64 / n);
            rim += 2.0 * (piece.runs.1 - piece.runs.0 + piece.bounds[2] - piece.bounds[0] + 1) as f64;
        }
        let mut covariance = moment * (2.0 * RIM * rim / (n * n));
        let size = [self.width, self.height];
        let mut touches_border = false;
        for axis in 0..2 {
            if bounds[axis] == 0 || bounds[axis + 2] + 1 == size[axis] {
                touches_border = true;
                let extent = (bounds[axis + 2] - bounds[axis] + 1) as f64;
                covariance[(axis, axis)] += extent * extent / 4.0;
            }
        }
        let bounds = bounds.map(|it| it as u32);
        Some(Blob { centroid, covariance, moment, area, bounds, touches_border, pieces: range })
    }
}
