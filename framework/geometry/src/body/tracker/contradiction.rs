//! Contradictions between silhouettes around a body. Where all silhouettes are right, a hull contains the body, and no
//! view shows what has no voxel: places that many views need and others deny, and missing voxels inside a part,
//! indicate wrong poses, pictures or silhouettes there, however well a body fits the remaining voxels.
use nalgebra::{Point3, Vector3};

use super::super::field::VoxelField;
use super::super::parts::{Joint, N_PARTS, Part};
use super::BodyTracker;

/// What views disagree on counts for a body if it is so near to its skin, or to that of its head, and so far above its lowest joint, where shadows are no more [m].
const NEAR: f64 = 0.3;
const NEAR_HEAD: f64 = 0.2;
const ABOVE: f64 = 0.15;
/// Wrong poses and pictures last: what is contested holds for about so long [s].
const LASTS_S: f64 = 1.0;
/// Joints are so much vaguer an axis where views disagree on as much as the body holds [m], or a cubic metre at its head [m/m³], and at most so much [m]. Of drawn people before cameras that were turned, moved, exchanged and
/// mirrored, or that had lost heads and upper bodies.
const CONTESTED_SIGMA: f64 = 0.6;
const AT_HEAD_SIGMA: f64 = 25.0;
const MOST_SIGMA: f64 = 0.3;
/// The same where all voxels inside of its parts lack, beyond what lacks where all is well [m, –]: of drawn people whose silhouettes had holes and strips.
const LACKING_SIGMA: f64 = 0.3;
const LACKING_WELL: f64 = 0.02;
/// Inside of a part it is looked at so many places along its axis, on the axis and around it at half of its thickness, so far to its ends [–].
const ALONG: usize = 8;
const ABOUT: usize = 6;
const HALF: f64 = 0.5;
const TO_END: f64 = 0.85;
const TO_END_OF_HEAD: f64 = 0.6;

/// From fewer views no joint is measured: two cones may enclose bodies that no person has.
const LEAST_VIEWS: usize = 3;
/// Joints are so much vaguer an axis in hulls of so few views [m], two and three: of one rendered walker before pairs and threes of eight cameras.
const FEW_VIEWS_SIGMA: [(usize, f64); 2] = [(2, 0.15), (3, 0.04)];

/// What is known of it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Contradiction {
    /// What views disagree on near the body, of what its voxels hold; in the mean of the last second or now, if that is more [–].
    share: f64,
    mean: Option<f64>,
    /// What they disagree on at the head [m³].
    at_head: f64,
    /// Of each part, what lacks inside [–], and of all, by volume.
    lacks: [f64; N_PARTS],
    lacking: f64,
    /// What the voxels hold [m³].
    volume: f64,
    /// Views that carved them, where that is known.
    n_views: Option<usize>,
    dt_s: f64,
}

impl Contradiction {
    /// How much vaguer joints are an axis [m].
    pub(super) fn sigma(&self) -> f64 {
        let contested = (CONTESTED_SIGMA * self.share).max(AT_HEAD_SIGMA * self.at_head).min(MOST_SIGMA);
        let of_views = |it: &&(usize, f64)| self.n_views.is_some_and(|views| views <= it.0);
        let few = FEW_VIEWS_SIGMA.iter().find(of_views).map_or(0.0, |it| it.1);
        contested.hypot(LACKING_SIGMA * (self.lacking - LACKING_WELL).max(0.0)).hypot(few)
    }

    /// The share of a part's inside in which there is no voxel [–].
    pub(super) fn lacks_of(&self, part: Part) -> f64 {
        self.lacks[part.index()]
    }

    /// After left and right were exchanged.
    pub(super) fn turn_about(&mut self) {
        self.lacks = Part::ALL.map(|it| self.lacks[it.mirrored().index()]);
    }
}

impl BodyTracker {
    /// Measures what lacks inside of all parts.
    pub(super) fn look_inside(&mut self, field: &VoxelField, dt_s: f64) {
        let lacks = Part::ALL.map(|it| self.lacks_inside(field, it));
        let body = &self.filter.body;
        let volumes = Part::ALL.map(|it| if self.filter.layout().has(it) { body.size(it).product() } else { 0.0 });
        let lacking = lacks.iter().zip(volumes).map(|(lacks, volume)| lacks * volume).sum::<f64>();
        let lacking = lacking / volumes.iter().sum::<f64>().max(f64::MIN_POSITIVE);
        let volume = field.len() as f64 * field.size().powi(3);
        self.contradiction = Contradiction { lacks, lacking, volume, dt_s, ..self.contradiction };
    }

