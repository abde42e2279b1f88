//! The track store of marks: position and confirmation of each.

use std::collections::{BTreeMap, BTreeSet};

use foveate::geometry::{AlignmentOptions, align};
use foveate::prelude::*;
use nalgebra::{Isometry3, Point3};

/// A tentative mark is dropped after this many frames without an observation.
const PATIENCE: u32 = 15;
/// A mark that was labelled here is false once its cameras contradicted each other in this many frames more than they agreed in: half a second at the
/// 60 Hz of heads.
const MOST_CONTRADICTIONS: u32 = 30;
/// Of two hidden marks that may have reappeared at a place, the second must be this many times as far from its prediction as the first.
const CLEARLY_FARTHER: f64 = 2.0;
/// After this many ambiguous frames the first is used: the second may never reappear.
const MOST_UNDECIDED: u32 = 30;
/// Number of nearest marks by whose motion an unseen one is extrapolated.
const NEIGHBOURS: usize = 10;
/// Fewest marks that determine the surface's motion.
const LEAST_FOR_MOTION: usize = 4;

/// One mark.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Known {
    /// Measured or predicted position, in the world [m].
    pub position: Point3<f64>,
    /// Whether it was measured in the last frame.
    pub is_seen: bool,
    /// Frames in which it was measured, until it is confirmed.
    seen: u32,
    /// Frames since it was measured.
    unseen: u32,
    pub is_believed: bool,
    /// Frames in which two or more cameras disagreed on its place, minus those in which they agreed.
    contradictions: u32,
    /// Frames since it was seen in which a reappearing mark may be it or another one.
    undecided: u32,
    /// Whether its label came from outside.
    is_given: bool,
}

impl Known {
    /// A new mark without observations under its label.
    fn at(position: Point3<f64>) -> Known {
        Known {
            position,
            is_seen: false,
            seen: 0,
            unseen: 0,
            is_believed: false,
            contradictions: 0,
            undecided: 0,
            is_given: false,
        }
    }
}

/// All marks by label.
#[derive(Default)]
pub(super) struct TrackStore {
    pub marks: BTreeMap<u32, Known>,
    /// Labels that are not used again: of false marks, and of tentative marks that were not confirmed.
    pub retired: BTreeSet<u32>,
    next_label: u32,
}

impl TrackStore {
    /// A mark whose label came from outside.
    pub fn named(&mut self, label: u32, position: Point3<f64>) {
        self.next_label = self.next_label.max(label + 1);
        let known = Known { is_seen: true, seen: 1, is_believed: true, is_given: true, ..Known::at(position) };
        self.marks.insert(label, known);
    }

    /// A mark that the cameras agree on.
    pub fn initiate(&mut self, position: Point3<f64>) {
        self.marks.insert(self.next_label, Known::at(position));
        self.next_label += 1;
    }

    /// Updates marks that two or more cameras saw, with whether they agreed on its place; retires marks with too many contradictions.
    pub fn judge(&mut self, agreed: impl Iterator<Item = (u32, bool)>) {
        for (label, agreed) in agreed {
            let Some(mark) = self.marks.get_mut(&label).filter(|it| !it.is_given) else { continue };
            mark.contradictions = if agreed { mark.contradictions.saturating_sub(1) } else { mark.contradictions + 1 };
            if mark.contradictions > MOST_CONTRADICTIONS {
                self.marks.remove(&label);
                self.retired.insert(label);
            }
        }
    }

    /// Takes in the marks of one frame and predicts the others: by `filled`, positions of all marks in their own space, or else by their previous positions.
    /// Tentative marks in `weak`, which too few cameras see, are dropped.
    pub fn update(
        &mut self,
        measured: &BTreeMap<u32, Point3<f64>>,
        weak: &BTreeSet<u32>,
        filled: Option<&Marks>,
        initiation_frames: u32,
    ) {
        let known = |label: u32| self.marks.get(&label).map(|it| it.position);
        // Where a mark that was not measured is, in a space in which the measured ones are known too.
        let reference = |label: u32| filled.and_then(|it| Some(it.get(label)?.position));
        let by_model: Vec<(u32, Point3<f64>)> =
            measured.keys().filter_map(|label| Some((*label, reference(*label)?))).collect();
        let by_memory: Vec<(u32, Point3<f64>)> =
            measured.keys().filter_map(|label| Some((*label, known(*label)?))).collect();
        let carried: Vec<(u32, Point3<f64>)> = self
            .marks
            .iter()
            .filter(|(label, _)| !measured.contains_key(label))
            .filter_map(|(label, mark)| {
                let by_model = || Some(carry(&by_model, measured, &reference(*label)?)? * reference(*label)?);
                let by_memory = || Some(carry(&by_memory, measured, &mark.position)? * mark.position);
                Some((*label, by_model().or_else(by_memory)?))
            })
            .collect();
        for (label, position) in carried {
            if let Some(mark) = self.marks.get_mut(&label) {
                (mark.position, mark.is_seen) = (position, false);
            }
        }
        for (label, mark) in &mut self.marks {
            let position = measured.get(label);
            mark.is_seen = position.is_some();
            match position {
                Some(position) if mark.is_believed || !weak.contains(label) => {
                    (mark.position, mark.unseen, mark.undecided) = (*position, 0, 0);
                    mark.seen += 1;
                    mark.is_believed |= mark.seen >= initiation_frames;
                }
                Some(position) => (mark.position, mark.unseen) = (*position, mark.unseen + 1),
                None => mark.unseen += 1,
            }
        }
        self.marks.retain(|label, mark| {
            let stays = mark.is_believed || mark.unseen < PATIENCE;
            stays || !self.retired.insert(*label)
        });
    }

