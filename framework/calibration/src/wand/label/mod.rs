//! Labels the ends of a wand: the same end under the same label in all cameras, although both lights look alike.
//!
//! Two lights in each of two pictures can be matched in two ways. Pairs of cameras are
//! oriented on both matchings of every frame at once: half of these pairs of pixels is right, which is enough for a search by random
//! quintuples. Epipolar lines then decide between the matchings, frame by frame, unless the wand lies along them. The cameras of a
//! frame are joined by their clearest readings first; a camera that no clear reading joins goes without labels there. Pictures with
//! one light or with clutter are read last, by the lines of the cameras that are clear. From frame to frame the ends
//! keep their labels by moving little.
//!
//! Labels that a recording already has are kept where they agree; a camera with swapped labels throughout is reported and
//! corrected.

mod readings;

use nalgebra::Point2;

use self::readings::{LAMP_PX, Oriented, joined, lamps};
use crate::recording::{Recording, Spot};

/// A reading is clear when the other one is worse by this, in squared standard deviations.
const CLEAR: f64 = 9.0;

/// Options of [`label`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LabelOptions {
    /// Of either coordinate of a right pixel, standard deviation; the optics may be guesses, so more than the detector's [px].
    pub sigma_px: f64,
    /// A spot fits when its epipolar line is at most this far away [px].
    pub inlier_px: f64,
    /// Frames in which two cameras both see two lights, at least, for them to be oriented [–].
    pub min_frames: usize,
    /// Of the random draws.
    pub seed: u64,
}

impl Default for LabelOptions {
    fn default() -> Self {
        Self { sigma_px: 1.0, inlier_px: 4.0, min_frames: 10, seed: 1 }
    }
}

/// The result of [`label`].
#[derive(Debug, Clone, PartialEq)]
pub struct Labelled {
    /// The recording with the wand's ends as labels 0 and 1; other spots are gone.
    pub recording: Recording,
    /// Pictures with both ends labelled.
    pub whole: usize,
    /// Pictures with one end labelled.
    pub single: usize,
    /// Spots that were dropped: lamps, clutter, and ends that stayed ambiguous.
    pub dropped: usize,
    /// Cameras whose own labels were swapped throughout.
    pub swapped: Vec<usize>,
    /// Pairs of cameras that were oriented, with the frames in which both saw two lights, and those of them that fit.
    pub pairs: Vec<([usize; 2], usize, usize)>,
    /// Cameras that could not be oriented with any other.
    pub unplaced: Vec<usize>,
}

/// Why the ends could not be labelled.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LabelError {
    /// Lists of different lengths.
    #[error("{camera_frames} camera frames and {frames} frame numbers, expected as many of each")]
    LengthsDiffer {
        /// Pictures.
        camera_frames: usize,
        /// Frames of them.
        frames: usize,
    },
    /// A frame of an unknown camera.
    #[error("camera frame {camera_frame} is of camera {camera}, expected less than {cameras}")]
    NoSuchCamera {
        /// Number of the picture.
        camera_frame: usize,
        /// Its camera.
        camera: usize,
        /// How many cameras there are.
        cameras: usize,
    },
    /// An option outside its range.
    #[error("{option} is {found}, expected a finite number above 0")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// The value that was found.
        found: f64,
    },
    /// No two cameras saw the wand whole together.
    #[error(
        "no two cameras could be oriented by the wand; the best pair, {} and {}, saw both of its lights together in {frames} frames, \
         expected at least {needed}, moved about in all directions", best[0], best[1]
    )]
    NothingOriented {
        /// The pair.
        best: [usize; 2],
        /// Their frames.
        frames: usize,
        /// Number that is needed.
        needed: usize,
    },
}

/// What a camera frame of a frame shows.
#[derive(Debug, Clone, Default)]
struct View {
    camera_frame: usize,
    /// Usable spots, brightest first.
    spots: Vec<usize>,
    /// The spots of ends 0 and 1.
    ends: [Option<usize>; 2],
}

