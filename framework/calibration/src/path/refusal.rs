//! Why a camera is not calibrated from a path, each with what to do.

use foveate_geometry::Optic;

/// Why a camera was refused, with the remedy.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// It saw too little.
    #[error("saw the point in {seen} pictures, expected at least {needed}")]
    TooFew {
        /// Pictures with the point.
        seen: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// What it saw does not move.
    #[error("saw the point stand still: {spread_px:.1} px over its pictures; move it all over them")]
    Still {
        /// Standard deviation of the pixels [px].
        spread_px: f64,
    },
    /// At no clock offset do enough pictures fall on the path.
    #[error("at no offset of its clock do {needed} of its {seen} observations meet the path")]
    NoOverlap {
        /// Observations.
        seen: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// No pose and clock explain enough.
    #[error(
        "{:.0} % of its observations agree with the path ({right} of {of} within {limit_px:.1} px, at the best offset of its clock, {offset_s:+.2} s), \
         expected at least {:.0} %: another point than the path's, a wrong lens or picture size, a camera that moved, or a clock that jumps",
        100.0 * *right as f64 / (*of).max(1) as f64, 100.0 * least_share
    )]
    Disagrees {
        /// Observations that agree.
        right: usize,
        /// Of all that fall on the path.
        of: usize,
        /// How far off a right one may be [px].
        limit_px: f64,
        /// Path time less camera time [s].
        offset_s: f64,
        /// Share that is needed [–].
        least_share: f64,
    },
    /// Its mirrored pictures fit, and so do other cameras' as they are.
    #[error("its pictures are mirrored: {:.0} % of its observations agree with the path when left and right are swapped, {:.0} % as they are", 100.0 * mirrored, 100.0 * share)]
    Mirrored {
        /// Share that agrees as it is [–].
        share: f64,
        /// And mirrored [–].
        mirrored: f64,
    },
    /// Two offsets of the clock explain what it saw.
    #[error(
        "its clock is ambiguous: {:.0} % of its observations agree with the path at an offset of {offset_s:+.2} s and {:.0} % at {other_s:+.2} s; \
         vary the path, since a repeated loop looks the same each time", 100.0 * share, 100.0 * other_share
    )]
    ClockAmbiguous {
        /// Path time less camera time [s].
        offset_s: f64,
        /// Share that agrees [–].
        share: f64,
        /// The other one [s].
        other_s: f64,
        /// And its share [–].
        other_share: f64,
    },
    /// A flat path seen from afar has a reversed twin.
    #[error(
        "two poses, {angle_deg:.0}° apart, explain what it saw equally well: the part of the path in its view is flat ({flat:.1} % as thick as long) and \
         far away; move the point up and down as well"
    )]
    TwoPoses {
        /// Angle between them [°].
        angle_deg: f64,
        /// Thickness over length of the path that it saw [%].
        flat: f64,
    },
    /// What it saw leaves the pose open, or nearly.
    #[error(
        "its observations fix its place only to {centre_m:.3} m and its direction to {turn_mrad:.1} mrad (the path was {depth_m:.1} m away): move the point \
         all over its picture, near and far"
    )]
    Weak {
        /// Standard deviation of the centre, its weakest direction [m].
        centre_m: f64,
        /// And of its orientation [mrad].
        turn_mrad: f64,
        /// Median distance of what it saw [m].
        depth_m: f64,
    },
    /// The pose is open.
    #[error(
        "the part of the path that it saw does not determine its pose: it is {across_m:.3} m wide and {along_m:.3} m long; move the point all over its picture"
    )]
    Open {
        /// Standard deviation along the longest axis of what it saw [m].
        along_m: f64,
        /// Across it [m].
        across_m: f64,
    },
    /// Its focal length is too uncertain.
    #[error("its {optic} is known only to {:.1} %: give its optics, or move the point nearer to it and farther away", 100.0 * sigma)]
    OpticOpen {
        /// The parameter concerned.
        optic: Optic,
        /// Standard deviation, relative [–].
        sigma: f64,
    },
    /// Observations that were held out disagree.
    #[error(
        "observations that were held out are {held_out_px:.1} px off, those that were used {used_px:.1} px: the solution holds only for a part of the time"
    )]
    HeldOut {
        /// Median of those held out [px].
        held_out_px: f64,
        /// Of those used [px].
        used_px: f64,
    },
}

impl Refusal {
    /// A fixed name of the cause, for programs.
    pub fn cause(&self) -> &'static str {
        match self {
            Refusal::TooFew { .. } => "too_few_observations",
            Refusal::Still { .. } => "light_still",
            Refusal::NoOverlap { .. } => "no_overlap",
            Refusal::Disagrees { .. } => "false_observations",
            Refusal::Mirrored { .. } => "mirrored",
            Refusal::ClockAmbiguous { .. } => "clock_ambiguous",
            Refusal::TwoPoses { .. } => "pose_ambiguous",
            Refusal::Weak { .. } | Refusal::Open { .. } => "pose_open",
            Refusal::OpticOpen { .. } => "focal_open",
            Refusal::HeldOut { .. } => "held_out_disagrees",
        }
    }
}
