//! Shared by the exports on one time base: targets, marks and cameras of a run, in the world, at regular times.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use foveate::messages::ScaleId;
use foveate::node::scale::Spaces;
use foveate::prelude::*;
use foveate::scene::{LengthUnit, UncertainPose};
use nalgebra::Isometry3;

use crate::csv::check_file_name;
use crate::in_order::InOrder;
use crate::time_base::{Sample, Settling, Ticks, TimeBase, Tracks};

ports! {
    pub(crate) fn ports;
    TARGETS: In<Targets> = each("targets").optional();
    PARENT_TARGETS: In<Targets> = each("parent_targets").of_parent().optional();
    MARKS: In<Marks> = each("marks").optional();
    SPACES: In<ScaleSpace> = latest("spaces").many().optional();
}

/// An input after [`ports`] where poses of heads are exported too.
pub(crate) const POSES: In<HeadPose> = In::each(4, "poses").many().optional();

/// How long a stalled input delays frames for which others have samples, in session time.
const PATIENCE: Interval = Interval(5_000_000_000);

/// Samples farther apart leave a hole [ms].
pub(crate) fn default_gap_ms() -> f64 {
    50.0
}

/// The settings that all exports on one time base have.
pub(crate) struct Common<'a> {
    pub(crate) file: &'a str,
    pub(crate) rate_hz: f64,
    pub(crate) gap_ms: f64,
    pub(crate) labels: &'a BTreeMap<String, String>,
}

/// A point of the world over time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Point {
    Target(TargetId),
    ParentTarget(TargetId),
    Mark(u32),
    /// In the space of the marks.
    OwnMark(u32),
}

/// A space of the world over time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Body {
    Marks,
    Camera(CameraId),
}

/// An item that waits until the time base is known.
#[derive(Debug, Clone)]
enum Item {
    Point(Point, Sample),
    Predicted(Point, Sample),
    Body(Body, Isometry3<f64>),
}

/// A point's samples: frame, counted from 0, and sample, ascending.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Column {
    pub(crate) label: String,
    /// The target of the node's own scale, where it is one.
    pub(crate) target: Option<TargetId>,
    /// The mark, where it is one.
    pub(crate) mark: Option<u32>,
    pub(crate) samples: Vec<(usize, Sample)>,
}

/// Poses by frame, `world_from_…`.
pub(crate) type Poses = Vec<(usize, Isometry3<f64>)>;

/// All gathered samples, frame by frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table {
    /// When frame 0 is.
    pub(crate) start: Time,
    pub(crate) rate_hz: f64,
    pub(crate) n_frames: usize,
    /// In the world: targets of the scale, of its parent, then marks.
    pub(crate) points: Vec<Column>,
    /// The marks once more, in the space of the head.
    pub(crate) own_marks: Vec<Column>,
    /// `world_from_marks`.
    pub(crate) marks_from: Poses,
    /// `world_from_camera`.
    pub(crate) cameras: Vec<(CameraId, Poses)>,
}

impl Table {
    /// When a frame is.
    pub(crate) fn time_s(&self, frame: usize) -> f64 {
        self.start.as_s() + frame as f64 / self.rate_hz
    }

    /// Derives the marks in the world from their own space, so that both agree: each is interpolated by itself, which differs slightly.
    fn agree(&mut self) {
        for own in &mut self.own_marks {
            let Some(in_world) = self.points.iter().find(|it| it.mark == own.mark) else { continue };
            let mut in_world = in_world.samples.iter().peekable();
            let mut poses = self.marks_from.iter().peekable();
            for (frame, sample) in &mut own.samples {
                while in_world.next_if(|it| it.0 < *frame).is_some() {}
                while poses.next_if(|it| it.0 < *frame).is_some() {}
                if let (Some((at, place)), Some((then, pose))) = (in_world.peek(), poses.peek())
                    && (*at, *then) == (*frame, *frame)
                {
                    sample.position = pose.inverse_transform_point(&place.position);
                }
            }
        }
    }

    /// Points frame by frame, in each frame point by point; `make` of a sample, `missing` where there is none.
    pub(crate) fn dense<T: Clone>(
        columns: &[Column],
        n_frames: usize,
        missing: T,
        make: impl Fn(&Sample) -> T,
    ) -> Vec<T> {
        let mut all = vec![missing; columns.len() * n_frames];
        for (place, column) in columns.iter().enumerate() {
            for (frame, sample) in &column.samples {
                all[frame * columns.len() + place] = make(sample);
            }
        }
        all
    }
}

/// One frame, taken while the run goes on.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Frame {
    /// Its number on the time base.
    pub(crate) tick: i64,
    /// All points that are there, ascending.
    pub(crate) points: Vec<(Point, Sample)>,
}

