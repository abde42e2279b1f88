//! Tracks the marks of one camera from picture to picture [Davis 2002 §5.1]; knows no graph.
//!
//! Each mark is searched at its position predicted by the dominant motion, and at that predicted by its own velocity (a finite difference). Marks that pass the checks
//! are compared with their neighbours: a mark that moves unlike them is searched again at the place predicted by them, and lost if it is not there. A lost mark is searched again
//! for some pictures; after that it gets its label from the guide only.

use std::collections::VecDeque;

use foveate::imaging::{Dot, ImageView, plane};
use foveate::messages::{GuidedMark, Window};
use foveate::prelude::*;
use nalgebra::{Matrix2, Point2, Vector2};

use super::corrections::Correction;
use super::eye::Eye;
use super::rows::Rows;
use super::settings::TrackerSettings;
use super::track::{Tally, Track};

/// Smallest difference between guesses that are searched separately [px].
pub(super) const SAME_GUESS_PX: f64 = 0.5;
/// Pictures after which a dot's reference patch is renewed, and that of a mark that is no dot, which drifts by that.
const RENEW_FRAMES: [u32; 2] = [10, 30];
/// Variance of a position that was chosen by hand [px²].
const BY_HAND: f64 = 0.25;
/// Without a guide, a lost mark is remembered for this long, as long as its neighbours predict it [frames].
const REMEMBERED_FRAMES: u32 = 30;
/// Pictures whose motion is stored, for guides that come late.
const PAST: usize = 16;

/// Tracks the marks of one camera.
pub struct MarkTracker {
    pub(super) settings: TrackerSettings,
    pub(super) eye: Eye,
    corrections: Vec<Correction>,
    camera_rows: Option<u32>,
    /// One byte a pixel, of a colour picture.
    plane: Vec<u8>,
    pub(super) tracks: Vec<Track>,
    free: Vec<Track>,
    dots: Vec<Dot>,
    /// Size and window of the picture before; `None`: there was none.
    last: Option<([u32; 2], Window)>,
    /// Its stamp.
    stamp: Stamp,
    pub(super) window: Window,
    /// Shift of the window since the picture before, in pixels of the camera.
    window_moved: Vector2<f64>,
    /// Each picture's time and the dominant motion to the next, in pixels of the camera.
    pub(super) past: VecDeque<(Time, Vector2<f64>)>,
    since_search: u32,
    has_guide: bool,
    /// The present picture is rejected.
    pub(super) is_blurred: bool,
    pub(super) tally: Tally,
}

impl MarkTracker {
    /// `camera_rows`: rows of the camera's whole picture; left out, those of each received picture.
    ///
    /// # Errors
    /// Names the setting that is out of its range.
    pub fn new(
        settings: TrackerSettings,
        corrections: Vec<Correction>,
        camera_rows: Option<u32>,
    ) -> Result<Self, ConfigError> {
        settings.check()?;
        Ok(Self {
            camera_rows,
            eye: Eye::new(&settings).map_err(ConfigError::node)?,
            settings,
            corrections,
            plane: Vec::new(),
            tracks: Vec::new(),
            free: Vec::new(),
            dots: Vec::new(),
            last: None,
            stamp: Stamp::default(),
            window: Window::default(),
            window_moved: Vector2::zeros(),
            past: VecDeque::new(),
            since_search: 0,
            has_guide: false,
            is_blurred: false,
            tally: Tally::default(),
        })
    }

    /// Works on the next picture and fills `features` with the marks seen in it: labelled ones ascending, then unlabelled dots in scan order, in pixels
    /// of the camera. `guide`: predicted marks at a time.
    ///
    /// # Errors
    /// A sentence about a picture whose number of bytes does not match its size; it is skipped.
    pub fn see(
        &mut self,
        image: &Image,
        stamp: Stamp,
        guide: Option<(Time, &[GuidedMark])>,
        features: &mut Features,
    ) -> Result<(), String> {
        features.list.clear();
        self.take(image)?;
        self.tally.pictures += 1;
        let now = ([image.width, image.height], image.window);
        let is_next = self.last.is_some_and(|(size, window)| size == now.0 && window.shrink == now.1.shrink);
        if self.last.is_some() && !is_next {
            self.tally.restarts += 1;
            (0..self.tracks.len()).rev().for_each(|at| self.end(at));
            self.past.clear();
        }
        self.is_blurred = false;
        let had_lost = self.tracks.iter().any(|it| !it.is_seen());
        if is_next {
            let shift = self.eye.dominant_motion();
            let before = self.last.map_or(now.1, |it| it.1);
            let moved = |now: u32, before: u32| f64::from(now) - f64::from(before);
            let window = Vector2::new(moved(now.1.left, before.left), moved(now.1.top, before.top));
            self.window_moved = window;
            if let Some(last) = self.past.back_mut() {
                last.1 = window + shift * f64::from(now.1.shrink);
            }
            self.follow(shift);
        }
        (self.last, self.stamp) = (Some(now), stamp);
        if self.past.len() == PAST {
            self.past.pop_front();
        }
        let before = self.past.back().map(|it| it.0).filter(|_| is_next);
        let rows = Rows::of(self.settings.readout_ms, self.camera_rows.unwrap_or(image.height), before, stamp.time);
        self.past.push_back((stamp.time, Vector2::zeros()));
        self.correct(stamp);
        self.since_search += 1;
        let is_clear = self.settings.find && !self.is_blurred;
        if is_clear && (!is_next || had_lost || self.since_search >= self.settings.search_every) {
            self.search();
        }
        if let Some((time, marks)) = guide {
            self.has_guide = true;
            self.heed(time, marks, stamp.time, [image.width, image.height]);
        }
        self.write(features, rows);
        Ok(())
    }

