//! Clock offsets of unsynchronised cameras from the path of one light, before anything else is known.
//!
//! 1. Each camera's observations are compared with their neighbours; those on a smooth path are kept, with interpolated places and velocities.
//! 2. Pairs of cameras are compared at every offset in the window, without poses, by whether one epipolar geometry explains them.
//! 3. The offsets of all pairs are brought to agree; pairs that contradict the others are dropped.
//! 4. Frames by these clocks give a room ([`self_calibrate`](foveate_geometry::self_calibration)), whose adjustment has the clocks free; frames are
//!    rebuilt until the clocks converge. Its covariance gives the uncertainty of each clock.
//!
//! Offsets that the path does not determine are refused with the reason: a light at rest, one that repeats its path, or one that moves evenly on a circle.
//!
//! Source of the problem and of the data it is measured on: J. Li, J. Murray, D. Ismaili, K. Schindler, C. Albl, "Reconstruction of 3D flight
//! trajectories from ad-hoc camera networks", IROS 2020 (which needs offsets that are known to a second or so).

mod agreement;
mod frames;
mod joint;
mod pairs;
mod resample;
mod track;

use foveate_estimation::Random;
use foveate_geometry::Camera;
use foveate_geometry::camera::CameraError;
use foveate_geometry::self_calibration::CameraStatus;

pub use self::frames::{FrameOptions, Frames, frames};
pub use self::pairs::PairError;
pub(crate) use self::resample::in_turn;
pub use self::resample::on_one_clock;
use crate::recording::Recording;
use crate::solved::ClockFit;
use agreement::{Compared, agree};
use pairs::{PairOptions, Straight, compare};

/// Options of [`synchronise`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockOptions {
    /// Clocks are compared up to this far apart, either way [s].
    pub max_offset_s: f64,
    /// And up to this part faster or slower; 0: all run alike [–].
    pub max_drift: f64,
    /// The camera whose clock is the room's; `None`: the one that agrees with most others.
    pub reference: Option<usize>,
    /// Between observations further apart, where the light was is not known; one and a half periods of a camera that is slower than this [s].
    pub max_gap_s: f64,
    /// Of either coordinate of a right observation, standard deviation [px].
    pub sigma_px: f64,
    /// An observation is right when at most this far from where its point is seen [px].
    pub inlier_px: f64,
    /// Moments, at steps of the path, that two cameras must share, at least 16 [–].
    pub min_moments: usize,
    /// The best offset of two cameras must be supported this much better than any other, or it is not believed [–].
    pub min_distinction: f64,
    /// Frames that clocks and poses are found from, at most [–].
    pub max_frames: usize,
    /// A clock with a larger standard deviation is not determined [s].
    pub max_sigma_s: f64,
    /// Clocks that move less than this from one round to the next have converged [s].
    pub settled_s: f64,
    /// Of the random draws.
    pub seed: u64,
}

impl Default for ClockOptions {
    fn default() -> Self {
        Self {
            max_offset_s: 0.5,
            max_drift: 0.0,
            reference: None,
            max_gap_s: 0.1,
            sigma_px: 0.5,
            inlier_px: 3.0,
            min_moments: 30,
            min_distinction: 1.25,
            max_frames: 1500,
            max_sigma_s: 5e-3,
            settled_s: 0.1e-3,
            seed: 1,
        }
    }
}

/// Two cameras whose clocks were compared.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockLink {
    /// The one of the lower number.
    pub a: usize,
    /// The second one.
    pub b: usize,
    /// What a's clock shows less what b's shows, in the middle of what both saw [s].
    pub offset_s: f64,
    /// Moments at which both see the light.
    pub moments: usize,
    /// By how many it is supported, each counted by how well it fits.
    pub support: f64,
    /// Whether the other pairs agree.
    pub consistent: bool,
}

/// Offsets this much beyond the window are within it, as far as is known before all cameras are taken together [s].
const BESIDE_S: f64 = 2e-3;