/// Gathers samples from the inputs.
pub(crate) struct Gather {
    spaces: Spaces,
    parent: Option<(ScaleId, String)>,
    order: [InOrder<Arc<Targets>>; 2],
    marks_order: InOrder<Arc<Marks>>,
    /// Whether targets, the parent's targets and marks can come.
    expected: [bool; 3],
    /// Frames are taken as soon as they are ready, and only points in the world are needed.
    is_taken: bool,
    has_ended: bool,
    settling: Settling<(Time, Item)>,
    points: Tracks<Point, Sample>,
    bodies: Tracks<Body, Isometry3<f64>>,
    labels: BTreeMap<String, String>,
    /// Samples of a scale whose pose in the world was unknown.
    without_place: u64,
    unit_is_known: bool,
}

impl Gather {
    /// Checks the settings that exports have in common.
    pub(crate) fn new(common: &Common, setup: &Setup) -> Result<Self, ConfigError> {
        check_file_name("file", common.file)?;
        setup.claim_file(Some("file"), common.file)?;
        ConfigError::unless_in("rate_hz", common.rate_hz, 0.0..=100_000.0)?;
        ConfigError::unless_in("gap_ms", common.gap_ms, 0.0..=60_000.0)?;
        let mut taken = BTreeSet::new();
        for (name, label) in common.labels {
            if label.trim().is_empty() || label.chars().any(char::is_control) || !taken.insert(label) {
                let message =
                    format!("found `{label}` for `{name}`, expected a name of its own, without tabs or line ends");
                return Err(ConfigError::at("labels", message));
            }
        }
        let parent = setup.scales.place(setup.scales.own).and_then(|it| it.parent);
        let moves = |scale: ScaleId| {
            setup.scales.around(scale).any(|it| setup.scales.place(it).is_some_and(|it| it.is_anchored))
        };
        let needs_own = setup.is_connected(&TARGETS) && moves(setup.scales.own);
        let needs_parent = setup.is_connected(&PARENT_TARGETS) && parent.is_some_and(moves);
        if (needs_own || needs_parent) && !setup.is_connected(&SPACES) {
            return Err(ConfigError::node(
                "targets of a moving scale have no place in the world without its anchors; found nothing at `spaces`, \
                 expected `anchor.space` of that scale and of those around it",
            ));
        }
        let gap = Interval::from_ms(common.gap_ms);
        Ok(Self {
            spaces: Spaces::new(&setup.scales),
            parent: parent.and_then(|it| Some((it, setup.scales.place(it)?.name.clone()))),
            order: Default::default(),
            marks_order: InOrder::default(),
            expected: [setup.is_connected(&TARGETS), setup.is_connected(&PARENT_TARGETS), setup.is_connected(&MARKS)],
            is_taken: false,
            has_ended: false,
            settling: Settling::new(common.rate_hz, setup.is_connected(&MARKS)),
            points: Tracks::new(gap),
            bodies: Tracks::new(gap),
            labels: common.labels.clone(),
            without_place: 0,
            unit_is_known: setup.calibration.length_unit == LengthUnit::Metre,
        })
    }

    /// Takes the messages of an activation.
    pub(crate) fn take(&mut self, io: &mut Io<'_>) {
        io.latest_of_each(&SPACES).for_each(|it| self.spaces.learn(it.value));
        while let Some(message) = io.take(&TARGETS) {
            self.push_targets(message.value, false);
        }
        while let Some(message) = io.take(&PARENT_TARGETS) {
            self.push_targets(message.value, true);
        }
        while let Some(message) = io.take(&MARKS) {
            self.push_marks(message.value);
        }
    }

    /// For exports that take frames during the run.
    pub(crate) fn taken_by_frame(mut self) -> Self {
        self.is_taken = true;
        self
    }

    /// Takes targets alone, for exports with ports of their own.
    pub(crate) fn take_targets(&mut self, io: &mut Io<'_>, spaces: &In<ScaleSpace>) {
        io.latest_of_each(spaces).for_each(|it| self.spaces.learn(it.value));
        while let Some(message) = io.take(&TARGETS) {
            self.push_targets(message.value, false);
        }
    }

    /// Takes the cameras' poses of an activation.
    pub(crate) fn take_poses(&mut self, io: &mut Io<'_>) {
        while let Some(message) = io.take(&POSES) {
            self.push_pose(&message.value);
        }
    }

    pub(crate) fn push_targets(&mut self, message: Arc<Targets>, of_parent: bool) {
        let mut ready = Vec::new();
        self.order[usize::from(of_parent)].push(message.time, message, &mut |it| ready.push(it));
        ready.iter().for_each(|it| self.add_targets(it, of_parent));
    }

