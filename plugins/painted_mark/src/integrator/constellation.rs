//! Re-identification of marks from points in space alone: finds which points are which marks of a known constellation.
//!
//! Three points whose mutual distances are those of three marks determine a rigid motion; the motion that brings most marks onto points wins. A face
//! deforms, but much of it little.

use foveate::estimation::Random;
use foveate::geometry::{AlignmentOptions, align};
use nalgebra::{Isometry3, Point3};

/// Largest difference between distances of matching triples [m]: deformation of a face between neighbours.
const LENGTH_TOLERANCE: f64 = 0.003;
/// A mark is on a point when it is closer [m].
const NEAR: f64 = 0.003;
/// Sides of the triples: longer than the gaps between marks [m].
const SHORTEST_SIDE: f64 = 0.03;
const DRAWS: usize = 120;
/// Points by which most candidate motions are rejected, and how many of them must be on marks.
const PROBES: usize = 12;
const LIKELY: usize = 3;
/// Share of the points that must be marks, and their least number.
const SHARE: f64 = 0.6;
const LEAST: usize = 8;
/// A second motion may bring at most this share of the marks onto points: rows of marks look alike when shifted.
const RIVAL: f64 = 0.7;

/// Number of the point for each mark that is on one; `None` where the points are not the constellation.
pub(super) fn recognise(points: &[Point3<f64>], marks: &[Point3<f64>]) -> Option<Vec<(usize, usize)>> {
    if points.len() < LEAST || marks.len() < LEAST {
        return None;
    }
    let mut random = Random::new(points.len() as u64);
    let mut best: Vec<(usize, usize)> = Vec::new();
    let mut rival = 0;
    for _ in 0..DRAWS {
        let mut draw = || random.below(points.len() as u32) as usize;
        let triple = [draw(), draw(), draw()];
        let side = |i: usize| (points[triple[i]] - points[triple[(i + 1) % 3]]).norm();
        let sides = [side(0), side(1), side(2)];
        if sides.iter().any(|it| *it < SHORTEST_SIDE) {
            continue;
        }
        for a in 0..marks.len() {
            let at = |from: usize, length: f64| {
                (0..marks.len()).filter(move |it| ((marks[*it] - marks[from]).norm() - length).abs() < LENGTH_TOLERANCE)
            };
            for b in at(a, sides[0]) {
                for c in at(b, sides[1]) {
                    if ((marks[c] - marks[a]).norm() - sides[2]).abs() > LENGTH_TOLERANCE {
                        continue;
                    }
                    let from = [marks[a], marks[b], marks[c]];
                    let Ok(motion) = align(&from, &triple.map(|it| points[it]), AlignmentOptions::default()) else {
                        continue;
                    };
                    if !is_likely(points, marks, &motion.b_from_a.isometry) {
                        continue;
                    }
                    let pairs = on_points(points, marks, &motion.b_from_a.isometry);
                    let in_common = pairs.iter().filter(|it| best.contains(it)).count();
                    let is_another = 2 * in_common < pairs.len();
                    if pairs.len() > best.len() {
                        rival = if is_another { best.len() } else { rival };
                        best = pairs;
                    } else if is_another {
                        rival = rival.max(pairs.len());
                    }
                }
            }
        }
    }
    // Once more with all that agree.
    let from: Vec<Point3<f64>> = best.iter().map(|it| marks[it.0]).collect();
    let to: Vec<Point3<f64>> = best.iter().map(|it| points[it.1]).collect();
    let motion = align(&from, &to, AlignmentOptions { robust: true, ..AlignmentOptions::default() }).ok()?;
    let pairs = on_points(points, marks, &motion.b_from_a.isometry);
    let enough = pairs.len() >= LEAST && pairs.len() as f64 >= SHARE * points.len().min(marks.len()) as f64;
    let is_alone = (rival as f64) <= RIVAL * best.len() as f64;
    (enough && is_alone).then_some(pairs)
}

/// Whether enough of a few points have a mark near them to examine the motion further.
fn is_likely(points: &[Point3<f64>], marks: &[Point3<f64>], motion: &Isometry3<f64>) -> bool {
    let back = motion.inverse();
    let probes = (0..PROBES).map(|it| back * points[it * points.len() / PROBES]);
    let near = |probe: &Point3<f64>| marks.iter().any(|it| (it - probe).norm_squared() < NEAR * NEAR);
    probes.filter(near).count() >= LIKELY
}

/// Mark and point, for marks that the motion brings closer to one point than to any other, and no other mark as close.
fn on_points(points: &[Point3<f64>], marks: &[Point3<f64>], motion: &Isometry3<f64>) -> Vec<(usize, usize)> {
    let moved: Vec<Point3<f64>> = marks.iter().map(|it| motion * it).collect();
    let nearest = |from: &Point3<f64>, of: &[Point3<f64>]| {
        let distances = of.iter().map(|it| (it - from).norm_squared()).enumerate();
        distances.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|it| it.1 < NEAR * NEAR).map(|it| it.0)
    };
    let pair = |mark: usize| {
        let point = nearest(&moved[mark], points)?;
        (nearest(&points[point], &moved) == Some(mark)).then_some((mark, point))
    };
    (0..marks.len()).filter_map(pair).collect()
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::integrator::tests::marks_on_a_face;

    #[test]
    fn marks_get_their_names_back_after_any_motion_with_some_missing_and_some_deformed() {
        let marks = marks_on_a_face();
        let mut random = Random::new(9);
        for round in 0..4 {
            let turn = Vector3::from_fn(|_, _| random.uniform_in(-1.5, 1.5));
            let motion = Isometry3::new(Vector3::new(0.4, -0.2, 0.1), turn);
            let mut truth: Vec<usize> = (0..marks.len()).filter(|_| random.uniform() < 0.8).collect();
            truth.rotate_left(13);
            let place = |mark: &usize| {
                // The chin hangs down.
                let open = if marks[*mark].z < 1.54 { 0.015 } else { 0.0005 };
                motion * (marks[*mark] - Vector3::z() * open)
            };
            let points: Vec<Point3<f64>> = truth.iter().map(place).collect();
            let pairs = recognise(&points, &marks).unwrap();
            let wrong = pairs.iter().filter(|(mark, point)| truth[*point] != *mark).count();
            assert!(wrong == 0 && pairs.len() > 30, "round {round}: {wrong} wrong of {}", pairs.len());
        }
    }

    #[test]
    fn rows_that_could_be_shifted_are_not_recognised() {
        let row = |it: u32| Point3::new(f64::from(it % 5) * 0.02, 0.0, f64::from(it / 5) * 0.02);
        let marks: Vec<Point3<f64>> = (0..45).map(row).collect();
        // The five marks at one end are hidden.
        assert_eq!(recognise(&marks[5..], &marks), None);
    }

    #[test]
    fn other_points_are_not_recognised() {
        let marks = marks_on_a_face();
        let mut random = Random::new(10);
        let points: Vec<Point3<f64>> =
            (0..40).map(|_| Point3::from(Vector3::from_fn(|_, _| random.uniform_in(-0.1, 0.1)))).collect();
        assert_eq!(recognise(&points, &marks), None);
        assert_eq!(recognise(&points[..5], &marks), None);
    }
}
