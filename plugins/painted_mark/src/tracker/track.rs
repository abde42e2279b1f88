//! One tracked mark or dot, and counts over all of them.

use foveate::estimation::statistics::median;
use foveate::imaging::{Dot, Template};
use foveate::prelude::{Report, Time};
use nalgebra::{Matrix2, Point2, Vector2};

/// One tracked mark or dot. Positions are in pixels of the received picture (which may be a part of the camera's).
#[derive(Debug, Clone, Default)]
pub(super) struct Track {
    /// The mark's label; `None`: an unlabelled dot.
    pub label: Option<u32>,
    /// Time of labelling.
    pub named: Time,
    /// Its position, predicted while it is lost.
    pub pixel: Point2<f64>,
    pub covariance: Matrix2<f64>,
    /// Its motion in the last step relative to the dominant motion.
    pub velocity: Vector2<f64>,
    /// Its whole last step, where it was seen before, extrapolated to the end of the step by the one before.
    pub step: Option<Vector2<f64>>,
    pub pace: Option<Vector2<f64>>,
    /// Pictures since its last observation; 0: it is visible.
    pub lost: u32,
    /// Pictures in which it was tracked without help.
    pub length: u32,
    /// Its patch in the last picture in which it was seen, but the present one.
    pub template: Template,
    /// Its patch when it began, renewed slowly.
    pub reference: Template,
    pub reference_covariance: Matrix2<f64>,
    pub reference_age: u32,
    pub has_reference: bool,
    /// Usual contrast and area of its dot; `None`: it is no dot.
    pub look: Option<[f64; 2]>,
    /// The pixels of the dot in the present picture.
    pub area: u32,
    /// In the present picture: its predicted position, and where it was found.
    pub expected: Point2<f64>,
    pub found: Option<Found>,
}

/// Result of the search for a track in the present picture.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    pub pixel: Point2<f64>,
    pub covariance: Matrix2<f64>,
    pub dot: Option<Dot>,
}

impl Track {
    pub fn is_seen(&self) -> bool {
        self.lost == 0
    }

    /// Starts a track at `dot`, reusing another's memory.
    pub fn begin(&mut self, pixel: Point2<f64>, covariance: Matrix2<f64>, dot: Option<&Dot>) {
        (self.label, self.pixel, self.covariance) = (None, pixel, covariance);
        (self.velocity, self.step, self.pace, self.lost, self.length) = (Vector2::zeros(), None, None, 0, 1);
        (self.has_reference, self.reference_age) = (false, 0);
        self.look = dot.map(|it| [it.contrast, f64::from(it.area)]);
        self.area = dot.map_or(0, |it| it.area);
        (self.expected, self.found) = (pixel, None);
    }
}

/// Counts.
#[derive(Debug, Clone, Default)]
pub(super) struct Tally {
    pub pictures: u64,
    pub refused: u64,
    pub named_features: u64,
    pub features: u64,
    pub searches: u64,
    /// Labelled marks that were not found again within the patience, and that were.
    pub lost: u64,
    pub regained: u64,
    pub named: u64,
    pub disputed: u64,
    pub corrected: u64,
    pub corrections_missed: u64,
    pub restarts: u64,
    pub blurred: u64,
    /// Pictures in which labelled marks were tracked from their labelling (or choosing) to their loss.
    pub lengths: Vec<f64>,
}

impl Tally {
    pub fn report(&self, camera: &str, report: &mut Report) {
        let mut figure = |name: &str, value: f64| report.figure(format!("tracker.{name}.{camera}"), value);
        figure("pictures", self.pictures as f64);
        if self.pictures > 0 {
            let pictures = self.pictures as f64;
            figure("named.mean", self.named_features as f64 / pictures);
            figure("unnamed.mean", (self.features - self.named_features) as f64 / pictures);
        }
        if let Some(length) = median(&self.lengths) {
            figure("track_frames.median", length);
        }
        for (name, count) in [
            ("losses", self.lost),
            ("regained", self.regained),
            ("namings", self.named),
            ("disputed", self.disputed),
            ("searches", self.searches),
            ("corrected", self.corrected),
            ("corrections_missed", self.corrections_missed),
            ("restarts", self.restarts),
            ("pictures_blurred", self.blurred),
            ("pictures_refused", self.refused),
        ] {
            if count > 0 {
                figure(name, count as f64);
            }
        }
    }
}