    pub(crate) fn push_marks(&mut self, marks: Arc<Marks>) {
        let mut ready = Vec::new();
        self.marks_order.push(marks.time, marks, &mut |it| ready.push(it));
        ready.iter().for_each(|it| self.add_marks(it));
    }

    fn add_targets(&mut self, message: &Targets, of_parent: bool) {
        let own = self.spaces.own();
        let scale = self.parent.as_ref().map(|it| it.0).filter(|_| of_parent).unwrap_or(own);
        let Ok(world_from_scale) = self.spaces.a_from_b(self.spaces.root(), scale, message.time) else {
            self.without_place +=
                message.list.iter().filter(|it| it.provenance != Provenance::Predicted).count() as u64;
            return;
        };
        for target in &message.list {
            let covariance = target.covariance.fixed_view::<3, 3>(0, 0).into_owned();
            let (position, covariance) = world_from_scale.transform_point(&target.position, &covariance);
            let key = if of_parent { Point::ParentTarget(target.id) } else { Point::Target(target.id) };
            if let Some(sample) = Sample::new(position, &covariance, target.provenance, &target.cameras) {
                let is_data = target.provenance != Provenance::Predicted;
                self.push(message.time, if is_data { Item::Point(key, sample) } else { Item::Predicted(key, sample) });
            }
        }
    }

    fn add_marks(&mut self, marks: &Marks) {
        self.settling.observe(marks.time);
        let world_from_marks = UncertainPose { transform: marks.world_from_marks, covariance: marks.covariance };
        let mut is_any = false;
        for mark in &marks.list {
            let (position, covariance) = world_from_marks.transform_point(&mark.position, &mark.covariance);
            let Some(in_world) = Sample::new(position, &covariance, mark.provenance, &mark.cameras) else { continue };
            if mark.provenance == Provenance::Predicted {
                self.push(marks.time, Item::Predicted(Point::Mark(mark.label), in_world));
                continue;
            }
            self.push(marks.time, Item::Point(Point::Mark(mark.label), in_world));
            is_any = true;
            let own = Sample::new(mark.position, &mark.covariance, mark.provenance, &mark.cameras);
            if let Some(own) = own.filter(|_| !self.is_taken) {
                self.push(marks.time, Item::Point(Point::OwnMark(mark.label), own));
            }
        }
        if is_any && !self.is_taken {
            self.push(marks.time, Item::Body(Body::Marks, marks.world_from_marks));
        }
    }

    pub(crate) fn push_pose(&mut self, pose: &HeadPose) {
        let world_from_camera = pose.camera_from_world.inverse();
        if world_from_camera.to_homogeneous().iter().all(|it| it.is_finite()) {
            self.push(pose.time, Item::Body(Body::Camera(pose.camera), world_from_camera));
        }
    }

    fn push(&mut self, time: Time, item: Item) {
        match self.settling.base() {
            Some(base) => {
                self.release(&base);
                self.put(&base, time, item);
            }
            None => self.settling.hold(time, (time, item)),
        }
    }

    fn release(&mut self, base: &TimeBase) {
        for (time, item) in self.settling.release() {
            self.put(base, time, item);
        }
    }

    fn put(&mut self, base: &TimeBase, time: Time, item: Item) {
        match item {
            Item::Point(key, sample) => self.points.push(base, key, time, sample),
            Item::Predicted(key, sample) => self.points.push_predicted(key, time, sample),
            Item::Body(key, pose) => self.bodies.push(base, key, time, pose),
        }
    }

    /// The time base, once it is known.
    pub(crate) fn base(&self) -> Option<TimeBase> {
        self.settling.base()
    }

    /// The next frame with a point in it that no later sample can change.
    pub(crate) fn next_frame(&mut self) -> Option<Frame> {
        let base = self.settling.base()?;
        if self.has_ended {
            let tick = self.points.first_tick()?;
            return Some(self.take_frame(tick));
        }
        let until = self.all_has_come_until()?;
        self.points.forget(&base, until);
        let tick = self.points.first_tick()?;
        (base.at(tick) + self.points.gap() <= until).then(|| self.take_frame(tick))
    }

    fn take_frame(&mut self, tick: i64) -> Frame {
        let mut points = Vec::new();
        self.points.take_tick(tick, |key, sample| points.push((key, sample)));
        Frame { tick, points }
    }

