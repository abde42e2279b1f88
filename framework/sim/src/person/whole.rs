//! A person as recorded: bones of the recorded length, and root motion: a body that travels, turns, crouches and jumps.
//!
//! 1. Joints are read some sixty times a second. Which axis points up is found ([`upright`](super::upright)); the front is where left is left, however the skeleton stands at rest.
//! 2. The unit of length is the one of those in use that makes the person between 1.4 and 2.1 m tall; where none does, centimetres, metres or millimetres that make a child or a giant of them.
//! 3. The longest piece is taken in which no joint jumps: some files begin with a frame in which the person stands like a cross.
//! 4. How the head and the straps of the LEDs sit on their bones is the mean over the recording of how they should: from there on they turn with the bone.
//!
//! What of it is repeated, and where in the room, is the [`Course`]'s matter.

use foveate_estimation::random::Random;
use foveate_scene::skeleton::{CMU_UNIT_M, SkeletonMotion};
use nalgebra::{
    Isometry2, Matrix3, Point3, Rotation2, Rotation3, SVector, Translation2, UnitQuaternion, Vector2, Vector3,
};

use super::body::{FOOT, Pose};
use super::course::Course;
use super::figure::{Figure, STATURE_M, axes};
use super::joints::{HEAD, N_JOINTS, find_joints};
use super::upright::{self, Up};

/// How often the recording is read, as nearly as its frames allow [Hz].
const RATE_HZ: f64 = 60.0;
/// As much of a recording is looked at [s].
const LONGEST_S: f64 = 60.0;
/// Less than this is no motion [s].
const SHORTEST_S: f64 = 0.5;
/// No joint of a person is faster [m/s].
const FASTEST_M_S: f64 = 25.0;
/// How tall people are whose unit of length is looked for [m] …
const TALL_M: [f64; 2] = [1.4, 2.1];
/// … and those of the metric ones, where that finds none; whose unit is told may be as tall, too.
const ANYHOW_TALL_M: [f64; 2] = [0.5, 2.6];
/// From the ankles along the bones to the joint of the head, of all that a person is tall [–].
const ANKLES_TO_HEAD: f64 = 0.87;
/// Units of length in use, the commonest first: centimetre, metre, inch, that of Carnegie Mellon's files, millimetre [m].
const UNITS_M: [f64; 5] = [0.01, 1.0, 0.0254, CMU_UNIT_M, 0.001];
const METRIC_UNITS_M: [f64; 3] = [0.01, 1.0, 0.001];
/// How far the joints are from the floor that they touch, in the order of the joints, of somebody of the built-in body's size [m].
const CLEAR_M: [f64; N_JOINTS] = [0.1, 0.1, 0.05, 0.05, FOOT, FOOT, 0.1, 0.1, 0.04, 0.04, 0.03, 0.03, 0.1];
/// Where less than this part of the line from right to left is level, it tells no heading; from there on it tells more [–].
const LEVEL: [f64; 2] = [0.3, 0.7];

/// Thirteen joints, front and upper side of the head, straps of upper arms and forearms, left and right.
pub(super) const N_CHANNELS: usize = 3 * (N_JOINTS + 2 + 4);
/// All that moves but place and heading on the floor, seen from there.
pub(super) type Channels = SVector<f64, N_CHANNELS>;

/// A body in one frame of the recording.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moment {
    /// Below the middle of the hips on the floor, x to the front [m].
    pub place: Isometry2<f64>,
    /// Seen from there [m].
    pub channels: Channels,
}

/// A person of a recording, with a way that stays within an area.
#[derive(Debug, Clone, PartialEq)]
pub struct WholeBody {
    size: f64,
    notes: Vec<String>,
    course: Course,
}

/// What is told of a recording; nothing of it need be.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Told {
    /// What one unit of length is [m].
    pub unit_m: Option<f64>,
    /// Which axis points up: 0, 1, 2 for x, y, z.
    pub up: Option<usize>,
}

impl WholeBody {
    /// Of a BVH recording of which so much is `told`; the middle of the body stays in an area of `area_m`.
    ///
    /// # Errors
    /// A sentence: a joint that it lacks, a size that no person has, that it is too short, or that there is no room for it.
    pub fn new(motion: &SkeletonMotion, told: Told, area_m: [f64; 2]) -> Result<Self, String> {
        let Recording { moments, rate_hz, stature_m, notes } = Recording::read(motion, told)?;
        let course = Course::new(&moments, rate_hz, area_m)?;
        Ok(Self { size: stature_m / STATURE_M, notes, course })
    }

