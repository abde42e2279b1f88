//! `structured_light.boundaries`: decodes pictures of a stripe boundary code one by one; for each picture, which projector position lights each pixel.
//!
//! 1. Each picture gets the pattern that was shown during all of its exposure or, in a recording, the next one in turn. A picture that comes out of order, or whose pattern is unknown, is left out.
//! 2. Edges of light are found along the rows and tracked, predicted by the head's pose and by the target's velocity (`foresight`).
//! 3. All four patterns are tried until it is certain which one is shown (`follow`). Then known tracks identify it: where the projector dropped a picture, the one that is shown is used.
//! 4. The boundaries of the picture before are decoded, ghosts between where they were and are: so a map comes one picture late, and is of its own picture's time.
//! 5. The code repeats. The distances that the surface may have, around the target or as set, say which repetition it is; where several fit, the boundary is left out.

use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use foveate::geometry::Camera;
use foveate::imaging::ImageView;
use foveate::imaging::stripes::boundary::{DetectOptions, Edges, FRAMES, Held, TrackOptions, Tracker, Turns, detect};
use foveate::imaging::stripes::code::{Axis, StripeCode};
use foveate::node::scale::Spaces;
use foveate::prelude::*;
use nalgebra::Vector3;

use crate::foresight::{Field, lit_from, shift, slope};
use crate::pattern::{PatternSettings, projector_of};

mod conclude;
mod follow;
mod recorded;
mod settings;

use self::recorded::Recorded;
pub use settings::BoundariesSettings;

ports! {
    IMAGE: In<Image> = each("image");
    SHOWN: In<PatternShown> = each("shown").optional();
    POSE: In<HeadPose> = each("pose").optional();
    TARGETS: In<Targets> = latest("targets").of_parent().optional();
    SPACES: In<ScaleSpace> = each("spaces").many().optional();
    MAP: Out<ProjectorMap> = "map";
    WHITE: Out<Image> = "white";
}

figures! {
    "boundaries.frames.*": count, high, "Pictures of the camera that gave a map";
    "boundaries.frames_empty.*": count, low, "Pictures of the camera in which no boundary could be decoded, or few of those before: the first four, and those that are dark, saturated or without stripes, and those of what moves too fast";
    "boundaries.frames_refused.*": count, low, "Pictures of the camera that came out of order, have another size or, once the projector has begun, whose pattern is unknown";
    "boundaries.frames_moving.*": count, low, "Pictures taken while the head moved that gave no map because its pose was less certain than max_pose_px";
    "boundaries.a_frame.*": count, high, "Boundaries per picture that gave a map, counted row by row";
    "boundaries.ghosts.*": share, neither, "Part of these boundaries that did not show in their picture and were interpolated between the pictures before and after";
    "boundaries.unknown_period.*": count, low, "Boundaries left out because no repetition of the code, or more than one, fits the possible distances of the surface";
}

/// Patterns that wait for their pictures.
const HELD: usize = 64;
/// Pictures that wait for the pose of their head.
const WAITING: usize = 8;
/// After a gap of so many pictures nothing is carried on.
const MOST_MISSING: u64 = 3;
/// So many pictures without their next one, and no map: the camera is slower than the projector.
const SLOW: u64 = 3;
/// Boundaries without a repetition are reported from this part on [–].
const UNKNOWN: f64 = 0.05;
/// A projector may drop so many pictures in a row.
const MOST_OTHERS: u32 = 2;
/// Edges for each row, on average, below which a picture has no stripes.
const LEAST_EDGES: f64 = 0.5;

/// Where stripes move in common by more than this beyond what the head's pose says, the pose is in doubt and its picture gives no map [px].
const MOST_OFF_PX: f32 = 3.0;

/// What was seen of the picture before.
struct Before {
    stamp: Stamp,
    camera: Camera,
    number: u64,
    lit_from: Field,
    /// How far stripes moved in common beyond what the head's pose says, to this picture [px].
    off: f32,
    /// Standard deviation of the head's pose in this picture; 0 without a head [px].
    pose_px: f64,
}

