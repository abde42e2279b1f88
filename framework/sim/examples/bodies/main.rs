//! Bodies of simulated people in voxels, found and followed, against their true joints: table by cameras and voxels.
//!
//! `FOVEATE_DATA=… cargo run --release -p foveate-sim --example bodies -- [PEOPLE] [SECONDS] [CAMERAS] [VOXEL_MM] [FAULTS] [FIRST]` prints a line a person and the
//! whole; `… --example bodies -- growth [FILE.svg]` how time and error grow with views, voxels and people. FAULTS 0: silhouettes are those of the true body; 1: holes, shadows at the feet, views that are missing;
//! 2: at the beginning, for half a second or less, views lack a large piece of the body, the same one in all frames.

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use foveate_estimation::random::Random;
use foveate_geometry::body::field::ENDLESS;
use foveate_geometry::body::{BodyTracker, Joint, JointSource, Part, TrackerOptions, VoxelField};
use foveate_scene::skeleton::SkeletonMotion;
use foveate_sim::person::{Person, Pose, RecordingHints, WholeBody};
use nalgebra::{Point3, Vector2, Vector3};

mod growth;
mod scene;

use scene::{Faults, carve, ring};

const RATE_HZ: f64 = 30.0;
/// Hands above this are fast [m/s].
const FAST: f64 = 3.0;
/// Heads that are wrong after that will stay so [s].
const LATE_S: f64 = 1.5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    if std::env::args().nth(1).as_deref() == Some("growth") {
        return growth::growth(&motions()?, std::env::args().nth(2).map(PathBuf::from).as_deref());
    }
    let arguments: Vec<f64> = std::env::args().skip(1).map_while(|it| it.parse().ok()).collect();
    let argument = |place: usize, default: f64| arguments.get(place).copied().unwrap_or(default);
    let (people, seconds) = (argument(0, 20.0) as u64, argument(1, 4.0));
    let (cameras, voxel, faults) = (argument(2, 4.0) as usize, argument(3, 50.0) / 1e3, argument(4, 0.0) as u32);
    let first = argument(5, 0.0) as u64;
    let files = motions()?;
    let cameras = ring(cameras, if cameras <= 4 { [320, 240] } else { [640, 480] });
    let mut all = Score::default();
    for seed in first..first + people {
        let file = &files[seed as usize % files.len()];
        let motion = SkeletonMotion::from_bvh(&std::fs::read_to_string(file)?)?;
        let body = Arc::new(WholeBody::new(&motion, RecordingHints::default(), [1.6, 1.6])?);
        let mut random = Random::new(1000 + seed);
        let person = Person::whole(Arc::clone(&body), Vector2::zeros(), &mut random);
        let girth = random.uniform_in(0.9, 1.25);
        let mut of_pieces = Random::new(5000 + seed);
        let (lost, lost_s) = (scene::lost_pieces(&cameras, &mut of_pieces), of_pieces.uniform_in(0.03, 0.5));
        let mut score = Score::default();
        let mut tracker: Option<BodyTracker> = None;
        for frame in 0..(seconds * RATE_HZ) as usize {
            let time = frame as f64 / RATE_HZ;
            let pose = person.pose(time);
            let faults = match faults {
                1 => Faults::Specks,
                2 if time < lost_s => Faults::Pieces(&lost),
                _ => Faults::None,
            };
            let voxels = carve(&pose, girth, &cameras, voxel, faults, &mut random);
            let start = Instant::now();
            let field = VoxelField::new(voxel, &voxels.0, &voxels.1, ENDLESS);
            match (&mut tracker, &field) {
                (Some(it), Some(field)) => it.step(field, 1.0 / RATE_HZ, &[]),
                (Some(it), None) => it.coast(1.0 / RATE_HZ),
                (None, Some(field)) => match BodyTracker::acquire(field, &TrackerOptions::default()) {
                    Ok(found) => tracker = Some(found),
                    Err(why) => score.failures.push(why.to_string()),
                },
                (None, None) => {}
            }
            if tracker.as_ref().is_some_and(BodyTracker::is_lost) {
                tracker = None;
                score.lost_bodies += 1;
            }
            score.times.push(start.elapsed().as_secs_f64());
            let before = [9, 10].map(|it| person.pose(time - 1.0 / RATE_HZ).parts[it].ends[1]);
            let speed = |it: usize| (pose.parts[9 + it].ends[1] - before[it]).norm() * RATE_HZ;
            score.wrist_speed = speed(0).max(speed(1));
            score.add(&truth(&pose), tracker.as_ref(), time);
            score.add_bias(&pose, tracker.as_ref());
            if std::env::var("TRACE").is_ok() {
                trace(frame, &pose, tracker.as_ref());
            }
        }
        let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        println!("{seed:>3} {name:<22} {:.2} m ×{girth:.2} {}", body.stature_m(), score.line());
        println!("    {}", score.by_facing());
        all.join(score);
    }
    println!("all {:<35} {}", "", all.line());
    println!("    {}", all.by_joint());
    println!("    {}", all.by_bias());
    println!("    {}", all.by_sigma());
    println!("    {}", all.by_facing());
    println!("    {}", all.by_person());
    Ok(())
}

