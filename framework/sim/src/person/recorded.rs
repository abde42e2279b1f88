//! A body that moves as a recorded skeleton did, over and over.
//!
//! Of the recording only what bends the body is taken: the directions of the limbs, how the shoulders and the head turn. Place and heading are those of the
//! person's own walk, the bones are ours, and the body stands as high as its lower foot asks for.
//!
//! 1. Thirty times a second the directions are read, relative to the hips' heading (those of the arms to the shoulders').
//! 2. Of all stretches of two seconds and more, the longest is taken out of those whose end is nearly as much like their beginning as it gets.
//! 3. The last third of a second of it is blended into what led up to its beginning.
//! 4. What is left is the control polygon of a closed uniform cubic B-spline: smooth to the second derivative everywhere.
//!
//! Where the recorded body walked at an even speed its steps follow the way walked, so that feet do not slide; otherwise time.

use std::f64::consts::TAU;

use foveate_estimation::random::Random;
use foveate_scene::skeleton::{SkeletonMotion, z_up_from_y_up};
use nalgebra::{SVector, Vector3};

use super::body::{FOOT, HIPS, SHANK, THIGH};
use super::joints::{HEAD, find_joints};
use super::posture::Posture;
use super::upright;

/// How often the recording is read [Hz].
const RATE_HZ: f64 = 30.0;
/// The shortest stretch [s].
const SHORTEST_S: f64 = 2.0;
/// As much of a recording is looked at [s].
const LONGEST_S: f64 = 60.0;
/// How long the end is blended into the beginning [s].
const BLEND_S: f64 = 1.0 / 3.0;
/// Stretches whose ends differ by this times the least difference are as good [–].
const AS_GOOD: f64 = 1.5;
/// Or by this, for all limbs together: the square of the distance of directions [–].
const ALIKE: f64 = 0.02;
/// Above this a body walks [m/s], if its speed varies by less than [`EVEN`] of the mean.
const WALKS_M_S: f64 = 0.3;
const EVEN: f64 = 0.35;
/// Shoulders and head turn at most this far from the hips [rad].
const MOST_TURN: [f64; 2] = [0.8, 1.1];

/// Rise, twist, look, nod, tilt, then the eight directions: arms and legs, left and right, upper and lower.
const N_CHANNELS: usize = 5 + 8 * 3;
type Channels = SVector<f64, N_CHANNELS>;

/// A recorded body.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedBody {
    /// The control points of the closed spline.
    controls: Vec<Channels>,
    /// After so many metres the recording begins again; `None`: it runs with the time.
    stride: Option<f64>,
}

impl RecordedBody {
    /// Of a BVH recording with y up, whose skeleton looks along z where no joint is turned. Its unit of length does not matter.
    ///
    /// # Errors
    /// A sentence: a joint that it lacks, or that it is too short.
    pub fn new(motion: &SkeletonMotion) -> Result<Self, String> {
        let duration_s = motion.n_frames() as f64 * motion.frame_s;
        let margin_s = SHORTEST_S + 2.0 * BLEND_S;
        if duration_s < margin_s {
            return Err(format!("found {duration_s:.2} s of motion, expected {margin_s:.2} s or more"));
        }
        let joints = find_joints(motion)?;
        let count = (duration_s.min(LONGEST_S) * RATE_HZ) as usize;
        let (mut moments, mut all_places) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for i in 0..count {
            let frame = (i as f64 / RATE_HZ / motion.frame_s).round() as usize;
            let Some(poses) = motion.poses(frame, 1.0) else { break };
            all_places.push(joints.map(|it| poses[it].translation.vector));
            let up = z_up_from_y_up();
            let places = joints.map(|it| up * poses[it].translation.vector);
            let turns = poses[joints[HEAD]].rotation;
            let head = [Vector3::z(), Vector3::x()].map(|it| up * (turns * it));
            moments.push(moment(&places, head).ok_or_else(|| {
                format!("found hips or shoulders one above the other in frame {}, expected an upright body", frame + 1)
            })?);
        }
        if let Some(up) = upright::of_motion(&all_places).filter(|it| *it != (1, true)) {
            let up = upright::in_words(up);
            return Err(format!(
                "found heads above ankles along {up}, expected y up: `motion = \"whole\"` takes any axis"
            ));
        }
        let [from, to] = stretch(&moments);
        let stride = walked(&moments[from..to]);
        let mut controls: Vec<Channels> = moments[from..to].iter().map(|it| it.channels).collect();
        let blend = (BLEND_S * RATE_HZ) as usize;
        let n = controls.len();
        for k in 0..blend {
            let share = smooth((k + 1) as f64 / (blend + 1) as f64);
            let before = moments[from - blend + k].channels;
            controls[n - blend + k] = controls[n - blend + k].lerp(&before, share);
        }
        // How somebody holds the head is a habit of the recorded person.
        let mean = controls.iter().sum::<Channels>() / n as f64;
        for control in &mut controls {
            for channel in [2, 3, 4] {
                control[channel] -= mean[channel];
            }
        }
        Ok(Self { controls, stride })
    }

