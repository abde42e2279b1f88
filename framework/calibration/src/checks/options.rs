//! Where good ends and where usable ends.

/// Limits of the checks. Each pair is `[good up to, usable up to]`; beyond the second the calibration is to be done again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckOptions {
    /// Median distance of observations held out [px]. Lights and boards are found to 0.1–0.5 px; a median beyond 1.5 px is no longer noise.
    pub hold_out_px: [f64; 2],
    /// The same over what pixel noise and the other cameras' geometry leave to be expected [–]. Clean simulated rooms stay below 1.2.
    pub hold_out_excess: [f64; 2],
    /// Share of the observations that were rejected [–]. Reflections and lamps make up a third in dark rooms; with half, right and wrong are
    /// a matter of chance.
    pub rejected_share: [f64; 2],
    /// Share of common observations of two or more calibrated cameras that intersect nowhere [–]: they contradict the optics or poses.
    pub unsolved_share: [f64; 2],
    /// Of a camera, the median residual of held-out observations over that of those in use [–]; reported from 1 px on.
    pub hold_out_ratio: [f64; 2],
    /// Standard deviation of a known length, relative [–]. Recordings of waved wands reach 0.3–0.9 %.
    pub length_spread: [f64; 2],
    /// How much worse the reversed world must fit at least, as a ratio of r.m.s. residuals: `[good from, usable from]` [–].
    pub reversed_ratio: [f64; 2],
    /// How deep under the floor something may be, for a floor that is not quite flat [m].
    pub floor_tolerance_m: f64,
    /// Spread of the path across its flattest plane over that along it, least: `[good from, usable from]` [–]. A plane leaves focal
    /// lengths open and has a mirrored twin.
    pub flatness: [f64; 2],
    /// Farthest over nearest depth of a camera's points below which a free focal length trades against distance [–].
    pub depth_ratio: f64,
    /// Standard deviation of a camera's centre along its weakest direction over its median distance from the path [–]. 0.3 % are 12 mm
    /// at 4 m.
    pub centre_sigma: [f64; 2],
    /// Standard deviation of a camera's orientation about its weakest axis [mrad]. 3 mrad are 12 mm at 4 m.
    pub turn_sigma_mrad: [f64; 2],
    /// Frames that two cameras must share to count as linked [–].
    pub min_common: usize,
    /// A camera with a smaller part of the median camera's observations saw too little [–].
    pub few_observations: f64,
    /// Cells of a residual map along the longer side of the picture [–].
    pub map_cells: usize,
    /// Errors up to this length are negligible: no camera is diagnosed for them and no fit called bad, however small the noise
    /// [px]. 0.1 px are 0.8 mm at 4 m with a focal length of 500 px; lens models and the light's own shape leave as much.
    pub trifle_px: f64,
    /// Length from which a systematic residual is reported, in standard deviations of a pixel [–]. Smaller ones do no harm.
    pub pattern_sigma: f64,
    /// Robust cost of a camera's observations against the others' points, over that of the median camera, from which on it is a candidate [–].
    pub misfit: f64,
    /// What a cause must lower the robust cost by to be named [squared standard deviations]; chance rarely gives 30 in a hundred cameras.
    pub min_gain: f64,
    /// Part of the cost that it must lower as well, so that large recordings do not diagnose negligible errors [–].
    pub min_gain_share: f64,
    /// Share of a camera's observations far from where the others have the light, more than the median camera's, from which on they are
    /// called wrong [–].
    pub wrong_share: f64,
    /// What a cause must change in the picture of its camera, median, to be named; twice that for one that moved, which has more to please by
    /// chance [px]. Lens models leave errors of some tenths of a pixel that differ from one part of the picture, and so of the time, to the next.
    pub least_effect_px: f64,
    /// An observation is far from where the others have the light when at least so far off [px].
    pub far_px: f64,
    /// Most candidates that are searched [–].
    pub max_candidates: usize,
    /// Observations of a camera that are compared with the others; more are thinned out evenly [–].
    pub max_observations: usize,
    /// Sentences of the verdict at most [–].
    pub max_sentences: usize,
    /// Of the random draws.
    pub seed: u64,
}

impl Default for CheckOptions {
    fn default() -> Self {
        Self {
            hold_out_px: [1.5, 5.0],
            hold_out_excess: [1.5, 3.0],
            rejected_share: [0.35, 0.6],
            unsolved_share: [0.35, 0.5],
            hold_out_ratio: [4.0, 8.0],
            length_spread: [0.01, 0.03],
            reversed_ratio: [2.0, 1.3],
            floor_tolerance_m: 0.1,
            flatness: [0.05, 0.01],
            depth_ratio: 1.3,
            centre_sigma: [0.003, 0.03],
            turn_sigma_mrad: [3.0, 30.0],
            min_common: 10,
            few_observations: 0.25,
            map_cells: 8,
            trifle_px: 0.1,
            pattern_sigma: 0.5,
            misfit: 1.5,
            min_gain: 60.0,
            min_gain_share: 0.08,
            wrong_share: 0.1,
            least_effect_px: 0.5,
            far_px: 6.0,
            max_candidates: 6,
            max_observations: 500,
            max_sentences: 5,
            seed: 1,
        }
    }
}

impl CheckOptions {
    /// The level of `value` under a pair of limits, the smaller the better; what is not a number is not good.
    pub(super) fn level(value: f64, [good, usable]: [f64; 2]) -> super::Level {
        if value <= good {
            super::Level::Good
        } else if value <= usable {
            super::Level::Usable
        } else {
            super::Level::Redo
        }
    }
}