    /// Makes one byte a pixel of the picture and takes that.
    fn take(&mut self, image: &Image) -> Result<(), String> {
        let (width, height) = (image.width as usize, image.height as usize);
        let promised = width.saturating_mul(height).saturating_mul(image.format.channels());
        if image.pixels.len() != promised || image.window.shrink == 0 {
            self.tally.refused += 1;
            return Err(format!("the picture has {} bytes, expected {promised}", image.pixels.len()));
        }
        self.window = image.window;
        let pixels = match (image.format, self.settings.colour) {
            (PixelFormat::Gray8, _) => image.pixels.as_slice(),
            (PixelFormat::Rgb8, None) => {
                plane::extract(plane::Channel::Luma, &image.pixels, &mut self.plane).map_err(|it| it.to_string())?;
                &self.plane
            }
            (PixelFormat::Rgb8, Some(colour)) => {
                // Dark where it has the colour.
                let distance = |pixel: &[u8; 3]| {
                    let sum: u32 = pixel.iter().zip(colour).map(|(a, b)| u32::from(a.abs_diff(b)).pow(2)).sum();
                    f64::from(sum).sqrt().min(255.0) as u8
                };
                self.plane.clear();
                self.plane.extend(image.pixels.as_chunks::<3>().0.iter().map(distance));
                &self.plane
            }
        };
        let view = ImageView::new(pixels, width, height).map_err(|it| it.to_string())?;
        self.eye.take(&view, self.settings.levels as usize);
        Ok(())
    }

    /// Searches all tracks after the dominant motion `shift`.
    fn follow(&mut self, shift: Vector2<f64>) {
        let settings = &self.settings;
        for track in &mut self.tracks {
            track.expected = track.pixel + shift;
            track.found = None;
            if track.is_seen() && self.eye.flow.learn(&self.eye.previous, track.pixel, &mut track.template).is_err() {
                // There is no patch to look for.
                track.lost = settings.patience_frames + 1;
            }
            if track.lost > settings.patience_frames {
                continue;
            }
            track.found = self.eye.look(settings, track, track.expected, shift);
            if track.found.is_none() && track.velocity.norm() > SAME_GUESS_PX {
                track.found = self.eye.look(settings, track, track.expected + track.velocity, shift);
            }
        }
        if settings.checks {
            self.compare(shift);
            self.part();
            self.pass_over_blur();
        }
        self.settle(shift);
    }

    /// Minimum distance between dots [px].
    pub(super) fn apart(&self) -> f64 {
        1.5 * self.settings.radius_px
    }

    /// Updates tracks with what was found; the others are lost, and extrapolated by their neighbours.
    fn settle(&mut self, shift: Vector2<f64>) {
        for at in 0..self.tracks.len() {
            if self.tracks[at].found.is_none() {
                // Before any is changed: neighbours are asked where they were expected.
                let neighbours = self.neighbours(at);
                let track = &mut self.tracks[at];
                track.expected += neighbours.median().unwrap_or_default();
                track.velocity = Vector2::zeros();
                // A patience is short; for longer, only neighbours all around carry it on.
                if !neighbours.surround() && track.lost > self.settings.patience_frames {
                    track.lost = track.lost.max(REMEMBERED_FRAMES);
                }
            }
        }
        let patience = self.settings.patience_frames;
        for at in (0..self.tracks.len()).rev() {
            let track = &mut self.tracks[at];
            let Some(found) = track.found else {
                track.pixel = track.expected;
                track.lost += 1;
                let is_named = track.label.is_some();
                if is_named && track.lost == patience + 1 {
                    self.tally.lost += 1;
                    self.tally.lengths.push(f64::from(track.length));
                    track.length = 0;
                }
                let is_remembered = is_named && !self.has_guide && track.lost <= REMEMBERED_FRAMES;
                if track.lost > patience && !is_remembered {
                    self.remove(at);
                }
                continue;
            };
            let step = track.is_seen().then(|| found.pixel - track.pixel);
            // A difference is the velocity of half a period ago.
            track.pace = step.map(|step| step + (step - track.step.unwrap_or(step)) * 0.5);
            track.step = step;
            if track.is_seen() {
                track.velocity = found.pixel - track.pixel - shift;
            } else if track.label.is_some() {
                self.tally.regained += 1;
            }
            (track.pixel, track.covariance, track.lost) = (found.pixel, found.covariance, 0);
            track.length += 1;
            if let (Some(look), Some(dot)) = (&mut track.look, &found.dot) {
                track.area = dot.area;
                look[0] += 0.1 * (dot.contrast - look[0]);
                look[1] += 0.1 * (f64::from(dot.area) - look[1]);
            }
            track.reference_age += 1;
            if !track.has_reference || track.reference_age >= RENEW_FRAMES[usize::from(track.look.is_none())] {
                let learnt = self.eye.flow.learn(&self.eye.current, track.pixel, &mut track.reference);
                track.has_reference = learnt.is_ok();
                (track.reference_age, track.reference_covariance) = (0, track.covariance);
            }
        }
    }

