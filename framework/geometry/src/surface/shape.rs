//! A shape with nearest-point queries: triangles, or points with the plane around each.
//!
//! The nearest place on a triangle mesh is exact. A cloud is a surface with gaps between its points: there the plane
//! of the nearest point counts, as far as the next points are, and beyond that the point itself. A nearest place on an
//! open edge is marked: a distance to an edge says nothing about the shape.
//!
//! Source of the nearest place of a triangle: C. Ericson, *Real-Time Collision Detection*, 2005, section 5.1.5. The tree of boxes is split at the median of the longest side.

use std::collections::HashMap;

use nalgebra::{Point3, Vector3};

use super::{SurfacePoint, find_normals};

/// Items of a leaf of the tree.
const LEAF: usize = 6;
/// Points whose distance to the next is measured, at most.
const SPACINGS: usize = 2000;
/// A cloud is a surface so many times the distance between neighbours around each point: of points that lie anywhere, two in a thousand places are farther from the next one, exp(-π (3 · 0.47)²) [–].
const REACH: f64 = 3.0;
/// Across the normal over the whole distance, of what lies beside an edge and not straight above it [–].
const BESIDE: f64 = 1e-3;
/// Neighbours within this many times the distance between points give the normals of a cloud that has none: some 17 where points lie anywhere [–].
const NORMAL_RADIUS: f64 = 5.0;

/// A triangle mesh or point cloud for nearest-point queries.
#[derive(Debug, Clone)]
pub struct Shape {
    points: Vec<Point3<f64>>,
    /// By point; zero where it is not known.
    normals: Vec<Vector3<f64>>,
    triangles: Vec<[u32; 3]>,
    /// By triangle: bits 0 to 2 for edges after corner 0, 1, 2 that no other triangle has, bits 3 to 5 for corners on such an edge.
    open: Vec<u8>,
    spacing: f64,
    /// Triangles or points, in the order of the tree's leaves.
    order: Vec<u32>,
    nodes: Vec<TreeNode>,
}

#[derive(Debug, Clone)]
struct TreeNode {
    low: Point3<f64>,
    high: Point3<f64>,
    /// Of a leaf: items in `order`. Else the children are the next node and `from`.
    from: u32,
    until: u32,
}

/// The nearest place on a shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearest {
    /// Position [m].
    pub place: Point3<f64>,
    /// Unit normal there; zero where it is unknown [–].
    pub normal: Vector3<f64>,
    /// Whether it lies on an open edge.
    pub is_edge: bool,
}

impl Shape {
    /// A shape from points with normals (zero where unknown), or from triangles between the points; `None` without
    /// points. Missing normals of a cloud are estimated from its neighbours, towards `viewpoint`.
    pub fn new(
        points: Vec<Point3<f64>>,
        mut normals: Vec<Vector3<f64>>,
        triangles: Vec<[u32; 3]>,
        viewpoint: &Point3<f64>,
    ) -> Option<Shape> {
        points.first()?;
        normals.resize(points.len(), Vector3::zeros());
        let mut shape =
            Shape { points, normals, triangles, open: Vec::new(), spacing: 0.0, order: Vec::new(), nodes: Vec::new() };
        shape.open = shape.open_edges();
        let n_items = if shape.is_mesh() { shape.triangles.len() } else { shape.points.len() };
        shape.order = (0..n_items as u32).collect();
        shape.build(0, n_items);
        shape.spacing = shape.distance_between_points();
        if !shape.is_mesh() && shape.normals.contains(&Vector3::zeros()) {
            let covariance = nalgebra::Matrix3::identity();
            let oriented = shape.points.iter().zip(&shape.normals);
            let mut points: Vec<SurfacePoint> = oriented
                .map(|(position, normal)| SurfacePoint { position: *position, covariance, normal: *normal })
                .collect();
            find_normals(&mut points, NORMAL_RADIUS * shape.spacing.max(f64::MIN_POSITIVE), viewpoint);
            shape.normals = points.into_iter().map(|it| it.normal).collect();
        }
        Some(shape)
    }

    /// Whether it is a triangle mesh.
    pub fn is_mesh(&self) -> bool {
        !self.triangles.is_empty()
    }

