//! Surfaces over rings: a grid of vertices, closed around, with texture coordinates in shares of both sides.

use nalgebra::{Point3, Vector3};

use crate::painted::{Material, Triangle};

/// A grid of rings: ring by ring, counter-clockwise around as seen against the way from the first ring to the last.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Grid {
    pub rings: usize,
    pub around: usize,
    /// Of its vertices among those of the whole thing.
    pub first: usize,
}

impl Grid {
    pub fn n_vertices(&self) -> usize {
        self.rings * self.around
    }

    /// Adds its triangles, counter-clockwise as seen from outside; texture coordinates are shares of both sides.
    pub fn triangles(&self, into: &mut Vec<Triangle>) {
        let vertex = |ring: usize, place: usize| (self.first + ring * self.around + place % self.around) as u32;
        let [rows, columns] = [self.rings - 1, self.around].map(|it| it as f32);
        let texel = |ring: usize, place: usize| [place as f32 / columns, ring as f32 / rows];
        for ring in 0..self.rings - 1 {
            for place in 0..self.around {
                let corner = |(ring, place): (usize, usize)| (vertex(ring, place), texel(ring, place));
                let [a, b, c, d] =
                    [(ring, place), (ring, place + 1), (ring + 1, place), (ring + 1, place + 1)].map(corner);
                // Alternate diagonals, so that no side leans.
                let pairs = if (ring + place) % 2 == 0 { [[a, b, d], [a, d, c]] } else { [[a, b, c], [b, d, c]] };
                into.extend(pairs.map(|it| Triangle {
                    corners: it.map(|it| it.0),
                    texels: it.map(|it| it.1),
                    material: Material::Skin,
                }));
            }
        }
    }

    /// Outward normals of its vertices, from the differences of their neighbours; at ends that are closed, along the axis.
    pub fn normals(&self, vertices: &[Point3<f64>], normals: &mut [Vector3<f32>]) {
        let at = |ring: usize, place: usize| vertices[self.first + ring * self.around + place % self.around];
        for ring in 0..self.rings {
            let (before, after) = (ring.saturating_sub(1), (ring + 1).min(self.rings - 1));
            for place in 0..self.around {
                let around = at(ring, place + 1) - at(ring, place + self.around - 1);
                let along = at(after, place) - at(before, place);
                let normal = around.cross(&along);
                // A ring that is a point has no way around.
                let is_point = around.norm_squared() < 1e-12;
                let normal = if is_point {
                    let inner = if ring == 0 { after } else { before };
                    at(ring, 0) - nalgebra::center(&at(inner, 0), &at(inner, self.around / 2))
                } else {
                    normal
                };
                let normal = normal.try_normalize(1e-15).unwrap_or(Vector3::z());
                normals[self.first + ring * self.around + place] = normal.cast();
            }
        }
    }
}

/// Values at rings of a table, between which is interpolated smoothly: Catmull and Rom's cubic with uneven steps, its slopes limited so that nothing overshoots.
pub(crate) fn along_table<const N: usize>(table: &[(f64, [f64; N])], at: f64) -> [f64; N] {
    let last = table.len() - 1;
    let next = table.iter().position(|it| it.0 > at).unwrap_or(last).clamp(1, last);
    let ((t0, v0), (t1, v1)) = (table[next - 1], table[next]);
    let share = ((at - t0) / (t1 - t0)).clamp(0.0, 1.0);
    let slope = |index: usize, value: usize| {
        if index == 0 || index == last {
            return 0.0;
        }
        let rise = |a: usize, b: usize| (table[b].1[value] - table[a].1[value]) / (table[b].0 - table[a].0);
        let (before, after) = (rise(index - 1, index), rise(index, index + 1));
        if before * after <= 0.0 { 0.0 } else { 2.0 * before * after / (before + after) }
    };
    std::array::from_fn(|value| {
        let (m0, m1) = (slope(next - 1, value) * (t1 - t0), slope(next, value) * (t1 - t0));
        let (s, q) = (share, share * share);
        let cubic = q * s;
        (2.0 * cubic - 3.0 * q + 1.0) * v0[value]
            + (cubic - 2.0 * q + s) * m0
            + (3.0 * q - 2.0 * cubic) * v1[value]
            + (cubic - q) * m1
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normals_and_triangles_of_a_ball_point_outwards() {
        let grid = Grid { rings: 13, around: 16, first: 0 };
        let mut vertices = Vec::new();
        for ring in 0..grid.rings {
            let down = std::f64::consts::PI * (1.0 - ring as f64 / (grid.rings - 1) as f64);
            for place in 0..grid.around {
                let angle = std::f64::consts::TAU * place as f64 / grid.around as f64;
                vertices.push(Point3::new(angle.cos() * down.sin(), angle.sin() * down.sin(), down.cos()));
            }
        }
        let mut normals = vec![Vector3::zeros(); grid.n_vertices()];
        grid.normals(&vertices, &mut normals);
        for (vertex, normal) in vertices.iter().zip(&normals) {
            assert!(vertex.coords.dot(&normal.cast()) > 0.98, "{vertex} {normal}");
        }
        let mut triangles = Vec::new();
        grid.triangles(&mut triangles);
        for triangle in &triangles {
            let [a, b, c] = triangle.corners.map(|it| vertices[it as usize]);
            let normal = (b - a).cross(&(c - a));
            assert!(normal.norm() < 1e-12 || normal.dot(&(a.coords + b.coords + c.coords)) > 0.0);
        }
    }

    #[test]
    fn table_is_met_at_its_rows_and_never_left() {
        let table = [(0.0, [1.0]), (0.2, [1.5]), (1.0, [1.5]), (1.3, [0.2])];
        for (at, [value]) in table {
            assert!((along_table(&table, at)[0] - value).abs() < 1e-12);
        }
        for step in -10..150 {
            let [value] = along_table(&table, f64::from(step) * 0.01);
            assert!((0.2 - 1e-12..1.5 + 1e-12).contains(&value), "{value}");
        }
    }
}
