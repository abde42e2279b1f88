//! Which parameters of each camera are known, guessed and estimated.

use foveate_calibration::recording::CameraGuess;
use foveate_geometry::{Camera, Distortion, Freedom};
use foveate_scene::Draft;
use foveate_scene::draft::{guessed_focal, middle};

use super::{CalibrateArgs, Optics};

impl Optics {
    fn freedom(self) -> Freedom {
        let focal = Freedom { focal: true, ..Freedom::POSE };
        match self {
            Optics::Known => Freedom::POSE,
            Optics::Focal => focal,
            Optics::Lens => Freedom { k1: true, k2: true, ..focal },
            Optics::All => Freedom { k1: true, k2: true, principal: true, decentering: true, aspect: true, ..focal },
        }
    }
}

/// What is computed with.
pub(super) struct Plan {
    pub(super) cameras: Vec<CameraGuess>,
    /// Whether poses are found from nothing.
    pub(super) from_nothing: bool,
    /// Whether nothing is known of focal lengths.
    pub(super) focal_unknown: bool,
}

impl Plan {
    pub(super) fn new(args: &CalibrateArgs, draft: &Draft) -> Result<Plan, String> {
        let unknown = |name: &str| draft.unknown.get(name).copied().unwrap_or_default();
        let without_pose = draft.calibration.cameras.iter().filter(|it| unknown(&it.name).pose).count();
        let from_nothing = args.from_nothing || 2 * without_pose >= draft.calibration.cameras.len();
        if without_pose > 0 && !from_nothing {
            let names: Vec<&str> = draft.unknown.iter().filter(|it| it.1.pose).map(|it| it.0.as_str()).collect();
            return Err(format!(
                "error: {} have no pose and the others have, expected all or none; say --from-nothing to find all of them",
                names.join(", ")
            ));
        }
        Ok(Plan::with(args, draft, from_nothing))
    }

    /// For a measured path, which takes poses from nothing but itself.
    pub(super) fn of_path(args: &CalibrateArgs, draft: &Draft) -> Plan {
        Plan::with(args, draft, true)
    }

    fn with(args: &CalibrateArgs, draft: &Draft, from_nothing: bool) -> Plan {
        let unknown = |name: &str| draft.unknown.get(name).copied().unwrap_or_default();
        let forget = args.from_nothing && args.optics.is_some_and(|it| it != Optics::Known);
        let guess = |named: &foveate_scene::NamedCamera| {
            let (mut camera, unknown) = (named.camera.clone(), unknown(&named.name));
            let free = match args.optics {
                Some(optics) => optics.freedom(),
                None => Freedom {
                    focal: unknown.focal,
                    principal: unknown.principal && unknown.focal,
                    k1: unknown.distortion && unknown.focal,
                    k2: unknown.distortion && unknown.focal,
                    ..Freedom::POSE
                },
            };
            if forget {
                forget_optics(&mut camera, free);
            }
            CameraGuess { name: named.name.clone(), camera, free }
        };
        let cameras: Vec<CameraGuess> = draft.calibration.cameras.iter().map(guess).collect();
        let focal_unknown = forget || draft.unknown.values().any(|it| it.focal);
        Plan { cameras, from_nothing, focal_unknown }
    }
}

/// Pictures that are so many times as wide as high often have pixels that are not square.
const WIDE: f64 = 2.0;

impl Plan {
    /// A note before a room is solved with the wrong pixel aspect: a waved light cannot distinguish that from a distorted world.
    pub(super) fn doubtful_pixels(&self, draft: &Draft) -> Option<String> {
        let doubtful = self.cameras.iter().find(|it| {
            let ([columns, rows], [fx, fy]) = (it.camera.image_size.map(f64::from), it.camera.intrinsics.focal);
            let is_guess = draft.unknown.get(&it.name).is_some_and(|it| it.focal);
            is_guess && fx == fy && !(1.0 / WIDE..=WIDE).contains(&(columns / rows))
        })?;
        let [columns, rows] = doubtful.camera.image_size;
        Some(format!(
            "note: the pictures of {} are {columns} × {rows} px; if their pixels are not square, as those of single fields of video, state it in the calibration: \
             pixel_aspect = 0.5",
            doubtful.name
        ))
    }
}

/// Puts what is to be found of a camera's optics back to what can be said of any camera.
fn forget_optics(camera: &mut Camera, free: Freedom) {
    if free.focal {
        // The shape of the pixels is the sensor's, which nobody guesses.
        let [fx, fy] = camera.intrinsics.focal;
        camera.intrinsics.focal = guessed_focal(camera.image_size, fy / fx);
        camera.intrinsics.skew = 0.0;
    }
    if free.principal {
        camera.intrinsics.principal = middle(camera.image_size);
    }
    if free.k1 {
        camera.distortion = Distortion::default();
    }
}
