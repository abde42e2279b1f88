//! A file of frames of any format that is written during the run, and is complete at any time.
//!
//! Its columns are the points of the first seconds, ascending. A later point takes a spare column; without a spare one the file is rewritten from itself,
//! row by row, with more columns and spare ones, so that many new points need few such passes. At the end spare columns are removed in one more pass.

use std::collections::BTreeMap;
use std::io::{self, Read, Write};

use foveate::prelude::*;

use crate::gather::{Frame, Gather, Point};
use crate::growing_file::GrowingFile;
use crate::time_base::{Sample, TimeBase};

/// Time in which frames wait until most points are known, in session time.
const FIRST_FRAMES: Interval = Interval(2_000_000_000);
/// Samples in them at most.
const FIRST_SAMPLES: usize = 50_000;
/// The most frames of a file: C3D counts them by a 32-bit float.
const MOST_FRAMES: i64 = 1 << 24;

/// Metadata of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct About {
    /// Session time of the first frame [s].
    pub(crate) start_s: f64,
    pub(crate) rate_hz: f64,
}

/// Sources of the columns of a rewritten file.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Columns {
    /// How many there were.
    pub(crate) n_before: usize,
    /// The old column of each new one; `None`: all its points are missing.
    pub(crate) sources: Vec<Option<usize>>,
}

/// A format of frames in rows.
pub(crate) trait Format {
    /// Length of a head for these labels, which stays the same while frames are added and spare labels are used.
    fn room(&self, about: &About, labels: &[String]) -> usize;

    /// Everything before the rows, of constant length for any number of frames as long as the labels fit in `room`.
    ///
    /// # Errors
    /// Why the format cannot hold it.
    fn head(&self, about: &About, labels: &[String], n_frames: usize, room: usize) -> Result<Vec<u8>, String>;

    /// Adds the row of a frame, counted from 0.
    fn put(&mut self, about: &About, frame: usize, points: &[Option<Sample>], rows: &mut Vec<u8>);

    /// Copies all rows with other columns.
    fn convert(&self, columns: &Columns, from: &mut dyn Read, to: &mut dyn Write) -> io::Result<()>;

    /// Whether the finished file has other rows than the one that grew.
    fn is_other_at_the_end(&self) -> bool {
        false
    }

    /// As [`Self::head`], for the finished file when it is rewritten.
    fn last_head(&self, about: &About, labels: &[String], n_frames: usize) -> Result<Vec<u8>, String> {
        self.head(about, labels, n_frames, 0)
    }

    /// As [`Self::convert`], for the finished file.
    fn convert_last(&self, columns: &Columns, from: &mut dyn Read, to: &mut dyn Write) -> io::Result<()> {
        self.convert(columns, from, to)
    }

    /// Everything after the last row of a file of this many bytes.
    fn end(&self, n_bytes: u64, n_frames: usize) -> Vec<u8>;
}

/// The file.
pub(crate) struct FrameFile<F> {
    format: F,
    file: GrowingFile,
    name: String,
    first: Vec<Frame>,
    base: Option<(TimeBase, i64)>,
    /// Columns of points, in the order of the file; `None`: spare.
    columns: Vec<Option<Point>>,
    places: BTreeMap<Point, usize>,
    labels: Vec<String>,
    room: usize,
    head_bytes: usize,
    n_frames: i64,
    row: Vec<Option<Sample>>,
    /// Why the file could not take further points, and how many samples were lost by it.
    refused: Option<(String, u64)>,
    /// Frames beyond the most that a file can have.
    n_beyond: u64,
}

impl<F: Format> FrameFile<F> {
    /// The file `name` of `setup`'s results folder; nothing is touched yet.
    pub(crate) fn new(setup: &Setup, name: &str, format: F) -> Self {
        Self {
            format,
            file: GrowingFile::new(setup, name),
            name: name.to_owned(),
            first: Vec::new(),
            base: None,
            columns: Vec::new(),
            places: BTreeMap::new(),
            labels: Vec::new(),
            room: 0,
            head_bytes: 0,
            n_frames: 0,
            row: Vec::new(),
            refused: None,
            n_beyond: 0,
        }
    }