/// Recorded motions of people.
fn motions() -> Result<Vec<PathBuf>, Box<dyn std::error::Error>> {
    let mut files = Vec::new();
    let data = PathBuf::from(std::env::var("FOVEATE_DATA").unwrap_or_else(|_| "../shared/data".to_owned()));
    for set in ["s18_bvh", "s22_bvh_people"] {
        for entry in std::fs::read_dir(data.join(set))?.flatten() {
            files.push(entry.path());
        }
    }
    files.retain(|it| it.extension().is_some_and(|it| it == "bvh"));
    files.sort();
    Ok(files)
}

fn trace(frame: usize, pose: &Pose, tracker: Option<&BodyTracker>) {
    let truth = truth(pose);
    let Some(tracker) = tracker else { return println!("  {frame:>3} –") };
    let found = tracker.joints();
    let off: Vec<String> = truth
        .iter()
        .map(|(joint, place)| match found.iter().find(|it| it.joint == *joint) {
            Some(it) => format!("{:>4.0}", (it.position - place).norm() * 1e3),
            None => "   –".to_owned(),
        })
        .collect();
    let support = tracker.support();
    let shares = |it: [f64; 10]| it.map(|it| format!("{it:.1}")).join(" ");
    println!(
        "  {frame:>3} {} | in {} | cov {} | free {:.2} facing {:.2}",
        off.join(" "),
        shares(support.inside),
        shares(support.covered),
        support.unexplained,
        tracker.facing()
    );
}

/// The ten-part model's joints on the simulated body.
fn truth(pose: &Pose) -> [(Joint, Point3<f64>); 10] {
    let head = Point3::from(pose.head.translation.vector);
    let end = |part: usize, end: usize| pose.parts[part].ends[end];
    [
        (Joint::Head, head),
        (Joint::Neck, pose.head * Point3::new(0.0, 0.0, -pose.parts[3].radius)),
        (Joint::LeftShoulder, end(7, 0)),
        (Joint::RightShoulder, end(8, 0)),
        (Joint::LeftElbow, end(7, 1)),
        (Joint::RightElbow, end(8, 1)),
        (Joint::LeftHip, end(11, 0)),
        (Joint::RightHip, end(12, 0)),
        (Joint::LeftKnee, end(11, 1)),
        (Joint::RightKnee, end(12, 1)),
    ]
}

fn other_side(name: &str) -> String {
    match name.split_once('-') {
        Some(("left", rest)) => format!("right-{rest}"),
        Some(("right", rest)) => format!("left-{rest}"),
        _ => name.to_owned(),
    }
}

