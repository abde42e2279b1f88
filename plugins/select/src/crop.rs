//! `select.crop`: tracks a target with a part of a high-resolution picture [Davis 2002 §2.2].

use foveate::geometry::Camera;
use foveate::imaging::{Channel, ImageView, plane, shrink};
use foveate::messages::Window;
use foveate::prelude::*;
use foveate::scene::anchor::{Anchor, AnchorRule, AnchorState, Pick, TargetObservation};
use nalgebra::{Matrix6, Point2};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

ports! {
    IMAGE: In<Image> = each("image");
    TARGET: In<Targets> = latest("target").of_parent().optional();
    TARGETS: In<Targets> = latest("targets").optional();
    INSIDE: Out<Image> = "inside";
    COARSE: Out<Image> = "coarse";
    REGION: Out<SubRegion> = "region";
}

figures! {
        "crop.pictures.*": count, high, "Pictures of the camera from which a part was cut out";
        "crop.lost.*": count, low, "Pictures without a part because there was no target";
        "crop.out_of_view.*": count, low, "Pictures without a part because the target was out of view";
        "crop.refused.*": count, low, "Pictures that could not be used: wrong size or pixels";
        "crop.pixels_kept.*": share, low, "Pixels sent, in parts and in reduced pictures, relative to the pixels received";
}

/// Settings of [`Crop`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct CropSettings {
    /// Columns of the part around the target; at most those of the picture [px].
    #[schemars(range(min = 1, max = 65535))]
    pub width_px: u32,
    /// Rows of the part [px].
    #[schemars(range(min = 1, max = 65535))]
    pub height_px: u32,
    /// Reduction factor of the whole picture that is sent as well, to find targets in; 0: none [–].
    #[schemars(range(min = 0, max = 16))]
    pub shrink: u32,
    /// Identity of the tracked target. Left out: the one that anchors the scale, or in a scale without an anchor the one that has
    /// lived longest [–].
    pub target: Option<u32>,
}

impl Default for CropSettings {
    fn default() -> Self {
        Self { width_px: 256, height_px: 256, shrink: 4, target: None }
    }
}

/// Pictures in; out a part of each at full resolution, centred on the target as far as the picture reaches, and the whole
/// picture reduced, in gray. Both carry their [`Window`], so that detections in them are in pixels of the camera.
///
/// The target is taken from `target`, which has points of the parent scale, or `targets`, of the own one, and extrapolated at its velocity to the picture's
/// time. Where it is lost or out of the picture, `inside` has a gap.
pub struct Crop {
    settings: CropSettings,
    camera: CameraId,
    camera_name: String,
    model: Camera,
    radius: Option<f64>,
    anchor: Anchor,
    /// Time of the last targets of the anchor.
    last_targets: Option<Time>,
    inside: Pool<Image>,
    coarse: Pool<Image>,
    gray: Vec<u8>,
    tally: Tally,
}

#[derive(Default)]
struct Tally {
    inside: u64,
    lost: u64,
    out_of_view: u64,
    refused: u64,
    pixels_in: u64,
    pixels_out: u64,
}