    /// Takes the frames that are ready, and writes them when that is due.
    pub(crate) fn take(&mut self, gather: &mut Gather, now: Time) {
        while let Some(frame) = gather.next_frame() {
            self.push(frame, gather);
        }
        if self.file.is_due(now) {
            self.flush();
        }
    }

    fn push(&mut self, frame: Frame, gather: &Gather) {
        let Some(base) = gather.base() else { return };
        let (_, start) = *self.base.get_or_insert((base, frame.tick));
        if !self.columns.is_empty() {
            return self.put(&frame, gather);
        }
        if self.refused.is_some() {
            return;
        }
        let tick = frame.tick;
        self.first.push(frame);
        let n_samples: usize = self.first.iter().map(|it| it.points.len()).sum();
        if base.at(tick) - base.at(start) >= FIRST_FRAMES || n_samples >= FIRST_SAMPLES {
            self.begin(gather);
        }
    }

    /// Columns for all points of the first frames, then the frames.
    fn begin(&mut self, gather: &Gather) {
        let frames = std::mem::take(&mut self.first);
        let mut points: Vec<Point> = frames.iter().flat_map(|it| &it.points).map(|it| it.0).collect();
        points.sort_unstable();
        points.dedup();
        self.lay_out(points, 0, gather);
        frames.iter().for_each(|it| self.put(it, gather));
    }

    fn about(&self) -> About {
        let (base, start) = self.base.unwrap_or((TimeBase { start: Time::ZERO, rate_hz: 0.0 }, 0));
        About { start_s: base.start.as_s() + start as f64 / base.rate_hz.max(f64::MIN_POSITIVE), rate_hz: base.rate_hz }
    }

    /// Writes one frame, and empty ones for missing frames.
    fn put(&mut self, frame: &Frame, gather: &Gather) {
        let start = self.base.map_or(frame.tick, |it| it.1);
        let number = frame.tick - start;
        if number >= MOST_FRAMES {
            self.n_beyond += 1;
            return;
        }
        self.make_room(frame, gather);
        let about = self.about();
        while self.n_frames <= number {
            self.row.clear();
            self.row.resize(self.columns.len(), None);
            if self.n_frames == number {
                for (point, sample) in &frame.points {
                    match self.places.get(point) {
                        Some(place) => self.row[*place] = Some(sample.clone()),
                        None => self.refused.iter_mut().for_each(|it| it.1 += 1),
                    }
                }
            }
            if self.file.is_wanted() {
                self.format.put(&about, self.n_frames as usize, &self.row, self.file.rows());
            }
            self.n_frames += 1;
            // A long hole is written on the way.
            if self.file.is_much() {
                self.flush();
            }
        }
    }

    /// Columns for all points of a frame.
    fn make_room(&mut self, frame: &Frame, gather: &Gather) {
        let new: Vec<Point> = frame.points.iter().map(|it| it.0).filter(|it| !self.places.contains_key(it)).collect();
        if new.is_empty() || self.refused.is_some() {
            return;
        }
        let spare: Vec<usize> = (0..self.columns.len()).filter(|it| self.columns[*it].is_none()).collect();
        if spare.len() >= new.len() {
            let before = self.labels.clone();
            for (point, place) in new.iter().zip(&spare) {
                self.labels[*place] = gather.name(*point);
            }
            if self.head().is_ok_and(|it| it.len() == self.head_bytes) {
                for (point, place) in new.into_iter().zip(spare) {
                    self.columns[place] = Some(point);
                    self.places.insert(point, place);
                }
                return;
            }
            self.labels = before;
        }
        let mut points: Vec<Point> = self.places.keys().copied().chain(new).collect();
        points.sort_unstable();
        let n_spare = (points.len() / 4).max(4);
        self.lay_out(points, n_spare, gather);
    }

