//! A simulated head in a rig: a line for its driver, and where the camera on it stands.
//!
//! Line and motion are two handles to one head on the logical clock of the run. Only the driver's line advances the head; a query of its motion at a
//! later time uses a copy that was advanced until then. What a driver writes moves nothing before the head's reaction time is over, so that up to this long
//! after the last write the copy moves as the head will: pictures may be drawn so far ahead of the driver, on another thread, with the same bytes.

use std::ops::Range;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use foveate_estimation::random::Random;
use foveate_geometry::pan_tilt::PanTiltHead;
use foveate_messages::{CameraId, Interval, Message, Space, Time, Wire};
use foveate_node::{ConfigError, Device, Line};

use super::datagrams::NetworkHead;
use super::device::Head;
use super::line::SerialHead;
use super::mechanics::TICK;
use super::settings::{HeadSettings, LineSettings, NetworkSettings};
use crate::truth::TrueCamera;

/// What happens to a line, and when.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LineFaults {
    /// It is pulled out: nothing arrives at either end.
    pub unplugged: Option<Range<Time>>,
    /// The head answers nothing, and executes commands.
    pub silent: Option<Range<Time>>,
    /// This share of the bytes is changed in both directions.
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

/// A head, and how it will move as long as nothing else is written.
struct Foreseen {
    head: LineHead,
    /// A copy that has lived longer, unless something was written since it was made.
    ahead: Option<LineHead>,
}

impl Foreseen {
    /// Where it looks and how it is zoomed, see [`Head::looked`].
    fn looked(&mut self, time: Time) -> [f64; 3] {
        if time <= self.head.now {
            return self.head.head().looked(time);
        }
        let ahead = self.ahead.get_or_insert_with(|| self.head.clone());
        ahead.advance(time);
        ahead.head().looked(time)
    }
}

impl Device for Foreseen {
    fn write(&mut self, now: Time, bytes: &[u8]) {
        self.ahead = None;
        self.head.write(now, bytes);
    }

    fn read(&mut self, now: Time, bytes: &mut Vec<u8>) {
        self.head.read(now, bytes);
    }

    fn has_datagrams(&self) -> bool {
        self.head.has_datagrams()
    }
}

/// Where the camera on a simulated head stands, at any time that has passed; cloning it is cheap.
#[derive(Clone)]
pub struct HeadMotion {
    head: Arc<Mutex<Foreseen>>,
    mechanics: Arc<PanTiltHead>,
    camera: CameraId,
}

impl HeadMotion {
    /// The motion of `head`, which carries `camera` and whose axes, and optics where it zooms, are really those of `mechanics`.
    pub fn new(camera: CameraId, head: LineHead, mechanics: PanTiltHead) -> HeadMotion {
        HeadMotion {
            head: Arc::new(Mutex::new(Foreseen { head, ahead: None })),
            mechanics: Arc::new(mechanics),
            camera,
        }
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

    /// Commands so far that found the head's buffer full.
    pub fn n_refused_full(&self) -> u64 {
        self.head().head.head().n_refused_full()
    }

    fn head(&self) -> MutexGuard<'_, Foreseen> {
        self.head.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Pan and tilt, vibration and all, at `time` [rad]: not later than the head's reaction time after what its driver has come to, and not more than
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
    pub fn camera_at(&self, at_rest: &TrueCamera, time: Time) -> TrueCamera {
        at_rest.turned(&self.mechanics, self.looked(time))
    }

    fn looked(&self, time: Time) -> [f64; 3] {
        self.head().looked(time)
    }
}

impl Message for HeadMotion {
    const NAME: &'static str = "head_motion";
    const SPACE: Space = Space::NONE;
    const WIRE: Wire = Wire::Local;
}

#[cfg(test)]
mod tests {
    use foveate_geometry::pan_tilt::{ZoomStop, ZoomTable};
    use foveate_geometry::{Camera, Intrinsics};
    use nalgebra::Point3;

    use super::super::{Axes, AxesSettings};
    use super::*;

    fn camera() -> Camera {
        Camera::look_at(Point3::new(0.0, -4.0, 2.0), Point3::new(0.0, 0.0, 1.0), [640, 480], 700.0)
    }

    fn motion(head: LineHead) -> HeadMotion {
        HeadMotion::new(CameraId(0), head, Axes::new(&AxesSettings::default()).carrying(&camera()))
    }

    fn serial(faults: LineFaults) -> LineHead {
        LineHead::serial(&HeadSettings::default(), &LineSettings::default(), faults, 1).unwrap()
    }