    /// From one beginning to the next [s].
    fn length_s(&self) -> f64 {
        self.controls.len() as f64 / RATE_HZ
    }

    /// After `way` metres, at `time_s` seconds, `phase` of the recording ahead (0 to 1).
    pub(super) fn posture(&self, way: f64, time_s: f64, phase: f64) -> Posture {
        let rounds = self.stride.map_or(time_s / self.length_s(), |stride| way / stride) + phase;
        let n = self.controls.len();
        let at = rounds.rem_euclid(1.0) * n as f64;
        let (index, u) = (at as usize % n, at.fract());
        let v = 1.0 - u;
        // The blending functions of the uniform cubic B-spline.
        let weights = [v * v * v, 3.0 * u * u * u - 6.0 * u * u + 4.0, 3.0 * v * v * v - 6.0 * v * v + 4.0, u * u * u];
        let mut channels = Channels::zeros();
        for (k, weight) in weights.into_iter().enumerate() {
            channels += self.controls[(index + k) % n] * (weight / 6.0);
        }
        let direction = |place: usize| {
            let it = channels.fixed_rows::<3>(5 + 3 * place).into_owned();
            // Mixtures of opposite directions may be nothing; hanging down then.
            it.try_normalize(1e-9).unwrap_or(-Vector3::z())
        };
        let limbs = |first: usize| [0, 2].map(|side| [direction(first + side), direction(first + side + 1)]);
        Posture {
            rise: channels[0],
            sway: 0.0,
            twist: channels[1],
            look: channels[2],
            nod: channels[3],
            tilt: channels[4],
            arms: limbs(0),
            legs: limbs(4),
        }
    }

    /// Where in the recording one of several people begins, so that they do not move as one (0 to 1).
    pub(super) fn phase(random: &mut Random) -> f64 {
        random.uniform_in(0.0, TAU) / TAU
    }
}

/// The body in one frame of the recording.
struct Moment {
    channels: Channels,
    /// Middle of the hips on the floor, in lengths of our legs.
    place: [f64; 2],
}

/// From the joints' places with z up, and where the head looks and what is to its left; `None` where there is no heading.
fn moment(places: &[Vector3<f64>; 13], [looks, left_of_head]: [Vector3<f64>; 2]) -> Option<Moment> {
    let heading = |left: usize, right: usize| {
        let across = places[left] - places[right];
        let left = Vector3::new(across.x, across.y, 0.0).try_normalize(1e-9)?;
        Some([left.cross(&Vector3::z()), left, Vector3::z()])
    };
    let [body, chest] = [heading(0, 1)?, heading(6, 7)?];
    let within = |frame: &[Vector3<f64>; 3], it: Vector3<f64>| Vector3::from(frame.map(|axis| axis.dot(&it)));
    let bone = |frame: &[Vector3<f64>; 3], from: usize, to: usize| within(frame, places[to] - places[from]).normalize();
    let arms = [0, 1].map(|side| [bone(&chest, 6 + side, 8 + side), bone(&chest, 8 + side, 10 + side)]);
    let legs = [0, 1].map(|side| [bone(&body, side, 2 + side), bone(&body, 2 + side, 4 + side)]);
    let foot = |[thigh, shank]: [Vector3<f64>; 2]| HIPS + thigh.z * THIGH + shank.z * SHANK;
    let limited = |angle: f64, most: f64| most * (angle / most).tanh();
    let [chest, looks, left_of_head] = [chest[0], looks, left_of_head].map(|it| within(&body, it));
    let nod = -looks.z.clamp(-1.0, 1.0).asin();
    let mut channels = Channels::zeros();
    channels[0] = FOOT - foot(legs[0]).min(foot(legs[1]));
    channels[1] = limited(chest.y.atan2(chest.x), MOST_TURN[0]);
    channels[2] = limited(looks.y.atan2(looks.x), MOST_TURN[1]);
    channels[3] = limited(nod, MOST_TURN[0]);
    channels[4] = limited((left_of_head.z / nod.cos().max(0.1)).clamp(-1.0, 1.0).asin(), MOST_TURN[0]);
    for (place, direction) in arms.into_iter().chain(legs).flatten().enumerate() {
        channels.fixed_rows_mut::<3>(5 + 3 * place).copy_from(&direction);
    }
    let leg = (places[2] - places[0]).norm() + (places[4] - places[2]).norm();
    let middle = (places[0] + places[1]) / (2.0 * leg) * (THIGH + SHANK);
    channels.iter().all(|it| it.is_finite()).then_some(Moment { channels, place: [middle.x, middle.y] })
}

