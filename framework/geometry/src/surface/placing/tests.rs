//! Shapes laid on shapes whose place is known.

use foveate_estimation::random::Random;

use super::*;

/// A head of sorts without a symmetry, its points 1 of 0.1 m, seen from all sides or from the front alone.
fn head(n: usize, seed: u64, noise: f64, is_seen: impl Fn(&Vector3<f64>) -> bool) -> Vec<Point3<f64>> {
    let mut random = Random::new(seed);
    let mut points = Vec::new();
    while points.len() < n {
        let way = Vector3::from([0; 3].map(|_| random.normal())).normalize();
        let bump = |at: [f64; 3], height: f64, width: f64| {
            height * (-(way - Vector3::from(at).normalize()).norm_squared() / (width * width)).exp()
        };
        let radius = 0.1
            + 0.03 * way.z.abs()
            + bump([0.0, -1.0, 0.1], 0.03, 0.25)
            + bump([1.0, 0.1, 0.3], 0.015, 0.2)
            + bump([-0.3, -0.8, 0.7], -0.01, 0.3);
        if is_seen(&way) {
            points.push(Point3::from(way * (radius + noise * random.normal())));
        }
    }
    points
}

fn shape(points: Vec<Point3<f64>>, inside: Point3<f64>) -> Shape {
    let mut shape = Shape::new(points, Vec::new(), Vec::new(), &inside).unwrap();
    shape.turn_outwards(&inside);
    shape
}

impl Shape {
    fn turn_outwards(&mut self, inside: &Point3<f64>) {
        let points = self.points().to_vec();
        let normals = self.normals().to_vec();
        let turned = points.iter().zip(normals).map(|(at, it)| if it.dot(&(at - inside)) < 0.0 { -it } else { it });
        *self = Shape::new(points.clone(), turned.collect(), Vec::new(), inside).unwrap();
    }
}

/// Places a view of the front of a head on the whole head, from another pose each time; the largest error of a point.
#[track_caller]
fn check(scale: f64, with_scale: bool, bound: f64) {
    let b = shape(head(20_000, 1, 0.0, |_| true), Point3::origin());
    for seed in [2, 3] {
        let mut random = Random::new(seed);
        let front = head(6000, seed + 10, 0.0002, |it| it.y < -0.1);
        let axis = Vector3::from([0; 3].map(|_| random.normal()));
        let rotation = UnitQuaternion::from_scaled_axis(axis.normalize() * random.uniform_in(0.5, 3.1));
        let shift = Vector3::from([0; 3].map(|_| random.uniform_in(-1.0, 1.0)));
        let a_from_b = Similarity3::from_parts(Translation3::from(shift), rotation, scale);
        let moved: Vec<Point3<f64>> = front.iter().map(|it| a_from_b * it).collect();
        let a = shape(moved, a_from_b * Point3::origin());
        let options = PlacingOptions { scale: with_scale, n_starts: 300, most: f64::INFINITY };
        let found = place(&a, &b, &options).unwrap();
        let error = |it: &Point3<f64>| (found.b_from_a * (a_from_b * it) - it).norm();
        let worst = front.iter().map(error).fold(0.0, f64::max);
        assert!(worst < bound, "seed {seed}: {worst} m, {found:?}");
        assert!((found.b_from_a.scaling() * scale - 1.0).abs() < 0.002 || !with_scale, "{found:?}");
        assert!(found.overlap > 0.85 && found.n_open == 0 && found.other.is_none(), "{found:?}");
    }
}

#[test]
fn a_view_of_the_front_finds_its_place_from_anywhere() {
    check(1.0, false, 2e-4);
}

#[test]
fn a_scale_is_found_with_the_place() {
    check(1.07, true, 4e-4);
}

#[test]
fn a_scale_that_shrinks_a_shape_to_a_spot_is_refused_and_a_place_that_is_one_of_many_says_so() {
    let mut random = Random::new(8);
    // A cloud without a surface beside a sphere, on which nothing but a spot of it can lie.
    let cloud = (0..4000).map(|_| Point3::from(Vector3::from([0; 3].map(|_| random.uniform_in(-0.1, 0.1))))).collect();
    let a = Shape::new(cloud, Vec::new(), Vec::new(), &Point3::new(0.0, 0.0, 5.0)).unwrap().without_sides();
    let b = shape(head(20_000, 1, 0.0, |_| true), Point3::origin());
    let options = PlacingOptions { scale: true, n_starts: 40, most: f64::INFINITY };
    match place(&a, &b, &options) {
        Err(_) => {}
        Ok(found) => assert!(SCALES.contains(&found.b_from_a.scaling()) && found.other.is_some(), "{found:?}"),
    }
}

