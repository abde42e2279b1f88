//! Points where lines of sight of several cameras meet, without a motion model and without identities.
//!
//! [Davis 2002 §3.6]: a real light is seen by several cameras along lines that meet within a tolerance; detections
//! of one camera alone are not. With many lights, lines of *different* lights meet by accident as well (a ghost). Therefore:
//!
//! 1. each pair of lines that comes close enough, at a sufficient angle, is a candidate;
//! 2. its support is the number of cameras with a line through it (the nearest of each camera);
//! 3. the best supported candidate is taken first, among equals the one whose lines meet best, and its lines are removed,
//!    so that ghosts can use only the remaining lines.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use foveate::geometry::{Ray, closest_approach, triangulate_rays};
use foveate::messages::{CameraId, Time};
use nalgebra::{Matrix2, Point2, Point3};
use smallvec::SmallVec;

/// A feature as a line of sight.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayObservation {
    /// The camera.
    pub camera: CameraId,
    /// The capture time.
    pub time: Time,
    /// In the world [m].
    pub ray: Ray,
    /// Raw pixels [px].
    pub pixel: Point2<f64>,
    /// Of the pixel [px²].
    pub covariance: Matrix2<f64>,
    /// Its index in its list of features.
    pub feature: usize,
}

/// Conditions of a meeting.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConsensusOptions {
    /// Lines this close to a point go through it [m].
    pub tolerance: f64,
    /// How many different cameras a point needs.
    pub min_cameras: usize,
    /// Two lines fix a point only when the sine of their angle is at least this [–].
    pub min_sine: f64,
}

/// A point and the lines through it, at most one a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Meeting {
    /// Least-squares point of the lines [m].
    pub position: Point3<f64>,
    /// Indices in the list of observations, ascending.
    pub members: SmallVec<[usize; 20]>,
}

/// The search, with its buffers.
#[derive(Debug, Default)]
pub struct Consensus {
    heap: BinaryHeap<Candidate>,
    used: Vec<bool>,
}

#[derive(Debug, Clone, Copy)]
struct Candidate {
    cameras: usize,
    /// Sum of the squared distances of the supporting lines over their count [m²].
    spread: f64,
    position: Point3<f64>,
    /// The pair that proposed it: completes the order, so that the result is the same in every run.
    pair: (usize, usize),
}

impl Ord for Candidate {
    fn cmp(&self, other: &Self) -> Ordering {
        let better = self.cameras.cmp(&other.cameras).then(other.spread.total_cmp(&self.spread));
        better.then(other.pair.cmp(&self.pair))
    }
}

impl PartialOrd for Candidate {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Candidate {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Candidate {}

impl Consensus {
    /// Fills `found` with the meetings among `observations`, best first; no observation is in two of them.
    ///
    /// `observations` must be grouped by camera. With `seeds`, only lines of that camera propose meetings: the only ones
    /// that are new. `accept` decides whether a point with that many cameras may be a light.
    pub fn find(
        &mut self,
        observations: &[RayObservation],
        seeds: Option<CameraId>,
        options: &ConsensusOptions,
        accept: impl Fn(&Point3<f64>, usize) -> bool,
        found: &mut Vec<Meeting>,
    ) {
        found.clear();
        self.heap.clear();
        self.used.clear();
        self.used.resize(observations.len(), false);
        self.propose(observations, seeds, options, &accept);
        while let Some(candidate) = self.heap.pop() {
            let Some((meeting, now)) = self.settle(observations, candidate, options) else { continue };
            if now.cameras < candidate.cameras {
                self.heap.push(now); // others took some of its lines: it queues again
            } else if accept(&meeting.position, meeting.members.len()) {
                for &member in &meeting.members {
                    self.used[member] = true;
                }
                found.push(meeting);
            }
        }
    }

    /// Puts all pairs of lines that meet, with enough support, into the heap.
    fn propose(
        &mut self,
        observations: &[RayObservation],
        seeds: Option<CameraId>,
        options: &ConsensusOptions,
        accept: &impl Fn(&Point3<f64>, usize) -> bool,
    ) {
        for (i, a) in observations.iter().enumerate() {
            if seeds.is_some_and(|camera| camera != a.camera) {
                continue;
            }
            for (j, b) in observations.iter().enumerate() {
                if b.camera == a.camera || (seeds.is_none() && j < i) {
                    continue;
                }
                let Some(position) = meet(a, b, options) else { continue };
                let (members, spread) = self.support(observations, &position, options);
                if members.len() >= options.min_cameras && accept(&position, members.len()) {
                    self.heap.push(Candidate { cameras: members.len(), spread, position, pair: (i, j) });
                }
            }
        }
    }