/// First moment, and the one behind the last, of the stretch to repeat; there is room for a blend before and behind it.
fn stretch(moments: &[Moment]) -> [usize; 2] {
    let blend = (BLEND_S * RATE_HZ) as usize;
    let shortest = (SHORTEST_S * RATE_HZ) as usize;
    let end = moments.len() - blend;
    // Over a few moments, so that speeds agree too.
    let difference = |a: usize, b: usize| {
        let limbs = |at: usize| moments[at].channels.fixed_rows::<24>(5);
        [0, 2, 4, 6].map(|ahead| (limbs(a + ahead) - limbs(b + ahead)).norm_squared()).iter().sum::<f64>() / 4.0
    };
    let pairs = || (blend..end).flat_map(move |from| (from + shortest..=end).map(move |to| [from, to]));
    let all: Vec<([usize; 2], f64)> =
        pairs().filter(|[_, to]| to + 6 < moments.len()).map(|[from, to]| ([from, to], difference(from, to))).collect();
    let least = all.iter().map(|it| it.1).fold(f64::INFINITY, f64::min);
    let good = all.iter().filter(|it| it.1 <= (AS_GOOD * least).max(ALIKE));
    good.max_by_key(|([from, to], _)| to - from).map_or([blend, end], |it| it.0)
}

/// How far the person walked meanwhile [m]; `None` where the person did not walk evenly.
fn walked(moments: &[Moment]) -> Option<f64> {
    // Half a second at a time: within a step everybody is faster and slower.
    let step = (RATE_HZ / 2.0) as usize;
    let speed = |pair: [&Moment; 2]| {
        let [a, b] = pair.map(|it| it.place);
        (b[0] - a[0]).hypot(b[1] - a[1]) * RATE_HZ / step as f64
    };
    let speeds: Vec<f64> = moments.iter().zip(moments.iter().skip(step)).map(|(a, b)| speed([a, b])).collect();
    let mean = speeds.iter().sum::<f64>() / speeds.len().max(1) as f64;
    let variance = speeds.iter().map(|it| (it - mean).powi(2)).sum::<f64>() / speeds.len().max(1) as f64;
    (mean > WALKS_M_S && variance.sqrt() < EVEN * mean).then_some(mean * moments.len() as f64 / RATE_HZ)
}

