//! A surface from seeds: points on a grid over the reference's picture, grown best first, and checks of each of them once all are there.
//!
//! Each point passed the gates of its match, the match back and the epipolar line when it was measured. Here it is compared with its
//! neighbours: seen along the reference's lines of sight a plane has an inverse depth that is linear in pixels, and steps over the grid come in the same order in
//! all views. Points with few agreeing neighbours, or few neighbours, are left out.

use std::collections::{HashMap, HashSet};

use foveate::geometry::Camera;
use foveate::imaging::matching::{Grown, Growth, Warp, grow};
use nalgebra::{Matrix3, Point2, Point3, Vector3};

use crate::measure::{MeasureOptions, Measurer, NoPoint, Sample};
use crate::views::{Moment, View};

/// How a surface is covered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CoverOptions {
    /// From point to point in the reference's picture [px].
    pub spacing_px: usize,
    /// Neighbours that a node of the grid is tried from.
    pub tries: u8,
    /// Neighbourhood of a point, in steps of the grid.
    pub around: usize,
    /// Part of the places around it at which there must be neighbours that agree.
    pub min_agreeing: f64,
    /// What a neighbourhood may deviate from its plane beside its distance, beyond noise [–].
    pub step: f64,
    /// Fewest points of a piece of surface that is not connected to others.
    pub min_piece: usize,
}

/// A point of the surface.
#[derive(Debug, Clone, PartialEq)]
pub struct Covered {
    /// Where the reference sees it, on the grid.
    pub cell: [usize; 2],
    /// What was measured.
    pub sample: Sample,
    /// Out of the surface, towards the reference [–].
    pub normal: Vector3<f64>,
    /// Part of the places around it with neighbours that agree [–].
    pub confidence: f64,
    /// Which of the samples given it is; `None` for one that was grown.
    pub seed: Option<usize>,
}

/// What was left out in the end.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LeftOut {
    /// Neighbours lie on another surface.
    pub alone: u64,
    /// Neighbours come in another order in some view.
    pub disordered: u64,
    /// In a piece of surface of too few points.
    pub piece: u64,
    /// In a piece of surface whose patches look the same at another depth.
    pub repeats: u64,
    /// In a piece of surface that some cameras see at another depth than others.
    pub contradicted: u64,
    /// Found beside a point of the surface, and out of the volume.
    pub cut: u64,
}

/// A sample on its way through the growth.
#[derive(Debug, Clone)]
struct Node {
    sample: Sample,
    seed: Option<usize>,
}

/// The extent of the grid over a picture.
pub fn grid(camera: &Camera, spacing_px: usize) -> [usize; 2] {
    camera.image_size.map(|it| (it as usize).div_ceil(spacing_px))
}

/// The node of the grid next to a pixel.
pub fn cell_of(pixel: [f64; 2], spacing_px: usize) -> [usize; 2] {
    pixel.map(|it| (it / spacing_px as f64).max(0.0) as usize)
}

/// Where the reference sees a node: the middle of its square.
pub fn pixel_of(cell: [usize; 2], spacing_px: usize) -> [f64; 2] {
    cell.map(|it| ((it * spacing_px) + spacing_px / 2) as f64)
}

/// Grows from `seeds` over the connected surface.
pub fn cover(
    measurer: &mut Measurer,
    views: &[View],
    moment: &Moment,
    reference: usize,
    seeds: &[Sample],
    measure: &MeasureOptions,
    options: &CoverOptions,
) -> (Vec<Covered>, LeftOut) {
    let camera = &views[reference].camera;
    let spacing = options.spacing_px;
    let [columns, rows] = grid(camera, spacing);
    let growth = Growth { columns, rows, tries: options.tries };
    let started = seeds.iter().enumerate().map(|(at, sample)| {
        let cell = cell_of(sample.pixel, spacing);
        Grown { cell, found: Node { sample: sample.clone(), seed: Some(at) }, score: sample.correlation }
    });
    let mut cut = 0;
    let grown = grow(growth, started, |cell, from| {
        let pixel = pixel_of(cell, spacing);
        let starts: Vec<(usize, Warp)> = from.found.sample.starts_at(views, pixel);
        let measured = measurer.measure(views, moment, reference, pixel, &starts, measure);
        cut += u64::from(matches!(measured, Err(NoPoint::OutOfVolume)));
        let sample = measured.ok()?;
        let score = sample.correlation;
        Some((Node { sample, seed: None }, score))
    });
    let (kept, left_out) = judge(camera, grown, growth, options);
    (kept, LeftOut { cut, ..left_out })
}