    /// How tall the person is [m].
    pub fn stature_m(&self) -> f64 {
        self.size * STATURE_M
    }

    /// What was made of the recording: its unit of length, and whatever else may be otherwise than thought, each in some words.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// After how long everything begins anew [s].
    pub fn period_s(&self) -> f64 {
        self.course.period_s()
    }

    /// The person at `time_s`, going about `centre` [m]; `ahead` says when to begin and which way to face, each from 0 to 1.
    pub(super) fn pose(&self, time_s: f64, ahead: [f64; 2], centre: Vector2<f64>) -> Pose {
        figure(&self.course.at(time_s, ahead, centre), self.size).pose()
    }

    /// When to begin and which way to face, drawn.
    pub(super) fn ahead(random: &mut Random) -> [f64; 2] {
        [(); 2].map(|()| random.uniform_in(0.0, 1.0))
    }
}

/// The body of channels that are seen from the world's origin.
fn figure(channels: &Channels, size: f64) -> Figure {
    let vector = |place: usize| channels.fixed_rows::<3>(3 * place).into_owned();
    let pair = |kind: usize| [0, 1].map(|side| Point3::from(vector(2 * kind + side)));
    let strap = |side: usize| [vector(N_JOINTS + 2 + side), vector(N_JOINTS + 4 + side)];
    Figure {
        size,
        head: Point3::from(vector(HEAD)),
        head_axes: [vector(N_JOINTS), vector(N_JOINTS + 1)],
        hips: pair(0),
        knees: pair(1),
        ankles: pair(2),
        shoulders: pair(3),
        elbows: pair(4),
        wrists: pair(5),
        straps: [strap(0), strap(1)],
    }
}

/// Turns and shifts `channels` on the floor.
pub(super) fn moved(channels: &Channels, by: &Isometry2<f64>) -> Channels {
    let (cosine, sine) = (by.rotation.re, by.rotation.im);
    let mut moved = *channels;
    for place in 0..N_CHANNELS / 3 {
        let [x, y] = [channels[3 * place], channels[3 * place + 1]];
        let shift = if place < N_JOINTS { by.translation.vector } else { Vector2::zeros() };
        moved[3 * place] = cosine * x - sine * y + shift.x;
        moved[3 * place + 1] = sine * x + cosine * y + shift.y;
    }
    moved
}

/// What a file holds, in metres, z up.
struct Recording {
    moments: Vec<Moment>,
    rate_hz: f64,
    stature_m: f64,
    notes: Vec<String>,
}

/// Joints and the turns of those that wear something: upper arms, forearms, head.
struct Frame {
    places: [Vector3<f64>; N_JOINTS],
    turns: [UnitQuaternion<f64>; 5],
}