    /// The candidate on the lines that are still unused, moved to where these meet best.
    fn settle(
        &self,
        observations: &[RayObservation],
        candidate: Candidate,
        options: &ConsensusOptions,
    ) -> Option<(Meeting, Candidate)> {
        let (members, spread) = self.support(observations, &candidate.position, options);
        if members.len() < options.min_cameras {
            return None;
        }
        let now = Candidate { cameras: members.len(), spread, ..candidate };
        let Some(position) = least_squares(observations, &members) else {
            return Some((Meeting { position: candidate.position, members }, now));
        };
        // Lines that the first guess missed may go through the better point; never fewer than before.
        let (again, _) = self.support(observations, &position, options);
        if again.len() < members.len() {
            return Some((Meeting { position: candidate.position, members }, now));
        }
        let position = least_squares(observations, &again).unwrap_or(position);
        Some((Meeting { position, members: again }, now))
    }

    /// The nearest unused line of each camera within the tolerance of `point`, and their mean squared distance [m²].
    fn support(
        &self,
        observations: &[RayObservation],
        point: &Point3<f64>,
        options: &ConsensusOptions,
    ) -> (SmallVec<[usize; 20]>, f64) {
        let mut members: SmallVec<[usize; 20]> = SmallVec::new();
        let (mut sum, mut nearest) = (0.0, f64::INFINITY);
        let mut camera = None;
        for (i, it) in observations.iter().enumerate() {
            if self.used[i] {
                continue;
            }
            let to_point = point - it.ray.origin;
            let depth = to_point.dot(&it.ray.direction);
            let squared = to_point.norm_squared() - depth * depth;
            if !(depth > 0.0 && squared <= options.tolerance * options.tolerance) {
                continue;
            }
            if camera != Some(it.camera) {
                camera = Some(it.camera);
                nearest = squared;
                sum += squared;
                members.push(i);
            } else if squared < nearest {
                sum += squared - nearest;
                nearest = squared;
                if let Some(last) = members.last_mut() {
                    *last = i;
                }
            }
        }
        let spread = sum.max(0.0) / members.len().max(1) as f64;
        (members, spread)
    }
}

/// Where two lines meet in front of both cameras, at a sufficient angle and within the tolerance.
fn meet(a: &RayObservation, b: &RayObservation, options: &ConsensusOptions) -> Option<Point3<f64>> {
    let sine_squared = a.ray.direction.cross(&b.ray.direction).norm_squared();
    if sine_squared < options.min_sine * options.min_sine {
        return None;
    }
    let approach = closest_approach(&a.ray, &b.ray)?;
    let in_front = approach.depth_a > 0.0 && approach.depth_b > 0.0;
    (in_front && approach.gap <= options.tolerance).then_some(approach.midpoint)
}

fn least_squares(observations: &[RayObservation], members: &[usize]) -> Option<Point3<f64>> {
    let rays: SmallVec<[Ray; 20]> = members.iter().map(|&i| observations[i].ray).collect();
    triangulate_rays(&rays)
}

#[cfg(test)]
mod tests {
    use foveate_testkit::camera_ring;

    use super::*;

    const OPTIONS: ConsensusOptions = ConsensusOptions { tolerance: 0.015, min_cameras: 3, min_sine: 0.05 };

    /// What `cameras` of a ring of 8 see of `lights`, by camera.
    fn observations(cameras: &[usize], lights: &[Point3<f64>]) -> Vec<RayObservation> {
        let ring = camera_ring(8);
        let mut list = Vec::new();
        for &camera in cameras {
            for (feature, light) in lights.iter().enumerate() {
                let pixel = ring[camera].sees(light).unwrap();
                let ray = ring[camera].ray(&pixel).unwrap();
                let camera = CameraId(camera as u16);
                list.push(RayObservation {
                    camera,
                    time: Time::ZERO,
                    ray,
                    pixel,
                    covariance: Matrix2::identity(),
                    feature,
                });
            }
        }
        list
    }

    fn meetings(observations: &[RayObservation], seeds: Option<CameraId>) -> Vec<Meeting> {
        let mut found = Vec::new();
        Consensus::default().find(observations, seeds, &OPTIONS, |_, _| true, &mut found);
        found
    }