/// Groups pictures into frames: one for each run of camera frames whose times are less than `tolerance_s` after the one before, and in which no
/// camera comes twice. For cameras that share a clock.
pub fn frames_by_time(recording: &Recording, tolerance_s: f64) -> Vec<Option<usize>> {
    let mut order: Vec<usize> =
        (0..recording.camera_frames.len()).filter(|it| recording.camera_frames[*it].time_s.is_finite()).collect();
    order.sort_by(|a, b| recording.camera_frames[*a].time_s.total_cmp(&recording.camera_frames[*b].time_s));
    let mut frames = vec![None; recording.camera_frames.len()];
    let (mut frame, mut seen, mut before) = (0, Vec::new(), f64::NEG_INFINITY);
    for index in order {
        let camera_frame = &recording.camera_frames[index];
        if !seen.is_empty() && (camera_frame.time_s - before >= tolerance_s || seen.contains(&camera_frame.camera)) {
            frame += 1;
            seen.clear();
        }
        seen.push(camera_frame.camera);
        before = camera_frame.time_s;
        frames[index] = Some(frame);
    }
    frames
}

/// Labels the ends of the wand; `frame_of_look` gives the frame of each picture, if any.
///
/// # Errors
/// See [`LabelError`].
pub fn label(
    recording: &Recording,
    moment_of_frame: &[Option<usize>],
    options: &LabelOptions,
) -> Result<Labelled, LabelError> {
    check(recording, moment_of_frame, options)?;
    let mut wand = Wand::new(recording, moment_of_frame, options);
    wand.orient()?;
    let swapped = if wand.has_labels { wand.agree_on_given_labels() } else { Vec::new() };
    if !wand.has_labels {
        (0..wand.frames.len()).for_each(|it| wand.join(it));
    }
    (0..wand.frames.len()).for_each(|it| wand.read_the_rest(it));
    if !wand.has_labels {
        wand.keep_ends_over_time();
    }
    Ok(wand.finish(swapped))
}

fn check(recording: &Recording, moment_of_frame: &[Option<usize>], options: &LabelOptions) -> Result<(), LabelError> {
    let (camera_frames, frames, cameras) =
        (recording.camera_frames.len(), moment_of_frame.len(), recording.cameras.len());
    if camera_frames != frames {
        return Err(LabelError::LengthsDiffer { camera_frames, frames });
    }
    if let Some(camera_frame) = recording.camera_frames.iter().position(|it| it.camera >= cameras) {
        return Err(LabelError::NoSuchCamera {
            camera_frame,
            camera: recording.camera_frames[camera_frame].camera,
            cameras,
        });
    }
    for (option, found) in [("sigma_px", options.sigma_px), ("inlier_px", options.inlier_px)] {
        if !(found.is_finite() && found > 0.0) {
            return Err(LabelError::BadOption { option, found });
        }
    }
    Ok(())
}

struct Wand<'a> {
    recording: &'a Recording,
    options: &'a LabelOptions,
    /// By frame and camera.
    frames: Vec<Vec<Option<View>>>,
    has_labels: bool,
    oriented: Vec<Oriented>,
}

impl<'a> Wand<'a> {
    fn new(recording: &'a Recording, moment_of_frame: &[Option<usize>], options: &'a LabelOptions) -> Self {
        let n_frames = moment_of_frame.iter().flatten().max().map_or(0, |it| it + 1);
        let mut frames: Vec<Vec<Option<View>>> = vec![vec![None; recording.cameras.len()]; n_frames];
        let lamps: Vec<Vec<Point2<f64>>> = (0..recording.cameras.len()).map(|it| lamps(recording, it)).collect();
        let mut labelled = [0, 0];
        for (camera_frame, frame) in moment_of_frame.iter().enumerate() {
            let Some(frame) = *frame else { continue };
            let seen = &recording.camera_frames[camera_frame];
            let is_lamp = |it: &Spot| lamps[seen.camera].iter().any(|lamp| (lamp - it.pixel).norm() <= LAMP_PX);
            let usable = |it: &usize| {
                let spot = &seen.spots[*it];
                spot.pixel.coords.norm().is_finite() && (spot.label.is_some() || !is_lamp(spot))
            };
            let mut spots: Vec<usize> = (0..seen.spots.len()).filter(usable).collect();
            spots.sort_by(|a, b| seen.spots[*b].peak.total_cmp(&seen.spots[*a].peak));
            labelled[0] += spots.len();
            labelled[1] += spots.iter().filter(|it| matches!(seen.spots[**it].label, Some(0 | 1))).count();
            frames[frame][seen.camera].get_or_insert(View { camera_frame, spots, ends: [None; 2] });
        }
        let mut wand =
            Self { recording, options, frames, has_labels: 2 * labelled[1] > labelled[0], oriented: Vec::new() };
        wand.first_readings();
        wand
    }