impl Node for Crop {
    const TYPE: &'static str = "select.crop";
    const ROLE: Role = Role::Selector;
    const SUMMARY: &'static str =
        "Cuts a window that follows a target out of each picture, and reduces the whole picture";
    const FIGURES: Figures = DECLARED_FIGURES;
    type Settings = CropSettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: CropSettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("width_px", settings.width_px, 1..=65_535)?;
        ConfigError::unless_in("height_px", settings.height_px, 1..=65_535)?;
        ConfigError::unless_in("shrink", settings.shrink, 0..=16)?;
        let (Some(camera), Some(model)) = (setup.camera, setup.camera_model()) else {
            return Err(ConfigError::node(
                "found no camera, expected `each` or `camera`: parts are those of one camera's pictures",
            ));
        };
        if setup.is_connected(&TARGET) && setup.is_connected(&TARGETS) {
            return Err(ConfigError::node(
                "found both `target` and `targets`, expected the targets of the parent scale or those of its own",
            ));
        }
        let mut rule = setup.anchor.unwrap_or_default();
        if let Some(id) = settings.target {
            rule.pick = Pick::Id(id);
        }
        Ok(Self::following(rule, settings, camera, model.clone(), setup))
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        let Some(image) = io.take(&IMAGE) else { return Ok(()) };
        let time = image.time();
        if let Err(reason) = self.check(&image.value) {
            self.tally.refused += 1;
            io.gap(&INSIDE, time, &reason);
            if self.settings.shrink > 0 {
                io.gap(&COARSE, time, reason);
            }
            return Ok(());
        }
        self.tally.pixels_in += u64::from(image.value.width) * u64::from(image.value.height);
        if self.settings.shrink > 0 {
            match self.made_smaller(&image.value) {
                Ok(smaller) => io.emit(&COARSE, image.stamp, smaller),
                Err(reason) => io.gap(&COARSE, time, reason),
            }
        }
        if let Some(targets) = io.latest(&TARGET).or_else(|| io.latest(&TARGETS)) {
            self.take_targets(targets.value);
        }
        let Some(target) = self.target_at(time) else {
            self.tally.lost += 1;
            io.gap(&INSIDE, time, "there is no target to look at");
            return Ok(());
        };
        let Some(pixel) = self.model.sees(&target.position) else {
            self.tally.out_of_view += 1;
            io.gap(&INSIDE, time, "the target is out of the picture");
            return Ok(());
        };
        let inside = self.cut_out(&image.value, &pixel);
        let depth = (self.model.camera_from_world * target.position).z;
        let half_px = f64::from(inside.width.min(inside.height)) / 2.0;
        let focal = self.model.intrinsics.focal;
        let region = SubRegion {
            time,
            target: TargetId(target.id),
            centre: target.position,
            velocity: target.velocity,
            covariance: target.covariance,
            radius: self.radius.unwrap_or(half_px * depth / focal[0].max(focal[1])),
            provenance: if target.is_measured { Provenance::Measured } else { Provenance::Predicted },
        };
        io.emit(&INSIDE, image.stamp, inside);
        io.emit(&REGION, image.stamp, region);
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        let Tally { inside, lost, out_of_view, refused, pixels_in, pixels_out } = self.tally;
        let name = &self.camera_name;
        report.figure(format!("crop.pictures.{name}"), inside as f64);
        for (what, count) in [("lost", lost), ("out_of_view", out_of_view), ("refused", refused)] {
            if count > 0 {
                report.figure(format!("crop.{what}.{name}"), count as f64);
            }
        }
        if pixels_in > 0 {
            report.figure(format!("crop.pixels_kept.{name}"), pixels_out as f64 / pixels_in as f64);
        }
        Ok(())
    }
}

impl Crop {
    fn following(rule: AnchorRule, settings: CropSettings, camera: CameraId, model: Camera, setup: &Setup) -> Self {
        Self {
            settings,
            camera,
            camera_name: setup.camera_name().unwrap_or(&setup.instance).to_owned(),
            model,
            radius: setup.radius_m,
            anchor: Anchor::new(rule),
            last_targets: None,
            inside: Pool::default(),
            coarse: Pool::default(),
            gray: Vec::new(),
            tally: Tally::default(),
        }
    }

    /// Whether this is a whole picture of the camera.
    fn check(&self, image: &Image) -> Result<(), String> {
        let (size, expected) = ([image.width, image.height], self.model.image_size);
        if image.window != Window::default() || size != expected {
            let ([w, h], [a, b]) = (expected, size);
            let Window { left, top, shrink } = image.window;
            return Err(format!(
                "the picture is {a} x {b} px at ({left}, {top}), 1/{shrink} of its size: expected the camera's whole {w} x {h} px"
            ));
        }
        let (found, promised) = (image.pixels.len(), size[0] as usize * size[1] as usize * image.format.channels());
        if found == promised { Ok(()) } else { Err(format!("the picture has {found} bytes, expected {promised}")) }
    }