    /// Gives the file these columns, with spare ones after them. On failure it stays as it was.
    fn lay_out(&mut self, points: Vec<Point>, n_spare: usize, gather: &Gather) {
        let labels = points.iter().map(|it| gather.name(*it)).chain((1..=n_spare).map(|it| format!("unused-{it}")));
        let labels: Vec<String> = labels.collect();
        let about = self.about();
        let room = self.format.room(&about, &labels);
        let columns: Vec<Option<Point>> = points.iter().map(|it| Some(*it)).chain(vec![None; n_spare]).collect();
        let sources = columns.iter().map(|it| self.places.get(it.as_ref()?).copied()).collect();
        let from = Columns { n_before: self.columns.len(), sources };
        let made = self.format.head(&about, &labels, self.n_frames as usize, room).and_then(|head| {
            if self.n_frames > 0 {
                let old = self.head()?;
                let format = &self.format;
                self.file.rewrite(&old, &head, |rows, to| format.convert(&from, rows, to))?;
            }
            Ok(head.len())
        });
        match made {
            Ok(head_bytes) => {
                (self.labels, self.room, self.head_bytes) = (labels, room, head_bytes);
                self.places = points.into_iter().zip(0..).collect();
                self.columns = columns;
            }
            Err(why) => self.refused = Some((why, 0)),
        }
    }

    fn head(&self) -> Result<Vec<u8>, String> {
        self.format.head(&self.about(), &self.labels, self.n_frames as usize, self.room)
    }

    fn flush(&mut self) {
        if self.n_frames > 0
            && let Ok(head) = self.head()
        {
            self.file.flush(&head);
        }
    }