/// Pictures of a boundary code in, maps out.
pub struct Boundaries {
    settings: BoundariesSettings,
    camera_name: String,
    camera: Camera,
    projector: Camera,
    has_pose: bool,
    /// Of the scale, where `spaces` says where that is, with its velocity [m/s].
    spaces: Option<(Spaces, Vector3<f64>)>,
    shown: VecDeque<Arc<PatternShown>>,
    /// Of a recording, which pictures show which patterns.
    recorded: Option<Recorded>,
    /// When the light of the first pattern comes.
    lit_from: Option<Time>,
    images: VecDeque<Stamped<Arc<Image>>>,
    poses: VecDeque<Arc<HeadPose>>,
    recent: VecDeque<Arc<Image>>,
    code: Option<(String, StripeCode)>,
    tracker: Tracker,
    /// While it is open which of the four patterns is shown, instead of `tracker`.
    turns: Option<Turns>,
    /// How many pictures what is shown is ahead of what was said.
    ahead: usize,
    /// Whether it was ever found which pattern is shown.
    is_decided: bool,
    /// Of a recording whose `first_shows` is wrong: what it is, and what the first picture shows.
    wrong_first: Option<(u32, u32)>,
    /// What holds of the last pictures.
    held: Held,
    before: Option<Before>,
    last: Option<Time>,
    /// Of the last map [m].
    distance: Option<f64>,
    /// Successive pictures in which the projector showed another pattern than requested.
    others: u32,
    /// Pictures one after the other that were none of the four.
    unclear: u32,
    /// Pictures that were taken up into the tracks …
    taken: u64,
    /// … and which of them showed each of the four patterns last.
    shown_last: [u64; FRAMES],
    /// Boundaries in the best recent map.
    most: f64,
    frames: u64,
    empty: u64,
    refused: u64,
    /// While the head moved.
    moving: u64,
    /// Pictures before that.
    unlit: u64,
    found: u64,
    ghosts: u64,
    unknown_period: u64,
    /// Pictures whose next one of the code is missing.
    unfollowed: u64,
    /// What was wrong: the first time in words, and how often.
    faults: BTreeMap<&'static str, (String, u64)>,
}

