//! Diagnosis of cameras that are not synchronised, or were moved since their calibration.

use std::sync::Arc;

use foveate::estimation::statistics::median;
use foveate::prelude::*;

use crate::measure::{MeasureOptions, Sample};
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
    /// Points that were measured, and patches that lay off their epipolar lines, up to the moment before.
    counted: [f64; 2],
    /// Moments that were left out.
    left_out: u64,
    /// Moments in which views contradict each other, and the worst of them.
    contradicted: (u64, Option<Contradiction>),
    /// What that makes of variances in the last moment [–].
    widened: f64,
}

/// Views that do not agree to what is known of them.
#[derive(Debug, Clone)]
struct Contradiction {
    /// How far lines of sight pass their places, and how far matches and calibration would have them do so, in the median [px].
    found_px: f64,
    expected_px: f64,
    /// The view without which the others agree, where it is one, and how far they pass then [px].
    without: Option<(String, f64)>,
    /// Whether two views say so.
    are_two: bool,
}

/// The median of fewer points says nothing about the cameras [–].
const LEAST_POINTS: usize = 20;

/// Lines of sight that pass each other's places by more than this in the median are of a calibration that is wrong, or of pictures that were shifted: of a real rig, calibrated from one picture each, it is 0.37 [px].
const WIDE_PX: f64 = 0.75;
/// Where they pass by so many times as much in some moment as in the best, and by more than this, the cameras are as they were calibrated but look at different times: of scenes that move in step it is 1.1 to 1.4 times, of a real rig whose lenses are known to 0.4 px 2.0 [–, px].
const GROWS: f64 = 2.5;
const GROWN_PX: f64 = 0.1;
/// A moment is left out, instead of only reported, where the residual exceeds that of the best one by this factor, [–]
const MUCH_MORE: f64 = 9.0;
/// at least and at most by these parts of what they may at all: lenses, rolling shutters and cameras that creep make less, of a real rig 0.12 px a picture [–].
const LEFT_OUT: [f64; 2] = [0.25, 0.5];
/// So is one in which so many of the patches that are recognised lie off their epipolar lines: of scenes that are in step and as they were calibrated it is 4 % at most, of cameras that were exchanged 10 to 32 % [–].
pub const OFF_LINES: f64 = 0.08;
/// Views contradict each other where their lines of sight pass by so many times what their matches and the calibration (`camera_sigma_px`) would have: chance makes 1, of a median over a moment's points [–].
const CONTRADICTS: f64 = 2.5;
/// Most points of a moment for finding the faulty view [–].
const ASKED: usize = 60;
/// A view is named where the others pass by less than this part of what they do without any other view [–].
const NAMED: f64 = 0.4;

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
                    "`{}`: found the same picture as a moment before, byte for byte, while another camera's has changed; expected a new one for each moment: it is not used",
                    views[at].name
                ));
            }
        }
        (same.into_iter().map(|at| views[at].id).collect(), faults)
    }

    /// Why a moment is left out, by the points that it has, of which lines of sight may pass their places by `options` at most, and by how many points were measured and how many patches lay off their
    /// epipolar lines so far.
    pub fn judge(
        &mut self,
        views: &[View],
        samples: &[&Sample],
        options: &MeasureOptions,
        counted: [f64; 2],
    ) -> Option<String> {
        let (passed, max_px) = (samples.iter().map(|it| it.misfit_px).collect::<Vec<_>>(), options.max_misfit_px);
        self.widened = 1.0;
        let [measured, off] = [0, 1].map(|it| counted[it] - self.counted[it]);
        self.counted = counted;
        let share = (measured + off >= LEAST_POINTS as f64).then(|| off / (measured + off));
        let now = median(&passed).filter(|_| passed.len() >= LEAST_POINTS);
        let least_px = self.medians.iter().copied().reduce(f64::min);
        self.medians.extend(now);
        let limit_px = |least: f64| {
            let [low, high] = LEFT_OUT.map(|it| it * max_px);
            (least + (MUCH_MORE * least).clamp(low, high)).max(GROWS * least)
        };
        let why = match (now.zip(least_px), share) {
            (Some((now, least)), _) if now > limit_px(least) => format!(
                "the median residual of its lines of sight is {now:.2} px, but {least:.2} px in an earlier moment"
            ),
            (_, Some(share)) if share > OFF_LINES => format!(
                "{:.0} % of the patches that were recognised in another view are off their epipolar lines there, expected {:.0} % at most",
                100.0 * share,
                100.0 * OFF_LINES
            ),
            _ => {
                self.weigh(views, samples, options.camera_sigma_px);
                return None;
            }
        };
        self.left_out += 1;
        Some(format!("{why}: cameras are not synchronised, exchanged, or one was moved; the moment is left out"))
    }

    /// Whether views contradict each other: three or more where enough points are seen by as many, or two, of which it is seen across the base alone.
    fn weigh(&mut self, views: &[View], samples: &[&Sample], camera_sigma_px: f64) {
        let mut several: Vec<&Sample> = samples.iter().copied().filter(|it| it.seen.len() > 1).collect();
        let are_two = several.len() < LEAST_POINTS;
        if are_two {
            several = samples.to_vec();
        }
        // Of n views 2 n − 3 equations are left over.
        let variance = |it: &&Sample| {
            let n = (it.seen.len() + 1) as f64;
            let matched = it.seen.iter().map(|it| it.covariance.trace()).sum::<f64>() / (2.0 * n);
            camera_sigma_px * camera_sigma_px + matched
        };
        let left_over = |it: &&Sample| (2.0 * it.seen.len() as f64 - 1.0) / (it.seen.len() as f64 + 1.0);
        let middle = |of: &dyn Fn(&&Sample) -> f64| median(&several.iter().map(of).collect::<Vec<_>>());
        let found = middle(&|it| it.misfit_px).zip(middle(&|it| (left_over(it) * variance(it)).sqrt()));
        let Some((found_px, expected_px)) = found.filter(|_| several.len() >= LEAST_POINTS) else { return };
        if found_px <= CONTRADICTS * expected_px {
            return;
        }
        // Of three views in a line one that is off by e along it shows as e / √18, and what it shows as is what all of them may be off by: √(2 n) times as much.
        let of_points = middle(&|it| 2.0 * (it.seen.len() as f64 + 1.0) * found_px * found_px / variance(it));
        self.widened = 1.0 + of_points.unwrap_or(0.0);
        let asked: Vec<&Sample> = several.iter().step_by(several.len().div_ceil(ASKED)).copied().collect();
        let mut without: Vec<(f64, usize)> = (0..views.len())
            .filter_map(|view| {
                let left: Vec<f64> =
                    asked.iter().filter_map(|it| it.misfit_without(views, view, camera_sigma_px)).collect();
                Some((median(&left).filter(|_| 2 * left.len() > asked.len())?, view))
            })
            .collect();
        without.sort_by(|a, b| a.0.total_cmp(&b.0));
        let without = match without[..] {
            [(least_px, view), (next_px, _), ..]
                if least_px < NAMED * next_px && least_px < CONTRADICTS * expected_px =>
            {
                Some((views[view].name.clone(), least_px))
            }
            _ => None,
        };
        self.contradicted.0 += 1;
        if self.contradicted.1.as_ref().is_none_or(|it| found_px > it.found_px) {
            self.contradicted.1 = Some(Contradiction { found_px, expected_px, without, are_two });
        }
    }

    /// By what the variances of the last moment's points are to be multiplied, for views that contradict each other [–].
    pub fn widened(&self) -> f64 {
        self.widened
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
                "{} moments were left out: their residuals are far larger than earlier, or patches are off their epipolar lines: cameras are not synchronised (by a field, or a picture), exchanged, or \
                 one was moved",
                self.left_out
            ));
        } else if most_px > GROWN_PX && most_px > GROWS * least_px {
            report.remark(format!(
                "the median residual of lines of sight is {most_px:.2} px in one moment and {least_px:.2} px in another, expected about the same in all: cameras are \
                 not synchronised (by a field, or a picture), or one was moved; depths and motions of these moments are unreliable"
            ));
        } else if middle_px > WIDE_PX && self.contradicted.0 == 0 {
            report.remark(format!(
                "the median residual of lines of sight is {middle_px:.2} px, expected less than {WIDE_PX} px: lenses or poses of cameras have changed since calibration, pictures are \
                 shifted or cropped, or cameras are not synchronised"
            ));
        }
        if let (n, Some(Contradiction { found_px, expected_px, without, are_two })) = &self.contradicted {
            let seen = if *are_two { "two" } else { "three" };
            let who = match without {
                Some((name, left_px)) => format!("without `{name}` the others agree to {left_px:.2} px"),
                None if *are_two => {
                    "along their base, which determines depth, the error may be as large or larger".to_owned()
                }
                None => "the faulty camera is ambiguous".to_owned(),
            };
            report.remark(format!(
                "cameras contradict each other in {n} moments: the median residual of points that {seen} of them see is {found_px:.2} px, expected {expected_px:.2} px by their matches and \
                 `camera_sigma_px`; {who}: lenses or poses of cameras have changed since calibration, pictures are shifted or cropped, or cameras are not synchronised; the points' uncertainty is increased accordingly"
            ));
        }
        let stuck: u64 = self.stuck.iter().sum();
        report.figure("surface.stuck", stuck as f64);
    }
}