    fn take_targets(&mut self, targets: &Targets) {
        if self.last_targets.is_some_and(|last| targets.time <= last) {
            return;
        }
        self.last_targets = Some(targets.time);
        let observations = targets.list.iter().map(|it| TargetObservation {
            id: it.id.0,
            position: it.position,
            velocity: it.velocity,
            covariance: it.covariance,
            is_measured: it.provenance == Provenance::Measured,
        });
        self.anchor.update(targets.time.0, observations);
    }

    /// The target, extrapolated to `time`; `None`: it is lost, or no targets have come for that long.
    fn target_at(&self, time: Time) -> Option<TargetObservation> {
        let AnchorState::Found(target) = self.anchor.state() else { return None };
        let later = time - self.last_targets?;
        if later.0 > self.anchor.rule().lost_ns {
            return None;
        }
        let mut carry_on = Matrix6::identity();
        carry_on.fixed_view_mut::<3, 3>(0, 3).fill_diagonal(later.as_s());
        Some(TargetObservation {
            position: target.position + target.velocity * later.as_s(),
            covariance: carry_on * target.covariance * carry_on.transpose(),
            is_measured: target.is_measured && later.0 == 0,
            ..target
        })
    }

    /// The part around `pixel`.
    fn cut_out(&mut self, image: &Image, pixel: &Point2<f64>) -> std::sync::Arc<Image> {
        let place = |at: f64, part: u32, whole: u32| {
            let part = part.min(whole);
            // Beyond either end it is cut off, and `as` takes no number for 0.
            (part, ((at - (f64::from(part) - 1.0) / 2.0).round().max(0.0) as u32).min(whole - part))
        };
        let (width, left) = place(pixel.x, self.settings.width_px, image.width);
        let (height, top) = place(pixel.y, self.settings.height_px, image.height);
        let mut part = self.inside.take(Image::default);
        part.camera = self.camera;
        (part.width, part.height, part.format) = (width, height, image.format);
        part.window = Window { left, top, shrink: 1 };
        part.pixels.clear();
        let channels = image.format.channels();
        for row in top..top + height {
            let start = (row as usize * image.width as usize + left as usize) * channels;
            part.pixels.extend_from_slice(&image.pixels[start..start + width as usize * channels]);
        }
        self.tally.inside += 1;
        self.tally.pixels_out += u64::from(width) * u64::from(height);
        self.inside.share(part)
    }

