//! The facing direction of a body: which side is its front. Voxels of a standing person look the same from front and back; anatomy and motion decide.
//!
//! | cue | what it says |
//! |---|---|
//! | legs | thighs bend to the front, by up to 120°, rather than to the back, by up to 30°; knees bend so that the feet go back. The mean of both legs counts: a stride cancels out |
//! | feet | stick out to the front of the shins |
//! | hands | work in front of the trunk: shoulders reach back by 60° only |
//! | head | is held in front of the shoulders, for an upright trunk |
//! | elbows | bend so that the hands go to the front, for arms that hang |
//! | walking | goes forward, nearly always |
//!
//! There are two hypotheses: the front is where the torso's x points, or it is behind. Voxels fit both equally well,
//! for the model is the same from both sides, so one body is tracked for both; the difference is the log-odds.
//! Successive frames repeat each other: the mean of each cue over the last seconds counts, weighted as in a logistic
//! regression. So a person who walks backwards all day is still decided by knees and feet. The front is reversed only
//! once the odds are `TURNS` against it; after that they are as much in favour of the new one, so that it takes twice
//! that to reverse again.

use nalgebra::{Point3, Vector3};

use super::field::VoxelField;
use super::filter::BodyFilter;
use super::parts::{Joint, Limb, Part, SHOULDER_UP};

/// Log-odds against the front from which on it is turned about.
const TURNS: f64 = 1.0;

/// A front with these odds is sure [–].
pub(super) const SURE: f64 = 4.0;

const N_WITNESSES: usize = 6;

/// Log-odds that a witness is worth where it speaks as clearly as it usually does (1): of legs, feet, hands, head, elbows, walking. A logistic regression on the means over a second of people of six recordings,
/// in hulls of four and eight views with voxels of 20 and 50 mm, gives 2.2, 1.2, 3.1, 3.6, 1.7 and 0.3; hands and head, which depend on what people do, have less here.
const WEIGHTS: [f64; N_WITNESSES] = [2.0, 1.2, 1.5, 3.0, 1.2, 0.3];
/// No witness speaks more clearly than so [–].
const CLEAREST: f64 = 2.0;
/// What was said so long ago counts a third [s].
const MEMORY_S: f64 = 2.0;
/// What was heard for so long counts half of what it does in the end [s].
const HEARD_S: f64 = 0.2;

/// What speaks for the front that a body has, so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Facing {
    /// Of each witness, what it said times how long [s].
    sums: [f64; N_WITNESSES],
    /// How long it was heard, as far as that is remembered [s].
    heard_s: f64,
}

impl Facing {
    /// Hears what a body in voxels says, `dt_s` seconds of it. Of limbs only those `tell` that are known to lie where the filter has them: what bends in a skirt may be its folds.
    pub fn hear(&mut self, filter: &BodyFilter, field: &VoxelField, tell: impl Fn(Limb) -> bool, dt_s: f64) {
        self.take(&evidence(filter, field, tell), dt_s);
    }

    fn take(&mut self, evidence: &[f64; N_WITNESSES], dt_s: f64) {
        let kept = (-dt_s / MEMORY_S).exp();
        for (sum, it) in self.sums.iter_mut().zip(evidence) {
            *sum = *sum * kept + it.clamp(-CLEAREST, CLEAREST) * dt_s;
        }
        self.heard_s = self.heard_s * kept + dt_s;
    }

    /// Above 0: the front is where the torso's x points, more likely than not.
    pub fn log_odds(&self) -> f64 {
        let sum: f64 = self.sums.iter().zip(&WEIGHTS).map(|(sum, weight)| sum * weight).sum();
        sum / (self.heard_s + HEARD_S)
    }

    /// Whether it must be turned about; at the `start` there is nothing to hold on to.
    pub fn is_behind(&self, start: bool) -> bool {
        self.log_odds() < if start { 0.0 } else { -TURNS }
    }

