//! Distances of a shape from a reference as colours: a picture from the front, a histogram, and a cloud for viewers.

use foveate_estimation::statistics::percentile;
use foveate_geometry::surface::{Shape, ShapeDistances};
use foveate_plot::axes::{Labels, Panel, Range};
use foveate_plot::svg::{Anchor, Pen, Rect, SMALL, Svg};
use nalgebra::{Matrix3, Point3, Vector3};

/// Cells of the picture along its longer side.
const CELLS: f64 = 220.0;
/// Of a cell [px].
const CELL: f64 = 3.0;
/// Colours from the one side to the other.
const COLOURS: usize = 33;
const GRAY: &str = "#d4d4d4";
/// Columns of the histogram.
const BARS: usize = 61;

/// From deep blue (−1) over pale gray to deep red (+1), ever darker on either side.
fn colour(part: f64) -> [u8; 3] {
    const STOPS: [[f64; 3]; 5] =
        [[24.0, 66.0, 140.0], [92.0, 160.0, 220.0], [238.0, 236.0, 226.0], [236.0, 140.0, 90.0], [150.0, 20.0, 40.0]];
    let place = (part.clamp(-1.0, 1.0) + 1.0) / 2.0 * (STOPS.len() - 1) as f64;
    let (low, high) = (STOPS[place.floor() as usize], STOPS[place.ceil() as usize]);
    [0, 1, 2].map(|it| (low[it] * (1.0 - place.fract()) + high[it] * place.fract()).round() as u8)
}

/// Which of the colours a distance has.
fn bin(distance: f64, most: f64) -> usize {
    let part = (distance / most).clamp(-1.0, 1.0);
    ((part + 1.0) / 2.0 * (COLOURS - 1) as f64).round() as usize
}

fn colour_of(bin: usize) -> [u8; 3] {
    colour(2.0 * bin as f64 / (COLOURS - 1) as f64 - 1.0)
}

/// The distance that has the deepest colour: the 95th percentile, in a round number [m].
fn deepest(found: &ShapeDistances) -> f64 {
    let sizes: Vec<f64> = found.of_points.iter().map(|it| it.abs()).collect();
    let p95 = percentile(&sizes, 95.0).filter(|it| *it > 0.0).unwrap_or(1e-3);
    let decade = 10_f64.powf(p95.log10().floor());
    [1.0, 1.5, 2.0, 3.0, 5.0, 10.0].map(|it| it * decade).into_iter().find(|it| *it >= p95).unwrap_or(p95)
}

/// Points of a shape seen from the front, without perspective: for each cell the nearest one.
struct View {
    view_from_space: Matrix3<f64>,
    low: Vector3<f64>,
    cell: f64,
    size: [usize; 2],
}

impl View {
    /// From where `a` faces on the whole; where its normals are not known, along its thinnest direction.
    fn of(a: &Shape, b: &Shape) -> View {
        let facing: Vector3<f64> = a.normals().iter().sum();
        let strength = facing.norm() / a.normals().len().max(1) as f64;
        let toward = if strength > 0.1 { facing.normalize() } else { thinnest(a.points()) };
        let back = -toward;
        let up = if back.z.abs() < 0.95 { Vector3::z() } else { Vector3::y() };
        let right = back.cross(&up).normalize();
        let view_from_space =
            Matrix3::from_rows(&[right.transpose(), back.cross(&right).transpose(), back.transpose()]);
        let (mut low, mut high) = (Vector3::repeat(f64::INFINITY), Vector3::repeat(f64::NEG_INFINITY));
        for axis in 0..3 {
            let along = |shape: &Shape, percent: f64| {
                let values: Vec<f64> = shape.points().iter().map(|it| (view_from_space * it.coords)[axis]).collect();
                percentile(&values, percent).unwrap_or(0.0)
            };
            // A few points far away must not make the rest small.
            let margin = 0.1 * (along(a, 99.0) - along(a, 1.0)).max(along(b, 99.0) - along(b, 1.0));
            low[axis] = along(a, 1.0).min(along(b, 1.0)) - margin;
            high[axis] = along(a, 99.0).max(along(b, 99.0)) + margin;
        }
        let extent = (high - low).xy();
        let cell = (extent.max() / CELLS).max(f64::MIN_POSITIVE);
        let size = [extent.x, extent.y].map(|it| ((it / cell).ceil() as usize).clamp(1, CELLS as usize + 1));
        View { view_from_space, low, cell, size }
    }