    fn lacks_inside(&self, field: &VoxelField, part: Part) -> f64 {
        if !self.filter.layout().has(part) {
            return 0.0;
        }
        let body = &self.filter.body;
        let (centre, turn, sizes) = (body.centres()[part.index()], body.turn(part), body.size(part));
        let to_end = if part == Part::Head { TO_END_OF_HEAD } else { TO_END };
        let lacks = |place: &Vector3<f64>| {
            let place = centre + turn * place.component_mul(sizes);
            !field.is_beyond(&place) && !field.cell(&place).is_some_and(|it| field.holds(it))
        };
        let about = (0..ABOUT).map(|it| (std::f64::consts::TAU * it as f64 / ABOUT as f64).sin_cos());
        let around: Vec<[f64; 2]> = about.map(|(sin, cos)| [HALF * cos, HALF * sin]).chain([[0.0; 2]]).collect();
        let heights = (0..ALONG).map(|it| to_end * ((2 * it + 1) as f64 / ALONG as f64 - 1.0));
        let n = heights.flat_map(|z| around.iter().map(move |[x, y]| Vector3::new(*x, *y, z))).filter(lacks).count();
        n as f64 / (ALONG * around.len()) as f64
    }

    /// Reports where views contradict each other, after a step: positions, and the volume that each represents [m, m³].
    pub fn set_contested(&mut self, contested: &[(Point3<f64>, f64)]) {
        let known = |it: &Joint| self.filter.layout().has(it.place().0);
        let heights = Joint::ALL.into_iter().filter(known).map(|it| self.filter.body.joint(it).z);
        let low = heights.fold(f64::INFINITY, f64::min);
        let (skins, head) = (self.skins(), self.skins().only(Part::Head));
        let is_near = |it: &&(Point3<f64>, f64)| it.0.z > low + ABOVE && skins.distance(&it.0) < NEAR;
        let is_at_head = |it: &&(Point3<f64>, f64)| head.distance(&it.0) < NEAR_HEAD;
        let own = self.contradiction.volume;
        let near: f64 = contested.iter().filter(is_near).map(|it| it.1).sum();
        let now = if own > 0.0 { near / own } else { 0.0 };
        let taken = (self.contradiction.dt_s / LASTS_S).min(1.0);
        let mean = self.contradiction.mean.map_or(now, |it| it + (now - it) * taken);
        let at_head = contested.iter().filter(is_at_head).map(|it| it.1).sum();
        self.contradiction = Contradiction { share: now.max(mean), mean: Some(mean), at_head, ..self.contradiction };
    }

    /// Reports how many views carved the voxels of the last step.
    pub fn set_n_views(&mut self, n_views: usize) {
        self.contradiction.n_views = Some(n_views);
    }

    /// Whether too few views carved the voxels for any joint to count as measured.
    pub fn is_of_few_views(&self) -> bool {
        self.contradiction.n_views.is_some_and(|it| it < LEAST_VIEWS)
    }

    /// Whether views contradict each other so much around this body that no joint counts as measured.
    pub fn is_contradicted(&self) -> bool {
        let Contradiction { share, at_head, lacking, .. } = self.contradiction;
        let levels = &self.options.levels;
        let [most_share, most_at_head] = levels.most_contested;
        share > most_share || at_head > most_at_head || lacking > levels.most_lacking[1]
    }
}

#[cfg(test)]
mod tests {
    use foveate_estimation::random::Random;

    use super::*;
    use crate::body::drawn::{self, followed};
    use crate::body::field::ENDLESS;
    use crate::body::{JointEstimate, JointSource};

    fn measured(tracker: &BodyTracker) -> usize {
        tracker.joints().iter().filter(|it| it.source == JointSource::Measured).count()
    }

    fn sigma(tracker: &BodyTracker) -> f64 {
        let one = |it: &JointEstimate| it.covariance.fixed_view::<3, 3>(0, 0).trace();
        tracker.joints().iter().map(one).fold(0.0, f64::max).sqrt()
    }