/// Seeds that share a node of the grid with a better one among `kept`, and are connected to it: tracked points are not bound to the grid.
pub fn crowded(seeds: &[Sample], kept: &[Covered], camera: &Camera, options: &CoverOptions) -> Vec<Covered> {
    let by_cell: HashMap<[usize; 2], &Covered> = kept.iter().map(|it| (it.cell, it)).collect();
    let is_kept: HashSet<usize> = kept.iter().filter_map(|it| it.seed).collect();
    let centre = camera.centre();
    let inverse = |it: &Sample| 1.0 / (it.position - centre).norm();
    let per_px = 1.0 / camera.intrinsics.focal[0];
    let others = seeds.iter().enumerate().filter(|it| !is_kept.contains(&it.0));
    let on_its_surface = others.filter_map(|(seed, sample)| {
        let beside = by_cell.get(&cell_of(sample.pixel, options.spacing_px))?;
        let [a, b] = [sample.pixel, beside.sample.pixel];
        let reach = (a[0] - b[0]).hypot(a[1] - b[1]);
        let here = inverse(sample);
        let tolerance = 4.0 * 3f64.sqrt() * sample.sigma() * here * here;
        let limit = tolerance + (options.step + SLANTED * reach * per_px) * here;
        let hangs = (here - inverse(&beside.sample)).abs() < limit;
        hangs.then(|| Covered { sample: sample.clone(), seed: Some(seed), ..(*beside).clone() })
    });
    on_its_surface.collect()
}

/// Compares every point with its neighbours.
fn judge(camera: &Camera, grown: Vec<Grown<Node>>, growth: Growth, options: &CoverOptions) -> (Vec<Covered>, LeftOut) {
    let Growth { columns, rows, .. } = growth;
    let mut at = vec![usize::MAX; columns * rows];
    let centre = camera.centre();
    let inverse: Vec<f64> = grown.iter().map(|it| 1.0 / (it.found.sample.position - centre).norm()).collect();
    for (index, it) in grown.iter().enumerate() {
        at[it.cell[1] * columns + it.cell[0]] = index;
    }
    let around = options.around as isize;
    let places = ((2 * around + 1) * (2 * around + 1) - 1) as f64;
    let mut left_out = LeftOut::default();
    let mut kept = Vec::with_capacity(grown.len());
    let mut neighbours = Vec::new();
    // The angle of a pixel.
    let per_px = 1.0 / camera.intrinsics.focal[0];
    for (index, it) in grown.iter().enumerate() {
        neighbours.clear();
        for dy in -around..=around {
            for dx in -around..=around {
                let (x, y) = (it.cell[0].checked_add_signed(dx), it.cell[1].checked_add_signed(dy));
                let (Some(x), Some(y)) = (x.filter(|it| *it < columns), y.filter(|it| *it < rows)) else { continue };
                let other = at[y * columns + x];
                if other != usize::MAX && other != index {
                    neighbours.push(other);
                }
            }
        }
        let sample = &it.found.sample;
        // Along the line of sight a standard deviation of the depth is one of its inverse times its square.
        let sigma = sample.sigma() * inverse[index] * inverse[index] * 3f64.sqrt();
        let tolerance = 4.0 * sigma + options.step * inverse[index];
        let Some((plane, agreeing)) = local_plane(&grown, &inverse, index, &neighbours, tolerance, per_px) else {
            left_out.alone += 1;
            continue;
        };
        let confidence = agreeing as f64 / places;
        if confidence < options.min_agreeing {
            left_out.alone += 1;
            continue;
        }
        if is_disordered(&grown, index, &neighbours) {
            left_out.disordered += 1;
            continue;
        }
        let normal = normal_of(camera, sample, &plane).unwrap_or_else(Vector3::zeros);
        kept.push(Covered { cell: it.cell, sample: sample.clone(), normal, confidence, seed: it.found.seed });
    }
    let small: Vec<usize> =
        pieces(&kept, camera, options).into_iter().filter(|it| it.len() < options.min_piece).flatten().collect();
    left_out.piece = small.len() as u64;
    remove(&mut kept, &small);
    (kept, left_out)
}

/// Takes the points with these numbers out of a list.
pub fn remove(list: &mut Vec<Covered>, numbers: &[usize]) {
    let mut is_out = vec![false; list.len()];
    numbers.iter().for_each(|it| is_out[*it] = true);
    let mut out = is_out.iter();
    list.retain(|_| out.next() == Some(&false));
}