    /// Points, or vertices of the mesh [m].
    pub fn points(&self) -> &[Point3<f64>] {
        &self.points
    }

    /// Unit normal of each point, or zero [–].
    pub fn normals(&self) -> &[Vector3<f64>] {
        &self.normals
    }

    /// Vertex indices of each triangle; empty for a cloud.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Median distance between neighbouring points, or length of an edge [m].
    pub fn spacing(&self) -> f64 {
        self.spacing
    }

    /// Diagonal of the bounding box [m].
    pub fn extent(&self) -> f64 {
        self.nodes.first().map_or(0.0, |it| (it.high - it.low).norm())
    }

    /// Orients the normals of a cloud like those of the nearest places of `towards`. Returns whether any normal there is known.
    pub fn turn_normals(&mut self, towards: &Shape) -> bool {
        let mut n_known = 0;
        for (point, normal) in self.points.iter().zip(&mut self.normals) {
            if let Some(nearest) = towards.nearest(point).filter(|it| it.normal != Vector3::zeros()) {
                n_known += 1;
                if normal.dot(&nearest.normal) < 0.0 {
                    *normal = -*normal;
                }
            }
        }
        n_known > 0
    }

    /// The same points without normals.
    pub fn without_sides(&self) -> Shape {
        let mut points = self.clone();
        if self.is_mesh() {
            points.triangles = Vec::new();
            points.open = Vec::new();
            points.nodes = Vec::new();
            points.order = (0..points.points.len() as u32).collect();
            points.build(0, points.order.len());
        }
        points.normals.fill(Vector3::zeros());
        points
    }

    /// `n` samples evenly spread over a mesh by area, or all or some points of a cloud; the same ones each time.
    pub fn samples(&self, n: usize) -> Vec<SurfacePoint> {
        let covariance = nalgebra::Matrix3::identity();
        if !self.is_mesh() {
            let step = self.points.len().div_ceil(n.max(1));
            let some = self.points.iter().zip(&self.normals).step_by(step);
            return some.map(|(at, normal)| SurfacePoint { position: *at, covariance, normal: *normal }).collect();
        }
        let area = |it: &[u32; 3]| {
            let [a, b, c] = self.corners(it);
            (b - a).cross(&(c - a)).norm() / 2.0
        };
        let areas: Vec<f64> = self.triangles.iter().map(area).collect();
        let each = areas.iter().sum::<f64>() / n.max(1) as f64;
        let (mut sum, mut samples) = (0.0, Vec::with_capacity(n));
        for (triangle, area) in self.triangles.iter().zip(areas) {
            let [a, b, c] = self.corners(triangle);
            let normal = self.normal_of(triangle);
            let until = sum + area;
            while ((samples.len() as f64) + 0.5) * each < until {
                // The two golden numbers of the plane spread places evenly: M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
                let number = samples.len() as f64 + 0.5;
                let [mut s, mut t] = [0.754_877_666_246_693, 0.569_840_290_998_053_3].map(|it| (number * it).fract());
                if s + t > 1.0 {
                    (s, t) = (1.0 - s, 1.0 - t);
                }
                samples.push(SurfacePoint { position: a + (b - a) * s + (c - a) * t, covariance, normal });
            }
            sum = until;
        }
        samples
    }

    fn corners(&self, triangle: &[u32; 3]) -> [Point3<f64>; 3] {
        triangle.map(|it| self.points[it as usize])
    }

    /// Of the plane of a triangle, to the side of its corners' normals where these are known.
    fn normal_of(&self, triangle: &[u32; 3]) -> Vector3<f64> {
        let [a, b, c] = self.corners(triangle);
        let normal = (b - a).cross(&(c - a)).try_normalize(1e-300).unwrap_or_else(Vector3::zeros);
        let stated: Vector3<f64> = triangle.iter().map(|it| self.normals[*it as usize]).sum();
        if normal.dot(&stated) < 0.0 { -normal } else { normal }
    }

