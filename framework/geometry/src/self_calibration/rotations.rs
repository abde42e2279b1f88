//! Rotation averaging: one rotation for each camera from the rotations of pairs, some of which are wrong.
//!
//! Pairs gain weight by the triangles that they close; a maximum spanning tree over these weights gives a start; then
//! all pairs are averaged on the tangent space of the rotations with Cauchy's weights (V. M. Govindu 2004), and those
//! far from the average are dropped.

use std::collections::BTreeSet;

use nalgebra::{DMatrix, UnitQuaternion, Vector3};

use super::links::Oriented;

/// The rotations on which the pairs agree.
pub(super) struct Averaged {
    /// By camera; the groups do not know each other.
    pub camera_from_world: Vec<UnitQuaternion<f64>>,
    /// By camera: the number of its group.
    pub group: Vec<usize>,
    /// The group of most cameras.
    pub largest: usize,
    /// Pairs that agree with the average.
    pub consistent: BTreeSet<(usize, usize)>,
}

/// `[a][b]`: b from a, and how many observations say so.
type Between = Vec<Vec<Option<(UnitQuaternion<f64>, usize)>>>;

/// A triangle whose rotations miss the identity by less closes [rad].
const CLOSES_RAD: f64 = 0.08;
/// A pair further from the average is wrong [rad].
const WRONG_RAD: f64 = 0.12;
/// Where the weight of a pair has fallen to one half [rad].
const SCALE_RAD: f64 = 0.02;
const ROUNDS: usize = 20;

pub(super) fn average(n: usize, links: &[Oriented]) -> Averaged {
    let mut between: Between = vec![vec![None; n]; n];
    for it in links {
        let rotation = it.b_from_a.rotation;
        between[it.link.a][it.link.b] = Some((rotation, it.link.right));
        between[it.link.b][it.link.a] = Some((rotation.inverse(), it.link.right));
    }
    let trust = |a: usize, b: usize| -> f64 {
        let Some((b_from_a, right)) = between[a][b] else { return 0.0 };
        let (mut triangles, mut closed) = (0.0, 0.0);
        for (b_to, c_to) in between[b].iter().zip(&between) {
            let (Some((c_from_b, _)), Some((a_from_c, _))) = (b_to, c_to[a]) else { continue };
            triangles += 1.0;
            closed += f64::from(u8::from((a_from_c * c_from_b * b_from_a).angle() < CLOSES_RAD));
        }
        right as f64 * (1.0 + closed) / (1.0 + triangles)
    };
    let mut edges: Vec<(f64, usize, usize)> =
        links.iter().map(|it| (trust(it.link.a, it.link.b), it.link.a, it.link.b)).collect();
    edges.sort_by(|x, y| y.0.total_cmp(&x.0).then((x.1, x.2).cmp(&(y.1, y.2))));
    let mut camera_from_world = vec![UnitQuaternion::identity(); n];
    spread_over_tree(&edges, &between, &mut camera_from_world);
    for _ in 0..ROUNDS {
        let step = mean_step(&edges, &between, &camera_from_world);
        camera_from_world.iter_mut().zip(&step).for_each(|(it, step)| *it *= UnitQuaternion::from_scaled_axis(*step));
        if step.iter().all(|it| it.norm() < 1e-9) {
            break;
        }
    }
    let agrees = |a: usize, b: usize| {
        between[a][b].is_some_and(|(it, _)| error(&it, &camera_from_world[a], &camera_from_world[b]).norm() < WRONG_RAD)
    };
    let consistent: BTreeSet<(usize, usize)> =
        edges.iter().filter(|it| agrees(it.1, it.2)).map(|it| (it.1, it.2)).collect();
    let group = groups(n, consistent.iter().copied());
    let size = |which: usize| group.iter().filter(|it| **it == which).count();
    let largest = group.iter().copied().max_by_key(|it| (size(*it), n - it)).unwrap_or(0);
    Averaged { camera_from_world, group, largest, consistent }
}

/// Rotation vector of Rbᵀ Rba Ra, which is 0 when the pair agrees.
fn error(b_from_a: &UnitQuaternion<f64>, a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> Vector3<f64> {
    (b.inverse() * b_from_a * a).scaled_axis()
}

/// Prim's order: from each camera not yet reached, along the most trusted edge.
fn spread_over_tree(edges: &[(f64, usize, usize)], between: &Between, rotations: &mut [UnitQuaternion<f64>]) {
    let mut reached = vec![false; rotations.len()];
    while let Some(&(_, first, _)) = edges.iter().find(|it| !reached[it.1] && !reached[it.2]) {
        reached[first] = true;
        while let Some(&(_, a, b)) = edges.iter().find(|it| reached[it.1] != reached[it.2]) {
            let (from, to) = if reached[a] { (a, b) } else { (b, a) };
            reached[to] = true;
            if let Some((to_from_from, _)) = between[from][to] {
                rotations[to] = to_from_from * rotations[from];
            }
        }
    }
}

/// The step ω with ωb − ωa = error, by weighted least squares; each group's mean stays.
fn mean_step(edges: &[(f64, usize, usize)], between: &Between, rotations: &[UnitQuaternion<f64>]) -> Vec<Vector3<f64>> {
    let n = rotations.len();
    let (mut normal, mut right) = (DMatrix::<f64>::identity(n, n) * 1e-9, DMatrix::<f64>::zeros(n, 3));
    for &(trust, a, b) in edges {
        let Some((b_from_a, _)) = between[a][b] else { continue };
        let error = error(&b_from_a, &rotations[a], &rotations[b]);
        let weight = trust.max(1e-3) / (1.0 + (error.norm() / SCALE_RAD).powi(2));
        normal[(a, a)] += weight;
        normal[(b, b)] += weight;
        normal[(a, b)] -= weight;
        normal[(b, a)] -= weight;
        for axis in 0..3 {
            right[(b, axis)] += weight * error[axis];
            right[(a, axis)] -= weight * error[axis];
        }
    }
    let step = normal.cholesky().map_or_else(|| DMatrix::zeros(n, 3), |it| it.solve(&right));
    (0..n).map(|it| Vector3::new(step[(it, 0)], step[(it, 1)], step[(it, 2)])).collect()
}

/// By camera: the least number among those it is connected with.
fn groups(n: usize, edges: impl Iterator<Item = (usize, usize)> + Clone) -> Vec<usize> {
    let mut group: Vec<usize> = (0..n).collect();
    loop {
        let before = group.clone();
        for (a, b) in edges.clone() {
            let least = group[a].min(group[b]);
            (group[a], group[b]) = (least, least);
        }
        if group == before {
            return group;
        }
    }
}