#[derive(Default)]
struct Score {
    /// Joint, error [m].
    errors: Vec<(Joint, f64)>,
    /// Joint, from the true place to the one found: to the front, to the side that the joint is on, up [m].
    biases: Vec<(Joint, [f64; 3])>,
    /// Joint, provenance, and a third of its squared error over the stated covariance: 1 where sigmas are right.
    normalised: Vec<(Joint, JointSource, f64)>,
    /// Of the torso's front from the true one [rad].
    yaws: Vec<f64>,
    /// How sure the sides are, and whether they are right.
    facings: Vec<(f64, bool)>,
    ends: Vec<f64>,
    missing: usize,
    frames: usize,
    bodies: usize,
    heads_right: usize,
    heads_wrong: usize,
    heads_wrong_late: usize,
    swapped: usize,
    complete_s: Vec<f64>,
    is_complete: bool,
    lost_for: Vec<(Joint, usize)>,
    lost: usize,
    /// Of these, while a hand was faster than 3 m/s; how fast the faster one is, and how many frames have it so fast.
    lost_fast: usize,
    wrist_speed: f64,
    frames_fast: usize,
    /// Median and 95 % of each person [m].
    people: Vec<[f64; 2]>,
    lost_bodies: usize,
    times: Vec<f64>,
    failures: Vec<String>,
}

fn percentile(values: &mut [f64], share: f64) -> f64 {
    values.sort_by(f64::total_cmp);
    values.get(((values.len() as f64 - 1.0) * share).round().max(0.0) as usize).copied().unwrap_or(f64::NAN)
}

impl Score {
    fn add(&mut self, truth: &[(Joint, Point3<f64>)], tracker: Option<&BodyTracker>, time: f64) {
        self.frames += 1;
        self.frames_fast += usize::from(self.wrist_speed > FAST);
        let Some(tracker) = tracker else {
            self.missing += truth.len();
            return;
        };
        self.bodies += 1;
        let found = tracker.joints();
        let place = |joint: Joint| found.iter().find(|it| it.joint == joint).map(|it| it.position);
        let (mut straight, mut crossed) = (0.0, 0.0);
        for (joint, true_place) in truth {
            let Some(found) = place(*joint) else {
                self.missing += 1;
                continue;
            };
            let error = (found - true_place).norm();
            self.errors.push((*joint, error));
            let mirrored = match joint {
                Joint::LeftShoulder => Some(Joint::RightShoulder),
                Joint::LeftHip => Some(Joint::RightHip),
                _ => None,
            };
            if let Some(other) = mirrored.and_then(place) {
                straight += error;
                crossed += (other - true_place).norm();
            }
            if *joint == Joint::Head {
                if error < 0.05 {
                    self.heads_right += 1;
                } else {
                    self.heads_wrong += 1;
                    self.heads_wrong_late += usize::from(time > LATE_S);
                }
            }
            let entry = match self.lost_for.iter_mut().find(|it| it.0 == *joint) {
                Some(it) => it,
                None => {
                    self.lost_for.push((*joint, 0));
                    let last = self.lost_for.len() - 1;
                    &mut self.lost_for[last]
                }
            };
            entry.1 = if error > 0.15 { entry.1 + 1 } else { 0 };
            if entry.1 == (0.5 * RATE_HZ) as usize {
                self.lost += 1;
                self.lost_fast += usize::from(self.wrist_speed > FAST);
            }
        }
        self.swapped += usize::from(crossed < straight);
        if found.len() == 14 && !self.is_complete {
            self.is_complete = true;
            self.complete_s.push(time);
        }
    }