    /// By cell the number of the nearest point.
    fn front(&self, points: &[Point3<f64>]) -> Vec<Option<usize>> {
        let mut found: Vec<Option<(f64, usize)>> = vec![None; self.size[0] * self.size[1]];
        for (number, point) in points.iter().enumerate() {
            let at = self.view_from_space * point.coords;
            let [x, y] = [0, 1].map(|it| ((at[it] - self.low[it]) / self.cell).floor());
            if x < 0.0 || y < 0.0 || x >= self.size[0] as f64 || y >= self.size[1] as f64 {
                continue;
            }
            let cell = &mut found[y as usize * self.size[0] + x as usize];
            if cell.is_none_or(|it| at.z < it.0) {
                *cell = Some((at.z, number));
            }
        }
        found.into_iter().map(|it| it.map(|it| it.1)).collect()
    }

    fn rect(&self, cell: usize, [left, top]: [f64; 2]) -> Rect {
        let [x, y] = [cell % self.size[0], cell / self.size[0]].map(|it| it as f64 * CELL);
        Rect { left: left + x, top: top + y, width: CELL, height: CELL }
    }
}

/// The direction in which points spread least.
fn thinnest(points: &[Point3<f64>]) -> Vector3<f64> {
    let n = points.len().max(1) as f64;
    let mean = points.iter().map(|it| it.coords).sum::<Vector3<f64>>() / n;
    let spread: Matrix3<f64> = points.iter().map(|it| (it.coords - mean) * (it.coords - mean).transpose()).sum();
    let eigen = spread.symmetric_eigen();
    eigen.eigenvectors.column(eigen.eigenvalues.imin()).into_owned()
}

/// Where `a` is before and behind `b`, from the front of `a`, with a histogram.
pub(super) fn svg(a: &Shape, b: &Shape, found: &ShapeDistances) -> String {
    let most = deepest(found);
    let view = View::of(a, b);
    let [columns, rows] = view.size.map(|it| it as f64 * CELL);
    let (left, top) = (16.0, 44.0);
    let right = left + columns + 76.0;
    let (width, height) = (right + 330.0, top + rows.max(330.0) + 40.0);
    let sign = if found.is_signed { "signed distance of A from B" } else { "distance of A from B" };
    let mut svg = Svg::new(width, height, sign);
    let of_b: Vec<Rect> = if b.is_mesh() {
        let samples: Vec<Point3<f64>> = b.samples(200_000).iter().map(|it| it.position).collect();
        cells(&view, &view.front(&samples), [left, top])
    } else {
        cells(&view, &view.front(b.points()), [left, top])
    };
    svg.cells(&of_b, GRAY);
    let mut by_colour: Vec<Vec<Rect>> = vec![Vec::new(); COLOURS];
    let mut beside = Vec::new();
    for (cell, point) in view.front(a.points()).into_iter().enumerate() {
        let Some(point) = point else { continue };
        let rect = view.rect(cell, [left, top]);
        match found.of_points[point] {
            it if it.is_nan() => beside.push(rect),
            it => by_colour[bin(it, most)].push(rect),
        }
    }
    svg.cells(&beside, "#8f8f8f");
    for (bin, cells) in by_colour.iter().enumerate() {
        svg.cells(cells, &hex(colour_of(bin)));
    }
    // What the colours mean.
    let bar = Rect { left: left + columns + 12.0, top, width: 14.0, height: 300.0 };
    for bin in 0..COLOURS {
        let each = bar.height / COLOURS as f64;
        let rect = Rect { top: bar.bottom() - (bin + 1) as f64 * each, height: each + 0.5, ..bar };
        svg.rect(rect, &hex(colour_of(bin)), None);
    }
    svg.rect(bar, "none", Some(Pen::new("#222222", 1.0)));
    let least = if found.is_signed { -1.0 } else { 0.0 };
    for part in [-1.0, -0.5, 0.0, 0.5, 1.0].into_iter().filter(|it| *it >= least) {
        let y = bar.bottom() - (part + 1.0) / 2.0 * bar.height + 4.0;
        let sign = if found.is_signed && part != 0.0 { "+" } else { "" };
        let number =
            if sign.is_empty() { short(part * most * 1e3) } else { format!("{:+}", short_number(part * most * 1e3)) };
        svg.text([bar.right() + 5.0, y], Anchor::Start, SMALL, &number);
    }
    svg.text([bar.left, bar.bottom() + 18.0], Anchor::Start, SMALL, "mm");
    for (line, (fill, words)) in [(GRAY, "B alone"), ("#8f8f8f", "beside B, or too far")].into_iter().enumerate() {
        let y = bar.bottom() + 40.0 + 18.0 * line as f64;
        svg.rect(Rect { left: right, top: y - 10.0, width: 12.0, height: 12.0 }, fill, None);
        svg.text([right + 18.0, y], Anchor::Start, SMALL, words);
    }
    histogram(&mut svg, found, most, Rect { left: right + 40.0, top, width: 270.0, height: 240.0 });
    svg.finish()
}