    /// The body was turned about: what spoke against its front speaks for it.
    pub fn turn_about(&mut self) {
        self.sums = self.sums.map(|it| -it);
    }
}

/// How clearly each witness speaks for the front: below 0 against it, 1 as clearly as it usually does.
fn evidence(filter: &BodyFilter, field: &VoxelField, tell: impl Fn(Limb) -> bool) -> [f64; N_WITNESSES] {
    let body = &filter.body;
    let layout = filter.layout();
    let torso = body.turn(Part::Torso);
    let (front, up) = (torso * Vector3::x(), torso * Vector3::z());
    let mut legs = Mean::default();
    let (mut feet, mut hands, mut elbows) = (Mean::default(), Mean::default(), Mean::default());
    for limb in Limb::ALL {
        let [upper, lower] = limb.parts();
        if !(layout.has(lower) && tell(limb)) {
            continue;
        }
        let [u, v] = [upper, lower].map(|it| body.turn(it) * Vector3::z());
        // How far the lower part's upward direction points to the front of the upper part's line.
        let bent = (v - u * v.dot(&u)).dot(&front);
        let upright = u.dot(&up).max(0.0);
        if limb.is_leg() {
            legs.add(bent * upright - u.dot(&front));
            if let Some(foot) = foot(filter, field, lower, limb.mirrored().parts()[1]) {
                feet.add(foot.dot(&front));
            }
        } else {
            let wrist = if limb == Limb::LeftArm { Joint::LeftWrist } else { Joint::RightWrist };
            hands.add((body.joint(wrist) - body.torso).dot(&front));
            elbows.add(-bent * upright * upright);
        }
    }
    let neck = body.place(Part::Torso, &Vector3::new(0.0, 0.0, SHOULDER_UP));
    // Who stoops looks ahead, with the head behind the line of the trunk: from 37° on it says nothing, up to 18° all.
    let head = (body.centre(Part::Head) - neck).dot(&front) * ((up.z - 0.8) / 0.15).clamp(0.0, 1.0);
    // Across the floor, along the axis that is the front.
    let walks = if up.z.abs() > 0.8 { dead(filter.velocity.dot(&front), 0.25) } else { 0.0 };
    [
        dead(legs.value(), 0.05) / 0.3,
        dead(feet.value(), 0.005) / 0.03,
        dead(hands.value(), 0.1) / 0.2,
        head / 0.06,
        dead(elbows.value(), 0.2) / 0.4,
        walks / 0.5,
    ]
}

#[derive(Default)]
struct Mean {
    sum: f64,
    n: f64,
}

impl Mean {
    fn add(&mut self, value: f64) {
        self.sum += value;
        self.n += 1.0;
    }

    fn value(&self) -> f64 {
        self.sum / self.n.max(1.0)
    }
}

fn dead(value: f64, zone: f64) -> f64 {
    value.signum() * (value.abs() - zone).max(0.0)
}

