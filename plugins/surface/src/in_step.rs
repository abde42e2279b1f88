//! Whether the cameras that look at a surface do so at the same time, from where they were calibrated.

use std::sync::Arc;

use foveate::estimation::statistics::median;
use foveate::prelude::*;

use crate::views::View;

/// What was seen of it from moment to moment.
#[derive(Debug, Default)]
pub struct InStep {
    /// The pictures before, by view.
    before: Vec<Option<Arc<Image>>>,
    /// Pictures that a camera gave twice while another one's changed, by view.
    stuck: Vec<u64>,
    /// By moment: how far lines of sight pass the places that they agree on, in the median [px].
    medians: Vec<f64>,
    /// Of patches that are recognised so many lay off their epipolar lines in the moment that had fewest [–].
    least_share: Option<f64>,
    /// Points that were measured, and patches that lay off their epipolar lines, up to the moment before.
    counted: [f64; 2],
    /// Moments that were left out.
    left_out: u64,
}

/// The median of fewer points says nothing about the cameras [–].
const LEAST_POINTS: usize = 20;

/// Lines of sight that pass each other's places by more than this in the median are of a calibration that is wrong, or of pictures that were shifted: of a real rig, calibrated from one picture each, it is 0.37 [px].
const WIDE_PX: f64 = 0.75;
/// Where they pass by so many times as much in some moment as in the best, and by more than this, the cameras are as they were calibrated but look at different times: of scenes that move in step it is 1.1 to 1.4 times, of a real rig whose lenses are known to 0.4 px 2.0 [–, px].
const GROWS: f64 = 2.5;
const GROWN_PX: f64 = 0.1;
/// A moment is left out, and not told alone, where they pass by so many times as much more than in the best one, [–]
const MUCH_MORE: f64 = 9.0;
/// at least and at most by these parts of what they may at all: lenses, rolling shutters and cameras that creep make less, of a real rig 0.12 px a picture [–].
const LEFT_OUT: [f64; 2] = [0.25, 0.5];
/// So is one in which so many of the patches that are recognised lie off their epipolar lines, [–]
const OFF_LINES: f64 = 0.1;
/// so many times as many as in the best moment [–].
const MORE_OFF: f64 = 4.0;

impl InStep {
    /// Cameras that show the same picture as a moment before, to the last bit, while another one's has changed, and what is said of them.
    pub fn stuck(&mut self, views: &[View], images: &[Stamped<Arc<Image>>]) -> (Vec<CameraId>, Vec<String>) {
        self.before.resize_with(views.len(), || None);
        self.stuck.resize(views.len(), 0);
        let (mut same, mut has_changed) = (Vec::new(), false);
        for image in images {
            let Some(at) = views.iter().position(|it| it.id == image.value.camera) else { continue };
            match &self.before[at] {
                Some(before) if before.pixels == image.value.pixels => same.push(at),
                Some(_) => has_changed = true,
                None => (),
            }
            self.before[at] = Some(image.value.clone());
        }
        if !has_changed {
            same.clear();
        }
        let mut faults = Vec::new();
        for &at in &same {
            self.stuck[at] += 1;
            if self.stuck[at] == 1 {
                faults.push(format!(
                    "`{}`: found the same picture as a moment before, to the last bit, while another camera's has changed; expected one of its own for each moment: it is taken for none",
                    views[at].name
                ));
            }
        }
        (same.into_iter().map(|at| views[at].id).collect(), faults)
    }

    /// Why a moment is left out, by how far the lines of sight of its points `passed` their places, which may be `max_px` [px], and by how many points were measured and how many patches lay off their
    /// epipolar lines so far.
    pub fn judge(&mut self, passed: &[f64], max_px: f64, counted: [f64; 2]) -> Option<String> {
        let [measured, off] = [0, 1].map(|it| counted[it] - self.counted[it]);
        self.counted = counted;
        let share = (measured + off >= LEAST_POINTS as f64).then(|| off / (measured + off));
        let least_share = self.least_share;
        self.least_share = [share, least_share].into_iter().flatten().reduce(f64::min);
        let now = median(passed).filter(|_| passed.len() >= LEAST_POINTS);
        let least_px = self.medians.iter().copied().reduce(f64::min);
        self.medians.extend(now);
        let limit_px = |least: f64| {
            let [low, high] = LEFT_OUT.map(|it| it * max_px);
            (least + (MUCH_MORE * least).clamp(low, high)).max(GROWS * least)
        };
        let why = match (now.zip(least_px), share.zip(least_share)) {
            (Some((now, least)), _) if now > limit_px(least) => format!(
                "lines of sight of its points pass the places that they agree on by {now:.2} px in the median, {least:.2} px in an earlier moment"
            ),
            (_, Some((share, least))) if share > OFF_LINES && share > MORE_OFF * least => format!(
                "{:.0} % of the patches that were recognised in another view lie off their epipolar lines, {:.0} % in an earlier moment",
                100.0 * share,
                100.0 * least
            ),
            _ => return None,
        };
        self.left_out += 1;
        Some(format!("{why}: cameras are out of step, or one was moved; it is left out"))
    }

    /// How many moments were left out.
    pub fn n_left_out(&self) -> u64 {
        self.left_out
    }

    /// Figures and remarks of all moments so far.
    pub fn report(&self, report: &mut Report) {
        let middle_px = median(&self.medians).unwrap_or(f64::NAN);
        let most_px = self.medians.iter().copied().fold(f64::NAN, f64::max);
        let least_px = self.medians.iter().copied().fold(f64::NAN, f64::min);
        report.figure("surface.misfit_px.median", middle_px);
        report.figure("surface.misfit_px.max", most_px);
        report.figure("surface.out_of_step", self.left_out as f64);
        if self.left_out > 0 {
            report.remark(format!(
                "{} moments were left out: lines of sight pass each other there by far more than in earlier ones: cameras are out of step (by a field, or a picture), or one was moved",
                self.left_out
            ));
        } else if most_px > GROWN_PX && most_px > GROWS * least_px {
            report.remark(format!(
                "lines of sight of a moment's points pass the places that they agree on by {most_px:.2} px in one moment and by {least_px:.2} px in another, in the median, expected about the same in all: cameras are \
                 out of step (by a field, or a picture), or one was moved; depths and motions of these moments are not to be believed"
            ));
        } else if middle_px > WIDE_PX {
            report.remark(format!(
                "lines of sight of points pass the places that they agree on by {middle_px:.2} px in the median, expected less than {WIDE_PX} px: lenses or places of cameras are not as they were calibrated, pictures are \
                 shifted or cropped, or cameras are out of step"
            ));
        }
        let stuck: u64 = self.stuck.iter().sum();
        report.figure("surface.stuck", stuck as f64);
    }
}