fn cells(view: &View, front: &[Option<usize>], at: [f64; 2]) -> Vec<Rect> {
    let filled = front.iter().enumerate().filter(|it| it.1.is_some());
    filled.map(|(cell, _)| view.rect(cell, at)).collect()
}

fn histogram(svg: &mut Svg, found: &ShapeDistances, most: f64, rect: Rect) {
    let (low, high) = (if found.is_signed { -2.0 * most } else { 0.0 }, 2.0 * most);
    let mut counts = [0_usize; BARS];
    let values: Vec<f64> = found.of_points.iter().copied().filter(|it| it.is_finite()).collect();
    let place = |it: f64| (it - low) / (high - low) * BARS as f64;
    for it in values.iter().map(|it| place(*it)).filter(|it| (0.0..BARS as f64).contains(it)) {
        counts[it as usize] += 1;
    }
    let share = |count: usize| 100.0 * count as f64 / values.len().max(1) as f64;
    let highest = counts.iter().copied().max().map_or(1.0, share).max(1e-9);
    let panel = Panel::new(rect, Range { min: 1e3 * low, max: 1e3 * high }, Range { min: 0.0, max: 1.05 * highest });
    panel.background(svg, Labels::new(Some("distance of A from B [mm]"), "points [%]"));
    let step = (high - low) / BARS as f64;
    for (bar, count) in counts.into_iter().enumerate().filter(|it| it.1 > 0) {
        let from = low + bar as f64 * step;
        let [left, top] = panel.place(1e3 * from, share(count));
        let [right, bottom] = panel.place(1e3 * (from + step), 0.0);
        let bar = Rect { left, top, width: right - left, height: bottom - top };
        svg.rect(bar, &hex(colour_of(bin(from + step / 2.0, most))), Some(Pen::new("#777777", 0.4)));
    }
    panel.frame(svg);
}

fn hex([red, green, blue]: [u8; 3]) -> String {
    format!("#{red:02x}{green:02x}{blue:02x}")
}

fn short_number(value: f64) -> f64 {
    let decimals = 10_f64.powf(2.0 - value.abs().max(1e-9).log10().floor());
    (value * decimals).round() / decimals
}

fn short(value: f64) -> String {
    short_number(value).to_string()
}

/// The points of a shape as a binary PLY file: where they lie on the reference, coloured, with `distance` in metres, not a number where it does not count.
pub(super) fn ply(a: &Shape, found: &ShapeDistances) -> Vec<u8> {
    let most = deepest(found);
    let n = a.points().len();
    let mut header =
        format!("ply\nformat binary_little_endian 1.0\ncomment metres, in the space of B\nelement vertex {n}\n");
    ["x", "y", "z"].iter().for_each(|it| header += &format!("property float {it}\n"));
    ["red", "green", "blue"].iter().for_each(|it| header += &format!("property uchar {it}\n"));
    header += "property float distance\n";
    if a.is_mesh() {
        header += &format!("element face {}\nproperty list uchar int vertex_indices\n", a.triangles().len());
    }
    let mut bytes = (header + "end_header\n").into_bytes();
    for (point, distance) in a.points().iter().zip(&found.of_points) {
        bytes.extend([point.x, point.y, point.z].iter().flat_map(|it| (*it as f32).to_le_bytes()));
        bytes.extend(if distance.is_nan() { [143; 3] } else { colour(distance / most) });
        bytes.extend((*distance as f32).to_le_bytes());
    }
    for triangle in a.triangles() {
        bytes.push(3);
        bytes.extend(triangle.iter().flat_map(|it| it.to_le_bytes()));
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_are_pale_in_the_middle_and_differ_at_the_ends() {
        let sum = |it: [u8; 3]| it.iter().map(|it| u32::from(*it)).sum::<u32>();
        assert!(sum(colour(0.0)) > sum(colour(0.5)) && sum(colour(0.5)) > sum(colour(1.0)));
        assert!(colour(1.0)[0] > colour(1.0)[2] && colour(-1.0)[2] > colour(-1.0)[0]);
        assert_eq!([bin(-9.0, 1.0), bin(0.0, 1.0), bin(9.0, 1.0)], [0, COLOURS / 2, COLOURS - 1]);
        assert_eq!(colour(f64::NEG_INFINITY), colour(-1.0));
    }
}
