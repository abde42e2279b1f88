//! A small lab with known truth: cameras under the ceiling, moving lights, and the disturbances of a real lab: noise,
//! clutter, lights hidden from one camera or from all, spots that melt into one, clocks that disagree, links that are late,
//! cameras that are slow, lose frames or fail.
//!
//! Features are given directly; pictures are the business of the room `sim`.

mod paths;
mod room;
mod score;

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_messages::{CameraId, Feature, Features, Interval, Time};
use nalgebra::{Matrix2, Point2};

pub use paths::{Crossings, Light, Lights, Path, Wanderers};
pub use room::{ROOM_M, cameras, person};
pub use score::{GATE_M, Score, ScoreOptions, Scorer, score};

/// What the lab is like.
#[derive(Debug, Clone)]
pub struct Lab {
    /// All cameras, in the order of their numbers.
    pub cameras: Vec<Camera>,
    /// By camera; where it is shorter than `cameras`, the rest is as [`Conditions::default`].
    pub conditions: Vec<Conditions>,
    /// Standard deviation of a feature's place, each axis [px].
    pub noise: f64,
    /// False features a frame, on average.
    pub clutter: f64,
    /// Part of the time that a light is hidden from a camera.
    pub hidden: f64,
    /// When lights are hidden from all cameras at once.
    pub occlusions: Option<Occlusions>,
    /// Features nearer to each other than this melt into one [px].
    pub melt: f64,
    /// Whether lights shine to one side only.
    pub directional: bool,
    /// Frames a second of each camera [Hz].
    pub rate: f64,
    /// Whether all cameras expose at once.
    pub synchronous: bool,
    /// The same lab for the same seed.
    pub seed: u64,
}

/// Deviations of one camera.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Conditions {
    /// Only each (this + 1)-th frame is taken: 1 makes a camera of 60 Hz one of 30 Hz.
    pub skips: u32,
    /// Its clock is ahead by this at time 0 [s].
    pub clock_ahead_s: f64,
    /// And gains this in each second [s/s].
    pub clock_drift: f64,
    /// From capture to arrival [s].
    pub delay_s: f64,
    /// And up to this more, drawn for each frame; frames of one camera never overtake each other [s].
    pub jitter_s: f64,
    /// Part of its frames that get lost.
    pub lost: f64,
    /// From when to when it is dead [s].
    pub dead_s: Option<[f64; 2]>,
}

/// Lights that no camera sees for a while, each at its own times.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Occlusions {
    /// One episode a light in each span of this length, at a random moment of it [s].
    pub every_s: f64,
    /// Least and largest length [s].
    pub last_s: [f64; 2],
}

/// One frame on its way.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// When it was captured, by the camera's clock.
    pub stated: Time,
    /// When it was captured in truth.
    pub captured: Time,
    /// When it arrives, in truth.
    pub arrives: Time,
    /// What it shows.
    pub features: Features,
}

impl Lab {
    /// `n_cameras` of [`cameras`] at 60 Hz, unsynchronised, 0.3 px of noise, no disturbances. Seed 1.
    pub fn new(n_cameras: usize) -> Self {
        Self {
            cameras: cameras(n_cameras),
            conditions: Vec::new(),
            noise: 0.3,
            clutter: 0.0,
            hidden: 0.0,
            occlusions: None,
            melt: 0.0,
            directional: false,
            rate: 60.0,
            synchronous: false,
            seed: 1,
        }
    }

    /// All frames of `duration_s`, as they arrive, each with the time of capture that its camera states.
    pub fn frames(&self, duration_s: f64, lights: &impl Lights) -> Vec<(Time, Features)> {
        self.stream(duration_s, lights).map(|it| (it.stated, it.features)).collect()
    }

    /// All frames of `duration_s`, as they arrive, one by one.
    pub fn stream<'a, L: Lights>(&'a self, duration_s: f64, lights: &'a L) -> Stream<'a, L> {
        let hidden = Hidden::new(self, duration_s, lights.count());
        let mut stream =
            Stream { lab: self, lights, hidden, eyes: Vec::new(), due: BinaryHeap::new(), here: Vec::new() };
        let root = Random::new(self.seed);
        for camera in 0..self.cameras.len() {
            let mut random = root.fork(&format!("camera {camera}"));
            let conditions = self.conditions.get(camera).copied().unwrap_or_default();
            let offset_s = if self.synchronous { 0.0 } else { random.uniform() / self.rate };
            stream.eyes.push(Eye {
                conditions,
                offset_s,
                link: random.fork("link"),
                random,
                hidden: vec![false; lights.count()],
                next: 0,
                end: (duration_s * self.rate) as u64,
                arrived: Time(i64::MIN),
            });
            stream.queue(camera);
        }
        stream
    }
}

