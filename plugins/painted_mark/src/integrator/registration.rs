//! Registration of the pictures of several cameras without labels, by voting.
//!
//! The matches are unknown, but true pairs all vote for the same shift of a picture, and false ones for random shifts. First the two cameras that
//! are closest vote on the shift across their epipolar lines; along these a shift is only a change of depth. The places of their pairs then vote for a shift of
//! each further picture, in both directions.

use foveate::geometry::{Camera, Ray, triangulate_rays};
use nalgebra::{Isometry3, Point2, Point3, Translation3, UnitQuaternion, Vector2, Vector3};

use super::matching::DotView;

/// Width of the bins of votes [px].
const BIN: f64 = 2.0;
/// Largest distance between the lines of sight of a pair of dots of the first two cameras [px].
const PASS: f64 = 2.5;

/// Rotates the cameras by up to `reach` px so that their dots match; all marks lie in the ball `ball`. A camera with fewer than `least` votes does not
/// see the surface: its dots are removed. Returns whether `n_views` cameras do.
pub(super) fn register(
    views: &mut [DotView],
    ball: (Point3<f64>, f64),
    reach: f64,
    least: usize,
    n_views: usize,
) -> bool {
    // Nor does one with fewer dots than that.
    views.iter_mut().filter(|it| it.dots.len() < least).for_each(|it| it.dots.clear());
    let Some([a, b]) = closest_pair(views) else { return false };
    let across = votes_across(&views[a], &views[b], ball, reach);
    let Some(shift) = peak(&across.iter().map(|it| it.0).collect::<Vec<_>>(), reach, least) else { return false };
    // Every pair asks for a shift along its own normal; these are nearly parallel.
    let normals = across.iter().filter(|it| (it.0 - shift).abs() < BIN).fold(Vector2::zeros(), |sum, it| sum + it.1);
    views[b].camera = shifted(&views[b].camera, &(normals.normalize() * shift), &ball.0);
    let mut places = places_of(&views[a], &views[b], ball);
    // A turn of the first two against each other along their lines has moved all places in depth.
    let reach = 2.0 * reach;
    let mut is_placed: Vec<bool> = (0..views.len()).map(|it| it == a || it == b).collect();
    for index in 0..views.len() {
        if std::mem::replace(&mut is_placed[index], true) {
            continue;
        }
        let view = &mut views[index];
        let offsets = offsets(view, &places, reach);
        let all: Vec<Vector2<f64>> = offsets.iter().map(|it| it.1).collect();
        let Some(shift) = peak_2d(&all, reach, least) else {
            view.dots.clear();
            continue;
        };
        view.camera = shifted(&view.camera, &shift, &ball.0);
        // From here on only places that this camera sees too.
        let mut agreeing: Vec<usize> =
            offsets.iter().filter(|it| (it.1 - shift).norm() < 2.0 * BIN).map(|it| it.0).collect();
        agreeing.dedup();
        places = agreeing.iter().map(|it| places[*it]).collect();
    }
    views.iter().filter(|it| !it.dots.is_empty()).count() >= n_views
}

/// The two cameras with dots whose viewing directions differ least.
fn closest_pair(views: &[DotView]) -> Option<[usize; 2]> {
    let axis = |view: &DotView| Some(view.camera.ray(view.dots.first()?)?.direction.into_inner());
    let pairs = (0..views.len()).flat_map(|b| (0..b).map(move |a| [a, b]));
    let angle = |pair: &[usize; 2]| Some(axis(&views[pair[0]])?.angle(&axis(&views[pair[1]])?));
    let known = pairs.filter_map(|pair| Some((pair, angle(&pair)?)));
    known.min_by(|a, b| a.1.total_cmp(&b.1)).map(|it| it.0)
}

