//! People of recordings, tried.

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
            assert!(change < most_m_s2, "LED {led} changes its velocity by {change} m/s² at {time} s, seams {seams:?}");
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
    check_course(WholeBody::new(&walker(9.0, 0.0), RecordingHints::default(), AREA_M).unwrap(), 100.0);
    let rounds = WholeBody::new(&walker(9.0, 0.6), RecordingHints::default(), AREA_M).unwrap();
    assert!(rounds.period_s() > 8.0, "{} s", rounds.period_s());
    check_course(rounds, 100.0);
    // Too short for a lap.
    check_course(WholeBody::new(&walker(0.8, 1.0), RecordingHints::default(), AREA_M).unwrap(), 100.0);
    // Too fast for a round in the area.
    check_course(WholeBody::new(&walker(4.0, 4.0), RecordingHints::default(), AREA_M).unwrap(), 100.0);
}

#[test]
fn somebody_who_jumps_leaves_the_floor() {
    let body = WholeBody::new(&walker(5.0, 0.3), RecordingHints::default(), AREA_M).unwrap();
    let heights = (0..500).map(|it| body.pose(f64::from(it) * 0.01, [0.0; 2], Vector2::zeros()).parts[13].ends[1].z);
    let [low, high] = heights.fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], it| [low.min(it), high.max(it)]);
    assert!((0.04..0.1).contains(&low) && high - low > 0.28, "{low} to {high} m");
}

#[test]
fn another_axis_and_unit_make_the_same_person() {
    let motion = walker(5.0, 0.6);
    let leds = |motion: &SkeletonMotion, unit_m: Option<f64>| {
        let body = WholeBody::new(motion, RecordingHints { unit_m, up: None }, AREA_M).unwrap();
        assert!((body.stature_m() - 1.7).abs() < 0.05, "{} m", body.stature_m());
        (0..50).map(|it| body.pose(f64::from(it) * 0.1, [0.0; 2], Vector2::zeros()).leds).collect::<Vec<_>>()
    };
    let metres = leds(&motion, None);
    for (unit_m, said) in [(0.0254, None), (0.01, None), (0.0254 / 0.45, None), (0.333, Some(0.333))] {
        let others = leds(&z_up_in(unit_m, &motion), said);
        for (one, other) in metres.iter().zip(others).flat_map(|(a, b)| a.iter().copied().zip(b).collect::<Vec<_>>()) {
            assert!((one.position - other.position).norm() < 1e-6, "{} and {} m", one.position, other.position);
            assert!((one.normal - other.normal).norm() < 1e-6);
        }
    }
    let unknown = WholeBody::new(&z_up_in(0.04, &motion), RecordingHints::default(), AREA_M).unwrap();
    assert!(
        unknown.notes()[0].contains("no unit in use makes a person of it")
            && (unknown.stature_m() - STATURE_M).abs() < 1e-9
    );
    let refused = |unit_m: f64, area_m: [f64; 2]| {
        WholeBody::new(&motion, RecordingHints { unit_m: Some(unit_m), up: None }, area_m).unwrap_err()
    };
    assert!(refused(2.0, AREA_M).contains("expected one that makes 0.5 to 2.6 m"), "{}", refused(2.0, AREA_M));
    assert!(refused(1.0, [0.1, 0.1]).contains("0.10 m × 0.10 m"), "{}", refused(1.0, [0.1, 0.1]));
    let short = WholeBody::new(&walker(0.4, 1.0), RecordingHints::default(), AREA_M).unwrap_err();
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
    let heights = (0..200)
        .map(|it| body.pose(f64::from(it) * period_s / 200.0, [0.0; 2], Vector2::zeros()).head.translation.vector.z);
    heights.fold([f64::INFINITY, 0.0], |[low, high]: [f64; 2], it| [low.min(it), high.max(it)])
}

#[test]
fn who_lies_or_stands_on_the_hands_does_so_here() {
    // On the back, somewhere in the room, with legs that swing.
    let lying = turned(|_| [0.0, 0.0, -90.0], |_| [0.4, 0.55, 1.3]);
    let hints = RecordingHints { up: Some(1), ..RecordingHints::default() };
    for body in [RecordingHints::default(), hints].map(|it| WholeBody::new(&lying, it, AREA_M).unwrap()) {
        let [low, high] = head_heights(&body);
        assert!(0.0 < low && high < 1.0, "{low} to {high} m, {:?}", body.notes());
    }
    let body = WholeBody::new(&lying, RecordingHints::default(), AREA_M).unwrap();
    assert!(body.notes()[1].starts_with("y taken for up, though -z may be"), "{:?}", body.notes());
    // A skeleton made with y up whose root is turned to z up stands, though.
    let stands = turned(|_| [0.0, 0.0, 90.0], |time| [0.5, 0.3 + 0.1 * time, 0.9]);
    let body = WholeBody::new(&stands, RecordingHints::default(), AREA_M).unwrap();
    assert!(head_heights(&body)[0] > 1.4, "{:?}, {:?}", head_heights(&body), body.notes());
    // On the hands.
    let body =
        WholeBody::new(&turned(|_| [180.0, 0.0, 0.0], |_| [0.0, 1.2, 0.0]), RecordingHints::default(), AREA_M).unwrap();
    let [low, high] = head_heights(&body);
    assert!(0.1 < low && high < 1.2, "{low} to {high} m");
}

#[test]
fn a_cartwheel_goes_over_without_a_jump() {
    // Once over sideways in a second and a half, and again.
    let body = WholeBody::new(
        &turned(|time| [240.0 * time, 0.0, 0.0], |_| [0.0, 0.9, 0.0]),
        RecordingHints::default(),
        AREA_M,
    )
    .unwrap();
    let [low, high] = head_heights(&body);
    assert!(low < 0.4 && high > 1.4, "{low} to {high} m");
    check_course(body, 400.0);
}

#[test]
fn children_and_giants_are_as_tall_as_recorded() {
    let tall = |unit_m: f64, hints: Option<f64>| {
        let body =
            WholeBody::new(&z_up_in(unit_m, &walker(3.0, 0.0)), RecordingHints { unit_m: hints, up: None }, AREA_M)
                .unwrap();
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
    let body = WholeBody::new(&motion, RecordingHints::default(), AREA_M).unwrap();
    let hints = body.notes().join("; ");
    assert!(hints.contains("3.0 s of 4.0 s, since `") && hints.contains("moves 99.0"), "{hints}");
    motion.values.iter_mut().step_by(n_channels).enumerate().for_each(|(frame, it)| *it = 9.0 * frame as f64);
    let refused = WholeBody::new(&motion, RecordingHints::default(), AREA_M).unwrap_err();
    assert!(refused.contains("0.02 s of it without a jump (`") && refused.contains("moves 9.0"), "{refused}");
}

#[test]
fn a_first_frame_like_a_cross_is_left_out() {
    let mut motion = walker(3.0, 0.0);
    let n_channels = motion.n_channels();
    let mut cross = motion.values[..n_channels].to_vec();
    cross[..3].copy_from_slice(&[0.0, 5.0, 7.0]);
    motion.values.splice(0..0, cross);
    check_course(WholeBody::new(&motion, RecordingHints::default(), AREA_M).unwrap(), 100.0);
}

#[test]
fn recorded_people_go_on_without_a_jump() {
    let Some(folder) = std::env::var_os("FOVEATE_DATA").map(PathBuf::from) else {
        return println!("skipped: recorded_people_go_on_without_a_jump needs FOVEATE_DATA, the folder of recordings");
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
            let body = WholeBody::new(&motion, RecordingHints::default(), AREA_M)
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