/// One camera while it looks.
struct Eye {
    conditions: Conditions,
    /// Of its first frame [s].
    offset_s: f64,
    random: Random,
    link: Random,
    /// By light.
    hidden: Vec<bool>,
    /// Numbers of the next frame and of the one after the last.
    next: u64,
    end: u64,
    /// When its last frame arrived.
    arrived: Time,
}

/// All frames of a lab, as they arrive.
pub struct Stream<'a, L> {
    lab: &'a Lab,
    lights: &'a L,
    hidden: Hidden,
    eyes: Vec<Eye>,
    /// Each camera's next arrival; the number of the frame is the eye's.
    due: BinaryHeap<Reverse<(Time, usize, Time)>>,
    here: Vec<Light>,
}

impl<L: Lights> Stream<'_, L> {
    /// Looks up when the next frame of `camera` will arrive.
    fn queue(&mut self, camera: usize) {
        let eye = &mut self.eyes[camera];
        if eye.next < eye.end {
            let captured = Time::from_s(eye.offset_s + eye.next as f64 / self.lab.rate);
            let Conditions { delay_s, jitter_s, .. } = eye.conditions;
            let delay = Interval::from_s(delay_s + eye.link.uniform() * jitter_s);
            eye.arrived = eye.arrived.max(captured + delay);
            self.due.push(Reverse((eye.arrived, camera, captured)));
        }
    }

    /// What `camera` sees at `time_s`.
    fn look(&mut self, camera: usize, time_s: f64) -> Vec<Feature> {
        let (lab, eye, model) = (self.lab, &mut self.eyes[camera], &self.lab.cameras[camera]);
        let random = &mut eye.random;
        let mut list = Vec::new();
        self.lights.at(time_s, &mut self.here);
        for (it, light) in self.here.iter().enumerate() {
            // Hidden for 0.2 s on average, as often as it takes.
            let leave = 1.0 / (0.2 * lab.rate);
            let enter = leave * lab.hidden / (1.0 - lab.hidden);
            eye.hidden[it] ^= random.uniform() < if eye.hidden[it] { leave } else { enter };
            let towards = (model.centre() - light.position).normalize();
            let turned_away = lab.directional && towards.dot(&light.normal.normalize()) < -0.1;
            let noise = Point2::new(random.normal(), random.normal()) * lab.noise;
            let is_hidden = eye.hidden[it] || turned_away || self.hidden.at(it, time_s);
            if let Some(pixel) = model.sees(&light.position).filter(|_| !is_hidden) {
                list.push(feature(pixel + noise.coords, lab.noise));
            }
        }
        melt(&mut list, lab.melt);
        let mut expected = lab.clutter;
        while random.uniform() < expected {
            let [width, height] = model.image_size.map(f64::from);
            let place = Point2::new(random.uniform_in(0.0, width), random.uniform_in(0.0, height));
            list.push(feature(place, lab.noise));
            expected -= 1.0;
        }
        list.sort_by(|a, b| a.centre.y.total_cmp(&b.centre.y));
        list
    }
}

impl<L: Lights> Iterator for Stream<'_, L> {
    type Item = Frame;

    fn next(&mut self) -> Option<Frame> {
        loop {
            let Reverse((arrives, camera, captured)) = self.due.pop()?;
            let number = self.eyes[camera].next;
            let time_s = self.eyes[camera].offset_s + number as f64 / self.lab.rate;
            let list = self.look(camera, time_s);
            let eye = &mut self.eyes[camera];
            let Conditions { skips, clock_ahead_s, clock_drift, lost, dead_s, .. } = eye.conditions;
            let is_lost = lost > 0.0 && eye.link.uniform() < lost;
            let is_dead = dead_s.is_some_and(|[from, to]| (from..to).contains(&time_s));
            eye.next += 1;
            self.queue(camera);
            if is_lost || is_dead || !number.is_multiple_of(u64::from(skips) + 1) {
                continue;
            }
            let stated = captured + Interval::from_s(clock_ahead_s + clock_drift * time_s);
            let features = Features { camera: CameraId(camera as u16), list };
            return Some(Frame { stated, captured, arrives, features });
        }
    }
}

/// By light, by span: from when to when it is hidden from all [s].
struct Hidden {
    every_s: f64,
    episodes: Vec<Vec<[f64; 2]>>,
}

impl Hidden {
    fn new(lab: &Lab, duration_s: f64, n_lights: usize) -> Self {
        let Some(Occlusions { every_s, last_s }) = lab.occlusions else {
            return Self { every_s: f64::INFINITY, episodes: Vec::new() };
        };
        let root = Random::new(lab.seed).fork("occlusions");
        let of_light = |light: usize| {
            let mut random = root.fork(&format!("light {light}"));
            let n_spans = (duration_s / every_s).ceil() as usize + 1;
            let episode = |span: usize| {
                let length = random.uniform_in(last_s[0], last_s[1]);
                let start = span as f64 * every_s + random.uniform() * (every_s - length).max(0.0);
                [start, start + length]
            };
            (0..n_spans).map(episode).collect()
        };
        Self { every_s, episodes: (0..n_lights).map(of_light).collect() }
    }

