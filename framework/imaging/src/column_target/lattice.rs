//! Columns: patches below one another at even steps.

use nalgebra::Vector2;

use super::apart;
use super::patches::DarkPatch;

/// A patch below another one lies within this of straight down: sine of the lean of a column.
const LEAN: f64 = 0.35;
/// Areas of neighbours differ by less than this factor.
const AREAS: f64 = 2.2;
/// A step differs from the one before it by less than this part of it.
const UNEVEN: f64 = 0.14;
/// A neighbour is at most so many of its own heights away.
const FARTHEST: f64 = 8.0;

/// Columns from left to right, each from top to bottom, as numbers of `patches`. A column that is broken (a patch in glare) is joined over one or two missing ones
/// for its order among the others, but is then not whole. What is no neighbour of another column is left out.
pub(super) fn columns(patches: &[DarkPatch], rows: usize) -> Vec<Vec<usize>> {
    let below = links(patches);
    let mut above = vec![None; patches.len()];
    for (from, to) in below.iter().enumerate() {
        if let Some(to) = to {
            above[*to] = Some(from);
        }
    }
    let mut chains: Vec<Vec<usize>> = Vec::new();
    for top in (0..patches.len()).filter(|it| above[*it].is_none()) {
        let mut chain = vec![top];
        while let Some(next) = below[chain[chain.len() - 1]] {
            chain.push(next);
        }
        split_uneven(patches, chain, &mut chains);
    }
    chains.retain(|it| it.len() >= 3);
    join_broken(patches, &mut chains);
    // What is not of the target is not as long.
    chains.retain(|it| 2 * it.len() >= rows && it.len() <= rows);
    let middle = |chain: &[usize]| patches[chain[chain.len() / 2]].centre.x;
    chains.sort_by(|a, b| middle(a).total_cmp(&middle(b)));
    chains
}

/// By patch, the one right below it: the nearest one, for which it is the nearest above.
fn links(patches: &[DarkPatch]) -> Vec<Option<usize>> {
    let nearest = |from: usize, way: f64| {
        let of = &patches[from];
        let near = |to: &usize| {
            let step = patches[*to].centre - of.centre;
            let down = way * step.y;
            let ratio = f64::from(patches[*to].area) / f64::from(of.area);
            *to != from
                && down > 0.5 * f64::from(of.size[1])
                && down < FARTHEST * f64::from(of.size[1])
                && step.x.abs() < LEAN * step.norm()
                && (1.0 / AREAS..AREAS).contains(&ratio)
        };
        let all = (0..patches.len()).filter(near);
        all.min_by(|a, b| apart(&patches[*a].centre, &of.centre).total_cmp(&apart(&patches[*b].centre, &of.centre)))
    };
    let down: Vec<Option<usize>> = (0..patches.len()).map(|it| nearest(it, 1.0)).collect();
    let up: Vec<Option<usize>> = (0..patches.len()).map(|it| nearest(it, -1.0)).collect();
    down.iter().enumerate().map(|(from, to)| to.filter(|to| up[*to] == Some(from))).collect()
}

/// Cuts a chain where a step is another than those beside it: a figure above a column, two columns that met.
fn split_uneven(patches: &[DarkPatch], chain: Vec<usize>, into: &mut Vec<Vec<usize>>) {
    let mut steps: Vec<f64> =
        chain.windows(2).map(|it| apart(&patches[it[0]].centre, &patches[it[1]].centre)).collect();
    if steps.len() < 2 {
        into.push(chain);
        return;
    }
    // Each step against the median of its four neighbours, so that one wrong step makes no other one wrong.
    let evened: Vec<f64> = (0..steps.len())
        .map(|at| {
            let first = at.saturating_sub(2).min(steps.len().saturating_sub(5));
            let mut near: Vec<f64> = steps[first..(first + 5).min(steps.len())].to_vec();
            near.sort_by(f64::total_cmp);
            near[near.len() / 2]
        })
        .collect();
    steps.iter_mut().zip(&evened).for_each(|(step, even)| *step = *step / even - 1.0);
    let mut part = vec![chain[0]];
    for (at, next) in chain.into_iter().skip(1).enumerate() {
        if steps[at].abs() > UNEVEN {
            into.push(std::mem::take(&mut part));
        }
        part.push(next);
    }
    into.push(part);
}

/// Joins a chain to the one that goes on where it would have its patch after next, or the one after that.
fn join_broken(patches: &[DarkPatch], chains: &mut Vec<Vec<usize>>) {
    loop {
        let goes_on = |upper: &[usize], lower: &[usize]| {
            let n = upper.len();
            let (last, before) = (patches[upper[n - 1]].centre, patches[upper[n - 2]].centre);
            let step: Vector2<f64> = last - before;
            let gap = patches[lower[0]].centre - last;
            (2..=3).any(|count| (gap - step * f64::from(count)).norm() < 0.3 * step.norm())
        };
        let pair = (0..chains.len()).find_map(|upper| {
            let lower = (0..chains.len()).find(|lower| *lower != upper && goes_on(&chains[upper], &chains[*lower]))?;
            Some((upper, lower))
        });
        let Some((upper, lower)) = pair else { return };
        let tail = chains[lower].clone();
        chains[upper].extend(tail);
        chains.remove(lower);
    }
}