/// Whether a camera's clock was found, and if not, why.
#[derive(Debug, Clone, PartialEq)]
pub enum ClockStatus {
    /// It is the reference clock.
    Reference,
    /// It is known.
    Found {
        /// Pairs that confirm it; one alone has no loop that could contradict it.
        links: usize,
    },
    /// It saw too little of a smooth path.
    TooFewViews {
        /// Moments at steps of the path.
        moments: usize,
        /// Number that is needed.
        needed: usize,
    },
    /// What it saw stays in place.
    LightStill {
        /// Root of the mean squared distance of its pixels from their centre [px].
        spread_px: f64,
    },
    /// No pair determines its offset; the reason of the pair that came closest.
    Undetermined {
        /// The other camera of that pair.
        other: usize,
        /// Why not.
        fault: PairError,
    },
    /// Pairs determine its offset to some cameras, but not to the larger group.
    Separate {
        /// Those that it stands with.
        group: Vec<usize>,
    },
    /// Pairs determine its offset, but its pose could not be found.
    NoPose {
        /// Why it was not calibrated.
        status: CameraStatus,
    },
    /// Pairs lead to an offset beyond the search window.
    BeyondLimit {
        /// What was found, in the middle of the recording [s].
        offset_s: f64,
        /// The most that is allowed [s].
        limit_s: f64,
    },
    /// Its standard deviation is too large.
    Uncertain {
        /// Standard deviation, infinite for one that is entirely open [s].
        sigma_s: f64,
        /// The most that is accepted [s].
        limit_s: f64,
    },
}

impl ClockStatus {
    /// The status as a sentence; `name` gives the name of camera `k`.
    pub fn sentence(&self, name: impl Fn(usize) -> String) -> String {
        match self {
            ClockStatus::Reference => "its clock is the reference".to_owned(),
            ClockStatus::Found { links: 1 } => "found from one pair of cameras, not confirmed by a third".to_owned(),
            ClockStatus::Found { links } => format!("found, confirmed by {links} pairs"),
            ClockStatus::TooFewViews { moments, needed } => {
                format!("saw {moments} moments of a smoothly moving light, expected at least {needed}")
            }
            ClockStatus::LightStill { spread_px } => format!(
                "the light stays in place: its pixels are within {spread_px:.2} px, and a light at rest determines no clock"
            ),
            ClockStatus::Undetermined { other, fault } => format!("with {}: {fault}", name(*other)),
            ClockStatus::Separate { group } => {
                let group: Vec<String> = group.iter().map(|it| name(*it)).collect();
                format!("no pair links it to the larger group of cameras; its own group is {}", group.join(", "))
            }
            ClockStatus::NoPose { status } => format!("its pose was not found: {}", status.sentence(name)),
            ClockStatus::BeyondLimit { offset_s, limit_s } => format!(
                "pairs of cameras lead to an offset of {:.0} ms, expected at most {:.0} ms",
                offset_s * 1e3,
                limit_s * 1e3
            ),
            ClockStatus::Uncertain { sigma_s, limit_s } => format!(
                "known only to {:.2} ms, expected {:.2} ms: too little motion in the common view",
                sigma_s * 1e3,
                limit_s * 1e3
            ),
        }
    }

    /// Whether a larger search window might find the clock: nothing fits within the offsets that were tried.
    pub fn may_be_further_off(&self) -> bool {
        let at_no_offset = |it: &PairError| matches!(it, PairError::NoOverlap { .. } | PairError::Inconsistent { .. });
        match self {
            ClockStatus::BeyondLimit { .. } => true,
            ClockStatus::Undetermined { fault, .. } => at_no_offset(fault),
            _ => false,
        }
    }
}

impl std::fmt::Display for ClockStatus {
    fn fmt(&self, to: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        to.write_str(&self.sentence(|it| format!("camera {it}")))
    }
}

