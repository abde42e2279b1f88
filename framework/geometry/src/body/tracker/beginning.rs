//! Acquisition with and without a child: a body of the expected stature, or a smaller one.
//!
//! Voxels too low for a standing person of the expected stature are those of a crouching or sitting adult, or of a
//! child. Both are tried. A child stands on straight legs; a person as low on straight legs is no adult.

use nalgebra::Vector3;

use super::super::acquire::{AcquisitionFailure, HeadFound, TrunkFound, body_of, find_heads, find_torso};
use super::super::facing::Facing;
use super::super::field::VoxelField;
use super::super::filter::BodyFilter;
use super::super::fit::Support;
use super::super::layout::Layout;
use super::super::parts::{Limb, Part};
use super::super::proportions::{Proportions, STANDING_SPREAD, share};
use super::contradiction::Contradiction;
use super::{BodyTracker, LimbLevel, LimbTrack, TrackerOptions, UPRIGHT};

/// So often at the beginning [–]: once for each limb.
const REACHES: usize = 4;
/// What is begun is too unlike a person above this sum of squares [–]. People in hulls of 2 to 20 views, real ones on chairs included, have 1.1 at most; chairs, boxes and plants 1.7 and more.
const MOST_DOUBT: f64 = 1.4;
/// A head of which so much is there above an upright trunk is one, though limbs are odd: two people who embrace have limbs in common [–]. Of chairs' and cupboards' 0.83 and less is there, or the trunk lies; plants
/// have such heads, and limbs that are odder than so much doubt.
const CLEAR_HEAD: f64 = 0.9;
const CLEAR_DOUBT: f64 = 4.0;
/// For a standing person with plausible arms, so much of a head is enough, and legs may be implausible: they are in a skirt [–].
const CLOTHED_HEAD: f64 = 0.85;
/// … with arms of which each is no more unusual, as half of a sum of four squares: those of three people in five [–].
const USUAL_ARM: f64 = 2.0;
/// Where the volume cuts a body off, shoulders and chests below its end look like heads; of a head, so much is there, and so much where limbs are cut off too or are none [–]. Chosen on 40 people who are cut off at
/// nine heights and seven places beside the head, in hulls of 4 and 8 views: of 84 heads that were none 83 have less, of 269 others 41, most of them heads that are cut themselves.
const CUT_OFF: f64 = 0.75;
const CUT_OFF_LIMBS: f64 = 0.85;
/// Radius of a head with hair in a hull, and how far it varies [m]: heads of 0.155 m × 0.19 m × 0.23 m (Winter, figure 4.1) are balls of 0.095 m.
const HEAD_RADIUS: f64 = 0.095;
const HEAD_SPREAD: f64 = 0.02;

