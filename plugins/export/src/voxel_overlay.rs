//! `export.voxel_overlay`: silhouettes, voxels and skeletons over the pictures of one camera, as a series of PNG files.
//!
//! The outline of the silhouette is magenta, voxels are tinted by their component and shaded by their depth, so that the hull's shape can be seen; where the silhouette extends beyond the
//! voxels nothing is tinted. Bones lie over them: white where their lower joint was measured, orange where it is predicted, gray where it is set by proportions. A series of `voxels/CAMERA_NUMBER.png` becomes a film with `ffmpeg -i voxels/CAMERA_%06d.png film.mp4`.

use std::collections::VecDeque;
use std::fs;
use std::path::PathBuf;
use std::sync::Arc;

use foveate::geometry::Camera;
use foveate::plot::canvas::Canvas;
use foveate::prelude::*;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::csv::file_part;
use crate::row_file::write_whole;

ports! {
    IMAGE: In<Image> = each("image");
    SILHOUETTE: In<Silhouette> = each("silhouette").optional();
    POSE: In<HeadPose> = each("pose").optional();
    VOXELS: In<Voxels> = each("voxels");
    SKELETONS: In<Skeletons> = each("skeletons").optional();
}

/// Messages of each kind that wait for the others.
const HELD: usize = 8;
/// The folder within the results.
const FOLDER: &str = "voxels";
/// Joints, upper and lower, of each bone; their numbers are those of `BODY_JOINTS`.
const BONES: [[u8; 2]; 15] = [
    [0, 1],
    [1, 2],
    [1, 3],
    [2, 4],
    [3, 5],
    [4, 6],
    [5, 7],
    [2, 8],
    [3, 9],
    [8, 9],
    [8, 10],
    [9, 11],
    [10, 12],
    [11, 13],
    [2, 3],
];
const BONE_PX: f64 = 2.0;
const OUTLINE: [u8; 3] = [255, 0, 255];
/// Colours of components, in turn.
const TINTS: [[u8; 3]; 6] =
    [[0, 220, 255], [255, 200, 0], [80, 255, 80], [255, 110, 80], [160, 130, 255], [255, 255, 255]];

/// Settings of [`ExportVoxelOverlay`].
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ExportVoxelOverlaySettings {
    /// Every n-th set of voxels is drawn, and the last one [–]
    #[schemars(range(min = 1, max = 1000000))]
    pub every_n: u64,
    /// Pictures drawn at most [–]
    #[schemars(range(min = 1, max = 100000))]
    pub max_pictures: u64,
    /// Opacity of the tint of voxels; 0: silhouettes only [–]
    #[schemars(range(min = 0.0, max = 1.0))]
    pub tint: f64,
}

impl Default for ExportVoxelOverlaySettings {
    fn default() -> Self {
        Self { every_n: 25, max_pictures: 20, tint: 0.55 }
    }
}

/// Pictures, silhouettes and voxels of one time in; pictures out.
pub struct ExportVoxelOverlay {
    settings: ExportVoxelOverlaySettings,
    name: String,
    model: Camera,
    out_dir: Option<PathBuf>,
    images: VecDeque<(Time, Arc<Image>)>,
    silhouettes: VecDeque<(Time, Arc<Silhouette>)>,
    poses: VecDeque<(Time, Arc<HeadPose>)>,
    skeletons: VecDeque<(Time, Arc<Skeletons>)>,
    has_silhouettes: bool,
    has_skeletons: bool,
    has_poses: bool,
    /// Sets that wait for their picture, with their number.
    waiting: VecDeque<(u64, Arc<Voxels>)>,
    /// The newest set, if it is not to be drawn yet: the last one always is.
    newest: Option<(u64, Arc<Voxels>)>,
    n_come: u64,
    n_drawn: u64,
    n_without: u64,
    report: Report,
    fault: Option<String>,
}

impl Node for ExportVoxelOverlay {
    const TYPE: &'static str = "export.voxel_overlay";
    const ROLE: Role = Role::Sink;
    const SUMMARY: &'static str = "Writes camera pictures as PNG, with silhouettes and voxels drawn over them";
    type Settings = ExportVoxelOverlaySettings;

    fn ports() -> Ports {
        declared_ports()
    }