impl Recording {
    fn read(motion: &SkeletonMotion, told: Told) -> Result<Self, String> {
        let joints = find_joints(motion)?;
        let step = (1.0 / (RATE_HZ * motion.frame_s)).round().max(1.0) as usize;
        let rate_hz = 1.0 / (motion.frame_s * step as f64);
        let (unit_m, stature_m, of_unit) = unit(motion, &joints, told.unit_m)?;
        let mut notes = vec![of_unit];
        let count = ((LONGEST_S / motion.frame_s) as usize).min(motion.n_frames());
        let mut frames: Vec<Frame> = (0..count)
            .step_by(step)
            .map_while(|frame| motion.poses(frame, unit_m))
            .map(|poses| Frame {
                places: joints.map(|it| poses[it].translation.vector),
                turns: [6, 7, 8, 9, HEAD].map(|it| poses[joints[it]].rotation),
            })
            .collect();
        let (n_read, seconds) = (frames.len(), |n: usize| n as f64 / rate_hz);
        let (frames, jump) = steadiest(&mut frames, rate_hz);
        let jump = jump.map_or_else(String::new, |(frame, joint, moved)| {
            let joint = &motion.joints[joints[joint]].name;
            format!("`{joint}` moves {moved:.3} m from frame {} to the next that is read", frame * step + 1)
        });
        if seconds(frames.len()) < SHORTEST_S {
            let found = format!("found {:.2} s of motion", seconds(n_read));
            let why = if jump.is_empty() {
                String::new()
            } else {
                format!(", {:.2} s of it without a jump ({jump})", seconds(frames.len()))
            };
            return Err(format!("{found}{why}, expected {SHORTEST_S} s or more"));
        }
        // One frame like a cross is what many files begin with.
        if n_read - frames.len() > 1 {
            notes.push(format!("{:.1} s of {:.1} s, since {jump}", seconds(frames.len()), seconds(n_read)));
        }
        let places: Vec<[Vector3<f64>; N_JOINTS]> = frames.iter().map(|it| it.places).collect();
        let (up, other) = match told.up {
            Some(axis) => ((axis, true), None),
            None => upright::up(motion, &joints, &places, stature_m),
        };
        notes.extend(other.map(|other: Up| {
            let [up, other] = [up, other].map(upright::in_words);
            format!("{up} taken for up, though {other} may be: the skeleton stands otherwise than in its motion, `body.up` says which is right")
        }));
        let turn = upright::z_up_from(up);
        for frame in frames.iter_mut() {
            frame.places = frame.places.map(|it| turn * it);
            frame.turns = frame.turns.map(|it| turn * it);
        }
        let size = stature_m / STATURE_M;
        let lowest = |it: &Frame| {
            it.places.iter().zip(CLEAR_M).map(|(it, clear)| it.z - clear * size).fold(f64::INFINITY, f64::min)
        };
        let floor = frames.iter().map(lowest).fold(f64::INFINITY, f64::min);
        Ok(Self { moments: moments(frames, floor)?, rate_hz, stature_m, notes })
    }
}

/// One unit of length, how tall that makes the person [m], and how that is said.
fn unit(
    motion: &SkeletonMotion,
    joints: &[usize; N_JOINTS],
    unit_m: Option<f64>,
) -> Result<(f64, f64, String), String> {
    let offset = |it: usize| motion.joints[it].offset;
    // From a joint back to one that it hangs on, at the latest the root, along the bones.
    let back = |from: usize, to: Option<usize>| {
        let chain = std::iter::successors(Some(from), |&it| motion.joints[it].parent);
        chain
            .take_while(|&it| Some(it) != to && motion.joints[it].parent.is_some())
            .map(|it| offset(it).norm())
            .sum::<f64>()
    };
    let leg = |side: usize| back(joints[4 + side], Some(joints[side]));
    let [a, b] = [0, 1].map(|side| offset(joints[side]));
    let below = ((a + b) / 2.0).norm(); // the hips below the root, where they hang on it
    let tall = (back(joints[HEAD], None) + below + (leg(0) + leg(1)) / 2.0) / ANKLES_TO_HEAD;
    if !(tall > 0.0 && tall.is_finite()) {
        return Err(format!("found bones of {tall} units from foot to head, expected a person"));
    }
    let within = |[low, high]: [f64; 2], unit: f64| (low..=high).contains(&(tall * unit));
    let said = |unit: f64, why: &str| {
        (unit, tall * unit, format!("{:.2} m tall, one unit being {unit:.4} m{why}", tall * unit))
    };
    if let Some(unit) = unit_m {
        return if within(ANYHOW_TALL_M, unit) {
            Ok(said(unit, ""))
        } else {
            let [low, high] = ANYHOW_TALL_M;
            let message = "with this `unit_m`, expected one that makes";
            Err(format!("found a person of {:.2} m {message} {low} to {high} m of {tall:.1} units", tall * unit))
        };
    }
    if let Some(unit) = UNITS_M.into_iter().find(|it| within(TALL_M, *it)) {
        let is_usual = METRIC_UNITS_M.contains(&unit);
        return Ok(said(
            unit,
            if is_usual { "" } else { " as no metric one makes a person of 1.4 to 2.1 m: `body.unit_m` says another" },
        ));
    }
    if let Some(unit) = METRIC_UNITS_M.into_iter().find(|it| within(ANYHOW_TALL_M, *it)) {
        return Ok(said(unit, " as no unit in use makes a person of 1.4 to 2.1 m: `body.unit_m` says another"));
    }
    Ok(said(STATURE_M / tall, " since no unit in use makes a person of it: `body.unit_m` says another"))
}