/// The result of [`synchronise`]: clocks, common frames, and the cameras with which they were found.
#[derive(Debug, Clone, PartialEq)]
pub struct Synchronised {
    /// By camera: its clock relative to the reference camera's; `None` where it is not determined.
    pub clocks: Vec<Option<ClockFit>>,
    /// By camera: the status of its clock.
    pub status: Vec<ClockStatus>,
    /// The camera whose clock is the room's.
    pub reference: usize,
    /// Pairs whose clocks could be compared.
    pub links: Vec<ClockLink>,
    /// Frames of all cameras whose clock is known, ready for a solution of the room.
    pub frames: Frames,
    /// By camera: pose and optics with which the clocks were found; as given where no pose was.
    pub cameras: Vec<Camera>,
    /// Root mean square length of the residuals from which clocks were found [px].
    pub rms_px: f64,
    /// Largest change of a clock in the last round [s].
    pub last_move_s: f64,
}

/// Why no clocks were found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ClockError {
    /// One camera, or none.
    #[error("{count} cameras, expected at least 2")]
    TooFewCameras {
        /// Their number.
        count: usize,
    },
    /// A camera with a parameter that is not finite.
    #[error("camera {camera}: {fault}")]
    BadCamera {
        /// Index of the camera.
        camera: usize,
        /// What is wrong.
        fault: CameraError,
    },
    /// A picture of an unknown camera, or at a time that is not finite.
    #[error(
        "picture {camera_frame} is of camera {camera} at {time_s} s, expected a camera below {cameras} and a finite time"
    )]
    BadFrame {
        /// Its place in the recording.
        camera_frame: usize,
        /// Its camera.
        camera: usize,
        /// Its time [s].
        time_s: f64,
        /// How many cameras there are.
        cameras: usize,
    },
    /// An option outside its range.
    #[error("{option} is {found}, expected {expected}")]
    BadOption {
        /// Name of the option.
        option: &'static str,
        /// The value that was found.
        found: f64,
        /// What it may be.
        expected: &'static str,
    },
    /// No two clocks could be compared; the reason of each camera.
    #[error("no two clocks could be compared: {}", status.iter().enumerate().map(|(camera, it)| format!("camera {camera}: {it}")).collect::<Vec<_>>().join("; "))]
    NothingFound {
        /// By camera.
        status: Vec<ClockStatus>,
    },
    /// Clocks were found, but no two cameras could be calibrated with them.
    #[error("no two cameras could be calibrated: {}", status.iter().enumerate().map(|(camera, it)| format!("camera {camera}: {it}")).collect::<Vec<_>>().join("; "))]
    NoRoom {
        /// By camera.
        status: Vec<CameraStatus>,
    },
    /// The joint adjustment of clocks and cameras failed.
    #[error("the adjustment of clocks failed: {fault}")]
    NotAdjusted {
        /// The fault.
        fault: String,
    },
}

impl ClockError {
    /// The error as a message; `name` gives the name of camera `k`, and `further` adds advice to the status of a clock.
    pub fn sentence(&self, name: impl Fn(usize) -> String, further: impl Fn(&ClockStatus) -> String) -> String {
        let list = |each: Vec<String>| each.iter().map(|it| format!("\n  {it}")).collect::<String>();
        match self {
            ClockError::BadCamera { camera, fault } => format!("{}: {fault}", name(*camera)),
            ClockError::BadFrame { camera_frame, camera, time_s, .. } => {
                format!("picture {camera_frame} of {} is at {time_s} s, expected a finite time", name(*camera))
            }
            ClockError::NothingFound { status } => {
                let each = status.iter().enumerate();
                let one = |(camera, it): (usize, &ClockStatus)| {
                    format!("{}: {}{}", name(camera), it.sentence(&name), further(it))
                };
                format!("no two clocks could be compared:{}", list(each.map(one).collect()))
            }
            ClockError::NoRoom { status } => {
                let each = status.iter().enumerate();
                let one = |(camera, it): (usize, &CameraStatus)| format!("{}: {}", name(camera), it.sentence(&name));
                format!("no two cameras could be calibrated:{}", list(each.map(one).collect()))
            }
            other => other.to_string(),
        }
    }
}

