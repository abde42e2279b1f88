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
/// Range of stature for inferring the unit of length [m] …
const TALL_M: [f64; 2] = [1.4, 2.1];
/// … and that for the metric units, where the first range finds none; it also applies where the unit is given.
const ANYHOW_TALL_M: [f64; 2] = [0.5, 2.6];
/// From the ankles along the bones to the joint of the head, of all that a person is tall [–].
const ANKLES_TO_HEAD: f64 = 0.87;
/// Units of length in use, the commonest first: centimetre, metre, inch, that of Carnegie Mellon's files, millimetre [m].
const UNITS_M: [f64; 5] = [0.01, 1.0, 0.0254, CMU_UNIT_M, 0.001];
const METRIC_UNITS_M: [f64; 3] = [0.01, 1.0, 0.001];
/// How far the joints are from the floor that they touch, in the order of the joints, for a person of the built-in body's size [m].
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

/// Optional hints about a recording: its unit of length and its up axis.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RecordingHints {
    /// What one unit of length is [m].
    pub unit_m: Option<f64>,
    /// Which axis points up: 0, 1, 2 for x, y, z.
    pub up: Option<usize>,
}

impl WholeBody {
    /// From a BVH recording and hints about it; the middle of the body stays in an area of `area_m`.
    ///
    /// # Errors
    /// A sentence: a joint that it lacks, a size that no person has, that it is too short, or that there is no room for it.
    pub fn new(motion: &SkeletonMotion, hints: RecordingHints, area_m: [f64; 2]) -> Result<Self, String> {
        let Recording { moments, rate_hz, stature_m, notes } = Recording::read(motion, hints)?;
        let course = Course::new(&moments, rate_hz, area_m)?;
        Ok(Self { size: stature_m / STATURE_M, notes, course })
    }

    /// How tall the person is [m].
    pub fn stature_m(&self) -> f64 {
        self.size * STATURE_M
    }

    /// How the recording was interpreted: its unit of length, and other assumptions, in words.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// After how long everything repeats [s].
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
    fn read(motion: &SkeletonMotion, hints: RecordingHints) -> Result<Self, String> {
        let joints = find_joints(motion)?;
        let step = (1.0 / (RATE_HZ * motion.frame_s)).round().max(1.0) as usize;
        let rate_hz = 1.0 / (motion.frame_s * step as f64);
        let (unit_m, stature_m, of_unit) = unit(motion, &joints, hints.unit_m)?;
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
        let (up, other) = match hints.up {
            Some(axis) => ((axis, true), None),
            None => upright::up(motion, &joints, &places, stature_m),
        };
        notes.extend(other.map(|other: Up| {
            let [up, other] = [up, other].map(upright::in_words);
            format!("{up} taken for up, though {other} may be: skeleton and motion disagree, `body.up` states which is right")
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
mod tests;
