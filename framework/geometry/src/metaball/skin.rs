//! The skin of a body as B-spline patches over cross-sections (§3.1).

use nalgebra::{Point3, Vector3};

use super::field::Body;
use super::skeleton::State;
use crate::surface::{SurfaceVertex, TriangleMesh};

/// A B-spline patch around one segment: its grid of control points, closed around the limb, and its tessellation.
#[derive(Debug, Clone, PartialEq)]
pub struct BodySkin {
    /// Index of the segment.
    pub segment: usize,
    /// Control points, by cross-section along the bone, then around it [m].
    pub control: Vec<Vec<Point3<f64>>>,
    /// The patch as triangles.
    pub mesh: TriangleMesh,
}

/// A B-spline patch for each segment with balls: control points where rays from the bone leave the surface, `sections`
/// of them along the bone and `around` about it; each span of the uniform bicubic B-spline is divided `divide` times.
/// Ends of a patch reach its control points.
///
/// # Panics
/// When there are fewer than 2 sections, 3 rays or 1 division.
pub fn skin_patches(body: &Body, state: &State, sections: usize, around: usize, divide: usize) -> Vec<BodySkin> {
    assert!(sections >= 2 && around >= 3 && divide >= 1, "expected 2 sections, 3 rays and 1 division at least");
    let posed = body.skeleton.pose(state);
    let carries = |segment: usize| body.balls.iter().any(|it| it.segment == segment);
    let mut patches = Vec::new();
    for segment in (0..body.skeleton.segments().len()).filter(|it| carries(*it)) {
        let scale = state.scales[body.skeleton.segments()[segment].scale];
        let length = body.skeleton.segments()[segment].length * scale;
        let section = |number: usize| -> Vec<Point3<f64>> {
            let along = Vector3::new(0.0, 0.0, length * number as f64 / (sections - 1) as f64);
            let leaves = |ray: usize| {
                let angle = std::f64::consts::TAU * ray as f64 / around as f64;
                let out = Vector3::new(angle.cos(), angle.sin(), 0.0);
                let far = body.leaves(&posed, state, segment, body.near(segment), along, out);
                posed.world_from_segment[segment] * Point3::from(along + out * far)
            };
            (0..around).map(leaves).collect()
        };
        let control: Vec<Vec<Point3<f64>>> = (0..sections).map(section).collect();
        let mesh = tessellated(&control, divide);
        patches.push(BodySkin { segment, control, mesh });
    }
    patches
}

/// Weights of the four control points about a place in a span of the uniform cubic B-spline, and their derivatives.
fn cubic(t: f64) -> ([f64; 4], [f64; 4]) {
    let (t2, t3, s) = (t * t, t * t * t, 1.0 - t);
    let value =
        [s * s * s / 6.0, (3.0 * t3 - 6.0 * t2 + 4.0) / 6.0, (-3.0 * t3 + 3.0 * t2 + 3.0 * t + 1.0) / 6.0, t3 / 6.0];
    let slope = [-0.5 * s * s, 1.5 * t2 - 2.0 * t, -1.5 * t2 + t + 0.5, 0.5 * t2];
    (value, slope)
}

fn tessellated(control: &[Vec<Point3<f64>>], divide: usize) -> TriangleMesh {
    let (sections, around) = (control.len(), control[0].len());
    // Beyond an end the control points go on in a straight line, so that the spline ends in its control points.
    let at = |section: isize, ray: usize| -> Vector3<f64> {
        let last = sections as isize - 1;
        let point = |it: isize| control[it as usize][ray % around].coords;
        match section {
            it if it < 0 => 2.0 * point(0) - point(1),
            it if it > last => 2.0 * point(last) - point(last - 1),
            it => point(it),
        }
    };
    let (rows, columns) = ((sections - 1) * divide + 1, around * divide);
    let mut mesh = TriangleMesh::default();
    for row in 0..rows {
        let span = (row / divide).min(sections - 2);
        let (along, along_slope) = cubic((row - span * divide) as f64 / divide as f64);
        for column in 0..columns {
            let (about, about_slope) = cubic((column % divide) as f64 / divide as f64);
            let sum = |first: &[f64; 4], second: &[f64; 4]| {
                let mut sum = Vector3::zeros();
                for (i, by_section) in first.iter().enumerate() {
                    for (j, by_ray) in second.iter().enumerate() {
                        // The span about control points −1 to 2 of it; + around keeps the index above 0.
                        sum += at(span as isize + i as isize - 1, column / divide + j + around - 1)
                            * (by_section * by_ray);
                    }
                }
                sum
            };
            let normal = sum(&along, &about_slope).cross(&sum(&along_slope, &about));
            let normal = normal.try_normalize(0.0).unwrap_or_else(Vector3::z);
            let position = Point3::from(sum(&along, &about));
            mesh.vertices.push(SurfaceVertex { position, normal, colour: [200; 3], n_points: 1.0, sigma: 0.0 });
        }
    }
    for (row, column) in (1..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
        let vertex = |row: usize, column: usize| (row * columns + column % columns) as u32;
        let [a, b, c, d] =
            [vertex(row - 1, column), vertex(row - 1, column + 1), vertex(row, column + 1), vertex(row, column)];
        mesh.triangles.extend([[a, b, c], [a, c, d]]);
    }
    mesh
}