/// Finds the clocks of the cameras of a `recording` of one light, whose image is the brightest spot of each picture.
///
/// # Errors
/// See [`ClockError`]. Where only some clocks are undetermined, [`Synchronised::status`] gives the reason of each.
pub fn synchronise(recording: &Recording, options: &ClockOptions) -> Result<Synchronised, ClockError> {
    check(recording, options)?;
    let n = recording.cameras.len();
    let all = track::brightest(recording);
    let smooth: Vec<_> = all.iter().map(|it| it.smooth(options.max_gap_s)).collect();
    let straight: Vec<Straight> =
        smooth.iter().zip(&recording.cameras).map(|(track, it)| Straight::new(track, &it.camera)).collect();
    let pair_options = PairOptions {
        max_offset_s: options.max_offset_s,
        max_drift: options.max_drift,
        max_gap_s: options.max_gap_s,
        inlier_px: options.inlier_px,
        sigma_px: options.sigma_px,
        min_moments: options.min_moments.max(16),
        min_distinction: options.min_distinction,
    };
    let mut status: Vec<Option<ClockStatus>> = straight
        .iter()
        .map(|it| {
            let (moments, needed) = (it.n_moments(), pair_options.min_moments);
            if moments < needed {
                Some(ClockStatus::TooFewViews { moments, needed })
            } else if it.spread_px < 5.0 * options.sigma_px {
                Some(ClockStatus::LightStill { spread_px: it.spread_px })
            } else {
                None
            }
        })
        .collect();
    let (mut compared, mut faults): (Vec<Compared>, Vec<(usize, usize, PairError)>) = (Vec::new(), Vec::new());
    for a in 0..n {
        for b in (a + 1..n).filter(|it| status[a].is_none() && status[*it].is_none()) {
            match compare(&straight[a], &straight[b], &pair_options) {
                Ok(clock) => compared.push(Compared { a, b, clock }),
                Err(fault) => faults.push((a, b, fault)),
            }
        }
    }
    // What a camera that no pair reaches is told: the fault that came furthest.
    let closest = |camera: usize| {
        let own = faults.iter().filter(|it| it.0 == camera || it.1 == camera);
        own.max_by_key(|it| depth(&it.2))
            .map(|&(a, b, fault)| ClockStatus::Undetermined { other: a + b - camera, fault })
    };
    let unreached = |camera: usize, group: Vec<usize>| {
        if group.len() > 1 {
            return ClockStatus::Separate { group };
        }
        let needed = pair_options.min_moments;
        closest(camera).unwrap_or(ClockStatus::TooFewViews { moments: straight[camera].n_moments(), needed })
    };
    let mut random = Random::new(options.seed).fork("clocks");
    let Some(agreed) = agree(n, &compared, options.reference, &mut random) else {
        let each = status.into_iter().enumerate();
        let status = each.map(|(camera, it)| it.unwrap_or_else(|| unreached(camera, Vec::new()))).collect();
        return Err(ClockError::NothingFound { status });
    };
    for (camera, status) in status.iter_mut().enumerate().filter(|it| it.1.is_none()) {
        if agreed.clocks[camera].is_none() {
            *status = Some(unreached(camera, agreement::group_of(n, &compared, camera)));
        }
    }
    let links: Vec<ClockLink> = compared
        .iter()
        .zip(&agreed.consistent)
        .map(|(it, consistent)| ClockLink {
            a: it.a,
            b: it.b,
            offset_s: it.clock.a_from_b.room_s(it.clock.middle_s) - it.clock.middle_s,
            moments: it.clock.moments,
            support: it.clock.support,
            consistent: *consistent,
        })
        .collect();
    let reference = agreed.reference;
    let found = joint::refine(recording, &smooth, agreed.clocks, reference, options)?;
    let times = || recording.camera_frames.iter().map(|it| it.time_s);
    let middle_s = 0.5 * (times().fold(f64::INFINITY, f64::min) + times().fold(f64::NEG_INFINITY, f64::max));
    let mut clocks: Vec<Option<ClockFit>> = Vec::with_capacity(n);
    let mut stated: Vec<ClockStatus> = Vec::with_capacity(n);
    for (camera, early) in status.into_iter().enumerate() {
        let confirming = links.iter().filter(|it| it.consistent && (it.a == camera || it.b == camera)).count();
        let (clock, status) = match (early, &found.clocks[camera]) {
            (Some(status), _) => (None, status),
            (None, None) => (None, ClockStatus::NoPose { status: found.status[camera].clone() }),
            (None, Some(it)) if camera == reference => (Some(it), ClockStatus::Reference),
            // Pairs within the window add up: what they lead to may be the second best of two offsets.
            (None, Some(it)) if (it.clock.room_s(middle_s) - middle_s).abs() > options.max_offset_s + BESIDE_S => {
                let offset_s = it.clock.room_s(middle_s) - middle_s;
                (None, ClockStatus::BeyondLimit { offset_s, limit_s: options.max_offset_s })
            }
            (None, Some(it)) if it.sigma_s <= options.max_sigma_s => {
                (Some(it), ClockStatus::Found { links: confirming })
            }
            (None, Some(it)) => (None, ClockStatus::Uncertain { sigma_s: it.sigma_s, limit_s: options.max_sigma_s }),
        };
        clocks.push(clock.map(|it| ClockFit {
            offset_s: it.clock.offset_s,
            drift: it.clock.rate - 1.0,
            sigma_s: it.sigma_s,
            pairs: if camera == reference { 0 } else { confirming },
        }));
        stated.push(status);
    }
    let frame_options =
        FrameOptions { max_gap_s: options.max_gap_s, max_frames: options.max_frames, ..FrameOptions::default() };
    Ok(Synchronised {
        frames: frames(recording, &clocks, &frame_options),
        clocks,
        status: stated,
        reference,
        links,
        cameras: found.cameras,
        rms_px: found.rms_px,
        last_move_s: found.last_move_s,
    })
}