    /// Ends where two spots leave no doubt which they are but for their order, or where labels are given.
    fn first_readings(&mut self) {
        for view in self.frames.iter_mut().flatten().flatten() {
            let spots = &self.recording.camera_frames[view.camera_frame].spots;
            view.ends = if self.has_labels {
                [0, 1].map(|end| view.spots.iter().copied().find(|it| spots[*it].label == Some(end)))
            } else if let [a, b] = view.spots[..] {
                [Some(a), Some(b)]
            } else {
                [None; 2]
            };
        }
    }

    fn pixel(&self, view: &View, spot: usize) -> Point2<f64> {
        self.recording.camera_frames[view.camera_frame].spots[spot].pixel
    }

    /// Pixels of both ends, in the order that they were read.
    fn both(&self, frame: usize, camera: usize) -> Option<[Point2<f64>; 2]> {
        let view = self.frames[frame][camera].as_ref()?;
        Some([self.pixel(view, view.ends[0]?), self.pixel(view, view.ends[1]?)])
    }

    fn exchange(&mut self, frame: usize, camera: usize) {
        if let Some(view) = &mut self.frames[frame][camera] {
            view.ends.swap(0, 1);
        }
    }

    /// Exchanges the ends of cameras that have them the wrong way round throughout; which these are, is settled by the majority.
    fn agree_on_given_labels(&mut self) -> Vec<usize> {
        let gain = |pair: &Oriented| {
            let each = (0..self.frames.len()).filter_map(|it| self.readings(pair, it));
            (pair.cameras, each.map(|[same, exchanged]| exchanged - same).sum::<f64>())
        };
        let edges: Vec<([usize; 2], f64)> = self.oriented.iter().map(gain).collect();
        let (group, exchanged) = joined(self.recording.cameras.len(), edges);
        let mut swapped = Vec::new();
        for of_group in 0..group.len() {
            let members: Vec<usize> = (0..group.len()).filter(|it| group[*it] == of_group).collect();
            let (out, kept): (Vec<usize>, Vec<usize>) = members.into_iter().partition(|it| exchanged[*it]);
            swapped.extend(if out.len() > kept.len() { kept } else { out });
        }
        swapped.sort_unstable();
        for frame in 0..self.frames.len() {
            swapped.iter().for_each(|it| self.exchange(frame, *it));
        }
        swapped
    }

    /// Joins the cameras of a frame by their clearest readings; those beside the largest group lose theirs.
    fn join(&mut self, frame: usize) {
        let edge = |pair: &Oriented| {
            let [same, exchanged] = self.readings(pair, frame)?;
            let fits = same.min(exchanged) < 2.0 * (self.options.inlier_px / self.options.sigma_px).powi(2);
            ((exchanged - same).abs() >= CLEAR && fits).then_some((pair.cameras, exchanged - same))
        };
        let edges: Vec<([usize; 2], f64)> = self.oriented.iter().filter_map(edge).collect();
        let n = self.recording.cameras.len();
        let (group, exchanged) = joined(n, edges);
        let size = |it: usize| group.iter().filter(|other| **other == it).count();
        let largest = (0..n).max_by_key(|it| (size(*it), n - it)).filter(|it| size(*it) > 1);
        for camera in 0..n {
            if largest.is_none_or(|it| group[camera] != group[it]) {
                if let Some(view) = &mut self.frames[frame][camera] {
                    view.ends = [None; 2];
                }
            } else if exchanged[camera] {
                self.exchange(frame, camera);
            }
        }
    }

    /// Reads pictures without both ends by the epipolar lines of those with both.
    fn read_the_rest(&mut self, frame: usize) {
        let n = self.recording.cameras.len();
        let clear: Vec<usize> = (0..n).filter(|it| self.both(frame, *it).is_some()).collect();
        for camera in 0..n {
            let Some(view) =
                self.frames[frame][camera].clone().filter(|it| it.ends == [None; 2] && !it.spots.is_empty())
            else {
                continue;
            };
            let read = self.by_lines(frame, camera, &view, &clear);
            if let Some(view) = &mut self.frames[frame][camera] {
                view.ends = read;
            }
        }
    }