    fn new(settings: ExportVoxelOverlaySettings, setup: &Setup) -> Result<Self, ConfigError> {
        ConfigError::unless_in("every_n", settings.every_n, 1..=1_000_000)?;
        ConfigError::unless_in("max_pictures", settings.max_pictures, 1..=100_000)?;
        ConfigError::unless_in("tint", settings.tint, 0.0..=1.0)?;
        let name = file_part(setup.camera_name().unwrap_or(&setup.instance));
        setup.claim_file(None, &format!("{FOLDER}/{name}_*.png"))?;
        let model = setup.camera_model().cloned().ok_or_else(|| {
            ConfigError::node(
                "found no camera, expected `each` or `camera`: voxels are drawn into one camera's pictures",
            )
        })?;
        Ok(Self {
            settings,
            name,
            model,
            out_dir: setup.out_dir.clone(),
            images: VecDeque::new(),
            silhouettes: VecDeque::new(),
            poses: VecDeque::new(),
            skeletons: VecDeque::new(),
            has_skeletons: setup.is_connected(&SKELETONS),
            has_silhouettes: setup.is_connected(&SILHOUETTE),
            has_poses: setup.is_connected(&POSE),
            waiting: VecDeque::new(),
            newest: None,
            n_come: 0,
            n_drawn: 0,
            n_without: 0,
            report: Report::default(),
            fault: None,
        })
    }

    fn process(&mut self, io: &mut Io<'_>) -> Result<(), NodeError> {
        if let Some(it) = io.take(&IMAGE) {
            hold(&mut self.images, it);
        }
        if let Some(it) = io.take(&SILHOUETTE) {
            hold(&mut self.silhouettes, it);
        }
        if let Some(it) = io.take(&POSE) {
            hold(&mut self.poses, it);
        }
        if let Some(it) = io.take(&SKELETONS) {
            hold(&mut self.skeletons, it);
        }
        if let Some(voxels) = io.take(&VOXELS) {
            let number = self.n_come;
            self.n_come += 1;
            self.newest = None;
            if number.is_multiple_of(self.settings.every_n) && self.n_drawn < self.settings.max_pictures {
                self.waiting.push_back((number, voxels.value));
            } else {
                self.newest = Some((number, voxels.value));
            }
        }
        // What completes a set of silhouettes may reach the carver before it comes here.
        for (number, voxels) in std::mem::take(&mut self.waiting) {
            if !self.draw(number, &voxels) {
                self.waiting.push_back((number, voxels));
            }
        }
        if self.waiting.len() > HELD {
            self.waiting.pop_front();
            self.n_without += 1;
        }
        Ok(())
    }

    fn finish(&mut self, report: &mut Report) -> Result<(), NodeError> {
        self.n_without += self.waiting.len() as u64;
        if let Some((number, voxels)) = self.newest.take().filter(|_| self.n_drawn < self.settings.max_pictures) {
            // Without a picture of its time it was not asked for.
            let _ = self.draw(number, &voxels);
        }
        if self.n_without > 0 {
            let n = self.n_without;
            report.remark(format!(
                "{}: {n} sets of voxels were not drawn: no picture (or pose, or skeletons) of their time came",
                self.name
            ));
        }
        report.open_first = self.report.files.last().cloned();
        report.files.append(&mut self.report.files);
        self.fault.take().map_or(Ok(()), |fault| Err(NodeError::input(fault)))
    }
}

/// The newest few.
fn hold<T>(held: &mut VecDeque<(Time, Arc<T>)>, message: Stamped<Arc<T>>) {
    held.push_back((message.stamp.time, message.value));
    if held.len() > HELD {
        held.pop_front();
    }
}

impl ExportVoxelOverlay {
    /// `false`: an input of that time is missing.
    fn draw(&mut self, number: u64, voxels: &Voxels) -> bool {
        // Cameras of one set may differ by the tolerance that joined them.
        fn nearest<T>(held: &VecDeque<(Time, Arc<T>)>, time: Time) -> Option<&Arc<T>> {
            let off = |it: &(Time, Arc<T>)| (it.0 - time).0.abs();
            held.iter().min_by_key(|it| off(it)).filter(|it| off(it) < 5_000_000).map(|it| &it.1)
        }
        let image = nearest(&self.images, voxels.time);
        let silhouette = nearest(&self.silhouettes, voxels.time);
        let pose = nearest(&self.poses, voxels.time);
        let skeletons = nearest(&self.skeletons, voxels.time);
        let is_whole = (silhouette.is_some() || !self.has_silhouettes)
            && (pose.is_some() || !self.has_poses)
            && (skeletons.is_some() || !self.has_skeletons);
        let (Some(image), true) = (image, is_whole) else { return false };
        self.n_drawn += 1;
        let Some(out_dir) = &self.out_dir else { return true };
        let mut camera = self.model.clone();
        if let Some(pose) = pose {
            camera.camera_from_world = pose.camera_from_world;
        }
        camera.camera_from_world *= voxels.world_from_scale;
        let mut canvas = Canvas::of(&image.pixels, image.width, image.format.channels(), 1, 1.0);
        tint(&mut canvas, image, &camera, voxels, self.settings.tint);
        if let Some(silhouette) = silhouette.filter(|it| it.window.shrink == image.window.shrink) {
            // A silhouette may be of a part of the picture.
            let place =
                |it: foveate::messages::Window| [it.left, it.top].map(|it| i64::from(it / image.window.shrink.max(1)));
            let [of, whole] = [silhouette.window, image.window].map(place);
            let is_body = |x: i64, y: i64| {
                let at = [x + whole[0] - of[0], y + whole[1] - of[1]].map(usize::try_from);
                matches!(at, [Ok(x), Ok(y)] if silhouette.is_body(x, y))
            };
            canvas.outline(|x, y| is_body(i64::from(x), i64::from(y)), OUTLINE);
        }
        for skeleton in skeletons.iter().flat_map(|it| &it.list) {
            draw_bones(&mut canvas, image, &camera, skeleton);
        }
        let name = format!("{FOLDER}/{}_{number:06}.png", self.name);
        let written = canvas
            .png()
            .map_err(|error| format!("`{name}` cannot be encoded: {error}"))
            .and_then(|bytes| {
                let folder = out_dir.join(FOLDER);
                fs::create_dir_all(&folder).map_err(|error| format!("`{}`: {error}", folder.display()))?;
                Ok(bytes)
            })
            .and_then(|bytes| write_whole(Some(out_dir), &name, &bytes, &mut self.report));
        if let Err(fault) = written {
            self.fault.get_or_insert(fault);
        }
        true
    }
}