/// The longest piece in which no joint is faster than a person's, and the first jump beyond it: after which frame, which joint, how far [m].
fn steadiest(frames: &mut [Frame], rate_hz: f64) -> (&mut [Frame], Option<(usize, usize, f64)>) {
    let farthest = |pair: &[Frame]| {
        let moved = pair[0].places.iter().zip(&pair[1].places).map(|(a, b)| (b - a).norm()).enumerate();
        moved.fold((0, 0.0), |far: (usize, f64), it| if it.1 > far.1 || it.1.is_nan() { it } else { far })
    };
    let jumps: Vec<(usize, usize, f64)> = frames
        .windows(2)
        .enumerate()
        .map(|(at, pair)| (at, farthest(pair)))
        .filter(|(_, (_, moved))| !moved.le(&(FASTEST_M_S / rate_hz)))
        .map(|(at, (joint, moved))| (at, joint, moved))
        .collect();
    let (mut from, mut longest) = (0, [0, 0]);
    for end in jumps.iter().map(|it| it.0 + 1).chain([frames.len()]) {
        if end - from > longest[1] - longest[0] {
            longest = [from, end];
        }
        from = end;
    }
    (&mut frames[longest[0]..longest[1]], jumps.first().copied())
}

/// Seen from place and heading, with straps and head on their bones.
fn moments(frames: &[Frame], floor: f64) -> Result<Vec<Moment>, String> {
    let across = |it: &Frame, place: usize| it.places[place] - it.places[place + 1];
    let trunk = |it: &Frame| {
        let spine = it.places[6] + it.places[7] - it.places[0] - it.places[1];
        axes(across(it, 6), spine)
    };
    let bone = |it: &Frame, from: usize, to: usize| {
        (it.places[to] - it.places[from]).try_normalize(1e-9).unwrap_or(-Vector3::z())
    };
    // In the axes of the bone: where a strap's LED ought to be, and how the head ought to look, on average.
    let mut straps = [Vector3::zeros(); 4];
    let mut head = Matrix3::zeros();
    for frame in frames {
        let [front, left, up] = trunk(frame);
        for (side, out) in [(0, 1.0), (1, -1.0)] {
            let [upper, fore] = [bone(frame, 6 + side, 8 + side), bone(frame, 8 + side, 10 + side)];
            let across = |along: Vector3<f64>, wish: Vector3<f64>| wish - along * along.dot(&wish);
            // At the elbow on the outer side and away from where the forearm bends to.
            let on_upper = across(upper, left * (0.9 * out) + up * 0.3 - fore);
            let on_fore = across(fore, left * out + front * 0.2 + up * 0.4);
            straps[side] += frame.turns[side].inverse() * on_upper;
            straps[2 + side] += frame.turns[2 + side].inverse() * on_fore;
        }
        let level = axes(left, Vector3::z());
        head += frame.turns[4].inverse().to_rotation_matrix() * Matrix3::from_columns(&level);
    }
    // The rotation nearest to the mean.
    let head = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&(head / frames.len() as f64)));
    let mut found = Vec::with_capacity(frames.len());
    for (number, frame) in frames.iter().enumerate() {
        let Some(left) = heading(across(frame, 0) + across(frame, 6), trunk(frame)[0], found.last().map(left_of))
        else {
            let message = "found hips and shoulders one above the other in frame";
            return Err(format!("{message} {} of those read, expected a body with a heading", number + 1));
        };
        let middle = (frame.places[0] + frame.places[1]).xy() / 2.0;
        let heading = Rotation2::from_matrix_unchecked(nalgebra::Matrix2::new(left.y, left.x, -left.x, left.y));
        let place = Isometry2::from_parts(Translation2::from(middle), heading.into());
        let mut channels = Channels::zeros();
        let on_head = [Vector3::x(), Vector3::z()].map(|it| frame.turns[4] * (head * it));
        let worn = (0..4).map(|it| frame.turns[it] * straps[it].try_normalize(1e-9).unwrap_or(Vector3::z()));
        let places = frame.places.iter().map(|it| it - Vector3::z() * floor);
        for (place, vector) in places.chain(on_head).chain(worn).enumerate() {
            channels.fixed_rows_mut::<3>(3 * place).copy_from(&vector);
        }
        let channels = moved(&channels, &place.inverse());
        if !channels.iter().all(|it| it.is_finite()) {
            return Err(format!("found values that are no numbers in frame {} of those read", number + 1));
        }
        found.push(Moment { place, channels });
    }
    Ok(found)
}

