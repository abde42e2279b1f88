//! `export.bodies`: skeletons as a table (CSV), one moving skeleton a body (BVH), and all bodies as skinned shapes (GLB).
//!
//! Joint centres as C3D, TRC and NPZ come from the other exports: a body tracker sends its joints as targets, too.

pub(crate) mod bvh;
mod node;
mod skin;
#[cfg(test)]
mod tests;

pub use node::{ExportBodies, ExportBodiesSettings};

use foveate::prelude::*;
use nalgebra::Vector3;

/// One body through the session.
#[derive(Debug, Clone, Default)]
pub(crate) struct Course {
    pub(crate) id: u32,
    /// Ascending by time.
    pub(crate) frames: Vec<(Time, Skeleton)>,
}

/// The time between two frames: the median over all bodies, and at least a microsecond [s].
fn frame_s(courses: &[Course]) -> f64 {
    let mut steps: Vec<f64> =
        courses.iter().flat_map(|it| it.frames.windows(2).map(|pair| (pair[1].0 - pair[0].0).as_s())).collect();
    steps.retain(|it| *it > 1e-6);
    steps.sort_by(f64::total_cmp);
    steps.get(steps.len() / 2).copied().unwrap_or(1.0 / 30.0)
}

/// Median size of a part along its axes [m]; `None`: the body never had it.
fn median_sizes(course: &Course, part: usize) -> Option<Vector3<f64>> {
    let sizes: Vec<_> = course.frames.iter().filter_map(|it| part_of(&it.1, part)).map(|it| it.sizes).collect();
    median_of(&sizes)
}

/// Median along each axis; `None` of nothing.
fn median_of(list: &[Vector3<f64>]) -> Option<Vector3<f64>> {
    if list.is_empty() {
        return None;
    }
    Some(Vector3::from_fn(|axis, _| {
        let mut values: Vec<f64> = list.iter().map(|it| it[axis]).collect();
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    }))
}

fn part_of(skeleton: &Skeleton, part: usize) -> Option<&SkeletonPart> {
    skeleton.parts.iter().find(|it| usize::from(it.part) == part)
}
