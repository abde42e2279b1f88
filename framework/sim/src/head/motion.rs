//! A simulated head in a rig: a line for its driver, and where the camera on it stands.
//!
//! Line and motion are two handles to one head on the logical clock of the run. Whoever asks first at some time lets the head live until
//! then; since what a driver writes reaches the head after it was written, the answers do not depend on who asked first.

use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate_dataflow::{ConfigError, Device, Line};
use foveate_estimation::random::Random;
use foveate_geometry::Camera;
use foveate_geometry::pan_tilt::{PanTiltHead, Setting};
use foveate_messages::{CameraId, Interval, Message, SpaceKind, Time};

use super::datagrams::NetworkHead;
use super::device::Head;
use super::line::SerialHead;
use super::mechanics::TICK;
use super::settings::{HeadSettings, LineSettings, NetworkSettings};

/// What happens to a line, and when.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LineFaults {
    /// It is pulled out: nothing arrives at either end.
    pub unplugged: Option<Range<Time>>,
    /// The head says nothing, and does what it is told.
    pub silent: Option<Range<Time>>,
    /// This share of the bytes is changed on both ways.
    pub garbage: Option<(Range<Time>, f64)>,
}

/// A head at the end of its line, on a logical clock.
#[derive(Debug, Clone)]
pub struct LineHead {
    end: End,
    faults: LineFaults,
    now: Time,
}

#[derive(Debug, Clone)]
enum End {
    Serial { head: SerialHead, line: LineSettings },
    Network { head: NetworkHead, network: NetworkSettings, garbage: f64, random: Random, there: Way, back: Way },
}

/// Datagrams on their way, in the order in which they were sent.
type Way = std::collections::VecDeque<(Time, Vec<u8>)>;

impl LineHead {
    /// On a serial line.
    ///
    /// # Errors
    /// Settings out of their ranges.
    pub fn serial(
        head: &HeadSettings,
        line: &LineSettings,
        faults: LineFaults,
        seed: u64,
    ) -> Result<LineHead, ConfigError> {
        let end = End::Serial { head: SerialHead::new(head, line, seed)?, line: line.clone() };
        let mut found = LineHead { end, faults, now: Time::ZERO };
        found.take_up_faults();
        Ok(found)
    }

    /// On a network.
    ///
    /// # Errors
    /// Settings out of their ranges.
    pub fn network(
        head: &HeadSettings,
        network: &NetworkSettings,
        faults: LineFaults,
        seed: u64,
    ) -> Result<LineHead, ConfigError> {
        network.check()?;
        let end = End::Network {
            head: NetworkHead::new(head, seed)?,
            network: network.clone(),
            garbage: network.garbage,
            random: Random::new(seed).fork("network"),
            there: Way::new(),
            back: Way::new(),
        };
        let mut found = LineHead { end, faults, now: Time::ZERO };
        found.take_up_faults();
        Ok(found)
    }

    /// The head itself.
    pub fn head(&self) -> &Head {
        match &self.end {
            End::Serial { head, .. } => head.head(),
            End::Network { head, .. } => head.head(),
        }
    }

    /// Lives until `to`; a time that has passed changes nothing.
    pub fn advance(&mut self, to: Time) {
        // Faults begin and end on the way.
        while let Some(edge) = self.faults.edges().filter(|it| (self.now < *it) && (*it <= to)).min() {
            self.live_until(edge);
            self.take_up_faults();
        }
        self.live_until(to);
    }

    fn live_until(&mut self, to: Time) {
        let mut at = self.now;
        self.now = at.max(to);
        match &mut self.end {
            End::Serial { head, .. } => head.advance(self.now),
            // Replies are fetched at every tick, in which they are sent, whoever asks and when.
            End::Network { head, there, back, network, garbage, random } => loop {
                while there.front().is_some_and(|it| it.0 <= at)
                    && let Some((arrived, datagram)) = there.pop_front()
                {
                    head.receive(arrived, &datagram);
                }
                while let Some(reply) = head.send(at) {
                    network.send(at, reply, *garbage, random, back);
                }
                if at >= self.now {
                    return;
                }
                let tick = Time((at.0.div_euclid(TICK.0) + 1) * TICK.0);
                at = there.front().map_or(tick, |it| it.0.min(tick)).min(self.now);
            },
        }
    }

    fn take_up_faults(&mut self) {
        let now = self.now;
        let garbage = self.faults.garbage.as_ref().filter(|it| it.0.contains(&now)).map_or(0.0, |it| it.1);
        let is_unplugged = self.faults.is_unplugged(now);
        match &mut self.end {
            End::Serial { head, line } => {
                if head.is_plugged() == is_unplugged {
                    head.set_plugged(!is_unplugged);
                }
                let flipped = line.flipped.max(garbage);
                // Both shares were checked.
                let _ = head.set_line(&LineSettings { flipped, ..line.clone() });
            }
            End::Network { network, garbage: share, there, back, .. } => {
                *share = network.garbage.max(garbage);
                if is_unplugged {
                    there.clear();
                    back.clear();
                }
            }
        }
    }
}

