//! Pan-tilt heads: kinematics, calibration and aiming.
//!
//! Source: [Davis 2002 §4.2–4.3]. The camera is rigid on the head and turns about two axes, which may lie anywhere in space:
//!
//! | here | source | meaning |
//! |---|---|---|
//! | [`PanTiltHead`] | (2) | both axes anywhere; [`PanTiltHead::aligned`] is (1) |
//! | [`Axis::turn`] | T R T⁻¹ | rotation about an axis that need not pass through the origin |
//! | [`calibrate_head`] | (4) | the axes and the camera at rest from targets seen at many settings |
//! | [`aim`] | §4.3 | the pan and tilt at which a target is in the middle of the image |
//! | [`ZoomTable`] | – | optics by zoom position |
//!
//! Axes are given in the space of the camera *at rest*, that is with both angles zero (x right, y down, z forward, origin at the
//! centre of projection): they do not change when the head is moved. With x₀ the point in that space, the point in the camera is
//! Tilt(−tilt) Pan(−pan) x₀ for a head whose pan axis is fixed and carries the tilt axis, as nearly all do
//! ([`Stacking::TiltOnPan`]). Equation (2) as written has the opposite order ([`Stacking::PanOnTilt`]); settings that change one
//! angle at a time, with the other at rest, do not distinguish the two.
//!
//! Angles are right-handed about the axes. In an aligned head, pan is about y (down) and positive to the right, tilt
//! about x and positive up, as in the protocols of most heads.

mod aim;
mod axis;
mod calibration;
mod head;
mod zoom;

pub use aim::{Aim, Obstacle, Unreachable, aim, aim_at_sphere};
pub use axis::Axis;
pub use calibration::{
    AxesRule, AxisSigma, HeadCalibration, HeadCalibrationError, HeadCovariance, HeadObservation, HeadOptions, Holdout,
    OpticsRule, UnitsRule, calibrate_head, refine_head,
};
pub use head::{AxisUnits, HeadError, HeadProjection, Limits, PanTiltHead, Setting, Stacking};
pub use zoom::{ZoomChoice, ZoomError, ZoomStop, ZoomTable};