    fn open_edges(&self) -> Vec<u8> {
        let ends = |triangle: &[u32; 3], it: usize| {
            let (a, b) = (triangle[it], triangle[(it + 1) % 3]);
            (a.min(b), a.max(b))
        };
        // Corners in one place count as one: files of triangles each with corners of its own.
        let mut first: HashMap<[u64; 3], u32> = HashMap::new();
        let same: Vec<u32> = if self.is_mesh() {
            let bits = |it: &Point3<f64>| [it.x, it.y, it.z].map(|it| (it + 0.0).to_bits());
            (0..).zip(&self.points).map(|(at, it)| *first.entry(bits(it)).or_insert(at)).collect()
        } else {
            Vec::new()
        };
        let joined = |it: &[u32; 3]| it.map(|it| same[it as usize]);
        let mut counts: HashMap<(u32, u32), u32> = HashMap::with_capacity(2 * self.triangles.len());
        for triangle in self.triangles.iter().map(joined) {
            (0..3).for_each(|it| *counts.entry(ends(&triangle, it)).or_default() += 1);
        }
        let mut is_open = vec![false; if self.is_mesh() { self.points.len() } else { 0 }];
        for ((a, b), _) in counts.iter().filter(|it| *it.1 == 1) {
            is_open[*a as usize] = true;
            is_open[*b as usize] = true;
        }
        let bits = |triangle: [u32; 3]| {
            let edge = |it: usize| u8::from(counts[&ends(&triangle, it)] == 1) << it;
            let corner = |it: usize| u8::from(is_open[triangle[it] as usize]) << (3 + it);
            (0..3).map(|it| edge(it) | corner(it)).sum()
        };
        self.triangles.iter().map(joined).map(bits).collect()
    }

    fn box_of(&self, item: u32) -> (Point3<f64>, Point3<f64>) {
        if !self.is_mesh() {
            return (self.points[item as usize], self.points[item as usize]);
        }
        let [a, b, c] = self.corners(&self.triangles[item as usize]);
        (a.inf(&b).inf(&c), a.sup(&b).sup(&c))
    }

    fn build(&mut self, from: usize, until: usize) {
        let (mut low, mut high) = (Point3::from([f64::INFINITY; 3]), Point3::from([f64::NEG_INFINITY; 3]));
        for item in &self.order[from..until] {
            let (least, most) = self.box_of(*item);
            (low, high) = (low.inf(&least), high.sup(&most));
        }
        let number = self.nodes.len();
        self.nodes.push(TreeNode { low, high, from: from as u32, until: until as u32 });
        if until - from <= LEAF {
            return;
        }
        let axis = (high - low).imax();
        let middle = from.midpoint(until);
        let mut part = self.order[from..until].to_vec();
        let centre = |it: &u32| {
            let (low, high) = self.box_of(*it);
            low[axis] + high[axis]
        };
        part.select_nth_unstable_by(middle - from, |a, b| centre(a).total_cmp(&centre(b)).then(a.cmp(b)));
        self.order[from..until].copy_from_slice(&part);
        self.build(from, middle);
        self.nodes[number].from = self.nodes.len() as u32;
        self.nodes[number].until = 0;
        self.build(middle, until);
    }

    /// The nearest place; `None` for a point that is not finite.
    pub fn nearest(&self, point: &Point3<f64>) -> Option<Nearest> {
        self.search(point, f64::INFINITY, |_| true).map(|it| self.at(point, it))
    }

    /// The nearest place, if at most `most` away [m].
    pub fn nearest_within(&self, point: &Point3<f64>, most: f64) -> Option<Nearest> {
        // The plane of a point may be nearer than the point.
        let beyond = if self.is_mesh() { 0.0 } else { REACH * self.spacing };
        let most_squared = (most * most + beyond * beyond) * (1.0 + 1e-12);
        let nearest = self.search(point, most_squared, |_| true).map(|it| self.at(point, it))?;
        ((nearest.place - point).norm() <= most * (1.0 + 1e-12)).then_some(nearest)
    }