/// Draws the surface voxels, the nearest in front, each as a square of its projected size.
fn tint(canvas: &mut Canvas, image: &Image, camera: &Camera, voxels: &Voxels, strength: f64) {
    let window = image.window;
    let (width, height) = (image.width as usize, image.height as usize);
    let mut nearest = vec![(f32::INFINITY, 0u16); width * height];
    let focal = camera.intrinsics.focal[0] / f64::from(window.shrink.max(1));
    let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
    for voxel in voxels.iter().filter(|it| it.is_surface) {
        let centre = voxels.centre(voxel.index);
        let Some(pixel) = camera.project(&centre) else { continue };
        let depth = (camera.camera_from_world * centre).z;
        let (pixel, half) = (window.in_image(&pixel), 0.5 * focal * voxels.size / depth);
        let range = |at: f64, n: usize| {
            let [first, last] = [at - half, at + half].map(|it| (it + 0.5).floor());
            first.max(0.0) as usize..((last + 1.0).max(0.0) as usize).min(n)
        };
        let depth = depth as f32;
        (least, most) = (least.min(depth), most.max(depth));
        for row in range(pixel.y, height) {
            for column in range(pixel.x, width) {
                let at = &mut nearest[row * width + column];
                if depth < at.0 {
                    *at = (depth, voxel.component);
                }
            }
        }
    }
    let span = (most - least).max(1e-6);
    for (at, (depth, component)) in nearest.into_iter().enumerate() {
        if depth.is_finite() {
            let light = 1.0 - 0.75 * (depth - least) / span;
            let colour = TINTS[usize::from(component) % TINTS.len()].map(|it| (f32::from(it) * light) as u8);
            canvas.tint((at % width) as u32, (at / width) as u32, colour, strength);
        }
    }
}

/// Bones that the model has, over everything else.
fn draw_bones(canvas: &mut Canvas, image: &Image, camera: &Camera, skeleton: &Skeleton) {
    let joint = |number: u8| skeleton.joints.iter().find(|it| it.joint == number);
    let place = |it: &SkeletonJoint| {
        let pixel = image.window.in_image(&camera.project(&it.position)?);
        Some([pixel.x, pixel.y])
    };
    for [upper, lower] in BONES {
        let (Some(upper), Some(lower)) = (joint(upper), joint(lower)) else { continue };
        let (Some(from), Some(to)) = (place(upper), place(lower)) else { continue };
        let colour = match lower.provenance {
            Provenance::Measured => [255; 3],
            Provenance::Predicted => [255, 150, 0],
            _ => [150; 3],
        };
        canvas.line(from, to, BONE_PX, colour);
    }
}

#[cfg(test)]
mod tests {
    use foveate::messages::LimbDetail;
    use foveate_testkit::scene::ring_calibration;
    use nalgebra::{Matrix6, Point3, Vector3};

    use super::*;