/// Pieces of surface, each as the numbers of its points. Neighbours in the grid are connected where their depths are continuous.
pub fn pieces(kept: &[Covered], camera: &Camera, options: &CoverOptions) -> Vec<Vec<usize>> {
    let [columns, rows] = grid(camera, options.spacing_px);
    let centre = camera.centre();
    let inverse: Vec<f64> = kept.iter().map(|it| 1.0 / (it.sample.position - centre).norm()).collect();
    let mut at = vec![usize::MAX; columns * rows];
    for (index, it) in kept.iter().enumerate() {
        at[it.cell[1] * columns + it.cell[0]] = index;
    }
    let per_px = 1.0 / camera.intrinsics.focal[0];
    let mut pieces = Vec::new();
    let mut is_reached = vec![false; kept.len()];
    for start in 0..kept.len() {
        if std::mem::replace(&mut is_reached[start], true) {
            continue;
        }
        let mut piece = vec![start];
        let mut next = 0;
        while let Some(&here) = piece.get(next) {
            next += 1;
            let [column, row] = kept[here].cell;
            for y in row.saturating_sub(1)..(row + 2).min(rows) {
                for x in column.saturating_sub(1)..(column + 2).min(columns) {
                    let Some(there) = kept.get(at[y * columns + x]).map(|_| at[y * columns + x]) else { continue };
                    let [a, b] = [kept[here].sample.pixel, kept[there].sample.pixel];
                    let reach = (a[0] - b[0]).hypot(a[1] - b[1]);
                    let step = (inverse[here] - inverse[there]).abs();
                    let hangs = step < (options.step + SLANTED * reach * per_px) * inverse[here];
                    if hangs && !std::mem::replace(&mut is_reached[there], true) {
                        piece.push(there);
                    }
                }
            }
        }
        pieces.push(piece);
    }
    pieces
}

/// The plane through the neighbours that agree with one another, as inverse depth over pixels from the point, and how many of them agree with both; `None` where
/// the point itself does not, or there are too few.
fn local_plane(
    grown: &[Grown<Node>],
    inverse: &[f64],
    index: usize,
    neighbours: &[usize],
    tolerance: f64,
    per_px: f64,
) -> Option<(Vector3<f64>, usize)> {
    let pixel = grown[index].found.sample.pixel;
    let place = |it: usize| {
        let other = grown[it].found.sample.pixel;
        Vector3::new(1.0, other[0] - pixel[0], other[1] - pixel[1])
    };
    // A step between surfaces: those near in depth are the point's own.
    let near = |it: &&usize| {
        let reach = place(**it).fixed_rows::<2>(1).norm();
        let slope = (inverse[**it] - inverse[index]).abs();
        // A surface at 80° to the line of sight changes its depth by six times its width.
        slope < tolerance + SLANTED * reach * per_px * inverse[index]
    };
    let mut used: Vec<usize> = neighbours.iter().filter(near).copied().collect();
    let mut plane = Vector3::zeros();
    for _ in 0..3 {
        if used.len() < 3 {
            return None;
        }
        let (mut normal, mut side) = (Matrix3::zeros(), Vector3::zeros());
        for &it in &used {
            let place = place(it);
            normal += place * place.transpose();
            side += place * inverse[it];
        }
        plane = normal.try_inverse()? * side;
        let before = used.len();
        used = neighbours
            .iter()
            .filter(near)
            .copied()
            .filter(|it| (plane.dot(&place(*it)) - inverse[*it]).abs() < tolerance)
            .collect();
        if used.len() == before {
            break;
        }
    }
    ((plane[0] - inverse[index]).abs() < tolerance).then_some((plane, used.len()))
}

/// Depth that a surface may gain over a step, in widths of the step.
const SLANTED: f64 = 6.0;

/// Whether most neighbours in the same rows and columns lie on the wrong side of a point in some view.
fn is_disordered(grown: &[Grown<Node>], index: usize, neighbours: &[usize]) -> bool {
    let here = &grown[index].found.sample;
    here.seen.iter().any(|seen| {
        let (mut wrong, mut all) = (0, 0);
        for &other in neighbours {
            let there = &grown[other].found.sample;
            let Some(other_seen) = there.seen.iter().find(|it| it.view == seen.view) else { continue };
            let offset = [there.pixel[0] - here.pixel[0], there.pixel[1] - here.pixel[1]];
            let expected = seen.warp.apply(offset);
            let way = [expected[0] - seen.warp.at[0], expected[1] - seen.warp.at[1]];
            let went = [other_seen.warp.at[0] - seen.warp.at[0], other_seen.warp.at[1] - seen.warp.at[1]];
            all += 1;
            wrong += usize::from(way[0] * went[0] + way[1] * went[1] <= 0.0);
        }
        2 * wrong > all
    })
}

/// Of the plane whose inverse depth is `plane`, towards the camera.
fn normal_of(camera: &Camera, sample: &Sample, plane: &Vector3<f64>) -> Option<Vector3<f64>> {
    let at = |dx: f64, dy: f64| -> Option<Point3<f64>> {
        let inverse = plane[0] + plane[1] * dx + plane[2] * dy;
        let ray = camera.ray(&Point2::new(sample.pixel[0] + dx, sample.pixel[1] + dy))?;
        (inverse > 0.0).then(|| ray.at(1.0 / inverse))
    };
    let across = at(1.0, 0.0)? - at(-1.0, 0.0)?;
    let down = at(0.0, 1.0)? - at(0.0, -1.0)?;
    let normal = across.cross(&down).try_normalize(0.0)?;
    Some(if normal.dot(&(camera.centre() - sample.position)) < 0.0 { -normal } else { normal })
}
