//! The built-in head: rows of a skull, a jaw and a neck around a vertical axis, with the features of a face pushed out of them.
//!
//! Everything is in millimetres here, in the head's space: x forward, y left, z up, the origin in the middle of the head.

use std::f64::consts::PI;

use nalgebra::{Point3, Vector3};

use super::surface::{Material, Surface, Triangle};

/// Height, how far the middle of front and back reach, half the width [mm].
const PROFILE: [[f64; 4]; 25] = [
    [109.0, 18.0, -36.0, 19.0],
    [104.0, 38.0, -56.0, 36.0],
    [96.0, 55.0, -73.0, 50.0],
    [85.0, 69.0, -86.0, 61.0],
    [72.0, 79.5, -94.0, 68.0],
    [57.0, 87.0, -99.5, 72.5],
    [40.0, 91.5, -101.5, 75.0],
    [26.0, 92.5, -100.0, 75.5],
    [10.0, 88.5, -97.0, 74.5],
    [-10.0, 88.0, -92.0, 71.5],
    [-30.0, 89.0, -84.0, 68.0],
    [-50.0, 89.0, -71.0, 63.5],
    [-62.0, 88.0, -64.0, 60.5],
    [-75.0, 85.0, -58.0, 56.5],
    [-88.0, 84.0, -54.0, 51.0],
    [-98.0, 82.0, -52.0, 46.0],
    [-106.0, 78.0, -51.0, 42.0],
    [-112.0, 69.0, -51.0, 41.0],
    [-117.0, 55.0, -51.0, 42.5],
    [-122.0, 42.0, -51.5, 46.0],
    [-130.0, 34.0, -52.0, 48.5],
    [-140.0, 29.0, -53.0, 50.0],
    [-155.0, 26.0, -55.0, 51.5],
    [-168.0, 26.0, -58.0, 54.0],
    [-182.0, 30.0, -62.0, 61.0],
];
/// The line between the lips [mm]: rows lie just above and below it.
pub(super) const SLIT: f64 = -62.0;
/// Half the distance of those rows [mm].
pub(super) const HALF_SLIT: f64 = 0.6;
/// Half the length of the line between the lips [mm].
pub(super) const HALF_MOUTH: f64 = 25.0;

/// Heights of rows, from the top down: to, and step [mm].
const ROWS: [[f64; 2]; 8] =
    [[100.0, 4.0], [80.0, 7.0], [45.0, 6.5], [-16.0, 4.2], [-40.0, 2.4], [-90.0, 3.4], [-124.0, 4.0], [-182.0, 10.0]];
/// Columns between azimuths, from straight ahead to straight back [°]: to, and step.
const COLUMNS: [[f64; 2]; 4] = [[36.0, 2.4], [75.0, 4.0], [110.0, 5.0], [180.0, 14.0]];
/// Size of a texel on the surface at most [mm], where the face is.
const TEXEL: f64 = 0.42;

/// The head at rest, with its texture's size [texel]; what follows the trunk is the foot of the neck.
pub(super) fn head() -> (Surface, [usize; 2]) {
    let heights = heights();
    let azimuths = azimuths();
    let n_columns = azimuths.len();
    let mut base: Vec<Point3<f64>> = Vec::new();
    for &z in &heights {
        base.extend(azimuths.iter().map(|&azimuth| skull(azimuth, z)));
    }
    let pole = base.len() as u32;
    base.push(Point3::new(-9.0, 0.0, 111.0));
    let rest: Vec<Point3<f64>> = base.iter().map(|it| (it + features(it)) * 1e-3).collect();
    let (across, width) = spread(n_columns, |column| {
        let next = (column + 1) % n_columns;
        let rows = (0..heights.len()).filter(|row| (-110.0..80.0).contains(&heights[*row]));
        rows.map(|row| (rest[row * n_columns + column] - rest[row * n_columns + next]).norm()).fold(0.0, f64::max)
    });
    let (down, height) = spread(heights.len() - 1, |row| {
        let columns = (0..n_columns).filter(|column| azimuths[*column].abs() < 70.0);
        columns
            .map(|column| (rest[row * n_columns + column] - rest[(row + 1) * n_columns + column]).norm())
            .fold(0.0, f64::max)
    });
    let texel = |row: usize, column: usize| [across[column], down[row]];
    let mut triangles = Vec::new();
    let mut add = |corners: [u32; 3], texels: [[f32; 2]; 3]| {
        triangles.push(Triangle { corners, texels, material: Material::Skin });
    };
    for column in 0..n_columns {
        let next = (column + 1) % n_columns;
        let vertex = |row: usize, column: usize| (row * n_columns + column) as u32;
        let (left, right) = (across[column], across[column + 1]);
        add(
            [pole, vertex(0, column), vertex(0, next)],
            [[(left + right) / 2.0, 1.0], [left, down[0]], [right, down[0]]],
        );
        for row in 0..heights.len() - 1 {
            let [a, b] = [vertex(row, column), vertex(row + 1, column)];
            let [c, d] = [vertex(row + 1, next), vertex(row, next)];
            let [ta, tb] = [texel(row, column), texel(row + 1, column)];
            let [tc, td] = [[right, down[row + 1]], [right, down[row]]];
            // Split along the diagonal that mirrors left and right.
            if azimuths[column] < 0.0 {
                add([a, b, c], [ta, tb, tc]);
                add([a, c, d], [ta, tc, td]);
            } else {
                add([a, b, d], [ta, tb, td]);
                add([b, c, d], [tb, tc, td]);
            }
        }
    }
    let follow = base.iter().map(|it| smooth((-128.0 - it.z) / 44.0)).collect();
    let mut surface = Surface { rest, triangles, modes: Vec::new(), follow, openness: Vec::new() };
    surface.open();
    surface.modes = super::expressions::modes(&base);
    (super::coarser::coarser(surface, target_edge), [width, height])
}