/// How far a comparison came.
fn depth(fault: &PairError) -> u8 {
    match fault {
        PairError::TooFew { .. } => 0,
        PairError::NoOverlap { .. } => 1,
        PairError::Inconsistent { .. } => 2,
        PairError::Flat { .. } => 3,
        PairError::Ambiguous { .. } => 4,
    }
}

fn check(recording: &Recording, options: &ClockOptions) -> Result<(), ClockError> {
    let cameras = recording.cameras.len();
    if cameras < 2 {
        return Err(ClockError::TooFewCameras { count: cameras });
    }
    for (camera, guess) in recording.cameras.iter().enumerate() {
        guess.camera.check().map_err(|fault| ClockError::BadCamera { camera, fault })?;
    }
    for (index, camera_frame) in recording.camera_frames.iter().enumerate() {
        if camera_frame.camera >= cameras || !camera_frame.time_s.is_finite() {
            let (camera, time_s) = (camera_frame.camera, camera_frame.time_s);
            return Err(ClockError::BadFrame { camera_frame: index, camera, time_s, cameras });
        }
    }
    for (option, found) in [
        ("max_offset_s", options.max_offset_s),
        ("max_gap_s", options.max_gap_s),
        ("sigma_px", options.sigma_px),
        ("inlier_px", options.inlier_px),
        ("max_frames", options.max_frames as f64),
        ("max_sigma_s", options.max_sigma_s),
        ("settled_s", options.settled_s),
    ] {
        if !(found.is_finite() && found > 0.0) {
            return Err(ClockError::BadOption { option, found, expected: "a finite number above 0" });
        }
    }
    if !(0.0..=0.05).contains(&options.max_drift) {
        return Err(ClockError::BadOption { option: "max_drift", found: options.max_drift, expected: "0 to 0.05" });
    }
    if !(options.min_distinction >= 1.0 && options.min_distinction.is_finite()) {
        return Err(ClockError::BadOption {
            option: "min_distinction",
            found: options.min_distinction,
            expected: "at least 1",
        });
    }
    if let Some(camera) = options.reference.filter(|it| *it >= cameras) {
        return Err(ClockError::BadOption {
            option: "reference",
            found: camera as f64,
            expected: "the number of a camera",
        });
    }
    Ok(())
}