/// For each pair of dots whose place may lie in the ball: the shift of the second dot across its epipolar line [px], and its direction.
fn votes_across(a: &DotView, b: &DotView, ball: (Point3<f64>, f64), reach: f64) -> Vec<(f64, Vector2<f64>)> {
    let (middle, radius) = ball;
    let mut votes = Vec::new();
    for dot in &a.dots {
        let Some(ray) = a.camera.ray(dot) else { continue };
        let depth = ray.depth_of(&middle);
        let ends = [depth - radius, depth + radius].map(|it| b.camera.project(&ray.at(it)));
        let [Some(near), Some(far)] = ends else { continue };
        let line = far - near;
        let length = line.norm();
        if length < 1.0 {
            continue;
        }
        let along = line / length;
        let normal = Vector2::new(-along.y, along.x);
        // The normals of all pairs point to the same side.
        let normal = if normal.y < 0.0 { -normal } else { normal };
        for other in &b.dots {
            let from = other - near;
            let across = from.dot(&normal);
            if across.abs() < reach && (0.0..length).contains(&from.dot(&along)) {
                votes.push((across, normal));
            }
        }
    }
    votes
}

/// The places of all pairs of dots that agree, in the ball.
fn places_of(a: &DotView, b: &DotView, ball: (Point3<f64>, f64)) -> Vec<Point3<f64>> {
    let rays = |view: &DotView| -> Vec<Ray> { view.dots.iter().filter_map(|it| view.camera.ray(it)).collect() };
    let per_metre = b.camera.intrinsics.focal[0] / (b.camera.centre() - ball.0).norm();
    let (ones, others) = (rays(a), rays(b));
    let mut places = Vec::new();
    for one in &ones {
        for other in &others {
            let place = triangulate_rays(&[*one, *other]).filter(|it| (it - ball.0).norm() < ball.1);
            places.extend(place.filter(|it| (one.distance_to(it) + other.distance_to(it)) * per_metre < PASS));
        }
    }
    places
}

/// By place: how far each dot of a view lies from where the place is seen [px].
fn offsets(view: &DotView, places: &[Point3<f64>], reach: f64) -> Vec<(usize, Vector2<f64>)> {
    let mut offsets = Vec::new();
    for (index, place) in places.iter().enumerate() {
        let Some(expected) = view.camera.project(place) else { continue };
        let near = view.dots.iter().map(|it| it - expected).filter(|it| it.norm() < reach);
        offsets.extend(near.map(|it| (index, it)));
    }
    offsets
}

/// The mean of the largest cluster of votes, if it has at least `least` of them.
fn peak(votes: &[f64], reach: f64, least: usize) -> Option<f64> {
    let flat: Vec<Vector2<f64>> = votes.iter().map(|it| Vector2::new(*it, 0.0)).collect();
    peak_2d(&flat, reach, least).map(|it| it.x)
}

fn peak_2d(votes: &[Vector2<f64>], reach: f64, least: usize) -> Option<Vector2<f64>> {
    let side = 2 * (reach / BIN).ceil() as i64 + 3;
    let bin = |it: f64| ((it + reach) / BIN) as i64 + 1;
    let mut bins = vec![0_usize; (side * side) as usize];
    for vote in votes {
        bins[(bin(vote.y) * side + bin(vote.x)) as usize] += 1;
    }
    // Votes of one shift may lie on both sides of a bin's border.
    let around = |place: i64| -> usize {
        [0, 1, side, side + 1].iter().map(|it| bins.get((place + it) as usize).copied().unwrap_or(0)).sum()
    };
    let best = (0..side * side).max_by_key(|it| around(*it))?;
    let corner = Vector2::new((best % side) as f64, (best / side) as f64) * BIN - Vector2::repeat(reach);
    let inside = |it: &&Vector2<f64>| (*it - corner).abs().max() <= BIN;
    let (count, sum) = votes.iter().filter(inside).fold((0, Vector2::zeros()), |(n, sum), it| (n + 1, sum + it));
    (count >= least).then(|| sum / count as f64)
}