/// Where left is in the way that a person faces.
fn left_of(moment: &Moment) -> Vector2<f64> {
    moment.place.rotation * Vector2::y()
}

/// Where left is on the floor, by the line from right to left, and, where that stands upright as in a cartwheel, by the `front`. Upside down both point the other way: nearest to `before`.
fn heading(left: Vector3<f64>, front: Vector3<f64>, before: Option<Vector2<f64>>) -> Option<Vector2<f64>> {
    let nearest = |it: Vector2<f64>| if before.is_some_and(|before| before.dot(&it) < 0.0) { -it } else { it };
    let by_left = left.xy().try_normalize(1e-9);
    let by_front = Vector2::new(-front.y, front.x).try_normalize(1e-9);
    let level = ((left.xy().norm() / left.norm().max(1e-9) - LEVEL[0]) / (LEVEL[1] - LEVEL[0])).clamp(0.0, 1.0);
    let [by_left, by_front] = [by_left, by_front].map(|it| it.map(nearest).unwrap_or_default());
    (by_left * level + by_front * (1.0 - level)).try_normalize(1e-9).or(before)
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;
    use std::sync::Arc;

    use foveate_scene::skeleton::{Axis, Channel};

    use super::super::sticks::{Limbs, skeleton};
    use super::super::{N_LEDS, Person};
    use super::*;

    /// In metres, y up, looking along z: somebody of 1.7 m who goes ahead at `speed` [m/s] for as long as asked, 60 times a second; arms swing, and every second
    /// there is a jump of 0.3 m.
    fn walker(duration_s: f64, speed: f64) -> SkeletonMotion {
        let legs = Limbs { names: ["UpLeg", "Leg", "Foot"], at: [0.09, 0.0, 0.0], lengths: [0.42, 0.41] };
        let arms = Limbs { names: ["Arm", "ForeArm", "Hand"], at: [0.18, 0.38, 0.0], lengths: [0.28, 0.25] };
        let joints = skeleton(("Spine", 0.1), 0.55, &legs, &arms);
        let mut values = Vec::new();
        for frame in 0..(duration_s * 60.0) as usize {
            let time = frame as f64 / 60.0;
            let swing = 40.0 * (std::f64::consts::TAU * time).sin();
            let jumped = (2.0 * time.fract() - 0.5).clamp(0.0, 1.0);
            let jump = 0.15 * (1.0 - (std::f64::consts::TAU * jumped).cos());
            let mut of_frame = vec![[0.0, 0.9 + jump, speed * time], [0.0; 3], [0.0; 3], [0.0; 3]];
            for out in [1.0, -1.0] {
                of_frame.extend([[0.0, 0.0, -out * swing], [0.0, 0.0, 20.0], [0.0; 3]]);
                of_frame.extend([[out * 10.0, 0.0, out * swing], [0.0, 0.0, -30.0], [0.0; 3]]);
            }
            values.extend(of_frame.into_iter().flatten());
        }
        SkeletonMotion { joints, frame_s: 1.0 / 60.0, values }
    }

    /// `motion` in another unit of length and with other axes: what was y is z, what was z is −y, x is left.
    fn z_up_in(unit_m: f64, motion: &SkeletonMotion) -> SkeletonMotion {
        let mut other = motion.clone();
        let turned = |it: Vector3<f64>| Vector3::new(it.x, -it.z, it.y) / unit_m;
        other.joints.iter_mut().for_each(|it| it.offset = turned(it.offset));
        let n_channels = other.n_channels();
        for frame in other.values.chunks_mut(n_channels) {
            let place = turned(Vector3::new(frame[0], frame[1], frame[2]));
            frame[..3].copy_from_slice(place.as_slice());
        }
        for joint in &mut other.joints {
            for channel in &mut joint.channels {
                // About y before is about z now, about z before about −y.
                if let Channel::Rotation(axis) = channel {
                    *axis = [Axis::X, Axis::Z, Axis::Y][axis.index()];
                }
            }
        }
        let mut at = 0;
        let n = n_channels;
        for joint in &other.joints {
            for channel in &joint.channels {
                if *channel == Channel::Rotation(Axis::Y) {
                    other.values.iter_mut().skip(at).step_by(n).for_each(|it| *it = -*it);
                }
                at += 1;
            }
        }
        other
    }

    const AREA_M: [f64; 2] = [2.5, 4.0];

    fn person(body: &Arc<WholeBody>) -> Person {
        Person::whole(Arc::clone(body), Vector2::zeros(), &mut Random::new(5))
    }

    /// No LED jumps or gets another velocity at once, a seam or not; nobody leaves the area or sinks into the floor.
    #[track_caller]
    fn check_course(body: WholeBody, most_m_s2: f64) {
        const STEP_S: f64 = 1e-3;
        let body = Arc::new(body);
        let seams = body.course.seams_s();
        let leds = |time_s: f64| body.pose(time_s, [0.0; 2], Vector2::zeros()).leds.map(|it| it.position);
        // All through, and more closely about the seams, on either side of which what is written down differs most.
        let spread = (0..2000).map(|it| body.period_s() * 2.0 * f64::from(it) / 2000.0);
        let near = seams.iter().flat_map(|seam| (-60..60).map(move |it| seam + f64::from(it) * STEP_S + 0.3e-3));
        for time in spread.chain(near) {
            let [a, b, c] = [0.0, 1.0, 2.0].map(|it| leds(time + it * STEP_S));
            for led in 0..N_LEDS {
                let [first, second] = [(b[led] - a[led]) / STEP_S, (c[led] - b[led]) / STEP_S];
                assert!(first.norm() < 15.0, "LED {led} moves at {} m/s at {time} s", first.norm());
                let change = (second - first).norm() / STEP_S;
                assert!(
                    change < most_m_s2,
                    "LED {led} changes its velocity by {change} m/s² at {time} s, seams {seams:?}"
                );
            }
        }
        let period_s = body.period_s();
        let [start, end] = [0.0, period_s].map(leds);
        assert!((0..N_LEDS).all(|led| (end[led] - start[led]).norm() < 1e-6), "{start:?} {end:?}");
        let person = person(&body);
        for step in 0..500 {
            let pose = person.pose(f64::from(step) * period_s / 500.0);
            let inside = (0..2).all(|axis| pose.middle[axis].abs() <= AREA_M[axis] / 2.0 + 0.02);
            assert!(inside, "{} m", pose.middle);
            let lowest = pose.parts.iter().flat_map(|it| it.ends).map(|it| it.z).fold(f64::INFINITY, f64::min);
            assert!((0.0..0.9).contains(&lowest), "lowest at {lowest} m");
            let head = pose.head.translation.vector.z;
            assert!((0.15..2.9).contains(&head), "head at {head} m");
        }
    }

    #[test]
    fn loops_have_no_seam_and_keep_within_the_area() {
        check_course(WholeBody::new(&walker(9.0, 0.0), Told::default(), AREA_M).unwrap(), 100.0);
        let rounds = WholeBody::new(&walker(9.0, 0.6), Told::default(), AREA_M).unwrap();
        assert!(rounds.period_s() > 8.0, "{} s", rounds.period_s());
        check_course(rounds, 100.0);
        // Too short for a lap.
        check_course(WholeBody::new(&walker(0.8, 1.0), Told::default(), AREA_M).unwrap(), 100.0);
        // Too fast for a round in the area.
        check_course(WholeBody::new(&walker(4.0, 4.0), Told::default(), AREA_M).unwrap(), 100.0);
    }

    #[test]
    fn somebody_who_jumps_leaves_the_floor() {
        let body = WholeBody::new(&walker(5.0, 0.3), Told::default(), AREA_M).unwrap();
        let heights =
            (0..500).map(|it| body.pose(f64::from(it) * 0.01, [0.0; 2], Vector2::zeros()).parts[13].ends[1].z);
        let [low, high] = heights.fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], it| [low.min(it), high.max(it)]);
        assert!((0.04..0.1).contains(&low) && high - low > 0.28, "{low} to {high} m");
    }

    #[test]
    fn another_axis_and_unit_make_the_same_person() {
        let motion = walker(5.0, 0.6);
        let leds = |motion: &SkeletonMotion, unit_m: Option<f64>| {
            let body = WholeBody::new(motion, Told { unit_m, up: None }, AREA_M).unwrap();
            assert!((body.stature_m() - 1.7).abs() < 0.05, "{} m", body.stature_m());
            (0..50).map(|it| body.pose(f64::from(it) * 0.1, [0.0; 2], Vector2::zeros()).leds).collect::<Vec<_>>()
        };
        let metres = leds(&motion, None);
        for (unit_m, said) in [(0.0254, None), (0.01, None), (0.0254 / 0.45, None), (0.333, Some(0.333))] {
            let others = leds(&z_up_in(unit_m, &motion), said);
            for (one, other) in
                metres.iter().zip(others).flat_map(|(a, b)| a.iter().copied().zip(b).collect::<Vec<_>>())
            {
                assert!((one.position - other.position).norm() < 1e-6, "{} and {} m", one.position, other.position);
                assert!((one.normal - other.normal).norm() < 1e-6);
            }
        }
        let unknown = WholeBody::new(&z_up_in(0.04, &motion), Told::default(), AREA_M).unwrap();
        assert!(
            unknown.notes()[0].contains("no unit in use makes a person of it")
                && (unknown.stature_m() - STATURE_M).abs() < 1e-9
        );
        let refused = |unit_m: f64, area_m: [f64; 2]| {
            WholeBody::new(&motion, Told { unit_m: Some(unit_m), up: None }, area_m).unwrap_err()
        };
        assert!(refused(2.0, AREA_M).contains("expected one that makes 0.5 to 2.6 m"), "{}", refused(2.0, AREA_M));
        assert!(refused(1.0, [0.1, 0.1]).contains("0.10 m × 0.10 m"), "{}", refused(1.0, [0.1, 0.1]));
        let short = WholeBody::new(&walker(0.4, 1.0), Told::default(), AREA_M).unwrap_err();
        assert!(short.contains("expected 0.5 s or more"), "{short}");
    }

    /// The walker, turned as a whole by `turns` [degrees about z, y, x], its hips at `hips` [m] in each frame.
    fn turned(turns: impl Fn(f64) -> [f64; 3], hips: impl Fn(f64) -> [f64; 3]) -> SkeletonMotion {
        let mut motion = walker(5.0, 0.0);
        let n_channels = motion.n_channels();
        for (frame, values) in motion.values.chunks_mut(n_channels).enumerate() {
            let time = frame as f64 / 60.0;
            values[..3].copy_from_slice(&hips(time));
            values[3..6].copy_from_slice(&turns(time));
        }
        motion
    }

    /// How high the middle of the head is over a recording, least and most [m].
    fn head_heights(body: &WholeBody) -> [f64; 2] {
        let period_s = body.period_s();
        let heights = (0..200).map(|it| {
            body.pose(f64::from(it) * period_s / 200.0, [0.0; 2], Vector2::zeros()).head.translation.vector.z
        });
        heights.fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], it| [low.min(it), high.max(it)])
    }

    #[test]
    fn who_lies_or_stands_on_the_hands_does_so_here() {
        // On the back, somewhere in the room, with legs that swing.
        let lying = turned(|_| [0.0, 0.0, -90.0], |_| [0.4, 0.55, 1.3]);
        let told = Told { up: Some(1), ..Told::default() };
        for body in [Told::default(), told].map(|it| WholeBody::new(&lying, it, AREA_M).unwrap()) {
            let [low, high] = head_heights(&body);
            assert!(0.0 < low && high < 1.0, "{low} to {high} m, {:?}", body.notes());
        }
        let body = WholeBody::new(&lying, Told::default(), AREA_M).unwrap();
        assert!(body.notes()[1].starts_with("y taken for up, though -z may be"), "{:?}", body.notes());
        // A skeleton made with y up whose root is turned to z up stands, though.
        let stands = turned(|_| [0.0, 0.0, 90.0], |time| [0.5, 0.3 + 0.1 * time, 0.9]);
        let body = WholeBody::new(&stands, Told::default(), AREA_M).unwrap();
        assert!(head_heights(&body)[0] > 1.4, "{:?}, {:?}", head_heights(&body), body.notes());
        // On the hands.
        let body =
            WholeBody::new(&turned(|_| [180.0, 0.0, 0.0], |_| [0.0, 1.2, 0.0]), Told::default(), AREA_M).unwrap();
        let [low, high] = head_heights(&body);
        assert!(0.1 < low && high < 1.2, "{low} to {high} m");
    }

    #[test]
    fn a_cartwheel_goes_over_without_a_jump() {
        // Once over sideways in a second and a half, and again.
        let body =
            WholeBody::new(&turned(|time| [240.0 * time, 0.0, 0.0], |_| [0.0, 0.9, 0.0]), Told::default(), AREA_M)
                .unwrap();
        let [low, high] = head_heights(&body);
        assert!(low < 0.4 && high > 1.4, "{low} to {high} m");
        check_course(body, 400.0);
    }

    #[test]
    fn children_and_giants_are_as_tall_as_recorded() {
        let tall = |unit_m: f64, told: Option<f64>| {
            let body =
                WholeBody::new(&z_up_in(unit_m, &walker(3.0, 0.0)), Told { unit_m: told, up: None }, AREA_M).unwrap();
            (body.stature_m(), body.notes().join("; "))
        };
        // 1.7 m in units of 1.7 cm are 100: a child of 1 m if they are centimetres.
        let (stature, notes) = tall(0.017, None);
        assert!((stature - 1.0).abs() < 0.05 && notes.contains("one unit being 0.0100 m"), "{stature} m, {notes}");
        let (stature, notes) = tall(0.0072, None);
        assert!((stature - 2.36).abs() < 0.1 && notes.contains("`body.unit_m` says another"), "{stature} m, {notes}");
        // Seventy units are inches, or a child.
        let (stature, notes) = tall(0.0243, None);
        assert!((stature - 1.78).abs() < 0.08 && notes.contains("as no metric one"), "{stature} m, {notes}");
        assert!((tall(0.0243, Some(0.01)).0 - 0.7).abs() < 0.05);
    }

    #[test]
    fn a_joint_that_jumps_is_named() {
        let mut motion = walker(4.0, 0.0);
        let n_channels = motion.n_channels();
        motion.values.iter_mut().skip(60 * n_channels).step_by(n_channels).for_each(|it| *it += 99.0);
        let body = WholeBody::new(&motion, Told::default(), AREA_M).unwrap();
        let told = body.notes().join("; ");
        assert!(told.contains("3.0 s of 4.0 s, since `") && told.contains("moves 99.0"), "{told}");
        motion.values.iter_mut().step_by(n_channels).enumerate().for_each(|(frame, it)| *it = 9.0 * frame as f64);
        let refused = WholeBody::new(&motion, Told::default(), AREA_M).unwrap_err();
        assert!(refused.contains("0.02 s of it without a jump (`") && refused.contains("moves 9.0"), "{refused}");
    }

    #[test]
    fn a_first_frame_like_a_cross_is_left_out() {
        let mut motion = walker(3.0, 0.0);
        let n_channels = motion.n_channels();
        let mut cross = motion.values[..n_channels].to_vec();
        cross[..3].copy_from_slice(&[0.0, 5.0, 7.0]);
        motion.values.splice(0..0, cross);
        check_course(WholeBody::new(&motion, Told::default(), AREA_M).unwrap(), 100.0);
    }

    #[test]
    fn recorded_people_go_on_without_a_jump() {
        let Some(folder) = std::env::var_os("FOVEATE_DATA").map(PathBuf::from) else {
            return println!(
                "skipped: recorded_people_go_on_without_a_jump needs FOVEATE_DATA, the folder of recordings"
            );
        };
        let mut n_files = 0;
        for set in ["s18_bvh", "s22_bvh_people"] {
            for entry in std::fs::read_dir(folder.join(set)).unwrap().flatten() {
                let path = entry.path();
                if path.extension().is_none_or(|it| it != "bvh") {
                    continue;
                }
                let text = std::fs::read_to_string(&path).unwrap();
                let motion = SkeletonMotion::from_bvh(&text).unwrap();
                let body = WholeBody::new(&motion, Told::default(), AREA_M)
                    .unwrap_or_else(|it| panic!("{}: {it}", path.display()));
                println!("{}: {:.2} m, repeats after {:.1} s", path.display(), body.stature_m(), body.period_s());
                assert!((1.4..2.1).contains(&body.stature_m()));
                // Limbs that hit an end of their motion change as fast in the recordings themselves.
                check_course(body, 400.0);
                n_files += 1;
            }
        }
        assert!(n_files >= 12, "found {n_files} recordings");
    }
}
