//! Calibrations before calibrating: files of ours in which cameras may lack what is not known yet.

use std::collections::BTreeMap;

use crate::calibration::Calibration;

/// Default for a focal length that is not stated, in widths of the picture: a lens of some 58° [–].
const FOCAL_GUESS: f64 = 0.9;

/// A calibration, some of whose numbers are guesses.
#[derive(Debug, Clone, PartialEq)]
pub struct Draft {
    /// All cameras; unknown numbers are guesses, unknown poses are the origin.
    pub calibration: Calibration,
    /// What is unknown, by the camera's name; complete cameras are left out.
    pub unknown: BTreeMap<String, Unknown>,
}

/// What a file does not state about a camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Unknown {
    /// Both focal lengths: the calibration has a guess from the size of the picture.
    pub focal: bool,
    /// The principal point: the calibration has the middle of the picture.
    pub principal: bool,
    /// The distortion: the calibration has none.
    pub distortion: bool,
    /// Where it stands and looks: the calibration has the origin and no rotation.
    pub pose: bool,
}

/// The focal lengths to begin with for pictures of this size [px] whose pixels are `aspect` = fy/fx as wide as they are high [–]: ½ for
/// single fields of interlaced video.
pub fn guessed_focal(image_size: [u32; 2], aspect: f64) -> [f64; 2] {
    let [columns, rows] = image_size.map(f64::from);
    let focal = FOCAL_GUESS * columns.max(rows / aspect);
    [focal, aspect * focal]
}

/// The middle of pictures of this size [px].
pub fn middle(image_size: [u32; 2]) -> [f64; 2] {
    image_size.map(|it| (f64::from(it) - 1.0) / 2.0)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    fn draft(text: &str) -> Result<Draft, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("lab.toml");
        std::fs::write(&path, text).unwrap();
        Draft::load(&path).map_err(|error| error.to_string())
    }

    const HEAD: &str = "[calibration]\nlength_unit = \"unknown\"\n[camera.a]\nimage_size_px = [640, 480]\n";

    #[test]
    fn camera_needs_no_more_than_its_size() {
        let found = draft(HEAD).unwrap();
        let all = Unknown { focal: true, principal: true, distortion: true, pose: true };
        assert_eq!(found.unknown["a"], all);
        let camera = found.calibration.camera("a").unwrap();
        assert_eq!(camera.intrinsics.focal, [576.0, 576.0]);
        assert_eq!(camera.intrinsics.principal, [319.5, 239.5]);
    }

    #[test]
    fn shape_of_pixels_is_stated_where_they_are_not_square() {
        let field = HEAD.replace("480", "240") + "pixel_aspect = 0.5\n";
        assert_eq!(draft(&field).unwrap().calibration.camera("a").unwrap().intrinsics.focal, [576.0, 288.0]);
        let error = draft(&(field.clone() + "focal_px = [500, 250]\n")).unwrap_err();
        assert!(error.contains("pixel_aspect beside focal_px"), "{error}");
        let error = draft(&field.replace("0.5", "-1")).unwrap_err();
        assert!(error.contains("pixel_aspect") && error.contains("a number above 0"), "{error}");
    }

    #[test]
    fn what_is_stated_is_kept_and_half_a_pose_is_refused() {
        let found = draft(&format!("{HEAD}focal_px = [500, 501]\ndistortion = {{ k1 = -0.1 }}\n")).unwrap();
        let rest = Unknown { principal: true, pose: true, ..Unknown::default() };
        assert_eq!(found.unknown["a"], rest);
        assert_eq!(found.calibration.camera("a").unwrap().intrinsics.focal, [500.0, 501.0]);
        let error = draft(&format!("{HEAD}position_m = [0, 0, 1]\n")).unwrap_err();
        assert!(error.contains("camera_from_world_wxyz is missing"), "{error}");
    }

    #[test]
    fn run_is_told_what_a_draft_lacks_and_what_finds_it() {
        let error = Calibration::from_toml(HEAD, Path::new("lab.toml")).unwrap_err().to_string();
        assert!(error.contains("position_m is missing") && error.contains("foveate calibrate"), "{error}");
    }
}
