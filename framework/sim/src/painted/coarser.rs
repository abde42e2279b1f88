//! Fewer triangles: short edges are drawn together into one of their ends, shortest first, where that folds nothing over.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use nalgebra::{Point3, Vector3};

use super::surface::{Material, Mode, Surface, Triangle};

/// A triangle may turn by no more than this cosine says when one of its corners moves.
const LEAST_COSINE: f64 = 0.85;

/// Edges of whole nanometres, for an order that is the same everywhere.
type Length = u64;

struct Mesh {
    rest: Vec<Point3<f64>>,
    triangles: Vec<Option<Triangle>>,
    /// Of each vertex, the triangles around it.
    around: Vec<Vec<u32>>,
    /// Vertices that stay: at borders, and where texture or material changes.
    is_fixed: Vec<bool>,
}

/// `surface` with edges of about the length that `target` [m] says for a place, its modes and shares kept for the vertices that are left.
pub(super) fn coarser(surface: Surface, target: impl Fn(&Point3<f64>) -> f64) -> Surface {
    let Surface { rest, triangles, modes, follow, openness } = surface;
    let mut around = vec![Vec::new(); rest.len()];
    for (number, triangle) in (0..).zip(&triangles) {
        triangle.corners.iter().for_each(|it| around[*it as usize].push(number));
    }
    let triangles = triangles.into_iter().map(Some).collect();
    let mut mesh = Mesh { is_fixed: vec![false; rest.len()], rest, triangles, around };
    mesh.is_fixed = (0..mesh.rest.len()).map(|vertex| mesh.must_stay(vertex as u32)).collect();
    let mut queue: BinaryHeap<Reverse<(Length, u32, u32)>> = BinaryHeap::new();
    for vertex in 0..mesh.rest.len() as u32 {
        mesh.queue_from(vertex, &target, &mut queue);
    }
    while let Some(Reverse((length, from, to))) = queue.pop() {
        if mesh.length(from, to) == length && mesh.draw_together(from, to) {
            for vertex in mesh.neighbours(to) {
                mesh.queue_from(vertex, &target, &mut queue);
            }
            mesh.queue_from(to, &target, &mut queue);
        }
    }
    mesh.compact(modes, &follow, &openness)
}

impl Mesh {
    fn of(&self, vertex: u32) -> impl Iterator<Item = (u32, &Triangle)> {
        self.around[vertex as usize].iter().filter_map(|it| Some((*it, self.triangles[*it as usize].as_ref()?)))
    }

    fn neighbours(&self, vertex: u32) -> Vec<u32> {
        let mut found: Vec<u32> = self.of(vertex).flat_map(|it| it.1.corners).filter(|it| *it != vertex).collect();
        found.sort_unstable();
        found.dedup();
        found
    }

    /// Whether a vertex lies at a border, or triangles around it differ in texture or material.
    fn must_stay(&self, vertex: u32) -> bool {
        let mut first: Option<([f32; 2], Material)> = None;
        let mut n = 0;
        for (_, triangle) in self.of(vertex) {
            let Some(place) = triangle.corners.iter().position(|it| *it == vertex) else { continue };
            let own = (triangle.texels[place], triangle.material);
            if *first.get_or_insert(own) != own {
                return true;
            }
            n += 1;
        }
        self.neighbours(vertex).len() != n
    }

    fn length(&self, a: u32, b: u32) -> Length {
        ((self.rest[a as usize] - self.rest[b as usize]).norm() * 1e9) as Length
    }

    fn queue_from(
        &self,
        vertex: u32,
        target: &impl Fn(&Point3<f64>) -> f64,
        queue: &mut BinaryHeap<Reverse<(Length, u32, u32)>>,
    ) {
        if self.is_fixed[vertex as usize] {
            return;
        }
        let least = (target(&self.rest[vertex as usize]) * 1e9) as Length;
        let near = self.neighbours(vertex).into_iter().map(|it| (self.length(vertex, it), it));
        queue.extend(near.filter(|it| it.0 < least).map(|(length, to)| Reverse((length, vertex, to))));
    }

    fn normal(&self, corners: [u32; 3]) -> Vector3<f64> {
        let [a, b, c] = corners.map(|it| self.rest[it as usize]);
        (b - a).cross(&(c - a))
    }