    /// Ends the file at the end of the run. Figures are called `NAME.points` and `NAME.frames`.
    ///
    /// # Errors
    /// The file could not be written, or not all of it: why, and where it is.
    pub(crate) fn finish(&mut self, gather: &mut Gather, name: &str, report: &mut Report) -> Result<(), NodeError> {
        let is_empty = self.n_frames == 0 && self.first.is_empty();
        gather.end(&self.name, is_empty, report);
        while let Some(frame) = gather.next_frame() {
            self.push(frame, gather);
        }
        if self.columns.is_empty() {
            self.base = self.base.or(gather.base().map(|it| (it, 0)));
            self.begin(gather);
        }
        report.figure(format!("{name}.points"), self.places.len() as f64);
        report.figure(format!("{name}.frames"), self.n_frames as f64);
        if !self.file.is_wanted() {
            return Ok(());
        }
        let cannot = |error: String| NodeError::input(format!("{} cannot be written: {error}", self.name));
        if self.columns.is_empty()
            && let Some((why, _)) = &self.refused
        {
            return Err(cannot(why.clone()));
        }
        let mut head = self.head().map_err(cannot)?;
        let points: Vec<Point> = self.places.keys().copied().collect();
        let is_in_order = self.columns.iter().copied().eq(points.iter().map(|it| Some(*it)));
        let mut trouble = None;
        if self.n_frames > 0 && (!is_in_order || self.format.is_other_at_the_end()) {
            let places: Vec<usize> = self.places.values().copied().collect();
            let labels: Vec<String> = places.iter().map(|it| self.labels[*it].clone()).collect();
            let from = Columns { n_before: self.columns.len(), sources: places.iter().map(|it| Some(*it)).collect() };
            let format = &self.format;
            let last = format.last_head(&self.about(), &labels, self.n_frames as usize).and_then(|last| {
                self.file.rewrite(&head, &last, |rows, to| format.convert_last(&from, rows, to)).map(|()| last)
            });
            match last {
                Ok(last) => head = last,
                Err(why) => {
                    trouble = Some(format!("{}: its last pass failed: {why}; unused columns remain in it", self.name))
                }
            }
        }
        let n_bytes = head.len() as u64 + self.file.row_bytes() + self.file.rows().len() as u64;
        let end = self.format.end(n_bytes, self.n_frames as usize);
        self.file.finish(&head, &end, report)?;
        if self.n_beyond > 0 {
            let n = self.n_beyond;
            report.remark(format!("{}: {n} frames beyond the first {MOST_FRAMES} are left out", self.name));
        }
        let refused = self.refused.take().map(|(why, n)| {
            format!("{} has no room for later points, {n} samples of them are left out: {why}", self.name)
        });
        refused.or(trouble).map_or(Ok(()), |it| Err(NodeError::input(it)))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;
    use std::sync::Arc;

    use foveate::motion::{c3d, trc};

    use super::*;
    use crate::c3d::ExportC3d;
    use crate::target_rows::tests::target;
    use crate::trc::ExportTrc;

    const RATE_HZ: f64 = 50.0;

    /// Where a target is [m], and whether it is there.
    fn place(id: u32, step: u32) -> Option<[f64; 3]> {
        // Number 3 comes at 5 s, 1 at 6 s, those from 20 on one after the other, and 7 has holes.
        let is_there = match id {
            3 => step >= 250,
            1 => step >= 300,
            7 => !(100..140).contains(&step),
            20..40 => (step / 10) >= id,
            _ => id == 5,
        };
        is_there.then(|| [f64::from(id), f64::from(step) * 0.01, -0.5])
    }

    fn message(step: u32) -> Arc<Targets> {
        let list = (0..40).filter_map(|id| Some(target(id, place(id, step)?, Provenance::Measured))).collect();
        Arc::new(Targets { time: Time::from_s(1.0 + f64::from(step) / RATE_HZ), list })
    }

    /// Both nodes, fed by hand.
    struct Both {
        c3d: ExportC3d,
        trc: ExportTrc,
    }

    impl Both {
        fn new(folder: &Path, settings: &str) -> Self {
            let setup =
                Setup { out_dir: Some(folder.to_owned()), connected: vec!["targets".to_owned()], ..Setup::for_tests() };
            let settings = format!("rate_hz = {RATE_HZ}\n{settings}");
            let c3d = ExportC3d::new(toml::from_str(&settings).unwrap(), &setup).unwrap();
            let text = settings.replace("numbers = \"integer\"", "");
            Self { c3d, trc: ExportTrc::new(toml::from_str(&text).unwrap(), &setup).unwrap() }
        }

        fn push(&mut self, message: &Arc<Targets>) {
            self.c3d.push(Arc::clone(message));
            self.trc.push(Arc::clone(message));
        }

        fn finish(mut self) -> Report {
            let mut report = Report::default();
            self.c3d.finish(&mut report).unwrap();
            self.trc.finish(&mut report).unwrap();
            report
        }
    }

    /// The point of a label in each frame of both files, in mm.
    fn points(folder: &Path, label: &str) -> [Vec<Option<[f64; 3]>>; 2] {
        let file = c3d::read(&std::fs::read(folder.join("motion.c3d")).unwrap()).unwrap();
        let table = std::fs::read_to_string(folder.join("motion.trc"))
            .map_or_else(|_| trc::Recording::default(), |it| trc::read(&it).unwrap());
        let place = |labels: &[String]| labels.iter().position(|it| it == label);
        let of = |it: &c3d::Sample| it.is_present().then(|| it.position.map(f64::from));
        let in_file =
            place(&file.labels).map(|at| file.samples.iter().skip(at).step_by(file.labels.len()).map(of).collect());
        let in_table = place(&table.labels).map(|at| {
            let points = table.positions.iter().skip(at).step_by(table.labels.len()).copied();
            // z up again.
            points.map(|it| it.map(|[x, y, z]| [x, -z, y])).collect()
        });
        [in_file.unwrap_or_default(), in_table.unwrap_or_default()]
    }

    #[track_caller]
    fn check_points(folder: &Path, ids: impl Iterator<Item = u32>, n_frames: usize, tolerance_mm: f64) {
        for id in ids {
            for found in points(folder, &format!("target-{id}")) {
                assert_eq!(found.len(), n_frames, "target {id}");
                for (step, found) in (0..).zip(found) {
                    match (place(id, step), found) {
                        (Some(wanted), Some(found)) => assert!(
                            (0..3).all(|it| (found[it] - 1e3 * wanted[it]).abs() < tolerance_mm),
                            "target {id}, frame {step}: {found:?}, expected {wanted:?}"
                        ),
                        (None, None) => {}
                        other => panic!("target {id}, frame {step}: {other:?}"),
                    }
                }
            }
        }
    }

    #[test]
    fn points_that_come_late_find_room_and_stand_in_order_at_the_end() {
        for (settings, tolerance_mm) in [("", 0.001), ("numbers = \"integer\"", 1.0)] {
            let folder = tempfile::tempdir().unwrap();
            let mut both = Both::new(folder.path(), settings);
            (0..600).for_each(|step| both.push(&message(step)));
            let report = both.finish();
            assert_eq!([report.figures["c3d.points"], report.figures["trc.points"]], [24.0; 2]);
            let wanted = [1, 3, 5, 7].into_iter().chain(20..40);
            let labels: Vec<String> = wanted.clone().map(|it| format!("target-{it}")).collect();
            let file = c3d::read(&std::fs::read(folder.path().join("motion.c3d")).unwrap()).unwrap();
            assert_eq!((file.labels, file.start_s), (labels.clone(), Some(1.0)));
            let text = std::fs::read_to_string(folder.path().join("motion.trc")).unwrap();
            assert_eq!(trc::read(&text).unwrap().labels, labels);
            assert!(
                text.lines().next().unwrap().ends_with("motion.trc"),
                "no room is left over where the file was made anew"
            );
            check_points(folder.path(), wanted, 600, tolerance_mm);
            assert!(report.remarks.is_empty(), "{:?}", report.remarks);
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2, "no file is left over");
        }
    }