    /// The reduced picture, each pixel the mean of several.
    fn made_smaller(&mut self, image: &Image) -> Result<std::sync::Arc<Image>, foveate::imaging::ImagingError> {
        let pixels = match image.format {
            PixelFormat::Gray8 => image.pixels.as_slice(),
            PixelFormat::Rgb8 => {
                plane::extract(Channel::Luma, &image.pixels, &mut self.gray)?;
                &self.gray
            }
        };
        let view = ImageView::new(pixels, image.width as usize, image.height as usize)?;
        let mut small = self.coarse.take(Image::default);
        let (width, height) = shrink::shrink(&view, self.settings.shrink as usize, &mut small.pixels)?;
        small.camera = self.camera;
        (small.width, small.height, small.format) = (width as u32, height as u32, PixelFormat::Gray8);
        small.window = Window { left: 0, top: 0, shrink: self.settings.shrink };
        self.tally.pixels_out += (width * height) as u64;
        Ok(self.coarse.share(small))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use foveate_testkit::check_node;
    use foveate_testkit::scene::{add_spot, ring_calibration};
    use nalgebra::{Point3, Vector3};

    use super::*;

    fn setup(connected: &[&str]) -> Setup {
        Setup {
            camera: Some(CameraId(1)),
            calibration: Arc::new(ring_calibration(4)),
            connected: connected.iter().map(|it| (*it).to_owned()).collect(),
            ..Setup::for_tests()
        }
    }

    fn crop(settings: CropSettings) -> Crop {
        let rule = AnchorRule { settle_ns: 0, ..AnchorRule::default() };
        let setup = setup(&[]);
        Crop::following(rule, settings, CameraId(1), setup.camera_model().unwrap().clone(), &setup)
    }

    fn targets(time_s: f64, list: &[(u32, Point3<f64>, Vector3<f64>)]) -> Targets {
        let target = |(id, position, velocity): &(u32, Point3<f64>, Vector3<f64>)| Target {
            id: TargetId(*id),
            position: *position,
            velocity: *velocity,
            covariance: Matrix6::identity() * 1e-4,
            cameras: CameraSet::default(),
            provenance: Provenance::Measured,
        };
        Targets { time: Time::from_s(time_s), list: list.iter().map(target).collect() }
    }

    /// 640 × 480 px, each pixel another level than its neighbours.
    fn picture(format: PixelFormat) -> Image {
        let level = |at: usize| ((at % 640) * 3 + (at / 640) * 7) as u8;
        let pixels = (0..640 * 480).flat_map(|at| std::iter::repeat_n(level(at), format.channels())).collect();
        Image { camera: CameraId(1), width: 640, height: 480, format, pixels, ..Image::default() }
    }

    #[test]
    fn a_part_has_the_target_in_the_middle_and_the_pixels_of_the_whole() {
        for format in [PixelFormat::Gray8, PixelFormat::Rgb8] {
            let mut crop = crop(CropSettings { width_px: 101, height_px: 51, ..CropSettings::default() });
            let image = picture(format);
            let part = crop.cut_out(&image, &Point2::new(300.3, 200.4));
            assert_eq!((part.width, part.height, part.window), (101, 51, Window { left: 250, top: 175, shrink: 1 }));
            assert_eq!((part.camera, part.format), (CameraId(1), format));
            let n = format.channels();
            for (x, y) in [(0, 0), (100, 0), (37, 29), (100, 50)] {
                let whole = image.pixels[((175 + y) * 640 + 250 + x) * n];
                assert_eq!(part.pixels[(y * 101 + x) * n], whole, "({x}, {y})");
            }
            assert_eq!(part.pixels.len(), 101 * 51 * n);
        }
    }

    #[test]
    fn at_the_edge_the_part_stays_in_the_picture_and_keeps_its_size() {
        let mut crop = crop(CropSettings { width_px: 100, height_px: 60, ..CropSettings::default() });
        let image = picture(PixelFormat::Gray8);
        for (pixel, corner) in [([0.0, 0.0], [0, 0]), ([639.4, 479.4], [540, 420]), ([20.0, 470.0], [0, 420])] {
            let part = crop.cut_out(&image, &Point2::from(pixel));
            assert_eq!(([part.width, part.height], [part.window.left, part.window.top]), ([100, 60], corner));
        }
        crop.settings.width_px = 5000;
        let part = crop.cut_out(&image, &Point2::new(300.0, 200.0));
        assert_eq!((part.width, part.window.left), (640, 0), "no wider than the picture");
    }

    #[test]
    fn the_target_is_extrapolated_to_the_time_of_the_picture_and_lost_when_no_targets_come() {
        let mut crop = crop(CropSettings::default());
        assert_eq!(crop.target_at(Time::ZERO), None);
        let (place, velocity) = (Point3::new(0.1, 0.2, 1.0), Vector3::new(1.0, 0.0, -0.5));
        crop.take_targets(&targets(1.0, &[(7, place, velocity)]));
        let at = |crop: &Crop, time_s: f64| crop.target_at(Time::from_s(time_s));
        let now = at(&crop, 1.0).unwrap();
        assert!(now.is_measured && now.id == 7 && now.position == place);
        let later = at(&crop, 1.2).unwrap();
        assert!((later.position - (place + velocity * 0.2)).norm() < 1e-12 && !later.is_measured);
        // Variance of the position: 1e-4 + 0.2² · 1e-4.
        assert!((later.covariance[(0, 0)] - 1.04e-4).abs() < 1e-12, "{}", later.covariance);
        assert!((later.covariance[(0, 3)] - 0.2e-4).abs() < 1e-12);
        assert!(at(&crop, 0.9).is_some(), "a picture from before the targets");
        assert_eq!(at(&crop, 1.6), None);
        // Old news change nothing.
        crop.take_targets(&targets(0.5, &[]));
        assert!(at(&crop, 1.2).is_some());
        crop.take_targets(&targets(1.3, &[]));
        assert_eq!(at(&crop, 1.3), None);
    }

    #[test]
    fn what_is_found_in_either_picture_is_in_pixels_of_the_camera() {
        let mut crop = crop(CropSettings { width_px: 64, height_px: 64, shrink: 4, target: None });
        let truth = Point2::new(411.3, 122.6);
        let mut image = Image { pixels: vec![0; 640 * 480], ..picture(PixelFormat::Gray8) };
        add_spot(&mut image, [truth.x, truth.y], 3.0, 200.0);
        let centroid = |image: &Image| {
            let (mut sum, mut moment) = (0.0, [0.0; 2]);
            for (at, level) in image.pixels.iter().enumerate() {
                let (x, y) = (at % image.width as usize, at / image.width as usize);
                let level = f64::from(*level);
                (sum, moment) = (sum + level, [moment[0] + level * x as f64, moment[1] + level * y as f64]);
            }
            image.window.in_camera(&Point2::new(moment[0] / sum, moment[1] / sum))
        };
        let inside = crop.cut_out(&image, &Point2::new(405.0, 130.0));
        assert!((centroid(&inside) - truth).norm() < 0.05, "{}", centroid(&inside));
        let coarse = crop.made_smaller(&image).unwrap();
        assert_eq!((coarse.width, coarse.height), (160, 120));
        assert!((centroid(&coarse) - truth).norm() < 0.1, "{}", centroid(&coarse));
    }

    #[test]
    fn only_whole_pictures_of_the_camera_are_cut() {
        let crop = crop(CropSettings::default());
        let whole = picture(PixelFormat::Gray8);
        assert_eq!(crop.check(&whole), Ok(()));
        let part = Image { window: Window { left: 1, ..Window::default() }, ..whole.clone() };
        assert!(crop.check(&part).is_err_and(|it| it.contains("at (1, 0)")));
        assert!(crop.check(&Image { width: 639, ..whole.clone() }).is_err_and(|it| it.contains("whole 640 x 480 px")));
        assert!(crop.check(&Image { pixels: vec![1; 3], ..whole }).is_err_and(|it| it.contains("3 bytes")));
    }

    #[test]
    fn node_keeps_its_promises() {
        check_node::<Crop>("");
        check_node::<Crop>("width_px = 192\nshrink = 0\ntarget = 3");
    }

    #[test]
    fn a_crop_without_a_camera_or_with_two_kinds_of_targets_is_refused() {
        let new = |settings, setup: &Setup| Crop::new(settings, setup).err().map(|it| it.to_string());
        assert_eq!(new(CropSettings::default(), &setup(&["image", "target"])), None);
        let none = Setup { camera: None, ..setup(&[]) };
        assert!(new(CropSettings::default(), &none).is_some_and(|it| it.contains("camera")));
        assert!(new(CropSettings::default(), &setup(&["target", "targets"])).is_some_and(|it| it.contains("both")));
        let coarse = CropSettings { shrink: 17, ..CropSettings::default() };
        assert!(new(coarse, &setup(&[])).is_some_and(|it| it.contains("17")));
    }
}