    /// Moves `from` into its neighbour `to`; whether that could be done.
    fn draw_together(&mut self, from: u32, to: u32) -> bool {
        let (ours, theirs) = (self.neighbours(from), self.neighbours(to));
        if !ours.contains(&to) || ours.iter().filter(|it| theirs.contains(it)).count() != 2 {
            return false;
        }
        let shared = self.of(from).find_map(|(_, triangle)| {
            let place = triangle.corners.iter().position(|it| *it == to)?;
            Some(triangle.texels[place])
        });
        let Some(texel) = shared else { return false };
        let (mut kept, mut gone) = (Vec::new(), Vec::new());
        for (number, triangle) in self.of(from) {
            if triangle.corners.contains(&to) {
                gone.push(number);
                continue;
            }
            let mut moved = *triangle;
            for (corner, at) in moved.corners.iter_mut().zip(&mut moved.texels) {
                if *corner == from {
                    (*corner, *at) = (to, texel);
                }
            }
            let (before, after) = (self.normal(triangle.corners), self.normal(moved.corners));
            if before.dot(&after) < LEAST_COSINE * before.norm() * after.norm() || after.norm() < 1e-9 {
                return false;
            }
            kept.push((number, moved));
        }
        gone.iter().for_each(|it| self.triangles[*it as usize] = None);
        for (number, moved) in kept {
            self.triangles[number as usize] = Some(moved);
            self.around[to as usize].push(number);
        }
        self.around[from as usize].clear();
        true
    }

    /// Leaves out what is not used any more.
    fn compact(self, modes: Vec<Mode>, follow: &[f64], openness: &[f32]) -> Surface {
        let mut triangles: Vec<Triangle> = self.triangles.into_iter().flatten().collect();
        let mut names = vec![u32::MAX; self.rest.len()];
        let (mut rest, mut follows, mut opennesses) = (Vec::new(), Vec::new(), Vec::new());
        for corner in triangles.iter_mut().flat_map(|it| &mut it.corners) {
            let old = *corner as usize;
            if names[old] == u32::MAX {
                names[old] = rest.len() as u32;
                rest.push(self.rest[old]);
                follows.push(follow[old]);
                opennesses.push(openness[old]);
            }
            *corner = names[old];
        }
        let renamed = |mode: Mode| {
            let moves = mode.moves.into_iter().map(|(vertex, by)| (names[vertex as usize], by));
            Mode { name: mode.name, moves: moves.filter(|it| it.0 != u32::MAX).collect() }
        };
        let modes = modes.into_iter().map(renamed).collect();
        Surface { modes, rest, triangles, follow: follows, openness: opennesses }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fine_sheet_becomes_a_coarse_one_with_its_border_and_area() {
        let n = 21_u32;
        let rest = (0..n * n).map(|i| {
            let (y, z) = (f64::from(i % n), f64::from(i / n));
            Point3::new(0.05 * (y * 0.3).sin(), y, z) * 1e-3
        });
        let mut triangles = Vec::new();
        for (row, column) in (0..n - 1).flat_map(|row| (0..n - 1).map(move |column| (row, column))) {
            let [a, b, c, d] = [0, 1, n + 1, n].map(|it| row * n + column + it);
            for corners in [[a, b, c], [a, c, d]] {
                let texels = corners.map(|it| [(it % n) as f32, (it / n) as f32]);
                triangles.push(Triangle { corners, texels, material: Material::Skin });
            }
        }
        let mode = Mode { name: "up".to_owned(), moves: (0..n * n).map(|it| (it, Vector3::z() * 1e-3)).collect() };
        let size = (n * n) as usize;
        let (follow, openness) = (vec![0.5; size], vec![1.0; size]);
        let sheet = Surface { rest: rest.collect(), triangles, modes: vec![mode], follow, openness };
        let coarse = coarser(sheet, |_| 3e-3);
        assert!(coarse.rest.len() < 200 && coarse.rest.len() >= 80, "{} vertices", coarse.rest.len());
        let mut area = 0.0;
        for triangle in &coarse.triangles {
            let [a, b, c] = triangle.corners.map(|it| coarse.rest[it as usize]);
            let normal = (b - a).cross(&(c - a));
            assert!(normal.x > 0.0, "a triangle is folded over");
            area += normal.x / 2.0;
            // Texture places stay with their vertices.
            for (corner, texel) in triangle.corners.iter().zip(triangle.texels) {
                let p = coarse.rest[*corner as usize] * 1e3;
                assert!((p.y - f64::from(texel[0])).abs() < 1e-6 && (p.z - f64::from(texel[1])).abs() < 1e-6);
            }
        }
        assert!((area - 400e-6).abs() < 1e-9, "{area} m²");
        assert_eq!(coarse.modes[0].moves.len(), coarse.rest.len());
        assert_eq!(coarse.follow.len(), coarse.rest.len());
    }
}
