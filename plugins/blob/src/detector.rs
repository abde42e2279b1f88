//! `blob.detector`: finds what moves before a learnt background, in the pictures of one camera.

use std::path::Path;

use foveate::geometry::Camera;
use foveate::node::detector::{DetectorPorts, DetectorShell};
use foveate::prelude::*;
use nalgebra::{Point2, Vector2, Vector3};

use crate::blob_detector::{BlobDetector, GrayPicture};
use crate::settings::BlobSettings;

ports! {
    IMAGE: In<Image> = each("image");
    PREDICTED: In<Targets> = latest("predicted").optional();
    FEATURES: Out<Features> = "features";
}

const PORTS: DetectorPorts = DetectorPorts { image: &IMAGE, predicted: &PREDICTED, features: &FEATURES };

figures! {
        "detector.features.*": count, neither, "Blobs found in all pictures of the camera";
        "detector.pictures_searched.*": count, neither, "Pictures searched; the pictures of the three figures below are not among them";
        "detector.pictures_learning.*": count, neither, "Pictures used only to learn the background";
        "detector.pictures_flooded.*": count, low, "Pictures not searched because too much of them differed from the background";
    "detector.pictures_refused.*": count, low, "Pictures that could not be read: wrong size, part, colour or pixels";
}

/// Pictures in, blobs out in scan order, each with a point and its covariance.
///
/// Nothing seen, or the background not learnt yet: an empty list. A picture of the wrong size, a broken picture, and a picture with more
/// foreground than `flood_share` are gaps on the output; the detector continues with the next picture.
pub struct Detector {
    blob_detector: BlobDetector,
    shell: DetectorShell,
}

impl Node for Detector {
    const TYPE: &'static str = "blob.detector";
    const ROLE: Role = Role::Detector;
    const SUMMARY: &'static str = "Finds what moves before a learnt background in the pictures of one camera";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = BlobSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: BlobSettings, setup: &Setup) -> Result<Self, ConfigError> {
        settings.check()?;
        let size = setup.camera_model().map(|it| it.image_size);
        let background = match settings.background.as_str() {
            "" => None,
            text => Some(read_background(&setup.path("background", text)?, size)?),
        };
        let shell = DetectorShell::new(setup);
        let settings = of_camera(settings, &shell)?;
        let blob_detector = BlobDetector::new(settings, size, background).map_err(ConfigError::node)?;
        Ok(Self { blob_detector, shell })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Self { blob_detector, shell } = self;
        let flooded = "too much of the picture differs from the learnt background";
        shell.process(io, &PORTS, flooded, |image, predicted, model, features| {
            blob_detector.find(image, predicted, |pixel| up_at(model, pixel), features)
        });
        Ok(())
    }

    fn change(&mut self, settings: BlobSettings) -> Result<(), ConfigError> {
        settings.check()?;
        self.blob_detector.change(of_camera(settings, &self.shell)?).map_err(ConfigError::node)
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.shell.report(report);
        Ok(())
    }
}

/// The settings with all masks of the camera among `masks`.
fn of_camera(settings: BlobSettings, shell: &DetectorShell) -> Result<BlobSettings, ConfigError> {
    let masks = shell.masks(&settings.masks, &settings.camera_masks)?;
    Ok(BlobSettings { masks, ..settings })
}

/// Direction of the world's +Z in the picture at `pixel`, for a point 3 m away; the picture's own up without a camera model,
/// or where Z runs along the line of sight.
fn up_at(model: Option<&Camera>, pixel: &Point2<f64>) -> Vector2<f64> {
    let seen = |camera: &Camera| {
        let foot = camera.ray(pixel)?.at(3.0);
        let up = camera.project(&(foot + Vector3::z() * 0.1))? - camera.project(&foot)?;
        up.try_normalize(1e-6)
    };
    model.and_then(seen).unwrap_or(Vector2::new(0.0, -1.0))
}

/// Reads a picture as brightness. From a picture larger than the camera's, the part at the top left with the camera's size.
fn read_background(path: &Path, size: Option<[u32; 2]>) -> Result<GrayPicture, ConfigError> {
    let refuse = |text: String| ConfigError::at("background", text);
    let picture = image::open(path).map_err(|error| refuse(format!("`{}` cannot be read: {error}", path.display())))?;
    let gray = picture.into_luma8();
    let size = size.unwrap_or([gray.width(), gray.height()]);
    if gray.width() < size[0] || gray.height() < size[1] {
        let ([w, h], a, b) = (size, gray.width(), gray.height());
        return Err(refuse(format!(
            "`{}` is {a} x {b} px, expected at least the camera's {w} x {h} px",
            path.display()
        )));
    }
    let pixels = image::imageops::crop_imm(&gray, 0, 0, size[0], size[1]).to_image().into_raw();
    Ok(GrayPicture { size, pixels })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_testkit::check_node;
    use foveate_testkit::scene::{camera_ring, ring_calibration};
    use image::GrayImage;

    use super::*;

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Detector>("");
        check_node::<Detector>("point = \"top\"\nmasks = [[[0, 0], [10, 0], [0, 10.5]]]\nshrink = 2");
    }

    #[test]
    fn settings_out_of_range_are_named() {
        let setting = |change: fn(&mut BlobSettings)| {
            let mut settings = BlobSettings::default();
            change(&mut settings);
            Detector::new(settings, &Setup::for_tests()).err().and_then(|it| it.setting)
        };
        assert_eq!(setting(|_| ()), None);
        assert_eq!(setting(|it| it.learn_frames = 0).as_deref(), Some("learn_frames"));
        assert_eq!(setting(|it| it.threshold_sigma = f32::NAN).as_deref(), Some("threshold_sigma"));
        assert_eq!(setting(|it| it.sure_sigma = 1.0).as_deref(), Some("sure_sigma"));
        assert_eq!(setting(|it| it.max_area_px = 1).as_deref(), Some("max_area_px"));
        assert_eq!(setting(|it| it.shrink = 17).as_deref(), Some("shrink"));
        assert_eq!(setting(|it| it.shape_error = -1.0).as_deref(), Some("shape_error"));
        assert_eq!(setting(|it| it.masks = vec![vec![[0.0; 2]; 2]]).as_deref(), Some("masks[0]"));
        assert_eq!(setting(|it| it.background = "/no/such.png".into()).as_deref(), Some("background"));
    }

    #[test]
    fn a_background_picture_must_cover_the_camera_s() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("empty.png");
        let new = |size: [u32; 2]| {
            GrayImage::new(size[0], size[1]).save(&path).unwrap();
            let calibration = Arc::new(ring_calibration(3)); // 640 × 480 px
            let setup = Setup { camera: Some(CameraId(0)), calibration, ..Setup::for_tests() };
            let settings = BlobSettings { background: path.display().to_string(), ..BlobSettings::default() };
            Detector::new(settings, &setup).map(|_| ()).map_err(|it| it.message)
        };
        assert_eq!(new([648, 480]), Ok(()));
        assert!(new([640, 479]).unwrap_err().contains("640 x 479 px"));
    }

    #[test]
    fn up_in_the_world_is_up_in_the_picture_of_an_upright_camera() {
        let camera = &camera_ring(3)[0];
        let up = up_at(Some(camera), &Point2::new(320.0, 240.0));
        assert!(up.y < -0.99, "{up}");
        assert_eq!(up_at(None, &Point2::origin()), Vector2::new(0.0, -1.0));
    }
}