    /// Takes marks chosen by hand, by label and position [px of the camera], in the picture with this number, which is the next one: all that are visible there. `None`: that picture is past.
    pub fn choose(&mut self, marks: &[(u32, Point2<f64>)], frame: Option<u64>) {
        let Some(frame) = frame else {
            self.tally.corrections_missed += marks.len() as u64;
            return;
        };
        let place = self.corrections.partition_point(|it| it.frame <= frame);
        let labels = self.tracks.iter().filter_map(|it| it.label);
        let hidden = labels.filter(|label| marks.iter().all(|it| it.0 != *label)).map(|mark| (mark, None));
        let visible = marks.iter().map(|(mark, pixel)| (*mark, Some(*pixel)));
        let corrections: Vec<Correction> =
            hidden.chain(visible).map(|(mark, pixel)| Correction { frame, mark, pixel }).collect();
        self.corrections.splice(place..place, corrections);
    }

    /// Goes on with other settings, and with `rows` besides: those of the last picture and of some before it are applied now.
    pub fn change(&mut self, settings: TrackerSettings, rows: &[Correction]) {
        self.settings = settings;
        for it in rows {
            if self.last.is_none() || it.frame > self.stamp.sequence {
                let order = |it: &Correction| (it.frame, it.mark);
                self.corrections.retain(|other| order(other) != order(it));
                let place = self.corrections.partition_point(|other| order(other) < order(it));
                self.corrections.insert(place, *it);
                continue;
            }
            let n_since = (self.stamp.sequence - it.frame) as usize;
            // The motion to the next picture stands with each but the last.
            if n_since >= self.past.len() {
                self.tally.corrections_missed += 1;
                continue;
            }
            let motions = self.past.iter().rev().skip(1).take(n_since).map(|it| it.1);
            let moved = motions.sum::<Vector2<f64>>();
            self.correct_mark(it.mark, it.pixel.map(|it| it + moved), self.stamp.time);
        }
    }

    /// Applies the corrections by hand for this picture.
    fn correct(&mut self, stamp: Stamp) {
        let n_before = self.corrections.partition_point(|it| it.frame < stamp.sequence);
        let n = self.corrections.partition_point(|it| it.frame <= stamp.sequence);
        self.tally.corrections_missed += n_before as u64;
        for place in n_before..n {
            let Correction { mark, pixel, .. } = self.corrections[place];
            self.correct_mark(mark, pixel, stamp.time);
        }
        self.corrections.drain(..n);
    }

    /// Puts a mark to `pixel` of the camera in the last picture, or ends it.
    fn correct_mark(&mut self, mark: u32, pixel: Option<Point2<f64>>, time: Time) {
        self.tally.corrected += 1;
        if let Some(at) = self.tracks.iter().position(|it| it.label == Some(mark)) {
            self.end(at);
        }
        let Some(pixel) = pixel else { return };
        let pixel = self.window.in_image(&pixel);
        let dot = self.eye.dot(pixel, self.settings.radius_px + 1.5);
        let place = match &dot {
            Some(dot) if self.settings.reanchor => (dot.centre, dot.covariance),
            _ => (pixel, Matrix2::identity() * BY_HAND),
        };
        let apart = self.apart();
        while let Some(at) = self.tracks.iter().position(|it| (it.pixel - place.0).norm() < apart) {
            self.end(at);
        }
        let track = self.begin(place.0, place.1, dot.as_ref());
        (track.label, track.named) = (Some(mark), time);
    }