    /// For each end the one spot that lies on the lines of all clear cameras, if there is just one, and if it is not on those of the other.
    fn by_lines(&self, frame: usize, camera: usize, view: &View, clear: &[usize]) -> [Option<usize>; 2] {
        let mut costs = vec![[0.0; 2]; view.spots.len()];
        let mut lines = 0.0;
        for pair in &self.oriented {
            let Some(side) = pair.cameras.iter().position(|it| *it == camera) else { continue };
            let other = pair.cameras[1 - side];
            let Some(ends) = self.both(frame, other).filter(|_| clear.contains(&other)) else { continue };
            lines += 1.0;
            for (costs, spot) in costs.iter_mut().zip(&view.spots) {
                for (cost, end) in costs.iter_mut().zip(ends) {
                    let here = self.pixel(view, *spot);
                    let pixels = if side == 0 { [here, end] } else { [end, here] };
                    *cost += self.cost(pair, pixels).unwrap_or(f64::INFINITY);
                }
            }
        }
        let limit = lines * (self.options.inlier_px / self.options.sigma_px).powi(2);
        [0, 1].map(|end| {
            let fits = |it: &usize| costs[*it][end] < limit;
            let best = (0..costs.len()).filter(fits).min_by(|a, b| costs[*a][end].total_cmp(&costs[*b][end]))?;
            let rival =
                (0..costs.len()).filter(|it| *it != best).map(|it| costs[it][end]).fold(f64::INFINITY, f64::min);
            let clear = costs[best][end] + CLEAR <= rival.min(costs[best][1 - end]);
            clear.then_some(view.spots[best])
        })
    }

    /// Exchanges the ends of whole frames where they then move less.
    fn keep_ends_over_time(&mut self) {
        let n = self.recording.cameras.len();
        let mut last: Vec<Option<(usize, [Point2<f64>; 2])>> = vec![None; n];
        for frame in 0..self.frames.len() {
            let now: Vec<Option<[Point2<f64>; 2]>> = (0..n).map(|it| self.both(frame, it)).collect();
            let latest = (0..n).filter(|it| now[*it].is_some()).filter_map(|it| Some(last[it]?.0)).max();
            let mut moved = [0.0; 2];
            for (now, last) in now.iter().zip(&last) {
                let (Some([a, b]), Some((when, [was_a, was_b]))) = (now, last) else { continue };
                if Some(*when) == latest {
                    moved[0] += (a - was_a).norm() + (b - was_b).norm();
                    moved[1] += (a - was_b).norm() + (b - was_a).norm();
                }
            }
            if moved[1] < moved[0] {
                (0..n).for_each(|it| self.exchange(frame, it));
            }
            for (camera, last) in last.iter_mut().enumerate() {
                *last = self.both(frame, camera).map(|it| (frame, it)).or(*last);
            }
        }
    }

    fn finish(self, swapped: Vec<usize>) -> Labelled {
        let mut recording = self.recording.clone();
        recording.camera_frames.iter_mut().for_each(|it| it.spots.clear());
        let (mut whole, mut single) = (0, 0);
        for view in self.frames.iter().flatten().flatten() {
            let spots = &mut recording.camera_frames[view.camera_frame].spots;
            for (end, spot) in view.ends.iter().enumerate() {
                let found = spot.map(|it| self.recording.camera_frames[view.camera_frame].spots[it]);
                spots.extend(found.map(|it| Spot { label: Some(end as u32), ..it }));
            }
            whole += usize::from(spots.len() == 2);
            single += usize::from(spots.len() == 1);
        }
        let before: usize = self.recording.camera_frames.iter().map(|it| it.spots.len()).sum();
        let placed = |camera: &usize| self.oriented.iter().any(|it| it.cameras.contains(camera));
        Labelled {
            recording,
            whole,
            single,
            dropped: before - 2 * whole - single,
            swapped,
            pairs: self.oriented.iter().map(|it| (it.cameras, it.frames, it.right)).collect(),
            unplaced: (0..self.recording.cameras.len()).filter(|it| !placed(it)).collect(),
        }
    }
}