    #[test]
    fn voxels_and_silhouettes_lie_where_the_camera_sees_them() {
        let folder = tempfile::tempdir().unwrap();
        let connected = ["image", "silhouette", "voxels", "skeletons"].map(str::to_owned).to_vec();
        let setup = Setup {
            out_dir: Some(folder.path().to_owned()),
            calibration: Arc::new(ring_calibration(3)),
            camera: Some(CameraId(0)),
            connected,
            ..Setup::for_tests()
        };
        let settings = ExportVoxelOverlaySettings { tint: 1.0, every_n: 1, ..ExportVoxelOverlaySettings::default() };
        let mut bench = NodeBench::<ExportVoxelOverlay>::with_setup(settings, &setup).unwrap();
        let time = Time::from_s(1.0);
        let image = Image { width: 640, height: 480, pixels: vec![20; 640 * 480], ..Image::default() };
        // Of a part of the picture, as of a camera on a head.
        let window = foveate::messages::Window { left: 20, top: 60, shrink: 1 };
        let mut silhouette =
            Silhouette { width: 200, height: 150, window, confidence: vec![0; 200 * 150], ..Silhouette::default() };
        (40..50).for_each(|y| silhouette.confidence[y * 200 + 30..y * 200 + 40].fill(255));
        // One voxel at the point that all cameras look at: the middle of the picture.
        let mut voxels =
            Voxels { time, size: 0.1, origin: Point3::new(-0.05, -0.05, 0.95), cells: [1; 3], ..Voxels::default() };
        voxels.push(&Voxel { is_surface: true, ..Voxel::default() });
        bench.feed(&IMAGE, time, image).unwrap();
        bench.feed(&VOXELS, time, voxels.clone()).unwrap();
        bench.feed(&SILHOUETTE, time, silhouette).unwrap();
        // An upper arm that stands on the voxel.
        let joint = |joint: u8, z: f64, provenance: Provenance| SkeletonJoint {
            joint,
            position: Point3::new(0.0, 0.0, z),
            velocity: Vector3::zeros(),
            covariance: Matrix6::identity() * 1e-4,
            provenance,
        };
        let joints = vec![joint(2, 1.0, Provenance::Measured), joint(4, 1.3, Provenance::Predicted)];
        let skeleton = Skeleton {
            id: 0,
            joints,
            parts: Vec::new(),
            limbs: [LimbDetail::Absent; 4],
            facing: 1.0,
            unexplained: 0.0,
            cameras: CameraSet::default(),
        };
        bench.feed(&SKELETONS, time, Skeletons { time, list: vec![skeleton], ..Skeletons::default() }).unwrap();
        bench.feed(&VOXELS, Time::from_s(2.0), Voxels { time: Time::from_s(2.0), ..voxels }).unwrap();
        let report = bench.finish().unwrap();
        assert!(report.remarks[0].contains("1 sets of voxels were not drawn"), "{:?}", report.remarks);
        let picture = image::open(folder.path().join("voxels/ring-1_000000.png")).unwrap().into_rgb8();
        assert_eq!(picture.get_pixel(320, 245).0, TINTS[0]);
        assert_eq!(picture.get_pixel(320, 220).0, [255, 150, 0]);
        assert_eq!(picture.get_pixel(325, 220).0, [20; 3]);
        assert_eq!(picture.get_pixel(290, 240).0, [20; 3]);
        let outline = picture.pixels().filter(|it| it.0 == OUTLINE).count();
        assert_eq!(outline, 4 * 9);
        assert_eq!(picture.get_pixel(50, 100).0, OUTLINE);
    }

    #[test]
    fn of_a_short_recording_the_first_and_the_last_set_are_drawn() {
        let folder = tempfile::tempdir().unwrap();
        let setup = Setup {
            out_dir: Some(folder.path().to_owned()),
            calibration: Arc::new(ring_calibration(3)),
            camera: Some(CameraId(0)),
            connected: ["image", "voxels"].map(str::to_owned).to_vec(),
            ..Setup::for_tests()
        };
        let mut bench =
            NodeBench::<ExportVoxelOverlay>::with_setup(ExportVoxelOverlaySettings::default(), &setup).unwrap();
        for frame in 0..12 {
            let time = Time::from_s(0.04 * f64::from(frame));
            let image = Image { width: 8, height: 6, pixels: vec![20; 48], ..Image::default() };
            bench.feed(&IMAGE, time, image).unwrap();
            bench.feed(&VOXELS, time, Voxels { time, ..Voxels::default() }).unwrap();
        }
        let report = bench.finish().unwrap();
        assert!(report.remarks.is_empty(), "{:?}", report.remarks);
        let mut names: Vec<_> =
            fs::read_dir(folder.path().join(FOLDER)).unwrap().map(|it| it.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["ring-1_000000.png", "ring-1_000011.png"]);
    }

    #[test]
    fn node_refuses_what_it_cannot_draw() {
        let refused = NodeBench::<ExportVoxelOverlay>::new(ExportVoxelOverlaySettings::default()).err().unwrap();
        assert!(refused.message.contains("found no camera"));
    }
}