impl Device for LineHead {
    fn write(&mut self, now: Time, bytes: &[u8]) {
        self.advance(now);
        let now = self.now;
        match &mut self.end {
            End::Serial { head, .. } => head.write(now, bytes),
            End::Network { .. } if self.faults.is_unplugged(now) => {}
            End::Network { network, garbage, random, there, .. } => {
                network.send(now, bytes.to_vec(), *garbage, random, there);
            }
        }
    }

    fn read(&mut self, now: Time, bytes: &mut Vec<u8>) {
        self.advance(now);
        let now = self.now;
        let is_silent = self.faults.silent.as_ref().is_some_and(|it| it.contains(&now));
        match &mut self.end {
            End::Serial { head, .. } => {
                let heard = head.read(now);
                if !is_silent {
                    bytes.extend(heard);
                }
            }
            End::Network { back, .. } => {
                while back.front().is_some_and(|it| it.0 <= now)
                    && let Some((_, datagram)) = back.pop_front()
                {
                    if !is_silent {
                        bytes.extend(datagram);
                        return;
                    }
                }
            }
        }
    }

    fn has_datagrams(&self) -> bool {
        matches!(self.end, End::Network { .. })
    }
}

impl LineFaults {
    fn edges(&self) -> impl Iterator<Item = Time> + '_ {
        let garbage = self.garbage.as_ref().map(|it| &it.0);
        [self.unplugged.as_ref(), self.silent.as_ref(), garbage].into_iter().flatten().flat_map(|it| [it.start, it.end])
    }

    fn is_unplugged(&self, now: Time) -> bool {
        self.unplugged.as_ref().is_some_and(|it| it.contains(&now))
    }
}

impl NetworkSettings {
    /// Puts a datagram on its way, unless it gets lost.
    fn send(&self, now: Time, mut datagram: Vec<u8>, garbage: f64, random: &mut Random, way: &mut Way) {
        if random.uniform() < self.lost {
            return;
        }
        for byte in &mut datagram {
            if garbage > 0.0 && random.uniform() < garbage {
                *byte ^= 1 << random.below(8);
            }
        }
        let arrives = now + Interval::from_ms(self.delay_ms + random.uniform() * self.delay_jitter_ms);
        let place = way.partition_point(|it| it.0 <= arrives);
        way.insert(place, (arrives, datagram));
    }
}

/// Where the camera on a simulated head stands, at any time that has passed; cloning it is cheap.
#[derive(Clone)]
pub struct HeadMotion {
    head: Arc<Mutex<LineHead>>,
    mechanics: Arc<PanTiltHead>,
    camera: CameraId,
}

impl HeadMotion {
    /// The motion of `head`, which carries `camera` and whose axes, and optics where it zooms, are really those of `mechanics`.
    pub fn new(camera: CameraId, head: LineHead, mechanics: PanTiltHead) -> HeadMotion {
        HeadMotion { head: Arc::new(Mutex::new(head)), mechanics: Arc::new(mechanics), camera }
    }

    /// The camera on the head.
    pub fn camera(&self) -> CameraId {
        self.camera
    }

    /// The line to the same head.
    pub fn line(&self) -> Line {
        Line::new(Arc::clone(&self.head) as Arc<Mutex<dyn Device>>)
    }

    /// The head's axes and its camera at rest, as they really are.
    pub fn mechanics(&self) -> &PanTiltHead {
        &self.mechanics
    }

    /// The head, to look at.
    pub fn head(&self) -> MutexGuard<'_, LineHead> {
        self.head.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Pan and tilt, vibration and all, at `time` [rad]: a time that has passed in the run, and not more than
    /// [`REMEMBERED_S`](super::REMEMBERED_S) ago.
    pub fn angles_at(&self, time: Time) -> [f64; 2] {
        let [pan, tilt, _] = self.looked(time);
        [pan, tilt]
    }

    /// Position of the zoom drive at `time` [units]; times as for [`Self::angles_at`].
    pub fn zoom_at(&self, time: Time) -> f64 {
        self.looked(time)[2]
    }

    /// `at_rest` as it stands at `time`, turned by the head, with the optics of the head's zoom where that is known. Times as for
    /// [`Self::angles_at`].
    pub fn camera_at(&self, at_rest: &Camera, time: Time) -> Camera {
        let [pan, tilt, zoom] = self.looked(time);
        let mut camera = at_rest.clone();
        camera.camera_from_world =
            self.mechanics.camera_from_rest(&Setting::new(pan, tilt)) * at_rest.camera_from_world;
        if let Some(table) = &self.mechanics.zoom {
            (camera.intrinsics, camera.distortion) = table.optics_at(zoom);
        }
        camera
    }

    fn looked(&self, time: Time) -> [f64; 3] {
        let mut head = self.head();
        head.advance(time);
        head.head().looked(time)
    }
}

impl Message for HeadMotion {
    const NAME: &'static str = "head_motion";
    const SPACE: SpaceKind = SpaceKind::None;
}
