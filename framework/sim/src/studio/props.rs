//! Things that stand in the studio: chairs.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};

use super::texture::Colour;
use crate::painted::{Material, Triangle, noise};

/// A box of a chair: its middle and half its sides [m], in the chair's space (x forward, z up, the origin on the floor below the seat), by how much its upper end leans back [rad], and
/// whether it is cloth.
struct Board {
    middle: [f64; 3],
    half: [f64; 3],
    leans: f64,
    is_cloth: bool,
}

const fn board(middle: [f64; 3], half: [f64; 3], leans: f64, is_cloth: bool) -> Board {
    Board { middle, half, leans, is_cloth }
}

const CHAIR: [Board; 8] = [
    board([0.0, 0.0, 0.45], [0.22, 0.22, 0.03], 0.0, true),
    board([-0.22, 0.0, 0.75], [0.02, 0.21, 0.16], 0.14, true),
    board([-0.205, 0.17, 0.62], [0.015, 0.015, 0.18], 0.14, false),
    board([-0.205, -0.17, 0.62], [0.015, 0.015, 0.18], 0.14, false),
    board([0.19, 0.19, 0.21], [0.018, 0.018, 0.21], 0.0, false),
    board([0.19, -0.19, 0.21], [0.018, 0.018, 0.21], 0.0, false),
    board([-0.19, 0.19, 0.21], [0.018, 0.018, 0.21], 0.0, false),
    board([-0.19, -0.19, 0.21], [0.018, 0.018, 0.21], 0.0, false),
];

/// All things that stand still, in the world.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Props {
    pub vertices: Vec<Point3<f64>>,
    pub triangles: Vec<Triangle>,
    /// By twelve triangles.
    boards: Vec<(Isometry3<f64>, bool)>,
}

/// Corners of the sides of a box, counter-clockwise from outside; bit k of a corner says whether it lies at the higher end of axis k.
const SIDES: [[u32; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

impl Props {
    /// Chairs: place on the floor [m], and where they face, from X towards Y [°].
    pub fn chairs(chairs: &[[f64; 3]]) -> Self {
        let mut props = Self::default();
        for [x, y, facing_deg] in chairs {
            let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), facing_deg.to_radians());
            let world_from_chair = Isometry3::from_parts(Translation3::new(*x, *y, 0.0), turn);
            CHAIR.iter().for_each(|it| props.add(it, &world_from_chair));
        }
        props
    }

    fn add(&mut self, board: &Board, world_from_chair: &Isometry3<f64>) {
        let leans = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -board.leans);
        let chair_from_board = Isometry3::from_parts(Translation3::from(Vector3::from(board.middle)), leans);
        let world_from_board = world_from_chair * chair_from_board;
        let first = self.vertices.len() as u32;
        for corner in 0..8 {
            let at = [0, 1, 2].map(|axis| if corner >> axis & 1 == 1 { board.half[axis] } else { -board.half[axis] });
            self.vertices.push(world_from_board * Point3::from(at));
        }
        for [a, b, c, d] in SIDES {
            self.triangles.extend([[a, b, c], [a, c, d]].map(|corners| Triangle {
                corners: corners.map(|it| it + first),
                texels: [[0.0; 2]; 3],
                material: Material::Skin,
            }));
        }
        self.boards.push((world_from_board, board.is_cloth));
    }

    /// Outward normal of a triangle, of length 1.
    pub fn normal(&self, triangle: usize) -> Vector3<f32> {
        let [a, b, c] = self.triangles[triangle].corners.map(|it| self.vertices[it as usize]);
        (b - a).cross(&(c - a)).normalize().cast()
    }

    /// What colour a point of a triangle has.
    pub fn colour(&self, triangle: usize, point: &Point3<f64>) -> Colour {
        let (world_from_board, is_cloth) = &self.boards[triangle / 12];
        let at = world_from_board.inverse() * point;
        let (base, tone) = if *is_cloth {
            ([0.14, 0.22, 0.30], 1.0 + 0.12 * noise(&at, [4e-3; 3], 401) + 0.08 * noise(&at, [0.03; 3], 402))
        } else {
            let along = Point3::new(at.x, at.y, at.z * 0.1);
            ([0.34, 0.22, 0.12], 1.0 + 0.25 * noise(&along, [6e-3; 3], 403))
        };
        base.map(|it| it * tone)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_chair_is_closed_and_stands_on_the_floor() {
        let props = Props::chairs(&[[0.4, -0.3, 30.0]]);
        assert_eq!((props.vertices.len(), props.triangles.len()), (64, 96));
        let volume: f64 = props
            .triangles
            .iter()
            .map(|it| {
                let [a, b, c] = it.corners.map(|it| props.vertices[it as usize].coords);
                a.dot(&b.cross(&c)) / 6.0
            })
            .sum();
        let boards: f64 = CHAIR.iter().map(|it| it.half.iter().product::<f64>() * 8.0).sum();
        assert!((volume - boards).abs() < 1e-12, "{volume} {boards}");
        let low = props.vertices.iter().map(|it| it.z).fold(f64::INFINITY, f64::min);
        assert!(low.abs() < 1e-12);
    }
}