    /// The item whose place is nearest.
    fn search(&self, point: &Point3<f64>, most_squared: f64, counts: impl Fn(u32) -> bool) -> Option<u32> {
        let (mut best, mut least) = (None, most_squared);
        let mut open = vec![(0_u32, self.box_distance(0, point))];
        while let Some((number, squared)) = open.pop() {
            // What is not a number is not nearer either.
            if squared.is_nan() || squared > least {
                continue;
            }
            let node = &self.nodes[number as usize];
            if node.until > 0 {
                for item in self.order[node.from as usize..node.until as usize].iter().filter(|it| counts(**it)) {
                    let place = if self.is_mesh() {
                        nearest_of(&self.corners(&self.triangles[*item as usize]), point).0
                    } else {
                        self.points[*item as usize]
                    };
                    let squared = (place - point).norm_squared();
                    if squared < least || squared == least && best.is_none() {
                        (best, least) = (Some(*item), squared);
                    }
                }
                continue;
            }
            let children = [number + 1, node.from].map(|it| (it, self.box_distance(it as usize, point)));
            let [near, far] = if children[0].1 <= children[1].1 { children } else { [children[1], children[0]] };
            open.extend([far, near]);
        }
        best
    }

    fn box_distance(&self, node: usize, point: &Point3<f64>) -> f64 {
        let TreeNode { low, high, .. } = &self.nodes[node];
        (0..3).map(|it| (low[it] - point[it]).max(point[it] - high[it]).max(0.0).powi(2)).sum()
    }

    fn at(&self, point: &Point3<f64>, item: u32) -> Nearest {
        let number = item as usize;
        if self.is_mesh() {
            let triangle = &self.triangles[number];
            let (place, on) = nearest_of(&self.corners(triangle), point);
            let (normal, off) = (self.normal_of(triangle), point - place);
            // Straight above an edge is not beside it.
            let is_beside = (off - normal * normal.dot(&off)).norm() > BESIDE * off.norm();
            return Nearest { place, normal, is_edge: on & self.open[number] != 0 && is_beside };
        }
        let (own, normal) = (self.points[number], self.normals[number]);
        let foot = point - normal * normal.dot(&(point - own));
        let is_beside = normal == Vector3::zeros() || (foot - own).norm() > REACH * self.spacing;
        Nearest { place: if is_beside { own } else { foot }, normal, is_edge: is_beside }
    }

    fn distance_between_points(&self) -> f64 {
        let mut distances: Vec<f64> = if self.is_mesh() {
            let step = self.triangles.len().div_ceil(SPACINGS);
            let some = self.triangles.iter().step_by(step).map(|it| self.corners(it));
            some.flat_map(|[a, b, c]| [(b - a).norm(), (c - b).norm(), (a - c).norm()]).collect()
        } else {
            let step = self.points.len().div_ceil(SPACINGS);
            let one = |it: usize| {
                let point = &self.points[it];
                // Other points in the same place are no neighbours.
                let other = self.search(point, f64::INFINITY, |it| self.points[it as usize] != *point)?;
                Some((self.points[other as usize] - point).norm())
            };
            (0..self.points.len()).step_by(step).filter_map(one).collect()
        };
        distances.sort_by(f64::total_cmp);
        distances.get(distances.len() / 2).copied().unwrap_or(0.0)
    }
}