impl BodyTracker {
    /// Acquires a body in voxels without a prior.
    ///
    /// # Errors
    /// The step that failed; to be tried again in another frame.
    pub fn acquire(field: &VoxelField, options: &TrackerOptions) -> Result<Self, AcquisitionFailure> {
        let wanted = &options.acquisition;
        let volume = field.len() as f64 * field.size().powi(3);
        if volume < wanted.least_volume {
            return Err(AcquisitionFailure::Small { found: volume, expected: wanted.least_volume });
        }
        let (heads, best) = find_heads(field, wanted);
        if heads.is_empty() {
            return Err(AcquisitionFailure::Head { found: best, expected: wanted.crust_share });
        }
        let heights = field.voxels().iter().map(|&it| field.centre(it).z);
        let [lowest, highest] = heights.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], it| [a.min(it), b.max(it)]);
        let expected = heads.iter().map(|it| (it, None));
        let children = heads.iter().filter_map(|it| Some((it, Some(child(field, it, lowest, &options.proportions)?))));
        let mut trunks: Vec<(TrunkFound, Option<Proportions>)> = expected
            .chain(children)
            .filter_map(|(head, child)| {
                let found = find_torso(field, head, child.as_ref().unwrap_or(&options.proportions));
                found.map(|it| (it, child))
            })
            .collect();
        let of_expected = |trunks: &[(TrunkFound, Option<Proportions>)], what: fn(&TrunkFound) -> f64| {
            trunks.iter().filter(|it| it.1.is_none()).map(|it| what(&it.0)).reduce(f64::max)
        };
        let filled = of_expected(&trunks, |it| it.filled).unwrap_or(0.0);
        trunks.retain(|it| it.0.filled >= wanted.torso_filled);
        let mut failure = match of_expected(&trunks, |it| it.up.z) {
            Some(found) => AcquisitionFailure::Hanging { found, expected: wanted.least_up },
            None => AcquisitionFailure::Torso { found: filled, expected: wanted.torso_filled },
        };
        trunks.retain(|(trunk, child)| trunk.up.z >= if child.is_some() { UPRIGHT } else { wanted.least_up });
        // The best as tall as is expected, and the best child.
        let mut best: [Option<(f64, BodyTracker)>; 2] = [None, None];
        for (trunk, child) in &trunks {
            let begun = Self::begin(field, options, trunk, child.as_ref());
            match begun {
                Ok(tracker) if child.is_none() || tracker.is_child() => {
                    // The one that explains most of the voxels, with a head of common size, high up on an upright torso.
                    let size = (trunk.head.radius - HEAD_RADIUS) / HEAD_SPREAD;
                    let score = trunk.head.crust_share + trunk.filled
                        - 2.0 * tracker.support.unexplained
                        - 0.4 * (1.0 - trunk.up.z)
                        + (trunk.head.centre.z - lowest) / (highest - lowest)
                        - 0.1 * size * size;
                    let best = &mut best[usize::from(child.is_some())];
                    if best.as_ref().is_none_or(|it| score > it.0) {
                        *best = Some((score, tracker));
                    }
                }
                Err(why) if child.is_none() => failure = why,
                _ => {}
            }
        }
        let [expected, child] = best.map(|it| it.map(|it| it.1));
        match (expected, child) {
            // Who is low on straight legs would be as tall as people are, if grown up.
            (Some(it), Some(child)) if child.support.unexplained < it.support.unexplained + CHILD_REST => Ok(child),
            (Some(it), _) => Ok(it),
            (None, Some(child)) if child.support.covered[Part::Head.index()] >= CLEAR_HEAD => Ok(child),
            _ => Err(failure),
        }
    }

    /// Whether only the legs of a standing person with so much of a head are implausible, since they do not show in a skirt.
    fn is_in_skirt(&self, head: f64) -> bool {
        let arms = [Limb::LeftArm, Limb::RightArm];
        let is_usual = |it: &Limb| self.level(*it) != LimbLevel::Absent && self.unusual(*it) <= USUAL_ARM;
        let of_arms = arms.map(|it| self.unusual(it)).iter().sum();
        head >= CLOTHED_HEAD
            && self.upright() >= UPRIGHT
            && arms.iter().all(is_usual)
            && self.doubt(of_arms) <= MOST_DOUBT
    }

    /// Whether what was begun as a child is one: with a head, on straight legs.
    fn is_child(&self) -> bool {
        self.support.covered[Part::Head.index()] >= CHILD_HEAD && self.legs_upright() > CHILD_LEGS
    }

    /// Cosine of the angle from upright of that part of both legs that is farthest from it.
    fn legs_upright(&self) -> f64 {
        let parts = [Part::LeftThigh, Part::LeftCalf, Part::RightThigh, Part::RightCalf];
        let has = |it: Part| self.filter.layout().has(it);
        let upright =
            |it: Part| if has(it) { (self.filter.body.turns[it.index()] * Vector3::z()).z.abs() } else { 1.0 };
        let all = [Limb::LeftLeg, Limb::RightLeg].into_iter().all(|it| self.level(it) != LimbLevel::Absent);
        if all { parts.map(upright).into_iter().fold(1.0, f64::min) } else { 0.0 }
    }

    fn begin(
        field: &VoxelField,
        options: &TrackerOptions,
        trunk: &TrunkFound,
        child: Option<&Proportions>,
    ) -> Result<BodyTracker, AcquisitionFailure> {
        let standing = child
            .cloned()
            .or_else(|| standing(field, trunk.head.centre.z + trunk.head.radius, trunk.up.z, &options.proportions));
        let length = standing.as_ref().map_or(trunk.length, |it| {
            // The place where legs part is known for legs that do; for others it is far below.
            let expected = 2.0 * share(Part::Torso).z * it.stature;
            (trunk.length.clamp(0.85 * expected, 1.15 * expected) + expected) / 2.0
        });
        let stands = standing.is_some();
        let proportions = standing.unwrap_or_else(|| options.proportions.clone());
        let body = body_of(&TrunkFound { length, ..trunk.clone() }, &proportions);
        let layout = Layout::new(|it| !it.is_limb());
        let filter = BodyFilter::new(body, layout, &proportions.covariance(), &options.beginning);
        let mut tracker = Self {
            options: options.clone(),
            // Children differ from each other as adults do.
            child: child.map(|it| Proportions { stature_spread: options.proportions.stature_spread, ..it.clone() }),
            filter,
            limbs: std::array::from_fn(|_| LimbTrack { level: LimbLevel::Absent, weak_s: 0.0, straight_s: 0.0 }),
            support: Support::default(),
            facing: Facing::default(),
            trunk_weak_s: 0.0,
            is_lost: false,
            frame: 0,
            next_look: 0,
            wait: 1,
            room: [1.0; 4],
            beyond: [0.0; 2],
            shared: [false; 4],
            contradiction: Contradiction::default(),
            share: 1.0,
            voxel: field.size(),
            last: None,
        };
        let begin = tracker.filter.clone();
        tracker.update(field, &[], 8);
        tracker.search_absent(field);
        tracker.update(field, &[], 8);
        tracker.reach_for_rest(field, &[], REACHES);
        for limb in Limb::ALL {
            tracker.try_elsewhere(field, limb);
        }
        // All of it again from the start, so that nothing counts twice.
        let (layout, body) = (*tracker.filter.layout(), tracker.filter.body.clone());
        tracker.filter = begin;
        tracker.filter.set_parts(layout, &body, &options.beginning);
        tracker.filter.body.turns = body.turns;
        tracker.filter.body.torso = body.torso;
        tracker.update(field, &[], 10);
        tracker.unfold_legs(field, &[]);
        for part in [Part::Head, Part::Torso] {
            let (inside, covered) = (tracker.support.inside[part.index()], tracker.support.covered[part.index()]);
            if inside < 0.75 || covered < 0.3 {
                return Err(AcquisitionFailure::Fit { part: part.name(), inside, covered });
            }
        }
        let head = tracker.support.covered[Part::Head.index()];
        let doubt = tracker.doubt(tracker.unusual_limbs());
        let is_unlike = doubt > MOST_DOUBT && !(stands && tracker.is_in_skirt(head));
        if field.is_cut_off() {
            let expected = if is_unlike { CUT_OFF_LIMBS } else { CUT_OFF };
            if head < expected {
                return Err(AcquisitionFailure::CutOff { head, expected });
            }
        } else if is_unlike && !(head >= CLEAR_HEAD && tracker.upright() >= UPRIGHT && doubt <= CLEAR_DOUBT) {
            return Err(AcquisitionFailure::Unlike { head, limbs: tracker.sigmas_of_limbs() });
        }
        if tracker.support.unexplained > options.acquisition.most_unexplained {
            return Err(AcquisitionFailure::Rest {
                found: tracker.support.unexplained,
                expected: options.acquisition.most_unexplained,
            });
        }
        // What one frame says counts as much as a quarter of a second does.
        tracker.look_around(field);
        tracker.hear_facing(field, 0.25);
        if tracker.facing.is_behind(true) {
            tracker.turn_about();
        }
        tracker.judge_limbs(0.0);
        tracker.look_inside(field, 0.0);
        Ok(tracker)
    }
}