/// From the shin on, as its voxels lie, to the middle of the voxels about the sole, at right angles to the calf [m]. What is nearer to the other calf is not looked at.
fn foot(filter: &BodyFilter, field: &VoxelField, calf: Part, other: Part) -> Option<Vector3<f64>> {
    let body = &filter.body;
    let axis = body.turn(calf) * Vector3::z();
    let sole = body.place(calf, &-Vector3::z());
    let length = 2.0 * body.size(calf).z;
    let (other_axis, other_sole) = (body.turn(other) * Vector3::z(), body.place(other, &-Vector3::z()));
    let is_other = |place: &Point3<f64>, across: f64| {
        let away = place - other_sole;
        let along = away.dot(&other_axis).clamp(0.0, length);
        filter.layout().has(other) && (away - other_axis * along).norm() < across
    };
    let (mut low, mut shin) = ((Vector3::zeros(), 0), (Vector3::zeros(), 0));
    for &cell in field.voxels() {
        let place = field.centre(cell);
        let away = place - sole;
        let along = away.dot(&axis);
        let across = (away - axis * along).norm();
        let to = match along / length {
            _ if (-0.06..0.09).contains(&along) && across < 0.30 => &mut low,
            share if (0.35..0.75).contains(&share) && across < 0.15 => &mut shin,
            _ => continue,
        };
        if !is_other(&place, across) {
            to.0 += away;
            to.1 += 1;
        }
    }
    if low.1 < 3 || shin.1 < 3 {
        return None;
    }
    let off = low.0 / f64::from(low.1) - shin.0 / f64::from(shin.1);
    Some(off - axis * off.dot(&axis))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::body::drawn;

    fn heard(evidence: [f64; N_WITNESSES], frames: usize, before: Facing) -> Facing {
        let mut facing = before;
        (0..frames).for_each(|_| facing.take(&evidence, 1.0 / 30.0));
        facing
    }

    #[test]
    fn one_witness_alone_does_not_outweigh_the_rest_however_long_it_speaks() {
        let walks_back = heard([0.5, 0.3, 0.0, 0.0, 0.0, -1.0], 3000, Facing::default());
        assert!(walks_back.log_odds() > 0.5 * TURNS, "{}", walks_back.log_odds());
        let one = heard([0.0, 0.0, 0.0, 0.0, 0.0, -9.0], 3000, Facing::default());
        assert!(!one.is_behind(false) && one.is_behind(true));
    }

    #[test]
    fn limbs_that_may_lie_elsewhere_are_not_heard() {
        let field = drawn::field(&drawn::somebody());
        let tracker = drawn::followed(&field);
        let [all, legs, none] = [|_| true, Limb::is_leg, |_| false].map(|it| evidence(tracker.filter(), &field, it));
        assert!(all[0] != 0.0 && all[1] != 0.0 && legs[..2] == all[..2], "{all:?} {legs:?}");
        assert_eq!([legs[2], legs[4], none[0], none[1], none[2], none[4]], [0.0; 6]);
        assert!(none[3] == all[3] && none[5] == all[5], "{none:?}");
    }

    #[test]
    fn a_first_look_counts_less_than_a_second_does() {
        let evidence = [0.3, 0.2, 0.0, 0.4, 0.0, 0.0];
        let [first, second] = [8, 30].map(|frames| heard(evidence, frames, Facing::default()).log_odds());
        assert!(first > 0.0 && first < 0.75 * second, "{first}, {second}");
    }

    #[test]
    fn evidence_that_wavers_does_not_turn_the_front_and_evidence_that_is_clear_does_and_stays() {
        let mut facing = heard([0.3, 0.1, 0.0, 0.0, 0.0, 0.0], 30, Facing::default());
        for frame in 0..600 {
            // A stride: to and fro, ten frames each, and a little against the front on the whole.
            let sign = if frame / 10 % 2 == 0 { 1.0 } else { -1.0 };
            facing.take(&[sign * 0.6 - 0.05, 0.0, 0.0, 0.0, 0.0, 0.0], 1.0 / 30.0);
            assert!(!facing.is_behind(false), "{frame}: {}", facing.log_odds());
        }
        let frames = (0..60).find(|_| {
            facing = heard([-1.0, -1.0, 0.0, 0.0, 0.0, 0.0], 1, facing);
            facing.is_behind(false)
        });
        assert!(frames.is_some_and(|it| it > 10), "{frames:?}");
        // What spoke against it speaks for it now: a whole stride the other way does not bring it back, two seconds of clear evidence do.
        facing.turn_about();
        let back = heard([-0.6, 0.0, 0.0, 0.0, 0.0, 0.0], 10, facing);
        assert!(facing.log_odds() >= TURNS && !back.is_behind(false), "{}", back.log_odds());
        assert!(heard([-1.0, -1.0, 0.0, 0.0, 0.0, 0.0], 60, facing).is_behind(false));
    }
}
