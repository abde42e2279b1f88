//! Matches the dots of several cameras by geometry alone.
//!
//! Two dots whose lines of sight pass each other closely propose a place; the other cameras should see a dot there too. Places that most cameras agree
//! on come first and take their dots; a dot belongs to one place at most.

use foveate::geometry::{Camera, Ray, triangulate_rays};
use nalgebra::{Matrix3, Point2, Point3, Vector3};

/// The dots of one camera.
pub(super) struct DotView {
    pub camera: Camera,
    pub dots: Vec<Point2<f64>>,
}

/// Dots that are one mark.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Match {
    /// In the world [m].
    pub position: Point3<f64>,
    /// View and dot.
    pub dots: Vec<(usize, usize)>,
    /// Largest distance between a dot and the projection of the place [px].
    pub worst: f64,
}

/// Options of matching.
#[derive(Debug, Clone, Copy)]
pub(super) struct MatchOptions {
    /// Middle of the ball that all marks lie in [m], and its radius [m].
    pub ball: (Point3<f64>, f64),
    /// Largest distance between a dot and the projection of its place [px].
    pub tolerance: f64,
    /// Fewest cameras that agree.
    pub views: usize,
}

/// The point that the optical axes of `cameras` pass closest to: heads that track one target look at it. `None` for fewer than two.
pub(super) fn where_all_look<'a>(cameras: impl Iterator<Item = &'a Camera>) -> Option<Point3<f64>> {
    let axes: Vec<Ray> = cameras
        .filter_map(|it| it.ray(&Point2::new(f64::from(it.image_size[0]) / 2.0, f64::from(it.image_size[1]) / 2.0)))
        .collect();
    if axes.len() < 2 {
        return None;
    }
    let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
    for ray in &axes {
        let direction = ray.direction.into_inner();
        let off = Matrix3::identity() - direction * direction.transpose();
        normal += off;
        right += off * ray.origin.coords;
    }
    Some(Point3::from(normal.try_inverse()? * right)).filter(|it| it.coords.norm().is_finite())
}

/// Matches dots; the best supported places first.
pub(super) fn match_dots(views: &[DotView], options: &MatchOptions) -> Vec<Match> {
    let rays: Vec<Vec<Option<Ray>>> =
        views.iter().map(|view| view.dots.iter().map(|dot| view.camera.ray(dot)).collect()).collect();
    let mut found: Vec<Match> = Vec::new();
    for a in 0..views.len() {
        for b in a + 1..views.len() {
            for (i, one) in rays[a].iter().enumerate() {
                for (j, other) in rays[b].iter().enumerate() {
                    let (Some(one), Some(other)) = (one, other) else { continue };
                    found.extend(hypothesis(views, &rays, options, [(a, i), (b, j)], [*one, *other]));
                }
            }
        }
    }
    found.sort_by(|a, b| b.dots.len().cmp(&a.dots.len()).then(a.worst.total_cmp(&b.worst)));
    let mut taken: Vec<Vec<bool>> = views.iter().map(|view| vec![false; view.dots.len()]).collect();
    found.retain(|it| {
        let is_free = it.dots.iter().all(|(view, dot)| !taken[*view][*dot]);
        if is_free {
            it.dots.iter().for_each(|(view, dot)| taken[*view][*dot] = true);
        }
        is_free
    });
    found
}

fn hypothesis(
    views: &[DotView],
    rays: &[Vec<Option<Ray>>],
    options: &MatchOptions,
    pair: [(usize, usize); 2],
    observations: [Ray; 2],
) -> Option<Match> {
    let start = triangulate_rays(&observations)?;
    let off = |position: &Point3<f64>, (view, dot): (usize, usize)| {
        let DotView { camera, dots } = &views[view];
        Some((camera.project(position)? - dots[dot]).norm())
    };
    let near = (start - options.ball.0).norm() < options.ball.1;
    if !near || pair.iter().any(|it| off(&start, *it).is_none_or(|off| off > options.tolerance)) {
        return None;
    }
    let mut dots = pair.to_vec();
    for (view, DotView { camera, dots: candidates }) in views.iter().enumerate() {
        if pair.iter().any(|it| it.0 == view) {
            continue;
        }
        let Some(expected) = camera.project(&start) else { continue };
        let nearest = candidates.iter().map(|it| (it - expected).norm()).enumerate().min_by(|a, b| a.1.total_cmp(&b.1));
        // The place is known by two cameras only yet.
        dots.extend(nearest.filter(|it| it.1 < 1.5 * options.tolerance).map(|it| (view, it.0)));
    }
    if dots.len() < options.views {
        return None;
    }
    dots.sort_unstable();
    let lines: Vec<Ray> = dots.iter().filter_map(|(view, dot)| rays[*view][*dot]).collect();
    let position = triangulate_rays(&lines)?;
    let worst = dots.iter().try_fold(0.0_f64, |worst, it| Some(worst.max(off(&position, *it)?)))?;
    (worst <= options.tolerance).then_some(Match { position, dots, worst })
}

#[cfg(test)]
mod tests {
    use foveate::estimation::Random;

    use super::*;
    use crate::integrator::tests::{Scene, marks_on_a_face};

    #[test]
    fn dots_of_four_cameras_are_told_apart_though_some_are_hidden() {
        let mut random = Random::new(4);
        let marks = marks_on_a_face();
        let scene = Scene::new(0.0);
        let mut truth: Vec<Vec<usize>> = Vec::new();
        let views: Vec<DotView> = scene
            .cameras
            .iter()
            .map(|camera| {
                let mut seen: Vec<usize> = (0..marks.len()).filter(|_| random.uniform() < 0.85).collect();
                seen.sort_by_key(|it| (it * 31) % 69);
                let dots = seen.iter().map(|it| camera.project(&marks[*it]).unwrap()).collect();
                truth.push(seen);
                DotView { camera: camera.clone(), dots }
            })
            .collect();
        let ball = (where_all_look(scene.cameras.iter()).unwrap(), 0.25);
        let found = match_dots(&views, &MatchOptions { ball, tolerance: 1.0, views: 3 });
        for it in &found {
            let mark = truth[it.dots[0].0][it.dots[0].1];
            assert!(it.dots.iter().all(|(view, dot)| truth[*view][*dot] == mark), "{it:?}");
            assert!((it.position - marks[mark]).norm() < 1e-6);
        }
        let seen_thrice =
            (0..marks.len()).filter(|mark| truth.iter().filter(|it| it.contains(mark)).count() >= 3).count();
        assert!(found.len() + 2 >= seen_thrice && found.len() > 50, "{} of {seen_thrice}", found.len());
    }

    #[test]
    fn nothing_comes_of_nothing() {
        let options = MatchOptions { ball: (Point3::origin(), 1.0), tolerance: 1.0, views: 2 };
        assert_eq!(match_dots(&[], &options), []);
        let scene = Scene::new(0.0);
        let empty = |camera: &Camera| DotView { camera: camera.clone(), dots: vec![] };
        let views: Vec<DotView> = scene.cameras.iter().map(empty).collect();
        assert_eq!(match_dots(&views, &options), []);
        assert_eq!(where_all_look(scene.cameras[..1].iter()), None);
    }
}