    /// Offsets of joints from their true places, in the axes of the true trunk, whether or not left and right are exchanged.
    fn add_bias(&mut self, pose: &Pose, tracker: Option<&BodyTracker>) {
        let Some(tracker) = tracker else { return };
        let truth = truth(pose);
        let of = |joint: Joint| truth.iter().find(|it| it.0 == joint).map_or(Point3::origin(), |it| it.1);
        let [shoulders, hips] = [[Joint::LeftShoulder, Joint::RightShoulder], [Joint::LeftHip, Joint::RightHip]]
            .map(|it| (of(it[0]), of(it[1])));
        let up = (nalgebra::center(&shoulders.0, &shoulders.1) - nalgebra::center(&hips.0, &hips.1)).normalize();
        let front = (shoulders.0 - shoulders.1).cross(&up).normalize();
        let left = up.cross(&front);
        let found_front = tracker.filter().body.turn(Part::Torso) * Vector3::x();
        let is_right = found_front.dot(&front) > 0.0;
        self.yaws.push(found_front.dot(&left).atan2(found_front.dot(&front)));
        self.facings.push((tracker.facing(), is_right));
        let mirrored = |joint: Joint| Joint::ALL.into_iter().find(|it| it.name() == other_side(joint.name()));
        for it in tracker.joints() {
            let Some(named) = (if is_right { Some(it.joint) } else { mirrored(it.joint) }) else { continue };
            let Some((_, place)) = truth.iter().find(|it| it.0 == named) else { continue };
            let away = it.position - place;
            let out = if named.name().starts_with("right") { -1.0 } else { 1.0 };
            if let Some(inverse) = it.covariance.fixed_view::<3, 3>(0, 0).into_owned().try_inverse() {
                self.normalised.push((named, it.source, away.dot(&(inverse * away)) / 3.0));
            }
            self.biases.push((named, [away.dot(&front), away.dot(&left) * out, away.dot(&up)]));
        }
    }

    fn join(&mut self, other: Score) {
        self.biases.extend(other.biases);
        self.normalised.extend(other.normalised);
        self.yaws.extend(other.yaws);
        self.facings.extend(other.facings);
        let n_errors = other.errors.len();
        self.errors.extend(other.errors);
        self.ends.extend(other.ends);
        self.missing += other.missing;
        self.frames += other.frames;
        self.bodies += other.bodies;
        self.heads_right += other.heads_right;
        self.heads_wrong += other.heads_wrong;
        self.heads_wrong_late += other.heads_wrong_late;
        self.swapped += other.swapped;
        if !other.is_complete {
            self.complete_s.push(f64::INFINITY);
        }
        self.complete_s.extend(other.complete_s);
        self.lost += other.lost;
        self.lost_fast += other.lost_fast;
        self.frames_fast += other.frames_fast;
        let mut mm: Vec<f64> = self.errors[self.errors.len() - n_errors..].iter().map(|it| it.1).collect();
        self.people.push([percentile(&mut mm, 0.5), percentile(&mut mm, 0.95)]);
        self.lost_bodies += other.lost_bodies;
        self.times.extend(other.times);
    }

    fn line(&mut self) -> String {
        let mut mm: Vec<f64> = self.errors.iter().map(|it| it.1 * 1e3).collect();
        let mut ms: Vec<f64> = self.times.iter().map(|it| it * 1e3).collect();
        let frames = self.frames as f64;
        format!(
            "median {:>5.1} p95 {:>6.1} mm | head {:.2} wrong {:.3} late {:.3} | missing {:.3} lost {} ({} bodies) swapped {:.2} | complete {:.2} s | {:.1} ms{}",
            percentile(&mut mm, 0.5),
            percentile(&mut mm, 0.95),
            self.heads_right as f64 / frames,
            self.heads_wrong as f64 / frames,
            self.heads_wrong_late as f64 / frames,
            self.missing as f64 / frames / 10.0,
            self.lost,
            self.lost_bodies,
            self.swapped as f64 / self.bodies.max(1) as f64,
            percentile(&mut self.complete_s, 0.95),
            percentile(&mut ms, 0.5),
            self.failures.first().map_or(String::new(), |it| format!(" | {it}")),
        )
    }