/// The camera rotated about its centre so that the view of the ball's middle shifts by `shift` px.
fn shifted(camera: &Camera, shift: &Vector2<f64>, middle: &Point3<f64>) -> Camera {
    let Some(pixel) = camera.project(middle) else { return camera.clone() };
    let direction = |pixel: &Point2<f64>| camera.ray(pixel).map(|it| it.direction.into_inner());
    let (Some(from), Some(to)) = (direction(&pixel), direction(&(pixel + shift))) else { return camera.clone() };
    // What lay along `from` in the world shall lie where `to` was.
    let turn = UnitQuaternion::rotation_between(&from, &to).unwrap_or_else(UnitQuaternion::identity);
    let centre: Vector3<f64> = camera.centre().coords;
    let change = Translation3::from(centre)
        * Isometry3::from_parts(Translation3::identity(), turn)
        * Translation3::from(-centre);
    Camera { camera_from_world: camera.camera_from_world * change, ..camera.clone() }
}

#[cfg(test)]
mod tests {
    use foveate::estimation::Random;

    use super::*;
    use crate::integrator::tests::{Scene, marks_on_a_face};

    /// Views of a face by heads that are off by that many pixels, a part of the marks hidden from each, and a few dots that are none.
    fn views(off: [[f64; 2]; 4]) -> Vec<DotView> {
        let (marks, scene) = (marks_on_a_face(), Scene::new(0.0));
        let mut random = Random::new(8);
        let ball = Point3::new(0.0, 0.05, 1.6);
        let view = |(camera, off): (&Camera, [f64; 2])| {
            let mut dots: Vec<Point2<f64>> =
                marks.iter().filter(|_| random.uniform() < 0.8).map(|it| camera.project(it).unwrap()).collect();
            dots.extend((0..8).map(|_| Point2::new(random.uniform() * 640.0, random.uniform() * 480.0)));
            DotView { camera: shifted(camera, &Vector2::from(off), &ball), dots }
        };
        scene.cameras.iter().zip(off).map(view).collect()
    }

    #[test]
    fn pictures_that_are_far_off_each_other_are_brought_together() {
        let off = [[9.0, -14.0], [-12.0, 6.0], [3.0, 15.0], [-8.0, -10.0]];
        let mut views = views(off);
        let ball = (Point3::new(0.0, 0.05, 1.6), 0.25);
        assert!(register(&mut views, ball, 30.0, 15, 3));
        let marks = marks_on_a_face();
        let dots_near = |views: &[DotView]| {
            let options = super::super::matching::MatchOptions { ball, tolerance: 3.0, views: 3 };
            super::super::matching::match_dots(views, &options)
        };
        let found = dots_near(&views);
        // The whole face may be off by what all heads are off together.
        assert!(found.len() > 50, "{} of {}", found.len(), marks.len());
        let before = dots_near(&self::views(off));
        assert!(before.len() < 40, "without it: {}", before.len());
    }

    #[test]
    fn a_camera_that_does_not_see_the_surface_does_not_keep_the_others_from_it() {
        let ball = (Point3::new(0.0, 0.05, 1.6), 0.25);
        for blind in 0..4 {
            let mut views = views([[9.0, -14.0], [-12.0, 6.0], [3.0, 15.0], [-8.0, -10.0]]);
            views[blind].dots.truncate(if blind < 2 { 0 } else { 16 });
            assert!(register(&mut views, ball, 30.0, 15, 3), "without camera {blind}");
            assert!(views[blind].dots.is_empty());
            let options = super::super::matching::MatchOptions { ball, tolerance: 3.0, views: 3 };
            let found = super::super::matching::match_dots(&views, &options).len();
            assert!(found > 25, "without camera {blind}: {found}");
        }
    }

    #[test]
    fn pictures_of_other_things_are_not_brought_together() {
        let mut random = Random::new(3);
        let scene = Scene::new(0.0);
        let mut dots = || {
            (0..60).map(|_| Point2::new(200.0 + 200.0 * random.uniform(), 120.0 + 240.0 * random.uniform())).collect()
        };
        let mut views: Vec<DotView> =
            scene.cameras.iter().map(|camera| DotView { camera: camera.clone(), dots: dots() }).collect();
        assert!(!register(&mut views, (Point3::new(0.0, 0.05, 1.6), 0.25), 30.0, 35, 3));
        assert!(!register(&mut [], (Point3::origin(), 1.0), 30.0, 15, 3));
    }
}