    /// Samples of this time or an earlier one will not come; `None` before the first.
    fn all_has_come_until(&self) -> Option<Time> {
        let reached = [self.order[0].reached(), self.order[1].reached(), self.marks_order.reached()];
        let newest = reached.into_iter().flatten().max()?;
        let waited_for = reached.into_iter().zip(self.expected).filter(|it| it.1 || it.0.is_some());
        let slowest = waited_for.map(|it| it.0).min().flatten();
        Some(slowest.map_or(newest - PATIENCE, |it| it.max(newest - PATIENCE)))
    }

    /// The run is over: all remaining frames are ready. Reports unused samples and caveats of `file`.
    pub(crate) fn end(&mut self, file: &str, is_empty: bool, report: &mut Report) {
        self.settle();
        if let Some(base) = self.settling.base() {
            self.points.close(&base);
        }
        self.has_ended = true;
        // Those that come too late to be taken are counted when they are looked for.
        let is_empty = self.points.first_tick().is_none() && is_empty;
        self.remark(self.points.late(), file, is_empty, report);
    }

    /// Takes in all waiting items.
    fn settle(&mut self) -> TimeBase {
        let (mut targets, mut marks) = (Vec::new(), Vec::new());
        for (order, of_parent) in self.order.iter_mut().zip([false, true]) {
            order.finish(&mut |it| targets.push((it, of_parent)));
        }
        self.marks_order.finish(&mut |it| marks.push(it));
        targets.iter().for_each(|it| self.add_targets(&it.0, it.1));
        marks.iter().for_each(|it| self.add_marks(it));
        let base = self.settling.settle();
        self.release(&base);
        base
    }

    /// Name of a point in files.
    pub(crate) fn name(&self, point: Point) -> String {
        let name = match point {
            Point::Target(id) => format!("target-{}", id.0),
            Point::ParentTarget(id) => {
                format!("{}-target-{}", self.parent.as_ref().map_or("parent", |it| it.1.as_str()), id.0)
            }
            Point::Mark(label) | Point::OwnMark(label) => format!("mark-{label}"),
        };
        self.labels.get(&name).cloned().unwrap_or(name)
    }

    /// All gathered samples. Reports unused samples and caveats of `file`.
    pub(crate) fn finish(mut self, file: &str, report: &mut Report) -> Table {
        let base = self.settle();
        self.points.close(&base);
        let late = self.points.late();
        let points = std::mem::replace(&mut self.points, Tracks::new(Interval(0))).finish(&base);
        let bodies = std::mem::replace(&mut self.bodies, Tracks::new(Interval(0))).finish(&base);
        let ends = points.iter().map(|it| (it.1[0].0, it.1[it.1.len() - 1].0));
        let (first, last) = ends.fold((i64::MAX, i64::MIN), |all, it| (all.0.min(it.0), all.1.max(it.1)));
        let n_frames = if points.is_empty() { 0 } else { (last - first + 1) as usize };
        let in_frames = |poses: Ticks<Isometry3<f64>>| -> Poses {
            let within = poses.into_iter().filter(|it| (first..=last).contains(&it.0));
            within.map(|(tick, pose)| ((tick - first) as usize, pose)).collect()
        };
        let mut table = Table {
            start: if points.is_empty() { base.start } else { base.at(first) },
            rate_hz: base.rate_hz,
            n_frames,
            points: Vec::new(),
            own_marks: Vec::new(),
            marks_from: Vec::new(),
            cameras: Vec::new(),
        };
        for (key, ticks) in points {
            let column = Column {
                label: self.name(key),
                target: if let Point::Target(id) = key { Some(id) } else { None },
                mark: if let Point::Mark(label) | Point::OwnMark(label) = key { Some(label) } else { None },
                samples: ticks.into_iter().map(|(tick, it)| ((tick - first) as usize, it)).collect(),
            };
            let columns = if matches!(key, Point::OwnMark(_)) { &mut table.own_marks } else { &mut table.points };
            columns.push(column);
        }
        for (key, ticks) in bodies {
            match key {
                Body::Marks => table.marks_from = in_frames(ticks),
                Body::Camera(camera) => table.cameras.push((camera, in_frames(ticks))),
            }
        }
        table.agree();
        self.remark(late, file, table.n_frames == 0, report);
        table
    }

    fn remark(&self, late: u64, file: &str, is_empty: bool, report: &mut Report) {
        if late > 0 {
            report.remark(format!("{file}: {late} samples came after a later one, and are left out"));
        }
        if self.without_place > 0 {
            let n = self.without_place;
            report.remark(format!("{file}: {n} samples of a scale with an unknown pose in the world are left out"));
        }
        if !self.unit_is_known && !is_empty {
            report.remark(format!(
                "the lengths in {file} are in the calibration's own unit, whose length in metres is unknown"
            ));
        }
    }
}
