//! Small holes in blobs are body.

use crate::blobs::Blob;
use crate::spots::component::{Component, Frame};

/// Fills holes; keeps its memory.
#[derive(Default)]
pub struct HoleFiller {
    component: Component,
    /// The box of a blob: 1 where it is background.
    open: Vec<u8>,
    zeros: Vec<u8>,
}

impl HoleFiller {
    /// Calls `fill` with the row and the first and last column of each piece of background within the box of `blob` that is connected (over sides and corners),
    /// does not reach the rim of the box, and has at most `max_area` pixels. `mask` is 0 where background; `width` its columns.
    pub fn find(
        &mut self,
        mask: &[u8],
        width: usize,
        blob: &Blob,
        max_area: u64,
        mut fill: impl FnMut(usize, usize, usize),
    ) {
        let [x0, y0, x1, y1] = blob.bounds.map(|it| it as usize);
        let (columns, rows) = (x1 - x0 + 1, y1 - y0 + 1);
        self.open.clear();
        for y in y0..=y1 {
            self.open.extend(mask[y * width + x0..=y * width + x1].iter().map(|it| u8::from(*it == 0)));
        }
        self.zeros.clear();
        self.zeros.resize(columns * rows, 0);
        self.component.begin(columns * rows, columns);
        let frame = Frame { pixels: &self.open, thresholds: &self.zeros, width: columns, height: rows, raised: 0 };
        for i in 0..columns * rows {
            if self.open[i] == 0 || self.component.taken(i) {
                continue;
            }
            let first = self.component.runs().len();
            let shape = self.component.take(&frame, i % columns, i / columns);
            let [a, b, c, d] = shape.bounds;
            let reaches_rim = a == 0 || b == 0 || c + 1 == columns || d + 1 == rows;
            if !reaches_rim && shape.area <= max_area {
                for run in &self.component.runs()[first..] {
                    fill(y0 + run.y, x0 + run.x0, x0 + run.x1 - 1);
                }
            }
        }
    }
}