    /// Moves the unseen marks as in `shape`, a stored shape in any pose [m].
    pub fn take_shape(&mut self, shape: &BTreeMap<u32, Point3<f64>>) {
        for (label, position) in shape {
            self.marks.entry(*label).and_modify(|it| it.position = *position);
        }
    }

    /// Whether the label was given here, not from outside.
    pub fn is_own(&self, label: u32) -> bool {
        self.marks.get(&label).is_some_and(|it| !it.is_given)
    }

    /// Assigns `position`, where the cameras agree on an unlabelled mark, to the hidden mark predicted within `reach` of it [m], if no other is nearly as near.
    /// Returns whether any is within reach; an ambiguous position moves no mark for half a second, and initiates none: a mark on skin that is pulled aside reappears halfway to
    /// its neighbour's place.
    pub fn moved_to(&mut self, position: &Point3<f64>, reach: f64) -> bool {
        let (mut near, mut second) = ((f64::INFINITY, None), f64::INFINITY);
        for (label, mark) in self.marks.iter().filter(|it| it.1.is_believed && it.1.unseen > 0) {
            let distance = (mark.position - position).norm();
            if distance < near.0 {
                second = near.0;
                near = (distance, Some(*label));
            } else {
                second = second.min(distance);
            }
        }
        let is_clear = second >= CLEARLY_FARTHER * near.0;
        let moved = near.1.filter(|_| near.0 < reach).and_then(|label| self.marks.get_mut(&label));
        if let Some(mark) = moved {
            mark.undecided += 1;
            if is_clear || mark.undecided > MOST_UNDECIDED {
                (mark.position, mark.undecided) = (*position, 0);
            }
            return true;
        }
        false
    }

    /// Distance to the nearest mark [m].
    pub fn nearest(&self, position: &Point3<f64>) -> f64 {
        self.marks.values().map(|it| (it.position - position).norm()).fold(f64::INFINITY, f64::min)
    }
}