    /// Searches dots without a track.
    fn search(&mut self) {
        self.since_search = 0;
        self.tally.searches += 1;
        let mut dots = std::mem::take(&mut self.dots);
        self.eye.finder.find(&self.eye.current.level(0), &mut dots);
        let apart = self.apart();
        dots.retain(|dot| {
            let is_there = |it: &Track| it.is_seen() && (it.pixel - dot.centre).norm() < apart;
            !self.tracks.iter().any(is_there)
        });
        for dot in &dots {
            if let Some(at) = self.remembered(dot, &dots) {
                let track = &mut self.tracks[at];
                (track.pixel, track.covariance) = (dot.centre, dot.covariance);
                (track.lost, track.length, track.area) = (0, 1, dot.area);
                self.tally.regained += 1;
            } else if self.tracks.len() < self.settings.max_marks as usize {
                self.begin(dot.centre, dot.covariance, Some(dot));
            }
        }
        self.dots = dots;
    }

    /// The lost mark predicted at `dot`, if it is unambiguous.
    fn remembered(&mut self, dot: &Dot, dots: &[Dot]) -> Option<usize> {
        if !self.settings.checks {
            return None;
        }
        let is_lost = |it: &Track| it.label.is_some() && it.lost > self.settings.patience_frames;
        let distance = |it: &Track| (it.pixel - dot.centre).norm();
        let lost = self.tracks.iter().enumerate().filter(|(_, it)| is_lost(it));
        let (at, track) = lost.min_by(|a, b| distance(a.1).total_cmp(&distance(b.1)))?;
        let near = distance(track);
        let clear = super::naming::clear_of(near);
        let other_dots = dots.iter().filter(|it| it.centre != dot.centre).map(|it| (it.centre - track.pixel).norm());
        let other_marks =
            self.tracks.iter().enumerate().filter(|(k, it)| *k != at && is_lost(it)).map(|it| distance(it.1));
        let is_alone = other_dots.chain(other_marks).all(|it| it >= clear);
        let is_like_it = near <= self.settings.name_px
            && is_alone
            && track.has_reference
            && self.eye.flow.correlation(&track.reference, &self.eye.current, dot.centre)
                >= self.settings.min_correlation;
        is_like_it.then_some(at)
    }

    fn begin(&mut self, pixel: Point2<f64>, covariance: Matrix2<f64>, dot: Option<&Dot>) -> &mut Track {
        let mut track = self.free.pop().unwrap_or_default();
        track.begin(pixel, covariance, dot);
        self.tracks.push(track);
        let last = self.tracks.len() - 1;
        &mut self.tracks[last]
    }

    /// Removes a track, and counts its length.
    pub(super) fn end(&mut self, at: usize) {
        let track = &self.tracks[at];
        if track.label.is_some() && track.length > 0 {
            self.tally.lengths.push(f64::from(track.length));
        }
        self.remove(at);
    }

    fn remove(&mut self, at: usize) {
        let track = self.tracks.swap_remove(at);
        self.free.push(track);
    }

    fn write(&mut self, features: &mut Features, rows: Option<Rows>) {
        let scale = f64::from(self.window.shrink).powi(2);
        let steps: Vec<Vector2<f64>> = self.tracks.iter().filter(|it| it.is_seen()).filter_map(|it| it.pace).collect();
        // What was not seen before goes with the others.
        let usual = steps.iter().sum::<Vector2<f64>>() / steps.len().max(1) as f64;
        let place = |it: &Track| {
            let pixel = self.window.in_camera(&it.pixel);
            let step = self.window_moved + it.pace.unwrap_or(usual) * f64::from(self.window.shrink);
            rows.map_or(pixel, |rows| rows.at_middle(&pixel, &step))
        };
        features.list.extend(self.tracks.iter().filter(|it| it.is_seen()).map(|it| Feature {
            centre: place(it),
            covariance: it.covariance * scale,
            area: it.area,
            peak: 0,
            label: it.label,
        }));
        let order = |it: &Feature| (it.label.is_none(), it.label);
        features.list.sort_unstable_by(|a, b| {
            let place = |it: &Feature| (it.centre.y, it.centre.x);
            order(a).cmp(&order(b)).then(place(a).partial_cmp(&place(b)).unwrap_or(std::cmp::Ordering::Equal))
        });
        self.tally.features += features.list.len() as u64;
        self.tally.named_features += features.list.iter().filter(|it| it.label.is_some()).count() as u64;
    }

    /// Counts the remaining tracks, and reports all figures.
    pub(super) fn report(&mut self, camera: &str, report: &mut Report) {
        for track in self.tracks.iter().filter(|it| it.label.is_some() && it.length > 0) {
            self.tally.lengths.push(f64::from(track.length));
        }
        self.tally.corrections_missed += self.corrections.len() as u64;
        self.tally.report(camera, report);
    }
}