/// How far apart vertices should lie [m]; 0: as they do, where the features of the face are.
fn target_edge(p: &Point3<f64>) -> f64 {
    let [x, z] = [p.x, p.z].map(|it| it * 1e3);
    match (x, z) {
        _ if x < 28.0 || z < -114.0 => 10e-3,
        _ if z > 80.0 => 7e-3,
        _ => 0.0,
    }
}

/// Heights of the rows, from the top down, two of them at the line between the lips.
fn heights() -> Vec<f64> {
    let mut heights = vec![109.0];
    for [end, step] in ROWS {
        let start = heights[heights.len() - 1];
        let n = ((start - end) / step).ceil().max(1.0);
        heights.extend((1..=n as usize).map(|i| start + (end - start) * i as f64 / n));
    }
    heights.retain(|z| (z - SLIT).abs() > 1.4);
    heights.extend([SLIT + HALF_SLIT, SLIT - HALF_SLIT]);
    heights.sort_by(|a, b| b.total_cmp(a));
    heights
}

/// Azimuths of the columns, counter-clockwise from above and from −180° [°].
fn azimuths() -> Vec<f64> {
    let mut half = vec![0.0];
    for [end, step] in COLUMNS {
        let start = half[half.len() - 1];
        let n = ((end - start) / step).ceil().max(1.0);
        half.extend((1..=n as usize).map(|i| start + (end - start) * i as f64 / n));
    }
    let right = half.iter().rev().map(|it| -it);
    right.chain(half[1..half.len() - 1].iter().copied()).collect()
}

/// Places of `n + 1` lines in the texture, `n` steps of these lengths [m] apart, and the texture's extent [texel].
fn spread(n: usize, length: impl Fn(usize) -> f64) -> (Vec<f32>, usize) {
    let mut places = vec![4.0_f32];
    for step in 0..n {
        // The back of the head is coarse: its columns are wide.
        let size = (length(step) * 1e3).min(12.0) / TEXEL;
        places.push(places[step] + size.max(1.0) as f32);
    }
    let extent = (places[n] + 5.0) as usize;
    (places, extent)
}

/// The smooth head without features.
fn skull(azimuth_deg: f64, z: f64) -> Point3<f64> {
    let [front, back, half_width] = profile(z);
    let middle = back + (front - back) * 0.46;
    let (sine, cosine) = (azimuth_deg * PI / 180.0).sin_cos();
    let round = |it: f64| it.abs().powf(0.9).copysign(it);
    let reach = if cosine > 0.0 { front - middle } else { middle - back };
    Point3::new(middle + reach * round(cosine), half_width * round(sine), z)
}

/// Front, back and half width at a height, by cubic interpolation.
fn profile(z: f64) -> [f64; 3] {
    let last = PROFILE.len() - 2;
    let place = PROFILE.iter().position(|row| row[0] < z).unwrap_or(last + 1).clamp(1, last + 1) - 1;
    let row = |i: usize| PROFILE[i.min(last + 1)];
    let [before, a, b, after] = [row(place.saturating_sub(1)), row(place), row(place + 1), row(place + 2)];
    let span = b[0] - a[0];
    let t = (z - a[0]) / span;
    [1, 2, 3].map(|of| {
        let slope = |from: [f64; 4], to: [f64; 4]| (to[of] - from[of]) / (to[0] - from[0]) * span;
        let (m, n) = (slope(before, b), slope(a, after));
        let (t2, t3) = (t * t, t * t * t);
        a[of] * (2.0 * t3 - 3.0 * t2 + 1.0) + m * (t3 - 2.0 * t2 + t) + b[of] * (3.0 * t2 - 2.0 * t3) + n * (t3 - t2)
    })
}