/// Motion of the surroundings of `place`, from the marks' positions `from` to their measured ones.
pub(super) fn carry(
    from: &[(u32, Point3<f64>)],
    measured: &BTreeMap<u32, Point3<f64>>,
    place: &Point3<f64>,
) -> Option<Isometry3<f64>> {
    if from.len() < LEAST_FOR_MOTION {
        return None;
    }
    let mut near: Vec<&(u32, Point3<f64>)> = from.iter().collect();
    near.sort_by(|a, b| (a.1 - place).norm_squared().total_cmp(&(b.1 - place).norm_squared()));
    near.truncate(NEIGHBOURS);
    let before: Vec<Point3<f64>> = near.iter().map(|it| it.1).collect();
    let after: Vec<Point3<f64>> = near.iter().map(|it| measured[&it.0]).collect();
    let motion = align(&before, &after, AlignmentOptions::default()).ok()?;
    Some(motion.b_from_a.isometry)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::integrator::tests::marks_on_a_face;

    #[test]
    fn a_hidden_mark_moves_with_its_surroundings() {
        let marks = marks_on_a_face();
        let mut track_store = TrackStore::default();
        for (label, position) in marks.iter().enumerate() {
            track_store.named(label as u32, *position);
        }
        let motion = Isometry3::new(Vector3::new(0.03, 0.01, -0.02), Vector3::new(0.1, 0.2, -0.1));
        let hidden = [3, 40];
        let measured: BTreeMap<u32, Point3<f64>> = marks
            .iter()
            .zip(0..)
            .filter(|(_, label)| !hidden.contains(label))
            .map(|(it, label)| (label, motion * it))
            .collect();
        track_store.update(&measured, &BTreeSet::new(), None, 1);
        for label in hidden {
            let mark = &track_store.marks[&label];
            let off = (mark.position - motion * marks[label as usize]).norm();
            assert!(off < 1e-6 && !mark.is_seen, "{label}: {off} m");
        }
        assert!(track_store.marks[&4].is_seen);
    }

    #[test]
    fn the_model_knows_better_where_a_hidden_mark_is() {
        let marks = marks_on_a_face();
        let mut track_store = TrackStore::default();
        let mark = |label: u32, position: Point3<f64>| Mark {
            label,
            position,
            covariance: nalgebra::Matrix3::identity() * 1e-8,
            cameras: CameraSet::default(),
            provenance: Provenance::Filled,
        };
        // The model has the mark 5 mm beside where it was last seen.
        let mut list: Vec<Mark> = marks.iter().zip(0..).map(|(it, label)| mark(label, *it)).collect();
        list[20].position.x += 0.005;
        for (label, position) in marks.iter().enumerate() {
            track_store.named(label as u32, *position);
        }
        let motion = Isometry3::new(Vector3::new(0.03, 0.01, -0.02), Vector3::new(0.1, 0.2, -0.1));
        let expected = motion * list[20].position;
        let measured = marks.iter().zip(0..).filter(|it| it.1 != 20).map(|(it, label)| (label, motion * it)).collect();
        track_store.update(&measured, &BTreeSet::new(), Some(&Marks { list, ..Marks::default() }), 1);
        assert!((track_store.marks[&20].position - expected).norm() < 1e-6);
    }

    #[test]
    fn what_comes_out_near_where_one_hidden_mark_should_be_is_that_mark() {
        let mut track_store = TrackStore::default();
        let at = |x: f64| Point3::new(x, 0.0, 1.0);
        [0.0, 0.1, 0.112].iter().zip(0..).for_each(|(x, label)| track_store.named(label, at(*x)));
        assert!(!track_store.moved_to(&at(0.005), 0.009), "no mark is hidden");
        track_store.update(&BTreeMap::new(), &BTreeSet::new(), None, 1);
        assert!(track_store.moved_to(&at(0.005), 0.009) && track_store.marks[&0].position == at(0.005));
        assert!(
            track_store.moved_to(&at(0.106), 0.009) && track_store.marks[&1].position == at(0.1),
            "one of two, ambiguous"
        );
        for _ in 1..MOST_UNDECIDED {
            assert!(track_store.moved_to(&at(0.105), 0.009) && track_store.marks[&1].position == at(0.1), "5 and 7 mm");
        }
        (0..2).for_each(|_| assert!(track_store.moved_to(&at(0.105), 0.009)));
        assert_eq!(track_store.marks[&1].position, at(0.105), "a second later");
        track_store.named(1, at(0.1));
        track_store.update(&BTreeMap::new(), &BTreeSet::new(), None, 1);
        assert!(track_store.moved_to(&at(0.103), 0.009) && track_store.marks[&1].position == at(0.103), "3 and 9 mm");
        assert!(!track_store.moved_to(&at(0.05), 0.009));
    }

    #[test]
    fn a_mark_is_believed_after_some_frames_and_forgotten_before_that_when_it_does_not_come_again() {
        let mut track_store = TrackStore::default();
        track_store.initiate(Point3::new(0.0, 0.0, 1.0));
        track_store.initiate(Point3::new(0.1, 0.0, 1.0));
        let seen: BTreeMap<u32, Point3<f64>> = [(0, Point3::new(0.0, 0.0, 1.0))].into();
        (0..3).for_each(|_| track_store.update(&seen, &BTreeSet::new(), None, 3));
        assert!(track_store.marks[&0].is_believed && !track_store.marks[&1].is_believed);
        (0..PATIENCE).for_each(|_| track_store.update(&BTreeMap::new(), &BTreeSet::new(), None, 3));
        assert_eq!(track_store.marks.keys().copied().collect::<Vec<_>>(), [0]);
        track_store.initiate(Point3::origin());
        assert!(track_store.marks.contains_key(&2), "labels are not given out again");
        // Two cameras go on seeing it, where three would have to.
        let seen: BTreeMap<u32, Point3<f64>> = [(2, Point3::origin())].into();
        (0..PATIENCE).for_each(|_| track_store.update(&seen, &[2].into(), None, 3));
        assert_eq!(track_store.retired, [1, 2].into());
    }

    #[test]
    fn a_mark_that_is_mostly_contradicted_is_false_unless_it_was_given() {
        let mut track_store = TrackStore::default();
        track_store.named(0, Point3::origin());
        (1..4).for_each(|it| track_store.initiate(Point3::new(f64::from(it), 0.0, 0.0)));
        for frame in 0..3 * (MOST_CONTRADICTIONS - 1) {
            // Mark 1 in two frames of three, mark 2 in every other one, mark 3 in the first so many.
            track_store.judge([(0, false), (1, frame % 3 == 2), (2, frame % 2 == 1)].into_iter());
            if frame < MOST_CONTRADICTIONS {
                track_store.judge([(3, false)].into_iter());
            }
        }
        assert!(track_store.retired.is_empty());
        (0..2).for_each(|_| track_store.judge([(1, false), (3, false)].into_iter()));
        assert_eq!(track_store.retired, [1, 3].into());
        assert_eq!(track_store.marks.keys().copied().collect::<Vec<_>>(), [0, 2]);
    }
}
