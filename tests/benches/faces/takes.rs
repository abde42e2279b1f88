//! Faces in motion, real and simulated.

use foveate::estimation::Random;
use foveate_messages::Time;
use foveate_sim::painted::{FaceSettings, RecordedHead};
use foveate_sim::world::{SceneSettings, WalkKind, World};
use nalgebra::Point3;

/// The places of all marks at one time [m].
pub type Frame = Vec<Point3<f64>>;

/// A recording of `s09_face_markers_41`, which is in centimetres, head motion included; `None`, with a line that says so, without the data.
pub fn recorded(name: &str) -> Option<Vec<Frame>> {
    let folder = foveate_testkit::data_dir_or_skip("faces", "s09_face_markers_41")?;
    let path = folder.join(format!("{name}_60Hz_cm.csv"));
    let text = match std::fs::read_to_string(&path) {
        Ok(text) => text,
        Err(error) => {
            println!("{}: left out ({error})", path.display());
            return None;
        }
    };
    let row = |line: &str| {
        let numbers: Option<Vec<f64>> = line.split(',').skip(1).map(|it| it.trim().parse().ok()).collect();
        Some(numbers?.chunks_exact(3).map(|it| Point3::new(it[0], it[1], it[2]) * 0.01).collect::<Frame>())
    };
    text.lines().skip(1).map(row).collect()
}

/// Times of a simulated actor's session: the face shows its range for this long, then it acts [s].
pub const SHOWN_S: f64 = 20.0;
const ENTERS_S: f64 = 0.5;

/// Whose head a simulated actor has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Head {
    /// Made of formulas.
    BuiltIn,
    /// The ICT Face Model Light, moved by recorded curves.
    Ict,
}

/// Frames of a simulated actor's painted face, 30 a second: those in which it stands and shows its range, and those of `acted_s` in which it walks about and
/// acts. Each mark off by `noise` on each axis [m]. `None`, with a line that says so, without the recordings of the head.
pub fn simulated(head: Head, n_marks: usize, acted_s: f64, noise: f64) -> Option<[Vec<Frame>; 2]> {
    let settings = SceneSettings {
        face: Some(FaceSettings { marks: n_marks, ..FaceSettings::default() }),
        walk: WalkKind::Stage,
        people_enter_s: ENTERS_S,
        stand_s: SHOWN_S,
        ..SceneSettings::default()
    };
    let world = match head {
        Head::BuiltIn => World::new(settings, &Random::new(1)),
        Head::Ict => {
            let folder = foveate_testkit::data_dir_or_skip("faces", "s13_ict_facekit_min")?;
            match RecordedHead::read(folder.parent()?) {
                Ok(head) => World::with_head(settings, head, &Random::new(1)),
                Err(error) => {
                    println!("the recorded head is left out ({error})");
                    return None;
                }
            }
        }
    };
    let mut random = Random::new(2).fork("marks");
    // It comes onto the stage first: the frames begin when it stands there.
    let mut frame = |time_s: f64| -> Option<Frame> {
        let painted = world.painted(Time::from_s(time_s))?;
        let mut off = || nalgebra::Vector3::new(random.normal(), random.normal(), random.normal()) * noise;
        Some(painted.marks.iter().map(|it| it + off()).collect())
    };
    let from = ENTERS_S + 2.0;
    let mut of = |from_s: f64, to_s: f64| -> Vec<Frame> {
        let count = ((to_s - from_s) * 30.0) as usize;
        (0..count).filter_map(|it| frame(from_s + it as f64 / 30.0)).collect()
    };
    Some([of(from, from + SHOWN_S - 1.0), of(from + SHOWN_S, from + SHOWN_S + acted_s)])
}

/// `count` of them, evenly spread; the first at `offset` of a step.
pub fn spread(frames: &[Frame], count: usize, offset: f64) -> Vec<Frame> {
    let step = frames.len() as f64 / count as f64;
    (0..count).map(|it| frames[((it as f64 + offset) * step) as usize].clone()).collect()
}