impl Node for Boundaries {
    const TYPE: &'static str = "structured_light.boundaries";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str =
        "Matches camera to projector on moving objects by tracking projected stripe boundaries";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = BoundariesSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: BoundariesSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let camera = setup.camera_model().cloned().ok_or_else(|| {
            ConfigError::node(format_args!("`{}` serves one camera: say which with `camera = \"name\"`", Self::TYPE))
        })?;
        let projector = setup.calibration.cameras[projector_of(setup, &settings.projector)?].camera.clone();
        let options = TrackOptions { threads: settings.threads, ..TrackOptions::default() };
        let recorded = match setup.is_connected(&SHOWN) {
            true => None,
            false => Some(Recorded::new(&settings, projector.image_size, setup)?),
        };
        let tracker = Tracker::new(camera.image_size[1] as usize, options).map_err(ConfigError::node)?;
        Ok(Self {
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            has_pose: setup.is_connected(&POSE),
            spaces: setup.is_connected(&SPACES).then(|| (Spaces::new(&setup.scales), Vector3::zeros())),
            settings,
            camera,
            projector,
            shown: VecDeque::new(),
            recorded,
            lit_from: None,
            images: VecDeque::new(),
            poses: VecDeque::new(),
            recent: VecDeque::new(),
            code: None,
            turns: Some(Turns::new(tracker.clone())),
            tracker,
            ahead: 0,
            is_decided: false,
            wrong_first: None,
            held: Held::default(),
            before: None,
            last: None,
            distance: None,
            others: 0,
            unclear: 0,
            taken: 0,
            shown_last: [0; FRAMES],
            most: 0.0,
            frames: 0,
            empty: 0,
            refused: 0,
            moving: 0,
            unlit: 0,
            found: 0,
            ghosts: 0,
            unknown_period: 0,
            unfollowed: 0,
            faults: BTreeMap::new(),
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        while let Some(shown) = io.take(&SHOWN) {
            let latency = Interval::from_ms(self.settings.latency_ms);
            self.lit_from.get_or_insert(shown.value.from + latency);
            self.shown.push_back(shown.value);
            if self.shown.len() > HELD {
                self.shown.pop_front();
            }
        }
        while let Some(space) = io.take(&SPACES) {
            if let Some((spaces, velocity)) = &mut self.spaces {
                spaces.learn(&space.value);
                if space.value.scale == spaces.own() {
                    *velocity = space.value.velocity;
                }
            }
        }
        while let Some(pose) = io.take(&POSE) {
            self.poses.push_back(pose.value);
            if self.poses.len() > HELD {
                self.poses.pop_front();
            }
        }
        while let Some(image) = io.take(&IMAGE) {
            self.images.push_back(image);
        }
        // The pose of a picture may come after it.
        while let Some(image) = self.images.front() {
            let pose = self.poses.iter().find(|it| it.time == image.time()).cloned();
            if self.has_pose && pose.is_none() && self.images.len() <= WAITING {
                break;
            }
            let Some(image) = self.images.pop_front() else { break };
            match self.camera_at(pose.as_deref()) {
                Some(camera) => {
                    let pose_px = pose.map_or(0.0, |it| sigma_px(&it, &camera));
                    self.take(io, &image, camera, pose_px);
                }
                None => {
                    let fault = "found no pose of the camera's head at the time of the picture, expected one";
                    self.refuse(io, image.time(), "pose", fault.to_owned());
                }
            }
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let name = &self.camera_name;
        report.figure(format!("boundaries.frames.{name}"), self.frames as f64);
        report.figure(format!("boundaries.frames_empty.{name}"), self.empty as f64);
        report.figure(format!("boundaries.frames_refused.{name}"), self.refused as f64);
        if self.has_pose {
            report.figure(format!("boundaries.frames_moving.{name}"), self.moving as f64);
        }
        report.figure(format!("boundaries.a_frame.{name}"), self.found as f64 / self.frames as f64);
        report.figure(format!("boundaries.ghosts.{name}"), self.ghosts as f64 / self.found as f64);
        report.figure(format!("boundaries.unknown_period.{name}"), self.unknown_period as f64);
        self.remark_on_start(report);
        let is_slow = self.frames == 0 && self.unfollowed >= SLOW;
        if is_slow {
            report.remark(format!(
                "{name} took no two successive pictures of the code in {} pictures: it is slower than the projector; run both at one rate",
                self.unfollowed + 1
            ));
        }
        let unknown = self.unknown_period as f64 / (self.unknown_period + self.found).max(1) as f64;
        if self.frames > 0 && unknown > UNKNOWN {
            report.remark(format!(
                "{name}: {:.0} % of the boundaries are left out, since no repetition of the code, or more than one, fits the possible distances of the surface; use wider stripes or a narrower `distance_m`",
                100.0 * unknown
            ));
        }
        for (kind, (first, n)) in &self.faults {
            if is_slow && *kind == "missing" {
                continue;
            }
            report.remark(if *n > 1 { format!("{first}; {n} times in all") } else { first.clone() });
        }
        Ok(())
    }
}

fn missing_in_words(n: u64) -> String {
    match n {
        1 => "a picture of the camera is missing before this one".to_owned(),
        n => format!("{n} pictures of the camera are missing before this one"),
    }
}

/// Standard deviation of a head's larger angle, in the middle of the picture [px].
fn sigma_px(pose: &HeadPose, camera: &Camera) -> f64 {
    let [pan, tilt] = [0, 1].map(|axis| pose.angles_covariance[(axis, axis)]);
    camera.intrinsics.focal[0] * pan.max(tilt).max(0.0).sqrt()
}

impl Boundaries {
    /// The camera as it stood; `None` where a head carries it and its pose is not known.
    fn camera_at(&self, pose: Option<&HeadPose>) -> Option<Camera> {
        match pose {
            Some(pose) => Some(Camera { camera_from_world: pose.camera_from_world, ..self.camera.clone() }),
            None => (!self.has_pose).then(|| self.camera.clone()),
        }
    }

    fn note(&mut self, kind: &'static str, time: Time, fault: &str) -> String {
        let words = format!("{} at {:.3} s: {fault}", self.camera_name, time.as_s());
        self.faults.entry(kind).or_insert_with(|| (words.clone(), 0)).1 += 1;
        words
    }

    fn refuse(&mut self, io: &mut Io<'_>, time: Time, kind: &'static str, fault: String) {
        self.refused += 1;
        let words = self.note(kind, time, &fault);
        io.gap(&MAP, time, words);
    }

    /// What the projector reported to show during all of a picture's exposure.
    fn shown_at(&self, time: Time) -> Option<Arc<PatternShown>> {
        let exposure = Interval::from_ms(self.settings.exposure_ms);
        let latency = Interval::from_ms(self.settings.latency_ms);
        let fits = |it: &&Arc<PatternShown>| {
            let middle = it.from + latency + Interval(it.lasts.0 / 2);
            2 * (time - middle).0.abs() <= it.lasts.0 - exposure.0
        };
        self.shown.iter().rev().find(fits).cloned()
    }

    /// The code of what is shown.
    fn code_of(&mut self, shown: &PatternShown) -> Result<StripeCode, String> {
        if let Some((_, code)) = self.code.as_ref().filter(|it| it.0 == shown.manifest) {
            return Ok(code.clone());
        }
        let code = PatternSettings::read(&shown.manifest)?.stripe_code(None).map_err(|fault| fault.message)?;
        if code.frames == 0 {
            return Err("the projector shows a static code, expected `code = \"boundary\"`".to_owned());
        }
        if code.projector != self.projector.image_size {
            let [[a, b], [c, d]] = [code.projector, self.projector.image_size];
            return Err(format!(
                "the pictures are for a projector of {a} x {b} px, expected {c} x {d} px as in the calibration"
            ));
        }
        self.code = Some((shown.manifest.clone(), code.clone()));
        Ok(code)
    }

    fn take(&mut self, io: &mut Io<'_>, image: &Stamped<Arc<Image>>, camera: Camera, pose_px: f64) {
        let time = image.time();
        let size = [image.value.width, image.value.height];
        if let Some(last) = self.last.filter(|it| *it >= time) {
            let fault =
                format!("a picture came after that of {:.3} s, expected pictures in the order of time", last.as_s());
            return self.refuse(io, time, "order", fault);
        }
        if size != camera.image_size
            || image.value.format != PixelFormat::Gray8
            || image.value.window != Default::default()
        {
            let [a, b] = camera.image_size;
            let fault = format!(
                "found a picture of {} x {} px or in colour, expected a gray one of {a} x {b} px",
                size[0], size[1]
            );
            return self.refuse(io, time, "size", fault);
        }
        self.last = Some(time);
        if self.recorded.is_none() && self.lit_from.is_none_or(|it| time < it) {
            self.unlit += 1;
            return;
        }
        let shown = match &self.recorded {
            Some(recorded) => Some(recorded.shown(&image.stamp)),
            None => self.shown_at(time),
        };
        let Some(shown) = shown else {
            let fault = "the pattern shown during all of the exposure is unknown; are `latency_ms` and `exposure_ms` right, are camera and projector in step?";
            return self.refuse(io, time, "shown", fault.to_owned());
        };
        let code = match self.code_of(&shown) {
            Ok(code) => code,
            Err(fault) => return self.refuse(io, time, "code", fault),
        };
        let axis = if code.has(Axis::Columns) { 0 } else { 1 };
        let (range, distance, velocity) = self.whereabouts(io, &camera, time);
        let [along, across] = slope(&camera, &self.projector, axis, distance).unwrap_or([f64::NAN; 2]);
        if along.is_nan() || along <= across.abs() {
            let fault = format!(
                "found {along:.2} {} of the projector for each pixel to the right and {across:.2} for each pixel down, expected rows that cross the stripes from left to right",
                if axis == 0 { "columns" } else { "rows" }
            );
            return self.refuse(io, time, "direction", fault);
        }
        self.tracker.set_pitch((f64::from(code.stripe[axis]) / along) as f32);
        let number = match self.recorded {
            Some(_) => image.stamp.sequence,
            None => shown.set * FRAMES as u64 + u64::from(shown.index),
        };
        let said = shown.index as usize % FRAMES;
        let Ok(view) = ImageView::new(&image.value.pixels, size[0] as usize, size[1] as usize) else {
            return self.refuse(io, time, "size", "found a picture with too few or too many pixels".to_owned());
        };
        let options = DetectOptions {
            min_step: self.settings.min_step,
            min_contrast: self.settings.min_contrast,
            black: self.settings.black,
            noise: self.settings.noise,
            threads: self.settings.threads,
            ..DetectOptions::default()
        };
        let edges = match detect(&view, &options) {
            Ok(edges) => edges,
            Err(fault) => return self.refuse(io, time, "edges", fault.to_string()),
        };
        self.look_over(&edges, &image.value, time);
        let before = self.before.take();
        let passed = before.as_ref().map_or(0, |it| number.saturating_sub(it.number));
        let followed = match &before {
            Some(before) if (1..=MOST_MISSING).contains(&passed) => {
                if passed > 1 {
                    self.note("missing", time, &missing_in_words(passed - 1));
                }
                let by = velocity * (time - before.stamp.time).as_s();
                let field = shift(&before.camera, &camera, &self.projector, distance, &by);
                let predicted = |x: f32, y: f32| field.at(x, y).map(|it| if it.is_finite() { it } else { 0.0 });
                self.follow(&edges, said, Some((passed as u32, &predicted)), time)
            }
            Some(_) if passed == 0 => {
                let fault =
                    "a second picture was taken during the same pattern; is the camera faster than the projector?";
                self.refuse(io, time, "twice", fault.to_owned());
                self.before = before;
                return;
            }
            Some(_) => {
                self.note("missing", time, &format!("{}: tracking restarts", missing_in_words(passed - 1)));
                self.follow(&edges, said, None, time)
            }
            None => self.follow(&edges, said, None, time),
        };
        let off = followed.off;
        if let Some(before) = before.as_ref().filter(|_| passed > 1) {
            self.unfollowed += 1;
            self.empty += 1;
            io.gap(
                &MAP,
                before.stamp.time,
                "the picture after it is missing, so its boundaries cannot be interpolated",
            );
        }
        if let Some(before) = before.filter(|_| passed == 1) {
            let off = off.abs().max(before.off.abs());
            if off > MOST_OFF_PX {
                let fault = format!(
                    "stripes moved by {off:.1} px more than the head's pose predicts, expected at most {MOST_OFF_PX} px: the pose is unreliable"
                );
                self.note("off", before.stamp.time, &fault);
                io.gap(&MAP, before.stamp.time, fault);
            } else if before.pose_px > self.settings.max_pose_px {
                self.moving += 1;
                let fault = format!(
                    "the head moves, and its pose is less certain than the {} px of `max_pose_px`",
                    self.settings.max_pose_px
                );
                io.gap(&MAP, before.stamp.time, fault);
            } else {
                match followed.lines {
                    Some(lines) => self.conclude(io, &before, &code, axis, &image.value, &lines),
                    None => {
                        self.empty += 1;
                        let fault = match self.wrong_first {
                            Some(_) => "`first_shows` is wrong",
                            None => {
                                "it is not yet certain which of the four patterns is shown, or boundaries contradict the stated one"
                            }
                        };
                        io.gap(&MAP, before.stamp.time, fault);
                    }
                }
            }
        }
        self.recent.push_back(Arc::clone(&image.value));
        if self.recent.len() > FRAMES {
            self.recent.pop_front();
        }
        let lit_from = lit_from(&camera, &self.projector, axis, range);
        self.before = Some(Before { stamp: image.stamp, camera, number, lit_from, off, pose_px });
    }

    /// Notes what is wrong with the light of a picture.
    fn look_over(&mut self, edges: &Edges, image: &Image, time: Time) {
        let n = edges.len();
        if edges.n_saturated > n.max(image.height as usize) {
            let fault = format!(
                "too bright: {} edges of light are saturated, {n} are not; use less exposure, gain or light",
                edges.n_saturated
            );
            self.note("bright", time, &fault);
        } else if (n as f64) < LEAST_EDGES * f64::from(image.height) {
            let brightest = image.pixels.iter().max().copied().unwrap_or(0);
            let few = f32::from(brightest) < self.settings.black + 2.0 * self.settings.min_step;
            let why = if few { "too dark" } else { "is the projector on, and in focus, where the camera looks?" };
            let fault = format!("found {n} edges of light, expected at least one in every other row: {why}");
            self.note("dark", time, &fault);
        }
    }
}

#[cfg(test)]
mod stage;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod upset;
