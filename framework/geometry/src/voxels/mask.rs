//! A silhouette prepared for queries: which of its pixels, and how many in a rectangle, are body.

/// Confidence from which on a pixel is body.
pub const BODY: u8 = 128;

/// What the picture says of a pixel, if it is not 1: body.
pub(super) const BACKGROUND: u8 = 0;
/// It does not show it.
pub(super) const UNSEEN: u8 = 2;

/// The body's bounding box in a silhouette, with a rim of one background pixel.
#[derive(Debug, Clone, Default)]
pub(super) struct Mask {
    /// Columns and rows of the picture [px].
    pub size: [u32; 2],
    /// First column and row of the box [px].
    pub start: [u32; 2],
    /// Its columns and rows [px]; 0 without body.
    pub extent: [u32; 2],
    /// [`UNSEEN`], then row by row of the box and its rim 1 for body or [`BACKGROUND`].
    pub codes: Vec<u8>,
    /// Body pixels above and to the left, with a zero row and column.
    sums: Vec<u32>,
    columns: Vec<u8>,
}

impl Mask {
    /// Takes in a silhouette of `width × height`.
    pub fn set(&mut self, confidence: &[u8], width: usize, height: usize) {
        self.size = [width as u32, height as u32];
        (self.start, self.extent) = ([0; 2], [0; 2]);
        self.columns.clear();
        self.columns.resize(width, 0);
        let mut rows: Option<(usize, usize)> = None;
        if width > 0 {
            for (y, row) in confidence.chunks_exact(width).enumerate() {
                let most = row.iter().zip(&mut self.columns).fold(0, |most: u8, (it, column)| {
                    *column = (*column).max(*it);
                    most.max(*it)
                });
                if most >= BODY {
                    rows = Some((rows.map_or(y, |it| it.0), y));
                }
            }
        }
        if let Some((top, bottom)) = rows {
            let is_body = |it: &u8| *it >= BODY;
            let left = self.columns.iter().position(is_body).unwrap_or(0);
            let right = self.columns.iter().rposition(is_body).unwrap_or(0);
            (self.start, self.extent) =
                ([left as u32, top as u32], [(right - left + 1) as u32, (bottom - top + 1) as u32]);
        }
        self.fill(confidence, width);
    }

    fn fill(&mut self, confidence: &[u8], width: usize) {
        let ([left, top], [columns, rows]) = (self.start.map(|it| it as usize), self.extent.map(|it| it as usize));
        let stride = columns + 2;
        self.codes.clear();
        self.codes.resize(1 + stride * (rows + 2), BACKGROUND);
        self.codes[0] = UNSEEN;
        self.sums.clear();
        self.sums.resize((columns + 1) * (rows + 1), 0);
        for y in 0..rows {
            let from = &confidence[(top + y) * width + left..][..columns];
            let codes = &mut self.codes[1 + (y + 1) * stride + 1..][..columns];
            for (code, it) in codes.iter_mut().zip(from) {
                *code = it >> 7;
            }
            let (above, here) = self.sums.split_at_mut((y + 1) * (columns + 1));
            let (above, here) = (&above[y * (columns + 1) + 1..][..columns], &mut here[1..=columns]);
            let mut sum = 0;
            for ((here, above), code) in here.iter_mut().zip(above).zip(&*codes) {
                sum += u32::from(*code);
                *here = above + sum;
            }
        }
    }

    /// Body pixels of all.
    pub fn n_body(&self) -> u32 {
        self.sums.last().copied().unwrap_or(0)
    }

    /// Body pixels in columns `x0..x1` of rows `y0..y1` of the picture.
    #[inline]
    pub fn count(&self, [x0, x1]: [u32; 2], [y0, y1]: [u32; 2]) -> u32 {
        let inside =
            |at: u32, axis: usize| (at.max(self.start[axis]) - self.start[axis]).min(self.extent[axis]) as usize;
        let ([x0, x1], [y0, y1]) = ([inside(x0, 0), inside(x1, 0)], [inside(y0, 1), inside(y1, 1)]);
        let stride = self.extent[0] as usize + 1;
        let at = |x: usize, y: usize| self.sums[y * stride + x];
        at(x1, y1).wrapping_sub(at(x0, y1)).wrapping_sub(at(x1, y0)).wrapping_add(at(x0, y0))
    }
}