/// exp(−(d/σ)²/2)
pub(super) fn bell(d: f64, sigma: f64) -> f64 {
    (-0.5 * (d / sigma).powi(2)).exp()
}

/// From 0 to 1 where `x` does, with slopes 0 at both ends.
pub(super) fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

/// How far the nose stands out at a height, and how wide it is there [mm].
fn nose(z: f64) -> [f64; 2] {
    const RIDGE: [[f64; 3]; 10] = [
        [34.0, 0.0, 9.0],
        [24.0, 2.0, 8.0],
        [12.0, 6.5, 6.5],
        [0.0, 12.5, 6.5],
        [-12.0, 19.5, 7.5],
        [-20.0, 24.0, 8.5],
        [-26.0, 23.0, 9.0],
        [-32.0, 13.0, 9.0],
        [-37.0, 3.0, 8.0],
        [-41.0, 0.0, 8.0],
    ];
    let Some(place) = RIDGE.windows(2).position(|it| it[1][0] <= z && z <= it[0][0]) else { return [0.0, 8.0] };
    let (a, b) = (RIDGE[place], RIDGE[place + 1]);
    let t = (a[0] - z) / (a[0] - b[0]);
    [1, 2].map(|of| a[of] + (b[of] - a[of]) * t)
}

/// How far a point of the skull is pushed by the features of the face.
fn features(p: &Point3<f64>) -> Vector3<f64> {
    let side = p.y.abs();
    let ahead = smooth((p.x - 5.0) / 45.0);
    let outward = Vector3::new(p.x * 0.6, p.y, 0.0).try_normalize(1e-9).unwrap_or(Vector3::x());
    let [ridge, wide] = nose(p.z);
    let wings = 8.5 * bell(side - 12.5, 4.2) * bell(p.z + 27.5, 4.2);
    let mouth = 1.0 - smooth((side - 14.0) / 15.0);
    let upper = 4.2 * bell(p.z - SLIT - 5.0, 3.4) * mouth;
    let lower = 4.8 * bell(p.z - SLIT + 5.4, 3.6) * (1.0 - smooth((side - 12.0) / 14.0));
    let parting = -2.2 * bell(p.z - SLIT, 1.5) * (1.0 - smooth((side - 20.0) / 8.0));
    let forward = ridge * (-(side / wide).powf(2.6)).exp() + wings + upper + lower + parting
        - 9.0 * bell(side - 30.0, 13.5) * bell(p.z - 9.0, 8.5)
        + 4.8 * bell(side - 31.0, 9.0) * bell(p.z - 8.5, 6.0)
        + 3.2 * bell(side - 26.0, 17.0) * bell(p.z - 25.0, 5.5)
        - 1.6 * bell(side, 6.0) * bell(p.z - 25.0, 7.0)
        + 4.5 * bell(side, 23.0) * bell(p.z + 57.0, 15.0)
        - 1.3 * bell(side, 2.6) * bell(p.z + 47.0, 6.0)
        - 3.8 * bell(side, 15.0) * bell(p.z + 77.5, 4.5)
        + 6.5 * bell(side, 15.0) * bell(p.z + 96.0, 9.5)
        - 1.6 * bell(side - 24.0 - (p.z + 38.0) * -0.35, 3.0) * bell(p.z + 44.0, 11.0);
    let aside = 3.8 * bell(side - 48.0, 14.0) * bell(p.z + 14.0, 11.0)
        - 3.0 * bell(side - 45.0, 15.0) * bell(p.z + 48.0, 15.0)
        - 2.5 * bell(side - 66.0, 12.0) * bell(p.z - 34.0, 16.0) * ahead;
    let ear = bell(p.x + 10.0 + 0.12 * p.z, 7.5) * (-((p.z - 1.0) / 29.0).powi(4)).exp() * smooth((side - 45.0) / 20.0);
    let hollow = bell(p.x + 6.0, 4.0) * bell(p.z - 2.0, 11.0) * smooth((side - 45.0) / 20.0);
    Vector3::x() * forward * ahead
        + outward * (aside * ahead)
        + Vector3::new(-0.35, p.y.signum(), 0.0) * (17.0 * ear - 7.0 * hollow)
}