    #[test]
    fn what_views_disagree_on_near_a_body_or_its_head_leaves_none_of_it_measured_for_a_second() {
        let field = drawn::field(&drawn::somebody());
        let mut tracker = followed(&field);
        let (all, exact) = (measured(&tracker), sigma(&tracker));
        assert!(all >= 12, "{all}");
        let (torso, head) = (tracker.filter.body.torso, tracker.filter.body.joint(Joint::Head));
        let volume = field.len() as f64 * field.size().powi(3);
        let floor = Point3::new(torso.x, torso.y, tracker.filter.body.joint(Joint::LeftAnkle).z);
        // On the floor, far away, or little: as before.
        tracker.set_contested(&[(floor, volume), (torso + Vector3::x() * 1.5, volume), (torso, 0.01 * volume)]);
        assert!(measured(&tracker) == all && sigma(&tracker) < exact + 0.01, "{}", sigma(&tracker));
        let beside = torso + Vector3::x() * 0.2;
        tracker.set_contested(&[(beside, 0.2 * volume)]);
        assert!(measured(&tracker) == 0 && sigma(&tracker) > exact.hypot(0.1), "{}", sigma(&tracker));
        // It lasts, and ends.
        let mut frames = 0;
        while measured(&tracker) == 0 && frames < 100 {
            tracker.step(&field, 0.04, &[]);
            tracker.set_contested(&[]);
            frames += 1;
        }
        assert!((1..50).contains(&frames) && measured(&tracker) == all, "{frames}");
        let mut tracker = followed(&field);
        tracker.set_contested(&[(head + Vector3::z() * 0.2, 0.004)]);
        assert_eq!(measured(&tracker), 0);
    }

    #[test]
    fn holes_in_silhouettes_make_a_body_vaguer_and_a_part_with_many_is_not_measured() {
        let mut random = Random::new(7);
        let person = drawn::Stance { stature: 1.75, arms: [0.6; 2], ..drawn::Stance::upright(&mut random) }.drawn().0;
        let cameras = drawn::ring(8, &mut random);
        let (origin, cells) = drawn::hull_cells(&person, &cameras, 0.025);
        let field = |cells: &[[u16; 3]]| VoxelField::new(0.025, &origin, cells, ENDLESS).unwrap();
        let whole = followed(&field(&cells));
        assert!(whole.contradiction.lacking < 0.03, "{:?}", whole.contradiction);
        let torso = whole.filter.body.torso;
        let mut before = (whole.contradiction.lacking, sigma(&whole));
        for radius in [0.05, 0.12] {
            // Four views of eight have a hole each before the trunk.
            let lost: Vec<_> =
                (0..4).map(|it| (cameras[2 * it], torso + Vector3::z() * (0.1 * it as f64 - 0.15), radius)).collect();
            let mut holed = whole.clone();
            holed.step(&field(&drawn::without(&origin, &cells, 0.025, &lost)), 0.04, &[]);
            let now = (holed.contradiction.lacking, sigma(&holed));
            assert!(now.0 > before.0 + 0.03 && now.1 > before.1 + 0.002, "{radius}: {now:?} after {before:?}");
            let lacks = holed.contradiction.lacks_of(Part::Torso);
            assert_eq!(holed.shows(Part::Torso), lacks <= 0.3, "{radius}: {lacks}");
            before = now;
        }
        assert!(before.0 > 0.15, "{before:?}");
    }

    #[test]
    fn of_two_views_nothing_is_measured_and_of_three_it_is_vaguer() {
        let field = drawn::field(&drawn::somebody());
        let tracker = drawn::followed(&field);
        let of = |n_views: usize| {
            let mut tracker = tracker.clone();
            tracker.set_n_views(n_views);
            (tracker.shows(Part::Torso), tracker.is_of_few_views(), tracker.contradiction.sigma())
        };
        let enough = tracker.contradiction.sigma();
        assert_eq!(of(4), (true, false, enough));
        assert_eq!(of(3), (true, false, enough.hypot(0.04)));
        assert_eq!([1, 2].map(of), [(false, true, enough.hypot(0.15)); 2]);
    }
}