/// Proportions of a standing person: with an upright trunk a person usually stands, and is about as tall as the voxels are high below the `top` of the head; `up` is the cosine between trunk and vertical. `None` for a sitting or crouching person, who is far below that.
pub(super) fn standing(field: &VoxelField, top: f64, up: f64, expected: &Proportions) -> Option<Proportions> {
    // They are in the order of their heights.
    let lowest = field.centre(*field.voxels().first()?).z - field.size() / 2.0;
    let height = top - lowest;
    let is_likely = (height / expected.stature - 1.0).abs() < 2.5 * expected.stature_spread;
    // Knees that bend and legs apart take some percent, shoes and hair give some.
    let stature_spread = STANDING_SPREAD.min(expected.stature_spread);
    (up > 0.85 && is_likely).then(|| Proportions { stature: height, stature_spread, ..expected.clone() })
}

/// Proportions of a standing child with this head on top, if the voxels are too low for a standing person of the
/// expected stature.
fn child(field: &VoxelField, head: &HeadFound, lowest: f64, expected: &Proportions) -> Option<Proportions> {
    let height = head.centre.z + head.radius - lowest + field.size() / 2.0;
    let is_low = height < expected.stature * (1.0 - 2.5 * expected.stature_spread) && height > LEAST_CHILD;
    is_low.then(|| Proportions { stature: height, stature_spread: STANDING_SPREAD, ..expected.clone() })
}

/// No standing person is lower than this: of children of two years 19 in 20 are taller [m].
const LEAST_CHILD: f64 = 0.80;

/// A child stands on legs whose parts are no farther from upright than this [cosine]: parts of a standing child's are at 0.75 or more, of adults who crouch as low at 0.65 or less.
const CHILD_LEGS: f64 = 0.75;

/// Of a child's head, so much of the skin is there [–]: silhouettes that lose the head of an adult make a lower body, whose chest looks like a head.
const CHILD_HEAD: f64 = 0.85;

/// A child may leave so much more of the skin unexplained than an adult who crouches [–].
const CHILD_REST: f64 = 0.01;

#[cfg(test)]
mod tests {
    use super::super::super::drawn;
    use super::*;

    #[test]
    fn odd_legs_are_those_of_somebody_in_a_skirt_and_odd_arms_of_nobody() {
        let field = drawn::field(&drawn::somebody());
        let tracker = drawn::followed(&field);
        let thicker = |parts: [Part; 4], by: f64| {
            let mut odd = tracker.clone();
            parts.iter().for_each(|it| odd.filter.body.sizes[it.index()].x *= by);
            [odd.doubt(odd.unusual_limbs()) > MOST_DOUBT, odd.is_in_skirt(0.9), odd.is_in_skirt(0.8)]
        };
        let legs = [Part::LeftThigh, Part::RightThigh, Part::LeftCalf, Part::RightCalf];
        let arms = [Part::LeftUpperArm, Part::RightUpperArm, Part::LeftLowerArm, Part::RightLowerArm];
        assert_eq!(thicker(legs, 1.0), [false, true, false]);
        assert_eq!(thicker(legs, 2.5), [true, true, false]);
        assert_eq!(thicker(arms, 2.5), [true, false, false]);
    }
}