#[test]
fn small_things_before_a_large_wall_say_how_it_lies() {
    // Points 1 of 3 m of wall, two balls before it, seen from where the wall is 3 m away.
    let room = |seed: u64, half: f64| -> Vec<Point3<f64>> {
        let mut random = Random::new(seed);
        let mut one = || {
            let (x, y) = (random.uniform_in(-half, half), random.uniform_in(-half, half));
            let ball = |at: [f64; 2], radius: f64| {
                let square = radius * radius - (x - at[0]).powi(2) - (y - at[1]).powi(2);
                if square > 0.0 { 2.6 - square.sqrt() } else { 3.0 }
            };
            Point3::new(x, y, ball([0.4, 0.25], 0.2).min(ball([-0.5, 0.1], 0.14)) + 2e-4 * random.normal())
        };
        (0..30_000).map(|_| one()).collect()
    };
    let b = Shape::new(room(1, 1.5), Vec::new(), Vec::new(), &Point3::origin()).unwrap();
    for seed in 2..6 {
        let mut random = Random::new(seed);
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from([0; 3].map(|_| random.uniform_in(-2.0, 2.0))));
        let a_from_b = Isometry3::from_parts(Translation3::new(0.7, -0.4, 1.9), turn);
        let own = room(seed + 10, 1.2);
        let moved = own.iter().map(|it| a_from_b * it).collect();
        let a = Shape::new(moved, Vec::new(), Vec::new(), &(a_from_b * Point3::origin())).unwrap();
        let options = PlacingOptions { scale: false, n_starts: 100, most: f64::INFINITY };
        for a in [a.clone(), a.without_sides()] {
            let found = place(&a, &b, &options).unwrap();
            let error = |it: &Point3<f64>| (found.b_from_a * (a_from_b * it) - it).norm();
            let worst = own.iter().map(error).fold(0.0, f64::max);
            assert!(worst < 2e-3 && found.overlap > 0.95, "seed {seed}: {worst} m, {found:?}");
        }
    }
}

#[test]
fn a_thing_before_a_wall_finds_its_place_on_the_thing_alone_and_the_other_way_round() {
    let b = shape(head(20_000, 1, 0.0, |_| true), Point3::origin());
    let behind = Point3::new(0.0, -3.0, 0.0);
    let mut random = Random::new(4);
    // The front of it, and 1.4 m of the wall behind it: seven points in eight are of the wall.
    let mut scan = head(2500, 24, 2e-4, |it| it.y < -0.1);
    scan.extend((0..17_500).map(|_| {
        Point3::new(random.uniform_in(-0.7, 0.7), 0.2 + 2e-4 * random.normal(), random.uniform_in(-0.7, 0.7))
    }));
    let turn = UnitQuaternion::from_scaled_axis(Vector3::from([0; 3].map(|_| random.uniform_in(-2.0, 2.0))));
    let a_from_b = Isometry3::from_parts(Translation3::new(0.3, 0.2, -0.9), turn);
    let moved = scan.iter().map(|it| a_from_b * it).collect();
    let a = Shape::new(moved, Vec::new(), Vec::new(), &(a_from_b * behind)).unwrap();
    let options = PlacingOptions { scale: false, n_starts: 300, most: f64::INFINITY };
    let check = |found: &Placing, b_from_a: Similarity3<f64>, at: &str| {
        let error = |it: &Point3<f64>| (b_from_a * (a_from_b * it) - it).norm();
        let worst = scan.iter().take(2500).map(error).fold(0.0, f64::max);
        assert!(worst < 4e-4 && found.n_open == 0 && found.other.is_none(), "{at}: {worst} m, {found:?}");
    };
    let found = place(&a, &b, &options).unwrap();
    check(&found, found.b_from_a, "scan on the thing");
    assert!((0.08..0.16).contains(&found.overlap), "{found:?}");
    let found = place(&b, &a, &options).unwrap();
    check(&found, found.b_from_a.inverse(), "thing on the scan");
}

#[test]
fn a_plane_says_that_it_slides_and_shapes_apart_are_refused() {
    let mut random = Random::new(5);
    let mut plane = |n: usize| -> Vec<Point3<f64>> {
        (0..n).map(|_| Point3::new(random.uniform(), random.uniform(), 0.0)).collect()
    };
    let up = Point3::new(0.5, 0.5, 5.0);
    let [a, b] = [plane(2000), plane(9000)].map(|it| Shape::new(it, Vec::new(), Vec::new(), &up).unwrap());
    let options = PlacingOptions { scale: false, n_starts: 20, most: f64::INFINITY };
    assert_eq!(place(&a, &b, &options).unwrap().n_open, 3);
    let few = Shape::new(vec![up; 5], Vec::new(), Vec::new(), &up).unwrap();
    assert_eq!(place(&few, &b, &options).unwrap_err(), PlacingError::TooFewPoints { count: 5, expected: 100 });
}
