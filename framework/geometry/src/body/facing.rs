//! Which way a body looks. Voxels of somebody who stands still look the same from front and back; what tells is how bodies are built and how they move.
//!
//! | witness | says |
//! |---|---|
//! | legs | thighs go to the front, by up to 120°, rather than to the back, by up to 30°; knees bend so that the feet go back. Of both legs the mean: of a stride nothing is left |
//! | feet | stick out to the front of the shins |
//! | hands | are at work before the trunk: shoulders reach back by 60° only |
//! | head | is held before the shoulders |
//! | elbows | of arms that hang bend so that the hands go to the front |
//! | walking | goes ahead, nearly always |
//!
//! There are two hypotheses: the front is where the torso's x points, or it is behind. Voxels fit both as well, for the model is the same from both sides, so one body is followed for both; what
//! differs is the log-odds. Frames that follow each other say the same thing again: each witness adds up over time, and none for more than its `most`, however long it speaks.
//! So somebody who walks backwards all day is followed by knees and feet. The front is turned about only once the odds are `TURNS` against it; after that they are as much in favour of the new one, so that
//! it takes twice that to turn back.

use nalgebra::{Point3, Vector3};

use super::field::VoxelField;
use super::filter::BodyFilter;
use super::parts::{Joint, Limb, Part, SHOULDER_UP};

/// Log-odds against the front from which on it is turned about.
const TURNS: f64 = 1.0;

/// A front with these odds is sure [–].
pub(super) const SURE: f64 = 4.0;

/// Of one kind of evidence: what it is worth in a second at its clearest, and how much it counts at most.
struct Witness {
    per_second: f64,
    most: f64,
}

const N_WITNESSES: usize = 6;

/// Legs, feet, hands, head, elbows, walking. Weights follow how often each was right on simulated people that are not in the figures: legs and feet nearly always, elbows and walking in three of four cases.
const WITNESSES: [Witness; N_WITNESSES] = [
    Witness { per_second: 4.0, most: 2.5 },
    Witness { per_second: 3.0, most: 2.0 },
    Witness { per_second: 1.5, most: 1.5 },
    Witness { per_second: 1.0, most: 1.0 },
    Witness { per_second: 1.0, most: 0.7 },
    Witness { per_second: 0.8, most: 0.8 },
];

/// What speaks for the front that a body has, so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Facing {
    sums: [f64; N_WITNESSES],
}

impl Facing {
    /// Hears what a body in voxels says, `dt_s` seconds of it.
    pub fn hear(&mut self, filter: &BodyFilter, field: &VoxelField, dt_s: f64) {
        self.take(&evidence(filter, field), dt_s);
    }

    fn take(&mut self, evidence: &[f64; N_WITNESSES], dt_s: f64) {
        for ((sum, it), witness) in self.sums.iter_mut().zip(evidence).zip(&WITNESSES) {
            *sum = (*sum + it.clamp(-1.0, 1.0) * witness.per_second * dt_s).clamp(-witness.most, witness.most);
        }
    }

    /// Above 0: the front is where the torso's x points, more likely than not.
    pub fn log_odds(&self) -> f64 {
        self.sums.iter().sum()
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

/// How clearly each witness speaks for the front, from −1 to 1.
fn evidence(filter: &BodyFilter, field: &VoxelField) -> [f64; N_WITNESSES] {
    let body = &filter.body;
    let layout = filter.layout();
    let torso = body.turn(Part::Torso);
    let (front, up) = (torso * Vector3::x(), torso * Vector3::z());
    let mut legs = Mean::default();
    let (mut feet, mut hands, mut elbows) = (Mean::default(), Mean::default(), Mean::default());
    for limb in Limb::ALL {
        let [upper, lower] = limb.parts();
        if !layout.has(lower) {
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
    let head = (body.centre(Part::Head) - neck).dot(&front);
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

    fn heard(evidence: [f64; N_WITNESSES], frames: usize, before: Facing) -> Facing {
        let mut facing = before;
        (0..frames).for_each(|_| facing.take(&evidence, 1.0 / 30.0));
        facing
    }

    #[test]
    fn one_witness_alone_does_not_outweigh_the_rest_however_long_it_speaks() {
        let walks_back = heard([0.5, 0.3, 0.0, 0.0, 0.0, -1.0], 3000, Facing::default());
        assert!(walks_back.log_odds() > 0.5 * SURE, "{}", walks_back.log_odds());
        let one = heard([0.0, 0.0, 0.0, 0.0, 0.0, -1.0], 3000, Facing::default());
        assert!(!one.is_behind(false) && one.is_behind(true));
    }

    #[test]
    fn evidence_that_wavers_does_not_turn_the_front_to_and_fro() {
        let mut facing = Facing::default();
        let mut n_turned = 0;
        for frame in 0..600 {
            // A stride: to and fro, ten frames each, and a little against the front on the whole.
            let sign = if frame / 10 % 2 == 0 { 1.0 } else { -1.0 };
            facing.take(&[sign * 0.6 - 0.05, 0.0, 0.0, 0.0, 0.0, 0.0], 1.0 / 30.0);
            if facing.is_behind(false) {
                facing.turn_about();
                n_turned += 1;
                // What spoke against it speaks for it now, and would go on to.
                facing = heard([0.05, 0.0, 0.0, 0.0, 0.0, 0.0], 1, facing);
                break;
            }
        }
        assert_eq!(n_turned, 1);
        assert!(facing.log_odds() >= TURNS && !facing.is_behind(false));
        // From there on a whole stride the other way does not bring it back.
        let back = heard([-0.6, 0.0, 0.0, 0.0, 0.0, 0.0], 10, facing);
        assert!(!back.is_behind(false), "{}", back.log_odds());
        // Two seconds of clear evidence do.
        assert!(heard([-1.0, -1.0, 0.0, 0.0, 0.0, 0.0], 60, facing).is_behind(false));
    }
}