    #[test]
    fn file_is_whole_whenever_the_run_is_killed() {
        let folder = tempfile::tempdir().unwrap();
        let mut both = Both::new(folder.path(), "");
        let mut lengths = Vec::new();
        for step in 0..600 {
            both.push(&message(step));
            if step % 50 == 20 && step > 150 {
                // As it would be found, had the program ended here: nothing is finished.
                let n_frames = points(folder.path(), "target-5")[0].len();
                let ids: Vec<u32> =
                    (0..40).filter(|id| (0..n_frames as u32).any(|it| place(*id, it).is_some())).collect();
                let text = std::fs::read_to_string(folder.path().join("motion.trc")).unwrap();
                let declared: usize = text.lines().nth(2).unwrap().split('\t').nth(2).unwrap().parse().unwrap();
                assert_eq!(declared, n_frames);
                check_points(folder.path(), ids.into_iter(), n_frames, 0.001);
                lengths.push(n_frames);
            }
        }
        assert!(
            lengths.iter().zip(3..).all(|(n, lot)| *n + 80 > lot * 50 + 20),
            "no more than 1.6 s behind: {lengths:?}"
        );
        drop(both);
        assert_eq!(points(folder.path(), "target-5")[0].len(), *lengths.last().unwrap());
    }

    #[test]
    fn samples_out_of_order_find_their_place() {
        let folder = tempfile::tempdir().unwrap();
        let mut both = Both::new(folder.path(), "");
        for lot in 0..100 {
            [2, 0, 3, 1].iter().for_each(|it| both.push(&message(4 * lot + it)));
        }
        // Two seconds late: left out, and said.
        both.push(&message(300));
        let report = both.finish();
        check_points(folder.path(), [1, 3, 5, 7].into_iter(), 400, 0.001);
        assert!(report.remarks.iter().all(|it| it.contains("samples came after a later one")), "{:?}", report.remarks);
        assert_eq!(report.remarks.len(), 2);
    }

    #[test]
    fn input_that_halts_holds_up_frames_only_for_a_while() {
        let folder = tempfile::tempdir().unwrap();
        let setup = Setup {
            out_dir: Some(folder.path().to_owned()),
            connected: ["targets", "parent_targets", "marks"].map(str::to_owned).to_vec(),
            ..Setup::for_tests()
        };
        let mut node = ExportC3d::new(toml::from_str("rate_hz = 50.0").unwrap(), &setup).unwrap();
        (0..420).for_each(|step| node.push(message(step)));
        let n_frames = points(folder.path(), "target-5")[0].len();
        assert!((80..160).contains(&n_frames), "8 s less five of patience: {n_frames}");
        node.finish(&mut Report::default()).unwrap();
        assert_eq!(points(folder.path(), "target-5")[0].len(), 420);
    }

    #[test]
    fn run_without_anything_leaves_files_without_points() {
        let folder = tempfile::tempdir().unwrap();
        Both::new(folder.path(), "").finish();
        let file = c3d::read(&std::fs::read(folder.path().join("motion.c3d")).unwrap()).unwrap();
        assert_eq!((file.labels.len(), file.n_frames()), (0, 0));
        let text = std::fs::read_to_string(folder.path().join("motion.trc")).unwrap();
        assert!(text.starts_with("PathFileType") && text.lines().nth(2).unwrap().contains("\t0\t0\tmm"), "{text}");
    }
}