/// The nearest place of a triangle, and where it lies: bits 0 to 2 for the edge after corner 0, 1, 2, bits 3 to 5 for a corner, 0 for inside.
fn nearest_of([a, b, c]: &[Point3<f64>; 3], point: &Point3<f64>) -> (Point3<f64>, u8) {
    let (ab, ac, ap) = (b - a, c - a, point - a);
    let (d1, d2) = (ab.dot(&ap), ac.dot(&ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return (*a, 8);
    }
    let bp = point - b;
    let (d3, d4) = (ab.dot(&bp), ac.dot(&bp));
    if d3 >= 0.0 && d4 <= d3 {
        return (*b, 16);
    }
    let of_c = d1 * d4 - d3 * d2;
    if of_c <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (a + ab * (d1 / (d1 - d3)), 1);
    }
    let cp = point - c;
    let (d5, d6) = (ab.dot(&cp), ac.dot(&cp));
    if d6 >= 0.0 && d5 <= d6 {
        return (*c, 32);
    }
    let of_b = d5 * d2 - d1 * d6;
    if of_b <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (a + ac * (d2 / (d2 - d6)), 4);
    }
    let of_a = d3 * d6 - d5 * d4;
    if of_a <= 0.0 && d4 >= d3 && d5 >= d6 {
        return (b + (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6))), 2);
    }
    let sum = of_a + of_b + of_c;
    (a + ab * (of_b / sum) + ac * (of_c / sum), 0)
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;

    fn anywhere(random: &mut Random) -> Point3<f64> {
        Point3::from([0; 3].map(|_| random.uniform_in(-1.0, 1.0)))
    }

    #[test]
    fn the_nearest_place_is_nearer_than_a_thousand_others() {
        let mut random = Random::new(4);
        for _ in 0..40 {
            let points: Vec<Point3<f64>> = (0..60).map(|_| anywhere(&mut random)).collect();
            let triangles: Vec<[u32; 3]> = (0..20).map(|it| [3 * it, 3 * it + 1, 3 * it + 2]).collect();
            let shape = Shape::new(points, Vec::new(), triangles, &Point3::origin()).unwrap();
            let point = anywhere(&mut random) * 2.0;
            let nearest = shape.nearest(&point).unwrap();
            let least = (nearest.place - point).norm();
            let others = shape.samples(1000);
            assert_eq!(others.len(), 1000);
            let next = others.iter().map(|it| (it.position - point).norm()).fold(f64::INFINITY, f64::min);
            assert!(least <= next && next < least + 0.3, "{least} {next}");
            // It lies on the shape itself.
            assert!((shape.nearest(&nearest.place).unwrap().place - nearest.place).norm() < 1e-12);
            assert_eq!(shape.nearest_within(&point, 0.99 * least), None);
        }
        assert_eq!(Shape::new(Vec::new(), Vec::new(), Vec::new(), &Point3::origin()).map(|it| it.extent()), None);
    }

    /// Points of the plane z = 0 over a square of 1 m, 11 × 11, or as two triangles.
    fn square(is_mesh: bool) -> Shape {
        let n = if is_mesh { 2 } else { 11 };
        let place = |it: usize| Point3::new((it % n) as f64 / (n - 1) as f64, (it / n) as f64 / (n - 1) as f64, 0.0);
        let triangles = if is_mesh { vec![[0, 1, 3], [0, 3, 2]] } else { Vec::new() };
        let points = (0..n * n).map(place).collect();
        Shape::new(points, Vec::new(), triangles, &Point3::new(0.5, 0.5, 3.0)).unwrap()
    }

    #[test]
    fn over_a_square_the_distance_is_the_height_and_beside_it_is_an_edge() {
        for is_mesh in [true, false] {
            let shape = square(is_mesh);
            let over = shape.nearest(&Point3::new(0.53, 0.46, 0.2)).unwrap();
            assert!((over.place - Point3::new(0.53, 0.46, 0.0)).norm() < 1e-9 && !over.is_edge, "{over:?}");
            assert!((over.normal - Vector3::z()).norm() < 1e-9, "{over:?}");
            assert!(shape.nearest(&Point3::new(1.3, 0.5, 0.1)).unwrap().is_edge, "{is_mesh}");
            assert!(shape.nearest(&Point3::new(f64::NAN, 0.5, 0.1)).is_none());
        }
        assert!((square(false).spacing() - 0.1).abs() < 1e-9);
    }

    #[test]
    fn triangles_with_corners_of_their_own_have_no_edge_between_them() {
        let corner = |x: f64, y: f64| Point3::new(x, y, 0.0);
        let points = vec![
            corner(0.0, 0.0),
            corner(1.0, 0.0),
            corner(1.0, 1.0),
            corner(0.0, 0.0),
            corner(1.0, 1.0),
            corner(0.0, 1.0),
        ];
        let shape = Shape::new(points, Vec::new(), vec![[0, 1, 2], [3, 4, 5]], &Point3::origin()).unwrap();
        assert!(!shape.nearest(&Point3::new(0.5, 0.5, 0.3)).unwrap().is_edge);
        assert!(shape.nearest(&Point3::new(0.5, -0.1, 0.3)).unwrap().is_edge);
    }
}