    #[test]
    fn each_light_is_met_once_by_all_cameras_and_nothing_else_is() {
        let lights: Vec<Point3<f64>> = foveate_testkit::scene::point_cloud(20, 3);
        let observations = observations(&[0, 1, 2, 3, 4, 5, 6, 7], &lights);
        let found = meetings(&observations, None);
        assert_eq!(found.len(), 20);
        for meeting in found {
            assert_eq!(meeting.members.len(), 8);
            let light = observations[meeting.members[0]].feature;
            assert!(meeting.members.iter().all(|&it| observations[it].feature == light), "lines of different lights");
            assert!((meeting.position - lights[light]).norm() < 1e-6);
        }
    }

    #[test]
    fn lines_are_used_once_even_where_an_accident_shares_them() {
        // Two lights as seen by two cameras lie in one plane with them: four meetings of two lines, two of which are ghosts.
        let ring = camera_ring(8);
        let (a, b) = (ring[0].centre(), ring[3].centre());
        let middle = Point3::new(0.0, 0.0, 1.0);
        let in_plane = (a - middle) * 0.1 + (b - middle) * 0.15;
        let lights = [middle, middle + in_plane];
        let pair = observations(&[0, 3], &lights);
        let options = ConsensusOptions { min_cameras: 2, ..OPTIONS };
        let mut found = Vec::new();
        Consensus::default().find(&pair, None, &options, |_, _| true, &mut found);
        assert_eq!(found.len(), 2, "two lines a camera make two points, right or wrong");
        // A third camera tells which.
        let found = meetings(&observations(&[0, 3, 5], &lights), None);
        assert_eq!(found.len(), 2);
        assert!(found.iter().all(|it| lights.iter().any(|light| (light - it.position).norm() < 1e-6)), "{found:?}");
    }

    #[test]
    fn the_best_supported_point_is_taken_first() {
        // A ghost on the line of camera 0 to the light, where cameras 1 and 2 imagine something.
        let light = Point3::new(0.1, 0.2, 0.9);
        let ghost = nalgebra::center(&light, &camera_ring(8)[0].centre());
        let mut mixed = observations(&[0, 3, 4], &[light]);
        mixed.splice(1..1, observations(&[1, 2], &[ghost, light]));
        let found = meetings(&mixed, None);
        assert_eq!(found.len(), 1, "what is left of the ghost is two lines");
        assert_eq!(found[0].members.len(), 5);
        assert!((found[0].position - light).norm() < 1e-6);
    }

    #[test]
    fn lines_at_too_small_an_angle_fix_no_point() {
        let pair = observations(&[0, 1], &[Point3::new(0.1, 0.2, 0.9)]); // some 40 degrees apart
        for (min_sine, n) in [(0.4, 1), (0.8, 0)] {
            let mut found = Vec::new();
            let options = ConsensusOptions { min_sine, min_cameras: 2, ..OPTIONS };
            Consensus::default().find(&pair, None, &options, |_, _| true, &mut found);
            assert_eq!(found.len(), n, "{min_sine}");
        }
    }

    #[test]
    fn seeds_restrict_the_proposers() {
        let light = [Point3::new(0.1, 0.2, 0.9)];
        let observations = observations(&[1, 2, 4], &light);
        assert_eq!(meetings(&observations, Some(CameraId(2))).len(), 1);
        assert_eq!(meetings(&observations, Some(CameraId(3))).len(), 0);
    }

    #[test]
    fn too_few_parallel_and_broken_lines_meet_nowhere() {
        let light = [Point3::new(0.1, 0.2, 0.9)];
        assert!(meetings(&[], None).is_empty());
        assert!(meetings(&observations(&[1, 2], &light), None).is_empty());
        let mut same = observations(&[1, 1, 1], &light);
        (0..3).for_each(|k| same[k].camera = CameraId(k as u16));
        assert!(meetings(&same, None).is_empty());
        let mut broken = observations(&[1, 2, 4], &light);
        broken[1].ray.origin.x = f64::NAN;
        assert!(meetings(&broken, None).is_empty());
    }

    #[test]
    fn what_lies_behind_a_camera_is_not_met() {
        let mut backwards = observations(&[0, 2, 5], &[Point3::new(0.1, 0.2, 0.9)]);
        for it in &mut backwards {
            it.ray.direction = -it.ray.direction;
        }
        assert!(meetings(&backwards, None).is_empty());
    }
}