    fn at(&self, light: usize, time_s: f64) -> bool {
        let episode = self.episodes.get(light).and_then(|it| it.get((time_s / self.every_s) as usize));
        episode.is_some_and(|[from, to]| (*from..*to).contains(&time_s))
    }
}

/// Makes one feature, midway, of each two that are nearer than `distance` [px].
fn melt(list: &mut Vec<Feature>, distance: f64) {
    let mut index = 0;
    while index < list.len() {
        let centre = list[index].centre;
        let near = (index + 1..list.len()).find(|it| (list[*it].centre - centre).norm() < distance);
        match near {
            Some(other) => {
                let other = list.remove(other);
                list[index].centre = nalgebra::center(&centre, &other.centre);
                list[index].area += other.area;
            }
            None => index += 1,
        }
    }
}

/// A feature at `centre` [px] with an error of `sigma` [px] on each axis.
pub fn feature(centre: Point2<f64>, sigma: f64) -> Feature {
    Feature { centre, covariance: Matrix2::identity() * (sigma * sigma).max(1e-4), area: 9, peak: 200, label: None }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STILL: fn(f64) -> [Light; 1] = |_| [Light::at(nalgebra::Point3::new(0.1, 0.2, 1.2))];

    fn frames(lab: &Lab, duration_s: f64) -> Vec<Frame> {
        lab.stream(duration_s, &STILL).collect()
    }

    #[test]
    fn undisturbed_frames_come_in_order_of_capture_and_see_the_light_where_it_is() {
        let lab = Lab { noise: 0.0, ..Lab::new(5) };
        let frames = frames(&lab, 1.0);
        assert_eq!(frames.len(), 5 * 60);
        assert!(frames.is_sorted_by_key(|it| it.captured));
        for frame in &frames {
            assert!(frame.stated == frame.captured && frame.arrives == frame.captured);
            let camera = &lab.cameras[usize::from(frame.features.camera.0)];
            let seen: Vec<_> = frame.features.list.iter().map(|it| it.centre).collect();
            assert_eq!(seen, [camera.sees(&STILL(0.0)[0].position).unwrap()]);
        }
    }

    #[test]
    fn each_camera_has_its_own_clock_link_rate_and_fate() {
        let conditions = vec![
            Conditions { clock_ahead_s: 0.004, clock_drift: 1e-3, ..Conditions::default() },
            Conditions { delay_s: 0.01, jitter_s: 0.05, ..Conditions::default() },
            Conditions { skips: 1, ..Conditions::default() },
            Conditions { dead_s: Some([1.0, 3.0]), ..Conditions::default() },
            Conditions { lost: 0.25, ..Conditions::default() },
        ];
        let frames = frames(&Lab { conditions, ..Lab::new(6) }, 10.0);
        let of = |camera: u16| -> Vec<&Frame> { frames.iter().filter(|it| it.features.camera.0 == camera).collect() };
        assert!(frames.is_sorted_by_key(|it| it.arrives) && !frames.is_sorted_by_key(|it| it.captured));
        for frame in of(0) {
            let ahead = (frame.stated - frame.captured).as_s();
            assert!((ahead - 0.004 - 1e-3 * frame.captured.as_s()).abs() < 1e-8);
        }
        let delays: Vec<f64> = of(1).iter().map(|it| (it.arrives - it.captured).as_ms()).collect();
        assert!(delays.iter().all(|it| (10.0..60.001).contains(it)) && delays.iter().any(|it| *it > 50.0));
        assert!(of(1).is_sorted_by_key(|it| it.captured));
        assert_eq!((of(2).len(), of(3).len(), of(5).len()), (300, 480, 600));
        assert!((400..500).contains(&of(4).len()));
    }

    #[test]
    fn occlusions_hide_from_all_cameras_for_as_long_as_asked() {
        let occlusions = Some(Occlusions { every_s: 2.0, last_s: [0.1, 0.6] });
        let frames = frames(&Lab { occlusions, ..Lab::new(6) }, 20.0);
        let mut gaps = Vec::new();
        let mut last = 0.0;
        for frame in frames.iter().filter(|it| !it.features.list.is_empty()) {
            let now = frame.captured.as_s();
            if now - last > 0.05 {
                gaps.push(now - last);
            }
            last = now;
        }
        assert_eq!(gaps.len(), 10, "{gaps:?}");
        assert!(gaps.iter().all(|it| (0.09..0.63).contains(it)), "{gaps:?}");
    }

    #[test]
    fn near_features_melt_into_one() {
        let mut list: Vec<Feature> = [1.0, 9.0, 2.0].map(|x| feature(Point2::new(x, 5.0), 0.3)).to_vec();
        melt(&mut list, 2.0);
        let found: Vec<_> = list.iter().map(|it| (it.centre.x, it.area)).collect();
        assert_eq!(found, [(1.5, 18), (9.0, 9)]);
    }
}