/// From 0 to 1 where `x` does, with slopes 0 at both ends.
fn smooth(x: f64) -> f64 {
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::super::gait::Gait;
    use super::super::sticks::{Limbs, skeleton};
    use super::*;

    /// A skeleton of sticks that does what the built-in gait does, at `speed` [m/s] and 100 Hz.
    fn walker(duration_s: f64, speed: f64) -> SkeletonMotion {
        let legs = Limbs { names: ["Hip", "Knee", "Ankle"], at: [9.0, 0.0, 0.0], lengths: [42.0; 2] };
        let arms = Limbs { names: ["Shoulder", "Elbow", "Wrist"], at: [18.0, 15.0, 0.0], lengths: [42.0; 2] };
        let joints = skeleton(("Chest", 40.0), 20.0, &legs, &arms);
        let gait = Gait::without_gestures(speed, &mut Random::new(4));
        let mut values = Vec::new();
        for frame in 0..(duration_s * 100.0) as usize {
            let time = frame as f64 / 100.0;
            let it = gait.joints(speed * time, time);
            // Ahead is z: a limb that swings forward turns about −x.
            let turn = |z: f64, y: f64, x: f64| [z, y, x].map(f64::to_degrees);
            let mut of_frame = vec![[0.0, 90.0, 100.0 * speed * time], turn(0.0, 0.0, 0.0), turn(0.0, it.twist, 0.0)];
            of_frame.push(turn(0.0, it.look - it.twist, 0.0));
            for (side, out) in [(0, 1.0), (1, -1.0)] {
                of_frame.push(turn(out * 0.03, 0.0, -it.thighs[side]));
                of_frame.extend([turn(0.0, 0.0, it.knees[side]), turn(0.0, 0.0, 0.0)]);
                of_frame.push(turn(out * it.spread[side], 0.0, -it.arms[side]));
                of_frame.extend([turn(0.0, 0.0, -it.elbows[side]), turn(0.0, 0.0, 0.0)]);
            }
            values.extend(of_frame.into_iter().flatten());
        }
        SkeletonMotion { joints, frame_s: 0.01, values }
    }

    #[test]
    fn recorded_gait_is_the_gait() {
        let (speed, motion) = (1.1, walker(9.0, 1.1));
        let body = RecordedBody::new(&motion).unwrap();
        let gait = Gait::without_gestures(speed, &mut Random::new(4));
        // It walks, and a whole number of double steps is repeated.
        let stride = body.stride.unwrap();
        assert!((stride / (speed * body.length_s()) - 1.0).abs() < 0.02, "{stride} m in {} s", body.length_s());
        let difference = |ahead: f64| {
            let all = (0..60).map(|step| {
                let way = f64::from(step) * 0.05;
                let found = body.posture(way, 0.0, 0.0);
                let wanted = Posture::from(gait.joints(way + ahead, 0.0));
                let bones = |it: &Posture| [it.arms[0][0], it.arms[1][0], it.legs[0][0], it.legs[1][1]];
                let (found, wanted) = (bones(&found), bones(&wanted));
                (0..4).map(|it| (found[it] - wanted[it]).norm()).fold(0.0, f64::max)
            });
            all.fold(0.0, f64::max)
        };
        // The recording begins somewhere in a double step.
        let best = (0..150).map(|it| difference(f64::from(it) * 0.01)).fold(f64::INFINITY, f64::min);
        assert!(best < 0.07, "directions differ by {best}");
    }

    #[track_caller]
    fn check_smooth(body: &RecordedBody, most_speed: f64) {
        let length_s = body.length_s();
        let at = |time: f64| match body.stride {
            Some(stride) => body.posture(time / length_s * stride, 0.0, 0.0),
            None => body.posture(0.0, time, 0.0),
        };
        let bones = |it: &Posture| it.arms.into_iter().chain(it.legs).flatten().collect::<Vec<_>>();
        let mut fastest = 0.0_f64;
        for step in 0..4000 {
            let time = f64::from(step) * length_s / 2000.0;
            let [a, b] = [time, time + 1e-3].map(at);
            let speeds = bones(&a).into_iter().zip(bones(&b)).map(|(a, b)| (b - a).norm() / 1e-3);
            fastest = speeds.fold(fastest, f64::max);
            let lowest = [0, 1].map(|side| HIPS + a.rise + a.legs[side][0].z * THIGH + a.legs[side][1].z * SHANK);
            assert!((lowest[0].min(lowest[1]) - FOOT).abs() < 0.05, "{lowest:?} at {time} s");
        }
        assert!(fastest < most_speed, "{fastest} rad/s");
        let [end, start] = [length_s - 1e-9, 0.0].map(at);
        assert!(bones(&end).iter().zip(bones(&start)).all(|(a, b)| (a - b).norm() < 1e-6));
    }

    #[test]
    fn loop_has_no_jump_and_a_foot_is_on_the_floor() {
        check_smooth(&RecordedBody::new(&walker(9.0, 1.1)).unwrap(), 5.0);
        // Not a whole number of steps: the blend has to bridge it.
        check_smooth(&RecordedBody::new(&walker(2.9, 0.7)).unwrap(), 5.0);
    }

    #[test]
    fn recordings_drive_a_body_smoothly() {
        let Some(folder) = std::env::var_os("FOVEATE_DATA") else {
            return println!("skipped: recordings_drive_a_body_smoothly needs FOVEATE_DATA, the folder of recordings");
        };
        for name in ["131_01.bvh", "131_03.bvh"] {
            let text = std::fs::read_to_string(PathBuf::from(&folder).join("s18_bvh").join(name)).unwrap();
            let body = RecordedBody::new(&SkeletonMotion::from_bvh(&text).unwrap()).unwrap();
            // They dance: forearms of the recordings themselves turn this fast.
            check_smooth(&body, 24.0);
            assert_eq!(body.stride, None, "nobody walks evenly");
        }
    }

    #[test]
    fn what_cannot_drive_a_body_is_refused() {
        let refused = |motion: &SkeletonMotion| RecordedBody::new(motion).unwrap_err();
        assert!(refused(&walker(2.0, 1.0)).contains("found 2.00 s of motion, expected 2.67 s or more"));
        let mut other = walker(4.0, 1.0);
        other.joints[3].name = "Left Lever".to_owned();
        assert!(refused(&other).contains("expected one named `LeftUpLeg` or `LeftUpperLeg`"), "{}", refused(&other));
        let mut lying = walker(4.0, 1.0);
        let n_channels = lying.n_channels();
        lying.values.chunks_mut(n_channels).for_each(|it| it[3] = 90.0);
        assert!(refused(&lying).contains("frame 1, expected an upright body"), "{}", refused(&lying));
    }
}