    /// Medians of where joints lie beside their true places, and of how sure sides are.
    fn by_bias(&self) -> String {
        let one = |joint: &Joint| {
            let median = |axis: usize| {
                let mut mm: Vec<f64> =
                    self.biases.iter().filter(|it| it.0 == *joint).map(|it| it.1[axis] * 1e3).collect();
                percentile(&mut mm, 0.5)
            };
            format!("{} {:+.0} {:+.0} {:+.0}", joint.name(), median(0), median(1), median(2))
        };
        let named = Joint::ALL.iter().filter(|it| self.biases.iter().any(|e| e.0 == **it));
        named.map(one).collect::<Vec<_>>().join(", ")
    }

    /// Squared errors over what is stated: median (0.79 of a Gaussian), 95 % (2.6), and mean (1).
    fn by_sigma(&self) -> String {
        let median_and_most = |of: &dyn Fn(&(Joint, JointSource, f64)) -> bool| {
            let mut all: Vec<f64> = self.normalised.iter().filter(|it| of(it)).map(|it| it.2).collect();
            let mean = all.iter().sum::<f64>() / all.len().max(1) as f64;
            format!("{:.2}/{:.1}, mean {mean:.1}", percentile(&mut all, 0.5), percentile(&mut all, 0.95))
        };
        let sources = [JointSource::Measured, JointSource::Filled, JointSource::Predicted].map(|source| {
            let n = self.normalised.iter().filter(|it| it.1 == source).count();
            let share = n as f64 / self.normalised.len().max(1) as f64;
            format!("{source:?} ({share:.2} of all) {}", median_and_most(&|it| it.1 == source))
        });
        let named = Joint::ALL.into_iter().filter(|it| self.normalised.iter().any(|e| e.0 == *it));
        let joints = named.map(|joint| format!("{} {}", joint.name(), median_and_most(&|it| it.0 == joint)));
        let all = std::iter::once(format!("normalised squared errors: all {}", median_and_most(&|_| true)));
        all.chain(sources).chain(joints).collect::<Vec<_>>().join(", ")
    }

    /// Medians over people, and the worst of them; what was lost while hands were fast.
    fn by_person(&self) -> String {
        let of = |axis: usize, share: f64| {
            percentile(&mut self.people.iter().map(|it| it[axis] * 1e3).collect::<Vec<_>>(), share)
        };
        format!(
            "people: median {:.0}, worst {:.0} mm; p95 {:.0}, worst {:.0} mm; frames with a hand above {FAST} m/s {:.2}, joints lost then {}",
            of(0, 0.5),
            of(0, 1.0),
            of(1, 0.5),
            of(1, 1.0),
            self.frames_fast as f64 / self.frames.max(1) as f64,
            self.lost_fast,
        )
    }

    /// How many frames state their sides (surer than a half), and how many of these are wrong.
    fn by_facing(&self) -> String {
        let stated: Vec<bool> = self.facings.iter().filter(|it| it.0 > 0.5).map(|it| it.1).collect();
        let wrong = stated.iter().filter(|it| !**it).count();
        let mut yaws: Vec<f64> = self.yaws.iter().map(|it| it.sin().asin().abs().to_degrees()).collect();
        format!(
            "sides stated {:.2}, of these wrong {:.3}; front off by {:.0}°, p95 {:.0}°",
            stated.len() as f64 / self.facings.len().max(1) as f64,
            wrong as f64 / stated.len().max(1) as f64,
            percentile(&mut yaws, 0.5),
            percentile(&mut yaws, 0.95),
        )
    }

    fn by_joint(&self) -> String {
        let one = |joint: &Joint| {
            let mut mm: Vec<f64> = self.errors.iter().filter(|it| it.0 == *joint).map(|it| it.1 * 1e3).collect();
            format!("{} {:.0}/{:.0}", joint.name(), percentile(&mut mm, 0.5), percentile(&mut mm, 0.95))
        };
        Joint::ALL.iter().filter(|it| self.errors.iter().any(|e| e.0 == **it)).map(one).collect::<Vec<_>>().join(", ")
    }
}