    fn network(lost: f64) -> LineHead {
        let settings = NetworkSettings { delay_ms: 3.0, delay_jitter_ms: 9.0, lost, garbage: 0.01 };
        LineHead::network(&HeadSettings::default(), &settings, LineFaults::default(), 1).unwrap()
    }

    const GO: [u8; 15] = [0x81, 0x01, 0x06, 0x02, 0x18, 0x14, 0, 1, 0, 0, 0, 0, 0, 0, 0xFF];

    fn ms(milliseconds: f64) -> Time {
        Time::from_s(milliseconds * 1e-3)
    }

    #[test]
    fn answers_do_not_depend_on_who_asked_before() {
        let heard = |head: LineHead, others_ask: bool| {
            let motion = motion(head);
            let (line, mut heard, mut angles) = (motion.line(), Vec::new(), Vec::new());
            let (reaction, mut foreseen) = (Interval::from_ms(HeadSettings::default().reaction_ms), Vec::new());
            for step in 0..1500 {
                let now = ms(f64::from(step) + 0.3);
                if others_ask {
                    motion.angles_at(now - Interval(150_000));
                    motion.angles_at(now);
                    foreseen.push((now + reaction, motion.angles_at(now + reaction)));
                }
                if step % 40 == 0 {
                    let header = [0x01, 0x00, 0, 15, 0, 0, 0, (step / 40) as u8];
                    let datagram = if line.device().has_datagrams() { &header[..] } else { &[] };
                    line.device().write(now, &[datagram, &GO].concat());
                }
                let mut bytes = Vec::new();
                line.device().read(now, &mut bytes);
                heard.push(bytes);
                if step % 100 == 99 {
                    angles.push(motion.angles_at(now - Interval(7_654_321)));
                }
            }
            let is_as_foreseen = |it: &(Time, [f64; 2])| motion.angles_at(it.0) == it.1;
            assert!(foreseen.iter().filter(|it| it.0 < ms(1500.0)).all(is_as_foreseen));
            (heard, angles)
        };
        assert_eq!(heard(serial(LineFaults::default()), false), heard(serial(LineFaults::default()), true));
        let (bytes, angles) = heard(network(0.2), false);
        assert!(bytes.iter().flatten().count() > 200 && angles.last().unwrap()[0] > 0.4, "{angles:?}");
        assert_eq!((bytes, angles), heard(network(0.2), true));
    }

    #[test]
    fn a_head_that_zooms_has_the_optics_of_its_table() {
        let stop = |zoom: f64, focal: f64| {
            let Camera { intrinsics, distortion, .. } = camera();
            ZoomStop { zoom, intrinsics: Intrinsics { focal: [focal; 2], ..intrinsics }, distortion }
        };
        let mut mechanics = Axes::new(&AxesSettings::default()).carrying(&camera());
        mechanics.zoom = ZoomTable::new(vec![stop(0.0, 700.0), stop(1023.0, 7000.0)]).ok();
        let motion = HeadMotion::new(CameraId(0), serial(LineFaults::default()), mechanics);
        let focal = |time: Time| motion.camera_at(&TrueCamera::from(&camera()), time).intrinsics.focal[0];
        assert!((focal(ms(1.0)) - 700.0).abs() < 1e-9);
        motion.line().device().write(ms(1.0), &[0x81, 0x01, 0x04, 0x47, 0, 3, 15, 15, 0xFF]);
        // 2.5 s from end to end.
        let half = focal(ms(1300.0));
        assert!((1500.0..3500.0).contains(&half), "{half} px");
        assert!((focal(ms(2700.0)) - 7000.0).abs() < 1e-6);
        assert_eq!(motion.zoom_at(ms(2700.0)), 1023.0);
    }

    #[test]
    fn a_line_that_is_pulled_out_carries_nothing_and_then_again() {
        let ask = |unplugged: Option<Range<Time>>, silent: Option<Range<Time>>, at_ms: f64| {
            let mut head = serial(LineFaults { unplugged, silent, garbage: None });
            head.write(ms(at_ms), &[0x81, 0x09, 0x06, 0x12, 0xFF]);
            let mut bytes = Vec::new();
            (0..60).for_each(|step| head.read(ms(at_ms + f64::from(step)), &mut bytes));
            bytes.len()
        };
        let span = Some(ms(100.0)..ms(200.0));
        assert_eq!([20.0, 120.0, 195.0, 210.0].map(|at| ask(span.clone(), None, at)), [11, 0, 0, 11]);
        assert_eq!([20.0, 120.0, 210.0].map(|at| ask(None, span.clone(), at)), [11, 0, 11]);
    }
}
